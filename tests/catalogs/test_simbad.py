"""Asking SIMBAD: the queries mean what they say, and an answer counts only when it is whole.

SIMBAD's answers: old and new names, units and texts; what cannot be right is refused.

From the answers to a table: names, blends, shared parallaxes, filled values and their labels.

Refreshed tables on disk: written whole, read back equal, refused when damaged.

Bound systems and the parallax that they share, against a brute-force reading of the rule.
"""

import json
import math
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from astropy import units as u
from astropy.table import Table
from hypothesis import given, settings, strategies as st

from catalogs import (
    ADDED_FLAGS,
    Cuts,
    RefreshError,
    TapService,
    data_dir,
    ecsv_text,
    file_name,
    load_stars,
    open_catalogue,
    parse_refreshed,
    queries,
    refresh_stars,
    resolve_star,
    service_url,
    snapshot_vintage,
    stars_at,
    stored_tables,
)
from catalogs.archives import answer_columns, ask
from catalogs.simbad import (
    Member,
    adopt_parallaxes,
    blends,
    group_systems,
    is_blend_id,
    match_snapshot,
    own_names,
    read_measurements,
    read_stars,
    row_name,
)
from catalogs.stars import COLUMNS, SHIPPED_FLAGS
from catalogs.stellar_physics import bolometric_correction, colour_temperature
from catalogs.table_files import RawTable, column_of

STARS, MEASUREMENTS = queries(Cuts())


def answered(service, query, **changes):
    """Cells of the columns of an answer."""
    asked = TapService(**({"url": service.url, "retries": 0} | changes))
    return {column.heading: column.cells.tolist() for column in ask(asked, service_url(asked), query).columns}


def test_first_query_gives_every_object_within_the_cuts_once(simbad, sky):
    table = answered(simbad, STARS)
    wanted = [star[1] for star in sky.STARS if star[12] is not None and star[12] <= 7.5 and star[4] >= 25.0]
    assert sorted(table["main_id"]) == sorted(wanted)
    assert "HD 999005" in wanted, "the edge itself belongs to the cut"
    assert table["V"][table["main_id"].index("* tau Cet")] == 3.5, "as the service wrote it, though of single precision"
    assert not table["ids"][table["main_id"].index("HD 999011")], "an object without identifiers stays"


def test_second_query_gives_all_measurements_of_the_same_objects(simbad, sky):
    table = answered(simbad, MEASUREMENTS)
    outside = {14}
    assert sorted(table["oidref"]) == sorted(row[0] for row in sky.MEASUREMENTS if row[0] not in outside)


@pytest.mark.parametrize(("v_mag_max", "parallax_min_mas"), [(6.0, 25.0), (7.5, 100.0), (4, 30.5)])
def test_cuts_are_in_the_queries(simbad, sky, v_mag_max, parallax_min_mas):
    cuts = Cuts(v_mag_max=v_mag_max, parallax_min_mas=parallax_min_mas)
    inside = {s[0]: s[1] for s in sky.STARS if s[12] is not None and s[12] <= v_mag_max and s[4] >= parallax_min_mas}
    first, second = (answered(simbad, query) for query in queries(cuts))
    assert set(first["main_id"]) == set(inside.values())
    assert set(second["oidref"]) == {row[0] for row in sky.MEASUREMENTS if row[0] in inside}


def test_request_is_a_tap_request_with_a_limit_and_nothing_else_is_asked(simbad):
    answered(simbad, STARS, maxrec=77)
    assert simbad.paths == ["/simbad/sim-tap/sync"]
    assert simbad.maxrec == [77]
    assert simbad.queries == [STARS]


def test_same_question_is_asked_anew_each_time(simbad):
    first = answered(simbad, STARS)
    simbad.tables["basic"] = simbad.tables["basic"][:3]
    assert len(answered(simbad, STARS)["oid"]) == 3 < len(first["oid"])


