"""The instrument as configuration: every number of telescope, optics, detector and bands."""

import functools
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, TypeAlias

from pydantic import Field

from catalogs import band_from_file, band_provenance, load_bands
from cpic_core import InputError, by_line, is_file, load_mapping, load_yaml, split_sourced
from simulator.config.base import FrozenModel, Sourced, deep_merge, validate
from simulator.config.coronagraph_table import KEY as TABLE_KEY, CoronagraphTable, coronagraph_table
from simulator.config.detector import AnyDetector, Detector, assume_converter
from simulator.config.presets import preset_names, preset_path
from simulator.config.sky import CosmicRayConfig, SkyConfig, own_sky
from simulator.config.telescope import (
    CameraName,
    Channel,
    Coronagraph,
    DarkHoleConfig,
    Drift,
    MirrorConfig,
    MissionConfig,
    NearInfrared,
    Telescope,
    WavefrontConfig,
    drop_bands,
)
from simulator.config.yield_package import is_package
from simulator.detectors import INFRARED, VISIBLE, chain_preset

_ORIGIN = ("unit", "source", "confidence", "range", "note")
_MAPS = ("map_file", "template_file", "transmission_file", "surface_files", "calibration_files")
_FILE_KEYS = ("apodizer", "table", "psf", *_MAPS)
ARCSEC_PER_RAD = 180.0 * 3600.0 / math.pi

Fraction = Annotated[float, Field(ge=0, le=1)]


class BandConfig(FrozenModel):
    """One band: top-hat of ``width_nm`` around ``center_nm``, or a file of transmissions, from which both follow."""

    camera: CameraName = "VIS"
    center_nm: Annotated[float, Field(ge=300, le=1750)]
    width_nm: Annotated[float, Field(gt=0, le=1000)]
    t_opt: Annotated[float, Field(gt=0, le=1)]
    qe: Annotated[float, Field(gt=0, le=1)]
    transmission_file: str | None = None


