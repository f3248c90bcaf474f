"""Where charge flows, against the camera's own blooming and register on whole frames."""

import math

import numpy as np
import pytest

from simulator import observe
from simulator.detectors import Blooming
from simulator.detectors.chains import VISIBLE, switched
from simulator.imaging import psf_metrics
from simulator.ledger import NOT_IN_SUMS, forecast
from simulator.ledger.visit import _arrives

STILL = {name: False for name in NOT_IN_SUMS if name in switched(VISIBLE)}


def flows(scene, instrument, settings):
    """Whether charge arrives in the aperture of the planet, in the mean image of the whole frame: bloomed, trailed."""
    seen = observe(scene, instrument=instrument, **settings, switches=STILL)
    exposure = seen.camera_chain.prepare(seen.mean_rate_map, seen.exposure_s, seen.em_gain)
    before = exposure.mean_e
    after = before.copy()
    Blooming().expect(after, exposure)
    well = instrument.detector.register_full_well_e / seen.em_gain
    carried = np.zeros(before.shape)
    queue = np.zeros(len(before))
    for column in range(before.shape[1]):
        carried[:, column] = queue
        queue = np.maximum(queue + after[:, column] - well, 0.0)
    y, x = np.indices(before.shape)
    reach = psf_metrics(instrument, seen.band).aperture_radius_arcsec / seen.pixel_scale_arcsec + 1.0
    inside = np.hypot(y - seen.truth.y_pixel[1], x - seen.truth.x_pixel[1]) <= reach
    return bool((np.abs(after - before)[inside] > 1e-9).any()), bool((carried[inside] > 0).any())


CASES = [
    # (place of the planet, V, exposure, gain, band): dim, saturated far away, tails that stop short, tails that arrive
    (0.42, 0.42, 5.0, 10.0, 20.0, "F662"),
    (0.46, 0.46, 1.35, 60.0, 50.0, "F662"),
    (0.46, 0.46, -1.0, 60.0, 50.0, "F662"),
    (-0.46, 0.4, 0.0, 60.0, 300.0, "F850"),
    (0.2, 0.6, 0.0, 100.0, 1.0, "F520"),
    (0.6, 0.2, 0.0, 100.0, 1.0, "F520"),
    (0.3, 0.3, -1.5, 900.0, 1.0, "F720"),
]


@pytest.mark.long
def test_charge_that_arrives_is_foreseen(make, calm):
    """Of tails and of bloomed columns, some arrive and some do not."""
    arrived = []
    for x, y, v_mag, exposure_s, em_gain, band in CASES:
        settings = {"band": band, "exposure_s": exposure_s, "n_frames": 2, "em_gain": em_gain}
        sizes = forecast(make(x, y, v_mag=v_mag), calm, **settings, full=True).sizes
        foreseen = max(sizes[key]["planet_flux"] for key in ("blooming", "register_full_well")) > 0.5
        here, brighter = (flows(make(x, y, v_mag=v), calm, settings) for v in (v_mag, v_mag - 2.0))
        assert foreseen or not any(here), settings
        # and not out of thin air: a star two magnitudes brighter does it
        assert any(brighter) or not foreseen, settings
        arrived.append(here)
    for kind in zip(*arrived, strict=True):
        assert 0 < sum(kind) < len(CASES)


def test_a_neighbour_in_the_same_rows(make, calm):
    """Another star beside the stamp trails into the hole from one side, and not where its rows are others."""
    settings = {"band": "F662", "exposure_s": 30.0, "n_frames": 2, "em_gain": 300.0}

    def trails(x, y, v_mag):
        star = {
            "name": "t",
            "v_mag": v_mag,
            "teff_k": 5000,
            "separation_arcsec": math.hypot(x, y),
            "pa_deg": math.degrees(math.atan2(-x, y)) % 360,
        }
        scene = make(v_mag=9.0, stars=[star])
        said = forecast(scene, calm, **settings, full=True).sizes["register_full_well"]["planet_flux"] > 0.5
        return said, flows(scene, calm, settings)[1]

    assert trails(-1.6, 0.42, 3.0) == (True, True)
    assert trails(1.6, 0.42, 7.5) == (False, False)  # it is read after the planet
    assert trails(-1.6, -0.42, 7.5) == (False, False)


@pytest.mark.parametrize("well", [10.0, 20.0])
def test_runs_against_the_queue_of_a_register(well):
    """A queue that passes on what a pixel cannot hold is empty at the end exactly if no run is over-full."""
    rng = np.random.default_rng(4)
    light = rng.gamma(0.3, 30.0, (400, 25))
    queue = np.zeros(400)
    for column in range(light.shape[1]):
        queue = np.maximum(queue + light[:, column] - well, 0.0)
    found = _arrives([(light[:, ::-1], 1.0)], well, 0.0)
    np.testing.assert_array_equal(found, queue > 0)
    assert 0.1 < found.mean() < 0.9
    # boxes of several pixels are runs of their mean
    whole = _arrives([(light[:, ::-1][:, :5], 1.0), (np.full((400, 2), 8.0), 10.0)], well, 0.0)
    same = _arrives([(np.concatenate([light[:, ::-1][:, :5], np.full((400, 20), 8.0)], axis=1), 1.0)], well, 0.0)
    assert (whole == same).all()


def test_switched_off_nothing_flows(make, calm):
    settings = {"band": "F662", "exposure_s": 60.0, "n_frames": 2, "em_gain": 300.0}
    off = calm.switched({"blooming": False, "register_full_well": False})
    said = forecast(make(v_mag=-1.0), off, **settings, full=True).sizes
    assert said["blooming"]["planet_flux"] == said["register_full_well"]["planet_flux"] == 0.0
    said = forecast(make(v_mag=-1.0), calm, **settings, full=True).sizes
    assert said["register_full_well"]["planet_flux"] == 1.0
