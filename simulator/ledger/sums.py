"""Whether sums of frames may stand for the frames, from closed forms."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from simulator.camera.saturation import pixel_saturated
from simulator.detectors.chains import VISIBLE, in_sums
from simulator.imaging.metrics import PsfMetrics
from simulator.ledger.case import CameraCase
from simulator.outcome import Outcome, Reason, Status

# What a reduction takes out (flaws, bias, particles) or what moves charge between pixels: sums of frames leave it out.
NOT_IN_SUMS = in_sums(VISIBLE, "left_out", "moves_charge", "not_additive")
_SIGMA = 8.0


def sums_possible(
    case: CameraCase, metrics: PsfMetrics, star_e_s: float, *, visible: bool, moved: bool, band: str
) -> Outcome[float]:
    """Whether frames add up over the dark hole: no pixel in it reaches a limit, and none overflows into it.

    The image that is made decides it pixel by pixel (`simulator.hole_stack.hole_stackable`); this is the same from the
    sketch of the light.
    """
    if not visible:
        return Outcome.refuse(Status.INVALID, Reason.NOT_ADDITIVE, f"{band} is read by the infrared camera")
    if moved:
        return Outcome.refuse(Status.INVALID, Reason.NOT_ADDITIVE, "the star stands off the mask")
    detector, t, gain = case.detector, case.exposure_s, case.em_gain
    light = star_e_s * metrics.peak_on_axis_hole + case.sketch.sky_e_s
    light += max((source.stamp_peak_e_s for source in case.sketch.sources), default=0.0)
    inside = pixel_saturated(light * t + case.noise.dark_e + case.noise.clock_e, gain, detector, _SIGMA)
    if inside.status is not Status.OK:
        return inside
    rows, columns = (_runs(np.asarray(metrics.hole.any(axis=axis))) for axis in (1, 0))
    places = list(itertools.product(rows, columns))
    if any(case.spill.blooms_into(*place) for place in places):
        return Outcome.refuse(Status.SATURATED, Reason.PIXEL_FULL_WELL, "bloomed columns may enter the hole")
    if any(case.spill.trails_into(*place) for place in places):
        return Outcome.refuse(Status.SATURATED, Reason.REGISTER_FULL_WELL, "tails of the register may enter the hole")
    return inside


def _runs(inside: NDArray[np.bool_]) -> list[slice]:
    """Intervals of pixels that are inside."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
    return [slice(int(low), int(high)) for low, high in zip(edges[::2], edges[1::2], strict=True)]
