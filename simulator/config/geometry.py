"""Where the bodies of a scene stand: offsets from the central star on the sky, and true distances from it."""

from __future__ import annotations

import math
from typing import NamedTuple

from catalogs.coordinates import position_angle, separation_arcsec, tangent_offset
from catalogs.errors import InputError
from simulator.config.bodies import MAX_SEPARATION_ARCSEC, Body, Planet, SceneStar
from simulator.config.keys import required

__all__ = ["DISTANCE_TOLERANCE", "Place", "place", "true_distance_au"]

DISTANCE_TOLERANCE = 0.01
"""Largest difference between a given projected and a given true distance, relative to the true one: people round."""


class Place(NamedTuple):
    """Offset from the central star on the sky."""

    separation_arcsec: float
    pa_deg: float


def place(host: SceneStar, body: Body) -> Place:
    """Offset of a body from the central star, exact on the sphere.

    Parameters
    ----------
    host : SceneStar
        The central star; its coordinates are needed where the body is given by coordinates, at the same epoch.
    body : Body
        A star or planet.

    Raises
    ------
    InputError
        If no place is given, the coordinates of the host are missing, or the body is farther than 120 arcsec.
    """
    if body.separation_arcsec is not None and body.pa_deg is not None:
        return Place(body.separation_arcsec, body.pa_deg)
    if body.ra_deg is None or body.dec_deg is None:
        raise required("separation_arcsec", "separation_arcsec and pa_deg, or ra_deg and dec_deg")
    if host.ra_deg is None or host.dec_deg is None:
        raise InputError("ra_deg", body.ra_deg, unit="deg", allowed="coordinates where cstar has them too")
    sky = (body.ra_deg, body.dec_deg, host.ra_deg, host.dec_deg)
    separation = float(separation_arcsec(*sky))
    if separation > MAX_SEPARATION_ARCSEC:
        raise InputError(
            "ra_deg, dec_deg",
            f"{separation:.6g} arcsec from cstar",
            allowed=f"at most {MAX_SEPARATION_ARCSEC:g} arcsec, at the same epoch",
        )
    return Place(separation, float(position_angle(*tangent_offset(*sky))))


def true_distance_au(planet: Planet, separation: float, distance_pc: float | None) -> float | None:
    """True distance of a planet from its star, au.

    The given one, or ``r = rho / sin(phase)`` with the projected distance ``rho = separation x distance_pc``
    (1 arcsec at 1 pc is 1 au). A given distance must agree with the projected one where both are known.

    Parameters
    ----------
    planet : Planet
    separation : float
        Projected separation, arcsec.
    distance_pc : float or None
        Distance of the star.

    Returns
    -------
    float or None
        None for a planet with light of its own whose distance is not known: nothing depends on it.

    Raises
    ------
    InputError
        If the distance does not follow from what is given, or contradicts it.
    """
    rho = None if distance_pc is None else separation * distance_pc
    phase, given = planet.phase_deg, planet.distance_au
    # Exactly 0 at 180 degrees too.
    sine = None if phase is None else math.sin(math.radians(min(phase, 180.0 - phase)))
    if given is not None:
        if rho is not None:
            _agree(given, rho, phase, sine)
        return given
    if rho and sine:
        return rho / sine
    if not planet.reflects:
        return None
    if rho is None:
        raise required("distance_au", "the true distance from the star, or cstar.distance_pc")
    if rho == 0.0:
        raise required("distance_au", "the true distance where the separation is 0")
    raise required("distance_au", f"the true distance where phase_deg is {phase:g}")


def _agree(given: float, rho: float, phase: float | None, sine: float | None) -> None:
    slack = DISTANCE_TOLERANCE * given
    if rho > given + slack:
        allowed = f"at least the projected distance {rho:.6g} au = separation x cstar.distance_pc"
        raise InputError("distance_au", given, unit="au", allowed=allowed)
    if sine is not None and abs(given * sine - rho) > slack:
        raise InputError(
            "distance_au",
            given,
            unit="au",
            allowed=f"{f'{rho / sine:.6g} au, or none' if sine else 'none'}",
            hint=f"distance_au x sin(phase_deg = {phase:g}) is {given * sine:.6g} au, "
            f"separation x cstar.distance_pc is {rho:.6g} au",
        )
