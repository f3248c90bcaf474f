"""The noise model against Monte Carlo: electrons, register, read noise, converter, apertures, references, particles."""

import numpy as np
import pytest

from cpic_planner.etc import build_model
from simulator.config import load_instrument

GAINS = (1.0, 2.0, 20.0, 300.0, 1000.0)
REGIMES = ("photon", "halo", "read", "cic", "speckle", "mixed", "particles")
TRIALS = 20_000
EXACT = 0.01
"""What closed forms may differ by: the tolerances of users (3 %, 5 % with speckles) leave room for wrong models."""


def tolerance(found, part=EXACT):
    return part + 4.5 * found.relative_error


def compared(oracles, case, seed):
    """Monte Carlo and prediction of a case."""
    places = oracles.regimes.apertures()
    rng = np.random.default_rng([seed, int(case.stack.em_gain), int(10 * case.stack.reference_ratio)])
    found = oracles.monte_carlo.recover(case.stack, places, case.readout, rng, TRIALS)
    return found, oracles.regimes.predicted(case, places)


def agrees(found, said):
    return abs(found.snr / said.snr[0] - 1.0) < tolerance(found) and abs(
        found.significance / said.significance[0] - 1.0
    ) < tolerance(found)


@pytest.mark.parametrize(
    ("regime", "gain"),
    [
        pytest.param(regime, gain, marks=[pytest.mark.long] * (gain != (1.0, 20.0, 1000.0)[number % 3]))
        for number, regime in enumerate(REGIMES)
        for gain in GAINS
    ],
)
def test_every_regime_at_every_gain(oracles, regime, gain):
    case = oracles.regimes.case_of(regime, gain)
    found, said = compared(oracles, case, REGIMES.index(regime))
    assert said.signal_e[0] == pytest.approx(case.stack.signal_e, rel=1e-12)
    assert abs(found.bias) < 4.5
    assert agrees(found, said)


DOMINANT = {
    "photon": "planet",
    "halo": "halo",
    "sky": "sky",
    "companion": "companion",
    "dark": "dark",
    "exozodi": "exozodi",
    "read": "read_noise",
    "cic": "cic",
    "speckle": "speckle",
}


@pytest.mark.parametrize(("regime", "term"), DOMINANT.items())
def test_the_named_noise_dominates(oracles, regime, term):
    """Half of the white noise is the reference's; otherwise the regimes would not test what they are named after."""
    for gain in GAINS:
        said = oracles.regimes.predicted(oracles.regimes.case_of(regime, gain), oracles.regimes.apertures())
        terms = {name: float(np.ravel(part)[0]) for name, part in said.terms.items()}
        total = sum(terms.values())
        if term in ("planet", "speckle"):
            assert terms[term] > 0.9 * total
        else:
            assert terms[term] + terms["reference"] > 0.9 * total
            assert terms[term] > 0.9 * terms["reference"]


@pytest.mark.parametrize("light", ["sky", "companion", "dark", "exozodi"])
def test_every_light_counts_once(oracles, light):
    assert agrees(*compared(oracles, oracles.regimes.case_of(light, 300.0), 11))


@pytest.mark.parametrize("ratio", [0.5, 3.0])
@pytest.mark.parametrize("regime", ["halo", "read", "mixed"])
def test_longer_and_shorter_reference_libraries(oracles, regime, ratio):
    assert agrees(*compared(oracles, oracles.regimes.case_of(regime, 20.0, ratio), 12))


@pytest.mark.parametrize("regime", ["reference star", "projected"])
def test_other_reductions(oracles, regime):
    assert agrees(*compared(oracles, oracles.regimes.case_of(regime, 300.0), 13))


@pytest.mark.long
def test_the_shortcuts_of_the_oracle_are_exact(oracles):
    """Pixel by pixel, frame by frame and rounded by the converter: the same mean and scatter, particles included."""
    mc, rng = oracles.monte_carlo, np.random.default_rng(14)
    stack = mc.Stack(
        0.5,
        0.3,
        10.0,
        12,
        50.0,
        reference_ratio=0.5,
        speckle_e_s=0.05,
        loss_per_s=5e-3,
        background_apertures=3,
        rdi_throughput=0.95,
    )
    place, readout = mc.aperture_on(2.3, offset_y=0.2, offset_x=-0.4), mc.Readout()
    for planet in (True, False):
        slow = mc.frame_sums(stack, place, readout, rng, 2000, planet=planet)
        fast = mc.stack_sums(stack, place, readout, rng, 100_000, planet=planet)
        assert abs(slow.mean() - fast.mean()) < 4.5 * slow.std() / np.sqrt(slow.size)
        assert abs(slow.std() / fast.std() - 1.0) < 4.5 / np.sqrt(2 * slow.size)


def test_rounding_is_a_uniform_error_of_its_own(oracles):
    """The read noise of nearly two ADU hides where the converter's steps lie."""
    readout, rng = oracles.monte_carlo.Readout(), np.random.default_rng(15)
    assert readout.read_noise_e > 1.5 * readout.gain_e_adu
    output = rng.normal(17.0, readout.read_noise_e, 400_000)
    error = np.rint(output / readout.gain_e_adu) * readout.gain_e_adu - output
    assert error.std() == pytest.approx(readout.gain_e_adu / np.sqrt(12.0), rel=0.005)
    assert abs(np.corrcoef(error, output)[0, 1]) < 4.5 / np.sqrt(error.size)


@pytest.mark.parametrize("index", [0, *(pytest.param(index, marks=pytest.mark.long) for index in (4, 5))])
def test_counted_photons(oracles, index):
    """Nearly dark at 3 sigma and gain 300; a tenth and a third of an electron at 5 sigma and gain 1000."""
    places = oracles.regimes.apertures()
    stack, readout, sigma = list(oracles.counting.counted_cases())[index]
    rng = np.random.default_rng([21, index])
    found = oracles.counting.recover_counts(stack, places, readout, sigma, rng, TRIALS)
    assert abs(found.bias) < 4.5
    assert agrees(found, oracles.counting.predicted_counting(stack, places, readout, sigma))


@pytest.mark.parametrize("index", [0, 2, 4, *(pytest.param(index, marks=pytest.mark.long) for index in (1, 3, 5))])
def test_real_stars(oracles, index):
    """Rates of the ETC, light of the planet on pixels from the images, circles anywhere on the pixels."""
    model, stars = build_model(load_instrument()), oracles.real_stars
    said = stars.prepared(model, stars.PLANETS[index])
    # The light itself: energy of the images in the circles, beside the core throughput in the ETC's rates.
    energy = np.mean([place.energy for place in said.places])
    assert energy == pytest.approx(said.core_throughput, rel=0.02)
    found = oracles.monte_carlo.recover(said.stack, said.places, said.readout, np.random.default_rng(20), TRIALS)
    assert abs(found.bias) < 4.5
    assert abs(found.snr / said.noise.snr[0] - 1.0) < tolerance(found, 0.02)
    assert abs(found.significance / said.noise.significance[0] - 1.0) < tolerance(found, 0.02)


def test_the_planets_of_real_stars_are_all_tried(oracles):
    assert len(oracles.real_stars.PLANETS) == 6
