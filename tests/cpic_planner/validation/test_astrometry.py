from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from cpic_planner.validation import Astrometry, ReducedStack, fit_position, rdi_subtract
from cpic_planner.validation.astrometry import PositionFitter
from simulator import load_instrument, single_band_psf
from simulator.detectors import excess_noise_factor2
from simulator.imaging import Psf
from simulator.knobs import Knobs
from simulator.target import sky_to_detector, wcs_keywords

SIDE = 97
GAIN, STAGES = 300.0, 604
FACTOR2 = float(excess_noise_factor2(GAIN, STAGES))


@pytest.fixture(scope="module", params=["F520", "F850"])
def psf(request: pytest.FixtureRequest) -> Psf:
    """The smallest stamp that holds the dark hole."""
    return single_band_psf(request.param, fidelity=Knobs(stamp_pixels=SIDE))


@pytest.fixture(scope="module")
def field(psf: Psf) -> Field:
    return Field(psf)


class Field:
    """Static star light, white noise that follows it, and speckles that are its beat with a drift."""

    def __init__(self, psf: Psf) -> None:
        metrics = psf.metrics
        self.psf, self.hole, self.scale = psf, metrics.hole, metrics.pixel_scale_arcsec
        self.width = 0.42 * metrics.lambda_d_arcsec / self.scale
        self.ends = metrics.hole_inner_arcsec / self.scale, metrics.hole_outer_arcsec / self.scale
        rng = np.random.default_rng(2)
        offset = np.arange(SIDE) - SIDE // 2
        radius = np.maximum(np.hypot(offset[:, None], offset), 5.0)
        self.drift = (radius / 35.0) ** -1.25  # amplitude of a wavefront error with a spectrum of f^-2.5
        self.static = self.smooth(rng)
        self.halo = gaussian_filter(np.abs(self.static) ** 2, 1.5) * self.hole
        library = (100 * self.halo + rng.normal(size=(8, SIDE, SIDE))) * self.hole
        self.rdi = rdi_subtract(library[0], library, 5, region=self.hole, centering="temporal")

    def smooth(self, rng: np.random.Generator) -> np.ndarray:
        parts = gaussian_filter(rng.normal(size=(2, SIDE, SIDE)), (0, self.width, self.width))
        return math.sqrt(2 * math.pi) * self.width * (parts[0] + 1j * parts[1])

    def planet(self, x_pixel: float, y_pixel: float) -> np.ndarray:
        return self.psf.at(x_pixel * self.scale, y_pixel * self.scale)

    def stack(self, light: np.ndarray, variance: np.ndarray | None = None) -> ReducedStack:
        white = np.zeros(self.hole.shape) if variance is None else variance * self.hole
        return ReducedStack(self.rdi.project(light), self.hole, white, self.halo, self.rdi, 1.0, FACTOR2)

    def fit(self, stack: ReducedStack, x_pixel: float, y_pixel: float, **settings: object) -> Astrometry:
        return fit_position(stack, self.psf, x_pixel * self.scale, y_pixel * self.scale, **settings)  # type: ignore[arg-type]

    def noise(self, rng: np.random.Generator, white: float, speckle: float) -> tuple[np.ndarray, np.ndarray]:
        variance = white * (0.5 + 0.5 * self.halo)
        beat = 2 * speckle * (self.static.conj() * self.smooth(rng) * self.drift).real
        return np.sqrt(variance) * rng.normal(size=variance.shape) + beat, variance

    def places(self, rng: np.random.Generator, number: int) -> list[tuple[float, float, np.ndarray]]:
        """Anywhere in the hole, half a lambda/D from its edges."""
        margin = self.width / 0.84
        draws = rng.uniform(self.ends[0] + margin, self.ends[1] - margin, (number, 2)) * rng.choice(
            [-1, 1], (number, 2)
        )
        return [(x, y, self.planet(x, y)) for x, y in draws.tolist()]


