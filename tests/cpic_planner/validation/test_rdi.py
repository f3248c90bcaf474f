"""Principal modes against a decomposition in extended precision."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from cpic_planner.validation import aperture_photometry, aperture_weights, rdi_subtract
from cpic_planner.validation.rdi import leading_modes, paying_modes, row_norm

CENTERINGS = ["none", "spatial", "temporal"]


def speckles(n: int, side: int = 40, seed: int = 1, drift: float = 0.1, level: float = 100.0) -> np.ndarray:
    """Photon-noisy frames of a static field with a few drifting modes; ``seed`` draws the frames, not the field."""
    field = np.random.default_rng(99)
    modes = field.standard_normal((6, side, side)) + 1j * field.standard_normal((6, side, side))
    kernel = np.exp(-0.5 * np.hypot(*np.mgrid[-5:6, -5:6]) ** 2 / 1.5**2)
    from scipy.signal import fftconvolve

    modes = np.stack([fftconvolve(mode, kernel, mode="same") for mode in modes])
    rng = np.random.default_rng(seed)
    weights = np.column_stack([np.ones(n), drift * rng.standard_normal((n, 5))])
    light = np.abs(np.einsum("nk,kyx->nyx", weights, modes)) ** 2
    return rng.poisson(level * light / np.mean(np.abs(modes[0]) ** 2)).astype(float)


def centred(science: np.ndarray, refs: np.ndarray, centering: str) -> tuple[np.ndarray, np.ndarray]:
    if centering == "spatial":
        return science - science.mean(1, keepdims=True), refs - refs.mean(1, keepdims=True)
    if centering == "temporal":
        return science - refs.mean(0), refs - refs.mean(0)
    return science, refs


def by_svd(science: np.ndarray, refs: np.ndarray, k: int) -> np.ndarray:
    _, _, vt = np.linalg.svd(refs, full_matrices=False)
    return science - (science @ vt[:k].T) @ vt[:k]


def by_klip(science: np.ndarray, refs: np.ndarray, k: int) -> np.ndarray:
    """Soummer et al. 2012: Karhunen-Loeve images from the covariance of the references, frame by frame."""
    covariance = np.cov(refs, bias=False) * (refs.shape[1] - 1)
    values, vectors = np.linalg.eigh(covariance)
    out = []
    for frame in science:
        estimate = np.zeros_like(frame)
        for j in range(1, k + 1):
            image = (vectors[:, -j] @ refs) / np.sqrt(values[-j])
            estimate += (frame @ image) * image
        out.append(frame - estimate)
    return np.array(out)


@pytest.fixture(scope="module")
def region() -> np.ndarray:
    y, x = np.indices((40, 40)) - 20
    return (np.hypot(x, y) > 5) & (np.hypot(x, y) < 19)


@pytest.mark.parametrize("centering", CENTERINGS)
@pytest.mark.parametrize("k", [0, 1, 5, 10, 19])
def test_against_direct_svd(centering: str, k: int, region: np.ndarray) -> None:
    science, refs = speckles(7, seed=2), speckles(20, seed=3)
    result = rdi_subtract(science, refs, k, region=region, centering=centering)
    expected = by_svd(*centred(science[:, region], refs[:, region], centering), k)
    assert np.abs(result.residuals[:, region] - expected).max() < 1e-10
    assert not result.residuals[:, ~region].any()
    assert result.modes_used == k
    assert not result.truncated
    assert np.abs(result.modes @ result.modes.T - np.eye(k)).max(initial=0) < 1e-13


@pytest.mark.parametrize("k", [1, 10, 19])
def test_spatial_centering_is_klip(k: int, region: np.ndarray) -> None:
    science, refs = speckles(3, seed=2), speckles(20, seed=3)
    result = rdi_subtract(science, refs, k, region=region)
    expected = by_klip(*centred(science[:, region], refs[:, region], "spatial"), k)
    assert result.residuals[:, region] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("k", [1, 5, 12, 20])
@pytest.mark.parametrize("pedestal", [0.0, 1e4])
def test_same_as_the_peer(k: int, pedestal: float, region: np.ndarray) -> None:
    """Where pyKLIP is installed: 20 modes of 20 frames are all there are."""
    klip = pytest.importorskip("pyklip.klip")
    science, refs = speckles(3, seed=2) + pedestal, speckles(20, seed=3) + pedestal
    result = rdi_subtract(science, refs, k, region=region)
    assert result.modes_used == k
    for frame, residual in zip(science, result.residuals, strict=True):
        expected = klip.klip_math(frame[region], refs[:, region], np.array([k]))[:, 0]
        assert np.abs(residual[region] - expected).max() < 1e-8 * np.abs(expected).max()


def test_all_modes_leave_the_least_squares_residual(region: np.ndarray) -> None:
    science, refs = speckles(3, seed=2)[:, region], speckles(12, seed=3)[:, region]
    shape = (1, region.sum())
    result = rdi_subtract(science.reshape(-1, *shape), refs.reshape(-1, *shape), 12, centering="none")
    solution, *_ = np.linalg.lstsq(refs.T, science.T, rcond=None)
    assert result.residuals[:, 0] == pytest.approx((science.T - refs.T @ solution).T, abs=1e-9)


def test_gram_eigenvalues(region: np.ndarray) -> None:
    refs = speckles(9, seed=3)
    result = rdi_subtract(refs, refs, 9, region=region, centering="none")
    rows = refs[:, region]
    expected = np.linalg.eigvalsh(rows @ rows.T)[::-1]
    assert result.eigenvalues == pytest.approx(expected, rel=1e-9)
    assert np.abs(result.residuals).max() < 1e-9


@pytest.mark.parametrize("exponent", [-150, -8, 8, 150])
def test_scale_does_not_matter(exponent: int, region: np.ndarray) -> None:
    science, refs = speckles(2, seed=2), speckles(6, seed=3)
    scale = 10.0**exponent
    plain = rdi_subtract(science, refs, 4, region=region).residuals
    scaled = rdi_subtract(science * scale, refs * scale, 4, region=region)
    assert scaled.modes_used == 4
    assert scaled.residuals / scale == pytest.approx(plain, abs=1e-9)


@pytest.mark.parametrize("centering", CENTERINGS)
def test_one_frame_in_one_frame_out(centering: str) -> None:
    science, refs = speckles(2, seed=2), speckles(6, seed=3)
    many = rdi_subtract(science, refs, 3, centering=centering).residuals
    one = rdi_subtract(science[1], refs, 3, centering=centering).residuals
    assert one.shape == (40, 40)
    assert one == pytest.approx(many[1], abs=1e-10)


DEGENERATE = {
    "zero": (np.zeros((4, 40, 40)), {"none": 0, "spatial": 0, "temporal": 0}),
    "constant": (np.full((4, 40, 40), 100.1), {"none": 1, "spatial": 0, "temporal": 0}),
    "constants": (
        np.full((4, 40, 40), 1 / 3) * np.arange(1, 5)[:, None, None],
        {"none": 1, "spatial": 0, "temporal": 1},
    ),
    "duplicates": (np.repeat(speckles(1, seed=3), 5, axis=0), {"none": 1, "spatial": 1, "temporal": 0}),
    "twins": (np.repeat(speckles(3, seed=3), 2, axis=0), {"none": 3, "spatial": 3, "temporal": 2}),
    "single": (speckles(1, seed=3), {"none": 1, "spatial": 1, "temporal": 0}),
}


@pytest.mark.parametrize("centering", CENTERINGS)
@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_libraries(name: str, centering: str, region: np.ndarray) -> None:
    refs, ranks = DEGENERATE[name]
    result = rdi_subtract(speckles(2, seed=2), refs, 10, region=region, centering=centering)
    assert result.modes_used == ranks[centering]
    assert result.truncated
    assert np.isfinite(result.residuals).all()
    expected = by_svd(*centred(speckles(2, seed=2)[:, region], refs[:, region], centering), ranks[centering])
    assert result.residuals[:, region] == pytest.approx(expected, abs=1e-9)


def test_more_references_than_pixels() -> None:
    small = np.zeros((40, 40), dtype=bool)
    small[3, 4:9] = True
    result = rdi_subtract(speckles(2, seed=2), speckles(12, seed=3), 12, region=small, centering="none")
    assert result.modes_used == 5
    assert result.truncated
    assert np.abs(result.residuals).max() < 1e-9


@given(n=st.integers(1, 4), m=st.integers(1, 6), k=st.integers(0, 8), centering=st.sampled_from(CENTERINGS))
@settings(max_examples=40, deadline=None)
def test_projection_properties(n: int, m: int, k: int, centering: str) -> None:
    rng = np.random.default_rng(n + 10 * m + 100 * k)
    science, refs = rng.normal(size=(n, 6, 7)), rng.normal(size=(m, 6, 7))
    result = rdi_subtract(science, refs, k, centering=centering)
    rows = result.residuals.reshape(n, -1)
    assert np.abs(rows @ result.modes.T).max(initial=0) < 1e-12
    planet = rng.normal(size=(6, 7))
    shifted = rdi_subtract(science + planet, refs, k, centering=centering)
    assert shifted.residuals - result.residuals == pytest.approx(np.broadcast_to(result.project(planet), science.shape))


def test_pixels_outside_the_region_are_not_read(region: np.ndarray) -> None:
    science, refs = speckles(2, seed=2), speckles(6, seed=3)
    expected = rdi_subtract(science, refs, 3, region=region).residuals
    science[:, ~region], refs[:, ~region] = np.nan, np.inf
    assert np.array_equal(rdi_subtract(science, refs, 3, region=region).residuals, expected)


def test_inputs_are_not_changed_and_integers_are_welcome(region: np.ndarray) -> None:
    science, refs = speckles(2, seed=2).astype(np.uint16), speckles(6, seed=3).astype(np.uint16)
    before = science.copy(), refs.copy()
    for centering in CENTERINGS:
        rdi_subtract(science, refs, 3, region=region, centering=centering)
    assert np.array_equal(before[0], science)
    assert np.array_equal(before[1], refs)


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"n_modes": -1}, "n_modes"),
        ({"n_modes": 2.0}, "n_modes"),
        ({"n_modes": True}, "n_modes"),
        ({"centering": "median"}, "centering"),
        ({"references": np.ones((40, 40))}, "references"),
        ({"references": np.ones((0, 40, 40))}, "references"),
        ({"references": np.ones((3, 40, 41))}, "references"),
        ({"science": np.ones(40)}, "science"),
        ({"region": np.zeros((40, 40), dtype=bool)}, "region"),
        ({"region": np.ones((40, 40))}, "region"),
        ({"region": np.ones((3, 3), dtype=bool)}, "region"),
    ],
)
def test_refusals(refused, values: dict[str, object], named: str) -> None:
    arguments = {"science": speckles(2), "references": speckles(3), "n_modes": 1}
    refused(named, rdi_subtract, **{**arguments, **values})


def test_a_bad_pixel_is_named(refused, region: np.ndarray) -> None:
    science, refs = speckles(2), speckles(3)
    refs[2, 20, 30] = np.nan
    refused(r"references\[frame=2, y=20, x=30\]", rdi_subtract, science, refs, 1, region=region)


def gaussian(x: float, y: float, side: int = 40, sigma: float = 1.45) -> np.ndarray:
    rows, columns = np.indices((side, side))
    return np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * sigma**2)) / (2 * np.pi * sigma**2)


def test_throughput_definition(region: np.ndarray) -> None:
    refs = speckles(10, seed=3)
    planet = gaussian(31.3, 20.2)
    weights = aperture_weights(planet.shape, 31.3, 20.2, 2.3)
    background = region & (weights == 0)
    for centering in CENTERINGS:
        result = rdi_subtract(refs[0], refs, 5, region=region, centering=centering)
        with_planet = rdi_subtract(refs[0] + 1000 * planet, refs, 5, region=region, centering=centering)
        difference = (with_planet.residuals - result.residuals) / 1000
        expected = np.sum(difference * weights) / np.sum(planet * weights)
        assert result.throughput(planet, weights) == pytest.approx(expected, rel=1e-9)
        assert result.throughput(7 * planet, 3 * weights) == pytest.approx(expected, rel=1e-9)
        level = difference[background].mean() * weights.sum() / np.sum(planet * weights)
        measured = result.throughput(planet, weights, background=background)
        assert measured == pytest.approx(expected - level, rel=1e-9)
    nothing = rdi_subtract(refs[0], refs, 0, region=region, centering="none")
    assert nothing.throughput(planet, weights * region) == pytest.approx(1.0)


def test_throughput_refusals(refused, region: np.ndarray) -> None:
    result = rdi_subtract(speckles(1), speckles(3), 1, region=region)
    planet = gaussian(31, 20)
    refused("aperture", result.throughput, planet, np.ones(3))
    refused("template", result.throughput, np.zeros((40, 40)), np.ones((40, 40)))
    refused("template", result.project, np.ones((4, 4)))


@pytest.mark.parametrize(("k", "half"), [(5, 9), (20, 9), (20, 16)])
def test_noise_modes_take_the_fraction_k_over_p(k: int, half: int) -> None:
    """Modes of pure noise are random directions: each takes 1/P of the planet's light."""
    rng = np.random.default_rng(k + half)
    y, x = np.indices((40, 40)) - 20
    patch = (np.abs(x) <= half) & (np.abs(y) <= half)
    planet = gaussian(20.3, 20.1)
    weights = aperture_weights(planet.shape, 20.3, 20.1, 2.3)
    blank = np.zeros((40, 40))
    throughput = [
        rdi_subtract(blank, rng.normal(size=(k, 40, 40)), k, region=patch, centering="none").throughput(planet, weights)
        for _ in range(150)
    ]
    expected = 1 - k / patch.sum()
    error = np.std(throughput) / np.sqrt(len(throughput))
    assert abs(np.mean(throughput) - expected) < 4 * error
    assert error < 0.15 * k / patch.sum()


