import dataclasses

import pytest

from cpic_planner.tradeoff.points import TOLERANCES_MEASURED, named_points, points_of
from cpic_planner.tradeoff.run import chosen, n_rows
from cpic_planner.tradeoff.scenes import SCENES
from cpic_planner.tradeoff.setup import reference_setup


@pytest.mark.parametrize("name", SCENES)
def test_knobs_and_effects_change_one_thing_of_the_reference(name):
    case = SCENES[name]
    best, points = reference_setup(case), points_of(case)
    assert len({point.name for point in points}) == len(points)
    for point in points:
        if not point.shares_process:
            continue
        changed = [
            item.name
            for item in dataclasses.fields(best)
            if getattr(point.setup, item.name) != getattr(best, item.name)
        ]
        assert len(changed) == 1, point.name
        if changed == ["knobs"]:
            ours, theirs = point.setup.knobs.model_dump(), best.knobs.model_dump()
            assert sum(ours[key] != theirs[key] for key in ours) == 1
        assert point.light_changes == (changed != ["switches"])


def test_every_way_of_the_dial_is_there():
    points = {point.name: point for point in points_of(SCENES["binary"])}
    assert [points[name].fidelity for name in ("quick", "standard")] == ["quick", "standard"]
    assert [points[f"tolerance_{value:g}"].tolerance for value in TOLERANCES_MEASURED] == list(TOLERANCES_MEASURED)
    assert set(
        """
        etc etc_many sums_quick sums_standard hole_quick hole_standard full_standard reference wavelengths_1
        pixel_nodes_4 single pupil_64 epochs_1 window paper_scene no_blooming no_sky no_drift no_other_stars
    """.split()
    ) <= set(points)
    assert "exact_scene" in {point.name for point in points_of(SCENES["paper"])}
    assert (
        "no_persistence" in {point.name for point in points_of(SCENES["infrared"])}
        or not SCENES["infrared"].instrument.near_infrared.detector.switches.persistence
    )


def test_what_is_asked_for():
    work = chosen(["faint", "edge"], ["etc"])
    assert [(case.name, [point.name for point in points]) for case, points in work] == [
        ("faint", ["etc"]),
        ("edge", ["etc"]),
    ]
    assert n_rows(work) == 2
    glance = chosen(["faint"], quick_look=True)
    assert glance[0][0].n_frames == 2
    assert not any(point.shares_process for point in glance[0][1])
    # A way that only some scenes have.
    assert [case.name for case, _ in chosen([], ["no_other_stars"])] == ["binary", "field"]


def test_refusals(refused):
    refused(r"--only = fast: not accepted; allowed: .*etc", chosen, [], ["fast"])
    refused(r"--only = no_other_stars", chosen, ["faint"], ["no_other_stars"])
    refused("a point of faint", named_points, SCENES["faint"], ("fast",))
