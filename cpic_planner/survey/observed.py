"""The table of planned visits as an observatory gives it back, and what visits leave of the planets that may be there.

``visits.csv`` (`cpic_planner.results.PlannedVisitRow`) is plan and observation log in one: a line whose last columns
are filled was observed, the others are still to be made.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from catalogs import (
    Column,
    Columns,
    RawTable,
    Rows,
    TableBytes,
    column_of,
    parse_table,
    read_bytes,
    read_rows,
    star_key,
)
from cpic_core import BoolArray, FloatArray, InputError, Record, parse_json
from cpic_planner.etc import EtcModel
from cpic_planner.results import PlannedVisitRow, columns_of
from cpic_planner.survey.calendar import sun_position_angle_deg
from cpic_planner.survey.detection import Setting, detection_chance, expected_signals
from cpic_planner.survey.strategy import DetectionRule
from cpic_planner.survey.universe import NEW, PlanetSample
from cpic_planner.targets import Targets
from simulator.config import AlbedoSpec, checked_utc
from simulator.products import mjd_of

_KINDS = {"float64": "float", "int64": "whole", "bool": "bool", "string": "text"}
_ALIASES = {
    "star": "target object name",
    "start_utc": "date utc dateobs begin",
    "band": "filter",
    "exposure_s": "exposure exptime",
    "frames_per_visit": "nframes frames",
    "em_gain": "gain emgain",
    "telescope_h": "hours telescopehours",
    "roll_deg": "roll",
    "planets": "detections found",
}
"""What else people call the columns of their logs."""
_FRAMES = (("star",), ("band",), ("exposure_s",), ("frames_per_visit",), ("em_gain",))
_OBSERVED = (*_FRAMES[:1], ("start_utc",), *_FRAMES[1:])
OUTCOMES = ("detected", "not_detected", "lost")


def _columns() -> Columns:
    """Return the columns of `PlannedVisitRow` with the ranges that a file may hold."""
    made = []
    for item in columns_of(PlannedVisitRow):
        limits = PlannedVisitRow.model_fields[item.name].metadata
        low, high = (
            next((getattr(limit, end) for limit in limits if hasattr(limit, end)), 0.0) for end in ("ge", "le")
        )
        kind = "int" if item.name == "hip" else _KINDS[item.dtype]
        made.append(
            Column(item.name, item.description, kind, item.unit, _ALIASES.get(item.name, ""), float(low), float(high))
        )
    return Columns(*made)


COLUMNS = _columns()
"""Columns of a table of visits; star, band, exposure_s, frames_per_visit and em_gain are needed."""


class ObservedVisit(Record):
    """One visit that was made.

    ``roll_deg`` is nan where the log does not say, ``where`` names file and row; the frames of a ``lost`` visit say
    nothing.
    """

    star: str
    mjd: float
    setting: Setting
    telescope_h: float
    roll_deg: float
    planets: int
    where: str = ""
    lost: bool = False


class ObservationLog(Record):
    """Visits that were made, in the order of time, and what the file is."""

    visits: tuple[ObservedVisit, ...]
    provenance: str

    def of(self, star: str) -> tuple[ObservedVisit, ...]:
        """Return the visits of a star, by any of its names, without those that were lost."""
        key = star_key(star)
        return tuple(visit for visit in self.visits if star_key(visit.star) == key and not visit.lost)

    @property
    def until_mjd(self) -> float:
        """When the last visit began."""
        return self.visits[-1].mjd

    @property
    def hours(self) -> float:
        """Telescope time of all visits."""
        return sum(visit.telescope_h for visit in self.visits)


class ScheduledVisit(Record):
    """One visit that is still to be made: line ``row`` of the file.

    ``mjd`` is the middle of its window, nan where the file gives none, as ``roll_deg``.
    """

    star: str
    setting: Setting
    visits: int
    reference_library: str
    roll_deg: float
    mjd: float
    reserve: bool
    row: int


def read_log(source: str | Path, strategies: Collection[str] = ()) -> ObservationLog:
    """Read what was observed: the lines of a table of visits that have an outcome.

    Parameters
    ----------
    source : str or Path
        CSV, ECSV, JSON, VOTable or FITS with the columns of `COLUMNS`. A log without the columns ``outcome`` and
        ``planets`` has visits that showed nothing.
    strategies : collection of str
        Names of strategies: where lines of several have an outcome, those of the one that is among them count.

    Raises
    ------
    InputError
        Naming file, row, column, value, unit and range of the first fault; if no line has an outcome, or those of
        several strategies have.
    """
    file = read_bytes(source, key="observed", presets="")
    table = read_rows(_raw_table(file), COLUMNS, _OBSERVED, about="star")
    told = {"outcome", "planets"} & set(table.headings)
    made = [(where, row) for where, row in table if {"start_utc", "outcome", "planets"} & set(row)]
    if not made:
        allowed = "at least one line with start_utc and outcome"
        raise InputError("observed", file.name, allowed=allowed, hint=f"none of its {len(table.rows)} lines has them")
    kept = _of_one_strategy(made, file.name, "observed", strategies)
    visits = [_observed(table, where, row, bool(told)) for where, row in kept]
    visits.sort(key=lambda visit: (visit.mjd, visit.star))
    hours, planets = sum(visit.telescope_h for visit in visits), sum(visit.planets for visit in visits)
    lost = sum(visit.lost for visit in visits)
    text = f"{len(visits)} visits, {f'{lost} of them lost, ' * bool(lost)}{hours:g} h, {planets} planets"
    return ObservationLog(tuple(visits), f"{text} ({file.name} {file.sha256[:12]})")


def read_schedule(source: str | Path, strategy: str | None = None) -> tuple[tuple[ScheduledVisit, ...], str]:
    """Read what is still to be made: the lines of a table of visits that have no outcome.

    Parameters
    ----------
    source : str or Path
        As of `read_log`.
    strategy : str, optional
        Which strategy's visits; needed where the table has several.

    Returns
    -------
    visits : tuple of ScheduledVisit
        In the order of the file.
    provenance : str
        What the file is.

    Raises
    ------
    InputError
        As of `read_log`, and if every line has an outcome.
    """
    file = read_bytes(source, key="schedule", presets="")
    table = read_rows(_raw_table(file), COLUMNS, _FRAMES, about="star")
    named = [row["strategy"] for row in table.rows if "strategy" in row]
    if strategy is not None and strategy not in named:
        known = ", ".join(dict.fromkeys(named)) or "no strategy: the file names none"
        raise InputError("schedule_strategy", strategy, allowed=known)
    chosen = () if strategy is None else (strategy,)
    lines = _of_one_strategy(list(table), file.name, "schedule", chosen)
    left = [(where, row) for where, row in lines if not {"start_utc", "outcome", "planets"} & set(row)]
    if not left:
        raise InputError("schedule", file.name, allowed="lines without an outcome", hint="all were observed")
    name = next((row["strategy"] for _, row in left if "strategy" in row), "")
    about = f"{len(left)} visits{f' of {name}' * bool(name)} ({file.name} {file.sha256[:12]})"
    number = {id(row): i for i, row in enumerate(table.rows, start=1)}
    return tuple(_scheduled(table, where, row, number[id(row)]) for where, row in left), about


def _raw_table(file: TableBytes) -> RawTable:
    """Return the table as it is written; JSON as ``visits.json`` has it."""
    if not file.data.lstrip().startswith(b"{"):
        return parse_table(file)
    allowed = "JSON with a list of visits, as cpic whatif writes it"
    try:
        rows = parse_json(file.data)["visits"]
        names = list(dict.fromkeys(name for row in rows for name in dict(row)))
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(file.name, "not a table of visits", allowed=allowed, hint=type(error).__name__) from None
    if not names:
        raise InputError(file.name, "no rows", allowed=allowed)
    return RawTable(file.name, [column_of(name, "", [row.get(name) for row in rows]) for name in names])


_Line = tuple[str, dict[str, Any]]


def _of_one_strategy(lines: Sequence[_Line], file: str, key: str, wanted: Collection[str]) -> list[_Line]:
    """Return the lines of one strategy, and those nobody planned; a varied strategy goes by its earlier name."""
    found = list(dict.fromkeys(row["strategy"] for _, row in lines if "strategy" in row))
    mine = found
    if wanted and (key == "schedule" or len(found) > 1):
        mine = [name for name in found if any(item == name or item.startswith(f"{name} ") for item in wanted)]
    if len(found) > 1 and len(mine) != 1:
        hint = f"it has those of {', '.join(found)}: choose one with --strategy"
        raise InputError(key, file, allowed="visits of one strategy", hint=hint)
    return [(where, row) for where, row in lines if row.get("strategy") in (None, *mine)]


def _setting(table: Rows, where: str, row: dict[str, Any]) -> tuple[Setting, int]:
    """Return the frames of a line, and how many visits are reduced together."""
    table.refuse_missing(where, row, _FRAMES)
    visits, frames = int(row.get("visits", 1)), row["frames_per_visit"]
    time_s = row.get("time_s") or 2.0 * row["exposure_s"] * frames * visits
    return Setting(str(row["band"]), row["exposure_s"], frames, row["em_gain"], time_s), visits


def _observed(table: Rows, where: str, row: dict[str, Any], told: bool) -> ObservedVisit:
    table.refuse_missing(where, row, _OBSERVED)
    utc = checked_utc(f"{where} column start_utc", row["start_utc"])
    outcome, planets = row.get("outcome"), row.get("planets")
    if outcome is not None:
        word = str(outcome).lower().replace(" ", "_").replace("-", "_")
        if word not in OUTCOMES:
            raise InputError(f"{where} column outcome", outcome, allowed=f"{', '.join(OUTCOMES)}, or empty")
        planets = (word == "detected") if planets is None else planets
        if (planets > 0) != (word == "detected"):
            allowed = "1 or more with outcome detected, 0 or empty with another"
            raise InputError(f"{where} column planets", int(planets), allowed=allowed)
    elif planets is None and told:
        allowed = f"{', '.join(OUTCOMES)}, for a visit that has a start_utc"
        raise InputError(f"{where} column outcome", "missing", allowed=allowed)
    setting, visits = _setting(table, where, row)
    hours = row.get("telescope_h", 2.0 * setting.exposure_s * setting.n_frames * visits / 3600.0)
    roll, lost = row.get("roll_deg", math.nan), outcome is not None and word == "lost"
    return ObservedVisit(str(row["star"]), mjd_of(utc), setting, hours, roll, int(planets or 0), where, lost)


def _scheduled(table: Rows, where: str, row: dict[str, Any], number: int) -> ScheduledVisit:
    setting, visits = _setting(table, where, row)
    mjd = 0.5 * (row.get("window_start_mjd", math.nan) + row.get("window_end_mjd", math.nan))
    library, roll = row.get("reference_library", ""), row.get("roll_deg", math.nan)
    return ScheduledVisit(
        str(row["star"]), setting, visits, library, roll, mjd, bool(row.get("reserve", False)), number
    )


def missed(
    model: EtcModel,
    star: Targets,
    planets: PlanetSample,
    albedos: tuple[AlbedoSpec, ...],
    visits: Sequence[ObservedVisit],
    rule: DetectionRule,
    *,
    epoch_mjd: float,
    sun_pa_deg: FloatArray | None = None,
    placed: BoolArray | None = None,
    zodis: FloatArray | None = None,
) -> FloatArray:
    """Return the probability that none of some visits showed each planet.

    Parameters
    ----------
    model, star, planets, albedos
        As of `cpic_planner.survey.detection.expected_signals`.
    visits : sequence of ObservedVisit
        Visits of this star.
    rule : DetectionRule
    epoch_mjd : float
        Of the planets.
    sun_pa_deg : ndarray, shape (v,), optional
        Position angle of the Sun at each visit, the roll where the log has none; by default that of its date.
    placed : ndarray of bool, optional
        Planets that a visit knows where to look for; none by default.
    zodis : ndarray, optional
        Dust around the star of each planet; by default that of the model.

    Notes
    -----
    New planets are a Poisson process: those that a visit did not show are one of less intensity, however many it
    showed. What a visit showed is in the log, not among what is left to find, unless a detection takes several visits:
    then a visit that showed planets rules none out. Nor does it rule out a known planet, which it may have shown.
    """
    at_place = np.zeros(len(planets), bool) if placed is None else placed
    left = np.ones(len(planets))
    if sun_pa_deg is None:
        sun_pa_deg = sun_position_angle_deg(star, np.array([[visit.mjd for visit in visits]]))[0]
    for visit, sun in zip(visits, sun_pa_deg, strict=True):
        if visit.planets and rule.visits_needed > 1:
            continue
        roll = sun if math.isnan(visit.roll_deg) else visit.roll_deg
        seen = expected_signals(
            model, star, visit.setting, planets, albedos, planets.places([visit.mjd - epoch_mjd]), [roll], zodis
        )
        odds = detection_chance(seen, rule, at_place, calibration=rule.calibration)
        left *= 1.0 - np.where(planets.known != NEW, 0.0, odds[0]) if visit.planets else 1.0 - odds[0]
    return left


def resampled(planets: PlanetSample, left: FloatArray, luck: FloatArray) -> PlanetSample:
    """Return the planets that are left to be found after some visits.

    Parameters
    ----------
    planets : PlanetSample
    left : ndarray
        Probability of each planet not to have been seen.
    luck : ndarray
        Uniform number of each.

    Notes
    -----
    New planets are a Poisson process; those that were not seen are one of the intensity times ``left``: each stays
    with that probability. A known planet is there; its orbits are drawn anew among its own draws with weights
    ``left``, or kept where none of them could have been missed.
    """
    keep = (planets.known == NEW) & (luck < left)
    parts = [planets.select(keep)]
    for row in np.unique(planets.known[planets.known != NEW]):
        mine = np.flatnonzero(planets.known == row)
        total = np.cumsum(left[mine])
        pick = np.arange(mine.size)
        if total[-1] > 0.0:
            pick = np.minimum(np.searchsorted(total / total[-1], luck[mine], side="right"), mine.size - 1)
        drawn = planets.select(mine[pick])
        held = {name: getattr(planets, name)[mine] for name in ("universe", "number", "known", "kind")}
        parts.insert(-1, replace(drawn, **held))
    return PlanetSample.joined(parts)
