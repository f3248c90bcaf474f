"""The law of a detection: planets of known significance in the visits of surveys, looked for in simulated images."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import log_ndtr, ndtr

from cpic_core import load_yaml, split_sourced, stream
from cpic_planner.etc import aperture_rates, stack_noise
from cpic_planner.etc.detection import INWARD
from cpic_planner.jobs.engine import run_tasks
from cpic_planner.survey import load_strategies, varied
from cpic_planner.survey.assumed import imaged_model
from cpic_planner.survey.detection import Setting, rolled, tail_share
from cpic_planner.survey.image_check import image_task
from cpic_planner.survey.prepare import prepare
from cpic_planner.survey.simulate import Survey
from cpic_planner.validation import Frames, expected_of, refusals_of, star_scene, task_of
from simulator.config import ConstantAlbedo, Planet, preset_path
from simulator.target import contrast_at, detector_to_sky

NOMINAL, VARIED, REALISATIONS = 400, 240, 8
MARGINS, ALBEDO = (0.5, 3.0), 0.5
SWEEPS = ("contrast=1e-8,3e-9,1e-9", "drift=x0.5,x2")
STARTED = 1e-8
MOST_RJUP, MOST_TRIES = 10.0, 50


def prepared() -> dict[str, tuple[Survey, ...]]:
    """Surveys whose visits are imaged: the default ones, and two of them with other light and drift."""
    config = load_strategies()
    two = config.model_copy(
        update={
            "strategies": tuple(item for item in config.strategies if item.name in ("few_and_deep", "single_visit"))
        }
    )
    other = tuple(survey for sweep in SWEEPS for survey in prepare(varied(two, [sweep])).surveys)
    return {"nominal": prepare(config).surveys, "varied": other}


def sequence(surveys: dict[str, tuple[Survey, ...]], kind: str, number: int) -> dict[str, Any] | None:
    """One planet in one visit: its margin, what it is looked for in, and how often it is found."""
    rng = stream(1, "detection law", kind, number)
    for _ in range(MOST_TRIES):
        survey = surveys[kind][rng.integers(len(surveys[kind]))]
        row = int(rng.integers(len(survey.targets)))
        options = [option for option in survey.options[row] if option.n_frames >= 2]
        place, margin = rng.random(4), float(rng.uniform(*MARGINS))
        turn, choice, seed = float(rng.uniform(0.0, 360.0)), rng.random(), int(rng.integers(2**31))
        if not options:
            continue
        made = _sequence(survey, row, options[int(choice * len(options))], place, turn, margin, seed)
        if made is not None:
            return made | {"kind": kind}
    return None


def _sequence(
    survey: Survey, row: int, setting: Setting, place: NDArray[np.float64], turn_deg: float, margin: float, seed: int
) -> dict[str, Any] | None:
    model = imaged_model(survey.model, survey.strategy, setting.band)
    if model is None:
        return None
    star, metrics = rolled(survey.targets.select([row]), turn_deg), model.metrics[setting.band]
    low, high = (
        edge + sign * metrics.aperture_radius_arcsec
        for edge, sign in ((metrics.zone.inner_arcsec, 1.0), (metrics.zone.outer_arcsec, -1.0))
    )
    x, y = (low + place[:2] * (high - low)) * np.where(place[2:] < 0.5, -1.0, 1.0)
    separation, pa_deg = (
        float(np.squeeze(part)) for part in detector_to_sky(x, y, parity=model.instrument.detector.parity)
    )
    frames, contrast = Frames(setting.exposure_s, int(setting.n_frames), setting.em_gain), STARTED
    for _ in range(3):  # the planet's own light is no part of the noise of a significance
        expected = expected_of(model, star, setting.band, (x, y), contrast, frames)
        found = expected["significance_full"] / expected["threshold"]
        if not (np.isfinite(found) and found > 0.0):
            return None
        contrast *= margin / found
    expected = expected_of(model, star, setting.band, (x, y), contrast, frames)
    distance_au = separation * float(star.distance_pc[0])
    radius = float(np.sqrt(contrast / float(contrast_at(1.0, distance_au, 90.0, ALBEDO))))
    if radius > MOST_RJUP:
        return None
    planet = Planet(
        name="planet",
        separation_arcsec=separation,
        pa_deg=pa_deg % 360.0,
        radius_rjup=radius,
        albedo=ConstantAlbedo(value=ALBEDO),
        distance_au=distance_au,
        phase_deg=90.0,
    )
    task = task_of(
        model,
        star_scene(star, (planet,), name="x", exozodi_zodis=model.instrument.sky.exozodi_zodis),
        setting.band,
        frames,
        [expected],
        seed=seed,
        fidelity="standard",
        realisations=REALISATIONS,
        audit=False,
        overrides=None,
    )
    if refusals_of(task):
        return None
    done = image_task(task.to_dict())["confirmations"]
    if not done or done[0]["n_detected"] is None:  # a corner of the hole that leaves no room to measure its noise in
        return None
    answer = done[0]
    rates = aperture_rates(model, star, setting.band, np.array([[x]]), np.array([[y]]), np.array([[contrast]]))
    noise = stack_noise(
        rates, frames.exposure_s, frames.n_frames, frames.em_gain, model.camera(setting.band), model.strategy
    )
    return {
        "star": str(star.name[0]),
        "band": setting.band,
        "contrast": survey.strategy.assumptions.contrast,
        "drift": survey.strategy.assumptions.drift,
        "margin": expected["significance_full"] / expected["threshold"],
        "tails": float(np.squeeze(tail_share(model, setting, np.array([[separation]]), noise))),
        "inward": metrics.lambda_d_arcsec / separation,
        "realisations": answer["realisations"],
        "blind": answer["n_detected"],
        "known": answer["n_significant"],
    }


def run() -> dict[str, Any]:
    """All sequences, and the laws that are fitted to them; twelve minutes on two cores."""
    surveys = prepared()
    work = [(kind, number) for kind, most in (("nominal", NOMINAL), ("varied", VARIED)) for number in range(most)]
    done = dict(run_tasks(sequence, work, common=(surveys,), workers=2))
    rows = [row for k in range(len(work)) if (row := done[k]) is not None]
    rows = [
        {key: float(f"{value:.6g}") if isinstance(value, float) else value for key, value in row.items()}
        for row in rows
    ]
    return {"rows": rows, **fitted(rows)}


def _columns(rows: list[dict[str, Any]], law: str) -> tuple[NDArray[np.float64], ...]:
    margin, tails, inward, tries, hits = (
        np.array([row[key] for row in rows], float) for key in ("margin", "tails", "inward", "realisations", law)
    )
    one = np.ones(len(rows))
    terms = np.stack([one, tails, inward - INWARD], axis=1) if law == "blind" else one[:, None]
    return np.log(margin), terms, hits, tries


def probit(
    above: NDArray[np.float64], terms: NDArray[np.float64], hits: NDArray[np.float64], tries: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Coefficients of the middle of a normal law, and its width, by maximum likelihood."""

    def loss(p: NDArray[np.float64]) -> float:
        z = (above - terms @ p[:-1]) / np.exp(p[-1])
        return -float((hits * log_ndtr(z) + (tries - hits) * log_ndtr(-z)).sum())

    start = np.zeros(terms.shape[1] + 1)
    start[-1] = np.log(0.3)
    best = minimize(loss, start, method="BFGS").x
    return np.append(best[:-1], np.exp(best[-1]))


