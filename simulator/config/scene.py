"""A scene as configuration: the central star, its planets, other stars, discs and images, and where they stand.

The light of an object is a named model, a file, or a table of numbers; right ascension and declination are read as
people write them. Tables of stars (pandas, astropy or the star catalogue) become one scene a row.
"""

import math
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Protocol, TypeAlias, TypeGuard, cast

import numpy as np
from pydantic import BeforeValidator, Field, StrictBool, model_validator

from catalogs import position_angle, separation_arcsec, stellar_parameters, tangent_offset
from cpic_core import InputError, by_line, is_file, load_mapping
from simulator.config.base import (
    FrozenModel,
    Real,
    SpelledModel,
    canonical_keys,
    inside,
    nearest,
    other_names,
    preset_or_file,
    required,
    to_unit,
    validate,
)

STAR_MODELS = ("grid", "blackbody", "pickles")
"""Spectra of stars by name; anything else is a path or a table."""
PLANET_MODELS = ("reflected", "blackbody")
"""Light of planets by name; anything else is a path or a table."""

_TABLE_HINTS = {
    "wavelength": "wavelength_nm",
    "flux": "photlam (ph/s/cm2/A) or flam (erg/s/cm2/A)",
    "wavelength_angstrom": "wavelength_nm",
    "wavelength_um": "wavelength_nm",
}


class SpectrumTable(SpelledModel):
    """A user's spectrum at the telescope, linear between its samples.

    Attributes
    ----------
    wavelength_nm : tuple of float
        Wavelengths in vacuum, increasing.
    photlam : tuple of float, optional
        Photons, ph/s/cm2/A; this or ``flam``.
    flam : tuple of float, optional
        Energy, erg/s/cm2/A.
    """

    HINTS = _TABLE_HINTS
    wavelength_nm: tuple[Real, ...]
    photlam: tuple[Real, ...] | None = None
    flam: tuple[Real, ...] | None = None

    def _check_values(self) -> None:
        if (self.photlam is None) == (self.flam is None):
            allowed = "photlam (ph/s/cm2/A) or flam (erg/s/cm2/A), one of the two"
            raise InputError("photlam", "missing" if self.flam is None else "given with flam", allowed=allowed)
        name = "photlam" if self.photlam is not None else "flam"
        values = self.photlam or self.flam or ()
        check_columns("wavelength_nm", self.wavelength_nm, name, values)
        if not any(values):
            raise InputError(name, "all zero", allowed="some light")


def check_columns(x_name: str, x: Sequence[float], y_name: str, y: Sequence[float]) -> None:
    """Refuse columns of unequal or no length, wavelengths that do not increase from above 0, negative values.

    Parameters
    ----------
    x_name : str
        Name of the wavelengths.
    x : sequence of float
        Wavelengths, nm.
    y_name : str
        Name of the values.
    y : sequence of float
        Values at the wavelengths.

    Raises
    ------
    InputError
        Naming the first row at fault.
    """
    if len(x) != len(y):
        raise InputError(y_name, f"{len(y)} values", allowed=f"as many as {x_name}, {len(x)}")
    if len(x) < 2:
        raise InputError(x_name, f"{len(x)} values", allowed="at least 2")
    wavelength, value = np.asarray(x), np.asarray(y)
    if wavelength[0] <= 0.0:
        raise InputError(f"{x_name}.0", x[0], unit="nm", allowed="above 0")
    falling = np.flatnonzero(np.diff(wavelength) <= 0.0)
    if falling.size:
        row = int(falling[0]) + 1
        raise InputError(f"{x_name}.{row}", x[row], unit="nm", allowed=f"increasing values, here above {x[row - 1]:g}")
    negative = np.flatnonzero(value < 0.0)
    if negative.size:
        row = int(negative[0])
        raise InputError(f"{y_name}.{row}", y[row], allowed="at least 0")


def spectrum_value(value: Any, models: tuple[str, ...]) -> str | SpectrumTable:
    """Read a spectrum as people give it.

    Parameters
    ----------
    value : str, Path, mapping or spectrum object
        One of `models`; the path of a file or folder; ``{file: ...}``; ``{wavelength_nm: [...], photlam: [...]}``; an
        object with ``wavelength_nm`` and ``photlam``; a synphot source.
    models : tuple of str
        Names that mean a model.

    Raises
    ------
    InputError
        Naming what is wrong with it.
    """
    if isinstance(value, SpectrumTable):
        return value
    if isinstance(value, Mapping) and len(value) == 1 and next(iter(value)) in ("file", "model"):
        value = next(iter(value.values()))
    if isinstance(value, Mapping):
        return validate(SpectrumTable, value)
    if isinstance(value, str | Path):
        if value in models or (str(value) and os.path.exists(value)):
            return str(value)
        allowed = f"{', '.join(models)}, or an existing file"
        raise InputError("spectrum", str(value), allowed=allowed, hint=nearest(value, models))
    columns = _columns_of(value)
    if columns is None:
        raise InputError("spectrum", value, allowed=f"{', '.join(models)}, a file, or a table of numbers")
    return validate(SpectrumTable, dict(zip(("wavelength_nm", "photlam"), columns, strict=True)))


def _columns_of(value: Any) -> tuple[list[float], list[float]] | None:
    """Return the wavelengths (nm) and PHOTLAM of a spectrum object of this project or of synphot."""
    if hasattr(value, "wavelength_nm") and hasattr(value, "photlam"):
        return np.asarray(value.wavelength_nm, float).tolist(), np.asarray(value.photlam, float).tolist()
    points = getattr(value, "waveset", None)
    if callable(value) and points is not None:
        return (np.asarray(points.value) / 10.0).tolist(), np.asarray(value(points).value).tolist()
    return None


