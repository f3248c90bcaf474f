"""The documentation in a real browser: no page asks anybody for anything, fits on a phone, and is found by searching.

Its pages are those of ``make docs``; where they are not built the tests are skipped.
"""

import functools
import http.server
import threading
from pathlib import Path

import pytest

SITE = Path(__file__).resolve().parents[2] / "docs" / "_build" / "html"
PAGES = sorted(path.relative_to(SITE).as_posix() for path in SITE.rglob("*.html")) if SITE.is_dir() else []
pytestmark = [pytest.mark.browser, pytest.mark.skipif(not PAGES, reason="no pages: make docs")]
SHOWN = ("index", "tutorials/first_question", "how_to/own_instrument", "reference/words", "explanation/noise_model")


@pytest.fixture(scope="module")
def site():
    """Serve the pages; their address."""
    handler = functools.partial(_Quiet, directory=SITE)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as served:
        threading.Thread(target=served.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{served.server_address[1]}"
        served.shutdown()


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_told):
        """Say nothing of each request."""


@pytest.fixture
def window(chromium, site):
    """Make windows that may ask for nothing but files of the site, and whose pages may complain of nothing."""
    made, wrong = [], []

    def opened(width=1280, **more):
        own = chromium.new_context(viewport={"width": width, "height": 900}, **more)
        own.on("request", lambda request: elsewhere(request.url))
        own.on("console", lambda told: wrong.append(told.text) if told.type == "error" else None)
        own.on("requestfailed", failed)
        made.append(own)
        return own.new_page()

    def elsewhere(address):
        if not address.startswith((f"{site}/", "data:")):
            wrong.append(address)

    def failed(request):
        if "ERR_ABORTED" not in str(request.failure):  # the page was left meanwhile
            wrong.append(f"failed: {request.url}")

    yield opened
    for own in made:
        own.close()
    assert wrong == []


def test_no_page_asks_anybody_and_all_fit_on_a_phone(window, site):
    page = window(390)
    for name in PAGES:
        page.goto(f"{site}/{name}")
        assert page.evaluate("document.documentElement.scrollWidth") <= 390, name
    assert len(PAGES) > 60


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_pages_can_be_read(window, site, check, scheme):
    page = window(390, color_scheme=scheme)
    for name in SHOWN:
        page.goto(f"{site}/{name}.html")
        check(page, 390)


def test_formulas_are_drawn_without_a_script(window, site):
    page = window(java_script_enabled=False)
    page.goto(f"{site}/explanation/noise_model.html")
    assert page.locator("math").count() > 40
    fraction = page.locator("div.math mfrac").first.bounding_box()
    assert fraction["height"] > 15


def test_a_word_is_found(window, site):
    page = window()
    page.goto(f"{site}/search.html?q=common_fraction")
    page.locator("#search-results li").first.wait_for()
    assert page.locator("#search-results li").count() >= 2


def test_two_clicks_lead_to_an_answer(window, site):
    page = window()
    page.goto(f"{site}/index.html")
    page.get_by_role("link", name="Time for an SNR").click()
    assert "first_question.html" in page.url
    assert page.locator("#time-for-an-snr").is_visible()
