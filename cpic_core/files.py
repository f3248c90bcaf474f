"""Whole-file writing: a reader sees the old content or the new, never a part.

Named arrays in npz files with the same bytes for the same content; never pickle.

Disk cache of computed arrays, keyed by content; a damaged entry is dropped and rebuilt.

The folder is ``$CPIC_CACHE_DIR`` or the user's cache folder (platformdirs). Deleting it is always safe.
"""

import contextlib
import errno
import hashlib
import io
import json
import logging
import os
import stat
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from cpic_core.errors import InputError
from cpic_core.quantities import NDArray
from cpic_core.user_files import open_file


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
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink()
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


def write_text(path: str | Path, text: str) -> Path:
    """`write_bytes` of UTF-8 text.

    Parameters
    ----------
    path : str or Path
    text : str
        Content of the file.
    """
    return write_bytes(path, text.encode())


def dump_json(tree: Any) -> str:
    """JSON as this project writes it: two-space indent, shortest round-trip floats, no NaN, final newline."""
    return json.dumps(tree, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def write_json(path: str | Path, tree: Any) -> Path:
    """`write_text` of `dump_json`.

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
    with open_file(path, key="file", allowed=_WANTED, max_bytes=MAX_BYTES) as file:
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


_LOG = logging.getLogger(__name__)
_MAGIC = b"cpic-cache-1\n"


def cache_dir() -> Path:
    """Folder of the cache (not created here)."""
    chosen = os.environ.get("CPIC_CACHE_DIR")
    if chosen:
        return Path(chosen)
    from platformdirs import user_cache_path

    return user_cache_path("cpic-planner", appauthor=False)


def _entry(key: str) -> Path:
    if not key or not all(char.isalnum() or char in "-_." for char in key):
        raise ValueError(f"cache key {key!r} must be letters, digits, '-', '_' or '.'")
    return cache_dir() / f"{key}.bin"


def get_arrays(key: str) -> dict[str, np.ndarray] | None:
    """Arrays stored under ``key``, or ``None``; a damaged entry is removed and counts as absent."""
    path = _entry(key)
    try:
        data = path.read_bytes()
    except OSError:
        return None
    digest, payload = data[len(_MAGIC) : len(_MAGIC) + 32], data[len(_MAGIC) + 32 :]
    if not data.startswith(_MAGIC) or hashlib.sha256(payload).digest() != digest:
        _LOG.warning("cache entry %s is damaged: rebuilding it", path.name)
        path.unlink(missing_ok=True)
        return None
    with np.load(io.BytesIO(payload), allow_pickle=False) as stored:
        return {name: stored[name] for name in stored.files}


def put_arrays(key: str, arrays: Mapping[str, np.ndarray]) -> None:
    """Store arrays whole; an unwritable cache folder is a warning, not a failure.

    Parameters
    ----------
    key : str
        Content key of the entry.
    arrays : mapping of str to ndarray
        Arrays by name.
    """
    buffer = io.BytesIO()
    np.savez(buffer, **dict(arrays))  # type: ignore[arg-type]
    payload = buffer.getvalue()
    path = _entry(key)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(path, _MAGIC + hashlib.sha256(payload).digest() + payload)
    except OSError as error:
        _LOG.warning("cache folder %s is not writable (%s): going on without it", path.parent, error.strerror)


def compute_once(key: str, compute: Callable[[], Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Cached arrays of ``key``, computed by one process while others of this machine wait for it.

    The lock belongs to the operating system, so a killed process leaves nobody waiting.

    Parameters
    ----------
    key : str
        Content key of the entry.
    compute : callable
        Makes the arrays where there are none yet.
    """
    found = get_arrays(key)
    if found is not None:
        return found
    with contextlib.ExitStack() as stack:
        try:
            cache_dir().mkdir(parents=True, exist_ok=True)
            stack.enter_context(exclusive_lock(_entry(key).with_suffix(".lock")))
        except OSError as error:
            _LOG.warning("cache folder %s cannot be locked (%s): going on without", cache_dir(), error.strerror)
        found = get_arrays(key)
        if found is None:
            found = {name: np.asarray(array) for name, array in compute().items()}
            put_arrays(key, found)
    return found


@dataclass(frozen=True)
class CacheInfo:
    """What the cache holds."""

    folder: Path
    n_entries: int
    size_bytes: int


def cache_info() -> CacheInfo:
    """Folder, number of entries and size."""
    folder = cache_dir()
    files = list(folder.glob("*.bin")) if folder.is_dir() else []
    return CacheInfo(folder, len(files), sum(path.stat().st_size for path in files))


def clear_cache() -> CacheInfo:
    """Remove every entry; returns what was there."""
    info = cache_info()
    if info.folder.is_dir():
        for pattern in ("*.bin", "*.lock", ".*.part"):
            for path in info.folder.glob(pattern):
                path.unlink(missing_ok=True)
    return info
