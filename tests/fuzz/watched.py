"""What every case of the fuzzer has to keep: answered, or refused in one line; quiet, soon, and within memory.

Cases of a surface are drawn by hypothesis; `Surface.tried` runs one under limits and counts how it ended.
"""

import contextlib
import io
import resource
import signal
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from cpic_core import InputError

SILENT_S = 11.0
"""Longest time without a line of progress, in processor time, which no other process of the machine lengthens: lines
are due every ten seconds, and it is looked for them four times a second."""
ENOUGH_S = 25.0
"""After so long a case that says what it does is interrupted: it is work, and its question was accepted."""
MEMORY_BYTES = 1_000_000_000
"""Most memory that a case may take beside what the process has."""


Case = tuple[str, Any, Callable[[], str]]
"""A case: what it is one of, what is shown of it, and what runs it and returns how it ended."""


class Fault(AssertionError):
    """What a case did not keep; ``where`` is the place in our code, by which faults are told apart."""

    def __init__(self, what: str, where: str = "") -> None:
        self.where = where
        super().__init__(f"{what} ({where})" if where else what)


class _Told(io.StringIO):
    """Errors of a command; lines of progress start the clock again."""

    def write(self, text: str) -> int:
        if text:
            _again()
        return super().write(text)


def _again() -> None:
    signal.setitimer(signal.ITIMER_PROF, SILENT_S)


@contextlib.contextmanager
def limited() -> Iterator[None]:
    """Limit memory and silence of what runs inside; a warning is an error.

    Raises
    ------
    Fault
    """
    soft_hard, silent = resource.getrlimit(resource.RLIMIT_DATA), []

    def late(*ignored: Any) -> None:
        silent.append(Fault(f"nothing was said for {SILENT_S:g} s", _place(sys._getframe(1))))
        raise silent[0]

    def enough(*ignored: Any) -> None:
        raise KeyboardInterrupt

    with open("/proc/self/statm", encoding="ascii") as about:
        used = int(about.read().split()[5]) * resource.getpagesize()
    before = signal.signal(signal.SIGPROF, late), signal.signal(signal.SIGVTALRM, enough)
    # Of data, not of addresses (RLIMIT_AS): a stack that may not grow ends the process by a segmentation fault, while
    # memory that is refused is a MemoryError.
    resource.setrlimit(resource.RLIMIT_DATA, (used + MEMORY_BYTES, soft_hard[1]))
    _again()
    signal.setitimer(signal.ITIMER_VIRTUAL, ENOUGH_S)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        resource.setrlimit(resource.RLIMIT_DATA, soft_hard)
        signal.signal(signal.SIGPROF, before[0])
        signal.signal(signal.SIGVTALRM, before[1])
        if silent:  # also where something took it for damage of a file
            raise silent[0]


def _place(frame: Any) -> str:
    """Innermost line of ours below a frame."""
    while frame is not None:
        name = frame.f_code.co_filename
        if any(f"/{package}/" in name for package in ("cpic_core", "catalogs", "simulator", "cpic_planner")):
            return f"{name.rsplit('/', 2)[-2]}/{name.rsplit('/', 1)[-1]}:{frame.f_lineno}"
        frame = frame.f_back
    return ""


def _raised_at(error: BaseException) -> str:
    frames = [summary for summary in traceback.extract_tb(error.__traceback__) if "/tests/" not in summary.filename]
    ours = [item for item in frames if "site-packages" not in item.filename]
    return f"{ours[-1].filename.rsplit('/', 1)[-1]}:{ours[-1].lineno}" if ours else ""


def check_refusal(text: str) -> None:
    """Check that a refusal is one line of a decent length with key, value and what is allowed.

    Raises
    ------
    Fault
    """
    if "\n" in text or "Traceback" in text or "Warning" in text:
        raise Fault(f"more than one line: {text[:300]!r}")
    if "MemoryError" in text or "Unable to allocate" in text:
        raise Fault(f"more than {MEMORY_BYTES:g} bytes: {text[:300]!r}")
    if len(text) > 2000:
        raise Fault(f"a line of {len(text)} characters: {text[:300]!r}")
    if not all(character.isprintable() or character == " " for character in text):
        raise Fault(f"characters that no terminal should get: {text[:300]!r}")
    if ": not accepted" in text and " = " in text and "; allowed: " not in text and " (" not in text:
        raise Fault(f"says not what is allowed: {text[:300]!r}")


def of_function(function: Callable[[], Any]) -> str:
    """Call a function under limits; return ``answered`` or ``refused``.

    Raises
    ------
    Fault
        Unless it answers, or refuses by `InputError`.
    """
    out = _Told()
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out), limited():
            function()
    except InputError as error:
        check_refusal(str(error))
        return "refused"
    except Fault:
        raise
    except BaseException as error:
        raise Fault(f"{type(error).__name__}: {str(error)[:200]}", _raised_at(error)) from error
    if "Traceback" in out.getvalue() or "Warning:" in out.getvalue():
        raise Fault(f"wrote {out.getvalue()[:200]!r}")
    return "answered"


def of_command(arguments: list[str]) -> str:
    """Run ``cpic`` in this process under limits; return ``answered``, ``refused``, or ``at work``.

    Raises
    ------
    Fault
        Unless it answers with status 0, refuses with status 2 in one line and nothing else, tells findings or that
        there is no answer where it was asked to (1 of ``check``, 3 of ``--strict``), or was at work and said so.
    """
    from cpic_planner.cli import main as entry

    out, errors, raised = io.StringIO(), _Told(), []

    own = entry._failed

    def failed(error: Exception, arguments: Sequence[str]) -> int:
        raised.append(error)
        return own(error, arguments)

    entry._failed = failed
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors), limited():
            status = entry.main(arguments)
    finally:
        entry._failed = own
    said = errors.getvalue()
    where = _raised_at(raised[0]) if raised else ""
    if "Traceback" in said or "Warning:" in said:
        raise Fault(f"status {status}: {said[-300:]!r}", where)
    if status == 2:
        lines = [line for line in said.splitlines() if not _is_remark(line)]
        if len(lines) != 1 or not lines[0].startswith("cpic: "):
            raise Fault(f"refused in {len(lines)} lines: {said[-400:]!r}", where)
        check_refusal(lines[0])
        return "refused"
    if status == 130:
        return "at work"
    if status == 0 or (status == 3 and "--strict" in arguments) or (status == 1 and arguments[:1] == ["check"]):
        if "cpic: " in said and "not accepted" in said:
            raise Fault(f"status {status} with a refusal: {said[-300:]!r}", where)
        return "answered"
    raise Fault(f"status {status}: {said[-300:]!r}", where)


def _is_remark(line: str) -> bool:
    """Whether a line of a command is progress or a remark, which may stand before a refusal."""
    return line.startswith("cpic: ") and ": not accepted" not in line and "(see cpic" not in line


@dataclass
class Surface:
    """How the cases of a surface ended, and how long the slowest of them took, in seconds of processor."""

    ended: Counter[str] = field(default_factory=Counter)
    slowest_s: float = 0.0

    def tried(self, case: Case) -> None:
        """Run one case and count it.

        Raises
        ------
        Fault
            With what was drawn.
        """
        kind, shown, run = case
        began = time.process_time()
        try:
            self.ended[run()] += 1
        except Fault as fault:
            raise Fault(f"{kind}: {str(shown)[:1500]}: {fault}") from fault.__cause__
        self.slowest_s = max(self.slowest_s, time.process_time() - began)
