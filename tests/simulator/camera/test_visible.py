"""The whole chain: means, switches, bookkeeping, borders, extremes.

A stack drawn at once against the sum of frames drawn one by one.
"""

import numpy as np
import pytest

from cpic_core import Reason, Status, stream
from simulator.camera import MaskBit, VisibleCamera, stack_electrons, stackable
from simulator.config import load_instrument
from simulator.config.detector import CameraSwitches
from simulator.detectors import VISIBLE, Effect, excess_noise_factor2
from simulator.effects import draw_cosmic_rays
from tests.simulator.frames import to_electrons

SHAPE = (1050, 1080)
RAYS = load_instrument().cosmic_rays


def frames(camera, exposure, count, seed=1, rows=slice(None)):
    seen = (camera.expose(exposure, seed=seed, path=("frames", i)).adu[rows] for i in range(count))
    return np.stack(list(seen)).astype(float)


def test_all_switches_off_is_plain_arithmetic(detector):
    """Point by point: expected electrons times gain over conversion plus bias, rounded."""
    plain = detector.switched(off=("all",))
    camera = VisibleCamera(plain)
    rates = np.random.default_rng(1).uniform(0, 40, (40, 50))
    for gain in (1.0, 20.0, 300.0):
        exposure = camera.prepare(rates, 10.0, gain)
        adu = camera.expose(exposure, seed=1, path=("off",)).adu
        exact = np.clip(rates * 10.0 * gain / plain.gain_e_adu + plain.bias_adu, 0, plain.adc_max_adu)
        assert np.abs(adu - exact).max() <= 0.5 + 1e-6
        assert camera.expected_adu(exposure) == pytest.approx(exact)


@pytest.mark.parametrize(
    ("gain", "n_frames"), [(20.0, 100), *(pytest.param(gain, 300, marks=pytest.mark.long) for gain in (1.0, 20.0))]
)
def test_mean_of_frames_is_the_expected_map_with_every_effect_on(detector, gain, n_frames):
    # What is common to a frame does not average over pixels: it has a test of its own.
    camera = VisibleCamera(detector.switched(on=("register_clock_charge",), off=("interference", "bias_drift")))
    rates = np.full((60, 80), 3.0)
    rates[20:24, 30:34] = 2000.0
    exposure = camera.prepare(rates, 10.0, gain)  # cosmic rays come with their rate only
    # 300 frames: the mean over 4800 pixels is known to 1/1200 of a pixel's scatter in a frame, its pull's width to 1 %,
    # so that what is allowed below is still 4.5 of the one and 5 of the other.
    seen = frames(camera, exposure, n_frames)
    expected = camera.expected_adu(exposure)
    pull = (seen.mean(axis=0) - expected) / (seen.std(axis=0) / np.sqrt(len(seen)))
    assert abs(pull.mean()) < 4.5 / np.sqrt(pull.size)
    assert np.abs(pull).max() < 5
    assert pull.std() == pytest.approx(1, abs=0.05)


def test_structure_of_the_bias(detector):
    """Stripes stay, the wave turns with every frame, the level wanders."""
    config = detector.bias_structure
    quiet = detector.switched(off=("all",), on=("stripes", "interference", "bias_drift"))
    camera = VisibleCamera(quiet)
    exposure = camera.prepare(np.zeros(SHAPE), 0.0, 1.0)
    seen = frames(camera, exposure, 40, rows=slice(450, 555))  # a tenth of the rows: they only average rounding
    stripes = seen.mean(axis=(0, 1)) - quiet.bias_adu
    assert stripes.std() == pytest.approx(config.stripe_rms_adu, rel=0.1)
    rest = seen - seen.mean(axis=0)
    levels = rest.mean(axis=(1, 2))
    assert levels.std() == pytest.approx(config.drift_adu, rel=0.4)
    waves = rest - levels[:, None, None]
    assert waves.std() == pytest.approx(config.interference_adu / np.sqrt(2), rel=0.05)
    # The wave runs in the order of readout: one line on, it has moved on by a line's pixels.
    turn = 2 * np.pi / config.interference_period_columns
    spectrum = np.abs(np.fft.rfft(waves[0, 50] - waves[0, 50].mean()))
    assert np.argmax(spectrum) == pytest.approx(SHAPE[1] / config.interference_period_columns, abs=1)
    column = np.arange(SHAPE[1])
    phases = [np.angle(np.sum(waves[0, row] * np.exp(-1j * turn * column))) for row in (50, 51)]
    moved = (phases[1] - phases[0] - turn * SHAPE[1]) % (2 * np.pi)
    assert min(moved, 2 * np.pi - moved) < 0.1