def hole_parts() -> dict[int, np.ndarray]:
    """Regions of a 137 px stamp at 520 nm: the annulus of 4 to 15 lambda/D, a quadrant of it, and a patch."""
    y, x = np.indices((137, 137)) - 68
    radius = np.hypot(x, y)
    annulus = (radius > 4 * 3.32) & (radius < 15 * 3.32)
    patch = (np.abs(x - 20) <= 10) & (np.abs(y - 20) <= 10)
    return {7240: annulus, 1774: annulus & (x > 0) & (y > 0), 455: patch}


@pytest.mark.parametrize("pixels", [7240, 1774, 455])
def test_thirty_modes_of_noise_in_regions_of_the_instrument(pixels: int) -> None:
    """Raw loss k/P within 30 %, the corrected flux within 0.01, whatever the size of the region."""
    region = hole_parts()[pixels]
    assert region.sum() == pytest.approx(pixels, rel=0.05)
    planet, k, rng = gaussian(88.3, 88.1, 137), 30, np.random.default_rng(pixels)
    weights = aperture_weights(planet.shape, 88.3, 88.1, 2.3)
    raw, corrected = [], []
    for _ in range(60):
        refs = np.zeros((k, 137, 137))
        refs[:, region] = rng.normal(size=(k, int(region.sum())))
        cut = rdi_subtract(1000.0 * planet, refs, k, region=region, centering="none")
        raw.append(float(np.sum(cut.residuals * weights) / np.sum(1000.0 * planet * weights)))
        corrected.append(raw[-1] / cut.throughput(planet, weights))
    assert 1.0 - np.mean(raw) == pytest.approx(k / region.sum(), rel=0.3)
    assert corrected == pytest.approx(np.ones(60), abs=1e-9)


