"""Every spelling of a designation has one key."""

import pytest
from hypothesis import given, strategies as st

from catalogs import CONSTELLATIONS, GREEK
from catalogs.nomenclature import designation_key, split_component


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
