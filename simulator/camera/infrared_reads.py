"""From charge to reads, and from reads to one number per pixel: single read, double sampling, fit of a ramp."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from simulator.config.detector import ReadoutMode

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


def read_times(mode: ReadoutMode, n_reads: int) -> FloatArray:
    """Times of the reads as fractions of the exposure: the last is at its end."""
    if mode == "single":
        return np.ones(1)
    return np.linspace(0.0, 1.0, n_reads)


class ReadStack:
    """Reads of one frame, reduced as they come, without keeping them.

    ``single`` keeps the read. ``cds`` subtracts the first read from the last. ``up_the_ramp`` fits a straight line of
    equal weights to the reads of each pixel before it saturates and gives slope times exposure; with fewer than two
    such reads there is no slope, and the pixel is at the top of the range. Differences and slopes stand on the bias.

    Parameters
    ----------
    mode : {"single", "cds", "up_the_ramp"}
        How reads become one number.
    shape : tuple of int
        Rows and columns.
    bias_adu, adc_max_adu : float
        Level of the bias, and largest number of the converter.
    """

    def __init__(self, mode: ReadoutMode, shape: tuple[int, ...], bias_adu: float, adc_max_adu: float) -> None:
        self.mode, self.bias_adu, self.adc_max_adu = mode, bias_adu, adc_max_adu
        self._lost: BoolArray = np.zeros(shape, dtype=np.bool_)
        self._clipped: BoolArray = np.zeros(shape, dtype=np.bool_)
        self._first: FloatArray | None = None
        self._last: FloatArray = np.zeros(shape)
        # Sums over the unsaturated reads: 1, t, t^2, y, t y.
        self._sums: FloatArray | None = np.zeros((5, *shape)) if mode == "up_the_ramp" else None

    def add(self, time: float, adu: FloatArray, full: BoolArray) -> None:
        """Take one read.

        Parameters
        ----------
        time : float
            Fraction of the exposure at which it is taken.
        adu : ndarray
            What the amplifier gives, before the range of the converter cuts it off.
        full : ndarray of bool
            Pixels filled to the full well.
        """
        above = adu > self.adc_max_adu
        self._lost |= full | above
        self._clipped |= above | (adu < 0.0)
        adu = np.clip(adu, 0.0, self.adc_max_adu)
        if self._sums is None:
            self._first = adu if self._first is None else self._first
            self._last = adu
            return
        y, good = adu - self.bias_adu, ~self._lost
        terms: tuple[FloatArray | float, ...] = (1.0, time, time * time, y, time * y)
        for row, term in enumerate(terms):
            self._sums[row] += np.where(good, np.asarray(term), 0.0)

    def result(self) -> tuple[FloatArray, BoolArray, BoolArray]:
        """ADU before rounding, pixels that say nothing about their light, and pixels beyond the converter's range.

        A pixel is beyond it if a read or the number made from the reads was cut off, or if it saturated before there
        was a slope and was put at the top.
        """
        lost, adu = self._lost, self._last
        if self._sums is not None:
            n, t, tt, y, ty = (np.asarray(total) for total in self._sums)
            enough = n > 1.5
            slope = (n * ty - t * y) / np.where(enough, n * tt - t * t, 1.0)
            adu, lost = np.where(enough, slope + self.bias_adu, self.adc_max_adu), ~enough
            self._clipped |= lost
        elif self.mode == "cds" and self._first is not None:
            adu = self._last - self._first + self.bias_adu
        above = adu > self.adc_max_adu
        clipped = self._clipped | above | (adu < 0.0)
        return np.clip(adu, 0.0, self.adc_max_adu), lost | above, clipped
