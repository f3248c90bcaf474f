"""The files of a tradeoff: table, report, figure of error against time; and reading the result back.

Errors of every way against the reference of its scene, each with its own uncertainty.

Measure the ways on the scenes, each in a process of its own, and keep what an earlier run found.
"""

from __future__ import annotations

import io
import itertools
import math
import multiprocessing
import time
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from cpic_core import Advance, InputError, numeric_context, parse_json, read_text, untold
from cpic_planner.jobs import Job, RunFolder, Runner, Task
from cpic_planner.report import new_figure, place_labels, style
from cpic_planner.results import (
    MachineRecord,
    TradeoffResult,
    TradeoffRow,
    TradeoffScene,
    csv_text as table_text,
    names_of,
)
from cpic_planner.tradeoff.measure import compared, measured_rows, speed_ups
from cpic_planner.tradeoff.scenes import (
    FULL_EFFORT,
    GLANCE,
    REFERENCE,
    SCENES,
    Effort,
    FixedScene,
    Point,
    fixed_scene,
    points_of,
    this_machine,
)
from cpic_planner.version import __version__
from simulator.config import content_hash
from simulator.knobs import Quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_COUNTED = [name for name in names_of(TradeoffRow) if name != "variance_e2"]
_AT = _COUNTED.index("n_frames")
COLUMNS = (*_COUNTED[:_AT], "predicted_flux_error", "predicted_snr_error", *_COUNTED[_AT:])
"""Columns of the CSV file: those of `TradeoffRow`, and what the ledger predicts for flux and SNR."""


def csv_text(result: TradeoffResult) -> str:
    """Return one line for each row; empty where there is no number."""
    errors: dict[str, Quantity] = {"predicted_flux_error": "planet_flux", "predicted_snr_error": "snr"}
    rows = (dict(row) | {name: row.predicted_error.get(of) for name, of in errors.items()} for row in result.rows)
    return table_text(COLUMNS, rows)


def _seconds(value: float | None) -> str:
    if value is None:
        return ""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value / 1e-9:.3g} ns"


def _error_of(row: TradeoffRow, quantity: str) -> str:
    value: float | None = getattr(row, f"{quantity}_error")
    uncertainty: float | None = getattr(row, f"{quantity}_uncertainty")
    if value is None:
        return ""
    if value == 0.0 and not uncertainty:
        return "0"
    if abs(value) < (uncertainty or 0.0):
        return f"< {100 * (uncertainty or 0.0):.2g} %"
    spread = f" ± {100 * uncertainty:.2g}" if uncertainty and uncertainty > 1e-6 else ""
    return f"{100 * value:+.2g}{spread} %"


def _worst(rows: Sequence[TradeoffRow], quantity: str) -> str:
    def size(row: TradeoffRow) -> float:
        return float(abs(getattr(row, f"{quantity}_error") or 0.0))

    worst = max(rows, key=size)
    return _error_of(worst, quantity) + (f" ({worst.scene})" if size(worst) else "")


