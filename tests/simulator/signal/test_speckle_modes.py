"""Modes of reference visits in closed form against subtractions that are carried out."""

import numpy as np
import pytest

from cpic_core import InputError
from simulator.config import load_instrument
from simulator.imaging import centred_axis, overlap_weights, single_band_psf, visit_responses
from simulator.signal import BandModes, OpticalBand, SpeckleModes, speckle_modes

R = 60


class Subtraction:
    """Sums over libraries of what a subtraction by SVD leaves: variance of aperture sums and light of planets."""

    def __init__(self, apertures, own, planets, counts):
        self.apertures, self.own, self.planets, self.counts = apertures, own, planets, counts
        self.variance, self.kept, self.n = np.zeros(len(counts)), np.zeros(len(counts)), 0

    def add(self, references, science):
        mean = references.mean(axis=0)
        _, _, modes = np.linalg.svd(references - mean, full_matrices=False)
        on_science, on_planets = (science - mean) @ modes.T, self.planets @ modes.T
        for j, k in enumerate(self.counts):
            left = science - mean - on_science[:, :k] @ modes[:k]
            self.variance[j] += ((left @ self.apertures.T) ** 2).mean()
            through = self.planets - on_planets[:, :k] @ modes[:k]
            self.kept[j] += ((self.own * through).sum(1) / (self.own * self.planets).sum(1)).mean()
        self.n += 1

    @property
    def limits(self):
        return np.sqrt(self.variance / self.variance[0]) / (self.kept / self.n)


@pytest.fixture(scope="module")
def line():
    """A line of 300 pixels whose smooth speckles fade along it, with apertures and planets on it, and its modes."""
    x = np.arange(300.0)
    middles = np.arange(0.0, 300.0, 3.0)
    patches = np.exp(-0.5 * ((x - middles[:, None]) / 3.0) ** 2) * np.exp(-middles / 60.0)[:, None]
    rng = np.random.default_rng(5)

    def visits(n):
        return rng.standard_normal((n, middles.size)) @ patches

    centres = np.arange(20, 120, 4)
    own = (np.abs(x - centres[:, None]) <= 4).astype(float)
    apertures, planets = own - own.mean(axis=0), np.exp(-0.5 * ((x - centres[:, None]) / 3.0) ** 2)
    many = visits(2000)
    return visits, apertures, own, planets, SpeckleModes(many - many.mean(axis=0), apertures, own, planets)


@pytest.mark.parametrize("noise", [0.1, 1.0])
def test_residual_and_throughput_are_those_of_a_subtraction(line, noise):
    visits, apertures, own, planets, modes = line
    found = modes.factors(R, noise)
    pixel = noise * modes.speckle_rms / np.sqrt((apertures**2).sum(axis=1).mean())
    rng, counts = np.random.default_rng(7), (0, 1, 4, 12, 40, R - 1)
    done = Subtraction(apertures, own, planets, counts)
    for _ in range(60):
        science = visits(200) + pixel * rng.standard_normal((200, 300))
        done.add(visits(R) + pixel * rng.standard_normal((R, 300)), science)
    expected = [found.at(k) for k in counts]
    np.testing.assert_allclose([one.throughput for one in expected], done.kept / done.n, atol=0.012)
    # 60 libraries: some 1 % of error.
    np.testing.assert_allclose(found.limit(noise)[list(counts)], done.limits, rtol=0.03)


def test_the_mean_over_visits_falls_with_both_numbers_and_modes_do_not_change_that(line):
    visits, apertures, own, planets, modes = line
    counts = (0, 4, 12)
    found = np.array([modes.factors(R, 0.01).at(k).speckle for k in counts])
    alone = modes.speckle_rms**2
    for v in (1, 9):
        done = Subtraction(apertures, own, planets, counts)
        for _ in range(60):
            done.add(visits(R), visits(40 * v).reshape(40, v, -1).mean(axis=1))
        np.testing.assert_allclose(done.variance / done.n, alone * (1 / v + 1 / R) * found, rtol=0.06)


