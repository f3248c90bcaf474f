"""Statistics of a multiplication register that draws of any simulator are asked for, and those of our exact law."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

STAGES = 604
ELECTRONS = (1, 2, 5)  # at the input
SHARES = (0.02, 0.1, 0.5)  # of the mean output, up to which the low tail is summed
LEAST_CHANCE = 1e-6  # that is compared of a law
LEAST_DRAWS = 2000.0  # in a tail that is compared of draws
STANDARD_ERRORS = 4.0  # of draws, that agree: 1 in 16 000 by chance


def limits(electrons: int, gain: float) -> list[int]:
    """Return the outputs up to which the low tail is summed."""
    return [round(share * electrons * gain) for share in SHARES]


def drawn(register: Callable[[Any], Any], gain: float, draws: int) -> list[dict[str, Any]]:
    """Return the statistics of draws of a register, which takes an array of electrons."""
    found = []
    for electrons in ELECTRONS:
        output = np.asarray(register(np.full(draws, float(electrons))), dtype=np.float64)
        mean = float(output.mean())
        tails = [float((output <= limit + 0.5).mean()) for limit in limits(electrons, gain)]  # some round, some do not
        found.append(
            {
                "electrons": electrons,
                "gain": gain,
                "draws": draws,
                "mean": mean,
                "variance": float(((output - mean) ** 2).mean()),
                "tails": tails,
            }
        )
    return found


@functools.cache
def our_law(electrons: int, gain: float) -> NDArray[np.float64]:
    """Return our probabilities that the output is at most 0, 1, 2 and so on."""
    from simulator.detectors.gain import output_pmf, stage_probability

    reach = gain * (electrons + math.sqrt(72.0 * electrons) + 36.0)  # a tail of 1e-16 beyond folds
    size = 1 << int(reach + 64.0).bit_length()
    return np.cumsum(output_pmf(electrons, float(stage_probability(gain, STAGES)), STAGES, size))


def our_cumulants(electrons: int, gain: float) -> tuple[float, float, float]:
    """Return mean, variance and fourth cumulant of our law."""
    from simulator.detectors.gain import output_cumulants, stage_probability

    mean, variance, _, fourth, _ = output_cumulants(float(stage_probability(gain, STAGES)), STAGES)
    return electrons * mean, electrons * variance, electrons * fourth


def compared(case: dict[str, Any], words: str, *, misses: str = "", variance_too: bool = True) -> list[Any]:
    """Return rows of draws beside our law.

    Parameters
    ----------
    case : dict
        Of `drawn`.
    words : str
        What drew.
    misses : str
        Why the low tail is known to disagree; nothing where it should agree.
    variance_too : bool
        Whether the variance is then known to disagree as well.
    """
    from reports.external.comparison import Row

    electrons, gain, draws = case["electrons"], case["gain"], case["draws"]
    mean, variance, fourth = our_cumulants(electrons, gain)
    law, where = our_law(electrons, gain), f"{electrons} e-, gain {gain:g}, {words}"
    plain: dict[str, Any] = {"why": f"{STANDARD_ERRORS:g} standard errors of {draws:g} draws"}
    known = {"expected": False, "why": misses} if misses else plain
    error = math.sqrt(variance / draws) / mean
    rows = [Row(f"mean (e-), {where}", case["mean"], mean, STANDARD_ERRORS * error, **plain)]
    error = math.sqrt((fourth + 2.0 * variance**2) / draws)
    theirs, ours = (1.0 + value / (electrons * gain**2) for value in (case["variance"], variance))  # for Poisson input
    error /= electrons * gain**2 * theirs
    what = f"squared excess noise factor, {where}"
    rows.append(Row(what, theirs, ours, STANDARD_ERRORS * error, **(known if variance_too else plain)))
    for limit, theirs in zip(limits(electrons, gain), case["tails"], strict=True):
        ours = float(law[limit])
        if ours * draws < LEAST_DRAWS:
            continue
        error = math.sqrt(ours * (1.0 - ours) / draws) / theirs
        rows.append(Row(f"chance of at most {limit} e-, {where}", theirs, ours, STANDARD_ERRORS * error, **known))
    return rows
