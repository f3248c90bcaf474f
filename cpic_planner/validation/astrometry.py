"""Position of a planet from a reduced image, with errors from the noise that is really there.

The model is the planet's image at any sub-pixel place as the subtraction leaves it (`RdiResult.project`), so that
over-subtraction moves nothing. Errors hold white noise, the planet's own photons, and residual speckles: these have the
size and shape of a planet, hence the same fit is made at many other places, and its scatter there says what they do.

Fits are in pixels from the star. Parameters are flux, flux x shift in x and flux x shift in y: in these the model is
linear.
"""

import functools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from cpic_core import BoolArray, FloatArray, InputError, NDArray, Record, numeric_context, require
from cpic_planner.validation.rdi import ReducedStack
from simulator.imaging import AnyPsf
from simulator.target import detector_to_sky, sky_to_detector

# Radius of the pixels that are fitted, and half width of the annulus in which speckles are sampled.
WINDOW_LAMBDA_D, ANNULUS_LAMBDA_D = 1.5, 2.0
MAX_ITERATIONS = 25
STILL_PIXELS = 1e-3
# Noise bends the model's peak so that full steps may swing about it: steps that turn back are shortened.
TURNED_BACK = 0.6
# Longest step of the search, and a walk farther than which it has left the candidate it was given.
MAX_STEP_LAMBDA_D = 0.35
MAX_WALK_LAMBDA_D = 1.0
# Other sources, and the planet itself, are kept this many aperture radii away from what measures the noise.
EXCLUSION_RADII = 1.5
# Bright rings of another source end here: no fit for the noise reaches into them.
RING_LAMBDA_D = 2.0
# Least share of a planet's squared light that a place, cut by the edge of the region, must show to be a sample.
SAMPLE_COVERAGE = 0.7
# Places with less star light than this share of the mean have the speckles of that light.
LEAST_HALO = 0.05
# Fewer independent samples than this in the annulus, and the whole region is taken.
LEAST_SAMPLES = 20.0
LEAST_DEGREES = 4.0


class PositionFit(Record, eq=False):
    """The end of a search for a position.

    Attributes
    ----------
    place : ndarray, shape (2,)
        x and y, pixels from the star.
    flux : float
        Electrons on the clear pupil.
    converged : bool
        Whether the search came to rest within 1 lambda/D of its start.
    window : ndarray of bool, shape (n, n)
        Fitted pixels.
    design : ndarray, shape (3, k)
        Forward model of unit flux and its derivatives in these pixels.
    inverse : ndarray, shape (3, 3)
        Inverse of the information matrix.
    planet : ndarray, shape (n, n)
        Unit planet before the subtraction.
    model : ndarray, shape (n, n)
        Unit planet after the subtraction and the level.
    """

    place: FloatArray
    flux: float
    converged: bool
    window: BoolArray
    design: FloatArray
    inverse: FloatArray
    planet: FloatArray
    model: FloatArray


class SpeckleScatter(Record, eq=False):
    """Second moments of fits without a planet, in excess of white noise and over the local halo.

    Attributes
    ----------
    scaled : ndarray, shape (3, 3)
        Of flux, radial and tangential shift; positive semi-definite, and widened by n / (n - 2) for n samples.
    samples : float
        Independent places behind it.
    whole_region : bool
        Whether the annulus was too small.
    """

    scaled: FloatArray
    samples: float
    whole_region: bool


