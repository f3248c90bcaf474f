"""The three images of one band of one confirmed target, as they are stored and drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.errors import InputError
from simulator.imaging.hole_zone import HoleMode, HoleSide, HoleZone
from simulator.target.positions import sky_to_detector

__all__ = ["Panels", "compass"]

FloatArray = NDArray[np.float64]
_IMAGES = ("science", "reference", "residual")
_STORED_DTYPE = np.float32


def compass(parity: int, roll_deg: float = 0.0) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the unit vectors (x, y) on the detector that point to north and to east.

    Parameters
    ----------
    parity : {-1, +1}
        Detector parity; -1 puts east at -x.
    roll_deg : float
        Rotation of the sky on the detector.
    """
    x, y = sky_to_detector([1.0, 1.0], [0.0, 90.0], roll_deg=roll_deg, parity=parity)
    return (float(x[0]), float(y[0])), (float(x[1]), float(y[1]))


@dataclass(frozen=True)
class Panels:
    """Images of one band: summed science stack, summed reference stack, residual after subtraction.

    Attributes
    ----------
    band : str
        Band name.
    science, reference, residual : ndarray
        Equal shapes (y, x), electrons of the summed stack; NaN where there is no value.
    pixel_scale_arcsec : float
        Size of a pixel.
    planet_x_arcsec, planet_y_arcsec : float
        Offset of the planet from the star on the detector.
    aperture_radius_arcsec : float
        Photometric aperture.
    hole_inner_arcsec, hole_outer_arcsec : float
        Each quadrant's zone is ``inner <= |x|, |y| <= outer`` (not diagonal separations).
    mask_half_width_arcsec : float
        Half width of the arms of the cross mask.
    hole_mode, hole_side : str
        All four quadrants, or the two on a side of the star.
    parity : int
        Detector parity, -1 or +1.
    roll_deg : float
        Rotation of the sky on the detector.
    star_column, star_row : float
        Pixel of the star; the middle of the array when not given.
    """

    band: str
    science: FloatArray
    reference: FloatArray
    residual: FloatArray
    pixel_scale_arcsec: float
    planet_x_arcsec: float
    planet_y_arcsec: float
    aperture_radius_arcsec: float
    hole_inner_arcsec: float
    hole_outer_arcsec: float
    mask_half_width_arcsec: float
    hole_mode: HoleMode = "4q"
    hole_side: HoleSide = "right"
    parity: int = -1
    roll_deg: float = 0.0
    star_column: float | None = None
    star_row: float | None = None

    def __post_init__(self) -> None:
        for name in _IMAGES:
            image = np.asarray(getattr(self, name), dtype=np.float64)
            if image.ndim != 2 or image.shape != np.shape(self.science) or image.size == 0:
                raise InputError(f"panels.{name}", str(image.shape), allowed="2-D images of equal shape")
            object.__setattr__(self, name, image)
        for name in ("pixel_scale_arcsec", "aperture_radius_arcsec", "hole_outer_arcsec"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"panels.{name}", value, unit="arcsec", allowed="finite and above 0")
        rows, columns = np.shape(self.science)
        if self.star_column is None:
            object.__setattr__(self, "star_column", (columns - 1) / 2.0)
        if self.star_row is None:
            object.__setattr__(self, "star_row", (rows - 1) / 2.0)
        compass(self.parity, self.roll_deg)

    @property
    def star_pixel(self) -> tuple[float, float]:
        """Column and row of the star."""
        assert self.star_column is not None
        assert self.star_row is not None
        return self.star_column, self.star_row

    @property
    def zone(self) -> HoleZone:
        """The dark quadrants."""
        return HoleZone(self.hole_inner_arcsec, self.hole_outer_arcsec, self.hole_mode, self.hole_side)

    @property
    def extent_arcsec(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top edge of the array, arcsec from the star on the detector."""
        rows, columns = self.science.shape
        column, row = self.star_pixel
        edges = (
            np.array([-0.5 - column, columns - 0.5 - column, -0.5 - row, rows - 0.5 - row]) * self.pixel_scale_arcsec
        )
        return float(edges[0]), float(edges[1]), float(edges[2]), float(edges[3])

    def inside_hole(self) -> NDArray[np.bool_]:
        """Pixels whose centres lie in one of the dark quadrants, (y, x)."""
        rows, columns = self.science.shape
        column, row = self.star_pixel
        x = np.asarray((np.arange(columns) - column) * self.pixel_scale_arcsec, dtype=np.float64)
        y = np.asarray((np.arange(rows) - row) * self.pixel_scale_arcsec, dtype=np.float64)
        return self.zone.covers(y, x)

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays for ``numpy.savez`` (no pickle needed); images in single precision."""
        stored: dict[str, NDArray[Any]] = {}
        for item in fields(self):
            value = getattr(self, item.name)
            stored[item.name] = value.astype(_STORED_DTYPE) if item.name in _IMAGES else np.asarray(value)
        return stored

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Any]) -> Panels:
        """Panels of what `to_arrays` gave, or of an open npz file.

        Raises
        ------
        InputError
            If an array is missing or the values are refused.
        """
        values: dict[str, Any] = {}
        for item in fields(cls):
            if item.name not in arrays:
                raise InputError(
                    "panels",
                    item.name,
                    allowed="an npz file with every array of Panels",
                    hint="it is missing",
                )
            value = np.asarray(arrays[item.name])
            values[item.name] = value if item.name in _IMAGES else value.item()
        return cls(**values)
