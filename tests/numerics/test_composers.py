"""The chain from scene to file at its extremes: frames of whole numbers, products that pass their own check."""

import itertools

import numpy as np
import pytest

import cpic_planner
import simulator
from simulator.config import load_scene
from simulator.ledger import forecast

# Two weeks of particles on a whole frame take long to draw.
FEW_HITS = {"cosmic_rays": False}


def scene(v_mag, distance_pc=10.0):
    planet = {
        "name": "b",
        "radius_rjup": 1.0,
        "phase_deg": 90.0,
        "separation_arcsec": 0.55,
        "pa_deg": 45.0,
        "albedo": {"model": "constant", "value": 0.5},
    }
    star = {"v_mag": v_mag, "teff_k": 5772.0, "distance_pc": distance_pc}
    return {"name": "extreme", "cstar": star, "planets": [planet]}


@pytest.mark.parametrize(("v_mag", "exposure_s"), list(itertools.product((-27.0, 30.0), (1e-6, 1e6))))
@pytest.mark.parametrize(("band", "em_gain"), [("F520", 1.0 + 1e-12), ("F520", 1000.0), ("F1265", 1.0)])
def test_one_frame(v_mag, exposure_s, band, em_gain):
    seen = simulator.observe(
        scene(v_mag), band=band, exposure_s=exposure_s, em_gain=em_gain, window="hole", fidelity="quick"
    )
    frame = seen.frame(0)
    assert frame.adu.dtype == np.uint16
    # The Sun saturates in a microsecond; a star of V = 30 in a microsecond leaves the bias.
    if v_mag == -27.0:
        assert frame.n_saturated_pixels > 1000
    elif exposure_s == 1e-6:
        assert frame.n_saturated_pixels == 0
        assert frame.adu.max() < 2000
    for source in seen.truth.sources:
        assert np.isfinite(source.rate_e_s)
        assert source.rate_e_s >= 0


@pytest.mark.parametrize(("v_mag", "exposure_s", "em_gain"), [(-27.0, 1e6, 1000.0), (30.0, 1e-6, 1.0 + 1e-12)])
def test_a_file_of_it_passes_its_own_check(tmp_path, v_mag, exposure_s, em_gain):
    seen = simulator.observe(
        scene(v_mag), band="F520", exposure_s=exposure_s, em_gain=em_gain, fidelity="quick", switches=FEW_HITS
    )
    path = simulator.write_level0(seen, tmp_path)
    assert simulator.check_level0(path) == []


@pytest.mark.parametrize("exposure_s", [1e-6, 1e6])
def test_calibrations(exposure_s):
    dark = simulator.calibrate("DARK", exposure_s=exposure_s, em_gain=1.0 + 1e-12, switches=FEW_HITS)
    assert dark.frame(0).adu.dtype == np.uint16


def test_simulate_products(tmp_path):
    made = cpic_planner.simulate_products(
        load_scene(scene(30.0)), tmp_path / "tree", band="F520", exposure_s=1e-6, frames=1, fidelity="quick"
    )
    assert simulator.check_level0(tmp_path / "tree" / made.sequences[0].file) == []


@pytest.mark.parametrize(
    ("v_mag", "exposure_s", "n_frames", "em_gain"),
    list(itertools.product((-27.0, 5.0, 30.0), (1e-6, 30.0, 1e6), (1, 10**6), (1.0, 1.0 + 1e-12, 1000.0))),
)
def test_forecasts_are_finite(v_mag, exposure_s, n_frames, em_gain):
    sizes = forecast(
        load_scene(scene(v_mag)),
        simulator.load_instrument(),
        band="F520",
        exposure_s=exposure_s,
        n_frames=n_frames,
        em_gain=em_gain,
    ).sizes
    for key, size in sizes.items():
        for quantity, value in size.items():
            assert np.isfinite(value), (key, quantity)
            assert value >= 0, (key, quantity)
