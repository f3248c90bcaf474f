"""The OpenAPI document of all addresses; ``python -m tools.schemas`` makes it from questions, forms and results."""

import functools
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from cpic_core import parse_json
from cpic_planner.schemas import openapi_text
from cpic_planner.version import __version__


@functools.cache
def described() -> dict[str, Any]:
    """Return the document as shipped, with the version of the package."""
    tree: dict[str, Any] = parse_json(openapi_text())
    return tree | {"info": tree["info"] | {"version": __version__}}


async def openapi(request: Request) -> Response:
    """Send the document."""
    return JSONResponse(described(), headers={"Cache-Control": "private, max-age=3600"})
