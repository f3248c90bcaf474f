"""The law of the speckle residual against the table that the imaging model measured."""

from dataclasses import replace

import numpy as np
import pytest

from cpic_core import stream
from cpic_planner.etc import build_model
from simulator.config import Timing, load_instrument
from simulator.imaging import psf_metrics, single_band_psf
from simulator.imaging.drift import screen_model
from simulator.signal import (
    ProgrammeLaw,
    SpeckleLaw,
    annulus_floor,
    drift_halo,
    error_light_share,
    error_variance_nm2,
    programme_law,
    programme_parts,
    speckle_law,
    unit_parts,
)
from simulator.signal.speckles import LOW_ORDER_SQUARE, _annulus_table, _followed

MODEL = build_model(load_instrument())
DRIFT = MODEL.instrument.drift
BANDS = MODEL.bands


def speckle_fraction(metrics, drift, visit_s, separation_arcsec, annulus_lambda_d):
    """Rms of aperture sums over the star's light."""
    return np.sqrt(speckle_law(metrics, drift, separation_arcsec, annulus_lambda_d).variance(visit_s))


def drift(visit_nm, walk=0.0, **more):
    values = {"visit_nm": visit_nm, "walk_nm_per_sqrt_hour": walk, "common_fraction": 0.0, "orbital_nm": 0.0}
    return DRIFT.model_copy(update=values | more)


@pytest.mark.parametrize("band", BANDS)
def test_it_is_the_measured_floor_at_a_place(band):
    metrics = MODEL.metrics[band]
    bins = metrics.floor_separation_arcsec
    places = np.sort(np.concatenate([bins, (bins[1:] + bins[:-1]) / 2]))
    for offset in (0.005, 0.05, 0.3, 2.0, 10.0):
        said = speckle_fraction(metrics, drift(offset), 0.0, places, 0.0)
        # The law is tabulated in steps: at the bins, where the slope changes, they show.
        np.testing.assert_allclose(said, metrics.rdi_floor(offset, separation_arcsec=places), rtol=0.03)


@pytest.mark.parametrize("band", BANDS)
@pytest.mark.parametrize("ratio", [1.0, 0.25, 4.0])
def test_the_walk_adds_its_time_average(band, ratio):
    """A walk of variance ``w s``: its mean over a visit has ``w v / 3``; the mean of its square 3/2 of that squared."""
    metrics, place, visit_nm, walk = MODEL.metrics[band], np.array([0.5, 0.7, 0.9]), 0.04, 0.3
    law = speckle_law(metrics, drift(visit_nm, walk), place, 1.5, ratio)
    linear = speckle_law(metrics, drift(1e-6), place, 1.5).k0 / 1e-12
    square = speckle_law(metrics, drift(1e6), place, 1.5).k0 / 1e24
    for hours in (0.1, 3.0, 100.0):
        own, other = walk**2 * hours / 3, walk**2 * hours * ratio / 3
        expected = linear * (visit_nm**2 + (own + other) / 2)
        expected = expected + square * (visit_nm**4 + visit_nm**2 * (own + other) + 1.5 * (own**2 + other**2) / 2)
        np.testing.assert_allclose(law.variance(3600.0 * hours), expected, rtol=1e-6)


def test_what_a_walk_leaves_by_drawing_walks():
    """Mean and mean square of 20 000 walks of 200 steps, against the factors of the law."""
    rng = np.random.default_rng(1)
    walks = np.cumsum(rng.standard_normal((20_000, 200)) / 200**0.5, axis=1)
    first, second = walks.mean(axis=1), (walks**2).mean(axis=1)
    law = speckle_law(MODEL.metrics["F520"], drift(0.0, 60.0), 0.6, 1.5)  # 1 nm of variance a second
    frozen = speckle_law(MODEL.metrics["F520"], drift(1.0), 0.6, 1.5)
    small, large = (speckle_law(MODEL.metrics["F520"], drift(o), 0.6, 1.5).k0 for o in (1e-4, 1e4))
    assert law.k1 / (small / 1e-8) == pytest.approx(first.var(), rel=4 * (2 / 20_000) ** 0.5 + 0.01)
    error = 4 * (second - second.mean()).__pow__(4).mean() ** 0.5 / second.var() / 20_000**0.5
    assert law.k2 / (large / 1e16) * 2 == pytest.approx(second.var(), rel=error + 0.01)
    assert frozen.k1 == frozen.k2 == 0.0


