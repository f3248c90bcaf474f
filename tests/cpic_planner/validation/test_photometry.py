import math
import subprocess
import sys

import numpy as np
import pytest
from photutils.aperture import CircularAperture

from cpic_core import stream
from cpic_planner.validation import aperture_photometry, aperture_weights
from cpic_planner.validation.photometry import (
    kernel_at,
    outside_discs,
    ratio as over_noise,
    sample_scatter,
    sum_weights,
)
from simulator.detectors import excess_noise_factor2
from simulator.detectors.gain import multiply

SIDE, RADIUS = 97, 2.32


@pytest.fixture(scope="module")
def hole() -> np.ndarray:
    """Four square quadrants."""
    y, x = np.abs(np.indices((SIDE, SIDE)) - SIDE // 2)
    return (x >= 11) & (x <= 43) & (y >= 11) & (y <= 43)


def gaussian(x: float, y: float, sigma: float = 1.45) -> np.ndarray:
    rows, columns = np.indices((SIDE, SIDE))
    return np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * sigma**2)) / (2 * np.pi * sigma**2)


@pytest.mark.parametrize(
    ("x", "y", "radius"),
    [(5.3, 4.8, 2.32), (5.0, 4.0, 2.0), (5.5, 4.5, 0.3), (4.0, 4.0, 4.5), (3.0, 6.0, 0.5), (2.9, 4.1, 3.3999)],
)
def test_weights_are_those_of_photutils(x: float, y: float, radius: float) -> None:
    weights = aperture_weights((10, 12), x, y, radius)
    # It takes points closer than 1e-10 for the same.
    exact = CircularAperture((x, y), radius).to_mask(method="exact").to_image((10, 12))
    np.testing.assert_allclose(weights, exact, rtol=0, atol=2e-10)
    assert ((weights > 0) == (exact > 0)).all()
    assert weights.sum() == pytest.approx(math.pi * radius**2, rel=1e-13)


def test_weights_need_no_photutils() -> None:
    code = "import sys; from cpic_planner.validation import aperture_weights as w; w((9, 9), 4.1, 4.2, 2.3); "
    subprocess.run([sys.executable, "-c", code + "sys.exit('photutils' in sys.modules)"], check=True)


@pytest.mark.parametrize("phase", [(0.0, 0.0), (0.5, 0.3), (-0.4, 0.1)])
def test_scatter_of_white_noise_is_unbiased(phase: tuple[float, float], hole: np.ndarray) -> None:
    rng = np.random.default_rng(1)
    found = [sample_scatter(rng.normal(7.0, 3.0, hole.shape), hole, RADIUS, phase_pixel=phase) for _ in range(300)]
    variance = np.array([sigma for sigma, _ in found]) ** 2
    n = found[0][1]
    weights = aperture_weights((9, 9), 4 + phase[0], 4 + phase[1], RADIUS)
    truth = 9 * np.sum(weights**2)
    error = variance.std() / math.sqrt(len(variance))
    assert abs(variance.mean() - truth) < 4 * error
    # The quoted uncertainty, that of one grid of independent apertures, is an upper limit to the pooled one's.
    relative = np.sqrt(variance).std() / math.sqrt(truth)
    assert 0.5 / math.sqrt(2 * (n - 1)) < relative < 1.1 / math.sqrt(2 * (n - 1))


def test_scatter_is_that_of_sums_at_every_place(hole: np.ndarray) -> None:
    """Aperture by aperture, on grids about their own means."""
    image = np.random.default_rng(5).normal(40.0, 3.0, hole.shape)
    sigma, n = sample_scatter(image, hole, RADIUS, phase_pixel=(0.3, -0.2))
    y, x = np.nonzero(hole)
    first, pitch, grids = (y.min(), x.min()), math.ceil(2 * RADIUS), {}
    for row, column in zip(y, x, strict=True):
        weights = aperture_weights(image.shape, column + 0.3, row - 0.2, RADIUS)
        if hole[weights > 0].all():
            offset = (row - first[0]) % pitch, (column - first[1]) % pitch
            grids.setdefault(offset, []).append(float((weights * image).sum()))
    squares = sum(np.sum((np.array(part) - np.mean(part)) ** 2) for part in grids.values())
    assert sigma == pytest.approx(math.sqrt(squares / sum(len(part) - 1 for part in grids.values())), rel=1e-10)
    assert n == max(map(len, grids.values()))


