"""Deformable mirror: a square grid of actuators with separable Gaussian influence functions.

The surface of an ``a x a`` mirror on an ``n x n`` pupil grid is ``B c B^T`` with B of shape (n, a): two small matrix
products, and a Jacobian of the focal-plane field that separates in the same way. The actuators fill a centred square,
one pitch apart, the outermost half a pitch inside its edge. The square need not reach the rim of the pupil: beyond
0.875 diameters the default apodizer transmits less than 1 % in amplitude, and a mirror laid on the open part
controls ``a / (2 x 0.875)`` cycles per diameter instead of ``a / 2``. Light is reflected, so the optical path
difference is twice the surface.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from catalogs.errors import InputError
from simulator.arrays import read_npz

__all__ = ["DeformableMirror", "load_dm_surface"]

FloatArray = NDArray[np.float64]
UNITS_NM = {"nm": 1.0, "um": 1e3, "micron": 1e3, "mm": 1e6, "m": 1e9}
MAX_SURFACE_NM = 1e4


@dataclass(frozen=True)
class DeformableMirror:
    """A mirror and what its electronics do to a command.

    Attributes
    ----------
    n_actuators : int
        Actuators a side, 4 to 128 (A: 32).
    span_diameters : float
        Side of the square that they fill, in pupil diameters, 0.5 to 1.5 (A: 0.875, the open part of the apodizer).
    coupling : float
        Influence of an actuator one pitch away, 0.01 to 0.5 (A: 0.15, usual for micro-machined mirrors).
    stroke_nm : float
        Range of the surface command, from ``-stroke/2`` to ``+stroke/2``, > 0 (A: 1000).
    bits : int or None
        Resolution of the digital-analogue converter over the stroke, 8 to 32; None does not quantise.
    noise_nm : float
        Rms noise of each actuator, nm of surface, >= 0.
    dead : tuple of (int, int)
        Row and column of actuators that stay at zero.
    """

    n_actuators: int = 32
    span_diameters: float = 0.875
    coupling: float = 0.15
    stroke_nm: float = 1000.0
    bits: int | None = None
    noise_nm: float = 0.0
    dead: tuple[tuple[int, int], ...] = ()

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not 4 <= self.n_actuators <= 128:
            raise InputError("n_actuators", self.n_actuators, allowed="4 to 128")
        if not 0.5 <= self.span_diameters <= 1.5:
            raise InputError("span_diameters", self.span_diameters, unit="pupil diameters", allowed="0.5 to 1.5")
        if not 0.01 <= self.coupling <= 0.5:
            raise InputError("coupling", self.coupling, allowed="0.01 to 0.5")
        if not (math.isfinite(self.stroke_nm) and self.stroke_nm > 0):
            raise InputError("stroke_nm", self.stroke_nm, unit="nm", allowed="above 0")
        if self.bits is not None and not 8 <= self.bits <= 32:
            raise InputError("bits", self.bits, allowed="8 to 32, or none")
        if not (math.isfinite(self.noise_nm) and self.noise_nm >= 0):
            raise InputError("noise_nm", self.noise_nm, unit="nm", allowed="at least 0")
        for place in self.dead:
            if len(place) != 2 or not all(0 <= index < self.n_actuators for index in place):
                raise InputError("dead", place, allowed=f"row and column from 0 to {self.n_actuators - 1}")

    @property
    def alive(self) -> NDArray[np.bool_]:
        """Actuators that obey, shape (a, a)."""
        answer = np.ones((self.n_actuators, self.n_actuators), dtype=bool)
        for row, column in self.dead:
            answer[row, column] = False
        return answer

    def influence(self, samples: int) -> FloatArray:
        """Influence functions of one axis at the sample centres, shape (samples, a)."""
        pitch = self.span_diameters / self.n_actuators
        position = (np.arange(samples) + 0.5) / samples - 0.5
        actuator = (np.arange(self.n_actuators) + 0.5) * pitch - self.span_diameters / 2
        distance = (position[:, None] - actuator) / pitch
        return np.asarray(self.coupling ** (distance**2), dtype=np.float64)

    def surface_nm(self, commands_nm: FloatArray, samples: int) -> FloatArray:
        """Surface of commands ``[y, x]`` on a pupil grid, shape (samples, samples)."""
        functions = self.influence(samples)
        return np.asarray(functions @ self._checked(commands_nm) @ functions.T)

    def opd_nm(self, commands_nm: FloatArray, samples: int) -> FloatArray:
        """Optical path difference on reflection: twice the surface."""
        return 2.0 * self.surface_nm(commands_nm, samples)

    def within_stroke(self, commands_nm: FloatArray) -> bool:
        """Whether every command is within reach."""
        return bool(np.abs(self._checked(commands_nm)).max() <= self.stroke_nm / 2)

    def realise(self, commands_nm: FloatArray, rng: np.random.Generator | None = None) -> FloatArray:
        """What the mirror does when asked: clipped to the stroke, rounded to steps, noisy, dead actuators at zero.

        Parameters
        ----------
        commands_nm : ndarray, shape (a, a)
            Commands, nm of surface.
        rng : numpy.random.Generator, optional
            Source of the noise; needed if ``noise_nm`` is above 0.

        Raises
        ------
        InputError
            For commands of another shape or not finite, or noise without ``rng``.
        """
        asked = self._checked(commands_nm)
        done = np.clip(asked, -self.stroke_nm / 2, self.stroke_nm / 2)
        if self.bits is not None:
            step = self.stroke_nm / 2**self.bits
            done = np.clip(np.rint(done / step), -(2 ** (self.bits - 1)), 2 ** (self.bits - 1) - 1) * step
        if self.noise_nm > 0:
            if rng is None:
                raise InputError("rng", None, allowed="a random generator, since noise_nm is above 0")
            done = done + self.noise_nm * rng.standard_normal(done.shape)
        return np.where(self.alive, done, 0.0)

    def _checked(self, commands_nm: FloatArray) -> FloatArray:
        commands = np.asarray(commands_nm, dtype=np.float64)
        if commands.shape != (self.n_actuators,) * 2:
            raise InputError("commands_nm", commands.shape, allowed=f"shape {(self.n_actuators,) * 2}")
        if not np.isfinite(commands).all():
            raise InputError("commands_nm", "NaN or infinite values", unit="nm", allowed="finite numbers")
        return commands


def load_dm_surface(path: str | Path, samples: int, *, unit: str | None = None) -> FloatArray:
    """Surface of a mirror from a file, on the pupil grid.

    Parameters
    ----------
    path : str or Path
        FITS file (first image; its unit is the header's ``BUNIT``) or npz file (array ``surface_nm``, in nm). The map
        spans the pupil diameter exactly and is indexed ``[y, x]``.
    samples : int
        Samples across the pupil: a multiple of the map's side. A map is piecewise constant, as the apodizer is.
    unit : str, optional
        Unit of a FITS image without ``BUNIT``: ``nm``, ``um``, ``mm`` or ``m``; it must not contradict the header.

    Returns
    -------
    ndarray, shape (samples, samples)
        Surface in nm; the optical path difference is twice that.

    Raises
    ------
    InputError
        If the file cannot be read, has no or another unit, is not a square map that fits ``samples``, holds NaN, or
        reaches beyond 10 um (a unit mistaken by a thousand).
    """
    name = str(path)
    if not Path(name).is_file():
        raise InputError("dm_surface", name, allowed="an existing FITS or npz file")
    if Path(name).suffix == ".npz":
        arrays = read_npz(name)
        if "surface_nm" not in arrays:
            raise InputError("dm_surface", name, allowed="an npz file with an array named surface_nm")
        raw, factor = arrays["surface_nm"], _factor(name, "nm", unit)
    else:
        raw, header_unit = _from_fits(name)
        factor = _factor(name, header_unit, unit)
    if raw.dtype.kind not in "fiu" or raw.ndim != 2 or len(set(raw.shape)) != 1 or len(raw) < 2:
        raise InputError("dm_surface", name, allowed="a square map of real numbers", hint=f"shape {raw.shape}")
    surface = np.asarray(raw, dtype=np.float64) * factor
    if not np.isfinite(surface).all():
        raise InputError("dm_surface", name, allowed="finite heights", hint=f"{(~np.isfinite(surface)).sum()} are not")
    if np.abs(surface).max() > MAX_SURFACE_NM:
        raise InputError("dm_surface", name, unit="nm", allowed=f"heights within {MAX_SURFACE_NM:g} nm",
                         hint=f"found {np.abs(surface).max():.3g} nm; is the unit right?")  # fmt: skip
    repeat, rest = divmod(samples, len(surface))
    if rest or repeat < 1:
        raise InputError("dm_surface", name, allowed=f"a map whose side divides the {samples} pupil samples",
                         hint=f"its side is {len(surface)}")  # fmt: skip
    return np.repeat(np.repeat(surface, repeat, axis=0), repeat, axis=1)


def _from_fits(name: str) -> tuple[NDArray[np.float64], str | None]:
    from astropy.io import fits

    try:
        with fits.open(name, memmap=False) as hdus:
            images = [(hdu.data, hdu.header.get("BUNIT")) for hdu in hdus if hdu.is_image and hdu.data is not None]
    except (OSError, ValueError, TypeError) as error:
        raise InputError("dm_surface", name, allowed="a FITS or npz file", hint=str(error)) from None
    if not images:
        raise InputError("dm_surface", name, allowed="a FITS file with an image")
    data, header_unit = images[0]
    return np.asarray(data), None if header_unit is None else str(header_unit).strip()


def _factor(name: str, found: str | None, asked: str | None) -> float:
    for unit in (found, asked):
        if unit is not None and unit not in UNITS_NM:
            raise InputError("dm_surface unit", unit, allowed=", ".join(UNITS_NM), hint=name)
    if found is not None and asked is not None and UNITS_NM[found] != UNITS_NM[asked]:
        raise InputError("dm_surface unit", asked, allowed=f"{found}, as the file says", hint=name)
    unit = found or asked
    if unit is None:
        raise InputError("dm_surface unit", "missing", allowed="BUNIT in the header, or the argument unit", hint=name)
    return UNITS_NM[unit]
