"""Sizes of the numerical settings of the optics, of the drift and its sampling, and of sources left out.

What the settings cost are remainders of the quadratures, and rounding. A Gauss-Legendre rule of n nodes misses of a
wave ``cos(phi s)``, -1 <= s <= 1, at most

    E_n(phi) = 2^(2n) (n!)^4 / ((2n + 1) ((2n)!)^3) phi^(2n)

of its amplitude (remainder of the rule, its highest derivative at its largest). Over a band the image at u lambda/D
holds waves up to ``phi = pi u Delta`` with Delta the relative width of the band; over a pixel waves up to
``phi = pi (pixel / (lambda/D))``, widened by the jitter. Few waves are that fast: the factors below lower the phase so
that the remainder follows the differences that were measured between the images of each rule and those of nine
wavelengths and six nodes a pixel, in the four visible bands (`reports/effect_ledger`).
"""

import functools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cpic_core import FloatArray
from simulator.config import Drift
from simulator.detectors import Sizes, sizes
from simulator.imaging import PsfMetrics
from simulator.ledger.case import CameraCase, largest_speckles
from simulator.ledger.light import PlanetPlace, SourceLight
from simulator.signal import drift_halo

_PIXEL_REACH, _WAVE_REACH = 3, 2
# Sources off the axis in single precision: of their light on a pixel, and of their peak anywhere.
_OTHERS_RELATIVE, _OTHERS_NOISE = 4e-6, 4e-8
# What a planet behind the edge of the mask adds to the error of its colour, for as much as the mask hides of it.
_HIDDEN = 0.5


class Lasting(NamedTuple):
    """Variances of aperture sums over that of a pair of visits alone, as if each visit of the programme had them.

    Attributes
    ----------
    common : float
        Of the screen that science visits have in common: times their number.
    orbital : float
        Of what swings with the orbit: what stays in every visit, times their number, and what averages.
    """

    common: float
    orbital: float