@pytest.mark.parametrize("place", [(20.0, 31.5), (-0.5, 3.0), (-9.0, 20.0), (41.2, 38.8), (60.0, 60.0)])
def test_discs_are_taken_out_also_at_and_beyond_the_edges(place: tuple[float, float]) -> None:
    y, x = np.indices((40, 43))
    region = (x + y) % 3 > 0
    kept = outside_discs(region, [place, (5.0, 5.0)], 6.3)
    expected = region & (np.hypot(x - place[0], y - place[1]) > 6.3) & (np.hypot(x - 5.0, y - 5.0) > 6.3)
    np.testing.assert_array_equal(kept, expected)
    assert region[5, 5] == ((5 + 5) % 3 > 0)


def test_sample_count_is_the_packing_of_squares(refused, hole: np.ndarray) -> None:
    # 33 px quadrants, pitch 5 px: six apertures of 5 px a side and a seventh where the circle's box allows.
    _, n = sample_scatter(np.random.default_rng(0).normal(size=hole.shape), hole, 2.32)
    assert 4 * 6**2 <= n <= 4 * 7**2
    refused("room for at least 3", sample_scatter, np.zeros(hole.shape), hole, 17.0)
    refused("background_region", sample_scatter, np.zeros(hole.shape), hole, 60.0)


def test_correlated_speckles_count_in_full(hole: np.ndarray) -> None:
    """Speckles the size of the aperture: pixel scatter times sqrt(pixels) understates the noise severalfold."""
    from scipy.ndimage import gaussian_filter

    rng = np.random.default_rng(2)
    results = []
    truth = []
    for _ in range(150):
        image = gaussian_filter(rng.normal(size=hole.shape), 1.45)
        results.append(aperture_photometry(image, 74.3, 20.8, RADIUS, background_region=hole))
        truth.append(results[-1].raw_flux)
    sigma = np.mean([r.sigma_background for r in results])
    assert np.std(truth) == pytest.approx(sigma, rel=4 / math.sqrt(300))
    naive = math.sqrt(results[0].aperture_area_pixels) * np.std(image[hole])
    assert sigma > 2.5 * naive


@pytest.mark.parametrize("n", [300, pytest.param(1500, marks=pytest.mark.long)])
def test_noise_only_pulls_have_unit_width(n: int, hole: np.ndarray) -> None:
    rng = np.random.default_rng(4)
    pulls = np.array(
        [
            aperture_photometry(rng.normal(50.0, 3.0, hole.shape), *place, RADIUS, background_region=hole).significance
            for place in np.column_stack([rng.uniform(63, 87, n), rng.uniform(14, 32, n)])
        ]
    )
    assert abs(pulls.mean()) < 4 / math.sqrt(len(pulls))
    assert pulls.std() == pytest.approx(1, abs=4 / math.sqrt(2 * len(pulls)) + 0.004)


@pytest.mark.parametrize(
    ("gain", "flux", "n"),
    [
        (300.0, 400.0, 150),
        pytest.param(300.0, 400.0, 1000, marks=pytest.mark.long),
        pytest.param(1.0, 3000.0, 1000, marks=pytest.mark.long),
    ],
)
def test_planet_flux_is_unbiased_and_its_error_true(gain: float, flux: float, n: int, hole: np.ndarray) -> None:
    """A planet through the real register, on a photon background: the pull of the flux has mean 0 and width 1."""
    rng = stream(5, "planet", int(gain))
    pulls, fluxes, snrs, errors = [], [], [], []
    factor2 = float(excess_noise_factor2(gain))
    for x, y in rng.uniform(16, 32, (n, 2)):
        planet = gaussian(x, y)
        weights = aperture_weights(planet.shape, x, y, RADIUS)
        image = multiply(rng.poisson(20.0 + flux * planet), gain, rng=rng) / gain
        measured = aperture_photometry(image, x, y, RADIUS, background_region=hole, em_gain=gain)
        truth = flux * np.sum(planet * weights)
        pulls.append((measured.flux - truth) / measured.error)
        fluxes.append(measured.flux / truth)
        snrs.append(measured.snr)
        errors.append(measured.error)
    assert abs(np.mean(fluxes) - 1) < 4 * np.std(fluxes) / math.sqrt(n)
    # An error that grows with the measured flux skews the pull by -(F^2 / 2) / error; it is not a bias of the flux.
    skew = 0.5 * factor2 / np.mean(errors)
    assert abs(np.mean(pulls) + skew) < 5 / math.sqrt(n)
    assert np.std(pulls) == pytest.approx(1, abs=4 / math.sqrt(2 * n))
    assert np.mean(snrs) == pytest.approx(np.mean(fluxes) * truth / np.mean(errors), rel=0.05)