@pytest.mark.parametrize("band", BANDS)
def test_without_squares_it_is_the_floor_of_a_longer_offset(band):
    """While the beat with the hole's own field rules, ``v`` hours are an offset of ``sqrt(visit^2 + walk^2 v / 3)``."""
    metrics, place = MODEL.metrics[band], np.array([0.5, 0.7, 0.85])
    for visit_nm, walk, hours in ((0.01, 0.01, 4.0), (0.02, 0.05, 0.1)):
        local = speckle_fraction(metrics, drift(visit_nm, walk), 3600.0 * hours, place, 0.0)
        there = metrics.rdi_floor(visit_nm, walk_nm_per_sqrt_hour=walk, visit_hours=hours, separation_arcsec=place)
        np.testing.assert_allclose(local, there, rtol=0.07)


def test_no_drift_leaves_exactly_nothing():
    law = speckle_law(MODEL.metrics["F520"], drift(0.0), np.array([0.5, 0.9]), 1.5)
    for visit in (0.0, 1.0, 1e9):
        np.testing.assert_array_equal(law.variance(visit), 0.0)


def coefficients(metrics, r):
    """Of the floor at separations: between bins by logarithms, beyond them by the power of the last two."""
    found = []
    bins = metrics.floor_separation_arcsec
    for part in (metrics.floor_linear[1:], metrics.floor_square[1:]):
        power = np.log(part[-1] / part[-2]) / np.log(bins[-1] / bins[-2])
        beyond = part[-1] * (r / bins[-1]) ** power
        found.append(np.where(r > bins[-1], beyond, np.exp(np.interp(r, bins, np.log(part)))))
    return found


def test_a_floor_that_rises_outward_stays_what_it_is_at_the_last_place():
    """Beyond the measured places a residual falls on, but is not taken to rise for ever."""
    metrics = MODEL.metrics["F662"]
    rising = [np.concatenate([part[:1], np.sort(part[1:])]) for part in (metrics.floor_linear, metrics.floor_square)]
    metrics = replace(metrics, floor_linear=rising[0], floor_square=rising[1])
    last = metrics.floor_separation_arcsec[-1]
    assert metrics.owa_arcsec > 1.02 * last
    at_last, beyond = speckle_fraction(metrics, drift(0.05), 0.0, np.array([last, metrics.owa_arcsec]), 0.0)
    assert beyond == pytest.approx(at_last, rel=2e-3)


def test_light_that_crosses_with_an_orbital_term_goes_with_its_amplitude():
    """Low orders leave a part of the variance that is the square of their light: the cross term has its root."""
    added = {}
    for orders in ("low", "all"):
        with_orbit = drift(1.0, orbital_nm=1.0, orbital_period_s=5700.0, orbital_orders=orders)
        (_, one), (_, other) = (unit_parts(chosen) for chosen in (with_orbit, drift(1.0)))
        added[orders] = float(np.squeeze(one.science.k0 - other.science.k0))
    assert added["all"] > 0.01
    assert added["low"] / added["all"] == pytest.approx(np.sqrt(LOW_ORDER_SQUARE), rel=1e-6)


def test_an_annulus_counts_with_the_mean_variance_of_its_whole_apertures():
    """Apertures thrown at random on the annulus, kept where they lie in the square quadrants."""
    metrics, place, half = MODEL.metrics["F662"], 0.66, 1.5
    rng, margin = np.random.default_rng(5), metrics.aperture_radius_arcsec
    reach = half * metrics.lambda_d_arcsec - margin  # whole apertures
    x, y = rng.uniform(0.0, place + reach, (2, 400_000))
    r = np.hypot(x, y)
    low, high = metrics.zone.inner_arcsec + margin, metrics.zone.outer_arcsec - margin
    kept = (np.abs(r - place) <= reach) & (np.minimum(x, y) >= low) & (np.maximum(x, y) <= high)
    a, b = coefficients(metrics, r[kept])
    mean = (a * 0.05**2 + b * 0.05**4).mean() ** 0.5
    assert speckle_fraction(metrics, drift(0.05), 0.0, place, half) == pytest.approx(mean, rel=0.03)
    inner, outer = speckle_fraction(metrics, drift(0.05), 0.0, np.array([0.5, 0.8]), half)
    assert inner > 1.3 * outer


