"""Survey what-ifs: ``python -m tools.reports whatif`` makes this report anew.

``-- --only STUDY`` measures one part again and keeps the others, which are in ``results.json``.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import optics
import studies

from cpic_core import dump_json, write_bytes, write_text
from cpic_planner.report.whatif_figures import whatif_figures
from cpic_planner.results import WhatIfResult
from cpic_planner.survey.visibility import load_visibility, visibility_result
from cpic_planner.targets import rank_sample
from simulator import load_instrument
from tools.report_parts import columns, verdict, write_picture

HERE = Path(__file__).resolve().parent
UNIVERSES, WORKERS, YEAR = 1000, 2, 366
PICTURES = {
    "yields": "Planets of each strategy",
    "curves": "Planets against telescope time",
    "time": "Where the time goes",
    "calendar": "When which star is visited",
}


def default_run() -> dict[str, Any]:
    """The command as a user types it, with images: processor time of all its processes."""
    with tempfile.TemporaryDirectory() as out:
        command = [sys.executable, "-m", "cpic_planner.cli.main", "whatif", "survey_default", "--out", out, "--json"]
        command += ["--universes", str(UNIVERSES), "--workers", str(WORKERS)]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        _, ended, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(ended)
        write_bytes(HERE / "whatif.json", Path(out, "whatif.json").read_bytes())
    spent = usage.ru_utime + usage.ru_stime
    return {"status": process.returncode, "processor_s": spent, "universes": UNIVERSES}


def seasons() -> dict[str, Any]:
    """Days and minutes of every star of the ranking in the first year of the mission."""
    mission, stars = load_instrument().mission, rank_sample()
    found = visibility_result(stars, load_visibility(), mission.orbit, start_utc=mission.start_utc, n_days=YEAR)
    quarters = [0.0, 0.25, 0.5, 0.75, 1.0]
    return {
        "stars": len(stars),
        "start_utc": found.start_utc,
        "period_min": found.period_s / 60.0,
        "days": np.quantile([item.observable_days for item in found.targets], quarters).tolist(),
        "minutes": np.quantile([(item.visible_s or 0.0) / 60.0 for item in found.targets], quarters).tolist(),
    }


PARTS: dict[str, Callable[[], Any]] = {
    "default_run": default_run,
    "geometry": studies.geometry,
    "one_visit": studies.one_visit,
    "completeness": studies.completeness_check,
    "optics": optics.run,
    "seasons": seasons,
    "coverage": studies.coverage,
}


def checks(found: dict[str, Any]) -> list[tuple[str, str, str, bool]]:
    """What was asked, what was found, and whether that is enough."""
    run, cover, cases = found["default_run"], found["coverage"], found["completeness"]
    shares = [row["covered"] for row in cover["rows"]]
    brute = max(abs(row["survey"] / row["brute_force"] - 1.0) for row in cases)
    circle = max(abs(row["survey"] - row["closed_form"]) for row in found["geometry"])
    same = sum(abs(row["detected_by_ranking"] / row["detected_in_survey"] - 1.0) < 1e-4 for row in found["one_visit"])
    return [
        (
            f"processor time of `cpic whatif survey_default`, full catalogue, {run['universes']} universes, images",
            "10 min",
            f"{run['processor_s']:.0f} s",
            run["processor_s"] <= 600.0 and run["status"] == 0,
        ),
        (
            f"nominal 90 % intervals of paired differences, {cover['repeats']} repeats of "
            f"{cover['universes']} universes, {len(shares)} differences",
            "87 to 93 %",
            f"{min(shares):.1%} to {max(shares):.1%}",
            min(shares) >= 0.87 and max(shares) <= 0.93,
        ),
        (f"completeness against brute force, {len(cases)} cases", "1 %", f"{brute:.2%} at most", brute <= 0.01),
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
    ]


def images_of(item: Any) -> str:
    """How many of the detections that were imaged are found there."""
    images = item.images
    if images is None or images.correction is None:
        return "" if images is None else images.note
    return (
        f"{images.found} of {images.expected:.1f} expected in {images.images} images: "
        f"{images.correction:.2f} ({images.low:.2f} to {images.high:.2f})"
    )


def strategies(result: WhatIfResult) -> str:
    """The default strategies: tables and pictures."""
    cells = {
        "strategy": "{0.name}",
        "stars": lambda item: len(item.targets),
        "visits planned": "{0.schedule.visits}",
        "hours used": "{0.hours.mean:.0f}",
        "planets": "{0.planets.mean:.2f} ({0.planets.low:.2f} to {0.planets.high:.2f})",
        "of them new": "{0.new_planets.mean:.2f} ({0.new_planets.low:.2f} to {0.new_planets.high:.2f})",
        "any new planet": "{0.any_new_planet:.0%}",
        "seen in all bands": "{0.characterised_planets.mean:.2f}",
        "false alarms": lambda item: f"{item.background_alarms.mean + item.noise_alarms.mean:.3f}",
        "confirmed by images": images_of,
    }
    differences = {
        "paired difference": "{0.first} - {0.second}",
        "planets": "{0.mean:+.2f}",
        "90 % interval": "{0.low:+.2f} to {0.high:+.2f}",
        "correlation": lambda item: "" if item.correlation is None else f"{item.correlation:.2f}",
    }
    return "\n\n".join(
        [
            f"## {len(result.strategies)} ways to spend {result.strategies[0].settings['time_budget_h']:.0f} hours",
            f"{result.n_universes} universes of the population `giants` (0.21 planets a star) and the known planets in "
            "the shipped table, ten years from 2028. Means over surveys with their 90 % intervals; a detection is one "
            "of a blind search, with the probability that images show; of known planets the place on the sky is not "
            "known either.",
            columns(result.strategies, cells),
            *(f"![{words}]({name}.svg)" for name, words in PICTURES.items()),
            columns([item for item in result.differences if item.quantity == "planets"], differences),
        ]
    )


def season_text(found: dict[str, Any]) -> str:
    """When the stars can be seen."""
    low, quarter, middle, three, high = found["days"]
    return (
        f"From {found['start_utc'][:10]} the median of {found['stars']} ranked stars can be observed on {middle:.0f} "
        f"of {YEAR} days (quarters at {quarter:.0f} and {three:.0f}, extremes {low:.0f} and {high:.0f}), and then for "
        f"{found['minutes'][2]:.0f} min of an orbit of {found['period_min']:.1f} min (median day; quarters at "
        f"{found['minutes'][1]:.0f} and {found['minutes'][3]:.0f})."
    )


def report(found: dict[str, Any], result: WhatIfResult) -> str:
    """The whole text."""
    completeness = {
        "star": "{star}",
        "visits": "{visits}",
        "survey": "{survey:.4f}",
        "brute force": "{brute_force:.4f}",
        "difference": lambda row: f"{row['survey'] / row['brute_force'] - 1:+.2%}",
        "1 sigma": "{error:.2%}",
    }
    one_visit = {
        "star": "{star}",
        "planets": "{planets}",
        "detected, ranking": "{detected_by_ranking:.2f}",
        "detected, survey": "{detected_in_survey:.2f}",
    }
    geometry = {
        "separation (arcsec)": "{separation_arcsec:.2f}",
        "survey": "{survey:.5f}",
        "squares less the aperture": "{closed_form:.5f}",
        "whole squares": "{whole_zone:.3f}",
    }
    coverage = {
        "difference": "{first} - {second}",
        "of": lambda row: row["quantity"].replace("_", " "),
        "true mean": "{truth:+.4f}",
        "correlation of the two": "{correlation:.2f}",
        "held by the 90 % interval": "{covered:.1%}",
    }
    assumed = {
        "band": "{band}",
        "contrast, nominal": "{nominal:.1e}",
        "contrast, assumed": "{contrast:.0e}",
        "error of the mirror (nm)": "{mirror_noise_nm:.3f}",
        "predicted over recovered SNR": "{ratio:.2f} ± {error:.2f}",
        "worst of eight places": "{worst:.2f}",
        "by scaled light": "{scaled:.2f}",
        "its worst": "{scaled_worst:.2f}",
    }
    return f"""# Survey what-ifs

