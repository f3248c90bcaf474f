"""The one place where files that somebody named are opened for reading.

A name comes from a user, or from a file that a user named, and may lead anywhere. Only regular files are opened (a link
to one too), never a pipe or a device, none that is larger than its reader allows, and no more than that is ever read.

Where files come over a network, they are what was sent (`only_sent_files`): no name leads to the disk then, but to
what the package ships.
"""

import contextlib
import errno
import hashlib
import math
import os
import re
import stat
from collections.abc import Iterator, Mapping
from contextvars import ContextVar
from io import BufferedReader, BytesIO
from pathlib import Path
from typing import BinaryIO

from cpic_core.errors import InputError

_KINDS = (
    (stat.S_ISDIR, "this is a folder"),
    (stat.S_ISFIFO, "this is a pipe"),
    (stat.S_ISSOCK, "this is a socket"),
    (stat.S_ISREG, ""),
)

_PART_BYTES = 4_000_000
_SENT: ContextVar[Mapping[str, bytes] | None] = ContextVar("sent", default=None)
_READ: ContextVar[set[str] | None] = ContextVar("read", default=None)
_PACKAGES = tuple(
    Path(__file__).resolve().parents[1] / name for name in ("cpic_core", "catalogs", "simulator", "cpic_planner")
)


@contextlib.contextmanager
def only_sent_files(sent: Mapping[str, bytes]) -> Iterator[None]:
    """Let names of files mean what was sent, and nothing on this machine's disk.

    Parameters
    ----------
    sent : mapping
        Content by name, without folders.
    """
    token = _SENT.set(sent)
    try:
        yield
    finally:
        _SENT.reset(token)


@contextlib.contextmanager
def files_read() -> Iterator[set[str]]:
    """Collect the names of the files that are opened, with and without folders: a refusal may begin with one."""
    names: set[str] = set()
    token = _READ.set(names)
    try:
        yield names
    finally:
        _READ.reset(token)


def _note_read(path: str | Path) -> None:
    if (names := _READ.get()) is not None:
        names.update((str(path), Path(path).name))


def at_home(path: str | Path) -> Path:
    """Return a path with ``~`` as the user's home; as it is where there is no such home."""
    return Path(os.path.expanduser(path))


def as_path(key: str, value: object) -> Path:
    """Return a path that Python code names.

    Parameters
    ----------
    key : str
        Name that a refusal gives.
    value : str or Path

    Raises
    ------
    InputError
        If it is of another type.
    """
    if not isinstance(value, str | Path):
        raise InputError(key, value, allowed="a path")
    return Path(value)


def was_sent(name: str) -> bool:
    """Tell whether a file of this name was sent."""
    return name in (_SENT.get() or {})


def is_file(path: str | Path) -> bool:
    """Tell whether there is a file of a name, among those that were sent where files are sent."""
    sent = _sent_to(path)
    return os.path.isfile(path) if sent is None else str(path) in sent  # which raises for no name


def file_state(path: str | Path) -> tuple[int, int]:
    """Return what changes with a file: its time and its size, of one that was sent its content.

    Raises
    ------
    OSError
        If there is none.
    """
    sent = _sent_to(path)
    if sent is None:
        about = os.stat(at_home(path))
        return about.st_mtime_ns, about.st_size
    if str(path) not in sent:
        raise FileNotFoundError(errno.ENOENT, "it was not sent")
    return int(hashlib.sha256(sent[str(path)]).hexdigest(), 16), len(sent[str(path)])


def refuse_sent(path: str | Path, *, key: str) -> None:
    """Refuse a file that was sent, where only one on a disk can be used.

    Raises
    ------
    InputError
    """
    if _sent_to(path) is not None:
        raise InputError(key, str(path), allowed="a file of the machine that computes", hint="use the command line")


def _sent_to(path: str | Path) -> Mapping[str, bytes] | None:
    """Return the files among which a name is looked for; None for the disk, where the package's own files are."""
    sent = _SENT.get()
    if sent is None:
        return None
    place = Path(os.path.normpath(path))
    return None if any(place.is_relative_to(folder) for folder in _PACKAGES) else sent


