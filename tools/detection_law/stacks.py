"""Stacks of visits of some stars and bands, with and without planets, as the law of detection is measured on them."""

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cpic_core import FloatArray, InputError, IntArray, NDArray, stream
from cpic_planner.etc import EtcModel, Programme, aperture_rates, build_model, stack_noise, threshold_array
from cpic_planner.etc.detection import tail_share
from cpic_planner.queries import ReferencePlanet, Strategy
from cpic_planner.targets import Targets, find_target
from cpic_planner.validation import (
    ConfirmTask,
    Frames,
    PlanetTemplate,
    RdiResult,
    Realisation,
    ReducedStack,
    aperture_weights,
    prepare_task,
    visit_pair,
)
from cpic_planner.validation.detection import BlindSearch, search
from cpic_planner.validation.measure import forced_photometry
from cpic_planner.validation.speckle_maps import SpeckleMaps, speckle_maps
from simulator.config import load_instrument
from simulator.detectors import excess_noise_factor2
from simulator.imaging import Psf, PsfMetrics
from simulator.observing import hole_stacks
from simulator.signal import hole_changes

VISITS = (1, 4, 16)
POOL, DRAWN, PLACES = 800, 48, 160  # visits of a band that are combined, drawn by frames, and places of planets
SEED = 4


@dataclass(frozen=True)
class Case:
    """Star (its light scaled to ``v_mag``), band, rms of the offset of a visit, wall time of one visit.

    ``part`` is ``fit``, ``test`` (stars, bands, drifts and lengths that the fit knows nothing of), or ``frames``:
    visits are sums of frames of the image simulator, with a walk within each, instead of those of the pool.
    """

    part: str
    star: str
    band: str
    v_mag: float
    drift_nm: float
    time_s: float


CASES = (
    Case("fit", "tau Cet", "F520", 3.5, 0.05, 7200.0),
    Case("fit", "tau Cet", "F520", 0.0, 0.05, 7200.0),
    Case("fit", "tau Cet", "F520", 5.0, 0.03, 7200.0),
    Case("fit", "tau Cet", "F520", 3.0, 0.3, 7200.0),
    Case("frames", "tau Cet", "F520", 3.5, 0.05, 7200.0),
    Case("fit", "eps Eri", "F662", 3.7, 0.05, 7200.0),
    Case("fit", "eps Eri", "F662", 1.0, 0.1, 7200.0),
    Case("fit", "eps Eri", "F662", 5.0, 0.1, 7200.0),
    Case("fit", "alf CMi", "F850", 0.4, 0.05, 7200.0),
    Case("fit", "alf CMi", "F850", 3.0, 0.3, 7200.0),
    Case("test", "bet Hyi", "F520", 3.5, 0.1, 7200.0),
    Case("test", "bet Hyi", "F520", 1.0, 0.03, 3600.0),
    Case("test", "alf Cen B", "F720", 1.3, 0.05, 5400.0),
    Case("test", "alf Cen B", "F720", 4.0, 0.1, 10800.0),
    Case("test", "61 Cyg A", "F850", 2.5, 0.07, 5400.0),
    Case("test", "61 Cyg A", "F850", 5.2, 0.2, 7200.0),
)


