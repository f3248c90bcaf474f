"""Result of measuring speed against accuracy."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from cpic_planner.models.base import Result, Row, StatusText
from cpic_planner.models.columns import column
from simulator.knobs import Quantity


class MachineRecord(Result):
    """Where it was timed."""

    key: str = Field(description="hash of the description: equal machines, equal keys")
    processor: str
    cores: int = Field(description="cores that the program may use")
    memory_gb: float
    system: str
    python: str
    numpy: str
    scipy: str
    numba: str
    blas: str
    blas_threads: int


class TradeoffScene(Result):
    """A fixed scene and the frames that it is observed in."""

    name: str
    title: str
    why: str
    band: str
    exposure_s: float
    n_frames: int = Field(description="of the science visit, and as many of the reference visit")
    em_gain: float
    scene_model: Literal["exact", "paper"]


class TradeoffRow(Row):
    """One way to an answer on one scene: time, memory, and error against the reference of that scene."""

    scene: str
    point: str
    title: str
    group: Literal["closed_form", "images", "tier", "tolerance", "knob", "effect"]
    status: StatusText = Field(description="invalid: the way does not apply to this scene, as reason and message say")
    reason: str = ""
    message: str = ""
    wall_s: float | None = column(
        "least wall clock of a warm call, for one case", short="wall s", format=".3g", default=None
    )
    cpu_s: float | None = column("processor time of that call", short="CPU s", format=".3g", default=None)
    cold_s: float | None = Field(
        default=None, description="from the start of a new process to its first answer; null where none was started"
    )
    peak_memory_mb: float | None = column(
        "peak resident set during the warm calls", short="MB", format=".0f", default=None
    )
    repeats: int = Field(default=0, description="calls that were timed")
    flux_e: float | None = Field(default=None, description="expected electrons of the planet in its aperture, visit")
    variance_e2: float | None = Field(default=None, description="of that sum, science and reference visit together")
    snr: float | None = None
    flux_error: float | None = column("relative to the reference; free of noise", short="flux", default=None)
    flux_uncertainty: float | None = None
    snr_error: float | None = column("relative to the reference", short="SNR", default=None)
    snr_uncertainty: float | None = Field(default=None, description="one standard error of that")
    predicted_error: dict[Quantity, float] = Field(default_factory=dict, description="what the effect ledger says")
    settings: dict[str, Any] = Field(default_factory=dict, description="what is modelled")
    samples: dict[str, list[float]] = Field(
        default_factory=dict,
        description="what the noise was measured from: white_e2 (one value a frame), more_white_e2, speckle_e2_s2, "
        "walk_e2_s2, one_epoch_e2_s2 (one a pair of visits), own_e2, whole_e2, fixed_speckle_e2",
    )
    n_frames: int = 0
    machine: str = Field(description="key of the machine")
    version: str


class TradeoffResult(Result):
    """Speed against accuracy on fixed scenes."""

    schema_version: Literal[1] = 1
    kind: Literal["tradeoff"] = "tradeoff"
    version: str
    quick_look: bool = Field(description="few frames: for a look, not for a record")
    machine: MachineRecord = Field(description="of the latest rows")
    other_machines: list[MachineRecord] = Field(default_factory=list, description="of rows that were kept")
    scenes: list[TradeoffScene]
    rows: list[TradeoffRow]
    speed_ups: dict[str, float] = Field(
        default_factory=dict, description="wall clock of the reference over that of one closed-form call, by scene"
    )
