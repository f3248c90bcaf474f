"""Refreshed tables on disk: written whole, read back equal, refused when damaged."""

import json
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from astropy.table import Table

from catalogs import (
    Cuts,
    TapService,
    data_dir,
    ecsv_text,
    file_name,
    load_stars,
    open_catalogue,
    parse_refreshed,
    queries,
    refresh_stars,
    snapshot_vintage,
    stars_at,
    stored_tables,
)
from catalogs.stars import COLUMNS


@pytest.fixture(scope="module")
def made(tap, sky):
    service = tap.TapService(sky.small_sky())
    yield refresh_stars(TapService(url=service.url, retries=0), Cuts())
    service.close()


@pytest.fixture(scope="module")
def text(made):
    return ecsv_text(made, {"cpic-planner": "0", "astroquery": "1"})


def test_reads_back_equal_to_the_digits_of_the_snapshot(made, text):
    table, _ = parse_refreshed(text, "x.ecsv")
    assert list(table.columns) == list(made.table.columns)
    assert dict(table.units) == dict(made.table.units)
    for column in COLUMNS:
        one, two = made.table.column(column.name), table.column(column.name)
        assert one.dtype.kind == two.dtype.kind, column.name
        if column.kind == "float":
            np.testing.assert_allclose(two, one, rtol=0, atol=0.5000001 * 10.0**-column.decimals, err_msg=column.name)
        else:
            np.testing.assert_array_equal(two, one, err_msg=column.name)


def test_digits_in_the_file_are_those_of_the_snapshot(text):
    table, _ = parse_refreshed(text, "x.ecsv")
    for column in COLUMNS:
        if column.kind == "float":
            values = table.column(column.name)
            np.testing.assert_array_equal(values, np.round(values, column.decimals), err_msg=column.name)


def test_a_name_that_could_be_a_formula_is_guarded_and_reads_back(made):
    """What a service calls a star is not ours: it may go into a spreadsheet."""
    names = made.table.column("name").tolist()
    wrong = [f"=cmd|'/C calc'!{row}" for row in range(len(names))]
    table = replace(made.table, columns=dict(made.table.columns) | {"name": np.array(wrong)})
    text = ecsv_text(replace(made, table=table), {})
    assert text.count("'=cmd|") == len(names)
    assert parse_refreshed(text, "x.ecsv")[0].column("name").tolist() == wrong


def test_is_an_ecsv_file_that_says_where_it_comes_from(made, text, tmp_path):
    (tmp_path / "t.ecsv").write_text(text)
    table = Table.read(tmp_path / "t.ecsv", format="ascii.ecsv")
    assert str(table["parallax_mas"].unit) == "mas"
    assert table["sp_type"].description == made.table.descriptions["sp_type"]
    assert "as listed" in table["sp_type"].description, "not as the extract of 2012 has it"
    meta = table.meta
    assert meta["queried_utc"] == made.queried_utc.isoformat()
    assert meta["queries"] == list(queries(Cuts()))
    assert meta["service"].startswith("http://127.0.0.1")
    assert meta["counts"]["stars"] == len(table) == 12
    assert meta["snapshot"] == snapshot_vintage()
    assert meta["software"]["astroquery"] == "1"
    assert "ODbL" in meta["licence"]
    assert "SIMBAD" in meta["credit"]
    assert meta["changes_to_snapshot"]["added"] == len(made.changes["added"])
    json.dumps(dict(meta))


def test_writing_again_gives_the_same_bytes(made, text):
    assert ecsv_text(made, {"cpic-planner": "0", "astroquery": "1"}) == text


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda text: text[: len(text) // 2], "mine"),
        (lambda text: text[: text.rindex("\n", 0, len(text) - 2) + 40], "mine"),
        (lambda text: text.replace("cpic_star_table: 1", "cpic_star_table: 7"), "cpic_star_table"),
        (lambda text: text.replace("v_mag", "vee_mag"), "v_mag"),
        (lambda text: "# %ECSV 1.0\n# ---\n# garbage", "mine"),
        (lambda text: text.replace(",5344.0,", ",,"), "teff_k"),
    ],
)
def test_damage_is_refused_with_the_remedy(refused, text, damage, words):
    message = refused(words, parse_refreshed, damage(text), "mine.ecsv")
    assert "mine.ecsv" in message
    assert "cpic catalog refresh" in message


