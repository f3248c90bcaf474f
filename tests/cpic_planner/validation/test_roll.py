"""Two rolls against injection into simulated frames, and the variance that the ETC takes for them."""

import functools

import numpy as np
import pytest

from cpic_core import InputError
from cpic_planner.validation import RollResult, aperture_weights, roll_photometry, roll_subtract
from cpic_planner.validation.photometry import kernel_at

SIDE, RADIUS, CENTRE = 40, 2.3, 20
_Y, _X = np.indices((SIDE, SIDE)) - CENTRE
REGION = (np.hypot(_X, _Y) > 4) & (np.hypot(_X, _Y) < 19)
CENTERINGS = ["temporal", "spatial", "none"]


@functools.cache
def static_field() -> np.ndarray:
    """A field of speckles and the modes by which it drifts."""
    field = np.random.default_rng(99)
    waves = field.standard_normal((6, SIDE, SIDE)) + 1j * field.standard_normal((6, SIDE, SIDE))
    frequency = np.hypot(np.fft.fftfreq(SIDE)[:, None], np.fft.fftfreq(SIDE))
    return np.fft.ifft2(np.fft.fft2(waves) * np.exp(-2.0 * (np.pi * 1.5 * frequency) ** 2))


@functools.cache
def speckles(n: int, seed: int, *, drift: float = 0.1) -> np.ndarray:
    """Photon-noisy frames of a static field with drifting modes; ``seed`` draws the frames, not the field."""
    waves, rng = static_field(), np.random.default_rng(seed)
    weights = np.column_stack([np.ones(n), drift * rng.standard_normal((n, 5))])
    light = np.abs(np.einsum("nk,kyx->nyx", weights, waves)) ** 2
    return rng.poisson(100.0 * light / np.mean(np.abs(waves[0]) ** 2)).astype(np.int32)


def places(roll_deg: float, separation: float = 12.3) -> list[tuple[float, float]]:
    """Half the roll to either side of the diagonal."""
    angle = np.deg2rad(45.0 + np.array([-0.5, 0.5]) * roll_deg)
    return [(CENTRE + separation * np.cos(a), CENTRE + separation * np.sin(a)) for a in angle]


def gaussian(place: tuple[float, float], sigma: float = 1.45) -> np.ndarray:
    rows, columns = np.indices((SIDE, SIDE))
    return np.exp(-((columns - place[0]) ** 2 + (rows - place[1]) ** 2) / (2 * sigma**2)) / (2 * np.pi * sigma**2)


def scene(roll_deg: float) -> tuple[list[tuple[float, float]], list[np.ndarray], list[np.ndarray]]:
    where = places(roll_deg)
    return where, [gaussian(p) for p in where], [aperture_weights((SIDE, SIDE), *p, RADIUS) for p in where]


