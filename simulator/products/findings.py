"""What a check found wrong."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

__all__ = ["Finding", "Report"]

Severity = Literal["error", "warning"]


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong.

    Attributes
    ----------
    path : Path
        The file or folder.
    hdu : int or None
        Number of the unit, 0 for the primary one; None for the file as a whole.
    keyword : str
        The keyword, empty if the finding is about none.
    message : str
        What is wrong, in one sentence.
    severity : {"error", "warning"}
        Error: against the specification. Warning: unusual, or missing where the specification leaves it open.
    """

    path: Path
    hdu: int | None
    keyword: str
    message: str
    severity: Severity = "error"

    def __str__(self) -> str:
        unit = "" if self.hdu is None else f"[{self.hdu}]"
        keyword = f" {self.keyword}:" if self.keyword else ""
        return f"{self.severity}: {self.path}{unit}:{keyword} {self.message}"


@dataclass
class Report:
    """Collects findings about one file."""

    path: Path
    findings: list[Finding] = field(default_factory=list)

    def error(self, message: str, keyword: str = "", hdu: int | None = None) -> None:
        """Note a breach of the specification.

        Parameters
        ----------
        message : str
            One sentence for people.
        keyword : str, optional
            Keyword at fault; empty for the file.
        hdu : int, optional
            Number of the unit in the file; the primary one is 0.
        """
        self.findings.append(Finding(self.path, hdu, keyword, message))

    def warning(self, message: str, keyword: str = "", hdu: int | None = None) -> None:
        """Note something unusual.

        Parameters
        ----------
        message : str
            One sentence for people.
        keyword : str, optional
            Keyword that it is about; empty for the file.
        hdu : int, optional
            Number of the unit in the file; the primary one is 0.
        """
        self.findings.append(Finding(self.path, hdu, keyword, message, "warning"))
