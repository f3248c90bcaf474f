"""Realisations of a programme: its science and reference visits, drawn as sums of frames or frame by frame."""

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from cpic_core import BoolArray, FloatArray, Outcome, Status
from cpic_planner.queries import Strategy
from cpic_planner.validation.frames import MOST_LOST, CalibratedFrames, calibrated_frames
from cpic_planner.validation.libraries import LibraryPlan, VisitSettings, library_plan
from cpic_planner.validation.modelling import Modelling, modelling_of
from cpic_planner.validation.reduced import ReducedStack, pedestal_e, reduce_stack
from cpic_planner.validation.rejection import filled, rejected_in
from cpic_planner.validation.roll import RollResult, roll_subtract
from cpic_planner.validation.task import ConfirmTask
from simulator.config import Drift, Instrument, Scene, validate
from simulator.imaging import BandGeometry, Psf
from simulator.observing import HoleStacks, Observation, Role, hole_stackable, hole_stacks, observe

_VARIANCE_ERROR = 0.02
"""Of a visit's mean wavefront, by the epochs at which its walk is drawn."""
_LEAST_SWINGING = 2
"""Epochs of a visit in which the orbit moves the wavefront."""


@dataclass(frozen=True, eq=False)
class Realisation:
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
class FrameStatistics:
    """The losses of single frames.

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

    @classmethod
    def of(cls, parts: "Sequence[FrameStatistics]") -> "FrameStatistics":
        """Return the same of several sequences of frames together."""
        return cls(
            lost_in=sum(part.lost_in for part in parts),
            lost_outside=sum(part.lost_outside for part in parts),
            rejected_fraction=float(np.mean([part.rejected_fraction for part in parts])),
            hits=sum(part.hits for part in parts),
        )


@dataclass(frozen=True, eq=False)
class VisitPair:
    """Science and reference visits of a task, ready to be drawn any number of times; made by `visit_pair`.

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
        The first visit of each; the others differ by their wavefront and noise.
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
    _seen: Callable[[Role, int], Observation]

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

    def visit(self, role: Role, number: int) -> Observation:
        """Return a visit of the programme, to be run frame by frame."""
        return self._seen(role, number)

    def with_light(self, extra_e_s: FloatArray) -> "VisitPair":
        """Return the same with more light in the science visit (an injected planet), electrons per second and pixel."""
        assert self._stacks is not None  # as stackable says
        science, reference = self._stacks
        return dataclasses.replace(self, _stacks=(science.with_light(extra_e_s), reference))

    def draw(self, realisation: int) -> Realisation:
        """Return one realisation from sums of frames; only where ``stackable`` is ok."""
        assert self._stacks is not None  # as stackable says
        science, reference = self._stacks
        images = science.draw(realisation, visits=self.plan.visits)
        # The search learns from how science visits scatter; of references without modes only the mean counts. Rolls are
        # each other's references.
        visits = self.plan.reference_visits
        summed = self.strategy.n_modes == 0 and not self.plan.shows_planet
        frames = reference.counts(visits, summed=summed)
        if self.plan.noise_free:
            dark_e = pedestal_e(self.science.instrument.detector, self.task.exposure_s)
            rates = reference.mean_rates(realisation, visits=visits, summed=summed)
            library = (rates * self.task.exposure_s + dark_e) * frames[:, None, None]
            library[:, ~reference.region] = 0.0
        else:
            library = reference.draw(realisation, visits=visits, summed=summed)
        return self.reduced(images, library, science.counts(self.plan.visits), frames, science.region)

    def reduced(
        self, science_e: FloatArray, reference_e: FloatArray, science_n: Any, reference_n: Any, region: BoolArray
    ) -> Realisation:
        """Reduce images of both visits, each of so many frames."""
        n_modes = self.strategy.n_modes
        roll = None
        if self.plan.shows_planet:
            roll = roll_subtract(
                science_e,
                reference_e,
                n_modes,
                region=region,
                first_frames=science_n,
                second_frames=reference_n,
            )
        reduced = reduce_stack(
            science_e,
            reference_e,
            region=region,
            n_modes=n_modes,
            exposure_s=self.task.exposure_s,
            em_gain=self.task.em_gain,
            detector=self.science.instrument.detector,
            science_frames=science_n,
            reference_frames=reference_n,
            reference_scale=self.scale,
            noise_free_reference=self.plan.noise_free,
            smear_e=(self._smear_e(self.science), self._smear_e(self.reference)),
        )
        return Realisation(reduced, roll, science_e.sum(axis=0), reference_e.sum(axis=0))

    @staticmethod
    def _smear_e(seen: Observation) -> FloatArray:
        rows, columns, _ = seen.area.stamp(len(seen.psf.on_axis))
        return seen.smear_e[rows, columns]


