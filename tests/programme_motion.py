"""The motion of planets within a programme in all its parts, from the laws that `OrbitSearch` makes its factor of."""

from dataclasses import dataclass

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, special
from cpic_planner.planets import OrbitSearch, span_days
from cpic_planner.planets.motion import MOST_SHIFT_LAMBDA_D, ORBIT_DUTY, _bent, aperture_track


def smeared(shift_lambda_d: ArrayLike) -> FloatArray:
    """Return the part of a planet's light in its aperture while it goes along a straight line, over that at rest."""
    track, half = aperture_track(), np.maximum(np.asarray(shift_lambda_d) / 2.0, 1e-6)
    return np.minimum(np.interp(half, track.offset, track.along) / half, 1.0)


@dataclass(frozen=True, eq=False)
class ProgrammeMotion:
    """Motion of a planet that nobody knows within a programme; arrays of one shape.

    Attributes
    ----------
    span_days : ndarray
        From the begin of the first visit to the end of the last.
    shift_lambda_d : ndarray
        Most that a planet on a circular orbit of that radius goes in this time: on an orbit seen from its pole.
    planet_moves : ndarray of bool
        Whether that is more than 0.3 lambda/D.
    kept_at_rest : ndarray
        Part of the signal that a stack keeps that does not follow the planet (`smeared`).
    n_orbits : ndarray
        Velocities that the search goes through, one where all are near enough to rest.
    trials : ndarray
        Number by which false alarms are more than in a search at rest, at the threshold ``sigma``.
    kept : ndarray
        Least part of the signal that the searched orbit next to the planet's own keeps.
    sigma : ndarray
        Gaussian significance with the false alarms of the one asked for, once every trial has its own.
    longest_span_days : ndarray
        Time in which a circular orbit bends from its best straight line by 0.3 lambda/D.
    straight : ndarray of bool
        Whether the span is not longer: beyond it a search over velocities loses ever more of the planet.
    """

    span_days: FloatArray
    shift_lambda_d: FloatArray
    planet_moves: BoolArray
    kept_at_rest: FloatArray
    n_orbits: FloatArray
    trials: FloatArray
    kept: FloatArray
    sigma: FloatArray
    longest_span_days: FloatArray
    straight: BoolArray


def motion_of(search: OrbitSearch, visits: ArrayLike, visit_time_s: ArrayLike) -> ProgrammeMotion:
    """Return everything about the motion within programmes."""
    span, longest = search.span_days(visits, visit_time_s), np.sqrt(16.0 * MOST_SHIFT_LAMBDA_D / search.bend)
    shift = search.speed * span
    level = search._level(np.asarray(visits, float), span, search.speed)
    kept = smeared(np.minimum(shift, 2.0 * MOST_SHIFT_LAMBDA_D)) * _bent(search.bend * span**2 / 16.0)
    values = np.broadcast_arrays(
        span,
        shift,
        shift > MOST_SHIFT_LAMBDA_D,
        smeared(shift),
        search.n_orbits(visits, visit_time_s),
        special().ndtr(-search.sigma) / special().ndtr(-level),
        kept,
        level,
        longest,
        span <= longest,
    )
    return ProgrammeMotion(*values)


def programme_motion(
    separation_arcsec,
    distance_pc,
    star_mass_msun,
    lambda_d_arcsec,
    time_s,
    visits=1.0,
    *,
    gap_h=0.0,
    duty=ORBIT_DUTY,
    sigma=5.0,
) -> ProgrammeMotion:
    """Return everything about the motion within programmes of a time, all visits together."""
    span_days(time_s, visits, gap_h, duty)
    search = OrbitSearch.of(
        separation_arcsec, distance_pc, star_mass_msun, lambda_d_arcsec, gap_h=gap_h, duty=duty, sigma=sigma
    )
    return motion_of(search, visits, np.asarray(time_s, float) / np.asarray(visits, float))
