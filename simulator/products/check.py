"""Check Level-0 products: one file with its truth and its parameters, or a whole tree of them.

Header values are checked against the table of keywords, against each other and against the name. Every complaint is a
finding, and no byte is taken on trust.
"""

import contextlib
import csv
import math
import os
import re
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from io import BufferedReader
from pathlib import Path
from typing import Any, Literal, TypeGuard

import numpy as np

from cpic_core import InputError, Record, as_path, bounded_fits, open_file, parse_json, parse_yaml, read_file, read_text
from simulator.config import SKY_KINDS, checked_utc
from simulator.products.ephemeris import elapsed_s, mjd_of, stamp
from simulator.products.keywords import ALL_ONES, KEYWORD_FILE, Keyword, Profile, load_keywords, ones_sum
from simulator.products.sequence import ProductName
from simulator.products.write import ATTITUDE, CONFIGURATION_FILE, PARAMS_FILES, SUM_KEYWORD, read_section, sum_of

Severity = Literal["error", "warning"]


class Header(dict[str, Any]):
    """Keywords and values of one unit."""

    def find(self, name: str) -> tuple[str, Any] | None:
        """Return the spelling and value of a keyword of the table under any of its spellings; None if it is missing."""
        return load_keywords().find(self, name)

    def value(self, name: str) -> Any:
        """Return the value of a keyword of the table under any of its spellings; None if it is missing."""
        return load_keywords().value(self, name)


class Finding(Record):
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

    def differs(self, value: Any, expected: Any, words: str, keyword: str, hdu: int) -> None:
        """Note a breach where a value is there and is another than the one expected, which the words tell."""
        if value is not None and expected is not None and value != expected:
            self.error(f"is {value!r}, {words}", keyword, hdu)

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


def plain_header(report: Report, units: Any, number: int) -> Header:
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

    values = Header()
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


TIME_TOLERANCE_S = 0.002
SCALE_TOLERANCE = 1e-3
PLACE_TOLERANCE_DEG = 1.0 / 3600.0
ANGLE_TOLERANCE_DEG = 0.01
# Where what a keyword repeats is said, by the fact of the file.
_SAID = {"n_images": "the file has {} images", "number": "this is image {}"}
_SAID |= dict.fromkeys(("obsid", "kind", "camera"), "the file name says {!r}")


def check_keywords(
    report: Report, header: Header, hdu: int, *, kind: str, coordinates: bool, facts: Mapping[str, Any]
) -> None:
    """Check that a header has the keywords of its unit, under any spelling, in their types, and with possible values.

    Parameters
    ----------
    report : Report
    header : mapping
        Keywords and values of one unit.
    hdu : int
        Number of the unit in the file; the primary one is 0.
    kind : str
        Kind of the observation.
    coordinates : bool
        Whether the target has coordinates.
    facts : mapping
        Of the file and its name, by the names that the table of keywords has for them.
    """
    needed = {"always": True, "sky": kind in SKY_KINDS, "coordinates": coordinates and kind in SKY_KINDS}
    for keyword in load_keywords().of("image" if hdu else "primary"):
        found = [spelling for spelling in (keyword.name, *keyword.aliases) if spelling in header]
        if not found:
            if needed.get(keyword.required, False):
                others = f" (or {', '.join(keyword.aliases)})" if keyword.aliases else ""
                report.error(f"is missing{others}", keyword.name, hdu)
            continue
        for spelling in found:
            value = header[spelling]
            if not keyword.fits(value):
                report.error(f"is {value!r}, which is not of type {keyword.kind}", spelling, hdu)
        value, expected = header[found[0]], facts.get(keyword.file)
        if any(header[spelling] != value for spelling in found):
            report.error(f"differs from its other spelling {found[0]}", found[-1], hdu)
        if fault := _out_of_range(keyword, value):
            report.error(f"is {value!r}, not {fault}", keyword.name, hdu)
        report.differs(value, expected, _SAID.get(keyword.file, "").format(expected), keyword.name, hdu)


def _out_of_range(keyword: Keyword, value: Any) -> str:
    """Return what a value had to be and is not, empty if it may be."""
    if isinstance(value, str):
        return repr(keyword.values[0]) if keyword.values and value.strip() not in keyword.values else ""
    if keyword.least is not None and is_real(value) and value < keyword.least:
        return f"at least {keyword.least:g}"
    return f"above {keyword.above:g}" if keyword.above is not None and is_real(value) and value <= keyword.above else ""


def profile_of(header: Header) -> Profile:
    """Return the profile whose spellings a primary header follows best; the first of the table where several do."""
    table = load_keywords()
    return min(table.profiles.values(), key=lambda profile: len(_misspelled(header, 0, profile)))


def check_spellings(report: Report, header: Header, hdu: int, profile: Profile) -> None:
    """Warn where a keyword stands under another spelling only than those of the profile.

    Parameters
    ----------
    report : Report
    header : mapping
        Keywords and values of one unit.
    hdu : int
        Number of the unit in the file; the primary one is 0.
    profile : Profile
    """
    for missing, found in _misspelled(header, hdu, profile):
        report.warning(f"is missing, {found} stands for it", missing, hdu)


