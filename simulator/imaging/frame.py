"""Light of a scene on the pixels of a window: sky, far wings of the star, and every other source.

The star itself goes through its own propagation, frame by frame (`simulator.imaging.drift`). All other sources pass
the exact scene of `simulator.imaging.scene_image`, or, where the shortcut of Zhu et al. 2025 is asked for, the
unmasked kernel on a grid of 4 x 4 cells a pixel.

Extended sources become grids of point fluxes on the detector. Light is dealt out in small parcels, each to the four
grid points around it in proportion to how near they are. That keeps the total and the centre of light exactly, sharp
edges and edge-on discs included, and widens an image by at most half a step rms. Parcels of a disc are cells of rings
in its own plane, whose light is known in closed form; those of an image are equal parts of its pixels.
"""

import functools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from cpic_core import FloatArray, InputError, Keyed, NDArray, Record, compute_once
from simulator.config import DiscSource, ExtendedSource, ImageSource, Instrument, RingSource, content_hash
from simulator.config.map_files import SCALE_TOLERANCE, pixel_scale, read_maps, real_map
from simulator.imaging.build import build_imager
from simulator.imaging.external import ExternalPsf
from simulator.imaging.imager import Imager
from simulator.imaging.psf import Psf, wide_on_axis
from simulator.imaging.sampling import centred_axis, overlap, pixel_axis
from simulator.imaging.scene_image import (
    BandTransfer,
    KernelTransfer,
    PointSources,
    SourceGrid,
    Transfer,
    paper_scene_image,
    scene_image,
)
from simulator.imaging.store import metrics_key
from simulator.knobs import Knobs
from simulator.target import ExtendedRate, Source, sky_to_detector

PARCELS_PER_STEP = 3
MAX_POINTS = 6001
"""Largest number of grid points a side."""
CHUNK = 1 << 19
RING_SIGMAS = 6.0
FWHM_PER_SIGMA = 2.0 * math.sqrt(2.0 * math.log(2.0))


_Parcels: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
# Offsets from the centre of the source on the sky toward east and toward north, and the light there.


def render_extended(
    source: ExtendedSource,
    *,
    step_arcsec: float,
    roll_deg: float = 0.0,
    parity: int = -1,
    reach_arcsec: float | None = None,
) -> SourceGrid:
    """Deal out the light of an extended source to a grid on the detector.

    Parameters
    ----------
    source : DiscSource, RingSource or ImageSource
    step_arcsec : float
        Step of the grid, above 0. On the telescope's image the grid is seen as a slight blur that goes with the square
        of the step: at a quarter of a detector pixel at most 0.05 % of the peak for a face-on disc and 0.2 % for
        one seen edge-on or a ring of a pixel's width; four times that at half a pixel.
    roll_deg : float
        Roll of the telescope; it turns the sky on the detector.
    parity : {-1, +1}
        Orientation of the detector.
    reach_arcsec : float, optional
        Leave out what lies beyond ``|x|`` or ``|y|`` of this; the whole source if omitted.

    Returns
    -------
    SourceGrid
        Fraction of the source's light at each point, whole multiples of the step from the star; it sums to 1, or to
        what lies within the reach asked for.

    Raises
    ------
    InputError
        If the grid would have more than 6001 points a side, or an image cannot be
        read, has no pixel scale, or is not finite and non-negative.
    """
    limit = math.inf if reach_arcsec is None else math.sqrt(2.0) * reach_arcsec + source.center_separation_arcsec
    if isinstance(source, ImageSource):
        picture = _read(source)
        extent = picture.extent_arcsec
        parcels = _image_parcels(picture, source.pa_deg, step_arcsec, limit)
    else:
        extent = _outer(source)
        parcels = _disc_parcels(source, step_arcsec, limit)
    # The map from sky to detector is linear: the offsets of one arcsec toward east and north tell all of it.
    separations_arcsec = [source.center_separation_arcsec, 1.0, 1.0]
    angles_deg = [source.center_pa_deg, 90.0, 0.0]
    x, y = sky_to_detector(separations_arcsec, angles_deg, roll_deg=roll_deg, parity=parity)
    x_axis, y_axis = (_axis(float(part[0]), extent, step_arcsec, reach_arcsec) for part in (x, y))
    flux = np.zeros((y_axis.size, x_axis.size))
    for east, north, light in parcels:
        column = (x[0] + east * x[1] + north * x[2] - x_axis[0]) / step_arcsec
        row = (y[0] + east * y[1] + north * y[2] - y_axis[0]) / step_arcsec
        _deal(flux, column, row, light)
    return SourceGrid(x_axis, y_axis, flux)


