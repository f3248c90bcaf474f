"""Visibility of stars as a result."""

from dataclasses import replace

import numpy as np
import pytest

from cpic_planner.results import VisibilityResult
from cpic_planner.survey.visibility import BLOCKS, load_visibility, visibility, visibility_result
from cpic_planner.targets import Targets, find_target
from simulator import load_instrument

ORBIT = load_instrument().mission.orbit
CONFIG = load_visibility()
YEAR = {"start_utc": "2028-01-01", "n_days": 366}


@pytest.fixture(scope="module")
def stars():
    return Targets.joined([find_target(name)[0] for name in ("tau Cet", "rho1 Cnc", "bet Hyi")])


@pytest.fixture(scope="module")
def result(stars):
    return visibility_result(stars, CONFIG, ORBIT, **YEAR, catalogue="test")


def test_numbers_are_those_of_the_calendar(stars, result):
    seen = visibility(stars.ra_deg, stars.dec_deg, CONFIG, ORBIT, **YEAR)
    assert result.mjd == seen.mjd.tolist()
    assert result.period_s == seen.period_s
    for row, target in enumerate(result.targets):
        assert target.days.visible_s == seen.visible_s[row].tolist()
        assert target.days.window_s == seen.window_s[row].tolist()
        assert [BLOCKS.index(name) for name in target.days.blocked_by] == seen.blocked_by[row].tolist()
        usable = seen.observable[row]
        assert target.observable_days == usable.sum()
        assert sum(target.blocked_days.values()) + target.observable_days == 366
        assert target.visible_s == np.median(seen.visible_s[row, usable])
        assert target.best_visible_s == seen.visible_s[row].max()
        assert target.longest_window_s == seen.window_s[row].max()
        best = int(np.argmax(seen.visible_s[row]))
        assert target.best_utc == seen.windows(row)[0][0] if best == 0 else target.best_utc > result.start_utc
        assert sum(season.days for season in target.seasons) == target.observable_days
        assert 0 < target.roll_half_range_deg <= 15


def test_known_stars(result):
    tau_cet, rho_cnc, beta_hyi = result.targets
    assert (tau_cet.hip, rho_cnc.hip, beta_hyi.hip) == (8102, 43587, 2021)
    # Beyond 50 deg from the ecliptic nothing blocks; beside it the Sun does twice as long as the panels' 40 deg.
    assert beta_hyi.ecliptic_latitude_deg == pytest.approx(-64.8, abs=0.1)
    assert beta_hyi.observable_days == 366
    assert len(beta_hyi.seasons) == 1
    assert rho_cnc.ecliptic_latitude_deg == pytest.approx(10.4, abs=0.1)
    assert 98 <= rho_cnc.blocked_days["sun"] <= 106
    assert rho_cnc.blocked_days["moon"] > 10
    assert tau_cet.blocked_days["moon"] == 0
    # Opposite the Sun in early October: the season before ends, the one behind begins 140 deg from the Sun.
    assert [season.end_utc[:7] for season in tau_cet.seasons] == ["2028-02", "2028-09", "2029-01"]


def test_round_trip_and_hash(stars, result):
    assert VisibilityResult.model_validate_json(result.model_dump_json()) == result
    again = visibility_result(stars, CONFIG, ORBIT, **YEAR, catalogue="other words")
    assert again.config_hash == result.config_hash
    month = {"start_utc": "2028-01-01", "n_days": 31}
    hashes = {
        visibility_result(stars, CONFIG, ORBIT, **month).config_hash,
        visibility_result(stars, load_visibility({"moon_deg": 30}), ORBIT, **month).config_hash,
        visibility_result(stars, CONFIG, ORBIT.model_copy(update={"node_deg": 10.0}), **month).config_hash,
        visibility_result(stars, CONFIG, ORBIT, start_utc="2028-01-02", n_days=31).config_hash,
        visibility_result(stars.select([0]), CONFIG, ORBIT, **month).config_hash,
        result.config_hash,
    }
    assert len(hashes) == 6


def test_a_star_that_is_never_seen(stars):
    never = visibility_result(stars.select([0]), load_visibility({"sun_deg": 179}), ORBIT, **YEAR)
    (target,) = never.targets
    assert (target.observable_days, target.seasons) == (0, [])
    assert target.visible_s is target.best_utc is target.longest_window_s is target.roll_half_range_deg is None
    assert target.blocked_days["sun"] == 366


def test_a_star_without_coordinates_is_refused_by_name(refused, stars):
    bare = replace(stars, ra_deg=np.array([1.0, np.nan, 2.0]))
    refused(r"ra_deg, dec_deg = missing deg: .* has none of rho1 Cnc", visibility_result, bare, CONFIG, ORBIT, **YEAR)
