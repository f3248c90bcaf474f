"""Realisations of one observation: science and reference visits drawn as sums of frames, or frame by frame."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from cpic_core import BoolArray, FloatArray, Outcome
from cpic_planner.queries import Strategy
from cpic_planner.validation.frames import MOST_LOST, CalibratedFrames, calibrated_frames
from cpic_planner.validation.libraries import LibraryPlan, library_plan
from cpic_planner.validation.modelling import Modelling, modelling_of
from cpic_planner.validation.reduced import ReducedStack, pedestal_e, reduce_stack
from cpic_planner.validation.rejection import filled, reject_cosmic_rays
from cpic_planner.validation.roll import RollResult, roll_subtract
from cpic_planner.validation.task import ConfirmTask
from simulator.config import Instrument, Scene, validate
from simulator.imaging import BandGeometry, Psf
from simulator.observing import HoleStacks, Observation, hole_stackable, hole_stacks, observe


@dataclass(frozen=True, eq=False)
class Realised:
    """One realisation, reduced.

    Attributes
    ----------
    reduced : ReducedStack
        Residual of the science visit.
    roll : RollResult or None
        Both residuals where the planet is in both visits.
    science_e, reference_e : ndarray, shape (n, n)
        What went in, summed over the frames, for pictures.
    """

    reduced: ReducedStack
    roll: RollResult | None
    science_e: FloatArray
    reference_e: FloatArray


@dataclass(frozen=True)
class FrameStory:
    """What happened to frames one by one.

    Attributes
    ----------
    lost_in, lost_outside : int
        Pixel-frames of the dark hole and around it that a limit cut off. In the hole only pixels that lose more than
        one frame in twenty: their own light does it, or what flows in, and not a particle.
    rejected_fraction : float
        Share of the pixel-frames of the hole that were taken for hits of particles.
    hits : int
        Pixel-frames above the limit of rejection.
    """

    lost_in: int
    lost_outside: int
    rejected_fraction: float
    hits: int


@dataclass(frozen=True, eq=False)
class Visits:
    """Science and reference visit of a task, ready to be drawn any number of times; made by `visits_of`.

    Attributes
    ----------
    task : ConfirmTask
    modelling : Modelling
        How the images are made.
    strategy : Strategy
    instrument : Instrument
        Of the images.
    plan : LibraryPlan
    science, reference : Observation
    scale : float
        Brightness of the science star over that of the reference star.
    stackable : Outcome
        Whether sums of frames may stand for them.
    """

    task: ConfirmTask
    modelling: Modelling
    strategy: Strategy
    instrument: Instrument
    plan: LibraryPlan
    science: Observation
    reference: Observation
    scale: float
    stackable: Outcome[float]
    _stacks: tuple[HoleStacks, HoleStacks] | None

    @property
    def geometry(self) -> BandGeometry:
        """Hole and apertures on the stamp."""
        return self.optics.geometry

    @property
    def optics(self) -> Psf:
        """The optics themselves."""
        return cast(Psf, self.science.psf)  # a task has no PSF from a file

    @property
    def scene(self) -> Scene:
        """What the science frames show."""
        return self.science.scene

    def with_light(self, extra_e_s: FloatArray) -> Visits:
        """The same with more light in the science visit (an injected planet), electrons per second and pixel."""
        assert self._stacks is not None  # as stackable says
        science, reference = self._stacks
        return dataclasses.replace(self, _stacks=(science.with_light(extra_e_s), reference))

    def draw(self, realisation: int) -> Realised:
        """One realisation from sums of frames; only where ``stackable`` is ok."""
        assert self._stacks is not None  # as stackable says
        science, reference = self._stacks
        sums = science.draw(realisation)
        if self.plan.noise_free:
            dark_e = pedestal_e(self.science.instrument.detector, self.task.exposure_s)
            rates = reference.mean_rates(realisation)
            library = (rates * self.task.exposure_s + dark_e) * reference.frames[:, None, None]
            library[:, ~reference.region] = 0.0
        else:
            library = reference.draw(realisation)
        return self.reduced(sums, library, science.frames, reference.frames, science.region)

    def reduced(
        self, science_e: FloatArray, reference_e: FloatArray, science_n: Any, reference_n: Any, region: BoolArray
    ) -> Realised:
        """Reduce images of both visits, each of so many frames."""
        roll = None
        if self.plan.shows_planet:
            roll = roll_subtract(
                science_e,
                reference_e,
                self.strategy.n_modes,
                region=region,
                first_frames=science_n,
                second_frames=reference_n,
            )
        reduced = reduce_stack(
            science_e,
            reference_e,
            region=region,
            n_modes=self.strategy.n_modes,
            exposure_s=self.task.exposure_s,
            em_gain=self.task.em_gain,
            detector=self.science.instrument.detector,
            science_frames=science_n,
            reference_frames=reference_n,
            reference_scale=self.scale,
            noise_free_reference=self.plan.noise_free,
            smear_e=(self._smear_e(self.science), self._smear_e(self.reference)),
        )
        return Realised(reduced, roll, science_e.sum(axis=0), reference_e.sum(axis=0))

    @staticmethod
    def _smear_e(seen: Observation) -> FloatArray:
        rows, columns, _ = seen.area.stamp(len(seen.psf.on_axis))
        return seen.smear_e[rows, columns]


def visits_of(
    task: ConfirmTask, *, full: bool = False, realisation: int = 0, modelling: Modelling | None = None
) -> Visits:
    """Set up the visits of a task.

    Parameters
    ----------
    task : ConfirmTask
    full : bool
        Every effect of the camera, to be run frame by frame (`realised_frames`), whatever the modelling says.
    realisation : int
        Of the frames.
    modelling : Modelling, optional
        How the images are made; what `modelling_of` the task says by default.
    """
    how = modelling_of(task) if modelling is None else modelling
    how = how.whole() if full else how
    strategy = validate(Strategy, task.strategy, where="strategy")
    scene = how.scene(validate(Scene, task.scene, where="scene"))
    chosen = how.instrument(validate(Instrument, task.simulator, where="instrument"))
    plan = library_plan(strategy, scene, task.n_frames)
    sums = how.draw == "sums"
    settings: dict[str, Any] = {
        "band": task.band,
        "exposure_s": task.exposure_s,
        "em_gain": task.em_gain,
        "seed": task.seed,
        "fidelity": how.knobs,
        "instrument": chosen,
        "window": "hole" if sums else how.region,
        "realisation": realisation,
        "max_epochs": 1 if sums else how.epochs,  # the sums draw their own drift
    }
    shown = (plan.science_scene, plan.science), (plan.reference_scene, plan.reference)
    science, reference = (observe(what, **settings, **visit) for what, visit in shown)
    answer = hole_stackable(science)
    if answer.status.value == "ok":
        answer = hole_stackable(reference)
    stacks = None
    if sums and answer.status.value == "ok":
        stacks = hole_stacks(science, epochs=how.epochs), hole_stacks(reference, epochs=how.epochs)
    scale = science.truth.sources[0].rate_e_s / reference.truth.sources[0].rate_e_s
    return Visits(task, how, strategy, chosen, plan, science, reference, scale, answer, stacks)


def realised_frames(visits: Visits) -> tuple[Realised, FrameStory]:
    """Draw every frame, calibrate it, take out particles, and reduce.

    Notes
    -----
    Pixel-frames that are hit or cut off take the temporal mean of their pixel, so that each frame is whole for the
    projection; pixels with no usable frame leave the region. The white variance grows by the frames that a pixel lost.
    """
    region = visits.geometry.hole.copy()
    kept, stories = [], []
    for observation in (visits.science, visits.reference):
        frames = calibrated_frames(observation, cropped=observation.window == "full")
        electrons, usable, hits = cleaned(frames)
        whole, covered = filled(electrons, usable)
        region &= covered
        stories.append((frames, usable, hits))
        # The pedestal goes back in: `reduce_stack` knows dark current and clock charge by their nominal values.
        kept.append(whole + pedestal_e(observation.instrument.detector, observation.exposure_s))
    hole = visits.geometry.hole
    realised = visits.reduced(kept[0], kept[1], 1, 1, region)
    thinned = _thinned(realised, [usable for _, usable, _ in stories])
    rejected = [1.0 - usable[:, hole].mean() for _, usable, _ in stories]
    return thinned, FrameStory(
        lost_in=sum(_by_light(frames, hole) for frames, _, _ in stories),
        lost_outside=sum(frames.lost_outside for frames, _, _ in stories),
        rejected_fraction=float(np.mean(rejected)),
        hits=sum(hits for _, _, hits in stories),
    )


def _by_light(frames: CalibratedFrames, hole: BoolArray) -> int:
    lost = frames.n_lost[hole]
    most = min(max(MOST_LOST * frames.n_frames, 1.0), frames.n_frames - 0.5)
    return int(lost[lost > most].sum())


def cleaned(frames: CalibratedFrames) -> tuple[FloatArray, BoolArray, int]:
    """Return frames in electrons, the pixel-frames that no particle voids either, and how many were hit."""
    detector = frames.detector
    found = reject_cosmic_rays(
        frames.electrons,
        frames.usable,
        em_gain=frames.em_gain,
        read_noise_e=detector.read_noise_e * detector.switches.read_noise,
        pedestal_e=frames.pedestal_e,
        stages=detector.register_stages,
        gain_e_adu=detector.gain_e_adu,
    )
    return frames.electrons, frames.usable & ~found.rejected, found.n_hit


def _thinned(realised: Realised, usable: list[BoolArray]) -> Realised:
    """Variance per pixel of a sum whose pixels were measured in fewer frames."""
    counts = [np.maximum(part.sum(axis=0), 1) / len(part) for part in usable]
    factor = 0.5 * (1.0 / counts[0] + 1.0 / counts[1])
    stack = realised.reduced
    variance = np.where(stack.region, stack.white_variance_e2 * factor, 0.0)
    return dataclasses.replace(realised, reduced=dataclasses.replace(stack, white_variance_e2=variance))