def test_default_service_is_that_of_astroquery(monkeypatch):
    monkeypatch.delenv("CPIC_SIMBAD_URL", raising=False)
    from astroquery.simbad import conf

    assert service_url(TapService()) == f"https://{conf.server}/simbad/sim-tap"
    with conf.set_temp("server", "simbad.harvard.edu"):
        assert service_url(TapService()) == "https://simbad.harvard.edu/simbad/sim-tap"
    for address in ("http://localhost:8000/tap", "http://localhost:8000/tap/", "http://localhost:8000/tap/sync"):
        assert service_url(TapService(url=address)) == "http://localhost:8000/tap"


def test_environment_may_name_the_service(refused, simbad, monkeypatch):
    monkeypatch.setenv("CPIC_SIMBAD_URL", simbad.url)
    assert service_url(TapService()) == simbad.url
    assert service_url(TapService(url="http://localhost:8000/tap")) == "http://localhost:8000/tap"
    monkeypatch.setenv("CPIC_SIMBAD_URL", "simbad.example.org")
    refused("CPIC_SIMBAD_URL.*https://", service_url, TapService())


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Cuts(v_mag_max=float("nan")), "v_mag_max"),
        (lambda: Cuts(v_mag_max=99.0), "v_mag_max"),
        (lambda: Cuts(parallax_min_mas=0.0), "parallax_min_mas"),
    ],
)
def test_settings_are_checked(refused, make, words):
    refused(words, make)


@pytest.mark.network
def test_the_real_service_answers_both_questions():
    cuts = Cuts(v_mag_max=4.0, parallax_min_mas=250.0)

    stars, measurements = (ask(TapService(), service_url(TapService()), query) for query in queries(cuts))
    answer = read_stars(stars)
    found = {star["main_id"]: star["v_mag"] for star in answer}
    assert found["* tau Cet"] == pytest.approx(3.5, abs=0.05)
    assert found["* eps Eri"] == pytest.approx(3.73, abs=0.05)
    assert len(read_measurements(measurements)) > 100


def with_cells(given, cells):
    """The column with other cells, None where missing."""
    return column_of(given.heading, given.unit, cells)


def answered_of_simbad_answer(simbad, query=STARS):
    """Columns of an answer by their headings, to be altered."""
    return {column.heading: column for column in ask(TapService(retries=0), simbad.url, query).columns}


def table(columns):
    return RawTable("the answer", list(columns.values()))


def both(simbad):
    return read_stars(table(answered_of_simbad_answer(simbad))), read_measurements(
        table(answered_of_simbad_answer(simbad, MEASUREMENTS))
    )


def column(rows, name):
    return np.array([row.get(name, np.nan) for row in rows])


def same(one, two):
    assert [row.keys() for row in one] == [row.keys() for row in two]
    for name in one[0]:
        values, others = ([row.get(name) for row in rows] for rows in (one, two))
        if name in ("main_id", "sp_type", "object_type", "ids", "bibcode"):
            assert values == others
        else:
            np.testing.assert_array_equal(np.array(values, float), np.array(others, float), err_msg=name)


def test_values_are_those_of_the_tables(simbad, sky):
    answer, measurements = both(simbad)
    by_name = {" ".join(star[1].split()): star for star in sky.STARS}
    names = "ra_deg dec_deg parallax_mas parallax_err_mas pm_ra_mas_yr pm_dec_mas_yr rv_km_s b_mag v_mag".split()
    for star in answer:
        _, _, ra, dec, plx, err, pmra, pmdec, rv, sp_type, otype, b, v, ids = by_name[star["main_id"]]
        expected = [ra, dec, plx, err, pmra, pmdec, rv, b, v]
        found = [star[name] for name in names]
        np.testing.assert_allclose(found, [np.nan if x is None else x for x in expected], rtol=1e-6)
        assert star["sp_type"] == (sp_type or "")
        assert star["object_type"] == otype
        assert star["ids"] == tuple(" ".join(name.split()) for name in (ids or "").split("|") if name)
    assert len(measurements) == sum(row[0] != 14 for row in sky.MEASUREMENTS)


