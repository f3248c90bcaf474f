"""Write the tables and pictures of the committed reports: what their scripts share."""

import base64
import csv
import io
import os
import platform
import statistics
import textwrap
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from cpic_core import write_bytes
from cpic_planner.report.drawing import Picture

Cells = Mapping[str, str | Callable[[Any], object]]
"""By the heading of a column: how the cell of a row is written, as a format or by a function."""


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return rows as a table of Markdown.

    Parameters
    ----------
    head : sequence of str
    rows : sequence of sequence of object
    """
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def columns(rows: Iterable[Any], cells: Cells) -> str:
    """Return rows as a table of Markdown, a column for each heading.

    Parameters
    ----------
    rows : iterable of object
        Mappings, whose fields a format names, or objects, whose attributes it takes as ``{0.name}``.
    cells : mapping of str to str or callable
        By heading: how the cell of a row is written, as a format or by a function.
    """

    def cell(row: Any, how: str | Callable[[Any], object]) -> object:
        return how.format(row, **(row if isinstance(row, Mapping) else {})) if isinstance(how, str) else how(row)

    return table(list(cells), [[cell(row, how) for how in cells.values()] for row in rows])


def verdict(checks: Iterable[tuple[str, str, str, bool | None]]) -> str:
    """Return the table of what was asked and what was found.

    Parameters
    ----------
    checks : iterable of tuple of str, str, str and bool or None
        What is checked, what is asked, what is found, and whether that is enough; None where nothing is asked.
    """
    met = {True: "yes", False: "**no**", None: ""}
    return table(["", "asked", "found", "met"], [(*words, met[fine]) for *words, fine in checks])


def bulleted(paragraphs: Iterable[str]) -> str:
    """Return paragraphs as the points of a list, in lines of 120 characters.

    Parameters
    ----------
    paragraphs : iterable of str
    """
    form = textwrap.TextWrapper(120, initial_indent="- ", subsequent_indent="  ", break_on_hyphens=False)
    form.break_long_words = False
    return "\n".join(map(form.fill, paragraphs))


@dataclass(frozen=True)
class Timing:
    """Median times of a job.

    Attributes
    ----------
    job : str
    cpu_s, wall_s : float
        Processor time and wall clock, s.
    """

    job: str
    cpu_s: float
    wall_s: float


def timed(job: str, run: Callable[[], object], rounds: int = 5) -> Timing:
    """Return the median times of a job, which is run once before it counts.

    Parameters
    ----------
    job : str
        Its name.
    run : callable
    rounds : int, optional
        How often it is timed.
    """
    run()
    cpu, wall = [], []
    for _ in range(rounds):
        began = time.process_time(), time.perf_counter()
        run()
        cpu.append(time.process_time() - began[0])
        wall.append(time.perf_counter() - began[1])
    return Timing(job, statistics.median(cpu), statistics.median(wall))


def csv_text(rows: Sequence[Mapping[str, object]]) -> str:
    """Return rows as CSV, numbers with six digits; the keys of the first are the head.

    Parameters
    ----------
    rows : sequence of mapping of str to object
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n", extrasaction="ignore")
    writer.writeheader()
    for row in rows:
        writer.writerow({key: f"{value:.6g}" if isinstance(value, float) else value for key, value in row.items()})
    return text.getvalue()


def png(figure: Figure, dpi: float = 110) -> bytes:
    """Return a figure as a file without date and program.

    Parameters
    ----------
    figure : Figure
    dpi : float
    """
    with io.BytesIO() as image:
        figure.savefig(image, format="png", dpi=dpi, metadata={"Software": None})
        return image.getvalue()


def write_picture(folder: Path, name: str, picture: Picture) -> str:
    """Write a picture of a page into a folder and return the name of its file.

    Parameters
    ----------
    folder : Path
    name : str
        Without suffix.
    picture : Picture
    """
    head, data = picture.uri.split(",", 1)
    file = f"{name}{'.svg' if 'svg' in head else '.png'}"
    write_bytes(folder / file, base64.b64decode(data))
    return file


def machine(*packages: str) -> str:
    """Return the processor, Python, and the versions of packages.

    Parameters
    ----------
    *packages : str
    """
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    name = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "processor")
    versions = [f"Python {platform.python_version()}", *(f"{one} {metadata.version(one)}" for one in packages)]
    return f"{name} ({platform.machine()}, {os.cpu_count()} cores), {', '.join(versions)}"
