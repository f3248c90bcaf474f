"""Completeness against a loop over single planets, against geometry, and at its limits."""

import dataclasses
import math

import numpy as np
import pytest

import cpic_planner.ranking.completeness as module
from catalogs import load_stars
from cpic_core import InputError
from cpic_planner.etc import (
    LEAST_PROBABILITY,
    Programme,
    aperture_rates,
    band_law,
    build_model,
    effective_visits,
    light_share,
    lit_share,
    own_share,
    speckled_share,
    stack_noise,
    threshold_array,
)
from cpic_planner.planets import Planets, StarLimits, draw_population, load_population, star_masses_msun
from cpic_planner.queries import Strategy
from cpic_planner.ranking.completeness import completeness
from cpic_planner.targets import targets_from_table
from simulator import load_instrument
from simulator.imaging import HoleZone
from simulator.target import albedo_source, lambert_phase, sky_to_detector
from tests.programme_motion import programme_motion

BANDS = ("F520", "F850")
AU_KM, RJUP_KM = 149597870.7, 71492.0
IDEAL = Strategy(library="idealised")
EVERYTHING = {"exposure_s": 100.0, "n_frames": 1e14, "em_gain": 20.0}
FACE_ON = {"base": "jupiters", "inclination_deg": 0}


@pytest.fixture(scope="module")
def model():
    return build_model(load_instrument(), bands=BANDS)


@pytest.fixture(scope="module")
def everyone():
    return targets_from_table(load_stars())


@pytest.fixture(scope="module")
def stars(everyone):
    """Nearby stars, with and without companions, and some others."""
    near = np.argsort(everyone.distance_pc)[:5].tolist()
    return everyone.select([*near, 100, 400, 800])


def planets(source=None, n=300, seed=1):
    return draw_population(load_population(source), n, seed)


def with_strategy(model, **changes):
    return dataclasses.replace(model, strategy=Strategy(**changes))


def one_by_one(model, targets, band, drawn, exposure_s, n_frames, em_gain, visits):
    """Sums of chances blind and at known places, numbers in the zone and observable: every planet for itself."""
    instrument, metrics, strategy = model.instrument, model.metrics[band], model.strategy
    low, high = instrument.hole_inner_arcsec(band), instrument.hole_outer_arcsec(band)
    radius = instrument.aperture_radius_arcsec(band)
    right = {"right": (1,), "left": (-1,)}.get(metrics.hole_side, (-1, 1)) if metrics.hole_mode == "2q" else (-1, 1)
    top = {"top": (1,), "bottom": (-1,)}.get(metrics.hole_side, (-1, 1)) if metrics.hole_mode == "2q" else (-1, 1)
    camera, found, law = model.camera(band), np.zeros((4, len(targets))), band_law(model, band)
    for i in range(len(targets)):
        target = targets.select([i])
        luminosity = float(target.luminosity_lsun[0])
        grow = math.sqrt(luminosity) if drawn.semi_major_axis_scale == "insolation" else 1.0
        for k in range(len(drawn)):
            per_au = grow / float(target.distance_pc[0])
            x = instrument.detector.parity * float(drawn.east_au[k]) * per_au
            y = float(drawn.north_au[k]) * per_au
            dark = math.copysign(1, x) in right and math.copysign(1, y) in top
            if not (dark and low <= abs(x) <= high and low <= abs(y) <= high):
                continue
            found[2, i] += 1
            if not (low + radius <= min(abs(x), abs(y)) and max(abs(x), abs(y)) <= high - radius):
                continue
            found[3, i] += 1
            if n_frames[i] == 0:
                continue
            distance = float(drawn.distance_au[k]) * grow
            spec = drawn.albedos[drawn.kind[k]]
            albedo = model.passbands.band_albedo(
                albedo_source(spec),
                target.teff_k,
                target.log_g,
                target.metallicity,
                insolation_au=distance / math.sqrt(luminosity),
                only=band,
            )[0]
            size = float(drawn.radius_rjup[k]) * RJUP_KM / (distance * AU_KM)
            contrast = albedo * size * size * lambert_phase(float(drawn.phase_deg[k]))
            rates = aperture_rates(model, target, band, np.array([x]), np.array([y]), np.array([contrast]))
            setting = [np.array([value[i]]) for value in (exposure_s, n_frames, em_gain)]
            programme = Programme.of(strategy, np.array([visits[i]]))
            noise = stack_noise(rates, *setting, camera, strategy, programme=programme)
            separation = math.hypot(x, y)
            margin = noise.significance[0] / threshold_array(metrics.resolution_elements(separation), strategy.sigma)
            visit_s = n_frames[i] * (exposure_s[i] + camera.readout_s)
            mass = star_masses_msun(target.name.tolist(), target.log_g, target.luminosity_lsun, target.teff_k)
            around = separation, target.distance_pc, mass, metrics.lambda_d_arcsec
            moves = programme_motion(*around, visits[i] * model.time_s(visit_s), visits[i], sigma=strategy.sigma)
            paid = np.array([float(moves.sigma[0] / strategy.sigma / moves.kept[0]), 1.0])
            if law is None:
                found[:2, i] += margin >= paid
            else:
                light = lit_share(noise, light_share(model, band, separation, visit_s))
                where = (
                    own_share(noise),
                    separation,
                    speckled_share(noise),
                    light,
                    effective_visits(visits[i], visits[i]),
                )
                blind, placed = (
                    float(np.ravel(law.probability(noise.significance / part, *where, at_place=known))[0])
                    for part, known in zip(paid, (False, True), strict=True)
                )
                chances = np.array([blind, max(blind, placed)])
                found[:2, i] += np.where(chances < LEAST_PROBABILITY, 0.0, chances)
    return found


