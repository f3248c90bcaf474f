"""The equations of the pages, evaluated as they stand there, are what the code computes."""

import functools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from cpic_planner import exposure_time, lambert_phase, planet_contrast
from cpic_planner.etc import (
    Programme,
    aperture_rates,
    build_model,
    search_threshold,
    searched_region,
    snr_at,
    stack_noise,
)
from cpic_planner.etc.detection_law import MAP_VISITS, _filtered_light, _law
from cpic_planner.queries import Strategy
from cpic_planner.targets import find_target
from cpic_planner.validation import detection_threshold
from simulator.config import load_instrument
from simulator.detectors import aperture_noise_pixels, clean_fraction, excess_noise_factor2
from simulator.detectors.gain import output_cumulants
from simulator.imaging import psf_metrics
from simulator.signal.light import exozodi_fraction_arcsec2
from simulator.signal.speckles import ProgrammeLaw, SpeckleLaw
from tests.docs.formulas import evaluated, formulas

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = {
    name: formulas((DOCS / "explanation" / f"{name}.md").read_text("utf-8"))
    for name in ("noise_model", "detection", "em_gain")
}
NOISE, DETECTION, GAIN = PAGES.values()
EXACT = {"rel": 1e-12}


def page(which, label, **values):
    """Return what an equation of a page gives."""
    return evaluated(which[label], values)


def test_contrast():
    phase = page(NOISE, "eq-phase", alpha=math.radians(75.0))
    assert phase == pytest.approx(lambert_phase(75.0), **EXACT)
    distance_au = 1.6 / math.sin(math.radians(75.0))
    radius_au = 71492.0 / 149597870.7
    found = page(NOISE, "eq-contrast", A=0.4, R=1.2 * radius_au, d=distance_au, Phi=phase)
    assert found == pytest.approx(planet_contrast(1.2, 0.0, 1.6, 75.0, 0.4), **EXACT)


def test_dust():
    found = page(NOISE, "eq-dust", n_z=3.0, rho=0.45)
    assert found == pytest.approx(float(exozodi_fraction_arcsec2(0.45, 3.0)), **EXACT)


@pytest.mark.parametrize("gain", [1.0, 20.0, 300.0, 1000.0])
def test_excess_noise(gain):
    stages, probability = 604, math.expm1(math.log(gain) / 604)
    exact = float(excess_noise_factor2(gain))
    mean, variance = output_cumulants(probability, stages)[:2]
    assert page(GAIN, "eq-gain", p=probability, N=stages) == pytest.approx(mean, rel=1e-10)
    assert page(NOISE, "eq-excess", g=gain, N=stages) == pytest.approx(exact, **EXACT)
    assert page(GAIN, "eq-factor", g=gain, p=probability) == pytest.approx(exact, **EXACT)
    # Of Poisson light: one for its own scatter, and that of the register for each electron.
    assert 1.0 + variance / mean**2 == pytest.approx(exact, rel=1e-9)


def test_aperture_and_particles():
    assert page(NOISE, "eq-weights", rho_a=2.3) == pytest.approx(float(aperture_noise_pixels(2.3)), **EXACT)
    found = page(NOISE, "eq-clean", **{"lambda": 2e-3, "t": 40.0})
    assert found == pytest.approx(float(clean_fraction(2e-3, 40.0)), **EXACT)


@pytest.mark.parametrize("visits", [1, 2, 7])
def test_visits_that_remember_each_other(visits):
    law = ProgrammeLaw(*[SpeckleLaw(*np.zeros(3))] * 3, correlation_time_h=2.0)
    found = page(NOISE, "eq-independent", V=float(visits), varrho=math.exp(-0.5))
    assert found == pytest.approx(float(law.independent(visits, 3600.0)), rel=1e-9)


CASES = {
    "the same star": {},
    "few references": {"reference_ratio": 0.5},
    "a brighter star": {"library": "reference_star", "reference_star": {"v_mag": 2.0}},
    "two rolls": {"library": "roll"},
}


@functools.cache
def observed(case):
    """One observation: a star, its rates, and what the calculator makes of them."""
    strategy = Strategy(**CASES[case])
    instrument = load_instrument({"sky": {"exozodi_zodis": 3.0}, "drift": {"correlation_time_h": 1.5}})
    model = build_model(instrument, ["F520"], strategy)
    star = find_target("tau Cet")[0]
    x = np.array([[0.45 / 2**0.5]])
    return strategy, model, star, aperture_rates(model, star, "F520", x, x, np.array([[2e-8]]))


