"""Chances that visits detect planets, blind and at a known place, and what given frames promise of planets."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray
from cpic_planner.etc.detection import MIN_ELEMENTS, threshold_array
from cpic_planner.etc.detection_law import SearchLaw, band_law, light_share, lit_share, own_share, speckled_share
from cpic_planner.etc.model import EtcModel, Programme
from cpic_planner.etc.noise import StackNoise, stack_noise, with_modes
from cpic_planner.etc.programmes import SearchMotion, motion_factor
from cpic_planner.etc.rates import aperture_rates
from cpic_planner.targets import Targets

LEAST_PROBABILITY = 1e-6
"""Planets that are detected with a smaller probability count as not detected at all."""


@dataclass(frozen=True, eq=False)
class Chances:
    """Probabilities of a detection, of a blind search and at a known place."""

    blind: FloatArray
    known_place: FloatArray

    @classmethod
    def of(
        cls,
        law: SearchLaw,
        noise: StackNoise,
        separation_arcsec: ArrayLike,
        light: ArrayLike,
        visits: ArrayLike,
        motion: ArrayLike = 1.0,
        *,
        at_place: bool = True,
    ) -> Self:
        """Return the chances by a law.

        Parameters
        ----------
        law : SearchLaw
        noise : StackNoise
            Of programmes at the planets' places.
        separation_arcsec : array_like
        light : array_like
            Share of the errors' light in what visits average (`light_share`).
        visits : array_like
            Independent wavefronts behind the noise (`effective_visits`).
        motion : array_like
            Factor on the threshold of a blind search for the motion of planets; at a known place the orbit is followed.
        at_place : bool
            Those at a known place are asked for; else they are NaN.
        """
        where = own_share(noise), separation_arcsec, speckled_share(noise), lit_share(noise, light), visits
        paid = noise.significance / np.asarray(motion, float)
        blind = law.probability(paid, *where, at_place=False)
        # Who knows the place may search blind, too.
        known = law.probability(noise.significance, *where, at_place=True) if at_place else np.nan
        return cls(blind, np.maximum(blind, known))

    def where(self, defined: BoolArray) -> Self:
        """Return the same, and 0 where no threshold of a significance is defined."""
        return type(self)(*(np.where(defined, part, 0.0 * part) for part in (self.blind, self.known_place)))


def visit_chances(
    model: EtcModel,
    band: str,
    separation_arcsec: ArrayLike,
    visit_s: ArrayLike,
    noise: StackNoise,
    visits: ArrayLike = 1.0,
    *,
    motion: ArrayLike = 1.0,
    at_place: bool = True,
) -> Chances:
    """Return the probabilities that visits, or programmes of them, detect planets.

    Parameters
    ----------
    model : EtcModel
    band : str
    separation_arcsec, visit_s : array_like
        Of the planets, and length of the science visits.
    noise, visits, motion, at_place
        As of `Chances.of`.
    """
    light = light_share(model, band, separation_arcsec, visit_s)
    found = Chances.of(band_law(model, band), noise, separation_arcsec, light, visits, motion, at_place=at_place)
    return found.where(model.metrics[band].resolution_elements(separation_arcsec) >= MIN_ELEMENTS)


@dataclass(frozen=True, eq=False)
class Prospect:
    """The expected signals of planets; arrays of stars x planets, made by `prospect_of`.

    Attributes
    ----------
    programme : Programme
        With the modes that are projected out at each place.
    noise : StackNoise
        Of the frames of all visits.
    threshold : ndarray
        Small-sample threshold of the significance.
    chances : Chances
        Probabilities of a detection.
    motion : ndarray
        Factor by which a blind search asks for more because planets may move.
    at_level : callable
        The same of a search at another level (sigma).
    """

    programme: Programme
    noise: StackNoise
    threshold: FloatArray
    chances: Chances
    motion: FloatArray
    at_level: "Callable[[float], Prospect]"

    @property
    def margin(self) -> FloatArray:
        """Predicted significance over threshold."""
        return np.asarray(self.noise.significance / self.threshold)


def prospect_of(
    model: EtcModel,
    targets: Targets,
    band: str,
    x_arcsec: FloatArray,
    y_arcsec: FloatArray,
    contrast: FloatArray,
    frames: tuple[float, float, float],
    programme: Programme,
    *,
    moving: bool = True,
) -> Prospect:
    """Return what given frames promise of planets.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars.
    band : str
        Name of a band of the instrument, such as ``F520``.
    x_arcsec, y_arcsec, contrast : ndarray, shape (n, k)
        Offsets on the detector, and planet-to-star ratios of detected rates.
    frames : tuple of float
        Exposure (s), number of frames of a visit, EM gain.
    programme : Programme
        Visits that are reduced together.
    moving : bool
        Whether a blind search pays for the motion of planets, as `cpic_planner.contrast_limit` counts it; images show
        planets that stand still.
    """
    separation = np.hypot(x_arcsec, y_arcsec)
    rates = aperture_rates(model, targets, band, x_arcsec, y_arcsec, contrast)
    made = with_modes(model, band, separation, rates, programme, *frames)
    camera = model.camera(band)
    noise = stack_noise(rates, *frames, camera, model.strategy, made)
    elements = model.metrics[band].resolution_elements(separation)
    visit_s = np.asarray(frames[1] * (frames[0] + camera.readout_s))
    visits = made.effective(rates.speckle)
    here = aperture_rates(model, targets, band, x_arcsec, y_arcsec, contrast, at_place=True)
    seen = stack_noise(here, *frames, camera, model.strategy, made)

    def at_level(sigma: float) -> Prospect:
        own = replace(model, strategy=model.strategy.model_copy(update={"sigma": sigma}))
        motion = np.ones_like(separation)
        if moving:
            motion = np.asarray(motion_factor(SearchMotion.of(own, targets, band, separation), made, visit_s))
        chances = visit_chances(own, band, separation, visit_s, seen, visits, motion=motion)
        return Prospect(made, noise, threshold_array(elements, sigma), chances, motion, at_level)

    return at_level(model.strategy.sigma)
