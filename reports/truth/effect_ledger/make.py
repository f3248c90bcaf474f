"""Regenerate this report: ``python -m tools.reports effect_ledger``.

Whether what the effect ledger leaves out stays within the tolerance: random scenes, each with and without one, compared
by noiseless images and closed-form variances that know nothing of the ledger. ``--scenes N`` takes the first N.
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scenes import RandomCase, random_case
from settings import settings_rows, wing_rows
from threadpoolctl import threadpool_limits
from truth import alone, pair_of, true_difference

from cpic_core import Status, write_text
from simulator import observe
from simulator.ledger import NOT_IN_SUMS, forecast
from simulator.ledger.inventory import LEFT_OUT
from simulator.observing import Observation, hole_stacks
from tools.report_parts import columns, csv_text, table, verdict

HERE = Path(__file__).resolve().parent
SCENES, EFFECT_SCENES, SUM_SCENES = 480, 25, 40
ASKED_RATE = 0.01
FRAMES_TIMED = 2
# Not to be left out alone: the dark current takes its structure and hot pixels along, and some no image has.
NOT_ALONE = ("sky", "dark", "summed_frames", "hole_region", *LEFT_OUT)

Row = dict[str, Any]


def processor_s(seen: Observation) -> float:
    """Processor time of a frame, the first one left out."""
    seen.frame(0)
    began = time.process_time()
    for index in range(1, 1 + FRAMES_TIMED):
        seen.frame(index % seen.n_frames)
    return (time.process_time() - began) / FRAMES_TIMED


def scene_row(case: RandomCase) -> Row:
    """One scene with and without its tolerance."""
    whole, short, *set_up = pair_of(case)
    frame = [processor_s(one) for one in (whole, short)]
    difference = true_difference(whole, short)
    choice = short.choice
    assert choice is not None
    row: Row = {
        "scene": case.number,
        **case.settings,
        "v_mag": case.scene.cstar.v_mag,
        "planets": len(case.scene.planets),
        "stars": len(case.scene.stars),
        "visit_nm": case.instrument.drift.visit_nm,
        "walk_nm_per_sqrt_hour": case.instrument.drift.walk_nm_per_sqrt_hour,
        "tolerance": case.tolerance,
        "quantity": "+".join(case.quantity),
    }
    for name in ("planet_flux", "snr", "pixel_map"):
        asked = name in case.quantity
        row[f"true_{name}"] = getattr(difference, name) if asked else ""
        row[f"predicted_{name}"] = choice.predicted_error[name] if asked else ""  # type: ignore[index]
    row["kept"] = all(getattr(difference, name) <= case.tolerance for name in case.quantity)
    row |= {"set_up_s": set_up[0], "set_up_short_s": set_up[1], "frame_s": frame[0], "frame_short_s": frame[1]}
    frames = case.settings["n_frames"]
    row["speed_up"] = (set_up[0] + frames * frame[0]) / (set_up[1] + frames * frame[1])
    skipped = [item.key for item in choice.rows if item.decision == "skipped" and item.size is not None]
    row["left_out"] = ";".join(key for key in skipped if key not in LEFT_OUT)
    return row


def effect_rows(case: RandomCase) -> list[Row]:
    """Predicted and true size of everything that one scene leaves out, on every quantity asked for."""
    found: list[Row] = []
    whole, short, *_ = pair_of(case)
    assert short.choice is not None
    for item in short.choice.rows:
        if item.decision != "skipped" or not item.size or item.key in NOT_ALONE:
            continue
        one = alone(case, short, item.key)
        difference = true_difference(whole, one, kept_planets=not item.key.startswith("planet:"))
        true = max(getattr(difference, name) for name in case.quantity)
        found.append({"scene": case.number, "key": item.key.split(":")[0], "predicted": item.size, "true": true})
    return found


def sum_row(case: RandomCase) -> Row | None:
    """Processor time of a visit as sums over the hole and as whole frames; nothing where sums are no substitute."""
    settings = case.settings | {"instrument": case.instrument, "seed": 5}
    if forecast(case.scene, case.instrument, **case.settings, reduced=True, full=True).sums.status is not Status.OK:
        return None
    began = time.process_time()
    still = case.instrument.switched(dict.fromkeys(NOT_IN_SUMS, False))
    hole_stacks(observe(case.scene, **settings | {"instrument": still}, window="hole")).draw()
    sums = time.process_time() - began
    began = time.process_time()
    whole = observe(case.scene, **settings)
    frames = time.process_time() - began + processor_s(whole) * case.settings["n_frames"]
    return {
        "scene": case.number,
        "n_frames": case.settings["n_frames"],
        "sums_s": sums,
        "whole_frames_s": frames,
        "speed_up": frames / sums,
    }


def upper_bound(violations: int, scenes: int, level: float = 0.95) -> float:
    """One-sided Clopper-Pearson bound of a rate."""
    from scipy.stats import beta

    return float(beta.ppf(level, violations + 1, scenes - violations)) if violations < scenes else 1.0


def quartiles(values: list[float]) -> str:
    """Median and quartiles."""
    low, middle, high = np.percentile(values, [25, 50, 75])
    return f"{middle:.2f} ({low:.2f} to {high:.2f})"


def three(name: str) -> Callable[[tuple[str, list[Row]]], str]:
    """Write median and quartiles of a column of a named group."""
    return lambda group: quartiles([row[name] for row in group[1]])


def speed_table(rows: list[Row]) -> str:
    """Speed-up by tolerance and quantity."""
    groups = {"all": rows}
    for low, high in ((0.0, 0.01), (0.01, 0.03), (0.03, 0.1), (0.1, 0.5)):
        groups[f"tolerance {low:g} to {high:g}"] = [row for row in rows if low < row["tolerance"] <= high]
    for name in sorted({row["quantity"] for row in rows}):
        groups[f"asked: {name.replace('+', ', ')}"] = [row for row in rows if row["quantity"] == name]
    faster = {"set_up": ("set_up_s", "set_up_short_s"), "a_frame": ("frame_s", "frame_short_s")}
    parts = {
        name: [row | {key: row[whole] / row[short] for key, (whole, short) in faster.items()} for row in part]
        for name, part in groups.items()
        if part
    }
    return columns(
        parts.items(),
        {
            "scenes": "{0[0]}",
            "number": lambda group: len(group[1]),
            "speed-up, set-up and all frames": three("speed_up"),
            "set-up alone": three("set_up"),
            "a frame": three("a_frame"),
        },
    )


def skipped_table(rows: list[Row], effects: list[Row]) -> str:
    """How often each effect is left out, and how close its size is."""
    counts = Counter(key for row in rows for key in {part.split(":")[0] for part in row["left_out"].split(";") if part})
    lines = []
    for key, count in counts.most_common():
        own = [row for row in effects if row["key"] == key and row["true"] > 1e-9]
        ratio = [row["predicted"] / row["true"] for row in own]
        close = f"{np.median(ratio):.2g} ({min(ratio):.2g} to {max(ratio):.2g})" if ratio else ""
        lines.append([key, count, f"{count / len(rows):.0%}", len(own), close])
    return table(
        ["left out or lowered", "scenes", "share", "sizes compared", "predicted / true, median (range)"], lines
    )


def sums_text(sums: list[Row]) -> str:
    """What sums of frames save."""
    if not sums:
        return "None of these scenes can be drawn as sums."
    spans = {"all": (1, 10000), "1 to 10": (1, 10), "11 to 100": (11, 100), "101 to 1000": (101, 1000)}
    groups = {name: [row for row in sums if low <= row["n_frames"] <= high] for name, (low, high) in spans.items()}
    return columns(
        [(name, part) for name, part in groups.items() if part],
        {
            "frames": "{0[0]}",
            "scenes": lambda group: len(group[1]),
            "sums (s)": three("sums_s"),
            "whole frames (s)": three("whole_frames_s"),
            "speed-up": three("speed_up"),
        },
    )


def settings_text(settings: list[Row]) -> str:
    """Largest errors of the settings over the bands, and how much of the predicted ones they are."""
    numbers, lines = ("halo_error", "halo_of_bound", "speckle_error", "speckle_of_bound"), []
    for name in ("wavelength_nodes", "pixel_nodes"):
        own = [row for row in settings if row["setting"] == name]
        for value, place in itertools.product(sorted({row["value"] for row in own}), ("hole", "beyond")):
            part = [row for row in own if (row["value"], row["place"]) == (value, place)]
            lines.append([f"`{name}` {value}", place, *(f"{max(row[key] for row in part):.2g}" for key in numbers)])
    return table(
        ["setting", "apertures", "starlight, over that around", "of the bound", "rms of speckles", "of the bound"],
        lines,
    )


WINGS = {"band": "{band}", "median": "{median:.2f}", "99 in 100 pixels": "{of_99_in_100:.1f}", "most": "{most:.1f}"}
WINGS |= {"bound": "{bound:g}"}


def report(
    rows: list[Row], effects: list[Row], sums: list[Row], settings: list[Row], wings: list[Row], seconds: float
) -> str:
    """The report."""
    violations = [row for row in rows if not row["kept"]]
    bound = upper_bound(len(violations), len(rows))
    used = [
        row[f"true_{name}"] / row["tolerance"]
        for row in rows
        for name in ("planet_flux", "snr", "pixel_map")
        if row[f"true_{name}"] != ""
    ]
    missed, share = f"{len(violations)} of {len(rows)}", f"{np.median(used):.2g} ({max(used):.2g})"
    checks = [
        ("scenes in which a quantity moves by more than its tolerance", "", missed, None),
        (
            "upper 95 % bound of their rate (Clopper-Pearson)",
            f"{ASKED_RATE:.0%}",
            f"{bound:.2%}",
            bound <= ASKED_RATE,
        ),
        ("part of the tolerance used, median (largest)", "", share, None),
        ("speed-up over tolerance 0, median (quartiles)", "", quartiles([row["speed_up"] for row in rows]), None),
    ]
    lines = [f"scene {row['scene']}: {row['quantity']} asked to {row['tolerance']:.3g}" for row in violations]
    return f"""# The effect ledger against the whole

