"""Results as files: the ranking, every measurement of images, targets of survey strategies, visibility.

Tables of the terminal as CSV, ECSV, LaTeX and Markdown.
"""

from __future__ import annotations

import json
import re
import unicodedata
from collections.abc import Mapping, Sequence
from typing import Any

from cpic_core import visible
from cpic_planner import results
from cpic_planner.report.cells import Cells
from cpic_planner.report.words import STATUS_SYMBOLS
from simulator.knobs import Quantity

_DIGITS = 4
_MARKS = re.compile(f"^[→·{''.join(STATUS_SYMBOLS.values())}\\s]+")
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


def form_text(form: str, title: str, columns: Sequence[Cells], rows: Sequence[Any]) -> str:
    """Return a table of the terminal, with all its columns, as text of another form.

    Parameters
    ----------
    form : str
        ``csv`` and ``ecsv`` have the fields of the rows, units in the names or the header, four significant digits and
        empty cells for null; ``latex`` (a plain ``tabular``) and ``markdown`` have the cells of the terminal.
    title : str
    columns : sequence of Cells
    rows : sequence
        What `Cells.text` takes.
    """
    if form in ("latex", "markdown"):
        heads = [f"{column.label or column.header}{f' ({column.unit})' * bool(column.unit)}" for column in columns]
        cells = [[_MARKS.sub("", column.cell(row)) for column in columns] for row in rows]
        return (_latex if form == "latex" else _markdown)(
            visible(title, "\n"), heads, [column.right for column in columns], cells
        )
    fields: dict[str, str] = {}
    table: list[dict[str, Any]] = [{} for _ in rows]
    for column in columns:
        for name in column.fields or (None,):
            for line, row in zip(table, rows, strict=True):
                found = _values(column, name, row)
                line.update(found)
                for key in found:
                    fields.setdefault(key, "" if name is None else results.unit_of(name))
    text = results.csv_text(tuple(fields), table, joined=results.FLAG_SEPARATOR, digits=_DIGITS)
    return text if form == "csv" else _ecsv_header(title, fields, table) + text


def _values(column: Cells, name: str | None, row: Any) -> dict[str, Any]:
    """Return the cells of a row in a file by name: a field, three of what has errors, or the terminal's text."""
    if name is None:
        text = _MARKS.sub("", column.cell(row))
        return {re.sub(r"\W+", "_", column.header.casefold()).strip("_") or "text": text}
    value: Any = column.of(row)
    for part in name.split("."):
        value = getattr(value, part, None)
    name = name.replace(".", "_")
    if isinstance(value, results.Quantiles):
        return {f"{name}_low": value.low, name: value.median, f"{name}_high": value.high}
    return {name: value}


def _ecsv_header(title: str, fields: Mapping[str, str], table: Sequence[Mapping[str, Any]]) -> str:
    lines = ["%ECSV 1.0", "---", "delimiter: ','", "datatype:"]
    for name, unit in fields.items():
        kinds = {type(cells.get(name)) for cells in table} - {type(None)}
        number = "int64" if kinds <= {int, bool} else "float64" if kinds <= {int, bool, float} else "string"
        about = {"name": name} | ({"unit": unit} if unit else {}) | {"datatype": number if kinds else "string"}
        lines.append(f"- {json.dumps(about)}")
    lines += [f"meta: {json.dumps({'title': title})}", "schema: astropy-2.0"]
    return "".join(f"# {line}\n" for line in lines)


def _markdown(title: str, heads: Sequence[str], right: Sequence[bool], cells: Sequence[Sequence[str]]) -> str:
    def line(words: Sequence[str]) -> str:
        return f"| {' | '.join(word.replace('|', chr(92) + '|') for word in words)} |\n"

    rule = line(["---:" if side else "---" for side in right])
    return f"{title}\n\n{line(heads)}{rule}{''.join(map(line, cells))}"


def _latex(title: str, heads: Sequence[str], right: Sequence[bool], cells: Sequence[Sequence[str]]) -> str:
    def line(words: Sequence[str]) -> str:
        return " & ".join(map(latex_text, words)) + " \\\\\n"

    sides = "".join("r" if side else "l" for side in right)
    body = "".join(map(line, cells))
    about = " ".join(title.split())
    return f"% {about}\n\\begin{{tabular}}{{{sides}}}\n\\hline\n{line(heads)}\\hline\n{body}\\hline\n\\end{{tabular}}\n"


def latex_text(text: str) -> str:
    """Return a text for LaTeX: powers of ten, Greek letters and signs in mathematics, the rest escaped."""
    made = []
    for part in re.split(r"(\d\.?\d*e[-+]\d+)", text):
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


def ranking_csv(rank: results.RankResult) -> str:
    """Return the ranking as CSV: one line a target, header with units in the names, empty cells for null.

    Numbers keep full precision (shortest text that reads back to the same double); flags are joined with ``|``.
    """
    names = results.names_of(results.RankedTarget)
    return results.csv_text(names, map(results.values_of, rank.targets), joined=results.FLAG_SEPARATOR)


def ranking_ecsv(rank: results.RankResult) -> str:
    """Return the ranking as ECSV 1.0: units and descriptions of every column, and what the ranking is, in the header.

    Reads back with ``astropy.table.Table.read(..., format="ascii.ecsv")``; missing numbers are masked.
    """
    meta = rank.model_dump(mode="json", exclude={"targets"}) | {"flag_separator": results.FLAG_SEPARATOR}
    return results.ecsv_text(results.RankedTarget, rank.targets, meta, joined=results.FLAG_SEPARATOR)


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
