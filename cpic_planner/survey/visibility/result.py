"""Visibility of stars as a result: seasons, days and times per orbit."""

import math
from typing import Any

import numpy as np

from cpic_core import InputError
from cpic_planner.results import PointingRecord, SeasonRecord, VisibilityResult, VisibleDays, VisibleTarget
from cpic_planner.survey.visibility.calendar import BLOCKS, Visibility, utc_of, visibility
from cpic_planner.survey.visibility.config import VisibilityConfig
from cpic_planner.targets import Targets
from simulator.config import OrbitConfig, checked_utc, content_hash
from simulator.effects import ecliptic_deg


def visibility_result(
    targets: Targets,
    config: VisibilityConfig,
    orbit: OrbitConfig,
    *,
    start_utc: str,
    n_days: int,
    step_days: float = 1.0,
    catalogue: str = "",
) -> VisibilityResult:
    """When stars can be seen.

    Parameters
    ----------
    targets : Targets
    config, orbit, start_utc, n_days, step_days
        As of `cpic_planner.survey.visibility.visibility`.
    catalogue : str
        What the stars come from, in words.

    Returns
    -------
    VisibilityResult

    Raises
    ------
    InputError
        For a star without coordinates, by name, and as `visibility` does.
    """
    for name, ra, dec in zip(targets.name, targets.ra_deg, targets.dec_deg, strict=True):
        if not (math.isfinite(ra) and math.isfinite(dec)):
            hint = f"the star table has none of {name}"
            raise InputError("ra_deg, dec_deg", "missing", unit="deg", allowed="coordinates", hint=hint)
    seen = visibility(
        targets.ra_deg, targets.dec_deg, config, orbit, start_utc=start_utc, n_days=n_days, step_days=step_days
    )
    when: dict[str, Any] = {"start_utc": checked_utc("start_utc", start_utc), "n_days": n_days, "step_days": step_days}
    stars, orbit_content = targets.content(), orbit.model_dump(mode="json")
    digest = content_hash({"pointing": config.content(), "orbit": orbit_content, "stars": stars, **when})
    rows = [_target(targets, seen, row) for row in range(len(targets))]
    about = {"config_hash": digest, "catalogue": catalogue, "pointing": PointingRecord.of(config), **when}
    return VisibilityResult.of(seen, orbit, **about, targets=rows)


def _target(targets: Targets, seen: Visibility, row: int) -> VisibleTarget:
    usable = np.flatnonzero(seen.observable[row])
    visible = seen.visible_s[row]
    best = int(usable[np.argmax(visible[usable])]) if len(usable) else None
    days = seen.days(row)
    runs, times = seen.runs(row, through=("moon",)), seen.windows(row, through=("moon",))
    lengths = [float(np.count_nonzero(seen.observable[row, begin:behind]) * seen.step_days) for begin, behind in runs]
    return VisibleTarget.of(
        targets,
        at=row,
        hip=int(targets.hip[row]) or None,
        ecliptic_latitude_deg=float(ecliptic_deg(targets.ra_deg[row], targets.dec_deg[row])[1]),
        seasons=[
            SeasonRecord(start_utc=start, end_utc=end, days=length)
            for (start, end), length in zip(times, lengths, strict=True)
        ],
        observable_days=days[""],
        blocked_days={name: days[name] for name in BLOCKS if name},
        visible_s=None if best is None else float(np.median(visible[usable])),
        best_visible_s=None if best is None else float(visible[best]),
        best_utc=None if best is None else utc_of(seen.mjd[best])[0],
        longest_window_s=None if best is None else float(seen.window_s[row].max()),
        roll_half_range_deg=None if best is None else float(np.median(seen.roll_half_range_deg[row, usable])),
        days=VisibleDays.of(seen, at=row, blocked_by=[BLOCKS[number] for number in seen.blocked_by[row]]),
    )
