"""Cosmic rays in one exposure: their rate over the solar cycle, and a Poisson number of tracks.

Tracks are straight lines of charge (`PhysicalModel`, `PaperModel`), or small images from a file, turned and placed at
random (`TemplateModel`). Such a file is a FITS image or npz file, never pickle:

- FITS: a cube ``(n, rows, columns)``, or one image, with the card ``PIXUM``, the size of a sample in um;
- npz: an array ``templates`` of that shape and a number ``pixel_um``.

Values are the share of the charge in every sample, on any scale: finite, not negative, not all 0 in any template.
"""

from __future__ import annotations

import functools
import itertools
import math
import os
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from cpic_core import BoolArray, FloatArray, InputError, IntArray, NDArray, Record, load_kernels, stream
from simulator.config import CosmicRayConfig, PaperTracks, PhysicalTracks, TemplateTracks
from simulator.effects.sky import decimal_year
from simulator.imaging import array_number, header_number, read_maps

_BEYOND = 20.0


def cut_landau(n: int, cut: float, rng: np.random.Generator) -> FloatArray:
    """Draw ``n`` values of Landau's lambda, given that it is at most ``cut`` (at least 1)."""
    value = _landau(n, rng)
    (above,) = np.nonzero(value > cut)
    while above.size:
        value[above] = _landau(above.size, rng)
        above = above[value[above] > cut]
    return value


def _landau(n: int, rng: np.random.Generator) -> FloatArray:
    # 1 - [0, 1) leaves out 0, where t cot t is a limit; at t = pi the value is huge and cut off.
    t = np.pi * (1.0 - rng.random(n))
    sine = np.sin(t)
    return np.asarray(-t * np.cos(t) / sine - np.log(rng.standard_exponential(n) * sine / t))


@functools.lru_cache(maxsize=64)
def cut_landau_mean(cut: float) -> float:
    """Return the mean of Landau's lambda, given that it is at most ``cut`` (1 to 600).

    Integrating the sampling form over W leaves smooth functions of t alone:
    ``cut - integral(E1(w)) / integral(exp(-w))`` over 0 to pi, with ``w = exp(-t cot t - cut) t / sin t``.
    """
    from scipy.special import exp1

    # With t = pi s / (1 + s) both integrands fall from one value to 0 within a few units of s around the cut.
    nodes, weights = np.polynomial.legendre.leggauss(16)
    edges = np.linspace(0.0, cut + _BEYOND, math.ceil(cut + _BEYOND) + 1)
    half = 0.5 * np.diff(edges)[:, None]
    s = edges[:-1, None] + half * (1.0 + nodes)
    measure = half * weights / (1.0 + s) ** 2
    t = np.pi * s / (1.0 + s)
    w = np.exp(np.minimum(-t / np.tan(t) - cut + np.log(t / np.sin(t)), math.log(700.0)))
    return float(cut - np.sum(measure * exp1(w)) / np.sum(measure * np.exp(-w)))


REACH_SIGMA = 4.0  # a Gaussian holds all but 6e-5 of its charge within
_STEP_SIGMA, _SHORTEST_STEP = 1.0, 0.2  # points one sigma apart make a line smooth to 3e-9
_MAX_WIDTH_SIGMA = 3.0
_LEAST_WEIGHT = 0.05


class Tracks(Record, eq=False):
    """Shapes of tracks before they are placed; arrays of one length.

    Attributes
    ----------
    length_um, projected_um : ndarray
        Length in the layer and its projection on the detector.
    sigma_pixels : ndarray
        Gaussian sigma of the charge around every point.
    half_pixels : ndarray
        Farthest that a point lies from the middle.
    kind : ndarray of int
        Which template; 0 where there is none.
    """

    length_um: FloatArray
    projected_um: FloatArray
    sigma_pixels: FloatArray
    half_pixels: FloatArray
    kind: IntArray

    def __getitem__(self, chosen: BoolArray | slice) -> Tracks:
        return replace(self, **{item.name: getattr(self, item.name)[chosen] for item in fields(self)})


class Points(Record, eq=False):
    """Points of tracks: ``start[i]`` to ``start[i + 1]`` are those of track i; offsets in pixels from its middle."""

    start: IntArray
    along: FloatArray
    across: FloatArray
    weight: FloatArray


