"""The best setting of every target: where planets are looked for, what is detected, and what limits it."""

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np

from cpic_core import BoolArray, FloatArray, InputError, IntArray, NDArray, Reason, Status
from cpic_planner import etc
from cpic_planner.ranking.programmes import Outlook, picked
from cpic_planner.results import LimitText
from simulator.imaging import BandGeometry
from simulator.signal import frame_limit

_CHANGES = ("without_motion", "without_speckles", "without_background")
_COUNTS = ("visits", "reference_visits", "frames_per_visit", "n_frames")
_ROUNDING = 1e-9
N_SEPARATIONS = 41
MIN_BACKGROUND_APERTURES = 25.0
"""Aperture areas that the background annulus must hold: about a third of them fit without overlap."""


def separation_grid(model: etc.EtcModel, band: str) -> FloatArray:
    """Return diagonal separations with the aperture in a band's zone, a defined threshold and room for noise."""
    inner, outer = etc.usable_range_arcsec(model.instrument, band)
    grid = _roomy(model.metrics[band].geometry, inner, outer, model.strategy.annulus_lambda_d)
    if len(model.strategy.rolls_deg) > 1:  # a planet that is seen at two rolls stands beside the diagonal
        grid = grid[np.array([etc.place_status(model, band, float(place))[0] is Status.OK for place in grid], bool)]
    if grid.size == 0:
        allowed = "a zone with room for aperture, background and three elements"
        raise InputError("band", band, allowed=allowed, hint="see annulus_lambda_d, roll_deg and the hole's edges")
    return grid


@functools.lru_cache(maxsize=64)
def _roomy(band: BandGeometry, inner_arcsec: float, outer_arcsec: float, annulus_lambda_d: float) -> FloatArray:
    grid = np.geomspace(inner_arcsec, outer_arcsec, N_SEPARATIONS)
    room = band.annulus_pixels(grid, annulus_lambda_d) >= MIN_BACKGROUND_APERTURES * band.aperture_pixels
    usable: FloatArray = grid[(band.resolution_elements(grid) >= 3.0) & room]
    usable.flags.writeable = False
    return usable


@dataclass(frozen=True)
class Places:
    """Stars x separations; ``separation_arcsec`` is ``(1 or n, k)``, the others ``(n, k)``."""

    model: etc.EtcModel
    band: str
    separation_arcsec: FloatArray
    contrast: FloatArray
    threshold: FloatArray
    rates: etc.ApertureRates
    motion: etc.SearchMotion | None

    def at(self, stars: IntArray, columns: IntArray) -> Self:
        """Return some of the separations of some stars; parameters as of `picked`."""
        parts = (getattr(self, item.name) for item in fields(self))
        return type(self)(*(picked(part, self.contrast.shape, stars, columns) for part in parts))

    def problem(self, objective: etc.Objective, programme: etc.Programme = etc.ONE_VISIT) -> etc.FrameProblem:
        """Return what the solver of the frames of a visit needs."""
        camera, strategy = self.model.camera(self.band), self.model.strategy
        return etc.frame_problem(self.rates, camera, strategy, objective=objective, programme=programme)

    def outlook(self, snr: float | None = None, *, dark: bool = False) -> Outlook:
        """Return what decides programmes for an SNR, or for a detection; ``dark``: with no background."""
        problem = self.problem("significance" if snr is None else "snr")
        if dark:
            problem = etc.without_background(problem, etc.own_noise(self.rates, problem.camera))
        level = self.threshold if snr is None else np.full(self.contrast.shape, snr)
        places = self.separation_arcsec, self.contrast, self.rates
        return Outlook.of(
            self.model,
            self.band,
            *places,
            problem,
            level,
            searched=snr is None,
            motion=self.motion if snr is None else None,
        )

    def noise(self, choice: etc.FrameChoice, programme: etc.Programme) -> etc.StackNoise:
        """Return the noise of chosen frames, those of all visits together."""
        frames = choice.exposure_s, choice.n_frames, choice.em_gain
        return etc.stack_noise(
            self.rates, *frames, self.model.camera(self.band), self.model.strategy, programme=programme
        )

    def needed(
        self, choice: etc.FrameChoice, programme: etc.Programme, noise: etc.StackNoise | None = None
    ) -> FloatArray:
        """Return the significance over threshold at which half of such observations detect a planet."""
        model, band, place = self.model, self.band, self.separation_arcsec
        seen = noise or self.noise(choice, programme)
        speckled, light = etc.speckled_share(seen), etc.light_share(model, band, place, choice.visit_s)
        visits = etc.effective_of(programme, self.rates.speckle)
        shares = speckled, etc.lit_share(seen, light)
        at_rest = etc.needed_margin(model, band, place, *shares, visits, self.threshold)
        return at_rest * etc.motion_factor(self.motion, programme, choice.visit_s)


