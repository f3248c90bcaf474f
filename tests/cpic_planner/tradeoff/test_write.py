import csv
import io

import pytest

from cpic_core import dump_json
from cpic_planner.tradeoff import FILES, read_result
from cpic_planner.tradeoff.run import (
    COLUMNS,
    LOOKS,
    SMALLEST,
    pareto_figure,
    products_of,
    report_text,
)
from cpic_planner.tradeoff.scenes import SCENES


@pytest.fixture
def result(make):
    rows = [
        make.row(
            "reference",
            group="tier",
            wall_s=12.0,
            flux_error=0.0,
            snr_error=0.0,
            flux_uncertainty=0.0,
            snr_uncertainty=0.0,
        ),
        make.row(
            "etc",
            group="closed_form",
            wall_s=2e-3,
            flux_error=0.004,
            snr_error=-0.02,
            flux_uncertainty=1e-9,
            snr_uncertainty=0.003,
            predicted_error={"planet_flux": 0.01},
        ),
        make.row(
            "standard",
            group="tier",
            wall_s=0.4,
            flux_error=1e-12,
            snr_error=1e-4,
            flux_uncertainty=1e-9,
            snr_uncertainty=8e-3,
        ),
        make.row(
            "quick",
            group="tier",
            status="invalid",
            reason="tier_too_coarse",
            message="quick misses it",
            wall_s=None,
            cpu_s=None,
            peak_memory_mb=None,
            flux_e=None,
        ),
        make.row(
            "wavelengths_1",
            group="knob",
            wall_s=3.0,
            machine="elsewhere",
            flux_error=-1e-3,
            snr_error=-2e-3,
            flux_uncertainty=1e-9,
            snr_uncertainty=1e-4,
        ),
        make.row(
            "reference",
            group="tier",
            scene="edge",
            wall_s=6.0,
            flux_error=0.0,
            snr_error=0.0,
            flux_uncertainty=0.0,
            snr_uncertainty=0.0,
        ),
    ]
    return make.result(rows, speed_ups={"faint": 6000.0}, other_machines=[make.machine("elsewhere")])


def test_files_come_back_as_they_were(result, tmp_path):
    (tmp_path / "results.json").write_text(dump_json(result.model_dump(mode="json")))
    assert read_result(tmp_path) == result
    files = products_of(result, head="measured today")
    assert tuple(files) == FILES
    lines = list(csv.DictReader(io.StringIO(files["results.csv"].decode())))
    assert tuple(lines[0]) == COLUMNS
    assert [(line["scene"], line["point"]) for line in lines] == [(row.scene, row.point) for row in result.rows]
    assert float(lines[1]["snr_error"]) == -0.02
    assert float(lines[1]["predicted_flux_error"]) == 0.01
    assert lines[3]["wall_s"] == ""
    assert lines[3]["message"] == "quick misses it"
    assert files["pareto.png"].startswith(b"\x89PNG")
    assert "measured today" in files["report.md"].decode()


def test_the_report_says_what_was_found(result):
    text = report_text(result)
    assert "- faint: 6000 times" in text
    assert "| etc | 2 ms | 900 ms |  | 100 | +0.4 % | -2 ± 0.3 % |" in text
    assert "| quick | invalid: tier too coarse |" in text
    assert "wavelengths 1 (another machine)" in text
    assert "< 0.8 %" in text  # of the standard tier: below what can be told
    assert "## Tiers over `faint`, `edge`\n" in text  # two of the fixed scenes
    every = [result.scenes[0].model_copy(update={"name": name}) for name in ["faint", "edge", *SCENES]][: len(SCENES)]
    assert "## Tiers over all scenes\n" in report_text(result.model_copy(update={"scenes": every}))
    assert "Few frames" not in text
    assert "Few frames" in report_text(result.model_copy(update={"quick_look": True}))


def table(result, first):
    """The lines of the table of the report whose heading begins so."""
    return report_text(result)[report_text(result).index(f"| {first} |") :].split("\n\n")[0].splitlines()


def test_the_table_of_tiers(result):
    lines = table(result, "tier")
    assert lines[2].startswith("| closed form | 2 ms to 2 ms | 100 | +0.4 % (faint) | -2 ± 0.3 % (faint) | 1 of 1 |")
    assert lines[4].startswith("| `reference` | 6 s to 12 s | 100 | 0 | 0 | 2 of 2 |")
    assert len(lines) == 5  # no scene has a quick answer


def test_the_table_of_programmes(result, make):
    """A programme has its line, is no scene of the tiers, and has no panel of its own."""
    scene = result.scenes[0]
    about = {"name": "four", "visits": 4, "reference_visits": 16, "n_modes": 3, "is_programme": True}
    drawn = {"scene": "four", "flux_error": 0.0, "snr_error": 0.0}
    rows = [
        make.row("reference", group="tier", cpu_s=0.5, snr=11.0, **drawn),
        make.row("etc", group="closed_form", cpu_s=2e-3, **drawn | {"snr_error": 0.02, "snr_uncertainty": 0.01}),
    ]
    update = {"scenes": [*result.scenes, scene.model_copy(update=about)], "rows": [*result.rows, *rows]}
    with_programme = result.model_copy(update=update)
    line = table(with_programme, "visits")[2]
    assert line == "| 4 | 16 | 3 | same star planet free | 11.00 | 0 | +2 ± 1 % | 2 ms | 500 ms |  |"
    assert "reference frames in 16 visits" in report_text(with_programme)
    assert "Programmes of visits" not in report_text(result)
    assert table(with_programme, "tier") == table(result, "tier")
    assert len([axes for axes in pareto_figure(with_programme).axes if axes.axison]) == len(result.scenes)


def test_the_figure_has_its_labels(result):
    figure = pareto_figure(result)
    panels = [axes for axes in figure.axes if axes.axison]
    assert [axes.get_title() for axes in panels] == ["Faint planet", "Planet at the edge of the mask"]
    assert figure._supxlabel.get_text() == "wall clock of one observation (s)"
    assert "error" in figure._supylabel.get_text()
    assert {axes.get_xscale() for axes in panels} == {axes.get_yscale() for axes in panels} == {"log"}
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert words == [*(look[3] for look in LOOKS.values()), "upper limit", "1, 3 and 5 %"]
    assert len({look[1] for look in LOOKS.values()}) == len({look[2] for look in LOOKS.values()}) == len(LOOKS)
    named = {text.get_text() for text in panels[0].texts}
    assert {"reference", "closed form", "standard"} <= named
    drawn = {
        (line.get_xdata()[0], line.get_ydata()[0]): line.get_marker()
        for line in panels[0].lines
        if len(line.get_xdata()) == 1
    }
    assert drawn[12.0, SMALLEST] == "v"
    assert drawn[0.4, 8e-3] == "v"
    assert drawn[2e-3, 0.02] == "*"


def test_foreign_files_are_refused(refused, tmp_path):
    assert read_result(tmp_path) is None
    (tmp_path / "results.json").write_text('{"kind": "plan"}')
    refused("something else", read_result, tmp_path)
