"""Optical transfer functions: what a band, or a point-spread function from a file, does to the spectrum of a scene.

A scene is synthesised from harmonics of a period longer than the displacements (pixel minus source) that occur in it.
The wings of a hard-edged pupil fall off as the inverse square only, 1e-5 of the peak at 10 arcsec, and would fold in
from the next period. So the point-spread function is first multiplied by a window that is one on all displacements
that occur and falls to zero before the period ends. No light folds; what remains is the leakage of the window,
1e-9 of the *local* level of the wings, because the window is a box smoothed by a Kaiser-Bessel bell (Kaiser & Schafer
1980), the shortest practical bell for a given leakage. No kernel is cut off, and nothing rings.
"""

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from cpic_core import ComplexArray, FloatArray, InputError, NDArray
from simulator.config import ARCSEC_PER_RAD
from simulator.imaging.imager import Imager
from simulator.imaging.pupil_symmetry import HalfWaves, add_intensity, mirrored_waves, parts_of, quadrants_of, unfolded

BELL = 23.0  # of the Kaiser-Bessel bell: leakage about exp(-BELL)
# (half width of the bell) x (frequency from which its transform stays below the leakage)
BELL_PRODUCT = BELL / (2.0 * math.pi)
LONGEST_AXIS = 5000  # harmonics an axis; the arrays stay below 1 GB
SHORTEST_CYCLES = 20.0  # of the cutoff frequency: beyond the core, where the window leaks less
JITTER_REACH = 7.0  # standard deviations


