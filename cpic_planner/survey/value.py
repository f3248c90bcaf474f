"""What visits of a star are worth: expected detections of the planets drawn for planning, visit after visit."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cpic_planner.survey.candidates import Candidate

__all__ = ["StarValue", "Visit"]

FloatArray = NDArray[np.float64]
Visit = tuple[int, int]
"""Option and slot."""


@dataclass(frozen=True, eq=False)
class StarValue:
    """Value of a star after some visits.

    ``counts[c]`` is the probability that each planet was detected ``c`` times so far, for ``c`` below the number of
    detections that are needed.

    Notes
    -----
    A planet counts once it has been detected ``k`` times: the value of a set of visits is ``V = sum w P(count >= k)``.
    ``U = sum w E[min(count, k)] / k`` is at least as large, equal for ``k = 1``, and has diminishing returns (it is
    monotone and submodular), which `V` lacks for ``k > 1``: bounds are made of `U`.
    """

    star: Candidate
    needed: int
    counts: FloatArray
    value: float
    upper: float

    @classmethod
    def none(cls, star: Candidate, needed: int) -> StarValue:
        """Before any visit.

        Parameters
        ----------
        star : Candidate
        needed : int
            Detections that a planet needs.
        """
        counts = np.zeros((needed, len(star.weight)))
        counts[0] = 1.0
        return cls(star, needed, counts, 0.0, 0.0)

    @classmethod
    def of(cls, star: Candidate, needed: int, visits: Iterable[Visit]) -> StarValue:
        """After a set of visits.

        Parameters
        ----------
        star : Candidate
        needed : int
            Detections that a planet needs.
        visits : iterable of Visit
        """
        state = cls.none(star, needed)
        for visit in visits:
            state = state.after(visit)
        return state

    def after(self, visit: Visit) -> StarValue:
        """After one more visit."""
        option, slot = visit
        p = self.star.chance[option, slot].astype(np.float64)
        w = self.star.weight
        gain, upper = float((w * p) @ self.counts[-1]), float((w * p) @ self.counts.sum(axis=0)) / self.needed
        counts = self.counts * (1.0 - p)
        counts[1:] += self.counts[:-1] * p
        return StarValue(self.star, self.needed, counts, self.value + gain, self.upper + upper)

    def gains(self) -> tuple[FloatArray, FloatArray]:
        """What one more visit adds to `V` and to `U`, for every option and slot, shape ``(o, b)``."""
        w = self.star.weight
        return (
            self.star.chance @ (w * self.counts[-1]),
            self.star.chance @ (w * self.counts.sum(axis=0)) / self.needed,
        )
