"""What a subtraction leaves of a companion's wings, against images of both rolls."""

import numpy as np
import pytest

from cpic_planner.etc.model import Strategy, build_model
from cpic_planner.etc.noise import stack_noise
from cpic_planner.etc.rates import aperture_rates
from cpic_planner.scene_confirmation import scene_target
from simulator import load_instrument, load_scene, single_band_psf
from simulator.imaging.aperture import aperture_sums, overlap_weights
from simulator.imaging.frame import off_axis_light, window_of
from simulator.signal.wings import wings_variance
from simulator.target.positions import sky_to_detector
from simulator.target.sources import scene_sources

INSTRUMENT = load_instrument()
ROLL, STAR = Strategy(library="roll"), Strategy(library="reference_star", reference_star={"v_mag": 1.0})
RANDOM = np.random.default_rng(5)
PLACES = [(1.8 * 10.0 ** RANDOM.uniform(0.0, 1.0), RANDOM.uniform(0.0, 360.0)) for _ in range(16)]


def left(model, band, star, separation_arcsec):
    """What the references leave of a companion's light, by the places that a library shows it at."""
    half = model.strategy.roll_deg / 2
    rolls = {"roll": (-half, half), "reference_star": (0.0,)}.get(model.strategy.library, ())
    found = [
        sky_to_detector(star.companion_separation_arcsec, star.companion_pa_deg, roll_deg=roll, parity=-1)
        for roll in rolls
    ]
    return wings_variance(model.metrics[band], found, model.strategy.annulus_lambda_d, separation_arcsec)


def target(separation=4.0, pa=30.0, **more):
    near = {"name": "B", "v_mag": 3.0, "teff_k": 5800, "separation_arcsec": separation, "pa_deg": pa}
    star = {"v_mag": 3.0, "teff_k": 5800, "log_g": 4.4, "metallicity": 0.0, "ra_deg": 1.0, "dec_deg": 2.0}
    scene = load_scene({"name": "A", "cstar": star, "stars": [near]} | more)
    return scene, scene_target(scene)


def seen_rms(model, band, scene, separation_arcsec):
    """Rms of aperture sums of the difference, whole apertures of the annulus, per unit companion."""
    metrics, psf, strategy = model.metrics[band], single_band_psf(band), model.strategy
    half = strategy.roll_deg / 2 if strategy.library == "roll" else 0.0
    remains = 0.0
    for sign in (1, -1) if half else (1,):
        source = scene_sources(scene, INSTRUMENT, band, roll_deg=-sign * half)[1]
        light = off_axis_light(psf, window_of(psf, INSTRUMENT, full=False), [source], (), roll_deg=0.0)
        remains = remains + sign * light / source.rate_e_s
    sums = aperture_sums(remains, overlap_weights(metrics.aperture_radius_arcsec / metrics.pixel_scale_arcsec))
    offset = (np.arange(len(sums)) - len(sums) // 2) * metrics.pixel_scale_arcsec
    whole = metrics.zone.covers(offset, offset, -metrics.aperture_radius_arcsec)
    near = abs(np.hypot(offset[:, None], offset) - separation_arcsec)
    return sums[whole & (near < strategy.annulus_lambda_d * metrics.lambda_d_arcsec)].std()


@pytest.mark.parametrize(("band", "strategy"), [("F520", ROLL), ("F850", STAR)], ids=["roll", "reference star"])
def test_the_rms_is_that_of_images(band, strategy):
    """To a factor of 1.4 for half of the places and of 2 for most, without a bias of more than 1.3."""
    model, ratio = build_model(INSTRUMENT, [band], strategy), []
    for place in PLACES:
        scene, star = target(*place)
        expected = np.sqrt(left(model, band, star, np.array([[0.6]])))[0, 0]
        ratio.append(np.log(seen_rms(model, band, scene, 0.6) / expected))
    assert np.median(np.abs(ratio)) < np.log(1.4)
    assert np.mean(np.abs(ratio) < np.log(2.0)) > 0.8
    assert abs(np.median(ratio)) < np.log(1.3)


def test_a_library_that_shows_the_same_wings_leaves_none():
    model, (_, star) = build_model(INSTRUMENT, ["F662"]), target()
    np.testing.assert_array_equal(left(model, "F662", star, np.array([[0.6, 0.7]])), np.zeros((1, 2)))


@pytest.mark.parametrize("library", ["same_star_planet_free", "idealised"])
def test_nothing_is_left_in_the_rates_of_such_a_library(library):
    model, (_, star) = build_model(INSTRUMENT, ["F662"], Strategy(library=library)), target()
    x = np.full((1, 1), 0.42)
    assert not np.any(aperture_rates(model, star, "F662", x, x, np.full((1, 1), 1e-9)).wings_e2_s2)


def test_a_roll_of_nothing_leaves_their_structure_and_no_course():
    """The course goes with the angle; the fine structure of both wings stays, as it were of two places."""
    (_, star), found = target(), []
    for roll in (1e-6, 30.0):
        model = build_model(INSTRUMENT, ["F662"], Strategy(library="roll", roll_deg=roll))
        found.append(left(model, "F662", star, np.array([[0.6]]))[0, 0])
    assert found[0] < found[1]


def test_the_residual_does_not_average_and_stars_without_companion_have_none():
    model = build_model(INSTRUMENT, ["F662"], ROLL)
    terms = {}
    for name, star in (("on", target()[1]), ("off", target(companions="off")[1]), ("none", target(stars=[])[1])):
        x = np.full((1, 1), 0.42)
        rates = aperture_rates(model, star, "F662", x, x, np.full((1, 1), 1e-9))
        terms[name] = [stack_noise(rates, 10.0, n, 100.0, model.camera("F662")) for n in (10.0, 1000.0)]
    few, many = (part.terms["companion_wings"] for part in terms["on"])
    np.testing.assert_allclose(many, 1e4 * few, rtol=1e-12)
    assert terms["on"][1].snr < terms["off"][1].snr
    for name in ("off", "none"):
        assert not np.any(terms[name][1].terms["companion_wings"])


def test_separations_of_each_star_and_shared_ones_agree():
    model, (_, star) = build_model(INSTRUMENT, ["F662"], ROLL), target()
    both = star.select([0, 0])
    shared = np.linspace(0.3, 0.95, 7)[None, :]
    one = left(model, "F662", star, shared)
    assert one.shape == (1, 7)
    np.testing.assert_array_equal(left(model, "F662", both, shared), np.tile(one, (2, 1)))
    np.testing.assert_array_equal(left(model, "F662", both, np.tile(shared, (2, 1))), np.tile(one, (2, 1)))