@dataclass(frozen=True, eq=False)
class FrequencyAxis:
    """Harmonics ``k / period``, ``|k| <= count // 2``, of one axis.

    Attributes
    ----------
    low_arcsec, high_arcsec : float
        Displacements pixel minus source on which the synthesis holds.
    period_arcsec : float
        Period of the synthesis.
    count : int
        Number of harmonics, odd; also the number of samples a period.
    centre_arcsec : float
        Displacement that the phases of the transfer function refer to.
    """

    low_arcsec: float
    high_arcsec: float
    period_arcsec: float
    count: int
    centre_arcsec: float

    @property
    def frequencies(self) -> FloatArray:
        """Harmonics 0 to ``count // 2`` in cycles per arcsec."""
        return np.arange(self.count // 2 + 1) / self.period_arcsec

    @property
    def samples_arcsec(self) -> FloatArray:
        """One period of displacements relative to the centre, in the order of an FFT: from zero up, then below zero."""
        return np.asarray(np.fft.fftfreq(self.count) * self.period_arcsec, dtype=np.float64)

    @property
    def window(self) -> FloatArray:
        """Weights of the samples: one between low and high, smoothly to zero at the ends of the period."""
        flat = (self.high_arcsec - self.low_arcsec) / 2.0
        bell = (self.period_arcsec / 2.0 - flat) / 2.0
        return _bell_integral((flat + bell - np.abs(self.samples_arcsec)) / bell)


@dataclass(frozen=True, eq=False)
class BandTransfer:
    """Transfer function of the optics of a band, pointing jitter included, pixel not.

    Attributes
    ----------
    imager : Imager
        Optical model: wavelengths, apodizer, static wavefront, mirror and jitter are all honoured.
    """

    imager: Imager

    @property
    def native_pixel_arcsec(self) -> None:
        """Any pixel can be integrated over."""
        return

    @property
    def reach_arcsec(self) -> float:
        """Diffraction has no end."""
        return math.inf

    @property
    def cutoff_per_arcsec(self) -> float:
        """Highest frequency that the pupil passes, per axis: its diameter over the shortest wavelength."""
        return self.imager.diameter_m / float(self.imager.wavelengths_m.min()) / ARCSEC_PER_RAD

    def axis(self, low_arcsec: float, high_arcsec: float) -> FrequencyAxis:
        """Return the harmonics that serve the displacements from low to high, as few as the window's flanks allow.

        Parameters
        ----------
        low_arcsec : float
            Lower edge, arcsec.
        high_arcsec : float
            Upper edge, arcsec.

        Raises
        ------
        InputError
            If the displacements span more than the memory can hold (about 100 arcsec at 520 nm).
        """
        margin = JITTER_REACH * self.imager.jitter_arcsec
        low, high = low_arcsec - margin, high_arcsec + margin
        length = max(high - low, SHORTEST_CYCLES / self.cutoff_per_arcsec)
        # The fewest of (length + 4 bell) * 2 (cutoff + BELL_PRODUCT / bell) samples.
        bell = 0.5 * math.sqrt(length * BELL_PRODUCT / self.cutoff_per_arcsec)
        period = length + 4.0 * bell
        count = _odd_fast_length(period * 2.0 * (self.cutoff_per_arcsec + BELL_PRODUCT / bell))
        if count > LONGEST_AXIS:
            unit = "arcsec from end to end, window and sources together"
            hint = "image its parts one by one and add them"
            allowed = f"up to about {LONGEST_AXIS / 2.5 / self.cutoff_per_arcsec:.0f} arcsec"
            raise InputError("scene", round(length, 1), unit=unit, allowed=allowed, hint=hint)
        centre = 0.5 * (low + high)
        return FrequencyAxis(centre - length / 2.0, centre + length / 2.0, period, count, centre)

    def values(self, y: FrequencyAxis, x: FrequencyAxis) -> ComplexArray:
        """Return the transfer function on the harmonics, of the light within the window.

        Parameters
        ----------
        y, x : FrequencyAxis
            Axes from `axis`.

        Returns
        -------
        ndarray of complex128, shape (y.count, x.count // 2 + 1)
            Rows in the order of an FFT, columns from zero up; phases relative to the centres of the axes. Its scale:
            1 would pass the energy on the clear pupil disc.
        """
        kernel = _intensity(self.imager, y, x)
        cell_sr = y.period_arcsec / y.count * x.period_arcsec / x.count / ARCSEC_PER_RAD**2
        kernel *= (y.window * cell_sr)[:, None]
        kernel *= x.window
        spectrum: ComplexArray = np.fft.rfft2(kernel)
        if self.imager.jitter_arcsec > 0:
            spectrum *= _gaussian(y.frequencies, self.imager.jitter_arcsec)[_mirrored(y.count), None]
            spectrum *= _gaussian(x.frequencies, self.imager.jitter_arcsec)
        return spectrum


@dataclass(frozen=True, eq=False)
class KernelTransfer:
    """Transfer function of a pixel-integrated point-spread function, for example one from a file.

    Sources between pixels see the band-limited interpolation of the kernel, which is exact for a kernel sampled
    finer than lambda/2D that has faded at its edge. At an edge that has not faded it rings by a fraction of the edge's
    own level; what falls below zero is set to zero in images.

    Attributes
    ----------
    kernel : ndarray, shape (n, n), n odd
        Light in every pixel for a source of unit flux on the central pixel, not negative.
    pixel_scale_arcsec : float
        Pixel of the kernel, which must be that of the detector.

    Raises
    ------
    InputError
        If the kernel is not a finite, non-negative square map of odd side, or the pixel scale is not positive.
    """

    kernel: FloatArray
    pixel_scale_arcsec: float

    def __post_init__(self) -> None:
        """Check the kernel."""
        kernel = np.asarray(self.kernel, dtype=np.float64)
        if kernel.ndim != 2 or kernel.shape[0] != kernel.shape[1] or kernel.shape[0] % 2 == 0:
            raise InputError("kernel", f"shape {kernel.shape}", unit="px", allowed="a square of odd side")
        if not np.isfinite(kernel).all() or (kernel < 0).any():
            bad = int(np.count_nonzero(~(np.isfinite(kernel) & (kernel >= 0))))
            raise InputError("kernel", f"{bad} bad pixels", allowed="finite values >= 0")
        if not (math.isfinite(self.pixel_scale_arcsec) and self.pixel_scale_arcsec > 0):
            raise InputError("pixel_scale_arcsec", self.pixel_scale_arcsec, unit="arcsec", allowed="> 0")
        object.__setattr__(self, "kernel", kernel)

    @property
    def native_pixel_arcsec(self) -> float:
        """The pixel that the kernel was integrated over."""
        return self.pixel_scale_arcsec

    @property
    def reach_arcsec(self) -> float:
        """Half the kernel and a pixel."""
        return float((self.kernel.shape[0] // 2 + 1) * self.pixel_scale_arcsec)

    @property
    def cutoff_per_arcsec(self) -> float:
        """Highest frequency that the pixels carry, per axis."""
        return 0.5 / self.pixel_scale_arcsec

    def axis(self, low_arcsec: float, high_arcsec: float) -> FrequencyAxis:
        """Return the harmonics whose samples are the pixels of the kernel, padded until nothing folds.

        Parameters
        ----------
        low_arcsec : float
            Lower edge, arcsec.
        high_arcsec : float
            Upper edge, arcsec.

        Raises
        ------
        InputError
            If that takes more pixels than the memory can hold.
        """
        farthest = max(abs(low_arcsec), abs(high_arcsec))
        count = _odd_fast_length((farthest + self.reach_arcsec) / self.pixel_scale_arcsec + self.kernel.shape[0] // 2)
        if count > LONGEST_AXIS:
            unit = "arcsec from end to end"
            allowed = f"up to {LONGEST_AXIS} pixels"
            hint = "image its parts one by one"
            raise InputError("scene", round(high_arcsec - low_arcsec, 1), unit=unit, allowed=allowed, hint=hint)
        return FrequencyAxis(low_arcsec, high_arcsec, count * self.pixel_scale_arcsec, count, 0.0)

    def values(self, y: FrequencyAxis, x: FrequencyAxis) -> ComplexArray:
        """Return the transfer function on the harmonics, the pixel's own divided out (it is 0.64 or more on each axis).

        Parameters
        ----------
        y, x : FrequencyAxis
            Axes from `axis`.

        Returns
        -------
        ndarray of complex128, shape (y.count, x.count // 2 + 1)
        """
        offsets = np.arange(self.kernel.shape[0]) - self.kernel.shape[0] // 2
        padded = np.zeros((y.count, x.count))
        padded[np.ix_(offsets, offsets)] = self.kernel  # negative offsets at the end, as an FFT wants them
        spectrum: ComplexArray = np.fft.rfft2(padded)
        spectrum /= np.sinc(y.frequencies * self.pixel_scale_arcsec)[_mirrored(y.count), None]
        spectrum /= np.sinc(x.frequencies * self.pixel_scale_arcsec)
        return spectrum


Transfer: TypeAlias = BandTransfer | KernelTransfer
"""Anything that can image a scene: ``axis`` serves displacements, ``values`` has the transfer function on them."""


def _intensity(imager: Imager, y: FrequencyAxis, x: FrequencyAxis) -> FloatArray:
    """Return the band-averaged intensity per steradian on the samples of two axes, each in the order of an FFT.

    The samples lie symmetrically about the centre of their axis. With the phases of the centre in the pupil, parity
    (`simulator.imaging.pupil_symmetry`) takes a quarter of the multiplications; the envelope of a pupil sample, which
    is not symmetric about the centre, comes last.
    """
    samples, step = len(imager.transmission), imager.diameter_m / len(imager.transmission)
    dtype = np.empty(0, imager.knobs.field_dtype).real.dtype
    position = np.arange(samples) - (samples - 1) / 2
    sizes = y.count // 2 + 1, x.count // 2 + 1
    total = np.zeros((2, 2, *sizes))
    for index, (wavelength, weight) in enumerate(zip(imager.wavelengths_m, imager.weights, strict=True)):
        per_arcsec = step / float(wavelength) / ARCSEC_PER_RAD  # cycles a pupil sample
        # Light on the clear disc is one, and a pixel of the field is a steradian.
        scale = math.sqrt(weight) * step**2 / (float(wavelength) * math.sqrt(math.pi / 4.0) * imager.diameter_m)
        waves: list[HalfWaves] = []
        phases, envelopes = [], []
        for axis in (y, x):
            cycles = axis.period_arcsec / axis.count * per_arcsec
            upper: FloatArray = np.arange(axis.count // 2 + 1, dtype=np.float64) * cycles
            known = waves and (axis.period_arcsec, axis.count) == (y.period_arcsec, y.count)
            waves.append(waves[0] if known else mirrored_waves(upper, samples, dtype))
            centre = axis.centre_arcsec * per_arcsec
            phases.append(np.exp(-2j * np.pi * centre * position))
            envelopes.append(scale * np.sinc(np.stack([centre + upper, centre - upper])) ** 2)
        pupil = imager.pupil(index) * phases[0][:, None] * phases[1]
        parts = parts_of(quadrants_of(pupil.real), quadrants_of(pupil.imag), dtype)
        add_intensity(total, parts, waves[0], waves[1], (envelopes[0], envelopes[1]))
    return unfolded(total, (y.count, x.count), (_sides(y.count), _sides(x.count)))


def _sides(count: int) -> list[tuple[slice, slice]]:
    """Return where the samples of either side of an axis go in the order of an FFT, and which of them."""
    return [(slice(0, count // 2 + 1), slice(None)), (slice(count - 1, count // 2, -1), slice(1, None))]


def _gaussian(frequencies: FloatArray, sigma_arcsec: float) -> FloatArray:
    return np.asarray(np.exp(-2.0 * (np.pi * sigma_arcsec * frequencies) ** 2), dtype=np.float64)


def _mirrored(count: int) -> NDArray[np.intp]:
    """Return the index of the absolute frequency of every row of an FFT of odd length."""
    steps = np.arange(count)
    return np.minimum(steps, count - steps)


def _bell_integral(u: FloatArray) -> FloatArray:
    """Return the integral of the Kaiser-Bessel bell on [-1, 1] up to u, scaled to run from 0 to 1."""
    from scipy.special import i0e

    nodes, weights = np.polynomial.legendre.leggauss(48)
    integral = np.where(u >= 1.0, 1.0, 0.0)
    flank = np.abs(u) < 1.0
    span = u[flank] + 1.0
    points = 0.5 * span[:, None] * (nodes + 1.0) - 1.0
    root = np.sqrt(np.maximum(1.0 - points**2, 0.0))
    part = 0.5 * span * ((i0e(BELL * root) * np.exp(BELL * (root - 1.0))) @ weights)
    root = np.sqrt(1.0 - nodes**2)
    integral[flank] = part / ((i0e(BELL * root) * np.exp(BELL * (root - 1.0))) @ weights)
    return integral


def _odd_fast_length(least: float) -> int:
    """Return the smallest odd integer >= least that is a product of 3, 5, 7 and 11."""
    count = math.ceil(least) | 1
    while True:
        rest = count
        for prime in (3, 5, 7, 11):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return count
        count += 2
