"""Orbits that a later publication contradicts: the definition, case by case."""

import pytest

from catalogs import load_known_planets
from cpic_planner.ranking import KnownChoice
from cpic_planner.ranking.known_answer import superseded_by
from simulator.config import albedo_spec

DISTANCE_PC = 3.216
BENEDICT = "2502,10,2454207.5,7,0.702,0.039,47,3,3.39,0.36,1.55,30.1,3.8"
HEADING = "star,planet,P,P_err,tp,tp_err,e,e_err,omega,omega_err,a,a_err,mass,i,i_err"


def choice(table):
    return KnownChoice(load_known_planets(table), "2028-01-01T00:00:00", 61771.0, albedo_spec("jupiter"), 500)


def told(table, planet="eps Eri b", distance_pc=DISTANCE_PC):
    made = choice(table)
    return superseded_by(made, made.table.row_of(planet), distance_pc)


@pytest.fixture
def written(tmp_path):
    def make(orbit, heading=HEADING, **more):
        path = tmp_path / "mine.csv"
        names = "".join(f",{name}" for name in more)
        path.write_text(f"{heading}{names}\neps Eri,eps Eri b,{orbit}{''.join(f',{cell}' for cell in more.values())}\n")
        return str(path)

    return make


def test_the_orbit_of_2006_is_contradicted_by_that_of_2025():
    said = told("archive_2019")
    assert said.startswith("Thompson et al. 2025 (2025AJ....170..301T)")
    assert "eccentricity" in said.rpartition(", in ")[2]


def test_no_shipped_orbit_is_contradicted_by_a_shipped_one():
    made = choice("snapshot")
    for row in range(len(made.table)):
        assert superseded_by(made, row, 10.0) == ""


def test_an_orbit_that_agrees_within_its_errors_is_not_contradicted():
    """47 UMa c: 2391 +- 94 d in 2010; 2287 and 2329 d later. Planets without a later orbit are not either."""
    assert told("archive_2019", "47 UMa c", 14.06) == ""
    assert told("archive_2019", "bet Gem b", 10.0) == ""


def test_217107_c_is_four_errors_away():
    """4270 +- 220 d in 2009, 5141 +- 13 d in 2021, where 871 d are 4.0 combined errors."""
    assert "period" in told("archive_2019", "HD 217107 c", 19.86)


@pytest.mark.parametrize(
    ("more", "contradicted"),
    [
        ({"reference": "Benedict et al. 2006 (2006AJ....132.2206B)"}, True),
        ({"reference": "mine"}, True),  # nothing tells when
        ({"reference": "mine", "updated": "2020-05-01"}, True),
        ({"reference": "mine", "updated": "2027-05-01"}, False),
        ({"reference": "mine of 2026"}, False),
        ({"reference": "arXiv:1906.03624 of 2025"}, False),  # as late as the other
    ],
)
def test_only_a_later_publication_contradicts(written, more, contradicted):
    assert bool(told(written(BENEDICT, **more))) == contradicted


def test_small_differences_without_errors_are_none(written):
    """Values without errors differ by any digit: below 5 % that says nothing."""
    near = "star,planet,a,e,mass,i,omega,star_mass,tc,tc_err,P,P_err"
    assert told(written("3.55,0.06,1,40,0,0.83,2457388,40,2680,27", near, reference="1999")) == ""
    assert "axis" in told(written("2.5,0.06,1,40,0,0.83,2457388,40,2680,27", near, reference="1999"))
