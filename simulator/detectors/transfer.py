"""Moving charge to the register: smear, parallel and serial transfer losses, clock-induced charge."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from cpic_core import FloatArray, IntArray, load_kernels
from simulator.config import FrozenModel
from simulator.detectors.effect import KERNELS, Effect, Exposure, Sizes, Work, rounded, sizes
from simulator.detectors.gain import pixel_keys
from simulator.detectors.variance import FrameTerm

if TYPE_CHECKING:
    from simulator.ledger import CameraCase, PlanetPlace

# 1 / 18! is 2e-16.
_TERMS = 18
_SMEAR_MARGIN = 1.2  # rows behind the cross and beyond the frame, drifting speckles
# Of the aperture sum of a planet, what a shift by one pixel costs, times the squared radius in pixels: measured 0.40 to
# 0.43 in the four visible bands. At the edge of the mask the image ends sharply, and what is left of it may be little.
_SHIFT, _SHIFT_EDGE, _SHIFT_CUT = 0.43, 0.1, 1.3

Chances = tuple[FloatArray, FloatArray, FloatArray]
ClockInduced = Annotated[float, Field(ge=0, le=1e3)]


class ChargeTransfer(FrozenModel):
    """Losses of charge transfer and the clocks of frame transfer.

    A transfer leaves the fraction ``parallel_cti`` (image) or ``serial_cti`` (line and multiplication register) of the
    charge behind; ``store_rows`` (the frame store) lie between the first row and the register, ``serial_elements``
    between the first column and the output. Light falls on the pixels during frame transfer: there is no shutter.
    """

    parallel_cti: Annotated[float, Field(ge=0, le=0.01)]
    serial_cti: Annotated[float, Field(ge=0, le=0.001)]
    store_rows: Annotated[int, Field(ge=0, le=100_000)]
    serial_elements: Annotated[int, Field(ge=0, le=100_000)]
    line_shift_s: Annotated[float, Field(ge=0, le=0.1)]


class Smear(Effect):
    """Frame-transfer smear: lines pass under the light of their column on the way in and on the way out."""

    switch, label, law = "smear", "frame-transfer smear", "light during the line shifts, no shutter"
    needs, number = "light", "transfer.line_shift_s"
    set_up_s = 5e-5

    @staticmethod
    def smear_e(light_e_s: FloatArray, rows: slice, line_shift_s: float, beyond_e_s: FloatArray | float) -> FloatArray:
        """Return the mean electrons that the light of the other rows leaves in every pixel of a frame.

        Parameters
        ----------
        light_e_s : ndarray
            Photo-electrons per second and pixel, (y, x).
        rows : slice
            Rows that are made of pixels.
        line_shift_s : float
            Time that a line stands at a row.
        beyond_e_s : ndarray or float
            Light of rows beyond a window, summed over each column.
        """
        passed = light_e_s[rows] * line_shift_s
        others = passed.sum(axis=0)
        others += np.asarray(beyond_e_s) * line_shift_s
        smear = np.zeros_like(light_e_s)
        smear[rows] = others - passed
        return smear

    def size(self, case: CameraCase) -> Sizes:
        """Return the size of the light of the columns, and of a planet's own."""
        line_s = case.detector.transfer.line_shift_s
        own = line_s / case.exposure_s * 2.0 * case.radius_pixels
        own *= 0.0 if case.reduced else 1.0 + case.over_planets(lambda planet: planet.hidden)
        snr = own + _SMEAR_MARGIN * case.snr_share("smear")
        return sizes(case.mean_change(line_s * case.light.column_e_s), own, snr)


class _Transfer(Effect):
    """Charge left behind in transfers: the fraction ``n c`` of a pixel's charge arrives with the pixel behind it."""

    law = "charge left behind, electron by electron"
    stage, in_sums = "charge", "moves_charge"
    frame_s = 2e-4
    axis: ClassVar[int]
    elements: ClassVar[str]

    def _loss(self, detector: Any) -> float:
        return float(getattr(detector.transfer, self.switch))

    def _moved(self, image: FloatArray, exposure: Exposure) -> FloatArray:
        """Return a view of the pixels whose charge moves, with the transfers along its first axis."""
        raise NotImplementedError

    def chances(self, image: FloatArray, exposure: Exposure) -> Chances:
        """Return the chances of losses of every row (or column) of an image; see `chances_of_loss`."""
        first = (exposure.place.first_row, exposure.place.first_column)[self.axis]
        transfers = np.maximum(first + np.arange(image.shape[self.axis]), 0) + 1
        clocks = exposure.detector.transfer
        return chances_of_loss(transfers + getattr(clocks, self.elements), self._loss(exposure.detector))

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Shift the mean."""
        _expected_shift(self._moved(image, exposure), self.chances(image, exposure))

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Shift the counts."""
        if self._loss(exposure.detector) > 0:
            rounded(work, exposure, rng)
            moved = self._moved(work.image, exposure)
            pixels = moved if self.axis == 0 else moved.T
            chances = self.chances(work.image, exposure)
            lost = load_kernels(KERNELS).shift_back(pixels, *chances, self.axis == 0, pixel_keys(rng))
            work.book("left_behind", -lost)

    def size(self, case: CameraCase) -> Sizes:
        """Return the size of the charge that arrives one pixel later."""
        noise, clocks, axis = case.noise, case.detector.transfer, self.axis
        stamp = case.charge_e
        outside = case.light_e[stamp.size :]
        c, elements = self._loss(case.detector), getattr(clocks, self.elements)
        whole = (case.detector.n_rows, case.detector.n_columns)[axis]
        share = 1.0 - math.exp(-c * (case.first_pixel[axis] + elements + len(stamp) + 1))
        edge = 1.0 - math.exp(-c * (whole + elements))
        step = np.abs(np.diff(stamp, axis=axis, prepend=0.0))

        def of_planet(planet: PlanetPlace) -> float:
            cut = _SHIFT_EDGE if min(abs(planet.x_arcsec), abs(planet.y_arcsec)) < case.edge_arcsec else 0.0
            return share * (_SHIFT / case.radius_pixels**2 + cut + _SHIFT_CUT * planet.hidden)

        flux = case.over_planets(of_planet)
        hot_e = (case.flaws["bad_pixels"].dark_e_s + case.flaws["bad_columns"].dark_e_s) * case.exposure_s
        counts = case.n_frames * noise.factor2 * noise.photons
        beside = [0.0 if case.reduced else counts * float(hot_e[planet.place].sum()) for planet in case.light.planets]
        # Charge of steep halos moves too: a tenth of what moves, measured; and that of hot pixels beside an aperture.
        snr = flux + 0.1 * share * case.snr_share("halo", "other", factor=2.0) + share * case.snr_added(beside)
        moved = case.mean_change(np.concatenate([share * step.ravel(), edge * outside]))
        return sizes(moved + share * case.struck(), flux, snr)


