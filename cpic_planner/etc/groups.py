"""Cases of the bands of one camera, solved at once: the programmes and frames that answer a question."""

import functools
from dataclasses import dataclass, replace

import numpy as np

from cpic_core import ArrayLike, FloatArray, NDArray
from cpic_planner.etc.frames import FrameChoice, FrameProblem, best_in_visit, least_time, shortened
from cpic_planner.etc.model import EtcModel, Programme
from cpic_planner.etc.noise import Objective
from cpic_planner.etc.programmes import Programmes, Span, shortest
from cpic_planner.etc.searches import spread, taken
from cpic_planner.etc.together import CameraCases, Wanted
from cpic_planner.queries import MAX_VISITS

_LEVEL_STEPS, _SAME, _STILL = 60, 1e-10, 1e-10
_HAIR = 1e-14
_SHORT, _FLAT, _LONGEST_S = 0.98, 2e-3, 1e15


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
            return taken(spread(array, self.level.shape), index)

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
        return Programmes(self.model, self.problem, self.wanted, self.wanted.steady, self.cases.with_modes)

    @property
    def _with_modes(self) -> bool:
        return self.model.strategy.n_modes > 0

    def made(
        self, visits: FloatArray, visit_time_s: ArrayLike, choice: FrameChoice, *, of_choice: bool = False
    ) -> Programme:
        """Return a programme with what modes change where its visits are filled with frames like those of a choice.

        Parameters
        ----------
        visits, visit_time_s : array_like
        choice : FrameChoice
            Where it has no frames, the modes are those of `Programmes.programme`.
        of_choice : bool
            As many frames as the choice has, although they may not fill the visits.
        """
        programme = Programme.of(self.model.strategy, visits, visit_time_s)
        if not self._with_modes:
            return programme
        camera, best_s, gain = self.programmes._alone
        some = choice.n_frames >= 1
        exposure, gain = np.where(some, choice.exposure_s, best_s), np.where(some, choice.em_gain, gain)
        number = self.model.visit_s(visit_time_s) / (exposure + camera.readout_s)
        return self.cases.with_modes(programme, exposure, np.where(some & of_choice, choice.n_frames, number), gain)

    def visits_in(self, span: Span) -> FloatArray:
        """Return the given number of visits, or the best ones in the time."""
        if span.visits is not None:
            return np.full(self._shape, float(span.visits))
        assert span.time_s is not None
        return self.programmes.best_in_time(span.time_s)

    @property
    def possible(self) -> NDArray[np.bool_]:
        """Cases in the dark hole with a level to reach."""
        defined = np.isfinite(self.cases.threshold) | (self.value is not None)
        return np.asarray(spread(self.cases.usable & defined, self._shape))

    def missed_in(self, span: Span) -> FloatArray:
        """Return ``(level / SNR)^2`` of the best programmes in a time, of frames that need not be whole."""
        assert span.time_s is not None
        cost = self.programmes.missed(self.visits_in(span), span.time_s)[0]
        return np.where(self.possible & ~np.isnan(cost), cost, np.inf)

    def paying_s(self, visits: FloatArray, visit_s: FloatArray) -> FloatArray:
        """Return the length of visits, at most the given one, that comes nearest to the level, or most above it.

        It depends on the given one only where that is chosen: more time is never worse.
        """
        if self.wanted.steady:
            return visit_s
        bottom_s = self.programmes.bottom_s(visits, visit_s)
        # At the very bottom the length would be arbitrary: the inverse question could not find it again.
        return np.where(np.isfinite(bottom_s), np.minimum(visit_s, bottom_s * _SHORT), visit_s)

    def level_of(self, programme: Programme, problem: FrameProblem, choice: FrameChoice) -> FloatArray:
        """Return the level that chosen frames have to reach; where there are none, as if visits were short."""
        some = choice.n_frames >= 1
        visit, inverse = np.where(some, choice.visit_s, 1.0), np.where(some, choice.inverse_snr2, np.inf)
        return self.wanted(programme, problem)(visit, inverse)

    def in_time(self, visits: FloatArray, span: Span, exact: bool) -> Found:
        """Return the best frames of a programme in its time; of a chosen number of visits, the best of those beside."""
        assert span.time_s is not None
        if span.visits is None:
            visits = np.stack(_beside(visits))
        found = self.framed(visits, span.time_s / visits, whole=exact, quickest=False)
        visit_s = spread(self.model.visit_s(span.time_s / visits), found.level.shape)
        if span.visits is None:
            missed = np.where(visit_s > 0, found.choice.inverse_snr2 * found.level**2, np.inf)
            index = np.argmin(missed, axis=0)
            found, visit_s, visits = found.taken(index), taken(visit_s, index), taken(visits, index)
        if exact:
            return found
        if self._with_modes:
            return self.framed(visits, span.time_s / visits)
        choice = shortened(found.problem, found.choice, visit_s)
        return replace(found, choice=choice, level=self.level_of(found.programme, found.problem, choice))

    def framed(self, visits: FloatArray, visit_time_s: FloatArray, **settings: bool) -> Found:
        """Return visits of a wall time with their best frames, and with what modes change where it has those.

        Parameters
        ----------
        visits, visit_time_s : ndarray
        **settings
            Of `cpic_planner.etc.frames.best_in_visit`.
        """
        programme = self.programmes.programme(visits, visit_time_s)
        problem = self.problem(programme)
        visit_s = spread(self.model.visit_s(visit_time_s), problem.signal_e_s.shape)
        choice = best_in_visit(problem, visit_s, **settings)
        for _ in range(_LEVEL_STEPS if self._with_modes else 0):
            last, programme = choice, self.made(visits, visit_time_s, choice, of_choice=True)
            problem = self.problem(programme)
            choice = best_in_visit(problem, visit_s, **settings)
            if np.allclose(choice.visit_s, last.visit_s, rtol=_STILL, atol=0.0):
                break
        return Found(self, programme, problem, choice, self.level_of(programme, problem, choice))

    def spread(self, visits: FloatArray, time_s: float) -> tuple[Programme, FrameProblem, FloatArray]:
        """Return the programmes of so many visits in a time, with the length of their science visits."""
        programme = self.programmes.programme(visits, time_s / visits)
        problem = self.problem(programme)
        return programme, problem, spread(self.model.visit_s(time_s / visits), problem.signal_e_s.shape)

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
        """Return the programmes of fewest visits of one length that reach the level, in whole frames, or one more."""
        for _ in range(3):
            found = self.framed(visits, np.full(visits.shape, visit_time_s))
            choice = found.choice
            short = np.sqrt(choice.inverse_snr2) * found.level > 1.0 + _SAME
            if not np.any(short & (visits < MAX_VISITS)):
                break
            visits = np.minimum(np.where(short, visits + np.ceil(visits * 0.002), visits), MAX_VISITS)
        return replace(found, choice=choice.where(~short, replace(choice, n_frames=np.zeros_like(choice.n_frames))))

    def at_level(self, visits: FloatArray) -> Found:
        """Return the quickest frames of so many visits that reach the level, which may depend on them."""
        if not self._with_modes:
            return self._of_mean(visits)
        visit_s = self.programmes.solved(visits)[0]
        reachable = np.isfinite(visit_s)

        def in_visits(length_s: FloatArray) -> tuple[FloatArray, Found]:
            found = self.framed(visits, self.model.time_s(length_s))
            return found.choice.inverse_snr2 * found.level**2, found

        # The frames of the shortest visits that reach it: the question for a time, turned round.
        start_s = np.where(reachable, visit_s, 1.0)
        taken_s = shortest(lambda length_s: in_visits(length_s)[0], start_s, reachable)
        missed, found = in_visits(taken_s * (1.0 + _HAIR))
        lost = ~reachable | (missed > 1.0 + _SAME)
        choice = found.choice
        none = np.zeros_like(choice.n_frames)
        return replace(found, choice=choice.where(~lost, replace(choice, n_frames=none, visit_s=none)))

    def _of_mean(self, visits: FloatArray) -> Found:
        """Return the same without modes."""
        model, last = self.model, None
        steady = self.wanted.steady and model.instrument.drift.correlation_time_h == 0.0
        if steady:
            wall_s, level = np.array(np.inf), spread(self.wanted.level, visits.shape)
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
    """Return one visit, and numbers of visits as they are, one less and one more."""
    return [np.ones_like(visits), *(np.clip(visits + step, 1.0, MAX_VISITS) for step in (-1, 0, 1))]
