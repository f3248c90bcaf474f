"""Whole-file writing: a reader sees the old content or the new, never a part.

Named arrays in npz files with the same bytes for the same content; never pickle.

Cells of tables in files: nothing in them steers a terminal, and a text is never a formula of a spreadsheet.
"""

import contextlib
import errno
import io
import json
import os
import re
import stat
import tempfile
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np

from cpic_core.errors import InputError, visible
from cpic_core.quantities import NDArray
from cpic_core.user_files import open_file, refuse_special


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


def write_json(path: str | Path, tree: Any) -> Path:
    """Write a value as `dump_json` has it; see `write_text`.

    Parameters
    ----------
    path : str or Path
    tree : object
        Plain data.
    """
    return write_text(path, dump_json(tree))


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


def write_npz(path: str | Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays, sorted by name, deflated, under fixed dates.

    Parameters
    ----------
    path : str or Path
    arrays : mapping
        Arrays by name.
    """
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name in sorted(arrays):
            entry = zipfile.ZipInfo(f"{name}.npy", FIXED_DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
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


def read_npz(path: str | Path) -> dict[str, NDArray[Any]]:
    """Read every array of an npz file.

    Raises
    ------
    InputError
        If the file is missing, damaged, or holds Python objects.
    """
    try:
        with open_npz(path) as archive:
            return {name: archive[name] for name in archive.files}
    except InputError:
        raise
    except NPZ_ERRORS as error:
        raise InputError("file", str(path), allowed=_WANTED, hint=str(error)) from None


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
