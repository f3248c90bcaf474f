"""Tables of sources: positions at hand, spectra worked out when they are asked for."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, overload

import numpy as np

from cpic_core import InputError
from simulator.target.lights import LitPlanet, LitStar
from simulator.target.star_spectrum import synphot_source

if TYPE_CHECKING:
    import pandas as pd
    from astropy.table import QTable
    from synphot import SourceSpectrum


Kind: TypeAlias = Literal["cstar", "planet", "star"]
_NUMBERS = dict.fromkeys(("x_arcsec", "y_arcsec", "separation_arcsec"), "arcsec") | {"pa_deg": "deg"}
_NUMBERS |= dict.fromkeys(("distance_au", "insolation_au"), "AU")
_COLUMNS = ("name", "kind", *_NUMBERS, "flags", "spectrum")


@dataclass(frozen=True, eq=False)
class SpectralSource:
    """One source: where it stands and its spectrum at the telescope.

    Attributes
    ----------
    name : str
    kind : {"cstar", "planet", "star"}
    x_arcsec, y_arcsec : float
        Offset from the central star on the detector.
    light : LitStar or LitPlanet
        What the spectrum is made from.
    """

    name: str
    kind: Kind
    x_arcsec: float
    y_arcsec: float
    light: LitStar | LitPlanet

    @property
    def separation_arcsec(self) -> float:
        """Separation from the central star."""
        return self.light.place.separation_arcsec

    @property
    def pa_deg(self) -> float:
        """Position angle, degrees east of north."""
        return self.light.place.pa_deg

    @property
    def distance_au(self) -> float | None:
        """True distance of a planet from its star, None for stars and where nothing depends on it."""
        return self.light.distance_au if isinstance(self.light, LitPlanet) else None

    @property
    def insolation_au(self) -> float | None:
        """Insolation used for the albedo, as the distance from the Sun that has it; None where it has no part."""
        return self.light.insolation_au if isinstance(self.light, LitPlanet) else None

    @property
    def wavelength_nm(self) -> np.ndarray:
        """Wavelengths of the samples; the spectrum is linear between them and zero outside."""
        return self.light.wavelength_nm

    @property
    def photlam(self) -> np.ndarray:
        """Photon flux density at the samples, ph/s/cm2/A."""
        return self.light.photlam

    @property
    def contrast(self) -> np.ndarray | None:
        """Planet over star at the samples; None for stars."""
        return self.light.contrast if isinstance(self.light, LitPlanet) else None

    @property
    def flags(self) -> tuple[str, ...]:
        """What was assumed, clamped or extrapolated."""
        return self.light.flags()

    @functools.cached_property
    def spectrum(self) -> SourceSpectrum:
        """The spectrum as a synphot source, PHOTLAM over Angstrom."""
        meta = {"name": self.name, "kind": self.kind, "flags": self.flags}
        return synphot_source(self.wavelength_nm, self.photlam, meta)

    def __getitem__(self, column: str) -> Any:
        if column not in _COLUMNS and column not in ("wavelength_nm", "photlam", "contrast"):
            raise InputError("column", column, allowed=", ".join(_COLUMNS))
        return getattr(self, column)


class _Numbers:
    """Column of a table: one number for each row, nan where there is none."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, table: SourceTable | None, owner: type | None = None) -> np.ndarray:
        rows = () if table is None else table.rows
        return np.array([getattr(row, self._name) for row in rows], dtype=np.float64)


