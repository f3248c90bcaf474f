"""The dark zone, the mask and the apertures of a band on a star-centred stamp, which need no optics.

The zone in which planets are looked for is squares ``a <= |x|, |y| <= b`` in four quadrants or in two, or a ring.

Whoever asks where a planet may stand asks the zone, and needs not know which it is.
"""

import functools
import math
from dataclasses import fields
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, IntArray, NDArray, Record
from simulator.config import Instrument
from simulator.imaging.sampling import centred_axis, separations

HoleMode = Literal["4q", "2q"]
HoleSide = Literal["right", "left", "top", "bottom"]
HoleStatus = Literal["reached", "not_reached", "none", "table"]


class HoleZone(Record):
    """The zone in which light is to be removed. In both modes it is a product of two sets of intervals.

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

    @property
    def inner_corner_arcsec(self) -> float:
        """Diagonal separation of the inner corner."""
        return self.inner_arcsec * math.sqrt(2.0)

    @property
    def outer_corner_arcsec(self) -> float:
        """Diagonal separation of the outer corner."""
        return self.outer_arcsec * math.sqrt(2.0)

    def azimuth_fraction(self, separation_arcsec: ArrayLike, margin_arcsec: float = 0.0) -> FloatArray:
        """Return the fraction of the circle of that radius that lies inside the zone.

        Parameters
        ----------
        separation_arcsec : array_like
        margin_arcsec : float
            Distance kept from the edges, arcsec.
        """
        r = np.maximum(np.asarray(separation_arcsec, dtype=np.float64), 1e-12)
        low, high = self.inner_arcsec + margin_arcsec, self.outer_arcsec - margin_arcsec
        from_inner = np.arcsin(np.minimum(low / r, 1.0))
        first = np.maximum(from_inner, np.arccos(np.minimum(high / r, 1.0)))
        fraction = 1.0 if self.mode == "4q" else 0.5
        return fraction * np.clip(1.0 - first / (math.pi / 4), 0.0, 1.0)

    def usable_range_arcsec(self, radius_arcsec: float, turn_deg: float = 0.0) -> tuple[float, float]:
        """Return the separations at which an aperture on a diagonal, or degrees beside it, lies whole in the zone.

        Parameters
        ----------
        radius_arcsec : float
            Of the aperture.
        turn_deg : float
            Angle from the diagonal, to either side.
        """
        low, high = self.inner_arcsec + radius_arcsec, self.outer_arcsec - radius_arcsec
        if turn_deg == 0.0:
            return low * math.sqrt(2.0), high * math.sqrt(2.0)
        angle = math.pi / 4 + math.radians(turn_deg)
        near, far = math.cos(angle), math.sin(angle)
        return low / near if near > 0 else math.inf, high / far

    def axes(self, half_axis: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the axes y and x of the zone, given the points of one positive half axis in ascending order."""
        y, x = (
            np.concatenate([half_axis if high > 0 else -half_axis[::-1] for _, high in parts])
            for parts in self.intervals()
        )
        return y, x

    def intervals(self) -> tuple[tuple[tuple[float, float], ...], tuple[tuple[float, float], ...]]:
        """Return the intervals of y and of x whose product the zone is."""
        a, b = self.inner_arcsec, self.outer_arcsec
        left, right = (-b, -a), (a, b)
        if self.mode == "4q":
            return (left, right), (left, right)
        one = (right,) if self.side in ("right", "top") else (left,)
        return ((left, right), one) if self.side in ("right", "left") else (one, (left, right))

    def covers(self, y_arcsec: FloatArray, x_arcsec: FloatArray, widen_arcsec: float = 0.0) -> NDArray[np.bool_]:
        """Return which points of a grid lie in the zone, its intervals widened at both ends (narrowed if negative).

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

    def contains(self, x_arcsec: FloatArray, y_arcsec: FloatArray, margin_arcsec: float) -> BoolArray:
        """Return which points lie in the zone, at least ``margin`` from its edges or a rounding error less.

        Parameters
        ----------
        x_arcsec : ndarray
            Offset from the star on the detector along x, arcsec.
        y_arcsec : ndarray
            Offset from the star on the detector along y, arcsec.
        margin_arcsec : float
            Distance kept from the edges, arcsec.
        """
        inside = np.ones(np.broadcast_shapes(np.shape(x_arcsec), np.shape(y_arcsec)), bool)
        margin = margin_arcsec - _ROUNDING * self.outer_arcsec
        for offset, parts in zip((y_arcsec, x_arcsec), self.intervals(), strict=True):
            within = [(offset >= low + margin) & (offset <= high - margin) for low, high in parts]
            inside &= np.any(within, axis=0)
        return inside

    def reaches(self, x: FloatArray, y: FloatArray, margin_arcsec: float) -> tuple[FloatArray, FloatArray]:
        """Return the least and the largest factor with which offsets are points that `contains` finds in the zone.

        Parameters
        ----------
        x, y : ndarray
            Offsets from the star in any unit; the factors are arcsec of it.
        margin_arcsec : float
            Distance kept from the edges.

        Returns
        -------
        least, largest : ndarray
            The least is above the largest where no factor leads into the zone.
        """
        margin = margin_arcsec - _ROUNDING * self.outer_arcsec
        least, largest = np.zeros(np.shape(x)), np.full(np.shape(x), np.inf)
        with np.errstate(divide="ignore"):
            for offset, parts in zip((y, x), self.intervals(), strict=True):
                sides = [np.sign(low + high) for low, high in parts]
                distance = np.where(np.isin(np.sign(offset), sides), np.abs(offset), 0.0)
                least = np.maximum(least, (self.inner_arcsec + margin) / distance)
                largest = np.minimum(largest, (self.outer_arcsec - margin) / distance)
        return least, largest

    def crosses_inner(self, x_arcsec: float, y_arcsec: float, radius_arcsec: float) -> bool:
        """Return whether an aperture that does not lie in the zone crosses its inner edge.

        Parameters
        ----------
        x_arcsec, y_arcsec : float
            Offsets of its middle from the star on the detector.
        radius_arcsec : float
            Of the aperture.
        """
        near, far = sorted((abs(x_arcsec), abs(y_arcsec)))
        return near - radius_arcsec < self.inner_arcsec and far + radius_arcsec <= self.outer_arcsec

    def cells(
        self, step_arcsec: float, radius_arcsec: float, pixel_arcsec: float
    ) -> tuple[FloatArray, FloatArray, float]:
        """Return x and y of apertures whose pixels lie in the zone, centres of square cells, and the side of a cell.

        Parameters
        ----------
        step_arcsec : float
            Side that a cell should have.
        radius_arcsec : float
            Of the aperture.
        pixel_arcsec : float
            Of the detector.
        """
        # Edges of the pixels whose centres lie in the zone.
        low = (math.ceil(self.inner_arcsec / pixel_arcsec) - 0.5) * pixel_arcsec + radius_arcsec
        high = (math.floor(self.outer_arcsec / pixel_arcsec) + 0.5) * pixel_arcsec - radius_arcsec
        cells = max(1, round((high - low) / step_arcsec))
        step = (high - low) / cells
        rows, columns = self.axes(np.asarray(low + step * (np.arange(cells) + 0.5), np.float64))
        y, x = (part.ravel() for part in np.meshgrid(rows, columns, indexing="ij"))
        return x, y, step

    @property
    def diagonal(self) -> tuple[int, int]:
        """Signs of x and y of one quadrant of the zone."""
        y, x = self.intervals()
        return (1 if x[-1][0] > 0 else -1), (1 if y[-1][0] > 0 else -1)

    @property
    def middle(self) -> tuple[float, float]:
        """Place x and y in the middle of one quadrant of the zone."""
        sign_x, sign_y = self.diagonal
        offset = 0.5 * (self.inner_arcsec + self.outer_arcsec)
        return sign_x * offset, sign_y * offset

    def control_axes(self, step_arcsec: float, margin_arcsec: float) -> tuple[FloatArray, FloatArray]:
        """Return the points at most ``step`` apart that include the edges, widened by ``margin`` on every side.

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
        """Return the centres of cells of exactly ``step``, as many as fit, centred: not the points of control."""
        n = max(1, math.floor((self.outer_arcsec - self.inner_arcsec) / step_arcsec + 1e-9))
        middle = 0.5 * (self.inner_arcsec + self.outer_arcsec)
        points = middle + (np.arange(n) - (n - 1) / 2) * step_arcsec
        return self.axes(np.asarray(points, dtype=np.float64))


