"""Which planets may still be there: closed forms of the law, an independent loop, companion stars, known giants."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import quad

from catalogs import VELOCITY_AXES_AU, load_known_planets, stability_limit, velocity_limit
from cpic_planner.planets import StarLimits, excluded_by_rv
from cpic_planner.planets.allowed import EXCLUDED_BELOW
from cpic_planner.queries import EXCLUSIONS

STARS = ("tau Cet", "61 Cyg A", "eps Eri", "alf CMi", "36 Oph A", "eps Ind", "bet Hyi", "nobody")


def found_by_hand(star, axis_au, msini_mjup):
    """The law in plain floating point, from the row of the star."""
    limit = velocity_limit(star)
    if limit is None or axis_au > limit.reach_au:
        return 0.0
    axes = VELOCITY_AXES_AU
    if axis_au <= axes[0]:
        numbers = [(limit.m50_mjup[0], limit.m90_mjup[0], limit.ceiling[0])]
        m50, m90, ceiling = numbers[0]
    else:
        j = max(i for i in range(len(axes) - 1) if axes[i] <= axis_au)
        t = math.log(axis_au / axes[j]) / math.log(axes[j + 1] / axes[j])
        m50 = limit.m50_mjup[j] ** (1 - t) * limit.m50_mjup[j + 1] ** t
        m90 = limit.m90_mjup[j] ** (1 - t) * limit.m90_mjup[j + 1] ** t
        ceiling = limit.ceiling[j] * (1 - t) + limit.ceiling[j + 1] * t
    if msini_mjup == 0.0:
        return 0.0
    return ceiling / (1.0 + (m50 / msini_mjup) ** (math.log(9.0) / math.log(m90 / m50)))


def beside_giant_by_hand(star, axis_au, mass_mjup):
    """Nearer than 2 sqrt(3) mutual Hill radii to what a confirmed giant covers between pericentre and apocentre."""
    known = load_known_planets()
    star_mass = {"eps Eri": 0.86, "eps Ind": 0.68, "tau Cet": 0.80, "61 Cyg A": 0.66}
    for row in known.rows_of(star):
        of_giant = known.number("mass_mjup")[row]
        if not math.isfinite(of_giant):
            of_giant = known.number("msini_mjup")[row]
        if known.text("status")[row] != "confirmed" or not of_giant >= 0.1:
            continue
        a, e = known.number("semi_major_axis_au")[row], known.number("eccentricity")[row]
        hill = ((mass_mjup + of_giant) * 9.5459e-4 / (3 * star_mass[star])) ** (1 / 3) * (a + axis_au) / 2
        if axis_au + 2 * math.sqrt(3) * hill >= a * (1 - e) and axis_au - 2 * math.sqrt(3) * hill <= a * (1 + e):
            return True
    return False


def test_limits_of_the_fits_are_recovered():
    limits = StarLimits.of(STARS)
    for i, star in enumerate(STARS):
        limit = velocity_limit(star)
        if limit is None:
            continue
        within = np.array(VELOCITY_AXES_AU) <= limit.reach_au
        axes, ceiling = np.array(VELOCITY_AXES_AU)[within], np.array(limit.ceiling)[within]
        for masses, share in ((limit.m50_mjup, 0.5), (limit.m90_mjup, 0.9)):
            missed = limits.missed_probability(np.full(len(axes), i), axes, np.array(masses)[within], 90.0)
            np.testing.assert_allclose(missed, 1.0 - share * ceiling, rtol=0, atol=1e-9)
        # The same by the inclination: twice the mass at 30 deg.
        half = limits.missed_probability(np.full(len(axes), i), axes, 2.0 * np.array(limit.m50_mjup)[within], 30.0)
        np.testing.assert_allclose(half, 1.0 - 0.5 * ceiling, rtol=0, atol=1e-9)


@pytest.mark.parametrize("star", ["tau Cet", "eps Eri"])
def test_against_a_loop_over_planets(star):
    """Drawn planets one by one, in plain arithmetic."""
    random = np.random.default_rng(3)
    n = 400
    axis, mass = np.exp(random.uniform(np.log(0.2), np.log(20.0), n)), np.exp(random.uniform(-4, 2, n))
    tilt = np.rad2deg(np.arccos(random.uniform(-1, 1, n)))
    found = StarLimits.of([star]).allowed_probability(np.zeros(n, int), axis, mass, tilt)
    pair = stability_limit(star)
    expected = []
    for a, m, i in zip(axis, mass, tilt, strict=True):
        chance = 1.0 - found_by_hand(star, a, m * math.sin(math.radians(i)))
        if pair is not None and pair.critical_au < a < pair.circumbinary_au:
            chance = 0.0
        expected.append(0.0 if beside_giant_by_hand(star, a, m) else chance)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    assert 0.0 < np.mean(expected) < 0.9
    forbidden = [beside_giant_by_hand(star, a, m) for a, m in zip(axis, mass, strict=True)]
    assert any(forbidden) == (star == "eps Eri")


def test_heavier_planets_and_steeper_orbits_are_never_easier_to_miss():
    limits = StarLimits.of(["61 Cyg A"])
    masses = np.geomspace(1e-3, 100.0, 300)
    missed = limits.missed_probability(np.zeros(300, int), 2.0, masses, 60.0)
    assert np.all(np.diff(missed) <= 0.0)
    tilted = limits.missed_probability(np.zeros(91, int), 2.0, 0.3, np.arange(91.0))
    assert np.all(np.diff(tilted) <= 0.0)
    assert tilted[0] == 1.0


def test_nothing_is_excluded_beyond_the_reach_or_without_velocities():
    limits = StarLimits.of(STARS)
    for star in ("tau Cet", "bet Hyi"):
        reach = velocity_limit(star).reach_au
        at = np.array([STARS.index(star)])
        assert limits.missed_probability(at, reach * (1 + 1e-9), 50.0, 90.0) == 1.0
        assert limits.missed_probability(at, reach * (1 - 1e-9), 50.0, 90.0) < 0.2
    for star in ("alf CMi", "nobody"):
        assert limits.missed_probability(np.array([STARS.index(star)]), 1.0, 80.0, 90.0) == 1.0


def test_companion_stars_leave_room_inside_and_around():
    """Procyon: 2.8 au, 0.80 arcsec. 36 Oph, outside the range of the fit: nothing in the field of 0.23 to 1 arcsec."""
    limits = StarLimits.of(["alf CMi", "36 Oph A", "chi Dra", "tau Cet"])
    procyon = limits.allowed_probability(np.zeros(4, int), [1.0, 2.7, 3.0, 10.0], 0.2, 60.0)
    assert procyon.tolist() == [1.0, 1.0, 0.0, 0.0]
    assert not limits.allowed_probability(np.ones(30, int), np.linspace(0.23, 1.0, 30) * 5.93, 0.2, 60.0).any()
    # chi Dra, 1 au and e = 0.4: nothing around one star alone, something around both far outside.
    around = limits.allowed_probability(np.full(3, 2), [0.5, 2.0, 5.0], 0.2, 60.0)
    assert around[:2].tolist() == [0.0, 0.0]
    assert around[2] > 0.0
    assert limits.stable_au[3] == np.inf


def test_planets_beside_a_known_giant():
    """eps Eri b, 3.5 au and one Jupiter mass, leaves 2.52 au and what is inside."""
    limits = StarLimits.of(["eps Eri"], ["known_giants"])
    axis = np.array([1.0, 2.4, 2.7, 3.5, 4.5, 6.0])
    assert limits.allowed_probability(np.zeros(6, int), axis, 0.2, 60.0).tolist() == [1.0, 1.0, 0.0, 0.0, 0.0, 1.0]


def test_what_does_not_count_excludes_nothing():
    star, axis, mass, tilt = np.arange(len(STARS)), 3.0, 0.3, 60.0
    assert StarLimits.of(STARS, ()).allowed_probability(star, axis, mass, tilt).tolist() == [1.0] * len(STARS)
    alone = [StarLimits.of(STARS, [name]).allowed_probability(star, axis, mass, tilt) for name in EXCLUSIONS]
    np.testing.assert_allclose(
        StarLimits.of(STARS).allowed_probability(star, axis, mass, tilt), np.prod(alone, axis=0), rtol=1e-14
    )
    assert all((part < 1.0).any() for part in alone)


def test_the_reference_planet_is_excluded_where_its_mean_chance_says_so():
    """Mean over isotropic poles, by adaptive quadrature of the law by hand."""
    for star, axis, mass in (("tau Cet", 1.7, 0.274), ("61 Cyg A", 3.0, 0.274), ("eps Eri", 1.0, 0.274)):
        mean, _ = quad(lambda c: 1.0 - found_by_hand(star, axis, mass * math.sqrt(1 - c * c)), 0, 1, limit=400)  # noqa: B023
        excluded = StarLimits.of([star]).excluded_by_velocities(np.array([0]), axis, mass)[0]
        assert excluded == (mean < EXCLUDED_BELOW)
        assert abs(mean / EXCLUDED_BELOW - 1.0) > 0.02
    # One Jupiter radius is 0.27 Jupiter masses or more.
    assert excluded_by_rv(["tau Cet", "61 Cyg A", "alf CMi"], [1.7, 3.0, 1.7], 1.0).tolist() == [True, False, False]


def test_the_hash_is_that_of_the_numbers():
    one, again, other = (StarLimits.of(names).digest() for names in (["tau Cet"], ["HD 10700"], ["eps Eri"]))
    assert one == again != other
    shifted = StarLimits.of(["tau Cet"])
    shifted = dataclasses.replace(shifted, reach_au=shifted.reach_au + 1.0)
    assert shifted.digest() != one
