"""Effects of the visible camera, from the light on its pixels to the converter, and numbers that belong to them.

Collecting charge (photo-electrons, cosmic rays, non-linearity, full well); moving it to the register (smear, transfer
losses, clock-induced charge); the multiplication register; reading out (noise of the amplifier, structure of the bias,
rounding of the converter).
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from cpic_core import FloatArray, IntArray, load_kernels
from simulator.config import FrozenModel
from simulator.detectors.effect import KERNELS, Case, Effect, Exposure, Setting, Sizes, Work, counted, rounded, sizes
from simulator.detectors.gain import amplify, pixel_keys, stage_probability
from simulator.detectors.variance import FrameTerm

COUNTED = ("planet", "halo", "other", "sky", "smear", "dark", "flaws")
"""Origins of the variance of an aperture sum that are counts of electrons with photon noise."""

FullWell = Annotated[float, Field(ge=100, le=1e9)]


class Nonlinearity(FrozenModel):
    """Fractions of the charge missing at two levels: in a pixel at full well, and at the output of the register."""

    pixel_loss_at_full_well: Annotated[float, Field(ge=0, le=0.5)]
    register_loss: Annotated[float, Field(ge=0, le=0.5)]
    register_loss_at_e: Annotated[float, Field(gt=0, le=1e9)]


class PhotonNoise(Effect):
    """Poisson counts of the collected electrons."""

    switch, label, law = "photon_noise", "photon noise", "Poisson"
    stage, in_sums, always = "charge", "per_electron", True
    needs = "exposure"
    frame_s = 4e-4

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Draw the counts; with the switch off, collect the mean."""
        if self.on(exposure.detector):
            mean, zero = exposure.mean_e.reshape(-1), exposure.zero.reshape(-1)
            load_kernels(KERNELS).draw_poisson(mean, zero, pixel_keys(rng), work.image.reshape(-1))
        else:
            work.image[...] = exposure.mean_e
        work.charge["collected"] = float(work.image.sum())

    def size(self, case: Case) -> Sizes:
        """Return the share of counts in the variance."""
        return sizes(case.variance_change(case.noise.factor2 * case.counted_e), snr=case.snr_share(*COUNTED))


class InfraredPhotonNoise(PhotonNoise):
    """Poisson counts of the light alone."""

    def draw(self, work: Work, exposure: Any, rng: np.random.Generator) -> None:
        """Draw the counts; with the switch off, collect the mean."""
        work.image[...] = counted(exposure.light_e, exposure.detector, rng)
        work.book("photons", work.image.sum())

    def draw_sum(self, work: Work, exposure: Exposure, n_frames: int, rng: np.random.Generator) -> None:
        """Draw the counts of light and dark current together."""
        super().draw(work, exposure, rng)


