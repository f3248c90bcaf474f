"""Collecting charge: photo-electrons, cosmic rays, non-linearity, full well and blooming."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from cpic_core import FloatArray, load_kernels
from simulator.config import FrozenModel
from simulator.detectors.effect import KERNELS, LIMIT_KERNELS, Effect, Exposure, Setting, Work, counted, rounded, sizes
from simulator.detectors.gain import pixel_keys

if TYPE_CHECKING:
    from simulator.detectors.effect import Sizes
    from simulator.ledger import CameraCase, PlanetPlace

COUNTED = ("planet", "halo", "other", "sky", "smear", "dark", "flaws")
"""Origins of the variance of an aperture sum that are counts of electrons with photon noise."""

FullWell = Annotated[float, Field(ge=100, le=1e9)]


class Nonlinearity(FrozenModel):
    """Fractions of the charge missing at two levels: in a pixel at full well, and at the output of the register."""

    pixel_loss_at_full_well: Annotated[float, Field(ge=0, le=0.5)]
    register_loss: Annotated[float, Field(ge=0, le=0.5)]
    register_loss_at_e: Annotated[float, Field(gt=0, le=1e9)]


class PhotonNoise(Effect):
    """Poisson counts of the collected electrons."""

    switch, label, law = "photon_noise", "photon noise", "Poisson"
    stage, in_sums, always = "charge", "per_electron", True
    needs = "exposure"
    frame_s = 4e-4

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Draw the counts; with the switch off, collect the mean."""
        if self.on(exposure.detector):
            mean, zero = exposure.mean_e.reshape(-1), exposure.zero.reshape(-1)
            load_kernels(KERNELS).draw_poisson(mean, zero, pixel_keys(rng), work.image.reshape(-1))
        else:
            work.image[...] = exposure.mean_e
        work.charge["collected"] = float(work.image.sum())

    def size(self, case: CameraCase) -> Sizes:
        """Return the share of counts in the variance."""
        return sizes(case.variance_change(case.noise.factor2 * case.counted_e), snr=case.snr_share(*COUNTED))


class InfraredPhotonNoise(PhotonNoise):
    """Poisson counts of the light alone."""

    def draw(self, work: Work, exposure: Any, rng: np.random.Generator) -> None:
        """Draw the counts; with the switch off, collect the mean."""
        work.image[...] = counted(exposure.light_e, exposure.detector, rng)
        work.book("photons", work.image.sum())

    def draw_sum(self, work: Work, exposure: Exposure, n_frames: int, rng: np.random.Generator) -> None:
        """Draw the counts of light and dark current together."""
        super().draw(work, exposure, rng)


