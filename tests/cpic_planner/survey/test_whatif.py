"""Strategies compared from end to end: the same result for any number of workers, and after any break."""

import hashlib
import json
import shutil
from dataclasses import replace
from types import SimpleNamespace
from typing import get_args

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from scipy.stats import chi2, poisson

import cpic_planner.survey.whatif as module
from cpic_planner.results import DifferenceRecord, WhatIfResult
from cpic_planner.survey import run_whatif, varied
from cpic_planner.survey.observed import read_log
from cpic_planner.survey.prepare import read_ground
from cpic_planner.survey.simulate import simulate_survey
from cpic_planner.survey.universe import BLOCK
from cpic_planner.survey.whatif import (
    REALISATIONS,
    _poisson_interval,
    decided_by,
    image_sample,
    image_task,
    sampled_detections,
    whatif_cost,
)
from simulator import load_scene
from simulator.config import content_hash

PRODUCTS = ("universes.parquet", "detections.parquet", "stars.parquet", "whatif.json", "report.html", "targets.csv")
PRODUCTS += ("orbits.parquet", "visits.csv", "visits.ecsv", "visits.json")
STRATEGIES = (
    {"name": "plain"},
    {"name": "twin"},
    {"name": "shy", "visit": {"time_s": 3000}, "targets": {"names": ["eps Eri"]}},
)
UNIVERSE = {"universes": BLOCK + 30}


class Told(list):
    """What progress was told."""

    steps = 0

    def __call__(self, text, steps=1, /):
        self.append(text)
        self.steps += steps


def digest_of(config, ground, n_images=0):
    return content_hash(decided_by(config, ground, n_images))


def digests(folder):
    return {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in PRODUCTS}


@pytest.fixture(scope="module")
def run(small, tmp_path_factory):
    """An undisturbed run in this process."""
    folder = tmp_path_factory.mktemp("whatif") / "serial"
    told = Told()
    done = run_whatif(small(*STRATEGIES, universe=UNIVERSE), folder, advance=told)
    return folder, done, told


def test_every_block_is_told_and_counted(run, small):
    _, done, told = run
    assert (done.computed_parts, done.resumed_parts) == (3, 0)
    assert told.steps == whatif_cost(small(*STRATEGIES, universe=UNIVERSE)).counts["n_steps"]


def test_the_result_is_that_of_its_tables(run):
    folder, done, _ = run
    stored = WhatIfResult.model_validate_json((folder / "whatif.json").read_text())
    assert stored == done.result
    universes = pd.read_parquet(folder / "universes.parquet")
    for item in stored.strategies:
        mine = universes["strategy"] == item.name
        assert mine.sum() == BLOCK + 30
        planets = (universes["new_planets"] + universes["known_planets"])[mine]
        assert item.planets.mean == pytest.approx(planets.mean())
    assert (
        stored.config_hash
        == json.loads(pq.read_schema(folder / "stars.parquet").metadata[b"cpic_planner"])["config_hash"]
    )


def test_equal_strategies_have_no_difference(run):
    _, done, _ = run
    found = [item for item in done.result.differences if (item.first, item.second) == ("twin", "plain")]
    assert {item.quantity for item in found} == set(get_args(DifferenceRecord.model_fields["quantity"].annotation))
    assert all((item.mean, item.error) == (0.0, 0.0) for item in found)
    universes = pd.read_parquet(run[0] / "universes.parquet")
    one, two = (universes["strategy"] == name for name in ("plain", "twin"))
    for name, values in universes.items():
        if name != "strategy":
            np.testing.assert_array_equal(values[one], values[two])
    other = next(item for item in done.result.differences if item.quantity == "hours" and item.first == "shy")
    assert other.mean < 0.0


@pytest.mark.long
def test_two_workers_make_the_same_files(run, small, tmp_path):
    run_whatif(small(*STRATEGIES, universe=UNIVERSE), tmp_path / "two", workers=2)
    assert digests(tmp_path / "two") == digests(run[0])


def test_what_is_lost_is_done_again(run, small, tmp_path):
    folder = tmp_path / "broken"
    shutil.copytree(run[0], folder)
    parts = sorted((folder / "parts").glob("*.blob"))
    assert len(parts) == 3
    parts[0].unlink()
    parts[2].write_bytes(parts[2].read_bytes()[:-20])  # cut short
    for name in PRODUCTS:
        (folder / name).unlink()
    told = Told()
    done = run_whatif(small(*STRATEGIES, universe=UNIVERSE), folder, advance=told)
    assert (done.resumed_parts, done.computed_parts) == (1, 2)
    assert sum("(kept)" in text for text in told) == 1
    assert digests(folder) == digests(run[0])


