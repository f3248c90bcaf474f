"""The inputs of the sizes of camera effects: pixels, planets, their noise, hits by particles.

Whether sums of frames may stand for the frames, from closed forms.
"""

import functools
import itertools
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from cpic_core import BoolArray, FloatArray, Outcome, Reason, Status, compute_once, stream
from simulator.camera import FrameNoise, load_calibration_set
from simulator.config import AnyDetector, CosmicRayConfig, content_hash
from simulator.detectors import INFRARED, VISIBLE, in_sums
from simulator.effects import draw_cosmic_rays
from simulator.imaging import PsfMetrics
from simulator.ledger.light import PlanetPlace, SceneLight, Spill
from simulator.signal import overflow, pixel_saturated

# Radius of the Gaussian that stands for the core of a planet, lambda/D.
_CORE_SIGMA = 0.66
_SPILLED = 1e-6  # of the noise of a pixel, from which on what it passes on counts
# Speckles of a drifting wavefront scatter by this much more than their two parts would alone, and the largest of a
# stamp by so many times that.
_SPECKLE_SCATTER, _SPECKLE_MOST = 1.4, 3.5


class Flaw(NamedTuple):
    """Relative change of the response and of the dark current by one flaw: on the stamp, and at most on the frame."""

    response: FloatArray
    dark_e_s: FloatArray
    most_response: float
    most_dark_e_s: float


@functools.lru_cache(maxsize=8)
def stamp_flaws(detector: AnyDetector, corner: tuple[int, int], side: int) -> tuple[dict[str, Flaw], FloatArray]:
    """Return the flaws of the calibration set, by switch, and the stripes of the stamp and of the frame.

    Parameters
    ----------
    detector : Detector or InfraredDetector
    corner : tuple of int
        First row and column of the stamp on the frame.
    side : int
        Of the stamp, pixels.
    """
    maps = load_calibration_set(detector)
    hot = maps.hot & ~maps.bad_column
    raised, nothing = maps.dark_e_s - maps.dark_smooth_e_s, np.zeros(maps.shape)
    frame = {
        "flat": (np.where(maps.sensitivity > 0, maps.sensitivity - 1.0, 0.0), nothing),
        "dark_structure": (nothing, maps.dark_smooth_e_s - maps.dark_uniform_e_s),
        "bad_pixels": (maps.dead * 1.0, hot * raised),
        "bad_columns": (maps.bad_column * 1.0, maps.bad_column * raised),
    }

    def stamp(values: FloatArray) -> FloatArray:
        part = np.zeros((side, side))
        rows, columns = (np.arange(first, first + side) for first in corner)
        there = [(axis >= 0) & (axis < size) for axis, size in zip((rows, columns), values.shape, strict=True)]
        part[np.ix_(*there)] = np.abs(values[np.ix_(rows[there[0]], columns[there[1]])])
        return part

    found = {
        key: Flaw(stamp(response), stamp(dark), float(np.abs(response).max()), float(np.abs(dark).max()))
        for key, (response, dark) in frame.items()
    }
    seen = maps.stripe_adu[max(corner[1], 0) : corner[1] + side]
    return found, np.array([np.abs(seen).max(initial=0.0), np.abs(maps.stripe_adu).max(initial=0.0)])


@dataclass(frozen=True, eq=False)
class CameraCase:
    """The inputs that the sizes are worked out for.

    Attributes
    ----------
    detector : Detector or InfraredDetector
    light : SceneLight
    noise : FrameNoise
    exposure_s : float
    n_frames : int
    em_gain : float
    reduced : bool
        Whether flat, bias structure and flaws are calibrated out and particles rejected.
    first_pixel : tuple of int or None
        Of the stamp on the frame.
    full : bool
        Whether the frame around the stamp is read too.
    hits_per_s : float
        Tracks a second and pixel.
    hits : PixelHits
    lost_per_s : float
        Rate of tracks that touch an aperture.
    variances : tuple of dict
        Of every measured planet, by origin (`simulator.ledger.visit.visit_variance_e2`), with the least light of other
        sources.
    column_peak_e_s : float
        Brightest pixel in the columns of the hole or of a source on the frame.
    radius_pixels, lambda_d_pixels : float
        Of the aperture; lambda/D.
    edge_arcsec : float
        Separation from an axis below which an aperture meets the mask.
    visits : int
        Of the programme. What averages over visits is weighed as in one of them; what all have in common stands in
        ``variances`` times their number (``common``), so that the rest counts the less the more of them there are.
    """

    detector: Any
    light: SceneLight
    noise: FrameNoise
    exposure_s: float
    n_frames: int
    em_gain: float
    reduced: bool
    first_pixel: tuple[int, int]
    full: bool
    hits_per_s: float
    hits: "PixelHits"
    lost_per_s: float
    variances: tuple[dict[str, float], ...]
    column_peak_e_s: float
    radius_pixels: float
    lambda_d_pixels: float
    pixel_arcsec: float
    edge_arcsec: float
    visits: int = 1

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
        return Spill(self)

    def overflow(self, mean_e: FloatArray | float, well_e: float, factor2: float) -> FloatArray:
        """Return what a limit cuts off; see `overflow`."""
        return overflow(mean_e, well_e, factor2)

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


