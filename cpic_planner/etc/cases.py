"""Cases of a question: stars x planets in bands of one camera, and the programmes and frames that reach a level.

With ``V`` visits of ``v`` seconds of science frames each, ``o`` of overhead and ``q`` of wall time a second of science,

    1 / SNR^2 = G / (V v) + science(v) / V + reference(v V / R) / R + common,    time = V (o + q v).

Both the noise in a given time and the time for a level fall with the number of visits as long as speckles rule, and
rise once the overhead eats the time: they have one valley in ``V``, which is found on grids of whole numbers that close
in on it. In the middle of the valley, with as many references and no walk, a visit takes ``sqrt(G o / (2 q z))``, ``z``
the residual of one visit. Frames need not be whole in this search.

A blind search goes through orbits of planets that move, and its threshold pays for the trials
(`cpic_planner.planets.motion`). Where the place of a planet is known its orbit is followed, which costs nothing. It
asks for more the more of the noise is light of the wavefront's errors, and for less the more visits average it: its
level depends on the programme (`cpic_planner.etc.detection_law`).
"""

import copy
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, Self

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, IntArray, NDArray, Reason, Record, Status
from cpic_planner.etc.detection import threshold_array
from cpic_planner.etc.detection_law import Chances, SearchLaw, bands_law, half_of, visit_chances
from cpic_planner.etc.frames import (
    FrameChoice,
    FrameProblem,
    Level,
    best_exposure_s,
    best_in_visit,
    frame_problem,
    least_time,
    peak_visit_s,
    shortened,
    smooth_least_visit_s,
)
from cpic_planner.etc.model import (
    ONE_VISIT,
    EtcModel,
    FrameCamera,
    Programme,
    check_range,
    hole_notes,
    place_statuses,
    usable_range_arcsec,
)
from cpic_planner.etc.noise import Objective, StackNoise, residuals, stack_noise, white_term, with_modes
from cpic_planner.etc.rates import (
    NEAREST_ARCSEC,
    QUADRANTS,
    ApertureRates,
    Planets,
    aperture_rates,
    planet_offsets,
    reference_contrast,
    reference_notes,
)
from cpic_planner.etc.searches import around_lowest, first_root_of_all, lowest_whole, mapped, spread, taken
from cpic_planner.planets import OrbitSearch, StarLimits, least_mass, span_days, star_masses_msun
from cpic_planner.queries import MAX_VISITS, check_visits
from cpic_planner.targets import Targets
from simulator.detectors import FrameTerm
from simulator.effects import SKY_PLACE_UNKNOWN, sky_place_unknown
from simulator.imaging import quadrant_of
from simulator.signal import ProgrammeLaw, SpeckleLaw
from simulator.target import sin_phase

_FAINTEST, _ORDINARY = 1e-30, 1e-9
_ROUNDING = 1e-12
_LEVEL_STEPS, _SAME, _STILL = 60, 1e-10, 1e-10
_HAIR, _ABOUT = 1e-14, 1e-6
_NEAR = math.log(2.0)
_SHORT, _ENDLESS_S = 0.98, 1e15
_ROUNDS, _POINTS, _MANY_POINTS = 3, 18, 72
_STEPS, _CLOSE, _FLAT = 40, 1e-12, 1.01e-4
_SHORTEST_S, _WIDER, _REACHED = 1e-3, 1.5, 1e-9
_LONGEST_S = 1e10
_OF_PLACES = ("_orbits", "separation_arcsec", "usable", "_law", "_averaging", "camera")
_COUNTS = ("visits", "reference_visits", "frames_per_visit", "n_frames", "orbits_searched")
_FLOATS = ("exposure_s", "em_gain", "independent_visits", "visit_time_s", "time_s", "unused_s", "motion_factor")


def search_motion(
    model: EtcModel,
    targets: Targets,
    band: str | Sequence[str],
    separation_arcsec: ArrayLike,
    stars: IntArray | None = None,
) -> OrbitSearch:
    """Return what the motion of planets costs a blind search at places around stars.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars.
    band : str or sequence of str
        Several are the first of three axes of the places.
    separation_arcsec : array_like
        Projected, above 0; its first axis is 1 or that of the stars.
    stars : ndarray of int, optional
        Which of the stars each place is at; broadcasts with the places.
    """
    place, strategy = np.asarray(separation_arcsec, float), model.strategy
    around = (slice(None), *(None,) * (place.ndim - 1)) if stars is None else stars
    bands = (band,) if isinstance(band, str) else band
    width_arcsec = np.array([model.metrics[name].lambda_d_arcsec for name in bands])
    width_arcsec = width_arcsec[0] if isinstance(band, str) else width_arcsec[:, None, None]
    physics = (tuple(part.tolist()) for part in (targets.log_g, targets.luminosity_lsun, targets.teff_k))
    masses_msun = _masses_msun(tuple(targets.name.tolist()), *physics)
    of_star = targets.distance_pc[around], masses_msun[around], width_arcsec
    # Within the significances that trials are stated for.
    sigma = min(max(strategy.sigma, 1.0), 20.0)
    return OrbitSearch.of(place, *of_star, gap_h=strategy.visit_gap_h, sigma=sigma)


