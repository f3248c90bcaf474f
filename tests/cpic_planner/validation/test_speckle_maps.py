"""Maps of speckle noise, against full propagations of drifting visits."""

import numpy as np
import pytest

from cpic_core import stream
from cpic_planner.validation.search import filter_kernel, matched_sum, speckle_maps
from simulator import single_band_psf
from simulator.config import Drift
from simulator.imaging import visit_frames
from simulator.knobs import Knobs

DRIFT = Drift(visit_nm=0.2, walk_nm_per_sqrt_hour=0.0, psd_slope=2.5)


@pytest.fixture(scope="module")
def psf():
    # As quick, in double precision: rounding of single precision is 2e-3 of the darkest pixels.
    return single_band_psf("F850", fidelity=Knobs(wavelength_nodes=1, pixel_nodes=2))


@pytest.fixture(scope="module")
def maps(psf):
    return speckle_maps(psf, DRIFT, n_visits=256)


def test_the_kernel_is_centred(psf):
    matched = filter_kernel(psf)
    assert matched.shape[0] % 2 == 1
    assert np.unravel_index(matched.argmax(), matched.shape) == (len(matched) // 2, len(matched) // 2)


def test_matched_sum_is_a_sum_of_products():
    rng = np.random.default_rng(0)
    image, kernel = rng.random((2, 9, 9)), rng.random((3, 3))
    assert matched_sum(image, kernel)[1, 4, 5] == pytest.approx(float(np.sum(image[1, 3:6, 4:7] * kernel)))


@pytest.mark.long
def test_variances_are_those_of_propagated_visits(psf, maps):
    frames = np.array([visit_frames(psf, DRIFT, 1, 1.0, stream(9, "v", k), stream(9, "w", k))[0] for k in range(256)])
    hole = psf.metrics.hole
    sums = matched_sum(np.where(hole, frames, 0.0), maps.kernel)[:, hole]
    spread = matched_sum(hole.astype(float), maps.kernel**2)[hole]
    seen = 2.0 * sums.var(axis=0, ddof=1) / spread
    stated = (maps.linear + maps.square)[hole]
    assert np.median(seen / stated) == pytest.approx(1.0, abs=0.1)
    assert np.corrcoef(np.log(seen), np.log(stated))[0, 1] > 0.9
    np.testing.assert_allclose(maps.nominal[hole], psf.on_axis[hole], rtol=1e-3)
    assert np.median(frames.mean(axis=0)[hole] / (maps.nominal + maps.stray)[hole]) == pytest.approx(1.0, abs=0.1)


def test_tails_lie_between_gaussian_and_laplace(maps):
    assert 0.1 < maps.tail_square < 1.2
    assert 0.1 < maps.tail_cross < 1.2


def test_no_drift_no_speckles(refused, psf):
    still = speckle_maps(psf, Drift(visit_nm=0.0, walk_nm_per_sqrt_hour=0.0, psd_slope=2.5), n_visits=32)
    assert still.n_visits == 0
    assert not still.linear.any()
    assert not still.square.any()
    refused("n_visits", speckle_maps, psf, DRIFT, n_visits=3)
