"""Results of simulations and of checks of their products, and the story of a run.

Result of measuring speed against accuracy.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

from cpic_planner.results.answers import ModellingRecord
from cpic_planner.results.base import (
    Document,
    OfTables,
    Result,
    Row,
    RunResult,
    StatusText,
    column,
    column as told,  # a row here has a field of that name
    optional,
)
from simulator.knobs import Quantity

if TYPE_CHECKING:
    from catalogs import TableReading


class SequenceRow(Row):
    """Base of rows of sequences of frames."""

    obsid: str = column("number of the observation, eleven digits", label="OBSID")
    band: str = column("empty for BIAS and DARK")
    exposure_s: float = column("exposure of a frame, s")
    n_frames: int
    em_gain: float = column(format="g")
    start_utc: str = column("begin of the first exposure", short="begins (UTC)")


class PlannedSequenceRow(SequenceRow):
    """One sequence of a simulation: what it is, and its file."""

    kind: str = column("SCI, DSF, CALS, BIAS, DARK, FLAT, BKG or LASER")
    target: str = column("name of the scene, or the kind where there is none")
    role: str = column("science, reference or calibration; empty where there is no scene")
    camera: Literal["VIS", "NIR"]
    file: str = column("Level-0 file below the folder of the run")
    visit: int | None = optional("number of the visit of its role, from 1; null outside of a programme")
    window: int | None = optional("number of the window of the orbit in the visit, from 1; null outside of a programme")
    modelled: ModellingRecord | None = optional(
        "what its tolerance leaves out, and the predicted error; null without a tolerance"
    )


class ProgrammeRow(SequenceRow):
    """Base of rows of the files of a programme, with the calibrations that each is reduced with."""

    file: str = column("Level-0 file, below the folder of the list of visits")
    begin_mjd: float = column("begin of the first exposure, MJD (UTC)")
    end_mjd: float = column("end of the last exposure, MJD (UTC)")
    roll_deg: float | None = column("position angle of the +y axis; null without a scene", format="g")
    star_x_pixel: float | None = optional("column of the star, from 0; null without a scene")
    star_y_pixel: float | None = optional("row of the star, from 0; null without a scene")
    bias: str | None = optional("file of bias frames of its gain; null where it needs none or has none")
    dark: str | None = optional("file of dark frames of its gain and of the exposure nearest to its own; null as bias")
    flat: str | None = optional("file of flat frames of its band; null as bias")
    star: str | None = optional("file of the star off the mask, in its band and gain; null as bias")


class CalibrationRow(ProgrammeRow):
    """One sequence of calibrations, or of the star off the mask, of a programme."""

    kind: Literal["CALS", "BIAS", "DARK", "FLAT"] = column("CALS for the star off the mask")


class VisitRow(ProgrammeRow):
    """One sequence of a programme: the frames of a visit in one window of the orbit."""

    visit: int = column("number of the visit among those of its role, from 1")
    n_visits: int = column("visits of its role")
    role: Literal["science", "reference"]
    window: int = column("number of the window of the orbit in the visit, from 1")
    folder: str = column("tree of products of the visit, beside the list of visits")
    first_frame: int = column("number of its first frame in the visit, from 0")
    seed: int
    streams: list[str | int] = column("names of the random streams of the visit, below the seed")


class SimulatedProgramme(RunResult):
    """Visits of one star that are to be reduced together, as the file ``programme.json`` lists them."""

    kind: Literal["programme"] = "programme"
    file: str = column("this list below the folder of the run")
    target: str = column("name of the scene of the science visits")
    reference: str | None = column("name of the scene of the reference visits; null without any")
    visits: int = column("science visits")
    reference_visits: int
    reference_scheme: Literal["interleaved", "half", "swapped", "other_star"] = column(
        "where in the orbit references are taken"
    )
    visit_gap_h: float = column("least time between a visit with its references and the next")
    orbit_s: float = column("period of the orbit, whose windows the visits begin with")
    span_days: float = column("from the begin of the first exposure to the end of the last")
    sequences: list[VisitRow] = column("in the order of time")
    calibrations: list[CalibrationRow] = column("of the run, in the order of time", default=[])


class SimulatedSequence(PlannedSequenceRow):
    """One sequence of a simulation with what its frames hold."""

    settings: dict[str, Any] = column("what decides the frames; scene and instrument by their hash")
    truth: str | None = column("truth of the file; null if none was asked for")
    params: str = column("folder of configuration, keyword table and logs")
    adu_min: int = column("smallest pixel value of all frames")
    adu_max: int = column("largest pixel value of all frames")
    saturated_pixels: int = column("most pixels of one frame that a limit cut off", short="sat. px", format="d")
    clipped_pixels: int = column("most pixels of one frame that left the range of the converter")
    cosmic_rays: int = column("particles that crossed the detector, all frames together", short="cosmics", format="d")
    size_bytes: int = column("Level-0 file, truth and parameters together", label="size", format="bytes")
    sha256: str = column("of the Level-0 file")


class SimulationEstimate(Document):
    """The products of a simulation and their expected cost."""

    kind: Literal["estimate"] = "estimate"
    name: str
    n_sequences: int
    n_frames: int
    workers: int
    cpu_s: float | None = optional("processor time on this machine; null in older results")
    wall_s: float = column("wall time on this machine, where it does nothing else")
    memory_mb: float = column("memory of a worker")
    disk_mb: float
    sequences: list[PlannedSequenceRow]


class SimulationResult(OfTables, RunResult):
    """The products of a simulation: reproducible from configuration and seeds."""

    kind: Literal["simulation"] = "simulation"
    version: str
    name: str
    description: str
    n_frames: int
    size_bytes: int
    sequences: list[SimulatedSequence]
    programmes: list[SimulatedProgramme] = column("visits of each programme", default=[])


class MasterRow(Row):
    """One master calibration that was made of frames."""

    kind: str = column("BIAS, DARK or FLAT")
    file: str = column("below the folder of the run")
    n_frames: int
    exposure_s: float = column("exposure of a frame, s")
    em_gain: float = column(format="g")
    made_of: list[str] = column("Level-0 files")
    made_with: list[str] = column("other masters that it was made with")


class ReducedSequence(Row):
    """One reduced sequence: what was applied, and what its masks say."""

    file: str = column("Level-1 file below the folder of the run")
    error_file: str = column("errors of its frames")
    level0: str = column("Level-0 file", label="Level 0")
    kind: str = column("SCI, DSF, CALS, DARK, FLAT, BKG or LASER")
    target: str = column("name of the target, as the header says")
    band: str = column("empty where the header names none")
    exposure_s: float = column("exposure of a frame, s")
    n_frames: int
    em_gain: float = column(format="g")
    median_e: float = column("median of the light of good pixels of a frame", label="median")
    error_e: float = column("median error of a pixel of a frame", label="error")
    steps: dict[str, str] = column("what each step was made with, in the order of the reduction")
    assumed: list[str] = column("what the header does not say, and was taken for it")
    mask_counts: dict[str, int] = column("pixels of all frames with each bit of the mask; good ones have none")


class ReductionResult(RunResult):
    """Level-1 files of a reduction, and how they were made."""

    main_rows: ClassVar[str] = "sequences"
    kind: Literal["reduction"] = "reduction"
    version: str
    config_hash: str
    n_frames: int
    masters: list[MasterRow] = column("masters made of frames; maps are named in the steps of each sequence")
    sequences: list[ReducedSequence]
    left_out: list[str] = column("files of a folder that were not reduced, and why")


class FindingRecord(Row):
    """One thing that is wrong with a product."""

    path: str
    hdu: int | None = column("number of the unit, 0 for the primary one; null for the file as a whole", label="HDU")
    keyword: str = column("empty if the finding is about none")
    message: str = column(label="finding")
    severity: Literal["error", "warning"] = column(
        "error: against the specification; warning: unusual, or missing where that is left open"
    )


class CheckResult(Document):
    """The findings of a check of Level-0 products."""

    kind: Literal["check"] = "check"
    paths: list[str] = column("what was checked")
    n_files: int = column("Level-0 files among it")
    n_errors: int
    n_warnings: int
    findings: list[FindingRecord]


class MachineRecord(Result):
    """The machine on which something was timed."""

    key: str = column("hash of the description: equal machines, equal keys")
    processor: str
    cores: int = column("cores that the program may use")
    memory_gb: float
    system: str
    python: str
    numpy: str
    scipy: str
    numba: str
    blas: str
    blas_threads: int


class SceneFrames(Result):
    """Base of fixed scenes: what a scene is, and the frames that it is observed in."""

    name: str
    title: str
    why: str = column("why it is in the list")
    band: str
    exposure_s: float
    n_frames: int = column("of the science visit, and as many of the reference visit")
    em_gain: float
    scene_model: Literal["exact", "paper"] = column("how the scene is asked to be made", default="exact")


class TradeoffScene(SceneFrames):
    """A fixed scene and the frames that it is observed in, with its visits and their reduction."""

    visits: int = column("science visits that are reduced as one", default=1)
    reference_visits: int = 1
    n_modes: int = column("modes of the references that are projected out", default=0)
    library: str = column("where the references come from", default="same_star_planet_free")
    is_programme: bool = column("whether visits are drawn many times and reduced as one", default=False)


class TradeoffRow(Row):
    """One way to an answer on one scene: time, memory, and error against the reference of that scene."""

    scene: str
    point: str
    group: Literal["closed_form", "images", "tier", "tolerance", "knob", "effect"]
    title: str
    status: StatusText = column("invalid: the way does not apply to this scene, as reason and message say")
    reason: str = ""
    message: str = ""
    wall_s: float | None = optional("least wall clock of a warm call, for one case", format=".3g")
    cpu_s: float | None = optional("processor time of that call", short="CPU s", format=".3g")
    cold_s: float | None = optional("from the start of a new process to its first answer; null where none was started")
    peak_memory_mb: float | None = optional("peak resident set during the warm calls", short="MB", format=".0f")
    repeats: int = column("calls that were timed", default=0)
    flux_e: float | None = optional("expected electrons of the planet in its aperture, visit")
    variance_e2: float | None = optional("of that sum, science and reference visit together")
    snr: float | None = None
    flux_error: float | None = optional("relative to the reference; free of noise", short="flux")
    flux_uncertainty: float | None = None
    snr_error: float | None = optional("relative to the reference", short="SNR")
    snr_uncertainty: float | None = optional("one standard error of that")
    predicted_error: dict[Quantity, float] = column("what the effect ledger says", default={})
    settings: dict[str, Any] = column("what is modelled", default={})
    samples: dict[str, list[float]] = column(
        "what the noise was measured from: contrast_error, one value a realisation", default={}
    )
    n_frames: int = 0
    machine: str = column("key of the machine")
    version: str


class TradeoffResult(RunResult):
    """Speed against accuracy on fixed scenes."""

    kind: Literal["tradeoff"] = "tradeoff"
    version: str
    quick_look: bool = column("few frames: for a look, not for a record")
    machine: MachineRecord = column("of the latest rows")
    other_machines: list[MachineRecord] = column("of rows that were kept", default=[])
    scenes: list[TradeoffScene]
    rows: list[TradeoffRow]
    speed_ups: dict[str, float] = column(
        "wall clock of the reference over that of one closed-form call, by scene", default={}
    )


class InstrumentValue(Row):
    """One value of an instrument."""

    key: str = column("dotted key, as --set takes it")
    value: str
    other: str | None = optional("value of the other instrument; null where there is none")
    unit: str = ""
    short_name: str = column("what --set and --simulator-overrides call it as well", default="")
    confidence: str = column(
        "P published, I inferred, A assumed; empty for what is the user's", short="sure", default=""
    )
    source: str = ""


class InstrumentResult(Document):
    """Values of an instrument, or those in which two differ."""

    kind: Literal["instrument"] = "instrument"
    title: str = column("names and hashes")
    values: list[InstrumentValue]


class FingerprintRecord(Result):
    """The code, data and libraries that made the numbers of a run."""

    code: str = column("SHA-256 of the installed Python code and of shipped data other than the next two")
    presets: str = column("that of the shipped presets")
    catalogue: str = column("that of the shipped tables of stars and planets")
    libraries: dict[str, str] = column("version, and hash of the compiled files, by distribution")
    processor: list[str] = column("machine, features, kernels of BLAS")


class RunRecord(RunResult):
    """The story of one run: clocks, host, versions; not reproducible and kept apart from the plan."""

    kind: Literal["run"] = "run"
    command: list[str]
    config_hash: str
    parts_hash: str = column(
        "of what decides the finished pieces of work, whatever number of them was asked for, as the list of files has "
        "it; empty in older results",
        default="",
    )
    started_utc: str
    finished_utc: str
    wall_s: float
    workers: int
    scheduler: str | None
    resumed_parts: int
    computed_parts: int
    host: dict[str, Any]
    versions: dict[str, str]
    software: FingerprintRecord | None = optional("null in older results")
    other_fingerprints: list[str] = column(
        "of other processors that took part; nothing but the processor differs", default=[]
    )
    promise: str = column("what holds for another run of the same fingerprints", default="")
    list_sha256: str = column("of the list of the run's files, up to the line of this one", default="")


class _LeftOutRow(Row):
    """Base of rows on what is not used of a user's table."""

    row: int = told("number of the row below the heading, from 1; of several the first", label="first row")
    name: str = told("what that row is about; empty if it does not say", label="of")
    column: str = told("heading of the file, or several joined by or")
    value: str = told("what stands there", label="with")
    reason: str = told("what may stand there, or what is wrong")
    done: str = told("row left out, or taken as missing", label="what is done")