def _misspelled(header: Header, hdu: int, profile: Profile) -> list[tuple[str, str]]:
    """Return the spellings of the profile that a header lacks, and those that it has instead."""
    found = []
    for keyword in load_keywords().of("image" if hdu else "primary"):
        present = header.find(keyword.name)
        if present is not None:
            found += [(spelling, present[0]) for spelling in profile[keyword.name] if spelling not in header]
    return found


def check_shared(report: Report, header: Header, first: Header, primary: Header, hdu: int) -> None:
    """Check that an image says of the sequence what the first image and the primary header say of it.

    Every keyword of the table that an image has is compared, but for those that are its own; what is measured for each
    image may differ.

    Parameters
    ----------
    report : Report
    header : mapping
        Keywords and values of one unit.
    first, primary : mapping
        Those of the first image and of the primary unit.
    hdu : int
        Number of the unit in the file; the primary one is 0.
    """
    for keyword in load_keywords().of("image"):
        if keyword.images == "own":
            continue
        found, other = header.find(keyword.name), first.find(keyword.name)
        if found is not None and other is not None and found[1] != other[1]:
            say = report.warning if keyword.images == "measured" else report.error
            say(f"is {found[1]!r}, image 1 has {other[1]!r}", found[0], hdu)
        elif (found is None) != (other is None) and keyword.images != "setting":
            fault = "missing, image 1 has it" if found is None else "there, image 1 lacks it"
            report.warning(f"is {fault}", keyword.name, hdu)
        if hdu == 1 and found is not None and keyword.hdu == "both":
            said = primary.value(keyword.name)
            report.differs(found[1], said, f"the primary header says {said!r}", found[0], hdu)


def check_primary(report: Report, header: Header, name: ProductName | None) -> None:
    """Check number and name of the file in its primary header.

    Parameters
    ----------
    report : Report
    header : mapping
        Keywords and values of the unit.
    name : ProductName or None
    """
    obsid, written = header.value("OBSID"), header.value("FILENAME")
    if isinstance(obsid, str) and re.fullmatch(r"\d{11}", obsid, re.ASCII) is None:
        report.error(f"is {obsid!r}, not 11 digits", "OBSID", 0)
    if name is not None and isinstance(written, str) and written.removesuffix(".fits") != name.stem:
        report.error(f"is {written!r}, not the name of this file", "FILENAME", 0)


def check_times(report: Report, header: Header, name: ProductName | None) -> None:
    """Check that times in the primary header, exposure, readout and the stamps of the name agree.

    Parameters
    ----------
    report : Report
    header : mapping
        Keywords and values of one unit.
    name : ProductName or None
    """
    keys = ("DATE-OBS", "DATE-END", "EXPSTART", "EXPEND", "EXPTIME", "READTIME", "NFRAME")
    get = {key: header.value(key) for key in keys}
    utc: dict[str, str] = {}
    for key in ("DATE-OBS", "DATE-END"):
        if isinstance(get[key], str):
            try:
                utc[key] = checked_utc(key, get[key])
            except InputError:
                report.error(f"is {get[key]!r}, no time as 2028-01-01T00:00:00", key, 0)
    if name is not None:
        for key, digits, word in (("DATE-OBS", name.start, "start"), ("DATE-END", name.end, "end")):
            if key in utc and stamp(utc[key]) != digits:
                report.error(f"is {utc[key]}, the {word} stamp of the name is {digits}", key, 0)
    for key, other in (("DATE-OBS", "EXPSTART"), ("DATE-END", "EXPEND")):
        if key in utc and is_real(get[other]) and abs(mjd_of(utc[key]) - get[other]) * 86400.0 > TIME_TOLERANCE_S:
            report.error(f"is {get[other]!r}, {key} is MJD {mjd_of(utc[key]):.8f}", other, 0)
    if not all(is_real(get[key]) for key in ("EXPSTART", "EXPEND", "EXPTIME", "NFRAME")):
        return
    took, shortest = elapsed_s(get["EXPSTART"], get["EXPEND"]), get["NFRAME"] * get["EXPTIME"]
    if is_real(get["READTIME"]):
        expected = shortest + (get["NFRAME"] - 1) * get["READTIME"]
        if abs(took - expected) > TIME_TOLERANCE_S:
            report.error(f"comes {took:.3f} s after EXPSTART, the frames take {expected:.3f} s", "EXPEND", 0)
    elif took < shortest - TIME_TOLERANCE_S:
        report.error(f"comes {took:.3f} s after EXPSTART, the exposures alone take {shortest:.3f} s", "EXPEND", 0)


