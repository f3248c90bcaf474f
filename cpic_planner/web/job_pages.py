"""Pages of jobs: the form that asks for images, how far a job is, and what it found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Route

from cpic_core import InputError, read_file
from cpic_planner import report
from cpic_planner.report import PANELS, Picture
from cpic_planner.results import StarImagesResult
from cpic_planner.web import pages
from cpic_planner.web.addresses import IMAGES, MOST_PARAMETERS, Pairs, form_fields, image_lines
from cpic_planner.web.forms import image_form
from cpic_planner.web.guard import Workers, line
from cpic_planner.web.job_queue import RESULT, FullError, JobAnswer, JobQueue, State, expected

DEAREST_S = 900.0
"""Longest expected processor time of a job."""
_TABLE = "measurements.csv"
_MEDIA = {".json": "application/json", ".csv": "text/csv; charset=utf-8", ".png": "image/png", ".svg": "image/svg+xml"}
_DRAWING_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
_MOST_BYTES = 50_000_000
_REFRESH_S = 5
_TITLE = "CPI-C images"
_ABOUT = (
    "Simulated images of one star with a reference planet where each band sees it best, measured as real ones would "
    "be. This takes minutes, so that it runs as a job: the address of the job is that of its result."
)
_SAID: Mapping[State, str] = {
    "waiting": "It waits.",
    "running": "It is worked on.",
    "done": "It is done.",
    "failed": "It failed; what went wrong is in the log of the server. Asked again it is tried again.",
    "late": "It took longer than jobs may here. In Python it has no limit of time.",
}
_NO_FILE = HTTPException(404, "The job has no such file, or is not done.")


class JobPages:
    """Pages of one queue.

    Parameters
    ----------
    queue : JobQueue
    workers : Workers
        Who prepares jobs.
    """

    def __init__(self, queue: JobQueue, workers: Workers) -> None:
        self._queue, self._workers = queue, workers

    def routes(self) -> list[Route]:
        """Return the addresses that are answered."""
        return [
            Route("/jobs", _form, methods=["GET"]),
            Route("/jobs", self._asked, methods=["POST"]),
            Route("/jobs/{id}", self._told, methods=["GET"]),
            Route("/jobs/{id}/cancel", self._cancelled, methods=["POST"]),
            Route("/jobs/{id}/{name}", self._file, methods=["GET"]),
        ]

    def _job(self, request: Request) -> JobAnswer:
        """Return the job of a request, which is looked up and never opened by its name."""
        found = self._queue.standing(request.path_params["id"])
        if found is None:
            raise HTTPException(404, "There is no such job: it was never asked for, was cancelled, or is long ago.")
        return found

    async def _asked(self, request: Request) -> Response:
        """Put a question into the queue, or refuse it as the calculator does."""
        given: list[tuple[str, str]] = []
        form = ""
        try:
            given = await _fields(request)
            form = next((text for name, text in given if name == "format"), "")
            form = "" if form == "html" else form
            pages.page_or_json(form)
            pairs = IMAGES.canonical((name, text) for name, text in given if name != "format")
            if sum(name == "target" for name, _ in pairs) != 1:
                raise InputError("target", "not one", allowed="one star")
            standing, token = await self._workers.do(self._ask, pairs)
        except InputError as error:
            return pages.refused(error, form, partial(_question_page, given, error))
        except FullError:
            text = f"{self._queue.waiting()} jobs wait, as many as may; ask again later."
            return line(text, 503, **{"Retry-After": "300"})
        if form == "json":
            told = standing.model_copy(update={"token": token or None})
            return pages.data(told, 200 if standing.state == "done" else 202)
        return RedirectResponse(f"/jobs/{standing.id}{f'?token={token}' * bool(token)}", 303)

    def _ask(self, pairs: Pairs) -> tuple[JobAnswer, str]:
        """Put a question into the queue; this runs in a thread of its own."""
        name, cost = expected(pairs)
        if cost["wall_s"] > DEAREST_S:
            about, hint = (
                f"about {cost['wall_s']:.0f}",
                "fewer realisations or bands; confirm_targets in Python has none",
            )
            raise InputError("realisations", about, unit="s", allowed=f"at most {DEAREST_S:g} s a job", hint=hint)
        token = self._queue.ask(name, pairs, cost_s=cost["wall_s"], tasks=int(cost["n_tasks"]))
        standing = self._queue.standing(name)
        assert standing is not None
        return standing, token

    async def _told(self, request: Request) -> Response:
        """Say how far a job is, or what it found."""
        standing = self._job(request)
        token = request.query_params.get("token", "")[:64]
        if pages.page_or_json(request.query_params.get("format", "")):
            return pages.data(standing)
        folder = self._queue.run_folder(standing.id)
        if folder is None:
            star = dict(standing.pairs).get("target", "")
            return pages.html(_progress_page(f"{star}: {_TITLE}", standing, token))
        body = await run_in_threadpool(_read, folder / RESULT)
        result = StarImagesResult.model_validate_json(body)
        return pages.html(_result_page(standing, result))

    async def _cancelled(self, request: Request) -> Response:
        """Withdraw an asker."""
        standing = self._job(request)
        try:
            token = dict(await _fields(request)).get("token", "")
        except InputError as error:
            return line(str(error), 400)
        if not self._queue.withdraw(standing.id, token[:64]):
            return line("Only who asked for a job, with its token and before it has ended, can cancel it.", 403)
        text = "It is cancelled for you; it goes on where others asked for it too."
        return pages.html(pages.plain_page(_TITLE, _ABOUT, "Cancelled", [report.Paragraph(text)]))

    async def _file(self, request: Request) -> Response:
        """Send one of the files that every job leaves, by its name among them."""
        name, folder = request.path_params["name"], self._queue.run_folder(self._job(request).id)
        images = [PANELS.format(band=band) for band in _bands()]
        known = {name: name for name in (RESULT, _TABLE, *images)} | {_drawing(name): name for name in images}
        if folder is None or name not in known:
            raise _NO_FILE
        body = await run_in_threadpool(_read, folder / known[name])
        headers, ending = {"Cache-Control": "private"}, name[name.rindex(".") :]
        if ending == ".svg":
            body, headers["Content-Security-Policy"] = report.in_both_lights(body), _DRAWING_POLICY
        return Response(body, media_type=_MEDIA[ending], headers=headers)


async def _form(request: Request) -> Response:
    given = [(name, text.strip()) for name, text in request.query_params.multi_items()][:MOST_PARAMETERS]
    return pages.html(_question_page(given))


def _question_page(given: Sequence[tuple[str, str]], error: InputError | None = None) -> str:
    return pages.page(_TITLE, _ABOUT, image_form(given, error))


async def _fields(request: Request) -> list[tuple[str, str]]:
    return form_fields(request.headers.get("content-type", ""), await request.body())


def _drawing(image: str) -> str:
    """Return the name of images of a band as a drawing that follows dark mode."""
    return image.removesuffix(".png") + ".svg"


def _bands() -> Sequence[str]:
    from simulator.config import load_instrument

    return tuple(load_instrument().bands)


def _read(path: Path) -> bytes:
    try:
        return read_file(path, key="job", allowed="a file of the job", max_bytes=_MOST_BYTES)
    except InputError:
        raise _NO_FILE from None


def _progress_page(title: str, standing: JobAnswer, token: str) -> str:
    """Return the page of a job without a result: while that may come it asks again by itself."""
    going = standing.state in ("waiting", "running")
    blocks: list[report.Block] = [report.Paragraph(_SAID[standing.state], "lead")]
    facts: list[tuple[Any, Any]] = [("Question", ", ".join(f"{name} {text}" for name, text in standing.pairs))]
    facts += [("Expected", f"{report.duration_text(standing.expected_s)} of processor time")]
    if standing.place:
        facts.append(("Place in the queue", str(standing.place)))
    if standing.state == "running":
        facts.append(("Finished", f"{standing.finished} of {standing.tasks} band{'s' * (standing.tasks != 1)}"))
    blocks.append(report.Facts(facts))
    more: dict[str, Any] = {}
    if going:
        note = f"This page asks again every {_REFRESH_S} s; it can be closed and come back to at /jobs/{standing.id}."
        blocks.append(report.Paragraph(note, "note"))
        more = {"refresh_s": _REFRESH_S, "share": (standing.finished, max(standing.tasks, 1))}
    if going and token:
        blocks.append(report.Paragraph("This address can cancel the job; the one in the note above cannot.", "note"))
        more["cancel"] = (f"/jobs/{standing.id}/cancel", token)
    return pages.plain_page(title, _ABOUT, "Job", blocks, **more)


def _result_page(standing: JobAnswer, result: StarImagesResult) -> str:
    (target,) = result.targets
    address, name = f"/jobs/{standing.id}", report.pretty_name(target.name)
    images = {}
    for band in target.bands:
        if band.image is not None:
            caption = f"{band.band}: summed science frames, summed reference frames, and the residual"
            picture = f"{address}/{_drawing(PANELS.format(band=band.band))}"
            images[band.image] = Picture(picture, f"{name} in {caption}.", f"{caption}.")
    blocks = [*report.star_blocks(target, images), report.Paragraph(report.calibration_sentence(result))]
    blocks += pages.elsewhere((), pages.cited(result), image_lines(standing.pairs))
    sources = [("JSON", f"{address}/{RESULT}"), ("CSV", f"{address}/{_TABLE}")]
    return pages.plain_page(f"{name}: {report.outcome_text(target.bands)}", _ABOUT, "Result", blocks, sources=sources)
