"""Base classes of results and their rows: what a column is called, its unit, how its numbers are written, and files.

A field of a `cpic_planner.results.base.Row` is a column of every table that shows such rows. What a column is called
and how its numbers are written stands beside the field (`column`); words that mean the same in every row stand in
`VOCABULARY`, by the name of the field. The unit follows from the suffix of the name unless the field states another.
From the columns derive CSV, ECSV with units, Arrow schemas of Parquet files, tables of astropy and pandas frames.
"""

from __future__ import annotations

import csv
import io
import math
import re
import types
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from html import escape
from operator import eq
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self, TypeVar, Union, cast, get_args, get_origin, overload

from pydantic import BaseModel, ConfigDict, Field, GetJsonSchemaHandler, WrapSerializer, WrapValidator
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, PydanticUndefined

from cpic_core import InputError, Record, guarded, shortened, unguarded

if TYPE_CHECKING:
    import pandas as pd
    from astropy.table import Table

StatusText = Literal["ok", "unreachable", "saturated", "outside_field", "invalid"]
VerdictText = Literal["detected", "measured_not_detected", "unreachable"]
DetectionMode = Literal["blind", "known_place"]
LimitText = Literal[
    "geometry", "photons", "background", "speckles", "common_speckles", "saturation", "motion", "visibility", "none"
]


_ABSENT = object()
_AT_ONCE = 500  # rows that are made together
_MOST_FIELDS, _MOST_ROWS, _MOST_COLUMNS, _LONGEST = 8, 20, 12, 60
_ABOUT = ("fingerprint", "schema_version", "kind")


class Result(BaseModel):
    """Base of results: immutable, unknown keys refused, NaN and inf refused; what has rows gives them as a table.

    Attributes
    ----------
    main_rows : str
        Field that holds the rows that the result is about; empty for the first one that holds rows.
    column_order : str
        Names of fields whose columns stand elsewhere than the fields: in front, or after ``...`` at the end.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)
    main_rows: ClassVar[str] = ""
    column_order: ClassVar[str] = ""

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Write meaning, label and unit of every field into its JSON Schema; see `cpic_planner.results.base`."""
        schema = handler(core_schema)
        properties = handler.resolve_ref_schema(schema).get("properties", {})
        for name, part in properties.items():
            told = described(name, cls.model_fields[name])
            said = {"title": told.title, "unit": told.unit, "description": told.description}
            part.update({key: value for key, value in said.items() if value})
        return schema

    @classmethod
    def of(cls, *sources: Any, at: int | None = None, **given: Any) -> Self:
        """Return a result made of the attributes of other objects that bear the names of its fields.

        Parameters
        ----------
        *sources
            Objects; the first one that has an attribute counts. Arrays become lists.
        at : int, optional
            Place in their arrays, along the first axis: for one star of columns of many.
        **given
            Values of fields that no source has, or has otherwise.

        Returns
        -------
        Result
            Numbers that are not finite are null where the field may be.
        """
        found = dict(given)
        for name, field in cls.model_fields.items():
            for source in () if name in given else sources:
                value = getattr(source, name, _ABSENT)
                if value is not _ABSENT:
                    found[name] = _plain(value, at, field.annotation)
                    break
        return cls(**found)

    def to_table(self, rows: str = "") -> Table:
        """Return the rows as a table of astropy, with units; missing numbers are masked.

        Parameters
        ----------
        rows : str
            Field that holds the rows; by default those that the result is about. One without rows is one row.

        Returns
        -------
        astropy.table.Table
            A column for each field of the row; of a mean with its error one for each number. Lists of words are
            joined with ``|``. ``meta`` has the plain fields of the result.

        Raises
        ------
        InputError
            If the result has no such rows.
        """
        columns, entries = self._table(rows)
        plain = {
            name: value for name, value in vars(self).items() if isinstance(value, str | int | float) and value != ""
        }
        return astropy_table(columns, entries, plain if entries != [self] else {})

    def to_pandas(self, rows: str = "") -> pd.DataFrame:
        """Return the rows as a pandas frame, units in the names; missing numbers are NaN, of whole ones ``pandas.NA``.

        Parameters
        ----------
        rows : str
            As of `to_table`.

        Raises
        ------
        InputError
            As `to_table`.
        """
        return data_frame(*self._table(rows))

    def _table(self, rows: str) -> tuple[list[Column], list[Any]]:
        kind: Any = type(self)
        held = rows_of(kind)
        if rows and rows not in held:
            raise InputError("rows", rows, allowed=", ".join(held) or "nothing: the result has no rows")
        name = rows or self.main_rows or next(iter(held), "")
        if not name:
            return taken_of(kind), [self]
        entries = list(getattr(self, name) or ())
        own = own_taken(entries) if "own" in held[name].model_fields else []
        return [*taken_of(held[name]), *own], entries

    def __repr_args__(self) -> Iterator[tuple[str, Any]]:
        """Yield what a short ``repr`` names: the first fields that hold something, and how many rows there are."""
        told = 0
        for name, value in vars(self).items():
            if name in _ABOUT or value is None or value == "" or isinstance(value, dict | Result):
                continue
            if isinstance(value, list | tuple | Rows):
                if value:
                    yield name, _Count(value)
            elif told < _MOST_FIELDS:
                told += 1
                yield name, shortened(value, _LONGEST) if isinstance(value, str) else value

    def _repr_html_(self) -> str:
        """Return the first rows as a table for a notebook."""
        frame = self.to_pandas()
        shown = frame.dropna(axis=1, how="all").head(_MOST_ROWS)
        text = shown.to_html(max_cols=_MOST_COLUMNS, border=0)
        return f"<p>{escape(repr(self))}</p>\n{text}\n<p>{len(shown)} of {len(frame)} rows</p>"


