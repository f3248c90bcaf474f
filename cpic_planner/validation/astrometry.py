"""Position of a planet from a reduced image, with errors from the noise that is really there.

The model is the planet's image at any sub-pixel place as the subtraction leaves it (`RdiResult.project`), so that
over-subtraction moves nothing. Errors hold white noise, the planet's own photons, and residual speckles: these have the
size and shape of a planet, hence the same fit is made at many other places, and its scatter there says what they do.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpic_core import FloatArray, InputError, numeric_context
from cpic_planner.validation.apertures import require
from cpic_planner.validation.position_fit import PositionFitter
from cpic_planner.validation.reduced import ReducedStack
from simulator.imaging import AnyPsf
from simulator.target import detector_to_sky, sky_to_detector

# Below, the fit is not linear in the noise: errors are only indicative.
LINEAR_SNR = 5.0
# Least share of the planet's squared light in the region: for a fit at all, and without a flag.
LEAST_COVERAGE, WHOLE_COVERAGE = 0.5, 0.9
# From the fit's order (flux, x, y) to the answer's.
_ORDER = [1, 2, 0]


def chi2_p_value(chi2: float, degrees_of_freedom: int) -> float | None:
    """Return the chance of a chi2 at least this large if the model holds; None without degrees of freedom."""
    from scipy.special import gammaincc

    return float(gammaincc(0.5 * degrees_of_freedom, 0.5 * chi2)) if degrees_of_freedom else None


@dataclass(frozen=True, eq=False)
class SkyPosition:
    """Offset from the star on the sky.

    Attributes
    ----------
    east_arcsec, north_arcsec : float
        Offsets toward east and north.
    covariance_arcsec2 : ndarray, shape (2, 2)
        Of east and north.
    separation_arcsec, separation_error_arcsec : float
        Separation and its 1-sigma error.
    pa_deg, pa_error_deg : float
        Position angle, degrees east of north, and its 1-sigma error; 180 at most.
    chi2 : float
        Of the positions behind the mean about it; 0 for a single one.
    degrees_of_freedom : int
        Of that: twice the number of positions less one.
    """

    east_arcsec: float
    north_arcsec: float
    covariance_arcsec2: FloatArray
    separation_arcsec: float
    separation_error_arcsec: float
    pa_deg: float
    pa_error_deg: float
    chi2: float = 0.0
    degrees_of_freedom: int = 0

    @property
    def p_value(self) -> float | None:
        """Chance of a chi2 at least this large where the positions agree; None for a single one."""
        return chi2_p_value(self.chi2, self.degrees_of_freedom)


@dataclass(frozen=True, eq=False)
class Astrometry:
    """Position and flux of a planet on the detector and on the sky; made by `fit_position`.

    Attributes
    ----------
    x_arcsec, y_arcsec : float
        Detector offset from the star; x grows with the column, y with the row.
    x_error_arcsec, y_error_arcsec : float
        1-sigma errors.
    covariance : ndarray, shape (3, 3)
        Of x_arcsec, y_arcsec and flux_e.
    sky : SkyPosition
        The same place on the sky.
    flux_e, flux_error_e : float
        Electrons of the summed stack that the planet sends through the clear pupil, before apodizer, mask and
        subtraction: over star rate x integration time it is the contrast. As in any fit of a position, noise raises it
        by about 1/SNR^2; forced photometry does not have that.
    chi2 : float
        Sum of squared residuals over the variance of white noise and planet photons; speckles raise it. 0 where the
        stack has no white noise.
    degrees_of_freedom : int
        Fitted pixels less 3.
    noise_samples : float
        Independent places n behind the speckle part of the errors: where speckles dominate, an error is known to about
        1 / sqrt(2 n) of itself. It is widened by sqrt(n / (n - 2)), so that deviations over it have unit width.
    shift_arcsec : float
        Distance from the starting position.
    flags : tuple of str
        ``not_converged`` (or walked farther than 1 lambda/D: no position was found), ``low_snr`` (below 5: errors are
        only indicative), ``edge`` (over a tenth of the planet's squared light lies beyond the region or in an excluded
        source), ``whole_region`` (too few places at this separation).
    """

    x_arcsec: float
    y_arcsec: float
    x_error_arcsec: float
    y_error_arcsec: float
    covariance: FloatArray
    sky: SkyPosition
    flux_e: float
    flux_error_e: float
    chi2: float
    degrees_of_freedom: int
    noise_samples: float
    shift_arcsec: float
    flags: tuple[str, ...] = ()

    @property
    def separation_arcsec(self) -> float:
        """Separation from the star."""
        return self.sky.separation_arcsec

    @property
    def separation_error_arcsec(self) -> float:
        """1-sigma error of the separation."""
        return self.sky.separation_error_arcsec

    @property
    def pa_deg(self) -> float:
        """Position angle, degrees east of north, 0 to 360."""
        return self.sky.pa_deg

    @property
    def pa_error_deg(self) -> float:
        """1-sigma error of the position angle."""
        return self.sky.pa_error_deg

    @property
    def snr(self) -> float:
        """Flux over its error; infinite where the stack has no noise."""
        return self.flux_e / self.flux_error_e if self.flux_error_e > 0 else math.copysign(math.inf, self.flux_e)

    @property
    def converged(self) -> bool:
        """Whether a position was found."""
        return "not_converged" not in self.flags


@numeric_context()
def fit_position(
    stack: ReducedStack,
    psf: AnyPsf,
    x_arcsec: float,
    y_arcsec: float,
    *,
    roll_deg: float = 0.0,
    parity: int | None = None,
    window_lambda_d: float = 1.5,
    annulus_lambda_d: float = 2.0,
    exclude: Sequence[tuple[float, float]] = (),
) -> Astrometry:
    """Fit position and flux of a planet near a given place.

    Parameters
    ----------
    stack : ReducedStack
        Reduced image with its noise and forward model; the references hold no planet.
    psf : Psf or ExternalPsf
        Point-spread function of its band.
    x_arcsec, y_arcsec : float
        Where a blind search found the planet, off by 0.3 lambda/D or less; inside the region.
    roll_deg : float, optional
        Roll of the sky on the detector.
    parity : {-1, +1}, optional
        Orientation of the detector; that of the PSF's instrument if omitted.
    window_lambda_d : float, optional
        Radius of the pixels that are fitted, 0.8 to 4 lambda/D.
    annulus_lambda_d : float, optional
        Speckles are sampled at separations within this many lambda/D of the planet's, 0.5 or more.
    exclude : sequence of (x_arcsec, y_arcsec), optional
        Other known sources: pixels within 1.5 aperture radii of them are left out of everything.

    Returns
    -------
    Astrometry

    Raises
    ------
    InputError
        If a number is out of range, images and PSF do not fit, less than half of the planet's squared light would lie
        in the region, or nothing of the region is left to measure speckles on.

    Notes
    -----
    Gauss-Newton on position and flux with pixels weighted by the white variance. The unmasked PSF is shifted exactly
    by its Fourier phases (it is sampled finely enough, lambda/D over 2 px; pixels of the hole see no mask, 1e-6 px
    against the full optics). The fit is linear in the noise ``n``: ``d = A n``. Then
    ``Cov = A V A^T + A F^2 f t A^T + H^(1/2) S H^(1/2)``, the last term being that of the speckles. They are the beat
    of the static halo ``h`` with the drift of the wavefront, so their variance follows ``H = diag(A h A^T)``, and
    ``S = sum_i (d_i d_i^T - A_i V A_i^T) / sum_i (H_i H_i)^(1/2)`` is measured by the fit at other places i of the same
    separation, radial and tangential components apart, since speckles of a wide band are drawn out radially.
    """
    require("window_lambda_d", window_lambda_d, 0.8 <= window_lambda_d <= 4.0, "lambda/D", "0.8 to 4")
    require("annulus_lambda_d", annulus_lambda_d, annulus_lambda_d >= 0.5, "lambda/D", "at least 0.5")
    orientation = psf.instrument.detector.parity if parity is None else parity
    scale = psf.geometry.pixel_scale_arcsec
    reach = (len(stack.region) // 2) * scale
    for key, value in (("x_arcsec", x_arcsec), ("y_arcsec", y_arcsec)):
        require(key, value, abs(value) <= reach, "arcsec", f"{-reach:g} to {reach:g}")
    fitter = PositionFitter(stack, psf, window_lambda_d, annulus_lambda_d, exclude)
    start = np.array([x_arcsec, y_arcsec]) / scale
    if not fitter.coverage(start) >= LEAST_COVERAGE:
        allowed = "a place with half of the planet's squared light in the region"
        raise InputError("x_arcsec, y_arcsec", (x_arcsec, y_arcsec), unit="arcsec", allowed=allowed)
    fit = fitter.climb(start)
    speckles = fitter.speckles(fit)
    flux = fit.flux or math.inf
    units = np.array([scale / flux, scale / flux, 1.0])
    covariance = fitter.covariance(fit, speckles)[np.ix_(_ORDER, _ORDER)] * np.outer(units, units)
    errors = np.sqrt(np.diag(covariance))
    x, y = (float(part) for part in fit.place * scale)
    chi2, pixels = fitter.chi2(fit)
    flags = {
        "not_converged": not fit.converged,
        "low_snr": not fit.flux >= LINEAR_SNR * errors[2],
        "edge": fitter.coverage(fit.place) < WHOLE_COVERAGE,
        "whole_region": speckles.whole_region,
    }
    rotation = _to_sky(roll_deg, orientation)
    return Astrometry(
        x_arcsec=x,
        y_arcsec=y,
        x_error_arcsec=float(errors[0]),
        y_error_arcsec=float(errors[1]),
        covariance=covariance,
        sky=_described(rotation @ (x, y), rotation @ covariance[:2, :2] @ rotation.T, 0.0, 0),
        flux_e=fit.flux,
        flux_error_e=float(errors[2]),
        chi2=chi2,
        degrees_of_freedom=pixels - 3,
        noise_samples=speckles.samples,
        shift_arcsec=float(np.hypot(*(fit.place - start)) * scale),
        flags=tuple(flag for flag, there in flags.items() if there),
    )


@numeric_context()
def band_average(positions: Sequence[Astrometry]) -> SkyPosition:
    """Return the mean of the positions measured in several bands, weighted with their covariances.

    Parameters
    ----------
    positions : sequence of Astrometry
        At least one, of one planet at one epoch; rolls may differ, since the mean is taken on the sky. Fits that found
        no position are passed over.

    Returns
    -------
    SkyPosition
        With the chi2 of the positions about it: a large one says that they do not agree.

    Raises
    ------
    InputError
        If no fit found a position, or one has no error.
    """
    used = [one.sky for one in positions if one.converged]
    if not used:
        raise InputError("positions", len(positions), allowed="at least one fit that found a position")
    if any(not np.linalg.det(one.covariance_arcsec2) > 0 for one in used):
        raise InputError("positions", "without errors", allowed="positions with errors above 0")
    weights = np.array([np.linalg.inv(one.covariance_arcsec2) for one in used])
    places = np.array([[one.east_arcsec, one.north_arcsec] for one in used])
    covariance = np.linalg.inv(weights.sum(axis=0))
    mean = covariance @ np.einsum("pij,pj->i", weights, places)
    chi2 = float(np.einsum("pi,pij,pj->", places - mean, weights, places - mean))
    return _described(mean, covariance, chi2, 2 * (len(used) - 1))


def _to_sky(roll_deg: float, parity: int) -> FloatArray:
    """Return the matrix from detector offsets (x, y) to (east, north): the transpose of what `sky_to_detector` does."""
    x, y = sky_to_detector(np.ones(2), np.array([90.0, 0.0]), roll_deg=roll_deg, parity=parity)
    return np.column_stack([x, y])


def _described(offset: FloatArray, covariance: FloatArray, chi2: float, degrees_of_freedom: int) -> SkyPosition:
    """Return the separation and position angle of an offset (east, north); on the sky itself east is +x (parity +1)."""
    separation, pa = (float(part) for part in detector_to_sky(offset[0], offset[1], parity=1))
    radial = offset / separation if separation > 0 else np.array([0.0, 1.0])
    tangential = np.array([radial[1], -radial[0]])
    across = math.sqrt(max(float(tangential @ covariance @ tangential), 0.0))
    return SkyPosition(
        east_arcsec=float(offset[0]),
        north_arcsec=float(offset[1]),
        covariance_arcsec2=covariance,
        separation_arcsec=separation,
        separation_error_arcsec=math.sqrt(max(float(radial @ covariance @ radial), 0.0)),
        pa_deg=pa,
        pa_error_deg=min(math.degrees(across / separation), 180.0) if separation > 0 else 180.0,
        chi2=chi2,
        degrees_of_freedom=degrees_of_freedom,
    )
