"""Regenerate this report: ``python reports/one_year/make.py`` (about five minutes on two quiet cores).

One year at 5 % of the telescope: the strategies of ``strategies.yaml`` compared, the calendar of the one to take, and
what it may bring. ``--images 0`` leaves out the check by images.
"""

from __future__ import annotations

import argparse
import base64
import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cpic_core import write_bytes, write_text
from cpic_planner.report.figures import whatif_figures
from cpic_planner.report.numbers import duration_text, pretty_name, significant
from cpic_planner.results import StrategyOutcome, WhatIfResult
from cpic_planner.survey.strategy_file import load_strategies
from cpic_planner.survey.whatif import run_whatif

HERE = Path(__file__).resolve().parent
RUN = HERE.parents[1] / "out" / "one_year"
"""A run that is stopped goes on here."""
FIGURES = ("yields", "calendar", "time")
N_IMAGES, WORKERS = 24, 2


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def chosen(result: WhatIfResult) -> StrategyOutcome:
    """The strategy to take: of those that find as many planets as the best, as far as chance lets one tell, the one of
    fewest hours.
    """
    best = max(result.strategies, key=lambda item: item.planets.mean)
    behind = {
        (row.first if row.second == best.name else row.second)
        for row in result.differences
        if row.quantity == "planets" and best.name in (row.first, row.second) and (row.low > 0.0 or row.high < 0.0)
    }
    equals = [item for item in result.strategies if item.name not in behind]
    return min(equals, key=lambda item: item.hours.mean)


def _interval(record: Any) -> str:
    return f"{record.mean:.3f} ({record.low:.3f} to {record.high:.3f})"


def strategies_part(result: WhatIfResult) -> str:
    """What each strategy brings."""
    rows = [
        [
            item.name,
            _interval(item.planets),
            _interval(item.new_planets),
            f"{100 * item.any_planet:.0f} %",
            f"{100 * item.any_new_planet:.0f} %",
            f"{item.hours.mean:.0f}",
            item.schedule.visits,
            f"{item.noise_alarms.mean + item.background_alarms.mean:.2f}",
            f"{item.time_use.alarm_h:.1f}",
            f"{100 * item.schedule.distance:.0f} %",
        ]
        for item in result.strategies
    ]
    head = ["strategy", "planets", "of them new", "any planet", "any new planet", "hours used", "visits planned"]
    head += ["false alarms", "hours on them", "calendar below its bound at most"]
    described = "\n".join(
        f"- **{item.name}**: {config.description}."
        for item, config in zip(result.strategies, load_strategies(HERE / "strategies.yaml").strategies, strict=True)
    )
    return f"## The strategies\n\n{described}\n\n{table(head, rows)}"


def stars_part(item: StrategyOutcome) -> str:
    """What is done at each star, and what that brings."""
    rows = [
        [
            row.rank,
            pretty_name(row.name),
            ", ".join(name.rpartition(" ")[2] for name in row.known_planets) or "-",
            "/".join(row.bands),
            row.planned_visits,
            f"{row.visits * row.visit_h:.0f}",
            f"{row.new_planets:.4f}",
            f"{row.known_seen:.4f}",
            significant(row.planets_per_100h, 2),
        ]
        for row in item.targets
    ]
    head = ["#", "star", "known planets", "bands", "visits", "hours", "new planets", "known planets seen", "per 100 h"]
    return f"## Star by star\n\n{table(head, rows)}"


def visits_part(rows: Sequence[Mapping[str, str]]) -> str:
    """The calendar."""
    lines = [
        [
            row["visit"],
            row["window_start_utc"][:10],
            row["window_end_utc"][:10],
            pretty_name(row["star"]),
            row["band"],
            f"{row['frames_per_visit']} × {significant(float(row['exposure_s']), 3)} s",
            f"{float(row['em_gain']):.0f}",
            f"{float(row['roll_deg']):+.0f}",
            duration_text(float(row["time_s"])),
            f"{float(row['telescope_h']):.1f}",
            f"{100 * float(row['probability']):.2f} %",
        ]
        for row in rows
        if row["reserve"] in ("0", "False", "false")
    ]
    head = ["visit", "from", "to", "star", "band", "frames", "gain", "roll (deg)", "wall time", "telescope (h)"]
    return f"""## The calendar

Each visit is made on any day of its window. Reserve visits, which are made where a detection frees time, are in
[visits.csv](visits.csv) with the numbers in full; that file comes back as the log: `cpic whatif
reports/one_year/strategies.yaml --observed visits.csv` plans what is left of the year, once `start_utc` and `outcome`
of the visits that were made are filled in.

{table([*head, "shows a planet"], lines)}"""


