"""Programmes of visits: how many visits of which length.

With ``V`` visits of ``v`` seconds of science frames each, ``o`` of overhead and ``q`` of wall time a second of science,

    1 / SNR^2 = G / (V v) + science(v) / V + reference(v V / R) / R + common,    time = V (o + q v).

Both the noise in a given time and the time for a level fall with the number of visits as long as speckles rule, and
rise once the overhead eats the time: they have one valley in ``V``, which is found on grids of whole numbers that close
in on it. In the middle of the valley, with as many references and no walk, a visit takes ``sqrt(G o / (2 q z))``, ``z``
the residual of one visit. Frames need not be whole in this search.

A blind search goes through orbits of planets that move, and its threshold pays for the trials
(`cpic_planner.planets.motion`). Where the place of a planet is known its orbit is followed, which costs nothing.
"""

import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, IntArray, NDArray
from cpic_planner.etc.frames import FrameChoice, FrameProblem, best_exposure_s, peak_visit_s, smooth_least_visit_s
from cpic_planner.etc.model import ONE_VISIT, EtcModel, FrameCamera, Programme, check_range
from cpic_planner.etc.rates import ApertureRates
from cpic_planner.etc.searches import CaseArrays, around_lowest, first_root, lowest_whole, spread
from cpic_planner.planets import OrbitSearch, span_days, star_masses_msun
from cpic_planner.queries import MAX_VISITS, check_visits
from cpic_planner.targets import Targets


@dataclass(frozen=True, eq=False)
class SearchMotion(CaseArrays):
    """The cost of the motion of planets to a blind search at places of stars; made by `of`.

    Attributes
    ----------
    model : EtcModel
        Says what a visit takes of wall time.
    search : OrbitSearch
        Of the places.
    """

    model: EtcModel
    search: OrbitSearch

    @classmethod
    def of(
        cls,
        model: EtcModel,
        targets: Targets,
        band: str,
        separation_arcsec: ArrayLike,
        stars: IntArray | None = None,
    ) -> Self:
        """Return the motion at places around stars.

        Parameters
        ----------
        model : EtcModel
        targets : Targets
            ``n`` stars.
        band : str
        separation_arcsec : array_like
            Projected, above 0; its first axis is 1 or that of the stars.
        stars : ndarray of int, optional
            Which of the stars each place is at, of the shape of the places.
        """
        place, strategy = np.asarray(separation_arcsec, float), model.strategy
        around = (slice(None), *(None,) * (place.ndim - 1)) if stars is None else stars
        of_star = targets.distance_pc[around], _masses_msun(targets)[around], model.metrics[band].lambda_d_arcsec
        return cls(model, OrbitSearch.of(place, *of_star, gap_h=strategy.visit_gap_h, sigma=_level(strategy.sigma)))

    def factor(self, programme: Programme, visit_s: ArrayLike) -> FloatArray:
        """Return the factor on the significance that a search asks for, at least 1.

        Parameters
        ----------
        programme : Programme
        visit_s : array_like
            Length of the science part of its visits.
        """
        return self.search.threshold_factor(programme.visits, self.model.time_s(visit_s))

    def orbits(self, programme: Programme, visit_s: ArrayLike) -> FloatArray:
        """Return the number of orbits that a search goes through; parameters as of `factor`."""
        return self.search.n_orbits(programme.visits, self.model.time_s(visit_s))


def motion_factor(motion: SearchMotion | None, programme: Programme, visit_s: FloatArray) -> FloatArray:
    """Return the factor on the significance that a search asks for because planets move; 1 where it follows them.

    Parameters
    ----------
    motion : SearchMotion or None
    programme, visit_s
        As of `SearchMotion.factor`.
    """
    return np.ones_like(visit_s) if motion is None else motion.factor(programme, visit_s)


def programme_days(model: EtcModel, visits: ArrayLike, time_s: ArrayLike) -> FloatArray:
    """Return the days from the begin of the first visit to the end of the last, occultations by the Earth included.

    Parameters
    ----------
    model : EtcModel
        Its strategy says what lies between visits.
    visits, time_s : array_like
        Number of visits, and wall time of all.
    """
    return span_days(time_s, np.maximum(visits, 1.0), model.strategy.visit_gap_h)