class _Count:
    """Stands for a list in a short ``repr``."""

    def __init__(self, items: Sequence[Any]) -> None:
        self._items = items

    def __repr__(self) -> str:
        first = self._items[0]
        if len(self._items) <= 3 and isinstance(first, str | int | float):
            return repr(self._items)
        return f"[{len(self._items)} {type(first).__name__}]"


def _plain(value: Any, at: int | None, annotation: Any) -> Any:
    if hasattr(value, "tolist"):
        value = value.tolist() if at is None else value[[at]].tolist()[0]
    if isinstance(value, float) and not math.isfinite(value) and type(None) in get_args(annotation):
        return None
    return value


class Row(Result):
    """Base of rows: every field is a column of the tables that show it."""


R = TypeVar("R", bound=Result)


class Rows(Sequence[R]):
    """Rows that are made of columns once they are looked at: of many stars they would take a hundred times the room.

    Parameters
    ----------
    kind : type
        Of the rows.
    columns : mapping of str to ndarray or OwnCells
        By names of fields, of one length; numbers that are not finite are null where the field may be.
    """

    def __init__(self, kind: type[R], columns: Mapping[str, Any]) -> None:
        self.kind = kind
        self.columns = columns

    @classmethod
    def held(cls, rows: Sequence[R]) -> Rows[R]:
        """Return rows that are made late, as a field has them."""
        assert isinstance(rows, Rows)
        return rows

    @property
    def listed(self) -> list[R]:
        """The same, as fields are declared."""
        return cast("list[R]", self)

    def having(self, **columns: Any) -> Self:
        """Return the rows with other columns too."""
        return type(self)(self.kind, {**self.columns, **columns})

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def __iter__(self) -> Iterator[R]:
        for start in range(0, len(self), _AT_ONCE):
            yield from self[start : start + _AT_ONCE]

    @overload
    def __getitem__(self, index: int) -> R: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[R]: ...
    def __getitem__(self, index: int | slice) -> R | Sequence[R]:
        numbers = range(len(self))[index]
        if isinstance(numbers, int):
            return self[numbers : numbers + 1][0]
        cells = []
        for name, column in self.columns.items():
            found = column[index].tolist()
            if type(None) in get_args(self.kind.model_fields[name].annotation):
                found = [None if isinstance(cell, float) and not math.isfinite(cell) else cell for cell in found]
            cells.append(found)
        return [self.kind(**dict(zip(self.columns, row, strict=True))) for row in zip(*cells, strict=True)]

    __hash__ = None  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and len(self) == len(other) and all(map(eq, self, other))


def gathered(kind: type[Result], *sources: Any, **given: Any) -> dict[str, Any]:
    """Return the columns of rows from those of other objects that bear the names of its fields; as `Result.of`."""
    found = dict(given)
    for name in (name for name in kind.model_fields if name not in given):
        column = next((own for own in (getattr(source, name, None) for source in sources) if own is not None), None)
        if column is not None:
            found[name] = column
    return found


class OwnCells:
    """Columns of a user's table, of which rows hold a mapping each."""

    def __init__(self, columns: Mapping[str, Any]) -> None:
        self.columns = columns

    def __getitem__(self, index: Any) -> OwnCells:
        return OwnCells({name: column[index] for name, column in self.columns.items()})

    def tolist(self) -> list[dict[str, Any]]:
        """Return the mappings."""
        cells = (column.tolist() for column in self.columns.values())
        return [dict(zip(self.columns, row, strict=True)) for row in zip(*cells, strict=True)]


