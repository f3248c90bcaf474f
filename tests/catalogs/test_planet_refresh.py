"""Refreshed planets: what is new, gone and moved; written and read back; where the updates kept by hand are newer."""

from datetime import UTC, datetime

import numpy as np
import pytest

from catalogs import (
    PLANETS_QUERY,
    TapService,
    file_name,
    load_known_planets,
    load_stars,
    parse_planets,
    planets_ecsv,
    refresh_planets,
)
from catalogs.exoplanet_archive import difference
from catalogs.known_planets import NUMBERS, TABLE_COLUMNS, newer_updates
from catalogs.table_files import TableBytes


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
