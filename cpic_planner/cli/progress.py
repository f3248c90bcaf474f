"""Progress of a command on stderr while it works: a bar on a terminal, lines in a pipe or a file.

Work that ends within two seconds is not mentioned. A bar shows what is done now; lines come at the start, then at most
every ten seconds, and after the first minute only with a tenth of the pieces, another kind of work, or a minute more.
"""

from __future__ import annotations

import contextlib
import logging
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from cpic_core import LOGGER, Advance, untold, visible

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress


VerboseOption: TypeAlias = Annotated[
    int, typer.Option("-v", "--verbose", count=True, help="More messages (twice: debug).", show_default=False)
]
QuietOption: TypeAlias = Annotated[bool, typer.Option("-q", "--quiet", help="Errors only, no progress.")]


def set_loudness(verbose: int, quiet: bool) -> None:
    """Set the level of messages."""
    level = logging.ERROR if quiet else (logging.WARNING, logging.INFO, logging.DEBUG)[min(verbose, 2)]
    for package in ("cpic_core", "catalogs", "simulator", "cpic_planner"):
        logging.getLogger(package).setLevel(level)


SHOW_AFTER_S = 2.0
LINE_EVERY_S = 10.0
DENSE_S = 60.0  # lines every ten seconds for so long
TENTH = 0.1
_TICK_S = 0.25


def is_quiet() -> bool:
    """Return whether ``-q`` was given."""
    return logging.getLogger("cpic_planner").getEffectiveLevel() >= logging.ERROR


def is_verbose() -> bool:
    """Return whether ``-v`` was given."""
    return logging.getLogger("cpic_planner").getEffectiveLevel() <= logging.INFO


@dataclass
class Work:
    """One piece of work: its title, how far it has come, and what was shown of it (times in s)."""

    title: str
    began: float
    total: int | None = None
    text: str = ""
    done: int = 0
    shown_at: float | None = None
    shown_done: int = 0
    shown_text: str = ""

    def restart(self, now: float) -> None:
        """Count from now on as work that has not been mentioned."""
        self.began, self.shown_at, self.text = now, None, ""

    def is_due(self, now: float) -> bool:
        """Return whether a line about it is due."""
        if self.shown_at is None:
            return True
        since, further = now - self.shown_at, self.text != self.shown_text
        if self.total:
            further = self.done - self.shown_done >= TENTH * self.total
        return since >= LINE_EVERY_S and (further or since >= DENSE_S or now - self.began <= DENSE_S)

    def line(self, now: float) -> str:
        """Return how far it has come, in a line."""
        elapsed = now - self.began
        parts = [f"{_duration(elapsed)} so far"]
        if self.total:
            parts.insert(0, f"{self.done} of {self.total} done")
            if 0 < self.done < self.total:
                parts.append(f"about {_duration(elapsed * (self.total - self.done) / self.done)} left")
        return f"{self.title}{': ' * bool(self.text)}{self.text} ({', '.join(parts)})"


def _duration(seconds: float) -> str:
    minutes = round(seconds / 60.0)
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 120 else f"{seconds / 3600:.1f} h"


def _rich_bar(*, counted: bool) -> RichProgress:
    from rich import progress as rich
    from rich.console import Console

    text, elapsed = rich.TextColumn("{task.description}", markup=False), rich.TimeElapsedColumn()
    columns: tuple[rich.ProgressColumn, ...] = (rich.SpinnerColumn(), text, elapsed)
    if counted:
        left = rich.TextColumn("left"), rich.TimeRemainingColumn()
        columns = (text, rich.BarColumn(), rich.MofNCompleteColumn(), elapsed, *left)
    # Results go to stdout, which may be a file while the bar is on a terminal: it stays as it is.
    return rich.Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=False)