@pytest.mark.parametrize("case", CASES)
def test_observation(case):
    """Each equation is evaluated with what those before it gave; the code's own numbers enter as rates alone."""
    strategy, model, _, rates = observed(case)
    camera, detector = model.camera("F520"), model.instrument.detector_of("F520")
    exposure, each, gain, visits, visit_time = 30.0, 20.0, 200.0, 3.0, 4000.0
    programme = Programme.of(strategy, visits, visit_time)
    noise = stack_noise(rates, exposure, each, gain, camera, strategy, programme)

    def one(value):
        return float(np.ravel(value)[0])

    own = {name: one(getattr(rates, f"{name}_e_s")) for name in ("halo", "companion", "sky", "exozodi", "dark")}
    background = page(NOISE, "eq-background", **dict(zip(("H", "K", "Y", "Z_d", "D"), own.values(), strict=True)))
    a, scale = one(rates.aperture_pixels), one(rates.reference_scale)
    m = one(programme.frame_ratio(strategy.reference_ratio))
    b = one(rates.variance_factor)
    rate = page(NOISE, "eq-rate", B=background, B_r=one(rates.reference_light_e_s), m=m)
    charge = page(
        NOISE,
        "eq-charge",
        q_s=one(rates.smear_e),
        q_r=one(rates.reference_smear_e),
        a=a,
        c=detector.cic_e,
        s=scale,
        m=m,
    )
    behind = page(NOISE, "eq-output", a=a, sigma_r=detector.read_noise_e, k=detector.gain_e_adu, s=scale, m=m)
    # F^2 is one symbol of the pages: the square root goes in, so that its square is what the register makes.
    factor = page(NOISE, "eq-excess", g=gain, N=detector.register_stages) ** 0.5
    frame = page(NOISE, "eq-frame", F=factor, r=rate, t=exposure, q=charge, o=behind, g=gain)
    radius = model.metrics["F520"].aperture_radius_arcsec / model.metrics["F520"].pixel_scale_arcsec
    weights = page(NOISE, "eq-weights", rho_a=radius)
    left = page(NOISE, "eq-clean", **{"lambda": one(rates.loss_per_s), "t": exposure})
    white = page(NOISE, "eq-white", b=b, V=visits, n=each, P=left, n_w=weights, a=a, v=frame)
    assert white == pytest.approx(one(noise.white), rel=1e-10)

    length = page(NOISE, "eq-visit", n=each, t=exposure, t_r=camera.readout_s)

    def speckles(law, stretch=1.0):
        k = {f"k_{power}": one(part) for power, part in enumerate(law)}
        return page(NOISE, "eq-speckle", **k, u=length * stretch)

    memory = math.exp(-visit_time / (3600.0 * rates.speckle.correlation_time_h))
    independent = page(NOISE, "eq-independent", V=visits, varrho=memory)
    stretch = one(programme.reference_length)
    residual = page(
        NOISE,
        "eq-programme",
        x_s=speckles(rates.speckle.science),
        V_e=independent,
        x_r=speckles(rates.speckle.reference, stretch),
        R_e=independent,
        x_c=speckles(rates.speckle.common),
    )
    wings = one(rates.wings_e2_s2)
    left_over = page(NOISE, "eq-residual", b=b, V=visits, n=each, t=exposure, x=residual, w=wings)
    signal = page(NOISE, "eq-signal", V=visits, n=each, t=exposure, S=one(rates.planet_e_s))
    quiet = page(NOISE, "eq-quiet", W=white, Z=left_over)
    mean = page(NOISE, "eq-mean", Q=quiet, n_b=one(rates.background_apertures))
    planet = page(
        NOISE,
        "eq-own",
        b=b,
        V=visits,
        n=each,
        P=left,
        F=factor,
        epsilon=one(rates.source_noise_fraction),
        S=one(rates.planet_e_s),
        t=exposure,
    )
    assert planet == pytest.approx(one(noise.terms["planet"]), rel=1e-10)
    assert quiet == pytest.approx(one(noise.quiet), rel=1e-10)
    snr = page(NOISE, "eq-snr", E=signal, Q=quiet, M=mean, O=planet)
    assert snr == pytest.approx(one(noise.snr), rel=1e-10)
    assert page(NOISE, "eq-significance", E=signal, Q=quiet) == pytest.approx(one(noise.significance), rel=1e-10)


def test_rate_of_the_planet():
    from cpic_planner.etc.rates import star_e_s

    _, model, star, rates = observed("two rolls")
    light = float(star_e_s(model, "F520", star, star.v_mag, star.teff_k)[0])
    left = {"S_*": light, "C": 2e-8, "eta": float(rates.core[0, 0]), "ell": float(rates.planet_left[0, 0])}
    assert page(NOISE, "eq-planet", **left) == pytest.approx(float(rates.planet_e_s[0, 0]), **EXACT)


def test_wall_time():
    answer = exposure_time("tau Cet", snr=10, bands=["F520"])[0]
    instrument = load_instrument()
    length = page(NOISE, "eq-visit", n=answer.frames_per_visit, t=answer.exposure_s, t_r=instrument.detector.readout_s)
    found = page(NOISE, "eq-time", V=answer.visits, h=instrument.overhead_s, m=1.0, u=length)
    assert found == pytest.approx(answer.time_s, rel=1e-9)


