"""Measure the ways on the scenes, each in a process of its own, and keep what an earlier run found."""

from __future__ import annotations

import dataclasses
import itertools
import multiprocessing
import time
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from typing import Any

from catalogs.errors import InputError
from cpic_planner.jobs.folder import RunFolder
from cpic_planner.jobs.job import Job, Runner, Task
from cpic_planner.models.tradeoff import MachineRecord, TradeoffResult, TradeoffRow, TradeoffScene
from cpic_planner.tradeoff.compare import compared, speed_ups
from cpic_planner.tradeoff.machine import this_machine
from cpic_planner.tradeoff.points import REFERENCE, Point, named_points, points_of
from cpic_planner.tradeoff.scenes import SCENES, FixedScene, fixed_scene
from cpic_planner.tradeoff.worker import FULL_EFFORT, GLANCE, Effort, measured_rows
from cpic_planner.tradeoff.write import FILES, RESULT, products_of
from cpic_planner.version import __version__
from simulator.config import content_hash
from simulator.numeric import numeric_context
from simulator.work import Advance, untold

RESULT_VERSION = 1
"""Raised when rows of the same name are measured in another way, so that old folders are not continued."""
GLANCE_FRAMES = 2


def chosen(
    scenes: Sequence[str] = (), only: Sequence[str] = (), *, quick_look: bool = False
) -> list[tuple[FixedScene, tuple[Point, ...]]]:
    """What is to be measured: scenes with their points.

    Raises
    ------
    InputError
        For a scene or point that does not exist, or a point that none of the scenes has.
    """
    cases = [fixed_scene(name) for name in dict.fromkeys(scenes)] or list(SCENES.values())
    if quick_look:
        cases = [dataclasses.replace(case, n_frames=GLANCE_FRAMES) for case in cases]
    found = []
    for case in cases:
        known = {point.name for point in points_of(case)}
        names = tuple(name for name in only if name in known)
        if names or not only:
            found.append((case, named_points(case, names, main_only=quick_look and not only)))
    everywhere = {point.name for case in cases for point in points_of(case)}
    for name in only:
        if name not in everywhere:
            raise InputError("--only", name, allowed=", ".join(sorted(everywhere)))
    return found


def n_rows(work: Iterable[tuple[FixedScene, tuple[Point, ...]]]) -> int:
    """Number of rows that will be measured."""
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
            shown.append(TradeoffScene.of(case, n_frames=own[0].n_frames))
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