@pytest.mark.parametrize("place", [(25.31, 24.62), (-38.5, 20.2), (31.04, -36.77), (-22.5, -41.0)])
@pytest.mark.parametrize("off", [(0.7, -0.7), (-1.0, 0.0), (0.1, 0.9)])
def test_without_noise_the_place_comes_back(field: Field, place: tuple[float, float], off: tuple[float, float]) -> None:
    # Five modes of noise take light from the planet and distort it: the model has that in it, but for wings beyond
    # this small stamp.
    found = field.fit(field.stack(1e4 * field.planet(*place)), place[0] + off[0], place[1] + off[1])
    assert found.converged
    assert np.array([found.x_arcsec, found.y_arcsec]) / field.scale == pytest.approx(place, abs=1e-3)
    assert found.flux_e == pytest.approx(1e4, rel=5e-4)
    assert found.shift_arcsec == pytest.approx(math.hypot(*off) * field.scale, abs=2e-5)


def test_projection_is_in_the_model(field: Field) -> None:
    # The same image fitted with a model that forgets the projection is dimmer.
    stack = field.stack(1e4 * field.planet(25.0, 24.0))
    forgetful = replace(stack, rdi=rdi_subtract(stack.image_e, np.ones((1, SIDE, SIDE)), 0, region=field.hole))
    assert field.fit(forgetful, 25.0, 24.0).flux_e < 0.9995e4


