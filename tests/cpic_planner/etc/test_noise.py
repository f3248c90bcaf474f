"""The noise of a stack, term by term, and the solver's view of it."""

from dataclasses import replace

import numpy as np
import pytest

from cpic_planner.etc import FrameCamera, Programme, aperture_rates, build_model, frame_problem, own_noise, stack_noise
from cpic_planner.etc.photon_counting import counting_law, counting_variance
from cpic_planner.queries import Strategy
from cpic_planner.targets import rank_sample
from simulator.config import load_instrument
from simulator.detectors import FrameTerm, excess_noise_factor2
from simulator.signal import ProgrammeLaw

INSTRUMENT = load_instrument({"sky": {"exozodi_zodis": 3.0}})
STARS = rank_sample(v_mag_max=4.0)
PAIR = STARS.select(np.flatnonzero(np.isfinite(STARS.companion_v_mag) & (STARS.companion_separation_arcsec > 4))[:3])
LIGHT = ("halo", "companion", "sky", "exozodi", "dark")
LIBRARIES = {
    "same_star": {},
    "many references": {"reference_ratio": 10.0},
    "few references": {"reference_ratio": 0.1},
    "roll": {"library": "roll"},
    "idealised": {"library": "idealised"},
    "brighter star": {"library": "reference_star", "reference_star": {"v_mag": 0.0}},
    "fainter star": {"library": "reference_star", "reference_star": {"v_mag": 6.0, "teff_k": 4000}},
}


MODES = Programme(
    visits=np.array(4.0),
    reference_visits=np.array(4.0),
    speckle=np.array([[0.7], [0.6], [0.5]]),
    white=np.array(0.9),
    throughput=np.array([[0.8], [0.9], [0.85]]),
)


def rates_of(strategy=None, instrument=INSTRUMENT, contrast=3e-9, stars=PAIR):
    model = build_model(instrument, ["F520"], strategy)
    x = y = np.array([0.55 / 2**0.5])
    return aperture_rates(model, stars, "F520", x[None], y[None], np.full((len(stars), 1), contrast)), model


def only(rates, **kept):
    """The rates without noise but for some."""
    zero = 0.0 * rates.planet_e_s
    names = (*(f"{name}_e_s" for name in LIGHT), "reference_light_e_s", "smear_e", "reference_smear_e", "wings_e2_s2")
    none = dict.fromkeys(names, zero)
    return replace(rates, **none | {"speckle": rates.speckle.scaled(zero)} | kept)


@pytest.mark.parametrize("mode", ["analogue", "photon_counting"])
@pytest.mark.parametrize("library", LIBRARIES)
def test_the_solver_sees_the_noise_of_the_stack(library, mode):
    strategy = Strategy(**LIBRARIES[library], mode=mode)
    rates, model = rates_of(strategy)
    camera, exposure, frames = model.camera("F520"), 0.2, 40.0
    gain = camera.em_gain_max if mode == "photon_counting" else 123.0
    noise = stack_noise(rates, exposure, frames, gain, camera, strategy)
    for objective in ("snr", "significance"):
        problem = frame_problem(rates, camera, strategy, objective=objective, em_gain=gain)
        seen = problem.inverse_snr2(np.full(problem.z0.shape, exposure), np.full(problem.z0.shape, frames)) ** -0.5
        np.testing.assert_allclose(seen, getattr(noise, objective), rtol=1e-12)


def test_the_noise_of_some_cases_is_theirs_without_terms():
    rates, model = rates_of()
    noise = stack_noise(rates, np.array([[[5.0]], [[7.0]]]), 40.0, 100.0, model.camera("F520"))
    some = noise.at((1, 0, 0))
    for name in ("signal_e", "quiet", "white", "speckle", "errors", "snr", "significance"):
        assert getattr(some, name) == np.broadcast_to(getattr(noise, name), noise.snr.shape)[1, 0, 0]
    assert some.terms == {}


@pytest.mark.parametrize("mode", ["analogue", "photon_counting"])
@pytest.mark.parametrize("library", LIBRARIES)
def test_terms_add_up(library, mode):
    strategy = Strategy(**LIBRARIES[library], mode=mode)
    rates, model = rates_of(strategy)
    noise = stack_noise(rates, 0.2, 90.0, 1000.0, model.camera("F520"), strategy)
    quiet = sum(part for name, part in noise.terms.items() if name not in ("planet", "background_mean"))
    quiet = np.broadcast_to(quiet, noise.snr.shape)
    np.testing.assert_allclose(np.broadcast_to(noise.quiet, quiet.shape), quiet, rtol=1e-12)
    left = ("planet", "background_mean", "speckle", "common_speckle", "companion_wings")
    white = sum(part for name, part in noise.terms.items() if name not in left)
    assert np.any(noise.terms["companion_wings"] > 0) == (library in ("roll", "brighter star", "fainter star"))
    np.testing.assert_allclose(*np.broadcast_arrays(noise.white, white), rtol=1e-9)
    np.testing.assert_allclose(noise.signal_e**2 / noise.significance**2, quiet, rtol=1e-12)
    np.testing.assert_allclose(noise.signal_e**2 / noise.snr**2, sum(noise.terms.values()), rtol=1e-12)
    assert np.all(np.array([np.broadcast_to(part, quiet.shape) for part in noise.terms.values()]) >= 0)


