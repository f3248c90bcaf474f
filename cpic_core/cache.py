"""Disk cache of computed arrays, keyed by content: what a question costs is paid once on a machine.

An entry says which key it answers, which version of this package wrote it, and the sum of both and its content. All
three are checked before a number of it is used, and so is that the content is what the question wants; anything else is
removed and computed anew, with one line on the log. Of several processes that want an entry that is not there one
computes, the others wait for it and read. The entries together take at most ``$CPIC_CACHE_MAX_MB`` (2000) megabytes:
those that were not used for longest go first, and entries of other versions before them.

The folder is ``$CPIC_CACHE_DIR`` or the user's cache folder (platformdirs). Deleting it is always safe. Only files that
this module wrote are removed from it.
"""

import contextlib
import functools
import hashlib
import io
import json
import logging
import math
import os
import re
import stat
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cpic_core.errors import InputError
from cpic_core.files import MAX_BYTES, LockHeld, exclusive_lock, npz_in, write_bytes
from cpic_core.quantities import NDArray
from cpic_core.records import Record
from cpic_core.runtime import announce

T = TypeVar("T")
Arrays = Mapping[str, NDArray[Any]]

_LOG = logging.getLogger(__name__)
_FAMILY = b"cpic-cache-"  # begins every entry of every format
_OLD, _MAGIC = _FAMILY + b"1\n", _FAMILY + b"2\n"
_HEAD_BYTES = 1000
_KEY = re.compile(r"[\w.-]+-[0-9a-f]{16}")
_LEFT = re.compile(rf"{_KEY.pattern}\.lock|\.{_KEY.pattern}\.bin\.\w+\.part")
_SHARE = 0.01  # of the limit, that may be added before room is made again
_PART_S = 3600.0  # a part that is older was left by a process that was killed: writing takes seconds
_LIMIT = "CPIC_CACHE_MAX_MB"
_DEFAULT_MB = 2000.0


class _BadEntry(Exception):
    """An entry that is not to be used, in words."""


class _OldEntry(Exception):
    """An entry of another version."""


@functools.cache
def _version() -> str:
    """Return the version of the package; an entry of another one may mean other things by the same key."""
    from importlib import metadata

    try:
        return metadata.version("cpic-planner")
    except metadata.PackageNotFoundError:
        return "source"


def cache_dir() -> Path:
    """Return the folder of the cache (not created here)."""
    chosen = os.environ.get("CPIC_CACHE_DIR")
    if chosen:
        return Path(chosen)
    from platformdirs import user_cache_path

    return user_cache_path("cpic-planner", appauthor=False)


def cache_limit_bytes() -> int:
    """Return the most bytes that the entries take together.

    Raises
    ------
    InputError
        If ``$CPIC_CACHE_MAX_MB`` is no number of megabytes from 0, which keeps nothing, to 1e9.
    """
    given = os.environ.get(_LIMIT) or str(_DEFAULT_MB)
    try:
        size_mb = float(given)
    except ValueError:
        size_mb = math.nan
    if not 0.0 <= size_mb <= 1e9:
        raise InputError(_LIMIT, given, unit="MB", allowed=f"0 to 1e9 (without it: {_DEFAULT_MB:g})")
    return int(size_mb * 1e6)


def compute_once(key: str, compute: Callable[[], Arrays], read: Callable[[Arrays], T]) -> T:
    """Return what is read from the arrays of ``key``, computed by one process while others of this machine wait.

    The lock belongs to the operating system, so a killed process leaves nobody waiting.

    Parameters
    ----------
    key : str
        Content key of the entry: a word, a hyphen and 16 hex digits that stand for all that decides the arrays.
    compute : callable
        Makes the arrays where there are none yet.
    read : callable
        Makes of the arrays what is wanted. An entry from which that fails is computed anew.

    Raises
    ------
    InputError
        If ``$CPIC_CACHE_MAX_MB`` is no size.
    """
    limit = cache_limit_bytes()
    with contextlib.suppress(LookupError):
        return _stored(key, read)
    with contextlib.ExitStack() as stack:
        lock = _entry(key).with_suffix(".lock")
        try:
            lock.parent.mkdir(parents=True, exist_ok=True)
            try:
                stack.enter_context(exclusive_lock(lock, wait=False))
            except LockHeld:
                announce(f"another process computes {key} for the cache: waiting for it")
                stack.enter_context(exclusive_lock(lock))
        except OSError as error:
            _LOG.warning("cache folder %s cannot be locked (%s): going on without", lock.parent, error.strerror)
        with contextlib.suppress(LookupError):
            return _stored(key, read)
        made = {name: np.asarray(array) for name, array in compute().items()}
        _store(key, made, limit)
    return read(made)


def _entry(key: str) -> Path:
    if not _KEY.fullmatch(key):
        raise ValueError(f"cache key {key!r} must be letters, digits, '-', '_' or '.', and 16 hex digits after a '-'")
    return cache_dir() / f"{key}.bin"


def _stored(key: str, read: Callable[[Arrays], T]) -> T:
    """Return what is read from the entry of a key.

    Raises
    ------
    LookupError
        If there is none that can be used; one that is there is removed.
    """
    path = _entry(key)
    try:
        found = read(_arrays_of(_content(path), key))
    except FileNotFoundError:
        raise LookupError(key) from None
    except Exception as error:  # of many kinds, where the content is not what the question wants
        level = logging.INFO if isinstance(error, _OldEntry) else logging.WARNING
        _LOG.log(level, "cache entry %s is not used (%s): computing it anew", path.name, " ".join(str(error).split()))
        with contextlib.suppress(OSError):
            path.unlink()
        raise LookupError(key) from None
    with contextlib.suppress(OSError):
        os.utime(path)  # used now: those that were not used for longest are removed first
    return found


