"""Light of a scene on the pixels of a window: sky, far wings of the star, and every other source.

The star itself goes through its own propagation, frame by frame (`simulator.imaging.drift`). All other sources pass the
exact scene of `simulator.imaging.scene_image`, or, where the shortcut of Zhu et al. 2025 is asked for, the unmasked
kernel on a grid of 4 x 4 cells a pixel (`simulator.imaging.paper_scene`).
"""

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from cpic_core import FloatArray, InputError, NDArray, compute_once
from simulator.config import Instrument, content_hash
from simulator.imaging.build import build_imager
from simulator.imaging.extended import render_extended
from simulator.imaging.external import ExternalPsf
from simulator.imaging.imager import Imager, centred_axis
from simulator.imaging.paper_scene import paper_scene_image
from simulator.imaging.psf import Psf, wide_on_axis
from simulator.imaging.sampling import pixel_axis
from simulator.imaging.scene_image import PointSources, SourceGrid, scene_image
from simulator.imaging.store import metrics_key
from simulator.imaging.transfer import BandTransfer, KernelTransfer, Transfer
from simulator.knobs import Knobs
from simulator.target import ExtendedRate, Source

AnyPsf: TypeAlias = Psf | ExternalPsf
SceneModel = Literal["exact", "paper"]
N_KEPT = 4  # images of field stars, up to 9 MB each
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
        """Return where a stamp centred on the mask lies in the window, and the part of it that does."""
        spans, parts = [], []
        for middle, length in zip(self.centre, self.shape, strict=True):
            low, high = max(middle - side // 2, 0), min(middle + side // 2 + 1, length)
            spans.append(slice(low, high))
            parts.append(slice(low - middle + side // 2, high - middle + side // 2))
        return spans[0], spans[1], (parts[0], parts[1])


def window_of(psf: AnyPsf, instrument: Instrument, *, full: bool) -> Window:
    """Return the whole detector, or the stamp of the PSF.

    Parameters
    ----------
    psf : AnyPsf
    instrument : Instrument
    full : bool
        Whether the whole detector is meant.
    """
    detector = instrument.detector_of(psf.band) if psf.band else instrument.detector
    side = psf.on_axis.shape[0]
    shape = (detector.n_rows, detector.n_columns) if full else (side, side)
    centre = (detector.star_row, detector.star_column) if full else (side // 2, side // 2)
    scale = psf.pixel_scale_arcsec
    rows, columns = (centred_axis(length, scale, middle) for length, middle in zip(shape, centre, strict=True))
    return Window(rows, columns, centre)


def sky_transmission(psf: AnyPsf, window: Window) -> FloatArray:
    """Open fraction of every pixel behind the cross.

    There is no Lyot stop, so a uniform sky passes the focal-plane mask by geometry alone.
    """
    axes = [pixel_axis(axis, psf.pixel_scale_arcsec, 1, _half_width(psf)) for axis in (window.rows, window.columns)]
    return np.outer(axes[0].open_fraction, axes[1].open_fraction)


def apodizer_energy(psf: AnyPsf) -> float:
    """Return the energy behind the apodizer, relative to the clear disc."""
    return psf.apodizer_energy if isinstance(psf, ExternalPsf) else psf.imager.apodizer_energy


def full_star_map(psf: AnyPsf, window: Window, star_arcsec: tuple[float, float] = (0.0, 0.0)) -> FloatArray:
    """Return the masked star over the window with the stamp around the mask left out (the drifting frames fill it).

    Kept in the disk cache: it takes a second and changes with the instrument only. The wings of a PSF from a file end
    with its stamp.

    Parameters
    ----------
    psf : AnyPsf
    window : Window
    star_arcsec : tuple of float, optional
        Offset (x, y) of the star from the mask's centre, arcsec.
    """
    if isinstance(psf, ExternalPsf):
        return np.zeros(window.shape)
    place = [*window.shape, *window.centre, *star_arcsec]
    key = content_hash({"optics": metrics_key(psf.instrument, psf.band), "place": place})

    def computed() -> dict[str, NDArray[Any]]:
        return {"image": _wide(psf, window, star_arcsec).astype(np.float32)}

    def image_of(found: Mapping[str, NDArray[Any]]) -> FloatArray:
        return found["image"].astype(np.float64).reshape(window.shape)

    image = compute_once(f"wide-{key}", computed, image_of)
    side = psf.on_axis.shape[0]
    if any(star_arcsec):
        _fill_core(image, psf, window, star_arcsec, side)
    rows, columns, _ = window.stamp(side)
    image[rows, columns] = 0.0
    return image


def star_column_light(
    psf: AnyPsf, window: Window, rows: NDArray[np.bool_], star_arcsec: tuple[float, float] = (0.0, 0.0)
) -> FloatArray:
    """Return the masked unit star's light in rows of a window, summed over columns; none for a PSF from a file.

    The light of `full_star_map`, kept in the disk cache as well.

    Parameters
    ----------
    psf : AnyPsf
    window : Window
    rows : ndarray of bool
        Rows that are meant, shape (y,).
    star_arcsec : tuple of float, optional
        Offset (x, y) of the star from the mask's centre, arcsec.
    """
    if isinstance(psf, ExternalPsf):
        return np.zeros(window.columns.size)
    place = [*window.shape, *window.centre, *star_arcsec, *np.flatnonzero(np.diff(rows)).tolist()]
    key = content_hash({"optics": metrics_key(psf.instrument, psf.band), "columns": place})
    name = f"columns-{key}"

    def computed() -> dict[str, NDArray[Any]]:
        return {"light": _wide(psf, window, star_arcsec)[rows].sum(axis=0)}

    return compute_once(name, computed, lambda found: found["light"].reshape(window.columns.shape))


def _wide(psf: Psf, window: Window, star_arcsec: tuple[float, float]) -> FloatArray:
    return wide_on_axis(psf.band, psf.instrument, window.shape, window.centre, star_arcsec=star_arcsec)


def _fill_core(image: FloatArray, psf: Psf, window: Window, star_arcsec: tuple[float, float], side: int) -> None:
    """Put a star off the mask on the map at the settings of the PSF, a stamp around it."""
    spans, axes = [], []
    for axis, place in ((window.rows, star_arcsec[1]), (window.columns, star_arcsec[0])):
        middle = int(np.abs(axis - place).argmin())
        span = slice(max(middle - side // 2, 0), middle + side // 2 + 1)
        spans.append(span)
        axes.append(psf.imager.axis(axis[span], masked=True))
    image[spans[0], spans[1]] = psf.imager.image(*axes, source_arcsec=star_arcsec)


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
    """Return the electrons per second and pixel of everything but the central star and the sky.

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
    x = np.array([source.x_arcsec for source in sources]) + star_arcsec[0]
    y = np.array([source.y_arcsec for source in sources]) + star_arcsec[1]
    rates = np.array([source.rate_e_s for source in sources])
    if isinstance(psf, ExternalPsf):
        rates = rates * psf.passed(x, y)
    if model == "paper":
        if isinstance(psf, ExternalPsf) or extended:
            raise InputError("scene_model", model, allowed="exact for extended sources and for PSFs from files")
        return paper_scene_image(_coarsest(psf), window.rows, window.columns, PointSources(x, y, rates))
    nodes = np.array([_wavelengths(psf, source, star_arcsec) for source in sources], dtype=int)
    stars = np.array([source.kind == "star" for source in sources], dtype=bool)
    total = np.zeros(window.shape)
    if stars.any():
        total += _starlight(_Stars(psf, window, *(part[stars] for part in (nodes, x, y, rates))))
    grids = [_grid(psf, window, item, roll_deg, star_arcsec) for item in extended]
    if grids or not stars.all():
        # Beside the light of stars the image of a planet would keep only their rounding.
        total += _image(psf, window, 0, PointSources(*(part[~stars] for part in (x, y, rates))), grids)
    return total


class _Stars:
    """Stars behind some optics on a window, equal to any others of the same content."""

    def __init__(self, psf: AnyPsf, window: Window, nodes: NDArray[np.int_], *points: FloatArray) -> None:
        self.psf, self.window, self.nodes, self.points = psf, window, nodes, points
        arrays: list[NDArray[Any]] = [window.rows, window.columns, nodes, *points]
        optics = psf.content_hash if isinstance(psf, ExternalPsf) else psf.imager.content_key
        if isinstance(psf, Psf) and psf.spectrum is not None:
            # With other wavelengths than its own the model is built anew, with the same spectrum.
            arrays += [psf.spectrum.wavelength_nm, psf.spectrum.photlam]
        self._key = (optics, psf.instrument.content_hash, *(array.tobytes() for array in arrays))

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Stars) and other._key == self._key


@functools.lru_cache(maxsize=N_KEPT)
def _starlight(stars: _Stars) -> FloatArray:
    """Return electrons per second and pixel of all stars but the central one; kept, as two visits see the same."""
    total = np.zeros(stars.window.shape)
    for count in np.unique(stars.nodes).tolist():
        part = stars.nodes == count
        points = PointSources(*(array[part] for array in stars.points))
        total += _image(stars.psf, stars.window, count, points, ())
    total.flags.writeable = False
    return total


def forget_starlight() -> None:
    """Drop the light of field stars that earlier observations left, so that the next one is timed as the first."""
    _starlight.cache_clear()


def _image(psf: AnyPsf, window: Window, nodes: int, points: PointSources, grids: Sequence[SourceGrid]) -> FloatArray:
    return scene_image(
        _transfer(psf, nodes),
        window.rows,
        window.columns,
        psf.pixel_scale_arcsec,
        points,
        mask_half_width_arcsec=_half_width(psf),
        extended=grids,
    )


def _wavelengths(psf: AnyPsf, source: Source, star_arcsec: tuple[float, float]) -> int:
    """Return the wavelengths that the wings of a star need at the centre of the mask; 0 for those of the PSF.

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
    return BandTransfer(_coarsest(psf, wavelength_nodes))


def _coarsest(psf: Psf, wavelength_nodes: int = 0) -> Imager:
    """Return the optics on the coarsest grid that holds the steps of the pupil: the field is exact there."""
    least = psf.knobs.model_copy(update={"pupil_samples": Knobs().pupil_samples})
    if not wavelength_nodes and least == psf.knobs:
        return psf.imager
    knobs = least.model_copy(update={"wavelength_nodes": wavelength_nodes or least.wavelength_nodes})
    return build_imager(psf.instrument, psf.band, knobs, spectrum=psf.spectrum)


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
    flux = item.rate_e_s * grid.flux
    return SourceGrid(x, y, flux * psf.extended(x[None, :], y[:, None]) if isinstance(psf, ExternalPsf) else flux)