@pytest.mark.parametrize("half", [0.3, 1.5])
@pytest.mark.parametrize("band", ["F520", "F850"])
def test_the_mean_over_an_annulus_by_counting_angles(band, half):
    """From inside the hole's corner to beyond its edge: circles of the annulus count by angles left to apertures."""
    metrics = MODEL.metrics[band]
    corner, edge, margin = metrics.hole_inner_corner_arcsec, metrics.owa_arcsec, metrics.aperture_radius_arcsec
    low, high = metrics.zone.inner_arcsec + margin, metrics.zone.outer_arcsec - margin
    first, last = np.hypot(low, low), np.hypot(high, high)
    reach = max(half * metrics.lambda_d_arcsec - margin, 0.0)
    near = 0.98 * reach  # circles at the end of the annulus hold the only apertures
    places = np.array([0.6 * corner, first - near, first, 0.5 * (first + last), high, last, last + near, edge])
    angle = 2.0 * np.pi * (np.arange(20_000) + 0.5) / 20_000
    cosine, sine = np.abs(np.cos(angle)), np.abs(np.sin(angle))
    expected = []
    for place in places:
        circles = place + np.linspace(-1.0, 1.0, 25)[:, None] * reach
        x, y = circles * cosine, circles * sine
        free = (np.minimum(x, y) >= low) & (np.maximum(x, y) <= high)
        weight = circles[:, 0] * free.mean(axis=1)
        if weight.sum() == 0.0:
            circles, weight = np.full((1, 1), place), np.ones(1)
        a, b = coefficients(metrics, circles[:, 0])
        expected.append(((a * 0.05**2 + b * 0.05**4) @ weight / weight.sum()) ** 0.5)
    found = speckle_fraction(metrics, drift(0.05), 0.0, places, half)
    inner = np.isin(np.arange(places.size), [1, 6])  # a few angles there: the steps of the table show
    np.testing.assert_allclose(found[~inner], np.array(expected)[~inner], rtol=3e-3)
    np.testing.assert_allclose(found[inner], np.array(expected)[inner], rtol=0.03)


ORBIT = {"orbital_nm": 0.3, "orbital_orders": "all"}


def orbital_laws(scheme, **more):
    """Return the law of a drift with an orbital term, and without."""
    settings = [drift(0.05, **(ORBIT | more)), drift(0.05)]
    return [programme_law(MODEL.metrics["F520"], item, 0.6, 1.5, timing=Timing(scheme)) for item in settings]


def phases(scheme):
    """Orbital sine over the windows of science and of references, for all phases: arrays (phases, times)."""
    half, late = 0.5 if scheme in ("half", "swapped") else 1.0, {"half": 0.23, "swapped": 0.23, "other_star": 0.25}
    start = (np.arange(720) + 0.5) / 720
    times = (np.arange(3000) + 0.5) / 3000 * 0.46 * half
    begins = (0.0, late.get(scheme, 0.0))
    return [np.sqrt(2) * np.sin(2 * np.pi * (start[:, None] + begin + times)) for begin in begins]


@pytest.mark.parametrize("scheme", ["interleaved", "half", "swapped", "other_star"])
def test_the_orbit_leaves_what_its_sine_leaves(scheme):
    """From means over a fine clock and all phases: its cross terms with the static field and with visits, and alone."""
    law, alone = orbital_laws(scheme)
    linear, square = (programme_law(MODEL.metrics["F520"], drift(o), 0.6, 1.5).science.k0 for o in (1e-6, 1e6))
    linear, square, power = linear / 1e-12, square / 1e24, 0.3**2
    science, reference = phases(scheme)
    stays = power * ((science - reference).mean(axis=1) ** 2).mean()
    light = power**2 * (((science**2).mean(axis=1) - (reference**2).mean(axis=1)) ** 2).mean()
    lasting = stays * linear + light * square
    crossing = [2 * square * 0.05**2 * power * (part.mean(axis=1) ** 2).mean() for part in (science, reference)]
    for visits in (1, 2, 8):
        more = law.law(visits).k0 - alone.law(visits).k0
        stay = lasting / visits**2 if scheme == "swapped" else lasting
        small = 1e-4 * float(alone.law(visits).k0)
        assert more == pytest.approx(stay + sum(crossing) / visits, rel=2e-3, abs=small)


