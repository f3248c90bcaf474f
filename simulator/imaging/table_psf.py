"""Images of a coronagraph that is a table: a Gaussian core, and speckles that are as stable as the table says.

Starlight is ``|E0 + m dE|^2``: E0 is the same in all visits, as bright as the table has it or a file of images shows
it, and dE is what the wavefront of a visit adds, a random Gaussian field behind a clear pupil. Where no file shows the
static speckles, m is a field of such of the mean light 1: the residual varies from place to place as if it beat with
them; else it is of that light everywhere. Sums over a core that the star lights with C vary by ``2 k C L + q L^2`` with
L the light of dE in it, and k and q what a sum leaves of the variance of coherent light; L is such that this is the
variance of the table.
"""

import dataclasses
import functools
import math
from dataclasses import dataclass

import numpy as np

from cpic_core import ArrayLike, ComplexArray, FloatArray, overlap_weights, stream
from simulator.config import Instrument
from simulator.imaging.external import ExternalPsf, load_psf
from simulator.imaging.sampling import centred_offsets
from simulator.imaging.store import psf_metrics
from simulator.imaging.table_metrics import TableMetrics

_CORE_SIGMA = 0.4374  # of a Gaussian as wide at half its maximum as the image of a clear pupil, in lambda/D
_MOST = 4.0  # rms of a Gaussian field that hardly any speckle passes
_RINGS = 30  # of a stamp, over each of which the pattern of static speckles has the mean 1


@dataclass(frozen=True, eq=False, kw_only=True)
class TablePsf(ExternalPsf):
    """Point-spread functions of a table, with speckles that change from visit to visit; made by `psf_of_table`.

    Attributes
    ----------
    pattern : ndarray of complex, shape (n, n)
        Factor ``m`` of the fields of visits.
    figures : TableMetrics
        What the table says.
    """

    pattern: ComplexArray
    figures: TableMetrics

    @property
    def hole_state(self) -> str:
        """``table``: what is known of it is that."""
        return "table"

    @functools.cached_property
    def coherence(self) -> tuple[float, float]:
        """Factors ``k`` and ``q`` of the module."""
        at = self.geometry
        both, four = core_coherence(at.aperture_radius_arcsec, at.lambda_d_arcsec, at.pixel_scale_arcsec)
        return both, both if self.file else 2.0 * both + four

    @functools.cached_property
    def _separation(self) -> FloatArray:
        offset = centred_offsets(len(self.on_axis)) * self.pixel_scale_arcsec
        return np.hypot(offset[:, None], offset)

    @functools.cached_property
    def field(self) -> FloatArray:
        """Field of the star without errors."""
        return np.sqrt(self.on_axis)

    def extended(self, x_arcsec: ArrayLike, y_arcsec: ArrayLike) -> FloatArray:
        """Return the light of an extended source at (x, y) over that of ``off_axis``: all that passes, not cores."""
        shape = np.broadcast_shapes(np.shape(x_arcsec), np.shape(y_arcsec))
        place = np.broadcast_to(np.asarray(x_arcsec, float), shape), np.broadcast_to(np.asarray(y_arcsec, float), shape)
        return self.figures.dust_transmission(*place, np.zeros(shape)) / float(self.off_axis.sum())

    def moved(self, separation_arcsec: FloatArray, variance: FloatArray, rng: np.random.Generator) -> ComplexArray:
        """Return a field that makes sums over a core vary as much.

        Parameters
        ----------
        separation_arcsec, variance : ndarray, shape (k,)
            Variance by separation, ascending; of a star of the light 1 on the collecting area.
        rng : numpy.random.Generator
            Source of random numbers; a seed gives the same draws.

        Returns
        -------
        ndarray of complex, shape (n, n)
        """
        side, unit = len(self.on_axis), self.geometry.lambda_d_arcsec / self.pixel_scale_arcsec
        return np.asarray(self._rms(separation_arcsec, variance) * coherent_field(side, unit, rng))

    def brightest(self, separation_arcsec: FloatArray, variance: FloatArray) -> FloatArray:
        """Return the brightest that a pixel of such visits is: in more by less than once in 1e7 speckles."""
        return np.asarray((self.field + _MOST * np.abs(self._rms(separation_arcsec, variance))) ** 2)

    def _rms(self, separation_arcsec: FloatArray, variance: FloatArray) -> ComplexArray:
        crossed, lit = self.coherence
        half = crossed / lit * self.figures.starlight(separation_arcsec)
        light = np.sqrt(half**2 + variance / lit) - half
        on_pixel = np.interp(self._separation, separation_arcsec, light / self.figures.aperture_pixels)
        return np.asarray(self.pattern * np.sqrt(on_pixel))


