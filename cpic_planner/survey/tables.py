"""Tables of a survey's results: their columns, written part by part, joined into one Parquet file each.

A part is what one task found, rows for several tables in one file that is there whole or not at all
(`cpic_planner.jobs.folder`). The joined tables hold no clock, path or order of arrival: the same parts give the same
bytes, whoever made them and however often the run was broken off.
"""

from __future__ import annotations

import io
import json
import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import ArrayLike, InputError, NDArray, Record
from cpic_planner.jobs import DamagedPartError, RunFolder
from cpic_planner.results import Column, Row, arrow_schema, column, columns_of, unit_of

_LOG = logging.getLogger(__name__)
SCHEMA_VERSION = 1
# All that decides the bytes is fixed.
_FORMAT = {"row_group_size": 1 << 18, "compression": "zstd", "compression_level": 3, "version": "2.6"}
_FORMAT |= {"data_page_version": "1.0", "write_statistics": True, "store_schema": True}


class Table(Record):
    """A table with its declared key: columns whose values together are unique, and by which rows are sorted."""

    name: str
    columns: tuple[Column, ...]
    key: tuple[str, ...]

    @property
    def file(self) -> str:
        """Name of its file in the folder of a run."""
        return f"{self.name}.parquet"

    @cached_property
    def schema(self) -> Any:
        """Arrow schema: types, and unit and description of each column."""
        return arrow_schema(self.columns)

    @cached_property
    def empty(self) -> dict[str, NDArray[Any]]:
        """Columns without rows."""
        return {
            item.name: np.zeros(0, object if item.dtype == "string" else item.dtype)
            for item in self.columns
            if item.name != "strategy"
        }


class ResultStore:
    """The tables of one run in its output folder.

    Parameters
    ----------
    folder : RunFolder
        Open folder of the run; its parts belong to this store.
    tables : sequence of Table
        What each part has rows for.

    Examples
    --------
    >>> import tempfile
    >>> from cpic_planner.jobs.folder import open_run_folder
    >>> yields = Table("yields", (Column("draw", "int64", "number of the universe"),
    ...                           Column("found", "float64", "planets found")), key=("draw",))
    >>> with tempfile.TemporaryDirectory() as place, open_run_folder(place, kind="whatif", config_hash="1") as folder:
    ...     store = ResultStore(folder, [yields])
    ...     _ = store.save_part("b", {"yields": {"draw": [2], "found": [0.5]}})
    ...     _ = store.save_part("a", {"yields": {"draw": [0, 1], "found": [1.5, 2.5]}})
    ...     store.read("yields")["found"]
    array([1.5, 2.5, 0.5])
    """

    def __init__(self, folder: RunFolder, tables: Sequence[Table]) -> None:
        self._folder = folder
        self._tables = {table.name: table for table in tables}

    def finished(self) -> frozenset[str]:
        """Return the keys of the parts that are whole; damaged ones are named on the log and are to be done again."""
        keys = set()
        for path in self._folder.blob_paths():
            try:
                keys.add(self._folder.read_blob(path)[0])
            except DamagedPartError as error:
                _LOG.warning("%s: doing it again", error)
        return frozenset(keys)

    @cached_property
    def _kept(self) -> frozenset[str]:
        return self.finished()

    def part(self, key: str) -> dict[str, Any] | None:
        """Return nothing but that the part was whole when this store was first asked; None if it was not."""
        return {} if key in self._kept else None

    def save_part(self, key: str, body: bytes | Mapping[str, Mapping[str, ArrayLike]]) -> dict[str, Any]:
        """Store one part whole; one of the same key is replaced. Rows stay on disk: returns nothing of them.

        Parameters
        ----------
        key : str
            Key of the part.
        body : bytes or mapping
            What `packed` makes, or is given.
        """
        self._folder.save_blob(key, body if isinstance(body, bytes) else packed(self._tables.values(), body))
        return {}

    def read(self, table: str) -> dict[str, NDArray[Any]]:
        """Return all parts of one table joined, sorted by its key, as they were when any table was first asked for.

        Raises
        ------
        InputError
            If a key occurs twice.
        DamagedPartError
            If a part is damaged.
        """
        rows = self._joined[1][table]
        return {name: _array(rows.column(name)) for name in rows.column_names}

    def merge(self, expected: Sequence[str] | None = None) -> dict[str, Path]:
        """Write the file of every table, the same bytes for any order of parts.

        Parameters
        ----------
        expected : sequence of str, optional
            Keys of all parts of the run.

        Returns
        -------
        paths : dict
            File of each table.

        Raises
        ------
        InputError
            If parts are missing or not expected, or a key of a table occurs twice.
        DamagedPartError
            If a part is damaged.
        """
        found, tables = self._joined
        if expected is not None and found != (asked := set(expected)):
            first, allowed = min(found ^ asked), f"the {len(asked)} of this run"
            hint = f"{first} is {'missing' if first in asked else 'not one of them'}"
            raise InputError("parts", f"{len(found)} on disk", allowed=allowed, hint=hint)
        return {
            name: self._folder.write_bytes(table.file, self._parquet(table, tables[name]))
            for name, table in self._tables.items()
        }

    @cached_property
    def _joined(self) -> tuple[set[str], dict[str, Any]]:
        """The keys of all parts, each of which is read once, and the rows of every table."""
        import pyarrow as pa

        keys, parts = set(), {name: [table.schema.empty_table()] for name, table in self._tables.items()}
        for path in self._folder.blob_paths():
            key, content = self._folder.read_blob(path)
            keys.add(key)
            source = io.BytesIO(content)
            for name, table in self._tables.items():
                rows = pa.ipc.open_stream(source).read_all()
                if not rows.schema.equals(table.schema):
                    raise DamagedPartError(f"a part has other columns in table {name} than this version writes")
                parts[name].append(rows)
        return keys, {name: _by_key(table, parts.pop(name)) for name, table in self._tables.items()}

    def _parquet(self, table: Table, rows: Any) -> bytes:
        import pyarrow.parquet as pq

        made = {name: getattr(self._folder, name) for name in ("config_hash", "fingerprint")}
        about = {"table": table.name, "key": table.key, **made, "schema_version": SCHEMA_VERSION}
        rows = rows.replace_schema_metadata({b"cpic_planner": json.dumps(about, sort_keys=True)})
        sink = io.BytesIO()
        texts = [item.name for item in table.columns if item.dtype == "string"]
        pq.write_table(rows, sink, use_dictionary=texts, **_FORMAT)
        return sink.getvalue()


