"""Spectral types: reading and mean sequences."""

import itertools

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from catalogs.errors import InputError
from catalogs.spectral_types import parse_spectral_type, stellar_parameters


@pytest.mark.parametrize(
    ("text", "position", "rank"),
    [
        ("K1V", 51.0, 5.0),
        ("k1v", 51.0, 5.0),
        ("G2 V", 42.0, 5.0),
        ("G8.5IV-V", 48.5, 4.5),
        ("F7/8V", 37.5, 5.0),
        ("G8/K0 V", 49.0, 5.0),
        ("K0IIIb", 50.0, 3.0),
        ("F5Iab:", 35.0, 1.0),
        ("sdG2", 42.0, 5.0),
        ("dK5", 55.0, 5.0),
        ("gM3", 63.0, 3.0),
        ("F6V+M", 36.0, 5.0),
        ("(G3w)F7V", 37.0, 5.0),
        ("kA5hF0mF2", 30.0, 5.0),
        ("kA2hA5mA4IV-V", 25.0, 4.5),
        ("hF3mF5V", 33.0, 5.0),
        ("A5mF2", 25.0, 5.0),
        ("G0VmF2", 40.0, 5.0),
        ("F0VpkA5Sr", 30.0, 5.0),
        ("g2v", 42.0, 5.0),
        ("G2v", 42.0, 5.0),
        ("k0iii", 50.0, 3.0),
        ("g8iv-v", 48.0, 4.5),
        ("k 2 v", 52.0, 5.0),
        (" K1\tV ", 51.0, 5.0),
        ("F5 IV/V", 35.0, 4.5),
        ("F5IV,V", 35.0, 4.5),
        ("G5III-IV", 45.0, 3.5),
        ("G5Ib-II", 45.0, 1.5),
        ("K2(IV)", 52.0, 4.0),
        ("K1/2(III)", 51.5, 3.0),
        ("sd:F8", 38.0, 5.0),
        ("esdK7", 57.0, 5.0),
        ("dM1", 61.0, 5.0),
        ("dm1", 61.0, 5.0),
        ("M3.5:d", 63.5, 5.0),
        ("K0III+...", 50.0, 3.0),
        ("K0III + G1V", 50.0, 3.0),
        ("A9V+F4III", 29.0, 5.0),
        ("G8.5", 48.5, 5.0),
        ("G8,5V", 48.5, 5.0),
        ("M2Ve", 62.0, 5.0),
        ("K3-V?", 53.0, 5.0),
        ("K3+V", 53.0, 5.0),
        ("G8+VCN+1", 48.0, 5.0),
        ("(G8)V", 48.0, 5.0),
        ("G2 V:", 42.0, 5.0),
        ("F2:V:", 32.0, 5.0),
        ("G8:III/IV+...", 48.0, 3.5),
        ("K1V Fe-1.5", 51.0, 5.0),
        ("K1.5IIIFe-0.5", 51.5, 3.0),
        ("K0IIIb CN1", 50.0, 3.0),
        ("A0Va+", 20.0, 5.0),
        ("F8Ia0", 38.0, 1.0),
        ("G0VI", 40.0, 5.0),
        ("M3SIII", 63.0, 3.0),
        ("G2\u2013K0V", 46.0, 5.0),
        ("G2\u2212 3V", 42.5, 5.0),
        ("\uff27\uff12\uff36", 42.0, 5.0),
        ("K0V\u2026", 50.0, 5.0),
        ("K2V k", 52.0, 5.0),
        ("M3.5Ve", 63.5, 5.0),
        ("G0V CH-0.3", 40.0, 5.0),
    ],
)
def test_reading(text: str, position: float, rank: float) -> None:
    found = parse_spectral_type(text)
    assert (found.position, found.luminosity_rank) == (position, rank)


@pytest.mark.parametrize(
    ("text", "flags"),
    [
        ("K1V", ()),
        ("K1", ("luminosity_class_assumed",)),
        ("KV", ("subclass_assumed",)),
        ("Am", ("subclass_assumed", "luminosity_class_assumed")),
        ("sdF8", ("subdwarf_as_dwarf",)),
        ("G0VI", ("subdwarf_as_dwarf",)),
        ("G2V:", ("type_uncertain",)),
        ("K3V?", ("type_uncertain",)),
        ("K0III+G1V", ("composite_first_used",)),
        ("F6V+M", ("composite_first_used",)),
        ("K0III+...", ("composite_first_used",)),
        ("K0V+sdM", ("composite_first_used",)),
        ("A0Va+", ()),
        ("G8+V", ()),
        ("G6VCN+0.5", ()),
        ("dM1", ()),
    ],
)
def test_flags(text: str, flags: tuple[str, ...]) -> None:
    assert parse_spectral_type(text).flags == flags


