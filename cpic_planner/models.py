"""Typed results that leave the program: their JSON is described by the schemas that ``cpic schema`` prints.

`PlanResult` holds what is reproducible (no clock, no path, no host); `RunRecord` holds the story of the run.
"""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

__all__ = [
    "SCHEMAS",
    "BandConfirmation",
    "ConfirmedTarget",
    "EtcResult",
    "EtcRow",
    "PlanResult",
    "PlannedSequenceRow",
    "RankResult",
    "RankedTarget",
    "RunRecord",
    "SimulatedSequence",
    "SimulationEstimate",
    "SimulationResult",
]

StatusText = Literal["ok", "unreachable", "saturated", "outside_field", "invalid"]


class Result(BaseModel):
    """Base of results: immutable, unknown keys refused, NaN and inf refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class ReferencePlanetRecord(Result):
    """The planet that ranked numbers refer to."""

    radius_rjup: float = Field(description="radius in Jupiter equatorial radii (71 492 km)")
    phase_deg: float = Field(description="star-planet-observer phase angle")
    albedo: str = Field(description="what reflects the light: a measured planet, or a model and its parameters")
    position: str = Field(default="on the diagonal of a quadrant", description="where in the dark hole")


class RankedTarget(Result):
    """One star of the ranking. Numbers refer to the stated reference planet in the best band and separation."""

    rank: int = Field(description="1 is best: highest detection_margin")
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
    reason: str = Field(description="why not, empty when ok")
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
    counts: dict[str, int] = Field(description="stars by status or reason")
    targets: list[RankedTarget]


class EtcRow(Result):
    """One answer of the exposure-time calculator; see `cpic_planner.etc.questions.EtcAnswer`."""

    target: str
    band: str
    question: Literal["exposure_time", "signal_to_noise", "contrast_limit"]
    value: float | None
    unit: str
    status: StatusText
    reason: str
    message: str
    separation_arcsec: float
    contrast: float | None
    exposure_s: float | None
    n_frames: int | None
    em_gain: float | None
    integration_s: float | None
    time_s: float | None
    snr: float | None
    significance: float | None
    threshold: float | None
    core_throughput: float | None
    budget: dict[str, float]
    flags: list[str]


class EtcResult(Result):
    """Answers of the exposure-time calculator for one target."""

    schema_version: Literal[1] = 1
    kind: Literal["etc"] = "etc"
    config_hash: str
    target: str
    hip: int | None
    v_mag: float
    distance_pc: float
    catalogue: str = Field(description="what the star table is, its vintage or file name, and its checksum")
    note: str
    reference_planet: ReferencePlanetRecord | None
    best_band: str | None
    answers: list[EtcRow]


class BandConfirmation(Result):
    """One band of one target: prediction beside the measurement in simulated images."""

    band: str
    status: StatusText
    reason: str
    message: str
    separation_arcsec: float
    pa_deg: float
    exposure_s: float | None = None
    n_frames: int | None = None
    em_gain: float | None = None
    integration_s: float | None = None
    time_s: float | None = None
    predicted_snr: float | None = None
    predicted_significance: float | None = None
    recovered_snr: float | None = None
    recovered_significance: float | None = None
    threshold: float | None = Field(default=None, description="small-sample threshold for significance")
    true_contrast: float | None = None
    recovered_contrast: float | None = None
    contrast_error: float | None = Field(default=None, description="1 sigma, from aperture-sized samples in the hole")
    rdi_throughput: float | None = None
    rdi_modes_used: int | None = None
    core_throughput: float | None = None
    n_background_apertures: int | None = None
    saturated_in_hole: int | None = Field(
        default=None, description="pixels of the hole that a limit cut off, in all frames"
    )
    saturated_outside: float | None = Field(
        default=None,
        description="pixels around the hole that a limit cut off, mean per frame; they do not reach the hole",
    )
    detected: bool | None = Field(default=None, description="recovered significance reaches the threshold")
    verdict: str = Field(default="", description="in words")
    image: str | None = Field(default=None, description="key of the stored panels")


class ConfirmedTarget(Result):
    """One target that was simulated and measured."""

    name: str
    hip: int | None
    ranked: RankedTarget
    planet_distance_au: float
    chosen_band: str | None = Field(
        description="of the bands whose images show the planet, that of highest predicted margin; null if none"
    )
    bands: list[BandConfirmation]


class PlanResult(Result):
    """The plan: reproducible from configuration and seed."""

    schema_version: Literal[1] = 1
    kind: Literal["plan"] = "plan"
    version: str
    config_hash: str
    seed: int
    fidelity: str
    instrument: str
    time_s: float
    sigma: float
    reference_library: str
    rdi_modes: int
    companions: Literal["on", "off"] = Field(default="on", description="whether the light of known companions counts")
    reference_planet: ReferencePlanetRecord
    catalogue: str
    sample: str
    n_ranked: int
    counts: dict[str, int]
    calibration: dict[str, float | int | None] = Field(
        description="mean of recovered / predicted SNR over confirmed bands, its standard error, number of bands"
    )
    not_modelled: list[str] = Field(description="effects that neither the prediction nor the images contain")
    targets: list[ConfirmedTarget]


class RunRecord(Result):
    """The story of one run: clocks, host, versions; not reproducible and kept apart from the plan."""

    schema_version: Literal[1] = 1
    kind: Literal["run"] = "run"
    command: list[str]
    config_hash: str
    started_utc: str
    finished_utc: str
    wall_s: float
    workers: int
    scheduler: str | None
    resumed_parts: int
    computed_parts: int
    host: dict[str, Any]
    versions: dict[str, str]


class PlannedSequenceRow(Result):
    """One sequence of a simulation: what it is, and its file."""

    obsid: str = Field(description="number of the observation, eleven digits")
    kind: str = Field(description="SCI, DSF, CALS, BIAS, DARK, FLAT, BKG or LASER")
    target: str = Field(description="name of the scene, or the kind where there is none")
    role: str = Field(description="science, reference or calibration; empty where there is no scene")
    camera: Literal["VIS", "NIR"]
    band: str = Field(description="empty for BIAS and DARK")
    exposure_s: float = Field(description="exposure of a frame, s")
    n_frames: int
    em_gain: float
    start_utc: str = Field(description="begin of the first exposure")
    file: str = Field(description="Level-0 file below the folder of the run")


class SimulatedSequence(PlannedSequenceRow):
    """One sequence of a simulation with what its frames hold."""

    settings: dict[str, Any] = Field(description="what decides the frames; scene and instrument by their hash")
    truth: str | None = Field(description="truth of the file; null if none was asked for")
    params: str = Field(description="folder of configuration, keyword table and logs")
    adu_min: int = Field(description="smallest pixel value of all frames")
    adu_max: int = Field(description="largest pixel value of all frames")
    saturated_pixels: int = Field(description="most pixels of one frame that a limit cut off")
    clipped_pixels: int = Field(description="most pixels of one frame that left the range of the converter")
    cosmic_rays: int = Field(description="particles that crossed the detector, all frames together")
    size_bytes: int = Field(description="Level-0 file, truth and parameters together")
    sha256: str = Field(description="of the Level-0 file")


class SimulationEstimate(Result):
    """What a simulation would make, and its expected cost."""

    schema_version: Literal[1] = 1
    kind: Literal["estimate"] = "estimate"
    name: str
    n_sequences: int
    n_frames: int
    workers: int
    wall_s: float = Field(description="wall time, with one core of about 2.5 GHz for each worker")
    memory_mb: float = Field(description="memory of a worker")
    disk_mb: float
    sequences: list[PlannedSequenceRow]


class SimulationResult(Result):
    """The products of a simulation: reproducible from configuration and seeds."""

    schema_version: Literal[1] = 1
    kind: Literal["simulation"] = "simulation"
    version: str
    config_hash: str
    name: str
    description: str
    n_frames: int
    size_bytes: int
    sequences: list[SimulatedSequence]


class FindingRecord(Result):
    """One thing that is wrong with a product."""

    path: str
    hdu: int | None = Field(description="number of the unit, 0 for the primary one; null for the file as a whole")
    keyword: str = Field(description="empty if the finding is about none")
    message: str
    severity: Literal["error", "warning"] = Field(
        description="error: against the specification; warning: unusual, or missing where that is left open"
    )


class CheckResult(Result):
    """What a check of Level-0 products found."""

    schema_version: Literal[1] = 1
    kind: Literal["check"] = "check"
    paths: list[str] = Field(description="what was checked")
    n_files: int = Field(description="Level-0 files among it")
    n_errors: int
    n_warnings: int
    findings: list[FindingRecord]


SCHEMAS: dict[str, type[Result]] = {
    "rank": RankResult,
    "etc": EtcResult,
    "plan": PlanResult,
    "run": RunRecord,
    "simulation": SimulationResult,
    "check": CheckResult,
}
