"""The blind search: sources in a residual, found without knowing where they are.

Its noise is fitted to the residual itself: the level of the white noise, and the strength of speckles whose maps say
where they are strong and how heavy their tails are. Sources that were found are taken out one by one.
"""

import copy
import functools
import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from typing import Any, cast

import numpy as np

from cpic_core import (
    BoolArray,
    FloatArray,
    InputError,
    NDArray,
    Outcome,
    Reason,
    Record,
    Status,
    announce,
    check_positive,
    check_whole,
    checked_scalar,
    compute_once,
    load_quietly,
    stream,
)
from cpic_planner.etc import (
    MAX_SIGMA,
    PRIORS,
    SearchedRegion,
    effective_visits,
    equivalent_sigma,
    false_alarms,
    search_threshold,
    searched_region,
    snr_at,
)
from cpic_planner.validation.photometry import checked_image
from cpic_planner.validation.rdi import ReducedStack, smoothed
from simulator import imaging
from simulator.config import Drift, content_hash
from simulator.signal import programme_law

_MAX_STEPS, _MAX_CHANGE, _DONE = 15, 2.0, 1e-3


class NoiseTerms(Record, eq=False):
    """Terms of the variance per position, shape (p,): ``level white + drift linear + drift^2 square``.

    With a third number, ``+ drift common shared``: speckles that are the same in all visits.
    """

    white: FloatArray
    linear: FloatArray
    square: FloatArray
    shared: FloatArray | None = None

    @property
    def believed(self) -> FloatArray:
        """Standard deviations of the logarithms of the numbers, before a residual is seen."""
        return np.array(PRIORS[:2] if self.shared is None else PRIORS)

    def at(self, places: BoolArray | NDArray[np.intp] | int | slice) -> "NoiseTerms":
        """Return the terms of some of the positions."""
        return NoiseTerms(*(part[places] for part in self._arrays()))

    def beside(self, other: "NoiseTerms") -> "NoiseTerms":
        """Return the terms of these positions and of others, of the same numbers."""
        return NoiseTerms(*map(np.concatenate, zip(self._arrays(), other._arrays(), strict=True)))

    def _arrays(self) -> list[FloatArray]:
        parts = [self.white, self.linear, self.square]
        return parts if self.shared is None else [*parts, self.shared]

    def _parts(self, logs: FloatArray) -> list[FloatArray]:
        """Return the terms at the logarithms of the numbers."""
        level, drift = np.exp(logs[:2])
        parts = [level * self.white, drift * self.linear, drift**2 * self.square]
        return parts if self.shared is None else [*parts, drift * math.exp(logs[2]) * self.shared]

    def variance(self, logs: FloatArray) -> FloatArray:
        """Return the sum of the terms at the logarithms of ``level``, ``drift`` and ``common``."""
        return np.asarray(sum(self._parts(logs)))

    def slopes(self, logs: FloatArray, variance: FloatArray) -> FloatArray:
        """Return the derivatives of the logarithm of the variance, shape (2 or 3, p).

        Parameters
        ----------
        logs : ndarray, shape (2,) or (3,)
            Of ``level``, ``drift`` and ``common``.
        variance : ndarray, shape (p,)
            There.
        """
        white, linear, square, *shared = self._parts(logs)
        return np.stack([white, sum(shared, linear + 2.0 * square), *shared]) / variance


class NoiseFit(Record, eq=False):
    """Logarithms of the numbers of `NoiseTerms`, the inverse of their covariance, and the variance per position."""

    logs: FloatArray
    information: FloatArray
    variance: FloatArray


