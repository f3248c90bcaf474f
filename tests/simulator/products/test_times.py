import socket
from datetime import datetime, timedelta

import numpy as np
import pytest

from simulator.products.times import elapsed_s, mjd_of, sequence_times, stamp


def test_frames_follow_each_other_with_their_dead_time():
    times = sequence_times("2028-03-04T05:06:07.25", 10.0, 1.1, 5)
    start = datetime(2028, 3, 4, 5, 6, 7, 250000)
    begins = [start + timedelta(seconds=index * 11.1) for index in range(5)]
    assert [datetime.fromisoformat(text) for text in times.begin_utc] == begins
    assert [datetime.fromisoformat(text) for text in times.end_utc] == [b + timedelta(seconds=10) for b in begins]
    mjd = [(begin - datetime(1858, 11, 17)) / timedelta(days=1) for begin in begins]
    assert np.abs(times.begin_mjd - mjd).max() * 86400 < 1e-5
    assert times.day == 61834
    # the readout behind the last frame is not part of the sequence
    assert times.stop_utc == "2028-03-04T05:07:01.650000"
    assert (stamp(times.start_utc), stamp(times.stop_utc)) == ("20280304050607", "20280304050701")


def test_a_leap_second_is_a_second():
    times = sequence_times("2016-12-31T23:59:58", 1.0, 0.0, 4)
    assert [stamp(text) for text in times.begin_utc] == [
        "20161231235958",
        "20161231235959",
        "20161231235960",
        "20170101000000",
    ]
    assert times.day == 57753
    assert elapsed_s(57753.0, 57754.0) == pytest.approx(86401.0, abs=1e-4)
    assert elapsed_s(57754.0, 57755.0) == pytest.approx(86400.0, abs=1e-4)


@pytest.mark.parametrize("year", [1973, 2029, 2060, 2100])
def test_any_year_goes_without_network_and_without_a_warning(year, monkeypatch):
    def refuse(*args, **kwargs):
        raise AssertionError("the network was asked")

    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    monkeypatch.setattr(socket.socket, "connect", refuse)
    times = sequence_times(f"{year}-07-01", 86400.0, 0.0, 2)
    assert times.begin_utc[1].startswith(f"{year}-07-02T00:00:00")
    assert mjd_of(times.begin_utc[1]) - times.day == pytest.approx(1.0, abs=1e-9)


def test_stamps_and_header_times_cut_the_same_digits():
    # 29.9999999 s rounds to 30 s at the microsecond: stamp and text must not disagree.
    times = sequence_times("2028-01-01T00:00:00", 29.9999999, 0.0, 1)
    assert times.stop_utc == "2028-01-01T00:00:30.000000"
    assert stamp(times.stop_utc) == "20280101000030"