def test_shifts_are_exact(field: Field) -> None:
    fitter = PositionFitter(field.stack(field.planet(25.0, 25.0)), field.psf, exclude=())
    x, y, step = 25.37, -30.46, 1e-3
    image, along_x, along_y = fitter.images(np.array([x, y]))
    peak = image.max()
    near = field.hole & (np.hypot(*(np.indices(image.shape)[::-1] - SIDE // 2 - np.array([x, y])[:, None, None])) < 12)
    assert image[near] == pytest.approx(field.planet(x, y)[near], abs=1e-5 * peak)
    brute_x = (field.planet(x + step, y) - field.planet(x - step, y)) / (2 * step)
    brute_y = (field.planet(x, y + step) - field.planet(x, y - step)) / (2 * step)
    for slope, brute in ((along_x, brute_x), (along_y, brute_y)):
        assert -slope[near] == pytest.approx(-brute[near], abs=2e-5 * peak)


@pytest.mark.parametrize(("parity", "east"), [(-1, -1), (1, 1)])
def test_east_is_where_the_convention_says(field: Field, parity: int, east: int) -> None:
    # An absolute picture: a source at PA 90 plus a little has x < 0 at parity -1, and a larger right ascension.
    x, y = east * 35.0, -20.0
    found = field.fit(field.stack(1e4 * field.planet(x, y)), x, y, parity=parity)
    assert found.pa_deg == pytest.approx(90 + math.degrees(math.atan2(20, 35)), abs=2e-3)
    assert found.east_arcsec == pytest.approx(35.0 * field.scale, abs=2e-5)
    assert found.north_arcsec == pytest.approx(-20.0 * field.scale, abs=2e-5)
    assert found.x_arcsec * east > 0
    header = wcs_keywords(field.scale, (SIDE // 2, SIDE // 2), (None, None), parity=parity)
    to_east = float(header["CD1_1"]) * x + float(header["CD1_2"]) * y
    assert to_east * 3600 == pytest.approx(found.east_arcsec, abs=2e-5)


@pytest.mark.parametrize("parity", [-1, 1])
def test_roll_turns_the_sky(field: Field, parity: int) -> None:
    x, y = (float(part) / field.scale for part in sky_to_detector(0.6, 77.0, roll_deg=33.0, parity=parity))
    found = field.fit(field.stack(1e4 * field.planet(x, y)), x, y, roll_deg=33.0, parity=parity)
    assert found.separation_arcsec == pytest.approx(0.6, abs=2e-5)
    assert found.pa_deg == pytest.approx(77.0, abs=2e-3)
    assert parity * found.x_arcsec == pytest.approx(0.6 * math.sin(math.radians(44.0)), abs=2e-5)


def test_parity_is_the_instruments(field: Field) -> None:
    tree = load_instrument().model_dump(mode="json")
    mirrored = replace(field.psf, instrument=load_instrument(tree | {"detector": tree["detector"] | {"parity": 1}}))
    stack = field.stack(1e4 * field.planet(30.0, 30.0))
    place = 30.0 * field.scale
    assert fit_position(stack, field.psf, place, place).pa_deg == pytest.approx(315.0, abs=2e-3)
    assert fit_position(stack, mirrored, place, place).pa_deg == pytest.approx(45.0, abs=2e-3)


# All four bands on draws of the whole chain: reports/truth/blind_validator.
@pytest.mark.parametrize(("psf", "white", "speckle", "snr"), [("F520", 3.0, 10.0, 12.0)], indirect=["psf"])
@pytest.mark.parametrize(("n_draws", "within"), [(50, 0.4), pytest.param(500, 0.1, marks=pytest.mark.long)])
def test_pulls(field: Field, white: float, speckle: float, snr: float, n_draws: int, within: float) -> None:
    """Deviation over error of separation and position angle: width 1.0 +- 0.1, mean 0.

    The standard error of a width is 3 % over 500 draws, 10 % over 50. The flux is biased by about 1 / SNR^2, a pull of
    1 / SNR.
    """
    rng = np.random.default_rng(11)
    places = field.places(rng, 10)
    variance = field.noise(rng, white, speckle)[1]
    pulls = []
    for x, y, image in places:
        flux = 1e4
        for _ in range(4):  # the brightness that has the wanted SNR
            light = flux * image + field.noise(rng, white, speckle)[0]
            flux = snr * field.fit(field.stack(light, variance), x, y).flux_error_e
        mean = flux * image
        for _ in range(n_draws // len(places)):
            light = mean + np.sqrt(FACTOR2 * np.maximum(mean, 0)) * rng.normal(size=mean.shape)
            light = light + field.noise(rng, white, speckle)[0]
            off = rng.uniform(-0.7, 0.7, 2)
            found = field.fit(field.stack(light, variance), x + off[0], y + off[1])
            separation, pa = math.hypot(x, y) * field.scale, math.degrees(math.atan2(-x, y))
            turned = (found.pa_deg - pa + 180) % 360 - 180
            pulls.append(
                [
                    (found.separation_arcsec - separation) / found.separation_error_arcsec,
                    turned / found.pa_error_deg,
                    found.converged,
                    found.snr,
                ]
            )
    values = np.array(pulls, dtype=float)
    assert values[:, 2].mean() > 0.99
    assert np.median(values[:, 3]) == pytest.approx(snr, rel=0.3)
    kept = values[values[:, 2] > 0, :2]
    assert kept.std(axis=0) == pytest.approx([1.0, 1.0], abs=within)
    assert np.abs(kept.mean(axis=0)).max() < 4.0 * kept.std(axis=0).max() / math.sqrt(len(kept))


def test_errors_of_white_noise_are_those_of_the_linear_fit(field: Field) -> None:
    # Nothing but the planet on the image, so no excess over the white noise: the errors are the closed form.
    x, y, flux, white = 26.3, -29.8, 5e4, 40.0
    variance = np.full(field.hole.shape, white)
    nothing = rdi_subtract(np.zeros((SIDE, SIDE)), np.ones((1, SIDE, SIDE)), 0, region=field.hole, centering="none")
    stack = replace(field.stack(flux * field.planet(x, y), variance), rdi=nothing)
    stack = replace(stack, image_e=flux * field.planet(x, y) * field.hole)
    found = field.fit(stack, x, y)
    step, image = 1e-3, field.planet(x, y)
    rows, columns = np.indices(image.shape) - SIDE // 2
    reach = 1.5 * field.psf.metrics.lambda_d_arcsec / field.scale
    disc = np.hypot(columns - x, rows - y) <= reach
    radius = np.hypot(columns, rows)
    annulus = field.hole & (np.abs(radius - math.hypot(x, y)) <= reach * 2.0 / 1.5)
    level = image[annulus & (np.hypot(columns - x, rows - y) > reach * 1.05 / 1.5)].mean()
    slopes = [
        (field.planet(x + i, y + j) - field.planet(x - i, y - j))[disc] / (2 * step * field.scale) * flux
        for i, j in ((step, 0), (0, step))
    ]
    design = np.stack([*slopes, image[disc] - level])
    estimator = np.linalg.inv(design @ design.T) @ design
    covariance = (estimator * (white + FACTOR2 * flux * image[disc])) @ estimator.T
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx(np.sqrt(np.diag(covariance)), rel=3e-3)
    assert found.flux_error_e == pytest.approx(math.sqrt(covariance[2, 2]), rel=3e-3)
    assert found.chi2 == pytest.approx(0.0, abs=1e-3)
    assert found.degrees_of_freedom == disc.sum() - 3


def test_speckles_raise_the_errors(field: Field) -> None:
    rng = np.random.default_rng(3)
    light, variance = field.noise(rng, 3.0, 0.0)
    beat = field.noise(rng, 0.0, 30.0)[0]
    planet = 1e6 * field.planet(25.0, 25.0)
    quiet, loud = (field.fit(field.stack(planet + part, variance), 25.0, 25.0) for part in (light, light + beat))
    assert loud.flux_error_e > 1.2 * quiet.flux_error_e
    assert loud.chi2 > 2 * quiet.chi2
    assert quiet.noise_samples > 20
    assert quiet.flags == loud.flags == ()


def test_another_planet_is_left_out(field: Field) -> None:
    rng = np.random.default_rng(4)
    light, variance = field.noise(rng, 30.0, 0.0)
    light = light + 4e4 * field.planet(25.0, 25.0)
    other = (-36.0 * field.scale, 22.0 * field.scale)
    alone = field.fit(field.stack(light, variance), 25.0, 25.0, exclude=[other])
    both = light + 4e4 * field.planet(-36.0, 22.0)
    naive, told = (field.fit(field.stack(both, variance), 25.0, 25.0, exclude=known) for known in ([], [other]))
    assert naive.flux_error_e > 1.5 * alone.flux_error_e
    assert told.flux_error_e == pytest.approx(alone.flux_error_e, rel=0.3)


def test_what_is_no_planet_says_so(field: Field) -> None:
    rng = np.random.default_rng(6)
    found = []
    for _ in range(8):
        light, variance = field.noise(rng, 10.0, 0.0)
        found.append(field.fit(field.stack(light, variance), 25.0, 25.0))
    assert all("low_snr" in one.flags for one in found)
    assert any(not one.converged for one in found)
    assert all(np.isfinite([one.x_arcsec, one.pa_deg, one.x_error_arcsec, one.flux_error_e]).all() for one in found)
    empty = field.fit(field.stack(np.zeros(field.hole.shape)), 25.0, 25.0)
    assert not empty.converged
    assert empty.flux_e == 0.0


def test_edge_of_the_hole(refused, field: Field) -> None:
    x = field.ends[0] + 1.2
    found = field.fit(field.stack(1e4 * field.planet(x, 25.0)), x + 0.3, 25.0)
    assert "edge" in found.flags
    assert found.x_arcsec / field.scale == pytest.approx(x, abs=2e-3)
    refused("half of the planet", field.fit, field.stack(field.planet(x, 25.0)), field.ends[0] - 3.0, 25.0)


def test_a_roll_of_no_number_is_refused(refused, field: Field) -> None:
    refused("roll_deg", field.fit, field.stack(field.planet(25.0, 25.0)), 25.0, 25.0, roll_deg=math.nan)


def test_places_off_the_image_are_refused(refused, field: Field) -> None:
    for place in (math.nan, 1e3):
        refused("x_arcsec", field.fit, field.stack(field.planet(25.0, 25.0)), place, 25.0)


def test_a_variance_of_zero_among_others_is_refused(refused, field: Field) -> None:
    variance = np.ones(field.hole.shape)
    variance[SIDE // 2 + 25, SIDE // 2 + 25] = 0.0
    refused("white_variance_e2", field.fit, field.stack(field.planet(25.0, 25.0), variance), 25.0, 25.0)