def packed(tables: Iterable[Table], body: Mapping[str, Mapping[str, ArrayLike]]) -> bytes:
    """Return a part as it is stored: one stream of Arrow after another.

    Parameters
    ----------
    tables : iterable of Table
    body : mapping
        For every table its columns, arrays of one length (which may be 0); Arrow refuses what does not fit.
    """
    import pyarrow as pa

    sink = io.BytesIO()
    for table in tables:
        arrays = [pa.array(body[table.name][field.name], field.type) for field in table.schema]
        with pa.ipc.new_stream(sink, table.schema, options=pa.ipc.IpcWriteOptions(compression="zstd")) as stream:
            stream.write_table(pa.table(arrays, schema=table.schema))
    return sink.getvalue()


def _by_key(table: Table, parts: Sequence[Any]) -> Any:
    """Return the rows by key, in one piece: how a table is cut in pieces shows in the bytes of its file."""
    import pyarrow as pa
    import pyarrow.compute as pc

    rows = pa.concat_tables(parts).combine_chunks()
    order = pc.sort_indices(rows, sort_keys=[(name, "ascending") for name in table.key])
    rows = rows.take(order).combine_chunks()
    keys = [_array(rows.column(name)) for name in table.key]
    if (same := np.logical_and.reduce([values[1:] == values[:-1] for values in keys])).any():
        first = rows.slice(int(np.argmax(same)), 1).select(list(table.key)).to_pylist()[0]
        hint = f"{int(same.sum())} rows repeat one"
        raise InputError(f"{table.name} key", first, allowed="each key once", hint=hint)
    return rows


def _array(column: Any) -> NDArray[Any]:
    """Return a column; equal texts are one object."""
    import pyarrow as pa

    if not pa.types.is_string(column.type):
        return np.asarray(column.to_numpy())
    coded = column.combine_chunks().dictionary_encode()
    return np.asarray(np.array(coded.dictionary.to_pylist(), object)[coded.indices.to_numpy()])


