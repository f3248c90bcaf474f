"""What programmes leave unused of a given time, and for whom they were chosen, in words."""

from types import SimpleNamespace

import pytest

from cpic_planner.report.confirm import programme_sentences
from cpic_planner.report.known import lacking_lines
from cpic_planner.report.words import unused_text
from tests.cpic_planner.measured import band

HOUR = 3600.0


def row(band, unused_h, used_h, **more):
    unused_s = None if unused_h is None else unused_h * HOUR
    return SimpleNamespace(band=band, unused_s=unused_s, time_s=None if used_h is None else used_h * HOUR, **more)


@pytest.mark.parametrize(
    ("rows", "text"),
    [
        ([], ""),
        ([row("F520", None, 3.0)], ""),
        ([row("F520", 0.05, 9.95)], ""),
        ([row("F520", 5.8, 4.2)], "Left unused: 5.80 h of 10.0 h in F520"),
        ([row("F520", 5.8, 4.2), row("F520", 5.8, 4.2)], "Left unused: 5.80 h of 10.0 h in F520"),
        (
            [row("F520", 5.8, 4.2), row("F662", 5.8, 4.2), row("F850", 1.0, 9.0), row("F720", 0.0, 10.0)],
            "Left unused: 5.80 h of 10.0 h in F520, F662; 1.00 h of 10.0 h in F850",
        ),
        ([row("F520", 0.1 * n, 10.0 - 0.1 * n) for n in range(2, 9)], "up to 48.0 min of 10.0 h, in 7 programmes"),
    ],
)
def test_unused_time_is_told_from_one_per_cent_on(rows, text):
    assert unused_text(rows).endswith(text)
    assert bool(unused_text(rows)) == bool(text)


def measured(name, **more):
    return band(name, exposure_s=52.5, visits=10, frames_per_visit=28, time_s=9.0 * HOUR, **more)


def test_the_summary_of_a_scene_says_visits_planet_and_what_is_left():
    bands = [measured("F520", chosen_for="b", unused_s=HOUR), measured("F662", chosen_for="c", unused_s=0.0)]
    told = programme_sentences(SimpleNamespace(searches=[], bands=bands))
    assert told == [
        "Programme of highest SNR for b, as cpic etc chooses it: F520 10 visits of 28 × 52.5 s.",
        "Programme of highest SNR for c, as cpic etc chooses it: F662 10 visits of 28 × 52.5 s.",
        "Left unused: 1.00 h of 10.0 h in F520.",
    ]
    given = [measured("F520")]
    assert programme_sentences(SimpleNamespace(searches=[], bands=given)) == []


def test_what_a_table_of_planets_lacks():
    one = lacking_lines({"X b": ["omega_unknown", "period_err_unknown", "columns_not_used"]}, ["argp"])
    assert one == [
        "No argument of periastron: any (omega_unknown).",
        "Taken as exact, because no error is given: the period (period_err_unknown).",
        "Columns of the table that were not used: argp; what is unknown may stand there.",
    ]
    assert lacking_lines({"X b": ["mass_unknown"], "X c": []}, [])[0].startswith("b: neither mass")
    assert lacking_lines({}, []) == []
    assert "and 3 more" in lacking_lines({}, [f"c{n}" for n in range(15)])[0]
