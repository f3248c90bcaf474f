"""Frames of the camera, sequences as Level-0 files, cosmic rays, stacks, and the compilation of the kernels."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits

from simulator import load_instrument, observe
from simulator.camera import VisibleCamera, stack_electrons
from simulator.effects import draw_cosmic_rays
from simulator.observing import hole_stacks
from simulator.products import write_level0
from tests.simulator.frames import to_electrons

INSTRUMENT = load_instrument()
DETECTOR = INSTRUMENT.detector
SHAPE = (DETECTOR.n_rows, DETECTOR.n_columns)
COLD = Path(__file__).with_name("cold.py")
FIFTH = {"name": "star", "cstar": {"v_mag": 5.0, "spectral_type": "G2V"}}
SCENES = {
    "paper's example, 17 s, gain 20": ("paper_example", "F520", 17.0, 20.0),
    "V = 5, 30 s, gain 300": (FIFTH, "F662", 30.0, 300.0),
    "paper's example, 300 s, gain 20": ("paper_example", "F520", 300.0, 20.0),
}


def camera(*, off=()):
    return VisibleCamera(DETECTOR.switched(off=off), cosmic_rays=INSTRUMENT.cosmic_rays, cosmic_ray_rate_per_s_cm2=1.0)


def sequence(name, n_frames=30):
    scene, band, exposure_s, gain = SCENES[name]
    return observe(scene, band=band, exposure_s=exposure_s, em_gain=gain, n_frames=n_frames)


def frame_of(timed, name, rates, exposure_s, gain):
    chain = camera()
    exposure = chain.prepare(rates, exposure_s, gain)
    frame = timed(name, lambda: chain.expose(exposure, seed=1, path=("speed",)))
    assert frame.adu.shape == rates.shape
    return frame


def test_dark_frame(timed):
    frame = frame_of(timed, "frame: dark, 30 s, gain 300", np.zeros(SHAPE), 30.0, 300.0)
    assert frame.n_saturated_pixels == 0


@pytest.mark.parametrize("name", SCENES)
def test_frame_of_a_scene(timed, name):
    seen = sequence(name)
    frame = frame_of(timed, f"frame: {name}", seen.rate_map(0), seen.exposure_s, seen.em_gain)
    assert (frame.n_saturated_pixels > 1000) == (seen.exposure_s == 300.0)


@pytest.mark.parametrize("gain", [1, 20, 300])
@pytest.mark.parametrize("level_e", [50, 1000, 20000])
def test_flat(timed, level_e, gain):
    frame = frame_of(timed, f"flat: {level_e} e-, gain {gain}", np.full(SHAPE, level_e / 30), 30.0, float(gain))
    assert (frame.n_register_saturated > 1e6) == (level_e * gain > DETECTOR.register_full_well_e)


@pytest.mark.parametrize(
    ("job", "name"),
    [
        ("30 frames to Level 0: paper's example", "paper's example, 17 s, gain 20"),
        ("30 frames to Level 0: V = 5", "V = 5, 30 s, gain 300"),
    ],
)
def test_thirty_frames_as_level_0(timed, tmp_path, job, name):
    seen = sequence(name)
    path = timed(job, lambda: write_level0(seen, tmp_path, overwrite=True), rounds=3)
    assert path.stat().st_size > 30 * 2 * SHAPE[0] * SHAPE[1]


def test_writing_alone(timed, tmp_path):
    """What the FITS library takes for the bytes of 30 frames: the floor of writing a sequence."""
    frames = np.random.default_rng(1).integers(0, 2**14, (30, *SHAPE), dtype=np.uint16)
    timed(
        "write one FITS file of 30 frames",
        lambda: fits.PrimaryHDU(frames).writeto(tmp_path / "x.fits", overwrite=True, checksum=True),
    )
    assert (tmp_path / "x.fits").stat().st_size > frames.nbytes


@pytest.mark.parametrize("model", ["physical", "paper", "template"])
def test_cosmic_rays_of_3000_s(timed, model):
    config = INSTRUMENT.cosmic_rays.model_copy(update={"model": model})
    rng = np.random.default_rng(1)
    rays = timed(
        f"particles of 3000 s: {model}", lambda: draw_cosmic_rays(config, SHAPE, DETECTOR.pixel_um, 3000.0, 1.0, rng)
    )
    expected = 3000 * SHAPE[0] * SHAPE[1] * (DETECTOR.pixel_um * 1e-4) ** 2
    assert expected - 5 * expected**0.5 < rays.n_events < 1.2 * expected


@pytest.fixture(scope="module")
def stack():
    """Camera, exposure, and the mean of the sum of 30 frames where one draw may stand for them."""
    seen, chain = sequence("paper's example, 17 s, gain 20"), camera(off=("cosmic_rays", "nonlinearity"))
    exposure = chain.prepare(seen.rate_map(0), seen.exposure_s, seen.em_gain)
    return chain, exposure, seen.em_gain


def test_stack_as_one_draw(timed, stack):
    chain, exposure, _ = stack
    total = timed("30 frames: one draw", lambda: stack_electrons(chain, exposure, 30, seed=1, path=("all",)))
    assert total.shape == SHAPE


def test_stack_frame_by_frame(timed, stack):
    chain, exposure, gain = stack

    def one_by_one():
        total = np.zeros(SHAPE)
        for index in range(30):
            total += to_electrons(chain.expose(exposure, seed=1, path=("one", index)).adu, DETECTOR, gain)
        return total

    total = timed("30 frames: one by one", one_by_one, rounds=2)
    drawn = stack_electrons(chain, exposure, 30, seed=1, path=("all",))
    assert abs(drawn.sum() / total.sum() - 1) < 0.01


def test_sums_over_the_dark_hole(timed):
    """What one realisation of a plan draws, wavefronts included."""
    off = dict.fromkeys(
        (
            "flat",
            "dark_structure",
            "bad_pixels",
            "bad_columns",
            "smear",
            "cosmic_rays",
            "nonlinearity",
            "parallel_cti",
            "serial_cti",
            "stripes",
            "interference",
            "bias_drift",
        ),
        False,
    )
    seen = observe(
        "paper_example", band="F662", exposure_s=3.0, em_gain=300.0, n_frames=30, window="hole", switches=off
    )
    sums = timed("hole: sums of 30 frames", hole_stacks(seen).draw)
    assert sums.max() > 0


@pytest.mark.parametrize(
    ("job", "full"), [("fresh process, cold kernels", False), ("fresh process, warm kernels", True)]
)
def test_compilation(timed, tmp_path, job, full):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}

    def fresh():
        done = subprocess.run([sys.executable, str(COLD)], env=environment, capture_output=True, text=True, check=True)
        return sum(json.loads(done.stdout).values())

    if full:
        fresh()
    assert timed(job, fresh, rounds=3 if full else 1) > 0