StarLight: TypeAlias = Annotated[str | SpectrumTable, BeforeValidator(lambda value: spectrum_value(value, STAR_MODELS))]
"""Field type: the spectrum of a star."""
PlanetLight: TypeAlias = Annotated[
    str | SpectrumTable, BeforeValidator(lambda value: spectrum_value(value, PLANET_MODELS))
]
"""Field type: the light of a planet."""


LOG10_FSED_MAX = math.log10(6.0)
"""Largest sedimentation efficiency with models behind it; above, the value is clamped and flagged."""

_LINEAR = {"mh": "log10_mh", "fsed": "log10_fsed"}


class MeasuredAlbedo(FrozenModel):
    """Measured giant planet of the solar system."""

    model: Literal["jupiter", "saturn", "uranus", "neptune"]

    @property
    def label(self) -> str:
        """For tables and legends."""
        return self.model


class _Atmosphere(FrozenModel):
    """A giant planet's atmosphere by metallicity, clouds and insolation.

    A mapping may give ``mh`` or ``fsed``, not logarithms, instead; ``fsed: 0`` means cloud-free. The defaults are
    Jupiter-like: carbon about three times the Sun's (Wong et al. 2004, Icarus 171, 153), f_sed 3 of the ammonia clouds
    (Ackerman & Marley 2001, ApJ 556, 872).

    Attributes
    ----------
    log10_mh : float
        Decimal logarithm of the metallicity over the Sun's.
    log10_fsed : float, optional
        Decimal logarithm of the sedimentation efficiency of the clouds; null means cloud-free.
    insolation_au : float, optional
        Distance from the Sun of equal insolation; by default the true distance over the square root of the star's
        luminosity.
    phase_function : {"lambert", "grid"}
        Lambert's law, or that of the models.
    """

    log10_mh: Annotated[Real, Field(ge=0, le=2)] = 0.5
    log10_fsed: Annotated[Real, Field(ge=-2, le=2)] | None = 0.5
    insolation_au: Annotated[Real, Field(gt=0, le=1e6)] | None = None
    phase_function: Literal["lambert", "grid"] = "lambert"

    @model_validator(mode="before")
    @classmethod
    def _linear_aliases(cls, tree: Any) -> Any:
        if not isinstance(tree, Mapping):
            return tree
        result = dict(tree)
        for linear, name in _LINEAR.items():
            if linear not in result:
                continue
            if name in result:
                raise InputError(linear, f"given with {name}", allowed="one of the two")
            value = result.pop(linear)
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or value < 0:
                raise InputError(linear, value, allowed="a finite number above 0")
            if value == 0 and linear == "mh":
                raise InputError(linear, value, allowed="a number above 0")
            result[name] = math.log10(value) if value else None
        return result

    @property
    def clamped_log10_fsed(self) -> float | None:
        """What is used: at most log10 6; None for a cloud-free atmosphere."""
        return None if self.log10_fsed is None else min(self.log10_fsed, LOG10_FSED_MAX)

    @property
    def label(self) -> str:
        """For tables and legends: what was used, in linear units too."""
        distance = "star's insolation" if self.insolation_au is None else f"{self.insolation_au:g} au"
        if self.log10_fsed is None:
            clouds = "cloud-free"
        else:
            fsed = 10.0**self.log10_fsed
            clouds = f"f_sed {fsed:.3g}" + (" taken as 6" if self.log10_fsed > LOG10_FSED_MAX else "")
        phase = "" if self.phase_function == "lambert" else ", grid phase"
        return f"{self._kind()} ({10.0**self.log10_mh:.3g} x solar, {clouds}, {distance}{phase})"

    def _kind(self) -> str:
        return "parametric"


class ParametricAlbedo(_Atmosphere):
    """Rayleigh scattering over a cloud deck with methane absorption; see `simulator.target.albedo`."""

    model: Literal["parametric"] = "parametric"


class GridAlbedo(_Atmosphere):
    """A user's copy of a grid of models.

    Attributes
    ----------
    file : str
        Path of the grid, in the SQLite or npz layout of Batalha et al. 2018.
    """

    model: Literal["grid"] = "grid"
    file: str

    def _kind(self) -> str:
        return f"grid {Path(self.file).name}"


class ConstantAlbedo(FrozenModel):
    """The same geometric albedo at every wavelength.

    Attributes
    ----------
    value : float
        The albedo.
    """

    model: Literal["constant"] = "constant"
    value: Annotated[Real, Field(ge=0, le=1.5)]

    @property
    def label(self) -> str:
        """For tables and legends."""
        return f"constant {self.value:g}"


class TableAlbedo(FrozenModel):
    """A user's spectrum: a file, or wavelengths and values.

    Attributes
    ----------
    file : str, optional
        Path of a file with wavelength and geometric albedo.
    wavelength_nm : tuple of float, optional
        Wavelengths, increasing.
    albedo : tuple of float, optional
        Geometric albedo at these wavelengths.
    """

    model: Literal["table"] = "table"
    file: str | None = None
    wavelength_nm: tuple[Real, ...] | None = None
    albedo: tuple[Real, ...] | None = None

    def _check_values(self) -> None:
        arrays = self.wavelength_nm is not None and self.albedo is not None
        if (self.file is not None) == arrays or (self.wavelength_nm is None) != (self.albedo is None):
            raise InputError("file", self.file, allowed="either file, or wavelength_nm and albedo")
        if self.wavelength_nm is not None and self.albedo is not None:
            check_columns("wavelength_nm", self.wavelength_nm, "albedo", self.albedo)

    @property
    def label(self) -> str:
        """For tables and legends."""
        return f"table {Path(self.file).name}" if self.file is not None else "table"


