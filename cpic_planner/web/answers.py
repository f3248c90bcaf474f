"""Answers to addresses, as data: JSON as the command line prints it, tables in other forms, figures as bytes."""

from __future__ import annotations

import base64
import contextlib
import functools
import hashlib
import json
import threading
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, cast

from pydantic import BaseModel

from catalogs import tables_read
from cpic_core import InputError, dump_json, only_sent_files
from cpic_planner import report
from cpic_planner.api import Answered, answered, prepared
from cpic_planner.results import RankResult
from cpic_planner.version import __version__
from cpic_planner.web.asking import ETC, RANK, Asking, Pairs, Q
from cpic_planner.web.sent import Sent, check_optics

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console

MEDIA = {
    "json": "application/json",
    "csv": "text/csv; charset=utf-8",
    "ecsv": "text/plain; charset=utf-8",
    "latex": "text/plain; charset=utf-8",
    "markdown": "text/plain; charset=utf-8",
}
"""Media type of each form of an answer beside the page."""
FigureForm: TypeAlias = Literal["svg", "png", "values"]
FIGURE_MEDIA: dict[FigureForm, str] = {"svg": "image/svg+xml", "png": "image/png", "values": "text/html; charset=utf-8"}
"""Media type of each form of a figure; its values are a page of tables."""
_PENCIL = threading.Lock()
"""Matplotlib's settings are those of the process: one figure is drawn at a time."""
_RANKER = threading.Lock()
DEFAULT_ROWS, MOST_ROWS = 50, 1500


class Problem(BaseModel):
    """An error in a question, for programs."""

    schema_version: Literal[1] = 1
    kind: Literal["error"] = "error"
    type: Literal["invalid_input"] = "invalid_input"
    parameter: str
    value: str
    unit: str
    allowed: str
    hint: str
    message: str

    @classmethod
    def of(cls, error: InputError) -> Problem:
        """Return the problem that a refusal states."""
        texts = {name: getattr(error, name) for name in ("unit", "allowed", "hint")}
        return cls(parameter=error.key, value=str(error.value)[:200], message=str(error), **texts)


def tag_of(kind: str, pairs: Pairs) -> str:
    """Return the tag of an answer: a hash of the question and of the version that answers it.

    Parameters
    ----------
    kind : str
        What the answer is: a figure, a form.
    pairs : sequence of (str, str)
    """
    text = dump_json({"version": __version__, "kind": kind, "asked": pairs})
    return f'"{hashlib.sha256(text.encode()).hexdigest()[:32]}"'


@functools.lru_cache(maxsize=128)
def etc_answer(pairs: Pairs) -> Answered:
    """Return the answer of the calculator to an address; the last ones are kept.

    Raises
    ------
    InputError
        For the first fault, naming the parameter.
    """
    return fresh_etc(pairs)


def fresh_etc(pairs: Pairs, sent: Sent | None = None) -> Answered:
    """Return the answer of the calculator with files that were sent, which are the only ones that are read.

    Raises
    ------
    InputError
        As `etc_answer`.
    """
    with _asked(ETC, pairs, sent) as question:
        return answered(question)


@contextlib.contextmanager
def _asked(asking: Asking[Q], pairs: Pairs, sent: Sent | None) -> Iterator[Q]:
    from cpic_planner.queries import called_as

    with only_sent_files({} if sent is None else sent.files), called_as(asking.names):
        question = asking.question(pairs)
        if sent is not None:
            check_optics(question, sent)
        with tables_read(strict=getattr(question, "strict", False), tell=lambda remark: None):  # the answer has them
            yield question


@functools.lru_cache(maxsize=16)
def ranking(pairs: Pairs) -> RankResult:
    """Return the ranking of an address; the last ones are kept, and filters choose from the kept ranking of all stars.

    Cuts (``v_mag_max``, ``dwarfs_only``, ``singles_only``) rank anew: they say which stars are ranked at all, so that
    the rank in the catalogue and the hash are others, and with another number of stars at once the last digits are.

    Raises
    ------
    InputError
        As `etc_answer`.
    """
    from cpic_planner.queries import FILTERS, called_as

    with called_as(RANK.names):
        ready = prepared(RANK.question(pairs))
        if ready.stars.chosen is None:
            return _whole_ranking(pairs)
        return ready.of_all(_whole_ranking(tuple(pair for pair in pairs if pair[0] not in FILTERS)))


