"""The three images of one band of one confirmed target or scene, with what is marked on them."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from cpic_core import FloatArray, InputError, NDArray
from simulator.imaging import Zone
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
    aperture_radius_arcsec : float
        Photometric aperture.
    zone : HoleZone or RingZone
        The dark quadrants, or the ring.
    parity : int
        Detector parity, -1 or +1.
    roll_deg : float
        Rotation of the sky on the detector.
    marks : tuple of Mark
        What is marked, planets included.
    """

    band: str
    science: FloatArray
    reference: FloatArray
    residual: FloatArray
    pixel_scale_arcsec: float
    aperture_radius_arcsec: float
    zone: Zone
    parity: int = -1
    roll_deg: float = 0.0
    marks: tuple[Mark, ...] = ()

    def __post_init__(self) -> None:
        for name in _IMAGES:
            image = np.asarray(getattr(self, name), dtype=np.float64)
            if image.ndim != 2 or image.shape != np.shape(self.science) or image.size == 0:
                raise InputError(f"panels.{name}", str(image.shape), allowed="2-D images of equal shape")
            object.__setattr__(self, name, image)
        for name in ("pixel_scale_arcsec", "aperture_radius_arcsec"):
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