@pytest.mark.parametrize("mode", ["analogue", "photon_counting"])
def test_modes_change_each_term_by_what_they_leave_of_it(mode):
    """Of the flux over what is left of the planet: common speckles are one more draw of the same field."""
    shared = load_instrument({"drift": {"common_fraction": 0.2}})
    strategy = Strategy(library="roll", mode=mode)
    rates, model = rates_of(strategy, instrument=shared)
    camera, gain = model.camera("F520"), 900.0
    mean, modes = (stack_noise(rates, 0.2, 40.0, gain, camera, strategy, one) for one in (MODES.of_mean(), MODES))
    np.testing.assert_array_equal(modes.signal_e, mean.signal_e)
    through2 = MODES.throughput**2
    changes = dict.fromkeys(mean.terms, MODES.white / through2)
    changes |= dict.fromkeys(("speckle", "common_speckle"), MODES.speckle / through2)
    changes |= {"companion_wings": 1.0 / through2}
    if mode == "analogue":
        changes |= {"planet": 1.0 / MODES.throughput}
    quiet = sum(term * changes[name] for name, term in mean.terms.items() if name not in ("planet", "background_mean"))
    for name, term in mean.terms.items():
        if name == "background_mean":
            np.testing.assert_allclose(modes.terms[name], quiet / rates.background_apertures, rtol=1e-12)
        else:
            np.testing.assert_allclose(modes.terms[name], term * changes[name], rtol=1e-12)
    assert np.all(mean.terms["common_speckle"] > 0.0)
    for objective in ("snr", "significance"):
        problem = frame_problem(rates, camera, strategy, objective=objective, em_gain=gain, programme=MODES)
        seen = problem.inverse_snr2(np.full(problem.z0.shape, 0.2), np.full(problem.z0.shape, 40.0)) ** -0.5
        np.testing.assert_allclose(seen, getattr(modes, objective), rtol=1e-12)


def test_each_term_is_what_its_name_says():
    """Written out: pixels that the circle cuts count with their weight squared, and nothing else is shared."""
    rates, model = rates_of()
    camera, t, n, gain = model.camera("F520"), 12.0, 50.0, 80.0
    noise = stack_noise(rates, t, n, gain, camera)
    f2 = float(excess_noise_factor2(gain, camera.register_stages))
    clean = n * np.exp(model.loss_per_s("F520") * t)
    for name in LIGHT:
        expected = clean * rates.noise_fraction * f2 * getattr(rates, f"{name}_e_s") * t
        assert np.all(np.abs(noise.terms[name] - expected) <= 1e-12 * expected)
    pixels = clean * rates.noise_fraction * rates.aperture_pixels
    expected = {
        "smear": clean * rates.noise_fraction * f2 * rates.smear_e,
        "cic": pixels * f2 * camera.cic_e,
        "read_noise": pixels * camera.read_noise_e**2 / gain**2,
        "rounding": pixels * (model.instrument.detector.gain_e_adu**2 / 12) / gain**2,
    }
    for name, value in expected.items():
        assert np.all(np.abs(noise.terms[name] - value) <= 1e-12 * value)
    same = sum(noise.terms[name] for name in (*LIGHT, *expected))
    np.testing.assert_allclose(noise.terms["reference"], same, rtol=1e-12)
    own = clean * rates.source_noise_fraction * f2 * rates.planet_e_s * t
    np.testing.assert_allclose(noise.terms["planet"], own, rtol=1e-12)
    visit = n * (t + camera.readout_s)
    left = noise.terms["speckle"] + noise.terms["common_speckle"]
    np.testing.assert_allclose(left, (n * t) ** 2 * rates.speckle.law().variance(visit), rtol=1e-12)
    np.testing.assert_allclose(noise.terms["common_speckle"], (n * t) ** 2 * rates.speckle.common.k0, rtol=1e-12)


