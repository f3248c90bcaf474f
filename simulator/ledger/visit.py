"""An observation as the ledger sees it, noise of an aperture sum in it, and sizes of settings of its optics.

Everything comes from known tables alone. What numerical settings cost are remainders of the quadratures, and rounding.
A Gauss-Legendre rule of n nodes misses of a wave ``cos(phi s)``, -1 <= s <= 1, at most

    E_n(phi) = 2^(2n) (n!)^4 / ((2n + 1) ((2n)!)^3) phi^(2n)

of its amplitude (remainder of the rule, its highest derivative at its largest). Over a band the image at u lambda/D
holds waves up to ``phi = pi u Delta`` with Delta the relative width of the band; over a pixel waves up to
``phi = pi (pixel / (lambda/D))``, widened by the jitter. Few waves are that fast: the factors below lower the phase so
that the remainder follows the differences that were measured between the images of each rule and those of nine
wavelengths and six nodes a pixel, in the four visible bands (`reports/truth/effect_ledger`).
"""

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from catalogs import luminosity_from_v, radius_from_luminosity, stellar_parameters
from cpic_core import FloatArray, InputError, NDArray, Outcome
from simulator.camera import FrameNoise, aperture_loss_per_s
from simulator.config import Drift, Instrument, Scene, SceneStar, Timing
from simulator.detectors import FrameTerm, Sizes, rows_of, sizes, sizes as sizes_of
from simulator.effects import SkyLevel, cosmic_ray_rate, sky_rate_e_s_arcsec2, stray_light_parts
from simulator.imaging import PsfMetrics, aperture_sums, centred_axis, overlap_weights, psf_metrics
from simulator.knobs import Knobs
from simulator.ledger.case import (
    CameraCase,
    PlanetPlace,
    SceneLight,
    SourceLight,
    Spill,
    largest_speckles,
    pixel_hits,
    scene_light,
    stamp_flaws,
    sums_possible,
)
from simulator.ledger.inventory import LEFT_OUT, EffectRow, effect_ledger
from simulator.passbands import Passbands
from simulator.signal import INTERLEAVED, drift_halo, overflow, programme_law, sky_pixel_e_s
from simulator.target import Source, extended_rates, scene_sources

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
class VisitCase:
    """An observation with the inputs of all its sizes; made by `visit_of`.

    Attributes
    ----------
    instrument, switched : Instrument
        As configured, and with what is switched off.
    band, start_utc : str
    sources : tuple of Source
        The central star first.
    measured : tuple of str
        Planets that are measured.
    metrics : PsfMetrics
    sky : SkyLevel
    stray : mapping of str to ndarray
        By origin, on the stamp; electrons per second and pixel.
    camera : CameraCase
        Pixels, planets and their noise.
    optics : Optics
    visit_s : float
        Length of the visit.
    n_epochs : int
        At which the drift is sampled without the ledger.
    timing : Timing
        Where in the orbit the visit is taken.
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

    instrument: Instrument
    switched: Instrument
    band: str
    start_utc: str
    sources: tuple[Source, ...]
    measured: tuple[str, ...]
    metrics: PsfMetrics
    sky: SkyLevel
    stray: Mapping[str, NDArray[Any]]
    camera: CameraCase
    optics: "Optics"
    visit_s: float
    n_epochs: int
    timing: Timing
    speckle_share: tuple[float, ...]
    walk_share: tuple[float, ...]
    lasting: tuple[Lasting, ...]
    moved: bool
    star_radius_mas: float

    @property
    def drift(self) -> Drift:
        """Drift of the wavefront."""
        return self.instrument.drift

    @property
    def star_e_s(self) -> float:
        """Rate of the central star."""
        return self.sources[0].rate_e_s

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
        """Return the size of taking fewer epochs of the walk and of the swing with the orbit.

        The mean of a walk over a visit has a variance higher by ``1 / (2 e^2)`` when it is sampled in the middle of e
        intervals (its covariance is ``min(s, s')``), and a frame is at most half an interval away from its epoch. The
        swing is averaged over each interval: its mean over the visit stays, that of a frame is another one.
        """
        if n_epochs >= self.n_epochs:
            return sizes(0.0)
        fewer = 1.0 / n_epochs - 1.0 / self.n_epochs
        walk = self.drift.walk_nm_per_sqrt_hour * math.sqrt(self.visit_s / 3600.0 * 0.5 * fewer)
        more = 0.5 * (1.0 / n_epochs**2 - 1.0 / self.n_epochs**2)
        snr = max((0.5 * share * more for share in self.walk_share), default=0.0)
        return sizes(self._speckles(math.hypot(walk, self._swing_nm(n_epochs))), snr=snr)

    def _swing_nm(self, n_epochs: int) -> float:
        """Return the largest change of the swing in a frame by taking fewer epochs, at whatever phase it begins."""
        if self.drift.orbital_nm == 0:
            return 0.0
        turns, frames = self.visit_s / self.drift.orbital_period_s, self.camera.n_frames
        ours, theirs = (self.timing.phasors(np.linspace(0.0, turns, n + 1)) for n in (self.n_epochs, n_epochs))
        # Frames of one epoch lie in at most two of the longer ones: those of its first and of its last.
        first = -(-np.arange(self.n_epochs + 1) * frames // self.n_epochs)
        longer = np.array([first[:-1], first[1:] - 1]) * n_epochs // frames
        return float(math.sqrt(2.0) * self.drift.orbital_nm * np.abs(ours - theirs[longer]).max())

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
        halo = drift_halo(self.metrics, radius, rms_nm, slope, self.instrument.band(self.band).center_nm) * lit
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


def visit_variance_e2(
    planet: PlanetPlace,
    light: SceneLight,
    noise: FrameNoise,
    *,
    source_noise_fraction: float,
    exposure_s: float,
    n_frames: int,
    speckle_e_s: float,
    line_shift_s: float,
    flaws_e: float = 0.0,
) -> dict[str, float]:
    """Return the variance of the aperture sum of a planet over a visit, by origin, electrons^2.

    Parameters
    ----------
    planet : PlanetPlace
    light : SceneLight
        Light around it.
    noise : FrameNoise
    source_noise_fraction : float
        Mean weight of the planet's light in its aperture.
    exposure_s : float
        Of one frame.
    n_frames : int
    speckle_e_s : float
        Rms of aperture sums that a reference visit leaves.
    line_shift_s : float
        Time that a row of the frame transfer takes, 0 without smear.
    flaws_e : float
        What hot pixels and bad columns add to a frame, times the squared weights.

    Notes
    -----
    ``N (F^2 w (light t + charge) + n (read^2 + rounding)) + (N t speckle)^2``: w the mean squared weight of the pixels
    of the aperture, n the sum of squared weights (`simulator.detectors.effect.aperture_noise_pixels`).
    """
    pixels = light.noise_pixels
    fraction = pixels / light.aperture_pixels
    bright = float((planet.weights**2).sum()) / max(float(planet.weights.sum()), 1e-300) if planet.weights.size else 1.0
    counted = {
        "planet": FrameTerm(rate_e_s=source_noise_fraction * planet.signal_e_s),
        "halo": FrameTerm(rate_e_s=max(fraction, bright) * planet.halo_e_s),
        "other": FrameTerm(rate_e_s=fraction * planet.other_e_s),
        "sky": FrameTerm(rate_e_s=fraction * planet.sky_e_s),
        "smear": FrameTerm(charge_e=fraction * line_shift_s * planet.column_e_s),
        "dark": FrameTerm(charge_e=pixels * noise.dark_e),
        "flaws": FrameTerm(charge_e=flaws_e),
    }
    electronic = {
        "clock": FrameTerm(charge_e=pixels * noise.clock_e),
        "read": FrameTerm(output_e2=pixels * noise.read_e2),
        "rounding": FrameTerm(output_e2=pixels * noise.rounding_e2),
    }
    drawn = FrameTerm.total(counted.values())
    past_e = noise.photons * (drawn.rate_e_s * exposure_s + drawn.charge_e)
    electronic |= {name: term.over(pixels, 0.0, past_e) for name, term in noise.added.items()}
    counts = n_frames * noise.photons
    # The variances of the frame's noise are those at the register input already.
    found = {name: counts * term.variance_e2(exposure_s, noise.factor2, 1.0) for name, term in counted.items()}
    found |= {name: n_frames * term.variance_e2(exposure_s, noise.factor2, 1.0) for name, term in electronic.items()}
    speckle = (n_frames * exposure_s * speckle_e_s) ** 2
    return {name: float(value) for name, value in found.items()} | {"speckle": speckle}


MAX_EPOCHS = 12
"""Epochs of a visit without a ledger."""
_CM_PER_UM = 1e-4
_SUN_AT_10_PC_MAS = 0.46505  # angular radius: 695 700 km (IAU 2015) at 10 pc
# A single place in the hole against the rms of its separation.
_FLOOR_LEAST, _FLOOR_MOST = 0.5, 2.0
_BEAT = 1.4
_ANNULUS_LAMBDA_D = 1.5  # half width of the annulus around a planet whose scatter counts


def visit_of(
    scene: Scene,
    instrument: Instrument,
    *,
    band: str,
    exposure_s: float,
    n_frames: int,
    em_gain: float,
    roll_deg: float = 0.0,
    star_offset_arcsec: tuple[float, float] = (0.0, 0.0),
    start_utc: str | None = None,
    switches: Mapping[str, bool] | None = None,
    planets: Sequence[str] | None = None,
    reduced: bool = False,
    full: bool = False,
    max_epochs: int = MAX_EPOCHS,
    visits: int = 1,
    timing: Timing = INTERLEAVED,
) -> VisitCase:
    """Return the light, noise and optics of an observation.

    Parameters
    ----------
    scene : Scene
    instrument : Instrument
    band : str
    exposure_s, n_frames, em_gain
        Of the sequence.
    roll_deg, star_offset_arcsec, start_utc, switches
        As `simulator.observing.observation.observe`.
    planets : sequence of str, optional
        Names of the planets that are measured; all of the scene by default.
    reduced : bool
        Sizes after a full reduction: flat, bias structure and flaws calibrated out, non-linearity and smear undone,
        particles rejected.
    full : bool
        Whole frames, or the window around the hole.
    max_epochs : int
        Epochs of the visit without a ledger.
    visits : int
        Of the programme, with as many references: the SNR is that of all of them.
    timing : Timing
        Where in the orbit references are taken.

    Raises
    ------
    InputError
        If a planet that is named is not in the scene, or as `simulator.target.sources.scene_sources`.
    """
    switched = instrument.switched(switches, camera=instrument.band(band).camera)
    start = instrument.mission.start_utc if start_utc is None else start_utc
    sources = scene_sources(scene, instrument, band, roll_deg=roll_deg)
    measured = _measured(sources, planets)
    figures = psf_metrics(instrument, band)
    detector = switched.detector_of(band)
    star = scene.cstar
    sky = sky_rate_e_s_arcsec2(instrument, band, ra_deg=star.ra_deg, dec_deg=star.dec_deg, start_utc=start)
    side = len(figures.raw_contrast)
    corner = (detector.star_row - side // 2, detector.star_column - side // 2)
    stray = stray_light_parts(instrument, band, detector.shape, first_pixel=corner, window=(side, side))
    visit_s = n_frames * (exposure_s + detector.readout_s)
    drift = instrument.drift
    light = scene_light(
        instrument,
        band,
        figures,
        sources,
        measured=measured,
        full=full,
        star_offset_arcsec=star_offset_arcsec,
        sky_e_s_arcsec2=sky.rate_e_s_arcsec2,
        stray_e_s=_mean_stray(stray),
        drift_nm=math.hypot(
            drift.visit_nm,
            drift.common_nm,
            drift.walk_nm_per_sqrt_hour * math.sqrt(visit_s / 3600.0),
            drift.orbital_nm * (drift.orbital_orders == "all"),
        ),
    )
    noise = FrameNoise.of(detector, em_gain, exposure_s)
    star_e_s = sources[0].rate_e_s
    moved = any(star_offset_arcsec)
    speckles = [_speckles(figures, drift, planet, star_e_s, visit_s, still=moved) for planet in light.planets]
    lasting = [_lasting(figures, drift, planet, visit_s, visits, timing) for planet in light.planets]
    variances, speckle_shares, walk_shares = [], [], []
    for planet, speckle, more in zip(light.planets, speckles, lasting, strict=True):
        variance = visit_variance_e2(
            planet,
            light,
            noise,
            source_noise_fraction=figures.source_noise_fraction,
            exposure_s=exposure_s,
            n_frames=n_frames,
            speckle_e_s=speckle[0],
            line_shift_s=detector.line_shift_s if exposure_s > 0 else 0.0,
            flaws_e=0.0 if reduced else _flaws_e(detector, corner, side, planet) * exposure_s,
        )
        speckle_share, walk_share = _shares(variance, speckle, n_frames * exposure_s)
        variance["common"] = variance["speckle"] * (more.common + more.orbital)
        variances.append(variance)
        speckle_shares.append(speckle_share)
        walk_shares.append(walk_share)
    rays = instrument.cosmic_rays
    rate = cosmic_ray_rate(rays, start) if detector.switches.cosmic_rays else 0.0
    pixel, radius = figures.pixel_scale_arcsec, figures.aperture_radius_arcsec
    case = CameraCase(
        detector=detector,
        light=light,
        noise=noise,
        exposure_s=exposure_s,
        n_frames=n_frames,
        em_gain=em_gain,
        reduced=reduced,
        first_pixel=corner,
        full=full,
        hits_per_s=rate * (detector.pixel_um * _CM_PER_UM) ** 2,
        hits=pixel_hits(rays, detector.pixel_um),
        lost_per_s=aperture_loss_per_s(switched, band, start_utc=start),
        variances=tuple(variances),
        column_peak_e_s=_column_peak(figures, light, star_e_s, moved=moved),
        radius_pixels=radius / pixel,
        lambda_d_pixels=figures.lambda_d_arcsec / pixel,
        pixel_arcsec=pixel,
        edge_arcsec=figures.mask_half_width_arcsec + radius + pixel,
        visits=visits,
    )
    passbands = Passbands.from_instrument(instrument)
    low, high = passbands.bands[passbands.index(band)].support_nm
    width, jitter_arcsec = (high - low) / (0.5 * (high + low)), instrument.wavefront.jitter_mas * 1e-3
    return VisitCase(
        instrument=instrument,
        switched=switched,
        band=band,
        start_utc=start,
        sources=tuple(sources),
        measured=measured,
        metrics=figures,
        sky=sky,
        stray=stray,
        camera=case,
        optics=Optics(width, figures.lambda_d_arcsec, pixel, jitter_arcsec),
        visit_s=visit_s,
        n_epochs=min(n_frames, max_epochs),
        timing=timing,
        speckle_share=tuple(speckle_shares),
        walk_share=tuple(walk_shares),
        lasting=tuple(lasting),
        moved=moved,
        star_radius_mas=_radius_mas(star),
    )


def _radius_mas(star: SceneStar) -> float:
    """Return the angular radius of a star by its V magnitude and temperature; 0 if the temperature is unknown."""
    teff_k = star.teff_k
    if teff_k is None and star.spectral_type is not None:
        teff_k = stellar_parameters(star.spectral_type).teff_k
    if teff_k is None:
        return 0.0
    return radius_from_luminosity(luminosity_from_v(star.v_mag, 10.0, teff_k), teff_k) * _SUN_AT_10_PC_MAS


def _mean_stray(stray: Mapping[str, NDArray[Any]]) -> float:
    return sum(float(part.mean()) for part in stray.values())


Speckles = tuple[float, float, float]


def _shares(variances: Mapping[str, float], speckle_e_s: Speckles, integration_s: float) -> tuple[float, float]:
    """Return the largest part of the variance of an aperture sum that speckles make, and the walk alone."""
    least, every, walk = ((integration_s * part) ** 2 for part in speckle_e_s)
    white = sum(variances.values()) - variances["speckle"]
    return every / max(white + max(every, least), 1e-300), walk / max(white + every, 1e-300)


def _speckles(
    metrics: PsfMetrics, drift: Drift, planet: PlanetPlace, star_e_s: float, visit_s: float, *, still: bool
) -> Speckles:
    """Return the rms of aperture sums that a reference visit leaves: least, most, and the walk's part in that.

    Inside the hole that is the measured floor, within a factor; an aperture that reaches beyond it sees the beat of the
    drift with light that no one measured.
    """
    if still:
        return 0.0, 0.0, 0.0
    hours, where = visit_s / 3600.0, math.hypot(planet.x_arcsec, planet.y_arcsec)
    rdi_floor = functools.partial(metrics.rdi_floor, drift.visit_nm, visit_hours=hours, separation_arcsec=where)
    walks = (drift.walk_nm_per_sqrt_hour, 0.0)
    floor, frozen = (star_e_s * float(rdi_floor(walk_nm_per_sqrt_hour=walk)) for walk in walks)
    walk = math.sqrt(max(floor**2 - frozen**2, 0.0))
    if planet.inside:
        return _FLOOR_LEAST * floor, _FLOOR_MOST * floor, _FLOOR_MOST * walk
    beat = math.sqrt(2.0 * planet.halo_e_s * planet.scattered_e_s + planet.scattered_e_s**2)
    return 0.0, max(_FLOOR_MOST * floor, _BEAT * beat), max(_FLOOR_MOST * walk, _BEAT * beat if walk else 0.0)


def _lasting(
    metrics: PsfMetrics, drift: Drift, planet: PlanetPlace, visit_s: float, visits: int, timing: Timing
) -> Lasting:
    """Return what a programme's speckles have besides those of its visits alone, at the place of a planet."""

    def summed(**changes: float) -> float:
        """Return the variance of the mean rate of the programme, times its visits."""
        law = programme_law(metrics, drift.model_copy(update=changes), where, _ANNULUS_LAMBDA_D, timing=timing)
        return visits * float(law.law(visits).variance(visit_s))

    where = math.hypot(planet.x_arcsec, planet.y_arcsec)
    alone = summed(common_fraction=0.0, orbital_nm=0.0)
    both = (summed(orbital_nm=0.0) - alone, summed(common_fraction=0.0) - alone)
    return Lasting(*(max(part, 0.0) / max(alone, 1e-300) for part in both))


def _flaws_e(detector: Any, corner: tuple[int, int], side: int, planet: PlanetPlace) -> float:
    """Return the dark current of hot pixels and bad columns in an aperture, by squared weights, e-/s."""
    if not detector.switches.dark:
        return 0.0
    flaws, _ = stamp_flaws(detector, corner, side)
    return sum(
        float((planet.weights**2 * flaws[key].dark_e_s[planet.place]).sum())
        for key in ("bad_pixels", "bad_columns")
        if getattr(detector.switches, key, False)
    )


def _measured(sources: Sequence[Source], planets: Sequence[str] | None) -> tuple[str, ...]:
    known = tuple(source.name for source in sources if source.kind == "planet")
    if planets is None:
        return known
    for name in planets:
        if name not in known:
            raise InputError("planets", name, allowed=", ".join(known) or "none: the scene has no planet")
    return tuple(planets)


def _column_peak(metrics: PsfMetrics, light: SceneLight, star_e_s: float, *, moved: bool) -> float:
    """Return the brightest pixel whose overflow may reach the hole along its column or row."""
    star = metrics.peak_off_axis if moved else metrics.peak_on_axis_columns
    return max([star_e_s * star, *(source.peak_e_s for source in light.sources if source.kind == "star")])


def camera_sizes(case: CameraCase) -> dict[str, Sizes]:
    """Return the size of every effect of the camera on every quantity, by the name of its switch.

    Of a change of the mean ``d`` of a pixel the size is ``|d| / sigma``, or that of the variance that goes with it; of
    a part of the variance half its share; of a change of the aperture sum of a planet its relative size; for the SNR
    the sum of this and half the share of the variance of the aperture sum.
    """
    found = {effect.switch: effect.size(case) for effect in rows_of(case.detector.chain)}
    return {key: size for key, size in found.items() if size is not None}


WAVELENGTHS, PIXEL_NODES = (1, 2, 3, 4, 5, 6, 7), (1, 2, 3, 4, 5)
EPOCHS = (1, 2, 3, 4, 6, 8, 12)
_ANNULUS_LAMBDA_D = 1.5


@dataclass(frozen=True)
class Forecast:
    """Sizes of effects; made by `forecast`.

    Attributes
    ----------
    rows : tuple of EffectRow
        What scene and configuration contain, before anything is left out.
    sizes : dict of str to dict
        By key of the effect, its size on ``planet_flux``, ``snr`` and ``pixel_map``. Those of settings are the sizes at
        the standard tier.
    knob_sizes : dict of str to dict
        Sizes of every value of ``wavelength_nodes``, ``pixel_nodes``, ``precision`` and ``drift_epochs``, against the
        reference.
    sources : dict of str to str
        Kind of every source besides the central star, by name.
    sums : Outcome
        Whether sums of frames can stand for the frames; see `simulator.observing.hole_stack`.
    n_frames, max_epochs : int
    full : bool
        Whole frames, or the window around the hole.
    measured : tuple of str
        Planets that are measured.
    """

    rows: tuple[EffectRow, ...]
    sizes: dict[str, Sizes]
    knob_sizes: dict[str, dict[Any, Sizes]]
    sources: dict[str, str]
    sums: Outcome[float]
    n_frames: int
    max_epochs: int
    full: bool
    measured: tuple[str, ...]


def forecast(scene: Scene, instrument: Instrument, *, scene_model: str = "exact", **settings: Any) -> Forecast:
    """Predict how much each effect changes what is asked of an observation.

    Parameters
    ----------
    scene : Scene
    instrument : Instrument
    scene_model : str
        As of `simulator.observing.observation.observe`.
    **settings
        As of `visit_of`.

    Returns
    -------
    Forecast

    Raises
    ------
    InputError
        If a planet that is named is not in the scene, or as `simulator.target.sources.scene_sources`.

    Notes
    -----
    ``planet_flux`` is the relative change of the planet's light in its aperture, ``snr`` that of this light over the
    noise of the aperture sum over the visit, ``pixel_map`` the largest change of the mean or standard deviation of a
    pixel over its standard deviation in one frame. Nothing is propagated or drawn (but 1500 tracks of particles, once).
    """
    visit = visit_of(scene, instrument, **settings)
    case, figures = visit.camera, visit.metrics
    sizes = camera_sizes(case)
    sizes |= _light_sizes(visit)
    for item in extended_rates(scene, instrument, visit.band):
        pixel_e_s, aperture_e_s = item.rate_e_s * figures.peak_off_axis, item.rate_e_s * figures.core_open
        sizes[f"extended:{item.source.name}"] = visit.spread_light(pixel_e_s, aperture_e_s)
    knobs = _knob_sizes(visit)
    if instrument.coronagraph.table is not None:  # there is no field to sample
        knobs = {name: dict.fromkeys(values, sizes_of(0.0)) for name, values in knobs.items()}
    sizes |= {
        "off_mask_psf": _off_mask(case.light),
        "drift": visit.no_drift(),
        "drift_common": visit.no_common(),
        "orbital_drift": visit.no_orbit(),
        "pupil_samples": sizes_of(0.0),
    }
    sizes |= _left_out(visit)
    sizes |= {name: knobs[name][getattr(Knobs(), name)] for name in ("wavelength_nodes", "pixel_nodes")}
    sizes |= {"precision": knobs["precision"]["single"], "drift_epochs": knobs["drift_epochs"][1]}
    sizes["hole_region"] = _hole_region(case)
    rows = effect_ledger(
        scene,
        visit.switched,
        band=visit.band,
        scene_model=scene_model,
        hole_state=figures.hole_state,
        sky=visit.sky,
        stray=visit.stray,
        start_utc=visit.start_utc,
    )
    for row in rows:  # what does not exist has no size
        if row.decision == "skipped" and row.key in sizes and row.key not in ("source_positions", *LEFT_OUT):
            sizes[row.key] = sizes_of(0.0)
    if max(sizes.get(key, sizes_of(0.0))["planet_flux"] for key in ("blooming", "register_full_well")) >= 1.0:
        _forbid(sizes, knobs)
    kinds: dict[str, str] = {source.name: source.kind for source in visit.sources[1:]}
    kinds |= {source.name: "extended" for source in scene.extended}
    sums = sums_possible(case, figures, visit.star_e_s, moved=visit.moved)
    return Forecast(
        rows=rows,
        sizes=sizes,
        knob_sizes=knobs,
        sources=kinds,
        sums=sums,
        n_frames=case.n_frames,
        max_epochs=visit.n_epochs,
        full=case.full,
        measured=visit.measured,
    )


def _forbid(sizes: dict[str, Sizes], knobs: dict[str, dict[Any, Sizes]]) -> None:
    """Forbid limits that cut off the planet or spill charge onto it: there every bit of light can decide the rest."""
    for size in [*sizes.values(), *(size for values in knobs.values() for size in values.values())]:
        if any(size.values()):
            size["planet_flux"] = size["snr"] = 1.0


def _light_sizes(visit: VisitCase) -> dict[str, Sizes]:
    light, metrics = visit.camera.light, visit.metrics
    front = float(sky_pixel_e_s(metrics, visit.sky.rate_e_s_arcsec2))
    spread = {"sky": front, "stray_light": _mean_stray(visit.stray)}
    sizes = {key: visit.spread_light(rate, rate * light.aperture_pixels) for key, rate in spread.items()}
    measured = {planet.name for planet in light.planets}
    for source in light.sources:
        sizes[f"{source.kind}:{source.name}"] = visit.source(source, measured=source.name in measured)
    return sizes


def _knob_sizes(visit: VisitCase) -> dict[str, dict[Any, Sizes]]:
    none = sizes_of(0.0)
    steps = sorted({*(fewer for fewer in EPOCHS if fewer < visit.n_epochs), visit.n_epochs})
    return {
        "wavelength_nodes": {n: visit.wavelength_nodes(n) for n in WAVELENGTHS[:-1]} | {WAVELENGTHS[-1]: none},
        "pixel_nodes": {n: visit.pixel_nodes(n) for n in PIXEL_NODES[:-1]} | {PIXEL_NODES[-1]: none},
        "precision": {"single": visit.precision(), "double": none},
        "drift_epochs": {n: visit.epochs(n) for n in steps},
    }


def _off_mask(light: SceneLight) -> Sizes:
    """Return the size of one unmasked image for every source, without mask and cross, to the nearest of 4 x 4 cells.

    The cells cost 0.55 % of an aperture sum at most, 4.5 % of a peak pixel (measured at 520 nm).
    """
    flux = max((1.0 / max(planet.core, 1e-3) - 1.0 + 0.0055 for planet in light.planets), default=0.0)
    return sizes_of(0.0, flux)


def _left_out(visit: VisitCase) -> dict[str, Sizes]:
    """Return the sizes of what no image has: an error of the pointing of each visit, and the disc of the star.

    The light in the hole goes with the star, so that an error of the pointing changes aperture sums by their gradient,
    in science and in reference visits by other amounts, which visits average as they do speckles. A disc of radius r
    blurs the light by a variance of ``r^2 / 4`` an axis, which changes aperture sums by ``r^2 / 8`` of their Laplacian,
    at most ``2 pi / (lambda/D)`` times their gradient, as no wave of the image is shorter than lambda/D; by the same in
    all visits, as if no reference showed it. Both are upper bounds, within a factor of 1.5 and 3 of the rms that moved
    and wide stars leave: differences of pixels see the light beyond the hole.
    """
    case, metrics = visit.camera, visit.metrics
    sums = aperture_sums(case.light.star_e_s, overlap_weights(case.radius_pixels))
    square = np.sum(np.square(np.gradient(sums)), axis=0) * (case.n_frames * case.exposure_s) ** 2
    axis = centred_axis(len(sums), case.pixel_arcsec)
    inside = metrics.zone.covers(axis, axis, -metrics.aperture_radius_arcsec)
    separation = np.hypot(axis[:, None], axis)
    near = []
    for planet in case.light.planets:
        away = np.abs(separation - math.hypot(planet.x_arcsec, planet.y_arcsec))
        around = inside & (away <= _ANNULUS_LAMBDA_D * metrics.lambda_d_arcsec) & (not visit.moved)
        near.append(float(square[around].mean()) if around.any() else 0.0)
    step, radius = (1e-3 * part / case.pixel_arcsec for part in (visit.drift.pointing_mas, visit.star_radius_mas))
    factors = {
        "pointing": 2.0 * step**2,
        "stellar_disc": case.visits * (2.0 * math.pi / case.lambda_d_pixels * radius**2 / 8.0) ** 2,
    }
    return {key: sizes_of(0.0, snr=case.snr_added(factor * part for part in near)) for key, factor in factors.items()}


def _hole_region(case: CameraCase) -> Sizes:
    """Return the size of reading a window alone: overflow that would have come in; what smears into it is known."""
    detector, light, noise = case.detector, case.light, case.noise
    in_columns, in_rows = (peak * case.exposure_s for peak in light.beyond_peaks_e_s)
    enters = float(overflow(in_columns, detector.blooming_e, 1.0))
    enters += float(overflow(in_rows, detector.trailing_e / case.em_gain, noise.factor2))
    if enters <= 1e-6:
        return sizes_of(0.0)
    spill = Spill(dataclasses.replace(case, full=True))
    hit = any(
        not planet.weights.size or spill.blooms_into(*planet.place) or spill.trails_into(*planet.place)
        for planet in light.planets
    )
    return sizes_of(1.0, float(hit))