def _axis(middle: float, extent: float, step: float, reach: float | None) -> FloatArray:
    """Return the whole multiples of the step that enclose the source, none beyond the reach; at least two."""
    low, high = math.floor((middle - extent) / step) - 1, math.ceil((middle + extent) / step) + 1
    if reach is not None:
        last = max(1, math.floor(reach / step * (1 + 1e-12)))
        low, high = max(low, -last), min(high, last)
        if high <= low:
            low, high = -1, 1  # nothing of the source lies within the reach
    if high - low + 1 > MAX_POINTS:
        hint = f"the source needs {high - low + 1}; give reach_arcsec"
        raise InputError("step_arcsec", step, unit="arcsec", allowed=f"at most {MAX_POINTS} points a side", hint=hint)
    return np.arange(low, high + 1, dtype=np.float64) * step


def _deal(flux: FloatArray, column: FloatArray, row: FloatArray, light: FloatArray) -> None:
    """Add parcels to the four points around each, in place; what lies outside the grid is left out."""
    n_y, n_x = flux.shape
    inside = (column >= 0) & (column <= n_x - 1) & (row >= 0) & (row <= n_y - 1)
    column, row, light = column[inside], row[inside], light[inside]
    i, j = np.minimum(row.astype(np.intp), n_y - 2), np.minimum(column.astype(np.intp), n_x - 2)
    p, q = row - i, column - j
    flat = flux.reshape(-1)
    first = i * n_x + j
    low, high = light * (1 - p), light * p
    for step, part in ((0, low * (1 - q)), (1, low * q), (n_x, high * (1 - q)), (n_x + 1, high * q)):
        np.add.at(flat, first + step, part)


def _sky(separation: float, pa_deg: float) -> tuple[float, float]:
    """Return the offset toward east and toward north."""
    angle = math.radians(pa_deg)
    return separation * math.sin(angle), separation * math.cos(angle)


def _outer(source: DiscSource | RingSource) -> float:
    if isinstance(source, DiscSource):
        return source.outer_arcsec
    return source.radius_arcsec + RING_SIGMAS * source.fwhm_arcsec / FWHM_PER_SIGMA


def _rings(source: DiscSource | RingSource, step: float) -> tuple[FloatArray, FloatArray]:
    """Return the radii of thin rings, where their light is on average, and their light, which sums to 1."""
    outer = _outer(source)
    if isinstance(source, DiscSource):
        inner, width = source.inner_arcsec, step / PARCELS_PER_STEP
    else:
        sigma = source.fwhm_arcsec / FWHM_PER_SIGMA
        inner, width = max(source.radius_arcsec - RING_SIGMAS * sigma, 0.0), min(step / PARCELS_PER_STEP, sigma / 8)
    edges = np.linspace(inner, outer, max(1, math.ceil((outer - inner) / width)) + 1)
    if isinstance(source, DiscSource):
        light, moment = (_power_integral(edges / outer, source.slope + power) for power in (1.0, 2.0))
        moment = moment * outer
    else:
        nodes, weights = np.polynomial.legendre.leggauss(4)
        r = 0.5 * (edges[1:] + edges[:-1])[:, None] + 0.5 * np.diff(edges)[:, None] * nodes
        density = r * np.exp(-0.5 * ((r - source.radius_arcsec) / sigma) ** 2)
        light, moment = density @ weights, (density * r) @ weights
    keep = light > 0
    return moment[keep] / light[keep], light[keep] / light.sum()


def _power_integral(edges: FloatArray, power: float) -> FloatArray:
    """Return the integral of ``r^power`` between neighbouring edges; the first edge may be 0 if the power is > -1."""
    above = power + 1.0
    low, high = edges[:-1], edges[1:]
    with np.errstate(divide="ignore"):
        ratio = np.log(high) - np.log(low)
    if above == 0.0:
        return ratio
    # High less low to the same power, without the cancellation for powers near -1.
    return np.asarray(-(high**above) * np.expm1(-above * ratio) / above)