CASES = [
    (None, {}, {}),
    ({"albedo": "parametric"}, {"library": "idealised"}, {}),
    ("solar_system", {"library": "idealised", "reference_ratio": 2.0}, {}),
    (
        {"semi_major_axis_scale": "insolation", "albedo": {"model": "parametric", "log10_mh": 1.0}},
        {"library": "idealised"},
        {"hole_mode": "2q", "hole_side": "left"},
    ),
    ({"radius_rjup": 1}, {"mode": "photon_counting", "library": "idealised"}, {"hole_mode": "2q", "hole_side": "top"}),
]


@pytest.mark.parametrize(("source", "strategy", "hole"), CASES)
def test_equals_a_loop_over_single_planets(model, stars, source, strategy, hole):
    drawn = planets(source, n=400, seed=4)
    model = with_strategy(model, **strategy)
    model = dataclasses.replace(
        model, metrics={band: dataclasses.replace(item, **hole) for band, item in model.metrics.items()}
    )
    counting = model.strategy.mode == "photon_counting"
    n = len(stars)
    frames, visits = np.array([0, 3e3, 40, 2e4, 6e2, 7e5, 1e8, 1e9]), np.array([1.0, 1, 1, 16, 2, 300, 1, 1])
    exposure = np.linspace(0.2, 1.0, n) if counting else np.linspace(5.0, 60.0, n)
    gain = np.full(n, 1000.0) if counting else np.linspace(1.0, 300.0, n)
    detected = 0
    for band in BANDS:
        setting = {"exposure_s": exposure, "n_frames": frames, "em_gain": gain, "visits": visits}
        found = completeness(model, stars, band, drawn, **setting)
        expected = one_by_one(model, stars, band, drawn, exposure, frames, gain, visits)
        both = found.completeness, found.completeness_known_place
        for value, count in zip((*both, found.in_zone, found.observable), expected, strict=True):
            np.testing.assert_allclose(value, count / len(drawn), rtol=2e-5, atol=1e-30)
        np.testing.assert_array_equal(found.completeness_unconditional, found.completeness)
        detected += expected[0].sum()
        assert expected[3].sum() > 10
        assert np.any(expected[0] < expected[3] - 0.5)
    assert detected > 1


