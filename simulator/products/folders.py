"""Folders and temporary files of a tree of products: made when needed, gone again when a write fails or failed."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO

__all__ = ["claim", "clear_stale_parts", "temporary_folders"]


@contextlib.contextmanager
def temporary_folders(folders: Iterable[Path], *, whole: Path, done: Path) -> Iterator[None]:
    """Remove on failure what was not there before: the folders where they are empty, and ``whole`` with its files.

    Where there is a file ``done``, somebody else was faster, and ``whole`` is theirs.

    Parameters
    ----------
    folders : iterable of Path
        Folders that may be made.
    whole : Path
        Folder that is written as a whole.
    done : Path
        File that is there when it is done.
    """
    made = {place for folder in folders for place in (folder, *folder.parents) if not place.exists()}
    new = not whole.exists()
    try:
        yield
    except BaseException:
        with contextlib.suppress(OSError):
            if new and not done.exists():
                shutil.rmtree(whole)
        for place in sorted(made, key=lambda path: len(path.parts), reverse=True):
            with contextlib.suppress(OSError):
                place.rmdir()  # which refuses one that somebody else has put a file in
        raise


def claim(file: IO[bytes]) -> None:
    """Mark a temporary file as one that a living process writes; the mark dies with the process."""
    import fcntl

    with contextlib.suppress(OSError):  # a file system without locks
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def clear_stale_parts(path: Path) -> None:
    """Remove temporary files of ``path`` that no living process has claimed: what killed runs of it left."""
    import fcntl

    for part in path.parent.glob(f".{path.name}.*.part"):
        with contextlib.suppress(OSError), part.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            part.unlink()
