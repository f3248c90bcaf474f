"""Audit a programme: a fraction of its frames, run one by one with every effect of the camera, carried to all of it.

A sum of frames lacks what only single frames show: particles and their rejection, charge left behind in transfers,
curves, levels of the bias. Each frame that is run has a plain twin: the same light, the same random numbers and the
same pixels, without these effects. Their difference is free of nearly all noise, so that few frames tell what the
effects do to the mean. The image of the audit is a realisation of the whole programme from sums, with this difference
added to every frame.
"""

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cpic_core import BoolArray, FloatArray, IntArray
from cpic_planner.validation.frames import calibrated_frames
from cpic_planner.validation.modelling import LIMITS, Modelling
from cpic_planner.validation.realise import (
    ROLES,
    FrameStatistics,
    Realisation,
    VisitPair,
    frames_of,
    thinned,
    visit_pair,
)
from cpic_planner.validation.rejection import grown
from cpic_planner.validation.task import ConfirmTask
from cpic_planner.validation.templates import radius_pixel
from simulator.camera import FrameNoise
from simulator.detectors import rows_of
from simulator.observing import Observation, Role

REALISATION = 1_000_000
"""Number of the realisation that is audited: far from those of the sums."""
MOST_SHARE = 0.5
"""Largest part of the variance of the whole programme that may come from the frames that stand for the others."""
_SEQUENCE_FRAMES = 24  # a pixel is compared with itself in as many: more tell its level no better than its drift
_LEAST_SEQUENCES = 2
_EPOCHS = 3  # the drift within a visit matters to the rejection alone: frame and twin share it
_REACH_PIXELS = 4  # from a track: its charge, three pixels of what transfers leave behind, and the neighbour of that


@dataclass(frozen=True, eq=False)
class FrameEffects:
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
        frames, whole, usable, story = frames_of(observation, hole, numbers)
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
