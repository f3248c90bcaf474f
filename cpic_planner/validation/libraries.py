"""Reference libraries by name: what their frames show, and how those of another star are scaled."""

import math
from dataclasses import dataclass
from typing import TypedDict

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, check_finite, check_number, check_whole, numeric_context
from cpic_planner.queries import Strategy
from cpic_planner.validation.apertures import checked_frames, checked_region, region_rows
from simulator.config import Scene
from simulator.observing import MAX_FRAMES, Role

BLOCK_PIXELS = 8
"""Side of the squares whose sums count as independent in the error of `halo_scale`: about two speckles."""


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
        A name of `cpic_planner.registry.libraries.LIBRARIES`.
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


def library_plan(
    strategy: Strategy, scene: Scene, n_frames: int, *, visits: int = 1, roll_deg: float = 0.0
) -> LibraryPlan:
    """Return what to simulate for the library that a strategy names (`cpic_planner.registry.libraries`).

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
    roll_deg : float
        Roll of the science visit; the middle of the two rolls.

    Returns
    -------
    LibraryPlan
        With ``round(n_frames * reference_ratio * V / R)`` reference frames, at least 1, in each of R reference visits
        of V science visits; without the factor ``V / R`` for a library whose visits are there already.
    """
    count = check_whole("n_frames", n_frames, 1, MAX_FRAMES)
    middle = check_number("roll_deg", roll_deg, "deg")
    library, rolls = strategy.reference_library, strategy.rolls_deg
    role: Role = "science" if library.noise_free else "reference"
    # Expectations are those of the very visits that they stand beside.
    number = visits if library.noise_free else strategy.references_of(visits)
    length = float(library.reference_length(np.asarray(float(visits)), np.asarray(float(number))))
    references = count if library.noise_free else max(round(count * strategy.reference_ratio * length), 1)
    science: VisitSettings = {"role": "science", "roll_deg": middle + rolls[0], "n_frames": count}
    reference: VisitSettings = {"role": role, "roll_deg": middle + rolls[-1], "n_frames": references}
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
        that the ETC takes, or `halo_scale`.
    pedestal_e : array_like, optional
        Mean of what does not come from the star (dark current, clock-induced charge), broadcasts to a frame; it is the
        same afterwards. Sky light that is left in becomes a constant, which the background of the photometry takes.

    Returns
    -------
    ndarray
        ``(reference_e - pedestal_e) scale + pedestal_e``: the variance of star light counts ``scale`` times that of the
        science star's, all other variance ``scale^2`` times its own, as in `cpic_planner.registry.libraries.OtherStar`.

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


@dataclass(frozen=True)
class HaloScale:
    """Light of the science star over that of the reference star as the halo shows it, and its 1-sigma error."""

    value: float
    error: float


def halo_scale(science_e: ArrayLike, reference_e: ArrayLike, *, region: ArrayLike | None = None) -> HaloScale:
    """Measure the brightness of the science star over that of the reference star on their halos.

    Parameters
    ----------
    science_e, reference_e : array_like
        Frames of equal exposure, electrons, (n, y, x) and (m, y, x); at least two reference frames.
    region : array_like of bool, optional
        Pixels (y, x) to use; all by default. Leave out known planets.

    Returns
    -------
    HaloScale

    Raises
    ------
    InputError
        If shapes or numbers do not fit, there are fewer than two reference frames, or the halo does not stand out of
        the noise.

    Notes
    -----
    Least squares of the mean science frame ``S`` on the mean reference frame, both less their mean over the region (a
    constant background does not matter), would be too small by the share of noise in the square of the reference. The
    even and the odd frames, ``A`` and ``B``, have independent noise: ``sum(S (A + B) / 2) / sum(A B)`` is free of it.
    A planet of flux ``f`` and template ``p`` in the region adds ``f sum(p A) / sum(A B)``.

    The error is that of a ratio of sums over squares of 8 x 8 pixels (Cochran 1977, Sampling Techniques, eq. 6.13): it
    holds for correlated speckles too, as long as the region has some ten squares.
    """
    science, reference = checked_frames("science_e", science_e), checked_frames("reference_e", reference_e)
    if reference.ndim != 3 or len(reference) < 2 or reference.shape[-2:] != science.shape[-2:]:
        allowed = f"at least two frames of {science.shape[-2:]}"
        raise InputError("reference_e", reference.shape, unit="px", allowed=allowed)
    pixels = checked_region("region", region, science.shape[-2:])
    star = region_rows("science_e", science, pixels).mean(axis=0)
    frames = region_rows("reference_e", reference, pixels)
    even, odd = frames[::2].mean(axis=0), frames[1::2].mean(axis=0)
    star, even, odd = star - star.mean(), even - even.mean(), odd - odd.mean()
    y, x = np.nonzero(pixels)
    _, square = np.unique((y // BLOCK_PIXELS) * pixels.shape[1] + x // BLOCK_PIXELS, return_inverse=True)
    above, below = np.bincount(square, star * (even + odd) / 2.0), np.bincount(square, even * odd)
    value, spread = math.nan, math.inf
    if len(below) > 1 and below.sum() > 0:
        value = float(above.sum() / below.sum())
        left = above - value * below
        spread = math.sqrt(float(left @ left) * len(left) / (len(left) - 1)) / float(below.sum())
    if not value > 2.0 * spread:
        raise InputError("reference_e", "no halo above the noise", allowed="frames in which both halos can be measured")
    return HaloScale(value, spread)
