"""The one door to files: those that somebody named are opened here, and whole files are written.

A name comes from a user, or from a file that a user named, and may lead anywhere. Only regular files are opened (a
link to one too), never a pipe or a device, none that is larger than its reader allows, and no more than that is ever
read.

Where files come over a network, they are what was sent (`only_sent_files`): no name leads to the disk then, but to
what the package ships.

Files are written whole: a reader sees the old content or the new, never a part. Named arrays in npz files have the
same bytes for the same content, and are never pickled. In cells of tables nothing steers a terminal, and a text is
never a formula of a spreadsheet.
"""

import contextlib
import errno
import functools
import hashlib
import io
import json
import math
import os
import re
import stat
import tempfile
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextvars import ContextVar
from io import BufferedReader, BytesIO
from pathlib import Path
from typing import IO, Any, BinaryIO

import numpy as np

from cpic_core.errors import InputError, visible
from cpic_core.quantities import NDArray

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


@contextlib.contextmanager
def whole_file(path: str | Path, *, overwrite: bool = True) -> Iterator[IO[bytes]]:
    """Write a file under a temporary name beside ``path``; flushed to disk and renamed when the block ends well.

    Parameters
    ----------
    path : str or Path
        The file; its folder exists.
    overwrite : bool
        Whether a file of that name is replaced.

    Yields
    ------
    file
        The open file, binary, for reading too.

    Raises
    ------
    FileExistsError
        If the file exists, at the beginning or at the end, and ``overwrite`` is false.
    OSError
        If the folder is not writable or the disk is full; ``path`` then keeps its old content.
    """
    path = Path(path)
    if not overwrite and path.exists():
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
    temporary = Path(name)
    try:
        with os.fdopen(handle, "w+b") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        if overwrite:
            temporary.replace(path)
        else:
            _link_or_rename(temporary, path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        if isinstance(error, OSError) and error.errno and error.filename is None:  # of a write: says which disk is full
            error.filename = str(path)
        raise


def _link_or_rename(temporary: Path, path: Path) -> None:
    """Give the file its name; a link, unlike a rename, fails where another process was faster."""
    try:
        path.hardlink_to(temporary)
    except OSError as error:
        if isinstance(error, FileExistsError) or path.exists():
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from None
        temporary.replace(path)  # a file system without links
    else:
        temporary.unlink()


def check_writable(path: str | Path, *, key: str, folder: bool = False) -> None:
    """Refuse what could not be written, before there is anything to write; nothing is made.

    Parameters
    ----------
    path : str or Path
        A file in a folder that exists, replaced if it is a regular one; or a folder, made with its parents where it
        is not. A link stands for what it leads to, which has to be there.
    key : str
        What it is asked for as, for messages.
    folder : bool
        Whether it is a folder.

    Raises
    ------
    InputError
        Saying why.
    """
    place = Path(path)
    try:
        if not folder and os.path.lexists(place):
            refuse_special(place.stat().st_mode)
        place = _standing(place) if folder else place.resolve().parent
        if not stat.S_ISDIR(place.stat().st_mode):
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
        if not os.access(place, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(key, str(path), allowed=f"a writable {'folder' if folder else 'file'}", hint=reason) from None


def _standing(place: Path) -> Path:
    """Return a path, or the first of its parents that is there."""
    while True:
        try:
            place.lstat()
        except FileNotFoundError:
            place = place.parent
        else:
            return place


def write_bytes(path: str | Path, data: bytes) -> Path:
    """Write ``data`` as a `whole_file`.

    Parameters
    ----------
    path : str or Path
    data : bytes
        Content of the file.

    Raises
    ------
    OSError
        If the folder is not writable or the disk is full; ``path`` then keeps its old content.
    """
    with whole_file(path) as file:
        file.write(data)
    return Path(path)


def write_named(path: str | Path, text: str | bytes, *, key: str) -> Path:
    """Write a file that somebody named whole; a link stays one, and the file that it leads to is written.

    Parameters
    ----------
    path : str or Path
    text : str or bytes
        Content of the file.
    key : str
        What it is asked for as, for messages.

    Returns
    -------
    Path
        The file that is written.

    Raises
    ------
    InputError
        As `check_writable`: nothing but regular files is written.
    OSError
        If the disk is full or broken.
    """
    check_writable(path, key=key)
    return write_bytes(Path(path).resolve(), utf8(text) if isinstance(text, str) else text)


def utf8(text: str) -> bytes:
    r"""Return a text as bytes.

    What UTF-8 has no bytes for, lone surrogates, which stand for other bytes in names of files and in arguments of
    commands, are written as escapes; JSON reads these back.

    Parameters
    ----------
    text : str

    Examples
    --------
    >>> import os
    >>> from cpic_core import utf8
    >>> utf8("é"), utf8(os.fsdecode(b"\xff"))
    (b'\xc3\xa9', b'\\udcff')
    """
    return text.encode("utf-8", "backslashreplace")


def write_text(path: str | Path, text: str) -> Path:
    """Write text as UTF-8 bytes; see `write_bytes`.

    Parameters
    ----------
    path : str or Path
    text : str
        Content of the file.
    """
    return write_bytes(path, utf8(text))


_STEERING = re.compile(r"[\x7f-\x9f\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff]")
"""Signs that steer a terminal or the order of others, and that JSON need not escape."""


def dump_json(tree: Any) -> str:
    """Return JSON as this project writes it: two-space indent, shortest round-trip floats, no NaN, final newline."""
    text = json.dumps(tree, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    return _STEERING.sub(lambda sign: json.dumps(sign[0])[1:-1], text)


class LockHeld(RuntimeError):
    """Another live process holds the lock; ``text`` is what it wrote into the lock file."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.text = text
        super().__init__(f"{path} is held by another process: {text}")


def parse_json(text: str | bytes) -> Any:
    """Return what a JSON text of somebody else's says.

    Raises
    ------
    ValueError
        For every text that is none, brackets in brackets without end among them.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None


@contextlib.contextmanager
def exclusive_lock(path: str | Path, *, wait: bool = True) -> Iterator[IO[str]]:
    """Hold an operating-system lock on ``path`` (created if absent, left in place afterwards, its content as it was).

    The kernel drops the lock when the holder dies, however it dies, so there are no stale locks to judge. Whatever the
    holder writes, it writes into this file: a link, or a file that has a second name elsewhere, is not locked.

    Parameters
    ----------
    path : str or Path
    wait : bool, optional
        Whether to wait for another process that holds the lock.

    Yields
    ------
    file
        The open lock file, in which the holder may describe itself.

    Raises
    ------
    LockHeld
        If ``wait`` is false and another process holds it.
    OSError
        If ``path`` cannot be opened, or is a link, a file with a second name, or no regular file.
    """
    import fcntl

    path = Path(path)
    flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    with os.fdopen(os.open(path, flags, 0o666), "a+", encoding="utf-8", errors="replace") as file:
        about = os.fstat(file.fileno())
        if not stat.S_ISREG(about.st_mode) or about.st_nlink > 1:
            raise OSError(errno.EINVAL, "not a file of its own", str(path))
        try:
            fcntl.flock(file, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.seek(0)
            raise LockHeld(path, file.read().strip()) from None
        try:
            yield file
        finally:
            fcntl.flock(file, fcntl.LOCK_UN)


MAX_BYTES = 4_000_000_000
_WANTED = "a whole npz file of plain arrays"
FIXED_DATE = (1980, 1, 1, 0, 0, 0)  # the oldest date a zip file can hold


def write_npz(path: str | Path, arrays: Mapping[str, Any], *, deflated: bool = True) -> None:
    """Write arrays, sorted by name, under fixed dates.

    Parameters
    ----------
    path : str or Path
    arrays : mapping
        Arrays by name.
    deflated : bool
        Whether the file is small rather than quick to read.
    """
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compresslevel=9) as archive:
        for name in sorted(arrays):
            entry = zipfile.ZipInfo(f"{name}.npy", FIXED_DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED if deflated else zipfile.ZIP_STORED
            entry.external_attr = 0o644 << 16
            body = io.BytesIO()
            np.lib.format.write_array(body, np.asanyarray(arrays[name]), allow_pickle=False)
            archive.writestr(entry, body.getvalue())
    write_bytes(path, buffer.getvalue())


_DAMAGED = (zipfile.BadZipFile, zlib.error)
NPZ_ERRORS = (OSError, ValueError, TypeError, EOFError, KeyError, RuntimeError, MemoryError, *_DAMAGED)
"""Errors that reading a damaged npz file may raise."""


@contextlib.contextmanager
def open_npz(path: str | Path) -> Iterator[Any]:
    """Open an npz file without pickle; a damaged one is closed too, which numpy forgets given a name.

    Raises
    ------
    Exception
        One of `NPZ_ERRORS`, here or when an array is read; also for an archive of anything but arrays, or whose arrays
        would take more than 4 GB.
    """
    with open_file(path, key="file", allowed=_WANTED, max_bytes=MAX_BYTES) as file, npz_in(file) as arrays:
        yield arrays


@contextlib.contextmanager
def npz_in(file: IO[bytes]) -> Iterator[Any]:
    """Yield the arrays of an open npz file; errors are those of `open_npz`."""
    with zipfile.ZipFile(file) as archive:
        entries = archive.infolist()
    if not all(entry.filename.endswith(".npy") for entry in entries):
        raise ValueError("it holds other files than arrays")
    if sum(entry.file_size for entry in entries) > MAX_BYTES:
        raise ValueError(f"its arrays take more than {MAX_BYTES} bytes")
    file.seek(0)
    with np.load(file, allow_pickle=False) as arrays:
        yield arrays


@functools.lru_cache(maxsize=256)
def _shape_of(head: bytes) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    return np.lib.format.read_array_header_1_0(io.BytesIO(head))


def _array_of(data: bytes) -> NDArray[Any]:
    """Return the array of an npy file; many have the same few bytes before their numbers."""
    end = 10 + int.from_bytes(data[8:10], "little")
    if data[:8] != np.lib.format.magic(1, 0):
        return np.asarray(np.lib.format.read_array(io.BytesIO(data), allow_pickle=False))
    shape, by_column, kind = _shape_of(data[8:end])
    if kind.hasobject:
        raise ValueError("it holds Python objects")
    found = np.frombuffer(data, kind, math.prod(shape), end).reshape(shape, order="F" if by_column else "C")
    return found.copy("K")


def read_npz(path: str | Path) -> dict[str, NDArray[Any]]:
    """Read every array of an npz file.

    Raises
    ------
    InputError
        If the file is missing, damaged, or holds Python objects.
    """
    try:
        with open_npz(path) as archive:
            return {name: _array_of(archive.zip.read(f"{name}.npy")) for name in archive.files}
    except InputError:
        raise
    except NPZ_ERRORS as error:
        raise InputError("file", str(path), allowed=_WANTED, hint=str(error)) from None


def byte_planes(numbers: NDArray[Any]) -> NDArray[np.uint8]:
    """Return numbers as planes of bytes of equal weight, which compress better, as `of_byte_planes` reads them.

    Parameters
    ----------
    numbers : ndarray
        Floats, of 4 or 8 bytes each.

    Returns
    -------
    ndarray of uint8
        One axis before those of the numbers, of 4 or 8 planes.
    """
    plain = np.ascontiguousarray(numbers, numbers.dtype.newbyteorder("<"))
    return np.moveaxis(plain.view(np.uint8).reshape(*plain.shape, plain.itemsize), -1, 0)


def of_byte_planes(planes: NDArray[np.uint8]) -> NDArray[Any]:
    """Return the numbers of `byte_planes`."""
    together = np.empty((*planes.shape[1:], len(planes)), np.uint8)
    for byte, plane in enumerate(planes):
        together[..., byte] = plane
    return np.asarray(together.view(f"<f{len(planes)}")[..., 0])


_FORMULA = re.compile(r"'*[=+\-@\t\r]")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", re.ASCII)


def guarded(text: str) -> str:
    r"""Return a cell as it stands in a file: `visible`, and behind an apostrophe if it could be a formula.

    Formulas of spreadsheets begin with =, +, - or @. Numbers stay as they are.

    Parameters
    ----------
    text : str

    Examples
    --------
    >>> from cpic_core import guarded, unguarded
    >>> guarded("=1+1"), guarded("-1.5"), guarded("tau\x1b"), unguarded(guarded("'@x"))
    ("'=1+1", '-1.5', 'tau\\x1b', "'@x")
    """
    text = visible(text)
    return f"'{text}" if _FORMULA.match(text) and not _NUMBER.fullmatch(text) else text


def unguarded(text: str) -> str:
    """Return the text of a cell that `guarded` wrote; others are unchanged.

    Parameters
    ----------
    text : str
    """
    return text[1:] if text.startswith("'") and _FORMULA.match(text) else text