def test_newest_in_the_data_folder_is_the_latest(data_folder, text):
    assert data_dir() == data_folder
    assert stored_tables() == []
    data_folder.mkdir()
    days = [datetime(2026, 3, day, 4, 5, 6, tzinfo=UTC) for day in (2, 30, 9)]
    for day in days:
        (data_folder / file_name(day)).write_text(text)
    for stray in ("notes.txt", "simbad_yesterday.ecsv", ".simbad_2027-01-01T000000Z.ecsv.part"):
        (data_folder / stray).write_text("x")
    assert [item.queried_utc for item in stored_tables()] == sorted(days, reverse=True)
    chosen = open_catalogue("latest")
    assert chosen.kind == "refreshed"
    assert "simbad_2026-03-30T040506Z.ecsv" in chosen.provenance
    assert str(data_folder) not in chosen.provenance


def test_latest_without_any_says_what_to_do(refused, data_folder):
    message = refused("cpic catalog refresh", open_catalogue, "latest")
    assert str(data_folder) in message


def test_default_folder_is_the_users_and_not_the_package(monkeypatch):
    import catalogs

    monkeypatch.delenv("CPIC_DATA_DIR")
    assert not data_dir().is_relative_to(catalogs.__path__[0])
    assert "cpic-planner" in data_dir().parts


def test_a_refreshed_file_elsewhere_is_known_for_what_it_is(tmp_path, text):
    (tmp_path / "renamed.ecsv").write_text(text)
    chosen = open_catalogue(tmp_path / "renamed.ecsv")
    assert chosen.kind == "refreshed"
    assert len(chosen.table) == 12
    assert chosen.ranked_v_mag == 7.0
    assert chosen.table.label == "renamed.ecsv"
    assert chosen.notes == ()
    assert len(load_stars()) == 1390


def test_companions_of_a_refreshed_table_follow_their_orbits(tmp_path, text):
    (tmp_path / "new.ecsv").write_text(text)
    opened = open_catalogue(tmp_path / "new.ecsv")
    assert opened.orbits
    table = stars_at(opened.table, 2028.5, orbits=opened.orbits)
    for name, pa in (("alf Cen A", 17.8), ("alf Cen B", 197.8)):
        row = table.row(table.column("name").tolist().index(name))
        assert row["companion_sep_arcsec"] == pytest.approx(10.25, abs=0.01)
        assert row["companion_pa_deg"] == pytest.approx(pa, abs=0.1)
        assert str(row["companion_src"]).startswith("derived:orbit of Akeson")


def test_a_shortened_file_is_read_and_said_to_be_one(tmp_path, text):
    (tmp_path / "part.ecsv").write_text("\n".join(text.splitlines()[:-2]) + "\n")
    chosen = open_catalogue(tmp_path / "part.ecsv")
    assert len(chosen.table) == 10
    assert chosen.notes == ("part.ecsv has 10 stars of the 12 that it was written with",)


@pytest.mark.parametrize(
    ("service", "asked"),
    [
        ("https://simbad.cds.unistra.fr/simbad/sim-tap", ""),
        ("http://localhost:8000/tap", " as localhost has it"),
        ("http://[", " as [ has it"),
        ("", " as an unknown service has it"),
    ],
)
def test_provenance_names_a_service_that_is_not_simbads_own(made, tmp_path, service, asked):
    (tmp_path / "mine.ecsv").write_text(ecsv_text(replace(made, url=service), {}))
    provenance = open_catalogue(tmp_path / "mine.ecsv").provenance
    assert provenance.startswith(f"SIMBAD of {made.queried_utc:%Y-%m-%d}{asked}, 12 stars (mine.ecsv ")
