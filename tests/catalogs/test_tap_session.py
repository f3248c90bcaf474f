"""Where a request may go, after redirects too."""

import pytest

from catalogs.tap_session import Problem, Question, refuse_place

ARCHIVE = "https://archive.example/TAP"


def question(url=ARCHIVE, **changes):
    return Question(**({"url": url, "query": "", "maxrec": 1, "max_bytes": 1, "plain_http": False} | changes))


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
    refuse_place(question(**({"other_hosts": False} | changes)), to)


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
        refuse_place(question(**({"other_hosts": False} | changes)), to)
