"""A page that says what the columns of a table that is sent are taken for, in the words of ``cpic catalog columns``."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from catalogs import taken_for
from cpic_core import InputError
from cpic_planner import report
from cpic_planner.results import ColumnsResult
from cpic_planner.web.asking import Pairs
from cpic_planner.web.blocks import blocks_of
from cpic_planner.web.forms import Field, Form, Group
from cpic_planner.web.sent import Sent
from cpic_planner.web.star import View

PAGE = "/columns"
_KINDS = ("stars", "planets")
_TABLE, _KIND = "table", "as"
_ABOUT = {
    _TABLE: ("Table, at most 2 MB", "Stars or planets, in any format that tables are read in. It is not kept."),
    _KIND: ("Taken as", "A table of stars or of planets; by default each kind that it can be."),
}


def columns_form(given: Sequence[tuple[str, str]], error: InputError | None = None) -> Form:
    """Return the form that takes a table; parameters as of `cpic_planner.web.forms.etc_form`."""
    values, key = dict(given), "" if error is None else error.key
    wrong = {_KIND: str(error)} if key == _KIND else {_TABLE: str(error)} if error is not None else {}
    chosen = (values[_KIND],) if values.get(_KIND) else ()
    fields = (
        Field(_TABLE, *_ABOUT[_TABLE], "file", (), (), wrong.get(_TABLE, ""), ""),
        Field(_KIND, *_ABOUT[_KIND], "choice", _KINDS, chosen, wrong.get(_KIND, ""), ""),
    )
    return Form(PAGE, (Group("A table of your own", fields),), "Show its columns", method="post")


def columns_pairs(given: Sequence[tuple[str, str]]) -> Pairs:
    """Return the parameters in order, without empty ones.

    Raises
    ------
    InputError
        For an unknown parameter, one that is given twice, or another kind of table.
    """
    for name, text in given:
        if name not in _ABOUT:
            raise InputError(name[:40], "given", allowed=", ".join(_ABOUT))
        if name == _KIND and text not in ("", *_KINDS):
            raise InputError(_KIND, text[:40], allowed=" or ".join(_KINDS))
        if sum(key == name for key, _ in given) > 1:
            raise InputError(name, "given twice", allowed="once")
    values = {name: text for name, text in given if text}
    return tuple((name, values[name]) for name in _ABOUT if name in values)


def columns_result(pairs: Pairs, sent: Sent | None = None) -> ColumnsResult:
    """Return what the columns of a table that was sent are taken for.

    Parameters
    ----------
    pairs : sequence of (str, str)
        As `columns_pairs` makes them.
    sent : Sent, optional
        The file.

    Raises
    ------
    InputError
        If there is none, or it is no table of the kind.
    """
    given: dict[str, Any] = dict(pairs)
    if sent is None or given.get(_TABLE) not in sent.files:
        raise InputError(_TABLE, "missing", allowed="a file that is sent with the form")
    return ColumnsResult.of_files(taken_for(given[_TABLE], given.get(_KIND)))


def columns_blocks(pairs: Pairs, sent: Sent | None = None) -> list[report.Block]:
    """Return what `columns_result` says as blocks of a page; parameters as there."""
    result = columns_result(pairs, sent)
    kind = f" --as {dict(pairs)[_KIND]}" if _KIND in dict(pairs) else ""
    same = [("Command", report.code(f"cpic catalog columns {result.file}{kind}"))]
    found = blocks_of(partial(report.print_columns, result))
    return [*found, report.Heading("The same elsewhere"), report.Facts(same)]


COLUMNS = View(
    PAGE,
    "Columns of a table",
    "What the columns of a table of your own are taken for, and which of its rows can be used.",
    columns_pairs,
    columns_form,
    columns_blocks,
    columns_result,
    lambda pairs: f"Columns of {dict(pairs).get(_TABLE, 'a table')}",
    takes_files=True,
)
"""The page of the columns of a table."""