def test_white_noise_averages_and_speckles_do_not():
    rates, model = rates_of()
    camera = model.camera("F520")
    science, reference, common = (part.stretched(0.0) for part in rates.speckle[:3])
    still = replace(rates, speckle=ProgrammeLaw(science, reference, common))
    floor = rates.planet_e_s / np.sqrt(rates.speckle.law().k0)
    far = stack_noise(still, 10.0, 1e12, 300.0, camera)
    np.testing.assert_allclose(far.significance, np.broadcast_to(floor, far.significance.shape), rtol=1e-6)
    white = replace(rates, speckle=rates.speckle.scaled(0.0))
    few, many = (stack_noise(white, 10.0, n, 300.0, camera) for n in (10.0, 1000.0))
    np.testing.assert_allclose(many.snr / few.snr, 10.0, rtol=1e-12)
    walking = [stack_noise(rates, 10.0, n, 300.0, camera).significance for n in (1e3, 1e6)]
    assert np.all(walking[1] < walking[0])


def test_photon_limited_snr_is_the_textbook_one():
    """Planet alone, gain 1, no detector: the square root of its electrons; at high gain that over F."""
    rates, model = rates_of()
    camera = replace(model.camera("F520"), cic_e=0.0, read_noise_e=0.0, rounding_e=0.0)
    alone = only(replace(rates, source_noise_fraction=1.0, loss_per_s=0.0))
    for gain in (1.0, 20.0, 1000.0):
        noise = stack_noise(alone, 100.0, 30.0, gain, camera)
        f2 = float(excess_noise_factor2(gain, camera.register_stages))
        np.testing.assert_allclose(noise.snr, np.sqrt(noise.signal_e / f2), rtol=1e-12)


def test_no_planet_no_snr():
    rates, model = rates_of(contrast=0.0)
    noise = stack_noise(rates, 10.0, 5.0, 20.0, model.camera("F520"))
    assert np.all(noise.snr == 0)
    assert np.all(noise.significance == 0)
    none = stack_noise(rates_of()[0], 10.0, 0.0, 20.0, model.camera("F520"))
    assert np.all(none.snr == 0)
    assert np.all(none.significance == 0)


def test_neither_planet_nor_residual_is_no_nan():
    rates, model = rates_of(contrast=0.0)
    problem = frame_problem(only(rates), model.camera("F520"))
    assert np.all(np.isinf(problem.inverse_snr2(np.full(problem.z0.shape, 10.0), np.full(problem.z0.shape, 5.0))))


def test_a_ramp_has_more_noise_of_light():
    rates, _ = rates_of()
    one = FrameCamera.of(load_instrument(), "F1265")
    ramp = replace(one, light_factor=1.2)
    plain, fitted = (stack_noise(rates, 60.0, 10.0, 1.0, camera).terms for camera in (one, ramp))
    for name in ("halo", "planet"):
        np.testing.assert_allclose(fitted[name], 1.2 * plain[name], rtol=1e-12)
    np.testing.assert_allclose(fitted["read_noise"], plain["read_noise"], rtol=1e-12)
    for camera, terms in ((one, plain), (ramp, fitted)):  # 10 frames of 60 s, less those that particles void
        lost = np.exp(rates.loss_per_s * 60.0)
        np.testing.assert_allclose(own_noise(rates, camera) * 600.0 * lost, terms["planet"], rtol=1e-12)
    for camera in (one, ramp):
        problem = frame_problem(rates, camera, objective="snr")
        seen = problem.inverse_snr2(np.full(problem.z0.shape, 60.0), np.full(problem.z0.shape, 10.0)) ** -0.5
        np.testing.assert_allclose(seen, stack_noise(rates, 60.0, 10.0, 1.0, camera).snr, rtol=1e-12)


def test_counting_uses_the_light_that_a_reference_frame_really_holds():
    """A reference star ten times as bright: its pixels count at their own mean, then the difference is scaled."""
    strategy = Strategy(library="reference_star", reference_star={"v_mag": 0.0}, mode="photon_counting")
    stars = replace(
        PAIR, v_mag=np.full(3, 2.5), teff_k=np.full(3, 5772.0), log_g=np.full(3, 4.4), metallicity=np.zeros(3)
    )
    rates, model = rates_of(strategy, stars=stars)
    camera, t, n = model.camera("F520"), 1.0, 100.0
    noise = stack_noise(rates, t, n, 1000.0, camera, strategy)
    law = counting_law(1000.0, camera.register_stages, camera.read_noise_e, 5.0 * camera.read_noise_e)
    mean = (10.0 * (rates.halo_e_s + rates.exozodi_e_s) + rates.sky_e_s + rates.dark_e_s) / rates.aperture_pixels * t
    # Its own smear: ten times the star's light in the columns, the same sky.
    alone, _ = rates_of(strategy, stars=replace(stars, companions="off", v_mag=np.full(3, 0.0)))
    mean += alone.smear_e / alone.aperture_pixels
    pixels = n * np.exp(model.loss_per_s("F520") * t)
    pixels = pixels * rates.noise_fraction * rates.aperture_pixels
    expected = pixels * counting_variance(mean + camera.cic_e, law) / 100.0
    np.testing.assert_allclose(noise.terms["reference"], expected, rtol=1e-12)


