"""Targets x planets of one band, ready for a question.

From answers to the result that leaves the program.
"""

import functools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from cpic_core import FloatArray, NDArray, Reason, Status
from cpic_planner.etc.camera import FrameCamera
from cpic_planner.etc.detection import (
    DetectionLaw,
    default_law,
    effective_visits,
    half_margin,
    law_of,
    threshold_array,
)
from cpic_planner.etc.fidelity import etc_dial, etc_fidelity
from cpic_planner.etc.frames import FrameChoice, FrameProblem
from cpic_planner.etc.model import (
    ONE_VISIT,
    EtcModel,
    Programme,
    hole_notes,
    place_status,
    usable_range_arcsec,
)
from cpic_planner.etc.motion import SearchMotion
from cpic_planner.etc.noise import Objective, StackNoise, frame_problem, stack_noise
from cpic_planner.etc.planet import (
    QUADRANTS,
    Planets,
    planet_offsets,
    reference_contrast,
    reference_distance_au,
    reference_notes,
)
from cpic_planner.etc.rates import ApertureRates, aperture_rates
from cpic_planner.planets import excluded_by_rv
from cpic_planner.queries import ReferencePlanet
from cpic_planner.results import EtcAnswer, EtcResult, ReferencePlanetRecord
from cpic_planner.targets import Targets
from cpic_planner.version import __version__
from simulator.config import content_hash
from simulator.effects import SKY_PLACE_UNKNOWN, sky_place_unknown
from simulator.knobs import Dial
from simulator.signal import ProgrammeLaw, SpeckleLaw, programme_parts, quadrant_of

_FAINTEST, _ORDINARY = 1e-30, 1e-9


@dataclass(frozen=True)
class FixedFrames:
    """What the user fixes of the frames; the rest is optimised."""

    exposure_s: float | None = None
    em_gain: float | None = None


