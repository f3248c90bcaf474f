"""The one place where files that somebody named are opened for reading.

A name comes from a user, or from a file that a user named, and may lead anywhere. Only regular files are opened (a link
to one too), never a pipe or a device, none that is larger than its reader allows, and no more than that is ever read.
"""

import contextlib
import errno
import hashlib
import os
import stat
from collections.abc import Iterator
from io import BufferedReader
from pathlib import Path

from cpic_core.errors import InputError

_KINDS = (
    (stat.S_ISDIR, "this is a folder"),
    (stat.S_ISFIFO, "this is a pipe"),
    (stat.S_ISSOCK, "this is a socket"),
    (stat.S_ISREG, ""),
)


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
    place = Path(path).expanduser()
    try:
        _refuse_special(os.stat(place).st_mode)  # before it is opened: that alone may act on a device
        handle = os.open(place, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(key, str(path), allowed=allowed, hint=reason) from None
    with open(handle, "rb") as file:
        about = os.fstat(handle)
        try:
            _refuse_special(about.st_mode)
        except OSError as error:
            raise InputError(key, str(path), allowed=allowed, hint=error.strerror or "") from None
        _refuse_large(key, path, about.st_size, max_bytes, too_large)
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
            data = file.read(max_bytes + 1) or b""
        except OSError as error:
            raise InputError(key, str(path), allowed=allowed, hint=error.strerror or "") from None
    _refuse_large(key, path, len(data), max_bytes, too_large)
    return data


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


def _refuse_special(mode: int) -> None:
    for is_kind, words in (*_KINDS, (lambda mode: True, "this is a device")):
        if is_kind(mode):
            if words:
                raise OSError(errno.EINVAL, words)
            return


def _refuse_large(key: str, path: str | Path, size: int, max_bytes: int, too_large: str) -> None:
    if size > max_bytes:
        raise InputError(key, str(path), allowed=f"a file of at most {max_bytes} bytes", hint=too_large)