def test_white_space_of_identifiers_is_normalised(simbad):
    answer, _ = both(simbad)
    ids = {star["main_id"]: star["ids"] for star in answer}
    assert "* alf Cen A" in ids["* alf Cen A"]
    assert "GJ 559 B" in ids["* alf Cen B"]


def test_misprints_of_the_literature_count_as_missing(simbad):
    _, measurements = both(simbad)
    odd = next(row for row in measurements if row["bibcode"] == "1901ApJ.....1....1X")
    assert not odd.keys() & {"teff_k", "metallicity"}


@pytest.mark.parametrize("names", ["OLD_NAMES", "PARENTHESES"])
def test_old_names_of_the_columns_are_understood(simbad, tap, names):
    new = both(simbad)
    simbad.rename = getattr(tap, names)
    for one, two in zip(new, both(simbad), strict=True):
        same(one, two)


def test_every_column_that_is_asked_for_is_known(tap):
    for query, table in ((STARS, "simbad_stars"), (MEASUREMENTS, "simbad_measurements")):
        asked = {column for _, column, _ in tap.parse(query)[1]["select"]} - {"mespos"}  # of the order of the list
        listed = answer_columns(table)
        forms = {form: name for name, row in listed.items() for form in (name, *row["headings"].split())}
        assert {forms[column.replace("_", "") if column not in forms else column] for column in asked} == set(listed)


def test_positions_in_hours_and_units_of_another_kind_are_converted(simbad):
    answer, _ = both(simbad)
    columns = answered_of_simbad_answer(simbad)
    from astropy.coordinates import SkyCoord

    sky = SkyCoord(column(answer, "ra_deg") * u.deg, column(answer, "dec_deg") * u.deg)
    ra = sky.ra.to_string(unit="hourangle", sep=" ", precision=6).tolist()
    dec = sky.dec.to_string(unit="deg", sep=" ", precision=6, alwayssign=True).tolist()
    rv_m_s = [None if np.isnan(value) else 1000.0 * value for value in column(answer, "rv_km_s")]
    columns["ra"], columns["dec"] = column_of("ra", "", ra), column_of("dec", "", dec)
    columns["plx_value"] = column_of("plx_value", "arcsec", (column(answer, "parallax_mas") / 1000.0).tolist())
    columns["rvz_radvel"] = column_of("rvz_radvel", "m/s", rv_m_s)
    other = read_stars(table(columns))
    for name in ("ra_deg", "dec_deg", "parallax_mas", "rv_km_s"):
        np.testing.assert_allclose(column(other, name), column(answer, name), atol=1e-8)


def change(name, value):
    """Change the first cell of a column."""

    def alter(columns):
        columns[name] = with_cells(columns[name], [value, *columns[name].cells.tolist()[1:]])

    return alter


def fill(name, value):
    """Change all cells of a column."""

    def alter(columns):
        columns[name] = with_cells(columns[name], [value] * len(columns[name].cells))

    return alter


def rows(choose):
    """Choose other rows."""

    def alter(columns):
        for name, column in columns.items():
            columns[name] = with_cells(column, choose(column.cells.tolist()))

    return alter