@dataclass(frozen=True)
class BandCases:
    """All stars and planets in one band; arrays ``(n_star, n_planet)``, ``(1, n_planet)`` or ``(n_planet,)``."""

    model: EtcModel
    targets: Targets
    band: str
    planets: Planets
    places: tuple[tuple[Status, Reason, str], ...]
    x_arcsec: FloatArray
    y_arcsec: FloatArray
    contrast: FloatArray
    threshold: FloatArray
    rates: ApertureRates
    fixed: FixedFrames
    programme: Programme = ONE_VISIT

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Cases whose aperture lies in the controlled zone."""
        inside = np.array([place[0] is Status.OK for place in self.places])
        return np.broadcast_to(inside, self.contrast.shape)

    @functools.cached_property
    def motion(self) -> SearchMotion | None:
        """What a search pays for the motion of the planets; None where it knows their places."""
        place = np.broadcast_to(np.hypot(self.x_arcsec, self.y_arcsec), self.contrast.shape)
        return SearchMotion.asked(self.model, self.targets, self.band, place)

    def problem(
        self, objective: Objective, contrast: FloatArray | None = None, programme: Programme | None = None
    ) -> FrameProblem:
        """Return what the solver needs, for the cases' own contrasts and programme or given ones.

        Parameters
        ----------
        objective : {"snr", "significance"}
        contrast : ndarray, optional
            Contrasts instead of the cases' own, ``(n_star, n_planet)``.
        programme : Programme, optional
        """
        rates = self.rates if contrast is None else self.rates_at(contrast)
        made = self.programme if programme is None else programme
        settings: dict[str, Any] = {"objective": objective, "em_gain": self.fixed.em_gain, "programme": made}
        return frame_problem(rates, self.camera, self.model.strategy, **settings)

    @property
    def camera(self) -> FrameCamera:
        """One frame of the band's camera, of the exposure that is fixed."""
        camera = self.model.camera(self.band)
        if self.fixed.exposure_s is None:
            return camera
        return replace(camera, exposure_min_s=self.fixed.exposure_s, exposure_max_s=self.fixed.exposure_s)

    def rates_at(self, contrast: FloatArray) -> ApertureRates:
        """The rates with other contrasts: only the planet's own light follows them."""
        own = self.rates.peak_in_hole_e_s - self.rates.peak_planet_e_s
        factor = contrast / np.maximum(self.contrast, _FAINTEST)
        peak = self.rates.peak_planet_e_s * factor
        planet_e_s = self.rates.planet_e_s * factor
        return replace(self.rates, planet_e_s=planet_e_s, peak_planet_e_s=peak, peak_in_hole_e_s=own + peak)

    def noise(self, choice: FrameChoice) -> StackNoise:
        """Signal and noise of chosen frames."""
        return self.noise_of(self.rates, self.model.camera(self.band), choice)

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
        strategy = strategy.model_copy(update={"reference_ratio": ratio * strategy.reference_ratio})
        frames = choice.exposure_s, choice.n_frames, choice.em_gain
        return stack_noise(rates, *frames, camera, strategy, self.programme)

    def head(self, star: int, planet: int) -> dict[str, Any]:
        """Return the fields of an answer that do not depend on the question.

        Parameters
        ----------
        star, planet : int
            The case.
        """
        library = self.model.strategy.reference_library
        notes = [*self.targets.flags[star], *hole_notes(self.model, self.band), *library.flags]
        if sky_place_unknown(self.model.instrument, self.targets.ra_deg[star], self.targets.dec_deg[star]):
            notes.append(SKY_PLACE_UNKNOWN)
        threshold = float(self.threshold[planet])
        inside = self.places[planet][0] is Status.OK

        def of_case(values: FloatArray) -> float:
            return float(np.broadcast_to(values, self.contrast.shape)[star, planet])

        x, y = of_case(self.x_arcsec), of_case(self.y_arcsec)
        return {
            "target": str(self.targets.name[star]),
            "band": self.band,
            "separation_arcsec": float(self.planets.separation_arcsec[planet]),
            "threshold": threshold if inside and np.isfinite(threshold) else None,
            "core_throughput": of_case(self.rates.core) if inside else None,
            "quadrant": QUADRANTS[quadrant_of(x, y)] if inside else None,
            "roll_deg": self.targets.roll_deg,
            "flags": tuple(notes),
        }

    def planet_notes(self, star: int, planet: int) -> tuple[str, ...]:
        """Return the flags of the planet's model.

        Parameters
        ----------
        star, planet : int
            The case.
        """
        if self.planets.contrast is not None:
            return ()
        place = float(self.planets.separation_arcsec[planet])
        body, target = self.planets.models[planet], self.targets.select([star])
        if place <= 0:
            return ()
        distance = float(reference_distance_au(target, np.array([place]), body)[0, 0])
        excluded = excluded_by_rv(target.name.tolist(), distance, body.radius_rjup)[0]
        notes = reference_notes(self.model, target, self.band, place, body)
        return (*notes, "excluded_by_rv") if excluded else notes


