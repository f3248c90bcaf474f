"""The best setting of every target: band, separation, visits and frames, what is detected with it, and what limits it.

With ``G`` the white noise over signal squared of one second of frames, and ``z(v; V)`` the residual of V visits of
``v`` seconds over signal squared, a programme has ``1 / SNR^2 = G / (V v) + z(v; V)``. Each visit has an overhead, so
that more of them leave less time; each has a wavefront of its own, so that more of them average it; what science and
reference visits differ by in all of them stays. An `Outlook` chooses number and length of the visits by these closed
forms. In it frames need not be whole, and their exposure is that of one visit, so that many stars and places cost
little; they are made whole at the chosen place.
"""

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import field, fields, replace
from types import SimpleNamespace
from typing import Any, Self

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, IntArray, NDArray, Reason, Record, Status
from cpic_planner import etc
from cpic_planner.etc.searches import bracketed, first_root_of_all, last_true, taken
from cpic_planner.planets import OrbitSearch
from cpic_planner.queries import MAX_VISITS, ReferencePlanet
from cpic_planner.results import LimitText
from cpic_planner.results.base import ProgrammeColumns
from cpic_planner.targets import Targets
from simulator.detectors import noise_factor2
from simulator.signal import ProgrammeLaw, SpeckleLaw, frame_limit, programme_parts
from simulator.target import albedo_source

VISITS = etc.whole_steps(MAX_VISITS, 24)
"""Numbers of visits that are looked at first."""
_NEARBY = np.linspace(0.0, 1.0, 11)
_SHORTER = np.geomspace(1.0, 0.01, 16)
_ENDLESS_S = np.geomspace(1e2, 1e8, 25)
_SPACED = np.linspace(0.0, 1.0, 25).reshape(-1, 1, 1, 1)
_ROUNDS, _NEWTON_STEPS, _BITS = 8, 3, 14
_LEAST_FACTOR, _CLOSE_FACTOR, _SAME, _NEARLY = 1e-4, 0.1, 1e-10, 1e-4
_RUNAWAY = 0.02
_TOGETHER = 80_000  # programmes that are worked out at once: they stay in the cache


