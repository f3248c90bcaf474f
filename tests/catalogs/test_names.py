"""Name resolution: the way people type star names, ambiguity, refusals."""

import pytest

from catalogs import load_stars, open_catalogue, resolve_star

HIP = {
    "alf Cen A": 71683,
    "alf Cen B": 71681,
    "tau Cet": 8102,
    "eps Eri": 16537,
    "82 Eri": 15510,
    "61 Cyg A": 104214,
    "61 Cyg B": 104217,
    "omi2 Eri": 19849,
    "alf CMi": 37279,
}


@pytest.mark.parametrize(("name", "hip"), HIP.items())
def test_hip_numbers_against_the_literature(name: str, hip: int) -> None:
    stars = load_stars()
    match = resolve_star(f"HIP {hip}")
    assert match.name == name
    assert match.note == ""
    assert stars.row(match.index)["hip"] == hip


@pytest.mark.parametrize(
    ("text", "name", "other"),
    [
        ("61 Cyg", "61 Cyg A", "61 Cyg B"),
        ("alpha Cen", "alf Cen A", "alf Cen B"),
        ("Alpha Centauri", "alf Cen A", "alf Cen B"),
        ("GJ 559", "alf Cen A", "alf Cen B"),
        ("70 Oph", "70 Oph A", "70 Oph B"),
        ("HIP 88601", "70 Oph A", "70 Oph B"),
        ("xi Boo", "ksi Boo A", "ksi Boo B"),
        ("xi UMa", "ksi UMa A", "ksi UMa B"),
        ("16 Cyg", "16 Cyg A", "16 Cyg B"),
        ("zeta Reticuli", "zet2 Ret", "zet1 Ret"),
    ],
)
def test_a_system_gives_its_brightest_star_and_a_note(text: str, name: str, other: str) -> None:
    match = resolve_star(text)
    assert match.name == name
    assert name in match.note
    assert other in match.note


def test_lenient_forms_say_so() -> None:
    assert "case" in resolve_star("E Eri").note
    assert resolve_star("Procyon A").name == "alf CMi"
    assert resolve_star("tau Cet A").name == "tau Cet"


def test_every_star_answers_to_its_own_names() -> None:
    stars = load_stars()
    for index in range(len(stars)):
        row = stars.row(index)
        for column in ("name", "simbad_id", "hd", "gj"):
            if row[column]:
                match = resolve_star(str(row[column]))
                found = stars.row(match.index)
                same = match.index == index or (found[column] == row[column] and "system" in match.note)
                assert same, (column, row[column], match)


def test_hip_number_gives_a_star_of_that_number() -> None:
    stars = load_stars()
    for hip in sorted(set(stars.column("hip").tolist()) - {0}):
        assert stars.row(resolve_star(f"HIP {hip}").index)["hip"] == hip


def test_a_selection_has_its_own_rows(refused) -> None:
    stars = load_stars()
    part = stars.select(stars.column("luminosity_class") == "V")
    match = resolve_star("tau Cet", part)
    assert part.row(match.index)["name"] == "tau Cet"
    refused("not selected", resolve_star, "Arcturus", part)


def own_table(tmp_path, *names, magnitudes=None):
    magnitudes = magnitudes or [5.0 + i for i in range(len(names))]
    lines = [f"{name},10,{v_mag},G2V" for name, v_mag in zip(names, magnitudes, strict=True)]
    (tmp_path / "mine.csv").write_text("\n".join(["name,dist,V,SpT", *lines]) + "\n", encoding="utf-8")
    return open_catalogue(tmp_path / "mine.csv").table


