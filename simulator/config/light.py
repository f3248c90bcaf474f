"""Where the light of an object comes from, as configuration: a named model, a file, or a table of numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from catalogs.errors import InputError
from simulator.config.base import FrozenModel, validate
from simulator.config.keys import canonical_keys, nearest

__all__ = [
    "PLANET_MODELS",
    "STAR_MODELS",
    "PlanetLight",
    "Real",
    "SpectrumTable",
    "StarLight",
    "check_columns",
    "spectrum_value",
]

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


class SpectrumTable(FrozenModel):
    """A user's spectrum at the telescope, linear between its samples.

    ``photlam`` (ph/s/cm2/A) or ``flam`` (erg/s/cm2/A) over increasing ``wavelength_nm``.
    """

    wavelength_nm: tuple[Real, ...]
    photlam: tuple[Real, ...] | None = None
    flam: tuple[Real, ...] | None = None

    @model_validator(mode="before")
    @classmethod
    def _keys(cls, tree: Any) -> Any:
        return canonical_keys(tree, cls.model_fields, {}, hints=_TABLE_HINTS) if isinstance(tree, Mapping) else tree

    @model_validator(mode="after")
    def _readable(self) -> SpectrumTable:
        if (self.photlam is None) == (self.flam is None):
            raise InputError(
                "photlam",
                "missing" if self.flam is None else "given with flam",
                allowed="photlam (ph/s/cm2/A) or flam (erg/s/cm2/A), one of the two",
            )
        name = "photlam" if self.photlam is not None else "flam"
        values = self.photlam or self.flam or ()
        check_columns("wavelength_nm", self.wavelength_nm, name, values)
        if not any(values):
            raise InputError(name, "all zero", allowed="some light")
        return self


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
        if value in models or (str(value) and Path(value).exists()):
            return str(value)
        raise InputError(
            "spectrum", str(value), allowed=f"{', '.join(models)}, or an existing file", hint=nearest(value, models)
        )
    columns = _columns_of(value)
    if columns is None:
        raise InputError("spectrum", value, allowed=f"{', '.join(models)}, a file, or a table of numbers")
    return validate(SpectrumTable, dict(zip(("wavelength_nm", "photlam"), columns, strict=True)))


def _columns_of(value: Any) -> tuple[list[float], list[float]] | None:
    """Wavelengths (nm) and PHOTLAM of a spectrum object of this project or of synphot."""
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
