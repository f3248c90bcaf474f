"""Planet-to-star contrast in reflected light, and the phase function of a Lambert sphere."""

import numpy as np

from cpic_core import ArrayLike, InputError, check_finite, real_array

# Below this angle sin d - d cos d loses digits; its Taylor series, with these terms, does not.
_SERIES_BELOW_RAD = 1.0
_SERIES_TERMS = 10


def lambert_phase(phase_deg: ArrayLike) -> np.ndarray | float:
    """Return the Lambert phase function, 1 at full phase, 1/pi at 90 deg, 0 at 180 deg.

    ``[sin a + (pi - a) cos a] / pi`` for phase angle a (Russell 1916; Eq. 1 of Zhu et al. 2025). It is
    computed from d = 180 deg - a, where it reads ``(sin d - d cos d) / pi``: the difference is exact in
    degrees, and a series replaces the cancelling terms near new phase, so that the relative error stays at
    rounding up to 180 deg.

    Parameters
    ----------
    phase_deg : array_like
        Phase angle, 0 to 180 degrees.

    Returns
    -------
    ndarray or float
        Same shape; a float for a scalar.

    Raises
    ------
    InputError
        If an angle is not within 0 to 180.
    """
    supplement = np.deg2rad(180.0 - checked_phase(phase_deg))
    small = supplement < _SERIES_BELOW_RAD
    plain = np.sin(supplement) - supplement * np.cos(supplement)
    result = np.where(small, _series(np.where(small, supplement, 0.0)), plain)
    return _plain(result / np.pi)


def sin_phase(phase_deg: ArrayLike) -> np.ndarray | float:
    """Return the sine of a phase angle, exactly 0 at both 0 and 180 degrees, to full relative precision.

    Raises
    ------
    InputError
        If an angle is not within 0 to 180.
    """
    phase = checked_phase(phase_deg)
    return _plain(np.sin(np.deg2rad(np.minimum(phase, 180.0 - phase))))


def checked_phase(phase_deg: ArrayLike) -> np.ndarray:
    """Return phase angles as float64; refuse what is not within 0 to 180 degrees."""
    phase = real_array("phase_deg", phase_deg, "deg")
    inside = (phase >= 0.0) & (phase <= 180.0)
    if not np.all(inside):
        raise InputError("phase_deg", float(phase[~inside].flat[0]), unit="deg", allowed="0 to 180")
    return phase


def _series(d: np.ndarray) -> np.ndarray:
    """Return sin d - d cos d = sum over k >= 1 of (-1)^(k+1) 2k d^(2k+1) / (2k+1)!."""
    square = d * d
    total = np.zeros_like(d)
    for k in range(_SERIES_TERMS, 0, -1):
        # Horner from the smallest term; ratio of coefficients k+1 to k is -1 / (2k (2k+3)).
        total = 1.0 - total * square / (2.0 * k * (2.0 * k + 3.0))
    result: np.ndarray = d * square * total / 3.0
    return result


#: Equatorial radius of Jupiter at 1 bar (IAU 2015 resolution B3 nominal value), km.
JUPITER_RADIUS_KM = 71492.0
#: Astronomical unit (IAU 2012, exact), km.
AU_KM = 149597870.7


