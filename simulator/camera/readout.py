"""Reading out: noise of the amplifier and structure of the bias."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simulator.camera.stage import KERNELS, Exposure, FloatArray, Work
from simulator.lazy import load_kernels

__all__ = ["BiasDrift", "Interference", "ReadNoise", "Stripes"]


@dataclass(frozen=True)
class ReadNoise:
    """Gaussian noise of the output amplifier, from electrons at the output to ADU."""

    switch: str = "read_noise"

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Leave the mean as it is."""

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add the noise."""
        kernels = load_kernels(KERNELS)
        detector = exposure.detector
        if detector.read_noise_e > 0:
            kernels.add_normal(work.image.reshape(-1), detector.read_noise_e / detector.gain_e_adu, rng)


@dataclass(frozen=True)
class Stripes:
    """Fixed vertical stripes of the bias, one offset a column, from the calibration set."""

    switch: str = "stripes"

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Add the stripes."""
        if exposure.stripe_adu is not None:
            image += exposure.stripe_adu

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add the stripes."""
        self.expect(work.image, exposure)


@dataclass(frozen=True)
class Interference:
    """Electrical pick-up during readout: a sine in the order in which pixels are read, of random phase in each frame.

    ``interference_period_columns`` need not fit a line, so that the waves run obliquely across the rows.
    """

    switch: str = "interference"

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Leave the mean as it is: phases are random."""

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add one wave."""
        self.add_wave(work.image, exposure, np.exp(2j * np.pi * rng.random()))

    def add_wave(self, image: FloatArray, exposure: Exposure, phasor: complex) -> None:
        """Add a wave of the configured amplitude times that of the phasor, and its phase."""
        structure, (rows, columns) = exposure.detector.bias_structure, image.shape
        if structure.interference_adu == 0:
            return
        turn = 2.0 * np.pi / structure.interference_period_columns
        row = turn * exposure.detector.n_columns * (exposure.place.first_row + np.arange(rows)) + np.angle(phasor)
        column = turn * (exposure.place.first_column + np.arange(columns))
        # sin(a + b) of a row's and a column's angle
        wave = np.stack([np.sin(row), np.cos(row)], axis=1) @ np.stack([np.cos(column), np.sin(column)])
        wave *= structure.interference_adu * abs(phasor)
        image += wave


@dataclass(frozen=True)
class BiasDrift:
    """Level of the bias from frame to frame: Gaussian, the same for all pixels of a frame."""

    switch: str = "bias_drift"

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Leave the mean as it is."""

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add one offset."""
        work.image += exposure.detector.bias_structure.drift_adu * rng.standard_normal()
