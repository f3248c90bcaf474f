"""Tell whether charge that a pixel or the register cannot hold flows into a part of the frame.

A pixel above its full well passes the excess on along its column, the register above its own along the row, to what is
read next. Nothing arrives at a place exactly if every run of pixels that ends there holds less than its wells do: the
light of a run is compared with them, five sigma of noise included, however far away it begins.

Light of sources off the axis where there is no map: wings, the frame around the stamp, and lines across it.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from cpic_core import BoolArray, FloatArray
from simulator.config import Instrument
from simulator.imaging import PsfMetrics, centred_axis
from simulator.signal import wing

if TYPE_CHECKING:
    from simulator.ledger.case import CameraCase


_SIGMA = 5.0


class Spill:
    """Blooming and tails of the register on the stamp of a case."""

    def __init__(self, case: CameraCase) -> None:
        self.case = case
        detector, factor2 = case.detector, case.noise.factor2
        self._pixel = detector.full_well_e if detector.switches.blooming else np.inf
        self._register = detector.register_full_well_e / case.em_gain
        if not detector.switches.register_full_well:
            self._register = np.inf
        self._factor2 = factor2
        self._known: dict[tuple[str, int], tuple[FloatArray, float]] = {}
        # Where even the brightest pixel stays below its limit nothing flows.
        top = float(case.most_e.max()) + case.noise.dark_e + case.noise.clock_e
        if top + _SIGMA * math.sqrt(top) <= self._pixel:
            self._pixel = np.inf
        if top + _SIGMA * math.sqrt(factor2 * top) <= self._register:
            self._register = np.inf

    @functools.cached_property
    def _charge_e(self) -> FloatArray:
        """Electrons of the pixels of the stamp at the register, with the light of other sources at most."""
        case = self.case
        side = len(case.charge_e)
        return case.most_e[: side * side].reshape(side, side) + case.noise.dark_e + case.noise.clock_e

    def blooms_into(self, rows: slice, columns: slice) -> bool:
        """Return whether charge flows along the columns into a part of the stamp, or is too much there.

        Parameters
        ----------
        rows, columns : slice
            The part of the stamp.
        """
        if not np.isfinite(self._pixel):
            return False
        return self._over(rows, columns, self._pixel, 1.0) or bool(self._blooming_columns(rows)[columns].any())

    def trails_into(self, rows: slice, columns: slice) -> bool:
        """Return whether charge of the register flows along the rows into a part of the stamp, or is too much there.

        Parameters
        ----------
        rows, columns : slice
            The part of the stamp.
        """
        if not np.isfinite(self._register):
            return False
        if self._over(rows, columns, self._register, self._factor2):
            return True
        charge = self._charge_e[rows]
        # No pixel hands on more than it holds; what blooms across these rows fills its pixels there.
        most = self.case.detector.full_well_e if self.case.detector.switches.blooming else np.inf
        charge = np.minimum(charge, most)
        if np.isfinite(self._pixel):
            charge = np.where(self._blooming_columns(rows), most, charge)
        before = charge[:, : columns.start][:, ::-1]
        parts = [(before, 1.0)]
        if self.case.full:
            light, pixels = self._lanes("x", -1)
            parts.append((np.minimum(light[rows], most), pixels))
        return bool(_arrives(parts, self._register, self._factor2).any())

    def _over(self, rows: slice, columns: slice, well_e: float, factor2: float) -> bool:
        """Return whether a pixel in there holds too much itself."""
        top = float(self._charge_e[rows, columns].max(initial=0.0))
        return top + _SIGMA * math.sqrt(factor2 * top) > well_e

    def _blooming_columns(self, rows: slice) -> BoolArray:
        """Return the columns of the stamp along which charge arrives at some rows."""
        charge, found = self._charge_e.T, np.zeros(len(self._charge_e), dtype=np.bool_)
        # Half of the excess goes up, first; the other half down, where the first may have taken its room.
        for sign, run, part in ((-1, charge[:, : rows.start][:, ::-1], 0.5), (1, charge[:, rows.stop :], 1.0)):
            parts = [(run, 1.0)]
            if self.case.full:
                parts.append(self._lanes("y", sign))
            found |= _arrives(parts, self._pixel, 1.0, part)
        return found

    def _lanes(self, axis: Literal["x", "y"], sign: int) -> tuple[FloatArray, float]:
        """Return the charge beyond the stamp along all its rows or columns, and the pixels of a box."""
        if (axis, sign) not in self._known:
            case = self.case
            places = centred_axis(len(case.light.star_e_s), case.pixel_arcsec)
            light, pixels = case.light.surroundings.lanes(places, axis, sign)
            self._known[axis, sign] = light * case.exposure_s + case.noise.dark_e + case.noise.clock_e, pixels
        return self._known[axis, sign]


def _arrives(parts: Sequence[tuple[FloatArray, float]], well_e: float, factor2: float, share: float = 1.0) -> BoolArray:
    """Return whether any run of each line, nearest pixel first, holds more than its wells; shape (lines,).

    ``share`` of what is above the well of a pixel goes this way.
    """
    charge = np.concatenate([levels * pixels for levels, pixels in parts], axis=1)
    length = np.concatenate([np.full(levels.shape[1], pixels) for levels, pixels in parts])
    if not charge.shape[1]:
        return np.zeros(len(charge), dtype=np.bool_)
    over = charge - well_e * length
    passed = np.cumsum(np.where(over > 0, share * over, over), axis=1)
    return np.asarray((passed + _SIGMA * share * np.sqrt(factor2 * np.cumsum(charge, axis=1)) > 0).any(axis=1))


MOST, MOST_BEYOND = 5.0, 20.0
"""Light in a pixel or an aperture over that of the wing map, at most, on it and beyond it: 4.6 out to 4 arcsec in the
four visible bands, where one pixel in a hundred has more than 3.8."""
# Light that a core leaves in one row or column, in peak pixels, and how far from its middle.
_CORE_PEAKS, _CORE_REACH_LD = 8.0, 3.0
# Means over the boxes of the wing map, over single rows and columns of them.
_LANE = 2.0
_BRIGHTEST = 12


def frame_reach(instrument: Instrument, band: str, pixel: float) -> tuple[float, float]:
    """Return the half sides of the frame, x and y, in arcsec.

    Parameters
    ----------
    instrument : Instrument
    band : str
    pixel : float
        Scale, arcsec.
    """
    detector = instrument.detector_of(band)
    column, row = detector.star_column, detector.star_row
    return max(column, detector.n_columns - 1 - column) * pixel, max(row, detector.n_rows - 1 - row) * pixel


def beyond(
    metrics: PsfMetrics,
    rate_e_s: float,
    half: float,
    frame: tuple[float, float],
    sky_e_s: float,
    stars: Sequence[tuple[float, float, float]],
) -> tuple[FloatArray, float, tuple[float, float]]:
    """Return levels of pixels beyond the stamp, their largest sum over a column, the brightest in its columns and rows.

    A core holds the light of eight of its peak pixels in one column, the arm of a star beside the column some ten
    pixels of its wing.

    Parameters
    ----------
    metrics : PsfMetrics
    rate_e_s : float
        Of the central star.
    half : float
        Half side of the stamp, arcsec.
    frame : tuple of float
        Half sides of the frame, arcsec.
    sky_e_s : float
        On an open pixel.
    stars : sequence of tuple of float
        Place x and y, arcsec, and rate of the others.
    """
    step, pixel = metrics.wing_map_step_arcsec, metrics.pixel_scale_arcsec
    last = len(metrics.wing_map) // 2
    arm = np.arange(-last, last + 1) * step
    x, y = np.meshgrid(arm, arm)
    cross = np.minimum(np.abs(x), np.abs(y)) >= metrics.mask_half_width_arcsec
    outside = (np.maximum(np.abs(x), np.abs(y)) > half) & (np.abs(x) <= frame[0]) & (np.abs(y) <= frame[1])
    light = np.where(cross & outside, metrics.wing_map, 0.0) * rate_e_s
    column = float(light[:, np.abs(arm) <= half].sum(axis=0).max()) * step / pixel + sky_e_s * 2.0 * frame[1] / pixel
    brightest = rate_e_s * metrics.peak_on_axis_frame
    in_columns, in_rows = rate_e_s * metrics.peak_on_axis_columns, rate_e_s * metrics.register_tail
    for at_x, at_y, rate in stars:
        seen, peak = abs(at_x) <= frame[0] and abs(at_y) <= frame[1], rate * metrics.peak_off_axis
        if seen:
            brightest = max(brightest, peak)
        if seen and abs(at_y) <= half:
            in_rows = max(in_rows, peak)
        if seen and abs(at_x) <= half:
            in_columns, column = max(in_columns, peak), column + 8.0 * peak
        else:
            column += 10.0 * MOST * rate * float(wing(metrics, max(abs(at_x) - half, pixel), 0.0))
    levels = light[outside] * MOST + sky_e_s
    return np.concatenate([levels, [brightest, sky_e_s, 0.0]]), column, (in_columns, in_rows)


@dataclass(frozen=True, eq=False)
class Surroundings:
    """The frame around the stamp, for what runs along its rows and columns.

    Attributes
    ----------
    metrics : PsfMetrics
    star_e_s : float
        Rate of the star behind the mask.
    stars : tuple of (float, float, float)
        Place in arcsec and rate of every other source.
    half_arcsec : float
        Half side of the stamp.
    frame_arcsec : tuple of float
        Half sides of the frame, x and y.
    sky_e_s : float
        On an open pixel.
    """

    metrics: PsfMetrics
    star_e_s: float
    stars: tuple[tuple[float, float, float], ...]
    half_arcsec: float
    frame_arcsec: tuple[float, float]
    sky_e_s: float

    def lanes(self, places_arcsec: FloatArray, axis: Literal["x", "y"], sign: int) -> tuple[FloatArray, float]:
        """Return the light along rows or columns beyond the stamp, electrons per second and pixel.

        Parameters
        ----------
        places_arcsec : ndarray, shape (k,)
            Of the rows (``axis="x"``) or columns (``"y"``), from the star.
        axis : {"x", "y"}
            Along which they run.
        sign : {-1, 1}
            Side of the stamp.

        Returns
        -------
        light : ndarray, shape (k, m)
            At most, in boxes; nearest to the stamp first.
        pixels : float
            Length of a box.
        """
        figures, across = self.metrics, np.asarray(places_arcsec, dtype=np.float64)[:, None]
        step, edge = figures.wing_map_step_arcsec, self.frame_arcsec[axis == "y"]
        n = max(int(np.ceil((edge - self.half_arcsec) / step)), 0)
        along = np.asarray(sign * (self.half_arcsec + step * (np.arange(n) + 0.5)), float)[None, :]
        pixel, open_lane = figures.pixel_scale_arcsec, np.abs(across) > figures.mask_half_width_arcsec
        light = np.full((len(across), n), self.sky_e_s)
        if self.star_e_s > 0:
            light = light + _LANE * self.star_e_s * _pair(figures, along, across, axis) * open_lane
        reach = _CORE_REACH_LD * figures.lambda_d_arcsec
        for rank, (x, y, rate) in enumerate(sorted(self.stars, key=lambda star: -star[2])):
            here, beside = (x, y) if axis == "x" else (y, x)
            if rank < _BRIGHTEST:
                light = light + _LANE * rate * _pair(figures, along - here, across - beside, axis)
            # A row or column through a core holds much of its light; wings of the many faint stars are nothing to it.
            if across.min() - reach <= beside <= across.max() + reach:
                core = (np.abs(across - beside) <= reach) & (np.abs(along - here) <= 0.5 * step + reach)
                light = light + core * (_CORE_PEAKS * rate * figures.peak_off_axis * pixel / step)
        return light, step / pixel


def _pair(metrics: PsfMetrics, along: FloatArray, across: FloatArray, axis: str) -> FloatArray:
    return wing(metrics, along, across) if axis == "x" else wing(metrics, across, along)