def _kept(value: Any, handler: Callable[[Any], Any]) -> Any:
    return value if isinstance(value, Rows) else handler(value)


MADE_LATE = WrapValidator(_kept), WrapSerializer(lambda rows, handler: handler(list(rows)))
"""Says of a field that holds rows that they may be `Rows`; schemas say what a function says that it returns."""


class Document(Result):
    """Base of results that leave the program: the version of their schema and their kind begin the file."""

    schema_version: Literal[1] = 1
    kind: str = ""


class RunResult(Document):
    """Base of results, which say what made them."""

    fingerprint: str = ""


UNITS = {
    "per_hour": "1/h",
    "deg_s": "deg/s",
    "m_s": "m/s",
    "e_s": "electron/s",
    "arcsec": "arcsec",
    "days": "d",
    "bytes": "byte",
    "mjup": "M_jup",
}
UNITS |= {"rjup": "R_jup", "lsun": "solLum", "mag": "mag", "deg": "deg", "mb": "Mbyte", "gb": "Gbyte", "pc": "pc"}
UNITS |= {"au": "AU", "nm": "nm", "km": "km", "s": "s", "h": "h", "e": "electron"}
"""Unit of a number by the last words of its name, as astropy reads it; longer suffixes stand first."""


class Column(Record):
    """One column of a table, and the way in which it is shown to people.

    Attributes
    ----------
    name : str
        Name of the field.
    dtype : str
        Type of the cells, as numpy names it, or ``string``; empty where the field holds other rows.
    description : str
        What it is.
    unit : str
        Unit as astropy reads it; empty for none, and in a field whose name says it by its suffix.
    title : str
        Heading in pages, without the unit; by default the name in words.
    short : str
        Heading on a terminal, with the unit; the title by default.
    format : str
        How cells are written, see `cpic_planner.report.words.formatted`: ``.3f``, ``.3g``, ``.2e``, ``%`` (per cent
        without the sign), ``time`` (s, min or h), ``d`` (thin spaces between thousands), ``star`` (names of stars).
        After ``±`` that of the column ``NAME_error``, which stands in the same cell.
    console : bool
        Whether the tables of a terminal show it without being asked by name.
    value : callable, optional
        Returns the value of an entry of a table; null where it has none.
    text : str or callable, optional
        What people see in place of the value: a template of fields of the entry, or a function of it; see
        `cpic_planner.report.document.Table`.
    gives_way : int
        How soon it gives way on a narrow terminal; 0: never; the highest goes first.
    look : str
        Classes of its cells in pages: ``left``, ``wide``, ``star``, ...; with ``row`` the cell heads its row, with
        ``page``, ``terminal`` or ``files`` the column stands there alone.
    files : tuple of Column
        Columns that stand in files for it; by default itself.
    row : (type, callable), optional
        Kind of the row that it is of, and what returns that row of an entry.
    """

    name: str = ""
    dtype: str = ""
    description: str = ""
    unit: str = ""
    title: str = ""
    short: str = ""
    format: str = ""
    console: bool = False
    value: Callable[[Any], Any] | None = None
    text: str | Callable[[Any], Any] | None = None
    gives_way: int = 0
    look: str = ""
    files: tuple[Column, ...] = ()
    row: tuple[type[Result], Callable[[Any], Any]] | None = None

    def __call__(self, schema: dict[str, Any]) -> None:
        """Leave the JSON Schema of the field as it is: `Result` writes label and unit of every column."""

    @property
    def label(self) -> str:
        """Heading in pages, without the unit."""
        suffix = next((suffix for suffix in UNITS if self.name.endswith(f"_{suffix}")), "")
        return self.title or self.name.removesuffix(f"_{suffix}").replace("_", " ")

    @property
    def heading(self) -> str:
        """Heading on a terminal."""
        return self.short or self.title or self.name.replace("_", " ")

    @property
    def right(self) -> bool:
        """Whether cells stand at the right: numbers do."""
        return self.dtype != "string"


def _word(title: str = "", short: str = "", format: str = "", meaning: str = "") -> Column:
    return Column("", "", meaning, "", title, short, format)