def _level(sigma: float) -> float:
    """Return the significance of the false alarms at rest, within what trials are stated for."""
    return min(max(sigma, 1.0), 20.0)


def _masses_msun(targets: Targets) -> FloatArray:
    return _masses(
        tuple(targets.name.tolist()),
        *(tuple(part.tolist()) for part in (targets.log_g, targets.luminosity_lsun, targets.teff_k)),
    )


@functools.lru_cache(maxsize=64)
def _masses(names: tuple[str, ...], *physics: tuple[float, ...]) -> FloatArray:
    log_g, luminosity, teff = physics
    return star_masses_msun(names, log_g, luminosity, teff)


_ROUNDS, _POINTS, _MANY_POINTS = 3, 18, 72
_STEPS, _CLOSE, _FLAT = 40, 1e-12, 2e-3
_SHORTEST_S, _WIDER, _REACHED = 1e-3, 1.5, 1e-9
_LONGEST_S = 1e10


_COUNTS = ("visits", "reference_visits", "frames_per_visit", "n_frames", "orbits_searched")
_FLOATS = ("exposure_s", "em_gain", "independent_visits", "visit_time_s", "time_s", "unused_s", "motion_factor")


def programme_columns(
    model: EtcModel,
    rates: ApertureRates,
    motion: SearchMotion | None,
    programme: Programme,
    choice: FrameChoice,
    time_s: float | None = None,
    given_s: float | None = None,
) -> dict[str, FloatArray]:
    """Return what answers state of programmes and their frames, by the names of columns, in the shape of the frames.

    Parameters
    ----------
    model, rates, motion, programme, choice
        Of the cases.
    time_s : float, optional
        Wall time that was given; visits never take more, not even by rounding.
    given_s : float, optional
        Wall time that may be used, of which visits of a given length can leave some.

    Returns
    -------
    dict of str to ndarray
        NaN where there is nothing: no time was given, or orbits are followed.
    """
    visit_s, visits, wall_s = choice.visit_s, programme.visits, model.time_s(choice.visit_s)
    if time_s is not None:
        wall_s = np.minimum(wall_s, time_s / visits)
    columns = {
        "exposure_s": choice.exposure_s,
        "em_gain": choice.em_gain,
        "visits": visits,
        "reference_visits": programme.reference_visits,
        "independent_visits": rates.speckle.independent(visits, programme.gap_s),
        "frames_per_visit": choice.n_frames,
        "n_frames": choice.n_frames * visits,
        "visit_time_s": wall_s,
        "time_s": wall_s * visits,
        "unused_s": np.nan if given_s is None else np.maximum(given_s - wall_s * visits, 0.0),
        "orbits_searched": np.nan if motion is None else motion.orbits(programme, visit_s),
        "motion_factor": motion_factor(motion, programme, visit_s),
    }
    return {name: spread(np.asarray(part, float), visit_s.shape) for name, part in columns.items()}


def programme_fields(model: EtcModel, columns: Mapping[str, Any], case: Any) -> dict[str, float | int | None]:
    """Return the same of one case as plain numbers, with the time on the star and the days that the programme spans.

    All are None where there is no frame.

    Parameters
    ----------
    model : EtcModel
    columns : mapping
        Of `programme_columns`.
    case : int or tuple of int
    """
    found: dict[str, Any] = dict.fromkeys((*_FLOATS, *_COUNTS, "integration_s", "span_days"))
    if columns["n_frames"][case] < 1:
        return found
    for name in (*_FLOATS, *_COUNTS):
        value = float(columns[name][case])
        found[name] = None if not math.isfinite(value) else int(value) if name in _COUNTS else value
    found["integration_s"] = found["n_frames"] * found["exposure_s"]
    return found | {"span_days": float(programme_days(model, found["visits"], found["time_s"]))}


