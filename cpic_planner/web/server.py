"""The calculator and the ranking as pages and data: addresses, forms of answers, refusals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal, cast

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.routing import Route

from cpic_core import InputError
from cpic_planner import report
from cpic_planner.web import answers, forms, pages
from cpic_planner.web.asking import ETC, RANK, Asking, Pairs
from cpic_planner.web.guard import FAILED, line
from cpic_planner.web.work import Busy, Kept, Workers

MOST_PARAMETERS = 200
_OWN = ("format", "limit")
"""Parameters of an address that are no fields of the question."""
_SVG_POLICY = "default-src 'none'; style-src 'unsafe-inline'"
_ABOUT = {
    "etc": "Wall time for an SNR or a detection, SNR in a time, or the contrast limit, of one star or known planet. "
    "The address of an answer is its question: share it.",
    "rank": "Which stars promise most planets per hour of telescope time, among 1077 nearby ones.",
}
_TITLE = {"etc": "CPI-C exposure-time calculator", "rank": "CPI-C priorities"}


class Site:
    """Pages and data of one server.

    Parameters
    ----------
    workers : Workers
        Who computes.
    """

    def __init__(self, workers: Workers) -> None:
        self._workers = workers
        self._kept: Kept[tuple[Any, ...]] = Kept()

    def routes(self) -> list[Route]:
        """Return the addresses that are answered."""
        found = [Route("/", lambda _: RedirectResponse(ETC.page, 307)), Route("/style.css", _style)]
        for asking in (ETC, RANK):
            found.append(Route(asking.page, partial(self._asked, asking)))
            found += [Route(f"{asking.page}.{form}", partial(self._figure, asking, form)) for form in ("svg", "png")]
        return found

    async def _asked(self, asking: Asking[Any], request: Request) -> Response:
        """Answer a question as a page or as data; without parameters the page of the calculator is its form."""
        given = _parameters(request)
        form, rest = _own(given, "format"), [(name, text) for name, text in given if name not in _OWN]
        limit = _own(given, "limit") if asking is RANK else ""
        try:
            _check_own(given, asking)
            pairs, shown = asking.canonical(rest), {"limit": limit} if limit else {}
            rows = answers.rows_of(limit)
            if form not in ("", "html", *answers.MEDIA):
                raise InputError("format", form[:40], allowed=f"html, {', '.join(answers.MEDIA)}")
            if form in ("", "html") and any(not text for _, text in given):
                return RedirectResponse(asking.address(pairs, **shown), 303)
            if not given and asking is ETC:
                return _page(pages.page(_TITLE["etc"], _ABOUT["etc"], forms.etc_form(())))
            key = (asking.page, pairs, rows, form, bool(shown))
            kept = self._kept.get(key)
            if kept is None:
                made = await self._workers.do(_answer, asking, pairs, rows, form, shown)
                kept = bytes(made.body), str(made.media_type)
                self._kept.put(key, *kept)
            return Response(kept[0], media_type=kept[1])
        except InputError as error:
            return _refused(asking, given, error, form)

    async def _figure(self, asking: Asking[Any], form: Literal["svg", "png"], request: Request) -> Response:
        """Draw an answer, unless the asker has its figure already."""
        given = _parameters(request)
        try:
            _check_own(given, asking)
            if _own(given, "format"):
                raise InputError("format", _own(given, "format")[:40], allowed="without it: this is a figure")
            pairs = asking.canonical((name, text) for name, text in given if name not in _OWN)
            limit = min(answers.rows_of(_own(given, "limit")), report.MOST_STARS)
            tag = answers.tag_of(f"{asking.page}.{form} {limit}", pairs)
            headers = {"ETag": tag, "Cache-Control": "private, max-age=86400", "Content-Security-Policy": _SVG_POLICY}
            if tag in request.headers.get("if-none-match", ""):
                return Response(status_code=304, headers=headers)
            draw: Callable[..., bytes] = answers.etc_figure
            more: tuple[Any, ...] = (form,)
            if asking is RANK:
                draw, more = answers.rank_figure, (limit, form)
            drawn = await self._workers.do(draw, pairs, *more)
        except InputError as error:
            return line(str(error), 400)
        return Response(drawn, media_type="image/svg+xml" if form == "svg" else "image/png", headers=headers)


def _parameters(request: Request) -> list[tuple[str, str]]:
    return [(name, text.strip()) for name, text in request.query_params.multi_items()]


def _own(given: Sequence[tuple[str, str]], name: str) -> str:
    return next((text for key, text in given if key == name), "")


def _check_own(given: Sequence[tuple[str, str]], asking: Asking[Any]) -> None:
    """Refuse too many parameters, and those that are given twice or to no end."""
    if len(given) > MOST_PARAMETERS:
        raise InputError("parameters", len(given), allowed=f"at most {MOST_PARAMETERS}")
    for name in _OWN:
        times = sum(key == name for key, _ in given)
        if times > 1 or (times and name == "limit" and asking is ETC):
            raise InputError(name, "given", allowed="once" if asking is RANK else "with the ranking only")


def _answer(asking: Asking[Any], pairs: Pairs, rows: int, form: str, shown: dict[str, str]) -> Response:
    """Compute an answer and write it; this runs in a thread of its own."""
    result: Any
    if asking is ETC:
        answer = answers.etc_answer(pairs)
        result, tables = answer.result, answer.print
    else:
        result = answers.ranking(pairs)
        tables = cast(Any, partial(report.print_rank, result, limit=rows))
    if form not in ("", "html"):
        return Response(answers.form_text(form, result, tables), media_type=answers.MEDIA[form])
    sources = pages.sources_of(asking, pairs, **shown)
    if asking is ETC:
        title = f"{report.pretty_name(result.target)}: {_TITLE['etc']}"
        return _page(pages.page(title, _ABOUT["etc"], forms.etc_form(pairs), pages.etc_blocks(pairs), sources))
    form_of = forms.rank_form([*pairs, *shown.items()])
    return _page(pages.page(_TITLE["rank"], _ABOUT["rank"], form_of, pages.rank_blocks(pairs, rows), sources))


def _page(text: str, status: int = 200) -> Response:
    return Response(text, status, media_type="text/html; charset=utf-8")


def _refused(asking: Asking[Any], given: Sequence[tuple[str, str]], error: InputError, form: str) -> Response:
    """Answer bad input: the form with one line at the field, JSON with its parts, or one line."""
    if form == "json":
        return JSONResponse(answers.Problem.of(error).model_dump(mode="json"), 400)
    if form not in ("", "html"):
        return line(str(error), 400)
    made = forms.etc_form if asking is ETC else forms.rank_form
    return _page(pages.page(_TITLE[asking.command], _ABOUT[asking.command], made(given, error)), 400)


async def _style(request: Request) -> Response:
    return Response(pages.style_sheet(), media_type="text/css", headers={"Cache-Control": "private, max-age=3600"})


async def _missing(request: Request, error: Exception) -> Response:
    status = error.status_code if isinstance(error, HTTPException) else 404
    return line("There is no such page; /etc and /priorities are the pages.", status)


async def _busy(request: Request, error: Exception) -> Response:
    return line("Too many questions wait for an answer; ask again in a moment.", 503, **{"Retry-After": "5"})


async def _late(request: Request, error: Exception) -> Response:
    return line("The answer takes too long here; the command line has no limit of time.", 504)


async def _failed(request: Request, error: Exception) -> Response:
    return line(FAILED, 500)


HANDLERS: dict[Any, Any] = {HTTPException: _missing, Busy: _busy, TimeoutError: _late, Exception: _failed}
"""What answers instead where something is raised."""
