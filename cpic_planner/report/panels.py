"""The three images of one band of one confirmed target or scene, with what is marked on them."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from cpic_core import FloatArray, InputError, NDArray
from simulator.imaging import HoleSide, Zone, ZoneMode, zone_from
from simulator.target import sky_to_detector

_IMAGES = ("science", "reference", "residual")
MarkKind: TypeAlias = Literal["planet", "star", "candidate"]


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
class Mark:
    """A place that is marked on the images: a planet, a star of the scene, or what a blind search names.

    Attributes
    ----------
    x_arcsec, y_arcsec : float
        Offset from the star on the detector.
    kind : {"planet", "star", "candidate"}
        What it is: candidates are marked on the residual alone.
    label : str
        Written beside it; empty for none.
    """

    x_arcsec: float
    y_arcsec: float
    kind: MarkKind = "planet"
    label: str = ""


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
    planet_x_arcsec, planet_y_arcsec : float or None
        Offset of the planet from the star on the detector; None for a scene without one.
    aperture_radius_arcsec : float
        Photometric aperture.
    hole_inner_arcsec, hole_outer_arcsec : float
        Each quadrant's zone is ``inner <= |x|, |y| <= outer`` (not diagonal separations); radii of a ring.
    mask_half_width_arcsec : float
        Half width of the arms of the cross mask.
    hole_mode, hole_side : str
        All four quadrants, the two on a side of the star, or a ring.
    parity : int
        Detector parity, -1 or +1.
    roll_deg : float
        Rotation of the sky on the detector.

    marks : tuple of Mark
        What else is marked.
    """

    band: str
    science: FloatArray
    reference: FloatArray
    residual: FloatArray
    pixel_scale_arcsec: float
    planet_x_arcsec: float | None
    planet_y_arcsec: float | None
    aperture_radius_arcsec: float
    hole_inner_arcsec: float
    hole_outer_arcsec: float
    mask_half_width_arcsec: float
    hole_mode: ZoneMode = "4q"
    hole_side: HoleSide = "right"
    parity: int = -1
    roll_deg: float = 0.0

    marks: tuple[Mark, ...] = ()

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
        compass(self.parity, self.roll_deg)

    @property
    def star_pixel(self) -> tuple[float, float]:
        """Column and row of the star: the middle of the array."""
        rows, columns = self.science.shape
        return (columns - 1) / 2.0, (rows - 1) / 2.0

    @property
    def every_mark(self) -> tuple[Mark, ...]:
        """The planet first, where there is one, then the other marks."""
        if self.planet_x_arcsec is None or self.planet_y_arcsec is None:
            return self.marks
        return Mark(self.planet_x_arcsec, self.planet_y_arcsec), *self.marks

    @property
    def zone(self) -> Zone:
        """The dark quadrants, or the ring."""
        return zone_from(self.hole_inner_arcsec, self.hole_outer_arcsec, self.hole_mode, self.hole_side)

    @property
    def extent_arcsec(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top edge of the array, arcsec from the star on the detector."""
        rows, columns = self.science.shape
        column, row = self.star_pixel
        edges = np.array([-0.5 - column, columns - 0.5 - column, -0.5 - row, rows - 0.5 - row])
        left, right, bottom, top = (edges * self.pixel_scale_arcsec).tolist()
        return left, right, bottom, top

    def inside_hole(self) -> NDArray[np.bool_]:
        """Return the pixels whose centres lie in one of the dark quadrants, (y, x)."""
        rows, columns = self.science.shape
        column, row = self.star_pixel
        x = np.asarray((np.arange(columns) - column) * self.pixel_scale_arcsec, dtype=np.float64)
        y = np.asarray((np.arange(rows) - row) * self.pixel_scale_arcsec, dtype=np.float64)
        return self.zone.covers(y, x)