class Outlook(etc.CaseArrays, Record):
    """The numbers that decide programmes at places of stars: ``(n, k, 1)`` or ``(1, k, 1)``; programmes come last.

    Made by `Places.outlook`.

    Attributes
    ----------
    model : EtcModel
    band : str
    level : ndarray
        Small-sample threshold of a significance, or the SNR that is asked for.
    separation_arcsec : ndarray
    white : ndarray
        ``G``: white noise over signal squared of one second of a visit at its best exposure; infinite where no frame is
        possible.
    errors : ndarray
        Part of it that photons make which the errors of the wavefront scatter.
    shortest_s : ndarray
        Length of one such frame, readout included.
    crossed, light : ProgrammeLaw
        Residual in units of the star's light: cross term with the static field, and light of the wavefront's errors.
    star : ndarray
        Square of the star's light over that of the planet.
    wings : ndarray
        Wings of a companion that the references do not share, over signal squared.
    searched : bool
        Whether the level is a threshold, which the law of detections raises.
    motion : OrbitSearch, optional
        What the search pays for the motion of planets; nothing without.
    drift2 : ndarray
        Square of a factor on the drift, its walk and what is common included.
    """

    model: etc.EtcModel
    band: str
    level: FloatArray
    separation_arcsec: FloatArray
    white: FloatArray
    errors: FloatArray
    shortest_s: FloatArray
    crossed: ProgrammeLaw
    light: ProgrammeLaw
    star: FloatArray
    wings: FloatArray
    searched: bool
    motion: OrbitSearch | None = None
    drift2: FloatArray = field(default_factory=lambda: np.ones(()))

    def select(self, stars: Any) -> Self:
        """Return the outlook of some of the stars."""
        return self._combined(lambda part: part[stars] if part.ndim and len(part) > 1 else part)

    def picked(self, stars: IntArray, columns: IntArray) -> Self:
        """Return some of the places of some stars; parameters as of `picked`."""
        return self._combined(lambda part: picked(part, self.white.shape[:2], stars, columns))

    def drifting(self, factor: ArrayLike) -> Self:
        """Return the same with a drift that is ``factor`` times as large, its walk and what is common included."""
        k2 = np.asarray(factor, float) ** 2
        with np.errstate(invalid="ignore"):
            less = np.where(np.isfinite(self.errors), self.errors * (1.0 - k2), 0.0)
        return replace(self, white=self.white - less, errors=self.errors * k2, drift2=self.drift2 * k2)

    def at_rest(self) -> Self:
        """Return the same for planets that stand still."""
        return replace(self, motion=None)

    def without_speckles(self) -> Self:
        """Return the same with a wavefront that does not drift, and without a companion's wings."""
        return replace(self.drifting(0.0), wings=np.zeros((1, 1, 1)))

    @property
    def visits(self) -> FloatArray:
        """Numbers of visits to look at: the given one, or some up to the most."""
        given = self.model.strategy.visits
        return VISITS if given is None else np.array([float(given)])

    def planned(self, visits: FloatArray, visit_s: FloatArray) -> "_Planned":
        """Return programmes of so many visits, spaced as visits of that length are; arrays as of `cost`."""
        programme, known = programme_of(self.model, visits, visit_s), self.model.strategy.search == "known_place"
        laws, polynomials = (self.crossed, self.light, self.light.averaging()), np.zeros((1, 1))
        if self.searched:
            law, where = etc.band_law(self.model, self.band), (self.separation_arcsec, programme.effective(self.light))
            polynomials = law.polynomials(*where, at_place=known)
            polynomials[0, 0] += np.where(np.isfinite(self.level), 0.0, np.inf)
        crossed, light, averaged = map(programme.law, laws)
        return _Planned(self, programme, crossed, light, averaged, np.moveaxis(polynomials, (0, 1), (-2, -1)))

    def cost(self, visits: FloatArray, visit_s: FloatArray) -> FloatArray:
        """Return the level over the SNR of programmes, at most 1 where it is reached.

        Parameters
        ----------
        visits, visit_s : ndarray
            Number and length of the science visits; broadcast, programmes along the last axis.
        """
        return self.planned(visits, visit_s).cost(visit_s)

    def in_time(self, time_s: float | FloatArray, visits: FloatArray | None = None) -> list[FloatArray]:
        """Return least cost within a wall time, and number and length of the visits; arrays ``(n, k)``.

        Parameters
        ----------
        time_s : float or ndarray
            One number, or of every star, ``(n, 1, 1)``.
        visits : ndarray, optional
            Numbers of visits to choose from, along the last axis.
        """
        many = self.visits if visits is None else visits
        visit = self.model.visit_s(time_s / many)
        if self.model.strategy.visits is not None:
            many, visit = np.broadcast_arrays(many, visit * _SHORTER)  # where a shorter visit is better
        cost = self.cost(many, visit)
        if self.model.strategy.visits is None:
            cost = np.where((many == 1.0) | (visit >= self.shortest_s), cost, np.inf)
        return _least(cost, many, visit)

    def for_level(self, visits: FloatArray | None = None, same: float = _SAME) -> list[FloatArray]:
        """Return the least wall time that reaches the level, and number and length of the visits; arrays ``(n, k)``.

        Parameters
        ----------
        visits : ndarray, optional
            Numbers of visits to choose from, along the last axis.
        same : float
            Relative change of their length that ends the search.
        """
        many = self.visits if visits is None else visits
        visit = self._shortest_visit_s(many, same)
        with np.errstate(invalid="ignore"):
            time = np.where(np.isfinite(visit), many * self.model.time_s(visit), np.inf)
        return _least(time, many, visit)

    def _shortest_visit_s(self, visits: FloatArray, same: float) -> FloatArray:
        """Return the length of the visits with which programmes reach the level; ``inf`` where none does.

        From the left: the level grows with the share of the errors' light, and that with the length of the visits.
        """
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            planned, shortest = self.planned(visits, np.ones(1)), np.ones(1)
            v = self.white / visits * planned.wanted(shortest, np.zeros(1), np.zeros(1)) ** 2
            v = np.where(visits > 1.0, np.maximum(v, self.shortest_s), v)
            if self.light.correlation_time_h > 0.0:
                return self._spaced_visit_s(visits, v)
            left = np.arange(len(v))
            for _ in range(_ROUNDS):
                many = visits[left] if visits.ndim == 3 and len(visits) > 1 else visits
                closer = planned.select(left).closer_s(many, v[left])
                moved = np.any(closer > v[left] * (1.0 + same), axis=(1, 2))
                v[left] = closer
                left = left[moved]  # the others stay as they are
            v = np.where(v < _ENDLESS_S[-1], v, np.inf)
            # Where the search goes through ever more orbits, the level may have run away.
            if self.motion is not None:
                v = np.where(self.cost(visits, v) <= 1.0 + _RUNAWAY, v, np.inf)
        return v

    def _spaced_visit_s(self, visits: FloatArray, low: FloatArray) -> FloatArray:
        """Return the same for visits that remember each other, none of them shorter than ``low``.

        Longer visits are farther apart and remember less, so that the level can be reached in a narrow range alone: a
        grid, and a finer one around its first or its lowest point, find it.
        """

        def cost(_: None, visit_s: FloatArray) -> FloatArray:
            return np.stack([self.cost(visits, each) for each in visit_s.reshape(-1, *low.shape)])

        start, end = np.fmin(low, _ENDLESS_S[-1]), np.full(low.shape, _ENDLESS_S[-1])
        grid = start * (end / start) ** _SPACED
        seen = cost(None, grid)
        reached = seen <= 1.0
        some = reached.any(axis=0)
        k = np.where(some, reached.argmax(axis=0), seen.argmin(axis=0))
        before, after = np.maximum(k - 1, 0), np.minimum(np.where(some, k, k + 1), len(grid) - 1)
        start, end, least = bracketed(None, cost, taken(grid, before), taken(grid, after))
        found = first_root_of_all(lambda visit_s: self.cost(visits, visit_s), start, end, least <= 1.0, _SAME)
        return np.where(least <= 1.0, found, np.inf)

    def fewest(self, visit_s: FloatArray) -> FloatArray:
        """Return the least number of visits of that length that reach the level, ``(n,)``; NaN where none does.

        Parameters
        ----------
        visit_s : ndarray, shape (n,)
            For one place of each star.
        """

        def reached(visits: FloatArray, some: Any) -> BoolArray:
            return self.select(some).cost(visits[:, None, None], visit_s[some, None, None])[:, 0, 0] <= 1.0

        fewest = np.full(len(visit_s), np.nan)
        some = np.flatnonzero(reached(np.full(len(visit_s), float(MAX_VISITS)), slice(None)))
        low, high = np.zeros(len(some)), np.full(len(some), float(MAX_VISITS))
        while np.any(high - low > 1.0):
            middle = np.floor(0.5 * (low + high))
            good = reached(np.maximum(middle, 1.0), some)
            low, high = np.where(good, low, middle), np.where(good, middle, high)
        fewest[some] = high
        return fewest

    def endless(self) -> FloatArray:
        """Return the least cost of any number of visits of any length, ``(n, k)``, of planets that stand still."""
        return np.asarray(self.at_rest().cost(self.visits[-1:], _ENDLESS_S).min(axis=-1))

    def drift_factor(self, time_s: float) -> FloatArray:
        """Return the largest factor on the drift with which a star's planet is detected, ``(n,)``; NaN where none.

        The programme that needs least at a factor goes farthest alone; at that factor another one may need less.

        Parameters
        ----------
        time_s : float
            Wall time.
        """
        every, factor = np.arange(len(self.white)), np.full(len(self.white), _CLOSE_FACTOR)
        while True:
            cost, *programme = self.drifting(factor[:, None, None]).in_time(time_s)
            place = np.argmin(cost, axis=1)[:, None]
            visits, visit_s = (np.take_along_axis(part, place, axis=1)[..., None] for part in programme)
            found = self.picked(every, place).planned(visits, visit_s).most_drift(visit_s)
            last, factor = factor, np.where(np.isnan(found), _LEAST_FACTOR, found)
            if np.array_equal(factor, last):
                return np.where(np.isnan(found), np.nan, factor)


