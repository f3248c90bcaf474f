"""Compiled kernel that turns points of charge into whole electrons in pixels.

Importing this module loads the compiler: do it inside functions. The kernel takes checked input only.
"""

import math

from numba import njit

from cpic_core import FloatArray, IntArray


@njit(cache=True)
def deposit(
    start: IntArray,
    row: FloatArray,
    column: FloatArray,
    weight: FloatArray,
    sigma: FloatArray,
    reach_sigma: float,
    charge: IntArray,
    n_rows: int,
    n_columns: int,
    work: FloatArray,
    image: IntArray,
    touched: IntArray,
    share: FloatArray,
    left: IntArray,
) -> None:
    """Add every event's charge to ``image``, split over Gaussians at its points; ``left`` gets what fell inside.

    Event i owns points ``start[i]`` to ``start[i + 1]`` with weights of any scale, and one sigma in pixels. A Gaussian
    is integrated over pixels (centres at integers) out to ``reach_sigma``. Whole electrons come from rounding the
    cumulated share, pixel after pixel: they add up to ``charge[i]`` less what fell outside, exactly. ``work`` (as long
    as ``image``, both flat) must be 0 and is left so; ``touched`` is scratch space of the same length, ``share`` of the
    width of the largest Gaussian.
    """
    for i in range(charge.size):
        scale = 1.0 / (sigma[i] * math.sqrt(2.0))
        reach = reach_sigma * sigma[i]
        n_touched = 0
        inside = 0.0
        outside = 0.0
        for j in range(start[i], start[i + 1]):
            y, x, w = row[j], column[j], weight[j]
            y_low, y_high = math.floor(y - reach + 0.5), math.floor(y + reach + 0.5)
            x_low, x_high = math.floor(x - reach + 0.5), math.floor(x + reach + 0.5)
            if y_high < 0 or x_high < 0 or y_low >= n_rows or x_low >= n_columns:
                outside += w
                continue
            before = math.erf((x_low - 0.5 - x) * scale)
            for k in range(x_low, x_high + 1):
                after = math.erf((k + 0.5 - x) * scale)
                share[k - x_low] = 0.5 * (after - before)
                before = after
            before = math.erf((y_low - 0.5 - y) * scale)
            for m in range(y_low, y_high + 1):
                after = math.erf((m + 0.5 - y) * scale)
                part = 0.5 * (after - before) * w
                before = after
                for k in range(x_low, x_high + 1):
                    value = part * share[k - x_low]
                    if value <= 0.0:
                        continue
                    if 0 <= m < n_rows and 0 <= k < n_columns:
                        pixel = m * n_columns + k
                        if work[pixel] == 0.0:
                            touched[n_touched] = pixel
                            n_touched += 1
                        work[pixel] += value
                        inside += value
                    else:
                        outside += value
        given = 0
        cumulated = 0.0
        for k in range(n_touched):
            pixel = touched[k]
            cumulated += work[pixel]
            work[pixel] = 0.0
            target = math.floor(charge[i] * min(cumulated / (inside + outside), 1.0) + 0.5)
            if k == n_touched - 1 and outside == 0.0:
                target = charge[i]
            image[pixel] += target - given
            given = target
        left[i] = given
