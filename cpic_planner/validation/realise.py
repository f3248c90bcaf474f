"""Realisations of a programme: science and reference visits, drawn as sums of frames, frame by frame, or audited.

What the references show is an entry of `cpic_planner.queries.shared.LIBRARIES`.

A sum of frames lacks what only single frames show: particles and their rejection, charge left behind in transfers,
curves, levels of the bias. An audit runs a fraction of the frames with every effect of the camera, and carries what it
finds to all of them. Each frame that is run has a plain twin: the same light, the same random numbers and the same
pixels, without these effects. Their difference is free of nearly all noise, so that few frames tell what the effects do
to the mean. The image of the audit is a realisation of the whole programme from sums, with this difference added to
every frame.
"""

import dataclasses
import functools
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple, cast

import numpy as np

from cpic_core import BoolArray, FloatArray, InputError, IntArray, NDArray, Outcome, Reason, Record, Status, stream
from cpic_planner.etc import MAX_MEAN_E, CountingLaw, FrameCamera, counting_probabilities
from cpic_planner.queries import Strategy
from cpic_planner.validation.frames import MOST_LOST, CalibratedFrames, calibrated_frames, filled, rejected_in
from cpic_planner.validation.photometry import radius_pixel
from cpic_planner.validation.rdi import ReducedStack, RollResult, pedestal_e, reduce_stack, roll_subtract, smoothed
from cpic_planner.validation.task import (
    LIMITS,
    ConfirmTask,
    LibraryPlan,
    Modelling,
    VisitSettings,
    library_plan,
    modelling_of,
)
from simulator.camera import FrameNoise
from simulator.config import Drift, Instrument, Scene, validate
from simulator.detectors import rows_of
from simulator.imaging import BandGeometry, Psf, TablePsf
from simulator.observing import HoleStacks, Observation, Role, hole_stackable, hole_stacks, observe
from simulator.reduction import grown

ROLES: tuple[Role, Role] = ("science", "reference")
_VARIANCE_ERROR = 0.02
"""Of a visit's mean wavefront, by the epochs at which its walk is drawn."""
_LEAST_SWINGING = 2
"""Epochs of a visit in which the orbit moves the wavefront."""


class Realisation(Record, eq=False):
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


