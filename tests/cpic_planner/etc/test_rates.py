"""Rates in an aperture, field by field, against images, synphot, photutils and closed forms written out here."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from photutils.aperture import CircularAperture

from catalogs import load_reference_spectrum
from cpic_planner.etc import Programme, aperture_rates, build_model, companion_saturates
from cpic_planner.etc.noise import residual_law
from cpic_planner.queries import Strategy
from cpic_planner.targets import find_target
from simulator import load_instrument, star_photlam
from simulator.config import Drift
from simulator.imaging import single_band_psf, visit_frames
from simulator.imaging.psf import wide_on_axis
from simulator.passbands import v_photon_rate, vega_v_photon_rate

INSTRUMENT = load_instrument()
DETECTOR = INSTRUMENT.detector
BAND, CENTRE_NM, WIDTH_NM, T_OPT, QE = "F662", 662.0, 55.0, 0.19, 0.90  # of the default instrument
PIXEL, LAMBDA_D = 0.016153, 662e-9 / 2.0 * 206264.806  # arcsec
RADIUS = 0.7 * LAMBDA_D
AREA_CM2 = 1e4 * np.pi * 1.0**2
SUN = {"teff_k": 5772.0, "log_g": 4.4, "metallicity": 0.0}


def targets(v_mag=3.0, /, companions="on", **companion):
    """Return one star like the Sun, with a companion where its numbers are given."""
    given = {"separation_arcsec": np.nan, "pa_deg": np.nan, "v_mag": np.nan, "teff_k": np.nan} | companion
    columns = SUN | {"v_mag": v_mag} | {f"companion_{name}": value for name, value in given.items()}
    return replace(
        find_target("tau Cet")[0],
        companions=companions,
        **{name: np.array([float(value)]) for name, value in columns.items()},
    )


PAIR = {"separation_arcsec": 5.0, "pa_deg": 248.0, "v_mag": 1.0, "teff_k": 5772.0}


def electrons(v_mag, teff_k=5772.0):
    """Detected electrons per second of a star on the clear 2 m disc, by integrating its spectrum."""
    source = star_photlam(v_mag, teff_k=teff_k, log_g=4.4, metallicity=0.0)
    angstrom = np.linspace(10 * (CENTRE_NM - WIDTH_NM / 2), 10 * (CENTRE_NM + WIDTH_NM / 2), 20_001)
    return AREA_CM2 * T_OPT * QE * np.trapezoid(source(angstrom).value, angstrom)


def sunlight(v_mag):
    """Detected electrons per second of the measured Sun at this V on the clear 2 m disc."""
    sun = load_reference_spectrum("sun")
    scale = 10.0 ** (-0.4 * v_mag) * vega_v_photon_rate() / v_photon_rate(sun.wavelength_nm, sun.photlam)
    nm = np.linspace(CENTRE_NM - WIDTH_NM / 2, CENTRE_NM + WIDTH_NM / 2, 20_001)
    photlam = np.interp(nm, sun.wavelength_nm, sun.photlam)
    return AREA_CM2 * T_OPT * QE * scale * np.trapezoid(photlam, 10.0 * nm)


def aperture_sum(image, x, y, radius=RADIUS):
    """Light in an exact circle on a star-centred stamp, by photutils."""
    middle = len(image) // 2
    circle = CircularAperture((x / PIXEL + middle, y / PIXEL + middle), radius / PIXEL)
    return float(circle.do_photometry(image, method="exact")[0][0])


def model(library="same_star_planet_free", instrument=INSTRUMENT, **strategy):
    return build_model(instrument, [BAND], Strategy(library=library, **strategy))


@pytest.fixture(scope="module")
def light():
    """Images of unit sources: the star, a source far from the mask, and the star on the whole frame."""
    psf = single_band_psf(BAND, instrument=INSTRUMENT)
    n = len(psf.on_axis)
    centre = PIXEL * (np.arange(n) - n // 2)
    frame = wide_on_axis(BAND, INSTRUMENT, (1050, 1080), (DETECTOR.star_row, DETECTOR.star_column))
    return SimpleNamespace(psf=psf, centre=centre, frame=frame)


def pixels(*steps):
    """Places that are centres of pixels, arcsec."""
    return PIXEL * np.array(steps, float)


X, Y = pixels(30, -33, 28, 40), pixels(27, 30, -36, -24)  # separations of 0.65 to 0.75 arcsec, in three quadrants
INNER, OUTER = 0.294 / 2**0.5, 0.707  # edges of the squares, arcsec


def beside(x, y, half_width=1.5):
    """Every second pixel around which an aperture lies in the squares and in the annulus, away from a place."""
    grid, room = PIXEL * np.arange(-44, 45, 2), half_width * LAMBDA_D - RADIUS
    whole = [at for at in grid if INNER + RADIUS <= abs(at) <= OUTER - RADIUS]
    return [
        (one, other)
        for one in whole
        for other in whole
        if abs(np.hypot(one, other) - np.hypot(x, y)) <= room and np.hypot(one - x, other - y) > 2.5 * RADIUS
    ]


def of(setup, star, contrast=1e-8, x=X, y=Y):
    return aperture_rates(setup, star, BAND, x[None], y[None], np.full((1, x.size), contrast))


def test_light_of_planet_and_star_is_that_of_images(light):
    rates, star_e_s = of(model(), targets(3.0)), electrons(3.0)
    planet = [1e-8 * star_e_s * aperture_sum(light.psf.at(x, y), x, y) for x, y in zip(X, Y, strict=True)]
    around = [beside(x, y) for x, y in zip(X, Y, strict=True)]
    halo = [star_e_s * np.mean([aperture_sum(light.psf.on_axis, *at) for at in places]) for places in around]
    np.testing.assert_allclose((rates.planet_e_s / rates.planet_left)[0], planet, rtol=2e-3)
    np.testing.assert_allclose((rates.halo_e_s - rates.errors_e_s)[0], halo, rtol=0.07)
    np.testing.assert_array_equal(rates.companion_e_s, 0.0)
    np.testing.assert_array_equal(rates.wings_e2_s2, 0.0)
    bright, faint = (of(model(), targets(v_mag)).halo_e_s for v_mag in (3.0, 5.5))
    np.testing.assert_allclose(faint, 0.1 * bright, rtol=1e-9)


@pytest.mark.parametrize(("roll_deg", "within"), [(4.0, 0.02), (8.0, 4e-3), (16.0, 1e-3), (30.0, 1e-3)])
def test_two_rolls_take_the_negative_image_off_the_planet(light, roll_deg, within):
    """Difference of images of the planet at both rolls, in its aperture; its noise is that of their sum.

    Where the two images overlap by half, the steps of the table (3 pixels) show.
    """
    rates = of(model("roll", roll_deg=roll_deg), targets(3.0))
    half = np.radians(roll_deg / 2.0)
    turned = [(X + 1j * Y) * np.exp(sign * 1j * half) for sign in (-1, 1)]
    for number in range(X.size):
        here, there = ((place[number].real, place[number].imag) for place in turned)
        one, two = (aperture_sum(light.psf.at(*place), *here) for place in (here, there))
        left = np.broadcast_to(rates.planet_left, (1, X.size))[0, number]
        assert left == pytest.approx(1.0 - two / one, abs=within)
    single = of(model(), targets(3.0))
    gain = rates.planet_left / single.planet_left  # whose background holds wings of the planet alone
    np.testing.assert_allclose(rates.planet_e_s, single.planet_e_s * gain, rtol=1e-12)
    own = rates.source_noise_fraction * rates.planet_e_s / (single.source_noise_fraction * single.planet_e_s)
    np.testing.assert_allclose(own, 2.0 - rates.planet_left, rtol=1e-12)


def test_one_place_for_each_star():
    stars = targets(3.0), targets(4.0, **PAIR), targets(3.5, **(PAIR | {"pa_deg": 30.0}))
    every = aperture_rates(model(), type(stars[0]).joined(stars), BAND, X[:3], Y[:3], np.array([1e-8, 3e-8, 2e-8]))
    for i, star in enumerate(stars):
        one = of(model(), star, (1e-8, 3e-8, 2e-8)[i], X[i : i + 1], Y[i : i + 1])
        for name in ("planet_e_s", "halo_e_s", "companion_e_s", "peak_in_hole_e_s", "smear_e"):
            assert getattr(every, name).shape == (3,)
            assert getattr(every, name)[i] == pytest.approx(getattr(one, name).item(), rel=1e-12), name


@pytest.mark.parametrize(
    ("x", "y", "contrast"),
    [
        (X[None, :3, None], Y[None, :3, None], 1e-8),
        (X[:1], Y[:1], np.array([[[1e-8, 3e-8]]])),
        (X[None, :3, None], Y[None, :3, None], np.array([[[1e-8, 3e-8]]])),
    ],
    ids=["places of more dimensions", "contrasts of more dimensions", "both"],
)
def test_the_longer_shape_decides(x, y, contrast):
    both = type(targets()).joined([targets(3.0, **PAIR), targets(4.0, **PAIR)])
    shape = (2, *np.broadcast_shapes(x.shape, np.shape(contrast), (1, 1, 1))[1:])
    every = aperture_rates(model(), both, BAND, x, y, contrast)
    for i, v_mag in enumerate((3.0, 4.0)):
        for place in np.ndindex(shape[1:]):
            there = [float(np.broadcast_to(part, shape)[(i, *place)]) for part in (x, y, contrast)]
            one = of(model(), targets(v_mag, **PAIR), there[2], *(np.array([part]) for part in there[:2]))
            for name in ("planet_e_s", "halo_e_s", "companion_e_s", "smear_e", "peak_in_hole_e_s", "background_e_s"):
                found = np.broadcast_to(getattr(every, name), shape)[(i, *place)]
                assert found == pytest.approx(getattr(one, name).item(), rel=1e-12), name
            own = np.broadcast_to(every.speckle.law().k0, shape)[(i, *place)]
            assert own == pytest.approx(one.speckle.law().k0.item())


def test_every_star_has_the_sky_of_its_own_place():
    """Zodiacal light is brightest in the ecliptic."""
    setup = model(instrument=INSTRUMENT)
    stars = [replace(targets(3.0), ra_deg=np.array([180.0]), dec_deg=np.array([dec])) for dec in (0.0, 70.0)]
    both = aperture_rates(setup, type(stars[0]).joined(stars), BAND, X[None], Y[None], np.full((1, 4), 1e-8))
    assert both.sky_e_s.shape == (2, 1)
    assert both.sky_e_s[0] > 1.5 * both.sky_e_s[1]
    np.testing.assert_allclose(both.sky_e_s[:, 0], [of(setup, star).sky_e_s.item() for star in stars], rtol=1e-12)


def test_sky_dust_and_dark_current():
    sky = {"model": "uniform", "exozodi_zodis": 3.0}
    instrument = INSTRUMENT.changed({"sky": sky, "detector": {"dark_293k_e_s": 0.0}})
    rates, star_e_s = of(model(instrument=instrument), targets(3.0)), electrons(3.0)
    passed = 0.3283  # energy behind the shipped apodizer: its squared transmission over the disc
    sky = sunlight(21.0) * np.pi * RADIUS**2 * passed  # 21 mag/arcsec2, of the Sun's colour
    assert rates.sky_e_s.item() == pytest.approx(sky, rel=0.01)
    # One zodi is 22 mag/arcsec2 at 1 au from a star of M_V 4.83 (Stark et al. 2014), as r^-2.
    at_one_arcsec = 3.0 * 10 ** (-0.4 * (22.0 - 4.83)) / 100.0
    dust = star_e_s * at_one_arcsec / (X**2 + Y**2) * np.pi * RADIUS**2 * passed
    np.testing.assert_allclose(rates.exozodi_e_s[0], dust, rtol=0.05)  # diffraction and the mask take a few per cent
    area, dark_rate = np.pi * (RADIUS / PIXEL) ** 2, float(DETECTOR.dark_e_s)
    assert rates.aperture_pixels == pytest.approx(area, rel=1e-4)
    assert rates.dark_e_s.item() == pytest.approx(dark_rate * area, rel=1e-4)
    whole = rates.halo_e_s + rates.companion_e_s + rates.sky_e_s + rates.exozodi_e_s + rates.dark_e_s
    np.testing.assert_allclose(rates.background_e_s, whole, rtol=1e-14)


def companion_place():
    """Where the companion stands on the detector: east of north, parity -1 (x = -rho sin PA)."""
    angle = np.deg2rad(PAIR["pa_deg"])
    return -PAIR["separation_arcsec"] * np.sin(angle), PAIR["separation_arcsec"] * np.cos(angle)


def background(image, x, y):
    """Aperture sums of an image over the annulus beside a planet, as photometry takes them for its noise."""
    offset = PIXEL * (np.arange(len(image)) - len(image) // 2)
    inside = (np.abs(offset) >= INNER) & (np.abs(offset) <= OUTER)
    ring = np.outer(inside, inside) & (np.abs(np.hypot(offset[:, None], offset) - np.hypot(x, y)) <= 1.5 * LAMBDA_D)
    ring &= np.hypot(offset - x, offset[:, None] - y) > 1.5 * RADIUS
    sums = []
    for row, column in zip(*np.nonzero(ring), strict=True):
        mask = CircularAperture((column, row), RADIUS / PIXEL).to_mask(method="exact")
        if np.all(mask.cutout(ring.astype(float))[mask.data > 0] > 0):
            sums.append(float((mask.cutout(image) * mask.data).sum()))
    return np.array(sums)


def test_light_of_a_companion_is_that_of_the_apertures_that_measure_the_noise(light):
    image, star_e_s = light.psf.at(*companion_place()), electrons(PAIR["v_mag"])
    rates = of(model(), targets(3.0, **PAIR))
    seen = [star_e_s * background(image, x, y).mean() for x, y in zip(X, Y, strict=True)]
    np.testing.assert_allclose(rates.companion_e_s[0], seen, rtol=0.1)
    there = [star_e_s * aperture_sum(image, x, y) for x, y in zip(X, Y, strict=True)]
    assert max(there) > 3 * min(there)  # at the planets it differs
    np.testing.assert_allclose(rates.background_e_s - of(model(), targets(3.0)).background_e_s, rates.companion_e_s)
    off = of(model(), targets(3.0, companions="off", **PAIR))
    np.testing.assert_array_equal(off.companion_e_s, 0.0)


def test_a_search_sees_a_companions_stripes(light):
    """Weights of inverse variance are those of the harmonic mean of its light under the source's squared image."""
    image, star_e_s = light.psf.at(*companion_place()), electrons(PAIR["v_mag"])
    half, middle = 5, len(image) // 2
    inside = slice(middle - half, middle + half + 1)
    kernel = np.asarray(light.psf.off_axis)[inside, inside] ** 2
    offset = PIXEL * np.arange(-half, half + 1)
    kernel *= np.hypot(offset[:, None], offset) <= 1.5 * LAMBDA_D
    rng = np.random.default_rng(4)
    row, column = middle + (rng.choice([-1, 1], (2, 60)) * rng.uniform(0.3, 0.6, (2, 60)) / PIXEL).astype(int)
    x, y = PIXEL * (column - middle), PIXEL * (row - middle)
    cuts = [image[r - half : r + half + 1, c - half : c + half + 1] for r, c in zip(row, column, strict=True)]
    harmonic = star_e_s * np.array([kernel.sum() / np.sum(kernel / cut) for cut in cuts])
    said = aperture_rates(model(), targets(3.0, **PAIR), BAND, x[None], y[None], np.full((1, 60), 1e-9), at_place=True)
    seen = np.log(said.companion_e_s[0] / (harmonic * said.aperture_pixels))
    assert abs(seen.mean()) < 0.1
    assert seen.std() < 0.25