def test_another_configuration_does_not_mix(refused, run, small, tmp_path, no_report):
    folder = tmp_path / "other"
    shutil.copytree(run[0], folder)
    other = varied(small(universe={"universes": 30}), ["max_visits=1,3"])
    refused("--force", run_whatif, other, folder)
    assert digests(folder) == digests(run[0])
    result = run_whatif(other, folder, force=True).result
    assert result.n_universes == 30
    one, three = result.strategies
    assert (one.name, three.name) == ("plain max_visits=1", "plain max_visits=3")
    assert one.planets.mean <= three.planets.mean
    assert "max_visits=1: " in result.statement
    assert [(item.base, item.varied[0].label, item.variation) for item in result.strategies] == [
        ("plain", "max_visits=1", "max_visits=1"),
        ("plain", "max_visits=3", "max_visits=3"),
    ]
    # Which known planet makes how much of the yield, as the table of detections has it.
    found = pd.read_parquet(folder / "detections.parquet")
    mine = found["known_row"][found["strategy"] == three.name]
    most = max(np.bincount(mine[mine >= 0]))
    assert three.leading_planet.name == "eps Eri b"
    assert three.leading_planet.share == most / len(mine)
    assert three.leading_planet.planets == most / 30
    if three.leading_planet.share > 0.3:
        assert f"{three.planets.mean:.2f} planets" in result.statement
        assert "of the planets found are eps Eri b" in result.statement
    assert three.instrument.visit_drift_nm == 0.05
    assert three.instrument.throughput == {"F520": 0.19}
    assert set(pd.read_parquet(folder / "universes.parquet")["strategy"]) == {one.name, three.name}


@pytest.fixture
def no_report(monkeypatch):
    """Leave the page with its figures out."""
    monkeypatch.setattr(module, "write_whatif", lambda folder, result: None)


def test_fewer_universes_are_the_first_of_more(run, small, tmp_path, no_report):
    run_whatif(small(*STRATEGIES[:1], universe={"universes": 70}), tmp_path / "few")
    few, many = (pd.read_parquet(folder / "universes.parquet") for folder in (tmp_path / "few", run[0]))
    mine = (many["strategy"] == "plain") & (many["universe"] < 70)
    for name, values in few.items():
        np.testing.assert_array_equal(values, many[name][mine])


CHANGES = {
    "slot_share": ({"slot_share": 0.2}, {}),
    "bands": ({"visit": {"bands": ["F662"]}}, {}),
    "rule": ({"detection": {"half_factor": 2.5}}, {}),
    "contrast": ({"assumptions": {"contrast": 1e-9}}, {}),
    "rate": ({"population": {"base": "giants", "planets_per_star": 0.3}}, {}),
    "names": ({"targets": {"names": ["eps Eri"]}}, {}),
    "seed": ({}, {"seed": 2}),
    "universes": ({}, {"universes": 101}),
    "start": ({}, {"start_utc": "2028-01-02T00:00:00"}),
    "slots": ({}, {"slot_days": 61}),
    "background": ({}, {"background": "on"}),
    "exclusions": ({}, {"exclusions": ["rv"]}),
    "facts": ({}, {"facts": True}),
}


@pytest.fixture(scope="module")
def ground(small):
    return read_ground(small())


@pytest.mark.parametrize("change", CHANGES)
def test_the_hash_tells_what_decides_results(ground, small, change):
    strategy, universe = CHANGES[change]
    digest = digest_of(small(), ground)
    assert digest_of(small(strategy, universe=universe), ground) != digest


def test_the_hash_of_the_same_is_the_same_and_counts_images(ground, small):
    digest = digest_of(small(), ground)
    assert digest_of(small(), read_ground(small())) == digest
    assert digest_of(small(), ground, 3) != digest


def test_the_hash_counts_what_is_known_of_the_stars(ground, small):
    universe = small(universe={"exclusions": ["rv"]}).universe
    assert digest_of(small(), replace(ground, universe=universe)) != digest_of(small(), ground)


