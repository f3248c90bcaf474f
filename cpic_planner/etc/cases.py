"""Cases of a question: stars x planets in bands of one camera, and the programmes and frames that reach a level."""

import copy
import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, NDArray, Reason, Status
from cpic_planner.etc.chances import Chances
from cpic_planner.etc.detection import threshold_array
from cpic_planner.etc.detection_law import SearchLaw, band_law
from cpic_planner.etc.frames import (
    FrameChoice,
    FrameProblem,
    best_exposure_s,
    best_in_visit,
    frame_problem,
    least_time,
    shortened,
)
from cpic_planner.etc.model import (
    ONE_VISIT,
    EtcModel,
    FrameCamera,
    Programme,
    check_range,
    hole_notes,
    place_status,
    usable_range_arcsec,
)
from cpic_planner.etc.noise import Objective, StackNoise, residuals, stack_noise, white_term, with_modes
from cpic_planner.etc.programmes import Programmes, SearchMotion, Span, motion_factor, shortest
from cpic_planner.etc.rates import (
    NEAREST_ARCSEC,
    QUADRANTS,
    ApertureRates,
    Planets,
    aperture_rates,
    planet_offsets,
    reference_contrast,
    reference_distance_au,
    reference_notes,
)
from cpic_planner.etc.searches import spread, taken
from cpic_planner.planets import excluded_by_rv
from cpic_planner.queries import MAX_VISITS
from cpic_planner.targets import Targets
from simulator.detectors import FrameTerm
from simulator.effects import SKY_PLACE_UNKNOWN, sky_place_unknown
from simulator.imaging import quadrant_of
from simulator.signal import ProgrammeLaw, SpeckleLaw, programme_parts

_FAINTEST, _ORDINARY = 1e-30, 1e-9
_ROUNDING = 1e-12
_LEVEL_STEPS, _SAME, _STILL = 60, 1e-10, 1e-10
_HAIR = 1e-14
_SHORT, _LONGEST_S = 0.98, 1e15
_OF_PLACES = ("goal", "search", "motion", "residual_parts", "separation_arcsec", "usable")


@dataclass(frozen=True)
class FixedFrames:
    """The settings of frames that the user fixes; the rest is optimised."""

    exposure_s: float | None = None
    em_gain: float | None = None


def fixed_frames(
    model: EtcModel, bands: Sequence[str] | None, exposure_s: float | None, em_gain: float | None
) -> FixedFrames:
    """Return what is fixed of the frames, refused where a camera of the bands cannot do it."""
    cameras = [model.camera(band) for band in model.named(bands)]
    limits: dict[str, Any] = {}
    if exposure_s is not None:
        shortest_s = max(camera.exposure_min_s for camera in cameras)
        limits["exposure_s"] = check_range("exposure_s", exposure_s, shortest_s, 1e6, "s")
    if em_gain is not None:
        limits["em_gain"] = check_range("em_gain", em_gain, 1.0, min(camera.em_gain_max for camera in cameras), "")
    return FixedFrames(**limits)


