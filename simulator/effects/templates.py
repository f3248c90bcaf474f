"""Tracks from templates: small images of events, from a file or generated, turned and placed at random.

A file is a FITS image or npz file, never pickle:

- FITS: a cube ``(n, rows, columns)``, or one image, with the card ``PIXUM``, the size of a sample in um;
- npz: an array ``templates`` of that shape and a number ``pixel_um``.

Values are the share of the charge in every sample, on any scale: finite, not negative, not all 0 in any template.
"""

import functools
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import FloatArray, InputError, IntArray, NDArray, load_kernels, stream
from simulator.config import PaperTracks, PhysicalTracks, TemplateTracks
from simulator.effects.tracks import REACH_SIGMA, PhysicalModel, Points, Tracks, paper_charges, whole_electrons
from simulator.imaging import FileMap, header_number, read_maps


class Canvas:
    """Electrons of an array of pixels, whose centres lie at integers; ``image`` has the shape of the array."""

    def __init__(self, shape: tuple[int, int]) -> None:
        size = shape[0] * shape[1]
        self.image: IntArray = np.zeros(shape, dtype=np.int64)
        self._work = np.zeros(size)
        self._touched = np.empty(size, dtype=np.int64)

    def add(
        self,
        tracks: Tracks,
        points: Points,
        row: FloatArray,
        column: FloatArray,
        azimuth: FloatArray,
        charge_e: IntArray,
    ) -> IntArray:
        """Add placed tracks.

        Parameters
        ----------
        tracks, points
            Shapes, and their points.
        row, column : ndarray
            Places of the middles.
        azimuth : ndarray
            Direction in radians, from columns towards rows.
        charge_e : ndarray of int
            Charge, above 0.

        Returns
        -------
        ndarray of int
            Electrons of each track that fell inside the array; the rest fell outside.
        """
        deposit = load_kernels("simulator.effects.deposit").deposit
        owner = np.repeat(np.arange(row.size), np.diff(points.start))
        sine, cosine = np.sin(azimuth)[owner], np.cos(azimuth)[owner]
        left = np.zeros(row.size, dtype=np.int64)
        if row.size:
            share = np.empty(2 * int(np.ceil(REACH_SIGMA * tracks.sigma_pixels.max())) + 3)
            y = row[owner] + points.along * sine + points.across * cosine
            x = column[owner] + points.along * cosine - points.across * sine
            clouds = (points.start, y, x, points.weight, tracks.sigma_pixels, REACH_SIGMA)
            arrays = (self._work, self.image.reshape(-1), self._touched, share, left)
            deposit(*clouds, charge_e, *self.image.shape, *arrays)
        return left


_KEY = "template_file"
_SIDES = (0.1, 1000.0)  # um
_BLEND = 0.5  # sigma around a sample, in samples: neighbours blend


@dataclass(frozen=True, eq=False)
class TemplateSet:
    """Samples of every template that hold charge, in um from the centre of the charge.

    Attributes
    ----------
    start : ndarray of int, shape (n + 1,)
        Samples ``start[i]`` to ``start[i + 1]`` belong to template i.
    row_um, column_um, weight : ndarray
        Places and shares of the samples.
    radius_um, extent_um : ndarray, shape (n,)
        Farthest sample; and length of the uniform bar with the same largest second moment.
    pixel_um : float
        Size of a sample.
    """

    start: IntArray
    row_um: FloatArray
    column_um: FloatArray
    weight: FloatArray
    radius_um: FloatArray
    extent_um: FloatArray
    pixel_um: float


@dataclass(frozen=True)
class TemplateModel:
    """Tracks from a set of templates; the charge follows the law of the paper's streaks."""

    set: TemplateSet
    charge_law: PaperTracks
    pixel_um: float

    @property
    def reach_pixels(self) -> float:
        """Farthest sample of any template, and its blending."""
        return (float(self.set.radius_um.max()) + REACH_SIGMA * _BLEND * self.set.pixel_um) / self.pixel_um

    def tracks(self, n: int, rng: np.random.Generator) -> Tracks:
        """Choose templates, each as likely as any other; length and projection are both its extent."""
        kind = rng.integers(0, self.set.radius_um.size, size=n)
        extent = self.set.extent_um[kind]
        sigma = np.full(n, _BLEND * self.set.pixel_um / self.pixel_um)
        return Tracks(extent, extent, sigma, self.set.radius_um[kind] / self.pixel_um, kind)

    def charges(self, tracks: Tracks, rng: np.random.Generator) -> IntArray:
        """Return the charge of every track.

        Parameters
        ----------
        tracks : Tracks
        rng : numpy.random.Generator
            Source of random numbers; a seed gives the same draws.
        """
        return whole_electrons(paper_charges(tracks.kind.size, self.charge_law, rng))

    def point_counts(self, tracks: Tracks) -> IntArray:
        """Return the samples of the template."""
        return np.diff(self.set.start)[tracks.kind]

    def points(self, tracks: Tracks, rng: np.random.Generator) -> Points:
        """Return the samples of every template; nothing is random in them.

        Parameters
        ----------
        tracks : Tracks
        rng : numpy.random.Generator
            Source of random numbers; a seed gives the same draws.
        """
        count = self.point_counts(tracks)
        start = np.concatenate([[0], np.cumsum(count)])
        owner = np.repeat(np.arange(count.size), count)
        sample = np.arange(start[-1]) - start[owner] + self.set.start[tracks.kind][owner]
        along, across = self.set.column_um[sample] / self.pixel_um, self.set.row_um[sample] / self.pixel_um
        return Points(start, along, across, self.set.weight[sample])


