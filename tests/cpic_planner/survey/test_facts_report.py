"""The report of which fact moved which number: states that differ by one fact, played in the same universes."""

import numpy as np
import pytest

from catalogs import load_known_planets
from cpic_planner.survey.store import read_table

UNIVERSES = 30


def row_of(table, planet):
    return list(table.text("planet")).index(planet)


def test_each_state_adds_one_fact(facts_report, tmp_path):
    before, orbit, refuted, now = facts_report.steps(tmp_path)
    assert (before.catalog, before.known_planets) == ("simbad_2012", "archive_2019")
    assert before.catalog == orbit.catalog == refuted.catalog != now.catalog
    assert (now.catalog, now.known_planets) == ("snapshot", refuted.known_planets)
    old, one, new = (load_known_planets(step.known_planets) for step in (before, orbit, refuted))
    periods = [
        {name: table.number("period_days")[row_of(table, name)] for name in old.text("planet")} for table in (old, one)
    ]
    changed = [name for name, value in periods[0].items() if abs(periods[1][name] - value) > 0.0]
    assert changed == ["eps Eri b"]
    eccentricities = [table.number("eccentricity")[row_of(table, "eps Eri b")] for table in (old, one, new)]
    assert eccentricities == pytest.approx([0.70, 0.06, 0.06], abs=0.005)
    counted = [row_of(table, "tau Cet e") in table.rows_of("tau Cet") for table in (old, one, new)]
    assert counted == [True, True, False]


@pytest.fixture(scope="module")
def compared(facts_report, small, tmp_path_factory):
    """Two states that differ by the known planets, and the last one again."""
    folder = tmp_path_factory.mktemp("facts")
    states = [
        facts_report.Step(label, "snapshot", known)
        for label, known in (("old", "archive_2019"), ("new", "snapshot"), ("again", "snapshot"))
    ]
    config = small({"targets": {"names": ["eps Eri"]}}, universe={"universes": UNIVERSES})
    return facts_report.measure(config, states, folder, workers=1), folder


def test_the_counts_are_those_of_the_tables(facts_report, compared):
    found, folder = compared
    for state, known in enumerate(("archive_2019", "snapshot")):
        table = read_table(folder / f"state_{state}" / "detections.parquet").columns
        mine = table["known_row"] == row_of(load_known_planets(known), "eps Eri b")
        (alone,), (planets,) = (facts_report.means(found, key, state) for key in ("planet", "planets"))
        assert alone == pytest.approx(mine.sum() / UNIVERSES)
        assert planets == pytest.approx(len(mine) / UNIVERSES)


def test_changes_are_paired(facts_report, compared):
    found, folder = compared
    row = next(row for row in found["rows"] if row["quantity"] == "planets")
    first, second, third = row["states"]
    assert first["change"] is None
    assert second["change"]["mean"] == pytest.approx(second["value"]["mean"] - first["value"]["mean"])
    sums = [
        np.add(
            *(
                read_table(folder / f"state_{state}" / "universes.parquet").columns[name]
                for name in ("new_planets", "known_planets")
            )
        )
        for state in (0, 1)
    ]
    error = (sums[1] - sums[0]).std(ddof=1) / np.sqrt(UNIVERSES)
    assert second["change"]["error"] == pytest.approx(error)
    assert third["value"] == second["value"]
    assert third["change"]["mean"] == third["change"]["error"] == 0.0


def test_the_tables_say_what_moved(facts_report, compared):
    found, _ = compared
    *values, (title, head, rows) = facts_report.tables(found)
    assert [len(part) for _, _, part in values] == [1, 1, 1]
    assert values[0][1] == ["strategy", "old", "+ new", "+ again"]
    assert "90 %" in title
    assert head == ["strategy", "of", "new", "again"]
    assert [row[-1] for row in rows] == ["none"] * 3
    assert rows[0][2].startswith(("+", "-"))
    words = facts_report.text(found)
    assert f"{UNIVERSES} universes" in words
    ends = [facts_report.means(found, "planets", state)[0] for state in (0, -1)]
    assert f"from {ends[0]:.2f} to {ends[1]:.2f} planets" in words