def test_corrected_flux_is_unbiased_raw_flux_is_not() -> None:
    """Injection into drifting speckles: what 30 modes on a small patch take from the planet is given back.

    The loss exceeds k/P here, since the noise modes live where the speckles, and so their noise, are bright.
    """
    y, x = np.indices((40, 40)) - 20
    patch = (np.abs(x) <= 10) & (np.abs(y) <= 10)
    planet = gaussian(22.4, 19.7)
    weights = aperture_weights(planet.shape, 22.4, 19.7, 2.3)
    flux, core = 40.0, float(np.sum(planet * weights))
    raw, corrected = [], []
    for trial in range(60):
        frames = speckles(60, seed=1000 + trial)
        science, refs = frames[:30], frames[30:]
        noise = np.random.default_rng(trial).poisson(flux * planet, science.shape)
        with_planet = rdi_subtract(science + noise, refs, 30, region=patch, centering="none")
        without = rdi_subtract(science, refs, 30, region=patch, centering="none")
        # The planet's own response, free of the speckle noise common to both.
        difference = with_planet.residuals - without.residuals
        measured = float(np.sum(difference * weights)) / (30 * flux * core)
        raw.append(measured)
        corrected.append(measured / with_planet.throughput(planet, weights))
    error = np.std(corrected) / np.sqrt(len(corrected))
    assert abs(np.mean(corrected) - 1) < 4 * error
    assert error < 0.01
    assert 1 - np.mean(raw) > 0.9 * 30 / patch.sum()


