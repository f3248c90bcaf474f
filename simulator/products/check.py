"""Check Level-0 products: one file with its truth, or a whole tree of them."""

import os
from collections import defaultdict
from pathlib import Path
from typing import Any

from cpic_core import InputError, as_path, parse_json, read_text
from simulator.products.check_file import FileFacts, check_file
from simulator.products.check_headers import TIME_TOLERANCE_S
from simulator.products.check_params import MAX_BYTES, check_params
from simulator.products.keywords import load_keywords
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
from simulator.products.write import PARAMS_FILES

_SAME = (
    "CAMERA",
    "OBSID",
    "OBSTYPE",
    "NFRAME",
    "DATE-OBS",
    "DATE-END",
    "EXPTIME",
    "CONFHASH",
    "SCENHASH",
    "SEED",
    "FPRINT",
)
_OF_THE_TRUTH = ("FILENAME", "L0FILE")
_MAPS = ("EXPECTED_ADU", "EXPECTED_E")


def check_truth(path: Path, facts: FileFacts) -> list[Finding]:
    """Check one truth file against what a check learned of its Level-0 file."""
    report = Report(path)
    with open_units(report, raw=True) as units:
        if units is not None:
            _check_units(report, units, facts)
    return report.findings


def _check_units(report: Report, units: Any, facts: FileFacts) -> None:
    table = load_keywords()
    headers = [plain_header(report, units, number) for number in range(len(units))]
    header = headers[0]
    others = [keyword.name for keyword in table if keyword.name not in (*_SAME, *_OF_THE_TRUTH)]
    for key in (*_SAME, *others):
        mine, other = table.value(header, key), table.value(facts.primary, key)
        if mine != other and (key in _SAME or mine is not None):
            report.error(f"is {mine!r}, that of {facts.path.name} is {other!r}", key, 0)
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
        for keyword in table:
            mine, other = headers[number].get(keyword.name), facts.image.get(keyword.name)
            if keyword.name != "BUNIT" and None not in (mine, other) and mine != other:
                report.error(f"is {mine!r}, that of image 1 is {other!r}", keyword.name, number)
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
_OF_VISIT = {"VISIT": "visit", "NVISITS": "n_visits", "VISWIN": "window", "ROLE": "role", "OBSID": "obsid"}
_OF_VISIT |= {"NFRAME": "n_frames", "EXPSTART": "begin_mjd"}
_BRANCHES = ("SCI", "CAL")


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
    expected = "SCI" if facts.name.kind in SCIENCE_KINDS else "CAL"
    if branch != expected:
        found.append(Finding(file, None, "", f"stands in {branch}, {facts.name.kind} belongs in {expected}"))
    begin = load_keywords().value(facts.primary, "EXPSTART")
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
    try:
        tree: Any = parse_json(read_text(path, key="file", allowed="a readable file", max_bytes=MAX_BYTES))
        rows = [{"file": str(row["file"])} | {key: row[key] for key in _OF_VISIT.values()} for row in tree["sequences"]]
    except (OSError, ValueError, LookupError, TypeError) as error:
        return [Finding(path, None, "", f"cannot be read: {type(error).__name__}")]
    headers = {facts.path.resolve(): facts.primary for facts in known}
    table, found = load_keywords(), []
    for row in rows:
        file = path.parent / row["file"]
        header = headers.get(file.resolve())
        if header is None:
            found.append(Finding(path, None, "", f"lists {row['file']}, which is no Level-0 file of this tree"))
            continue
        for keyword, key in _OF_VISIT.items():
            value = table.value(header, keyword)
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
