"""The work that is timed: both visits of an observation, drawn, calibrated, and the planet's aperture measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from catalogs.errors import InputError
from cpic_planner.tradeoff.scenes import FixedScene
from cpic_planner.tradeoff.setup import Setup, visit
from cpic_planner.validation.frames import calibrated_frames
from cpic_planner.validation.realise import cleaned
from cpic_planner.validation.rejection import filled
from simulator.camera.frame import MaskBit
from simulator.hole_stack import hole_stacks
from simulator.imaging.aperture import overlap_weights
from simulator.imaging.frame import forget_starlight
from simulator.observation import Observation

FloatArray = NDArray[np.float64]


class NotApplicable(Exception):
    """A way that a scene does not allow, with its reason."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """Frames of one visit over the stamp, in electrons at the register input.

    Attributes
    ----------
    electrons : ndarray, shape (n, y, x)
        Calibrated; the mean of its pixel where a particle or a limit voids a pixel-frame.
    usable : ndarray of bool, shape (n, y, x)
    """

    electrons: FloatArray
    usable: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Work:
    """What the work leaves.

    Attributes
    ----------
    science : Observation
    flux_e : float
        Planet's aperture in the science visit less that in the reference visit, electrons of the visit.
    drawn : tuple of Drawn
        Frames of both visits; none where sums were drawn.
    """

    science: Observation
    flux_e: float
    drawn: tuple[Drawn, ...]


def stamp_of(observation: Observation) -> tuple[slice, slice]:
    """Rows and columns of the stamp around the mask."""
    rows, columns, _ = observation.area.stamp(observation.psf.on_axis.shape[0])
    return rows, columns


def aperture_flux_e(observation: Observation, stamp_e: FloatArray) -> float:
    """Sum in the planet's aperture on a stamp."""
    planet = next(k for k, source in enumerate(observation.truth.sources) if source.kind == "planet")
    rows, columns = stamp_of(observation)
    y, x = observation.truth.y_pixel[planet] - rows.start, observation.truth.x_pixel[planet] - columns.start
    row, column = round(y), round(x)
    geometry = observation.psf.geometry
    weights = overlap_weights(geometry.aperture_radius_arcsec / geometry.pixel_scale_arcsec, y - row, x - column)
    half = len(weights) // 2
    return float((weights * stamp_e[row - half : row + half + 1, column - half : column + half + 1]).sum())


def drawn_frames(observation: Observation) -> Drawn:
    """Draw and calibrate the frames of a visit, particles taken out.

    Notes
    -----
    Frames of the visible camera go through the calibration and rejection of ``cpic confirm``. Those of the infrared
    camera have no such reduction yet: the expected frame is taken off, and pixels that the truth calls hit or cut off
    are left out.
    """
    if observation.camera == "NIR":
        return _infrared(observation)
    frames = calibrated_frames(observation, cropped=True)
    usable = cleaned(frames)[1] if frames.detector.switches.cosmic_rays else frames.usable
    return Drawn(filled(frames.electrons, usable)[0], usable)


def _infrared(observation: Observation) -> Drawn:
    place, detector = stamp_of(observation), observation.instrument.near_infrared.detector
    electrons, usable = [], []
    expected = observation.expected[place]
    void = MaskBit.SATURATED | MaskBit.COSMIC_RAY | MaskBit.BAD | MaskBit.HOT
    for frame in observation.iter_full_frames():
        electrons.append((frame.adu[place] - expected) * detector.gain_e_adu)
        usable.append((frame.mask[place] & np.uint8(void)) == 0)
    whole, _ = filled(np.stack(electrons), np.stack(usable))
    return Drawn(whole, np.stack(usable))


def both_visits(case: FixedScene, setup: Setup) -> tuple[Observation, Observation]:
    """Science and reference visit, the light of field stars made anew: work that is timed begins without it.

    Parameters
    ----------
    case : FixedScene
    setup : Setup
    """
    forget_starlight()
    return visit(case, setup), visit(case, setup, role="reference")


def worked(case: FixedScene, setup: Setup, visits: tuple[Observation, Observation] | None = None) -> Work:
    """Do the whole work once.

    Parameters
    ----------
    case : FixedScene
    setup : Setup
    visits : tuple of Observation, optional
        Science and reference visit where they are there already.

    Returns
    -------
    Work

    Raises
    ------
    NotApplicable
        If the scene does not allow this way.
    """
    science, reference = visits or both_visits(case, setup)
    if setup.draw == "sums":
        try:
            epochs = setup.n_epochs(case)
            sums = [hole_stacks(seen, epochs=epochs).draw().sum(axis=0) for seen in (science, reference)]
        except InputError as error:
            raise NotApplicable(error.hint or str(error)) from None
        return Work(science, aperture_flux_e(science, sums[0] - sums[1]), ())
    drawn = tuple(drawn_frames(seen) for seen in (science, reference))
    means = [part.electrons.mean(axis=0) for part in drawn]
    return Work(science, case.n_frames * aperture_flux_e(science, means[0] - means[1]), drawn)