class _Planned(etc.CaseArrays, Record):
    """Programmes at the places of an outlook: their residual in units of the star's light, and what a search asks for.

    ``averaged`` is the part of ``light`` that visits average; the last axes of ``polynomials`` are the first ones of
    `cpic_planner.etc.detection_law.half_of`.
    """

    outlook: Outlook
    programme: etc.Programme
    crossed: SpeckleLaw
    light: SpeckleLaw
    averaged: SpeckleLaw
    polynomials: FloatArray

    def most_drift(self, visit_s: FloatArray) -> FloatArray:
        """Return the largest factor below 1 on the drift that leaves costs of at most 1, ``(n,)``; NaN where none does.

        Parameters
        ----------
        visit_s : ndarray, shape (n, 1, 1)
            Of one programme for each star.
        """
        least = math.log(_LEAST_FACTOR)

        def reached(share: FloatArray) -> BoolArray:
            factor = np.exp(least * (1.0 - np.moveaxis(share, 0, -1)[:, None]))
            costs = replace(self, outlook=self.outlook.drifting(factor)).cost(visit_s)
            return np.moveaxis(costs[:, 0], -1, 0) <= 1.0

        some = reached(np.zeros((1, len(visit_s))))[0]
        share = last_true(reached, (len(visit_s),), _BITS)
        return np.where(some, np.exp(least * (1.0 - share)), np.nan)

    @property
    def whole(self) -> SpeckleLaw:
        """All of the residual but wings of companions."""
        k2 = self.outlook.drift2
        return SpeckleLaw(
            *(one + two for one, two in zip(self.crossed.scaled(k2), self.light.scaled(k2**2), strict=True))
        )

    def select(self, stars: Any) -> Self:
        """Return the programmes of some of the stars."""
        return self._combined(lambda part: part[stars] if part.ndim > 2 and len(part) > 1 else part)

    def speckles(self, visit_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the residual over signal squared, and the share in it of the errors' light."""
        of, whole = self.outlook, self.whole.variance(visit_s)
        light = of.drift2**2 * self.averaged.variance(visit_s)
        with np.errstate(divide="ignore", invalid="ignore"):
            if not of.wings.any():  # the share is the same for all stars
                return of.star * whole, light / whole
            speckles = of.star * whole + of.wings
            return speckles, of.star * light / speckles

    def wanted(self, visit_s: FloatArray, speckled: FloatArray, light: FloatArray) -> FloatArray:
        """Return the level that has to be reached in such visits; shares as of `cpic_planner.etc.needed_margin`."""
        of = self.outlook
        if not of.searched:
            return of.level
        half = etc.half_of(np.moveaxis(self.polynomials, (-2, -1), (0, 1)), speckled, light)
        return half if of.motion is None else half * etc.motion_factor(of.model, of.motion, self.programme, visit_s)

    def noise(self, visit_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ``1 / SNR^2`` of programmes, and the level that they have to reach."""
        speckles, light = self.speckles(visit_s)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            noise = self.outlook.white / (self.programme.visits * visit_s) + speckles
            return noise, self.wanted(visit_s, speckles / noise, light)

    def closer_s(self, visits: FloatArray, v: FloatArray) -> FloatArray:
        """Return lengths of visits that are closer to those that reach the level than ``v`` is; not below them."""
        of, (speckles, lit) = self.outlook, self.speckles(v)
        white, whole = of.white / visits, self.whole.scaled(of.star)
        aim = 1.0 / self.wanted(v, speckles / (white / v + speckles), lit) ** 2
        for _ in range(_NEWTON_STEPS):
            slope = white / v**2 - whole.k1 - 2.0 * whole.k2 * v
            excess = white / v + whole.variance(v) + of.wings - aim
            v = np.where(excess > 0.0, np.where(slope > 0.0, v + excess / slope, np.inf), v)
        return np.where(~np.isfinite(of.white) | (aim <= whole.k0 + of.wings), np.inf, v)

    def cost(self, visit_s: FloatArray) -> FloatArray:
        """Return what `Outlook.cost` does; stars beside a companion apart, whose light is another share for each."""
        of = self.outlook
        shape = np.broadcast_shapes(*(part.shape for part in (of.white, of.level, self.programme.visits, visit_s)))
        winged = np.broadcast_to(of.wings.any(axis=(1, 2)), shape[0])
        found, step = np.empty(shape), max(_TOGETHER * shape[0] // math.prod(shape), 1)
        for stars in (np.flatnonzero(winged), np.flatnonzero(~winged)):
            for part in (slice(start, start + step) for start in range(0, len(stars), step)):
                some: Any = part if len(stars) == shape[0] else stars[part]  # views where all are of one kind
                mine = self.select(some)
                length_s = visit_s[some] if visit_s.ndim > 2 and len(visit_s) > 1 else visit_s
                noise, level = mine.noise(length_s)
                with np.errstate(invalid="ignore", over="ignore"):
                    found[some] = np.sqrt(noise) * level
        return np.fmin(found, np.inf)


def picked(part: FloatArray, shape: tuple[int, ...], stars: IntArray, columns: IntArray) -> FloatArray:
    """Return some of the places of some stars; an axis of length 1 stays where it can.

    Parameters
    ----------
    part : ndarray
        Broadcasts to ``shape`` and may have further axes.
    shape : tuple of int
        ``(n_star, n_place)``.
    stars : ndarray of int, shape (n,)
    columns : ndarray of int, shape (n, k) or (1, k)
        Places of each of those stars.
    """
    if np.ndim(part) < 2:
        return part
    if part.shape[1] == 1:
        return part[stars] if len(part) > 1 else part
    if len(part) == len(columns) == 1:
        return part[:, columns[0]]
    whole = part if part.shape[:2] == shape else np.broadcast_to(part, shape + part.shape[2:])
    return whole[stars[:, None], columns]


def programme_of(model: etc.EtcModel, visits: ArrayLike, visit_s: ArrayLike) -> etc.Programme:
    """Return so many visits of that length, each begun after the one before it and the gap of the strategy.

    Parameters
    ----------
    model : EtcModel
    visits, visit_s : array_like
        Number of the science visits, and length of their science part.
    """
    return etc.Programme.of(model.strategy, visits, model.time_s(visit_s))


def nearby(visits: FloatArray) -> FloatArray:
    """Return whole numbers of visits from the last value of `VISITS` before ``visits`` to the next, along a last axis.

    Parameters
    ----------
    visits : ndarray
        Values of `VISITS`.
    """
    place = np.searchsorted(VISITS, visits)
    low, high = VISITS[np.maximum(place - 1, 0)], VISITS[np.minimum(place + 1, len(VISITS) - 1)]
    return np.asarray(np.rint(low[..., None] + (high - low)[..., None] * _NEARBY))


def _least(value: FloatArray, *others: FloatArray) -> list[FloatArray]:
    """Return the least value along the last axis, and what other arrays have there."""
    best = np.argmin(value, axis=-1)[..., None]
    taken = (np.broadcast_to(part, value.shape) for part in (value, *others))
    return [np.take_along_axis(part, best, axis=-1)[..., 0] for part in taken]


_OF_PLACES = ("level", "separation_arcsec", "white", "errors", "shortest_s", "crossed", "light", "star", "wings")
_CHANGES = ("without_motion", "without_speckles", "without_background")
_REQUIRED = ("required_visits", "required_drift_factor", "required_contrast_factor")
_ROUNDING = 1e-9


class Places(etc.CaseArrays, Record):
    """Stars x separations; ``separation_arcsec`` and ``threshold`` are ``(1 or n, k)``, the others ``(n, k)``."""

    model: etc.EtcModel
    band: str
    separation_arcsec: FloatArray
    contrast: FloatArray
    threshold: FloatArray
    rates: etc.ApertureRates
    motion: OrbitSearch | None

    def picked(self, stars: IntArray, columns: IntArray) -> Self:
        """Return some of the separations of some stars; parameters as of `picked`."""
        return self._combined(lambda part: picked(part, self.contrast.shape, stars, columns))

    def problem(self, objective: etc.Objective, programme: etc.Programme = etc.ONE_VISIT) -> etc.FrameProblem:
        """Return what the solver of the frames of a visit needs."""
        camera, strategy = self.model.camera(self.band), self.model.strategy
        return etc.frame_problem(self.rates, camera, strategy, objective=objective, programme=programme)

    def outlook(self, problem: etc.FrameProblem, snr: float | None = None) -> Outlook:
        """Return what decides programmes for an SNR, or for a detection, by the problem of one visit."""
        model, rates, strategy, searched = self.model, self.rates, self.model.strategy, snr is None
        camera = problem.camera
        exposure_s, white = etc.best_exposure_s(problem)
        place, shared = self.separation_arcsec, (strategy.annulus_lambda_d, strategy.reference_ratio, model.timing)
        parts = programme_parts(model.metrics[self.band], model.instrument.drift, place, *shared)
        mean = 1.0 if searched else 1.0 + 1.0 / rates.background_apertures
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            kept = rates.variance_factor * model.library_noise(self.band, np.ones(1)).speckle
            planet = rates.core * rates.planet_left * self.contrast
            of_star = np.nan_to_num(mean * kept / planet**2, posinf=0.0)  # no light: white is inf
            wings = np.nan_to_num(mean * rates.variance_factor * rates.wings_e2_s2 / rates.planet_e_s**2, posinf=0.0)
            # The excess noise of a high gain; at a low one no more than their part of the light's noise.
            scattered = mean * etc.error_noise(rates, camera, strategy, etc.ONE_VISIT)
            stages = camera.register_stages
            excess = noise_factor2(np.array(camera.em_gain_max), stages) if stages else 1.0
            errors = excess * scattered / rates.planet_e_s**2 * (1.0 + camera.readout_s / exposure_s)
            errors = np.fmin(np.fmin(errors, white * scattered / problem.alpha_e_s), white)
        level = self.threshold if snr is None else np.full((1, 1), snr)
        columns = level, place, white, errors, exposure_s + camera.readout_s, *parts, of_star, wings
        made = zip(_OF_PLACES, etc.mapped(lambda part: part[..., None], columns), strict=True)
        motion = etc.mapped(lambda part: part[..., None], self.motion) if searched else None
        return Outlook(model, self.band, **dict(made), searched=searched, motion=motion)

    def noise(self, choice: etc.FrameChoice, programme: etc.Programme) -> etc.StackNoise:
        """Return the noise of chosen frames, those of all visits together."""
        frames = choice.exposure_s, choice.n_frames, choice.em_gain
        return etc.stack_noise(
            self.rates, *frames, self.model.camera(self.band), self.model.strategy, programme=programme
        )

    def needed(
        self, choice: etc.FrameChoice, programme: etc.Programme, noise: etc.StackNoise | None = None
    ) -> FloatArray:
        """Return the significance over threshold at which half of such observations detect a planet."""
        model, band, place = self.model, self.band, self.separation_arcsec
        seen = noise or self.noise(choice, programme)
        speckled, light = etc.speckled_share(seen), etc.light_share(model, band, place, choice.visit_s)
        visits = programme.effective(self.rates.speckle)
        shares = speckled, etc.lit_share(seen, light)
        at_rest = etc.needed_margin(model, band, place, *shares, visits, self.threshold)
        return at_rest * etc.motion_factor(model, self.motion, programme, choice.visit_s)


class OptimalSetting(Record):
    """Best setting of each target; arrays of ``n`` stars.

    ``visits`` of ``frames_per_visit`` frames are reduced together with ``reference_visits`` reference visits;
    ``visit_time_s`` is the wall time of one with its references and ``time_s`` that of all, ``unused_s`` what they
    leave of the given time (NaN where none was), ``n_frames`` the science frames of all. ``margin`` is significance
    over the detection threshold at the chosen separation; at ``needed_margin`` half of such observations detect the
    planet there, by the search of the strategy, and ``chance_blind`` and ``chance_known_place`` are the probabilities
    of a detection. ``floor_margin`` is what no programme can pass, at any separation:
    of the given number of visits, or of the most. ``without_motion``, ``without_speckles`` and ``without_background``
    say whether the planet would be detected in the given time under the changes of `cpic_planner.etc.budget`
    (``without_motion``: if it did not move); False where no time was given. ``moves`` says that no programme detects
    it, although one would if it stood still; False where that was not asked. ``independent_visits``,
    ``orbits_searched`` (NaN where the orbit is followed) and ``motion_factor``, which is part of ``needed_margin``, are
    columns of answers too. ``required_visits`` are the fewest of this length that detect it, ``required_drift_factor``
    and ``required_contrast_factor`` the least changes of drift and contrast that make it detected in the given time;
    NaN where it is detected or no value does. ``contrast_limit`` is the faintest contrast that this observation detects
    at the chosen separation, ``deepest_limit`` that of the best separation for it. ``n_frames`` is 0 where every frame
    saturates or the time is too short. ``extrapolated`` says that the planet's albedo is beyond its data in this band,
    ``outside`` why a given separation has no answer (empty: it is in the zone), ``inherited``
    is the flag of `cpic_planner.etc.inherited_terms`.
    """

    band: NDArray[np.str_]
    separation_arcsec: FloatArray
    contrast: FloatArray
    visits: FloatArray
    independent_visits: FloatArray
    orbits_searched: FloatArray
    motion_factor: FloatArray
    reference_visits: FloatArray
    exposure_s: FloatArray
    frames_per_visit: FloatArray
    n_frames: FloatArray
    em_gain: FloatArray
    visit_time_s: FloatArray
    time_s: FloatArray
    unused_s: FloatArray
    snr: FloatArray
    significance: FloatArray
    threshold: FloatArray
    margin: FloatArray
    floor_margin: FloatArray
    needed_margin: FloatArray
    chance_blind: FloatArray
    chance_known_place: FloatArray
    without_motion: BoolArray
    moves: BoolArray
    without_speckles: BoolArray
    without_background: BoolArray
    required_visits: FloatArray
    required_drift_factor: FloatArray
    required_contrast_factor: FloatArray
    contrast_limit: FloatArray
    deepest_limit: FloatArray
    deepest_separation_arcsec: FloatArray
    longest_exposure_s: FloatArray
    peak_columns_e_s: FloatArray
    peak_hole_e_s: FloatArray
    tail_e_s: FloatArray
    core_throughput: FloatArray
    extrapolated: BoolArray
    outside: NDArray[np.str_]
    inherited: NDArray[np.str_]

    @property
    def detected(self) -> BoolArray:
        """Whether half of such observations or more detect the planet."""
        possible = (self.n_frames >= 1) & (self.outside == "")
        return np.asarray(possible & (self.margin >= self.needed_margin * (1.0 - _ROUNDING)))


def best_of(found: Sequence[OptimalSetting], *, by_time: bool = False) -> OptimalSetting:
    """Pick row by row the one of largest margin over what is needed (or of least time), the first of equals.

    Extrapolated ones come last. Whether a change would make the planet detected is said of any of them; the required
    drift, and what no programme can pass, are the largest.
    """
    costs = [
        np.where(item.n_frames > 0, item.time_s, np.inf) if by_time else -item.margin / item.needed_margin
        for item in found
    ]
    cost = np.stack(costs)
    answered = np.stack([item.n_frames > 0 for item in found])
    last = np.stack([item.extrapolated for item in found]) | ~answered
    rows = np.arange(cost.shape[1])
    pick = np.lexsort((np.broadcast_to(np.arange(len(found))[:, None], cost.shape), cost, last), axis=0)[0]
    changed = {name: np.any([getattr(item, name) for item in found], axis=0) for name in _CHANGES}
    drift = np.fmax.reduce([item.required_drift_factor for item in found])
    floor = np.max([item.floor_margin / item.needed_margin for item in found], axis=0)
    others = (item.name for item in fields(OptimalSetting) if item.name not in _CHANGES)
    best = OptimalSetting(
        **changed, **{name: np.stack([getattr(item, name) for item in found])[pick, rows] for name in others}
    )
    drift = np.where(best.detected, np.nan, drift)
    return replace(best, required_drift_factor=drift, floor_margin=floor * best.needed_margin)


def detection_statuses(best: OptimalSetting, model: etc.EtcModel) -> list[tuple[Status, Reason]]:
    """Return whether the reference planet is detected in the given time, and if not, why.

    A detection is a significance that half of such observations show, by the search of the model's strategy
    (`OptimalSetting.needed_margin`). The reason ``speckle_floor`` says that no length of the given number of visits
    reaches it, ``common_speckle_floor`` that no number of visits does either, up to 1000; neither says that the drift
    decides: `limits_of` says that.
    """
    floor = Reason.COMMON_SPECKLE_FLOOR if model.strategy.visits is None else Reason.SPECKLE_FLOOR
    return [_verdict(best, i, model.camera(str(best.band[i])), floor) for i in range(len(best.margin))]


def _verdict(best: OptimalSetting, i: int, camera: etc.FrameCamera, floor: Reason) -> tuple[Status, Reason]:
    if best.outside[i]:
        return Status.OUTSIDE_FIELD, Reason(str(best.outside[i]))
    if best.n_frames[i] < 1:
        return no_frame_status(best, i, camera)
    if best.detected[i]:
        return Status.OK, Reason.NONE
    if best.without_motion[i] or best.moves[i]:
        return Status.UNREACHABLE, Reason.PLANET_MOVES
    enough = best.floor_margin[i] > best.needed_margin[i]
    return Status.UNREACHABLE, Reason.INSUFFICIENT_TIME if enough else floor


def limits_of(standings: Sequence[tuple[Status, Reason]], best: OptimalSetting) -> list[LimitText]:
    """Return what limits the detection of each star's reference planet in the given time, visits chosen anew.

    Parameters
    ----------
    standings : sequence
        Status and reason of each star, of `detection_statuses`.
    best : OptimalSetting
        The same stars, in their best band.
    """
    changes = zip(*(getattr(best, name).tolist() for name in _CHANGES), strict=True)
    return [
        etc.limit_of(
            *standing,
            detected=standing[0] is Status.OK,
            without_motion=still,
            without_speckles=calm,
            without_background=dark,
            common=standing[1] is Reason.COMMON_SPECKLE_FLOOR,
        )
        for standing, (still, calm, dark) in zip(standings, changes, strict=True)
    ]


def no_frame_status(best: OptimalSetting, i: int, camera: etc.FrameCamera) -> tuple[Status, Reason]:
    """Return why not even one frame is possible: the shortest one saturates, or the time is too short for it."""
    peaks = (float(best.peak_columns_e_s[i]), float(best.peak_hole_e_s[i]), float(best.tail_e_s[i]))
    limit = frame_limit(*peaks, camera.exposure_min_s, 1.0, camera)
    return (Status.UNREACHABLE, Reason.NO_TIME) if limit is Reason.NONE else (Status.SATURATED, limit)


def setting_columns(model: etc.EtcModel, best: OptimalSetting) -> SimpleNamespace:
    """Return what rows say of stars' best settings: frames, and whether they detect the reference planet; NaN for null.

    Parameters
    ----------
    model : EtcModel
    best : OptimalSetting
    """
    standings = detection_statuses(best, model)
    status, reason = (objects([word.value for word in words]) for words in zip(*standings, strict=True))
    some = best.n_frames >= 1
    names = (name for name in ProgrammeColumns.model_fields if hasattr(best, name))
    columns = {name: np.where(some, getattr(best, name), np.nan) for name in names}
    span_days = etc.programme_days(model, *(np.where(some, columns[name], 1.0) for name in ("visits", "time_s")))
    return SimpleNamespace(
        **columns,
        integration_s=columns["n_frames"] * columns["exposure_s"],
        span_days=np.where(some, span_days, np.nan),
        status=status,
        reason=reason,
        verdict=objects([etc.verdict_of(standing[0], detected=True) for standing in standings]),
        verdict_mode=np.full(len(status), model.strategy.search),
        detection_probability=best.chance_blind,
        detection_probability_known_place=best.chance_known_place,
        detection_margin=best.margin,
        limited_by=objects(limits_of(standings, best)),
    )


def objects(cells: Sequence[Any]) -> NDArray[np.object_]:
    """Return a column of texts or other objects."""
    found = np.empty(len(cells), object)
    found[:] = cells
    return found


QUICK, CALM, FAINT = 10.0, 0.1, 10.0
"""Most time over that given, and least factor on the drift, of tier 2; most factor on the planet's light of tier 3."""


def tiers_of(setting: SimpleNamespace, best: OptimalSetting, required_time_s: FloatArray, time_s: float) -> IntArray:
    """Return the tiers of stars' priorities, 1 to 4, by what their reference planets lack.

    1: it is detected in the given time. 2: it would be in at most `QUICK` times the time, or with at least `CALM` times
    the drift, one of the two changed alone. 3: a planet at most `FAINT` times as bright there would be. 4: the others.

    Parameters
    ----------
    setting : SimpleNamespace
        Of `setting_columns`.
    best : OptimalSetting
    required_time_s : ndarray
        Least wall time that detects it; NaN for none.
    time_s : float
        Given wall time.
    """
    near = (required_time_s <= QUICK * time_s) | (best.required_drift_factor >= CALM)
    return np.select([setting.verdict == "detected", near, best.required_contrast_factor <= FAINT], [1, 2, 3], 4)


_SLACK = 1.5  # by how much other exposures may beat the chosen ones at other places; 1 gives the catalogue the same
_LEVEL_ROUNDS, _SECANTS, _MORE_FRAMES = 40, 8, 8
STRIDE = 5
_ANCHORS, _STEP, _HOPELESS_S, _UNSURE = np.array([0, 1, 4, 8]), 0.3, 1e8, 0.1


def optimise(
    model: etc.EtcModel,
    targets: Targets,
    *,
    time_s: float | None = None,
    snr: float | None = None,
    detect: bool = False,
    separation_arcsec: float | None = None,
    planet: ReferencePlanet | None = None,
    bands: Sequence[str] | None = None,
) -> OptimalSetting:
    """Return the best band, separation and frame settings of each target.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars.
    time_s : float, optional
        Longest wall time per target and band, overheads and reference frames included: the clearest detection wins.
    snr : float, optional
        Photometric SNR to reach, 1e-6 to 1e6: the least time wins.
    detect : bool
        A detection to reach: the least time wins. One of the three is given.
    separation_arcsec : float, optional
        Projected separation of the planet, instead of the best one.
    planet : ReferencePlanet, optional
    bands : sequence of str, optional
        All of the model by default.

    Returns
    -------
    OptimalSetting

    Raises
    ------
    InputError
        For values out of range, or if not exactly one goal is given.

    Notes
    -----
    The separation maximises significance over the level of a detection that holds there (or SNR), not bare
    significance: towards the corner of the zone the number of resolution elements falls below three and no detection
    could be claimed. The number of visits is that of the strategy or, without, the best one up to 1000: each has an
    overhead and a wavefront of its own. Less than ``time_s`` is used where the wavefront's walk makes longer visits
    worse. A band in which the albedo is extrapolated wins only where no other has an answer.
    """
    given = {"time_s": time_s, "snr": snr, "detect": detect or None}
    goals = [name for name, value in given.items() if value is not None]
    if len(goals) != 1:
        raise InputError("time_s", " and ".join(goals) or None, allowed="one of time_s, snr, detect")
    body = planet or ReferencePlanet()
    names = model.named(bands)
    if separation_arcsec is not None:
        etc.check_range("separation_arcsec", separation_arcsec, etc.NEAREST_ARCSEC, etc.FARTHEST_ARCSEC, "arcsec")
    if time_s is not None:
        etc.check_range("time_s", time_s, 1e-3, 1e9, "s")
        return best_of([best_in_band(model, targets, band, time_s, body, separation_arcsec) for band in names])
    if snr is not None:
        etc.check_range("snr", snr, 1e-6, 1e6, "")
    searches, every = (
        (Search(model, targets, band, body, separation_arcsec, snr) for band in names),
        np.arange(len(targets)),
    )
    return best_of([search.best(*search.least_programmes(every)) for search in searches], by_time=True)


def best_in_band(
    model: etc.EtcModel,
    targets: Targets,
    band: str,
    time_s: float,
    planet: ReferencePlanet,
    separation_arcsec: float | None = None,
) -> OptimalSetting:
    """Return the best separation, visits and settings of each target in one band within a time; see `optimise`."""
    return Search(model, targets, band, planet, separation_arcsec).in_time(time_s, brief=False)


def quickest(searches: Sequence["Search"], stars: IntArray) -> FloatArray:
    """Return the least wall times of a detection and the visits of that, ``(2, n)``; NaN where there is none.

    They are those of `optimise` with ``detect``, of which nothing else is worked out.

    Parameters
    ----------
    searches : sequence of Search
        Of the bands.
    stars : ndarray of int, shape (n,)
    """
    least = np.full((2, len(stars)), np.nan)
    # A band is looked into where it may be quicker than those before it; one without data of the albedo comes last.
    for search in sorted(searches, key=lambda item: item.extrapolated):
        known_s = np.where(np.isfinite(least[0]), least[0], np.inf)
        left = np.isinf(known_s)
        if not search.extrapolated:
            bound = search.coarse(stars).in_time(np.where(left, 1.0, known_s)[:, None, None])[0].min(axis=1)
            left |= bound < math.exp(_UNSURE)
        if left.any():
            _, _, choice, programme = search.least_programmes(stars[left])
            time_s = np.where(choice.n_frames > 0, programme.visits * search.model.time_s(choice.visit_s), np.inf)[:, 0]
            quicker = time_s < known_s[left]
            least[:, np.flatnonzero(left)[quicker]] = time_s[quicker], programme.visits[quicker, 0]
    return least


def _vertex(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return where parabolas through three points (first axis) are lowest; beyond the lower end without one."""
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = np.diff(y, axis=0) / np.diff(x, axis=0)
        bend = (second - first) / (x[2] - x[0])
        lowest = 0.5 * (x[0] + x[1]) - first / (2.0 * bend)
    return np.where(bend > 0.0, lowest, np.where(y[0] < y[1], -np.inf, np.inf))


def _least_frames(
    chosen: Places, outlook: Outlook, visits: FloatArray, visit_s: FloatArray, snr: float | None
) -> tuple[etc.Programme, etc.FrameChoice]:
    """Return the least frames of so many visits for an SNR, or a detection; they need at least ``visit_s``.

    The level of a detection grows with the share of the errors' light in the frames, and that with the length of the
    visits: it is reached from below, so that the first answer is the least.
    """
    spaced_s = np.where(np.isfinite(visit_s), visit_s, 1.0)
    programme = programme_of(chosen.model, visits, spaced_s)
    problem = chosen.problem("significance" if snr is None else "snr", programme)
    if snr is not None:
        return programme, etc.least_time(problem, np.full(visits.shape, snr))
    reachable = np.isfinite(np.broadcast_to(visit_s, visits.shape))
    length_s = spaced_s[..., None]
    aim = outlook.planned(visits[..., None], length_s).noise(length_s)[1][..., 0] * (1.0 - _ROUNDING)
    choice = etc.least_time(problem, np.where(reachable, aim, np.inf))
    # Visits that remember each other are spaced as they were planned: shorter ones would be closer together.
    secants = 0 if chosen.model.instrument.drift.correlation_time_h > 0.0 else _SECANTS
    slope = np.zeros(visits.shape)
    last: tuple[FloatArray, FloatArray] | None = None
    for step in range(_LEVEL_ROUNDS):
        level = chosen.needed(choice, programme) * chosen.threshold
        some = choice.n_frames > 0
        off = np.where(some, level / np.where(some, aim, 1.0) - 1.0, 0.0)
        # Secants of a fixed point may land above it; the last ones go up to it step by step.
        wrong = some & ((off > _ROUNDING) | (off < -_ROUNDING) & (step < secants))
        if not wrong.any():
            break
        if last is not None and step < secants:
            with np.errstate(divide="ignore", invalid="ignore"):
                slope = np.clip(np.nan_to_num((level - last[1]) / (aim - last[0])), -0.9, 0.9)
        last = aim, level
        moved = aim * (1.0 + off / (1.0 - slope)) if step < secants else level
        aim = np.where(wrong, moved * (1.0 + 0.1 * _ROUNDING), aim)
        better = etc.least_time(problem.at(wrong), aim[wrong])
        for item in fields(etc.FrameChoice):
            getattr(choice, item.name)[wrong] = getattr(better, item.name)
    else:
        choice.n_frames[wrong] = 0.0  # a level that runs away is never reached
    return (programme, choice) if secants else _as_spaced(chosen, visits, spaced_s, choice)


def _as_spaced(
    chosen: Places, visits: FloatArray, visit_s: FloatArray, choice: etc.FrameChoice
) -> tuple[etc.Programme, etc.FrameChoice]:
    """Return frames that fill visits which remember each other: shorter ones than planned would be closer together."""
    frame_s = choice.exposure_s + chosen.model.camera(chosen.band).readout_s
    fewest = np.ceil(visit_s / frame_s * (1.0 - _ROUNDING))
    some = choice.n_frames > 0
    frames = np.where(some & (visits > 1.0), np.maximum(choice.n_frames, fewest), choice.n_frames)
    for _ in range(_MORE_FRAMES):
        choice = replace(choice, n_frames=frames, visit_s=frames * frame_s)
        programme = programme_of(chosen.model, visits, np.where(some, choice.visit_s, 1.0))
        noise = chosen.noise(choice, programme)
        reached = noise.significance >= chosen.needed(choice, programme, noise) * chosen.threshold * (1.0 - _ROUNDING)
        if np.all(reached | ~some):
            break
        frames = np.where(reached, frames, frames + some)
    return programme, choice


class Search(Record):
    """Search of the best separation of each star, first on a coarse grid, then between its points; or a given one."""

    model: etc.EtcModel
    targets: Targets
    band: str
    planet: ReferencePlanet
    separation_arcsec: float | None = None
    snr: float | None = None

    @property
    def grid(self) -> FloatArray:
        """Separations to look at."""
        given = self.separation_arcsec
        return etc.separation_grid(self.model, self.band) if given is None else np.array([given])

    @property
    def refusal(self) -> Reason:
        """Why a given separation is outside the zone of the band."""
        if self.separation_arcsec is None:
            return Reason.NONE
        return etc.place_status(self.model, self.band, self.separation_arcsec)[1]

    @property
    def extrapolated(self) -> bool:
        """Tell whether the planet's albedo is beyond its data in the band."""
        flags = self.model.passbands.albedo_flags(albedo_source(self.planet.albedo))
        return bool(flags[self.model.passbands.index(self.band)])

    @functools.cached_property
    def places(self) -> Places:
        """Rates and contrasts of all stars at every separation."""
        model, band, place = self.model, self.band, self.grid[None, :]
        x, y = etc.planet_offsets(model, self.targets, band, place)
        contrast = etc.reference_contrast(model, self.targets, band, place, self.planet)
        elements = model.metrics[band].resolution_elements(place)
        threshold = etc.threshold_array(elements, model.strategy.sigma)
        rates = etc.aperture_rates(model, self.targets, band, x, y, contrast)
        blind, everywhere = model.strategy.search == "blind", np.broadcast_to(place, contrast.shape)
        motion = etc.search_motion(model, self.targets, band, everywhere) if blind else None
        return Places(model, band, place, contrast, threshold, rates, motion)

    def outlook(self, places: Places, *, dark: bool = False) -> Outlook:
        """Return what decides programmes of stars at ascending separations; ``dark``: with no background.

        Exposures of most SNR per time are looked for at a few of the separations. Between them a parabola through what
        three exposures cost, around one between those, is right to some 1e-4 of the cost.
        """
        problem = places.problem("significance" if self.snr is None else "snr")
        if dark:
            problem = etc.without_background(problem, etc.own_noise(places.rates, problem.camera))
        n = problem.signal_e_s.shape[1]
        anchors = np.unique(_ANCHORS * (n - 1) // _ANCHORS[-1])
        some = np.isin(np.arange(n), anchors)
        logs = np.log(etc.best_exposure_s(problem.at((slice(None), some)))[0])
        longest = np.log(problem.longest_s)
        if n > len(anchors):
            where = np.interp(np.arange(n), anchors, np.arange(len(anchors)))
            low = np.minimum(where.astype(int), len(anchors) - 2)
            known, logs = logs, logs[:, low] + (where - low) * (logs[:, low + 1] - logs[:, low])
            logs = np.minimum(logs, longest)
            tried = np.stack((logs - _STEP, logs, np.minimum(logs + _STEP, longest)))

            def cost(log_s: FloatArray) -> FloatArray:
                exposure_s = np.exp(log_s)
                return problem.frame_noise(exposure_s)[0] * (exposure_s + problem.camera.readout_s)

            costs = cost(tried)
            lowest = np.clip(_vertex(tried, costs), logs - 2.0 * _STEP, np.minimum(logs + 2.0 * _STEP, longest))
            tried, costs = np.append(tried, lowest[None], axis=0), np.append(costs, cost(lowest)[None], axis=0)
            logs = np.take_along_axis(tried, np.argmin(costs, axis=0)[None], axis=0)[0]
            logs[:, some] = known
        return places.outlook(replace(problem, best_s=np.exp(logs)), self.snr)

    @functools.cached_property
    def rough(self) -> Outlook:
        """The outlook of all stars at every separation."""
        return self.outlook(self.places)

    def coarse(self, stars: IntArray) -> Outlook:
        """Return the rough outlook at every few separations."""
        return self.rough.picked(stars, np.arange(0, len(self.grid), STRIDE)[None, :])

    @functools.cached_property
    def endless(self) -> FloatArray:
        """Least level over SNR that any programme has at the separations of the coarse grid, ``(n,)``."""
        return np.asarray(self.coarse(np.arange(len(self.targets))).endless().min(axis=1))

    def lowest(
        self,
        outlook: Outlook,
        rough: Sequence[FloatArray],
        cost: Callable[[Outlook, FloatArray | None], list[FloatArray]],
    ) -> tuple[IntArray, list[FloatArray]]:
        """Return which separation is of least cost for each star, ``(n, 1)``, and the cost there.

        Parameters
        ----------
        outlook : Outlook
            Of ``n`` stars at every separation.
        rough : sequence of ndarray, shape (n, k)
            What the cost is with some numbers of visits, and these; the middle separation counts where there is no
            answer. From the least, the search goes on to neighbours that are better.
        cost : callable
            Returns least cost, visits and their length; of whole numbers of visits near those, where they are chosen.
        """
        (n_stars, n), free = outlook.white.shape[:2], self.model.strategy.visits is None
        value, visits = rough[:2]
        column = np.where(np.isfinite(value).any(axis=1), np.argmin(value, axis=1), n // 2)
        found, left = np.empty((3, n_stars, 1)), np.arange(n_stars)
        while left.size:
            around = np.clip(column[left, None] + ([-1, 0, 1] if n > 1 else [0]), 0, n - 1)
            close = cost(outlook.picked(left, around), nearby(visits[left[:, None], around]) if free else None)
            best = np.argmin(close[0], axis=1)
            best = np.where(np.isfinite(close[0]).any(axis=1), best, around.shape[1] // 2)[:, None]
            found[:, left] = [np.take_along_axis(part, best, axis=1) for part in close]
            last, column[left] = column[left], np.take_along_axis(around, best, axis=1)[:, 0]
            left = left[column[left] != last]
        return column[:, None], list(found)

    def in_time(self, time_s: float, *, brief: bool) -> OptimalSetting:
        """Return the best separation, visits and frames of each star within a time; see `best_in_band`."""
        every = np.arange(len(self.targets))
        # The best place depends on the number of visits: both are chosen together.
        rough = self.rough.in_time(time_s)
        best, (_, visits, visit) = self.lowest(self.rough, rough, lambda item, many: item.in_time(time_s, many))
        chosen, programme = self.places.picked(every, best), programme_of(self.model, visits, visit)
        outlook = self.rough.picked(every, best)
        choice = etc.best_in_visit(chosen.problem("significance", programme), visit)
        return self.best(chosen, outlook, choice, programme, time_s, brief=brief)

    def least_programmes(self, stars: IntArray) -> tuple[Places, Outlook, etc.FrameChoice, etc.Programme]:
        """Return places, frames and programmes of least time for an SNR or a detection of some stars."""
        least_s = self.coarse(stars).for_level(same=_NEARLY)[0].min(axis=1)
        least_s = np.where(np.isfinite(least_s), least_s, _HOPELESS_S)[:, None, None]
        mine = self.rough.select(stars)
        best, (_, visits, visit) = self.lowest(mine, mine.in_time(least_s), Outlook.for_level)
        chosen, outlook = self.places.picked(stars, best), mine.picked(np.arange(len(stars)), best)
        if self.model.strategy.visits is not None:
            programme, choice = _least_frames(chosen, outlook, visits, visit, self.snr)
            return chosen, outlook, choice, programme
        # Where visits are of few frames, those of one visit alone can be quicker.
        visits = np.stack((visits, np.ones_like(visits)))
        programme, choice = _least_frames(chosen, outlook, visits, visit, self.snr)
        both = programme.spread(visits.shape)
        time_s = np.where(choice.n_frames > 0, visits * self.model.time_s(choice.visit_s), np.inf)
        better = time_s[1] < time_s[0]
        return chosen, outlook, choice.at(1).where(better, choice.at(0)), both.at(1).where(better, both.at(0))

    def _changed(
        self, stars: BoolArray, change: Callable[[Outlook], Outlook], time_s: float, *, dark: bool = False
    ) -> FloatArray:
        """Return about the least cost of some stars under a change; infinite for the others.

        Where it may be either side of 1, it is that of the best separation.
        """
        found, some = np.full(len(self.targets), np.inf), np.flatnonzero(stars)
        if some.size:
            every = np.arange(len(self.grid))[None, :]
            mine = self.outlook(self.places.picked(some, every), dark=True) if dark else self.rough.select(some)
            rough = change(mine).in_time(time_s)
            found[some] = rough[0].min(axis=1)
            close = np.flatnonzero(np.abs(np.log(found[some])) < _UNSURE)
            if close.size:
                rough = [part[close] for part in rough]
                best = self.lowest(change(mine.select(close)), rough, lambda item, many: item.in_time(time_s, many))
                found[some[close]] = best[1][0][:, 0]
        return found

    def best(
        self,
        chosen: Places,
        outlook: Outlook,
        choice: etc.FrameChoice,
        programme: etc.Programme,
        time_s: float | None = None,
        *,
        brief: bool = False,
    ) -> OptimalSetting:
        """Return everything about the chosen separations and programmes; what limits them only in a given time."""
        model, band, n = self.model, self.band, len(self.targets)
        noise = chosen.noise(choice, programme)
        if (refused := self.refusal) is not Reason.NONE:
            choice.n_frames[:] = 0.0
        possible = choice.n_frames > 0
        with np.errstate(invalid="ignore"):
            margin = np.where(possible, noise.significance / chosen.threshold, 0.0)
        needed = chosen.needed(choice, programme, noise)
        fine = self.grid
        every = self.places
        around = every.noise(choice, programme)
        level = every.needed(choice, programme, around) * every.threshold
        with np.errstate(divide="ignore", invalid="ignore"):
            limits = np.where(around.significance > 0, every.contrast * level / around.significance, np.inf)
            limit = np.where(margin > 0, chosen.contrast * needed / margin, np.inf)
        deepest = np.argmin(limits, axis=1)

        def column(array: ArrayLike) -> FloatArray:
            return np.array(np.broadcast_to(np.asarray(array, float), (n, 1))[:, 0])

        setting = etc.programme_columns(model, chosen.rates, chosen.motion, programme, choice, time_s, time_s)
        place, visits = chosen.separation_arcsec, programme.effective(chosen.rates.speckle)
        known = not brief or model.strategy.search == "known_place"
        chances = etc.visit_chances(
            model, band, place, choice.visit_s, noise, visits, motion=setting["motion_factor"], at_place=known
        )
        inherited = etc.inherited_terms(model.instrument, model.instrument.band(band).camera, noise)
        lost = column(possible & (margin < needed * (1.0 - _ROUNDING))).astype(bool)
        columns: dict[str, Any] = {name: column(part) for name, part in setting.items()}
        # What is not known, or not asked.
        columns |= dict.fromkeys((*_CHANGES, "moves"), np.zeros(n, bool)) | dict.fromkeys(_REQUIRED, np.full(n, np.nan))
        best = OptimalSetting(
            band=np.full(n, band),
            separation_arcsec=column(chosen.separation_arcsec),
            contrast=column(chosen.contrast),
            threshold=column(chosen.threshold),
            **columns,
            snr=column(noise.snr),
            significance=column(noise.significance),
            margin=column(margin),
            floor_margin=np.full(n, np.nan) if brief else column(needed) / self.endless,
            needed_margin=column(needed),
            chance_blind=column(chances.blind),
            chance_known_place=column(chances.known_place),
            contrast_limit=column(limit),
            deepest_limit=limits[np.arange(n), deepest],
            deepest_separation_arcsec=fine[deepest],
            longest_exposure_s=column(chosen.problem("significance").longest_s),
            peak_columns_e_s=column(chosen.rates.peak_columns_e_s),
            peak_hole_e_s=column(chosen.rates.peak_in_hole_e_s),
            tail_e_s=column(chosen.rates.register_tail_e_s),
            core_throughput=column(chosen.rates.core),
            extrapolated=np.full(n, self.extrapolated),
            outside=np.full(n, refused.value),
            inherited=np.broadcast_to(inherited, (n, 1))[:, 0].copy(),
        )
        if time_s is None or brief or not lost.any():
            return best
        # A bound leaves few stars to be solved again: white noise alone.
        with np.errstate(divide="ignore", invalid="ignore"):
            bound = around.signal_e * np.sqrt(model.visit_s(time_s) / choice.visit_s / programme.visits / around.white)
            ends = (
                etc.needed_margin(model, band, fine, 0.0, 0.0, visits, every.threshold) for visits in (1.0, MAX_VISITS)
            )
            calmest = np.minimum(*ends)
            near = np.nan_to_num(bound / every.threshold / calmest).max(axis=1) * _SLACK >= 1.0
        fewest, factor = np.full((2, n), np.nan)
        fewest[lost] = outlook.select(lost).fewest(column(choice.visit_s)[lost])
        contrast = np.where(lost, column(needed) / np.maximum(column(margin), 1e-300), np.nan)
        few = lost & (self.endless <= 1.0)
        still = self._changed(few & near, Outlook.at_rest, time_s) <= 1.0
        calm = self._changed(lost & near, Outlook.without_speckles, time_s) <= 1.0
        dark = self._changed(few, lambda item: item, time_s, dark=True) <= 1.0
        if calm.any():
            factor[calm] = self.rough.select(calm).drift_factor(time_s)
        return replace(
            best,
            without_motion=still,
            without_speckles=calm,
            without_background=dark,
            required_visits=fewest,
            required_drift_factor=factor,
            required_contrast_factor=contrast,
        )
