"""Measurements in simulated images: a plan of two confirmed targets in four bands, and a confirmed scene."""

from __future__ import annotations

import math

from cpic_planner.results import (
    AlbedoRecord,
    AuditRecord,
    BandConfirmation,
    CandidateRecord,
    ConfirmedTarget,
    ConfirmResult,
    EffectRecord,
    ModellingRecord,
    PlanResult,
    PositionRecord,
    RankedTarget,
    RankResult,
    SearchRecord,
)
from cpic_planner.validation import Calibration
from simulator.knobs import FIDELITIES

CALIBRATION, OPTIMISTIC = Calibration(1.03, 0.04, None, 6), Calibration(1.43, 0.06, None, 4)

BANDS = ("F520", "F662", "F720", "F850")


def _audit(predicted: float, contrast: float) -> AuditRecord:
    return AuditRecord(
        n_frames=118,
        frames_run=48,
        frames_in_all=236,
        predicted_snr=0.99 * predicted,
        recovered_snr=1.01 * predicted,
        recovered_significance=1.2 * predicted,
        contrast=1.04 * contrast,
        contrast_error=0.03 * contrast,
        deviation_sigma=1.33,
        detected=True,
        false_detections=0,
        hits=444,
        rejected_fraction=0.0158,
        saturated_in_hole=0,
        saturated_outside=259.2,
    )


def _confirmed(row: RankedTarget, shift: float) -> ConfirmedTarget:
    bands = []
    for number, (band, predicted) in enumerate(zip(BANDS, (24.0, 31.0, 12.0, 6.0), strict=True)):
        head = {
            "band": band,
            "separation_arcsec": row.separation_arcsec,
            "pa_deg": 315.0,
            "true_contrast": row.contrast,
        }
        if shift > 0 and band == "F850":
            bands.append(
                BandConfirmation(
                    status="outside_field",
                    reason="inside_inner_edge",
                    verdict="not observed",
                    message="0.330 arcsec is inside the inner edge of F850 (0.377 arcsec on the diagonal)",
                    **head,
                )
            )
            continue
        if shift < 0 and band == "F520":
            bands.append(
                BandConfirmation(
                    status="saturated",
                    reason="pixel_full_well",
                    verdict="not observed",
                    message="a frame of 0.01 s at EM gain 1 saturates; at gain 1 up to 0.004 s do not",
                    **head,
                )
            )
            continue
        recovered = predicted * (1.0 + shift) + (-1.0) ** number * 0.8
        detected = recovered * 1.1 >= 5.7
        bands.append(
            BandConfirmation(
                status="ok",
                reason="",
                message="",
                exposure_s=42.5,
                n_frames=118,
                em_gain=36.2,
                integration_s=5015.0,
                time_s=10289.6,
                realisations=8,
                drawn_as="sums",
                modelled=modelled(0.001 * number),
                predicted_snr=predicted,
                predicted_significance=1.2 * predicted,
                recovered_snr=recovered,
                recovered_snr_error=0.04 * recovered,
                etc_ratio=predicted / recovered,
                etc_ratio_error=0.06,
                recovered_significance=1.1 * recovered,
                threshold=5.7,
                recovered_contrast=row.contrast * recovered / predicted,
                contrast_error=row.contrast / recovered,
                contrast_mean_error=row.contrast / recovered / math.sqrt(8.0),
                star_flux="off_mask" if shift > 0 else "known",
                star_flux_error=2e-4 if shift > 0 else None,
                rdi_throughput=0.94,
                rdi_modes_used=10,
                core_throughput=0.21,
                n_background_apertures=60,
                saturated_in_hole=0,
                saturated_outside=None,
                n_detected=8 if detected else 2,
                n_significant=8,
                search_snr=0.9 * predicted,
                search_threshold=7.25,
                false_detections=1,
                detected=detected,
                found_separation_arcsec=row.separation_arcsec + 0.001 if detected else None,
                found_separation_error_arcsec=0.0021 if detected else None,
                found_pa_deg=314.6 if detected else None,
                found_pa_error_deg=0.35 if detected else None,
                verdict="confirmed (8 of 8); ETC agrees, 0.97 +- 0.06" if detected else "not confirmed (2 of 8)",
                audit=_audit(predicted, row.contrast) if band == "F662" else None,
                image=f"{row.name} {band}",
                **head,
            )
        )
    chosen = "F662"
    return ConfirmedTarget(
        name=row.name,
        hip=row.hip,
        ranked=row,
        planet_distance_au=row.ref_planet_distance_au,
        chosen_band=chosen,
        verdict="confirmed in F662, F720; ETC agrees, 0.97 +- 0.04",
        etc_ratio=0.97,
        etc_ratio_error=0.04,
        bands=bands,
    )