AlbedoSpec: TypeAlias = MeasuredAlbedo | ParametricAlbedo | GridAlbedo | ConstantAlbedo | TableAlbedo
_BY_MODEL: dict[str, type[FrozenModel]] = dict.fromkeys(("jupiter", "saturn", "uranus", "neptune"), MeasuredAlbedo)
_BY_MODEL |= {"parametric": ParametricAlbedo, "grid": GridAlbedo, "constant": ConstantAlbedo, "table": TableAlbedo}


ALBEDO_MODELS = tuple(_BY_MODEL)
"""Albedos by name."""
_WORDS = ("jupiter", "saturn", "uranus", "neptune", "parametric")
_ALBEDO_KEYS_ = tuple(dict.fromkeys((*(key for model in _BY_MODEL.values() for key in model.model_fields), *_LINEAR)))
_ALBEDO_ALIASES = {"coe_metal": "log10_mh", "coe_cloud": "log10_fsed"}
_ALLOWED = "a planet's name, a number, a file or a mapping"


def albedo_spec(value: Any) -> AlbedoSpec:
    """Read an albedo as people write it.

    Parameters
    ----------
    value : AlbedoSpec, str, Path, float, mapping or Albedo
        ``"jupiter"`` and the other giants; a number for a constant; the path of a file with wavelengths and albedos;
        a mapping with ``model`` (which may be left out where the other keys decide): ``{log10_mh: 1, log10_fsed: 1}``,
        ``{file: spectrum.txt}``, and both together for a grid in a file; an object with ``wavelength_nm`` and
        ``albedo``. Numbers may carry units (`astropy.units`).

    Raises
    ------
    InputError
        Naming the key, its value and what is allowed.
    """
    if isinstance(value, AlbedoSpec):
        return value
    if isinstance(value, bool) or value is None:
        raise InputError("albedo", value, allowed=_ALLOWED)
    if isinstance(value, int | float):
        try:
            return validate(ConstantAlbedo, {"value": value})
        except InputError as error:
            raise InputError("albedo", value, allowed=error.allowed) from None
    if isinstance(value, Path) or (isinstance(value, str) and names_file(value)):
        return validate(TableAlbedo, {"file": str(value)})
    if hasattr(value, "wavelength_nm") and hasattr(value, "albedo"):
        value = {"wavelength_nm": value.wavelength_nm, "albedo": value.albedo}
    given = {"model": value} if isinstance(value, str) else value
    if not isinstance(given, Mapping):
        raise InputError("albedo", value, allowed=_ALLOWED)
    tree = canonical_keys(given, _ALBEDO_KEYS_, _ALBEDO_ALIASES)
    model = tree.get("model", _implied(tree))
    name = model.lower() if isinstance(model, str) else model
    names = tuple(_BY_MODEL) if isinstance(value, Mapping) else _WORDS
    if name not in names:
        raise InputError("albedo", model, allowed=f"{', '.join(names)}, a number or a file", hint=nearest(model, names))
    return cast("AlbedoSpec", validate(_BY_MODEL[name], tree | ({"model": name} if "model" in tree else {})))


def names_file(text: str) -> bool:
    """Return whether a word in the place of an albedo is a file's path: it has a slash or a point and is no number."""
    try:
        float(text)
    except ValueError:
        return "/" in text or "\\" in text or "." in text
    return False


def _implied(tree: Mapping[str, Any]) -> str:
    if "value" in tree:
        return "constant"
    if any(key in tree for key in (*_Atmosphere.model_fields, *_LINEAR)):
        return "grid" if "file" in tree else "parametric"
    return "table" if set(tree) & set(TableAlbedo.model_fields) else "parametric"


AlbedoValue: TypeAlias = Annotated[AlbedoSpec, BeforeValidator(albedo_spec)]
"""Field type of a model: reads whatever `albedo_spec` reads."""


_NUMBER = r"\d+(?:\.\d*)?"
_SEXAGESIMAL = re.compile(
    rf"(?P<sign>[-+]?)\s*(?P<whole>\d+)\s*(?P<unit>[hd:\s])\s*"
    rf"(?P<minutes>\d{{1,2}})(?:\s*[m:\s]\s*(?:(?P<seconds>{_NUMBER})\s*s?)?)?"
)
_DECIMAL = re.compile(rf"(?P<sign>[-+]?)\s*(?P<value>{_NUMBER})\s*(?P<unit>[hd])")
_SPELLINGS = str.maketrans("−–°ʰᵐˢ′'″\"", "--dhmsmmss")
_DEGREES_PER_HOUR = 15.0


def right_ascension_deg(value: Any) -> float:
    """Return a right ascension in degrees.

    Parameters
    ----------
    value : float or str
        Degrees, 0 to 360; or text: hours as ``14:39:36.49``, ``14 39 36.49``, ``14h39m36.49s``, ``14.66h``; degrees
        only where it says so, ``219.9d`` or ``219d54m7s``.

    Raises
    ------
    InputError
        If it cannot be read or is out of range.
    """
    return _angle("ra_deg", value, _DEGREES_PER_HOUR, (0.0, 360.0), "0 to 360 degrees, or text such as 14:39:36.5")


def declination_deg(value: Any) -> float:
    """Return a declination in degrees.

    Parameters
    ----------
    value : float or str
        Degrees, -90 to 90; or text: ``-60:50:02.3``, ``-60 50 02.3``, ``-60d50m02.3s``, ``-60.84d``.

    Raises
    ------
    InputError
        If it cannot be read or is out of range.
    """
    return _angle("dec_deg", value, 1.0, (-90.0, 90.0), "-90 to 90 degrees, or text such as -60:50:02.3")


