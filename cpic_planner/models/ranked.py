"""Results of the ranking: rows, sensitivity, and the explanation of one star."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from cpic_planner.models.base import (
    DETECTION_PROBABILITY,
    DETECTION_PROBABILITY_KNOWN_PLACE,
    LIMITED_BY,
    VERDICT_MODE,
    DetectionMode,
    LimitText,
    Result,
    StatusText,
    VerdictText,
)
from cpic_planner.registry.scores import ScoreName

__all__ = [
    "KNOWN_PLANETS",
    "BandStanding",
    "Explanation",
    "PopulationRecord",
    "RankResult",
    "RankedTarget",
    "ReferencePlanetRecord",
    "ScoreName",
    "SensitivityResult",
    "SensitivityRow",
]


KNOWN_PLANETS = "known planets"
"""Name of the population where completeness refers to the stars' own planets."""


class ReferencePlanetRecord(Result):
    """The planet that ranked numbers refer to."""

    radius_rjup: float = Field(description="radius in Jupiter equatorial radii (71 492 km)")
    phase_deg: float = Field(description="star-planet-observer phase angle")
    albedo: str = Field(description="what reflects the light: a measured planet, or a model and its parameters")
    position: str = Field(default="on the diagonal of a quadrant", description="where in the dark hole")


class PopulationRecord(Result):
    """The population that completeness refers to."""

    name: str
    description: str
    n_planets: int = Field(description="planets drawn, the same at every star")
    seed: int
    planets_per_star: float | None = Field(description="occurrence, if the population states it")


class RankedTarget(Result):
    """One star of the ranking. Numbers refer to the stated reference planet in the best band and separation."""

    rank: int = Field(description="1 is best: highest score")
    score: float = Field(
        description="what the ranking is by, see score_name; more is better; stars of equal score, such as all "
        "those of score 0, follow each other by detection_margin, then name"
    )
    name: str = Field(description="name of the star in the catalogue")
    hip: int | None = Field(description="Hipparcos number")
    v_mag: float = Field(description="Johnson V (Vega), mag")
    sp_type: str = Field(description="spectral type as catalogued")
    distance_pc: float = Field(description="distance, pc")
    ra_deg: float | None = Field(description="ICRS right ascension at the catalogue epoch, deg; null if not listed")
    dec_deg: float | None = Field(description="ICRS declination at the catalogue epoch, deg; null if not listed")
    separation_arcsec: float = Field(description="projected separation of the reference planet, arcsec")
    contrast: float = Field(description="true planet-to-star ratio of detected rates in the band")
    band: str = Field(description="best band")
    snr: float = Field(description="predicted photometric SNR of the stack; 0 where no frame is possible")
    significance: float = Field(description="predicted S / sigma without the planet")
    threshold: float = Field(description="small-sample detection threshold for significance, 5 sigma-equivalent")
    detection_margin: float = Field(description="significance / threshold")
    status: StatusText = Field(description="ok when the reference planet is detected in the given time")
    reason: str = Field(
        description="why not, empty when ok; speckle_floor: no length of visit is enough; limited_by says why"
    )
    verdict: VerdictText | None = Field(
        default=None,
        description="of the reference planet in the given time: detected with status ok, else unreachable; "
        "null in older results",
    )
    verdict_mode: DetectionMode | None = VERDICT_MODE
    detection_probability: float | None = DETECTION_PROBABILITY
    detection_probability_known_place: float | None = DETECTION_PROBABILITY_KNOWN_PLACE
    limited_by: LimitText | None = LIMITED_BY
    contrast_limit: float | None = Field(description="faintest contrast detected there by this observation")
    deepest_limit: float | None = Field(description="the same at the separation where it is faintest")
    deepest_separation_arcsec: float = Field(description="that separation, arcsec")
    detection_time_s: float | None = Field(
        description="least wall time that detects the reference planet, in any band and at any separation; null: none"
    )
    completeness: float = Field(
        description="fraction of the population that one observation detects in the best band, each planet looked for "
        "at its known place: its significance reaches the threshold there"
    )
    completeness_error: float = Field(description="its binomial standard error")
    completeness_band: str = Field(description="band of that observation")
    completeness_time_s: float | None = Field(description="its wall time, s")
    completeness_per_hour: float = Field(description="completeness over that time in hours")
    expected_detections: float | None = Field(description="completeness times planets per star of the population")
    exposure_s: float | None = Field(description="frame exposure, s")
    n_frames: int | None = Field(description="science frames; as many reference frames are taken")
    em_gain: float | None = Field(description="EM gain")
    integration_s: float | None = Field(description="time on source, s")
    time_s: float | None = Field(description="wall time with readouts, reference frames and overhead, s")
    ref_planet_distance_au: float = Field(description="true star-planet distance, au")
    ref_planet_insolation_au: float | None = Field(
        description="distance from the Sun of equal insolation, r / sqrt(L), au"
    )
    luminosity_lsun: float | None = Field(description="bolometric luminosity, solar units")
    companion_separation_arcsec: float | None = Field(description="nearest known companion, arcsec")
    flags: list[str] = Field(description="caveats, see the documentation of flags")