@dataclass(frozen=True, eq=False)
class Field:
    """Optics of a star in a band: responses to offsets of 1 nm at the pixels of the hole, and images of planets."""

    psf: Psf
    maps: SpeckleMaps
    slope: float
    linear: NDArray[np.float32]
    square: NDArray[np.float32]
    place_arcsec: FloatArray
    planet: FloatArray

    @classmethod
    def of(cls, psf: Psf, maps: SpeckleMaps, slope: float) -> "Field":
        """Draw the pool; other screens than those of the maps."""
        place = places_arcsec(psf.metrics)
        planet = np.stack([np.asarray(psf.at(*one))[psf.geometry.hole] for one in place])
        _, linear, square = hole_changes(psf, slope, POOL, stream(SEED, "pool"))
        return cls(psf, maps, slope, linear, square, place, planet)

    def renewed(self, number: int) -> "Field":
        """Return the same optics with another pool of visits, the same for the same number."""
        _, linear, square = hole_changes(self.psf, self.slope, POOL, stream(SEED, "pool", number))
        return dataclasses.replace(self, linear=linear, square=square)

    def template(self, place: int, width_lambda_d: float) -> PlanetTemplate:
        """Return what forced photometry at one of the places needs."""
        geometry = self.psf.geometry
        x, y = (float(part) for part in self.place_arcsec[place])
        scale, middle = geometry.pixel_scale_arcsec, geometry.stamp_pixels // 2
        image, radius = np.zeros(geometry.hole.shape), geometry.aperture_radius_arcsec / scale
        image[geometry.hole] = self.planet[place]
        weights = aperture_weights(geometry.hole.shape, middle + x / scale, middle + y / scale, radius)
        ring, core = geometry.annulus(math.hypot(x, y), width_lambda_d), float(np.sum(image * weights))
        return PlanetTemplate(
            name="planet",
            places_arcsec=((x, y),),
            apertures=(weights,),
            background=ring,
            others=(),
            templates=(image,),
            cores=(core,),
        )

    def places(self, rng: np.random.Generator) -> IntArray:
        """Return the places of four planets, one a quadrant, no two near each other's mirror image."""
        reach = 2.0 * self.psf.geometry.lambda_d_arcsec
        while True:
            chosen = 4 * rng.integers(PLACES // 4, size=4) + np.arange(4)
            at = self.place_arcsec[chosen]
            if all(np.hypot(*(at[k] + at[k + 2])) > reach for k in (0, 1)):
                return chosen


@dataclass(frozen=True, eq=False)
class Scene:
    """A case with its optics, frames and white noise of one visit."""

    case: Case
    field: Field
    model: EtcModel
    target: Targets
    frames: Frames
    rate_e_s: float
    white_e2: FloatArray
    stages: int
    drawn: tuple[FloatArray, FloatArray] | None

    def renewed(self, number: int) -> "Scene":
        """Return the same case with another pool of visits."""
        return dataclasses.replace(self, field=self.field.renewed(number))

    def visits_of(self, visits: int, rng: np.random.Generator) -> FloatArray:
        """Return science visits less the mean of as many references, electrons, (visits, pixels of the hole)."""
        if self.drawn is not None:
            science, reference = (part[rng.choice(len(part), visits, replace=False)] for part in self.drawn)
            return np.asarray(science - reference.mean(axis=0))
        chosen = rng.choice(len(self.field.linear), 2 * visits, replace=False)
        light_e = self.rate_e_s * self.frames.exposure_s * self.frames.n_frames * self.case.drift_nm
        light = light_e * (self.field.linear[chosen] + self.case.drift_nm * self.field.square[chosen])
        light = light + np.sqrt(0.5 * self.white_e2) * rng.standard_normal(light.shape)
        return np.asarray(light[:visits] - light[visits:].mean(axis=0))

    def light_of(self, visits: int, planet_e: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Return the light of a planet of so many electrons a visit in the pixels of the hole, mean of the visits."""
        drawn = rng.poisson(np.maximum(visits * planet_e, 0.0)).astype(float)
        spread = float(excess_noise_factor2(self.frames.em_gain, self.stages)) - 1.0
        return np.asarray((drawn + np.sqrt(spread * drawn) * rng.standard_normal(drawn.shape)) / visits)

    def stack(self, left: FloatArray) -> ReducedStack:
        """Return the sum of visits as `visits_of` gives them, with what planets add."""
        hole, visits = self.field.psf.geometry.hole, len(left)
        images = np.zeros((visits, *hole.shape))
        images[:, hole] = left
        variance = np.zeros(hole.shape)
        variance[hole] = visits * self.white_e2
        none = np.zeros((0, int(hole.sum())))
        rdi = RdiResult(images, 0, 0, False, "temporal", hole, none, np.zeros(0))
        gain, total_s = self.frames.em_gain, visits * self.frames.exposure_s * self.frames.n_frames
        return ReducedStack(images.sum(axis=0), hole, variance, variance, rdi, total_s, gain, self.stages)

    def searched(self, stack: ReducedStack, visits: int, sigma: float) -> BlindSearch:
        """Search a stack blind."""
        return search(
            stack,
            self.field.psf,
            self.field.maps,
            star_rate_e_s=self.rate_e_s,
            sigma=sigma,
            visits=visits,
            reference_visits=visits,
        )

    def seen_at_place(self, stack: ReducedStack, place: int) -> bool:
        """Return whether photometry at a place exceeds the small-sample threshold, in a stack without other planets."""
        strategy, metrics = self.model.strategy, self.model.metrics[self.case.band]
        template = self.field.template(place, strategy.annulus_lambda_d)
        seen = Realisation(stack, None, stack.image_e, stack.image_e)
        try:
            found = forced_photometry(seen, template, self.field.psf.geometry, strategy.filter)
        except InputError:  # too few apertures beside the planet: the noise is not known there
            return False
        separation = float(np.hypot(*self.field.place_arcsec[place]))
        return found.significance >= float(threshold_array(metrics.resolution_elements(separation), strategy.sigma))


def model_of(case: Case) -> EtcModel:
    """Return the calculator of single visits of a case."""
    walk_nm = case.drift_nm if case.part == "frames" else 0.0
    drift = {"visit_nm": case.drift_nm, "walk_nm_per_sqrt_hour": walk_nm, "common_fraction": 0.0, "orbital_nm": 0.0}
    # Frames and white noise of one visit, of which stacks are made.
    one = load_instrument().changed({"drift": drift, "overhead_s": 0.0})
    return build_model(one, [case.band], Strategy(visits=1))


def star_of(case: Case) -> Targets:
    """Return the star of a case."""
    return dataclasses.replace(find_target(case.star)[0], v_mag=np.array([case.v_mag]))


def places_arcsec(metrics: PsfMetrics) -> FloatArray:
    """Return the places of planets in the hole of a band, one quadrant after the other, shape (PLACES, 2)."""
    low = metrics.zone.inner_arcsec + metrics.aperture_radius_arcsec
    high = metrics.zone.outer_arcsec - metrics.aperture_radius_arcsec
    signs = np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])[np.arange(PLACES) % 4]
    return np.asarray(signs * stream(SEED, "places").uniform(low, high, (PLACES, 2)))


def expected(case: Case, frames: Frames, visits: int) -> dict[str, FloatArray]:
    """Return the margin of a planet of contrast 1, share of tails, and element over separation, at every place.

    Parameters
    ----------
    case : Case
    frames : Frames
        Of each visit.
    visits : int
        Of science, and as many of references.
    """
    model, x, y = model_of(case), *places_arcsec(model_of(case).metrics[case.band]).T
    separation, camera, metrics = np.hypot(x, y), model.camera(case.band), model.metrics[case.band]
    rates = aperture_rates(model, star_of(case), case.band, x[None], y[None], np.full((1, x.size), 1e-9))
    made = Programme(np.array(float(visits)), np.array(float(visits)))
    noise = stack_noise(rates, *frames[:3], camera, model.strategy, made)
    threshold = threshold_array(metrics.resolution_elements(separation), model.strategy.sigma)
    visit_s = frames.n_frames * (frames.exposure_s + camera.readout_s)
    return {
        "margin": noise.significance[0] / threshold / 1e-9,
        "tails": tail_share(model, case.band, separation[None], np.array(visit_s), noise)[0],
        "inward": metrics.lambda_d_arcsec / separation,
    }


def scenes() -> Iterator[Scene]:
    """Yield all cases; those of one star and band share their optics."""
    field, key = None, None
    for case in CASES:
        model, target = model_of(case), star_of(case)
        task = prepare_task(
            model, target, case.band, time_s=case.time_s, planet=ReferencePlanet(), seed=1, fidelity="standard",
            realisations=1, audit=False, overrides=None,
        )  # fmt: skip
        if not isinstance(task, ConfirmTask):
            raise RuntimeError(f"{case}: {task.message}")
        pair = visit_pair(dataclasses.replace(task, scene=task.scene | {"planets": []}, predictions=[], planets=[]))
        maps = speckle_maps(pair.optics, model.instrument.drift)
        if field is None or key != (case.star, case.band):
            field, key = Field.of(pair.optics, maps, model.instrument.drift.psd_slope), (case.star, case.band)
        field = dataclasses.replace(field, psf=pair.optics, maps=maps)
        reduced, hole, drawn = pair.draw(0).reduced, pair.geometry.hole, None
        if case.part == "frames":
            roles = (hole_stacks(seen, epochs=2) for seen in (pair.science, pair.reference))
            sums = [np.concatenate([role.draw(k, summed=True) for k in range(DRAWN)])[:, hole] for role in roles]
            drawn = sums[0], sums[1]
        yield Scene(
            case=case,
            field=field,
            model=model,
            target=target,
            frames=Frames(task.exposure_s, task.n_frames, task.em_gain),
            rate_e_s=pair.science.truth.sources[0].rate_e_s,
            white_e2=reduced.white_variance_e2[hole],
            stages=reduced.stages,
            drawn=drawn,
        )
