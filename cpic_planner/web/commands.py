"""Pages of the commands that are not run for visitors, with their expected cost."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from cpic_core import InputError
from cpic_planner import report
from cpic_planner.web import pages
from cpic_planner.web.guard import line
from cpic_planner.web.work import Workers

_TITLE = "Longer runs"
_ABOUT = "Plans, what-ifs and dark holes of other optics take minutes to hours: the command line makes them."
_HOLE_S = 15.0
"""Processor time in which the dark hole of a band is dug and measured: 51 s were measured for four of them."""


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


class Commands:
    """The page of long runs.

    Parameters
    ----------
    workers : Workers
        Who works the costs out.
    """

    def __init__(self, workers: Workers) -> None:
        self._workers = workers

    def routes(self) -> list[Route]:
        """Return the addresses that are answered."""
        return [Route("/commands", self._told)]

    async def _told(self, request: Request) -> Response:
        form = request.query_params.get("format", "")
        if form not in ("", "html", "json"):
            return line(str(InputError("format", form[:40], allowed="html or json")), 400)
        found = await self._workers.do(costs)
        if form == "json":
            return JSONResponse({command: dict(cost) for command, cost in found.items()})
        facts: list[tuple[Any, Any]] = [(report.code(command), _text(cost)) for command, cost in found.items()]
        note = "Each says what a run of your own would cost with --dry-run; --workers shares the work."
        blocks: list[report.Block] = [report.Facts(facts), report.Paragraph(note, "note")]
        text = pages.told_page(_TITLE, _ABOUT, "Commands and their expected cost", blocks)
        return Response(text, media_type="text/html; charset=utf-8")


def _text(cost: Mapping[str, float]) -> str:
    counts = [
        f"{count:g} {name.removeprefix('n_').replace('_', ' ')}" for name, count in cost.items() if name[:2] == "n_"
    ]
    sizes = [f"{cost[name]:.0f} MB of {name.removesuffix('_mb')}" for name in ("memory_mb", "disk_mb") if name in cost]
    return "; ".join([", ".join(counts), f"about {report.duration_text(cost['wall_s'])} with one worker", *sizes])