def _disc_parcels(source: DiscSource | RingSource, step: float, limit: float) -> Iterator[_Parcels]:
    """Yield the cells of rings, projected on the sky; rings that lie wholly beyond the limit are passed over."""
    radii, light = _rings(source, step)
    tilt = math.cos(math.radians(source.inclination_deg)) if source.inclination_deg < 90 else 0.0
    major = _sky(1.0, source.pa_deg)
    minor = (major[1] * tilt, -major[0] * tilt)
    near = radii * tilt <= limit
    radii, light = radii[near], light[near]
    counts = np.maximum(np.ceil(2 * np.pi * radii * PARCELS_PER_STEP / step), 16).astype(np.intp)
    counts += (-counts) % 4  # a ring of 4m parcels is as symmetric as the ellipse
    first = 0
    while first < radii.size:
        total = np.cumsum(counts[first:])
        last = first + max(1, int(np.searchsorted(total, CHUNK, side="right")))
        size = counts[first:last]
        place = np.arange(size.sum()) - np.repeat(np.cumsum(size) - size, size)
        # Every other ring is turned by half a cell, so that neighbours do not line up.
        turn = np.repeat(0.5 * (np.arange(first, last) % 2), size)
        angle = 2 * np.pi * (place + turn) / np.repeat(size, size)
        r = np.repeat(radii[first:last], size)
        along, across = r * np.cos(angle), r * np.sin(angle)
        east = along * major[0] + across * minor[0]
        north = along * major[1] + across * minor[1]
        yield east, north, np.repeat(light[first:last] / size, size)
        first = last


class _Picture(NamedTuple):
    """Image with sum 1, its pixel, and column and row of its centre."""

    image: FloatArray
    pixel_arcsec: float
    middle: tuple[float, float]

    @property
    def extent_arcsec(self) -> float:
        """Distance of the farthest corner from the centre."""
        n_y, n_x = self.image.shape
        x, y = self.middle
        return self.pixel_arcsec * math.hypot(max(x + 0.5, n_x - 0.5 - x), max(y + 0.5, n_y - 0.5 - y))


def _read(source: ImageSource) -> _Picture:
    """Read and check an image."""
    key = f"extended {source.name}".strip()
    file = read_maps(key, source.file)
    found = file.maps[0] if file.is_fits or len(file.maps) == 1 else file.named("image")
    if found is None:
        raise InputError(key, source.file, allowed="an npz file with an array named image")
    image = real_map(key, source.file, found.data, square=False)
    if image.min() < 0:
        allowed = "no negative values"
        raise InputError(key, source.file, allowed=allowed, hint=f"{(image < 0).sum()} are, down to {image.min():.3g}")
    if not image.any():
        raise InputError(key, source.file, allowed="an image with light in it")
    stated = pixel_scale(key, source.file, found.header)
    scale = file.named("pixel_scale_arcsec") if not file.is_fits else None
    if scale is not None:
        stated = float(real_map(key, source.file, np.atleast_2d(scale.data), square=False)[0, 0])
    asked = source.pixel_scale_arcsec
    if asked is not None and stated is not None and abs(asked / stated - 1) > SCALE_TOLERANCE:
        allowed = f"{stated:g}, as the file says"
        raise InputError("pixel_scale_arcsec", asked, unit="arcsec", allowed=allowed, hint=source.file)
    pixel = stated if asked is None else asked
    if pixel is None:
        allowed = "a value, or PIXSCALE or CDELT in the header"
        raise InputError("pixel_scale_arcsec", "missing", unit="arcsec", allowed=allowed, hint=source.file)
    if not 0 < pixel <= 10:
        raise InputError("pixel_scale_arcsec", pixel, unit="arcsec", allowed="above 0, at most 10", hint=source.file)
    n_y, n_x = image.shape
    middle = source.center_pixel or ((n_x - 1) / 2, (n_y - 1) / 2)
    if not (-0.5 <= middle[0] <= n_x - 0.5 and -0.5 <= middle[1] <= n_y - 0.5):
        raise InputError("center_pixel", middle, unit="px", allowed=f"inside the image of {n_x} x {n_y}")
    return _Picture(image / image.sum(), pixel, (float(middle[0]), float(middle[1])))


