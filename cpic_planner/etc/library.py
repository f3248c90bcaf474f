"""What a reference library adds to the noise of the difference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cpic_planner.etc.model import EtcModel, Strategy
from cpic_planner.targets import Targets

__all__ = ["LibraryNoise", "library_flags", "library_noise", "strategy_flags"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class LibraryNoise:
    """Noise of reference frames once their star is scaled to that of the science frames.

    Attributes
    ----------
    halo, even : ndarray
        Factors of the variance of star light, and of light that does not come from the star.
    scale : ndarray
        Factor of the variance that every frame has (clock-induced charge, read noise).
    companion : float
        1 where the library shows the companion's light too.
    peak : ndarray
        Brightness of the brighter of the two stars, over the science star: it must not saturate either.
    speckle : float
        1, or 0 for an idealised library.
    variance_factor : float
        1, or 1/2 where science and reference frames both show the planet.
    """

    halo: FloatArray
    even: FloatArray
    scale: FloatArray
    companion: float
    peak: FloatArray
    speckle: float
    variance_factor: float

    def light(self, halo_e_s: FloatArray, companion_e_s: FloatArray, even_e_s: FloatArray) -> FloatArray:
        """Light and dark charge of a reference frame as they enter the variance, e-/s."""
        return self.halo * halo_e_s + self.even * even_e_s + self.scale * self.companion * companion_e_s


def library_noise(model: EtcModel, targets: Targets, band: str, star_e_s: FloatArray) -> LibraryNoise:
    """Noise of the library that the strategy names.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
    band : str
    star_e_s : ndarray
        Rates of the science stars.

    Notes
    -----
    ``same_star_planet_free``: the star itself, at another time. ``reference_star``: scaled by the ratio of rates,
    ``rho = reference / science``: variance of its star light over ``rho``, of everything else over ``rho^2``.
    ``roll``: the star at another roll angle; each half is the other's reference, and the planet is measured in both.
    ``idealised``: no noise and no drift.
    """
    strategy = model.strategy
    one = np.ones(1)
    if strategy.library == "idealised":
        return LibraryNoise(0.0 * one, 0.0 * one, 0.0 * one, 0.0, one, 0.0, 1.0)
    if strategy.library == "reference_star":
        other = strategy.reference_star
        assert other is not None  # checked by the strategy
        column = model.passbands.names.index(band)
        rate = model.passbands.star_rate_e_s(
            other.v_mag, other.teff_k, other.log_g, other.metallicity, model.instrument.telescope.area_cm2
        )[..., column]
        ratio = np.asarray(rate, float) / star_e_s
        return LibraryNoise(1.0 / ratio, 1.0 / ratio**2, 1.0 / ratio**2, 0.0, np.maximum(ratio, 1.0), 1.0, 1.0)
    return LibraryNoise(one, one, one, 1.0, one, 1.0, 0.5 if strategy.library == "roll" else 1.0)


def library_flags(model: EtcModel) -> tuple[str, ...]:
    """Caveats of the library."""
    return strategy_flags(model.strategy)


def strategy_flags(strategy: Strategy) -> tuple[str, ...]:
    """Caveats of the library that a strategy names."""
    return {
        "idealised": ("idealised",),
        "reference_star": ("reference_colour_not_modelled",),
        "roll": (),
        "same_star_planet_free": (),
    }[strategy.library]