class RingZone(Record):
    """A ring around the star: where a coronagraph that is known by tables of separation shows planets.

    It has what `HoleZone` tells whoever looks for planets. Separations of its edges are the same in all directions.

    Attributes
    ----------
    inner_arcsec, outer_arcsec : float
        Radii of its edges, inner < outer; an inner one below 0 lets apertures reach across the star.
    """

    inner_arcsec: float
    outer_arcsec: float
    mode: ClassVar[Literal["ring"]] = "ring"
    side: ClassVar[HoleSide] = "right"
    diagonal: ClassVar[tuple[int, int]] = (1, 1)

    @property
    def inner_corner_arcsec(self) -> float:
        """Separation of the inner edge, above 0."""
        return max(self.inner_arcsec, _NEAREST * self.outer_arcsec)

    @property
    def outer_corner_arcsec(self) -> float:
        """Separation of the outer edge."""
        return self.outer_arcsec

    @property
    def middle(self) -> tuple[float, float]:
        """Place x and y in the middle of the ring, on a diagonal."""
        offset = 0.5 * (self.inner_arcsec + self.outer_arcsec) / math.sqrt(2.0)
        return offset, offset

    def azimuth_fraction(self, separation_arcsec: ArrayLike, margin_arcsec: float = 0.0) -> FloatArray:
        """Return the fraction of the circle of that radius that lies inside the ring; parameters as of `HoleZone`."""
        r = np.asarray(separation_arcsec, dtype=np.float64)
        inside = (r >= self.inner_arcsec + margin_arcsec) & (r <= self.outer_arcsec - margin_arcsec)
        return inside.astype(np.float64)

    def usable_range_arcsec(self, radius_arcsec: float, turn_deg: float = 0.0) -> tuple[float, float]:
        """Return the separations between which an aperture lies in the ring whole; parameters as of `HoleZone`."""
        return self.inner_arcsec + radius_arcsec, self.outer_arcsec - radius_arcsec

    def covers(self, y_arcsec: FloatArray, x_arcsec: FloatArray, widen_arcsec: float = 0.0) -> NDArray[np.bool_]:
        """Return which points of a grid lie in the ring; parameters as of `HoleZone`."""
        return self.contains(x_arcsec[None, :], y_arcsec[:, None], -widen_arcsec)

    def contains(self, x_arcsec: FloatArray, y_arcsec: FloatArray, margin_arcsec: float) -> BoolArray:
        """Return which points lie in the ring, at least ``margin`` from its edges; parameters as of `HoleZone`."""
        separation = np.hypot(x_arcsec, y_arcsec)
        inner = (self.inner_arcsec + margin_arcsec) * (1.0 - _ROUNDING)
        return np.asarray((separation >= inner) & (separation <= (self.outer_arcsec - margin_arcsec) * (1 + _ROUNDING)))

    def reaches(self, x: FloatArray, y: FloatArray, margin_arcsec: float) -> tuple[FloatArray, FloatArray]:
        """Return the least and the largest factor that takes offsets into the ring; parameters as of `HoleZone`."""
        separation = np.hypot(x, y)
        inner = (self.inner_arcsec + margin_arcsec) * (1.0 - _ROUNDING)
        return inner / separation, (self.outer_arcsec - margin_arcsec) * (1.0 + _ROUNDING) / separation

    def crosses_inner(self, x_arcsec: float, y_arcsec: float, radius_arcsec: float) -> bool:
        """Return whether an aperture not in the zone crosses its inner edge; parameters as of `HoleZone`."""
        return math.hypot(x_arcsec, y_arcsec) - radius_arcsec < self.inner_arcsec

    def cells(
        self, step_arcsec: float, radius_arcsec: float, pixel_arcsec: float
    ) -> tuple[FloatArray, FloatArray, float]:
        """Return x and y of apertures that lie in the ring whole, and the side of a cell; as `HoleZone.cells`."""
        low, high = self.usable_range_arcsec(radius_arcsec)
        cells = 2 * max(1, round(high / step_arcsec))
        step = 2.0 * high / cells
        axis = step * (np.arange(cells) + 0.5) - high
        y, x = (part.ravel() for part in np.meshgrid(axis, axis, indexing="ij"))
        separation = np.hypot(x, y)
        # Of a ring that is narrower than a cell, the cells nearest to its middle.
        room = max(0.5 * (high - low), step)
        inside = np.abs(separation - 0.5 * (low + high)) <= room
        return x[inside], y[inside], step


