"""Probability that a search detects a planet, from the statistic that it compares: nothing in it is fitted to images.

The search compares a matched-filtered residual, over the standard deviation that it estimates, with a threshold
(`cpic_planner.validation.search`). For a planet of the significance ``S`` in its aperture, at a place where white
noise is the share ``w`` of the variance, the cross term of the wavefront's errors with the static field ``c`` and the
light of the errors ``l``, these have closed forms (``F`` of `PsfMetrics.filter_square`, ``m`` the mean's variance):

    v     = w + c f_c + l f_l                         noise through the filter; f of `PsfMetrics.filter_linear`
    mu    = S g (1 + var / 6) / sqrt(v)               signal over noise; g of `PsfMetrics.filter_gain`
    f_l   = F (1 - m / b) / mean(1 - m / b)           apertures, of variance b, are measured less the mean of the hole
    peak  = sqrt(mu^2 + 2), or mu at a known place    a maximum over two coordinates
    rel   = s' I^-1 s                                 relative variance of the noise estimate; s slopes of ln v
    tau   = snr_at(level, laplace, 2 / rel, visits)   threshold; laplace from the kurtosis of the errors' light
    var   = rel (1 + 3 laplace^2 / 2 visits)          the same of what is there: squares of heavy tails vary by more
    P     = Phi((peak - tau) / sqrt(1 + own + tau^2 var / 4))

The median of a mean square of relative variance ``var`` lies ``var / 3`` below its mean (Wilson & Hilferty 1931).
``I`` is the information of all places of the hole but the planet's disc and, as far as speckles rule, its mirror image,
and of the scatter of the visits, on the level of the white noise and the drift, by which ``s`` are slopes. The cross
term varies from place to place: P is the mean over fifths of the places at a separation.
"""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, IntArray, Record, read_npz, special
from cpic_planner.etc.detection import (
    MIN_ELEMENTS,
    MIN_SIGMA,
    equivalent_sigma,
    near_threshold,
    search_threshold,
    searched_region,
)
from cpic_planner.etc.model import EtcModel
from cpic_planner.etc.noise import StackNoise
from simulator.imaging import PsfMetrics, centred_axis
from simulator.signal import annulus_floor, error_light_share

PRIORS = 0.25, 1.0, 1.0
"""Standard deviations of natural logarithms before a residual is seen: of the level of the white noise, computed from
known numbers, of the squared drift of a visit and of what all visits share, which are assumed (A)."""
MAP_VISITS = 256
"""Visits behind the maps of speckles that a search assumes."""
LAW_ERROR = 0.03
"""Relative standard error of the significance at which half of the planets are found (report `detection_law`)."""
_REACH = 3.0
"""Places that a speckle of the light correlates with, over those of the filter: 3/2 of a Gaussian, at mirror places."""
_CROSSED = 0.6
"""Kurtosis of the product of cross term and light over that of the light: 0.53 in F520, 0.47 to 0.64 in the others."""
_SHARES, _LIGHTS, _VISITS = 8, 4, 11  # one and two visits are nearly nodes
_MOST_SHARE, _LEAST_VISITS, _EXCLUDED = 0.9999, 0.5, 1.22
_TAILS, _RELATIVES, _MOST_RELATIVE = 7, 6, 0.4
_LEVELS = 1.0, 1.12
_APART, _FAR, _BETWEEN = 0.15, 2.0, 3
_REPEATED = 4
_TOGETHER = 4096  # numbers that are looked up at once: they stay in the cache
_CLOSE, _BESIDE, _LOWEST, _HIGHEST = 1e-6, 0.15, 0.5, 1e3


