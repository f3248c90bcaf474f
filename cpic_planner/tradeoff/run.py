"""Errors of every way against the reference of its scene, each with its own uncertainty.

Measure the ways on the scenes, each in a process of its own, and keep what an earlier run found.
"""

import dataclasses
import itertools
import math
import multiprocessing
import time
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, Self

import numpy as np

from cpic_core import Advance, FloatArray, InputError, numeric_context, untold
from cpic_planner.jobs import Job, RunFolder, Runner, Task
from cpic_planner.results import MachineRecord, TradeoffResult, TradeoffRow, TradeoffScene
from cpic_planner.tradeoff.points import REFERENCE, Point, compared_programme, points_of
from cpic_planner.tradeoff.setup import FULL_EFFORT, GLANCE, SCENES, Effort, FixedScene, fixed_scene, this_machine
from cpic_planner.tradeoff.worker import measured_rows
from cpic_planner.tradeoff.write import FILES, RESULT, products_of
from cpic_planner.version import __version__
from simulator.config import content_hash

FLUX_LIMIT = 1e-9
"""Rounding of the difference of two expected images, relative to a planet."""


@dataclass(frozen=True)
class _Ratio:
    """A mean or a ratio, and its standard error."""

    value: float
    error: float

    @classmethod
    def of(cls, values: Sequence[float] | FloatArray) -> Self:
        """Return the mean of samples."""
        mean = float(np.mean(values))
        return cls(mean, mean * _relative(values))

    def over(self, other: Self) -> Self:
        """Return the ratio to another one, whose samples have nothing to do with these."""
        if not other.value > 0:
            return type(self)(1.0, 0.0)
        value = self.value / other.value
        own = self.error / self.value if self.value > 0 else 0.0
        return type(self)(value, value * math.hypot(own, other.error / other.value))


def compared(rows: Iterable[TradeoffRow], *, exposure_s: float) -> list[TradeoffRow]:
    """Return the rows of one scene with their errors; None where there is no reference to compare with.

    Parameters
    ----------
    rows : iterable of TradeoffRow
        Of one scene.
    exposure_s : float
        Of a frame.

    Returns
    -------
    list of TradeoffRow

    Notes
    -----
    ``variance = 2 N white + own + (N t)^2 speckle``: science and reference visit of ``N`` frames each, the planet's own
    light, and what subtraction leaves of the star. A part whose random numbers are those of the reference, frame by
    frame or pair by pair, is compared with it sample by sample; the others carry the errors of both.
    """
    every = list(rows)
    best = next((row for row in every if row.point == REFERENCE and row.status == "ok"), None)
    if best is None:
        return [row.model_copy(update=dict.fromkeys(_ERRORS)) for row in every]
    return [_one(row, best, exposure_s) if row.status == "ok" else row for row in every]


_ERRORS = ("variance_e2", "snr", "flux_error", "flux_uncertainty", "snr_error", "snr_uncertainty")


def _one(row: TradeoffRow, best: TradeoffRow, exposure_s: float) -> TradeoffRow:
    assert row.flux_e is not None  # as ok says
    assert best.flux_e is not None
    if "contrast" in best.samples:
        return compared_programme(row, best)
    white_best, speckle_best = _white(best), _speckle(best, best).value * (best.n_frames * exposure_s) ** 2
    parts = np.array([2.0 * best.n_frames * white_best.value, best.samples["own_e2"][0], speckle_best])
    whole = float(parts.sum())
    if row.group == "closed_form":
        variance = row.samples["whole_e2"][0] + row.samples["fixed_speckle_e2"][0]
        error = _variance_error(parts, white_best.error / white_best.value, _relative(best.samples["speckle_e2_s2"]))
    else:
        white, ratio = _white_ratio(row, best), _speckle(row, best).over(_speckle(best, best))
        new = parts * [white.value, 1.0, ratio.value]
        new[1] = row.samples["own_e2"][0]
        variance = float(new.sum())
        error = _variance_error(new, white.error / max(white.value, 1e-300), ratio.error / max(ratio.value, 1e-300))
    flux, noise = row.flux_e / best.flux_e, math.sqrt(variance / whole)
    return row.model_copy(
        update={
            "variance_e2": variance,
            "snr": row.flux_e / math.sqrt(variance),
            "flux_error": flux - 1.0,
            "flux_uncertainty": 0.0 if row is best else FLUX_LIMIT,
            "snr_error": flux / noise - 1.0,
            "snr_uncertainty": 0.0 if row is best else flux / noise * 0.5 * error,
        }
    )