def test_chunks_change_nothing(model, everyone, monkeypatch):
    targets, drawn = everyone.select(np.argsort(everyone.distance_pc)[:40]), planets({"albedo": "parametric"}, n=777)
    model = dataclasses.replace(model, strategy=IDEAL)
    setting = {"exposure_s": 30.0, "n_frames": np.arange(40.0) * 500, "em_gain": 20.0}
    whole = completeness(model, targets, "F520", drawn, **setting)
    for name, size in (("_TOGETHER", 20), ("_PLANETS", 100)):
        monkeypatch.setattr(module, name, size)
    observed, chances = [], module._Counts._chances

    def seen_chances(counts, stars, places, shown):
        observed.append(places[0].shape)
        return chances(counts, stars, places, shown)

    monkeypatch.setattr(module._Counts, "_chances", seen_chances)
    parts = completeness(model, targets, "F520", drawn, **setting)
    # Pairs at work at once: never more than asked, unless one star alone has more, and not much fewer.
    assert all(rows == 1 or rows * most <= 20 for rows, most in observed)
    assert max(rows for rows, _ in observed) > 1
    assert max(most for _, most in observed) > 20
    for item in dataclasses.fields(whole):
        value = getattr(whole, item.name)
        if isinstance(value, np.ndarray):
            np.testing.assert_allclose(getattr(parts, item.name), value, rtol=1e-12, atol=1e-15)
        else:
            assert getattr(parts, item.name) == value
    assert 0 < whole.completeness.sum() < whole.observable.sum()


@pytest.mark.parametrize("hole", [{}, {"hole_mode": "2q", "hole_side": "top"}])
def test_planets_that_are_placed_are_those_in_the_zone(model, everyone, hole):
    metrics = dataclasses.replace(model.metrics["F520"], **hole)
    stars, drawn = everyone.select(np.arange(0, len(everyone), 9)), planets({}, n=500)
    own = dataclasses.replace(model, metrics={"F520": metrics})
    (placed,) = module.ZonePlanets(stars, drawn).of(own, "F520")
    arcsec_au = (drawn.scale(stars.luminosity_lsun) / stars.distance_pc)[:, None]
    pa_deg = np.rad2deg(np.arctan2(drawn.east_au, drawn.north_au))
    parity = model.instrument.detector.parity
    x, y = sky_to_detector(arcsec_au * np.hypot(drawn.east_au, drawn.north_au), pa_deg, parity=parity)
    inside = [metrics.zone.contains(x, y, margin) for margin in (0.0, metrics.aperture_radius_arcsec)]
    for found, expected in zip((placed.in_zone, placed.observable), inside, strict=True):
        np.testing.assert_array_equal(found, expected.sum(axis=1))
    np.testing.assert_array_equal((placed.star, placed.planet), np.nonzero(inside[1]))
    np.testing.assert_allclose((placed.x_arcsec, placed.y_arcsec), (x[inside[1]], y[inside[1]]), rtol=1e-12)
    assert 0 < placed.observable.sum() < placed.in_zone.sum()


@pytest.mark.parametrize("lambda_d", [None, 0.3])
def test_noise_free_giants_are_detected_wherever_statistics_are_defined(model, stars, lambda_d):
    model = dataclasses.replace(model, strategy=IDEAL)
    if lambda_d is not None:  # coarse enough that part of the zone has fewer than three resolution elements
        coarse = {band: dataclasses.replace(item, lambda_d_arcsec=lambda_d) for band, item in model.metrics.items()}
        model = dataclasses.replace(model, metrics=coarse)
    drawn = planets(FACE_ON | {"radius_rjup": 10, "albedo": 1.5}, n=2000)
    for band in BANDS:
        metrics = model.metrics[band]
        x, y = (part / stars.distance_pc[:, None] for part in (drawn.east_au, drawn.north_au))
        near, far = np.minimum(abs(x), abs(y)), np.maximum(abs(x), abs(y))
        low = metrics.hole_inner_arcsec + metrics.aperture_radius_arcsec
        high = metrics.hole_outer_arcsec - metrics.aperture_radius_arcsec
        there = (near >= low) & (far <= high)
        defined = there & (metrics.resolution_elements(np.hypot(x, y)) >= 3)
        found = completeness(model, stars, band, drawn, **EVERYTHING)
        np.testing.assert_array_equal(found.observable, there.mean(axis=1))
        # A threshold of three elements, some 10^6, is more than one planet in a hundred has.
        whole = defined & (metrics.resolution_elements(np.hypot(x, y)) >= 4)
        # At known places: the orbits of so many years forbid a blind search.
        seen = found.completeness_known_place
        assert np.all(seen <= defined.mean(axis=1) * (1 + 1e-12))
        assert np.all(seen >= whole.mean(axis=1) * (1 - 1e-9))
        assert 0 < seen.max() < 1
        assert np.any(seen < found.observable) == (lambda_d is not None)