class Instrument(FrozenModel, Sourced):
    """The whole instrument; frozen, hashed by content.

    ``provenance`` tells, per dotted key, where the number comes from and how sure it is.
    """

    name: str
    telescope: Telescope
    coronagraph: Coronagraph
    near_infrared: NearInfrared
    wavefront: WavefrontConfig
    mirror: MirrorConfig
    dark_hole: DarkHoleConfig
    drift: Drift
    detector: Detector
    cosmic_rays: CosmicRayConfig
    sky: SkyConfig
    bands: dict[str, BandConfig]
    overhead_s: Annotated[float, Field(ge=0, le=1e6)]
    mission: MissionConfig

    def _check_values(self) -> None:
        for key in ("coronagraph.inner_arcsec", "dark_hole.surface_files", "dark_hole.sensing_contrast_by_band"):
            section, _, field = key.partition(".")
            for name in getattr(getattr(self, section), field):
                if name not in self.bands:
                    raise InputError(key, name, allowed=f"names of bands: {', '.join(self.bands)}")
        self._check_table()
        least = 1.0 if self.coronagraph.table is None else 0.5
        for name, band in self.bands.items():
            section = self.channel(band.camera).section
            aperture, pixel = self.aperture_radius_arcsec(name), self.pixel_scale_arcsec(name)
            if not least <= aperture / pixel <= 20.0:
                allowed = f"{least:g} to 20 pixels in the aperture radius of {name}, not {aperture / pixel:.3g}"
                raise InputError("pixel_scale_arcsec", pixel, unit="arcsec", allowed=allowed)
            if self.coronagraph.is_ring:
                continue
            inner = self.hole_inner_arcsec(name) + 2 * aperture
            if inner >= self.hole_outer_arcsec(name):
                key, outer = f"{section}.outer_half_side_arcsec", self.hole_outer_arcsec(name)
                allowed = f"room for an aperture in the hole of {name}: above {inner:.3g}"
                raise InputError(key, outer, unit="arcsec", allowed=allowed)

    def _check_table(self) -> None:
        """Refuse what an optical model without a table does not know, and tables of bands that are not there."""
        named, telescope = self.coronagraph.table, self.telescope
        if named is None:
            for key in ("obstruction_diameter_ratio", "area_m2"):
                if getattr(telescope, key):
                    hint = "the optical model has a clear disc; give the coronagraph as coronagraph.table"
                    raise InputError(f"telescope.{key}", getattr(telescope, key), allowed="not given", hint=hint)
            return
        for band in () if isinstance(named, str) else named:
            if band not in self.bands:
                raise InputError(TABLE_KEY, band, allowed=f"names of bands: {', '.join(self.bands)}")
        for band in self.bands:
            self.table(band)

    def table(self, band: str) -> CoronagraphTable | None:
        """Return the table of the coronagraph in a band; None where the optics are modelled.

        Raises
        ------
        InputError
            As `simulator.config.coronagraph_table.coronagraph_table`; if the tables lack the band.
        """
        named = self.coronagraph.table
        if named is None:
            return None
        if not isinstance(named, str) and band not in named:
            raise InputError(TABLE_KEY, ", ".join(named), allowed=f"a table for every band, {band} has none")
        own, unit = self.coronagraph, self.lambda_d_arcsec(band)
        diameter = own.diameter_m or self.telescope.diameter_m
        return coronagraph_table(
            named if isinstance(named, str) else named[band],
            unit * self.telescope.diameter_m / diameter,
            diameter_m=diameter,
            is_stated=own.diameter_m is not None,
            aperture_arcsec=own.aperture_radius_lambda_d * unit,
            star_diameter_mas=own.star_diameter_mas,
        )

    def band(self, name: str) -> BandConfig:
        """Return the configuration of one band.

        Raises
        ------
        InputError
            If the instrument has no such band.
        """
        if not isinstance(name, str) or name not in self.bands:
            raise InputError("band", name, allowed=", ".join(self.bands))
        return self.bands[name]

    def channel(self, camera: str) -> Channel:
        """Return one camera, ``VIS`` or ``NIR``, with its optics."""
        own, optics, longest = self.detector, self.near_infrared, self.detector.exposure_max_s
        if camera == "VIS":
            return Channel("VIS", "visible", "coronagraph", own, self.coronagraph, own.pixel_scale_arcsec, longest)
        scale = optics.pixel_scale_arcsec
        return Channel("NIR", "near-infrared", "near_infrared", optics.detector, optics, scale, longest)

    def channel_of(self, band: str) -> Channel:
        """Return the camera of a band with its optics."""
        return self.channel(self.band(band).camera)

    def switched(self, switches: Mapping[str, bool] | None, *, camera: str | None = None) -> "Instrument":
        """Return this instrument with effects of its cameras switched on or off, by name, in each camera that has them.

        Parameters
        ----------
        switches : mapping of str to bool, optional
            Effects by the name of their switch.
        camera : {"VIS", "NIR"}, optional
            Camera that has to have them; either if not given.

        Raises
        ------
        InputError
            For a name that is no switch, or a value that is neither true nor false.
        """
        if switches is None:
            return self
        if not isinstance(switches, Mapping):
            raise InputError("switches", switches, allowed="a mapping of effects to true or false")
        if not switches:
            return self
        wanted = [self.channel("VIS"), self.channel("NIR")] if camera is None else [self.channel(camera)]
        known = sorted({name for channel in wanted for name in channel.switches})
        for name in switches:
            if name not in known:
                hint = "" if camera is None else f"the switches of the {wanted[0].words} camera"
                raise InputError("switches", name, allowed=", ".join(known), hint=hint)
        if not all(isinstance(value, bool) for value in switches.values()):
            raise InputError("switches", switches, allowed="a mapping of effects to true or false")
        infrared = self.near_infrared.detector.with_switches(switches)
        optics = self.near_infrared.model_copy(update={"detector": infrared})
        return self.model_copy(update={"detector": self.detector.with_switches(switches), "near_infrared": optics})

    def changed(self, own: Mapping[str, Any]) -> "Instrument":
        """Return the instrument with a mapping of what differs, as in an instrument's file, laid over it.

        Raises
        ------
        InputError
            Naming key, value, unit and allowed range of the first fault.
        """
        plain, provenance = split_sourced(dict(own))
        plain = _with_own_sky(_with_curves(plain), self.sky.model_dump())
        values = deep_merge(self.model_dump() | {"name": f"{self.name}+changes"}, plain)
        new = validate(Instrument, values, where="instrument")
        kept = {key: item for key, item in self._provenance.items() if not _within(plain, key)}
        new._provenance.update(kept | provenance)
        return new

    def visible_bands(self) -> tuple[str, ...]:
        """Return the names of the bands of the visible camera, by wavelength."""
        names = [name for name, band in self.bands.items() if band.camera == "VIS"]
        return tuple(sorted(names, key=lambda name: self.bands[name].center_nm))

    def lambda_d_arcsec(self, band: str) -> float:
        """Return the lambda/D at band centre."""
        return self.band(band).center_nm * 1e-9 / self.telescope.diameter_m * ARCSEC_PER_RAD

    def hole_inner_arcsec(self, band: str) -> float:
        """Return the inner edge ``a`` of the square zone, per axis; inner radius of a ring."""
        if (table := self._ring_table(band)) is not None:
            # A planet may stand at every separation of the table: its aperture reaches beyond.
            return float(table.separation_arcsec[0]) - self.aperture_radius_arcsec(band)
        corner = self.coronagraph.inner_arcsec.get(band)
        if corner is None:
            corner = self.coronagraph.inner_lambda_d * self.lambda_d_arcsec(band)
        return corner / math.sqrt(2.0)

    def hole_outer_arcsec(self, band: str) -> float:
        """Return the outer edge ``b`` of the square zone, per axis; outer radius of a ring."""
        if (table := self._ring_table(band)) is not None:
            return float(table.separation_arcsec[-1]) + self.aperture_radius_arcsec(band)
        return self.channel_of(band).optics.outer_half_side_arcsec

    def psf_file(self, band: str) -> str | None:
        """Return the file of the point-spread functions of a table's band; None where there is none."""
        named = self.coronagraph.psf
        return named.get(band) if isinstance(named, dict) else named

    def _ring_table(self, band: str) -> CoronagraphTable | None:
        return self.table(band) if self.coronagraph.is_ring else None

    def mask_half_width_arcsec(self, band: str) -> float:
        """Return half of the width of the bars of the cross; 0 where a table has a ring."""
        return 0.0 if self.coronagraph.is_ring else self.channel_of(band).optics.mask_half_width_arcsec

    def pixel_scale_arcsec(self, band: str) -> float:
        """Return the pixel of the band's camera."""
        return self.channel_of(band).pixel_scale_arcsec

    def detector_of(self, band: str) -> AnyDetector:
        """Return the detector of the band's camera."""
        return self.channel_of(band).detector

    def aperture_radius_arcsec(self, band: str) -> float:
        """Return the radius of the photometric aperture: that of the core of a table that has its area."""
        table = self.table(band)
        if table is not None and table.core_radius_arcsec is not None:
            return table.core_radius_arcsec
        return self.coronagraph.aperture_radius_lambda_d * self.lambda_d_arcsec(band)

    def aperture_pixels(self, band: str) -> float:
        """Return the area of the photometric aperture in pixels."""
        return math.pi * (self.aperture_radius_arcsec(band) / self.pixel_scale_arcsec(band)) ** 2