@pytest.mark.parametrize("trials", [100, pytest.param(500, marks=pytest.mark.long)])
@pytest.mark.parametrize("centering", CENTERINGS)
def test_planet_through_subtraction_and_photometry(centering: str, trials: int) -> None:
    """Blind chain on a static speckle field with white noise: flux unbiased, pulls of unit width."""
    side, frames = 48, 6
    rng = np.random.default_rng(7)
    y, x = np.abs(np.indices((side, side)) - side // 2)
    hole = (x >= 4) & (y >= 4) & (x <= 22) & (y <= 22)
    field = 200 * np.exp(rng.normal(size=(side, side)))
    planet = gaussian(11.3, 35.8, side)
    weights = aperture_weights(planet.shape, 11.3, 35.8, 2.3)
    away = hole & (np.hypot(*(np.indices((side, side)) - np.array([35.8, 11.3])[:, None, None])) > 1.5 * 2.3)
    flux, core = 300.0, float(np.sum(planet * weights))
    fluxes, pulls = [], []
    for _ in range(trials):
        noise = rng.normal(0, 10, (2 * frames, side, side))
        cut = rdi_subtract(
            field + flux * planet + noise[:frames], field + noise[frames:], 3, region=hole, centering=centering
        )
        through = cut.throughput(planet, weights, background=away)
        image = cut.residuals.sum(axis=0)
        got = aperture_photometry(image, 11.3, 35.8, 2.3, background_region=hole, throughput=through)
        fluxes.append(got.flux / (frames * flux * core))
        # No photon noise in this scene: the scatter of the background is the whole error.
        pulls.append((got.flux - frames * flux * core) * through / got.sigma_background)
    assert abs(np.mean(fluxes) - 1) < 4 * np.std(fluxes) / np.sqrt(trials)
    assert np.std(fluxes) < 0.2
    assert np.std(pulls) == pytest.approx(1, abs=4 / np.sqrt(2 * trials) + 0.02)


M, P = 12, 300
SPECTRA = {
    "even": np.linspace(1.0, 0.5, M),
    "direct at its edge": np.geomspace(1.0, 0.031, M),
    "turned from its edge": np.geomspace(1.0, 0.029, M),
    "steep": np.geomspace(1.0, 1.1e-4, M),
    "below what the Gram matrix sees": np.geomspace(1.0, 1.2e-6, M),
    "one large, photon noise": np.r_[300.0, np.linspace(1.0, 0.5, M - 1)],
    "one large, hardly any noise": np.r_[1e5, np.linspace(1.0, 0.5, M - 1)],
    "wanted above 1e-4, the others below": np.r_[1.0, np.full(5, 1.1e-4) * np.linspace(1.2, 1.0, 5), np.full(6, 9e-7)],
    "rank 6": np.r_[np.linspace(1.0, 0.9, 6), np.full(6, 1e-9)],
}


def rows_with(spectrum: np.ndarray, seed: int = 3) -> np.ndarray:
    rng = np.random.default_rng(seed)
    left = np.linalg.qr(rng.normal(size=(M, M)))[0]
    right = np.linalg.qr(rng.normal(size=(P, M)))[0].T
    return 100.0 * (left * spectrum) @ right


def by_jacobi(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One-sided Jacobi rotations in extended precision: modes and singular values."""
    turned = rows.astype(np.longdouble)
    for _ in range(30):
        worst = 0.0
        for i in range(len(rows) - 1):
            for j in range(i + 1, len(rows)):
                a, b, c = turned[i] @ turned[i], turned[j] @ turned[j], turned[i] @ turned[j]
                if abs(c) < 1e-19 * np.sqrt(a * b):
                    continue
                worst = max(worst, float(abs(c) / np.sqrt(a * b)))
                zeta = (b - a) / (2 * c)
                tangent = (1 if zeta >= 0 else -1) / (abs(zeta) + np.sqrt(1 + zeta * zeta))
                cosine = 1 / np.sqrt(1 + tangent * tangent)
                turned[[i, j]] = (
                    cosine * (turned[i] - tangent * turned[j]),
                    cosine * (tangent * turned[i] + turned[j]),
                )
        if worst < 1e-18:
            break
    singular = np.sqrt((turned * turned).sum(axis=1))
    order = np.argsort(-singular)
    return turned[order] / singular[order][:, None], singular[order]


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="no extended precision on this platform")
@pytest.mark.parametrize("name", SPECTRA)
def test_residuals_are_exact_down_to_the_rank(name: str) -> None:
    rows = rows_with(SPECTRA[name])
    frames = np.random.default_rng(5).normal(size=(3, P))
    modes, singular = by_jacobi(rows)
    for count in (1, 3, 6, M):
        used = min(count, int((singular > 1e-6 * singular[0]).sum()))
        found, values = leading_modes(rows, count)
        assert len(found) == len(values) == used
        assert values == pytest.approx(singular[:used].astype(float), rel=1e-9)
        assert np.abs(found @ found.T - np.eye(used)).max() < 1e-9
        exact = frames.astype(np.longdouble) @ modes[:used].T @ modes[:used]
        error = (frames @ found.T @ found - exact).astype(float)
        assert np.abs(error).max() < 1e-10, count


def test_the_eigenvectors_alone_would_not_do() -> None:
    """What the rotation and the QR factorisation are for."""
    rows = rows_with(SPECTRA["one large, hardly any noise"])
    values, vectors = np.linalg.eigh(rows @ rows.T)
    plain = (vectors[:, ::-1] / np.sqrt(values[::-1])).T @ rows
    assert np.abs(plain @ plain.T - np.eye(M)).max() > 1e-8
    modes, _ = leading_modes(rows, M)
    assert np.abs(modes @ modes.T - np.eye(M)).max() < 1e-14


@pytest.mark.parametrize("exponent", [-290, -160, 160, 290])
def test_squares_neither_overflow_nor_vanish(exponent: int) -> None:
    rows = rows_with(SPECTRA["turned from its edge"])
    plain, values = leading_modes(rows, 5)
    modes, singular = leading_modes(rows * 10.0**exponent, 5)
    assert np.abs(np.abs(modes @ plain.T) - np.eye(5)).max() < 1e-12
    assert singular / 10.0**exponent == pytest.approx(values, rel=1e-12)
    assert row_norm(rows * 10.0**exponent) / 10.0**exponent == pytest.approx(np.linalg.norm(rows), rel=1e-12)


def test_nothing_in_nothing_out() -> None:
    for rows in (np.zeros((3, 7)), np.full((3, 7), 1e-14)):
        modes, singular = leading_modes(rows, 3, floor=1e-13)
        assert modes.shape == (0, 7)
        assert singular.shape == (0,)
    assert row_norm(np.zeros((3, 7))) == 0.0
    assert leading_modes(np.eye(3), 0)[0].shape == (0, 3)


def held_out(strong: float, visits: int = 60, most: int = 20) -> tuple[int, list[float]]:
    """Modes that pay where three patterns vary, ``strong`` times the white noise; and limits of new visits by hand."""
    side, rng = 41, np.random.default_rng(7)
    rows, columns = np.indices((side, side)) - side // 2
    region = (np.hypot(rows, columns) < 19) & (np.hypot(rows, columns) > 6)
    waves = np.stack([np.cos(0.6 * rows + k) * np.sin((0.5 + 0.1 * k) * columns) for k in range(3)])

    def drawn(number: int) -> np.ndarray:
        amounts = strong * rng.standard_normal((number, 3))
        return np.tensordot(amounts, waves, 1) + rng.standard_normal((number, side, side))

    place, radius = (side // 2 + 12.0, float(side // 2)), 2.3
    template = np.exp(-0.5 * ((columns - 12) ** 2 + rows**2) / 1.4**2)
    weights, kernel = aperture_weights((side, side), *place, radius), aperture_weights((7, 7), 3, 3, radius)
    samples = (np.hypot(rows, columns) < 16) & (np.hypot(rows, columns) > 9)
    references, science = drawn(visits), drawn(400)
    chosen = paying_modes(
        references, most, region=region, template=template, weights=weights, kernel=kernel, samples=samples
    )
    limits = []
    for k in (0, 3, most):
        cut = rdi_subtract(science, references, k, region=region, centering="temporal")
        sums = np.array([(image * weights).sum() for image in cut.residuals])
        limits.append(float(sums.std() / cut.throughput(template, weights)))
    return chosen, limits


def test_as_many_modes_are_taken_as_pay() -> None:
    chosen, (none, three, many) = held_out(3.0)
    assert 3 <= chosen <= 5
    assert three < 0.5 * none
    assert three < many
    assert held_out(0.0)[0] == 0
    assert held_out(3.0, visits=2)[0] == 0
    assert held_out(3.0, most=2)[0] == 2
