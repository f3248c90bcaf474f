"""Every size against images with and without the effect."""

import math

import numpy as np
import pytest

from cpic_core import stream
from simulator import load_instrument, observe
from simulator.camera import aperture_loss_per_s
from simulator.detectors import VISIBLE
from simulator.detectors.chains import switched
from simulator.effects import draw_cosmic_rays
from simulator.ledger import forecast
from simulator.ledger.case import pixel_hits

SETTINGS = {"band": "F662", "exposure_s": 2.0, "n_frames": 4, "em_gain": 20.0}
# Nothing overflows in the scene, and the clocks of the register make nothing by default.
ELSEWHERE = ("blooming", "register_full_well", "register_clock_charge")
FLUX = ("flat", "smear", "nonlinearity", "parallel_cti", "serial_cti")


@pytest.fixture(scope="module")
def bright(make, calm, report):
    """A scene, its observation and the predicted sizes."""
    scene = make(v_mag=3.0)
    whole = observe(scene, **SETTINGS, window="hole", instrument=calm)
    return scene, whole, forecast(scene, calm, **SETTINGS), report.truth


@pytest.mark.parametrize("key", [name for name in switched(VISIBLE) if name not in ELSEWHERE])
def test_size_of_a_switch_bounds_what_it_changes(key, bright, calm):
    scene, whole, said, truth = bright
    # Without the dark current its structure and the charge of hot pixels go too.
    more = ("dark_structure", "bad_pixels", "bad_columns") if key == "dark" else ()
    base = (
        whole
        if not more
        else observe(scene, **SETTINGS, window="hole", instrument=calm, switches=dict.fromkeys(more, False))
    )
    short = observe(scene, **SETTINGS, window="hole", instrument=calm, switches=dict.fromkeys((key, *more), False))
    true = truth.true_difference(base, short)
    for name in ("planet_flux", "snr", "pixel_map"):
        size, found = said.sizes[key][name], getattr(true, name)
        # Half a share of a variance is the first order of the change that follows.
        most = size if size < 0.2 or name == "planet_flux" else math.inf
        assert found <= 1.1 * most / max(1.0 - 2.0 * min(size, 0.3), 0.4) + 1e-5, name
        if found > 1e-3:
            assert size < 30 * found, name
    if key in FLUX:
        assert true.planet_flux > 1e-8


def test_saturation_is_seen_where_it_is(make, calm):
    faint, blooming = (forecast(make(v_mag=v), calm, **(SETTINGS | {"exposure_s": 300.0})) for v in (9.0, -2.0))
    for key in ("blooming", "register_full_well"):
        assert faint.sizes[key]["pixel_map"] < 1e-12
        assert faint.sizes[key]["planet_flux"] == 0.0
    assert blooming.sizes["register_full_well"]["pixel_map"] > 1.0
    assert blooming.sizes["register_full_well"]["planet_flux"] == 1.0
    # and with it everything that could tip the balance
    assert blooming.sizes["smear"]["planet_flux"] == 1.0
    assert blooming.sums.status.value == "saturated"
    assert faint.sums.status.value == "ok"


def test_reduced_sizes_leave_what_is_calibrated(make, calm):
    said = forecast(make(), calm, **SETTINGS, reduced=True).sizes
    for key in """
        flat dark_structure bad_pixels bad_columns stripes interference bias_drift nonlinearity
    """.split():
        assert said[key]["planet_flux"] == said[key]["snr"] == said[key]["pixel_map"] == 0.0
    assert said["parallel_cti"]["planet_flux"] > 0
    assert said["cosmic_rays"]["snr"] > 0


def test_particles_cost_frames(make, calm):
    said = forecast(make(v_mag=9.0), calm, **(SETTINGS | {"exposure_s": 300.0})).sizes["cosmic_rays"]["snr"]
    lost = aperture_loss_per_s(calm, "F662")
    assert said == pytest.approx(1.0 - math.sqrt(math.exp(-lost * 300.0)), rel=1e-12)


