"""Regenerate this report: ``python reports/priorities/make.py`` (about ten minutes on a quiet core).

Which stars first, how sure that is, and what decides; then the checks of the numbers that are new in it. ``--only
PART`` measures one part again and keeps the others, which are in ``results.json``.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import write_text
from cpic_core.files import write_json
from cpic_planner import rank_targets
from cpic_planner.etc import EtcModel, build_model
from cpic_planner.queries import OCCURRENCE, EnsembleChoice, Strategy, load_ensemble
from cpic_planner.ranking.ensemble import instrument_of, standings, states_of
from cpic_planner.ranking.order import RankSetting, ranked, ranked_order
from cpic_planner.report.numbers import duration_text, pretty_name, significant
from cpic_planner.report.priorities import TIERS, ensemble_figure
from cpic_planner.results import RankResult
from cpic_planner.targets import Targets, rank_sample
from simulator.config import load_instrument
from simulator.imaging import at_contrast, mean_contrast, psf_metrics
from simulator.imaging.mirror_states import measured_states, sensed_with

HERE = Path(__file__).resolve().parent
RESULTS, RANKING = HERE / "results.json", HERE / "ranking.json"
N, SEEDS, SHOWN, FIRST = 200, (1, 2, 3), 30, 10
TIME_S = 36000.0
BETWEEN = (0.17, 0.55, 1.7)
"""Errors of sensing between those of the states of the mirror, over those of the published instrument."""
LONGEST_S = 30.0 * TIME_S
_STEPS = 24  # halvings of an interval of logarithms: to 1e-6 of the factor


def nominal() -> RankSetting:
    """The default question."""
    return RankSetting.of(build_model(load_instrument()), time_s=TIME_S)


def ranking() -> dict[str, Any]:
    """The ranking under the ensemble; it is kept whole beside this file."""
    result = rank_targets(instruments=N)
    kept = result.model_copy(update={"targets": result.targets[: 4 * SHOWN]})
    write_text(RANKING, kept.model_dump_json(indent=1) + "\n")
    figure = ensemble_figure(result, SHOWN)
    figure.savefig(HERE / "ensemble.png", dpi=110)
    tiers = [sum(row.tier == tier for row in result.targets) for tier in TIERS]
    return {"stars": len(result.targets), "tiers": tiers}


def first_stars(setting: RankSetting, number: int) -> Targets:
    """The first stars of the default ranking."""
    targets = rank_sample()
    found = ranked(setting, targets, brief=True)
    return targets.select(np.array(ranked_order(found, targets)[:number]))


def cost() -> dict[str, Any]:
    """Processor time of 200 instruments and 100 stars."""
    setting = nominal()
    stars, ensemble = first_stars(setting, 100), load_ensemble()
    choice = EnsembleChoice(ensemble, N, 1)
    drawn = choice.draws()
    draws = [{key: float(values[i]) for key, values in drawn.items()} for i in range(N)]
    standings(setting, stars, choice, draws[:2])  # compiled, and states read
    began, wall = time.process_time(), time.perf_counter()
    standings(setting, stars, choice, draws)
    return {"processor_s": time.process_time() - began, "wall_s": time.perf_counter() - wall}


def seeds() -> dict[str, Any]:
    """Median ranks of the first stars, for other draws of instruments."""
    rows = {}
    for seed in SEEDS:
        setting = nominal()
        stars = first_stars(setting, 60)
        choice = EnsembleChoice(load_ensemble(), N, seed)
        drawn = choice.draws()
        draws = [{key: float(values[i]) for key, values in drawn.items()} for i in range(N)]
        found = standings(setting, stars, choice, draws)
        median = np.quantile(found.rank, 0.5, axis=0, method="inverted_cdf")
        reached = found.detected.mean(axis=0)
        rows[str(seed)] = {
            str(name): [float(a), float(b)] for name, a, b in zip(stars.name, median, reached, strict=True)
        }
    return rows


def bars() -> list[dict[str, Any]]:
    """The five longest bars beside rankings of the whole catalogue, each by a model built for it alone."""
    kept = RankResult.model_validate_json(RANKING.read_text(encoding="utf-8"))
    assert kept.ensemble is not None
    setting, ensemble, targets = nominal(), load_ensemble(), rank_sample()
    states, rows = states_of(setting.model, ensemble), []
    for bar in kept.ensemble.bars[:5]:
        ends = ensemble.numbers[bar.key].law.quantile(np.array([0.05, 0.95])).tolist()
        row: dict[str, Any] = {"label": bar.label, "bars": [bar.planets_low, bar.planets_high], "whole": []}
        for end in ends:
            model = instrument_of(setting.model, ensemble, states, {bar.key: end})
            found = ranked(replace(setting, model=model), targets)
            counted = np.stack([part.counted for part in found.counted])[found.picked, np.arange(len(targets))]
            rate = (setting.population.record().planets_per_star or 1.0) * (end if bar.key == OCCURRENCE else 1.0)
            row["whole"].append(float(rate * counted.sum()))
        rows.append(row)
    return rows


def between() -> list[dict[str, Any]]:
    """Mixtures of states of the mirror beside states that were measured there."""
    setting = nominal()
    base, stars, rows = setting.model, first_stars(setting, 40), []
    for level in BETWEEN:
        mixed, measured = {}, {}
        for band in base.bands:
            measured[band] = psf_metrics(sensed_with(base.instrument, band, level), band)
            mixed[band] = at_contrast(measured_states(base.instrument, band), mean_contrast(measured[band]))
        two = [
            ranked(replace(setting, model=replace(base, metrics=metrics)), stars, brief=True)
            for metrics in (mixed, measured)
        ]
        planets = [
            float(np.stack([part.counted for part in one.counted])[one.picked, np.arange(len(stars))].sum())
            for one in two
        ]
        margins = two[0].best.margin[:12] / two[1].best.margin[:12]
        rows.append(
            {
                "level": level,
                "contrast": [mean_contrast(item) for item in measured.values()],
                "planets": planets[0] / planets[1],
                "margins": [float(value) for value in np.quantile(margins, [0.0, 0.5, 1.0])],
                "detected": [int(np.count_nonzero(one.best.detected)) for one in two],
            }
        )
    return rows


def detects(model: EtcModel, star: Targets, time_s: float, visits: int | None = None) -> bool:
    """Whether one star's reference planet is detected: the whole model, asked as for a ranking."""
    if visits is not None:
        model = replace(model, strategy=Strategy.model_validate(model.strategy.model_dump() | {"visits": visits}))
    setting = RankSetting.of(model, time_s=time_s)
    return bool(ranked(setting, star, brief=True).best.detected[0])


