"""Regenerate this report: ``python -m tools.reports camera_speed -- --install``.

How long frames take on one thread, beside emccd-detect and getframes, and how exact the gain of each is. Without
``--install`` the other packages run in environments of your own: ``--peer emccd-detect=PATH/bin/python``.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import logging
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from beside import (
    DETECTOR,
    INSTRUMENT,
    MEAN_E,
    OURS,
    PACKAGES,
    THREADS,
    Factor,
    Samples,
    camera_of,
    cases,
    compare,
    factors,
    installed,
    peers,
    write_setup,
)
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from cpic_core import write_text
from simulator import Observation, observe
from simulator.camera import VisibleCamera, stack_electrons
from simulator.detectors import Exposure
from simulator.effects import draw_cosmic_rays
from simulator.products import write_level0
from tools.report_parts import machine

HERE = Path(__file__).resolve().parent
FLATS_E, FLAT_GAINS = (50.0, 1e3, 2e4), (1.0, 20.0, 300.0)

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Timing:
    """Median seconds of one job."""

    name: str
    cpu_s: float
    wall_s: float
    rounds: int
    asked_s: float | None = None


def timed(name: str, job: Callable[[int], Any], rounds: int, asked_s: float | None = None) -> Timing:
    """Time a job, once before it counts."""
    job(0)
    cpu, wall = [], []
    for index in range(1, rounds + 1):
        began = time.process_time(), time.perf_counter()
        job(index)
        cpu.append(time.process_time() - began[0])
        wall.append(time.perf_counter() - began[1])
    found = Timing(name, float(np.median(cpu)), float(np.median(wall)), rounds, asked_s)
    print(f"{name}: {found.cpu_s:.4f} s of processor, {found.wall_s:.4f} s", flush=True)
    return found


def observations() -> dict[str, Observation]:
    """Sky scenes: the paper's example, a star of magnitude 5, and one that blooms."""
    fifth = {"name": "star", "cstar": {"v_mag": 5.0, "spectral_type": "G2V"}}
    return {
        "paper's example, F520, 17 s, gain 20": observe(
            "paper_example", band="F520", exposure_s=17.0, em_gain=20.0, n_frames=30
        ),
        "star of V = 5, F662, 30 s, gain 300": observe(fifth, band="F662", exposure_s=30.0, em_gain=300.0, n_frames=30),
        "paper's example, F520, 300 s, gain 20 (blooms)": observe(
            "paper_example", band="F520", exposure_s=300.0, em_gain=20.0, n_frames=30
        ),
    }


def frames(scenes: dict[str, Observation], rounds: int) -> list[Timing]:
    """Whole frames, every default effect, from a prepared exposure."""
    camera, rows = camera_of(), []

    def run(name: str, rates: FloatArray, exposure_s: float, gain: float, asked_s: float) -> None:
        exposure = camera.prepare(rates, exposure_s, gain)
        rows.append(timed(name, lambda index: camera.expose(exposure, seed=1, path=("speed", index)), rounds, asked_s))

    shape = (DETECTOR.n_rows, DETECTOR.n_columns)
    run("dark, 30 s, gain 300", np.zeros(shape), 30.0, 300.0, 0.06)
    for name, seen in scenes.items():
        run(name, seen.rate_map(0), seen.exposure_s, seen.em_gain, 0.15 if "blooms" in name else 0.06)
    for level in FLATS_E:
        for gain in FLAT_GAINS:
            run(f"flat of {level:g} e-, gain {gain:g}", np.full(shape, level / 30.0), 30.0, gain, 0.15)
    return rows


