"""The values that a figure shows, read from the figure itself: for tables, and for the script of pages, at the pointer.

What is to be read has a label; one that begins with an underscore is left out of legends, as matplotlib does.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np

from cpic_planner.report import document as doc
from cpic_planner.report.words import MISSING, contrast_text, significant

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure


_DIGITS, _PLACE_DIGITS = 5, 8


_NAMELESS = re.compile(r"_(child|container)\d+|_nolegend_|")


class Scale(TypedDict):
    """An axis: its label, whether it is logarithmic or counts days since 1970, and its ends."""

    label: str
    log: bool
    days: bool
    low: float
    high: float


class Line(TypedDict):
    """A line by its points; None where it has a gap."""

    name: str
    x: list[float | None]
    y: list[float | None]


class Level(TypedDict):
    """A line at one height."""

    name: str
    y: float


class Bar(TypedDict):
    """A bar in a row, from its low to its high end; a point begins at 0."""

    name: str
    row: int
    low: float
    high: float


class Panel(TypedDict):
    """One pair of axes; ``box`` is left, bottom, width and height as shares of the figure, ``rows`` name its rows."""

    title: str
    box: list[float]
    x: Scale
    y: Scale
    rows: list[str]
    lines: list[Line]
    levels: list[Level]
    bars: list[Bar]


def panels_of(figure: Figure) -> list[Panel]:
    """Return what the axes of a finished figure show; those without a named value are left out."""
    found = map(_panel, figure.axes)
    return [panel for panel in found if panel["lines"] or panel["bars"]]


def _panel(axes: Axes) -> Panel:
    from matplotlib.patches import StepPatch

    rows, lines, levels = _rows(axes), list[Line](), list[Level]()
    bars = list(_bars(axes)) if rows else []
    for line in axes.lines:
        name = _name(line.get_label())
        x, y = (np.atleast_1d(np.asarray(values, float)) for values in line.get_data(orig=False))
        if not name:
            continue
        if rows:
            at = zip(x.tolist(), y.tolist(), strict=True)
            bars += [{"name": name, "row": round(row), "low": 0.0, "high": _rounded(value)} for value, row in at]
        elif line.get_transform() == axes.get_yaxis_transform(which="grid"):
            levels.append({"name": name, "y": _rounded(y[0])})
        else:
            lines.append({"name": name, "x": _listed(x, _PLACE_DIGITS), "y": _listed(y)})
    for patch in axes.patches:
        if isinstance(patch, StepPatch) and (name := _name(patch.get_label())):
            values, edges, _ = patch.get_data()
            middle = 0.5 * (np.asarray(edges)[1:] + np.asarray(edges)[:-1])
            lines.append({"name": name, "x": _listed(middle, _PLACE_DIGITS), "y": _listed(np.asarray(values, float))})
    place = axes.get_position()
    box = [round(float(value), 5) for value in (place.x0, place.y0, place.width, place.height)]
    title = _plain(axes.get_title())
    scales = (_scale(axes.xaxis, axes.get_xlim()), _scale(axes.yaxis, axes.get_ylim()))
    return Panel(title=title, box=box, x=scales[0], y=scales[1], rows=rows, lines=lines, levels=levels, bars=bars)


def _bars(axes: Axes) -> Iterator[Bar]:
    from matplotlib.container import BarContainer

    for container in axes.containers:
        if isinstance(container, BarContainer) and (name := _name(container.get_label())):
            for bar in container.patches:
                ends, row = (bar.get_x(), bar.get_x() + bar.get_width()), bar.get_y() + 0.5 * bar.get_height()
                yield {"name": name, "row": round(row), "low": _rounded(ends[0]), "high": _rounded(ends[1])}


def _rows(axes: Axes) -> list[str]:
    """Return the names of rows, where the ticks of the y axis are texts."""
    from matplotlib.ticker import FixedLocator, FuncFormatter

    axis = axes.yaxis
    named = isinstance(axis.get_major_locator(), FixedLocator) and isinstance(axis.get_major_formatter(), FuncFormatter)
    return axis.get_major_formatter().format_ticks(list(axis.get_majorticklocs())) if named else []


def _scale(axis: Axis, ends: tuple[float, float]) -> Scale:
    from matplotlib.dates import DateLocator

    days = isinstance(axis.get_major_locator(), DateLocator)
    low, high = (_rounded(end, _PLACE_DIGITS) for end in ends)
    label = _plain(axis.get_label_text()) or ("date" if days else "")
    return Scale(label=label, log=axis.get_scale() == "log", days=days, low=low, high=high)


def _plain(text: str) -> str:
    return text.replace(r"\$", "$")


def _name(label: Any) -> str:
    """Return what a label says; empty for those that matplotlib makes."""
    return "" if _NAMELESS.fullmatch(str(label)) else _plain(str(label)).lstrip("_")


def _rounded(value: float, digits: int = _DIGITS) -> float:
    return float(f"{value:.{digits}g}")


def _listed(values: Any, digits: int = _DIGITS) -> list[float | None]:
    return [_rounded(value, digits) if np.isfinite(value) else None for value in values.tolist()]


def values_blocks(panels: Iterable[Panel]) -> Iterator[doc.Block]:
    """Yield the values of panels as tables: lines that share their places, and rows with all that stands in them.

    Places before the first value of any line and behind the last are left out.
    """
    for panel in panels:
        if panel["bars"]:
            yield _row_table(panel)
        groups: dict[tuple[float | None, ...], list[Line]] = {}
        for line in panel["lines"]:
            groups.setdefault(tuple(line["x"]), []).append(line)
        for lines in groups.values():
            yield _line_table(panel, lines)
        if panel["levels"]:
            told = "; ".join(f"{level['name']}: {_text(level['y'])}" for level in panel["levels"])
            yield doc.Paragraph(f"{panel['y']['label']}: {told}.", "note")


def _line_table(panel: Panel, lines: list[Line]) -> doc.Table:
    scale, names = panel["x"], ", ".join(line["name"] for line in lines)
    told = [at for at in range(len(lines[0]["x"])) if any(line["y"][at] is not None for line in lines)]
    columns = [doc.Column[int](scale["label"], lambda at: _place(scale, lines[0]["x"][at]), look="row")]
    columns += [doc.Column(line["name"], partial(_height, line)) for line in lines]
    caption = f"{panel['y']['label']}{': ' * bool(panel['title'])}{panel['title']}"
    shown = range(told[0], told[-1] + 1) if told else ()
    return doc.table(f"{panel['y']['label']}: {names}", f"{caption}.", columns, shown)


def _row_table(panel: Panel) -> doc.Table:
    found: dict[str, dict[int, Bar]] = {}
    for bar in panel["bars"]:
        found.setdefault(bar["name"], {})[bar["row"]] = bar
    columns = [doc.Column[int]("", lambda row: panel["rows"][row], look="row left")]
    columns += [doc.Column(name, partial(_length, bars)) for name, bars in found.items()]
    return doc.table(panel["x"]["label"], f"{panel['x']['label']}.", columns, range(len(panel["rows"])))


def _height(line: Line, at: int) -> str:
    return _text(line["y"][at])


def _length(bars: dict[int, Bar], row: int) -> str:
    return _text(bars[row]["high"] - bars[row]["low"]) if row in bars else MISSING


def _place(scale: Scale, value: float | None) -> str:
    if scale["days"] and value is not None:
        return str(np.datetime64(int(np.floor(value)), "D"))
    return _text(value)


def _text(value: float | None) -> str:
    if value is None or value == 0.0 or 1e-3 <= abs(value) < 1e6:
        return significant(value, 4)
    return contrast_text(value, 4)