def test_a_companion_that_may_stand_anywhere_is_averaged():
    """Mean over position angles of what it leaves at each: no angle is favoured."""
    rates = of(model(), targets(3.0, **(PAIR | {"pa_deg": np.nan})))
    each = [
        of(model(), targets(3.0, **(PAIR | {"pa_deg": float(pa_deg)}))).companion_e_s for pa_deg in np.arange(2, 360, 5)
    ]
    np.testing.assert_allclose(rates.companion_e_s, np.mean(each, axis=0), rtol=0.15)
    assert np.max(each) > 5 * np.min(each)


@pytest.mark.parametrize("missing", ["v_mag", "separation_arcsec"])
def test_a_companion_that_cannot_be_placed_leaves_no_light(missing):
    rates = of(model(), targets(3.0, **(PAIR | {missing: np.nan})))
    np.testing.assert_array_equal(rates.companion_e_s, 0.0)


def test_only_the_star_with_a_companion_has_its_light():
    both = type(targets()).joined([targets(3.0), targets(3.0, **PAIR), targets(3.0)])
    x, y = np.stack([X, X[::-1], X]), np.stack([Y, Y[::-1], Y])
    rates = aperture_rates(model("roll"), both, BAND, x, y, np.full(x.shape, 1e-8))
    alone = of(model("roll"), targets(3.0, **PAIR), x=X[::-1], y=Y[::-1])
    for name in ("companion_e_s", "wings_e2_s2"):
        found = getattr(rates, name)
        np.testing.assert_array_equal(found[[0, 2]], 0.0)
        np.testing.assert_allclose(found[1], getattr(alone, name)[0], rtol=1e-12)


