"""Point-spread functions, whole frames and dark holes: ours beside HCIPy's propagation of the same optics."""

import numpy as np
import pytest

from simulator.config import load_instrument
from simulator.imaging import build_imager, centred_axis, single_band_psf
from simulator.imaging.build import aberrations_of, bare_imager, configured_mirror, dig
from simulator.imaging.dark_hole import Conjugation, default_settings
from simulator.imaging.psf import forget_stamps, wide_on_axis
from simulator.imaging.scene_image import BandTransfer, PointSources, scene_image
from simulator.knobs import FIDELITIES

INSTRUMENT = load_instrument()
BANDS = INSTRUMENT.visible_bands()
IMAGER = build_imager(INSTRUMENT, "F520")
FRAME = 1081


def pairs(fidelity, engine="matrix"):
    forget_stamps()
    return [single_band_psf(band, fidelity=fidelity, instrument=INSTRUMENT, engine=engine) for band in BANDS]


@pytest.mark.parametrize("tier", FIDELITIES)
def test_stamps_of_four_bands(timed, tier):
    psfs = timed(f"stamps of four bands: {tier}", lambda: pairs(tier), rounds=5)
    assert all(psf.on_axis.shape == (137, 137) for psf in psfs)


def test_stamps_of_four_bands_by_hcipy(timed):
    theirs = timed("stamps of four bands: peer HCIPy", lambda: pairs("standard", "hcipy"), rounds=3)
    for ours, other in zip(pairs("standard"), theirs, strict=True):
        assert np.abs(ours.on_axis - other.on_axis).max() < 1e-12 * ours.off_axis.max()


def frame_of(engine):
    axis = IMAGER.stamp_axis(masked=True, n_pixels=FRAME)
    return IMAGER.image(axis, axis, engine=engine)


def test_star_over_a_frame(timed):
    image = timed("star over a frame", lambda: frame_of("matrix"), rounds=3)
    assert image.shape == (FRAME, FRAME)


def test_star_over_a_frame_by_hcipy(timed):
    theirs = timed("star over a frame: peer HCIPy", lambda: frame_of("hcipy"), rounds=1)
    assert np.abs(theirs - frame_of("matrix")).max() < 1e-12 * theirs.max()


def test_star_over_a_frame_with_pixels_in_closed_form(timed):
    pixel, half_width = IMAGER.pixel_scale_arcsec, IMAGER.mask_half_width_arcsec
    centres, star = centred_axis(FRAME, pixel), PointSources([0.0], [0.0], [1.0])
    image = timed(
        "star over a frame: closed form",
        lambda: scene_image(BandTransfer(IMAGER), centres, centres, pixel, star, mask_half_width_arcsec=half_width),
    )
    exact = frame_of("matrix")
    assert np.abs(image - exact).max() < 1e-4 * exact.max()  # its four nodes a pixel, four wavelengths


def test_star_over_a_frame_with_one_node_a_pixel(timed):
    middle = (FRAME // 2, FRAME // 2)
    image = timed(
        "star over a frame: one node a pixel", lambda: wide_on_axis("F520", INSTRUMENT, (FRAME, FRAME), middle)
    )
    assert image.sum() > 0


@pytest.mark.parametrize("band", BANDS)
@pytest.mark.parametrize(("mode", "preset"), [("4q", "cpic_default"), ("2q", "cpic_2q")])
def test_dark_hole(timed, mode, preset, band):
    instrument = load_instrument(preset)
    hole, _ = timed(f"dark hole {mode}, {band}", lambda: dig(instrument, band), rounds=1)
    assert hole.reached


def test_jacobian(timed):
    imager, aberrations = bare_imager(INSTRUMENT, "F662"), aberrations_of(INSTRUMENT)
    problem = Conjugation(
        imager,
        aberrations.upsampled(len(imager.transmission)),
        configured_mirror(INSTRUMENT),
        imager.zone,
        default_settings("4q"),
    )
    rest = np.zeros(problem.mirror.alive.shape)
    jacobian = timed("Jacobian", lambda: problem.jacobian(rest, 0))
    assert jacobian.shape[1] == rest.size


def test_one_propagation_by_hcipy(timed):
    """A Jacobian by finite differences takes one for each of the 1024 actuators."""
    imager, settings = build_imager(INSTRUMENT, "F662"), default_settings("4q")
    points = imager.zone.control_axes(
        settings.step_lambda_d * imager.lambda_d_arcsec, settings.margin_lambda_d * imager.lambda_d_arcsec
    )
    field = timed("one propagation: peer HCIPy", lambda: imager.field(0, *points, engine="hcipy"), repeats=10)
    assert field.shape == (points[0].size, points[1].size)