PLANETS = ("new_planets", "known_planets")
"""Columns that add up to the planets found."""
HOURS = ("search_h", "follow_up_h", "alarm_h")
"""Columns that add up to the telescope time used."""
_STRATEGY = Column("strategy", "string", "name of the strategy")
_MEANINGS = {
    "universe": "number of the universe, the same sky for every strategy",
    "new_planets": "planets found that nobody knew",
    "new_planets_unconditional": "the same of the whole population, had nobody looked before: with planets that "
    "velocities, stability and known giants exclude, in the same visits",
    "known_planets": "known planets seen",
    "stars_with_planet": "stars with a planet found",
    "characterised_planets": "planets found and seen in every band of the follow-up",
    "orbits_known": "planets found whose orbit is known, what is published and logged included",
    "confirmed_planets": "planets found where a published orbit has them, or seen again in another visit",
    "noise_alarms": "noise taken for a planet",
    "background_alarms": "background stars taken for a planet",
    "visits": "visits made",
    "search_h": "telescope time of the search",
    "follow_up_h": "telescope time of follow-up, visits for orbits, and second visits of true candidates",
    "alarm_h": "telescope time of visits that only false alarms asked for",
}
_OF_UNIVERSE = {
    name: Column(name, "float64" if name in HOURS else "int64", meaning, unit_of(name))
    for name, meaning in _MEANINGS.items()
}
"""Columns of one universe of a strategy, by name."""


class PlanetRow(Row):
    """Base of rows of planets that a strategy finds."""

    strategy: str = column("name of the strategy")
    universe: int = column("number of the universe")
    star: str = column("name in the catalogue")
    planet: int = column("number of the planet around its star, known ones first")


class DetectionRow(PlanetRow):
    """One planet that a strategy finds in one universe."""

    known_row: int = column("row in the table of known planets, -1 for a new planet")
    kind: int = column("number of the planet's kind in the population; the last one is that of known planets")
    ordinal: int = column("number of the visit among those of its star")
    option: int = column("way to visit the star: number of its frames")
    band: str = column("band of the visit")
    day: float = column("since the start of the survey", unit="d")
    used_h: float = column("telescope time used by then")
    radius_rjup: float = column("radius")
    semi_major_axis_au: float = column("of the orbit")
    eccentricity: float = column("of the orbit")
    inclination_deg: float = column("of the orbit")
    margin: float = column("predicted significance over threshold")
    chance: float = column("probability that this visit detects it")
    snr: float = column("predicted photometric SNR")
    contrast: float = column("true planet-to-star ratio of detected rates")
    separation_arcsec: float = column("projected")
    pa_deg: float = column("position angle, east of north")
    roll_deg: float = column("position angle of the detector's +y axis")
    distance_au: float = column("true distance from the star")
    phase_deg: float = column("star-planet-observer")
    exozodi_zodis: float = column("dust around the star, in solar systems")


class OrbitRow(PlanetRow):
    """The orbit of one planet that a strategy finds in one universe, with enough positions; errors are 1 sigma."""

    epochs: int = column("positions: visits of search, follow-up and the observation log that show it")
    arc_periods: float = column("from the first position to the last, in periods of the planet")
    axis_error: float = column("of the semi-major axis, relative")
    period_error: float = column("relative")
    eccentricity_error: float = column("of the eccentricity")
    inclination_error_deg: float = column("of the inclination")
    next_day: float = column("next window of the star, since the start of the survey", unit="d")
    place_error_arcsec: float = column("of the predicted place then, rms distance")
    place_error_lambda_d: float = column("the same, in lambda/D of the last band that showed it")
    orbit_known: bool = column("whether both errors are within the rule of the strategy")


_SUMMED = ("visits", *HOURS, "new_planets", "new_planets_unconditional", "known_planets", "orbits_known")
STAR_COLUMNS = (
    _STRATEGY,
    Column("star", "string", "name in the catalogue"),
    Column("block", "int64", "block of universes that the sums run over"),
    Column("universes", "int64", "universes of the block"),
    *(replace(_OF_UNIVERSE[name], description=f"{_OF_UNIVERSE[name].description}, sum") for name in _SUMMED),
)
"""Columns of what a strategy does and finds at one star in one block of universes."""
UNIVERSES = Table("universes", (_STRATEGY, *_OF_UNIVERSE.values()), key=("strategy", "universe"))
DETECTIONS = Table("detections", columns_of(DetectionRow), key=("strategy", "universe", "star", "planet"))
STARS = Table("stars", STAR_COLUMNS, key=("strategy", "star", "block"))
ORBITS = Table("orbits", columns_of(OrbitRow), key=("strategy", "universe", "star", "planet"))
TABLES = (UNIVERSES, DETECTIONS, STARS, ORBITS)