def _spelled(record: Any) -> str:
    return f"{record.mean:.3f} (90 % interval of the mean {record.low:.3f} to {record.high:.3f})"


def head(result: WhatIfResult, item: StrategyOutcome, hours: float) -> str:
    """What to do and what to expect."""
    alarms = item.noise_alarms.mean + item.background_alarms.mean
    unused = hours - item.hours.mean
    more = "more" if alarms > item.planets.mean else "fewer"
    told = [
        f"**Take `{item.name}`.** Of {hours:.0f} h (5 % of a year; slews, settling and occultations included) it uses "
        f"{item.hours.mean:.0f} h for {item.schedule.visits} visits of {len(item.targets)} stars. "
        f"{unused:.0f} h are left over: no further visit is worth what the strategy asks of one.",
        f"It finds a planet in {100 * item.any_planet:.0f} % of the universes and one that nobody knows in "
        f"{100 * item.any_new_planet:.0f} %; in the mean {_spelled(item.planets)} planets, "
        f"{_spelled(item.new_planets)} of them new. In {100 * (1 - item.any_planet):.0f} % of the universes the year "
        "shows nothing.",
        f"**False alarms are {more} than planets**: {alarms:.2f} in the year, {item.background_alarms.mean:.2f} of "
        f"them stars of the background and {item.noise_alarms.mean:.3f} noise.",
    ]
    if alarms > 0.2 * item.planets.mean:
        told[-1] += " No detection of this year should be believed before a second visit has shown it."
    for other in result.strategies:
        if other.time_use.follow_up_h > 0.0:
            told.append(
                f"Second looks are cheap: `{other.name}` spends {other.time_use.follow_up_h:.1f} h on planets that it "
                f"has found and {other.time_use.alarm_h:.1f} h on false alarms, and sees "
                f"{other.confirmed_planets.mean:.3f} of {other.planets.mean:.3f} planets again or where a published "
                "orbit has them within the year. For the others the year ends, or the orbit carries them out of the "
                "dark hole, before that."
            )
    images = item.images
    if images is not None and images.images:
        told.append(
            f"{images.images} images of {images.detections} of its detections were simulated and searched blind: "
            f"{images.found} show the planet, {significant(images.expected, 3)} were expected."
        )
    told.append(
        f"The calendar is worth {item.schedule.value:.3f} to the scheduler (made of {item.schedule.method}), and none "
        f"can be worth more than {item.schedule.bound:.3f}. All numbers hold for the instrument as it is assumed: "
        "`reports/priorities` says how far that is known, `reports/doubt` what a wrong drift costs."
    )
    body = "\n\n".join(told)
    return f"""# One year at 5 % of the telescope

Regenerate with `python reports/one_year/make.py`; the question is [strategies.yaml](strategies.yaml).

{body}"""


def main() -> None:
    """Run, choose, write."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--images", type=int, default=N_IMAGES)
    options.add_argument("--workers", type=int, default=WORKERS)
    given = options.parse_args()
    config = load_strategies(HERE / "strategies.yaml")
    result = run_whatif(config, RUN, n_images=given.images, workers=given.workers).result
    item = chosen(result)
    every = csv.DictReader(io.StringIO((RUN / "visits.csv").read_text(encoding="utf-8")))
    rows = [row for row in every if row["strategy"] == item.name]
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_text(HERE / "visits.csv", text.getvalue())
    pictures, shown = whatif_figures(result), []
    for name in FIGURES:
        if name in pictures:
            before, data = pictures[name].uri.split(",", 1)
            file = f"{name}{'.svg' if 'svg' in before else '.png'}"
            write_bytes(HERE / file, base64.b64decode(data))
            shown.append(f"![{pictures[name].alt}]({file})")
    hours = config.strategies[0].time_budget_h
    parts = [head(result, item, hours), strategies_part(result), *shown, stars_part(item), visits_part(rows)]
    write_text(HERE / "report.md", "\n\n".join(parts) + "\n")
    print(HERE / "report.md")


if __name__ == "__main__":
    main()