def test_side_of_the_hole_and_parity(model, everyone):
    """A planet in the north-east is on the left with the default parity, on the right with the other."""
    star = everyone.select([0])
    there = FACE_ON | {"node_deg": 45, "mean_anomaly_deg": 0, "semi_major_axis_au": 0.65 * float(star.distance_pc[0])}
    drawn = planets(there, n=3)
    assert np.all((drawn.east_au > 0) & (drawn.north_au > 0))
    seen = {}
    for parity in (-1, 1):
        instrument = load_instrument({"detector": {"parity": parity}})
        for side in ("right", "left", "top", "bottom"):
            metrics = dataclasses.replace(model.metrics["F520"], hole_mode="2q", hole_side=side)
            other = dataclasses.replace(model, instrument=instrument, metrics={"F520": metrics})
            found = completeness(other, star, "F520", drawn, exposure_s=1.0, n_frames=0, em_gain=1.0)
            seen[parity, side] = float(found.observable[0])
    assert [seen[-1, side] for side in ("right", "left", "top", "bottom")] == [0, 1, 1, 0]
    assert [seen[1, side] for side in ("right", "left", "top", "bottom")] == [1, 0, 1, 0]


@pytest.mark.parametrize(("mode", "side"), [("4q", "right"), *(("2q", s) for s in ("right", "left", "top", "bottom"))])
def test_the_zone_holds_its_edges(mode, side):
    # Edges that are exact in binary, and points on them, on either side of them and on the axes.
    zone = HoleZone(0.25, 2.0, mode, side)
    axis = np.unique(
        [
            sign * edge * (1 + off)
            for sign in (-1, 1)
            for edge in (0, 0.25, 0.375, 0.5, 1.875, 2)
            for off in (-1e-9, 0, 1e-9)
        ]
    )
    x, y = np.meshgrid(axis, axis)
    dark = {"right": x > 0, "left": x < 0, "top": y > 0, "bottom": y < 0}[side] | (mode == "4q")
    for margin in (0.0, 0.125):
        near, far = np.minimum(abs(x), abs(y)), np.maximum(abs(x), abs(y))
        expected = dark & (near >= 0.25 + margin) & (far <= 2.0 - margin)
        np.testing.assert_array_equal(zone.contains(x, y, margin), expected)
        assert 0 < expected.sum() < expected.size


def placed_by_hand(offsets_au, distances_au, albedo):
    """Draw planets and move them to x and y of equal offset, in the quadrant that the default parity calls left top."""
    n, drawn = len(offsets_au), planets({"radius_rjup": 10, "albedo": albedo}, n=len(offsets_au))
    there = np.array(offsets_au, float)
    return dataclasses.replace(
        drawn, east_au=there, north_au=there, distance_au=np.array(distances_au, float), phase_deg=np.full(n, 30.0)
    )


@pytest.mark.parametrize("mode", ["analogue", "photon_counting"])
def test_one_planet_in_one_frame(model, everyone, mode):
    """A large warm giant at a sunlike neighbour: one short frame shows it, half of one too, none does not."""
    model = with_strategy(model, mode=mode, library="idealised")
    sunlike = int(np.flatnonzero(everyone.name == "tau Cet")[0])
    stars = dataclasses.replace(everyone.select([sunlike] * 3), distance_pc=np.full(3, 5.0))
    drawn = placed_by_hand([2.0], [2.0], 0.5)
    for rows, frames in (([0], 1.0), ([0, 1, 2], 1.0), ([0, 1, 2], 0.5), ([0, 1, 2], 0.0)):
        found = completeness(
            model, stars.select(rows), "F520", drawn, exposure_s=[2.0], n_frames=frames, em_gain=[1000.0]
        )
        assert found.observable.tolist() == [1.0] * len(rows)
        assert found.completeness == pytest.approx([float(frames > 0)] * len(rows), abs=0.05)


def test_only_planets_that_are_observed_are_noted(model, everyone):
    # The models of the albedo reach from insolations of 0.5 to beyond 5 au, not to 20 au; F520 is dark to 0.7 arcsec.
    pair = dataclasses.replace(
        everyone.select([0, 0]), distance_pc=np.array([5.0, 3.2]), luminosity_lsun=np.array([1.0, 0.04])
    )
    drawn = placed_by_hand([2.0, 3.0], [1.0, 4.0], {"log10_mh": 0.5})
    setting = {"exposure_s": 20.0, "em_gain": 20.0}
    found = completeness(model, pair, "F520", drawn, n_frames=100, **setting)
    # The second star sees the first planet only: that the other would be too cold there is nobody's concern.
    assert found.observable.tolist() == [1.0, 0.5]
    assert found.flags == ()
    cold = placed_by_hand([2.0], [20.0], {"log10_mh": 0.5})
    assert completeness(model, pair.select([0]), "F520", cold, n_frames=100, **setting).flags == ("insolation_clamped",)
    assert completeness(model, pair.select([0]), "F520", cold, n_frames=0, **setting).flags == ()