Regenerate with `python -m tools.reports whatif`; everything below is written by it. The command `cpic whatif
survey_default` gives the tables of its strategies, and which known fact moved which number.

{verdict(checks(found))}

{strategies(result)}

## What an assumed contrast means

A brighter dark hole than the instrument's is that of a mirror whose actuators have random errors, and the metrics of
the optics are recomputed. A planet around ε Eri at eight places, {optics.REALISATIONS} images each, made with that
mirror: predicted over recovered SNR. *By scaled light*: what the same prediction would be if the light of the nominal
hole, which differs across the band, were multiplied instead. A darker hole is scaled, since no optics are known for it.

{columns(found["optics"], assumed)}

## When stars can be seen

{season_text(found["seasons"])}

## Does the Monte Carlo count right

Completeness with one visit and with four over ten years, a million planets each, against a sampler, orbits and
geometry of `brute_force.py` (noise and core throughput are the calculator's in both).

{columns(found["completeness"], completeness)}

Detections to be expected of one blind visit of a star, of the same planets through `cpic rank`'s completeness.

{columns(found["one_visit"], one_visit)}

A circle of planets far above every threshold (F520): share that is seen, and of the quadrants without the margin that
an aperture needs.

{columns(found["geometry"], geometry)}

## Do the intervals hold

{found["coverage"]["repeats"]} repeats of {found["coverage"]["universes"]} universes each; truth is the mean of all.

{columns(found["coverage"]["rows"], coverage)}
"""


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Regenerate the report of survey what-ifs.")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=[], help="parts to measure again")
    parser.add_argument("--text", action="store_true", help="write the text again from results.json")
    chosen = parser.parse_args()
    place = HERE / "results.json"
    kept = chosen.only or chosen.text
    found: dict[str, Any] = json.loads(place.read_text(encoding="utf-8")) if kept else {}
    for name in [] if chosen.text else chosen.only or PARTS:
        print(name, flush=True)
        found[name] = PARTS[name]()
        write_text(place, dump_json(found))
    result = WhatIfResult.model_validate(json.loads((HERE / "whatif.json").read_text(encoding="utf-8")))
    drawn = whatif_figures(result)
    for name in PICTURES:
        write_picture(HERE, name, drawn[name])
    write_text(HERE / "report.md", report(found, result))
    for what, asked, got, good in checks(found):
        print(f"{'met' if good else 'MISSED'}: {what}: asked {asked}, found {got}")


if __name__ == "__main__":
    main()