def halves(seed: int, n: int = 20, *, drift: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    return speckles(n, 2 * seed + 1, drift=drift), speckles(n, 2 * seed + 2, drift=drift)


def injected(first: np.ndarray, second: np.ndarray, planets: list[np.ndarray], flux: float, **how) -> RollResult:
    return roll_subtract(first + flux * planets[0], second + flux * planets[1], region=REGION, **how)


@pytest.mark.parametrize("centering", CENTERINGS)
@pytest.mark.parametrize("modes", [0, 1, 5, 19])
def test_forward_model_is_the_derivative_of_the_subtraction(centering: str, modes: int) -> None:
    """Against central differences of the whole subtraction, modes and all, where the places overlap."""
    _, planets, _ = scene(15.0)
    first, second = halves(1)
    setup = {"n_modes": modes, "centering": centering}
    up, down = (injected(first, second, planets, sign * 0.02, **setup) for sign in (1, -1))
    model = roll_subtract(first, second, region=REGION, **setup).project(*planets)
    for i in range(2):
        derivative = (up.image_e[i] - down.image_e[i]) / (0.04 * len(first))
        assert np.abs(model[i] - derivative).max() < 1e-5 * np.abs(planets[i]).max()
        assert not model[i][~REGION].any()


def test_without_modes_the_planet_leaves_itself_and_its_negative() -> None:
    _, planets, _ = scene(60.0)
    first, second = halves(1)
    left = roll_subtract(first, second, 0, region=REGION).project(*planets)
    assert left[0] == pytest.approx(np.where(REGION, planets[0] - planets[1], 0.0), abs=1e-15)
    assert left[1] == pytest.approx(-left[0], abs=1e-15)


@pytest.mark.parametrize("centering", CENTERINGS)
@pytest.mark.parametrize("roll_deg", [10.0, 15.0, 30.0, 90.0])
def test_injected_flux_is_recovered(centering: str, roll_deg: float) -> None:
    """Without noise of their own (a difference of two reductions), planets of 2 to 20 sigma in a single frame.

    The roll of 10 deg moves the planet by less than its aperture, and more than half of its light is lost.
    """
    _, planets, weights = scene(roll_deg)
    for flux in (20.0, 100.0, 200.0):
        ratios, fractions = [], []
        for seed in range(5):
            first, second = halves(seed)
            seen = injected(first, second, planets, flux, n_modes=5, centering=centering)
            blank = injected(first, second, planets, 0.0, n_modes=5, centering=centering)
            through = seen.throughput(*planets, *weights)
            for i in range(2):
                left = np.sum((seen.image_e[i] - blank.image_e[i]) * weights[i]) / len(first)
                ratios.append(left / (flux * np.sum(planets[i] * weights[i]) * through[i]))
            fractions.extend(through)
        assert np.mean(ratios) == pytest.approx(1.0, abs=0.005)
        assert np.abs(np.array(ratios) - 1.0).max() < 0.02
        assert np.mean(fractions) < {10.0: 0.5, 15.0: 0.7, 30.0: 0.93, 90.0: 0.995}[roll_deg]


def test_the_planet_in_the_references_must_be_modelled() -> None:
    """As a reduction with a planet-free library sees it, a third of the planet would be missing."""
    _, planets, weights = scene(15.0)
    first, second = halves(3)
    seen = injected(first, second, planets, 100.0, n_modes=5)
    naive = seen.first.throughput(planets[0], weights[0])
    assert seen.throughput(*planets, *weights)[0] < 0.75 * naive


@pytest.mark.parametrize(
    ("centering", "roll_deg", "n_seeds"),
    [
        ("spatial", 15.0, 50),
        pytest.param("spatial", 15.0, 200, marks=pytest.mark.long),
        pytest.param("temporal", 15.0, 200, marks=pytest.mark.long),
        pytest.param("none", 40.0, 200, marks=pytest.mark.long),
    ],
)
def test_flux_of_noisy_sequences(centering: str, roll_deg: float, n_seeds: int) -> None:
    """Planet and speckles with their photon noise, a sequence of seeds: mean flux within 4 standard errors and 0.01."""
    where, planets, weights = scene(roll_deg)
    flux, n = 400.0, 10
    truth = flux * n * np.mean([np.sum(p * w) for p, w in zip(planets, weights, strict=True)])
    fluxes = []
    for seed in range(n_seeds):
        rng = np.random.default_rng(seed)
        first, second = (
            half + rng.poisson(flux * p, half.shape)
            for half, p in zip(halves(1000 + seed, n, drift=0.003), planets, strict=True)
        )
        cut = roll_subtract(first, second, 3, region=REGION, centering=centering)
        found = roll_photometry(cut, *planets, *where, RADIUS, background_region=REGION)
        assert found.flux == pytest.approx(found.raw_flux / found.throughput)
        fluxes.append(found.flux / truth)
    error = np.std(fluxes) / np.sqrt(len(fluxes))
    assert abs(np.mean(fluxes) - 1.0) < 4 * error
    fewer = np.sqrt(200 / n_seeds)
    assert abs(np.mean(fluxes) - 1.0) < 0.01 * fewer
    assert error < 0.006 * fewer


@pytest.mark.parametrize("roll_deg", [40.0, pytest.param(90.0, marks=pytest.mark.long)])
def test_half_the_variance_of_one_reference(roll_deg: float) -> None:
    """White noise: N frames of each roll against N science and N planet-free reference frames.

    The factor 1/2 is ``variance_factor`` of the ETC's library.
    """
    where, planets, weights = scene(roll_deg)
    rng = np.random.default_rng(11)
    rolls, single, quoted = [], [], []
    for _ in range(1500):
        first, second = rng.normal(100.0, 10.0, (2, 1, SIDE, SIDE))
        cut = roll_subtract(first, second, 0, region=REGION)
        through = cut.throughput(*planets, *weights)
        sums = [float(np.sum(image * w)) for image, w in zip(cut.image_e, weights, strict=True)]
        rolls.append(sum(sums) / sum(through))
        single.append(sums[0])
        if len(quoted) < 40:
            found = roll_photometry(cut, *planets, *where, RADIUS, background_region=REGION)
            quoted.append((found.sigma_background / found.throughput) ** 2)
    ratio = np.var(rolls) / np.var(single)
    # Two correlated sample variances of 1500: 1/2 +- 0.02.
    assert ratio == pytest.approx(0.5, abs=0.07)
    assert np.mean(quoted) == pytest.approx(np.var(rolls), rel=0.15)


@pytest.mark.parametrize("roll_deg", [pytest.param(10.0, marks=pytest.mark.long), 19.0])
def test_error_where_the_apertures_overlap(roll_deg: float) -> None:
    """The shared pixels cancel in signal and noise."""
    where, planets, weights = scene(roll_deg)
    rng = np.random.default_rng(12)
    measured, quoted = [], []
    for _ in range(1200):
        first, second = rng.normal(100.0, 10.0, (2, 1, SIDE, SIDE))
        cut = roll_subtract(first, second, 0, region=REGION)
        measured.append(np.mean([np.sum(i * w) for i, w in zip(cut.image_e, weights, strict=True)]))
        if len(quoted) < 60:
            quoted.append(
                roll_photometry(cut, *planets, *where, RADIUS, background_region=REGION).sigma_background ** 2
            )
    assert np.sum(weights[0] * weights[1]) > 0
    assert np.mean(quoted) == pytest.approx(np.var(measured), rel=0.15)


@pytest.mark.parametrize("kernels", [None, "matched"])
@pytest.mark.parametrize("n_modes", [0, 12])
def test_wings_and_light_that_modes_spread_are_no_noise(n_modes: int, kernels: str | None) -> None:
    """The scatter of the background is the same with and without a bright planet."""
    where, planets, _ = scene(60.0)
    if kernels is not None:
        kernels = tuple(kernel_at(image, *place, RADIUS) for image, place in zip(planets, where, strict=True))
    first, second = halves(5)
    found = [
        roll_photometry(
            injected(first, second, planets, flux, n_modes=n_modes),
            *planets,
            *where,
            RADIUS,
            background_region=REGION,
            kernels=kernels,
        )
        for flux in (0.0, 1e4)
    ]
    assert found[1].sigma_background == pytest.approx(found[0].sigma_background, rel=1e-6)


@pytest.mark.parametrize("centering", CENTERINGS)
def test_sums_of_unequal_numbers_of_frames(centering: str) -> None:
    """Sums of 1 to 4 frames have unequal light; per frame, the planet is the same in all of them."""
    _, planets, weights = scene(15.0)
    counts, flux = np.array([4, 1, 3, 2]), 20.0
    first, second = (
        np.stack([part.sum(axis=0) for part in np.split(half, np.cumsum(counts)[:-1])]) for half in halves(7, 10)
    )
    shares = counts[:, None, None]
    setup = {"region": REGION, "centering": centering, "first_frames": counts, "second_frames": counts}
    seen = roll_subtract(first + flux * shares * planets[0], second + flux * shares * planets[1], 2, **setup)
    blank = roll_subtract(first, second, 2, **setup)
    through = seen.throughput(*planets, *weights)
    for i in range(2):
        left = np.sum((seen.image_e[i] - blank.image_e[i]) * weights[i])
        assert left == pytest.approx(10 * flux * np.sum(planets[i] * weights[i]) * through[i], rel=0.005)
    same = roll_subtract(first / shares, second / shares, 2, region=REGION, centering=centering)
    assert blank.first.residuals == pytest.approx(same.first.residuals, abs=1e-9)
    assert blank.image_e[0] == pytest.approx(np.tensordot(counts, same.first.residuals, 1), abs=1e-9)


@pytest.mark.parametrize("centering", CENTERINGS)
def test_any_library_stays_finite(centering: str) -> None:
    _, planets, weights = scene(30.0)
    for first in (np.zeros((3, SIDE, SIDE)), np.ones((1, SIDE, SIDE)), np.repeat(speckles(1, 3), 4, axis=0)):
        cut = roll_subtract(first, first, 10, region=REGION, centering=centering)
        assert all(np.isfinite(image).all() for image in (*cut.image_e, *cut.project(*planets)))
        assert np.isfinite(cut.throughput(*planets, *weights)).all()


def test_refusals(refused) -> None:
    first, second = halves(1, 3)
    _, planets, weights = scene(30.0)
    refused("second_e", roll_subtract, first, second[:2], 1)
    refused("second_e", roll_subtract, first[0], second[0], 1)
    for wrong in (0, [1, 2], np.nan):
        refused("first_frames", roll_subtract, first, second, 1, first_frames=wrong)
    refused("second_frames = 6", roll_subtract, first, second, 1, second_frames=2)
    cut = roll_subtract(first, second, 1, region=REGION)
    refused("second_template", cut.project, planets[0], planets[1][:3])
    refused("first_template", cut.throughput, 0.0 * planets[0], planets[1], *weights)
    refused("aperture", cut.throughput, *planets, weights[0], weights[1][:3])
    where = places(30.0)
    with pytest.raises(InputError, match="far enough from the first"):
        roll_photometry(cut, planets[0], planets[0], where[0], where[0], RADIUS, background_region=REGION)