@pytest.mark.parametrize(
    ("alter", "words"),
    [
        (rows(lambda cells: []), "no star"),
        (lambda columns: columns.pop("plx_value"), "no column parallax_mas"),
        (lambda columns: columns.update(V=replace(columns["V"], heading="Vega")), "no column v_mag"),
        (rows(lambda cells: [cells[0], *cells]), "2 rows are of one name; same oid"),
        (change("plx_value", None), "column plx_value = missing"),
        (change("plx_value", -3.0), r"column plx_value = -3.0 mas"),
        (change("V", None), "column V = missing"),
        (change("V", 99.9), r"column V = 99.9.*-30 to 30"),
        (change("ra", 361.0), "column ra = 361.0 deg"),
        (change("dec", None), "column dec = missing"),
        (change("oid", None), "column oid = missing"),
        (change("main_id", None), "row 1 column main_id = missing"),
        (fill("pmra", "fast"), "column pmra = fast"),
        (fill("ra", "12 xx 4"), "column ra = 12 xx 4"),
        (
            lambda columns: columns.update(plx_value=replace(columns["plx_value"], unit="kg")),
            "column plx_value = unit kg.*like mas",
        ),
    ],
)
def test_what_cannot_be_right_is_refused_in_one_line(simbad, alter, words):
    columns = answered_of_simbad_answer(simbad)
    alter(columns)
    with pytest.raises(RefreshError, match=words) as failure:
        read_stars(table(columns))
    assert "\n" not in str(failure.value)


def test_no_measurements_at_all_are_fine_but_a_lost_column_is_not(simbad):
    columns = answered_of_simbad_answer(simbad, MEASUREMENTS)
    assert len(read_measurements(table({name: with_cells(column, []) for name, column in columns.items()}))) == 0
    del columns["fe_h"]
    with pytest.raises(RefreshError, match="no column metallicity"):
        read_measurements(table(columns))


def test_numbers_in_texts_are_read(simbad):
    columns = answered_of_simbad_answer(simbad)
    expected = read_stars(table(columns))
    columns["pmra"] = with_cells(
        columns["pmra"], [str(cell) if cell else cell for cell in columns["pmra"].cells.tolist()]
    )
    same(expected, read_stars(table(columns)))


@pytest.fixture(scope="module")
def made(tap, sky):
    service = tap.TapService(sky.small_sky())
    yield refresh_stars(TapService(url=service.url, retries=0), Cuts())
    service.close()


@pytest.fixture(scope="module")
def same_sky(tap, sky):
    """The refreshed table when SIMBAD says just what the snapshot says."""
    service = tap.TapService(sky.snapshot_sky(load_stars()))
    yield refresh_stars(TapService(url=service.url, retries=0), Cuts())
    service.close()


def star(made, name):
    table = made.table
    return table.row(table.column("name").tolist().index(name))


def flags(made, name):
    return set(star(made, name)["quality_flags"].split(";")) - {""}


def test_rows_are_the_f_g_and_k_stars_whatever_marks_their_types_have(made):
    assert set(made.table.column("simbad_id").tolist()) == {
        "* alf Cen A",
        "* alf Cen B",
        "* alf Aur",
        "* tau Cet",
        "* eps Eri",
        "HD 999001",
        "HD 999002",
        "HD 999005",
        "HD 999010A",
        "HD 999010B",
        "HD 999011",
        "HD 999012",
    }
    assert (
        dict(zip(made.table.column("simbad_id").tolist(), made.table.column("spectral_class").tolist(), strict=True))[
            "HD 999011"
        ]
        == "F"
    ), "a metallic-line star counts by its hydrogen lines"
    assert np.all(np.diff(made.table.column("v_mag")) >= 0.0)


def test_what_is_left_out_is_counted_and_named(made):
    counts = made.counts
    assert counts["objects"] == 19
    assert counts["stars"] == len(made.table) == 12
    left = {key: count for key, count in counts.items() if key.startswith("left out")}
    assert sum(left.values()) == counts["objects"] - counts["stars"]
    assert left["left out: not of class F, G or K"] == 3
    assert left["left out: blend of components that are listed"] == 2
    assert left["left out: spectral type missing or unreadable"] == 2
    assert made.left_out["* alf Cen"] == "blend of * alf Cen A, * alf Cen B"
    assert made.left_out["HD 999004"].startswith("no type")
    assert "???" in made.left_out["HD 999006"]


