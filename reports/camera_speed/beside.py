"""Other simulators beside ours: the same scenes in alternation, and the gain of each register."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator import Observation, load_instrument
from simulator.camera import VisibleCamera, load_calibration_set
from simulator.detectors import excess_noise_factor2
from simulator.detectors.gain import multiply
from simulator.effects import cosmic_ray_rate

HERE = Path(__file__).resolve().parent
PACKAGES = {"emccd-detect": "emccd-detect==2.6.2", "getframes": "getframes==2.6.1"}
MODES = {"emccd-detect": ("exact", "fast", "fast, no register CIC"), "getframes": ("double", "single")}
# Twenty seconds a frame and more: the science scene alone.
SLOW = ("exact", "fast")
OURS = "ours"
MEAN_E, FACTOR_GAINS, FACTOR_PIXELS, SLOW_PIXELS = 5.0, (2.0, 20.0, 300.0), 1_000_000, 250_000
THREADS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")

FloatArray = NDArray[np.float64]
INSTRUMENT = load_instrument()
DETECTOR = INSTRUMENT.detector
ACTIVE = DETECTOR.sections["active"]


@dataclass(frozen=True, eq=False)
class Case:
    """A scene on the active pixels."""

    name: str
    words: str
    rates_e_s: FloatArray
    exposure_s: float
    gain: float


@dataclass(eq=False)
class Samples:
    """Seconds of one simulator on one scene."""

    code: str
    mode: str
    case: Case
    cpu_s: list[float] = field(default_factory=list)
    wall_s: list[float] = field(default_factory=list)
    median_adu: float = math.nan
    average_adu: float = math.nan

    def add(self, answer: dict[str, float]) -> None:
        """Keep an answer."""
        self.cpu_s.append(answer["cpu_s"])
        self.wall_s.append(answer["wall_s"])
        self.median_adu, self.average_adu = answer["median"], answer["average"]


def camera_of(*, off: tuple[str, ...] = ()) -> VisibleCamera:
    """The default camera with cosmic rays."""
    rate = cosmic_ray_rate(INSTRUMENT.cosmic_rays, INSTRUMENT.mission.start_utc)
    return VisibleCamera(DETECTOR.switched(off=off), cosmic_rays=INSTRUMENT.cosmic_rays, cosmic_ray_rate_per_s_cm2=rate)


def cases(scenes: dict[str, Observation]) -> list[Case]:
    """Scenes for all simulators: the active pixels alone."""
    example, fifth, _ = scenes.values()
    names = list(scenes)
    return [
        Case("science", names[0], example.rate_map(0)[ACTIVE].copy(), example.exposure_s, example.em_gain),
        Case("faint", names[1], fifth.rate_map(0)[ACTIVE].copy(), fifth.exposure_s, fifth.em_gain),
        Case("dark", "dark, 30 s, gain 300", np.zeros(DETECTOR.active_shape), 30.0, 300.0),
        Case("flat", "flat of 1000 e-, gain 20", np.full(DETECTOR.active_shape, 1e3 / 30.0), 30.0, 20.0),
    ]


def write_setup(path: Path, found: list[Case]) -> None:
    """Write camera and scenes for the other simulators."""
    whole = load_calibration_set(DETECTOR)
    part, flaws, rays = whole.window(*ACTIVE), DETECTOR.flaws, INSTRUMENT.cosmic_rays
    numbers = {
        name: getattr(DETECTOR, name)
        for name in (
            "full_well_e",
            "register_full_well_e",
            "dark_e_s",
            "cic_e",
            "read_noise_e",
            "bias_adu",
            "gain_e_adu",
            "adc_bits",
            "pixel_um",
        )
    }
    numbers |= {
        name: getattr(flaws, name)
        for name in ("dsnu_rms", "hot_fraction", "hot_factor", "dead_fraction", "bad_columns", "prnu_rms")
    }
    numbers |= {
        "stages": DETECTOR.register_stages,
        "line_shift_s": DETECTOR.transfer.line_shift_s,
        "parallel_cti": DETECTOR.transfer.parallel_cti,
        "pixel_loss": DETECTOR.nonlinearity.pixel_loss_at_full_well,
        "stripe_adu": DETECTOR.bias_structure.stripe_rms_adu,
        "drift_adu": DETECTOR.bias_structure.drift_adu,
        "cosmic_ray_rate": cosmic_ray_rate(rays, INSTRUMENT.mission.start_utc),
        "track_px": 2.0 * rays.physical.depth_um / DETECTOR.pixel_um,
    }
    maps = {"response_map": part.response, "hot_map": part.dark_e_s / DETECTOR.dark_e_s}
    np.savez(path, **numbers, **maps, **{case.name: case.rates_e_s for case in found})


class Peer:
    """Another simulator in a process of its own."""

    def __init__(self, name: str, python: Path, setup: Path) -> None:
        environment = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "PYTHONHOME")}
        command = [str(python), str(HERE / "peer.py"), name, str(setup)]
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            stderr=subprocess.DEVNULL,
            env=environment | THREADS,
        )
        self.about = self._answer()

    def ask(self, **request: Any) -> dict[str, Any]:
        """Send a request and wait for its answer."""
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()
        return self._answer()

    def _answer(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(f"{self.process.args} ended")
        found: dict[str, Any] = json.loads(line)
        return found


@contextmanager
def peers(pythons: dict[str, Path], setup: Path) -> Iterator[dict[str, Peer]]:
    """Start the other simulators; end them afterwards."""
    started: dict[str, Peer] = {}
    try:
        for name, python in pythons.items():
            started[name] = Peer(name, python, setup)
        yield started
    finally:
        for peer in started.values():
            peer.process.kill()
            peer.process.communicate()


def installed(folder: Path, names: list[str]) -> dict[str, Path]:
    """Make an environment for each of some simulators."""
    pythons = {}
    for name in names:
        subprocess.run([sys.executable, "-m", "venv", str(folder / name)], check=True)
        pythons[name] = folder / name / "bin" / "python"
        subprocess.run([str(pythons[name]), "-m", "pip", "install", "--quiet", PACKAGES[name]], check=True)
    return pythons


def our_frame(case: Case) -> Callable[[int], dict[str, float]]:
    """A job that times one of our frames of a case."""
    camera = camera_of()
    exposure = camera.prepare(
        case.rates_e_s, case.exposure_s, case.gain, first_pixel=(ACTIVE[0].start, ACTIVE[1].start)
    )

    def job(seed: int) -> dict[str, float]:
        began = time.process_time(), time.perf_counter()
        image = camera.expose(exposure, seed=seed, path=("beside", case.name)).adu
        spent = time.process_time() - began[0], time.perf_counter() - began[1]
        return {
            "cpu_s": spent[0],
            "wall_s": spent[1],
            "median": float(np.median(image)),
            "average": float(image.mean()),
        }

    return job


def compare(found: list[Case], started: dict[str, Peer], rounds: int) -> list[Samples]:
    """Time every simulator on every case in turns, once before it counts."""
    rows = []
    for case in found:
        job, ours = our_frame(case), Samples(OURS, "", case)
        theirs = [
            Samples(name, mode, case)
            for name in started
            for mode in MODES[name]
            if case.name == "science" or mode not in SLOW
        ]
        job(0)
        for turn in range(rounds + 1):
            for one in theirs:
                # A first turn of the slow modes warms nothing that counts.
                if turn == 0 and one.mode in SLOW:
                    continue
                request = {"scene": case.name, "exposure_s": case.exposure_s, "gain": case.gain, "mode": one.mode}
                answer = started[one.code].ask(**request, seed=turn)
                if turn:
                    one.add(answer)
            if turn:
                ours.add(job(turn))
        rows += [ours, *theirs]
        for row in (ours, *theirs):
            print(case.name, row.code, row.mode, f"{np.median(row.cpu_s):.4f} s", flush=True)
    return rows


@dataclass(frozen=True)
class Factor:
    """Squared excess noise factor of one register."""

    code: str
    mode: str
    gain: float
    law: float
    found: float
    error: float
    mean: float


def factors(started: dict[str, Peer]) -> list[Factor]:
    """Variance of the output of every register for Poisson input, over that of the input times the squared gain."""
    from peer import excess

    rows = []
    for gain in FACTOR_GAINS:
        law = float(excess_noise_factor2(gain, DETECTOR.register_stages))

        def ours(charge: NDArray[np.int64], seed: int, gain: float = gain) -> NDArray[np.int64]:
            return multiply(charge, gain, rng=np.random.default_rng(seed), stages=DETECTOR.register_stages)

        answers = [(OURS, "", excess(ours, gain, MEAN_E, FACTOR_PIXELS))]
        for name, peer in started.items():
            for mode in MODES[name]:
                if mode in ("fast, no register CIC", "single"):
                    continue  # the register of the other mode
                pixels = SLOW_PIXELS if mode == "exact" else FACTOR_PIXELS
                answer = peer.ask(scene="dark", exposure_s=30.0, gain=gain, mode=mode, mean=MEAN_E, pixels=pixels)
                answers.append((name, mode, answer))
        rows += [
            Factor(code, mode, gain, law, one["factor2"], one["error"], one["mean"]) for code, mode, one in answers
        ]
    return rows