def test_hottest_pixels(light):
    """Star, planet and companion each at a brightness that shows in the sum; the last was once left out."""
    star_e_s, other_e_s = electrons(3.0), electrons(PAIR["v_mag"])
    off_axis = light.psf.off_axis.max()
    inside = (np.abs(light.centre) >= INNER - PIXEL / 2) & (np.abs(light.centre) <= OUTER + PIXEL / 2)
    own = light.psf.on_axis[np.ix_(inside, inside)].max()
    contrast = 0.5 * own / off_axis
    alone, pair = (of(model(), star, contrast) for star in (targets(3.0), targets(3.0, **PAIR)))
    np.testing.assert_allclose(alone.peak_in_hole_e_s, 1.5 * star_e_s * own, rtol=1e-5)
    np.testing.assert_allclose(alone.peak_planet_e_s, 0.5 * star_e_s * own, rtol=1e-5)
    np.testing.assert_allclose(pair.peak_planet_e_s, alone.peak_planet_e_s)
    added = pair.peak_in_hole_e_s - alone.peak_in_hole_e_s
    # No less than the brightest pixel of its image in the hole, lest frames saturate that were promised.
    brightest = light.psf.at(*companion_place())[np.ix_(inside, inside)].max()
    assert np.all((added >= other_e_s * brightest) & (added < 3.0 * other_e_s * brightest))
    columns = PIXEL * (np.arange(1080) - DETECTOR.star_column)
    crossing = (np.abs(columns) >= INNER - PIXEL / 2) & (np.abs(columns) <= OUTER + PIXEL / 2)
    assert alone.peak_frame_e_s.item() == pytest.approx(star_e_s * light.frame.max(), rel=1e-5)
    assert alone.peak_columns_e_s.item() == pytest.approx(star_e_s * light.frame[:, crossing].max(), rel=1e-5)


