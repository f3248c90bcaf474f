"""Programmes of visits: how many visits of which length.

With ``V`` visits of ``v`` seconds of science frames each, ``o`` of overhead and ``q`` of wall time a second of science,

    1 / SNR^2 = G / (V v) + science(v) / V + reference(v V / R) / R + common,    time = V (o + q v).

Both the noise in a given time and the time for a level fall with the number of visits as long as speckles rule, and
rise once the overhead eats the time: they have one valley in ``V``, which is found on grids of whole numbers that close
in on it. In the middle of the valley, with as many references and no walk, a visit takes ``sqrt(G o / (2 q z))``, ``z``
the residual of one visit. Frames need not be whole in this search.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cpic_core import ArrayLike, FloatArray, NDArray
from cpic_planner.etc.frames import (
    FrameChoice,
    FrameProblem,
    best_exposure_s,
    best_in_visit,
    least_time,
    peak_visit_s,
    shortened,
    smooth_least_visit_s,
)
from cpic_planner.etc.model import ONE_VISIT, EtcModel, Programme, Span
from cpic_planner.etc.noise import Objective
from cpic_planner.etc.searches import around_lowest, lowest_whole, taken
from cpic_planner.etc.together import CameraCases, Wanted
from cpic_planner.queries import MAX_VISITS

_LEVEL_STEPS, _SAME = 60, 1e-10
_ROUNDS, _POINTS = 3, 18
_STEPS, _CLOSE, _FLAT = 40, 1e-12, 2e-3
_SHORT, _BEYOND, _LONGEST_S = 0.98, (1.03, 1.04), 1e15


Level = Callable[[Programme, FrameProblem], Callable[[FloatArray, FloatArray], FloatArray]]
"""SNR or significance to reach of a programme and its problem, for lengths of its visits (s) and ``1 / SNR^2`` there.
"""


@dataclass(frozen=True, eq=False)
class Programmes:
    """All programmes that cases can have, frames not being whole.

    Attributes
    ----------
    model : EtcModel
        Says what a visit costs.
    problem : callable
        Problem of the frames of a programme, whose arrays may have one more axis in front than the cases.
    level : callable
        Level to reach.
    steady : bool
        Whether that is the same for all programmes.
    """

    model: EtcModel
    problem: Callable[[Programme], FrameProblem]
    level: Level
    steady: bool = False

    def best_in_time(self, time_s: ArrayLike) -> FloatArray:
        """Return the numbers of visits that come nearest to the level, or most above it, in a wall time.

        Parameters
        ----------
        time_s : array_like
            Of the whole programme.
        """
        best_s, camera = self._exposure_s, self.problem(ONE_VISIT).camera
        visit_s = float(self.model.time_s(camera.exposure_min_s + camera.readout_s))
        most = np.minimum(np.floor(np.asarray(time_s, float) / visit_s * (1.0 + 1e-12)), MAX_VISITS)
        most = np.broadcast_to(most, best_s.shape)
        return lowest_whole(lambda visits: self._missed(visits, time_s, best_s)[0], most)

    def missed(self, visits: ArrayLike, time_s: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return ``(level / SNR)^2`` of programmes in a wall time, and the length of their visits.

        Parameters
        ----------
        visits : array_like
        time_s : array_like
            Of the whole programme.
        """
        return self._missed(np.asarray(visits, float), time_s, self._exposure_s)

    def bottom_s(self, visits: FloatArray, longest_s: FloatArray) -> FloatArray:
        """Return the length of visits beyond which a search asks for more than time gains; ``inf`` where none is.

        The noise of long visits is all speckles, in which a search asks for more. No bottom is looked for where the
        longest visits are all well short of theirs.

        Parameters
        ----------
        visits, longest_s : ndarray
            Number of the visits, and their longest length.
        """
        best_s, camera = self._exposure_s, self.problem(ONE_VISIT).camera

        def missed(length_s: FloatArray) -> tuple[FloatArray, FloatArray]:
            return self._missed(visits, visits * self.model.time_s(length_s), best_s)

        near, far = (missed(factor * longest_s)[0] for factor in _BEYOND)
        if np.all(far < near):
            return np.full(best_s.shape, np.inf)
        low = np.full(best_s.shape, camera.exposure_min_s + camera.readout_s)
        last, high = missed(np.full(best_s.shape, _LONGEST_S))
        for _ in range(_ROUNDS):
            grid = np.geomspace(low, high, _POINTS)
            low, best, high = around_lowest(grid, values := missed(grid)[0])
        return np.where(values.min(axis=0) < last * (1.0 - _CLOSE), best, np.inf)

    def quickest(self) -> FloatArray:
        """Return the numbers of visits that reach the level in least wall time; 1 where none does."""
        best_s = self._exposure_s
        most = np.full(best_s.shape, float(MAX_VISITS))
        return lowest_whole(lambda visits: visits * self.model.time_s(self._solved(visits, best_s)[0]), most)

    def solved(self, visits: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the shortest visits with which programmes reach the level (``inf`` where none does), and the level."""
        return self._solved(np.asarray(visits, float), self._exposure_s)

    def fewest(self, visit_s: ArrayLike, most: float = MAX_VISITS) -> FloatArray:
        """Return the least numbers of visits of a given length that reach the level; ``inf`` where none does.

        Parameters
        ----------
        visit_s : array_like
            Science frames of a visit.
        most : float
            Largest number to look at.
        """
        best_s = self._exposure_s
        low, high = np.zeros(best_s.shape), np.full(best_s.shape, float(most))
        wall_s = self.model.time_s(visit_s)
        possible = self._missed(high, high * wall_s, best_s)[0] <= 1.0 + _CLOSE
        while np.any(high - low > 1.0):
            middle = np.ceil(0.5 * (low + high))
            enough = self._missed(middle, middle * wall_s, best_s)[0] <= 1.0 + _CLOSE
            low, high = np.where(enough, low, middle), np.where(enough, middle, high)
        return np.where(possible, high, np.inf)

    @functools.cached_property
    def _exposure_s(self) -> FloatArray:
        """Exposures of most SNR per time, which depend little on the programme."""
        return best_exposure_s(self.problem(ONE_VISIT))[0]

    def _made(self, visits: FloatArray, visit_time_s: ArrayLike) -> tuple[Programme, FrameProblem]:
        programme = Programme.of(self.model.strategy, visits, visit_time_s)
        return programme, self.problem(programme)

    def _missed(self, visits: FloatArray, time_s: ArrayLike, best_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        each_s = np.asarray(time_s, float) / visits
        programme, problem = self._made(visits, each_s)
        camera, visit = problem.camera, self.model.visit_s(each_s)
        exposure = np.minimum(best_s, visit - camera.readout_s)
        possible = exposure >= camera.exposure_min_s * (1.0 - 1e-12)
        cost = _cost(problem, np.where(possible, exposure, camera.exposure_min_s))
        visit = np.minimum(visit, peak_visit_s(problem, cost))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            inverse = np.where(possible & np.isfinite(cost), cost / visit + problem.residual(visit), np.inf)
            return inverse * self.level(programme, problem)(visit, inverse) ** 2, visit

    def _solved(self, visits: FloatArray, best_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        drift, wall_s = self.model.instrument.drift, np.array(np.inf)
        for _ in range(1 if drift.correlation_time_h == 0.0 else 4):
            programme, problem = self._made(visits, wall_s)
            camera = problem.camera
            shortest, frame_s = (exposure + camera.readout_s for exposure in (camera.exposure_min_s, best_s))
            visit, level = self._reached(programme, problem, _cost(problem, best_s))
            if np.any(visit < frame_s):  # not even one frame of that exposure: a shorter one, or one whole
                exposure = np.clip(visit - camera.readout_s, camera.exposure_min_s, best_s)
                other, its_level = self._reached(programme, problem, _cost(problem, exposure))
                whole = (visit < frame_s) & (other > frame_s)
                visit, level = np.where(whole, frame_s, other), np.where(whole, level, its_level)
            visit = np.maximum(visit, shortest)
            wall_s = self.model.time_s(visit)
        return visit, level

    def _reached(self, programme: Programme, problem: FrameProblem, cost: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Shortest visits of the level, and the level: from the left of a falling curve, by secants of logarithms.

        White noise alone falls with the slope -1, which no step overshoots.
        """
        wanted = self.level(programme, problem)
        if self.steady:
            most = wanted(np.ones_like(cost), np.zeros_like(cost))
            return smooth_least_visit_s(problem, most, cost), most
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):

            def excess(log_visit: FloatArray) -> tuple[FloatArray, FloatArray]:
                visit = np.exp(log_visit)
                inverse = cost / visit + problem.residual(visit)
                level = wanted(visit, inverse)
                return np.log(inverse) + 2.0 * np.log(level), level

            least = wanted(np.ones_like(cost), np.full(cost.shape, np.inf))
            x = np.log(cost * least**2)
            solvable = np.isfinite(x)
            x = np.where(solvable, x, 0.0)
            (f, level), slope = excess(x), np.full(cost.shape, -1.0)
            for _ in range(_STEPS):
                moving = solvable & (np.abs(f) > _CLOSE) & (slope < -_FLAT) & (x < np.log(_LONGEST_S))
                if not moving.any():
                    break
                new = np.where(moving, x - f / slope, x)
                g, level = excess(new)
                slope = np.where(moving, np.clip((g - f) / (new - x), -1.0, -1e-4), slope)
                x, f = new, g
            visit = np.where(solvable & (f < 1e-8), np.exp(x), np.inf)
            # At a known place the level stops growing: longer ones may reach it.
            most = wanted(np.ones_like(cost), np.zeros_like(cost))
            longer = np.where(np.isfinite(visit), visit, smooth_least_visit_s(problem, most, cost))
            there = np.where(np.isfinite(longer), longer, np.exp(x))
            missed, at_end = excess(np.log(there))  # of longer ones the level of a search over orbits is higher
            return np.where(missed < 1e-8, longer, np.inf), np.where(np.isfinite(visit), level, at_end)


