"""Planets on orbits: the elements that every draw of planets has."""

from dataclasses import dataclass

import numpy as np

from catalogs import ORBIT, OrbitPlaces, orbit_places
from cpic_core import ArrayLike, FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class OrbitingPlanets:
    """Planets on Kepler orbits, arrays of one shape; what every draw of planets has.

    Attributes
    ----------
    radius_rjup : ndarray
        Radius in Jupiter equatorial radii.
    semi_major_axis_au, eccentricity, inclination_deg, argument_of_pericentre_deg, node_deg : ndarray
        As `orbit_places` takes them.
    mean_anomaly_deg : ndarray
        At the epoch of the draw.
    """

    radius_rjup: FloatArray
    semi_major_axis_au: FloatArray
    eccentricity: FloatArray
    inclination_deg: FloatArray
    argument_of_pericentre_deg: FloatArray
    node_deg: FloatArray
    mean_anomaly_deg: FloatArray

    def places_after(self, days: ArrayLike, period_days: FloatArray) -> OrbitPlaces:
        """Return places so many days after the epoch.

        Parameters
        ----------
        days : array_like
            Broadcasts against the planets.
        period_days : ndarray
            Period of each planet, days.

        Returns
        -------
        OrbitPlaces
            Arrays of the shape of ``days`` and the planets, broadcast.
        """
        *elements, anomaly = (getattr(self, name) for name in ORBIT)
        return orbit_places(*[*elements, anomaly + 360.0 * np.asarray(days, float) / period_days])