def test_stars_too_far_and_no_frames_detect_nothing(model, stars):
    far = dataclasses.replace(stars, distance_pc=np.full(len(stars), 1e4))
    model = dataclasses.replace(model, strategy=IDEAL)
    drawn = planets({"planets_per_star": 0.5})
    for targets, frames in ((far, 1e9), (stars, 0.0)):
        found = completeness(model, targets, "F520", drawn, exposure_s=100.0, n_frames=frames, em_gain=20.0)
        assert not found.completeness.any()
        assert not found.standard_error.any()
        assert not found.expected_planets.any()
    assert completeness(model, stars, "F520", drawn, exposure_s=np.nan, n_frames=0, em_gain=0).observable.any()


def test_seeds_scatter_by_the_standard_error(model, stars):
    model = dataclasses.replace(model, strategy=IDEAL)
    results = [
        completeness(model, stars, "F520", planets(n=1000, seed=seed), exposure_s=20.0, n_frames=1e5, em_gain=20.0)
        for seed in range(24)
    ]
    values = np.stack([found.completeness for found in results])
    truth = values.mean(axis=0)
    # A planet that is detected with some chance scatters less than one that is or is not.
    error = np.sqrt(np.mean([found.standard_error**2 for found in results], axis=0))
    assert np.all(error <= np.sqrt(truth * (1 - truth) / 1000) * (1 + 1e-9))
    busy = truth > 0.005
    assert busy.sum() >= 4
    assert np.ptp(values, axis=0)[busy].min() > 0
    chi2 = (((values - truth) / np.where(error > 0, error, 1)) ** 2).sum(axis=0)[busy]
    assert np.all(np.abs(chi2 - 23) < 4.5 * math.sqrt(46))
    one = results[0]
    again = completeness(model, stars, "F520", planets(n=1000, seed=0), exposure_s=20.0, n_frames=1e5, em_gain=20.0)
    np.testing.assert_array_equal(again.completeness, one.completeness)


def test_what_is_known_against_a_loop_over_planets(model, everyone):
    """Every planet for itself: whether it is detected, times the probability that it may exist."""
    model = dataclasses.replace(model, strategy=IDEAL)
    names = everyone.name.tolist()
    two = everyone.select([names.index("tau Cet"), names.index("eps Eri")])
    drawn, setting = planets("giants", n=250), {"exposure_s": 20.0, "n_frames": 1e5, "em_gain": 20.0}
    limits = StarLimits.of(two.name.tolist())
    found = completeness(model, two, "F520", drawn, limits=limits, **setting)
    arrays = [name for name, value in vars(drawn).items() if isinstance(value, np.ndarray)]
    sums, placed = np.zeros((3, 2)), np.zeros(2)
    for k in range(len(drawn)):
        one: Planets = dataclasses.replace(drawn, **{name: getattr(drawn, name)[k : k + 1] for name in arrays})
        alone = completeness(model, two, "F520", one, **setting)
        seen = alone.completeness
        elements = (drawn.semi_major_axis_au[k], drawn.mass_mjup[k], drawn.inclination_deg[k])
        chance = [float(limits.allowed_probability(np.array([i]), *elements)[0]) for i in range(2)]
        sums += [seen, seen * chance, np.square(seen * chance)]
        placed += alone.completeness_known_place * chance
    mean = sums / 250
    np.testing.assert_allclose(found.completeness_unconditional, mean[0], rtol=1e-12)
    np.testing.assert_allclose(found.completeness, mean[1], rtol=1e-12)
    np.testing.assert_allclose(found.standard_error, np.sqrt((mean[2] - mean[1] ** 2) / 250), rtol=1e-9)
    np.testing.assert_allclose(found.completeness_known_place, placed / 250, rtol=1e-12)
    at_place = completeness(model, two, "F520", drawn, limits=limits, search="known_place", **setting)
    np.testing.assert_array_equal(at_place.expected_planets, 0.21 * found.completeness_known_place)
    assert (found.search, at_place.search) == ("blind", "known_place")
    assert np.all(found.completeness > 0.0)
    # Radial velocities exclude at least nine in ten of the giants that would be detected around tau Ceti.
    assert found.completeness[0] < 0.1 * found.completeness_unconditional[0]
    np.testing.assert_allclose(found.expected_planets, 0.21 * mean[1], rtol=1e-12)
    np.testing.assert_allclose(found.expected_planets_unconditional, 0.21 * mean[0], rtol=1e-12)


