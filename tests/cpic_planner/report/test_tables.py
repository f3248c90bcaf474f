import csv
import io

import pytest

from cpic_planner.models import RankedTarget
from cpic_planner.report.tables import COLUMN_UNITS, ranking_csv, ranking_ecsv


def test_every_column_has_a_unit_entry():
    assert list(COLUMN_UNITS) == list(RankedTarget.model_fields)


def test_units_agree_with_the_suffixes_of_the_names():
    suffixes = {
        "_arcsec": "arcsec",
        "_pc": "pc",
        "_s": "s",
        "_au": "AU",
        "_lsun": "solLum",
        "_mag": "mag",
        "_deg": "deg",
        "_per_hour": "1/h",
    }
    for name, unit in COLUMN_UNITS.items():
        expected = next((value for suffix, value in suffixes.items() if name.endswith(suffix)), "")
        assert unit == expected, name


def test_csv_holds_every_row_in_full_precision(rank):
    rows = list(csv.DictReader(io.StringIO(ranking_csv(rank))))
    assert len(rows) == len(rank.targets)
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
    assert table.colnames == list(COLUMN_UNITS)
    for name, unit in COLUMN_UNITS.items():
        assert (table[name].unit or u.dimensionless_unscaled) == u.Unit(unit), name
        assert table[name].description == RankedTarget.model_fields[name].description
    assert table["contrast"].tolist() == [row.contrast for row in rank.targets]
    assert [str(name) for name in table["name"]] == [row.name for row in rank.targets]
    assert table["time_s"].mask.tolist() == [row.time_s is None for row in rank.targets]
    assert table["hip"].mask.tolist() == [row.hip is None for row in rank.targets]
    assert table.meta["wall_time_s"] == rank.time_s
    assert table.meta["reference_planet"]["albedo"] == "jupiter"
    assert table.meta["score_name"] == "completeness_per_hour"
    assert table.meta["population"]["n_planets"] == 4000
    assert table["detection_time_s"].mask.tolist() == [row.detection_time_s is None for row in rank.targets]


@pytest.mark.parametrize("writer", [ranking_csv, ranking_ecsv])
def test_same_text_twice(rank, writer):
    assert writer(rank) == writer(rank)


@pytest.mark.parametrize("writer", [ranking_csv, ranking_ecsv])
def test_empty_ranking(rank, writer):
    text = writer(rank.model_copy(update={"targets": []}))
    assert text.splitlines()[-1].split(",") == list(COLUMN_UNITS)
