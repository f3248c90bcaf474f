"""What the images of a task take, before any is made."""

from __future__ import annotations

from dataclasses import dataclass

from cpic_planner.validation.modelling import Modelling, modelling_of
from cpic_planner.validation.task import ConfirmTask
from simulator.knobs import Knobs

__all__ = ["TaskCost", "task_cost"]

# Fitted to processor times of one core of a server, bands F520 and F850, 4 to 80 frames, 1 to 30 realisations, every
# tier: within a factor of 1.3 there.
_SETUP_S, _SETUP_STAMPS = 0.15, 25.0  # visits, star off the mask, subjects: a fixed part, and propagations
_SUMS_S = 0.02  # of one realisation of both visits, reduced, searched and measured
_FRAME_S = {"hole": 4e-3, "full": 0.085}  # drawn, calibrated, cleaned
_STAMP_S, _STAMP_S_PER_PRODUCT = 1e-3, 8e-11  # of one propagation of the star
_HOLE_SHARE = 0.4  # of the stamp, in rows and columns that the hole has
_BASE_MB, _WHOLE_FRAME_MB, _STACK_BYTES = 450.0, 200.0, 32.0


@dataclass(frozen=True)
class TaskCost:
    """Expected cost of one task.

    Attributes
    ----------
    work_s : float
        Processor time.
    realisations : int
        That are made.
    frames : int
        That are drawn one by one.
    memory_mb : float
    """

    work_s: float
    realisations: int
    frames: int
    memory_mb: float


def task_cost(task: ConfirmTask) -> TaskCost:
    """Expected cost of the images of a task and of measuring them.

    Notes
    -----
    Sums of frames are taken at their word: where a limit turns out to be reached in the hole, two realisations run
    frame by frame instead.
    """
    how = modelling_of(task)
    ratio = float(task.strategy["reference_ratio"])
    frames = task.n_frames + max(round(task.n_frames * ratio), 1)
    stamp_s = _stamp_s(how.knobs)
    work = _SETUP_S + _SETUP_STAMPS * stamp_s
    one_by_one, largest = 0, 0
    if how.draw == "sums":
        runs = task.realisations
        work += runs * (_SUMS_S + 2 * min(how.epochs, task.n_frames) * _HOLE_SHARE * stamp_s)
        if task.audit:
            one_by_one, largest = frames, task.n_frames
            work += _frames_s(how, "hole", task.n_frames, frames, stamp_s)
    else:
        runs = how.runs_by_frames(task.realisations)
        one_by_one, largest = runs * frames, task.n_frames
        work += runs * _frames_s(how, how.region, task.n_frames, frames, stamp_s)
    stack = largest * how.knobs.stamp_pixels**2 * 2 * _STACK_BYTES / 1e6
    whole = _WHOLE_FRAME_MB if how.draw == "frames" and how.region == "full" else 0.0
    return TaskCost(work, runs, one_by_one, _BASE_MB + whole + stack)


def _frames_s(how: Modelling, region: str, n_frames: int, frames: int, stamp_s: float) -> float:
    return 2 * min(how.epochs, n_frames) * stamp_s + frames * _FRAME_S[region]


def _stamp_s(knobs: Knobs) -> float:
    """Of one propagation of the star onto a stamp: two matrix products a wavelength."""
    nodes, pupil = knobs.stamp_pixels * knobs.pixel_nodes, knobs.pupil_samples
    products = knobs.wavelength_nodes * (nodes * pupil**2 + nodes**2 * pupil)
    return _STAMP_S + _STAMP_S_PER_PRODUCT * products
