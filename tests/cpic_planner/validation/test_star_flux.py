"""The star's rate from its frames off the mask and from a star in the field; and contrasts that refer to it."""

import dataclasses
import math

import numpy as np
import pytest

from cpic_core import InputError, Reason, Status
from cpic_planner.validation import (
    Photometry,
    aperture_photometry,
    aperture_weights,
    calibrated_frames,
    filled,
    observe_off_mask,
    rdi_subtract,
    reject_cosmic_rays,
    star_flux_off_mask,
)
from cpic_planner.validation.frames import transferred
from cpic_planner.validation.star_flux import off_mask_exposure_s
from reports.paper.paper_table1.measure import contrast_of, field_star_ratio, rate_by_field_star
from simulator import Observation, load_instrument, load_scene, observe
from simulator.camera import load_calibration_set

SCENE = "paper_science"


@pytest.mark.parametrize(("band", "n_seeds"), [pytest.param("F520", 40, marks=pytest.mark.long), ("F850", 20)])
def test_star_off_the_mask(band: str, n_seeds: int) -> None:
    """Unbiased, and scattered by its error, over many seeds with every effect on."""
    seen = observe_off_mask(SCENE, band, n_frames=4).unwrap()
    true = seen.truth.sources[0].rate_e_s
    found = [star_flux_off_mask(dataclasses.replace(seen, seed=seed)).unwrap() for seed in range(n_seeds)]
    pulls = np.array([(one.rate_e_s - true) / one.error_e_s for one in found])
    assert abs(pulls.mean()) < 4 / math.sqrt(pulls.size)
    assert abs(pulls.std(ddof=1) - 1.0) < 3.5 / math.sqrt(2 * pulls.size)
    assert found[0].error_e_s < 1e-3 * true
    assert found[0].method == "off_mask"


def test_other_places_and_gains_agree() -> None:
    """Where the star stands, in pixel and field, and at which gain, makes no difference beyond the error."""
    true = 0.0
    for offset, gain in (((0.36, 0.42), 1.0), ((-0.5, 0.371), 1.0), ((0.4, -0.4), 3.0)):
        seen = observe_off_mask(SCENE, "F720", n_frames=8, offset_arcsec=offset, em_gain=gain).unwrap()
        true = seen.truth.sources[0].rate_e_s
        star = star_flux_off_mask(seen).unwrap()
        assert abs(star.rate_e_s - true) < 4 * star.error_e_s + 1e-4 * true
    assert true > 1e8


@pytest.mark.long
def test_whole_frames_serve_too() -> None:
    seen = observe_off_mask(SCENE, "F850", n_frames=2, window="full").unwrap()
    star = star_flux_off_mask(seen).unwrap()
    assert abs(star.rate_e_s / seen.truth.sources[0].rate_e_s - 1.0) < 4 * star.error_e_s / star.rate_e_s


def test_a_star_far_from_the_mask_is_measured_alone() -> None:
    """Beyond the stamp about the mask, off the centre of a pixel; behind an arm of the cross it is refused."""
    seen = observe_off_mask(SCENE, "F662", n_frames=2, offset_arcsec=(2.003, -1.994), window="full").unwrap()
    star, true = star_flux_off_mask(seen).unwrap(), seen.truth.sources[0].rate_e_s
    assert abs(star.rate_e_s - true) < 4 * star.error_e_s + 1e-4 * true
    behind = observe_off_mask(SCENE, "F662", n_frames=1, exposure_s=0.01, offset_arcsec=(2.0, 0.1), window="full")
    with pytest.raises(InputError, match="off the mask"):
        star_flux_off_mask(behind.unwrap())