class CosmicRayHits(Effect):
    """Charge that particles leave in the pixels."""

    switch, label, law = "cosmic_rays", "cosmic rays", "tracks at the rate of the date"
    stage, in_sums = "charge", "not_additive"
    needs = "exposure"
    frame_s = 6e-4

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add the tracks of one exposure."""
        if exposure.tracks is None:
            return
        part = exposure.place.rows, exposure.place.columns
        pixels = work.image[part]
        hits = exposure.tracks(pixels.shape, rng=rng)
        rows, columns = np.divmod(hits.pixels, pixels.shape[1])
        pixels[rows, columns] += hits.electrons
        work.cosmic = np.zeros(work.image.shape, dtype=np.bool_)
        work.cosmic[part][rows, columns] = True
        work.book("cosmic_rays", float(hits.electrons.sum()))
        work.counts["n_cosmic_rays"] = hits.n_events

    def row(self, setting: Setting) -> tuple[str, str]:
        """Return how it is modelled, and why it does not exist; empty if it does."""
        rate, why_not = setting.particles_per_s_cm2, self.why_not(setting)
        law = f"{self.law}, {rate:.3g} /s/cm2" if setting.dated and not why_not else self.law
        return law, why_not or ("" if rate > 0 else "their rate is zero")

    def size(self, case: Case) -> Sizes:
        """Return the size of the charge in a pixel, and of the frames that an aperture loses."""
        t = case.exposure_s
        pixel = case.struck() + case.mean_change(case.hits_per_s * t * case.hits.mean_e)
        return sizes(0.0 if case.reduced else pixel, snr=1.0 - math.exp(-0.5 * case.lost_per_s * t))


class PixelNonlinearity(Effect):
    """A pixel collects less of what comes as it fills up; the missing electrons recombine.

    The curve is ``x / (1 + b x)`` up to the full well, with the loss there of the configuration, the same for all
    pixels; what comes beyond spills without loss. Counts are rounded at random to whole electrons so that the mean
    follows the curve.
    """

    switch, label, law = "nonlinearity", "non-linearity", "pixels and output of the register"
    stage, in_sums = "charge", "not_additive"
    frame_s = 1e-4

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Apply the curve to the mean, and to the variance about it to second order."""
        b, full_well = pixel_curve(exposure.detector), exposure.detector.full_well_e
        held = np.minimum(image, full_well)
        image -= b * held**2 / (1.0 + b * held)
        if exposure.detector.switches.photon_noise:
            image -= np.where(image < full_well, b / (1.0 + b * held) ** 3 * held, 0.0)

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Apply the curve to the counts."""
        b = pixel_curve(exposure.detector)
        if b == 0.0:
            return
        before = float(work.image.sum())
        rounded(work, exposure, rng)
        load_kernels(KERNELS).compress_counts(work.image.reshape(-1), b, exposure.detector.full_well_e, pixel_keys(rng))
        work.book("nonlinearity", float(work.image.sum()) - before)

    def size(self, case: Case) -> Sizes:
        """Return the size of the curves of the pixels and of the output together."""
        if case.reduced:
            return sizes(0.0)
        detector, noise, t = case.detector, case.noise, case.exposure_s
        b = pixel_curve(detector) + case.em_gain * output_curve(detector)
        charge = np.minimum(case.light_e + noise.dark_e + noise.clock_e, detector.full_well_e)
        lost = b * charge**2 / (1.0 + b * charge)
        spread = 2.0 * b * noise.factor2 * charge**2 / case.sigma_e**2

        def slope(planet: Any) -> float:
            behind = max(case.behind_e_s(planet), float(case.light.star_e_s[planet.place].max(initial=0.0)))
            return float(b * t * (2.0 * behind + planet.peak_e_s))

        pixel = float(np.max(lost / case.sigma_e + spread, initial=0.0)) + 2.0 * case.struck() * b * case.hits.typical_e
        return sizes(pixel, case.over_planets(slope))


class Blooming(Effect):
    """Pixel full well: the excess spills along the column, half each way; column ends drain what arrives there."""

    switch, label, law = "blooming", "pixel full well", "the excess blooms along the column"
    stage, in_sums = "charge", "per_electron"
    frame_s = 5e-5

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Spill the mean."""
        self._spill(image, np.zeros(image.shape, dtype=np.bool_), exposure)

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Spill the counts."""
        bottom, top = self._spill(work.image, work.saturated, exposure)
        work.book("drained_bottom", -bottom)
        work.book("drained_top", -top)
        work.counts["n_saturated_pixels"] = int(np.count_nonzero(work.saturated)) if work.image.size else 0

    def draw_sum(self, work: Work, exposure: Exposure, n_frames: int, rng: np.random.Generator) -> None:
        """Leave sums of frames as they are: no frame among them reaches the limit."""

    @staticmethod
    def _spill(image: FloatArray, spilled: np.ndarray, exposure: Exposure) -> tuple[float, float]:
        part = exposure.place.rows, exposure.place.columns
        well = float(math.floor(exposure.detector.full_well_e))
        if image[part].max(initial=0.0) <= well:
            return 0.0, 0.0
        bottom, top = load_kernels(KERNELS).vertical_spill(image[part], well, spilled[part])
        return bottom, top

    def size(self, case: Case) -> Sizes:
        """Return the size of what overflows, and whether it may reach a planet."""
        well = case.detector.full_well_e
        pixel = np.max(case.overflow(case.most_e + case.noise.dark_e, well, 1.0), initial=0.0)
        reached = case.over_planets(lambda planet: case.spilled_on(planet, well, 1.0, case.spill.blooms_into))
        return sizes(float(pixel), reached)


def compressed(level: FloatArray, loss: float, at_level: float) -> FloatArray:
    """Return the smooth saturating response ``x / (1 + b x)`` that misses the fraction ``loss`` at ``at_level``."""
    return level / (1.0 + level * curve(loss, at_level))


def curve(loss: float, at_level: float) -> float:
    """Return ``b`` of the response ``x / (1 + b x)`` that misses the fraction ``loss`` at ``at_level``."""
    return loss / ((1.0 - loss) * at_level)


def pixel_curve(detector: Any) -> float:
    """Return ``b`` of the curve of the pixels, 1/e-."""
    return curve(detector.nonlinearity.pixel_loss_at_full_well, detector.full_well_e)


def output_curve(detector: Any) -> float:
    """Return ``b`` of the curve of the register's output, 1/e-."""
    return curve(detector.nonlinearity.register_loss, detector.nonlinearity.register_loss_at_e)


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

    def size(self, case: Case) -> Sizes:
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

    def size(self, case: Case) -> Sizes:
        """Return the size of the charge that arrives one pixel later."""
        noise, clocks, axis = case.noise, case.detector.transfer, self.axis
        stamp = case.charge_e
        outside = case.light_e[stamp.size :]
        c, elements = self._loss(case.detector), getattr(clocks, self.elements)
        whole = (case.detector.n_rows, case.detector.n_columns)[axis]
        share = 1.0 - math.exp(-c * (case.first_pixel[axis] + elements + len(stamp) + 1))
        edge = 1.0 - math.exp(-c * (whole + elements))
        step = np.abs(np.diff(stamp, axis=axis, prepend=0.0))

        def of_planet(planet: Any) -> float:
            cut = _SHIFT_EDGE if min(abs(planet.x_arcsec), abs(planet.y_arcsec)) < case.edge_arcsec else 0.0
            return float(share * (_SHIFT / case.radius_pixels**2 + cut + _SHIFT_CUT * planet.hidden))

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

    def size(self, case: Case) -> Sizes:
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


