"""Sums of frames over the hole against the frames themselves."""

import dataclasses
import math

import numpy as np
import pytest

from cpic_core import Reason, Status, stream
from simulator import load_instrument, observe
from simulator.config import Timing
from simulator.detectors import excess_noise_factor2
from simulator.imaging import FocalGrid
from simulator.imaging.drift import low_order_map, screen_model
from simulator.ledger import SUM_EPOCHS
from simulator.observing import hole_stackable, hole_stacks
from tests.simulator.frames import to_electrons

STILL = {"drift": {"visit_nm": 0.0, "walk_nm_per_sqrt_hour": 0.0, "orbital_nm": 0.0}}
MOVING = tuple(
    """
    parallel_cti serial_cti smear cosmic_rays nonlinearity flat dark_structure bad_pixels bad_columns stripes
    interference bias_drift
""".split()
)


def scene(v_mag=3.0):
    return {"name": "s", "cstar": {"name": "s", "v_mag": v_mag, "teff_k": 5800}}


def sequence(changes=None, **settings):
    instrument = load_instrument(changes or {}).switched(dict.fromkeys(MOVING, False))
    given = {
        "band": "F520",
        "exposure_s": 10.0,
        "n_frames": 20,
        "em_gain": 100.0,
        "window": "hole",
        "fidelity": "quick",
        "max_epochs": 1,
    } | settings
    return observe(given.pop("scene", scene()), instrument=instrument, **given)


@pytest.mark.parametrize("n_draws", [40, pytest.param(120, marks=pytest.mark.long)])
def test_mean_and_variance_are_those_of_the_frames(n_draws):
    observation = sequence(STILL, fidelity="standard")
    stacks = hole_stacks(observation)
    hole = stacks.region
    draws = np.array([stacks.draw(number).sum(axis=0)[hole] for number in range(n_draws)])
    detector = observation.instrument.detector
    charge = observation.mean_rate_map[hole] * 10.0 + detector.dark_e_s * 10.0 + detector.cic_e
    mean = 20 * charge
    factor2 = float(excess_noise_factor2(100.0, detector.register_stages))
    variance = 20 * (factor2 * charge + (detector.read_noise_e**2 + detector.gain_e_adu**2 / 12) / 100.0**2)
    pixels = draws.size
    pull = (draws - mean) / np.sqrt(variance)
    assert abs(pull.mean()) < 4 / np.sqrt(pixels)
    # A charge of some electrons is skewed: the fourth moment of its pull is above 3.
    assert np.mean(pull**2) == pytest.approx(1.0, abs=4 * np.sqrt((np.mean(pull**4) - 1) / pixels))


@pytest.mark.long
def test_sums_scatter_as_sums_of_frames_do():
    """Aperture-sized sums with drift, from both chains: same mean, same variance."""
    found, hole = {}, sequence().psf.metrics.hole
    for chain in ("sums", "frames"):
        values = []
        for number in range(24):
            observation = sequence(n_frames=6, realisation=number, max_epochs=3)
            if chain == "sums":
                image = hole_stacks(observation, epochs=3).draw(1000 + number).sum(axis=0)
            else:
                frames = np.array([observation.frame(index).adu for index in range(6)])
                image = to_electrons(frames, observation.instrument.detector, 100.0).sum(axis=0)
            values.append(image[hole].reshape(-1, 33).sum(axis=1))
        found[chain] = np.array(values)
    sums, frames = found["sums"], found["frames"]
    error = np.hypot(sums.std(axis=0), frames.std(axis=0)) / np.sqrt(24)
    assert np.sqrt(np.mean(((sums - frames).mean(axis=0) / error) ** 2)) == pytest.approx(1.0, abs=0.35)
    ratio = sums.var(axis=0, ddof=1).mean() / frames.var(axis=0, ddof=1).mean()
    assert ratio == pytest.approx(1.0, abs=0.25)