def _angle(key: str, value: Any, degrees_per_part: float, limits: tuple[float, float], allowed: str) -> float:
    if isinstance(value, str):
        degrees = _read(value, degrees_per_part)
    else:
        degrees = value if isinstance(value, int | float) and not isinstance(value, bool) else None
    # Not a number compares false.
    if degrees is None or not limits[0] <= degrees <= limits[1]:
        raise InputError(key, value, unit="" if isinstance(value, str) else "deg", allowed=allowed)
    return float(degrees)


def _read(text: str, degrees_per_part: float) -> float | None:
    """Return the degrees of an angle whose colons separate parts of that many degrees, None if it cannot be read."""
    plain = text.strip().lower().translate(_SPELLINGS)
    found = _SEXAGESIMAL.fullmatch(plain)
    if found:
        minutes, seconds = float(found["minutes"]), float(found["seconds"] or 0.0)
        if minutes >= 60.0 or seconds >= 60.0:
            return None
        size = math.fsum((float(found["whole"]), minutes / 60.0, seconds / 3600.0))
    else:
        found = _DECIMAL.fullmatch(plain)
        if not found:
            return None
        size = float(found["value"])
    hours = found["unit"] == "h" or (found["unit"] != "d" and degrees_per_part == _DEGREES_PER_HOUR)
    if hours and degrees_per_part != _DEGREES_PER_HOUR:
        return None
    # The sign belongs to the whole angle: -00:30:00 is south.
    return (-1.0 if found["sign"] == "-" else 1.0) * size * (_DEGREES_PER_HOUR if hours else 1.0)


MAX_SEPARATION_ARCSEC = 120.0
"""Farthest source from the central star; the detector reaches 12 arcsec, the light of companions farther."""

RightAscension = Annotated[float | None, BeforeValidator(lambda x: None if x is None else right_ascension_deg(x))]
Declination = Annotated[float | None, BeforeValidator(lambda x: None if x is None else declination_deg(x))]
Magnitude = Annotated[Real, Field(ge=-30, le=40)]

_ALIASES = other_names(ra_deg="ra", dec_deg="dec", separation_arcsec="separation", spectrum="model", teff_k="teff")
_ALIASES |= other_names(pa_deg="position_angle position_angle_deg pangle pa", v_mag="magnitude magnitude_v")
_ALBEDO_KEYS = ("log10_mh", "log10_fsed", "mh", "fsed", "insolation_au", "phase_function")
_PLANET_HINTS = {
    "distance": "distance_au is the planet's true distance from its star; the star's own is cstar.distance_pc",
    "distance_pc": "the distance of the system is cstar.distance_pc",
    "spectral_type": "a planet has a teff_k, for model: blackbody",
    "metallicity": "log10_mh for a parametric albedo",
}


class Body(SpelledModel):
    """The fields that every source has: a name, a place, and perhaps a brightness and a spectrum of its own.

    The place is either ``ra_deg`` and ``dec_deg`` (same epoch as the central star's) or ``separation_arcsec`` and
    ``pa_deg`` from the central star.

    Attributes
    ----------
    name : str
        Name in tables, headers and the truth.
    ra_deg, dec_deg : float or str, optional
        Right ascension and declination, ICRS: degrees, or text such as ``14:39:36.5``.
    separation_arcsec : float, optional
        Angle from the central star.
    pa_deg : float, optional
        Position angle from the central star, east of north.
    """

    name: str = ""
    ra_deg: RightAscension = None
    dec_deg: Declination = None
    separation_arcsec: Annotated[Real, Field(ge=0, le=MAX_SEPARATION_ARCSEC)] | None = None
    pa_deg: Annotated[Real, Field(ge=-360, le=360)] | None = None

    def _check_values(self) -> None:
        for pair in (("ra_deg", "dec_deg"), ("separation_arcsec", "pa_deg")):
            for one, other in (pair, pair[::-1]):
                if getattr(self, one) is None and getattr(self, other) is not None:
                    raise required(one, f"a value where {other} is given")
        if self.ra_deg is not None and self.separation_arcsec is not None:
            allowed = "either ra_deg and dec_deg, or separation_arcsec and pa_deg"
            raise InputError("ra_deg", "given with separation_arcsec", allowed=allowed)


class SceneStar(Body):
    """A star: brightness, atmosphere, and a place when it is not the central one.

    Attributes
    ----------
    v_mag : float
        Johnson V (Vega), to which the spectrum is scaled.
    spectral_type : str, optional
        MK type, which gives temperature and gravity where they are not given; a file or table needs neither.
    teff_k : float, optional
        Effective temperature.
    log_g : float, optional
        Decimal logarithm of the surface gravity in cm/s2.
    metallicity : float, optional
        Decimal logarithm of the metallicity over the Sun's.
    spectrum : str or SpectrumTable
        ``grid`` (shipped PHOENIX and CK04 fluxes), ``blackbody``, ``pickles``, the path of a file or of a CK04 or
        PHOENIX tree, or a table.
    distance_pc : float, optional
        Distance of the central star, which turns angles into distances.
    luminosity_lsun : float, optional
        Luminosity of the central star, which turns distances into insolation.
    companion : bool
        Whether the star stays away where a scene leaves companions out; no for a star of the field or a calibrator.
    """

    ALIASES = _ALIASES | other_names(spectral_type="sp_type sptype", log_g="logg", distance_pc="distance")
    ALIASES |= other_names(luminosity_lsun="luminosity")
    v_mag: Magnitude
    spectral_type: str | None = None
    teff_k: Annotated[Real, Field(ge=100, le=1e6)] | None = None
    log_g: Annotated[Real, Field(ge=-1, le=9)] | None = None
    metallicity: Annotated[Real, Field(ge=-5, le=2)] | None = None
    spectrum: StarLight = "grid"
    distance_pc: Annotated[Real, Field(gt=0, le=1e6)] | None = None
    luminosity_lsun: Annotated[Real, Field(gt=0, le=1e8)] | None = None
    companion: StrictBool = True

    def _check_values(self) -> None:
        super()._check_values()
        if self.spectral_type is not None:
            stellar_parameters(self.spectral_type)
        elif self.spectrum == "pickles":
            raise required("spectral_type", "an MK type such as K1V for spectrum: pickles")
        elif self.teff_k is None and self._needs_parameters():
            raise required("spectral_type", "an MK type such as K1V, or teff_k in K")

    def _needs_parameters(self) -> bool:
        """Return whether the spectrum is made from parameters: by a model or a tree of them, not by a file or table."""
        if isinstance(self.spectrum, SpectrumTable):
            return False
        return self.spectrum in STAR_MODELS or not is_file(self.spectrum)