@pytest.mark.parametrize("name", list(CameraSwitches.model_fields))
def test_a_switch_leaves_the_draws_of_the_others(detector, name):
    """Turning one effect off changes what depends on it and no random number of the others."""
    base = detector.switched(off=("all",), on=("read_noise", "interference", "bias_drift", "stripes"))
    if name in ("read_noise", "interference", "bias_drift", "stripes"):
        others = base.switched(off=(name,))
        seen = [VisibleCamera(d) for d in (base, others, detector.switched(off=("all",), on=(name,)))]
        level = np.zeros((30, 40))
        both, without, alone = (
            camera.expose(camera.prepare(level, 1.0, 1.0), seed=3, path=("s",)).adu.astype(int) for camera in seen
        )
        assert np.abs(both - without - (alone - 200)).max() <= 2  # each frame is rounded
    else:
        one = VisibleCamera(base.switched(on=(name,)), cosmic_rays=RAYS, cosmic_ray_rate_per_s_cm2=1e-9)
        two = VisibleCamera(base, cosmic_rays=RAYS, cosmic_ray_rate_per_s_cm2=1e-9)
        level = np.zeros((30, 40))
        first, second = (camera.expose(camera.prepare(level, 0.0, 1.0), seed=3, path=("s",)) for camera in (one, two))
        changed = first.adu.astype(int) - second.adu.astype(int)
        # Without light, without exposure and at gain 1 only clock charge adds something: whole electrons, up.
        assert changed.min() >= 0
        assert (changed > 0).mean() < 0.05


@pytest.mark.parametrize("name", ["cosmic_rays", "clock_charge", "bad_pixels", "smear", "parallel_cti"])
def test_pixels_that_an_effect_does_not_touch_keep_their_noise(detector, name):
    """What a pixel draws in one step does not depend on other pixels: frames with and without differ where it acts."""
    rates = np.full((120, 120), 0.4)
    quiet = detector.switched(off=("serial_cti",))

    def exposed(camera_detector):
        camera = VisibleCamera(camera_detector, cosmic_rays=RAYS, cosmic_ray_rate_per_s_cm2=30.0)
        exposure = camera.prepare(rates, 10.0, 20.0)
        return exposure.mean_e, camera.expose(exposure, seed=9, path=("same",)).adu

    mean, frame = exposed(quiet)
    mean_without, without = exposed(quiet.switched(off=(name,)))
    same_mean = np.abs(mean - mean_without) < 1e-3
    share = (frame != without)[same_mean].mean()
    # Touched: particles 4 %, clock charge 2 %, losses of 2 % of four electrons each from a pixel and into the next.
    allowed = {"cosmic_rays": 0.08, "clock_charge": 0.03, "bad_pixels": 1e-3, "smear": 1e-3, "parallel_cti": 0.15}
    assert share < allowed[name]


def test_a_spike_blooms_in_full_on_a_curved_pixel(detector):
    """101 full wells fill 101 pixels, less what the curve takes from the first."""
    camera = VisibleCamera(detector.switched(off=("all",), on=("blooming", "nonlinearity")))
    rates = np.zeros(SHAPE)
    rates[514, 536] = 101 * detector.full_well_e
    exposure = camera.prepare(rates, 1.0, 1.0)
    frame = camera.expose(exposure, seed=1, path=("spike",))
    filled = np.flatnonzero(frame.mask[:, 536] & MaskBit.SATURATED)
    assert len(filled) == 101
    assert (filled[0], filled[-1]) == (464, 564)
    assert frame.charge["nonlinearity"] == -0.01 * detector.full_well_e
    assert ((camera.expected_adu(exposure)[:, 536] > 210) == (np.isin(np.arange(1050), filled))).all()


