"""Universes against Kepler's laws at high precision, the law of Poisson, and the promise of common chance."""

import dataclasses
import math

import mpmath
import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.optimize import brentq

from catalogs import ORBIT, OrbitPlaces, load_known_planets, orbit_places, star_key
from cpic_planner.planets import StarLimits, least_mass, load_population
from cpic_planner.survey.universe import (
    BLOCK,
    NEW,
    PlanetSample,
    allowed_probability,
    at_known_place,
    chance,
    draw_planet_sample,
    occurrence,
    star_mass_msun,
)
from cpic_planner.targets import find_target

GIANTS = load_population("giants")
QUANTITIES = [name for name in PlanetSample.__dataclass_fields__ if name not in ("universe", "number")]


def draw(population=GIANTS, *, n=100, star="tau Cet", seed=1, **more):
    return draw_planet_sample(star, 0.8, 0.5, population, epoch_mjd=61771.0, n=n, seed=seed, **more)


def with_rate(rate):
    return GIANTS.model_copy(update={"planets_per_star": rate})


def by_name(bodies):
    """Planets by universe and number."""
    return {
        (int(u), int(j)): tuple(getattr(bodies, name)[row] for name in QUANTITIES)
        for row, (u, j) in enumerate(zip(bodies.universe, bodies.number, strict=True))
    }


def test_more_planets_leave_the_others_where_they_are():
    few, many = by_name(draw(with_rate(0.5))), by_name(draw(with_rate(2.0)))
    assert 0 < len(few) < len(many)
    assert all(many[key] == value for key, value in few.items())


def test_another_law_leaves_the_other_quantities_alone():
    other = load_population({"base": "giants", "radius_rjup": 0.3, "planets_per_star": 0.21})
    one, two = draw(n=2000), draw(other, n=2000)
    assert np.array_equal(one.universe, two.universe)
    for name in QUANTITIES:
        same = np.array_equal(getattr(one, name), getattr(two, name))
        assert same == (name not in ("radius_rjup", "mass_mjup")), name  # the mass is that of the radius


@pytest.mark.parametrize("n", [1, 37, 99, 100, 101, 250])
def test_universes_do_not_depend_on_how_many_follow(n):
    table = load_known_planets()
    rows = table.by_star[star_key("eps Eri")]
    make = {"known": table, "known_rows": rows, "star": "eps Eri"}
    every, some = (
        by_name(draw(with_rate(1.5), n=300 if n > BLOCK else BLOCK, **make)),
        by_name(draw(with_rate(1.5), n=n, **make)),
    )
    if n <= BLOCK:  # what a block of the survey holds
        assert some == {key: value for key, value in every.items() if key[0] < n}
    assert {key[0] for key in some} == set(range(n))


@given(n=st.integers(1, BLOCK), rows=st.integers(1, 4), more=st.integers(0, 4))
def test_chance_grows_at_its_end(n, rows, more):
    whole = chance(5, "stage", 3, shape=(rows + more, BLOCK))
    assert np.array_equal(chance(5, "stage", 3, shape=(rows, n)), whole[:rows, :n])
    assert np.array_equal(chance(5, "stage", shape=(n,)), chance(5, "stage", shape=(BLOCK,))[:n])


def test_same_names_give_the_same_planets_and_others_do_not():
    one = by_name(draw(with_rate(1.0)))
    assert one == by_name(draw(with_rate(1.0)))
    for other in ({"seed": 2}, {"block": 1}, {"stage": "planning"}, {"star": "eps Eri"}):
        drawn = by_name(draw(with_rate(1.0), **other))
        assert drawn.keys() != one.keys() or not any(drawn[key] == one[key] for key in one), other


@pytest.mark.parametrize("rate", [0.21, 1.3, 30.0])
def test_numbers_follow_the_law_of_poisson(rate):
    n = 20_000 if rate < 10 else 2_000
    numbers = np.bincount(draw(with_rate(rate), n=n).universe, minlength=n)
    assert abs(numbers.mean() - rate) < 4.0 * math.sqrt(rate / n)
    # Variance of the sample variance: (mu4 - sigma^4) / n, with mu4 = rate + 3 rate^2.
    assert abs(numbers.var() - rate) < 4.0 * math.sqrt((rate + 2.0 * rate**2) / n)
    none = math.exp(-rate)
    assert abs(np.mean(numbers == 0) - none) < 4.0 * math.sqrt(max(none, 1.0 / n) / n)