Regenerate with `python -m tools.reports effect_ledger`; it took {seconds / 60:.0f} minutes of processor time.

{len(rows)} random scenes: a star of V -1.5 to 12 and type F0 to M0, up to three planets of contrast 1e-10 to 1e-5 in
and around the dark hole, up to five companions and field stars, uniform or zodiacal sky, visit offset and random walk
of 0 to 0.5 nm, every visible band, exposures of 0.01 to 1000 s, gain 1 to 1000, 1 to 1000 frames, tolerances 0.003 to
0.3 on planet flux, SNR, pixel map or all of them. Each is set up twice, with and without the tolerance, at the standard
settings and on the window around the hole, with the wavefront of the same visit. Compared are noiseless images and
variances from closed forms that the ledger does not use (`truth.py`).

{verdict(checks)}

{chr(10).join(f"- {line}" for line in lines) if lines else "No scene misses its tolerance."}

## Speed

Processor time of what a user waits for, the ledger itself included: setting the observation up, and drawing its
frames (two are timed). A tolerance on the pixel map keeps most of the camera, since it is held in the worst pixel of
the window in a single frame; one on the planet leaves out most of it.

{speed_table(rows)}

A planner asks for the planet after a reduction, and of most scenes it can draw sums of frames over the dark hole
instead of whole frames ({len(sums)} of the first {SUM_SCENES} scenes). Processor time of one visit at the standard
settings:

{sums_text(sums)}

## What is left out, and how close its predicted size is

Each effect that the first {EFFECT_SCENES} scenes leave out was left out alone, and its size measured in the images. A
size is meant as a bound: a ratio above 1 costs speed, one below 1 is too small.

{skipped_table(rows, effects)}

## Settings of the optics

The ledger bounds what fewer wavelengths and nodes do to the starlight in an aperture, relative to the light around it,
and to the rms of what two visits of a drifting wavefront leave there. Against seven wavelengths and five nodes a pixel,
99 in 100 apertures of the dark hole, and of the places of planets beyond it; the largest of four bands:

{settings_text(settings)}

Light of a source off the axis, from 0.6 to 4 arcsec, over the map of its wings that the ledger reads:

{columns(wings, WINGS)}
"""


def main() -> None:
    """Everything."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=SCENES, help="number of random scenes")
    options = parser.parse_args()
    began = time.process_time()
    rows: list[Row] = []
    effects: list[Row] = []
    with threadpool_limits(limits=1):
        for number in range(options.scenes):
            case = random_case(number)
            row = scene_row(case)
            rows.append(row)
            if not row["kept"] or number % 20 == 0:
                print(number, "" if row["kept"] else f"misses its tolerance: {row}", flush=True)
        for number in range(min(EFFECT_SCENES, options.scenes)):
            effects += effect_rows(random_case(number))
        found = [sum_row(random_case(number)) for number in range(min(SUM_SCENES, options.scenes))]
        sums = [row for row in found if row is not None]
        settings, wings = settings_rows(), wing_rows()
    write_text(HERE / "scenes.csv", csv_text(rows))
    write_text(HERE / "effects.csv", csv_text(effects))
    write_text(HERE / "sums.csv", csv_text(sums))
    write_text(HERE / "settings.csv", csv_text(settings))
    write_text(HERE / "report.md", report(rows, effects, sums, settings, wings, time.process_time() - began))


if __name__ == "__main__":
    main()