def test_light_beside_the_hole_that_the_register_carries_into_it(light):
    """The largest mean over any run of pixels that ends at the hole, from either side of every row that crosses it."""
    x, y = (PIXEL * (np.arange(n) - star) for n, star in ((1080, DETECTOR.star_column), (1050, DETECTOR.star_row)))
    worst = 0.0
    for row in light.frame[(np.abs(y) >= INNER) & (np.abs(y) <= OUTER)]:
        for low, high in ((-OUTER, -INNER), (INNER, OUTER)):
            before, after = row[x < low][::-1], row[x > high]
            worst = max(worst, *(np.max(np.cumsum(run) / np.arange(1, run.size + 1)) for run in (before, after)))
    assert of(model(), targets(3.0)).register_tail_e_s.item() == pytest.approx(electrons(3.0) * worst, rel=0.02)


@pytest.mark.parametrize("n_pairs", [20, pytest.param(60, marks=pytest.mark.long)])
def test_speckles_are_those_of_pairs_of_visits(light, n_pairs):
    """Frozen offsets of 0.05 nm: rms of aperture sums in the annulus of the difference of two visits."""
    drift = Drift(visit_nm=0.05, walk_nm_per_sqrt_hour=0.0, psd_slope=2.5)
    setup, star_e_s = model(), electrons(3.0)
    place = np.hypot(X, Y)[0]
    angles = np.deg2rad(45 + np.arange(4) * 90 + np.array([[-12], [0], [12]])).ravel()
    spots = [(r * np.cos(a), r * np.sin(a)) for r in place + LAMBDA_D * np.array([-0.8, 0.0, 0.8]) for a in angles]
    squares = []
    for k in range(n_pairs):
        one, other = (
            visit_frames(light.psf, drift, 1, 1.0, *map(np.random.default_rng, ((k, i, 1), (k, i, 2))))[0]
            for i in (1, 2)
        )
        sums = [aperture_sum(one - other, x, y) for x, y in spots]
        squares.append(np.var(sums))
    found = of(setup, targets(3.0)).speckle.averaging().law()
    error = np.std(squares) / np.sqrt(n_pairs) / np.mean(squares)
    assert found.k0[0, 0] == pytest.approx(star_e_s**2 * np.mean(squares), rel=0.15 + 3 * error)
    walking = of(
        model(instrument=INSTRUMENT.changed({"drift": {"walk_nm_per_sqrt_hour": 0.0}})), targets(3.0)
    ).speckle.law()
    np.testing.assert_array_equal(walking.k1, 0.0)
    brighter = of(setup, targets(0.5)).speckle.averaging().law()
    for part, fainter in zip(brighter, found, strict=True):
        np.testing.assert_allclose(part, 100.0 * fainter, rtol=1e-9)


