"""Angular differential imaging by roll: two rolls of one star, each the other's reference."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from cpic_core import FloatArray, InputError, numeric_context
from cpic_planner.validation.apertures import aperture_weights, as_images, checked_frames, checked_region, region_rows
from cpic_planner.validation.photometry import EXCLUSION_RADII, Photometry, aperture_photometry, ratio
from cpic_planner.validation.rdi import Centering, RdiResult, rdi_subtract


@dataclass(frozen=True, eq=False)
class RollResult:
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
    _responses: tuple[_Response, _Response] = field(repr=False)

    @property
    def image_e(self) -> tuple[FloatArray, FloatArray]:
        """Residuals summed over the frames, first and second roll."""
        one, two = self.frames
        return np.tensordot(one, self.first.residuals, 1), np.tensordot(two, self.second.residuals, 1)

    def project(self, first_template: npt.ArrayLike, second_template: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """What the subtraction leaves of a planet, per frame.

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
        Exact with temporal centring: the planet is the same in all references and leaves with their mean. Otherwise it
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
        first_template: npt.ArrayLike,
        second_template: npt.ArrayLike,
        first_aperture: npt.ArrayLike,
        second_aperture: npt.ArrayLike,
        *,
        background: npt.ArrayLike | None = None,
    ) -> tuple[float, float]:
        """Fraction of the planet's aperture flux that survives in each roll.

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
            incoming = float(np.sum(np.asarray(template, float) * weights))
            if not incoming > 0:
                raise InputError(key, incoming, allowed="a positive sum inside the aperture")
            surviving = float(np.sum(image * weights))
            if background is not None:
                pixels = checked_region("background", background, image.shape)
                surviving -= float(image[pixels].mean() * weights.sum())
            fractions.append(surviving / incoming)
        return fractions[0], fractions[1]

    def _named(self, first: npt.ArrayLike, second: npt.ArrayLike) -> list[tuple[str, npt.ArrayLike]]:
        named = [("first_template", first), ("second_template", second)]
        for key, image in named:
            if np.shape(image) != self.first.region.shape:
                raise InputError(key, np.shape(image), unit="px", allowed=f"one image of {self.first.region.shape}")
        return named


@dataclass(frozen=True, eq=False)
class _Response:
    """Linear answer of the mean residual of one roll to a planet in science and reference frames.

    ``modes`` are all that exist, the first ``used`` of which are subtracted; ``shares`` are the projections of the unit
    change of every reference on their left singular vectors, ``target`` is the centred mean science frame.
    """

    centering: Centering
    used: int
    modes: FloatArray
    singular: FloatArray
    shares: FloatArray
    target: FloatArray

    @classmethod
    def of(cls, cut: RdiResult, science: FloatArray, frames: FloatArray, references: FloatArray) -> _Response:
        region, used = cut.region, cut.modes_used
        if cut.centering == "temporal" or used == 0:
            nothing = np.empty(0)
            return cls(cut.centering, used, cut.modes, nothing, nothing, nothing)
        target = region_rows("science", np.average(science, axis=0, weights=frames), region)[0]
        total = region_rows("references", references.sum(axis=0), region)[0]
        if cut.centering == "spatial":
            target, total = target - target.mean(), total - total.mean()
        every = rdi_subtract(science[0], references, len(references), region=region, centering=cut.centering)
        singular = np.sqrt(every.eigenvalues)
        return cls(cut.centering, used, every.modes, singular, every.modes @ total / singular, target)

    def left(self, own: FloatArray, other: FloatArray) -> FloatArray:
        """Row that a planet ``own`` in the science frames and ``other`` in the references leaves."""
        kept = self.modes[: self.used]
        if self.centering == "temporal":
            own = own - other
        elif self.centering == "spatial":
            own, other = own - own.mean(), other - other.mean()
        left = own - (kept @ own) @ kept
        if self.centering == "temporal" or self.used == 0:
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
    first_e: npt.ArrayLike,
    second_e: npt.ArrayLike,
    n_modes: int,
    *,
    region: npt.ArrayLike | None = None,
    centering: Centering = "temporal",
    first_frames: npt.ArrayLike = 1,
    second_frames: npt.ArrayLike = 1,
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
        raise InputError(
            "second_e", second.shape, unit="px", allowed=f"as many frames of one size as the first roll, {first.shape}"
        )
    counts = _counts("first_frames", first_frames, len(first)), _counts("second_frames", second_frames, len(second))
    if counts[0].sum() != counts[1].sum():
        raise InputError(
            "second_frames", float(counts[1].sum()), allowed=f"{counts[0].sum():g} in all, as in the first"
        )
    first, second = first / counts[0][:, None, None], second / counts[1][:, None, None]
    one, two = (
        rdi_subtract(a, b, n_modes, region=region, centering=centering) for a, b in ((first, second), (second, first))
    )
    responses = _Response.of(one, first, counts[0], second), _Response.of(two, second, counts[1], first)
    return RollResult(one, two, counts, responses)


def _counts(key: str, value: npt.ArrayLike, images: int) -> FloatArray:
    counts = np.asarray(value, dtype=np.float64)
    if counts.shape not in ((), (images,)) or not (counts >= 1).all():
        raise InputError(key, value, allowed=f"at least 1, one number or {images} of them")
    return np.broadcast_to(counts, (images,)).copy()


@numeric_context()
def roll_photometry(
    result: RollResult,
    first_template: npt.ArrayLike,
    second_template: npt.ArrayLike,
    first_pixel: tuple[float, float],
    second_pixel: tuple[float, float],
    radius_pixel: float,
    *,
    background_region: npt.ArrayLike,
    em_gain: float = 1.0,
    stages: int = 604,
) -> Photometry:
    """Flux of a planet from both of its places.

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
    em_gain, stages : float, int, optional
        Gain and stages of the register.

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
    weights = [aperture_weights(images[0].shape, *place, radius_pixel) for place in places]
    away = checked_region("background_region", background_region, images[0].shape)
    y, x = np.indices(away.shape)
    for place in places:
        away &= np.hypot(x - place[0], y - place[1]) > EXCLUSION_RADII * radius_pixel
    through = result.throughput(*templates, *weights, background=away)
    incoming = [
        float(np.sum(np.asarray(template) * weight)) for template, weight in zip(templates, weights, strict=True)
    ]
    throughput = float(np.dot(through, incoming)) / sum(incoming)
    if not throughput > 0:
        raise InputError(
            "second_pixel",
            second_pixel,
            unit="px",
            allowed="a place far enough from the first for some of the planet to be left",
        )
    first, second = (
        aperture_photometry(image, *place, radius_pixel, background_region=away, em_gain=em_gain, stages=stages)
        for image, place in zip(images, places, strict=True)
    )
    shared = float(np.sum(weights[0] * weights[1]))
    return _mean_of(
        first, second, throughput, shared / math.sqrt(float(np.sum(weights[0] ** 2) * np.sum(weights[1] ** 2)))
    )


def _mean_of(first: Photometry, second: Photometry, throughput: float, overlap: float) -> Photometry:
    """Photometry of the mean of two aperture sums whose noise has the correlation ``-overlap``."""
    both = (first, second)
    raw = (first.raw_flux + second.raw_flux) / 2.0
    one, two = first.sigma_background, second.sigma_background
    sigma = math.sqrt(max(one**2 + two**2 - 2.0 * overlap * one * two, 0.0)) / 2.0
    widening = 1.0 + first.aperture_area_pixels / first.background_area_pixels
    own = sum(part.error**2 - part.sigma_background**2 * widening for part in both) / 4.0
    error = math.sqrt(sigma**2 * widening + max(own, 0.0))
    paper = math.hypot(*(part.flux_paper_error for part in both)) / 2.0
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
