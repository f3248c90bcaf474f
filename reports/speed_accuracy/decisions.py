"""Measure what decisions cost: ``python reports/speed_accuracy/decisions.py`` (about a quarter of an hour on one core).

Ensembles of more and fewer instruments, and strategies played in more and fewer universes, each against many; the
schedules of each method. ``--only PART`` measures one part again and keeps the others, which are in ``decisions.json``;
``make.py`` puts them into the report.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import coronagraph_tables
import numpy as np

from cpic_core.files import write_json
from cpic_planner.etc import build_model
from cpic_planner.queries import EnsembleChoice, load_ensemble
from cpic_planner.ranking.ensemble import ENDS, FIRST, POOL, Standings, standings
from cpic_planner.ranking.order import RankSetting, ranked, ranked_order
from cpic_planner.survey.prepare import prepare
from cpic_planner.survey.simulate import simulate_survey
from cpic_planner.survey.strategy_file import load_strategies
from cpic_planner.survey.universe import BLOCK
from cpic_planner.targets import rank_sample
from simulator.config import load_instrument

HERE = Path(__file__).resolve().parent
RESULTS = HERE / "decisions.json"
TIME_S = 36000.0
INSTRUMENTS, MANY_INSTRUMENTS, SEEDS = (10, 30, 100, 200), 600, (2, 3, 4)
UNIVERSES, MANY_UNIVERSES = (100, 300, 1000), 4000


def ensembles() -> dict[str, Any]:
    """Ranks of the first stars under more and fewer instruments, against those under many."""
    setting = RankSetting.of(build_model(load_instrument()), time_s=TIME_S)
    targets = rank_sample()
    order = ranked_order(ranked(setting, targets, brief=True), targets)
    stars = targets.select(np.array(order[:POOL]))
    ensemble = load_ensemble()

    def found(number: int, seed: int) -> tuple[Standings, float]:
        choice = EnsembleChoice(ensemble, number, seed)
        drawn = choice.draws()
        began = time.process_time()
        draws = [{key: float(values[i]) for key, values in drawn.items()} for i in range(number)]
        return standings(setting, stars, choice, draws), time.process_time() - began

    def said(item: Standings) -> dict[str, Any]:
        first = item.rank[:, :FIRST]
        return {
            "ranks": np.quantile(first, (ENDS[0], 0.5, ENDS[1]), axis=0, method="inverted_cdf"),
            "reached": item.detected[:, :FIRST].mean(axis=0),
            "planets": np.quantile(item.total, (ENDS[0], 0.5, ENDS[1])),
        }

    found(2, 1)  # compiled, and states read
    many, seconds = found(MANY_INSTRUMENTS, 1)
    best = said(many)
    rows = []
    for number in INSTRUMENTS:
        tried = [found(number, seed) for seed in SEEDS]
        each = [said(item) for item, _ in tried]
        rows.append(
            {
                "instruments": number,
                "processor_s": float(np.mean([spent for _, spent in tried])),
                "median_places": max(float(np.abs(one["ranks"][1] - best["ranks"][1]).max()) for one in each),
                "end_places": max(float(np.abs(one["ranks"] - best["ranks"]).max()) for one in each),
                "reached": max(float(np.abs(one["reached"] - best["reached"]).max()) for one in each),
                "planets": [float(np.abs(one["planets"] / best["planets"] - 1.0)[1]) for one in each],
            }
        )
    return {"stars": POOL, "first": FIRST, "many": MANY_INSTRUMENTS, "processor_s": seconds, "rows": rows}


def strategies() -> dict[str, Any]:
    """Planets of each default strategy in more and fewer universes, against those in many."""
    config = load_strategies("survey_default")
    began = time.process_time()
    ready = prepare(config)
    prepared_s = time.process_time() - began
    found = []
    for survey in ready.surveys:
        planets, spent = np.zeros(0), []
        for block in range(MANY_UNIVERSES // BLOCK):
            began = time.process_time()
            played = simulate_survey(survey, block=block, n=BLOCK, seed=config.universe.seed).universes
            spent.append(time.process_time() - began)
            planets = np.concatenate([planets, played["new_planets"] + played["known_planets"]])
        best, error = float(planets.mean()), float(planets.std(ddof=1))
        rows = [
            {
                "universes": number,
                "processor_s": float(sum(spent[: number // BLOCK])),
                "error": float(planets[:number].mean() / best - 1.0),
                "standard_error": error / math.sqrt(number) / best,
            }
            for number in (*UNIVERSES, MANY_UNIVERSES)
        ]
        schedule = survey.schedule
        kept = {"value": schedule.value, "bound": schedule.bound, "method": schedule.method}
        found.append({"name": survey.strategy.name, "planets": best, "schedule": kept, "rows": rows})
    return {"prepared_s": prepared_s, "strategies": found}


PARTS = {"ensembles": ensembles, "strategies": strategies, "tables": coronagraph_tables.measured}


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def ensembles_text(found: dict[str, Any]) -> str:
    """The section of ensembles."""
    rows = [
        [
            row["instruments"],
            f"{row['processor_s']:.1f} s",
            f"{row['median_places']:.0f}",
            f"{row['end_places']:.0f}",
            f"{row['reached']:.2f}",
            f"{100 * max(row['planets']):.0f} %",
        ]
        for row in found["rows"]
    ]
    head = [
        "instruments",
        "processor time",
        "median rank",
        "ends of the rank's interval",
        "probability that the reference planet is detected",
        "median of the expected planets",
    ]
    return f"""