@functools.lru_cache(maxsize=4)
def _kept_ranking(pairs: Pairs) -> RankResult:
    return prepared(RANK.question(pairs)).ranked()


def _whole_ranking(pairs: Pairs) -> RankResult:
    """Return the ranking of all stars; who asks while it is worked out waits for it."""
    with _RANKER:
        return _kept_ranking(pairs)


def form_text(form: str, result: BaseModel, tables: Callable[[Console], None]) -> str:
    """Return an answer in a form of `MEDIA`, to the byte as the command line prints it.

    Parameters
    ----------
    form : str
    result : BaseModel
    tables : callable
        Prints its tables on a console.
    """
    if form == "json":
        return dump_json(result.model_dump(mode="json"))
    from rich.console import Console

    sheet = report.Sheet(Console(width=110, highlight=False), form)
    tables(cast("Console", sheet))
    if sheet.taken is None:
        raise InputError("format", form, allowed="html or json: this answer has no table")
    return report.form_text(form, result, sheet.taken)


@functools.lru_cache(maxsize=64)
def etc_figure(pairs: Pairs, form: FigureForm) -> bytes:
    """Return the figure of an answer of the calculator; the last ones are kept.

    Parameters
    ----------
    pairs : sequence of (str, str)
    form : str
        As of `drawn`.
    """
    return drawn(etc_answer(pairs).figure, form)


@functools.lru_cache(maxsize=16)
def rank_figure(pairs: Pairs, limit: int, form: FigureForm) -> bytes:
    """Return the figure of a ranking; the last ones are kept.

    Parameters
    ----------
    pairs : sequence of (str, str)
    limit : int
        Stars that are drawn.
    form : str
        As of `drawn`.
    """
    result = ranking(pairs)
    return drawn(lambda: report.rank_figure(result, limit), form)


def drawn(figure: Callable[[], Figure], form: FigureForm) -> bytes:
    """Return a figure in a form, while no other is drawn.

    Parameters
    ----------
    figure : callable
    form : {"svg", "png", "values"}
        The last is the JSON of what it shows.
    """
    with _PENCIL, report.style():
        made = figure()
        return _panels(made).encode() if form == "values" else _image(made, form)


def _panels(made: Figure) -> str:
    return json.dumps(report.panels_of(made), separators=(",", ":"))


def _image(made: Figure, form: Literal["svg", "png"]) -> bytes:
    return base64.b64decode(report.save(made, form, alt="", caption="").uri.partition(",")[2])


def fresh_ranking(pairs: Pairs, sent: Sent | None = None) -> RankResult:
    """Return a ranking with files that were sent; as `fresh_etc`."""
    with _asked(RANK, pairs, sent) as question:
        return prepared(question).ranked()


def figure_inside(figure: Callable[[], Figure], alt: str, caption: str) -> list[report.Block]:
    """Return the figure of an answer with files that were sent, which has no address, and its values."""
    with _PENCIL, report.style():
        made = figure()
        panels, picture = _panels(made), report.save(made, "svg", alt=alt, caption=caption)
    values = report.Fold("Values of the figure", list(report.values_blocks(json.loads(panels))))
    return [report.Figure(picture, panels=panels), values]


def rows_of(given: Any) -> int:
    """Return the number of rows that are shown, from the text of the parameter ``limit``; `DEFAULT_ROWS` without.

    Raises
    ------
    InputError
        If it is no number from 1 to `MOST_ROWS`.
    """
    if given in (None, ""):
        return DEFAULT_ROWS
    if not (str(given).isascii() and str(given).isdecimal() and 1 <= int(str(given)[:6]) <= MOST_ROWS):
        raise InputError("limit", str(given)[:40], allowed=f"1 to {MOST_ROWS}")
    return int(given)
