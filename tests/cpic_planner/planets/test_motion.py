"""Motion of planets within a programme against Kepler's laws integrated, images, and searches of noise."""

import math

import numpy as np
import pytest
from scipy import integrate, special

from catalogs import load_known_planets
from cpic_core import InputError
from cpic_planner.planets import OrbitSearch, span_days, star_masses_msun
from cpic_planner.planets.motion import _SMEARS, MOST_SHIFT_LAMBDA_D, aperture_track
from cpic_planner.planets.published_orbits import draw_known, known_uniforms, places_at
from simulator.imaging import single_band_psf
from tests.programme_motion import motion_of, programme_motion, smeared

LAMBDA_D = 0.0536  # arcsec, F520
G_AU3_MSUN_DAY2 = 0.01720209895**2
HOUR = 3600.0


def integrated(place_au, velocity_au_day, mass_msun, days, steps=4000):
    """Positions of a planet, au, from Newton's law by leapfrog, at equal times over so many days."""
    x, v, dt = np.array(place_au, float), np.array(velocity_au_day, float), days / steps
    path = [x.copy()]
    for _ in range(steps):
        x = x + v * dt / 2
        v = v - G_AU3_MSUN_DAY2 * mass_msun * x / np.linalg.norm(x) ** 3 * dt
        x = x + v * dt / 2
        path.append(x.copy())
    return np.array(path)


def test_calendar_of_a_programme():
    # 16 visits of 30 minutes of which 46 % of the calendar is seen, a day of pause between them.
    assert span_days(16 * 0.5 * HOUR, 16, 24.0) == pytest.approx((16 * 0.5 / 0.46 + 15 * 24.0) / 24.0, rel=1e-12)
    assert span_days(5 * HOUR, 1, 24.0, 1.0) == pytest.approx(5 / 24, rel=1e-12)
    assert span_days(0.0, 3) == 0.0


@pytest.mark.parametrize(("distance_pc", "mass", "days"), [(1.33, 1.08, 1.0), (3.22, 0.82, 4.5), (3.65, 0.78, 5.1)])
def test_days_in_which_a_planet_leaves_its_place(distance_pc, mass, days):
    """Alpha Cen, eps Eri and tau Cet at 0.5 arcsec."""
    at = [programme_motion(0.5, distance_pc, mass, LAMBDA_D, d * 86400.0, duty=1.0) for d in (0.9 * days, 1.1 * days)]
    assert [bool(one.planet_moves) for one in at] == [False, True]


