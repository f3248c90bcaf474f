"""The main job: resumable, the same for any number of workers, and honest."""

import contextlib
import io
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from cpic_planner.cli.main import main
from cpic_planner.confirm import make_plan, plan_job
from cpic_planner.jobs import estimate
from cpic_planner.planets import load_population
from cpic_planner.queries import PlanQuestion
from cpic_planner.ranking import counted_planets
from simulator.config import load_instrument, validate

ARGUMENTS = """
    plan --top 2 --time-s 1000 --band F520 --band F662 --realisations 2 --planets 500
""".split()
# Of the sample these alone let sums of frames stand for frames, which takes a tenth of the time.
STARS = """name,v_mag,sp_type,teff_k,log_g,metallicity,distance_pc,luminosity_lsun,ra_deg,dec_deg
first,3.73,K2V,5080,4.6,-0.1,3.2,0.34,53.2,-9.5
second,3.5,G8V,5283,4.5,-0.5,3.65,0.5,26.0,-15.9
third,4.4,G0V,5950,4.4,0.0,8.7,1.1,88.6,20.3
"""


@pytest.fixture(scope="module")
def stars(tmp_path_factory):
    path = tmp_path_factory.mktemp("stars") / "stars.csv"
    path.write_text(STARS)
    return path


def arguments(stars, out, *more):
    return [*ARGUMENTS, "--catalog", str(stars), "--out", str(out), *more]


def started(stars, out, *more):
    """The command in a process of its own, to be killed."""
    command = [sys.executable, "-m", "cpic_planner.cli.main", *arguments(stars, out, *more)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


@pytest.fixture(scope="module")
def finished(stars, tmp_path_factory):
    out = tmp_path_factory.mktemp("plan") / "whole"
    with contextlib.redirect_stdout(io.StringIO()) as stdout:
        assert main(arguments(stars, out, "--json")) == 0
    return out, stdout.getvalue()


def test_known_planets_stand_instead_of_a_population(refused, tmp_path):
    """Of two hosts, one of a refuted planet and one of its own table, only those are ranked that are counted."""
    stars, own = tmp_path / "stars.csv", tmp_path / "own.csv"
    stars.write_text(STARS.replace("first", "eps Eri").replace("second", "omi2 Eri"))
    own.write_text("star,planet,a,e,mass,star_mass\nthird,third b,3,0,1,1\n")
    asked = {"instrument": load_instrument(), "top": 3, "bands": ("F520",), "time_s": 1000.0, "n_planets": 50}

    def ranked(**known):
        config = PlanQuestion(**asked, **known)
        return int(estimate(plan_job(config, stars))["n_targets"]), config

    counts = {
        source: ranked(known_planets=source, date_utc="2027-01-01")[0]
        for source in ("snapshot", "archive_2019", str(own), f"none+{own}")
    }
    assert list(counts.values()) == [1, 2, 2, 1]
    choice = counted_planets(ranked(known_planets="snapshot", date_utc="2027-01-01")[1])
    assert (choice.mjd, choice.n_draws) == (61406.0, 50)
    both = {"known_planets": "snapshot", "population": load_population()}
    refused("given with known_planets", validate, PlanQuestion, asked | both, where="plan")


def test_products_are_all_there_and_stdout_is_the_plan(finished):
    out, stdout = finished
    assert stdout == (out / "plan.json").read_text()
    for name in ("plan.json", "run.json", "ranking.csv", "ranking.ecsv", "measurements.csv", "report.html"):
        assert (out / name).stat().st_size > 100
    assert (out / "report.html").stat().st_size <= 5e6


def test_each_band_has_prediction_and_measurement(finished):
    plan = json.loads(finished[1])
    assert len(plan["targets"]) == 2
    for target in plan["targets"]:
        assert [band["band"] for band in target["bands"]] == ["F520", "F662"]
        for band in target["bands"]:
            if band["status"] == "ok":
                assert band["realisations"] == 2
                for key in ("predicted_snr", "recovered_snr", "true_contrast", "recovered_contrast", "contrast_error"):
                    assert np.isfinite(band[key])
                # two draws: within five of its own errors, and of unit scatter in SNR
                assert abs(band["recovered_contrast"] - band["true_contrast"]) < 5 * band["contrast_error"]
                assert abs(band["recovered_snr"] - band["predicted_snr"]) < 5 + 0.5 * band["predicted_snr"]
            else:
                assert band["reason"]


def test_plan_holds_no_clock_host_or_path(finished):
    out, text = finished
    run = json.loads((out / "run.json").read_text())
    for word in (str(out), run["started_utc"][:16], run["host"]["python"]):
        assert word not in text


def test_killed_half_way_and_started_again_gives_the_same_bytes(finished, stars, tmp_path):
    """Whole, it ran in one process; here two workers begin with half of the work, and one process goes on."""
    out = tmp_path / "again"
    process = started(stars, out, "--workers", "2")
    deadline = time.monotonic() + 120
    while len(list(out.glob("parts/*.json"))) < 2 and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert len(list(out.glob("parts/*.json"))) >= 2
    assert not (out / "run.json").exists(), "it had finished before the kill"
    assert main(arguments(stars, out)) == 0
    assert (out / "plan.json").read_bytes() == (finished[0] / "plan.json").read_bytes()
    assert (out / "ranking.csv").read_bytes() == (finished[0] / "ranking.csv").read_bytes()
    run = json.loads((out / "run.json").read_text())
    assert run["resumed_parts"] >= 2
    assert run["resumed_parts"] + run["computed_parts"] == 4


def test_another_configuration_needs_force(finished, stars, capsys):
    out = finished[0]
    assert main(arguments(stars, out, "--seed", "2")) == 2
    assert "--force" in capsys.readouterr().err


def test_seed_changes_the_measurement_but_not_the_prediction(finished, stars, tmp_path):
    """Nor does how many targets are confirmed: one here, two before, in the same frames."""
    plan = json.loads(finished[1])
    before = {target["name"]: target for target in plan["targets"]}
    settings = {"bands": ("F520", "F662"), "time_s": 1000.0, "realisations": 2, "n_planets": 500}
    config = PlanQuestion(instrument=load_instrument(), top=1, seed=plan["seed"] + 1, **settings)
    (other,) = make_plan(config, tmp_path / "other", catalog=stars).result.targets
    compared = [
        (band, again)
        for band, again in zip(before[other.name]["bands"], other.bands, strict=True)
        if band["status"] == "ok"
    ]
    assert compared
    for band, again in compared:
        assert (again.predicted_snr, again.n_frames) == (band["predicted_snr"], band["n_frames"])
        assert again.recovered_snr != band["recovered_snr"]


def test_dry_run_estimates_without_working(stars):
    config = PlanQuestion(instrument=load_instrument(), top=3)
    cost = estimate(plan_job(config, stars))
    assert 3 <= cost["n_tasks"] <= 12
    assert cost["wall_s"] > 0


def test_unknown_band_is_refused(refused, tmp_path):
    config = PlanQuestion(instrument=load_instrument(), bands=("F1",))
    refused("F1", make_plan, config, tmp_path / "x")
