"""A coronagraph as a yield input package: the folder of images that AYO, EXOSIMS, pyEDITH and yippy read.

Images of the star by its diameter (``stellar_intens.fits``, ``stellar_intens_diam_list.fits``), of sources by their
offset (``offax_psf.fits``, ``offax_psf_offset_list.fits``) and of an even sky (``sky_trans.fits``): parts of the light
on the collecting area in each pixel, angles in lambda/D, the star at ``XCENTER, YCENTER``, counted from 0. Source of
the format: the readers of EXOSIMS (``process_opticalsys_package``) and of yippy 2.10.6, which agree on this.
"""

import functools
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import FloatArray, InputError, NDArray, digest_of, is_file, overlap_weights
from simulator.config.coronagraph_table import KEY, CoronagraphTable, checked, sha256_of
from simulator.config.map_files import header_number, read_maps

STAR, DIAMETERS = "stellar_intens.fits", "stellar_intens_diam_list.fits"
SOURCES, OFFSETS = "offax_psf.fits", "offax_psf_offset_list.fits"
SKY = "sky_trans.fits"
FILES = (STAR, DIAMETERS, SOURCES, OFFSETS, SKY)
_CUT, _STEP = 4, 0.05
"""Parts into which a pixel is cut along each axis for means over rings, and width of the rings in pixels."""
_ROW_LAMBDA_D, _TURNS = 0.05, 360
_ROUNDING, _LEAST_SHIFT, _MOST_SHIFT = 1e-3, 0.1, 1.5


def is_package(path: str) -> bool:
    """Return whether a path is a folder with at least one of the files of a yield input package."""
    return any(is_file(Path(path) / name) for name in FILES)


@functools.lru_cache(maxsize=16)
def read_yield_package(
    path: str,
    states: tuple[Any, ...],
    lambda_d_arcsec: float,
    diameter_m: float | None,
    aperture_arcsec: float,
    star_diameter_mas: float | None,
) -> CoronagraphTable:
    """Read the table of a coronagraph from its images.

    The core throughput is the light of a source in an aperture around it, exact for light that is even within a pixel;
    between the offsets it is linear, and beyond the first and last one, or where the aperture would leave the images,
    the table ends. Starlight and sky are means over all position angles, every 0.05 lambda/D; between two diameters
    of the star they are linear. Offsets in two dimensions give means over circles.

    Parameters
    ----------
    path : str
        The folder.
    states : tuple
        What changes with its files: the same is read once.
    lambda_d_arcsec : float
        lambda/D of the images.
    diameter_m : float, optional
        The D of that lambda/D: what the images were made for is compared with it.
    aperture_arcsec : float
        Radius of the photometric aperture.
    star_diameter_mas : float, optional
        Angular diameter of the star; the smallest of the package if not given.

    Raises
    ------
    InputError
        Naming file, card, value and range: a file is missing or damaged, two do not belong together, or the images are
        none of a coronagraph.
    """
    folder = Path(path)
    lacking = [name for name in FILES if not is_file(folder / name)]
    if lacking:
        allowed = f"the folder of a yield input package: {', '.join(FILES)}"
        raise InputError(KEY, path, allowed=allowed, hint=f"without {', '.join(lacking)}")
    star = None if star_diameter_mas is None else round(1e-3 * star_diameter_mas / lambda_d_arcsec, 9)
    found, header = _measured(path, states, round(aperture_arcsec / lambda_d_arcsec, 9), star)
    notes = found.notes + _another_telescope(found.file, header, lambda_d_arcsec, diameter_m)
    return checked(replace(found, separation_arcsec=found.separation_arcsec * lambda_d_arcsec, notes=notes))