def test_stars_share_their_planets(model, stars):
    """Equal stars have equal completeness, to the last planet, whoever else is asked about."""
    model = dataclasses.replace(model, strategy=IDEAL)
    drawn, setting = planets(n=400), {"exposure_s": 20.0, "n_frames": 5e3, "em_gain": 20.0}
    twice = completeness(model, stars.select([0, 1, 0]), "F520", drawn, **setting)
    alone = completeness(model, stars.select([0]), "F520", drawn, **setting)
    assert twice.completeness[0] == twice.completeness[2] == alone.completeness[0] > 0


def test_expected_detections_and_flags(model, stars):
    model = dataclasses.replace(model, strategy=IDEAL)
    setting = {"exposure_s": 20.0, "n_frames": 5e3, "em_gain": 20.0}
    found = completeness(model, stars, "F520", planets("giants"), **setting)
    rate = load_population("giants").planets_per_star
    np.testing.assert_array_equal(found.expected_planets, rate * found.completeness)
    assert (found.band, found.n_planets, found.flags) == ("F520", 300, ())
    found = completeness(model, stars, "F520", planets({"albedo": {"log10_fsed": 2.0}}), **setting)
    assert found.expected_planets is None
    assert found.flags == ("fsed_clamped", "insolation_clamped")
    at_two = planets(
        {"semi_major_axis_au": 2, "eccentricity": 0, "semi_major_axis_scale": "insolation", "albedo": {"log10_mh": 0.5}}
    )
    assert completeness(model, stars, "F520", at_two, **setting).flags == ()
    dark = dataclasses.replace(
        model, metrics={"F520": dataclasses.replace(model.metrics["F520"], hole_state="not_reached")}
    )
    assert completeness(dark, stars, "F520", planets(n=5), **setting).flags == ("hole_not_reached",)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"band": "F9"}, "band = F9: not accepted; allowed: F520, F850"),
        ({"n_frames": -1}, "n_frames = -1.0: not accepted; allowed: finite numbers, at least 0"),
        (
            {"n_frames": [0, 0.5, 1, -2, -3, 4, 5, 6]},
            "n_frames = -2.0: not accepted; allowed: finite numbers, at least 0",
        ),
        ({"n_frames": np.nan}, "n_frames = nan: not accepted; allowed: finite numbers, at least 0"),
        ({"n_frames": [1, 2, 3]}, "n_frames = (3,): not accepted; allowed: one number, or one for each of 8 stars"),
        ({"exposure_s": 0}, "exposure_s = 0.0 s: not accepted; allowed: above 0"),
        ({"exposure_s": np.inf}, "exposure_s = inf s: not accepted; allowed: finite numbers"),
        ({"em_gain": 0.5}, "em_gain = 0.5: not accepted; allowed: at least 1"),
    ],
)
def test_refusals(refused, model, stars, changes, text):
    given = {"band": "F520", "exposure_s": 1.0, "n_frames": 10, "em_gain": 1.0} | changes
    message = refused("", completeness, model, stars, given.pop("band"), planets(n=3), **given)
    assert message == text


def test_counted_photons_have_one_gain(model, stars):
    model = with_strategy(model, mode="photon_counting")
    for gains in (np.linspace(100.0, 300.0, len(stars)), [100.0] * (len(stars) - 1) + [300.0]):
        with pytest.raises(InputError, match="one gain for all stars where photons are counted"):
            completeness(model, stars, "F520", planets(n=3), exposure_s=1.0, n_frames=10, em_gain=gains)
    # That of a star without frames is no gain.
    frames = [10] * (len(stars) - 1) + [0]
    assert completeness(model, stars, "F520", planets(n=3), exposure_s=1.0, n_frames=frames, em_gain=gains).flags == ()