def _image_parcels(picture: _Picture, pa_deg: float, step: float, limit: float) -> Iterator[_Parcels]:
    """Yield equal parts of the pixels, small beside the step, on the sky, without what is dark or too far."""
    image, pixel, (middle_x, middle_y) = picture
    parts = max(1, math.ceil(pixel * PARCELS_PER_STEP / step - 1e-9))
    fine = (np.arange(parts) + 0.5) / parts - 0.5
    up, right = _sky(1.0, pa_deg), _sky(1.0, pa_deg - 90.0)  # west is to the right
    rows, columns = np.nonzero(image)
    near = np.hypot(rows - middle_y, columns - middle_x) - 1.0 <= limit / pixel
    rows, columns = rows[near], columns[near]
    per_pixel = parts * parts
    chunk = max(1, CHUNK // per_pixel)
    for start in range(0, rows.size, chunk):
        row, column = rows[start : start + chunk], columns[start : start + chunk]
        shape = (row.size, parts, parts)
        y = np.broadcast_to((row - middle_y)[:, None, None] + fine[:, None], shape).ravel() * pixel
        x = np.broadcast_to((column - middle_x)[:, None, None] + fine, shape).ravel() * pixel
        light = np.repeat(image[row, column] / per_pixel, per_pixel)
        yield x * right[0] + y * up[0], x * right[1] + y * up[1], light


AnyPsf: TypeAlias = Psf | ExternalPsf
SceneModel = Literal["exact", "paper"]
N_KEPT = 4  # images of field stars, up to 9 MB each
# Numbers of wavelengths for far sources: few, since sources of one number share a pass.
_LADDER = (5, 8, 12, 17, 24, 33)


class Window(Record, eq=False):
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
        places = zip(self.centre, self.shape, strict=True)
        (rows, above), (columns, beside) = (overlap(middle, side // 2, length) for middle, length in places)
        return rows, columns, (above, beside)


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
    axes = [
        pixel_axis(axis, psf.pixel_scale_arcsec, 1, psf.mask_half_width_arcsec)
        for axis in (window.rows, window.columns)
    ]
    return np.outer(axes[0].open_fraction, axes[1].open_fraction)


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
        total += _starlight(_Stars(psf, window, nodes[stars], (x[stars], y[stars], rates[stars])).keyed)
    grids = [_grid(psf, window, item, roll_deg, star_arcsec) for item in extended]
    if grids or not stars.all():
        # Beside the light of stars the image of a planet would keep only their rounding.
        total += _image(psf, window, 0, PointSources(*(part[~stars] for part in (x, y, rates))), grids)
    return total


class _Stars(NamedTuple):
    """Stars behind some optics on a window."""

    psf: AnyPsf
    window: Window
    nodes: NDArray[np.int_]
    points: tuple[FloatArray, ...]

    @property
    def keyed(self) -> "Keyed[_Stars]":
        """The same, equal to any others of the same content."""
        psf, arrays = self.psf, [self.window.rows, self.window.columns, self.nodes, *self.points]
        optics = psf.content_hash if isinstance(psf, ExternalPsf) else psf.imager.content_key
        if isinstance(psf, Psf) and psf.spectrum is not None:
            # With other wavelengths than its own the model is built anew, with the same spectrum.
            arrays += [psf.spectrum.wavelength_nm, psf.spectrum.photlam]
        return Keyed((optics, psf.instrument.content_hash, *(array.tobytes() for array in arrays)), self)


@functools.lru_cache(maxsize=N_KEPT)
def _starlight(keyed: Keyed[_Stars]) -> FloatArray:
    """Return electrons per second and pixel of all stars but the central one; kept, as two visits see the same."""
    stars = keyed.value
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
        mask_half_width_arcsec=psf.mask_half_width_arcsec,
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
    x, y, light = grid.arrays
    x, y, flux = x + star_arcsec[0], y + star_arcsec[1], item.rate_e_s * light
    return SourceGrid(x, y, flux * psf.extended(x[None, :], y[:, None]) if isinstance(psf, ExternalPsf) else flux)