def check_world(report: Report, header: Header, primary: Header, hdu: int) -> None:
    """Check that the world coordinates are a sky of square pixels of the stated scale, place and position angle.

    Parameters
    ----------
    report : Report
    header : mapping
        Keywords and values of one unit.
    primary : mapping
        Keywords and values of the primary header.
    hdu : int
        Number of the unit in the file; the primary one is 0.
    """
    cd = [header.value(key) for key in ("CD1_1", "CD1_2", "CD2_1", "CD2_2")]
    if not all(is_real(value) for value in cd):
        return
    a, b, c, d = cd
    determinant = a * d - b * c
    if determinant == 0.0:
        report.error("is singular", "CD1_1", hdu)
        return
    step = math.sqrt(abs(determinant))
    if max(abs(a * a + c * c - step**2), abs(b * b + d * d - step**2), abs(a * b + c * d)) > SCALE_TOLERANCE * step**2:
        report.error("does not describe square pixels", "CD1_1", hdu)
    scale = header.value("PIXSCALE")
    if is_real(scale) and abs(step * 3600.0 - scale) > SCALE_TOLERANCE * abs(scale):
        report.error(f"describes pixels of {step * 3600.0:.6f} arcsec, PIXSCALE is {scale}", "CD1_1", hdu)
    angle = primary.value("POS_ANG1")
    if is_real(angle):
        turn = math.degrees(math.atan2(b, d))
        if abs((turn - angle + 180.0) % 360.0 - 180.0) > ANGLE_TOLERANCE_DEG:
            report.error(f"puts +y at {turn % 360.0:.3f} deg, POS_ANG1 is {angle}", "CD1_2", hdu)
    types = header.get("CTYPE1"), header.get("CTYPE2")
    if types == ("RA---TAN", "DEC--TAN"):
        for key, other in (("CRVAL1", "RA_OBJ"), ("CRVAL2", "DEC_OBJ")):
            value, target = header.get(key), primary.value(other)
            if is_real(value) and is_real(target):
                gap = abs((value - target + 180.0) % 360.0 - 180.0)
                if gap > PLACE_TOLERANCE_DEG:
                    report.error(f"is {value}, {other} is {target}", key, hdu)
        if is_real(header.get("CRVAL2")) and abs(header["CRVAL2"]) > 90.0:
            report.error(f"is {header['CRVAL2']}, no declination", "CRVAL2", hdu)
    elif types != ("EAST", "NORTH") and None not in types:
        known = "RA---TAN and DEC--TAN are known, EAST and NORTH without coordinates"
        report.error(f"is {types[0]!r} with CTYPE2 {types[1]!r}; {known}", "CTYPE1", hdu)


def check_electrons(report: Report, header: Header, hdu: int) -> None:
    """Check that the electrons in a pixel for one count are those at the output divided by the gain of the register.

    Parameters
    ----------
    report : Report
    header : mapping
        Keywords and values of one unit.
    hdu : int
        Number of the unit in the file.
    """
    stated, gain, em_gain = (header.value(key) for key in ("EPERADU", "GAIN", "EMGAIN"))
    register = em_gain if is_real(em_gain) and em_gain > 0 else 1.0
    if is_real(stated) and is_real(gain) and abs(stated - gain / register) > SCALE_TOLERANCE * abs(stated):
        report.error(f"is {stated}, GAIN / EMGAIN is {gain / register:.6g}", "EPERADU", hdu)


@dataclass
class FileFacts:
    """The facts of a Level-0 file that other checks need: parameters, truth and tree.

    ``primary`` and ``image`` are the headers of the primary unit and of the first image; ``begins`` and ``end`` are the
    begin of each exposure and the end of the last, MJD, None where a header does not say.
    """

    path: Path
    name: ProductName | None
    primary: Header = field(default_factory=Header)
    image: Header = field(default_factory=Header)
    begins: list[float | None] = field(default_factory=list)
    end: float | None = None
    shape: tuple[int, ...] | None = None
    datasums: list[str] = field(default_factory=list)
    readable: bool = False


def check_file(path: Path) -> tuple[FileFacts, list[Finding]]:
    """Check one Level-0 file on its own: name, structure, keywords, times, world coordinates, pixels, checksums."""
    report = Report(path)
    packed = path.suffix in PACKED_ENDINGS
    facts = FileFacts(path, ProductName.parse(path.stem if packed else path.name))
    if facts.name is None:
        report.error("has no Level-0 name: CSST_CPIC_{VIS|NIR}_{TYPE}_{start}_{end}_{OBSID}_X_L0_V{nn}.fits")
    elif facts.name.end < facts.name.start:
        report.error("ends before it starts, by its name")
    with open_units(report) as units:
        if units is not None:
            facts.readable = True
            _check_file_units(report, units, facts)
    return facts, report.findings


def _check_file_units(report: Report, units: Any, facts: FileFacts) -> None:
    primary = plain_header(report, units, 0)
    facts.primary = primary
    if units[0].data is not None:
        report.error("has data in its primary unit", hdu=0)
    name, known = facts.name, {"n_images": len(units) - 1}
    kind = str(primary.value("OBSTYPE")) if name is None else name.kind
    said = known if name is None else known | {"obsid": name.obsid, "kind": name.kind, "camera": name.camera}
    if len(units) == 1:
        report.error("has no image")
    headers = [primary, *(plain_header(report, units, number) for number in range(1, len(units)))]
    celestial = any(str(header.get("CTYPE1", "")).startswith("RA") for header in headers[:2])
    asked: dict[str, Any] = {"kind": kind, "coordinates": celestial or primary.find("RA_OBJ") is not None}
    check_keywords(report, primary, 0, **asked, facts=said)
    check_primary(report, primary, name)
    check_times(report, primary, name)
    check_sums(report, units, 0, primary)
    profile = profile_of(primary)
    check_spellings(report, primary, 0, profile)
    earlier: float | None = None
    for number in range(1, len(units)):
        if report.full:
            break
        header = headers[number]
        check_keywords(report, header, number, **asked, facts=said | {"number": number})
        check_spellings(report, header, number, profile)
        check_shared(report, header, headers[1], primary, number)
        _check_image(report, units[number], header, number, facts)
        earlier = _check_frame_times(report, header, primary, number, len(units) - 1, earlier)
        check_electrons(report, header, number)
        if kind in SKY_KINDS or "CTYPE1" in header:
            check_world(report, header, primary, number)
        check_sums(report, units, number, header)
        facts.datasums.append(str(header.get("DATASUM", "")))
        facts.image = headers[1]
        begin, facts.end = (value if is_real(value := header.get(key)) else None for key in ("EXPBEG", "EXPEND"))
        facts.begins.append(begin)


