"""An observation as the ledger sees it: its pixels and their noise, and the size of everything that may be left out.

Everything comes from known tables alone. A pixel above its full well passes the excess on along its column, the
register above its own along the row, to what is read next. Nothing arrives at a place exactly if every run of pixels
that ends there holds less than its wells do: the light of a run is compared with them, five sigma of noise included,
however far away it begins.

What numerical settings cost are remainders of the quadratures, and rounding.
A Gauss-Legendre rule of n nodes misses of a wave ``cos(phi s)``, -1 <= s <= 1, at most

    E_n(phi) = 2^(2n) (n!)^4 / ((2n + 1) ((2n)!)^3) phi^(2n)

of its amplitude (remainder of the rule, its highest derivative at its largest). Over a band the image at u lambda/D
holds waves up to ``phi = pi u Delta`` with Delta the relative width of the band; over a pixel waves up to
``phi = pi (pixel / (lambda/D))``, widened by the jitter. Few waves are that fast: the factors below lower the phase so
that the remainder follows the differences that were measured between the images of each rule and those of nine
wavelengths and six nodes a pixel, in the four visible bands (`reports/truth/effect_ledger`).
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal

import numpy as np

from catalogs import luminosity_from_v, radius_from_luminosity, stellar_parameters
from cpic_core import BoolArray, FloatArray, InputError, NDArray, Outcome, Reason, Record, Status
from simulator.camera import FrameNoise, aperture_loss_per_s
from simulator.config import Drift, Instrument, Scene, SceneStar, Timing
from simulator.detectors import INFRARED, VISIBLE, FrameTerm, Sizes, in_sums, rows_of, sizes
from simulator.effects import cosmic_ray_rate, sky_rate_e_s_arcsec2, stray_light_parts
from simulator.imaging import PsfMetrics, aperture_sums, centred_axis, overlap_weights, psf_metrics
from simulator.knobs import Knobs
from simulator.ledger.inventory import LEFT_OUT, EffectRow, effect_ledger
from simulator.ledger.light import Flaw, PlanetPlace, SceneLight, SourceLight, pixel_hits, stamp_flaws
from simulator.passbands import Passbands
from simulator.signal import INTERLEAVED, drift_halo, overflow, pixel_saturated, programme_law, sky_pixel_e_s
from simulator.target import Source, extended_rates, scene_sources

_FLOW_SIGMA, _SIGMA = 5.0, 8.0
# Radius of the Gaussian that stands for the core of a planet, lambda/D.
_CORE_SIGMA = 0.66
_SPILLED = 1e-6  # of the noise of a pixel, from which on what it passes on counts
# Speckles of a drifting wavefront scatter by this much more than their two parts would alone, and the largest of a
# stamp by so many times that.
_SPECKLE_SCATTER, _SPECKLE_MOST = 1.4, 3.5
_PIXEL_REACH, _WAVE_REACH = 3, 2
# Sources off the axis in single precision: of their light on a pixel, and of their peak anywhere.
_OTHERS_RELATIVE, _OTHERS_NOISE = 4e-6, 4e-8
# What a planet behind the edge of the mask adds to the error of its colour, for as much as the mask hides of it.
_HIDDEN = 0.5
MAX_EPOCHS = 12
"""Epochs of a visit without a ledger."""
_CM_PER_UM = 1e-4
_SUN_AT_10_PC_MAS = 0.46505  # angular radius: 695 700 km (IAU 2015) at 10 pc
# A single place in the hole against the rms of its separation.
_FLOOR_LEAST, _FLOOR_MOST = 0.5, 2.0
_BEAT = 1.4
_ANNULUS_LAMBDA_D = 1.5  # half width of the annulus around a planet whose scatter counts
# What a reduction takes out (flaws, bias, particles) or what moves charge between pixels: sums of frames leave it out.
NOT_IN_SUMS = tuple(dict.fromkeys(in_sums((*VISIBLE, *INFRARED), "left_out", "moves_charge", "not_additive")))


class Spill:
    """Blooming and tails of the register on the stamp of a visit; ``full`` where the frame around it counts too."""

    def __init__(self, case: Visit, *, full: bool) -> None:
        self.case, self.full = case, full
        detector, factor2 = case.detector, case.noise.factor2
        self._pixel, self._register = detector.blooming_e, detector.trailing_e / case.em_gain
        self._factor2 = factor2
        self._known: dict[tuple[str, int], tuple[FloatArray, float]] = {}
        # Where even the brightest pixel stays below its limit nothing flows.
        top = float(case.most_e.max()) + case.noise.dark_e + case.noise.clock_e
        if top + _FLOW_SIGMA * math.sqrt(top) <= self._pixel:
            self._pixel = np.inf
        if top + _FLOW_SIGMA * math.sqrt(factor2 * top) <= self._register:
            self._register = np.inf

    @functools.cached_property
    def _charge_e(self) -> FloatArray:
        """Electrons of the pixels of the stamp at the register, with the light of other sources at most."""
        case = self.case
        side = len(case.charge_e)
        return case.most_e[: side * side].reshape(side, side) + case.noise.dark_e + case.noise.clock_e

    def blooms_into(self, rows: slice, columns: slice) -> bool:
        """Return whether charge flows along the columns into a part of the stamp, or is too much there.

        Parameters
        ----------
        rows, columns : slice
            The part of the stamp.
        """
        if not np.isfinite(self._pixel):
            return False
        return self._over(rows, columns, self._pixel, 1.0) or bool(self._blooming_columns(rows)[columns].any())

    def trails_into(self, rows: slice, columns: slice) -> bool:
        """Return whether charge of the register flows along the rows into a part of the stamp, or is too much there.

        Parameters
        ----------
        rows, columns : slice
            The part of the stamp.
        """
        if not np.isfinite(self._register):
            return False
        if self._over(rows, columns, self._register, self._factor2):
            return True
        charge = self._charge_e[rows]
        # No pixel hands on more than it holds; what blooms across these rows fills its pixels there.
        most = self.case.detector.blooming_e
        charge = np.minimum(charge, most)
        if np.isfinite(self._pixel):
            charge = np.where(self._blooming_columns(rows), most, charge)
        before = charge[:, : columns.start][:, ::-1]
        parts = [(before, 1.0)]
        if self.full:
            light, pixels = self._lanes("x", -1)
            parts.append((np.minimum(light[rows], most), pixels))
        return bool(_arrives(parts, self._register, self._factor2).any())

    def _over(self, rows: slice, columns: slice, well_e: float, factor2: float) -> bool:
        """Return whether a pixel in there holds too much itself."""
        top = float(self._charge_e[rows, columns].max(initial=0.0))
        return top + _FLOW_SIGMA * math.sqrt(factor2 * top) > well_e

    def _blooming_columns(self, rows: slice) -> BoolArray:
        """Return the columns of the stamp along which charge arrives at some rows."""
        charge, found = self._charge_e.T, np.zeros(len(self._charge_e), dtype=np.bool_)
        # Half of the excess goes up, first; the other half down, where the first may have taken its room.
        for sign, run, part in ((-1, charge[:, : rows.start][:, ::-1], 0.5), (1, charge[:, rows.stop :], 1.0)):
            parts = [(run, 1.0)]
            if self.full:
                parts.append(self._lanes("y", sign))
            found |= _arrives(parts, self._pixel, 1.0, part)
        return found

    def _lanes(self, axis: Literal["x", "y"], sign: int) -> tuple[FloatArray, float]:
        """Return the charge beyond the stamp along all its rows or columns, and the pixels of a box."""
        if (axis, sign) not in self._known:
            case = self.case
            light, pixels = case.light.lanes(axis, sign)
            self._known[axis, sign] = light * case.exposure_s + case.noise.dark_e + case.noise.clock_e, pixels
        return self._known[axis, sign]


def _arrives(parts: Sequence[tuple[FloatArray, float]], well_e: float, factor2: float, share: float = 1.0) -> BoolArray:
    """Return whether any run of each line, nearest pixel first, holds more than its wells; shape (lines,).

    ``share`` of what is above the well of a pixel goes this way.
    """
    charge = np.concatenate([levels * pixels for levels, pixels in parts], axis=1)
    length = np.concatenate([np.full(levels.shape[1], pixels) for levels, pixels in parts])
    if not charge.shape[1]:
        return np.zeros(len(charge), dtype=np.bool_)
    over = charge - well_e * length
    passed = np.cumsum(np.where(over > 0, share * over, over), axis=1)
    return np.asarray((passed + _FLOW_SIGMA * share * np.sqrt(factor2 * np.cumsum(charge, axis=1)) > 0).any(axis=1))


class Visit:
    """An observation with the inputs of all its sizes: the case that effects of the camera work theirs out for.

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
        Of the programme, with as many references: the SNR is that of all of them. What averages over visits is weighed
        as in one of them; what all have in common stands in ``variances`` times their number (``common``), so that the
        rest counts the less the more of them there are.
    timing : Timing
        Where in the orbit references are taken.

    Attributes
    ----------
    switched : Instrument
        With what is switched off.
    sources : tuple of Source
        The central star first.
    measured : tuple of str
        Planets that are measured.
    metrics : PsfMetrics
    sky : SkyLevel
    stray : mapping of str to ndarray
        By origin, on the stamp; electrons per second and pixel.
    detector : Detector or InfraredDetector
    first_pixel : tuple of int
        Of the stamp on the frame.
    light : SceneLight
    noise : FrameNoise
    optics : Optics
    visit_s : float
        Length of the visit.
    n_epochs : int
        At which the drift is sampled without the ledger.
    moved : bool
        Whether the star stands off the mask.
    hits_per_s : float
        Tracks a second and pixel.
    hits : PixelHits
    lost_per_s : float
        Rate of tracks that touch an aperture.
    variances : list of dict
        Of every measured planet, by origin (`visit_variance_e2`), with the least light of other sources.
    speckle_share, walk_share : list of float
        Of every measured planet, the largest part of the variance of its aperture sum that speckles make, and the walk
        alone.
    lasting : list of tuple of float
        Of every measured planet, what speckles of a programme have besides those of its visits alone (`_lasting`).
    column_peak_e_s : float
        Brightest pixel in the columns of the hole or of a source on the frame.
    radius_pixels, lambda_d_pixels : float
        Of the aperture; lambda/D.
    edge_arcsec : float
        Separation from an axis below which an aperture meets the mask.
    star_radius_mas : float
        Angular radius of the central star.

    Raises
    ------
    InputError
        If a planet that is named is not in the scene, or as `simulator.target.sources.scene_sources`.
    """

    overflow = staticmethod(overflow)

    def __init__(
        self,
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
    ) -> None:
        self.instrument, self.band, self.drift = instrument, band, instrument.drift
        self.exposure_s, self.n_frames, self.em_gain = exposure_s, n_frames, em_gain
        self.reduced, self.full, self.visits, self.timing = reduced, full, visits, timing
        self.moved, self.n_epochs = any(star_offset_arcsec), min(n_frames, max_epochs)
        self.start_utc = instrument.mission.start_utc if start_utc is None else start_utc
        self.switched = instrument.switched(switches, camera=instrument.band(band).camera)
        self.detector: Any = self.switched.detector_of(band)
        self.sources = scene_sources(scene, instrument, band, roll_deg=roll_deg)
        self.star_e_s, self.measured = self.sources[0].rate_e_s, _measured(self.sources, planets)
        self.metrics = metrics = psf_metrics(instrument, band)
        star, side, detector, drift = scene.cstar, len(metrics.raw_contrast), self.detector, self.drift
        place: dict[str, Any] = {"ra_deg": star.ra_deg, "dec_deg": star.dec_deg, "start_utc": self.start_utc}
        self.sky = sky_rate_e_s_arcsec2(instrument, band, **place)
        self.first_pixel = detector.star_row - side // 2, detector.star_column - side // 2
        window: dict[str, Any] = {"first_pixel": self.first_pixel, "window": (side, side)}
        self.stray = stray_light_parts(instrument, band, detector.shape, **window)
        self.visit_s = n_frames * (exposure_s + detector.readout_s)
        orbital_nm = drift.orbital_nm * (drift.orbital_orders == "all")
        walk_nm = drift.walk_nm_per_sqrt_hour * math.sqrt(self.visit_s / 3600.0)
        self.light = light = SceneLight(
            instrument,
            band,
            metrics,
            self.sources,
            measured=self.measured,
            full=full,
            star_offset_arcsec=star_offset_arcsec,
            sky_e_s_arcsec2=self.sky.rate_e_s_arcsec2,
            stray_e_s=_mean_stray(self.stray),
            drift_nm=math.hypot(drift.visit_nm, drift.common_nm, walk_nm, orbital_nm),
        )
        self.noise = FrameNoise.of(detector, em_gain, exposure_s)
        self.variances: list[dict[str, float]] = []
        self.speckle_share: list[float] = []
        self.walk_share: list[float] = []
        self.lasting: list[tuple[float, float]] = []
        for planet in light.planets:
            speckle = _speckles(metrics, drift, planet, self.star_e_s, self.visit_s, still=self.moved)
            variance = visit_variance_e2(
                planet,
                light,
                self.noise,
                source_noise_fraction=metrics.source_noise_fraction,
                exposure_s=exposure_s,
                n_frames=n_frames,
                speckle_e_s=speckle[0],
                line_shift_s=detector.line_shift_s if exposure_s > 0 else 0.0,
                flaws_e=0.0 if reduced else _flaws_e(detector, self.first_pixel, side, planet) * exposure_s,
            )
            shares = _shares(variance, speckle, n_frames * exposure_s)
            self.speckle_share.append(shares[0])
            self.walk_share.append(shares[1])
            self.lasting.append(_lasting(metrics, drift, planet, self.visit_s, visits, timing))
            self.variances.append(variance | {"common": variance["speckle"] * sum(self.lasting[-1])})
        rays = instrument.cosmic_rays
        rate = cosmic_ray_rate(rays, self.start_utc) if detector.switches.cosmic_rays else 0.0
        self.hits_per_s = rate * (detector.pixel_um * _CM_PER_UM) ** 2
        self.hits = pixel_hits(rays, detector.pixel_um)
        self.lost_per_s = aperture_loss_per_s(self.switched, band, start_utc=self.start_utc)
        # Its overflow may reach the hole along its column or row.
        peak = metrics.peak_off_axis if self.moved else metrics.peak_on_axis_columns
        stars = (source.peak_e_s for source in light.sources if source.kind == "star")
        self.column_peak_e_s = max([self.star_e_s * peak, *stars])
        self.pixel_arcsec = pixel = metrics.pixel_scale_arcsec
        self.radius_pixels, self.lambda_d_pixels = (
            metrics.aperture_radius_arcsec / pixel,
            metrics.lambda_d_arcsec / pixel,
        )
        self.edge_arcsec = metrics.mask_half_width_arcsec + metrics.aperture_radius_arcsec + pixel
        passbands = Passbands.from_instrument(instrument)
        low, high = passbands.bands[passbands.index(band)].support_nm
        jitter_arcsec = instrument.wavefront.jitter_mas * 1e-3
        self.optics = Optics((high - low) / (0.5 * (high + low)), metrics.lambda_d_arcsec, pixel, jitter_arcsec)
        self.star_radius_mas = _radius_mas(star)

    @functools.cached_property
    def charge_e(self) -> FloatArray:
        """Electrons of light, and of hot pixels and bad columns, on the stamp in a frame."""
        return self._charged(self.light.total_e_s)

    @functools.cached_property
    def light_e(self) -> FloatArray:
        """The same of every level of light, the stamp first."""
        return np.concatenate([self.charge_e.ravel(), self.light.outside_e_s * self.exposure_s])

    @property
    def counted_e(self) -> FloatArray:
        """Of light and dark current, the electrons that are drawn as counts."""
        return (self.light_e + self.noise.dark_e) * self.noise.photons

    def struck(self) -> float:
        """Return the size of the charge of particles on the variance of a pixel."""
        hits = self.hits_per_s * self.exposure_s * self.hits.square_e2
        return self.variance_change(self.noise.factor2 * hits, inside=False)

    @functools.cached_property
    def most_e(self) -> FloatArray:
        """The same with the light of other sources and of speckles at most."""
        speckles = largest_speckles(self.light.star_e_s, self.light.scattered_e_s)
        stamp = self._charged(self.light.most_e_s + speckles)
        return np.concatenate([stamp.ravel(), self.light.outside_e_s * self.exposure_s])

    def _charged(self, light_e_s: FloatArray) -> FloatArray:
        charge, switches = light_e_s * self.exposure_s, self.detector.switches
        for key in ("bad_pixels", "bad_columns"):
            if getattr(switches, key, False):
                flaw = self.flaws[key]
                charge = np.where(flaw.response > 0, 0.0, charge) + flaw.dark_e_s * (self.exposure_s * switches.dark)
        return charge

    @functools.cached_property
    def spill(self) -> Spill:
        """Where charge beyond the limits flows."""
        return Spill(self, full=self.full)

    def behind_e_s(self, planet: PlanetPlace) -> float:
        """Return the light of others on a pixel of the aperture of a planet, at most, e-/s."""
        return (planet.halo_e_s + planet.other_most_e_s + planet.sky_e_s) / self.light.aperture_pixels

    def spilled_on(
        self, planet: PlanetPlace, well_e: float, factor2: float, flows_into: Callable[[slice, slice], object]
    ) -> float:
        """Return whether charge beyond a limit may reach a planet: 1, or what of its own is cut off.

        Parameters
        ----------
        planet : PlanetPlace
        well_e : float
            The limit, e- at the register input.
        factor2 : float
            Squared excess noise factor of what it cuts off.
        flows_into : callable
            Whether charge of others flows into rows and columns of the stamp.
        """
        if not planet.weights.size:  # off the stamp: from the brightest pixel of all
            return float(overflow(self.column_peak_e_s * self.exposure_s, well_e, factor2) > 1e-9)
        level = (self.behind_e_s(planet) + planet.peak_e_s) * self.exposure_s
        return max(float(bool(flows_into(*planet.place))), float(overflow(level, well_e, factor2)))

    @property
    def largest_stripe_adu(self) -> float:
        """Largest stripe of the bias in what is read."""
        return float(stamp_flaws(self.detector, self.first_pixel, len(self.light.total_e_s))[1][1 if self.full else 0])

    @property
    def flaws(self) -> dict[str, Flaw]:
        """Flaws of the calibration set on the stamp."""
        return stamp_flaws(self.detector, self.first_pixel, len(self.light.total_e_s))[0]

    @functools.cached_property
    def sigma_e(self) -> FloatArray:
        """Standard deviation of these pixels, with the light that is certain."""
        least = self._charged(self.light.least_e_s).ravel()
        light = np.concatenate([least, self.light.outside_e_s * self.exposure_s])
        return np.sqrt(np.maximum(self.noise.variance_e2(light), 1e-30))

    @functools.cached_property
    def spills(self) -> tuple[bool, bool]:
        """Whether pixels overflow into their column, and the register into its row."""
        peak = float(self.most_e.max(initial=0.0)) + self.noise.dark_e
        register = self.detector.trailing_e / self.em_gain
        bloom = bool(overflow(peak, self.detector.blooming_e, 1.0) > _SPILLED)
        return bloom, bool(overflow(peak, register, self.noise.factor2) > _SPILLED)

    def mean_change(self, change_e: FloatArray | float) -> float:
        """Return the largest change of mean and standard deviation in a pixel whose mean changes so.

        Where charge spills, the last pixel that it reaches sees the changes of a whole column or row.
        """
        change = np.abs(np.broadcast_to(np.asarray(change_e, dtype=np.float64), self.sigma_e.shape))
        spread = 0.5 * self.noise.factor2 * self.noise.photons / self.sigma_e
        worst = float(np.max(change / self.sigma_e * np.maximum(1.0, spread), initial=0.0))
        if any(self.spills):
            side = len(self.charge_e)
            stamp = change[: side * side].reshape(side, side)
            sums = [float(stamp.sum(axis=axis).max()) for axis in (0, 1) if self.spills[axis]]
            more = (max(self.detector.n_rows, self.detector.n_columns) - side) * self.full
            beyond = float(change[side * side :].mean()) * more if more else 0.0
            rounded = float(change.max(initial=0.0) > 0)  # of whole electrons a half goes each way
            worst = max(worst, (max(sums) + beyond + rounded) / float(self.sigma_e.min()))
        return worst

    def variance_change(self, variance_e2: FloatArray | float, *, inside: bool = True) -> float:
        """Return the largest share of a pixel's variance, halved; ``inside`` where it is part of the noise already."""
        part = np.broadcast_to(np.asarray(variance_e2, dtype=np.float64), self.sigma_e.shape)
        whole = self.sigma_e**2 if inside else self.sigma_e**2 + part
        return 0.5 * min(float(np.max(part / whole, initial=0.0)), 1.0)

    def light_variance_e2(self, aperture_e_s: float) -> float:
        """Return the variance over the visit of an aperture sum of even light."""
        noise, fraction = self.noise, self.light.noise_pixels / self.light.aperture_pixels
        return self.n_frames * noise.factor2 * noise.photons * self.exposure_s * fraction * aperture_e_s

    def snr_share(self, *origins: str, factor: float = 1.0) -> float:
        """Return half of the share of some origins in the variance of an aperture sum, the largest of all planets.

        Light of other sources counts as much as it may be; what adds no variance is no origin.
        """
        most = 0.0
        for variances, planet in zip(self.variances, self.light.planets, strict=True):
            other = self.light_variance_e2(planet.other_most_e_s)
            more = other - variances["other"] if "other" in origins else 0.0
            part = sum(variances.get(name, 0.0) for name in origins) + more
            most = max(most, 0.5 * factor * part / max(sum(variances.values()) + more, 1e-300))
        return most

    def snr_added(self, variance_e2: Iterable[float]) -> float:
        """Return the same of a variance that is not among the origins, one a planet."""
        totals = (max(sum(variances.values()), 1e-300) for variances in self.variances)
        return max((0.5 * part / total for part, total in zip(variance_e2, totals, strict=True)), default=0.0)

    def over_planets(self, size: Callable[[PlanetPlace], float]) -> float:
        """Return the largest of all planets."""
        return max((size(planet) for planet in self.light.planets), default=0.0)

    @functools.cached_property
    def cores(self) -> tuple[tuple[tuple[slice, slice], FloatArray], ...]:
        """Part of the stamp under the core of each planet, inside its aperture, and the weights there."""
        n, reach, found = len(self.light.total_e_s), math.ceil(self.radius_pixels + 1.0), []
        for planet in self.light.planets:
            spans, offsets = [], []
            for place in (planet.y_arcsec, planet.x_arcsec):
                middle = n // 2 + place / self.pixel_arcsec
                low, high = max(math.floor(middle) - reach, 0), min(math.ceil(middle) + reach + 1, n)
                spans.append(slice(low, max(high, low)))
                offsets.append(np.arange(low, max(high, low)) - middle)
            distance = np.hypot(offsets[0][:, None], offsets[1])
            weight = np.exp(-0.5 * (distance / (_CORE_SIGMA * self.lambda_d_pixels)) ** 2)
            weight *= distance <= self.radius_pixels + 0.5
            found.append(((spans[0], spans[1]), weight / max(float(weight.sum()), 1e-300)))
        return tuple(found)

    @functools.cached_property
    def _around_mean(self) -> FloatArray:
        """Starlight of a pixel, or the mean around it where that is brighter."""
        star = self.light.star_e_s
        return np.maximum(star, _box(star, _WAVE_REACH, largest=False))

    @functools.cached_property
    def _around_most(self) -> FloatArray:
        """Brightest starlight around a pixel."""
        return _box(self.light.star_e_s, _PIXEL_REACH, largest=True)

    def _around(self, planet: PlanetPlace) -> float:
        """Return the starlight around the pixels of an aperture over their own: what is misplaced comes from there."""
        if not planet.weights.size:
            return 1.0
        around = float((planet.weights * self._around_mean[planet.place]).sum())
        own = float((planet.weights * self.light.star_e_s[planet.place]).sum())
        return around / own if own > 0 else 1.0

    def wavelength_nodes(self, n_nodes: int) -> Sizes:
        """Return the size of taking so many wavelengths a band."""
        t = self.exposure_s
        change = self.optics.wavelength_error(n_nodes, self.light.radius_arcsec) * self._around_mean * t
        peak = self.optics.wavelength_peak_error(n_nodes)
        for source in self.light.sources:
            # With one wavelength the wings of a star are another pattern; with more it has as many as it needs.
            wings = float(self.optics.wavelength_error(1, 1.0 + source.distance_arcsec)) if n_nodes == 1 else 0.0
            level = source.peak_e_s * (min(wings, 1.0) if source.distance_arcsec > 1.0 else peak + 1e-3 * wings)
            change = change + (level if source.kind == "star" else source.peak_e_s * peak) * t
        halos, speckles = [], []
        for planet in self.light.planets:
            separation = math.hypot(planet.x_arcsec, planet.y_arcsec)
            halos.append(self.optics.wavelength_halo_error(n_nodes, separation, planet.inside) * self._around(planet))
            speckles.append(self.optics.wavelength_speckle_error(n_nodes, separation, planet.inside))
        hidden = self.over_planets(lambda planet: planet.hidden)
        found = self._of(change, self.optics.wavelength_flux_error(n_nodes) * (1.0 + _HIDDEN * hidden), halos, speckles)
        if n_nodes == 1:
            stars = [source.aperture_e_s for source in self.light.sources if source.kind == "star"]
            others = sum(stars, np.zeros(len(self.variances)))
            found["snr"] += self.snr_added(self._white(others))
        return found

    def pixel_nodes(self, n_nodes: int) -> Sizes:
        """Return the size of taking so many nodes a pixel and axis; all sources but the star are in closed form."""
        planets = self.light.planets
        halos = [self.optics.pixel_halo_error(n_nodes, planet.inside) * self._around(planet) for planet in planets]
        error = min(self.optics.pixel_error(n_nodes), LARGEST)
        speckles = [self.optics.pixel_speckle_error(n_nodes)] * len(planets)
        return self._of(error * self._around_most * self.exposure_s, 0.0, halos, speckles)

    def precision(self) -> Sizes:
        """Return the size of taking fields in single precision."""
        peak = self.star_e_s * self.metrics.peak_off_axis
        change = precision_error_e_s(self.light.star_e_s, peak) + _OTHERS_RELATIVE * self.light.total_e_s
        change = change + _OTHERS_NOISE * sum(source.peak_e_s for source in self.light.sources)
        halos, pixels = [], self.light.aperture_pixels
        for planet in self.light.planets:
            error = float(precision_error_e_s(planet.halo_e_s / pixels, peak))
            halos.append(error * pixels / max(planet.halo_e_s, 1e-300))
        return self._of(change * self.exposure_s, 1e-7, halos, halos)

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
        turns, frames = self.visit_s / self.drift.orbital_period_s, self.n_frames
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
        return sizes(self._speckles(self.drift.common_nm), snr=self._left(0))

    def no_orbit(self) -> Sizes:
        """Return the size of a wavefront that does not swing with the orbit."""
        # Low orders leave less than a screen in the hole, and as much around the mask.
        largest = math.sqrt(2.0) * self.drift.orbital_nm
        return sizes(self._speckles(largest), snr=self._left(1))

    def _left(self, term: int) -> float:
        """Return the size of a part of the variance of speckles: half its share of all that the programme has."""
        parts = zip(self.speckle_share, self.lasting, strict=True)
        return max((0.5 * share * every[term] / (1.0 + share * sum(every)) for share, every in parts), default=0.0)

    def _speckles(self, rms_nm: float) -> float:
        """Return the largest change of a pixel by a wavefront error."""
        t = self.exposure_s
        peak = self.star_e_s * self.metrics.peak_off_axis
        radius, slope = self.light.radius_arcsec, self.drift.psd_slope
        lit = (self.light.total_e_s > 0) & (not self.moved)
        halo = drift_halo(self.metrics, radius, rms_nm, slope, self.instrument.band(self.band).center_nm) * lit
        change = largest_speckles(self.light.star_e_s * t, halo * peak * t)
        return self.mean_change(self._padded(change))

    def source(self, source: SourceLight, *, measured: bool) -> Sizes:
        """Return the size of a source left out.

        Parameters
        ----------
        source : SourceLight
        measured : bool
            Whether it is one of the planets that are measured.
        """
        pixel = self.mean_change(source.peak_e_s * self.exposure_s)
        if measured:
            return sizes(pixel, 1.0)
        return sizes(pixel, snr=self.snr_added(self._white(source.aperture_e_s)))

    def spread_light(self, pixel_e_s: float, aperture_e_s: float) -> Sizes:
        """Return the size of light spread over many pixels.

        Parameters
        ----------
        pixel_e_s, aperture_e_s : float
            On a pixel and in an aperture.
        """
        added = self._white(np.full(len(self.variances), aperture_e_s))
        return sizes(self.mean_change(pixel_e_s * self.exposure_s), snr=self.snr_added(added))

    def _white(self, aperture_e_s: FloatArray) -> list[float]:
        return [self.light_variance_e2(float(light)) for light in aperture_e_s]

    def _padded(self, change: FloatArray) -> FloatArray:
        """Return a change on the stamp, nothing on the pixels around it."""
        return np.concatenate([change.ravel(), np.zeros(self.light.outside_e_s.size)])

    def _of(self, change_e: FloatArray, flux: float, halo_errors: list[float], speckle_errors: list[float]) -> Sizes:
        """Return sizes from changes of the star's pixels and the planet, and relative errors of light and speckles."""
        parts, shares = [], zip(self.variances, self.speckle_share, strict=True)
        for halo, speckle, (variances, share) in zip(halo_errors, speckle_errors, shares, strict=True):
            part = 0.5 * variances["halo"] / max(sum(variances.values()), 1e-300)
            parts.append(min(halo, LARGEST) * part + min(speckle, LARGEST) * share)
        return sizes(self.mean_change(self._padded(change_e)), flux, flux + max(parts, default=0.0))


