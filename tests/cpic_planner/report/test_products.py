import io
from pathlib import Path

import pytest
from rich.console import Console

from cpic_planner.models import CheckResult, FindingRecord, SimulatedSequence, SimulationResult
from cpic_planner.report.numbers import size_text
from cpic_planner.report.products import print_check, print_planned, print_simulation
from cpic_planner.simulation.cost import estimate
from simulator.config.simulation_file import load_simulation


def printed(show, width=110):
    console = Console(file=io.StringIO(), width=width, highlight=False)
    show(console)
    return console.file.getvalue()


def result(count):
    rows = [
        SimulatedSequence(
            obsid=f"4{number:010d}",
            kind="SCI",
            target="a [red] star with a long name",
            camera="VIS",
            band="F520",
            exposure_s=0.01,
            n_frames=50,
            em_gain=20,
            start_utc="2028-01-01T00:00:00",
            role="reference",
            settings={},
            file=f"SCI/{61771 + number}/{number}.fits",
            truth=None,
            params="",
            adu_min=180,
            adu_max=16383,
            saturated_pixels=12345,
            clipped_pixels=0,
            cosmic_rays=77,
            size_bytes=12_300_000,
            sha256="",
        )
        for number in range(count)
    ]
    return SimulationResult(
        version="", config_hash="", name="x", description="", n_frames=1, size_bytes=1, sequences=rows
    )


def test_a_row_says_what_the_frames_hold():
    text = printed(lambda console: print_simulation(result(1), Path("out"), console))
    for word in ("x: 1 sequence", "40000000000", "SCI reference", "a [red] star", "F520", "50 × 0.01", "180–16383"):
        assert word in text
    for word in ("12\u202f345", "77", "12.3 MB", "out/SCI/61771/0.fits"):
        assert word in text


def test_long_runs_are_cut_and_say_so():
    text = printed(lambda console: print_simulation(result(60), Path("out"), console))
    assert "and 20 more: see out/simulation.json" in text
    assert "out/SCI/61771, out/SCI/61772, out/SCI/61773 and 57 more" in text


def test_narrow_terminals_keep_numbers():
    text = printed(lambda console: print_simulation(result(1), Path("out"), console), width=80)
    for word in ("40000000000", "50 × 0.01", "180–16383", "12.3 MB"):
        assert word in text


def test_plan_names_begin_and_cost():
    plan = estimate(load_simulation("calibration_set"))
    text = printed(lambda console: print_planned(plan, console, limit=3))
    for word in ("calibration_set: 15 sequences", "40000000003", "20 × 0", "2028-01-01T00:00:22", "and 12 more"):
        assert word in text
    for word in ("97 frames", "1 worker(s)", "disk"):
        assert word in text


def test_findings_are_grouped_by_file():
    findings = [
        FindingRecord(path="a.fits", hdu=1, keyword="DATASUM", message="is wrong", severity="error"),
        FindingRecord(path="a.fits", hdu=None, keyword="", message="is [red] old", severity="warning"),
        FindingRecord(path="b.fits", hdu=0, keyword="OBSID", message="is that of a.fits too", severity="error"),
    ]
    checked = CheckResult(paths=["."], n_files=2, n_errors=2, n_warnings=1, findings=findings)
    text = printed(lambda console: print_check(checked, console))
    assert text.count("a.fits\n") == 1
    for word in ("DATASUM", "is [red] old", "2 Level-0 files checked: 2 errors, 1 warning"):
        assert word in text


@pytest.mark.parametrize(("size", "text"), [(1500, "1.50 kB"), (2.5e6, "2.50 MB"), (3.21e9, "3.21 GB"), (0, "0 kB")])
def test_sizes(size, text):
    assert size_text(size) == text
