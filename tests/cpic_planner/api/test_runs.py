"""Visibility and surveys by star names: the answers of the commands, refused as clearly."""

import pytest

import cpic_planner
from cpic_planner import compare_strategies, star_visibility


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"strategy": {"mode": "photon_counting"}, "fidelity": "reference"}, "not yet frame by frame"),
        ({"strategy": {"librarry": "roll"}}, "librarry"),
        ({"simulator_overrides": {"thruput": "x0.7"}}, "thruput"),
        ({"simulator_overrides": {"throughput": "x-1"}}, "at least 0"),
        ({"realisations": 0}, "realisations"),
        ({"bands": ("F999",)}, "F999"),
    ],
)
def test_plans_and_scenes_refuse_alike(refused, tmp_path, settings, words):
    refused(words, cpic_planner.make_plan, tmp_path / "plan", top=1, n_planets=50, **settings)
    refused(words, cpic_planner.confirm_scene, "paper_example", out=tmp_path / "scene", **settings)
    assert not (tmp_path / "plan" / "plan.json").exists()
    assert not (tmp_path / "scene" / "confirm.json").exists()


def test_targets_take_planets_as_mappings(refused):
    refused("radius", cpic_planner.confirm_targets, "tau Cet", planet={"radius": 1})
    counting = {"strategy": {"mode": "photon_counting"}, "fidelity": "reference"}
    refused("not yet frame by frame", cpic_planner.confirm_targets, "tau Cet", **counting)


ONE = {"strategies": [{"name": "once", "targets": {"names": ["eps Eri"]}, "visit": {"bands": ["F520"]}}]}
SHORT = {"universes": 30, "duration_days": 365.0, "known_planets": "off"}


def test_visibility_of_several_stars_by_any_name():
    seen = star_visibility(["eps Eri", "HIP 8102"], start_utc="2028-01-01", n_days=60, limits={"sun_deg": 60})
    assert [star.name for star in seen.targets] == ["eps Eri", "tau Cet"]
    assert seen.n_days == 60
    assert seen.pointing.sun_deg == 60


def test_one_visit_of_one_star_and_the_folder_that_keeps_it(tmp_path):
    result = compare_strategies(ONE, out=tmp_path / "run", **SHORT)
    assert result.n_universes == 30
    assert result.strategies[0].schedule.visits == 1
    assert result == compare_strategies(ONE, **SHORT)
    assert {"whatif.json", "report.html", "universes.parquet"} <= {path.name for path in (tmp_path / "run").iterdir()}


def test_values_that_are_varied():
    result = compare_strategies(ONE, vary=["drift=x1,0.15nm"], **SHORT)
    assert [item.name for item in result.strategies] == ["once drift=x1 (0.05 nm)", "once drift=0.15 nm"]
    assert result.strategies[0].schedule.value > result.strategies[1].schedule.value


@pytest.mark.parametrize(
    ("given", "text"),
    [({"slot_days": 0}, "slot_days = 0 d"), ({"universes": 1}, "universes = 1"), ({"vary": ["foo=1"]}, "--vary = foo")],
)
def test_what_is_refused(refused, given, text):
    message = refused("", compare_strategies, ONE, **given)
    assert message.startswith(text)


def test_the_date_places_stars_and_is_the_first_day_unless_another_is_given():
    stars = ["61 Cyg A"]
    dated = star_visibility(stars, date_utc="2030-01-01", n_days=3)
    assert dated.start_utc == "2030-01-01T00:00:00"
    later = star_visibility(stars, date_utc="2060-01-01", start_utc="2030-01-01", n_days=3)
    assert later.start_utc == dated.start_utc
    # 30 years at 3.2 arcsec a year in declination (van Leeuwen 2007).
    moved = later.targets[0].dec_deg - dated.targets[0].dec_deg
    assert moved * 3600.0 == pytest.approx(30.0 * 3.269, rel=0.01)


def test_a_scene_is_observed_at_the_date():
    from cpic_planner.queries import ConfirmQuestion

    asked = ConfirmQuestion.of({"scene": "paper_example", "date_utc": "2031-02-03"})
    assert asked.instrument.mission.start_utc == "2031-02-03T00:00:00"
    plain = ConfirmQuestion.of({"scene": "paper_example"})
    assert plain.content_hash != asked.content_hash


def test_the_survey_takes_its_places_from_its_begin_or_the_date(monkeypatch):
    from cpic_planner.survey import prepare

    seen = []
    sample = prepare.rank_sample
    monkeypatch.setattr(prepare, "rank_sample", lambda **cuts: seen.append(cuts["date_utc"]) or sample(**cuts))
    once = {"strategies": [{"name": "once", "targets": {"names": ["eps Eri"]}, "visit": {"bands": ["F520"]}}]}
    for given in ({}, {"date_utc": "2031-01-01"}):
        compare_strategies(once, universes=2, duration_days=60.0, start_utc="2029-01-01", **given)
    assert seen == ["2029-01-01T00:00:00", "2031-01-01T00:00:00"]