@dataclass(frozen=True, eq=False)
class OpticsCase:
    """The inputs that these sizes are worked out for.

    Attributes
    ----------
    camera : CameraCase
        Pixels, planets and their noise.
    metrics : PsfMetrics
    optics : Optics
    drift : Drift
    star_e_s : float
        Rate of the central star.
    wavelength_nm : float
        Middle of the band.
    visit_s : float
        Length of the visit.
    n_epochs : int
        At which the walk is sampled without the ledger.
    speckle_share, walk_share : tuple of float
        Of every measured planet, the largest part of the variance of its aperture sum that speckles make, and the walk
        alone.
    lasting : tuple of Lasting
        Of every measured planet, what speckles of a programme have besides those of its visits alone.
    moved : bool
        Whether the star stands off the mask.
    star_radius_mas : float
        Angular radius of the central star.
    """

    camera: CameraCase
    metrics: PsfMetrics
    optics: "Optics"
    drift: Drift
    star_e_s: float
    wavelength_nm: float
    visit_s: float
    n_epochs: int
    speckle_share: tuple[float, ...]
    walk_share: tuple[float, ...]
    lasting: tuple["Lasting", ...]
    moved: bool
    star_radius_mas: float = 0.0

    @functools.cached_property
    def _around_mean(self) -> FloatArray:
        """Starlight of a pixel, or the mean around it where that is brighter."""
        star = self.camera.light.star_e_s
        return np.maximum(star, _box(star, _WAVE_REACH, largest=False))

    @functools.cached_property
    def _around_most(self) -> FloatArray:
        """Brightest starlight around a pixel."""
        return _box(self.camera.light.star_e_s, _PIXEL_REACH, largest=True)

    def _around(self, planet: PlanetPlace) -> float:
        """Return the starlight around the pixels of an aperture over their own: what is misplaced comes from there."""
        if not planet.weights.size:
            return 1.0
        around = float((planet.weights * self._around_mean[planet.place]).sum())
        own = float((planet.weights * self.camera.light.star_e_s[planet.place]).sum())
        return around / own if own > 0 else 1.0

    def wavelength_nodes(self, n_nodes: int) -> Sizes:
        """Return the size of taking so many wavelengths a band."""
        case, t = self.camera, self.camera.exposure_s
        change = self.optics.wavelength_error(n_nodes, case.light.radius_arcsec) * self._around_mean * t
        peak = self.optics.wavelength_peak_error(n_nodes)
        for source in case.light.sources:
            # With one wavelength the wings of a star are another pattern; with more it has as many as it needs.
            wings = float(self.optics.wavelength_error(1, 1.0 + source.distance_arcsec)) if n_nodes == 1 else 0.0
            level = source.peak_e_s * (min(wings, 1.0) if source.distance_arcsec > 1.0 else peak + 1e-3 * wings)
            change = change + (level if source.kind == "star" else source.peak_e_s * peak) * t
        halos, speckles = [], []
        for planet in case.light.planets:
            separation = math.hypot(planet.x_arcsec, planet.y_arcsec)
            halos.append(self.optics.wavelength_halo_error(n_nodes, separation, planet.inside) * self._around(planet))
            speckles.append(self.optics.wavelength_speckle_error(n_nodes, separation, planet.inside))
        hidden = case.over_planets(lambda planet: planet.hidden)
        found = self._of(change, self.optics.wavelength_flux_error(n_nodes) * (1.0 + _HIDDEN * hidden), halos, speckles)
        if n_nodes == 1:
            stars = [source.aperture_e_s for source in case.light.sources if source.kind == "star"]
            others = sum(stars, np.zeros(len(case.variances)))
            found["snr"] += case.snr_added(self._white(others))
        return found

    def pixel_nodes(self, n_nodes: int) -> Sizes:
        """Return the size of taking so many nodes a pixel and axis; all sources but the star are in closed form."""
        case = self.camera
        planets = case.light.planets
        halos = [self.optics.pixel_halo_error(n_nodes, planet.inside) * self._around(planet) for planet in planets]
        error = min(self.optics.pixel_error(n_nodes), LARGEST)
        speckles = [self.optics.pixel_speckle_error(n_nodes)] * len(planets)
        return self._of(error * self._around_most * case.exposure_s, 0.0, halos, speckles)

    def precision(self) -> Sizes:
        """Return the size of taking fields in single precision."""
        case = self.camera
        peak = self.star_e_s * self.metrics.peak_off_axis
        change = precision_error_e_s(case.light.star_e_s, peak) + _OTHERS_RELATIVE * case.light.total_e_s
        change = change + _OTHERS_NOISE * sum(source.peak_e_s for source in case.light.sources)
        halos, pixels = [], case.light.aperture_pixels
        for planet in case.light.planets:
            error = float(precision_error_e_s(planet.halo_e_s / pixels, peak))
            halos.append(error * pixels / max(planet.halo_e_s, 1e-300))
        return self._of(change * case.exposure_s, 1e-7, halos, halos)

    def epochs(self, n_epochs: int) -> Sizes:
        """Return the size of taking fewer epochs of the walk.

        The mean of a walk over a visit has a variance higher by ``1 / (2 e^2)`` when it is sampled in the middle of e
        intervals (its covariance is ``min(s, s')``), and a frame is at most half an interval away from its epoch.
        """
        if n_epochs >= self.n_epochs:
            return sizes(0.0)
        fewer = 1.0 / n_epochs - 1.0 / self.n_epochs
        away = self.drift.walk_nm_per_sqrt_hour * math.sqrt(self.visit_s / 3600.0 * 0.5 * fewer)
        more = 0.5 * (1.0 / n_epochs**2 - 1.0 / self.n_epochs**2)
        snr = max((0.5 * share * more for share in self.walk_share), default=0.0)
        return sizes(self._speckles(away), snr=snr)

    def no_drift(self) -> Sizes:
        """Return the size of a wavefront that stands still."""
        rms = math.hypot(self.drift.visit_nm, self.drift.walk_nm_per_sqrt_hour * math.sqrt(self.visit_s / 3600.0))
        return sizes(self._speckles(rms), snr=max(self.speckle_share, default=0.0))

    def no_common(self) -> Sizes:
        """Return the size of science visits without the screen that references have not."""
        return sizes(self._speckles(self.drift.common_nm), snr=self._left([part.common for part in self.lasting]))

    def no_orbit(self) -> Sizes:
        """Return the size of a wavefront that does not swing with the orbit."""
        # Low orders leave less than a screen in the hole, and as much around the mask.
        largest = math.sqrt(2.0) * self.drift.orbital_nm
        return sizes(self._speckles(largest), snr=self._left([part.orbital for part in self.lasting]))

    def _left(self, ratios: list[float]) -> float:
        """Return the size of parts of the variance of speckles: half their share of all that the programme has."""
        parts = zip(self.speckle_share, self.lasting, ratios, strict=True)
        return max((0.5 * share * ratio / (1.0 + share * sum(every)) for share, every, ratio in parts), default=0.0)

    def _speckles(self, rms_nm: float) -> float:
        """Return the largest change of a pixel by a wavefront error."""
        case, t = self.camera, self.camera.exposure_s
        peak = self.star_e_s * self.metrics.peak_off_axis
        radius, slope = case.light.radius_arcsec, self.drift.psd_slope
        lit = (case.light.total_e_s > 0) & (not self.moved)
        halo = drift_halo(self.metrics, radius, rms_nm, slope, self.wavelength_nm) * lit
        change = largest_speckles(case.light.star_e_s * t, halo * peak * t)
        return case.mean_change(self._padded(change))

    def source(self, source: SourceLight, *, measured: bool) -> Sizes:
        """Return the size of a source left out.

        Parameters
        ----------
        source : SourceLight
        measured : bool
            Whether it is one of the planets that are measured.
        """
        case = self.camera
        pixel = case.mean_change(source.peak_e_s * case.exposure_s)
        if measured:
            return sizes(pixel, 1.0)
        return sizes(pixel, snr=case.snr_added(self._white(source.aperture_e_s)))

    def spread_light(self, pixel_e_s: float, aperture_e_s: float) -> Sizes:
        """Return the size of light spread over many pixels.

        Parameters
        ----------
        pixel_e_s, aperture_e_s : float
            On a pixel and in an aperture.
        """
        case = self.camera
        added = self._white(np.full(len(case.variances), aperture_e_s))
        return sizes(case.mean_change(pixel_e_s * case.exposure_s), snr=case.snr_added(added))

    def _white(self, aperture_e_s: FloatArray) -> list[float]:
        return [self.camera.light_variance_e2(float(light)) for light in aperture_e_s]

    def _padded(self, change: FloatArray) -> FloatArray:
        """Return a change on the stamp, nothing on the pixels around it."""
        return np.concatenate([change.ravel(), np.zeros(self.camera.light.outside_e_s.size)])

    def _of(self, change_e: FloatArray, flux: float, halo_errors: list[float], speckle_errors: list[float]) -> Sizes:
        """Return sizes from changes of the star's pixels and the planet, and relative errors of light and speckles."""
        parts, shares = [], zip(self.camera.variances, self.speckle_share, strict=True)
        for halo, speckle, (variances, share) in zip(halo_errors, speckle_errors, shares, strict=True):
            part = 0.5 * variances["halo"] / max(sum(variances.values()), 1e-300)
            parts.append(min(halo, LARGEST) * part + min(speckle, LARGEST) * share)
        return sizes(self.camera.mean_change(self._padded(change_e)), flux, flux + max(parts, default=0.0))