class FrameStatistics(Record):
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
    frames_run : int
        Frames that were run.
    """

    lost_in: int
    lost_outside: int
    rejected_fraction: float
    hits: int
    frames_run: int

    @classmethod
    def of(cls, parts: "Sequence[FrameStatistics]") -> "FrameStatistics":
        """Return the same of several sequences of frames together."""
        return cls(
            lost_in=sum(part.lost_in for part in parts),
            lost_outside=sum(part.lost_outside for part in parts),
            rejected_fraction=float(np.mean([part.rejected_fraction for part in parts])),
            hits=sum(part.hits for part in parts),
            frames_run=sum(part.frames_run for part in parts),
        )


class VisitPair(Record, eq=False):
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

    @property
    def geometry(self) -> BandGeometry:
        """Hole and apertures on the stamp."""
        return self.optics.geometry

    @property
    def optics(self) -> Psf:
        """The optics themselves."""
        return cast(Psf, self.science.psf)  # or one of a table, which has the same images

    @property
    def still(self) -> bool:
        """True if all science visits have the same residual, as a table may say: they are worth one."""
        psf = self.science.psf
        stable = psf.figures.stability(np.zeros(1)) if isinstance(psf, TablePsf) else None
        return stable is not None and stable[1]

    @property
    def scene(self) -> Scene:
        """What the science frames show."""
        return self.science.scene

    @functools.cached_property
    def known_light_e_s(self) -> FloatArray:
        """Light on the stamp that does not change, e-/s in each pixel: other stars, dust and sky, not the planets."""
        rows, columns, _ = self.science.area.stamp(len(self.geometry.hole))
        light = self.science.light.static_e_s[rows, columns].copy()
        for one in self.science.truth.sources[1:]:
            if one.kind == "planet":
                light -= one.rate_e_s * self.optics.at(one.x_arcsec, one.y_arcsec)
        return light

    @property
    def beside_arcsec(self) -> list[tuple[float, float]]:
        """Places of the sources beside the star, offsets x and y on the detector."""
        return [(one.x_arcsec, one.y_arcsec) for one in self.science.truth.sources[1:]]

    def visit(self, role: Role, number: int) -> Observation:
        """Return a visit of the programme, to be run frame by frame."""
        first = self.science if role == "science" else self.reference
        return first.at_visit(number) if number else first

    def with_light(self, extra_e_s: FloatArray) -> "VisitPair":
        """Return the same with more light in the science visit (an injected planet), electrons per second and pixel."""
        assert self._stacks is not None  # as stackable says
        science, reference = self._stacks
        return dataclasses.replace(self, _stacks=(science.with_light(extra_e_s), reference))

    def draw(self, realisation: int) -> Realisation:
        """Return one realisation from sums of frames; only where ``stackable`` is ok."""
        science, reference = (self.drawn(role, realisation) for role in ROLES)
        return self.reduced(science[0], reference[0], science[1], reference[1], self._region)

    def drawn(self, role: Role, realisation: int) -> tuple[FloatArray, NDArray[np.int64]]:
        """Return the images of one role, sums of frames in electrons, and how many frames each is the sum of.

        Parameters
        ----------
        role : {"science", "reference"}
        realisation : int
            As of `draw`.
        """
        stacks, visits, summed = self._drawing(role)
        counts = stacks.counts(visits, summed=summed)
        if self.plan.noise_free and role == "reference":
            return self.expected(role, realisation), counts
        if self.counting is not None:
            return self._counted(role, realisation, counts, self.counting), counts
        return stacks.draw(realisation, visits=visits, summed=summed), counts

    def _counted(self, role: Role, realisation: int, counts: IntArray, law: CountingLaw) -> FloatArray:
        """Return the electrons that counts of photons tell: frames above the threshold are a binomial number."""
        each, smear_e = counts[:, None, None], self.smear_e(role)
        mean_e = self._held(role, realisation)
        path = "counted", self.task.name, self.task.band, role, realisation
        share = stream(self.task.seed, *path).binomial(each, law.q(np.minimum(mean_e, MAX_MEAN_E))) / each
        about = smoothed(np.average(share, axis=0, weights=counts), self._region)
        return np.where(self.geometry.hole, (law.electrons(share, about) - smear_e) * each, 0.0)

    def _held(self, role: Role, realisation: int) -> FloatArray:
        """Return the mean electrons of a frame of each image, smear included."""
        stacks, visits, summed = self._drawing(role)
        counts = stacks.counts(visits, summed=summed)[:, None, None]
        return np.asarray(self.expected(role, realisation) / counts + self.smear_e(role))

    @functools.cached_property
    def _region(self) -> BoolArray:
        """Pixels that take part in sums of frames: the dark hole, as far as photons can be told apart there."""
        hole = self._drawing("science")[0].region
        if self.counting is None:
            return hole
        told = [self.counting.usable(self._held(role, 0)).all(axis=0) for role in ROLES]
        return np.asarray(hole & told[0] & told[1])

    @functools.cached_property
    def counting(self) -> CountingLaw | None:
        """Law of counts of photons; None where charge is measured."""
        if self.strategy.mode == "analogue":
            return None
        camera = FrameCamera.of(self.instrument, self.task.band)
        return counting_probabilities(camera, self.task.em_gain, self.strategy)

    def expected(self, role: Role, realisation: int) -> FloatArray:
        """Return the means of the same images for the same wavefronts."""
        stacks, visits, summed = self._drawing(role)
        dark_e = pedestal_e(self.science.channel.detector, self.task.exposure_s)
        electrons = stacks.mean_rates(realisation, visits=visits, summed=summed) * self.task.exposure_s + dark_e
        return np.where(stacks.region, electrons * stacks.counts(visits, summed=summed)[:, None, None], 0.0)

    def _drawing(self, role: Role) -> tuple[HoleStacks, int, bool]:
        """Return the sums of a role, its visits, and whether they are one draw."""
        assert self._stacks is not None  # as stackable says
        if role == "science":  # the search learns from how its visits scatter
            return self._stacks[0], self.plan.visits, self.still
        # Without modes most reductions need no more than the sum of all references. Rolls are each other's references.
        one_by_one = self.strategy.n_modes > 0 or self.plan.shows_planet or self.strategy.reduction.needs_images
        return self._stacks[1], self.plan.reference_visits, not one_by_one

    def reduced(
        self, science_e: FloatArray, reference_e: FloatArray, science_n: Any, reference_n: Any, region: BoolArray
    ) -> Realisation:
        """Reduce images of both visits, each of so many frames."""
        n_modes, centering = self.strategy.n_modes, self.strategy.centring
        roll = None
        if self.plan.shows_planet:
            roll = roll_subtract(
                science_e,
                reference_e,
                n_modes,
                region=region,
                centering=centering,
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
            detector=self.science.channel.detector,
            science_frames=science_n,
            reference_frames=reference_n,
            reference_scale=self.scale,
            noise_free_reference=self.plan.noise_free,
            smear_e=(self.smear_e("science"), self.smear_e("reference")),
            counting=self.counting,
            centering=centering,
        )
        return Realisation(reduced, roll, science_e.sum(axis=0), reference_e.sum(axis=0))

    def smear_e(self, role: Role) -> FloatArray:
        """Return the mean electrons that smear into each pixel of a frame."""
        seen = self.science if role == "science" else self.reference
        rows, columns, _ = seen.area.stamp(len(seen.psf.on_axis))
        return seen.smear_e[rows, columns]


def visit_pair(task: ConfirmTask, *, realisation: int = 0, modelling: Modelling | None = None) -> VisitPair:
    """Set up the visits of a task.

    Parameters
    ----------
    task : ConfirmTask
    realisation : int
        Of the frames.
    modelling : Modelling, optional
        How the images are made; what `modelling_of` the task says by default.
    """
    how = modelling or modelling_of(task)
    strategy = validate(Strategy, task.strategy, where="strategy")
    scene = how.kept_sources(validate(Scene, task.scene, where="scene"))
    chosen = how.instrument(validate(Instrument, task.simulator, where="instrument"))
    plan = library_plan(strategy, scene, task.n_frames, visits=task.visits, roll_deg=task.roll_deg)
    sums = how.draw == "sums"

    def seen(shown: Scene, visit: VisitSettings) -> Observation:
        return observe(
            shown,
            band=task.band,
            exposure_s=task.exposure_s,
            em_gain=task.em_gain,
            seed=task.seed,
            fidelity=how.knobs,
            instrument=chosen,
            realisation=realisation,
            timing=task.timing,
            window="hole" if sums else how.region,
            scene_model=how.scene_model,
            max_epochs=1 if sums else how.epochs,  # sums draw their own drift
            **visit,
        )

    science = seen(plan.science_scene, plan.science)
    reference = seen(plan.reference_scene, plan.reference)

    stacks = None
    answer: Outcome[float] = Outcome.refuse(Status.INVALID, Reason.NOT_ADDITIVE, "frames are drawn one by one")
    if sums:
        answer = hole_stackable(science)
        if answer.status is Status.OK:
            answer = hole_stackable(reference)
    if strategy.mode != "analogue" and answer.status is not Status.OK:
        hint = f"photons are counted in sums of frames alone: {answer.message}"
        raise InputError("strategy.mode", strategy.mode, allowed="analogue", hint=hint)
    if answer.status is Status.OK:
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


def realisations(
    task: ConfirmTask, modelling: Modelling, numbers: Iterable[int], sums: VisitPair | None
) -> Iterator[tuple[VisitPair, Realisation, FrameStatistics | None]]:
    """Yield realisations from sums of frames; without them frame by frame, one in memory at a time."""
    for number in numbers:
        if sums is not None:
            yield sums, sums.draw(number), None
        else:
            visits = visit_pair(task, realisation=number, modelling=modelling)
            yield visits, *realise_frames(visits)


class WholeFrames(NamedTuple):
    """The frames of one visit, ready to be reduced.

    Attributes
    ----------
    electrons : ndarray, shape (n_frames, n, n)
        Frames without holes (`cpic_planner.validation.frames.filled`).
    usable : ndarray of bool, same shape
    statistics : FrameStatistics
    """

    electrons: FloatArray
    usable: BoolArray
    statistics: FrameStatistics


def realise_frames(visits: VisitPair) -> tuple[Realisation, FrameStatistics]:
    """Draw every frame, calibrate it, take out particles, and reduce."""

    def drawn(role: Role, number: int) -> Iterator[WholeFrames]:
        return (frames_of(visits.visit(role, visit), visits.geometry.hole)[1] for visit in range(number))

    return reduced_frames(
        visits, drawn("science", visits.plan.visits), drawn("reference", visits.plan.reference_visits)
    )


def reduced_frames(
    visits: VisitPair, science: Iterable[WholeFrames], reference: Iterable[WholeFrames]
) -> tuple[Realisation, FrameStatistics]:
    """Reduce the frames of a programme.

    Parameters
    ----------
    visits : VisitPair
    science, reference : iterable of WholeFrames
        One a visit, in their order.

    Notes
    -----
    Pixel-frames that are hit or cut off take the temporal mean of their pixel, so that each frame is whole for the
    projection; pixels with no usable frame leave the region. The white variance grows by the frames that a pixel lost.
    """
    region = visits.geometry.hole.copy()
    kept: list[FloatArray] = []
    counts: list[list[int]] = []
    parts: list[FrameStatistics] = []
    thinning: list[FloatArray] = []
    # The pedestal goes back in: `reduce_stack` knows dark current and clock charge by their nominal values.
    pedestal = pedestal_e(visits.science.channel.detector, visits.task.exposure_s)
    for frames, number in ((science, visits.plan.visits), (reference, visits.plan.reference_visits)):
        images, lost, numbers = [], [], []
        for electrons, usable, story in frames:
            region &= usable.any(axis=0)
            parts.append(story)
            lost.append(len(usable) / np.maximum(usable.sum(axis=0), 1))
            whole = electrons + pedestal
            images.append(whole if number == 1 else whole.sum(axis=0, keepdims=True))
            numbers += [1] * len(whole) if number == 1 else [len(whole)]
        thinning.append(np.mean(lost, axis=0))
        kept.append(np.concatenate(images))
        counts.append(numbers)
    realisation = visits.reduced(kept[0], kept[1], counts[0], counts[1], region)
    return thinned(realisation, thinning[0], thinning[1]), FrameStatistics.of(parts)


def frames_of(
    observation: Observation, hole: BoolArray, numbers: Sequence[int] | None = None
) -> tuple[CalibratedFrames, WholeFrames]:
    """Draw frames of a visit, calibrate them and take out particles.

    Parameters
    ----------
    observation : Observation
    hole : ndarray of bool, shape (n, n)
    numbers : sequence of int, optional
        Numbers of the frames; all of them by default.
    """
    frames = calibrated_frames(observation, cropped=observation.window == "full", numbers=numbers)
    return frames, whole_frames(frames, hole)


def whole_frames(frames: CalibratedFrames, hole: BoolArray) -> WholeFrames:
    """Take particles out of calibrated frames, and fill the holes that are left.

    Parameters
    ----------
    frames : CalibratedFrames
    hole : ndarray of bool, shape (n, n)
    """
    electrons, usable, hits = cleaned(frames)
    rejected = float(1.0 - usable[:, hole].mean())
    story = FrameStatistics(_by_light(frames, hole), frames.lost_outside, rejected, hits, frames.n_frames)
    return WholeFrames(filled(electrons, usable)[0], usable, story)


def thinned(realisation: Realisation, science: FloatArray, reference: FloatArray) -> Realisation:
    """Return a realisation whose pixels were measured in fewer frames: their white variance grows by these factors."""
    stack = realisation.reduced
    variance = np.where(stack.region, stack.white_variance_e2 * (0.5 * (science + reference)), 0.0)
    return dataclasses.replace(realisation, reduced=dataclasses.replace(stack, white_variance_e2=variance))


def _by_light(frames: CalibratedFrames, hole: BoolArray) -> int:
    lost = frames.n_lost[hole]
    most = min(max(MOST_LOST * frames.n_frames, 1.0), frames.n_frames - 0.5)
    return int(lost[lost > most].sum())


def cleaned(frames: CalibratedFrames) -> tuple[FloatArray, BoolArray, int]:
    """Return frames in electrons, the pixel-frames that no particle voids either, and how many were hit."""
    found = rejected_in(frames)
    return frames.electrons, frames.usable & ~found.rejected, found.n_hit


REALISATION = 1_000_000
"""Number of the realisation that is audited: far from those of the sums."""
MOST_SHARE = 0.5
"""Largest part of the variance of the whole programme that may come from the frames that stand for the others."""
_SEQUENCE_FRAMES = 24  # a pixel is compared with itself in as many: more tell its level no better than its drift
_LEAST_SEQUENCES = 2
_EPOCHS = 3  # the drift within a visit matters to the rejection alone: frame and twin share it
_REACH_PIXELS = 4  # from a track: its charge, three pixels of what transfers leave behind, and the neighbour of that


class FrameEffects(Record, eq=False):
    """The change that effects of single frames make in the images of one role; made by `frame_effects`.

    Attributes
    ----------
    change_e : ndarray, shape (n, n)
        Mean change of a calibrated frame.
    variance : ndarray, shape (n, n)
        Variance of a frame over that of a frame of sums: flawed pixels, frames that are left out, hits that stay.
    common : ndarray, shape (n, n)
        The part of it that is not in ``change_e`` already, times the frames of the programme.
    thinning : ndarray, shape (n, n)
        Variance per pixel over that of as many whole frames.
    covered : ndarray of bool, shape (n, n)
        Pixels with a usable frame.
    statistics : FrameStatistics
        Of the frames that were run.
    """

    change_e: FloatArray
    variance: FloatArray
    common: FloatArray
    thinning: FloatArray
    covered: BoolArray
    statistics: FrameStatistics

    def on(self, drawn_e: FloatArray, expected_e: FloatArray, counts: IntArray) -> FloatArray:
        """Return images of visits with the effects.

        Parameters
        ----------
        drawn_e, expected_e : ndarray, shape (k, n, n)
            Sums of frames, and their means.
        counts : ndarray of int, shape (k,)
            Number of frames in each.

        Notes
        -----
        ``change_e`` is the same in all visits, and with it its noise. The noise that the visits have in common is
        lowered by as much; that by which they differ is that of their frames, from which a search learns.
        """
        frames = counts[:, None, None]
        noise = drawn_e - expected_e
        common = noise.sum(axis=0) * (frames / counts.sum())
        apart = np.sqrt(self.variance) * (noise - common)
        return np.asarray(expected_e + apart + np.sqrt(self.common) * common + frames * self.change_e)


def audited(task: ConfirmTask, modelling: Modelling, sums: VisitPair) -> tuple[Realisation, FrameStatistics]:
    """Return one realisation with every effect of the camera, and what happened to the frames that were run.

    Parameters
    ----------
    task : ConfirmTask
    modelling : Modelling
    sums : VisitPair
        The visits of the task, drawn as sums.
    """
    how = dataclasses.replace(modelling.whole(), epochs=_EPOCHS)
    full = visit_pair(task, realisation=REALISATION, modelling=how)
    science = frame_effects(full, "science", full.plan.visits)
    reference = frame_effects(full, "reference", full.plan.reference_visits)
    images, counts = [], []
    for role, effects in zip(ROLES, (science, reference), strict=True):
        drawn, numbers = sums.drawn(role, REALISATION)
        images.append(effects.on(drawn, sums.expected(role, REALISATION), numbers))
        counts.append(numbers)
    region = sums.geometry.hole & science.covered & reference.covered
    realisation = sums.reduced(images[0], images[1], counts[0], counts[1], region)
    story = FrameStatistics.of([science.statistics, reference.statistics])
    return thinned(realisation, science.thinning, reference.thinning), story


def frame_effects(visits: VisitPair, role: Role, n_visits: int) -> FrameEffects:
    """Run frames of one role until they tell what the effects of single frames do to all of them.

    Parameters
    ----------
    visits : VisitPair
        With every effect of the camera.
    role : {"science", "reference"}
    n_visits : int
        Visits of this role.

    Notes
    -----
    What does not average out (charge that is left behind, curves, remains of particles) changes every frame alike:
    ``N`` frames of a programme have ``N`` times the mean change of a frame. Of ``n`` frames this mean has the
    variance ``d / n``, with ``d`` that of the difference between a frame and its twin, 4 to 9 % of the variance ``v``
    of a frame. In the image it is ``N^2 d / n``, of ``N v`` the share ``(d / v) (N / n)``. Sequences are run, at
    least two and no more than there are, until this share is at most `MOST_SHARE`: one frame in six or so, more where
    particles are many. The noise from sums is lowered by the same share, so that the image has the noise of the whole
    programme, and beside it a change of the mean shows as much as if every frame had been run.

    Variances are those of steps between squares as large as an aperture: charge that moves by a pixel stays in one, and
    an even level in both. Frames that a particle hit are left out of the difference as of the mean. Where a frame is
    left out and no particle was near, its own light did it: the loss is part of the change.
    """
    hole = visits.geometry.hole
    side = max(round(math.sqrt(math.pi) * radius_pixel(visits.geometry)), 1)
    length = visits.visit(role, 0).n_frames
    changes, thinning, parts, moved, plain = [], [], [], [], []
    covered = hole.copy()
    for visit, numbers in sequences(n_visits, length):
        observation = visits.visit(role, visit)
        frames, (whole, usable, story) = frames_of(observation, hole, numbers)
        twin = calibrated_frames(without_frame_effects(observation), numbers=numbers).electrons
        counted = usable | ~grown(frames.struck, _REACH_PIXELS)
        covered &= usable.any(axis=0)
        change = np.where(counted & covered, whole - twin, 0.0)
        changes.append(change.sum(axis=0) / np.maximum(counted.sum(axis=0), 1))
        thinning.append(len(usable) / np.maximum(usable.sum(axis=0), 1))
        parts.append(story)
        light = np.stack([observation.rate_map(number) for number in numbers]) * observation.exposure_s
        moved.append(_steps(change, covered, side))
        plain.append(_steps(twin - light, covered, side))
        difference, own = np.concatenate(moved), np.concatenate(plain)
        share, ratio = _ratios(difference, own)
        share *= n_visits * length / len(own)
        if len(parts) >= _LEAST_SEQUENCES and share <= MOST_SHARE:
            break
    noise, expected = FrameNoise.of(frames.detector, frames.em_gain, frames.exposure_s), light.mean(axis=0)
    law = frames.variance_e2(expected) / noise.charge_variance_e2(expected + noise.pedestal_e + visits.smear_e(role))
    thin = np.mean(thinning, axis=0)
    return FrameEffects(
        change_e=np.mean(changes, axis=0),
        variance=law * thin * ratio,
        common=law * thin * max(ratio - share, 0.0),
        thinning=thin,
        covered=covered,
        statistics=FrameStatistics.of(parts),
    )


def sequences(n_visits: int, length: int) -> Iterator[tuple[int, range]]:
    """Yield visits with numbers of frames, each a sequence of at most 24 over the whole visit; all of them in the end.

    Parameters
    ----------
    n_visits : int
    length : int
        Frames of a visit.
    """
    step = -(-length // _SEQUENCE_FRAMES)
    for first in range(step):
        for visit in range(n_visits):
            yield visit, range(first, length, step)


def without_frame_effects(observation: Observation) -> Observation:
    """Return an observation of the same light and pixels without the effects that sums of frames cannot have."""
    detector = observation.channel.detector
    effects = (effect for effect in rows_of(detector.chain) if effect.stage != "light")
    off = (effect.switch for effect in effects if effect.in_sums not in ("added", "per_electron"))
    instrument = observation.instrument.switched(dict.fromkeys((*off, *LIMITS), False))
    return dataclasses.replace(observation, instrument=instrument)


def _steps(frames: FloatArray, covered: BoolArray, side: int) -> FloatArray:
    """Return steps from the mean of a square of ``side`` pixels to that of the next one, shape (frames, steps).

    A level that is common to a frame is no noise of an aperture beside its background.
    """
    rows, columns = (size // side * side for size in covered.shape)
    shape = rows // side, side, columns // side, side
    pixels = covered[:rows, :columns].reshape(shape).sum(axis=(1, 3))
    sums = np.where(covered, frames, 0.0)[:, :rows, :columns].reshape(len(frames), *shape).sum(axis=(2, 4))
    means = sums / np.maximum(pixels, 1)
    full = pixels > 0.5 * side**2
    return np.asarray(np.diff(means, axis=2)[:, full[:, 1:] & full[:, :-1]])


def _ratios(difference: FloatArray, plain: FloatArray) -> tuple[float, float]:
    """Return the variance of differences, and that of frames with them, over that of plain frames."""
    if len(plain) < 2:
        return 0.0, 1.0
    own, moved, both = (part.var(axis=0, ddof=1).sum() for part in (plain, difference, plain + difference))
    return (float(moved / own), float(both / own)) if own > 0 else (0.0, 1.0)
