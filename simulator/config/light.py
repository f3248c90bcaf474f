"""Light of an object as configuration: a spectrum or an albedo by a named model, a file, or a table of numbers."""

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, cast

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from cpic_core import InputError
from simulator.config.base import FrozenModel, SpelledModel, canonical_keys, nearest, validate

STAR_MODELS = ("grid", "blackbody", "pickles")
"""Spectra of stars by name; anything else is a path or a table."""
PLANET_MODELS = ("reflected", "blackbody")
"""Light of planets by name; anything else is a path or a table."""

Real: TypeAlias = Annotated[float, Field(strict=True)]
"""A number; neither text nor a truth value becomes one."""

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
_KEYS = tuple(dict.fromkeys((*(key for model in _BY_MODEL.values() for key in model.model_fields), *_LINEAR)))
_ALIASES = {"coe_metal": "log10_mh", "coe_cloud": "log10_fsed"}
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
    tree = canonical_keys(given, _KEYS, _ALIASES)
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
