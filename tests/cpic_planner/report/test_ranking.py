"""What becomes of a ranking under an ensemble of instruments, on the terminal."""

import io

import pytest
from rich.console import Console

from cpic_planner.report import print_blocks, rank_blocks
from cpic_planner.report.document import row_columns
from cpic_planner.results import EnsembleBar, EnsembleRecord, RankedTarget

BAR = EnsembleBar(
    key="wavefront.drift",
    label="wavefront drift",
    low="x0.12",
    high="x3.33",
    planets_low=0.36,
    planets_high=0.062,
    n_reachable_low=49,
    n_reachable_high=8,
    tau_low=0.71,
    tau_high=None,
    source="",
)
NUMBERS = ("planets_nominal", "planets_p05", "planets_median", "planets_p95")
COUNTS = ("n_instruments", "seed", "n_stars", *(f"n_reachable_{name}" for name in ("nominal", "p05", "median", "p95")))


@pytest.fixture
def printed(rank):
    record = EnsembleRecord(
        name="default",
        bars=[BAR],
        decides=BAR.key,
        decides_order=BAR.key,
        statement="A statement.",
        **dict.fromkeys(NUMBERS, 0.2),
        **dict.fromkeys(COUNTS, 20),
    )
    drawn = {"p_reachable": 0.8, "rank_median": 3, "rank_p05": 2, "rank_p95": 5, "p_rank_le_10": 1.0, "tier": 1}
    rows = [row.model_copy(update=drawn | {"detection_time_s": 690.0}) for row in rank.targets[:3]]

    def shown(width):
        stream = io.StringIO()
        ranking = rank.model_copy(update={"targets": rows, "ensemble": record})
        print_blocks(rank_blocks(ranking), Console(file=stream, width=width, highlight=False))
        return stream.getvalue()

    return shown


@pytest.mark.parametrize("width", [100, 110, 160])
def test_headings_stand_alone_and_say_what_the_cells_are(printed, width):
    """No heading is a bare low or high, none has a unit that its cells do not have, and no two are the same."""
    lines = printed(width).splitlines()
    stars, bars = (
        next(line for line in lines if line.split()[:2] == first) for first in (["#", "star"], ["number", "values,"])
    )
    for line in (stars, bars):
        headings = [heading for heading in line.split("  ") if heading.strip()]
        named = [heading.strip() for heading in headings]
        assert len(named) == len(set(named))
        assert not {"low", "high"} & set(named)
    assert "detection time s" not in stars
    assert "values, 5 to 95 %" in bars


def test_both_ends_of_a_number_stand_in_one_cell(printed):
    text = printed(160)
    for cell in ("x0.12 to x3.33", "0.36 to 0.062", "49 to 8", "11.5 min"):
        assert cell in text


def test_a_time_with_its_unit_in_the_cell_has_none_in_the_heading():
    """Of every column that is written as 11.5 min, whatever its table."""
    headings = {column.heading for column in row_columns(RankedTarget, "detection_time_s completeness_time_s")}
    assert headings == {"detection time", "completeness time"}
