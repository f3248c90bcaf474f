"""Laws of the tracks: chords, charge, width, texture.

Landau's law against its integral form and published numbers.
"""

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from simulator.effects.cosmic_rays import (
    PaperModel,
    PhysicalModel,
    cut_landau,
    cut_landau_mean,
    paper_charges,
    whole_electrons,
)

N = 200_000


@pytest.fixture(params=["physical", "paper"])
def model(request, cosmic):
    config = cosmic(request.param)
    return {"physical": PhysicalModel, "paper": PaperModel}[request.param](getattr(config, request.param), 13.0)


def test_chords_of_an_isotropic_flux(model, rng):
    tracks = model.tracks(N, rng)
    depth, longest = model.config.depth_um, model.config.max_length_um
    assert tracks.length_um.min() >= depth
    assert tracks.length_um.max() <= longest
    # The square of the cosine is uniform above that of the longest chord.
    least = (depth / longest) ** 2
    assert stats.kstest((depth / tracks.length_um) ** 2, stats.uniform(least, 1.0 - least).cdf).pvalue > 1e-3
    # The density of L at the median is 1 / (sqrt(2) d).
    error = np.sqrt(2.0) * depth * 0.5 / np.sqrt(N)
    assert abs(np.median(tracks.length_um) - depth * np.sqrt(2.0 / (1.0 + least))) < 4.5 * error
    np.testing.assert_allclose(tracks.projected_um, np.sqrt(tracks.length_um**2 - depth**2), rtol=1e-9, atol=1e-6)


def test_isotropic_flux_by_brute_force(cosmic, rng):
    # Directions uniform on the sphere, hits weighted with the cosine: the chord is depth / cosine.
    depth = cosmic("physical").physical.depth_um
    cosine = rng.random(400_000)
    chord = depth / cosine[rng.random(cosine.size) < cosine]
    tracks = PhysicalModel(cosmic("physical").physical, 13.0).tracks(N, rng)
    assert stats.ks_2samp(chord[chord < 1000.0], tracks.length_um).pvalue > 1e-3


def test_mean_track_of_the_paper(cosmic):
    config = cosmic("paper").paper
    assert 2 * config.depth_um / (1 + config.depth_um / config.max_length_um) == pytest.approx(200.0, rel=0.006)


def test_physical_charge_is_proportional_to_length(cosmic, rng):
    config = cosmic("physical").physical
    model = PhysicalModel(config, 13.0)
    tracks = model.tracks(N, rng)
    loss = model.charges(tracks, rng) / tracks.length_um
    assert abs(loss.mean() - config.mean_loss_e_um) < 4.5 * loss.std() / np.sqrt(N)
    # Most probable loss: lambda = -0.2228 of Landau's law.
    expected = config.mean_loss_e_um + config.loss_width_e_um * (-0.2228 - cut_landau_mean(config.loss_cut))
    counts, edges = np.histogram(loss, bins=np.arange(0.0, 200.0, 2.0))
    assert abs(edges[counts.argmax()] + 1.0 - expected) < 4.0
    short, long = loss[tracks.length_um < 16.0], loss[tracks.length_um > 40.0]
    assert abs(short.mean() - long.mean()) < 4.5 * np.hypot(
        short.std() / np.sqrt(short.size), long.std() / np.sqrt(long.size)
    )
    mean_charge = config.mean_loss_e_um * 2 * config.depth_um / (1 + config.depth_um / config.max_length_um)
    assert 2300 < mean_charge < 2700  # a thin layer leaves about what the paper quotes


def test_loss_without_fluctuations_is_exact(cosmic, rng):
    model = PhysicalModel(cosmic("physical", physical={"loss_width_e_um": 0.0}).physical, 13.0)
    tracks = model.tracks(1000, rng)
    np.testing.assert_array_equal(model.charges(tracks, rng), np.rint(85.0 * tracks.length_um))
    assert np.ptp(model.points(tracks, rng).weight) == 0.0


def density(x, knee, index):
    return np.exp(-x) if x <= knee else np.exp(-knee) * (x / knee) ** -index


@pytest.mark.parametrize(("knee", "index"), [(3.0, 4.0), (0.5, 3.5), (10.0, 6.0)])
def test_paper_charge_is_exponential_with_a_power_law_tail(cosmic, rng, knee, index):
    config = cosmic("paper", paper={"tail_start": knee, "tail_index": index}).paper
    charge = paper_charges(N, config, rng)
    assert charge.min() >= 0.0
    assert abs(charge.mean() - 2700.0) < 4.5 * charge.std() / np.sqrt(N)

    # Oracle by quadrature: norm and mean of the density, then its distribution.
    def integral(low, power=0):
        parts = [(low, knee), (knee, np.inf)] if low < knee else [(low, np.inf)]
        return sum(quad(lambda x: x**power * density(x, knee, index), *part, limit=200)[0] for part in parts)

    norm, scale = integral(0.0), 2700.0 * integral(0.0) / integral(0.0, power=1)
    for x in (0.3 * knee, 0.9 * knee, 1.1 * knee, 2.0 * knee, 5.0 * knee):
        share = integral(x) / norm
        assert abs((charge > x * scale).mean() - share) < 4.5 * np.sqrt(share * (1 - share) / N)


def test_paper_charge_does_not_know_the_length(cosmic, rng):
    model = PaperModel(cosmic("paper").paper, 13.0)
    tracks = model.tracks(N, rng)
    charge = model.charges(tracks, rng)
    assert abs(stats.spearmanr(charge, tracks.length_um).statistic) < 4.5 / np.sqrt(N)