def largest_speckles(light: FloatArray, scattered: FloatArray) -> FloatArray:
    """Return the largest change of pixels by a wavefront error: ``|dE|^2`` and its beat with the light that is there.

    Parameters
    ----------
    light : ndarray
        That is there without the error.
    scattered : ndarray
        Mean light that the error scatters, in the same units.
    """
    return _SPECKLE_MOST * _SPECKLE_SCATTER * np.sqrt(2.0 * light * scattered + scattered**2)


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


class Optics(Record):
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
) -> tuple[float, float]:
    """Return what a programme's speckles have besides those of its visits alone, at the place of a planet.

    Variances of aperture sums over that of a pair of visits alone, as if each visit of the programme had them: of the
    screen that science visits have in common, times their number; and of what swings with the orbit, what stays in
    every visit, times their number, and what averages.
    """

    def summed(**changes: float) -> float:
        """Return the variance of the mean rate of the programme, times its visits."""
        law = programme_law(metrics, drift.model_copy(update=changes), where, _ANNULUS_LAMBDA_D, timing=timing)
        return visits * float(law.law(visits).variance(visit_s))

    where = math.hypot(planet.x_arcsec, planet.y_arcsec)
    alone = summed(common_fraction=0.0, orbital_nm=0.0)
    both = (summed(orbital_nm=0.0) - alone, summed(common_fraction=0.0) - alone)
    common, orbital = (max(part, 0.0) / max(alone, 1e-300) for part in both)
    return common, orbital


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