def test_a_given_throughput_is_divided_out(hole: np.ndarray) -> None:
    image = np.random.default_rng(5).normal(10, 2, hole.shape) + 500 * gaussian(25, 24)
    plain = aperture_photometry(image, 25, 24, RADIUS, background_region=hole, em_gain=20.0)
    half = aperture_photometry(image, 25, 24, RADIUS, background_region=hole, em_gain=20.0, throughput=0.5)
    assert half.flux == pytest.approx(2 * plain.flux)
    assert half.error == pytest.approx(2 * plain.error)
    assert half.raw_flux == plain.raw_flux
    assert half.snr == plain.snr
    assert half.significance == plain.significance
    assert plain.significance > plain.snr


def test_terms_of_the_error_by_hand(hole: np.ndarray) -> None:
    image = np.random.default_rng(6).normal(10, 2, hole.shape) + 500 * gaussian(25.2, 24.4)
    got = aperture_photometry(image, 25.2, 24.4, RADIUS, background_region=hole, em_gain=20.0)
    rows, columns = np.indices(hole.shape)
    region = hole & (np.hypot(columns - 25.2, rows - 24.4) > 1.5 * RADIUS)
    area, weights = math.pi * RADIUS**2, aperture_weights(image.shape, 25.2, 24.4, RADIUS)
    level = image[region].mean()
    assert got.background_area_pixels == region.sum()
    assert got.raw_flux == pytest.approx(np.sum(weights * image) - area * level)
    own = float(excess_noise_factor2(20.0)) * np.sum(weights**2 * (image - level))
    spread = got.sigma_background**2 * (1 + area / region.sum())
    assert got.error == pytest.approx(math.sqrt(own + spread))
    assert got.significance == pytest.approx(got.raw_flux / got.sigma_background)
    paper = got.raw_flux + np.var(image[region], ddof=1) * area * (1 + area / region.sum())
    assert got.flux_paper_error == pytest.approx(math.sqrt(paper))
    assert got.snr_paper == pytest.approx(got.raw_flux / math.sqrt(paper))
    assert got.error_rel_uncertainty == pytest.approx(1 / math.sqrt(2 * (got.n_background_apertures - 1)))


def test_known_sources_stay_out_of_the_background(hole: np.ndarray) -> None:
    image = np.random.default_rng(7).normal(10, 2, hole.shape)
    other = image + 1e5 * gaussian(70, 70, 0.7)
    clean = aperture_photometry(image, 25, 24, RADIUS, background_region=hole, exclude=[(70, 70)])
    masked = aperture_photometry(other, 25, 24, RADIUS, background_region=hole, exclude=[(70, 70)])
    spoiled = aperture_photometry(other, 25, 24, RADIUS, background_region=hole)
    assert masked.sigma_background == pytest.approx(clean.sigma_background, rel=0.01)
    assert spoiled.sigma_background > 10 * clean.sigma_background


def test_a_strong_planet_does_not_raise_its_own_background(hole: np.ndarray) -> None:
    image = np.random.default_rng(8).normal(10, 2, hole.shape)
    faint = aperture_photometry(image, 25, 24, RADIUS, background_region=hole)
    bright = aperture_photometry(image + 5e3 * gaussian(25, 24, 0.8), 25, 24, RADIUS, background_region=hole)
    assert bright.sigma_background == pytest.approx(faint.sigma_background, rel=0.01)


