"""Fit, bins and report of the law of detection, on planets that are found by a law stated here."""

import math

import numpy as np
import pytest
from scipy.stats import norm, poisson

from cpic_planner.etc import DetectionLaw, default_law
from tools import detection_law

TRUTH = {
    "blind_margin": 0.8,
    "blind_tails": 0.9,
    "blind_inward": 4.0,
    "blind_visits": 0.3,
    "blind_width": 0.35,
    "stack_margin": 0.6,
    "stack_inward": -3.0,
    "stack_width": 0.22,
}


def measured(seed, planets=300):
    """What the tool keeps of all its cases, planets found by the law of `TRUTH`, false alarms as many as expected."""
    rng, stacks = np.random.default_rng(seed), []
    for number, case in enumerate(detection_law.CASES):
        for visits in detection_law.VISITS:
            margin = np.exp(rng.uniform(math.log(0.35), math.log(3.5), planets))
            tails, inward = rng.uniform(0.0, 1.0, planets), rng.uniform(0.06, 0.2, planets)
            single, stack = math.log(0.8) + 4.0 * (inward - 0.1), math.log(0.6) - 3.0 * (inward - 0.1)
            middle = 0.9 * tails * visits**-0.3 + single / visits + stack * (1.0 - 1.0 / visits)
            width = math.sqrt(0.35**2 / visits + 0.22**2 * (1.0 - 1.0 / visits))
            chance = norm.cdf((np.log(margin) - middle) / width)
            found = (rng.random(planets) < chance).astype(float)
            columns = {"margin": margin, "tails": tails, "inward": inward, "found": found}
            alarms = {"elements": 1e5} | {f"{level:g}": round(1e5 * norm.sf(level)) for level in detection_law.LEVELS}
            kept = {name: part.tolist() for name, part in columns.items()}
            stacks.append({"case": number, "visits": visits, "nulls": alarms if case.part != "frames" else None} | kept)
    return {"stacks": stacks, "minutes": 1, "machine": "none"}


def test_the_fit_finds_the_law_that_planets_follow():
    found = detection_law.fitted(detection_law.table_of(measured(1), ("fit",)))
    for name, value in TRUTH.items():
        best, error = found[name]
        assert 0.0 < error < (1.0 if name.endswith("inward") else 0.1)
        assert abs(best - value) < 4.0 * error
    assert 0.0 < found["blind_margin_error"][0] < 0.05


@pytest.mark.parametrize("part", ["fit", "test", "frames"])
def test_bins_hold_enough_planets_and_the_right_fractions(part):
    bins = detection_law.bins_of(DetectionLaw(**TRUTH), detection_law.table_of(measured(2), (part,)))
    cases = sum(case.part == part for case in detection_law.CASES)
    assert sum(line[1] for line in bins) == 3 * 300 * cases
    assert {line[0] for line in bins} == set(detection_law.VISITS)
    for _, planets, predicted, found in bins:
        assert planets >= min(detection_law.LEAST, 300 * cases)
        assert abs(found - predicted) < 4.5 * math.sqrt(max(predicted * (1 - predicted), 1e-3) / planets)


def test_the_report_says_whether_false_alarms_are_those_expected(monkeypatch):
    monkeypatch.setattr(detection_law, "default_law", lambda: DetectionLaw(**TRUTH))
    kept = measured(3)
    kept["law"] = {name: [value, 0.01] for name, value in TRUTH.items()}
    page = detection_law.text(kept)
    assert page.count(" | yes |") == 16
    assert " | no |" not in page
    kept["stacks"][0]["nulls"]["3"] *= 3
    assert detection_law.text(kept).count(" | no |") == 1


@pytest.mark.long
def test_stacks_hold_false_alarms_and_find_as_many_planets_as_the_law_says(monkeypatch, record_property):
    """One case that the fit knows nothing of, from the optics on: false alarms within Poisson, planets within 0.05."""
    case = next(case for case in detection_law.CASES if (case.part, case.star) == ("test", "bet Hyi"))
    monkeypatch.setattr(detection_law, "CASES", (case,))
    monkeypatch.setattr(detection_law, "POOL", 400)
    (scene,) = detection_law.scenes()
    for visits in (4, 16):
        rng = np.random.default_rng(visits)
        alarms = detection_law.nulls(scene, visits, 60, rng)
        for level in (3.0, 5.0):
            found, expected = alarms[f"{level:g}"], alarms["elements"] * norm.sf(level)
            record_property(f"false alarms at {level:g} sigma, {visits} visits", f"{found} of {expected:.3g}")
            # As rare as 4 sigma to either side.
            assert min(poisson.sf(found - 1, expected), poisson.cdf(found, expected)) > norm.sf(4.0)
        rows = detection_law.injections(scene, visits, rng)
        columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
        chance = detection_law.chances(default_law(), columns | {"visits": np.full(len(rows), float(visits))})
        found, predicted = columns["found"].mean(), chance.mean()
        record_property(f"planets found, {visits} visits", f"{found:.3f} of {predicted:.3f}")
        assert abs(found - predicted) < 0.05 + 3.0 * math.sqrt(float((chance * (1.0 - chance)).sum())) / len(rows)
