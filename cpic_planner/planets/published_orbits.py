"""Orbits of known planets: draws at a date, covariance of published elements, and what further astrometry would add.

Errors are those of elements that stay regular for circles and for orbits seen from their pole (Broucke & Cefola 1972,
Celest. Mech. 5, 303): ``ln a``, ``h = e sin W``, ``k = e cos W`` with the longitude of pericentre ``W = omega +
Omega``, ``p = tan(i/2) sin Omega``, ``q = tan(i/2) cos Omega``, the mean longitude in the middle of the arc, and ``ln
M`` of the star, which with the axis makes the period. Retrograde orbits are described on a mirrored sky,
where they are prograde.
"""

import functools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from catalogs import ORBIT, KnownPlanetTable, OrbitPlaces, orbit_places
from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, IntArray, Record, check_finite, special, stream
from cpic_planner.planets.masses import MJUP_IN_MSUN, STAR_MJUP, catalogue_masses_msun, radius_from_mass
from cpic_planner.planets.motion import aperture_track, in_range
from cpic_planner.planets.population import Isotropic, Law, OrbitingPlanets, Planets, chosen_entry, load_population
from simulator.config import AlbedoSpec

_OF_COLUMNS = ("period", "epoch", "eccentricity", "omega", "semi_major_axis", "mass", "inclination", "node")
QUANTITIES = (*_OF_COLUMNS, "mean_anomaly", "radius", "star_mass", "solution")
"""What is drawn of one known planet, in the order of the last axis of the uniforms; ``solution`` is which orbit."""

ECCENTRICITY_HIGH = 0.99
_MJD_ZERO_JD = 2400000.5
_GAUSSIAN_YEAR_DAYS = 365.2568983
"""Period at 1 au around one solar mass."""
_LEAST_SHARE = 1e-3
"""Least share of its published value that a drawn length, mass or period has."""


@functools.cache
def _usual_eccentricity() -> Law:
    """Return the law of eccentricities of the default population."""
    law = load_population().mixture[0].eccentricity
    assert law is not None
    return law


