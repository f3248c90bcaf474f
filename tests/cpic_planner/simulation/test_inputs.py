import json

import pytest

from catalogs.errors import InputError
from cpic_planner.simulation.inputs import simulation_from
from simulator.config import load_scene

TABLE = "name,distance_pc,v_mag,sp_type\nA star,10,5.0,G2V\nB star,3,4.0,K1V\n"
SCENE = {"name": "mine", "cstar": {"v_mag": 5, "teff_k": 5800}}


def test_a_scene_by_preset_file_mapping_and_object(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(json.dumps(SCENE))
    what = ["paper_example", str(path), path, SCENE, load_scene("paper_reference")]
    found, notes = simulation_from(what, settings={"band": "F520", "exposure_s": [1, 2]}, changes={"frames": 3})
    assert [item.scene.name for item in found.sequences] == ["alpha Cen B", "mine", "mine", "mine", "alpha Cen B alone"]
    assert {(item.band, item.exposure_s, item.frames) for item in found.sequences} == {(("F520",), (1.0, 2.0), 3)}
    assert found.name == "alpha Cen B and 4 more"
    assert notes == ()


def test_a_simulation_by_preset_file_and_mapping(tmp_path):
    tree = {"name": "mine", "sequences": [{"kind": "BIAS"}, {"scene": SCENE, "band": "F520"}]}
    path = tmp_path / "mine.yaml"
    path.write_text(json.dumps(tree))
    for what in (tree, path, str(path)):
        found, _ = simulation_from([what], changes={"seed": 5})
        assert [(item.kind, item.seed) for item in found.sequences] == [("BIAS", 5), ("SCI", 5)]
    found, _ = simulation_from(["paper_shifted_star"])
    assert found.name == "paper_shifted_star"
    assert found.description
    both, _ = simulation_from(["paper_shifted_star", path])
    assert len(both.sequences) == 6


def test_every_row_of_a_table_is_a_scene(tmp_path):
    path = tmp_path / "stars.csv"
    path.write_text(TABLE)
    found, _ = simulation_from([path], settings={"band": "F662"})
    assert [(item.scene.name, item.scene.cstar.v_mag) for item in found.sequences] == [("A star", 5.0), ("B star", 4.0)]
    assert found.name == "stars"


@pytest.mark.parametrize("kind", ["fits", "ecsv"])
def test_tables_of_astropy(tmp_path, kind):
    from astropy.table import Table

    path = tmp_path / f"stars.{kind}"
    rows = Table({"name": ["a", "b"], "distance_pc": [10.0, 3.0], "v_mag": [5.0, 4.0], "teff_k": [5800.0, 5000.0]})
    rows.write(path, format="ascii.ecsv" if kind == "ecsv" else kind)
    found, _ = simulation_from([path], settings={"band": "F662"})
    assert [item.scene.name for item in found.sequences] == ["a", "b"]


def test_the_snapshot_is_a_table():
    found, _ = simulation_from(["snapshot"], settings={"band": "F662"})
    assert len(found.sequences) > 1000


def test_calibration_kinds_need_nothing():
    found, _ = simulation_from([], settings={"kind": "BIAS"}, changes={"frames": 10})
    (only,) = found.sequences
    assert (found.name, only.kind, only.frames) == ("BIAS", "BIAS", 10)


@pytest.mark.parametrize(
    ("what", "settings", "changes", "words"),
    [
        ([], {}, {}, ["what", "missing", "paper_example", "calibration_set"]),
        (["paper_exmple"], {}, {}, ["paper_exmple", "did you mean paper_example"]),
        (["nowhere.csv"], {}, {}, ["nowhere.csv", "exists"]),
        (["paper_example"], {"kind": "BIAS"}, {}, ["what", "paper_example", "BIAS looks at no scene"]),
        (["paper_example"], {"level_e": 3.0}, {}, ["level_e", "FLAT, LASER", "not for SCI"]),
        (["paper_shifted_star"], {"band": ("F520",)}, {}, ["band", "a simulation names its own"]),
        (["calibration_set"], {}, {"fidelity": "quick"}, ["fidelity", "SCI, DSF, CALS"]),
        ([{"kind": "instrument"}], {}, {}, ["kind instrument", "kind: scene"]),
        ([7], {}, {}, ["what", "7"]),
        ([""], {}, {}, ["what"]),
    ],
)
def test_what_cannot_be_used_is_refused(what, settings, changes, words):
    with pytest.raises(InputError) as refused:
        simulation_from(what, settings=settings, changes=changes)
    for word in words:
        assert word in str(refused.value)


def test_settings_of_a_scene_stand_beside_a_simulation():
    found, _ = simulation_from(["calibration_set", SCENE], settings={"band": "F520"}, changes={"fidelity": "quick"})
    assert found.sequences[-1].band == ("F520",)
    assert found.sequences[-1].fidelity == "quick"
