"""The list of the files that a run wrote into its folder: what a later run may replace or remove, and nothing else.

The list is ``cpic-run.jsonl``, one JSON object a line. The first line says whose list it is; every other line was added
before the file that it names got its name, so that a run which is killed leaves no file that its list does not know::

    {"software": "cpic-planner", "schema_version": 3, "kind": "plan", "config_hash": "...", "fingerprint": "..."}
    {"folder": "parts"}
    {"file": "parts/x-01234567.json", "size_bytes": 123, "sha256": "..."}

A file belongs to the run if the list names it and it still has one of the contents that the list gives for it. A listed
file with another content was changed by somebody: it is renamed, never removed. Links are not followed.
A line ``{"fingerprint": "..."}`` is that of another processor that took part; `cpic_core.provenance` says what one is.
"""

import contextlib
import errno
import json
import logging
import os
import re
import secrets
import shutil
import stat
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, Literal

from cpic_core import InputError, digest_of, parse_json, read_file, write_text
from cpic_planner.version import DISTRIBUTION

_LOG = logging.getLogger(__name__)
LIST_NAME = "cpic-run.jsonl"
SCHEMA_VERSION = 3
_MAX_BYTES = 1_000_000_000
_HEAD = {"software": DISTRIBUTION, "schema_version": SCHEMA_VERSION}

_BEGIN = f'{{"software": "{DISTRIBUTION}", '.encode()
_TEMPORARY = re.compile(r"\.cpic-[0-9a-f]{8}")

_WITHOUT_IT, _MOVE_IT = "a folder without this file", "move it, or choose another folder"
Standing = Literal["free", "ours", "changed"]


def refused(path: Path, allowed: str, hint: str = "") -> InputError:
    """Return the refusal of an output folder, or of a file in it."""
    return InputError("--out", str(path), allowed=allowed, hint=hint)


class DamagedListError(RuntimeError):
    """The list of a run is not as it was written."""