_SIDE, _TRACKS = 700, 1500.0
_CM_PER_UM = 1e-4


class PixelHits(NamedTuple):
    """Charge of a track by pixels.

    Attributes
    ----------
    mean_e : float
        Electrons a track.
    square_e2 : float
        Sum over its pixels of the squared charge.
    charge_e : ndarray
        Charge of pixels that were hit, ascending.
    """

    mean_e: float
    square_e2: float
    charge_e: FloatArray

    def share_above(self, level_e: float) -> float:
        """Return the share of the squared charge in pixels of more than a level."""
        squares = self.charge_e**2
        return float(squares[np.searchsorted(self.charge_e, level_e) :].sum() / max(squares.sum(), 1e-300))

    @property
    def typical_e(self) -> float:
        """Mean charge weighted by its square."""
        squares = self.charge_e**2
        return float((squares * self.charge_e).sum() / max(squares.sum(), 1e-300))


@functools.lru_cache(maxsize=8)
def pixel_hits(config: CosmicRayConfig, pixel_um: float) -> PixelHits:
    """Return the moments of a configured model of tracks, from 1500 of them drawn from a fixed stream.

    The moments of a track that crosses pixels at random have no closed form; those drawn are good to 5 %. They are
    drawn once and kept in the cache, but for tracks of a file, which may change.

    Parameters
    ----------
    config : CosmicRayConfig
    pixel_um : float
        Side of a pixel.
    """

    def drawn() -> dict[str, Any]:
        area_cm2 = (_SIDE * pixel_um * _CM_PER_UM) ** 2
        found = draw_cosmic_rays(config, (_SIDE, _SIDE), pixel_um, 1.0, _TRACKS / area_cm2, stream(1, "ledger", "hits"))
        charge, tracks = np.sort(found.electrons.astype(np.float64)), max(found.n_events, 1)
        return PixelHits(charge.sum() / tracks, (charge**2).sum() / tracks, charge)._asdict()

    def read(found: Mapping[str, Any]) -> PixelHits:
        return PixelHits(float(found["mean_e"]), float(found["square_e2"]), found["charge_e"])

    if config.model == "template" and config.template.template_file is not None:
        return read(drawn())
    key = {"tracks": config.model_dump(mode="json"), "pixel_um": pixel_um, "side": _SIDE, "mean": _TRACKS, "schema": 1}
    return compute_once(f"hits-{content_hash(key)}", drawn, read)


# What a reduction takes out (flaws, bias, particles) or what moves charge between pixels: sums of frames leave it out.
NOT_IN_SUMS = tuple(dict.fromkeys(in_sums((*VISIBLE, *INFRARED), "left_out", "moves_charge", "not_additive")))
_SIGMA = 8.0


def sums_possible(case: CameraCase, metrics: PsfMetrics, star_e_s: float, *, moved: bool) -> Outcome[float]:
    """Return whether frames add up over the dark hole: no pixel in it reaches a limit, and none overflows into it.

    The image that is made decides it pixel by pixel (`simulator.observing.hole_stack.hole_stackable`); this is the same
    from tables of the light.
    """
    if moved:
        return Outcome.refuse(Status.INVALID, Reason.NOT_ADDITIVE, "the star stands off the mask")
    detector, t, gain = case.detector, case.exposure_s, case.em_gain
    light = star_e_s * metrics.peak_on_axis_hole + case.light.sky_e_s
    light += max((source.stamp_peak_e_s for source in case.light.sources), default=0.0)
    inside = pixel_saturated(light * t + case.noise.dark_e + case.noise.clock_e, gain, detector, _SIGMA)
    if inside.status is not Status.OK:
        return inside
    rows, columns = (_runs(np.asarray(metrics.hole.any(axis=axis))) for axis in (1, 0))
    places = list(itertools.product(rows, columns))
    if any(case.spill.blooms_into(*place) for place in places):
        return Outcome.refuse(Status.SATURATED, Reason.PIXEL_FULL_WELL, "bloomed columns may enter the hole")
    if any(case.spill.trails_into(*place) for place in places):
        return Outcome.refuse(Status.SATURATED, Reason.REGISTER_FULL_WELL, "tails of the register may enter the hole")
    return inside


def _runs(inside: BoolArray) -> list[slice]:
    """Return the intervals of pixels that are inside."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
    return [slice(int(low), int(high)) for low, high in zip(edges[::2], edges[1::2], strict=True)]