InstrumentLike: TypeAlias = Instrument | Mapping[str, Any] | str | Path | None
"""What the functions of the package take for an instrument; None is the default preset."""


@by_line
def load_instrument(source: str | Path | Mapping[str, Any] | None = None) -> Instrument:
    """Load an instrument.

    Parameters
    ----------
    source : str, Path, mapping or None
        Preset name, YAML path, or mapping; ``None`` is the default preset ``cpic_default``. A file or mapping
        needs to hold only what differs from its ``base`` (a preset name, ``cpic_default`` if absent). Files that it
        names (apodizer, mirror surfaces, band curves) are looked for beside it first.

    Returns
    -------
    Instrument

    Raises
    ------
    InputError
        Naming key, value, unit and allowed range of the first fault.

    Examples
    --------
    >>> from simulator import load_instrument
    >>> load_instrument({"detector": {"read_noise_e": 160}}).detector.read_noise_e
    160.0
    """
    if source is None or (isinstance(source, str | Path) and preset_path("instrument", str(source)) is not None):
        return _preset("cpic_default" if source is None else str(source))
    return Instrument.read(_tree(source), "instrument")


@functools.lru_cache(maxsize=16)
def _preset(name: str) -> Instrument:
    """Return a preset, read once: nobody can change it."""
    return Instrument.read(_preset_tree(name), "instrument")