@dataclass
class WrittenFiles:
    """The list of the run that holds a folder; whoever uses it holds the lock of the folder.

    Attributes
    ----------
    root : Path
        The folder.
    kind, config_hash : str
        Kind and configuration of the run.
    fingerprints : list of str
        Of the process that began it, and of others that differ in the processor alone and took part.
    """

    root: Path
    kind: str
    config_hash: str
    fingerprints: list[str]
    _contents: dict[str, set[tuple[int, str]]] = field(default_factory=dict)
    _folders: list[str] = field(default_factory=list)
    _temporary: list[str] = field(default_factory=list)

    @classmethod
    def begin(cls, root: Path, kind: str, config_hash: str, fingerprint: str) -> "WrittenFiles":
        """Begin an empty list; it takes the place of an earlier one, which must name nothing that still exists.

        What a run left that was killed in the middle of this is removed, if its content says that it is nothing else.
        """
        for left in root.glob(f".{LIST_NAME}.*.part"):
            begun = left.read_bytes()[: len(_BEGIN)] if left.is_file() and not left.is_symlink() else None
            if begun is not None and _BEGIN.startswith(begun):
                left.unlink()
        about = {"kind": kind, "config_hash": config_hash, "fingerprint": fingerprint}
        write_text(root / LIST_NAME, _line(_HEAD | about))
        return cls(root, kind, config_hash, [fingerprint])

    @classmethod
    def read(cls, root: Path, *, mend: bool = True) -> "WrittenFiles | None":
        """Read the list of a folder; None where there is none.

        A last line without an end is that of a file which never got its name: the run was killed. It is cut off,
        unless the list is only looked at (``mend`` is false).

        Raises
        ------
        DamagedListError
            If a line is not one that this module writes.
        InputError
            If something else stands in its place, or another version of this program wrote it.
        """
        if not has_list(root):
            return None
        path = root / LIST_NAME
        text = read_file(path, key="--out", allowed="a list that a run wrote there", max_bytes=_MAX_BYTES)
        whole = text[: text.rfind(b"\n") + 1]
        lines = whole.splitlines()
        try:
            head = dict(parse_json(lines[0]))
            if head["software"] != DISTRIBUTION:
                raise ValueError("not a list of this program")
            if head["schema_version"] != SCHEMA_VERSION:
                hint = "another version wrote the run that it holds"
                raise refused(root, "a folder of this version of the program", hint)
            kind, config_hash, begun = (str(head[name]) for name in ("kind", "config_hash", "fingerprint"))
            listed = cls(root, kind, config_hash, [begun])
            for line in lines[1:]:
                listed._note(parse_json(line))
        except InputError:
            raise
        except (ValueError, KeyError, TypeError, IndexError, AttributeError) as error:
            raise DamagedListError(f"{type(error).__name__}: {error}") from None
        if mend and len(whole) < len(text):
            os.truncate(path, len(whole))
        return listed

    def met(self, fingerprint: str) -> None:
        """Note another processor that took part."""
        if fingerprint not in self.fingerprints:
            self._add({"fingerprint": fingerprint})

    def standing(self, name: str) -> Standing:
        """Return whether the place of a listed file is free, holds what was written there, or something changed.

        Raises
        ------
        InputError
            If a folder on the way is a link or no folder.
        """
        path = self._place(name)
        try:
            about = path.lstat()
        except FileNotFoundError:
            return "free"
        known = self._contents[name]
        if not stat.S_ISREG(about.st_mode) or about.st_size not in {size for size, _ in known}:
            return "changed"
        try:
            return "ours" if (about.st_size, digest_of(path)) in known else "changed"
        except InputError:  # it cannot be read: nobody can say that it is ours
            return "changed"

    def names(self) -> list[str]:
        """Return the names of the listed files that stand in the folder, as they were written or not."""
        return sorted(name for name in self._contents if os.path.lexists(self.root / name))

    def missing(self) -> list[str]:
        """Return the names of the listed files that do not stand there; a run that was stopped lacks its last ones."""
        return sorted(set(self._contents).difference(self.names()))

    def refuse_foreign(self, name: str) -> None:
        """Refuse a name under which somebody else's file stands.

        Raises
        ------
        InputError
            Naming the file.
        """
        path = self._place(name)
        if name not in self._contents and os.path.lexists(path):
            hint = "the run writes a file of this name, and did not write the one that is there"
            raise refused(path, _WITHOUT_IT, f"{hint}: {_MOVE_IT}")

    def install(self, temporary: Path, name: str, *, size_bytes: int, sha256: str) -> Path:
        """Give a file, whole under a temporary name in the same file system, its name below the folder.

        One of ours that stands there is replaced; one that was changed since we wrote it is set aside.

        Parameters
        ----------
        temporary : Path
            File that is renamed.
        name : str
            Name of the file in the folder.
        size_bytes : int
            Its size, bytes.
        sha256 : str
            Hash of its content.

        Raises
        ------
        InputError
            If somebody else's file stands there.
        """
        self.refuse_foreign(name)
        for folder in reversed(PurePosixPath(name).parents[:-1]):
            if not (self.root / folder).exists():
                self._add({"folder": folder.as_posix()})
                (self.root / folder).mkdir()
        if name in self._contents and self.standing(name) == "changed":
            self._set_changed_aside(name)
        if (size_bytes, sha256) not in self._contents.get(name, set()):
            self._add({"file": name, "size_bytes": size_bytes, "sha256": sha256})
        path = self.root / name
        temporary.replace(path)
        return path

    def clear(self) -> None:
        """Remove the listed files, and the folders made for them where they are empty; set aside what was changed."""
        for name in sorted(self._contents):
            try:
                standing = self.standing(name)
            except InputError:  # behind a link: not where we wrote it
                continue
            if standing == "ours":
                (self.root / name).unlink()
            elif standing == "changed":
                self._set_changed_aside(name)
        self.sweep()
        for folder in sorted(self._folders, key=len, reverse=True):
            with contextlib.suppress(OSError, InputError):  # not empty, or not a folder any more
                self._place(folder).rmdir()

    def sweep(self) -> None:
        """Remove the temporary folders of runs that were killed."""
        for name in self._temporary:
            path = self.root / name
            if not path.is_symlink() and path.is_dir():
                shutil.rmtree(path, ignore_errors=True)

    @contextlib.contextmanager
    def temporary_folder(self) -> Iterator[Path]:
        """Make a listed folder for files that are not whole yet; removed at the end."""
        name = f".cpic-{secrets.token_hex(4)}"
        self._add({"temporary": name})
        (self.root / name).mkdir()
        try:
            yield self.root / name
        finally:
            self.sweep()  # all: workers of a run that was killed go on for a moment, and write into theirs

    def _place(self, name: str) -> Path:
        """Return the path of a name below the folder; no folder on the way is a link."""
        path = self.root
        for part in PurePosixPath(name).parent.parts:
            path = path / part
            if path.is_symlink() or (path.exists() and not path.is_dir()):
                hint = "the run needs a folder of this name, and this is a link or a file"
                raise refused(path, _WITHOUT_IT, f"{hint}: {_MOVE_IT}")
        return self.root / name

    def _set_changed_aside(self, name: str) -> None:
        kept = set_aside(self.root / name, "changed")
        _LOG.warning("%s was changed after it was written: kept as %s", name, kept.name)

    def _add(self, line: Mapping[str, Any]) -> None:
        """Add a line; it is on the disk when this returns."""
        flags = os.O_RDWR | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC
        handle = os.open(self.root / LIST_NAME, flags)
        try:
            size, data = os.fstat(handle).st_size, _line(line).encode()
            if os.write(handle, data) < len(data):
                os.ftruncate(handle, size)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.root / LIST_NAME))
            os.fsync(handle)
        finally:
            os.close(handle)
        self._note(line)

    def _note(self, line: Mapping[str, Any]) -> None:
        if "file" in line:
            facts = int(line["size_bytes"]), str(line["sha256"])
            self._contents.setdefault(_below(line["file"]), set()).add(facts)
        elif "fingerprint" in line:
            self.fingerprints.append(str(line["fingerprint"]))
        elif "folder" in line:
            self._folders.append(_below(line["folder"]))
        elif _TEMPORARY.fullmatch(line["temporary"]):
            self._temporary.append(line["temporary"])
        else:
            raise ValueError("not the name of a temporary folder")


def _below(name: str) -> str:
    """Return a name of a list as it is; one that leads out of the folder is none of ours."""
    if not name or name.startswith("/") or not {"", ".", ".."}.isdisjoint(name.split("/")):
        raise ValueError("not a name below the folder")
    return name


def has_list(root: Path) -> bool:
    """Return whether a folder holds a list, damaged or not.

    Raises
    ------
    InputError
        If a link, a folder or the like stands in its place.
    """
    path = root / LIST_NAME
    if os.path.lexists(path) and (path.is_symlink() or not path.is_file()):
        raise refused(path, _WITHOUT_IT, "it is no list of a run")
    return path.exists()


def set_aside(path: Path, word: str) -> Path:
    """Rename a file, or a link, to the first free ``NAME.WORD-N`` beside it; returns the new path."""
    number = 1
    while os.path.lexists(new := path.with_name(f"{path.name}.{word}-{number}")):
        number += 1
    path.rename(new)
    return new


def _line(tree: Mapping[str, Any]) -> str:
    return json.dumps(tree, ensure_ascii=False) + "\n"