Zone: TypeAlias = HoleZone | RingZone
ZoneMode: TypeAlias = Literal["4q", "2q", "ring"]
_ROUNDING, _NEAREST = 1e-10, 1e-3


@functools.lru_cache(maxsize=256)
def zone_from(inner_arcsec: float, outer_arcsec: float, mode: ZoneMode, side: HoleSide) -> Zone:
    """Return the zone of some edges.

    Parameters
    ----------
    inner_arcsec, outer_arcsec : float
        Of `HoleZone` per axis, of `RingZone` radii.
    mode : {"4q", "2q", "ring"}
    side : {"right", "left", "top", "bottom"}
        Of ``2q``.
    """
    return RingZone(inner_arcsec, outer_arcsec) if mode == "ring" else HoleZone(inner_arcsec, outer_arcsec, mode, side)


def zone_of(instrument: Instrument, band: str) -> Zone:
    """Return the controlled zone of a band.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    hole = instrument.dark_hole
    edges = instrument.hole_inner_arcsec(band), instrument.hole_outer_arcsec(band)
    return zone_from(*edges, "ring" if instrument.coronagraph.is_ring else hole.mode, hole.side)


class BandGeometry(Record):
    """Geometry of one band on a stamp, star at pixel ``stamp_pixels // 2``; the same at all numerical settings.

    Attributes
    ----------
    lambda_d_arcsec : float
        lambda/D at band centre.
    pixel_scale_arcsec, aperture_radius_arcsec, mask_half_width_arcsec : float
        Detector pixel, photometric aperture, half width of the cross.
    zone : HoleZone or RingZone
        Where planets are looked for.
    stamp_pixels : int
        Side of the stamp.
    """

    lambda_d_arcsec: float
    pixel_scale_arcsec: float
    aperture_radius_arcsec: float
    mask_half_width_arcsec: float
    zone: Zone
    stamp_pixels: int

    @classmethod
    def of(
        cls, instrument: Instrument, band: str, stamp_pixels: int, mask_half_width_arcsec: float | None = None
    ) -> "BandGeometry":
        """Return the geometry of a band of an instrument, perhaps with another mask.

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

    @classmethod
    def like(cls, optics: Any, stamp_pixels: int) -> "BandGeometry":
        """Return the geometry of optics, or of their figures, that have its lengths and zone by the same names.

        Parameters
        ----------
        optics : Imager or StampMetrics
        stamp_pixels : int
            Pixels of the stamp a side.
        """
        names = (field.name for field in fields(cls) if field.name != "stamp_pixels")
        return cls(**{name: getattr(optics, name) for name in names}, stamp_pixels=stamp_pixels)

    def figures(self) -> dict[str, Any]:
        """Return the lengths and hole as fields of `simulator.imaging.metrics.StampMetrics`."""
        lengths = {name: value for name, value in vars(self).items() if name.endswith("_arcsec")}
        edges = ("inner_arcsec", "outer_arcsec", "mode", "side")
        return lengths | {f"hole_{name}": getattr(self.zone, name) for name in edges}

    @property
    def hole(self) -> NDArray[np.bool_]:
        """Pixels whose centres lie in the zone; shape (n, n)."""
        offset = centred_axis(self.stamp_pixels, self.pixel_scale_arcsec)
        return self.zone.covers(offset, offset)

    @property
    def aperture_pixels(self) -> float:
        """Area of the photometric aperture in pixels."""
        return float(np.pi) * (self.aperture_radius_arcsec / self.pixel_scale_arcsec) ** 2

    def annulus(self, separation_arcsec: float, half_width_lambda_d: float) -> NDArray[np.bool_]:
        """Return the pixels of the hole whose separation is within ``half_width_lambda_d`` of the given one.

        Parameters
        ----------
        separation_arcsec : float
            Projected separation from the star, arcsec, above 0.
        half_width_lambda_d : float
            Half width of the annulus, in lambda/D of the band.
        """
        distance = np.abs(separations(self.stamp_pixels, self.pixel_scale_arcsec) - separation_arcsec)
        return self.hole & (distance <= half_width_lambda_d * self.lambda_d_arcsec)

    def annulus_pixels(self, separation_arcsec: FloatArray, half_width_lambda_d: float) -> IntArray:
        """Return how many pixels `annulus` has at each of many separations.

        Parameters
        ----------
        separation_arcsec : ndarray
        half_width_lambda_d : float
        """
        width, inside = (
            half_width_lambda_d * self.lambda_d_arcsec,
            np.sort(separations(self.stamp_pixels, self.pixel_scale_arcsec)[self.hole]),
        )
        first = np.searchsorted(inside, separation_arcsec - width, side="left")
        last = np.searchsorted(inside, separation_arcsec + width, side="right")
        return np.asarray(last - first)

    def resolution_elements(self, separation_arcsec: ArrayLike) -> FloatArray:
        """Return the non-overlapping lambda/D-wide apertures on the arcs inside the zone, a real number (>= 0)."""
        r = np.asarray(separation_arcsec, dtype=np.float64)
        return 2.0 * np.pi * r * self.zone.azimuth_fraction(r) / self.lambda_d_arcsec
