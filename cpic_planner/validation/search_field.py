"""Matched-filtered residual of a search, its noise, and its peaks; sources that were found are taken out one by one."""

import copy
import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cpic_core import BoolArray, FloatArray, load_quietly
from cpic_planner.etc import effective_visits, equivalent_sigma, searched_region
from cpic_planner.validation.reduced import ReducedStack, smoothed
from cpic_planner.validation.search import NoiseFit, NoiseTerms, fit_noise
from cpic_planner.validation.speckle_maps import SpeckleMaps, matched_sum
from simulator.imaging import AnyPsf

REPORTED_SIGMA = 2.5
_MARGIN = 0.3  # by which a source lifts the noise that it is counted in
_EXCLUDED_LAMBDA_D = 1.22  # radius around a source whose pixels do not tell the noise
_TABLED_SNR, _TABLE = 12.0, (60, 30)
_SMALL_CHANGE = 0.1  # of a logarithm, whose square is the error of one step
_EVERYWHERE = slice(None)
_ROUNDS = 5  # of a fit whose weights are its own, after which it changes by less than 1 %
_LEAST_DYNAMIC = 1e-6  # noise that is assumed beside the brightest pixel of a residual without any


_Maximum = tuple[float, float, float, float, int, NoiseFit]


@dataclass(frozen=True)
class Peak:
    """A local maximum, judged by the noise without it; see `cpic_planner.validation.detection.Candidate`."""

    x_pixel: float
    y_pixel: float
    snr: float
    significance: float
    laplace: float
    dof: float
    flux_e: float


@dataclass(frozen=True, eq=False)
class FilteredState:
    """Matched-filtered residual and its noise, per position of the region."""

    snr: FloatArray
    assumed: FloatArray
    sigma_e: FloatArray
    fit: NoiseFit
    roughness: float


@functools.lru_cache(maxsize=32)
def _sigma_table(visits: float) -> FloatArray:
    """Return `equivalent_sigma` of known noise on a grid of the square roots of level and share."""
    roots = (np.linspace(0.0, 1.0, size) for size in _TABLE)
    level, share = np.square(np.meshgrid(*roots, indexing="ij"))
    return equivalent_sigma(_TABLED_SNR * level, share, visits=visits)


def _sigma_map(snr: FloatArray, laplace: FloatArray, visits: float) -> FloatArray:
    """Return `equivalent_sigma` of many positions with known noise; in proportion beyond the table.

    The error is 0.04 at most, 0.002 rms, from one pair of visits to many.
    """
    from scipy.ndimage import map_coordinates

    level = np.abs(snr) / _TABLED_SNR
    roots = np.sqrt([np.minimum(level, 1.0), np.minimum(laplace, 1.0)])
    sigma = map_coordinates(_sigma_table(visits), roots * (np.array(_TABLE)[:, None] - 1), order=1)
    return np.asarray(np.copysign(sigma * np.maximum(level, 1.0), snr))


@dataclass(frozen=True)
class SearchedProgramme:
    """Visits behind a residual.

    Attributes
    ----------
    visits, reference_visits : int
        Science visits, and visits that all references are spread over, at least 1.
    common_fraction : float
        Believed rms of what science and reference differ by in every visit, over that of a visit's offset; 0: none.
    """

    visits: int = 1
    reference_visits: int = 1
    common_fraction: float = 0.0

    @property
    def pairs(self) -> float:
        """Laplace variates in the noise."""
        return float(effective_visits(self.visits, self.reference_visits))

    def terms(self, white: FloatArray, linear: FloatArray, square: FloatArray, *, own: bool) -> NoiseTerms:
        """Return the variance of the sum of all visits, or the part of it that the visits themselves bring.

        Parameters
        ----------
        white : ndarray
            Of the sum, references included.
        linear, square : ndarray
            Of a pair of visits as bright as the sum.
        own : bool
            Without references, and what the visits share.
        """
        science, reference = 0.5 / self.visits, 0.5 / self.reference_visits
        if own:
            share = self.reference_visits / (self.visits + self.reference_visits)
            return NoiseTerms(share * white, science * linear, science * square, self._common(0.0 * linear))
        both = science + reference
        return NoiseTerms(white, both * linear, both * square, self._common(0.5 * self.common_fraction**2 * linear))

    def _common(self, part: FloatArray) -> FloatArray | None:
        return part if self.common_fraction > 0 and self.visits > 1 else None