@dataclass(frozen=True, eq=False)
class Wanted:
    """SNR or significance that cases have to reach; arrays ``(n_band, n_star, n_planet)``.

    A search asks for more the more of the noise is light of the wavefront's errors, and for less the more visits
    average it: its level depends on the programme (`cpic_planner.etc.detection.half_margin`).

    Attributes
    ----------
    level : ndarray
        What is to be reached, or thresholds of a search; infinite where no threshold is defined.
    law : DetectionLaw, optional
        Law of detections; without one the level is all.
    at_place : bool
        Whether the place of a planet is known.
    averaging : ProgrammeLaw, optional
        What visits average of the residual, (e-/s)^2.
    crossed, light : SpeckleLaw, optional
        Its two parts, of one visit: the cross term with the static field, and the light of the errors.
    inward : ndarray, optional
        Width of a resolution element over the separation.
    motion : SearchMotion, optional
        What the search pays for the motion of planets; nothing without.
    """

    level: FloatArray
    law: DetectionLaw | None = None
    at_place: bool = False
    averaging: ProgrammeLaw | None = None
    crossed: SpeckleLaw | None = None
    light: SpeckleLaw | None = None
    inward: FloatArray | None = None
    motion: SearchMotion | None = None

    @property
    def steady(self) -> bool:
        """Whether the level is the same for all programmes."""
        return self.law is None and self.motion is None

    @classmethod
    def of(cls, every: Sequence[BandCases], value: float | None = None) -> Self:
        """Return the level of bands of one camera: a given value, or that of a detection as the strategy searches."""
        shape = every[0].contrast.shape

        def together(arrays: Iterable[FloatArray]) -> FloatArray:
            return np.stack([np.broadcast_to(array, shape) for array in arrays])

        def laws(found: Sequence[SpeckleLaw]) -> SpeckleLaw:
            return SpeckleLaw(*(together(parts) for parts in zip(*found, strict=True)))

        if value is not None:
            return cls(np.full((len(every), *shape), float(value)))
        model, thresholds = every[0].model, together(cases.threshold for cases in every)
        law, strategy = law_of(model, every[0].band), model.strategy
        motion = SearchMotion.stacked([cases.motion for cases in every], shape)
        if law is None:
            return cls(thresholds, motion=motion)
        speckle = [cases.rates.speckle.averaging().scaled(cases.rates.variance_factor) for cases in every]
        science, reference, common = (laws(parts) for parts in zip(*(law[:3] for law in speckle), strict=True))
        turned = [law.turned for law in speckle if law.turned is not None]
        width, ratio, drift = strategy.annulus_lambda_d, strategy.reference_ratio, model.instrument.drift
        separations = [np.hypot(cases.x_arcsec, cases.y_arcsec) for cases in every]
        metrics = [model.metrics[cases.band] for cases in every]
        parts = [
            [part.averaging().law() for part in programme_parts(one, drift, place, width, ratio, model.timing)]
            for one, place in zip(metrics, separations, strict=True)
        ]
        crossed, light = (laws(found) for found in zip(*parts, strict=True))
        inward = together(one.lambda_d_arcsec / place for one, place in zip(metrics, separations, strict=True))
        also = laws(turned) if turned else None
        averaging = ProgrammeLaw(science, reference, common, drift.correlation_time_h, also)
        at_place = strategy.search == "known_place"
        return cls(thresholds / law.calibration, law, at_place, averaging, crossed, light, inward, motion)

    def __call__(
        self, programme: Programme, problem: FrameProblem, visit_s: FloatArray, inverse: FloatArray
    ) -> FloatArray:
        """Return the level of a programme whose visits have this length, and noise over signal squared."""
        if self.averaging is None or self.crossed is None or self.light is None:
            return self.of_tails(programme, np.zeros_like(inverse), visit_s)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            light = self.light.variance(visit_s)
            speckle = programme.law(self.averaging).variance(visit_s) / problem.signal_e_s**2
            tails = np.sqrt(light / (light + self.crossed.variance(visit_s)) * speckle / inverse)
        return self.of_tails(programme, np.minimum(np.nan_to_num(tails), 1.0), visit_s)

    def of_tails(self, programme: Programme, tails: FloatArray, visit_s: FloatArray) -> FloatArray:
        """Return the level of a programme of visits of a length whose noise is light of errors in this part, as rms."""
        at_rest = self._at_rest(programme, tails)
        return at_rest if self.motion is None else at_rest * self.motion.factor(programme, visit_s)

    def _at_rest(self, programme: Programme, tails: FloatArray) -> FloatArray:
        """The same for planets that do not move, or that are followed."""
        if self.law is None or self.averaging is None or self.inward is None:
            return np.broadcast_arrays(self.level, tails)[0]
        independent = effective_of(programme, self.averaging)
        return self.level * half_margin(self.law, self.at_place, tails, self.inward, independent)


