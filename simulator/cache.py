"""Disk cache of computed arrays, keyed by content; a damaged entry is dropped and rebuilt.

The folder is ``$CPIC_CACHE_DIR`` or the user's cache folder (platformdirs). Deleting it is always safe.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import logging
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from simulator.files import exclusive_lock, write_bytes

__all__ = ["CacheInfo", "cache_dir", "cache_info", "clear_cache", "compute_once", "get_arrays", "put_arrays"]

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