def test_stars_that_the_snapshot_has_keep_its_names(made):
    for name, hip, common in (
        ("alf Cen A", 71683, "Rigil Kentaurus"),
        ("alf Cen B", 71681, "Toliman"),
        ("tau Cet", 8102, "Durre Menthor"),
    ):
        row = star(made, name)
        assert row["hip"] == hip
        assert row["common_name"] == common
    for name in ("HIP 8102", "52 Cet", "GJ 71", "Capella", "alf Aur", "HD 128621", "α Cen B", "HR 509"):
        assert resolve_star(name, made.table).name in {"tau Cet", "alf Aur", "alf Cen B"}


def test_new_stars_are_named_by_the_usual_rule(made):
    for name in ("HD 999001", "HD 999010 A", "HD 999010 B"):
        assert resolve_star(name, made.table).name == name
    assert resolve_star("HIP 119901", made.table).name == "HD 999002"
    assert resolve_star("HD 999010", made.table).note
    assert star(made, "HD 999010 B")["component"] == "B"


@pytest.mark.parametrize(
    ("main_id", "ids", "shown"),
    [
        ("* alf Cen B", ("* alf Cen B", "HD 128621"), "alf Cen B"),
        ("* 61 Cyg A", ("* 61 Cyg A", "HD 201091"), "61 Cyg A"),
        ("V* V538 Aur", ("HD 37394", "HIP 26779"), "HD 37394"),
        ("HIP 5", ("HIP 5",), "HIP 5"),
        ("BD+01 1", ("BD+01 1", "Gaia DR3 1"), "BD+01 1"),
        ("* h Dra", ("* h Dra", "HD 1"), "h Dra"),
        ("* h Dra", ("* 19 Dra", "* h Dra", "HD 1"), "19 Dra"),
        ("NAME Ran", ("NAME Ran",), "Ran"),
    ],
)
def test_order_of_names(main_id, ids, shown):
    assert row_name(own_names(main_id, ids), set()) == shown


def test_names_stay_unique():
    taken = set()
    names = [row_name(own_names("* alf Xxx", ("* alf Xxx", f"HD {n}")), taken) for n in (1, 2)]
    assert names == ["alf Xxx", "HD 2"]


def test_blends_are_found_by_identifier_name_or_double_star_letters(simbad):
    answer = read_stars(ask(TapService(), simbad.url, queries(Cuts())[0]))
    listed, alone = blends(answer)
    assert {answer[i]["main_id"] for i in listed} == {"* alf Cen", "HD 999010"}
    assert {answer[i]["main_id"] for i in alone} == {"* alf Aur"}


def test_no_two_objects_are_one_star_of_the_snapshot(simbad):
    next(row for row in simbad.tables["ids"] if row["oidref"] == 11)["ids"] += "|HIP 8102"  # a stray identifier

    answer = read_stars(ask(TapService(), simbad.url, queries(Cuts())[0]))
    rows = [row for row in match_snapshot(answer, load_stars()) if row >= 0]
    assert len(set(rows)) == len(rows)
    names = load_stars().column("name").tolist()
    matched = dict(zip([star["main_id"] for star in answer], match_snapshot(answer, load_stars()), strict=True))
    assert names[matched["* tau Cet"]] == "tau Cet"
    assert matched["HD 999004"] == -1


def test_bound_pairs_share_the_better_parallax(made):
    one, two = star(made, "alf Cen A"), star(made, "alf Cen B")
    assert one["parallax_mas"] == two["parallax_mas"] == pytest.approx(754.81)
    assert two["parallax_own_mas"] == pytest.approx(796.92)
    assert two["parallax_src"] == "derived:shared with alf Cen A"
    assert one["parallax_src"] == "measured"
    assert "shared_parallax" in flags(made, "alf Cen B")
    assert two["distance_pc"] == pytest.approx(1.3248, abs=1e-4)


