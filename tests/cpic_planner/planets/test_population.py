"""Populations: presets and their sources, files and mappings, seeded draws."""

import math

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from cpic_core import load_yaml
from cpic_planner.planets import Planets, PopulationConfig, draw_population, load_population
from cpic_planner.planets.population import PACKAGE, QUANTITIES
from simulator.config import preset_names, preset_path

ARRAYS = (*QUANTITIES, "kind", "east_au", "north_au", "distance_au", "phase_deg")
DRAWN = QUANTITIES[:2]


def same(one: Planets, other: Planets, names=ARRAYS, n=None):
    return all(np.array_equal(getattr(one, name)[:n], getattr(other, name)[:n]) for name in names)


@pytest.mark.parametrize("name", preset_names("population", package=PACKAGE))
def test_presets_are_complete_and_sourced(name):
    config = load_population(name)
    assert config.name == name
    assert config.description
    for key, standing in config.provenance.items():
        assert standing.source, key
        assert standing.confidence in ("P", "I", "A"), key
    # Every number but those of isotropic geometry says where it is from.
    sourced = config.provenance

    def walk(tree, path):
        if isinstance(tree, dict):
            for key, item in tree.items():
                walk(item, f"{path}.{key}" if path else key)
        elif isinstance(tree, list):
            for number, item in enumerate(tree):
                walk(item, f"{path}[{number}]")
        elif isinstance(tree, float | int):
            assert any(path == f"{key}.value" or path.startswith(f"{key}.range") for key in sourced), path

    walk(
        {
            key: item
            for key, item in load_yaml(preset_path("population", name, package=PACKAGE)).items()
            if not key.endswith("_deg")
        },
        "",
    )


def test_default_preset_is_giants():
    config = load_population("giants")
    assert load_population() == config
    assert load_population(config) is config


def test_numbers_of_the_giants_follow_from_what_they_quote():
    config = load_population("giants")
    law = config.semi_major_axis_au
    assert law.turn == pytest.approx((1581 / 365.25) ** (2 / 3), abs=0.005)
    # dN/dln P ~ P^p with P ~ a^1.5 is dN/da ~ a^(1.5 p - 1).
    assert law.index_inner == pytest.approx(1.5 * 0.65 - 1)
    assert law.index_outer == pytest.approx(-1.5 * 0.65 - 1)

    def number(low, high):
        def density(a):
            return (a / law.turn) ** (law.index_inner if a < law.turn else law.index_outer)

        return quad(density, low, high, points=[law.turn], limit=200)[0]

    share = number(law.low, law.high) / number(0.1, 100.0)
    assert share == pytest.approx(0.79, abs=0.005)
    assert config.planets_per_star == pytest.approx(0.266 * share, abs=0.005)
    # Stars with 1, 2, and 3 or 4 giants within 10 au, per cent, by Li & Zhu 2026: HARPS, then the California survey.
    harps, california = 7.8 + 2 * 2.3 + 3 * 0.5, 7.3 + 2 * 7.2 + 4 * 1.0
    assert config.provenance["planets_per_star"].range == (
        pytest.approx(harps / 100, abs=0.005),
        pytest.approx(california / 100, abs=0.005),
    )
    e = config.eccentricity
    assert stats.beta(e.a, e.b).sf(e.high) == pytest.approx(1e-4, rel=0.5)


def test_masses_are_the_least_of_their_radii_or_those_stated():
    giants = draw_population(load_population("giants"), 3000, 1)
    # Chen & Kipping 2017: radius of the giants' lower branch, R = 1.008 2.04^0.279 (M / 2.04)^0.589 Earth radii.
    earths = giants.mass_mjup * 317.828
    radius = 1.008 * 2.04**0.279 * (earths / 2.04) ** 0.589 / (71492 / 6378.1)
    np.testing.assert_allclose(radius, giants.radius_rjup, rtol=1e-12)
    assert 0.08 < giants.mass_mjup.min() < giants.mass_mjup.max() < 0.38
    assert set(draw_population(load_population("jupiters"), 50, 1).mass_mjup.tolist()) == {1.0}
    # Ratios of the masses of the Sun and the planets with their moons, as of 2009.
    sun_over = {"jupiter": 1047.348644, "saturn": 3497.9018, "uranus": 22902.98, "neptune": 19412.26}
    solar = draw_population(load_population("solar_system"), 400, 1)
    expected = [sun_over["jupiter"] / sun_over[solar.kind_names[kind]] for kind in solar.kind]
    np.testing.assert_allclose(solar.mass_mjup, expected, rtol=1e-4)