class CosmicRayHits(Effect):
    """Charge that particles leave in the pixels."""

    switch, label, law = "cosmic_rays", "cosmic rays", "tracks at the rate of the date"
    stage, in_sums = "charge", "not_additive"
    needs = "exposure"
    frame_s = 6e-4

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Add the tracks of one exposure."""
        if exposure.tracks is None:
            return
        part = exposure.place.rows, exposure.place.columns
        pixels = work.image[part]
        hits = exposure.tracks(pixels.shape, rng=rng)
        rows, columns = np.divmod(hits.pixels, pixels.shape[1])
        pixels[rows, columns] += hits.electrons
        work.cosmic = np.zeros(work.image.shape, dtype=np.bool_)
        work.cosmic[part][rows, columns] = True
        work.book("cosmic_rays", float(hits.electrons.sum()))
        work.counts["n_cosmic_rays"] = hits.n_events

    def row(self, setting: Setting) -> tuple[str, str]:
        """Return how it is modelled, and why it does not exist; empty if it does."""
        rate, why_not = setting.particles_per_s_cm2, self.why_not(setting)
        law = f"{self.law}, {rate:.3g} /s/cm2" if setting.dated and not why_not else self.law
        return law, why_not or ("" if rate > 0 else "their rate is zero")

    def size(self, case: CameraCase) -> Sizes:
        """Return the size of the charge in a pixel, and of the frames that an aperture loses."""
        t = case.exposure_s
        pixel = case.struck() + case.mean_change(case.hits_per_s * t * case.hits.mean_e)
        return sizes(0.0 if case.reduced else pixel, snr=1.0 - math.exp(-0.5 * case.lost_per_s * t))


class PixelNonlinearity(Effect):
    """A pixel collects less of what comes as it fills up; the missing electrons recombine.

    The curve is ``x / (1 + b x)`` up to the full well, with the loss there of the configuration, the same for all
    pixels; what comes beyond spills without loss. Counts are rounded at random to whole electrons so that the mean
    follows the curve.
    """

    switch, label, law = "nonlinearity", "non-linearity", "pixels and output of the register"
    stage, in_sums = "charge", "not_additive"
    frame_s = 1e-4

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Apply the curve to the mean, and to the variance about it to second order."""
        b, full_well = pixel_curve(exposure.detector), exposure.detector.full_well_e
        held = np.minimum(image, full_well)
        image -= b * held**2 / (1.0 + b * held)
        if exposure.detector.switches.photon_noise:
            image -= np.where(image < full_well, b / (1.0 + b * held) ** 3 * held, 0.0)

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Apply the curve to the counts."""
        b = pixel_curve(exposure.detector)
        if b == 0.0:
            return
        before = float(work.image.sum())
        rounded(work, exposure, rng)
        load_kernels(KERNELS).compress_counts(work.image.reshape(-1), b, exposure.detector.full_well_e, pixel_keys(rng))
        work.book("nonlinearity", float(work.image.sum()) - before)

    def size(self, case: CameraCase) -> Sizes:
        """Return the size of the curves of the pixels and of the output together."""
        if case.reduced:
            return sizes(0.0)
        detector, noise, t = case.detector, case.noise, case.exposure_s
        b = pixel_curve(detector) + case.em_gain * output_curve(detector)
        charge = np.minimum(case.light_e + noise.dark_e + noise.clock_e, detector.full_well_e)
        lost = b * charge**2 / (1.0 + b * charge)
        spread = 2.0 * b * noise.factor2 * charge**2 / case.sigma_e**2

        def slope(planet: PlanetPlace) -> float:
            behind = max(case.behind_e_s(planet), float(case.light.star_e_s[planet.place].max(initial=0.0)))
            return b * t * (2.0 * behind + planet.peak_e_s)

        pixel = float(np.max(lost / case.sigma_e + spread, initial=0.0)) + 2.0 * case.struck() * b * case.hits.typical_e
        return sizes(pixel, case.over_planets(slope))


class Blooming(Effect):
    """Pixel full well: the excess spills along the column, half each way; column ends drain what arrives there."""

    switch, label, law = "blooming", "pixel full well", "the excess blooms along the column"
    stage, in_sums = "charge", "per_electron"
    frame_s = 5e-5

    def expect(self, image: FloatArray, exposure: Exposure) -> None:
        """Spill the mean."""
        self._spill(image, np.zeros(image.shape, dtype=np.bool_), exposure)

    def draw(self, work: Work, exposure: Exposure, rng: np.random.Generator) -> None:
        """Spill the counts."""
        bottom, top = self._spill(work.image, work.saturated, exposure)
        work.book("drained_bottom", -bottom)
        work.book("drained_top", -top)
        work.counts["n_saturated_pixels"] = int(np.count_nonzero(work.saturated)) if work.image.size else 0

    def draw_sum(self, work: Work, exposure: Exposure, n_frames: int, rng: np.random.Generator) -> None:
        """Leave sums of frames as they are: no frame among them reaches the limit."""

    @staticmethod
    def _spill(image: FloatArray, spilled: np.ndarray, exposure: Exposure) -> tuple[float, float]:
        part = exposure.place.rows, exposure.place.columns
        well = float(math.floor(exposure.detector.full_well_e))
        if image[part].max(initial=0.0) <= well:
            return 0.0, 0.0
        bottom, top = load_kernels(LIMIT_KERNELS).vertical_spill(image[part], well, spilled[part])
        return bottom, top

    def size(self, case: CameraCase) -> Sizes:
        """Return the size of what overflows, and whether it may reach a planet."""
        well = case.detector.full_well_e
        pixel = np.max(case.overflow(case.most_e + case.noise.dark_e, well, 1.0), initial=0.0)
        reached = case.over_planets(lambda planet: case.spilled_on(planet, well, 1.0, case.spill.blooms_into))
        return sizes(float(pixel), reached)


def compressed(level: FloatArray, loss: float, at_level: float) -> FloatArray:
    """Return the smooth saturating response ``x / (1 + b x)`` that misses the fraction ``loss`` at ``at_level``."""
    return level / (1.0 + level * curve(loss, at_level))


def curve(loss: float, at_level: float) -> float:
    """Return ``b`` of the response ``x / (1 + b x)`` that misses the fraction ``loss`` at ``at_level``."""
    return loss / ((1.0 - loss) * at_level)


def pixel_curve(detector: Any) -> float:
    """Return ``b`` of the curve of the pixels, 1/e-."""
    return curve(detector.nonlinearity.pixel_loss_at_full_well, detector.full_well_e)


def output_curve(detector: Any) -> float:
    """Return ``b`` of the curve of the register's output, 1/e-."""
    return curve(detector.nonlinearity.register_loss, detector.nonlinearity.register_loss_at_e)
