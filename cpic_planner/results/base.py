"""Base classes of results and their rows: what a column is called, its unit, and how its numbers are written.

A field of a `cpic_planner.results.base.Row` is a column of every table that shows such rows. What a column is called
and how its numbers are written stands beside the field (`column`); words that mean the same in every row stand in
`VOCABULARY`, by the name of the field. The unit follows from the suffix of the name unless the field states another.
"""

import math
import types
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, Self, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, GetJsonSchemaHandler
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, PydanticUndefined

from cpic_planner.results.tabular import Tabular

StatusText = Literal["ok", "unreachable", "saturated", "outside_field", "invalid"]
VerdictText = Literal["detected", "measured_not_detected", "unreachable"]
DetectionMode = Literal["blind", "known_place"]
LimitText = Literal[
    "geometry",
    "photons",
    "background",
    "speckles",
    "common_speckles",
    "saturation",
    "motion",
    "visibility",
    "none",
]


_ABSENT = object()


class Result(Tabular, BaseModel):
    """Base of results: immutable, unknown keys refused, NaN and inf refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Write meaning, label and unit of every field into its JSON Schema; see `cpic_planner.results.base`."""
        schema = handler(core_schema)
        properties = handler.resolve_ref_schema(schema).get("properties", {})
        for name, part in properties.items():
            look = described(name, cls.model_fields[name])
            said = {"title": look.label, "unit": look.unit, "description": look.meaning}
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


def _plain(value: Any, at: int | None, annotation: Any) -> Any:
    if hasattr(value, "tolist"):
        value = (value if at is None else value[at]).tolist()
    if isinstance(value, float) and not math.isfinite(value) and type(None) in get_args(annotation):
        return None
    return value


class Row(Result):
    """Base of rows: every field is a column of the tables that show it."""


class RunResult(Result):
    """Base of results, which say what made them."""

    fingerprint: str = ""


class OfTables(Result):
    """Base of results of questions that tables of a user's own can be part of."""

    notes: list[str] = Field(
        default_factory=list,
        description="remarks on the reading of tables of your own: columns that are not used, rows that are left out; "
        "empty for shipped tables and in older results",
    )


UNITS = {
    "per_hour": "1/h",
    "deg_s": "deg/s",
    "m_s": "m/s",
    "arcsec": "arcsec",
    "days": "d",
    "bytes": "byte",
    "mjup": "M_jup",
}
UNITS |= {"rjup": "R_jup", "lsun": "solLum", "mag": "mag", "deg": "deg", "mb": "Mbyte", "gb": "Gbyte", "pc": "pc"}
UNITS |= {"au": "AU", "nm": "nm", "km": "km", "s": "s", "h": "h"}
"""Unit of a number by the last words of its name, as astropy reads it; longer suffixes stand first."""


@dataclass(frozen=True)
class Look:
    """The way in which a column is shown to people.

    Attributes
    ----------
    label : str
        Heading in pages, without the unit; by default the name in words.
    short : str
        Heading on a terminal, with the unit; the label by default.
    format : str
        How cells are written, see `cpic_planner.report.words.formatted`: ``.3f``, ``.3g``, ``.2e``, ``%`` (per cent
        without the sign), ``time`` (s, min or h), ``d`` (thin spaces between thousands), ``star`` (names of stars).
        After ``±`` that of the column ``NAME_error``, which stands in the same cell.
    meaning : str
        Description of the column where the field states none.
    unit : str, optional
        Unit, where the suffix of the name does not say it; empty for none.
    console : bool
        Whether the tables of a terminal show it without being asked by name.
    """

    label: str = ""
    short: str = ""
    format: str = ""
    meaning: str = ""
    unit: str | None = None
    console: bool = False

    def __call__(self, schema: dict[str, Any]) -> None:
        """Leave the JSON Schema of the field as it is: `Row` writes label and unit of every column."""


