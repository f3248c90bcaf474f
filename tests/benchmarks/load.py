"""Twenty users at once ask ``cpic serve``: answers and pages a second, errors, memory (``make load``).

Users ask questions of a pool in an order drawn from a seed, as people do who share addresses: the first time a question
is worked out, later its answer is there. ``--distinct`` is the size of the pool; as many as requests means that every
question is new. Processor time of server and users is told apart, since they share the machine.
"""

import argparse
import http.client
import json
import os
import random
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

STARS = (
    "tau Cet",
    "eps Eri",
    "eps Ind",
    "61 Cyg A",
    "alpha Cen B",
    "40 Eri A",
    "82 Eri",
    "delta Pav",
    "beta Hyi",
    "HIP 86400",
)
ASKED = {"json": 80.0, "page": 50.0}
"""Least number a second."""
MOST_GROWTH = 1.10
"""Resident memory at the end over that after a quarter, at most."""


def addresses(distinct: int, form: str) -> list[str]:
    """Different questions: stars and levels."""
    tail = "&format=json" if form == "json" else ""
    per = -(-distinct // len(STARS))
    every = [
        f"/etc?target={star.replace(' ', '+')}&snr={5 + 5 * number / per:.5g}{tail}"
        for number in range(per)
        for star in STARS
    ]
    return every[:distinct]


def rss_mb(pid: int) -> float:
    """Resident memory."""
    text = Path(f"/proc/{pid}/status").read_text()
    return int(text.partition("VmRSS:")[2].split()[0]) / 1024


def cpu_s(pid: int) -> float:
    """Processor time that a process has taken."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def asked(port: int, pid: int, every: list[str], requests: int, users: int, seed: int) -> dict:
    """Ask, and say how it went."""
    rng = random.Random(seed)
    order = [rng.choice(every) for _ in range(requests)] if len(every) < requests else list(every)
    left, lock, seen, memory = iter(order), threading.Lock(), Counter(), {}
    times: list[float] = []

    def user() -> None:
        wire = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
        while True:
            with lock:
                address = next(left, None)
                count = sum(seen.values())
            if address is None:
                return
            began = time.perf_counter()
            try:
                wire.request("GET", address)
                told = wire.getresponse()
                body, status = told.read(), told.status
                status = status if body else 0
            except (OSError, http.client.HTTPException):
                status = 0
                wire.close()
            with lock:
                seen[status] += 1
                times.append(time.perf_counter() - began)
                if "quarter" not in memory and count >= requests // 4:
                    memory["quarter"] = rss_mb(pid)

    before, wall, mine = cpu_s(pid), time.perf_counter(), resource.getrusage(resource.RUSAGE_SELF).ru_utime
    threads = [threading.Thread(target=user) for _ in range(users)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    wall = time.perf_counter() - wall
    times.sort()
    return {
        "requests": requests,
        "distinct": len(every),
        "per_s": round(requests / wall, 1),
        "errors": requests - seen[200],
        "median_ms": round(1e3 * times[len(times) // 2], 1),
        "p99_ms": round(1e3 * times[int(0.99 * len(times))], 1),
        "server_cpu_s": round(cpu_s(pid) - before, 2),
        "users_cpu_s": round(resource.getrusage(resource.RUSAGE_SELF).ru_utime - mine, 2),
        "rss_quarter_mb": round(memory.get("quarter", 0.0), 1),
        "rss_end_mb": round(rss_mb(pid), 1),
    }


def main() -> int:
    """Start a server and ask it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--requests", type=int, default=10_000)
    parser.add_argument("--users", type=int, default=20)
    parser.add_argument("--distinct", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--forms", nargs="+", choices=list(ASKED), default=list(ASKED))
    chosen = parser.parse_args()
    failed = False
    with tempfile.TemporaryDirectory() as folder:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        words = ["-m", "cpic_planner.cli.main", "-q", "serve", "--port", str(port), "--jobs", f"{folder}/jobs"]
        server = subprocess.Popen([sys.executable, *words])
        try:
            while True:
                try:
                    socket.create_connection(("127.0.0.1", port), timeout=1.0).close()
                    break
                except OSError:
                    if server.poll() is not None:
                        return 1
                    time.sleep(0.1)
            for form in chosen.forms:
                every = addresses(chosen.distinct, form)
                told = asked(port, server.pid, every, chosen.requests, chosen.users, chosen.seed)
                growth = told["rss_end_mb"] / told["rss_quarter_mb"]
                good = told["per_s"] >= ASKED[form] and told["errors"] == 0 and growth <= MOST_GROWTH
                failed |= not good
                print(json.dumps({"form": form, "asked_per_s": ASKED[form], **told, "growth": round(growth, 3)}))
        finally:
            server.send_signal(signal.SIGINT)
            server.wait()
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
