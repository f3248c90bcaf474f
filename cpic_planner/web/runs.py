"""Plans, what-ifs, confirmations and rankings in a folder, found by their own marks and shown as they were written.

A request names a run by its hash and a file by one of the names in `FILES`; both are looked up, neither is a path.
Commands that are not run for visitors are shown with their expected cost.
"""

from __future__ import annotations

import functools
import os
import re
import time
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, PrivateAttr
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from cpic_core import InputError, digest_of, parse_json, read_file, read_text
from cpic_planner import report
from cpic_planner.jobs import LIST_NAME
from cpic_planner.web import pages
from cpic_planner.web.guard import Workers, line

FILES = {
    "report.html": "text/html; charset=utf-8",
    **dict.fromkeys(
        ("ranking.csv", "measurements.csv", "astrometry.csv", "contrast_curve.csv"), "text/csv; charset=utf-8"
    ),
    **dict.fromkeys(("targets.csv", "visits.csv"), "text/csv; charset=utf-8"),
    **dict.fromkeys(("ranking.ecsv", "visits.ecsv", "astrometry.ecsv", "limits.ecsv"), "text/plain; charset=utf-8"),
    **dict.fromkeys(("photometry.ecsv", "band_covariance.ecsv", "passbands.ecsv"), "text/plain; charset=utf-8"),
    **dict.fromkeys(("plan.json", "confirm.json", "whatif.json", "rank.json"), "application/json"),
    **dict.fromkeys(("sensitivity.json", "known.json", "visits.json"), "application/json"),
}
"""Files that are shown, where a run has them, with their media types; `run.json` tells of the machine and is not."""
DEEPEST, MOST_RUNS, MOST_FOLDERS, MOST_BYTES = 4, 500, 5_000, 100_000_000
FRESH_S = 2.0
"""Time for which a look at the folder counts."""
_KINDS = {"plan": "plan", "whatif": "what-if", "confirm": "confirmation", "rank": "ranking"}
_TITLE = "Plans and what-ifs"
_ABOUT = "Runs that this server was told to show, as they were written."
_LONGER = "Longer runs"
_ABOUT_LONGER = "Plans, what-ifs and dark holes of other optics take minutes to hours: the command line makes them."
_HOLE_S = 15.0
"""Processor time in which the dark hole of a band is dug and measured: 51 s were measured for four of them."""
_REPORT_POLICY = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:"
"""A report is one file with its style and images inside, and runs nothing."""


class RunAnswer(BaseModel):
    """One run, for programs; files are addresses."""

    id: str
    """Hash of the run; a number follows where several folders hold the same."""
    title: str
    """Name of its folder, or of its file."""
    kind: Literal["plan", "whatif", "confirm", "rank"]
    state: Literal["finished", "running", "not finished"]
    date_utc: str
    """Date of its end, empty where it has none."""
    config_hash: str
    files: list[str]
    _paths: Mapping[str, Path] = PrivateAttr(default_factory=dict)
    _digests: Mapping[str, set[str]] = PrivateAttr(default_factory=dict)

    def named(self, name: str) -> RunAnswer:
        """Return the run under a hash, with the addresses of its files."""
        return self.model_copy(update={"id": name, "files": [f"/runs/{name}/{file}" for file in self._paths]})

    def read(self, name: str) -> bytes:
        """Return a file as it was written.

        Raises
        ------
        InputError
            If it is not there, or is no more what the run wrote.
        """
        changed = InputError("file", name, allowed="a file as the run wrote it")
        if name not in self._paths:
            raise changed
        path = self._paths[name]
        if path.is_symlink() or (name in self._digests and digest_of(path) not in self._digests[name]):
            raise changed
        try:
            return read_file(path, key="file", allowed="a file of the run", max_bytes=MOST_BYTES)
        except InputError:
            raise changed from None


class RunsAnswer(BaseModel):
    """All runs, for programs."""

    schema_version: Literal[1] = 1
    kind: Literal["runs"] = "runs"
    runs: list[RunAnswer]


def _run(paths: Mapping[str, Path], digests: Mapping[str, set[str]], **told: Any) -> RunAnswer:
    """Return a run with its files by the names of `FILES`, and the hashes of what was written where there are any."""
    run = RunAnswer(id="", files=[], **told)
    run._paths, run._digests = paths, digests
    return run


def runs_of(folder: Path) -> list[RunAnswer]:
    """Return the runs beneath a folder, the latest first; links are not followed."""
    found = []
    for place in _folders(folder):
        if (place / LIST_NAME).is_file():
            found.append(_run_of(place))
        else:
            found += [_ranking_of(path) for path in sorted(place.glob("*.json"))]
        if len(found) > 2 * MOST_RUNS:
            break
    runs: dict[str, RunAnswer] = {}
    for run in sorted(filter(None, found), key=lambda run: (run.date_utc, run.title), reverse=True)[:MOST_RUNS]:
        name, number = run.config_hash, 2
        while name in runs:
            name, number = f"{run.config_hash}-{number}", number + 1
        runs[name] = run.named(name)
    return list(runs.values())