@dataclass(frozen=True, eq=False)
class Cases:
    """All stars and planets in bands of one camera, made by `cases_of`.

    Arrays broadcast to ``(n_band, n_star, n_planet)``, the shape of ``contrast``.

    Attributes
    ----------
    model : EtcModel
    targets : Targets
    bands : tuple of str
    planets : tuple of Planets
        Of each band.
    places : tuple of tuple
        Of each band, whether each planet's aperture lies in the controlled zone: status, reason and message.
    fixed : FixedFrames
    x_arcsec, y_arcsec : ndarray
        Offsets of the planets on the detector.
    contrast, threshold : ndarray
        Small-sample thresholds are infinite where none is defined.
    rates : ApertureRates
    by_band : tuple of ApertureRates
        Rates of each band alone, of planets of the first contrast.
    objective : {"snr", "significance"}
        What is to be reached.
    value : float or None
        How much of it; None for a detection as the strategy searches.
    programme : Programme
    """

    model: EtcModel
    targets: Targets
    bands: tuple[str, ...]
    planets: tuple[Planets, ...]
    places: tuple[tuple[tuple[Status, Reason, str], ...], ...]
    fixed: FixedFrames
    x_arcsec: FloatArray
    y_arcsec: FloatArray
    contrast: FloatArray
    threshold: FloatArray
    rates: ApertureRates
    by_band: tuple[ApertureRates, ...]
    objective: Objective
    value: float | None
    programme: Programme = ONE_VISIT

    @property
    def shape(self) -> tuple[int, ...]:
        """Return the numbers of bands, stars and planets."""
        return self.contrast.shape

    @functools.cached_property
    def camera(self) -> FrameCamera:
        """One frame of the camera that all bands share, of the exposure that is fixed."""
        return _fixed_camera(self.model, self.bands[0], self.fixed)

    @property
    def free_camera(self) -> FrameCamera:
        """One frame of the camera that all bands share, of any exposure."""
        return self.model.camera(self.bands[0])

    @functools.cached_property
    def usable(self) -> NDArray[np.bool_]:
        """Cases whose aperture lies in the controlled zone."""
        inside = np.array([[place[0] is Status.OK for place in places] for places in self.places])
        return np.asarray(spread(inside[:, None], self.shape))

    @functools.cached_property
    def separation_arcsec(self) -> FloatArray:
        """Projected separations."""
        return np.asarray(spread(np.hypot(self.x_arcsec, self.y_arcsec), self.shape))

    @functools.cached_property
    def motion(self) -> SearchMotion | None:
        """Price that a search pays for the motion of the planets; None where it knows their places."""
        if self.model.strategy.search != "blind":
            return None
        pairs = zip(self.bands, self.separation_arcsec, strict=True)
        every = (SearchMotion.of(self.model, self.targets, band, place) for band, place in pairs)
        return SearchMotion.stacked([one.spread(self.shape[1:]) for one in every])

    @functools.cached_property
    def residual_parts(self) -> tuple[ProgrammeLaw, ProgrammeLaw]:
        """Residual in units of the star's light: cross term with the static field, and light of the errors."""
        model, strategy = self.model, self.model.strategy
        shared = strategy.annulus_lambda_d, strategy.reference_ratio, model.timing
        pairs = zip(self.bands, np.hypot(self.x_arcsec, self.y_arcsec), strict=True)
        parts = [programme_parts(model.metrics[band], model.instrument.drift, at, *shared) for band, at in pairs]
        crossed, light = _together(parts, self.shape[1:])
        return crossed, light

    @functools.cached_property
    def search(self) -> "Goal":
        """Level of a detection as the strategy searches."""
        return Goal.of(self)

    @functools.cached_property
    def goal(self) -> "Goal":
        """Level to reach; 1 where none is defined, which can be solved like others."""
        goal = self.search if self.value is None else Goal.of(self, self.value)
        return replace(goal, level=np.where(np.isfinite(goal.level), goal.level, 1.0))

    @property
    def possible(self) -> NDArray[np.bool_]:
        """Cases in the dark hole with a level to reach."""
        defined = np.isfinite(self.threshold) | (self.value is not None)
        return np.asarray(spread(self.usable & defined, self.shape))

    @functools.cached_property
    def programmes(self) -> Programmes:
        """All programmes of the cases."""
        return Programmes(self.model, self.problem_in, self.goal, self.goal.steady, self.with_modes)

    @functools.cached_property
    def _single(self) -> dict[Objective, FrameProblem]:
        """Problems of a single visit, with their exposures of most SNR per time, as far as they were asked for."""
        return {}

    @functools.cached_property
    def _white(self) -> FrameTerm:
        """White noise of a frame of a single visit but the planet's own."""
        return white_term(self.rates, self.camera, ONE_VISIT.frame_ratio(self.model.strategy.reference_ratio))

    def in_programme(self, programme: Programme) -> Self:
        """Return the cases in another programme."""
        made = copy.copy(self)
        object.__setattr__(made, "programme", programme)
        return made

    def of_contrast(self, contrast: FloatArray) -> Self:
        """Return the cases with other contrasts; what does not follow them is kept."""
        made = replace(self, contrast=contrast, rates=self.rates_at(contrast))
        vars(made).update({name: vars(self)[name] for name in _OF_PLACES if name in vars(self)})
        return made

    def rates_at(self, contrast: FloatArray) -> ApertureRates:
        """Return the rates with other contrasts: only the planet's own light follows them."""
        own = self.rates.peak_in_hole_e_s - self.rates.peak_planet_e_s
        factor = contrast / np.maximum(self.contrast, _FAINTEST)
        peak = self.rates.peak_planet_e_s * factor
        planet_e_s = self.rates.planet_e_s * factor
        return replace(self.rates, planet_e_s=planet_e_s, peak_planet_e_s=peak, peak_in_hole_e_s=own + peak)

    def with_modes(
        self, programme: Programme, exposure_s: FloatArray, n_frames: FloatArray, em_gain: FloatArray
    ) -> Programme:
        """Return a programme with what modes change where it has these frames (`cpic_planner.etc.noise.with_modes`).

        Parameters
        ----------
        programme : Programme
        exposure_s, n_frames, em_gain : ndarray
            Frames of a visit.
        """
        if self.model.strategy.n_modes == 0:
            return programme
        parts = []
        for i, (band, rates) in enumerate(zip(self.bands, self.by_band, strict=True)):
            own = programme._combined(lambda array, at=i: _of_band(array, at))
            frames = (_of_band(part, i) for part in (exposure_s, n_frames, em_gain))
            place = np.hypot(self.x_arcsec[i], self.y_arcsec[i])
            parts.append(with_modes(self.model, band, place, rates, own, *frames))
        shape = np.broadcast_shapes((1, 1), *(np.shape(array) for part in parts for array in vars(part).values()))
        return Programme.stacked([part.spread(shape) for part in parts], axis=-3)

    def programme_of(self, visits: ArrayLike, visit_time_s: ArrayLike, choice: FrameChoice) -> Programme:
        """Return another number of visits of chosen frames.

        Parameters
        ----------
        visits, visit_time_s : array_like
        choice : FrameChoice
        """
        programme = Programme.of(self.model.strategy, visits, visit_time_s)
        return self.with_modes(programme, choice.exposure_s, choice.n_frames, choice.em_gain)

    def problem_in(self, programme: Programme, contrast: FloatArray | None = None) -> FrameProblem:
        """Return the problem of a programme for the cases' own objective; as `problem`."""
        return self.problem(self.objective, contrast, programme)

    def problem(
        self, objective: Objective, contrast: FloatArray | None = None, programme: Programme | None = None
    ) -> FrameProblem:
        """Return what the solver needs, with the exposure of most SNR per time where it is that of one visit.

        Parameters
        ----------
        objective : {"snr", "significance"}
        contrast : ndarray, optional
            Contrasts instead of the cases' own, of their shape.
        programme : Programme, optional
            Instead of the cases' own.
        """
        made, strategy = self.programme if programme is None else programme, self.model.strategy

        def framed(made: Programme, rates: ApertureRates = self.rates, white: FrameTerm | None = None) -> FrameProblem:
            settings: dict[str, Any] = {"objective": objective, "em_gain": self.fixed.em_gain, "white": white}
            return frame_problem(rates, self.camera, strategy, programme=made, **settings)

        shares = made.frame_ratio(strategy.reference_ratio)
        # As many references a frame: a visit has the white noise of a single one, unless modes leave another part.
        modes, alike = strategy.n_modes > 0, bool((shares == strategy.reference_ratio).all())
        if contrast is not None:
            return framed(made, self.rates_at(contrast), self._white if alike and not modes else None)
        if modes or (not alike and np.any(np.abs(shares / strategy.reference_ratio - 1.0) > _ROUNDING)):
            return framed(made)
        if objective not in self._single:
            single = framed(ONE_VISIT)
            self._single[objective] = replace(single, best_s=best_exposure_s(single)[0])
        if alike:
            return in_programme(self._single[objective], self.rates, made, objective)
        other = framed(made)
        return replace(other, best_s=spread(self._single[objective].best_s, other.signal_e_s.shape))

    def noise(self, choice: FrameChoice) -> StackNoise:
        """Return the signal and noise of chosen frames."""
        return self.noise_of(self.rates, self.free_camera, choice)

    def noise_of(
        self, rates: ApertureRates, camera: FrameCamera, choice: FrameChoice, ratio: float = 1.0
    ) -> StackNoise:
        """Return signal and noise of chosen frames, for other rates, another camera, or more reference frames.

        Parameters
        ----------
        rates : ApertureRates
        camera : FrameCamera
        choice : FrameChoice
            Frames of every case.
        ratio : float
            Reference frames over those of the strategy.
        """
        strategy = self.model.strategy
        if ratio != 1.0:
            strategy = strategy.model_copy(update={"reference_ratio": ratio * strategy.reference_ratio})
        frames = choice.exposure_s, choice.n_frames, choice.em_gain
        return stack_noise(rates, *frames, camera, strategy, self.programme)

    def head(self, band: int, star: int, planet: int) -> dict[str, Any]:
        """Return the fields of an answer that do not depend on the question.

        Parameters
        ----------
        band, star, planet : int
            The case.
        """
        model, name = self.model, self.bands[band]
        notes = [*self.targets.flags[star], *hole_notes(model, name), *model.library_flags]
        if sky_place_unknown(model.instrument, self.targets.ra_deg[star], self.targets.dec_deg[star]):
            notes.append(SKY_PLACE_UNKNOWN)
        inside = self.places[band][planet][0] is Status.OK
        x, y, core, threshold = (
            float(spread(part, self.shape)[band, star, planet])
            for part in (self.x_arcsec, self.y_arcsec, self.rates.core, self.threshold)
        )
        return {
            "target": str(self.targets.name[star]),
            "band": name,
            "separation_arcsec": float(self.planets[band].separation_arcsec[planet]),
            "threshold": threshold if inside and np.isfinite(threshold) else None,
            "core_throughput": core if inside else None,
            "quadrant": QUADRANTS[quadrant_of(x, y)] if inside else None,
            "roll_deg": self.targets.roll_deg,
            "reference_library": model.strategy.reference_library.name,
            "centring": model.strategy.centring,
            "annulus_lambda_d": model.strategy.annulus_lambda_d,
            "flags": tuple(notes),
        }

    def planet_notes(self, band: int, star: int, planet: int) -> tuple[str, ...]:
        """Return the flags of the planet's model.

        Parameters
        ----------
        band, star, planet : int
            The case.
        """
        planets = self.planets[band]
        place = float(planets.separation_arcsec[planet])
        if planets.contrast is not None or place <= 0:
            return ()
        body, target = planets.models[planet], self.targets.select([star])
        distance = float(reference_distance_au(target, np.array([place]), body)[0, 0])
        notes = reference_notes(self.model, target, self.bands[band], place, body)
        excluded = _excluded(str(target.name[0]), distance, body.radius_rjup)
        return (*notes, "excluded_by_rv") if excluded else notes

    def visits_in(self, span: Span) -> FloatArray:
        """Return the given number of visits, or the best ones in the time."""
        if span.visits is not None:
            return np.full(self.shape, float(span.visits))
        assert span.time_s is not None
        return self.programmes.best_in_time(span.time_s)

    def missed_in(self, span: Span) -> FloatArray:
        """Return ``(level / SNR)^2`` of the best programmes in a time, of frames that need not be whole."""
        assert span.time_s is not None
        cost = self.programmes.missed(self.visits_in(span), span.time_s)[0]
        return np.where(self.possible & ~np.isnan(cost), cost, np.inf)

    def paying_s(self, visits: FloatArray, visit_s: FloatArray) -> FloatArray:
        """Return the length of visits, at most the given one, that comes nearest to the level, or most above it.

        It depends on the given one only where that is chosen: more time is never worse.
        """
        if self.goal.steady:
            return visit_s
        bottom_s = self.programmes.bottom_s(visits, visit_s)
        # At the very bottom the length would be arbitrary: the inverse question could not find it again.
        return np.where(np.isfinite(bottom_s), np.minimum(visit_s, bottom_s * _SHORT), visit_s)

    def level_of(self, programme: Programme, problem: FrameProblem, choice: FrameChoice) -> FloatArray:
        """Return the level that chosen frames have to reach; where there are none, as if visits were short."""
        some = choice.n_frames >= 1
        visit, inverse = np.where(some, choice.visit_s, 1.0), np.where(some, choice.inverse_snr2, np.inf)
        return self.goal(programme, problem)(visit, inverse)

    def filled(
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
        if not self.model.strategy.n_modes:
            return programme
        camera, best_s, gain = self.programmes._alone
        some = choice.n_frames >= 1
        exposure, gain = np.where(some, choice.exposure_s, best_s), np.where(some, choice.em_gain, gain)
        number = self.model.visit_s(visit_time_s) / (exposure + camera.readout_s)
        return self.with_modes(programme, exposure, np.where(some & of_choice, choice.n_frames, number), gain)

    def spread(self, visits: FloatArray, time_s: float) -> tuple[Programme, FloatArray]:
        """Return the programmes of so many visits in a time, with the length of their science visits."""
        programme = self.programmes.programme(visits, time_s / visits)
        shape = self.problem_in(programme).signal_e_s.shape
        return programme, spread(self.model.visit_s(time_s / visits), shape)

    def in_time(self, span: Span, exact: bool) -> "Solution":
        """Return the best frames of programmes in a time; of a chosen number of visits, the best of those beside."""
        assert span.time_s is not None
        visits = self.visits_in(span)
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
        if self.model.strategy.n_modes:
            return self.framed(visits, span.time_s / visits)
        return found.of_choice(shortened(found.problem, found.choice, visit_s))

    def framed(self, visits: FloatArray, visit_time_s: FloatArray, **settings: bool) -> "Solution":
        """Return visits of a wall time with their best frames, and with what modes change where it has those.

        Parameters
        ----------
        visits, visit_time_s : ndarray
        **settings
            Of `cpic_planner.etc.frames.best_in_visit`.
        """
        programme = self.programmes.programme(visits, visit_time_s)
        problem = self.problem_in(programme)
        visit_s = spread(self.model.visit_s(visit_time_s), problem.signal_e_s.shape)
        choice = best_in_visit(problem, visit_s, **settings)
        for _ in range(_LEVEL_STEPS if self.model.strategy.n_modes else 0):
            last, programme = choice, self.filled(visits, visit_time_s, choice, of_choice=True)
            problem = self.problem_in(programme)
            choice = best_in_visit(problem, visit_s, **settings)
            if np.allclose(choice.visit_s, last.visit_s, rtol=_STILL, atol=0.0):
                break
        return Solution(self, programme, problem, choice, self.level_of(programme, problem, choice))

    def for_level(self, span: Span) -> "Solution":
        """Return the quickest frames that reach the level, with the number of visits that is given or best."""
        model, every = self.model, self.programmes
        if span.visit_time_s is not None:
            visit_s = float(model.visit_s(span.visit_time_s))
            visits = np.minimum(every.fewest(visit_s), MAX_VISITS)
            return self._in_visits(visits, span.visit_time_s)
        if span.visits is not None:
            return self.at_level(np.full(self.shape, float(span.visits)))
        best = every.quickest()
        near = np.stack([*_beside(best), np.full_like(best, MAX_VISITS)])
        found = self.at_level(near)
        cost = np.where(found.choice.n_frames >= 1, near * model.time_s(found.choice.visit_s), np.inf)
        # Where none reaches it, as many visits as there may be say what forbids it.
        cost[-1] = _LONGEST_S
        return found.taken(np.argmin(cost, axis=0))

    def _in_visits(self, visits: FloatArray, visit_time_s: float) -> "Solution":
        """Return the programmes of fewest visits of one length that reach the level, in whole frames, or one more."""
        for _ in range(3):
            found = self.framed(visits, np.full(visits.shape, visit_time_s))
            choice = found.choice
            short = np.sqrt(choice.inverse_snr2) * found.level > 1.0 + _SAME
            if not np.any(short & (visits < MAX_VISITS)):
                break
            visits = np.minimum(np.where(short, visits + np.ceil(visits * 0.002), visits), MAX_VISITS)
        return replace(found, choice=choice.where(~short, replace(choice, n_frames=np.zeros_like(choice.n_frames))))

    def at_level(self, visits: FloatArray) -> "Solution":
        """Return the quickest frames of so many visits that reach the level, which may depend on them."""
        if not self.model.strategy.n_modes:
            return self._at_level_by_mean(visits)
        visit_s = self.programmes.solved(visits)[0]
        reachable = np.isfinite(visit_s)

        def in_visits(length_s: FloatArray) -> tuple[FloatArray, Solution]:
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

    def _at_level_by_mean(self, visits: FloatArray) -> "Solution":
        """Return the same without modes."""
        model, last = self.model, None
        steady = self.goal.steady and model.instrument.drift.correlation_time_h == 0.0
        if steady:
            wall_s, level = np.array(np.inf), spread(self.goal.level, visits.shape)
        else:
            visit_s, level = self.programmes.solved(visits)
            wall_s = model.time_s(visit_s)
        for _ in range(_LEVEL_STEPS):
            programme = Programme.of(model.strategy, visits, wall_s)
            problem = self.problem_in(programme)
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
        return Solution(self, programme, problem, choice, level)


@dataclass(frozen=True, eq=False)
class Solution:
    """Programmes and frames that answer for cases; arrays ``(n_band, n_star, n_planet)``."""

    cases: Cases
    programme: Programme
    problem: FrameProblem
    choice: FrameChoice
    level: FloatArray

    def taken(self, index: NDArray[np.int_]) -> "Solution":
        """Return one element of the first axis of every case."""

        def take(array: FloatArray) -> FloatArray:
            return taken(spread(array, self.level.shape), index)

        programme, problem = self.programme._combined(take), self.problem._combined(take)
        return Solution(self.cases, programme, problem, self.choice._combined(take), take(self.level))

    def of_choice(self, choice: FrameChoice) -> "Solution":
        """Return the same programmes with other frames."""
        return replace(self, choice=choice, level=self.cases.level_of(self.programme, self.problem, choice))


def _beside(visits: FloatArray) -> list[FloatArray]:
    """Return one visit, and numbers of visits as they are, one less and one more."""
    return [np.ones_like(visits), *(np.clip(visits + step, 1.0, MAX_VISITS) for step in (-1, 0, 1))]


@functools.lru_cache(maxsize=256)
def _excluded(name: str, distance_au: float, radius_rjup: float) -> bool:
    """Return whether velocities exclude a planet: every band of a question asks about the same one."""
    return bool(excluded_by_rv([name], distance_au, radius_rjup)[0])


def cases_by_camera(
    model: EtcModel,
    targets: Targets,
    bands: Sequence[str] | None,
    planets: Planets | Mapping[str, Planets],
    fixed: FixedFrames,
    snr: float | None = None,
    sigma: float | None = None,
    *,
    offsets_arcsec: tuple[float, float] | None = None,
) -> list[Cases]:
    """Return the cases of every camera.

    Parameters
    ----------
    model, targets, planets, fixed, offsets_arcsec
        As of `cases_of`.
    bands : sequence of str, optional
        All of the model by default.
    snr, sigma : float, optional
        Photometric SNR or plain significance to reach; by default a detection.
    """
    if len(targets) < 1:
        raise InputError("target", len(targets), allowed="at least one star")
    cameras = {band: _fixed_camera(model, band, fixed) for band in model.named(bands)}
    alike = [[band for band in cameras if cameras[band] == one] for one in dict.fromkeys(cameras.values())]
    level: dict[str, Any] = {
        "objective": "significance" if snr is None else "snr",
        "value": sigma if snr is None else snr,
    }
    return [cases_of(model, targets, same, planets, fixed, **level, offsets_arcsec=offsets_arcsec) for same in alike]


def _fixed_camera(model: EtcModel, band: str, fixed: FixedFrames) -> FrameCamera:
    """Return one frame of a band's camera, of the exposure that is fixed."""
    camera = model.camera(band)
    if fixed.exposure_s is None:
        return camera
    return replace(camera, exposure_min_s=fixed.exposure_s, exposure_max_s=fixed.exposure_s)


def cases_of(
    model: EtcModel,
    targets: Targets,
    bands: Sequence[str],
    planets: Planets | Mapping[str, Planets] | Sequence[Planets],
    fixed: FixedFrames | None = None,
    *,
    objective: Objective = "snr",
    value: float | None = None,
    offsets_arcsec: tuple[float, float] | None = None,
) -> Cases:
    """Return rates and places of all stars and planets in bands that share a camera.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
    bands : sequence of str
    planets : Planets, mapping or sequence of it
        Of all bands, or as many of each, by name or in their order.
    fixed : FixedFrames, optional
        What is fixed of the frames.
    objective : {"snr", "significance"}
    value : float, optional
        Level to reach; by default that of a detection.
    offsets_arcsec : tuple of float, optional
        A place in the dark hole at which all planets stand, instead of the diagonal at their separations.
    """
    if isinstance(planets, Planets):
        own = [planets] * len(bands)
    else:
        own = [planets[band] for band in bands] if isinstance(planets, Mapping) else list(planets)
    parts = [_in_band(model, targets, band, one, offsets_arcsec) for band, one in zip(bands, own, strict=True)]
    places, *columns, by_band = zip(*parts, strict=True)
    shape = len(targets), len(own[0])
    x, y, contrast, threshold = (_together(column, shape) for column in columns)
    rates, programme = _together(by_band, shape), Programme.of(model.strategy)
    head = model, targets, tuple(bands), tuple(own), places, fixed or FixedFrames()
    return Cases(*head, x, y, contrast, threshold, rates, by_band, objective, value, programme)


def _in_band(
    model: EtcModel, targets: Targets, band: str, planets: Planets, offsets_arcsec: tuple[float, float] | None
) -> tuple[Any, ...]:
    """Return the status of all places in one band, offsets, contrasts, thresholds and rates."""
    metrics, place = model.metrics[band], planets.separation_arcsec
    places = tuple(place_status(model, band, float(value)) for value in place)
    if offsets_arcsec is not None:
        places = ((Status.OK, Reason.NONE, ""),) * len(place)
    inside = np.array([status is Status.OK for status, _, _ in places])
    # What has no answer (a place outside the hole, no light) is carried along as something that can be solved.
    solvable = np.where(inside, place, np.mean(usable_range_arcsec(model.instrument, band)))
    x, y = planet_offsets(model, targets, band, solvable[None, :])
    if offsets_arcsec is not None:
        x, y = (np.full_like(x, part) for part in offsets_arcsec)
    contrast = _contrasts(model, targets, band, planets)
    light = np.where(inside, np.maximum(contrast, _FAINTEST), _ORDINARY)
    rates = aperture_rates(model, targets, band, x, y, light)
    return places, x, y, contrast, threshold_array(metrics.resolution_elements(place), model.strategy.sigma), rates


def _contrasts(model: EtcModel, targets: Targets, band: str, planets: Planets) -> FloatArray:
    """Return the contrasts ``(n_star, n_planet)``; planets of one model are computed together."""
    shape = (len(targets), len(planets))
    if planets.contrast is not None:
        return np.asarray(spread(planets.contrast, shape))
    contrast = np.zeros(shape)
    for body in dict.fromkeys(planets.models):
        own = np.array([other == body for other in planets.models]) & (planets.separation_arcsec >= NEAREST_ARCSEC)
        if own.any():
            contrast[:, own] = reference_contrast(model, targets, band, planets.separation_arcsec[own], body)
    return contrast


def in_programme(
    problem: FrameProblem, rates: ApertureRates, programme: Programme, objective: Objective = "snr"
) -> FrameProblem:
    """Return the problem of one visit in a programme by the mean of as many reference frames: only speckles differ.

    Parameters
    ----------
    problem : FrameProblem
        Of one visit, by `frame_problem` of the rates.
    rates : ApertureRates
    programme : Programme
        Without modes.
    objective : {"snr", "significance"}
        That of the problem.
    """
    level = 1.0 + 1.0 / rates.background_apertures if objective == "snr" else 1.0
    z0, z1, z2 = residuals(rates, level, programme)
    shape = np.broadcast(problem.signal_e_s, z0, z1, z2, programme.visits).shape
    parts = {"z0": z0, "z1": z1, "z2": z2, "visits": programme.visits}
    wide = problem if problem.signal_e_s.shape == shape else problem.spread(shape)
    return replace(wide, **{name: spread(part, shape) for name, part in parts.items()})


def _of_band(array: FloatArray, index: int) -> FloatArray:
    """Return one band of an array ``(..., n_band, n_star, n_planet)``; what is the same for all bands stays."""
    whole = np.asarray(array)
    return whole if whole.ndim < 3 else whole[..., index if whole.shape[-3] > 1 else 0, :, :]


def _together(parts: Sequence[Any], shape: tuple[int, ...]) -> Any:
    """Return arrays of one shape on a new first axis, part by part of tuples and rates; equal numbers stay one.

    Parameters
    ----------
    parts : sequence
        Arrays and numbers that broadcast to the shape, or tuples of such, or rates.
    shape : tuple of int
    """
    first: Any = parts[0]
    if isinstance(first, ApertureRates):
        names = [item.name for item in fields(first)]
        return replace(first, **{name: _together([getattr(part, name) for part in parts], shape) for name in names})
    if isinstance(first, tuple):
        every = [_together(of_one, shape) for of_one in zip(*parts, strict=True)]
        return type(first)(*every) if hasattr(first, "_fields") else tuple(every)
    if first is None or (not isinstance(first, np.ndarray) and all(part == first for part in parts)):
        return first
    whole = np.empty((len(parts), *shape))
    for place, part in zip(whole, parts, strict=True):
        place[...] = part
    return whole


@dataclass(frozen=True, eq=False)
class Goal:
    """SNR or significance that cases have to reach; arrays ``(n_band, n_star, n_planet)``.

    A search asks for more the more of the noise is light of the wavefront's errors, and for less the more visits
    average it: its level depends on the programme (`cpic_planner.etc.detection_law`).

    Attributes
    ----------
    level : ndarray
        What is to be reached, or small-sample thresholds; infinite where none is defined.
    laws : tuple of SearchLaw
        Law of detections of each band; without any the level is all.
    at_place : bool
        Whether the place of a planet is known.
    residual, averaging : ProgrammeLaw, optional
        What frames do not average, (e-/s)^2, and what of it visits do.
    crossed, light : SpeckleLaw, optional
        Two parts of the latter, of one visit: the cross term with the static field, and the light of the errors.
    separation_arcsec : ndarray, optional
    motion : SearchMotion, optional
        What the search pays for the motion of planets; nothing without.
    """

    level: FloatArray
    laws: tuple[SearchLaw, ...] = ()
    at_place: bool = False
    averaging: ProgrammeLaw | None = None
    crossed: SpeckleLaw | None = None
    light: SpeckleLaw | None = None
    separation_arcsec: FloatArray | None = None
    motion: SearchMotion | None = None

    @property
    def steady(self) -> bool:
        """Tell whether the level is the same for all programmes."""
        return not self.laws and self.motion is None

    @classmethod
    def of(cls, cases: Cases, value: float | None = None) -> Self:
        """Return the level of cases: a given value, or that of a detection as the strategy searches."""
        shape = cases.contrast.shape
        if value is not None:
            return cls(np.full(shape, float(value)))
        model, laws = cases.model, tuple(band_law(cases.model, band) for band in cases.bands)
        thresholds = spread(cases.threshold, shape)
        averaging = cases.rates.speckle.averaging().scaled(cases.rates.variance_factor)
        crossed, light = (part.averaging().law() for part in cases.residual_parts)
        at_place = model.strategy.search == "known_place"
        place = cases.separation_arcsec
        return cls(thresholds, laws, at_place, averaging, crossed, light, place, cases.motion)

    def __call__(self, programme: Programme, problem: FrameProblem) -> Callable[[FloatArray, FloatArray], FloatArray]:
        """Return the level of a programme: of the length of its visits, and of noise over signal squared."""
        at = self.at_speckles(programme)
        if not self.laws or self.averaging is None:
            return lambda visit_s, inverse: at(np.zeros_like(inverse), visit_s)
        averaging, signal2 = programme.law(self.averaging), problem.signal_e_s**2

        def level(visit_s: FloatArray, inverse: FloatArray) -> FloatArray:
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                residual = problem.residual(visit_s)
                light = self.light_share(visit_s) * averaging.variance(visit_s) / signal2 / residual
                return at(residual / inverse, visit_s, light)

        return level

    def at_speckles(self, programme: Programme) -> Callable[..., FloatArray]:
        """Return the level of a programme: of the share of its variance that frames do not average, and of the visits.

        The arguments are that share, the length of the visits in s, and the share of the errors' light in the former.
        """
        own, motion, laws, place = self.level, self.motion, self.laws, self.separation_arcsec

        def level(speckled: FloatArray, visit_s: FloatArray, light: FloatArray | float = 0.0) -> FloatArray:
            if not laws or place is None or self.averaging is None:
                at_rest = np.broadcast_arrays(own, speckled)[0]
            else:
                parts = np.broadcast_arrays(place, speckled, light, programme.effective(self.averaging))
                half = np.empty(parts[0].shape)
                for i, law in enumerate(laws):
                    band = ... if len(laws) == 1 else (..., i, slice(None), slice(None))
                    where = [part[band] for part in parts]
                    half[band] = law.half(where[0], where[1], where[2], where[3], at_place=self.at_place)
                at_rest = np.where(np.isfinite(own), half, np.inf)
            return at_rest if motion is None else at_rest * motion.factor(programme, visit_s)

        return level

    def light_share(self, visit_s: FloatArray) -> FloatArray:
        """Return the share of the errors' light in what visits average."""
        assert self.light is not None
        assert self.crossed is not None
        light = self.light.variance(visit_s)
        whole = light + self.crossed.variance(visit_s)
        return np.asarray(light / np.where(whole > 0.0, whole, 1.0))

    def chances(self, programme: Programme, visit_s: FloatArray, noise: StackNoise) -> Chances:
        """Return the probabilities of a detection in a programme."""
        assert self.separation_arcsec is not None  # of a detection
        assert self.averaging is not None
        visits, paid = programme.effective(self.averaging), motion_factor(self.motion, programme, visit_s)
        shape = noise.significance.shape
        light, place, visits, paid = (
            np.broadcast_to(part, shape) for part in (self.light_share(visit_s), self.separation_arcsec, visits, paid)
        )
        every = [
            Chances.of(law, noise.at(i), place[i], light[i], visits[i], paid[i]) for i, law in enumerate(self.laws)
        ]
        found = Chances(*(np.stack([getattr(one, name) for one in every]) for name in ("blind", "known_place")))
        return found.where(np.isfinite(self.level))