def halved(holds: Callable[[float], bool], low: float, high: float) -> float | None:
    """The end, in logarithms, of the values from ``low`` on that hold; None where not even ``low`` does."""
    if not holds(low):
        return None
    if holds(high):
        return high
    for _ in range(_STEPS):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def required() -> list[dict[str, Any]]:
    """What 30 stars lack, beside a search over the whole model: drift, time and visits, each changed alone."""
    model, targets = build_model(load_instrument()), rank_sample()
    result = rank_targets()
    wanted = [row for row in result.targets if row.required_drift_factor is not None or row.required_visits is not None]
    index = {str(name): i for i, name in enumerate(targets.name)}
    rows = []
    for row in wanted[:SHOWN]:
        star = targets.select([index[row.name]])
        visits = None
        one_band = build_model(load_instrument(), [row.band])
        if row.required_visits is not None and row.visit_time_s is not None:
            length = row.visit_time_s

            def enough(number: float, model: EtcModel = one_band, star: Targets = star, length: float = length) -> bool:
                return detects(model, star, round(number) * length, round(number))

            visits = next((n for n in range(max(1, row.required_visits // 2), 1001) if enough(n)), None)
        drift = halved(lambda f, star=star: detects(_drifting(f), star, TIME_S), 1e-4, 1.0)  # type: ignore[misc]
        least = halved(lambda x, star=star: detects(model, star, LONGEST_S / x), 1.0, LONGEST_S / 1e3)  # type: ignore[misc]
        rows.append(
            {
                "star": row.name,
                "limited_by": row.limited_by,
                "drift": [row.required_drift_factor, drift],
                "time": [row.required_time_s, None if least is None else LONGEST_S / least],
                "visits": [row.required_visits, visits],
            }
        )
        print(rows[-1], flush=True)
    return rows


def _drifting(factor: float) -> EtcModel:
    drift = load_instrument().drift
    changed = {"visit_nm": factor * drift.visit_nm, "walk_nm_per_sqrt_hour": factor * drift.walk_nm_per_sqrt_hour}
    return build_model(load_instrument().changed({"drift": changed}))


PARTS: dict[str, Callable[[], Any]] = {
    "ranking": ranking,
    "cost": cost,
    "seeds": seeds,
    "bars": bars,
    "between": between,
    "required": required,
}


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A table of Markdown."""
    lines = [list(head), ["---"] * len(head), *[[str(cell) for cell in row] for row in rows]]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _factor(value: float | None) -> str:
    return "" if value is None else significant(value, 2)


def _time(value: float | None) -> str:
    return "" if value is None else duration_text(value)


def priorities_part(rank: RankResult, counts: dict[str, Any]) -> list[str]:
    """The first stars and what decides."""
    ensemble = rank.ensemble
    assert ensemble is not None
    rows = [
        [
            row.rank,
            pretty_name(row.name),
            row.tier,
            _time(row.detection_time_s),
            row.detection_visits or "",
            row.limited_by,
            _factor(row.required_drift_factor),
            _factor(row.required_contrast_factor),
            f"{row.expected_planets:.2g}",
            f"{row.expected_planets_unconditional:.2g}",
            f"{100 * (row.p_reachable or 0):.0f} %",
            f"{row.rank_median:.0f} ({row.rank_p05:.0f} to {row.rank_p95:.0f})",
            f"{100 * (row.p_rank_le_10 or 0):.0f} %",
        ]
        for row in rank.targets[:SHOWN]
    ]
    head = ["rank", "star", "tier", "time to detect", "visits", "limited by", "drift factor", "planet factor"]
    head += ["expected planets", "of all", "reachable", "median rank (5 to 95 %)", "first ten"]
    tiers = "; ".join(
        f"tier {t}: {text} ({n} stars)" for (t, text), n in zip(TIERS.items(), counts["tiers"], strict=True)
    )
    return [
        f"# Which stars first, and how sure\n\n{ensemble.statement}",
        f"The first {SHOWN} of {counts['stars']} stars of the default question (`cpic rank --instruments {N}`): a "
        "planet of 1 Jupiter radius at quadrature, found blind within 10 h; expected planets of the population "
        f"`giants`, one observation of each star, without and with those that are already excluded. {tiers}. Time to "
        "detect and visits: the least that detect the reference planet. Drift and planet factor: the change of the "
        "drift, or of the planet's light, that would detect it in 10 h, each alone. Reachable: the share of "
        f"{N} instruments that detect it in 10 h.",
        table(head, rows),
        "![ranks over the ensemble, and what the expected planets hang on](ensemble.png)",
    ]


def checks_part(found: dict[str, Any], rank: RankResult) -> list[str]:
    """The checks of what is new in the numbers above."""
    assert rank.ensemble is not None
    parts = ["## Checks"]
    if "cost" in found:
        took = found["cost"]
        parts.append(
            f"**Cost.** {N} instruments and 100 stars: {took['processor_s']:.0f} s of one processor "
            f"({took['wall_s']:.0f} s of wall time)."
        )
    if "seeds" in found:
        names = [row.name for row in rank.targets[:FIRST]]
        medians = {name: [found["seeds"][str(seed)][name] for seed in SEEDS] for name in names}
        spread = max(max(m for m, _ in values) - min(m for m, _ in values) for values in medians.values())
        rows = [
            [pretty_name(name), *(f"{m:.0f}" for m, _ in values), *(f"{100 * p:.0f} %" for _, p in values)]
            for name, values in medians.items()
        ]
        head = ["star", *(f"median rank, seed {s}" for s in SEEDS), *(f"reachable, seed {s}" for s in SEEDS)]
        parts += [
            f"**Other draws.** Median ranks of the first {FIRST} stars among the first 60, for {len(SEEDS)} draws of "
            f"{N} instruments; they differ by at most {spread:.0f}.",
            table(head, rows),
        ]
    if "bars" in found:
        rows, worst = [], 0.0
        for row in found["bars"]:
            ratios = [bar / whole for bar, whole in zip(row["bars"], row["whole"], strict=True)]
            worst = max(worst, *(abs(ratio - 1.0) for ratio in ratios))
            rows.append([row["label"], *(f"{v:.3g}" for v in (*row["bars"], *row["whole"]))])
        head = ["number", "bar, low", "bar, high", "whole catalogue, low", "whole catalogue, high"]
        parts += [
            "**Bars.** The five longest bars beside rankings of all stars with that one number changed: they differ by "
            f"at most {100 * worst:.1f} %.",
            table(head, rows),
        ]
    if "between" in found:
        rows = [
            [
                row["level"],
                ", ".join(f"{value:.2g}" for value in row["contrast"]),
                f"{row['planets']:.3f}",
                ", ".join(f"{value:.2f}" for value in row["margins"]),
                "{} and {}".format(*row["detected"]),
            ]
            for row in found["between"]
        ]
        head = ["error of sensing", "mean contrast by band", "expected planets", "margins: least, median, most"]
        parts += [
            "**Between the states of the mirror.** Dark holes dug and measured anew with errors of sensing between "
            "those of the grid (in units of the published instrument's), beside the mixture of the same mean contrast: "
            "ratio of expected planets of 40 stars, of the margins of the first 12, and detected reference planets. "
            "Where a search for a hole happens to end leaves more light at one edge and less at another, which no grid "
            "tells: single margins differ by up to a quarter, the numbers of planets by a few per cent.",
            table([*head, "detected: mixture and measured"], rows),
        ]
    if "required" in found:
        rows, worst = [], {"drift": 0.0, "time": 0.0, "visits": 0.0}
        for row in found["required"]:
            cells = []
            for name, text in (("drift", _factor), ("time", _time), ("visits", str)):
                said, searched = row[name]
                cells += ["" if value is None else text(value) for value in (said, searched)]
                if said is not None and searched is not None:
                    worst[name] = max(worst[name], abs(said / searched - 1.0))
            rows.append([pretty_name(row["star"]), row["limited_by"], *cells])
        head = ["star", "limited by", "drift factor", "searched", "time", "searched", "visits", "searched"]
        parts += [
            f"**What is missing.** What {len(rows)} stars lack for a detection, as the ranking says it and by a search "
            "over the whole model, one number changed at a time. Largest differences: "
            + ", ".join(f"{name} {100 * value:.1f} %" for name, value in worst.items())
            + ".",
            table(head, rows),
        ]
    return parts


def write() -> None:
    """Write the report of what is there."""
    found = json.loads(RESULTS.read_text(encoding="utf-8"))
    rank = RankResult.model_validate_json(RANKING.read_text(encoding="utf-8"))
    parts = [*priorities_part(rank, found["ranking"]), *checks_part(found, rank)]
    parts.append("Made by `python reports/priorities/make.py`.")
    write_text(HERE / "report.md", "\n\n".join(parts) + "\n")


def main() -> None:
    """Measure, and write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=tuple(PARTS), action="append", help="measure this part alone")
    chosen = parser.parse_args().only or tuple(PARTS)
    found = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.is_file() else {}
    for name in chosen:
        found[name] = PARTS[name]()
        write_json(RESULTS, found)
    if RANKING.is_file():
        write()


if __name__ == "__main__":
    main()
