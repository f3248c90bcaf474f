"""What limits an answer: the single change of the model that would make the planet detected in the given time.

``none`` where it is detected. ``geometry`` where the dark hole does not cover its place, ``saturation`` where no frame
is possible. ``speckles`` where it is detected once the wavefront does not drift: everything that no time averages is
taken away, wings of a companion included. Otherwise ``background`` where it is detected with its own photon noise and
the speckles alone: no starlight, sky, dust, companion, dark current, smear, clock-induced charge or read noise, in
science and in reference frames. Otherwise ``photons``: neither change alone is enough, the planet is too faint for the
time. Exposure, gain and number of frames are the best ones under each change, as are band and separation where the
question leaves them open. A question for a time that has no answer gets 1e9 s, the longest time that can be given.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cpic_planner.etc.frames import FrameProblem, best_in_visit
from cpic_planner.models.base import LimitText
from simulator.outcome import Reason, Status

__all__ = ["LONGEST_TIME_S", "limit_of", "reached", "without_background", "without_speckles"]

FloatArray = NDArray[np.float64]
LONGEST_TIME_S = 1e9
"""Longest wall time that can be given, s: what a question for a time may take at most."""
_OF_PLACE = (Reason.TOO_FEW_ELEMENTS, Reason.SMALL_ROLL)


def without_speckles(problem: FrameProblem) -> FrameProblem:
    """Return the problem without what no time averages: speckles of the drift, and a companion's wings."""
    nothing = np.zeros_like(problem.z0)
    return replace(problem, z0=nothing, z1=nothing, z2=nothing)


def without_background(problem: FrameProblem, own_e_s: FloatArray) -> FrameProblem:
    """Return the problem with no white noise but the planet's own, ``own_e_s`` (`cpic_planner.etc.noise.own_noise`)."""
    nothing = np.zeros_like(problem.alpha_e_s)
    own = np.array(np.broadcast_to(own_e_s, nothing.shape))
    return replace(problem, alpha_e_s=own, beta_e=nothing, gamma_e2=nothing, counting=None)


def reached(problem: FrameProblem, visit_s: FloatArray, level: FloatArray) -> NDArray[np.bool_]:
    """Return whether visits of at most ``visit_s`` reach a level; ``inf`` is reached by none."""
    choice = best_in_visit(problem, visit_s, quickest=False)
    with np.errstate(divide="ignore"):
        return (choice.n_frames >= 1) & (np.sqrt(choice.inverse_snr2) * level <= 1.0 + 1e-9)


def limit_of(
    status: Status, reason: Reason, *, detected: bool, without_speckles: bool, without_background: bool
) -> LimitText:
    """Return what limits an answer; see the module for the definition.

    Parameters
    ----------
    status, reason
        Of the answer. A time that does not hold one frame counts as ``photons``.
    detected : bool
        Whether the planet is detected as things are.
    without_speckles, without_background : bool
        Whether it is under each change.
    """
    if status is Status.OUTSIDE_FIELD or reason in _OF_PLACE:
        return "geometry"
    if status is Status.SATURATED:
        return "saturation"
    if status is Status.OK and detected:
        return "none"
    if without_speckles:
        return "speckles"
    return "background" if without_background else "photons"
