"""Check whether every part and product of a run was made by what the list in its folder says: `cpic check`.

The list of the run names the fingerprint of the process that began it, and those of other processors that took part.
Every part, FITS file, table and result says which process made it, and must say one of these.
"""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from cpic_core import InputError, differing_words, open_file, parse_json, read_file
from cpic_planner.jobs.written_files import LIST_NAME, DamagedListError, WrittenFiles, has_list
from simulator.products import Finding, check_level0

_MOST_BYTES = 1_000_000_000
_CARD, _BLOCK, _MOST_CARDS = 80, 2880, 10_000


def check_tree(path: str | Path) -> list[Finding]:
    """Check Level-0 files and, where they are those of a run, what made its parts and products.

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
        listed = WrittenFiles.read(place, mend=False)
    except (DamagedListError, InputError) as error:
        return [*check_level0(place), Finding(place / LIST_NAME, None, "", f"cannot be read: {error}")]
    assert listed is not None
    level0 = check_level0(place) if listed.kind == "simulation" else []
    return [*level0, *_chain(place, listed)]


def _chain(root: Path, listed: WrittenFiles) -> Iterator[Finding]:
    for name in listed.names():
        path = root / name
        reader = _READERS.get("part" if name.startswith("parts/") else path.suffix)
        if reader is None:
            continue
        try:
            stated = reader(path)
        except (InputError, OSError, ValueError, LookupError, TypeError) as error:
            yield Finding(path, None, "", f"does not say what made it: {type(error).__name__}")
            continue
        if stated is not None and stated not in listed.fingerprints:
            other = " and ".join(differing_words(listed.fingerprints[0], stated))
            yield Finding(path, None, "", f"was made with other {other} than {LIST_NAME} says: {stated}")


def _of_part(path: Path) -> str:
    with open_file(path, key="part", allowed="a part", max_bytes=_MOST_BYTES) as file:
        return str(parse_json(file.readline(_MOST_CARDS))["fingerprint"])


def _of_json(path: Path) -> str | None:
    """Return what a result says; None for one that is no result of its own (a list of files covers it)."""
    tree: Any = parse_json(read_file(path, key="result", allowed="a result", max_bytes=_MOST_BYTES))
    about = tree.get("software") if "obsid" in tree else tree
    return None if about is None or "fingerprint" not in about else str(about["fingerprint"])


def _of_fits(path: Path) -> str:
    """Return ``FPRINT`` of the primary header, without reading more of the file."""
    with open_file(path, key="file", allowed="a FITS file", max_bytes=2**63) as file:
        for _ in range(_MOST_CARDS):
            card = file.read(_CARD).decode("ascii")
            if card.startswith("FPRINT  ="):
                return card.split("'")[1].strip()
            if len(card) < _CARD or card.startswith("END     "):
                break
    raise LookupError("FPRINT")


def _of_table(path: Path) -> str:
    import pyarrow.parquet as pq

    with open_file(path, key="table", allowed="a table", max_bytes=_MOST_BYTES) as file:
        return str(parse_json(pq.read_schema(file).metadata[b"cpic_planner"])["fingerprint"])


_READERS: Mapping[str, Callable[[Path], str | None]] = {
    "part": _of_part,
    ".json": _of_json,
    ".fits": _of_fits,
    ".parquet": _of_table,
}
