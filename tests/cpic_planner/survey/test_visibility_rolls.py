"""Limits of pointing: the preset and its sources, files and mappings, refusals.

Solar panels: closed forms against panels that are turned step by step.
"""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from matplotlib.path import Path as Outline

from cpic_core import load_yaml
from cpic_planner.survey.visibility import PACKAGE, VisibilityConfig, load_visibility, roll_half_range_deg, slew_s
from simulator import load_instrument
from simulator.config import preset_names, preset_path
from simulator.products import CircularOrbit


@pytest.mark.parametrize("name", preset_names("visibility", package="cpic_planner"))
def test_presets_are_complete_and_sourced(name):
    config = load_visibility(name)
    assert config.name == name
    assert config.description
    tree = load_yaml(preset_path("visibility", name, package=PACKAGE))
    numbers = set(VisibilityConfig.model_fields) - {"name", "description"}
    # The Sun's limit is said in the instrument's preset alone.
    assert set(tree) - {"kind", "name", "description"} | {"sun_deg"} == numbers == set(config.provenance)
    for key, standing in config.provenance.items():
        assert standing.source, key
        assert standing.confidence in ("P", "I", "A"), key
        if standing.confidence == "A":
            low, high = standing.range
            assert low <= getattr(config, key) <= high, key


def test_default_values():
    config = load_visibility()
    assert load_visibility("default") == config
    assert load_visibility(config) is config
    assert (config.sun_deg, config.moon_deg, config.dark_limb_deg, config.bright_limb_deg) == (50, 20, 10, 30)
    assert config.sun_deg == load_instrument().sky.sun_limit_deg
    assert config.provenance["sun_deg"] == load_instrument().provenance["sky.sun_limit_deg"]
    assert (config.panel, config.panel_deg, config.roll_deg, config.saa_fraction) == ("one_axis", 25, 15, 0.08)
    assert (config.settle_s, config.thermal_settle_orbits) == (180, 1)


def test_share_of_the_anomaly_is_that_of_the_quoted_polygon_and_a_margin():
    # Corners (longitude, latitude) of the survey planning's polygon; over days an orbit passes every longitude alike.
    outline = Outline([(-13, -42.5), (-72, -42.5), (-81, -25), (-54, -15), (5, -32)])
    orbit = CircularOrbit(load_instrument().mission.orbit)
    position, _ = orbit.state(np.linspace(0, orbit.period_s, 4000, endpoint=False))
    latitude = np.degrees(np.arcsin(position[:, 2] / orbit.radius_km))
    longitude = np.linspace(-180, 180, 720, endpoint=False)
    points = np.stack(np.meshgrid(longitude, latitude), axis=-1).reshape(-1, 2)
    share = outline.contains_points(points).mean()
    assert share == pytest.approx(0.062, abs=0.0005)
    assert "6.2 %" in load_visibility().provenance["saa_fraction"].source
    assert share < load_visibility().saa_fraction


def test_slews_follow_the_quoted_times(refused):
    survey = load_visibility({"settle_s": 68})
    # Angle (deg) and time (s) of the survey planning.
    for angle, time_s in ((20, 127), (45, 196), (180, 581)):
        assert float(slew_s(angle, survey)) == pytest.approx(time_s, abs=2)
    assert slew_s([0.0, 35.0, 180.0], load_visibility()).tolist() == pytest.approx([0.0, 280.0, 180 / 0.35 + 180])
    for angle in (-1.0, 181.0, float("nan"), "far"):
        refused("angle_deg", slew_s, angle, survey)


def test_changes_are_laid_over_the_base(tmp_path):
    near = load_visibility({"moon": 40})
    assert near.moon_deg == 40
    assert near.name == "default+changes"
    assert near.sun_deg == load_visibility().sun_deg
    assert "moon_deg" not in near.provenance
    assert near.provenance["sun_deg"] == load_visibility().provenance["sun_deg"]
    path = tmp_path / "strict.yaml"
    path.write_text(
        'kind: visibility\nbase: default\nbright_limb_deg: {value: 70, unit: deg, source: "survey", confidence: P}\n'
    )
    strict = load_visibility(str(path))
    assert (strict.name, strict.bright_limb_deg) == ("strict", 70)
    assert strict.provenance["bright_limb_deg"].confidence == "P"
    assert load_visibility(path).content() == strict.content() != load_visibility().content()
    assert load_visibility({"name": "other words"}).content() == load_visibility().content()
    assert load_visibility({}) == load_visibility().model_copy(update={"description": ""})