def _sums_possible(visit: Visit) -> Outcome[float]:
    """Return whether frames add up over the dark hole: no pixel in it reaches a limit, and none overflows into it.

    The image that is made decides it pixel by pixel (`simulator.observing.hole_stack.hole_stackable`); this is the same
    from tables of the light.
    """
    if visit.moved:
        return Outcome.refuse(Status.INVALID, Reason.NOT_ADDITIVE, "the star stands off the mask")
    metrics = visit.metrics
    light = visit.star_e_s * metrics.peak_on_axis_hole + visit.light.sky_e_s
    light += max((source.stamp_peak_e_s for source in visit.light.sources), default=0.0)
    peak_e = light * visit.exposure_s + visit.noise.dark_e + visit.noise.clock_e
    inside = pixel_saturated(peak_e, visit.em_gain, visit.detector, _SIGMA)
    if inside.status is not Status.OK:
        return inside
    rows, columns = (_runs(np.asarray(metrics.hole.any(axis=axis))) for axis in (1, 0))
    places = list(itertools.product(rows, columns))
    if any(visit.spill.blooms_into(*place) for place in places):
        return Outcome.refuse(Status.SATURATED, Reason.PIXEL_FULL_WELL, "bloomed columns may enter the hole")
    if any(visit.spill.trails_into(*place) for place in places):
        return Outcome.refuse(Status.SATURATED, Reason.REGISTER_FULL_WELL, "tails of the register may enter the hole")
    return inside