def test_modes_pay_only_where_references_are_many_and_quiet(line):
    modes = line[-1]
    few, many = (modes.factors(r, 0.1).limit(0.1).min() for r in (4, 200))
    assert many < few <= 1.0
    best = [np.argmin(modes.factors(200, noise).limit(noise)) for noise in (0.1, 3.0)]
    assert best[0] > best[1]
    found = modes.factors(8, 0.3)
    assert found.speckle[0] == found.white[0] == found.throughput[0] == 1.0
    assert found.at(500) == found.at(7)


def test_many_references_and_levels_of_noise_are_those_of_each(line):
    modes = line[-1]
    references, noise = np.array([[4], [20], [50]]), np.array([0.1, 0.7])
    found = modes.factors(references, noise, 6)
    assert found.speckle.shape == (3, 2, 7)
    for i, r in enumerate(references.ravel()):
        for j, level in enumerate(noise):
            one = modes.factors(int(r), level)
            for k in (0, 3, 6):
                np.testing.assert_allclose([part[i, j, k] for part in found], one.at(k), rtol=1e-12)
    assert found.at(6).n_modes.tolist() == [[3, 3], [6, 6], [6, 6]]
    # Between the numbers that are drawn factors go from one to the next.
    ends = [modes.factors(r, 0.1).at(4).speckle for r in (34, 41, 48)]
    assert min(ends[0], ends[2]) <= ends[1] <= max(ends[0], ends[2])


def test_places_and_noise_broadcast_and_the_hole_ends_where_it_does(line, monkeypatch):
    asked, modes = [], line[-1]

    def stored(optics, separation, offset):
        asked.append(separation)
        return modes

    monkeypatch.setattr("simulator.signal.speckle_modes._stored", stored)
    band = BandModes.of(load_instrument(), "F520", 0.05)
    found = band.factors([[0.1], [0.6], [2.0]], 20, 4, [0.1, 1.0])
    assert found.speckle.shape == (3, 2)
    for j, noise in enumerate((0.1, 1.0)):
        np.testing.assert_array_equal(np.stack(found)[:, :, j].T, [modes.factors(20, noise, 4).at(4)] * 3)
    assert min(asked) > 0.23
    assert max(asked) < 1.0
    assert min(abs(place - 0.6) for place in asked) <= 0.0135
    # Nothing to project out: no reference beside the mean, no mode, no speckles.
    still = BandModes.of(load_instrument(), "F520", 0.0)
    for one, references, n_modes in ((band, 1, 4), (band, 20, 0), (still, 20, 4)):
        assert [float(part) for part in one.factors(0.6, references, n_modes, 0.1)] == [0.0, 1.0, 1.0, 1.0]
    # More modes than references have are as many as they have.
    many, all_of_them = (band.factors(0.6, 20, k, 0.1) for k in (500, 19))
    assert many == all_of_them
    assert many.n_modes == 19
    # Beyond the largest number of references that is known nothing changes.
    monkeypatch.setattr("simulator.signal.speckle_modes.MOST_REFERENCES", 40)
    assert band.factors(0.6, 1e12, 4, 0.1) == band.factors(0.6, 40, 4, 0.1)


def test_the_best_number_of_modes_is_that_of_least_limit(line, monkeypatch):
    modes = line[-1]
    monkeypatch.setattr("simulator.signal.speckle_modes._stored", lambda *_: modes)
    band = BandModes.of(load_instrument(), "F520", 0.05)
    references = np.array([2, 8, 100])
    found = band.factors(0.6, references, 12, 0.3, programme_noise=0.2)
    for i, r in enumerate(references):
        limits = modes.factors(int(r), 0.3, 12).limit(0.2)
        assert found.n_modes[i] == np.argmin(limits) <= min(12, r - 1)
    assert found.n_modes[0] < found.n_modes[2]


