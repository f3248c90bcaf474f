"""Light of a scene on the pixels of a window: sky, far wings of the star, and every other source.

The star itself goes through its own propagation, frame by frame (`simulator.imaging.drift`). All other sources pass the
exact scene of `simulator.imaging.scene_image`, or, where the shortcut of Zhu et al. 2025 is asked for, the unmasked
kernel on a grid of 4 x 4 cells a pixel (`simulator.imaging.paper_scene`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from catalogs.errors import InputError
from simulator.cache import compute_once
from simulator.config import Instrument, content_hash
from simulator.imaging.build import build_imager
from simulator.imaging.extended import render_extended
from simulator.imaging.external import ExternalPsf
from simulator.imaging.imager import centred_axis
from simulator.imaging.paper_scene import paper_scene_image
from simulator.imaging.psf import Psf, wide_on_axis
from simulator.imaging.quadrature import pixel_axis
from simulator.imaging.scene_image import PointSources, SourceGrid, scene_image
from simulator.imaging.store import metrics_key
from simulator.imaging.transfer import KernelTransfer, Transfer, band_transfer
from simulator.target.sources import ExtendedRate, Source

__all__ = [
    "AnyPsf",
    "SceneModel",
    "Window",
    "apodizer_energy",
    "full_star_map",
    "off_axis_light",
    "sky_transmission",
    "window_of",
]

FloatArray = NDArray[np.float64]
AnyPsf: TypeAlias = Psf | ExternalPsf
SceneModel = Literal["exact", "paper"]
# Numbers of wavelengths for far sources: few, since sources of one number share a pass.
_LADDER = (5, 8, 12, 17, 24, 33)


@dataclass(frozen=True, eq=False)
class Window:
    """Pixels to fill: centres of rows and columns in arcsec from the centre of the mask.

    Attributes
    ----------
    rows, columns : ndarray
        Pixel centres.
    centre : tuple of int
        Row and column of the mask's centre in the window.
    """

    rows: FloatArray
    columns: FloatArray
    centre: tuple[int, int]

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.rows.size, self.columns.size

    def stamp(self, side: int) -> tuple[slice, slice, tuple[slice, slice]]:
        """Where a stamp centred on the mask lies in the window, and the part of it that does."""
        spans, parts = [], []
        for middle, length in zip(self.centre, self.shape, strict=True):
            low, high = max(middle - side // 2, 0), min(middle + side // 2 + 1, length)
            spans.append(slice(low, high))
            parts.append(slice(low - middle + side // 2, high - middle + side // 2))
        return spans[0], spans[1], (parts[0], parts[1])


def window_of(psf: AnyPsf, instrument: Instrument, *, full: bool) -> Window:
    """The whole detector, or the stamp of the PSF."""
    detector = instrument.detector_of(psf.band) if psf.band else instrument.detector
    side = psf.on_axis.shape[0]
    shape = (detector.n_rows, detector.n_columns) if full else (side, side)
    centre = (detector.star_row, detector.star_column) if full else (side // 2, side // 2)
    rows, columns = (
        centred_axis(length, psf.pixel_scale_arcsec, middle) for length, middle in zip(shape, centre, strict=True)
    )
    return Window(rows, columns, centre)


def sky_transmission(psf: AnyPsf, window: Window) -> FloatArray:
    """Open fraction of every pixel behind the cross.

    There is no Lyot stop, so a uniform sky passes the focal-plane mask by geometry alone.
    """
    rows, columns = (
        pixel_axis(centres, psf.pixel_scale_arcsec, 1, _half_width(psf)).open_fraction
        for centres in (window.rows, window.columns)
    )
    return np.outer(rows, columns)


def apodizer_energy(psf: AnyPsf) -> float:
    """Energy behind the apodizer, relative to the clear disc."""
    return psf.apodizer_energy if isinstance(psf, ExternalPsf) else psf.imager.apodizer_energy


def full_star_map(psf: AnyPsf, window: Window, star_arcsec: tuple[float, float] = (0.0, 0.0)) -> FloatArray:
    """Masked star over the window with the stamp around the mask left out (the drifting frames fill it).

    Kept in the disk cache: it takes a second and changes with the instrument only. The wings of a PSF from a file end
    with its stamp.
    """
    if isinstance(psf, ExternalPsf):
        return np.zeros(window.shape)
    place = [*window.shape, *window.centre, *star_arcsec]
    key = content_hash({"optics": metrics_key(psf.instrument, psf.band), "place": place})
    stored = compute_once(f"wide-{psf.band}-{key}", lambda: {
        "image": wide_on_axis(psf.band, psf.instrument, window.shape, window.centre,
                              star_arcsec=star_arcsec).astype(np.float32)
    })  # fmt: skip
    image = stored["image"].astype(np.float64)
    side = psf.on_axis.shape[0]
    if any(star_arcsec):
        _fill_core(image, psf, window, star_arcsec, side)
    rows, columns, _ = window.stamp(side)
    image[rows, columns] = 0.0
    return image


def _fill_core(image: FloatArray, psf: Psf, window: Window, star_arcsec: tuple[float, float], side: int) -> None:
    """Put a star off the mask on the map at the settings of the PSF, a stamp around it."""
    spans = []
    for axis, place in ((window.rows, star_arcsec[1]), (window.columns, star_arcsec[0])):
        middle = int(np.abs(axis - place).argmin())
        spans.append(slice(max(middle - side // 2, 0), middle + side // 2 + 1))
    y, x = (psf.imager.axis(axis[span], masked=True)
            for axis, span in zip((window.rows, window.columns), spans, strict=True))  # fmt: skip
    image[spans[0], spans[1]] = psf.imager.image(y, x, source_arcsec=star_arcsec)


def off_axis_light(
    psf: AnyPsf,
    window: Window,
    sources: Sequence[Source],
    extended: Sequence[ExtendedRate],
    *,
    roll_deg: float,
    star_arcsec: tuple[float, float] = (0.0, 0.0),
    model: SceneModel = "exact",
) -> FloatArray:
    """Electrons per second and pixel of everything but the central star and the sky.

    Parameters
    ----------
    psf : Psf or ExternalPsf
    window : Window
    sources : sequence of Source
        Point sources, relative to the central star.
    extended : sequence of ExtendedRate
    roll_deg : float
        Roll of the telescope, for the extended sources.
    star_arcsec : tuple of float
        Place of the central star relative to the centre of the mask.
    model : {"exact", "paper"}
        Exact positions behind the mask, or the shortcut of the paper: nearest of 4 x 4 cells, no mask.

    Raises
    ------
    InputError
        If the paper's model is asked for extended sources or a PSF from a file.
    """
    if not sources and not extended:
        return np.zeros(window.shape)
    x, y = (np.array([getattr(source, f"{axis}_arcsec") for source in sources]) + shift
            for axis, shift in zip("xy", star_arcsec, strict=True))  # fmt: skip
    points = PointSources(x, y, np.array([source.rate_e_s for source in sources]))
    if model == "paper":
        if isinstance(psf, ExternalPsf) or extended:
            raise InputError("scene_model", model, allowed="exact for extended sources and for PSFs from files")
        return paper_scene_image(psf.imager, window.rows, window.columns, points)
    grids = [_grid(psf, window, item, roll_deg, star_arcsec) for item in extended]
    nodes = np.array([_wavelengths(psf, source, star_arcsec) for source in sources], dtype=int)
    total = np.zeros(window.shape)
    for count in sorted({0, *nodes.tolist()}):
        part = nodes == count
        total += scene_image(
            _transfer(psf, count),
            window.rows,
            window.columns,
            psf.pixel_scale_arcsec,
            PointSources(*(array[part] for array in points.arrays)),
            mask_half_width_arcsec=_half_width(psf),
            extended=() if count else grids,
        )
    return total


def _wavelengths(psf: AnyPsf, source: Source, star_arcsec: tuple[float, float]) -> int:
    """Wavelengths that the wings of a star need at the centre of the mask; 0 for those of the PSF.

    Over a band the wings of a source stretch by the bandwidth: at 8 arcsec by ten lambda/D, which four wavelengths
    turn into a pattern of their own. Only stars are bright enough there for it to matter.
    """
    if isinstance(psf, ExternalPsf) or source.kind != "star":
        return 0
    imager = psf.imager
    distance = math.hypot(source.x_arcsec + star_arcsec[0], source.y_arcsec + star_arcsec[1])
    low, high = imager.wavelengths_m.min(), imager.wavelengths_m.max()
    stretch = distance / imager.lambda_d_arcsec * 1.2 * (high - low) / (0.5 * (high + low))
    needed = next(count for count in _LADDER if count >= min(3 + math.ceil(1.3 * stretch), _LADDER[-1]))
    return needed if needed > max(imager.weights.size, 2) and imager.weights.size > 1 else 0


def _transfer(psf: AnyPsf, wavelength_nodes: int = 0) -> Transfer:
    if isinstance(psf, ExternalPsf):
        return KernelTransfer(psf.off_axis, psf.pixel_scale_arcsec)
    if not wavelength_nodes:
        return band_transfer(psf.imager)
    knobs = psf.knobs.model_copy(update={"wavelength_nodes": wavelength_nodes})
    return band_transfer(build_imager(psf.instrument, psf.band, knobs, spectrum=psf.spectrum))


def _half_width(psf: AnyPsf) -> float:
    return psf.mask_half_width_arcsec if isinstance(psf, ExternalPsf) else psf.imager.mask_half_width_arcsec


def _grid(
    psf: AnyPsf, window: Window, item: ExtendedRate, roll_deg: float, star_arcsec: tuple[float, float]
) -> SourceGrid:
    reach = 2.0 * max(float(np.abs(axis).max()) for axis in (window.rows, window.columns))
    grid = render_extended(
        item.source,
        step_arcsec=0.5 * psf.pixel_scale_arcsec,
        roll_deg=roll_deg,
        parity=psf.instrument.detector.parity,
        reach_arcsec=reach,
    )
    x, y = grid.x_arcsec + star_arcsec[0], grid.y_arcsec + star_arcsec[1]
    return SourceGrid(x, y, item.rate_e_s * grid.flux)
