"""What a visitor does, in a real browser: fill, ask, share, sort, filter, copy, download, send files."""

import csv
import io
import json
import re

import pytest
from PIL import Image, ImageStat

pytestmark = pytest.mark.browser
STARS = "name,v_mag,sp_type,distance_pc\nBob,4.5,G8V,7\n"
PAGES = {
    "form": "/etc",
    "answer": "/etc?target=tau+Cet&snr=5",
    "planet": "/etc?target=eps+Eri+b&bands=F520",
    "refused": "/etc?target=tau+Cet&snr=five",
    "values": "/star/seasons.values?name=eps+Eri",
    "files": "/etc/own",
    "priorities": "/priorities?sp_type=K&distance_max_pc=12&limit=12",
    "star": "/star?name=eps+Eri",
    "commands": "/commands",
    "runs": "/runs",
    "compare": "/compare?target=tau+Cet&snr=5&separation_arcsec=0.45&instrument=as_published&bands=F520",
    "columns": "/columns",
}


def ask(page, **answers):
    page.goto("/etc")
    for name, text in answers.items():
        page.fill(f"#{name}", text)
    page.click("button[type=submit]")
    page.wait_for_load_state()


def first_answer(page):
    return page.locator(".answer table").first.locator("tbody tr").first.inner_text().split("\t")


@pytest.mark.parametrize("script", [pytest.param(True, marks=pytest.mark.slice), False], ids=["script", "plain"])
def test_fill_ask_and_share(context, script):
    page = context(script=script)
    ask(page, target="tau Cet", snr="5", separation_arcsec="0.36")
    assert page.url.endswith("/etc?target=tau+Cet&snr=5&separation_arcsec=0.36")
    shared = context(script=False)
    shared.goto(page.url)
    assert first_answer(shared) == first_answer(page)
    assert shared.input_value("#snr") == "5"
    page.fill("#snr", "8")
    page.click("button[type=submit]")
    page.wait_for_load_state()
    assert "snr=8" in page.url
    assert first_answer(page) != first_answer(shared)


def test_a_star_that_is_in_no_table(context):
    page = context()
    page.goto("/etc")
    page.click("summary:has-text('no table')")
    for name, text in {"v_mag": "4.5", "sp_type": "G8V", "distance_pc": "7", "snr": "5"}.items():
        page.fill(f"#{name}", text)
    page.click("button[type=submit]")
    page.wait_for_load_state()
    assert "my star" in page.locator(".answer caption").first.inner_text()


@pytest.mark.parametrize(
    ("field", "wrong", "good"),
    [
        ("snr", "five", "5"),
        ("planet_radius_rjup", "11", "1.2"),
        ("planet_radius_rjup", "0", "0.1"),
        ("visits", "2.5", "2"),
        ("visit_time_s", "2 parsecs", "45min"),
        ("separation_arcsec", "0.3, x", "0.3, 0.4"),
    ],
)
def test_numbers_are_checked_while_they_are_typed(context, field, wrong, good):
    page = context()
    page.goto("/etc")
    page.fill("#target", "tau Cet")
    page.locator(f"#{field}").press_sequentially(wrong)
    told = page.locator(f"#live-{field}")
    assert wrong in told.inner_text()
    assert page.get_attribute(f"#{field}", "aria-invalid") == "true"
    page.click("button[type=submit]")
    assert page.url.endswith("/etc")
    assert page.evaluate("document.activeElement.id") == field
    page.fill(f"#{field}", good)
    assert told.inner_text() == ""
    assert page.get_attribute(f"#{field}", "aria-invalid") is None


def test_what_the_script_refuses_the_server_refuses_too(context):
    page = context(script=False)
    for field, wrong in (
        ("snr", "five"),
        ("planet_radius_rjup", "11"),
        ("visits", "2.5"),
        ("visit_time_s", "2 parsecs"),
    ):
        ask(page, target="tau Cet", **{field: wrong})
        assert page.locator(f"#wrong-{field}").is_visible(), field


