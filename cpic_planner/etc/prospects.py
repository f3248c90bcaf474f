"""Expected detections of planets anywhere in the dark hole of a band, by a programme of given frames."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cpic_core import FloatArray
from cpic_planner.etc.chances import Chances, visit_chances
from cpic_planner.etc.detection import threshold_array
from cpic_planner.etc.model import EtcModel, Programme
from cpic_planner.etc.modes import with_modes
from cpic_planner.etc.motion import SearchMotion, motion_factor
from cpic_planner.etc.noise import StackNoise, stack_noise
from cpic_planner.etc.rates import aperture_rates
from cpic_planner.etc.together import effective_of
from cpic_planner.targets import Targets


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
    visits = effective_of(made, rates.speckle)
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
