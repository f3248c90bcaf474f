"""What radial velocities say of the reference planet of each star."""

import math
from dataclasses import dataclass

from catalogs import amplitude_m_s
from cpic_core import BoolArray, FloatArray
from cpic_planner.etc import reference_distance_au
from cpic_planner.planets import StarLimits, excluded_by_rv, least_mass
from cpic_planner.queries import ReferencePlanet
from cpic_planner.targets import Targets

MEDIAN_INCLINATION_DEG = 60.0
"""Half of all orbits, whose poles are isotropic, are inclined by more."""


@dataclass(frozen=True, eq=False)
class ReferenceVelocities:
    """The reference planet where it stands, arrays of ``n`` stars.

    Attributes
    ----------
    distance_au : ndarray
        From its star: the radius of its orbit.
    amplitude_m_s : ndarray
        Of the star's velocity, where the planet has the least mass of its radius and the median inclination.
    excluded : ndarray of bool
        Whether velocities would have shown it.
    """

    distance_au: FloatArray
    amplitude_m_s: FloatArray
    excluded: BoolArray


def reference_velocities(
    targets: Targets, separation_arcsec: FloatArray, planet: ReferencePlanet
) -> ReferenceVelocities:
    """Return what velocities say of the reference planet.

    Parameters
    ----------
    targets : Targets
        ``n`` stars.
    separation_arcsec : ndarray, shape (n,)
        Projected, where the planet stands.
    planet : ReferencePlanet
    """
    names: list[str] = targets.name.tolist()
    distance = reference_distance_au(targets, separation_arcsec[:, None], planet)[:, 0]
    msini = least_mass(planet.radius_rjup) * math.sin(math.radians(MEDIAN_INCLINATION_DEG))
    amplitude = amplitude_m_s(msini, distance, StarLimits.of(names, ()).star_mass_msun)
    return ReferenceVelocities(distance, amplitude, excluded_by_rv(names, distance, planet.radius_rjup))
