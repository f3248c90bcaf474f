"""Where a request may go, after redirects too."""

import io
import os
import resource
import sys
import warnings

import pytest

from catalogs import TapService, tap_session
from catalogs.tap_session import Problem, refuse_place

ARCHIVE = "https://archive.example/TAP"


@pytest.mark.parametrize(
    ("to", "changes"),
    [
        (f"{ARCHIVE}/sync", {}),
        ("https://archive.example/results/1", {}),
        ("http://archive.example/results/1", {"plain_http": True}),
        ("https://mirror.example/TAP", {"other_hosts": True}),
        ("http://mirror.example/TAP", {"other_hosts": True, "plain_http": True}),
    ],
)
def test_a_request_may_go(to, changes):
    refuse_place(TapService(**changes), ARCHIVE, to)


@pytest.mark.parametrize(
    ("to", "changes", "words"),
    [
        ("https://mirror.example/TAP", {}, "another host"),
        ("https://archive.example:444/TAP", {}, "another host"),
        ("http://archive.example/TAP", {}, "http://archive.example, which is not asked"),
        ("http://mirror.example/TAP", {"other_hosts": True}, "which is not asked"),
        ("https://127.0.0.1/TAP", {"other_hosts": True, "plain_http": True}, "which is not asked"),
        ("http://localhost/TAP", {"other_hosts": True, "plain_http": True}, "which is not asked"),
        ("ftp://archive.example/TAP", {"plain_http": True}, "which is not asked"),
    ],
)
def test_a_request_may_not_go(to, changes, words):
    with pytest.raises(Problem, match=words):
        refuse_place(TapService(**changes), ARCHIVE, to)


def test_a_process_that_is_asked_nothing_ends(monkeypatch):
    """Whoever started it may have gone without a word; `catalogs.archives` ends it otherwise."""
    monkeypatch.setattr(resource, "setrlimit", lambda *_: None)
    monkeypatch.setattr(tap_session, "IDLE_S", 0.0)
    ours, theirs = os.pipe()
    said = io.StringIO()
    monkeypatch.setattr(sys, "stdout", said)
    with os.fdopen(ours) as questions, os.fdopen(theirs, "w"), warnings.catch_warnings():
        monkeypatch.setattr(sys, "stdin", questions)
        tap_session.main()
    assert said.getvalue() == "ready\n"