def coherent_field(side: int, lambda_d_pixels: float, rng: np.random.Generator) -> ComplexArray:
    """Return a random Gaussian field behind a clear round pupil, mean light 1.

    Parameters
    ----------
    side : int
        Pixels of the image.
    lambda_d_pixels : float
        lambda/D.
    rng : numpy.random.Generator
        Source of random numbers; a seed gives the same draws.

    Returns
    -------
    ndarray of complex, shape (side, side)
        Points of the field in the middle of pixels; its edges continue at the opposite ones.
    """
    cycles = np.fft.fftfreq(side) * lambda_d_pixels
    pupil = np.hypot(cycles[:, None], cycles) <= 0.5
    waves = np.where(pupil, rng.standard_normal((2, side, side)), 0.0)
    return np.asarray(np.fft.ifft2(waves[0] + 1j * waves[1]) * side**2 / math.sqrt(2.0 * np.count_nonzero(pupil)))


def core_coherence(radius_arcsec: float, lambda_d_arcsec: float, pixel_arcsec: float) -> tuple[float, float]:
    """Return what a sum over a disc of pixels leaves of the variance of products of two and of four Gaussian fields.

    Parameters
    ----------
    radius_arcsec, lambda_d_arcsec, pixel_arcsec : float

    Notes
    -----
    ``sum(w_i w_j rho_ij^p) / sum(w)^2`` with p of 2 and 4, and the correlation of the fields,
    ``rho = 2 J1(pi u) / (pi u)`` at u lambda/D.
    """
    from scipy.special import j1

    weights = overlap_weights(radius_arcsec / pixel_arcsec)
    axis = centred_offsets(len(weights)) * pixel_arcsec / lambda_d_arcsec
    x, y, w = (part.ravel() for part in (*np.meshgrid(axis, axis), weights))
    apart = np.pi * np.hypot(x[:, None] - x, y[:, None] - y)
    correlation = np.where(apart > 0, 2.0 * j1(apart) / np.maximum(apart, 1e-12), 1.0)
    two, four = (float(w @ correlation**power @ w / w.sum() ** 2) for power in (2, 4))
    return two, four


def psf_of_table(instrument: Instrument, band: str) -> TablePsf | None:
    """Return images of a band whose coronagraph is a table; None where it is none.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Name of a band of the instrument.

    Raises
    ------
    InputError
        As `load_psf`, where the instrument names a file of images.

    Notes
    -----
    Without a file the core is that of a clear pupil, a Gaussian of 1.03 lambda/D at half its maximum, as bright as puts
    the largest core throughput into the area of the core; the star behind the mask is as even as the table has it.
    """
    figures = psf_metrics(instrument, band)
    if not isinstance(figures, TableMetrics):
        return None
    path = instrument.psf_file(band)
    known = None if path is None else load_psf(path, instrument=instrument, band=band)
    side = len(figures.raw_contrast if known is None else known.on_axis)
    pixel, unit = figures.pixel_scale_arcsec, figures.lambda_d_arcsec
    pattern = coherent_field(side, unit / pixel, stream(1, "static speckles of a table", band))
    if known is not None:
        parts = {item.name: getattr(known, item.name) for item in dataclasses.fields(known)}
        return TablePsf(**parts, pattern=pattern / np.abs(pattern), figures=figures)
    sigma, radius = _CORE_SIGMA * unit / pixel, figures.aperture_radius_arcsec / pixel
    # Pixels widen the image, and exact apertures by as much again.
    held = -math.expm1(-(radius**2) / (2.0 * (sigma**2 + 1.0 / 6.0)))
    line = _pixel_integrals(side, sigma)
    offset = centred_offsets(side)
    ring = np.rint(np.hypot(offset[:, None], offset) * (_RINGS / side)).astype(int)
    level = np.bincount(ring.ravel(), np.abs(pattern.ravel()) ** 2) / np.maximum(np.bincount(ring.ravel()), 1)
    return TablePsf(
        band=band,
        on_axis=figures.raw_contrast * figures.peak_off_axis,
        off_axis=figures.core_open / held * np.outer(line, line),
        pixel_scale_arcsec=pixel,
        instrument=instrument,
        mask_half_width_arcsec=0.0,
        apodizer_energy=figures.apodizer_energy,
        pattern=pattern / np.sqrt(level[ring]),
        figures=figures,
    )


def _pixel_integrals(side: int, sigma_pixels: float) -> FloatArray:
    """Return the shares of a Gaussian in the pixels of a line, centred on the middle one."""
    from scipy.special import ndtr

    edges = (np.arange(side + 1) - 0.5 - side // 2) / sigma_pixels
    return np.asarray(np.diff(ndtr(edges)))
