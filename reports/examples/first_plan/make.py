"""The first plan: ``python -m tools.reports first_plan`` makes this report anew.

Runs the main job on the embedded catalogue with the default settings and writes the figures that the README shows
and the numbers that it quotes.
"""

from __future__ import annotations

import os
import platform
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cpic_core import write_bytes, write_text
from cpic_planner.confirm import make_plan
from cpic_planner.confirm.plan import prepare_plan
from cpic_planner.etc import build_model
from cpic_planner.queries import PlanQuestion
from cpic_planner.report.files import panels_of
from cpic_planner.report.image_figures import PanelSheet
from cpic_planner.report.words import pretty_name, tau_text
from cpic_planner.results import PlanResult, SensitivityResult
from simulator.config import load_instrument
from tools.report_parts import Cells, columns, table, write_picture

HERE = Path(__file__).resolve().parent
TOP = 5
LISTED = 12
SHOWN = ("eps Eri", "F520")


def cold_seconds(arguments: list[str], runs: int = 5) -> list[float]:
    """Processor times of a command from a cold interpreter."""
    times = []
    for _ in range(runs):
        began = processor_s()
        subprocess.run([sys.executable, "-m", "cpic_planner.cli.main", *arguments], check=True, capture_output=True)
        times.append(processor_s() - began)
    return times


def processor_s() -> float:
    """Processor time of this process and of its children that have ended."""
    return sum(os.times()[:4])


def confirmed(plan: PlanResult) -> str:
    """One line per confirmed target and band."""
    heads = ["target", "band", "separation (arcsec)", "contrast, true", "contrast, recovered", "frames x exposure (s)"]
    heads += ["EM gain", "wall (h)", "SNR predicted", "SNR recovered", "verdict"]
    form = (
        "{0.true_contrast:.2e}|{0.recovered_contrast:.2e} +- {0.contrast_error:.1e}|{0.n_frames} x {0.exposure_s:.1f}|"
        "{0.em_gain:.0f}|{1:.2f}|{0.predicted_snr:.1f}|{0.recovered_snr:.1f}|{0.verdict}"
    )
    rows = []
    for target in plan.targets:
        for band in target.bands:
            mark = "**" if band.band == target.chosen_band else ""
            measured = band.recovered_snr is not None
            cells = form.format(band, band.time_s / 3600).split("|") if measured else [*[""] * 7, band.reason]
            rows.append([f"{mark}{pretty_name(target.name)}{mark}", band.band, f"{band.separation_arcsec:.3f}", *cells])
    return table(heads, rows)


def given(form: str, name: str, unit: float = 1.0) -> Callable[[Any], str]:
    """Write a number of a row where there is one."""
    return lambda row: "" if getattr(row, name) is None else form.format(getattr(row, name) / unit)


RANKED: Cells = {
    "rank": "{0.rank}",
    "star": lambda row: pretty_name(row.name),
    "score (1/h)": "{0.score:.3g}",
    "completeness": "{0.completeness:.4f} +- {0.completeness_error:.4f}",
    "band": "{0.completeness_band}",
    "wall (h)": given("{:.2f}", "completeness_time_s", 3600.0),
    "reference planet: band": "{0.band}",
    "margin": "{0.detection_margin:.2f}",
    "least time of detection (s)": given("{:.0f}", "detection_time_s"),
    "faintest contrast": given("{:.1e}", "deepest_limit"),
}


def undetected(counts: dict[str, int]) -> str:
    """How many reference planets are limited by what."""
    meaning = {
        "speckles": "detected if the wavefront did not drift",
        "background": "detected if there were no noise but their own and the speckles",
        "photons": "too faint even then",
    }
    shown = dict.fromkeys(meaning, 0) | {name: count for name, count in counts.items() if name != "none"}
    return ", ".join(
        f"{count} limited by {name}" + (f" ({meaning[name]})" if name in meaning else "")
        for name, count in shown.items()
    )