def jobs(scenes: dict[str, Observation], rounds: int) -> list[Timing]:
    """Sequences, particles, stacks."""
    rows = []

    def run(name: str, job: Callable[[int], Any], asked_s: float, most: int = 1000) -> None:
        rows.append(timed(name, job, min(rounds, most), asked_s))

    for name, seen in list(scenes.items())[:2]:
        for words, truth in (("with", True), ("without", False)):
            with tempfile.TemporaryDirectory() as folder:
                write = partial(write_level0, seen, folder, overwrite=True, truth=truth)
                run(f"30 frames to Level 0 {words} truth: {name}", lambda _, write=write: write(), 3.0, 5)
    shape = (DETECTOR.n_rows, DETECTOR.n_columns)
    for model in ("physical", "paper", "template"):
        draw = partial(
            draw_cosmic_rays,
            INSTRUMENT.cosmic_rays.model_copy(update={"model": model}),
            shape,
            DETECTOR.pixel_um,
            3000.0,
            1.0,
        )
        run(
            f"particles of 3000 s at 1 /s/cm², `{model}`",
            lambda index, draw=draw: draw(np.random.default_rng(index)),
            0.2,
        )
    plain = camera_of(off=("cosmic_rays", "nonlinearity"))
    seen = next(iter(scenes.values()))
    exposure = plain.prepare(seen.rate_map(0), seen.exposure_s, seen.em_gain)
    rows.append(timed("30 frames added up in electrons, one by one", lambda index: added(plain, exposure, index), 3))

    def stacked(index: int) -> FloatArray:
        return stack_electrons(plain, exposure, 30, seed=1, path=("stack", index))

    rows.append(timed("30 frames as one draw", stacked, rounds))
    return rows


def added(camera: VisibleCamera, exposure: Exposure, index: int) -> FloatArray:
    """Sum of 30 frames, one by one."""
    total = np.zeros(exposure.mean_e.shape)
    for number in range(30):
        total += camera.expose(exposure, seed=1, path=("one", index, number)).adu
    total -= 30 * DETECTOR.bias_adu
    total *= DETECTOR.gain_e_adu / exposure.em_gain
    return total


def cold() -> tuple[float, float, int, int]:
    """Seconds of a fresh process with an empty cache of compiled code and with a full one; kernels made, and all."""
    from simulator.detectors import kernels
    from simulator.effects import deposit

    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | THREADS | {"NUMBA_CACHE_DIR": folder}
        totals = []
        for _ in range(2):
            answer = subprocess.run(
                [sys.executable, str(HERE / "cold.py")], env=environment, capture_output=True, text=True, check=True
            )
            totals.append(sum(json.loads(answer.stdout).values()))
        made = {path.name.rsplit("-", 1)[0].rpartition(".")[2] for path in Path(folder).rglob("*.nbi")}
    wanted = {name for module in (kernels, deposit) for name, item in vars(module).items() if hasattr(item, "py_func")}
    print(f"cold {totals[0]:.1f} s, warm {totals[1]:.1f} s", flush=True)
    return totals[0], totals[1], len(made & wanted), len(wanted)


def seconds(value: float) -> str:
    """Three figures."""
    return f"{value:.3g}"


def own_table(rows: list[Timing]) -> str:
    """Our own timings."""
    lines = ["| job | processor time (s) | wall clock (s) | asked (s) | met |", "|---|---|---|---|---|"]
    for row in rows:
        met = "" if row.asked_s is None else "yes" if row.cpu_s <= row.asked_s else "**no**"
        asked = "" if row.asked_s is None else f"{row.asked_s:g}"
        lines.append(f"| {row.name} | {seconds(row.cpu_s)} | {seconds(row.wall_s)} | {asked} | {met} |")
    return "\n".join(lines)


def peer_table(rows: list[Samples], absent: list[str]) -> str:
    """Ours and the others."""
    heads = (
        "scene",
        "simulator",
        "processor time (s)",
        "wall clock (s)",
        "times longer than ours",
        "median, mean (ADU)",
    )
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for row in rows:
        ours = next(one for one in rows if one.case is row.case and one.code == OURS)
        ratio = "" if row is ours else f"{np.median(row.cpu_s) / np.median(ours.cpu_s):.1f}"
        name = f"{row.code}, {row.mode}" if row.mode else f"**{row.code}**"
        lines.append(
            f"| {row.case.words} | {name} | {seconds(float(np.median(row.cpu_s)))} | "
            f"{seconds(float(np.median(row.wall_s)))} | {ratio} | "
            f"{row.median_adu:.0f}, {row.average_adu:.1f} |"
        )
    lines += [f"| every scene | {name} | absent: not installed here | | | |" for name in absent]
    return "\n".join(lines)


