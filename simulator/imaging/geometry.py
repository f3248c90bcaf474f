"""Where the dark hole, the mask and the apertures of a band lie on a star-centred stamp: known without any optics.

The dark zone on the detector: squares ``a <= |x|, |y| <= b``, in four quadrants or in the two on one side.
"""

import math
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, IntArray, NDArray, check_word
from simulator.config import Instrument
from simulator.imaging.sampling import centred_offsets


def zone_of(instrument: Instrument, band: str) -> "HoleZone":
    """The controlled zone of a band.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    hole = instrument.dark_hole
    return HoleZone(instrument.hole_inner_arcsec(band), instrument.hole_outer_arcsec(band), hole.mode, hole.side)


@dataclass(frozen=True)
class BandGeometry:
    """Geometry of one band on a stamp, star at pixel ``stamp_pixels // 2``; the same at all numerical settings.

    Attributes
    ----------
    lambda_d_arcsec : float
        lambda/D at band centre.
    pixel_scale_arcsec, aperture_radius_arcsec, mask_half_width_arcsec : float
        Detector pixel, photometric aperture, half width of the cross.
    zone : HoleZone
        The dark quadrants.
    stamp_pixels : int
        Side of the stamp.
    """

    lambda_d_arcsec: float
    pixel_scale_arcsec: float
    aperture_radius_arcsec: float
    mask_half_width_arcsec: float
    zone: "HoleZone"
    stamp_pixels: int

    @classmethod
    def of(
        cls, instrument: Instrument, band: str, stamp_pixels: int, mask_half_width_arcsec: float | None = None
    ) -> "BandGeometry":
        """Geometry of a band of an instrument, perhaps with another mask.

        Parameters
        ----------
        instrument : Instrument
        band : str
            Name of a band of the instrument, such as ``F520``.
        stamp_pixels : int
            Pixels of the stamp a side.
        mask_half_width_arcsec : float, optional
            Half width of the mask's arms, arcsec; that of the instrument by default.

        Raises
        ------
        InputError
            If the instrument has no such band.
        """
        own = instrument.mask_half_width_arcsec(band)
        return cls(
            lambda_d_arcsec=instrument.lambda_d_arcsec(band),
            pixel_scale_arcsec=instrument.pixel_scale_arcsec(band),
            aperture_radius_arcsec=instrument.aperture_radius_arcsec(band),
            mask_half_width_arcsec=own if mask_half_width_arcsec is None else mask_half_width_arcsec,
            zone=zone_of(instrument, band),
            stamp_pixels=stamp_pixels,
        )

    def figures(self) -> dict[str, Any]:
        """Lengths and hole as fields of `simulator.imaging.metrics.StampMetrics`."""
        lengths = {name: value for name, value in vars(self).items() if name.endswith("_arcsec")}
        return lengths | {f"hole_{name}": value for name, value in vars(self.zone).items()}

    @property
    def hole(self) -> NDArray[np.bool_]:
        """Pixels whose centres lie in the dark quadrants, ``a <= |x|, |y| <= b``; shape (n, n)."""
        offset = centred_offsets(self.stamp_pixels) * self.pixel_scale_arcsec
        return self.zone.covers(offset, offset)

    @property
    def aperture_pixels(self) -> float:
        """Area of the photometric aperture in pixels."""
        return float(np.pi) * (self.aperture_radius_arcsec / self.pixel_scale_arcsec) ** 2

    def annulus(self, separation_arcsec: float, half_width_lambda_d: float) -> NDArray[np.bool_]:
        """Pixels of the hole whose separation is within ``half_width_lambda_d`` of the given one.

        Parameters
        ----------
        separation_arcsec : float
            Projected separation from the star, arcsec, above 0.
        half_width_lambda_d : float
            Half width of the annulus, in lambda/D of the band.
        """
        distance = np.abs(self._separations() - separation_arcsec)
        return self.hole & (distance <= half_width_lambda_d * self.lambda_d_arcsec)

    def annulus_pixels(self, separation_arcsec: FloatArray, half_width_lambda_d: float) -> IntArray:
        """Return how many pixels `annulus` has at each of many separations.

        Parameters
        ----------
        separation_arcsec : ndarray
        half_width_lambda_d : float
        """
        width, inside = half_width_lambda_d * self.lambda_d_arcsec, np.sort(self._separations()[self.hole])
        first = np.searchsorted(inside, separation_arcsec - width, side="left")
        last = np.searchsorted(inside, separation_arcsec + width, side="right")
        return np.asarray(last - first)

    def _separations(self) -> FloatArray:
        """Distance of every pixel from the star, arcsec."""
        offset = centred_offsets(self.stamp_pixels) * self.pixel_scale_arcsec
        return np.hypot(offset[:, None], offset)

    def resolution_elements(self, separation_arcsec: ArrayLike) -> FloatArray:
        """Non-overlapping lambda/D-wide apertures on the arcs inside the quadrants, a real number (>= 0)."""
        r = np.asarray(separation_arcsec, dtype=np.float64)
        return 2.0 * np.pi * r * self.zone.azimuth_fraction(r) / self.lambda_d_arcsec


HoleMode = Literal["4q", "2q"]
HoleSide = Literal["right", "left", "top", "bottom"]
HoleStatus = Literal["reached", "not_reached", "none"]


@dataclass(frozen=True)
class HoleZone:
    """Where light is to be removed. In both modes the zone is a product of two sets of intervals.

    Attributes
    ----------
    inner_arcsec, outer_arcsec : float
        Edges a and b of the squares, per axis, 0 < a < b.
    mode : {"4q", "2q"}
        All four quadrants, or the two on ``side``.
    side : {"right", "left", "top", "bottom"}
        Side of the star on the detector that ``2q`` darkens: right is +x (growing column), top is +y. With the default
        parity right is west at roll 0: position angles 225 and 315 deg.
    """

    inner_arcsec: float
    outer_arcsec: float
    mode: HoleMode = "4q"
    side: HoleSide = "right"

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not (math.isfinite(self.outer_arcsec) and 0 < self.inner_arcsec < self.outer_arcsec):
            allowed = "0 < inner < outer"
            raise InputError("hole edges", (self.inner_arcsec, self.outer_arcsec), unit="arcsec", allowed=allowed)
        for name, value, known in (("mode", self.mode, HoleMode), ("side", self.side, HoleSide)):
            check_word(name, value, get_args(known))

    @property
    def inner_corner_arcsec(self) -> float:
        """Diagonal separation of the inner corner."""
        return self.inner_arcsec * math.sqrt(2.0)

    @property
    def outer_corner_arcsec(self) -> float:
        """Diagonal separation of the outer corner."""
        return self.outer_arcsec * math.sqrt(2.0)

    def azimuth_fraction(self, separation_arcsec: ArrayLike) -> FloatArray:
        """Fraction of the circle of that radius that lies inside the zone."""
        r = np.maximum(np.asarray(separation_arcsec, dtype=np.float64), 1e-12)
        from_inner = np.arcsin(np.minimum(self.inner_arcsec / r, 1.0))
        first = np.maximum(from_inner, np.arccos(np.minimum(self.outer_arcsec / r, 1.0)))
        fraction = 1.0 if self.mode == "4q" else 0.5
        return fraction * np.clip(1.0 - first / (math.pi / 4), 0.0, 1.0)

    def axes(self, half_axis: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Axes y and x of the zone, given the points of one positive half axis in ascending order."""
        both = np.concatenate([-half_axis[::-1], half_axis])
        if self.mode == "4q":
            return both, both
        one = half_axis if self.side in ("right", "top") else -half_axis[::-1]
        return (both, one) if self.side in ("right", "left") else (one, both)

    def intervals(self) -> tuple[tuple[tuple[float, float], ...], tuple[tuple[float, float], ...]]:
        """Intervals of y and of x whose product the zone is."""
        a, b = self.inner_arcsec, self.outer_arcsec
        left, right = (-b, -a), (a, b)
        if self.mode == "4q":
            return (left, right), (left, right)
        one = (right,) if self.side in ("right", "top") else (left,)
        return ((left, right), one) if self.side in ("right", "left") else (one, (left, right))

    def covers(self, y_arcsec: FloatArray, x_arcsec: FloatArray, widen_arcsec: float = 0.0) -> NDArray[np.bool_]:
        """Which points of a grid lie in the zone, its intervals widened at both ends (narrowed if negative).

        Parameters
        ----------
        y_arcsec : ndarray
            Offset from the star on the detector along y, arcsec.
        x_arcsec : ndarray
            Offset from the star on the detector along x, arcsec.
        widen_arcsec : float, optional
            Widening at both ends, arcsec; negative to narrow.
        """
        rows, columns = (
            np.any([(axis >= low - widen_arcsec) & (axis <= high + widen_arcsec) for low, high in parts], axis=0)
            for axis, parts in zip((y_arcsec, x_arcsec), self.intervals(), strict=True)
        )
        return np.outer(rows, columns)

    @property
    def diagonal(self) -> tuple[int, int]:
        """Signs of x and y of one quadrant of the zone."""
        y, x = self.intervals()
        return (1 if x[-1][0] > 0 else -1), (1 if y[-1][0] > 0 else -1)

    def control_axes(self, step_arcsec: float, margin_arcsec: float) -> tuple[FloatArray, FloatArray]:
        """Points at most ``step`` apart that include the edges, widened by ``margin`` on every side.

        Parameters
        ----------
        step_arcsec : float
            Largest distance between neighbouring points, arcsec.
        margin_arcsec : float
            Distance kept from the edges, arcsec.
        """
        low, high = max(self.inner_arcsec - margin_arcsec, 0.0), self.outer_arcsec + margin_arcsec
        points = np.linspace(low, high, math.ceil((high - low) / step_arcsec) + 1)
        return self.axes(np.asarray(points, dtype=np.float64))

    def score_axes(self, step_arcsec: float) -> tuple[FloatArray, FloatArray]:
        """Centres of cells of exactly ``step``, as many as fit, centred in the zone: not the points of control."""
        n = max(1, math.floor((self.outer_arcsec - self.inner_arcsec) / step_arcsec + 1e-9))
        middle = 0.5 * (self.inner_arcsec + self.outer_arcsec)
        points = middle + (np.arange(n) - (n - 1) / 2) * step_arcsec
        return self.axes(np.asarray(points, dtype=np.float64))
