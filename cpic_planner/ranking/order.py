"""The analytic ranking of the whole sample."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from catalogs import snapshot_vintage
from cpic_core import FloatArray, InputError, IntArray, Reason, Status, announce
from cpic_planner import etc
from cpic_planner.planets import Planets, PopulationChoice
from cpic_planner.queries import ReferencePlanet
from cpic_planner.ranking.completeness import BandCompleteness, completeness
from cpic_planner.ranking.known_completeness import KnownChoice, KnownSample, known_completeness
from cpic_planner.ranking.optimiser import OptimalSetting, best_in_band, best_of, optimise
from cpic_planner.registry import DEFAULT_SCORE, SCORES, ScoreName, StarNumbers
from cpic_planner.results import LimitText, RankedTarget, RankResult, ReferencePlanetRecord
from cpic_planner.targets import Targets
from cpic_planner.version import __version__
from simulator.config import content_hash
from simulator.signal import frame_limit


def planet_record(planet: ReferencePlanet) -> ReferencePlanetRecord:
    """The reference planet as it is written into results."""
    return ReferencePlanetRecord(radius_rjup=planet.radius_rjup, phase_deg=planet.phase_deg, albedo=planet.albedo.label)


@dataclass(frozen=True)
class RankSetting:
    """What a ranking is made with; made by `of`.

    ``time_s`` is the wall time per target and band, ``planet`` the reference planet, ``bands`` names of bands of the
    model, ``population`` what completeness counts, and ``score`` what the stars are ordered by.
    """

    model: etc.EtcModel
    time_s: float
    planet: ReferencePlanet
    bands: tuple[str, ...]
    population: PopulationChoice | KnownChoice
    score: ScoreName

    @classmethod
    def of(
        cls,
        model: etc.EtcModel,
        *,
        time_s: float,
        planet: ReferencePlanet | None = None,
        bands: Sequence[str] | None = None,
        population: PopulationChoice | KnownChoice | None = None,
        score: ScoreName = DEFAULT_SCORE,
    ) -> Self:
        """Return what a ranking is asked for, checked and complete; parameters are those of `rank_targets`."""
        return cls(
            model=model,
            time_s=etc.check_range("time_s", time_s, 1e-3, 1e9, "s"),
            planet=planet or ReferencePlanet(),
            bands=model.named(bands),
            population=population or PopulationChoice.default(),
            score=score,
        )

    def drawn(self, targets: Targets) -> Planets | KnownSample:
        """Return the planets that completeness counts: of a population, the same at every star, or each star's own."""
        choice = self.population
        return choice.draw(targets) if isinstance(choice, KnownChoice) else choice.draw()

    def digest(self, targets: Targets) -> str:
        """Hash of everything that decides a ranking."""
        decides = {
            "kind": "rank",
            "version": __version__,
            "model": self.model.content(),
            "detection": etc.default_law().model_dump(mode="json"),
            "targets": targets.content(),
            "bands": list(self.bands),
            "time_s": self.time_s,
            "score": self.score,
            "planet": self.planet.content(),
            "population": self.population.content(),
        }
        return content_hash(decides)


@dataclass(frozen=True)
class Ranked:
    """Numbers of a ranking before they become rows; arrays of ``n`` stars.

    ``best`` is the reference planet's best band, ``by_band`` the same in each band, ``quickest`` its least time to a
    detection (if asked for); ``counted`` the completeness in each band, ``picked`` the index of the band where it is
    largest per hour (or largest, where that is the score).
    """

    setting: RankSetting
    best: OptimalSetting
    by_band: tuple[OptimalSetting, ...]
    quickest: OptimalSetting | None
    counted: tuple[BandCompleteness, ...]
    picked: IntArray
    score: FloatArray

    def chosen(self, name: str) -> FloatArray:
        """A column of the completeness of the picked band."""
        return np.stack([getattr(item, name) for item in self.counted])[self.picked, np.arange(len(self.picked))]

    @property
    def completeness_time_s(self) -> FloatArray:
        """Wall time of the observation that the completeness refers to; 0 for none."""
        return np.stack([item.time_s for item in self.by_band])[self.picked, np.arange(len(self.picked))]


