"""Collecting charge: photo-electrons and dark current, cosmic rays, non-linearity, full well and blooming."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from simulator.camera.gain import pixel_keys
from simulator.camera.stage import KERNELS, LIMIT_KERNELS, Exposure, FloatArray, Work
from simulator.config.effects import CosmicRayConfig
from simulator.effects.cosmic_rays import draw_cosmic_rays
from simulator.lazy import load_kernels

__all__ = ["Blooming", "CosmicRayHits", "PhotonNoise", "PixelNonlinearity", "compressed"]


@dataclass(frozen=True)
class PhotonNoise:
    """Poisson counts of the collected electrons."""

    switch: str = "photon_noise"

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Leave the mean as it is."""

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Draw the counts."""
        kernels = load_kernels(KERNELS)
        kernels.draw_poisson(
            exposure.mean_e.reshape(-1), exposure.zero.reshape(-1), pixel_keys(rng), work.image.reshape(-1)
        )
        work.charge["collected"] = float(work.image.sum())


@dataclass(frozen=True)
class CosmicRayHits:
    """Charge that particles leave in the pixels; ``rate_per_s_cm2`` is that of the date of the observation."""

    config: CosmicRayConfig
    rate_per_s_cm2: float
    switch: str = "cosmic_rays"

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Leave the mean as it is: particles are events, no level."""

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add the tracks of one exposure."""
        pixels = work.image[exposure.place.rows, exposure.place.columns]
        hits = draw_cosmic_rays(
            self.config, pixels.shape, exposure.detector.pixel_um, exposure.exposure_s, self.rate_per_s_cm2, rng
        )
        rows, columns = np.divmod(hits.pixels, pixels.shape[1])
        pixels[rows, columns] += hits.electrons
        work.cosmic = np.zeros(work.image.shape, dtype=np.bool_)
        work.cosmic[exposure.place.rows, exposure.place.columns][rows, columns] = True
        work.book("cosmic_rays", float(hits.electrons.sum()))
        work.counts["n_cosmic_rays"] = hits.n_events


def compressed(level: FloatArray, loss: float, at_level: float) -> FloatArray:
    """Smooth saturating response ``x / (1 + b x)`` that misses the fraction ``loss`` at ``at_level``."""
    return level / (1.0 + level * (loss / ((1.0 - loss) * at_level)))


@dataclass(frozen=True)
class PixelNonlinearity:
    """A pixel collects less of what comes as it fills up; the missing electrons recombine.

    The curve is ``x / (1 + b x)`` up to the full well, with the loss there of the configuration, the same for all
    pixels; what comes beyond spills without loss. Counts are rounded at random to whole electrons so that the mean
    follows the curve.
    """

    switch: str = "nonlinearity"

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Curve of the mean, and of the variance about it to second order."""
        b, full_well = self._curve(exposure), exposure.detector.full_well_e
        held = np.minimum(image, full_well)
        image -= b * held**2 / (1.0 + b * held)
        if exposure.detector.switches.photon_noise:
            image -= np.where(image < full_well, b / (1.0 + b * held) ** 3 * held, 0.0)

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Curve of the counts."""
        kernels = load_kernels(KERNELS)
        b = self._curve(exposure)
        if b == 0.0:
            return
        before = float(work.image.sum())
        flat = work.image.reshape(-1)
        if not exposure.detector.switches.photon_noise:
            kernels.round_stochastic(flat, pixel_keys(rng))
        kernels.compress_counts(flat, b, exposure.detector.full_well_e, pixel_keys(rng))
        work.book("nonlinearity", float(work.image.sum()) - before)

    @staticmethod
    def _curve(exposure: Exposure) -> float:
        loss = exposure.detector.nonlinearity.pixel_loss_at_full_well
        return loss / ((1.0 - loss) * exposure.detector.full_well_e)


@dataclass(frozen=True)
class Blooming:
    """Pixel full well: the excess spills along the column, half each way; column ends drain what arrives there."""

    switch: str = "blooming"

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Spill the mean."""
        self._spill(image, np.zeros(image.shape, dtype=np.bool_), exposure)

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Spill the counts."""
        bottom, top = self._spill(work.image, work.saturated, exposure)
        work.book("drained_bottom", -bottom)
        work.book("drained_top", -top)
        work.counts["n_saturated_pixels"] = int(np.count_nonzero(work.saturated)) if work.image.size else 0

    @staticmethod
    def _spill(image: FloatArray, spilled: np.ndarray, exposure: Exposure) -> tuple[float, float]:
        kernels = load_kernels(LIMIT_KERNELS)
        part = exposure.place.rows, exposure.place.columns
        bottom, top = kernels.vertical_spill(
            image[part], float(math.floor(exposure.detector.full_well_e)), spilled[part]
        )
        return bottom, top