def test_charge_without_photon_noise_keeps_its_mean(detector):
    """Fractions of electrons are rounded at random before single ones can be left behind."""
    camera = VisibleCamera(
        detector.switched(off=("all",), on=("parallel_cti", "serial_cti", "em_register", "nonlinearity"))
    )
    for level in (0.1, 0.7):
        exposure = camera.prepare(np.full((400, 400), level), 1.0, 20.0)
        frame = camera.expose(exposure, seed=1, path=("mean",))
        expected = (camera.expected_adu(exposure) - 200) * 59 / 20
        # Before the converter: the register's own count.
        found = frame.charge["register_out"] / 20 / 400**2
        assert found == pytest.approx(expected.mean(), abs=4.5 * np.sqrt(2 * level) / 400)


def test_losses_beyond_what_is_followed_are_refused(refused):
    refused(r"parallel_cti.*at most 0\.000144", load_instrument, {"detector": {"transfer": {"parallel_cti": 0.001}}})
    refused(r"serial_cti.*at most 0\.000139", load_instrument, {"detector": {"transfer": {"serial_cti": 0.0002}}})


def test_charge_is_booked_to_the_electron(detector):
    """In: collected, particles, clock charge. Out: curve, drained, left behind, into the register."""
    camera = VisibleCamera(detector, cosmic_rays=RAYS, cosmic_ray_rate_per_s_cm2=30.0)
    y, x = np.indices(SHAPE)
    halo = 0.1 + 3e6 / (1 + (np.hypot(y - 514, x - 536) / 6) ** 3.2)
    frame = camera.expose(camera.prepare(halo, 10.0, 20.0), seed=5, path=("book",))
    charge = frame.charge
    assert frame.n_saturated_pixels > 100
    assert frame.n_cosmic_rays > 100
    steps = ("collected", "cosmic_rays", "nonlinearity", "drained_bottom", "drained_top", "left_behind", "clock_charge")
    assert sum(charge[step] for step in steps) == charge["register_in"]
    assert all(value == round(value) for value in charge.values())
    assert charge["drained_row_ends"] <= 0


def test_cosmic_rays_of_a_frame_are_those_of_their_stream(bare):
    det = bare(
        read_noise_e=0.0, dark_e_s=0.0, dark_293k_e_s=0.0, cic_e=0.0, gain_e_adu=1.0, adc_bits=16, full_well_e=1e6
    ).switched(on=("cosmic_rays",))
    camera = VisibleCamera(det, cosmic_rays=RAYS, cosmic_ray_rate_per_s_cm2=1.0)
    frame = camera.expose(camera.prepare(np.zeros(SHAPE), 30.0, 1.0), seed=7, path=("rays",))
    image = det.sections["image"]
    shape = (1032, 1056)
    hits = draw_cosmic_rays(RAYS, shape, det.pixel_um, 30.0, 1.0, stream(7, "rays", "cosmic_rays"))
    assert np.array_equal(frame.adu[image].astype(int) - 200, hits.image())
    assert np.array_equal((frame.mask & MaskBit.COSMIC_RAY)[image] > 0, hits.image() > 0)
    outside = np.ones(SHAPE, bool)
    outside[image] = False
    assert (frame.adu[outside] == 200).all()


def test_borders_of_the_frame_see_no_light(detector):
    still = detector.switched(off=("read_noise", "interference", "bias_drift", "stripes", "clock_charge"))
    camera = VisibleCamera(still)
    frame = camera.expose(camera.prepare(np.full(SHAPE, 100.0), 10.0, 1.0), seed=1, path=("edge",))
    parts = still.sections
    lit = frame.adu[parts["active"]]
    assert np.median(lit) == pytest.approx(1000 / 59 + 200, abs=1)
    for name in ("dark_left", "dark_right", "dark_bottom", "dark_top", "prescan"):
        assert np.median(frame.adu[parts[name]]) == 200, name
    # What transfers leave behind arrives in the first lines of the overscan: 1.6 % of 1000 e-, less than an ADU.
    exact = VisibleCamera(detector.switched(off=("read_noise",)))
    behind = exact.expected_adu(exact.prepare(np.full(SHAPE, 4000.0), 10.0, 1.0)) - exact.expected_adu(
        exact.prepare(np.zeros(SHAPE), 10.0, 1.0)
    )
    first_dark = behind[514, parts["dark_right"][1].start]
    assert first_dark == pytest.approx(
        40000 / 59 * (1 - (1 - 1e-5) ** (1 + 1072 + parts["dark_right"][1].start - 1)), rel=0.05
    )
    assert (behind[:, : parts["prescan"][1].stop] == 0).all()