def test_all_that_is_left_is_speckles_and_wings():
    rates = of(model("roll"), targets(3.0, **PAIR))
    assert np.all(rates.wings_e2_s2 > 0)
    for visits in (1.0, 100.0):
        many = np.array(visits)
        programme = Programme(visits=many, reference_visits=many)
        left, speckle = residual_law(rates, programme), rates.speckle.law(visits)
        np.testing.assert_allclose(left.k0, speckle.k0 + rates.wings_e2_s2, rtol=1e-14)
        np.testing.assert_array_equal(left.k1, speckle.k1)
    fainter = of(model("roll"), targets(3.0, **(PAIR | {"v_mag": 3.5})))
    np.testing.assert_allclose(rates.wings_e2_s2, 100.0 * fainter.wings_e2_s2, rtol=1e-9)  # a variance


def test_weights_of_an_aperture_on_pixels(light):
    """Means over places of the circle on the pixels: sum w^2 / sum w, and the same weighted by the planet's light."""
    radius = RADIUS / PIXEL
    shifts = np.random.default_rng(3).uniform(-0.5, 0.5, (400, 2))
    squares = [(CircularAperture(shift, radius).to_mask(method="exact").data ** 2).sum() for shift in shifts]
    rates = of(model(), targets(3.0))
    assert rates.noise_fraction == pytest.approx(np.mean(squares) / (np.pi * radius**2), rel=2e-3)
    middle = len(light.psf.off_axis) // 2
    mask = CircularAperture((middle, middle), radius).to_mask(method="exact")
    source = mask.cutout(light.psf.off_axis)
    expected = (mask.data**2 * source).sum() / (mask.data * source).sum()
    assert rates.source_noise_fraction == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(("half_width", "tolerance"), [(0.25, 0.05), (0.5, 0.08), (1.0, 0.17), (1.5, 0.25)])
