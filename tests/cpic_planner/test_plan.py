"""The main job: resumable, the same for any number of workers, and honest."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from catalogs.errors import InputError
from cpic_planner.plan import PlanConfig, estimate_cost, make_plan
from simulator.config import load_instrument

ARGUMENTS = ["plan", "--top", "2", "--time-s", "1000", "--fidelity", "quick", "--band", "F520", "--band", "F662"]


def command(out, *more):
    return [sys.executable, "-m", "cpic_planner.cli.main", *ARGUMENTS, "--out", str(out), *more]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("plan") / "whole"
    done = subprocess.run(command(out, "--json"), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return out, done.stdout


def test_products_are_all_there_and_stdout_is_the_plan(finished):
    out, stdout = finished
    assert stdout == (out / "plan.json").read_text()
    for name in ("plan.json", "run.json", "ranking.csv", "ranking.ecsv", "report.html"):
        assert (out / name).stat().st_size > 100
    assert (out / "report.html").stat().st_size <= 5e6


def test_each_band_has_prediction_and_measurement(finished):
    plan = json.loads(finished[1])
    assert len(plan["targets"]) == 2
    for target in plan["targets"]:
        assert [band["band"] for band in target["bands"]] == ["F520", "F662"]
        for band in target["bands"]:
            if band["status"] == "ok":
                for key in ("predicted_snr", "recovered_snr", "true_contrast", "recovered_contrast", "contrast_error"):
                    assert np.isfinite(band[key])
                # one draw: within five of its own errors, and of unit scatter in SNR
                assert abs(band["recovered_contrast"] - band["true_contrast"]) < 5 * band["contrast_error"]
                assert abs(band["recovered_snr"] - band["predicted_snr"]) < 5 + 0.5 * band["predicted_snr"]
            else:
                assert band["reason"]


def test_plan_holds_no_clock_host_or_path(finished):
    out, text = finished
    run = json.loads((out / "run.json").read_text())
    for word in (str(out), run["started_utc"][:16], run["host"]["python"]):
        assert word not in text


@pytest.mark.parametrize("workers", ["1", "2"])
def test_killed_half_way_and_started_again_gives_the_same_bytes(finished, tmp_path, workers):
    out = tmp_path / "again"
    process = subprocess.Popen(command(out, "--workers", workers), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 120
    while not list(out.glob("parts/*.json")) and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert list(out.glob("parts/*.json"))
    assert not (out / "run.json").exists(), "it had finished before the kill"
    done = subprocess.run(command(out, "--workers", workers), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (out / "plan.json").read_bytes() == (finished[0] / "plan.json").read_bytes()
    assert (out / "ranking.csv").read_bytes() == (finished[0] / "ranking.csv").read_bytes()
    run = json.loads((out / "run.json").read_text())
    assert run["resumed_parts"] >= 1
    assert run["resumed_parts"] + run["computed_parts"] >= 3


def test_second_run_on_a_live_folder_is_refused(tmp_path):
    out = tmp_path / "live"
    process = subprocess.Popen(command(out), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        deadline = time.monotonic() + 60
        while not (out / "manifest.json").exists() and time.monotonic() < deadline:
            time.sleep(0.02)
        second = subprocess.run(command(out), capture_output=True, text=True, check=False)
        assert second.returncode == 2
        assert f"in use by pid {process.pid}" in second.stderr
    finally:
        process.kill()
        process.wait()


def test_another_configuration_needs_force(finished):
    out = finished[0]
    other = subprocess.run(command(out, "--seed", "2"), capture_output=True, text=True, check=False)
    assert other.returncode == 2
    assert "--force" in other.stderr


def test_seed_changes_the_measurement_but_not_the_prediction(tmp_path):
    config = PlanConfig(instrument=load_instrument(), top=1, bands=("F520",), time_s=2000.0, fidelity="quick", seed=1)
    first = make_plan(config, tmp_path / "a").plan.targets[0].bands[0]
    second = make_plan(config.model_copy(update={"seed": 2}), tmp_path / "b").plan.targets[0].bands[0]
    assert first.predicted_snr == second.predicted_snr
    assert first.recovered_snr != second.recovered_snr


def test_dry_run_estimates_without_working(tmp_path):
    config = PlanConfig(instrument=load_instrument(), top=3)
    cost = estimate_cost(config)
    assert 3 <= cost["n_tasks"] <= 12
    assert cost["wall_s"] > 0


def test_unknown_band_is_refused(tmp_path):
    config = PlanConfig(instrument=load_instrument(), bands=("F1",))
    with pytest.raises(InputError, match="F1"):
        make_plan(config, tmp_path / "x")