_PROBABILITY = (
    "probability that a blind search finds the planet, by the law of simulated images; null where there is no answer"
)
_KNOWN_PLACE = _word("at its place", "place %", "%", "the same for a look at the planet's known place")
VOCABULARY: Mapping[str, Column] = {
    "hip": _word("HIP", meaning="Hipparcos number"),
    "v_mag": _word("V", "V mag", ".2f", "Johnson V (Vega), mag"),
    "distance_pc": _word("distance", "dist pc", ".2f", "distance, pc"),
    "band": _word("band", "band"),
    "status": _word("status", "status"),
    "separation_arcsec": _word("separation", "sep ″", ".3f", "projected separation of the planet, arcsec"),
    "contrast": _word("contrast", "contrast", ".2e", "true planet-to-star ratio of detected rates in the band"),
    "contrast_limit": _word("contrast limit", "limit", ".2e", "faintest contrast detected there by this observation"),
    "snr": _word("SNR", "SNR", ".3g", "photometric SNR of the stack, with the planet's own noise"),
    "significance": _word("significance", "signif", ".3g", "predicted S / sigma without the planet"),
    "threshold": _word("threshold", "thresh", ".3g", "small-sample detection threshold for significance"),
    "detection_margin": _word("margin", "margin", ".3g", "significance / threshold"),
    "exposure_s": _word("exposure", "exposure s", ".3g", "frame exposure, s"),
    "n_frames": _word("frames", "frames", "", "science frames of all visits"),
    "frames_per_visit": _word("frames of a visit", "each", "", "science frames of a visit"),
    "visits": _word("visits", "visits", "", "science visits that are reduced together, each with its own wavefront"),
    "reference_visits": _word("reference visits", "refs", "", "visits that the reference frames are spread over"),
    "visit_time_s": _word("time of a visit", "visit", "time", "wall time of a visit with its references, s"),
    "n_modes": _word("modes", "modes", "", "modes of the library that the subtraction projects out"),
    "span_days": _word(
        "span",
        "span d",
        ".3g",
        "from the start of the first visit to the end of the last, d: the Earth hides the star for 54 % of it",
    ),
    "orbits_searched": _word(
        "orbits searched",
        "orbits",
        "d",
        "orbits that a blind search goes through in the span, 1 where the planet stays within 0.3 lambda/D of its "
        "place; null where the place is known: the orbit is followed",
    ),
    "motion_factor": _word(
        "threshold for the orbits",
        "× thresh",
        ".3f",
        "factor by which a blind search asks for more significance because the planet may move: the false alarms of "
        "the orbits, and light that the nearest of them misses; 1 where the orbit is followed",
    ),
    "independent_visits": _word(
        "independent visits",
        "indep",
        ".3g",
        "number of independent wavefronts whose mean is as steady as that of the science visits: fewer than the visits "
        "where their wavefronts remember each other (drift.correlation_time_h)",
    ),
    "required_visits": _word(
        meaning="least number of visits of this length that makes the planet detected; null where none does"
    ),
    "required_time_s": _word(
        "time for a detection",
        "",
        "time",
        "least wall time of as many visits that makes the planet detected; null where none does",
    ),
    "required_drift_factor": _word(
        meaning="largest factor on the drift, common part and walk included, that makes the planet detected in these "
        "frames; null where none does"
    ),
    "required_contrast_factor": _word(
        meaning="least factor on the contrast that makes the planet detected in these frames; null where none does"
    ),
    "em_gain": _word("EM gain", "gain", ".3g", "EM gain"),
    "integration_s": _word("time on source", "on source", "time", "time on source of all visits, s"),
    "time_s": _word("wall time", "wall", "time", "wall time of all visits: readouts, reference frames, overheads, s"),
    "unused_s": _word("time left unused", "unused", "time", "part of the given wall time that is left; null without"),
    "completeness": _word("completeness", "compl %", "%"),
    "completeness_known_place": _word("completeness at known places", "known %", "%"),
    "verdict": _word(
        meaning="of the planet: detected (half of such programmes show it, looked for as verdict_mode says), "
        "measured_not_detected, or unreachable (every status but ok); null for a contrast limit, which is about no "
        "planet, and in older results"
    ),
    "verdict_mode": _word(
        meaning="how the planet is looked for: blind, by a search that knows no place, or at a known_place; detected "
        "where half of such programmes show it; null without a verdict"
    ),
    "detection_probability": _word("found blind", "blind %", "%", _PROBABILITY),
    "predicted_detection_probability": _word(meaning=_PROBABILITY),
    "detection_probability_known_place": _KNOWN_PLACE,
    "predicted_detection_probability_known_place": _KNOWN_PLACE,
    "limited_by": _word(
        meaning="single change that would make the planet detected in the given time: speckles (no drift of the "
        "wavefront), common_speckles (the same, where no number of visits helps), background (no light and no noise "
        "but the planet's own and the speckles), photons (neither is enough: the planet is too faint); motion: it "
        "is detected if it stands still, but not by a search that goes through orbits; visibility: the star is not "
        "seen for so long; geometry: outside the dark hole; "
        "saturation: no frame is possible; none: detected; null where there is no verdict"
    ),
    "exposure_limited_by": _word(meaning="limit that binds the exposure; empty: the optimum"),
    "gain_limited_by": _word(meaning="limit that binds the EM gain; empty: the optimum"),
    "gain_caps": _word(meaning="largest EM gains by what they spare: hole, register_tail, frame"),
    "dominant": _word("largest noise", "largest noise", meaning="largest term of the variance"),
    "remedies": _word(meaning="factors of SNR if one thing is changed"),
    "config_hash": _word(meaning="hash of everything that decides the numbers"),
    "fingerprint": _word(meaning="hashes of code, presets, catalogue, libraries, processor; empty in older results"),
    "catalogue": _word(meaning="what the star table is, its vintage or file name, and its checksum"),
}
"""Columns that mean the same in every row, by the names of their fields."""