def fit_noise(
    ratio: FloatArray, before: FloatArray, terms: NoiseTerms, weight: FloatArray, start: FloatArray
) -> NoiseFit:
    """Return the most probable level, drift and common part, given squared significances.

    Parameters
    ----------
    ratio : ndarray, shape (p,)
        Squares of the residual over its standard deviation, with the variances ``before``.
    before : ndarray, shape (p,)
        Variance that was assumed.
    terms : NoiseTerms
    weight : ndarray, shape (p,)
        Independent samples per position: neighbours share their noise.
    start : ndarray, shape (2,) or (3,)
        First guess of the logarithms.

    Notes
    -----
    Minimises ``sum weight [ln V + ratio before / V] / 2`` plus the priors, by Fisher scoring with damping.
    """
    prior = np.diag(terms.believed**-2)

    def cost(logs: FloatArray) -> tuple[float, FloatArray]:
        variance = terms.variance(logs)
        relative = variance / before
        return 0.5 * float(np.sum(weight * (np.log(relative) + ratio / relative)) + logs @ prior @ logs), variance

    logs = np.array(start, float)
    value, variance = cost(logs)
    damping = 1e-4
    for _ in range(_MAX_STEPS):
        slopes = terms.slopes(logs, variance)
        gradient = 0.5 * (slopes * weight) @ (1.0 - ratio * before / variance) + prior @ logs
        information = 0.5 * (slopes * weight) @ slopes.T + prior
        while True:
            change = np.linalg.solve(information + damping * np.diag(np.diag(information)), -gradient)
            trial = logs + np.clip(change, -_MAX_CHANGE, _MAX_CHANGE)
            lower, there = cost(trial)
            if lower <= value or damping > 1e6:
                break
            damping *= 10.0
        if lower > value:
            break
        gained, logs, value, variance, damping = value - lower, trial, lower, there, 0.1 * damping
        if gained < _DONE:
            break
    slopes = terms.slopes(logs, variance)
    return NoiseFit(logs, 0.5 * (slopes * weight) @ slopes.T + prior, variance)


N_VISITS = 256
SCHEMA = 1  # raised when the same key would give other maps
_SEED = 20250207  # other screens than those of any observation
_HOUR_S, _ANNULUS_LAMBDA_D = 3600.0, 1.5


class SpeckleMaps(Record, eq=False):
    """Residual of two visits whose wavefronts differ by independent offsets; made by `speckle_maps`.

    The variances are those of a matched-filtered sum over the sum of the squared kernel: what a pixel of white noise
    would need to have the same effect. Units: square of the star's light on the clear disc, at ``visit_nm``.

    Attributes
    ----------
    linear, square : ndarray, shape (n, n)
        Variance of ``2 Re(E0* dE)`` (grows with offset^2) and of ``|dE|^2`` (offset^4); 0 beyond the hole.
    nominal, stray : ndarray, shape (n, n)
        Star behind the mask, and the mean of ``|dE|^2``; 0 beyond the hole.
    tail_square, tail_cross : float
        Excess kurtosis over that of a Laplace law, of ``|dE|^2`` and of its product with the linear term: below 1,
        since a passband and a kernel average over speckles.
    visit_nm : float
        Offset of each visit.
    n_visits : int
        Visits behind the variances; 0 where they are known exactly (no drift).
    kernel : ndarray, shape (k, k)
        Weights of the filter, k odd.
    """

    linear: FloatArray
    square: FloatArray
    nominal: FloatArray
    stray: FloatArray
    tail_square: float
    tail_cross: float
    visit_nm: float
    n_visits: int
    kernel: FloatArray


def filter_kernel(psf: imaging.AnyPsf) -> FloatArray:
    """Return the weights of the matched filter of a PSF (`simulator.imaging.matched_kernel`)."""
    return imaging.matched_kernel(psf.off_axis, psf.geometry.lambda_d_arcsec / psf.geometry.pixel_scale_arcsec)


