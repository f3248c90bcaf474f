"""The closed-form answer: what the exposure-time calculator says of a fixed scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cpic_planner.etc.model import EtcModel, Strategy, build_model
from cpic_planner.etc.noise import StackNoise, stack_noise
from cpic_planner.etc.rates import aperture_rates
from cpic_planner.scene_confirmation import scene_target
from cpic_planner.targets import Targets
from cpic_planner.tradeoff.places import ANNULUS_LAMBDA_D
from cpic_planner.tradeoff.scenes import FixedScene
from simulator.target.sources import scene_sources

FloatArray = NDArray[np.float64]
_NOT_PLACE = ("background_mean",)


@dataclass(frozen=True)
class ClosedForm:
    """A fixed scene as the calculator sees it: a star, its planet's contrast and place, and the frames."""

    model: EtcModel
    target: Targets
    case: FixedScene
    x_arcsec: float
    y_arcsec: float
    contrast: float

    def noise(self, n_cases: int = 1) -> StackNoise:
        """One question, or as many at once, of planets that differ."""
        case, place = self.case, np.ones((1, n_cases))
        contrast = self.contrast * np.linspace(1.0, 2.0, n_cases)[None]
        rates = aperture_rates(
            self.model, self.target, case.band, self.x_arcsec * place, self.y_arcsec * place, contrast
        )
        return stack_noise(rates, case.exposure_s, case.n_frames, case.em_gain, self.model.camera(case.band))

    def answer(self) -> dict[str, float]:
        """Flux and variance of the visit, e- and e-^2, as the images are measured: no error of the mean background."""
        said = self.noise()
        terms = {name: float(np.ravel(part)[0]) for name, part in said.terms.items() if name not in _NOT_PLACE}
        speckle = terms.pop("speckle")
        return {"flux_e": float(np.ravel(said.signal_e)[0]), "white_e2": sum(terms.values()), "speckle_e2": speckle}


def closed_form(case: FixedScene) -> ClosedForm:
    """Prepare the calculator for a fixed scene."""
    model = build_model(case.instrument, [case.band], Strategy(n_modes=0, annulus_lambda_d=ANNULUS_LAMBDA_D))
    planet = next(item for item in scene_sources(case.scene, case.instrument, case.band) if item.kind == "planet")
    return ClosedForm(model, scene_target(case.scene), case, planet.x_arcsec, planet.y_arcsec, planet.contrast or 0.0)
