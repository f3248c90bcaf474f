"""Compiled kernels of limits: full wells that spill, the curve of the amplifier, the converter.

They take checked input only. Charge is float64 holding whole electrons; what spills is conserved exactly. Importing
this module loads the compiler: do it inside functions.
"""

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from cpic_core import BoolArray, FloatArray


@njit(cache=True)
def vertical_spill(charge: FloatArray, full_well: float, spilled: BoolArray) -> tuple[float, float]:
    """Spill charge above the full well along the columns, half each way, in place.

    Each half fills the free room of the pixels in its direction; what is left at the ends of the columns is returned
    (bottom, top). ``spilled`` is set where charge was cut off or arrived.
    """
    rows, columns = charge.shape
    bottom = 0.0
    top = 0.0
    flagged = np.zeros(columns, np.bool_)
    for r in range(rows):
        for c in range(columns):
            if charge[r, c] > full_well:
                flagged[c] = True
    for c in range(columns):
        if not flagged[c]:
            continue
        down = np.zeros(rows)
        carry = 0.0
        for r in range(rows):
            excess = charge[r, c] - full_well
            if excess > 0.0:
                down[r] = math.floor(excess / 2.0)
                charge[r, c] = full_well
                spilled[r, c] = True
            elif carry > 0.0:
                taken = min(-excess, carry)
                if taken > 0.0:
                    charge[r, c] += taken
                    carry -= taken
                    spilled[r, c] = True
            if excess > 0.0:
                carry += excess - down[r]
        top += carry
        carry = 0.0
        for step in range(rows):
            r = rows - 1 - step
            if carry > 0.0:
                taken = min(full_well - charge[r, c], carry)
                if taken > 0.0:
                    charge[r, c] += taken
                    carry -= taken
                    spilled[r, c] = True
            carry += down[r]
        bottom += carry
    return bottom, top


@njit(cache=True)
def serial_spill(charge: FloatArray, full_well: float, spilled: BoolArray) -> float:
    """Pass charge above the register's full well to the pixels read next, in place; returns what is left at row ends.

    ``spilled`` is set where charge was cut off or arrived.
    """
    rows, columns = charge.shape
    residue = 0.0
    for r in range(rows):
        carry = 0.0
        for c in range(columns):
            n = charge[r, c]
            if carry == 0.0 and n <= full_well:
                continue
            spilled[r, c] = True
            total = n + carry
            charge[r, c] = min(total, full_well)
            carry = max(total - full_well, 0.0)
        residue += carry
    return residue


@njit(cache=True)
def compress(level: FloatArray, b: float) -> None:
    """Bend counts to ``x / (1 + b x)``. Flat, in place."""
    for i in range(level.size):
        level[i] /= 1.0 + b * level[i]


@njit(cache=True)
def digitise(level: FloatArray, highest: float, out: npt.NDArray[np.uint16], clipped: BoolArray) -> int:
    """Round to whole ADU, cut off at 0 and ``highest``; flag and count what was cut off. Flat arrays."""
    count = 0
    for i in range(level.size):
        value = np.rint(level[i])
        if value < 0.0 or value > highest:
            clipped[i] = True
            count += 1
            value = min(max(value, 0.0), highest)
        out[i] = np.uint16(value)
    return count
