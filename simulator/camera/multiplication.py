"""The multiplication register: its exact law, charge that its own clocks make, its full well and its amplifier."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from simulator.camera.collection import compressed
from simulator.camera.gain import amplify, stage_probability
from simulator.camera.stage import LIMIT_KERNELS, Exposure, FloatArray, Work
from simulator.lazy import load_kernels

__all__ = ["OutputNonlinearity", "Register", "RegisterClockCharge", "RegisterFullWell"]


@dataclass(frozen=True)
class Register:
    """Random multiplication; without it (switch off) charge is multiplied by the gain exactly."""

    switch: str = "em_register"

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Multiply."""
        image *= exposure.em_gain

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Multiply at random."""
        work.charge["register_in"] = float(work.image.sum())
        if exposure.detector.switches.em_register:
            amplify(work.image.reshape(-1), exposure.em_gain, exposure.detector.register_stages, rng)
        else:
            work.image *= exposure.em_gain
        work.charge["register_out"] = float(work.image.sum())


@dataclass(frozen=True)
class RegisterClockCharge:
    """Electrons that the clocks of the register make, each multiplied by the stages that are left to it.

    ``register_cic_e`` is the mean number made per pixel in one stage.
    """

    switch: str = "register_clock_charge"

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Add the mean: ``c`` times the sum of the gains of all remainders of the register, ``c (g - 1) / p``."""
        detector = exposure.detector
        p = float(stage_probability(exposure.em_gain, detector.register_stages))
        gains = (exposure.em_gain - 1.0) / p if p > 0 else float(detector.register_stages)
        image += detector.register_cic_e * gains

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add single electrons, each through the rest of the register."""
        detector = exposure.detector
        stages = detector.register_stages
        p = float(stage_probability(exposure.em_gain, stages))
        events = int(rng.poisson(detector.register_cic_e * stages * work.image.size))
        places = rng.integers(0, max(work.image.size, 1), size=events)
        left = rng.integers(0, stages, size=events)
        charge = np.ones(events, dtype=np.int64)
        # Stage by stage, all electrons that still have that many stages before them: exact.
        order = np.argsort(-left, kind="stable")
        counts = np.searchsorted(-left[order], -np.arange(stages, 0, -1), side="right")
        grown = charge[order]
        for count in counts:
            if count:
                grown[:count] += rng.binomial(grown[:count], p)
        charge[order] = grown
        np.add.at(work.image.reshape(-1), places, charge)
        work.book("register_clock_charge", float(charge.sum()))


@dataclass(frozen=True)
class RegisterFullWell:
    """Full well of the register: the excess trails into the pixels read next and drains at the end of the row."""

    switch: str = "register_full_well"

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Trail the mean."""
        self._trail(image, np.zeros(image.shape, dtype=np.bool_), exposure)

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Trail the counts."""
        trailed = np.zeros(work.image.shape, dtype=np.bool_)
        work.book("drained_row_ends", -self._trail(work.image, trailed, exposure))
        work.counts["n_register_saturated"] = int(np.count_nonzero(trailed))
        work.saturated |= trailed

    @staticmethod
    def _trail(image: FloatArray, trailed: np.ndarray, exposure: Exposure) -> float:
        kernels = load_kernels(LIMIT_KERNELS)
        return float(kernels.serial_spill(image, float(math.floor(exposure.detector.register_full_well_e)), trailed))


@dataclass(frozen=True)
class OutputNonlinearity:
    """The output falls behind as the register fills: ``x / (1 + b x)`` through the loss of the configuration."""

    switch: str = "nonlinearity"

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Curve of the mean."""
        curve = exposure.detector.nonlinearity
        if curve.register_loss > 0:
            image[...] = compressed(image, curve.register_loss, curve.register_loss_at_e)

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Curve of the output, in electrons: no charge is lost."""
        curve = exposure.detector.nonlinearity
        if curve.register_loss > 0:
            b = curve.register_loss / ((1.0 - curve.register_loss) * curve.register_loss_at_e)
            load_kernels(LIMIT_KERNELS).compress(work.image.reshape(-1), b)
