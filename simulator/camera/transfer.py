"""Moving charge to the register: parallel and serial transfer losses, clock-induced charge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from simulator.camera.gain import pixel_keys
from simulator.camera.stage import KERNELS, Exposure, FloatArray, Work
from simulator.lazy import load_kernels

__all__ = ["ClockCharge", "ParallelTransfer", "SerialTransfer", "chances_of_loss"]

# 1 / 18! is 2e-16.
_TERMS = 18


def chances_of_loss(transfers: npt.NDArray[np.int64], inefficiency: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Chances that an electron is left behind at least once, then a second and a third time given the one before.

    The number of losses in ``transfers`` transfers is binomial. Those beyond the third count as the third: their share
    is ``(n c)^4 / 24``.
    """
    n, c = transfers.astype(np.float64), inefficiency
    log_stay = np.log1p(-c)
    first = -np.expm1(n * log_stay)
    # Sums from below for few losses, where the complements would cancel; the complements for many.
    none, one = np.exp(n * log_stay), n * c * np.exp((n - 1.0) * log_stay)
    two = 0.5 * n * (n - 1.0) * c * c * np.exp((n - 2.0) * log_stay)
    three = two * np.maximum(n - 2.0, 0.0) / 3.0 * c / (1.0 - c)
    few = n * c < 1.0
    twice = np.where(few, _tail(two, 2, n, c), 1.0 - none - one)
    thrice = np.where(few, _tail(three, 3, n, c), 1.0 - none - one - two)
    second = np.divide(twice, first, out=np.zeros_like(first), where=first > 0.0)
    third = np.divide(thrice, twice, out=np.zeros_like(first), where=twice > 0.0)
    return first, np.clip(second, 0.0, 1.0), np.clip(third, 0.0, 1.0)


def _tail(term: FloatArray, k: int, n: FloatArray, chance: float) -> FloatArray:
    """Sum of a binomial law from ``k`` on, whose first term is given, for a mean below 1."""
    odds, total = chance / (1.0 - chance), term.copy()
    for j in range(k, k + _TERMS):
        term = term * np.maximum(n - j, 0.0) / (j + 1.0) * odds
        total += term
    return total


def _expected_shift(image: FloatArray, chances: tuple[FloatArray, FloatArray, FloatArray]) -> None:
    """Mean of `kernels.shift_back` along the rows of ``image``, in place."""
    first, second, third = (chance[:, None] for chance in chances)
    once = image * first
    twice = once * second
    thrice = twice * third
    image -= once
    for back, amount in ((1, once - twice), (2, twice - thrice), (3, thrice)):
        if image.shape[0] > back:
            image[back:] += amount[:-back]


def _whole(work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
    """Round mean charge to whole electrons, the mean kept: only they can be left behind."""
    if not exposure.detector.switches.photon_noise:
        load_kernels(KERNELS).round_stochastic(work.image.reshape(-1), pixel_keys(rng))


@dataclass(frozen=True)
class ParallelTransfer:
    """Charge left behind in the transfers along the columns, through the store to the register."""

    switch: str = "parallel_cti"

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Shift the mean."""
        _expected_shift(image[:, exposure.place.columns], self._chances(image, exposure))

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Shift the counts."""
        kernels = load_kernels(KERNELS)
        if exposure.detector.transfer.parallel_cti > 0:
            pixels = work.image[:, exposure.place.columns]
            _whole(work, exposure, rng)
            lost = kernels.shift_back(pixels, *self._chances(work.image, exposure), True, pixel_keys(rng))
            work.book("left_behind", -lost)

    @staticmethod
    def _chances(image: FloatArray, exposure: Exposure) -> tuple[FloatArray, FloatArray, FloatArray]:
        clocks = exposure.detector.transfer
        rows = exposure.place.first_row + np.arange(image.shape[0])
        return chances_of_loss(np.maximum(rows, 0) + 1 + clocks.store_rows, clocks.parallel_cti)


@dataclass(frozen=True)
class SerialTransfer:
    """Charge left behind in the transfers along the rows, through line and multiplication register."""

    switch: str = "serial_cti"

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Shift the mean."""
        _expected_shift(image.T, self._chances(image, exposure))

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Shift the counts."""
        kernels = load_kernels(KERNELS)
        if exposure.detector.transfer.serial_cti > 0:
            _whole(work, exposure, rng)
            lost = kernels.shift_back(work.image, *self._chances(work.image, exposure), False, pixel_keys(rng))
            work.book("left_behind", -lost)

    @staticmethod
    def _chances(image: FloatArray, exposure: Exposure) -> tuple[FloatArray, FloatArray, FloatArray]:
        clocks = exposure.detector.transfer
        columns = exposure.place.first_column + np.arange(image.shape[1])
        return chances_of_loss(np.maximum(columns, 0) + 1 + clocks.serial_elements, clocks.serial_cti)


@dataclass(frozen=True)
class ClockCharge:
    """Clock-induced charge of the parallel clocks: Poisson, in all rows that are clocked, once a frame.

    Thrown as events at random pixels, which is the same law as a count in every pixel and cheap where few occur.
    """

    switch: str = "clock_charge"

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Add the mean."""
        columns = exposure.place.columns
        image[:, columns] += exposure.detector.cic_e if exposure.cic_e is None else exposure.cic_e[:, columns]

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add the counts."""
        pixels = work.image[:, exposure.place.columns]
        if exposure.cic_e is None:
            total, cumulated = exposure.detector.cic_e * pixels.size, None
        else:
            cumulated = np.cumsum(exposure.cic_e[:, exposure.place.columns], dtype=np.float64)
            total = float(cumulated[-1])
        if total > 0.5 * pixels.size:
            mean = exposure.detector.cic_e if exposure.cic_e is None else exposure.cic_e[:, exposure.place.columns]
            counts = rng.poisson(mean, pixels.shape).astype(np.float64)
            pixels += counts
            work.book("clock_charge", float(counts.sum()))
            return
        events = int(rng.poisson(total))
        if cumulated is None:
            places = rng.integers(0, max(pixels.size, 1), size=events)
        else:
            places = np.searchsorted(cumulated, rng.random(events) * total, side="right")
        np.add.at(pixels, np.divmod(places, pixels.shape[1]), 1.0)
        work.book("clock_charge", events)
