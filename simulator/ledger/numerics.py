"""What the numerical settings of the optics cost: remainders of the quadratures, and rounding.

A Gauss-Legendre rule of n nodes misses of a wave ``cos(phi s)``, -1 <= s <= 1, at most

    E_n(phi) = 2^(2n) (n!)^4 / ((2n + 1) ((2n)!)^3) phi^(2n)

of its amplitude (remainder of the rule, its highest derivative at its largest). Over a band the image at u lambda/D
holds waves up to ``phi = pi u Delta`` with Delta the relative width of the band; over a pixel waves up to
``phi = pi (pixel / (lambda/D))``, widened by the jitter. Few waves are that fast: the factors below lower the phase so
that the remainder follows the differences that were measured between the images of each rule and those of nine
wavelengths and six nodes a pixel, in the four visible bands (`reports/effect_ledger`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Optics", "gauss_remainder", "precision_error_e_s"]

FloatArray = NDArray[np.float64]
LARGEST = 1.7  # of a remainder, in units of the light around: measured for one node
# Share of the fastest wave's phase that the remainder acts as if it had: 1 - 0.44 exp(-0.42 (n - 1)).
_SLOWER, _FADING = 0.44, 0.42
# Of starlight in an aperture, over the remainder and the light around: in the dark hole and elsewhere. Light of the
# arms beside the hole reaches into it, so that the wave is never slower than at ten lambda/D.
_HALO_WAVES, _LEAST_WAVES = (2.0, 4.0), 10.0
_HALO_PIXEL = {1: (0.16, 0.75), 2: (0.65, 5.5), 3: (6.0, 24.0), 4: (60.0, 60.0)}
_MOST_HALO_PIXEL = 600.0
# Of the rms of speckles that drift leaves, over the remainder: errors of single speckles average out.
_SPECKLE_WAVES, _SPECKLE_MORE_WAVES, _SPECKLE_PIXEL = {1: (0.5, 1.1), 2: (0.15, 0.3)}, (0.07, 0.1), 0.5
# Relative change of a planet's aperture sum by the number of wavelengths, over Delta^(2n); that of its brightest pixel.
_FLUX = {1: 0.11, 2: 5e-3}
_PEAK = {1: 0.26, 2: 8.0, 3: 100.0}
# Rounding of a field in single precision: intensity of its noise over the peak, and relative error of bright light.
SINGLE_NOISE, SINGLE_RELATIVE = 3e-17, 6e-7


def gauss_remainder(n_nodes: int, phase: FloatArray | float) -> FloatArray:
    """Largest error of a Gauss-Legendre mean of a wave of half-range ``phase`` (rad), at most 1.7."""
    n = int(n_nodes)
    log = 2 * n * math.log(2.0) + 4 * math.lgamma(n + 1) - math.log(2 * n + 1) - 3 * math.lgamma(2 * n + 1)
    with np.errstate(divide="ignore"):
        power = np.exp(np.minimum(log + 2 * n * np.log(np.asarray(phase, dtype=np.float64)), 1.0))
    return np.minimum(power, LARGEST)


@dataclass(frozen=True)
class Optics:
    """What the quadratures of a band depend on.

    Attributes
    ----------
    relative_width : float
        Of the band.
    lambda_d_arcsec, pixel_arcsec, jitter_arcsec : float
    """

    relative_width: float
    lambda_d_arcsec: float
    pixel_arcsec: float
    jitter_arcsec: float

    def wavelength_error(self, n_nodes: int, separation_arcsec: FloatArray | float) -> FloatArray:
        """Relative error of the light of a source at a distance from it, with so many wavelengths."""
        slower = 1.0 - _SLOWER * math.exp(-_FADING * (n_nodes - 1))
        u = np.asarray(separation_arcsec, dtype=np.float64) / self.lambda_d_arcsec
        return gauss_remainder(n_nodes, slower * math.pi * self.relative_width * u)

    def wavelength_flux_error(self, n_nodes: int) -> float:
        """Relative error of the aperture sum of a planet: ``0.11 Delta^2`` with one wavelength."""
        return _FLUX.get(n_nodes, 1e-3) * self.relative_width ** (2 * n_nodes)

    def wavelength_peak_error(self, n_nodes: int) -> float:
        """Largest error of a pixel in the image of a source off the axis, relative to its peak."""
        return _PEAK.get(n_nodes, 1e3) * self.relative_width ** (2 * n_nodes)

    def pixel_error(self, n_nodes: int) -> float:
        """Error of a pixel of the star relative to the light around it, both axes together."""
        # A box of half width 1/2 and a normal law of width j have the second moment of a box sqrt(1 + 12 j^2) wider.
        wider = math.sqrt(1.0 + 12.0 * (self.jitter_arcsec / self.pixel_arcsec) ** 2)
        return 2.0 * float(gauss_remainder(n_nodes, math.pi * self.pixel_arcsec / self.lambda_d_arcsec * wider))

    def wavelength_halo_error(self, n_nodes: int, separation_arcsec: float, inside: bool) -> float:
        """Error of the starlight in an aperture in or beyond the dark hole, relative to the light around it."""
        return _HALO_WAVES[not inside] * self._fast_waves(n_nodes, separation_arcsec)

    def wavelength_speckle_error(self, n_nodes: int, separation_arcsec: float, inside: bool) -> float:
        """Relative error of the rms of aperture sums that a drifting wavefront leaves in or beyond the dark hole."""
        factor = _SPECKLE_WAVES.get(n_nodes, _SPECKLE_MORE_WAVES)[not inside]
        return factor * self._fast_waves(n_nodes, separation_arcsec)

    def _fast_waves(self, n_nodes: int, separation_arcsec: float) -> float:
        return float(self.wavelength_error(n_nodes, max(separation_arcsec, _LEAST_WAVES * self.lambda_d_arcsec)))

    def pixel_halo_error(self, n_nodes: int, inside: bool) -> float:
        """Error of the starlight in an aperture in or beyond the dark hole, relative to the light around it."""
        factor = _HALO_PIXEL[n_nodes][not inside] if n_nodes in _HALO_PIXEL else _MOST_HALO_PIXEL
        return factor * self.pixel_error(n_nodes)

    def pixel_speckle_error(self, n_nodes: int) -> float:
        """Relative error of the rms of aperture sums that a drifting wavefront leaves."""
        return _SPECKLE_PIXEL * self.pixel_error(n_nodes)


def precision_error_e_s(light_e_s: FloatArray | float, peak_e_s: float) -> FloatArray:
    """Error of starlight by fields in single precision: noise of the field beats with the light that is there."""
    light = np.asarray(light_e_s, dtype=np.float64)
    noise = SINGLE_NOISE * peak_e_s
    return 2.0 * np.sqrt(light * noise) + noise + SINGLE_RELATIVE * light
