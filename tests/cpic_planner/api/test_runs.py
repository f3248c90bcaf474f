import pytest

import cpic_planner


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"strategy": {"mode": "photon_counting"}}, "not yet measured in images"),
        ({"strategy": {"librarry": "roll"}}, "librarry"),
        ({"simulator_overrides": {"thruput": "x0.7"}}, "thruput"),
        ({"simulator_overrides": {"throughput": "x-1"}}, "at least 0"),
        ({"realisations": 0}, "realisations"),
        ({"bands": ("F1265",)}, "near-infrared"),
    ],
)
def test_plans_and_scenes_refuse_alike(refused, tmp_path, settings, words):
    refused(words, cpic_planner.make_plan, tmp_path / "plan", top=1, n_planets=50, **settings)
    refused(words, cpic_planner.confirm_scene, "paper_example", out=tmp_path / "scene", **settings)
    assert not (tmp_path / "plan" / "plan.json").exists()
    assert not (tmp_path / "scene" / "confirm.json").exists()


def test_targets_take_planets_as_mappings(refused):
    refused("radius", cpic_planner.confirm_targets, "tau Cet", planet={"radius": 1})
    refused("not yet measured in images", cpic_planner.confirm_targets, "tau Cet", strategy={"mode": "photon_counting"})