def _folders(folder: Path) -> Iterator[Path]:
    """Yield the folder and those beneath it; what a run made inside its own is left out."""
    left, seen = [(folder, 0)], 0
    while left and seen < MOST_FOLDERS:
        place, depth = left.pop(0)
        seen += 1
        yield place
        if depth < DEEPEST and not (place / LIST_NAME).is_file():
            try:
                below = [path for path in sorted(place.iterdir()) if path.is_dir() and not path.is_symlink()]
            except OSError:
                continue
            left += [(path, depth + 1) for path in below if not path.name.startswith(".")]


def _run_of(place: Path) -> RunAnswer | None:
    """Return the run of a folder; None for one of another kind, or a damaged list."""
    try:
        lines = _text(place / LIST_NAME).splitlines()
        head = parse_json(lines[0])
        kind, config_hash = str(head["kind"]), str(head["config_hash"])
        listed = [parse_json(text) for text in lines[1:] if text.startswith('{"file"') and text.endswith("}")]
        digests: dict[str, set[str]] = {}
        for entry in listed:
            digests.setdefault(str(entry["file"]), set()).add(str(entry["sha256"]))
    except (InputError, ValueError, KeyError, TypeError, IndexError):
        return None
    if kind not in _KINDS or not config_hash.isalnum():
        return None
    places = {name.removeprefix(report.EXPORT): name for name in digests if (place / name).is_file()}
    files = {name: place / places[name] for name in FILES if name in places}
    date_utc, whole_hash = _ended(place / "run.json") if "run.json" in digests else ("", "")
    config_hash = whole_hash if whole_hash.isalnum() else config_hash
    state = "finished" if date_utc and f"{kind}.json" in files else "running" if _is_held(place) else "not finished"
    told = {"title": place.name, "kind": kind, "state": state, "date_utc": date_utc, "config_hash": config_hash}
    return _run(files, {name: digests[places[name]] for name in files}, **told)


def _ranking_of(path: Path) -> RunAnswer | None:
    """Return the ranking of a file that ``cpic rank --out`` wrote; None for any other file."""
    try:
        beginning = "" if path.is_symlink() else _beginning(path)
        date_utc = datetime.fromtimestamp(path.stat().st_mtime, UTC).isoformat(timespec="seconds")
    except (InputError, OSError):
        return None
    named = re.search(r'"config_hash": "([0-9a-f]+)"', beginning)
    if named is None or '"kind": "rank"' not in beginning:
        return None
    told = {"title": path.stem, "kind": "rank", "state": "finished", "date_utc": date_utc, "config_hash": named[1]}
    return _run({"rank.json": path}, {}, **told)


def _text(path: Path) -> str:
    return read_text(path, key="--folder", allowed="a file of a run", max_bytes=MOST_BYTES)


def _beginning(path: Path) -> str:
    from cpic_core.files import open_file

    with open_file(path, key="--folder", allowed="a file of a run", max_bytes=MOST_BYTES) as file:
        return file.read(1000).decode("utf-8", "replace")


def _ended(path: Path) -> tuple[str, str]:
    """Return when a run ended, and the hash of its configuration; nothing of one whose record cannot be read."""
    try:
        record = parse_json(_text(path))
        return str(record["finished_utc"])[:25], str(record.get("config_hash", ""))
    except (InputError, ValueError, KeyError, TypeError, AttributeError):
        return "", ""


def _is_held(place: Path) -> bool:
    """Return whether a living process says that it works there."""
    try:
        pid = int(_text(place / "run.lock").removeprefix("in use by pid ").partition(",")[0])
        os.kill(pid, 0)
    except (InputError, ValueError, ProcessLookupError):
        return False
    except OSError:
        return True
    return True