def test_a_calm_orbit_changes_nothing_and_drift_scales_as_a_whole():
    law, alone = orbital_laws("half", orbital_nm=0.0)
    assert law == alone
    metrics, timing = MODEL.metrics["F520"], Timing("other_star")
    settings = drift(0.05, 0.1, common_fraction=0.3, **ORBIT)
    twice = drift(0.1, 0.2, common_fraction=0.3, **(ORBIT | {"orbital_nm": 0.6}))
    one, two = (programme_parts(metrics, item, 0.6, 1.5, timing=timing) for item in (settings, twice))
    for power, part, larger in zip((4, 16), one, two, strict=True):
        assert larger.law(3).variance(3600.0) == pytest.approx(power * part.law(3).variance(3600.0), rel=1e-12)
    whole = programme_law(metrics, settings, 0.6, 1.5, timing=timing).law(3).variance(3600.0)
    assert whole == pytest.approx(sum(part.law(3).variance(3600.0) for part in one), rel=1e-12)


def test_residuals_beside_each_other_add_up():
    law, alone = orbital_laws("half", orbital_nm=0.3)
    turned, still = law._replace(turned=law.common.scaled(3.0)), alone._replace(turned=None)
    for one, two in ((turned, turned), (turned, still), (still, turned), (still, still)):
        found = one.beside(two)
        for visits in (1, 2, 5):
            expected = one.law(visits).variance(3600.0) + two.law(visits).variance(3600.0)
            assert found.law(visits).variance(3600.0) == pytest.approx(expected, rel=1e-12)


def test_the_floor_of_an_annulus_follows_its_table_to_both_ends():
    metrics = MODEL.metrics["F662"]
    metrics = replace(metrics, floor_separation_arcsec=0.3 * metrics.floor_separation_arcsec)  # it falls from the first
    first, step, *tables = _annulus_table(metrics, 1.5)
    assert all(abs(rise[0]) > 1e-6 for _, rise in tables)
    last = metrics.owa_arcsec
    assert first == pytest.approx(0.5 * metrics.hole_inner_corner_arcsec, rel=1e-12)
    count = len(tables[0][0])
    assert first + (count - 1) * step == pytest.approx(last, rel=1e-12)
    rows = np.array([-3.0, 0.0, 0.25, 0.75, 1.5, count - 2.25, count - 1.75, count - 1.25, count - 1.0, count + 4.0])
    for found, (logs, _) in zip(annulus_floor(metrics, 1.5, first + rows * step), tables, strict=True):
        np.testing.assert_allclose(np.log(found), np.interp(rows, np.arange(count), logs), atol=1e-9)


def test_the_parts_of_any_sum_are_factors_of_its_variances():
    """What a programme leaves of the covariance of visits at 1 nm: of a pair, twice that of one."""
    settings = drift(0.05, 0.1, common_fraction=0.3, **ORBIT)
    metrics, timing = MODEL.metrics["F520"], Timing("other_star")
    found = unit_parts(settings, timing=timing)
    for power, part, factor in zip(
        (2, 4), programme_parts(metrics, settings, 0.6, 1.5, timing=timing), found, strict=True
    ):
        one = programme_law(metrics, drift(1e-6 if power == 2 else 1e6), 0.6, 1.5).science.k0
        coefficient = float(one) / (1e-6 if power == 2 else 1e6) ** power
        assert part.law(3).variance(3600.0) == pytest.approx(coefficient * factor.law(3).variance(3600.0), rel=1e-6)
    linear, square = unit_parts(drift(0.1))
    assert linear.law(4, 12).variance(0.0) == pytest.approx(0.1**2 * (1 / 4 + 1 / 12), rel=1e-12)
    assert square.law(4, 12).variance(0.0) == pytest.approx(0.1**4 * (1 / 4 + 1 / 12), rel=1e-12)


def test_the_order_that_turns_scales_with_the_rest():
    law, _ = orbital_laws("swapped")
    assert law.turned is not None
    assert law.scaled(4.0).law(3).k0 == pytest.approx(4.0 * law.law(3).k0, rel=1e-12)
    assert law.averaging().turned is law.turned