def detection_statuses(best: OptimalSetting, model: etc.EtcModel) -> list[tuple[Status, Reason]]:
    """Whether the reference planet is detected in the given time, and if not, why.

    A detection is a significance that half of the visits show at a known place (`OptimalSetting.needed_margin`). The
    reason ``speckle_floor`` says that no length of visit reaches it, not that the drift decides: `limits_of` says that.

    Parameters
    ----------
    best : OptimalSetting
    model : EtcModel
    """
    return [_verdict(best, i, model.camera(str(best.band[i]))) for i in range(len(best.margin))]


def _verdict(best: OptimalSetting, i: int, camera: etc.FrameCamera) -> tuple[Status, Reason]:
    if best.outside[i]:
        return Status.OUTSIDE_FIELD, Reason(str(best.outside[i]))
    if best.n_frames[i] < 1:
        return no_frame_status(best, i, camera)
    if best.margin[i] >= best.needed_margin[i]:
        return Status.OK, Reason.NONE
    if best.floor_margin[i] <= best.needed_margin[i]:
        return Status.UNREACHABLE, Reason.SPECKLE_FLOOR
    return Status.UNREACHABLE, Reason.INSUFFICIENT_TIME


def limits_of(standings: Sequence[tuple[Status, Reason]], best: OptimalSetting) -> list[LimitText]:
    """Return what limits the detection of each star's reference planet in the given time.

    Parameters
    ----------
    standings : sequence
        Status and reason of each star, of `detection_statuses`.
    best : OptimalSetting
        The same stars, in their best band.
    """
    changes = zip(best.without_speckles.tolist(), best.without_background.tolist(), strict=True)
    return [
        etc.limit_of(*standing, detected=standing[0] is Status.OK, without_speckles=calm, without_background=dark)
        for standing, (calm, dark) in zip(standings, changes, strict=True)
    ]


def no_frame_status(best: OptimalSetting, i: int, camera: etc.FrameCamera) -> tuple[Status, Reason]:
    """Why not even one frame is possible: the shortest one saturates, or the time is too short for it."""
    peaks = (float(best.peak_columns_e_s[i]), float(best.peak_hole_e_s[i]), float(best.tail_e_s[i]))
    limit = frame_limit(*peaks, camera.exposure_min_s, 1.0, camera)
    return (Status.UNREACHABLE, Reason.NO_TIME) if limit is Reason.NONE else (Status.SATURATED, limit)


def ranked(setting: RankSetting, targets: Targets, *, with_times: bool = True) -> Ranked:
    """Best settings, completeness and score of every star; least times of detection only ``with_times``."""
    model, planet, bands = setting.model, setting.planet, setting.bands
    planets = setting.drawn(targets)
    chosen = SCORES[setting.score]
    if len(targets) < 1:
        raise InputError("targets", len(targets), allowed="at least one star")
    by_band = tuple(best_in_band(model, targets, band, setting.time_s, planet) for band in bands)
    best = best_of(by_band)
    quickest = None
    if with_times or chosen.timed:
        quickest = optimise(model, targets, detect=True, planet=planet, bands=bands)
    counted = tuple(_counted(model, targets, band, planets, item) for band, item in zip(bands, by_band, strict=True))
    numbers = _numbers(best, by_band, quickest, counted)
    picked = np.argmax(chosen.by_band(numbers), axis=0)
    return Ranked(setting, best, by_band, quickest, counted, picked, np.asarray(chosen.value(numbers), float))