def test_background_is_measured_in_the_annulus_within_the_quadrants(half_width, tolerance):
    """Points thrown on the field: area of the ring inside the squares, over that of an aperture.

    The closed form takes the azimuth of the ring's middle for all of it: up to 25 % too much for a wide ring, which is
    0.2 % of the noise, for 70 apertures measure the background.
    """
    x, y = np.random.default_rng(4).uniform(-0.9, 0.9, (2, 2_000_000))
    dark = np.minimum(np.abs(x), np.abs(y)) >= INNER
    dark &= np.maximum(np.abs(x), np.abs(y)) <= OUTER
    place = np.hypot(X, Y)
    ring = np.abs(np.hypot(x, y)[dark] - place[:, None]) <= half_width * LAMBDA_D
    area = ring.sum(axis=1) * 1.8**2 / x.size / (np.pi * RADIUS**2)
    rates = of(model(annulus_lambda_d=half_width), targets(3.0))
    np.testing.assert_allclose(rates.background_apertures[0], area, rtol=tolerance)


def test_a_background_is_never_measured_in_less_than_an_aperture():
    far = pixels(200)
    np.testing.assert_array_equal(of(model(), targets(3.0), x=far, y=far).background_apertures, 1.0)


def test_particles_hit_an_aperture_at_the_rate_of_its_pixels_and_tracks():
    instrument = INSTRUMENT.switched({"cosmic_rays": False})
    assert of(model(instrument=instrument), targets(3.0)).loss_per_s == 0.0
    side_cm = DETECTOR.pixel_um * 1e-4
    area = np.pi * (RADIUS / PIXEL) ** 2 * side_cm**2 * INSTRUMENT.cosmic_rays.peak_rate_per_s_cm2
    assert area < of(model(), targets(3.0)).loss_per_s < 6 * area  # tracks make the target larger


