"""Frames of the camera, sequences as Level-0 files, cosmic rays, stacks and the compilation of the kernels.

``make bench`` prints the times. There is no limit on the clock here: machines differ. ``reports/camera_speed`` has the
figures of one machine, and those of other simulators, which need environments of their own, beside them.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from simulator import load_instrument, observe
from simulator.camera import VisibleCamera, stack_electrons, to_electrons
from simulator.effects import draw_cosmic_rays
from simulator.products import write_level0

INSTRUMENT = load_instrument()
DETECTOR = INSTRUMENT.detector
SHAPE = (DETECTOR.n_rows, DETECTOR.n_columns)
COLD = Path(__file__).resolve().parents[2] / "reports/camera_speed/cold.py"
FIFTH = {"name": "star", "cstar": {"v_mag": 5.0, "spectral_type": "G2V"}}
SCENES = {
    "paper's example, 17 s, gain 20": ("paper_example", "F520", 17.0, 20.0),
    "V = 5, 30 s, gain 300": (FIFTH, "F662", 30.0, 300.0),
    "paper's example, 300 s, gain 20": ("paper_example", "F520", 300.0, 20.0),
}
MEDIANS: dict[tuple[str, str], float] = {}


@pytest.fixture(scope="module", autouse=True)
def times(printed) -> Iterator[None]:
    yield
    with printed() as line:
        line("\ncamera, median seconds")
        for (job, name), seconds in MEDIANS.items():
            line(f"  {job:28s} {name:44s} {seconds:9.4f} s")


def timed(benchmark, job, name, function, *, rounds=5):
    """Run a job, once before it counts unless it is run a single time, and keep its median."""
    answer = benchmark.pedantic(function, rounds=rounds, warmup_rounds=int(rounds > 1))
    MEDIANS[job, name] = benchmark.stats.stats.median
    return answer


def camera(*, off=()):
    return VisibleCamera(DETECTOR.switched(off=off), cosmic_rays=INSTRUMENT.cosmic_rays, cosmic_ray_rate_per_s_cm2=1.0)


def sequence(name, n_frames=30):
    scene, band, exposure_s, gain = SCENES[name]
    return observe(scene, band=band, exposure_s=exposure_s, em_gain=gain, n_frames=n_frames)


def frame_of(benchmark, name, rates, exposure_s, gain):
    chain = camera()
    exposure = chain.prepare(rates, exposure_s, gain)
    frame = timed(benchmark, "frame", name, lambda: chain.expose(exposure, seed=1, path=("speed",)))
    assert frame.adu.shape == SHAPE
    return frame


def test_dark_frame(benchmark):
    frame = frame_of(benchmark, "dark, 30 s, gain 300", np.zeros(SHAPE), 30.0, 300.0)
    assert frame.n_saturated_pixels == 0


@pytest.mark.parametrize("name", SCENES)
def test_frame_of_a_scene(benchmark, name):
    seen = sequence(name)
    frame = frame_of(benchmark, name, seen.rate_map(0), seen.exposure_s, seen.em_gain)
    assert (frame.n_saturated_pixels > 1000) == (seen.exposure_s == 300.0)


@pytest.mark.parametrize("gain", [1.0, 20.0, 300.0])
@pytest.mark.parametrize("level_e", [50.0, 1e3, 2e4])
def test_flat(benchmark, level_e, gain):
    frame = frame_of(benchmark, f"flat of {level_e:g} e-, gain {gain:g}", np.full(SHAPE, level_e / 30), 30.0, gain)
    assert (frame.n_register_saturated > 1e6) == (level_e * gain > DETECTOR.register_full_well_e)


@pytest.mark.parametrize("name", list(SCENES)[:2])
def test_thirty_frames_as_level_0(benchmark, tmp_path, name):
    seen = sequence(name)
    path = timed(
        benchmark, "30 frames to Level 0", name, lambda: write_level0(seen, tmp_path, overwrite=True), rounds=3
    )
    assert path.stat().st_size > 30 * 2 * SHAPE[0] * SHAPE[1]


@pytest.mark.parametrize("model", ["physical", "paper", "template"])
def test_cosmic_rays_of_3000_s(benchmark, model):
    config = INSTRUMENT.cosmic_rays.model_copy(update={"model": model})
    rng = np.random.default_rng(1)
    rays = timed(
        benchmark, "cosmic rays", f"3000 s, {model}",
        lambda: draw_cosmic_rays(config, SHAPE, DETECTOR.pixel_um, 3000.0, 1.0, rng),
    )  # fmt: skip
    expected = 3000 * SHAPE[0] * SHAPE[1] * (DETECTOR.pixel_um * 1e-4) ** 2
    assert expected - 5 * expected**0.5 < rays.n_events < 1.2 * expected


def test_stack_as_one_draw_and_frame_by_frame(benchmark):
    seen, chain = sequence("paper's example, 17 s, gain 20"), camera(off=("cosmic_rays", "nonlinearity"))
    exposure = chain.prepare(seen.rate_map(0), seen.exposure_s, seen.em_gain)

    def one_by_one():
        total = np.zeros(SHAPE)
        for index in range(30):
            total += to_electrons(chain.expose(exposure, seed=1, path=("one", index)).adu, DETECTOR, seen.em_gain)
        return total

    stack = timed(
        benchmark, "stack of 30 frames", "one draw", lambda: stack_electrons(chain, exposure, 30, seed=1, path=("all",))
    )
    began = time.perf_counter()
    total = one_by_one()
    MEDIANS["stack of 30 frames", "frame by frame"] = time.perf_counter() - began
    assert abs(stack.sum() / total.sum() - 1) < 0.01


def test_cold_compilation(benchmark, tmp_path):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}

    def fresh():
        done = subprocess.run([sys.executable, str(COLD)], env=environment, capture_output=True, text=True, check=True)
        return sum(json.loads(done.stdout).values())

    cold = timed(benchmark, "fresh process", "empty cache of compiled code", fresh, rounds=1)
    MEDIANS["fresh process", "full cache"] = fresh()
    assert cold > MEDIANS["fresh process", "full cache"]
