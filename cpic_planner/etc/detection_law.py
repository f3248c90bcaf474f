"""Probability that a search detects a planet, from the statistic that it compares: nothing in it is fitted to images.

The search compares a matched-filtered residual, over the standard deviation that it estimates, with a threshold
(`cpic_planner.validation.detection`). For a planet of the significance ``S`` in its aperture, at a place where white
noise is the share ``w`` of the variance, the cross term of the wavefront's errors with the static field ``c`` and the
light of the errors ``l``, these have closed forms (``F`` of `PsfMetrics.filter_square`, ``m`` the mean's variance):

    v     = w + c f_c + l f_l                         noise through the filter; f of `PsfMetrics.filter_linear`
    mu    = S g / sqrt(v)                             signal over noise; g of `PsfMetrics.filter_gain`
    f_l   = F (1 - m / b) / mean(1 - m / b)           apertures, of variance b, are measured less the mean of the hole
    peak  = sqrt(mu^2 + 2), or mu at a known place    a maximum over two coordinates
    rel   = s' I^-1 s                                 relative variance of the noise estimate; s slopes of ln v
    tau   = snr_at(level, laplace, 2 / rel, visits)   threshold; laplace from the kurtosis of the errors' light
    P     = Phi((peak - tau) / sqrt(1 + own + tau^2 rel / 4))

``I`` is the information of all places of the hole but the planet's disc and, as far as speckles rule, its mirror image,
and of the scatter of the visits, on the level of the white noise and the drift, by which ``s`` are slopes. The cross
term varies from place to place: P is the mean over fifths of the places at a separation.
"""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpic_core import ArrayLike, FloatArray, special
from cpic_planner.etc.detection import near_threshold
from cpic_planner.etc.model import EtcModel
from cpic_planner.etc.noise import StackNoise
from cpic_planner.etc.search_level import MIN_SIGMA, search_threshold, searched_region
from cpic_planner.etc.tails import equivalent_sigma
from simulator.imaging import PsfMetrics, centred_axis
from simulator.signal import annulus_floor, error_light_share

PRIOR_WHITE, PRIOR_DRIFT = 0.25, 1.0
"""Standard deviations of the logarithms of level and squared drift before a residual is seen."""
MAP_VISITS = 256
"""Visits behind the maps of speckles that a search assumes."""
LAW_ERROR = 0.03
"""Relative standard error of the significance at which half of the planets are found (`reports/detection_law`)."""
_REACH = 3.0
"""Places that a speckle of the light correlates with, over those of the filter: 3/2 of a Gaussian, at mirror places."""
_CROSSED = 0.6
"""Kurtosis of the product of cross term and light over that of the light: 0.53 in F520, 0.47 to 0.64 in the others."""
_SHARES, _LIGHTS, _VISITS = 8, 4, 11  # one and two visits are nearly nodes
_MOST_SHARE, _LEAST_VISITS, _EXCLUDED = 0.9999, 0.5, 1.22
_TAILS, _RELATIVES, _MOST_RELATIVE = 7, 6, 0.4
_LEVELS = 1.0, 1.12
_APART, _FAR, _BETWEEN = 0.15, 2.0, 3
_TOGETHER = 16384  # numbers that are looked up at once: they stay in the cache
_STEPS, _BESIDE, _LOWEST, _HIGHEST = 20, 0.15, 0.5, 1e3