def test_what_the_text_does_not_say_is_flagged() -> None:
    assert parse_spectral_type("K1V").flags == ()
    assert parse_spectral_type("K1").flags == ("luminosity_class_assumed",)
    assert parse_spectral_type("GV").flags == ("subclass_assumed",)
    assert stellar_parameters("F").flags == ("subclass_assumed", "luminosity_class_assumed")


@pytest.mark.parametrize(
    ("text", "teff_k"),
    [
        ("F5V", 6550),
        ("G2V", 5770),
        ("G5V", 5660),
        ("K1V", 5170),
        ("K5V", 4440),
        ("A0V", 9700),
        ("K0III", 4810),
    ],
)
def test_temperatures_of_the_published_tables(text: str, teff_k: float) -> None:
    assert stellar_parameters(text).teff_k == teff_k


def test_gravities() -> None:
    assert stellar_parameters("G2V").log_g == pytest.approx(4.44, abs=0.02)
    assert stellar_parameters("K0III").log_g == pytest.approx(2.14)
    dwarf, subgiant, giant = (stellar_parameters(f"K0{c}") for c in ("V", "IV", "III"))
    assert dwarf.log_g > subgiant.log_g > giant.log_g
    assert subgiant.teff_k == pytest.approx((dwarf.teff_k + giant.teff_k) / 2)


def test_temperature_falls_along_the_sequence() -> None:
    names = [f"{letter}{n}V" for letter in "AFGK" for n in range(10)] + [f"M{n}V" for n in range(7)]
    values = [stellar_parameters(name).teff_k for name in names]
    assert all(a > b for a, b in itertools.pairwise(values))


@pytest.mark.parametrize(
    "text", ["", "banana", "Kitten", "WC8", "DA2", "T5", "M9V", "O5V", "M6I", "1G", "GK", "sd", "Vega", "+", "x" * 999]
)
def test_other_words_are_refused(text: str) -> None:
    with pytest.raises(InputError) as caught:
        stellar_parameters(text)
    assert caught.value.key == "spectral_type"


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("", "not known"),
        ("  ", "not known"),
        ("~", "not known"),
        ("nan", "not known"),
        ("DA2", "white dwarf"),
        ("DA2.5+dM", "white dwarf"),
        ("DQ", "white dwarf"),
        ("da2", "write dA2"),
        ("L1", "brown dwarf"),
        ("T8", "brown dwarf"),
        ("L7.5:", "brown dwarf"),
        ("WN6", "Wolf-Rayet"),
        ("C5,4", "carbon or S star"),
        ("S4/2", "carbon or S star"),
        ("N", "carbon or S star"),
        ("sdB2", "hot subdwarf"),
        ("sdO", "hot subdwarf"),
        ("Sirius", ""),
    ],
)
def test_refusals_say_why(text: str, hint: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_spectral_type(text)
    assert hint in caught.value.hint
    assert bool(hint) == bool(caught.value.hint)


@given(st.one_of(st.text(), st.text("OBAFGKMLDWIVabdegkmhns0123456789.:+-/()? ", max_size=20)))
@example("K0" + "-" * 150)
@example("kA0" * 60)
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        found = stellar_parameters(text)
    except InputError:
        return
    assert 2000.0 < found.teff_k < 35000.0
    assert -1.0 < found.log_g < 6.0


@pytest.mark.parametrize("value", [None, 5, float("nan"), b"K1V", ["K1V"]])
def test_what_is_not_text_is_refused(value) -> None:
    with pytest.raises(InputError, match="spectral_type"):
        parse_spectral_type(value)


def test_every_type_of_the_catalogue_is_read() -> None:
    from catalogs.stars import load_stars

    types = {str(text) for text in load_stars().column("sp_type")}
    assert len(types) > 300
    for text in types:
        found = parse_spectral_type(text)
        assert found.position // 10 == "OBAFGKM".index(text[0])
        assert 3500.0 < stellar_parameters(text).teff_k < 8000.0
