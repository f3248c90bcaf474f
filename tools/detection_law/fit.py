"""Numbers of the law of detection that planets in stacks follow best, and how well they do."""

import functools
import math
from typing import Any

import numpy as np

from cpic_core import ArrayLike, FloatArray
from cpic_planner.etc import DetectionLaw
from cpic_planner.etc.detection import detection_probability, half_margin
from cpic_planner.validation import Frames
from tools.detection_law.stacks import CASES, VISITS, Case, expected

_RAREST, _NEVER = 1e-12, 1e30


def table_of(found: dict[str, Any], parts: tuple[str, ...]) -> dict[str, FloatArray]:
    """Return the columns of all planets of some cases' parts, with what today's calculator expects of them."""
    rows: dict[str, list[FloatArray]] = {}
    for one in found["stacks"]:
        case, count = CASES[one["case"]], len(one["place"])
        if case.part not in parts:
            continue
        known = {
            name: part[one["place"]] for name, part in _expected(case, tuple(one["frames"]), one["visits"]).items()
        }
        known["margin"] = known["margin"] * np.array(one["contrast"])
        own = {name: np.array(one[name], float) for name in ("found", "placed")}
        own |= {name: np.full(count, float(one[name])) for name in ("case", "visits")}
        for name, column in (known | own).items():
            rows.setdefault(name, []).append(column)
    return {name: np.concatenate(columns) for name, columns in rows.items()}


@functools.cache
def _expected(case: Case, frames: tuple[float, ...], visits: int) -> dict[str, FloatArray]:
    return expected(case, Frames(frames[0], int(frames[1]), frames[2]), visits)


MODES = ("found", "placed")
"""Columns of planets that a blind search finds, and that photometry at their place shows."""
_SEARCH = "blind_margin blind_tails blind_inward blind_visits blind_width stack_margin stack_inward stack_width"
FITTED = {"found": tuple(_SEARCH.split()), "placed": ("known_margin", "known_width", "known_stack_width")}
# Logarithms of margins and widths.
_START = {"found": (-0.3, 1.0, 3.0, 0.25, -1.1, -0.4, 0.0, -1.4), "placed": (0.0, -1.4, -1.6)}


def law_of_numbers(numbers: FloatArray, mode: str = "found") -> DetectionLaw:
    """Return the law of fitted numbers, where margins and widths are logarithms."""
    pairs = zip(FITTED[mode], map(float, numbers), strict=True)
    own: dict[str, Any] = {name: math.exp(x) if name.endswith(("margin", "width")) else x for name, x in pairs}
    return DetectionLaw.model_construct(**own)


def most_likely(rows: dict[str, FloatArray], mode: str = "found", start: ArrayLike | None = None) -> FloatArray:
    """Return the numbers of `law_of_numbers` of maximum likelihood."""
    from scipy.optimize import minimize

    hits = rows[mode] > 0.5

    def loss(numbers: FloatArray) -> float:
        chance = np.clip(chances(law_of_numbers(numbers, mode), rows, mode), _RAREST, 1.0 - _RAREST)
        return -float(np.log(np.where(hits, chance, 1.0 - chance)).sum())

    first = np.asarray(_START[mode] if start is None else start, float)
    return np.asarray(minimize(loss, first, method="BFGS", options={"gtol": 0.05}).x)


def fitted(rows: dict[str, FloatArray], mode: str = "found") -> dict[str, list[float]]:
    """Return the fitted numbers of the law, with errors of a jackknife over cases (star, band and drift)."""
    best, cases = most_likely(rows, mode), np.unique(rows["case"])
    parts = [{name: part[rows["case"] != case] for name, part in rows.items()} for case in cases]
    others, groups = np.array([most_likely(part, mode, best) for part in parts]), len(parts)
    spread = np.sqrt((groups - 1) / groups * ((others - others.mean(axis=0)) ** 2).sum(axis=0))
    # The middle of the sample is known best.
    middles = [float(middle_of(law_of_numbers(one, mode), rows, mode).mean()) for one in others]
    error = math.sqrt((groups - 1) / groups * float(np.sum((np.array(middles) - np.mean(middles)) ** 2)))
    law = law_of_numbers(best, mode)
    found = {}
    for name, deviation in zip(FITTED[mode], spread, strict=True):
        value = float(getattr(law, name))
        found[name] = [value, float(deviation) * (value if name.endswith(("margin", "width")) else 1.0)]
    return found | {f"{FITTED[mode][0]}_error": [error, 0.0]}


def middle_of(law: DetectionLaw, rows: dict[str, FloatArray], mode: str = "found") -> FloatArray:
    """Return the logarithms of the margins at which half of the planets are found."""
    if mode == "placed":
        return np.full(rows["margin"].shape, math.log(law.known_margin))
    return np.log(half_margin(law, False, rows["tails"], rows["inward"], rows["visits"]))


def chances(law: DetectionLaw, rows: dict[str, FloatArray], mode: str = "found") -> FloatArray:
    """Return the probabilities that a law gives to planets: by the search, or by photometry at their place alone."""
    expected = rows["margin"], mode == "placed", rows["tails"], rows["inward"]
    alone = law if mode == "found" else law.model_copy(update={"blind_margin": _NEVER, "stack_margin": _NEVER})
    return detection_probability(alone, *expected, visits=rows["visits"])


LEAST = 400  # planets in a bin


def bins_of(law: DetectionLaw, rows: dict[str, FloatArray], mode: str = "found") -> list[list[float]]:
    """Return the visits, planets, and their predicted and found fraction in bins of the predicted probability."""
    made = []
    for visits in VISITS:
        own = rows["visits"] == visits
        chance, hits = chances(law, rows, mode)[own], rows[mode][own]
        for part in np.array_split(np.argsort(chance), max(int(own.sum()) // LEAST, 1)):
            made.append([visits, part.size, float(chance[part].mean()), float(hits[part].mean())])
    return made