def test_one_each():
    bodies = draw(n=500, one_each=True)
    assert np.array_equal(bodies.universe, np.arange(500))
    assert np.all(bodies.number == 0)


def test_the_laws_of_the_population_hold():
    bodies = draw(with_rate(5.0), n=4000)
    for name in ("radius_rjup", "semi_major_axis_au", "eccentricity", "inclination_deg"):
        law, values = getattr(GIANTS, name), np.sort(getattr(bodies, name))
        share = (np.arange(values.size) + 0.5) / values.size
        # Kolmogorov's distance: 1.95 / sqrt(n) is passed once in a thousand.
        expected = np.sort(law.quantile(share))
        reach = np.searchsorted(expected, values) / values.size
        assert np.abs(reach - share).max() < 1.95 / math.sqrt(values.size), name


def test_orbits_follow_insolation_where_they_should():
    population = load_population({"base": "giants", "semi_major_axis_scale": "insolation", "planets_per_star": 0.21})
    near, far = draw(n=2000), draw(population, n=2000)
    np.testing.assert_allclose(far.semi_major_axis_au, math.sqrt(0.5) * near.semi_major_axis_au, rtol=1e-14)


def test_keplers_third_law():
    bodies = draw(with_rate(2.0))
    np.testing.assert_allclose((bodies.period_days / 365.25) ** 2 * 0.8, bodies.semi_major_axis_au**3, rtol=1e-13)


def mpmath_place(a, e, inclination, pericentre, node, mean):
    """East, north and distance to thirty digits."""
    with mpmath.workdps(40):
        a, e = mpmath.mpf(a), mpmath.mpf(e)
        i, w, o, m = (mpmath.mpf(angle) * mpmath.pi / 180 for angle in (inclination, pericentre, node, mean))
        m -= 2 * mpmath.pi * mpmath.nint(m / (2 * mpmath.pi))
        # The equation is monotone: bracketing finds its root for any eccentricity.
        anomaly = mpmath.findroot(lambda x: x - e * mpmath.sin(x) - m, (m - e - 1e-9, m + e + 1e-9), solver="anderson")
        true = 2 * mpmath.atan2(
            mpmath.sqrt(1 + e) * mpmath.sin(anomaly / 2), mpmath.sqrt(1 - e) * mpmath.cos(anomaly / 2)
        )
        r, u = a * (1 - e * mpmath.cos(anomaly)), w + true
        north = r * (mpmath.cos(o) * mpmath.cos(u) - mpmath.sin(o) * mpmath.sin(u) * mpmath.cos(i))
        east = r * (mpmath.sin(o) * mpmath.cos(u) + mpmath.cos(o) * mpmath.sin(u) * mpmath.cos(i))
        return float(east), float(north), float(r)


def bodies_of(a, e, inclination, pericentre, node, mean, period):
    n = len(a)
    zero = np.zeros(n, np.int64)
    elements = (np.asarray(part, float) for part in (a, e, inclination, pericentre, node, mean))
    return PlanetSample(
        universe=np.arange(n),
        number=zero,
        known=np.full(n, NEW),
        kind=zero,
        radius_rjup=np.ones(n),
        mass_mjup=np.ones(n),
        **dict(zip(ORBIT, elements, strict=True)),
        period_days=np.asarray(period, float),
    )


def test_places_after_a_time_to_a_part_in_1e12():
    rng = np.random.default_rng(3)
    e = np.array([0.0, 0.1, 0.5, 0.8, 0.9, 0.97, 0.99, 0.99, 0.99])
    n = e.size
    a, period = rng.uniform(0.5, 10.0, n), np.full(n, 512.0)
    angles = rng.uniform(0.0, 360.0, (3, n))
    mean = rng.uniform(0.0, 360.0, n)
    mean[-2:] = 0.02, 359.99  # at the pericentre, where the planet runs
    bodies = bodies_of(a, e, angles[0] / 2.0, angles[1], angles[2], mean, period)
    for day in (0.0, 3.25, 256.0, 896.0):
        found = bodies.places([day])
        for k in range(n):
            # Days over the period are a power of two: the mean anomaly of the oracle is the one that is meant.
            east, north, r = mpmath_place(
                a[k],
                e[k],
                angles[0, k] / 2.0,
                angles[1, k],
                angles[2, k],
                mpmath.mpf(mean[k]) + mpmath.mpf(360) * day / 512,
            )
            miss = np.hypot(found.east_au[0, k] - east, found.north_au[0, k] - north) / a[k]
            assert miss < 1e-12, (e[k], day, miss)
            assert abs(found.distance_au[0, k] - r) < 1e-12 * a[k]


