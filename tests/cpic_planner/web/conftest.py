"""A browser without a network: requests as a server hands them over, byte for byte as they were sent."""

import asyncio
import json
from dataclasses import dataclass
from urllib.parse import unquote, urlencode

import pytest

from cpic_planner.web import application


@dataclass(frozen=True)
class Told:
    """An answer."""

    status: int
    headers: dict
    body: bytes

    @property
    def text(self):
        return self.body.decode()

    @property
    def json(self):
        return json.loads(self.body)


@dataclass(frozen=True)
class Browser:
    """Asks an application."""

    application: object

    def post(self, address, files=(), *, fields=(), **headers):
        """Send a question with files, as a form does: (parameter, name, content)."""
        line = b"----edge"
        body = b""
        for name, text in fields:
            body += b'--%s\r\nContent-Disposition: form-data; name="%s"\r\n\r\n%s\r\n' % (
                line,
                name.encode(),
                text.encode(),
            )
        for name, file, content in files:
            told = f'name="{name}"; filename="{file}"'.encode()
            body += b"--%s\r\nContent-Disposition: form-data; %s\r\nContent-Type: x/y\r\n\r\n%s\r\n" % (
                line,
                told,
                content,
            )
        body += b"--%s--\r\n" % line
        about = {"content_type": f"multipart/form-data; boundary={line.decode()}", "content_length": str(len(body))}
        return self.get(address, method="POST", body=body, **(about | headers))

    def get(self, address, *, method="GET", host="localhost:8765", body=b"", **headers):
        path, _, query = address.partition("?")
        given = {"host": host} | {name.replace("_", "-"): value for name, value in headers.items()}
        scope = {
            "type": "http",
            "asgi": {"version": "3.0"},
            "http_version": "1.1",
            "method": method,
            "scheme": "http",
            "path": unquote(path),
            "raw_path": path.encode(),
            "query_string": query.encode(),
            "root_path": "",
            "headers": [(name.encode(), value.encode()) for name, value in given.items()],
            "client": ("127.0.0.1", 1),
            "server": ("127.0.0.1", 8765),
        }
        sent = []

        async def receive():
            return {"type": "http.request", "body": body, "more_body": False}

        async def send(message):
            sent.append(message)

        asyncio.run(self.application(scope, receive, send))
        head = {name.decode(): value.decode() for name, value in sent[0]["headers"]}
        return Told(sent[0]["status"], head, b"".join(message.get("body", b"") for message in sent[1:]))

    def submit(self, address, fields, **headers):
        """Send a form without files."""
        body = fields if isinstance(fields, bytes) else urlencode(fields).encode()
        kind = {"content_type": "application/x-www-form-urlencoded", "content_length": str(len(body))}
        return self.get(address, method="POST", body=body, **kind | headers)


@pytest.fixture(autouse=True)
def _each_ranking_once(kept_rankings):
    """Tests of pages ask the same questions again and again."""


@pytest.fixture(scope="session")
def browser():
    return Browser(application())


@pytest.fixture
def send(browser):
    """Send a question with files."""
    return browser.post


@pytest.fixture
def ask(browser):
    """Ask an address."""
    return browser.get