def planet_contrast(
    radius_rjup: ArrayLike,
    separation_ra_au: ArrayLike,
    separation_dec_au: ArrayLike,
    phase_deg: ArrayLike,
    geometric_albedo: ArrayLike,
) -> np.ndarray | float:
    """Return the contrast of a planet seen at a projected offset (Eq. 1 of Zhu et al. 2025).

    ``A_g (R/r)^2 Phi(a)`` with the Lambert phase function and the true distance ``r = rho / sin a`` of a
    planet at projected distance rho and phase angle a. With rho > 0 the contrast goes to 0 at both 0 and
    180 degrees (there the planet would have to be infinitely far), and 0.0 is returned; its maximum is near
    63 degrees. All arguments may carry units (`astropy.units`).

    Parameters
    ----------
    radius_rjup : array_like
        Planet radius, R_J = 71 492 km.
    separation_ra_au, separation_dec_au : array_like
        Projected offset from the star along right ascension (true angle, not coordinate) and declination, AU.
    phase_deg : array_like
        Phase angle, 0 to 180 degrees.
    geometric_albedo : array_like
        Geometric albedo; use the photon-weighted band mean for a band contrast.

    Returns
    -------
    ndarray or float
        Flux ratio, broadcast shape; a float for scalars.

    Raises
    ------
    InputError
        If a value is out of range, or the offset is zero: then the true distance is not fixed by it, use
        `contrast_at`.
    """
    east = check_finite("separation_ra_au", separation_ra_au, "AU")
    north = check_finite("separation_dec_au", separation_dec_au, "AU")
    radius, albedo = _not_negative(radius_rjup, geometric_albedo)
    phase = checked_phase(phase_deg)
    _one_shape(
        radius_rjup=radius, separation_ra_au=east, separation_dec_au=north, phase_deg=phase, geometric_albedo=albedo
    )
    with np.errstate(over="ignore"):
        rho_au = np.hypot(east, north)
    if np.any(rho_au == 0.0):
        raise InputError("separation", 0.0, unit="AU", allowed="above 0", hint="give the true distance to contrast_at")
    return _ratio(albedo, radius * sin_phase(phase), rho_au, lambert_phase(phase))


def contrast_at(
    radius_rjup: ArrayLike,
    distance_au: ArrayLike,
    phase_deg: ArrayLike,
    geometric_albedo: ArrayLike,
    *,
    phase_value: ArrayLike | None = None,
) -> np.ndarray | float:
    """Return the contrast ``A_g (R/r)^2 Phi(a)`` of a planet at true distance r from its star.

    Parameters
    ----------
    radius_rjup : array_like
        Planet radius, R_J = 71 492 km.
    distance_au : array_like
        True distance from the star, AU, above 0.
    phase_deg : array_like
        Phase angle, 0 to 180 degrees.
    geometric_albedo : array_like
        Geometric albedo.
    phase_value : array_like, optional
        Phi, where it is not Lambert's of `phase_deg`.

    Returns
    -------
    ndarray or float
        Flux ratio, broadcast shape; a float for scalars.

    Raises
    ------
    InputError
        If a value is out of range.
    """
    distance = check_finite("distance_au", distance_au, "AU")
    if np.any(distance <= 0.0):
        raise InputError("distance_au", float(distance.min()), unit="AU", allowed="above 0")
    radius, albedo = _not_negative(radius_rjup, geometric_albedo)
    phi = np.asarray(lambert_phase(phase_deg)) if phase_value is None else check_finite("phase_value", phase_value)
    _one_shape(radius_rjup=radius, distance_au=distance, phase=phi, geometric_albedo=albedo)
    return _ratio(albedo, radius, distance, phi)


def _ratio(albedo: np.ndarray, radius_rjup: np.ndarray, distance_au: np.ndarray, phi: ArrayLike) -> np.ndarray | float:
    """Return ``A_g (R/r)^2 Phi``; refuse what no double holds."""
    with np.errstate(over="ignore", invalid="ignore"):
        size = radius_rjup * (JUPITER_RADIUS_KM / AU_KM) / distance_au
        ratio = albedo * size * size * np.asarray(phi)
    if not np.all(np.isfinite(ratio)):
        hint = "a radius or albedo is too large, or a distance too small"
        raise InputError("contrast", float(ratio[~np.isfinite(ratio)].flat[0]), allowed="a finite ratio", hint=hint)
    return _plain(ratio)


def _not_negative(radius_rjup: ArrayLike, geometric_albedo: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    radius = check_finite("radius_rjup", radius_rjup, "R_Jup")
    albedo = check_finite("geometric_albedo", geometric_albedo)
    for name, array, unit in (("radius_rjup", radius, "R_Jup"), ("geometric_albedo", albedo, "")):
        if np.any(array < 0.0):
            raise InputError(name, float(array.min()), unit=unit, allowed="at least 0")
    return radius, albedo


def _one_shape(**arrays: np.ndarray) -> None:
    try:
        np.broadcast_shapes(*(array.shape for array in arrays.values()))
    except ValueError:
        shown = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise InputError("shapes", shown, allowed="shapes that broadcast") from None


def _plain(value: np.ndarray | float) -> np.ndarray | float:
    return float(value) if np.ndim(value) == 0 else value
