import numpy as np
import pytest

from catalogs.errors import InputError
from simulator.config import load_instrument
from simulator.config.optics import Drift
from simulator.imaging.aperture import aperture_sums, overlap_weights
from simulator.imaging.build import build_imager
from simulator.imaging.drift import visit_frames
from simulator.imaging.floor import measure_floor
from simulator.imaging.store import psf_metrics
from simulator.knobs import Knobs

INSTRUMENT = load_instrument()


@pytest.mark.parametrize("rms", [0.05, 0.5])
def test_floor_equals_exact_frames_of_visit_pairs(rms):
    """Full propagation, pair by pair, against the tabulated first-order floor."""
    imager = build_imager(INSTRUMENT, "F662")
    metrics = psf_metrics(INSTRUMENT, "F662")
    hole = metrics.hole
    weights = overlap_weights(metrics.aperture_radius_arcsec / metrics.pixel_scale_arcsec)
    offset = np.abs(np.arange(137) - 68) * metrics.pixel_scale_arcsec
    radius = metrics.aperture_radius_arcsec
    fits = (offset >= metrics.hole_inner_arcsec + radius) & (offset <= metrics.hole_outer_arcsec - radius)
    place = np.outer(fits, fits)
    drift = Drift(visit_nm=rms, walk_nm_per_sqrt_hour=0, psd_slope=2.5)
    images = [visit_frames(imager, drift, 1, 1.0, *(np.random.default_rng([k, 0]),) * 2)[0] for k in range(120)]
    squares = []
    for science, reference in zip(images, images[1:] + images[:1], strict=True):
        s, r = (image[hole] - image[hole].mean() for image in (science, reference))
        residual = np.zeros((137, 137))
        residual[hole] = s - r
        squares.append((aperture_sums(residual, weights)[place] ** 2).mean())
    error = np.std(squares) / np.mean(squares) / np.sqrt(len(squares)) / 2
    assert np.sqrt(np.mean(squares)) == pytest.approx(metrics.rdi_floor(rms), rel=4 * np.hypot(error, 0.02))


def test_floor_is_quadratic_for_large_and_linear_for_small_drift():
    imager = build_imager(INSTRUMENT, "F720", "quick")
    floor = measure_floor(imager, 2.5, n_visits=24, visit_nm=(0.005, 0.01, 5.0, 10.0))
    small, large = floor.sigma[0, 1] / floor.sigma[0, 0], floor.sigma[0, 3] / floor.sigma[0, 2]
    assert small == pytest.approx(2, rel=0.1)
    assert large == pytest.approx(4, rel=0.1)
    assert floor.sigma.shape == (1 + floor.separation_arcsec.size, 4)
    assert (np.diff(floor.separation_arcsec) > 0).all()


def test_narrow_and_empty_holes(refused):
    def floor_of(outer):
        # past the configuration's own check, which leaves room for an aperture
        narrow = INSTRUMENT.coronagraph.model_copy(update={"outer_half_side_arcsec": outer})
        instrument = INSTRUMENT.model_copy(update={"coronagraph": narrow})
        knobs = Knobs(pupil_samples=64, wavelength_nodes=1, pixel_nodes=1)
        return measure_floor(build_imager(instrument, "F520", knobs), 2.5, n_visits=4, visit_nm=(0.05, 0.1))

    assert np.isfinite(floor_of(0.2).sigma).all()  # narrower than the aperture
    with pytest.raises(InputError, match="inner_lambda_d"):
        floor_of(0.1655)  # between two pixel centres
    refused("hole edges", floor_of, 0.1)
