"""Reading out the visible camera: noise of the amplifier, structure of the bias, rounding of the converter."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from cpic_core import FloatArray, load_kernels
from simulator.config import FrozenModel
from simulator.detectors.effect import KERNELS, Effect, Exposure, Setting, Sizes, Work, sizes
from simulator.detectors.variance import FrameTerm

if TYPE_CHECKING:
    from simulator.ledger import CameraCase

ReadNoiseElectrons = Annotated[float, Field(ge=0, le=1e5)]


class BiasStructure(FrozenModel):
    """Structure of the bias: fixed vertical stripes, horizontal interference, drift of the level."""

    stripe_rms_adu: Annotated[float, Field(ge=0, le=1000)]
    interference_adu: Annotated[float, Field(ge=0, le=1000)]
    interference_period_columns: Annotated[float, Field(ge=2, le=1e5)]
    drift_adu: Annotated[float, Field(ge=0, le=1000)]


class ReadNoise(Effect):
    """Gaussian noise of the output amplifier, from electrons at the output to ADU.

    In sums of frames the rounding of the converter is part of the same draw, so that it runs with its switch off.
    """

    switch, label, law = "read_noise", "read noise", "Gaussian"
    stage, always = "voltage", True
    number = "read_noise_e"
    frame_s, colour = 3e-4, "#444444"

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add the noise."""
        noise = self.rms_adu(exposure.detector)
        if noise > 0:
            load_kernels(KERNELS).add_normal(work.image.reshape(-1), noise, rng)

    def draw_sum(self, work: Work, exposure: Exposure, n_frames: int, rng: np.random.Generator) -> None:
        """Add the noise of all frames and of the rounding of each."""
        rms = math.sqrt(n_frames * (self.rms_adu(exposure.detector) ** 2 + 1.0 / 12.0))
        work.image += rms * rng.standard_normal(work.image.shape)

    def rms_adu(self, detector: Any) -> float:
        """Return the rms in ADU; 0 with the switch off."""
        return float(detector.read_noise_e / detector.gain_e_adu) if self.on(detector) else 0.0

    def added(self, detector: Any, exposure_s: float | None = None) -> FrameTerm:
        """Return the variance at the output."""
        return FrameTerm(output_e2=detector.read_noise_e**2)

    def size(self, case: CameraCase) -> Sizes:
        """Return the share of the variance."""
        return sizes(case.variance_change(case.noise.read_e2), snr=case.snr_share("read"))


class _Bias(Effect):
    """Structure of the bias that a reduction takes out; sizes are of what is left without one."""

    stage, in_sums = "voltage", "left_out"

    def variance_adu2(self, detector: Any) -> float:
        """Return the variance of a pixel from frame to frame, ADU^2."""
        raise NotImplementedError

    def size(self, case: CameraCase) -> Sizes:
        """Return the share of its variance."""
        left, per_adu = 0.0 if case.reduced else 1.0, case.detector.gain_e_adu / case.em_gain
        return sizes(left * case.variance_change(self.variance_adu2(case.detector) * per_adu**2, inside=False))


class Stripes(_Bias):
    """Fixed vertical stripes of the bias, one offset a column, from the calibration set."""

    switch, label, law = "stripes", "stripes of the bias", "one offset a column"
    seeded = True
    number, map_kind = "bias_structure.stripe_rms_adu", "bias"
    frame_s = 5e-5

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Add the stripes."""
        if exposure.stripe_adu is not None:
            image += exposure.stripe_adu

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add the stripes."""
        self.expect(work.image, exposure)

    def draw_sum(self, work: Work, exposure: Exposure, n_frames: int, rng: np.random.Generator) -> None:
        """Leave sums without the fixed bias."""

    def row(self, setting: Setting) -> tuple[str, str]:
        """Return how it is modelled, and why it does not exist; empty if it does."""
        file = self.file_of(setting.detector)
        # The map holds whatever structure the bias has, and no switch takes it off.
        return (f"replaced by the map {file}, level and structure", "") if file else super().row(setting)

    def size(self, case: CameraCase) -> Sizes:
        """Return the size of the largest stripe of what is read."""
        largest = case.largest_stripe_adu * case.detector.gain_e_adu / case.em_gain
        return sizes((0.0 if case.reduced else 1.0) * case.mean_change(largest))


