"""The check of words finds planted fragments and words that the glossary replaces, and nothing in the repository."""

import re

import pytest

from tools import words

GLOSSARY = (words.ROOT / words.GLOSSARY).read_text(encoding="utf-8")
REPLACED = words.replaced_words(GLOSSARY)

MODULE = '''"""{module}"""

class Table:
    """{thing}"""

    @property
    def rows(self) -> int:
        """Number of rows."""

    def column(self, name: str) -> list[float]:
        """{function}"""
'''


@pytest.mark.parametrize(
    "fragment",
    ["The column.", "Name of the column.", "Band-averaged column.", "What a column holds.", "Numbers, None without."],
)
def test_a_function_without_a_verb_is_found(fragment):
    code = MODULE.format(module="Tables.", thing="A table.", function=fragment)
    assert list(words.docstring_fragments("here.py", code)) == [
        f'here.py:10: "{fragment}": begin with a verb, such as "Return"'
    ]


def test_a_riddle_at_the_head_of_a_module_or_class_is_found():
    code = MODULE.format(module="What fills a table.", thing="Where rows stand.", function="Return a column.")
    assert [line.split('"')[1] for line in words.docstring_fragments("here.py", code)] == [
        "What fills a table.",
        "Where rows stand.",
    ]


@pytest.mark.parametrize(
    ("text", "other"),
    [
        ("Stop at this S/N.", "S/N"),
        ("Wall clock of all visits.", "wall clock"),
        ("The faintest flux\nratios that are found.", "flux ratio"),
        ("Ranking metric.", "ranking metric"),
    ],
)
def test_a_replaced_word_in_help_is_found(text, other):
    found = list(words.help_findings([("cpic rank --planted", text, False)], REPLACED))
    assert found == [f'help of cpic rank --planted: "{other}": write "{REPLACED[other]}", the word of the glossary']


def test_options_and_code_are_names_and_no_words():
    text = "Set --headroom, `headroom`, ``headroom`` or drift.wander=1 [as here](how_to/headroom.md)."
    assert list(words.wrong_words("here", text, REPLACED)) == []
    assert len(list(words.wrong_words("here", text + " It is the headroom.", REPLACED))) == 1


def test_phrases_that_the_style_page_refuses_are_gone():
    style = (words.ROOT / words.STYLE).read_text(encoding="utf-8")
    table = style.partition("## Do and don't")[2].partition("\n## ")[0]
    refused = [line.split("|")[2].strip().rstrip(".") for line in table.splitlines() if line.startswith("| ")][2:]
    assert len(refused) == 20
    files = [*(words.ROOT / "cpic_planner").rglob("*.*"), *(words.ROOT / "docs").rglob("*.md")]
    read = [
        file for file in files if file.suffix in {".py", ".md", ".j2", ".yaml"} and file != words.ROOT / words.STYLE
    ]
    kept = [file for file in read if not words.MADE & set(file.parts)]
    text = " ".join(re.sub(r"\s+", " ", file.read_text("utf-8")) for file in kept)
    assert [phrase for phrase in refused if phrase in text] == []
