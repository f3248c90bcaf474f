"""The near-infrared camera: from photon rate to the numbers of a frame, read once, twice, or up the ramp.

Light goes through the response of the pixels and dark current is added (`InfraredCamera.prepare`, noise-free, once for
a sequence). Each frame then collects photons, dark current, persistence and cosmic rays, and is read without
destroying the charge: non-linearity and full well, inter-pixel capacitance, reset and read noise, bias and range of the
converter. Reads are reduced before they are rounded to whole ADU.
"""

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, PathPart, Reason, checked_scalar
from simulator import detectors
from simulator.camera.camera import (
    MARGIN_SIGMA,
    MAX_EXPOSURE_S,
    MAX_MEAN_E,
    Camera,
    begun,
    corner_of,
    flaws_of,
    means,
    run,
)
from simulator.camera.frame import Frame, MaskBit, checked_rates
from simulator.config import CosmicRayConfig, InfraredDetector, ReadoutMode


def read_times(mode: ReadoutMode, n_reads: int) -> FloatArray:
    """Return the times of the reads as fractions of the exposure: the last is at its end."""
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
        """Return ADU before rounding, pixels that say nothing about their light, and pixels beyond the converter.

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


MAX_RATE_E_S = 1e300


class _GivenHits(NamedTuple):
    """Particles that the caller gives instead of those that the camera draws."""

    map_e: FloatArray
    n_events: int

    def image(self) -> FloatArray:
        """Return the electrons per pixel."""
        return self.map_e


@dataclass(frozen=True, eq=False, kw_only=True)
class InfraredExposure(detectors.Exposure):
    """The noise-free part of a frame: made once, exposed many times.

    Attributes
    ----------
    light_e, dark_e : ndarray
        Mean electrons that every pixel collects from light and as dark current.
    expected_adu : ndarray
        Mean ADU of every pixel, without noise, rounding, cosmic rays and persistence. Where a limit cuts off only the
        upper tail of the counts (within a few sigma of full well) the mean of noisy frames differs.
    n_reads : int
        Reads that are taken between the first (the reset, for a single read) and the end of the exposure.
    """

    light_e: FloatArray
    dark_e: FloatArray
    expected_adu: FloatArray
    n_reads: int  # type: ignore[misc]


class InfraredCamera(Camera):
    """The near-infrared camera.

    Parameters
    ----------
    detector : InfraredDetector
        Everything about the camera, switches included.
    cosmic_rays : CosmicRayConfig, optional
        Particles; none without it.
    cosmic_ray_rate_per_s_cm2 : float
        Their rate at the date of the observation.
    persistence : LateCharge, optional
        What earlier frames leave; `simulator.detectors.infrared.ExponentialPersistence` of the configuration if not
        given.
    coupling : Coupling, optional
        Inter-pixel capacitance; the four nearest neighbours with ``interpixel_coupling`` if not given.

    Raises
    ------
    InputError
        For a plug-in whose switch is off, or a rate out of range.
    """

    detector: InfraredDetector

    def __init__(
        self,
        detector: InfraredDetector,
        *,
        cosmic_rays: CosmicRayConfig | None = None,
        cosmic_ray_rate_per_s_cm2: float = 0.0,
        persistence: detectors.LateCharge | None = None,
        coupling: detectors.Coupling | None = None,
    ) -> None:
        rate = checked_scalar("cosmic_ray_rate_per_s_cm2", cosmic_ray_rate_per_s_cm2, low=0.0, high=1e12)
        for key, given in (("persistence", persistence), ("interpixel_capacitance", coupling)):
            if given is not None and not getattr(detector.switches, key):
                raise InputError(f"near_infrared.detector.switches.{key}", False, allowed="true with a plug-in for it")
        instead = detectors.Persistence(persistence), detectors.InterpixelCapacitance(coupling)
        chain = tuple(next((own for own in instead if own.switch == one.switch), one) for one in detector.chain)
        super().__init__(detector, cosmic_rays=cosmic_rays, cosmic_ray_rate_per_s_cm2=rate, chain=chain)

    def _there(self, effect: Any) -> bool:
        return True  # particles can be given frame by frame

    def prepare(
        self, rate_map_e_s: ArrayLike, exposure_s: float, *, first_pixel: tuple[int, int] | None = None
    ) -> InfraredExposure:
        """Return the noise-free part of a frame.

        Parameters
        ----------
        rate_map_e_s : array_like
            Photo-electrons per second and pixel, 2-D (y, x): the whole frame, or a window of it.
        exposure_s : float
            Exposure of the frame, 0 to 1e6 s (0 is a bias frame).
        first_pixel : tuple of int, optional
            Row and column of the frame at which a window begins; around the star if not given.

        Raises
        ------
        InputError
            For a rate that is NaN, infinite or more negative than 1e-9 of the largest (naming the pixel), an exposure
            out of range, or a window that reaches beyond the frame while flaws of pixels are switched on.
        """
        detector, switches = self.detector, self.detector.switches
        rates, n_negative = checked_rates(rate_map_e_s)
        time = checked_scalar("exposure_s", exposure_s, low=0.0, high=MAX_EXPOSURE_S, unit="s")
        corner = corner_of(detector, rates.shape, first_pixel)
        flaws = flaws_of(detector, rates.shape, corner)
        # The cap keeps products of the largest rates finite.
        light = np.minimum(rates, MAX_RATE_E_S)
        if flaws is not None:
            light = light * flaws.response_of(switches)
            dark, mask = flaws.dark_of(switches), flaws.mask_of(switches)
        else:
            dark = np.full(rates.shape, detector.dark_e_s if switches.dark else 0.0)
            mask = np.zeros(rates.shape, dtype=np.uint8)
        light_e, dark_e = np.minimum(light * time, MAX_MEAN_E), np.minimum(dark * time, MAX_MEAN_E)
        rows, columns = rates.shape
        place = detectors.Place(slice(0, rows), slice(0, columns), *(corner or (0, 0)), corner is None)
        exposure = InfraredExposure(
            detector,
            place,
            time,
            1.0,
            light_e + dark_e,
            flaws=mask,
            n_negative_rates=n_negative,
            tracks=self._tracks(detector, time) if time > 0 else None,
            light_e=light_e,
            dark_e=dark_e,
            expected_adu=light_e,
            n_reads=detector.reads_of(time),
        )
        stack, collected = self._stack(rates.shape), means(self.charge, exposure.mean_e.copy(), exposure)
        for fraction in read_times(detector.readout_mode, exposure.n_reads):
            charge = fraction * collected
            full = charge >= detector.full_well_e
            stack.add(float(fraction), self._adu(means(self.voltage, charge, exposure)), full)
        return dataclasses.replace(exposure, expected_adu=stack.result()[0])

    def expected_adu(self, exposure: InfraredExposure) -> FloatArray:
        """Return the mean ADU of every pixel; see `InfraredExposure`."""
        return exposure.expected_adu

    def expose(
        self,
        exposure: InfraredExposure,
        *,
        seed: int,
        path: Sequence[PathPart],
        cosmic_rays: detectors.Hits | None = None,
        past: Sequence[detectors.PastExposure] = (),
    ) -> Frame:
        """Return one noisy frame.

        Parameters
        ----------
        exposure : InfraredExposure
            What `prepare` made.
        seed : int
            Seed of the run.
        path : sequence of str or int
            Names of target, role, band, realisation, frame. Each effect draws from ``stream(seed, *path, switch)``;
            ``arrivals`` and ``cosmic_ray_times`` are the streams of what arrives when.
        cosmic_rays : tuple of array_like, optional
            Flat pixel indices and electrons of what particles left during the exposure, instead of those that the
            camera draws. Left out where their switch is off. In a ramp, pixels that touch were hit at one time.
        past : sequence of PastExposure, optional
            Earlier frames and their age, for persistence; of no effect where its switch is off.

        Returns
        -------
        Frame
            ``charge`` holds the electrons of the frame: ``photons``, ``dark``, ``persistence`` and ``cosmic_rays`` came
            in, ``stored`` stayed in the pixels and ``lost_full_well`` did not.

        Raises
        ------
        InputError
            For a path that is a string, hits outside the array, or charges of past frames that do not fit.
        """
        detector = self.detector
        work = begun(exposure, seed, path, past)
        if cosmic_rays is not None:
            hits = detectors.checked_hits(cosmic_rays, work.image.shape)
            given = _GivenHits(hits, detectors.tracks_of(hits > 0)[1])
            exposure = dataclasses.replace(exposure, tracks=lambda shape, rng: given)
        run(self.charge, work, exposure)
        collected, stack = work.image, self._stack(work.image.shape)
        streams = {effect.switch: work.stream(effect.switch) for effect in self.voltage}
        for fraction, charge in self._collect(collected, exposure, work.stream("arrivals")):
            work.image = charge + self._struck(work, fraction)
            work.saturated = work.image >= detector.full_well_e
            for effect in self.voltage:
                effect.draw(work, exposure, streams[effect.switch])
            stack.add(fraction, self._adu(work.image), work.saturated)
        adu, lost, clipped = stack.result()
        mask = exposure.flaws | np.where(lost, np.uint8(MaskBit.SATURATED), np.uint8(0))
        if work.cosmic is not None:
            mask[work.cosmic] |= np.uint8(MaskBit.COSMIC_RAY)
            collected = collected + work.held[detectors.HITS]
        work.book("lost_full_well", np.maximum(collected - detector.full_well_e, 0.0).sum())
        work.book("stored", np.minimum(collected, detector.full_well_e).sum())
        work.counts["n_negative_rates"] = exposure.n_negative_rates
        work.counts["n_saturated_pixels"] = int(np.count_nonzero(work.saturated))
        whole, n_clipped = np.rint(adu).astype(np.uint16), int(np.count_nonzero(clipped))
        return Frame(whole, mask, work.charge, n_clipped, **work.counts)

    def fills(self, exposure: detectors.Exposure) -> dict[Reason, float]:
        """Return how far frames fill every limit; see `Camera`."""
        detector, peak_e = exposure.detector, float(exposure.mean_e.max())
        charge_e = peak_e + MARGIN_SIGMA * math.sqrt(peak_e)
        swing_e = MARGIN_SIGMA * math.hypot(detector.read_noise_e, detector.reset_noise_e)
        below_e, room_e = detector.bias_adu * detector.gain_e_adu, detector.converter_e - swing_e
        return {
            Reason.PIXEL_FULL_WELL: charge_e / detector.full_well_e,
            Reason.ADC_RANGE: math.inf if swing_e > below_e or room_e <= 0 else charge_e / room_e,
        }

    def summed(self, exposure: Any, n_frames: int, work: detectors.Work) -> FloatArray:
        """Return the sum of frames; see `Camera`: numbers of equal reads add up, and so do slopes through them."""
        detector = exposure.detector
        whole = dataclasses.replace(exposure, mean_e=n_frames * exposure.mean_e)
        streams = {effect.switch: work.stream(effect.switch) for effect in (*self.charge, *self.voltage)}
        for effect in self.charge:
            effect.draw_sum(work, whole, n_frames, streams[effect.switch])
        bias_adu = n_frames * detector.bias_adu
        stack = ReadStack(detector.readout_mode, work.image.shape, bias_adu, n_frames * detector.adc_max_adu)
        for fraction, charge in self._collect(work.image, whole, work.stream("arrivals")):
            work.image = charge
            for effect in self.voltage:
                effect.draw_sum(work, whole, n_frames, streams[effect.switch])
            stack.add(fraction, work.image / detector.gain_e_adu + bias_adu, work.saturated)
        rounded = math.sqrt(n_frames / 12.0) * work.stream("quantisation").standard_normal(work.image.shape)
        return np.asarray((stack.result()[0] - bias_adu + rounded) * detector.gain_e_adu)

    def to_electrons(self, adu: ArrayLike) -> FloatArray:
        """Return the electrons collected, as far as ADU tell: ``(adu - bias) gain_e_adu``, dark current included."""
        return (np.asarray(adu, dtype=np.float64) - self.detector.bias_adu) * self.detector.gain_e_adu

    def _stack(self, shape: tuple[int, ...]) -> ReadStack:
        return ReadStack(self.detector.readout_mode, shape, self.detector.bias_adu, self.detector.adc_max_adu)

    def _adu(self, signal_e: FloatArray) -> FloatArray:
        return signal_e / self.detector.gain_e_adu + self.detector.bias_adu

    @staticmethod
    def _struck(work: detectors.Work, fraction: float) -> FloatArray | float:
        """Return the charge of particles at a read."""
        if detectors.HITS not in work.held or fraction == 0.0:
            return 0.0
        hits, arrival = work.held[detectors.HITS], work.held.get(detectors.ARRIVAL)
        return hits if arrival is None else np.where(arrival <= fraction, hits, 0.0)

    def _collect(
        self, total: FloatArray, exposure: InfraredExposure, rng: np.random.Generator
    ) -> Iterator[tuple[float, FloatArray]]:
        """Yield the charge at each read: electrons arrive at independent, uniform times."""
        fractions = read_times(self.detector.readout_mode, exposure.n_reads)
        if not self.detector.switches.photon_noise:
            yield from ((float(fraction), fraction * total) for fraction in fractions)
            return
        left, here, before = total.astype(np.int64), np.zeros(total.shape, dtype=np.int64), 0.0
        for fraction in fractions:
            if fraction == 1.0:
                here = here + left
            elif fraction > before:
                step = rng.binomial(left, (fraction - before) / (1.0 - before))
                here, left = here + step, left - step
            before = float(fraction)
            yield before, here.astype(np.float64)