class Reporter(logging.Handler):
    """Keeps what is being worked on, and shows it; also takes the announcements of the simulator.

    Parameters
    ----------
    title : str
        What is worked on where nothing else is said.
    write : callable, optional
        Takes a line without its end, for a pipe, a file or a log; without, a bar on a terminal shows how far work is,
        and is cleared when that is done.
    clock : callable
        Time in s.
    """

    def __init__(
        self, title: str, write: Callable[[str], None] | None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__(logging.INFO)
        self._write, self._clock = write, clock
        self._stack = [Work(title, clock())]
        self._mutex = threading.RLock()
        self._bar: RichProgress | None = None

    def tick(self) -> None:
        """Show what is due now."""
        with self._mutex:
            work, now = self._stack[-1], self._clock()
            if is_quiet() or now - work.began < SHOW_AFTER_S:
                return
            if self._write is None:
                self._draw(work, now)
            elif work.is_due(now):
                work.shown_at, work.shown_done, work.shown_text = now, work.done, work.text
                self._write(f"cpic: {work.line(now)}")

    def _draw(self, work: Work, now: float) -> None:
        """Draw or refresh the bar."""
        if self._bar is None:
            self._bar = _rich_bar(counted=work.total is not None)
            self._bar.start()
            self._bar.add_task(work.title, total=work.total)
        task = self._bar.tasks[0]
        task.start_time = self._bar.get_time() - (now - work.began)
        described = f"{work.title}: {work.text}" if work.text else work.title
        self._bar.update(task.id, completed=work.done, description=visible(described))

    def _hide(self) -> None:
        """Take the bar away; lines of a log are not cleared."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None

    def emit(self, record: logging.LogRecord) -> None:
        """Take an announcement as what is done from now on."""
        with self._mutex:
            self._stack[-1].text = record.getMessage()

    def rest(self) -> None:
        """Clear the screen: what follows is the output of the command."""
        with self._mutex:
            self._hide()
            self._stack[-1].restart(self._clock())

    @contextlib.contextmanager
    def working(self, title: str, total: int) -> Iterator[Advance]:
        """Show the work in ``total`` pieces; yield `Advance`."""
        with self._mutex:
            self._hide()
            work = Work(title, self._clock(), total)
            self._stack.append(work)

        def advance(text: str, steps: int = 1, /) -> None:
            with self._mutex:
                work.done += steps
                work.text = text
                self.tick()

        try:
            yield advance
            if work.shown_at is not None and self._write is not None:
                self._write(f"cpic: {work.title}: done in {_duration(self._clock() - work.began)}")
        finally:
            with self._mutex:
                self._hide()
                self._stack.remove(work)
                self._stack[-1].restart(self._clock())


_active: list[Reporter] = []


@contextlib.contextmanager
def watch(title: str) -> Iterator[Reporter]:
    """Show what is worked on from now on, in the way that fits stderr.

    Parameters
    ----------
    title : str
        What is worked on where nothing else is said.
    """
    reporter = Reporter(title, None if sys.stderr.isatty() else write_line)
    stop, announcements = threading.Event(), logging.getLogger(LOGGER)

    def run() -> None:
        while not stop.wait(_TICK_S):
            reporter.tick()

    before = announcements.level, announcements.propagate
    announcements.setLevel(logging.INFO)
    announcements.propagate = logging.getLogger("cpic_planner").isEnabledFor(logging.INFO)  # as lines too with -v
    announcements.addHandler(reporter)
    thread = threading.Thread(target=run, name="progress", daemon=True)
    thread.start()
    _active.append(reporter)
    try:
        yield reporter
    finally:
        _active.remove(reporter)
        stop.set()
        thread.join()
        reporter.rest()
        announcements.removeHandler(reporter)
        announcements.level, announcements.propagate = before


def write_line(text: str) -> None:
    """Write a line to stderr; where it cannot be written, this and what follows is lost, and nothing else."""
    try:
        sys.stderr.write(f"{visible(text)}\n")
        sys.stderr.flush()
    except (OSError, ValueError):
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115 - to the end of the process, which writes what is left there


@contextlib.contextmanager
def progress(title: str, total: int) -> Iterator[Advance]:
    """Show the work in ``total`` pieces, if any, on stderr unless quiet; yield ``advance(text, steps)``."""
    if total < 1 or is_quiet():
        yield untold
        return
    with contextlib.ExitStack() as stack:
        reporter = _active[-1] if _active else stack.enter_context(watch(title))
        yield stack.enter_context(reporter.working(title, total))


def rest() -> None:
    """Clear the screen for the output of a command."""
    if _active:
        _active[-1].rest()
