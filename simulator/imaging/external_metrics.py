"""Figures of merit of a point-spread function of which only the stamps are known."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulator.config.instrument import Instrument
from simulator.imaging.aperture import (
    aperture_sums,
    core_from_table,
    cumulative_table,
    overlap_weights,
    photon_weights,
)
from simulator.imaging.geometry import BandGeometry, zone_of
from simulator.imaging.hole_zone import HoleZone
from simulator.imaging.kernel import unpixelled

__all__ = ["ExternalMetrics", "stamp_metrics"]

FloatArray = NDArray[np.float64]
CELLS_PER_PIXEL = 10


@dataclass(frozen=True, eq=False)
class ExternalMetrics:
    """What follows from the stamps: the same names and meanings as in `simulator.imaging.metrics.PsfMetrics`.

    Attributes
    ----------
    band : str
        Name of the band.
    lambda_d_arcsec : float
        lambda/D at band centre.
    pixel_scale_arcsec, aperture_radius_arcsec, mask_half_width_arcsec : float
        Detector pixel, photometric aperture, half width of the cross.
    zone : HoleZone
        The dark quadrants, those of the instrument.
    strehl : None
        Not known: the peak of the same optics without aberrations is not in the file.
    apodizer_energy : float
        Energy behind the apodizer: as the file says, or what lies on the stamp, which is a little less.
    core_open : float
        Core throughput far from the mask, in an aperture laid on pixels (phase average).
    peak_off_axis : float
        Peak pixel of a source centred on a pixel, no mask.
    iwa_arcsec : float
        Diagonal separation where core throughput is half its maximum.
    raw_contrast : ndarray, shape (n, n)
        Masked on-axis image over ``peak_off_axis``.
    halo_map : ndarray, shape (n, n)
        Starlight in the aperture centred on every pixel.
    column_light : ndarray, shape (n,)
        Masked star in every column, summed over the rows of the stamp: what lies beyond is not known.
    core_table : ndarray, shape (k, k)
        Cumulative aperture-weighted PSF, over offsets up to ``core_table_half_arcsec``.
    core_table_half_arcsec : float
        Half side of that table.
    """

    band: str
    lambda_d_arcsec: float
    pixel_scale_arcsec: float
    aperture_radius_arcsec: float
    mask_half_width_arcsec: float
    zone: HoleZone
    strehl: None
    apodizer_energy: float
    core_open: float
    peak_off_axis: float
    iwa_arcsec: float
    raw_contrast: FloatArray
    halo_map: FloatArray
    column_light: FloatArray
    core_table: FloatArray
    core_table_half_arcsec: float

    @property
    def geometry(self) -> BandGeometry:
        """What follows from the instrument and the size of the stamp alone."""
        return BandGeometry(
            self.lambda_d_arcsec,
            self.pixel_scale_arcsec,
            self.aperture_radius_arcsec,
            self.mask_half_width_arcsec,
            self.zone,
            len(self.raw_contrast),
        )

    @property
    def hole(self) -> NDArray[np.bool_]:
        """Pixels whose centres lie in the dark quadrants."""
        return self.geometry.hole

    @property
    def hole_inner_corner_arcsec(self) -> float:
        """Diagonal separation of the inner corner of the hole."""
        return self.zone.inner_corner_arcsec

    @property
    def owa_arcsec(self) -> float:
        """Diagonal separation of the outer corner of the hole."""
        return self.zone.outer_corner_arcsec

    @property
    def aperture_pixels(self) -> float:
        """Area of the photometric aperture in pixels."""
        return self.geometry.aperture_pixels

    def core_throughput(self, x_arcsec: ArrayLike, y_arcsec: ArrayLike) -> FloatArray:
        """Energy of a unit source at (x, y) in its aperture behind the mask."""
        return core_from_table(
            self.core_table, self.core_table_half_arcsec, self.mask_half_width_arcsec, x_arcsec, y_arcsec
        )


def stamp_metrics(
    on_axis: FloatArray,
    off_axis: FloatArray,
    instrument: Instrument,
    band: str,
    *,
    mask_half_width_arcsec: float,
    apodizer_energy: float,
) -> ExternalMetrics:
    """Measure the figures on the stamps; aperture and hole are those of the instrument's band.

    Parameters
    ----------
    on_axis, off_axis : ndarray, shape (n, n), n odd
        Fraction of the energy on the clear disc in each pixel.
    instrument : Instrument
    band : str
    mask_half_width_arcsec : float
        Half width of the bars of the cross.
    apodizer_energy : float
        Energy behind the apodizer.

    Raises
    ------
    InputError
        If the instrument has no such band.
    """
    pixel, radius = instrument.pixel_scale_arcsec(band), instrument.aperture_radius_arcsec(band)
    zone = zone_of(instrument, band)
    cells = 2 * math.ceil((radius / pixel + 1) * CELLS_PER_PIXEL)
    offset = (np.arange(cells) - cells / 2 + 0.5) / CELLS_PER_PIXEL  # pixels
    light = unpixelled(off_axis, offset) / CELLS_PER_PIXEL**2
    table = cumulative_table(light * photon_weights(offset, offset, radius / pixel))
    half = cells / 2 / CELLS_PER_PIXEL * pixel
    far = 10.0 * (half + mask_half_width_arcsec)
    core_open = float(core_from_table(table, half, mask_half_width_arcsec, far, far))
    diagonal = np.arange(0.0, mask_half_width_arcsec + 2 * half, pixel / 50)
    sign_x, sign_y = zone.diagonal
    curve = core_from_table(table, half, mask_half_width_arcsec, sign_x * diagonal, sign_y * diagonal)
    hidden = curve[0] < 0.5 * core_open
    peak = float(off_axis.max())
    return ExternalMetrics(
        band=band,
        lambda_d_arcsec=instrument.lambda_d_arcsec(band),
        pixel_scale_arcsec=pixel,
        aperture_radius_arcsec=radius,
        mask_half_width_arcsec=mask_half_width_arcsec,
        zone=zone,
        strehl=None,
        apodizer_energy=apodizer_energy,
        core_open=core_open,
        peak_off_axis=peak,
        iwa_arcsec=math.sqrt(2.0) * float(np.interp(0.5 * core_open, curve, diagonal)) if hidden else 0.0,
        raw_contrast=on_axis / peak,
        halo_map=aperture_sums(on_axis, overlap_weights(radius / pixel)),
        column_light=on_axis.sum(axis=0),
        core_table=table,
        core_table_half_arcsec=half,
    )
