"""Arrays in npz files: the same bytes for the same content, and a plain refusal of what is damaged."""

import numpy as np
import pytest

from cpic_core import read_npz, write_npz

ARRAYS = {"b": np.arange(6.0).reshape(2, 3), "a": np.array([1, 2], dtype=np.int16)}


def test_round_trip_and_same_bytes(tmp_path):
    write_npz(tmp_path / "one.npz", ARRAYS)
    write_npz(tmp_path / "two.npz", dict(reversed(ARRAYS.items())))
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    back = read_npz(tmp_path / "one.npz")
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(back[name], array)
        assert back[name].dtype == array.dtype


@pytest.mark.parametrize("damage", ["missing", "text", "cut", "flipped", "pickle"])
def test_damaged_files_are_refused_in_one_line(refused, tmp_path, damage):
    path = tmp_path / "file.npz"
    if damage == "text":
        path.write_text("not arrays")
    elif damage == "pickle":
        np.savez(path, a=np.array([{"key": 1}], dtype=object))
    elif damage != "missing":
        write_npz(path, ARRAYS | {"c": np.random.default_rng(1).normal(size=4000)})
        body = bytearray(path.read_bytes())
        if damage == "cut":
            body = body[: len(body) // 2]
        else:
            body[len(body) // 2] ^= 0xFF
        path.write_bytes(bytes(body))
    refused("npz file of plain arrays", read_npz, path)
