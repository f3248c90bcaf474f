"""Seeded maps of what makes pixels differ: response, dark current, hot and dead pixels."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from simulator.camera.frame import MaskBit

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

# A pixel is warm from 10 and hot from 100 times the median dark current on, and a median below 1e-4 e-/s counts as
# that. Assumed: the Level-1 data model names the bits but no limits.
WARM_FACTOR, HOT_FACTOR, LEAST_MEDIAN_E_S = 10.0, 100.0, 1e-4
LEAST_RESPONSE = 0.01


def response_map(shape: tuple[int, int], rms: float, rng: np.random.Generator) -> FloatArray:
    """Relative response: Gaussian about 1, at least 0.01 before its mean is made exactly 1."""
    if rms == 0.0:
        return np.ones(shape)
    response = rng.standard_normal(shape)
    response *= rms
    response += 1.0
    np.maximum(response, LEAST_RESPONSE, out=response)
    response /= response.mean()
    return response


def scatter_map(shape: tuple[int, int], rms: float, rng: np.random.Generator) -> FloatArray:
    """Log-normal factors above 0 of mean 1 and relative standard deviation ``rms``."""
    if rms == 0.0:
        return np.ones(shape)
    variance = math.log1p(rms * rms)
    factor = rng.standard_normal(shape)
    factor *= math.sqrt(variance)
    factor -= 0.5 * variance
    np.exp(factor, out=factor)
    return factor


def chosen_places(shape: tuple[int, int], fraction: float, rng: np.random.Generator) -> BoolArray:
    """``fraction`` of the pixels, rounded to a whole number, at random places."""
    chosen = np.zeros(shape, dtype=np.bool_)
    number = round(fraction * chosen.size)
    if number:
        chosen.reshape(-1)[rng.choice(chosen.size, number, replace=False, shuffle=False)] = True
    return chosen


def excess_map(hot: BoolArray, factor: float, rng: np.random.Generator) -> FloatArray:
    """What hot pixels have in excess, in units of the mean dark current: exponential of mean ``factor - 1``."""
    excess = np.zeros(hot.shape)
    excess[hot] = (factor - 1.0) * rng.standard_exponential(int(np.count_nonzero(hot)))
    return excess


def warm_from_e_s(dark_e_s: FloatArray, pixels: tuple[slice, slice]) -> float:
    """Dark current from which on a pixel is warm: 10 times the median of ``pixels``."""
    return WARM_FACTOR * max(float(np.median(dark_e_s[pixels])), LEAST_MEDIAN_E_S)


def flaw_mask(bad: BoolArray, dark_e_s: FloatArray, pixels: tuple[slice, slice]) -> npt.NDArray[np.uint8]:
    """`MaskBit` of the flaws: bad as given; hot or warm by the dark current against the median of ``pixels``."""
    warm = warm_from_e_s(dark_e_s, pixels)
    mask = np.where(bad, np.uint8(MaskBit.BAD), np.uint8(MaskBit.GOOD))
    raised = dark_e_s >= warm
    hot = dark_e_s >= HOT_FACTOR / WARM_FACTOR * warm
    mask[hot] |= np.uint8(MaskBit.HOT)
    mask[raised & ~hot] |= np.uint8(MaskBit.WARM)
    return mask