@pytest.mark.parametrize("elements", [3, 7.5, 19, 200])
def test_threshold(elements):
    quantile = stats.t.isf(stats.norm.sf(5.0), elements - 2.0)
    found = page(DETECTION, "eq-threshold", q_t=quantile, n=float(elements))
    assert found == pytest.approx(detection_threshold(elements).unwrap(), rel=1e-9)


@pytest.mark.parametrize("speckled", [0.0, 0.2, 0.6])
@pytest.mark.parametrize("at_place", [False, True])
def test_law_of_detection(speckled, at_place):
    """At the half of the law the chance is one half: in so many visits that fit and speckles are known."""
    metrics = replace(psf_metrics(load_instrument(), "F662"), floor_separation_arcsec=np.array([0.4, 0.9]))
    even = {"filter_gain": np.full(2, 1.14), "filter_linear": np.full((2, 5), 0.9)}
    metrics = replace(metrics, floor_linear=np.ones(3), floor_square=np.ones(3), **even)
    law, light, many = _law(metrics, 2.0, 5.0, 0.2), 0.5, 1e9
    half = float(law.half(0.6, speckled, light, many, at_place=at_place))
    shares = {"w": 1.0 - speckled, "c": speckled * (1.0 - light), "l": speckled * light}
    through = {"c": shares["c"], "l": shares["l"], "f_c": 0.9, "f_l": float(metrics.filter_square)}
    noise = page(DETECTION, "eq-filtered-noise", w=shares["w"], **through)
    laplace = page(DETECTION, "eq-laplace", kappa=float(metrics.filter_tails), v=noise, **through)
    slopes = shares["w"] / noise, (through["c"] * 0.9 + 2.0 * through["l"] * through["f_l"]) / noise
    known = {"I_11": 1e9, "I_12": 0.0, "I_22": 1e9, "s_1": slopes[0], "s_2": slopes[1]}
    share = page(DETECTION, "eq-common", f_v=0.2, V=many)
    left = share * through["c"] * 0.9 / noise
    assert share == pytest.approx(1.0, abs=1e-6)  # of so many visits nothing else is left of the cross term
    disc = math.pi * (1.22 * metrics.lambda_d_arcsec / metrics.pixel_scale_arcsec) ** 2
    samples = (np.count_nonzero(metrics.hole) - disc) / float(metrics.filter_positions)
    known |= {"J": 1.0 + 0.5 * samples / (1.0 + (1.0 - slopes[0]) ** 2) * left**2, "t_3": left}
    relative = page(DETECTION, "eq-relative", **known, N=float(MAP_VISITS), **{"lambda": laplace})
    varied = page(DETECTION, "eq-varied", rho=relative, V=many, **{"lambda": laplace})
    mean = page(DETECTION, "eq-filtered-signal", S=half, g=1.14, v=noise, rho_v=varied)
    height = mean if at_place else page(DETECTION, "eq-peak", mu=mean)
    level = 5.0
    if not at_place:
        region = searched_region(metrics.hole, metrics.lambda_d_arcsec / metrics.pixel_scale_arcsec)
        level = search_threshold(region, metrics.filter_roughness).unwrap()
    threshold = float(snr_at(level, 0.0, 2.0 / max(relative, 1e-9))[0])
    numbers = {"h": height, "tau": threshold, "o": 0.0, "rho_v": varied}
    assert page(DETECTION, "eq-chance", Phi_n=stats.norm.cdf, **numbers) == pytest.approx(0.5, abs=0.02)


def test_filtered_light():
    """The floor falls with the fifth power of the separation; its rings and pixels are added one by one here."""
    metrics = psf_metrics(load_instrument(), "F662")
    rings, number = np.geomspace(0.2, 1.1, 400), len(metrics.hole) // 2
    floor = 1e-9 * rings**-5.0
    metrics = replace(metrics, floor_separation_arcsec=rings, floor_square=np.concatenate([[1.0], floor]))
    row, column = np.nonzero(metrics.hole)
    pixels = 1e-9 * (np.hypot(row - number, column - number) * metrics.pixel_scale_arcsec) ** -5.0
    mean_ratio = float(metrics.filter_square)
    share = 3.0 * mean_ratio * metrics.aperture_pixels / pixels.size
    mean = share / (1.0 - share) * pixels.mean()
    here = 1e-9 * np.array([0.45, 0.6]) ** -5.0
    everywhere = float(np.maximum(1.0 - mean / pixels, 0.1).mean())
    for found, variance in zip(_filtered_light(metrics, here), here, strict=True):
        asked = page(DETECTION, "eq-filtered-light", F=mean_ratio, m=mean, b=variance, B=everywhere)
        assert found == pytest.approx(asked, rel=1e-3)


def test_no_equation_is_left_out():
    """Every equation of the pages is evaluated by a test above."""
    written = {label for own in PAGES.values() for label in own}
    assert len(written) > 30
    assert written <= set(Path(__file__).read_text("utf-8").split('"'))
