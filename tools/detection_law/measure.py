"""False alarms and detections in stacks of visits, counted."""

import json
import math
import platform
import time
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import stream, write_text
from cpic_planner.validation.injection import recovered
from cpic_planner.validation.search import search_threshold
from tools.detection_law.stacks import CASES, SEED, VISITS, Scene, expected, scenes

FILE = Path(__file__).resolve().parents[2] / "reports" / "detection_law" / "law.json"
LEVELS = (3.0, 3.5, 4.0, 5.0)
MARGINS = (0.35, 3.5)
NULLS = 100  # stacks without planets that are made of one pool of visits
POOLS = 1  # pools of a case
INJECTED = {1: (150, 1), 4: (150, 1), 16: (40, 4)}  # stacks with planets, and planets in each


def nulls(scene: Scene, visits: int, count: int, rng: np.random.Generator) -> dict[str, Any]:
    """Return false alarms of stacks without planets; ``spread`` sums the squares of those of a stack, at 3 sigma."""
    found: dict[str, Any] = {"stacks": count, "elements": 0.0, "dof": [], "drift_nm": [], "spread": 0}
    found |= {f"{level:g}": 0 for level in LEVELS}
    for _ in range(count):
        answer = scene.searched(scene.stack(scene.visits_of(visits, rng)), visits, LEVELS[0])
        found["elements"] += answer.region.n_elements
        found["dof"].append(answer.dof)
        found["drift_nm"].append(answer.drift_nm)
        for level in LEVELS:
            asked = search_threshold(answer.region, answer.roughness, sigma=level).unwrap()
            above = sum(one.significance >= asked for one in answer.candidates)
            found[f"{level:g}"] += above
            found["spread"] += above**2 if level == LEVELS[0] else 0
    return found | {name: float(f"{np.median(found[name]):.4g}") for name in ("dof", "drift_nm")}


def injections(scene: Scene, visits: int, rng: np.random.Generator) -> list[dict[str, Any]]:
    """Return the planets put into stacks, and whether a blind search, or photometry at their place, finds them.

    Their contrasts are such that margins are spread evenly in their logarithm. One stack holds several only where its
    visits tell the noise without them: others raise the noise of a single visit.
    """
    count, planets = INJECTED[visits]
    field, rows = scene.field, []
    known = expected(scene.case, scene.frames, visits)["margin"]
    integration_s = scene.frames.exposure_s * scene.frames.n_frames
    reach = field.psf.geometry.lambda_d_arcsec
    for _ in range(count):
        chosen = rng.permutation(field.places(rng))[:planets]
        margin = np.exp(rng.uniform(math.log(MARGINS[0]), math.log(MARGINS[1]), planets))
        contrast = margin / known[chosen]
        left = scene.visits_of(visits, rng)
        star_e = scene.rate_e_s * integration_s
        lights = [
            scene.light_of(visits, one * star_e * field.planet[k], rng) for k, one in zip(chosen, contrast, strict=True)
        ]
        answer = scene.searched(scene.stack(left + sum(lights)), visits, 5.0)
        for k, place in enumerate(chosen):
            x, y = (float(part) for part in field.place_arcsec[place])
            best = recovered(answer, x, y, reach)
            found = best is not None and best.detected
            placed = scene.seen_at_place(scene.stack(left + lights[k]), int(place))
            rows.append({"place": int(place), "contrast": contrast[k], "found": int(found), "placed": int(placed)})
    return rows


def empty() -> dict[str, Any]:
    """Return the counts of nothing measured yet."""
    machine = f"{platform.machine()}, one core"
    return {"machine": machine, "minutes": {"alarms": 0.0, "planets": 0.0}, "alarms": [], "stacks": []}


def kept(found: dict[str, Any]) -> None:
    """Write ``law.json``, one line a stack."""
    text = json.dumps(found, separators=(",", ":")).replace('{"case"', '\n{"case"')
    write_text(FILE, text + "\n")


def measure(found: dict[str, Any]) -> None:
    """Add what is not in the results yet, and keep them after every case."""
    done = {(one["case"], one["visits"]) for one in found["stacks"]}
    counted = {(one["case"], one["visits"], one["pool"]) for one in found["alarms"]}
    for number, scene in enumerate(scenes()):
        start = time.process_time()
        for visits in VISITS:
            if (number, visits) not in done:
                rows = injections(scene, visits, stream(SEED, "planets", number, visits))
                columns: dict[str, Any] = {name: [row[name] for row in rows] for name in rows[0]}
                columns["contrast"] = [float(f"{one:.4g}") for one in columns["contrast"]]
                found["stacks"].append({"case": number, "visits": visits, "frames": list(scene.frames[:3])} | columns)
        planets_s = time.process_time() - start
        for pool in range(POOLS if scene.drawn is None else 0):
            missing = [visits for visits in VISITS if (number, visits, pool) not in counted]
            fresh = scene.renewed(1000 * number + pool) if missing else scene
            for visits in missing:
                alarms = nulls(fresh, visits, NULLS, stream(SEED, "alarms", number, visits, pool))
                found["alarms"].append({"case": number, "visits": visits, "pool": pool} | alarms)
        whole_s = time.process_time() - start
        for name, taken_s in (("planets", planets_s), ("alarms", whole_s - planets_s)):
            found["minutes"][name] = round(found["minutes"][name] + taken_s / 60.0, 2)
        kept(found)
        print(f"{CASES[number]}: planets {planets_s:.0f} s, false alarms {whole_s - planets_s:.0f} s", flush=True)