def test_references_of_the_same_star_double_the_noise():
    rates = of(model(instrument=INSTRUMENT.changed({"sky": {"exozodi_zodis": 3.0}})), targets(3.0, **PAIR))
    assert np.all(rates.exozodi_e_s > 0)
    same = rates.halo_e_s + rates.exozodi_e_s + rates.companion_e_s + rates.sky_e_s + rates.dark_e_s
    np.testing.assert_allclose(rates.reference_light_e_s, same, rtol=1e-12)
    np.testing.assert_array_equal(rates.reference_halo, 1.0)
    np.testing.assert_allclose(rates.reference_smear_e, rates.smear_e, rtol=1e-12)
    assert rates.reference_scale.item() == rates.variance_factor == 1.0
    assert of(model("roll"), targets(3.0)).variance_factor == 0.5


@pytest.mark.parametrize(("v_mag", "ratio"), [(0.5, 10.0), (5.5, 0.1)])
def test_references_of_another_star_are_scaled(v_mag, ratio):
    """Scaled to the science star: variance of its light over the ratio, of all else over its square; no companion."""
    star = targets(3.0, **PAIR)
    own = of(model(), star)
    rates = of(model("reference_star", reference_star={"v_mag": v_mag, **SUN}), star)
    even = (own.sky_e_s + own.dark_e_s) / ratio**2
    np.testing.assert_allclose(rates.reference_light_e_s, (own.halo_e_s + own.exozodi_e_s) / ratio + even, rtol=1e-9)
    np.testing.assert_allclose(rates.reference_halo, 1.0 / ratio, rtol=1e-9)
    np.testing.assert_allclose(rates.reference_scale, ratio**-2, rtol=1e-9)
    brighter = max(ratio, 1.0)
    for name in ("peak_frame_e_s", "peak_columns_e_s", "register_tail_e_s"):
        np.testing.assert_allclose(getattr(rates, name), brighter * getattr(own, name), rtol=1e-9)
    alone = of(model(), targets(3.0), 1e-30).peak_in_hole_e_s
    np.testing.assert_allclose(rates.peak_in_hole_e_s, own.peak_in_hole_e_s + (brighter - 1.0) * alone, rtol=1e-9)


