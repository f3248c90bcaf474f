"""Cases of several bands of one camera at once, and the level that they have to reach."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np

from cpic_core import FloatArray, NDArray
from cpic_planner.etc.cases import BandCases, Cases, FixedFrames
from cpic_planner.etc.chances import Chances
from cpic_planner.etc.detection_law import SearchLaw, band_law
from cpic_planner.etc.frames import FrameProblem, best_exposure_s, frame_problem
from cpic_planner.etc.model import ONE_VISIT, EtcModel, FrameCamera, Programme
from cpic_planner.etc.noise import Objective, StackNoise, residuals, white_term
from cpic_planner.etc.programmes import SearchMotion, motion_factor
from cpic_planner.etc.rates import ApertureRates
from cpic_planner.etc.searches import spread
from simulator.detectors import FrameTerm
from simulator.signal import ProgrammeLaw, SpeckleLaw

_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class CameraCases(Cases):
    """All stars and planets in bands of one camera; arrays broadcast to ``(n_band, n_star, n_planet)``.

    Attributes
    ----------
    model, fixed
        As of `BandCases`.
    bands : tuple of BandCases
        The same band by band.
    x_arcsec, y_arcsec, contrast, threshold, rates
        As of `BandCases`.
    programme : Programme
    """

    model: EtcModel
    fixed: FixedFrames
    bands: tuple[BandCases, ...]
    x_arcsec: FloatArray
    y_arcsec: FloatArray
    contrast: FloatArray
    threshold: FloatArray
    rates: ApertureRates
    programme: Programme

    @classmethod
    def of(cls, bands: Sequence[BandCases]) -> Self:
        """Return the bands together, with the programme of the first.

        Parameters
        ----------
        bands : sequence of BandCases
            Of one model and camera, of the same stars and planets.
        """
        shape = bands[0].contrast.shape
        names = ("x_arcsec", "y_arcsec", "contrast", "threshold", "rates")
        arrays = {name: together([getattr(cases, name) for cases in bands], shape) for name in names}
        first = bands[0]
        return cls(model=first.model, fixed=first.fixed, bands=tuple(bands), programme=first.programme, **arrays)

    @functools.cached_property
    def camera(self) -> FrameCamera:
        """One frame of the camera that all bands share, of the exposure that is fixed."""
        return self.bands[0].camera

    @property
    def free_camera(self) -> FrameCamera:
        """One frame of the camera that all bands share, of any exposure."""
        return self.bands[0].free_camera

    @functools.cached_property
    def usable(self) -> NDArray[np.bool_]:
        """Cases whose aperture lies in the controlled zone, one row a band."""
        return np.stack([cases.usable for cases in self.bands])

    @functools.cached_property
    def residual_parts(self) -> tuple[ProgrammeLaw, ProgrammeLaw]:
        """Residual in units of the star's light, one row a band; see `Cases.residual_parts`."""
        crossed, light = together([cases.residual_parts for cases in self.bands], self.contrast.shape[1:])
        return crossed, light

    @functools.cached_property
    def separation_arcsec(self) -> FloatArray:
        """Projected separations, one row a band."""
        return np.asarray(spread(np.hypot(self.x_arcsec, self.y_arcsec), self.contrast.shape))

    @functools.cached_property
    def motion(self) -> SearchMotion | None:
        """As of `BandCases`."""
        return SearchMotion.stacked([cases.motion for cases in self.bands], self.contrast.shape[1:])

    @functools.cached_property
    def search(self) -> "Wanted":
        """Level of a detection as the strategy searches."""
        return Wanted.of(self)

    @functools.cached_property
    def _single(self) -> dict[Objective, FrameProblem]:
        """Problems of a single visit, with their exposures of most SNR per time, as far as they were asked for."""
        return {}

    @functools.cached_property
    def _white(self) -> FrameTerm:
        """White noise of a frame of a single visit but the planet's own."""
        return white_term(self.rates, self.camera, ONE_VISIT.frame_ratio(self.model.strategy.reference_ratio))

    def problem(
        self, objective: Objective, contrast: FloatArray | None = None, programme: Programme | None = None
    ) -> FrameProblem:
        """Return what the solver needs, as `Cases.problem`; exposure of most SNR per time where it is of one visit."""
        reduced, ratio = self.programme if programme is None else programme, self.model.strategy.reference_ratio
        if self.model.strategy.n_modes:  # of the planet's own light modes leave another part
            return super().problem(objective, contrast, programme)
        shares = reduced.frame_ratio(ratio)
        # As many references a frame: a visit has the white noise of a single one.
        alike = bool((shares == ratio).all())
        if contrast is not None:
            settings: dict[str, Any] = {"objective": objective, "em_gain": self.fixed.em_gain, "programme": reduced}
            settings["white"] = self._white if alike else None
            return frame_problem(self.rates_at(contrast), self.camera, self.model.strategy, **settings)
        if not alike and np.any(np.abs(shares / ratio - 1.0) > _ROUNDING):
            return super().problem(objective, None, reduced)
        if objective not in self._single:
            single = super().problem(objective, None, ONE_VISIT)
            self._single[objective] = replace(single, best_s=best_exposure_s(single)[0])
        if alike:
            return in_programme(self._single[objective], self.rates, reduced, objective)
        made = super().problem(objective, None, reduced)
        return replace(made, best_s=spread(self._single[objective].best_s, made.signal_e_s.shape))

    def with_modes(
        self, programme: Programme, exposure_s: FloatArray, n_frames: FloatArray, em_gain: FloatArray
    ) -> Programme:
        """Return a programme with what modes change in each band; see `Cases.with_modes`."""
        if self.model.strategy.n_modes == 0:
            return programme
        parts = [
            cases.with_modes(
                programme._combined(lambda array, at=i: _of_band(array, at)),
                *(_of_band(part, i) for part in (exposure_s, n_frames, em_gain)),
            )
            for i, cases in enumerate(self.bands)
        ]
        shape = np.broadcast_shapes((1, 1), *(np.shape(array) for part in parts for array in vars(part).values()))
        return Programme.stacked([part.spread(shape) for part in parts], axis=-3)

    def of_contrast(self, contrast: FloatArray) -> Self:
        """Return the cases with other contrasts, ``(n_band, n_star, n_planet)``."""
        return replace(self, contrast=contrast, rates=self.rates_at(contrast))


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


def together(parts: Sequence[Any], shape: tuple[int, ...]) -> Any:
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
        return replace(first, **{name: together([getattr(part, name) for part in parts], shape) for name in names})
    if isinstance(first, tuple):
        every = [together(of_one, shape) for of_one in zip(*parts, strict=True)]
        return type(first)(*every) if hasattr(first, "_fields") else tuple(every)
    if first is None or (not isinstance(first, np.ndarray) and all(part == first for part in parts)):
        return first
    whole = np.empty((len(parts), *shape))
    for place, part in zip(whole, parts, strict=True):
        place[...] = part
    return whole


@dataclass(frozen=True, eq=False)
class Wanted:
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
        """Whether the level is the same for all programmes."""
        return not self.laws and self.motion is None

    @classmethod
    def of(cls, cases: CameraCases, value: float | None = None) -> Self:
        """Return the level of cases: a given value, or that of a detection as the strategy searches."""
        shape = cases.contrast.shape
        if value is not None:
            return cls(np.full(shape, float(value)))
        model, laws = cases.model, tuple(band_law(cases.model, one.band) for one in cases.bands)
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
