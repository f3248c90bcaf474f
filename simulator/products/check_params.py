"""Check the parameters beside a Level-0 file: that they are what was written, and say what the file says."""

import csv
import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from cpic_core import InputError, parse_json, parse_yaml, read_file
from simulator.config import checked_utc
from simulator.products.check_file import FileFacts
from simulator.products.check_headers import TIME_TOLERANCE_S
from simulator.products.ephemeris import mjd_of
from simulator.products.keywords import KEYWORD_FILE, load_keywords
from simulator.products.reading import Finding, Report, is_real
from simulator.products.write import CONFIGURATION_FILE, PARAMS_FILES, SUM_KEYWORD, sum_of

MAX_BYTES = 50_000_000
"""Size of the largest configuration, list of visits or log that is read."""
LOG_TOLERANCE = 2e-6
"""Logs have six digits behind the point."""
# Columns of the log of attitude, and the keywords of the first and of the last row.
_ENDS = {
    "ra_deg": ("RA_PNT0", "RA_PNT1"),
    "dec_deg": ("DEC_PNT0", "DEC_PNT1"),
    "pos_ang_deg": ("POS_ANG0", "POS_ANG1"),
}
_ENDS |= {f"{axis}_km": tuple(f"POSI{end}_{axis.upper()}" for end in (0, 1)) for axis in "xyz"}  # type: ignore[misc]
_ENDS |= {f"v{axis}_km_s": tuple(f"VELO{end}_{axis.upper()}" for end in (0, 1)) for axis in "xyz"}  # type: ignore[misc]
_OF_SEQUENCE = {
    "FILTER": "band",
    "NFRAME": "n_frames",
    "EXPTIME": "exposure_s",
    "READTIME": "readout_s",
    "SEED": "seed",
}
_OF_SEQUENCE |= {"CAMERA": "camera", "OBSTYPE": "kind"}
_ANGLES = {"sun_deg": "SUNANGL", "moon_deg": "MOONANG", "limb_deg": "TEL_ALT"}  # where the target has coordinates
_ENDS |= {column: (f"{keyword}0", f"{keyword}1") for column, keyword in _ANGLES.items()}


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
    stated = load_keywords().value(facts.primary, SUM_KEYWORD)
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
    table = load_keywords()
    settings = [(key, tree["sequence"][name]) for key, name in _OF_SEQUENCE.items() if tree["sequence"].get(name)]
    own = [("CONFHASH", number), ("OBSID", str(tree.get("obsid", facts.name.obsid)))]
    for key, said in dict.fromkeys((*tree.get("header", {}).items(), *settings, *own)):
        found = table.find(facts.primary, key) if key in table.keywords else None
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
    version, stated = tree.get("schema_version"), load_keywords().value(facts.primary, "KEYTABLE")
    if stated is not None and version != stated:
        report.error(f"is of version {version!r}, KEYTABLE is {stated!r}")


def _check_attitude(report: Report, content: bytes, facts: FileFacts) -> None:
    rows = _rows(report, content, ("utc", *(name for name in _ENDS if name not in _ANGLES)), facts)
    table = load_keywords()
    for column, keywords in _ENDS.items():
        for row, keyword, end in zip((rows[:1], rows[-1:]), keywords, ("first", "last"), strict=True):
            stated = table.value(facts.primary, keyword)
            cell = row[0].get(column) if row else None
            if not cell or not is_real(stated):
                continue
            if not abs(float(cell) - stated) <= LOG_TOLERANCE:
                report.error(f"says {column} = {cell} in its {end} row, {keyword} is {stated}", keyword)


def _check_temperature(report: Report, content: bytes, facts: FileFacts) -> None:
    stated = load_keywords().value(facts.image, "CCDTEMP")
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
    if load_keywords().value(facts.primary, "NFRAME") != len(facts.begins):
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