class RankResult(Result):
    """The analytic ranking of the whole sample."""

    schema_version: Literal[1] = 1
    kind: Literal["rank"] = "rank"
    config_hash: str
    catalogue: str = Field(description="what the star table is, its vintage or file name, and its checksum")
    sample: str = Field(description="which rows of the catalogue are returned")
    time_s: float = Field(description="wall time per target and band, s")
    sigma: float = Field(description="detection level whose false-alarm probability the thresholds keep")
    reference_library: str = Field(description="reference library of the subtraction")
    reference_planet: ReferencePlanetRecord
    population: PopulationRecord
    score_name: ScoreName = Field(description="what the ranking is by")
    counts: dict[str, int] = Field(description="stars by status or reason")
    counts_limited_by: dict[str, int] = Field(
        default_factory=dict, description="stars by limited_by; empty in older results"
    )
    targets: list[RankedTarget]


class SensitivityRow(Result):
    """The ranking under one other assumption."""

    assumption: str = Field(description="key of the assumption")
    text: str = Field(description="what is assumed instead")
    n_ok: int = Field(description="stars whose reference planet is detected")
    kendall_tau_b: float | None = Field(
        description="Kendall's tau-b of the nominal scores and those under the assumption, over the compared stars; "
        "ties count as no order; null where no order can be compared"
    )
    n_compared: int = Field(
        description="stars among the first, nominally or under the assumption, that have a score above zero in either"
    )
    kendall_tau: float | None = Field(
        description="Kendall's tau of the ranks of the nominal first stars, those without a score included, whose "
        "ranks are by margin and name; null for one star"
    )
    kept: int = Field(description="stars of the nominal top that are in the top under this assumption too")
    largest_fall: str = Field(description="star of the nominal top that loses most ranks; empty if none")
    largest_fall_ranks: int
    best: str = Field(description="first star under this assumption")


class SensitivityResult(Result):
    """How the ranking depends on what is assumed."""

    schema_version: Literal[1] = 1
    kind: Literal["sensitivity"] = "sensitivity"
    config_hash: str
    top: int = Field(description="stars of the nominal ranking that are compared")
    score_name: ScoreName
    n_ranked: int = Field(description="stars of the ranking")
    n_ok: int = Field(description="stars whose reference planet is detected, nominally")
    rows: list[SensitivityRow]
    deciding_tau: float = Field(description="an assumption with a kendall_tau_b below this decides the ranking")
    deciding_share: float = Field(
        description="so does one that changes n_ok by this share of the nominal number (of 1 if that is 0) or more"
    )
    decides: list[str] = Field(description="assumptions that decide the ranking")
    statement: str = Field(description="the same in words")


class BandStanding(Result):
    """One band of a star's explanation."""

    band: str
    status: StatusText
    reason: str
    verdict: VerdictText | None = Field(default=None, description="as of the ranked star, in this band alone")
    verdict_mode: DetectionMode | None = VERDICT_MODE
    detection_probability: float | None = DETECTION_PROBABILITY
    detection_probability_known_place: float | None = DETECTION_PROBABILITY_KNOWN_PLACE
    limited_by: LimitText | None = LIMITED_BY
    separation_arcsec: float
    contrast: float
    contrast_limit: float | None
    snr: float
    significance: float
    threshold: float
    detection_margin: float
    floor_margin: float = Field(description="margin that no length of visit can pass")
    completeness: float
    in_zone: float = Field(description="fraction of the population in the dark quadrants")
    observable: float = Field(description="fraction whose whole aperture lies there")
    time_s: float | None
    exposure_s: float | None
    n_frames: int | None
    em_gain: float | None
    exposure_limited_by: str
    gain_limited_by: str
    gain_caps: dict[str, float] = Field(description="largest EM gains by what they spare: hole, register_tail, frame")
    dominant: str = Field(description="largest term of the noise")
    budget: dict[str, float] = Field(description="terms of the variance, electrons^2")
    remedies: dict[str, float] = Field(description="factors of SNR if one thing is changed")


class Explanation(Result):
    """Why a star stands where it stands."""

    schema_version: Literal[1] = 1
    kind: Literal["explanation"] = "explanation"
    config_hash: str
    n_ranked: int
    score_name: ScoreName
    star: RankedTarget
    better: RankedTarget | None = Field(description="star one rank higher")
    worse: RankedTarget | None = Field(description="star one rank lower")
    bands: list[BandStanding]
    ranks: dict[str, int] = Field(description="rank of the star under other assumptions")
    sentences: list[str] = Field(description="the explanation in words")
