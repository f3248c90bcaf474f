"""Cosmic rays, the sky, and extended sources (discs, rings, images) as configuration.

Light that is no point: discs, rings and images of scattered starlight, as configuration.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, cast

from pydantic import BeforeValidator, Field

from cpic_core import InputError, is_file
from simulator.config.base import FrozenModel, canonical_keys, nearest, other_names, required, validate
from simulator.config.light import Real

Depth = Annotated[float, Field(ge=1, le=2000)]
Width = Annotated[float, Field(ge=0.1, le=100)]
Length = Annotated[float, Field(ge=10, le=100_000)]
Brightness = Annotated[float, Field(ge=0, le=40)]
LOSS_WIDTHS = 10  # the lower end of the truncated Landau law lies at most so many widths below its mean


class PhysicalTracks(FrozenModel):
    """Straight tracks of fast charged particles through a silicon layer.

    Isotropic particles cross a layer of ``depth_um``; chords longer than ``max_length_um`` are left out. A chord L
    leaves ``mean_loss_e_um`` L on average, with Landau fluctuations of width ``loss_width_e_um`` L cut off at
    ``loss_cut`` (Landau's lambda). ``diffusion_um`` is the Gaussian sigma of the collected charge.
    """

    depth_um: Depth
    max_length_um: Length
    mean_loss_e_um: Annotated[float, Field(gt=0, le=1e5)]
    loss_width_e_um: Annotated[float, Field(ge=0, le=1e4)]
    loss_cut: Annotated[float, Field(ge=1, le=200)]
    diffusion_um: Width

    def _check_values(self) -> None:
        _check_lengths(self.depth_um, self.max_length_um)
        if self.mean_loss_e_um < LOSS_WIDTHS * self.loss_width_e_um:
            allowed = f"at most mean_loss_e_um / {LOSS_WIDTHS} = {self.mean_loss_e_um / LOSS_WIDTHS:g}"
            raise InputError("loss_width_e_um", self.loss_width_e_um, unit="e-/um", allowed=allowed)


class PaperTracks(FrozenModel):
    """Streaks as Zhu et al. 2025 describe them.

    Chords of a layer of ``depth_um``. Charge does not depend on length: exponential up to ``tail_start`` e-foldings, a
    power law of index ``tail_index`` beyond, mean ``mean_charge_e``. The Gaussian sigma across is ``width_um`` with a
    relative scatter ``width_rms``; along the streak the charge varies by ``texture_rms`` in ``texture_waves`` Fourier
    components.
    """

    depth_um: Depth
    max_length_um: Length
    mean_charge_e: Annotated[float, Field(ge=1, le=1e7)]
    tail_start: Annotated[float, Field(gt=0, le=30)]
    tail_index: Annotated[float, Field(ge=2.5, le=100)]
    width_um: Width
    width_rms: Annotated[float, Field(ge=0, le=1)]
    texture_rms: Annotated[float, Field(ge=0, le=1)]
    texture_waves: Annotated[int, Field(ge=1, le=64)]

    def _check_values(self) -> None:
        _check_lengths(self.depth_um, self.max_length_um)


class TemplateTracks(FrozenModel):
    """Tracks taken from a set of small images, turned and placed at random, scaled to a charge of the law of ``paper``.

    ``template_file`` is a FITS cube or npz file (`simulator.effects.tracks`). Without one, ``generated_tracks``
    tracks of the physical model, sampled at ``sample_um``, are made from ``generated_seed``.
    """

    template_file: str | None
    generated_tracks: Annotated[int, Field(ge=1, le=5000)]
    generated_seed: Annotated[int, Field(ge=0)]
    sample_um: Annotated[float, Field(ge=0.5, le=100)]


class CosmicRayConfig(FrozenModel):
    """Cosmic rays: how many, and what they leave.

    The rate falls from ``peak_rate_per_s_cm2`` at solar minimum by the fraction ``cycle_depth`` at maximum;
    ``orbit_factor`` scales it to the orbit.
    """

    model: Literal["physical", "paper", "template"]
    peak_rate_per_s_cm2: Annotated[float, Field(ge=0, le=1e6)]
    cycle_depth: Annotated[float, Field(ge=0, le=1)]
    cycle_minimum_year: Annotated[float, Field(ge=1700, le=2300)]
    cycle_years: Annotated[float, Field(ge=1, le=100)]
    orbit_factor: Annotated[float, Field(ge=0, le=1000)]
    physical: PhysicalTracks
    paper: PaperTracks
    template: TemplateTracks


class ExtraLight(FrozenModel):
    """Light besides the sky: at most one of three.

    ``brightness_v_mag_arcsec2`` is a surface brightness of solar colour in front of the telescope; ``rate_e_s`` a
    uniform rate per pixel on the detector; ``map_file`` a FITS map of that rate over the whole frame (BUNIT
    electron/s), one for all bands or one by band.
    """

    brightness_v_mag_arcsec2: Brightness | None = None
    rate_e_s: Annotated[float, Field(ge=0, le=1e9)] | None = None
    map_file: str | dict[str, str] | None = None

    def _check_values(self) -> None:
        given = [name for name, value in self if value is not None]
        if len(given) > 1:
            raise InputError(given[1], f"given with {given[0]}", allowed="one of the two")

    def map_of(self, band: str) -> str | None:
        """Return the name of the map of a band, None if none is set.

        Raises
        ------
        InputError
            If there are maps by band and none for this one.
        """
        if not isinstance(self.map_file, dict):
            return self.map_file
        if band not in self.map_file:
            allowed = f"a map of each band, or of {band} at least"
            hint = f"there are maps of {', '.join(self.map_file) or 'no band'}"
            raise InputError("map_file", f"no map of {band}", allowed=allowed, hint=hint)
        return self.map_file[band]


class SkyConfig(FrozenModel):
    """Light of the sky, and what earthshine and stray light add.

    ``model`` is ``zodiacal``, by place, or ``uniform`` of solar colour and ``brightness_v_mag_arcsec2`` everywhere.
    ``season`` of the zodiacal light is ``median``, over the days of a year on which the target is at least
    ``sun_limit_deg`` from the Sun, or ``date``, that of the observation.

    ``exozodi_zodis`` is the dust assumed around every target, in units of the solar system's, in a disc seen face-on:
    22 mag/arcsec2 in V at 1 au of a solar twin, in proportion to the star's V light and ``r^-2``. Predictions count it
    and confirmations show it; a scene of one's own has the discs that it names.
    """

    model: Literal["zodiacal", "uniform"]
    season: Literal["median", "date"]
    sun_limit_deg: Annotated[float, Field(ge=0, le=90)]
    brightness_v_mag_arcsec2: Brightness
    exozodi_zodis: Annotated[float, Field(ge=0, le=1e5)]
    earthshine: ExtraLight
    stray_light: ExtraLight


_ONLY_WITH = {"brightness_v_mag_arcsec2": "uniform", "season": "zodiacal"}
_NO_LIGHT: dict[str, Any] = dict.fromkeys(ExtraLight.model_fields)


def own_sky(own: Mapping[str, Any], base: Mapping[str, Any]) -> dict[str, Any]:
    """Return a section ``sky`` as it is laid over that of another instrument.

    A number or map of earthshine or stray light replaces whatever the other instrument has for it. A uniform sky in
    place of a zodiacal one is all the light there is: earthshine comes with it only where it is given.

    Parameters
    ----------
    own, base : mapping
        The section as it was given, and that of the other instrument; values may have their sources.

    Raises
    ------
    InputError
        For a new value of a key that the model does not read, which would change nothing.
    """
    model = _plain(own.get("model", base["model"]))
    for key, reader in _ONLY_WITH.items():
        if key in own and model != reader and model in _ONLY_WITH.values() and _plain(own[key]) != _plain(base[key]):
            value = _plain(own[key])
            raise InputError(f"sky.{key}", value, allowed=f"only with sky.model: {reader}", hint=f"it is {model}")
    lights = {key: own[key] for key in ("earthshine", "stray_light") if isinstance(own.get(key), Mapping)}
    alone = {"earthshine": _NO_LIGHT} if model == "uniform" != _plain(base["model"]) else {}
    return {**alone, **own, **{key: {**_NO_LIGHT, **light} if light else light for key, light in lights.items()}}


def _plain(value: Any) -> Any:
    return value.get("value") if isinstance(value, Mapping) else value


def _check_lengths(depth_um: float, max_length_um: float) -> None:
    if max_length_um <= depth_um:
        raise InputError("max_length_um", max_length_um, unit="um", allowed=f"above depth_um = {depth_um:g}")


MAX_RADIUS_ARCSEC = 20.0
"""Largest disc; the detector reaches 12 arcsec into its corners."""

Radius = Annotated[Real, Field(ge=0, le=MAX_RADIUS_ARCSEC)]
Angle = Annotated[Real, Field(ge=-360, le=360)]
Inclination = Annotated[Real, Field(ge=0, le=90)]

_ALIASES = other_names(inner_arcsec="inner", outer_arcsec="outer", radius_arcsec="radius", fwhm_arcsec="fwhm")
_ALIASES |= other_names(inclination_deg="inclination incl_deg", pa_deg="position_angle position_angle_deg pangle pa")
_ALIASES |= other_names(v_mag="magnitude magnitude_v", pixel_scale_arcsec="pixel_scale pixscale", file="image")
_ALIASES |= other_names(center_separation_arcsec="centre_separation_arcsec center_separation centre_separation")
_ALIASES |= other_names(center_pa_deg="centre_pa_deg center_pa centre_pa", center_pixel="centre_pixel")
_MOVED = "center_separation_arcsec, with center_pa_deg, moves the centre away from the star"
_HINTS = {
    "separation": _MOVED,
    "separation_arcsec": _MOVED,
    "spectrum": "scattered light is grey: it has the star's spectrum",
    "albedo": "scattered light is grey: contrast is its total over the star's",
}
_KIND_WORDS = {"disk": "disc", "exozodi": "disc"}


class _Scattered(FrozenModel):
    """The fields that every extended source has.

    The light is that of the star, scattered without colour.

    Attributes
    ----------
    name : str
        Name in tables and the truth.
    contrast : float, optional
        Detected rate of the whole source over that of the central star in every band, before mask and aperture.
    v_mag : float, optional
        Total light as Johnson V, instead of ``contrast``.
    pa_deg : float
        Position angle of the major axis, or of what is up in an image, east of north.
    center_separation_arcsec, center_pa_deg : float
        Place of the centre from the star, east of north.
    """

    name: str = ""
    contrast: Annotated[Real, Field(gt=0, le=1)] | None = None
    v_mag: Annotated[Real, Field(ge=-30, le=60)] | None = None
    pa_deg: Angle = 0.0
    center_separation_arcsec: Radius = 0.0
    center_pa_deg: Angle = 0.0

    def _check_values(self) -> None:
        if self.contrast is None and self.v_mag is None:
            raise required("contrast", "total light over the star's, above 0, at most 1, or v_mag")
        if self.contrast is not None and self.v_mag is not None:
            raise InputError("contrast", "given with v_mag", allowed="one of the two")

    def contrast_to(self, star_v_mag: float) -> float:
        """Return the total light over that of a star of the given V magnitude, in every band."""
        if self.contrast is not None:
            return self.contrast
        assert self.v_mag is not None
        return float(10.0 ** (-0.4 * (self.v_mag - star_v_mag)))


class DiscSource(_Scattered):
    """A thin disc (exozodiacal dust, debris): surface brightness ``r^slope`` between two radii, else 0.

    Attributes
    ----------
    inner_arcsec, outer_arcsec : float
        Radii between which it shines, in the plane of the disc.
    slope : float
        Power of the radius with which the brightness goes.
    inclination_deg : float
        Inclination about the major axis: 0 face-on, 90 edge-on.
    """

    kind: Literal["disc"] = "disc"
    inner_arcsec: Radius
    outer_arcsec: Annotated[Real, Field(gt=0, le=MAX_RADIUS_ARCSEC)]
    slope: Annotated[Real, Field(ge=-10, le=10)] = 0.0
    inclination_deg: Inclination = 0.0

    def _check_values(self) -> None:
        super()._check_values()
        if self.inner_arcsec >= self.outer_arcsec:
            allowed = f"below outer_arcsec = {self.outer_arcsec:g}"
            raise InputError("inner_arcsec", self.inner_arcsec, unit="arcsec", allowed=allowed)
        if self.inner_arcsec == 0 and self.slope <= -2:
            raise InputError("slope", self.slope, allowed="above -2 where inner_arcsec is 0: the light must be finite")


class RingSource(_Scattered):
    """A thin ring: surface brightness a Gaussian of ``fwhm_arcsec`` about ``radius_arcsec``, in the plane of the ring.

    Attributes
    ----------
    radius_arcsec, fwhm_arcsec : float
        Radius of the ring, and full width at half maximum of its brightness.
    inclination_deg : float
        Inclination about the major axis: 0 face-on, 90 edge-on.
    """

    kind: Literal["ring"] = "ring"
    radius_arcsec: Annotated[Real, Field(gt=0, le=MAX_RADIUS_ARCSEC)]
    fwhm_arcsec: Annotated[Real, Field(gt=0, le=MAX_RADIUS_ARCSEC)]
    inclination_deg: Inclination = 0.0


class ImageSource(_Scattered):
    """An image in a FITS or npz file; its pixels are squares of even brightness.

    Without ``pa_deg`` north is up (+row) and east to the left (-column); ``pa_deg`` turns it so that up is at that
    position angle. The pixel is ``pixel_scale_arcsec``, or the header's ``PIXSCALE`` or ``CDELT``. The middle of the
    image, or ``center_pixel`` (column, row, from 0), is where the star stands, or at the ``center_...`` offset.
    Other orientation cards are not read.

    Attributes
    ----------
    file : str
        Path of a FITS or npz file.
    pixel_scale_arcsec : float, optional
        Side of a pixel.
    center_pixel : tuple of float, optional
        Column and row of the star, from 0.
    """

    kind: Literal["image"] = "image"
    file: str
    pixel_scale_arcsec: Annotated[Real, Field(gt=0, le=10)] | None = None
    center_pixel: tuple[Real, Real] | None = None

    def _check_values(self) -> None:
        super()._check_values()
        if not is_file(self.file):
            raise InputError("file", self.file, allowed="an existing FITS or npz file")


ExtendedSource: TypeAlias = DiscSource | RingSource | ImageSource
_BY_KIND: dict[str, type[_Scattered]] = {"disc": DiscSource, "ring": RingSource, "image": ImageSource}
_KEYS = tuple(dict.fromkeys(key for model in _BY_KIND.values() for key in model.model_fields))


def extended_source(value: Any) -> ExtendedSource:
    """Read an extended source as people write it.

    Parameters
    ----------
    value : ExtendedSource or mapping
        A mapping with ``kind`` (``disc``, ``ring`` or ``image``), which may be left out where the other keys decide: a
        ``file`` makes an image, a ``fwhm_arcsec`` a ring, anything else a disc. Numbers may carry units
        (`astropy.units`).

    Raises
    ------
    InputError
        Naming the key, its value and what is allowed.
    """
    if isinstance(value, ExtendedSource):
        return value
    if not isinstance(value, Mapping):
        raise InputError("extended", value, allowed="a mapping: disc, ring or image")
    tree = canonical_keys(value, _KEYS, _ALIASES, hints=_HINTS)
    kind = tree.get("kind") or ("image" if "file" in tree else "ring" if "fwhm_arcsec" in tree else "disc")
    word = kind.lower() if isinstance(kind, str) else kind
    name = _KIND_WORDS.get(word, word) if isinstance(word, str) else word
    if name not in _BY_KIND:
        raise InputError("kind", kind, allowed=", ".join(_BY_KIND), hint=nearest(kind, _BY_KIND))
    if isinstance(tree.get("file"), Path):
        tree["file"] = str(tree["file"])
    return cast("ExtendedSource", validate(_BY_KIND[name], tree | {"kind": name}))


ExtendedValue: TypeAlias = Annotated[ExtendedSource, BeforeValidator(extended_source)]
"""Field type of a model: reads whatever `extended_source` reads."""