def column(
    meaning: str = "",
    *,
    label: str = "",
    short: str = "",
    unit: str = "",
    format: str = "",
    console: bool = False,
    default: Any = PydanticUndefined,
) -> Any:
    """Return a field of a row with what tables need of it.

    Parameters
    ----------
    meaning : str
        Description in schemas and files.
    label, short, unit, format, console
        As `Column`; what is empty comes from `VOCABULARY`, if the name of the field stands there.
    default : optional
        Value of rows that do not give one.

    Returns
    -------
    FieldInfo
    """
    own = Column("", "", meaning, unit, label, short, format, console)
    return Field(default=default, description=meaning or None, json_schema_extra=own)


def optional(meaning: str = "", **look: Any) -> Any:
    """Return a `column` that is null where nothing is given; ``look`` as there: label, short, unit, format."""
    return column(meaning, default=None, **look)


class OfTables(Document):
    """Base of results of questions that tables of a user's own can be part of."""

    config_hash: str
    notes: list[str] = column(
        "remarks on the reading of tables of your own: columns that are not used, rows that are left out; empty for "
        "shipped tables and in older results",
        default=[],
    )


class StarRow(Row):
    """Base of rows on one star."""

    name: str = column("name of the star in the catalogue", label="star", format="star")


class FramesColumns(Row):
    """Columns of visits and their frames; null where there are none, and in older results."""

    exposure_s: float | None = None
    n_frames: int | None = None
    em_gain: float | None = None
    integration_s: float | None = None
    time_s: float | None = None
    unused_s: float | None = None
    visits: int | None = None
    reference_visits: int | None = None


class ProgrammeColumns(FramesColumns):
    """Columns of the programme that answers a question; null where there is none, and in older results."""

    visit_time_s: float | None = None
    frames_per_visit: int | None = None
    independent_visits: float | None = None
    span_days: float | None = None
    orbits_searched: int | None = None
    motion_factor: float | None = None


class VerdictColumns(Row):
    """Columns of the verdict on a planet, and of what would change it; null without one, and in older results."""

    verdict: VerdictText | None = None
    verdict_mode: DetectionMode | None = None
    detection_probability: float | None = None
    detection_probability_known_place: float | None = None
    limited_by: LimitText | None = None
    required_visits: int | None = None
    required_drift_factor: float | None = None
    required_contrast_factor: float | None = None


class LimitColumns(Row):
    """Columns of what binds the setting of the frames, and of its noise; empty where there is none."""

    exposure_limited_by: str = ""
    gain_limited_by: str = ""
    gain_caps: dict[str, float] = column(default={})
    budget: dict[str, float] = column(
        "terms of the variance, electrons^2; of answers also the signal, electrons", default={}
    )
    dominant: str = ""
    remedies: dict[str, float] = column(default={})


class ReferencePlanetRecord(Result):
    """The planet that ranked numbers refer to."""

    radius_rjup: float = column("radius in Jupiter equatorial radii (71 492 km)")
    phase_deg: float = column("star-planet-observer phase angle")
    albedo: str = column("what reflects the light: a measured planet, or a model and its parameters")
    position: str = column("where in the dark hole", default="on the diagonal of a quadrant")


