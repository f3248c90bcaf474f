""""""

import numpy as np
import pytest

from catalogs import load_stars
from cpic_planner.report import duration_text
from cpic_planner.report.words import (
    MISSING,
    contrast_text,
    count_text,
    decimals,
    formatted,
    full_name,
    percent_text,
    pretty_name,
    significant,
)
from cpic_planner.results import Quantiles


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (significant(31.04), "31.0"),
        (significant(0.0312345), "0.0312"),
        (significant(1234.5), "1234"),
        (significant(0.0), "0"),
        (significant(-1.5), "−1.50"),
        (decimals(-0.26, 1), "−0.3"),
        (contrast_text(5.163e-8), "5.16 × 10⁻⁸"),
        (contrast_text(0.0), "0"),
        (contrast_text(-2e-9, 2), "−2.0 × 10⁻⁹"),
        (duration_text(59.0), "59.0 s"),
        (duration_text(1800.0), "30.0 min"),
        (duration_text(36000.0), "10.0 h"),
        (count_text(1094), "1\u202f094"),
        (percent_text(0.944), "94 %"),
        (formatted(3.14159, ".2f"), "3.14"),
        (formatted(1234.5, ".3g"), "1234"),
        (formatted(5.163e-8, ".2e"), "5.16e-08"),
        (formatted(20.0, "g"), "20"),
        (formatted(12345, "d"), "12\u202f345"),
        (formatted(0.1234, "%"), "12.3"),
        (formatted(5400.0, "time"), "1.50 h"),
        (formatted(5400.0, "min"), "90.0"),
        (formatted(12_300_000, "bytes"), "12.3 MB"),
        (formatted("* alf Cen B", "star"), "α Cen B"),
        (formatted(Quantiles(low=1.0, median=2.0, high=3.0), ".1f"), "2.0"),
        (formatted(0.12345), "0.123"),
        (formatted(7), "7"),
        (formatted(True), "yes"),
        (formatted(["a", "b"]), "a, b"),
        (formatted([]), MISSING),
        (formatted(None, "d"), MISSING),
    ],
)
def test_formats(text, expected):
    assert text == expected


@pytest.mark.parametrize("function", [significant, contrast_text, duration_text, percent_text])
@pytest.mark.parametrize("value", [None, float("nan"), float("inf")])
def test_missing_numbers_are_a_dash(function, value):
    assert function(value) == MISSING
    assert decimals(value, 2) == MISSING


def test_missing_count():
    assert count_text(None) == MISSING


@pytest.mark.parametrize(
    ("identifier", "expected"),
    [
        ("* alf Cen B", "α Cen B"),
        ("* tau Cet", "τ Cet"),
        ("tau Cet", "τ Cet"),
        ("HD  10700", "HD 10700"),
        ("V* AK Lep", "AK Lep"),
        ("V* V538 Aur", "V538 Aur"),
        ("NAME Proxima Centauri", "Proxima Centauri"),
        ("* pi.03 Ori", "π³ Ori"),
        ("* alf01 Cen", "α¹ Cen"),
        ("*  61 Cyg A", "61 Cyg A"),
        ("* ksi Boo A", "ξ Boo A"),
        ("* e Eri", "e Eri"),
        ("* b03 Cyg", "b³ Cyg"),
        ("** STF 60A", "STF 60A"),
        ("* mu.02 Cnc", "μ² Cnc"),
        ("HIP 8102", "HIP 8102"),
        ("ups Foo", "ups Foo"),
        ("<script>", "<script>"),
        ("", ""),
    ],
)
def test_pretty_name(identifier, expected):
    assert pretty_name(identifier) == expected


def test_full_name():
    assert full_name("* tau Cet", 8102) == "τ Cet (HIP 8102)"
    assert full_name("HIP 8102", 8102) == "HIP 8102"
    assert full_name("* tau Cet", None) == "τ Cet"


def test_catalogue_names_stay_distinct_and_short():
    names = [pretty_name(str(name)) for name in np.asarray(load_stars().column("name"))]
    assert len(set(names)) == len(names)
    assert max(map(len, names)) <= 18
