"""The OpenAPI document that is shipped: parameters are the options of the questions, answers the schemas of results."""

from __future__ import annotations

import functools
import pkgutil
from collections.abc import Sequence
from typing import Any, Literal, get_args, get_origin

from pydantic.json_schema import models_json_schema

from cpic_planner.queries import Option, Question, spelled
from cpic_planner.schemas import RESULTS
from cpic_planner.web.addresses import ETC, FILE_FIELDS, IMAGES, MOST_VALUES, RANK, Addresses, parameter
from cpic_planner.web.answers import COMPARE, ETC_PAGE, PAGES, RANK_PAGE
from cpic_planner.web.forms import Field
from cpic_planner.web.job_queue import JobAnswer
from cpic_planner.web.pages import FIGURE_MEDIA, MEDIA, FigureForm, Page, Problem
from cpic_planner.web.runs import RunAnswer, RunsAnswer

_TYPES = {int: "integer", float: "number", bool: "boolean"}
_WITHIN = ("minimum", "exclusiveMinimum", "maximum", "exclusiveMaximum")
_FORM = "application/x-www-form-urlencoded"
_DRAWN: dict[FigureForm, str] = {
    "svg": "The figure of the answer.",
    "png": "The figure of the answer, as pixels.",
    "values": "What the figure of the answer shows, in tables.",
}


def described() -> dict[str, Any]:
    """Return the OpenAPI 3.1 document of all addresses, without the version of the package."""
    models: list[Any] = [page.result for page in PAGES]
    models += [pkgutil.resolve_name(RESULTS["star_images"]), Problem, JobAnswer, RunsAnswer, RunAnswer]
    where, schemas = models_json_schema(
        [(model, "serialization") for model in models], ref_template="#/components/schemas/{model}"
    )
    of = {model.__name__: where[(model, "serialization")] for model in models}
    paths: dict[str, Any] = {}
    for page in PAGES:
        paths |= _of_page(page, of)
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "CPI-C planner",
            "description": "Exposure times, priorities and simulated images for CPI-C, the coronagraph of CSST. An "
            "address is its question, with the fields of the question as parameters.",
            "license": {"name": "BSD-3-Clause AND ODbL-1.0", "identifier": "BSD-3-Clause AND ODbL-1.0"},
        },
        "paths": paths | _jobs(of) | _runs(of),
        "components": {"schemas": schemas["$defs"]},
    }


_TEXT: dict[str, Any] = {"schema": {"type": "string"}}
_SENT = {"description": "Names of the files with the sha256 of their content.", "schema": {"type": "string"}}


def _of_page(page: Page, of: dict[str, Any]) -> dict[str, Any]:
    """Return the addresses of a page: its answer, with files or without, and its figures."""
    fields = _fields(page)
    said = {form: MEDIA[form].partition(";")[0] for form in page.media}
    form = _plain("format", "Form of the answer; a page without.", {"type": "string", "enum": ["html", *said]})
    content = {"text/html": _TEXT, **dict.fromkeys(sorted(set(said.values())), _TEXT)}
    content["application/json"] = {"schema": of[page.result.__name__]}
    about = {ETC_PAGE: ETC.model.__doc__, RANK_PAGE: RANK.model.__doc__}.get(page, page.about)
    answer = _get(about, [*fields, form], content, of["Problem"])
    paths = {page.path: answer | (_with_files(answer["get"]) if page.takes_files else {})}
    for name in page.figures:
        for ending, media in FIGURE_MEDIA.items():
            paths[page.drawing(name, ending)] = _get(_DRAWN[ending], fields, {media: {}}, None)
    return paths


def _fields(page: Page) -> list[dict[str, Any]]:
    """Return the parameters of a page: the options of its question, and the fields of its form that are none."""
    kinds: dict[Page, Addresses[Any]] = {ETC_PAGE: ETC, RANK_PAGE: RANK, COMPARE: ETC}
    addresses = kinds.get(page)
    options = [] if addresses is None else [_parameter(addresses, option) for option in _offered(addresses)]
    if page is COMPARE:
        options = [option | {"required": False} for option in options]
    names = {option["name"] for option in options}
    shown = [field for group in page.form((), None).groups for field in group.fields if field.name not in names]
    return [*options, *map(_field, shown)]