class SearchLaw(Record, eq=False):
    """Law of detections of one band; made by `band_law`.

    Attributes
    ----------
    separation_arcsec : ndarray, shape (r,)
    made : callable
        Of whether the place is known, and of numbers of separations, ``(s, l, 3, n, v)``: logarithm of the significance
        at which half of the planets are detected, and widths of the law in it to either side. By separation and inverse
        root of the number of visits, the polynomials in the roots of the share of the speckles in the variance and of
        that of the errors' light in the speckles. Along polynomials no valley opens that the law has not.
    """

    separation_arcsec: FloatArray
    made: Callable[[bool, IntArray], FloatArray]

    @functools.cached_property
    def _kept(self) -> tuple[FloatArray, BoolArray]:
        """Tables of both ways to search, and of which separations they are made."""
        n = self.separation_arcsec.size
        return np.empty((2, _SHARES, _LIGHTS, 3, n, _VISITS)), np.zeros((2, n), bool)

    def _tables(self, at_place: bool, low: IntArray) -> FloatArray:
        """Return the tables, with these rows and the next ones made: one planet needs two of them."""
        tables: FloatArray = self._kept[0][int(at_place)]
        there: BoolArray = self._kept[1][int(at_place)]
        if not (there[low].all() and there[low + 1].all()):
            asked = np.zeros(there.size, bool)
            asked[low] = asked[low + 1] = True
            new = np.flatnonzero(asked & ~there)
            tables[..., new, :] = self.made(at_place, new)
            there[new] = True
        return tables

    def _rows(self, separation_arcsec: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the rows of the tables before separations, and their share of the way to the next."""
        size = self.separation_arcsec.size
        return _cell(np.interp(separation_arcsec, self.separation_arcsec, np.arange(size)), size)

    def _where(self, *where: ArrayLike) -> list[Any]:
        """Return cells of the tables, and the polynomials' variables, of what `half` is asked for."""
        place, speckled, light, visits = (np.asarray(part, float) for part in where)
        return [*self._cells(place, visits), _variable(speckled), _variable(light)]

    def _cells(self, separation_arcsec: FloatArray, visits: FloatArray) -> list[Any]:
        """Return cells of the tables, of places and numbers of visits, and their shares of the way to the next."""
        many = np.sqrt(_LEAST_VISITS / np.maximum(visits, _LEAST_VISITS)) * (_VISITS - 1)
        return [*self._rows(separation_arcsec), *_cell(many, _VISITS)]

    def _read(self, at_place: bool, which: ArrayLike, where: Sequence[Any]) -> FloatArray:
        """Return numbers of the tables: ``which`` of the three, and places of `_where`."""
        low, share, *rest = where
        tables = self._tables(at_place, low)
        shape = np.broadcast_shapes(*(np.shape(part) for part in (which, *where)))
        if low.size * _REPEATED < math.prod(shape):
            few, first, index = np.unique(low + share, return_index=True, return_inverse=True)
            if few.size * _VISITS * _REPEATED <= math.prod(shape):  # separations of a grid: rows of their own
                first = np.append(first, first[-1])
                row, between = low.reshape(-1)[first], share.reshape(-1)[first]
                tables = _between(tables[..., row, :], tables[..., row + 1, :], between[:, None])
                low = index.reshape(low.shape)
                share = np.zeros(low.shape)
        parts = [np.asarray(part) for part in (which, low, share, *rest)]
        wide = [part.reshape((1,) * (max(len(shape), 1) - part.ndim) + part.shape) for part in parts]
        found = np.empty(shape or (1,))
        step = max(_TOGETHER * len(found) // max(found.size, 1), 1)
        for block in (slice(start, start + step) for start in range(0, len(found), step)):
            *at, speckled, light = (part[block] if len(part) > 1 else part for part in wide)
            found[block] = _polynomial(_polynomial(_polynomials_at(tables, *at), speckled), light)
        return found if shape else found[0]

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
        return np.asarray(np.exp(self._read(at_place, 0, self._where(separation_arcsec, speckled, light, visits))))

    def polynomials(self, separation_arcsec: FloatArray, visits: FloatArray, *, at_place: bool) -> FloatArray:
        """Return the polynomials of places and numbers of visits, for `half_of`: (s, l, ...); as of `half`."""
        where = self._cells(separation_arcsec, visits)
        tables, (row, number) = self._tables(at_place, where[0]), (where[0] + where[1], where[2] + where[3])
        if min(row.size, number.size) > _TOGETHER // _REPEATED:  # many pairs of few places and numbers
            _, places, rows = np.unique(row, return_index=True, return_inverse=True)
            _, numbers, columns = np.unique(number, return_index=True, return_inverse=True)
            if places.size * numbers.size * _REPEATED <= np.broadcast(row, number).size:
                low, share = (part.reshape(-1)[places, None] for part in where[:2])
                few, of_visits = (part.reshape(-1)[numbers] for part in where[2:])
                every = _polynomials_at(tables, 0, *np.broadcast_arrays(low, share, few, of_visits))
                pair = rows.reshape(row.shape) * numbers.size + columns.reshape(number.shape)
                return every.reshape(_SHARES * _LIGHTS, -1).take(pair, 1).reshape(_SHARES, _LIGHTS, *pair.shape)
        return _polynomials_at(tables, 0, *where)

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
        where = self._where(separation_arcsec, speckled, light, visits)
        log_half = self._read(at_place, 0, where)
        with np.errstate(divide="ignore"):
            reached = np.log(np.asarray(significance, float)) - log_half
        # Beyond one half the excess is linear in the significance: a lower threshold never detects fewer.
        bright, faint = np.clip(reached, 1e-9, 50.0), reached < 0.0
        width = self._read(at_place, np.where(faint, 1, 2), where)
        width *= np.where(faint, 1.0, math.expm1(_BESIDE) / _BESIDE)
        width2 = width**2 + np.multiply(own, np.exp(-2.0 * log_half))
        return reached, np.sqrt(width2) * bright / np.expm1(bright)

    def probability(self, *of: Any, at_place: bool) -> FloatArray:
        """Return the probability of a detection; arguments as of `reach`."""
        reached, width = self.reach(*of, at_place=at_place)
        return np.asarray(special().ndtr(reached / width))

    def least(self, separation_arcsec: ArrayLike, probability: float, *, at_place: bool) -> FloatArray:
        """Return a significance below which nothing is detected with that probability, in any noise.

        Parameters
        ----------
        separation_arcsec : array_like
        probability : float
        at_place : bool
            Nothing at a known place, either.
        """
        least = _least_logs(self, probability, at_place)
        return np.asarray(np.exp(np.interp(np.asarray(separation_arcsec, float), self.separation_arcsec, least)))


@functools.lru_cache(maxsize=64)
def _least_logs(law: SearchLaw, probability: float, at_place: bool) -> FloatArray:
    """Return the logarithm of the least significance in any noise, at the separations of a law."""
    many = (_LEAST_VISITS / np.maximum(_grid(_VISITS), 1e-3) ** 2)[:, None]
    shares = _nodes(_SHARES)[:, None, None, None] ** 2, _nodes(_LIGHTS)[:, None, None] ** 2
    where, far = law._where(law.separation_arcsec, *shares, many), special().ndtri(probability)
    lowest = [law._read(known, 0, where) + far * law._read(known, 1, where) for known in {False, at_place}]
    return np.asarray(np.min(lowest, axis=(0, 1, 2, 3)))


class _BandLaws(SearchLaw, eq=False):
    """Laws of bands that are looked up together: arguments have three axes or more, the first of these the bands."""

    laws: tuple[SearchLaw, ...]
    first: IntArray

    def _rows(self, separation_arcsec: FloatArray) -> tuple[IntArray, FloatArray]:
        kept: tuple[FloatArray, tuple[IntArray, FloatArray]] | None = vars(self).get("_last")
        if kept is None or kept[0] is not separation_arcsec:  # a question asks for programmes at the same places
            kept = vars(self)["_last"] = separation_arcsec, self._found(separation_arcsec)
        return kept[1]

    def _found(self, separation_arcsec: FloatArray) -> tuple[IntArray, FloatArray]:
        each = zip(self.laws, np.moveaxis(separation_arcsec, -3, 0), self.first, strict=True)
        cells = [(first, *law._rows(place)) for law, place, first in each]
        return np.stack([first + low for first, low, _ in cells], -3), np.stack([share for *_, share in cells], -3)


@functools.lru_cache(maxsize=64)
def _together(laws: tuple[SearchLaw, ...]) -> SearchLaw:
    """Return one law of the bands of several, with their tables one behind the other."""
    if len(laws) == 1:
        return laws[0]
    sizes = [law.separation_arcsec.size for law in laws]
    first = np.cumsum([0, *sizes[:-1]])

    def copied(at_place: bool, rows: IntArray) -> FloatArray:
        found = []
        for law, start, size in zip(laws, first, sizes, strict=True):
            own = rows[(rows >= start) & (rows < start + size)] - start
            found.append(law._tables(at_place, np.minimum(own, size - 2))[..., own, :])
        return np.concatenate(found, axis=-2)

    return _BandLaws(np.concatenate([law.separation_arcsec for law in laws]), copied, laws, first)


def bands_law(model: EtcModel, bands: Sequence[str]) -> SearchLaw:
    """Return the law of bands of a model, of arguments ``(..., n_band, n_star, n_planet)``; as `band_law`."""
    return _together(tuple(band_law(model, band) for band in bands))


def _polynomials_at(
    tables: FloatArray, which: ArrayLike, low: IntArray, share: FloatArray, few: IntArray, of_visits: FloatArray
) -> FloatArray:
    """Return the polynomials of tables between their rows and numbers of visits: (s, l, ...)."""
    size = tables.shape[-2]
    cells, corner = tables.reshape(_SHARES * _LIGHTS, -1), (np.asarray(which) * size + low) * _VISITS + few
    # In one order, whatever the shapes: numbers are the same to the last bit alone and together.
    one, two = (cells.take(at, 1) for at in (corner, corner + 1))
    if share.any():
        one, two = (_between(end, cells.take(at + _VISITS, 1), share) for end, at in ((one, corner), (two, corner + 1)))
    return _between(one, two, of_visits).reshape(_SHARES, _LIGHTS, *corner.shape)


def half_of(polynomials: FloatArray, speckled: ArrayLike, light: ArrayLike) -> FloatArray:
    """Return what `SearchLaw.half` does from the polynomials of places and numbers of visits.

    Parameters
    ----------
    polynomials : ndarray, shape (s, l, ...)
        Of `SearchLaw.polynomials`.
    speckled, light : array_like
        As of `SearchLaw.half`; they may have further axes in front.
    """
    ahead = (1,) * (max(np.ndim(speckled), np.ndim(light)) - polynomials.ndim + 2)
    found = polynomials.reshape(*polynomials.shape[:2], *ahead, *polynomials.shape[2:]).swapaxes(0, 1)
    for share in (light, speckled):  # the light's share can be the same for many places
        found = _polynomial(found, _variable(share))
    return np.exp(found, out=found)


def _variable(share: ArrayLike) -> FloatArray:
    """Return the polynomials' variable of a share."""
    return np.asarray(2.0 * np.sqrt(np.fmin(np.fmax(share, 0.0), 1.0)) - 1.0)


def _cell(row: FloatArray, size: int) -> tuple[IntArray, FloatArray]:
    """Return the number before each of these, and their share of the way to the next."""
    low = np.minimum(row.astype(np.intp), size - 2)
    return low, row - low


def _between(first: FloatArray, second: FloatArray, share: FloatArray) -> FloatArray:
    """Return numbers between two, written over the second."""
    second -= first
    second *= share
    second += first
    return second


def band_law(model: EtcModel, band: str) -> SearchLaw:
    """Return the law of a band of a model.

    Parameters
    ----------
    model : EtcModel
        Its strategy has the level of a detection.
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    common = model.instrument.drift.common_fraction
    return _law(model.metrics[band], model.strategy.annulus_lambda_d, model.strategy.sigma, common)


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


LEAST_PROBABILITY = 1e-6
"""Planets that are detected with a smaller probability count as not detected at all."""


class Chances(NamedTuple):
    """Probabilities of a detection, of a blind search and at a known place."""

    blind: FloatArray
    known_place: FloatArray

    @classmethod
    def of(
        cls,
        law: SearchLaw,
        noise: StackNoise,
        separation_arcsec: ArrayLike,
        light: ArrayLike,
        visits: ArrayLike,
        motion: ArrayLike = 1.0,
        *,
        at_place: bool = True,
    ) -> Self:
        """Return the chances by a law.

        Parameters
        ----------
        law : SearchLaw
        noise : StackNoise
            Of programmes at the planets' places.
        separation_arcsec : array_like
        light : array_like
            Share of the errors' light in what visits average (`light_share`).
        visits : array_like
            Independent wavefronts behind the noise (`effective_visits`).
        motion : array_like
            Factor on the threshold of a blind search for the motion of planets; at a known place the orbit is followed.
        at_place : bool
            Those at a known place are asked for; else they are NaN.
        """
        where = own_share(noise), separation_arcsec, speckled_share(noise), lit_share(noise, light), visits
        paid = noise.significance / np.asarray(motion, float)
        blind = law.probability(paid, *where, at_place=False)
        # Who knows the place may search blind, too.
        known = law.probability(noise.significance, *where, at_place=True) if at_place else np.nan
        return cls(blind, np.maximum(blind, known))

    def where(self, defined: BoolArray) -> Self:
        """Return the same, and 0 where no threshold of a significance is defined."""
        return type(self)(*(np.where(defined, part, 0.0 * part) for part in (self.blind, self.known_place)))


def visit_chances(
    model: EtcModel,
    band: str,
    separation_arcsec: ArrayLike,
    visit_s: ArrayLike,
    noise: StackNoise,
    visits: ArrayLike = 1.0,
    *,
    motion: ArrayLike = 1.0,
    at_place: bool = True,
) -> Chances:
    """Return the probabilities that visits, or programmes of them, detect planets.

    Parameters
    ----------
    model : EtcModel
    band : str
    separation_arcsec, visit_s : array_like
        Of the planets, and length of the science visits.
    noise, visits, motion, at_place
        As of `Chances.of`.
    """
    light = light_share(model, band, separation_arcsec, visit_s)
    found = Chances.of(band_law(model, band), noise, separation_arcsec, light, visits, motion, at_place=at_place)
    return found.where(model.metrics[band].resolution_elements(separation_arcsec) >= MIN_ELEMENTS)


TAILS_FILE = Path(__file__).parent / "data" / "tails.npz"
"""File of `equivalents` at the steps of usual levels, which take longer to work out than all else."""


@functools.lru_cache(maxsize=256)
def _equivalents(step: int) -> FloatArray:
    found = _shipped().get(step)
    return equivalents(step) if found is None else found


@functools.cache
def _shipped() -> Mapping[int, FloatArray]:
    stored = read_npz(TAILS_FILE)
    return dict(zip(stored["step"].tolist(), stored["sigma"], strict=True))


def equivalents(step: int) -> FloatArray:
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
    """Return polynomials in the nodes' x (..., p) and y (..., v, p), of coefficients (v, x, y): (..., v, p)."""
    x, y = 2.0 * x - 1.0, 2.0 * y - 1.0
    along_y = [_polynomial(np.moveaxis(column, -1, 0)[..., None], y) for column in np.moveaxis(coefficients, 1, 0)]
    return _polynomial(along_y, x[..., None, :])


def _polynomial(coefficients: Sequence[FloatArray] | FloatArray, x: FloatArray) -> FloatArray:
    """Return polynomials, whose powers are the first axis."""
    found: FloatArray = coefficients[-1] * x
    for coefficient in coefficients[-2:0:-1]:
        found += coefficient
        found *= x
    found += coefficients[0]
    return found


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
        self.level, self.crossed = 1.0 / self.whole, crossed / self.whole
        self.drift = self.crossed + 2.0 * light / self.whole
        self.speckled = 1.0 - self.level
        heavy = np.sqrt(tails * light * (light + 2.0 * _CROSSED * crossed)) / self.whole
        self.heavy = np.minimum(heavy, 1.0)


@functools.lru_cache(maxsize=64)
def _noise(
    metrics: PsfMetrics, annulus_lambda_d: float, common_fraction: float
) -> tuple[FloatArray, Callable[[IntArray], tuple[FloatArray, ...]]]:
    """Return separations, and a function of their numbers that returns what laws of all levels are made of there.

    By separation, share, light, number of visits and place there: signal over noise of a planet of the significance 1,
    relative variance of the noise by the fit and by what is there, and Laplace share.
    """
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
    places = fifths, lit[:, None]

    def at(rows: IntArray) -> tuple[FloatArray, ...]:
        hole = terms(*(one * part / of[rows, None] for one, part, of in zip(local, (own, lit), ring, strict=True)))
        parts = zip(local, ring, places, strict=True)
        here = terms(*((one[rows] / of[rows])[:, None] * part[rows] for one, of, part in parts))
        relative = _relative_variance(metrics, place, hole, here, common_fraction, rows)
        # Signal over noise through the filter of a planet of the significance 1.
        white = here.level / (1.0 - share[..., None])
        unit = gain[rows, None, None, None, None] * np.sqrt(white)[..., None, :]
        # Mean squares of few visits with heavy tails vary by more than a fit of Gaussian noise says.
        varied = relative * (1.0 + 1.5 * here.heavy[..., None, :] ** 2 * _inverse_visits()[:, None])
        return unit * (1.0 + varied / 6.0), relative, varied, here.heavy

    return place, at


@functools.lru_cache(maxsize=64)
def _law(metrics: PsfMetrics, annulus_lambda_d: float, sigma: float, common_fraction: float) -> SearchLaw:
    """Return the law of a band; see the module."""
    place, noise = _noise(metrics, annulus_lambda_d, common_fraction)
    region = searched_region(metrics.hole, metrics.lambda_d_arcsec / metrics.pixel_scale_arcsec)
    least = max(sigma, MIN_SIGMA)  # of which the number of peaks is known
    blind = search_threshold(region, metrics.filter_roughness, sigma=least).value or least

    def made(at_place: bool, rows: IntArray) -> FloatArray:
        # A maximum over two coordinates lies above the mean.
        level, gained = (1.0, 0.0) if at_place else (blind / least, 2.0)
        between = (level - _LEVELS[0]) / (_LEVELS[1] - _LEVELS[0])
        lower, upper = _log_thresholds(sigma)
        table = (1.0 - between) * lower + between * upper
        unit, relative, varied, heavy = noise(rows)
        needed = np.exp(_value(table, heavy, np.sqrt(relative / _MOST_RELATIVE)))
        spread = np.sqrt(1.0 + 0.25 * needed**2 * varied)
        return _polynomials(_middle_and_widths(unit, needed, spread, gained))

    return SearchLaw(place, made)


def _nodes(count: int) -> FloatArray:
    """Return points from 0 to 1 through which a polynomial of many terms stays smooth (Chebyshev-Lobatto)."""
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.arange(count) / (count - 1)))