class LeftOutCell(_LeftOutRow):
    """A row of a user's table that is not used, or a cell that is taken as missing."""

    column_order: ClassVar[str] = "table"
    table: str = told("name of the file")


class ColumnTaken(Row):
    """A column of a user's table, and what it is taken for."""

    heading: str = told("heading of the file", label="column of the file")
    quantity: str = told("our column that it is taken for; empty: not used", label="taken for")
    unit: str = told("unit in which it is read; empty: none")
    unit_assumed: bool = told("whether the file names no unit, so that this one is assumed")
    convention: str = told("what its numbers mean beyond their unit, in words; empty: nothing else")
    reason: str = told("why it is not used; empty where it is", label="remark")


class ReasonLeftOut(_LeftOutRow):
    """A reason for which rows or cells of a user's table are not used."""

    column_order: ClassVar[str] = "done count column reason row name value"
    count: int = told("rows or cells", label="how many", short="number")


class TableTaken(Result):
    """The meaning of a file as a table of stars or of planets."""

    taken_as: Literal["stars", "planets"]
    n_rows: int = column("rows of the file")
    n_usable: int = column("rows that are used")
    columns: list[ColumnTaken]
    left_out: list[ReasonLeftOut] = column("rows and cells that are not used, by reason")
    notes: list[str] = column("remarks on the reading")

    @classmethod
    def of_file(cls, taken: "TableReading") -> Self:
        """Return the result of what `catalogs.table_readings` returns."""
        from catalogs import CONVENTIONS

        columns = [
            ColumnTaken.of(
                use,
                unit=use.unit.removeprefix("[").removesuffix("]") if use.quantity else use.unit,
                unit_assumed=bool(use.quantity) and use.unit.startswith("["),
                convention=CONVENTIONS.get(use.convention, use.convention),
                reason=use.why,
            )
            for use in taken.uses
        ]
        reasons = [ReasonLeftOut.of(item, count=count, reason=item.why) for item, count in taken.reasons]
        rest = {"n_rows": taken.rows, "n_usable": taken.usable, "notes": list(taken.notes)}
        return cls(taken_as=taken.kind, columns=columns, left_out=reasons, **rest)


class ColumnsResult(Document):
    """The meaning of the columns of a file, and how many of its rows can be used."""

    main_rows: ClassVar[str] = "tables"
    kind: Literal["columns"] = "columns"
    file: str = column("name of the file, without folders")
    tables: list[TableTaken] = column("one; two where it can be read both as stars and as planets")

    @classmethod
    def of_files(cls, found: "Sequence[TableReading]") -> Self:
        """Return the result of what `catalogs.table_readings` returns of one file."""
        return cls(file=found[0].file, tables=[TableTaken.of_file(one) for one in found])
