"""How far the settings of the optics move what an aperture sees, in the units that the ledger gives them in.

For every visible band and setting: the starlight in an aperture over the starlight around it, and the rms of what two
visits of a drifting wavefront leave, both against seven wavelengths and five nodes a pixel; and the light of a source
off the axis over its wing map.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from cpic_core import stream
from simulator import load_instrument
from simulator.config import Instrument
from simulator.imaging import aperture_sums, build_imager, centred_axis, overlap_weights, psf_metrics
from simulator.imaging.drift import screen_model
from simulator.imaging.imager import Imager
from simulator.knobs import Knobs
from simulator.ledger.light import MOST
from simulator.ledger.visit import Optics
from simulator.passbands import Passbands
from simulator.signal import wing

FloatArray = NDArray[np.float64]
BANDS = ("F520", "F662", "F720", "F850")
BEST = Knobs(wavelength_nodes=7, pixel_nodes=5)
VALUES = {"wavelength_nodes": (1, 2, 3, 4), "pixel_nodes": (1, 2, 3, 4)}
PAIRS, RMS_NM = 8, 0.1
NEAR_ARCSEC = (0.12, 0.78)  # the places of the random planets
WING_ARCSEC = (0.6, 4.0)


def _seen(imager: Imager, slope: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Image of the star, its aperture sums, and the rms of those of pairs of visits."""
    axis = imager.stamp_axis(masked=True)
    weights = overlap_weights(imager.aperture_radius_arcsec / imager.pixel_scale_arcsec)
    image, grid = imager.image(axis, axis), imager.focal_grid(axis, axis)
    screens = screen_model(len(imager.transmission), slope)
    sums = [aperture_sums(grid.image(screens.draw(stream(11, "pair", k), RMS_NM)), weights) for k in range(PAIRS)]
    squares = np.mean([(sums[k] - sums[(k + 1) % PAIRS]) ** 2 for k in range(PAIRS)], axis=0)
    return image, aperture_sums(image, weights), np.sqrt(np.maximum(uniform_filter(squares, 7), 0.0))


def _model(instrument: Instrument, band: str, imager: Imager) -> Optics:
    passbands = Passbands.from_instrument(instrument)
    low, high = passbands.bands[passbands.index(band)].support_nm
    return Optics(
        (high - low) / (0.5 * (high + low)),
        imager.lambda_d_arcsec,
        imager.pixel_scale_arcsec,
        instrument.wavefront.jitter_mas * 1e-3,
    )


def settings_rows() -> list[dict[str, Any]]:
    """One row a band, setting and place: measured and predicted, of 99 in 100 apertures."""
    instrument, rows = load_instrument(), []
    for band in BANDS:
        best = build_imager(instrument, band, BEST)
        image, halo, speckle = _seen(best, instrument.drift.psd_slope)
        weights = overlap_weights(best.aperture_radius_arcsec / best.pixel_scale_arcsec)
        around = aperture_sums(np.maximum(image, uniform_filter(image, 5, mode="constant")), weights)
        offset = centred_axis(len(image), best.pixel_scale_arcsec)
        separation = np.hypot(offset[:, None], offset)
        near = (np.abs(offset) > NEAR_ARCSEC[0]) & (np.abs(offset) < NEAR_ARCSEC[1])
        hole = best.zone.covers(offset, offset, -best.aperture_radius_arcsec)
        model = _model(instrument, band, best)
        for name, values in VALUES.items():
            for value in values:
                _, sums, residual = _seen(
                    build_imager(instrument, band, BEST.model_copy(update={name: value})), instrument.drift.psd_slope
                )
                for place, part in (("hole", hole), ("beyond", near[:, None] & near & ~hole)):
                    inside = place == "hole"
                    if name == "wavelength_nodes":
                        said = [model.wavelength_halo_error(value, u, inside) for u in separation[part]]
                        moved = [model.wavelength_speckle_error(value, u, inside) for u in separation[part]]
                    else:
                        said = [model.pixel_halo_error(value, inside)] * int(part.sum())
                        moved = [model.pixel_speckle_error(value)] * int(part.sum())
                    error = np.abs(sums - halo)[part] / around[part]
                    change = np.abs(residual[part] / speckle[part] - 1.0)
                    rows.append(
                        {
                            "band": band,
                            "setting": name,
                            "value": value,
                            "place": place,
                            "halo_error": float(np.percentile(error, 99)),
                            "halo_of_bound": float(np.percentile(error / said, 99)),
                            "speckle_error": float(np.percentile(change, 99)),
                            "speckle_of_bound": float(np.percentile(change / moved, 99)),
                        }
                    )
    return rows


def wing_rows() -> list[dict[str, Any]]:
    """Light of a source off the axis over its wing map, pixel by pixel."""
    instrument, rows = load_instrument(), []
    for band in BANDS:
        imager, figures = build_imager(instrument, band, BEST), psf_metrics(instrument, band)
        offset = np.arange(0.0, WING_ARCSEC[1], imager.pixel_scale_arcsec)
        axis = imager.axis(offset, masked=False)
        x, y = np.meshgrid(offset, offset)
        ratio = (imager.image(axis, axis) / wing(figures, x, y))[np.hypot(x, y) > WING_ARCSEC[0]]
        rows.append(
            {
                "band": band,
                "median": float(np.median(ratio)),
                "of_99_in_100": float(np.percentile(ratio, 99)),
                "most": float(ratio.max()),
                "bound": MOST,
            }
        )
    return rows
