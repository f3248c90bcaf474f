"""Spectral types: reading and mean sequences."""

from __future__ import annotations

import itertools

import pytest

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
        ("kA5hF0mF2", 25.0, 5.0),
        ("K2V k", 52.0, 5.0),
        ("M3.5Ve", 63.5, 5.0),
        ("G0V CH-0.3", 40.0, 5.0),
    ],
)
def test_reading(text: str, position: float, rank: float) -> None:
    found = parse_spectral_type(text)
    assert (found.position, found.luminosity_rank) == (position, rank)


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


@pytest.mark.parametrize("text", ["", "banana", "Kitten", "WC8", "DA2", "T5", "M9V", "O5V", "M6I", "1G"])
def test_other_words_are_refused(text: str) -> None:
    with pytest.raises(InputError) as caught:
        stellar_parameters(text)
    assert caught.value.key == "spectral_type"