def test_light_that_modes_spread_is_no_noise(hole: np.ndarray) -> None:
    """The scatter is that of the image without the planet, however bright it is, and its flux stays what it was."""
    y, x = np.indices((SIDE, SIDE))
    near = hole & (np.hypot(x - 25, y - 24) < 12) & (x < 48) & (y < 48)
    rng = np.random.default_rng(4)
    modes = np.linalg.qr(np.array([gaussian(*rng.uniform(14, 36, 2), 3.0)[near] for _ in range(12)]).T)[0]
    planet = gaussian(25, 24)
    left = np.where(near, planet, 0.0)
    left[near] -= modes @ (modes.T @ planet[near])
    noise = np.where(near, rng.normal(0.0, 3.0, hole.shape), 0.0)
    nothing = aperture_photometry(noise, 25, 24, RADIUS, background_region=near)
    for flux in (1e3, 1e5):
        image = noise + flux * left
        spoiled = aperture_photometry(image, 25, 24, RADIUS, background_region=near)
        # The scale of the model does not matter.
        mended = aperture_photometry(image, 25, 24, RADIUS, background_region=near, left=7.0 * left)
        assert mended.flux == spoiled.flux
        assert mended.sigma_background == pytest.approx(nothing.sigma_background, rel=0.02)
        if flux == 1e5:
            assert spoiled.sigma_background > 10.0 * nothing.sigma_background


def test_without_noise_there_is_no_nan(hole: np.ndarray) -> None:
    nothing = aperture_photometry(np.zeros(hole.shape), 25, 24, RADIUS, background_region=hole)
    assert (nothing.flux, nothing.snr, nothing.significance, nothing.snr_paper) == (0, 0, 0, 0)
    image = np.zeros(hole.shape)
    image[24, 25] = 100.0
    planet = aperture_photometry(image, 25, 24, RADIUS, background_region=hole)
    assert planet.flux == pytest.approx(100)
    assert planet.significance == math.inf
    assert planet.snr == pytest.approx(10)
    hollow = aperture_photometry(-image, 25, 24, RADIUS, background_region=hole)
    assert (hollow.snr, hollow.significance, hollow.snr_paper) == (-math.inf, -math.inf, -math.inf)


@pytest.mark.parametrize(("x", "y"), [(25, 24), (30, 66)])
def test_background_pixels_lie_farther_than_three_halves_of_the_radius(x: int, y: int) -> None:
    """Counted one by one in an image wider than high, with pixels that lie exactly on the circle."""
    wide = np.zeros((90, 120), dtype=bool)
    wide[5:85, 5:115] = True
    image = np.random.default_rng(10).normal(10, 2, wide.shape)
    own, other = (x, y), (100, 40)
    far = [
        (row, column)
        for row in range(5, 85)
        for column in range(5, 115)
        if all((column - u) ** 2 + (row - v) ** 2 > 9 for u, v in (own, other))
    ]
    found = aperture_photometry(image, x, y, 2.0, background_region=wide, exclude=[other])
    assert found.background_area_pixels == len(far) == 80 * 110 - 2 * 29
    assert found.background_per_pixel == pytest.approx(np.mean([image[place] for place in far]), rel=1e-13)


def test_a_dip_has_no_noise_of_its_own(hole: np.ndarray) -> None:
    """Fewer electrons than the background have the background's noise, in whatever unit."""
    dark = np.random.default_rng(11).normal(10, 2, hole.shape) - 300 * gaussian(25, 24)
    for unit in (1e-6, 1.0, 1e6):
        got = aperture_photometry(unit * dark, 25, 24, RADIUS, background_region=hole)
        region = hole & (np.hypot(*(np.indices(hole.shape) - [[[24]], [[25]]])) > 1.5 * RADIUS)
        area = math.pi * RADIUS**2 * (1 + math.pi * RADIUS**2 / region.sum())
        spread = got.sigma_background * math.sqrt(area / (math.pi * RADIUS**2))
        assert got.raw_flux < -100 * unit
        assert got.error == pytest.approx(spread, rel=1e-12)
        assert got.snr == pytest.approx(got.raw_flux / spread, rel=1e-12)
        assert got.significance == pytest.approx(got.raw_flux / got.sigma_background, rel=1e-12)
        assert got.flux_paper_error == pytest.approx(np.std(unit * dark[region], ddof=1) * math.sqrt(area), rel=1e-12)


