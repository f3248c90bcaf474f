"""How long stars can be seen in a year: all that are ranked, and those that surveys visit."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpic_planner.report.words import pretty_name
from cpic_planner.survey.visibility import load_visibility, visibility_result
from cpic_planner.targets import rank_sample
from simulator import load_instrument

STARS = ("eps Eri", "alf Cen A", "alf CMi", "tau Cet", "eps Ind", "61 Cyg A", "del Pav")
YEAR = 366


def run() -> dict[str, Any]:
    """Days and minutes of every star of the ranking in the first year of the mission."""
    mission, stars = load_instrument().mission, rank_sample()
    found = visibility_result(stars, load_visibility(), mission.orbit, start_utc=mission.start_utc, n_days=YEAR)
    days = np.array([item.observable_days for item in found.targets])
    minutes = np.array([(item.visible_s or 0.0) / 60.0 for item in found.targets])
    some = {item.name: item for item in found.targets}
    return {
        "stars": len(stars),
        "start_utc": found.start_utc,
        "period_min": found.period_s / 60.0,
        "days": [float(value) for value in np.quantile(days, [0.0, 0.25, 0.5, 0.75, 1.0])],
        "minutes": [float(value) for value in np.quantile(minutes, [0.0, 0.25, 0.5, 0.75, 1.0])],
        "always": int(np.count_nonzero(days == YEAR)),
        "never": int(np.count_nonzero(days == 0)),
        "rows": [
            {
                "star": pretty_name(name),
                "latitude_deg": some[name].ecliptic_latitude_deg,
                "days": some[name].observable_days,
                "seasons": len(some[name].seasons),
                "minutes": (some[name].visible_s or 0.0) / 60.0,
                "best_minutes": (some[name].best_visible_s or 0.0) / 60.0,
                "blocked": {key: value for key, value in some[name].blocked_days.items() if value},
            }
            for name in STARS
        ],
    }


def text(found: dict[str, Any]) -> str:
    """The statement over all stars."""
    low, quarter, middle, three, high = found["days"]
    return (
        f"From {found['start_utc'][:10]} the median of {found['stars']} ranked stars can be observed on {middle:.0f} "
        f"of {YEAR} days (quarters at {quarter:.0f} and {three:.0f}, extremes {low:.0f} and {high:.0f}), and then for "
        f"{found['minutes'][2]:.0f} min of an orbit of {found['period_min']:.1f} min (median day; quarters at "
        f"{found['minutes'][1]:.0f} and {found['minutes'][3]:.0f})."
    )


def rows(found: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Head and rows of the table of stars that surveys visit."""
    head = [
        "star",
        "ecliptic latitude (deg)",
        "days",
        "seasons",
        "minutes an orbit, median day",
        "best day",
        "days blocked by",
    ]
    return head, [
        [
            row["star"],
            f"{row['latitude_deg']:+.0f}",
            f"{row['days']:.0f}",
            str(row["seasons"]),
            f"{row['minutes']:.0f}",
            f"{row['best_minutes']:.0f}",
            ", ".join(f"{key} {value:.0f}" for key, value in row["blocked"].items()),
        ]
        for row in found["rows"]
    ]
