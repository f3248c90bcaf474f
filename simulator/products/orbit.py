"""Where the telescope is: a circular orbit about an oblate Earth. A model; it follows no ephemeris."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulator.config.mission import OrbitConfig

__all__ = ["CircularOrbit", "earth_radius_deg"]

FloatArray = NDArray[np.float64]

# WGS 84: equatorial radius (km), gravity (km3/s2) and oblateness of the Earth.
EARTH_RADIUS_KM = 6378.137
_GM_KM3_S2 = 398600.4418
_J2 = 1.08262668e-3


@dataclass(frozen=True)
class CircularOrbit:
    """A circular orbit whose node drifts.

    Position in the equatorial inertial frame, ``R_z(node) R_x(inclination) (a cos u, a sin u, 0)`` with the angle ``u``
    from the node at Kepler's rate and the node at the secular rate of the Earth's oblateness,
    ``-3/2 n J2 (R/a)^2 cos i``.
    """

    config: OrbitConfig

    @property
    def radius_km(self) -> float:
        """Distance from the centre of the Earth."""
        return EARTH_RADIUS_KM + self.config.altitude_km

    @property
    def period_s(self) -> float:
        """Period of revolution."""
        return 2.0 * math.pi / self._motion_rad_s

    @property
    def _motion_rad_s(self) -> float:
        return math.sqrt(_GM_KM3_S2 / self.radius_km**3)

    @property
    def node_rate_deg_day(self) -> float:
        """Drift of the node."""
        return math.degrees(self._node_rate_rad_s) * 86400.0

    @property
    def _node_rate_rad_s(self) -> float:
        flattening = _J2 * (EARTH_RADIUS_KM / self.radius_km) ** 2
        return -1.5 * self._motion_rad_s * flattening * math.cos(math.radians(self.config.inclination_deg))

    def plane(self, elapsed_s: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Axes of the plane of the orbit.

        Parameters
        ----------
        elapsed_s : array_like, shape (n,)
            Seconds since the epoch of the orbit.

        Returns
        -------
        towards_node, ahead : ndarray, shape (n, 3)
            Unit vectors to the ascending node, and a quarter of a revolution ahead of it.
        """
        node = math.radians(self.config.node_deg) + self._node_rate_rad_s * np.asarray(elapsed_s, dtype=np.float64)
        tilt = math.radians(self.config.inclination_deg)
        towards_node = np.stack([np.cos(node), np.sin(node), np.zeros_like(node)], axis=-1)
        ahead = np.stack(
            [-np.sin(node) * math.cos(tilt), np.cos(node) * math.cos(tilt), np.full_like(node, math.sin(tilt))], axis=-1
        )
        return towards_node, ahead

    def state(self, elapsed_s: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Position and velocity.

        Parameters
        ----------
        elapsed_s : array_like, shape (n,)
            Seconds since the epoch of the orbit.

        Returns
        -------
        position_km, velocity_km_s : ndarray, shape (n, 3)
        """
        elapsed = np.asarray(elapsed_s, dtype=np.float64)
        along = math.radians(self.config.phase_deg) + self._motion_rad_s * elapsed
        towards_node, ahead = self.plane(elapsed)
        cosine, sine = np.cos(along)[..., None], np.sin(along)[..., None]
        position = self.radius_km * (cosine * towards_node + sine * ahead)
        velocity = self.radius_km * self._motion_rad_s * (cosine * ahead - sine * towards_node)
        # The drift of the node turns the whole orbit about the axis of the Earth.
        turn = self._node_rate_rad_s * np.stack([-position[..., 1], position[..., 0], np.zeros_like(along)], axis=-1)
        return position, velocity + turn


def earth_radius_deg(distance_km: ArrayLike) -> FloatArray:
    """Angular radius of the solid Earth from a distance of its centre."""
    return np.rad2deg(np.arcsin(EARTH_RADIUS_KM / np.asarray(distance_km, dtype=np.float64)))