Modes = Callable[[Programme, FloatArray, FloatArray, FloatArray], Programme]
"""A programme with what modes change of it, for exposures, frames of a visit, and gains."""
Level = Callable[[Programme, FrameProblem], Callable[[FloatArray, FloatArray], FloatArray]]
"""SNR or significance to reach of a programme and its problem, for lengths of its visits (s) and ``1 / SNR^2`` there.
"""


@dataclass(frozen=True)
class Span:
    """Time of a programme: number of visits, wall time of each, and of all; None for what is not given.

    ``given_s`` is the wall time that may be used, of which whole visits of a given length can leave some.
    """

    visits: int | None = None
    visit_time_s: float | None = None
    time_s: float | None = None
    given_s: float | None = None

    @classmethod
    def of(cls, model: EtcModel, time_s: float | None, visit_time_s: float | None, *, asked: bool = False) -> Self:
        """Return what is given, and what follows from it.

        Parameters
        ----------
        model : EtcModel
            Whose strategy may say the number of visits.
        time_s, visit_time_s : float, optional
            Wall time of the programme and of a visit, 1e-3 to 1e9 s.
        asked : bool
            The time is what is asked for.

        Raises
        ------
        InputError
            For a value out of range, times that contradict each other, and where no time is given or left open.
        """
        visits = model.strategy.visits
        for name, value in (("time_s", time_s), ("visit_time_s", visit_time_s)):
            if value is not None:
                check_range(name, value, 1e-3, 1e9, "s")
        if asked:
            check_visits(visits, visit_time_s, time_s, asked=True)
            return cls(visits, visit_time_s)
        if visit_time_s is None:
            if time_s is None:
                raise InputError("time_s", None, allowed="a wall time, or visits and visit_time_s")
            return cls(visits, None if visits is None else time_s / visits, time_s, time_s)
        if visits is None:
            if time_s is None:
                raise InputError("visits", None, allowed="a number of visits of visit_time_s, or time_s")
            visits = min(math.floor(time_s / visit_time_s * (1.0 + 1e-9)), MAX_VISITS)
            if visits < 1:
                raise InputError("visit_time_s", visit_time_s, unit="s", allowed=f"at most time_s, {time_s:g} s")
        else:
            check_visits(visits, visit_time_s, time_s)
        each_s = visits * visit_time_s
        return cls(visits, visit_time_s, each_s, each_s if time_s is None else max(time_s, each_s))


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
    modes : callable, optional
        What modes change of a programme of such frames; nothing without.
    """

    model: EtcModel
    problem: Callable[[Programme], FrameProblem]
    level: Level
    steady: bool = False
    modes: Modes | None = None

    def best_in_time(self, time_s: ArrayLike) -> FloatArray:
        """Return the numbers of visits that come nearest to the level, or most above it, in a wall time.

        Parameters
        ----------
        time_s : array_like
            Of the whole programme.
        """
        best_s, visit_s = self._exposure_s, float(self.model.time_s(self._shortest_s))
        most = np.minimum(np.floor(np.asarray(time_s, float) / visit_s * (1.0 + 1e-12)), MAX_VISITS)
        most = spread(most, best_s.shape)
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
        """Return the length of visits that comes nearest to the level, up to a bit beyond the longest; else ``inf``.

        The noise of long visits is all speckles, in which a search asks for more.

        Parameters
        ----------
        visits, longest_s : ndarray
            Number of the visits, and their longest length.
        """
        longest_s = np.maximum(_WIDER * longest_s, self._shortest_s)
        best, value = self._bottom(visits, longest_s)
        return np.where(value < self._missed_by(visits, longest_s) * (1.0 - _CLOSE), best, np.inf)

    def _bottom(self, visits: FloatArray, longest_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the length of visits that comes nearest to the level, up to some beyond the longest, and how near."""
        # The same lengths whatever the longest is: so is the best of them.
        low, high = (np.full(longest_s.shape, end) for end in (self._shortest_s, _LONGEST_S))
        grid = np.geomspace(low, high, _MANY_POINTS)
        values = np.where(grid <= longest_s, self._missed_by(visits, grid), np.inf)
        return _lowest(lambda length_s: self._missed_by(visits, length_s), *around_lowest(grid, values)[::2])

    def _missed_by(self, visits: FloatArray, length_s: FloatArray) -> FloatArray:
        """Return ``(level / SNR)^2`` of visits of a length."""
        return self._missed(visits, visits * self.model.time_s(length_s), self._exposure_s)[0]

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

    @property
    def _shortest_s(self) -> float:
        """Length of one frame of the shortest exposure."""
        camera = self.problem(ONE_VISIT).camera
        return camera.exposure_min_s + camera.readout_s

    def _made(self, visits: FloatArray, visit_time_s: ArrayLike) -> tuple[Programme, FrameProblem]:
        programme = self.programme(visits, visit_time_s)
        return programme, self.problem(programme)

    def programme(self, visits: FloatArray, visit_time_s: ArrayLike) -> Programme:
        """Return a programme, with modes of frames that fill its visits and need not be whole.

        Parameters
        ----------
        visits : ndarray
        visit_time_s : array_like
            Wall time of a visit.
        """
        programme = Programme.of(self.model.strategy, visits, visit_time_s)
        if self.modes is None or self.model.strategy.n_modes == 0:
            return programme
        camera, best_s, gain = self._alone
        visit_s = self.model.visit_s(visit_time_s)
        exposure = np.clip(visit_s - camera.readout_s, camera.exposure_min_s, best_s)
        return self.modes(programme, exposure, visit_s / (exposure + camera.readout_s), gain)

    @functools.cached_property
    def _alone(self) -> tuple[FrameCamera, FloatArray, FloatArray]:
        """Camera, and exposure and gain of most SNR per time, which depend little on the programme."""
        problem = self.problem(ONE_VISIT)
        best_s = best_exposure_s(problem)[0]
        return problem.camera, best_s, problem.frame_noise(best_s)[1]

    def _missed(self, visits: FloatArray, time_s: ArrayLike, best_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        each_s = np.asarray(time_s, float) / visits
        programme, problem = self._made(visits, each_s)
        camera, visit = problem.camera, self.model.visit_s(each_s)
        exposure = np.minimum(best_s, visit - camera.readout_s)
        possible = exposure >= camera.exposure_min_s * (1.0 - 1e-12)
        exposure = np.where(possible, exposure, camera.exposure_min_s)
        cost, longest_s = _cost(problem, exposure), visit
        visit = np.minimum(longest_s, peak_visit_s(problem, cost))
        for _ in range(_ROUNDS):  # where not even one frame of that exposure pays: a shorter one
            if not np.any(visit < (exposure + camera.readout_s) * (1.0 - _CLOSE)):
                break
            exposure = np.minimum(exposure, np.maximum(visit - camera.readout_s, camera.exposure_min_s))
            cost = _cost(problem, exposure)
            visit = np.minimum(longest_s, peak_visit_s(problem, cost))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            inverse = np.where(possible & np.isfinite(cost), cost / visit + problem.residual(visit), np.inf)
            return inverse * self.level(programme, problem)(visit, inverse) ** 2, visit

    def _solved(self, visits: FloatArray, best_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        if self.modes is not None and self.model.strategy.n_modes:
            return self._solved_with_modes(visits, best_s)
        drift, wall_s = self.model.instrument.drift, np.array(np.inf)
        for _ in range(1 if drift.correlation_time_h == 0.0 else 4):
            visit, level = self._shortest(visits, wall_s, best_s)
            wall_s = self.model.time_s(visit)
        return visit, level

    def _solved_with_modes(self, visits: FloatArray, best_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the shortest visits where modes follow their length, and the level."""
        # About as long as with the modes of references without noise, or without modes.
        endless_s = self._shortest(visits, np.array(np.inf), best_s)[0]
        visit_s = np.minimum(endless_s, replace(self, modes=None)._solved(visits, best_s)[0])

        def reaching(start_s: FloatArray, wanted: NDArray[np.bool_]) -> FloatArray:
            start_s = np.where(wanted, start_s, 1.0)
            return np.where(wanted, shortest(lambda each: self._missed_by(visits, each), start_s, wanted), np.inf)

        found = reaching(visit_s, np.isfinite(visit_s))
        found = np.where(self._missed_by(visits, found) <= 1.0 + _REACHED, found, np.inf)
        # Shorter ones may do in a narrow range, beyond which modes or a search ask for more than time gains.
        if not self.steady or np.isinf(found).any():
            bottom_s, value = self._bottom(visits, found)
            narrow = (bottom_s < found) & (value <= 1.0 + _REACHED)
            if narrow.any():
                shorter = np.where(value > 1.0, bottom_s, reaching(bottom_s, narrow & (value <= 1.0)))
                found = np.where(narrow, shorter, found)
        return found, self._shortest(visits, self.model.time_s(found), best_s)[1]

    def _shortest(self, visits: FloatArray, wall_s: FloatArray, best_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the shortest visits of programmes with gaps and modes of visits of a length, and the level."""
        programme, problem = self._made(visits, wall_s)
        camera = problem.camera
        shortest_s, frame_s = (exposure + camera.readout_s for exposure in (camera.exposure_min_s, best_s))
        visit, level = self._reached(programme, problem, _cost(problem, best_s))
        if np.any(visit < frame_s):  # not even one frame of that exposure: a shorter one, or one whole
            exposure = np.clip(visit - camera.readout_s, camera.exposure_min_s, best_s)
            other, its_level = self._reached(programme, problem, _cost(problem, exposure))
            whole = (visit < frame_s) & (other > frame_s)
            visit, level = np.where(whole, frame_s, other), np.where(whole, level, its_level)
        return np.maximum(visit, shortest_s), level

    def _reached(self, programme: Programme, problem: FrameProblem, cost: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the shortest visits of the level, and the level, by secants of logarithms from a falling curve's left.

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
    """Return the white noise over signal squared of one second of every visit, in frames of an exposure."""
    camera = problem.camera
    usable = (problem.longest_s >= camera.exposure_min_s * (1.0 - 1e-12)) & (problem.signal_e_s > 0)
    return np.where(usable, problem.frame_noise(exposure_s)[0] * (exposure_s + camera.readout_s), np.inf)


def _lowest(
    missed: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the lengths of visits, between two, of least ``(level / SNR)^2``, and that."""
    for _ in range(_ROUNDS):
        grid = np.geomspace(low, high, _POINTS)
        low, best, high = around_lowest(grid, values := missed(grid))
    return best, values.min(axis=0)


def shortest(missed: Callable[[FloatArray], FloatArray], start_s: FloatArray, wanted: NDArray[np.bool_]) -> FloatArray:
    """Return the shortest visits with which a falling function of their length comes down to 1.

    Parameters
    ----------
    missed : callable
        ``(level / SNR)^2``, of all cases at once; ``inf`` where there is no frame.
    start_s : ndarray
        About as long.
    wanted : ndarray of bool
        Cases to solve.

    Returns
    -------
    ndarray
        The longest that there is where none reaches 1, and where none is wanted.
    """
    low = start_s * 0.99

    def value(_: Any, length_s: FloatArray) -> FloatArray:
        found = missed(length_s.reshape(start_s.shape))
        return np.where(wanted, np.clip(found, 1e-300, 1e300), 1.0).ravel()

    # A search asks for more the longer the visits are: a level may be reached in some range of lengths only.
    high = start_s * np.where(value(None, start_s.ravel()).reshape(start_s.shape) <= 1.0, 1.0, 1.01)
    for factor, end in ((_WIDER, high), (1.0 / _WIDER, low)):
        while True:
            off = value(None, end.ravel()).reshape(end.shape) > 1.0
            off = wanted & (off if factor > 1.0 else ~off) & (end < _LONGEST_S) & (end > _SHORTEST_S)
            if not off.any():
                break
            if factor > 1.0:
                low[off] = end[off]
            else:
                high[off] = end[off]
            end[off] *= factor
    found = first_root(_All(), value, low.ravel(), high.ravel(), np.ones(low.size, bool), tolerance=1e-11)
    return np.where(wanted, found.reshape(start_s.shape), _LONGEST_S)


class _All:
    """Cases that are never looked at apart."""

    def at(self, _: Any) -> Self:
        return self
