import csv
import io

import pytest

from cpic_core import InputError, dump_json
from cpic_planner.jobs import run
from cpic_planner.tradeoff import FILES, read_result, run as module, tradeoff_job
from cpic_planner.tradeoff.measure import measured_rows
from cpic_planner.tradeoff.run import COLUMNS, LOOKS, SMALLEST, pareto_figure, products_of, report_text, speed_ups
from cpic_planner.tradeoff.scenes import GLANCE, SCENES, FixedScene, points_of
from cpic_planner.version import __version__
from simulator.knobs import FIDELITIES, Knobs


def points(case, *names):
    return tuple(point for point in points_of(case) if point.name in names)


@pytest.mark.long
def test_rows_of_every_group(small_case, monkeypatch):
    monkeypatch.setitem(FIDELITIES, "reference", Knobs(wavelength_nodes=3, pixel_nodes=3))  # for speed
    alone = points(small_case, "reference", "etc", "tolerance_0.3")
    rows = [row for point in alone for row in measured_rows(small_case, [point], GLANCE, "here", 0.0)]
    rows += measured_rows(small_case, points(small_case, "wavelengths_1", "no_flat"), GLANCE, "here", 0.0)
    found = {row.point: row for row in rows}
    assert {row.status for row in found.values()} == {"ok"}
    for row in found.values():
        assert row.wall_s > 0
        assert row.peak_memory_mb > 20
        assert row.flux_e == pytest.approx(found["reference"].flux_e, rel=0.02)
        assert row.n_frames == 2
        assert (row.cold_s is None) == (row.point in ("wavelengths_1", "no_flat"))
    assert found["etc"].wall_s < 0.1 * found["reference"].wall_s
    assert [len(found[name].samples["contrast_error"]) for name in ("reference", "wavelengths_1")] == [2, 2]
    assert found["reference"].settings["region"] == "full"
    assert found["reference"].settings["epochs"] == 2
    assert found["tolerance_0.3"].predicted_error["snr"] <= 0.3


def test_a_row_that_does_not_apply_has_a_reason(small_case):
    case = FixedScene.of(small_case, em_gain=1000.0, exposure_s=1e5)
    (row,) = measured_rows(case, points(case, "sums_quick"), GLANCE, "here", 0.0)
    assert (row.status, row.reason) == ("invalid", "not_applicable")
    assert row.message != ""
    assert row.wall_s is None


def test_ways_that_void_every_aperture_are_rows_of_their_own(small_case, monkeypatch):
    """Their frames can be drawn, and show nothing: no error that ends the rows of the other ways."""
    monkeypatch.setitem(FIDELITIES, "reference", Knobs(wavelength_nodes=1, pixel_nodes=1))  # for speed
    case = FixedScene.of(small_case, em_gain=1000.0, exposure_s=1e4)
    rows = measured_rows(case, points(case, "hole_quick"), GLANCE, "here", 0.0)
    rows += measured_rows(case, points(case, "epochs_1", "no_flat"), GLANCE, "here", 0.0)
    assert [row.point for row in rows] == ["hole_quick", "epochs_1", "no_flat"]
    for row in rows:
        assert (row.status, row.reason) == ("invalid", "not_applicable")
        assert "cut off the planet's aperture" in row.message
        assert row.flux_e is None


class Told(list):
    """What progress was told."""

    def __call__(self, text, steps=1, /):
        self.append(text)


def test_only_keeps_the_other_rows(small_case, make):
    common = {"version": __version__, "n_frames": 2, "snr": 5.0, "samples": {"contrast_error": [1e-9, 2e-9]}}
    kept = [
        make.row("reference", group="tier", **common),
        make.row("hole_quick", machine="elsewhere", **common),
        make.row("full_standard", version=__version__, n_frames=3),
    ]
    earlier = make.result(kept, version=__version__, quick_look=True, machine=make.machine("elsewhere"))
    told = Told()
    job = tradeoff_job([(small_case, points(small_case, "etc"))], earlier=earlier, quick_look=True)
    result = run(job, advance=told).result
    assert told == ["faint, etc"]
    rows = {row.point: row for row in result.rows}
    assert set(rows) == {"reference", "hole_quick", "etc"}
    assert rows["etc"].machine == result.machine.key
    assert rows["etc"].cold_s > rows["etc"].wall_s
    assert rows["hole_quick"].machine == "elsewhere"
    assert [item.key for item in result.other_machines] == ["elsewhere"]
    assert rows["hole_quick"].snr_error == pytest.approx(0.0, abs=1e-12)
    assert result.speed_ups == {}  # times of two machines are not compared


