"""Runs of equal frames against their frames one by one."""

from __future__ import annotations

import numpy as np
import pytest

from simulator.camera import earlier_frames
from simulator.detectors import PastExposure
from simulator.detectors.infrared import ExponentialPersistence

WELL = 1e5


@pytest.mark.parametrize("decay_s", [0.5, 30.0, 300.0, 1e7])
@pytest.mark.parametrize(("exposure_s", "readout_s"), [(10.0, 0.033), (0.0, 0.033), (1000.0, 5.0)])
def test_runs_act_as_their_frames(decay_s, exposure_s, readout_s) -> None:
    rng = np.random.default_rng(1)
    charges = rng.uniform(0.0, 1.5e5, (3, 4, 5))
    epoch_of = [0, 0, 0, 1, 1, 2, 2, 2]
    law = ExponentialPersistence(1e-2, decay_s)
    one_by_one = [
        PastExposure(np.minimum(charges[epoch], WELL), readout_s + (7 - frame) * (exposure_s + readout_s))
        for frame, epoch in enumerate(epoch_of)
    ]
    runs = earlier_frames(
        [(5, 8), (3, 5), (0, 3)],
        lambda frame: charges[epoch_of[frame]],
        before=8,
        full_well_e=WELL,
        exposure_s=exposure_s,
        readout_s=readout_s,
        memory_s=50.0 * decay_s,
    )
    expected = law(one_by_one, exposure_s)
    np.testing.assert_allclose(law(list(runs), exposure_s), expected, rtol=1e-12, atol=1e-20 * expected.max())


def test_a_million_frames_cost_no_more_than_one_and_old_light_is_forgotten() -> None:
    made = []

    def mean_e(frame):
        made.append(frame)
        return np.ones((2, 2))

    found = list(
        earlier_frames(
            [(500_000, 1_000_000), (0, 500_000)],
            mean_e,
            before=1_000_000,
            full_well_e=WELL,
            exposure_s=1.0,
            readout_s=0.1,
            memory_s=50.0 * 300.0,
        )
    )
    assert made == [500_000]
    assert found[0].age_s == pytest.approx(0.1)
    # the series to its end: 1 / (1 - exp(-1.1 / 300))
    assert found[0].weight(300.0) == pytest.approx(1.0 / (1.0 - np.exp(-1.1 / 300.0)), rel=1e-9)