def test_a_visit_has_the_same_offset_as_its_frames():
    still = {"drift": {"visit_nm": 0.2, "walk_nm_per_sqrt_hour": 0.0, "orbital_nm": 0.0}}
    observation = sequence(still, realisation=3, fidelity="standard")
    rates = hole_stacks(observation, exact=True).mean_rates(3)
    hole = observation.psf.metrics.hole
    assert rates.shape == (SUM_EPOCHS, *hole.shape)
    for epoch in rates:
        np.testing.assert_allclose(epoch[hole], observation.mean_rate_map[hole], rtol=1e-12)
        assert not epoch[~hole].any()
    other = hole_stacks(observation, exact=True).mean_rates(4)
    assert np.abs(other[0][hole] / rates[0][hole] - 1).max() > 1e-3


def test_a_walk_is_sampled_evenly_and_grows():
    walk = {"drift": {"visit_nm": 0.0, "walk_nm_per_sqrt_hour": 0.02, "orbital_nm": 0.0}}
    stacks = hole_stacks(sequence(walk, n_frames=360))
    nominal = hole_stacks(sequence(STILL, n_frames=360)).mean_rates()[0]
    hole = stacks.region
    change = np.array([(stacks.mean_rates(number) - nominal)[:, hole].std(axis=1) for number in range(30)])
    mean_square = (change**2).mean(axis=0)
    # Half a step after the start, then in equal steps: 1, 3, 5 ... in the variance.
    np.testing.assert_allclose(mean_square / mean_square.mean(), np.arange(1, 12, 2) / 6, rtol=0.6)
    assert np.all(np.diff(mean_square) > 0)


def test_realisations_differ_and_repeat():
    stacks = hole_stacks(sequence())
    again = hole_stacks(sequence())
    np.testing.assert_array_equal(stacks.draw(2), again.draw(2))
    assert np.any(stacks.draw(2) != stacks.draw(3))
    reference = hole_stacks(sequence(role="reference"))
    assert np.any(stacks.draw(2) != reference.draw(2))


@pytest.fixture
def wavefront(monkeypatch):
    """Return what the pupil has in the epochs of a visit, nm."""
    seen = []
    image = FocalGrid.image

    def kept(grid, opd_nm=None):
        if opd_nm is not None:
            seen.append(opd_nm)
        return image(grid, opd_nm)

    def drawn(stacks, *which):
        seen.clear()
        stacks.mean_rates(*which)
        return np.array(seen)

    monkeypatch.setattr(FocalGrid, "image", kept)
    return drawn


def test_visits_of_a_programme_share_a_screen_and_the_orbit(wavefront):
    """Every wavefront, put together once more from its named streams."""
    drift = {
        "visit_nm": 0.2,
        "walk_nm_per_sqrt_hour": 0.0,
        "common_fraction": 0.5,
        "correlation_time_h": 0.1,
        "orbital_nm": 0.3,
    }
    timing = Timing("half", gap_s=600.0, start_turns=0.25)
    rho, model = np.exp(-600.0 / 360.0), screen_model(128, 2.5)
    for role in ("science", "reference"):
        stacks = hole_stacks(sequence({"drift": drift}, role=role, timing=timing, n_frames=4), exact=True)
        path = ("s", "SCI", role, "F520", 5)
        first, later = (model.draw(stream(1, *path, *visit, "visit"), 0.2) for visit in ((), ("visit", 1)))
        offset = rho * first + np.sqrt(1 - rho**2) * later
        if role == "science":
            offset = offset + model.draw(stream(1, *path, "common"), 0.1)
        turns = (np.arange(5) * 11.1 / 5553.6)[:, None] + np.linspace(0, 1, 2001) * 11.1 / 5553.6
        late = 0.23 if role == "reference" else 0.0
        sine = np.sin(2 * np.pi * (turns + 0.25 + late)).mean(axis=1)[:4]
        expected = offset + 0.3 * np.sqrt(2) * sine[:, None, None] * low_order_map(128)
        np.testing.assert_allclose(wavefront(stacks, 5, 1), expected, atol=1e-6)


