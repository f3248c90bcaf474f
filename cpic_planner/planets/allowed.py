"""Planets that may still exist: not found by radial velocities, stable, and not beside a giant that is known."""

import functools
import hashlib
from collections.abc import Collection, Sequence
from dataclasses import fields
from typing import Self

import numpy as np

from catalogs import VELOCITY_AXES_AU, KnownPlanetTable, load_known_planets, stability_limit, velocity_limit
from cpic_core import ArrayLike, BoolArray, FloatArray, IntArray, Record
from cpic_planner.planets.masses import MJUP_IN_MSUN, catalogue_masses_msun, catalogue_name, least_mass
from cpic_planner.queries import EXCLUSIONS

GIANT_MJUP = 0.1
"""Least mass of a known giant, true or m sin i: the lower end of the giants of Fernandes et al. 2019, ApJ 874, 81."""
EXCLUDED_BELOW = 0.1
"""Chance of having escaped the velocities below which a planet is called excluded by them."""
_HILL_RADII = 2.0 * np.sqrt(3.0)
_UNKNOWN_MJUP = 1e6
_POLES = 64


class StarLimits(Record, eq=False):
    """The limits that are known of ``n`` stars; made by `of`.

    Attributes
    ----------
    log_m50, log_m90 : ndarray, shape (n, k)
        Logarithm of the m sin i, in M_Jup, that velocities find with 50 and 90 % of the ceiling, at each axis of
        `catalogs.VELOCITY_AXES_AU`.
    ceiling : ndarray, shape (n, k)
        Share of the heaviest planets that is found; 0 where nothing is known.
    reach_au : ndarray, shape (n,)
        Semi-major axis beyond which velocities exclude nothing; 0 for a star without velocities.
    stable_au, circumbinary_au : ndarray, shape (n,)
        Semi-major axes between which a companion star leaves no orbit stable; inf without one. Around a pair outside
        the range of the stability fit no orbit beyond the first counts as stable.
    giant_axis_au, giant_eccentricity, giant_mass_mjup : ndarray, shape (n, g)
        Known giants of each star; nan where it has fewer than ``g``.
    star_mass_msun : ndarray, shape (n,)
    """

    log_m50: FloatArray
    log_m90: FloatArray
    ceiling: FloatArray
    reach_au: FloatArray
    stable_au: FloatArray
    circumbinary_au: FloatArray
    giant_axis_au: FloatArray
    giant_eccentricity: FloatArray
    giant_mass_mjup: FloatArray
    star_mass_msun: FloatArray

    @classmethod
    def of(
        cls, names: Sequence[str], exclusions: Collection[str] = EXCLUSIONS, known: KnownPlanetTable | None = None
    ) -> Self:
        """Return what is known of stars.

        Parameters
        ----------
        names : sequence of str
            Any names of ``n`` stars; one that is in no table has no limits.
        exclusions : collection of str, optional
            Those of `cpic_planner.queries.EXCLUSIONS` that count; without any every planet is allowed.
        known : KnownPlanetTable, optional
            Where the known giants are; the shipped table by default.
        """
        own = [catalogue_name(name) or name for name in names]
        star_mass = np.nan_to_num(catalogue_masses_msun(names), nan=1.0)
        n, k = len(names), len(VELOCITY_AXES_AU)
        found = np.tile(np.array([_UNKNOWN_MJUP, 2.0 * _UNKNOWN_MJUP, 0.0])[:, None, None], (1, n, k))
        reach, (stable, around_both) = np.zeros(n), np.full((2, n), np.inf)
        for i, name in enumerate(own):
            velocities = velocity_limit(name) if "rv" in exclusions else None
            if velocities is not None:
                found[:, i] = velocities.m50_mjup, velocities.m90_mjup, velocities.ceiling
                reach[i] = velocities.reach_au
            pair = stability_limit(name) if "stability" in exclusions else None
            if pair is not None:
                stable[i] = pair.critical_au
                around_both[i] = pair.circumbinary_au if pair.within_fit else np.inf
        axis, eccentricity, mass = np.empty((3, n, 0))
        if "known_giants" in exclusions:
            axis, eccentricity, mass = _giants(names, star_mass, load_known_planets() if known is None else known)
        return cls(
            log_m50=np.log(found[0]),
            log_m90=np.log(found[1]),
            ceiling=found[2],
            reach_au=reach,
            stable_au=stable,
            circumbinary_au=around_both,
            giant_axis_au=axis,
            giant_eccentricity=eccentricity,
            giant_mass_mjup=mass,
            star_mass_msun=star_mass,
        )

    def allowed_probability(
        self, star: IntArray, semi_major_axis_au: ArrayLike, mass_mjup: ArrayLike, inclination_deg: ArrayLike
    ) -> FloatArray:
        """Return the probability that planets may still be there, 0 to 1; arguments broadcast.

        The product of three: the planet was not found by velocities, its orbit is stable beside the companion star, and
        it does not stand beside a known giant. It does not say how probable the planet was before.

        Parameters
        ----------
        star : ndarray of int
            Position of each planet's star among the names.
        semi_major_axis_au : array_like
            Above 0.
        mass_mjup : array_like
            True mass, above 0.
        inclination_deg : array_like
            Of this planet's orbit, 0 to 180.
        """
        axis = np.asarray(semi_major_axis_au, float)
        missed = self.missed_probability(star, axis, mass_mjup, inclination_deg)
        stable = (axis <= self.stable_au[star]) | (axis >= self.circumbinary_au[star])
        return np.asarray(missed * stable * ~self._beside_giant(star, axis, mass_mjup))

    def missed_probability(
        self, star: IntArray, semi_major_axis_au: ArrayLike, mass_mjup: ArrayLike, inclination_deg: ArrayLike
    ) -> FloatArray:
        """Return the probability that velocities would have missed planets; parameters as of `allowed_probability`.

        Notes
        -----
        ``1 - ceiling / (1 + (m50 / (m sin i))^s)`` with ``s = ln 9 / ln(m90 / m50)``; between two axes of the fits the
        logarithms of the limits and the ceiling are linear in the logarithm of the axis, within the first they are
        those of the first, and beyond the reach nothing is excluded. The fits are averages over eccentricities.
        """
        axis, mass, tilt = np.broadcast_arrays(
            *(np.asarray(value, float) for value in (semi_major_axis_au, mass_mjup, inclination_deg))
        )
        knots = np.log(VELOCITY_AXES_AU)
        place = np.log(axis)
        below = np.clip(np.searchsorted(knots, place, side="right") - 1, 0, len(knots) - 2)
        share = np.clip((place - knots[below]) / np.diff(knots)[below], 0.0, 1.0)

        def between(column: FloatArray) -> FloatArray:
            return np.asarray((1.0 - share) * column[star, below] + share * column[star, below + 1])

        middle = between(self.log_m50)
        with np.errstate(divide="ignore"):
            log_msini = np.log(mass * np.abs(np.sin(np.deg2rad(tilt))))
        steps = np.log(9.0) * (log_msini - middle) / (between(self.log_m90) - middle)
        found = between(self.ceiling) / (1.0 + np.exp(np.clip(-steps, -700.0, 700.0)))
        return np.asarray(1.0 - np.where(axis <= self.reach_au[star], found, 0.0))

    def excluded_by_velocities(self, star: IntArray, semi_major_axis_au: ArrayLike, mass_mjup: ArrayLike) -> BoolArray:
        """Tell which planets velocities exclude, whatever their orientation: the mean chance is below `EXCLUDED_BELOW`.

        Poles are isotropic: the mean is one over the cosine of the inclination, by Gauss-Legendre quadrature.
        """
        stars, axis, mass = np.broadcast_arrays(star, np.asarray(semi_major_axis_au), np.asarray(mass_mjup))
        tilt_deg, weight = _poles()
        missed = self.missed_probability(stars[..., None], axis[..., None], mass[..., None], tilt_deg)
        return np.asarray(missed @ weight < EXCLUDED_BELOW)

    def digest(self) -> str:
        """Return the hash of all that is known of these stars, for content hashes."""
        # Rounded to what tells limits apart: the last digits of a logarithm are the processor's.
        columns = (np.ascontiguousarray(getattr(self, item.name).round(6)) for item in fields(self))
        return hashlib.sha256(b"".join(column.tobytes() for column in columns)).hexdigest()

    def _beside_giant(self, star: IntArray, axis_au: FloatArray, mass_mjup: ArrayLike) -> BoolArray:
        """Return which planets would come nearer to a known giant than ``2 sqrt(3)`` mutual Hill radii.

        Gladman 1993, Icarus 106, 247: two planets on circular orbits never meet if their axes differ by more. The
        giant's eccentricity widens its place to that from pericentre to apocentre.
        """
        own, mass = np.asarray(axis_au)[..., None], np.asarray(mass_mjup, float)[..., None]
        axis, eccentricity, giant = (
            column[star] for column in (self.giant_axis_au, self.giant_eccentricity, self.giant_mass_mjup)
        )
        ratio = MJUP_IN_MSUN * (mass + giant) / (3.0 * self.star_mass_msun[star][..., None])
        margin = _HILL_RADII * np.cbrt(ratio) * 0.5 * (own + axis)
        near = (own + margin >= axis * (1.0 - eccentricity)) & (own - margin <= axis * (1.0 + eccentricity))
        return np.asarray(np.any(near, axis=-1))