class ParallelTransfer(_Transfer):
    """Charge left behind in the transfers along the columns, through the store to the register."""

    switch, label = "parallel_cti", "parallel transfer losses"
    number = "transfer.parallel_cti"
    axis, elements = 0, "store_rows"

    def _moved(self, image: FloatArray, exposure: Exposure) -> FloatArray:
        return image[:, exposure.place.columns]


class SerialTransfer(_Transfer):
    """Charge left behind in the transfers along the rows, through line and multiplication register."""

    switch, label = "serial_cti", "serial transfer losses"
    number = "transfer.serial_cti"
    axis, elements = 1, "serial_elements"

    def _moved(self, image: FloatArray, exposure: Exposure) -> FloatArray:
        return image.T


class ClockCharge(Effect):
    """Clock-induced charge of the parallel clocks: Poisson, in all rows that are clocked, once a frame.

    Thrown as events at random pixels, which is the same law as a count in every pixel and cheap where few occur.
    """

    switch, label, law = "clock_charge", "clock-induced charge", "Poisson, once a frame"
    stage, in_sums = "charge", "per_electron"
    number, map_kind = "cic_e", "cic"
    frame_s, term, colour = 2e-4, "cic", "#D55E00"

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Add the mean."""
        image[:, exposure.place.columns] += self._mean_e(exposure)

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add the counts."""
        pixels, mean = work.image[:, exposure.place.columns], self._mean_e(exposure)
        cumulated = np.cumsum(mean, dtype=np.float64)
        total = mean * pixels.size if exposure.cic_e is None else float(cumulated[-1])
        if total > 0.5 * pixels.size:
            counts = rng.poisson(mean, pixels.shape).astype(np.float64)
            pixels += counts
            work.book("clock_charge", float(counts.sum()))
            return
        events = int(rng.poisson(total))
        if exposure.cic_e is None:
            places = rng.integers(0, max(pixels.size, 1), size=events)
        else:
            places = np.searchsorted(cumulated, rng.random(events) * total, side="right")
        np.add.at(pixels, np.divmod(places, pixels.shape[1]), 1.0)
        work.book("clock_charge", events)

    @staticmethod
    def _mean_e(exposure: Exposure) -> Any:
        return exposure.detector.cic_e if exposure.cic_e is None else exposure.cic_e[:, exposure.place.columns]

    def added(self, detector: Any, exposure_s: float | None = None) -> FrameTerm:
        """Return the electrons of one frame."""
        return FrameTerm(charge_e=detector.cic_e)

    def size(self, case: CameraCase) -> Sizes:
        """Return the size of the mean."""
        return sizes(case.mean_change(case.noise.clock_e), snr=case.snr_share("clock"))


def chances_of_loss(transfers: IntArray, inefficiency: float) -> Chances:
    """Return the chances that an electron is left behind at least once, then a second and a third time given that.

    The number of losses in ``transfers`` transfers is binomial. Those beyond the third count as the third: their share
    is ``(n c)^4 / 24``.

    Parameters
    ----------
    transfers : ndarray of int
        Number of transfers.
    inefficiency : float
        Fraction ``c`` that one transfer leaves behind.
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
    """Return the sum of a binomial law from ``k`` on, whose first term is given, for a mean below 1."""
    odds, total = chance / (1.0 - chance), term.copy()
    for j in range(k, k + _TERMS):
        term = term * np.maximum(n - j, 0.0) / (j + 1.0) * odds
        total += term
    return total


def _expected_shift(image: FloatArray, chances: Chances) -> None:
    """Average `kernels.shift_back` along the rows of ``image``, in place."""
    first, second, third = (chance[:, None] for chance in chances)
    once = image * first
    twice = once * second
    thrice = twice * third
    image -= once
    for back, amount in ((1, once - twice), (2, twice - thrice), (3, thrice)):
        if image.shape[0] > back:
            image[back:] += amount[:-back]