_PROBABILITY = (
    "probability that a blind search finds the planet, by the law of simulated images; null where there is no answer"
)
_KNOWN_PLACE = Look("at its place", "place %", "%", "the same for a look at the planet's known place")
VOCABULARY: Mapping[str, Look] = {
    "hip": Look("HIP", meaning="Hipparcos number"),
    "v_mag": Look("V", "V mag", ".2f", "Johnson V (Vega), mag"),
    "distance_pc": Look("distance", "dist pc", ".2f", "distance, pc"),
    "band": Look("band", "band"),
    "status": Look("status", "status"),
    "separation_arcsec": Look("separation", "sep ″", ".3f", "projected separation of the planet, arcsec"),
    "contrast": Look("contrast", "contrast", ".2e", "true planet-to-star ratio of detected rates in the band"),
    "contrast_limit": Look("contrast limit", "limit", ".2e", "faintest contrast detected there by this observation"),
    "snr": Look("SNR", "SNR", ".3g", "photometric SNR of the stack, with the planet's own noise"),
    "significance": Look("significance", "signif", ".3g", "predicted S / sigma without the planet"),
    "threshold": Look("threshold", "thresh", ".3g", "small-sample detection threshold for significance"),
    "detection_margin": Look("margin", "margin", ".3g", "significance / threshold"),
    "exposure_s": Look("exposure", "exposure s", ".3g", "frame exposure, s"),
    "n_frames": Look("frames", "frames", "", "science frames of all visits"),
    "frames_per_visit": Look("frames of a visit", "each", "", "science frames of a visit"),
    "visits": Look("visits", "visits", "", "science visits that are reduced together, each with its own wavefront"),
    "reference_visits": Look("reference visits", "refs", "", "visits that the reference frames are spread over"),
    "visit_time_s": Look("time of a visit", "visit", "time", "wall time of a visit with its references, s"),
    "n_modes": Look("modes", "modes", "", "modes of the library that the subtraction projects out"),
    "span_days": Look(
        "span",
        "span d",
        ".3g",
        "from the start of the first visit to the end of the last, d: the Earth hides the star for 54 % of it",
    ),
    "orbits_searched": Look(
        "orbits searched",
        "orbits",
        "d",
        "orbits that a blind search goes through in the span, 1 where the planet stays within 0.3 lambda/D of its "
        "place; null where the place is known: the orbit is followed",
    ),
    "motion_factor": Look(
        "threshold for the orbits",
        "× thresh",
        ".3f",
        "factor by which a blind search asks for more significance because the planet may move: the false alarms of "
        "the orbits, and light that the nearest of them misses; 1 where the orbit is followed",
    ),
    "independent_visits": Look(
        "independent visits",
        "indep",
        ".3g",
        "number of independent wavefronts whose mean is as steady as that of the science visits: fewer than the visits "
        "where their wavefronts remember each other (drift.correlation_time_h)",
    ),
    "required_visits": Look(
        meaning="least number of visits of this length that makes the planet detected; null where none does"
    ),
    "required_time_s": Look(
        "time for a detection",
        "",
        "time",
        "least wall time of as many visits that makes the planet detected; null where none does",
    ),
    "required_drift_factor": Look(
        meaning="largest factor on the drift, common part and walk included, that makes the planet detected in these "
        "frames; null where none does"
    ),
    "required_contrast_factor": Look(
        meaning="least factor on the contrast that makes the planet detected in these frames; null where none does"
    ),
    "em_gain": Look("EM gain", "gain", ".3g", "EM gain"),
    "integration_s": Look("time on source", "on source", "time", "time on source of all visits, s"),
    "time_s": Look("wall time", "wall", "time", "wall time of all visits: readouts, reference frames, overheads, s"),
    "unused_s": Look("time left unused", "unused", "time", "part of the given wall time that is left; null without"),
    "completeness": Look("completeness", "compl %", "%"),
    "completeness_known_place": Look("completeness at known places", "known %", "%"),
    "verdict": Look(
        meaning="of the planet: detected (half of such programmes show it, looked for as verdict_mode says), "
        "measured_not_detected, or unreachable (every status but ok); null for a contrast limit, which is about no "
        "planet, and in older results"
    ),
    "verdict_mode": Look(
        meaning="how the planet is looked for: blind, by a search that knows no place, or at a known_place; detected "
        "where half of such programmes show it; null without a verdict"
    ),
    "detection_probability": Look("found blind", "blind %", "%", _PROBABILITY),
    "predicted_detection_probability": Look(meaning=_PROBABILITY),
    "detection_probability_known_place": _KNOWN_PLACE,
    "predicted_detection_probability_known_place": _KNOWN_PLACE,
    "limited_by": Look(
        meaning="single change that would make the planet detected in the given time: speckles (no drift of the "
        "wavefront), common_speckles (the same, where no number of visits helps), background (no light and no noise "
        "but the planet's own and the speckles), photons (neither is enough: the planet is too faint); motion: it "
        "is detected if it stands still, but not by a search that goes through orbits; visibility: the star is not "
        "seen for so long; geometry: outside the dark hole; "
        "saturation: no frame is possible; none: detected; null where there is no verdict"
    ),
    "exposure_limited_by": Look(meaning="limit that binds the exposure; empty: the optimum"),
    "gain_limited_by": Look(meaning="limit that binds the EM gain; empty: the optimum"),
    "gain_caps": Look(meaning="largest EM gains by what they spare: hole, register_tail, frame"),
    "dominant": Look("largest noise", "largest noise", meaning="largest term of the variance"),
    "remedies": Look(meaning="factors of SNR if one thing is changed"),
    "config_hash": Look(meaning="hash of everything that decides the numbers"),
    "fingerprint": Look(meaning="hashes of code, presets, catalogue, libraries, processor; empty in older results"),
    "catalogue": Look(meaning="what the star table is, its vintage or file name, and its checksum"),
}
"""Looks of fields that mean the same in every row, by name."""