def whole_electrons(charge_e: FloatArray) -> IntArray:
    """Return the nearest whole electrons, at least 1."""
    return np.maximum(np.rint(charge_e), 1.0).astype(np.int64)


def _chords(n: int, depth_um: float, max_length_um: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return the chords of an isotropic flux through a layer, and their projections on it.

    The flux through a plane goes as the cosine mu of the angle of incidence, so mu^2 = (d / L)^2 is uniform; chords
    beyond the longest are left out, which makes it uniform from (d / longest)^2 to 1.
    """
    least = (depth_um / max_length_um) ** 2
    mu2 = least + (1.0 - least) * (1.0 - rng.random(n))
    length = depth_um / np.sqrt(mu2)
    return length, length * np.sqrt(1.0 - mu2)


def _line_counts(tracks: Tracks, pixel_um: float) -> IntArray:
    step = np.maximum(_STEP_SIGMA * tracks.sigma_pixels, _SHORTEST_STEP)
    return np.maximum(np.ceil(tracks.projected_um / pixel_um / step), 1.0).astype(np.int64)


def _line(tracks: Tracks, pixel_um: float) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Return the starts, owners, fractions (-1/2 to 1/2) and offsets of points evenly along every track."""
    count = _line_counts(tracks, pixel_um)
    start = np.concatenate([[0], np.cumsum(count)])
    owner = np.repeat(np.arange(count.size), count)
    fraction = (np.arange(start[-1]) - start[owner] + 0.5) / count[owner] - 0.5
    return start, owner, fraction, fraction * (tracks.projected_um / pixel_um)[owner]


class _Streaks(Record):
    """Straight tracks along the chords of a layer: a line of points, one a sigma, each with a Gaussian around it."""

    config: Any
    pixel_um: float

    @property
    def reach_pixels(self) -> float:
        """Farthest from its middle that any track leaves charge: half the longest projection, and the widest track."""
        longest = math.sqrt(self.config.max_length_um**2 - self.config.depth_um**2)
        return (0.5 * longest + REACH_SIGMA * self._widest_um) / self.pixel_um

    @property
    def _widest_um(self) -> float:
        raise NotImplementedError

    def tracks(self, n: int, rng: np.random.Generator) -> Tracks:
        """Draw the shapes of ``n`` tracks."""
        length, projected = _chords(n, self.config.depth_um, self.config.max_length_um, rng)
        sigma = self._sigma_pixels(n, rng)
        return Tracks(length, projected, sigma, 0.5 * projected / self.pixel_um, np.zeros(n, dtype=np.int64))

    def _sigma_pixels(self, n: int, rng: np.random.Generator) -> FloatArray:
        raise NotImplementedError

    def point_counts(self, tracks: Tracks) -> IntArray:
        """Return the points that every track needs: one a sigma."""
        return _line_counts(tracks, self.pixel_um)

    def points(self, tracks: Tracks, rng: np.random.Generator) -> Points:
        """Draw the points of every track, whose weights vary along it and are never negative.

        Parameters
        ----------
        tracks : Tracks
        rng : numpy.random.Generator
            Source of random numbers; a seed gives the same draws.
        """
        start, owner, fraction, along = _line(tracks, self.pixel_um)
        weight = self._weights(owner, fraction, start.size - 1, rng)
        return Points(start, along, np.zeros(along.size), np.maximum(weight, _LEAST_WEIGHT))

    def _weights(self, owner: IntArray, fraction: FloatArray, n_tracks: int, rng: np.random.Generator) -> FloatArray:
        """Return the weight of every point, by its track and its place along it (-1/2 to 1/2)."""
        raise NotImplementedError


class PhysicalModel(_Streaks):
    """Fast particles through a silicon layer, with its diffusion; see `PhysicalTracks`.

    The charge of a chord L is ``L [m + w (lambda - <lambda>)]`` with lambda of Landau's law up to the cut: its mean is
    ``m L`` whatever the cut. The charge of the points along a track fluctuates by the same law.
    """

    config: PhysicalTracks

    @property
    def _widest_um(self) -> float:
        return self.config.diffusion_um

    def _sigma_pixels(self, n: int, rng: np.random.Generator) -> FloatArray:
        return np.full(n, self.config.diffusion_um / self.pixel_um)

    def charges(self, tracks: Tracks, rng: np.random.Generator) -> IntArray:
        """Return the charge of every chord, whole electrons above 0.

        Parameters
        ----------
        tracks : Tracks
        rng : numpy.random.Generator
            Source of random numbers; a seed gives the same draws.
        """
        return whole_electrons(tracks.length_um * self._loss_e_um(tracks.length_um.size, rng))

    def _loss_e_um(self, n: int, rng: np.random.Generator) -> FloatArray:
        config = self.config
        excess = cut_landau(n, config.loss_cut, rng) - cut_landau_mean(config.loss_cut)
        return config.mean_loss_e_um + config.loss_width_e_um * excess

    def _weights(self, owner: IntArray, fraction: FloatArray, n_tracks: int, rng: np.random.Generator) -> FloatArray:
        return self._loss_e_um(fraction.size, rng) / self.config.mean_loss_e_um


class PaperModel(_Streaks):
    """Streaks of Zhu et al. 2025, each with its own width (log-normal, cut off at three sigma); see `PaperTracks`."""

    config: PaperTracks

    @property
    def _widest_um(self) -> float:
        return self.config.width_um * math.exp(_MAX_WIDTH_SIGMA * self.config.width_rms)

    def _sigma_pixels(self, n: int, rng: np.random.Generator) -> FloatArray:
        scatter = np.clip(rng.standard_normal(n), -_MAX_WIDTH_SIGMA, _MAX_WIDTH_SIGMA)
        return np.asarray(self.config.width_um / self.pixel_um * np.exp(self.config.width_rms * scatter))

    def charges(self, tracks: Tracks, rng: np.random.Generator) -> IntArray:
        """Return the charge of every streak, whatever its length.

        Parameters
        ----------
        tracks : Tracks
        rng : numpy.random.Generator
            Source of random numbers; a seed gives the same draws.
        """
        return whole_electrons(paper_charges(tracks.length_um.size, self.config, rng))

    def _weights(self, owner: IntArray, fraction: FloatArray, n_tracks: int, rng: np.random.Generator) -> FloatArray:
        config, weight = self.config, np.ones(fraction.size)
        # Waves of random phase. Amplitudes fall as 1 / wave number; their squares add up to the variance asked for.
        number = np.arange(1, config.texture_waves + 1)
        amplitude = config.texture_rms * np.sqrt(2.0 / np.sum(1.0 / number**2)) / number
        for wave, size in zip(number, amplitude, strict=True):
            phase = rng.random(n_tracks)
            weight += size * np.cos(2.0 * np.pi * (wave * fraction + phase[owner]))
        return weight


def paper_charges(n: int, config: PaperTracks, rng: np.random.Generator) -> FloatArray:
    """Return charges (e-) from an exponential that becomes a power law, continuously, at ``tail_start`` e-foldings.

    The scale of the exponential follows from the mean in closed form.
    """
    knee, index = config.tail_start, config.tail_index
    at_knee = math.exp(-knee)
    body, tail = 1.0 - at_knee, at_knee * knee / (index - 1.0)
    mean = (1.0 - at_knee * (1.0 + knee) + at_knee * knee**2 / (index - 2.0)) / (body + tail)
    u = 1.0 - rng.random(n)  # the fraction of events above
    beyond = u * (body + tail) < tail
    exponential = -np.log(np.where(beyond, 1.0, u * (body + tail) - tail + at_knee))
    power = knee * np.power(np.where(beyond, u * (body + tail) / tail, 1.0), -1.0 / (index - 1.0))
    return np.asarray(config.mean_charge_e / mean * np.where(beyond, power, exponential))


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


class TemplateSet(Record, eq=False):
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


class TemplateModel(Record):
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


TrackModel: TypeAlias = PhysicalModel | PaperModel | TemplateModel


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
        item, pixel = named, array_number(f"{_KEY} pixel_um", path, found.named("pixel_um"))
    if pixel is None or not _SIDES[0] <= pixel <= _SIDES[1]:
        where = "card PIXUM" if found.is_fits else "number pixel_um"
        given, allowed = "missing" if pixel is None else pixel, f"the size of a sample, {_SIDES[0]:g} to {_SIDES[1]:g}"
        raise InputError(f"{_KEY} {where}", given, unit="um", allowed=allowed, hint=str(path))
    return _template_set([_checked(path, i, cube) for i, cube in enumerate(_cube(path, item.data))], pixel)


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


def cosmic_ray_rate(config: CosmicRayConfig, when: str | float) -> float:
    """Return the rate of cosmic rays through the detector outside the South Atlantic Anomaly (no observations there).

    Parameters
    ----------
    config : CosmicRayConfig
        Rate at solar minimum, depth and time of the cycle, factor of the orbit.
    when : str or float
        ISO date or decimal year, 1972 to 2100.

    Returns
    -------
    float
        Particles per second and cm2: ``peak x orbit x [1 - m (1 - cos(2 pi (t - t_min) / T)) / 2]``, highest at solar
        minimum, when the Sun's field keeps fewest out.

    Raises
    ------
    InputError
        If the date cannot be read or is out of range.

    Examples
    --------
    >>> from simulator import load_instrument
    >>> from simulator.effects import cosmic_ray_rate
    >>> round(cosmic_ray_rate(load_instrument().cosmic_rays, "2028-01-01"), 3)
    0.832
    """
    phase = 2.0 * math.pi * (decimal_year("when", when) - config.cycle_minimum_year) / config.cycle_years
    return config.peak_rate_per_s_cm2 * config.orbit_factor * (1.0 - 0.5 * config.cycle_depth * (1.0 - math.cos(phase)))


MAX_EVENTS = 1e7
_MAX_THROWN = 1e8
_CHUNK_EVENTS = 50_000
_CHUNK_POINTS = 1_000_000
_CM_PER_UM = 1e-4


class CosmicRays(Record, eq=False):
    """The charge that cosmic rays leave in one exposure.

    Events are those that left charge in the array, in the order in which they were drawn. Their middles may lie
    outside it. Pixel centres lie at integers.

    Attributes
    ----------
    shape : tuple of int
        Rows and columns of the array.
    pixels, electrons : ndarray of int64
        Flat indices of the pixels hit, increasing, each once; and the electrons in each, above 0.
    lost_e : int
        Electrons of the events that fell outside the array: ``charge_e.sum() == electrons.sum() + lost_e``.
    row, column : ndarray, shape (n_events,)
        Middle of every track.
    length_um, projected_um : ndarray
        Length in the sensitive layer and its projection on the detector.
    azimuth_deg : ndarray
        Direction on the detector, 0 to 360, from columns towards rows.
    charge_e, left_e : ndarray of int64
        Electrons of every event, and those of them inside the array.
    """

    shape: tuple[int, int]
    pixels: IntArray
    electrons: IntArray
    lost_e: int
    row: FloatArray
    column: FloatArray
    length_um: FloatArray
    projected_um: FloatArray
    azimuth_deg: FloatArray
    charge_e: IntArray
    left_e: IntArray

    @property
    def n_events(self) -> int:
        """Events that left charge in the array."""
        return self.charge_e.size

    def image(self) -> IntArray:
        """Return electrons per pixel, shape (rows, columns)."""
        dense = np.zeros(self.shape[0] * self.shape[1], dtype=np.int64)
        dense[self.pixels] = self.electrons
        return dense.reshape(self.shape)


def track_model(config: CosmicRayConfig, pixel_um: float) -> TrackModel:
    """Return the model of tracks that a configuration names, on pixels of a given size.

    Parameters
    ----------
    config : CosmicRayConfig
    pixel_um : float
        Pitch of the pixels, um.

    Raises
    ------
    InputError
        If its template file cannot be used.
    """
    if config.model == "physical":
        return PhysicalModel(config.physical, pixel_um)
    if config.model == "paper":
        return PaperModel(config.paper, pixel_um)
    path = config.template.template_file
    found = generated_templates(config.template, config.physical) if path is None else read_templates(path)
    return TemplateModel(found, config.paper, pixel_um)


def draw_cosmic_rays(
    config: CosmicRayConfig,
    shape: tuple[int, int],
    pixel_um: float,
    exposure_s: float,
    rate_per_s_cm2: float,
    rng: np.random.Generator,
) -> CosmicRays:
    """Draw the cosmic rays of one exposure.

    Parameters
    ----------
    config : CosmicRayConfig
        Model of the tracks.
    shape : tuple of int
        Rows and columns of the array, 1 to 20000 each.
    pixel_um : float
        Pixel, 1 to 1000 um.
    exposure_s : float
        Exposure, 0 to 1e6 s.
    rate_per_s_cm2 : float
        Particles through the detector, at least 0; see `cosmic_ray_rate`.
    rng : numpy.random.Generator
        Source of every random number; equal states give equal cosmic rays.

    Returns
    -------
    CosmicRays

    Raises
    ------
    InputError
        For more than 1e7 expected events (1e8 with the margin below).

    Notes
    -----
    Middles of tracks are a Poisson process of mean ``rate x area x exposure`` on the array and a margin around it that
    is as wide as the longest track reaches: none that touches the array is missing. Charge beyond 4 sigma of a track
    (6e-5 of it) is moved inside. Random numbers are drawn in chunks, so that memory does not grow with the exposure
    beyond 56 bytes an event and 24 bytes a pixel.
    """
    rows, columns = shape
    model = track_model(config, pixel_um)
    margin = model.reach_pixels
    fluence = rate_per_s_cm2 * exposure_s
    per_pixel = fluence * (pixel_um * _CM_PER_UM) ** 2
    mean = per_pixel * (rows + 2.0 * margin) * (columns + 2.0 * margin)
    excess = max(per_pixel * rows * columns / MAX_EVENTS, mean / _MAX_THROWN)
    if excess > 1.0:
        events = f"{MAX_EVENTS:g} events, {_MAX_THROWN:g} with its margin"
        allowed = f"at most {fluence / excess:.4g} for this array and model: {events}"
        raise InputError("rate_per_s_cm2 x exposure_s", f"{fluence:.4g}", unit="1/cm2", allowed=allowed)
    return _drawn(model, (rows, columns), int(rng.poisson(mean)), rng)


def _drawn(model: TrackModel, shape: tuple[int, int], n: int, rng: np.random.Generator) -> CosmicRays:
    canvas = Canvas(shape)
    parts: list[tuple[NDArray[Any], ...]] = []
    for first in range(0, n, _CHUNK_EVENTS):
        for tracks, row, column, azimuth in _placed(model, shape, min(_CHUNK_EVENTS, n - first), rng):
            charge = model.charges(tracks, rng)
            left = canvas.add(tracks, model.points(tracks, rng), row, column, azimuth, charge)
            kept = left > 0
            found = (row, column, tracks.length_um, tracks.projected_um, np.rad2deg(azimuth), charge, left)
            parts.append(tuple(array[kept] for array in found))
    floats, integers = np.empty(0), np.empty(0, dtype=np.int64)
    columns = zip(*parts, strict=True) if parts else ([floats],) * 5 + ([integers],) * 2
    row, column, length, projected, azimuth_deg, charge, left = (np.concatenate(list(part)) for part in columns)
    pixels = np.flatnonzero(canvas.image)
    electrons = canvas.image.reshape(-1)[pixels]
    lost = int(charge.sum() - left.sum())
    return CosmicRays(shape, pixels, electrons, lost, row, column, length, projected, azimuth_deg, charge, left)


def _placed(
    model: TrackModel, shape: tuple[int, int], n: int, rng: np.random.Generator
) -> Iterator[tuple[Tracks, FloatArray, FloatArray, FloatArray]]:
    """Throw ``n`` tracks on array and margin; yield those that may touch the array, in portions of bounded size."""
    margin = model.reach_pixels
    row, column = ((side + 2.0 * margin) * rng.random(n) - margin - 0.5 for side in shape)
    azimuth = 2.0 * np.pi * rng.random(n)
    tracks = model.tracks(n, rng)
    reach = tracks.half_pixels + REACH_SIGMA * tracks.sigma_pixels + 1.0
    near = (np.abs(row - 0.5 * (shape[0] - 1)) < 0.5 * shape[0] + reach) & (
        np.abs(column - 0.5 * (shape[1] - 1)) < 0.5 * shape[1] + reach
    )
    tracks, row, column, azimuth = tracks[near], row[near], column[near], azimuth[near]
    portion = np.cumsum(model.point_counts(tracks)) // _CHUNK_POINTS
    edges = [0, *(np.flatnonzero(np.diff(portion)) + 1).tolist(), row.size]
    for low, high in itertools.pairwise(edges):
        part = slice(low, high)
        yield tracks[part], row[part], column[part], azimuth[part]
