""""""

import re
from html.parser import HTMLParser
from shlex import split

import html5lib
import pytest

from cpic_planner.cli.main import main
from cpic_planner.web.addresses import ETC, python_lines
from cpic_planner.web.answers import etc_answer
from cpic_planner.web.pages import style_sheet

ADDRESSES = [
    "/etc",
    "/etc?target=tau+Cet&snr=5&bands=F520&bands=F662",
    "/etc?target=eps+Eri+b&bands=F520",
    "/etc?target=eps+Eri&contrast_limit=on&separation_arcsec=0.6&bands=F520",
    "/etc?target=%3Cscript%3Ealert(1)%3C/script%3E",
    "/etc?target=tau+Cet&n_frames=x",
    "/priorities?sp_type=K&distance_max_pc=6&v_mag_max=5&bands=F520&limit=5",
]


class Elements(HTMLParser):
    """Elements of a page: name and attributes, in order."""

    def __init__(self, text):
        super().__init__()
        self.found = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))

    def of(self, *tags):
        return [attrs for tag, attrs in self.found if tag in tags]


@pytest.fixture(params=ADDRESSES)
def text(request, ask):
    return ask(request.param).text


def test_pages_are_valid(text):
    html5lib.HTMLParser(strict=True).parse(text)


def test_ids_are_unique_and_what_refers_to_them_finds_them(text):
    elements = Elements(text)
    names = [attrs["id"] for _, attrs in elements.found if "id" in attrs]
    assert len(names) == len(set(names))
    for _, attrs in elements.found:
        for key in ("for", "aria-describedby", "aria-labelledby"):
            assert [name for name in (attrs.get(key) or "").split() if name not in names] == []


def test_every_input_has_a_label(text):
    elements = Elements(text)
    named = {attrs.get("for") for attrs in elements.of("label")}
    inputs = elements.of("input", "select")
    assert inputs
    for attrs in inputs:
        inside = re.search(rf'<label[^>]*><input[^>]* id="{attrs["id"]}"', text)
        assert attrs["id"] in named or inside, attrs
    assert all(attrs.get("alt") for attrs in elements.of("img"))


def test_nothing_runs_and_nothing_comes_from_elsewhere(text):
    elements = Elements(text)
    assert elements.of("script") == [{"src": "/page.js", "defer": None}]
    assert elements.of("style", "iframe", "object", "embed", "base") == []
    for tag, attrs in elements.found:
        assert [name for name in attrs if name.startswith("on") or name == "style"] == [], tag
        for name in ("href", "src", "action"):
            assert (attrs.get(name) or "/").startswith(("/", "#"))
            assert not (attrs.get(name) or "").startswith("//")
    assert b"url(" not in style_sheet()
    assert b"@import" not in style_sheet()


def test_an_answer_says_verdict_error_budget_and_how_to_ask_elsewhere(ask):
    told = ask("/etc?target=tau+Cet&snr=5&bands=F520").text
    for words in ("is not a detection", "5.00 ±", "read noise", "% of variance", "To cite", "configuration"):
        assert words in told
    for form in ("json", "csv", "latex"):
        assert f"/etc?target=tau+Cet&amp;snr=5&amp;bands=F520&amp;format={form}" in told
    assert 'src="/etc.svg?target=tau+Cet&amp;snr=5&amp;bands=F520"' in told


COPIED = [
    "target=tau+Cet&snr=5&bands=F520",
    "target=tau+Cet&bands=F520&separation_arcsec=0.4&time=2h",
    "target=eps+Eri&contrast_limit=on&separation_arcsec=0.6&bands=F520",
    "target=tau+Cet&detect=on&bands=F520&library=roll&roll_deg=20&set=throughput%3Dx0.7&exozodi=2&albedo=saturn",
    "target=alpha+Cen+B&exposure_s=30&n_frames=100&bands=F520",
    "target=eps+Eri+b&bands=F662",
]


@pytest.mark.parametrize("address", COPIED)
def test_lines_to_copy_give_the_same_answer(ask, capsys, address):
    from urllib.parse import parse_qsl

    pairs = ETC.canonical(parse_qsl(address))
    answer = etc_answer(pairs)
    assert main([*split(ETC.command_line(pairs))[1:], "--json"]) == 0
    assert capsys.readouterr().out == ask(f"/etc?{address}&format=json").text
    given = {}
    exec(python_lines(ETC.question(pairs), pairs), given)
    told = [row.model_dump() for row in given["answers"]]
    assert told == [row.model_dump() for row in answer.result.answers]
