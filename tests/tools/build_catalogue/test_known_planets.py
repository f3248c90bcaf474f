"""The builder of known planets: values, errors and orbits of made-up rows; stars only where names and places agree."""

from types import SimpleNamespace

import pytest

from catalogs.archives import answer_columns
from tools.build_catalogue.builders import known_planets as builder

COLUMNS = [column for column, row in answer_columns("ps").items() if row["quantity"]]


def row(**given):
    blank = {f"{column}{end}": "" for column in COLUMNS for end in ("", "err1", "err2", "lim")}
    words = {
        "pl_name": "x b",
        "pl_letter": "b",
        "pl_bmassprov": "Msini",
        "pl_controvflag": "0",
        "pl_discmethod": "Radial Velocity",
        "pl_def_reflink": "later",
        "pl_def_refname": "earlier",
        "pl_hostname": "x",
        "hd_name": "",
        "hip_name": "HIP 1",
        "ra": "10.0",
        "dec": "60.0",
        "st_dist": "10.0",
    }
    return blank | words | {"pl_bmassj": "1.0"} | given


def test_errors_are_half_the_interval_and_zero_is_none():
    made = builder._planet(
        "x",
        row(
            pl_orbper="100",
            pl_orbpererr1="3",
            pl_orbpererr2="-1",
            pl_orbeccen="0.1",
            pl_orbeccenerr1="0.0",
            pl_orbeccenerr2="0.0",
        ),
        None,
    )
    assert (made["period_days"], made["period_err_days"]) == ("100.0", "2.0")
    assert "eccentricity_err" not in made
    assert "eccentricity_err_unknown" in made["flags"].split(";")
    one_sided = builder._planet("x", row(pl_orbper="100", pl_orbpererr1="3"), None)
    assert one_sided["period_err_days"] == "3.0"


def test_the_earlier_orbit_is_taken_whole_and_only_for_its_time():
    later = row(pl_orbper="100", pl_orbeccen="0.1", pl_orblper="10")
    earlier = row(pl_orbper="101", pl_orbtper="2450000", pl_orbeccen="0.2", pl_bmassj="9")
    made = builder._planet("x", later, earlier)
    assert (made["period_days"], made["eccentricity"], made["reference"]) == ("101.0", "0.2", "earlier")
    assert "omega_star_deg" not in made
    assert made["msini_mjup"] == "1.0"
    assert "earlier_orbit" in made["flags"]
    for dated in ({"pl_orbtper": "2450001"}, {"pl_tranmid": "2450001"}):
        assert builder._planet("x", later | dated, earlier)["reference"] == "later"
    assert builder._planet("x", later, row())["reference"] == "later"


def test_limits_are_no_values():
    made = builder._planet(
        "x", row(pl_orbper="100", pl_orbincl="30", pl_orbincllim="-1", pl_orbeccen="0.2", pl_orbeccenlim="1"), None
    )
    assert "inclination_deg" not in made
    assert "eccentricity_upper_limit" in made["flags"]


def test_what_no_column_may_hold_is_refused(refused):
    refused(r"x b periastron_jd = 50000.0 d", builder._planet, "x", row(pl_orbper="100", pl_orbtper="50000"), None)
    refused("best_mass_kind", builder._planet, "x", row(pl_orbper="100", pl_bmassprov="Guess"), None)


@pytest.fixture
def stars():
    made = builder._Stars.__new__(builder._Stars)
    made.aliases = {"hip 1": ("x", 0), "x": ("x", 0), "y": ("y", 0), "both": ("x", 1)}
    place = SimpleNamespace(star=SimpleNamespace(ra_deg=10.0, dec_deg=60.0), parallax_mas=100.0)
    made.people = {"x": SimpleNamespace(row=place), "y": SimpleNamespace(row=place)}
    return made


def test_stars_by_names_and_places(refused, stars):
    assert stars.find(row()) == "x"
    assert stars.find(row(pl_hostname="both")) == "x"
    assert stars.find(row(pl_hostname="both", hip_name="")) is None  # the system alone names no component
    assert stars.find(row(pl_hostname="z", hip_name="HIP 2")) is None
    assert stars.find(row(ra="10.005")) == "x"  # 9 arcsec at declination 60
    for wrong in ({"pl_hostname": "y"}, {"ra": "10.006"}, {"dec": "60.003"}, {"st_dist": "13"}):
        refused("star of x b", stars.find, row(**wrong))
