"""The tool that tests the law of detection on images: cells, their planets, and the report of both."""

import numpy as np
import pytest
from scipy.stats import norm

from tools.detection_law import cells, report


@pytest.fixture(scope="module")
def measured():
    """One cell of few planets, and what is known of the file that the tool writes."""
    found = cells.measured(1, 1, 3)
    assert found is not None
    return {"1": found, "2": None}


def test_cells_are_the_same_every_time_and_fill_their_ranges():
    every = [cells.Cell.drawn(number) for number in range(300)]
    assert every[7] == cells.Cell.drawn(7)
    assert {cell.band for cell in every} == set(cells.BANDS)
    assert {cell.visits for cell in every} == set(cells.VISITS)
    assert 0.2 < np.mean([cell.companion is not None for cell in every]) < 0.4
    assert all(0.01 <= cell.drift_nm <= 0.5 for cell in every)


def test_planets_stand_in_the_hole_and_are_counted(measured):
    found = measured["1"]
    assert len(found["shown"]) == 3
    x, y, contrast = cells.unpacked(found["planets"])
    assert cells.packed(x, y, contrast) == found["planets"]
    assert ((np.hypot(x, y) > 0.2) & (np.hypot(x, y) < 1.0) & (contrast > 0.0)).all()
    assert found["elements"] > 20.0
    (row,) = report.predicted(measured.values())
    assert (np.array(row["promised"]["found"]) <= row["promised"]["placed"]).all()
    assert ((row["promised"]["found"] >= 0.0) & (row["promised"]["placed"] <= 1.0)).all()


def test_report_adds_up():
    """Hits drawn with the chances that are promised differ from them by what counting makes."""
    rng, rows = np.random.default_rng(3), []
    for number in range(40):
        chance = {mode: rng.random(400) for mode in report.MODES}
        hits = {mode: (rng.random(400) < chance[mode]).astype(float) for mode in report.MODES}
        place = rng.uniform(0.4, 0.9, 400)
        alarms = dict(zip("345", rng.poisson(1e4 * norm.sf([3.0, 4.0, 5.0])), strict=True))
        row = {"cell": cells.Cell.drawn(number), "separation": place, "promised": chance, "alarms": alarms}
        slope = dict.fromkeys(report.MODES, 0.8)
        rows.append(row | hits | {"speckled": rng.random(400), "elements": 1e4, "slope": slope})
    for mode in report.MODES:
        apart, error = report.differences(rows, mode)
        assert np.mean((apart / error) ** 2) == pytest.approx(1.0, abs=0.6)
        assert report.law_error(rows, mode) < 0.02
        worse = [row | {mode: (rng.random(400) < row["promised"][mode] + 0.8 * 0.1).astype(float)} for row in rows]
        assert report.law_error(worse, mode) == pytest.approx(0.1, abs=0.02)
        lines = report.groups(rows, mode)
        assert lines[0][:2] == ["all", "16000"]
        assert sum(int(line[1]) for line in lines if line[0] in cells.BANDS) == 16000
    assert [line[-1] for line in report.alarm_rows(rows)] == ["yes"] * 3
    text = report.text(rows, {"minutes": 1.0, "stacks": 50})
    assert "map.png" in text
    assert all(f"{name}" in text for name in report.MODES.values())


def test_the_map_is_a_picture(measured, tmp_path):
    report.write_map(report.predicted(measured.values()), tmp_path / "map.png")
    assert (tmp_path / "map.png").read_bytes()[:4] == b"\x89PNG"