def _variance_error(parts: FloatArray, white: float, speckle: float) -> float:
    return float(np.hypot(parts[0] * white, parts[2] * speckle) / parts.sum())


def _relative(values: Sequence[float] | FloatArray) -> float:
    array = np.asarray(values, float)
    if array.size < 2 or not array.mean() > 0:
        return 0.0
    return float(array.std(ddof=1) / array.mean() / math.sqrt(array.size))


def _white(row: TradeoffRow) -> _Ratio:
    return _Ratio.of([*row.samples["white_e2"], *row.samples.get("more_white_e2", [])])


def _white_ratio(row: TradeoffRow, best: TradeoffRow) -> _Ratio:
    """Return the white noise over the reference's: frame by frame where the frames have the same random numbers."""
    ours, theirs = row.samples["white_e2"], best.samples["white_e2"]
    alike = all(row.settings.get(key) == best.settings.get(key) for key in ("draw", "region"))
    return _paired(ours, theirs) if alike and len(ours) == len(theirs) else _white(row).over(_white(best))


def _speckle(row: TradeoffRow, best: TradeoffRow) -> _Ratio:
    """Return the variance of the residual of the star, (e-/s)^2; its error is that of the ratio to the reference.

    What a row does not hold is as in the reference.
    """
    samples, others = row.samples, best.samples
    fixed = samples.get("speckle_e2_s2", others["speckle_e2_s2"])
    walk, one = (samples.get(name, others[name]) for name in ("walk_e2_s2", "one_epoch_e2_s2"))
    epochs = float(np.mean(walk) / np.mean(one)) if np.mean(one) > 0 else 1.0
    value = float(np.mean(fixed)) * epochs
    if not value > 0:
        return _Ratio(0.0, 0.0)
    knobs, moved = _paired(fixed, others["speckle_e2_s2"]), _paired(walk, others["walk_e2_s2"])
    return _Ratio(value, value * math.hypot(knobs.error / knobs.value, moved.error / moved.value))


def _paired(ours: Sequence[float], theirs: Sequence[float]) -> _Ratio:
    """Return the ratio of two means of paired samples."""
    first, second = np.asarray(ours, float), np.asarray(theirs, float)
    if len(first) != len(second):
        return _Ratio.of(first).over(_Ratio.of(second))
    value = float(first.mean() / second.mean())
    difference = first / first.mean() - second / second.mean() if value > 0 else np.zeros(2)
    return _Ratio(value, value * float(difference.std(ddof=1)) / math.sqrt(difference.size))


def speed_ups(rows: Iterable[TradeoffRow], *, beside: str = "etc") -> dict[str, float]:
    """Return the wall clock of the reference over that of another way on the same machine, by scene."""
    times: dict[str, dict[str, TradeoffRow]] = {}
    for row in rows:
        if row.point in (REFERENCE, beside) and row.wall_s:
            times.setdefault(row.scene, {})[row.point] = row
    return {
        scene: (pair[REFERENCE].wall_s or 0.0) / (pair[beside].wall_s or math.inf)
        for scene, pair in times.items()
        if len(pair) == 2 and pair[REFERENCE].machine == pair[beside].machine
    }


RESULT_VERSION = 1
"""Raised when rows of the same name are measured in another way, so that old folders are not continued."""
GLANCE_FRAMES = 2


