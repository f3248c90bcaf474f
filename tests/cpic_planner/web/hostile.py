"""Hostile requests, as bytes on a connection, drawn from a seed; and what has to become of each.

All of them against a server of its own: ``python tests/cpic_planner/web/hostile.py --count 600`` (``make hostile``).
"""

import argparse
import random
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

SECRET = "xyzzy-plugh"
FILES = ("etc/passwd", "secret.yaml", "proc/self/environ", "secret", "cpic-jobs.json", "queue.lock", "run.json")
NUMBERS = ("nan", "inf", "-inf", "1e999", "-1", "0x10", "1_0", "١٢", "5;rm -rf /", "1" * 190, "--1", "1e", "½", "true")
WORDS = (
    "<script>alert(1)</script>",
    "{{7*7}}",
    "${jndi:ldap://evil.example/x}",
    "' OR 1=1 --",
    "%s%s%n",
    "\x00",
    "a\r\nset-cookie: a=b",
    "\u202eevil",
    "\ud7ff\ufffd",
    "file:///etc/passwd",
    "~/.netrc",
    "!!python/object/apply:os.system [id]",
    "__import__('os')",
    "A" * 500,
)
FIELDS = ("snr", "time_s", "separation_arcsec", "planet_radius_rjup", "exposure_s", "visits", "distance_pc", "date_utc")
HOSTS = (
    "evil.example",
    "localhost.evil.example",
    "127.0.0.1.evil.example",
    "",
    "[::1",
    "a b",
    "127.1",
    "0",
    "user@evil",
)
METHODS = ("PUT", "DELETE", "PATCH", "TRACE", "OPTIONS", "CONNECT", "PROPFIND", "BREW", "get", "G3T")


AT_ONCE = 20
"""Requests at a time, fewer than may wait for an answer."""


@dataclass(frozen=True)
class Hostile:
    """A request: what kind, its bytes, and the pause before each byte of what is sent slowly."""

    kind: str
    sent: bytes
    slow: bytes = b""
    pause_s: float = 0.0


def request(line: str, *headers: str, body: bytes = b"", host: str | None = "localhost", kind: str = "") -> Hostile:
    """A request with a host."""
    given = ([f"Host: {host}"] if host is not None else []) + [*headers, "Connection: close"]
    text = "\r\n".join([line, *given, "", ""]).encode("utf-8", "surrogateescape")
    return Hostile(kind, text + body)


def posted(body: bytes, *headers: str, path: str = "/jobs", kind: str = "post") -> Hostile:
    """A posted form."""
    form = "Content-Type: application/x-www-form-urlencoded"
    return request(f"POST {path} HTTP/1.1", form, f"Content-Length: {len(body)}", *headers, body=body, kind=kind)


def paths(rng: random.Random) -> Hostile:
    """An address that could lead to a file."""
    up = rng.choice(("..", "%2e%2e", "..%2f", "%252e%252e", "..%5c", ".%00.", "%c0%ae%c0%ae", "....//"))
    start = rng.choice(("", "/etc", "/runs", "/runs/0123456789abcdef", "/jobs", "/jobs/0123456789abcdef", "/style.css"))
    depth = "/".join([up] * rng.randint(1, 6))
    return request(f"GET {start}/{depth}/{rng.choice(FILES)} HTTP/1.1", kind="path")


def named_files(rng: random.Random) -> Hostile:
    """A parameter that could name a file."""
    file = rng.choice(("/", "../", "./", "file:///", "~/", "C:\\", "//evil.example/")) + rng.choice(FILES)
    page, fields = rng.choice(
        (
            ("/etc?target=tau+Cet&", ("instrument", "catalog", "known_planets", "set")),
            ("/priorities?", ("stars", "population")),
        )
    )
    form = rng.choice(("csv", "json", "latex"))
    return request(f"GET {page}{rng.choice(fields)}={quote(file)}&format={form} HTTP/1.1", kind="file")