def test_another_radius_has_the_mass_of_the_relation():
    smaller = load_population({"base": "jupiters", "radius_rjup": 0.5})
    assert draw_population(smaller, 5, 1).mass_mjup == pytest.approx(0.0843, rel=1e-3)
    stated = load_population({"base": "jupiters", "radius_rjup": 0.5, "mass": 0.05})
    assert draw_population(stated, 5, 1).mass_mjup == pytest.approx(0.05)
    kinds = [{"name": "small", "radius_rjup": 0.5}, {"name": "large", "mass_mjup": 2.0}]
    mixed = draw_population(load_population({"base": "jupiters", "kinds": kinds}), 100, 1)
    np.testing.assert_allclose(mixed.mass_mjup, np.where(mixed.kind == 0, mixed.mass_mjup.min(), 2.0))
    assert mixed.mass_mjup.min() == pytest.approx(0.0843, rel=1e-3)


@pytest.mark.parametrize("mass", [0, -1, 101, "unknown_relation", {"law": "uniform", "low": 1, "high": 2}])
def test_masses_that_are_no_mass_are_refused(refused, mass):
    refused("mass_mjup", load_population, {"mass_mjup": mass})


def test_solar_system_planets_stay_together():
    planets = draw_population(load_population("solar_system"), 4000, 1)
    pairs, counts = np.unique(np.stack([planets.radius_rjup, planets.semi_major_axis_au]), axis=1, return_counts=True)
    assert pairs.T.tolist() == [[0.3464, 30.0699], [0.3575, 19.1892], [0.843, 9.5367], [1.0, 5.2029]]
    assert np.abs(counts - 1000).max() < 4 * math.sqrt(750)
    assert [albedo.model for albedo in planets.albedos] == list(planets.kind_names)
    np.testing.assert_allclose(planets.distance_au, planets.semi_major_axis_au, rtol=1e-12)


@pytest.mark.parametrize("name", preset_names("population", package=PACKAGE))
def test_draws_keep_to_their_laws(name):
    config = load_population(name)
    planets = draw_population(config, 20000, 7)
    assert len(planets) == 20000
    for number, kind in enumerate(config.mixture):
        mine = planets.kind == number
        for quantity in QUANTITIES:
            low, high = getattr(kind, quantity).support
            values = getattr(planets, quantity)[mine]
            assert values.min() >= low
            assert values.max() <= high
    # Poles anywhere, phases of such orbits: both have even cosines.
    for angle in (planets.inclination_deg, planets.phase_deg):
        assert stats.kstest(np.cos(np.radians(angle)), stats.uniform(-1, 2).cdf).pvalue > 1e-4
    pa = np.degrees(np.arctan2(planets.east_au, planets.north_au)) % 360
    assert stats.kstest(pa, stats.uniform(0, 360).cdf).pvalue > 1e-4
    mean = (planets.semi_major_axis_au * (1 + planets.eccentricity**2 / 2)).mean()
    error = planets.distance_au.std() / math.sqrt(len(planets))
    assert abs(planets.distance_au.mean() - mean) < 4 * error
    rho = np.hypot(planets.east_au, planets.north_au)
    np.testing.assert_allclose(rho, planets.distance_au * np.sin(np.radians(planets.phase_deg)), rtol=1e-9, atol=1e-12)


def test_first_planets_of_a_larger_draw_are_those_of_a_smaller_one():
    for name in preset_names("population", package=PACKAGE):
        config = load_population(name)
        assert same(draw_population(config, 100, 3), draw_population(config, 2500, 3), n=100)


def test_seed_decides_the_draw():
    config = load_population()
    one = draw_population(config, 500, 1)
    assert same(one, draw_population(config, 500, 1))
    other = draw_population(config, 500, 2)
    for name in (*DRAWN, "eccentricity", "inclination_deg", "node_deg", "mean_anomaly_deg"):
        assert not np.any(getattr(one, name) == getattr(other, name))


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_another_law_leaves_the_other_draws_alone(quantity):
    plain = draw_population(load_population(), 200, 5)
    changed = draw_population(load_population({quantity: {"law": "uniform", "low": 0.1, "high": 0.4}}), 200, 5)
    assert same(plain, changed, names=[name for name in QUANTITIES if name != quantity])
    assert not np.any(getattr(plain, quantity) == getattr(changed, quantity))
    # The same share of the population: a rank stays a rank.
    np.testing.assert_array_equal(np.argsort(getattr(plain, quantity)), np.argsort(getattr(changed, quantity)))