def test_smear_is_the_light_of_the_column_during_the_line_shifts(detector):
    """Oracle: charge packets walked line by line under the light."""
    det = detector.switched(off=("all",), on=("smear",))
    rng = np.random.default_rng(3)
    rates = rng.uniform(0, 1e6, (20, 5))
    exposure = VisibleCamera(det).prepare(rates, 2.0, 1.0, first_pixel=(100, 100))
    step = det.transfer.line_shift_s
    walked = rates * 2.0
    for row in range(20):
        for above in range(19, row, -1):  # on the way in, from the top
            walked[row] += rates[above] * step
        for below in range(row - 1, -1, -1):  # on the way out, to the register at the bottom
            walked[row] += rates[below] * step
    assert exposure.mean_e == pytest.approx(walked, rel=1e-12)
    np.testing.assert_allclose(exposure.smear_e, walked - rates * 2.0, rtol=1e-6)


def test_a_window_of_a_frame_collects_what_the_frame_does(detector):
    """Rows of a larger window, and the light of the others as column sums."""
    camera = VisibleCamera(detector.switched(off=("all",), on=("smear",)))
    rates = np.random.default_rng(4).uniform(0, 1e6, (20, 5))
    whole = camera.prepare(rates, 2.0, 1.0, first_pixel=(100, 100))
    beyond = rates[:8].sum(axis=0) + rates[14:].sum(axis=0)
    part = camera.prepare(rates[8:14], 2.0, 1.0, first_pixel=(108, 100), beyond_e_s=beyond)
    np.testing.assert_allclose(part.mean_e, whole.mean_e[8:14], rtol=1e-12)
    still = VisibleCamera(detector.switched(off=("all",)))
    assert still.prepare(rates[8:14], 2.0, 1.0, first_pixel=(108, 100), beyond_e_s=beyond).smear_e is None


@pytest.mark.parametrize("beyond", [np.ones(4), np.array([0.0, 1.0, -1.0, 0.0, 0.0]), np.full(5, np.nan)])
def test_light_beyond_a_window_is_one_finite_number_a_column(refused, detector, beyond):
    camera = VisibleCamera(detector.switched(off=("all",), on=("smear",)))
    refused("beyond_e_s", camera.prepare, np.ones((6, 5)), 2.0, 1.0, first_pixel=(108, 100), beyond_e_s=beyond)


@pytest.mark.parametrize("gain", [1.0, pytest.param(2.0, marks=pytest.mark.long), 300.0])
def test_photon_transfer_of_the_whole_camera(detector, gain):
    """Pairs of flats, as at the bench: conversion to 1 %, read noise and excess noise to 2 %."""
    camera = VisibleCamera(detector.switched(off=("nonlinearity", "bad_pixels", "bad_columns", "interference")))
    # Charge moved by transfer correlates neighbours; F^2 and K come from temporal differences at low losses.
    part = detector.sections["active"]
    levels = np.array([0.0, 4000.0, 9000.0, 20000.0]) / (1 if gain == 1 else gain / 2)
    mean, variance = [], []
    for number, level in enumerate(levels):
        exposure = camera.prepare(np.full(SHAPE, level), 1.0, gain)
        pair = [camera.expose(exposure, seed=2, path=(number, i)).adu[part].astype(float) for i in (0, 1)]
        mean.append((pair[0] + pair[1]).mean() / 2)
        variance.append((pair[0] - pair[1]).var() / 2)
    slope, _ = np.polyfit(mean, variance, 1)
    factor2 = float(excess_noise_factor2(gain))
    # Losses of 3 % per pixel smooth the noise between neighbours by about twice their mean.
    assert slope == pytest.approx(factor2 * gain / detector.gain_e_adu, rel=0.01)
    assert variance[0] - 1 / 12 == pytest.approx(
        (detector.read_noise_e / detector.gain_e_adu) ** 2
        + factor2 * gain**2 * detector.cic_e / detector.gain_e_adu**2,
        rel=0.02,
    )


