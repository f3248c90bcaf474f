"""Tables of a survey's results: their columns, written part by part, joined into one Parquet file each.

A part is what one task found, rows for several tables in one file that is there whole or not at all
(`cpic_planner.jobs.folder`). The joined tables hold no clock, path or order of arrival: the same parts give the same
bytes, whoever made them and however often the run was broken off.
"""

from __future__ import annotations

import io
import json
import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import ArrayLike, InputError, NDArray, read_file
from cpic_planner.jobs import DamagedPartError, RunFolder
from cpic_planner.results import Column, Row, arrow_schema, column, columns_of

_LOG = logging.getLogger(__name__)
SCHEMA_VERSION = 1
_METADATA, _ABOUT = b"cpic_planner", {"schema_version": SCHEMA_VERSION}


# All that decides the bytes is fixed.
_FORMAT = {"row_group_size": 1 << 18, "compression": "zstd", "compression_level": 3, "version": "2.6"}
_FORMAT |= {"data_page_version": "1.0", "write_statistics": True, "store_schema": True}
_WRITTEN = "a Parquet file written by this program"
_MAX_BYTES = 4_000_000_000
_KINDS = {"float64": "f", "int64": "i", "int32": "i", "bool": "b", "string": "OUT"}


@dataclass(frozen=True)
class Table:
    """A table with its declared key: columns whose values together are unique, and by which rows are sorted."""

    name: str
    columns: tuple[Column, ...]
    key: tuple[str, ...]

    def __post_init__(self) -> None:
        names = [column.name for column in self.columns]
        for item in self.columns:
            if item.dtype not in _KINDS:
                raise InputError(f"columns.{item.name}.dtype", item.dtype, allowed=", ".join(_KINDS))
        if len(set(names)) < len(names):
            raise InputError(f"tables.{self.name}.columns", names, allowed="each name once")
        if not self.key or not set(self.key) <= set(names):
            raise InputError(f"tables.{self.name}.key", list(self.key), allowed=f"some of {', '.join(names)}")

    @cached_property
    def schema(self) -> Any:
        """Arrow schema: types, and unit and description of each column."""
        return arrow_schema(self.columns)


@dataclass(frozen=True, eq=False)
class StoredTable:
    """A table as read from its file: columns by name, and what the file says about them."""

    name: str
    key: tuple[str, ...]
    columns: dict[str, NDArray[Any]]
    units: dict[str, str]
    descriptions: dict[str, str]
    config_hash: str
    schema_version: int


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
    ...     path = store.merge()["yields"]
    ...     read_table(path).columns["found"]
    array([1.5, 2.5, 0.5])
    """

    def __init__(self, folder: RunFolder, tables: Sequence[Table]) -> None:
        self._folder = folder
        self._tables = {table.name: table for table in tables}
        if not tables or len(self._tables) < len(tables):
            raise InputError("tables", [table.name for table in tables], allowed="at least one, each name once")

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

    def save_part(self, key: str, body: Mapping[str, Mapping[str, ArrayLike]]) -> dict[str, Any]:
        """Store one part whole; one of the same key is replaced. Rows stay on disk: returns nothing of them.

        Parameters
        ----------
        key : str
            Key of the part.
        body : mapping
            For every table its columns, arrays of one length (which may be 0).

        Raises
        ------
        InputError
            If tables or columns are missing or too many, lengths differ, a value does not fit its declared type,
            or a key occurs twice.
        """
        import pyarrow as pa

        if set(body) != set(self._tables):
            raise InputError(f"part {key}: tables", sorted(body), allowed=", ".join(sorted(self._tables)))
        sink = io.BytesIO()
        for name, table in self._tables.items():
            rows = _arrow_table(table, body[name], f"part {key}: {name}")
            _refuse_repeats(_sorted_rows(table, rows), table, f"part {key}: {name}")
            with pa.ipc.new_stream(sink, table.schema, options=pa.ipc.IpcWriteOptions(compression="zstd")) as stream:
                stream.write_table(rows)
        self._folder.save_blob(key, sink.getvalue())
        return {}

    def read(self, table: str) -> dict[str, NDArray[Any]]:
        """Return all parts of one table joined, sorted by its key.

        Raises
        ------
        InputError
            If a key occurs twice, or the store has no such table.
        DamagedPartError
            If a part is damaged.
        """
        return _as_arrays(self._joined(table))

    def merge(self, expected: Sequence[str] | None = None) -> dict[str, Path]:
        """Write ``DIR/TABLE.parquet`` for every table, the same bytes for any order of parts.

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
        if expected is not None:
            found, asked = {key for key, _ in self._parts()}, set(expected)
            if found != asked:
                first, allowed = min(found ^ asked), f"the {len(asked)} of this run"
                hint = f"{first} is {'missing' if first in asked else 'not one of them'}"
                raise InputError("parts", f"{len(found)} on disk", allowed=allowed, hint=hint)
        return {name: self._folder.write_bytes(f"{name}.parquet", self._parquet(name)) for name in self._tables}

    def _parts(self) -> Iterator[tuple[str, bytes]]:
        for path in self._folder.blob_paths():
            yield self._folder.read_blob(path)

    def _joined(self, name: str) -> Any:
        import pyarrow as pa

        if name not in self._tables:
            raise InputError("table", name, allowed=", ".join(self._tables))
        table, place = self._tables[name], list(self._tables).index(name)
        parts = [_rows_of(content, place, table) for _, content in self._parts()]
        rows = _sorted_rows(table, pa.concat_tables([table.schema.empty_table(), *parts]))
        _refuse_repeats(rows, table, name)
        return rows

    def _parquet(self, name: str) -> bytes:
        import pyarrow.parquet as pq

        table = self._tables[name]
        made = {name: getattr(self._folder, name) for name in ("config_hash", "fingerprint")}
        about = {"table": name, "key": table.key, **made, **_ABOUT}
        rows = self._joined(name).replace_schema_metadata({_METADATA: json.dumps(about, sort_keys=True)})
        sink = io.BytesIO()
        texts = [column.name for column in table.columns if column.dtype == "string"]
        pq.write_table(rows, sink, use_dictionary=texts, **_FORMAT)
        return sink.getvalue()


