"""Calibrated frames of the whole camera, against the light that went in."""

import numpy as np
import pytest

from cpic_planner.validation import aperture_weights, calibrated_frames, combine, reject_cosmic_rays
from cpic_planner.validation.frames import dark_bar, transferred
from simulator import Observation, load_instrument, observe
from simulator.camera import MaskBit
from simulator.reduction.steps import frame_level

BAND, N_FRAMES = "F520", 200


def observed(**more: object) -> Observation:
    settings = {"band": BAND, "exposure_s": 17.0, "n_frames": N_FRAMES, "em_gain": 20.0, "seed": 3, "window": "hole"}
    return observe("paper_science", **(settings | more))


def light_in(seen: Observation, response: np.ndarray, good: np.ndarray) -> np.ndarray:
    """True light of a frame as it arrives after the transfers, flat divided out."""
    charge = seen.mean_rate_map * seen.exposure_s * np.where(good, response, 0.0)
    return transferred(charge, seen.instrument.detector, seen.first_pixel) / response


@pytest.mark.parametrize(
    ("gain", "exposure_s", "seed"),
    [
        pytest.param(1.0, 17.0, 3, marks=pytest.mark.long),
        pytest.param(20.0, 17.0, 4, marks=pytest.mark.long),
        (300.0, 1.0, 5),
    ],
)
def test_mean_of_frames_is_the_light(gain: float, exposure_s: float, seed: int) -> None:
    """Every effect on: within 4 standard errors, and 0.3 %, in every region; and the error is right."""
    seen = observed(em_gain=gain, exposure_s=exposure_s, seed=seed)
    frames = calibrated_frames(seen)
    found = reject_cosmic_rays(
        frames.electrons, frames.usable, em_gain=gain, read_noise_e=110.0, pedestal_e=frames.pedestal_e, gain_e_adu=59.0
    )
    summed = combine(frames.electrons, frames.usable & ~found.rejected)
    dead = (frames.electrons == 0).all(axis=0)
    truth = light_in(seen, frames.response, ~dead)
    variance = frames.variance_e2(truth) * N_FRAMES * summed.variance_factor
    rows, columns = np.indices(seen.shape)
    regions = {"hole": seen.psf.metrics.hole, "bar": dark_bar(seen), "halo": truth > 20, "faint": truth < 0.1}
    for k in (1, 2):
        regions[f"source {k}"] = np.hypot(columns - seen.truth.x_pixel[k], rows - seen.truth.y_pixel[k]) < 3
    for name, region in regions.items():
        inside = region & summed.covered
        assert inside.sum() > 20, name
        excess = float(np.sum(summed.image_e[inside] - N_FRAMES * truth[inside]))
        error = float(np.sqrt(variance[inside].sum()))
        assert abs(excess) < 4 * error, name
        if error < 1e-3 * N_FRAMES * truth[inside].sum():
            assert abs(excess) < 3e-3 * N_FRAMES * truth[inside].sum(), name
    steady = summed.covered & (frames.n_lost == 0)
    pulls = ((summed.image_e - N_FRAMES * truth) / np.sqrt(variance))[steady]
    assert pulls.std() == pytest.approx(1.0, abs=0.03)


def test_noise_free_light_comes_back() -> None:
    """Off the mask, near full well, without noise: curves, smear, flat, bias undone to the converter's step."""
    off = ("photon_noise", "em_register", "read_noise", "cosmic_rays", "clock_charge")
    seen = observed(
        exposure_s=0.01,
        n_frames=30,
        em_gain=1.0,
        star_offset_arcsec=(0.353553, 0.353553),
        switches=dict.fromkeys(off, False),
    )
    frames = calibrated_frames(seen)
    good = frames.usable.all(axis=0)
    truth = light_in(seen, frames.response, (frames.electrons != 0).any(axis=0))
    difference = (frames.electrons.mean(axis=0) - truth)[good]
    assert truth.max() > 6e4
    step = seen.instrument.detector.gain_e_adu
    assert (np.abs(difference) < 0.6 * step + 2e-4 * truth[good]).all()
    bright = truth[good] > 1000.0  # elsewhere the converter's steps, without noise to smooth them, add up
    assert abs(difference[bright].sum()) < 1e-4 * truth[good][bright].sum()