def modelled(size: float = 0.0, draw: str = "sums") -> ModellingRecord:
    """Images of a band that leave two effects out; one of them is as large as given."""
    return ModellingRecord(
        fidelity="standard",
        tolerance={"planet_flux": 0.01, "snr": 0.03},
        predicted_error={"planet_flux": 0.002, "snr": 0.004 + size},
        draw=draw,
        region="hole",
        epochs=6,
        knobs=FIDELITIES["standard"],
        effects=[
            EffectRecord(key="photon_noise", effect="photon noise", decision="kept", reason="Poisson"),
            EffectRecord(
                key="summed_frames", effect="frame by frame", decision="skipped", size=0.004, reason="sums of frames"
            ),
            EffectRecord(
                key="serial_cti", effect="serial transfer losses", decision="skipped", size=size, reason="not in sums"
            ),
            EffectRecord(key="sky", effect="sky", decision="kept", reason="uniform <b>", size=0.21),
        ],
    )


def plan_of(rank: RankResult) -> PlanResult:
    """The first two stars, the one a little brighter than predicted and the other fainter."""
    return PlanResult(
        version="0.1.0",
        config_hash="9d1c44ab01fe",
        seed=1,
        fidelity="standard",
        tolerance={"planet_flux": 0.01, "snr": 0.03, "pixel_map": 0.03},
        instrument="cpic_default",
        time_s=36000.0,
        sigma=5.0,
        reference_library="same_star_planet_free",
        rdi_modes=10,
        reference_planet=rank.reference_planet,
        catalogue=rank.catalogue,
        sample=rank.sample,
        n_ranked=len(rank.targets),
        counts=rank.counts,
        realisations=8,
        calibration=vars(CALIBRATION),
        calibration_text=CALIBRATION.text,
        not_modelled=[
            "pointing jitter: not modelled",
            "cosmic rays: not modelled; frames are kept short enough that few are lost",
        ],
        targets=[_confirmed(rank.targets[0], 0.05), _confirmed(rank.targets[1], -0.05)],
    )


def _candidate(snr: float, planet: str, detected: bool) -> CandidateRecord:
    return CandidateRecord(
        x_arcsec=0.318,
        y_arcsec=0.32,
        separation_arcsec=0.451,
        pa_deg=315.2,
        snr=snr,
        threshold=6.1,
        detected=detected,
        planet=planet,
    )


def confirmation_of(plan: PlanResult, hostile: str) -> ConfirmResult:
    """A scene with a planet of a hostile name, measured in three bands and outside in one, and a second planet."""
    first = [band.model_copy(update={"planet": hostile, "image": band.band}) for band in plan.targets[0].bands]
    second = plan.targets[0].bands[0].model_copy(update={"planet": "c", "audit": None})
    frames = {"exposure_s": 42.5, "n_frames": 118, "em_gain": 36.2, "realisations": 8, "sigma": 5.0}
    searches = [
        SearchRecord(
            band="F520",
            resolution_elements=395.2,
            false_detections=1,
            candidates=[_candidate(20.1, hostile, True), _candidate(6.3, "", True), _candidate(4.4, "", False)],
            **frames,
        ),
        SearchRecord(band="F662", resolution_elements=215.0, false_detections=0, candidates=[], **frames),
    ]
    return ConfirmResult(
        version="0.1.0",
        config_hash="77aa01fe9d1c",
        scene="a scene",
        instrument="cpic_default",
        seed=1,
        fidelity="standard",
        realisations=8,
        sigma=5.0,
        reference_library="same_star_planet_free",
        rdi_modes=1,
        simulator_overrides={"bands.*.t_opt": "x0.7", "companions": "on"},
        calibration=vars(OPTIMISTIC),
        calibration_text=OPTIMISTIC.text,
        not_modelled=["cosmic rays: switched off"],
        bands=[*first, second],
        searches=searches,
        positions=[
            PositionRecord(
                planet=hostile,
                bands=["F520", "F662"],
                separation_arcsec=0.4512,
                separation_error_arcsec=0.0011,
                pa_deg=314.7,
                pa_error_deg=0.22,
                true_separation_arcsec=0.45,
                true_pa_deg=315.0,
            )
        ],
        albedos=[
            AlbedoRecord(
                planet=hostile,
                bands=["F520", "F662"],
                status="not_constrained",
                log10_mh=0.97,
                log10_fsed=-0.4,
                mean=[0.5, -0.3],
                covariance=[[0.1, 0.01], [0.01, 0.1]],
                correlation=-0.31,
                log10_mh_interval=[0.06, 0.97],
                log10_fsed_interval=[-1.2, 0.77],
                chi2=0.4,
                degrees_of_freedom=0,
                p_value=None,
                open_edges=["log10_mh_low"],
                flags=[],
            )
        ],
    )
