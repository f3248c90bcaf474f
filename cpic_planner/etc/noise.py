"""From rates to signal-to-noise: one noise model for every question."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cpic_planner.etc.camera import FrameCamera
from cpic_planner.etc.cosmic_loss import frames_per_clean
from cpic_planner.etc.counting_light import LIGHT_ARRAYS, CountingLight, counted
from cpic_planner.etc.frames import PROBLEM_ARRAYS, FrameProblem
from cpic_planner.etc.photon_counting import counting_law
from cpic_planner.etc.rates import ApertureRates
from simulator.camera.gain import noise_factor2

__all__ = ["Objective", "ReadMode", "StackNoise", "frame_problem", "own_noise", "stack_noise"]

FloatArray = NDArray[np.float64]
Objective = Literal["snr", "significance"]
ReadMode = Literal["analogue", "photon_counting"]


@dataclass(frozen=True)
class StackNoise:
    """Signal and noise of a summed stack, in input-referred electrons.

    ``snr`` = S / sqrt(Var S) with the source's own noise; ``significance`` = S / sigma without the planet. ``terms``
    are the parts of Var S: light of the science frames by origin, smear, clock-induced charge, read noise and rounding,
    then ``reference`` (all of that in the reference frames), ``background_mean`` (error of the mean background) and
    ``speckle`` and ``companion_wings`` (what does not average).
    """

    signal_e: FloatArray
    terms: dict[str, FloatArray]
    snr: FloatArray
    significance: FloatArray

    @property
    def white(self) -> FloatArray:
        """What of `quiet` averages with time."""
        return self.quiet - self.terms["speckle"] - self.terms["companion_wings"]

    @property
    def quiet(self) -> FloatArray:
        """Variance that a significance is measured by: without the planet's own light and the mean's error."""
        return np.asarray(sum(part for name, part in self.terms.items() if name not in ("planet", "background_mean")))


def _factor2(em_gain: FloatArray, camera: FrameCamera) -> FloatArray:
    if camera.register_stages == 0:
        return np.full(em_gain.shape, camera.light_factor)
    return noise_factor2(em_gain, camera.register_stages)


def frame_problem(
    rates: ApertureRates,
    camera: FrameCamera,
    *,
    reference_ratio: float = 1.0,
    objective: Objective = "snr",
    em_gain: float | None = None,
    mode: ReadMode = "analogue",
    counting_sigma: float = 5.0,
) -> FrameProblem:
    """What the solver of frames needs of an aperture's rates.

    Parameters
    ----------
    rates : ApertureRates
    camera : FrameCamera
    reference_ratio : float
        Reference frames per science frame.
    objective : {"snr", "significance"}
        With or without the planet's own noise and the error of the mean background.
    em_gain : float, optional
        Fixed gain.
    mode : {"analogue", "photon_counting"}
    counting_sigma : float
        Threshold of photon counting, in units of the read noise.

    Notes
    -----
    Everything but the planet is measured twice, in science and in reference frames. A sum over a circle has the
    variance of ``sum(w^2)`` pixels, fewer than its area.
    """
    with_planet = objective == "snr"
    level = 1.0 + 1.0 / rates.background_apertures if with_planet else 1.0
    share = rates.noise_fraction * rates.variance_factor / rates.rdi_throughput**2
    pixels = share * rates.aperture_pixels
    quiet, reference = rates.background_e_s, rates.reference_light_e_s / reference_ratio
    twice = 1.0 + rates.reference_scale / reference_ratio
    light = camera.light_factor
    smear = rates.smear_e + rates.reference_smear_e / reference_ratio
    alpha = light * (level * share * (quiet + reference) + (_own(rates) if with_planet else 0.0))
    arrays: dict[str, Any] = dict(
        zip(
            PROBLEM_ARRAYS,
            np.broadcast_arrays(
                alpha,
                level * (pixels * camera.cic_e * twice + light * share * smear),
                level * pixels * camera.read_variance_e2 * twice,
                rates.planet_e_s,
                *_residual(rates, level),
                np.asarray(rates.loss_per_s, float),
                rates.peak_columns_e_s,
                rates.peak_hole_e_s,
                rates.tail_e_s,
            ),
            strict=True,
        )
    )
    counting = None
    if mode == "photon_counting":
        gain = camera.em_gain_max if em_gain is None else em_gain
        law = counting_law(gain, camera.register_stages, camera.read_noise_e, counting_sigma * camera.read_noise_e)
        parts: dict[str, Any] = dict(
            zip(
                LIGHT_ARRAYS,
                np.broadcast_arrays(
                    rates.planet_e_s / rates.aperture_pixels,
                    quiet / rates.aperture_pixels,
                    _reference_pixel(rates.reference_light_e_s, rates),
                    rates.smear_e / rates.aperture_pixels + camera.cic_e,
                    _reference_pixel(rates.reference_smear_e, rates) + camera.cic_e,
                    np.asarray(pixels, float),
                    pixels * (level - 1.0),
                    level * pixels * rates.reference_scale / reference_ratio,
                    arrays["alpha_e_s"],
                )[:-1],
                strict=True,
            )
        )
        counting = CountingLight(**parts, law=law, own_noise=with_planet)
    return FrameProblem(**arrays, camera=camera, em_gain=em_gain, counting=counting)


def own_noise(rates: ApertureRates, camera: FrameCamera) -> FloatArray:
    """Return the variance of the planet's own light per second, before the gain register's excess noise, e-^2/s."""
    return camera.light_factor * _own(rates)


def _own(rates: ApertureRates) -> FloatArray:
    return rates.source_noise_fraction * rates.variance_factor / rates.rdi_throughput**2 * rates.planet_e_s


def _reference_pixel(scaled: FloatArray, rates: ApertureRates) -> FloatArray:
    """What a pixel of a reference frame holds of some light before it is scaled to the science frames."""
    scale = np.asarray(rates.reference_scale, float)
    return np.where(scale > 0, scaled / np.where(scale > 0, scale, 1.0) / rates.aperture_pixels, 0.0)


def _residual(rates: ApertureRates, level: FloatArray | float) -> list[FloatArray]:
    """Variance that does not average over signal squared, as a polynomial of the visit."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        scale = level * rates.variance_factor / rates.planet_e_s**2
        return [np.where(part > 0, part * scale, 0.0) for part in rates.residual]


