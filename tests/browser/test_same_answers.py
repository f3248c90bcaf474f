"""Fifty random questions: page in Chromium, command and Python give the same answer to the last digit."""

import json
from urllib.parse import parse_qsl, urlencode

import pytest

from cpic_planner.cli.main import main
from cpic_planner.web.addresses import ETC, python_lines
from tests.random_questions import pairs, question, words

pytestmark = pytest.mark.browser
QUESTIONS = 50


@pytest.fixture(scope="module")
def answered(request):
    """Numbers of questions that had an answer."""
    found, tried = set(), {item for item in request.session.items if "test_same_answers" in item.nodeid}
    yield found
    assert len(found) >= 0.9 * len(tried)


@pytest.mark.parametrize(
    "seed", [pytest.param(seed, marks=pytest.mark.slice) if seed == 0 else seed for seed in range(QUESTIONS)]
)
def test_page_command_and_python_say_the_same(context, capsys, answered, seed):
    given = question(seed)
    address = f"/etc?{urlencode(pairs(given))}"
    page = context(script=False)
    shown = page.goto(address)
    status = main(["etc", *words(given), "--json"])
    printed = capsys.readouterr()
    if status != 0:
        assert shown.status == 400
        assert page.locator(".wrong").count() == 1
        return
    answered.add(seed)
    assert shown.status == 200
    told = page.request.get(page.get_by_role("link", name="JSON", exact=True).get_attribute("href")).text()
    assert told == printed.out
    canonical = ETC.canonical(parse_qsl(address.partition("?")[2]))
    scope = {}
    exec(python_lines(ETC.question(canonical), canonical), scope)
    assert [json.loads(answer.model_dump_json()) for answer in scope["answers"]] == json.loads(told)["answers"]
    assert main(["etc", *words(given), "--format", "csv"]) == 0
    rows = page.locator(".answer table").first.locator("tbody tr")
    assert rows.count() == capsys.readouterr().out.count("\n") - 1
