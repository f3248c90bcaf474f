"""Fit, bins and report of the law of detection, on planets that are found by a law stated here."""

import math

import numpy as np
import pytest
from scipy.stats import norm, poisson

from cpic_planner.etc import DetectionLaw, default_law
from tools.detection_law import fit, measure, report, stacks

TRUTH = {
    "blind_margin": 0.8,
    "blind_tails": 0.9,
    "blind_inward": 4.0,
    "blind_visits": 0.3,
    "blind_width": 0.35,
    "stack_margin": 0.6,
    "stack_inward": -3.0,
    "stack_width": 0.22,
    "known_margin": 0.9,
    "known_width": 0.3,
    "known_stack_width": 0.15,
}


@pytest.fixture
def measured(monkeypatch):
    """What the tool keeps of all its cases, planets found by the law of `TRUTH`, false alarms as many as expected."""
    expected = {}
    monkeypatch.setattr(fit, "_expected", lambda case, frames, visits: expected[case, visits])

    def made(seed, planets=300):
        rng = np.random.default_rng(seed)
        found = {"stacks": [], "alarms": [], "minutes": {"planets": 1.0, "alarms": 1.0}, "machine": "none"}
        for number, case in enumerate(stacks.CASES):
            for visits in stacks.VISITS:
                margin = np.exp(rng.uniform(math.log(0.35), math.log(3.5), planets))
                tails, inward = rng.uniform(0.0, 1.0, planets), rng.uniform(0.06, 0.2, planets)
                single, stack = math.log(0.8) + 4.0 * (inward - 0.1), math.log(0.6) - 3.0 * (inward - 0.1)
                middle = 0.9 * tails * visits**-0.3 + single / visits + stack * (1.0 - 1.0 / visits)
                width, placed = (
                    math.sqrt(one**2 / visits + many**2 * (1.0 - 1.0 / visits))
                    for one, many in ((0.35, 0.22), (0.3, 0.15))
                )
                chances = norm.cdf((np.log(margin) - middle) / width), norm.cdf(np.log(margin / 0.9) / placed)
                hits = [(rng.random(planets) < chance).astype(int).tolist() for chance in chances]
                expected[case, visits] = {"margin": np.full(planets, 1e8), "tails": tails, "inward": inward}
                columns = {"place": list(range(planets)), "contrast": (1e-8 * margin).tolist()}
                columns |= {"found": hits[0], "placed": hits[1], "frames": [10.0, 100, 200.0]}
                found["stacks"].append({"case": number, "visits": visits} | columns)
                if case.part != "frames":
                    alarms = {f"{level:g}": round(1e5 * norm.sf(level)) for level in measure.LEVELS}
                    alarms |= {"stacks": 100, "elements": 1e5, "spread": alarms["3"] + alarms["3"] ** 2 / 100}
                    found["alarms"].append({"case": number, "visits": visits, "pool": 0} | alarms)
        return found

    return made


@pytest.mark.parametrize("mode", fit.MODES)
def test_the_fit_finds_the_law_that_planets_follow(measured, mode):
    found = fit.fitted(fit.table_of(measured(1), ("fit",)), mode)
    for name in fit.FITTED[mode]:
        best, error = found[name]
        assert 0.0 < error < (1.0 if name.endswith("inward") else 0.1)
        assert abs(best - TRUTH[name]) < 4.0 * error
    assert 0.0 < found[f"{fit.FITTED[mode][0]}_error"][0] < 0.05


@pytest.mark.parametrize("mode", fit.MODES)
@pytest.mark.parametrize("part", ["fit", "test", "frames"])
def test_bins_hold_enough_planets_and_the_right_fractions(measured, part, mode):
    bins = fit.bins_of(DetectionLaw(**TRUTH), fit.table_of(measured(2), (part,)), mode)
    cases = sum(case.part == part for case in stacks.CASES)
    assert sum(line[1] for line in bins) == 3 * 300 * cases
    assert {line[0] for line in bins} == set(stacks.VISITS)
    for _, planets, predicted, found in bins:
        assert planets >= min(fit.LEAST, 300 * cases)
        assert abs(found - predicted) < 4.5 * math.sqrt(max(predicted * (1 - predicted), 1e-3) / planets)