def fitted(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Maximum-likelihood laws, with errors of a jackknife over groups: tries of one planet share its place."""
    found: dict[str, Any] = {}
    for law in ("blind", "known"):
        best = probit(*_columns(rows, law))
        groups = 20
        others = np.array(
            [
                probit(*_columns([row for k, row in enumerate(rows) if k % groups != group], law))
                for group in range(groups)
            ]
        )
        error = np.sqrt((groups - 1) / groups * ((others - others.mean(axis=0)) ** 2).sum(axis=0))
        # The middle of the sample is known best: its error is what each universe draws.
        centre = np.mean(_columns(rows, law)[1], axis=0)
        at_centre = others[:, :-1] @ centre
        middle = np.sqrt((groups - 1) / groups * ((at_centre - at_centre.mean()) ** 2).sum())
        found[law] = {
            "coefficients": best[:-1].tolist(),
            "errors": error[:-1].tolist(),
            "width": float(best[-1]),
            "width_error": float(error[-1]),
            "middle_error": float(middle),
        }
    return found


def chance_of(rows: list[dict[str, Any]], law: str, fit: dict[str, Any]) -> NDArray[np.float64]:
    """Probability of each row's tries under a law."""
    above, terms, _, _ = _columns(rows, law)
    return np.asarray(ndtr((above - terms @ np.array(fit["coefficients"])) / fit["width"]))


def _preset() -> dict[str, float]:
    path = preset_path("strategy", "default", package="cpic_planner")
    assert path is not None
    return dict(split_sourced(load_yaml(path))[0]["detection"])


def _table(head: list[str], rows: list[list[str]]) -> str:
    return "\n".join(f"| {' | '.join(line)} |" for line in [head, ["---"] * len(head), *rows])


def _laws(found: dict[str, Any]) -> list[list[str]]:
    """Fitted numbers beside those of the preset."""
    preset, rows = _preset(), []
    for law, names in (("blind", ("margin", "tails", "inward")), ("known", ("margin",))):
        fit = found[law]
        for k, name in enumerate(names):
            value, error = fit["coefficients"][k], fit["errors"][k]
            if name == "margin":
                value, error = float(np.exp(value)), float(np.exp(value)) * error
            rows.append([f"`{law}_{name}`", f"{value:.3f} ± {error:.3f}", f"{preset[f'{law}_{name}']:g}"])
        rows.append([f"`{law}_width`", f"{fit['width']:.3f} ± {fit['width_error']:.3f}", f"{preset[f'{law}_width']:g}"])
        rows.append([f"`{law}_margin_error`", f"{fit['middle_error']:.3f}", f"{preset[f'{law}_margin_error']:g}"])
    return rows


def _groups(found: dict[str, Any]) -> list[list[str]]:
    """What the law expects beside what was found, in parts of the sample that the fit knows nothing of."""
    rows, made = found["rows"], []
    chances = {law: chance_of(rows, law, found[law]) for law in ("blind", "known")}
    parts = {
        "nominal instrument": lambda row: row["kind"] == "nominal",
        **{f"contrast {value:.0e}": lambda row, value=value: row["contrast"] == value for value in (1e-9, 3e-9, 1e-8)},
        **{
            f"drift x {value:g}": lambda row, value=value: (
                row["kind"] == "varied" and row["contrast"] is None and row["drift"] == value
            )
            for value in (0.5, 2.0)
        },
        **{band: lambda row, band=band: row["band"] == band for band in ("F520", "F662", "F720", "F850")},
        "tails below 0.2": lambda row: row["tails"] < 0.2,
        "tails 0.2 to 0.4": lambda row: 0.2 <= row["tails"] < 0.4,
        "tails above 0.4": lambda row: row["tails"] >= 0.4,
    }
    for name, part in parts.items():
        mine = [k for k, row in enumerate(rows) if part(row)]
        if not mine:
            continue
        tries = np.array([rows[k]["realisations"] for k in mine])
        cells = [name, str(len(mine)), str(int(tries.sum()))]
        for law in ("blind", "known"):
            hits, expected = sum(rows[k][law] for k in mine), float(tries @ chances[law][mine])
            cells.append(f"{hits} of {expected:.0f} ({hits / expected:.2f})")
        made.append(cells)
    return made


def text(found: dict[str, Any]) -> str:
    """The law in words and tables."""
    rows = found["rows"]
    return (
        "## The law of a detection\n\n"
        f"{len(rows)} planets of margins (predicted significance over threshold) from {MARGINS[0]:g} to {MARGINS[1]:g} "
        "at random places of the dark hole, in visits of the default strategies and of two of them under other raw "
        f"contrasts and drifts; {sum(row['realisations'] for row in rows)} simulated sequences, searched blind and "
        "measured at the known place. A detection has the probability "
        "`Phi(ln(margin / m) / width)`; a blind search has `ln m = ln(blind_margin) + blind_tails t + blind_inward "
        f"(i - {INWARD:g})`, with t the share of the noise (as rms) that is light of the wavefront's errors, whose "
        "tails are exponential, and i the resolution element over the separation. Errors are those of a jackknife over "
        "twenty groups of planets.\n\n"
        + _table(["number of the preset", "fitted", "preset"], _laws(found))
        + "\n\nFound, of expected by this one law:\n\n"
        + _table(["part", "planets", "sequences", "blind search", "at the known place"], _groups(found))
    )
