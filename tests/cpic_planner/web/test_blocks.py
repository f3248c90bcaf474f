"""What is printed on a console as blocks of a page."""

from dataclasses import dataclass

import pytest

from cpic_planner import report
from cpic_planner.report.cells import print_note, print_plain, print_table
from cpic_planner.web.pages import blocks_of


@dataclass(frozen=True)
class Line:
    """A row with two columns that may say the same."""

    name: str
    one: str
    other: str


def columns():
    return [
        report.Cells("star", lambda row: row.name),
        report.Cells("1", lambda row: row.one, label="one"),
        report.Cells("2", lambda row: row.other, label="other"),
        report.Cells("status", lambda row: row.one, label="status"),
    ]


def told(*pairs):
    rows = [Line(f"star {number}", *pair) for number, pair in enumerate(pairs)]
    (table,) = blocks_of(lambda console: print_table(console, "Stars", columns(), rows))
    return ["".join(map(str, [head.text])) for head in table.heads], str(table.caption)


def test_a_column_that_repeats_another_one_is_named_instead_of_shown():
    """The last one, the status, stays whatever it says."""
    heads, caption = told(("F520", "F520"), ("F662", "F662"), ("F520", "F520"))
    assert heads == ["star", "one", "status"]
    assert "Left out, because alike in every row: other (as one)." in caption


@pytest.mark.parametrize(
    "pairs",
    [
        [("F520", "F520"), ("F662", "F662")],  # two rows agree by chance
        [("F520", "F520"), ("F662", "F662"), ("F520", "F720")],
        [(report.MISSING, report.MISSING)] * 3,  # nothing is said at all
    ],
)
def test_columns_that_differ_or_agree_by_chance_stay(pairs):
    heads, caption = told(*pairs)
    assert heads == ["star", "one", "other", "status"]
    assert "Left out" not in caption


@pytest.mark.parametrize(
    ("count", "kinds"), [(1, [report.Paragraph]), (2, [report.Paragraph] * 2), (5, [report.Items])]
)
def test_many_lines_are_a_list(count, kinds):
    lines = [f"Line {number}." for number in range(count)]

    def printed(console):
        print_plain(console, "eps Eri", bold=True)
        print_plain(console, *lines)
        print_note(console, "! a flag", "Note: a note")

    blocks = blocks_of(printed)
    assert [type(block) for block in blocks] == [report.Heading, *kinds, report.Paragraph, report.Paragraph]
    assert blocks[0].text == "eps Eri"
    if count > 2:
        assert blocks[1].texts == lines
    assert [block.look for block in blocks[-2:]] == ["note", "note"]
