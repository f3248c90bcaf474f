import pytest

import cpic_planner
from catalogs.errors import InputError


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
def test_plans_and_scenes_refuse_alike(tmp_path, settings, words):
    with pytest.raises(InputError, match=words):
        cpic_planner.make_plan(tmp_path / "plan", top=1, n_planets=50, **settings)
    with pytest.raises(InputError, match=words):
        cpic_planner.confirm_scene("paper_example", out=tmp_path / "scene", **settings)
    assert not (tmp_path / "plan" / "plan.json").exists()
    assert not (tmp_path / "scene" / "confirm.json").exists()


def test_targets_take_planets_as_mappings():
    with pytest.raises(InputError, match="radius"):
        cpic_planner.confirm_targets("tau Cet", planet={"radius": 1})
    with pytest.raises(InputError, match="not yet measured in images"):
        cpic_planner.confirm_targets("tau Cet", strategy={"mode": "photon_counting"})
