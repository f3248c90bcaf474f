"""Check Level-0 products: one file with its truth and its parameters, or a whole tree of them."""

import csv
import math
import os
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from cpic_core import InputError, as_path, parse_json, parse_yaml, read_file, read_text
from simulator.config import checked_utc
from simulator.products.check_file import FileFacts, check_file
from simulator.products.check_headers import TIME_TOLERANCE_S
from simulator.products.ephemeris import mjd_of
from simulator.products.keywords import KEYWORD_FILE, load_keywords
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