def _check_image(report: Report, unit: Any, header: Header, number: int, facts: FileFacts) -> None:
    """Check structure and pixels of one image."""
    if header.get("XTENSION") != "IMAGE":
        report.error(f"is a {header.get('XTENSION')} extension, not an IMAGE", "XTENSION", number)
        return
    if header.get("EXTNAME") != "IMAGE":
        report.error(f"is {header.get('EXTNAME')!r}, not 'IMAGE'", "EXTNAME", number)
    report.differs(header.get("EXTVER"), number, f"this is image {number}", "EXTVER", number)
    if header.get("EXTVER") is None:
        report.error("is missing", "EXTVER", number)
    bitpix = header.get("BITPIX")
    if (bitpix, header.get("BZERO"), header.get("BSCALE", 1)) != (16, 32768, 1):
        found = f"BITPIX {bitpix}, BZERO {header.get('BZERO')}, BSCALE {header.get('BSCALE')}"
        key = "BZERO" if bitpix == 16 else "BITPIX"
        report.error(f"{found}: unsigned 16-bit pixels have 16, 32768 and 1", key, number)
    shape = unit.shape
    if len(shape) != 2:
        report.error(f"has {len(shape)} axes, an image has 2", "NAXIS", number)
        return
    if facts.shape is None:
        facts.shape = shape
    elif shape != facts.shape:
        there, first = (f"{size[1]} x {size[0]}" for size in (shape, facts.shape))
        report.error(f"has {there} pixels, image 1 has {first}", "NAXIS1", number)
    _check_sections(report, header, shape, number)
    bits = header.get("ADCBITS")
    if bitpix == 16 and header.get("BZERO") == 32768 and isinstance(bits, int) and 1 <= bits <= 16:
        try:
            stored = unit.data
        except (OSError, ValueError, TypeError):
            report.error("has pixels that cannot be read", hdu=number)
            return
        highest = int(np.max(stored)) + 32768 if stored is not None and stored.size else 0
        if highest >= 2**bits:
            report.error(f"has a pixel of {highest} ADU; {bits} bits end at {2**bits - 1}", "ADCBITS", number)


def _check_sections(report: Report, header: Header, shape: tuple[int, ...], number: int) -> None:
    """Check that named parts of the frame lie in it and, in the first image, make it up."""
    total, sound = 0, True
    for keyword in load_keywords():
        if not keyword.section or not isinstance(header.get(keyword.name), str):
            continue
        part = read_section(header[keyword.name], shape)
        if part is None:
            sound = False
            report.error(f"is {header[keyword.name]!r}, no part of the frame", keyword.name, number)
        elif keyword.section != "image":  # which others are part of
            total += math.prod(side.stop - side.start for side in part)
    if number == 1 and sound and total not in (0, shape[0] * shape[1]):
        there = f"has {shape[1]} x {shape[0]} pixels, {shape[0] * shape[1]}"
        report.warning(f"{there}; the parts that its header names have {total}", "NAXIS1", number)


def _check_frame_times(
    report: Report, header: Header, primary: Header, number: int, n_images: int, earlier: float | None
) -> float | None:
    """Check the times of one image against the primary header and the image before; return its end."""
    begin, end, exposure = (header.get(key) for key in ("EXPBEG", "EXPEND", "EXPTIME"))
    if not (is_real(begin) and is_real(end) and is_real(exposure)):
        return earlier
    took = elapsed_s(begin, end)
    if abs(took - exposure) > TIME_TOLERANCE_S:
        report.error(f"comes {took:.3f} s after EXPBEG, EXPTIME is {exposure} s", "EXPEND", number)
    if earlier is not None and (begin - earlier) * 86400.0 < -TIME_TOLERANCE_S:
        report.error("comes before the end of the image before", "EXPBEG", number)
    first, last = primary.get("EXPSTART"), primary.get("EXPEND")
    if number == 1 and is_real(first) and abs(begin - first) * 86400.0 > TIME_TOLERANCE_S:
        report.error(f"is {begin}, EXPSTART is {first}", "EXPBEG", number)
    if number == n_images and is_real(last) and abs(end - last) * 86400.0 > TIME_TOLERANCE_S:
        report.error(f"is {end}, that of the primary header is {last}", "EXPEND", number)
    return float(end)


