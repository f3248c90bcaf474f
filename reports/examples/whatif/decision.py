"""What a team could decide: the five default strategies, and what their settings change."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

from cpic_planner.report.drawing import Picture
from cpic_planner.report.words import pretty_name
from cpic_planner.results import StrategyOutcome, WhatIfResult
from cpic_planner.survey import StrategiesConfig, load_strategies, run_whatif, varied
from tools.report_parts import table

BASE = "few_and_deep"
SWEEPS = {
    "visits": ("max_visits=1,2,5,10,20,40", "visits of each star at most"),
    "time": ("time_s=1800,3600,10800,36000,72000", "wall time of a visit at most (s)"),
    "contrast": ("contrast=1e-8,3e-9,1e-9,3e-10", "median raw contrast of the dark hole"),
    "drift": ("drift=x0.25,x0.5,x1,x2,x4", "wavefront drift, times the nominal one"),
}


def _alone(name: str) -> StrategiesConfig:
    config = load_strategies()
    universe = config.universe.model_copy(update={"facts": False})  # the default run has them
    alone = tuple(item for item in config.strategies if item.name == name)
    return config.model_copy(update={"strategies": alone, "universe": universe})


def _row(item: StrategyOutcome) -> dict[str, Any]:
    return {
        "name": item.name,
        "planets": item.planets.model_dump(),
        "new": item.new_planets.model_dump(),
        "hours": item.hours.mean,
        "visits": item.schedule.visits,
        "stars": len(item.targets),
    }


def run(folder: Path) -> dict[str, Any]:
    """The sweeps, a thousand universes each."""
    found: dict[str, Any] = {}
    for key, (sweep, _) in SWEEPS.items():
        with tempfile.TemporaryDirectory() as scratch:
            result = run_whatif(varied(_alone(BASE), [sweep]), scratch, n_images=0).result
        found[key] = [_row(item) | {"against_last": _against_last(result, item.name)} for item in result.strategies]
    return found


def _against_last(result: WhatIfResult, name: str) -> dict[str, float] | None:
    """New planets less those of the last value, in the same universes; None where the pair was not compared."""
    last = result.strategies[-1].name
    for item in result.differences:
        if item.quantity == "new_planets" and (item.first, item.second) == (last, name):
            return {"mean": -item.mean, "low": -item.high, "high": -item.low}
    return None


def default_result(folder: Path) -> WhatIfResult:
    """The committed run of the five default strategies."""
    return WhatIfResult.model_validate(json.loads((folder / "whatif.json").read_text()))


def pictures(folder: Path, found: dict[str, Any]) -> dict[str, Picture]:
    """Figures of the default run that the report shows."""
    from cpic_planner.report.whatif_figures import whatif_figures

    drawn = whatif_figures(default_result(folder))
    return {name: drawn[name] for name in ("yields", "curves", "time", "calendar") if name in drawn}


def _value(name: str) -> str:
    """The number or word that was varied, without the unit or x: heads of columns and sentences have them."""
    return name.rsplit("=", 1)[-1].removeprefix("x").split(" ")[0]


def _estimate(item: dict[str, float]) -> str:
    return f"{item['mean']:.2f} ({item['low']:.2f} to {item['high']:.2f})"


def _seen(images: dict[str, Any] | None) -> str:
    """How many of the detections that were imaged are found there."""
    if images is None or images["correction"] is None:
        return "" if images is None else images["note"]
    return (
        f"{images['found']} of {images['expected']:.1f} expected in {images['images']} images: "
        f"{images['correction']:.2f} ({images['low']:.2f} to {images['high']:.2f})"
    )


def text(found: dict[str, Any]) -> str:
    """The decision in words and tables."""
    result = default_result(Path(__file__).resolve().parent)
    return "\n\n".join([_strategies(result), _sweeps(found), _decision(result, found)])


def _strategies(result: WhatIfResult) -> str:
    rows = []
    for item in result.strategies:
        seen = _seen(None if item.images is None else item.images.model_dump())
        rows.append(
            (
                item.name,
                len(item.targets),
                item.schedule.visits,
                f"{item.hours.mean:.0f}",
                _estimate(item.planets.model_dump()),
                _estimate(item.new_planets.model_dump()),
                f"{item.any_new_planet:.0%}",
                f"{item.characterised_planets.mean:.2f}",
                f"{item.background_alarms.mean + item.noise_alarms.mean:.3f}",
                seen,
            )
        )
    return (
        f"## {len(result.strategies)} ways to spend {result.strategies[0].settings['time_budget_h']:.0f} hours\n\n"
        f"{result.n_universes} universes of the population `giants` (0.21 planets a star) and the known planets "
        f"in the shipped table, ten "
        "years from 2028. Means over surveys with their 90 % intervals; a detection is one of a blind search, with the "
        "probability that images show; of known planets the place on the sky is not known either.\n\n"
        + table(
            [
                "strategy",
                "stars",
                "visits planned",
                "hours used",
                "planets",
                "of them new",
                "any new planet",
                "seen in all bands",
                "false alarms",
                "confirmed by images",
            ],
            rows,
        )
        + "\n\n![Planets of each strategy](yields.svg)\n\n![Planets against telescope time](curves.svg)\n\n"
        "![Where the time goes](time.svg)\n\n![When which star is visited](calendar.svg)\n\n"
        + table(
            ["paired difference", "planets", "90 % interval", "correlation"],
            [
                (
                    f"{item.first} - {item.second}",
                    f"{item.mean:+.2f}",
                    f"{item.low:+.2f} to {item.high:+.2f}",
                    "" if item.correlation is None else f"{item.correlation:.2f}",
                )
                for item in result.differences
                if item.quantity == "planets"
            ],
        )
    )


def _sweeps(found: dict[str, Any]) -> str:
    parts = [f"## What the settings of {BASE} change"]
    for key, (_, label) in SWEEPS.items():
        parts.append(
            table(
                [label, "planets", "new planets", "hours used", "visits planned"],
                [
                    (
                        _value(row["name"]),
                        _estimate(row["planets"]),
                        _estimate(row["new"]),
                        f"{row['hours']:.0f}",
                        row["visits"],
                    )
                    for row in found[key]
                ],
            )
        )
    return "\n\n".join(parts)


def _decision(result: WhatIfResult, found: dict[str, Any]) -> str:
    """What follows, in sentences whose numbers and comparisons are those of the tables."""
    best = max(result.strategies, key=lambda item: item.new_planets.mean)
    single = result.strategies[0]
    stars = ", ".join(
        pretty_name(target.name)
        for target in sorted(best.targets, key=lambda target: -(target.new_planets + target.known_seen))[:6]
    )
    visits, times, contrasts = (found[key] for key in ("visits", "time", "contrast"))
    short, long = times[0], times[-1]
    lost = short["against_last"]
    base = next(item for item in result.strategies if item.name == BASE)
    own, nominal = base.time_use, base.new_planets.mean
    gains = {"Contrast": contrasts[-1]["new"]["mean"], "Stability": found["drift"][0]["new"]["mean"]}
    first = max(gains, key=lambda name: gains[name])
    exposing = own.exposing_h / (own.exposing_h + own.occulted_h + own.settling_h)
    return (
        "## The decision\n\n"
        f"- **Come back.** {best.name} finds {best.new_planets.mean:.2f} new planets a survey where one visit of "
        f"each star "
        f"finds {single.new_planets.mean:.2f}: orbits carry planets into the square quadrants between visits. From "
        f"{_value(visits[0]['name'])} to {_value(visits[-1]['name'])} visits a star the yield of {BASE} goes from "
        f"{visits[0]['new']['mean']:.2f} to {visits[-1]['new']['mean']:.2f} new planets in "
        f"{visits[-1]['hours']:.0f} h.\n"
        f"- **Let visits run as long as they pay.** At most {_value(short['name'])} s a visit instead of "
        f"{_value(long['name'])} s change the new planets by {lost['mean']:+.3f} ({lost['low']:+.3f} to "
        f"{lost['high']:+.3f}) and the time from {long['hours']:.0f} to {short['hours']:.0f} h: only {exposing:.0%} of "
        f"the time of {BASE} is exposure, the rest goes to slews, settling and the Earth in the way. No visit runs "
        "longer than the drift of the wavefront lets it pay.\n"
        f"- **Few stars matter.** Nearly all detections are of {stars}; the whole budget of "
        f"{single.settings['time_budget_h']:.0f} h cannot be used well by any strategy at the nominal contrast "
        f"and drift "
        f"({max(item.hours.mean for item in result.strategies):.0f} h at most).\n"
        f"- **Let neither contrast nor drift slip; {first.lower()} is what gains more.** The nominal instrument finds "
        f"{nominal:.2f} new planets. At a raw contrast of {_value(contrasts[0]['name'])} it would be "
        f"{contrasts[0]['new']['mean']:.2f}, at {_value(contrasts[-1]['name'])} {contrasts[-1]['new']['mean']:.2f}; "
        f"with {_value(found['drift'][-1]['name'])} times the drift {found['drift'][-1]['new']['mean']:.2f}, with "
        f"{_value(found['drift'][0]['name'])} of it {found['drift'][0]['new']['mean']:.2f}.\n"
        f"- **Ask again before believing.** {best.name} takes {best.background_alarms.mean:.1f} background stars "
        f"a survey for "
        f"planets (nearly all at α Cen, near the Galactic plane) where it finds {best.new_planets.mean:.2f} new "
        f"ones; noise "
        f"passes {best.noise_alarms.mean:.3f} times. A second epoch tells: these stars move by arcsecs a year.\n\n"
        "What could change this: the occurrence of planets (the yield is proportional to it), and optics and drift "
        "that nobody has measured yet."
    )
