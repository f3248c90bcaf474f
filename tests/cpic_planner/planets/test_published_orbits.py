"""What published orbits say: moments in closed form, elements of many draws, and fits of velocities with images."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from catalogs import load_known_planets
from catalogs.orbits import eccentric_anomaly
from cpic_planner.planets import OrbitingPlanets, PublishedOrbit, orbit_quality, published_orbit
from cpic_planner.planets.published_orbits import regular_elements

EPOCH = 61_771.0
COLUMNS = "P,P_err,tp,periastron_err,e,e_err,omega_star_deg,omega_err_deg,star_mass_msun,mass,mass_err"
ANY = np.pi / np.sqrt(3.0)


@pytest.fixture
def table_of(tmp_path):
    def make(**values):
        path = tmp_path / "planets.csv"
        path.write_text(f"star,planet,{','.join(values)}\ns,s b,{','.join(map(str, values.values()))}\n")
        return load_known_planets(f"none+{path}")

    return make


VELOCITIES = {
    "P": 2700.0,
    "P_err": 27.0,
    "tp": 2_400_000.5 + EPOCH - 900.0,
    "periastron_err": 60.0,
    "e": 0.3,
    "e_err": 0.03,
    "omega_star_deg": 70.0,
    "omega_err_deg": 6.0,
    "msini": 1.0,
    "star_mass_msun": 0.82,
}


def planets(n=1, **values):
    own = {
        "semi_major_axis_au": 3.0,
        "eccentricity": 0.3,
        "inclination_deg": 50.0,
        "argument_of_pericentre_deg": 40.0,
        "node_deg": 110.0,
        "mean_anomaly_deg": 20.0,
    } | values
    named = {name: np.broadcast_to(np.asarray(value, float), (n,)).copy() for name, value in own.items()}
    return OrbitingPlanets(radius_rjup=np.ones(n), **named)


def test_moments_are_those_of_the_published_errors(table_of):
    found = published_orbit(table_of(**VELOCITIES), 0, epoch_mjd=EPOCH)
    wide = np.sqrt(np.diag(found.spread))
    period, omega = 27.0 / 2700.0, np.deg2rad(6.0)
    # M = 2 pi (t - T) / P at t - T = 900 d, and omega by itself.
    turn = 2.0 * np.pi / 2700.0
    phase = np.sqrt((turn * 60.0) ** 2 + (turn * 900.0 * period) ** 2 + omega**2)
    # The isotropic pole: tan(i/2) has mean square 2 ln 2 - 1 and mean pi/2 - 1.
    tilt = np.sqrt(2.0 * np.log(2.0) - 1.0 - (np.pi / 2.0 - 1.0) ** 2)
    # 2000 draws: a width is known to 1.6 %.
    assert wide == pytest.approx([period, 0.03, omega, tilt, ANY, phase], rel=0.064)
    correlation = found.spread / np.outer(wide, wide)
    assert correlation[2, 5] == pytest.approx(omega / phase, abs=0.09)
    assert correlation[0, 5] == pytest.approx(-turn * 900.0 * period / phase, abs=0.09)
    assert not found.of_axis
    assert found.period_error() == pytest.approx(period, rel=0.064)


def test_what_is_published_without_an_error_says_nothing(table_of):
    bare = {name: value for name, value in VELOCITIES.items() if "err" not in name}
    found = published_orbit(table_of(**bare, inclination=60.0, node=20.0), 0, epoch_mjd=EPOCH)
    assert np.sqrt(np.diag(found.spread)) == pytest.approx([1.05, 0.33, ANY, 0.44, ANY, ANY], rel=0.05)
    assert (found.spread[0, 1:] == 0.0).all()


def test_an_imaged_planet_is_known_by_its_axis(table_of):
    found = published_orbit(table_of(a=9.0, a_err=0.45, star_mass_msun=1.7, mass=9.0), 0, epoch_mjd=EPOCH)
    assert found.of_axis
    assert np.sqrt(found.spread[0, 0]) == pytest.approx(0.05, rel=0.064)
    assert found.period_error(0.1) == pytest.approx(np.hypot(1.5 * 0.05, 0.5 * 0.1), rel=0.064)


@pytest.mark.parametrize("tilt", [50.0, 130.0])
@pytest.mark.parametrize("of_axis", [False, True])
def test_covariance_is_that_of_the_elements_of_many_orbits(tilt, of_axis):
    """Orbits drawn about a true one, turned into regular elements one by one."""
    rng, n, true = np.random.default_rng(1), 40_000, planets(inclination_deg=tilt)
    mix = rng.normal(size=(6, 6)) * np.array([3, 0.3, 3, 0.3, 3, 3])[:, None] * 1e-3
    y, mass = rng.normal(size=(n, 6)) @ mix.T, 0.002 * rng.normal(size=n)
    around = np.deg2rad(true.mean_anomaly_deg + true.argument_of_pericentre_deg)
    omega = np.deg2rad(true.argument_of_pericentre_deg) + y[:, 2]
    half = np.arctan(np.tan(np.deg2rad(0.5 * min(tilt, 180.0 - tilt))) + y[:, 3])
    log_period = np.log(2000.0) + (1.5 * y[:, 0] - 0.5 * mass if of_axis else y[:, 0])
    drawn = planets(
        n,
        semi_major_axis_au=3.0 * np.exp(y[:, 0] if of_axis else (2.0 * y[:, 0] + mass) / 3.0),
        eccentricity=0.3 + y[:, 1],
        inclination_deg=np.rad2deg(2.0 * half) if tilt < 90.0 else 180.0 - np.rad2deg(2.0 * half),
        argument_of_pericentre_deg=np.rad2deg(omega),
        node_deg=110.0 + np.rad2deg(y[:, 4]),
        mean_anomaly_deg=np.rad2deg(around + y[:, 5] - omega),
    )
    expected = np.cov(regular_elements(drawn, np.exp(log_period), np.zeros(n)).T)
    found = PublishedOrbit(mix @ mix.T, of_axis).covariance(true, np.array([2000.0]), 0.002)[0]
    # What e and tan(i/2) have across their directions, and the least error, are small here, and no part of the draws.
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert found / scale == pytest.approx(expected / scale, abs=0.04)


def test_a_circle_from_its_pole_has_errors_in_all_directions():
    spread = np.diag([0.01, 0.05, 0.1, 0.1, 0.1, 0.1]) ** 2
    flat = planets(eccentricity=0.0, inclination_deg=0.0)
    found = np.sqrt(np.diag(PublishedOrbit(spread, False).covariance(flat, np.array([2000.0]))[0]))
    assert found[1:5] == pytest.approx([0.05, 0.05, 0.1, 0.1], rel=1e-4)


def test_the_place_of_a_circle_is_lost_as_its_period_says():
    """Without an image: along the path by the phase, which grows by 2 pi t sigma(ln P) / P, across it by the axis."""
    period, mass, turn = 0.01, 0.06, 1000.0
    spread = np.diag([period, 1e-7, 1e-7, 1e-7, 1e-7, 0.05]) ** 2
    flat = planets(eccentricity=0.0, inclination_deg=0.0)
    published = PublishedOrbit(spread, False).covariance(flat, np.array([turn]), mass)
    axis = np.hypot(2.0 * period, mass) / 3.0
    for later in (0.0, 500.0, 3000.0):
        along = np.hypot(0.05, 2.0 * np.pi * later / turn * period)
        for useless in ([0.0], [400.0]):  # wherever the middle of the arc lies
            errors = np.full((1, 1), 1e6)
            how = {"star_mass_error": mass, "published": published}
            found = orbit_quality(flat, np.array([turn]), 3.0, np.array([useless]), errors, np.array([later]), **how)
            assert found.place_error_arcsec[0] == pytest.approx(np.hypot(axis, along), rel=1e-3)
            assert found.axis_error[0] == pytest.approx(axis, rel=1e-3)
            assert found.period_error[0] == pytest.approx(period, rel=1e-3)


def test_planets_without_a_published_orbit_are_as_before():
    both, turn = planets(2), np.full(2, 2000.0)
    days, errors = np.array([[0.0, 300.0, 700.0]] * 2), np.full((2, 3), 0.007)
    own = PublishedOrbit(np.diag([0.01, 0.05, 0.1, 0.3, ANY, 0.2]) ** 2, False).covariance(both, turn)
    own[0] = np.nan
    given = both, turn, 3.0, days, errors, np.array([900.0, 900.0])
    without, found = orbit_quality(*given), orbit_quality(*given, published=own)
    assert found.place_error_arcsec[0] == without.place_error_arcsec[0]
    assert found.place_error_arcsec[1] < without.place_error_arcsec[1]
    assert found.axis_error[1] < 0.5 * without.axis_error[1]


def sky(parameters, days):
    """East and north, au, of (ln P, T, e, omega, i, Omega, ln M) by Thiele and Innes."""
    log_period, passage, e, omega, tilt, node, log_mass = parameters
    period = np.exp(log_period)
    axis = np.exp((log_mass + 2.0 * (log_period - np.log(365.25))) / 3.0)
    big = eccentric_anomaly(2.0 * np.pi * (days - passage) / period, min(max(e, 0.0), 0.99))
    x, y = axis * (np.cos(big) - e), axis * np.sqrt(max(1.0 - e * e, 0.0)) * np.sin(big)
    cw, sw, cn, sn, ci = np.cos(omega), np.sin(omega), np.cos(node), np.sin(node), np.cos(tilt)
    north = x * (cw * cn - sw * sn * ci) + y * (-sw * cn - cw * sn * ci)
    east = x * (cw * sn + sw * cn * ci) + y * (-sw * sn + cw * cn * ci)
    return np.concatenate([east, north])


@pytest.mark.parametrize(
    ("days", "n"),
    [
        ((100.0, 500.0), 40),
        *(pytest.param(days, 150, marks=pytest.mark.long) for days in ((100.0, 500.0), (100.0, 300.0, 800.0))),
    ],
)
def test_errors_are_those_of_fits_to_velocities_and_images(table_of, days, n):
    """Orbits that the published numbers allow, imaged; fits in other elements to the positions and these numbers."""
    rng, distance, later, sigma = np.random.default_rng(5), 3.2, 1000.0, 0.007
    orbit = published_orbit(table_of(**VELOCITIES), 0, epoch_mjd=EPOCH)
    said = np.array([np.log(2700.0), -900.0, 0.3, np.deg2rad(250.0), np.log(0.82)])
    wide, at = np.array([0.01, 60.0, 0.03, np.deg2rad(6.0), 0.064]), [0, 1, 2, 3, 6]
    epochs, pulls = np.array(days), []
    for _ in range(n):
        told = said + wide * rng.normal(size=5)
        true = np.array([*told[:4], np.arccos(rng.uniform(-0.9, 0.9)), rng.uniform(0, 2 * np.pi), told[4]])
        seen = sky(true, epochs) / distance + sigma * rng.normal(size=2 * len(days))

        def off(x, seen=seen):
            return np.concatenate([(sky(x, epochs) / distance - seen) / sigma, (x[at] - said) / wide])

        fit = least_squares(off, true, x_scale=[0.01, 60.0, 0.03, 0.1, 0.1, 0.1, 0.06]).x
        turn = np.exp(true[0])
        one = planets(
            semi_major_axis_au=np.exp((true[6] + 2.0 * (true[0] - np.log(365.25))) / 3.0),
            eccentricity=true[2],
            inclination_deg=np.rad2deg(true[4]),
            argument_of_pericentre_deg=np.rad2deg(true[3]),
            node_deg=np.rad2deg(true[5]),
            mean_anomaly_deg=-360.0 * true[1] / turn,
        )
        found = orbit_quality(
            one,
            np.array([turn]),
            distance,
            epochs[None],
            np.full((1, len(days)), sigma),
            np.array([later]),
            published=orbit.covariance(one, np.array([turn])),
        )
        missed = np.hypot(*np.split((sky(fit, np.array([later])) - sky(true, np.array([later]))) / distance, 2))[0]
        axis = (fit[6] - true[6] + 2.0 * (fit[0] - true[0])) / 3.0
        pulls.append([axis / found.axis_error[0], missed / found.place_error_arcsec[0]])
    middle = np.quantile(np.abs(pulls), 0.683, axis=0)
    # Of 150 campaigns: a width is known to 7 %.
    assert middle == pytest.approx([1.0, 1.0], abs=0.25 * np.sqrt(150 / n))