def test_the_report_says_whether_false_alarms_are_those_expected(monkeypatch, measured):
    monkeypatch.setattr(report, "default_law", lambda: DetectionLaw(**TRUTH))
    kept = measured(3)
    kept["law"] = {name: [value, 0.01] for name, value in TRUTH.items()}
    page = report.text(kept)
    assert page.count(" | yes |") == 16
    assert " | no |" not in page
    # As many alarms again as their number in each of 100 stacks: variance and mean are the same.
    for ratio in report.clustering(kept).values():
        assert ratio == pytest.approx(100.0 / 99.0, rel=1e-12)
    kept["alarms"][0]["3"] *= 3
    assert report.text(kept).count(" | no |") == 2  # of single visits, and of all


def test_what_was_measured_is_not_measured_again(monkeypatch, tmp_path, measured):
    """A case that is all there is left alone, whatever its pool; of another only what is missing is added."""
    scene = stacks.Scene(stacks.CASES[0], *[None] * 7, drawn=None)
    monkeypatch.setattr(measure, "FILE", tmp_path / "law.json")
    monkeypatch.setattr(measure, "scenes", lambda: [scene])
    monkeypatch.setattr(stacks.Scene, "renewed", lambda self, number: self)
    monkeypatch.setattr(measure, "nulls", lambda scene, visits, count, rng: {"3": int(rng.integers(1000))})
    found = measured(4)
    before = [dict(one) for one in found["alarms"]]
    measure.measure(found)
    assert found["alarms"] == before
    lost = found["alarms"].pop(1)
    assert lost["case"] == 0
    measure.measure(found)
    added = [one for one in found["alarms"] if one not in before]
    assert [{**one, "3": 0} for one in added] == [{"case": 0, "visits": lost["visits"], "pool": 0, "3": 0}]
    measure.measure(again := {**found, "alarms": before[2:] + before[:1]})
    assert [one for one in again["alarms"] if one not in before] == added


@pytest.mark.long
def test_stacks_hold_false_alarms_and_find_as_many_planets_as_the_law_says(monkeypatch, record_property):
    """One case that the fit knows nothing of, from the optics on: false alarms within Poisson, planets within 0.05.

    Blind, and by photometry at the place.
    """
    case = next(case for case in stacks.CASES if (case.part, case.star) == ("test", "bet Hyi"))
    monkeypatch.setattr(stacks, "CASES", (case,))
    monkeypatch.setattr(stacks, "POOL", 400)
    (scene,) = stacks.scenes()
    for visits in (4, 16):
        rng = np.random.default_rng(visits)
        alarms = measure.nulls(scene.renewed(visits), visits, 60, rng)
        for level in (3.0, 5.0):
            found, expected = alarms[f"{level:g}"], alarms["elements"] * norm.sf(level)
            record_property(f"false alarms at {level:g} sigma, {visits} visits", f"{found} of {expected:.3g}")
            # As rare as 4 sigma to either side.
            assert min(poisson.sf(found - 1, expected), poisson.cdf(found, expected)) > norm.sf(4.0)
        rows = measure.injections(scene, visits, rng)
        known = stacks.expected(scene.case, scene.frames, visits)
        place, contrast = (np.array([row[name] for row in rows]) for name in ("place", "contrast"))
        expected = {"tails": known["tails"][place], "inward": known["inward"][place]}
        expected |= {"margin": contrast * known["margin"][place], "visits": np.full(len(rows), float(visits))}
        for mode, words in (("found", "found"), ("placed", "seen at their place")):
            chance = fit.chances(default_law(), expected, mode)
            found, predicted = np.mean([row[mode] for row in rows]), chance.mean()
            record_property(f"planets {words}, {visits} visits", f"{found:.3f} of {predicted:.3f}")
            assert abs(found - predicted) < 0.05 + 3.0 * math.sqrt(float((chance * (1.0 - chance)).sum())) / len(rows)
