"""Survey what-ifs: ``python -m tools.reports whatif`` makes this report anew.

``-- --only STUDY`` measures one part again and keeps the others, which are in ``results.json``.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent))

import decision
import optics
import runs
import seasons
import studies

from cpic_core import write_text
from cpic_core.files import write_json
from tools.report_parts import table, write_picture

HERE = Path(__file__).resolve().parent
PARTS: dict[str, Callable[[], Any]] = {
    "geometry": studies.geometry,
    "one_visit": studies.one_visit,
    "completeness": studies.completeness_check,
    "decision": lambda: decision.run(HERE),
    "optics": optics.run,
    "seasons": seasons.run,
    "coverage": studies.coverage,
    "kills": runs.kills,
}


def facts_part() -> list[str]:
    """What each fact moved in the default run: the statement of the run, and a table for each kind of planets."""
    found = decision.default_result(HERE)
    facts = found.facts
    assert facts is not None
    rows = {(row.strategy, row.fact): row for row in facts.rows}
    head = ["strategy", "all facts", *(fact.heading for fact in facts.facts)]
    parts = [
        "## Which fact moved which number\n\n"
        "The five default strategies planned and played again as if one fact were not known, in the same "
        f"{found.universe['universes']} universes, and the change with its 90 % interval. {facts.statement}"
    ]
    for name, title in (("planets", "all planets"), ("new_planets", "new planets"), ("known_planets", "known planets")):
        body = []
        for item in found.strategies:
            mean = getattr(item, name).mean
            own = [rows[item.name, fact.name] for fact in facts.facts]
            cells = [(getattr(row, name).mean, getattr(row, f"{name}_change")) for row in own]
            body.append(
                [
                    item.name,
                    f"{mean:.3f}",
                    *(f"{value:.3f} ({change.low:+.3f} to {change.high:+.3f})" for value, change in cells),
                ]
            )
        parts.append(f"Found in a survey, {title}:\n\n{table(head, body)}")
    return parts


def checks(found: dict[str, Any]) -> list[tuple[str, str, str, bool]]:
    """What was asked, what was found, and whether that is enough."""
    run, cover = found["default_run"], found["coverage"]["rows"]
    worst = [min(row["covered"] for row in cover), max(row["covered"] for row in cover)]
    brute = max(abs(row["survey"] / row["brute_force"] - 1.0) for row in found["completeness"])
    circle = max(abs(row["survey"] - row["closed_form"]) for row in found["geometry"])
    same = sum(abs(row["detected_by_ranking"] / row["detected_in_survey"] - 1.0) < 1e-4 for row in found["one_visit"])
    kills = found["kills"]
    identical = kills["quiet"] == kills["disturbed"] == kills["resumed"] and len(kills["quiet"]) > 0
    return [
        (
            f"processor time of `cpic whatif survey_default`, full catalogue, {run['universes']} universes, images",
            "10 min",
            f"{run['processor_s']:.0f} s",
            run["processor_s"] <= 600.0 and run["status"] == 0,
        ),
        ("memory of all its processes", "4 GB", f"{run['peak_mb'] / 1000:.1f} GB", run["peak_mb"] <= 4000.0),
        (
            f"nominal 90 % intervals of paired differences, {found['coverage']['repeats']} repeats of "
            f"{found['coverage']['universes']} universes, {len(cover)} differences",
            "87 to 93 %",
            f"{worst[0]:.1%} to {worst[1]:.1%}",
            worst[0] >= 0.87 and worst[1] <= 0.93,
        ),
        (
            f"completeness against brute force, {len(found['completeness'])} cases",
            "1 %",
            f"{brute:.2%} at most",
            brute <= 0.01,
        ),
        (
            "share of a circle without noise against the closed form of the squares",
            "equal",
            f"{circle:.1e} at most",
            circle < 2e-5,
        ),
        (
            "one visit of one star against the ranking's completeness, same planets",
            "equal",
            f"{same} of {len(found['one_visit'])} stars equal",
            same == len(found["one_visit"]),
        ),
        (
            "tables after kills of workers, and after a kill of the client",
            "identical",
            f"{'identical' if identical else 'differ'} after {kills['worker_kills']} kills",
            identical and kills["worker_kills"] > 0,
        ),
    ]


def report(found: dict[str, Any]) -> str:
    """The whole text."""
    rows = [(what, asked, got, "yes" if good else "NO") for what, asked, got, good in checks(found)]
    kills = found["kills"]
    parts = [
        "# Survey what-ifs\n\nRegenerate with `python -m tools.reports whatif`; everything below is written by it.",
        table(["", "asked", "found", "met"], rows),
        decision.text(found["decision"]),
        *facts_part(),
        "## What an assumed contrast means\n\n"
        "A brighter dark hole than the instrument's is that of a mirror whose actuators have random errors, "
        "and the metrics of the optics are recomputed. A planet around ε Eri at eight places, "
        f"{optics.REALISATIONS} images each, made with that mirror: predicted over recovered SNR. *By scaled light*: "
        "what the same prediction would be if the light of the nominal hole, which differs across the band, were "
        "multiplied instead. A darker hole is scaled, since no optics are known for it.\n\n"
        + table(*optics.rows(found["optics"])),
        "## When stars can be seen\n\n"
        + seasons.text(found["seasons"])
        + "\n\n"
        + table(*seasons.rows(found["seasons"])),
        "## Does the Monte Carlo count right\n\n"
        "Completeness with one visit and with four over ten years, a million planets each, against a sampler, "
        "orbits and "
        "geometry of `brute_force.py` (noise and core throughput are the calculator's in both).\n\n"
        + table(
            ["star", "visits", "survey", "brute force", "difference", "1 sigma"],
            [
                (
                    row["star"],
                    row["visits"],
                    f"{row['survey']:.4f}",
                    f"{row['brute_force']:.4f}",
                    f"{row['survey'] / row['brute_force'] - 1:+.2%}",
                    f"{row['error']:.2%}",
                )
                for row in found["completeness"]
            ],
        )
        + "\n\nDetections to be expected of one blind visit of a star, of the same planets through `cpic rank`'s "
        "completeness.\n\n"
        + table(
            ["star", "planets", "detected, ranking", "detected, survey"],
            [
                (row["star"], row["planets"], f"{row['detected_by_ranking']:.2f}", f"{row['detected_in_survey']:.2f}")
                for row in found["one_visit"]
            ],
        )
        + "\n\nA circle of planets far above every threshold (F520): share that is seen, and of the quadrants "
        "without the "
        "margin that an aperture needs.\n\n"
        + table(
            ["separation (arcsec)", "survey", "squares less the aperture", "whole squares"],
            [
                (
                    f"{row['separation_arcsec']:.2f}",
                    f"{row['survey']:.5f}",
                    f"{row['closed_form']:.5f}",
                    f"{row['whole_zone']:.3f}",
                )
                for row in found["geometry"]
            ],
        ),
        "## Do the intervals hold\n\n"
        f"{found['coverage']['repeats']} repeats of {found['coverage']['universes']} universes each; truth is the "
        f"mean of all.\n\n"
        + table(
            ["difference", "of", "true mean", "correlation of the two", "held by the 90 % interval"],
            [
                (
                    f"{row['first']} - {row['second']}",
                    row["quantity"].replace("_", " "),
                    f"{row['truth']:+.4f}",
                    f"{row['correlation']:.2f}",
                    f"{row['covered']:.1%}",
                )
                for row in found["coverage"]["rows"]
            ],
        ),
        "## Kills\n\n"
        f"{kills['parts']} parts with two workers, {kills['quiet_s']:.0f} s undisturbed. {kills['worker_kills']} "
        f"workers were "
        f"killed at random in a second run. In a third the client and all its workers were killed when "
        f"{kills['parts_at_kill']} "
        f"parts were on disk; started again it kept {kills['kept_parts']} and made the others.\n\n"
        + table(
            ["table", "undisturbed", "workers killed", "client killed and started again"],
            [
                (name, digest, kills["disturbed"].get(name), kills["resumed"].get(name))
                for name, digest in kills["quiet"].items()
            ],
        ),
    ]
    return "\n\n".join(parts) + "\n"


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Regenerate the report of survey what-ifs.")
    parser.add_argument("--only", nargs="+", choices=["default_run", *PARTS], default=[], help="parts to measure again")
    parser.add_argument("--text", action="store_true", help="write the text again from results.json")
    chosen = parser.parse_args()
    place = HERE / "results.json"
    kept = (chosen.only or chosen.text) and place.exists()
    found: dict[str, Any] = json.loads(place.read_text()) if kept else {}
    wanted = [] if chosen.text else chosen.only or ["default_run", *PARTS]
    if "default_run" in wanted:
        with tempfile.TemporaryDirectory() as scratch:
            found["default_run"] = runs.default_run(Path(scratch))
            shutil.copy(Path(scratch) / "whatif.json", HERE / "whatif.json")
        write_json(place, found)
    for name, part in PARTS.items():
        if name in wanted:
            print(name, flush=True)
            found[name] = part()
            write_json(place, found)
    if set(found) < {"default_run", *PARTS}:
        print("parts are still missing: no text")
        return
    for name, picture in decision.pictures(HERE, found["decision"]).items():
        write_picture(HERE, name, picture)
    write_text(HERE / "report.md", report(found))
    for what, asked, got, good in checks(found):
        print(f"{'met' if good else 'MISSED'}: {what}: asked {asked}, found {got}")


if __name__ == "__main__":
    main()
