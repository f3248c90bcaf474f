"""Cases of one band, targets x planets, ready for a question, and the result that is made of their answers."""

import copy
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from cpic_core import ArrayLike, FloatArray, NDArray, Reason, Status
from cpic_planner.etc.detection import threshold_array
from cpic_planner.etc.fidelity import etc_fidelity
from cpic_planner.etc.frames import FrameChoice, FrameProblem, frame_problem
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
from cpic_planner.etc.noise import Objective, StackNoise, stack_noise, with_modes
from cpic_planner.etc.programmes import SearchMotion
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
from cpic_planner.etc.searches import spread
from cpic_planner.planets import excluded_by_rv
from cpic_planner.queries import ReferencePlanet
from cpic_planner.results import EtcAnswer, EtcResult, ReferencePlanetRecord
from cpic_planner.targets import Targets
from cpic_planner.version import __version__
from simulator.config import content_hash
from simulator.effects import SKY_PLACE_UNKNOWN, sky_place_unknown
from simulator.imaging import quadrant_of
from simulator.knobs import Dial, dial_of
from simulator.signal import ProgrammeLaw, programme_parts

_FAINTEST, _ORDINARY = 1e-30, 1e-9


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
        shortest = max(camera.exposure_min_s for camera in cameras)
        limits["exposure_s"] = check_range("exposure_s", exposure_s, shortest, 1e6, "s")
    if em_gain is not None:
        limits["em_gain"] = check_range("em_gain", em_gain, 1.0, min(camera.em_gain_max for camera in cameras), "")
    return FixedFrames(**limits)


class Cases:
    """Cases of one band, or of several of one camera, share this; all arrays broadcast against ``contrast``."""

    model: EtcModel
    fixed: FixedFrames
    contrast: FloatArray
    rates: ApertureRates
    programme: Programme
    x_arcsec: FloatArray
    y_arcsec: FloatArray

    @property
    def camera(self) -> FrameCamera:
        """One frame of the camera, of the exposure that is fixed."""
        raise NotImplementedError

    @property
    def free_camera(self) -> FrameCamera:
        """One frame of the camera, of any exposure."""
        raise NotImplementedError

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Cases whose aperture lies in the controlled zone."""
        raise NotImplementedError

    @property
    def residual_parts(self) -> tuple[ProgrammeLaw, ProgrammeLaw]:
        """Residual in units of the star's light: cross term with the static field, and light of the errors."""
        raise NotImplementedError

    def in_programme(self, programme: Programme) -> Self:
        """Return the cases in another programme."""
        made = copy.copy(self)
        object.__setattr__(made, "programme", programme)
        return made

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
        raise NotImplementedError

    def programme_of(self, visits: ArrayLike, visit_time_s: ArrayLike, choice: FrameChoice) -> Programme:
        """Return another number of visits of chosen frames.

        Parameters
        ----------
        visits, visit_time_s : array_like
        choice : FrameChoice
        """
        programme = Programme.of(self.model.strategy, visits, visit_time_s)
        return self.with_modes(programme, choice.exposure_s, choice.n_frames, choice.em_gain)

    def problem(
        self, objective: Objective, contrast: FloatArray | None = None, programme: Programme | None = None
    ) -> FrameProblem:
        """Return what the solver needs, for the cases' own contrasts and programme or given ones.

        Parameters
        ----------
        objective : {"snr", "significance"}
        contrast : ndarray, optional
            Contrasts instead of the cases' own, of their shape.
        programme : Programme, optional
        """
        rates = self.rates if contrast is None else self.rates_at(contrast)
        made = self.programme if programme is None else programme
        settings: dict[str, Any] = {"objective": objective, "em_gain": self.fixed.em_gain, "programme": made}
        return frame_problem(rates, self.camera, self.model.strategy, **settings)

    def rates_at(self, contrast: FloatArray) -> ApertureRates:
        """Return the rates with other contrasts: only the planet's own light follows them."""
        own = self.rates.peak_in_hole_e_s - self.rates.peak_planet_e_s
        factor = contrast / np.maximum(self.contrast, _FAINTEST)
        peak = self.rates.peak_planet_e_s * factor
        planet_e_s = self.rates.planet_e_s * factor
        return replace(self.rates, planet_e_s=planet_e_s, peak_planet_e_s=peak, peak_in_hole_e_s=own + peak)

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