@dataclass(frozen=True)
class OptimalSetting:
    """Best setting of each target; arrays of ``n`` stars.

    ``visits`` of ``frames_per_visit`` frames are reduced together with ``reference_visits`` reference visits;
    ``visit_time_s`` is the wall time of one with its references and ``time_s`` that of all, ``unused_s`` what they
    leave of the given time (NaN where none was), ``n_frames`` the science frames of all. ``margin`` is significance
    over the detection threshold at the chosen separation; at ``needed_margin`` half of such observations detect the
    planet there, by the search of the strategy, and ``chance_blind`` and ``chance_known_place`` are the probabilities
    of a detection. ``floor_margin`` is what no programme can pass, at any separation:
    of the given number of visits, or of the most. ``without_motion``, ``without_speckles`` and ``without_background``
    say whether the planet would be detected in the given time under the changes of `cpic_planner.etc.budget`
    (``without_motion``: if it did not move); False where no time was given. ``moves`` says that no programme detects
    it, although one would if it stood still; False where that was not asked. ``independent_visits``,
    ``orbits_searched`` (NaN where the orbit is followed) and ``motion_factor``, which is part of ``needed_margin``, are
    columns of answers too. ``required_visits`` are the fewest of this length that detect it, ``required_drift_factor``
    and ``required_contrast_factor`` the least changes of drift and contrast that make it detected in the given time;
    NaN where it is detected or no value does. ``contrast_limit`` is the faintest contrast that this observation detects
    at the chosen separation, ``deepest_limit`` that of the best separation for it. ``n_frames`` is 0 where every frame
    saturates or the time is too short. ``extrapolated`` says that the planet's albedo is beyond its data in this band,
    ``outside`` why a given separation has no answer (empty: it is in the zone), ``inherited``
    is the flag of `cpic_planner.etc.inherited_terms`.
    """

    band: NDArray[np.str_]
    separation_arcsec: FloatArray
    contrast: FloatArray
    visits: FloatArray
    independent_visits: FloatArray
    orbits_searched: FloatArray
    motion_factor: FloatArray
    reference_visits: FloatArray
    exposure_s: FloatArray
    frames_per_visit: FloatArray
    n_frames: FloatArray
    em_gain: FloatArray
    visit_time_s: FloatArray
    time_s: FloatArray
    unused_s: FloatArray
    snr: FloatArray
    significance: FloatArray
    threshold: FloatArray
    margin: FloatArray
    floor_margin: FloatArray
    needed_margin: FloatArray
    chance_blind: FloatArray
    chance_known_place: FloatArray
    without_motion: BoolArray
    moves: BoolArray
    without_speckles: BoolArray
    without_background: BoolArray
    required_visits: FloatArray
    required_drift_factor: FloatArray
    required_contrast_factor: FloatArray
    contrast_limit: FloatArray
    deepest_limit: FloatArray
    deepest_separation_arcsec: FloatArray
    longest_exposure_s: FloatArray
    peak_columns_e_s: FloatArray
    peak_hole_e_s: FloatArray
    tail_e_s: FloatArray
    core_throughput: FloatArray
    extrapolated: BoolArray
    outside: NDArray[np.str_]
    inherited: NDArray[np.str_]

    @property
    def detected(self) -> BoolArray:
        """Whether half of such observations or more detect the planet."""
        possible = (self.n_frames >= 1) & (self.outside == "")
        return np.asarray(possible & (self.margin >= self.needed_margin * (1.0 - _ROUNDING)))