def _field(field: Field) -> dict[str, Any]:
    """Return a field of a form as a parameter of an address."""
    schema: dict[str, Any] = {"type": "string"} | ({"enum": list(field.choices)} if field.choices else {})
    if field.name == "limit":
        schema = {"type": "integer", "minimum": 1}
    return _plain(field.name, field.hint or field.label, schema)


def _with_files(asked: dict[str, Any]) -> dict[str, Any]:
    """Return the same question with files: the parameters are parts of a form, some of which may be files."""
    fields: dict[str, Any] = {}
    for item in asked["parameters"]:
        fields[item["name"]] = item["schema"] | {"description": item["description"]}
        if item["name"] in FILE_FIELDS:
            one: dict[str, Any] = {"oneOf": [item["schema"], {"type": "string", "format": "binary"}]}
            fields[item["name"]] = one | {"description": f"{item['description']} Or a file."}
    schema = {"type": "object", "properties": fields}
    body = {"required": True, "content": {"multipart/form-data": {"schema": schema}, _FORM: {"schema": schema}}}
    found = asked["responses"]["200"] | {"headers": {"Cpic-Files": _SENT}}
    rest = {"parameters": [], "requestBody": body, "responses": asked["responses"] | {"200": found}}
    return {"post": asked | rest | {"summary": f"{asked['summary']} Files may come with it, and are not kept."}}


def _offered(addresses: Addresses[Any]) -> Sequence[Option]:
    return [option for option in addresses.options if option.flag not in addresses.left_out]


def _plain(name: str, text: str, schema: dict[str, Any]) -> dict[str, Any]:
    return {"name": name, "in": "query", "description": text, "schema": schema}


_FORMS = _plain("format", "Form of the answer; a page without.", {"type": "string", "enum": ["html", "json"]})


def _is_required(option: Option) -> bool:
    """Return whether every question has it: what a part of a question needs is asked for with that part alone."""
    return option.required and len(option.path) == 1


def _parameter(addresses: Addresses[Any], option: Option) -> dict[str, Any]:
    """Return a parameter of an address, which may be repeated where the field takes several values."""
    made = _plain(parameter(option), spelled(option.text), _schema(addresses, option)) | {
        "required": _is_required(option)
    }
    return made | {"style": "form", "explode": True} if option.several else made


def _schema(addresses: Addresses[Any], option: Option) -> dict[str, Any]:
    one: dict[str, Any] = {"type": _TYPES.get(option.kind, "string")} | _limits(addresses.model, option.path)
    if get_origin(option.kind) is Literal:
        one["enum"] = list(get_args(option.kind))
    if option.several:
        return {"type": "array", "items": one, "maxItems": MOST_VALUES}
    return one


def _limits(model: type[Question], path: Sequence[str]) -> dict[str, Any]:
    """Return the range of a number of a question; nothing for what is made of several options."""
    node: Any = (whole := _schema_of(model))
    for name in path:
        node = next(
            (part["properties"][name] for part in _parts(whole, node) if name in part.get("properties", {})), {}
        )
    return {word: part[word] for part in _parts(whole, node) for word in _WITHIN if word in part}


@functools.cache
def _schema_of(model: type[Question]) -> dict[str, Any]:
    return model.model_json_schema()


def _parts(whole: dict[str, Any], node: dict[str, Any]) -> list[dict[str, Any]]:
    """Return a schema, or those that it stands for."""
    if "$ref" in node:
        return _parts(whole, whole["$defs"][node["$ref"].rpartition("/")[2]])
    return [part for one in node["anyOf"] for part in _parts(whole, one)] if "anyOf" in node else [node]


def _get(text: str | None, parameters: Sequence[Any], content: dict[str, Any], problem: Any) -> dict[str, Any]:
    bad: dict[str, Any] = {"text/plain": _TEXT} | ({"application/json": {"schema": problem}} if problem else {})
    responses = {"200": {"description": "The answer.", "content": content}}
    return {"get": {"summary": _first(text), "parameters": list(parameters), "responses": responses | _refusals(bad)}}