def table_files(tables: Sequence[Table]) -> list[str]:
    """Return the names of the files that `ResultStore.merge` writes."""
    return [f"{table.name}.parquet" for table in tables]


def read_table(path: str | Path) -> StoredTable:
    """Read a table that `ResultStore.merge` wrote.

    Raises
    ------
    InputError
        If the file is not there, not Parquet, or not one of ours.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        data = read_file(path, key="table", allowed=_WRITTEN, max_bytes=_MAX_BYTES)
        rows = pq.read_table(pa.BufferReader(data), use_threads=False)
        about = json.loads(rows.schema.metadata[_METADATA])
    except InputError:
        raise
    except (OSError, pa.ArrowException, KeyError, TypeError, ValueError) as error:
        raise InputError("table", str(path), allowed=_WRITTEN, hint=f"{type(error).__name__}: {error}") from None
    units, descriptions = (
        {field.name: field.metadata[what].decode() for field in rows.schema} for what in (b"unit", b"description")
    )
    key, asked, version = tuple(about["key"]), about["config_hash"], about["schema_version"]
    return StoredTable(about["table"], key, _as_arrays(rows), units, descriptions, asked, version)


def _arrow_table(table: Table, columns: Mapping[str, ArrayLike], where: str) -> Any:
    import pyarrow as pa

    names = [column.name for column in table.columns]
    if set(columns) != set(names):
        raise InputError(f"{where} columns", sorted(columns), allowed=", ".join(names))
    arrays = [_checked(column, columns[column.name], f"{where}.{column.name}") for column in table.columns]
    lengths = {len(array) for array in arrays}
    if len(lengths) > 1:
        raise InputError(f"{where} lengths", sorted(lengths), allowed="one length for all columns")
    for item, array in zip(table.columns, arrays, strict=True):
        if item.name in table.key and item.dtype == "float64" and np.isnan(array).any():
            raise InputError(f"{where}.{item.name}", float("nan"), allowed="numbers in a key")
    typed = [pa.array(array, field.type) for array, field in zip(arrays, table.schema, strict=True)]
    return pa.table(typed, schema=table.schema)


def _checked(column: Column, values: ArrayLike, where: str) -> NDArray[Any]:
    """Return the values in the declared type, unchanged."""
    given = np.asarray(values)
    if given.ndim != 1:
        raise InputError(where, f"{given.ndim} dimensions", allowed="1")
    if given.size == 0:
        return np.empty(0, dtype=object if column.dtype == "string" else column.dtype)
    if column.dtype == "string":
        texts = given.astype(object)
        wrong = next((text for text in texts if not isinstance(text, str)), None)
        if given.dtype.kind not in _KINDS["string"] or any(not isinstance(text, str) for text in texts):
            raise InputError(where, wrong, allowed="texts")
        return texts
    kinds = {"float64": "fiu", "bool": "b"}.get(column.dtype, "iu")
    cast = given.astype(column.dtype) if given.dtype.kind in kinds else None
    if cast is None or not np.array_equal(cast, given, equal_nan=column.dtype == "float64"):
        raise InputError(where, f"dtype {given.dtype}", allowed=f"values that {column.dtype} holds")
    return cast


def _rows_of(content: bytes, place: int, table: Table) -> Any:
    """Return the rows of the table at ``place`` in a part: one stream of Arrow after another."""
    import pyarrow as pa

    source = io.BytesIO(content)
    for _ in range(place):
        pa.ipc.open_stream(source).read_all()
    rows = pa.ipc.open_stream(source).read_all()
    if not rows.schema.equals(table.schema):
        raise DamagedPartError(f"a part has other columns in table {table.name} than this version writes")
    return rows


def _sorted_rows(table: Table, rows: Any) -> Any:
    """Return the rows by key, in one piece: how a table is cut in pieces shows in the bytes of its file."""
    import pyarrow.compute as pc

    rows = rows.combine_chunks()
    order = pc.sort_indices(rows, sort_keys=[(name, "ascending") for name in table.key])
    return rows.take(order).combine_chunks()


def _refuse_repeats(rows: Any, table: Table, where: str) -> None:
    if rows.num_rows < 2:
        return
    same = np.ones(rows.num_rows - 1, dtype=bool)
    for name in table.key:
        values = rows.column(name).to_numpy()
        same &= values[1:] == values[:-1]
    if same.any():
        first = rows.slice(int(np.argmax(same)), 1).select(list(table.key)).to_pylist()[0]
        raise InputError(f"{where} key", first, allowed="each key once", hint=f"{int(same.sum())} rows repeat one")


def _as_arrays(rows: Any) -> dict[str, NDArray[Any]]:
    return {name: rows.column(name).to_numpy() for name in rows.column_names}


PLANETS = ("new_planets", "known_planets")
"""Columns that add up to the planets found."""
HOURS = ("search_h", "follow_up_h", "alarm_h")
"""Columns that add up to the telescope time used."""


class UniverseRow(Row):
    """One universe of a strategy."""

    strategy: str = column("name of the strategy")
    universe: int = column("number of the universe, the same sky for every strategy")
    new_planets: int = column("planets found that nobody knew")
    new_planets_unconditional: int = column(
        "the same of the whole population, had nobody looked before: with planets that velocities, stability and known "
        "giants exclude, in the same visits"
    )
    known_planets: int = column("known planets seen")
    stars_with_planet: int = column("stars with a planet found")
    characterised_planets: int = column("planets found and seen in every band of the follow-up")
    orbits_known: int = column("planets found whose orbit is known, what is published and logged included")
    confirmed_planets: int = column("planets found where a published orbit has them, or seen again in another visit")
    noise_alarms: int = column("noise taken for a planet")
    background_alarms: int = column("background stars taken for a planet")
    visits: int = column("visits made")
    search_h: float = column("telescope time of the search")
    follow_up_h: float = column("telescope time of follow-up, visits for orbits, and second visits of true candidates")
    alarm_h: float = column("telescope time of visits that only false alarms asked for")


class DetectionRow(Row):
    """One planet that a strategy finds in one universe."""

    strategy: str = column("name of the strategy")
    universe: int = column("number of the universe")
    star: str = column("name in the catalogue")
    planet: int = column("number of the planet around its star, known ones first")
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


class StarRow(Row):
    """The visits and findings of a strategy at one star in one block of universes."""

    strategy: str = column("name of the strategy")
    star: str = column("name in the catalogue")
    block: int = column("block of universes that the sums run over")
    universes: int = column("universes of the block")
    visits: int = column("visits of the search, sum")
    search_h: float = column("telescope time of the search, sum")
    follow_up_h: float = column("telescope time of the follow-up, sum")
    alarm_h: float = column("telescope time of visits that only false alarms asked for, sum")
    new_planets: int = column("planets found that nobody knew, sum")
    new_planets_unconditional: int = column("the same with the planets that are excluded, sum")
    known_planets: int = column("known planets seen, sum")
    orbits_known: int = column("planets whose orbit is known, sum")


class OrbitRow(Row):
    """The orbit of one planet that a strategy finds in one universe, with enough positions; errors are 1 sigma."""

    strategy: str = column("name of the strategy")
    universe: int = column("number of the universe")
    star: str = column("name in the catalogue")
    planet: int = column("number of the planet around its star, known ones first")
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


TABLES = (
    Table("universes", columns_of(UniverseRow), key=("strategy", "universe")),
    Table("detections", columns_of(DetectionRow), key=("strategy", "universe", "star", "planet")),
    Table("stars", columns_of(StarRow), key=("strategy", "star", "block")),
    Table("orbits", columns_of(OrbitRow), key=("strategy", "universe", "star", "planet")),
)
DETECTION_DTYPES = {item.name: "int64" if item.dtype == "string" else item.dtype for item in columns_of(DetectionRow)}
"""Types of the columns of detections while they are counted, where a star is its position."""
ORBIT_DTYPES = {item.name: object if item.dtype == "string" else item.dtype for item in columns_of(OrbitRow)}