@dataclass(frozen=True, eq=False)
class SearchLaw:
    """Law of detections of one band; made by `band_law`.

    Attributes
    ----------
    separation_arcsec : ndarray, shape (r,)
    log_half, fainter, brighter : ndarray, shape (2, l, s, r, v)
        Logarithm of the significance at which half of the planets are detected, blind and at a known place, and widths
        of the law in it to either side: by separation and inverse root of the number of visits, the polynomials in the
        roots of the share of the errors' light in the speckles and of that of the speckles in the variance. Along
        polynomials no valley opens that the law has not.
    """

    separation_arcsec: FloatArray
    log_half: FloatArray
    fainter: FloatArray
    brighter: FloatArray

    def _read(self, tables: Sequence[FloatArray], *where: ArrayLike) -> FloatArray:
        """Return tables at separations, shares of speckles and of their light, and numbers of visits."""
        parts = [np.asarray(part, float) for part in where]
        shape = np.broadcast_shapes(*(part.shape for part in parts)) or (1,)
        found = np.empty((len(tables), *shape))
        step = max(_TOGETHER * shape[0] // max(found[0].size, 1), 1)
        for block in (slice(start, start + step) for start in range(0, shape[0], step)):
            some = (part[block] if part.ndim == len(shape) and len(part) > 1 else part for part in parts)
            self._fill(found[:, block], tables, *some)
        return found if any(part.ndim for part in parts) else found[:, 0]

    def _fill(
        self,
        found: FloatArray,
        tables: Sequence[FloatArray],
        place: FloatArray,
        speckled: FloatArray,
        light: FloatArray,
        visits: FloatArray,
    ) -> None:
        """Write what `_read` returns, of so many numbers that all stay in the cache."""
        many = np.sqrt(_LEAST_VISITS / np.maximum(visits, _LEAST_VISITS)) * (_VISITS - 1)
        rows = np.interp(place, self.separation_arcsec, np.arange(self.separation_arcsec.size)), many
        sizes = self.log_half.shape[-2:]
        ends = []
        for row, size in zip(rows, sizes, strict=True):
            low = np.minimum(row.astype(np.intp), size - 2)
            ends.append(((low, 1.0 - (row - low)), (low + 1, row - low)))
        # A few places or numbers of visits are looked up once, for all the others that they go with.
        few = int(rows[1].size < rows[0].size)
        once = rows[few].size * sizes[1 - few] <= np.broadcast(*rows).size
        if once:
            number = np.arange(rows[few].size).reshape(rows[few].shape)
            corners = [(at * number.size + number, weight) for at, weight in ends[1 - few]]
        else:
            corners = [(i * sizes[1] + j, f * g) for i, f in ends[0] for j, g in ends[1]]
        x, y = (2.0 * np.sqrt(np.fmin(np.fmax(part, 0.0), 1.0)) - 1.0 for part in (speckled, light))
        for whole, table in zip(found, tables, strict=True):
            columns = table if few or not once else table.swapaxes(-1, -2)
            if once:
                columns = sum(columns[..., at.ravel()] * weight.ravel() for at, weight in ends[few])
            whole[...] = 0.0
            for of_light in columns.reshape(*table.shape[:2], -1)[::-1]:
                coefficients = of_light.take(corners[0][0], axis=1)
                coefficients *= corners[0][1]
                for at, weight in corners[1:]:
                    coefficients += of_light.take(at, axis=1) * weight
                value = np.empty(whole.shape)
                value[...] = coefficients[-1]
                for coefficient in coefficients[-2::-1]:
                    value *= x
                    value += coefficient
                np.multiply(whole, y, out=whole)
                np.add(whole, value, out=whole)

    def half(
        self, separation_arcsec: ArrayLike, speckled: ArrayLike, light: ArrayLike, visits: ArrayLike, *, at_place: bool
    ) -> FloatArray:
        """Return the significance at which half of the planets are detected.

        Parameters
        ----------
        separation_arcsec : array_like
        speckled : array_like
            Share of the variance that does not average with time (`speckled_share`), 0 to 1.
        light : array_like
            Share of the errors' light in that (`lit_share`).
        visits : array_like
            Independent wavefronts behind the noise (`effective_visits`), above 0.
        at_place : bool
            Planets are looked for at a known place.
        """
        where = separation_arcsec, speckled, light, visits
        return np.asarray(np.exp(self._read([self.log_half[int(at_place)]], *where)[0]))

    def reach(
        self,
        significance: ArrayLike,
        own: ArrayLike,
        separation_arcsec: ArrayLike,
        speckled: ArrayLike,
        light: ArrayLike,
        visits: ArrayLike,
        *,
        at_place: bool,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the logarithm of the significance over that of half the planets, and the width of the law in it.

        Parameters
        ----------
        significance : array_like
            Predicted, of the aperture; 0 for no visit.
        own : array_like
            Variance of the planet's own light over that of the noise (`own_share`).
        separation_arcsec, speckled, light, visits, at_place
            As of `half`.
        """
        tables = [table[int(at_place)] for table in (self.log_half, self.fainter, self.brighter)]
        log_half, low, high = self._read(tables, separation_arcsec, speckled, light, visits)
        with np.errstate(divide="ignore"):
            reached = np.log(np.asarray(significance, float)) - log_half
        # Beyond one half the excess is linear in the significance: a lower threshold never detects fewer.
        bright = np.clip(reached, 1e-9, 50.0)
        width2 = np.where(reached < 0.0, low, high * math.expm1(_BESIDE) / _BESIDE) ** 2 + own * np.exp(-2.0 * log_half)
        return reached, np.sqrt(width2) * bright / np.expm1(bright)

    def probability(self, *of: Any, at_place: bool) -> FloatArray:
        """Return the probability of a detection; arguments as of `reach`."""
        reached, width = self.reach(*of, at_place=at_place)
        return np.asarray(special().ndtr(reached / width))

    def least(self, separation_arcsec: ArrayLike, probability: float) -> FloatArray:
        """Return a significance below which nothing is detected with that probability, in any noise."""
        least = np.interp(np.asarray(separation_arcsec, float), self.separation_arcsec, _least_logs(self, probability))
        return np.asarray(np.exp(least))


@functools.lru_cache(maxsize=64)
def _least_logs(law: SearchLaw, probability: float) -> FloatArray:
    """Return the logarithm of the least significance in any noise, at the separations of a law."""
    many = (_LEAST_VISITS / np.maximum(_grid(_VISITS), 1e-3) ** 2)[:, None]
    shares = _nodes(_SHARES)[:, None, None, None] ** 2, _nodes(_LIGHTS)[:, None, None] ** 2
    where = law.separation_arcsec, *shares, many
    far = special().ndtri(probability)
    lowest = law._read(list(law.log_half), *where) + far * law._read(list(law.fainter), *where)
    return np.asarray(np.min(lowest, axis=(0, 1, 2, 3)))


def band_law(model: EtcModel, band: str) -> SearchLaw:
    """Return the law of a band of a model.

    Parameters
    ----------
    model : EtcModel
        Its strategy has the level of a detection.
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    return _law(model.metrics[band], model.strategy.annulus_lambda_d, model.strategy.sigma)


def needed_margin(
    model: EtcModel,
    band: str,
    separation_arcsec: ArrayLike,
    speckled: ArrayLike,
    light: ArrayLike,
    visits: ArrayLike,
    threshold: FloatArray | None = None,
) -> FloatArray:
    """Return the significance over the small-sample threshold at which half of the observations detect a planet.

    Parameters
    ----------
    model : EtcModel
        Its strategy says whether the search knows the place.
    band : str
    separation_arcsec, speckled, light, visits : array_like
        As of `SearchLaw.half`.
    threshold : ndarray, optional
        Small-sample threshold at the separation; from a table by default (`near_threshold`).

    Returns
    -------
    ndarray
        1 where no threshold is defined.
    """
    if threshold is None:
        threshold = near_threshold(model.metrics[band].resolution_elements(separation_arcsec), model.strategy.sigma)
    known = model.strategy.search == "known_place"
    half = band_law(model, band).half(separation_arcsec, speckled, light, visits, at_place=known)
    return np.where(np.isfinite(threshold), half / threshold, 1.0)


def speckled_share(noise: StackNoise) -> FloatArray:
    """Return the share of the variance that does not average with time."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.nan_to_num(1.0 - noise.white / noise.quiet))


def lit_share(noise: StackNoise, light: ArrayLike) -> FloatArray:
    """Return the share of the errors' light in all that does not average with time.

    Parameters
    ----------
    noise : StackNoise
    light : array_like
        Its share in what visits average (`light_share`): what all visits have in common is taken for the cross term.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        averaged = np.asarray(light, float) * noise.speckle
        return np.asarray(np.nan_to_num(averaged / (noise.quiet - noise.white)))


def own_share(noise: StackNoise) -> FloatArray:
    """Return the variance of the planet's own light, and of the mean background, over that of the noise."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.nan_to_num(np.maximum((noise.significance / noise.snr) ** 2 - 1.0, 0.0)))


def light_share(model: EtcModel, band: str, separation_arcsec: ArrayLike, visit_s: ArrayLike) -> FloatArray:
    """Return the share of the errors' light in the speckles that visits of a length average."""
    metrics, drift, strategy = model.metrics[band], model.instrument.drift, model.strategy
    width, ratio = strategy.annulus_lambda_d, strategy.reference_ratio
    return error_light_share(metrics, drift, separation_arcsec, width, ratio, visit_s, model.timing)


@functools.lru_cache(maxsize=256)
def _equivalents(step: int) -> FloatArray:
    """Return `equivalent_sigma` of the signal over noise of `_log_snr` by number of visits, (v, t, q)."""
    inverse, relative = np.maximum(_inverse_visits(), 1e-9), np.maximum(_MOST_RELATIVE * _nodes(_RELATIVES) ** 2, 1e-9)
    visits, laplace, dof = np.meshgrid(1.0 / inverse, _nodes(_TAILS), 2.0 / relative, indexing="ij")
    with np.errstate(over="ignore"):  # of parts that weigh nothing
        return equivalent_sigma(math.exp(_log_snr(step)), laplace, dof, visits)


def _log_snr(step: int) -> float:
    """Return logarithms that lie the farther apart the straighter tails are in them."""
    return _FAR * math.sinh(step * _APART / _FAR)


@functools.lru_cache(maxsize=32)
def _log_thresholds(sigma: float) -> FloatArray:
    """Return the logarithm of `snr_at` for two levels by number of visits, (2, v, t, q): polynomials, see `_value`."""
    first = math.floor(_FAR / _APART * math.asinh(math.log(sigma) / _FAR)) - _BETWEEN
    steps, most = [first], _LEVELS[1] * sigma
    # Tails are heavier than Gaussian ones: the level is not below.
    while len(steps) < 2 * _BETWEEN or _equivalents(steps[-_BETWEEN]).min() <= most:
        steps.append(steps[-1] + 1)
    known, logs = np.stack([_equivalents(step) for step in steps]), np.array([_log_snr(step) for step in steps])
    found = []
    for level in (part * sigma for part in _LEVELS):
        start = np.count_nonzero(known <= level, axis=0) - _BETWEEN
        near = start + np.arange(2 * _BETWEEN).reshape(-1, 1, 1, 1)
        x, y = np.take_along_axis(known, near, axis=0), logs[near]
        for k in range(1, len(x)):  # Neville's polynomial through the nearest
            y = ((level - x[k:]) * y[:-1] - (level - x[:-k]) * y[1:]) / (x[:-k] - x[k:])
        found.append(y[0])
    return np.asarray(np.einsum("it,jq,kvtq->kvij", *map(_through, (_TAILS, _RELATIVES)), np.stack(found)))


def _value(coefficients: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return polynomials in the nodes' x and y, from 0 to 1; the last axes of the coefficients are their powers."""
    found: Any = 0.0
    for row in np.moveaxis(coefficients, -2, 0)[::-1]:
        value: Any = 0.0
        for coefficient in np.moveaxis(row, -1, 0)[::-1]:
            value = value * (2.0 * y - 1.0) + coefficient[:, None]
        found = found * (2.0 * x - 1.0) + value
    return np.asarray(found)


def _inverse_visits() -> FloatArray:
    return np.asarray(_grid(_VISITS) ** 2 / _LEAST_VISITS)


def _grid(count: int) -> FloatArray:
    return np.linspace(0.0, 1.0, count)


class _Terms:
    """Noise through the filter over white noise, its slopes, and shares of speckles and of Laplace variates.

    Arrays by separation, share, light and place, of cross term and light of the errors over white noise.
    """

    def __init__(self, crossed: FloatArray, light: FloatArray, tails: float) -> None:
        self.whole = 1.0 + crossed + light
        self.level, self.drift = 1.0 / self.whole, (crossed + 2.0 * light) / self.whole
        self.speckled = 1.0 - self.level
        heavy = np.sqrt(tails * light * (light + 2.0 * _CROSSED * crossed)) / self.whole
        self.heavy = np.minimum(heavy, 1.0)


@functools.lru_cache(maxsize=64)
def _law(metrics: PsfMetrics, annulus_lambda_d: float, sigma: float) -> SearchLaw:
    """Return the law of a band; see the module."""
    bins = metrics.floor_separation_arcsec
    ends = metrics.zone.usable_range_arcsec(metrics.aperture_radius_arcsec)
    # Light and filters are linear between the bins of the metrics: no other places are needed.
    place = np.concatenate((ends[:1], bins[(bins > ends[0]) & (bins < ends[1])], ends[1:]))
    local = [np.exp(np.interp(place, bins, part)) for part in metrics.floor_logs()]
    ring = local if metrics.stability(place) is not None else annulus_floor(metrics, annulus_lambda_d, place)
    gain, fifths = (
        np.interp(place, bins, metrics.filter_gain),
        np.stack([np.interp(place, bins, part) for part in metrics.filter_linear.T], axis=-1),
    )
    share = np.minimum(_nodes(_SHARES) ** 2, _MOST_SHARE)[:, None]
    light = _nodes(_LIGHTS) ** 2
    odds = [(share / (1.0 - share) * part)[..., None] for part in (1.0 - light, light)]

    def terms(crossed: FloatArray, square: FloatArray) -> _Terms:
        lit = [share_of * part[:, None, None] for share_of, part in zip(odds, (crossed, square), strict=True)]
        return _Terms(lit[0], lit[1], metrics.filter_tails)

    own, lit = fifths.mean(axis=1), _filtered_light(metrics, local[1])
    hole = terms(*(one * part / of[:, None] for one, part, of in zip(local, (own, lit), ring, strict=True)))
    places = fifths, lit[:, None]
    here = terms(*((one / of)[:, None] * part for one, of, part in zip(local, ring, places, strict=True)))
    relative = _relative_variance(metrics, place, hole, here)
    # Signal over noise through the filter of a planet of the significance 1.
    white = here.level / (1.0 - share[..., None])
    unit = gain[:, None, None, None, None] * np.sqrt(white)[..., None, :]
    region = searched_region(metrics.hole, metrics.lambda_d_arcsec / metrics.pixel_scale_arcsec)
    least = max(sigma, MIN_SIGMA)  # of which the number of peaks is known
    blind = search_threshold(region, metrics.filter_roughness, sigma=least).value or least
    tables = []
    # A maximum over two coordinates lies above the mean.
    for level, gained in ((blind / least, 2.0), (1.0, 0.0)):
        between = (level - _LEVELS[0]) / (_LEVELS[1] - _LEVELS[0])
        lower, upper = _log_thresholds(sigma)
        table = (1.0 - between) * lower + between * upper
        needed = np.exp(_value(table, here.heavy[..., None, :], np.sqrt(relative / _MOST_RELATIVE)))
        tables.append(_middle_and_widths(unit, needed, np.sqrt(1.0 + 0.25 * needed**2 * relative), gained))
    return SearchLaw(place, *(_polynomials(np.stack(parts)) for parts in zip(*tables, strict=True)))


def _nodes(count: int) -> FloatArray:
    """Return points from 0 to 1 through which a polynomial of many terms stays smooth (Chebyshev-Lobatto)."""
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.arange(count) / (count - 1)))


def _through(count: int) -> FloatArray:
    """Return the matrix from values at `_nodes` to the coefficients of their polynomial in ``2 x - 1``."""
    return np.asarray(np.linalg.inv(np.vander(2.0 * _nodes(count) - 1.0, increasing=True)))


def _polynomials(table: FloatArray) -> FloatArray:
    """Return the polynomials through a table at `_nodes`, (2, r, s, l, v): (2, l, s, r, v)."""
    return np.asarray(np.einsum("is,jl,krslv->kjirv", *map(_through, (_SHARES, _LIGHTS)), table))


def _hole_arcsec(metrics: PsfMetrics) -> tuple[FloatArray, FloatArray]:
    """Return the offsets x and y of the pixels of the hole."""
    row, column = np.nonzero(metrics.hole)
    axis = centred_axis(len(metrics.hole), metrics.pixel_scale_arcsec)
    return axis[column], axis[row]


def _filtered_light(metrics: PsfMetrics, floor: FloatArray) -> FloatArray:
    """Return the variance of the errors' light through the filter over that in apertures, ``floor``, at the places."""
    bins, logs = np.log(metrics.floor_separation_arcsec), metrics.floor_logs()[1]
    pixels = np.log(np.hypot(*_hole_arcsec(metrics)))
    inward = (logs[1] - logs[0]) / (bins[1] - bins[0]) * np.minimum(pixels - bins[0], 0.0)
    levels = np.exp(np.interp(pixels, bins, logs) + inward)
    # Apertures are measured less the mean of the hole, which the filter keeps: far out most of the variance is its.
    share = _REACH * metrics.filter_square * metrics.aperture_pixels / pixels.size
    mean = share / (1.0 - share) * levels.mean()
    alone, everywhere = (np.maximum(1.0 - mean / part, 0.1) for part in (floor, levels))
    return np.asarray(metrics.filter_square * alone / everywhere.mean())


def _relative_variance(metrics: PsfMetrics, place: FloatArray, hole: _Terms, here: _Terms) -> FloatArray:
    """Return the relative variance of the noise that a search estimates at places, by number of visits too.

    Parameters
    ----------
    metrics : PsfMetrics
    place : ndarray
        Separations, arcsec.
    hole : _Terms
        At all of them: what tells level and drift.
    here : _Terms
        At the places that are judged.
    """
    x, y = _hole_arcsec(metrics)
    rings = np.searchsorted(np.sqrt(place[1:] * place[:-1]), np.hypot(x, y)) == np.arange(place.size)[:, None]
    diagonal = (place / math.sqrt(2.0))[:, None]
    near = np.hypot(x - diagonal, y - diagonal) < _EXCLUDED * metrics.lambda_d_arcsec
    room, taken = (part @ rings.T.astype(float) / metrics.filter_positions for part in (np.ones(x.size), near))
    once = room / (1.0 + hole.speckled**2)
    # A sample variance of V visits is worth V - 1 squares of one, fewer where the light of errors is skewed.
    again = once / (1.0 + 3.0 * hole.heavy**2)
    # Neither the disc around a planet nor, as far as speckles rule, its mirror image tells the noise there.
    once = np.maximum(once - taken[:, None, None], 0.0)
    more = np.maximum(1.0 / np.maximum(_inverse_visits(), 1e-4) - 1.0, 0.0)

    def known(product: FloatArray, prior: float) -> FloatArray:
        """Return an element of the information on level and drift."""
        single, every = (0.5 * np.sum(part * product, axis=-1)[..., None] for part in (once, again))
        return np.asarray(single + more * every + prior)[..., None]

    of_level, of_drift = known(hole.level**2, PRIOR_WHITE**-2), known(hole.drift**2, PRIOR_DRIFT**-2)
    both = known(hole.level * hole.drift, 0.0)
    level, drift = here.level[..., None, :], here.drift[..., None, :]
    relative = of_drift * level**2 - 2.0 * both * level * drift + of_level * drift**2
    of_maps = 2.0 / MAP_VISITS * here.speckled**2 * (1.0 + 1.5 * here.heavy**2)
    return np.asarray(relative / (of_level * of_drift - both**2) + of_maps[..., None, :])


def _middle_and_widths(
    unit: FloatArray, needed: FloatArray, spread: FloatArray, gained: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the logarithm of the significance of a chance of one half, and the widths of the law below and above.

    Parameters
    ----------
    unit, needed, spread : ndarray
        Signal over noise of the significance 1, threshold, and standard deviation, at each of the places (last axis).
    gained : float
        Square that the maximum adds.
    """
    ndtr, ndtri = special().ndtr, special().ndtri

    def chance(log_significance: FloatArray) -> FloatArray:
        peak = np.sqrt((np.exp(log_significance)[..., None] * unit) ** 2 + gained)
        return np.asarray(ndtr((peak - needed) / spread).mean(axis=-1))

    low = np.full(needed.shape[:-1], math.log(_LOWEST))
    high = np.full(low.shape, math.log(_HIGHEST))
    for _ in range(_STEPS):
        middle = 0.5 * (low + high)
        enough = chance(middle) >= 0.5
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    low, above = (side / ndtri(np.clip(chance(high + side), 1e-12, 1.0 - 1e-12)) for side in (-_BESIDE, _BESIDE))
    return high, low, above