class Planet(Body):
    """A planet: reflected light of the central star, or a light of its own.

    Reflected light needs ``radius_rjup`` (R_J = 71 492 km), ``phase_deg`` and an ``albedo`` (default Jupiter's). The
    true distance from the star is ``distance_au``; without it, that of the projected separation at the star's
    ``distance_pc``: ``r = rho / sin(phase)``.

    ``spectrum: blackbody`` is thermal light of temperature ``teff_k``, as bright as ``radius_rjup`` at the star's
    distance makes it or of the given ``v_mag``. A file or table is taken as it is, at the telescope, or scaled to
    ``v_mag``.

    Attributes
    ----------
    radius_rjup : float, optional
        Radius in Jupiter's equatorial radius, 71 492 km.
    distance_au : float, optional
        True distance from the star.
    phase_deg : float, optional
        Angle between star and observer as seen from the planet.
    albedo : optional
        A planet of the solar system, ``parametric``, a number, or a mapping with ``model`` or ``file``.
    spectrum : str or SpectrumTable
        ``reflected``, ``blackbody``, the path of a file, or a table.
    teff_k : float, optional
        Temperature of ``spectrum: blackbody``.
    v_mag : float, optional
        Johnson V of a planet with light of its own.
    """

    ALIASES = _ALIASES | other_names(radius_rjup="radius", phase_deg="phase phase_angle phase_angle_deg")
    ALIASES |= other_names(log10_mh="coe_metal", log10_fsed="coe_cloud")
    HINTS = _PLANET_HINTS
    MORE_KEYS = _ALBEDO_KEYS
    radius_rjup: Annotated[Real, Field(gt=0, le=10)] | None = None
    distance_au: Annotated[Real, Field(gt=0, le=1e12)] | None = None
    phase_deg: Annotated[Real, Field(ge=0, le=180)] | None = None
    albedo: AlbedoValue | None = None
    spectrum: PlanetLight = "reflected"
    teff_k: Annotated[Real, Field(ge=100, le=1e6)] | None = None
    v_mag: Magnitude | None = None

    @property
    def reflects(self) -> bool:
        """Whether the light is the star's, reflected."""
        return self.spectrum == "reflected"

    @classmethod
    def _read(cls, tree: dict[str, Any]) -> dict[str, Any]:
        return _with_albedo(tree)

    def _check_values(self) -> None:
        super()._check_values()
        if self.reflects:
            _refuse(self, ("teff_k", "v_mag"), "spectrum: reflected", "a key of a planet with light of its own")
            for name, why in (("radius_rjup", "radius in R_Jup"), ("phase_deg", "0 to 180 deg")):
                if getattr(self, name) is None:
                    raise required(name, f"a value: {why}")
            file = getattr(self.albedo, "file", None)
            if file is not None and not is_file(file):
                raise InputError("albedo.file", file, allowed="an existing file")
            return
        _refuse(self, ("albedo",), "light of its own", "a key of a planet in reflected light")
        if self.spectrum != "blackbody":
            _refuse(self, ("teff_k",), "a given spectrum", "a key of spectrum: blackbody")
        elif self.teff_k is None:
            raise required("teff_k", "a temperature in K for spectrum: blackbody")
        elif self.radius_rjup is None and self.v_mag is None:
            raise required("radius_rjup", "a radius in R_Jup, or v_mag, for spectrum: blackbody")


def _refuse(planet: Planet, names: tuple[str, ...], light: str, allowed: str) -> None:
    for name in names:
        if getattr(planet, name) is not None:
            raise InputError(name, f"given with {light}", allowed=allowed)


def _with_albedo(tree: dict[str, Any]) -> dict[str, Any]:
    """Gather the parameters of the albedo model, which the paper writes beside the others, under ``albedo``."""
    given = {key: tree.pop(key) for key in _ALBEDO_KEYS if key in tree}
    albedo = tree.get("albedo")
    if given:
        if albedo in (None, "parametric"):
            tree["albedo"] = {"model": "parametric", **given}
        elif isinstance(albedo, Mapping) and not set(albedo) & set(given):
            tree["albedo"] = {**albedo, **given}
        else:
            raise InputError("albedo", albedo, allowed="parametric, where its parameters stand beside it")
    elif albedo is None and tree.get("spectrum", "reflected") == "reflected":
        tree["albedo"] = "jupiter"
    return tree


MAX_RADIUS_ARCSEC = 20.0
"""Largest disc; the detector reaches 12 arcsec into its corners."""

Radius = Annotated[Real, Field(ge=0, le=MAX_RADIUS_ARCSEC)]
Angle = Annotated[Real, Field(ge=-360, le=360)]
Inclination = Annotated[Real, Field(ge=0, le=90)]