def _runs(inside: BoolArray) -> list[slice]:
    """Return the intervals of pixels that are inside."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
    return [slice(int(low), int(high)) for low, high in zip(edges[::2], edges[1::2], strict=True)]


WAVELENGTHS, PIXEL_NODES = (1, 2, 3, 4, 5, 6, 7), (1, 2, 3, 4, 5)
EPOCHS = (1, 2, 3, 4, 6, 8, 12)


class Forecast(Record):
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
        As of `Visit`.

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
    pixel over its standard deviation in one frame. Of a change of the mean ``d`` of a pixel the size is ``|d| / sigma``
    or that of the variance that goes with it; of a part of the variance half its share; of a change of the aperture sum
    of a planet its relative size; for the SNR the sum of this and half the share of the variance of the sum. Nothing is
    propagated or drawn (but 1500 tracks of particles, once).
    """
    visit = Visit(scene, instrument, **settings)
    light, metrics, none = visit.light, visit.metrics, sizes(0.0)
    of_effects = {effect.switch: effect.size(visit) for effect in rows_of(visit.detector.chain)}
    found = {key: size for key, size in of_effects.items() if size is not None}
    front = float(sky_pixel_e_s(metrics, visit.sky.rate_e_s_arcsec2))
    for key, rate_e_s in (("sky", front), ("stray_light", _mean_stray(visit.stray))):
        found[key] = visit.spread_light(rate_e_s, rate_e_s * light.aperture_pixels)
    planets = {planet.name for planet in light.planets}
    for source in light.sources:
        found[f"{source.kind}:{source.name}"] = visit.source(source, measured=source.name in planets)
    for item in extended_rates(scene, instrument, visit.band):
        pixel_e_s, aperture_e_s = item.rate_e_s * metrics.peak_off_axis, item.rate_e_s * metrics.core_open
        found[f"extended:{item.source.name}"] = visit.spread_light(pixel_e_s, aperture_e_s)
    steps = sorted({*(fewer for fewer in EPOCHS if fewer < visit.n_epochs), visit.n_epochs})
    knobs: dict[str, dict[Any, Sizes]] = {
        "wavelength_nodes": {n: visit.wavelength_nodes(n) for n in WAVELENGTHS[:-1]} | {WAVELENGTHS[-1]: none},
        "pixel_nodes": {n: visit.pixel_nodes(n) for n in PIXEL_NODES[:-1]} | {PIXEL_NODES[-1]: none},
        "precision": {"single": visit.precision(), "double": none},
        "drift_epochs": {n: visit.epochs(n) for n in steps},
    }
    if instrument.coronagraph.table is not None:  # there is no field to sample
        knobs = {name: dict.fromkeys(values, none) for name, values in knobs.items()}
    found |= {
        "off_mask_psf": _off_mask(light),
        "drift": visit.no_drift(),
        "drift_common": visit.no_common(),
        "orbital_drift": visit.no_orbit(),
        "pupil_samples": sizes(0.0),
        **_left_out(visit),
        **{name: knobs[name][getattr(Knobs(), name)] for name in ("wavelength_nodes", "pixel_nodes")},
        "precision": knobs["precision"]["single"],
        "drift_epochs": knobs["drift_epochs"][1],
        "hole_region": _hole_region(visit),
    }
    rows = effect_ledger(
        scene,
        visit.switched,
        band=visit.band,
        scene_model=scene_model,
        hole_state=metrics.hole_state,
        sky=visit.sky,
        stray=visit.stray,
        start_utc=visit.start_utc,
    )
    for row in rows:  # what does not exist has no size
        if row.decision == "skipped" and row.key in found and row.key not in ("source_positions", *LEFT_OUT):
            found[row.key] = sizes(0.0)
    if max(found.get(key, none)["planet_flux"] for key in ("blooming", "register_full_well")) >= 1.0:
        _forbid(found, knobs)
    kinds: dict[str, str] = {source.name: source.kind for source in visit.sources[1:]}
    kinds |= {source.name: "extended" for source in scene.extended}
    settled = visit.n_frames, visit.n_epochs, visit.full, visit.measured
    return Forecast(rows, found, knobs, kinds, _sums_possible(visit), *settled)


