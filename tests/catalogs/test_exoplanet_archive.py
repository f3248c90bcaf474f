"""The archive's columns under their names of today: values, errors, solutions, hosts; differences are named."""

import math

import pytest

from catalogs import RefreshError, TapService, archive_url, load_stars
from catalogs.exoplanet_archive import read_archive
from catalogs.table_files import RawTable, column_of


@pytest.fixture
def read(recorded):
    """Read rows as the archive would send them; units and names by column may differ."""

    def reading(*rows, units=None, names=None, without=()):
        columns = [column_of("st_nphot", "", [1] * len(rows))]
        for name in dict.fromkeys(key for row in rows for key in row if key not in without):
            cells = [None if row.get(name) == "" else row.get(name) for row in rows]
            columns.append(column_of((names or {}).get(name, name), (units or {}).get(name, ""), cells))
        return read_archive(RawTable("the answer", columns), load_stars())

    return reading


def test_a_planet_of_a_catalogue_star_has_its_orbit_errors_and_reference(read, recorded):
    (planet,) = read(recorded.row()).rows
    assert (planet["star"], planet["planet"]) == ("eps Eri", "eps Eri b")
    assert (planet["period_days"], planet["period_err_days"]) == (2678.0, 28.0)
    assert (planet["eccentricity"], planet["eccentricity_err"]) == (0.06, 0.05)
    assert planet["msini_mjup"] == 0.98
    assert planet["reference"] == "Thompson et al. 2025 (2025AJ....170..301T)"
    assert planet["updated"] == "2025-12-11"
    assert planet["discovery_method"] == "Radial Velocity"
    assert {"minimum_mass", "phase_unknown", "omega_unknown"} <= set(planet["flags"].split(";"))


def test_a_host_is_known_by_any_of_its_names_and_others_are_not_kept(read, recorded):
    rows = [
        recorded.row("Ran b", "Ran", hd_name="", hip_name="HIP 16537"),
        recorded.row("HD 22049 c", "HD 22049", hd_name="", hip_name=""),
        recorded.row("Kepler-1 b", "Kepler-1", hd_name="", hip_name=""),
    ]
    made = read(*rows)
    assert [row["planet"] for row in made.rows] == ["eps Eri b", "eps Eri c"]
    assert made.counts == {"solutions": 3, "planets of the answer": 3, "planets": 2}
    assert made.left_out == {}


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"hip_name": "HIP 8102"}, "star of eps Eri b = eps Eri, tau Cet"),
        ({"ra": 53.3}, "arcsec from eps Eri"),
        ({"sy_dist": 30.0}, "at 9.32 of its distance"),
        ({"soltype": "Published Candidate"}, "soltype = Published Candidate"),
        ({"pl_orbper": None, "pl_orbsmax": None}, "period_days or semi_major_axis_au"),
        ({"pl_bmassj": None}, "mass_mjup or msini_mjup or radius_rjup"),
        ({"pl_bmassprov": "Guess"}, "best_mass_kind = Guess"),
    ],
)
def test_a_planet_that_cannot_be_used_is_left_out_with_the_reason(read, recorded, given, words):
    place = {"hd_name": "", "hip_name": "", "ra": 26.02, "dec": -15.94, "sy_dist": 3.65}
    made = read(recorded.row(**given), recorded.row("tau Cet x", "tau Cet", **place))
    assert [row["planet"] for row in made.rows] == ["tau Cet x"]
    assert words in made.left_out["eps Eri b"]


def test_the_default_solution_counts_and_a_whole_dated_orbit_of_its_period_stands_in_for_the_phase(read, recorded):
    default = recorded.row(pl_bmassj=1.0)
    dated = {"pl_orbtper": (2454207.0, 7.0, -7.0), "pl_orbeccen": (0.7, 0.04, -0.04)}
    dated |= {"default_flag": 0, "pl_bmassj": 2.0}
    old = recorded.row(**dated, pl_orbper=(2502.0, 10.0, -10.0), pl_pubdate="2006-11", pl_refname="old")
    new = recorded.row(**dated, pl_orbper=(2671.0, 17.0, -23.0), pl_pubdate="2021-07", pl_refname="new")
    other = recorded.row(**dated, pl_orbper=(500.0, 1.0, -1.0), pl_pubdate="2024-01", pl_refname="alias of the period")
    doubted = recorded.row(**dated, soltype="Published Candidate", pl_pubdate="2026-01", pl_refname="doubted")
    (planet,) = read(old, other, doubted, default, new).rows
    assert planet["reference"] == "new"
    assert (planet["period_days"], planet["eccentricity"], planet["periastron_jd"]) == (2671.0, 0.7, 2454207.0)
    assert (planet["semi_major_axis_au"], planet["msini_mjup"]) == (3.53, 1.0)
    assert "earlier_orbit" in planet["flags"].split(";")
    (planet,) = read(old, recorded.row(pl_tranmid=(2457388.0, 45.0, -36.0)), new).rows
    assert planet["reference"].startswith("Thompson")
    assert "earlier_orbit" not in planet["flags"]
    assert planet["conjunction_err_days"] == 40.5


def test_without_a_default_the_newest_publication_counts(read, recorded):
    old, new = (recorded.row(default_flag=0, pl_pubdate=date, pl_refname=date) for date in ("2006-11", "2021-07"))
    assert read(new, old).rows[0]["reference"] == "2021-07"