Stages = Annotated[int, Field(ge=1, le=10000)]
LargestGain = Annotated[float, Field(ge=1, le=10000)]
StageCharge = Annotated[float, Field(ge=0, le=1)]


class Register(Effect):
    """Random multiplication; without it (switch off) charge is multiplied by the gain exactly."""

    switch, label, law = "em_register", "noise of the EM register", "law of the stage-by-stage cascade"
    stage, in_sums, always = "charge", "per_electron", True
    frame_s = 4e-4

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Multiply."""
        image *= exposure.em_gain

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Multiply at random."""
        work.charge["register_in"] = float(work.image.sum())
        if self.on(exposure.detector):
            amplify(work.image.reshape(-1), exposure.em_gain, exposure.detector.register_stages, rng)
        else:
            work.image *= exposure.em_gain
        work.charge["register_out"] = float(work.image.sum())

    def size(self, case: Case) -> Sizes:
        """Return the share of the variance that the register adds."""
        noise, excess = case.noise, case.noise.factor2 - 1.0
        snr = case.snr_share(*COUNTED, "clock", factor=excess / noise.factor2)
        return sizes(case.variance_change(excess * (case.counted_e + noise.clock_e)), snr=snr)


class RegisterClockCharge(Effect):
    """Electrons that the clocks of the register make, each multiplied by the stages that are left to it.

    ``register_cic_e`` is the mean number made per pixel in one stage.
    """

    switch, label = "register_clock_charge", "clock-induced charge of the register"
    law = "electrons made between the stages"
    stage, in_sums = "charge", "per_electron"
    number = "register_cic_e"
    frame_s = 2e-4

    @staticmethod
    def mean_output_e(detector: Any, em_gain: float) -> float:
        """Return the mean electrons of a pixel at the output.

        ``c`` times the sum of the gains of all remainders of the register, ``c (g - 1) / p``.

        Parameters
        ----------
        detector : Detector
        em_gain : float
            Gain of the register.
        """
        p = float(stage_probability(em_gain, detector.register_stages))
        gains = (em_gain - 1.0) / p if p > 0 else float(detector.register_stages)
        return float(detector.register_cic_e * gains)

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Add the mean."""
        image += self.mean_output_e(exposure.detector, exposure.em_gain)

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add single electrons, each through the rest of the register."""
        detector = exposure.detector
        stages = detector.register_stages
        p = float(stage_probability(exposure.em_gain, stages))
        events = int(rng.poisson(detector.register_cic_e * stages * work.image.size))
        places = rng.integers(0, max(work.image.size, 1), size=events)
        left = rng.integers(0, stages, size=events)
        # Stage by stage, all electrons that still have that many stages before them: exact.
        order = np.argsort(-left, kind="stable")
        grown = np.ones(events, dtype=np.int64)
        for count in np.searchsorted(-left[order], -np.arange(stages, 0, -1), side="right"):
            if count:
                grown[:count] += rng.binomial(grown[:count], p)
        np.add.at(work.image.reshape(-1), places[order], grown)
        work.book("register_clock_charge", float(grown.sum()))

    def size(self, case: Case) -> Sizes:
        """Return the size of its mean and of twice that as variance."""
        made = self.mean_output_e(case.detector, case.em_gain) / case.em_gain
        spread = 2.0 * made
        variance = [case.n_frames * case.light.noise_pixels * spread] * len(case.variances)
        pixel = max(case.mean_change(made), case.variance_change(spread, inside=False))
        return sizes(pixel, snr=case.snr_added(variance))


