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
from pathlib import Path

from cpic_core import write_bytes, write_text
from cpic_planner.confirm import make_plan
from cpic_planner.confirm.plan import prepare_plan
from cpic_planner.etc import build_model
from cpic_planner.jobs.folder import open_run_folder
from cpic_planner.queries import PlanQuestion
from cpic_planner.report.files import hole_edges, limit_curves, panels_of
from cpic_planner.report.image_figures import panel_picture, snr_figure
from cpic_planner.report.ranking_figures import contrast_diagram
from cpic_planner.report.words import pretty_name, tau_text
from cpic_planner.results import PlanResult, RankResult, SensitivityResult
from simulator.config import load_instrument
from tools.report_parts import write_picture

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


def table(plan: PlanResult) -> list[str]:
    """One line per confirmed target and band."""
    lines = [
        "| target | band | separation (arcsec) | contrast, true | contrast, recovered | frames x exposure (s) "
        "| EM gain | wall (h) | SNR predicted | SNR recovered | verdict |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for target in plan.targets:
        for band in target.bands:
            mark = "**" if band.band == target.chosen_band else ""
            name = f"{mark}{pretty_name(target.name)}{mark}"
            if band.recovered_snr is None:
                lines.append(f"| {name} | {band.band} | {band.separation_arcsec:.3f} | | | | | | | | {band.reason} |")
                continue
            lines.append(
                f"| {name} | {band.band} | {band.separation_arcsec:.3f} | {band.true_contrast:.2e} "
                f"| {band.recovered_contrast:.2e} +- {band.contrast_error:.1e} "
                f"| {band.n_frames} x {band.exposure_s:.1f} | {band.em_gain:.0f} | {band.time_s / 3600:.2f} "
                f"| {band.predicted_snr:.1f} | {band.recovered_snr:.1f} | {band.verdict} |"
            )
    return lines


def ranking(rank: RankResult) -> list[str]:
    """The first stars, with what makes their score."""
    planets = rank.population
    lines = [
        f"Score: completeness per hour, for {planets.n_planets} planets of the population `{planets.name}`.",
        "",
        "| rank | star | score (1/h) | completeness | band | wall (h) | reference planet: band | margin "
        "| least time of detection (s) | faintest contrast |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rank.targets[:LISTED]:
        least = "" if row.detection_time_s is None else f"{row.detection_time_s:.0f}"
        wall = "" if row.completeness_time_s is None else f"{row.completeness_time_s / 3600:.2f}"
        limit = "" if row.deepest_limit is None else f"{row.deepest_limit:.1e}"
        lines.append(
            f"| {row.rank} | {pretty_name(row.name)} | {row.score:.3g} | {row.completeness:.4f} +- "
            f"{row.completeness_error:.4f} | {row.completeness_band} | {wall} | {row.band} "
            f"| {row.detection_margin:.2f} | {least} | {limit} |"
        )
    return lines


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


def assumptions(firm: SensitivityResult) -> list[str]:
    """The ranking under other assumptions."""
    lines = [
        f"| instead | reference planets detected | kept of first {firm.first} | kept of first {firm.top} "
        "| Kendall's tau-b | stars compared | largest fall |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in firm.rows:
        tau = "" if row.kendall_tau_b is None else f"{row.kendall_tau_b:.2f}"
        fall = (
            f"{pretty_name(row.largest_fall)}: {row.largest_fall_ranks} rank{'s' * (row.largest_fall_ranks > 1)}"
            if row.largest_fall
            else ""
        )
        lines.append(
            f"| {row.text} | {row.n_ok} (nominal {firm.n_ok}) | {row.kept_first} | {row.kept} | {tau} "
            f"| {row.n_compared} | {fall} |"
        )
    return [*lines, "", firm.statement, "", f"Tau: {tau_text(firm.top)}."]


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
        with open_run_folder(out, kind="plan", config_hash=plan.config_hash) as folder:
            body = folder.part(f"{SHOWN[0]} {SHOWN[1]}")
    assert body is not None
    confirmed = tuple(target.name for target in plan.targets)
    contrasts = contrast_diagram(rank, limits=limit_curves(plan, model), holes=hole_edges(model), confirmed=confirmed)
    diagram = write_picture(HERE, "contrast", contrasts)
    snr = write_picture(HERE, "snr", snr_figure(plan))
    write_picture(HERE, "panels", panel_picture(panels_of(model, SHOWN[1], body), SHOWN[0]))
    cold = {
        "cpic etc 'tau Cet' --snr 5": cold_seconds(["etc", "tau Cet", "--snr", "5"]),
        "cpic rank": cold_seconds(["rank"]),
    }
    ratio, error, count = (plan.calibration[name] for name in ("etc_ratio", "etc_ratio_error", "n_bands"))
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
        *ranking(rank),
        "",
        "## What if",
        "",
        *assumptions(firm),
        "",
        "## Confirmed with images",
        "",
        *table(plan),
        "",
        "Bold: the band to observe in. Recovered numbers are means over the realisations; the error of a contrast is",
        "that of one observation. In brackets: realisations in which the blind search finds the planet.",
        "",
        f"![contrast against separation]({diagram})",
        "",
        f"![{SHOWN[0]}, {SHOWN[1]}](panels.png)",
        "",
        f"![predicted and recovered SNR]({snr})",
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