MAX_BYTES = 50_000_000
"""Size of the largest configuration, list of visits or log that is read."""
LOG_TOLERANCE = 2e-6
"""Logs have six digits behind the point."""


def check_params(file: Path, folder: Path, facts: FileFacts) -> list[Finding]:
    """Check the files of parameters of one Level-0 file.

    Each is compared with its checksum, where the file and its configuration have them: every change of it is found.
    Whoever made them, they are read, and compared with what the headers say: settings, keyword by keyword, times,
    pointing and orbit at both ends, temperature.

    Parameters
    ----------
    file : Path
        The Level-0 file.
    folder : Path
        Where its parameters are.
    facts : FileFacts
        What a check learned of it.
    """
    assert facts.name is not None
    contents: dict[str, bytes] = {}
    found: list[Finding] = []
    for name in PARAMS_FILES:
        place = folder / name
        if not place.exists() and not place.is_symlink():
            continue
        try:
            contents[name] = read_file(place, key="file", allowed="a readable file", max_bytes=MAX_BYTES)
        except InputError as error:
            contents[name] = b""
            found.append(Finding(place, None, "", f"cannot be read: {error.hint or error.allowed}"))
    missing = [name for name in PARAMS_FILES if name not in contents]
    if missing:
        found.append(Finding(file, None, "", f"has no {', '.join(missing)} in {facts.name.params}", "warning"))
    readers: dict[str, Callable[[Report, bytes, FileFacts], None]] = {
        CONFIGURATION_FILE: _check_configuration,
        "keywords.yaml": _check_keywords,
        "attitude.csv": _check_attitude,
        "temperature.csv": _check_temperature,
    }
    sums = _sums(contents, facts)
    for name, content in contents.items():
        if any(finding.path == folder / name for finding in found):
            continue
        report = Report(folder / name)
        stated, where = sums.get(name, (None, ""))
        if stated is not None and stated != sum_of(content)[: len(stated)]:
            report.error(f"is not what was written: its sum is {sum_of(content)[: len(stated)]}, {where} says {stated}")
        try:
            readers[name](report, content, facts)
        except (ValueError, LookupError, TypeError, csv.Error) as error:
            report.error(f"cannot be read: {type(error).__name__}")
        found += report.findings
    return found + _surplus(folder)


def _sums(contents: Mapping[str, bytes], facts: FileFacts) -> dict[str, tuple[str, str]]:
    """Return the sums of the files, and who states them: the primary header its own, that one the others'.

    A configuration that is not what was written states nothing.
    """
    stated = facts.primary.value(SUM_KEYWORD)
    found = {CONFIGURATION_FILE: (stated, facts.path.name)} if isinstance(stated, str) and stated else {}
    configuration = contents.get(CONFIGURATION_FILE, b"")
    if found and not sum_of(configuration).startswith(found[CONFIGURATION_FILE][0]):
        return found
    try:
        listed = parse_json(configuration)["files"]
        return found | {str(name): (str(value), CONFIGURATION_FILE) for name, value in listed.items()}
    except (ValueError, LookupError, TypeError, AttributeError):
        return found


def _check_configuration(report: Report, content: bytes, facts: FileFacts) -> None:
    """Check that a file is what its configuration describes."""
    tree: Any = parse_json(content)
    assert facts.name is not None
    shape, number = tuple(tree["sequence"]["shape"]), str(tree["configuration_hash"])
    about = Report(facts.path)
    if facts.shape is not None and shape != facts.shape:
        there, said = (" x ".join(map(str, reversed(size))) for size in (facts.shape, shape))
        about.error(f"has {there} pixels, {report.path.name} says {said}", "NAXIS1", 1)
    named = {keyword.name: tree["sequence"].get(keyword.configuration) for keyword in load_keywords()}
    settings = [(key, value) for key, value in named.items() if value]
    own = [("CONFHASH", number), ("OBSID", str(tree.get("obsid", facts.name.obsid)))]
    for key, said in dict.fromkeys((*tree.get("header", {}).items(), *settings, *own)):
        found = facts.primary.find(key) if key in load_keywords().keywords else None
        if found is not None and not _same(found[1], said):
            about.error(f"is {found[1]!r}, that of {report.path.name} is {said!r}", found[0], 0)
        elif found is None and key in tree.get("header", {}):
            about.error(f"is missing, {report.path.name} has it", key, 0)
    if Path(tree.get("file", facts.path.name)).name != facts.path.name:
        report.error(f"is of another file, {tree['file']}")
    report.findings += about.findings


def _same(value: Any, other: Any) -> bool:
    if is_real(value) and is_real(other):
        return math.isclose(value, other, rel_tol=1e-12, abs_tol=0.0)
    return bool(value == other)


def _check_keywords(report: Report, content: bytes, facts: FileFacts) -> None:
    """Check that a table of keywords can be read, and is of the version that the file names."""
    if content == KEYWORD_FILE.read_bytes():
        return
    try:
        tree = parse_yaml(content.decode("utf-8"), where=report.path.name, quoting=False)
    except InputError as error:
        report.error(f"cannot be read: {error}")
        return
    if not isinstance(tree, dict) or not isinstance(tree.get("keywords"), dict):
        report.error("is no table of keywords")
        return
    version, stated = tree.get("schema_version"), facts.primary.value("KEYTABLE")
    if stated is not None and version != stated:
        report.error(f"is of version {version!r}, KEYTABLE is {stated!r}")