def test_way_and_bend_of_an_orbit_that_is_integrated():
    distance, mass, separation = 3.65, 0.78, 0.5
    longest = float(programme_motion(separation, distance, mass, LAMBDA_D, 0.0).longest_span_days)
    radius = separation * distance
    speed = math.sqrt(G_AU3_MSUN_DAY2 * mass / radius)
    path = integrated([radius, 0.0], [0.0, speed], mass, longest) / distance / LAMBDA_D
    along = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    found = programme_motion(separation, distance, mass, LAMBDA_D, longest * 86400.0 * 0.99, duty=1.0)
    assert found.straight
    assert found.shift_lambda_d == pytest.approx(0.99 * along, rel=1e-3)
    # The best line leaves half of the height of the arc over its chord on each side.
    middle = (path[0] + path[-1]) / 2
    assert np.linalg.norm(path[len(path) // 2] - middle) / 2 == pytest.approx(0.3, rel=0.03)
    assert not programme_motion(separation, distance, mass, LAMBDA_D, longest * 86400.0 * 1.01, duty=1.0).straight


def test_some_searched_velocity_stays_within_three_tenths_of_every_bound_planet():
    distance, mass, separation, days = 3.22, 0.82, 0.5, 20.0
    found = programme_motion(separation, distance, mass, LAMBDA_D, days * 86400.0, duty=1.0)
    rng, radius = np.random.default_rng(3), separation * distance
    side = math.sqrt(2.0) * 2.0 * 0.3 / days  # of the squares, lambda/D per day
    used = set()
    for _ in range(40):
        depth = rng.normal(scale=0.5 * radius)
        full = math.hypot(radius, depth)
        direction = rng.standard_normal(3)
        velocity = direction / np.linalg.norm(direction) * math.sqrt(2 * G_AU3_MSUN_DAY2 * mass / full * rng.uniform())
        half = [integrated([radius, 0.0, depth], sign * velocity, mass, days / 2, 200) for sign in (1, -1)]
        ends = [(part[-1] - part[0])[:2] / distance / LAMBDA_D for part in half]
        cell = np.rint((ends[0] - ends[1]) / days / side)
        used.add(tuple(cell))
        off = [np.linalg.norm(end - sign * cell * side * days / 2) for end, sign in zip(ends, (1, -1), strict=True)]
        assert max(off) <= 0.3 + 0.03  # the arc adds a little
        assert np.linalg.norm(cell) * side <= math.sqrt(2.0) * found.shift_lambda_d / days + side / math.sqrt(2.0)
    assert 1 < len(used) <= found.n_orbits


def test_light_that_a_stack_at_rest_loses_against_an_image():
    psf = single_band_psf("F520")
    pixel, radius = psf.geometry.pixel_scale_arcsec, 0.7 * psf.geometry.lambda_d_arcsec
    image = np.asarray(psf.off_axis, float)
    y, x = (np.arange(n) - n // 2 for n in image.shape)
    fine = 5
    for shift in (0.6, 1.0, 2.0):
        kept = []
        for offset in np.linspace(-shift / 2, shift / 2, 9) * psf.geometry.lambda_d_arcsec / pixel:
            inside = np.zeros(image.shape)
            for dy in (np.arange(fine) + 0.5) / fine - 0.5:
                for dx in (np.arange(fine) + 0.5) / fine - 0.5:
                    inside += np.hypot(y[:, None] + dy, x + dx - offset) * pixel <= radius
            kept.append((image * inside).sum())
        weight = np.array([0.5] + [1.0] * 7 + [0.5])
        # Pixels have a width, and the aperture with them.
        assert smeared(shift) == pytest.approx((weight @ kept) / weight.sum() / kept[4], abs=0.012)
    assert smeared(0.0) == pytest.approx(1.0, abs=1e-9)
    assert np.all(np.diff(smeared(np.linspace(0.0, 90.0, 500))) < 0.0)


def test_false_alarms_of_a_search_over_velocities_in_noise():
    """Peaks of stacks of noise, shifted along a fine grid of velocities, against those of stacks at rest."""
    pixels, size, visits, days = 4, 32, 5, 24.0
    mass, distance = 0.82, 3.22
    found = programme_motion(0.5, distance, mass, LAMBDA_D, 1e-3, visits, gap_h=days * 24 / 4, sigma=2.7)
    u, fastest = float(found.sigma), math.sqrt(2.0) * float(found.shift_lambda_d)
    k = np.fft.fftfreq(size) * pixels
    kx, ky = np.meshgrid(k, k)
    r = np.minimum(np.hypot(kx, ky) / 0.65, 1.0)  # behind the apodizer
    filtered = np.arccos(r) - r * np.sqrt(1.0 - r**2)
    filtered /= np.sqrt((filtered**2).mean())
    step = fastest / 4.0
    v = np.arange(-4, 5) * step
    vx, vy = (part[np.hypot(*np.meshgrid(v, v)) <= fastest * 1.001] for part in np.meshgrid(v, v))
    dates = np.linspace(-0.5, 0.5, visits)
    turned = np.exp(2j * np.pi * (kx * vx[:, None, None, None] + ky * vy[:, None, None, None]) * dates[:, None, None])
    turned = turned[..., : size // 2 + 1].astype("c8") * filtered[:, : size // 2 + 1].astype("f4")
    rng, n = np.random.default_rng(1), 1200
    above = {"rest": 0, "search": 0}
    for _ in range(n):
        noise = np.fft.rfft2(rng.standard_normal((visits, size, size)))
        above["rest"] += (np.fft.irfft2(noise * filtered[:, : size // 2 + 1], s=(size, size)).max((1, 2)) > u).sum()
        stacks = (turned * noise.astype("c8")).sum(1) / math.sqrt(visits)
        above["search"] += np.fft.irfft2(stacks, s=(size, size)).max() > u
    rest, search = -math.log1p(-above["rest"] / n / visits), -math.log1p(-above["search"] / n)
    assert found.trials < found.n_orbits
    # The counts have an error of 8 %. Peaks come in groups, of which a search counts one.
    assert 0.6 < search / rest / found.trials < 1.1


def test_trials_cost_what_they_add_in_false_alarms():
    found = [programme_motion(0.5, 3.65, 0.78, LAMBDA_D, 10 * HOUR, 16, gap_h=gap) for gap in (0.0, 24.0, 72.0)]
    for one in found:
        tail = math.erfc(float(one.sigma) / math.sqrt(2.0)) / 2.0
        assert float(one.trials) * tail == pytest.approx(math.erfc(5.0 / math.sqrt(2.0)) / 2.0, rel=0.01)
        assert smeared(0.6) * 0.99 <= one.kept <= 1.0
        assert one.kept >= one.kept_at_rest * (1.0 - 1e-6)
    assert found[0].sigma == pytest.approx(5.0, abs=1e-9)
    assert found[0].n_orbits == 1
    assert found[0].sigma < found[1].sigma < found[2].sigma < 6.5


def test_factor_on_the_threshold_is_that_of_trials_and_lost_light_and_never_jumps():
    search = OrbitSearch.of(np.array([0.3, 0.6]), 1.33, 1.08, LAMBDA_D, gap_h=12.0)
    each = np.geomspace(1e2, 1e7, 4000)[:, None]
    factor, motion = search.threshold_factor(4, each), motion_of(search, 4, each)
    np.testing.assert_allclose(factor, motion.sigma / 5.0 / motion.kept, rtol=1e-5)
    assert factor.min() >= 1.0
    assert 1.0 < np.exp(np.diff(np.log(factor), axis=0)).max() < 1.02
    assert np.diff(factor, axis=0).min() >= 0.0
    still = OrbitSearch.of(0.5, 1e4, 1.0, LAMBDA_D)
    assert still.threshold_factor(1000, 1e5) == pytest.approx(1.0, abs=1e-4)


def test_light_that_a_search_over_straight_lines_loses_of_an_orbit_that_bends():
    """Of a leapfrog orbit beside its best line, with the light beside an aperture from that of smeared images."""
    distance, mass, separation = 3.65, 0.78, 0.5
    longest = float(programme_motion(separation, distance, mass, LAMBDA_D, 0.0).longest_span_days)
    for days in (longest, 1.5 * longest):
        radius = separation * distance
        # From the middle of the path to its end; half of the bend is on each side of the line.
        path = integrated([radius, 0.0], [0.0, math.sqrt(G_AU3_MSUN_DAY2 * mass / radius)], mass, days / 2.0)
        off = (radius - path[:, 0]) / distance / LAMBDA_D
        off = np.maximum(np.abs(off - off.max() / 2.0), 2e-3)
        step = 1e-3
        light = ((off + step) * smeared(2 * (off + step)) - (off - step) * smeared(2 * (off - step))) / (2 * step)
        found = programme_motion(separation, distance, mass, LAMBDA_D, days * 86400.0, duty=1.0)
        assert float(found.kept / smeared(0.6)) == pytest.approx(light.mean(), rel=0.03)


def test_a_known_planet_goes_as_kepler_says():
    table = load_known_planets()
    row, distance = table.row_of("eps Eri b"), 3.216
    drawn = draw_known(table, [row], known_uniforms(table, [row], 400, 1), epoch_mjd=61771.0)
    places = places_at(drawn, 0, 61771.0 + np.array([0.0, 1.0, 30.0]))
    east, north = (part[:, 1:] - part[:, :1] for part in (places.east_au, places.north_au))
    way = np.median(np.hypot(east, north), axis=0) / distance
    assert way[1] == pytest.approx(30 * way[0], rel=0.1)
    # 3.5 au and 0.82 solar masses: no bound planet on that orbit goes faster than at its nearest place.
    fastest = math.sqrt(G_AU3_MSUN_DAY2 * 0.82 / 3.5) / distance
    assert 0.3 * fastest < way[0] < 1.5 * fastest


def test_masses_are_those_of_the_catalogue():
    masses = star_masses_msun(
        ["tau Cet", "nobody", "nobody"], [4.0, 4.438, np.nan], [0.5, 1.0, 1.0], [5300, 5772, 5772]
    )
    assert masses[0] == pytest.approx(0.78, abs=0.05)
    assert masses[1:].tolist() == pytest.approx([1.0, 1.0], rel=1e-9)


@pytest.mark.parametrize(
    ("key", "value"),
    [("separation_arcsec", 0.0), ("distance_pc", -1.0), ("sigma", 0.5), ("visits", 0.5), ("duty", 0.0)],
)
def test_values_out_of_range_are_refused(key, value):
    given = {
        "separation_arcsec": 0.5,
        "distance_pc": 3.0,
        "star_mass_msun": 1.0,
        "lambda_d_arcsec": 0.05,
        "time_s": 1.0,
    }
    with pytest.raises(InputError, match=key):
        programme_motion(**{**given, key: value})


def test_the_fit_of_smeared_light_is_that_of_the_track():
    way = np.linspace(0.02, 2.0 * MOST_SHIFT_LAMBDA_D, 30)
    powers = np.stack([way**2, way**4, way**6], axis=1)
    fit = np.linalg.lstsq(powers, 1.0 / smeared(way) - 1.0, rcond=None)[0]
    np.testing.assert_allclose(_SMEARS, fit, rtol=1e-10)
    np.testing.assert_allclose(1.0 / (1.0 + powers @ _SMEARS), smeared(way), rtol=1e-6)


@pytest.mark.parametrize("place", [0, 3, 700, 2000])
def test_light_in_an_aperture_beside_an_image_is_that_of_an_adaptive_quadrature(place):
    def light(offset):
        def at(angle):
            frequency = 2.0 * math.pi * 0.65 * math.cos(angle)
            transfer = angle - math.sin(angle) * math.cos(angle)
            return transfer * math.sin(angle) * special.j1(0.7 * frequency) * special.j0(offset * frequency)

        return integrate.quad(at, 0.0, math.pi / 2.0, epsabs=1e-14, epsrel=1e-12, limit=400)[0]

    track = aperture_track()
    assert track.light[place] == pytest.approx(light(track.offset[place]) / light(0.0), abs=1e-12)