def _box(image: FloatArray, reach: int, *, largest: bool) -> FloatArray:
    """Return the largest value, or mean, of the square of pixels within ``reach`` of each."""
    n = len(image)
    for axis in (0, 1):
        padded = np.pad(image, [(reach, reach) if part == axis else (0, 0) for part in (0, 1)])
        parts = [padded.take(range(shift, shift + n), axis=axis) for shift in range(2 * reach + 1)]
        image = np.maximum.reduce(parts) if largest else np.add.reduce(parts) / len(parts)
    return image


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
    """Return the largest error of a Gauss-Legendre mean of a wave, at most 1.7 of its amplitude.

    Parameters
    ----------
    n_nodes : int
        Of the rule.
    phase : ndarray or float
        Half-range of the wave, rad.
    """
    n = int(n_nodes)
    log = 2 * n * math.log(2.0) + 4 * math.lgamma(n + 1) - math.log(2 * n + 1) - 3 * math.lgamma(2 * n + 1)
    with np.errstate(divide="ignore"):
        power = np.exp(np.minimum(log + 2 * n * np.log(np.asarray(phase, dtype=np.float64)), 1.0))
    return np.minimum(power, LARGEST)


@dataclass(frozen=True)
class Optics:
    """The properties that the quadratures of a band depend on.

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
        """Return the relative error of the light of a source at a distance from it.

        Parameters
        ----------
        n_nodes : int
            Wavelengths of the band.
        separation_arcsec : ndarray or float
            From the source.
        """
        slower = 1.0 - _SLOWER * math.exp(-_FADING * (n_nodes - 1))
        u = np.asarray(separation_arcsec, dtype=np.float64) / self.lambda_d_arcsec
        return gauss_remainder(n_nodes, slower * math.pi * self.relative_width * u)

    def wavelength_flux_error(self, n_nodes: int) -> float:
        """Return the relative error of the aperture sum of a planet: ``0.11 Delta^2`` with one wavelength."""
        return _FLUX.get(n_nodes, 1e-3) * self.relative_width ** (2 * n_nodes)

    def wavelength_peak_error(self, n_nodes: int) -> float:
        """Return the largest error of a pixel in the image of a source off the axis, relative to its peak."""
        return _PEAK.get(n_nodes, 1e3) * self.relative_width ** (2 * n_nodes)

    def pixel_error(self, n_nodes: int) -> float:
        """Return the error of a pixel of the star relative to the light around it, both axes together."""
        # A box of half width 1/2 and a normal law of width j have the second moment of a box sqrt(1 + 12 j^2) wider.
        wider = math.sqrt(1.0 + 12.0 * (self.jitter_arcsec / self.pixel_arcsec) ** 2)
        return 2.0 * float(gauss_remainder(n_nodes, math.pi * self.pixel_arcsec / self.lambda_d_arcsec * wider))

    def wavelength_halo_error(self, n_nodes: int, separation_arcsec: float, inside: bool) -> float:
        """Return the error of the starlight in an aperture, relative to the light around it.

        Parameters
        ----------
        n_nodes : int
            Wavelengths of the band.
        separation_arcsec : float
            Of the aperture from the star.
        inside : bool
            Whether it lies in the dark hole.
        """
        return _HALO_WAVES[not inside] * self._fast_waves(n_nodes, separation_arcsec)

    def wavelength_speckle_error(self, n_nodes: int, separation_arcsec: float, inside: bool) -> float:
        """Return the relative error of the rms of aperture sums that a drifting wavefront leaves.

        Parameters
        ----------
        n_nodes, separation_arcsec, inside
            As of `wavelength_halo_error`.
        """
        factor = _SPECKLE_WAVES.get(n_nodes, _SPECKLE_MORE_WAVES)[not inside]
        return factor * self._fast_waves(n_nodes, separation_arcsec)

    def _fast_waves(self, n_nodes: int, separation_arcsec: float) -> float:
        return float(self.wavelength_error(n_nodes, max(separation_arcsec, _LEAST_WAVES * self.lambda_d_arcsec)))

    def pixel_halo_error(self, n_nodes: int, inside: bool) -> float:
        """Return the error of the starlight in an aperture, relative to the light around it.

        Parameters
        ----------
        n_nodes : int
            A pixel and axis.
        inside : bool
            Whether the aperture lies in the dark hole.
        """
        factor = _HALO_PIXEL[n_nodes][not inside] if n_nodes in _HALO_PIXEL else _MOST_HALO_PIXEL
        return factor * self.pixel_error(n_nodes)

    def pixel_speckle_error(self, n_nodes: int) -> float:
        """Return the relative error of the rms of aperture sums that a drifting wavefront leaves."""
        return _SPECKLE_PIXEL * self.pixel_error(n_nodes)


def precision_error_e_s(light_e_s: FloatArray | float, peak_e_s: float) -> FloatArray:
    """Return the error of starlight by fields in single precision, whose noise beats with the light that is there.

    Parameters
    ----------
    light_e_s : ndarray or float
        That is there, e-/s.
    peak_e_s : float
        Of the unmasked star.
    """
    light = np.asarray(light_e_s, dtype=np.float64)
    noise = SINGLE_NOISE * peak_e_s
    return 2.0 * np.sqrt(light * noise) + noise + SINGLE_RELATIVE * light
