"""Open FITS files for a check: every complaint is a finding, and no byte is taken on trust."""

import contextlib
import math
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from io import BufferedReader
from pathlib import Path
from typing import Any, Literal, TypeAlias, TypeGuard

from cpic_core import InputError, bounded_fits, open_file
from simulator.products.units import ALL_ONES, ones_sum

Header: TypeAlias = Mapping[str, Any]
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
        self._note(Finding(self.path, hdu, keyword, message))

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
        self._note(Finding(self.path, hdu, keyword, message, "warning"))

    @property
    def full(self) -> bool:
        """Whether so much is wrong that the rest is not listed."""
        return len(self.findings) > _MOST_FINDINGS

    def _note(self, finding: Finding) -> None:
        if len(self.findings) == _MOST_FINDINGS:
            finding = Finding(self.path, None, "", f"has more than {_MOST_FINDINGS} faults: the rest is not listed")
        if not self.full:
            self.findings.append(finding)


_PACKED = {b"\x1f\x8b": "gunzip", b"BZh": "bunzip2", b"\xfd7zXZ": "unxz", b"\x1f\x9d": "uncompress"}
_PACKED |= {b"PK\x03\x04": "unzip", b"\x28\xb5\x2f\xfd": "unzstd"}
"""Programs that unpack files, by the first bytes of these."""
PACKED_ENDINGS = (".gz", ".bz2", ".xz", ".Z", ".zip", ".zst", ".fz")
_PIECE_BYTES = 1 << 22
# More than any product has: a file, a header, a unit, units of a file; and findings that say enough about one.
_MOST_BYTES, _MOST_OF_UNIT = 200_000_000_000, 200_000_000
_MOST_UNITS, _MOST_FINDINGS = 50_000, 1000
# What astropy raises over files that lie about themselves.
_DAMAGE = (OSError, ValueError, TypeError, LookupError, AttributeError, ArithmeticError, AssertionError)


@contextlib.contextmanager
def open_units(report: Report, *, raw: bool = False) -> Iterator[Any]:
    """Open the file of a report as an ``HDUList`` with every unit read; None if it is not FITS.

    What astropy warns of, while opening and while in use, becomes a finding. ``raw`` shows compressed images as the
    tables that hold them.

    Parameters
    ----------
    report : Report
    raw : bool, optional
        Whether compressed images show as tables.
    """
    from astropy.io import fits

    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        stack = contextlib.ExitStack()
        units = None
        try:
            file = stack.enter_context(_file_of(report))
            units = _opened(report, file, raw=raw)
        except InputError as error:
            report.error(f"is not readable as FITS: {error.hint or f'only {error.allowed} is read'}")
        try:
            yield units
        except (*_DAMAGE, fits.VerifyError) as error:
            report.error(f"cannot be read further: {_first_line(error)}")
        finally:
            if units is not None:
                units.close()
            stack.close()
            for text in dict.fromkeys(str(item.message).splitlines()[0] for item in said):
                if "truncated" not in text.lower():  # said already, with numbers
                    report.error(f"astropy warns: {text}")


def _file_of(report: Report) -> contextlib.AbstractContextManager[BufferedReader]:
    return open_file(report.path, key="file", allowed="a readable file", max_bytes=_MOST_BYTES)


def _opened(report: Report, file: BufferedReader, *, raw: bool) -> Any:
    """Read every header of a file; None if that is not possible."""
    from astropy.io import fits

    head, units = file.peek(8), None
    if program := next((name for magic, name in _PACKED.items() if head.startswith(magic)), ""):
        report.error(f"is compressed: unpack it with {program}")
        return None
    try:
        size = report.path.stat().st_size
        units = fits.open(bounded_fits(file), memmap=True, do_not_scale_image_data=True, disable_image_compression=raw)
        last = _last(units)
    except (*_DAMAGE, fits.VerifyError) as error:
        report.error(f"is not readable as FITS: {_first_line(error)}")
        if units is not None:
            units.close()
        return None
    if not raw and any(isinstance(unit, fits.CompImageHDU) for unit in units):
        report.error("is compressed: unpack it with funpack")
        units.close()
        return None
    end = last["datLoc"] + last["datSpan"]
    if size < end:
        report.error(f"is truncated: {size} bytes, {end} are described")
    elif size > end:
        report.error(f"is longer than described by {size - end} bytes: {size} bytes, {end} are described")
    return units


def _last(units: Any) -> dict[str, Any]:
    """Return where the last unit lies.

    Raises
    ------
    ValueError
        If there are more than any product has, or one is larger than any of a product.
    """
    for number in range(_MOST_UNITS):
        place: dict[str, Any] = units[number].fileinfo()
        if place["datSpan"] > _MOST_OF_UNIT:
            raise ValueError(f"unit {number} has {place['datSpan']} bytes, no unit of a product has {_MOST_OF_UNIT}")
        try:
            units[number + 1]
        except IndexError:
            return place
    raise ValueError(f"it has more than {_MOST_UNITS} units")


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]


def plain_header(report: Report, units: Any, number: int) -> dict[str, Any]:
    """Return the header of one unit as keywords and values; bad cards, and those that stand twice, are findings.

    Parameters
    ----------
    report : Report
    units : object
        Units of the open file.
    number : int
        Number of the unit; the primary one is 0.
    """
    from astropy.io import fits

    values: dict[str, Any] = {}
    for card in units[number].header.cards:
        try:
            keyword, value = card.keyword, card.value
        except (*_DAMAGE, fits.VerifyError):
            report.error("has a card that cannot be read", str(card.rawkeyword)[:8].strip(), number)
            continue
        if keyword in values and keyword not in ("COMMENT", "HISTORY", ""):
            report.error("stands twice", keyword, number)
        values.setdefault(keyword, value)
    return values


def check_sums(report: Report, units: Any, number: int, header: Header) -> None:
    """Check ``CHECKSUM`` and ``DATASUM`` of one unit against the bytes in the file.

    Parameters
    ----------
    report : Report
    units : object
        Units of the open file.
    number : int
        Number of the unit; the primary one is 0.
    header : mapping
        Keywords and values of one unit.
    """
    place = units[number].fileinfo()
    missing = [key for key in ("CHECKSUM", "DATASUM") if key not in header]
    for key in missing:
        report.error("is missing", key, number)
    if missing:
        return
    with _file_of(report) as file:
        file.seek(place["hdrLoc"])
        head = file.read(place["datLoc"] - place["hdrLoc"])
        data_sum, left = 0, place["datSpan"]
        while left:
            piece = file.read(min(left, _PIECE_BYTES))
            if len(piece) != min(left, _PIECE_BYTES):
                return  # truncated, which is a finding already
            data_sum, left = ones_sum(piece, data_sum), left - len(piece)
    stated = whole_number(header["DATASUM"])
    if stated != data_sum:
        report.error(f"is {header['DATASUM']}, the data sum to {data_sum}", "DATASUM", number)
    if ones_sum(head, data_sum) not in (0, ALL_ONES):
        report.error("does not agree with the content of the unit", "CHECKSUM", number)


def whole_number(value: Any) -> int | None:
    """Return an integer in digits as a number, None for anything else."""
    text = str(value).strip()
    return int(text) if text.isascii() and text.isdigit() else None


def is_real(value: Any) -> TypeGuard[float]:
    """Return whether a header value is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
