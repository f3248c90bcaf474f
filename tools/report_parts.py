"""Write the tables and pictures of the committed reports: what their scripts share."""

import base64
import csv
import io
import os
import platform
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path

from matplotlib.figure import Figure

from cpic_core import write_bytes
from cpic_planner.report.drawing import Picture


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return rows as a table of Markdown.

    Parameters
    ----------
    head : sequence of str
    rows : sequence of sequence of object
    """
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


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