def test_too_much_light_to_count_is_infinite_noise_and_never_nan():
    strategy = Strategy(library="idealised", mode="photon_counting")
    rates, model = rates_of(strategy, contrast=0.5)
    camera = model.camera("F520")
    for objective in ("snr", "significance"):
        problem = frame_problem(rates, camera, strategy, objective=objective)
        value = problem.inverse_snr2(np.full(problem.z0.shape, 100.0), np.ones(problem.z0.shape))
        assert np.all(np.isinf(value))
    noise = stack_noise(rates, 100.0, 1.0, 1000.0, camera, strategy)
    assert np.all(noise.snr == 0.0)
    assert not any(np.isnan(part).any() for part in noise.terms.values())
    over = np.isinf(noise.terms["counting"])
    assert over.any()
    assert np.all(noise.terms["planet"][over] == 0.0)  # nothing can be told from infinity


@pytest.mark.parametrize(("light", "wins"), [(0.003, True), (0.01, True), (0.1, True), (3.0, False)])
def test_counting_photons_beats_measuring_charge_in_faint_light_only(light, wins):
    """Gain 1000, 100 e- of read noise: sky of some electrons per pixel and frame."""
    rates, model = rates_of(contrast=1e-12)
    camera = replace(model.camera("F520"), cic_e=0.0, read_noise_e=100.0, rounding_e=0.0)
    lit = only(
        rates,
        sky_e_s=light * rates.aperture_pixels + 0.0 * rates.planet_e_s,
        reference_light_e_s=light * rates.aperture_pixels + 0.0 * rates.planet_e_s,
    )
    analogue, counted = (
        stack_noise(lit, 1.0, 100.0, 1000.0, camera, Strategy(mode=mode)).significance
        for mode in ("analogue", "photon_counting")
    )
    assert np.all((counted > analogue) == wins)
    if light == 0.01:
        # 1.34 by a first-order threshold law; the exact law of the register keeps a little more.
        assert counted[0, 0] / analogue[0, 0] == pytest.approx(1.34, rel=0.03)


@pytest.mark.parametrize("ratio", [0.5, 3.0])
def test_what_another_effect_adds_has_its_own_term(ratio):
    """Electrons with time and of every frame, and variance behind the register: in science and reference frames."""
    strategy = Strategy(library="reference_star", reference_star={"v_mag": 2.0, "teff_k": 5000}, reference_ratio=ratio)
    rates, model = rates_of(strategy)
    camera = replace(model.camera("F520"), added=(("pattern", FrameTerm(0.003, 0.2, 900.0)),))
    t, n, gain = 12.0, 50.0, 80.0
    terms = stack_noise(rates, t, n, gain, camera, strategy).terms
    f2 = float(excess_noise_factor2(gain, camera.register_stages))
    area, scale = rates.aperture_pixels, rates.reference_scale
    share = n * np.exp(model.loss_per_s("F520") * t) * rates.noise_fraction
    np.testing.assert_allclose(terms["pattern"], share * area * (f2 * (0.003 * t + 0.2) + 900.0 / gain**2), rtol=1e-12)
    light = f2 * (
        rates.reference_light_e_s * t + rates.reference_smear_e + scale * area * (0.003 * t + 0.2 + camera.cic_e)
    )
    behind = scale * area * (camera.read_noise_e**2 + camera.rounding_e**2 + 900.0) / gain**2
    np.testing.assert_allclose(terms["reference"], share * (light + behind) / ratio, rtol=1e-12)


@pytest.mark.parametrize("mode", ["analogue", "photon_counting"])
def test_electrons_that_an_effect_adds_are_as_more_dark_current(mode):
    strategy = Strategy(library="reference_star", reference_star={"v_mag": 2.0, "teff_k": 5000}, mode=mode)
    rates, model = rates_of(strategy)
    plain = model.camera("F520")
    more = 0.004 * rates.aperture_pixels
    darker = replace(
        rates,
        dark_e_s=rates.dark_e_s + more,
        reference_light_e_s=rates.reference_light_e_s + rates.reference_scale * more,
    )
    added = replace(plain, added=(("pattern", FrameTerm(rate_e_s=0.004)),))
    t, gain = np.full((3, 1), 2.0), plain.em_gain_max
    cases = (rates, added), (darker, plain)
    one, other = (stack_noise(light, t, 30.0, gain, camera, strategy) for light, camera in cases)
    np.testing.assert_allclose(one.snr, other.snr, rtol=1e-12)
    np.testing.assert_allclose(one.quiet, other.quiet, rtol=1e-12)
    solved = [frame_problem(light, camera, strategy, em_gain=gain) for light, camera in cases]
    np.testing.assert_allclose(*(problem.inverse_snr2(t, np.full((3, 1), 30.0)) for problem in solved), rtol=1e-12)
