"""A ranking of 20 stars with every kind of outcome, what it is sensitive to, and why one star stands where it does."""

from __future__ import annotations

from collections import Counter

from cpic_planner.results import (
    BandStanding,
    Explanation,
    PopulationRecord,
    RankedTarget,
    RankResult,
    ReferencePlanetRecord,
    SensitivityResult,
    SensitivityRow,
    SensitivityStar,
)

_BESIDE_A_STAR = ["shared_parallax", "companion_light_on", "companion_colour_assumed"]
# name, HIP, V, type, distance (pc), RA, Dec (deg), companion (arcsec), flags; the one without a name is the hostile one
STARS = [
    ("* alf Cen B", 71681, 1.33, "K1V", 1.2548, 219.896, -60.837, 10.0, _BESIDE_A_STAR),
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
    (None, None, 6.5, "G0V", 15.0, 180.0, 45.0, None, ["companion_light_unknown"]),
    ("* iot Per", 14632, 4.05, "G0V", 10.54, 47.267, 49.613, None, []),
    ("* chi01 Ori", 27913, 4.41, "G0V", 8.66, 88.596, 20.276, None, []),
]


def _ranked(index: int, hostile: str) -> RankedTarget:
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
        name=name or hostile,
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
        verdict="detected" if status == "ok" else "unreachable",
        verdict_mode="known_place",
        detection_probability=min(0.3 * margin, 1.0),
        detection_probability_known_place=min(0.58 * margin, 1.0),
        limited_by=_limited_by(status, reason, index),
        contrast_limit=contrast / margin if margin > 0 else None,
        deepest_limit=0.8 * contrast / margin if margin > 0 else None,
        deepest_separation_arcsec=0.7,
        detection_time_s=3600.0 / margin if margin > 0.8 else None,
        completeness=share,
        completeness_error=(share * (1 - share) / 4000) ** 0.5,
        completeness_band="F520",
        completeness_time_s=36000.0 if possible else None,
        completeness_per_hour=share / 10.0,
        completeness_unconditional=1.2 * share,
        expected_planets=0.21 * share,
        expected_planets_unconditional=0.21 * 1.2 * share,
        rv_amplitude_m_s=3.0 + index,
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


def _limited_by(status: str, reason: str, index: int) -> str:
    if status != "unreachable":
        return "none" if status == "ok" else "saturation"
    return "photons" if reason == "speckle_floor" and index % 4 == 0 else "speckles"


def ranking(hostile: str) -> RankResult:
    """One of the stars has this name."""
    rows = [_ranked(i, hostile) for i in range(len(STARS))]
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
        reference_planet=ReferencePlanetRecord(radius_rjup=1.0, phase_deg=90.0, albedo="jupiter"),
        population=PopulationRecord(
            name="giants",
            description="Giant planets",
            n_planets=4000,
            seed=1,
            planets_per_star=0.21,
            planets_per_star_range=(0.14, 0.26),
            exclusions=["rv", "stability", "known_giants"],
        ),
        score_name="completeness_per_hour",
        counts={key: keys.count(key) for key in sorted(set(keys))},
        counts_limited_by=dict(Counter(row.limited_by for row in rows)),
        targets=rows,
    )


def sensitivity_of(rank: RankResult, hostile: str) -> SensitivityResult:
    """The ranking under three other assumptions."""
    names = [row.name for row in rank.targets]
    # assumption, text, planets found and stars compared with their correlations, kept, largest fall, best
    told = [
        ("drift_x2", "wavefront drift twice as large", (3, 0.42, 11, 0.9), (14, 7), (names[3], 6), names[1]),
        ("t_opt_0.46", "optical throughput 0.46", (9, 0.91, 13, 0.95), (19, 9), (hostile, 2), names[0]),
        ("same", "the same again", (7, None, 0, None), (20, 10), ("", 0), names[0]),
    ]
    rows = [
        SensitivityRow(
            assumption=key,
            text=text,
            **dict(zip(("n_ok", "kendall_tau_b", "n_compared", "kendall_tau"), ranks, strict=True)),
            kept=kept[0],
            kept_first=kept[1],
            largest_fall=fall[0],
            largest_fall_ranks=fall[1],
            best=best,
        )
        for key, text, ranks, kept, fall, best in told
    ]
    return SensitivityResult(
        config_hash="abc",
        top=20,
        score_name="completeness_per_hour",
        n_ranked=1077,
        n_ok=7,
        rows=rows,
        first=10,
        stars=[
            SensitivityStar(name=row.name, rank=row.rank, rank_lowest=max(row.rank - 1, 1), rank_highest=row.rank + 6)
            for row in rank.targets
        ],
        statement="Of the first 10 stars, 7 (wavefront drift twice as large) to 10 stay among the first 10.",
    )


def explanation_of(rank: RankResult) -> Explanation:
    """Of the second star: one band that detects its planet and one that saturates."""
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
            verdict="detected",
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
            **dict.fromkeys(("snr", "significance", "detection_margin", "completeness"), 0.0),
            **dict.fromkeys(("contrast_limit", "time_s", "exposure_s", "n_frames", "em_gain")),
            **dict.fromkeys(("exposure_limited_by", "gain_limited_by", "dominant"), ""),
            **{key: {} for key in ("gain_caps", "budget", "remedies")},
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
