"""Documents: what their blocks look like as HTML, and a section that one entry adds to a page."""

import pytest

from cpic_core import Registry
from cpic_planner.report import document as doc
from cpic_planner.report.confirm import CONFIRM_SECTIONS, ConfirmReport, confirm_document
from cpic_planner.report.drawing import Picture
from cpic_planner.report.plan import PLAN_SECTIONS, PlanReport, plan_document
from cpic_planner.report.whatif import WHATIF_SECTIONS, WhatIfReport, whatif_document
from cpic_planner.report.writing import page_html, table_on_page, together

HOSTILE = "<script>alert('x')</script>"
PAGES = {"plan": PLAN_SECTIONS, "confirm": CONFIRM_SECTIONS, "whatif": WHATIF_SECTIONS}


def page_of(*blocks):
    return page_html(doc.Document("window", "heading", "about", [], [("one", "One", blocks)]))


def toy(report):
    yield doc.Paragraph("Toys were counted.")
    columns = [
        doc.own_column("toy", str, look="row left"),
        doc.own_column("twice", lambda number: str(2 * number), "n"),
    ]
    yield doc.Table("Toys", columns, (1, 2), "All toys.")
    yield doc.Figure(Picture("data:image/png;base64,", "a toy", "A toy."), "Picture of a toy", "toy")


@pytest.mark.parametrize("kind", PAGES)
def test_a_section_is_one_entry(kind, plan, rank, confirmation, compared, read):
    """It stands in the contents, under its heading, where it was put; without a block it does not show at all."""
    render = {
        "plan": lambda: page_html(plan_document(PlanReport(plan, rank, {}, {}))),
        "confirm": lambda: page_html(confirm_document(ConfirmReport(confirmation, {}, {}))),
        "whatif": lambda: page_html(whatif_document(WhatIfReport(compared(), {}))),
    }[kind]
    page, entry = PAGES[kind], doc.Section("toys", "All the toys", toy)
    before = render()
    with page.holding(doc.Section("nothing", "Nothing at all", lambda _: [])):
        assert render() == before
    with page.holding(entry):
        assert list(page)[-1] == "toys"
    with page.holding(entry, after="assumptions"):
        made = render()
    reader = read(made)
    reader.check_alone()
    reader.check_anchors()
    words = reader.words
    assert "All the toys Toys were counted. Toys. All toys. Toy Twice n 1 2 2 4 Picture of a toy A toy." in words
    assert made.index('id="assumptions"') < made.index('id="toys"') < made.index('id="glossary"')
    assert words.index("Contents" if "Contents" in words else "Assumptions") < words.index("All the toys")
    assert made.count('href="#toys"') == 1
    assert render() == before


def test_a_section_follows_one_that_there_is(refused):
    page = Registry("section")
    doc.section_of(page, "b", "B")(toy)
    doc.section_of(page, "a", "A", after="b")(toy)
    doc.section_of(page, "c", "C", after="b")(toy)
    assert list(page) == ["b", "c", "a"]
    refused("^section = x", doc.section_of(page, "d", "D", after="x"), toy)


def test_texts_are_text(read):
    text = [HOSTILE, doc.badge("ok", HOSTILE), doc.code(HOSTILE), doc.small(HOSTILE), doc.strong(HOSTILE)]
    picture = Picture("data:image/png;base64,", HOSTILE, HOSTILE)
    page = page_of(
        doc.Paragraph(text, "note"),
        doc.Heading(text),
        doc.Facts([(text, text)]),
        doc.Items([text]),
        doc.Figure(picture, HOSTILE, "key", before=HOSTILE, more=HOSTILE),
        doc.Group("anchor", HOSTILE, [doc.Fold(HOSTILE, [doc.Paragraph(doc.link("anchor", HOSTILE))], True)]),
        doc.Table(HOSTILE, [doc.own_column(HOSTILE, lambda _: text, HOSTILE, look="row wide")], [1], text),
    )
    reader = read(page)
    reader.check_alone()
    assert HOSTILE not in page
    assert reader.words.count(HOSTILE) >= 30
    assert "✓" in reader.words


def test_cells(read):
    """A cell may head its row, and its row be shaded; lines without text are left out."""
    columns = [
        doc.own_column("A", str, look="row left"),
        doc.own_column("B", lambda n: doc.lines(str(n), "", doc.small("unit"))),
        doc.own_column("C", lambda n: "", "s", look="wide"),
        doc.own_column("D", str, look="terminal"),
    ]
    page = page_of(doc.Table("label", columns, [1, 2], "caption", look="compact", picked=lambda n: n == 2))
    reader = read(page)
    assert reader.words.endswith("label. caption A B C s 1 1 unit 2 2 unit")
    rows = [tag for tag in reader.tags if tag[0] == "tr"]
    assert rows == [("tr", {}), ("tr", {}), ("tr", {"class": "pick"})]
    heads = [attributes for tag, attributes in reader.tags if tag == "th"]
    assert heads[0] == {"scope": "col", "class": "left"}
    assert heads[1] == {"scope": "col"}
    assert heads[-1] == {"scope": "row", "class": "left"}
    assert [attributes for tag, attributes in reader.tags if tag == "td"] == [{}, {"class": "wide"}] * 2
    assert ("table", {"class": "compact"}) in reader.tags


@pytest.mark.parametrize(("count", "kind"), [(1, doc.Paragraph), (2, doc.Paragraph), (5, doc.Items)])
def test_many_lines_are_a_list(count, kind):
    lines = [doc.Paragraph(f"Line {number}.") for number in range(count)]
    blocks = list(together([doc.Heading("eps Eri"), *lines, doc.Paragraph("lead", "lead")]))
    assert {type(block) for block in blocks[1:-1]} == {kind}


@pytest.mark.parametrize(
    ("pairs", "left_out"),
    [
        ([("F520", "F520"), ("F662", "F662"), ("F520", "F520")], True),
        ([("F520", "F520"), ("F662", "F662")], False),  # two rows agree by chance
        ([("F520", "F520"), ("F662", "F662"), ("F520", "F720")], False),
        ([("–", "–")] * 3, False),  # nothing is said at all
    ],
)
def test_a_column_that_repeats_another_one_is_named_instead_of_shown(pairs, left_out):
    """The last one, the status, stays whatever it says."""
    rows = [(f"star {number}", *pair) for number, pair in enumerate(pairs)]
    columns = [doc.own_column(name, f"{{{at}}}") for name, at in (("star", 0), ("one", 1), ("other", 2), ("status", 1))]
    page = table_on_page(doc.Table("Stars", columns, rows))
    heads = [doc.plain(head) for head, _ in page["heads"]]
    assert heads == ["Star", "One", *["Other"] * (not left_out), "Status"]
    assert ("Left out, because alike in every row: Other (as One)." in doc.plain(page["caption"])) == left_out


def test_backticks_are_code(read):
    page = page_of(doc.Paragraph(doc.marked("see `a.csv` and `b.csv`.")))
    assert "see <code>a.csv</code> and <code>b.csv</code>." in page