def test_limits_assumed_inclinations_and_doubts_are_read(read, recorded):
    limited = recorded.row(pl_orbeccen=0.2, pl_orbeccenlim=1, pl_orbper=2678.0, pl_orbperlim=1, pl_controv_flag=1)
    (planet,) = read(limited | {"pl_orbincl": 90.0, "pl_bmassprov": "Mass"}).rows
    assert "period_days" not in planet
    assert {"controversial", "eccentricity_upper_limit", "edge_on_assumed"} <= set(planet["flags"].split(";"))
    assert "inclination_deg" not in planet
    assert planet["msini_mjup"] == 0.98


def test_a_value_that_cannot_be_meant_is_left_out_and_said(read, recorded):
    made = read(recorded.row(pl_orbtper=(51220.0, 5.0, -5.0)))
    assert "periastron_jd" not in made.rows[0]
    assert len(made.notes) == 1
    assert "left out: eps Eri b periastron_jd = 51220.0 d" in made.notes[0]


UNITS = {"pl_orbper": "days", "pl_orbsmax": "au", "pl_bmassj": "Jupiter mass", "pl_orblper": "degrees"}


def test_units_as_the_archive_writes_them_are_ours_and_others_are_converted_and_said(read, recorded):
    usual = read(recorded.row(), units=UNITS | {"pl_radj": "Jupiter Radius"})
    assert usual.notes == ()
    hours = dict.fromkeys(("pl_orbper", "pl_orbpererr1", "pl_orbpererr2"), "hours")
    made = read(recorded.row(pl_orbper=(64272.0, 672.0, -672.0)), units=hours)
    assert made.rows[0]["period_days"] == pytest.approx(2678.0)
    assert made.rows[0]["period_err_days"] == pytest.approx(28.0)
    assert made.notes[0] == "pl_orbper is in hours, not in d: converted"
    with pytest.raises(RefreshError, match=r"column pl_orbper = unit parsec.*a unit like d"):
        read(recorded.row(), units={"pl_orbper": "parsec"})


def test_names_of_before_are_understood_and_named(read, recorded):
    made = read(recorded.row(), names={"hostname": "pl_hostname", "sy_dist": "st_dist", "pl_orbper": "PL_ORBPER"})
    assert made.notes == ("hostname is called pl_hostname", "sy_dist is called st_dist")
    assert made.rows == read(recorded.row()).rows


def test_what_is_missing_is_named_in_one_line(read, recorded):
    with pytest.raises(RefreshError, match="no column pl_orbper, pl_orbeccen;") as failure:
        read(recorded.row(), names={"pl_orbper": "pl_period"}, without=("pl_orbeccen",))
    assert "\n" not in str(failure.value)
    assert "archive may have changed" in str(failure.value)
    made = read(recorded.row(), without=("soltype", "pl_letter", "pl_orbperlim"))
    assert made.notes == ("columns that the archive no longer has: soltype, pl_letter, pl_orbperlim",)
    assert made.rows == read(recorded.row()).rows


@pytest.mark.parametrize("cell", ["fast", "1_000", math.inf])
def test_what_is_no_number_is_refused(read, recorded, cell):
    with pytest.raises(RefreshError, match=r"row 1 \(eps Eri b\) column pl_orbper"):
        read(recorded.row(pl_orbper=cell))


def test_planets_of_other_stars_alone_are_a_failure(read, recorded):
    with pytest.raises(RefreshError, match="no planet of the answer"):
        read(recorded.row("Kepler-1 b", "Kepler-1", hd_name="", hip_name=""))


def test_a_planet_that_is_there_under_two_names_counts_once(read, recorded):
    made = read(recorded.row(), recorded.row("HD 22049 b", "HD 22049"))
    assert len(made.rows) == 1
    assert made.left_out == {"HD 22049 b": "another planet of the archive is eps Eri b too"}


def test_names_without_a_blank_are_no_trouble(read, recorded):
    odd = recorded.row("b", "eps Eri", pl_bmassj=None)
    assert list(read(recorded.row(), odd).left_out) == ["b"]
    assert read(recorded.row("x", "eps Eri", pl_letter="")).rows[0]["planet"] == "eps Eri x"


def test_default_service_is_the_archives_own(refused, monkeypatch):
    monkeypatch.delenv("CPIC_ARCHIVE_URL", raising=False)
    assert archive_url(TapService()) == "https://exoplanetarchive.ipac.caltech.edu/TAP"
    monkeypatch.setenv("CPIC_ARCHIVE_URL", "https://mirror.example/TAP/sync")
    assert archive_url(TapService()) == "https://mirror.example/TAP"
    assert archive_url(TapService(url="http://localhost:8000/TAP")) == "http://localhost:8000/TAP"
    monkeypatch.setenv("CPIC_ARCHIVE_URL", "http://mirror.example/TAP")
    refused("CPIC_ARCHIVE_URL.*https://", archive_url, TapService())


@pytest.mark.network
def test_the_real_archive_answers():
    from catalogs import refresh_planets

    made = refresh_planets(TapService())
    assert made.refusal == ""
    assert made.notes == ()
    assert any(row["planet"] == "eps Eri b" for row in made.rows)
