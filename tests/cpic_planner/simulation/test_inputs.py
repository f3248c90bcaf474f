"""What sequences leave out is known before their frames are made, and is what the frames leave out."""

import json

import pytest

from cpic_core import InputError
from cpic_planner.simulation import (
    disk_bytes,
    modelled,
    plan_sequences,
    sequence_choice,
    simulate,
    simulation_estimate,
    simulation_from,
)
from simulator.config import SequenceConfig, load_scene, load_simulation, simulation_of
from simulator.knobs import MAX_TOLERANCE

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


@pytest.mark.parametrize(
    ("date_utc", "changes", "arcsec"),
    [("2030-01-01", {}, 10.35), (None, {"start_utc": "2030-01-01"}, 10.35), (None, {}, 10.12)],
)
def test_stars_of_a_table_stand_where_they_are_at_the_date(tmp_path, date_utc, changes, arcsec):
    """Alpha Centauri B, whose orbit (Akeson et al. 2021) takes it from 10.12 arcsec in 2028.0 to 10.35 in 2030.0."""
    found, _ = simulation_from(["snapshot"], settings={"band": "F662"}, changes=changes, date_utc=date_utc)
    scene = next(item.scene for item in found.sequences if item.scene.name == "alf Cen A")
    assert scene.stars[0].separation_arcsec == pytest.approx(arcsec, abs=0.01)


def test_a_date_needs_a_table():
    with pytest.raises(InputError, match="date_utc = 2031-01-01 UTC: not accepted; allowed: together with a table"):
        simulation_from(["paper_example"], settings={"band": "F662"}, date_utc="2031-01-01")


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


PLANET = {"radius": 1, "phase_angle": 90, "separation": 0.6, "position_angle": 315, "distance_au": 1.0, "name": "b"}


@pytest.fixture
def scene(star):
    return star | {"planets": [PLANET]}


def planned(scene, instrument, **settings):
    entry = {"scene": scene, "band": "F662", "frames": 4, "exposure_s": 30, "em_gain": 20} | settings
    tree = {"name": "x", "instrument": instrument, "sequences": [entry, {"kind": "BIAS"}]}
    return plan_sequences(load_simulation(tree))


@pytest.mark.parametrize(
    "settings",
    [
        {"tolerance": 0.05},
        {"tolerance": 0.2, "fidelity": "reference", "roll_deg": 20.0},
        {"tolerance": 0.1, "fidelity": "quick", "switches": {"cosmic_rays": False}},
        {"tolerance": 0.1, "star_offset_arcsec": [1.0, -1.0], "scene_model": "paper"},
        {"tolerance": 0.2, "band": "F940", "em_gain": 1, "start_utc": "2030-05-01T00:00:00"},
    ],
)
def test_the_plan_knows_what_the_frames_leave_out(scene, small, settings):
    item, bias = planned(scene, small, **settings)
    told, made = sequence_choice(item), item.build()
    assert told == made.choice
    assert made.ledger == told.rows
    record = modelled(item)
    assert [row.key for row in record.effects] == [row.key for row in told.rows]
    assert set(record.tolerance) == set(record.predicted_error)
    assert all(error <= settings["tolerance"] for error in record.predicted_error.values())
    assert modelled(bias) is None


def test_without_a_tolerance_nothing_is_left_out(scene, small):
    item, _ = planned(scene, small)
    assert modelled(item) is None
    assert item.build().choice is None


def test_a_tolerance_makes_it_cheaper_and_is_in_the_estimate(scene, small):
    def cost(tolerance):
        entry = {"scene": scene, "band": "F662", "frames": 50, "exposure_s": 1, "tolerance": tolerance}
        return simulation_estimate(load_simulation({"name": "x", "instrument": small, "sequences": entry}))

    full, less = cost(0.0), cost(0.5)
    assert less.wall_s < full.wall_s
    assert full.sequences[0].modelled is None
    assert less.sequences[0].modelled.tolerance["snr"] == 0.5


def test_yaml_defaults_and_changes(refused, scene, small):
    tree = {
        "name": "x",
        "instrument": small,
        "defaults": {"tolerance": 0.1},
        "sequences": [{"scene": scene}, {"scene": scene, "tolerance": 0.0}, {"kind": "DARK"}],
    }
    simulation = load_simulation(tree)
    assert [item.tolerance for item in simulation.sequences] == [0.1, 0.0, 0.0]
    changed = simulation_of("y", simulation.sequences, changes={"tolerance": 0.3})
    assert [item.tolerance for item in changed.sequences] == [0.3, 0.3, 0.0]
    refused("not for BIAS", load_simulation, {"name": "x", "sequences": [{"kind": "BIAS", "tolerance": 0.1}]})


def test_the_range_is_that_of_the_dial(scene, small):
    (field,) = (part for part in SequenceConfig.model_fields["tolerance"].metadata if hasattr(part, "le"))
    assert field.le == MAX_TOLERANCE


@pytest.mark.parametrize("truth", [True, False])
def test_disk_is_that_of_the_files_and_never_less(small, star, tmp_path, truth):
    tree = {
        "name": "x",
        "sequences": [
            {"kind": "BIAS", "frames": 30},
            {"scene": star, "band": "F520", "frames": 10, "fidelity": "quick"},
        ],
    }
    simulation = load_simulation(tree, instrument=small)
    estimates = [disk_bytes(item, truth=truth) for item in plan_sequences(simulation)]
    for bound, made in zip(estimates, simulate(simulation, tmp_path, truth=truth).result.sequences, strict=True):
        assert made.size_bytes <= bound <= 1.1 * made.size_bytes


def test_cost_grows_with_frames_and_shrinks_with_workers():
    def cost(frames, workers=1, sequences=1):
        tree = {"name": "x", "sequences": [{"kind": "BIAS", "frames": frames}] * sequences}
        return simulation_estimate(load_simulation(tree), workers=workers)

    more, most = cost(55).wall_s - cost(10).wall_s, cost(100).wall_s - cost(55).wall_s
    assert most == pytest.approx(more)
    assert more > 0
    assert cost(100).n_frames == 100
    assert cost(100, workers=2, sequences=2).wall_s < 0.7 * cost(100, sequences=2).wall_s
    # one sequence is one task
    assert cost(100, workers=8).wall_s == pytest.approx(cost(100).wall_s)