class RunPages:
    """Pages of the runs of one folder.

    Parameters
    ----------
    folder : Path or None
        None where none is shown.
    """

    def __init__(self, folder: Path | None) -> None:
        if folder is not None and not folder.is_dir():
            raise InputError("--folder", str(folder), allowed="a folder that is there")
        self._folder, self._found, self._until_s = folder, list[RunAnswer](), 0.0

    def routes(self) -> list[Route]:
        """Return the addresses that are answered."""
        return [Route("/runs", self._listed), Route("/runs/{id}", self._one), Route("/runs/{id}/{name}", self._file)]

    async def _runs(self) -> list[RunAnswer]:
        """Return the runs, looked for again after `FRESH_S`."""
        if self._folder is not None and time.monotonic() > self._until_s:
            self._found = await run_in_threadpool(runs_of, self._folder)
            self._until_s = time.monotonic() + FRESH_S
        return self._found

    async def _run(self, request: Request) -> RunAnswer:
        """Return the run of a request, which is looked up and never opened by its name."""
        found = next((run for run in await self._runs() if run.id == request.path_params["id"]), None)
        if found is None:
            raise HTTPException(404, "There is no such run.")
        return found

    async def _listed(self, request: Request) -> Response:
        runs = await self._runs()
        if pages.page_or_json(request.query_params.get("format", "")):
            return pages.data(RunsAnswer(runs=runs))
        if self._folder is None:
            text = "This server shows no folder; cpic serve --folder DIR shows the plans and what-ifs beneath one."
            blocks: list[report.Block] = [report.Paragraph(text)]
        elif not runs:
            blocks = [report.Paragraph("There are no plans, what-ifs or rankings in the folder yet.")]
        else:
            blocks = [report.Table("Runs, the latest first", _COLUMNS, runs)]
        return pages.html(pages.plain_page(_TITLE, _ABOUT, "Runs", blocks))

    async def _one(self, request: Request) -> Response:
        run = await self._run(request)
        if pages.page_or_json(request.query_params.get("format", "")):
            return pages.data(run)
        facts: list[tuple[Any, Any]] = [("Kind", _KINDS[run.kind]), ("State", run.state)]
        facts += [("Ended", run.date_utc)] if run.date_utc else []
        facts.append(("Configuration", report.code(run.config_hash)))
        links = [report.page_link(address, address.rpartition("/")[2]) for address in run.files]
        blocks: list[report.Block] = [report.Facts(facts), report.Items(links)]
        return pages.html(pages.plain_page(f"{run.title}: {_KINDS[run.kind]}", _ABOUT, "Files", blocks))

    async def _file(self, request: Request) -> Response:
        name, run = request.path_params["name"], await self._run(request)
        try:
            body = await run_in_threadpool(run.read, name)
        except InputError as error:
            return line(str(error), 404)
        policy = {"Content-Security-Policy": _REPORT_POLICY} if name.endswith(".html") else {}
        return Response(body, media_type=FILES[name], headers={"Cache-Control": "private, no-cache"} | policy)


_COLUMNS = [
    report.own_column("title", lambda run: report.page_link(f"/runs/{run.id}", run.title), look="left"),
    report.own_column("kind", lambda run: _KINDS[run.kind], look="left"),
    report.own_column("state", "{state}", look="left"),
    report.own_column("ended (UTC)", lambda run: run.date_utc[:19].replace("T", " "), look="left"),
    report.own_column("hash", lambda run: report.code(run.config_hash), look="left"),
]


@functools.lru_cache(maxsize=1)
def costs() -> dict[str, Mapping[str, float]]:
    """Return commands with their expected cost: counts, ``wall_s``, ``memory_mb``, ``disk_mb``, with one worker."""
    from cpic_planner.confirm import plan_job
    from cpic_planner.jobs import estimate
    from cpic_planner.queries import PlanQuestion, WhatIfQuestion
    from cpic_planner.survey import load_strategies, whatif_job, with_universe
    from simulator.config import load_instrument

    plan, whatif = PlanQuestion.of({}), WhatIfQuestion.of({"strategies": "survey_default"})
    config = with_universe(load_strategies("survey_default"), whatif.universe(), whatif.share_of_time)
    dug = {"n_bands": len(load_instrument().visible_bands())}
    return {
        f"cpic plan --top {plan.top}": estimate(plan_job(plan)),
        "cpic whatif survey_default": estimate(whatif_job(config, n_images=whatif.images)),
        'cpic etc "tau Cet" --set wavefront.opd_rms_nm=25': dug | {"wall_s": dug["n_bands"] * _HOLE_S},
    }


async def commands(workers: Workers, request: Request) -> Response:
    """Answer with the commands of longer runs, whose costs are worked out by ``workers``."""
    as_data = pages.page_or_json(request.query_params.get("format", ""))
    found = await workers.do(costs)
    if as_data:
        return JSONResponse({command: dict(cost) for command, cost in found.items()})
    facts: list[tuple[Any, Any]] = [(report.code(command), _cost_text(cost)) for command, cost in found.items()]
    note = "Each says what a run of your own would cost with --dry-run; --workers shares the work."
    blocks: list[report.Block] = [report.Facts(facts), report.Paragraph(note, "note")]
    return pages.html(pages.plain_page(_LONGER, _ABOUT_LONGER, "Commands and their expected cost", blocks))


def _cost_text(cost: Mapping[str, float]) -> str:
    counts = [
        f"{count:g} {name.removeprefix('n_').replace('_', ' ')}" for name, count in cost.items() if name[:2] == "n_"
    ]
    sizes = [f"{cost[name]:.0f} MB of {name.removesuffix('_mb')}" for name in ("memory_mb", "disk_mb") if name in cost]
    return "; ".join([", ".join(counts), f"about {report.duration_text(cost['wall_s'])} with one worker", *sizes])