class DrawnRows:
    """Columns of some rows with the uniform numbers of their draws."""

    def __init__(self, table: KnownPlanetTable, index: IntArray, uniforms: FloatArray) -> None:
        self.table, self.index, self.uniforms = table, index, uniforms
        self.flags = [table.flags(int(row)) for row in index]

    def column(self, name: str) -> FloatArray:
        """Return the column of the rows, shape ``(n_rows, 1)``."""
        return self.table.number(name)[self.index][:, None]

    def share(self, quantity: str) -> FloatArray:
        """Return the uniform numbers of a quantity, shape ``(n_rows, n_draws)``, as of all that follows."""
        return self.uniforms[:, :, QUANTITIES.index(quantity)]

    def flagged(self, flag: str) -> BoolArray:
        """Return which rows have a flag, shape ``(n_rows, 1)``."""
        return np.array([flag in flags for flags in self.flags], bool)[:, None]

    def normal(
        self,
        name: str,
        error_name: str,
        quantity: str,
        *,
        low: float | None = None,
        high: float = np.inf,
        fill: FloatArray | None = None,
    ) -> FloatArray:
        """Return a normal about a column with its error, cut; above a thousandth of the value if ``low`` is not given.

        Parameters
        ----------
        name : str
            Column of the value.
        error_name : str
            Column of its error.
        quantity : str
            Name of the uniform numbers to use.
        low : float, optional
            Lower physical limit.
        high : float, optional
            Upper physical limit.
        fill : ndarray, optional
            Values where the table has none.
        """
        value = self.column(name)
        if fill is not None:
            value = np.where(np.isfinite(value), value, fill[:, None])
        error = np.nan_to_num(self.column(error_name), nan=0.0)
        least = _LEAST_SHARE * value if low is None else np.full(value.shape, low)
        return truncated_normal(self.share(quantity), value, error, least, np.full(value.shape, high))

    def angle(self, name: str, error_name: str, quantity: str) -> FloatArray:
        """Return a normal about an angle, uniform where it is unknown; degrees.

        Parameters
        ----------
        name : str
            Column of the angle, degrees.
        error_name : str
            Column of its error, degrees.
        quantity : str
            Name of the uniform numbers to use.
        """
        known = self.normal(name, error_name, quantity, low=-np.inf)
        return np.where(np.isfinite(known), known, 360.0 * self.share(quantity)) % 360.0

    def eccentricity(self) -> FloatArray:
        """Return the eccentricity: about its value, below its limit, or of planets of long periods."""
        share, value = self.share("eccentricity"), self.column("eccentricity")
        drawn = self.normal("eccentricity", "eccentricity_err", "eccentricity", low=0.0, high=ECCENTRICITY_HIGH)
        drawn = np.where(self.flagged("eccentricity_upper_limit"), share * np.minimum(value, ECCENTRICITY_HIGH), drawn)
        unknown = ~np.isfinite(value[:, 0])
        drawn[unknown] = _usual_eccentricity().quantile(share[unknown])
        return drawn

    def tilt_and_mass(self) -> tuple[FloatArray, FloatArray]:
        """Return the inclination and true mass, which m sin i joins."""
        true = self.normal("mass_mjup", "mass_err_mjup", "mass")
        limit = self.flagged("mass_upper_limit")
        true = np.where(limit, np.maximum(self.share("mass"), _LEAST_SHARE) * self.column("mass_mjup"), true)
        minimum = self.normal("msini_mjup", "msini_err_mjup", "mass")
        alone = np.isfinite(minimum) & ~np.isfinite(true)
        share = self.share("inclination")
        # Of both hemispheres, the poles whose planet would be a star are left out.
        least_sine = np.where(alone, np.minimum(minimum / STAR_MJUP, 1.0), 0.0)
        any_tilt = np.rad2deg(np.arccos(np.sqrt(1.0 - least_sine**2) * np.cos(np.deg2rad(Isotropic().quantile(share)))))
        known = self.normal("inclination_deg", "inclination_err_deg", "inclination", low=0.0, high=180.0)
        tilt = np.where(np.isfinite(known), known, any_tilt)
        sine = np.maximum(np.sin(np.deg2rad(tilt)), 1e-9)
        return tilt, np.where(alone, np.minimum(minimum / sine, np.maximum(STAR_MJUP, minimum)), true)

    def axis_and_period(self, star_msun: FloatArray, mass_mjup: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the semi-major axis and period; what is missing follows from Kepler's third law.

        Parameters
        ----------
        star_msun : ndarray
            Mass of the star, solar masses, shape (n, n_draws).
        mass_mjup : ndarray
            Mass of the planet, Jupiter masses, shape (n, n_draws).
        """
        axis = self.normal("semi_major_axis_au", "semi_major_axis_err_au", "semi_major_axis")
        period = self.normal("period_days", "period_err_days", "period")
        total = star_msun + MJUP_IN_MSUN * np.nan_to_num(mass_mjup, nan=0.0)
        no_axis, no_period = ~np.isfinite(axis), ~np.isfinite(period)
        lost = (no_axis | no_period) & ~np.isfinite(total)
        if lost.any():
            name = self.table.text("planet")[int(self.index[np.flatnonzero(lost.any(axis=1))[0]])]
            allowed = "a mass: it joins period and semi-major axis"
            raise InputError(f"{name} star_mass_msun", "missing", unit="M_Sun", allowed=allowed)
        from_period = np.cbrt(total * (period / _GAUSSIAN_YEAR_DAYS) ** 2)
        from_axis = _GAUSSIAN_YEAR_DAYS * np.sqrt(axis**3 / total)
        return np.where(no_axis, from_period, axis), np.where(no_period, from_axis, period)

    def mean_anomaly(
        self, epoch_mjd: float, period_days: FloatArray, eccentricity: FloatArray, omega_star_deg: FloatArray
    ) -> FloatArray:
        """Return the mean anomaly at the epoch, degrees.

        Parameters
        ----------
        epoch_mjd : float
            Date of the anomaly, MJD.
        period_days : ndarray
            Period, days, shape (n, n_draws).
        eccentricity : ndarray
            0 to 0.99, shape (n, n_draws).
        omega_star_deg : ndarray
            Argument of pericentre of the star's orbit, degrees, shape (n, n_draws).
        """
        passage = self.normal("periastron_jd", "periastron_err_days", "epoch")
        conjunction = self.normal("conjunction_jd", "conjunction_err_days", "epoch")
        told = [np.isfinite(self.column(f"{what}_err_days")) for what in ("periastron", "conjunction")]
        better = np.isfinite(self.column("periastron_jd")) & told[0] & ~told[1]  # of two the one with an error
        meets = np.isfinite(self.column("conjunction_jd")) & ~better
        true = np.deg2rad(90.0 - omega_star_deg)
        sine, cosine = np.sin(true / 2), np.cos(true / 2)
        half = np.arctan2(np.sqrt(1.0 - eccentricity) * sine, np.sqrt(1.0 + eccentricity) * cosine)
        at_conjunction = 2.0 * half - eccentricity * np.sin(2.0 * half)
        start = np.where(meets, conjunction, passage) - _MJD_ZERO_JD
        angle = 360.0 * (epoch_mjd - start) / period_days + np.where(meets, np.rad2deg(at_conjunction), 0.0)
        return np.where(self.flagged("phase_unknown"), 360.0 * self.share("mean_anomaly"), angle) % 360.0

    def radius(self, mass_mjup: FloatArray) -> FloatArray:
        """Return the radius: about its value, or that of the true mass with scatter."""
        known = self.normal("radius_rjup", "radius_err_rjup", "radius")
        deviate = special().ndtri(np.clip(self.share("radius"), 1e-12, 1.0 - 1e-12))
        other = radius_from_mass(np.where(np.isfinite(mass_mjup), mass_mjup, 1.0), deviate)
        return np.where(np.isfinite(known), known, other)


def truncated_normal(
    share: FloatArray, mean: FloatArray, sd: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    """Return the quantiles of normal laws cut at both ends; the mean where ``sd`` is 0; arrays broadcast.

    Parameters
    ----------
    share : ndarray
        Uniform numbers in [0, 1), turned into values by the law.
    mean : ndarray
        Mean before the limits.
    sd : ndarray
        Standard deviation before the limits, 0 for an exact value.
    low : ndarray
        Lower limit.
    high : ndarray
        Upper limit.
    """
    width = np.where(sd > 0.0, sd, 1.0)
    first, last = special().ndtr((low - mean) / width), special().ndtr((high - mean) / width)
    with np.errstate(invalid="ignore"):
        drawn = mean + width * special().ndtri(np.clip(first + share * (last - first), 1e-15, 1.0 - 1e-15))
        drawn = np.clip(drawn, low, high)
    return np.where(sd > 0.0, drawn, np.broadcast_to(mean, drawn.shape))


FLOOR_MAS = 5.0
"""Error of a position on each axis that no light removes: the star's place behind the mask, and the plate scale.
Assumed: a tenth of lambda/D in F520."""
STAR_MASS_ERROR = 0.064
"""Relative error of a star's mass: the scatter of 0.027 in ``log M`` about the relation of Torres, Andersen & Gimenez
2010 (A&ARv 18, 67), which takes temperature, gravity and metallicity."""
_YEAR_DAYS = 365.25
_STEP = 1e-5
_MOST_ECCENTRICITY = 0.99
_WIDTHS = (0.7, 0.23, 0.23, 0.44, 0.44, np.pi / np.sqrt(3.0))


class OrbitQuality(Record, eq=False):
    """The 1-sigma errors of orbits after some epochs; arrays of one length. Made by `orbit_quality`.

    Attributes
    ----------
    epochs : ndarray of int
        Number of positions.
    arc_periods : ndarray
        From the first position to the last, in periods of the planet.
    axis_error, period_error : ndarray
        Relative errors of semi-major axis and period.
    eccentricity_error : ndarray
        Error of the eccentricity.
    inclination_error_deg : ndarray
        Error of the inclination.
    place_error_arcsec : ndarray
        At the later date that was asked for: root mean square of the distance between planet and predicted place.
    covariance : ndarray, shape (n, 7, 7)
        Of the regular elements (see the module), of which the errors follow.
    """

    epochs: IntArray
    arc_periods: FloatArray
    axis_error: FloatArray
    period_error: FloatArray
    eccentricity_error: FloatArray
    inclination_error_deg: FloatArray
    place_error_arcsec: FloatArray
    covariance: FloatArray


def astrometric_error_arcsec(
    snr: ArrayLike, lambda_d_arcsec: ArrayLike, floor_mas: ArrayLike = FLOOR_MAS
) -> FloatArray:
    """Return the error of a planet's position on each axis, arcsec.

    Parameters
    ----------
    snr : array_like
        Photometric SNR in the aperture, above 0.
    lambda_d_arcsec : array_like
        lambda/D of the band, above 0.
    floor_mas : array_like, optional
        Error that no light removes, mas, at least 0; added in quadrature.

    Raises
    ------
    InputError
        If a number is out of range.

    Notes
    -----
    A fit of an image ``g`` to white noise has flux and position errors ``sigma_F = s / |g|`` and ``sigma_x = s / (F
    |dg/dx|)`` (King 1983, PASP 95, 163), so that ``sigma_x = 1 / (SNR sqrt(c))`` with ``c = |dg/dx|^2 / |g|^2``, the
    roughness of noise that is filtered with the image (`cpic_planner.planets.motion.aperture_track`): 0.89 lambda/D
    over the SNR behind the shipped apodizer. It is cautious: a fit has a larger SNR than an aperture, and the noise of
    speckles, which have the size of the image, moves it less than white noise does.

    Examples
    --------
    >>> from cpic_planner.planets import astrometric_error_arcsec
    >>> round(1e3 * float(astrometric_error_arcsec(10.0, 0.0536)), 1)
    6.9
    """
    (width,) = in_range(lambda_d_arcsec=lambda_d_arcsec)
    light, floor = check_finite("snr", snr), check_finite("floor_mas", floor_mas, "mas")
    for key, value, unit, bad, allowed in (
        ("snr", light, "", light <= 0.0, "above 0"),
        ("floor_mas", floor, "mas", floor < 0.0, "at least 0"),
    ):
        if np.any(bad):
            raise InputError(key, float(value[bad].flat[0]), unit=unit, allowed=allowed)
    return np.asarray(np.hypot(width / (light * np.sqrt(aperture_track().roughness)), 1e-3 * floor))


class OrbitInformation(Record, eq=False):
    """Fisher matrices of orbits, which add with further positions; made by `orbit_information`.

    Attributes
    ----------
    elements : ndarray, shape (n, 7)
        Regular elements (see the module) with the mean longitude of ``day``.
    day : ndarray, shape (n,)
        Middle of the arc, after the epoch of the orbits.
    distance_pc : ndarray, shape (n,)
    matrix : ndarray, shape (n, 7, 7)
        Fisher information of the elements.
    """

    elements: FloatArray
    day: FloatArray
    distance_pc: FloatArray
    matrix: FloatArray

    def slopes(self, days: FloatArray) -> FloatArray:
        """Return derivatives of east and north by the elements on days after the epoch, (n, t), arcsec: (n, 2, t, 7).

        Parameters
        ----------
        days : ndarray, shape (n, t)
        """
        return _slopes(self.elements, days - self.day[:, None]) / self.distance_pc[:, None, None, None]


def orbit_information(
    planets: OrbitingPlanets,
    period_days: FloatArray,
    distance_pc: ArrayLike,
    days: FloatArray,
    error_arcsec: FloatArray,
    *,
    star_mass_error: float = STAR_MASS_ERROR,
    published: FloatArray | None = None,
) -> OrbitInformation:
    """Return what astrometry at some epochs, and what was known before, say of orbits.

    Parameters
    ----------
    planets, period_days, distance_pc, days, error_arcsec, star_mass_error, published
        As of `orbit_quality`.

    Raises
    ------
    InputError
        If a number is out of range.
    """
    (distance,) = in_range(distance_pc=distance_pc)
    for key, value, unit in (("period_days", period_days, "d"), ("error_arcsec", error_arcsec, "arcsec")):
        if np.any(bad := ~(value > 0.0)):
            raise InputError(key, float(value[bad].flat[0]), unit=unit, allowed="above 0")
    if not star_mass_error > 0.0:
        raise InputError("star_mass_error", star_mass_error, allowed="above 0")
    weight = error_arcsec**-2.0
    used = weight > 0.0
    middle = 0.5 * np.sum(_ends(days, used), axis=0)
    elements = regular_elements(planets, period_days, middle)
    prior = np.broadcast_to(np.diag(np.array([*_WIDTHS, star_mass_error]) ** -2.0), (len(middle), 7, 7)).copy()
    if published is not None:
        told = np.isfinite(published).all(axis=(1, 2))
        prior[told] = np.linalg.inv(_moved(published[told], period_days[told], middle[told]))
    nothing = OrbitInformation(elements, middle, np.broadcast_to(distance, middle.shape), prior)
    slopes = nothing.slopes(np.where(used, days, middle[:, None]))
    return replace(nothing, matrix=prior + np.einsum("nctj,nt,nctk->njk", slopes, weight, slopes))


def orbit_quality(
    planets: OrbitingPlanets,
    period_days: FloatArray,
    distance_pc: ArrayLike,
    days: FloatArray,
    error_arcsec: FloatArray,
    later_day: FloatArray,
    *,
    star_mass_error: float = STAR_MASS_ERROR,
    published: FloatArray | None = None,
) -> OrbitQuality:
    """Return how well astrometry at some epochs determines orbits.

    Parameters
    ----------
    planets : OrbitingPlanets
        ``n`` planets on their true orbits.
    period_days : ndarray, shape (n,)
        Above 0.
    distance_pc : array_like
        Of their stars, above 0; taken as exact.
    days : ndarray, shape (n, t)
        Epochs after that of the orbits.
    error_arcsec : ndarray, shape (n, t)
        Error of the position on each axis, above 0; inf where there is none at that epoch.
    later_day : ndarray, shape (n,)
        When the planet is to be found again.
    star_mass_error : float, optional
        Relative error of the mass of the star, above 0.
    published : ndarray, shape (n, 7, 7), optional
        Covariance of the regular elements at the epoch of the orbits of planets that were known before
        (`cpic_planner.planets.published_orbits`); nan for the others.

    Returns
    -------
    OrbitQuality

    Raises
    ------
    InputError
        If a number is out of range.

    Notes
    -----
    The covariance is ``(J^T W J + P)^-1`` with ``J`` the derivatives of the positions by the elements, ``W`` one over
    the squared errors, and ``P`` what is known without astrometry: that of the published orbit, or the mass of the star
    and a wide normal law of the others, so that two epochs, four numbers for seven elements, have errors too. Its
    widths are those of the shipped giant planets: a factor of 2 in the axis, an rms eccentricity of 0.33 (Kipping 2013,
    MNRAS 434, L51), poles that point anywhere, and any place on the orbit. It is the least covariance of a fit (Cramer
    & Rao), reached where positions are linear in the elements over their errors. Fits of simulated campaigns (the long
    proof beside the tests of this module: 3 stars, 200 campaigns a row) say where. Four or six epochs over 0.4 periods
    or more: 68 % of the errors of every element lie within 0.8 to 1.15 of these; of four epochs about one orbit in a
    hundred is off by five of them, where a rounder orbit fits as well. The place in the next window: within 0.9 to 1.1
    of it after three epochs over 0.1 to 0.4 periods, and up to a fifth better known than said here after two, or over a
    shorter arc.
    Which of several periods is right, where a planet may have gone round between epochs, is not in it.
    """
    known = orbit_information(
        planets, period_days, distance_pc, days, error_arcsec, star_mass_error=star_mass_error, published=published
    )
    used = error_arcsec < np.inf
    first, last = _ends(days, used)
    covariance = np.asarray(np.linalg.inv(known.matrix), np.float64)
    _, h, k, p, q, _, _ = known.elements.T
    tangent = np.hypot(p, q)
    ahead = known.slopes(later_day[:, None])[:, :, 0]
    return OrbitQuality(
        epochs=np.count_nonzero(used, axis=1),
        arc_periods=(last - first) / period_days,
        axis_error=np.sqrt(covariance[:, 0, 0]),
        period_error=_along(covariance, (0, 6), 1.5, -0.5),
        eccentricity_error=_along(covariance, (1, 2), *_unit(h, k)),
        inclination_error_deg=np.rad2deg(_along(covariance, (3, 4), *_unit(p, q)) * 2.0 / (1.0 + tangent**2)),
        place_error_arcsec=np.sqrt(np.einsum("ncj,njk,nck->n", ahead, covariance, ahead)),
        covariance=covariance,
    )


def _ends(days: FloatArray, used: BoolArray) -> FloatArray:
    """Return the first and last of the epochs that are used, 0 where none is, shape (2, n)."""
    first = np.where(used, days, np.inf).min(axis=1, initial=np.inf)
    last = np.where(used, days, -np.inf).max(axis=1, initial=-np.inf)
    return np.where(used.any(axis=1), [first, last], 0.0)


def _moved(covariance: FloatArray, period_days: FloatArray, days: FloatArray) -> FloatArray:
    """Return the covariance of the elements with the mean longitude some days later, ``ln P = 1.5 ln a - 0.5 ln M``."""
    turned = 2.0 * np.pi * days / period_days
    moves = np.broadcast_to(np.eye(7), covariance.shape).copy()
    moves[:, 5, 0], moves[:, 5, 6] = -1.5 * turned, 0.5 * turned
    return np.asarray(moves @ covariance @ moves.transpose(0, 2, 1))


def regular_elements(planets: OrbitingPlanets, period_days: FloatArray, day: FloatArray) -> FloatArray:
    """Return the regular elements of orbits (see the module) with the mean longitude of some days, shape (n, 7).

    Parameters
    ----------
    planets : OrbitingPlanets
    period_days : ndarray, shape (n,)
    day : ndarray, shape (n,)
        After the epoch of the orbits.
    """
    retrograde = planets.inclination_deg > 90.0
    tilt, node, omega, anomaly = (
        np.deg2rad(part)
        for part in (
            np.where(retrograde, 180.0 - planets.inclination_deg, planets.inclination_deg),
            np.where(retrograde, -planets.node_deg, planets.node_deg),
            planets.argument_of_pericentre_deg,
            planets.mean_anomaly_deg + 360.0 * day / period_days,
        )
    )
    e, pericentre, tangent = planets.eccentricity, omega + node, np.tan(0.5 * tilt)
    log_axis = np.log(planets.semi_major_axis_au)
    log_mass = 3.0 * log_axis - 2.0 * np.log(period_days / _YEAR_DAYS)
    shape = e * np.sin(pericentre), e * np.cos(pericentre), tangent * np.sin(node), tangent * np.cos(node)
    return np.stack([log_axis, *shape, anomaly + pericentre, log_mass], axis=1)


def places_of(elements: FloatArray, days: FloatArray) -> FloatArray:
    """Return offsets to (mirrored) east and north of prograde orbits, au, shape (..., 2, t).

    Parameters
    ----------
    elements : ndarray, shape (..., 7)
        Regular elements.
    days : ndarray, shape (..., t)
        After the day of their mean longitude.
    """
    log_axis, h, k, p, q, longitude, log_mass = np.moveaxis(elements[..., None], -2, 0)
    pericentre, node = np.arctan2(h, k), np.arctan2(p, q)
    period = _YEAR_DAYS * np.exp(1.5 * log_axis - 0.5 * log_mass)
    tilt, omega, turned, anomaly = (
        np.rad2deg(part) for part in (2.0 * np.arctan(np.hypot(p, q)), pericentre - node, node, longitude - pericentre)
    )
    e = np.minimum(np.hypot(h, k), _MOST_ECCENTRICITY)
    places = orbit_places(np.exp(log_axis), e, tilt, omega, turned, anomaly + 360.0 * days / period)
    return np.stack([places.east_au, places.north_au], axis=-2)


def _slopes(elements: FloatArray, days: FloatArray) -> FloatArray:
    """Return the derivatives of `places_of` by the elements, (n, 2, t, 7), by central differences, to some 1e-9."""
    steps = _STEP * np.eye(elements.shape[1])
    return np.stack(
        [(places_of(elements + step, days) - places_of(elements - step, days)) / (2.0 * _STEP) for step in steps],
        axis=-1,
    )


def _unit(one: FloatArray, other: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the unit vector along (one, other); the diagonal where both are 0 and any will do."""
    angle = np.where((one == 0.0) & (other == 0.0), 0.25 * np.pi, np.arctan2(other, one))
    return np.cos(angle), np.sin(angle)


def _along(covariance: FloatArray, at: tuple[int, int], one: ArrayLike, other: ArrayLike) -> FloatArray:
    """Return the error of ``one x + other y`` of the two elements ``at``."""
    i, j = at
    a, b = np.asarray(one), np.asarray(other)
    var = a * a * covariance[:, i, i] + 2.0 * a * b * covariance[:, i, j] + b * b * covariance[:, j, j]
    return np.asarray(np.sqrt(np.maximum(var, 0.0)))


_AT_ONCE = 100_000
"""Draws times dates whose places are held at a time."""


class KnownDraws(OrbitingPlanets, eq=False, kw_only=True):
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


class Ephemeris(Record, eq=False):
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
    table: KnownPlanetTable, row: int, mjd: ArrayLike, *, n_draws: int, seed: int, distance_pc: float
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

    Returns
    -------
    Ephemeris

    Examples
    --------
    >>> from catalogs.known_planets import load_known_planets
    >>> from cpic_planner.planets.published_orbits import ephemeris
    >>> planets = load_known_planets()
    >>> row = planets.row_of("eps Eri b")
    >>> where = ephemeris(planets, row, [61771.0], n_draws=500, seed=1, distance_pc=3.216)
    >>> where.separation_arcsec.shape
    (3, 1)
    """
    dates = np.atleast_1d(check_finite("mjd", mjd, "d"))
    uniforms = known_uniforms(table, [row], n_draws, seed)
    drawn = draw_known(table, [row], uniforms, epoch_mjd=float(dates[0]))
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


_DRAWS, _SEED = 2000, 0
_ANY_ANGLE = np.pi / np.sqrt(3.0)
_UNSAID = (1.05, 0.33, _ANY_ANGLE, 0.44, _ANY_ANGLE, _ANY_ANGLE)
"""Widths of what has no error: as wide as if nothing were published (`cpic_planner.planets.orbit_quality`)."""
_LEAST = 1e-4
"""Least error of an element: no position asks for less, and matrices stay regular."""


class PublishedOrbit(Record, eq=False):
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
        The moments are carried to the regular elements (see the module) by their derivatives at the true orbit. Where
        it is a circle, or seen from its pole, directions of pericentre and node are lost in them: errors of ``e`` and
        ``tan(i/2)`` therefore hold across their directions as well as along them.
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