def test_the_hash_counts_the_table_of_known_planets(ground, small):
    assert digest_of(small(), replace(ground, known=None)) != digest_of(small(), ground)


def test_the_hash_counts_the_stars_of_each_strategy(ground, small):
    (case,) = ground.cases
    fewer = replace(case, targets=case.targets.select([0, 1]))
    twice = replace(ground, cases=(case, case))
    assert digest_of(small(), replace(ground, cases=(fewer,))) != digest_of(small(), ground)
    assert digest_of(small(), replace(ground, cases=(case, fewer))) != digest_of(small(), twice)


def test_the_hash_counts_files_by_what_is_in_them(ground, small, tmp_path):
    digest = digest_of(small(), ground)
    for name in ("a", "b"):  # another place of the same limits
        (tmp_path / name).mkdir()
        (tmp_path / name / "mine.yaml").write_text("moon_deg: 25\n")
    (tmp_path / "c.yaml").write_text("moon_deg: 26\n")
    found = []
    for path in (tmp_path / "a/mine.yaml", tmp_path / "b/mine.yaml", tmp_path / "c.yaml"):
        config = small(universe={"visibility": str(path)})
        found.append(digest_of(config, read_ground(config)))
    assert found[0] == found[1]
    assert len({digest, *found}) == 3
    log = tmp_path / "log.csv"
    logged = []
    for hours in (5, 6):
        log.write_text(
            "star,start_utc,band,exposure_s,n_frames,em_gain,telescope_h\n"
            f"tau Cet,2028-02-01T00:00:00,F520,20,100,400,{hours}\n"
        )
        logged.append(digest_of(small(), replace(ground, log=read_log(log))))
    assert len({digest, *logged}) == 3


def test_the_hash_of_another_instrument(ground, small, tmp_path):
    high = tmp_path / "high.yaml"
    high.write_text("mission: {orbit: {altitude_km: 500}}\n")
    config = small(universe={"instrument": str(high)})
    assert digest_of(config, read_ground(config)) != digest_of(small(), ground)


def test_nothing_to_find_is_an_answer(small, tmp_path, no_report):
    config = small({"population": None, "targets": {"names": ["alf Cen A"]}}, universe={"universes": 10})
    done = run_whatif(config, tmp_path / "none")
    assert done.result.statement == "No strategy finds a planet in any universe."
    assert done.result.strategies[0].planets.mean == 0.0
    assert json.loads((tmp_path / "none/whatif.json").read_text())["strategies"][0]["targets"] == []


EXTREMES = {
    # A thousandth of a day is no time for the slews and settlings of a visit.
    "a calendar without a visit": ({"slot_share": 0.001}, {"duration_days": 1, "slot_days": 1}, 0.0),
    "a thousand visits": ({"revisits": {"max_visits": 1000}}, {}, 300.0),
    "no drift": ({"assumptions": {"drift": 0}}, {}, 300.0),
}


@pytest.mark.parametrize("extreme", EXTREMES)
def test_extremes_of_one_star_are_answers(small, tmp_path, extreme):
    strategy, universe, most_h = EXTREMES[extreme]
    config = small({"targets": {"names": ["tau Cet"]}} | strategy, universe={"universes": 10} | universe)
    (found,) = run_whatif(config, tmp_path, pages=False).result.strategies
    assert (found.hours.mean > 0.0) == (most_h > 0.0)
    assert found.hours.mean <= most_h


def test_the_cost_grows_with_the_work(small):
    config = small(*STRATEGIES, universe={"universes": 1000})
    one = whatif_cost(config).at(1)
    assert one["n_blocks"] == 3 * 1000 / BLOCK
    assert whatif_cost(config).at(2)["wall_s"] < one["wall_s"] < whatif_cost(config, 5).at(1)["wall_s"]
    assert whatif_cost(replace_universes(config, 2000)).disk_mb > one["disk_mb"]


def replace_universes(config, n):
    return config.model_copy(update={"universe": config.universe.model_copy(update={"universes": n})})


@pytest.fixture(scope="module")
def detections(plain):
    return simulate_survey(plain.surveys[0], block=0, n=200, seed=1).detections