@dataclass(frozen=True, eq=False)
class SourceTable(Sequence[SpectralSource]):
    """Sources of one scene, the central star first.

    ``table[0]`` and ``table["planet 1"]`` are rows, iteration goes over rows, and the names of the columns are
    attributes: ``table.x_arcsec`` is an array, ``table.spectrum`` a tuple of synphot sources.

    Attributes
    ----------
    scene : str
        Name of the scene.
    rows : tuple of SpectralSource
    """

    scene: str
    rows: tuple[SpectralSource, ...]

    def __len__(self) -> int:
        return len(self.rows)

    @overload
    def __getitem__(self, key: int) -> SpectralSource: ...
    @overload
    def __getitem__(self, key: slice) -> tuple[SpectralSource, ...]: ...
    @overload
    def __getitem__(self, key: str) -> Any: ...
    def __getitem__(self, key: int | slice | str) -> Any:
        """Return the row by number or name, rows by slice, or column by its name."""
        if not isinstance(key, str):
            return self.rows[key]
        for row in self.rows:
            if row.name == key:
                return row
        if key in _COLUMNS:
            return getattr(self, key)
        raise InputError("source", key, allowed=", ".join((*self.name, *_COLUMNS)))

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return _COLUMNS

    @property
    def name(self) -> tuple[str, ...]:
        """Names of the sources."""
        return tuple(row.name for row in self.rows)

    @property
    def kind(self) -> tuple[Kind, ...]:
        """``cstar``, ``planet`` or ``star``."""
        return tuple(row.kind for row in self.rows)

    x_arcsec = _Numbers()
    """Offsets along detector columns."""
    y_arcsec = _Numbers()
    """Offsets along detector rows."""
    separation_arcsec = _Numbers()
    """Separations from the central star."""
    pa_deg = _Numbers()
    """Position angles, degrees east of north."""
    distance_au = _Numbers()
    """True distances of planets from their star; nan where a source has none."""
    insolation_au = _Numbers()
    """Insolations used for albedos; nan where it has no part."""

    @property
    def flags(self) -> tuple[tuple[str, ...], ...]:
        """What was assumed, clamped or extrapolated."""
        return tuple(row.flags for row in self.rows)

    @property
    def spectrum(self) -> tuple[SourceSpectrum, ...]:
        """Spectra as synphot sources, PHOTLAM over Angstrom."""
        return tuple(row.spectrum for row in self.rows)

    def to_pandas(self) -> pd.DataFrame:
        """Return the table, without the spectra, as a data frame; flags joined by ``|``."""
        return _frame([self])

    def to_table(self) -> QTable:
        """Return the table, without the spectra, as an astropy table with units; flags joined by ``|``."""
        return _qtable([self])


@dataclass(frozen=True, eq=False)
class SourceBatch(Sequence[SourceTable]):
    """Source tables of many scenes, one after the other.

    Attributes
    ----------
    tables : tuple of SourceTable
    """

    tables: tuple[SourceTable, ...]

    def __len__(self) -> int:
        return len(self.tables)

    @overload
    def __getitem__(self, key: int | str) -> SourceTable: ...
    @overload
    def __getitem__(self, key: slice) -> tuple[SourceTable, ...]: ...
    def __getitem__(self, key: int | slice | str) -> SourceTable | tuple[SourceTable, ...]:
        """Return the table by number or name of its scene, tables by slice."""
        if not isinstance(key, str):
            return self.tables[key]
        for table in self.tables:
            if table.scene == key:
                return table
        raise InputError("scene", key, allowed="the name of a scene of the batch")

    def to_pandas(self) -> pd.DataFrame:
        """Return all rows, without the spectra, as one data frame with a first column ``scene``."""
        return _frame(self.tables, scene=True)

    def to_table(self) -> QTable:
        """Return all rows, without the spectra, as one astropy table with a first column ``scene``."""
        return _qtable(self.tables, scene=True)


def _columns(tables: Sequence[SourceTable], *, scene: bool = False) -> dict[str, Any]:
    rows = [row for table in tables for row in table.rows]
    columns: dict[str, Any] = {}
    if scene:
        columns["scene"] = [table.scene for table in tables for _ in table.rows]
    columns |= {name: [getattr(row, name) for row in rows] for name in ("name", "kind")}
    columns |= {name: np.array([getattr(row, name) for row in rows], dtype=np.float64) for name in _NUMBERS}
    return columns | {"flags": ["|".join(row.flags) for row in rows]}


def _frame(tables: Sequence[SourceTable], *, scene: bool = False) -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame(_columns(tables, scene=scene))


def _qtable(tables: Sequence[SourceTable], *, scene: bool = False) -> QTable:
    from astropy.table import QTable

    return QTable(_columns(tables, scene=scene), units=_NUMBERS)