@functools.lru_cache(maxsize=8)
def _measured(
    path: str, states: tuple[Any, ...], aperture_lambda_d: float, star_lambda_d: float | None
) -> tuple[CoronagraphTable, Mapping[str, Any]]:
    """Return the table with its separations in lambda/D, which all bands share, and the header of the star's images."""
    folder = Path(path)
    sources, header = _images(folder / SOURCES, 3)
    stars, star_header = _images(folder / STAR, 3)
    sky, sky_header = _images(folder / SKY, 2)
    pixel = _pixel(folder / STAR, star_header, None)
    for name, cards in ((SOURCES, header), (SKY, sky_header)):
        _pixel(folder / name, cards, pixel)
    diameters = _list(folder / DIAMETERS, len(stars)).reshape(-1)
    diameter, star = _star_of(folder / DIAMETERS, stars, diameters, star_lambda_d)
    radius = aperture_lambda_d / pixel
    offsets, centre, shift = _places(folder, sources, _list(folder / OFFSETS, len(sources)), header, pixel)
    x, y = (centre + shift + offsets / pixel).T
    # Another convention of the centre is that of all files that state the same.
    middles = [
        np.add(own, shift) if np.allclose(own := _centre(folder / name, image, cards), centre) else np.asarray(own)
        for name, image, cards in ((STAR, star, star_header), (SKY, sky, sky_header))
    ]
    cores = [_around(image, right, up, radius) for image, right, up in zip(sources, x, y, strict=True)]
    separation, core = _rings(offsets, np.array([math.nan if cut is None else cut[0].sum() for cut in cores]))
    rooms = (_room(folder / name, image, at) for name, image, at in zip((STAR, SKY), (star, sky), middles, strict=True))
    reach = min(rooms) - radius
    whole = separation <= reach * pixel
    if np.count_nonzero(core[whole] > 0) < 2:
        allowed = f"two offsets, with light, whose apertures of {aperture_lambda_d:.3g} lambda/D are on the images"
        raise InputError(KEY, str(folder / OFFSETS), allowed=allowed)
    separation, core = separation[whole], core[whole]
    steps = np.arange(separation[0], separation[-1], _ROW_LAMBDA_D)
    place = np.unique(np.concatenate([separation, steps]).round(9))
    core = np.interp(place, separation, core)
    light, through = (
        _ring_means(image, at, place / pixel, radius) for image, at in zip((star, sky), middles, strict=True)
    )
    through /= math.pi * radius**2
    if through.max() > 1.05:
        raise InputError(f"{KEY} {SKY}", float(through.max()), allowed="0 to 1: the part of an even sky's light")
    # Where the aperture holds the star, or it is brighter than a source of its own light, nobody looks for planets.
    good = (core > 0) & (light <= core) & (place > aperture_lambda_d)
    best, lost = int(np.where(good, core, -1.0).argmax()), np.flatnonzero(~good)
    edge = int(np.searchsorted(lost, best))
    kept = slice(int(lost[edge - 1]) + 1 if edge else 0, int(lost[edge]) if edge < len(lost) else None)
    if len(place[kept]) < 2:
        raise InputError(KEY, str(folder / STAR), allowed="a star fainter behind the mask than a source beside it")
    place, core, light, through = place[kept], core[kept], light[kept], np.minimum(through[kept], 1.0)
    origin = (
        f"{folder.name}, a yield input package: core_throughput from {SOURCES} ({len(sources)} offsets), raw_contrast "
        f"from it and {STAR} (star of {diameter:.3g} lambda/D), in apertures of {aperture_lambda_d:.3g} lambda/D at "
        f"{place[0]:.3g} to {place[-1]:.3g} lambda/D; occulter_transmission from {SKY}; not used: the images themselves"
    )
    moved = (
        f"{folder.name}: sources are {shift[0]:+.2f}, {shift[1]:+.2f} pixels from where {SOURCES} says; moved by that"
    )
    notes = (moved,) * bool(shift.any())
    columns = {"core_throughput": core, "raw_contrast": light / core, "occulter_transmission": through}
    digest = sha256_of("".join(digest_of(folder / name) for name in FILES).encode())
    return CoronagraphTable(folder.name, digest, place, columns, notes, origin=origin), star_header


def _another_telescope(
    name: str, header: Mapping[str, Any], lambda_d_arcsec: float, diameter_m: float | None
) -> tuple[str, ...]:
    """Return a remark where band or diameter are none that the images were made for, as far as the header says."""
    cards = (header_number(f"{KEY} {STAR}", name, header, card) for card in ("MINLAM", "MAXLAM", "D"))
    low, high, made_m = (math.nan if value is None else value for value in cards)
    low, high = (1e3 * edge if edge < 10.0 else edge for edge in (low, high))  # in um by EXOSIMS, or in nm
    if diameter_m is None:
        return ()
    nm = 1e9 * diameter_m * math.radians(lambda_d_arcsec / 3600.0)
    if not (nm < 0.99 * low or nm > 1.01 * high or abs(made_m / diameter_m - 1.0) > 0.01):
        return ()
    made = [f"{low:.4g} to {high:.4g} nm"] * (low <= high) + [f"a diameter of {made_m:.4g} m"] * (made_m > 0)
    taken = f"its lambda/D is taken for that of {nm:.4g} nm and {diameter_m:.4g} m"
    return (f"{name}: made for {' and '.join(made)}; {taken}",)


