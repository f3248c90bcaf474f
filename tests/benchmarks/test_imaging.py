"""Point-spread functions, whole frames and dark holes: ours beside HCIPy's propagation of the same optics.

``make bench`` prints the times and their ratios. There is no limit on the clock here: machines differ. Scenes and the
grid of 4 x 4 cells are in ``test_scene_image.py``; ``reports/imaging_speed`` has the figures of one machine.
"""

from collections.abc import Iterator

import numpy as np
import pytest

from simulator.config import load_instrument
from simulator.imaging.build import aberrations_of, bare_imager, build_imager, configured_mirror, dig
from simulator.imaging.conjugation import Conjugation
from simulator.imaging.dark_hole import DarkHole, default_settings
from simulator.imaging.imager import centred_axis
from simulator.imaging.psf import single_band_psf, wide_on_axis
from simulator.imaging.scene_image import PointSources, scene_image
from simulator.imaging.transfer import band_transfer
from simulator.knobs import FIDELITIES

INSTRUMENT = load_instrument()
BANDS = INSTRUMENT.visible_bands()
IMAGER = build_imager(INSTRUMENT, "F520")
FRAME = 1081
MEDIANS: dict[tuple[str, str], float] = {}


@pytest.fixture(scope="module", autouse=True)
def ratios(printed) -> Iterator[None]:
    yield
    with printed() as line:
        line("\nimages, median seconds and how many times longer than ours")
        for (job, name), seconds in MEDIANS.items():
            ours = MEDIANS.get((job, "ours"))
            ratio = f"{seconds / ours:8.1f} x" if ours and name != "ours" else ""
            line(f"  {job:44s} {name:36s} {seconds:9.4f} s {ratio}")


def timed(benchmark, job, name, function, *, rounds=3):
    """Run a job, once before it counts unless it is run a single time, and keep its median."""
    answer = benchmark.pedantic(function, rounds=rounds, warmup_rounds=int(rounds > 1))
    MEDIANS[job, name] = benchmark.stats.stats.median
    return answer


def pairs(fidelity, engine="matrix"):
    return [single_band_psf(band, fidelity=fidelity, instrument=INSTRUMENT, engine=engine) for band in BANDS]


@pytest.mark.parametrize("tier", FIDELITIES)
def test_stamps_of_four_bands(benchmark, tier):
    psfs = timed(benchmark, f"four bands, 137 px, {tier}", "ours", lambda: pairs(tier))
    assert all(psf.on_axis.shape == (137, 137) for psf in psfs)


def test_stamps_of_four_bands_by_hcipy(benchmark):
    theirs = timed(benchmark, "four bands, 137 px, standard", "HCIPy", lambda: pairs("standard", "hcipy"))
    for ours, other in zip(pairs("standard"), theirs, strict=True):
        assert np.abs(ours.on_axis - other.on_axis).max() < 1e-12 * ours.off_axis.max()


def frame_of(engine):
    axis = IMAGER.stamp_axis(masked=True, n_pixels=FRAME)
    return IMAGER.image(axis, axis, engine=engine)


def test_star_over_a_frame(benchmark):
    image = timed(benchmark, f"star, {FRAME} px, nodes of standard", "ours", lambda: frame_of("matrix"))
    assert image.shape == (FRAME, FRAME)


def test_star_over_a_frame_by_hcipy(benchmark):
    job = f"star, {FRAME} px, nodes of standard"
    theirs = timed(benchmark, job, "HCIPy", lambda: frame_of("hcipy"), rounds=1)
    assert np.abs(theirs - frame_of("matrix")).max() < 1e-12 * theirs.max()


def test_star_over_a_frame_with_pixels_in_closed_form(benchmark):
    pixel, half_width = IMAGER.pixel_scale_arcsec, IMAGER.mask_half_width_arcsec
    centres, star = centred_axis(FRAME, pixel), PointSources([0.0], [0.0], [1.0])
    image = timed(
        benchmark,
        f"star, {FRAME} px, nodes of standard",
        "ours, closed form",
        lambda: scene_image(band_transfer(IMAGER), centres, centres, pixel, star, mask_half_width_arcsec=half_width),
    )
    exact = frame_of("matrix")
    assert np.abs(image - exact).max() < 1e-4 * exact.max()  # its four nodes a pixel, four wavelengths


def test_star_over_a_frame_with_one_node_a_pixel(benchmark):
    middle = (FRAME // 2, FRAME // 2)
    image = timed(
        benchmark,
        f"star, {FRAME} px, nodes of standard",
        "ours, one node a pixel",
        lambda: wide_on_axis("F520", INSTRUMENT, (FRAME, FRAME), middle),
    )
    assert image.sum() > 0


@pytest.mark.parametrize("band", BANDS)
@pytest.mark.parametrize("preset", ["cpic_default", "cpic_2q"])
def test_dark_hole(benchmark, preset, band):
    instrument = load_instrument(preset)
    hole, _ = timed(benchmark, f"dark hole of {preset}, {band}", "ours", lambda: dig(instrument, band), rounds=1)
    assert isinstance(hole, DarkHole)


def problem_of(band):
    imager, aberrations = bare_imager(INSTRUMENT, band), aberrations_of(INSTRUMENT)
    return Conjugation(
        imager, INSTRUMENT.band(band).center_nm * 1e-9, aberrations.upsampled(len(imager.transmission)),
        configured_mirror(INSTRUMENT), imager.zone, default_settings("4q"),
    )  # fmt: skip


def test_jacobian(benchmark):
    problem = problem_of("F662")
    rest = np.zeros(problem.mirror.alive.shape)
    jacobian = timed(benchmark, "Jacobian, F662, one wavelength", "ours", lambda: problem.jacobian(rest, 0))
    assert jacobian.shape[1] == rest.size


def test_jacobian_by_finite_differences_of_hcipy(benchmark):
    imager, settings = build_imager(INSTRUMENT, "F662"), default_settings("4q")
    points = imager.zone.control_axes(
        settings.step_lambda_d * imager.lambda_d_arcsec, settings.margin_lambda_d * imager.lambda_d_arcsec
    )
    actuators = INSTRUMENT.mirror.n_actuators**2
    name = f"{actuators} x one propagation of HCIPy"
    field = timed(benchmark, "Jacobian, F662, one wavelength", name, lambda: imager.field(0, *points, engine="hcipy"))
    MEDIANS["Jacobian, F662, one wavelength", name] *= actuators
    assert field.shape == (points[0].size, points[1].size)
