import pytest

from cpic_planner.web import application


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
