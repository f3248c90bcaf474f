"""Wavefront drift: random phase screens, and the stamps of the star in every frame of a visit.

A screen is a Gaussian random Fourier series with frequencies 0.5 to 32 cycles per pupil diameter (step 0.5) and
power ``max(f, 1)^-slope``, without piston and tip/tilt: the fine-guidance loop holds the star on the mask, and
what it leaves is pointing jitter, not drift. Screens are scaled by the *expected* rms over the clear disc, so their
rms scatters from draw to draw as a Gaussian process does. The coefficients do not depend on the pupil sampling:
every fidelity sees the same screen.

A visit has one offset screen, frozen, plus a random walk from frame to frame; science and reference visits draw
from different streams. The residual speckle ``|dE|^2 + 2 Re(E0* dE)`` is not assembled from parts: every frame
is a full propagation of the pupil with static wavefront, mirror and drift in it.

What visits of a programme share (`SharedTerms`): a part of their offsets, a screen that all science visits have and
references have not, and one map that swings with the orbit. `Timing` says when in the orbit a visit's light is taken.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import field
from typing import Protocol

import numpy as np

from cpic_core import FloatArray, Record
from simulator.config import Drift, Timing
from simulator.imaging.imager import FocalGrid, Imager

STEP_CYCLES = 0.5
LAST_INDEX = 63  # of frequencies in steps: below 32 cycles per diameter, what 64 samples can hold
_FEWEST_SAMPLES = 64
FLAT_BELOW_CYCLES = 1.0


@functools.lru_cache(maxsize=8)
def low_order_map(samples: int) -> FloatArray:
    """Return defocus, two astigmatisms, two comas and spherical aberration in equal parts, of unit rms in all.

    Parameters
    ----------
    samples : int
        Samples of the pupil grid a side.

    Returns
    -------
    ndarray, shape (samples, samples)
    """
    axis = (np.arange(samples) + 0.5) / samples * 2.0 - 1.0
    x, y = np.meshgrid(axis, axis)
    r2 = x**2 + y**2
    terms = (
        math.sqrt(3.0) * (2.0 * r2 - 1.0),
        math.sqrt(6.0) * (x**2 - y**2),
        math.sqrt(6.0) * 2.0 * x * y,
        math.sqrt(8.0) * (3.0 * r2 - 2.0) * x,
        math.sqrt(8.0) * (3.0 * r2 - 2.0) * y,
        math.sqrt(5.0) * (6.0 * r2**2 - 6.0 * r2 + 1.0),
    )
    total = sum(terms[1:], terms[0])
    total /= math.sqrt(float((total[r2 <= 1.0] ** 2).mean()))
    total.flags.writeable = False
    return total


class HoldsImager(Protocol):
    """Carrier of an optical model: a PSF, or the transforms of a model to some pixels."""

    @property
    def imager(self) -> Imager:
        """The optical model."""


class Screens(Protocol):
    """Random wavefronts of one spectrum, as maps of the pupil or as other numbers that tell them."""

    def draw(self, rng: np.random.Generator, rms_nm: float) -> FloatArray:
        """Return one wavefront of an expected rms over the disc, nm."""

    @property
    def low_order(self) -> FloatArray:
        """The `low_order_map`, nm."""


class ScreenModel(Record, eq=False):
    """Generator of phase screens on an ``n x n`` pupil grid.

    Attributes
    ----------
    amplitude : ndarray, shape (64, 127)
        Rms of the real part of each coefficient at unit rms of the screen; rows f_y >= 0, columns f_x.
    cosine, sine : ndarray, shape (64, h)
        Waves of the frequencies from zero up at the sample centres of the upper half of an axis: opposite samples, and
        opposite frequencies, differ by the sign of the sine.
    removed : ndarray, shape (3, n, n)
        Piston, tip and tilt, orthonormal over the disc and zero outside it.
    planes : ndarray, shape (3, n, n)
        The same without the edge.
    """

    amplitude: FloatArray
    cosine: FloatArray
    sine: FloatArray
    removed: FloatArray
    planes: FloatArray

    def draw(self, rng: np.random.Generator, rms_nm: float) -> FloatArray:
        """Return one screen: optical path difference in nm, shape (n, n), expected rms ``rms_nm`` over the disc.

        Parameters
        ----------
        rng : numpy.random.Generator
            Source of random numbers; a seed gives the same draws.
        rms_nm : float
            Root mean square over the disc, nm.
        """
        real, imaginary = rng.standard_normal((2, *self.amplitude.shape))
        scale = rms_nm * self.amplitude
        screen = self._series(scale * real, scale * imaginary)
        content = self.removed.reshape(3, -1) @ screen.ravel()
        screen -= (content @ self.planes.reshape(3, -1)).reshape(screen.shape)
        return screen

    @property
    def low_order(self) -> FloatArray:
        """The `low_order_map` on this grid."""
        return low_order_map(self.planes.shape[-1])

    def variance(self, readings: FloatArray) -> FloatArray:
        """Return the variance of linear readings of a screen of 1 nm, exact, shape (...).

        Parameters
        ----------
        readings : ndarray, shape (..., n, n)
            Maps; a reading is the sum over the pupil of the screen times a map.
        """
        return np.asarray((self.coefficients(readings) ** 2).sum(axis=(-2, -1)))

    def coefficients(self, readings: FloatArray) -> FloatArray:
        """Return what linear readings see of each wave of a screen of 1 nm, shape (..., 128, 128).

        A reading of a random screen is the sum of these times independent standard normal numbers.

        Parameters
        ----------
        readings : ndarray, shape (..., n, n)
            Maps; a reading is the sum over the pupil of the screen times a map.
        """
        content = np.einsum("...yx,kyx->...k", readings, self.planes)
        readings = readings - np.einsum("...k,kyx->...yx", content, self.removed)
        waves, rms = self._real_waves()
        return np.asarray(rms * (waves @ readings @ waves.T))

    def screens(self, coefficients: FloatArray) -> FloatArray:
        """Return the screens of 1 nm in which each wave has been drawn so, in nm, shape (..., n, n).

        Parameters
        ----------
        coefficients : ndarray, shape (..., 128, 128)
            In the order of `coefficients`; independent standard normal numbers give a random screen.
        """
        waves, rms = self._real_waves()
        screens = waves.T @ (rms * coefficients) @ waves
        content = np.einsum("...yx,kyx->...k", screens, self.removed)
        return np.asarray(screens - np.einsum("...k,kyx->...yx", content, self.planes))

    def _real_waves(self) -> tuple[FloatArray, FloatArray]:
        """Return cosines, then sines at the samples of an axis, (128, n), and the rms of products of two of them."""
        lower = self.planes.shape[-1] - self.cosine.shape[1]
        waves = np.concatenate(
            [
                np.concatenate([sign * half[:, ::-1][:, :lower], half], axis=1)
                for sign, half in ((1.0, self.cosine), (-1.0, self.sine))
            ]
        )
        # Frequencies f_x and -f_x together: half of each product of cosines and sines belongs to either.
        several = np.full((LAST_INDEX + 1, LAST_INDEX + 1), 2.0)
        several[0], several[:, 0] = 1.0, 1.0
        return waves, np.tile(np.sqrt(several) * self.amplitude[:, LAST_INDEX:], (2, 2))

    def _series(self, real: FloatArray, imaginary: FloatArray) -> FloatArray:
        """Return the real part of the Fourier series with the given coefficients, shape (n, n)."""
        # Along x: sums of opposite frequencies bring cosines, differences of them sines and a factor of i.
        sums, steps = _opposite(np.stack([real, imaginary]))
        even, odd = sums @ self.cosine, steps @ self.sine
        upper = even[0] - odd[1], even[1] + odd[0]
        lower = even[0] + odd[1], even[1] - odd[0]
        n, half = self.planes.shape[-1], self.cosine.shape[1]
        row_real, row_imaginary = np.empty((2, len(real), n))
        for row, place in ((row_real, 0), (row_imaginary, 1)):
            row[:, n - half :] = upper[place]
            row[:, :half] = lower[place][:, ::-1]
        even_y, odd_y = self.cosine.T @ row_real, self.sine.T @ row_imaginary
        screen = np.empty((n, n))
        screen[n - half :] = even_y - odd_y
        screen[:half] = (even_y + odd_y)[::-1]
        return screen


def _opposite(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the sum and difference of the coefficients of f_x and -f_x, shapes (2, 64, 64); those of zero once."""
    upper, lower = values[..., LAST_INDEX:], values[..., LAST_INDEX::-1]
    sums, steps = upper + lower, upper - lower
    sums[..., 0] = upper[..., 0]
    return sums, steps


