"""What every command shares: error lines, JSON on stdout, consoles, progress on stderr."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, TypeVar

from pydantic import BaseModel

from cpic_planner.cli.progress import is_quiet, progress, rest
from cpic_planner.version import DISTRIBUTION, PACKAGES, __version__

if TYPE_CHECKING:
    from rich.console import Console

    from cpic_planner.jobs.job import Finished

R = TypeVar("R", bound=BaseModel)

__all__ = ["console", "error_line", "is_quiet", "note", "print_cost", "print_json", "progress", "version_text"]


def error_line(text: str, status: int) -> int:
    """Write one line to stderr and hand back the exit status."""
    with contextlib.suppress(BrokenPipeError):
        sys.stderr.write(f"cpic: {' '.join(text.split())}\n")
        sys.stderr.flush()
    return status


def note(text: str) -> None:
    """Write a remark to stderr unless quiet."""
    if not is_quiet():
        sys.stderr.write(f"cpic: {text}\n")


def print_json(result: BaseModel) -> None:
    """The result as JSON on stdout and nothing else there."""
    from simulator.files import dump_json

    rest()
    sys.stdout.write(dump_json(result.model_dump(mode="json")))


def print_cost(cost: Mapping[str, float], what: str, workers: int, as_json: bool) -> None:
    """What a run of simulated images would take, as a line or as JSON."""
    from simulator.files import dump_json

    line = (
        f"{what}, {cost['n_realisations']} realisations, {cost['n_frames']} frames drawn one by one, about "
        f"{cost['wall_s']:.0f} s with {workers} worker(s), {cost['memory_mb']:.0f} MB memory a worker, "
        f"{cost['disk_mb']:.1f} MB disk\n"
    )
    rest()
    sys.stdout.write(dump_json(dict(cost)) if as_json else line)


def shown(title: str, total: int, start: Callable[..., Finished[R]], piece: str = "piece") -> Finished[R]:
    """Run a job with progress on stderr, and say how much of it was there already.

    Parameters
    ----------
    title : str
        What is done.
    total : int
        Steps of progress.
    start : callable
        Runs the job, given ``advance`` and ``command`` as `cpic_planner.jobs.job.run` takes them.
    piece : str
        What its tasks are called.
    """
    with progress(title, total=total) as advance:
        done = start(advance=advance, command=sys.argv[1:])
    if done.resumed_parts:
        note(f"reused {done.resumed_parts} finished {piece}{'s' * (done.resumed_parts != 1)} of an earlier run")
    return done


def console() -> Console:
    """Console for tables on stdout; honours NO_COLOR and pipes."""
    from rich.console import Console

    rest()
    plain = None if sys.stdout.isatty() else 110
    return Console(width=plain, highlight=False)


def version_text() -> str:
    """Version, data vintage, and whether the generic top-level packages are this distribution's own."""
    from importlib import metadata, util
    from pathlib import Path

    from catalogs.info import snapshot_vintage

    home = Path(__file__).resolve().parents[2]
    lines = [f"{DISTRIBUTION} {__version__}", f"star table: {snapshot_vintage()}"]
    try:
        owners = metadata.packages_distributions()
    except Exception:
        owners = {}
    for package in PACKAGES:
        spec = util.find_spec(package)
        place = Path(spec.origin).resolve().parent.parent if spec and spec.origin else None
        foreign = sorted(set(owners.get(package, ())) - {DISTRIBUTION})
        state = "ok" if place == home and not foreign else f"also claimed by {', '.join(foreign) or place}"
        lines.append(f"package {package}: owned by {DISTRIBUTION} ({state})")
    return "\n".join(lines)
