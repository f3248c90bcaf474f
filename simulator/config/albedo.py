"""What reflects the star's light, as configuration: one of four kinds of geometric albedo."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import BeforeValidator, Field, model_validator

from catalogs.errors import InputError
from simulator.config.base import FrozenModel, validate

__all__ = [
    "LOG10_FSED_MAX",
    "AlbedoSpec",
    "AlbedoValue",
    "ConstantAlbedo",
    "MeasuredAlbedo",
    "ParametricAlbedo",
    "TableAlbedo",
    "albedo_spec",
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


class ParametricAlbedo(FrozenModel):
    """Rayleigh scattering over a cloud deck with methane absorption; see `simulator.target.reflection`.

    ``log10_mh`` is the metallicity over the Sun's and ``log10_fsed`` the sedimentation efficiency, both as decimal
    logarithms; a mapping may give ``mh`` or ``fsed``, not logarithms, instead. Without ``insolation_au`` it is the
    true distance over the square root of the star's luminosity.
    """

    model: Literal["parametric"] = "parametric"
    log10_mh: Annotated[float, Field(ge=0, le=2)]
    log10_fsed: Annotated[float, Field(ge=-2, le=2)]
    insolation_au: Annotated[float, Field(gt=0, le=1e6)] | None = None
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
            if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0:
                raise InputError(linear, value, allowed="a number above 0")
            result[name] = math.log10(value)
        return result

    @property
    def label(self) -> str:
        """For tables and legends: what was used, in linear units too."""
        distance = "star's insolation" if self.insolation_au is None else f"{self.insolation_au:g} au"
        fsed = 10.0**self.log10_fsed
        shown = f"{fsed:.3g}" if self.log10_fsed <= LOG10_FSED_MAX else f"{fsed:.3g} -> 6"
        phase = "" if self.phase_function == "lambert" else ", grid phase"
        return f"parametric ({10.0**self.log10_mh:.3g} x solar, f_sed {shown}, {distance}{phase})"


class ConstantAlbedo(FrozenModel):
    """The same geometric albedo at every wavelength."""

    model: Literal["constant"] = "constant"
    value: Annotated[float, Field(ge=0, le=1.5)]

    @property
    def label(self) -> str:
        """For tables and legends."""
        return f"constant {self.value:g}"


class TableAlbedo(FrozenModel):
    """A user's spectrum: a two-column file, or wavelengths and values."""

    model: Literal["table"] = "table"
    file: str | None = None
    wavelength_nm: tuple[float, ...] | None = None
    albedo: tuple[float, ...] | None = None

    @model_validator(mode="after")
    def _one_source(self) -> TableAlbedo:
        arrays = self.wavelength_nm is not None and self.albedo is not None
        if (self.file is not None) == arrays or (self.wavelength_nm is None) != (self.albedo is None):
            raise InputError("file", self.file, allowed="either file, or wavelength_nm and albedo")
        return self

    @property
    def label(self) -> str:
        """For tables and legends."""
        return f"table {self.file}" if self.file is not None else "table"


AlbedoSpec: TypeAlias = MeasuredAlbedo | ParametricAlbedo | ConstantAlbedo | TableAlbedo
_BY_MODEL: dict[str, type[MeasuredAlbedo] | type[ParametricAlbedo] | type[ConstantAlbedo] | type[TableAlbedo]] = {
    **dict.fromkeys(("jupiter", "saturn", "uranus", "neptune"), MeasuredAlbedo),
    "parametric": ParametricAlbedo,
    "constant": ConstantAlbedo,
    "table": TableAlbedo,
}


def albedo_spec(value: Any) -> AlbedoSpec:
    """Read an albedo as people write it.

    Parameters
    ----------
    value : AlbedoSpec, str, float or mapping
        ``"jupiter"`` and the other giants; a number for a constant; a mapping with ``model`` (which may be left out
        where the other keys decide): ``{log10_mh: 1, log10_fsed: 1}``, ``{file: spectrum.txt}``.

    Raises
    ------
    InputError
        Naming the key, its value and what is allowed.
    """
    if isinstance(value, MeasuredAlbedo | ParametricAlbedo | ConstantAlbedo | TableAlbedo):
        return value
    if isinstance(value, bool) or value is None:
        raise InputError("albedo", value, allowed="a planet's name, a number or a mapping")
    if isinstance(value, int | float):
        return validate(ConstantAlbedo, {"value": value})
    tree = {"model": value} if isinstance(value, str) else value
    if not isinstance(tree, Mapping):
        raise InputError("albedo", value, allowed="a planet's name, a number or a mapping")
    model = tree.get("model", _implied(tree))
    if model not in _BY_MODEL:
        raise InputError("albedo", model, allowed=", ".join(_BY_MODEL))
    return validate(_BY_MODEL[model], tree)


def _implied(tree: Mapping[str, Any]) -> str:
    if "value" in tree:
        return "constant"
    if "file" in tree or "albedo" in tree:
        return "table"
    return "parametric"


AlbedoValue: TypeAlias = Annotated[AlbedoSpec, BeforeValidator(albedo_spec)]
"""Field type of a model: reads whatever `albedo_spec` reads."""