def test_a_file_that_is_no_mapping_is_refused(refused, tmp_path):
    path = tmp_path / "list.yaml"
    path.write_text("- 1\n")
    refused("a YAML mapping of kind visibility", load_visibility, path)


def limits(**values):
    return load_visibility({"roll_deg": 90} | values)


def smallest_angle_deg(theta, psi, turn, steps=801):
    """Angle from the Sun of the best of many normals, for a boresight along z and panels that turn about y."""
    theta, psi = np.radians(theta), np.radians(psi)
    sun = np.array([np.sin(theta) * np.cos(psi), np.sin(theta) * np.sin(psi), np.cos(theta)])
    turned = np.radians(np.linspace(-turn, turn, steps))
    normals = np.stack([np.cos(turned), np.zeros(steps), np.sin(turned)], axis=-1)
    return np.degrees(np.arccos(np.clip(normals @ sun, -1, 1))).min()


@given(st.floats(0.5, 179.5), st.floats(0, 90), st.floats(1, 80))
def test_at_the_end_of_the_range_the_best_normal_is_at_its_limit(theta, turn, limit):
    (half,) = roll_half_range_deg(np.array([theta]), limits(panel_turn_deg=turn, panel_deg=limit))
    at_rest = smallest_angle_deg(theta, 0.0, turn)
    if np.isnan(half):
        assert at_rest > limit - 1e-6
    else:
        assert 0 <= half <= 90
        assert at_rest <= limit + 0.1
        assert smallest_angle_deg(theta, half, turn) <= limit + 0.1
        if half < 89:
            # A little more roll is too much.
            assert smallest_angle_deg(theta, half + 0.5, turn) >= limit - 0.1
            assert smallest_angle_deg(theta, half * 0.5, turn) <= limit + 0.1


def test_free_panels_follow_their_rule():
    theta = np.linspace(0, 180, 181)
    half = roll_half_range_deg(theta, limits(panel_turn_deg=90))
    rolled = np.sin(np.radians(theta)) * np.sin(np.radians(half))
    assert np.all(rolled <= np.sin(np.radians(25)) + 1e-12)
    # Whatever is less than all around stands at the limit.
    inside = half < 90 - 1e-9
    assert rolled[inside] == pytest.approx(np.sin(np.radians(25)))
    assert np.sin(np.radians(theta[~inside])).max() <= np.sin(np.radians(25)) + 1e-9


def test_fixed_panels_follow_their_rule():
    theta = np.linspace(0, 180, 361)
    half = roll_half_range_deg(theta, limits(panel="fixed"))
    seen = np.isfinite(half)
    assert theta[seen].tolist() == np.linspace(65, 115, 101).tolist()
    assert np.sin(np.radians(theta[seen])) * np.cos(np.radians(half[seen])) == pytest.approx(np.cos(np.radians(25)))
    # What panels of one axis may turn by is nothing to fixed ones.
    other = roll_half_range_deg(theta, limits(panel="fixed", panel_turn_deg=60))
    np.testing.assert_array_equal(half, other)
    np.testing.assert_allclose(roll_half_range_deg(theta, limits(panel_turn_deg=0)), half)


def test_default_reaches_from_40_to_140_degrees_with_the_roll_that_is_free():
    config = load_visibility()
    theta = np.array([39.9, 40.0, 90.0, 140.0, 140.1])
    half = roll_half_range_deg(theta, config)
    assert np.isnan(half).tolist() == [True, False, False, False, True]
    assert half[1:4].tolist() == pytest.approx([0.0, 15.0, 0.0], abs=1e-4)
    assert np.nanmax(roll_half_range_deg(np.linspace(0, 180, 200), config)) == 15.0


def test_no_limit():
    half = roll_half_range_deg(np.linspace(0, 180, 50), limits(panel_deg=90, panel_turn_deg=90))
    assert half == pytest.approx(90.0)
