"""A whole effect of a detector that needs the frame before: a part of its charge comes back in the next one."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from simulator.config import FrozenModel
from simulator.detectors import Effect, Exposure, FrameTerm, Work


class AfterglowNumbers(FrozenModel):
    """Part of the charge of a frame that comes back in the next one."""

    fraction: Annotated[float, Field(ge=0, le=0.5)]


class Afterglow(Effect):
    """Poisson counts of a part of the mean charge of the frame before."""

    switch = "afterglow"
    label = "afterglow of the frame before"
    law = "Poisson, of its mean charge"
    stage, remembers = "charge", True
    needs = "exposure"
    settings = AfterglowNumbers
    preset: ClassVar = {
        "afterglow": {"fraction": {"value": 0, "unit": "", "source": "none is known", "confidence": "A"}},
        "switches": {"afterglow": True},
    }
    number = "afterglow.fraction"
    frame_s = 4e-4

    def memory_s(self, detector: Any) -> float:
        """Return how long it lasts: nothing is left where nothing comes back."""
        return super().memory_s(detector) if detector.afterglow.fraction else 0.0

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add the counts."""
        if work.past:
            charge = rng.poisson(exposure.detector.afterglow.fraction * np.asarray(work.past[0].charge_e))
            work.image += charge
            work.book("afterglow", charge.sum())

    def added(self, detector: Any, exposure_s: float | None = None) -> FrameTerm:
        """Return what comes back of frames of the same light."""
        return FrameTerm(of_past=detector.afterglow.fraction)
