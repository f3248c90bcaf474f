"""Whether sums of frames may stand for the frames, from closed forms."""

from __future__ import annotations

import math

from simulator.camera.saturation import pixel_saturated
from simulator.imaging.metrics import PsfMetrics
from simulator.ledger.case import CameraCase
from simulator.outcome import Outcome, Reason, Status

__all__ = ["NOT_IN_SUMS", "sums_possible"]

# What a reduction takes out (flaws, bias, particles) or what moves charge between pixels: sums of frames leave it out.
NOT_IN_SUMS = ("flat", "dark_structure", "bad_pixels", "bad_columns", "smear", "cosmic_rays", "nonlinearity",
               "parallel_cti", "serial_cti", "stripes", "interference", "bias_drift")  # fmt: skip
_SIGMA = 8.0


def sums_possible(
    case: CameraCase, metrics: PsfMetrics, star_e_s: float, *, camera: str, moved: bool, band: str
) -> Outcome[float]:
    """Whether frames add up over the dark hole: no pixel in it reaches a limit, and none overflows into it.

    The image that is made decides it pixel by pixel (`simulator.hole_stack.hole_stackable`); this is the same from the
    brightest pixels of the hole, of its columns and of its rows.
    """
    if camera != "VIS":
        return Outcome.refuse(Status.INVALID, Reason.NOT_ADDITIVE, f"{band} is read by the infrared camera")
    if moved:
        return Outcome.refuse(Status.INVALID, Reason.NOT_ADDITIVE, "the star stands off the mask")
    detector, t, gain = case.detector, case.exposure_s, case.em_gain
    light = star_e_s * metrics.peak_on_axis_hole + case.sketch.sky_e_s
    light += max((source.peak_e_s for source in case.sketch.sources), default=0.0)
    inside = pixel_saturated(light * t + case.noise.dark_e + case.noise.clock_e, gain, detector, _SIGMA)
    if inside.status is not Status.OK:
        return inside
    column = case.column_peak_e_s * t
    if column + 5.0 * math.sqrt(column) > detector.full_well_e:
        return Outcome.refuse(Status.SATURATED, Reason.PIXEL_FULL_WELL, "bloomed columns may enter the hole")
    tail = max([star_e_s * metrics.register_tail, *(source.peak_e_s for source in case.sketch.sources)]) * t
    if gain * (tail + 5.0 * math.sqrt(2.0 * tail)) > detector.register_full_well_e:
        return Outcome.refuse(Status.SATURATED, Reason.REGISTER_FULL_WELL, "tails of the register may enter the hole")
    return inside