def test_flat_field_shows_the_response(detector):
    camera = VisibleCamera(detector.switched(off=("all",), on=("flat", "bad_pixels", "bad_columns")))
    frame = camera.expose(camera.prepare(np.full(SHAPE, 3e4), 1.0, 1.0), seed=1, path=("flat",))
    lit = frame.adu[detector.sections["active"]].astype(float) - 200
    good = (frame.mask[detector.sections["active"]] & MaskBit.BAD) == 0
    assert lit[good].std() / lit[good].mean() == pytest.approx(detector.flaws.prnu_rms, rel=0.01)
    assert lit[good].mean() == pytest.approx(3e4 / 59, rel=1e-3)
    assert lit[~good].max() == 0
    bad_columns = (~good).sum(axis=0) > 500
    assert bad_columns.sum() == detector.flaws.bad_columns


def test_in_register_clock_charge_has_its_mean(bare):
    det = bare(
        read_noise_e=0.0,
        cic_e=0.0,
        dark_e_s=0.0,
        dark_293k_e_s=0.0,
        gain_e_adu=1.0,
        adc_bits=16,
        bias_adu=0,
        register_cic_e=2e-5,
    ).switched(on=("register_clock_charge",))
    camera = VisibleCamera(det)
    exposure = camera.prepare(np.zeros((700, 700)), 1.0, 300.0)
    frame = camera.expose(exposure, seed=1, path=("cic",))
    p = np.expm1(np.log(300) / 604)
    expected = 2e-5 * sum((1 + p) ** k for k in range(604))
    assert camera.expected_adu(exposure)[0, 0] == pytest.approx(expected)
    charge = frame.adu.astype(float)
    assert charge.mean() == pytest.approx(expected, abs=4.5 * charge.std() / charge.size**0.5)
    assert (charge > 0).mean() == pytest.approx(1 - np.exp(-2e-5 * 604), rel=0.05)


def test_frames_do_not_depend_on_order_or_company(detector):
    camera = VisibleCamera(detector, cosmic_rays=RAYS, cosmic_ray_rate_per_s_cm2=1.0)
    exposure = camera.prepare(np.full((90, 110), 2.0), 30.0, 300.0)
    forward = frames(camera, exposure, 4)
    other = VisibleCamera(detector, cosmic_rays=RAYS, cosmic_ray_rate_per_s_cm2=1.0)
    again = other.prepare(np.full((90, 110), 2.0), 30.0, 300.0)
    for index in (3, 0, 2, 1):
        assert np.array_equal(other.expose(again, seed=1, path=("frames", index)).adu, forward[index])


def test_an_effect_of_ones_own_is_one_class(bare):
    class Glow(Effect):
        switch = "glow"
        stage = "charge"
        fixed = True

        def expect(self, image, exposure):
            image += 7.0

        def draw(self, work, exposure, rng):
            work.image += rng.poisson(7.0, work.image.shape)

    camera = VisibleCamera(bare(), chain=(*VISIBLE[:1], Glow(), *VISIBLE[1:]))
    exposure = camera.prepare(np.zeros((200, 200)), 1.0, 1.0)
    frame = camera.expose(exposure, seed=1, path=("glow",))
    expected = camera.expected_adu(exposure)
    assert expected[0, 0] == pytest.approx(200 + (7 + 0.02) / 59, abs=1e-3)
    assert frame.adu.mean() == pytest.approx(expected[0, 0], abs=4.5 * frame.adu.std() / 200)


def test_windows_beyond_the_pixels_are_refused(refused, detector):
    camera = VisibleCamera(detector)
    refused("active pixels", camera.prepare, np.zeros((100, 100)), 1.0, 1.0, first_pixel=(1000, 500))
    refused("path", camera.expose, camera.prepare(np.zeros((10, 10)), 1.0, 1.0), seed=1, path="name")
    for bad in (
        {"first_pixel": "ab"},
        {"first_pixel": (1.5, 2)},
        {"first_pixel": (1, 2, 3)},
        {"exposure_s": -1.0},
        {"exposure_s": np.nan},
        {"em_gain": 0.5},
        {"em_gain": 1001.0},
        {"em_gain": [2, 3]},
    ):
        refused(next(iter(bad)), camera.prepare, np.zeros((10, 10)), **{"exposure_s": 1.0, "em_gain": 1.0} | bad)


