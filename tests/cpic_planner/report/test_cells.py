import csv
import io

import pytest

from cpic_planner.report import ranking_csv, ranking_ecsv
from cpic_planner.report.confirm import MEASUREMENT_COLUMNS, measurements_csv
from cpic_planner.report.whatif import targets_csv
from cpic_planner.results import RankedTarget, columns_of


def lines(text):
    return list(csv.DictReader(io.StringIO(text)))


def test_csv_holds_every_row_in_full_precision(rank):
    rows = lines(ranking_csv(rank))
    assert len(rows) == len(rank.targets)
    assert list(rows[0]) == [name for name in RankedTarget.model_fields if name != "own"]
    for row, target in zip(rows, rank.targets, strict=True):
        assert float(row["contrast"]) == target.contrast
        assert row["name"] == target.name
        assert row["flags"] == "|".join(target.flags)
        assert row["hip"] == ("" if target.hip is None else str(target.hip))
    assert rows[-1]["exposure_s"] == ""
    assert "\r" not in ranking_csv(rank)


def test_ecsv_round_trip_with_units_descriptions_and_masks(rank):
    import astropy.units as u
    from astropy.table import Table

    text = ranking_ecsv(rank)
    assert text.startswith("# %ECSV 1.0")
    table = Table.read(text, format="ascii.ecsv")
    assert table.colnames == [name for name in RankedTarget.model_fields if name != "own"]
    units = {name: table[name].unit for name in table.colnames if table[name].unit}
    assert len(units) == 24
    assert (units["visit_time_s"], units["unused_s"], units["required_time_s"]) == (u.s, u.s, u.s)
    assert units["span_days"] == u.day
    assert units["rv_amplitude_m_s"].to_string() == "m / s"
    assert units["v_mag"] == u.mag
    assert units["ref_planet_distance_au"] == u.AU
    assert units["completeness_per_hour"] == 1 / u.h
    assert units["score"] == 1 / u.h
    assert units["luminosity_lsun"] == u.L_sun
    for column in columns_of(RankedTarget):
        assert table[column.name].description == (column.description or None)
    assert table["contrast"].tolist() == [row.contrast for row in rank.targets]
    assert [str(name) for name in table["name"]] == [row.name for row in rank.targets]
    assert table["time_s"].mask.tolist() == [row.time_s is None for row in rank.targets]
    assert table["hip"].mask.tolist() == [row.hip is None for row in rank.targets]
    assert table.meta["time_s"] == rank.time_s
    assert table.meta["reference_planet"]["albedo"] == "jupiter"
    assert table.meta["score_name"] == "completeness_per_hour"
    assert table.meta["population"]["n_planets"] == 4000


@pytest.mark.parametrize("writer", [ranking_csv, ranking_ecsv])
def test_the_same_text_twice_and_a_head_without_rows(rank, writer):
    assert writer(rank) == writer(rank)
    text = writer(rank.model_copy(update={"targets": []}))
    assert text.splitlines()[-1].split(",") == [name for name in RankedTarget.model_fields if name != "own"]


def test_a_measurement_for_each_target_and_band(plan):
    table = lines(measurements_csv(plan))
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
    table = lines(measurements_csv(confirmation))
    assert len(table) == 5
    assert {row["planet"] for row in table} == {"c", "<script>alert('x')</script>"}
    assert {(row["target"], row["hip"], row["chosen"]) for row in table} == {("a scene", "", "")}


def test_every_star_of_every_strategy_has_a_line(compared):
    result = compared()
    rows = lines(targets_csv(result))
    pairs = [(item.name, target) for item in result.strategies for target in item.targets]
    assert [(row["strategy"], row["name"]) for row in rows] == [(name, target.name) for name, target in pairs]
    for row, (_, target) in zip(rows, pairs, strict=True):
        assert float(row["new_planets"]) == target.new_planets
        assert float(row["visit_time_s"]) == target.visit_time_s
        assert row["slots"] == ";".join(map(str, target.slots))
        assert row["bands"] == "F520;F662"
        assert row["known_planets"] == ";".join(target.known_planets)
    assert targets_csv(compared(empty=True)).splitlines() == [",".join(rows[0])]