class SearchField:
    """Positions of a search with their noise terms.

    Attributes
    ----------
    region : ndarray of bool, shape (n, n)
        Positions that are searched.
    size : SearchedRegion
        Its size.
    lambda_d_pixels : float
        lambda/D.
    samples : float
        Independent samples of white noise in it.
    free : ndarray of bool, shape (p,)
        Positions that tell the noise: without known sources.
    pairs : float
        Laplace variates in the noise, as of `SearchedProgramme`.
    """

    def __init__(
        self,
        stack: ReducedStack,
        psf: AnyPsf,
        maps: SpeckleMaps,
        star_e: float,
        known: Sequence[tuple[float, float]],
        programme: "SearchedProgramme",
        known_light: FloatArray | None = None,
    ) -> None:
        self._stack, self._psf, self._maps, self._programme = stack, psf, maps, programme
        self.pairs = programme.pairs
        self._kernel = maps.kernel
        self.region: BoolArray = np.asarray(stack.region, np.bool_)
        self._pixel = psf.geometry.pixel_scale_arcsec
        self.lambda_d_pixels = psf.geometry.lambda_d_arcsec / self._pixel
        self.size = searched_region(self.region, self.lambda_d_pixels)
        self._y, self._x = np.nonzero(self.region)
        middle, half = len(psf.off_axis) // 2, len(maps.kernel) // 2
        cut = slice(middle - half, middle + half + 1)
        template = np.asarray(psf.off_axis, float)[cut, cut]
        self._response = float(np.sum(maps.kernel * template) / np.sum(maps.kernel**2))
        # Positions that share their noise, of a white residual: the sum of the squared autocorrelation of the kernel.
        alone = matched_sum(np.pad(maps.kernel, len(maps.kernel) - 1), maps.kernel)
        self._alike = alone / alone.max()
        self._shared = float(np.sum(self._alike**2))
        self.samples = self.size.n_positions / self._shared
        self.free = np.ones(self._y.size, np.bool_)
        self._hidden = np.zeros(self._y.size, np.bool_)
        rows, columns = np.flatnonzero(self.region.any(axis=1)), np.flatnonzero(self.region.any(axis=0))
        self._box = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)) if rows.size else (slice(0),) * 2
        self._index = np.full(self.region.shape, -1)
        self._index[self.region] = np.arange(self._y.size)
        # Shapes come from known light alone: the photons that are seen are dark where the residual is bright.
        lights = [maps.nominal, maps.stray, *([] if known_light is None else [known_light])]
        even = np.ones(self._y.size), self._y, self._x
        seen, sharp = (
            np.stack([*even, *(light[self.region] for light in each)])
            for each in ((smoothed(light, self.region) for light in lights), lights)
        )
        white = smooth_white(stack.white_variance_e2[self.region], seen, sharp) if self._y.size else sharp[0]
        least = _LEAST_DYNAMIC * float(np.abs(stack.image_e).max(initial=0.0))
        white = np.maximum(white, max(least**2, np.finfo(float).tiny))
        self._stray = star_e * maps.stray[self.region]
        linear, square = maps.linear[self.region], maps.square[self.region]
        self.terms = programme.terms(white, star_e**2 * linear, star_e**2 * square, own=False)
        self._within = programme.terms(white, star_e**2 * linear, star_e**2 * square, own=True)
        # Neighbours share their noise: one position in four tells as much of the scatter of visits.
        self._thin = (self._y % 2 == 0) & (self._x % 2 == 0)
        self._within = self._within.at(self._thin)
        self._both = self.terms.beside(self._within)
        self._scatter, self._scatter_before = self._visit_scatter()
        for x_arcsec, y_arcsec in known:
            self.exclude(*self.pixel_of(x_arcsec, y_arcsec))

    def anew(self) -> "SearchField":
        """Return the same, to be searched again: sources that are taken out of one are not out of the other."""
        other = copy.copy(self)
        other.free, other._hidden = self.free.copy(), self._hidden.copy()
        return other

    @property
    def _centre(self) -> tuple[int, int]:
        return self.region.shape[0] // 2, self.region.shape[1] // 2

    def unfold(self, values: FloatArray) -> FloatArray:
        """Return the values per position as an image, 0 elsewhere."""
        image = np.zeros(self.region.shape)
        image[self.region] = values
        return image

    def near(self, x_pixel: float, y_pixel: float) -> BoolArray:
        """Return the positions within 1.22 lambda/D.

        Parameters
        ----------
        x_pixel : float
            Column of the place, pixels.
        y_pixel : float
            Row of the place, pixels.
        """
        square = (self._x - x_pixel) ** 2 + (self._y - y_pixel) ** 2
        return np.asarray(square <= (_EXCLUDED_LAMBDA_D * self.lambda_d_pixels) ** 2)

    def exclude(self, x_pixel: float, y_pixel: float) -> None:
        """Take a source out of noise and search.

        Parameters
        ----------
        x_pixel : float
            Column of the place, pixels.
        y_pixel : float
            Row of the place, pixels.
        """
        disc = self.near(x_pixel, y_pixel)
        self.free &= ~disc
        self._hidden |= disc

    def measure(self, image: FloatArray) -> FilteredState:
        """Filter the stack and fit the noise; the second round filters with the noise that the first found."""
        logs = np.zeros(len(self.terms.believed))
        for _ in range(2):
            assumed = self.terms.variance(logs)
            snr, spread = self._filtered(image - self._common_light(image, assumed), 1.0 / assumed)
            fit = self._fitter(assumed, logs)(snr**2, self.weight(assumed, logs) * self.free)
            logs = fit.logs
        factor = np.sqrt(fit.variance / assumed)
        normal = snr / factor
        gauss = np.where(self.free, _sigma_map(normal, self.laplace(fit), self.pairs), 0.0)
        sigma_e = factor / (np.sqrt(spread) * self._response)
        return FilteredState(normal, assumed, sigma_e, fit, self._roughness(gauss))

    def _common_light(self, image: FloatArray, variance: FloatArray) -> FloatArray:
        """Return the mean light of the wavefront that science has and reference has not, in every visit.

        Its strength is the most probable one: it is believed to be the square of the common fraction, give or take.
        """
        if self.terms.shared is None:
            return np.zeros(image.shape)
        believed, weights = self._programme.common_fraction**2, self.free * self._stray / variance
        strength = (weights @ image[self.region] + 1.0 / believed) / (weights @ self._stray + believed**-2)
        return self.unfold(np.maximum(strength, 0.0) * self._stray)

    def _filtered(self, images: FloatArray, inverse: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return matched sums over their standard deviation, with these inverse variances; and the sums of weights."""
        # Next to no noise has weights whose sums are no numbers.
        most = inverse.max()
        inside, around = self.region[self._box], self.unfold(inverse / most)[self._box]
        spread = matched_sum(around, self._kernel**2)[inside]
        sums = matched_sum(images[..., *self._box] * around, self._kernel)[..., inside]
        return sums * (math.sqrt(most) / np.sqrt(spread)), spread * most

    def _visit_scatter(self) -> tuple[FloatArray, FloatArray]:
        """Return the mean square deviation of filtered visits from their mean, times their number; and that assumed.

        Planets, and what all visits share, are not in it. Empty where there is a single visit.
        """
        visits = self._programme.visits
        frames = self._stack.rdi.residuals
        if visits < 2 or not self._y.size or frames.ndim != 3 or len(frames) < visits:
            return np.zeros(0), np.zeros(0)
        whole = frames.sum(axis=0)[self.region]
        power = float(whole @ whole)
        scale = float(self._stack.image_e[self.region] @ whole) / power if power > 0 else 0.0
        assumed = self.terms.variance(np.zeros(len(self.terms.believed)))
        parts = np.stack([scale * part.sum(axis=0) for part in np.array_split(frames, visits)])
        sums = self._filtered(parts, 1.0 / assumed)[0][:, self._thin]
        return sums.var(axis=0, ddof=1) * visits, assumed[self._thin]

    def _fitter(self, before: FloatArray, logs: FloatArray) -> Callable[[FloatArray, FloatArray], NoiseFit]:
        """Return the fit of level, drift and common part, which explain the stack and the scatter of its visits.

        Its arguments are the ratios and weights of `fit_noise`.
        """
        if not self._scatter.size:
            return lambda ratio, weight: fit_noise(ratio, before, self.terms, weight, logs)
        within = self._within.variance(logs)
        # A sample variance of V visits is worth V - 1 squares of one, fewer where the light of errors is skewed.
        heavy = 1.0 + 3.0 * self._heavy(self._within, logs, within) ** 2
        many = 4.0 * self.weight(within, logs, self._within) * (self._programme.visits - 1) / heavy
        befores = np.concatenate([before, self._scatter_before])

        def fitted(ratio: FloatArray, weight: FloatArray) -> NoiseFit:
            ratios, weights = np.concatenate([ratio, self._scatter]), np.concatenate([weight, many])
            fit = fit_noise(ratios, befores, self._both, weights, logs)
            return replace(fit, variance=fit.variance[: ratio.size])

        return fitted

    def weight(self, variance: FloatArray, logs: FloatArray, terms: NoiseTerms | None = None) -> FloatArray:
        """Return the independent samples per position: speckles repeat at their mirror images."""
        return 1.0 / (self._shared * (1.0 + self._speckled(logs, variance, terms) ** 2))

    def _speckled(self, logs: FloatArray, variance: FloatArray, terms: NoiseTerms | None = None) -> FloatArray:
        return np.asarray(1.0 - math.exp(logs[0]) * (terms or self.terms).white / variance)

    def laplace(self, fit: NoiseFit, at: int | slice = _EVERYWHERE) -> FloatArray:
        """Return the share of Laplace variates, one for each pair of visits, with the kurtosis of the speckles."""
        return self._heavy(self.terms.at(at), fit.logs, fit.variance[at])

    def _heavy(self, terms: NoiseTerms, logs: FloatArray, variance: FloatArray) -> FloatArray:
        drift = math.exp(logs[1])
        square, linear = drift**2 * terms.square / variance, drift * terms.linear / variance
        return np.sqrt(self._maps.tail_square * square**2 + 2.0 * self._maps.tail_cross * square * linear)

    def dof(self, fit: NoiseFit, at: int | slice = _EVERYWHERE) -> FloatArray:
        """Return the degrees of freedom of the variance at every position, or some, from its relative error."""
        terms, variance = self.terms.at(at), fit.variance[at]
        slopes = terms.slopes(fit.logs, variance)
        relative = np.sum(slopes * np.linalg.solve(fit.information, slopes), axis=0)
        if self._maps.n_visits:
            heavy = 1.0 + 1.5 * self.laplace(fit, at) ** 2
            relative = relative + 2.0 / self._maps.n_visits * self._speckled(fit.logs, variance, terms) ** 2 * heavy
        return np.asarray(2.0 / relative)

    def _roughness(self, gauss: FloatArray) -> float:
        """Return the width from neighbours' correlation as of a Gaussian, which a sampled gradient would flatten."""
        whole, inside = self.unfold(gauss)[self._box], self.unfold(self.free.astype(float))[self._box] > 0
        power = float(np.sum(gauss**2) / max(int(self.free.sum()), 1))
        found = []
        for axis in (0, 1):
            pairs = inside & np.roll(inside, -1, axis=axis)
            pairs[(-1, slice(None)) if axis == 0 else (slice(None), -1)] = False
            step = (whole - np.roll(whole, -1, axis=axis))[pairs]
            found.append(float(np.mean(step**2)) / power if step.size and power > 0 else 0.0)
        return max(-2.0 * math.log(max(1.0 - 0.5 * float(np.mean(found)), 1e-3)), 1e-6)

    def peaks(self, state: FilteredState) -> list[Peak]:
        """Return the local maxima, most significant first, each judged by the noise without it."""
        sep = load_quietly("sep")
        image = self.unfold(np.where(self._hidden, 0.0, state.snr))[self._box]
        # No filter: the image is filtered, with the noise of every pixel.
        single = {"filter_kernel": None, "minarea": 1, "deblend_nthresh": 64, "deblend_cont": 1e-6, "clean": False}
        pixels, mask = np.ascontiguousarray(image), ~self.region[self._box]
        found = sep.extract(pixels, REPORTED_SIGMA - _MARGIN, err=np.ones(image.shape), mask=mask, **single)
        maxima = []
        for column, row in zip(found["xpeak"], found["ypeak"], strict=True):
            place = self._index[row + self._box[0].start, column + self._box[1].start]
            if place >= 0 and not self._hidden[place]:
                x, y, height = self._top(image, int(row), int(column))
                maxima.append(self._alone(state, int(place), x, y, height, height))
        return sorted(self._judged(maxima), key=lambda peak: -peak.significance)

    def at(self, state: FilteredState, x_pixel: float, y_pixel: float, taken_out: Sequence[Peak] = ()) -> Peak:
        """Return what stands at a place, judged by the noise without it; the height is a cubic between the pixels.

        Parameters
        ----------
        state : FilteredState
        x_pixel, y_pixel : float
            Column and row of the place, in the searched region.
        taken_out : sequence of Peak
            Sources that are not in the state but stand there.
        """
        from scipy.ndimage import map_coordinates

        place = int(self._index[round(y_pixel), round(x_pixel)])
        corner = [[y_pixel - self._box[0].start], [x_pixel - self._box[1].start]]
        heights = state.snr
        for peak in taken_out:
            sums, _ = self._filtered(self.source(peak), 1.0 / state.assumed)
            heights = heights + sums * np.sqrt(state.assumed / state.fit.variance)
        height = float(map_coordinates(self.unfold(heights)[self._box], corner, order=3)[0])
        shown = 0.0 if taken_out else height
        return self._judged([self._alone(state, place, x_pixel, y_pixel, height, shown)])[0]

    def _alone(
        self, state: FilteredState, place: int, x_pixel: float, y_pixel: float, height: float, shown: float
    ) -> _Maximum:
        """Return a place with its SNR by the noise without it, its electrons, position, and that fit of the noise.

        Of its height ``shown`` is in the state, whose wings beyond the disc would count as noise.
        """
        fit, weights = state.fit, self.weight(state.assumed, state.fit.logs) * self.free
        without = weights * self.near(x_pixel, y_pixel)
        mirror = self.near(2 * self._centre[1] - x_pixel, 2 * self._centre[0] - y_pixel)
        shared = self._speckled(fit.logs, fit.variance[place], self.terms.at(place)) ** 2
        wing = self._alike_at(x_pixel, y_pixel)
        rest = state.snr - shown * wing * np.sqrt(fit.variance[place] / fit.variance)
        taken = np.maximum(without, shared * weights * mirror)
        # Noise that is as high as here leaves less around it than it was: the square of what is like it.
        alone = self._without(state, weights, taken, rest**2 + wing**2)
        snr = height * math.sqrt(fit.variance[place] / alone.variance[place])
        return x_pixel, y_pixel, snr, height * float(state.sigma_e[place]), place, alone

    def _alike_at(self, x_pixel: float, y_pixel: float) -> FloatArray:
        """Return the filtered image of a source over its height at all positions, of a place rounded to a pixel."""
        half = len(self._alike) // 2
        offset = np.stack([self._y - round(y_pixel), self._x - round(x_pixel)]) + half
        inside = ((offset >= 0) & (offset <= 2 * half)).all(axis=0)
        return np.where(inside, self._alike[tuple(np.clip(offset, 0, 2 * half))], 0.0)

    def _without(self, state: FilteredState, weights: FloatArray, taken: FloatArray, left: FloatArray) -> NoiseFit:
        """Return the fit to squares that are left, with less weight: a step of Newton's where it is small, or anew."""
        fit = state.fit
        seen = state.snr**2
        parts = np.flatnonzero((taken > 0.0) | (left != seen))
        slopes = self.terms.at(parts).slopes(fit.logs, fit.variance[parts])
        information = fit.information - 0.5 * (slopes * taken[parts]) @ slopes.T
        less = (taken * (1.0 - seen) - (weights - taken) * (seen - left))[parts]
        change = np.linalg.solve(information, 0.5 * slopes @ less)
        if np.abs(change).max() > _SMALL_CHANGE:
            return self._fitter(state.assumed, fit.logs)(left * fit.variance / state.assumed, weights - taken)
        logs = fit.logs + change
        return NoiseFit(logs, information, self.terms.variance(logs))

    def _top(self, image: FloatArray, row: int, column: int) -> tuple[float, float, float]:
        """Return the place of a maximum on the stamp, x and y, and its height, refined between pixels by parabolas."""
        box_region, height = self.region[self._box], float(image[row, column])
        shift = [0.0, 0.0]
        for axis, (down, right) in enumerate(((1, 0), (0, 1))):
            sides = [(row - down, column - right), (row + down, column + right)]
            if all(0 <= y < image.shape[0] and 0 <= x < image.shape[1] and box_region[y, x] for y, x in sides):
                low, high = (float(image[side]) for side in sides)
                bend = 2.0 * float(image[row, column]) - low - high
                if bend > 0:
                    shift[axis] = float(np.clip(0.5 * (high - low) / bend, -0.5, 0.5))
                    height += 0.25 * (high - low) * shift[axis]
        return column + self._box[1].start + shift[1], row + self._box[0].start + shift[0], height

    def _judged(self, maxima: Sequence[_Maximum]) -> list[Peak]:
        """Return maxima (x, y, SNR, electrons, position, fit of the noise), each in the noise of its fit."""
        laplace, dof = ([float(law(fit, place)) for *_, place, fit in maxima] for law in (self.laplace, self.dof))
        sigma = equivalent_sigma([one[2] for one in maxima], laplace, dof, self.pairs).tolist()
        places = zip(maxima, sigma, laplace, dof, strict=True)
        return [Peak(x, y, snr, level, share, free, flux) for (x, y, snr, flux, *_), level, share, free in places]

    def with_final_noise(self, peaks: Sequence[Peak], state: FilteredState) -> list[Peak]:
        """Return the same sources in the noise that is known once all are out."""
        places = [int(self._index[round(peak.y_pixel), round(peak.x_pixel)]) for peak in peaks]
        return self._judged(
            [
                (peak.x_pixel, peak.y_pixel, peak.flux_e / float(state.sigma_e[place]), peak.flux_e, place, state.fit)
                for peak, place in zip(peaks, places, strict=True)
            ]
        )

    def pixel_of(self, x_arcsec: float, y_arcsec: float) -> tuple[float, float]:
        """Return the column and row of a place on the stamp, from its offsets on the detector."""
        return x_arcsec / self._pixel + self._centre[1], y_arcsec / self._pixel + self._centre[0]

    def offset_arcsec(self, peak: Peak) -> tuple[float, float]:
        """Return the place from the star on the detector, x and y."""
        return (peak.x_pixel - self._centre[1]) * self._pixel, (peak.y_pixel - self._centre[0]) * self._pixel

    def source(self, peak: Peak) -> FloatArray:
        """Return what a source leaves in the residual."""
        from scipy.ndimage import shift

        move = (peak.y_pixel - self._centre[0], peak.x_pixel - self._centre[1])
        image = shift(np.asarray(self._psf.off_axis, float), move, order=3, mode="constant")
        return np.asarray(peak.flux_e * self._stack.rdi.project(np.where(self.region, image, 0.0)))


def smooth_white(measured: FloatArray, patterns: FloatArray, sharp: FloatArray) -> FloatArray:
    """Return the variance without the noise of its own measurement: least squares on smooth patterns.

    Parameters
    ----------
    measured : ndarray, shape (p,)
        Variance per position, from frames that hold the same noise as the residual: where they happen to be dark the
        residual is bright and its variance is understated.
    patterns : ndarray, shape (k, p)
        Images of the light, at least 0, blurred as the variance is.
    sharp : ndarray, shape (k, p)
        The same as they are.

    Returns
    -------
    ndarray, shape (p,)
        Not below a quarter of the median of ``measured``.

    Notes
    -----
    A measured variance errs in proportion to itself: each position weighs by the inverse square of the fit, found in
    rounds (iteratively reweighted least squares, the quasi-likelihood of McCullagh & Nelder 1989, Generalized Linear
    Models, ch. 9). Without weights the core of a star in the field decides the fit everywhere.
    """
    scales = patterns.mean(axis=1)
    used, real = (part[scales > 0] / scales[scales > 0][:, None] for part in (patterns, sharp))
    scale = math.fabs(float(np.median(measured)))
    relative, fit = measured / (scale or 1.0), np.ones(measured.shape)
    for _ in range(_ROUNDS if scale else 1):
        weights, *_ = np.linalg.lstsq((used / fit).T, relative / fit, rcond=None)
        fit = np.maximum(weights @ used, 0.25 if scale else 0.0)
    return np.asarray(np.maximum(weights @ real, 0.25 if scale else 0.0) * (scale or 1.0))
