"""Answers of the exposure-time calculator: one that exists and two that do not."""

from __future__ import annotations

from cpic_planner.models import EtcResult, EtcRow, ReferencePlanetRecord


def answers_about(planet: ReferencePlanetRecord) -> EtcResult:
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
        reference_planet=planet,
        best_band="F520",
        answers=rows,
    )