def _forbid(found: dict[str, Sizes], knobs: dict[str, dict[Any, Sizes]]) -> None:
    """Forbid limits that cut off the planet or spill charge onto it: there every bit of light can decide the rest."""
    for size in [*found.values(), *(size for values in knobs.values() for size in values.values())]:
        if any(size.values()):
            size["planet_flux"] = size["snr"] = 1.0


def _off_mask(light: SceneLight) -> Sizes:
    """Return the size of one unmasked image for every source, without mask and cross, to the nearest of 4 x 4 cells.

    The cells cost 0.55 % of an aperture sum at most, 4.5 % of a peak pixel (measured at 520 nm).
    """
    flux = max((1.0 / max(planet.core, 1e-3) - 1.0 + 0.0055 for planet in light.planets), default=0.0)
    return sizes(0.0, flux)


def _left_out(visit: Visit) -> dict[str, Sizes]:
    """Return the sizes of what no image has: an error of the pointing of each visit, and the disc of the star.

    The light in the hole goes with the star, so that an error of the pointing changes aperture sums by their gradient,
    in science and in reference visits by other amounts, which visits average as they do speckles. A disc of radius r
    blurs the light by a variance of ``r^2 / 4`` an axis, which changes aperture sums by ``r^2 / 8`` of their Laplacian,
    at most ``2 pi / (lambda/D)`` times their gradient, as no wave of the image is shorter than lambda/D; by the same in
    all visits, as if no reference showed it. Both are upper bounds, within a factor of 1.5 and 3 of the rms that moved
    and wide stars leave: differences of pixels see the light beyond the hole.
    """
    metrics = visit.metrics
    sums = aperture_sums(visit.light.star_e_s, overlap_weights(visit.radius_pixels))
    square = np.sum(np.square(np.gradient(sums)), axis=0) * (visit.n_frames * visit.exposure_s) ** 2
    axis = centred_axis(len(sums), visit.pixel_arcsec)
    inside = metrics.zone.covers(axis, axis, -metrics.aperture_radius_arcsec)
    separation = np.hypot(axis[:, None], axis)
    near = []
    for planet in visit.light.planets:
        away = np.abs(separation - math.hypot(planet.x_arcsec, planet.y_arcsec))
        around = inside & (away <= _ANNULUS_LAMBDA_D * metrics.lambda_d_arcsec) & (not visit.moved)
        near.append(float(square[around].mean()) if around.any() else 0.0)
    step, radius = (1e-3 * part / visit.pixel_arcsec for part in (visit.drift.pointing_mas, visit.star_radius_mas))
    factors = {
        "pointing": 2.0 * step**2,
        "stellar_disc": visit.visits * (2.0 * math.pi / visit.lambda_d_pixels * radius**2 / 8.0) ** 2,
    }
    return {key: sizes(0.0, snr=visit.snr_added(factor * part for part in near)) for key, factor in factors.items()}


def _hole_region(visit: Visit) -> Sizes:
    """Return the size of reading a window alone: overflow that would have come in; what smears into it is known."""
    detector, light = visit.detector, visit.light
    in_columns, in_rows = (peak * visit.exposure_s for peak in light.beyond_peaks_e_s)
    enters = float(overflow(in_columns, detector.blooming_e, 1.0))
    enters += float(overflow(in_rows, detector.trailing_e / visit.em_gain, visit.noise.factor2))
    if enters <= 1e-6:
        return sizes(0.0)
    spill = Spill(visit, full=True)
    hit = any(
        not planet.weights.size or spill.blooms_into(*planet.place) or spill.trails_into(*planet.place)
        for planet in light.planets
    )
    return sizes(1.0, float(hit))