class RegisterFullWell(Effect):
    """Full well of the register: the excess trails into the pixels read next and drains at the end of the row."""

    switch, label, law = "register_full_well", "register full well", "the excess trails along the row"
    stage, in_sums = "charge", "per_electron"
    frame_s = 1e-4

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Trail the mean."""
        self._trail(image, np.zeros(image.shape, dtype=np.bool_), exposure)

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Trail the counts."""
        trailed = np.zeros(work.image.shape, dtype=np.bool_)
        work.book("drained_row_ends", -self._trail(work.image, trailed, exposure))
        work.counts["n_register_saturated"] = int(np.count_nonzero(trailed))
        work.saturated |= trailed

    def draw_sum(self, work: Work, exposure: Exposure, n_frames: int, rng: np.random.Generator) -> None:
        """Leave sums of frames as they are: no frame among them reaches the limit."""

    @staticmethod
    def _trail(image: FloatArray, trailed: np.ndarray, exposure: Exposure) -> float:
        well = float(math.floor(exposure.detector.register_full_well_e))
        return float(load_kernels(KERNELS).serial_spill(image, well, trailed))

    def size(self, case: Case) -> Sizes:
        """Return the size of what overflows, and whether it may reach a planet."""
        detector, noise = case.detector, case.noise
        well = detector.register_full_well_e / case.em_gain
        held = np.minimum(case.most_e + noise.dark_e, detector.full_well_e if detector.switches.blooming else np.inf)
        pixel = float(np.max(case.overflow(held + noise.clock_e, well, noise.factor2), initial=0.0))
        pixel += case.struck() * case.hits.share_above(well)
        reached = case.over_planets(lambda planet: case.spilled_on(planet, well, noise.factor2, case.spill.trails_into))
        return sizes(pixel, reached)


class OutputNonlinearity(Effect):
    """The output falls behind as the register fills: ``x / (1 + b x)`` through the loss of the configuration.

    It shares switch and row of the non-linearity of the pixels.
    """

    switch = "nonlinearity"
    stage, in_sums = "charge", "not_additive"

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Apply the curve to the mean."""
        numbers = exposure.detector.nonlinearity
        if numbers.register_loss > 0:
            image[...] = compressed(image, numbers.register_loss, numbers.register_loss_at_e)

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Apply the curve to the output, in electrons: no charge is lost."""
        b = output_curve(exposure.detector)
        if b > 0:
            load_kernels(KERNELS).compress(work.image.reshape(-1), b)


