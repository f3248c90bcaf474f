import pytest

from cpic_planner.report.numbers import (
    MISSING,
    contrast_text,
    count_text,
    decimals,
    duration_text,
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
