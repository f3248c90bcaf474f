"""Reference libraries by name: what their frames show, and how those of another star are scaled."""

from dataclasses import dataclass
from typing import TypedDict

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, check_finite, check_number, check_whole, numeric_context
from cpic_planner.queries import Strategy
from cpic_planner.validation.apertures import checked_frames
from simulator.config import Scene
from simulator.observing import MAX_FRAMES, Role


class VisitSettings(TypedDict):
    """Arguments of `simulator.observing.observation.observe` that tell one visit from the other."""

    role: Role
    roll_deg: float
    n_frames: int


@dataclass(frozen=True)
class LibraryPlan:
    """The visits of an observation whose references come from a named library.

    Attributes
    ----------
    name : str
        A name of `cpic_planner.registry.LIBRARIES`.
    science_scene, reference_scene : Scene
        What the frames of each visit show.
    science, reference : dict
        ``role``, ``roll_deg`` and ``n_frames`` of each visit, for `simulator.observing.observation.observe`. Visits of
        different role or number have wavefront offsets, walks and noise of their own.
    visits, reference_visits : int
        How many there are of each.
    shows_planet : bool
        Whether the planet is in the reference frames too: then both visits are science, each the other's reference
        (`cpic_planner.validation.roll`).
    noise_free : bool
        Whether the expectation (`simulator.products.sequence.FrameSequence.expected_e`) stands for the reference
        frames. It is that of the science visit without planets, wavefront included: neither noise nor drift between
        the visits.
    flags : tuple of str
        Caveats, the same as the ETC's.
    """

    name: str
    science_scene: Scene
    reference_scene: Scene
    science: VisitSettings
    reference: VisitSettings
    visits: int = 1
    reference_visits: int = 1
    shows_planet: bool = False
    noise_free: bool = False
    flags: tuple[str, ...] = ()


def library_plan(strategy: Strategy, scene: Scene, n_frames: int, *, visits: int = 1) -> LibraryPlan:
    """Return what to simulate for the library that a strategy names (`cpic_planner.registry`).

    Parameters
    ----------
    strategy : Strategy
        ``library``, ``reference_ratio``, ``reference_visits``, ``reference_star``, ``roll_deg``: those of the ETC.
    scene : Scene
        With its planets.
    n_frames : int
        Science frames of a visit, at least 1; for ``roll`` those of each roll.
    visits : int
        Science visits, at least 1.

    Returns
    -------
    LibraryPlan
        With ``round(n_frames * reference_ratio * V / R)`` reference frames, at least 1, in each of R reference visits
        of V science visits; without the factor ``V / R`` for a library whose visits are there already.
    """
    count = check_whole("n_frames", n_frames, 1, MAX_FRAMES)
    library, rolls = strategy.reference_library, strategy.rolls_deg
    role: Role = "science" if library.noise_free else "reference"
    # Expectations are those of the very visits that they stand beside.
    number = visits if library.noise_free else strategy.references_of(visits)
    length = float(library.reference_length(np.asarray(float(visits)), np.asarray(float(number))))
    references = count if library.noise_free else max(round(count * strategy.reference_ratio * length), 1)
    science: VisitSettings = {"role": "science", "roll_deg": rolls[0], "n_frames": count}
    reference: VisitSettings = {"role": role, "roll_deg": rolls[-1], "n_frames": references}
    return LibraryPlan(
        name=library.name,
        science_scene=scene,
        reference_scene=library.reference_scene(strategy, scene),
        science=science,
        reference=reference,
        visits=visits,
        reference_visits=number,
        shows_planet=len(rolls) > 1,
        noise_free=library.noise_free,
        flags=library.flags,
    )


@numeric_context()
def scale_library(reference_e: ArrayLike, scale: float, *, pedestal_e: ArrayLike = 0.0) -> FloatArray:
    """Return the frames of a reference star as bright as those of the science star.

    Parameters
    ----------
    reference_e : array_like
        Frames in electrons, (m, y, x) or (y, x).
    scale : float
        Light of the science star over that of the reference star in equal exposures, above 0: the ratio of the rates
        that the ETC takes.
    pedestal_e : array_like, optional
        Mean of what does not come from the star (dark current, clock-induced charge), broadcasts to a frame; it is the
        same afterwards. Sky light that is left in becomes a constant, which the background of the photometry takes.

    Returns
    -------
    ndarray
        ``(reference_e - pedestal_e) scale + pedestal_e``: the variance of star light counts ``scale`` times that of the
        science star's, all other variance ``scale^2`` times its own, as in `cpic_planner.registry.OtherStar`.

    Raises
    ------
    InputError
        If the scale is not above 0, or the shape or a number is not allowed.

    Notes
    -----
    An error ``e`` of the scale leaves the fraction ``e`` of the halo, speckles included. It only matters where a mean
    frame is subtracted: modes of uncentred or spatially centred frames have no scale.
    """
    frames = checked_frames("reference_e", reference_e)
    factor = check_number("scale", scale)
    if not factor > 0:
        raise InputError("scale", scale, allowed="above 0")
    pedestal = check_finite("pedestal_e", pedestal_e, "e-")
    sides = zip(pedestal.shape[::-1], frames.shape[::-1], strict=False)
    if pedestal.ndim > 2 or any(own not in (1, side) for own, side in sides):
        allowed = f"one number, or a map of {frames.shape[-2:]}"
        raise InputError("pedestal_e", pedestal.shape, unit="px", allowed=allowed)
    with np.errstate(over="ignore"):
        scaled: FloatArray = (frames - pedestal) * factor + pedestal
    if np.isinf(scaled).any():
        raise InputError("scale", scale, allowed="one at which the frames stay finite")
    return scaled