def chosen(
    scenes: Sequence[str] = (), only: Sequence[str] = (), *, quick_look: bool = False
) -> list[tuple[FixedScene, tuple[Point, ...]]]:
    """Return what is to be measured: scenes with their points.

    Raises
    ------
    InputError
        For a scene or point that does not exist, or a point that none of the scenes has.
    """
    cases = [fixed_scene(name) for name in dict.fromkeys(scenes)] or list(SCENES.values())
    if quick_look:
        cases = [dataclasses.replace(case, n_frames=GLANCE_FRAMES) for case in cases]
    known = {case.name: points_of(case) for case in cases}
    everywhere = {point.name for points in known.values() for point in points}
    for name in only:
        if name not in everywhere:
            raise InputError("--only", name, allowed=", ".join(sorted(everywhere)))
    work = []
    for case in cases:
        points = tuple(point for point in known[case.name] if point.name in only)
        if not only:
            points = points_of(case, main_only=quick_look)
        if points:
            work.append((case, points))
    return work


def n_rows(work: Iterable[tuple[FixedScene, tuple[Point, ...]]]) -> int:
    """Return the number of rows that will be measured."""
    return sum(len(points) for _, points in work)


def tradeoff_job(
    work: Sequence[tuple[FixedScene, tuple[Point, ...]]],
    *,
    earlier: TradeoffResult | None = None,
    quick_look: bool = False,
    at_once: int = 1,
) -> Job[TradeoffResult]:
    """Return the job that measures, and lays the new rows over those of an earlier result.

    It is to be run by one worker: every row is timed in a process of its own. In a folder that holds a result all is
    measured again; one without is of a run that was broken off, which goes on.

    Parameters
    ----------
    work : sequence
        Scenes with their points (`chosen`).
    earlier : TradeoffResult, optional
        Rows that are kept where nothing new is measured: those of the same version and frames.
    quick_look : bool
        Few samples.
    at_once : int
        Processes at once for rows that change one thing of the reference; all others are measured alone.

    Raises
    ------
    InputError
        If the earlier rows are of another version, or a scene has no reference to compare with.
    """
    machine, effort = this_machine(), GLANCE if quick_look else FULL_EFFORT
    rows, machines = _kept(earlier, quick_look, machine)
    for case, points in work:
        wanted = {point.name for point in points}
        if REFERENCE not in wanted and (case.name, REFERENCE) not in rows:
            raise InputError("--only", ", ".join(sorted(wanted)), allowed=f"{REFERENCE} too: {case.name} has none yet")
    tasks = [
        Task(f"{case.name}, {_names(together)}", (case, together, effort, machine, at_once), steps=len(together))
        for case, points in work
        for together in _together(points)
    ]

    def measure(runner: Runner) -> TradeoffResult:
        ended = runner.output is not None and (runner.output.path / RESULT).exists()
        for body in runner.finish(measured, tasks, tells=True, again=ended).values():
            where = MachineRecord.model_validate(body["machine"])
            machines[where.key] = where
            for row in map(TradeoffRow.model_validate, body["rows"]):
                rows[row.scene, row.point] = row
        return _result(rows, machine, machines, quick_look)

    def write(folder: RunFolder, result: TradeoffResult, bodies: Mapping[str, Any]) -> None:
        for name, content in products_of(result).items():
            folder.write_bytes(name, content)

    return Job(
        kind="tradeoff",
        results=RESULT_VERSION,
        decides=lambda: {"quick_look": quick_look},
        work=measure,
        write=write,
        products=FILES,
        result_file=RESULT,
    )


def _together(points: Sequence[Point]) -> list[tuple[Point, ...]]:
    """Return points that are measured one by one, and at the end those that share their processes."""
    shared = tuple(point for point in points if point.shares_process)
    return [*((point,) for point in points if not point.shares_process), *([shared] if shared else [])]


