"""Documents: what their blocks look like as HTML, and a section that one entry adds to a page."""

import pytest

from cpic_core import Registry
from cpic_planner.report import document as doc
from cpic_planner.report.confirm import CONFIRM_SECTIONS, ConfirmReport, confirm_document
from cpic_planner.report.document import page_html
from cpic_planner.report.drawing import Picture
from cpic_planner.report.plan import PLAN_SECTIONS, PlanReport, plan_document
from cpic_planner.report.whatif import WHATIF_SECTIONS, WhatIfReport, whatif_document

HOSTILE = "<script>alert('x')</script>"
PAGES = {"plan": PLAN_SECTIONS, "confirm": CONFIRM_SECTIONS, "whatif": WHATIF_SECTIONS}


def page_of(*blocks):
    return page_html(doc.Document("window", "heading", "about", [], [("one", "One", blocks)]))


def toy(report):
    yield doc.Paragraph("Toys were counted.")
    columns = [doc.Column("Toy", str, look="row left"), doc.Column("Twice", lambda number: str(2 * number), "n")]
    yield doc.table("Toys", "All toys.", columns, (1, 2))
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
    assert "All the toys Toys were counted. All toys. Toy Twice n 1 2 2 4 Picture of a toy A toy." in words
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
        doc.table(HOSTILE, text, [doc.Column(text, lambda _: text, HOSTILE, look="row wide")], [1]),
    )
    reader = read(page)
    reader.check_alone()
    assert HOSTILE not in page
    assert reader.words.count(HOSTILE) >= 30
    assert "✓" in reader.words


def test_cells(read):
    """A cell may go over several columns, head its row, and its row be shaded; lines without text are left out."""
    columns = [
        doc.Column("A", lambda n: doc.Span("both", 2) if n == 2 else str(n), look="row left"),
        doc.Column("B", lambda n: doc.lines(str(n), "", doc.small("unit"))),
        doc.Column(doc.lines("C", "c"), lambda n: "", "s", look="wide"),
    ]
    page = page_of(doc.table("label", "caption", columns, [1, 2], look="compact", picked=lambda n: n == 2))
    reader = read(page)
    assert reader.words.endswith("caption A B C c s 1 1 unit both")
    rows = [tag for tag in reader.tags if tag[0] == "tr"]
    assert rows == [("tr", {}), ("tr", {}), ("tr", {"class": "pick"})]
    heads = [attributes for tag, attributes in reader.tags if tag == "th"]
    assert heads[0] == {"scope": "col", "class": "left"}
    assert heads[1] == {"scope": "col"}
    assert heads[-1] == {"scope": "row", "colspan": "2", "class": "left"}
    assert [attributes for tag, attributes in reader.tags if tag == "td"] == [{}, {"class": "wide"}, {"class": "wide"}]
    assert ("table", {"class": "compact"}) in reader.tags


def test_backticks_are_code(read):
    page = page_of(doc.Paragraph(doc.marked("see `a.csv` and `b.csv`.")))
    assert "see <code>a.csv</code> and <code>b.csv</code>." in page