ReadNoiseElectrons = Annotated[float, Field(ge=0, le=1e5)]


class BiasStructure(FrozenModel):
    """Structure of the bias: fixed vertical stripes, horizontal interference, drift of the level."""

    stripe_rms_adu: Annotated[float, Field(ge=0, le=1000)]
    interference_adu: Annotated[float, Field(ge=0, le=1000)]
    interference_period_columns: Annotated[float, Field(ge=2, le=1e5)]
    drift_adu: Annotated[float, Field(ge=0, le=1000)]


class ReadNoise(Effect):
    """Gaussian noise of the output amplifier, from electrons at the output to ADU.

    In sums of frames the rounding of the converter is part of the same draw, so that it runs with its switch off.
    """

    switch, label, law = "read_noise", "read noise", "Gaussian"
    stage, always = "voltage", True
    number = "read_noise_e"
    frame_s, colour = 3e-4, "#444444"

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add the noise."""
        noise = self.rms_adu(exposure.detector)
        if noise > 0:
            load_kernels(KERNELS).add_normal(work.image.reshape(-1), noise, rng)

    def draw_sum(self, work: Work, exposure: Exposure, n_frames: int, rng: np.random.Generator) -> None:
        """Add the noise of all frames and of the rounding of each."""
        rms = math.sqrt(n_frames * (self.rms_adu(exposure.detector) ** 2 + 1.0 / 12.0))
        work.image += rms * rng.standard_normal(work.image.shape)

    def rms_adu(self, detector: Any) -> float:
        """Return the rms in ADU; 0 with the switch off."""
        return float(detector.read_noise_e / detector.gain_e_adu) if self.on(detector) else 0.0

    def added(self, detector: Any, exposure_s: float | None = None) -> FrameTerm:
        """Return the variance at the output."""
        return FrameTerm(output_e2=detector.read_noise_e**2)

    def size(self, case: Case) -> Sizes:
        """Return the share of the variance."""
        return sizes(case.variance_change(case.noise.read_e2), snr=case.snr_share("read"))


class _Bias(Effect):
    """Structure of the bias that a reduction takes out; sizes are of what is left without one."""

    stage, in_sums = "voltage", "left_out"

    def variance_adu2(self, detector: Any) -> float:
        """Return the variance of a pixel from frame to frame, ADU^2."""
        raise NotImplementedError

    def size(self, case: Case) -> Sizes:
        """Return the share of its variance."""
        left, per_adu = 0.0 if case.reduced else 1.0, case.detector.gain_e_adu / case.em_gain
        return sizes(left * case.variance_change(self.variance_adu2(case.detector) * per_adu**2, inside=False))


class Stripes(_Bias):
    """Fixed vertical stripes of the bias, one offset a column, from the calibration set."""

    switch, label, law = "stripes", "stripes of the bias", "one offset a column"
    seeded = True
    number, map_kind = "bias_structure.stripe_rms_adu", "bias"
    frame_s = 5e-5

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Add the stripes."""
        if exposure.stripe_adu is not None:
            image += exposure.stripe_adu

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add the stripes."""
        self.expect(work.image, exposure)

    def draw_sum(self, work: Work, exposure: Exposure, n_frames: int, rng: np.random.Generator) -> None:
        """Leave sums without the fixed bias."""

    def row(self, setting: Setting) -> tuple[str, str]:
        """Return how it is modelled, and why it does not exist; empty if it does."""
        file = self.file_of(setting.detector)
        # The map holds whatever structure the bias has, and no switch takes it off.
        return (f"replaced by the map {file}, level and structure", "") if file else super().row(setting)

    def size(self, case: Case) -> Sizes:
        """Return the size of the largest stripe of what is read."""
        largest = case.largest_stripe_adu * case.detector.gain_e_adu / case.em_gain
        return sizes((0.0 if case.reduced else 1.0) * case.mean_change(largest))


class Interference(_Bias):
    """Electrical pick-up during readout: a sine in the order in which pixels are read, of random phase in each frame.

    ``interference_period_columns`` need not fit a line, so that the waves run obliquely across the rows.
    """

    switch, label, law = "interference", "interference of the bias", "a wave in the order of readout"
    number = "bias_structure.interference_adu"
    frame_s = 2e-4

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add one wave."""
        self.add_wave(work.image, exposure, np.exp(2j * np.pi * rng.random()))

    def draw_sum(self, work: Work, exposure: Exposure, n_frames: int, rng: np.random.Generator) -> None:
        """Add the wave that the phases of all frames leave."""
        self.add_wave(work.image, exposure, np.exp(2j * np.pi * rng.random(n_frames)).sum())

    def add_wave(self, image: FloatArray, exposure: Exposure, phasor: complex) -> None:
        """Add a wave of the configured amplitude times that of the phasor, and its phase.

        Parameters
        ----------
        image : ndarray
            Image in ADU, (y, x), changed in place.
        exposure : Exposure
        phasor : complex
        """
        structure = exposure.detector.bias_structure
        if structure.interference_adu == 0:
            return
        row, column = wave_angles(exposure.detector, image.shape, exposure.place.first_row, exposure.place.first_column)
        row += np.angle(phasor)
        # sin(a + b) of a row's and a column's angle
        wave = np.stack([np.sin(row), np.cos(row)], axis=1) @ np.stack([np.cos(column), np.sin(column)])
        image += wave * (structure.interference_adu * abs(phasor))

    def variance_adu2(self, detector: Any) -> float:
        """Return the variance of a sine of random phase."""
        return float(detector.bias_structure.interference_adu**2 / 2.0)