@dataclass(frozen=True)
class BandCases(Cases):
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
        return np.asarray(spread(inside, self.contrast.shape))

    @functools.cached_property
    def motion(self) -> SearchMotion | None:
        """Price that a search pays for the motion of the planets; None where it knows their places."""
        place = spread(np.hypot(self.x_arcsec, self.y_arcsec), self.contrast.shape)
        return SearchMotion.asked(self.model, self.targets, self.band, place)

    @property
    def camera(self) -> FrameCamera:
        """One frame of the band's camera, of the exposure that is fixed."""
        camera = self.free_camera
        if self.fixed.exposure_s is None:
            return camera
        return replace(camera, exposure_min_s=self.fixed.exposure_s, exposure_max_s=self.fixed.exposure_s)

    @property
    def free_camera(self) -> FrameCamera:
        """One frame of the band's camera, of any exposure."""
        return self.model.camera(self.band)

    @functools.cached_property
    def residual_parts(self) -> tuple[ProgrammeLaw, ProgrammeLaw]:
        """Residual in units of the star's light, by the law of this band; see `Cases.residual_parts`."""
        model, strategy, place = self.model, self.model.strategy, np.hypot(self.x_arcsec, self.y_arcsec)
        width, ratio, metrics = strategy.annulus_lambda_d, strategy.reference_ratio, model.metrics[self.band]
        return programme_parts(metrics, model.instrument.drift, place, width, ratio, model.timing)

    def with_modes(
        self, programme: Programme, exposure_s: FloatArray, n_frames: FloatArray, em_gain: FloatArray
    ) -> Programme:
        """Return a programme with what modes change in this band; see `Cases.with_modes`."""
        place = np.hypot(self.x_arcsec, self.y_arcsec)
        return with_modes(self.model, self.band, place, self.rates, programme, exposure_s, n_frames, em_gain)

    def head(self, star: int, planet: int) -> dict[str, Any]:
        """Return the fields of an answer that do not depend on the question.

        Parameters
        ----------
        star, planet : int
            The case.
        """
        library = self.model.strategy.reference_library
        notes = [*self.targets.flags[star], *hole_notes(self.model, self.band), *self.model.library_flags]
        if sky_place_unknown(self.model.instrument, self.targets.ra_deg[star], self.targets.dec_deg[star]):
            notes.append(SKY_PLACE_UNKNOWN)
        threshold = float(self.threshold[planet])
        inside = self.places[planet][0] is Status.OK

        def of_case(values: FloatArray) -> float:
            return float(spread(values, self.contrast.shape)[star, planet])

        x, y = of_case(self.x_arcsec), of_case(self.y_arcsec)
        return {
            "target": str(self.targets.name[star]),
            "band": self.band,
            "separation_arcsec": float(self.planets.separation_arcsec[planet]),
            "threshold": threshold if inside and np.isfinite(threshold) else None,
            "core_throughput": of_case(self.rates.core) if inside else None,
            "quadrant": QUADRANTS[quadrant_of(x, y)] if inside else None,
            "roll_deg": self.targets.roll_deg,
            "reference_library": library.name,
            "centring": "temporal",
            "annulus_lambda_d": self.model.strategy.annulus_lambda_d,
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
        excluded = _excluded(str(target.name[0]), distance, body.radius_rjup)
        notes = reference_notes(self.model, target, self.band, place, body)
        return (*notes, "excluded_by_rv") if excluded else notes


@functools.lru_cache(maxsize=256)
def _excluded(name: str, distance_au: float, radius_rjup: float) -> bool:
    """Return whether velocities exclude a planet: every band of a question asks about the same one."""
    return bool(excluded_by_rv([name], distance_au, radius_rjup)[0])


def band_cases(
    model: EtcModel,
    targets: Targets,
    band: str,
    planets: Planets,
    fixed: FixedFrames,
    offsets_arcsec: tuple[float, float] | None = None,
) -> BandCases:
    """Return rates and places of all stars and planets in one band.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
    band : str
    planets : Planets
    fixed : FixedFrames
        What is fixed of the frames.
    offsets_arcsec : tuple of float, optional
        A place in the dark hole at which all planets stand, instead of the diagonal at their separations.
    """
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
    threshold = threshold_array(metrics.resolution_elements(place), model.strategy.sigma)
    programme = Programme.of(model.strategy)
    return BandCases(model, targets, band, planets, places, x, y, contrast, threshold, rates, fixed, programme)


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


def best_band(answers: Sequence[EtcAnswer]) -> str | None:
    """Return the band of the best answer: least time, highest significance over threshold, or faintest limit."""
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
    notes: Sequence[str] = (),
    planet: ReferencePlanet | None,
    asked: Mapping[str, Any],
    catalogue: str,
    dial: Dial | None = None,
    seed: int | None = None,
) -> EtcResult:
    """Collect answers about one star of a catalogue, which is named by its provenance.

    ``note`` is a remark on the name of the star, ``notes`` are those on the reading of tables. ``dial`` and ``seed``
    are those of the check in images, closed forms alone without.
    """
    record = None if planet is None else ReferencePlanetRecord.of(planet, albedo=planet.albedo.label)
    decides: dict[str, Any] = {"kind": "etc", "version": __version__, "model": model.content()}
    decides |= {"target": target.content(), "asked": asked}
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
        notes=list(notes),
        reference_planet=record,
        best_band=best_band(answers),
        answers=list(answers),
        fidelity=etc_fidelity(answers, dial or dial_of("quick"), seed=seed, of_table=model.of_table),
    )