def best_of(found: Sequence[OptimalSetting], *, by_time: bool = False) -> OptimalSetting:
    """Pick row by row the one of largest margin over what is needed (or of least time), the first of equals.

    Extrapolated ones come last. Whether a change would make the planet detected is said of any of them; the required
    drift, and what no programme can pass, are the largest.
    """
    costs = [
        np.where(item.n_frames > 0, item.time_s, np.inf) if by_time else -item.margin / item.needed_margin
        for item in found
    ]
    cost = np.stack(costs)
    answered = np.stack([item.n_frames > 0 for item in found])
    last = np.stack([item.extrapolated for item in found]) | ~answered
    rows = np.arange(cost.shape[1])
    pick = np.lexsort((np.broadcast_to(np.arange(len(found))[:, None], cost.shape), cost, last), axis=0)[0]
    changed = {name: np.any([getattr(item, name) for item in found], axis=0) for name in _CHANGES}
    drift = np.fmax.reduce([item.required_drift_factor for item in found])
    floor = np.max([item.floor_margin / item.needed_margin for item in found], axis=0)
    others = (item.name for item in fields(OptimalSetting) if item.name not in _CHANGES)
    best = OptimalSetting(
        **changed, **{name: np.stack([getattr(item, name) for item in found])[pick, rows] for name in others}
    )
    drift = np.where(best.detected, np.nan, drift)
    return replace(best, required_drift_factor=drift, floor_margin=floor * best.needed_margin)


def detection_statuses(best: OptimalSetting, model: etc.EtcModel) -> list[tuple[Status, Reason]]:
    """Return whether the reference planet is detected in the given time, and if not, why.

    A detection is a significance that half of such observations show, by the search of the model's strategy
    (`OptimalSetting.needed_margin`). The reason ``speckle_floor`` says that no length of the given number of visits
    reaches it, ``common_speckle_floor`` that no number of visits does either, up to 1000; neither says that the drift
    decides: `limits_of` says that.
    """
    floor = Reason.COMMON_SPECKLE_FLOOR if model.strategy.visits is None else Reason.SPECKLE_FLOOR
    return [_verdict(best, i, model.camera(str(best.band[i])), floor) for i in range(len(best.margin))]


def _verdict(best: OptimalSetting, i: int, camera: etc.FrameCamera, floor: Reason) -> tuple[Status, Reason]:
    if best.outside[i]:
        return Status.OUTSIDE_FIELD, Reason(str(best.outside[i]))
    if best.n_frames[i] < 1:
        return no_frame_status(best, i, camera)
    if best.detected[i]:
        return Status.OK, Reason.NONE
    if best.without_motion[i] or best.moves[i]:
        return Status.UNREACHABLE, Reason.PLANET_MOVES
    enough = best.floor_margin[i] > best.needed_margin[i]
    return Status.UNREACHABLE, Reason.INSUFFICIENT_TIME if enough else floor


def limits_of(standings: Sequence[tuple[Status, Reason]], best: OptimalSetting) -> list[LimitText]:
    """Return what limits the detection of each star's reference planet in the given time, visits chosen anew.

    Parameters
    ----------
    standings : sequence
        Status and reason of each star, of `detection_statuses`.
    best : OptimalSetting
        The same stars, in their best band.
    """
    changes = zip(*(getattr(best, name).tolist() for name in _CHANGES), strict=True)
    return [
        etc.limit_of(
            *standing,
            detected=standing[0] is Status.OK,
            without_motion=still,
            without_speckles=calm,
            without_background=dark,
            common=standing[1] is Reason.COMMON_SPECKLE_FLOOR,
        )
        for standing, (still, calm, dark) in zip(standings, changes, strict=True)
    ]