def test_moments_of_tracks_are_those_of_other_tracks(calm):
    rays, pixel = calm.cosmic_rays, calm.detector.pixel_um
    said = pixel_hits(rays, pixel)
    area = (1000 * pixel * 1e-4) ** 2
    drawn = draw_cosmic_rays(rays, (1000, 1000), pixel, 1.0, 6000.0 / area, stream(9, "other"))
    charge = drawn.electrons.astype(float)
    assert said.mean_e == pytest.approx(charge.sum() / drawn.n_events, rel=0.05)
    assert said.square_e2 == pytest.approx((charge**2).sum() / drawn.n_events, rel=0.1)
    level = 1000.0
    assert said.share_above(level) == pytest.approx((charge[charge >= level] ** 2).sum() / (charge**2).sum(), abs=0.05)


@pytest.mark.parametrize("place", [(0.9, 0.35), (2.0, 2.5), (6.0, -0.4)])
def test_size_of_a_star_left_out(place, make, calm, report):
    x, y = place
    star = {
        "name": "t",
        "v_mag": 9.0,
        "teff_k": 5000,
        "separation_arcsec": math.hypot(x, y),
        "pa_deg": math.degrees(math.atan2(-x, y)) % 360,
    }
    whole, short = (observe(make(stars=part), **SETTINGS, window="hole", instrument=calm) for part in ([star], []))
    true = report.truth.true_difference(whole, short)
    said = forecast(make(stars=[star]), calm, **SETTINGS).sizes["star:t"]
    for name in ("snr", "pixel_map"):
        assert getattr(true, name) <= 1.1 * said[name] + 1e-6, name
    assert said["planet_flux"] == 0.0


def test_settings_of_the_optics_for_a_scene(make, calm, report):
    from simulator.knobs import FIDELITIES

    best = FIDELITIES["reference"].model_copy(update={"pupil_samples": 64})
    scene = make(v_mag=3.0)
    settings = SETTINGS | {"window": "hole", "instrument": calm}
    whole, said = observe(scene, **settings, fidelity=best), forecast(scene, calm, **SETTINGS).knob_sizes
    for key, value in (("wavelength_nodes", 1), ("wavelength_nodes", 3), ("pixel_nodes", 2), ("precision", "single")):
        short = observe(scene, **settings, fidelity=best.model_copy(update={key: value}))
        true = report.truth.true_difference(whole, short)
        for name in ("planet_flux", "snr", "pixel_map"):
            assert getattr(true, name) <= 1.1 * said[key][value][name] + 1e-9, (key, value, name)
            if getattr(true, name) > 1e-4:
                assert said[key][value][name] < 50 * getattr(true, name), (key, value, name)


def test_fewer_epochs_miss_the_variance_of_a_walk(make):
    """Variance of the mean of a walk sampled at the middle of e intervals, by its covariance min(s, s')."""
    exact = 1.0 / 3.0
    for epochs in (1, 2, 3, 6):
        middle = (np.arange(epochs) + 0.5) / epochs
        sampled = np.minimum(middle[:, None], middle).mean()
        assert sampled == pytest.approx(exact * (1.0 + 0.5 / epochs**2), rel=1e-12)
    walking = load_instrument({"drift": {"visit_nm": 0.0, "walk_nm_per_sqrt_hour": 0.5}})
    said = forecast(make(v_mag=0.0), walking, **(SETTINGS | {"n_frames": 1000}))
    few, more = (said.knob_sizes["drift_epochs"][n]["snr"] for n in (1, 6))
    assert few > 20 * more > 0
    assert said.knob_sizes["drift_epochs"][12]["snr"] == 0.0
    assert said.knob_sizes["drift_epochs"][1]["pixel_map"] > said.knob_sizes["drift_epochs"][6]["pixel_map"] > 0
