"""Values that people, programs and enemies give: as texts, and as objects of Python."""

import copy
import datetime
import decimal
import math
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

NUMBERS = (
    *("0", "-0.0", "-1", "1", "0.5", "2", "3", "5", "10", "1e-9", "1e5", "5e-324", "1e-308", "1e-30", "1e30", "1e308"),
    *("-1e308", "1e400", "-5e-324", "2147483648", "9223372036854775807", "9223372036854775808", "1" * 40, "9" * 5000),
    *(
        "inf",
        "-inf",
        "nan",
        "0x10",
        "1_000",
        "1e5 s",
        "١٢",
        "½",
        "+5",
        ".5",
        "5.",
        "1e",
        "--1",
        "1,5",
        "90",
        "180",
        "360",
    ),
)
"""Texts that are numbers, or look like some."""
WORDS = (
    *("", " ", "\t", "a\nb", "\r\n", "\x00", "a\x00b", "\x1b[31mred", "\u202eevil", "\ufeffF520", "\ud800", "é" * 50),
    *("A" * 300, "x" * 5000, "%s%n", "{0}", "{{7*7}}", "${HOME}", "~", "~nobody/x", "/", "/dev/null", "/dev/zero"),
    *(
        "/etc/passwd",
        "../..",
        ".",
        "-",
        "--",
        "-h",
        "none",
        "null",
        "true",
        "off",
        "all",
        "[1,2",
        "{a: 1}",
        "[1, 2]",
        "!!x",
    ),
    *("F520", "tau Cet", "snapshot", "x2", "x1e308", "x-1", "drift=x2", "throughput=x1e-308", "drift.visit_nm=1e308nm"),
    *(
        "a=b",
        "=",
        "throughput=",
        "bands.*.qe=0",
        "detector.columns=1",
        "drift=nan",
        "2030-02-30",
        "2030-01-01",
        "9999-12-31",
    ),
    *("0001-01-01", "2030-01-01T24:00:00", "2030-01-01T00:00:60", "1e9-01-01", "snapshot;rm -rf /", "none+none", "G2V"),
)
"""Texts that are no number, some of them good somewhere."""

STARS = "name,ra_deg,dec_deg,distance_pc,v_mag,sp_type\nA one,10,20,5,4,G2V\neps Eri,53.23,-9.458,3.22,3.73,K2V\n"
"""A table of stars of one's own, ``stars.csv``."""
texts = st.one_of(
    st.sampled_from(NUMBERS),
    st.sampled_from(WORDS),
    st.floats(allow_nan=True, allow_infinity=True).map(repr),
    st.integers(-(10**20), 10**20).map(str),
    st.text(max_size=20),
)
"""Any text, of the pools or of its own."""


class _Odd:
    """An object that nothing knows."""

    def __repr__(self) -> str:
        return "an odd\nobject"


OBJECTS = (
    *(
        None,
        True,
        False,
        0,
        -0.0,
        -1,
        1,
        42,
        0.5,
        5e-324,
        1e-308,
        1e308,
        math.inf,
        -math.inf,
        math.nan,
        10**400,
        -(10**30),
    ),
    *(
        1j,
        b"bytes",
        "",
        " ",
        "5",
        "nan",
        "tau Cet",
        "\x00",
        "a\nb",
        "x" * 5000,
        "\ud800",
        [],
        [[]],
        (),
        {},
        set(),
        {1: 2},
    ),
    *([1, "a"], [None], [math.nan], ["tau Cet", 5], [[1.0], [1.0, 2.0]], {"radius_rjup": "x"}, {"a": {"b": {}}}),
    *(datetime.datetime(2030, 1, 1), datetime.date(2030, 1, 1), datetime.timedelta(1), decimal.Decimal("1e400")),
    *(np.float64(5), np.float32("nan"), np.int64(3), np.array(5.0), np.array([]), np.array([1.0, 2.0]), np.bool_(True)),
    *(
        np.array([1, "a"], dtype=object),
        np.array([None]),
        np.array("text"),
        np.datetime64("2030-01-01"),
        np.ones((2, 2, 2)),
    ),
    *(np.ma.masked, np.array([1 + 2j]), Path(), Path("/dev/null"), Path("/nowhere/x"), object, len, _Odd(), Ellipsis),
    *(range(3), iter([1]), frozenset({1}), slice(1), NotImplemented, memoryview(b"x"), lambda: 1),
)
"""Objects of every kind."""


def fresh(thing: object) -> object:
    """A copy, where there can be one: cases must not share what one of them may change."""
    try:
        return copy.deepcopy(thing)
    except TypeError:
        return thing


objects = st.one_of(
    st.sampled_from(OBJECTS).map(fresh),
    st.floats(),
    st.integers(),
    st.text(max_size=20),
    st.lists(st.floats(), max_size=3),
)
