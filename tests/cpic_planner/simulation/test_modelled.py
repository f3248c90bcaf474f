"""What sequences leave out is known before their frames are made, and is what the frames leave out."""

import pytest

from cpic_planner.simulation.cost import estimate
from cpic_planner.simulation.modelled import modelled, sequence_choice
from cpic_planner.simulation.sequences import plan_sequences
from simulator.config.simulation import SequenceConfig
from simulator.config.simulation_file import load_simulation, simulation_of
from simulator.knobs import MAX_TOLERANCE

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
        return estimate(load_simulation({"name": "x", "instrument": small, "sequences": entry}))

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