class PositionFitter:
    """One reduced image, made ready for fits; lengths are given in lambda/D, sources to exclude as (x, y) in arcsec.

    Parameters
    ----------
    stack : ReducedStack
    psf : Psf or ExternalPsf
    exclude : sequence of tuple of float
        Pixels that are left out.

    Raises
    ------
    InputError
        If nothing is left of the region, or its noise is not finite and positive (or 0 everywhere).

    Attributes
    ----------
    stack : ReducedStack
    psf : Psf or ExternalPsf
    usable : ndarray of bool, shape (n, n)
        Region without other known sources.
    weights : ndarray, shape (n, n)
        Inverse white variance; 0 beyond ``usable``, and 1 inside where the stack has no white noise.
    halo : ndarray, shape (n, n)
        What the variance of speckles follows: the static light, at least a share of its mean.
    others : ndarray, shape (k, 2)
        Other known sources, pixels from the star.
    window_pixel, annulus_pixel, lambda_d_pixel : float
        Radius of the fitted disc, half width of the annulus, and lambda/D.
    quiet : bool
        Whether the stack has no white noise.
    """

    def __init__(self, stack: ReducedStack, psf: AnyPsf, exclude: Sequence[tuple[float, float]]) -> None:
        scale = psf.geometry.pixel_scale_arcsec
        self.stack, self.psf, self.lambda_d_pixel = stack, psf, psf.geometry.lambda_d_arcsec / scale
        self.window_pixel = WINDOW_LAMBDA_D * self.lambda_d_pixel
        self.annulus_pixel = ANNULUS_LAMBDA_D * self.lambda_d_pixel
        self._excluded_pixel = EXCLUSION_RADII * psf.geometry.aperture_radius_arcsec / scale
        self.others = np.array(exclude, dtype=np.float64).reshape(-1, 2) / scale
        if not np.isfinite(self.others).all():
            raise InputError("exclude", exclude, unit="arcsec", allowed="finite pairs (x, y)")
        self.usable = usable = stack.region.copy()
        for place in self.others:
            usable &= ~_disc(usable.shape, place, self._excluded_pixel)
        if not usable.any():
            raise InputError("region", "empty", unit="px", allowed="some pixels away from the excluded sources")
        variance = stack.white_variance_e2[usable]
        self.quiet = bool((variance == 0).all())
        if not self.quiet and not (np.isfinite(variance) & (variance > 0)).all():
            raise InputError("white_variance_e2", float(variance.min()), unit="e-^2", allowed="above 0 in the region")
        self.weights, self.halo = np.zeros(usable.shape), np.zeros(usable.shape)
        self.weights[usable] = 1.0 if self.quiet else 1.0 / variance
        light = np.maximum(stack.halo_e[usable], 0.0)
        self.halo[usable] = np.maximum(light, LEAST_HALO * light.mean()) if light.any() else 1.0

    @functools.cached_property
    def _spectrum(self) -> tuple[NDArray[np.complex128], FloatArray, FloatArray]:
        """Fourier transform of the unmasked PSF, and the frequencies of rows and columns, radians a pixel."""
        from scipy.fft import next_fast_len

        size = next_fast_len(len(self.psf.off_axis), real=True)
        cycles = np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)
        rows, columns = (2 * np.pi * np.asarray(part, dtype=np.float64) for part in cycles)
        return np.fft.rfft2(self.psf.off_axis, s=(size, size)), rows, columns

    def shifted(self, shift: FloatArray) -> FloatArray:
        """Return the PSF's stamp moved by a fraction of a pixel (x, y), and its derivatives; shape (3, m, m)."""
        spectrum, rows, columns = self._spectrum
        moved = spectrum * np.exp(-1j * (rows * shift[1] + columns * shift[0]))
        parts = np.stack([moved, -1j * columns * moved, -1j * rows * moved])
        side, size = len(self.psf.off_axis), len(rows)
        return np.fft.irfft2(parts, s=(size, size))[:, :side, :side]

    def images(self, place: FloatArray) -> FloatArray:
        """Return the unit planet before the subtraction and its derivatives, shape (3, n, n)."""
        whole = np.rint(place).astype(int)
        stamps = self.shifted(place - whole)
        n, side = len(self.usable), stamps.shape[-1]
        result = np.zeros((3, n, n))
        cuts = []
        for step in (whole[1], whole[0]):
            first = n // 2 + int(step) - side // 2
            low, high = max(first, 0), min(first + side, n)
            cuts.append((slice(low, high), slice(low - first, high - first)))
        (rows, from_rows), (columns, from_columns) = cuts
        result[:, rows, columns] = stamps[:, from_rows, from_columns]
        return result

    def coverage(self, place: FloatArray) -> float:
        """Return the share of a planet's squared light within the window that lies on usable pixels."""
        stamp = self.images(place)[0] ** 2 * _disc(self.usable.shape, place, self.window_pixel)
        return float(stamp[self.usable].sum() / stamp.sum())

    def climb(self, start: FloatArray) -> PositionFit:
        """Fit by Gauss-Newton from a starting place; the window is laid around the start, then around what it finds."""
        background = self._background(start)
        image = self._levelled(self.stack.image_e, background)
        place = start
        for _ in range(2):
            fit = self._search(image, background, start, place)
            place = fit.place
            if not fit.converged:
                break
        return fit

    def _search(self, image: FloatArray, background: BoolArray, start: FloatArray, centre: FloatArray) -> PositionFit:
        place, converged = centre, False
        window = self.usable & _disc(self.usable.shape, centre, self.window_pixel)
        weights = self.weights[window]
        longest, farthest = MAX_STEP_LAMBDA_D * self.lambda_d_pixel, MAX_WALK_LAMBDA_D * self.lambda_d_pixel
        last = np.zeros(2)
        for _ in range(MAX_ITERATIONS):
            raw = self.images(place)
            models = self._levelled(self.stack.rdi.project(raw), background)
            design = models[:, window]
            inverse = np.asarray(np.linalg.inv((design * weights) @ design.T), dtype=np.float64)
            theta = inverse @ (design * weights) @ image[window]
            flux = float(theta[0])
            step = theta[1:] / flux if flux > 0 else np.full(2, np.inf)
            size = float(np.hypot(*step))
            if flux <= 0 or np.hypot(*(place - start)) > farthest:
                break
            converged = size < STILL_PIXELS
            last = step * min(TURNED_BACK if step @ last < 0 else 1.0, longest / max(size, longest))
            place = place + last
            if converged:
                break
        near = bool(np.hypot(*(place - start)) <= farthest)
        return PositionFit(place, flux, converged and near, window, design, inverse, raw[0], models[0])

    def speckles(self, fit: PositionFit) -> SpeckleScatter:
        """Return what the same fit finds at other places of this separation, beyond white noise.

        Raises
        ------
        InputError
            If the region has no other place for a fit.
        """
        residual = self._levelled(self.stack.image_e, self._background(fit.place)) - fit.flux * fit.model
        n = len(self.usable)
        pitch = max(1, round(0.5 * self.lambda_d_pixel))
        rows, columns = np.nonzero(self.usable)
        y, x = rows - n // 2, columns - n // 2
        clear = np.hypot(x - fit.place[0], y - fit.place[1]) > self.window_pixel
        for other in self.others:
            clear &= np.hypot(x - other[0], y - other[1]) > self.window_pixel + RING_LAMBDA_D * self.lambda_d_pixel
        grid = clear & (x % pitch == 0) & (y % pitch == 0)
        near = np.abs(np.hypot(x, y) - np.hypot(*fit.place)) <= self.annulus_pixel
        for whole_region, chosen in ((False, grid & near), (True, grid)):
            moments = self._fits(residual, fit.place, y[chosen], x[chosen])
            if moments is None:
                continue
            theta, white, halo = moments
            size = np.sqrt(np.einsum("pkk->pk", halo))
            samples = float(size[:, 0].sum() ** 2 / (size[:, 0] ** 2).sum()) * (pitch / self.lambda_d_pixel) ** 2
            if samples >= LEAST_SAMPLES or whole_region:
                excess = np.einsum("pk,pl->kl", theta, theta) - white.sum(axis=0)
                scaled = excess / np.einsum("pk,pl->kl", size, size)
                values, vectors = np.linalg.eigh(scaled)
                # Deviations over an error known from n samples scatter as Student's t does.
                student = max(samples, LEAST_DEGREES) / (max(samples, LEAST_DEGREES) - 2.0)
                scaled = student * (vectors * np.maximum(values, 0.0)) @ vectors.T
                return SpeckleScatter(scaled, samples, whole_region)
        raise InputError("region", "too small", unit="px", allowed="room for the fit at other places than the planet's")

    def _fits(
        self, residual: FloatArray, place: FloatArray, y: NDArray[np.intp], x: NDArray[np.intp]
    ) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """Return the fits at whole-pixel distances from a place: parameters, white covariance, halo form, radial first.

        The kernel is the unprojected planet; what the projection takes of it (modes over pixels of the region) is a
        per cent.
        """
        shift = place - np.rint(place)
        kernel = self.shifted(shift)
        half, middle = math.ceil(self.window_pixel) + 1, kernel.shape[-1] // 2
        cut = slice(middle - half, middle + half + 1)
        offset = np.arange(-half, half + 1)
        disc = np.hypot(offset[:, None] - shift[1], offset - shift[0]) <= self.window_pixel
        design = kernel[:, cut, cut][:, disc]
        products = (design[:, None] * design).reshape(9, -1).T

        def around(image: FloatArray) -> FloatArray:
            padded = np.pad(image, half)
            views = np.lib.stride_tricks.sliding_window_view(padded, disc.shape)
            return np.asarray(views[y + len(image) // 2, x + len(image) // 2][:, disc])

        held = around(self.usable.astype(float)) @ design[0] ** 2 >= SAMPLE_COVERAGE * float(design[0] @ design[0])
        if not held.any():
            return None
        y, x = y[held], x[held]
        weights = around(self.weights)
        inverse = np.linalg.inv((weights @ products).reshape(-1, 3, 3))
        theta = np.einsum("pkl,pl->pk", inverse, around(self.weights * residual) @ design.T)
        forms = (around(self.weights**2 * self.halo) @ products).reshape(-1, 3, 3)
        turn = _to_radial(x + shift[0], y + shift[1])
        back = turn.swapaxes(1, 2)
        white = np.zeros_like(inverse) if self.quiet else turn @ inverse @ back
        return np.einsum("pkl,pl->pk", turn, theta), white, turn @ (inverse @ forms @ inverse) @ back

    def covariance(self, fit: PositionFit, speckles: SpeckleScatter) -> FloatArray:
        """Return the covariance of flux, flux x shift in x and in y: white noise, the planet's photons and speckles."""
        estimator = fit.inverse @ (fit.design * self.weights[fit.window])
        pixels = (estimator * self._variance(fit)) @ estimator.T
        turn = _to_radial(fit.place[:1], fit.place[1:])[0]
        form = turn @ ((estimator * self.halo[fit.window]) @ estimator.T) @ turn.T
        size = np.sqrt(np.diag(form))
        return np.asarray(pixels + turn.T @ (speckles.scaled * np.outer(size, size)) @ turn)

    def chi2(self, fit: PositionFit) -> tuple[float, int]:
        """Return the squared residuals over white variance and planet photons (0 without white noise), and pixels."""
        pixels = int(fit.window.sum())
        if self.quiet:
            return 0.0, pixels
        image = self._levelled(self.stack.image_e, self._background(fit.place))[fit.window]
        residual = image - fit.flux * fit.model[fit.window]
        return float(np.sum(residual**2 / self._variance(fit))), pixels

    def _variance(self, fit: PositionFit) -> FloatArray:
        """Return white noise and the planet's photons in the fitted pixels; 0 where the stack has no white noise."""
        factor2 = 0.0 if self.quiet else self.stack.factor2
        own = np.maximum(fit.flux * fit.planet[fit.window], 0.0)
        return np.asarray(self.stack.white_variance_e2[fit.window] + factor2 * own)

    def _background(self, place: FloatArray) -> BoolArray:
        """Return the pixels of the annulus away from the planet; of the whole region where there are none."""
        shape, separation, star = self.usable.shape, float(np.hypot(*place)), np.zeros(2)
        away = self.usable & ~_disc(shape, place, self._excluded_pixel)
        annulus = away & _disc(shape, star, separation + self.annulus_pixel)
        annulus &= ~_disc(shape, star, max(separation - self.annulus_pixel, 0.0))
        return annulus if annulus.any() else away

    def _levelled(self, images: FloatArray, background: BoolArray) -> FloatArray:
        """Return the images minus their mean over the background, inside the region."""
        level = images[..., background].mean(axis=-1)
        return np.asarray(np.where(self.stack.region, images - np.asarray(level)[..., None, None], 0.0))


def _disc(shape: tuple[int, ...], place: FloatArray, radius: float) -> BoolArray:
    """Return the pixels whose centres lie within a radius of a place (x, y)."""
    offset = np.arange(shape[0]) - shape[0] // 2
    return np.asarray((offset[:, None] - place[1]) ** 2 + (offset - place[0]) ** 2 <= radius**2)


def _to_radial(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the matrices (p, 3, 3) that turn shifts in x and y into shifts away from the star and around it."""
    angle = np.arctan2(y, x)
    turn = np.zeros((len(angle), 3, 3))
    turn[:, 0, 0] = 1.0
    turn[:, 1, 1] = turn[:, 2, 2] = np.cos(angle)
    turn[:, 1, 2] = np.sin(angle)
    turn[:, 2, 1] = -np.sin(angle)
    return turn


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


class Astrometry(Record, eq=False):
    """Position and flux of a planet on the detector and on the sky; made by `fit_position`.

    Attributes
    ----------
    x_arcsec, y_arcsec : float
        Detector offset from the star; x grows with the column, y with the row.
    x_error_arcsec, y_error_arcsec : float
        1-sigma errors.
    covariance : ndarray, shape (3, 3)
        Of x_arcsec, y_arcsec and flux_e.
    east_arcsec, north_arcsec : float
        The same place on the sky: offsets from the star toward east and north.
    separation_arcsec, separation_error_arcsec : float
        Separation from the star and its 1-sigma error.
    pa_deg, pa_error_deg : float
        Position angle, degrees east of north, 0 to 360, and its 1-sigma error; 180 at most.
    sky_covariance : ndarray, shape (2, 2)
        Of east_arcsec and north_arcsec.
    separation_pa_correlation : float
        Of the errors of separation and position angle.
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
    east_arcsec: float
    north_arcsec: float
    separation_arcsec: float
    separation_error_arcsec: float
    pa_deg: float
    pa_error_deg: float
    sky_covariance: FloatArray
    separation_pa_correlation: float
    flux_e: float
    flux_error_e: float
    chi2: float
    degrees_of_freedom: int
    noise_samples: float
    shift_arcsec: float
    flags: tuple[str, ...] = ()

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
    scale = psf.geometry.pixel_scale_arcsec
    reach = (len(stack.region) // 2) * scale
    for key, value in (("x_arcsec", x_arcsec), ("y_arcsec", y_arcsec)):
        require(key, value, abs(value) <= reach, "arcsec", f"{-reach:g} to {reach:g}")
    fitter = PositionFitter(stack, psf, exclude)
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
    # From detector offsets (x, y) to (east, north): the transpose of what `sky_to_detector` does.
    parity = psf.instrument.detector.parity if parity is None else parity
    rotation = np.column_stack(sky_to_detector(np.ones(2), np.array([90.0, 0.0]), roll_deg=roll_deg, parity=parity))
    return Astrometry(
        x_arcsec=x,
        y_arcsec=y,
        x_error_arcsec=float(errors[0]),
        y_error_arcsec=float(errors[1]),
        covariance=covariance,
        **_on_sky(rotation @ (x, y), rotation @ covariance[:2, :2] @ rotation.T),
        flux_e=fit.flux,
        flux_error_e=float(errors[2]),
        chi2=chi2,
        degrees_of_freedom=pixels - 3,
        noise_samples=speckles.samples,
        shift_arcsec=float(np.hypot(*(fit.place - start)) * scale),
        flags=tuple(flag for flag, there in flags.items() if there),
    )


def _on_sky(offset: FloatArray, covariance: FloatArray) -> dict[str, Any]:
    """Return what `Astrometry` says of an offset (east, north); on the sky itself east is +x (parity +1)."""
    separation, pa = (float(part) for part in detector_to_sky(offset[0], offset[1], parity=1))
    radial = offset / separation if separation > 0 else np.array([0.0, 1.0])
    tangential = np.array([radial[1], -radial[0]])
    along, across = (math.sqrt(max(float(part @ covariance @ part), 0.0)) for part in (radial, tangential))
    return {
        "sky_covariance": covariance,
        "separation_pa_correlation": float(radial @ covariance @ tangential) / (along * across or 1.0),
        "east_arcsec": float(offset[0]),
        "north_arcsec": float(offset[1]),
        "separation_arcsec": separation,
        "separation_error_arcsec": along,
        "pa_deg": pa,
        "pa_error_deg": min(math.degrees(across / separation), 180.0) if separation > 0 else 180.0,
    }
