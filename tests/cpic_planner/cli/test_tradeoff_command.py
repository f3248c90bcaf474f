import json

import pytest

from cpic_planner.results import TradeoffResult
from cpic_planner.tradeoff import run
from cpic_planner.tradeoff.scenes import SCENES
from cpic_planner.version import __version__

COMMAND = "tradeoff"


def rows_for(case, points, machine):
    from cpic_planner.results import TradeoffRow

    return [
        TradeoffRow(
            scene=case.name,
            point=point.name,
            title=point.title,
            group=point.group,
            status="ok",
            wall_s=1.0,
            cpu_s=1.0,
            peak_memory_mb=50.0,
            repeats=1,
            flux_e=100.0,
            snr=5.0,
            samples={"contrast_error": [1e-9, 2e-9]},
            n_frames=case.n_frames,
            settings={"draw": "frames", "region": "full"},
            machine=machine,
            version=__version__,
        )
        for point in points
    ]


@pytest.fixture
def unmeasured(monkeypatch):
    """Every row at once, without any image; tells which were asked for."""
    asked = []

    def measured(case, points, effort, machine, at_once, progress):
        asked.extend((case.name, point.name) for point in points)
        rows = rows_for(case, points, machine.key)
        return {"machine": machine.model_dump(), "rows": [row.model_dump() for row in rows]}

    monkeypatch.setattr(run, "measured", measured)
    return asked


def test_files_table_and_json(call, done, tmp_path, unmeasured):
    out = tmp_path / "t"
    text, err = done("--scene", "faint", "--quick-look", "--out", str(out), "--json")
    result = TradeoffResult.model_validate(json.loads(text))
    assert result.quick_look
    assert (out / "results.json").read_text() == text
    assert {"pareto.png", "report.md", "results.csv", "run.json"} < {path.name for path in out.iterdir()}
    assert "written to" in err
    assert ("faint", "no_flat") not in unmeasured
    unmeasured.clear()
    text, _ = done("--scene", "faint", "--quick-look", "--only", "etc", "--out", str(out))
    assert unmeasured == [("faint", "etc")]
    assert "Faint planet (faint, F662)" in text
    assert "reference" in text
    assert len(json.loads((out / "results.json").read_text())["rows"]) == len(result.rows)
    assert call("--only", "etc", "--out", str(out))[0] == 2  # a look and a record do not mix


def test_a_list(call, done):
    text, _ = done("--list", "--scene", "binary", "--json")
    assert json.loads(text)["binary"]["points"]["etc"] == "closed form, one call"
    text, _ = done("--list")
    assert all(f"{case.name}: {case.title}" in text for case in SCENES.values())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--scene", "nebula"], "--scene = nebula: not accepted; allowed: faint, saturating"),
        (["--only", "fast"], "--only = fast: not accepted"),
        (["--scene", "faint", "--only", "etc"], "reference too: faint has none yet"),
        (["--workers", "3"], "--workers"),
    ],
)
def test_refusals(refuses, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    refuses(arguments, [words])


def test_a_foreign_folder_is_left_alone(call, tmp_path):
    (tmp_path / "letter.txt").write_text("dear")
    status, _, err = call("--scene", "faint", "--out", str(tmp_path))
    assert status == 2
    assert "an empty folder or one of an earlier run" in err
    assert [path.name for path in tmp_path.iterdir()] == ["letter.txt"]
