"""Check whether every file of a run is what the list in its folder says, and by what it says: `cpic check`.

The record, ``run.json``, has the sum of the list; the list has the sum of every file that the run wrote, that of the
record too, and the fingerprints of the process that began it and of those of other processors that took part. Every
part, FITS file, table and result says which process made it, and must say one of these; parts and tables of a survey
say of which configuration they are.
"""

import hashlib
import os
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from cpic_core import InputError, differing_words, open_file, parse_json, read_file
from cpic_planner.jobs.folder import LIST_NAME, DamagedListError, RunFolder, has_list
from cpic_planner.jobs.job import RECORD
from simulator.products import Finding, check_level0

_MOST_BYTES = 1_000_000_000
_CARD, _MOST_CARDS = 80, 10_000
_FINGERPRINT = re.compile(rb"# - \{fingerprint: (\S+)\}\s*")
_UNREADABLE = (InputError, OSError, ValueError, LookupError, TypeError)
Stated = Mapping[str, Any]
"""Statements of a file about itself: ``fingerprint``, and ``config_hash`` where it can only be that of the run."""


def check_tree(path: str | Path) -> list[Finding]:
    """Check Level-0 files and, where they are those of a run, all that it wrote and what made it.

    Parameters
    ----------
    path : str or Path
        A Level-0 file, a folder of them, or the folder of a run of any kind.

    Returns
    -------
    list of Finding
        Empty if nothing is wrong.

    Raises
    ------
    InputError
        If there is no such file or folder.
    """
    place = Path(path)
    if not place.is_dir() or not has_list(place):
        return check_level0(place)
    try:
        listed = RunFolder.read(place, mend=False)
    except (DamagedListError, InputError) as error:
        return [*check_level0(place), Finding(place / LIST_NAME, None, "", f"cannot be read: {error}")]
    assert listed is not None
    level0 = check_level0(place) if listed.kind == "simulation" else []
    findings = [Finding(place / name, None, "", said) for name, said in _chain(place, listed)]
    return [*level0, *findings]


def _chain(root: Path, listed: RunFolder) -> Iterator[tuple[str, str]]:
    """Yield what is wrong by the name of the file."""
    for other in listed.fingerprints:
        if words := set(differing_words(listed.fingerprints[0], other)) - {"processor"}:
            yield LIST_NAME, f"names processes that differ in {', '.join(sorted(words))}: {other}"
    for name in listed.names():
        yield from ((name, said) for said in _of_file(root / name, name, listed))
    yield from _end(root, listed)


def _of_file(path: Path, name: str, listed: RunFolder) -> Iterator[str]:
    try:
        if listed.standing(name) != "ours":
            yield f"has another sha256 than {LIST_NAME} says"
    except InputError as error:
        yield f"is not where {LIST_NAME} says: {error}"
    reader = _READERS.get("part" if name.startswith("parts/") else path.suffix)
    if reader is None:
        return
    try:
        if (stated := reader(path)) is None:
            return
        made = str(stated["fingerprint"])
    except _UNREADABLE as error:
        yield f"does not say what made it: {type(error).__name__}"
        return
    if made not in listed.fingerprints:
        other = " and ".join(differing_words(listed.fingerprints[0], made))
        yield f"was made with other {other} than {LIST_NAME} says: {made}"
    if stated.get("config_hash", listed.config_hash) != listed.config_hash:
        yield f"is of configuration {stated['config_hash']}, not {listed.config_hash} as {LIST_NAME} says"


def _end(root: Path, listed: RunFolder) -> Iterator[tuple[str, str]]:
    """Yield what a finished run lacks, and whether its list is the one that its record knows."""
    missing = listed.missing()
    if RECORD not in (*listed.names(), *missing):
        if os.path.lexists(root / RECORD):
            yield LIST_NAME, f"does not name {RECORD}, which is there"
        return  # not finished
    for name in missing:
        yield name, f"is not there, and {LIST_NAME} says that it was written"
    if RECORD in missing:
        return
    try:
        tree: Any = parse_json(read_file(root / RECORD, key="record", allowed="a record", max_bytes=_MOST_BYTES))
        stated = str(tree["list_sha256"])
    except _UNREADABLE as error:
        yield RECORD, f"does not say what its list was: {type(error).__name__}"
        return
    if stated not in _sums(root / LIST_NAME):
        yield LIST_NAME, f"has another sha256 than {RECORD} says"


def _sums(path: Path) -> Iterator[str]:
    """Yield the sum of a list up to each of its lines about the record."""
    before = hashlib.sha256()
    for line in read_file(path, key="list", allowed="a list", max_bytes=_MOST_BYTES).splitlines(keepends=True):
        if f'"{RECORD}"'.encode() in line:
            yield before.hexdigest()
        before.update(line)


def _of_part(path: Path) -> Stated:
    with open_file(path, key="part", allowed="a part", max_bytes=_MOST_BYTES) as file:
        return dict(parse_json(file.readline(_MOST_CARDS)))


def _of_json(path: Path) -> Stated | None:
    """Return what a result says; None for one that is no result of its own (a list of files covers it)."""
    tree: Any = parse_json(read_file(path, key="result", allowed="a result", max_bytes=_MOST_BYTES))
    about = tree.get("software") if "obsid" in tree else tree
    if about is None or "fingerprint" not in about:
        return None
    of_parts = {"config_hash": about.get("parts_hash") or about["config_hash"]} if path.name == RECORD else {}
    return {"fingerprint": about["fingerprint"]} | of_parts


def _of_fits(path: Path) -> Stated:
    """Return ``FPRINT`` of the primary header, without reading more of the file."""
    with open_file(path, key="file", allowed="a FITS file", max_bytes=2**63) as file:
        for _ in range(_MOST_CARDS):
            card = file.read(_CARD).decode("ascii")
            if card.startswith("FPRINT  ="):
                return {"fingerprint": card.split("'")[1].strip()}
            if len(card) < _CARD or card.startswith("END     "):
                break
    raise LookupError("FPRINT")


def _of_parquet(path: Path) -> Stated:
    import pyarrow.parquet as pq

    with open_file(path, key="table", allowed="a table", max_bytes=_MOST_BYTES) as file:
        return dict(parse_json(pq.read_schema(file).metadata[b"cpic_planner"]))


def _of_ecsv(path: Path) -> Stated:
    with open_file(path, key="table", allowed="a table", max_bytes=_MOST_BYTES) as file:
        for _ in range(_MOST_CARDS):
            if not (line := file.readline(_MOST_CARDS)).startswith(b"#"):
                break
            if found := _FINGERPRINT.fullmatch(line):
                return {"fingerprint": found[1].decode()}
    raise LookupError("fingerprint")


_READERS: Mapping[str, Callable[[Path], Stated | None]] = {
    "part": _of_part,
    ".json": _of_json,
    ".fits": _of_fits,
    ".parquet": _of_parquet,
    ".ecsv": _of_ecsv,
}