@functools.lru_cache(maxsize=8)
def screen_model(samples: int, psd_slope: float) -> ScreenModel:
    """Return the screens with power spectrum ``f^-psd_slope`` on ``samples`` x ``samples`` pupil samples.

    Parameters
    ----------
    samples : int
        Samples of the pupil grid a side.
    psd_slope : float
        Exponent of the power spectrum of the screens, ``f^-slope``.
    """
    position = (np.arange(samples) + 0.5) / samples - 0.5
    f_y = STEP_CYCLES * np.arange(LAST_INDEX + 1)
    f_x = STEP_CYCLES * np.arange(-LAST_INDEX, LAST_INDEX + 1)
    radius = np.hypot(f_y[:, None], f_x)
    amplitude = np.maximum(radius, FLAT_BELOW_CYCLES) ** (-psd_slope / 2)
    amplitude[0, f_x <= 0] = 0.0  # the other half of the f_y = 0 row, and piston
    rows = np.exp(2j * np.pi * np.outer(position, f_y))
    columns = np.exp(2j * np.pi * np.outer(position, f_x))
    disc = (np.hypot(position[:, None], position) <= 0.5).astype(np.float64)
    planes = np.stack([np.ones_like(disc), *np.meshgrid(position, position, indexing="ij")])
    planes = planes / np.sqrt((planes**2 * disc).sum(axis=(1, 2)) / disc.sum())[:, None, None]
    removed = planes * disc / disc.sum()
    # Expected mean square: each wave carries its amplitude squared, less what piston, tip and tilt take of it.
    taken = sum(np.abs(rows.T @ plane @ columns) ** 2 for plane in removed)
    mean_square = float((amplitude**2 * (1.0 - taken)).sum())
    turns = 2.0 * np.pi * np.outer(f_y, position[samples // 2 :])
    arrays = amplitude / math.sqrt(mean_square), np.cos(turns), np.sin(turns), removed, planes
    for array in arrays:
        array.flags.writeable = False
    return ScreenModel(*arrays)


@functools.lru_cache(maxsize=8)
def spectrum(psd_slope: float) -> tuple[FloatArray, FloatArray]:
    """Return the frequencies along an axis, cycles per diameter, and the mean square of the waves of a screen of 1 nm.

    Parameters
    ----------
    psd_slope : float
        Exponent of the power spectrum of the screens, ``f^-slope``.

    Returns
    -------
    frequency : ndarray, shape (127,)
    power : ndarray, shape (127, 127)
        nm^2, half of each wave's at opposite frequencies. All of it is 1, and what piston, tip and tilt take.
    """
    upper = 0.5 * screen_model(_FEWEST_SAMPLES, psd_slope).amplitude ** 2
    power = np.concatenate([upper[:0:-1, ::-1], upper[:1] + upper[:1, ::-1], upper[1:]])
    return STEP_CYCLES * np.arange(-LAST_INDEX, LAST_INDEX + 1.0), np.asarray(power)


class SharedTerms(Record, eq=False):
    """The wavefront that a visit shares with the other visits of its programme; nothing by default.

    Attributes
    ----------
    correlation : float
        Of the offsets of successive visits, 0 to 1.
    earlier : tuple of numpy.random.Generator
        Streams of the offsets of the visits before, the latest first; none where offsets are independent.
    common : numpy.random.Generator or None
        Stream of the screen that all science visits have and references have not.
    orbit : numpy.random.Generator or None
        Stream of the phase and of the map that swings with the orbit.
    timing : Timing
    reference : bool
        Of a reference visit, or of a science visit.
    visit : int
        Number of the visit.
    """

    correlation: float = 0.0
    earlier: tuple[np.random.Generator, ...] = ()
    common: np.random.Generator | None = None
    orbit: np.random.Generator | None = None
    timing: Timing = field(default_factory=Timing)
    reference: bool = False
    visit: int = 0

    def frozen(self, screens: Screens, drift: Drift, own: FloatArray) -> FloatArray:
        """Return what does not change within the visit, nm; ``own`` is the screen drawn for this visit alone."""
        opd_nm = own
        if self.earlier:
            # A stationary chain: each offset remembers the one before, and all have the same rms.
            new = math.sqrt(1.0 - self.correlation**2)
            weights = [new * self.correlation**back for back in range(len(self.earlier) + 1)]
            weights[-1] /= new
            opd_nm = weights[0] * own
            for weight, rng in zip(weights[1:], self.earlier, strict=True):
                opd_nm = opd_nm + weight * screens.draw(rng, drift.visit_nm)
        if self.common is not None:
            opd_nm = opd_nm + screens.draw(self.common, drift.common_nm)
        return opd_nm

    def swing(
        self, screens: Screens, drift: Drift, n_frames: int, cadence_s: float
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return the map that swings with the orbit, and its mean nm in each frame; None without one.

        Parameters
        ----------
        screens : Screens
        drift : Drift
        n_frames : int
        cadence_s : float
            Time on source from frame to frame, s.
        """
        if self.orbit is None or drift.orbital_nm == 0:
            return None
        drawn = float(self.orbit.uniform())
        start = drawn if self.timing.start_turns is None else self.timing.start_turns
        low = drift.orbital_orders == "low"
        shape = screens.low_order if low else screens.draw(self.orbit, 1.0)
        turns = np.arange(n_frames + 1) * (cadence_s / drift.orbital_period_s)
        means = self.timing.phasors(turns, reference=self.reference, visit=self.visit)
        return shape, drift.orbital_nm * math.sqrt(2.0) * (np.exp(2j * math.pi * start) * means).imag


ALONE = SharedTerms()


def visit_frames(
    optics: Imager | HoldsImager,
    drift: Drift,
    n_frames: int,
    cadence_s: float,
    rng_visit: np.random.Generator,
    rng_walk: np.random.Generator,
    *,
    star_arcsec: tuple[float, float] = (0.0, 0.0),
    shared: SharedTerms = ALONE,
) -> FloatArray:
    """Return the masked on-axis stamps of the frames of one visit, shape (n_frames, stamp, stamp).

    Parameters
    ----------
    optics : Imager, Psf or FocalGrid
        Optical model, or the PSF that holds it: stamps of the size that its ``knobs`` set. Or the transforms of a model
        to other pixels, with the star where they have it.
    drift : Drift
        Visit offset (nm rms), random walk (nm rms per square root of an hour), spectral slope.
    n_frames : int
        Number of frames, at least 1.
    cadence_s : float
        Time from one frame to the next, exposure and readout, > 0.
    rng_visit, rng_walk : numpy.random.Generator
        Streams of the frozen offset and of the walk; frame k stands for the middle of
        its interval, k + 1/2 steps after the start.
        The walk within one exposure is not smeared.
    star_arcsec : tuple of float
        Place of the star relative to the centre of the mask, x and y; the stamp stays on the mask.
    shared : SharedTerms
        What the visit shares with others; by default it stands alone.

    Returns
    -------
    ndarray
        Fraction of the energy on the clear disc in every pixel.
    """
    grid = optics
    if not isinstance(grid, FocalGrid):
        imager = grid if isinstance(grid, Imager) else grid.imager
        axis = imager.stamp_axis(masked=True)
        grid = imager.focal_grid(axis, axis, source_arcsec=star_arcsec)
    screens = screen_model(len(grid.imager.transmission), drift.psd_slope)
    last, stamps = None, []
    for opd_nm in wavefronts(screens, drift, n_frames, cadence_s, rng_visit, rng_walk, shared):
        stamps.append(stamps[-1] if opd_nm is last else grid.image(opd_nm))
        last = opd_nm
    return np.stack(stamps)


def wavefronts(
    screens: Screens,
    drift: Drift,
    n_frames: int,
    cadence_s: float,
    rng_visit: np.random.Generator,
    rng_walk: np.random.Generator,
    shared: SharedTerms = ALONE,
) -> Iterator[FloatArray]:
    """Yield the wavefront of every frame of one visit, nm, as ``screens`` tell it; the same array while it stays.

    Parameters
    ----------
    screens : Screens
        Maps of the pupil (`ScreenModel`), or the numbers of an expansion (`simulator.imaging.light_expansion`).
    drift, n_frames, cadence_s, rng_visit, rng_walk, shared
        As of `visit_frames`.
    """
    step_nm = drift.walk_nm_per_sqrt_hour * math.sqrt(cadence_s / 3600.0)
    still = shared.frozen(screens, drift, screens.draw(rng_visit, drift.visit_nm))
    swing = shared.swing(screens, drift, n_frames, cadence_s)
    for frame in range(n_frames):
        if step_nm > 0:
            # The first stamp stands for the middle of its interval: half a step after the start of the visit.
            still = still + screens.draw(rng_walk, step_nm if frame else step_nm * math.sqrt(0.5))
        yield still if swing is None else still + swing[1][frame] * swing[0]
