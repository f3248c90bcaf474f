"""Errors of orbits from astrometry that is still to be taken: of their elements and of places to come.

Elements are those that stay regular for circles and for orbits seen from their pole (Broucke & Cefola 1972, Celest.
Mech. 5, 303): ``ln a``, ``h = e sin W``, ``k = e cos W`` with the longitude of pericentre ``W = omega + Omega``, ``p =
tan(i/2) sin Omega``, ``q = tan(i/2) cos Omega``, the mean longitude in the middle of the arc, and ``ln M`` of the star,
which with the axis makes the period. Retrograde orbits are described on a mirrored sky, where they are prograde.
"""

from dataclasses import dataclass, replace

import numpy as np

from catalogs import orbit_places
from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, IntArray, check_finite
from cpic_planner.planets.motion import aperture_track, in_range
from cpic_planner.planets.population import OrbitingPlanets

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


@dataclass(frozen=True, eq=False)
class OrbitQuality:
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


@dataclass(frozen=True, eq=False)
class OrbitInformation:
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
