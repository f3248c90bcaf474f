"""The archive's columns under their names of today: values, errors, solutions, hosts; differences are named.

Refreshed planets: what is new, gone and moved; written and read back; where the updates kept by hand are newer.
"""

import math
from datetime import UTC, datetime

import numpy as np
import pytest

from catalogs import (
    PLANETS_QUERY,
    RefreshError,
    TapService,
    archive_url,
    file_name,
    load_known_planets,
    load_stars,
    parse_planets,
    planets_ecsv,
    refresh_planets,
)
from catalogs.exoplanet_archive import difference, read_archive
from catalogs.known_planets import NUMBERS, TABLE_COLUMNS, newer_updates
from catalogs.table_files import RawTable, TableBytes, column_of


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
    made = refresh_planets(TapService())
    assert made.refusal == ""
    assert made.notes == ()
    assert any(row["planet"] == "eps Eri b" for row in made.rows)


def refreshed(service):
    return refresh_planets(TapService(url=service.url, retries=0))


def planet(service, name):
    return next(row for row in service.tables if row["pl_name"] == name)


def stored(made):
    return planets_ecsv(made, {"cpic-planner": "0"})


@pytest.fixture
def store(data_folder):
    """Put a table into the data folder, as asked on a day."""

    def putting(made, day=datetime(2026, 12, 1, tzinfo=UTC)):
        data_folder.mkdir(exist_ok=True)
        path = data_folder / file_name(day, "archive")
        path.write_text(stored(made))
        return path

    return putting


def test_an_archive_that_says_what_is_shipped_changes_nothing(archive):
    made = refreshed(archive)
    changes, shipped = made.changes, load_known_planets()
    same = int(shipped.counted.sum())
    assert changes == {"same": same, "added": [], "gone": {}, "orbit_moved": []}
    assert len(made.rows) == same
    assert made.refusal == ""
    assert archive.queries == [PLANETS_QUERY]
    assert made.url == archive.url


def test_new_gone_and_moved_planets_are_told_from_the_shipped_ones(archive, recorded):
    place = {"hd_name": "", "hip_name": "", "ra": 26.02, "dec": -15.94, "sy_dist": 3.65}
    archive.tables.append(recorded.row("tau Cet z", "tau Cet", **place))
    archive.tables.append(recorded.row("tau Cet e", "tau Cet", **place))
    archive.tables.remove(planet(archive, "HD 102365 b"))
    planet(archive, "47 UMa b")["soltype"] = "Published Candidate"
    planet(archive, "eps Eri b").update(pl_orbeccen=0.7, pl_orbeccenerr1=0.04, pl_orbeccenerr2=-0.04)
    changes = refreshed(archive).changes
    assert changes["added"] == ["tau Cet z"], "a refuted planet is no new one"
    assert changes["gone"]["HD 102365 b"] == "not in the answer"
    assert "soltype = Published Candidate" in changes["gone"]["47 UMa b"]
    (moved,) = changes["orbit_moved"]
    assert (moved["planet"], moved["element"]) == ("eps Eri b", "eccentricity")
    assert (moved["before"], moved["now"]) == (0.06, 0.7)
    assert moved["sigmas"] == pytest.approx(0.64 / np.hypot(0.05, 0.04))


@pytest.mark.parametrize(
    ("now", "errors", "moved"),
    [
        (2677.3 * 1.06, (30.0, -30.0), True),
        (2677.3 * 1.06, (80.0, -80.0), False),  # 1.9 combined errors
        (2677.3 * 1.04, (1.0, -1.0), False),  # 3.9 combined errors, but 4 %
        (2677.3 * 1.06, (None, None), True),
        (None, (None, None), False),
    ],
)
def test_an_element_has_moved_beyond_three_combined_errors_and_five_percent(archive, now, errors, moved):
    planet(archive, "eps Eri b").update(pl_orbper=now, pl_orbpererr1=errors[0], pl_orbpererr2=errors[1])
    assert bool(refreshed(archive).changes["orbit_moved"]) is moved


def test_without_any_error_the_difference_alone_decides():
    nan = float("nan")
    assert difference("period_days", 100.0, nan, 104.0, None) == {}
    said = {"before": 100.0, "before_err": None, "now": 106.0, "now_err": None, "sigmas": None}
    assert difference("period_days", 100.0, nan, 106.0, None) == said


def test_a_planet_with_several_published_orbits_moves_from_all_of_them_only(archive):
    shipped = load_known_planets()
    name = next(iter(shipped.solutions))
    periods = shipped.solutions[name].number("period_days").tolist()
    row = planet(archive, name)
    for period in periods:
        row.update(pl_orbper=period, pl_orbsmax=None, pl_orbeccen=None)
        assert refreshed(archive).changes["orbit_moved"] == []
    row.update(pl_orbper=1000.0 * max(periods), pl_orbpererr1=None, pl_orbpererr2=None)
    assert [item["planet"] for item in refreshed(archive).changes["orbit_moved"]] == [name]