@pytest.mark.slice
def test_tables_sort_filter_and_copy(context):
    page = context(permissions=["clipboard-read", "clipboard-write"])
    page.goto(PAGES["priorities"])
    table = page.locator(".answer table").first

    def column(number):
        return [
            float(row.locator("th,td").nth(number).inner_text().replace("−", "-"))
            for row in table.locator("tbody tr").all()
        ]

    heads = [head.inner_text().split("\n")[0].strip() for head in table.locator("thead th").all()]
    magnitude = next(number for number, head in enumerate(heads) if head.startswith("V"))
    before = column(magnitude)
    assert before != sorted(before)
    button = table.locator("thead th").nth(magnitude).locator("button")
    button.click()
    assert column(magnitude) == sorted(before)
    assert table.locator("thead th").nth(magnitude).get_attribute("aria-sort") == "ascending"
    button.press("Enter")
    assert column(magnitude) == sorted(before, reverse=True)
    page.get_by_label("Filter rows").first.fill("Eri")
    shown = [row.inner_text() for row in table.locator("tbody tr").all() if row.is_visible()]
    assert 0 < len(shown) < len(before)
    assert all("Eri" in text for text in shown)
    page.get_by_label("Copy as CSV").first.click()
    rows = list(csv.reader(io.StringIO(page.evaluate("navigator.clipboard.readText()"))))
    assert len(rows) == 1 + len(shown)
    assert len({len(row) for row in rows}) == 1
    page.get_by_label("Copy as LaTeX").first.click()
    text = page.evaluate("navigator.clipboard.readText()")
    assert text.startswith("\\begin{tabular}")
    assert text.count("\\\\\n") == 1 + len(shown)
    assert not re.search(r"(?<!\\)[%#_](?![^$]*\$)", text)


def test_times_sort_by_how_long_they_are(context):
    page = context()
    page.goto("/etc?target=tau+Cet&snr=5")
    table = page.locator(".answer table").first
    table.locator("thead th").nth(1).locator("button").click()
    bands = [row.locator("th").inner_text() for row in table.locator("tbody tr").all()]
    told = json.loads(page.request.get("/etc?target=tau+Cet&snr=5&format=json").text())["answers"]
    assert [text.split()[-1] for text in bands] == [row["band"] for row in sorted(told, key=lambda row: row["value"])]


@pytest.mark.slice
def test_downloads_are_what_the_links_say(context):
    page = context()
    page.goto(PAGES["answer"])
    for name, begins in (
        ("JSON", "{"),
        ("CSV", "band"),
        ("LaTeX", r"\begin{table}"),
        ("SVG", "<?xml"),
        ("PNG", "\x89PNG"),
    ):
        address = page.get_by_role("link", name=name, exact=True).get_attribute("href")
        body = page.request.get(address).body()
        assert body.decode("latin-1").startswith(begins), name


def point_at(page, across, up):
    """Move the pointer to a place of the first figure, in shares of the drawing; what is told there."""
    image = page.locator(".drawn img").first
    image.scroll_into_view_if_needed()
    box, pad = image.bounding_box(), image.evaluate("i => i.clientLeft + parseFloat(getComputedStyle(i).paddingLeft)")
    x = box["x"] + pad + across * (box["width"] - 2 * pad)
    page.mouse.move(x, box["y"] + pad + (1 - up) * (box["height"] - 2 * pad))
    page.locator(".at-pointer").wait_for(state="visible")
    return dict(line.rsplit(": ", 1) for line in page.locator(".at-pointer").inner_text().split("\n") if ": " in line)