def test_broken_off_it_goes_on_and_ended_it_measures_again(small_case, make, monkeypatch, tmp_path):
    asked = []

    def measured(case, points, effort, machine, at_once, progress):
        asked.append([point.name for point in points])
        if len(asked) == 3:
            raise KeyboardInterrupt
        rows = [make.row(point.name, version=__version__, n_frames=case.n_frames, group="knob") for point in points]
        return {"machine": machine.model_dump(), "rows": [row.model_dump() for row in rows]}

    monkeypatch.setattr(module, "measured", measured)
    monkeypatch.setattr(module, "compared", lambda rows: rows)
    names = ["reference", "quick", "wavelengths_1", "no_flat"]
    job = tradeoff_job([(small_case, points(small_case, *names))], quick_look=True)
    with pytest.raises(KeyboardInterrupt):
        run(job, tmp_path)
    together = [["reference"], ["quick"], ["wavelengths_1", "no_flat"]]  # those that share their processes at the end
    assert asked == together
    told = Told()
    done = run(job, tmp_path, advance=told)
    assert asked == [*together, together[2]]
    assert (done.resumed_parts, done.computed_parts) == (2, 1)
    assert told == ["faint, reference (kept)", "faint, quick (kept)"]
    assert [row.point for row in done.result.rows] == names
    assert run(job, tmp_path).computed_parts == 3


def test_refusals(refused, small_case, make):
    work = [(small_case, points(small_case, "etc"))]
    with pytest.raises(InputError, match=r"--only = etc: not accepted; allowed: reference too: faint has none yet"):
        tradeoff_job(work, quick_look=True)
    old = make.result([make.row("reference", group="tier")], version="0.0.1", quick_look=True)
    refused(r"results of version 0.0.1 with --quick-look", tradeoff_job, work, earlier=old, quick_look=True)
    other = make.result([make.row("reference", group="tier")], version=__version__, quick_look=True)
    refused("a new one", tradeoff_job, work, earlier=other)


def test_speed_ups(make):
    rows = [
        make.row("reference", group="tier", wall_s=12.0),
        make.row("etc", group="closed_form", wall_s=0.003),
        make.row("reference", group="tier", wall_s=5.0, scene="edge"),
        make.row("etc", group="closed_form", wall_s=0.001, scene="edge", machine="elsewhere"),
        make.row("etc", group="closed_form", wall_s=0.001, scene="field"),
    ]
    assert speed_ups(rows) == {"faint": pytest.approx(4000.0)}


def errors(*numbers):
    """Errors of flux and SNR, and how well they are known."""
    return dict(zip(("flux_error", "snr_error", "flux_uncertainty", "snr_uncertainty"), numbers, strict=True))


@pytest.fixture
def result(make):
    rows = [
        make.row("reference", group="tier", wall_s=12.0, **errors(0.0, 0.0, 0.0, 0.0)),
        make.row(
            "etc",
            group="closed_form",
            wall_s=2e-3,
            **errors(0.004, -0.02, 1e-9, 0.003),
            predicted_error={"planet_flux": 0.01},
        ),
        make.row("standard", group="tier", wall_s=0.4, **errors(1e-12, 1e-4, 1e-9, 8e-3)),
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
        make.row("wavelengths_1", group="knob", wall_s=3.0, machine="elsewhere", **errors(-1e-3, -2e-3, 1e-9, 1e-4)),
        make.row("reference", group="tier", scene="edge", wall_s=6.0, **errors(0.0, 0.0, 0.0, 0.0)),
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
    measured = {row.group for row in result.rows if row.status == "ok" and row.wall_s and row.snr_error is not None}
    assert 1 < len(measured) < len(LOOKS)  # the legend names what is drawn
    assert words == [*(look[3] for group, look in LOOKS.items() if group in measured), "upper limit", "1, 3 and 5 %"]
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