def _names(points: Sequence[Point]) -> str:
    if len(points) == 1:
        return points[0].name
    return f"{len(points)} changes {content_hash([point.name for point in points])}"


def _kept(
    earlier: TradeoffResult | None, quick_look: bool, machine: MachineRecord
) -> tuple[dict[tuple[str, str], TradeoffRow], dict[str, MachineRecord]]:
    if earlier is None:
        return {}, {}
    if (earlier.version, earlier.quick_look) != (__version__, quick_look):
        held, asked = (
            f"{version}{' with --quick-look' * glance}"
            for version, glance in ((earlier.version, earlier.quick_look), (__version__, quick_look))
        )
        raise InputError("--out", f"results of version {held}", allowed=f"a folder of version {asked}, or a new one")
    machines = {item.key: item for item in (earlier.machine, *earlier.other_machines)} | {machine.key: machine}
    frames = {name: GLANCE_FRAMES if quick_look else case.n_frames for name, case in SCENES.items()}
    return {(row.scene, row.point): row for row in earlier.rows if row.n_frames == frames[row.scene]}, machines


def _result(
    rows: dict[tuple[str, str], TradeoffRow],
    machine: MachineRecord,
    machines: dict[str, MachineRecord],
    quick_look: bool,
) -> TradeoffResult:
    ordered: list[TradeoffRow] = []
    shown = []
    for case in SCENES.values():
        own = [rows[case.name, point.name] for point in points_of(case) if (case.name, point.name) in rows]
        if own:
            ordered += compared(own, exposure_s=case.exposure_s)
            references = case.how.references_of(case.visits)
            shown.append(TradeoffScene.of(case, case.how, n_frames=own[0].n_frames, reference_visits=references))
    used = {row.machine for row in ordered} - {machine.key}
    return TradeoffResult(
        version=__version__,
        quick_look=quick_look,
        machine=machine,
        other_machines=[item for key, item in machines.items() if key in used],
        scenes=shown,
        rows=ordered,
        speed_ups=speed_ups(ordered),
    )


def measured(
    case: FixedScene,
    points: tuple[Point, ...],
    effort: Effort,
    machine: MachineRecord,
    at_once: int,
    progress: Advance = untold,
) -> dict[str, Any]:
    """Measure points of a scene, each or each kind of them in a new process; returns plain rows and the machine."""
    groups = [tuple(group) for _, group in itertools.groupby(points, key=lambda point: point.group)]
    with ThreadPoolExecutor(max_workers=min(at_once, len(groups))) as pool:
        waiting = [pool.submit(_in_own_process, case, group, effort, machine.key, progress) for group in groups]
        rows = [row for one in waiting for row in one.result()]
    return {"machine": machine.model_dump(mode="json"), "rows": [row.model_dump(mode="json") for row in rows]}


def _in_own_process(
    case: FixedScene, points: tuple[Point, ...], effort: Effort, machine: str, progress: Advance
) -> list[TradeoffRow]:
    """Return the rows of points that a new process measures on one thread, starting from nothing."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_serve, args=(theirs, time.monotonic(), case, points, effort, machine))
    process.start()
    theirs.close()
    try:
        while True:
            kind, content = ours.recv()
            if kind == "step":
                progress(f"{case.name}, {content}")
            elif kind == "error":
                raise content
            else:
                return list(content)
    except EOFError:
        process.join()
        raise RuntimeError(f"a measuring process ended with status {process.exitcode}") from None
    finally:
        if process.is_alive() and process.exitcode is None:
            process.join(timeout=1.0)
        process.terminate()
        process.join()
        ours.close()


def _serve(
    tell: Connection, launched_s: float, case: FixedScene, points: tuple[Point, ...], effort: Effort, machine: str
) -> None:
    try:
        with numeric_context():
            rows = measured_rows(case, points, effort, machine, launched_s, lambda name: tell.send(("step", name)))
    except Exception as error:
        tell.send(("error", error))
    else:
        tell.send(("done", rows))
    tell.close()