def test_medians_of_the_measurements_with_count_and_newest_reference(made):
    row = star(made, "tau Cet")
    assert row["teff_k"] == 5344.0
    assert row["teff_k_src"] == "measured:median of 3 (SIMBAD mesFe_h, newest 2021A&A...656A..53S)"
    assert row["log_g"] == pytest.approx(4.5)
    assert row["metallicity"] == pytest.approx(-0.51)
    assert "median of 4" in row["metallicity_src"]


def test_what_simbad_has_not_comes_from_the_snapshot_or_is_derived_and_says_so(made):
    snapshot = load_stars(updates=False)
    old = snapshot.row(snapshot.column("name").tolist().index("eps Eri"))
    row = star(made, "eps Eri")
    assert (row["teff_k"], row["teff_k_src"]) == (old["teff_k"], f"{old['teff_k_src']}; from the snapshot")
    new = star(made, "HD 999012")
    assert new["teff_k"] == pytest.approx(colour_temperature(1.1, 0.0)[0], abs=0.1)
    assert new["teff_k_src"].startswith("derived:B-V")
    assert new["metallicity_src"] == "assumed:0"
    assert new["mass_msun_src"].startswith("assumed")
    m_bol = 5.9 - 5 * np.log10(1000 / 27.0 / 10) + bolometric_correction(new["teff_k"], 0.0, 2.5)
    assert new["luminosity_lsun"] == pytest.approx(10 ** (-0.4 * (m_bol - 4.73)), rel=1e-6)


def test_mass_of_the_literature_follows_unless_v_is_another_and_luminosity_is_of_the_new_v(made):
    snapshot = load_stars(updates=False)
    old = snapshot.row(snapshot.column("name").tolist().index("tau Cet"))
    same, other = star(made, "tau Cet"), star(made, "eps Eri")
    assert (same["mass_msun"], same["mass_msun_src"]) == (
        old["mass_msun"],
        f"{old['mass_msun_src']}; from the snapshot",
    )
    assert other["mass_msun_src"].startswith("derived:luminosity"), "its V is another one"
    for row in (same, other):
        correction = bolometric_correction(row["teff_k"], row["metallicity"], row["log_g"])
        m_bol = row["v_mag"] - 5 * np.log10(row["distance_pc"] / 10) + correction
        assert row["luminosity_lsun"] == pytest.approx(10 ** (-0.4 * (m_bol - 4.73)), rel=1e-6)
        assert row["luminosity_lsun_src"].startswith("derived:V, BC")


def test_companions_are_taken_over_or_looked_for_among_the_bright(made):
    snapshot = load_stars(updates=False)
    old = snapshot.row(snapshot.column("name").tolist().index("alf Cen B"))
    row = star(made, "alf Cen B")
    for name in ("companion_name", "companion_sep_arcsec", "companion_pa_deg", "companion_delta_v_mag"):
        assert row[name] == old[name]
    assert row["companion_src"] == f"{old['companion_src']}; from the snapshot"
    assert row["close_companion"] is True
    new = star(made, "HD 999002")
    assert new["companion_name"] == "HD 999003", "a neighbour of another class counts too"
    assert new["companion_sep_arcsec"] == pytest.approx(20.0, abs=1e-3)
    assert new["companion_pa_deg"] == pytest.approx(0.0, abs=1e-3)
    assert new["companion_delta_v_mag"] == pytest.approx(-0.3)
    assert new["companion_epoch_yr"] == 2000.0
    assert star(made, "HD 999010 A")["companion_name"] == "HD 999010 B", "the blend of both is no companion"
    assert "companions_not_searched" in flags(made, "HD 999002")
    assert "companions_not_searched" not in flags(made, "tau Cet")


def test_flags(made):
    assert "no_hip" in flags(made, "HD 999001")
    assert "no_class" not in flags(made, "HD 999001"), "the prefix sd says what it is"
    assert {"parallax_unknown_error", "rv_unknown", "double_entry"} <= flags(made, "HD 999002")
    assert {"giant", "low_parallax_snr"} <= flags(made, "HD 999012")
    assert "composite" in flags(made, "alf Aur")
    assert "variable" in flags(made, "eps Eri")
    known = set(SHIPPED_FLAGS) | set(ADDED_FLAGS)
    for text in made.table.column("quality_flags").tolist():
        assert set(text.split(";")) - {""} <= known


