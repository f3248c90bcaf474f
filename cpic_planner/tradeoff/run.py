"""Measure the ways on the scenes, each in a process of its own, and keep what an earlier run found."""

from __future__ import annotations

import dataclasses
import multiprocessing
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from typing import Any

from catalogs.errors import InputError
from cpic_planner.models.tradeoff import MachineRecord, TradeoffResult, TradeoffRow, TradeoffScene
from cpic_planner.tradeoff.compare import compared, speed_ups
from cpic_planner.tradeoff.machine import this_machine
from cpic_planner.tradeoff.points import REFERENCE, Point, named_points, points_of
from cpic_planner.tradeoff.scenes import SCENES, FixedScene, fixed_scene
from cpic_planner.tradeoff.worker import FULL_EFFORT, GLANCE, Effort, measure_point, measure_shared
from cpic_planner.version import __version__
from simulator.numeric import numeric_context

__all__ = ["chosen", "n_rows", "tradeoff"]

GLANCE_FRAMES = 2
Advance = Callable[[str], None]


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


def tradeoff(
    work: Sequence[tuple[FixedScene, tuple[Point, ...]]],
    *,
    earlier: TradeoffResult | None = None,
    quick_look: bool = False,
    workers: int = 1,
    advance: Advance = lambda text: None,
    keep: Callable[[TradeoffResult], None] = lambda result: None,
) -> TradeoffResult:
    """Measure, and lay the new rows over those of an earlier run.

    Parameters
    ----------
    work : sequence
        Scenes with their points (`chosen`).
    earlier : TradeoffResult, optional
        Rows that are kept where nothing new is measured: those of the same version and frames.
    quick_look : bool
        Few samples.
    workers : int
        Processes at once for rows that change one thing of the reference; all others are measured alone.
    advance : callable
        Called with a text after each row.
    keep : callable
        Called with the result so far after each scene.

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
    result = _result(rows, machine, machines, quick_look)
    for case, points in work:
        for row in _measured(case, points, effort, machine.key, workers, advance):
            rows[case.name, row.point] = row
        result = _result(rows, machine, machines, quick_look)
        keep(result)
    return result


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
            shown.append(_described(dataclasses.replace(case, n_frames=own[0].n_frames)))
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


def _described(case: FixedScene) -> TradeoffScene:
    return TradeoffScene.of(case)


def _measured(
    case: FixedScene, points: tuple[Point, ...], effort: Effort, machine: str, workers: int, advance: Advance
) -> list[TradeoffRow]:
    rows = []
    for point in points:
        if not point.shares_process:
            rows.append(_in_own_process(_one, case, point, effort, machine, advance=advance))
    batches = [tuple(point for point in points if point.group == group) for group in ("knob", "effect")]
    batches = [batch for batch in batches if batch]
    if batches:
        with ThreadPoolExecutor(max_workers=min(workers, len(batches))) as pool:
            waiting = [
                pool.submit(_in_own_process, _several, case, batch, effort, machine, advance=advance)
                for batch in batches
            ]
            for one in waiting:
                rows += one.result()
    return rows


def _one(
    tell: Connection, launched_s: float, case: FixedScene, point: Point, effort: Effort, machine: str
) -> TradeoffRow:
    row = measure_point(case, point, effort, machine, launched_s)
    tell.send(("step", f"{case.name}, {point.name}"))
    return row


def _several(
    tell: Connection, launched_s: float, case: FixedScene, points: tuple[Point, ...], effort: Effort, machine: str
) -> list[TradeoffRow]:
    del launched_s  # no first calls are timed here
    return measure_shared(case, points, effort, machine, lambda text: tell.send(("step", f"{case.name}, {text}")))


def _in_own_process(function: Callable[..., Any], *arguments: Any, advance: Advance) -> Any:
    """Answer of a function that a new process computes on one thread, starting from nothing."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_serve, args=(theirs, function, time.monotonic(), arguments))
    process.start()
    theirs.close()
    try:
        while True:
            kind, content = ours.recv()
            if kind == "step":
                advance(content)
            elif kind == "error":
                raise content
            else:
                return content
    except EOFError:
        process.join()
        raise RuntimeError(f"a measuring process ended with status {process.exitcode}") from None
    finally:
        if process.is_alive() and process.exitcode is None:
            process.join(timeout=1.0)
        process.terminate()
        process.join()
        ours.close()


def _serve(tell: Connection, function: Callable[..., Any], launched_s: float, arguments: tuple[Any, ...]) -> None:
    try:
        with numeric_context():
            answer = function(tell, launched_s, *arguments)
    except Exception as error:
        tell.send(("error", error))
    else:
        tell.send(("done", answer))
    tell.close()