class BiasDrift(_Bias):
    """Level of the bias from frame to frame: Gaussian, the same for all pixels of a frame."""

    switch, label, law = "bias_drift", "drift of the bias", "one offset a frame"
    number = "bias_structure.drift_adu"
    frame_s = 1e-4

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add one offset."""
        self.draw_sum(work, exposure, 1, rng)

    def draw_sum(self, work: Work, exposure: Exposure, n_frames: int, rng: np.random.Generator) -> None:
        """Add the offsets of all frames."""
        work.image += math.sqrt(n_frames) * exposure.detector.bias_structure.drift_adu * rng.standard_normal()

    def variance_adu2(self, detector: Any) -> float:
        """Return the variance of the level."""
        return float(detector.bias_structure.drift_adu**2)


class Quantisation(Effect):
    """Bias level, rounding to whole ADU and range of the converter; it has no switch and both cameras do it last."""

    switch, label, law = "quantisation", "bias level, quantisation, range of the converter", "cut off and counted"
    stage, fixed = "voltage", True
    term, term_label, colour = "rounding", "rounding to whole ADU", "#BBBBBB"

    def added(self, detector: Any, exposure_s: float | None = None) -> FrameTerm:
        """Return the variance of rounding at the output, uniform over one ADU: of what several reads are reduced to."""
        return FrameTerm(output_e2=detector.gain_e_adu**2 / 12.0)

    def size(self, case: Case) -> Sizes:
        """Return the share of the variance."""
        return sizes(case.variance_change(case.noise.rounding_e2), snr=case.snr_share("rounding"))


def wave_angles(
    detector: Any, shape: tuple[int, ...], first_row: int, first_column: int
) -> tuple[FloatArray, FloatArray]:
    """Return the phases of the interference along rows and columns: that of a pixel is the sum of both.

    Parameters
    ----------
    detector : Detector
    shape : tuple of int
        Rows and columns of the image.
    first_row, first_column : int
        Pixel of the frame that the image begins with.
    """
    turn = 2.0 * np.pi / detector.bias_structure.interference_period_columns
    row = turn * detector.n_columns * (first_row + np.arange(shape[0]))
    return row, turn * (first_column + np.arange(shape[1]))
