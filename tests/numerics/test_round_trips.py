"""exposure_time, signal_to_noise and contrast_limit undo each other from SNR 1e-6 to 1e6 and V -27 to 30."""

import pytest


@pytest.fixture(scope="module")
def etc(numerics):
    return numerics.round_trips.model()


def test_time_for_an_snr_and_back(numerics, etc):
    trips = numerics.round_trips.times(etc, (1e-6, 5.0, 1e6))
    assert trips.worst <= numerics.round_trips.ALLOWED, trips.where
    # Some of everything, and no other status.
    assert set(trips.answers) == {"ok", "saturated", "unreachable"}
    assert trips.answers["ok"] > 100


def test_contrast_in_a_time_and_back(numerics, etc):
    trips = numerics.round_trips.limits(etc)
    assert trips.worst <= numerics.round_trips.ALLOWED, trips.where
    assert trips.answers["ok"] > 20