def fall(row: Any) -> str:
    """The star that falls farthest."""
    if not row.largest_fall:
        return ""
    return f"{pretty_name(row.largest_fall)}: {row.largest_fall_ranks} rank{'s' * (row.largest_fall_ranks > 1)}"


def assumptions(firm: SensitivityResult) -> list[str]:
    """The ranking under other assumptions."""
    cells: Cells = {
        "instead": "{0.text}",
        "reference planets detected": f"{{0.n_ok}} (nominal {firm.n_ok})",
        f"kept of first {firm.first}": "{0.kept_first}",
        f"kept of first {firm.top}": "{0.kept}",
        "Kendall's tau-b": given("{:.2f}", "kendall_tau_b"),
        "stars compared": "{0.n_compared}",
        "largest fall": fall,
    }
    return [columns(firm.rows, cells), "", firm.statement, "", f"Tau: {tau_text(firm.top)}."]


def main() -> None:
    """Run the plan and write ``report.md``, figures and ``plan.json``."""
    config = PlanQuestion(instrument=load_instrument(), top=TOP)
    model = build_model(config.instrument)
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "plan"
        began = processor_s()
        done = make_plan(config, out)
        plan_s = processor_s() - began
        plan, rank = done.result, prepare_plan(config, "snapshot").rank
        write_bytes(HERE / "plan.json", (out / "plan.json").read_bytes())
        firm = SensitivityResult.model_validate_json((out / "sensitivity.json").read_text(encoding="utf-8"))
    body = done.bodies[f"{SHOWN[0]} {SHOWN[1]}"]
    write_picture(HERE, "panels", PanelSheet().picture(panels_of(model, SHOWN[1], body), SHOWN[0]))
    cold = {
        "cpic etc 'tau Cet' --snr 5": cold_seconds(["etc", "tau Cet", "--snr", "5"]),
        "cpic rank": cold_seconds(["rank"]),
    }
    ratio, error, count = (plan.calibration[name] for name in ("etc_ratio", "etc_ratio_error", "n_bands"))
    planets = rank.population
    lines = [
        "# The first plan",
        "",
        "Regenerate with `python -m tools.reports first_plan`; everything below is written by it.",
        "",
        f"`cpic plan --top {TOP}` on the embedded catalogue: {plan.n_ranked} stars ranked, "
        f"{plan.counts.get('ok', 0)} with a reference planet (1 R_J, phase 90 deg, Jupiter's albedo) detected within "
        f"{plan.time_s / 3600:g} h of wall time per band, the first {TOP} confirmed with simulated images.",
        f"Reference planets that are not detected: {undetected(plan.counts_limited_by)}.",
        f"Predicted over recovered SNR: {ratio:.2f} +- {error:.2f} over {count} measurements, "
        f"{plan.realisations} realisations of drift and noise each.",
        "",
        "## Ranking",
        "",
        f"Score: completeness per hour, for {planets.n_planets} planets of the population `{planets.name}`.",
        "",
        columns(rank.targets[:LISTED], RANKED),
        "",
        "## What if",
        "",
        *assumptions(firm),
        "",
        "## Confirmed with images",
        "",
        confirmed(plan),
        "",
        "Bold: the band to observe in. Recovered numbers are means over the realisations; the error of a contrast is",
        "that of one observation. In brackets: realisations in which the blind search finds the planet.",
        "",
        f"![{SHOWN[0]}, {SHOWN[1]}](panels.png)",
        "",
        "## Times",
        "",
        "| processor time of | median (s) | min to max (s) |",
        "|---|---|---|",
        *(
            f"| `{name}`, cold, 5 runs | {statistics.median(t):.2f} | {min(t):.2f} to {max(t):.2f} |"
            for name, t in cold.items()
        ),
        f"| plan of {TOP} targets x 4 bands, 1 run | {plan_s:.0f} | |",
        "",
        f"Machine: {platform.machine()}, Python {platform.python_version()}.",
        "",
    ]
    write_text(HERE / "report.md", "\n".join(lines))
    print(HERE / "report.md")


if __name__ == "__main__":
    main()
