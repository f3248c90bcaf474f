"""Page, command and Python give the same answer to the last digit; all fifty questions are in ``make browser``."""

import json
import re
from urllib.parse import parse_qsl, urlencode

import pytest

from cpic_planner.cli.main import main
from cpic_planner.web.addresses import ETC, python_lines
from tests.random_questions import pairs, question, words


def same(ask, capsys, seed):
    given = question(seed)
    address = f"/etc?{urlencode(pairs(given))}"
    told = ask(f"{address}&format=json")
    status = main(["etc", *words(given), "--json"])
    printed = capsys.readouterr()
    if told.status != 200:
        assert (told.status, status) == (400, 2), told.text
        return False
    assert status == 0, printed.err
    assert told.text == printed.out
    canonical = ETC.canonical(parse_qsl(address.partition("?")[2]))
    scope = {}
    exec(python_lines(ETC.question(canonical), canonical), scope)
    mine = [json.loads(answer.model_dump_json()) for answer in scope["answers"]]
    assert mine == told.json["answers"]
    page = ask(address)
    cells = [re.sub(r"<[^>]*>", "", cell) for cell in re.findall(r"<td[^>]*>(.*?)</td>", page.text, re.S)]
    shown = ask(f"{address}&format=markdown").text
    digits = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
    for cell in cells[:3]:
        power = re.fullmatch(r"([\d.]+) × 10(\S+)", cell.strip())
        written = f"{power[1]}e-{-int(power[2].translate(digits)):02d}" if power else cell.strip()
        assert written in shown
    return True


@pytest.mark.parametrize("seed", range(6))
def test_page_command_and_python_say_the_same(ask, capsys, seed):
    same(ask, capsys, seed)