@pytest.mark.parametrize("level", [0.0, -0.0, 1e-300, 1e-12, 1e9, 2.0**31 + 0.5, 1e15, 9.2e18, 9.3e18, 1e300])
@pytest.mark.parametrize("exposure_s", [0.0, 1e-6, 1.0, 1e6])
def test_levels_from_nothing_to_everything(detector, level, exposure_s):
    """Finite, in range, never wrapped; brighter is never fainter without noise."""
    camera = VisibleCamera(detector)
    rates = np.zeros((24, 24))
    rates[12, 12] = level
    exposure = camera.prepare(rates, exposure_s, 300.0)
    expected = camera.expected_adu(exposure)
    frame = camera.expose(exposure, seed=1, path=("extreme",))
    assert np.isfinite(expected).all()
    assert expected.min() >= 0
    assert expected.max() <= detector.adc_max_adu
    assert frame.adu.max() <= detector.adc_max_adu
    assert all(np.isfinite(value) for value in frame.charge.values())
    if level * exposure_s > 1e7:
        assert frame.lost[12, 12]
        assert frame.adu[12, 12] > 11_000
    longer = camera.expected_adu(camera.prepare(rates, min(2 * exposure_s, 1e6), 300.0))
    brighter = camera.expected_adu(camera.prepare(2 * np.minimum(rates, 1e300), exposure_s, 300.0))
    for more in (longer, brighter):
        assert (more - expected).min() > -1e-6
    if exposure_s:
        full = camera.expose(camera.prepare(2 * np.minimum(rates, 1e300), exposure_s, 300.0), seed=1, path=("extreme",))
        assert full.n_saturated_pixels >= frame.n_saturated_pixels


@pytest.mark.parametrize(("bad", "word"), [(np.nan, "nan"), (np.inf, "inf"), (-1.0, "-1"), (-1e-8, "-1e-08")])
def test_impossible_rates_are_refused_with_their_pixel(refused, detector, bad, word):
    rates = np.ones((24, 24))
    rates[3, 7] = bad
    refused(rf"y=3, x=7.*{word}", VisibleCamera(detector).prepare, rates, 1.0, 1.0)
    ringing = np.ones((24, 24))
    ringing[3, 7] = -5e-10
    exposure = VisibleCamera(detector).prepare(ringing, 1.0, 1.0)
    assert exposure.n_negative_rates == 1
    assert exposure.mean_e.min() >= 0


N = 30


@pytest.fixture(scope="module")
def camera(detector):
    return VisibleCamera(detector.switched(off=("nonlinearity",)))


@pytest.mark.parametrize(("gain", "level"), [(1.0, 300.0), (20.0, 0.4), (300.0, 2.0)])
def test_mean_and_variance_are_those_of_the_sum(bare, gain, level):
    det = bare(bias_adu=400)
    camera = VisibleCamera(det)
    exposure = camera.prepare(np.full((300, 300), level), 1.0, gain)
    once = stack_electrons(camera, exposure, N, seed=1, path=("once",))
    frames = [camera.expose(exposure, seed=1, path=("frames", i)).adu for i in range(N)]
    summed = sum(to_electrons(adu, det, gain) for adu in frames)
    mean = N * (level + det.dark_e_s + det.cic_e)
    factor2 = float(excess_noise_factor2(gain))
    variance = factor2 * mean + N * (det.read_noise_e**2 + det.gain_e_adu**2 / 12) / gain**2
    for stack in (once, summed):
        assert stack.mean() == pytest.approx(mean, abs=4.5 * np.sqrt(variance / stack.size) + 1e-4)
        assert stack.var() == pytest.approx(variance, rel=4.5 * np.sqrt((2 + 9 / mean) / stack.size))