def test_paper_width_varies(cosmic, rng):
    sigma = PaperModel(cosmic("paper").paper, 13.0).tracks(N, rng).sigma_pixels
    assert np.median(sigma) == pytest.approx(4.5 / 13.0, rel=0.005)
    assert np.log(sigma).std() == pytest.approx(0.3, rel=0.02)
    assert sigma.max() <= 4.5 / 13.0 * np.exp(0.9) * (1 + 1e-12)
    fixed = PaperModel(cosmic("paper", paper={"width_rms": 0.0}).paper, 13.0).tracks(1000, rng).sigma_pixels
    np.testing.assert_allclose(fixed, 4.5 / 13.0, rtol=1e-12)


def test_texture_modulates_along_the_track_and_stays_positive(cosmic, rng):
    for rms in (0.0, 0.2, 1.0):
        model = PaperModel(cosmic("paper", paper={"texture_rms": rms}).paper, 13.0)
        tracks = model.tracks(2000, rng)
        long = tracks[tracks.projected_um > 300.0]
        points = model.points(long, rng)
        assert points.weight.min() > 0.0
        if rms < 0.5:  # no clipping to speak of
            each = [part.std() for part in np.split(points.weight, points.start[1:-1])]
            assert np.mean(each) == pytest.approx(rms, abs=0.02)


def test_points_lie_evenly_on_the_projected_track(model, rng):
    tracks = model.tracks(500, rng)
    points = model.points(tracks, rng)
    np.testing.assert_array_equal(np.diff(points.start), model.point_counts(tracks))
    for i in (0, 17, 499):
        along = points.along[points.start[i] : points.start[i + 1]]
        length = tracks.projected_um[i] / 13.0
        assert along.mean() == pytest.approx(0.0, abs=1e-9)
        np.testing.assert_allclose(np.ptp(along), length * (1 - 1 / along.size), atol=1e-9)
        assert length / along.size <= max(tracks.sigma_pixels[i], 0.2) * (1 + 1e-12)
    assert not points.across.any()


def test_reach_holds_every_track(model, rng):
    tracks = model.tracks(N, rng)
    assert (tracks.half_pixels + 4.0 * tracks.sigma_pixels).max() <= model.reach_pixels


def test_whole_electrons_are_at_least_one():
    np.testing.assert_array_equal(whole_electrons(np.array([0.0, 0.4, 1.5, 2.6, 1e15])), [1, 1, 2, 3, 10**15])


CUT = 65.0


def survival(x):
    """P(lambda > x) from the Laplace form of the law, by Gauss-Legendre quadrature in panels."""
    nodes, weights = np.polynomial.legendre.leggauss(20)
    edges = np.linspace(0.0, 70.0, 351)
    t = (edges[:-1, None] + np.diff(edges)[:, None] * 0.5 * (1.0 + nodes)).ravel()
    measure = (np.diff(edges)[:, None] * 0.5 * weights).ravel() * np.sin(np.pi * t) / (np.pi * t)
    return np.exp(-t * np.log(t) - np.multiply.outer(np.asarray(x, dtype=float), t)) @ measure


def test_oracle_is_landaus_law():
    # Published: median 1.3558, most probable value -0.2228.
    assert survival(1.3557804) == pytest.approx(0.5, abs=1e-6)
    x = np.linspace(-0.6, 0.2, 401)
    density = -np.gradient(survival(x), x)
    assert x[density.argmax()] == pytest.approx(-0.2228, abs=0.005)


@pytest.mark.parametrize("x", [-2.0, -1.0, 0.0, 1.3557804, 5.0, 20.0, 50.0])
def test_draws_follow_the_law(x):
    n = 400_000
    draws = cut_landau(n, CUT, np.random.default_rng(3))
    expected = 1.0 - (survival(x) - survival(CUT)) / (1.0 - survival(CUT))
    assert abs((draws <= x).mean() - expected) < 4.5 * np.sqrt(expected * (1.0 - expected) / n)


def test_draws_stay_below_the_cut_and_are_finite():
    draws = cut_landau(1_000_000, 3.0, np.random.default_rng(4))
    assert np.isfinite(draws).all()
    assert draws.max() <= 3.0
    assert draws.min() > -5.0


@pytest.mark.parametrize("cut", [1.0, 10.0, 65.0, 200.0])
def test_mean_of_the_cut_law(cut):
    # Integration by parts: E = cut - integral(F) / F(cut); F is below 1e-9 at -4.
    nodes, weights = np.polynomial.legendre.leggauss(20)
    edges = np.linspace(-4.0, cut, 60)
    x = edges[:-1, None] + np.diff(edges)[:, None] * 0.5 * (1.0 + nodes)
    area = float(np.sum(np.diff(edges)[:, None] * 0.5 * weights * (1.0 - survival(x))))
    assert cut_landau_mean(cut) == pytest.approx(cut - area / (1.0 - survival(cut)), abs=1e-6)


def test_mean_grows_as_the_logarithm_of_the_cut():
    # The tail is 1 / lambda^2: E = ln(cut) - (1 - Euler's constant) + O(ln(cut) / cut).
    assert cut_landau_mean(600.0) == pytest.approx(
        np.log(600.0) - 1.0 + np.euler_gamma, abs=1.5 * np.log(600.0) / 600.0
    )


def test_mean_is_that_of_the_draws():
    draws = cut_landau(1_000_000, CUT, np.random.default_rng(5))
    assert abs(draws.mean() - cut_landau_mean(CUT)) < 4.5 * draws.std() / 1000.0