def _numbers(
    best: OptimalSetting,
    by_band: Sequence[OptimalSetting],
    quickest: OptimalSetting | None,
    counted: Sequence[BandCompleteness],
) -> StarNumbers:
    """What scores are made of; completeness is -1 where albedos are extrapolated, if they are known in another band."""
    shares = np.stack([part.completeness for part in counted])
    times = np.stack([item.time_s for item in by_band])
    known = np.array(["extrapolated" not in part.flags for part in counted])
    counts = known[:, None] | ~known.any()
    with np.errstate(divide="ignore", invalid="ignore"):
        rates = np.where(times > 0, shares / times * 3600.0, 0.0)
    speed = np.zeros(shares.shape[1])
    if quickest is not None:
        speed = np.where(quickest.n_frames > 0, 3600.0 / np.maximum(quickest.time_s, 1e-9), 0.0)
    return StarNumbers(
        completeness=np.where(counts, shares, -1.0),
        completeness_per_hour=np.where(counts, rates, -1.0),
        detections_per_hour=speed,
        margin=best.margin,
        snr=best.snr,
        significance=best.significance,
        contrast=best.contrast,
        deepest_limit=best.deepest_limit,
        time_s=best.time_s,
    )


def _counted(
    model: etc.EtcModel, targets: Targets, band: str, planets: Planets | KnownSample, setting: OptimalSetting
) -> BandCompleteness:
    """Completeness of the observation of each star: of planets that all may have, or of those that it has."""
    taken = {name: getattr(setting, name) for name in ("exposure_s", "n_frames", "em_gain")}
    if isinstance(planets, KnownSample):
        return known_completeness(model, targets, band, planets, **taken)
    return completeness(model, targets, band, planets, **taken)


def ranked_order(found: Ranked, targets: Targets) -> list[int]:
    """Stars from best to worst: by score, ties by the reference planet's margin, then by name.

    Parameters
    ----------
    found : Ranked
    targets : Targets
    """
    return sorted(range(len(targets)), key=lambda i: (-found.score[i], -found.best.margin[i], str(targets.name[i])))


def rank_targets(
    model: etc.EtcModel,
    targets: Targets,
    *,
    time_s: float,
    planet: ReferencePlanet | None = None,
    bands: Sequence[str] | None = None,
    population: PopulationChoice | KnownChoice | None = None,
    score: ScoreName = DEFAULT_SCORE,
    sample: str = "",
    catalogue: str | None = None,
) -> RankResult:
    """Rank targets.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars.
    time_s : float
        Wall time per target and band, overheads and reference frames included.
    planet : ReferencePlanet, optional
    bands : sequence of str, optional
        All of the model by default.
    population : PopulationChoice or KnownChoice, optional
        What completeness refers to; giant planets by default. With known planets it is the probability that the
        observation detects at least one of the star's own at the given date; stars without any have 0.
    score : str
        What the ranking is by, a name of `cpic_planner.registry.scores.SCORES`: ``completeness_per_hour``,
        ``completeness``, ``detection_margin``, ``detection_time`` or ``contrast_limit``.
    sample : str
        Which stars these are, in words.
    catalogue : str, optional
        Which table they are from (`catalogs.catalogue.Catalogue.provenance`); the snapshot by default.

    Returns
    -------
    RankResult
        One row per star, best first: descending score, ties by ``detection_margin``, then name.

    Raises
    ------
    InputError
        For values out of range or an unknown score.
    """
    setting = RankSetting.of(model, time_s=time_s, planet=planet, bands=bands, population=population, score=score)
    announce(f"ranking {len(targets)} stars")
    found = ranked(setting, targets)
    standings = detection_statuses(found.best, model)
    limits = limits_of(standings, found.best)
    said = zip(standings, limits, strict=True)
    settings = [setting_fields(found.best, i, *standing) for i, standing in enumerate(said)]
    blooming = {band: etc.companion_saturates(model, targets, band, found.best.exposure_s) for band in model.bands}
    rows = [
        _row(found, targets, i, rank, settings[i], bool(blooming[str(found.best.band[i])][i]))
        for rank, i in enumerate(ranked_order(found, targets), start=1)
    ]
    counts = Counter("ok" if row.status == "ok" else row.reason for row in rows)
    return RankResult(
        config_hash=setting.digest(targets),
        catalogue=snapshot_vintage() if catalogue is None else catalogue,
        sample=sample,
        date_utc=targets.date_utc,
        time_s=setting.time_s,
        sigma=model.strategy.sigma,
        reference_library=model.strategy.library,
        reference_planet=planet_record(setting.planet),
        population=setting.population.record(),
        score_name=score,
        counts=dict(sorted(counts.items())),
        counts_limited_by=dict(sorted(Counter(limits).items())),
        targets=rows,
    )


