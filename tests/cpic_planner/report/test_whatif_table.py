import csv
import io

from cpic_planner.report.whatif_table import TARGET_COLUMNS, targets_csv


def test_every_star_of_every_strategy_has_a_line(compared):
    result = compared()
    rows = list(csv.DictReader(io.StringIO(targets_csv(result))))
    pairs = [(item.name, target) for item in result.strategies for target in item.targets]
    assert [(row["strategy"], row["name"]) for row in rows] == [(name, target.name) for name, target in pairs]
    for row, (_, target) in zip(rows, pairs, strict=True):
        assert float(row["new_planets"]) == target.new_planets
        assert float(row["visit_time_s"]) == target.visit_time_s
        assert row["slots"] == ";".join(map(str, target.slots))
        assert row["bands"] == "F520;F662"
        assert row["known_planets"] == ";".join(target.known_planets)


def test_without_stars_there_is_the_head_alone(compared):
    assert targets_csv(compared(empty=True)) == ",".join(TARGET_COLUMNS) + "\n"