class Interference(_Bias):
    """Electrical pick-up during readout: a sine in the order in which pixels are read, of random phase in each frame.

    ``interference_period_columns`` need not fit a line, so that the waves run obliquely across the rows.
    """

    switch, label, law = "interference", "interference of the bias", "a wave in the order of readout"
    number = "bias_structure.interference_adu"
    frame_s = 2e-4

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add one wave."""
        self.add_wave(work.image, exposure, np.exp(2j * np.pi * rng.random()))

    def draw_sum(self, work: Work, exposure: Exposure, n_frames: int, rng: np.random.Generator) -> None:
        """Add the wave that the phases of all frames leave."""
        self.add_wave(work.image, exposure, np.exp(2j * np.pi * rng.random(n_frames)).sum())

    def add_wave(self, image: FloatArray, exposure: Exposure, phasor: complex) -> None:
        """Add a wave of the configured amplitude times that of the phasor, and its phase.

        Parameters
        ----------
        image : ndarray
            Image in ADU, (y, x), changed in place.
        exposure : Exposure
        phasor : complex
        """
        structure = exposure.detector.bias_structure
        if structure.interference_adu == 0:
            return
        row, column = wave_angles(exposure.detector, image.shape, exposure.place.first_row, exposure.place.first_column)
        row += np.angle(phasor)
        # sin(a + b) of a row's and a column's angle
        wave = np.stack([np.sin(row), np.cos(row)], axis=1) @ np.stack([np.cos(column), np.sin(column)])
        image += wave * (structure.interference_adu * abs(phasor))

    def variance_adu2(self, detector: Any) -> float:
        """Return the variance of a sine of random phase."""
        return float(detector.bias_structure.interference_adu**2 / 2.0)


class BiasDrift(_Bias):
    """Level of the bias from frame to frame: Gaussian, the same for all pixels of a frame."""

    switch, label, law = "bias_drift", "drift of the bias", "one offset a frame"
    number = "bias_structure.drift_adu"
    frame_s = 1e-4

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add one offset."""
        self.draw_sum(work, exposure, 1, rng)

    def draw_sum(self, work: Work, exposure: Exposure, n_frames: int, rng: np.random.Generator) -> None:
        """Add the offsets of all frames."""
        work.image += math.sqrt(n_frames) * exposure.detector.bias_structure.drift_adu * rng.standard_normal()

    def variance_adu2(self, detector: Any) -> float:
        """Return the variance of the level."""
        return float(detector.bias_structure.drift_adu**2)


class Quantisation(Effect):
    """Bias level, rounding to whole ADU and range of the converter; it has no switch and both cameras do it last."""

    switch, label, law = "quantisation", "bias level, quantisation, range of the converter", "cut off and counted"
    stage, fixed = "voltage", True
    term, term_label, colour = "rounding", "rounding to whole ADU", "#BBBBBB"

    def added(self, detector: Any, exposure_s: float | None = None) -> FrameTerm:
        """Return the variance of rounding at the output, uniform over one ADU: of what several reads are reduced to."""
        return FrameTerm(output_e2=detector.gain_e_adu**2 / 12.0)

    def size(self, case: CameraCase) -> Sizes:
        """Return the share of the variance."""
        return sizes(case.variance_change(case.noise.rounding_e2), snr=case.snr_share("rounding"))


def wave_angles(
    detector: Any, shape: tuple[int, ...], first_row: int, first_column: int
) -> tuple[FloatArray, FloatArray]:
    """Return the phases of the interference along rows and columns: that of a pixel is the sum of both.

    Parameters
    ----------
    detector : Detector
    shape : tuple of int
        Rows and columns of the image.
    first_row, first_column : int
        Pixel of the frame that the image begins with.
    """
    turn = 2.0 * np.pi / detector.bias_structure.interference_period_columns
    row = turn * detector.n_columns * (first_row + np.arange(shape[0]))
    return row, turn * (first_column + np.arange(shape[1]))
