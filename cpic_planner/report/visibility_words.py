"""Words, dates and tables of visibility."""

from __future__ import annotations

import csv
import io

from cpic_planner.models import PointingRecord, VisibilityResult

BLOCK_WORDS = {
    "sun": "too near the Sun",
    "moon": "too near the Moon",
    "panel": "panels out of the Sun",
    "limb": "behind the Earth",
}


def day_text(utc: str) -> str:
    """Return the day of a time of UTC."""
    return utc[:10]


def pointing_sentence(pointing: PointingRecord) -> str:
    """Return the limits of pointing in one sentence."""
    turned = f"turning by up to {pointing.panel_turn_deg:g}" if pointing.panel == "one_axis" else "fixed"
    return (
        f"Limits {pointing.name}: {pointing.sun_deg:g} deg from the Sun, {pointing.moon_deg:g} from the Moon, "
        f"{pointing.dark_limb_deg:g} from a dark limb of the Earth, {pointing.bright_limb_deg:g} from a sunlit one; "
        f"panels {turned} deg, within {pointing.panel_deg:g} of the Sun; {100 * pointing.saa_fraction:g} % of all time "
        "lost to the South Atlantic Anomaly."
    ).replace("fixed deg", "fixed")


def visibility_csv(result: VisibilityResult) -> str:
    """Return one line a target and step, with units in the names of the columns."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(
        ["name", "mjd", "blocked_by", "visible_s", "window_s", "roll_half_range_deg", "sun_deg", "moon_deg"]
    )
    for target in result.targets:
        days = target.days
        columns = (
            days.blocked_by,
            days.visible_s,
            days.window_s,
            days.roll_half_range_deg,
            days.sun_deg,
            days.moon_deg,
        )
        writer.writerows([target.name, *row] for row in zip(result.mjd, *columns, strict=True))
    return buffer.getvalue()