def _images(path: Path, dimensions: int) -> tuple[FloatArray, Mapping[str, Any]]:
    """Return square images of parts of light and their header."""
    found = read_maps(KEY, path).maps[0]
    data = np.asarray(found.data)
    if data.ndim != dimensions or data.shape[-1] != data.shape[-2] or data.dtype.kind not in "fiu":
        allowed = "a cube of square images" if dimensions == 3 else "one square image"
        raise InputError(KEY, str(path), allowed=allowed, hint=f"{data.dtype.name} of shape {data.shape}")
    images = data.astype(np.float64)
    worst = float(images.min())
    if not np.isfinite(images).all() or worst < -_ROUNDING * float(images.max()):
        raise InputError(KEY, str(path), allowed="finite values, none negative", hint=f"the least is {worst:.3g}")
    most = float(images.sum(axis=(-2, -1)).max()) if dimensions == 3 else 0.0
    if most > 1.0 + _ROUNDING:
        raise InputError(KEY, str(path), allowed="parts of the light: a sum of at most 1", hint=f"it is {most:.6g}")
    return np.maximum(images, 0.0, out=images), found.header


def _list(path: Path, number: int) -> FloatArray:
    """Return a list of one or two numbers for each image, ``(number, 1)`` or ``(number, 2)``."""
    data = np.asarray(read_maps(KEY, path).maps[0].data)
    rows = data.reshape(-1, 1) if data.size == number else data.T if data.shape == (2, number) != (2, 2) else data
    if rows.ndim != 2 or rows.shape[0] != number or rows.shape[1] > 2 or rows.dtype.kind not in "fiu":
        raise InputError(KEY, str(path), allowed=f"a number for each of {number} images", hint=f"shape {data.shape}")
    if not np.isfinite(rows).all():
        raise InputError(KEY, str(path), allowed="finite numbers")
    return rows.astype(np.float64)


def _pixel(path: Path, header: Mapping[str, Any], other: float | None) -> float:
    """Return the pixel in lambda/D; that of another file where this one does not say, and no other."""
    said = header_number(f"{KEY} {path.name}", path, header, "PIXSCALE")
    pixel = other if said is None else said
    allowed = "above 0 lambda/D" if other is None else f"{other:g} lambda/D, as in {STAR}"
    if pixel is None or not pixel > 0 or abs(pixel / (other or pixel) - 1.0) > _ROUNDING:
        raise InputError(f"{KEY} {path.name} PIXSCALE", "missing" if pixel is None else pixel, allowed=allowed)
    return pixel


def _centre(path: Path, image: FloatArray, header: Mapping[str, Any]) -> tuple[float, float]:
    """Return the star's place ``(x, y)``, pixel centres at whole numbers from 0; ``n / 2`` where no card says it."""
    cards = (header_number(f"{KEY} {path.name}", path, header, f"{axis}CENTER") for axis in "XY")
    x, y = (image.shape[-1] / 2 if value is None else value for value in cards)
    return x, y


def _room(path: Path, image: FloatArray, centre: FloatArray) -> float:
    """Return the largest circle around the star on an image, in pixels."""
    x, y = (float(part) for part in centre)
    room = float(min(x, y, len(image) - 1 - x, len(image) - 1 - y)) + 0.5
    if room <= 1.0:
        raise InputError(f"{KEY} {path.name} XCENTER, YCENTER", (x, y), unit="px", allowed="a pixel of the image")
    return room


def _star_of(
    path: Path, stars: FloatArray, diameters: FloatArray, asked_lambda_d: float | None
) -> tuple[float, FloatArray]:
    """Return the diameter of the star in lambda/D and its image, linear between two diameters."""
    order = np.argsort(diameters, kind="stable")
    least, most = (float(diameters[order[at]]) for at in (0, -1))
    asked = least if asked_lambda_d is None else asked_lambda_d
    if not least <= asked <= most:
        allowed = f"{least:g} to {most:g} lambda/D, those of {path.name}"
        raise InputError("coronagraph.star_diameter_mas", f"{asked:.4g} lambda/D", allowed=allowed)
    weights = [float(np.interp(asked, diameters[order], row)) for row in np.eye(len(order))]
    return asked, np.tensordot(weights, stars[order], axes=1)