_SOURCE_ALIASES = other_names(inner_arcsec="inner", outer_arcsec="outer", radius_arcsec="radius", fwhm_arcsec="fwhm")
_SOURCE_ALIASES |= other_names(
    inclination_deg="inclination incl_deg", pa_deg="position_angle position_angle_deg pangle pa"
)
_SOURCE_ALIASES |= other_names(v_mag="magnitude magnitude_v", pixel_scale_arcsec="pixel_scale pixscale", file="image")
_SOURCE_ALIASES |= other_names(center_separation_arcsec="centre_separation_arcsec center_separation centre_separation")
_SOURCE_ALIASES |= other_names(center_pa_deg="centre_pa_deg center_pa centre_pa", center_pixel="centre_pixel")
_MOVED = "center_separation_arcsec, with center_pa_deg, moves the centre away from the star"
_SOURCE_HINTS = {
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
_SOURCE_KEYS = tuple(dict.fromkeys(key for model in _BY_KIND.values() for key in model.model_fields))


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
    tree = canonical_keys(value, _SOURCE_KEYS, _SOURCE_ALIASES, hints=_SOURCE_HINTS)
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


DISTANCE_TOLERANCE = 0.01
"""Largest difference between a given projected and a given true distance, relative to the true one: people round."""


class Place(NamedTuple):
    """Offset from the central star on the sky."""

    separation_arcsec: float
    pa_deg: float


def place(host: SceneStar, body: Body) -> Place:
    """Return the offset of a body from the central star, exact on the sphere.

    Parameters
    ----------
    host : SceneStar
        The central star; its coordinates are needed where the body is given by coordinates, at the same epoch.
    body : Body
        A star or planet.

    Raises
    ------
    InputError
        If no place is given, the coordinates of the host are missing, or the body is farther than 120 arcsec.
    """
    if body.separation_arcsec is not None and body.pa_deg is not None:
        return Place(body.separation_arcsec, body.pa_deg)
    if body.ra_deg is None or body.dec_deg is None:
        raise required("separation_arcsec", "separation_arcsec and pa_deg, or ra_deg and dec_deg")
    if host.ra_deg is None or host.dec_deg is None:
        raise InputError("ra_deg", body.ra_deg, unit="deg", allowed="coordinates where cstar has them too")
    sky = (body.ra_deg, body.dec_deg, host.ra_deg, host.dec_deg)
    separation = float(separation_arcsec(*sky))
    if separation > MAX_SEPARATION_ARCSEC:
        allowed = f"at most {MAX_SEPARATION_ARCSEC:g} arcsec, at the same epoch"
        raise InputError("ra_deg, dec_deg", f"{separation:.6g} arcsec from cstar", allowed=allowed)
    return Place(separation, float(position_angle(*tangent_offset(*sky))))


def true_distance_au(planet: Planet, separation: float, distance_pc: float | None) -> float | None:
    """Return the true distance of a planet from its star, au.

    The given one, or ``r = rho / sin(phase)`` with the projected distance ``rho = separation x distance_pc``
    (1 arcsec at 1 pc is 1 au). A given distance must agree with the projected one where both are known.

    Parameters
    ----------
    planet : Planet
    separation : float
        Projected separation, arcsec.
    distance_pc : float or None
        Distance of the star.

    Returns
    -------
    float or None
        None for a planet with light of its own whose distance is not known: nothing depends on it.

    Raises
    ------
    InputError
        If the distance does not follow from what is given, or contradicts it.
    """
    rho = None if distance_pc is None else separation * distance_pc
    phase, given = planet.phase_deg, planet.distance_au
    # Exactly 0 at 180 degrees too.
    sine = None if phase is None else math.sin(math.radians(min(phase, 180.0 - phase)))
    if given is not None:
        if rho is not None:
            _agree(given, rho, phase, sine)
        return given
    if rho and sine:
        return rho / sine
    if not planet.reflects:
        return None
    if rho is None:
        raise required("distance_au", "the true distance from the star, or cstar.distance_pc")
    if rho == 0.0:
        raise required("distance_au", "the true distance where the separation is 0")
    raise required("distance_au", f"the true distance where phase_deg is {phase:g}")


def _agree(given: float, rho: float, phase: float | None, sine: float | None) -> None:
    slack = DISTANCE_TOLERANCE * given
    if rho > given + slack:
        allowed = f"at least the projected distance {rho:.6g} au = separation x cstar.distance_pc"
        raise InputError("distance_au", given, unit="au", allowed=allowed)
    if sine is not None and abs(given * sine - rho) > slack:
        allowed = f"{rho / sine:.6g} au, or none" if sine else "none"
        hint = f"distance_au x sin(phase_deg = {phase:g}) is {given * sine:.6g} au"
        hint += f", separation x cstar.distance_pc is {rho:.6g} au"
        raise InputError("distance_au", given, unit="au", allowed=allowed, hint=hint)


_HINTS = {"host": "did you mean cstar?"}
_FILE_KEYS = ("file", "spectrum", "model", "albedo")
_MODELS = (*STAR_MODELS, *PLANET_MODELS, *ALBEDO_MODELS)


class Scene(SpelledModel):
    """A scene: the bodies and the sky that the telescope points at.

    Objects without a name get one: the scene's for the central star, ``planet 1``, ``star 1``, ``extended 1`` and so on
    for the others. ``companions`` says whether the ``stars`` are put on the image (``on``) or left out (``off``); those
    with ``companion: false`` always are. ``extended`` is scattered light that is no point: discs, rings, images.
    """

    ALIASES = other_names(planets="planet", stars="star", extended="disc disk discs disks exozodi extended_sources")
    HINTS = _HINTS
    name: Annotated[str, Field(min_length=1)]
    cstar: SceneStar
    planets: tuple[Planet, ...] = ()
    stars: tuple[SceneStar, ...] = ()
    companions: Literal["on", "off"] = "on"
    extended: tuple[ExtendedValue, ...] = ()

    @classmethod
    def _read(cls, tree: dict[str, Any]) -> dict[str, Any]:
        result = dict(tree)
        result["cstar"] = _named(result["cstar"], result.get("name")) if "cstar" in result else None
        if result["cstar"] is None:
            raise InputError("cstar", "missing", allowed="a mapping: the central star")
        for key, word in (("planets", "planet"), ("stars", "star"), ("extended", "extended")):
            given = result.get(key)
            nothing = given is None or (isinstance(given, Mapping) and not given)
            listed = () if nothing else given if isinstance(given, list | tuple) else (given,)
            result[key] = tuple(_named(body, f"{word} {n}") for n, body in enumerate(listed, start=1))
        for number, source in enumerate(result["extended"]):
            if not isinstance(source, Mapping | DiscSource | RingSource | ImageSource):
                raise InputError(f"extended.{number}", source, allowed="a mapping: a disc, ring or image")
        return result

    def _check_values(self) -> None:
        for key in ("separation_arcsec", "pa_deg"):
            if getattr(self.cstar, key):
                raise InputError(f"cstar.{key}", getattr(self.cstar, key), allowed="no such key: it is the origin")
        if not self.cstar.companion:
            raise InputError("cstar.companion", False, allowed="no such key: the others are its companions")
        seen = {self.cstar.name: "cstar"}
        bodies = [(f"planets.{n}", body) for n, body in enumerate(self.planets)]
        for path, body in [*bodies, *((f"stars.{n}", body) for n, body in enumerate(self.stars))]:
            if body.name in seen:
                raise InputError(f"{path}.name", body.name, allowed=f"a name of its own, not that of {seen[body.name]}")
            seen[body.name] = path
            with inside(path):
                where = place(self.cstar, body)
                if isinstance(body, Planet):
                    true_distance_au(body, where.separation_arcsec, self.cstar.distance_pc)
        for number, source in enumerate(self.extended):
            if source.name in seen:
                allowed = f"a name of its own, not that of {seen[source.name]}"
                raise InputError(f"extended.{number}.name", source.name, allowed=allowed)
            seen[source.name] = f"extended.{number}"
            if source.contrast_to(self.cstar.v_mag) > 1:
                allowed = f"at least that of cstar, {self.cstar.v_mag:g}"
                raise InputError(f"extended.{number}.v_mag", source.v_mag, unit="mag", allowed=allowed)

    def is_lit(self, star: SceneStar) -> bool:
        """Return whether one of its stars is put on the image."""
        return self.companions == "on" or not star.companion

    def without_planets(self) -> "Scene":
        """Return the same scene, star only: what the reference library sees."""
        return self.model_copy(update={"planets": ()})


SCENE_KEYS = (*Scene.model_fields, *Scene.ALIASES, *Scene.HINTS)
"""Keys of a file of a scene, as people write them."""


@by_line
def load_scene(source: Scene | str | Path | Mapping[str, Any]) -> Scene:
    """Load a scene from a YAML path, a preset name or a mapping.

    Parameters
    ----------
    source : Scene, str, Path or mapping
        Keys ``name``, ``cstar``, ``stars`` and ``planet`` or ``planets`` (one or a list), as in Zhu et al. 2025, and
        ``extended`` (or ``disc``, ``exozodi``); see `Scene`, `SceneStar`, `Planet` and `DiscSource` for
        those of each object. Files named in a YAML file are looked for beside it first.

    Returns
    -------
    Scene

    Raises
    ------
    InputError
        Naming key, value, unit and allowed range of the first fault.

    Examples
    --------
    >>> from simulator import load_scene
    >>> scene = load_scene({
    ...     "name": "alpha Cen B",
    ...     "cstar": {"magnitude": 1.35, "spectral_type": "K1V", "distance": 1.35},
    ...     "planet": {"radius": 1, "phase_angle": 90, "separation": 0.65, "position_angle": 315, "albedo": "jupiter"},
    ... })
    >>> scene.planets[0].separation_arcsec
    0.65
    """
    if isinstance(source, Scene):
        return source
    if isinstance(source, Mapping):
        tree: Any = dict(source)
    elif isinstance(source, str | Path):
        path = preset_or_file("scene", source)
        tree = paths_beside(load_mapping(path, "scene", SCENE_KEYS), path.parent)
    else:
        raise InputError("scene", source, allowed="a mapping, a YAML file or a preset")
    kind = tree.pop("kind", "scene") if isinstance(tree, dict) else "scene"
    if not isinstance(kind, str) or kind != "scene":
        raise InputError("scene.kind", kind, allowed="scene")
    return validate(Scene, tree, where="scene")


def _named(body: Any, name: Any) -> Any:
    """Give a body without a name the given one."""
    if isinstance(body, Mapping):
        return {**body, "name": name} if body.get("name") in (None, "") else body
    if isinstance(body, SceneStar | Planet | DiscSource | RingSource | ImageSource) and not body.name:
        return body.model_copy(update={"name": name})
    return body


def paths_beside(tree: Any, folder: Path) -> Any:
    """Return the paths of spectra and albedos that exist beside the scene's file, made whole.

    Parameters
    ----------
    tree : object
        Plain data of a configuration.
    folder : Path
    """
    if isinstance(tree, list):
        return [paths_beside(item, folder) for item in tree]
    if not isinstance(tree, dict):
        return tree
    return {
        key: str(folder / item)
        if key in _FILE_KEYS and isinstance(item, str) and item not in _MODELS and is_file(folder / item)
        else paths_beside(item, folder)
        for key, item in tree.items()
    }


COMPANION_LIMIT_ARCSEC = 60.0
"""Farthest companion of a catalogue star that is put into its scene."""

ASSUMED_PA_DEG = 30.0
"""Position angle of a companion where none is known (A): between an arm of the mask and a diagonal."""

_STAR: dict[str, tuple[str, ...]] = {key: (key,) for key in ("metallicity", "luminosity_lsun")}
_STAR |= {"v_mag": ("v_mag", "magnitude"), "teff_k": ("teff_k", "teff"), "log_g": ("log_g", "logg")}
_STAR |= {"ra_deg": ("ra_deg", "ra"), "dec_deg": ("dec_deg", "dec"), "distance_pc": ("distance_pc", "distance")}
_STAR |= {"spectral_type": ("spectral_type", "sp_type")}
_COMPANION: dict[str, tuple[str, ...]] = {key: (f"companion_{key}",) for key in ("pa_deg", "v_mag", "teff_k")}
_COMPANION |= {"separation_arcsec": ("companion_separation_arcsec", "companion_sep_arcsec")}
_COMPANION |= {"delta_v_mag": ("companion_delta_v_mag",)}


class StarColumns(Protocol):
    """A table with named columns."""

    @property
    def columns(self) -> Any:
        """Names of the columns, or a mapping of them."""


def is_table(thing: Any) -> TypeGuard[StarColumns]:
    """Return whether something has named columns as a table of pandas, astropy or `catalogs.stars` has."""
    return hasattr(thing, "columns") and hasattr(thing, "__len__") and not isinstance(thing, Mapping)


def scenes_from_table(table: StarColumns, *, planet: Planet | Mapping[str, Any] | None = None) -> tuple[Scene, ...]:
    """Return one scene for each star of a table.

    Parameters
    ----------
    table : pandas.DataFrame, astropy Table or StarTable
        Columns ``name`` and ``v_mag``, and ``teff_k`` or ``sp_type``, which serves where the temperature is missing. Of
        use are ``log_g``, ``metallicity``, ``ra_deg``, ``dec_deg``, ``distance_pc``, ``luminosity_lsun``, and
        ``companion_separation_arcsec``, ``companion_pa_deg``, ``companion_v_mag`` (or ``companion_delta_v_mag``),
        ``companion_teff_k``: companions within 60 arcsec join the scene, see `companion_of`. Other columns are passed
        over; a cell without a value (nan, masked) counts as not given.
    planet : Planet or mapping, optional
        The same planet for every star.

    Returns
    -------
    tuple of Scene
        In the order of the rows.

    Raises
    ------
    InputError
        For a missing column or the first bad row, by its number.
    """
    if not is_table(table):
        raise InputError("table", table, allowed="a table with named columns")
    names = tuple(str(name) for name in table.columns)
    star, companion = _found(table, names, _STAR), _found(table, names, _COMPANION)
    if "name" not in names:
        raise required("table.name", "a column of names")
    if "v_mag" not in star:
        raise required("table.v_mag", "a column of Johnson V magnitudes")
    scenes = []
    for row, name in enumerate(_cells(table, "name", "name")):
        body = {key: cells[row] for key, cells in star.items() if cells[row] is not None}
        if "teff_k" in body:
            body.pop("spectral_type", None)
        tree: dict[str, Any] = {"name": name, "cstar": body, "planets": () if planet is None else (planet,)}
        near = {key: cells[row] for key, cells in companion.items()}
        tree["stars"] = companion_of(body, **near)
        scenes.append(validate(Scene, tree, where=f"table.{row}"))
    return tuple(scenes)


def companion_of(
    star: Mapping[str, Any],
    *,
    separation_arcsec: float | None = None,
    pa_deg: float | None = None,
    v_mag: float | None = None,
    delta_v_mag: float | None = None,
    teff_k: float | None = None,
) -> tuple[dict[str, Any], ...]:
    """Return a star's known companion as another star of its scene; empty if it is too far or its light is unknown.

    Parameters
    ----------
    star : mapping
        Keys of `SceneStar`: what the companion shares where it has no temperature of its own.
    separation_arcsec, pa_deg : float, optional
        Place; an unknown position angle is taken as 30 degrees, which the name says.
    v_mag, delta_v_mag : float, optional
        Its magnitude, or how much fainter than the star it is.
    teff_k : float, optional
        Its temperature.
    """
    if v_mag is None and delta_v_mag is not None:
        v_mag = star["v_mag"] + delta_v_mag
    if separation_arcsec is None or v_mag is None or separation_arcsec > COMPANION_LIMIT_ARCSEC:
        return ()
    shared = {key: star[key] for key in ("teff_k", "log_g", "metallicity", "spectral_type") if key in star}
    if teff_k is not None:
        shared = {key: shared[key] for key in ("log_g", "metallicity") if key in shared} | {"teff_k": teff_k}
    name = "companion" if pa_deg is not None else "companion, position angle assumed"
    pa = ASSUMED_PA_DEG if pa_deg is None else pa_deg
    return ({"name": name, "v_mag": v_mag, "separation_arcsec": separation_arcsec, "pa_deg": pa} | shared,)


def _found(table: StarColumns, names: tuple[str, ...], wanted: Mapping[str, tuple[str, ...]]) -> dict[str, list[Any]]:
    """Return the cells of the columns that there are, by key."""
    chosen = {key: next((name for name in spellings if name in names), None) for key, spellings in wanted.items()}
    return {key: _cells(table, name, key) for key, name in chosen.items() if name is not None}


def _cells(table: Any, name: str, key: str) -> list[Any]:
    """Return the cells of a column in the unit of the key, None where there is no value."""
    column = table.column(name) if hasattr(table, "column") else table[name]
    if hasattr(column, "isna"):
        column = column.astype(object).where(~column.isna(), None)
    values = to_unit(key, column)
    cells = values.tolist() if hasattr(values, "tolist") else list(values)
    return [None if _absent(cell) else cell for cell in cells]


def _absent(cell: Any) -> bool:
    return cell is None or cell == "" or (isinstance(cell, float) and bool(np.isnan(cell)))
