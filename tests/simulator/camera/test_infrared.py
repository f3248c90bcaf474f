"""The near-infrared camera: statistics, charge, limits and reproducibility.

Reads and their reduction: closed forms and a direct least-squares fit.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from cpic_core import InputError
from simulator.camera import InfraredCamera, MaskBit, load_calibration_set
from simulator.camera.camera import ReadStack, read_times
from simulator.config import InfraredDetector, load_instrument
from simulator.detectors import PastExposure
from simulator.detectors.infrared import ExponentialPersistence, InterpixelKernel, tracks_of, well_signal

MODES = ("single", "cds", "up_the_ramp")
PATH = ("target", "science", "F1265", 0, 3)
FLAWS = ("flat", "dark_structure", "bad_pixels")


@pytest.fixture(scope="module")
def varied(infrared):
    """Default camera with changed values, and effects off."""

    def build(off=(), on=(), **values) -> InfraredDetector:
        return InfraredDetector(**{**infrared.model_dump(), **values}).switched(off=off, on=on)

    return build


def flat_frame(detector, level, *, side=512, tag="a", exposure_s=1.0):
    camera = InfraredCamera(detector)
    return camera.expose(camera.prepare(np.full((side, side), level), exposure_s), seed=9, path=(tag,)).adu.astype(
        float
    )


def struck(exposure, pixels, electrons):
    """The exposure with these electrons of particles in pixels of the flat array, instead of drawn ones."""
    charge = np.bincount(pixels, electrons, exposure.mean_e.size).reshape(exposure.mean_e.shape)
    given = SimpleNamespace(image=lambda: charge, n_events=tracks_of(charge > 0)[1])
    return replace(exposure, tracks=lambda shape, rng: given)


@pytest.mark.parametrize("mode", MODES)
def test_photon_transfer(varied, mode) -> None:
    """Gain to 1 %, read noise to 2 %, from a ramp of levels as at the bench."""
    det = varied(off=(*FLAWS, "dark", "nonlinearity", "reset_noise"), readout_mode=mode, n_reads=6, read_noise_e=25)
    levels = np.array([0.0, 5e3, 1e4, 2e4, 4e4])
    mean, variance = [], []
    for i, level in enumerate(levels):
        pair = [flat_frame(det, level, tag=f"{mode}{i}{k}") for k in (0, 1)]
        mean.append(np.mean(pair) - det.bias_adu)
        variance.append(np.var(pair))
    slope = np.polyfit(mean[1:], np.array(variance[1:]) - variance[0], 1)[0]
    n = 6
    photon = {"single": 1.0, "cds": 1.0, "up_the_ramp": 1.2 * (n**2 + 1) / (n * (n + 1))}[mode]
    read = {"single": 1.0, "cds": 2.0, "up_the_ramp": 12 * (n - 1) / (n * (n + 1))}[mode]
    assert photon / slope == pytest.approx(det.gain_e_adu, rel=0.01)
    noise = np.sqrt((variance[0] - 1 / 12) / read) * det.gain_e_adu
    assert noise == pytest.approx(det.read_noise_e, rel=0.02)


# Most of the time goes into the reads along a ramp, whose level and noise `test_photon_transfer` has as well.
@pytest.mark.parametrize(
    "mode", [pytest.param(mode, marks=[pytest.mark.long] * (mode == "up_the_ramp")) for mode in MODES]
)
def test_mean_frame_is_the_expected_one(varied, mode) -> None:
    det = varied(on=("interpixel_capacitance",), readout_mode=mode, n_reads=5)
    camera = InfraredCamera(det)
    # As many draws as 2500 frames of a quarter of the pixels, and half of their overhead.
    exposure = camera.prepare(np.random.default_rng(0).uniform(0, 800, (48, 60)), 60.0)
    frames = np.stack([camera.expose(exposure, seed=2, path=("mean", i)).adu for i in range(625)]).astype(float)
    pull = (frames.mean(axis=0) - camera.expected_adu(exposure)) / (frames.std(axis=0) / np.sqrt(len(frames)))
    assert np.abs(pull).max() < 4.5
    assert pull.std() == pytest.approx(1, abs=0.15)
    assert abs(pull.mean()) < 4.5 / np.sqrt(pull.size)


def test_expected_frame_in_closed_form(varied) -> None:
    det = varied(off=FLAWS, readout_mode="cds")
    camera = InfraredCamera(det)
    exposure = camera.prepare(np.array([[0.0, 100.0], [600.0, 900.0]]), 100.0)
    x = (np.array([[0.0, 1e4], [6e4, 9e4]]) + 100.0) / 1e5
    assert camera.expected_adu(exposure) == pytest.approx(1000 + 1e5 * (x - 0.03 * x**2) / 2, rel=1e-12)
    assert exposure.mean_e == pytest.approx(1e5 * x)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("exposure_s", [0.0, 0.5, 300.0])
def test_all_switches_off_is_plain_arithmetic(varied, mode, exposure_s) -> None:
    det = varied(off=("all",), readout_mode=mode)
    camera = InfraredCamera(det)
    rates = np.random.default_rng(1).uniform(0, 300, det.shape)
    exposure = camera.prepare(rates, exposure_s)
    frame = camera.expose(exposure, seed=1, path=PATH)
    plain = rates * exposure_s / det.gain_e_adu + det.bias_adu
    assert np.abs(frame.adu - np.rint(plain)).max() <= 1
    np.testing.assert_allclose(camera.expected_adu(exposure), plain, rtol=1e-12)
    assert not frame.mask.any()


@pytest.mark.parametrize("mode", MODES)
def test_charge_is_conserved(varied, mode) -> None:
    det = varied(on=("persistence",), readout_mode=mode)
    camera = InfraredCamera(det)
    rates = np.random.default_rng(1).uniform(0, 8000, (60, 70))
    hits = (np.arange(300, 340), np.full(40, 2000))
    past = [PastExposure(np.full((60, 70), 9e4), 20.0)]
    frame = camera.expose(struck(camera.prepare(rates, 15.0), *hits), seed=3, path=PATH, past=past)
    book = frame.charge
    came = book["photons"] + book["dark"] + book["persistence"] + book["cosmic_rays"]
    assert came == book["stored"] + book["lost_full_well"]
    assert book["lost_full_well"] > 0
    assert book["cosmic_rays"] == 80_000
    assert all(value == int(value) for value in book.values())
    light = load_calibration_set(det).window(slice(226, 286), slice(285, 355)).response * rates * 15.0
    assert abs(book["photons"] - light.sum()) < 4.5 * np.sqrt(light.sum())


@pytest.mark.parametrize("mode", MODES)
def test_same_seed_same_bytes(varied, mode) -> None:
    det = varied(off=FLAWS, readout_mode=mode)
    rates = np.full((40, 50), 30.0)

    def frame(seed=1, path=PATH):
        camera = InfraredCamera(det)
        return camera.expose(camera.prepare(rates, 10.0), seed=seed, path=path).adu

    one = frame()
    assert one.tobytes() == frame().tobytes()
    for other in (frame(seed=2), frame(path=(*PATH[:-1], 4))):
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 4.5 / np.sqrt(one.size)


@pytest.mark.parametrize("mode", MODES)
def test_switches_leave_the_numbers_of_the_others(varied, mode) -> None:
    """What a switch changes is the contribution of its own effect."""
    quiet = ("nonlinearity", *FLAWS)
    base = {"readout_mode": mode, "gain_e_adu": 1.0, "bias_adu": 9000, "read_noise_e": 30, "n_reads": 4}
    rates = np.full((80, 80), 20.0)
    hits = ([3000, 3001], [500, 700])

    def frame(*off):
        camera = InfraredCamera(varied(off=(*quiet, *off), **base))
        return camera.expose(struck(camera.prepare(rates, 10.0), *hits), seed=4, path=PATH).adu.astype(int)

    everything = frame()
    # without photon noise charge is what is expected: the other effects alone are left
    for name in ("read_noise", "reset_noise", "cosmic_rays"):
        alone = everything - frame(name)
        again = frame("photon_noise") - frame("photon_noise", name)
        assert np.abs(alone - again).max() <= 2, name
    dark = everything - frame("dark")
    photon = frame("read_noise", "reset_noise") - frame("read_noise", "reset_noise", "dark")
    if mode != "up_the_ramp":
        assert np.abs(dark - photon).max() <= 2
        assert photon.min() >= 0
    assert photon.mean() == pytest.approx(10, abs=0.5)


def test_double_sampling_and_ramp_cancel_the_reset(varied) -> None:
    rates = np.full((100, 100), 5.0)
    for mode in MODES:
        noisy = [
            InfraredCamera(varied(off=off, readout_mode=mode, reset_noise_e=500)) for off in ((), ("reset_noise",))
        ]
        one, two = (camera.expose(camera.prepare(rates, 10.0), seed=4, path=PATH).adu.astype(int) for camera in noisy)
        if mode == "single":
            assert (one - two).std() == pytest.approx(250, rel=0.03)
        else:
            assert np.abs(one - two).max() <= 1


@pytest.mark.parametrize("mode", MODES)
def test_saturation(varied, mode) -> None:
    det = varied(off=(*FLAWS, "dark"), readout_mode=mode, n_reads=8, bias_adu=1000)
    rates = np.array([[10.0, 90.0, 200.0, 650.0, 750.0, 1e4, 1e9]])
    camera = InfraredCamera(det)
    exposure = camera.prepare(rates, 1000.0)
    frame = camera.expose(exposure, seed=1, path=PATH)
    assert frame.n_saturated_pixels == 5
    expected = [False, False, True, True, True, True, True]
    if mode == "up_the_ramp":
        # the fit to the unsaturated reads sees the whole slope, beyond the range of 16 bits
        assert (frame.adu[0, 2:] == 65535).all()
    else:
        ceiling = 1000 + (0.97 + 0.94 * 0.02) * 5e4
        assert np.abs(frame.adu[0, 3:] - ceiling).max() < 5 * np.hypot(50, 25 * np.sqrt(2)) / 2
    assert list((frame.mask & MaskBit.SATURATED)[0] != 0) == expected
    assert list(frame.lost[0]) == expected


def test_a_ramp_measures_what_saturates_before_its_end(varied) -> None:
    det = varied(off=(*FLAWS, "dark", "nonlinearity"), readout_mode="up_the_ramp", n_reads=11, gain_e_adu=10.0)
    camera = InfraredCamera(det)
    exposure = camera.prepare(np.full((60, 60), 3000.0), 100.0)
    frame = camera.expose(exposure, seed=1, path=PATH)
    assert frame.n_saturated_pixels == 3600
    assert not frame.lost.any()
    # four reads in a third of the exposure
    np.testing.assert_allclose(camera.expected_adu(exposure), 1000 + 3e4, rtol=1e-12)
    sigma = np.sqrt(9e4 * 1.2 * 17 / 20 + 625 * 36 / 20) / 0.3 / 10
    assert abs(frame.adu.mean() - 31000) < 4.5 * sigma / 60
    assert frame.adu.std() == pytest.approx(sigma, rel=0.06)


@pytest.mark.parametrize("mode", MODES)
def test_converter_range(varied, mode) -> None:
    det = varied(off=FLAWS, readout_mode=mode, adc_bits=12, bias_adu=100)
    camera = InfraredCamera(det)
    frame = camera.expose(camera.prepare(np.full((20, 20), 1e3), 50.0), seed=1, path=PATH)
    if mode == "cds":  # the first read has noise too
        assert 4095 - 5 * np.hypot(50, 25) / 2 < frame.adu.min() < frame.adu.max() == 4095
    else:
        assert (frame.adu == 4095).all()
    assert frame.n_clipped == 400
    assert frame.lost.all()
    dark = varied(off=FLAWS, readout_mode=mode, bias_adu=0, read_noise_e=100)
    camera = InfraredCamera(dark)
    frame = camera.expose(camera.prepare(np.zeros((20, 20)), 0.0), seed=1, path=PATH)
    assert frame.n_clipped > 100
    assert not frame.lost.any()


@pytest.mark.parametrize("mode", MODES)
def test_expected_frame_never_falls_with_time_or_light(varied, mode) -> None:
    camera = InfraredCamera(varied(readout_mode=mode, off=("bad_pixels",)))
    rates = np.geomspace(1e-3, 1e9, 640)[None, :] * np.ones((2, 1))
    last = np.zeros_like(rates)
    for exposure_s in (1e-6, 1e-3, 0.033, 0.1, 1.0, 30.0, 1e3, 1e6):
        adu = camera.expected_adu(camera.prepare(rates, exposure_s))
        assert np.isfinite(adu).all()
        assert (adu >= last - 1e-9).all()
        assert adu.min() >= 0
        assert adu.max() <= 65535
        last = adu
    uniform = InfraredCamera(varied(readout_mode=mode, off=FLAWS))
    adu = uniform.expected_adu(uniform.prepare(rates, 30.0))
    assert (np.diff(adu[0]) >= -1e-9).all()


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("rate", [0.0, -0.0, 1e-300, 1e-12, 1e9, 2**31 + 0.5, 1e15, 9.2e18, 9.3e18, 1.7e308])
def test_extreme_rates(varied, mode, rate) -> None:
    camera = InfraredCamera(varied(readout_mode=mode, n_reads=3))
    for exposure_s in (0.0, 1e-6, 1.0, 1e6):
        frame = camera.expose(camera.prepare(np.full((16, 16), rate), exposure_s), seed=1, path=PATH)
        assert frame.adu.dtype == np.uint16
        assert all(np.isfinite(value) for value in frame.charge.values())
        if rate * exposure_s > 1e12:
            assert (frame.lost | (frame.mask & MaskBit.BAD != 0)).all()


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 9), st.integers(1, 9), st.floats(0, 1e5), st.floats(0, 1e4), st.sampled_from(MODES))
def test_any_window(rows, columns, rate, exposure_s, mode) -> None:
    tree = load_instrument().near_infrared.detector.model_dump()
    camera = InfraredCamera(InfraredDetector(**{**tree, "readout_mode": mode}))
    exposure = camera.prepare(np.full((rows, columns), rate), exposure_s)
    frame = camera.expose(exposure, seed=5, path=PATH)
    assert frame.adu.shape == frame.mask.shape == camera.expected_adu(exposure).shape == (rows, columns)
    book = frame.charge
    assert book["photons"] + book["dark"] == book["stored"] + book["lost_full_well"]


def test_flaws_reach_frame_and_mask(infrared) -> None:
    camera, flaws = InfraredCamera(infrared), load_calibration_set(infrared)
    exposure = camera.prepare(np.full(infrared.shape, 100.0), 100.0)
    np.testing.assert_allclose(exposure.light_e, 1e4 * flaws.response)
    np.testing.assert_allclose(exposure.dark_e, 100 * flaws.dark_e_s)
    frame = camera.expose(exposure, seed=1, path=PATH)
    flawed = frame.mask & np.uint8(MaskBit.BAD | MaskBit.HOT | MaskBit.WARM)
    assert np.array_equal(flawed, flaws.mask)
    assert (flaws.response[(flaws.mask & MaskBit.BAD) != 0] == 0).all()
    assert np.count_nonzero(flaws.mask & MaskBit.BAD) == round(infrared.flaws.dead_fraction * flaws.mask.size)
    assert flaws.sensitivity.mean() == pytest.approx(1, abs=1e-12)
    plain = InfraredCamera(infrared.switched(off=FLAWS)).prepare(np.full(infrared.shape, 100.0), 100.0)
    assert (plain.light_e == 1e4).all()
    assert (plain.dark_e == 100).all()


def test_a_window_has_the_pixels_of_the_frame(infrared) -> None:
    camera = InfraredCamera(infrared)
    whole = camera.prepare(np.full(infrared.shape, 100.0), 10.0)
    corner = camera.prepare(np.full((5, 7), 100.0), 10.0, first_pixel=(3, 600))
    assert np.array_equal(corner.light_e, whole.light_e[3:8, 600:607])
    centred = camera.prepare(np.full((5, 7), 100.0), 10.0)
    assert np.array_equal(centred.light_e, whole.light_e[254:259, 317:324])


def test_cosmic_rays_given(varied) -> None:
    for mode in MODES:
        camera = InfraredCamera(varied(off=FLAWS, readout_mode=mode))
        exposure = camera.prepare(np.zeros((30, 40)), 10.0)
        hits = ([5, 6, 7, 1000], [4000, 6000, 2000, 30000])
        frame = camera.expose(struck(exposure, *hits), seed=1, path=PATH)
        clean = camera.expose(exposure, seed=1, path=PATH)
        marked = np.flatnonzero(frame.mask & MaskBit.COSMIC_RAY)
        assert list(marked) == [5, 6, 7, 1000]
        assert frame.n_cosmic_rays == 2
        assert frame.charge["cosmic_rays"] == 42000
        extra = frame.adu.astype(float) - clean.adu
        untouched = np.ones(extra.size, dtype=bool)
        untouched[marked] = False
        assert (extra.ravel()[untouched] == 0).all()
        if mode != "up_the_ramp":
            assert extra.ravel()[[5, 1000]] == pytest.approx([2000, 15000], rel=0.02)
    off = InfraredCamera(varied(off=("cosmic_rays", *FLAWS)))
    frame = off.expose(struck(off.prepare(np.zeros((30, 40)), 10.0), *hits), seed=1, path=PATH)
    assert frame.n_cosmic_rays == 0
    assert not frame.mask.any()


def test_cosmic_rays_drawn() -> None:
    instrument = load_instrument()
    det = instrument.near_infrared.detector.switched(off=FLAWS)
    camera = InfraredCamera(det, cosmic_rays=instrument.cosmic_rays, cosmic_ray_rate_per_s_cm2=1.0)
    exposure = camera.prepare(np.zeros(det.shape), 300.0)
    one = camera.expose(exposure, seed=1, path=PATH)
    crossings = 300 * 512 * 640 * (det.pixel_um * 1e-4) ** 2
    # tracks that begin outside the array leave charge too: up to some per cent more
    spread = 4.5 * np.sqrt(crossings)
    assert crossings - spread < one.n_cosmic_rays < 1.1 * crossings + spread
    assert one.charge["cosmic_rays"] > 0
    assert np.array_equal(one.adu, camera.expose(exposure, seed=1, path=PATH).adu)
    quiet = camera.expose(camera.prepare(np.zeros(det.shape), 0.0), seed=1, path=PATH)
    assert quiet.n_cosmic_rays == 0


def test_arrival_in_a_ramp_is_between_the_reads(varied) -> None:
    """A jump at a uniform time between two of nine reads, against the closed form of the fit."""
    off = (*FLAWS, "dark", "photon_noise", "read_noise", "reset_noise", "nonlinearity")
    camera = InfraredCamera(varied(off=off, readout_mode="up_the_ramp", n_reads=9))
    exposure = camera.prepare(np.zeros((200, 200)), 10.0)
    places = np.flatnonzero((np.indices((200, 200)) % 2 == 0).all(axis=0))
    frame = camera.expose(struck(exposure, places, np.full(places.size, 10000)), seed=1, path=PATH)
    jump = (frame.adu.ravel()[places].astype(float) - 1000) / 5000
    # reads at i/8; a jump between reads k and k+1 fits to 6 (k+1) (n-k-1) / (n (n+1)) of it
    k = np.arange(8)
    steps = 6 * (k + 1) * (9 - k - 1) / (9 * 10)
    assert np.allclose(np.unique(np.round(jump, 3)), np.unique(np.round(steps, 3)), atol=1.1e-3)
    assert jump.mean() == pytest.approx(steps.mean(), abs=4.5 * steps.std() / np.sqrt(places.size))


def test_persistence_adds_its_charge(varied) -> None:
    det = varied(on=("persistence",), off=FLAWS, dark_e_s=0.0)
    camera = InfraredCamera(det)
    exposure = camera.prepare(np.zeros((100, 100)), 100.0)
    past = [PastExposure(np.full((100, 100), 8e4), 50.0)]
    frame = camera.expose(exposure, seed=1, path=PATH, past=past)
    late = 1e-3 * 8e4 * (np.exp(-50 / 300) - np.exp(-150 / 300)) * 1e4
    assert abs(frame.charge["persistence"] - late) < 4.5 * np.sqrt(late)
    assert "persistence" not in camera.expose(exposure, seed=1, path=PATH).charge
    twice = InfraredCamera(det, persistence=ExponentialPersistence(2e-3, 300.0))
    frame = twice.expose(twice.prepare(np.zeros((100, 100)), 100.0), seed=1, path=PATH, past=past)
    assert abs(frame.charge["persistence"] - 2 * late) < 4.5 * np.sqrt(2 * late)


def test_interpixel_capacitance_correlates_neighbours(varied) -> None:
    det = varied(on=("interpixel_capacitance",), off=(*FLAWS, "nonlinearity"), interpixel_coupling=0.02)
    bright = flat_frame(det, 3e4) - det.bias_adu
    assert bright.mean() == pytest.approx(1.5e4, rel=2e-4)
    residual = bright - bright.mean()
    variance = 3e4 * (0.92**2 + 4 * 0.02**2) / 4 + 2 * 625 / 4
    assert residual.var() == pytest.approx(variance, rel=0.02)
    product = (residual[:, 1:] * residual[:, :-1]).mean()
    assert product == pytest.approx(2 * 0.02 * 0.92 * 3e4 / 4, rel=0.1)
    kernel = InterpixelKernel(np.full((3, 3), 1 / 9))
    camera = InfraredCamera(det, coupling=kernel)
    point = np.zeros((9, 9))
    point[4, 4] = 9e4
    adu = camera.expected_adu(camera.prepare(point, 1.0))
    assert adu[3:6, 3:6] == pytest.approx(np.full((3, 3), 1000 + 5000), rel=1e-3)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0])
def test_bad_rates_name_their_pixel(refused, infrared, bad) -> None:
    rates = np.ones((6, 8))
    rates[2, 5] = bad
    refused(r"rate_map_e_s\[y=2, x=5\]", InfraredCamera(infrared).prepare, rates, 1.0)


def test_rounding_error_negatives_are_counted(infrared) -> None:
    rates = np.full((6, 8), 1e3)
    rates[2, 5] = -1e-8
    camera = InfraredCamera(infrared)
    frame = camera.expose(camera.prepare(rates, 1.0), seed=1, path=PATH)
    assert frame.n_negative_rates == 1


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda c: c.prepare(np.ones((6, 8)), -1.0), "exposure_s = -1"),
        (lambda c: c.prepare(np.ones((6, 8)), np.nan), "exposure_s = nan"),
        (lambda c: c.prepare(np.ones((6, 8)), 1e7), "exposure_s"),
        (lambda c: c.prepare(np.ones((6, 8)), [1.0, 2.0]), "exposure_s.*one number"),
        (lambda c: c.prepare(np.ones(6), 1.0), "rate_map_e_s"),
        (lambda c: c.prepare(np.ones((0, 6)), 1.0), "rate_map_e_s"),
        (lambda c: c.prepare(np.ones((6, 8), dtype=complex), 1.0), "rate_map_e_s"),
        (lambda c: c.prepare(np.ones((600, 8)), 1.0), "window of 600 x 8.*512 x 640.*switch off"),
        (lambda c: c.prepare(np.ones((6, 8)), 1.0, first_pixel=(507, 0)), "window of 6 x 8 from row 507"),
        (lambda c: c.prepare(np.ones((6, 8)), 1.0, first_pixel=(0, -1)), "column -1"),
        (lambda c: c.expose(c.prepare(np.ones((6, 8)), 1.0), seed=1, path="abc"), "path"),
        (lambda c: c.expose(c.prepare(np.ones((6, 8)), 1.0), seed=-1, path=PATH), "seed"),
    ],
)
def test_refusals(refused, infrared, call, words) -> None:
    refused(words, call, InfraredCamera(infrared))


def test_plug_ins_need_their_switch_and_fit_the_frame(refused, infrared, varied) -> None:
    refused(r"switches\.persistence = False", InfraredCamera, infrared, persistence=ExponentialPersistence(0.1, 10.0))
    with pytest.raises(InputError, match=r"switches\.interpixel_capacitance = False"):
        InfraredCamera(infrared, coupling=InterpixelKernel([[0, 0, 0], [0, 1, 0], [0, 0, 0]]))
    on = varied(on=("persistence", "interpixel_capacitance"))
    broken = InfraredCamera(on, coupling=lambda signal: signal[1:])
    camera = InfraredCamera(on)
    exposure = camera.prepare(np.ones((6, 8)), 1.0)
    refused("coupling", broken.expected_adu, exposure)
    refused("coupling", broken.expose, exposure, seed=1, path=PATH)
    refused("persistence.*shape", camera.expose, exposure, seed=1, path=PATH, past=[PastExposure(np.ones((5, 5)), 1.0)])
    refused("cosmic_ray_rate", InfraredCamera, infrared, cosmic_ray_rate_per_s_cm2=-1.0)


WELL = 1e5


@pytest.mark.parametrize("loss", [0.0, 0.03, 0.4])
def test_signal_of_a_well(loss) -> None:
    charge = np.concatenate([np.linspace(0, 1.5e5, 200_001), [1e6, 1e9, 1e12]])
    signal = well_signal(charge, WELL, loss)
    assert (np.diff(signal) >= 0).all()
    assert signal[0] == 0
    below = charge <= WELL
    x = charge[below] / WELL
    np.testing.assert_allclose(signal[below], WELL * (x - loss * x**2), rtol=1e-12)
    top = WELL * (1 - loss + (0 if loss == 0 else (1 - 2 * loss) * 0.02))
    assert signal[-3:] == pytest.approx(top, rel=1e-12)


def test_the_bend_has_no_corner() -> None:
    step = 1e-3
    around = well_signal(np.array([WELL - step, WELL, WELL + step]), WELL, 0.03)
    before, after = np.diff(around) / step
    assert before == pytest.approx(0.94, abs=1e-5)
    assert after == pytest.approx(before, abs=1e-5)


def test_times() -> None:
    assert read_times("single", 1) == [1.0]
    assert list(read_times("cds", 2)) == [0.0, 1.0]
    assert list(read_times("up_the_ramp", 5)) == [0.0, 0.25, 0.5, 0.75, 1.0]


def fed(mode, reads, full=None, bias=1000.0, top=65535.0):
    """Stack of reads given as an array (reads, rows, columns)."""
    stack = ReadStack(mode, reads.shape[1:], bias, top)
    full = np.zeros(reads.shape, dtype=bool) if full is None else full
    for fraction, adu, over in zip(read_times(mode, len(reads)), reads, full, strict=True):
        stack.add(float(fraction), adu, over)
    return stack.result()


def test_single_and_double() -> None:
    reads = np.random.default_rng(0).uniform(900, 3000, (2, 5, 6))
    adu, lost, clipped = fed("single", reads[:1])
    assert np.array_equal(adu, reads[0])
    adu, lost, clipped = fed("cds", reads)
    assert adu == pytest.approx(np.clip(reads[1] - reads[0] + 1000, 0, None))
    assert not lost.any()
    assert np.array_equal(clipped, reads[1] - reads[0] < -1000)


@pytest.mark.parametrize("n", [2, 3, 8, 50])
def test_ramp_is_a_least_squares_fit(n) -> None:
    rng = np.random.default_rng(n)
    reads = 1000 + np.cumsum(rng.uniform(0, 100, (n, 4, 7)), axis=0)
    adu, lost, _ = fed("up_the_ramp", reads)
    slope = np.polyfit(np.linspace(0, 1, n), reads.reshape(n, -1), 1)[0].reshape(4, 7)
    assert adu == pytest.approx(slope + 1000, rel=1e-10)
    assert not lost.any()


def test_saturated_reads_are_left_out_of_the_ramp() -> None:
    rng = np.random.default_rng(1)
    reads = 1000 + np.cumsum(rng.uniform(0, 100, (8, 1, 8)), axis=0)
    full = np.zeros(reads.shape, dtype=bool)
    for pixel in range(8):
        full[pixel + 1 :, 0, pixel] = True  # pixel i has i + 1 good reads
    reads = np.where(full, 4e4, reads)
    adu, lost, _ = fed("up_the_ramp", reads, full)
    assert list(lost[0]) == [True] + [False] * 7
    assert adu[0, 0] == 65535
    for pixel in range(1, 8):
        slope = np.polyfit(np.linspace(0, 1, 8)[: pixel + 1], reads[: pixel + 1, 0, pixel], 1)[0]
        assert adu[0, pixel] == pytest.approx(slope + 1000, rel=1e-10)


def test_reads_above_the_converter_count_as_saturated() -> None:
    reads = np.array([0.0, 3e4, 6e4, 9e4, 12e4])[:, None, None] + 1000
    adu, lost, clipped = fed("up_the_ramp", reads)
    assert adu[0, 0] == 65535  # slope 120000 from the first three reads, beyond what 16 bits hold
    assert clipped.all()
    assert lost.all()
    late = np.array([0.0, 1e4, 2e4, 3e4, 9e4])[:, None, None] + 1000
    adu, lost, clipped = fed("up_the_ramp", late)
    assert adu[0, 0] == pytest.approx(1000 + 4e4)
    assert clipped.all()
    assert not lost.any()


@pytest.mark.parametrize("mode", ["single", "cds", "up_the_ramp"])
@pytest.mark.parametrize("top", [65535.0, 40000.0])
def test_more_light_is_never_less_cut_off(mode, top) -> None:
    """A pixel that the converter cannot follow at some light is counted at any brighter light."""
    charge = WELL * np.geomspace(0.01, 100.0, 200)[None, :]
    reads = 1 if mode == "single" else 2 if mode == "cds" else 8
    stack = ReadStack(mode, charge.shape, 1000.0, top)
    for fraction in read_times(mode, reads):
        held = fraction * charge
        stack.add(float(fraction), well_signal(held, WELL, 0.03) / 2.0 + 1000.0, held >= WELL)
    adu, lost, clipped = stack.result()
    assert (np.diff(clipped[0].astype(int)) >= 0).all()
    if mode == "up_the_ramp":
        assert clipped[0, -1]
        assert (adu[clipped] == top).all()
        assert lost[clipped].all()
