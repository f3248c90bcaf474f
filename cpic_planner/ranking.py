"""The analytic ranking of the whole sample."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from catalogs.info import snapshot_vintage
from cpic_planner.etc.limits import frame_limit
from cpic_planner.etc.model import EtcModel
from cpic_planner.etc.place import hole_notes
from cpic_planner.etc.planet import ReferencePlanet, reference_distance_au, reference_notes
from cpic_planner.etc.rates import companion_saturates
from cpic_planner.models import RankedTarget, RankResult, ReferencePlanetRecord
from cpic_planner.optimiser import Best, optimise
from cpic_planner.targets import Targets
from cpic_planner.version import __version__
from simulator.config import content_hash
from simulator.config.detector import Detector
from simulator.outcome import Reason, Status

__all__ = ["judge", "no_frame", "planet_record", "rank_hash", "rank_targets"]


def planet_record(planet: ReferencePlanet) -> ReferencePlanetRecord:
    """The reference planet as it is written into results."""
    return ReferencePlanetRecord(radius_rjup=planet.radius_rjup, phase_deg=planet.phase_deg, albedo=planet.albedo.label)


def rank_hash(
    model: EtcModel, targets: Targets, *, time_s: float, planet: ReferencePlanet, bands: Sequence[str] | None = None
) -> str:
    """Hash of everything that decides a ranking."""
    return content_hash(
        {
            "kind": "rank",
            "version": __version__,
            "model": model.content(),
            "bands": list(bands or model.bands),
            "time_s": time_s,
            "planet": planet.content(),
            "targets": targets.content(),
        }
    )


def judge(best: Best, detector: Detector) -> list[tuple[Status, Reason]]:
    """Whether the reference planet is detected in the given time, and if not, why."""
    return [_verdict(best, i, detector) for i in range(len(best.margin))]


def _verdict(best: Best, i: int, detector: Detector) -> tuple[Status, Reason]:
    if best.n_frames[i] < 1:
        return no_frame(best, i, detector)
    if best.margin[i] >= 1.0:
        return Status.OK, Reason.NONE
    if best.floor_margin[i] <= 1.0:
        return Status.UNREACHABLE, Reason.SPECKLE_FLOOR
    return Status.UNREACHABLE, Reason.INSUFFICIENT_TIME


def no_frame(best: Best, i: int, detector: Detector) -> tuple[Status, Reason]:
    """Why not even one frame is possible: the shortest one saturates, or the time is too short for it."""
    peaks = (float(best.peak_columns_e_s[i]), float(best.peak_hole_e_s[i]), float(best.tail_e_s[i]))
    limit = frame_limit(*peaks, detector.exposure_min_s, 1.0, detector)
    return (Status.UNREACHABLE, Reason.NO_TIME) if limit is Reason.NONE else (Status.SATURATED, limit)


def rank_targets(
    model: EtcModel,
    targets: Targets,
    *,
    time_s: float,
    planet: ReferencePlanet | None = None,
    bands: Sequence[str] | None = None,
    sample: str = "",
    catalogue: str | None = None,
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
    catalogue : str, optional
        Which table they are from (`catalogs.catalogue.Catalogue.provenance`); the snapshot by default.

    Returns
    -------
    RankResult
        One row per star, best first: descending ``detection_margin`` (significance over the small-sample
        threshold), ties by name.
    """
    planet = planet or ReferencePlanet()
    best = optimise(model, targets, time_s=time_s, planet=planet, bands=bands)
    verdicts = judge(best, model.instrument.detector)
    blooming = {band: companion_saturates(model, targets, band, best.exposure_s) for band in model.bands}
    order = sorted(range(len(targets)), key=lambda i: (-best.margin[i], str(targets.name[i])))
    rows = [
        _row(model, targets, best, i, rank, verdicts[i], planet, bool(blooming[str(best.band[i])][i]))
        for rank, i in enumerate(order, start=1)
    ]
    counts = Counter("ok" if row.status == "ok" else row.reason for row in rows)
    return RankResult(
        config_hash=rank_hash(model, targets, time_s=time_s, planet=planet, bands=bands),
        catalogue=snapshot_vintage() if catalogue is None else catalogue,
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
    companion_blooms: bool,
) -> RankedTarget:
    possible = best.n_frames[i] >= 1
    exposure, frames = float(best.exposure_s[i]), int(best.n_frames[i])
    distance = float(reference_distance_au(targets.select([i]), best.separation_arcsec[i : i + 1], planet)[0, 0])
    luminosity = _finite(targets.luminosity_lsun[i])
    flags = list(targets.flags[i])
    flags += reference_notes(model, targets.select([i]), str(best.band[i]), float(best.separation_arcsec[i]), planet)
    flags += hole_notes(model, str(best.band[i]))
    clamped = model.passbands.grid_flags(targets.teff_k[i], targets.log_g[i], targets.metallicity[i]).any
    if bool(np.any(clamped)) and "stellar_grid_clamped" not in flags:
        flags.append("stellar_grid_clamped")
    if companion_blooms:
        flags.append("companion_saturates")
    return RankedTarget(
        rank=rank,
        name=str(targets.name[i]),
        hip=int(targets.hip[i]) if targets.hip[i] else None,
        v_mag=float(targets.v_mag[i]),
        sp_type=str(targets.sp_type[i]),
        distance_pc=float(targets.distance_pc[i]),
        ra_deg=_finite(targets.ra_deg[i]),
        dec_deg=_finite(targets.dec_deg[i]),
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