def test_the_law_is_that_of_the_sum(bare):
    """Two-sample comparison of the whole distribution, tails of the register included."""
    from scipy import stats

    camera = VisibleCamera(bare(read_noise_e=5.0, bias_adu=400, gain_e_adu=1.0, adc_bits=16))
    exposure = camera.prepare(np.full((250, 250), 0.05), 1.0, 50.0)
    once = stack_electrons(camera, exposure, N, seed=2, path=("once",)).ravel()
    detector = camera.detector
    summed = sum(
        to_electrons(camera.expose(exposure, seed=2, path=("frames", i)).adu, detector, 50.0) for i in range(N)
    ).ravel()
    assert stats.ks_2samp(once, summed).pvalue > 1e-3


def test_what_is_common_to_frames_adds_up_too(camera):
    exposure = camera.prepare(np.zeros((200, 200)), 0.0, 1.0)
    levels = [stack_electrons(camera, exposure, N, seed=s, path=("level",)).mean() for s in range(60)]
    drift = camera.detector.bias_structure.drift_adu * camera.detector.gain_e_adu
    assert np.std(levels) == pytest.approx(drift * np.sqrt(N), rel=0.4)
    assert np.mean(levels) == pytest.approx(0, abs=4.5 * drift * np.sqrt(N / 60))


def test_frames_that_can_saturate_are_refused_with_the_limit(refused, camera, detector):
    for level, gain, reason in ((1e5, 1.0, Reason.PIXEL_FULL_WELL), (3000.0, 300.0, Reason.REGISTER_FULL_WELL)):
        exposure = camera.prepare(np.full((5, 5), level), 1.0, gain)
        answer = stackable(camera, exposure)
        assert answer.status is Status.SATURATED
        assert answer.reason is reason
        refused("one draw", stack_electrons, camera, exposure, 3, seed=1, path=("a",))
    curved = VisibleCamera(detector)
    answer = stackable(curved, curved.prepare(np.zeros((5, 5)), 1.0, 1.0))
    assert answer.reason is Reason.NOT_ADDITIVE
    assert "nonlinearity" in answer.message
    assert stackable(camera, camera.prepare(np.ones((5, 5)), 1.0, 20.0)).unwrap() < 0.1


@pytest.mark.parametrize(("gain", "level"), [(1.0, 10_000.0), (300.0, 1000.0)])
def test_a_sum_may_be_more_than_a_full_well(bare, gain, level):
    """Limits that no frame reaches do not cut their sum."""
    det = bare(gain_e_adu=100.0)
    camera = VisibleCamera(det)
    exposure = camera.prepare(np.full((100, 100), level), 1.0, gain)
    once = stack_electrons(camera, exposure, N, seed=3, path=("once",))
    summed = sum(to_electrons(camera.expose(exposure, seed=3, path=("frames", i)).adu, det, gain) for i in range(N))
    assert N * level > det.full_well_e or N * level * gain > det.register_full_well_e
    sigma = np.sqrt(N * (2 * level + (det.read_noise_e / gain) ** 2))
    assert once.mean() == pytest.approx(summed.mean(), abs=6 * sigma / 100)
    assert once.std() == pytest.approx(summed.std(), rel=0.06)


def test_limits_of_maps_count(refused, bare, tmp_path):
    import dataclasses

    camera = VisibleCamera(bare())
    exposure = camera.prepare(np.zeros((5, 5)), 0.0, 1.0)
    charge = np.zeros((5, 5))
    charge[2, 3] = 5e5
    assert stackable(camera, dataclasses.replace(exposure, cic_e=charge)).reason is Reason.PIXEL_FULL_WELL
    low = dataclasses.replace(exposure, bias_adu=np.full((5, 5), 3.0))
    assert stackable(camera, low).reason is Reason.ADC_RANGE
    for wrong in (0, -1, 1.5, "3", True, 10**7):
        refused("n_frames", stack_electrons, camera, exposure, wrong, seed=1, path=("a",))


def test_rounding_of_the_converter_is_in_the_sum(bare):
    det = bare().switched(off=("read_noise",))
    camera = VisibleCamera(det)
    stack = stack_electrons(camera, camera.prepare(np.full((300, 300), 100.0), 1.0, 1.0), N, seed=4, path=("r",))
    expected = N * (100.0 + det.cic_e) + N * det.gain_e_adu**2 / 12
    assert stack.var() == pytest.approx(expected, rel=0.03)