def report_text(result: TradeoffResult, *, head: str = "") -> str:
    """Return the report.

    Parameters
    ----------
    result : TradeoffResult
    head : str
        What stands between the title and the tables.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    trimmed: dict[str, Any] = {"trim_blocks": True, "lstrip_blocks": True, "keep_trailing_newline": True}
    loader = PackageLoader("cpic_planner", "presets/tradeoff")
    made = Environment(loader=loader, undefined=StrictUndefined, **trimmed)  # noqa: S701 - Markdown
    made.filters |= {"seconds": _seconds, "error": _error_of, "worst": _worst}
    scenes = ", ".join(f"`{scene.name}`" for scene in result.scenes)
    names = "all scenes" if len(result.scenes) == len(SCENES) else scenes
    headings = {group: look[0] for group, look in LOOKS.items()}
    return made.get_template("report.md.j2").render(result=result, head=head, names=names, headings=headings)


# Heading in the report; Okabe-Ito colour, symbol and words in the figure.
LOOKS: dict[str, tuple[str, str, str, str]] = {
    "closed_form": ("Closed forms", "#D55E00", "*", "closed forms"),
    "images": ("Images made in a stated way", "#56B4E9", "s", "images, stated way"),
    "tier": ("Named tiers", "#000000", "o", "named tiers"),
    "tolerance": ("Tolerances", "#009E73", "D", "tolerances"),
    "knob": ("The reference with one knob changed", "#CC79A7", "+", "one knob changed"),
    "effect": ("The reference without one effect", "#999999", "x", "one effect left out"),
}
SMALLEST = 1e-6
"""Errors below are drawn here, as upper limits."""
_LABELS = {"reference": "reference", "standard": "standard", "quick": "quick", "etc": "closed form"}
DPI = 130


def pareto_png(result: TradeoffResult) -> bytes:
    """Return the figure as a file."""
    buffer = io.BytesIO()
    with style():
        pareto_figure(result).savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return buffer.getvalue()


def pareto_figure(result: TradeoffResult) -> Figure:
    """Draw the larger of the errors of flux and SNR against wall clock."""
    from matplotlib.lines import Line2D

    scenes = [scene for scene in result.scenes if not scene.is_programme] or list(result.scenes)
    columns = 2 if len(scenes) > 1 else 1
    lines = math.ceil((len(scenes) + (columns == 2 and len(scenes) % 2 == 0)) / columns) if scenes else 1
    figure = new_figure(3.0 * lines + 0.9)
    panels = figure.subplots(lines, columns, squeeze=False, sharex=True).ravel()
    ok = [row for row in result.rows if row.status == "ok" and row.wall_s and row.snr_error is not None]
    for panel in panels[len(scenes) :]:
        panel.set_axis_off()
    for panel in panels[: len(scenes)][-columns:]:
        panel.tick_params(labelbottom=True)  # the lowest of each column
    for panel, scene in zip(panels, scenes, strict=False):
        panel.set_title(scene.title)
        _draw(panel, [row for row in ok if row.scene == scene.name])
    figure.supxlabel("wall clock of one observation (s)", fontsize=10.5)
    figure.supylabel("relative error (larger of flux and SNR)", fontsize=10.5)
    drawn = [look[1:] for group, look in LOOKS.items() if any(row.group == group for row in ok)]
    handles = [
        Line2D([], [], color=colour, marker=marker, ls="none", ms=7, mfc="none" if marker in "+xv" else colour)
        for colour, marker, _ in (*drawn, ("#444444", "v", ""))
    ]
    handles.append(Line2D([], [], color="#BBBBBB", ls=":"))
    words = [*(text for *_, text in drawn), "upper limit", "1, 3 and 5 %"]
    figure.legend(handles, words, loc="outside upper center", ncols=4)
    return figure


def _size(row: TradeoffRow) -> tuple[float, bool]:
    """Return the error to draw, and whether it is only a limit."""
    pairs = (row.flux_error, row.flux_uncertainty), (row.snr_error, row.snr_uncertainty)
    sizes = [(abs(error or 0.0), limit or 0.0) for error, limit in pairs]
    value, is_limit = max((max(size), size[0] <= size[1]) for size in sizes)
    return (value, is_limit) if value > SMALLEST else (SMALLEST, True)


def _draw(axes: Axes, rows: Sequence[TradeoffRow]) -> None:
    """Draw the ways on one scene, and name the main ones."""
    sizes = {row.point: _size(row) for row in rows}
    axes.set(xscale="log", yscale="log", ylim=(0.5 * SMALLEST, 3.0 * max([0.1, *(size for size, _ in sizes.values())])))
    axes.grid(visible=True)
    for level in (0.01, 0.03, 0.05):
        axes.axhline(level, color="#BBBBBB", lw=0.8, ls=":", zorder=1)
    for row in sorted(rows, key=lambda row: list(LOOKS).index(row.group)):
        _, colour, marker, _ = LOOKS[row.group]
        value, limit = sizes[row.point]
        thin = marker in "+x"
        how: dict[str, Any] = {"color": colour, "mec": colour, "mfc": "none" if limit or thin else colour}
        how |= {"ms": 9 if marker == "*" else 6, "mew": 1.3 if thin and not limit else 0.8}
        axes.plot(row.wall_s or 0.0, value, marker="v" if limit else marker, ls="none", zorder=3, **how)
    named = [row for row in rows if row.point in _LABELS]
    times, errors = [row.wall_s or 0.0 for row in named], [sizes[row.point][0] for row in named]
    place_labels(axes, times, errors, [_LABELS[row.point] for row in named], fontsize=8.5)


_MAX_BYTES = 100_000_000
RESULT = "results.json"
FILES = ("results.csv", "report.md", "pareto.png")
"""Names of the files beside the result."""


def products_of(result: TradeoffResult, *, head: str = "") -> dict[str, bytes]:
    """Return the files beside the result by their names; ``head`` stands between title and tables of the report."""
    contents = csv_text(result).encode(), report_text(result, head=head).encode(), pareto_png(result)
    return dict(zip(FILES, contents, strict=True))


def read_result(folder: Path) -> TradeoffResult | None:
    """Return what an earlier run wrote; None where there is nothing.

    Raises
    ------
    InputError
        If the file there is not such a result.
    """
    path = folder / RESULT
    if not path.exists():
        return None
    try:
        text = read_text(path, key="--out", allowed="a folder of an earlier tradeoff", max_bytes=_MAX_BYTES)
        return TradeoffResult.model_validate(parse_json(text))
    except (ValueError, ValidationError):
        allowed = "a folder of an earlier tradeoff, or a new one"
        raise InputError("--out", str(folder), allowed=allowed, hint=f"its {RESULT} is something else") from None


RESULT_VERSION = 2
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
        cases = [FixedScene.of(case, n_frames=GLANCE_FRAMES) for case in cases]
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

    def measure(runner: Runner[Any]) -> TradeoffResult:
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
            ordered += compared(own)
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
    rows = []
    fresh: dict[str, Any] = {"mp_context": multiprocessing.get_context("spawn"), "max_tasks_per_child": 1}
    with ProcessPoolExecutor(max_workers=min(at_once, len(groups)), **fresh) as pool:
        waiting = [pool.submit(_rows_of, case, group, effort, machine.key, time.monotonic()) for group in groups]
        for group, one in zip(groups, waiting, strict=True):
            rows += one.result()
            progress(f"{case.name}, {_names(group)}", len(group))
    return {"machine": machine.model_dump(mode="json"), "rows": [row.model_dump(mode="json") for row in rows]}


def _rows_of(
    case: FixedScene, points: tuple[Point, ...], effort: Effort, machine: str, launched_s: float
) -> list[TradeoffRow]:
    """Return the rows of points, on one thread."""
    with numeric_context():
        return measured_rows(case, points, effort, machine, launched_s)