def test_visits_have_their_own_noise_and_the_first_is_the_default():
    stacks = hole_stacks(sequence(STILL, n_frames=2))
    np.testing.assert_array_equal(stacks.draw(3), stacks.draw(3, 0))
    np.testing.assert_array_equal(stacks.mean_rates(3, 1), stacks.mean_rates(3))
    drawn = [stacks.draw(realisation, visit) for realisation in (3, 4) for visit in (0, 1, 2)]
    for i, one in enumerate(drawn):
        for other in drawn[:i]:
            assert np.any(one != other)


def test_frames_and_sums_are_of_the_same_visit():
    still = {"drift": {"visit_nm": 0.2, "walk_nm_per_sqrt_hour": 0.0, "orbital_nm": 0.0}}
    seen = sequence(still, realisation=3, visit=4, fidelity="standard")
    hole = seen.psf.metrics.hole
    rates = hole_stacks(sequence(still, fidelity="standard"), exact=True).mean_rates(3, 4)
    np.testing.assert_allclose(rates[0][hole], seen.mean_rate_map[hole], rtol=1e-12)
    one, other = (sequence(STILL, visit=visit).frame(0).adu for visit in (0, 1))
    assert np.any(one != other)


def test_a_visit_has_a_number(refused):
    refused("visit", sequence, visit=-1)
    refused("visit", hole_stacks(sequence(STILL)).draw, 1, 1.5)
    refused("visits", sequence, visits=0)


def test_frames_are_shared_among_epochs():
    assert hole_stacks(sequence(n_frames=20)).frames.tolist() == [4, 3, 3, 4, 3, 3]
    assert hole_stacks(sequence(n_frames=2)).frames.tolist() == [1, 1]
    assert hole_stacks(sequence(n_frames=20), epochs=1).frames.tolist() == [20]


def test_light_may_be_added():
    stacks = hole_stacks(sequence(STILL))
    extra = np.where(stacks.region, 5.0, 0.0)
    lit = stacks.with_light(extra)
    np.testing.assert_allclose(
        lit.mean_rates() - stacks.mean_rates(), np.broadcast_to(extra, lit.mean_rates().shape), atol=1e-9
    )
    difference = lit.draw(1).sum(axis=0) - stacks.draw(1).sum(axis=0)
    assert difference[stacks.region].mean() == pytest.approx(5.0 * 200.0, rel=0.01)


def test_one_sided_holes():
    instrument = load_instrument("cpic_2q").switched(dict.fromkeys(MOVING, False))
    observation = observe(
        scene(),
        band="F520",
        exposure_s=1.0,
        n_frames=4,
        em_gain=100.0,
        window="hole",
        fidelity="quick",
        instrument=instrument,
        max_epochs=1,
    )
    stacks = hole_stacks(observation)
    drawn = stacks.draw().sum(axis=0)
    assert np.count_nonzero(drawn[stacks.region]) > 0.9 * stacks.region.sum()
    assert not drawn[~stacks.region].any()


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"exposure_s": 300.0, "scene": scene(-1.0), "em_gain": 1.0}, Reason.PIXEL_FULL_WELL),
        ({"exposure_s": 30.0, "scene": scene(0.0), "em_gain": 1000.0}, Reason.REGISTER_FULL_WELL),
    ],
)
def test_overflow_that_enters_the_hole_is_refused(refused, settings, reason):
    observation = sequence(**settings)
    answer = hole_stackable(observation)
    assert answer.status is Status.SATURATED
    assert answer.reason in (reason, Reason.ADC_RANGE)
    refused("exposure_s", hole_stacks, observation)


def test_the_star_may_overflow_beside_the_hole():
    """Frames of the optimiser fill the columns beside the hole: their pixels overflow, nothing arrives in the hole."""
    observation = sequence(scene=scene(0.37), exposure_s=1.7, em_gain=298.0)
    exposure_e = observation.mean_rate_map * 1.7
    assert exposure_e.max() * 298.0 > observation.instrument.detector.register_full_well_e
    assert hole_stackable(observation).status is Status.OK