@contextlib.contextmanager
def open_file(
    path: str | Path, *, key: str, allowed: str, max_bytes: int, too_large: str = ""
) -> Iterator[BufferedReader]:
    """Open a file that somebody named, for reading as bytes.

    Parameters
    ----------
    path : str or Path
        The file; ``~`` is the user's home.
    key : str
        What it is asked for as, for messages.
    allowed : str
        What may be given, for messages.
    max_bytes : int
        Largest size that is accepted.
    too_large : str, optional
        What to do about a file that is larger, for messages.

    Yields
    ------
    file
        The open file; `read_file` reads one whole.

    Raises
    ------
    InputError
        If there is no such file, it is no regular file, cannot be opened, or is too large.
    """
    sent = _sent_to(path)
    if sent is not None:
        if str(path) not in sent:
            raise InputError(key, str(path), allowed=allowed, hint="no such file was sent")
        _refuse_large(key, path, len(sent[str(path)]), max_bytes, too_large)
        _note_read(path)
        yield BufferedReader(BytesIO(sent[str(path)]))
        return
    place = at_home(path)
    try:
        refuse_special(os.stat(place).st_mode)  # before it is opened: that alone may act on a device
        handle = os.open(place, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(key, str(path), allowed=allowed, hint=reason) from None
    with open(handle, "rb") as file:
        about = os.fstat(handle)
        try:
            refuse_special(about.st_mode)
        except OSError as error:
            raise InputError(key, str(path), allowed=allowed, hint=error.strerror or "") from None
        _refuse_large(key, path, about.st_size, max_bytes, too_large)
        _note_read(path)
        yield file


def read_file(path: str | Path, *, key: str, allowed: str, max_bytes: int, too_large: str = "") -> bytes:
    """Read a file that somebody named whole; parameters and errors are those of `open_file`.

    Parameters
    ----------
    path : str or Path
        The file; ``~`` is the user's home.
    key, allowed : str
        What it is asked for as, and what may be given, for messages.
    max_bytes : int
        Largest size that is accepted.
    too_large : str
        What to do about a file that is larger, for messages.
    """
    with open_file(path, key=key, allowed=allowed, max_bytes=max_bytes, too_large=too_large) as file:
        try:
            data = _up_to(file, max_bytes + 1)
        except OSError as error:
            raise InputError(key, str(path), allowed=allowed, hint=error.strerror or "") from None
    _refuse_large(key, path, len(data), max_bytes, too_large)
    return data


def _up_to(file: BufferedReader, most: int) -> bytes:
    """Read a file, at most so many bytes; ``read(most)`` alone would take the memory of that many first."""
    parts: list[bytes] = []
    while most > 0 and (part := file.read(min(most, _PART_BYTES))):
        parts.append(part)
        most -= len(part)
    return b"".join(parts)


def read_text(path: str | Path, *, key: str, allowed: str, max_bytes: int) -> str:
    """Read a file of UTF-8 text, with or without a byte-order mark; otherwise as `read_file`.

    Parameters
    ----------
    path : str or Path
        The file; ``~`` is the user's home.
    key, allowed : str
        What it is asked for as, and what may be given, for messages.
    max_bytes : int
        Largest size that is accepted.
    """
    try:
        return read_file(path, key=key, allowed=allowed, max_bytes=max_bytes).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(key, str(path), allowed="UTF-8 text") from None


def digest_of(path: str | Path) -> str:
    """Return the sha256 of a file, in hexadecimal digits; it may have any size.

    Raises
    ------
    InputError
        If it is no regular file, or cannot be read.
    """
    with open_file(path, key="file", allowed="a readable file", max_bytes=2**63) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


_COUNT = re.compile(rb"(BITPIX|Z?NAXIS\d*|[PG]COUNT|TFIELDS) *= *([-+]?\d+)")
_MOST_COUNTED = 999  # by the standard, of axes and of fields
_CARD, _BLOCK, _MOST_OF_HEADER = 80, 2880, 4_000_000


def bounded_fits(file: BinaryIO) -> BinaryIO:
    """Return an open FITS file, at its start, if its headers end and count as FITS does.

    With others astropy reads without end: to the end of the file for the end of a header, to any number of axes, and
    units of less than no bytes lead it back to where it was.

    Parameters
    ----------
    file : file
        Of bytes, which can seek. Only headers are read.

    Raises
    ------
    OSError
        As astropy raises for other damage.
    """
    end, place = file.seek(0, os.SEEK_END), 0
    while place < end and (cards := _cards(file, place)):
        counts: dict[str, int] = {}
        for card in cards:
            if (found := _COUNT.match(card)) is not None:
                counts.setdefault(found[1].decode(), int(found[2]))
                _refuse_count(found[1].decode(), int(found[2]))
        axes = [counts.get(f"NAXIS{axis + 1}", 0) for axis in range(counts.get("NAXIS", 0))]
        if len(axes) > 1 and axes[0] == 0 and any(re.match(rb"GROUPS *= *T", card) for card in cards):
            axes = axes[1:]
        values = counts.get("GCOUNT", 1) * (counts.get("PCOUNT", 0) + (math.prod(axes) if axes else 0))
        length = len(cards) * _CARD + abs(counts.get("BITPIX", 8)) * values // 8
        place += -(-length // _BLOCK) * _BLOCK
    file.seek(0)
    return file


def _cards(file: BinaryIO, place: int) -> list[bytes]:
    """Return the cards of the header at a place, all of its last block; none if no header ends before the file does."""
    file.seek(place)
    cards: list[bytes] = []
    while len(cards) * _CARD < _MOST_OF_HEADER:
        block = file.read(_BLOCK)
        if len(block) < _BLOCK:
            return []
        new = [block[start : start + _CARD] for start in range(0, _BLOCK, _CARD)]
        cards += new
        if any(card.rstrip() == b"END" for card in new):
            return cards
    raise OSError(errno.EINVAL, f"it has a header of more than {_MOST_OF_HEADER} bytes")


def _refuse_count(name: str, number: int) -> None:
    if number < 0 and name != "BITPIX":
        raise OSError(errno.EINVAL, f"{name} is below 0")
    if name in ("NAXIS", "ZNAXIS", "TFIELDS") and number > _MOST_COUNTED:
        raise OSError(errno.EINVAL, f"{name} is above {_MOST_COUNTED}")


def refuse_special(mode: int) -> None:
    """Raise an OSError that says what something is that is no regular file.

    Parameters
    ----------
    mode : int
        As `os.stat` has it.
    """
    for is_kind, words in (*_KINDS, (lambda mode: True, "this is a device")):
        if is_kind(mode):
            if words:
                raise OSError(errno.EINVAL, words)
            return


def _refuse_large(key: str, path: str | Path, size: int, max_bytes: int, too_large: str) -> None:
    if size > max_bytes:
        raise InputError(key, str(path), allowed=f"a file of at most {max_bytes} bytes", hint=too_large)
