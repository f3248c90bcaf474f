"""The files of a tradeoff: table, report, figure of error against time; and reading the result back."""

from __future__ import annotations

import functools
import io
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from cpic_core import InputError, load_yaml, parse_json, read_text
from cpic_planner.report import new_figure, place_labels, style
from cpic_planner.results import MachineRecord, TradeoffResult, TradeoffRow, csv_text as table_text, names_of
from cpic_planner.tradeoff.points import REFERENCE
from cpic_planner.tradeoff.setup import SCENES
from simulator.knobs import Quantity

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_COUNTED = [name for name in names_of(TradeoffRow) if name != "variance_e2"]
_AT = _COUNTED.index("n_frames")
COLUMNS = (*_COUNTED[:_AT], "predicted_flux_error", "predicted_snr_error", *_COUNTED[_AT:])
"""Columns of the CSV file: those of `TradeoffRow`, and what the ledger predicts for flux and SNR."""
_MEASURED = ("flux", "snr")
_PROSE = Path(__file__).resolve().parents[1] / "presets" / "tradeoff" / "report.yaml"
_TIERS = ("etc", "quick", "standard", "reference")


def csv_text(result: TradeoffResult) -> str:
    """Return one line for each row; empty where there is no number."""
    errors: dict[str, Quantity] = {"predicted_flux_error": "planet_flux", "predicted_snr_error": "snr"}
    rows = (dict(row) | {name: row.predicted_error.get(of) for name, of in errors.items()} for row in result.rows)
    return table_text(COLUMNS, rows)


@functools.cache
def _prose() -> dict[str, Any]:
    return dict(load_yaml(_PROSE))


def _table(name: str, lines: Iterable[Sequence[str]]) -> str:
    head = _prose()["heads"][name].split(" | ")
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *lines))


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


def tier_table(result: TradeoffResult) -> str:
    """Return one line per tier: range of times and memory over the scenes of a single visit, and the worst errors."""
    lines, programmes = [], {scene.name for scene in result.scenes if scene.is_programme}
    for name in _TIERS:
        rows = [row for row in result.rows if row.point == name and row.scene not in programmes]
        good = [row for row in rows if row.status == "ok"]
        if not good:
            continue
        times = sorted(row.wall_s or 0.0 for row in good)
        tier = "closed form" if name == "etc" else f"`{name}`"
        span = f"{_seconds(times[0])} to {_seconds(times[-1])}"
        memory = f"{max(row.peak_memory_mb or 0.0 for row in good):.0f}"
        lines.append([tier, span, memory, _worst(good, "flux"), _worst(good, "snr"), f"{len(good)} of {len(rows)}"])
    return _table("tiers", lines)


_OF_PROGRAMMES = ("etc", REFERENCE, "hole_standard")
"""Ways that the table of programmes compares."""


def programme_table(result: TradeoffResult) -> str:
    """Return one line per programme of visits: time of each way, and what the closed form says against the images."""
    lines = []
    for scene in (scene for scene in result.scenes if scene.is_programme):
        rows = {row.point: row for row in result.rows if row.scene == scene.name and row.status == "ok"}
        known = (rows.get(name) for name in _OF_PROGRAMMES)
        times = [_seconds(row.cpu_s) if row else "" for row in known]
        form, best = rows.get("etc"), rows.get(REFERENCE)
        errors = [_error_of(form, of) for of in _MEASURED if form]
        cells = [scene.visits, scene.reference_visits, scene.n_modes, scene.library.replace("_", " ")]
        snr = f"{best.snr:.2f}" if best and best.snr else ""
        lines.append([*map(str, cells), snr, *(errors or ["", ""]), *times])
    return _table("programmes", lines)


def _programmes_text(result: TradeoffResult) -> str:
    """Return the section of programmes; nothing where none was measured."""
    if not any(scene.is_programme for scene in result.scenes):
        return ""
    text: str = _prose()["programmes"]
    return f"\n{text.format(programmes=programme_table(result))}"


def _worst(rows: Sequence[TradeoffRow], quantity: str) -> str:
    def size(row: TradeoffRow) -> float:
        return float(abs(getattr(row, f"{quantity}_error") or 0.0))

    worst = max(rows, key=size)
    return _error_of(worst, quantity) + (f" ({worst.scene})" if size(worst) else "")


def _machine_text(machine: MachineRecord) -> str:
    return (
        f"{machine.processor}, {machine.cores} cores, {machine.memory_gb:g} GB, {machine.system}; Python "
        f"{machine.python}, NumPy {machine.numpy}, SciPy {machine.scipy}, Numba {machine.numba}, {machine.blas} on "
        f"{machine.blas_threads} thread"
    )


def _scene_text(result: TradeoffResult, scene: str) -> str:
    about = next(item for item in result.scenes if item.name == scene)
    frames = f"{about.band}, {about.n_frames} frames of {about.exposure_s:g} s, gain {about.em_gain:g}"
    if not about.is_programme:
        frames += "; as many of a reference visit"
    elif about.library == "roll":
        frames += f", in each of {about.visits} visits, half of it at either roll"
    else:
        references = f"as many reference frames in {about.reference_visits} visits"
        frames += f", in each of {about.visits} visits; {references}"
    parts = [f"## {about.title} (`{scene}`)\n\n{about.why[0].upper()}{about.why[1:]}.\n{frames}."]
    own = [row for row in result.rows if row.scene == scene]
    for group, (heading, *_) in LOOKS.items():
        rows = [row for row in own if row.group == group]
        if rows:
            lines = [_line(row, result.machine.key) for row in rows]
            parts.append(f"### {heading}\n\n{_table('scene', lines)}")
    return "\n\n".join(parts)


