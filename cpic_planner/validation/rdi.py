"""Reference-star differential imaging: projection of the science frames off the leading reference modes."""

import math
from dataclasses import dataclass, field

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, check_word, numeric_context
from cpic_planner.registry import REDUCTIONS
from cpic_planner.validation.apertures import as_images, checked_frames, checked_region, region_rows

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


@dataclass(frozen=True, eq=False)
class RdiResult:
    """Outcome of `rdi_subtract`.

    Attributes
    ----------
    residuals : ndarray
        Science frames minus their projection, shape of ``science``; 0 outside ``region``.
    modes_requested, modes_used : int
        Number of modes asked for and subtracted.
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
    modes_requested: int
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
        modes_requested=int(n_modes),
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
