"""A table of known planets in memory: its columns, and its rows by star, by planet and by what may be counted."""

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from catalogs.frozen_table import FrozenTable
from catalogs.known_planet_columns import CANDIDATE, COLUMNS, COUNTED, INPUT_ONLY
from catalogs.names import snapshot_aliases
from catalogs.nomenclature import designation_key
from catalogs.table_cells import LeftOut, Use
from cpic_core import ArrayLike, InputError, NDArray

TABLE_COLUMNS = tuple(name for name in COLUMNS if name not in INPUT_ONLY)
TEXTS = tuple(name for name in TABLE_COLUMNS if COLUMNS[name].kind == "text")
NUMBERS = tuple(name for name in TABLE_COLUMNS if name not in TEXTS)
PLACE_DEG = 3.0
"""Error of the angles of an orbit within which its planet's place is known: a resolution element at 1 arcsec."""


@dataclass(frozen=True)
class KnownPlanetTable(FrozenTable):
    """An immutable table of planets.

    Parameters
    ----------
    columns : mapping of str to ndarray
        Read-only arrays of equal length: those of `catalogs.known_planet_columns.COLUMNS` less ``INPUT_ONLY``;
        float64 with nan where missing, or text.
    label : str
        What messages call the table.
    provenance : str
        One line for results: what it is, its vintage or file name, the first digits of its sha256.
    notes : tuple of str
        Remarks on the reading, for its owner.
    solutions : mapping of str to KnownPlanetTable
        All published orbits of the planets that have several, by the name of the planet, each orbit a row with its
        ``solution_weight``. In ``columns`` these planets have the orbit of the largest weight.
    candidates : bool
        Whether candidates are counted as well.
    unused : tuple of str
        Headings of a user's file that were not used; its planets have the flag ``columns_not_used``.
    uses : tuple of Use
        What each column of a user's file was taken for.
    left_out : tuple of LeftOut
        Rows and cells of it that were not used.
    """

    label: str
    provenance: str
    notes: tuple[str, ...] = ()
    solutions: Mapping[str, "KnownPlanetTable"] = field(default_factory=dict)
    candidates: bool = False
    unused: tuple[str, ...] = ()
    uses: tuple[Use, ...] = ()
    left_out: tuple[LeftOut, ...] = ()

    def number(self, name: str) -> NDArray[np.float64]:
        """Return a column of numbers (read-only)."""
        if name not in NUMBERS:
            raise InputError("column", name, allowed=", ".join(NUMBERS))
        return np.asarray(self.columns[name], np.float64)

    def text(self, name: str) -> list[str]:
        """Return a column of texts."""
        if name not in TEXTS:
            raise InputError("column", name, allowed=", ".join(TEXTS))
        return [str(cell) for cell in self.columns[name]]

    def flags(self, row: int) -> tuple[str, ...]:
        """Return the flags of one planet."""
        return tuple(filter(None, str(self.columns["flags"][row]).split(";")))

    def select(self, rows: ArrayLike) -> "KnownPlanetTable":
        """Return the table of the rows of a mask, or of row numbers in their order."""
        index = np.asarray(rows)
        index = np.flatnonzero(index) if index.dtype == np.bool_ else index.astype(np.int64)
        columns = {name: cells[index] for name, cells in self.columns.items()}
        return replace(self, columns=columns, notes=())

    def orbits_of(self, row: int) -> "KnownPlanetTable":
        """Return the published orbits of one planet, each a row: one, or several with their weights."""
        return self.solutions.get(str(self.columns["planet"][row])) or self.select([row])

    def with_candidates(self) -> "KnownPlanetTable":
        """Return the table in which candidates are counted like confirmed planets."""
        return replace(self, candidates=True, provenance=f"{self.provenance}, candidates counted")

    @functools.cached_property
    def counted(self) -> NDArray[np.bool_]:
        """Tell which planets are counted: those whose status is not ``refuted``, nor ``candidate`` unless asked for."""
        return np.isin(self.columns["status"], (*COUNTED, CANDIDATE) if self.candidates else COUNTED)

    @functools.cached_property
    def listed_by_star(self) -> Mapping[str, tuple[int, ...]]:
        """Rows of all planets of each star, counted or not, by `star_key` of its name."""
        found: dict[str, list[int]] = {}
        for row, name in enumerate(self.text("star")):
            found.setdefault(star_key(name), []).append(row)
        return MappingProxyType({key: tuple(rows) for key, rows in found.items()})

    @functools.cached_property
    def by_star(self) -> Mapping[str, tuple[int, ...]]:
        """Rows of the counted planets of each star that has any, by `star_key` of its name."""
        counted = {key: tuple(row for row in rows if self.counted[row]) for key, rows in self.listed_by_star.items()}
        return MappingProxyType({key: rows for key, rows in counted.items() if rows})

    @functools.cached_property
    def placed(self) -> NDArray[np.bool_]:
        """Tell which planets have a place on the sky: phase, inclination and node are known, within `PLACE_DEG` deg.

        Planets with several published orbits have none. The errors of the angles are added in quadrature, that of the
        phase as it is a period after the time given.
        """
        lacking = {"phase_unknown", "several_orbits"}
        dated = np.array([lacking.isdisjoint(self.flags(row)) for row in range(len(self))], bool)
        times = [self.number(f"{what}_err_days") for what in ("conjunction", "periastron")]
        time_days = np.where(np.isfinite(self.number("conjunction_jd")), *times)
        turns = [days / self.number("period_days") for days in (time_days, self.number("period_err_days"))]
        angles_deg = [self.number(f"{what}_err_deg") for what in ("inclination", "node")]
        angles_deg += [360.0 * turn for turn in turns]
        error_deg = np.sqrt(np.sum(np.square(np.nan_to_num(angles_deg, nan=0.0)), axis=0))
        known = np.isfinite(self.number("inclination_deg")) & np.isfinite(self.number("node_deg"))
        return np.asarray(dated & known & (error_deg <= PLACE_DEG))

    def rows_of(self, star: str) -> tuple[int, ...]:
        """Return the rows of a star's counted planets, by any of its names; empty if it has none."""
        return self.by_star.get(star_key(star), ())

    def listed_rows_of(self, star: str) -> tuple[int, ...]:
        """Return the rows of all planets of a star, those that are not counted too, by any of its names."""
        return self.listed_by_star.get(star_key(star), ())

    def row_of(self, name: str) -> int:
        """Return the row of a planet, counted or not, by its name: any name of its star, and its letter.

        Raises
        ------
        InputError
            If there is no such planet.
        """
        star, _, letter = " ".join(name.split()).rpartition(" ")
        rows = self.listed_rows_of(star)
        planets = self.text("planet")
        for row in rows:
            if planets[row].rpartition(" ")[2] == letter:
                return row
        hint = f"of this star: {', '.join(planets[row] for row in rows)}" if rows else ""
        raise InputError("planet", name, allowed=f"a planet of {self.label}", hint=hint)


@functools.lru_cache(maxsize=100_000)
def star_key(name: str) -> str:
    """Return one key for all names of a star: that of its name in the embedded catalogue, where it is in there.

    Examples
    --------
    >>> from catalogs.known_planets import star_key
    >>> star_key("HD 22049") == star_key("epsilon Eridani") == star_key("eps Eri")
    True
    """
    key = designation_key(name)
    known = snapshot_aliases().get(key, (name, 0))[0]
    return key if known == name else designation_key(known)


def planet_key(star: str, planet: str) -> tuple[str, str]:
    """Return one key for all names of a planet: that of its star, and the last word of its own name.

    Parameters
    ----------
    star, planet : str
        Any name of the star, and any of the planet; the last word of the latter is its letter.

    Examples
    --------
    >>> from catalogs.known_planet_table import planet_key
    >>> planet_key("HD 22049", "HD 22049 b") == planet_key("eps Eri", "epsilon Eridani b")
    True
    """
    return star_key(star), planet.split()[-1].casefold()
