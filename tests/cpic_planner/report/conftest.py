"""A synthetic but realistic plan: 20 stars, 2 confirmed targets in 4 bands, every kind of outcome, a hostile name."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from cpic_planner.models import (
    AlbedoRecord,
    AuditRecord,
    BandConfirmation,
    BandStanding,
    CandidateRecord,
    ConfirmedTarget,
    ConfirmResult,
    EffectRecord,
    EtcResult,
    EtcRow,
    Explanation,
    ModellingRecord,
    PlanResult,
    PopulationRecord,
    PositionRecord,
    RankedTarget,
    RankResult,
    ReferencePlanetRecord,
    SearchRecord,
    SensitivityResult,
    SensitivityRow,
)
from cpic_planner.models.surveyed import (
    CurvePoint,
    DifferenceRecord,
    EstimateRecord,
    RankChange,
    ScheduleRecord,
    StrategyOutcome,
    SurveyTarget,
    TimeUse,
    WhatIfResult,
)
from cpic_planner.report.drawing import Picture
from cpic_planner.report.figures import HoleEdges, LimitCurve
from cpic_planner.report.panels import Panels
from simulator.knobs import FIDELITIES

VOID_TAGS = {"meta", "img", "br", "link", "input", "hr"}
HOSTILE = "<script>alert('x')</script>"
BANDS = ("F520", "F662", "F720", "F850")
PIXEL = 0.016153
# name, HIP, V, type, distance (pc), RA, Dec (deg), companion (arcsec), flags
STARS = [
    (
        "* alf Cen B",
        71681,
        1.33,
        "K1V",
        1.2548,
        219.896,
        -60.837,
        10.0,
        ["shared_parallax", "companion_light_on", "companion_colour_assumed"],
    ),
    ("* tau Cet", 8102, 3.50, "G8V", 3.650, 26.017, -15.937, None, []),
    ("* eps Eri", 16537, 3.73, "K2V", 3.216, 53.233, -9.458, None, []),
    ("* alf Cen A", 71683, 0.01, "G2V", 1.2548, 219.902, -60.834, 10.0, ["companion_light_unknown"]),
    ("* 61 Cyg A", 104214, 5.21, "K5V", 3.494, 316.725, 38.749, 28.0, ["companion_light_unknown"]),
    ("* 61 Cyg B", 104217, 6.03, "K7V", 3.494, 316.730, 38.742, 28.0, ["companion_light_unknown"]),
    ("* eps Ind A", 108870, 4.69, "K5V", 3.622, 330.840, -56.786, None, []),
    ("* 40 Eri", 19849, 4.43, "K0V", 4.98, 63.818, -7.653, 83.0, []),
    ("*  70 Oph", 88601, 4.03, "K0V", 5.08, 271.364, 2.500, 6.0, ["companion_light_unknown"]),
    ("* del Pav", 99240, 3.56, "G8IV", 6.108, 302.182, -66.182, None, []),
    ("* eta Cas", 3821, 3.44, "G0V", 5.94, 12.276, 57.815, 13.0, ["companion_light_unknown"]),
    ("* bet Hyi", 2021, 2.79, "G0V", 7.46, 6.438, -77.254, None, []),
    ("* pi.03 Ori", 22449, 3.19, "F6V", 8.07, 72.460, 6.961, None, []),
    ("V* AK Lep", 27072, 6.14, "K2V", 8.9, 86.108, -22.422, 97.0, []),
    ("* gam Lep A", 27072, 3.59, "F6V", 8.93, 86.116, -22.448, 97.0, []),
    ("HD  10700", None, 5.9, "G5V", 12.0, 120.0, 20.0, None, []),
    ("* ups And", 7513, 4.09, "F9V", 13.49, 24.199, 41.405, None, ["stellar_grid_clamped"]),
    (HOSTILE, None, 6.5, "G0V", 15.0, 180.0, 45.0, None, ["companion_light_unknown"]),
    ("* iot Per", 14632, 4.05, "G0V", 10.54, 47.267, 49.613, None, []),
    ("* chi01 Ori", 27913, 4.41, "G0V", 8.66, 88.596, 20.276, None, []),
]


def _planet() -> ReferencePlanetRecord:
    return ReferencePlanetRecord(radius_rjup=1.0, phase_deg=90.0, albedo="jupiter")


def _ranked(index: int) -> RankedTarget:
    name, hip, v_mag, sp_type, distance, ra, dec, companion, flags = STARS[index]
    separation = 0.33 + 0.02 * (index % 7)
    contrast = 6e-8 / (separation * distance) ** 2 * 0.6
    margin = 14.0 / (index + 1) ** 1.3
    status, reason = (
        ("ok", "") if margin >= 1 else ("unreachable", "insufficient_time" if index % 2 else "speckle_floor")
    )
    possible = True
    if index == len(STARS) - 1:
        status, reason, margin, possible = "saturated", "pixel_full_well", 0.0, False
    exposure, frames = 30.0 + 5 * index, 120 + index
    share = max(0.08 - 0.012 * index, 0.0)
    return RankedTarget(
        rank=index + 1,
        score=share / 10.0,
        name=name,
        hip=hip,
        v_mag=v_mag,
        sp_type=sp_type,
        distance_pc=distance,
        ra_deg=ra,
        dec_deg=dec,
        separation_arcsec=separation,
        contrast=contrast,
        band="F662" if index % 3 else "F520",
        snr=5.1 * margin,
        significance=5.6 * margin,
        threshold=5.6,
        detection_margin=margin,
        status=status,
        reason=reason,
        contrast_limit=contrast / margin if margin > 0 else None,
        deepest_limit=0.8 * contrast / margin if margin > 0 else None,
        deepest_separation_arcsec=0.7,
        detection_time_s=3600.0 / margin if margin > 0.8 else None,
        completeness=share,
        completeness_error=(share * (1 - share) / 4000) ** 0.5,
        completeness_band="F520",
        completeness_time_s=36000.0 if possible else None,
        completeness_per_hour=share / 10.0,
        expected_detections=0.21 * share,
        exposure_s=exposure if possible else None,
        n_frames=frames if possible else None,
        em_gain=35.0 if possible else None,
        integration_s=exposure * frames if possible else None,
        time_s=35990.0 if possible else None,
        ref_planet_distance_au=separation * distance,
        ref_planet_insolation_au=separation * distance / 0.7 if index != 4 else None,
        luminosity_lsun=0.49 if index != 4 else None,
        companion_separation_arcsec=companion,
        flags=flags,
    )


@pytest.fixture(scope="session")
def rank() -> RankResult:
    rows = [_ranked(i) for i in range(len(STARS))]
    keys = ["ok" if row.status == "ok" else row.reason for row in rows]
    return RankResult(
        config_hash="0f3a9c1d22b7",
        catalogue="FGK stars within 40 pc from SIMBAD (2014 extract) and Hipparcos-2",
        time_s=36000.0,
        sample="every FGK star of the snapshot with parallax >= 25 mas and V <= 7; all luminosity classes; stars "
        "with companions "
        "flagged, not dropped",
        sigma=5.0,
        reference_library="same_star_planet_free",
        reference_planet=_planet(),
        population=PopulationRecord(
            name="giants", description="Giant planets", n_planets=4000, seed=1, planets_per_star=0.21
        ),
        score_name="completeness_per_hour",
        counts={key: keys.count(key) for key in sorted(set(keys))},
        targets=rows,
    )


def _audit(predicted: float, contrast: float) -> AuditRecord:
    return AuditRecord(
        n_frames=118,
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
            EffectRecord(key="summed_frames", effect="frame by frame", decision="skipped", size=0.004,
                         reason="sums of frames"),
            EffectRecord(key="serial_cti", effect="serial transfer losses", decision="skipped", size=size,
                         reason="not in sums"),
            EffectRecord(key="sky", effect="sky", decision="kept", reason="uniform <b>", size=0.21),
        ],
    )  # fmt: skip


@pytest.fixture(scope="session")
def make_modelled() -> Callable[..., ModellingRecord]:
    return modelled


@pytest.fixture(scope="session")
def plan(rank: RankResult) -> PlanResult:
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
        reference_planet=_planet(),
        catalogue=rank.catalogue,
        sample=rank.sample,
        n_ranked=len(rank.targets),
        counts=rank.counts,
        realisations=8,
        calibration={"ratio": 0.97, "error": 0.04, "n_bands": 6},
        calibration_text="the ETC agrees with the images: predicted / recovered SNR 1.03 +- 0.04 over 6 measurements",
        not_modelled=[
            "pointing jitter: not modelled",
            "cosmic rays: not modelled; frames are kept short enough that few are lost",
        ],
        targets=[_confirmed(rank.targets[0], 0.05), _confirmed(rank.targets[1], -0.05)],
    )


def make_panels(band: str = "F662", *, seed: int = 1, size: int = 137) -> Panels:
    """Speckle halo, cross mask, noise, and a planet at PA 315 deg (north-west: +x, +y at parity -1)."""
    draw = np.random.default_rng(seed)
    offset = (np.arange(size) - size // 2) * PIXEL
    x, y = offset[None, :], offset[:, None]
    rho = np.hypot(x, y)
    inner, outer = 0.165 + 0.03 * BANDS.index(band) / 2, 0.707
    inside = (np.abs(x) >= inner) & (np.abs(x) <= outer) & (np.abs(y) >= inner) & (np.abs(y) <= outer)
    speckles = np.abs(draw.normal(size=(size, size)) + 1j * draw.normal(size=(size, size))) ** 2
    halo = (
        400.0
        + 4000.0 * np.exp(-rho / 0.15) * speckles / 2
        + np.where(inside, 0.0, 2e4 / (1 + (rho / 0.3) ** 3) * (np.abs(x) > 0.155) * (np.abs(y) > 0.155))
    )
    px = py = 0.5 / math.sqrt(2.0)
    planet = 300.0 * np.exp(-((x - px) ** 2 + (y - py) ** 2) / (2 * 0.022**2))
    science = draw.normal(halo + planet, 1.4 * np.sqrt(halo))
    reference = draw.normal(halo, 1.4 * np.sqrt(halo))
    return Panels(
        band=band,
        science=science,
        reference=reference,
        residual=np.where(inside, science - reference, np.nan),
        pixel_scale_arcsec=PIXEL,
        planet_x_arcsec=px,
        planet_y_arcsec=py,
        aperture_radius_arcsec=0.0375,
        hole_inner_arcsec=inner,
        hole_outer_arcsec=outer,
        mask_half_width_arcsec=0.155,
    )


@pytest.fixture(scope="session")
def panels(plan: PlanResult) -> dict[str, Panels]:
    keys = [(band.image, band.band) for target in plan.targets for band in target.bands if band.image]
    return {key: make_panels(band, seed=i) for i, (key, band) in enumerate(keys)}


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


@pytest.fixture(scope="session")
def confirmation(plan: PlanResult) -> ConfirmResult:
    """A scene with a planet of a hostile name, measured in three bands and outside in one, and a second planet."""
    first = [band.model_copy(update={"planet": HOSTILE, "image": band.band}) for band in plan.targets[0].bands]
    second = plan.targets[0].bands[0].model_copy(update={"planet": "c", "audit": None})
    frames = {"exposure_s": 42.5, "n_frames": 118, "em_gain": 36.2, "realisations": 8, "sigma": 5.0}
    searches = [
        SearchRecord(
            band="F520",
            resolution_elements=395.2,
            false_detections=1,
            candidates=[_candidate(20.1, HOSTILE, True), _candidate(6.3, "", True), _candidate(4.4, "", False)],
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
        calibration={"ratio": 0.7, "error": 0.03, "n_bands": 4},
        calibration_text="the ETC is optimistic by 1.43 +- 0.06 (predicted / recovered SNR) over 4 measurements",
        not_modelled=["cosmic rays: switched off"],
        bands=[*first, second],
        searches=searches,
        positions=[
            PositionRecord(
                planet=HOSTILE,
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
                planet=HOSTILE,
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


@pytest.fixture(scope="session")
def limits() -> list[LimitCurve]:
    separation = np.linspace(0.24, 0.95, 40)
    curve = 8e-10 * (1 + (0.3 / separation) ** 4)
    return [LimitCurve("α Cen B, F662", separation, curve), LimitCurve("τ Cet, F520", separation, 3 * curve)]


@pytest.fixture(scope="session")
def holes() -> list[HoleEdges]:
    return [
        HoleEdges("F520", 0.231, 1.0),
        HoleEdges("F662", 0.294, 1.0),
        HoleEdges("F720", 0.319, 1.0),
        HoleEdges("F850", 0.377, 1.0),
    ]


@pytest.fixture(scope="session")
def sensitivity(rank: RankResult) -> SensitivityResult:
    names = [row.name for row in rank.targets]
    rows = [
        SensitivityRow(
            assumption="drift_x2",
            text="wavefront drift twice as large",
            kendall_tau=0.42,
            kept=14,
            n_ok=3,
            largest_fall=names[3],
            largest_fall_ranks=6,
            best=names[1],
        ),
        SensitivityRow(
            assumption="t_opt_0.46",
            text="optical throughput 0.46",
            kendall_tau=0.91,
            kept=19,
            n_ok=9,
            largest_fall=HOSTILE,
            largest_fall_ranks=2,
            best=names[0],
        ),
        SensitivityRow(
            assumption="same",
            text="the same again",
            kendall_tau=None,
            kept=20,
            n_ok=7,
            largest_fall="",
            largest_fall_ranks=0,
            best=names[0],
        ),
    ]
    return SensitivityResult(
        config_hash="abc",
        top=20,
        score_name="completeness_per_hour",
        n_ok=7,
        rows=rows,
        decides=["drift_x2"],
        statement="Wavefront drift decides the order of the first 20.",
    )


@pytest.fixture(scope="session")
def explanation(rank: RankResult) -> Explanation:
    better, star, worse = rank.targets[:3]
    common = {
        "separation_arcsec": 0.5,
        "contrast": 1e-8,
        "threshold": 6.2,
        "floor_margin": 2.0,
        "in_zone": 0.3,
        "observable": 0.2,
    }
    bands = [
        BandStanding(
            band=star.band,
            status="ok",
            reason="",
            contrast_limit=7e-9,
            snr=8.0,
            significance=9.0,
            detection_margin=1.45,
            completeness=0.06,
            time_s=7200.0,
            exposure_s=20.0,
            n_frames=150,
            em_gain=390.0,
            exposure_limited_by="",
            gain_limited_by="adc_range",
            gain_caps={"hole": 1000.0, "register_tail": 390.0, "frame": 0.0},
            dominant="speckle",
            budget={"speckle": 10.0, "planet": 3.0},
            remedies={"half_the_drift": 1.31, "half_the_clock_charge": 1.0},
            **common,
        ),
        BandStanding(
            band="F850",
            status="saturated",
            reason="pixel_full_well",
            contrast_limit=None,
            snr=0.0,
            significance=0.0,
            detection_margin=0.0,
            completeness=0.0,
            time_s=None,
            exposure_s=None,
            n_frames=None,
            em_gain=None,
            exposure_limited_by="",
            gain_limited_by="",
            gain_caps={},
            dominant="",
            budget={},
            remedies={},
            **common,
        ),
    ]
    return Explanation(
        config_hash="abc",
        n_ranked=20,
        score_name="completeness_per_hour",
        star=star,
        better=better,
        worse=worse,
        bands=bands,
        ranks={"drift_x2": 4},
        sentences=["Two sentences. [bold]Brackets[/bold] stay."],
    )


@pytest.fixture(scope="session")
def etc_answers() -> EtcResult:
    common = {"target": "* tau Cet", "question": "exposure_time", "unit": "s", "flags": ["companion_light_unknown"]}
    none = {
        "value": None,
        "exposure_s": None,
        "n_frames": None,
        "em_gain": None,
        "integration_s": None,
        "time_s": None,
        "snr": None,
        "significance": None,
        "threshold": None,
        "core_throughput": None,
        "snr_paper": None,
        "level": 10.0,
        "exposure_limited_by": "",
        "gain_limited_by": "",
        "gain_caps": {},
        "dominant": "",
        "remedies": {},
        "budget": {},
    }
    rows = [
        EtcRow(
            band="F520",
            value=5120.3,
            status="ok",
            reason="",
            message="",
            separation_arcsec=0.41,
            contrast=3.2e-8,
            exposure_s=40.0,
            n_frames=61,
            em_gain=30.0,
            integration_s=2440.0,
            time_s=5120.3,
            snr=10.0,
            significance=11.2,
            threshold=5.6,
            core_throughput=0.2,
            snr_paper=10.4,
            level=10.0,
            exposure_limited_by="exposure_max",
            gain_limited_by="register_full_well",
            gain_caps={"hole": 1000.0, "register_tail": 30.0, "frame": 0.0},
            dominant="speckle",
            remedies={"half_the_drift": 1.31, "twice_the_time": 0.98, "half_the_read_noise": 1.001},
            budget={"signal_e": 812.0, "speckle_e2": 4900.0, "planet_e2": 1600.0, "dark_e2": 93.0, "sky_e2": 0.1},
            **common,
        ),
        EtcRow(
            band="F662",
            status="unreachable",
            reason="speckle_floor",
            separation_arcsec=0.41,
            contrast=2.2e-8,
            message="the speckle residual limits the SNR to 7.1, whatever the time",
            **(common | none),
        ),
        EtcRow(
            band="F850",
            status="outside_field",
            reason="inside_inner_edge",
            separation_arcsec=0.31,
            contrast=None,
            message="0.310 arcsec is inside the inner edge of F850 (0.377 arcsec on the diagonal)",
            **(common | none),
        ),
    ]
    return EtcResult(
        config_hash="abc",
        target="* tau Cet",
        hip=8102,
        v_mag=3.5,
        distance_pc=3.65,
        catalogue="SIMBAD extract of 2012-12-06 (stars.csv 0123456789ab)",
        note="",
        reference_planet=_planet(),
        best_band="F520",
        answers=rows,
    )


class Reader(HTMLParser):
    """Collects attributes and visible text, and checks that tags are balanced."""

    def __init__(self):
        super().__init__()
        self.tags, self.open, self.text = [], [], []

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        if tag not in VOID_TAGS:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" not in self.open:
            self.text.append(data)


@pytest.fixture(scope="session")
def read() -> Callable[[str], Reader]:
    """Tags and visible text of a page whose tags are balanced."""

    def reader_of(page: str) -> Reader:
        reader = Reader()
        reader.feed(page)
        reader.close()
        assert reader.open == []
        return reader

    return reader_of


def _estimate(mean: float) -> EstimateRecord:
    return EstimateRecord(mean=mean, error=0.03, low=0.9 * mean, high=1.1 * mean + 0.01, survey_low=0.0,
                          survey_high=2.0 * mean)  # fmt: skip


def _target(rank: int, name: str, ra_deg: float, slots: list[int], planets: float, hosts: list[str]) -> SurveyTarget:
    return SurveyTarget(
        name=name, rank=rank, v_mag=3.7 + 0.1 * rank, distance_pc=3.2, ra_deg=ra_deg, dec_deg=-9.5, known_planets=hosts,
        bands=["F520", "F662"], visit_time_s=7200.0, visit_h=6.25, planned_visits=len(slots), slots=slots,
        first_utc="2028-03-01" if slots else "", visits=0.9 * len(slots), search_h=5.6 * len(slots), follow_up_h=1.5,
        new_planets=planets, known_seen=0.5 * len(hosts), planets_per_100h=10.0 * planets,
    )  # fmt: skip


def _strategy(i: int, name: str, settings: dict[str, Any], n: int, empty: bool) -> StrategyOutcome:
    mean = 0.0 if empty else 0.512 + 0.3 * i
    budget, hours = settings["time_budget_h"], 0.0 if empty else 100.0 + 50.0 * min(i, 10)
    stars = [("* eps Eri", 53.2, ["eps Eri b"]), (HOSTILE, 26.0, []), ("5 $ star $", 330.0, [])]
    points = [CurvePoint(x=x, mean=mean * min(x / 100.0, 1.0), low=0.0, high=mean) for x in (0.0, 50.0, 100.0, budget)]
    return StrategyOutcome(
        name=name,
        description=f"Way {i} of {HOSTILE}",
        settings=settings | {"name": name},
        schedule=ScheduleRecord(method="greedy", visits=3 + i, reserve_visits=i, hours=hours, value=0.9, bound=1.0,
                                distance=0.1),
        planets=_estimate(mean),
        new_planets=_estimate(0.3 * mean),
        known_planets=_estimate(0.7 * mean),
        stars_with_planet=_estimate(mean),
        characterised_planets=_estimate(0.0),
        noise_alarms=_estimate(0.004),
        background_alarms=_estimate(0.0),
        hours=_estimate(hours),
        any_planet=0.4 if mean else 0.0,
        any_new_planet=0.2 if mean else 0.0,
        time_use=TimeUse(exposing_h=0.5 * hours, occulted_h=0.3 * hours, settling_h=0.2 * hours, follow_up_h=0.0,
                         unused_h=budget - hours),
        curve=points,
        convergence=[CurvePoint(x=float(k), mean=mean, low=0.8 * mean, high=1.2 * mean) for k in (10, 50, n)],
        quantiles={} if empty else {key: [scale * q for q in (1.0, 2.0, 3.0, 4.0, 9.0)] for key, scale in (
            ("snr", 3.0), ("contrast", 2e-9), ("separation_arcsec", 0.1), ("margin", 0.8), ("day", 300.0))},
        targets=[] if empty else [_target(k + 1, star, ra, list(range(k, 12, 4 + i)), 0.1 / (k + 1), hosts)
                                  for k, (star, ra, hosts) in enumerate(stars)],
    )  # fmt: skip


@pytest.fixture(scope="session")
def compared() -> Callable[..., WhatIfResult]:
    """Comparisons of strategies with the given names; ``empty`` ones find and visit nothing."""
    from cpic_planner.survey.strategy_file import load_strategies

    bands = {"bands": ["F520", "F662", "F720", "F850"]}
    config = load_strategies({"universe": {"seed": 1, "start_utc": "2028-01-01"}, "strategies": [
        {"name": "a", "time_budget_h": 1752, "visit": bands | {"time_s": 36000}, "revisits": {"max_visits": 1}},
        {"name": "b", "time_budget_h": 1752, "visit": {"bands": ["F520"]}, "revisits": {"max_visits": 4}},
    ]})  # fmt: skip
    trees = [item.model_dump(mode="json") for item in config.strategies]

    def make(names: Sequence[str] = ("single", "deep & long", "wide"), *, empty: bool = False) -> WhatIfResult:
        strategies = [_strategy(i, name, trees[i % len(trees)], 200, empty) for i, name in enumerate(names)]
        changes = [RankChange(strategy=name, star=HOSTILE, first_rank=2, rank=None if i else 1, why="2 visits, not 1")
                   for i, name in enumerate(names[1:])]  # fmt: skip
        return WhatIfResult(
            version="0.1.0",
            config_hash="0123456789abcdef",
            name="a survey",
            description="What if",
            universe=config.universe.model_dump(mode="json") | {"duration_days": 360.0, "slot_days": 30.0},
            catalogue="SIMBAD extract of 2012-12-06 (stars.csv 0123456789ab)",
            known_planets="NASA Exoplanet Archive of 2019-05-31, 176 planets (known_planets.csv 0123456789ab)",
            observed="",
            n_universes=200,
            slot_utc=[str(np.datetime64("2028-01-01") + 30 * k) for k in range(12)],
            strategies=strategies,
            differences=[_difference(one, strategies[0], key) for one in strategies[1:]
                         for key in ("planets", "new_planets", "characterised_planets", "hours")],
            rank_changes=[] if empty else changes,
            statement=f"{names[-1]} finds most planets",
            not_modelled=["weather of space"],
        )  # fmt: skip

    return make


def _difference(one: StrategyOutcome, other: StrategyOutcome, quantity: Any) -> DifferenceRecord:
    mean = getattr(one, quantity).mean - getattr(other, quantity).mean
    return DifferenceRecord(first=one.name, second=other.name, quantity=quantity, mean=mean, error=0.05,
                            low=mean - 0.11, high=mean + 0.12, correlation=0.62, verdict="more")  # fmt: skip


@pytest.fixture
def drawn(monkeypatch) -> Callable[..., tuple[Figure, Picture]]:
    """Run a function that draws; returns the matplotlib figure and its picture."""

    def draw(function, *arguments):
        module, kept = sys.modules[function.__module__], []
        save = module.save

        def keep(figure, *args, **options):
            kept.append(figure)
            return save(figure, *args, **options)

        with monkeypatch.context() as patch:
            patch.setattr(module, "save", keep)
            picture = function(*arguments)
        return kept[0], picture

    return draw
