"""Bound systems and the parallax that they share, against a brute-force reading of the rule."""

import math

import pytest
from hypothesis import given, settings, strategies as st

from catalogs.simbad import Member, adopt_parallaxes, group_systems, is_blend_id

NAN = float("nan")


def member(ra=0.0, dec=0.0, hip=0, plx=50.0, err=0.1, pm=(100.0, 0.0)):
    return Member(ra, dec, hip, plx, err, *pm)


@pytest.mark.parametrize(
    ("other", "bound"),
    [
        (member(dec=20 / 3600), True),
        (member(dec=20 / 3600, pm=(-300.0, 50.0)), True),  # so close that motions do not matter
        (member(dec=100 / 3600), True),
        (member(dec=100 / 3600, pm=(-300.0, 50.0)), False),
        (member(dec=100 / 3600, pm=(NAN, NAN)), True),
        (member(dec=700 / 3600), False),
        (member(dec=20 / 3600, plx=40.0), False),
        (member(dec=20 / 3600, plx=40.0, err=4.0), True),
        (member(dec=20 / 3600, plx=40.0, err=NAN), False),
    ],
)
def test_pairs(other, bound):
    systems = group_systems([member(), other])
    assert (systems[0] == systems[1]) == bound


def test_one_hipparcos_number_is_one_system():
    assert group_systems([member(hip=5), member(dec=300 / 3600, hip=5, plx=20.0, pm=(-900.0, 0.0))]) == [0, 0]


def test_chains_join():
    chain = [member(dec=0.0), member(dec=1000 / 3600), member(dec=500 / 3600)]
    assert group_systems(chain) == [0, 0, 0]
    assert group_systems(chain[:2]) == [0, 1]


def test_the_best_parallax_over_error_is_shared():
    rows = [member(plx=50.0, err=1.0), member(dec=1 / 3600, plx=51.0, err=0.1), member(dec=2 / 3600, plx=52.0, err=NAN)]
    taken = adopt_parallaxes(rows, [0, 0, 0])
    assert [item.parallax_mas for item in taken] == [51.0] * 3
    assert [item.parallax_err_mas for item in taken] == [0.1] * 3
    assert [item.lender for item in taken] == [1, -1, 1]
    assert [item.shared for item in taken] == [True, False, True]
    assert taken[1].src == "measured"


def test_without_errors_the_mean_counts_with_half_the_difference():
    taken = adopt_parallaxes([member(plx=50.0, err=NAN), member(plx=52.0, err=NAN)], [0, 0])
    assert [item.parallax_mas for item in taken] == [51.0, 51.0]
    assert [item.parallax_err_mas for item in taken] == [1.0, 1.0]
    (alone,) = adopt_parallaxes([member(plx=50.0, err=NAN)], [0])
    assert alone.parallax_mas == 50.0
    assert math.isnan(alone.parallax_err_mas)
    assert not alone.shared


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 8), st.floats(40, 60), st.floats(0.05, 5)), min_size=1, max_size=8))
def test_systems_are_the_connected_parts_and_members_agree(stars):
    rows = [member(dec=step * 250 / 3600, plx=plx, err=err) for step, plx, err in stars]
    systems = group_systems(rows)
    joined = {i: {i} for i in range(len(rows))}
    for i in range(len(rows)):
        for j in range(i):
            if len(set(group_systems([rows[i], rows[j]]))) == 1:
                union = joined[i] | joined[j]
                for k in union:
                    joined[k] = union
    for i in range(len(rows)):
        assert {j for j in range(len(rows)) if systems[j] == systems[i]} == joined[i]
        assert systems[i] == min(joined[i])
    taken = adopt_parallaxes(rows, systems)
    for i, part in joined.items():
        assert len({taken[j].parallax_mas for j in part}) == 1
        best = max(part, key=lambda j: rows[j].parallax_mas / rows[j].parallax_err_mas)
        assert taken[i].parallax_mas == pytest.approx(rows[best].parallax_mas)


@pytest.mark.parametrize(
    ("name", "blend"),
    [
        ("CCDM J14396-6050AB", True),
        ("** STF 2382AB", True),
        ("WDS J00057+4549AB", True),
        ("HD 10700", False),
        ("GJ 559 B", False),
        ("* alf Cen", False),
    ],
)
def test_identifiers_of_blends(name, blend):
    assert is_blend_id(name) == blend