def test_places_on_many_days_are_those_of_each():
    """They are worked out some days at a time, and there may be no day or no planet."""
    days = np.linspace(0.0, 4000.0, 57)
    a, e, *angles, period = np.random.default_rng(2).uniform(
        [[0.5], [0.0], [0.0], [0.0], [0.0], [0.0], [300.0]],
        [[9.0], [0.9], [180.0], [360.0], [360.0], [360.0], [9000.0]],
        (7, 1500),
    )
    bodies = bodies_of(a, e, *angles, period)
    every = bodies.places(days)
    for name in OrbitPlaces.__dataclass_fields__:
        each = [getattr(bodies.places([day]), name)[0] for day in days]
        np.testing.assert_array_equal(getattr(every, name), each)
        assert getattr(bodies.places([]), name).shape == (0, 1500)
        assert getattr(bodies.select(np.zeros(0, int)).places(days), name).shape == (57, 0)


@given(
    st.lists(
        st.tuples(st.floats(0.1, 20.0), st.floats(0.0, 0.95), st.floats(0.0, 180.0), st.floats(0.0, 360.0)),
        min_size=1,
        max_size=8,
    ),
    st.floats(0.1, 5.0),
    st.floats(1.01, 6.0),
)
def test_within_never_drops_a_planet_that_some_date_shows(orbits, inner, ratio):
    a, e, inclination, pericentre = (np.array(part) for part in zip(*orbits, strict=True))
    bodies = bodies_of(a, e, inclination, pericentre, 0.0 * a, 0.0 * a, 0.0 * a + 100.0)
    kept = bodies.within(inner, inner * ratio)
    around = orbit_places(a, e, inclination, pericentre, 0.0 * a, np.linspace(0.0, 360.0, 1441)[:, None])
    reach = np.hypot(around.east_au, around.north_au)
    shown = ((reach >= inner) & (reach <= inner * ratio)).any(axis=0)
    assert np.all(kept | ~shown)
    assert not np.any(kept & (reach.max(axis=0) < 0.2 * inner) & (e < 0.01))


def test_known_planets_are_in_every_universe():
    table = load_known_planets()
    rows = table.by_star[star_key("tau Cet")]
    bodies = draw(with_rate(1.0), n=60, known=table, known_rows=rows)
    known = bodies.known != NEW
    for number, row in enumerate(rows):
        mine = known & (bodies.number == number)
        assert np.array_equal(np.sort(bodies.universe[mine]), np.arange(60))
        assert np.all(bodies.known[mine] == row)
    assert bodies.number[~known].min() == len(rows)
    assert np.all(bodies.kind[known] == len(GIANTS.mixture))
    alone = draw(None, n=60, known=table, known_rows=rows)
    assert np.array_equal(alone.mean_anomaly_deg, bodies.mean_anomaly_deg[known])
    assert len(draw(None)) == 0


def test_mass_of_the_sun_and_of_known_stars():
    star = find_target("alf Cen A")[0]
    sun = dataclasses.replace(star, log_g=np.array([4.438]), luminosity_lsun=np.array([1.0]), teff_k=np.array([5772.0]))
    assert star_mass_msun(sun)[0] == pytest.approx(1.0, rel=1e-12)
    # Kervella et al. 2016 (A&A 594, A107): 1.133 solar masses.
    assert star_mass_msun(star)[0] == pytest.approx(1.133, rel=0.1)
    for log_g, mass in ((8.0, 5.0), (1.0, 0.2), (np.nan, 1.0)):
        assert star_mass_msun(dataclasses.replace(sun, log_g=np.array([log_g])))[0] == mass


def test_a_population_needs_an_occurrence_rate_that_can_be_drawn(refused):
    assert occurrence(GIANTS) == 0.21
    refused(r"population.planets_per_star = missing", draw, load_population("jupiters"))
    refused(r"planets_per_star = 9000", draw, with_rate(9000.0))


def test_joined_and_selected():
    one, two = draw(with_rate(1.0), n=20), draw(with_rate(1.0), n=20, star="eps Eri")
    both = PlanetSample.joined([one, two])
    assert len(both) == len(one) + len(two)
    assert by_name(both.select(np.arange(len(one)))) == by_name(one)
    assert by_name(both.select(np.arange(len(both)) >= len(one))) == by_name(two)


