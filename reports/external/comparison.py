"""What a comparison with somebody else's numbers consists of, and how the report shows it."""

from __future__ import annotations

import importlib
import json
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

HERE = Path(__file__).resolve().parent
NEGLIGIBLE = 0.01  # part of a tolerance below which differences are not shown
GIVEN = "given.npz"
# Sections of the report in their order; the modules in `comparisons`.
ORDER = (
    "rates",
    "stark",
    "stellar_flux",
    "cgi_noise",
    "pyedith",
    "csst_sky",
    "emccd_detect",
    "getframes",
    "pyklip",
    "hcipy",
    "vip",
    "exosims",
    "yippy",
    "paper",
)


@dataclass(frozen=True)
class Reference:
    """Whose numbers they are.

    Attributes
    ----------
    name, version : str
        Of the package, table or article.
    source : str
        Where it is: repository and path, article, or package index name.
    packages : tuple of str
        Requirements of an environment in which it runs; none where the numbers are published.
    """

    name: str
    version: str
    source: str
    packages: tuple[str, ...] = ()


@dataclass(frozen=True)
class Row:
    """One number of ours beside one of somebody else.

    Attributes
    ----------
    what : str
        The quantity and its case, with the unit.
    theirs, ours : float or str
        The two; words where the answer is a refusal.
    tolerance : float
        Largest difference that agrees, as a fraction of theirs (of 1 where `absolute`); above 0. It is chosen before
        the comparison from what the two model, and `why` says from what.
    why : str
        Why the two differ as far as they do, in a sentence.
    absolute : bool
        Whether the difference itself is compared.
    expected : bool
        False where the two are known to disagree: the row shows by how much and `why` explains it. It does not count
        as agreement.
    """

    what: str
    theirs: float | str
    ours: float | str
    tolerance: float
    why: str = ""
    absolute: bool = False
    expected: bool = True

    @property
    def difference(self) -> float:
        """Ours less theirs, as a fraction of theirs unless `absolute`; 0 or infinite where either is a word."""
        if isinstance(self.ours, str) or isinstance(self.theirs, str):
            return 0.0 if self.ours == self.theirs else math.inf
        return (self.ours - self.theirs) / (1.0 if self.absolute else abs(self.theirs))

    @property
    def agrees(self) -> bool:
        """Whether the difference is within the tolerance."""
        return abs(self.difference) <= self.tolerance


def comparisons() -> Iterator[tuple[str, ModuleType]]:
    """Yield the name and the module of every comparison, in the order of the report.

    A module has ``TITLE`` (str), ``TEXT`` (str, what is compared and what follows from it), ``REFERENCE``
    (`Reference`) and ``rows(recorded)``, which works ours out anew and returns `Row` objects; ``recorded`` is what
    ``recorded/NAME.json`` holds. One with many numbers has ``MAIN``, a regular expression that the quantities of its
    main ones match; the others stand on a page of their own. Where the other code can be run, ``peer()`` runs it and
    returns what is recorded; it is called in the other's environment, so that such a module imports nothing of ours at
    its top. What both start from is made by a seed in both environments, or by ``given()`` in ours: arrays, which
    ``peer()`` reads from the file `GIVEN` of its working directory.
    """
    for name in ORDER:
        yield name, importlib.import_module(f"reports.external.comparisons.{name}")


def recorded(name: str) -> Any:
    """Return the recorded numbers of a comparison, with the versions and the date of their run."""
    return json.loads((HERE / "recorded" / f"{name}.json").read_text(encoding="utf-8"))


def shown(value: float | str) -> str:
    """Return a number with four digits, or a word."""
    return value if isinstance(value, str) else f"{value:.4g}"


def anchor(title: str) -> str:
    """Return the fragment by which a page links to one of its headings."""
    return re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-")


def table(rows: list[Row]) -> str:
    """Return rows as a table."""
    heads = ("quantity", "theirs", "ours", "difference", "tolerance", "agrees", "why they differ")
    lines = [f"| {' | '.join(heads)} |", "|" + "---|" * len(heads)]
    for row in rows:
        words = isinstance(row.ours, str) or isinstance(row.theirs, str)
        scale = 1.0 if row.absolute else 100.0
        unit = "" if row.absolute else " %"
        size = scale * row.difference
        least = NEGLIGIBLE * scale * row.tolerance  # what lies below hangs on the processor
        differs = "" if words else f"{size:+.2g}{unit}" if abs(size) > least else f"below {least:.2g}{unit}"
        answer = "yes" if row.agrees else "**no**" if row.expected else "no, known"
        tolerance = "" if words else f"{scale * row.tolerance:.3g}{unit}"
        cells = (row.what, shown(row.theirs), shown(row.ours), differs, tolerance, answer, row.why)
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def section(name: str, module: ModuleType, rows: list[Row]) -> str:
    """Return the section of the report about one comparison: its main rows where it has many."""
    reference = module.REFERENCE
    lines = [f"## {module.TITLE}", "", f"{reference.name} {reference.version}; {reference.source}.", ""]
    lines += [module.TEXT.strip(), ""]
    main = [row for row in rows if re.search(getattr(module, "MAIN", ""), row.what)]
    if len(main) < len(rows):
        lines += [f"{len(main)} of {len(rows)} numbers; the others are in [rows/{name}.md](rows/{name}.md).", ""]
    return "\n".join([*lines, table(main)])


def page(module: ModuleType, rows: list[Row]) -> str:
    """Return the page with every number of one comparison."""
    return (
        f"# {module.TITLE}: every number\n\nWhat is compared is said in [the report](../report.md).\n\n{table(rows)}\n"
    )