def matched_sum(image: FloatArray, kernel: FloatArray) -> FloatArray:
    """Return the sum of image times kernel around every pixel; nothing beyond the edge. Shape (..., y, x).

    Parameters
    ----------
    image : ndarray
        Image, (y, x), or several.
    kernel : ndarray
        Weights, (y, x), odd sides; at most twice the image.
    """
    from scipy.fft import irfft2, next_fast_len, rfft2

    (rows, columns), (high, wide) = image.shape[-2:], kernel.shape
    size = [next_fast_len(rows + high // 2, real=True), next_fast_len(columns + wide // 2, real=True)]
    # The sum around the first pixel, so that nothing wraps around into the image.
    turned = np.roll(np.pad(kernel, ((0, size[0] - high), (0, size[1] - wide))), (-(high // 2), -(wide // 2)), (0, 1))
    sums = irfft2(rfft2(image, size) * np.conj(rfft2(turned)), size)
    return np.asarray(sums[..., :rows, :columns])


def speckle_maps(psf: imaging.AnyPsf, drift: Drift, *, n_visits: int = N_VISITS) -> SpeckleMaps:
    """Return the maps by Monte Carlo over visits: a few seconds a band, once; they are kept in the cache.

    Parameters
    ----------
    psf : Psf
        Optics of one band; maps of an external PSF, which has no wavefront, are 0, and those of a table are of the
        residual of its visits.
    drift : Drift
        Its ``visit_nm`` is the unit of offset, its slope that of the screens.
    n_visits : int
        At least 32.

    Raises
    ------
    InputError
        With fewer visits.
    """
    if n_visits < 32:
        raise InputError("n_visits", n_visits, allowed="at least 32")
    tabled, weights = isinstance(psf, imaging.TablePsf), filter_kernel(psf)
    visit_nm = 1.0 if tabled else drift.visit_nm or drift.walk_nm_per_sqrt_hour
    if not visit_nm > 0 or (isinstance(psf, imaging.ExternalPsf) and not tabled):
        nominal = np.where(psf.geometry.hole, np.asarray(psf.on_axis, float), 0.0)
        empty = np.zeros(nominal.shape)
        return SpeckleMaps(empty, empty, nominal, empty, 0.0, 0.0, visit_nm, 0, weights)
    optics = cast(imaging.Psf | imaging.TablePsf, psf)
    unit = _unit_maps(_Keyed(_key(optics, drift, n_visits), optics, drift, n_visits))
    return SpeckleMaps(
        linear=visit_nm**2 * unit["linear"],
        square=visit_nm**4 * unit["square"],
        nominal=unit["nominal"],
        stray=visit_nm**2 * unit["stray"],
        tail_square=float(unit["tails"][0]),
        tail_cross=float(unit["tails"][1]),
        visit_nm=visit_nm,
        n_visits=n_visits,
        kernel=weights,
    )


def _key(psf: imaging.Psf | imaging.TablePsf, drift: Drift, n_visits: int) -> str:
    """Return everything that decides the maps."""
    optics = imaging.metrics_key(psf.instrument, psf.band)
    if isinstance(psf, imaging.TablePsf):
        return content_hash({"table": optics, "drift": drift.model_dump(mode="json")})
    spectrum = None
    if psf.spectrum is not None:
        arrays = (psf.spectrum.wavelength_nm, psf.spectrum.photlam)
        spectrum = hashlib.sha256(b"".join(np.asarray(part, "<f8").tobytes() for part in arrays)).hexdigest()
    return content_hash(
        {
            "schema": SCHEMA,
            "optics": optics,
            "knobs": psf.knobs.model_dump(mode="json"),
            "spectrum": spectrum,
            "slope": drift.psd_slope,
            "visits": n_visits,
            "kernel": "matched",
        }
    )


class _Keyed(Record):
    """Optics, drift and visits that count as equal to any others of their key."""

    key: str
    psf: imaging.Psf | imaging.TablePsf = field(compare=False)
    drift: Drift = field(compare=False)
    n_visits: int


@functools.lru_cache(maxsize=16)
def _unit_maps(keyed: _Keyed) -> Mapping[str, FloatArray]:
    """Return the maps of an offset of 1 nm: of a table, from the cache, or measured."""
    psf = keyed.psf
    if isinstance(psf, imaging.TablePsf):
        return _maps_of_table(psf, keyed.drift, keyed.n_visits)
    names = ("linear", "square", "nominal", "stray", "tails")
    return compute_once(
        f"speckles-{keyed.key}",
        lambda: _measured(psf, keyed.drift.psd_slope, keyed.n_visits),
        lambda found: {name: found[name] for name in names},
    )


def _hole_axes(hole: BoolArray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the rows and the columns that have pixels of the hole."""
    return np.flatnonzero(hole.any(axis=1)), np.flatnonzero(hole.any(axis=0))


def _measured(psf: imaging.Psf, slope: float, n_visits: int) -> dict[str, FloatArray]:
    announce(f"measuring how drift moves the speckles in {psf.band}, once: some seconds")
    hole, imager = psf.geometry.hole, psf.imager
    offset = imaging.centred_axis(len(hole), imager.pixel_scale_arcsec)
    axes = [imager.axis(offset[part], masked=True) for part in _hole_axes(hole)]
    responses = imaging.visit_responses(imager, axes[0], axes[1], slope, n_visits, _SEED)
    return _filtered_maps(hole, filter_kernel(psf), responses)


def _maps_of_table(psf: imaging.TablePsf, drift: Drift, n_visits: int) -> dict[str, FloatArray]:
    """Return the maps of a table: of visits of an hour, each with half of what is left of a pair."""
    place, hole = psf.figures.floor_separation_arcsec, psf.geometry.hole
    left = programme_law(psf.figures, drift, place, _ANNULUS_LAMBDA_D).law(1.0, 1.0).variance(_HOUR_S)
    box, rng = np.ix_(*_hole_axes(hole)), stream(_SEED, "table")
    half = np.broadcast_to(0.5 * left, place.shape)
    moved = np.array([psf.moved(place, half, rng)[box] for _ in range(n_visits)])
    linear = 2.0 * psf.field[box] * moved.real
    return _filtered_maps(hole, filter_kernel(psf), (psf.on_axis[box], linear, np.abs(moved) ** 2))


def _filtered_maps(hole: BoolArray, kernel: FloatArray, responses: tuple[FloatArray, ...]) -> dict[str, FloatArray]:
    """Return the maps from the star behind the mask and both changes of its light, on rows and columns of the hole."""
    rows, columns = _hole_axes(hole)
    # Kernels at an edge reach over the cross: filtered on the whole box of the hole.
    box = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    inside = hole[box]
    place = np.ix_(rows - rows[0], columns - columns[0])
    spread = matched_sum(inside.astype(float), kernel**2)[inside]

    def filtered(images: FloatArray) -> FloatArray:
        whole = np.zeros((len(images), *inside.shape))
        whole[(slice(None), *place)] = images
        sums = matched_sum(np.where(inside, whole, 0.0), kernel)[:, inside]
        return np.asarray(sums - sums.mean(axis=0))

    def on_stamp(pixels: tuple[Any, ...], values: FloatArray) -> FloatArray:
        stamp = np.zeros(hole.shape)
        stamp[pixels] = values
        return np.where(hole, stamp, 0.0)

    linear, square = filtered(responses[1]), filtered(responses[2])
    of_linear, of_square, both = (np.mean(part, axis=0) for part in (linear**2, square**2, linear * square))
    # Joint cumulants of order 4, in units of those of a Laplace law: 3 variance^2, for the difference of two visits.
    fourth = float(np.sum((square**4).mean(axis=0) - 3.0 * of_square**2) / (6.0 * np.sum(of_square**2)))
    crossed = np.sum((linear**2 * square**2).mean(axis=0) - of_linear * of_square - 2.0 * both**2)
    tails = [max(fourth, 0.0), max(float(crossed / (2.0 * np.sum(of_linear * of_square))), 0.0)]
    sampled, box_shape = np.ix_(rows, columns), (rows.size, columns.size)
    return {
        "linear": on_stamp(np.nonzero(hole), 2.0 * of_linear / spread),
        "square": on_stamp(np.nonzero(hole), 2.0 * of_square / spread),
        "nominal": on_stamp(sampled, responses[0].reshape(box_shape)),
        "stray": on_stamp(sampled, responses[2].mean(axis=0).reshape(box_shape)),
        "tails": np.array(tails),
    }


def whole_kernels(region: BoolArray, kernel: FloatArray) -> BoolArray:
    """Return the centres of the kernels that lie wholly in a region.

    Parameters
    ----------
    region : ndarray of bool
    kernel : ndarray
        Smaller than the region; it counts where it is above 0.
    """
    from scipy.ndimage import binary_erosion

    return np.asarray(binary_erosion(region, structure=kernel > 0))


def mirror_share(image: FloatArray, kernel: FloatArray, region: BoolArray) -> float:
    """Return the part of the residual at the opposite place that is best subtracted: least squares in a region.

    Parameters
    ----------
    image, kernel : ndarray
    region : ndarray of bool
        Of the shape of the image.
    """
    places = whole_kernels(region, kernel)
    sums = matched_sum(image, kernel)
    here, there = sums[places], sums[::-1, ::-1][places]
    here, there = here - here.mean(), there - there.mean()
    return float(here @ there / (there @ there)) if np.count_nonzero(places) > 1 and there.any() else 0.0


REPORTED_SIGMA = 2.5
_MARGIN = 0.3  # by which a source lifts the noise that it is counted in
_EXCLUDED_LAMBDA_D = 1.22  # radius around a source whose pixels do not tell the noise
_TABLED_SNR, _TABLE = 12.0, (60, 30)
_SMALL_CHANGE = 0.1  # of a logarithm, whose square is the error of one step
_EVERYWHERE = slice(None)
_ROUNDS = 5  # of a fit whose weights are its own, after which it changes by less than 1 %
_LEAST_DYNAMIC = 1e-6  # noise that is assumed beside the brightest pixel of a residual without any


class Peak(Record):
    """A local maximum in the noise without it; see `cpic_planner.validation.search.Candidate`.

    ``place`` is the number of its position, ``noise`` the fit of the noise by which it is judged.
    """

    x_pixel: float
    y_pixel: float
    snr: float
    flux_e: float
    place: int
    noise: "NoiseFit"
    significance: float = math.nan
    laplace: float = math.nan
    dof: float = math.nan


class FilteredState(Record, eq=False):
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


class Candidate(Record):
    """One peak of the significance map.

    Attributes
    ----------
    x_arcsec, y_arcsec : float
        Place from the star on the detector, refined between pixels by parabolas; x grows with the column.
    x_pixel, y_pixel : float
        The same in pixels of the stamp.
    separation_arcsec : float
        Distance from the star.
    snr_mf : float
        Matched-filtered flux over its standard deviation, estimated from the residual without this source.
    significance : float
        Level of a standard normal variate that noise at this place reaches as rarely: heavy tails and the error of the
        estimated noise are in it.
    flux_e : float
        Electrons of the source on the clear disc (before mask, apodizer and aperture), from the unmasked image: low
        beside the mask.
    false_alarms : float
        Number of noise peaks that a search of this region expects at or above this one.
    detected : bool
        Whether ``snr_mf`` reaches ``threshold``.
    law : tuple of float
        Significance of a detection, and the law of noise here: `cpic_planner.etc.snr_at`.
    """

    x_arcsec: float
    y_arcsec: float
    x_pixel: float
    y_pixel: float
    separation_arcsec: float
    snr_mf: float
    significance: float
    flux_e: float
    false_alarms: float
    detected: bool
    law: tuple[float, float, float, float]

    @functools.cached_property
    def threshold(self) -> float:
        """The ``snr_mf`` that a detection needs here."""
        return float(snr_at(*self.law)[0])


class BlindSearch(Record, eq=False):
    """The findings of a search.

    Attributes
    ----------
    candidates : tuple of Candidate
        Peaks of 2.5 sigma and more, brightest first; empty where the threshold is undefined.
    threshold : Outcome of float
        Least `Candidate.significance` of a detection; ``unreachable`` in a region too small to know its noise.
    sigma : float
        Gaussian significance that was asked for.
    region : SearchedRegion
        Positions that were searched.
    roughness : float
        Variance of the gradient of the significance map, per square pixel; 0 where undefined.
    white_level : float
        White noise found over predicted, in variance.
    drift_nm : float
        Wavefront offset of a visit that explains the speckles; 0 where the optics know no drift.
    dof : float
        Degrees of freedom of the variance, median over the region.
    sigma_e : ndarray, shape (n, n)
        Standard deviation of the flux of a source at every searched position, electrons on the clear disc; 0 elsewhere.
    snr_map : ndarray, shape (n, n)
        Flux over that; 0 elsewhere. Sources that were taken out are not in it.
    at_places : tuple of Candidate
        What the map shows at the places that were asked for: one trial each, whose threshold is ``sigma``.
    """

    candidates: tuple[Candidate, ...]
    threshold: Outcome[float]
    sigma: float
    region: SearchedRegion
    roughness: float
    white_level: float
    drift_nm: float
    dof: float
    sigma_e: FloatArray
    snr_map: FloatArray
    at_places: tuple[Candidate, ...] = ()

    @property
    def detections(self) -> tuple[Candidate, ...]:
        """Candidates above their threshold."""
        return tuple(candidate for candidate in self.candidates if candidate.detected)

    def near(self, x_arcsec: float, y_arcsec: float, reach_arcsec: float) -> list[Candidate]:
        """Return the candidates within reach of a place.

        Parameters
        ----------
        x_arcsec, y_arcsec : float
            Offsets from the star on the detector.
        reach_arcsec : float
        """
        return [
            one
            for one in self.candidates
            if math.hypot(one.x_arcsec - x_arcsec, one.y_arcsec - y_arcsec) <= reach_arcsec
        ]

    def apart_from(
        self, places_arcsec: Sequence[tuple[float, float]], geometry: imaging.BandGeometry
    ) -> list[Candidate]:
        """Return the candidates that are no detection of a source at one of some places, offsets on the detector."""
        reach = MATCH_LAMBDA_D * geometry.lambda_d_arcsec
        near = [id(one) for place in places_arcsec for one in self.near(*place, reach)]
        return [one for one in self.candidates if id(one) not in near]

    def strongest_near(self, x_arcsec: float, y_arcsec: float, geometry: imaging.BandGeometry) -> Candidate | None:
        """Return the strongest candidate that is as near to a place as a detection of a planet there; None without one.

        Parameters
        ----------
        x_arcsec, y_arcsec : float
            Offsets from the star on the detector.
        geometry : BandGeometry
        """
        near = self.near(x_arcsec, y_arcsec, MATCH_LAMBDA_D * geometry.lambda_d_arcsec)
        return max(near, key=lambda item: item.snr_mf, default=None)


class Searcher:
    """A search for sources everywhere in the dark hole, ready for an image of a stack or several.

    Parameters
    ----------
    stack : ReducedStack
    psf : Psf
        Its unmasked image is the template of a source.
    maps : SpeckleMaps
        Of this PSF, with the filter (`cpic_planner.validation.search.speckle_maps`).
    star_rate_e_s : float
        Detected rate of the star on the clear pupil, above 0.
    sigma : float
        Gaussian significance, 2.5 to 20, that states the false-alarm probability. By default noise passes for a source
        with this probability in each resolution element of ``(lambda/D)^2``, as in `detection_threshold`.
    known : sequence of (x_arcsec, y_arcsec)
        Sources that are neither reported nor allowed to count as noise.
    visits, reference_visits : int
        Visits that the science images of the stack, in their order, and all its references come from; each has a
        wavefront of its own. At least 1.
    common_fraction : float
        Believed rms, over that of a visit's offset, of the wavefront by which science and reference differ in every
        visit (`Drift.common_fraction`): it is fitted, from a prior around this number; 0 for none. 0 to 1.
    known_light_e_s : ndarray, shape (n, n), optional
        Light on the stamp that is no planet's nor the star's, such as the wings of another star; even by default.

    Raises
    ------
    InputError
        If an argument is out of range or a pixel is not finite.

    Notes
    -----
    The variance of a matched-filtered pixel is ``level white + drift linear + drift^2 square`` with the shapes of white
    noise, of ``2 Re(E0* dE)`` and of ``|dE|^2``; both factors are fitted to the residual, for each candidate without
    the disc of 1.22 lambda/D around it and, as far as speckles rule there, around its mirror image: pupil phases make
    pairs. V science and R reference visits leave (1/V + 1/R)/2 of the last two terms, and a part that all visits share;
    how the visits scatter around their mean, where no planet and nothing common is left, tells the noise V - 1 times
    over. The law of a position is Gaussian noise plus Laplace variates, one for each of `effective_visits` pairs, of
    the same kurtosis, over the error of the fit;
    as an equivalent Gaussian field it has the threshold of `search_threshold`. Up to ten sources beyond 5 sigma are
    subtracted, brightest first, before others are looked for. ``sep`` finds the peaks of the matched-filtered image.

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
        Laplace variates in the noise.
    visit_nm : float
        Wavefront offset of a visit where its fitted number is 1; 0 where the optics know no drift.
    """

    def __init__(
        self,
        stack: ReducedStack,
        psf: imaging.AnyPsf,
        maps: SpeckleMaps,
        *,
        star_rate_e_s: float,
        sigma: float = 5.0,
        known: Sequence[tuple[float, float]] = (),
        visits: int = 1,
        reference_visits: int = 1,
        common_fraction: float = 0.0,
        known_light_e_s: FloatArray | None = None,
    ) -> None:
        check_positive("star_rate_e_s", star_rate_e_s, "e-/s")
        if not REPORTED_SIGMA <= sigma <= MAX_SIGMA:
            raise InputError("sigma", sigma, unit="sigma", allowed=f"{REPORTED_SIGMA:g} to {MAX_SIGMA:g}")
        for key, number in (("visits", visits), ("reference_visits", reference_visits)):
            check_whole(key, number, 1, MAX_VISITS)
        checked_scalar("common_fraction", common_fraction, low=0.0, high=1.0)
        image = checked_image(stack.image_e)
        if maps.linear.shape != image.shape:
            raise InputError("maps", maps.linear.shape, unit="px", allowed=f"maps of {image.shape}")
        self._stack, self._psf, self._maps = stack, psf, maps
        self._visits, self._references, self._common_fraction = visits, reference_visits, common_fraction
        self.sigma, self.visit_nm = sigma, maps.visit_nm if maps.n_visits else 0.0
        self.pairs, star_e = float(effective_visits(visits, reference_visits)), star_rate_e_s * stack.integration_s
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
        lights = [maps.nominal, maps.stray, *([] if known_light_e_s is None else [known_light_e_s])]
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
        self.terms = self._terms_of(white, star_e**2 * linear, star_e**2 * square, own=False)
        self._within = self._terms_of(white, star_e**2 * linear, star_e**2 * square, own=True)
        # Neighbours share their noise: one position in four tells as much of the scatter of visits.
        self._thin = (self._y % 2 == 0) & (self._x % 2 == 0)
        self._within = self._within.at(self._thin)
        self._both = self.terms.beside(self._within)
        self._scatter, self._scatter_before = self._visit_scatter()
        for x_arcsec, y_arcsec in known:
            self.exclude(*self.pixel_of(x_arcsec, y_arcsec))

    def _terms_of(self, white: FloatArray, linear: FloatArray, square: FloatArray, *, own: bool) -> NoiseTerms:
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
        visits, references, fraction = self._visits, self._references, self._common_fraction
        science, reference = 0.5 / visits, 0.5 / references
        both, shared = science + reference, 0.5 * fraction**2 * linear
        if own:
            white, both, shared = references / (visits + references) * white, science, 0.0 * linear
        return NoiseTerms(white, both * linear, both * square, shared if fraction > 0 and visits > 1 else None)

    def anew(self) -> "Searcher":
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
        believed, weights = self._common_fraction**2, self.free * self._stray / variance
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
        visits = self._visits
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
        many = 4.0 * self.weight(within, logs, self._within) * (self._visits - 1) / heavy
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
    ) -> Peak:
        """Return a place with its SNR by the noise without it, not yet judged.

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
        return Peak(x_pixel, y_pixel, snr, height * float(state.sigma_e[place]), place, alone)

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

    def _judged(self, maxima: Sequence[Peak]) -> list[Peak]:
        """Return maxima with their significance, each in the noise of its fit."""
        laplace, dof = ([float(law(one.noise, one.place)) for one in maxima] for law in (self.laplace, self.dof))
        sigma = equivalent_sigma([one.snr for one in maxima], laplace, dof, self.pairs).tolist()
        return [
            replace(one, significance=level, laplace=share, dof=free)
            for one, level, share, free in zip(maxima, sigma, laplace, dof, strict=True)
        ]

    def with_final_noise(self, peaks: Sequence[Peak], state: FilteredState) -> list[Peak]:
        """Return the same sources in the noise that is known once all are out."""
        levels = (float(state.sigma_e[peak.place]) for peak in peaks)
        return self._judged(
            [replace(peak, snr=peak.flux_e / level, noise=state.fit) for peak, level in zip(peaks, levels, strict=True)]
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

    def search(self, image_e: FloatArray, places_arcsec: Sequence[tuple[float, float]] = ()) -> BlindSearch:
        """Look for sources in an image.

        Parameters
        ----------
        image_e : ndarray, shape (n, n)
            Residual of the stack, or the same with planets that were put in: its noise is the stack's.
        places_arcsec : sequence of (x, y)
            Known places in the searched region that are judged one by one, the others taken out.
        """
        field, image = self.anew(), checked_image(image_e)
        if field.samples < _LEAST_SAMPLES:
            text = f"{field.samples:.3g} independent samples of noise: too few to know the noise"
            threshold: Outcome[float] = Outcome.refuse(Status.UNREACHABLE, Reason.TOO_FEW_ELEMENTS, text, unit="sigma")
            zero = np.zeros(image.shape)
            return BlindSearch((), threshold, self.sigma, field.size, 0.0, 1.0, 0.0, 0.0, zero, zero)
        peaks: list[Peak] = []
        while True:
            state = field.measure(image)
            level = search_threshold(field.size, state.roughness, sigma=self.sigma)
            found = field.peaks(state)
            clean = max(_CLEANED_SIGMA, level.unwrap())
            if not found or found[0].significance < clean or len(peaks) >= _MAX_CLEANED:
                break
            peaks.append(found[0])
            image = image - field.source(found[0])
            field.exclude(found[0].x_pixel, found[0].y_pixel)
        known = field._known(image, state, peaks, places_arcsec)
        peaks = field.with_final_noise(peaks, state)
        peaks += [peak for peak in found if peak.significance >= REPORTED_SIGMA]
        candidates = [field._candidate(peak, level.unwrap(), state.roughness) for peak in peaks]
        return BlindSearch(
            candidates=tuple(sorted(candidates, key=lambda one: -one.snr_mf)),
            threshold=level,
            sigma=self.sigma,
            region=field.size,
            roughness=state.roughness,
            white_level=math.exp(state.fit.logs[0]),
            drift_nm=self.visit_nm * math.exp(0.5 * state.fit.logs[1]),
            dof=float(np.median(field.dof(state.fit))),
            sigma_e=field.unfold(state.sigma_e),
            snr_map=field.unfold(state.snr),
            at_places=known,
        )

    def _known(
        self,
        image: FloatArray,
        state: FilteredState,
        peaks: Sequence[Peak],
        places_arcsec: Sequence[tuple[float, float]],
    ) -> tuple[Candidate, ...]:
        """Return what stands at known places; peaks are out of field, image and state, lest wings count as noise."""
        found = []
        for number, place in enumerate(places_arcsec):
            field, seen, (x, y) = self.anew(), state, self.pixel_of(*place)
            others = [*places_arcsec[:number], *places_arcsec[number + 1 :]]
            if others:
                for other in others:
                    field.exclude(*field.pixel_of(*other))
                seen = field.measure(image)
            # Noise moves a peak: what is not resolved from the place is its own, whichever pixel is the highest.
            near = (math.hypot(peak.x_pixel - x, peak.y_pixel - y) for peak in peaks)
            own = [peak for peak, apart in zip(peaks, near, strict=True) if apart <= field.lambda_d_pixels]
            found.append(self._candidate(field.at(seen, x, y, own), self.sigma, state.roughness))
        return tuple(found)

    def _candidate(self, peak: Peak, level: float, roughness: float) -> Candidate:
        """Return a peak as a candidate of a search whose detections reach a level."""
        x_arcsec, y_arcsec = self.offset_arcsec(peak)
        return Candidate(
            x_arcsec=x_arcsec,
            y_arcsec=y_arcsec,
            x_pixel=peak.x_pixel,
            y_pixel=peak.y_pixel,
            separation_arcsec=math.hypot(x_arcsec, y_arcsec),
            snr_mf=peak.snr,
            significance=peak.significance,
            flux_e=peak.flux_e,
            false_alarms=float(false_alarms(max(peak.significance, 1.0), self.size, roughness)),
            detected=peak.significance >= level,
            law=(level, peak.laplace, peak.dof, self.pairs),
        )


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


MATCH_LAMBDA_D = 0.5
"""A detection this close to a planet's place is the planet."""

_CLEANED_SIGMA = 5.0  # sources that are taken out before others are looked for
_MAX_CLEANED = 10
_LEAST_SAMPLES = 3.0
MAX_VISITS = 10_000


def search(stack: ReducedStack, psf: imaging.AnyPsf, maps: SpeckleMaps, **how: Any) -> BlindSearch:
    """Look for sources everywhere in the dark hole of a stack; arguments as of `Searcher`.

    Parameters
    ----------
    stack, psf, maps, how
        As of `Searcher`.
    """
    return Searcher(stack, psf, maps, **how).search(stack.image_e)