def _places(
    folder: Path, sources: FloatArray, listed: FloatArray, header: Mapping[str, Any], pixel: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the offsets ``(n, 2)`` in lambda/D, the stated centre, and how far sources are from there, in pixels.

    One number for each image is an offset along x, or along y where the light is there. Where the brightest source is
    not quite where centre and offset put it, the difference is that of all: it is the convention of the centre.
    """
    centre = np.array(_centre(folder / SOURCES, sources, header))
    number = int(sources.max(axis=(1, 2)).argmax())
    image = sources[number]
    if not image.any():
        raise InputError(KEY, str(folder / SOURCES), allowed="images of sources with light in them")
    seen = np.array(np.unravel_index(int(image.argmax()), image.shape)[::-1], np.float64)
    for _ in range(20):  # the middle of the light around the middle
        cut = _around(image, seen[0], seen[1], 1.0 / pixel)
        if cut is None:
            break
        light, rows, columns = cut
        seen = np.array([(light.sum(axis=0) * columns).sum(), (light.sum(axis=1) * rows).sum()]) / light.sum()
    zeros = np.zeros_like(listed)
    forms = [listed] if listed.shape[1] == 2 else [np.hstack([listed, zeros]), np.hstack([zeros, listed])]
    offsets = min(forms, key=lambda form: float(np.hypot(*(seen - centre - form[number] / pixel))))
    shift = seen - centre - offsets[number] / pixel
    if np.hypot(*shift) > max(_MOST_SHIFT, 0.5 / pixel):
        at, stated = (f"[{x:.2f}, {y:.2f}]" for x, y in (seen, seen - shift))
        hint = f"image {number} is brightest at {at}; centre and {OFFSETS} put its source at {stated}"
        raise InputError(f"{KEY} {SOURCES} XCENTER, YCENTER", tuple(centre), unit="px", allowed="the star", hint=hint)
    return offsets, centre, shift * (float(np.hypot(*shift)) > _LEAST_SHIFT)


def _around(
    image: FloatArray, x: float, y: float, radius: float
) -> tuple[FloatArray, NDArray[np.intp], NDArray[np.intp]] | None:
    """Return the light in an aperture, its rows and columns, in pixels; None where it is not whole on the image."""
    column, row = round(float(x)), round(float(y))
    weights = overlap_weights(radius, float(y) - row, float(x) - column)
    used = [np.asarray(weights.max(axis=axis) > 0) for axis in (1, 0)]
    weights = weights[np.ix_(*used)]
    rows, columns = (at + np.flatnonzero(one) - len(one) // 2 for at, one in zip((row, column), used, strict=True))
    if min(rows[0], columns[0]) < 0 or max(rows[-1], columns[-1]) >= len(image):
        return None
    return weights * image[np.ix_(rows, columns)], rows, columns


def _rings(offsets: FloatArray, light: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return separations, ascending, and the mean light of the sources there; those whose light is nan are left out.

    Where the offsets are those of one quadrant, each stands for its mirror images too; between them light is linear.
    """
    axes = [np.unique(part[part > 0]) for part in np.abs(offsets.T)]
    if min(map(len, axes)) == 0:  # on a line through the star
        at, number = np.unique(np.hypot(*offsets.T).round(9), return_inverse=True)
        mean = np.bincount(number, light) / np.bincount(number)
    else:
        from scipy.interpolate import LinearNDInterpolator

        signs = [(1, 1), (-1, 1), (1, -1), (-1, -1)] if offsets.min() >= 0 else [(1, 1)]
        points, first = np.unique(np.concatenate([offsets * sign for sign in signs]), axis=0, return_index=True)
        between = LinearNDInterpolator(points, np.tile(light, len(signs))[first])
        step = min(float(np.diff([0.0, *axis]).min()) for axis in axes)
        at = step * np.arange(1, math.ceil(float(np.abs(offsets).max()) / step) + 1)
        turns = np.linspace(0.0, 2.0 * math.pi, _TURNS, endpoint=False)
        mean = between(at[:, None] * np.cos(turns), at[:, None] * np.sin(turns)).mean(axis=1)
    kept = np.isfinite(mean)
    return at[kept], mean[kept]


def _ring_means(image: FloatArray, centre: FloatArray, separation: FloatArray, radius: float) -> FloatArray:
    """Return the means over all position angles of the light in apertures at separations, all in pixels.

    A point at r from the star is in the aperture at s for the part ``arccos((r^2 + s^2 - a^2) / 2 r s) / pi`` of the
    angles; a pixel counts in 16 parts.
    """
    part = (np.arange(len(image) * _CUT) + 0.5) / _CUT - 0.5
    distance = np.hypot(part[:, None] - centre[1], part - centre[0])
    each = np.repeat(np.repeat(image, _CUT, axis=0), _CUT, axis=1) / _CUT**2
    light = np.bincount(np.rint(distance / _STEP).astype(np.intp).ravel(), each.ravel())
    r = np.maximum(_STEP * np.arange(len(light)), 1e-9)
    means = np.empty(len(separation))
    for number, s in enumerate(np.maximum(separation, 1e-9)):
        near = slice(max(int((s - radius) / _STEP) - 1, 0), int((s + radius) / _STEP) + 2)
        cosine = (r[near] ** 2 + s**2 - radius**2) / (2.0 * r[near] * s)
        means[number] = (np.arccos(np.clip(cosine, -1.0, 1.0)) / math.pi) @ light[near]
    return means