def _tree(source: str | Path | Mapping[str, Any]) -> dict[str, Any]:
    if isinstance(source, Mapping):
        own: Any = dict(source)
    elif not isinstance(source, str | Path):
        raise InputError("instrument", source, allowed="a mapping, a YAML file or a preset")
    else:
        known = preset_path("instrument", str(source))
        if known is None and not is_file(source):
            hint = f"presets: {', '.join(preset_names('instrument'))}"
            raise InputError("instrument", str(source), allowed="a YAML file or a preset", hint=hint)
        tree = load_yaml(known, shipped=True) if known else load_mapping(source, "instrument", Instrument.model_fields)
        own = paths_beside(tree, Path(known or source).parent)
        if known is not None and isinstance(own, dict) and not {"bands", "base"} & set(own):
            own["bands"] = _shipped_bands()
    if not isinstance(own, dict):
        raise InputError("instrument", own, allowed="a mapping of keys to values")
    if own.pop("kind", "instrument") != "instrument":
        raise InputError("instrument", str(source), allowed="a file of kind: instrument")
    if "base" in own or isinstance(source, Mapping) or preset_path("instrument", str(source)) is None:
        base = own.pop("base", "cpic_default")
        if preset_path("instrument", str(base)) is None:
            raise InputError("base", base, allowed=", ".join(preset_names("instrument")))
        shipped = _preset_tree(str(base))
        own = _with_own_sky(_with_curves(own), shipped["sky"])
        merged = deep_merge(shipped, _plain_over_sourced(shipped, own))
        merged["name"] = own.get("name", f"{base}+changes" if own else base)
        drop_bands(own, merged)
        if isinstance(own.get("detector"), Mapping):
            assume_converter(own["detector"], shipped["detector"], merged["detector"])
        return merged
    # Effects may bring defaults of their own.
    brought = {"detector": chain_preset(VISIBLE), "near_infrared": {"detector": chain_preset(INFRARED)}}
    return deep_merge(brought, own)


_preset_tree = functools.lru_cache(maxsize=16)(_tree)  # of names; nobody changes what it returns


def _with_own_sky(own: dict[str, Any], base: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is laid over an instrument, with its section ``sky`` made ready for that."""
    return own | {"sky": own_sky(own["sky"], base)} if isinstance(own.get("sky"), Mapping) else own


def _with_curves(own: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is laid over an instrument; bands with a file have its curve's centre and width if they name none."""
    bands = dict(own["bands"]) if isinstance(own.get("bands"), Mapping) else {}
    for name, band in bands.items():
        file = band.get("transmission_file") if isinstance(band, Mapping) else None
        if isinstance(file, str) and not {"center_nm", "width_nm"} <= band.keys():
            curve = band_from_file(file, name, t_opt=1.0, qe=1.0)
            bands[name] = {"center_nm": round(curve.center_nm, 6), "width_nm": round(curve.width_nm, 6), **band}
    return {**own, "bands": bands} if bands else dict(own)


def _within(tree: Any, key: str) -> bool:
    """Return whether a tree holds a value for a dotted key."""
    for part in key.split("."):
        if not isinstance(tree, Mapping):
            return True
        if part not in tree:
            return False
        tree = tree[part]
    return True


def paths_beside(tree: Any, folder: Path, key: str = "") -> Any:
    """Return the names of maps and curves that exist beside the instrument's file, made whole.

    Parameters
    ----------
    tree : object
        Plain data of a configuration.
    folder : Path
    key : str, optional
        Name that a refusal gives.
    """
    if isinstance(tree, dict):
        inherits = key in _FILE_KEYS
        return {name: paths_beside(item, folder, key if inherits else name) for name, item in tree.items()}
    if key in _FILE_KEYS and isinstance(tree, str) and (is_file(folder / tree) or is_package(str(folder / tree))):
        return str(folder / tree)
    return tree


def _shipped_bands() -> dict[str, Any]:
    """Return the catalogue's bands as a sourced tree: the numbers live there and nowhere else."""
    provenance = band_provenance()
    tree: dict[str, Any] = {}
    for name, band in load_bands().items():
        entry: dict[str, Any] = {"camera": band.camera}
        for key in ("center_nm", "width_nm", "t_opt", "qe"):
            entry[key] = {"value": getattr(band, key)}
            standing = provenance.get(f"{name}.{key}")
            if standing is not None:
                entry[key] |= {origin: getattr(standing, origin) for origin in _ORIGIN}
        tree[name] = entry
    return tree


def _plain_over_sourced(base: Any, own: Any) -> Any:
    """Mark a user's plain number over a sourced default as replaced, so that no stale source clings to it."""
    if isinstance(base, Mapping) and "value" in base and not isinstance(own, Mapping):
        unit = base.get("unit", "")
        return {"value": own, "unit": unit, "source": "user", "confidence": "A", "range": None, "note": ""}
    if isinstance(base, Mapping) and isinstance(own, Mapping):
        return {key: _plain_over_sourced(base.get(key), item) for key, item in own.items()}
    return own