def stack_noise(
    rates: ApertureRates,
    exposure_s: ArrayLike,
    n_frames: ArrayLike,
    em_gain: ArrayLike,
    camera: FrameCamera,
    *,
    reference_ratio: float = 1.0,
    mode: ReadMode = "analogue",
    counting_sigma: float = 5.0,
) -> StackNoise:
    """Signal and noise of ``n_frames`` frames.

    ``Var = {F^2(g) [S + (1 + N/M) (B + smear + a0 cic)] + (1 + N/M) a0 (RN^2 + K^2/12) / g^2} / P``, summed over
    frames, with the weights of cut pixels squared, divided by the square of the RDI throughput and by the fraction
    ``P`` of frames that no particle voids; plus ``(N t sigma)^2`` of the residual light, which does not average.
    ``snr`` adds the error of the mean background. Where photons are counted, the terms of the white noise are
    ``counting`` (science frames) and ``reference``.
    """
    exposure, frames, gain = (np.asarray(item, float) for item in (exposure_s, n_frames, em_gain))
    stack = frames * frames_per_clean(rates.loss_per_s, exposure) * rates.variance_factor / rates.rdi_throughput**2
    scale = rates.reference_scale / reference_ratio
    pixels = stack * rates.noise_fraction * rates.aperture_pixels
    if mode == "photon_counting":
        terms, planet = _counted(rates, exposure, pixels, scale, float(gain.flat[0]), camera, counting_sigma)
    else:
        factor2 = _factor2(gain, camera)
        light = stack * factor2 * rates.noise_fraction
        terms = {
            name: light * getattr(rates, f"{name}_e_s") * exposure
            for name in ("halo", "companion", "sky", "exozodi", "dark")
        }
        terms["smear"] = light * rates.smear_e
        terms["cic"] = pixels * factor2 * camera.cic_e
        terms["read_noise"] = pixels * camera.read_noise_e**2 / gain**2
        terms["rounding"] = pixels * camera.rounding_e**2 / gain**2
        electronic = terms["cic"] + terms["read_noise"] + terms["rounding"]
        of_reference = rates.reference_light_e_s * exposure + rates.reference_smear_e
        terms["reference"] = light * of_reference / reference_ratio + electronic * scale
        planet = stack * factor2 * rates.source_noise_fraction * rates.planet_e_s * exposure
    visit = frames * (exposure + camera.readout_s)
    speckle = (frames * exposure) ** 2 * rates.speckle.variance(visit) * rates.variance_factor
    terms["companion_wings"] = (frames * exposure) ** 2 * rates.wings_e2_s2 * rates.variance_factor
    quiet = sum(terms.values()) + speckle
    terms["background_mean"] = quiet / rates.background_apertures
    terms["speckle"] = speckle
    terms["planet"] = planet
    signal = frames * exposure * rates.planet_e_s
    with np.errstate(divide="ignore", invalid="ignore"):
        snr = np.where(signal > 0, signal / np.sqrt(quiet + terms["background_mean"] + terms["planet"]), 0.0)
        significance = np.where(signal > 0, signal / np.sqrt(quiet), 0.0)
    return StackNoise(signal, terms, snr, significance)


def _counted(
    rates: ApertureRates,
    exposure_s: FloatArray,
    pixels: FloatArray,
    scale: FloatArray,
    em_gain: float,
    camera: FrameCamera,
    counting_sigma: float,
) -> tuple[dict[str, FloatArray], FloatArray]:
    """Terms of white noise where photons are counted, and what the planet's light adds to them."""
    law = counting_law(em_gain, camera.register_stages, camera.read_noise_e, counting_sigma * camera.read_noise_e)
    quiet = (rates.background_e_s * exposure_s + rates.smear_e) / rates.aperture_pixels + camera.cic_e
    held = rates.reference_light_e_s * exposure_s + rates.reference_smear_e
    reference = _reference_pixel(held, rates) + camera.cic_e
    alone = counted(pixels, quiet, law)
    both = counted(pixels, quiet + rates.planet_e_s / rates.aperture_pixels * exposure_s, law)
    with np.errstate(invalid="ignore"):
        planet = np.where(np.isfinite(alone), both - alone, 0.0)
    return {"counting": alone, "reference": counted(pixels * scale, reference, law)}, planet
