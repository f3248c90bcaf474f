"""Check that the truth beside a Level-0 file is the truth of that file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from simulator.products.check_file import FileFacts
from simulator.products.findings import Finding, Report
from simulator.products.keywords import load_keywords
from simulator.products.reading import check_sums, open_units, plain_header

__all__ = ["check_truth"]

_SAME = ("CAMERA", "OBSID", "OBSTYPE", "NFRAME", "DATE-OBS", "DATE-END", "EXPTIME", "CONFHASH", "SCENHASH", "SEED")
_MAPS = ("EXPECTED_ADU", "EXPECTED_E")


def check_truth(path: Path, facts: FileFacts) -> list[Finding]:
    """Check one truth file against what a check learned of its Level-0 file.

    Parameters
    ----------
    path : Path
    facts : FileFacts
    """
    report = Report(path)
    with open_units(report, raw=True) as units:
        if units is not None:
            _check_units(report, units, facts)
    return report.findings


def _check_units(report: Report, units: Any, facts: FileFacts) -> None:
    table = load_keywords()
    headers = [plain_header(report, units, number) for number in range(len(units))]
    header = headers[0]
    for key in _SAME:
        mine, other = table.value(header, key), table.value(facts.primary, key)
        if mine != other:
            report.error(f"is {mine!r}, that of {facts.path.name} is {other!r}", key, 0)
    if header.get("L0FILE") != facts.path.name:
        report.error(f"is {header.get('L0FILE')!r}, not {facts.path.name!r}", "L0FILE", 0)
    for number, one in enumerate(headers):
        check_sums(report, units, number, one)
    names = [str(one.get("EXTNAME", "")) for one in headers]
    for name in (*_MAPS, "FRAMES"):
        if name not in names:
            report.error(f"has no {name}")
        elif name in _MAPS and facts.shape is not None and units[names.index(name)].shape != facts.shape:
            report.error(
                f"has shape {units[names.index(name)].shape}, the images have {facts.shape}",
                "NAXIS1",
                names.index(name),
            )
    masks = [number for number, name in enumerate(names) if name == "MASK"]
    if len(masks) != len(facts.datasums):
        report.error(f"has {len(masks)} masks for {len(facts.datasums)} images")
    for count, number in enumerate(masks, start=1):
        _check_mask(report, headers[number], number, count, facts)
    if "FRAMES" in names:
        _check_frames(report, units[names.index("FRAMES")], names.index("FRAMES"), facts)


def _check_mask(report: Report, header: Mapping[str, Any], number: int, count: int, facts: FileFacts) -> None:
    if header.get("EXTVER", 1) != count:
        report.error(f"is {header.get('EXTVER')!r}, this is mask {count}", "EXTVER", number)
    if not header.get("ZIMAGE") or header.get("ZBITPIX") != 8:
        report.error("is no compressed image of bytes", "ZIMAGE", number)
    shape = (header.get("ZNAXIS2"), header.get("ZNAXIS1"))
    if facts.shape is not None and shape != facts.shape:
        report.error(f"has shape {shape}, the images have {facts.shape}", "ZNAXIS1", number)


def _check_frames(report: Report, unit: Any, number: int, facts: FileFacts) -> None:
    """Check that the rows belong to the images: each carries the sum of the image's data."""
    names = [] if unit.data is None else unit.columns.names
    if "datasum" not in names:
        report.error("has no column datasum", hdu=number)
        return
    sums = [str(value) for value in unit.data["datasum"].tolist()]
    if len(sums) != len(facts.datasums):
        report.error(f"has {len(sums)} rows for {len(facts.datasums)} images", "NAXIS2", number)
        return
    wrong = [row for row, pair in enumerate(zip(sums, facts.datasums, strict=True), start=1) if pair[0] != pair[1]]
    if wrong:
        rows = ", ".join(str(row) for row in wrong[:5]) + (", ..." if len(wrong) > 5 else "")
        report.error(f"belongs to other images than those in {facts.path.name}: rows {rows}", "DATASUM", number)
