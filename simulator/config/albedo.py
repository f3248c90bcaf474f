"""What reflects the star's light, as configuration: one of five kinds of geometric albedo."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, cast

from pydantic import BeforeValidator, Field, model_validator

from catalogs.errors import InputError
from simulator.config.base import FrozenModel, validate
from simulator.config.keys import canonical_keys, nearest
from simulator.config.light import Real, check_columns

__all__ = [
    "ALBEDO_MODELS",
    "LOG10_FSED_MAX",
    "AlbedoSpec",
    "AlbedoValue",
    "ConstantAlbedo",
    "GridAlbedo",
    "MeasuredAlbedo",
    "ParametricAlbedo",
    "TableAlbedo",
    "albedo_spec",
    "names_file",
]

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

    ``log10_mh`` is the metallicity over the Sun's and ``log10_fsed`` the sedimentation efficiency of the clouds, both
    as decimal logarithms; a mapping may give ``mh`` or ``fsed``, not logarithms, instead, and ``fsed: 0`` or
    ``log10_fsed: null`` means cloud-free. Without ``insolation_au`` it is the true distance over the square root of
    the star's luminosity. The defaults are Jupiter-like: carbon about three times the Sun's (Wong et al. 2004, Icarus
    171, 153), f_sed 3 of the ammonia clouds (Ackerman & Marley 2001, ApJ 556, 872).
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
    """Rayleigh scattering over a cloud deck with methane absorption; see `simulator.target.parametric`."""

    model: Literal["parametric"] = "parametric"


class GridAlbedo(_Atmosphere):
    """A user's copy of a grid of models: the SQLite or npz layout of Batalha et al. 2018, given by path."""

    model: Literal["grid"] = "grid"
    file: str

    def _kind(self) -> str:
        return f"grid {Path(self.file).name}"


class ConstantAlbedo(FrozenModel):
    """The same geometric albedo at every wavelength."""

    model: Literal["constant"] = "constant"
    value: Annotated[Real, Field(ge=0, le=1.5)]

    @property
    def label(self) -> str:
        """For tables and legends."""
        return f"constant {self.value:g}"


class TableAlbedo(FrozenModel):
    """A user's spectrum: a two-column file, or wavelengths and values."""

    model: Literal["table"] = "table"
    file: str | None = None
    wavelength_nm: tuple[Real, ...] | None = None
    albedo: tuple[Real, ...] | None = None

    @model_validator(mode="after")
    def _one_source(self) -> TableAlbedo:
        arrays = self.wavelength_nm is not None and self.albedo is not None
        if (self.file is not None) == arrays or (self.wavelength_nm is None) != (self.albedo is None):
            raise InputError("file", self.file, allowed="either file, or wavelength_nm and albedo")
        if self.wavelength_nm is not None and self.albedo is not None:
            check_columns("wavelength_nm", self.wavelength_nm, "albedo", self.albedo)
        return self

    @property
    def label(self) -> str:
        """For tables and legends."""
        return f"table {Path(self.file).name}" if self.file is not None else "table"


AlbedoSpec: TypeAlias = MeasuredAlbedo | ParametricAlbedo | GridAlbedo | ConstantAlbedo | TableAlbedo
_BY_MODEL: dict[str, type[FrozenModel]] = {
    **dict.fromkeys(("jupiter", "saturn", "uranus", "neptune"), MeasuredAlbedo),
    "parametric": ParametricAlbedo,
    "grid": GridAlbedo,
    "constant": ConstantAlbedo,
    "table": TableAlbedo,
}


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
    if isinstance(value, MeasuredAlbedo | ParametricAlbedo | GridAlbedo | ConstantAlbedo | TableAlbedo):
        return value
    if isinstance(value, bool) or value is None:
        raise InputError("albedo", value, allowed=_ALLOWED)
    if isinstance(value, int | float):
        return validate(ConstantAlbedo, {"value": value})
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
    """Whether a word in the place of an albedo is the path of a file: it has a slash or a point and is no number."""
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