## Ensembles of instruments

`cpic rank --instruments N` ranks {found["stars"]} stars under N instruments. Errors are the largest of the first
{found["first"]} stars and of {len(SEEDS)} seeds, ranks in places, against {found["many"]} other instruments, whose own
errors are in them.

{table(head, rows)}
"""


def strategies_text(found: dict[str, Any]) -> str:
    """The section of strategies."""
    rows = [
        [
            row["universes"],
            *(
                f"{100 * own['error']:+.1f} ± {100 * own['standard_error']:.1f} %"
                for own in (item["rows"][k] for item in found["strategies"])
            ),
            f"{sum(item['rows'][k]['processor_s'] for item in found['strategies']):.1f} s",
        ]
        for k, row in enumerate(found["strategies"][0]["rows"][:-1])
    ]
    names = [item["name"] for item in found["strategies"]]
    below = [
        [
            item["name"],
            f"{item['schedule']['value']:.3f}",
            f"{100 * (1 - item['schedule']['value'] / item['schedule']['bound']):.1f} %",
            item["schedule"]["method"],
        ]
        for item in found["strategies"]
    ]
    return f"""
## Strategies

`cpic whatif survey_default --universes N`: planets found against those in {MANY_UNIVERSES} universes, and the standard
error that so many universes leave. The preparation, which does not depend on them, takes {found["prepared_s"]:.0f} s of
a processor.

{table(["universes", *names, "processor time"], rows)}

What each calendar is worth to the scheduler, and how far below the bound that no calendar can pass:

{table(["strategy", "worth", "below the bound at most", "made by"], below)}
"""


def tables_text(found: dict[str, Any]) -> str:
    """Section on coronagraphs of tables."""
    return coronagraph_tables.text(found, table)


TEXTS = {"ensembles": ensembles_text, "strategies": strategies_text, "tables": tables_text}


def text() -> str:
    """Both sections, from what was measured last; nothing where that is not there."""
    if not RESULTS.exists():
        return ""
    found = json.loads(RESULTS.read_text(encoding="utf-8"))
    return "".join(words(found[name]) for name, words in TEXTS.items() if name in found)


def main() -> None:
    """Measure and keep."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--only", action="append", default=[], choices=sorted(PARTS))
    given = options.parse_args()
    found = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {}
    for name in given.only or PARTS:
        found[name] = PARTS[name]()
        write_json(RESULTS, found)
        print(name, "measured", flush=True)


if __name__ == "__main__":
    main()