def factor_table(rows: list[Factor], absent: list[str]) -> str:
    """Excess noise of every register."""
    lines = [
        "| gain | simulator | mean / gain | F² found | F² of the law | standard errors off |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows:
        name = f"{row.code}, {row.mode}" if row.mode else f"**{row.code}**"
        off = (row.found - row.law) / row.error
        lines.append(
            f"| {row.gain:g} | {name} | {row.mean:.4f} | {row.found:.4f} ± {row.error:.4f} | {row.law:.4f} | "
            f"{off:+.1f} |"
        )
    lines += [f"| every gain | {name} | absent: not installed here | | | |" for name in absent]
    return "\n".join(lines)


def verdict(rows: list[Samples]) -> str:
    """Ratios to ours, scene by scene."""
    lines = []
    for name, mode, asked in (
        ("emccd-detect", "fast, no register CIC", 60.0),
        ("emccd-detect", "fast", 60.0),
        ("getframes", "double", 1.0),
    ):
        ratios = {}
        for row in rows:
            if (row.code, row.mode) == (name, mode):
                ours = next(one for one in rows if one.case is row.case and one.code == OURS)
                ratios[row.case.words] = float(np.median(row.cpu_s) / np.median(ours.cpu_s))
        if ratios:
            listed = "; ".join(
                f"{words}: {ratio:.1f}{'' if ratio >= asked else ' (**not met**)'}" for words, ratio in ratios.items()
            )
            lines.append(f"- {name}, {mode}, over ours, at least {asked:g} asked: {listed}.")
    return "\n".join(lines) or "- No other simulator was installed."


def report(tables: dict[str, str], compiled: tuple[float, float, int, int], rounds: int, about: str) -> str:
    """Text of the report."""
    first, again, made, wanted = compiled
    return f"""# Speed of the camera

Regenerate with `python -m tools.reports camera_speed -- --install`; everything below is written by it.

{machine("numpy", "numba")}.

One thread, medians of {rounds} warm runs (5 at most of sequences). The verdict is by processor time: on one thread it
is the wall clock of an idle machine.

## Frames

{DETECTOR.n_rows} x {DETECTOR.n_columns} pixels, every default effect, cosmic rays included. The noise-free part is
prepared once as long as the light stays and is not in the time.

{tables["frames"]}

## Sequences, particles, stacks

{tables["jobs"]}

A sequence of 30 frames has 12 states of the wavefront, prepared one after the other; setting it up (`observe`) is not
in the time. A stack is one draw from 30 times the mean, which is the law of the sum where nothing saturates.

A fresh process with an empty cache of compiled code takes {first:.1f} s until both cameras and the register have run,
with a full one {again:.1f} s: **{first - again:.1f} s of compiling**, {made} of {wanted} kernels made (asked: 40 s).

## Beside other simulators

The {DETECTOR.active_shape[0]} x {DETECTOR.active_shape[1]} active pixels, one thread, each simulator in its own
environment and process, in turns, {rounds} frames each. {about}
All get the same mean electrons, full wells, read noise, bias, dark current, clock-induced charge, response, converter
and rate of particles, and every effect that they have of those that ours runs. Ours is timed with all of its own.

{tables["peers"]}

{tables["verdict"]}

| | ours | emccd-detect | getframes |
|---|---|---|---|
| register | exact law | *exact*: every stage of every electron; *fast*: Gamma(n, g) | Gamma with F² = 2 |
| charge made in the register | an option, off | on in *fast*, off in the others | none |
| full well of the register | spills along the row | spills along one long row, with a tail of traps | cut off |
| pixel full well | spills along the column, half each way | the same, at random, step by step | the same |
| parallel transfer | random losses, up to three a charge | none without arcticpy | mean loss, one step |
| serial transfer | random losses | none without arcticpy | none |
| non-linearity | pixel and register | none (needs a file) | pixel |
| response, hot and dead pixels, bad columns | maps | maps, read from disk in every frame | its own maps |
| smear | once per sequence | in every frame | none |
| cosmic rays | tracks, whole electrons | spots | lines of one pixel |
| bias | stripes, interference, drift | stripes | stripes, drift |
| random numbers | seed and path, a stream an effect | global state of numpy | seed |
| truth | mask, electron book of every step | none | mean electrons (left out here) |

## Statistics of the register

Poisson input of {MEAN_E:g} e-: variance of the output over gain² and mean, the squared excess noise factor. The law is
the closed form for {DETECTOR.register_stages} stages, 2 (g - 1) g^(-(N + 1) / N) + 1 / g.

{tables["factors"]}

Medians are in `times.csv`, `peers.csv` and `factors.csv`.
"""


def write_table(name: str, head: list[str], rows: list[list[Any]]) -> None:
    """Write rows as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    for row in rows:
        writer.writerow([f"{cell:.5g}" if isinstance(cell, float) else cell for cell in row])
    write_text(HERE / name, text.getvalue())


def options() -> argparse.Namespace:
    """What the user asks for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--peer",
        action="append",
        default=[],
        metavar="NAME=PYTHON",
        help=f"interpreter of an environment that holds {' or '.join(PACKAGES)}",
    )
    parser.add_argument("--install", action="store_true", help="make an environment for those that --peer leaves out")
    parser.add_argument("--rounds", type=int, default=7, help="runs of every job (%(default)s)")
    found = parser.parse_args()
    found.pythons = {}
    for text in found.peer:
        name, _, python = text.partition("=")
        if name not in PACKAGES or not Path(python).is_file():
            parser.error(f"--peer {text}: NAME=PYTHON, with NAME one of {', '.join(PACKAGES)} and a file PYTHON")
        found.pythons[name] = Path(python)
    if found.rounds < 1:
        parser.error("--rounds: at least 1")
    return found


