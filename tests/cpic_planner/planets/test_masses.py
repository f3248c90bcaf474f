"""The mass-radius relation against its published numbers."""

import numpy as np
import pytest

from cpic_planner.planets.masses import STAR_MJUP, least_mass, radius_from_mass

M_EARTH_KG, M_JUP_KG, M_SUN_KG = 5.9722e24, 1.89813e27, 1.98841e30
R_EARTH_KM, R_JUP_KM = 6378.1, 71492.0


def published(mass_mjup):
    """Chen & Kipping 2017, Table 1: constant of the Terran law, then each law from where the one before ends."""
    earths = mass_mjup * M_JUP_KG / M_EARTH_KG
    giants = 0.414 * M_JUP_KG / M_EARTH_KG
    if earths <= 2.04:
        radius = 1.008 * earths**0.2790
    elif earths <= giants:
        radius = 1.008 * 2.04**0.2790 * (earths / 2.04) ** 0.589
    else:
        radius = 1.008 * 2.04**0.2790 * (giants / 2.04) ** 0.589 * (earths / giants) ** -0.044
    return radius * R_EARTH_KM / R_JUP_KM


def test_radii_of_all_kinds():
    masses = np.geomspace(1e-4, 80.0, 400)
    expected = [published(mass) for mass in masses]
    np.testing.assert_allclose(radius_from_mass(masses), expected, rtol=1e-4)
    assert radius_from_mass(M_EARTH_KG / M_JUP_KG) == pytest.approx(1.008 * R_EARTH_KM / R_JUP_KM, rel=1e-4)


def test_stars_begin_at_eight_hundredths_of_the_sun():
    assert pytest.approx(0.080 * M_SUN_KG / M_JUP_KG, rel=1e-3) == STAR_MJUP


@pytest.mark.parametrize(("mass_mjup", "share"), [(0.003, 0.0403), (0.1, 0.1460), (1.0, 0.0737)])
def test_scatter_is_that_of_the_kind(mass_mjup, share):
    ratio = radius_from_mass(mass_mjup, [-1.0, 1.0]) / radius_from_mass(mass_mjup)
    np.testing.assert_allclose(np.log(ratio), [-share, share], rtol=1e-12)


def test_the_least_mass_has_the_radius_and_no_lighter_planet_has():
    radii = np.linspace(0.03, 1.27, 200)
    masses = least_mass(radii)
    np.testing.assert_allclose(radius_from_mass(masses), radii, rtol=1e-12)
    for radius, mass in zip(radii, masses, strict=True):
        assert radius_from_mass(np.geomspace(1e-6, 0.999 * mass, 50)).max() < radius


def test_a_radius_beyond_the_largest_has_the_mass_of_the_largest():
    assert least_mass([1.3, 2.0, 10.0]).tolist() == pytest.approx([0.414] * 3, rel=1e-12)
