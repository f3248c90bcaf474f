"""Draws of known planets: what published orbits and their errors leave open, at one date."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from catalogs import ORBIT, KnownPlanetTable, OrbitPlaces
from cpic_core import ArrayLike, FloatArray, InputError, IntArray, check_finite, stream
from cpic_planner.planets.allowed import catalogue_masses_msun
from cpic_planner.planets.known_rows import QUANTITIES, DrawnRows
from cpic_planner.planets.laws import chosen_entry
from cpic_planner.planets.population import OrbitingPlanets, Planets
from simulator.config import AlbedoSpec

_AT_ONCE = 100_000
"""Draws times dates whose places are held at a time."""


@dataclass(frozen=True, eq=False, kw_only=True)
class KnownDraws(OrbitingPlanets):
    """Draws of known planets, arrays of shape ``(n_rows, n_draws)``.

    Attributes
    ----------
    epoch_mjd : float
        Date of ``mean_anomaly_deg``.
    mass_mjup : ndarray
        True mass, nan where neither mass nor m sin i is known.
    period_days : ndarray
    """

    epoch_mjd: float
    mass_mjup: FloatArray
    period_days: FloatArray


@dataclass(frozen=True, eq=False)
class Ephemeris:
    """The places of one planet, arrays over the dates; quantiles are 16, 50 and 84 %, shape ``(3, n_dates)``.

    Attributes
    ----------
    mjd : ndarray
    separation_arcsec, distance_au, phase_deg : ndarray
        Projected separation, true distance, phase angle.
    pa_deg : ndarray or None
        Position angle east of north, continuous about its median (may leave 0 to 360); None without a known node.
    draws_arcsec : ndarray
        Separations of all draws, shape ``(n_draws, n_dates)``.
    """

    mjd: FloatArray
    separation_arcsec: FloatArray
    distance_au: FloatArray
    phase_deg: FloatArray
    pa_deg: FloatArray | None
    draws_arcsec: FloatArray

    def share_between(self, low_arcsec: float, high_arcsec: float) -> FloatArray:
        """Return the share of the draws whose separation lies between two edges, for each date.

        Parameters
        ----------
        low_arcsec : float
            Lower edge, arcsec.
        high_arcsec : float
            Upper edge, arcsec.
        """
        inside = (self.draws_arcsec >= low_arcsec) & (self.draws_arcsec <= high_arcsec)
        return np.asarray(inside.mean(axis=0))


def known_uniforms(table: KnownPlanetTable, rows: Sequence[int], n_draws: int, seed: int) -> FloatArray:
    """Return uniform numbers for `draw_known`, a stream for each planet and quantity: no other planet changes them.

    Parameters
    ----------
    table : KnownPlanetTable
    rows : sequence of int
        Rows of the table.
    n_draws : int
        Draws of each planet.
    seed : int
        Seed of all random streams.

    Returns
    -------
    ndarray
        Shape ``(n_rows, n_draws, len(QUANTITIES))``.
    """
    names = [table.text("planet")[row] for row in rows]
    drawn = [[stream(seed, "known", name, quantity).random(n_draws) for quantity in QUANTITIES] for name in names]
    return np.array(drawn).reshape(len(rows), len(QUANTITIES), n_draws).transpose(0, 2, 1)


def draw_known(
    table: KnownPlanetTable,
    rows: Sequence[int],
    uniforms: FloatArray,
    *,
    epoch_mjd: float,
    star_mass_msun: ArrayLike | None = None,
) -> KnownDraws:
    """Turn uniform numbers into planets that the published values and errors allow.

    Parameters
    ----------
    table : KnownPlanetTable
    rows : sequence of int
        ``n`` planets.
    uniforms : ndarray
        Numbers in [0, 1), shape ``(n, n_draws, len(QUANTITIES))``. The result is a pure function of them.
    epoch_mjd : float
        Date of the mean anomalies.
    star_mass_msun : array_like, optional
        Mass of each star, ``(n,)`` or one number, where the table has none: it joins period and axis. Without it those
        of the embedded catalogue are taken.

    Returns
    -------
    KnownDraws

    Raises
    ------
    InputError
        If the shape is wrong, or a period or axis that is missing cannot be had without the star's mass.

    Notes
    -----
    A value with an error is normal about it, cut at its physical limits (eccentricity 0 to 0.99); without an error it
    is taken as it is. Errors are taken as independent: for nearly circular orbits, where those of omega and the time of
    periastron cancel in the planet's place, this overstates the uncertainty.

    Without a period and a time (of an archive's planet: or the error of one of them) the mean anomaly is uniform.
    Otherwise ``M = 360 (t - T) / P`` with T and P drawn, so that the error of the phase grows by ``360 sigma_P / P``
    degrees a period. A time of inferior conjunction, where the planet's true anomaly is 90 deg - omega of the star, is
    preferred to one of periastron, unless only that has an error.

    The archive's omega is the star's; the planet's is 180 degrees more.

    Of a planet with several published orbits each draw has one, taken with its weight: the draws are a mixture, which
    is as wide as the publications disagree.

    Without an inclination the pole of the orbit is isotropic, ``p(i) ~ sin i``, which with m sin i alone is also the
    posterior if true masses are as common in every interval of the logarithm; orbits so nearly face-on that the true
    mass would pass 0.08 solar masses, a star's, are left out. A missing radius is that of the true mass (Chen & Kipping
    2017), with scatter. A missing axis follows from period and mass of the star by Kepler's third law, a missing period
    from axis and mass. An eccentricity that is an upper limit is uniform below it, an unknown one is drawn as those of
    the default population (long periods, Kipping 2013); a mass that is an upper limit is uniform below it.
    """
    index = np.asarray(rows, np.int64)
    given = np.asarray(uniforms, float)
    if given.ndim != 3 or given.shape[0] != len(index) or given.shape[2] != len(QUANTITIES):
        raise InputError("uniforms", given.shape, allowed=f"shape ({len(index)}, n_draws, {len(QUANTITIES)})")
    if given.size and not ((given >= 0.0) & (given <= 1.0)).all():
        raise InputError("uniforms", "outside", allowed="numbers from 0 to 1")
    epoch = float(check_finite("epoch_mjd", epoch_mjd, "d"))
    if star_mass_msun is None:
        stars = table.text("star")
        star_mass_msun = catalogue_masses_msun([stars[row] for row in index])
    masses = np.broadcast_to(np.asarray(star_mass_msun, float), index.shape)
    drawn = _drawn(table, index, given, epoch, masses)
    share = given[:, :, QUANTITIES.index("solution")]
    names = table.text("planet")
    for place, row in enumerate(index):
        orbits = table.solutions.get(names[row])
        if orbits is not None:
            several = len(orbits)
            each = np.broadcast_to(given[place], (several, *given.shape[1:]))
            found = _drawn(orbits, np.arange(several), each, epoch, np.full(several, masses[place]))
            chosen = chosen_entry(share[place], tuple(orbits.number("solution_weight").tolist()))
            for name, values in drawn.items():
                values[place] = found[name][chosen, np.arange(len(chosen))]
    return KnownDraws(epoch_mjd=epoch, **drawn)


def _drawn(
    table: KnownPlanetTable, index: IntArray, uniforms: FloatArray, epoch_mjd: float, masses: FloatArray
) -> dict[str, FloatArray]:
    """Return the draws of some rows of a table by the names of `KnownDraws`, each row one orbit."""
    made = DrawnRows(table, index, uniforms)
    star = made.normal("star_mass_msun", "star_mass_err_msun", "star_mass", fill=masses)
    inclination, mass = made.tilt_and_mass()
    axis, period = made.axis_and_period(star, mass)
    eccentricity, omega_star = made.eccentricity(), made.angle("omega_star_deg", "omega_err_deg", "omega")
    return {
        "radius_rjup": made.radius(mass),
        "mass_mjup": mass,
        "semi_major_axis_au": axis,
        "eccentricity": eccentricity,
        "inclination_deg": inclination,
        "argument_of_pericentre_deg": (omega_star + 180.0) % 360.0,
        "node_deg": made.angle("node_deg", "node_err_deg", "node"),
        "mean_anomaly_deg": made.mean_anomaly(epoch_mjd, period, eccentricity, omega_star),
        "period_days": period,
    }


def places_at(draws: KnownDraws, row: int, mjd: ArrayLike) -> OrbitPlaces:
    """Return the places of one planet's draws at some dates, arrays of shape ``(n_draws, n_dates)``.

    Parameters
    ----------
    draws : KnownDraws
    row : int
        Position of the planet among the draws.
    mjd : array_like
        Dates, Modified Julian Date (UTC).
    """
    days = check_finite("mjd", mjd, "d").reshape(1, -1) - draws.epoch_mjd
    one = OrbitingPlanets(**{name: getattr(draws, name)[row][:, None] for name in OrbitingPlanets.__dataclass_fields__})
    return one.places_after(days, draws.period_days[row][:, None])


def planets_of(draws: KnownDraws, row: int, albedo: AlbedoSpec) -> Planets:
    """Return the draws of one planet at their epoch, as a population of which there is one planet for a star.

    Parameters
    ----------
    draws : KnownDraws
    row : int
        Position of the planet among the draws.
    albedo : AlbedoSpec
    """
    places = places_at(draws, row, [draws.epoch_mjd])
    n = draws.radius_rjup.shape[1]
    return Planets(
        population="known planets",
        kind=np.zeros(n, np.int64),
        mass_mjup=draws.mass_mjup[row],
        radius_rjup=np.minimum(draws.radius_rjup[row], 10.0),
        **{name: getattr(draws, name)[row] for name in ORBIT},
        **{name: values[:, 0] for name, values in vars(places).items()},
        kind_names=("known planet",),
        albedos=(albedo,),
        semi_major_axis_scale="none",
        planets_per_star=1.0,
    )


def ephemeris(
    table: KnownPlanetTable,
    row: int,
    mjd: ArrayLike,
    *,
    n_draws: int,
    seed: int,
    distance_pc: float,
    star_mass_msun: float | None = None,
) -> Ephemeris:
    """Return the quantiles of separation, distance and phase of one planet at some dates.

    Parameters
    ----------
    table : KnownPlanetTable
    row : int
    mjd : array_like
        Dates, MJD; the light's way and the observer's around the Sun, minutes, are left out.
    n_draws, seed : int
    distance_pc : float
        Of the star.
    star_mass_msun : float, optional
        Where the table has none.

    Returns
    -------
    Ephemeris

    Examples
    --------
    >>> from catalogs.known_planets import load_known_planets
    >>> from cpic_planner.planets.known_draws import ephemeris
    >>> planets = load_known_planets()
    >>> row = planets.row_of("eps Eri b")
    >>> where = ephemeris(planets, row, [61771.0], n_draws=500, seed=1, distance_pc=3.216)
    >>> where.separation_arcsec.shape
    (3, 1)
    """
    dates = np.atleast_1d(check_finite("mjd", mjd, "d"))
    uniforms = known_uniforms(table, [row], n_draws, seed)
    drawn = draw_known(table, [row], uniforms, epoch_mjd=float(dates[0]), star_mass_msun=star_mass_msun)
    block = max(1, _AT_ONCE // n_draws)
    parts = [places_at(drawn, 0, dates[start : start + block]) for start in range(0, len(dates), block)]
    separation = np.concatenate([np.hypot(part.east_au, part.north_au) for part in parts], axis=1) / distance_pc
    names = ("distance_au", "phase_deg")
    middle = {name: np.concatenate([quantiles(getattr(part, name)) for part in parts], axis=1) for name in names}
    oriented = np.isfinite(table.orbits_of(row).number("node_deg")).all()
    return Ephemeris(
        mjd=dates,
        separation_arcsec=quantiles(separation),
        **middle,
        pa_deg=np.concatenate([_pa_deg(part) for part in parts], axis=1) if oriented else None,
        draws_arcsec=separation,
    )


def _pa_deg(places: OrbitPlaces) -> FloatArray:
    """Return the quantiles of the position angle, about its mean direction."""
    angle = np.arctan2(places.east_au, places.north_au)
    middle = np.angle(np.exp(1j * angle).mean(axis=0))
    turned = (angle - middle + np.pi) % (2.0 * np.pi) - np.pi
    return np.asarray(np.rad2deg(quantiles(turned) + middle))


def quantiles(draws: FloatArray) -> FloatArray:
    """Return 16, 50 and 84 % along the first axis."""
    return np.asarray(np.quantile(draws, (0.16, 0.5, 0.84), axis=0))