def _check_attitude(report: Report, content: bytes, facts: FileFacts) -> None:
    rows = _rows(report, content, ("utc", *ATTITUDE), facts)
    for keyword in load_keywords():
        stated = facts.primary.value(keyword.name)
        for column, row, end in ((keyword.first, rows[:1], "first"), (keyword.last, rows[-1:], "last")):
            cell = row[0].get(column) if row else None
            if cell and is_real(stated) and not abs(float(cell) - stated) <= LOG_TOLERANCE:
                report.error(f"says {column} = {cell} in its {end} row, {keyword.name} is {stated}", keyword.name)


def _check_temperature(report: Report, content: bytes, facts: FileFacts) -> None:
    stated = facts.image.value("CCDTEMP")
    for number, row in enumerate(_rows(report, content, ("utc", "detector_k"), facts), start=1):
        cell = row["detector_k"]
        if cell and is_real(stated) and not abs(float(cell) - stated) <= LOG_TOLERANCE:
            report.error(f"says {cell} K in row {number}, CCDTEMP is {stated}", "CCDTEMP")
            return


def _rows(report: Report, content: bytes, needed: Iterable[str], facts: FileFacts) -> list[dict[str, str]]:
    """Return the rows of a log: one for the begin of each exposure, and one for the end of the last."""
    reader = csv.DictReader(content.decode("ascii").splitlines(), strict=True)
    lacking = [name for name in needed if name not in (reader.fieldnames or ())]
    if lacking:
        report.error(f"has no column {', '.join(lacking)}")
        return []
    if facts.primary.value("NFRAME") != len(facts.begins):
        return []  # images are missing, which is said
    rows = list(reader)
    expected = [*facts.begins, facts.end]
    if len(rows) != len(expected):
        report.error(f"has {len(rows)} rows for {len(facts.begins)} exposures and the end of the last")
        return []
    for number, (row, mjd) in enumerate(zip(rows, expected, strict=True), start=1):
        if None in row or None in row.values():
            report.error(f"has another number of cells in row {number} than in its heading")
            return []
        wrong = [name for name, cell in row.items() if name != "utc" and cell and not math.isfinite(float(cell))]
        if wrong:
            report.error(f"has no number in row {number}, column {wrong[0]}")
        try:
            time = mjd_of(checked_utc("utc", row["utc"]))
        except InputError:
            report.error(f"has no time in row {number}: {row['utc'][:40]!r}")
            continue
        if mjd is not None and abs(time - mjd) * 86400.0 > TIME_TOLERANCE_S:
            report.error(f"says {row['utc']} in row {number}, the exposures say MJD {mjd:.8f}")
    return rows


def _surplus(folder: Path) -> list[Finding]:
    """Return the files among the parameters that are none."""
    names = sorted(place.name for place in folder.iterdir()) if folder.is_dir() else []
    return [
        Finding(folder / name, None, "", "does not belong among parameters", "warning")
        for name in names
        if name not in PARAMS_FILES and not name.endswith(".part")  # which is named anyway
    ]


_MAPS = ("EXPECTED_ADU", "EXPECTED_E")


def check_truth(path: Path, facts: FileFacts) -> list[Finding]:
    """Check one truth file against what a check learned of its Level-0 file."""
    report = Report(path)
    with open_units(report, raw=True) as units:
        if units is not None:
            _check_truth_units(report, units, facts)
    return report.findings


def _check_truth_units(report: Report, units: Any, facts: FileFacts) -> None:
    headers = [plain_header(report, units, number) for number in range(len(units))]
    header = headers[0]
    for keyword in sorted(load_keywords(), key=lambda each: each.truth != "identity"):
        mine, other = header.value(keyword.name), facts.primary.value(keyword.name)
        if mine != other and (keyword.truth == "identity" or (mine is not None and keyword.truth != "own")):
            report.error(f"is {mine!r}, that of {facts.path.name} is {other!r}", keyword.name, 0)
    if header.get("L0FILE") != facts.path.name:
        report.error(f"is {header.get('L0FILE')!r}, not {facts.path.name!r}", "L0FILE", 0)
    for number, one in enumerate(headers):
        check_sums(report, units, number, one)
    names = [str(one.get("EXTNAME", "")) for one in headers]
    for name in (*_MAPS, "FRAMES"):
        if name not in names:
            report.error(f"has no {name}")
            continue
        number = names.index(name)
        if name in _MAPS and facts.shape is not None and units[number].shape != facts.shape:
            report.error(f"has shape {units[number].shape}, the images have {facts.shape}", "NAXIS1", number)
        for keyword in load_keywords():
            mine, other = headers[number].get(keyword.name), facts.image.get(keyword.name)
            if keyword.name != "BUNIT":
                report.differs(mine, other, f"that of image 1 is {other!r}", keyword.name, number)
    masks = [number for number, name in enumerate(names) if name == "MASK"]
    if len(masks) != len(facts.datasums):
        report.error(f"has {len(masks)} masks for {len(facts.datasums)} images")
    for count, number in enumerate(masks, start=1):
        _check_mask(report, headers[number], number, count, facts)
    if "FRAMES" in names:
        _check_frames(report, units[names.index("FRAMES")], names.index("FRAMES"), facts)