@dataclass(frozen=True)
class Column:
    """One column of a table: numpy ``dtype`` (or ``string``), what it is, its unit (empty for none), and its look."""

    name: str
    dtype: str
    description: str
    unit: str = ""
    look: Look = Look()

    @property
    def label(self) -> str:
        """Heading in pages, without the unit."""
        unit = next((suffix for suffix in UNITS if self.name.endswith(f"_{suffix}")), "")
        return self.look.label or self.name.removesuffix(f"_{unit}").replace("_", " ")

    @property
    def heading(self) -> str:
        """Heading on a terminal."""
        return self.look.short or self.look.label or self.name.replace("_", " ")

    @property
    def right(self) -> bool:
        """Whether cells stand at the right: numbers do."""
        return self.dtype != "string"


def column(
    meaning: str = "",
    *,
    label: str = "",
    short: str = "",
    unit: str | None = None,
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
        As `Look`; what is empty comes from `VOCABULARY`, if the name of the field stands there.
    default : optional
        Value of rows that do not give one.

    Returns
    -------
    FieldInfo
    """
    look = Look(label, short, format, meaning, unit, console)
    return Field(default=default, description=meaning or None, json_schema_extra=look)


def optional(meaning: str = "", **look: Any) -> Any:
    """Return a `column` that is null where nothing is given; ``look`` as there: label, short, unit, format."""
    return column(meaning, default=None, **look)


class ProgrammeColumns(Row):
    """Columns of the programme that answers a question; null where there is none, and in older results."""

    exposure_s: float | None = None
    n_frames: int | None = None
    em_gain: float | None = None
    integration_s: float | None = None
    time_s: float | None = None
    unused_s: float | None = None
    visits: int | None = None
    reference_visits: int | None = None
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


def unit_of(name: str) -> str:
    """Return the unit that the suffix of a name states; empty where it states none."""
    return next((unit for suffix, unit in UNITS.items() if name.endswith(f"_{suffix}")), "")


@cache
def columns_of(row: type[BaseModel]) -> tuple[Column, ...]:
    """Return the columns of a kind of row in the order of its fields; fields that hold other rows are left out."""
    found = (column_of(row, name) for name in row.model_fields)
    return tuple(item for item in found if item.dtype)


def column_of(row: type[BaseModel], name: str) -> Column:
    """Return one column of a kind of row; its ``dtype`` is empty where the field holds other rows."""
    field = row.model_fields[name]
    look, dtype = described(name, field), _dtype(field.annotation)
    return Column(name, dtype, look.meaning, "" if dtype in ("string", "bool") else look.unit or "", look)


def described(name: str, field: FieldInfo) -> Look:
    """Return the look of a field: its own, filled from the vocabulary."""
    given, known = field.json_schema_extra, VOCABULARY.get(name, Look())
    own = given if isinstance(given, Look) else Look()
    return Look(
        label=own.label or known.label,
        short=own.short or own.label or known.short,
        format=own.format or known.format,
        meaning=field.description or known.meaning,
        unit=next((unit for unit in (own.unit, known.unit) if unit is not None), unit_of(name)),
        console=own.console,
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


class ReferencePlanetRecord(Result):
    """The planet that ranked numbers refer to."""

    radius_rjup: float = Field(description="radius in Jupiter equatorial radii (71 492 km)")
    phase_deg: float = Field(description="star-planet-observer phase angle")
    albedo: str = Field(description="what reflects the light: a measured planet, or a model and its parameters")
    position: str = Field(default="on the diagonal of a quadrant", description="where in the dark hole")