class SampleResult(Document):
    """Base of results on stars of a catalogue, whose numbers refer to one reference planet."""

    time_s: float = column("wall time per target and band, s")
    reference_planet: ReferencePlanetRecord
    catalogue: str
    date_utc: str = column("date of the places of stars and companions; empty in older results", default="")


class RankedSample(SampleResult):
    """Base of results on the stars of a ranking."""

    sample: str = column("which rows of the catalogue are returned")
    n_in_catalogue: int | None = optional("stars of the sample before the filters; null in older results")
    counts: dict[str, int] = column("stars by status or reason")
    counts_limited_by: dict[str, int] = column("stars by limited_by; empty in older results", default={})


class StarHeader(Document):
    """Base of results on one star."""

    hip: int | None
    v_mag: float
    distance_pc: float
    catalogue: str
    date_utc: str = column("date of the places of stars and companions; empty in older results", default="")
    note: str = column("on the name that was given; empty for none")


class OfTarget(OfTables):
    """Base of results on one target, which stands in front of what `StarHeader` says of its star."""

    target: str


def unit_of(name: str) -> str:
    """Return the unit that the suffix of a name states; empty where it states none."""
    return next((unit for suffix, unit in UNITS.items() if name.endswith(f"_{suffix}")), "")


@cache
def columns_of(row: type[Result]) -> tuple[Column, ...]:
    """Return the columns of a kind of row, in order; fields that hold other rows are left out."""
    found = (column_of(row, name) for name in _in_order(row))
    return tuple(item for item in found if item.dtype)


def _in_order(row: type[Result]) -> list[str]:
    """Return the names of the fields of a kind of row in the order of their columns."""
    first, _, last = (part.split() for part in row.column_order.partition("..."))
    return [*first, *(name for name in row.model_fields if name not in (*first, *last)), *last]


def column_of(row: type[BaseModel], name: str) -> Column:
    """Return one column of a kind of row; its ``dtype`` is empty where the field holds other rows."""
    found = described(name, row.model_fields[name])
    return replace(found, unit="" if found.dtype in ("string", "bool") else found.unit)


def described(name: str, field: FieldInfo) -> Column:
    """Return the column that a field states, filled from the vocabulary, with the unit also of texts and lists."""
    known = VOCABULARY.get(name) or _word()
    own = field.json_schema_extra if isinstance(field.json_schema_extra, Column) else _word()
    return Column(
        name,
        _dtype(field.annotation),
        field.description or known.description,
        own.unit or unit_of(name),
        own.title or known.title,
        own.short or own.title or known.short,
        own.format or known.format,
        own.console,
    )


def _dtype(annotation: Any) -> str:
    """Return the type of the cells; empty for what no cell can hold."""
    kinds = [kind for kind in get_args(annotation) if kind is not type(None)]
    origin = get_origin(annotation)
    if origin in (Union, types.UnionType):
        return _dtype(kinds[0]) if len(kinds) == 1 else ""
    if origin is Literal:
        return "string"
    if origin in (list, tuple):
        return "string" if _dtype(kinds[0]) else ""
    plain = {bool: "bool", int: "int64", float: "float64"}
    return plain.get(annotation, "string" if isinstance(annotation, type) and issubclass(annotation, str) else "")


FLAG_SEPARATOR = "|"
"""What stands between the flags of a ranked star in a file."""
OWN = "column of your own table, as it is there"
_FILLED = {"float64": 0.0, "int64": 0, "bool": False}
_MIDDLE = re.compile("_(mean|median)$")


def taken_of(row: type[Result], *paths: str, of: Callable[[Any], Any] = lambda entry: entry) -> list[Column]:
    """Return columns of a kind of row, in order: numbers of records that it holds are columns of their own.

    Parameters
    ----------
    row : type
    *paths : str
        Names of fields, with dots between those of records in records; every field by default. A record of numbers
        alone, such as a mean with its error, gives a column for each: ``NAME`` is the mean or the median, and
        ``NAME_error``, ``NAME_low`` stand beside it.
    of : callable
        Returns the row of an entry.
    """
    found = []
    for path in paths or _in_order(row):
        *outer, name = path.split(".")
        kind, unit = row, ""
        for part in outer:
            unit = column_of(kind, part).unit
            kind = _record(kind, part) or Result
        found += _flat(kind, name, outer, unit, of)
    return found