def read_templates(path: str | Path) -> TemplateSet:
    """Read a set of templates; see the module for what a file holds.

    Raises
    ------
    InputError
        If the file is missing, damaged or of another form, or a template is not finite, negative or empty.
    """
    place = Path(path)
    if not os.path.isfile(place):
        return _read_templates(path, None)
    return _read_templates(path, (place.stat().st_mtime_ns, place.stat().st_size))


@functools.lru_cache(maxsize=8)
def _read_templates(path: str | Path, state: tuple[int, int] | None) -> TemplateSet:
    """Read a file once for each of its states: every frame of a sequence asks for it."""
    found = read_maps(_KEY, path)
    if found.is_fits:
        item = found.maps[0]
        pixel = header_number(_KEY, path, item.header, "PIXUM")
    else:
        named = found.named("templates")
        if named is None:
            raise InputError(_KEY, str(path), allowed="an npz file with an array 'templates'")
        item, pixel = named, _npz_number(path, found.named("pixel_um"))
    if pixel is None or not _SIDES[0] <= pixel <= _SIDES[1]:
        where = "card PIXUM" if found.is_fits else "number pixel_um"
        given, allowed = "missing" if pixel is None else pixel, f"the size of a sample, {_SIDES[0]:g} to {_SIDES[1]:g}"
        raise InputError(f"{_KEY} {where}", given, unit="um", allowed=allowed, hint=str(path))
    return _template_set([_checked(path, i, cube) for i, cube in enumerate(_cube(path, item.data))], pixel)


def _npz_number(path: str | Path, item: FileMap | None) -> float | None:
    if item is None:
        return None
    if item.data.size != 1 or item.data.dtype.kind not in "fiu" or not np.isfinite(item.data).all():
        raise InputError(f"{_KEY} pixel_um", str(item.data), unit="um", allowed="one finite number", hint=str(path))
    return float(item.data.reshape(-1)[0])


def _cube(path: str | Path, data: NDArray[Any]) -> NDArray[Any]:
    if data.dtype.kind not in "fiu":
        raise InputError(_KEY, str(path), allowed="templates of real numbers", hint=f"found {data.dtype.name}")
    cube = data[None] if data.ndim == 2 else data
    if cube.ndim != 3 or 0 in cube.shape:
        raise InputError(_KEY, str(path), allowed="a cube (n, rows, columns) or one image", hint=f"shape {data.shape}")
    return cube


def _checked(path: str | Path, number: int, image: NDArray[Any]) -> FloatArray:
    values = image.astype(np.float64)
    for bad, fault in ((~np.isfinite(values), "is not finite"), (values < 0, "is negative")):
        if bad.any():
            row, column = np.argwhere(bad)[0]
            hint = f"template {number}, row {row}, column {column} {fault}"
            raise InputError(_KEY, str(path), allowed="finite values, not negative", hint=hint)
    largest = float(values.max())
    if largest == 0:
        raise InputError(_KEY, str(path), allowed="charge in every template", hint=f"template {number} has none")
    return values / largest


def _template_set(images: list[FloatArray], pixel_um: float) -> TemplateSet:
    rows, columns, weights, radii, extents = [], [], [], [], []
    for image in images:
        y, x = np.nonzero(image)
        weight = image[y, x] / image.sum()
        row, column = (place - float(weight @ place) for place in (y.astype(np.float64), x.astype(np.float64)))
        moments = np.array([[weight @ (a * b) for a in (row, column)] for b in (row, column)])
        rows.append(row * pixel_um)
        columns.append(column * pixel_um)
        weights.append(weight)
        radii.append(float(np.hypot(row, column).max()) * pixel_um)
        extents.append(math.sqrt(12.0 * max(float(np.linalg.eigvalsh(moments)[-1]), 0.0)) * pixel_um)
    start = np.cumsum([0, *(weight.size for weight in weights)])
    row, column, weight = (np.concatenate(part) for part in (rows, columns, weights))
    return TemplateSet(start, row, column, weight, np.array(radii), np.array(extents), pixel_um)


def _generated(config: TemplateTracks, physical: PhysicalTracks) -> tuple[PhysicalModel, Tracks, np.random.Generator]:
    """Yield the model and shapes of the set, and the random numbers that go on with it."""
    model = PhysicalModel(physical, config.sample_um)
    rng = stream(config.generated_seed, "cosmic-ray templates")
    return model, model.tracks(config.generated_tracks, rng), rng


def generated_projection_um(config: TemplateTracks, physical: PhysicalTracks) -> float:
    """Return the mean length, projected on the detector, of the tracks that `generated_templates` draws."""
    _, tracks, _ = _generated(config, physical)
    return float(tracks.projected_um.mean())


@functools.lru_cache(maxsize=8)
def generated_templates(config: TemplateTracks, physical: PhysicalTracks) -> TemplateSet:
    """Make the set that stands in for a file: tracks of the physical model, sampled finely; always the same."""
    model, tracks, rng = _generated(config, physical)
    charge = model.charges(tracks, rng)
    azimuth = 2.0 * np.pi * rng.random(config.generated_tracks)
    images = []
    for i in range(config.generated_tracks):
        one = tracks[slice(i, i + 1)]
        half = math.ceil(float(one.half_pixels[0]) + REACH_SIGMA * float(one.sigma_pixels[0])) + 1
        canvas = Canvas((2 * half + 1, 2 * half + 1))
        middle = np.array([float(half)])
        canvas.add(one, model.points(one, rng), middle, middle, azimuth[i : i + 1], charge[i : i + 1])
        images.append(canvas.image.astype(np.float64))
    return _template_set(images, config.sample_um)