def test_quantities_are_independent_of_each_other():
    planets = draw_population(load_population(), 20000, 11)
    values = np.stack([getattr(planets, name) for name in QUANTITIES])
    correlation = np.corrcoef(values)[~np.eye(len(QUANTITIES), dtype=bool)]
    assert np.abs(correlation).max() < 4.5 / math.sqrt(20000)


def test_mixture_inherits_what_a_kind_does_not_state():
    config = load_population(
        {
            "eccentricity": 0,
            "kinds": [{"name": "big", "radius_rjup": 1.1, "weight": 3}, {"radius_rjup": 0.4, "albedo": 0.3}],
        }
    )
    big, small = config.mixture
    assert big.semi_major_axis_au == small.semi_major_axis_au == load_population().semi_major_axis_au
    assert (big.albedo.model, small.albedo.model) == ("jupiter", "constant")
    planets = draw_population(config, 40000, 2)
    assert abs((planets.radius_rjup == 1.1).mean() - 0.75) < 4 * math.sqrt(0.75 * 0.25 / 40000)
    assert np.all(planets.eccentricity == 0)
    assert planets.kind_names == ("big", "")


def test_changes_are_laid_over_the_base():
    base = load_population("giants")
    near = load_population({"semi_major_axis_au": {"high": 5}})
    assert near.semi_major_axis_au == base.semi_major_axis_au.model_copy(update={"high": 5.0})
    assert near.name == "giants+changes"
    assert near.radius_rjup == base.radius_rjup
    assert "semi_major_axis_au.high" not in near.provenance
    assert near.provenance["semi_major_axis_au.low"] == base.provenance["semi_major_axis_au.low"]
    other = load_population({"base": "jupiters", "semi_major_axis": {"law": "uniform", "low": 1, "high": 2}})
    assert other.semi_major_axis_au.law == "uniform"
    assert other.eccentricity == load_population("jupiters").eccentricity
    # An occurrence rate is that of its own population.
    assert (base.planets_per_star is not None, near.planets_per_star) == (True, None)
    assert load_population({"planets_per_star": 0.1}).planets_per_star == 0.1


def test_file_finds_albedos_beside_it(tmp_path):
    (tmp_path / "spectrum.txt").write_text("300 0.5\n1800 0.5\n")
    path = tmp_path / "mine.yaml"
    path.write_text("kind: population\nradius_rjup: 0.7\nalbedo: spectrum.txt\n")
    config = load_population(path)
    assert config.name == "mine"
    assert config.albedo.file == str(tmp_path / "spectrum.txt")
    before = config.content()
    assert load_population(str(path)).content() == before
    (tmp_path / "spectrum.txt").write_text("300 0.4\n1800 0.4\n")
    assert config.content() != before


def test_content_is_what_decides_a_draw():
    content = load_population().content()
    assert load_population({"name": "other words", "planets_per_star": 0.21}).content() == content
    assert load_population({"planets_per_star": 0.3}).content() != content
    assert load_population({"planets_per_star": 0.21, "node_deg": 0}).content() != content
    one = load_population("solar_system")
    assert PopulationConfig.model_validate(one.model_dump(mode="json")).content_hash == one.content_hash


def test_orbits_may_follow_insolation(refused):
    luminosity = np.array([0.25, 1.0, 9.0])
    assert draw_population(load_population(), 5, 1).scale(luminosity).tolist() == [1.0, 1.0, 1.0]
    planets = draw_population(load_population({"semi_major_axis_scale": "insolation"}), 5, 1)
    assert planets.scale(luminosity).tolist() == [0.5, 1.0, 3.0]
    refused("luminosity_lsun = nan L_sun: not accepted; allowed: above 0", planets.scale, np.array([1.0, np.nan]))


def test_kinds_that_state_everything_need_nothing_of_the_base():
    planets = draw_population(load_population({"kinds": [{"radius_rjup": 1.0}, {"radius_rjup": 0.5}]}), 50, 1)
    assert set(planets.radius_rjup.tolist()) == {1.0, 0.5}


def test_file_that_is_no_mapping(refused, tmp_path):
    path = tmp_path / "list.yaml"
    path.write_text("- 1\n")
    refused("allowed: a YAML mapping of kind population", load_population, path)
