"""Chances that visits detect planets, by the law that images follow, and what is too faint to have one."""

import math
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from cpic_core import ArrayLike, FloatArray, special
from cpic_planner.etc import detection
from cpic_planner.etc.model import EtcModel, Programme
from cpic_planner.etc.noise import StackNoise

LEAST_PROBABILITY = 1e-6
"""Planets that are detected with a smaller probability count as not detected at all."""
_ERRORS = 6.0
"""Standard errors by which a law may be off."""
_FEWEST = 0.5
"""Independent wavefronts behind the noise of one visit and many reference visits (`effective_visits`): the fewest."""


@dataclass(frozen=True, eq=False)
class Chances:
    """Probabilities of a detection, of a blind search and at a known place; NaN where no law was measured."""

    blind: FloatArray
    known_place: FloatArray

    @classmethod
    def of(
        cls,
        law: detection.DetectionLaw,
        margin: FloatArray,
        tails: FloatArray,
        inward: FloatArray,
        visits: ArrayLike,
        motion: ArrayLike = 1.0,
    ) -> Self:
        """Return the chances of a law; parameters as of `detection_probability` and `visit_chances`."""
        settings: dict[str, Any] = {"tails": np.nan_to_num(tails), "inward": inward}
        settings |= {"visits": visits, "calibration": law.calibration}
        blind = margin / np.asarray(motion, float)
        found = (detection.detection_probability(law, *of, **settings) for of in ((blind, False), (margin, True)))
        return cls(*(np.broadcast_to(chance, blind.shape) for chance in found))


def visit_chances(
    model: EtcModel,
    band: str,
    separation_arcsec: ArrayLike,
    visit_s: ArrayLike,
    noise: StackNoise,
    margin: ArrayLike,
    visits: ArrayLike = 1.0,
    *,
    motion: ArrayLike = 1.0,
) -> Chances:
    """Return the probabilities that visits, or programmes of them, detect planets.

    Parameters
    ----------
    model : EtcModel
    band : str
    separation_arcsec, visit_s : array_like
        Of the planets, and length of the science visits.
    noise : StackNoise
        Of the visits at the planets' places.
    margin : array_like
        Predicted significance over threshold; 0 for no visit.
    visits : array_like
        Independent wavefronts behind the noise of a programme (`effective_visits`).
    motion : array_like
        Factor on the threshold of a blind search for the motion of planets (`cpic_planner.etc.motion`); at a known
        place the orbit is followed.
    """
    law, margins = detection.law_of(model, band), np.asarray(margin, float)
    if law is None:
        return Chances(*np.full((2, *margins.shape), np.nan))
    tails = detection.tail_share(model, band, separation_arcsec, visit_s, noise)
    inward = model.metrics[band].lambda_d_arcsec / np.asarray(separation_arcsec, float)
    return Chances.of(law, margins, tails, inward, visits, motion)


def least_margin(law: detection.DetectionLaw, inward: ArrayLike, programme: Programme) -> FloatArray:
    """Return a significance over threshold below which no search reaches `LEAST_PROBABILITY`, at a known place or not.

    Parameters
    ----------
    law : DetectionLaw
    inward : array_like
        As of `cpic_planner.etc.detection.half_margin`.
    programme : Programme
        Visits that are reduced together; broadcasts against ``inward``.

    Notes
    -----
    A lower bound, with any tails and whatever calibration and middle of the law `_ERRORS` standard errors allow:
    without tails the logarithm of the middle is linear in the inverse of the number of visits, and so is the square of
    the width, so that the least of the one and the largest of the other are those of the fewest or of the most. Tails
    raise the middle, or lower it by no more than with the fewest.
    """
    far = special().ndtri(LEAST_PROBABILITY)
    visits, references = programme.visits, programme.reference_visits
    fewest = np.where(visits == references, 1.0, _FEWEST)
    ends = np.stack(np.broadcast_arrays(fewest, np.maximum(visits, references)))
    widths = ((law.blind_width, law.stack_width), (law.known_width, law.known_stack_width))
    below = [np.exp(far * detection.law_width(*each, ends).max(axis=0)) for each in widths]
    middles = np.minimum(*(detection.half_margin(law, False, 0.0, inward, end) for end in ends))
    blind = middles * math.exp(min(law.blind_tails, 0.0) * _FEWEST**-law.blind_visits) * below[0]
    off = math.exp(-_ERRORS * max(law.blind_margin_error, law.known_margin_error))
    most = law.calibration + _ERRORS * law.calibration_error
    return np.asarray(np.minimum(blind, law.known_margin * below[1]) * off / most)