@pytest.mark.parametrize("count", [0, 1, 4, 30])
def test_the_interval_of_a_count(count):
    low, high = _poisson_interval(count)
    assert low == pytest.approx(chi2.ppf(0.05, 2 * count) / 2 if count else 0.0)
    assert high == pytest.approx(chi2.ppf(0.95, 2 * count + 2) / 2)
    # What has to be met or passed in one case of twenty.
    assert poisson.cdf(count, high) == pytest.approx(0.05)
    if count:
        assert poisson.sf(count - 1, low) == pytest.approx(0.05)


def body(n, detected, significant):
    return {"confirmations": [{"realisations": n, "n_detected": detected, "n_significant": significant}]}


def test_found_over_expected():
    sampled = [SimpleNamespace(known=False, probability=0.5), SimpleNamespace(known=True, probability=0.9)]
    found = image_sample(sampled, [body(4, 1, 4), body(4, 0, 3)], "note")
    assert (found.detections, found.images, found.found, found.note) == (2, 8, 1 + 3, "note")
    assert found.expected == pytest.approx(4 * 0.5 + 4 * 0.9)
    assert found.correction == pytest.approx(4 / 5.6)
    assert found.low < found.correction < found.high
    none = image_sample([], [], "no detections")
    assert (none.images, none.correction, none.low) == (0, None, None)


@pytest.mark.long
def test_a_planet_in_a_corner_is_measured_too(plain, detections, monkeypatch):
    """In the inner corner of the hole the ETC sees it, and the three other corners tell the noise of the images."""
    survey = plain.surveys[0]
    inner = survey.model.metrics["F520"].hole_inner_corner_arcsec + 0.06
    row = {name: values[:1].copy() for name, values in detections.items()}
    row["separation_arcsec"][:], row["pa_deg"][:] = inner, 45.0 + row["roll_deg"]
    mine = survey.targets.name == row["star"][0]
    row["distance_au"][:], row["phase_deg"][:] = inner * survey.targets.distance_pc[mine], 90.0
    sampled, note = sampled_detections(survey, row, 1, 1)
    monkeypatch.delattr("cpic_planner.validation.confirm.observe_off_mask")  # counts need no star of their own
    found = image_sample(sampled, [image_task(sampled[0].task.to_dict())], note)
    assert (found.images, found.note) == (REALISATIONS, "")


def test_sampled_scenes_are_what_the_visit_saw(plain, detections):
    survey = plain.surveys[0]
    sampled, note = sampled_detections(survey, detections, 3, 1)
    assert len(sampled) == 3
    assert note == ""
    assert sampled_detections(survey, detections, 2, 1)[0] == sampled[:2]
    every = set(np.round(detections["chance"], 12))
    for item in sampled:
        assert round(item.probability, 12) in every
        task = item.task
        assert task.realisations == REALISATIONS
        planet = load_scene(task.scene).planets[0]
        row = int(
            np.flatnonzero(np.isclose(detections["contrast"], task.predictions[0]["contrast"], rtol=1e-12, atol=0.0))[0]
        )
        assert planet.separation_arcsec == pytest.approx(detections["separation_arcsec"][row])
        turned = (planet.pa_deg + detections["roll_deg"][row] - detections["pa_deg"][row] + 180.0) % 360.0 - 180.0
        assert abs(turned) < 1e-9
        assert planet.radius_rjup == detections["radius_rjup"][row]
        # The ETC expects of the images what the survey expected of the visit.
        assert task.predictions[0]["snr_full"] == pytest.approx(detections["snr"][row], rel=1e-6)
        margin = task.predictions[0]["significance_full"] / task.predictions[0]["threshold"]
        assert margin == pytest.approx(detections["margin"][row], rel=1e-6)


def test_no_images_of_what_they_cannot_show(plain, detections, change):
    survey = plain.surveys[0]
    assumed = change(survey, assumptions={"contrast": 1e-10})
    assert sampled_detections(assumed, detections, 5, 1) == (
        [],
        "5 could not be imaged: no optics are known that leave so little light",
    )
    nothing = {name: values[:0] for name, values in detections.items()}
    assert sampled_detections(survey, nothing, 5, 1) == ([], "no detections")


@pytest.mark.long
def test_images_of_a_brighter_hole_have_a_noisier_mirror(plain, detections, change):
    brighter = change(plain.surveys[0], assumptions={"contrast": 1e-8})
    found = sampled_detections(brighter, detections, 3, 1)[0]
    assert len(found) == 3
    for item in found:
        assert item.task.simulator["mirror"]["noise_nm"] > 0.05