def no_frame_status(best: OptimalSetting, i: int, camera: etc.FrameCamera) -> tuple[Status, Reason]:
    """Return why not even one frame is possible: the shortest one saturates, or the time is too short for it."""
    peaks = (float(best.peak_columns_e_s[i]), float(best.peak_hole_e_s[i]), float(best.tail_e_s[i]))
    limit = frame_limit(*peaks, camera.exposure_min_s, 1.0, camera)
    return (Status.UNREACHABLE, Reason.NO_TIME) if limit is Reason.NONE else (Status.SATURATED, limit)


_TAKEN = ("exposure_s", "em_gain", "visit_time_s", "time_s", "unused_s", "motion_factor", "independent_visits")


def setting_fields(
    model: etc.EtcModel, best: OptimalSetting, i: int, standing: tuple[Status, Reason], limited_by: LimitText
) -> dict[str, Any]:
    """Return what rows say of a star's best setting: its frames, and whether it detects the reference planet.

    Parameters
    ----------
    model : EtcModel
    best : OptimalSetting
    i : int
        Number of the star.
    standing : tuple
        Its status and reason, of `detection_statuses`.
    limited_by : str
        What limits it, of `limits_of`.
    """
    possible = best.n_frames[i] >= 1

    def taken(value: float) -> float | None:
        """Return a value where the star can be observed."""
        return float(value) if possible else None

    return {
        "status": standing[0].value,
        "reason": standing[1].value,
        "verdict": etc.verdict_of(standing[0], detected=True),
        "verdict_mode": model.strategy.search,
        "detection_probability": finite(best.chance_blind[i]),
        "detection_probability_known_place": finite(best.chance_known_place[i]),
        "detection_margin": float(best.margin[i]),
        "limited_by": limited_by,
        **{name: int(getattr(best, name)[i]) if possible else None for name in _COUNTS},
        **{name: taken(getattr(best, name)[i]) for name in _TAKEN},
        "integration_s": taken(best.n_frames[i] * best.exposure_s[i]),
        "span_days": taken(float(etc.programme_days(model, best.visits[i], best.time_s[i]))),
        "orbits_searched": int(n) if possible and math.isfinite(n := best.orbits_searched[i]) else None,
        "required_visits": int(n) if math.isfinite(n := best.required_visits[i]) else None,
        "required_drift_factor": finite(best.required_drift_factor[i]),
        "required_contrast_factor": finite(best.required_contrast_factor[i]),
    }


QUICK, CALM, FAINT = 10.0, 0.1, 10.0
"""Most time over that given, and least factor on the drift, of tier 2; most factor on the planet's light of tier 3."""


def tier_of(setting: Mapping[str, Any], required_time_s: float | None, time_s: float) -> int:
    """Return the tier of a star's priority, 1 to 4, by what its reference planet lacks.

    1: it is detected in the given time. 2: it would be in at most `QUICK` times the time, or with at least `CALM` times
    the drift, one of the two changed alone. 3: a planet at most `FAINT` times as bright there would be. 4: the others.

    Parameters
    ----------
    setting : mapping
        Of `setting_fields`.
    required_time_s : float or None
        Least wall time that detects it.
    time_s : float
        Given wall time.
    """
    if setting["verdict"] == "detected":
        return 1
    drift, contrast = setting["required_drift_factor"], setting["required_contrast_factor"]
    if (required_time_s or math.inf) <= QUICK * time_s or (drift or 0.0) >= CALM:
        return 2
    return 3 if (contrast or math.inf) <= FAINT else 4


def finite(value: float) -> float | None:
    """Return a number as results hold it: null for one that is not finite."""
    return float(value) if math.isfinite(value) else None