def _content(path: Path) -> bytes:
    """Return the bytes of an entry; whatever else may stand there under its name is not opened, or not read."""
    with os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
        about = os.fstat(file.fileno())
        if not stat.S_ISREG(about.st_mode) or about.st_size > MAX_BYTES:
            raise _BadEntry("no file of an entry")
        return file.read()


def _arrays_of(data: bytes, key: str) -> Arrays:
    """Return the arrays of an entry that answers a key."""
    head, payload = _head_of(data), data[data.find(b"\n", len(_MAGIC)) + 1 :]
    if head is None:
        raise _OldEntry("of another format") if data.startswith(_OLD) else _BadEntry("it is damaged")
    if head.get("version") != _version():
        raise _OldEntry(f"of version {head.get('version')}")
    if head.get("key") != key:
        raise _BadEntry(f"it answers {head.get('key')}")
    if head.get("sum") != _sum_of(key, payload):
        raise _BadEntry("it is damaged")
    with npz_in(io.BytesIO(payload)) as stored:
        return {name: stored[name] for name in stored.files}


def _head_of(data: bytes) -> dict[str, Any] | None:
    """Return what an entry says of itself: key, version, sum; None where it says nothing."""
    if not data.startswith(_MAGIC):
        return None
    try:
        head = json.loads(data[len(_MAGIC) : data.index(b"\n", len(_MAGIC), _HEAD_BYTES)])
    except ValueError:
        return None
    return head if isinstance(head, dict) else None


def _sum_of(key: str, payload: bytes) -> str:
    return hashlib.sha256(f"{key}\n{_version()}\n".encode() + payload).hexdigest()


def _store(key: str, arrays: Arrays, limit: int) -> None:
    """Store arrays whole and remove what is too much; an unwritable folder is a warning, not a failure."""
    buffer = io.BytesIO()
    np.savez(buffer, **dict(arrays))  # type: ignore[arg-type]
    payload = buffer.getvalue()
    head = {"key": key, "version": _version(), "sum": _sum_of(key, payload)}
    path = _entry(key)
    try:
        write_bytes(path, _MAGIC + json.dumps(head).encode() + b"\n" + payload)
        _make_room(limit, len(payload))
    except OSError as error:
        _LOG.warning("cache folder %s is not writable (%s): going on without it", path.parent, error.strerror)


def _make_room(limit: int, added: int) -> None:
    """Remove entries of other versions, and those not used for longest that are too much.

    Looked for at the first entry that this process writes, and then at every hundredth of the limit: looking at some
    thousand small entries takes longer than writing one.
    """
    folder = cache_dir()
    _added[folder] = _added.get(folder, limit) + added
    if _added[folder] < _SHARE * limit:
        return
    _added[folder] = 0
    kept = []
    for path, about, start in _entries():
        head = _head_of(start)
        if head is None or head.get("version") != _version():
            path.unlink(missing_ok=True)
        else:
            kept.append((about.st_mtime_ns, about.st_size, path))
    left = sum(size for _, size, _ in kept)
    for _, size, path in sorted(kept):
        if left <= limit:
            break
        for gone in (path, path.with_suffix(".lock")):
            gone.unlink(missing_ok=True)
        left -= size
    now = time.time()
    for path in _leftovers():
        with contextlib.suppress(FileNotFoundError):
            if path.suffix == ".part" and now - path.lstat().st_mtime > _PART_S:
                path.unlink()


_added: dict[Path, int] = {}  # bytes since room was made last, by folder


def _entries() -> Iterator[tuple[Path, os.stat_result, bytes]]:
    """Yield the entries of any version and their first bytes: files of their name that begin as they do."""
    for path in cache_dir().glob("*.bin"):
        with contextlib.suppress(OSError):
            about = path.lstat()
            if not stat.S_ISREG(about.st_mode) or not _KEY.fullmatch(path.stem):
                continue
            with open(path, "rb") as file:
                start = file.read(_HEAD_BYTES)
            if start.startswith(_FAMILY):
                yield path, about, start


def _leftovers() -> Iterator[Path]:
    """Yield the files of locks, and what was being written when a process was killed."""
    return (path for path in cache_dir().glob("*") if _LEFT.fullmatch(path.name) and not path.is_dir())


class CacheInfo(Record):
    """Return what the cache holds, and how much it may hold."""

    folder: Path
    n_entries: int
    size_bytes: int
    limit_bytes: int


def cache_info() -> CacheInfo:
    """Return folder, number of entries, their size and its limit.

    Raises
    ------
    InputError
        As `cache_limit_bytes`.
    """
    sizes = [about.st_size for _, about, _ in _entries()]
    return CacheInfo(cache_dir(), len(sizes), sum(sizes), cache_limit_bytes())


def clear_cache() -> CacheInfo:
    """Remove every entry; returns what was there."""
    info = cache_info()
    for path in (*(path for path, *_ in _entries()), *_leftovers()):
        path.unlink(missing_ok=True)
    return info
