"""The subtraction of references: modes (reference-star differential imaging), two rolls, and the stack that is left.

What is taken off before the modes is an entry of `cpic_planner.registry.REDUCTIONS`.
"""

import math
from dataclasses import field, replace
from typing import NamedTuple

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, Record, check_word, numeric_context
from cpic_planner.etc import CountingLaw, counting_variance
from cpic_planner.registry import REDUCTIONS
from cpic_planner.validation.photometry import (
    EXCLUSION_RADII,
    Photometry,
    aperture_photometry,
    as_images,
    checked_frames,
    checked_region,
    frame_counts,
    outside_discs,
    ratio,
    region_rows,
    sum_weights,
)
from simulator.camera import FrameNoise
from simulator.config import AnyDetector

# Smallest eigenvalue of the rows' Gram matrix that counts as a mode, relative to the largest.
EIGENVALUE_CUT = 1e-12
# Singular values, relative to the largest, down to which the eigenvectors of the Gram matrix serve as they are ...
_DIRECT_CUT = 0.03
# ... or as a first rotation.
_TURNED_CUT = 1e-4
# Squares of numbers in this range neither overflow nor vanish.
_SAFE = (1e-100, 1e100)


def leading_modes(rows: FloatArray, count: int, floor: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """Return the leading right singular vectors of a matrix with few rows.

    Parameters
    ----------
    rows : ndarray
        Finite, (m, P).
    count : int
        Number of modes wanted, at least 0.
    floor : float
        Singular values up to this one count as rounding.

    Returns
    -------
    modes : ndarray
        Orthonormal, (min(count, rank), P).
    singular : ndarray
        Their singular values, descending.

    Notes
    -----
    The rank is the number of eigenvalues of the Gram matrix above 1e-12 of the largest (and of singular values above
    ``floor``).

    Eigenvectors of the Gram matrix ``R R^T`` carried to pixel space (Soummer et al. 2012, ApJ 755, L28) are orthonormal
    to about ``eps (s_1 / s_k)^2`` only, for singular values ``s``. Where all wanted modes are above 0.03 of the first
    they are good to 1e-12 and taken. Below, they serve as a first rotation: the rotated rows, scaled to unit length,
    have a Gram matrix close to unity, whose Cholesky factor orthonormalises them to rounding (as in CholeskyQR2,
    Yamamoto et al. 2015, ETNA 44, 306), and the singular value decomposition of the small triangular factor gives the
    modes as accurately as that of the rows. Both are matrix products, several times faster than a QR factorisation of
    long rows. Where a wanted mode lies below 1e-4 of the first, the Gram matrix cannot tell it well enough from the
    rounding of the larger ones, and the QR factorisation is made.
    """
    peak = max(float(rows.max()), -float(rows.min()))
    scale = 1.0 if _SAFE[0] < peak < _SAFE[1] else math.ldexp(1.0, -math.frexp(peak)[1])
    scaled = rows if scale == 1.0 else rows * scale
    found = _by_gram(scaled, count, floor * scale)
    modes, singular = _by_qr(scaled, count, floor * scale) if found is None else found
    return modes, singular / scale


def _kept(singular: FloatArray, count: int, floor: float) -> int:
    """Return the number of modes that are wanted and exist."""
    return min(count, int(np.count_nonzero(singular > max(floor, math.sqrt(EIGENVALUE_CUT) * singular[0]))))


def _by_gram(rows: FloatArray, count: int, floor: float) -> tuple[FloatArray, FloatArray] | None:
    """Return the modes from the Gram matrix; None where they would not be accurate."""
    values, vectors = np.linalg.eigh(rows @ rows.T)
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    used = _kept(np.sqrt(values), count, floor)
    if used == 0:
        return np.empty((0, rows.shape[1])), np.empty(0)
    last = math.sqrt(values[used - 1] / values[0])
    if last < _TURNED_CUT:
        return None
    if last > _DIRECT_CUT:
        singular = np.sqrt(values[:used])
        return (vectors[:, :used] / singular).T @ rows, singular
    turned = vectors[:, values > EIGENVALUE_CUT * values[0]].T @ rows
    gram = turned @ turned.T
    length = np.sqrt(np.diagonal(gram))
    lower = np.linalg.cholesky(gram / np.outer(length, length))
    _, singular, right = np.linalg.svd(length[:, None] * lower)
    mix = np.linalg.solve(lower.T, right[:used].T).T / length
    return mix @ turned, singular[:used]


def _by_qr(rows: FloatArray, count: int, floor: float) -> tuple[FloatArray, FloatArray]:
    basis, triangle = np.linalg.qr(rows.T)
    rotation, singular, _ = np.linalg.svd(triangle, full_matrices=False)
    used = _kept(singular, count, floor)
    return np.ascontiguousarray((basis @ rotation[:, :used]).T), singular[:used]


def row_norm(rows: FloatArray) -> float:
    """Return the root of the sum of squares, whatever the scale."""
    peak = max(float(rows.max()), -float(rows.min()))
    if _SAFE[0] < peak < _SAFE[1]:
        return math.sqrt(float(np.vdot(rows, rows)))
    return peak * float(np.linalg.norm(rows / peak)) if peak > 0 else 0.0


# Smallest amplitude of a mode relative to the references before centring: below it there is only rounding.
ROUNDING_CUT = 1e-13


class RdiResult(Record, eq=False):
    """Outcome of `rdi_subtract`.

    Attributes
    ----------
    residuals : ndarray
        Science frames minus their projection, shape of ``science``; 0 outside ``region``.
    modes_used : int
        Number of modes that were subtracted.
    truncated : bool
        Whether fewer modes were used because the references have no more (``modes_used`` is then their rank).
    centering : str
        Name of the reduction: what was taken off first (`cpic_planner.registry.REDUCTIONS`).
    region : ndarray of bool
        Pixels (y, x) that took part.
    modes : ndarray
        Orthonormal modes, (modes_used, region pixels).
    eigenvalues : ndarray
        Their eigenvalues in the Gram matrix of the centred references, descending.
    """

    residuals: FloatArray
    modes_used: int
    truncated: bool
    centering: str
    region: BoolArray
    modes: FloatArray = field(repr=False)
    eigenvalues: FloatArray = field(repr=False)

    def project(self, template: ArrayLike) -> FloatArray:
        """Return what the subtraction leaves of a planet.

        The subtraction is linear in the science frame (plus a constant of the references that no planet enters), so
        this image is the forward model of a planet absent from the references.

        Parameters
        ----------
        template : array_like
            Image or images of the planet, (y, x) or (n, y, x), without the star.

        Returns
        -------
        ndarray
            Same shape; 0 outside the region.
        """
        images = checked_frames("template", template)
        if images.shape[-2:] != self.region.shape:
            raise InputError("template", images.shape, unit="px", allowed=f"images of {self.region.shape}")
        rows = region_rows("template", images, self.region)
        rows = REDUCTIONS[self.centering].left_of(rows)
        return as_images(_remove(rows, self.modes), self.region, images.shape)

    def throughput(self, template: ArrayLike, aperture: ArrayLike, *, background: ArrayLike | None = None) -> float:
        """Return the fraction of a planet's aperture flux that survives the subtraction.

        Parameters
        ----------
        template : array_like
            Image of the planet, (y, x), any scale.
        aperture : array_like
            Weight of each pixel in the photometric aperture, (y, x), at least 0.
        background : array_like of bool, optional
            Pixels whose mean is subtracted as background by the photometry: the planet's light there then
            counts as lost, as it does in the measurement.

        Returns
        -------
        float
            Aperture sum of `project` (minus background) over aperture sum of ``template``. Light outside the
            region counts as lost.

        Raises
        ------
        InputError
            If shapes differ, or the template has no light in the aperture.
        """
        planet, weights = np.asarray(template, dtype=np.float64), np.asarray(aperture, dtype=np.float64)
        for key, image in (("template", planet), ("aperture", weights)):
            if image.shape != self.region.shape:
                raise InputError(key, image.shape, unit="px", allowed=f"one image of {self.region.shape}")
        return surviving_fraction("template", planet, self.project(planet), weights, background)


def surviving_fraction(
    key: str, template: FloatArray, left: FloatArray, aperture: FloatArray, background: ArrayLike | None
) -> float:
    """Return the aperture sum of what a subtraction leaves of a planet, over that of its image.

    Parameters
    ----------
    key : str
        Name of the image that a refusal gives.
    template, left, aperture : ndarray, shape (y, x)
        Image of the planet, what is left of it, and the weights of the aperture.
    background : array_like of bool or None
        Pixels whose mean is subtracted.
    """
    incoming, surviving = float(np.sum(template * aperture)), float(np.sum(left * aperture))
    if not incoming > 0:
        raise InputError(key, incoming, allowed="a positive sum inside the aperture")
    if background is not None:
        pixels = checked_region("background", background, left.shape)
        surviving -= float(left[pixels].mean() * aperture.sum())
    return surviving / incoming


@numeric_context()
def rdi_subtract(
    science: ArrayLike,
    references: ArrayLike,
    n_modes: int,
    *,
    region: ArrayLike | None = None,
    centering: str = "spatial",
) -> RdiResult:
    """Subtract from each science frame its projection on the leading modes of the references.

    Parameters
    ----------
    science : array_like
        One frame (y, x) or several (n, y, x).
    references : array_like
        Reference frames (m, y, x) of the same field, at least one. A planet in them would be partly
        subtracted in a way that `RdiResult.throughput` does not model.
    n_modes : int
        Number of modes, at least 0; more than the numerical rank is truncated to it.
    region : array_like of bool, optional
        Pixels (y, x) to use; all by default. Nothing else is read, and residuals are 0 elsewhere.
    centering : {"spatial", "none", "temporal"}, optional
        Remove from every frame its own mean over the region (as KLIP does), nothing, or the mean reference
        frame; or the name of another entry of `cpic_planner.registry.REDUCTIONS`.

    Returns
    -------
    RdiResult

    Raises
    ------
    InputError
        If shapes do not fit, a pixel inside the region is not finite (naming it), the region is empty, or
        ``n_modes`` or ``centering`` is not allowed.

    Notes
    -----
    The modes are the eigenvectors of the Gram matrix of the centred references carried to pixel space, that
    is their right singular vectors: the Karhunen-Loeve images of Soummer et al. 2012 (ApJ 755, L28) with
    spatial centring, the principal components of Amara & Quanz 2012 (MNRAS 427, 948) with temporal centring.
    How they are computed: `cpic_planner.validation.rdi.leading_modes`. Modes with an eigenvalue below 1e-12
    of the largest, or at the level of rounding, do not exist numerically and are dropped.

    References without planet leave nothing of the planet in the modes: the subtraction is a fixed projection
    for it and takes about ``modes / pixels`` of its light where the modes are noise. `RdiResult.throughput`
    gives the exact fraction.
    """
    check_word("centering", centering, REDUCTIONS.choices())
    if isinstance(n_modes, bool) or not isinstance(n_modes, int | np.integer) or n_modes < 0:
        raise InputError("n_modes", n_modes, allowed="an integer of at least 0")
    targets, library = checked_frames("science", science), checked_frames("references", references)
    if library.ndim != 3 or library.shape[0] < 1:
        raise InputError("references", library.shape, allowed="at least one frame, shape (m, y, x)")
    if targets.shape[-2:] != library.shape[-2:]:
        raise InputError("references", library.shape, unit="px", allowed=f"frames of {targets.shape[-2:]} as science")
    pixels = checked_region("region", region, targets.shape[-2:])
    rows, refs = region_rows("science", targets, pixels), region_rows("references", library, pixels)

    floor = ROUNDING_CUT * row_norm(refs)
    # Rows are copies: new memory for each step would cost more time than the arithmetic.
    REDUCTIONS[centering].centre(rows, refs)
    modes, singular = leading_modes(refs, int(n_modes), floor)
    used = len(singular)
    return RdiResult(
        residuals=as_images(_remove(rows, modes), pixels, targets.shape),
        modes_used=used,
        truncated=used < n_modes,
        centering=centering,
        region=pixels,
        modes=modes,
        eigenvalues=np.square(singular),
    )


_FOLDS = 5
_LEAST_GAIN = 0.98  # what the references cannot tell from none
_AS_GOOD = 1.01


@numeric_context()
def paying_modes(
    references: ArrayLike,
    most: int,
    *,
    region: BoolArray,
    template: FloatArray,
    weights: FloatArray,
    kernel: FloatArray,
    samples: BoolArray,
    centering: str = "temporal",
) -> int:
    """Return how many modes give the lowest limit at a place, as references show that were held out.

    Parameters
    ----------
    references : array_like
        Reference images (m, y, x), one a visit: what varies from one to the other is the speckles and their noise.
    most : int
        Modes at most.
    region : ndarray of bool
        Pixels (y, x) whose modes are meant.
    template, weights : ndarray
        Image of a planet, any scale, and the weights of the sum that measures it, (y, x).
    kernel : ndarray
        Weights of the sums that tell the noise, odd sides.
    samples : ndarray of bool
        Centres (y, x) of these sums.
    centering : str
        As in `rdi_subtract`.

    Returns
    -------
    int
        0 where none pay, or where there are fewer than three references.

    Notes
    -----
    The limit is the scatter of the sums about their mean over what the projection leaves of the planet. A fifth of the
    references at a time is projected off the modes of the others, centred by them; science visits lose and keep the
    same share. Of numbers within 1 % of the best the smallest is taken, and none unless they gain 2 %.
    """
    from scipy.ndimage import correlate

    rows = region_rows("references", checked_frames("references", references), region)
    count, reduction = len(rows), REDUCTIONS[centering]
    folds = min(count, _FOLDS)
    most = min(int(most), count - -(-count // folds) - 1)
    if count < 3 or most < 1 or not samples.any():
        return 0

    def sums(part: FloatArray) -> FloatArray:
        images = as_images(part, region, (len(part), *region.shape))
        found = np.stack([correlate(image, kernel, mode="constant")[samples] for image in images])
        return np.asarray(found - found.mean(axis=1, keepdims=True))

    planet, weighing = (region_rows("template", image[None], region)[0] for image in (template, weights))
    variance, left = np.zeros(most + 1), np.zeros(most + 1)
    for fold in range(folds):
        held = np.arange(count) % folds == fold
        known, apart = rows[~held], rows[held]
        reduction.centre(apart, known)
        modes, _ = leading_modes(known, most)
        noise, shares, of_modes = sums(apart), apart @ modes.T, sums(modes)
        for mode in range(most + 1):
            variance[mode] += np.sum(noise**2)
            if mode < len(modes):
                noise = noise - np.outer(shares[:, mode], of_modes[mode])
        taken = np.cumsum((modes @ planet) * (modes @ weighing)) / (planet @ weighing)
        left += 1.0 - np.concatenate([[0.0], taken, np.full(most - len(taken), taken[-1] if len(taken) else 0.0)])
    limit = np.where(left > 0, np.sqrt(variance) / np.where(left > 0, left, 1.0), np.inf)
    if limit.min() > _LEAST_GAIN * limit[0]:
        return 0
    return int(np.argmax(limit <= _AS_GOOD * limit.min()))


def _remove(rows: FloatArray, modes: FloatArray) -> FloatArray:
    out = (rows @ modes.T) @ modes
    return np.subtract(rows, out, out=out)


# The light that sets the white noise is smooth on the scale of the optics; the noise of its own measurement is not.
SMOOTHING_PIXELS = 1.5


class Inputs(NamedTuple):
    """The inputs from which a stack was reduced.

    Attributes
    ----------
    science_e : ndarray, shape (n, n)
        Mean science frame.
    library_e : ndarray, shape (m, n, n)
        Reference images per frame, scaled to the brightness of the science star.
    frames : float
        Number of science frames.
    other_star : bool
        Whether the references show another star, whose sky leaves an even level.
    """

    science_e: FloatArray
    library_e: FloatArray
    frames: float
    other_star: bool


class ReducedStack(Record, eq=False):
    """The result of the reduction of one observation; images are star-centred stamps (y, x).

    Attributes
    ----------
    image_e : ndarray, shape (n, n)
        Residual in electrons at the register input, summed over the science frames; 0 outside ``region``.
    region : ndarray of bool, shape (n, n)
        Pixels that took part.
    white_variance_e2 : ndarray, shape (n, n)
        Variance of ``image_e`` from photons with their excess noise, dark current, smear, clock-induced charge, read
        noise and rounding, of science and reference frames; speckles are not in it. 0 outside ``region``.
    halo_e : ndarray, shape (n, n)
        Light of the reference frames scaled to the summed science frames, smoothed, without dark current and
        clock-induced charge; 0 outside ``region``.
    rdi : RdiResult
        The projection, and with it the forward model of a planet.
    integration_s : float
        Sum of the science exposures.
    factor2 : float
        Variance over mean of the electrons that are counted.
    inputs : Inputs or None
        What it was reduced from; None where that is not kept, and it cannot be reduced otherwise.
    """

    image_e: FloatArray
    region: BoolArray
    white_variance_e2: FloatArray
    halo_e: FloatArray
    rdi: RdiResult
    integration_s: float
    factor2: float
    inputs: Inputs | None = field(default=None, repr=False)

    def within(self, region: BoolArray, n_modes: int) -> "ReducedStack":
        """Reduce the same images over part of their pixels, with modes of those alone.

        Parameters
        ----------
        region : ndarray of bool, shape (n, n)
        n_modes : int
            Modes that are projected out after the mean, at least 0.

        Notes
        -----
        The projection is linear: the mean science frame tells the sum of the residuals.
        """
        assert self.inputs is not None  # as `reduce_stack` makes it
        inside, made, centering = region & self.region, self.inputs, self.rdi.centering
        cut = rdi_subtract(made.science_e[None], made.library_e, n_modes, region=inside, centering=centering)
        return replace(
            self,
            image_e=_summed(cut, np.array([made.frames]), made.other_star),
            region=cut.region,
            white_variance_e2=np.where(inside, self.white_variance_e2, 0.0),
            halo_e=np.where(inside, self.halo_e, 0.0),
            rdi=cut,
        )


def _summed(cut: RdiResult, frames: FloatArray, other_star: bool) -> FloatArray:
    """Return the sum of residuals of images of so many frames; another star's sky, an even level, is taken off."""
    image = np.tensordot(frames, cut.residuals, axes=1)
    if other_star:
        image[cut.region] -= image[cut.region].mean()
    return np.asarray(image)


@numeric_context()
def reduce_stack(
    science_e: ArrayLike,
    reference_e: ArrayLike,
    *,
    region: BoolArray,
    n_modes: int,
    exposure_s: float,
    em_gain: float,
    detector: AnyDetector,
    science_frames: ArrayLike = 1,
    reference_frames: ArrayLike = 1,
    reference_scale: float = 1.0,
    noise_free_reference: bool = False,
    smear_e: tuple[FloatArray | float, FloatArray | float] = (0.0, 0.0),
    counting: CountingLaw | None = None,
    centering: str = "temporal",
) -> ReducedStack:
    """Subtract what the references make together and their leading modes, and sum.

    Parameters
    ----------
    science_e, reference_e : array_like, shapes (k, n, n) and (m, n, n)
        Frames, or sums of frames, in electrons at the register input; dark current and clock-induced charge included.
    region : ndarray of bool, shape (n, n)
        The dark hole without unusable pixels.
    n_modes : int
        Modes that are projected out after the mean.
    exposure_s, em_gain : float
        Of one frame.
    detector : Detector or InfraredDetector
        Noise of its frames.
    science_frames, reference_frames : array_like
        Number of frames in each image, one number for all or one each.
    reference_scale : float
        Brightness of the science star over that of the reference star, above 0.
    noise_free_reference : bool
        Whether the reference images are expectations, without noise of their own.
    smear_e : tuple of array_like
        Mean electrons that smeared into every pixel of a science and of a reference frame. They were taken off; their
        noise stays.
    counting : CountingLaw, optional
        Of counts of photons from which the electrons were worked out.
    centering : str
        As in `rdi_subtract`.

    Raises
    ------
    InputError
        If shapes, counts or the scale do not fit.

    Notes
    -----
    Images are divided by their number of frames before the projection and the residuals summed with it. The variance
    uses the light of the reference frames, smoothed over 1.5 px, for both: the science frames hold the planet. The sky
    of a reference star is scaled with its light, which leaves an even level: the mean of the region is taken off (a
    median would not do: counts of few electrons are skewed).
    """
    science, reference = np.asarray(science_e, float), np.asarray(reference_e, float)
    for key, images in (("science_e", science), ("reference_e", reference)):
        if images.ndim != 3:
            raise InputError(key, images.shape, unit="px", allowed="images (k, y, x)")
    science_n = frame_counts("science_frames", science_frames, len(science))
    reference_n = frame_counts("reference_frames", reference_frames, len(reference))
    if not reference_scale > 0:
        raise InputError("reference_scale", reference_scale, allowed="above 0")
    noise = FrameNoise.of(detector, em_gain, exposure_s)
    dark_e = noise.pedestal_e

    def frame_variance_e2(charge_e: FloatArray) -> FloatArray:
        return noise.charge_variance_e2(charge_e) if counting is None else counting_variance(charge_e, counting)

    library = (reference / reference_n[:, None, None] - dark_e) * reference_scale + dark_e
    cut = rdi_subtract(science / science_n[:, None, None], library, n_modes, region=region, centering=centering)
    total, library_total = float(science_n.sum()), float(reference_n.sum())
    light = smoothed((library * reference_n[:, None, None]).sum(axis=0) / library_total - dark_e, region)
    seen = np.maximum(light, 0.0)
    inside = seen + dark_e + smear_e[0]
    variance = total * frame_variance_e2(inside)
    if not noise_free_reference:
        # Held in a frame of the reference: its light before it was scaled, and the rest as it is.
        held = seen / reference_scale + dark_e + smear_e[1]
        added = REDUCTIONS[centering].reference_variance(len(reference), n_modes)
        variance += added * (total**2 / library_total * reference_scale**2 * frame_variance_e2(held))
    other_star, factor2 = reference_scale != 1.0, noise.factor2
    if counting is not None:
        about = np.median(inside[region]) * np.array([1.0, 1.01])
        factor2 = float(np.diff(counting_variance(about, counting))[0] / np.diff(about)[0])
    return ReducedStack(
        image_e=_summed(cut, science_n, other_star),
        region=cut.region,
        white_variance_e2=np.where(region, variance, 0.0),
        halo_e=np.where(region, total * light, 0.0),
        rdi=cut,
        integration_s=total * exposure_s,
        factor2=factor2,
        inputs=Inputs(science.sum(axis=0) / total, library, total, other_star),
    )


def pedestal_e(detector: AnyDetector, exposure_s: float) -> float:
    """Return the mean electrons of dark current and clock-induced charge in a pixel of one frame.

    Parameters
    ----------
    detector : Detector or InfraredDetector
    exposure_s : float
        Of the frame.
    """
    return FrameNoise.of(detector, 1.0, exposure_s).pedestal_e


def smoothed(image: FloatArray, region: BoolArray) -> FloatArray:
    """Return the Gaussian mean over the pixels of a region alone, 0 outside.

    Parameters
    ----------
    image : ndarray, shape (y, x)
    region : ndarray of bool, shape (y, x)
    """
    from scipy.ndimage import gaussian_filter

    inside = np.where(region, image, 0.0)
    weight = gaussian_filter(region.astype(float), SMOOTHING_PIXELS)
    smooth = gaussian_filter(inside, SMOOTHING_PIXELS) / np.where(region, weight, 1.0)
    return np.where(region, smooth, 0.0)


class RollResult(Record, eq=False):
    """Outcome of `roll_subtract`.

    Attributes
    ----------
    first, second : RdiResult
        Residuals of each roll, per frame. Their own ``project`` and ``throughput`` do not know of the planet in the
        references: those of this class do.
    frames : tuple of ndarray
        Number of frames in each image of each roll.
    """

    first: RdiResult
    second: RdiResult
    frames: tuple[FloatArray, FloatArray]
    _responses: "tuple[_Response, _Response]" = field(repr=False)
    _images: tuple[FloatArray, FloatArray] = field(repr=False)

    def within(self, region: ArrayLike, n_modes: int) -> "RollResult":
        """Reduce the same images over part of their pixels, with modes of those alone; as `roll_subtract`.

        Parameters
        ----------
        region : array_like of bool
            Pixels (y, x).
        n_modes : int
            Number of modes, at least 0.
        """
        inside = self.first.region & np.asarray(region)
        return _of_rolls(self._images, self.frames, n_modes, inside, self.first.centering)

    @property
    def image_e(self) -> tuple[FloatArray, FloatArray]:
        """Residuals summed over the frames, first and second roll."""
        first, second = self.frames
        return np.tensordot(first, self.first.residuals, 1), np.tensordot(second, self.second.residuals, 1)

    def project(self, first_template: ArrayLike, second_template: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return what the subtraction leaves of a planet, per frame.

        Parameters
        ----------
        first_template, second_template : array_like
            Image of the planet at its place in each roll, (y, x), same scale (any).

        Returns
        -------
        tuple of ndarray
            Its mean over the frames in the residuals of each roll: the planet less its projection (over-subtraction),
            and its negative image at the place it has in the other roll (self-subtraction).

        Notes
        -----
        Exact with temporal centring: the planet is the same in all references and leaves with their mean. Where what
        they share does not leave with what is subtracted (``follows_references`` of the reduction), it
        changes the modes, and the result holds to first order in its brightness: perturbed eigenvectors of the
        references' covariance, as the forward model of Pueyo 2016 (ApJ 824, 117), applied to the mean science frame.
        What is left out stays below 1 % of the flux for a planet of 7 sigma in a single frame.
        """
        images = [checked_frames(*pair) for pair in self._named(first_template, second_template)]
        own, other = (region_rows("template", image, self.first.region)[0] for image in images)
        left = [response.left(a, b) for response, a, b in zip(self._responses, (own, other), (other, own), strict=True)]
        first, second = (as_images(row[None], self.first.region, self.first.region.shape) for row in left)
        return first, second

    def throughput(
        self,
        first_template: ArrayLike,
        second_template: ArrayLike,
        first_aperture: ArrayLike,
        second_aperture: ArrayLike,
        *,
        background: ArrayLike | None = None,
    ) -> tuple[float, float]:
        """Return the fraction of the planet's aperture flux that survives in each roll.

        Parameters
        ----------
        first_template, second_template : array_like
            As in `project`.
        first_aperture, second_aperture : array_like
            Weight of each pixel in the photometric aperture, (y, x), at least 0.
        background : array_like of bool, optional
            Pixels whose mean is subtracted as background by the photometry.

        Raises
        ------
        InputError
            If shapes differ, or a template has no light in its aperture.
        """
        left = self.project(first_template, second_template)
        fractions = []
        apertures = (np.asarray(first_aperture, float), np.asarray(second_aperture, float))
        templates = self._named(first_template, second_template)
        for image, (key, template), weights in zip(left, templates, apertures, strict=True):
            if weights.shape != image.shape:
                raise InputError("aperture", weights.shape, unit="px", allowed=f"one image of {image.shape}")
            fractions.append(surviving_fraction(key, np.asarray(template, float), image, weights, background))
        return fractions[0], fractions[1]

    def _named(self, first: ArrayLike, second: ArrayLike) -> list[tuple[str, ArrayLike]]:
        named = [("first_template", first), ("second_template", second)]
        for key, image in named:
            if np.shape(image) != self.first.region.shape:
                raise InputError(key, np.shape(image), unit="px", allowed=f"one image of {self.first.region.shape}")
        return named


class _Response:
    """Linear answer of the mean residual of one roll to a planet in science and reference frames.

    ``modes`` are all that exist, the first ``used`` of which are subtracted; ``shares`` are the projections of the unit
    change of every reference on their left singular vectors, ``target`` is the centred mean science frame.
    """

    def __init__(self, cut: RdiResult, science: FloatArray, frames: FloatArray, references: FloatArray) -> None:
        self.reduction, self.used, self.modes = REDUCTIONS[cut.centering], cut.modes_used, cut.modes
        if self.reduction.follows_references or self.used == 0:
            return
        target = region_rows("science", np.average(science, axis=0, weights=frames), cut.region)[0]
        total = region_rows("references", references.sum(axis=0), cut.region)[0]
        target, total = self.reduction.left_of(np.stack([target, total]))
        every = rdi_subtract(science[0], references, len(references), region=cut.region, centering=cut.centering)
        self.modes, self.singular, self.target = every.modes, np.sqrt(every.eigenvalues), target
        self.shares = every.modes @ total / self.singular

    def left(self, own: FloatArray, other: FloatArray) -> FloatArray:
        """Return the row that a planet ``own`` in the science frames and ``other`` in the references leaves."""
        kept = self.modes[: self.used]
        exact = self.reduction.follows_references
        own, other = self.reduction.left_of(np.stack([own - other if exact else own, other]))
        left = own - (kept @ own) @ kept
        if exact or self.used == 0:
            return left
        k, s, t = self.used, self.singular, self.shares
        on_modes, amounts = self.modes @ other, self.modes @ self.target
        outside = other - on_modes @ self.modes
        # Change of the projector: rotation of each subtracted mode i towards what none of the modes sees ...
        turn = t[:k] / s[:k]
        lost = (turn @ amounts[:k]) * outside + (turn * (self.target @ outside)) @ kept
        # ... and towards each mode j that is not subtracted.
        gap = s[:k, None] ** 2 - s[None, k:] ** 2
        mixing = s[:k, None] * t[:k, None] * on_modes[None, k:] + s[None, k:] * t[None, k:] * on_modes[:k, None]
        mixing = np.divide(mixing, gap, out=np.zeros_like(gap), where=gap > 0)
        lost += (amounts[:k] @ mixing) @ self.modes[k:] + (mixing @ amounts[k:]) @ kept
        return np.asarray(left - lost, dtype=np.float64)


@numeric_context()
def roll_subtract(
    first_e: ArrayLike,
    second_e: ArrayLike,
    n_modes: int,
    *,
    region: ArrayLike | None = None,
    centering: str = "temporal",
    first_frames: ArrayLike = 1,
    second_frames: ArrayLike = 1,
) -> RollResult:
    """Subtract two rolls of one scene from each other.

    The planet moves with the sky, the speckles stay with the telescope. Each half is projected off the leading modes of
    the other.

    Parameters
    ----------
    first_e, second_e : array_like
        Frames of the two rolls, or sums of frames, electrons, (n, y, x), equally many.
    n_modes : int
        Number of modes, at least 0.
    region : array_like of bool, optional
        Pixels (y, x) to use; all by default.
    centering : {"temporal", "spatial", "none"}, optional
        As in `rdi_subtract`. With ``temporal``, the default, the mean frame of the other half is subtracted first; the
        planet goes with it, does not touch the modes, and the forward model is exact.
    first_frames, second_frames : array_like, optional
        Number of frames in each image, one number for all or one each; both rolls have as many in all. Sums are divided
        by it first.

    Returns
    -------
    RollResult

    Raises
    ------
    InputError
        As `rdi_subtract`, or if the halves differ in shape or in frames.
    """
    first, second = checked_frames("first_e", first_e), checked_frames("second_e", second_e)
    if first.ndim != 3 or second.shape != first.shape:
        allowed = f"as many frames of one size as the first roll, {first.shape}"
        raise InputError("second_e", second.shape, unit="px", allowed=allowed)
    n_first = frame_counts("first_frames", first_frames, len(first))
    n_second = frame_counts("second_frames", second_frames, len(second))
    if n_first.sum() != n_second.sum():
        raise InputError("second_frames", float(n_second.sum()), allowed=f"{n_first.sum():g} in all, as in the first")
    images = first / n_first[:, None, None], second / n_second[:, None, None]
    return _of_rolls(images, (n_first, n_second), n_modes, region, centering)


def _of_rolls(
    images: tuple[FloatArray, FloatArray],
    frames: tuple[FloatArray, FloatArray],
    n_modes: int,
    region: ArrayLike | None,
    centering: str,
) -> RollResult:
    """Subtract two rolls from each other whose images are means of so many frames."""
    first, second = images
    one = rdi_subtract(first, second, n_modes, region=region, centering=centering)
    two = rdi_subtract(second, first, n_modes, region=region, centering=centering)
    responses = _Response(one, first, frames[0], second), _Response(two, second, frames[1], first)
    return RollResult(one, two, frames, responses, images)


@numeric_context()
def roll_photometry(
    result: RollResult,
    first_template: ArrayLike,
    second_template: ArrayLike,
    first_pixel: tuple[float, float],
    second_pixel: tuple[float, float],
    radius_pixel: float,
    *,
    background_region: ArrayLike,
    em_gain: float = 1.0,
    stages: int = 604,
    factor2: float | None = None,
    kernels: tuple[FloatArray, ...] | None = None,
) -> Photometry:
    """Return the flux of a planet from both of its places.

    Parameters
    ----------
    result : RollResult
    first_template, second_template : array_like
        Image of the planet at its place in each roll, (y, x), same scale (any).
    first_pixel, second_pixel : tuple of float
        Place (x, y) in each roll; pixel centres are at integers.
    radius_pixel : float
        Radius of the apertures, above 0.
    background_region : array_like of bool
        As in `aperture_photometry`; discs around both places are taken out of it.
    em_gain, stages, factor2 : float, int, optional
        As in `aperture_photometry`.
    kernels : tuple of ndarray, optional
        Weights of the sum at each place instead of a circle's, as in `aperture_photometry`.

    Returns
    -------
    Photometry
        Of one roll, as if the planet had been seen once with the noise of both: ``raw_flux`` is the mean of the two
        aperture sums and ``throughput`` the mean of what the forward model leaves of them over the mean of what went
        in. Take the mean core throughput of both places with it.

    Raises
    ------
    InputError
        As `aperture_photometry` and `RollResult.throughput`, or if nothing of the planet is left (no roll).

    Notes
    -----
    Noise of the difference is that of two halves, and its negative is measured at the second place: the mean of two
    sums of unrelated pixels has half the variance (the ETC's ``variance_factor``). Where the apertures overlap the
    shared pixels cancel: the covariance is ``-sum(w1 w2)`` in units of ``sum(w^2)``.
    """
    places, templates, images = (first_pixel, second_pixel), (first_template, second_template), result.image_e
    given = kernels or (None, None)
    weights = [
        sum_weights(images[0].shape, *place, radius_pixel, kernel) for place, kernel in zip(places, given, strict=True)
    ]
    hole = checked_region("background_region", background_region, images[0].shape)
    away = outside_discs(hole, places, EXCLUSION_RADII * radius_pixel)
    through = result.throughput(*templates, *weights, background=away)
    incoming = [float(np.sum(np.asarray(image) * weight)) for image, weight in zip(templates, weights, strict=True)]
    throughput = float(np.dot(through, incoming)) / sum(incoming)
    if not throughput > 0:
        allowed = "a place far enough from the first for some of the planet to be left"
        raise InputError("second_pixel", second_pixel, unit="px", allowed=allowed)
    first, second = (
        aperture_photometry(
            image,
            *place,
            radius_pixel,
            background_region=away,
            em_gain=em_gain,
            stages=stages,
            factor2=factor2,
            kernel=kernel,
            left=left,
        )
        for image, place, kernel, left in zip(images, places, given, result.project(*templates), strict=True)
    )
    shared = float(np.sum(weights[0] * weights[1]))
    overlap = shared / math.sqrt(float(np.sum(weights[0] ** 2) * np.sum(weights[1] ** 2)))
    return _mean_of(first, second, throughput, overlap)


def _mean_of(first: Photometry, second: Photometry, throughput: float, overlap: float) -> Photometry:
    """Return the photometry of the mean of two aperture sums whose noise has the correlation ``-overlap``."""
    raw = (first.raw_flux + second.raw_flux) / 2.0
    one, two = first.sigma_background, second.sigma_background
    sigma = math.sqrt(max(one**2 + two**2 - 2.0 * overlap * one * two, 0.0)) / 2.0
    widening = 1.0 + first.aperture_area_pixels / first.background_area_pixels
    own = (first.error**2 - one**2 * widening + second.error**2 - two**2 * widening) / 4.0
    error = math.sqrt(sigma**2 * widening + max(own, 0.0))
    paper = math.hypot(first.flux_paper_error, second.flux_paper_error) / 2.0
    return replace(
        first,
        flux=raw / throughput,
        error=error / throughput,
        snr=ratio(raw, error),
        significance=ratio(raw, sigma),
        raw_flux=raw,
        sigma_background=sigma,
        background_per_pixel=(first.background_per_pixel + second.background_per_pixel) / 2.0,
        throughput=throughput,
        flux_paper_error=paper,
        snr_paper=ratio(raw, paper),
    )
