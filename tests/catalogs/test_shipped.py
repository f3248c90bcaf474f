"""Shipped tables: rows, objects by the types of their fields, and the digits by which results name them."""

import hashlib
import math
from dataclasses import dataclass
from pathlib import Path

import pytest

import catalogs
from catalogs.binaries import BinaryOrbit
from catalogs.shipped import shipped_digest, shipped_objects, shipped_rows

DATA = Path(catalogs.__file__).parent / "data"


def test_objects_have_the_cells_of_their_rows():
    rows, orbits = shipped_rows("binary_orbits.csv"), shipped_objects("binary_orbits.csv", BinaryOrbit)
    assert len(rows) == len(orbits) > 200
    for row, orbit in zip(rows, orbits, strict=True):
        assert (orbit.star, orbit.grade) == (row["star"], int(row["grade"]))
        assert orbit.period_yr == float(row["period_yr"])
        assert math.isnan(orbit.delta_v_mag) is (row["delta_v_mag"] == "")


def test_a_column_that_no_field_has_is_no_silent_loss():
    @dataclass
    class Other:
        star: str

    with pytest.raises(KeyError, match="companion"):
        shipped_objects("binary_orbits.csv", Other)


def test_digits_are_those_of_the_file():
    digest = hashlib.sha256((DATA / "velocity_limits.csv").read_bytes()).hexdigest()
    assert shipped_digest("velocity_limits.csv") == digest[:12]
