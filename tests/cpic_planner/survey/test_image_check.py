"""A sample of detections at image level: scenes, and the statistics of what is found."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2, poisson

from cpic_planner.survey.simulate import simulate_survey
from cpic_planner.survey.whatif import REALISATIONS, _poisson_interval, image_sample, image_task, sampled_detections
from simulator import load_scene


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