def _check_mask(report: Report, header: Header, number: int, count: int, facts: FileFacts) -> None:
    if header.get("EXTVER", 1) != count:
        report.error(f"is {header.get('EXTVER')!r}, this is mask {count}", "EXTVER", number)
    if not header.get("ZIMAGE") or header.get("ZBITPIX") != 8:
        report.error("is no compressed image of bytes", "ZIMAGE", number)
    shape = (header.get("ZNAXIS2"), header.get("ZNAXIS1"))
    if facts.shape is not None and shape != facts.shape:
        report.error(f"has shape {shape}, the images have {facts.shape}", "ZNAXIS1", number)


def _check_frames(report: Report, unit: Any, number: int, facts: FileFacts) -> None:
    """Check that the rows belong to the images: each carries the sum of the image's data."""
    if unit.header.get("NAXIS2") != len(facts.datasums):  # before any of them is read
        report.error(f"has {unit.header.get('NAXIS2')} rows for {len(facts.datasums)} images", "NAXIS2", number)
        return
    names = [] if unit.data is None else unit.columns.names
    if "datasum" not in names:
        report.error("has no column datasum", hdu=number)
        return
    sums = [str(value) for value in unit.data["datasum"].tolist()]
    wrong = [row for row, pair in enumerate(zip(sums, facts.datasums, strict=True), start=1) if pair[0] != pair[1]]
    if wrong:
        rows = ", ".join(str(row) for row in wrong[:5]) + (", ..." if len(wrong) > 5 else "")
        report.error(f"belongs to other images than those in {facts.path.name}: rows {rows}", "DATASUM", number)


PROGRAMME_FILE = "programme.json"
"""Name of the list of the visits of a programme, beside their folders."""
_BRANCHES = ("SCI", "CAL")
CUBE_FOLDER = "Cubes"
"""Name of the folder with frames for other programs, which are no Level-0 files."""


def check_level0(path: str | Path) -> list[Finding]:
    """Check a Level-0 file, or every file of a tree, against the specification.

    Of a file: name, structure, keywords, their types and spellings, times against each other and the name, world
    coordinates, settings of the camera, keywords of all images against each other, pixel values against the converter,
    checksums; and, where the file stands in a tree, its folder, its truth, and all files of its parameters. Of a tree,
    moreover: numbers that are used twice, parameters and truth without a file, files that do not belong or are no
    regular files, and visits that are not as their programme lists them.

    Only regular files are opened, and none that is larger than any product; they are read piece by piece.

    Parameters
    ----------
    path : str or Path
        A file, or a folder: the root of a tree, or any folder with Level-0 files below it.

    Returns
    -------
    list of Finding
        Empty if nothing is wrong.

    Raises
    ------
    InputError
        If there is no such file or folder.
    """
    place = as_path("path", path)
    if os.path.isfile(place):
        facts, findings = _check_one(place)
        return findings
    if not os.path.isdir(place):
        kind = "neither: a pipe, a socket or a device" if os.path.exists(place) else ""
        raise InputError("path", str(place), allowed="a regular file or a folder that exists", hint=kind)
    files, findings = _below(place)
    known: list[FileFacts] = []
    for file in files:
        if CUBE_FOLDER in file.relative_to(place).parts[:-1]:
            continue
        if file.suffix == ".part":
            findings.append(Finding(file, None, "", "is what an interrupted run left", "warning"))
        elif not file.is_file() and file.suffix != ".fits":
            findings.append(Finding(file, None, "", "is no regular file: it is not opened"))
        elif _branch(file) == "Truth" or file.name.endswith("_TRUTH.fits"):
            findings += _orphan(file)
        elif file.suffix == ".fits" or (file.suffix in PACKED_ENDINGS and ".fits" in file.suffixes):
            facts, found = _check_one(file)
            findings += found
            known.append(facts)
        elif _branch(file) in _BRANCHES:
            findings.append(Finding(file, None, "", "does not belong among Level-0 files", "warning"))
    if not known:
        findings.append(Finding(place, None, "", "has no Level-0 file"))
    listed = [item for file in files if file.name == PROGRAMME_FILE for item in _check_programme(file, known)]
    return findings + _used_twice(known) + _unclaimed(files, known) + listed


def _below(place: Path) -> tuple[list[Path], list[Finding]]:
    """Return all files below a folder, in order; and folders that are passed over, or look like files.

    Folders are not entered through links, which may lead anywhere and back.
    """
    files: list[Path] = []
    found: list[Finding] = []

    def closed(error: OSError) -> None:
        found.append(Finding(Path(error.filename), None, "", f"cannot be looked into: {error.strerror}"))

    for base, folders, names in os.walk(place, onerror=closed):
        folders.sort()
        files += [Path(base, name) for name in names]
        for folder in (Path(base, name) for name in folders):
            if folder.is_symlink():
                found.append(Finding(folder, None, "", "is a link to a folder: it is not followed", "warning"))
            elif folder.suffix == ".fits":
                found.append(Finding(folder, None, "", "is a folder, and has the name of a file"))
    return sorted(files), found


