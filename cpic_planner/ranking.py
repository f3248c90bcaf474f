"""The analytic ranking of the whole sample."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from catalogs.info import snapshot_vintage
from cpic_planner.etc.model import EtcModel
from cpic_planner.etc.planet import ReferencePlanet, reference_distance_au
from cpic_planner.models import RankedTarget, RankResult, ReferencePlanetRecord
from cpic_planner.optimise import Best, optimise
from cpic_planner.targets import Targets
from simulator.config import content_hash
from simulator.outcome import Reason, Status

__all__ = ["judge", "planet_record", "rank_hash", "rank_targets", "sample_text"]


def sample_text(v_mag_max: float, dwarfs_only: bool, singles_only: bool) -> str:
    """Which rows of the catalogue a ranking returns, in words."""
    classes = "dwarfs (V, IV-V) only" if dwarfs_only else "all luminosity classes"
    pairs = "stars with a close companion left out" if singles_only else "stars with companions flagged, not dropped"
    return f"every FGK star of the snapshot with parallax >= 25 mas and V <= {v_mag_max:g}; {classes}; {pairs}"


def planet_record(planet: ReferencePlanet) -> ReferencePlanetRecord:
    """The reference planet as it is written into results."""
    return ReferencePlanetRecord(radius_rjup=planet.radius_rjup, phase_deg=planet.phase_deg, albedo=planet.albedo)


def rank_hash(model: EtcModel, targets: Targets, *, time_s: float, planet: ReferencePlanet) -> str:
    """Hash of everything that decides a ranking."""
    return content_hash(
        {
            "kind": "rank",
            "instrument": model.instrument.model_dump(mode="json"),
            "strategy": vars(model.strategy),
            "bands": list(model.bands),
            "time_s": time_s,
            "planet": planet.model_dump(mode="json"),
            "targets": targets.name.tolist(),
            "v_mag": targets.v_mag.tolist(),
            "distance_pc": targets.distance_pc.tolist(),
            "companions": targets.companions,
        }
    )


def judge(best: Best) -> list[tuple[Status, Reason]]:
    """Whether the reference planet is detected in the given time, and if not, why."""
    verdicts = []
    for frames, margin, floor in zip(best.n_frames, best.margin, best.floor_margin, strict=True):
        if frames < 1:
            verdicts.append((Status.SATURATED, Reason.PIXEL_FULL_WELL))
        elif margin >= 1.0:
            verdicts.append((Status.OK, Reason.NONE))
        elif floor <= 1.0:
            verdicts.append((Status.UNREACHABLE, Reason.SPECKLE_FLOOR))
        else:
            verdicts.append((Status.UNREACHABLE, Reason.INSUFFICIENT_TIME))
    return verdicts


def rank_targets(
    model: EtcModel,
    targets: Targets,
    *,
    time_s: float,
    planet: ReferencePlanet | None = None,
    bands: Sequence[str] | None = None,
    sample: str = "",
) -> RankResult:
    """Rank targets by how clearly their reference planet is detected.

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
    sample : str
        Which stars these are, in words.

    Returns
    -------
    RankResult
        One row per star, best first: descending ``detection_margin`` (significance over the small-sample
        threshold), ties by name.
    """
    planet = planet or ReferencePlanet()
    best = optimise(model, targets, time_s=time_s, planet=planet, bands=bands)
    verdicts = judge(best)
    order = sorted(range(len(targets)), key=lambda i: (-best.margin[i], str(targets.name[i])))
    rows = [_row(model, targets, best, i, rank, verdicts[i], planet) for rank, i in enumerate(order, start=1)]
    counts = Counter("ok" if row.status == "ok" else row.reason for row in rows)
    return RankResult(
        config_hash=rank_hash(model, targets, time_s=time_s, planet=planet),
        catalogue=snapshot_vintage(),
        sample=sample,
        time_s=time_s,
        sigma=model.strategy.sigma,
        reference_library=model.strategy.library,
        reference_planet=planet_record(planet),
        counts=dict(sorted(counts.items())),
        targets=rows,
    )


def _row(
    model: EtcModel,
    targets: Targets,
    best: Best,
    i: int,
    rank: int,
    verdict: tuple[Status, Reason],
    planet: ReferencePlanet,
) -> RankedTarget:
    possible = best.n_frames[i] >= 1
    exposure, frames = float(best.exposure_s[i]), int(best.n_frames[i])
    distance = float(reference_distance_au(targets.select([i]), best.separation_arcsec[i : i + 1], planet)[0, 0])
    luminosity = _finite(targets.luminosity_lsun[i])
    flags = list(targets.flags[i])
    if bool(np.any(model.passbands.grid_flags(targets.teff_k[i], targets.log_g[i], targets.metallicity[i]).any)):
        flags.append("stellar_grid_clamped")
    return RankedTarget(
        rank=rank,
        name=str(targets.name[i]),
        hip=int(targets.hip[i]) if targets.hip[i] else None,
        v_mag=float(targets.v_mag[i]),
        sp_type=str(targets.sp_type[i]),
        distance_pc=float(targets.distance_pc[i]),
        ra_deg=float(targets.ra_deg[i]),
        dec_deg=float(targets.dec_deg[i]),
        separation_arcsec=float(best.separation_arcsec[i]),
        contrast=float(best.contrast[i]),
        band=str(best.band[i]),
        snr=float(best.snr[i]),
        significance=float(best.significance[i]),
        threshold=float(best.threshold[i]),
        detection_margin=float(best.margin[i]),
        status=verdict[0].value,
        reason=verdict[1].value,
        exposure_s=exposure if possible else None,
        n_frames=frames if possible else None,
        em_gain=float(best.em_gain[i]) if possible else None,
        integration_s=frames * exposure if possible else None,
        time_s=float(best.time_s[i]) if possible else None,
        ref_planet_distance_au=distance,
        ref_planet_insolation_au=None if luminosity is None or luminosity <= 0 else distance / math.sqrt(luminosity),
        luminosity_lsun=luminosity,
        companion_separation_arcsec=_finite(targets.companion_separation_arcsec[i]),
        flags=flags,
    )


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