def _cost(problem: FrameProblem, exposure_s: FloatArray) -> FloatArray:
    """White noise over signal squared of one second of every visit, in frames of an exposure."""
    camera = problem.camera
    usable = (problem.longest_s() >= camera.exposure_min_s * (1.0 - 1e-12)) & (problem.signal_e_s > 0)
    return np.where(usable, problem.frame_noise(exposure_s)[0] * (exposure_s + camera.readout_s), np.inf)


@dataclass(frozen=True, eq=False)
class Found:
    """Programmes that answer for the bands of one camera; arrays ``(n_band, n_star, n_planet)``."""

    group: "Group"
    programme: Programme
    problem: FrameProblem
    choice: FrameChoice
    level: FloatArray

    def taken(self, index: NDArray[np.int_]) -> "Found":
        """Return one element of the first axis of every case."""

        def take(array: FloatArray) -> FloatArray:
            return taken(np.broadcast_to(array, self.level.shape), index)

        programme, problem = self.programme._combined(take), self.problem._combined(take)
        return Found(self.group, programme, problem, self.choice._combined(take), take(self.level))


@dataclass(frozen=True, eq=False)
class Group:
    """Cases of bands of one camera, which are solved at once; arrays ``(..., n_band, n_star, n_planet)``."""

    model: EtcModel
    cases: CameraCases
    objective: Objective
    value: float | None
    wanted: Wanted

    @property
    def _shape(self) -> tuple[int, ...]:
        return self.cases.contrast.shape

    def problem(self, programme: Programme, contrast: FloatArray | None = None) -> FrameProblem:
        """Return the problem of a programme, for the cases' own contrasts or given ones."""
        return self.cases.problem(self.objective, contrast, programme)

    @functools.cached_property
    def programmes(self) -> Programmes:
        """All programmes of the cases."""
        return Programmes(self.model, self.problem, self.wanted, self.wanted.steady)

    def visits_in(self, span: Span) -> FloatArray:
        """Return the given number of visits, or the best ones in the time."""
        if span.visits is not None:
            return np.full(self._shape, float(span.visits))
        assert span.time_s is not None
        return self.programmes.best_in_time(span.time_s)

    def paying_s(self, visits: FloatArray, visit_s: FloatArray) -> FloatArray:
        """Return the length of visits, at most the given one, that comes nearest to the level, or most above it.

        It depends on the given one only where that is chosen: more time is never worse.
        """
        if self.wanted.steady:
            return visit_s
        every, search = self.programmes, Programmes(self.model, self.problem, replace(self.wanted, at_place=False))
        bottom_s = search.bottom_s(visits, visit_s)
        there = np.where(np.isfinite(bottom_s), bottom_s, visit_s)
        at_bottom, blind, at_end = (
            made.missed(visits, visits * self.model.time_s(length))[0]
            for made, length in ((every, there), (search, there), (every, visit_s))
        )
        # Photometry at a known place asks for the same in visits of any length: it may gain where the search loses.
        stops = np.isfinite(bottom_s) & (at_bottom >= blind) & (at_bottom <= at_end * (1.0 + _FLAT))
        # At the very bottom the length would be arbitrary: the inverse question could not find it again.
        return np.where(stops, np.minimum(visit_s, bottom_s * _SHORT), visit_s)

    def level_of(self, programme: Programme, problem: FrameProblem, choice: FrameChoice) -> FloatArray:
        """Level that chosen frames have to reach; of frames that there are none of, as if visits were short."""
        some = choice.n_frames >= 1
        visit, inverse = np.where(some, choice.visit_s, 1.0), np.where(some, choice.inverse_snr2, np.inf)
        return self.wanted(programme, problem)(visit, inverse)

    def in_time(self, visits: FloatArray, span: Span, exact: bool) -> Found:
        """Return the best frames of a programme in its time; of a chosen number of visits, the best of those beside."""
        assert span.time_s is not None
        if span.visits is None:
            visits = np.stack(_beside(visits))
        programme, problem, visit_s = self.spread(visits, span.time_s)
        choice = best_in_visit(problem, visit_s, whole=exact, quickest=False)
        found = Found(self, programme, problem, choice, self.level_of(programme, problem, choice))
        if span.visits is None:
            missed = np.where(visit_s > 0, choice.inverse_snr2 * found.level**2, np.inf)
            index = np.argmin(missed, axis=0)
            found, visit_s = found.taken(index), taken(visit_s, index)
        if exact:
            return found
        choice = shortened(found.problem, found.choice, visit_s)
        return replace(found, choice=choice, level=self.level_of(found.programme, found.problem, choice))

    def spread(self, visits: FloatArray, time_s: float) -> tuple[Programme, FrameProblem, FloatArray]:
        """Programmes of so many visits in a time, with the length of their science visits."""
        programme = Programme.of(self.model.strategy, visits, time_s / visits)
        problem = self.problem(programme)
        return programme, problem, np.broadcast_to(self.model.visit_s(time_s / visits), problem.signal_e_s.shape)

    def for_level(self, span: Span) -> Found:
        """Return the quickest frames that reach the level, with the number of visits that is given or best."""
        model, every = self.model, self.programmes
        if span.visit_time_s is not None:
            visit_s = float(model.visit_s(span.visit_time_s))
            visits = np.minimum(every.fewest(visit_s), MAX_VISITS)
            return self._in_visits(visits, span.visit_time_s)
        if span.visits is not None:
            return self.at_level(np.full(self._shape, float(span.visits)))
        best = every.quickest()
        near = np.stack([*_beside(best), np.full_like(best, MAX_VISITS)])
        found = self.at_level(near)
        cost = np.where(found.choice.n_frames >= 1, near * model.time_s(found.choice.visit_s), np.inf)
        # Where none reaches it, as many visits as there may be say what forbids it.
        cost[-1] = _LONGEST_S
        return found.taken(np.argmin(cost, axis=0))

    def _in_visits(self, visits: FloatArray, visit_time_s: float) -> Found:
        """Programmes of the fewest visits of one length that reach the level, of whole frames: one more at most."""
        for _ in range(3):
            programme = Programme.of(self.model.strategy, visits, visit_time_s)
            problem = self.problem(programme)
            visit_s = np.broadcast_to(self.model.visit_s(visit_time_s), visits.shape)
            choice = best_in_visit(problem, visit_s)
            level = self.level_of(programme, problem, choice)
            short = np.sqrt(choice.inverse_snr2) * level > 1.0 + _SAME
            if not np.any(short & (visits < MAX_VISITS)):
                break
            visits = np.minimum(np.where(short, visits + np.ceil(visits * 0.002), visits), MAX_VISITS)
        choice = choice.where(~short, replace(choice, n_frames=np.zeros_like(choice.n_frames)))
        return Found(self, programme, problem, choice, level)

    def at_level(self, visits: FloatArray) -> Found:
        """Return the quickest frames of so many visits that reach the level, which may depend on them."""
        model, last = self.model, None
        steady = self.wanted.steady and model.instrument.drift.correlation_time_h == 0.0
        if steady:
            wall_s, level = np.array(np.inf), np.broadcast_to(self.wanted.level, visits.shape)
        else:
            visit_s, level = self.programmes.solved(visits)
            wall_s = model.time_s(visit_s)
        for _ in range(_LEVEL_STEPS):
            programme = Programme.of(model.strategy, visits, wall_s)
            problem = self.problem(programme)
            choice = least_time(problem, level)
            some = choice.n_frames >= 1
            wall_s = np.where(some, model.time_s(choice.visit_s), wall_s)
            found = np.where(some, self.level_of(programme, problem, choice), level)
            off = np.subtract(found, level, out=np.zeros_like(level), where=some)
            if steady or (last is not None and np.all(np.abs(off) <= _SAME * level)):
                break
            # Secants of a fixed point: the level follows the length of the visits slowly.
            slope = np.zeros_like(level)
            if last is not None:
                with np.errstate(divide="ignore", invalid="ignore"):
                    slope = np.clip(np.nan_to_num((found - last[1]) / (level - last[0])), -0.9, 0.999)
            last = level, found
            level = level + off / (1.0 - slope)
        return Found(self, programme, problem, choice, level)


def _beside(visits: FloatArray) -> list[FloatArray]:
    """One visit, and numbers of visits as they are, one less and one more."""
    return [np.ones_like(visits), *(np.clip(visits + step, 1.0, MAX_VISITS) for step in (-1, 0, 1))]