def test_level_does_not_see_sources() -> None:
    """Adding a source to a frame leaves its fitted level exactly as it is; particles on the bar move it little."""
    seen = observed(n_frames=1, em_gain=300.0, exposure_s=1.0)
    detector, zero = seen.instrument.detector, np.zeros(seen.shape)
    how = {"unlit": dark_bar(seen), "mean_e": zero, "first_pixel": seen.first_pixel}
    level = frame_level(detector, 300.0, 1.0, **how)
    assert level is not None
    rng = np.random.default_rng(0)
    rows, columns = np.indices(seen.shape)
    turn = 2 * np.pi / detector.bias_structure.interference_period_columns
    order = detector.n_columns * (seen.first_pixel[0] + rows) + seen.first_pixel[1] + columns
    true = 1.7 + 2.0 * np.sin(turn * order + 0.8)
    noise = rng.normal(0.0, 110.0 / 59.0, seen.shape)
    usable = np.ones(seen.shape, dtype=bool)
    fitted = level.of(true + noise, usable)
    pixels = np.count_nonzero(dark_bar(seen))
    assert np.abs(fitted - true).max() < 4 * np.sqrt(5 / pixels) * 110 / 59
    planet = 1e5 * seen.psf.at(*(getattr(seen.truth.sources[1], f"{axis}_arcsec") for axis in "xy"))
    planet = transferred(planet, detector, seen.first_pixel)
    assert np.abs(level.of(true + noise + planet, usable) - fitted).max() < 1e-6 * planet.max()
    struck = true + noise
    struck[60, 68], struck[60, 69], struck[100, 66] = 9e3, 2.0, 3e3
    assert np.abs(level.of(struck, usable) - fitted).max() < 0.05
    assert level.of(true, np.zeros(seen.shape, dtype=bool)) is None


def test_planet_flux_with_and_without_pick_up() -> None:
    """Pick-up and drift, and taking them out, change a source's flux by less than 1e-3."""
    common = {"em_gain": 300.0, "exposure_s": 4.0, "n_frames": 25}
    quiet = {"interference": False, "bias_drift": False}
    weights = None
    fluxes = []
    for switches in ({}, quiet):
        seen = observed(**common, switches={"cosmic_rays": False, **switches})
        weights = aperture_weights(seen.shape, seen.truth.x_pixel[2], seen.truth.y_pixel[2], 2.324)
        fluxes.append(float(np.sum(weights * calibrated_frames(seen).electrons.sum(axis=0))))
    assert fluxes[0] > 3000
    assert abs(fluxes[0] / fluxes[1] - 1.0) < 1e-3
    assert fluxes[0] != fluxes[1]


def test_flawed_pixels_and_limits() -> None:
    seen = observed(em_gain=300.0, n_frames=10)
    frames = calibrated_frames(seen)
    first = seen.frame(0)
    bad = (first.mask & (MaskBit.BAD | MaskBit.HOT)) != 0
    assert bad.any()
    assert not frames.usable[:, bad].any()
    assert not frames.usable[0][first.lost].any()
    lost = sum(seen.frame(index).lost.astype(int) for index in range(10))
    hole = seen.psf.metrics.hole
    assert (frames.n_lost == lost).all()
    assert (frames.lost_in, frames.lost_outside) == (lost[hole].sum(), lost[~hole].sum())
    assert frames.lost_outside > 1000
    # A pixel that saturates by its own light in some frames is out in all.
    often = (lost >= 3) & (lost <= 7) & (seen.mean_rate_map * 17 * 300 > 0.9 * 730_000)
    assert often.any()
    assert not frames.usable[:, often].any()
    assert np.isfinite(frames.electrons).all()


def test_transfers_keep_an_aperture() -> None:
    """What the transfers take from a planet's aperture, unknown to a prediction without them: 0.4 % at most."""
    seen = observed(n_frames=1)
    detector = seen.instrument.detector
    weights = aperture_weights(seen.shape, seen.truth.x_pixel[1], seen.truth.y_pixel[1], 2.324)
    source = seen.truth.sources[1]
    template = seen.psf.at(source.x_arcsec, source.y_arcsec)
    moved = transferred(template, detector, seen.first_pixel)
    assert moved.sum() == pytest.approx(template.sum(), rel=1e-4)
    loss = 1.0 - float(np.sum(weights * moved) / np.sum(weights * template))
    assert 5e-4 < loss < 4e-3
    # Against counting losses one by one: binomial numbers of them, each one pixel back.
    row = seen.first_pixel[0] + int(seen.truth.y_pixel[1])
    column = seen.first_pixel[1] + int(seen.truth.x_pixel[1])
    transfers = (row + 1 + detector.transfer.store_rows, column + 1 + detector.transfer.serial_elements)
    by_hand = template.copy()
    for axis, number in enumerate(transfers):
        chance = 1.0 - (1.0 - 1e-5) ** number
        by_hand = (1.0 - chance) * by_hand + chance * np.roll(by_hand, 1, axis=axis)
    core = weights > 0
    assert moved[core] == pytest.approx(by_hand[core], abs=3e-4 * template.max())
    off = detector.switched(off=("parallel_cti", "serial_cti"))
    assert (transferred(template, off, seen.first_pixel) == template).all()