def test_ratio_for_any_noise() -> None:
    for noise in (5e-324, 1e-9, 0.5, 1.0, 1e300):
        assert over_noise(3 * noise, noise) == 3
    assert [over_noise(signal, 0.0) for signal in (2.0, -1e-300, 0.0)] == [math.inf, -math.inf, 0.0]


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"x_pixel": 1.0}, "x_pixel"),
        ({"y_pixel": np.nan}, "y_pixel"),
        ({"radius_pixel": 0.0}, "radius_pixel"),
        ({"radius_pixel": np.inf}, "radius_pixel"),
        ({"throughput": 0.0}, "throughput"),
        ({"throughput": np.nan}, "throughput"),
        ({"em_gain": 0.5}, "gain"),
        ({"exclude": [(np.nan, 1.0)]}, "exclude"),
        ({"exclude": [(1.0, 2.0, 3.0)]}, "exclude"),
        ({"background_region": np.ones((SIDE, SIDE))}, "background_region"),
        ({"background_region": np.zeros((SIDE, SIDE), dtype=bool)}, "background_region"),
        ({"image": np.ones(5)}, "image"),
        ({"image": np.full((SIDE, SIDE), np.nan)}, r"image\[y=0, x=0\]"),
    ],
)
def test_refusals(refused, values: dict[str, object], named: str, hole: np.ndarray) -> None:
    arguments = {
        "image": np.ones((SIDE, SIDE)),
        "x_pixel": 25.0,
        "y_pixel": 24.0,
        "radius_pixel": RADIUS,
        "background_region": hole,
    }
    refused(named, aperture_photometry, **{**arguments, **values})


def test_models_of_the_source_that_do_not_fit_are_refused(refused, hole: np.ndarray) -> None:
    setup = {"background_region": hole}
    refused("one image of", aperture_photometry, np.ones((SIDE, SIDE)), 25, 24, RADIUS, left=np.ones((3, 3)), **setup)
    nothing = np.zeros((SIDE, SIDE))
    refused("sum of left", aperture_photometry, np.ones((SIDE, SIDE)), 25, 24, RADIUS, left=nothing, **setup)


def test_a_hole_too_small_for_statistics_is_refused(refused) -> None:
    region = np.zeros((SIDE, SIDE), dtype=bool)
    region[20:26, 20:31] = True
    refused("room for at least 3", aperture_photometry, np.ones((SIDE, SIDE)), 60, 60, RADIUS, background_region=region)


def test_a_kernel_measures_as_the_sum_that_it_is(hole: np.ndarray) -> None:
    """With the weights of the circle the photometry of the circle; with the planet's image the best of white noise."""
    rng, (x, y) = np.random.default_rng(3), (70.3, 71.6)
    planet = 400.0 * gaussian(x, y)
    circle = kernel_at(aperture_weights((SIDE, SIDE), x, y, RADIUS), x, y, RADIUS + 1.0)
    matched = kernel_at(planet, x, y, 5.0)
    assert sum_weights((SIDE, SIDE), x, y, RADIUS, circle) == pytest.approx(
        aperture_weights((SIDE, SIDE), x, y, RADIUS), abs=1e-12
    )
    snr: dict[str, list[float]] = {"plain": [], "circle": [], "matched": []}
    for _ in range(40):
        image = planet + 5.0 * rng.standard_normal((SIDE, SIDE))
        for name, kernel in (("plain", None), ("circle", circle), ("matched", matched)):
            found = aperture_photometry(image, x, y, RADIUS, background_region=hole, kernel=kernel)
            snr[name].append(found.significance)
    assert snr["circle"] == pytest.approx(snr["plain"], rel=1e-2)
    # Of white noise the matched filter has the SNR of the root of the sum of squares.
    best = float(np.sqrt(np.sum(planet**2))) / 5.0
    assert np.mean(snr["matched"]) == pytest.approx(best, rel=0.04)
    assert np.mean(snr["matched"]) > 1.05 * np.mean(snr["plain"])
