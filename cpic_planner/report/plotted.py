"""The values that a figure shows, read from the figure itself: for tables, and for the script of pages, at the pointer.

What is to be read has a label; one that begins with an underscore is left out of legends, as matplotlib does.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from cpic_planner.report import document as doc
from cpic_planner.report.words import contrast_text, significant

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure


_DIGITS, _PLACE_DIGITS = 5, 8


_NAMELESS = re.compile(r"_(child|container)\d+|_nolegend_|")


Panel: TypeAlias = dict[str, Any]
"""One pair of axes, as JSON: ``title``; ``box``, left, bottom, width and height as shares of the figure; ``x`` and
``y``, each with ``label``, ``low``, ``high``, ``log``, and ``days`` where it counts days since 1970; ``rows``, the
names of rows; ``lines``, each with ``name``, ``x`` and ``y``, null where it has a gap; ``levels``, lines at one height;
``bars`` with ``name``, ``row``, ``low`` and ``high`` end, where a point begins at 0."""


def panels_of(figure: Figure) -> list[Panel]:
    """Return what the axes of a finished figure show; those without a named value are left out."""
    found = map(_panel, figure.axes)
    return [panel for panel in found if panel["lines"] or panel["bars"]]


def _panel(axes: Axes) -> Panel:
    from matplotlib.patches import StepPatch

    rows, lines, levels = _rows(axes), list[Panel](), list[Panel]()
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


def _bars(axes: Axes) -> Iterator[Panel]:
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


def _scale(axis: Axis, ends: tuple[float, float]) -> Panel:
    from matplotlib.dates import DateLocator

    days = isinstance(axis.get_major_locator(), DateLocator)
    low, high = (_rounded(end, _PLACE_DIGITS) for end in ends)
    label = _plain(axis.get_label_text()) or ("date" if days else "")
    return Panel(label=label, log=axis.get_scale() == "log", days=days, low=low, high=high)


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
        groups: dict[tuple[float | None, ...], list[Panel]] = {}
        for line in panel["lines"]:
            groups.setdefault(tuple(line["x"]), []).append(line)
        for lines in groups.values():
            yield _line_table(panel, lines)
        if panel["levels"]:
            told = "; ".join(f"{level['name']}: {_text(level['y'])}" for level in panel["levels"])
            yield doc.Paragraph(f"{panel['y']['label']}: {told}.", "note")


def _line_table(panel: Panel, lines: list[Panel]) -> doc.Table:
    scale, names = panel["x"], ", ".join(line["name"] for line in lines)
    told = [at for at in range(len(lines[0]["x"])) if any(line["y"][at] is not None for line in lines)]
    columns = [doc.own_column(scale["label"], lambda at: _place(scale, lines[0]["x"][at]), look="row")]
    columns += [doc.own_column(line["name"], lambda at, line=line: _text(line["y"][at])) for line in lines]  # type: ignore[misc]
    title = f"{panel['y']['label']}: {names}"
    caption = f"{panel['y']['label']}{': ' * bool(panel['title'])}{panel['title']}."
    return doc.Table(title, columns, range(told[0], told[-1] + 1) if told else (), caption)


def _row_table(panel: Panel) -> doc.Table:
    lengths: dict[str, dict[int, float]] = {}
    for bar in panel["bars"]:
        lengths.setdefault(bar["name"], {})[bar["row"]] = bar["high"] - bar["low"]
    columns = [doc.own_column("", lambda row: panel["rows"][row], look="row left")]
    columns += [doc.own_column(name, lambda row, own=own: _text(own.get(row))) for name, own in lengths.items()]  # type: ignore[misc]
    return doc.Table(panel["x"]["label"], columns, range(len(panel["rows"])), "Values of the bars.")


def _place(scale: Panel, value: float | None) -> str:
    if scale["days"] and value is not None:
        return str(np.datetime64(int(np.floor(value)), "D"))
    return _text(value)


def _text(value: float | None) -> str:
    if value is None or value == 0.0 or 1e-3 <= abs(value) < 1e6:
        return significant(value, 4)
    return contrast_text(value, 4)