def visit_pair(
    task: ConfirmTask, *, full: bool = False, realisation: int = 0, modelling: Modelling | None = None
) -> VisitPair:
    """Set up the visits of a task.

    Parameters
    ----------
    task : ConfirmTask
    full : bool
        Every effect of the camera, to be run frame by frame (`realise_frames`), whatever the modelling says.
    realisation : int
        Of the frames.
    modelling : Modelling, optional
        How the images are made; what `modelling_of` the task says by default.
    """
    how = modelling or modelling_of(task)
    how = how.whole() if full else how
    strategy = validate(Strategy, task.strategy, where="strategy")
    scene = how.scene(validate(Scene, task.scene, where="scene"))
    chosen = how.instrument(validate(Instrument, task.simulator, where="instrument"))
    plan = library_plan(strategy, scene, task.n_frames, visits=task.visits)
    sums = how.draw == "sums"

    def seen(shown: Scene, visit: VisitSettings, number: int = 0) -> Observation:
        return observe(
            shown,
            band=task.band,
            exposure_s=task.exposure_s,
            em_gain=task.em_gain,
            seed=task.seed,
            fidelity=how.knobs,
            instrument=chosen,
            realisation=realisation,
            visit=number,
            timing=task.timing,
            window="hole" if sums else how.region,
            max_epochs=1 if sums else how.epochs,  # sums draw their own drift
            **visit,
        )

    science = seen(plan.science_scene, plan.science)
    reference = seen(plan.reference_scene, plan.reference)

    def later(role: Role, number: int) -> Observation:
        if number == 0:
            return science if role == "science" else reference
        shown = (plan.science_scene, plan.science) if role == "science" else (plan.reference_scene, plan.reference)
        return seen(*shown, number)

    stacks = None
    answer = hole_stackable(science)
    if answer.status is Status.OK:
        answer = hole_stackable(reference)
    if sums and answer.status is Status.OK:
        epochs = _epochs(task, how, chosen.drift)
        drawn = functools.partial(hole_stacks, epochs=epochs, exact=how.exact)
        stacks = drawn(science), drawn(reference)
    scale = science.truth.sources[0].rate_e_s / reference.truth.sources[0].rate_e_s
    return VisitPair(
        task=task,
        modelling=how,
        strategy=strategy,
        instrument=chosen,
        plan=plan,
        science=science,
        reference=reference,
        scale=scale,
        stackable=answer,
        _stacks=stacks,
        _seen=later,
    )


def _epochs(task: ConfirmTask, how: Modelling, drift: Drift) -> int:
    """Return the draws of a visit of a programme: no more than tell its mean wavefront.

    The middles of E equal parts have a mean of the walk whose variance is too large by ``1 / (2 E^2)`` of it.
    """
    if task.visits == 1:
        return how.epochs
    walk_nm2 = drift.walk_nm_per_sqrt_hour**2 * task.n_frames * task.exposure_s / (3.0 * 3600.0)
    whole_nm2 = drift.visit_nm**2 + walk_nm2
    needed = math.ceil(math.sqrt(walk_nm2 / whole_nm2 / (2.0 * _VARIANCE_ERROR))) if walk_nm2 > 0 else 1
    swings = 1 if drift.orbital_nm == 0 else _LEAST_SWINGING
    return min(how.epochs, max(needed, swings))


def realise_frames(visits: VisitPair) -> tuple[Realisation, FrameStatistics]:
    """Draw every frame, calibrate it, take out particles, and reduce.

    Notes
    -----
    Pixel-frames that are hit or cut off take the temporal mean of their pixel, so that each frame is whole for the
    projection; pixels with no usable frame leave the region. The white variance grows by the frames that a pixel lost.
    """
    hole = visits.geometry.hole
    region = hole.copy()
    kept: list[FloatArray] = []
    counts: list[int] = []
    parts: list[FrameStatistics] = []
    thinning: list[FloatArray] = []
    roles: tuple[tuple[Role, int], ...] = ("science", visits.plan.visits), ("reference", visits.plan.reference_visits)
    for role, number in roles:
        images, thinned = [], []
        for visit in range(number):
            observation = visits.visit(role, visit)
            frames = calibrated_frames(observation, cropped=observation.window == "full")
            electrons, usable, hits = cleaned(frames)
            whole, covered = filled(electrons, usable)
            region &= covered
            rejected = float(1.0 - usable[:, hole].mean())
            parts.append(FrameStatistics(_by_light(frames, hole), frames.lost_outside, rejected, hits))
            # Variance per pixel of a sum whose pixels were measured in fewer frames.
            thinned.append(1.0 / (np.maximum(usable.sum(axis=0), 1) / len(usable)))
            # The pedestal goes back in: `reduce_stack` knows dark current and clock charge by their nominal values.
            whole = whole + pedestal_e(observation.instrument.detector, observation.exposure_s)
            images.append(whole if number == 1 else whole.sum(axis=0, keepdims=True))
        thinning.append(np.mean(thinned, axis=0))
        kept.append(np.concatenate(images))
        counts.append(1 if number == 1 else observation.n_frames)
    realisation = visits.reduced(kept[0], kept[1], counts[0], counts[1], region)
    stack = realisation.reduced
    variance = np.where(stack.region, stack.white_variance_e2 * (0.5 * (thinning[0] + thinning[1])), 0.0)
    less = dataclasses.replace(stack, white_variance_e2=variance)
    return dataclasses.replace(realisation, reduced=less), FrameStatistics.of(parts)


def _by_light(frames: CalibratedFrames, hole: BoolArray) -> int:
    lost = frames.n_lost[hole]
    most = min(max(MOST_LOST * frames.n_frames, 1.0), frames.n_frames - 0.5)
    return int(lost[lost > most].sum())


def cleaned(frames: CalibratedFrames) -> tuple[FloatArray, BoolArray, int]:
    """Return frames in electrons, the pixel-frames that no particle voids either, and how many were hit."""
    found = rejected_in(frames, frames.detector.read_noise_e * frames.detector.switches.read_noise)
    return frames.electrons, frames.usable & ~found.rejected, found.n_hit
