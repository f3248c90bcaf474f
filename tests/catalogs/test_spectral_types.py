"""Spectral types: reading and mean sequences."""

import itertools

import pytest
from hypothesis import example, given, strategies as st

from catalogs import parse_spectral_type, stellar_parameters
from cpic_core import InputError


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


@given(st.one_of(st.text(), st.text("OBAFGKMLDWIVabdegkmhns0123456789.:+-/()? ", max_size=20)))
@example("K0" + "-" * 150)
@example("kA0" * 60)
@example("x" * 999)
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        found = stellar_parameters(text)
    except InputError:
        return
    assert 2000.0 < found.teff_k < 35000.0
    assert -1.0 < found.log_g < 6.0


def test_every_type_of_the_catalogue_is_read() -> None:
    from catalogs import load_stars

    types = {str(text) for text in load_stars().column("sp_type")}
    assert len(types) > 300
    for text in types:
        found = parse_spectral_type(text)
        assert found.position // 10 == "OBAFGKM".index(text[0])
        assert 3500.0 < stellar_parameters(text).teff_k < 8000.0