def _unclaimed(files: list[Path], known: list[FileFacts]) -> list[Finding]:
    """Return the folders of parameters whose Level-0 file is not there."""
    claimed = {facts.name.params for facts in known if facts.name is not None}
    folders = sorted({file.parent for file in files if file.parent.parent.parent.name == "Params"})
    text = "has the parameters of a Level-0 file that is not there"
    return [
        Finding(folder, None, "", text, "warning")
        for folder in folders
        if Path(*folder.parts[-3:]) not in claimed and any((folder / name).exists() for name in PARAMS_FILES)
    ]


def _branch(file: Path) -> str:
    """Return the branch of the tree in which a file stands, ``branch/<MJD>/file``."""
    return file.parent.parent.name if file.parent.name.isdigit() else ""


def _check_one(file: Path) -> tuple[FileFacts, list[Finding]]:
    """Check one file and, if it stands in a tree, its folder, truth and parameters."""
    facts, findings = check_file(file)
    if not facts.readable:
        return facts, findings
    if facts.name is None or file.resolve().parent.parent.name not in _BRANCHES:
        return facts, findings
    return facts, findings + _check_place(file, facts)


def _check_place(file: Path, facts: FileFacts) -> list[Finding]:
    assert facts.name is not None
    found: list[Finding] = []
    whole = file.resolve()
    folder, branch, root = whole.parent.name, whole.parent.parent.name, whole.parents[2]
    expected = "SCI" if facts.name.kind in SKY_KINDS else "CAL"
    if branch != expected:
        found.append(Finding(file, None, "", f"stands in {branch}, {facts.name.kind} belongs in {expected}"))
    begin = facts.primary.value("EXPSTART")
    if is_real(begin) and folder != str(int(begin // 1)):
        found.append(Finding(file, 0, "EXPSTART", f"is MJD {begin:.5f}, the file stands in folder {folder}"))
    truth = root / "Truth" / folder / f"{facts.name.stem}_TRUTH.fits"
    if truth.is_file():
        found += check_truth(truth, facts)
    elif (root / "Truth").is_dir():  # a tree may go without, as a whole
        found.append(Finding(file, None, "", f"has no truth: {truth.relative_to(root)}", "warning"))
    return found + check_params(file, root / facts.name.params, facts)


def _check_programme(path: Path, known: list[FileFacts]) -> list[Finding]:
    """Check that the visits of a programme are there, and say of themselves what its list says."""
    listed = {keyword.name: keyword.programme for keyword in load_keywords() if keyword.programme}
    try:
        tree: Any = parse_json(read_text(path, key="file", allowed="a readable file", max_bytes=MAX_BYTES))
        rows = [{"file": str(row["file"])} | {key: row[key] for key in listed.values()} for row in tree["sequences"]]
        own = [key for key in listed.values() if key not in ("role", "visit", "n_visits", "window")]
        rows += [{key: row[key] for key in ("file", *own)} for row in tree.get("calibrations", ())]
    except (OSError, ValueError, LookupError, TypeError) as error:
        return [Finding(path, None, "", f"cannot be read: {type(error).__name__}")]
    headers = {facts.path.resolve(): facts.primary for facts in known}
    found = []
    for row in rows:
        file = path.parent / row["file"]
        header = headers.get(file.resolve())
        if header is None:
            found.append(Finding(path, None, "", f"lists {row['file']}, which is no Level-0 file of this tree"))
            continue
        for keyword, key in listed.items():
            if key not in row:
                continue
            value = header.value(keyword)
            near = is_real(value) and is_real(row[key]) and abs(value - row[key]) * 86400.0 <= TIME_TOLERANCE_S
            if value != row[key] and not near:
                found.append(Finding(file, 0, keyword, f"is {value!r}, {path.name} says {row[key]!r}"))
    return found


def _orphan(file: Path) -> list[Finding]:
    """Return the truth whose Level-0 file is missing; where it is there, the two are checked together."""
    name = f"{file.name.removesuffix('_TRUTH.fits')}.fits"
    folder = file.parent.resolve()
    if any((folder.parent.parent / branch / folder.name / name).is_file() for branch in _BRANCHES):
        return []
    return [Finding(file, None, "", "is the truth of a Level-0 file that is not there", "warning")]


def _used_twice(known: list[FileFacts]) -> list[Finding]:
    """Return the numbers that more than one observation has."""
    by_number: dict[str, list[FileFacts]] = defaultdict(list)
    for facts in known:
        if facts.name is not None:
            by_number[facts.name.obsid].append(facts)
    found = []
    for number, several in by_number.items():
        names = {facts.name.stem for facts in several if facts.name is not None}
        times = {facts.name.times for facts in several if facts.name is not None}
        if len(times) > 1 or len(names) < len(several):
            first = several[0].path.name
            found += [Finding(facts.path, 0, "OBSID", f"{number} is that of {first} too") for facts in several[1:]]
    return found
