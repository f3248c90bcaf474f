import csv
import io

from cpic_planner.report.measured_table import MEASUREMENT_COLUMNS, measurements_csv


def rows(result):
    return list(csv.DictReader(io.StringIO(measurements_csv(result))))


def test_a_line_for_each_target_and_band(plan):
    table = rows(plan)
    assert [(row["target"], row["band"]) for row in table] == [
        (target.name, band.band) for target in plan.targets for band in target.bands
    ]
    assert tuple(table[0]) == MEASUREMENT_COLUMNS
    assert [row["band"] for row in table if row["chosen"] == "1"] == ["F662", "F662"]
    first, outside = table[0], table[3]
    assert float(first["recovered_snr_error"]) == plan.targets[0].bands[0].recovered_snr_error
    assert first["detected"] == "1"
    assert first["audit_hits"] == ""
    assert table[1]["audit_hits"] == "444"
    assert (outside["status"], outside["recovered_snr"]) == ("outside_field", "")


def test_a_scene_has_its_planets_and_no_choice(confirmation):
    table = rows(confirmation)
    assert len(table) == 5
    assert {row["planet"] for row in table} == {"c", "<script>alert('x')</script>"}
    assert {(row["target"], row["hip"], row["chosen"]) for row in table} == {("a scene", "", "")}
