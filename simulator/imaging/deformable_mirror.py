"""Deformable mirror: a square grid of actuators with separable Gaussian influence functions.

The surface of an ``a x a`` mirror on an ``n x n`` pupil grid is ``B c B^T`` with B of shape (n, a): two small matrix
products, and a Jacobian of the focal-plane field that separates in the same way. The actuators fill a centred square,
one pitch apart, the outermost half a pitch inside its edge. The square need not reach the rim of the pupil: beyond
0.875 diameters the default apodizer transmits less than 1 % in amplitude, and a mirror laid on the open part
controls ``a / (2 x 0.875)`` cycles per diameter instead of ``a / 2``. Light is reflected, so the optical path
difference is twice the surface.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from catalogs import length_nm
from cpic_core import FloatArray, InputError, NDArray, check_whole, numeric_context
from simulator.config.instrument import MirrorConfig
from simulator.config.map_files import read_maps, real_map

UNITS_NM = {"nm": 1.0, "um": 1e3, "micron": 1e3, "mm": 1e6, "m": 1e9, "angstrom": 0.1, "pm": 1e-3}
MAX_SURFACE_NM = 1e4
MAX_SIDE = 4096


class DeformableMirror(MirrorConfig):
    """A mirror: its surface, and what it does when asked."""

    @property
    def alive(self) -> NDArray[np.bool_]:
        """Actuators that obey, shape (a, a)."""
        answer = np.ones((self.n_actuators, self.n_actuators), dtype=bool)
        for row, column in self.dead:
            answer[row, column] = False
        return answer

    def influence(self, samples: int) -> FloatArray:
        """Return the influence functions of one axis at the sample centres, shape (samples, a)."""
        pitch = self.span_diameters / self.n_actuators
        position = (np.arange(samples) + 0.5) / samples - 0.5
        actuator = (np.arange(self.n_actuators) + 0.5) * pitch - self.span_diameters / 2
        distance = (position[:, None] - actuator) / pitch
        return np.asarray(self.coupling ** (distance**2), dtype=np.float64)

    def surface_nm(self, commands_nm: FloatArray, samples: int) -> FloatArray:
        """Return the surface of commands ``[y, x]`` on a pupil grid, shape (samples, samples).

        Parameters
        ----------
        commands_nm : ndarray
            Commands of the mirror's actuators, nm of surface, shape (a, a).
        samples : int
            Samples of the pupil grid a side.
        """
        functions = self.influence(samples)
        return np.asarray(functions @ commands_nm @ functions.T)

    def opd_nm(self, commands_nm: FloatArray, samples: int) -> FloatArray:
        """Return the optical path difference on reflection: twice the surface.

        Parameters
        ----------
        commands_nm : ndarray
            Commands of the mirror's actuators, nm of surface, shape (a, a).
        samples : int
            Samples of the pupil grid a side.
        """
        return 2.0 * self.surface_nm(commands_nm, samples)

    def realise(self, commands_nm: FloatArray, rng: np.random.Generator | None = None) -> FloatArray:
        """Return what the mirror does when asked: clipped to the stroke, rounded, noisy, dead actuators at zero.

        Parameters
        ----------
        commands_nm : ndarray, shape (a, a)
            Commands, nm of surface.
        rng : numpy.random.Generator, optional
            Source of the noise; needed if ``noise_nm`` is above 0.

        Raises
        ------
        InputError
            For noise without ``rng``.
        """
        done = np.clip(commands_nm, -self.stroke_nm / 2, self.stroke_nm / 2)
        if self.bits is not None:
            step = self.stroke_nm / 2**self.bits
            done = np.clip(np.rint(done / step), -(2 ** (self.bits - 1)), 2 ** (self.bits - 1) - 1) * step
        if self.noise_nm > 0:
            if rng is None:
                raise InputError("rng", None, allowed="a random generator, since noise_nm is above 0")
            done = done + self.noise_nm * rng.standard_normal(done.shape)
        return np.where(self.alive, done, 0.0)


@numeric_context()
def load_dm_surface(path: str | Path, samples: int | None = None, *, unit: str | None = None) -> FloatArray:
    """Return the surface of a mirror from a file.

    Parameters
    ----------
    path : str or Path
        FITS file (first image; its unit is the header's ``BUNIT``) or npz file (array ``surface_nm``, in nm). The map
        spans the pupil diameter exactly and is indexed ``[y, x]``.
    samples : int, optional
        Samples across the pupil: a multiple of the map's side. A map is piecewise constant, as the apodizer is. The
        map's own side if omitted.
    unit : str, optional
        Unit of a FITS image without ``BUNIT``: ``nm``, ``um``, ``mm``, ``m``, ``angstrom`` or ``pm``; it must not
        contradict the header.

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
    file = read_maps("dm_surface", path)
    found = file.maps[0] if file.is_fits else file.named("surface_nm")
    if found is None:
        raise InputError("dm_surface", name, allowed="an npz file with an array named surface_nm")
    header_unit = str(found.header.get("BUNIT", "")).strip() or None
    factor = _factor(name, header_unit if file.is_fits else "nm", unit)
    surface = real_map("dm_surface", name, found.data, sides=(2, MAX_SIDE)) * factor
    if np.abs(surface).max() > MAX_SURFACE_NM:
        hint = f"found {np.abs(surface).max():.3g} nm; is the unit right?"
        raise InputError("dm_surface", name, unit="nm", allowed=f"heights within {MAX_SURFACE_NM:g} nm", hint=hint)
    if samples is None:
        return surface
    repeat, rest = divmod(check_whole("samples", samples, 1, MAX_SIDE), len(surface))
    if rest or repeat < 1:
        allowed = f"a map whose side divides the {samples} pupil samples"
        raise InputError("dm_surface", name, allowed=allowed, hint=f"its side is {len(surface)}")
    return np.repeat(np.repeat(surface, repeat, axis=0), repeat, axis=1)


def _factor(name: str, found: str | None, asked: str | None) -> float:
    """Return the nanometres in the unit that the file or the caller names."""
    for unit in (found, asked):
        if unit is not None and _nm_per(unit) is None:
            raise InputError("dm_surface unit", unit, allowed=", ".join(UNITS_NM), hint=name)
    scales = {_nm_per(unit): unit for unit in (asked, found) if unit is not None}
    if len(scales) == 2:
        raise InputError("dm_surface unit", str(asked), allowed=f"{found}, as the file says", hint=name)
    for scale in scales:
        if scale is not None:
            return scale
    raise InputError("dm_surface unit", "missing", allowed="BUNIT in the header, or the argument unit", hint=name)


def _nm_per(unit: object) -> float | None:
    """Return the nanometres per unit of length, None for another unit. Capitals matter in short names (Mm, mm)."""
    if not isinstance(unit, str):
        return None
    return UNITS_NM.get(unit, length_nm(unit) if len(unit) > 2 or not unit.isascii() else None)
