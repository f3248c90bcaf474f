"""Images in a real browser: ask, wait with a place in the queue, see how far it is, read the result, cancel."""

import json
import re

import pytest

pytestmark = pytest.mark.browser
ADDRESS = re.compile(r"/jobs/[0-9a-f]{16}")
ROUNDS = 600


def ask(page, seed, bands=("F520",)):
    """Ask for images of a seed of their own, so that no other test has them."""
    page.goto("/jobs")
    page.fill("#target", "tau Cet")
    for band in bands:
        page.check(f"input[name=bands][value={band}]")
    if not page.locator("#seed").is_visible():
        page.locator("details:has(#seed) > summary").click()
    page.fill("#seed", str(seed))
    page.click("button[type=submit]")
    page.wait_for_load_state()


def standing(page):
    """Return how far the job of the page is, for programs."""
    address = ADDRESS.search(page.url)[0]
    return json.loads(page.request.get(f"{address}?format=json").text())


def wait_for(page, state):
    """Wait until a job is in a state, while its page asks again by itself."""
    for _ in range(ROUNDS):
        told = standing(page)
        if told["state"] == state:
            break
        assert told["state"] in ("waiting", "running"), told
        page.wait_for_timeout(500)
    assert told["state"] == state, told
    return told


@pytest.mark.parametrize("script", [True, False], ids=["script", "plain"])
def test_from_the_question_to_the_images(context, script):
    page = context(script=script)
    ask(page, 11 + script)
    assert "token=" in page.url
    assert page.get_by_role("button", name="Cancel").is_visible()
    assert page.locator("progress").count() == 1
    assert page.locator("meta[http-equiv=refresh]").count() == 1
    told = wait_for(page, "done")
    assert (told["finished"], told["tasks"]) == (1, 1)
    page.wait_for_selector("figure img", timeout=30_000)  # the page asked again by itself
    assert page.locator("meta[http-equiv=refresh]").count() == 0
    assert page.get_by_role("button", name="Cancel").count() == 0
    for image in page.locator("figure img").all():
        assert image.evaluate("image => image.naturalWidth") > 300
        assert "F520" in image.get_attribute("alt")
    result = json.loads(page.request.get(page.get_by_role("link", name="JSON").get_attribute("href")).text())
    assert [band["band"] for band in result["targets"][0]["bands"]] == ["F520"]
    text = page.request.get(page.get_by_role("link", name="CSV").get_attribute("href")).text()
    assert text.count("\n") >= 2
    again = context(script=script)
    ask(again, 11 + script)
    assert "token=" not in again.url  # it is there already: nothing to cancel
    assert again.locator("figure img").count() == page.locator("figure img").count()


@pytest.mark.parametrize("script", [True, False], ids=["script", "plain"])
def test_who_waits_sees_the_place_and_only_the_asker_cancels(context, script):
    first, second, other = (context(script=script) for _ in range(3))
    ask(first, 21 + script, ("F520", "F662", "F720", "F850"))
    ask(second, 31 + script)
    assert standing(second)["place"] == 1
    assert "Place in the queue" in second.locator(".answer").inner_text()
    other.goto(ADDRESS.search(second.url)[0])
    assert other.get_by_role("button", name="Cancel").count() == 0
    refused = other.request.post(f"{ADDRESS.search(second.url)[0]}/cancel", form={"token": "0" * 32})
    assert refused.status == 403
    for page in (second, first):
        page.get_by_role("button", name="Cancel").click()
        page.wait_for_load_state()
        assert "It is cancelled for you" in page.inner_text("main")
        assert page.request.get(ADDRESS.search(page.url)[0]).status == 404


@pytest.mark.parametrize("width", [390, 1400])
def test_pages_of_jobs_fit_and_are_not_hard_to_use(context, width, check):
    page = context(width)
    page.goto("/jobs")
    check(page, width)
    ask(page, 11)
    if page.locator("progress").count():
        check(page, width)
        wait_for(page, "done")
        page.wait_for_selector("figure img", timeout=30_000)
    check(page, width)