def test_planets_beyond_the_last_stable_orbit_are_not_there(within_errors):
    """Their share is that of the law of the population beyond it."""
    limits = StarLimits.of(["tau Cet", "eps Eri"], ())
    limits = dataclasses.replace(limits, stable_au=np.array([np.inf, 2.0]))
    bodies = draw(with_rate(5.0), n=4000)
    law = GIANTS.semi_major_axis_au
    share = brentq(lambda part: float(law.quantile(np.array([part]))[0]) - 2.0, 0.0, 1.0)
    assert 0.2 < share < 0.8
    assert np.all(allowed_probability(bodies, limits, 0) == 1.0)
    allowed = allowed_probability(bodies, limits, 1)
    assert np.array_equal(allowed, (bodies.semi_major_axis_au <= 2.0).astype(float))
    within_errors(allowed, share)


def test_velocities_leave_the_planets_that_are_too_light_or_seen_pole_on(within_errors):
    """A sharp limit in m sin i leaves ``1 - sqrt(1 - (limit / m)^2)`` of isotropic orbits."""
    limits = StarLimits.of(["tau Cet"], ())
    sharp = {"log_m50": np.log(0.2), "log_m90": np.log(0.2) + 1e-6, "ceiling": 1.0}
    columns = {name: np.full_like(limits.ceiling, value) for name, value in sharp.items()}
    limits = dataclasses.replace(limits, **columns, reach_au=np.array([np.inf]))
    bodies = draw(with_rate(5.0), n=4000)
    left = 0.2 / bodies.mass_mjup
    share = np.where(left >= 1.0, 1.0, 1.0 - np.sqrt(1.0 - np.minimum(left, 1.0) ** 2))
    assert 0.05 < share.min() < share.max() == 1.0
    within_errors(allowed_probability(bodies, limits, 0) - share, 0.0)


def test_the_mass_is_that_of_the_radius():
    bodies = draw(with_rate(5.0), n=300)
    np.testing.assert_allclose(bodies.mass_mjup, least_mass(bodies.radius_rjup), rtol=1e-12)


def test_known_planets_are_always_there(excluding):
    table = load_known_planets()
    rows = table.by_star[star_key("eps Eri")]
    bodies = draw(with_rate(1.0), star="eps Eri", known=table, known_rows=rows)
    allowed = allowed_probability(bodies, excluding(["eps Eri"], 1.0), 0)
    assert np.array_equal(allowed, (bodies.known != NEW).astype(float))


def test_a_star_whose_planet_is_refuted_has_none():
    table = load_known_planets()
    bodies = draw(None, star="omi2 Eri", known=table, known_rows=table.rows_of("omi2 Eri"))
    assert len(bodies) == 0
    before = load_known_planets("archive_2019")
    assert len(draw(None, star="omi2 Eri", known=before, known_rows=before.rows_of("omi2 Eri"))) > 0


def test_radial_velocities_alone_give_no_place_on_the_sky(tmp_path):
    table = load_known_planets()
    rows = table.rows_of("pi Men")  # dated, inclination unknown
    assert len(rows) == 2
    assert not at_known_place(draw(star="pi Men", known=table, known_rows=rows), table).any()
    rows = table.rows_of("eps Eri")  # by astrometry the node is known as well, within 12 deg: 0.2 arcsec on the sky
    assert not at_known_place(draw(star="eps Eri", known=table, known_rows=rows), table).any()
    file = tmp_path / "orbits.csv"
    file.write_text(
        "star,planet,period_days,period_err_days,periastron_jd,periastron_err_days,eccentricity,omega_star_deg,"
        "inclination_deg,inclination_err_deg,node_deg,node_err_deg,mass_mjup\n"
        "eps Eri,eps Eri b,2502,10,2454207,7,0.4,50,40,1,70,2,0.8\n"
        "eps Eri,eps Eri c,9999,10,2454207,7,0.1,50,40,1,,,0.8\n"
        "eps Eri,eps Eri d,2502,10,2454207,7,0.4,50,40,1,70,3,0.8\n"
        "eps Eri,eps Eri f,2502,10,2454207,20,0.4,50,40,1,70,2,0.8\n"
    )
    own = load_known_planets(f"none+{file}")
    bodies = draw(star="eps Eri", known=own, known_rows=own.rows_of("eps Eri"))
    assert np.array_equal(at_known_place(bodies, own), bodies.known == 0)
    assert not at_known_place(bodies, None).any()