def effective_of(programme: Programme, law: ProgrammeLaw) -> FloatArray:
    """Return the number of independent wavefronts behind the noise of a programme.

    Parameters
    ----------
    programme : Programme
    law : ProgrammeLaw
        Which says how long wavefronts remember each other.
    """
    many = (programme.visits, programme.reference_visits)
    return effective_visits(*(law.independent(number, programme.gap_s) for number in many))


def band_cases(model: EtcModel, targets: Targets, band: str, planets: Planets, fixed: FixedFrames) -> BandCases:
    """Return rates and places of all stars and planets in one band.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
    band : str
    planets : Planets
    fixed : FixedFrames
        What is fixed of the frames.
    """
    metrics, place = model.metrics[band], planets.separation_arcsec
    places = tuple(place_status(model, band, float(value)) for value in place)
    inside = np.array([status is Status.OK for status, _, _ in places])
    # What has no answer (a place outside the hole, no light) is carried along as something that can be solved.
    solvable = np.where(inside, place, np.mean(usable_range_arcsec(model.instrument, band)))
    x, y = planet_offsets(model, targets, band, solvable[None, :])
    contrast = _contrasts(model, targets, band, planets)
    light = np.where(inside, np.maximum(contrast, _FAINTEST), _ORDINARY)
    rates = aperture_rates(model, targets, band, x, y, light)
    threshold = threshold_array(metrics.resolution_elements(place), model.strategy.sigma)
    programme = Programme.of(model.strategy)
    return BandCases(model, targets, band, planets, places, x, y, contrast, threshold, rates, fixed, programme)


def _contrasts(model: EtcModel, targets: Targets, band: str, planets: Planets) -> FloatArray:
    """Contrasts ``(n_star, n_planet)``; planets of one model are computed together."""
    shape = (len(targets), len(planets))
    if planets.contrast is not None:
        return np.broadcast_to(planets.contrast, shape)
    contrast = np.zeros(shape)
    for body in dict.fromkeys(planets.models):
        own = np.array([other == body for other in planets.models]) & (planets.separation_arcsec > 0)
        if own.any():
            contrast[:, own] = reference_contrast(model, targets, band, planets.separation_arcsec[own], body)
    return contrast


def best_band(answers: Sequence[EtcAnswer]) -> str | None:
    """Band of the best answer: least time, highest significance over threshold, or faintest limit."""
    good = [answer for answer in answers if answer.value is not None]
    if not good:
        return None
    if good[0].question in ("exposure_time", "contrast_limit"):
        return min(good, key=lambda answer: answer.value or np.inf).band
    return max(good, key=lambda answer: (answer.significance or 0.0) / (answer.threshold or np.inf)).band


def etc_result(
    model: EtcModel,
    target: Targets,
    answers: Sequence[EtcAnswer],
    *,
    note: str,
    planet: ReferencePlanet | None,
    asked: Mapping[str, Any],
    catalogue: str,
    dial: Dial | None = None,
    seed: int | None = None,
) -> EtcResult:
    """Collect answers about one star of a catalogue, which is named by its provenance.

    ``dial`` and ``seed`` are those of the check in images, closed forms alone without.
    """
    record = None if planet is None else ReferencePlanetRecord.of(planet, albedo=planet.albedo.label)
    decides: dict[str, Any] = {"kind": "etc", "version": __version__, "model": model.content()}
    decides |= {"target": target.content(), "detection": default_law().model_dump(mode="json"), "asked": asked}
    decides["planet"] = None if planet is None else planet.content()
    return EtcResult(
        config_hash=content_hash(decides),
        target=str(target.name[0]),
        hip=int(target.hip[0]) if target.hip[0] else None,
        v_mag=float(target.v_mag[0]),
        distance_pc=float(target.distance_pc[0]),
        catalogue=catalogue,
        date_utc=target.date_utc,
        note=note,
        reference_planet=record,
        best_band=best_band(answers),
        answers=list(answers),
        fidelity=etc_fidelity(answers, dial or etc_dial(), seed=seed),
    )
