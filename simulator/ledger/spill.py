"""Whether charge that a pixel or the register cannot hold flows into a part of the frame.

A pixel above its full well passes the excess on along its column, the register above its own along the row, to what is
read next. Nothing arrives at a place exactly if every run of pixels that ends there holds less than its wells do: the
light of a run is compared with them, five sigma of noise included, however far away it begins.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from simulator.imaging.imager import centred_axis

if TYPE_CHECKING:
    from simulator.ledger.case import CameraCase

FloatArray = NDArray[np.float64]
_SIGMA = 5.0


class Spill:
    """Blooming and tails of the register on the stamp of a case.

    Parameters
    ----------
    case : CameraCase
    """

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
        """Whether a pixel in there holds too much itself."""
        top = float(self._charge_e[rows, columns].max(initial=0.0))
        return top + _SIGMA * math.sqrt(factor2 * top) > well_e

    def _blooming_columns(self, rows: slice) -> NDArray[np.bool_]:
        """Columns of the stamp along which charge arrives at some rows."""
        charge, found = self._charge_e.T, np.zeros(len(self._charge_e), dtype=np.bool_)
        # Half of the excess goes up, first; the other half down, where the first may have taken its room.
        for sign, run, part in ((-1, charge[:, : rows.start][:, ::-1], 0.5), (1, charge[:, rows.stop :], 1.0)):
            parts = [(run, 1.0)]
            if self.case.full:
                parts.append(self._lanes("y", sign))
            found |= _arrives(parts, self._pixel, 1.0, part)
        return found

    def _lanes(self, axis: Literal["x", "y"], sign: int) -> tuple[FloatArray, float]:
        """Charge beyond the stamp along all its rows or columns, and the pixels of a box."""
        if (axis, sign) not in self._known:
            case = self.case
            places = centred_axis(len(case.sketch.star_e_s), case.pixel_arcsec)
            light, pixels = case.sketch.surroundings.lanes(places, axis, sign)
            self._known[axis, sign] = light * case.exposure_s + case.noise.dark_e + case.noise.clock_e, pixels
        return self._known[axis, sign]


def _arrives(
    parts: Sequence[tuple[FloatArray, float]], well_e: float, factor2: float, share: float = 1.0
) -> NDArray[np.bool_]:
    """Whether any run of each line, nearest pixel first, holds more than its wells; shape (lines,).

    ``share`` of what is above the well of a pixel goes this way.
    """
    charge = np.concatenate([levels * pixels for levels, pixels in parts], axis=1)
    length = np.concatenate([np.full(levels.shape[1], pixels) for levels, pixels in parts])
    if not charge.shape[1]:
        return np.zeros(len(charge), dtype=np.bool_)
    over = charge - well_e * length
    passed = np.cumsum(np.where(over > 0, share * over, over), axis=1)
    return np.asarray((passed + _SIGMA * share * np.sqrt(factor2 * np.cumsum(charge, axis=1)) > 0).any(axis=1))
