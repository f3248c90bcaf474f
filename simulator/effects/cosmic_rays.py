"""Cosmic rays in one exposure: their rate over the solar cycle, and a Poisson number of tracks."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpic_core import FloatArray, InputError, IntArray, NDArray, check_number
from simulator.config import CosmicRayConfig
from simulator.effects.sky import decimal_year
from simulator.effects.tracks import (
    REACH_SIGMA,
    Canvas,
    PaperModel,
    PhysicalModel,
    TemplateModel,
    TrackModel,
    Tracks,
    generated_templates,
    read_templates,
)


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
_MAX_SIDE = 20000
_CHUNK_EVENTS = 50_000
_CHUNK_POINTS = 1_000_000
_CM_PER_UM = 1e-4


@dataclass(frozen=True, eq=False)
class CosmicRays:
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
        For an argument out of range, or more than 1e7 expected events (1e8 with the margin below).

    Notes
    -----
    Middles of tracks are a Poisson process of mean ``rate x area x exposure`` on the array and a margin around it that
    is as wide as the longest track reaches: none that touches the array is missing. Charge beyond 4 sigma of a track
    (6e-5 of it) is moved inside. Random numbers are drawn in chunks, so that memory does not grow with the exposure
    beyond 56 bytes an event and 24 bytes a pixel.
    """
    rows, columns = _checked_shape(shape)
    pixel = _in_range("pixel_um", pixel_um, 1.0, 1000.0, "um")
    exposure = _in_range("exposure_s", exposure_s, 0.0, 1e6, "s")
    rate = _in_range("rate_per_s_cm2", rate_per_s_cm2, 0.0, 1e12, "1/s/cm2")
    if not isinstance(rng, np.random.Generator):
        raise InputError("rng", type(rng).__name__, allowed="a numpy.random.Generator")
    model = track_model(config, pixel)
    margin = model.reach_pixels
    per_pixel = rate * exposure * (pixel * _CM_PER_UM) ** 2
    mean = per_pixel * (rows + 2.0 * margin) * (columns + 2.0 * margin)
    excess = max(per_pixel * rows * columns / MAX_EVENTS, mean / _MAX_THROWN)
    if excess > 1.0:
        events = f"{MAX_EVENTS:g} events, {_MAX_THROWN:g} with its margin"
        allowed = f"at most {rate * exposure / excess:.4g} for this array and model: {events}"
        raise InputError("rate_per_s_cm2 x exposure_s", f"{rate * exposure:.4g}", unit="1/cm2", allowed=allowed)
    return _drawn(model, (rows, columns), int(rng.poisson(mean)), rng)


def _drawn(model: TrackModel, shape: tuple[int, int], n: int, rng: np.random.Generator) -> CosmicRays:
    canvas = Canvas(shape) if n else None
    parts: list[tuple[NDArray[Any], ...]] = []
    for first in range(0, n, _CHUNK_EVENTS):
        for tracks, row, column, azimuth in _placed(model, shape, min(_CHUNK_EVENTS, n - first), rng):
            assert canvas is not None
            charge = model.charges(tracks, rng)
            left = canvas.add(tracks, model.points(tracks, rng), row, column, azimuth, charge)
            kept = left > 0
            found = (row, column, tracks.length_um, tracks.projected_um, np.rad2deg(azimuth), charge, left)
            parts.append(tuple(array[kept] for array in found))
    floats, integers = np.empty(0), np.empty(0, dtype=np.int64)
    columns = zip(*parts, strict=True) if parts else ([floats],) * 5 + ([integers],) * 2
    row, column, length, projected, azimuth_deg, charge, left = (np.concatenate(list(part)) for part in columns)
    pixels = np.flatnonzero(canvas.image) if canvas is not None else integers
    electrons = canvas.image.reshape(-1)[pixels] if canvas is not None else integers
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


def _checked_shape(shape: Any) -> tuple[int, int]:
    try:
        rows, columns = shape
        whole = all(isinstance(side, int | np.integer) and not isinstance(side, bool) for side in (rows, columns))
    except (TypeError, ValueError):
        whole = False
    if not whole or not all(1 <= side <= _MAX_SIDE for side in (rows, columns)):
        raise InputError("shape", shape, allowed=f"rows and columns, 1 to {_MAX_SIDE} each")
    return int(rows), int(columns)


def _in_range(name: str, value: Any, low: float, high: float, unit: str) -> float:
    number = check_number(name, value, unit)
    if not low <= number <= high:
        raise InputError(name, value, unit=unit, allowed=f"{low:g} to {high:g}")
    return number