def _row(
    found: Ranked, targets: Targets, i: int, rank: int, setting: dict[str, Any], companion_blooms: bool
) -> RankedTarget:
    best, quickest, model, planet = found.best, found.quickest, found.setting.model, found.setting.planet
    star = targets.select([i])
    band = str(best.band[i])
    separation = best.separation_arcsec[i : i + 1]
    distance = float(etc.reference_distance_au(star, separation, planet)[0, 0])
    luminosity = finite(targets.luminosity_lsun[i])
    flags = [*targets.flags[i], *model.strategy.reference_library.flags]
    flags += etc.reference_notes(model, star, band, float(separation[0]), planet) + etc.hole_notes(model, band)
    clamped = model.passbands.grid_flags(targets.teff_k[i], targets.log_g[i], targets.metallicity[i]).any
    if bool(np.any(clamped)) and "stellar_grid_clamped" not in flags:
        flags.append("stellar_grid_clamped")
    if companion_blooms:
        flags.append("companion_saturates")
    counted = found.counted[found.picked[i]]
    time_s = float(found.completeness_time_s[i])
    share = float(counted.completeness[i])
    expected = counted.expected_detections
    return RankedTarget.of(
        best,
        targets,
        at=i,
        rank=rank,
        score=float(found.score[i]),
        hip=int(targets.hip[i]) if targets.hip[i] else None,
        detection_time_s=float(quickest.time_s[i]) if quickest is not None and quickest.n_frames[i] >= 1 else None,
        completeness=share,
        completeness_error=float(counted.standard_error[i]),
        completeness_band=counted.band,
        completeness_time_s=time_s if time_s > 0 else None,
        completeness_per_hour=share / time_s * 3600.0 if time_s > 0 else 0.0,
        expected_detections=None if expected is None else float(expected[i]),
        integration_s=setting["n_frames"] * setting["exposure_s"] if setting["n_frames"] else None,
        ref_planet_distance_au=distance,
        ref_planet_insolation_au=None if luminosity is None or luminosity <= 0 else distance / math.sqrt(luminosity),
        flags=flags,
        **setting,
    )


def setting_fields(
    best: OptimalSetting, i: int, standing: tuple[Status, Reason], limited_by: LimitText
) -> dict[str, Any]:
    """Return what rows say of a star's best setting: its frames, and whether it detects the reference planet.

    Parameters
    ----------
    best : OptimalSetting
    i : int
        Number of the star.
    standing : tuple
        Its status and reason, of `detection_statuses`.
    limited_by : str
        What limits it, of `limits_of`.
    """
    possible = best.n_frames[i] >= 1

    def taken(values: FloatArray) -> float | None:
        """Return the star's value where it can be observed."""
        return float(values[i]) if possible else None

    return {
        "status": standing[0].value,
        "reason": standing[1].value,
        "verdict": etc.verdict_of(standing[0], detected=True),
        "verdict_mode": "known_place",
        "detection_probability": finite(best.chance_blind[i]),
        "detection_probability_known_place": finite(best.chance_known_place[i]),
        "detection_margin": float(best.margin[i]),
        "limited_by": limited_by,
        "n_frames": int(best.n_frames[i]) if possible else None,
        "exposure_s": taken(best.exposure_s),
        "em_gain": taken(best.em_gain),
        "time_s": taken(best.time_s),
    }


def finite(value: float) -> float | None:
    """Return a number as results hold it: null for one that is not finite."""
    return float(value) if math.isfinite(value) else None