def test_an_idealised_library_adds_nothing():
    rates = of(model("idealised"), targets(3.0))
    for part in (
        rates.reference_light_e_s,
        rates.reference_halo,
        rates.reference_scale,
        rates.reference_smear_e,
        *rates.speckle.law(),
    ):
        np.testing.assert_array_equal(part, 0.0)


def test_smear_is_the_light_of_the_columns(light):
    """Every pixel of the aperture passes under the star's light of its column, for one line shift each row."""
    rates = of(model(), targets(0.0))
    columns, middle = light.frame.sum(axis=0), DETECTOR.star_column
    circle = CircularAperture((0.0, 0.0), RADIUS / PIXEL).to_mask(method="exact").data.sum(axis=0)
    reach = len(circle) // 2
    for j, x in enumerate(np.rint(X / PIXEL).astype(int)):
        light_e_s = electrons(0.0) * circle @ columns[middle + x - reach : middle + x + reach + 1]
        shift_s = model().camera(BAND).line_shift_s
        assert shift_s > 0
        assert rates.smear_e[0, j] == pytest.approx(shift_s * light_e_s, rel=0.03)


def test_a_companion_smears_along_its_own_columns():
    """North of the hole it stands in columns of apertures that measure the noise; beside it in none of them."""
    alone = of(model(), targets(3.0)).smear_e

    def smear(x_arcsec, v_mag=1.0):
        place = {"separation_arcsec": np.hypot(x_arcsec, 5.0), "pa_deg": np.rad2deg(np.arctan2(-x_arcsec, 5.0))}
        return of(model(), targets(3.0, **(PAIR | place | {"v_mag": v_mag}))).smear_e - alone

    assert np.all(smear(X[1]) > 5 * smear(3.0))
    np.testing.assert_allclose(smear(X[1]), 10.0 * smear(X[1], v_mag=3.5), rtol=1e-6)


@pytest.mark.parametrize(("fill", "over"), [(0.98, False), (1.02, True)])
def test_a_companion_saturates_where_its_peak_passes_the_well(light, fill, over):
    star = targets(3.0, **PAIR)
    peak_e_s = electrons(PAIR["v_mag"]) * light.psf.off_axis.max()
    exposure_s = fill * DETECTOR.full_well_e / peak_e_s
    assert companion_saturates(model(), star, BAND, exposure_s).tolist() == [over]
    assert companion_saturates(model(), targets(3.0), BAND, 1e6).tolist() == [False]
    assert companion_saturates(model(), replace(star, companions="off"), BAND, 1e6).tolist() == [False]
    both = type(star).joined([targets(3.0), star])
    assert companion_saturates(model(), both, BAND, [1e6, exposure_s]).tolist() == [False, over]
    for missing in ("v_mag", "separation_arcsec"):
        unknown = targets(3.0, **(PAIR | {missing: np.nan}))
        assert companion_saturates(model(), unknown, BAND, 1e6).tolist() == [False]
        assert companion_saturates(model(), type(star).joined([star, unknown]), BAND, exposure_s).tolist()[1] is False


@pytest.mark.parametrize(
    ("pa_deg", "reach"),
    [
        (270.0, 1080 - 1 - DETECTOR.star_column),
        (90.0, DETECTOR.star_column),
        (0.0, 1050 - 1 - DETECTOR.star_row),
        (180.0, DETECTOR.star_row),
    ],
    ids=["last column", "first column", "last row", "first row"],
)
def test_a_companion_beyond_the_frame_saturates_nothing(pa_deg, reach):
    """At parity -1 west is at +x; a companion on the last row or column still falls on the frame."""
    for steps, seen in ((reach - 0.4, True), (reach + 1.5, False)):
        star = targets(3.0, **(PAIR | {"separation_arcsec": steps * PIXEL, "pa_deg": pa_deg}))
        assert companion_saturates(model(), star, BAND, 1e6).tolist() == [seen]