def main() -> None:
    """Time, compare, write."""
    asked = options()
    rounds: int = asked.rounds
    logging.getLogger("simulator").setLevel(logging.ERROR)
    with ExitStack() as stack:
        stack.enter_context(threadpool_limits(1))
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        pythons: dict[str, Path] = asked.pythons
        if asked.install:
            pythons = installed(folder, [name for name in PACKAGES if name not in pythons]) | pythons
        absent = [name for name in PACKAGES if name not in pythons]
        scenes = observations()
        own, others = frames(scenes, rounds), jobs(scenes, rounds)
        compiled = cold()
        found = cases(scenes)
        write_setup(folder / "setup.npz", found)
        started = stack.enter_context(peers(pythons, folder / "setup.npz"))
        about = "; ".join(
            f"{name} {one.about['version']} (numpy {one.about['numpy']})" for name, one in started.items()
        )
        beside, registers = compare(found, started, rounds), factors(started)
    tables = {
        "frames": own_table(own),
        "jobs": own_table(others),
        "peers": peer_table(beside, absent),
        "verdict": verdict(beside),
        "factors": factor_table(registers, absent),
    }
    write_table(
        "times.csv",
        ["job", "cpu_s", "wall_s", "rounds", "asked_s"],
        [
            [row.name.replace("`", ""), row.cpu_s, row.wall_s, row.rounds, row.asked_s or ""]
            for row in [
                *own,
                *others,
                Timing("fresh process, empty cache", compiled[0], compiled[0], 1, 40.0),
                Timing("fresh process, full cache", compiled[1], compiled[1], 1),
            ]
        ],
    )
    write_table(
        "peers.csv",
        ["scene", "simulator", "mode", "cpu_s", "wall_s", "rounds"],
        [
            [
                row.case.words,
                row.code,
                row.mode,
                float(np.median(row.cpu_s)),
                float(np.median(row.wall_s)),
                len(row.cpu_s),
            ]
            for row in beside
        ],
    )
    write_table(
        "factors.csv",
        ["gain", "simulator", "mode", "factor2", "error", "law"],
        [[row.gain, row.code, row.mode, row.found, row.error, row.law] for row in registers],
    )
    write_text(HERE / "report.md", report(tables, compiled, rounds, f"{about}." if about else ""))
    print(HERE / "report.md")


if __name__ == "__main__":
    main()
