"""From the answers to a table: names, blends, shared parallaxes, filled values and their labels."""

import numpy as np
import pytest

from catalogs import ADDED_FLAGS, Cuts, RefreshError, TapService, load_stars, refresh_stars, resolve_star
from catalogs.simbad import blends, match_snapshot, own_names, read_stars, row_name
from catalogs.stars import COLUMNS, FLAGS
from catalogs.stellar_physics import bolometric_correction, colour_temperature


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
    from catalogs import queries
    from catalogs.archives import ask

    answer = read_stars(ask(TapService(), simbad.url, queries(Cuts())[0]))
    listed, alone = blends(answer)
    assert {answer[i]["main_id"] for i in listed} == {"* alf Cen", "HD 999010"}
    assert {answer[i]["main_id"] for i in alone} == {"* alf Aur"}


def test_no_two_objects_are_one_star_of_the_snapshot(simbad):
    next(row for row in simbad.tables["ids"] if row["oidref"] == 11)["ids"] += "|HIP 8102"  # a stray identifier
    from catalogs import queries
    from catalogs.archives import ask

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
    known = set(FLAGS) | set(ADDED_FLAGS)
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