@pytest.mark.parametrize("switch", ["parallel_cti", "serial_cti", "cosmic_rays", "nonlinearity"])
def test_effects_that_are_no_sum_are_refused(switch):
    instrument = load_instrument().switched(dict.fromkeys(MOVING, False) | {switch: True})
    observation = observe(
        scene(), band="F520", exposure_s=1.0, em_gain=10.0, window="hole", fidelity="quick", instrument=instrument
    )
    answer = hole_stackable(observation)
    assert answer.status is Status.INVALID
    assert switch in answer.message


def test_only_the_hole_behind_the_mask(refused):
    for changes in ({"window": "full"}, {"star_offset_arcsec": (0.3, 0.3)}):
        refused("window", hole_stacks, sequence(**changes))


def test_near_infrared_sums_are_those_of_frames_read_up_a_ramp():
    """Mean and variance over the hole; frames that pixels couple in do not add up pixel by pixel."""
    ramp = {"readout_mode": "up_the_ramp", "n_reads": 4, "read_noise_e": 6.0}
    instrument = load_instrument({"near_infrared": {"detector": ramp}}).switched(dict.fromkeys(MOVING, False))
    settings = {"band": "F1265", "exposure_s": 50.0, "n_frames": 40, "window": "hole", "fidelity": "quick"}
    seen = observe(scene(), **settings, max_epochs=1, instrument=instrument)
    stacks = hole_stacks(seen, epochs=1, exact=True)
    once, region = stacks.draw(0)[0][stacks.region], stacks.region
    light_e = 50.0 * seen.mean_rate_map[region]
    detector = seen.channel.detector
    reads, factor2 = detector.ramp(50.0)
    mean = 40 * (light_e + 50.0 * detector.dark_e_s)
    variance = factor2 * mean + 40 * (reads * detector.read_noise_e**2 + detector.gain_e_adu**2 / 12.0)
    frames = sum(to_electrons(adu, seen.channel.detector, 1.0)[region] for adu in seen.iter_frames())
    for found in (once, frames):
        pull = (found - mean) / np.sqrt(variance)
        assert abs(pull.mean()) < 4.0 / math.sqrt(pull.size)
        assert pull.std() == pytest.approx(1.0, abs=4.0 / math.sqrt(2.0 * pull.size))
    coupled = dataclasses.replace(seen, instrument=instrument.switched({"interpixel_capacitance": True}))
    assert "interpixel_capacitance" in hole_stackable(coupled).message


@pytest.mark.parametrize("averages", ["never", "visits"])
def test_visits_of_a_table_have_its_residual(averages):
    """The same in all visits, or a new one in each; sums of frames and frames see one wavefront a visit."""
    table = load_instrument("roman_hlc_like").changed({"coronagraph": {"stability_averages": averages}})
    instrument = table.switched(dict.fromkeys(MOVING, False))
    settings = {"band": "CGI1", "exposure_s": 10.0, "n_frames": 20, "em_gain": 10.0, "window": "hole"}
    seen = observe(scene(5.0), **settings, instrument=instrument)
    stacks = hole_stacks(seen, epochs=3)
    visits = stacks.mean_rates(0, visits=4)
    apart, even = np.ptp(visits, axis=0)[stacks.region], visits.mean(axis=0)[stacks.region]
    assert (apart.max() == 0.0) == (averages == "never")
    assert apart.max() < even.max()
    np.testing.assert_allclose(stacks.mean_rates(0, visits=4, summed=True)[0], visits.mean(axis=0), rtol=1e-12)
    assert len(stacks.mean_rates(0)) == 3
    for visit in (0, 3):
        frames = seen.at_visit(visit).mean_rate_map
        np.testing.assert_allclose(visits[visit][stacks.region], frames[stacks.region], rtol=1e-9)
    reference = observe(scene(5.0), **settings, instrument=instrument, role="reference")
    same = np.array_equal(reference.mean_rate_map, reference.at_visit(1).mean_rate_map)
    assert same == (averages == "never")
    assert not np.array_equal(stacks.mean_rates(1, visits=4), visits)
