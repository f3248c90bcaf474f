import pytest

from cpic_planner.models import Quantiles
from cpic_planner.report.numbers import (
    MISSING,
    contrast_text,
    count_text,
    decimals,
    duration_text,
    formatted,
    percent_text,
    significant,
)


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
