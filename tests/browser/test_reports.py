"""Reports in a real browser: tables sort, filter and copy, links open what is folded, drawings follow the dark."""

import csv
import io

import pytest
from PIL import Image

from cpic_planner.report.document import Document, Figure, Fold, Paragraph, Table, link, own_column
from cpic_planner.report.drawing import new_figure, save, style
from cpic_planner.report.writing import page_html

pytestmark = [pytest.mark.browser, pytest.mark.slice]
ROWS = [(f"star {number}", (7 * number) % 11) for number in range(1, 10)] + [("=1+1 star 10", 4)]


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """Return the address of a report with a table, a figure and a folded part."""
    columns = own_column("Star", "{0}", look="row left"), own_column("Places", "{1}", "count")
    with style():
        figure = new_figure(3.0)
        figure.add_subplot().set_title("drawn")
        picture = save(figure, alt="A drawing.", caption="Drawn.")
    blocks = [
        Paragraph(["See ", link("deep", "what is folded"), "."]),
        Table("Stars", columns, ROWS, "Stars and places."),
        Figure(picture, "A drawing"),
        Fold("More", [Paragraph("Found it.")], anchor="deep"),
    ]
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(page_html(Document("A report", "A report", "About.", blocks, [])), encoding="utf-8")
    return path.as_uri()


@pytest.fixture
def window(chromium):
    """Make windows that may ask for nothing but the file, and whose pages may complain of nothing."""
    made, wrong = [], []

    def open_window(width=1400, script=True, **more):
        own = chromium.new_context(viewport={"width": width, "height": 900}, java_script_enabled=script, **more)
        own.on("request", lambda asked: None if asked.url.startswith(("file:", "data:")) else wrong.append(asked.url))
        own.on("console", lambda told: wrong.append(told.text) if told.type == "error" else None)
        own.on("weberror", lambda told: wrong.append(str(told.error)))
        made.append(own)
        return own.new_page()

    yield open_window
    for own in made:
        own.close()
    assert wrong == []


def column(page, number):
    return page.locator(f"tbody tr:visible > :nth-child({number})").all_inner_texts()


def test_tables_sort_filter_and_copy(window, report):
    page = window()
    page.goto(report)
    page.click("thead th:nth-child(2) button")
    assert [int(text) for text in column(page, 2)] == sorted(value for _, value in ROWS)
    page.click("thead th:nth-child(2) button")
    assert [int(text) for text in column(page, 2)] == sorted((value for _, value in ROWS), reverse=True)
    page.fill("input[placeholder='Filter rows']", "STAR 1")
    assert set(column(page, 1)) == {"star 1", "=1+1 star 10"}
    page.evaluate("navigator.clipboard.writeText = (text) => { window.copied = text; return Promise.resolve(); }")
    page.click("button:has-text('Copy as CSV')")
    rows = list(csv.reader(io.StringIO(page.evaluate("window.copied"))))
    assert rows[0] == ["Star", "Places count"]
    assert ["'=1+1 star 10", "4"] in rows, "a spreadsheet shall not take it for a formula"
    wanted = {("star 1", str(dict(ROWS)["star 1"])), ("'=1+1 star 10", "4")}
    assert {tuple(row) for row in rows[1:]} == wanted
    page.click("button:has-text('Copy as LaTeX')")
    assert page.evaluate("window.copied").startswith("\\begin{tabular}{ll}")


def test_links_open_what_is_folded(window, report):
    page = window()
    page.goto(report)
    assert not page.is_visible("text=Found it.")
    page.click("text=what is folded")
    page.wait_for_selector("text=Found it.", state="visible")


def test_all_is_there_without_script(window, report):
    page = window(script=False)
    page.goto(report)
    assert [int(text) for text in column(page, 2)] == [value for _, value in ROWS]
    assert page.locator(".tools").count() == 0


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_of_a_drawing_is_that_of_the_report(window, report, scheme):
    """The corner of the drawing has the colour of the page around it, in both lights."""
    page = window(color_scheme=scheme)
    page.goto(report)
    shot = page.locator("figure img").screenshot()
    image = Image.open(io.BytesIO(shot)).convert("RGB")
    background = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert f"rgb{image.getpixel((image.width // 2, image.height - 12))}" == background
    assert background == {"light": "rgb(255, 255, 255)", "dark": "rgb(20, 23, 26)"}[scheme]


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1400, 390])
def test_nothing_runs_over_and_nobody_is_shut_out(window, report, width, scheme):
    from axe_playwright_python.sync_playwright import Axe

    page = window(width, color_scheme=scheme)
    page.goto(report)
    assert page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth") == 0
    found = Axe().run(page).response["violations"]
    assert [item["id"] for item in found if item["impact"] in ("serious", "critical")] == []
