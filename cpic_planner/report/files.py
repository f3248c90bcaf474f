"""Results as files: the ranking, every measurement of images, targets of survey strategies, visibility.

Tables of the terminal as CSV, ECSV, LaTeX and Markdown.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

from pydantic import BaseModel

from cpic_core import visible
from cpic_planner import results
from cpic_planner.registry import SCORES
from cpic_planner.report.cells import Cells, chosen, fitting, offered, plain_text
from cpic_planner.version import __version__
from simulator.knobs import Quantity

PRODUCTS = ("ranking.csv", "ranking.ecsv", "measurements.csv", "report.html")
"""Names of the files of a report of a plan."""
WHATIF_PRODUCTS = ("targets.csv", "report.html")
"""Names of the files of a report of survey strategies."""
PANELS = "panels-{band}.png"
"""Name of the images of a band."""

_LATEX_WIDTH, _LATEX_GAP = 82, 2  # letters of \\footnotesize on a line of an article, and between two columns
_POWER = re.compile(r"(\d\.?\d*)e([-+]\d+)")
_LATEX = {"\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "#": r"\#", "_": r"\_", "$": r"\$", "{": r"\{", "}": r"\}"}
_LATEX |= {"~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "–": r"\ldots{}", "×": r"$\times$", "±": r"$\pm$"}
_LATEX |= {
    "−": "$-$",
    "″": "$''$",
    "′": "$'$",
    "°": r"$^\circ$",
    "<": "$<$",
    ">": "$>$",
    "\u202f": r"\,",
}
_LATEX |= {"≥": r"$\ge$", "≤": r"$\le$", "λ": r"$\lambda$", "⊕": r"$\oplus$", "…": r"\ldots{}"}


def products_of(bands: Iterable[str]) -> list[str]:
    """Return the names of the files of a report of images in these bands."""
    return ["measurements.csv", "report.html", *(PANELS.format(band=band) for band in bands)]


def form_text(
    form: str,
    result: BaseModel,
    taken: tuple[str, Sequence[Cells], Sequence[Any]],
    *,
    columns: Sequence[str] = (),
    caption: str = "",
    label: str = "",
) -> str:
    """Return a table of the terminal as text of another form.

    Parameters
    ----------
    form : str
        ``csv`` and ``ecsv`` have the fields of the rows, units in the names or the header, numbers in full and empty
        cells for null; ``latex`` (a ``table`` with the columns that fit a page) and ``markdown`` have the cells of
        the terminal.
    result : BaseModel
        The result that the table is of: it says where its data are from.
    taken : tuple
        Title, columns and entries of the table, as `cpic_planner.report.cells.Sheet` keeps them.
    columns : sequence of str
        Names of the columns that are asked for; those of the table by default.
    caption, label : str
        Of a ``table`` in LaTeX; by default the title with the data and the version, and the kind of result.

    Raises
    ------
    InputError
        For columns that the table does not have.
    """
    title, shown, rows = visible(taken[0], "\n"), *taken[1:]
    shown = chosen(shown, columns) if columns else shown
    if form in ("latex", "markdown"):
        shown = [column for column in shown if not column.for_files]
        cells = [[plain_text(column, row) for column in shown] for row in rows]
        if form == "latex":
            label = label or f"tab:{getattr(result, 'kind', 'table')}"
            return _latex(caption or _caption(title, result), label, shown, cells)
        heads = [f"{column.label or column.header}{f' ({column.unit})' * bool(column.unit)}" for column in shown]
        return _markdown(title, heads, [column.right for column in shown], cells)
    items = {item.column.name: item for column in shown for item in column.taken}
    if form == "ecsv":
        meta = {"title": title, "flag_separator": results.FLAG_SEPARATOR}
        return results.ecsv_text(list(items.values()), rows, meta)
    table = ({name: item.value(row) for name, item in items.items()} for row in rows)
    return results.csv_text(tuple(items), table, joined=results.FLAG_SEPARATOR)


def offered_text(taken: tuple[str, Sequence[Cells], Sequence[Any]]) -> str:
    """Return the columns that a table can have, a line each: name, unit, meaning."""
    lines = []
    for name, cells in offered(taken[1]).items():
        column = next(item.column for item in cells.taken if item.column.name == name)
        unit = f" [{column.unit}]" if column.unit else ""
        lines.append(f"{name}{unit}{f': {column.description}' if column.description else ''}\n")
    return "".join(lines)


def _caption(title: str, result: BaseModel) -> str:
    """Return what a table is, of which date and data, and the version that made it, as sentences."""
    date = str(getattr(result, "date_utc", ""))[:10]
    said = (
        *title.split("\n"),
        f"Date: {date}" if date else "",
        str(getattr(result, "catalogue", "")).partition(" (")[0],
    )
    return " ".join(f"{text.strip().rstrip('.')}." for text in (*said, f"cpic-planner {__version__}") if text.strip())


def _markdown(title: str, heads: Sequence[str], right: Sequence[bool], cells: Sequence[Sequence[str]]) -> str:
    def line(words: Sequence[str]) -> str:
        return f"| {' | '.join(word.replace('|', chr(92) + '|') for word in words)} |\n"

    rule = line(["---:" if side else "---" for side in right])
    return f"{title}\n\n{line(heads)}{rule}{''.join(map(line, cells))}"


def _latex(caption: str, label: str, columns: Sequence[Cells], cells: Sequence[Sequence[str]]) -> str:
    heads = [
        f"{item.header} ({item.unit})" if item.unit and item.header == item.label else item.header for item in columns
    ]
    widths = [max(len(line[i]) for line in [heads, *cells]) + _LATEX_GAP for i in range(len(heads))]
    shown = fitting(columns, widths, _LATEX_WIDTH)

    def line(words: Sequence[str]) -> str:
        return f"{' & '.join(latex_text(words[i]) for i in shown)} \\\\\n"

    sides = "".join("r" if columns[i].right else "l" for i in shown)
    look = "\\begin{table}\n\\centering\\footnotesize\\setlength{\\tabcolsep}{3pt}\n"
    named = f"\\caption{{{latex_text(caption)}}}\n\\label{{{visible(label)}}}\n"
    tabular = f"\\begin{{tabular}}{{{sides}}}\n\\hline\n{line(heads)}\\hline\n{''.join(map(line, cells))}\\hline\n"
    return f"{look}{named}{tabular}\\end{{tabular}}\n\\end{{table}}\n"


def latex_text(text: str) -> str:
    """Return a text for LaTeX: powers of ten, Greek letters and signs in mathematics, the rest escaped."""
    made = []
    for part in re.split(r"(\d\.?\d*e[-+]\d+)", visible(text)):
        power = _POWER.fullmatch(part)
        if power is not None:
            made.append(rf"${power[1]}\times10^{{{int(power[2])}}}$")
            continue
        made.append("".join(map(_latex_sign, part)))
    return "".join(made)


def _latex_sign(sign: str) -> str:
    name = unicodedata.name(sign, "")
    if name.startswith("GREEK SMALL LETTER "):
        letter = name.rsplit(" ", 1)[1].lower()
        return "o" if letter == "omicron" else rf"$\{letter}$"
    if name.startswith(("SUPERSCRIPT", "SUBSCRIPT")):
        kind = "^" if name.startswith("SUPER") else "_"
        return f"${kind}{{{unicodedata.normalize('NFKD', sign).replace(chr(0x2212), '-')}}}$"
    return _LATEX.get(sign, sign)


_MODEL_COLUMNS = ("fidelity", "region", "epochs")
_KNOB_COLUMNS = ("pupil_samples", "wavelength_nodes", "pixel_nodes", "precision")
_ERROR_COLUMNS: tuple[Quantity, ...] = ("planet_flux", "snr")
MEASUREMENT_COLUMNS: tuple[str, ...] = (
    "target",
    "hip",
    "chosen",
    *(name for name in results.names_of(results.BandConfirmation) if name != "image"),
    *_MODEL_COLUMNS,
    *_KNOB_COLUMNS,
    *(f"predicted_error_{name}" for name in _ERROR_COLUMNS),
    *results.names_of(results.AuditRecord, before="audit_"),
)
"""Columns, in order: those of `BandConfirmation`, of its `ModellingRecord`, and, with ``audit_`` before their names, of
`AuditRecord`."""


def score_taken(name: str) -> results.Taken:
    """Return the column of a score in files, with the unit of that score."""
    (taken,) = results.taken_of(results.RankedTarget, "score")
    return replace(taken, column=replace(taken.column, unit=SCORES[name].unit))


def ranking_csv(rank: results.RankResult, limit: int | None = None) -> str:
    """Return the ranking as CSV: one line a target, header with units in the names, empty cells for null.

    Numbers keep full precision (shortest text that reads back to the same double); flags are joined with ``|``. With
    a ``limit`` the first stars alone.
    """
    rows = rank.targets[:limit]
    names = (*results.names_of(results.RankedTarget), *(item.column.name for item in results.own_taken(rows)))
    return results.csv_text(names, (results.values_of(row) | row.own for row in rows), joined=results.FLAG_SEPARATOR)


def ranking_ecsv(rank: results.RankResult, limit: int | None = None) -> str:
    """Return the ranking as ECSV 1.0: units and descriptions of every column, and what the ranking is, in the header.

    Reads back with ``astropy.table.Table.read(..., format="ascii.ecsv")``; missing numbers are masked. With a
    ``limit`` the first stars alone, and the header says of how many.
    """
    rows = rank.targets[:limit]
    meta = rank.model_dump(mode="json", exclude={"targets"}) | {"flag_separator": results.FLAG_SEPARATOR}
    if len(rows) < len(rank.targets):
        meta |= {"rows": len(rows), "rows_in_all": len(rank.targets)}
    columns = [*results.taken_of(results.RankedTarget), *results.own_taken(rows)]
    score = score_taken(rank.score_name)
    return results.ecsv_text([score if item.column.name == "score" else item for item in columns], rows, meta)


def measurements_csv(result: results.PlanResult | results.StarImagesResult | results.ConfirmResult) -> str:
    """Return one line for each planet and band; units stand in the names, missing numbers are empty."""
    if isinstance(result, results.ConfirmResult):
        rows = [_measured(band) | {"target": result.scene} for band in result.bands]
    else:
        rows = [
            _measured(band) | {"target": target.name, "hip": target.hip, "chosen": band.band == target.chosen_band}
            for target in result.targets
            for band in target.bands
        ]
    return results.csv_text(MEASUREMENT_COLUMNS, rows)


def _measured(band: results.BandConfirmation) -> dict[str, Any]:
    cells = results.values_of(band)
    if (made := band.modelled) is not None:
        cells |= {name: getattr(made, name) for name in _MODEL_COLUMNS}
        cells |= {name: getattr(made.knobs, name) for name in _KNOB_COLUMNS}
        cells |= {f"predicted_error_{name}": made.predicted_error.get(name) for name in _ERROR_COLUMNS}
    return cells | ({} if band.audit is None else results.values_of(band.audit, before="audit_"))


def targets_csv(result: results.WhatIfResult) -> str:
    """Return one line for each strategy and star; units stand in the names, lists are joined with semicolons."""
    rows = []
    for item in result.strategies:
        rows += [{"strategy": item.name} | results.values_of(target) for target in item.targets]
    return results.csv_text(("strategy", *results.names_of(results.SurveyTarget)), rows)


def visibility_csv(result: results.VisibilityResult) -> str:
    """Return visibility as CSV: one line a target and step."""
    days = ("blocked_by", "visible_s", "window_s", "roll_half_range_deg", "sun_deg", "moon_deg")
    names = ("name", "mjd", *days)
    rows = (
        dict(zip(names, (target.name, *step), strict=True))
        for target in result.targets
        for step in zip(result.mjd, *(getattr(target.days, name) for name in days), strict=True)
    )
    return results.csv_text(names, rows)
