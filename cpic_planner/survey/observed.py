"""What a survey has done already: an observation log, and what it leaves of the planets that may be there."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from catalogs import Column, Columns, parse_table, read_bytes, read_rows, star_key
from cpic_core import BoolArray, FloatArray, InputError
from cpic_planner.etc import EtcModel
from cpic_planner.survey.calendar import sun_position_angle_deg
from cpic_planner.survey.detection import Setting, detection_chance, expected_signals
from cpic_planner.survey.strategy import DetectionRule
from cpic_planner.survey.universe import NEW, PlanetSample
from cpic_planner.targets import Targets
from simulator.config import AlbedoSpec, checked_utc
from simulator.products import mjd_of

_ROLL = "position angle of the detector's +y axis; without it that of the panels on that day"
COLUMNS = Columns(
    (
        Column("star", "any name of a star of the catalogue", aliases="target object name"),
        Column("start_utc", "when the visit began, ISO 8601", aliases="date utc dateobs begin"),
        Column("band", "band of the visit", aliases="filter"),
        Column("exposure_s", "of one frame", "float", "s", "exposure exptime", 1e-6, 1e6),
        Column("n_frames", "science frames", "float", "", "frames nframes", 1.0, 1e9),
        Column("em_gain", "EM gain", "float", "", "gain emgain", 1.0, 1e4),
        Column("telescope_h", "telescope time that it took", "float", "h", "hours telescopehours", 0.0, 1e5),
        Column("roll_deg", _ROLL, "float", "deg", "roll", -360.0, 360.0),
        Column("planets", "planets that it showed; without it none", "float", "", "detections found", 0.0, 1000.0),
    )
)
"""Columns of a log; star, start_utc, band, exposure_s, n_frames and em_gain are needed."""
_NEEDED = (("star",), ("start_utc",), ("band",), ("exposure_s",), ("n_frames",), ("em_gain",))


@dataclass(frozen=True)
class ObservedVisit:
    """One line of a log; ``roll_deg`` is nan where the log does not say, ``where`` names file and row."""

    star: str
    mjd: float
    setting: Setting
    telescope_h: float
    roll_deg: float
    planets: int
    where: str = ""


@dataclass(frozen=True)
class ObservationLog:
    """Visits that were made, in the order of time, and what the file is."""

    visits: tuple[ObservedVisit, ...]
    provenance: str

    def of(self, star: str) -> tuple[ObservedVisit, ...]:
        """Visits of a star, by any of its names."""
        key = star_key(star)
        return tuple(visit for visit in self.visits if star_key(visit.star) == key)

    @property
    def until_mjd(self) -> float:
        """When the last visit began."""
        return self.visits[-1].mjd

    @property
    def hours(self) -> float:
        """Telescope time of all visits."""
        return sum(visit.telescope_h for visit in self.visits)


def read_log(source: str | Path) -> ObservationLog:
    """Read an observation log.

    Parameters
    ----------
    source : str or Path
        CSV, ECSV, VOTable or FITS with the columns of `COLUMNS`.

    Raises
    ------
    InputError
        Naming file, row, column, value, unit and range of the first fault.
    """
    file = read_bytes(source, key="observed", presets="")
    log = read_rows(parse_table(file), COLUMNS, _NEEDED, about="star")
    visits = []
    for where, row in log:
        log.refuse_missing(where, row, _NEEDED)
        visits.append(_visit(row, where))
    visits.sort(key=lambda visit: (visit.mjd, visit.star))
    hours, planets = sum(visit.telescope_h for visit in visits), sum(visit.planets for visit in visits)
    about = f"{len(visits)} visits, {hours:g} h, {planets} planets ({file.name} {file.sha256[:12]})"
    return ObservationLog(tuple(visits), about)


def _visit(row: dict[str, Any], where: str) -> ObservedVisit:
    utc = checked_utc(f"{where} column start_utc", row["start_utc"])
    for name in ("n_frames", "planets"):
        if not float(row.get(name) or 0).is_integer():
            raise InputError(f"{where} column {name}", row[name], allowed="a whole number")
    exposure_s, n_frames = row["exposure_s"], row["n_frames"]
    time_s = 2.0 * exposure_s * n_frames
    setting = Setting(str(row["band"]), exposure_s, n_frames, row["em_gain"], time_s)
    hours, roll = (
        other if row.get(name) is None else row[name]
        for name, other in (("telescope_h", time_s / 3600.0), ("roll_deg", math.nan))
    )
    planets = int(row.get("planets") or 0)
    return ObservedVisit(str(row["star"]), mjd_of(utc), setting, hours, roll, planets, where)


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
) -> FloatArray:
    """Probability that none of some visits showed each planet.

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
            model, star, visit.setting, planets, albedos, planets.places([visit.mjd - epoch_mjd]), [roll]
        )
        odds = detection_chance(seen, rule, at_place, calibration=rule.calibration)
        left *= 1.0 - np.where(planets.known != NEW, 0.0, odds[0]) if visit.planets else 1.0 - odds[0]
    return left


def resampled(planets: PlanetSample, left: FloatArray, luck: FloatArray) -> PlanetSample:
    """Planets that are left to be found after some visits.

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