@pytest.mark.parametrize(
    ("visits", "gap_h", "memory_h"), [(1, 1.0, 3.0), (2, 0.5, 1.0), (7, 2.0, 5.0), (40, 0.3, 30.0)]
)
def test_independent_visits_are_the_sum_over_pairs(visits, gap_h, memory_h):
    """The variance of a mean of correlated offsets, pair by pair."""
    law = programme_law(MODEL.metrics["F520"], drift(0.05, correlation_time_h=memory_h), 0.6, 1.5)
    number = np.arange(visits)
    together = np.exp(-np.abs(number[:, None] - number) * gap_h / memory_h)
    assert float(law.independent(visits, gap_h * 3600.0)) == pytest.approx(visits**2 / together.sum(), rel=1e-12)


def test_visits_forget_each_other_where_no_memory_is_stated():
    """However close they are."""
    part = SpeckleLaw(*np.ones((3, 1)))
    assert ProgrammeLaw(part, part, part).independent(16.0, 60.0) == 16.0


@pytest.mark.parametrize("fraction", [0.1, 0.5, 1.0])
def test_what_all_visits_share_is_half_of_a_pair_that_is_off_by_it(fraction):
    metrics = MODEL.metrics["F662"]
    shared = programme_law(metrics, drift(0.2, common_fraction=fraction), 0.6, 1.5).common
    alone = speckle_law(metrics, drift(0.2 * fraction), 0.6, 1.5)
    assert shared.variance(7200.0) == pytest.approx(alone.variance(7200.0) / 2.0, rel=1e-12)


@pytest.mark.parametrize("visit_s", [0.0, 3600.0, 40000.0])
def test_light_of_what_is_common_crosses_with_offset_and_walk_of_a_visit(visit_s):
    """Of errors c and e that know nothing of each other ``2 <|c|^2> <|e|^2>`` stands beside the squares of both.

    The mean of the walk's variance over the visit is a third of that at its end.
    """
    metrics, offset, walk, fraction = MODEL.metrics["F520"], 0.1, 0.3, 0.4
    square = float(programme_law(metrics, drift(1e6), 0.6, 1.5).science.k0) / 1e24
    with_it, without = (
        programme_law(metrics, drift(offset, walk, common_fraction=part), 0.6, 1.5).science for part in (fraction, 0.0)
    )
    own = offset**2 + walk**2 * visit_s / 3600.0 / 3.0
    more = float(with_it.variance(visit_s) - without.variance(visit_s))
    assert more == pytest.approx(2.0 * square * (fraction * offset) ** 2 * own, rel=1e-5)


def test_a_law_scales():
    law = SpeckleLaw(np.array([1.0]), np.array([2.0]), np.array([3.0]))
    np.testing.assert_array_equal(law.variance([0.0, 1.0, 10.0]), [1.0, 6.0, 321.0])
    np.testing.assert_array_equal(law.scaled(0.5).variance(10.0), [160.5])


@pytest.mark.parametrize("band", BANDS)
@pytest.mark.parametrize(("walk", "ratio"), [(0.0, 1.0), (0.05, 1.0), (0.3, 0.4)])
def test_light_of_the_errors_is_what_grows_with_the_fourth_power(band, walk, ratio):
    """Twice the drift is four times the cross term with the static field, and sixteen times the light of the errors."""
    metrics, places = MODEL.metrics[band], np.array([0.45, 0.6, 0.8])
    for visit_s in (0.0, 3600.0, 40000.0):
        once, twice = (
            speckle_law(metrics, drift(0.05 * times, walk * times), places, 1.5, ratio).variance(visit_s)
            for times in (1.0, 2.0)
        )
        share = error_light_share(metrics, drift(0.05, walk), places, 1.5, ratio, visit_s)
        np.testing.assert_allclose(share, (twice - 4.0 * once) / 12.0 / once, rtol=1e-9)
        assert np.all((share > 0.0) & (share < 1.0))


def test_no_drift_has_no_light_of_errors():
    assert error_light_share(MODEL.metrics["F520"], drift(0.0), 0.6, 1.5, 1.0, 3600.0) == 0.0
    assert error_light_share(MODEL.metrics["F520"], drift(10.0), 0.6, 1.5, 1.0, 0.0) > 0.99


@pytest.mark.parametrize(("orders", "reaches"), [("low", LOW_ORDER_SQUARE**0.5), ("all", 1.0)])
def test_errors_whose_light_lies_in_the_zone_add_up(orders, reaches):
    one = drift(0.05, 0.3, common_fraction=0.4, orbital_nm=0.2, orbital_orders=orders)
    assert error_variance_nm2(one) == pytest.approx(0.05**2 + 0.02**2 + reaches * 0.2**2, rel=1e-12)