@pytest.mark.parametrize("pixels", [1, 2])
def test_a_dead_column_leaves_nothing_behind(pixels: int) -> None:
    """A star so far behind the column that is dead in this window, with ten times the losses of the register."""
    lossy = load_instrument({"detector": {"transfer": {"serial_cti": 1e-4}}})
    seen = observe_off_mask(SCENE, "F520", n_frames=1, instrument=lossy).unwrap()
    window = [slice(first, first + size) for first, size in zip(seen.first_pixel, seen.shape, strict=True)]
    maps = load_calibration_set(seen.instrument.detector).window(*window)
    (dead,) = np.flatnonzero(maps.bad_column.all(axis=0))
    x_arcsec = (dead + pixels - seen.shape[1] // 2) * seen.pixel_scale_arcsec
    beside = observe_off_mask(SCENE, "F520", n_frames=8, instrument=lossy, offset_arcsec=(x_arcsec, 0.45)).unwrap()
    star = star_flux_off_mask(beside).unwrap()
    assert abs(star.rate_e_s - beside.truth.sources[0].rate_e_s) < 4 * star.error_e_s
    assert star.error_e_s < 2e-3 * star.rate_e_s


def test_exposure_fills_but_does_not_saturate() -> None:
    detector = load_instrument().detector
    peak = 0.0105
    answer = off_mask_exposure_s(1e7, peak, detector)
    brightest = 1e7 * peak * answer.unwrap()
    assert brightest + 5 * math.sqrt(2 * brightest) == pytest.approx(0.7 * detector.full_well_e, rel=1e-9)
    assert off_mask_exposure_s(1e7, peak, detector, fill=0.35).unwrap() < 0.55 * answer.unwrap()
    assert off_mask_exposure_s(1e3, peak, detector).unwrap() == 10.0
    # At high gain register and converter bind before the pixel.
    high = 1e7 * peak * off_mask_exposure_s(1e7, peak, detector, em_gain=20.0).unwrap() * 20.0
    assert high < 0.7 * detector.register_full_well_e
    assert off_mask_exposure_s(7.07e8, peak, detector).flags == ("above_fill",)
    refused = off_mask_exposure_s(2e9, peak, detector)
    assert refused.status is Status.SATURATED
    assert refused.reason is Reason.PIXEL_FULL_WELL
    assert "shortest exposure" in refused.message
    for wrong in ({"rate_e_s": 0.0}, {"peak": math.nan}, {"fill": 1.5}, {"em_gain": 0.0}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            off_mask_exposure_s(**({"rate_e_s": 1e7, "peak": 0.01, "detector": detector} | wrong))


def test_a_near_infrared_star_beside_the_mask() -> None:
    """Farther from the wider arms of the cross; frames of two reads."""
    faint = load_scene(SCENE).model_dump(mode="json")
    faint["cstar"]["v_mag"] = 6.0
    seen = observe_off_mask(faint, "F1542", n_frames=20, fidelity="quick").unwrap()
    assert min(seen.star_offset_arcsec) > 0.6
    star = star_flux_off_mask(seen).unwrap()
    assert abs(star.rate_e_s / seen.truth.sources[0].rate_e_s - 1.0) < 4.0 * star.error_e_s / star.rate_e_s
    assert star.error_e_s < 3e-3 * star.rate_e_s


def test_saturated_series_is_refused() -> None:
    bright = load_scene(SCENE).model_dump(mode="json")
    bright["cstar"]["v_mag"] = -1.0
    answer = observe_off_mask(bright, "F520")
    assert answer.status is Status.SATURATED
    assert answer.reason is Reason.PIXEL_FULL_WELL
    seen = observe_off_mask(SCENE, "F520", exposure_s=0.05, n_frames=3).unwrap()
    star = star_flux_off_mask(seen)
    assert star.status is Status.SATURATED
    assert star.reason is Reason.PIXEL_FULL_WELL
    assert "of 3 frames" in star.message


def test_refusals(refused) -> None:
    hidden = observe(
        SCENE,
        band="F520",
        exposure_s=0.01,
        n_frames=2,
        window="hole",
        kind="CALS",
        role="calibration",
        star_offset_arcsec=(0.5, 0.0),
    )
    refused("star_offset_arcsec", star_flux_off_mask, hidden)


def test_ratio_of_one_spectral_type_is_that_of_magnitudes() -> None:
    ratio = field_star_ratio(SCENE, "F662", "calibration star", load_instrument())
    assert ratio == pytest.approx(10 ** (0.4 * (17.0 - 1.35)), rel=1e-9)


def still() -> object:
    """An instrument whose wavefront does not drift: what is left is noise."""
    instrument = load_instrument()
    drift = instrument.drift.model_copy(update={"visit_nm": 0.0, "walk_nm_per_sqrt_hour": 0.0})
    return instrument.model_copy(update={"drift": drift})


def reduced(seen: Observation) -> tuple[np.ndarray, np.ndarray]:
    """Frames without holes, and the pixels that have any."""
    frames, detector = calibrated_frames(seen), seen.instrument.detector
    found = reject_cosmic_rays(
        frames.electrons,
        frames.usable,
        em_gain=frames.em_gain,
        read_noise_e=detector.read_noise_e,
        pedestal_e=frames.pedestal_e,
        gain_e_adu=detector.gain_e_adu,
    )
    return filled(frames.electrons, frames.usable & ~found.rejected)


def measured(science: Observation, reference: Observation, number: int) -> tuple[Photometry, float]:
    """Photometry of a source after subtraction of the reference, and its core throughput."""
    (frames, covered), (library, also) = reduced(science), reduced(reference)
    metrics = science.psf.metrics
    region = metrics.hole & covered & also
    cut = rdi_subtract(frames, library, 2, region=region, centering="temporal")
    x, y = science.truth.x_pixel[number], science.truth.y_pixel[number]
    source = science.truth.sources[number]
    radius = metrics.aperture_radius_arcsec / metrics.pixel_scale_arcsec
    weights = aperture_weights(science.shape, x, y, radius)
    template = transferred(
        science.psf.at(source.x_arcsec, source.y_arcsec), science.instrument.detector, science.first_pixel
    )
    rows, columns = np.indices(science.shape)
    background = region.copy()
    for k in (1, 2):
        background &= np.hypot(columns - science.truth.x_pixel[k], rows - science.truth.y_pixel[k]) > 6 * radius
    throughput = cut.throughput(template, weights, background=background)
    flux = aperture_photometry(
        cut.residuals.sum(axis=0),
        x,
        y,
        radius,
        background_region=background,
        throughput=throughput,
        em_gain=science.em_gain,
    )
    return flux, float(np.sum(weights * template))


@pytest.mark.long
def test_contrast_end_to_end() -> None:
    """Raw frames with every effect, particles included, to contrasts by both ways: unbiased, with the right error."""
    instrument = still()
    settings = {
        "band": "F520",
        "exposure_s": 17.0,
        "n_frames": 12,
        "em_gain": 100.0,
        "window": "hole",
        "instrument": instrument,
    }
    science = observe(SCENE, role="science", **settings)
    reference = observe("paper_reference", role="reference", **settings)
    off_mask = observe_off_mask(SCENE, "F520", instrument=instrument, n_frames=8).unwrap()
    planet, field = science.truth.sources[1], science.truth.sources[2]
    ratio = field_star_ratio(SCENE, "F520", "calibration star", instrument)
    time = 12 * 17.0
    pulls: dict[str, list[float]] = {"planet": [], "field": [], "star": []}
    values = []
    for seed in range(8):
        shown, empty, beside = (dataclasses.replace(one, seed=seed) for one in (science, reference, off_mask))
        star = star_flux_off_mask(beside).unwrap()
        faint, core = measured(shown, empty, 1)
        got = contrast_of(faint, core, star.rate_e_s, time, star.error_e_s)
        pulls["planet"].append((got.value - planet.contrast) / got.error)
        bright, core = measured(shown, empty, 2)
        got = contrast_of(bright, core, star.rate_e_s, time, star.error_e_s)
        values.append(got.value * science.truth.sources[0].rate_e_s / field.rate_e_s)
        pulls["field"].append((values[-1] - 1.0) * got.value / got.error / values[-1])
        rate_e_s, error_e_s = rate_by_field_star(bright, core, time, ratio)
        pulls["star"].append((rate_e_s - star.rate_e_s) / error_e_s)
        assert error_e_s > star.error_e_s
    for name, own in pulls.items():
        assert abs(np.mean(own)) < 4 / math.sqrt(len(own)), name
        assert 0.4 < np.std(own, ddof=1) < 1.7, name
    assert abs(np.mean(values) - 1.0) < 0.02


def test_field_star_adds_the_error_of_its_magnitude() -> None:
    flux = Photometry(1000.0, 20.0, 50.0, 80.0, 900.0, 10.0, 50, 0.1, 0.0, 17.0, 800, 0.9, 30.0, 30.0)
    rate_e_s, error_e_s = rate_by_field_star(flux, 0.1, 100.0, 1e6, ratio_relative_error=0.03)
    assert rate_e_s == pytest.approx(1000.0 / 0.1 / 100.0 * 1e6)
    assert error_e_s / rate_e_s == pytest.approx(math.hypot(0.02, 0.03))


def test_one_wavefront_serves_the_whole_series() -> None:
    """The drift of the wavefront moves the light in the aperture by far less than its counts vary."""
    one, walked = (observe_off_mask(SCENE, "F850", n_frames=4, **more).unwrap() for more in ({}, {"max_epochs": 4}))
    assert (one.light.epochs, walked.light.epochs) == (1, 4)
    images = [seen.light.mean() for seen in (one, walked)]
    aperture = images[0] > 0.05 * images[0].max()
    assert images[0][aperture].sum() == pytest.approx(images[1][aperture].sum(), rel=2e-5)
