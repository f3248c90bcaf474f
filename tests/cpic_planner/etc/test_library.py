"""Reference libraries: what each adds to the noise."""

from dataclasses import replace

import numpy as np
import pytest

from cpic_planner.etc import aperture_rates, build_model, stack_noise
from cpic_planner.etc.questions import signal_to_noise
from cpic_planner.queries import Strategy
from cpic_planner.targets import find_target
from simulator.config import load_instrument, load_scene

SUN = {"teff_k": 5772.0, "log_g": 4.4, "metallicity": 0.0}
ALONE = replace(
    find_target("tau Cet")[0], **{key: np.array([value]) for key, value in SUN.items()}, v_mag=np.array([3.0])
)
PAIR = find_target("alf Cen B")[0]
PLACE = {"separation_arcsec": 0.6, "bands": ["F520"]}


def model(**strategy):
    return build_model(load_instrument(), ["F520"], Strategy(**strategy))


def star(v_mag, **more):
    return {"library": "reference_star", "reference_star": {"v_mag": v_mag, **SUN}, **more}


def noise(target, **strategy):
    setup = model(**strategy)
    x = y = np.array([[0.6 / 2**0.5]])
    rates = aperture_rates(setup, target, "F520", x, y, np.array([[1e-8]]))
    return stack_noise(rates, 10.0, 50.0, 100.0, setup.camera("F520"), setup.strategy), rates


def test_a_twin_is_the_star_itself():
    same, twin = noise(ALONE)[0], noise(ALONE, **star(3.0))[0]
    assert twin.snr == pytest.approx(same.snr, rel=1e-12)
    for name in same.terms:
        assert np.squeeze(twin.terms[name]) == pytest.approx(np.squeeze(same.terms[name]), rel=1e-12)


def test_a_twin_does_not_have_the_companion():
    rates = noise(PAIR)[1]
    v, teff = float(PAIR.v_mag[0]), float(PAIR.teff_k[0])
    twin = {"v_mag": v, "teff_k": teff, "log_g": float(PAIR.log_g[0]), "metallicity": float(PAIR.metallicity[0])}
    other = noise(PAIR, library="reference_star", reference_star=twin)[1]
    assert rates.companion_e_s > 0
    assert rates.reference_light_e_s - other.reference_light_e_s == pytest.approx(rates.companion_e_s, rel=1e-9)


@pytest.mark.parametrize(("teff_k", "flagged"), [(9700.0, True), (7900.0, False)])
def test_a_reference_star_beyond_the_spectra_is_flagged(teff_k, flagged):
    """Its colours are those of the hottest spectrum, 8000 K."""
    hot = model(library="reference_star", reference_star={"v_mag": 2.0, "teff_k": teff_k})
    answer = signal_to_noise(hot, ALONE, time_s=3600.0, **PLACE)[0]
    assert ("reference_star_clamped" in answer.flags) is flagged
    assert "reference_star_clamped" not in signal_to_noise(model(), ALONE, time_s=3600.0, **PLACE)[0].flags


def test_scaled_noise_of_another_star():
    """Ten times as bright: its star light counts a tenth, everything else a hundredth."""
    rates = noise(ALONE, **star(0.5))[1]
    halo, other = float(np.squeeze(rates.halo_e_s)), float(np.squeeze(rates.sky_e_s + rates.dark_e_s))
    assert np.squeeze(rates.reference_halo) == pytest.approx(0.1, rel=1e-12)
    assert np.squeeze(rates.reference_light_e_s) == pytest.approx(halo / 10 + other / 100, rel=1e-12)
    assert np.squeeze(rates.reference_scale) == pytest.approx(0.01, rel=1e-12)


