"""The period of a plan: which of the first stars can be observed in it, and what that takes of the telescope's time."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from cpic_planner.etc import EtcModel
from cpic_planner.queries import PlanQuestion, observed_utc
from cpic_planner.results import ConfirmedTarget, LeftOutRow, PeriodRecord, RankedTarget, RankResult, SeenRow
from cpic_planner.survey import Sight, VisitRule
from cpic_planner.survey.visibility import BLOCKS, Visibility, load_visibility, seasons_of, visibility

_CHUNK = 20
_BLOCKED = {
    "sun": "too near to the Sun",
    "moon": "too near to the Moon",
    "panel": "the solar panels get no light",
    "limb": "behind the limb of the Earth",
}


def seen_stars(
    config: PlanQuestion, rank: RankResult, model: EtcModel
) -> tuple[list[RankedTarget], PeriodRecord, dict[str, Sight]]:
    """Return the first stars of the ranking that can be observed in the period, those left out, how each is seen."""
    pointing, orbit = load_visibility(config.limits), config.instrument.mission.orbit
    when: dict[str, Any] = {"start_utc": observed_utc(config), "n_days": config.n_days}
    chosen: list[RankedTarget] = []
    left_out: list[LeftOutRow] = []
    not_checked: list[str] = []
    seen: list[SeenRow] = []
    sights: dict[str, Sight] = {}
    waiting = [row for row in rank.targets if row.status != "saturated"]
    while waiting and len(chosen) < config.top:
        some, waiting = waiting[:_CHUNK], waiting[_CHUNK:]
        placed = [row for row in some if row.ra_deg is not None and row.dec_deg is not None]
        ra, dec = (np.array([getattr(row, name) for row in placed], float) for name in ("ra_deg", "dec_deg"))
        found = visibility(ra, dec, pointing, orbit, **when) if placed else None
        for row in some:
            if len(chosen) >= config.top:
                break
            if found is None or row not in placed:
                not_checked.append(row.name)
                chosen.append(row)
                continue
            at = placed.index(row)
            reason = _unseen(found, at, row, model)
            if reason is None:
                chosen.append(row)
                seen.append(SeenRow(name=row.name, usable_h=_usable_h(found, at), seasons=seasons_of(found, at)))
                sights[row.name] = Sight.of(found, at, pointing)
            else:
                left_out.append(reason)
    found_as: dict[str, Any] = {"seen": seen, "left_out": left_out, "not_checked": not_checked}
    return chosen, PeriodRecord(**when, pointing=pointing.name, **found_as), sights


def with_telescope_time(target: ConfirmedTarget, model: EtcModel, sights: Mapping[str, Sight]) -> ConfirmedTarget:
    """Return a target with the telescope time of its observation in each band, and of the least one that detects.

    A visit has as many slews as one of a survey that says nothing else. Without a sight of the star nothing is known.

    Parameters
    ----------
    target : ConfirmedTarget
    model : EtcModel
    sights : mapping of str to Sight
        Of `seen_stars`, by the names of stars.
    """
    sight = sights.get(target.name)

    def hours(time_s: float | None, exposure_s: float | None, visits: int | None, band: str) -> float | None:
        if sight is None or time_s is None or exposure_s is None:
            return None
        frame_s = exposure_s + model.camera(band).readout_s
        found = float(sight.telescope_h(time_s, frame_s, (visits or 1) * VisitRule().settlings))
        return found if np.isfinite(found) else None

    bands = [
        band.model_copy(update={"telescope_h": hours(band.time_s, band.exposure_s, band.visits, band.band)})
        for band in target.bands
    ]
    star = target.ranked
    least_h = hours(star.detection_time_s, star.exposure_s, star.detection_visits, star.band)
    return target.model_copy(update={"bands": bands, "detection_telescope_h": least_h})


def _usable_h(found: Visibility, at: int) -> float:
    return float(found.visible_fraction[at].sum()) * 24.0 * found.step_days


def _unseen(found: Visibility, at: int, row: RankedTarget, model: EtcModel) -> LeftOutRow | None:
    """Return why a star cannot have its best observation in the period; None where it can."""
    n_days = len(found.mjd) * found.step_days
    usable_h = _usable_h(found, at)
    needed_h = None if row.time_s is None else row.time_s / 3600.0
    frame_s = (row.exposure_s or 0.0) + model.camera(row.band).readout_s
    longest_s = float(found.window_s[at].max())
    if usable_h <= 0.0:
        days = found.days(at)
        why = ", ".join(f"{_BLOCKED[name]} for {days[name]:g} d" for name in BLOCKS if name and days[name])
        message = f"not seen in {n_days:g} d: {why}"
    elif needed_h is not None and usable_h < needed_h:
        message = f"seen for {usable_h:.1f} h in {n_days:g} d, and its observation takes {needed_h:.1f} h"
    elif longest_s < frame_s:
        message = f"never seen for the {frame_s:.0f} s of a frame without a break: {longest_s:.0f} s at most"
    else:
        return None
    return LeftOutRow(name=row.name, rank=row.rank, usable_h=usable_h, needed_h=needed_h, message=message)
