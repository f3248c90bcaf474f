"""Figures of merit of a point-spread function of which only the stamps are known."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from simulator.config.instrument import Instrument
from simulator.imaging.aperture import cumulative_table, figures_of_stamps, photon_weights
from simulator.imaging.geometry import zone_of
from simulator.imaging.kernel import unpixelled
from simulator.imaging.metrics import StampMetrics

__all__ = ["stamp_metrics"]

FloatArray = NDArray[np.float64]
CELLS_PER_PIXEL = 10


def stamp_metrics(
    on_axis: FloatArray,
    off_axis: FloatArray,
    instrument: Instrument,
    band: str,
    *,
    mask_half_width_arcsec: float,
    apodizer_energy: float,
) -> StampMetrics:
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
    return StampMetrics(
        band=band,
        lambda_d_arcsec=instrument.lambda_d_arcsec(band),
        pixel_scale_arcsec=pixel,
        aperture_radius_arcsec=radius,
        mask_half_width_arcsec=mask_half_width_arcsec,
        hole_inner_arcsec=zone.inner_arcsec,
        hole_outer_arcsec=zone.outer_arcsec,
        hole_mode=zone.mode,
        hole_side=zone.side,
        strehl=None,
        apodizer_energy=apodizer_energy,
        column_light=on_axis.sum(axis=0),
        **figures_of_stamps(
            on_axis, off_axis, table, half, pixel, radius, mask_half_width_arcsec, diagonal=zone.diagonal
        ),
    )
