import pytest

from cpic_planner.simulation.cost import disk_bytes, estimate
from cpic_planner.simulation.run import simulate
from cpic_planner.simulation.sequences import plan_sequences
from simulator.config.simulation_file import load_simulation


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
        return estimate(load_simulation(tree), workers=workers)

    more, most = cost(55).wall_s - cost(10).wall_s, cost(100).wall_s - cost(55).wall_s
    assert most == pytest.approx(more)
    assert more > 0
    assert cost(100).n_frames == 100
    assert cost(100, workers=2, sequences=2).wall_s < 0.7 * cost(100, sequences=2).wall_s
    # one sequence is one task
    assert cost(100, workers=8).wall_s == pytest.approx(cost(100).wall_s)