def test_columns_units_and_labels_are_those_of_the_snapshot(made):
    snapshot = load_stars()
    assert list(made.table.columns) == list(snapshot.columns) == [column.name for column in COLUMNS]
    assert dict(made.table.units) == dict(snapshot.units)
    for name, values in made.table.columns.items():
        assert values.dtype.kind == snapshot.columns[name].dtype.kind, name
        if name.endswith("_src"):
            assert all(text.startswith(("measured", "derived:", "assumed:", "missing")) for text in values.tolist()), (
                name
            )
    assert np.isnan(star(made, "HD 999001")["b_v_mag"])
    assert star(made, "HD 999001")["b_v_mag_src"] == "missing"


def test_differences_from_the_snapshot(made):
    changes = made.changes
    assert set(changes["added"]) == set(made.table.column("name").tolist()) - {
        "alf Cen A",
        "alf Cen B",
        "alf Aur",
        "tau Cet",
        "eps Eri",
    }
    assert changes["v_mag_changed"] == ["eps Eri"]
    assert changes["parallax_changed"] == []
    assert changes["same"] == 4
    within = load_stars().column("parallax_mas") >= Cuts().parallax_min_mas
    assert len(changes["removed"]) == within.sum() - 5
    assert changes["removed"]["alf Boo"] == "not in the answer"


def test_a_star_that_changed_its_class_or_became_a_blend_is_said_to_be_removed_for_that(tap, sky):
    tables = sky.small_sky()
    tables["basic"][3]["sp_type"] = "M0V"
    tables["basic"][4]["plx_value"] = 400.0
    service = tap.TapService(tables)
    made = refresh_stars(TapService(url=service.url, retries=0), Cuts())
    service.close()
    assert made.changes["removed"]["tau Cet"] == "type M0V"
    assert made.changes["parallax_changed"] == ["eps Eri"]


def test_wider_cuts_do_not_count_the_snapshots_own_edge(tap, sky):
    service = tap.TapService(sky.small_sky())
    made = refresh_stars(TapService(url=service.url, retries=0), Cuts(v_mag_max=2.0, parallax_min_mas=500.0))
    service.close()
    assert sorted(made.table.column("name").tolist()) == ["alf Cen A", "alf Cen B"]
    assert made.changes["removed"] == {}


def test_only_other_classes_is_a_failure(tap, sky):
    tables = sky.small_sky()
    for row in tables["basic"]:
        row["sp_type"] = "M0V"
    service = tap.TapService(tables)
    with pytest.raises(RefreshError, match="no star of class"):
        refresh_stars(TapService(url=service.url, retries=0), Cuts())
    service.close()


def changed(tap, sky, change):
    """The table of a sky with a change."""
    tables = sky.small_sky()
    change({row["main_id"]: row for row in tables["basic"]}, {row["oidref"]: row for row in tables["allfluxes"]})
    service = tap.TapService(tables)
    try:
        return refresh_stars(TapService(url=service.url, retries=0), Cuts())
    finally:
        service.close()


def test_an_error_of_zero_is_no_error(tap, sky):
    made = changed(tap, sky, lambda basic, fluxes: basic["* tau Cet"].update(plx_err=0.0))
    assert star(made, "tau Cet")["parallax_err_src"] == "missing"
    assert "parallax_unknown_error" in flags(made, "tau Cet")


def test_an_entry_fainter_than_its_components_is_no_blend(tap, sky):
    made = changed(tap, sky, lambda basic, fluxes: fluxes[17].update(v=7.3, b=7.9))
    assert "HD 999010" in made.table.column("simbad_id").tolist()


