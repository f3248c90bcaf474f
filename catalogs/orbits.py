"""Places on orbits of planets and companions: Kepler's equation, offsets on the sky, distance and phase angle."""

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, Record, check_finite

ECCENTRICITY_MAX = 0.999
"""Largest eccentricity for which Kepler's equation is solved to rounding."""
_CORRECTIONS = 2
_ANGLES = ("inclination_deg", "argument_of_pericentre_deg", "node_deg", "mean_anomaly_deg")
ORBIT = ("semi_major_axis_au", "eccentricity", *_ANGLES)
"""Elements of an orbit, in the order in which `orbit_places` takes them."""


class OrbitPlaces(Record, eq=False):
    """Places at one moment, arrays of one shape.

    Attributes
    ----------
    east_au, north_au : ndarray
        Offsets from the star, projected on the sky.
    distance_au : ndarray
        True distance from the star.
    phase_deg : ndarray
        Angle star-planet-observer, 0 (full, behind the star) to 180 (new).
    """

    east_au: FloatArray
    north_au: FloatArray
    distance_au: FloatArray
    phase_deg: FloatArray


def eccentric_anomaly(mean_anomaly_rad: ArrayLike, eccentricity: ArrayLike) -> FloatArray:
    """Solve Kepler's equation ``E - e sin E = M``.

    Parameters
    ----------
    mean_anomaly_rad : array_like
        Any finite angle.
    eccentricity : array_like
        0 to 0.999; broadcasts.

    Returns
    -------
    ndarray
        E in the turn of M, to 1e-14 rad in the turn -pi to pi.

    Raises
    ------
    InputError
        If a value is out of range.

    Notes
    -----
    The start is the root of a cubic, 5e-4 from the solution or nearer (Markley 1995, Celest. Mech. Dyn. Astron. 63,
    101); each Halley correction cubes the error.
    """
    angle = check_finite("mean_anomaly_rad", mean_anomaly_rad, "rad")
    e = _eccentricity(eccentricity)
    turns = np.round(angle / (2.0 * np.pi))
    signed = angle - 2.0 * np.pi * turns
    m = np.abs(signed)
    alpha = (3.0 * np.pi**2 + 1.6 * np.pi * (np.pi - m) / (1.0 + e)) / (np.pi**2 - 6.0)
    d = 3.0 * (1.0 - e) + alpha * e
    q = 2.0 * alpha * d * (1.0 - e) - m**2
    r = 3.0 * alpha * d * (d - 1.0 + e) * m + m**3
    w = np.cbrt(r + np.sqrt(q**3 + r**2)) ** 2
    root = (2.0 * r * w / (w**2 + w * q + q**2) + m) / d
    for _ in range(_CORRECTIONS):
        sine, cosine = e * np.sin(root), e * np.cos(root)
        miss, slope = root - sine - m, 1.0 - cosine
        root = root - miss / (slope - 0.5 * miss * sine / slope)
    return np.asarray(np.copysign(root, signed) + 2.0 * np.pi * turns)


def orbit_places(
    semi_major_axis_au: ArrayLike,
    eccentricity: ArrayLike,
    inclination_deg: ArrayLike,
    argument_of_pericentre_deg: ArrayLike,
    node_deg: ArrayLike,
    mean_anomaly_deg: ArrayLike,
) -> OrbitPlaces:
    """Return the places of planets on Kepler orbits.

    Parameters
    ----------
    semi_major_axis_au : array_like
        Above 0.
    eccentricity : array_like
        0 to 0.999.
    inclination_deg : array_like
        0: face-on, position angle growing; 90: edge-on; 180: face-on, position angle falling.
    argument_of_pericentre_deg : array_like
        Of the planet's own orbit, from the ascending node along its motion.
    node_deg : array_like
        Position angle of the ascending node, where the planet moves away from the observer, east of north.
    mean_anomaly_deg : array_like
        0 at pericentre. All arguments broadcast.

    Returns
    -------
    OrbitPlaces

    Raises
    ------
    InputError
        If a value is out of range.

    Notes
    -----
    With u the angle from the node along the orbit, the offsets are ``north = r (cos Omega cos u - sin Omega sin u
    cos i)``, ``east = r (sin Omega cos u + cos Omega sin u cos i)``, and ``away = r sin u sin i`` from the observer: a
    planet behind its star shows its lit side, ``cos(phase) = away / r``.
    """
    axis = check_finite("semi_major_axis_au", semi_major_axis_au, "au")
    if np.any(axis <= 0.0):
        raise InputError("semi_major_axis_au", float(axis.min()), unit="au", allowed="above 0")
    e = _eccentricity(eccentricity)
    angles = zip(_ANGLES, (inclination_deg, argument_of_pericentre_deg, node_deg, mean_anomaly_deg), strict=True)
    tilt, pericentre, node, mean = (np.deg2rad(check_finite(name, value, "deg")) for name, value in angles)
    anomaly = eccentric_anomaly(mean, e)
    distance = axis * (1.0 - e * np.cos(anomaly))
    # In the plane of the orbit, from the pericentre; then from the node.
    along, across = axis * (np.cos(anomaly) - e), axis * np.sqrt((1.0 - e) * (1.0 + e)) * np.sin(anomaly)
    at_node = along * np.cos(pericentre) - across * np.sin(pericentre)
    past_node = along * np.sin(pericentre) + across * np.cos(pericentre)
    level, away = past_node * np.cos(tilt), past_node * np.sin(tilt)
    east = at_node * np.sin(node) + level * np.cos(node)
    north = at_node * np.cos(node) - level * np.sin(node)
    # The arc tangent keeps its digits at full and new phase, where the arc cosine has none.
    phase = np.rad2deg(np.arctan2(np.hypot(at_node, level), away))
    return OrbitPlaces(*(np.array(part) for part in np.broadcast_arrays(east, north, distance, phase)))


def _eccentricity(value: ArrayLike) -> FloatArray:
    e = check_finite("eccentricity", value)
    if np.any(bad := (e < 0.0) | (e > ECCENTRICITY_MAX)):
        raise InputError("eccentricity", float(e[bad].flat[0]), allowed=f"0 to {ECCENTRICITY_MAX:g}")
    return e