@pytest.mark.slice
def test_figures_tell_their_values_at_the_pointer(context):
    """In the middle of the axis of times: what stands in the table of the values next to that time."""
    asked = "target=tau+Cet&snr=5&separation_arcsec=0.5&bands=F520"
    page, tables = context(), context(script=False)
    page.goto(f"/etc?{asked}")
    page.wait_for_load_state("networkidle")
    tables.goto(f"/etc?{asked}")
    tables.click("text=Its values in tables")
    assert tables.url.endswith(f"/etc.values?{asked}")
    panels = json.loads(tables.get_attribute("[data-panels]", "data-panels"))
    left, bottom, wide, high = panels[0]["box"]
    told = point_at(page, left + 0.5 * wide, bottom + 0.5 * high)
    hours = float(told["wall time allowed (h)"])
    ends = panels[0]["x"]
    assert hours == pytest.approx((ends["low"] * ends["high"]) ** 0.5, rel=0.03)
    rows = [row.split("\t") for row in tables.locator(".answer tbody").first.inner_text().split("\n")]
    times = {float(row[0]): row[1] for row in rows}
    nearest = min(times, key=lambda time: abs(time / hours - 1.0))
    assert float(told["F520, SNR"]) == pytest.approx(float(times[nearest]), rel=2e-3)
    left, bottom, wide, high = panels[2]["box"]
    shares = point_at(page, left + 0.5 * wide, bottom + 0.5 * high)
    assert sum(map(float, shares.values())) == pytest.approx(100.0, abs=0.1)
    page.mouse.move(5, 5)
    page.locator(".at-pointer").wait_for(state="hidden")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_figures_follow_the_dark(context, scheme):
    page = context(color_scheme=scheme)
    page.goto(PAGES["answer"])
    page.wait_for_load_state("networkidle")
    for image in page.locator(".drawn img").all():
        shade = ImageStat.Stat(Image.open(io.BytesIO(image.screenshot())).convert("L")).mean[0]
        assert (shade < 128) == (scheme == "dark")


def test_an_answer_follows_the_question_where_it_is_asked_to(context):
    page = context()
    page.goto("/etc?target=tau+Cet&snr=5&bands=F520")
    before = first_answer(page)
    page.locator("#snr").press_sequentially("0")
    page.wait_for_timeout(800)
    assert first_answer(page) == before
    page.check(".follow input")
    with page.expect_response(re.compile("snr=7")):
        page.fill("#snr", "7")
    page.wait_for_function("document.querySelector('.follow + .unit').textContent === 'answered'")
    assert "snr=7" in page.url
    assert first_answer(page) != before
    assert page.locator(".answer .sort").count() > 2
    assert "snr=7" in page.get_by_role("link", name="JSON", exact=True).get_attribute("href")


@pytest.mark.parametrize("script", [True, False], ids=["script", "plain"])
def test_a_table_of_stars_is_sent_and_answered(context, script):
    page = context(script=script)
    page.goto("/etc")
    page.click("text=With files of your own")
    page.set_input_files("#catalog", files=[{"name": "my stars.csv", "mimeType": "text/csv", "buffer": STARS.encode()}])
    page.fill("#target", "Bob")
    page.fill("#snr", "5")
    page.click("button[type=submit]")
    page.wait_for_load_state()
    assert "Bob" in page.locator(".answer caption").first.inner_text()
    assert page.locator("figure img").evaluate("image => image.naturalWidth") > 300
    assert "my stars.csv" in page.locator(".answer").inner_text()


@pytest.mark.parametrize("width", [390, 1280])
def test_columns_of_a_table_are_shown(context, width):
    page = context(width=width)
    page.goto("/etc")
    page.click("nav >> text=Your table")
    table = f"{STARS.rstrip().replace('v_mag', 'Vmag')}\nEve,bright,G8V,7\n"
    page.set_input_files("#table", files=[{"name": "my stars.csv", "mimeType": "text/csv", "buffer": table.encode()}])
    page.click("button[type=submit]")
    page.wait_for_load_state()
    assert "my stars.csv" in page.locator("h1").inner_text()
    first, left = (page.locator(".answer table").nth(i) for i in (0, 1))
    assert "1 of 2 rows can be used" in first.locator("caption").inner_text()
    cells = [row.inner_text().split("\t")[:2] for row in first.locator("tbody tr").all()]
    assert [cell.strip() for cell in cells[1]] == ["Vmag", "v_mag"]
    assert "bright" in left.locator("tbody").inner_text()
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")


def test_from_priorities_to_a_star_to_its_answer(context):
    page = context(script=False)
    page.goto(PAGES["priorities"])
    name = page.locator(".answer tbody a").first.inner_text()
    page.locator(".answer tbody a").first.click()
    assert name in page.locator("h1").inner_text()
    assert page.locator("figure img").count() >= 1
    page.click("text=time of a detection")
    assert name in page.locator("h1").inner_text()
    assert "detect=on" in page.url


@pytest.mark.parametrize("width", [390, 1400])
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slice) if name == "answer" else name for name in PAGES]
)
def test_nothing_is_wider_than_the_window_and_nothing_is_hard_to_use(context, check, name, width):
    page = context(width)
    page.goto(PAGES[name])
    check(page, width)