def values(rng: random.Random) -> Hostile:
    """A number that is none, or a text that could run."""
    form = rng.choice(("csv", "json", "html"))
    field = rng.choice(FIELDS)
    if rng.random() < 0.5:
        asked = f"target=tau+Cet&{field}={quote(rng.choice(NUMBERS))}"
        if "date" in field or field == "visits":
            asked += "x"
    else:
        asked = rng.choice((f"target={quote(rng.choice(WORDS))}", f"target=tau+Cet&{quote(rng.choice(WORDS))}=1"))
    tail = f"&nonsense{rng.randint(0, 99)}=1" if rng.random() < 0.2 else ""
    return request(f"GET /etc?{asked}{tail}&format={form} HTTP/1.1", kind="value")


def rankings(rng: random.Random) -> Hostile:
    """A ranking that is none."""
    field = rng.choice(("limit", "distance_max_pc", "v_mag_max", "time_s", "dec_min_deg", "planet_radius_rjup"))
    number = rng.choice([item for item in NUMBERS if item not in ("-1", "true", "1" * 190)])
    return request(f"GET /priorities?{field}={quote(number)}&format=csv HTTP/1.1", kind="ranking")


def huge(rng: random.Random) -> Hostile:
    """Too much of something."""
    size = rng.randint(5_000, 12_000)
    return rng.choice(
        (
            request(f"GET /etc?target={'a' * size} HTTP/1.1", kind="huge"),
            request(f"GET /{'a/' * (size // 2)} HTTP/1.1", kind="huge"),
            request("GET /etc HTTP/1.1", f"X-Long: {'a' * 4 * size}", kind="huge"),
            request("GET /etc HTTP/1.1", *(f"X-{number}: a" for number in range(size)), kind="huge"),
            request(f"GET /etc?{'&'.join(f'snr={n}' for n in range(400))} HTTP/1.1", kind="huge"),
            request("GET /etc HTTP/1.1", f"Content-Length: {10 ** rng.randint(5, 30)}", kind="huge"),
            posted(b"target=tau+Cet&x=" + b"a" * 30_000, kind="huge"),
            posted(b"&".join(b"a%d=1" % number for number in range(900)), kind="huge"),
        )
    )


def hosts(rng: random.Random) -> Hostile:
    """Another host, two of them, or none."""
    line = rng.choice(("GET /etc HTTP/1.1", "GET /openapi.json HTTP/1.1", "GET /jobs HTTP/1.1"))
    if rng.random() < 0.1:
        return request(line, "Host: evil.example", kind="host")
    if rng.random() < 0.1:
        return request(line, host=None, kind="host")
    name = rng.choice(HOSTS)
    return request(line, host=name + rng.choice(("", ":80", f":{rng.randint(0, 99999)}")) * bool(name), kind="host")


def methods(rng: random.Random) -> Hostile:
    """A method that nothing answers."""
    path = rng.choice(("/etc", "/priorities", "/runs", "/commands", "/openapi.json", "/style.css"))
    if rng.random() < 0.3:
        return posted(b"target=tau+Cet", path=rng.choice(("/runs", "/commands", "/openapi.json")), kind="method")
    return request(f"{rng.choice(METHODS)} {path} HTTP/1.1", kind="method")


