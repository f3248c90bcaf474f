"""Covariance of the elements of published orbits: what is known of a planet before it is imaged."""

from dataclasses import dataclass

import numpy as np

from catalogs import KnownPlanetTable
from cpic_core import FloatArray
from cpic_planner.planets.known_draws import draw_known, known_uniforms
from cpic_planner.planets.orbit_errors import STAR_MASS_ERROR, regular_elements
from cpic_planner.planets.population import OrbitingPlanets

_DRAWS, _SEED = 2000, 0
_ANY_ANGLE = np.pi / np.sqrt(3.0)
_UNSAID = (1.05, 0.33, _ANY_ANGLE, 0.44, _ANY_ANGLE, _ANY_ANGLE)
"""Widths of what has no error: as wide as if nothing were published (`cpic_planner.planets.orbit_quality`)."""
_LEAST = 1e-4
"""Least error of an element: no position asks for less, and matrices stay regular."""


@dataclass(frozen=True, eq=False)
class PublishedOrbit:
    """Second moments of a published orbit. Made by `published_orbit`.

    Attributes
    ----------
    spread : ndarray, shape (6, 6)
        Covariance of ``ln P`` (``ln a`` with ``of_axis``), ``e``, the planet's ``omega``, ``tan(i/2)`` on the sky where
        the orbit is prograde, ``Omega``, and ``M + omega`` at the epoch; angles in radians.
    of_axis : bool
        Whether the axis is known better than by the period and the mass of the star.
    """

    spread: FloatArray
    of_axis: bool

    def period_error(self, star_mass_error: float = STAR_MASS_ERROR) -> float:
        """Return the relative error of the period.

        Parameters
        ----------
        star_mass_error : float, optional
            Relative error of the mass of the star, above 0.
        """
        first = float(self.spread[0, 0])
        return float(np.sqrt(2.25 * first + 0.25 * star_mass_error**2 if self.of_axis else first))

    def covariance(
        self, planets: OrbitingPlanets, period_days: FloatArray, star_mass_error: float = STAR_MASS_ERROR
    ) -> FloatArray:
        """Return the covariance of the regular elements of true orbits at their epoch, shape (n, 7, 7).

        Parameters
        ----------
        planets : OrbitingPlanets
            ``n`` orbits that the planet may be on.
        period_days : ndarray, shape (n,)
            Above 0.
        star_mass_error : float, optional
            Relative error of the mass of the star, above 0.

        Notes
        -----
        The moments are carried to the regular elements (`cpic_planner.planets.orbit_errors`) by their derivatives at
        the true orbit. Where it is a circle, or seen from its pole, directions of pericentre and node are lost in them:
        errors of ``e`` and ``tan(i/2)`` therefore hold across their directions as well as along them.
        """
        elements = regular_elements(planets, period_days, np.zeros(len(period_days)))
        _, h, k, p, q, _, _ = elements.T
        turned, node, e, t = np.arctan2(h, k), np.arctan2(p, q), np.hypot(h, k), np.hypot(p, q)
        sign = np.where(planets.inclination_deg > 90.0, -1.0, 1.0)
        # Columns: the six of ``spread``, ln M, and what e and tan(i/2) have across their directions.
        slopes = np.zeros((len(e), 7, 9))
        slopes[:, 0, 0], slopes[:, 0, 6] = (1.0, 0.0) if self.of_axis else (2.0 / 3.0, 1.0 / 3.0)
        # Along and across the direction of pericentre, which omega and the node turn, and along and across the node.
        for row, size, angle, along, across in ((1, e, turned, 1, 7), (3, t, node, 3, 8)):
            radial, tangential = np.stack([np.sin(angle), np.cos(angle)]), np.stack([np.cos(angle), -np.sin(angle)])
            slopes[:, row : row + 2, along], slopes[:, row : row + 2, across] = radial.T, tangential.T
            slopes[:, row : row + 2, 4] = (size * tangential * sign).T
        slopes[:, 1:3, 2] = slopes[:, 1:3, 4] * sign[:, None]
        slopes[:, 5, 5], slopes[:, 5, 4], slopes[:, 6, 6] = 1.0, sign, 1.0
        whole = np.zeros((9, 9))
        whole[:6, :6] = self.spread
        whole[range(6, 9), range(6, 9)] = star_mass_error**2, self.spread[1, 1], self.spread[3, 3]
        return np.asarray(slopes @ whole @ slopes.transpose(0, 2, 1) + _LEAST**2 * np.eye(7))


def published_orbit(
    table: KnownPlanetTable, row: int, *, epoch_mjd: float, star_mass_msun: float | None = None
) -> PublishedOrbit:
    """Return what is published of the orbit of a known planet, as moments.

    Parameters
    ----------
    table : KnownPlanetTable
    row : int
    epoch_mjd : float
        When the place on the orbit is told.
    star_mass_msun : float, optional
        Where the table has none.

    Notes
    -----
    The moments are those of draws of `cpic_planner.planets.draw_known`, so that truth and what is said of it have one
    law: several published orbits, limits, and poles that point anywhere count with their whole width, as if it were
    that of a normal law. Angles deviate from their mean direction, by 104 deg (rms) where nothing is known. What is
    published without an error is drawn as it stands, but counts here as if it were not known. Of period and axis the
    better known one counts: the other is as a rule derived from it with the mass of the star.
    """
    uniforms = known_uniforms(table, [row], _DRAWS, _SEED)
    drawn = draw_known(table, [row], uniforms, epoch_mjd=epoch_mjd, star_mass_msun=star_mass_msun)
    omega, node, anomaly, tilt = (
        np.deg2rad(part[0])
        for part in (drawn.argument_of_pericentre_deg, drawn.node_deg, drawn.mean_anomaly_deg, drawn.inclination_deg)
    )
    axis, period = np.log(drawn.semi_major_axis_au[0]), np.log(drawn.period_days[0])
    # One that follows from the other, or has no error, says nothing of its own.
    errors = [
        item.std() if np.isfinite(table.number(name)[row]) and np.ptp(item) > 0.0 else np.inf
        for name, item in (("semi_major_axis_au", axis), ("period_days", period))
    ]
    of_axis = bool(1.5 * errors[0] < errors[1])
    values = np.stack(
        [
            _about_mean(axis if of_axis else period),
            _about_mean(drawn.eccentricity[0]),
            _turned(omega),
            _about_mean(np.tan(0.5 * np.minimum(tilt, np.pi - tilt))),
            _turned(node),
            _turned(anomaly + omega),
        ]
    )
    spread = np.cov(values)
    told = np.ptp(values, axis=1) > 0.0
    spread[~told, ~told] = np.square(_UNSAID)[~told]
    return PublishedOrbit(spread, of_axis)


def _about_mean(values: FloatArray) -> FloatArray:
    """Return the deviations from the mean; exactly 0 where all values are the same."""
    return values - values.mean() if np.ptp(values) > 0.0 else np.zeros_like(values)


def _turned(angle: FloatArray) -> FloatArray:
    """Return the deviations from the mean direction, between -pi and pi; exactly 0 where all are the same."""
    if not np.ptp(angle) > 0.0:
        return np.zeros_like(angle)
    middle = np.angle(np.exp(1j * angle).mean())
    return np.asarray((angle - middle + np.pi) % (2.0 * np.pi) - np.pi)
