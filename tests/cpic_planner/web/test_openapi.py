"""The OpenAPI document is one, describes what is answered, and its schemas hold what is answered."""

import json
from urllib.parse import urlencode

import pytest
from jsonschema import Draft202012Validator
from openapi_spec_validator import OpenAPIV31SpecValidator

from cpic_planner.schemas import openapi_text
from cpic_planner.version import __version__
from cpic_planner.web import application
from cpic_planner.web.addresses import ETC, IMAGES, RANK, parameter
from cpic_planner.web.job_queue import JobQueue
from tools.openapi import described


@pytest.fixture(scope="module")
def document(browser):
    return browser.get("/openapi.json").json


def test_the_shipped_one_is_that_of_the_models():
    assert json.loads(openapi_text()) == described(), "run python -m tools.schemas"


def test_it_has_the_version_of_the_package(document):
    assert document["info"]["version"] == __version__


@pytest.mark.long
def test_it_is_valid(document):
    assert list(OpenAPIV31SpecValidator(document).iter_errors()) == []


@pytest.mark.parametrize("asking", [ETC, RANK])
def test_parameters_are_those_that_are_taken(document, asking):
    told = {item["name"]: item for item in document["paths"][asking.page]["get"]["parameters"]}
    offered = {parameter(option): option for option in asking.options if option.flag not in asking.left_out}
    assert set(told) - set(offered) <= {"limit", "format"}
    assert set(offered) <= set(told)
    for name, option in offered.items():
        assert told[name]["required"] == (option.required and len(option.path) == 1)
        assert (told[name]["schema"]["type"] == "array") == option.several


def test_ranges_are_those_of_the_question(document):
    told = {item["name"]: item["schema"] for item in document["paths"]["/etc"]["get"]["parameters"]}
    assert told["planet_radius_rjup"] == {"type": "number", "exclusiveMinimum": 0, "maximum": 10}
    assert told["n_frames"] == {"type": "integer", "minimum": 1}
    assert "known_place" in told["search"]["enum"]
    assert told["bands"]["type"] == "array"


def test_a_posted_form_has_the_fields_that_are_taken(document):
    form = document["paths"]["/jobs"]["post"]["requestBody"]["content"]["application/x-www-form-urlencoded"]["schema"]
    offered = {parameter(option) for option in IMAGES.options if option.flag not in IMAGES.left_out}
    assert set(form["properties"]) == offered | {"format"}
    assert form["required"] == ["target"]


def schema_of(document, path, status, method="get"):
    content = document["paths"][path][method]["responses"][status]["content"]
    return content["application/json"]["schema"] | {"components": document["components"]}


def test_answers_are_as_it_says(document, browser, tmp_path):
    asked = {"target": "tau Cet", "bands": "F520", "format": "json"}
    for path, status, told in (
        ("/etc", "200", browser.get(f"/etc?{urlencode(asked)}")),
        ("/etc", "400", browser.get("/etc?target=tau+Cet&snr=x&format=json")),
        ("/commands", "200", browser.get("/commands?format=json")),
        ("/runs", "200", browser.get("/runs?format=json")),
        ("/priorities", "200", browser.get("/priorities?sp_type=K&distance_max_pc=6&bands=F520&format=json")),
    ):
        assert told.status == int(status)
        assert list(Draft202012Validator(schema_of(document, path, status)).iter_errors(told.json)) == []
    with JobQueue(tmp_path) as queue:
        mine = type(browser)(application(jobs=queue))
        told = mine.submit("/jobs", asked)
        assert told.status == 202
        for path, status, method, json in (
            ("/jobs", "202", "post", told.json),
            ("/jobs/{id}", "200", "get", mine.get(f"{told.json['address']}?format=json").json),
        ):
            assert list(Draft202012Validator(schema_of(document, path, status, method)).iter_errors(json)) == []


def test_every_described_address_is_answered(document, browser, tmp_path):
    with JobQueue(tmp_path) as queue:
        mine = type(browser)(application(jobs=queue))
        for path, item in document["paths"].items():
            for method in {"get", "post"} & set(item):
                place = path.replace("{id}", "0" * 16).replace("{name}", "plan.json").replace("{which}", "seasons")
                told = mine.submit(place, {}) if method == "post" else mine.get(f"{place}?nothing=1")
                assert told.status != 405, path
                assert not told.text.startswith("There is no such page"), path


@pytest.mark.parametrize(
    "query",
    [
        pytest.param("/star?name=eps+Eri", marks=pytest.mark.long),
        "/compare?instrument=as_published",
        "/compare?target=tau+Cet",
    ],
)
def test_pages_of_several_answers_are_described_as_they_answer(document, browser, query):
    path = query.partition("?")[0]
    told = browser.get(f"{query}&bands=F520&format=json" if "target" in query else f"{query}&format=json")
    assert told.status == 200
    assert list(Draft202012Validator(schema_of(document, path, "200")).iter_errors(told.json)) == []
    refused = browser.get(f"{query}&x=1&format=json")
    assert refused.status == 400
    assert list(Draft202012Validator(schema_of(document, path, "400")).iter_errors(refused.json)) == []


def test_files_are_described_where_they_are_taken(document, browser):
    for path, item in document["paths"].items():
        kinds = item.get("post", {}).get("requestBody", {}).get("content", {})
        assert ("multipart/form-data" in kinds) == (path in ("/etc", "/priorities", "/compare", "/columns"))
    for path, names in (
        ("/etc", {"instrument", "catalog", "albedo", "known_planets"}),
        ("/compare", {"instrument", "other", "catalog", "albedo", "known_planets"}),
        ("/columns", {"table"}),
    ):
        content = document["paths"][path]["post"]["requestBody"]["content"]["multipart/form-data"]
        assert {name for name, told in content["schema"]["properties"].items() if "oneOf" in told} == names
    stars = b"name,v_mag,sp_type,distance_pc\nBob,4.5,G8V,7\n"
    fields = [("target", "Bob"), ("snr", "5"), ("bands", "F520"), ("format", "json")]
    told = browser.post("/etc", [("catalog", "s.csv", stars)], fields=fields)
    assert "cpic-files" in told.headers
    assert list(Draft202012Validator(schema_of(document, "/etc", "200", "post")).iter_errors(told.json)) == []
