"""Which stars first, and how sure that is: ``python -m tools.reports priorities`` makes this report anew."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from cpic_core import write_text
from cpic_planner import rank_targets
from cpic_planner.report.ranking import TIERS
from cpic_planner.report.ranking_figures import ensemble_figure
from cpic_planner.report.words import duration_text, pretty_name, significant
from cpic_planner.results import RankResult
from tools.report_parts import table

HERE = Path(__file__).resolve().parent
N, SHOWN = 200, 30


def _factor(value: float | None) -> str:
    return "" if value is None else significant(value, 2)


def _time(value: float | None) -> str:
    return "" if value is None else duration_text(value)


def priorities_part(rank: RankResult) -> list[str]:
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
    counts = Counter(row.tier for row in rank.targets)
    tiers = "; ".join(f"tier {tier}: {text} ({counts[tier]} stars)" for tier, text in TIERS.items())
    return [
        f"# Which stars first, and how sure\n\n{ensemble.statement}",
        f"The first {SHOWN} of {len(rank.targets)} stars of the default question (`cpic rank --instruments {N}`): a "
        "planet of 1 Jupiter radius at quadrature, found blind within 10 h; expected planets of the population "
        f"`giants`, one observation of each star, without and with those that are already excluded. {tiers}. Time to "
        "detect and visits: the least that detect the reference planet. Drift and planet factor: the change of the "
        "drift, or of the planet's light, that would detect it in 10 h, each alone. Reachable: the share of "
        f"{N} instruments that detect it in 10 h.",
        table(head, rows),
        "![ranks over the ensemble, and what the expected planets hang on](ensemble.png)",
    ]


def main() -> None:
    """Rank under the ensemble, and write figure and report."""
    rank = rank_targets(instruments=N)
    ensemble_figure(rank, SHOWN).savefig(HERE / "ensemble.png", dpi=110)
    parts = [*priorities_part(rank), "Made by `python -m tools.reports priorities`."]
    write_text(HERE / "report.md", "\n\n".join(parts) + "\n")


if __name__ == "__main__":
    main()
