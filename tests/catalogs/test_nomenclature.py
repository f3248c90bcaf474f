"""Every spelling of a designation has one key."""

import pytest
from hypothesis import given, strategies as st

from catalogs import CONSTELLATIONS, GREEK
from catalogs.nomenclature import designation_key, host_of_planet, numbered_star, split_component, star_name_of


@pytest.mark.parametrize(
    ("key", "spellings"),
    [
        ("hip 71681", ["HIP 71681", "hip71681", "HIP  071681", "Hip-71681", "HIC 71681"]),
        ("gj 559 b", ["GJ 559B", "GJ 559 B", "Gl 559 B", "gliese 559b", "Gl559B"]),
        ("gj 3021", ["GJ 3021", "NN 3021"]),
        ("hd 10700", ["HD 10700", "hd010700", "HD\u200910700"]),
        (
            "alf cen b",
            ["alf Cen B", "alpha Cen B", "Alpha Centauri B", "α Cen B", "* alf Cen B", "ALPHA CEN b", "Alp Cen B"],
        ),
        ("alf2 cen", ["α² Cen", "alf02 Cen", "alpha-2 Centauri", "α2 Cen"]),
        ("ksi boo a", ["ksi Boo A", "xi Boo A", "Xi Boötis A", "ξ Boo A"]),
        ("tet uma", ["tet UMa", "the UMa", "theta Ursae Majoris", "ϑ UMa"]),
        ("mu cas", ["mu Cas", "mu. Cas", "µ Cas", "μ Cassiopeiae"]),
        ("omi2 eri", ["omi2 Eri", "omi02 Eri", "ο² Eri", "Omicron2 Eridani"]),
        ("bet cvn", ["beta CVn", "bet Canum Venaticorum"]),
        ("61 cyg a", ["61 Cyg A", "61 Cygni a", "61Cygni A"]),
        ("tau cet", ["tau Cet", "tauCeti", "τ Cet", "TAU CETI"]),
        ("v1803 cyg", ["V* V1803 Cyg", "V1803 cyg", "v 1803 Cygni"]),
        ("kx lib", ["KX Lib", "V* KX Lib"]),
        ("barnards star", ["Barnard's Star", "NAME Barnard's star", "barnard’s  star"]),
        ("bd+15 3364", ["BD+15 3364", "BD +15 3364", "BD+15°3364", "BD+15d3364", "bd +15  03364"]),
        ("cd-32 17191", ["CD-32 17191", "CD −32 17191", "CD-32°17191"]),
        ("bd+08 24", ["BD+08 24", "BD+8 24"]),
        ("bd+17 1286b", ["BD+17 1286b"]),
        ("bd-14 6448 a", ["BD-14 6448 A"]),
        ("tic 440109725", ["TIC 440109725", "TIC440109725", "tic-440109725"]),
        ("gaia dr3 385334230892516480", [f"Gaia{name} 385334230892516480" for name in (" DR3", " EDR3", "DR3", "")]),
        ("gaia dr2 385334230892516480", ["Gaia DR2 385334230892516480", "GAIA_DR2_385334230892516480"]),
        ("toi 700", ["TOI-700", "TOI 700", "toi700"]),
        ("hat-p 7", ["HAT-P-7", "HAT-P 7"]),
        ("k2 18", ["K2-18", "K2 18"]),
        ("eta tel b", ["eta Tel B", "eta Tel (B)", "η Telescopii(B)"]),
        ("", ["", "   "]),
    ],
)
def test_spellings(key: str, spellings: list[str]) -> None:
    assert {designation_key(text) for text in spellings} == {key}


def test_latin_bayer_letters_keep_their_case() -> None:
    assert designation_key("e Eri") == "e eri"
    assert designation_key("E Eri") == "E eri"
    assert designation_key("e ERI") == "e eri"
    assert designation_key("eps Eri") == designation_key("EPS ERI") == "eps eri"


def test_split_component() -> None:
    assert split_component("alf cen b") == ("alf cen", "b")
    assert split_component("gj 559") == ("gj 559", "")
    assert split_component("bet cae") == ("bet cae", "")
    assert split_component("procyon b") == ("procyon", "b")


def test_tables_are_complete() -> None:
    assert len(CONSTELLATIONS) == 88
    assert len(GREEK) == 24
    for short, genitive in CONSTELLATIONS.items():
        assert designation_key(f"61 {genitive}") == f"61 {short.lower()}"


@given(st.text(max_size=40))
def test_any_text_has_a_stable_key(text: str) -> None:
    key = designation_key(text)
    assert designation_key(key) == key or key[:1] == " "


