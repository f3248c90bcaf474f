"""Point-spread functions of a band: the star behind the mask, and a source off the axis."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from catalogs.errors import InputError
from simulator.config.instrument import Instrument, load_instrument
from simulator.imaging.imager import Imager, build_imager, centred_axis
from simulator.imaging.metrics import PsfMetrics
from simulator.knobs import Knobs

__all__ = ["Psf", "single_band_psf", "wide_on_axis"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Psf:
    """Point-spread functions of one band on star-centred stamps, ``[y, x]``, star at pixel ``n // 2``.

    Attributes
    ----------
    band : str
        Name of the band.
    on_axis : ndarray, shape (n, n)
        The star behind the cross mask: fraction of the energy on the clear disc in each pixel.
    off_axis : ndarray, shape (n, n)
        A source far from the mask, placed on the centre pixel; same unit.
    pixel_scale_arcsec : float
        Pixel of the detector.
    knobs : Knobs
        Numerical settings.
    imager : Imager
        Optical model behind the stamps.
    instrument : Instrument
        Its configuration.
    """

    band: str
    on_axis: FloatArray
    off_axis: FloatArray
    pixel_scale_arcsec: float
    knobs: Knobs
    imager: Imager
    instrument: Instrument

    @functools.cached_property
    def metrics(self) -> PsfMetrics:
        """Figures of merit; maps and core at this PSF's knobs, wings and speckle floor at the standard ones."""
        from simulator.imaging.measure import stamp_figures
        from simulator.imaging.store import psf_metrics

        stored = psf_metrics(self.instrument, self.band)
        if self.knobs == Knobs():
            return stored
        figures = stamp_figures(self.imager, self.on_axis, self.off_axis)
        arrays = stored.to_arrays() | {name: np.asarray(value) for name, value in figures.items()}
        return PsfMetrics.from_arrays(arrays)

    def at(self, x_arcsec: float, y_arcsec: float) -> FloatArray:
        """Image of a unit source at any sub-pixel position, behind the mask, on the star-centred stamp.

        The field is computed at the exact offsets, so a source far outside the stamp (a companion 8 arcsec away)
        leaves its true wings on it.

        Parameters
        ----------
        x_arcsec, y_arcsec : float
            Position on the detector relative to the star; x grows with the column.

        Returns
        -------
        ndarray, shape (n, n)
            Fraction of the energy on the clear disc in each pixel.

        Raises
        ------
        InputError
            If a coordinate is not finite.
        """
        if not (math.isfinite(x_arcsec) and math.isfinite(y_arcsec)):
            raise InputError("x_arcsec, y_arcsec", (x_arcsec, y_arcsec), unit="arcsec", allowed="finite numbers")
        axis = self.imager.stamp_axis(masked=True)
        return self.imager.image(axis, axis, source_arcsec=(float(x_arcsec), float(y_arcsec)))


def single_band_psf(band: str, *, fidelity: str | Knobs = "standard", instrument: Instrument | None = None) -> Psf:
    """Point-spread functions of one band, propagated by HCIPy.

    Parameters
    ----------
    band : str
        Band of the instrument, for example ``F662``.
    fidelity : str or Knobs
        ``quick``, ``standard``, ``reference``, or the settings themselves.
    instrument : Instrument, optional
        The default instrument if omitted.

    Returns
    -------
    Psf

    Raises
    ------
    InputError
        For an unknown band or fidelity, or an apodizer that does not fit the pupil sampling.

    Examples
    --------
    >>> from simulator import single_band_psf
    >>> psf = single_band_psf("F662")
    >>> psf.on_axis.shape
    (137, 137)
    """
    if instrument is None:
        instrument = load_instrument()
    imager = build_imager(instrument, band, fidelity)
    if imager.knobs.stamp_pixels % 2 == 0:
        raise InputError("stamp_pixels", imager.knobs.stamp_pixels, unit="px", allowed="an odd number")
    masked, clear = imager.stamp_axis(masked=True), imager.stamp_axis(masked=False)
    return Psf(
        band=band,
        on_axis=imager.image(masked, masked),
        off_axis=imager.image(clear, clear),
        pixel_scale_arcsec=imager.pixel_scale_arcsec,
        knobs=imager.knobs,
        imager=imager,
        instrument=instrument,
    )


def wide_on_axis(
    band: str,
    instrument: Instrument,
    shape: tuple[int, int],
    star_pixel: tuple[float, float],
    *,
    wavelength_nodes: int = 3,
) -> FloatArray:
    """Masked star over a whole frame: one node per pixel, for display and for whole-frame saturation.

    The step mask has no phase screens here, so its own steps are the exact pupil sampling. One node per pixel makes
    up to 5 % of error on the steepest pixels; three wavelengths leave the far wings (beyond 3 arcsec) grainier than
    the light itself is.

    Parameters
    ----------
    band : str
        Band of the instrument.
    instrument : Instrument
        Configuration.
    shape : tuple of int
        Rows and columns of the frame.
    star_pixel : tuple of float
        Row and column of the star.
    wavelength_nodes : int
        Wavelengths over the band.

    Returns
    -------
    ndarray, shape ``shape``
    """
    imager = build_imager(instrument, band, Knobs(pupil_samples=64, wavelength_nodes=wavelength_nodes, pixel_nodes=1))
    y, x = (
        imager.axis(centred_axis(n, imager.pixel_scale_arcsec, centre), masked=True)
        for n, centre in zip(shape, star_pixel, strict=True)
    )
    return imager.image(y, x)