def _scenes_text(result: TradeoffResult) -> str:
    """Name the scenes of a result, which may be some of the fixed ones."""
    names = [scene.name for scene in result.scenes]
    return "all scenes" if len(names) == len(SCENES) else ", ".join(f"`{name}`" for name in names)


def _line(row: TradeoffRow, machine: str) -> list[str]:
    mark = "" if row.machine == machine else " (another machine)"
    if row.status != "ok":
        return [f"{row.title}{mark}", f"{row.status}: {row.reason.replace('_', ' ')}", "", "", "", row.message, ""]
    times = map(_seconds, (row.wall_s, row.cpu_s, row.cold_s))
    memory = "" if row.peak_memory_mb is None else f"{row.peak_memory_mb:.0f}"
    return [f"{row.title}{mark}", *times, memory, *(_error_of(row, of) for of in _MEASURED)]


def report_text(result: TradeoffResult, *, head: str = "") -> str:
    """Return the report.

    Parameters
    ----------
    result : TradeoffResult
    head : str
        What stands between the title and the tables.
    """
    scenes = "\n\n".join(_scene_text(result, item.name) for item in result.scenes)
    single = [scene.name for scene in result.scenes if not scene.is_programme]
    faster = "\n".join(f"- {name}: {ratio:.0f} times" for name, ratio in result.speed_ups.items() if name in single)
    others = "".join(f"\nRows marked so: {_machine_text(item)}.\n" for item in result.other_machines)
    glance = "\n**Few frames and samples: for a look, not for a record.**\n" if result.quick_look else ""
    tables = {"tiers": tier_table(result), "programmes": _programmes_text(result), "scenes": scenes, "faster": faster}
    said = {"glance": glance, "head": head, "machine": _machine_text(result.machine), "others": others}
    return str(_prose()["report"].format(names=_scenes_text(result), **tables, **said))


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
    scenes = [scene for scene in result.scenes if not scene.is_programme] or list(result.scenes)
    columns = 2 if len(scenes) > 1 else 1
    lines = math.ceil((len(scenes) + (columns == 2 and len(scenes) % 2 == 0)) / columns) if scenes else 1
    figure = new_figure(3.0 * lines + 0.9)
    panels = figure.subplots(lines, columns, squeeze=False, sharex=True).ravel()
    ok = [row for row in result.rows if row.status == "ok" and row.wall_s and row.snr_error is not None]
    for panel, scene in zip(panels, scenes, strict=False):
        _panel(panel, [row for row in ok if row.scene == scene.name])
        panel.set_title(scene.title)
    for panel in panels[len(scenes) :]:
        panel.set_axis_off()
    for panel in panels[: len(scenes)][-columns:]:
        panel.tick_params(labelbottom=True)  # the lowest of each column
    figure.supxlabel("wall clock of one observation (s)", fontsize=10.5)
    figure.supylabel("relative error (larger of flux and SNR)", fontsize=10.5)
    handles, labels = _legend()
    figure.legend(handles, labels, loc="outside upper center", ncols=4)
    for panel, scene in zip(panels, scenes, strict=False):
        named = [row for row in ok if row.scene == scene.name and row.point in _LABELS]
        times, sizes = [row.wall_s or 0.0 for row in named], [_size(row)[0] for row in named]
        place_labels(panel, times, sizes, [_LABELS[row.point] for row in named], fontsize=8.5)
    return figure


def _size(row: TradeoffRow) -> tuple[float, bool]:
    """Return the error to draw, and whether it is only a limit."""
    sizes = []
    for quantity in ("flux", "snr"):
        value, limit = abs(getattr(row, f"{quantity}_error") or 0.0), getattr(row, f"{quantity}_uncertainty") or 0.0
        sizes.append((value, False) if value > limit else (limit, True))
    value, limit = max(sizes)
    return (value, limit) if value > SMALLEST else (SMALLEST, True)


def _panel(axes: Axes, rows: Sequence[TradeoffRow]) -> None:
    top = max([0.1, *(_size(row)[0] for row in rows)])
    axes.set(xscale="log", yscale="log", ylim=(0.5 * SMALLEST, 3.0 * top))
    axes.grid(visible=True)
    for level in (0.01, 0.03, 0.05):
        axes.axhline(level, color="#BBBBBB", lw=0.8, ls=":", zorder=1)
    for row in sorted(rows, key=lambda row: list(LOOKS).index(row.group)):
        _, colour, marker, _ = LOOKS[row.group]
        value, limit = _size(row)
        thin = marker in "+x"
        axes.plot(
            row.wall_s or 0.0,
            value,
            marker="v" if limit else marker,
            color=colour,
            ls="none",
            zorder=3,
            ms=9 if marker == "*" else 6,
            mew=1.3 if thin and not limit else 0.8,
            mfc="none" if limit or thin else colour,
            mec=colour,
        )


def _legend() -> tuple[list[Artist], list[str]]:
    from matplotlib.lines import Line2D

    handles: list[Artist] = [
        Line2D([], [], color=colour, marker=marker, ls="none", ms=7, mfc="none" if marker in "+x" else colour)
        for _, colour, marker, _ in LOOKS.values()
    ]
    handles.append(Line2D([], [], color="#444444", marker="v", ls="none", ms=7, mfc="none"))
    handles.append(Line2D([], [], color="#BBBBBB", ls=":"))
    return handles, [*(text for *_, text in LOOKS.values()), "upper limit", "1, 3 and 5 %"]


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
