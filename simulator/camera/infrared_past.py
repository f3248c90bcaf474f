"""What the frames before a frame of a sequence leave in it, without drawing them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator

import numpy as np
import numpy.typing as npt

from simulator.detectors.infrared import PastExposure

FloatArray = npt.NDArray[np.float64]
# A charge this many decay times old has left 2e-22 of what it leaves at once.
_FORGOTTEN = 50.0


def earlier_frames(
    runs: Iterable[tuple[int, int]],
    mean_e: Callable[[int], FloatArray],
    *,
    before: int,
    full_well_e: float,
    exposure_s: float,
    readout_s: float,
    decay_s: float,
) -> Iterator[PastExposure]:
    """Yield the earlier frames of a sequence as one past exposure for each run of equal light.

    Frames of equal light hold equal mean charge ``Q`` and differ in age. With one decay time ``tau`` they act together
    as one charge ``Q sum(exp(-(a_k - a) / tau))`` of the age ``a`` of the youngest: exact, in closed form, and at a
    cost that does not grow with the number of frames. The noise of the earlier frames, their cosmic rays and their own
    persistence (of second order) are left out, so that a frame never depends on which others were drawn.

    Parameters
    ----------
    runs : iterable of tuple of int
        First and last frame of each run of equal light, the last one excluded; from the youngest to the oldest.
    mean_e : callable
        Mean electrons of a frame, by its number.
    before : int
        The frame that sees them; runs end at it or earlier.
    full_well_e : float
        Most that a pixel holds.
    exposure_s, readout_s : float
        Frames follow each other after their sum, above 0.
    decay_s : float
        Decay time of the traps.

    Yields
    ------
    PastExposure
        From the youngest run to the oldest that is not forgotten.
    """
    pace = exposure_s + readout_s
    for begin, end in runs:
        age = readout_s + (before - end) * pace
        if age > _FORGOTTEN * decay_s:
            return
        # the geometric series of exp(-pace / tau), stable where pace << tau
        weight = math.expm1(-(end - begin) * pace / decay_s) / math.expm1(-pace / decay_s)
        yield PastExposure(np.minimum(mean_e(begin), full_well_e) * weight, age)
