"""The main job: resumable, the same for any number of workers, and honest."""

import contextlib
import csv
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from astropy.table import Table

import cpic_planner.confirm.plan as module
from cpic_planner.cli.main import main
from cpic_planner.confirm import make_plan, plan_job
from cpic_planner.confirm.plan import prepare_plan
from cpic_planner.jobs import check_tree, estimate, run
from cpic_planner.planets import load_population
from cpic_planner.queries import PlanQuestion
from cpic_planner.ranking import counted_planets
from cpic_planner.results import PlannedVisitRow, PlanResult
from cpic_planner.survey import load_strategies, run_whatif, with_universe
from simulator.config import load_instrument, validate

ARGUMENTS = """
    plan --top 2 --time-s 1000 --band F520 --band F662 --realisations 2 --planets 100 --fidelity quick
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


def test_filters_choose_the_stars_that_are_proposed(stars):
    """The first of those that pass, by the numbers of the whole ranking; the stars decide the hash, not the words."""
    asked = {"top": 2, "bands": ["F520"], "time_s": 1000.0, "n_planets": 50}

    def prepared(**filters):
        question = PlanQuestion.of(asked | filters)
        return prepare_plan(question, stars), plan_job(question, stars).digest

    (every, whole), (some, one), (_, other) = prepared(), prepared(sp_type="G"), prepared(stars=["second", "third"])
    ranks = {row.name: row for row in every.rank.targets}
    assert [row.name for row in some.chosen] == [row.name for row in every.rank.targets if row.sp_type[0] == "G"]
    for row in some.chosen:
        assert row.model_copy(update={"rank": row.rank_in_catalogue}) == ranks[row.name]
    assert some.targets.name.tolist() == ["second", "third"]
    assert whole != one == other


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


def test_page_one_stands_in_plan_json_and_in_the_tables(finished):
    """Telescope time holds slews of every visit and hidden parts of orbits; ranks are those of sensitivity.json."""
    out, text = finished
    plan, firm = json.loads(text), json.loads((out / "sensitivity.json").read_text())
    assert firm["first"] == 2
    ranks = {star["name"]: star for star in firm["stars"]}
    table = (out / "measurements.csv").read_text()
    measured = {(row["target"], row["band"]): row for row in csv.DictReader(io.StringIO(table))}
    for target in plan["targets"]:
        star = ranks[target["name"]]
        assert (target["rank_lowest"], target["rank_highest"]) == (star["rank_lowest"], star["rank_highest"])
        assert star["rank_lowest"] <= target["ranked"]["rank"] <= star["rank_highest"]
        assert (target["detection_telescope_h"] is None) == (target["ranked"]["detection_time_s"] is None)
        for band in (band for band in target["bands"] if band["status"] == "ok"):
            assert band["telescope_h"] > band["time_s"] / 3600.0 / 0.65 + 2 * band["visits"] * 5500.0 / 3600.0
            assert float(measured[target["name"], band["band"]]["telescope_h"]) == pytest.approx(band["telescope_h"])


def test_contrast_curves_are_those_of_every_target_and_band_with_images(finished):
    out, text = finished
    table = Table.read(out / "export" / "contrast_curve.ecsv", format="ascii.ecsv")
    bands = [(target["name"], band) for target in json.loads(text)["targets"] for band in target["bands"]]
    imaged = {(name, band["band"]): band for name, band in bands if band["status"] == "ok"}
    assert {(row["target"], row["band"]) for row in table} == set(imaged)
    for (name, band), measured in imaged.items():
        own = table[(table["target"] == name) & (table["band"] == band)]
        there = np.interp(measured["separation_arcsec"], own["separation_arcsec"], own["contrast_limit"])
        # Another quadrant of the same ring: the scatter of some twenty sums is known to 16 %.
        assert there == pytest.approx(measured["observations"][0]["contrast_limit"], rel=0.5)


def test_plan_holds_no_clock_host_or_path(finished):
    out, text = finished
    run = json.loads((out / "run.json").read_text())
    for word in (str(out), run["started_utc"][:16], run["host"]["python"]):
        assert word not in text


@pytest.fixture
def no_page(monkeypatch):
    """Leave the page with its figures empty."""
    monkeypatch.setattr("cpic_planner.report.files.page_html", lambda document: "")
    monkeypatch.setattr("cpic_planner.report.plan.plan_figures", lambda *given, **more: {})
    monkeypatch.setattr("cpic_planner.report.plan.panel_pictures", lambda *given: {})


@pytest.mark.long
def test_killed_half_way_and_started_again_gives_the_same_bytes(finished, stars, tmp_path, no_page):
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


def test_fewer_and_more_targets_go_on_in_the_same_folder(finished, stars, tmp_path, no_page):
    """One target of two makes no image; a second one makes its own alone, and the plan is that of a run of two."""
    whole, out = finished[0], tmp_path / "plan"
    shutil.copytree(whole, out)

    given = arguments(stars, out)
    at = given.index("--top") + 1

    def again(top):
        assert main([*given[:at], str(top), *given[at + 1 :]]) == 0
        assert check_tree(out) == []
        plan, record = (json.loads((out / name).read_text()) for name in ("plan.json", "run.json"))
        assert record["config_hash"] == plan["config_hash"]
        return plan, (record["resumed_parts"], record["computed_parts"])

    plan, parts = again(1)
    both = json.loads(finished[1])
    assert parts == (2, 0)
    assert [target["bands"] for target in plan["targets"]] == [both["targets"][0]["bands"]]
    assert plan["config_hash"] != both["config_hash"]
    for path in out.glob(f"parts/{both['targets'][1]['name'].replace(' ', '_')}*"):
        path.unlink()
    _, parts = again(2)
    assert parts == (2, 2)
    for name in ("plan.json", "measurements.csv", "ranking.csv", "sensitivity.json"):
        assert (out / name).read_bytes() == (whole / name).read_bytes()
    assert main([*given, "--days", "20"]) == 2  # other days may have other stars


@pytest.mark.long
def test_seed_changes_the_measurement_but_not_the_prediction(finished, stars, tmp_path, no_page):
    """Nor does how many targets are confirmed: one here, two before, in the same frames."""
    plan = json.loads(finished[1])
    before = {target["name"]: target for target in plan["targets"]}
    settings = {"bands": ("F520", "F662"), "time_s": 1000.0, "realisations": 2, "n_planets": 100, "fidelity": "quick"}
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


QUICK = {"bands": ("F520",), "time_s": 1000.0, "realisations": 1, "n_planets": 200}


def planned(stars, **asked):
    return module.prepare_plan(PlanQuestion(instrument=load_instrument(), **asked), stars)


def test_a_star_that_is_not_seen_in_the_period_is_not_proposed(stars, tmp_path, monkeypatch):
    """The Sun stands at 281.6, -23.0 deg on 2 January 2028, and a quarter of the sky away from there in April."""
    monkeypatch.setattr(module.scene, "plan_tasks", lambda *given, **more: ([], {}))  # no images are asked for
    path = tmp_path / "sun.csv"
    path.write_text(STARS.replace("53.2,-9.5", "281.6,-23.0") + "blind,3.6,K2V,5080,4.6,-0.1,3.4,0.34,,\n")
    winter, year, april = (
        planned(path, **QUICK, top=2, **period)
        for period in ({"n_days": 3}, {}, {"n_days": 3, "date_utc": "2028-04-02"})
    )
    assert [row.name for row in year.chosen] == [row.name for row in april.chosen] == ["first", "blind"]
    assert (year.period.start_utc, year.period.n_days, year.period.left_out) == ("2028-01-01T00:00:00", 365, [])
    assert year.period.not_checked == ["blind"]  # a table of one's own without coordinates
    for plan in (year, april):  # who is seen is told with its seasons
        assert [row.name for row in plan.period.seen] == ["first"]
        for row in plan.period.seen:
            days = sum(season.days for season in row.seasons)
            assert 0 < row.usable_h < 24.0 * days <= 24.0 * plan.period.n_days
    assert april.period.start_utc == "2028-04-02T00:00:00"
    (left,) = winter.period.left_out
    assert (left.name, left.rank, left.limited_by, left.usable_h) == ("first", 1, "visibility", 0.0)
    assert left.message == "not seen in 3 d: too near to the Sun for 3 d"
    assert [row.name for row in winter.chosen] == ["blind", "second"]
    # Who sees it for too short: a day has 24 h, and the Earth hides a star for half of them.
    short = planned(stars, **(QUICK | {"time_s": 86000.0}), top=3, n_days=1)
    seen = [row for row in short.period.left_out if row.usable_h > 0.0]
    for row in seen:
        assert 6.0 < row.usable_h < row.needed_h <= 86000.0 / 3600.0
        assert f"seen for {row.usable_h:.1f} h in 1 d, and its observation takes" in row.message
    assert seen
    tight = tmp_path / "tight.yaml"
    tight.write_text("sun_deg: 170\n")
    assert len(planned(stars, **QUICK, limits=str(tight)).period.left_out) == 3


SCHEDULE = "star,band,exposure_s,frames_per_visit,em_gain,roll_deg,reserve,"
SCHEDULE += """reference_library,window_start_mjd,window_end_mjd
first,F520,10,20,300,30,no,,61800,61810
first,F520,10,20,300,80,no,,61830,61840
first,F520,11,20,300,80,no,,61830,61840
first,Y,10,20,300,80,no,,61830,61840
Vulcan,F520,10,20,300,80,no,,61830,61840
third,F520,10,20,300,,yes,,,
third,F520,10,20,300,,no,archive,,
second,F662,12,15,200,,,,,
third,F520,10,5000,300,,,,,
"""


def test_visits_of_a_schedule_are_programmes_of_their_own_frames(stars, tmp_path, refused):
    path = tmp_path / "visits.csv"
    path.write_text(SCHEDULE)
    ready = planned(stars, schedule=str(path), realisations=1, n_planets=200)
    one, two = ready.tasks
    assert (one.name, one.band, one.exposure_s, one.n_frames, one.em_gain) == ("first", "F520", 10.0, 20, 300.0)
    assert (two.name, two.band, two.exposure_s, two.n_frames, two.em_gain) == ("second", "F662", 12.0, 15, 200.0)
    assert (one.visits, one.reference_visits, two.visits) == (2, 2, 1)
    assert one.gap_s == pytest.approx(30.0 * 86400.0, rel=1e-3)  # from window to window
    assert ready.rolls_deg == {"first": 30.0, "second": 0.0}
    assert ready.model.bands == ("F520", "F662")
    made = ready.schedule
    assert (made.n_visits, made.n_imaged, made.n_stars) == (9, 3, 2)
    said = {row.row: row.message for row in made.not_imaged}
    assert list(said) == [3, 4, 5, 6, 7, 9]
    for row, words in zip(
        said, ("those of row 1", "F520, F662", "no star", "a reserve visit", "give --library", "4000"), strict=True
    ):
        assert words in said[row]
    assert planned(stars, schedule=str(path), top=1, realisations=1, n_planets=200).schedule.n_imaged == 2
    asked = {"instrument": load_instrument(), "schedule": str(path)}
    for more in ({"time_s": 60.0}, {"bands": ("F520",)}, {"n_days": 3}):
        refused("schedule = given with", validate, PlanQuestion, asked | more, where="plan")
    refused("schedule_strategy", PlanQuestion.of, {"schedule_strategy": "x"})
    path.write_text(SCHEDULE.splitlines()[0] + "\nVulcan,F520,10,20,300,,,,,\n")
    refused("row 1: no star of the catalogue", planned, stars, schedule=str(path))
    path.write_text(SCHEDULE.splitlines()[0] + "\nfirst,Y,10,20,300,,,,,\n")
    refused("visits in F520", planned, stars, schedule=str(path))


STRATEGIES = """kind: strategies
universe: {duration_days: 300, slot_days: 60, universes: 20, known_planets: "off"}
defaults: {time_budget_h: 60, visit: {bands: [F520], time_s: 2000}, scheduler: {reserve: 0}}
strategies: [{name: once}, {name: twice, revisits: {max_visits: 2}}]
"""


def test_plan_visits_log_and_survey_close_by_files_alone(stars, tmp_path, capsys, refused):
    """A survey plans, images confirm its visits, an observer fills in what happened, and the rest is planned anew."""
    strategies, survey, log = tmp_path / "two.yaml", tmp_path / "survey", tmp_path / "log.csv"
    strategies.write_text(STRATEGIES)

    def whatif(out, observed=""):
        config = with_universe(load_strategies(strategies), {"catalog": str(stars), "observed": str(observed)})
        return run_whatif(config, out, pages=False).result

    before = whatif(survey)
    with (survey / "visits.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    mine = [row for row in rows if row["strategy"] == "twice"]
    assert {row["strategy"] for row in rows} == {"once", "twice"}
    assert len(mine) == before.strategies[1].schedule.visits >= 3

    # Which of the two strategies is meant has to be said.
    assert main(["plan", "--schedule", str(survey / "visits.csv"), "--catalog", str(stars)]) == 2
    assert "it has those of once, twice: choose one with --strategy" in capsys.readouterr().err
    asked = {"schedule": survey / "visits.csv", "schedule_strategy": "twice", "top": 1, "fidelity": "quick"}
    config = PlanQuestion.of(asked | {"realisations": 1, "n_planets": 200})
    run(replace(plan_job(config, stars), write=lambda folder, result, bodies: None), tmp_path / "plan")
    plan = PlanResult.model_validate_json((tmp_path / "plan/plan.json").read_text())
    (target,) = plan.targets
    own = [row for row in mine if row["star"] == target.name]
    (band,) = target.bands
    assert (band.visits, band.exposure_s, band.frames_per_visit) == (
        len(own),
        float(own[0]["exposure_s"]),
        int(own[0]["frames_per_visit"]),
    )
    assert band.recovered_snr is not None
    assert plan.schedule.n_stars > 1

    # The first visit shows nothing and takes two hours more; the second is lost.
    first, second = mine[:2]
    hours = float(first["telescope_h"]) + 2.0, float(second["telescope_h"])
    first |= {"start_utc": first["window_start_utc"], "outcome": "not_detected", "telescope_h": str(hours[0])}
    second |= {"start_utc": second["window_start_utc"], "outcome": "lost"}
    with log.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(PlannedVisitRow.model_fields))
        writer.writeheader()
        writer.writerows(rows)
    after = whatif(tmp_path / "rest", log)
    assert after.observed.startswith(f"2 visits, 1 of them lost, {sum(hours):g} h, 0 planets (log.csv ")
    with (tmp_path / "rest/visits.csv").open(encoding="utf-8") as file:
        rest = [row for row in csv.DictReader(file) if row["strategy"] == "twice"]
    assert rest
    assert min(row["window_start_utc"] for row in rest) >= second["start_utc"]
    # What was seen counts as a visit of its star; what was lost does not.
    visits = [row["star"] for row in rest]
    assert visits.count(first["star"]) <= 1
    assert after.strategies[1].schedule.hours <= 60.0 - sum(hours)
    # A new table says of itself that nothing is observed.
    refused("at least one line with start_utc and outcome", whatif, tmp_path / "x", tmp_path / "rest/visits.csv")
