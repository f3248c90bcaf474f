"""Results of a plan, and the story of its run."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from cpic_planner.models.base import Result, StatusText
from cpic_planner.models.ranked import RankedTarget, ReferencePlanetRecord

__all__ = ["BandConfirmation", "ConfirmedTarget", "PlanResult", "RunRecord"]


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