def encodings(rng: random.Random) -> Hostile:
    """Bytes that are no good HTTP, or no good text."""
    junk = bytes(rng.randrange(256) for _ in range(rng.randint(20, 200)))
    return rng.choice(
        (
            Hostile("encoding", junk + b"\r\n\r\n"),
            Hostile("encoding", b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"),
            Hostile("encoding", b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + junk),
            Hostile("encoding", b"GET /etc\r\n\r\n"),
            Hostile("encoding", b"GET /\xff\xfe HTTP/1.1\r\nHost: localhost\r\n\r\n"),
            Hostile("encoding", b"GET /etc HTTP/9.9\r\nHost: localhost\r\n\r\n"),
            request("GET http://evil.example/etc HTTP/1.1", host="evil.example", kind="encoding"),
            request(f"GET /etc?target={'%ff%fe' * rng.randint(1, 9)}&format=csv HTTP/1.1", kind="encoding"),
            request(f"GET /etc?target=%{rng.choice('zgq')}0&format=csv HTTP/1.1", kind="encoding"),
            request("GET /etc?target=%00%01%02&format=csv HTTP/1.1", kind="encoding"),
            request(
                "GET /etc HTTP/1.1", "Transfer-Encoding: chunked", body=b"5\r\nhello\r\n0\r\n\r\n", kind="encoding"
            ),
            request("GET /etc HTTP/1.1", "Content-Length: 5", "Content-Length: 6", body=b"hello!", kind="encoding"),
            request("POST /jobs HTTP/1.1", "Transfer-Encoding: chunked", body=b"0\r\n\r\n", kind="encoding"),
            request("GET /etc HTTP/1.1", "X: a\rb", kind="encoding"),
            request("GET /etc HTTP/1.1", "Content-Length: -1", kind="encoding"),
            request("GET /etc?format=../../secret HTTP/1.1", kind="encoding"),
        )
    )


def posts(rng: random.Random) -> Hostile:
    """A job that nobody may ask for, or a token of nobody."""
    name = f"{rng.randrange(16**16):016x}"
    field, word = rng.choice((*FIELDS[1:2], "realisations", "seed", "planet_radius_rjup")), rng.choice(NUMBERS[:-1])
    wrong = quote(word if field != "seed" else f"{word}x").encode()
    return rng.choice(
        (
            posted(b"target=tau+Cet", "Origin: https://evil.example"),
            posted(b"target=tau+Cet", "Origin: null"),
            posted(b"target=tau+Cet", "Sec-Fetch-Site: cross-site"),
            posted(b"target=tau+Cet&format=json&" + field.encode() + b"=" + wrong),
            posted(b"target=tau+Cet&format=json&out=" + quote(rng.choice(FILES)).encode()),
            posted(b"target=tau+Cet&format=json&instrument=../" + rng.choice(FILES).encode()),
            posted(b"target=tau+Cet&format=json&realisations=%d" % rng.randint(20_000, 99_999)),
            posted(b"target=" + quote(rng.choice(WORDS)).encode() + b"&format=json"),
            posted(b"target=tau+Cet&target=eps+Eri&format=json"),
            posted(b"format=json"),
            posted(b"\xff\xfe\x00" * 9),
            posted(b"token=" + name.encode(), path=f"/jobs/{name}/cancel"),
            request(
                "POST /jobs HTTP/1.1", "Content-Type: application/json", "Content-Length: 2", body=b"{}", kind="post"
            ),
            request("POST /jobs HTTP/1.1", "Content-Type: text/xml", "Content-Length: 2", body=b"<a", kind="post"),
        )
    )


def slow(rng: random.Random) -> Hostile:
    """A head or a body that does not come, or comes by the byte."""
    pause_s = rng.choice((0.05, 0.3))
    head = b"POST /jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/x-www-form-urlencoded\r\n"
    return rng.choice(
        (
            Hostile("slow", b""),
            Hostile("slow", b"GET /etc HTTP/1.1\r\nHost: loc"),
            Hostile("slow", b"", b"GET /etc HTTP/1.1\r\nX: " + b"a" * 2000, pause_s),
            Hostile("slow", head + b"Content-Length: 2000\r\n\r\n"),
            Hostile("slow", head + b"Content-Length: 2000\r\n\r\ntarget=", b"a" * 1900, pause_s),
        )
    )


KINDS: tuple[tuple[Callable[[random.Random], Hostile], int], ...] = (
    (paths, 20),
    (named_files, 14),
    (values, 20),
    (rankings, 6),
    (huge, 8),
    (hosts, 10),
    (methods, 10),
    (encodings, 12),
    (posts, 14),
    (slow, 4),
)
"""Kinds of requests with their shares."""


def hostile(count: int, seed: int = 1) -> list[Hostile]:
    """As many requests, none twice but the slow ones."""
    rng = random.Random(seed)
    found: dict[Hostile, None] = {}
    made, weights = zip(*KINDS, strict=True)
    plenty = 40 * count
    while len(found) < count and (plenty := plenty - 1):
        found.setdefault(rng.choices(made, weights)[0](rng))
    return list(found)


def answer(port: int, asked: Hostile, patience_s: float) -> bytes:
    """What comes back until the server closes."""
    with socket.create_connection(("127.0.0.1", port), timeout=patience_s) as wire:
        got = b""
        try:
            wire.sendall(asked.sent)
            for number in range(len(asked.slow)):
                wire.sendall(asked.slow[number : number + 1])
                wire.settimeout(asked.pause_s)
                try:
                    got += (some := wire.recv(65_536))
                    if not some or got:
                        break
                except TimeoutError:
                    continue
            wire.settimeout(patience_s)
            while some := wire.recv(65_536):
                got += some
        except (ConnectionResetError, BrokenPipeError):
            pass  # it closed while we sent
        return got


ONE_LINE = re.compile(r"[^\n]+\n?")


def faults(asked: Hostile, got: bytes) -> Iterator[str]:
    """What is wrong with an answer."""
    head, _, body = got.partition(b"\r\n\r\n")
    status = int(head[9:12]) if head[:5] == b"HTTP/" else 0
    text = body.decode("utf-8", "replace")
    if not 400 <= status < 500:
        yield f"status {status}"
    if b"text/html" in head.lower():
        wrong = re.findall(r'class="wrong"[^>]*>([^<]*)<', text)
        if len(wrong) != 1 or re.search(r"<script(?! src=./page.js. defer>)", text):
            yield f"{len(wrong)} lines say what is wrong"
    elif b"application/json" not in head.lower() and not ONE_LINE.fullmatch(text):
        yield f"not one line: {text[:80]!r}"
    for word in (SECRET, "root:", "Traceback", ".py", "/tmp/", "site-packages"):
        if word in text:
            yield f"it quotes {word}"
    if b"set-cookie" in head.lower() or b"\r\nserver:" in head.lower():
        yield "a header says too much"


def tried(port: int, every: list[Hostile], patience_s: float = 30.0) -> tuple[Counter, list[str]]:
    """Kinds of requests, and what was wrong with the answer of which."""
    late_first = sorted(every, key=lambda asked: asked.kind != "slow")
    with ThreadPoolExecutor(AT_ONCE) as pool:
        answers = list(pool.map(lambda asked: answer(port, asked, patience_s), late_first))
    found = [
        f"{asked.kind}: {fault}: {asked.sent[:160]!r}"
        for asked, got in zip(late_first, answers, strict=True)
        for fault in faults(asked, got)
    ]
    return Counter(asked.kind for asked in every), found


def main() -> int:
    """Run all of them against ``cpic serve``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=600)
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for name in ("secret", "secret.yaml"):
            (Path(folder) / name).write_text(f"kind: instrument\nname: {SECRET}\n")
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        words = ["-m", "cpic_planner.cli.main", "serve", "--port", str(port), "--jobs", f"{folder}/jobs"]
        log = Path(folder) / "log"
        with log.open("w") as file:
            server = subprocess.Popen([sys.executable, *words, "--folder", folder], cwd=folder, stderr=file)
        try:
            wait_for(port)
            kinds, found = tried(port, hostile(chosen.count, chosen.seed))
            plain = request("GET /etc?target=tau+Cet&snr=5&format=json HTTP/1.1")
            alive = server.poll() is None and answer(port, plain, 60.0).startswith(b"HTTP/1.1 200")
        finally:
            server.send_signal(signal.SIGINT)
            server.wait()
        failed = log.read_text().count("a request failed")
    print("\n".join(found))
    print(f"{sum(kinds.values())} requests: {dict(sorted(kinds.items()))}")
    print(f"{len(found)} not refused as they should, {failed} failed inside, server {'alive' if alive else 'dead'}")
    return int(bool(found) or failed > 0 or not alive)


def wait_for(port: int, seconds: float = 60.0) -> None:
    """Return when somebody listens there."""
    deadline = time.monotonic() + seconds
    while True:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1.0).close()
        except OSError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.1)
        else:
            return


if __name__ == "__main__":
    sys.exit(main())
