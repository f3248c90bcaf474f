"""A whole effect of a detector: noise of the amplifier with a new pattern in every frame."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from simulator.config import FrozenModel
from simulator.detectors import Effect, Exposure, FrameTerm, Work


class PatternNumbers(FrozenModel):
    """Rms of the pattern at the register output, electrons."""

    rms_e: Annotated[float, Field(ge=0, le=1e4)]


class PatternNoise(Effect):
    """Gaussian pattern of the amplifier, new in every frame."""

    switch = "pattern_noise"
    label = "pattern noise of the amplifier"
    law = "Gaussian, new in every frame"
    stage = "voltage"
    settings = PatternNumbers
    preset: ClassVar = {
        "pattern_noise": {"rms_e": {"value": 0, "unit": "e- rms", "source": "none is known", "confidence": "A"}},
        "switches": {"pattern_noise": True},
    }
    number = "pattern_noise.rms_e"
    frame_s = 2e-4
    colour = "#117733"

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add the pattern of one frame."""
        rms_adu = exposure.detector.pattern_noise.rms_e / exposure.detector.gain_e_adu
        work.image += rms_adu * rng.standard_normal(work.image.shape)

    def added(self, detector: Any, exposure_s: float | None = None) -> FrameTerm:
        """Return its variance at the register output."""
        return FrameTerm(output_e2=detector.pattern_noise.rms_e**2)