@pytest.mark.parametrize(
    ("listed", "asked"),
    [
        ("HD 10700", "tau Cet"),
        ("HD 10700", "HIP 8102"),
        ("HD 10700", "τ Ceti"),
        ("tau Cet", "HD10700"),
        ("HIP 71681", "alpha Centauri B"),
        ("Toliman", "GJ 559 B"),
        ("GJ 820 B", "61 Cyg B"),
        ("my star", "My  Star"),
        ("alf Lyr", "α Lyrae"),
        ("HD 1 A", "HD 1"),
        ("82 Eri", "e Eri"),
    ],
)
def test_a_users_star_answers_to_every_name_that_is_known_of_it(tmp_path, listed, asked):
    table = own_table(tmp_path, "HD 99", listed)
    match = resolve_star(asked, table)
    assert (match.index, match.name) == (1, listed)


def test_own_names_go_before_those_of_the_embedded_catalogue(tmp_path):
    table = own_table(tmp_path, "HIP 8102", "tau Cet")
    assert resolve_star("tau Cet", table).index == 1
    assert resolve_star("HIP 8102", table).index == 0
    assert resolve_star("HD 10700", table).name == "HIP 8102", "the brighter of two rows that are one star"
    assert "tau Cet" in resolve_star("HD 10700", table).note


def test_other_stars_that_a_name_may_mean_are_listed():
    assert resolve_star("61 Cyg").others == ("61 Cyg B",)
    assert resolve_star("zeta Ret").others == ("zet1 Ret",)
    assert resolve_star("61 Cyg A").others == resolve_star("tau Cet").others == ()
    alone = load_stars().select([load_stars().column("name").tolist().index("61 Cyg A")])
    assert resolve_star("61 Cyg", alone).others == (), "the other one is not selected"


def test_a_system_in_a_users_table_gives_its_brightest_star_and_a_note(tmp_path):
    table = own_table(tmp_path, "GJ 9 B", "GJ 9 A", "61 Cyg B", magnitudes=[4.0, 6.0, 7.0])
    assert resolve_star("GJ 9", table).name == "GJ 9 A", "component A is what a system's name usually means"
    assert resolve_star("61 Cyg", table).name == "61 Cyg B"
    assert "system" in resolve_star("61 Cyg", table).note


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ("61 Cyg A", "61 Cyg A is in the embedded catalogue"),
        ("Vega", "a star of mine.csv"),
        ("my stat", "nearest: my star"),
        ("HIP 7", "nothing similar"),
    ],
)
def test_what_a_users_table_has_not_is_refused_with_the_nearest(refused, tmp_path, asked, words):
    table = own_table(tmp_path, "my star", "61 Cyg B")
    message = refused("", resolve_star, asked, table)
    assert words in message


def test_component_letters_are_not_ignored_in_a_users_table(refused, tmp_path):
    table = own_table(tmp_path, "alf Cen B")
    refused("alf Cen A is in the embedded catalogue", resolve_star, "alf Cen A", table)


def test_exact_names_go_before_brighter_rows_and_letters_of_designations_count(refused, tmp_path):
    text = "name,hip,bayer,dist,V,SpT\nHIP 8102,,,10,5,G2V\ntau Cet,8102,,10,3,G8V\nx B,,alf Cen,10,4,K1V\n"
    (tmp_path / "t.csv").write_text(text)
    table = open_catalogue(tmp_path / "t.csv").table
    assert resolve_star("HIP 8102", table).index == 0
    assert resolve_star("alf Cen B", table).name == "x B"
    assert resolve_star("alf Cen", table).name == "x B"
    refused("alf Cen A is in the embedded catalogue", resolve_star, "alf Cen A", table)


def test_resolution_in_a_large_table_of_ones_own(tmp_path):
    table = own_table(tmp_path, *(f"star {i}" for i in range(1500)), magnitudes=[6.0] * 1500)
    for i in range(0, 1500, 100):
        assert resolve_star(f"star {i}", table).index == i


@pytest.mark.parametrize("name", ["Sirius B", "alf CMa B", "Fomalhaut C", "Vega B"])
def test_a_component_is_not_told_the_type_of_its_primary(refused, name):
    assert "spectral type" not in refused(f"component {name[-1]} is not in the catalogue", resolve_star, name)