@functools.lru_cache
def _through(count: int) -> FloatArray:
    """Return the matrix from values at `_nodes` to the coefficients of their polynomial in ``2 x - 1``."""
    return np.asarray(np.linalg.inv(np.vander(2.0 * _nodes(count) - 1.0, increasing=True)))


def _polynomials(table: FloatArray) -> FloatArray:
    """Return the polynomials through a table at `_nodes`, (3, r, s, l, v): (s, l, 3, r, v)."""
    for count in (_LIGHTS, _SHARES):  # without BLAS, which adds few and many rows in other orders
        parts = zip(_through(count).T, np.moveaxis(table, 3, 0), strict=True)
        table = np.asarray(sum(np.multiply.outer(column, part) for column, part in parts))
    return table


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


def _relative_variance(
    metrics: PsfMetrics, place: FloatArray, hole: _Terms, here: _Terms, common_fraction: float, rows: Any = ...
) -> FloatArray:
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
    common_fraction : float
        Rms of what all visits have in common over that of a visit's offset: the third unknown.
    rows : ndarray of int
        Numbers of the separations that are judged; all by default.
    """
    x, y = _hole_arcsec(metrics)
    rings = np.searchsorted(np.sqrt(place[1:] * place[:-1]), np.hypot(x, y)) == np.arange(place.size)[:, None]
    diagonal = (place[rows] / math.sqrt(2.0))[:, None]
    near = np.hypot(x - diagonal, y - diagonal) < _EXCLUDED * metrics.lambda_d_arcsec
    room, taken = (part @ rings.T.astype(float) / metrics.filter_positions for part in (np.ones(x.size), near))
    once = room / (1.0 + hole.speckled**2)
    # A sample variance of V visits is worth V - 1 squares of one, fewer where the light of errors is skewed.
    again = once / (1.0 + 3.0 * hole.heavy**2)
    # Neither the disc around a planet nor, as far as speckles rule, its mirror image tells the noise there.
    once = np.maximum(once - taken[:, None, None], 0.0)
    inverse = np.maximum(_inverse_visits(), 1e-4)
    more = np.maximum(1.0 / inverse - 1.0, 0.0)

    def known(product: FloatArray, prior: float) -> FloatArray:
        """Return an element of the information on level and drift."""
        single, every = (0.5 * np.sum(part * product, axis=-1)[..., None] for part in (once, again))
        return np.asarray(single + more * every + prior)[..., None]

    white, drifting, common = (sigma**-2 for sigma in PRIORS)
    of_level, of_drift = known(hole.level**2, white), known(hole.drift**2, drifting)
    both = known(hole.level * hole.drift, 0.0)
    whole = of_level * of_drift - both**2
    level, drift = here.level[..., None, :], here.drift[..., None, :]
    relative = (of_drift * level**2 - 2.0 * both * level * drift + of_level * drift**2) / whole
    # What all visits have in common does not scatter: the residual alone tells it, beside level and drift.
    share = (common_fraction**2 / (common_fraction**2 + 2.0 * inverse))[:, None]
    by_level, by_drift, own = (
        share * 0.5 * np.sum(once * hole.crossed * slope, axis=-1)[..., None, None]
        for slope in (hole.level, hole.drift, hole.crossed)
    )
    to_level, to_drift = (
        (of_drift * by_level - both * by_drift) / whole,
        (of_level * by_drift - both * by_level) / whole,
    )
    alone = share * own + common - by_level * to_level - by_drift * to_drift
    beside = share * here.crossed[..., None, :] - level * to_level - drift * to_drift
    of_maps = 2.0 / MAP_VISITS * here.speckled**2 * (1.0 + 1.5 * here.heavy**2)
    return np.asarray(relative + beside**2 / alone + of_maps[..., None, :])


def _middle_and_widths(unit: FloatArray, needed: FloatArray, spread: FloatArray, gained: float) -> FloatArray:
    """Return the logarithm of the significance of a chance of one half, and the widths of the law below and above.

    Parameters
    ----------
    unit, needed, spread : ndarray
        Signal over noise of the significance 1, threshold, and standard deviation, at each of the places (last axis).
    gained : float
        Square that the maximum adds.
    """
    ndtr, ndtri = special().ndtr, special().ndtri
    shape, places = needed.shape[:-1], needed.shape[-1]
    unit, needed, spread = (
        np.moveaxis(np.broadcast_to(part, needed.shape), -1, 0).reshape(places, -1) for part in (unit, needed, spread)
    )

    def chance(log_significance: FloatArray, some: Any = ...) -> tuple[FloatArray, FloatArray]:
        """Return the chance, and how fast it grows with the logarithm."""
        square = (np.exp(log_significance) * unit[:, some]) ** 2
        peak, own = np.sqrt(square + gained), spread[:, some]
        height = (peak - needed[:, some]) / own
        slope = np.exp(-0.5 * height**2) * (square / (peak * own))
        return ndtr(height).mean(axis=0), slope.mean(axis=0) / math.sqrt(2.0 * math.pi)

    # Newton's steps from where straight laws of the places have the chance, between the first place's and the last's.
    signal2 = np.maximum(needed**2 - gained, _CLOSE)
    each, weight = 0.5 * np.log(signal2) - np.log(unit), signal2 / (needed * spread)
    middle, low, high = (weight * each).sum(axis=0) / weight.sum(axis=0), each.min(axis=0), each.max(axis=0)
    left = np.flatnonzero(high - low > _CLOSE)
    while left.size:
        at, (value, slope) = middle[left], chance(middle[left], left)
        low[left], high[left] = np.where(value < 0.5, at, low[left]), np.where(value < 0.5, high[left], at)
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            new = at + (0.5 - value) / slope
        within = (new >= low[left]) & (new <= high[left])
        middle[left] = new = np.where(within, new, 0.5 * (low[left] + high[left]))
        left = left[np.abs(new - at) > _CLOSE]
    middle = np.clip(middle, math.log(_LOWEST), math.log(_HIGHEST))
    below, above = (side / ndtri(np.clip(chance(middle + side)[0], 1e-12, 1.0 - 1e-12)) for side in (-_BESIDE, _BESIDE))
    return np.stack([middle, below, above]).reshape(3, *shape)