def _first(text: str | None) -> str:
    return (text or "").strip().partition("\n")[0]


def _refusals(bad: dict[str, Any]) -> dict[str, Any]:
    late = {"text/plain": _TEXT}
    return {
        "400": {"description": "What is wrong with the question, in one line.", "content": bad},
        "503": {"description": "Too many wait.", "content": late},
        "504": {"description": "The answer takes too long here.", "content": late},
    }


def _runs(of: dict[str, Any]) -> dict[str, Any]:
    """Return the addresses of runs, and of commands that are not run for visitors."""
    cost = {"type": "object", "additionalProperties": {"type": "number"}}
    costs = {"type": "object", "additionalProperties": cost}
    told = {
        "/runs": ("Runs of the folder.", of["RunsAnswer"]),
        "/runs/{id}": ("One run and its files.", of["RunAnswer"]),
    }
    told["/commands"] = ("Commands of longer runs, with their expected cost.", costs)
    paths: dict[str, Any] = {}
    for path, (text, schema) in told.items():
        paths[path] = _get(text, [_FORMS], {"text/html": _TEXT, "application/json": {"schema": schema}}, None)
        if path.endswith("{id}"):
            paths[path]["parameters"] = [_named("id", "^[0-9a-f]+(-[0-9]+)?$")]
    files = {"*/*": {"schema": {"type": "string"}}}
    one = _get("A file of a run, as it was written.", [], files, None)
    return paths | {
        "/runs/{id}/{name}": one | {"parameters": [_named("id", "^[0-9a-f]+(-[0-9]+)?$"), _named("name", "")]}
    }


def _named(name: str, pattern: str) -> dict[str, Any]:
    schema = {"type": "string"} | ({"pattern": pattern} if pattern else {})
    return {"name": name, "in": "path", "required": True, "schema": schema}


def _jobs(of: dict[str, Any]) -> dict[str, Any]:
    """Return the addresses of jobs."""
    job = {"application/json": {"schema": of["JobAnswer"]}, "text/html": _TEXT}
    offered = _offered(IMAGES)
    fields = {parameter(option): _schema(IMAGES, option) | {"description": spelled(option.text)} for option in offered}
    fields["format"] = _FORMS["schema"]
    needed = [parameter(option) for option in offered if _is_required(option)]
    asked = {"type": "object", "properties": fields, "required": needed}
    missing = {"404": {"description": "There is no such job.", "content": {"text/plain": _TEXT}}}
    name = _named("id", "^[0-9a-f]{16}$")
    token = {"type": "object", "properties": {"token": {"type": "string"}}, "required": ["token"]}
    done = {"application/json": {"schema": of["StarImagesResult"]}}
    found = {"200": {"description": "How far it is.", "content": job}}
    return {
        "/jobs": {
            "post": {
                "summary": _first(IMAGES.model.__doc__),
                "requestBody": {"required": True, "content": {_FORM: {"schema": asked}}},
                "responses": {
                    "200": {"description": "The result is there already.", "content": job},
                    "202": {"description": "The job waits; with the token of the asker.", "content": job},
                    "303": {"description": "The page of the job."},
                    **_refusals({"application/json": {"schema": of["Problem"]}, "text/html": _TEXT}),
                },
            }
        },
        "/jobs/{id}": {
            "parameters": [name],
            "get": {
                "summary": "How far a job is, and its result.",
                "parameters": [_plain("format", "Form of the answer.", fields["format"])],
                "responses": found | missing,
            },
        },
        "/jobs/{id}/star_images.json": {
            "parameters": [name],
            "get": {
                "summary": "The result of a job that is done.",
                "responses": {"200": {"description": "The result.", "content": done}} | missing,
            },
        },
        "/jobs/{id}/cancel": {
            "parameters": [name],
            "post": {
                "summary": "Withdraw; the job ends when all who asked for it have.",
                "requestBody": {"required": True, "content": {_FORM: {"schema": token}}},
                "responses": {
                    "200": {"description": "Withdrawn.", "content": {"text/html": _TEXT}},
                    "403": {"description": "The token is not of one who asked.", "content": {"text/plain": _TEXT}},
                    **missing,
                },
            },
        },
    }
