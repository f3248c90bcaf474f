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


class Lines:
    """Plain lines, for a pipe, a file or a log.

    Parameters
    ----------
    write : callable
        Takes a line without its end.
    """

    def __init__(self, write: Callable[[str], None]) -> None:
        self._write = write

    def tick(self, work: Work, now: float) -> None:
        """Write a line where one is due."""
        if now - work.began < SHOW_AFTER_S:
            return
        if work.shown_at is not None:
            since = now - work.shown_at
            further = work.text != work.shown_text
            if work.total:
                further = work.done - work.shown_done >= TENTH * work.total
            if since < LINE_EVERY_S or (now - work.began > DENSE_S and since < DENSE_S and not further):
                return
        work.shown_at, work.shown_done, work.shown_text = now, work.done, work.text
        self._write(f"cpic: {work.line(now)}")

    def hide(self) -> None:
        """Do nothing: lines of a log are not cleared."""

    def end(self, work: Work, now: float) -> None:
        """Close with one line what was begun with one."""
        if work.shown_at is not None:
            self._write(f"cpic: {work.title}: done in {_duration(now - work.began)}")


class Bar:
    """A bar on a terminal, cleared when the work is done."""

    def __init__(self) -> None:
        self._bar: RichProgress | None = None

    def tick(self, work: Work, now: float) -> None:
        """Draw or refresh the bar."""
        if now - work.began < SHOW_AFTER_S:
            return
        if self._bar is None:
            self._bar = _rich_bar(counted=work.total is not None)
            self._bar.start()
            self._bar.add_task(work.title, total=work.total)
        task = self._bar.tasks[0]
        task.start_time = self._bar.get_time() - (now - work.began)
        described = f"{work.title}: {work.text}" if work.text else work.title
        self._bar.update(task.id, completed=work.done, description=visible(described))
        work.shown_at = now

    def hide(self) -> None:
        """Take the bar away."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None

    def end(self, work: Work, now: float) -> None:
        """Take the bar away: the results follow."""
        self.hide()


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
    """Keeps what is being worked on, and has it shown; also takes the announcements of the simulator.

    Parameters
    ----------
    display : Bar or Lines
        Shows how far work is.
    title : str
        What is worked on where nothing else is said.
    clock : callable
        Time in s.
    """

    def __init__(self, display: Bar | Lines, title: str, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(logging.INFO)
        self._display, self._clock = display, clock
        self._stack = [Work(title, clock())]
        self._mutex = threading.RLock()

    def tick(self) -> None:
        """Show what is due now."""
        with self._mutex:
            if not is_quiet():
                self._display.tick(self._stack[-1], self._clock())

    def emit(self, record: logging.LogRecord) -> None:
        """Take an announcement as what is done from now on."""
        with self._mutex:
            self._stack[-1].text = record.getMessage()

    def rest(self) -> None:
        """Clear the screen: what follows is the output of the command."""
        with self._mutex:
            self._display.hide()
            self._stack[-1].restart(self._clock())

    @contextlib.contextmanager
    def working(self, title: str, total: int) -> Iterator[Advance]:
        """Show the work in ``total`` pieces; yield `Advance`."""
        with self._mutex:
            self._display.hide()
            work = Work(title, self._clock(), total)
            self._stack.append(work)

        def advance(text: str, steps: int = 1, /) -> None:
            with self._mutex:
                work.done += steps
                work.text = text
                self._display.tick(work, self._clock())

        try:
            yield advance
            with self._mutex:
                self._display.end(work, self._clock())
        finally:
            with self._mutex:
                self._display.hide()
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
    reporter = Reporter(Bar() if sys.stderr.isatty() else Lines(write_line), title)
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