def test_factors_are_kept_on_disk_and_the_field_is_not_made_again(line, monkeypatch, tmp_path):
    monkeypatch.setenv("CPIC_CACHE_DIR", str(tmp_path))
    made = []
    monkeypatch.setattr("simulator.signal.speckle_modes._made", lambda *place: made.append(place) or line[-1])
    band = BandModes.of(load_instrument(), "F520", 0.05)
    first = speckle_modes._Stored(band._optics, 0.6, 0.05).factors(40, 0.3, 4)
    many = len(made)
    again = speckle_modes._Stored(band._optics, 0.6, 0.05).factors(40, 0.3, 4)
    assert many == len(made) > 0
    np.testing.assert_array_equal(again.speckle, first.speckle)
    np.testing.assert_allclose(again.speckle, line[-1].factors(40, 0.3, 4).speckle, rtol=1e-12)


def test_numbers_out_of_range_are_refused(line):
    modes = line[-1]
    for references in (0, 2000):
        with pytest.raises(InputError, match="reference_visits"):
            modes.factors(references, 0.1)
    with pytest.raises(InputError, match="noise_over_speckle"):
        modes.factors(8, -0.1)


@pytest.mark.long
@pytest.mark.parametrize(("band", "separation"), [("F520", 0.6), ("F520", 0.85), ("F850", 0.6)])
def test_limits_are_those_of_images_of_other_visits(band, separation):
    """Visits of another seed, subtracted in the annulus, references and science apart from each other."""
    instrument, offset_nm, n = load_instrument(), 0.05, 1200
    psf = single_band_psf(band, instrument=instrument)
    hole, imager = psf.geometry.hole, psf.imager
    rows, columns = (np.flatnonzero(hole.any(axis=axis)) for axis in (1, 0))
    offset = centred_axis(len(hole), imager.pixel_scale_arcsec)
    axes = [imager.axis(offset[part], masked=True) for part in (rows, columns)]
    _, linear, square = visit_responses(imager, *axes, instrument.drift.psd_slope, n, 7)
    stamps = np.zeros((n, *hole.shape))
    stamps[np.ix_(np.arange(n), rows, columns)] = offset_nm * linear + offset_nm**2 * square
    region = psf.geometry.annulus(separation, 2.4)
    images = stamps[:, region] - stamps[:, region].mean(axis=0)
    weights = overlap_weights(psf.geometry.aperture_radius_arcsec / psf.geometry.pixel_scale_arcsec)
    half, wing = len(weights) // 2, len(psf.off_axis) // 2
    own, planets = [], []
    padded = np.pad(region, half)
    for y, x in np.argwhere(region):
        inside = padded[y : y + 2 * half + 1, x : x + 2 * half + 1][weights > 0].all()
        if inside and abs(np.hypot(offset[y], offset[x]) - separation) <= 1.5 * psf.geometry.lambda_d_arcsec:
            stamp, light = np.zeros((2, len(hole) + 2 * wing, len(hole) + 2 * wing))
            stamp[y + wing - half : y + wing + half + 1, x + wing - half : x + wing + half + 1] = weights
            light[y : y + 2 * wing + 1, x : x + 2 * wing + 1] = psf.off_axis
            cut = slice(wing, wing + len(hole))
            own.append(stamp[cut, cut][region])
            planets.append((abs(np.hypot(offset[y], offset[x]) - separation), light[cut, cut][region]))
    own = np.array(own)
    apertures, nearest = own - own.mean(axis=0), np.argsort([distance for distance, _ in planets], kind="stable")[:48]
    sources = np.array([planets[i][1] for i in nearest])
    modes = speckle_modes._made(OpticalBand.of(instrument, band), separation, offset_nm)
    rng = np.random.default_rng(3)
    for noise in (0.1, 0.562):
        pixel = noise * np.sqrt(((images @ apertures.T) ** 2).mean() / (apertures**2).sum(axis=1).mean())
        for references in (32, 200):
            counts = tuple(k for k in (0, 4, 12, 40, 80) if k < references)
            done = Subtraction(apertures, own[nearest], sources, counts)
            for _ in range(6):
                order = rng.permutation(n)
                noisy = images[order] + pixel * rng.standard_normal(images.shape)
                done.add(noisy[:references], noisy[references:])
            found = modes.factors(references, noise).limit(noise)
            np.testing.assert_allclose(found[list(counts)], done.limits, rtol=0.03)
