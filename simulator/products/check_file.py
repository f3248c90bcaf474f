"""Check one Level-0 file."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from simulator.products import check_headers
from simulator.products.ephemeris import elapsed_s
from simulator.products.keywords import load_keywords
from simulator.products.naming import ProductName
from simulator.products.reading import (
    PACKED_ENDINGS,
    Finding,
    Header,
    Report,
    check_sums,
    is_real,
    open_units,
    plain_header,
)
from simulator.products.sequence import SCIENCE_KINDS

_SECTION = re.compile(r"\[(\d+):(\d+),(\d+):(\d+)\]", re.ASCII)


@dataclass
class FileFacts:
    """The facts of a Level-0 file that other checks need: parameters, truth and tree.

    ``primary`` and ``image`` are the headers of the primary unit and of the first image; ``begins`` and ``end`` are the
    begin of each exposure and the end of the last, MJD, None where a header does not say.
    """

    path: Path
    name: ProductName | None
    primary: Mapping[str, Any] = field(default_factory=dict)
    image: Mapping[str, Any] = field(default_factory=dict)
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
            _check_units(report, units, facts)
    return facts, report.findings


def _check_units(report: Report, units: Any, facts: FileFacts) -> None:
    table = load_keywords()
    primary = plain_header(report, units, 0)
    facts.primary = primary
    if units[0].data is not None:
        report.error("has data in its primary unit", hdu=0)
    kind = facts.name.kind if facts.name is not None else str(table.value(primary, "OBSTYPE"))
    if len(units) == 1:
        report.error("has no image")
    headers = [primary, *(plain_header(report, units, number) for number in range(1, len(units)))]
    known = any(str(header.get("CTYPE1", "")).startswith("RA") for header in headers[:2])
    coordinates = known or table.find(primary, "RA_OBJ") is not None
    check_headers.check_keywords(report, primary, 0, kind=kind, coordinates=coordinates)
    check_headers.check_primary(report, primary, facts.name, len(units) - 1)
    check_headers.check_times(report, primary, facts.name)
    check_sums(report, units, 0, primary)
    profile = check_headers.profile_of(primary)
    check_headers.check_spellings(report, primary, 0, profile)
    earlier: float | None = None
    for number in range(1, len(units)):
        if report.full:
            break
        header = headers[number]
        check_headers.check_keywords(report, header, number, kind=kind, coordinates=coordinates)
        check_headers.check_spellings(report, header, number, profile)
        check_headers.check_settings(report, header, headers[1], number)
        check_headers.check_shared(report, header, headers[1], primary, number)
        _check_image(report, units, header, number, facts)
        earlier = _check_frame_times(report, header, primary, number, len(units) - 1, earlier)
        if kind in SCIENCE_KINDS or "CTYPE1" in header:
            check_headers.check_world(report, header, primary, number)
        check_sums(report, units, number, header)
        facts.datasums.append(str(header.get("DATASUM", "")))
        facts.image = headers[1]
        begin, facts.end = (value if is_real(value := header.get(key)) else None for key in ("EXPBEG", "EXPEND"))
        facts.begins.append(begin)


def _check_image(report: Report, units: Any, header: Header, number: int, facts: FileFacts) -> None:
    """Check structure and pixels of one image."""
    unit = units[number]
    if header.get("XTENSION") != "IMAGE":
        report.error(f"is a {header.get('XTENSION')} extension, not an IMAGE", "XTENSION", number)
        return
    if header.get("EXTNAME") != "IMAGE":
        report.error(f"is {header.get('EXTNAME')!r}, not 'IMAGE'", "EXTNAME", number)
    for key in ("EXTVER", "FRAMEID"):
        if header.get(key, number) != number:
            report.error(f"is {header[key]!r}, this is image {number}", key, number)
    if header.get("EXTVER") is None:
        report.error("is missing", "EXTVER", number)
    n_images = len(units) - 1
    if header.get("NFRAME", n_images) != n_images:
        report.error(f"is {header['NFRAME']!r}, the file has {n_images} images", "NFRAME", number)
    camera = facts.name.camera if facts.name is not None else header.get("CAMERA")
    if header.get("CAMERA", camera) != camera:
        report.error(f"is {header['CAMERA']!r}, the file name says {camera!r}", "CAMERA", number)
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
        found = _SECTION.fullmatch(header[keyword.name])
        numbers = [] if found is None else [int(part) for part in found.groups()]
        inside = numbers and 1 <= numbers[0] <= numbers[1] <= shape[1] and 1 <= numbers[2] <= numbers[3] <= shape[0]
        if not inside:
            sound = False
            report.error(f"is {header[keyword.name]!r}, no part of the frame", keyword.name, number)
        elif keyword.section != "image":  # which others are part of
            total += (numbers[1] - numbers[0] + 1) * (numbers[3] - numbers[2] + 1)
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
    if abs(took - exposure) > check_headers.TIME_TOLERANCE_S:
        report.error(f"comes {took:.3f} s after EXPBEG, EXPTIME is {exposure} s", "EXPEND", number)
    if header.get("EXPTIME") != primary.get("EXPTIME", header.get("EXPTIME")):
        report.error(f"is {exposure}, the primary header says {primary['EXPTIME']}", "EXPTIME", number)
    if earlier is not None and (begin - earlier) * 86400.0 < -check_headers.TIME_TOLERANCE_S:
        report.error("comes before the end of the image before", "EXPBEG", number)
    first, last = primary.get("EXPSTART"), primary.get("EXPEND")
    if number == 1 and is_real(first) and abs(begin - first) * 86400.0 > check_headers.TIME_TOLERANCE_S:
        report.error(f"is {begin}, EXPSTART is {first}", "EXPBEG", number)
    if number == n_images and is_real(last) and abs(end - last) * 86400.0 > check_headers.TIME_TOLERANCE_S:
        report.error(f"is {end}, that of the primary header is {last}", "EXPEND", number)
    return float(end)
