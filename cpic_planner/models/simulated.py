"""Results of simulations and of checks of their products."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from cpic_planner.models.base import Result, Row
from cpic_planner.models.columns import column
from cpic_planner.models.modelled import ModellingRecord


class PlannedSequenceRow(Row):
    """One sequence of a simulation: what it is, and its file."""

    obsid: str = column("number of the observation, eleven digits", label="OBSID")
    kind: str = Field(description="SCI, DSF, CALS, BIAS, DARK, FLAT, BKG or LASER")
    target: str = column("name of the scene, or the kind where there is none")
    role: str = Field(description="science, reference or calibration; empty where there is no scene")
    camera: Literal["VIS", "NIR"]
    band: str = Field(description="empty for BIAS and DARK")
    exposure_s: float = Field(description="exposure of a frame, s")
    n_frames: int
    em_gain: float = column(short="gain", format="g")
    start_utc: str = column("begin of the first exposure", short="begins (UTC)")
    file: str = Field(description="Level-0 file below the folder of the run")
    modelled: ModellingRecord | None = Field(
        default=None, description="what its tolerance leaves out, and the predicted error; null without a tolerance"
    )


class SimulatedSequence(PlannedSequenceRow):
    """One sequence of a simulation with what its frames hold."""

    settings: dict[str, Any] = Field(description="what decides the frames; scene and instrument by their hash")
    truth: str | None = Field(description="truth of the file; null if none was asked for")
    params: str = Field(description="folder of configuration, keyword table and logs")
    adu_min: int = Field(description="smallest pixel value of all frames")
    adu_max: int = Field(description="largest pixel value of all frames")
    saturated_pixels: int = column("most pixels of one frame that a limit cut off", short="sat. px", format="d")
    clipped_pixels: int = Field(description="most pixels of one frame that left the range of the converter")
    cosmic_rays: int = column("particles that crossed the detector, all frames together", short="cosmics", format="d")
    size_bytes: int = column("Level-0 file, truth and parameters together", label="size", format="bytes")
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


class FindingRecord(Row):
    """One thing that is wrong with a product."""

    path: str
    hdu: int | None = column("number of the unit, 0 for the primary one; null for the file as a whole", label="HDU")
    keyword: str = Field(description="empty if the finding is about none")
    message: str = column(label="finding")
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
