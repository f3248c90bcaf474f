"""The best number and length of the visits of a programme, by closed forms over many places.

With ``G`` the white noise over signal squared of one second of frames, and ``z(v; V)`` the residual of V visits of
``v`` seconds over signal squared, a programme has ``1 / SNR^2 = G / (V v) + z(v; V)``. Each visit has an overhead, so
that more of them leave less time; each has a wavefront of its own, so that more of them average it; what science and
reference visits differ by in all of them stays. Frames need not be whole here, and their exposure is that of one visit,
so that many stars and places cost little: `cpic_planner.ranking.optimiser` makes frames whole.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, IntArray
from cpic_planner import etc
from cpic_planner.planets import OrbitSearch
from cpic_planner.queries import MAX_VISITS
from simulator.detectors import noise_factor2
from simulator.signal import ProgrammeLaw, SpeckleLaw, programme_parts

VISITS = etc.whole_steps(MAX_VISITS, 24)
"""Numbers of visits that are looked at first."""
_NEARBY = np.linspace(0.0, 1.0, 11)
_SHORTER = np.geomspace(1.0, 0.01, 16)
_ENDLESS_S = np.geomspace(1e2, 1e8, 25)
_ROUNDS, _NEWTON_STEPS, _BISECTIONS = 8, 3, 14
_LEAST_FACTOR = 1e-4
_RUNAWAY = 0.02


@dataclass(frozen=True)
class Outlook:
    """The numbers that decide programmes at places of stars: ``(n, k, 1)`` or ``(1, k, 1)``; programmes come last.

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
        Residual over signal squared: cross term with the static field, and light of the wavefront's errors.
    wings : ndarray
        Wings of a companion that the references do not share, over signal squared.
    searched : bool
        Whether the level is a threshold, which the law of detections raises.
    motion : SearchMotion, optional
        What the search pays for the motion of planets; nothing without.
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
    wings: FloatArray
    searched: bool
    motion: etc.SearchMotion | None = None

    @classmethod
    def of(
        cls,
        model: etc.EtcModel,
        band: str,
        separation_arcsec: FloatArray,
        contrast: FloatArray,
        rates: etc.ApertureRates,
        problem: etc.FrameProblem,
        level: FloatArray,
        *,
        searched: bool,
        motion: etc.SearchMotion | None = None,
    ) -> Self:
        """Return the outlook of places.

        Parameters
        ----------
        model : EtcModel
        band : str
        separation_arcsec : ndarray
            ``(n, k)`` or ``(1, k)``, as the other arrays.
        contrast : ndarray
            Of the planets there.
        rates : ApertureRates
        problem : FrameProblem
            Of one visit: its white noise is used.
        level : ndarray
            Threshold, or SNR to reach.
        searched : bool
            Whether the level is a threshold.
        motion : SearchMotion, optional
            At the places.
        """
        metrics, drift, strategy = model.metrics[band], model.instrument.drift, model.strategy
        exposure_s, white = etc.best_exposure_s(problem)
        width, ratio = strategy.annulus_lambda_d, strategy.reference_ratio
        parts = programme_parts(metrics, drift, separation_arcsec, width, ratio, model.timing)
        mean = 1.0 if searched else 1.0 + 1.0 / rates.background_apertures
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            kept = rates.variance_factor * model.library_noise(band, np.ones(1)).speckle
            planet = rates.core * rates.planet_left * contrast
            of_star = np.nan_to_num(mean * kept / planet**2, posinf=0.0)  # no light: white is inf
            wings = np.nan_to_num(mean * rates.variance_factor * rates.wings_e2_s2 / rates.planet_e_s**2, posinf=0.0)
            # The excess noise of a high gain; at a low one no more than their part of the light's noise.
            scattered = mean * etc.error_noise(rates, problem.camera, strategy, etc.ONE_VISIT)
            camera = problem.camera
            stages = camera.register_stages
            excess = noise_factor2(np.array(camera.em_gain_max), stages) if stages else 1.0
            errors = excess * scattered / rates.planet_e_s**2 * (1.0 + camera.readout_s / exposure_s)
            errors = np.fmin(np.fmin(errors, white * scattered / problem.alpha_e_s), white)

        def last(part: ArrayLike) -> FloatArray:
            return np.asarray(part, float)[..., None]

        crossed, light = (_deeper(part).scaled(last(of_star)) for part in parts)
        frame_s = last(exposure_s + problem.camera.readout_s)
        moving = None if motion is None else motion.at((..., None))
        return cls(
            model,
            band,
            last(level),
            last(separation_arcsec),
            last(white),
            last(errors),
            frame_s,
            crossed,
            light,
            last(wings),
            searched,
            moving,
        )

    def select(self, stars: Any) -> Self:
        """Return the outlook of some of the stars."""

        def some(part: Any) -> Any:
            if isinstance(part, tuple):
                return type(part)(*map(some, part))
            if isinstance(part, etc.SearchMotion):
                return part.at(stars)
            return part[stars] if isinstance(part, np.ndarray) and part.ndim and len(part) > 1 else part

        return type(self)(*(some(getattr(self, item.name)) for item in fields(self)))

    def at(self, stars: IntArray, columns: IntArray) -> Self:
        """Return some of the places of some stars; parameters as of `picked`."""
        shape = np.broadcast_shapes(self.level.shape, self.white.shape)[:2]
        return type(self)(*(picked(getattr(self, item.name), shape, stars, columns) for item in fields(self)))

    def drifting(self, factor: ArrayLike) -> Self:
        """Return the same with a drift that is ``factor`` times as large, its walk and what is common included."""
        k2 = np.asarray(factor, float) ** 2
        with np.errstate(invalid="ignore"):
            less = np.where(np.isfinite(self.errors), self.errors * (1.0 - k2), 0.0)
        crossed, light = self.crossed.scaled(k2), self.light.scaled(k2**2)
        return replace(self, white=self.white - less, errors=self.errors * k2, crossed=crossed, light=light)

    def at_rest(self) -> Self:
        """Return the same for planets that stand still."""
        return replace(self, motion=None)

    def without_speckles(self) -> Self:
        """Return the same with a wavefront that does not drift, and without a companion's wings."""
        return replace(self.drifting(0.0), wings=np.zeros_like(self.wings))

    @property
    def visits(self) -> FloatArray:
        """Numbers of visits to look at: the given one, or some up to the most."""
        given = self.model.strategy.visits
        return VISITS if given is None else np.array([float(given)])

    def _laws(self, programme: etc.Programme) -> tuple[SpeckleLaw, SpeckleLaw]:
        """Return the residual of programmes without wings of companions, and the errors' light that visits average."""
        light = programme.law(self.light.averaging())
        parts = programme.law(self.crossed), light, self.light.common
        return SpeckleLaw(*(one + two + three for one, two, three in zip(*parts, strict=True))), light

    def cost(self, visits: FloatArray, visit_s: FloatArray) -> FloatArray:
        """Return the level over the SNR of programmes, at most 1 where it is reached.

        Parameters
        ----------
        visits, visit_s : ndarray
            Number and length of the science visits; broadcast, programmes along the last axis.
        """
        noise, level = self._noise(visits, visit_s)
        with np.errstate(invalid="ignore"):
            value = np.sqrt(noise) * level
        return np.where(np.isfinite(value) & (visit_s > 0.0), value, np.inf)

    def wanted(self, visits: FloatArray, visit_s: FloatArray) -> FloatArray:
        """Return the level that a search asks for of programmes; parameters as of `cost`."""
        return self._noise(visits, visit_s)[1]

    def _noise(self, visits: FloatArray, visit_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ``1 / SNR^2`` of programmes, and the level that they have to reach."""
        programme = programme_of(self.model, visits, visit_s)
        whole, light = self._laws(programme)
        with np.errstate(divide="ignore", invalid="ignore"):
            speckles = whole.variance(visit_s) + self.wings
            noise = self.white / (visits * visit_s) + speckles
            return noise, self._wanted(programme, visit_s, speckles / noise, light.variance(visit_s) / speckles)

    def _wanted(
        self, programme: etc.Programme, visit_s: FloatArray, speckled: FloatArray, light: FloatArray
    ) -> FloatArray:
        """Return the level that a search asks for of such visits; shares as of `cpic_planner.etc.needed_margin`."""
        if not self.searched:
            return self.level
        effective = etc.effective_of(programme, self.light)
        place = self.separation_arcsec
        needed = etc.needed_margin(self.model, self.band, place, speckled, light, effective, self.level)
        level = self.level * needed
        return level if self.motion is None else level * self.motion.factor(programme, visit_s)

    def in_time(self, time_s: float, visits: FloatArray | None = None) -> list[FloatArray]:
        """Return least cost within a wall time, and number and length of the visits; arrays ``(n, k)``.

        Parameters
        ----------
        time_s : float
        visits : ndarray, optional
            Numbers of visits to choose from, along the last axis.
        """
        many = self.visits if visits is None else visits
        visit = self.model.visit_s(time_s / many)
        if self.model.strategy.visits is not None or many.shape[-1] == 1:
            many, visit = np.broadcast_arrays(many, visit * _SHORTER)  # where a shorter visit is better
        cost = self.cost(many, visit)
        possible = (many == 1.0) | (visit >= self.shortest_s) | (self.model.strategy.visits is not None)
        return _least(np.where(possible, cost, np.inf), many, visit)

    def finely_in_time(self, time_s: float) -> list[FloatArray]:
        """Return what `in_time` does, with numbers of visits between those of `VISITS` too."""
        found = self.in_time(time_s)
        return found if self.model.strategy.visits is not None else self.in_time(time_s, nearby(found[1]))

    def for_level(self, visits: FloatArray | None = None) -> list[FloatArray]:
        """Return the least wall time that reaches the level, and number and length of the visits; arrays ``(n, k)``.

        Parameters
        ----------
        visits : ndarray, optional
            Numbers of visits to choose from, along the last axis.
        """
        many = self.visits if visits is None else visits
        visit = self._shortest_visit_s(many)
        with np.errstate(invalid="ignore"):
            time = np.where(np.isfinite(visit), many * self.model.time_s(visit), np.inf)
        return _least(time, many, visit)

    def _shortest_visit_s(self, visits: FloatArray) -> FloatArray:
        """Return the length of the visits with which programmes reach the level; ``inf`` where none does.

        From the left: the level grows with the share of the errors' light, and that with the length of the visits.
        """
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            wanted = self._wanted(programme_of(self.model, visits, np.ones(1)), np.ones(1), np.zeros(1), np.zeros(1))
            v = self.white / visits * wanted**2
            v = np.where(visits > 1.0, np.maximum(v, self.shortest_s), v)
            left = np.arange(len(v))
            for _ in range(_ROUNDS):
                many = visits[left] if visits.ndim == 3 and len(visits) > 1 else visits
                closer = self.select(left)._closer_s(many, v[left])
                moved = np.any(closer != v[left], axis=(1, 2))
                v[left] = closer
                left = left[moved]  # the others stay as they are
            v = np.where(v < _ENDLESS_S[-1], v, np.inf)
            # Where the search goes through ever more orbits, the level may have run away.
            if self.motion is not None:
                v = np.where(self.cost(visits, v) <= 1.0 + _RUNAWAY, v, np.inf)
        return v

    def _closer_s(self, visits: FloatArray, v: FloatArray) -> FloatArray:
        """Return lengths of visits that are closer to those of `_shortest_visit_s` than ``v`` is; not below them."""
        programme = programme_of(self.model, visits, np.where(np.isfinite(v), v, 1.0))
        (whole, light), white = self._laws(programme), self.white / visits
        speckles = whole.variance(v) + self.wings
        aim = 1.0 / self._wanted(programme, v, speckles / (white / v + speckles), light.variance(v) / speckles) ** 2
        for _ in range(_NEWTON_STEPS):
            slope = white / v**2 - whole.k1 - 2.0 * whole.k2 * v
            excess = white / v + whole.variance(v) + self.wings - aim
            v = np.where(excess > 0.0, np.where(slope > 0.0, v + excess / slope, np.inf), v)
        return np.where(~np.isfinite(self.white) | (aim <= whole.k0 + self.wings), np.inf, v)

    def fewest(self, visit_s: FloatArray) -> FloatArray:
        """Return the least number of visits of that length that reach the level, ``(n,)``; NaN where none does.

        Parameters
        ----------
        visit_s : ndarray, shape (n,)
            For one place of each star.
        """
        low, high = np.zeros(len(visit_s)), np.full(len(visit_s), float(MAX_VISITS))

        def reached(visits: FloatArray) -> BoolArray:
            return self.cost(visits[:, None, None], visit_s[:, None, None])[:, 0, 0] <= 1.0

        possible = reached(high)
        while np.any(high - low > 1.0):
            middle = np.floor(0.5 * (low + high))
            good = reached(np.maximum(middle, 1.0))
            low, high = np.where(good, low, middle), np.where(good, middle, high)
        return np.where(possible, high, np.nan)

    def endless(self) -> FloatArray:
        """Return the least cost of any number of visits of any length, ``(n, k)``, of planets that stand still."""
        return np.asarray(self.at_rest().cost(self.visits[-1:], _ENDLESS_S).min(axis=-1))

    def drift_factor(self, time_s: float) -> FloatArray:
        """Return the largest factor on the drift with which a star's planet is detected, ``(n,)``; NaN where none.

        Parameters
        ----------
        time_s : float
            Wall time.
        """
        return _largest(lambda k: self.drifting(k[:, None, None]).in_time(time_s)[0].min(axis=1), len(self.white))


def picked(part: Any, shape: tuple[int, ...], stars: IntArray, columns: IntArray) -> Any:
    """Return some of the places of some stars; an axis of length 1 stays where it can.

    Parameters
    ----------
    part : object
        Arrays that broadcast to ``shape`` and may have further axes, alone or in named tuples, rates or motions; what
        is none stays.
    shape : tuple of int
        ``(n_star, n_place)``.
    stars : ndarray of int, shape (n,)
    columns : ndarray of int, shape (n, k) or (1, k)
        Places of each of those stars.
    """
    if isinstance(part, np.ndarray) and part.ndim > 1:
        if part.shape[1] == 1:
            return part[stars] if len(part) > 1 else part
        if len(part) == len(columns) == 1:
            return part[:, columns[0]]
        whole = part if part.shape[:2] == shape else np.broadcast_to(part, shape + part.shape[2:])
        return whole[stars[:, None], columns]
    if isinstance(part, tuple):
        return type(part)(*(picked(item, shape, stars, columns) for item in part))
    if isinstance(part, etc.ApertureRates | etc.SearchMotion | OrbitSearch):
        return type(part)(*(picked(getattr(part, item.name), shape, stars, columns) for item in fields(part)))
    return part


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


def _deeper(law: ProgrammeLaw) -> ProgrammeLaw:
    """Return a law whose arrays have one more axis, for programmes."""

    def deeper(part: SpeckleLaw) -> SpeckleLaw:
        return SpeckleLaw(*(np.asarray(k, float)[..., None] for k in part))

    science, reference, common = map(deeper, law[:3])
    turned = None if law.turned is None else deeper(law.turned)
    return law._replace(science=science, reference=reference, common=common, turned=turned)


def _least(value: FloatArray, *others: FloatArray) -> list[FloatArray]:
    """Return the least value along the last axis, and what other arrays have there."""
    best = np.argmin(value, axis=-1)[..., None]
    taken = (np.broadcast_to(part, value.shape) for part in (value, *others))
    return [np.take_along_axis(part, best, axis=-1)[..., 0] for part in taken]


def _largest(cost: Callable[[FloatArray], FloatArray], n: int) -> FloatArray:
    """Return the largest factor below 1 at which costs that grow with it are at most 1; NaN where that is at none."""
    low, high = np.full(n, np.log(_LEAST_FACTOR)), np.zeros(n)
    reached = cost(np.exp(low)) <= 1.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        good = cost(np.exp(middle)) <= 1.0
        low, high = np.where(good, middle, low), np.where(good, high, middle)
    return np.where(reached, np.exp(low), np.nan)
