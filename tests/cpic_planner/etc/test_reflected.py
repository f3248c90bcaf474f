"""Reflected light of many planets against one planet at a time."""

import numpy as np
import pytest

from cpic_planner.etc.model import build_model
from cpic_planner.etc.reflected import (
    insolation_distance_au,
    kinds_by_albedo,
    mixture_contrast,
    reflected_contrast,
    reflected_share,
)
from cpic_planner.targets import rank_sample
from simulator import load_instrument, planet_contrast
from simulator.config.albedo import ConstantAlbedo, MeasuredAlbedo, ParametricAlbedo
from simulator.target.albedo import albedo_source

MIXTURE = (
    ConstantAlbedo(value=0.3),
    ParametricAlbedo(log10_mh=0.5, log10_fsed=0.5),
    MeasuredAlbedo(model="jupiter"),
    ConstantAlbedo(value=0.3),
)


@pytest.fixture(scope="module")
def model():
    return build_model(load_instrument(), ("F662",))


@pytest.fixture(scope="module")
def stars():
    return rank_sample().select([0, 5, 40])


def drawn(n_stars, k, seed=0):
    rng = np.random.default_rng(seed)
    return (
        rng.integers(0, len(MIXTURE), (n_stars, k)),
        rng.uniform(0.3, 1.5, (n_stars, k)),
        rng.uniform(0.5, 8.0, (n_stars, k)),
        rng.uniform(5.0, 170.0, (n_stars, k)),
    )


def test_a_constant_albedo_is_the_papers_equation(model, stars):
    _, radius, distance, phase = drawn(len(stars), 7)
    found = reflected_contrast(model, stars, "F662", MIXTURE[0], radius, distance, phase)
    projected = distance * np.sin(np.radians(phase))
    np.testing.assert_allclose(found, planet_contrast(radius, projected, 0.0 * projected, phase, 0.3), rtol=1e-12)


def test_every_planet_of_a_mixture_is_what_it_is_alone(model, stars):
    kind, radius, distance, phase = drawn(len(stars), 11)
    found = mixture_contrast(model, stars, "F662", MIXTURE, kind, radius, distance, phase)
    for i in range(len(stars)):
        for j in range(kind.shape[1]):
            alone = reflected_contrast(
                model,
                stars.select([i]),
                "F662",
                MIXTURE[kind[i, j]],
                radius[i, j],
                distance[i, j][None, None],
                phase[i, j],
            )
            assert found[i, j] == pytest.approx(float(alone[0, 0]), rel=1e-12)


def test_an_albedo_that_follows_the_insolation_takes_that_of_its_star(model, stars):
    """The same insolation at stars of another luminosity is another distance."""
    own = np.array([[1.0, 5.0]])
    distance = own * np.sqrt(stars.luminosity_lsun)[:, None]
    np.testing.assert_allclose(insolation_distance_au(stars, distance), np.broadcast_to(own, (3, 2)), rtol=1e-14)
    share = reflected_share(model, stars, "F662", MIXTURE[1], distance, 0.0)
    albedo = model.passbands.band_albedo(
        albedo_source(MIXTURE[1]),
        stars.teff_k[:, None],
        stars.log_g[:, None],
        stars.metallicity[:, None],
        insolation_au=own,
        only="F662",
    )
    # At full phase the share is the geometric albedo.
    np.testing.assert_allclose(share, albedo, rtol=1e-9)
    assert np.all(np.abs(share[:, 0] / share[:, 1] - 1.0) > 0.01)


def test_kinds_of_one_albedo_go_together():
    assert kinds_by_albedo(MIXTURE) == [(MIXTURE[0], [0, 3]), (MIXTURE[1], [1]), (MIXTURE[2], [2])]