@functools.lru_cache(maxsize=64)
def _masses_msun(names: tuple[str, ...], *physics: tuple[float, ...]) -> FloatArray:
    return star_masses_msun(names, *physics)


def motion_factor(model: EtcModel, motion: OrbitSearch | None, programme: Programme, visit_s: ArrayLike) -> FloatArray:
    """Return the factor on the significance that a search asks for because planets move; 1 where it follows them.

    Parameters
    ----------
    model : EtcModel
        Says what a visit takes of wall time.
    motion : OrbitSearch or None
        Of `search_motion`.
    programme : Programme
    visit_s : array_like
        Length of the science part of its visits.
    """
    if motion is None:
        return np.ones_like(visit_s)
    return motion.threshold_factor(programme.visits, model.time_s(visit_s))


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


def programme_columns(
    model: EtcModel,
    rates: ApertureRates,
    motion: OrbitSearch | None,
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
        "orbits_searched": np.nan if motion is None else motion.n_orbits(visits, model.time_s(visit_s)),
        "motion_factor": motion_factor(model, motion, programme, visit_s),
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


class Span(Record):
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


class Cases(Record, eq=False):
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
    exposure_s, em_gain : float or None
        What is fixed of the frames; the rest is chosen.
    x_arcsec, y_arcsec : ndarray
        Offsets of the planets on the detector.
    contrast, threshold : ndarray
        Small-sample thresholds are infinite where none is defined.
    rates : ApertureRates
    objective : {"snr", "significance"}
        What is to be reached.
    value : float or None
        How much of it; None for a detection as the strategy searches.
    programme : Programme
    moving : bool
        Whether a blind search pays for the motion of planets.
    """

    model: EtcModel
    targets: Targets
    bands: tuple[str, ...]
    planets: tuple[Planets, ...]
    places: tuple[tuple[tuple[Status, Reason, str], ...], ...]
    exposure_s: float | None
    em_gain: float | None
    x_arcsec: FloatArray
    y_arcsec: FloatArray
    contrast: FloatArray
    threshold: FloatArray
    rates: ApertureRates
    objective: Objective
    value: float | None
    programme: Programme = ONE_VISIT
    moving: bool = True

    @property
    def shape(self) -> tuple[int, ...]:
        """Return the numbers of bands, stars and planets."""
        return self.contrast.shape

    @functools.cached_property
    def camera(self) -> FrameCamera:
        """One frame of the camera that all bands share, of the exposure that is fixed."""
        return _fixed_camera(self.model, self.bands[0], self.exposure_s)

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
    def _orbits(self) -> OrbitSearch:
        stars = np.arange(len(self.targets))[:, None]
        return search_motion(self.model, self.targets, self.bands, self.separation_arcsec, stars)

    @property
    def motion(self) -> OrbitSearch | None:
        """Price that a search pays for the motion of the planets; None where it knows their places."""
        return self._orbits if self.moving and self.model.strategy.search == "blind" else None

    @functools.cached_property
    def _law(self) -> SearchLaw:
        return bands_law(self.model, self.bands)

    @functools.cached_property
    def _averaging(self) -> tuple[ProgrammeLaw, SpeckleLaw, SpeckleLaw]:
        """Residual that visits average, (e-/s)^2, and two laws of it in one visit: light of the errors, and all."""
        crossed, light = (part.averaging() for part in self.rates.parts)
        whole = self.rates.speckle.averaging().scaled(self.rates.variance_factor)
        return whole, light.law(), crossed.beside(light).law()

    @property
    def steady(self) -> bool:
        """Tell whether the level is the same for all programmes."""
        return self.value is not None

    @property
    def possible(self) -> NDArray[np.bool_]:
        """Cases in the dark hole with a level to reach."""
        defined = np.isfinite(self.threshold) | (self.value is not None)
        return np.asarray(spread(self.usable & defined, self.shape))

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
        return self._with(programme=programme)

    @property
    def searched(self) -> Self:
        """The cases with a detection as the strategy searches for their level."""
        return self._with(objective="significance", value=None)

    @property
    def at_rest(self) -> Self:
        """The cases with a detection of planets that stand still for their level."""
        return self._with(objective="significance", value=None, moving=False)

    def _with(self, **changes: Any) -> Self:
        """Return the cases with another programme or level; what is known of the light is kept."""
        made = copy.copy(self)
        vars(made).update({"_single": self._single} | changes)
        for name in ("by_mean", "_visits"):
            vars(made).pop(name, None)
        if made.objective != self.objective:
            vars(made).pop("_alone", None)
        return made

    def asked_for(self, *, snr: float | None = None, sigma: float | None = None) -> Self:
        """Return the cases with an SNR or a plain significance to reach; without either, a detection."""
        return self._with(objective="significance" if snr is None else "snr", value=sigma if snr is None else snr)

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

    def level(self, programme: Programme, problem: FrameProblem) -> Level:
        """Return the level of a programme: of the length of its visits, and of noise over signal squared.

        It is that of cases with three elements where none is defined, which can be solved like others.
        """
        at = self.level_at(programme)
        if self.steady:
            return lambda visit_s, inverse: at(np.zeros_like(inverse), visit_s)
        with np.errstate(divide="ignore", over="ignore"):
            averaging = programme.law(self._averaging[0]).scaled(problem.signal_e_s**-2.0)

        def level(visit_s: FloatArray, inverse: FloatArray) -> FloatArray:
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                residual = problem.residual(visit_s)
                light = self.light_share(visit_s) * averaging.variance(visit_s) / residual
                return at(residual / inverse, visit_s, light)

        return level

    def level_at(self, programme: Programme) -> Callable[..., FloatArray]:
        """Return the level of a programme: of the share of its variance that frames do not average, and of the visits.

        The arguments are that share, the length of the visits in s, and the share of the errors' light in the former.
        """
        if self.value is not None:
            value = float(self.value)
            return lambda speckled, *_: np.full(np.broadcast_shapes(self.shape, np.shape(speckled)), value)
        known, motion = self.model.strategy.search == "known_place", self.motion
        visits = programme.effective(self._averaging[0])
        polynomials = self._law.polynomials(self.separation_arcsec, visits, at_place=known)

        def level(speckled: FloatArray, visit_s: FloatArray, light: FloatArray | float = 0.0) -> FloatArray:
            half = half_of(polynomials, speckled, light)
            return half if motion is None else half * motion_factor(self.model, motion, programme, visit_s)

        return level

    def light_share(self, visit_s: FloatArray) -> FloatArray:
        """Return the share of the errors' light in what visits average."""
        light, whole = (part.variance(visit_s) for part in self._averaging[1:])
        return np.asarray(light / np.maximum(whole, 1e-300))

    def chances(self, visit_s: FloatArray, noise: StackNoise) -> Chances:
        """Return the probabilities of a detection in the programme."""
        visits, shape = self.programme.effective(self._averaging[0]), noise.significance.shape
        paid = motion_factor(self.model, self.motion, self.programme, visit_s)
        found = Chances.of(self._law, noise, self.separation_arcsec, self.light_share(visit_s), visits, paid)
        return found.where(np.isfinite(spread(self.threshold, shape)))

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
        for i, band in enumerate(self.bands):
            of_all = self.rates, programme, exposure_s, n_frames, em_gain
            own = mapped(lambda array, at=i: _of_band(array, at), of_all)
            parts.append(with_modes(self.model, band, np.hypot(self.x_arcsec[i], self.y_arcsec[i]), *own))
        shape = np.broadcast_shapes((1, 1), *(np.shape(array) for part in parts for array in vars(part).values()))
        return Programme.stacked([part.spread(shape) for part in parts], axis=-3)

    def programme_of(self, visits: ArrayLike, visit_time_s: ArrayLike, choice: FrameChoice | None = None) -> Programme:
        """Return another number of visits, with what modes change where they have the frames of a choice.

        Parameters
        ----------
        visits, visit_time_s : array_like
            Number, and wall time of a visit.
        choice : FrameChoice, optional
            Where it has no frames, or without it, the modes are those of frames that fill the visits, of the exposure
            of most SNR per time, and need not be whole.
        """
        programme = Programme.of(self.model.strategy, visits, visit_time_s)
        if self.model.strategy.n_modes == 0:
            return programme
        best_s, gain = self._alone
        visit_s = self.model.visit_s(visit_time_s)
        exposure = np.clip(visit_s - self.camera.readout_s, self.camera.exposure_min_s, best_s)
        if choice is not None:
            some = choice.n_frames >= 1
            exposure = np.where(some, choice.exposure_s, best_s)
            gain = np.where(some, choice.em_gain, gain)
        n_frames = visit_s / (exposure + self.camera.readout_s)
        if choice is not None:
            n_frames = np.where(some, choice.n_frames, n_frames)
        return self.with_modes(programme, exposure, n_frames, gain)

    @functools.cached_property
    def _alone(self) -> tuple[FloatArray, FloatArray]:
        """Exposure and gain of most SNR per time, which depend little on the programme."""
        problem = self.problem(programme=ONE_VISIT)
        best_s = best_exposure_s(problem)[0]
        return best_s, problem.frame_noise(best_s)[1]

    def problem(
        self, objective: Objective | None = None, programme: Programme | None = None, contrast: FloatArray | None = None
    ) -> FrameProblem:
        """Return what the solver needs, with the exposure of most SNR per time where it is that of one visit.

        Parameters
        ----------
        objective : {"snr", "significance"}, optional
        programme : Programme, optional
        contrast : ndarray, optional
            Instead of the cases' own; contrasts of their shape.
        """
        made, strategy, asked = programme or self.programme, self.model.strategy, objective or self.objective
        rates, ratio = self.rates if contrast is None else self.rates_at(contrast), strategy.reference_ratio
        shares = made.frame_ratio(ratio)
        # As many references a frame: a visit has the white noise of a single one, unless modes leave another part.
        alike = strategy.n_modes == 0 and bool((shares == ratio).all())
        known = strategy.n_modes == 0 and contrast is None
        known = known and (alike or not np.any(np.abs(shares / ratio - 1.0) > _ROUNDING))
        settings: dict[str, Any] = {"objective": asked, "em_gain": self.em_gain}
        if known and asked not in self._single:
            single = frame_problem(rates, self.camera, strategy, programme=ONE_VISIT, **settings)
            self._single[asked] = replace(single, best_s=best_exposure_s(single)[0])
        if known and alike:  # only speckles differ
            level = 1.0 + 1.0 / rates.background_apertures if asked == "snr" else 1.0
            z0, z1, z2 = residuals(rates, level, made)
            signal_e_s = spread(rates.planet_e_s, np.broadcast(rates.planet_e_s, z0, z1, z2, made.visits).shape)
            parts = {"z0": z0, "z1": z1, "z2": z2, "visits": made.visits, "signal_e_s": signal_e_s}
            return replace(self._single[asked], **parts)
        white = self._white if alike else None
        found = frame_problem(rates, self.camera, strategy, programme=made, white=white, **settings)
        return replace(found, best_s=spread(self._single[asked].best_s, found.shape)) if known else found

    def noise(self, choice: FrameChoice) -> StackNoise:
        """Return the signal and noise of chosen frames."""
        return self.noise_of(self.rates, self.free_camera, choice)

    def noise_of(
        self, rates: ApertureRates, camera: FrameCamera, choice: FrameChoice, ratio: FloatArray | None = None
    ) -> StackNoise:
        """Return signal and noise of chosen frames, for other rates, another camera, or more reference frames.

        Parameters
        ----------
        rates : ApertureRates
        camera : FrameCamera
        choice : FrameChoice
            Frames of every case.
        ratio : ndarray, optional
            Reference frames over those of the strategy.
        """
        strategy = self.model.strategy
        if ratio is not None:
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
        notes = reference_notes(self.model, self.targets, self.bands[band], place, planets.models[planet], star)
        return (*notes, "excluded_by_rv") if self._excluded[band, star, planet] else notes

    @functools.cached_property
    def _excluded(self) -> BoolArray:
        """Planets that velocities exclude, whatever their orientation."""
        limits, star = StarLimits.of(self.targets.name.tolist(), ("rv",)), np.arange(len(self.targets))[:, None]
        bodies = [[(body.radius_rjup, body.phase_deg) for body in planets.models] for planets in self.planets]
        radius, phase_deg = np.moveaxis(np.array(bodies)[:, None], -1, 0)
        place = np.maximum([planets.separation_arcsec for planets in self.planets], NEAREST_ARCSEC)[:, None]
        distance_au = self.targets.distance_pc[:, None] * place / sin_phase(phase_deg)
        return limits.excluded_by_velocities(star, distance_au, least_mass(radius))

    def visits_in(self, span: Span) -> FloatArray:
        """Return the given number of visits, or the best ones in the time."""
        if span.visits is not None:
            return np.full(self.shape, float(span.visits))
        assert span.time_s is not None
        return self.best_in_time(span.time_s)

    def missed_in(self, span: Span) -> FloatArray:
        """Return ``(level / SNR)^2`` of the best programmes in a time, of frames that need not be whole."""
        assert span.time_s is not None
        cost = self._missed(self.visits_in(span), span.time_s)
        return np.where(self.possible & ~np.isnan(cost), cost, np.inf)

    def best_in_time(self, time_s: ArrayLike) -> FloatArray:
        """Return the numbers of visits that come nearest to the level, or most above it, in a wall time.

        Parameters
        ----------
        time_s : array_like
            Of the whole programme.
        """
        visit_s = float(self.model.time_s(self._shortest_s))
        most = np.minimum(np.floor(np.asarray(time_s, float) / visit_s * (1.0 + 1e-12)), MAX_VISITS)
        return lowest_whole(lambda visits: self._missed(visits, time_s), spread(most, self.shape))[0]

    def _bottom(self, visits: FloatArray, longest_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the length of visits that comes nearest to the level, up to some beyond the longest, and how near."""
        # The same lengths whatever the longest is: so is the best of them.
        low, high = (np.full(longest_s.shape, end) for end in (self._shortest_s, _LONGEST_S))
        grid = np.geomspace(low, high, _MANY_POINTS)
        values = np.where(grid <= longest_s, self._missed_by(visits, grid), np.inf)
        return _lowest(lambda length_s: self._missed_by(visits, length_s), *around_lowest(grid, values)[::2])

    def _missed_by(self, visits: FloatArray, length_s: FloatArray) -> FloatArray:
        """Return ``(level / SNR)^2`` of visits of a length."""
        return self._missed(visits, visits * self.model.time_s(length_s))

    def quickest(self) -> tuple[FloatArray, FloatArray]:
        """Return the numbers of visits that reach the level in least wall time, 1 where none does, and that time."""
        most = np.full(self.shape, float(MAX_VISITS))
        return lowest_whole(lambda visits: visits * self.model.time_s(self.solved(visits, about=True)[0]), most)

    def fewest(self, visit_s: ArrayLike) -> FloatArray:
        """Return the least numbers of visits of a given length that reach the level; ``inf`` where none does.

        Parameters
        ----------
        visit_s : array_like
            Science frames of a visit.
        """
        low, high = np.zeros(self.shape), np.full(self.shape, float(MAX_VISITS))
        wall_s = self.model.time_s(visit_s)
        possible = self._missed(high, high * wall_s) <= 1.0 + _CLOSE
        while np.any(high - low > 1.0):
            middle = np.ceil(0.5 * (low + high))
            enough = self._missed(middle, middle * wall_s) <= 1.0 + _CLOSE
            low, high = np.where(enough, low, middle), np.where(enough, middle, high)
        return np.where(possible, high, np.inf)

    @property
    def _shortest_s(self) -> float:
        """Length of one frame of the shortest exposure."""
        return self.camera.exposure_min_s + self.camera.readout_s

    def _missed(self, visits: FloatArray, time_s: ArrayLike) -> FloatArray:
        """Return ``(level / SNR)^2`` of programmes in a wall time."""
        each_s, camera = np.asarray(time_s, float) / visits, self.camera
        problem, level = self._asked(visits, each_s)
        visit = self.model.visit_s(each_s)
        exposure = np.minimum(self._alone[0], visit - camera.readout_s)
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
            return np.asarray(inverse * level(visit, inverse) ** 2)

    def _asked(self, visits: FloatArray, wall_s: FloatArray) -> tuple[FrameProblem, Level]:
        """Return the problem of visits of a wall time, and their level; once where the time does not matter."""
        kept: tuple[FloatArray, tuple[FrameProblem, Level]] | None = vars(self).get("_visits")
        if kept is not None and kept[0] is visits:
            return kept[1]
        programme = self.programme_of(visits, wall_s)
        problem = self.problem(programme=programme)
        made = problem, self.level(programme, problem)
        if not self.by_length:
            vars(self)["_visits"] = visits, made
        return made

    def solved(self, visits: ArrayLike, *, about: bool = False) -> tuple[FloatArray, FloatArray]:
        """Return the shortest visits with which programmes reach the level (``inf`` where none does), and the level.

        Parameters
        ----------
        visits : array_like
        about : bool
            Modes are those of visits that are nearly as long: enough to compare programmes.
        """
        many, modes = np.asarray(visits, float), self.model.strategy.n_modes > 0
        if self.by_length and not (about and modes):
            return self._solved_by_length(many)
        wall_s = self.model.time_s(self.by_mean.solved(many)[0]) if modes else np.array(np.inf)
        for _ in range(4 if modes else 1):
            visit, level = self._shortest(many, wall_s, about=about)
            wall_s = self.model.time_s(visit)
        return visit, level

    @property
    def by_length(self) -> bool:
        """Tell whether a programme follows the length of its visits: modes, and visits that remember each other, do."""
        return self.model.strategy.n_modes > 0 or self.model.instrument.drift.correlation_time_h > 0.0

    @functools.cached_property
    def by_mean(self) -> Self:
        """The cases reduced by the mean of their references."""
        if self.model.strategy.n_modes == 0:
            return self
        strategy = self.model.strategy.model_copy(update={"n_modes": 0})
        return self._with(model=replace(self.model, strategy=strategy), _single={})

    def _solved_by_length(self, visits: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the shortest visits of programmes that follow their length, and the level."""
        # About as long as with the modes of references without noise and visits far apart, or without modes.
        visit_s = self._shortest(visits, np.array(np.inf))[0]
        if self.by_mean is not self:
            visit_s = np.minimum(visit_s, self.by_mean.solved(visits)[0])

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
        return found, self._shortest(visits, self.model.time_s(found))[1]

    def _shortest(
        self, visits: FloatArray, wall_s: FloatArray, *, about: bool = False
    ) -> tuple[FloatArray, FloatArray]:
        """Return the shortest visits of programmes with gaps and modes of visits of a length, and the level."""
        (problem, wanted), best_s, camera = self._asked(visits, wall_s), self._alone[0], self.camera
        shortest_s, frame_s = (exposure + camera.readout_s for exposure in (camera.exposure_min_s, best_s))
        visit, level = self._reached(wanted, problem, _cost(problem, best_s), about)
        if np.any(visit < frame_s):  # not even one frame of that exposure: a shorter one, or one whole
            exposure = np.clip(visit - camera.readout_s, camera.exposure_min_s, best_s)
            other, its_level = self._reached(wanted, problem, _cost(problem, exposure), about)
            whole = (visit < frame_s) & (other > frame_s)
            visit, level = np.where(whole, frame_s, other), np.where(whole, level, its_level)
        return np.maximum(visit, shortest_s), level

    def _reached(
        self, wanted: Level, problem: FrameProblem, cost: FloatArray, about: bool
    ) -> tuple[FloatArray, FloatArray]:
        """Return the shortest visits of the level, and the level, by secants of logarithms from a falling curve's left.

        White noise alone falls with the slope -1, which no step overshoots.
        """
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
            last, close, found = (x, f), (_ABOUT if about else _CLOSE), 1e-8 + (_ABOUT if about else 0.0)
            for _ in range(_STEPS):
                moving = solvable & (np.abs(f) > close) & (slope < -_FLAT) & (x < np.log(_LONGEST_S))
                if not moving.any():
                    break
                left = moving & (f > 0.0)
                last = np.where(left, x, last[0]), np.where(left, f, last[1])
                new = np.where(moving, x - f / slope, x)
                g, level = excess(new)
                slope = np.where(moving, np.clip((g - f) / (new - x), -1.0, -1e-4), slope)
                x, f = new, g
            over = solvable & (np.abs(f) >= found) & (last[1] < _NEAR)
            if over.any() and not about:  # it stopped on a slope too flat for secants, or stepped over a valley
                end = np.log(np.minimum(peak_visit_s(problem, cost), _LONGEST_S))
                end = np.where(over & (f > 0.0), np.fmax(end, x), x)
                x = self._in_valley(lambda at: excess(at)[0], last[0], end, over)
                f, level = excess(x)
            visit = np.where(solvable & (f < found), np.exp(x), np.inf)
            if np.isfinite(visit).all():
                return visit, level
            # At a known place the level stops growing: longer ones may reach it.
            most = wanted(np.ones_like(cost), np.zeros_like(cost))
            longer = np.where(np.isfinite(visit), visit, smooth_least_visit_s(problem, most, cost))
            there = np.where(np.isfinite(longer), longer, np.exp(x))
            missed, at_end = excess(np.log(there))  # of longer ones the level of a search over orbits is higher
            return np.where(missed < found, longer, np.inf), np.where(np.isfinite(visit), level, at_end)

    @staticmethod
    def _in_valley(
        excess: Callable[[FloatArray], FloatArray], left: FloatArray, right: FloatArray, wanted: NDArray[np.bool_]
    ) -> FloatArray:
        """Return the first root of a function between two points, or the bottom of a valley that stays above 0."""
        length_s, least = _lowest(lambda at: excess(np.log(at)), np.exp(left), np.exp(right))
        best = np.log(length_s)
        crossed = wanted & (least <= 0.0)
        ends = np.exp(left), np.exp(np.where(crossed, best, left))
        found = first_root_of_all(lambda at: np.exp(excess(np.log(at))), *ends, crossed, tolerance=1e-11)
        return np.where(crossed, np.log(found), np.where(wanted, best, right))

    def paying_s(self, visits: FloatArray, visit_s: FloatArray) -> FloatArray:
        """Return the length of visits, at most the given one, that comes nearest to the level, or most above it.

        It depends on the given one only where that is chosen: more time is never worse.
        """
        if self.steady:
            return visit_s
        # The noise of long visits is all speckles, in which a search asks for more: a bit beyond the given one, too.
        longest_s = np.maximum(_WIDER * visit_s, self._shortest_s)
        bottom_s, value = self._bottom(visits, longest_s)
        nearer = value < self._missed_by(visits, longest_s) * (1.0 - _CLOSE)
        # At the very bottom the length would be arbitrary: the inverse question could not find it again.
        return np.where(nearer, np.minimum(visit_s, bottom_s * _SHORT), visit_s)

    def level_of(self, programme: Programme, problem: FrameProblem, choice: FrameChoice) -> FloatArray:
        """Return the level that chosen frames have to reach; where there are none, as if visits were short."""
        some = choice.n_frames >= 1
        visit, inverse = np.where(some, choice.visit_s, 1.0), np.where(some, choice.inverse_snr2, np.inf)
        return self.level(programme, problem)(visit, inverse)

    def spread(self, visits: FloatArray, time_s: float) -> tuple[Programme, FloatArray]:
        """Return the programmes of so many visits in a time, with the length of their science visits."""
        programme = self.programme_of(visits, time_s / visits)
        shape = self.problem(programme=programme).shape
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
        choice = shortened(found.problem, found.choice, visit_s)
        return replace(found, choice=choice, level=self.level_of(found.cases.programme, found.problem, choice))

    def framed(self, visits: FloatArray, visit_time_s: FloatArray, **settings: bool) -> "Solution":
        """Return visits of a wall time with their best frames, and with what modes change where it has those.

        Parameters
        ----------
        visits, visit_time_s : ndarray
        **settings
            Of `cpic_planner.etc.frames.best_in_visit`.
        """
        programme = self.programme_of(visits, visit_time_s)
        problem = self.problem(programme=programme)
        visit_s = spread(self.model.visit_s(visit_time_s), problem.shape)
        choice = best_in_visit(problem, visit_s, **settings)
        for _ in range(_LEVEL_STEPS if self.model.strategy.n_modes else 0):
            last, programme = choice, self.programme_of(visits, visit_time_s, choice)
            problem = self.problem(programme=programme)
            choice = best_in_visit(problem, visit_s, **settings)
            if np.allclose(choice.visit_s, last.visit_s, rtol=_STILL, atol=0.0):
                break
        level = self.level_of(programme, problem, choice)
        return Solution(self.in_programme(programme), problem, choice, level)

    def for_level(self, span: Span) -> "Solution":
        """Return the quickest frames that reach the level, with the number of visits that is given or best."""
        model = self.model
        if span.visit_time_s is not None:
            visit_s = float(model.visit_s(span.visit_time_s))
            visits = np.minimum(self.fewest(visit_s), MAX_VISITS)
            return self._in_visits(visits, span.visit_time_s)
        if span.visits is not None:
            return self.at_level(np.full(self.shape, float(span.visits)))
        best = self.quickest()[0]
        near = np.stack([*_beside(best), np.full_like(best, MAX_VISITS)])
        found = self.at_level(near)
        cost = np.where(found.choice.n_frames >= 1, near * model.time_s(found.choice.visit_s), np.inf)
        # Where none reaches it, as many visits as there may be say what forbids it.
        cost[-1] = _ENDLESS_S
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
        if self.by_length:
            return self._by_length(visits, self.solved(visits)[0])
        if self.steady:
            programme = Programme.of(self.model.strategy, visits)
            problem = self.problem(programme=programme)
            level = np.full(visits.shape, float(self.value or 1.0))
            return Solution(self.in_programme(programme), problem, least_time(problem, level), level)
        visit_s, level = self.solved(visits)
        found = self._by_frames(visits, visit_s, level)
        lost = np.isfinite(visit_s) & ~(found.choice.inverse_snr2 * found.level**2 <= 1.0 + 10.0 * _SAME)
        if not lost.any():
            return found
        # Whole frames make steps of the level, and only a narrow range of lengths may reach it.
        bottom_s = self._bottom(visits, np.full(visits.shape, _LONGEST_S))[0]
        return self._by_length(visits, np.where(lost, bottom_s, np.inf)).where(lost, found)

    def _by_length(self, visits: FloatArray, visit_s: FloatArray) -> "Solution":
        """Return the frames of the shortest visits that reach the level: the question for a time, turned round.

        Parameters
        ----------
        visits : ndarray
        visit_s : ndarray
            About as long; ``inf`` where no length reaches it.
        """
        reachable = np.isfinite(visit_s)

        def in_visits(length_s: FloatArray) -> tuple[FloatArray, Solution]:
            found = self.framed(visits, self.model.time_s(length_s))
            return found.choice.inverse_snr2 * found.level**2, found

        taken_s = shortest(lambda length_s: in_visits(length_s)[0], np.where(reachable, visit_s, 1.0), reachable)
        missed, found = in_visits(taken_s * (1.0 + _HAIR))
        lost, choice = ~reachable | (missed > 1.0 + _SAME), found.choice
        none = np.zeros_like(choice.n_frames)
        return replace(found, choice=choice.where(~lost, replace(choice, n_frames=none, visit_s=none)))

    def _by_frames(self, visits: FloatArray, visit_s: FloatArray, level: FloatArray) -> "Solution":
        """Return the quickest frames for a level that follows them.

        Parameters
        ----------
        visits : ndarray
        visit_s, level : ndarray
            Where frames need not be whole; ``inf`` where no length reaches the level.
        """
        programme = Programme.of(self.model.strategy, visits, self.model.time_s(visit_s))
        problem = self.problem(programme=programme)
        choice = least_time(problem, self.level(programme, problem), visit_s)
        level = np.where(choice.n_frames >= 1, self.level_of(programme, problem, choice), level)
        return Solution(self.in_programme(programme), problem, choice, level)


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
    # A search asks for more the longer the visits are: a level may be reached in some range of lengths only.
    low, high = start_s * 0.99, start_s * np.where(missed(start_s) <= 1.0, 1.0, 1.01)
    for factor, end in ((_WIDER, high), (1.0 / _WIDER, low)):
        while True:
            off = missed(end) > 1.0
            off = wanted & (off if factor > 1.0 else ~off) & (end < _LONGEST_S) & (end > _SHORTEST_S)
            if not off.any():
                break
            if factor > 1.0:
                low[off] = end[off]
            else:
                high[off] = end[off]
            end[off] *= factor
    return np.where(wanted, first_root_of_all(missed, low, high, wanted, tolerance=1e-11), _LONGEST_S)


class Solution(Record, eq=False):
    """Programmes of cases, and frames that answer for them; arrays ``(n_band, n_star, n_planet)``.

    Attributes
    ----------
    cases : Cases
        In the programmes.
    problem : FrameProblem
    choice : FrameChoice
    level : ndarray
        SNR or significance to reach.
    """

    cases: Cases
    problem: FrameProblem
    choice: FrameChoice
    level: FloatArray

    def taken(self, index: NDArray[np.int_]) -> "Solution":
        """Return one element of the first axis of every case."""

        def take(array: FloatArray) -> FloatArray:
            return taken(spread(array, self.level.shape), index)

        cases = self.cases.in_programme(self.cases.programme._combined(take))
        return Solution(cases, self.problem._combined(take), self.choice._combined(take), take(self.level))

    def where(self, mask: NDArray[np.bool_], other: "Solution") -> "Solution":
        """Return this solution where the mask holds, another one of the same cases elsewhere."""
        pairs = ((one.cases.programme.spread(mask.shape), one.problem, one.choice) for one in (self, other))
        programme, problem, choice = (one.where(mask, two) for one, two in zip(*pairs, strict=True))
        return Solution(self.cases.in_programme(programme), problem, choice, np.where(mask, self.level, other.level))


def _beside(visits: FloatArray) -> list[FloatArray]:
    """Return one visit, and numbers of visits as they are, one less and one more."""
    return [np.ones_like(visits), *(np.clip(visits + step, 1.0, MAX_VISITS) for step in (-1, 0, 1))]


def cases_by_camera(
    model: EtcModel,
    targets: Targets,
    bands: Sequence[str] | None,
    planets: Planets | Mapping[str, Planets],
    *,
    exposure_s: float | None = None,
    em_gain: float | None = None,
    snr: float | None = None,
    sigma: float | None = None,
    offsets_arcsec: tuple[float, float] | None = None,
) -> list[Cases]:
    """Return the cases of every camera.

    Parameters
    ----------
    model, targets, planets, offsets_arcsec
        As of `cases_of`.
    bands : sequence of str, optional
        All of the model by default.
    exposure_s, em_gain : float, optional
        As of `cases_of`; refused where a camera of the bands cannot do it.
    snr, sigma : float, optional
        Photometric SNR or plain significance to reach; by default a detection.
    """
    if len(targets) < 1:
        raise InputError("target", len(targets), allowed="at least one star")
    names = model.named(bands)
    own = [model.camera(band) for band in names]
    if exposure_s is not None:
        exposure_s = check_range("exposure_s", exposure_s, max(camera.exposure_min_s for camera in own), 1e6, "s")
    if em_gain is not None:
        em_gain = check_range("em_gain", em_gain, 1.0, min(camera.em_gain_max for camera in own), "")
    cameras = {band: _fixed_camera(model, band, exposure_s) for band in names}
    alike = [[band for band in cameras if cameras[band] == one] for one in dict.fromkeys(cameras.values())]
    asked: dict[str, Any] = {"exposure_s": exposure_s, "em_gain": em_gain, "offsets_arcsec": offsets_arcsec}
    return [cases_of(model, targets, same, planets, **asked).asked_for(snr=snr, sigma=sigma) for same in alike]


def _fixed_camera(model: EtcModel, band: str, exposure_s: float | None) -> FrameCamera:
    """Return one frame of a band's camera, of the exposure that is fixed."""
    camera = model.camera(band)
    return camera if exposure_s is None else replace(camera, exposure_min_s=exposure_s, exposure_max_s=exposure_s)


def cases_of(
    model: EtcModel,
    targets: Targets,
    bands: Sequence[str],
    planets: Planets | Mapping[str, Planets] | Sequence[Planets],
    *,
    exposure_s: float | None = None,
    em_gain: float | None = None,
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
    exposure_s, em_gain : float, optional
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
    places, *columns = zip(*parts, strict=True)
    shape = len(targets), len(own[0])
    x, y, contrast, threshold, rates = (_together(column, shape) for column in columns)
    head = model, targets, tuple(bands), tuple(own), places, exposure_s, em_gain
    return Cases(*head, x, y, contrast, threshold, rates, objective, value, Programme.of(model.strategy))


def _in_band(
    model: EtcModel, targets: Targets, band: str, planets: Planets, offsets_arcsec: tuple[float, float] | None
) -> tuple[Any, ...]:
    """Return the status of all places in one band, offsets, contrasts, thresholds and rates."""
    metrics, place = model.metrics[band], planets.separation_arcsec
    places = place_statuses(model, band, place.tolist())
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


class Prospect(Record, eq=False):
    """The expected signals of planets; arrays of stars x planets, made by `prospect_of`.

    Attributes
    ----------
    programme : Programme
        With the modes that are projected out at each place.
    noise : StackNoise
        Of the frames of all visits.
    threshold : ndarray
        Small-sample threshold of the significance.
    chances : Chances
        Probabilities of a detection.
    motion : ndarray
        Factor by which a blind search asks for more because planets may move.
    at_level : callable
        The same of a search at another level (sigma).
    """

    programme: Programme
    noise: StackNoise
    threshold: FloatArray
    chances: Chances
    motion: FloatArray
    at_level: "Callable[[float], Prospect]"

    @property
    def margin(self) -> FloatArray:
        """Predicted significance over threshold."""
        return np.asarray(self.noise.significance / self.threshold)


def prospect_of(
    model: EtcModel,
    targets: Targets,
    band: str,
    x_arcsec: FloatArray,
    y_arcsec: FloatArray,
    contrast: FloatArray,
    frames: tuple[float, float, float],
    programme: Programme,
    *,
    moving: bool = True,
) -> Prospect:
    """Return what given frames promise of planets.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars.
    band : str
        Name of a band of the instrument, such as ``F520``.
    x_arcsec, y_arcsec, contrast : ndarray, shape (n, k)
        Offsets on the detector, and planet-to-star ratios of detected rates.
    frames : tuple of float
        Exposure (s), number of frames of a visit, EM gain.
    programme : Programme
        Visits that are reduced together.
    moving : bool
        Whether a blind search pays for the motion of planets, as `cpic_planner.contrast_limit` counts it; images show
        planets that stand still.
    """
    separation = np.hypot(x_arcsec, y_arcsec)
    rates = aperture_rates(model, targets, band, x_arcsec, y_arcsec, contrast)
    made = with_modes(model, band, separation, rates, programme, *frames)
    camera = model.camera(band)
    noise = stack_noise(rates, *frames, camera, model.strategy, made)
    elements = model.metrics[band].resolution_elements(separation)
    visit_s = np.asarray(frames[1] * (frames[0] + camera.readout_s))
    visits = made.effective(rates.speckle)
    here = aperture_rates(model, targets, band, x_arcsec, y_arcsec, contrast, at_place=True)
    seen = stack_noise(here, *frames, camera, model.strategy, made)

    def at_level(sigma: float) -> Prospect:
        own = replace(model, strategy=model.strategy.model_copy(update={"sigma": sigma}))
        search = search_motion(own, targets, band, separation) if moving else None
        motion = np.broadcast_to(motion_factor(own, search, made, visit_s), separation.shape)
        chances = visit_chances(own, band, separation, visit_s, seen, visits, motion=motion)
        return Prospect(made, noise, threshold_array(elements, sigma), chances, motion, at_level)

    return at_level(model.strategy.sigma)
