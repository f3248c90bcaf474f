"""Images on the whole detector: the star's far wings, sources far from it, and the open part of every pixel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simulator.cache import compute_once
from simulator.config import Instrument, content_hash
from simulator.imaging.imager import build_imager, centred_axis
from simulator.imaging.psf import Psf, wide_on_axis
from simulator.imaging.store import metrics_key
from simulator.knobs import Knobs

__all__ = ["full_stamp", "full_star_map", "sky_transmission"]

FloatArray = NDArray[np.float64]


def _axes(psf: Psf, instrument: Instrument) -> tuple[FloatArray, FloatArray]:
    detector = instrument.detector
    rows = centred_axis(detector.n_rows, psf.pixel_scale_arcsec, detector.star_row)
    columns = centred_axis(detector.n_columns, psf.pixel_scale_arcsec, detector.star_column)
    return rows, columns


def sky_transmission(psf: Psf, instrument: Instrument | None = None) -> FloatArray:
    """Open fraction of every pixel behind the cross, of the stamp or of the whole detector.

    There is no Lyot stop, so a uniform sky passes the focal-plane mask by geometry alone.
    """
    imager = psf.imager
    if instrument is None:
        axes = [centred_axis(psf.on_axis.shape[0], psf.pixel_scale_arcsec)] * 2
    else:
        axes = list(_axes(psf, instrument))
    open_parts = []
    for centres in axes:
        axis = imager.axis(centres, masked=True, pixel_nodes=1)
        part = np.zeros(axis.n_pixels)
        part[axis.pixels] = np.add.reduceat(axis.weights, axis.starts)
        open_parts.append(part)
    return np.outer(open_parts[0], open_parts[1])


def full_star_map(psf: Psf, instrument: Instrument) -> FloatArray:
    """Masked on-axis PSF over the whole detector with the star's stamp left out (the drifting frames fill it).

    Kept in the disk cache: it takes seconds and changes with the instrument only.
    """
    detector = instrument.detector
    place = [detector.n_rows, detector.n_columns, detector.star_row, detector.star_column]
    key = content_hash({"optics": metrics_key(instrument, psf.band), "place": place})
    stored = compute_once(f"wide-{psf.band}-{key}", lambda: {
        "image": wide_on_axis(psf.band, instrument, (detector.n_rows, detector.n_columns),
                              (detector.star_row, detector.star_column)).astype(np.float32)
    })  # fmt: skip
    image = stored["image"].astype(np.float64)
    half = psf.on_axis.shape[0] // 2
    image[max(detector.star_row - half, 0) : detector.star_row + half + 1,
          max(detector.star_column - half, 0) : detector.star_column + half + 1] = 0.0  # fmt: skip
    return image


def full_stamp(psf: Psf, instrument: Instrument, x_arcsec: float, y_arcsec: float) -> FloatArray:
    """Unit source on the whole detector: coarse far wings, with its own stamp and the star's at full accuracy."""
    detector = instrument.detector
    rows, columns = _axes(psf, instrument)
    side, place = psf.on_axis.shape[0], (x_arcsec, y_arcsec)
    coarse = build_imager(instrument, psf.band, Knobs(pupil_samples=64, wavelength_nodes=3, pixel_nodes=1))
    image = coarse.image(coarse.axis(rows, masked=True), coarse.axis(columns, masked=True), source_arcsec=place)
    for x_centre, y_centre in (place, (0.0, 0.0)):
        row = detector.star_row + round(y_centre / psf.pixel_scale_arcsec)
        column = detector.star_column + round(x_centre / psf.pixel_scale_arcsec)
        part_rows = slice(max(row - side // 2, 0), max(min(row + side // 2 + 1, detector.n_rows), 0))
        part_columns = slice(max(column - side // 2, 0), max(min(column + side // 2 + 1, detector.n_columns), 0))
        if part_rows.start < part_rows.stop and part_columns.start < part_columns.stop:
            y = psf.imager.axis(rows[part_rows], masked=True)
            x = psf.imager.axis(columns[part_columns], masked=True)
            image[part_rows, part_columns] = psf.imager.image(y, x, source_arcsec=place)
    return image