def _flat(kind: type[Result], name: str, outer: list[str], unit: str, of: Callable[[Any], Any]) -> list[Column]:
    column, path = column_of(kind, name), [*outer, name]
    if column.dtype:
        unit = column.unit or (unit if column.right and column.dtype != "bool" else "")
        return [replace(column, name="_".join(path), unit=unit, value=lambda entry: _at(of(entry), path))]
    record = _record(kind, name)
    parts = () if record is None else columns_of(record)
    if record is None or len(parts) < len(record.model_fields) or not all(part.right for part in parts):
        return []
    held = [item for part in parts for item in _flat(record, part.name, path, column.unit, of)]
    return [
        replace(item, name=_MIDDLE.sub("", item.name), description=said)
        for item, part in zip(held, parts, strict=True)
        for said in ["; ".join(filter(None, (column.description, part.description or part.name.replace("_", " "))))]
    ]


def _record(kind: type[Result], name: str) -> type[Result] | None:
    """Return the kind of the record that a field holds; None where it holds something else."""
    annotation = kind.model_fields[name].annotation
    for held in (annotation, *get_args(annotation)):
        if isinstance(held, type) and issubclass(held, Result):
            return None if get_origin(annotation) in (list, tuple, dict) else held
    return None


def _at(value: Any, path: Sequence[str]) -> Any:
    for name in path:
        value = getattr(value, name, None)
    return value


def own_taken(entries: Sequence[Any]) -> list[Column]:
    """Return the columns of a user's table that rows carry, in the order in which these have them.

    Parameters
    ----------
    entries : sequence
        Rows with a field ``own``.
    """
    names = dict.fromkeys(name for entry in entries for name in entry.own)
    return [
        Column(name, _dtype_of([entry.own.get(name) for entry in entries]), OWN, value=partial(_own_value, name))
        for name in names
    ]


def _own_value(name: str, entry: Any) -> Any:
    return entry.own.get(name)


def _dtype_of(cells: Iterable[Any]) -> str:
    """Return the type of a column with these cells: numbers or truth values if all are."""
    kinds = {type(cell) for cell in cells if cell is not None}
    if kinds == {bool}:
        return "bool"
    return "int64" if kinds == {int} else "float64" if kinds and kinds <= {int, float} else "string"


def values_of(row: Result, *, before: str = "") -> dict[str, Any]:
    """Return the cells of a row by the names of its columns, with ``before`` in front of each name."""
    return {before + column.name: getattr(row, column.name) for column in columns_of(type(row))}


def names_of(row: type[Result], *, before: str = "") -> tuple[str, ...]:
    """Return the names of the columns of a kind of row, with ``before`` in front of each."""
    return tuple(before + column.name for column in columns_of(row))


def rows_of(kind: type[Result]) -> dict[str, type[Result]]:
    """Return the fields of a kind of result that hold rows, and of which kind these are."""
    found = {}
    for name, field in kind.model_fields.items():
        lists = (held for held in (field.annotation, *get_args(field.annotation)) if get_origin(held) in (list, tuple))
        for row in (held for several in lists for held in get_args(several)[:1]):
            if isinstance(row, type) and issubclass(row, Result) and taken_of(row):
                found[name] = row
    return found


def csv_text(names: Sequence[str], rows: Iterable[Mapping[str, Any]], *, joined: str = ";") -> str:
    """Return rows as CSV text: a heading of names, one line a row, units in the names.

    Parameters
    ----------
    names : sequence of str
        Columns, in order.
    rows : iterable of mapping
        Cells by name. Missing and null ones are empty, yes and no are 1 and 0; texts are `cpic_core.guarded`,
        numbers the shortest text that reads back to the same double.
    joined : str
        What stands between the items of a list.
    """

    def cell(value: Any) -> Any:
        plain = "" if value is None else int(value) if isinstance(value, bool) else _joined_text(value, joined)
        return guarded(plain) if isinstance(plain, str) else plain

    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(map(guarded, names))
    writer.writerows([cell(row.get(name)) for name in names] for row in rows)
    return buffer.getvalue()


def rows_from_csv(row: type[R], text: str, *, joined: str = ";") -> list[R]:
    """Return the rows that `csv_text` or `ecsv_text` wrote; columns that the kind of row does not have are left out.

    Parameters
    ----------
    row : type
        Kind of the rows.
    text : str
        With a heading of names; lines that begin with # in front of it are comments.
    joined : str
        What stands between the items of a list.

    Raises
    ------
    InputError
        For a column that is missing, or a cell that is none of its column.
    """
    from simulator.config import validate

    while text.startswith("#"):
        text = text.partition("\n")[2]
    return [
        validate(
            row, {name: _read(row, name, cell, joined) for name, cell in cells.items() if name in row.model_fields}
        )
        for cells in csv.DictReader(io.StringIO(text, newline=""), restkey="")
    ]