@pytest.mark.parametrize(
    "text", ["hd" + "0" * 40_000 + "x", "alf " + "0" * 40_000 + "x cen", "e" + "\u0301\u0323" * 40_000]
)
def test_a_text_that_is_too_long_for_a_name_is_not_parsed(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    """Forty thousand zeros or accents took a minute of processor, the square of their number."""
    monkeypatch.setattr("catalogs.nomenclature._plain", lambda text: pytest.fail("parsed"))
    assert designation_key(75 * text) == (75 * text).lower()


def test_long_texts_are_one_name_in_any_case() -> None:
    assert designation_key("A  Name " * 100) == designation_key("a name\n" * 100)


@pytest.mark.parametrize(
    ("row", "name"),
    [
        *(({"hip": cell}, "HIP 1475") for cell in (1475, 1475.0, "1475", "1475.0", "001475", "HIP 1475", "hip1475")),
        *(({"hip": cell}, "HIP 1475 B") for cell in ("1475B", "1475 B", "HIP 1475B", "HIP1475 b")),
        *(({"hd": cell}, "HD 1326 A") for cell in ("1326A", "HD 1326A", "HD1326 A")),
        *(({"gj": cell}, "GJ 15 A") for cell in ("15A", "GJ 15 A", "GJ15A", "Gl 15A", "Gliese 15 A")),
        *(({"gj": cell}, "GJ 15.1") for cell in (15.1, "15.1", "GJ 15.1")),
        *(({"tic": cell}, "TIC 440109725") for cell in (440109725, 440109725.0, "TIC 440109725", "TIC440109725")),
        ({"hr": "8832"}, "HR 8832"),
        *(({"gaia": cell}, "Gaia DR3 385334230892516480") for cell in (385334230892516480, "385334230892516480")),
        ({"gaia": "Gaia DR3 385334230892516480"}, "Gaia DR3 385334230892516480"),
        ({"gaia": "Gaia DR2 385334230892516480"}, "Gaia DR2 385334230892516480"),
        ({"gaia": 385334230892516480.0}, None),
        ({"hip": "1475", "hd": "1326", "gj": "15 A"}, "HIP 1475 A"),
        ({"hip": 1475, "component": "B"}, "HIP 1475 B"),
        ({"hip": "1475A", "gj": "15 B"}, "HIP 1475 A"),
        ({"hip": 0, "hd": float("nan"), "gj": "", "hr": None, "tic": "5"}, "TIC 5"),
        ({"hd": "1326", "gaia": 385334230892516480}, "HD 1326"),
        ({"gj": "15", "hr": 8832}, "GJ 15"),
        *(({"hip": cell}, None) for cell in ("-5", "HD 1326", "1475.5", "abc", "--", 0, None)),
        ({"v_mag": 5.0}, None),
        ({}, None),
    ],
)
def test_a_star_without_a_name_has_that_of_its_number(row, name):
    assert star_name_of(row) == name


def test_a_number_is_read_with_the_letter_of_its_component():
    assert numbered_star("1475B", "hip") == ("HIP 1475", "B")
    assert numbered_star("HD 1326", "hip") == ("", "")


def test_two_components_of_one_number_are_two_stars():
    rows = ({"hip": 1475, "gj": "15 A"}, {"hip": 1475, "gj": "15 B"}, {"hip": "1475"})
    assert len({designation_key(star_name_of(row)) for row in rows}) == 3


@pytest.mark.parametrize(
    ("planet", "star", "part"),
    [
        ("HD 154857 b", "HD 154857", "b"),
        ("47 UMa b", "47 UMa", "b"),
        ("eps Eri b", "eps Eri", "b"),
        ("beta  Pic c", "beta Pic", "c"),
        ("alf Cen A b", "alf Cen A", "b"),
        ("GJ 15 A b", "GJ 15 A", "b"),
        ("HIP 65 A b", "HIP 65 A", "b"),
        ("HD 10647b", "HD 10647", "b"),
        ("WASP-12b", "WASP-12", "b"),
        ("GJ 667Cc", "GJ 667C", "c"),
        ("16 Cyg Bb", "16 Cyg B", "b"),
        ("Kepler-16 (AB) b", "Kepler-16", "b"),
        ("Kepler-16(AB)b", "Kepler-16", "b"),
        ("HU Aqr AB c", "HU Aqr", "c"),
        ("HD 41004 (A) b", "HD 41004 A", "b"),
        ("TOI-700 d", "TOI-700", "d"),
        ("TOI-700.01", "TOI-700", "01"),
        ("TOI 700.02", "TOI 700", "02"),
        ("KOI-351.01", "KOI-351", "01"),
        ("K00351.01", "KOI-351", "01"),
        ("EPIC 201367065.03", "EPIC 201367065", "03"),
        ("HD 3651.02", "HD 3651", "02"),
        ("GJ 649.02", "GJ 649", "02"),
        ("PSR B1257+12 b", "PSR B1257+12", "b"),
        ("2MASS J12073346-3932539 b", "2MASS J12073346-3932539", "b"),
        ("Proxima Cen b", "Proxima Cen", "b"),
        ("OGLE-2005-BLG-390L b", "OGLE-2005-BLG-390L", "b"),
        ("BD+14 4559 b", "BD+14 4559", "b"),
        ("Barnard's star e", "Barnard's star", "e"),
        ("Kepler-90 i", "Kepler-90", "i"),
    ],
)
def test_the_star_of_a_planets_name(planet, star, part):
    assert host_of_planet(planet) == (star, part)


@pytest.mark.parametrize(
    "name",
    ["Dimidium", "Earth", "b", "", "tau Cet", "HD 10700", "61 Cyg A", "eta Tel (B)", "GJ 1.1", "GJ 15.11", "51 Pegb"],
)
def test_names_that_end_in_no_planets_letter(name):
    assert host_of_planet(name) is None


@pytest.mark.parametrize("name", ["eps Eri", "47 UMa", "16 Cyg B", "HD 10647", "tau Cet"])
def test_every_way_to_write_a_planet_gives_one_star(name):
    forms = [f"{name} b", f"{name}  b", f"{name} b "] + [f"{name}b"] * (name[-1] in "0123456789B")
    assert {designation_key(host_of_planet(form)[0]) for form in forms} == {designation_key(name)}