def test_whole_frames() -> None:
    """The whole detector: the same light in the hole, borders without light at 0."""
    seen = observed(window="full", n_frames=2, em_gain=300.0, exposure_s=1.0)
    frames = calibrated_frames(seen)
    assert frames.electrons.shape == (2, 1050, 1080)
    edge = frames.electrons[:, 100:900, :8]
    error = frames.noise_e / np.sqrt(edge.size)
    assert abs(edge.mean()) < 4 * error + 3 * frames.noise_e / np.sqrt(1000)
    stamp = frames.electrons[:, 446:583, 468:605].sum(axis=0)
    assert stamp[stamp < 1000].mean() > 0


@pytest.mark.parametrize("mode", ["cds", "up_the_ramp"])
def test_near_infrared_frames_are_the_light_again(mode: str) -> None:
    """Flat, curve and coupling undone: means are those of the light, variances those of the reads."""
    strong = {"interpixel_coupling": 0.02, "readout_mode": mode, "nonlinearity_at_full_well": 0.1}
    instrument = load_instrument({"near_infrared": {"detector": strong}})
    on = {"interpixel_capacitance": True, "cosmic_rays": False}
    given = {
        "band": "F1265",
        "exposure_s": 20.0,
        "n_frames": 30,
        "window": "hole",
        "max_epochs": 1,
        "fidelity": "quick",
    }
    seen = observe("paper_bright_source", **given, instrument=instrument, switches=on)
    frames = calibrated_frames(seen)
    usable = frames.usable.all(axis=0)
    usable[[0, -1]] = usable[:, [0, -1]] = False  # coupled with pixels beyond the window
    light = seen.mean_rate_map * 20.0
    assert light[usable].max() > 2e4
    pull = (frames.electrons.mean(axis=0) - light)[usable] / np.sqrt(frames.variance_e2(light)[usable] / 30.0)
    assert abs(np.median(pull)) < 4.0 * 1.25 / np.sqrt(pull.size)
    bright = usable & (light > 2000.0)
    assert abs((frames.electrons.mean(axis=0)[bright] / light[bright]).mean() - 1.0) < 1e-3
    # Undoing the coupling raises white noise a little: 1 + 40 a^2 of its variance.
    dark = usable & (light < 100.0)
    spread = frames.electrons.var(axis=0, ddof=1)[dark].mean() / frames.variance_e2(light)[dark].mean()
    assert 1.0 < spread < 1.3


def test_refusals(refused) -> None:
    refused("n_frames", calibrated_frames, observed(n_frames=1_000_000))


def test_register_clock_charge_is_taken_off() -> None:
    seen = observed(em_gain=300.0, exposure_s=0.01, n_frames=60, switches={"register_clock_charge": True})
    frames = calibrated_frames(seen)
    bar = dark_bar(seen)
    plain = load_instrument().detector
    assert frames.pedestal_e[bar].mean() > plain.cic_e + plain.register_cic_e * plain.register_stages * 0.1
    dark = seen.psf.metrics.hole & frames.usable.all(axis=0) & (seen.mean_rate_map * 0.01 < 1e-3)
    values = frames.electrons[:, dark]
    assert abs(values.mean()) < 4 * values.std() / np.sqrt(values.size) + 4 * frames.noise_e / np.sqrt(60 * bar.sum())


def test_whole_frames_are_cropped_as_they_come() -> None:
    """Without noise the hole of a whole frame is that of a window: charge that enters the edges does not get there."""
    off = ("photon_noise", "em_register", "read_noise", "cosmic_rays", "clock_charge")
    common = {"n_frames": 2, "em_gain": 1.0, "exposure_s": 17.0, "switches": dict.fromkeys(off, False)}
    window = observed(**common)
    stamp, hole = calibrated_frames(window), window.psf.metrics.hole
    whole = calibrated_frames(observed(**common, window="full"), cropped=True)
    assert whole.electrons.shape == whole.usable.shape == stamp.electrons.shape
    assert np.allclose(whole.response[hole], stamp.response[hole], rtol=1e-6)
    assert np.array_equal(stamp.usable[:, hole], whole.usable[:, hole])
    # What smears in from beyond the window is not weighed by the flat there: 1 % rms a pixel, averaged over a column.
    lit = stamp.usable[0] & hole
    assert np.allclose(whole.pedestal_e[lit], stamp.pedestal_e[lit], rtol=2e-3)
    good = stamp.usable & hole
    step = stamp.detector.gain_e_adu
    difference = np.abs(whole.electrons - stamp.electrons)[good]
    assert (difference < 1.2 * step + 2e-3 * stamp.electrons[good]).all()
    assert difference.mean() < 0.1 * step


def test_a_stamp_that_leaves_the_detector_is_refused(refused) -> None:
    moved = load_instrument({"detector": {"star_row": 30}})
    seen = observed(n_frames=1, window="full", instrument=moved)
    refused("137 pixels", calibrated_frames, seen, cropped=True)
