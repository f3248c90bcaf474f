"""Speed against accuracy of images: ``python -m tools.reports speed_accuracy`` makes this report anew."""

from __future__ import annotations

import shutil
from pathlib import Path

import light

from cpic_core import dump_json, write_bytes, write_text
from cpic_planner.jobs import run
from cpic_planner.results import TradeoffResult, TradeoffRow
from cpic_planner.tradeoff import RESULT, tradeoff_job
from cpic_planner.tradeoff.run import products_of
from cpic_planner.tradeoff.scenes import SCENES, points_of

HERE = Path(__file__).resolve().parent
ORDERS = 1000.0
ASKED = {"standard": (0.01, 0.03), "quick": (0.05, 0.05)}
SCRATCH = HERE.parents[2] / "out" / "speed_accuracy"


def rows_of(result: TradeoffResult, point: str) -> list[TradeoffRow]:
    """One way on every scene of a single visit."""
    programmes = {scene.name for scene in result.scenes if scene.is_programme}
    return [row for row in result.rows if row.point == point and row.scene not in programmes]


def beyond(row: TradeoffRow, flux: float, snr: float) -> bool:
    """Whether a row misses what was asked by more than it can be measured (two standard errors)."""
    if row.status != "ok":
        return False
    off = [(row.flux_error, row.flux_uncertainty, flux), (row.snr_error, row.snr_uncertainty, snr)]
    return any(abs(value or 0.0) - 2.0 * (error or 0.0) > asked for value, error, asked in off)


def check(result: TradeoffResult) -> list[tuple[str, str, str, bool]]:
    """What was asked, what was found, and whether that is enough."""
    single = {scene.name for scene in result.scenes if not scene.is_programme}
    least = min((ratio for name, ratio in result.speed_ups.items() if name in single), default=0.0)
    checks = [
        (
            "wall clock of the reference over that of one call of the closed forms, least of the scenes",
            f"at least {ORDERS:g}",
            f"{least:.0f}",
            least >= ORDERS,
        )
    ]
    for name, (flux, snr) in ASKED.items():
        rows = rows_of(result, name)
        good = [row for row in rows if row.status == "ok"]
        worst = [
            max((abs(getattr(row, f"{part}_error") or 0.0) for row in good), default=0.0) for part in ("flux", "snr")
        ]
        errors = max((row.snr_uncertainty or 0.0 for row in good), default=0.0)
        invalid = [row.scene for row in rows if row.status != "ok"]
        found = f"flux {worst[0]:.2%}, SNR {worst[1]:.1%} (known to {errors:.1%}) at most"
        if invalid:
            found += f"; typed not valid: {', '.join(invalid)}"
        met = bool(rows) and not any(beyond(row, flux, snr) for row in rows)
        if name == "standard":
            met = met and not invalid
        checks.append(
            (f"`{name}` against the reference, {len(rows)} scenes", f"flux {flux:.0%}, SNR {snr:.0%}", found, met)
        )
    return checks


def head(result: TradeoffResult) -> str:
    """The first lines of the report."""
    lines = [
        f"| {name} | {asked} | {found} | {'yes' if met else '**no**'} |" for name, asked, found, met in check(result)
    ]
    table = "\n".join(["| | asked | found | met |", "|---|---|---|---|", *lines])
    return f"""
Regenerate with `python -m tools.reports speed_accuracy`, or on your own machine with `cpic tradeoff`; everything below
is written by it, and [results.csv](results.csv) holds every row.

{table}

"Met" allows two standard errors of the measurement. Tolerances, single knobs and effects, and programmes with modes are
left out here; `cpic tradeoff` has them.
{light.section()}"""


def main() -> None:
    """Measure, check, write."""
    light.measure()
    every = ((case, points_of(case, main_only=True)) for case in SCENES.values() if not case.how.n_modes)
    work = [(case, tuple(point for point in points if point.group != "tolerance")) for case, points in every]
    shutil.rmtree(SCRATCH, ignore_errors=True)
    write(run(tradeoff_job(work), SCRATCH).result)


def write(result: TradeoffResult) -> None:
    """Write the files and say what was met."""
    write_text(HERE / RESULT, dump_json(result.model_dump(mode="json")))
    for name, content in products_of(result, head=head(result)).items():
        write_bytes(HERE / name, content)
    for name, asked, found, met in check(result):
        print(f"{'met' if met else 'MISSED'}: {name}: asked {asked}, found {found}")
    print(HERE / "report.md")


if __name__ == "__main__":
    main()