def test_a_colour_against_the_type_gives_way_to_the_subtypes_median(tap, sky):
    made = changed(tap, sky, lambda basic, fluxes: (basic["HD 999012"].update(sp_type="G2V"), fluxes[22].update(b=7.4)))
    row = star(made, "HD 999012")
    assert "colour_outlier" in flags(made, "HD 999012")
    assert row["b_v_mag"] == pytest.approx(0.64, abs=0.05)
    assert row["b_v_mag_src"] == "derived:median of the spectral subtype in the snapshot"
    assert row["teff_k"] == pytest.approx(5800.0, abs=120.0)


def test_the_neighbour_with_most_light_over_squared_separation_counts(tap, sky):
    def change(basic, fluxes):
        far, near = basic["HD 999004"], basic["HD 999006"]
        far.update(ra=50.0, dec=30.0 - 50 / 3600, plx_value=40.0)
        near.update(ra=50.0, dec=30.0 - 5 / 3600, plx_value=40.0)
        fluxes[11].update(v=2.0)
        fluxes[12].update(v=7.4)

    made = changed(tap, sky, change)
    row = star(made, "HD 999002")
    assert row["companion_name"] == "HD 999004"
    assert row["companion_pa_deg"] == pytest.approx(180.0)
    unrelated = changed(tap, sky, lambda basic, fluxes: basic["HD 999003"].update(plx_value=90.0))
    assert star(unrelated, "HD 999002")["companion_name"] == "", "another distance is another star"
    close = changed(
        tap, sky, lambda basic, fluxes: (basic["HD 999003"].update(dec=30.001), basic["HD 999002"].update(otype="*"))
    )
    assert star(close, "HD 999002")["close_companion"] is True


def test_rows_outside_the_cuts_are_left_out_and_counted(tap, sky):
    service = tap.TapService(sky.small_sky())

    def alter(headings, rows):
        if len(headings) > 10:  # the first question: a service that does not keep to the cut in V
            extra = list(rows[0])
            extra[0], extra[1], extra[12] = 999, "HD 77", 11.0
            rows = [*rows, extra]
        return headings, rows

    service.alter = alter
    made = refresh_stars(TapService(url=service.url, retries=0), Cuts())
    service.close()
    assert made.counts["left out: outside the cuts"] == 1
    assert "HD 77" not in made.table.column("simbad_id").tolist()


def test_the_snapshots_own_sky_gives_the_snapshot(same_sky):
    """Names, numbers and companions come back; only rounding and the labels of what was taken over differ."""
    snapshot = load_stars(updates=False)
    old = snapshot.select(snapshot.column("parallax_mas") >= Cuts().parallax_min_mas)
    new = same_sky.table
    assert new.column("name").tolist() == old.column("name").tolist()
    assert [same_sky.changes[name] for name in ("added", "v_mag_changed", "parallax_changed")] == [[], [], []]
    assert same_sky.changes["removed"] == {}
    assert same_sky.changes["same"] == len(old)
    tolerance = {
        "teff_k": 2e-4,
        "log_g": 3e-3,
        "luminosity_lsun": 6e-4,  # half of the last decimal of the faintest, 0.0863
        "radius_rsun": 1e-3,
        "mass_msun": 1e-3,
        "distance_pc": 3e-5,
    }
    for name in (
        "ra_deg",
        "dec_deg",
        "parallax_mas",
        "v_mag",
        "b_v_mag",
        "metallicity",
        "companion_sep_arcsec",
        "companion_pa_deg",
        "companion_delta_v_mag",
        *tolerance,
    ):
        np.testing.assert_allclose(
            new.column(name), old.column(name), rtol=tolerance.get(name, 1e-9), atol=1e-9, err_msg=name
        )
    for name in """
        hip hd gj bayer flamsteed sp_type luminosity_class close_companion companion_name
    """.split():
        np.testing.assert_array_equal(new.column(name), old.column(name), err_msg=name)


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