@functools.cache
def _poles() -> tuple[FloatArray, FloatArray]:
    """Return inclinations (degrees), and weights that average over the cosine from 0 to 1."""
    node, weight = np.polynomial.legendre.leggauss(_POLES)
    return np.rad2deg(np.arccos(0.5 * (1.0 + node))), 0.5 * weight


def excluded_by_rv(names: Sequence[str], semi_major_axis_au: ArrayLike, radius_rjup: ArrayLike) -> BoolArray:
    """Tell around which stars velocities exclude a planet of a radius, whatever its orientation.

    Parameters
    ----------
    names : sequence of str
        ``n`` stars.
    semi_major_axis_au, radius_rjup : array_like
        One number, or shape ``(n,)``. The mass is the least that the radius allows
        (`cpic_planner.planets.masses.least_mass`).
    """
    limits, star = StarLimits.of(names, ("rv",)), np.arange(len(names))
    return limits.excluded_by_velocities(star, semi_major_axis_au, least_mass(radius_rjup))


def _giants(names: Sequence[str], star_mass_msun: FloatArray, known: KnownPlanetTable) -> FloatArray:
    """Return the axis, eccentricity and mass of the confirmed giants of each star, shape ``(3, n, g)``, nan for none.

    A true mass comes before m sin i, which makes the forbidden place narrower than it is; an unknown eccentricity is 0.
    """
    mass = np.where(np.isfinite(known.number("mass_mjup")), known.number("mass_mjup"), known.number("msini_mjup"))
    confirmed = np.array(known.text("status")) == "confirmed"
    axis, period = known.number("semi_major_axis_au"), known.number("period_days")
    eccentricity = np.nan_to_num(known.number("eccentricity"), nan=0.0)
    found = []
    for name, of_star in zip(names, star_mass_msun, strict=True):
        rows = [row for row in known.rows_of(name) if confirmed[row] and mass[row] >= GIANT_MJUP]
        by_period = [float(np.cbrt(of_star * (period[row] / 365.25) ** 2)) for row in rows]
        axes = [axis[row] if np.isfinite(axis[row]) else other for row, other in zip(rows, by_period, strict=True)]
        found.append([(a, eccentricity[row], mass[row]) for a, row in zip(axes, rows, strict=True)])
    giants = np.full((3, len(names), max(map(len, found), default=0)), np.nan)
    for i, planets in enumerate(found):
        for j, planet in enumerate(planets):
            giants[:, i, j] = planet
    return giants
