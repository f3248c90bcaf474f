"""Named arrays in npz files with the same bytes for the same content; never pickle."""

from __future__ import annotations

import contextlib
import io
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.errors import InputError
from catalogs.user_files import open_file
from simulator.files import write_bytes

__all__ = ["NPZ_ERRORS", "open_npz", "read_npz", "write_npz"]

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


NPZ_ERRORS = (
    OSError,
    ValueError,
    TypeError,
    EOFError,
    KeyError,
    RuntimeError,
    MemoryError,
    zipfile.BadZipFile,
    zlib.error,
)
"""What reading a damaged npz file may raise."""


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