def _read(row: type[Result], name: str, cell: str | None, joined: str) -> Any:
    kind, cell = row.model_fields[name].annotation, unguarded(cell or "")
    if get_origin(kind) in (list, tuple):
        return [item for item in cell.split(joined) if item]
    return None if not cell and type(None) in get_args(kind) else cell


def _joined_text(value: Any, joined: str) -> Any:
    return joined.join(str(item) for item in value) if isinstance(value, (list, tuple)) else value


def _filled(column: Column, entries: Sequence[Any]) -> tuple[list[Any], list[bool]]:
    """Return the cells of a column without nulls, and which of them were null; texts that are null are empty."""
    assert column.value is not None
    cells = [column.value(entry) for entry in entries]
    missing = [cell is None for cell in cells]
    dtype = column.dtype
    if dtype == "string":
        return ["" if cell is None else str(_joined_text(cell, FLAG_SEPARATOR)) for cell in cells], [False] * len(cells)
    return [_FILLED[dtype] if cell is None else cell for cell in cells], missing


def astropy_table(
    columns: Sequence[Column], entries: Sequence[Any], meta: Mapping[str, Any], *, text: Callable[[str], str] = str
) -> Table:
    """Return a table of astropy with unit and meaning of every column; missing numbers are masked.

    Parameters
    ----------
    columns : sequence of Column
    entries : sequence
        Rows, or what the columns take values from.
    meta : mapping
        Of the table; plain values.
    text : callable
        Returns a text as the table has it.
    """
    import numpy as np
    from astropy.table import Column as PlainColumn, MaskedColumn, Table

    table = Table(meta=dict(meta))
    for column in columns:
        about = {"name": text(column.name), "unit": column.unit or None, "description": column.description or None}
        cells, missing = _filled(column, entries)
        texts = column.dtype == "string"
        values = np.array(list(map(text, cells)) if texts else cells, dtype=str if texts else column.dtype)
        masked = any(missing)
        table[about["name"]] = MaskedColumn(values, mask=missing, **about) if masked else PlainColumn(values, **about)
    return table


def ecsv_text(columns: Sequence[Column], entries: Sequence[Any], meta: Mapping[str, Any]) -> str:
    """Return rows as ECSV 1.0: unit and meaning of every column, and what the table is, in the header.

    Parameters
    ----------
    columns, entries, meta
        As of `astropy_table`.

    Notes
    -----
    Reads back with ``astropy.table.Table.read(..., format="ascii.ecsv")``; missing numbers are masked, and texts that
    begin like a formula keep the apostrophe of `cpic_core.guarded`.
    """
    buffer = io.StringIO()
    table = astropy_table(columns, entries, meta, text=guarded)
    table.write(buffer, format="ascii.ecsv", delimiter=",")
    return buffer.getvalue()


def data_frame(columns: Sequence[Column], entries: Sequence[Any]) -> pd.DataFrame:
    """Return rows as a pandas frame, units in the names; missing numbers are NaN or, of whole ones, ``pandas.NA``.

    Parameters
    ----------
    columns, entries
        As of `astropy_table`.
    """
    import pandas as pd

    series = {}
    for column in columns:
        cells, missing = _filled(column, entries)
        dtype = "object" if column.dtype == "string" else column.dtype
        if any(missing) and dtype != "float64":
            dtype = {"int64": "Int64", "bool": "boolean"}[dtype]
        known = [None if gone else cell for cell, gone in zip(cells, missing, strict=True)]
        series[column.name] = pd.Series(known, dtype=dtype)
    return pd.DataFrame(series)


def parquet_bytes(columns: Sequence[Column], entries: Sequence[Any]) -> bytes:
    """Return rows as a Parquet file, without nulls: unit and meaning of every column stand in its metadata.

    Parameters
    ----------
    columns, entries
        As of `astropy_table`.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    cells = [_filled(column, entries)[0] for column in columns]
    sink = io.BytesIO()
    pq.write_table(pa.table(cells, schema=arrow_schema(columns)), sink)
    return sink.getvalue()


def arrow_schema(columns: Sequence[Column]) -> Any:
    """Return the Arrow schema of columns without nulls: types, and unit and meaning of each column."""
    import pyarrow as pa

    return pa.schema(
        [
            pa.field(
                column.name,
                pa.string() if column.dtype == "string" else pa.from_numpy_dtype(column.dtype),
                nullable=False,
                metadata={"unit": column.unit, "description": column.description},
            )
            for column in columns
        ]
    )
