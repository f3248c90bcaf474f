"""The dust disc: brightness from magnitudes, light of the disc, and apertures on rendered images.

What a subtraction leaves of a companion's wings, against images of both rolls.
"""

import math

import numpy as np
import pytest

from cpic_planner.confirm import scene_target
from cpic_planner.etc import aperture_rates, build_model, stack_noise
from cpic_planner.queries import Strategy
from simulator import load_instrument, load_scene, observe, single_band_psf
from simulator.imaging import aperture_sums, off_axis_light, overlap_weights, psf_metrics, window_of
from simulator.signal import aperture_exozodi, exozodi_disc, wings_variance
from simulator.signal.light import exozodi_fraction_arcsec2
from simulator.target import scene_sources, sky_to_detector

ZODIS = 50.0


def figures(band):
    return psf_metrics(load_instrument(), band)


@pytest.mark.parametrize(("absolute_v_mag", "distance_pc"), [(4.83, 10.0), (4.83, 3.7), (1.4, 7.7), (6.9, 25.0)])
@pytest.mark.parametrize("au", [0.5, 1.0, 5.2])
def test_brightness_is_that_of_magnitudes(absolute_v_mag, distance_pc, au):
    """22 mag/arcsec2 at 1 au of a star of M_V 4.83, in proportion to light and r^-2; over the star's own light."""
    surface = 22.0 - 2.5 * math.log10(3.0) + (absolute_v_mag - 4.83) + 5 * math.log10(au)
    star = absolute_v_mag + 5 * math.log10(distance_pc / 10)
    found = exozodi_fraction_arcsec2(au / distance_pc, 3.0)
    assert found == pytest.approx(10 ** (-0.4 * (surface - star)), rel=1e-12)


def test_brightness_in_numbers():
    assert exozodi_fraction_arcsec2(1.0, 1.0) == pytest.approx(1.355e-9, rel=1e-3)
    assert exozodi_fraction_arcsec2([0.5, 1.0], [[1.0], [2.0]]).shape == (2, 2)
    assert exozodi_fraction_arcsec2(0.5, 0.0) == 0.0


def test_disc_holds_the_light_between_its_edges():
    disc = exozodi_disc(ZODIS)
    edge = np.geomspace(disc.inner_arcsec, disc.outer_arcsec, 20001)
    middle = np.sqrt(edge[1:] * edge[:-1])
    light = np.sum(exozodi_fraction_arcsec2(middle, ZODIS) * np.pi * np.diff(edge**2))
    assert disc.contrast == pytest.approx(light, rel=1e-6)
    assert (disc.slope, disc.inclination_deg) == (-2.0, 0.0)
    assert exozodi_disc(0.0) is None
    instrument = load_instrument()
    assert all(disc.outer_arcsec > instrument.hole_outer_arcsec(band) * math.sqrt(2) for band in instrument.bands)


@pytest.mark.parametrize("band", ["F520", "F850"])
def test_apertures_of_images_hold_as_much(band):
    """Every aperture that lies in the hole."""
    instrument, metrics = load_instrument(), figures(band)
    bare = {"name": "s", "cstar": {"v_mag": 5.0, "teff_k": 5800}}
    asked = {"band": band, "exposure_s": 1.0, "window": "hole", "fidelity": "quick", "instrument": instrument}
    dusty = observe(bare | {"extended": [exozodi_disc(ZODIS)]}, **asked)
    clean = observe(bare, **asked)
    seen = (dusty.mean_rate_map - clean.mean_rate_map) / dusty.truth.sources[0].rate_e_s
    radius, pixel = metrics.aperture_radius_arcsec, metrics.pixel_scale_arcsec
    sums = aperture_sums(seen, overlap_weights(radius / pixel))
    offset = (np.arange(len(sums)) - len(sums) // 2) * pixel
    x, y = np.meshgrid(offset, offset)
    low, high = metrics.hole_inner_arcsec + radius, metrics.hole_outer_arcsec - radius
    inside = (np.minimum(abs(x), abs(y)) >= low) & (np.maximum(abs(x), abs(y)) <= high)
    assert inside.sum() > 500
    ratio = sums[inside] / aperture_exozodi(metrics, ZODIS, x[inside], y[inside])
    assert ratio.mean() == pytest.approx(1.0, abs=0.01)
    assert np.all(abs(ratio - 1.0) < 0.026)


def test_mask_keeps_the_light_away():
    metrics = figures("F520")
    open_, edge, behind = aperture_exozodi(metrics, ZODIS, [0.4, metrics.mask_half_width_arcsec, 0.0], 0.4)
    assert open_ > edge > behind == 0.0
    area = math.pi * metrics.aperture_radius_arcsec**2
    most = exozodi_fraction_arcsec2(0.4 * math.sqrt(2), ZODIS) * area * metrics.apodizer_energy
    assert 0.97 * most < open_ < 0.98 * most  # less the far wings
    assert np.isfinite(aperture_exozodi(metrics, ZODIS, 0.0, 0.0))


def test_amount_scales_and_none_is_zero():
    metrics = figures("F520")
    x = np.linspace(0.2, 0.6, 6).reshape(2, 3)
    one = aperture_exozodi(metrics, ZODIS, x, 0.5)
    assert one.shape == (2, 3)
    assert aperture_exozodi(metrics, 2 * ZODIS, x, 0.5) == pytest.approx(2 * one, rel=1e-12)
    assert aperture_exozodi(metrics, 0.0, x, 0.5).tolist() == [[0.0] * 3] * 2


@pytest.mark.parametrize(
    ("ask", "word"),
    [
        (lambda: exozodi_fraction_arcsec2(0.0, 1.0), "separation_arcsec"),
        (lambda: exozodi_fraction_arcsec2(math.nan, 1.0), "separation_arcsec"),
        (lambda: exozodi_fraction_arcsec2(0.5, -1.0), "n_zodis"),
        (lambda: exozodi_disc(-1.0), "n_zodis"),
        (lambda: exozodi_disc(1e6), "n_zodis"),
        (lambda: aperture_exozodi(figures("F520"), ZODIS, math.inf, 0.0), "x_arcsec"),
    ],
)
def test_bad_input_is_refused(refused, ask, word):
    refused(word, ask)


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