def test_a_table_without_a_tenth_of_the_planets_is_refused(archive):
    whole = len(archive.tables)
    archive.tables = archive.tables[: -(whole // 10)]
    assert refreshed(archive).refusal == ""
    archive.tables = archive.tables[:-1]
    lost = whole // 10 + 1
    assert refreshed(archive).refusal.startswith(f"{lost} of {whole} counted planets of the shipped table are not in")


def test_reads_back_equal(archive):
    made = refreshed(archive)
    text = stored(made)
    rows, day = parse_planets(TableBytes("x.ecsv", text.encode(), ""))
    assert day == f"{made.queried_utc:%Y-%m-%d}"
    for one, two in zip(made.rows, rows, strict=True):
        assert {name: one.get(name) for name in NUMBERS} == {name: two.get(name) for name in NUMBERS}
        assert {name: one.get(name, "") for name in TABLE_COLUMNS if name not in NUMBERS} == {
            name: two.get(name, "") for name in TABLE_COLUMNS if name not in NUMBERS
        }
    assert stored(made) == text


def test_is_an_ecsv_file_that_says_where_it_comes_from(archive, tmp_path):
    from astropy.table import Table

    made = refreshed(archive)
    (tmp_path / "t.ecsv").write_text(stored(made))
    table = Table.read(tmp_path / "t.ecsv", format="ascii.ecsv")
    assert str(table["period_days"].unit) == "d"
    assert table.meta["queries"] == [PLANETS_QUERY]
    assert table.meta["service"] == archive.url
    assert table.meta["counts"]["planets"] == len(table)
    assert table.meta["changes_to_snapshot"]["same"] == len(table)
    assert "Akeson" in table.meta["credit"]


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda text: text[: len(text) // 2], "mine.ecsv"),
        (lambda text: text.replace("cpic_planet_table: 1", "cpic_planet_table: 9"), "cpic_planet_table = 9"),
        (lambda text: text.replace("cpic_planet_table", "cpic_star_table"), "cpic_planet_table = None"),
        (lambda text: "\n".join(text.splitlines()[:-2]) + "\n", "planets: not accepted"),
        (lambda text: text.replace("period_days", "perioddays_x"), "mine.ecsv"),
    ],
)
def test_damage_is_refused(refused, archive, damage, words):
    refused(words, parse_planets, TableBytes("mine.ecsv", damage(stored(refreshed(archive))).encode(), ""))


def test_latest_is_the_newest_stored_table_with_what_is_newer_of_the_updates(archive, store):
    planet(archive, "eps Eri b").update(pl_orbeccen=0.7, rowupdate="2025-01-01")
    planet(archive, "47 UMa b").update(pl_orbeccen=0.5, rowupdate="2030-01-01")
    path = store(refreshed(archive), datetime(2026, 12, 2, tzinfo=UTC))
    planet(archive, "47 UMa b").update(pl_orbeccen=0.4)
    store(refreshed(archive), datetime(2026, 12, 1, tzinfo=UTC))
    table = load_known_planets("latest")
    assert table.number("eccentricity")[table.row_of("eps Eri b")] == 0.06, "the row kept by hand is newer"
    assert table.number("eccentricity")[table.row_of("47 UMa b")] == 0.5, "the archive's is newer"
    assert table.text("status")[table.row_of("HD 102365 b")] == "controversial"
    assert path.name in table.provenance
    assert "known_planets_updates.csv" in table.provenance


def test_a_file_is_laid_over_the_latest_table(archive, store, tmp_path):
    store(refreshed(archive))
    (tmp_path / "mine.csv").write_text("star,planet,P,e,msini\ntau Cet,tau Cet z,500,0.1,1\n")
    table = load_known_planets(f"latest+{tmp_path / 'mine.csv'}")
    assert table.number("period_days")[table.row_of("tau Cet z")] == 500.0
    assert "archive_2026-12-01" in table.provenance
    assert "tau Cet z" not in load_known_planets("latest").text("planet")


def test_latest_without_any_says_what_to_do(refused, data_folder):
    message = refused("known_planets = latest.*cpic catalog refresh --planets", load_known_planets, "latest")
    assert str(data_folder) in message


ARCHIVE_ROW = {"star": "x", "planet": "x b", "period_days": 1.0, "updated": "2026-05-01"}


@pytest.mark.parametrize(
    ("update", "taken"),
    [
        ({"period_days": 2.0, "updated": "2026-05-02"}, "all"),
        ({"period_days": 2.0, "updated": "2026-05-01"}, "nothing"),
        ({"period_days": 2.0, "updated": "2026-05-01", "status": "confirmed"}, "nothing"),
        ({"period_days": 2.0, "updated": "2026-04-30", "status": "controversial"}, "status"),
        ({"updated": "2020-01-01", "status": "refuted"}, "status"),
        ({"updated": "2027-01-01", "status": "refuted"}, "status"),
    ],
)
def test_an_update_is_laid_over_an_older_orbit_and_its_doubts_over_any(update, taken):
    row = {"star": "x", "planet": "x b"} | update
    expected = {"all": [row], "nothing": [], "status": [{k: v for k, v in row.items() if k != "period_days"}]}
    assert newer_updates([ARCHIVE_ROW], [row]) == expected[taken]


def test_updates_of_planets_that_the_archive_lacks_need_an_orbit():
    known = {"star": "y", "planet": "y b", "semi_major_axis_au": 1.0, "updated": "2020-01-01"}
    gone = {"star": "y", "planet": "y c", "status": "refuted", "updated": "2027-01-01"}
    assert newer_updates([ARCHIVE_ROW], [known, gone]) == [known]


def test_every_shipped_planet_stands_where_the_adapter_looks_for_it(archive):
    stars = set(load_stars().column("name").tolist())
    assert {row["star"] for row in refreshed(archive).rows} <= stars
