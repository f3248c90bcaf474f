"""A sample of a strategy's detections at image level: are they found there as often as their law says."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpic_core import NDArray
from cpic_planner.queries import MAX_FRAMES
from cpic_planner.results import ImageSample
from cpic_planner.survey.assumed import imaged_model
from cpic_planner.survey.detection import rolled
from cpic_planner.survey.planning import albedos_of
from cpic_planner.survey.simulate import Survey
from cpic_planner.survey.universe import NEW, chance
from cpic_planner.validation import ConfirmTask, Frames, confirm_task, expected_of, refusals_of, star_scene, task_of
from simulator.config import Planet
from simulator.target import sky_to_detector

REALISATIONS = 4
_LEVEL = 0.90


@dataclass(frozen=True)
class SampledDetection:
    """A detection that is imaged: its work, whether its place is known, and the probability that a visit shows it."""

    task: ConfirmTask
    known: bool
    probability: float


def sampled_detections(
    survey: Survey, detections: Mapping[str, NDArray[Any]], n: int, seed: int
) -> tuple[list[SampledDetection], str]:
    """Draw detections of a strategy, and make the scenes that their visits saw.

    Parameters
    ----------
    survey : Survey
    detections : mapping
        The strategy's rows of the table of detections.
    n : int
        Detections to draw, each equally likely; all if there are fewer.
    seed : int

    Returns
    -------
    sampled : list of SampledDetection
    note : str
        Why there are none, or fewer.

    Notes
    -----
    The scene is turned by the roll of the visit, so that the detector of the images stands at roll 0 as in all other
    confirmations. Images have the raw contrast that a strategy assumes if it is brighter than the instrument's own;
    optics that would be darker are not known.
    """
    strategy = survey.strategy
    if survey.model.of_table:
        return [], "images of a coronagraph that is a table are not known"
    if len(strategy.reduction.rolls_deg) > 1:
        return [], "images of two rolls are not sampled"
    if strategy.detection.rule == "expected":
        return [], "certain detections have no law that images could confirm"
    if (total := len(detections["universe"])) == 0:
        return [], "no detections"
    order = np.argsort(chance(seed, "images", strategy.name, shape=(total,)), kind="stable")
    sampled: list[SampledDetection] = []
    left_out = 0
    for row in order[:n]:
        task = _task(survey, {name: column[row] for name, column in detections.items()}, len(sampled), seed)
        if task is None:
            left_out += 1
            continue
        planet = int(detections["known_row"][row])
        known = planet != NEW and survey.known is not None and bool(survey.known.placed[planet])
        known = known or strategy.detection.rule == "known_place"
        sampled.append(SampledDetection(task, known, float(detections["chance"][row])))
    darker = left_out and strategy.assumptions.contrast is not None
    why = ": no optics are known that leave so little light" if darker else ""
    return sampled, f"{left_out} could not be imaged{why}" if left_out else ""


def _task(survey: Survey, row: Mapping[str, Any], number: int, seed: int) -> ConfirmTask | None:
    """Return the images of one detection; None where the images cannot be made."""
    i = int(np.flatnonzero(survey.targets.name == row["star"])[0])
    setting = survey.options[i][int(row["option"])]
    model = imaged_model(survey.model, survey.strategy, setting.band)
    if model is None or not 1 <= setting.n_frames <= MAX_FRAMES:
        return None
    if (zodis := float(row["exozodi_zodis"])) != model.instrument.sky.exozodi_zodis:
        model = replace(model, instrument=model.instrument.changed({"sky": {"exozodi_zodis": zodis}}))
    turned = rolled(survey.targets.select([i]), float(row["roll_deg"]))
    pa_deg = (float(row["pa_deg"]) - float(row["roll_deg"])) % 360.0
    drawn = {key: float(row[key]) for key in ("radius_rjup", "distance_au", "phase_deg", "separation_arcsec")}
    albedo = albedos_of(survey.strategy.population)[int(row["kind"])]
    planet = Planet(name="planet", pa_deg=pa_deg, albedo=albedo, **drawn)
    name = f"{row['star']} {number}"
    scene = star_scene(turned, (planet,), name=name, exozodi_zodis=zodis)
    place = sky_to_detector(drawn["separation_arcsec"], pa_deg, parity=model.instrument.detector.parity)
    frames = Frames(setting.exposure_s, int(setting.n_frames), setting.em_gain)
    expected = [expected_of(model, turned, setting.band, place, float(row["contrast"]), frames)]
    task = task_of(
        model,
        scene,
        setting.band,
        frames,
        expected,
        seed=seed,
        fidelity="standard",
        realisations=REALISATIONS,
        audit=False,
        overrides=None,
    )
    return None if refusals_of(task) else task


def image_task(task: Mapping[str, Any]) -> dict[str, Any]:
    """Simulate and measure one detection."""
    return {"confirmations": confirm_task(dict(task), counted=True)["confirmations"]}


def image_sample(
    sampled: Sequence[SampledDetection], bodies: Sequence[Mapping[str, Any]], note: str = ""
) -> ImageSample:
    """Compare what images show with what the law of the strategy expects.

    Parameters
    ----------
    sampled : sequence of SampledDetection
    bodies : sequence of mapping
        What `cpic_planner.validation.confirm.confirm_task` made of each.
    note : str

    Notes
    -----
    Images count as independent tries of their own probability. The interval of found over expected is that of a
    Poisson number of the same mean (Garwood 1936), which is wider than the binomial one.
    """
    images = found = 0
    expected = 0.0
    for item, body in zip(sampled, bodies, strict=True):
        for answer in body["confirmations"]:
            n = int(answer["realisations"] or 0)
            images += n
            expected += n * item.probability
            found += int((answer["n_significant"] if item.known else answer["n_detected"]) or 0)
    numbers = found, *_poisson_interval(found)
    correction, low, high = (number / expected if expected > 0 else None for number in numbers)
    made = {"detections": len(sampled), "images": images, "expected": expected, "found": found, "note": note}
    return ImageSample(**made, correction=correction, low=low, high=high)


def _poisson_interval(count: int) -> tuple[float, float]:
    from scipy.special import gammaincinv

    tail = 0.5 * (1.0 - _LEVEL)
    return float(gammaincinv(count, tail)) if count else 0.0, float(gammaincinv(count + 1, 1.0 - tail))