def test_the_brighter_twin_is_a_star_of_the_same_type_two_magnitudes_brighter():
    twin, other = noise(ALONE, library="brighter_twin"), noise(ALONE, **star(1.0))
    assert twin[0].snr == pytest.approx(other[0].snr, rel=1e-9)
    assert np.squeeze(twin[1].peak_columns_e_s) == pytest.approx(np.squeeze(other[1].peak_columns_e_s), rel=1e-9)
    scene = load_scene({"name": "s", "cstar": {"name": "star", "v_mag": 3.0, **SUN}})
    settings = (Strategy(library="brighter_twin"), Strategy(**star(1.0)))
    shown = [setting.reference_library.reference_scene(setting, scene) for setting in settings]
    assert shown[0] == shown[1]


def test_a_brighter_reference_has_less_noise_and_saturates_earlier():
    found = [noise(ALONE, **star(v)) for v in (5.0, 3.0, 1.0, -1.0)]
    terms = [float(np.squeeze(part.terms["reference"])) for part, _ in found]
    assert terms == sorted(terms, reverse=True)
    peaks = [float(np.squeeze(rates.peak_columns_e_s)) for _, rates in found]
    assert peaks[0] == peaks[1] < peaks[2] < peaks[3]
    assert peaks[2] / peaks[1] == pytest.approx(10**0.8, rel=1e-9)
    short, long = (
        signal_to_noise(model(**star(v)), ALONE, time_s=3600.0, contrast=1e-8, **PLACE)[0] for v in (-1.0, 3.0)
    )
    assert short.exposure_s < long.exposure_s
    blinding = signal_to_noise(model(**star(-12.0)), ALONE, time_s=3600.0, contrast=1e-8, **PLACE)[0]
    assert (blinding.status, blinding.reason) == ("saturated", "pixel_full_well")


def test_two_rolls_halve_the_variance():
    """The planet is measured in both halves, less its negative image, whose light makes noise as well."""
    same, single = noise(ALONE)
    roll, both = noise(ALONE, library="roll")
    left = np.squeeze(both.planet_left)
    gain = left / np.squeeze(single.planet_left)  # whose background holds wings of the planet alone
    assert both.variance_factor == 0.5
    assert left == pytest.approx(1.0, abs=0.01)  # far apart; the spline of the table misses it by a little either way
    planet = 0.5 * (2.0 - left) * np.squeeze(same.terms["planet"])
    assert np.squeeze(roll.terms["planet"]) == pytest.approx(planet, rel=1e-12)
    for name in set(same.terms) - {"background_mean", "planet"}:
        assert np.squeeze(roll.terms[name]) == pytest.approx(0.5 * np.squeeze(same.terms[name]), rel=1e-12)
    assert roll.significance == pytest.approx(2**0.5 * gain * same.significance, rel=1e-12)
    assert roll.signal_e == pytest.approx(gain * same.signal_e, rel=1e-12)
    with pytest.raises(ValueError, match="reference_ratio"):
        Strategy(library="roll", reference_ratio=2.0)


def test_idealised_is_neither_noisy_nor_drifting_and_says_so():
    ideal = noise(ALONE, library="idealised")[0]
    assert np.all(ideal.terms["reference"] == 0)
    assert np.all(ideal.terms["speckle"] == 0)
    assert np.all(ideal.terms["common_speckle"] == 0)
    answer = signal_to_noise(model(library="idealised"), ALONE, time_s=3600.0, contrast=1e-8, **PLACE)[0]
    assert "idealised" in answer.flags
    assert Strategy().reference_library.flags == ()
    assert Strategy(**star(1.0)).reference_library.flags == ()  # its colour was shown to change nothing


def test_reference_frames_take_time():
    """Ten references for each science frame: less noise, a smaller part of the time on the planet."""
    one, ten = (model(reference_ratio=ratio) for ratio in (1.0, 10.0))
    overhead_s = one.instrument.overhead_s
    assert (ten.time_s(100.0) - overhead_s) / (one.time_s(100.0) - overhead_s) == pytest.approx(5.5)
    assert float(ten.visit_s(ten.time_s(123.0))) == pytest.approx(123.0, rel=1e-12)
    few, many = (noise(ALONE, reference_ratio=ratio)[0].terms["reference"] for ratio in (1.0, 10.0))
    assert few == pytest.approx(10.0 * many, rel=1e-12)
