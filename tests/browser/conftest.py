"""A server of its own and Debian's Chromium; without Playwright or Chromium the tests are skipped, and counted."""

import json
import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.request

import pytest

CHROMIUM = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser") or ""


def missing():
    """Return what is missing to run these tests; empty where nothing is."""
    try:
        import axe_playwright_python  # noqa: F401
        import playwright  # noqa: F401
    except ImportError:
        return "no Playwright: pip install '.[browser]'"
    return "" if CHROMIUM else "no Chromium: apt-get install chromium"


def pytest_collection_modifyitems(items):
    mine = [item for item in items if item.nodeid.startswith("tests/browser/")]
    reason = missing()
    for item in mine if reason else ():
        item.add_marker(pytest.mark.skip(reason=reason))


def pytest_terminal_summary(terminalreporter):
    """Say how many of these tests were not run."""
    skipped = [report for report in terminalreporter.stats.get("skipped", []) if "tests/browser/" in report.nodeid]
    ran = sum("tests/browser/" in getattr(item, "nodeid", "") for item in terminalreporter.stats.get("passed", []))
    if skipped or ran:
        terminalreporter.write_line(f"SKIPPED {len(skipped)} browser tests")


@pytest.fixture(scope="session")
def server(tmp_path_factory):
    """Serve the calculator as a command of its own; its address."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    folder = tmp_path_factory.mktemp("server")
    address = f"http://127.0.0.1:{port}"
    ranking = {"schema_version": 1, "kind": "rank", "config_hash": "ab12"}
    (folder / "ranking.json").write_text(json.dumps(ranking, indent=2))
    own = ["--jobs", str(folder / "jobs"), "--folder", str(folder)]
    command = [sys.executable, "-m", "cpic_planner.cli.main", "serve", "--port", str(port), *own]
    log = (folder / "log").open("w")
    process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT, cwd=folder)
    try:
        for _ in range(600):
            try:
                urllib.request.urlopen(f"{address}/style.css", timeout=5).read()
                break
            except OSError:
                assert process.poll() is None, (folder / "log").read_text()
                time.sleep(0.1)
        yield address
    finally:
        process.terminate()
        process.wait(20)
        log.close()


@pytest.fixture(scope="session")
def chromium():
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        yield browser
        browser.close()


@pytest.fixture
def check():
    """Check that a page fits into its window, shows its images, and that axe finds nothing serious."""
    from axe_playwright_python.sync_playwright import Axe

    def checked(page, width):
        page.wait_for_load_state("networkidle")
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        for image in page.locator("img").all():
            assert image.evaluate("image => image.naturalWidth") > 100
        found = Axe().run(page).response["violations"]
        bad = [(item["id"], item["nodes"][0]["html"]) for item in found if item["impact"] in ("serious", "critical")]
        assert bad == []

    return checked


@pytest.fixture
def context(chromium, server):
    """Make windows, whose requests all have to stay on the server, and whose pages may complain of nothing."""
    made, elsewhere, complaints = [], [], []

    def window(width=1400, script=True, **more):
        own = chromium.new_context(
            viewport={"width": width, "height": 900}, java_script_enabled=script, base_url=server, **more
        )
        own.on("request", lambda request: asked(request.url))
        own.on("console", lambda told: complaints.append(told.text) if told.type == "error" else None)
        own.on("weberror", lambda told: complaints.append(str(told.error)))
        made.append(own)
        return own.new_page()

    def asked(address):
        if not address.startswith((f"{server}/", "data:")):
            elsewhere.append(address)

    yield window
    for own in made:
        own.close()
    assert elsewhere == []
    assert [text for text in complaints if "400 (Bad Request)" not in text] == []
