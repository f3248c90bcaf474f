"""The multiplication register: its exact law, charge that its own clocks make, its full well and its amplifier."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from cpic_core import FloatArray, load_kernels
from simulator.detectors.collection import COUNTED, compressed, output_curve
from simulator.detectors.effect import LIMIT_KERNELS, Effect, Exposure, Sizes, Work, sizes
from simulator.detectors.gain import amplify, stage_probability

if TYPE_CHECKING:
    from simulator.ledger import CameraCase

Stages = Annotated[int, Field(ge=1, le=10000)]
LargestGain = Annotated[float, Field(ge=1, le=10000)]
StageCharge = Annotated[float, Field(ge=0, le=1)]


class Register(Effect):
    """Random multiplication; without it (switch off) charge is multiplied by the gain exactly."""

    switch, label, law = "em_register", "noise of the EM register", "law of the stage-by-stage cascade"
    stage, in_sums, always = "charge", "per_electron", True
    frame_s = 4e-4

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Multiply."""
        image *= exposure.em_gain

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Multiply at random."""
        work.charge["register_in"] = float(work.image.sum())
        if self.on(exposure.detector):
            amplify(work.image.reshape(-1), exposure.em_gain, exposure.detector.register_stages, rng)
        else:
            work.image *= exposure.em_gain
        work.charge["register_out"] = float(work.image.sum())

    def size(self, case: CameraCase) -> Sizes:
        """Return the share of the variance that the register adds."""
        noise, excess = case.noise, case.noise.factor2 - 1.0
        snr = case.snr_share(*COUNTED, "clock", factor=excess / noise.factor2)
        return sizes(case.variance_change(excess * (case.counted_e + noise.clock_e)), snr=snr)


class RegisterClockCharge(Effect):
    """Electrons that the clocks of the register make, each multiplied by the stages that are left to it.

    ``register_cic_e`` is the mean number made per pixel in one stage.
    """

    switch, label = "register_clock_charge", "clock-induced charge of the register"
    law = "electrons made between the stages"
    stage, in_sums = "charge", "per_electron"
    number = "register_cic_e"
    frame_s = 2e-4

    @staticmethod
    def mean_output_e(detector: Any, em_gain: float) -> float:
        """Return the mean electrons of a pixel at the output.

        ``c`` times the sum of the gains of all remainders of the register, ``c (g - 1) / p``.

        Parameters
        ----------
        detector : Detector
        em_gain : float
            Gain of the register.
        """
        p = float(stage_probability(em_gain, detector.register_stages))
        gains = (em_gain - 1.0) / p if p > 0 else float(detector.register_stages)
        return float(detector.register_cic_e * gains)

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Add the mean."""
        image += self.mean_output_e(exposure.detector, exposure.em_gain)

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add single electrons, each through the rest of the register."""
        detector = exposure.detector
        stages = detector.register_stages
        p = float(stage_probability(exposure.em_gain, stages))
        events = int(rng.poisson(detector.register_cic_e * stages * work.image.size))
        places = rng.integers(0, max(work.image.size, 1), size=events)
        left = rng.integers(0, stages, size=events)
        # Stage by stage, all electrons that still have that many stages before them: exact.
        order = np.argsort(-left, kind="stable")
        grown = np.ones(events, dtype=np.int64)
        for count in np.searchsorted(-left[order], -np.arange(stages, 0, -1), side="right"):
            if count:
                grown[:count] += rng.binomial(grown[:count], p)
        np.add.at(work.image.reshape(-1), places[order], grown)
        work.book("register_clock_charge", float(grown.sum()))

    def size(self, case: CameraCase) -> Sizes:
        """Return the size of its mean and of twice that as variance."""
        made = self.mean_output_e(case.detector, case.em_gain) / case.em_gain
        spread = 2.0 * made
        variance = [case.n_frames * case.light.noise_pixels * spread] * len(case.variances)
        pixel = max(case.mean_change(made), case.variance_change(spread, inside=False))
        return sizes(pixel, snr=case.snr_added(variance))


class RegisterFullWell(Effect):
    """Full well of the register: the excess trails into the pixels read next and drains at the end of the row."""

    switch, label, law = "register_full_well", "register full well", "the excess trails along the row"
    stage, in_sums = "charge", "per_electron"
    frame_s = 1e-4

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Trail the mean."""
        self._trail(image, np.zeros(image.shape, dtype=np.bool_), exposure)

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Trail the counts."""
        trailed = np.zeros(work.image.shape, dtype=np.bool_)
        work.book("drained_row_ends", -self._trail(work.image, trailed, exposure))
        work.counts["n_register_saturated"] = int(np.count_nonzero(trailed))
        work.saturated |= trailed

    def draw_sum(self, work: Work, exposure: Exposure, n_frames: int, rng: np.random.Generator) -> None:
        """Leave sums of frames as they are: no frame among them reaches the limit."""

    @staticmethod
    def _trail(image: FloatArray, trailed: np.ndarray, exposure: Exposure) -> float:
        well = float(math.floor(exposure.detector.register_full_well_e))
        return float(load_kernels(LIMIT_KERNELS).serial_spill(image, well, trailed))

    def size(self, case: CameraCase) -> Sizes:
        """Return the size of what overflows, and whether it may reach a planet."""
        detector, noise = case.detector, case.noise
        well = detector.register_full_well_e / case.em_gain
        held = np.minimum(case.most_e + noise.dark_e, detector.full_well_e if detector.switches.blooming else np.inf)
        pixel = float(np.max(case.overflow(held + noise.clock_e, well, noise.factor2), initial=0.0))
        pixel += case.struck() * case.hits.share_above(well)
        reached = case.over_planets(lambda planet: case.spilled_on(planet, well, noise.factor2, case.spill.trails_into))
        return sizes(pixel, reached)


class OutputNonlinearity(Effect):
    """The output falls behind as the register fills: ``x / (1 + b x)`` through the loss of the configuration.

    It shares switch and row of the non-linearity of the pixels.
    """

    switch = "nonlinearity"
    stage, in_sums = "charge", "not_additive"

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Apply the curve to the mean."""
        numbers = exposure.detector.nonlinearity
        if numbers.register_loss > 0:
            image[...] = compressed(image, numbers.register_loss, numbers.register_loss_at_e)

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Apply the curve to the output, in electrons: no charge is lost."""
        b = output_curve(exposure.detector)
        if b > 0:
            load_kernels(LIMIT_KERNELS).compress(work.image.reshape(-1), b)