@pytest.mark.parametrize("band", ["F520", "F850"])
def test_scattered_light_of_a_wavefront_error(band):
    calm = load_instrument({"drift": {"visit_nm": 0, "walk_nm_per_sqrt_hour": 0}})
    psf, figures = single_band_psf(band, instrument=calm, fidelity="quick"), psf_metrics(calm, band)
    grid = psf.imager.focal_grid(psf.imager.stamp_axis(masked=True), psf.imager.stamp_axis(masked=True))
    screens, rng, still = (
        screen_model(len(psf.imager.transmission), calm.drift.psd_slope),
        stream(3, "halo"),
        grid.image(),
    )
    scattered = np.mean([grid.image(screens.draw(rng, 1.0)) - still for _ in range(25)], axis=0) / psf.off_axis.max()
    offset = (np.arange(137) - 68) * figures.pixel_scale_arcsec
    radius = np.hypot(offset[:, None], offset)
    said = drift_halo(figures, radius, 1.0, calm.drift.psd_slope, calm.band(band).center_nm)
    for low, high in ((0.35, 0.55), (0.55, 0.8), (0.8, 1.0)):
        ring = figures.hole & (radius >= low) & (radius < high)
        assert 0.6 < said[ring].mean() / scattered[ring].mean() < 2.0
    assert float(drift_halo(figures, np.array(0.5), 2.0, 2.5, 662.0)) == pytest.approx(
        4.0 * float(drift_halo(figures, np.array(0.5), 1.0, 2.5, 662.0)), rel=1e-12
    )


def test_scattered_light_in_numbers():
    """As the square of the phase and the power of the screens; never more than the source, nor within lambda/D."""
    figures = MODEL.metrics["F520"]
    u = np.array([0.0, 0.5, 1.0, 10.0])
    said = drift_halo(figures, u * figures.lambda_d_arcsec, 2.0, 2.5, 331.0)
    np.testing.assert_allclose(said, 2.4e-5 * 16.0 * np.array([1.0, 1.0, 1.0, 10.0**-2.5]), rtol=1e-12)
    np.testing.assert_array_equal(drift_halo(figures, u, 1e4, 2.5, 662.0)[:2], 1.0)


def test_light_of_common_errors_crosses_with_that_of_the_orbit():
    """The light of two independent Gaussian fields of variances x and y varies as (x + y)^2: the cross term is 2 x y.

    What the orbit leaves in a visit crosses with the visit's offset and with the common screen alike, so that one term
    is the other times the ratio of their variances.
    """
    metrics, drift = psf_metrics(load_instrument(), "F520"), load_instrument().drift
    fraction = 0.3

    def light(common_fraction, orbital_nm):
        changes = {"common_fraction": common_fraction, "orbital_nm": orbital_nm, "orbital_orders": "all"}
        return programme_parts(metrics, drift.model_copy(update=changes), 0.6, 1.5)[1]

    both, common, orbit, neither = (light(*pair) for pair in ((fraction, 0.1), (fraction, 0.0), (0.0, 0.1), (0.0, 0.0)))
    crossed = both.common.k0 - common.common.k0 - orbit.common.k0
    of_offset = orbit.science.k0 - neither.science.k0
    assert crossed > 0.0
    assert crossed == pytest.approx(fraction**2 * of_offset, rel=1e-9)


@pytest.mark.parametrize(
    ("bins", "values", "right"),
    [
        ([0.5], [-3.0], [-3.0, -3.0, -3.0]),
        ([0.25, 0.5], [-1.0, -3.0], [-1.0, -3.0, -5.0]),
        ([0.125, 0.25, 0.5], [-9.0, -1.0, -2.0], [-1.0, -2.0, -3.0]),
        ([0.25, 0.5], [-3.0, -1.0], [-3.0, -1.0, -1.0]),
    ],
)
def test_floors_fall_on_beyond_the_last_bin_by_the_power_of_the_last_two(bins, values, right):
    """At 0.25, 0.5 and 1: a factor of two in separation each; what rises does not rise on."""
    found = _followed(np.array([0.25, 0.5, 1.0]), np.array(bins), np.array(values))
    np.testing.assert_allclose(found, right, rtol=1e-12)
