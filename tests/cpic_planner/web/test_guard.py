"""Limits of the server: what is refused, how many wait, and what is kept."""

import asyncio
import threading

import numpy as np
import pytest

from cpic_core import numeric_context
from cpic_planner.web import application
from cpic_planner.web.guard import AnswerCache, Busy, Workers


@pytest.mark.parametrize(
    "host", ["", "evil.example", "localhost.evil.example", "127.0.0.1.evil.example", "[", "a:b:c", "192.168.0.1"]
)
def test_other_hosts_are_refused(ask, host):
    told = ask("/etc", host=host)
    assert (told.status, told.text.count("\n")) == (421, 1)
    assert "evil" not in told.text


@pytest.mark.parametrize("host", ["localhost", "LOCALHOST:8765", "127.0.0.1:8765"])
def test_its_own_hosts_are_answered(ask, host):
    assert ask("/etc", host=host).status == 200


def test_further_hosts_are_those_that_were_allowed(browser):
    mine = type(browser)(application(("cpic.example.org",)))
    assert mine.get("/etc", host="cpic.example.org").status == 200
    assert mine.get("/etc").status == 421


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "PATCH", "TRACE", "BREW"])
def test_other_methods_are_refused(ask, method):
    assert ask("/star", method=method).status == 405


def test_no_body_and_no_long_address(ask):
    assert ask("/etc", content_length="0").status == 200
    assert ask("/etc", content_length="5").status == 413
    assert ask("/etc", content_length="99999999999999").status == 413
    assert ask("/etc", transfer_encoding="chunked").status == 413
    assert ask(f"/etc?target={'a' * 4000}").status == 400
    told = ask(f"/etc?target={'a' * 4096}")
    assert (told.status, told.text.count("\n")) == (414, 1)


@pytest.mark.parametrize("address", ["/etc", "/nothing", "/etc?snr=x", "/style.css"])
def test_every_answer_keeps_the_browser_to_itself(ask, address):
    told = ask(address)
    policy = told.headers["content-security-policy"]
    assert policy.startswith("default-src 'none'; style-src 'self'; img-src 'self'; form-action 'self'")
    assert "unsafe" not in policy
    assert told.headers["x-content-type-options"] == "nosniff"
    assert told.headers["referrer-policy"] == "same-origin"
    assert "set-cookie" not in told.headers
    assert "server" not in told.headers


def test_a_figure_may_style_itself_and_nothing_else(ask):
    policy = ask("/etc.svg?target=tau+Cet&snr=5&bands=F520").headers["content-security-policy"]
    assert policy == "default-src 'none'; style-src 'unsafe-inline'"


def test_work_is_done_in_other_threads():
    names = asyncio.run(Workers(threads=1).do(lambda: threading.current_thread().name))
    assert names.startswith("cpic-answer")


def test_only_so_many_wait_and_places_come_back():
    workers, go = Workers(threads=1, waiting=1), threading.Event()

    async def crowd():
        first, second = (asyncio.ensure_future(workers.do(go.wait, 30)) for _ in range(2))
        await asyncio.sleep(0)
        with pytest.raises(Busy):
            await workers.do(int)
        go.set()
        assert await first
        assert await second
        return await workers.do(lambda: 7)

    assert asyncio.run(crowd()) == 7


def test_a_request_has_a_limit_of_time_and_its_thread_a_place_until_it_ends():
    workers, go = Workers(threads=1, waiting=0, limit_s=0.05), threading.Event()

    async def late():
        with pytest.raises(TimeoutError):
            await workers.do(go.wait, 30)
        with pytest.raises(Busy):
            await workers.do(int)
        go.set()
        while True:
            try:
                return await workers.do(lambda: 7)
            except Busy:
                await asyncio.sleep(0.01)

    assert asyncio.run(late()) == 7


def test_threads_compute_as_the_command_line_does():
    with numeric_context():
        mine = np.geterr()
    with np.errstate(all="raise"):
        assert asyncio.run(Workers().do(np.geterr)) == mine


@pytest.mark.parametrize(("threads_free", "status"), [(0, 503), (1, 504)])
def test_too_many_and_too_late_are_said_in_one_line(browser, threads_free, status):
    workers = Workers(threads=1, waiting=threads_free - 1, limit_s=0.0)
    told = type(browser)(application(workers=workers)).get("/etc?target=tau+Cet&format=json")
    assert (told.status, told.text.count("\n")) == (status, 1)


def test_answers_are_kept_while_they_fit():
    kept = AnswerCache(most_bytes=10)
    kept.put("a", b"1234", "text/plain")
    kept.put("b", b"5678", "text/plain")
    assert kept.get("a") == (b"1234", "text/plain")
    kept.put("c", b"90", "text/html")
    assert kept.get("b") is not None
    kept.put("d", b"xyz", "text/plain")  # "a" was asked for longest ago
    assert [kept.get(key) is not None for key in "abcd"] == [False, True, True, True]
    kept.put("e", b"x" * 11, "text/plain")
    assert kept.get("e") is None
    kept.put("d", b"other", "text/plain")
    assert kept.get("d") == (b"xyz", "text/plain")


def test_a_kept_answer_takes_no_worker(browser):
    mine = type(browser)(application(workers=Workers(threads=1, waiting=0)))
    first = mine.get("/etc?target=tau+Cet&bands=F520")
    again = mine.get("/etc?bands=F520&target=tau+Cet")
    assert (first.status, again.body, again.headers) == (200, first.body, first.headers)


def test_what_several_ask_at_once_is_worked_out_once():
    workers, go, calls = Workers(threads=2, waiting=1), threading.Event(), []

    def slow():
        calls.append(1)
        go.wait(30)
        return len(calls)

    async def crowd():
        asked = [asyncio.ensure_future(workers.do(slow, key="same")) for _ in range(20)]
        other = asyncio.ensure_future(workers.do(lambda: "other", key="another"))
        assert await other == "other"
        go.set()
        assert await asyncio.gather(*asked) == [1] * 20
        await asyncio.sleep(0.05)
        return await workers.do(slow, key="same")

    assert asyncio.run(crowd()) == 2


def test_one_who_gives_up_takes_nothing_from_the_others():
    workers, go = Workers(threads=1), threading.Event()

    async def crowd():
        before = asyncio.ensure_future(workers.do(go.wait, 30))
        first, second = (asyncio.ensure_future(workers.do(lambda: 7, key="same")) for _ in range(2))
        await asyncio.sleep(0)
        first.cancel()
        await asyncio.sleep(0)
        go.set()
        assert await before
        return await second

    assert asyncio.run(crowd()) == 7
