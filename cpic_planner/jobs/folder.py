"""The output folder of a run: locked, resumable, never half written, and with a list of the files that the run wrote.

Layout::

    DIR/run.lock        operating-system lock; the holder writes pid and start time into it
    DIR/cpic-run.jsonl  kind of run, configuration hash, fingerprint, every file that the run wrote, by its checksum
    DIR/parts/KEY.json  one finished piece of work each: a line of JSON (key, checksum, hash, fingerprint), then the
                        piece, JSON too
    DIR/parts/KEY.blob  the same for pieces that are bytes
    DIR/plan.json ...   the products, written at the end

The configuration hash is that of what decides the pieces (`cpic_planner.jobs.job.Job.parts_digest`). A folder of the
same one is resumed (finished parts are reused) by the same code, data and libraries;
one of another hash or of others is refused unless forced, and then what its list names is removed. One in which nothing
was finished is taken over. A part that fails its checksum is done again. Files that no list names are never touched.

The list has one JSON object a line. The first line says whose list it is; every other line was added before the file
that it names got its name, so that a run which is killed leaves no file that its list does not know::

    {"software": "cpic-planner", "schema_version": 3, "kind": "plan", "config_hash": "...", "fingerprint": "..."}
    {"folder": "parts"}
    {"file": "parts/x-01234567.json", "size_bytes": 123, "sha256": "..."}

A file belongs to the run if the list names it and it still has one of the contents that the list gives for it. A listed
file with another content was changed by somebody: it is renamed, never removed. Links are not followed.
A line ``{"fingerprint": "..."}`` is that of another processor that took part; `cpic_core.provenance` says what one is.
"""

import contextlib
import errno
import hashlib
import json
import logging
import os
import re
import secrets
import shutil
import stat
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import Any, Literal

from cpic_core import (
    PROMISES,
    InputError,
    LockHeld,
    check_writable,
    differing_words,
    digest_of,
    dump_json,
    exclusive_lock,
    fingerprint as own_fingerprint,
    parse_json,
    read_file,
    utf8,
    write_bytes,
    write_text,
)
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


@dataclass(eq=False)
class RunFolder:
    """An output folder and the list of what its run wrote there; who writes into it holds its lock.

    Attributes
    ----------
    path : Path
    kind, config_hash : str
        Kind and configuration of the run.
    fingerprints : list of str
        Of the process that began it, and of others that differ in the processor alone and took part.
    fingerprint : str
        Of the process that has it open.
    resumed : bool
        Whether it held work of the same configuration when it was opened.
    temporary : Path
        Folder for files that are not whole yet, in the same file system; `adopt` gives them their names.
    """

    path: Path
    kind: str
    config_hash: str
    fingerprints: list[str]
    fingerprint: str = ""
    resumed: bool = False
    temporary: Path = Path()
    _contents: dict[str, set[tuple[int, str]]] = field(default_factory=dict)
    _folders: list[str] = field(default_factory=list)
    _temporaries: list[str] = field(default_factory=list)

    @classmethod
    def begin(cls, root: Path, kind: str, config_hash: str, fingerprint: str) -> "RunFolder":
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
    def read(cls, root: Path, *, mend: bool = True) -> "RunFolder | None":
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
        """Note another processor that took part, and say what that means."""
        if fingerprint not in self.fingerprints:
            _LOG.warning("%s: another processor takes part: %s, not %s", self.path, *PROMISES[::-1])
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
        return sorted(name for name in self._contents if os.path.lexists(self.path / name))

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

    def part(self, key: str) -> dict[str, Any] | None:
        """Return the finished piece of work ``key``, or ``None`` (also when it, or a file of it, is damaged)."""
        path = self.path / self._part_name(key, ".json")
        if not os.path.lexists(path):
            return None
        try:
            body = dict(parse_json(self.read_blob(path)[1]))
        except DamagedPartError as error:
            _LOG.warning("%s: doing it again", error)
            return None
        return body if all(self._is_whole(name, **about) for name, about in body.get("files", {}).items()) else None

    def _is_whole(self, name: str, size_bytes: int, sha256: str) -> bool:
        """Return whether a file of a piece is as it was left."""
        path = self.path / name
        return path.is_file() and path.stat().st_size == size_bytes and digest_of(path) == sha256

    def save_part(self, key: str, body: dict[str, Any]) -> dict[str, Any]:
        """Store a finished piece of work whole; returns it as it will be read back.

        Parameters
        ----------
        key : str
            Name of the finished piece.
        body : mapping
            Plain data of a finished piece. Its ``files``, if it has any, are size and hash by name of those below
            ``temporary/KEY``: they get their names first, the last one before the others.
        """
        for name in reversed(body.get("files", {})):
            self.adopt(self.temporary / key / name, name, **body["files"][name])
        text = dump_json(body)
        self._save(key, ".json", utf8(text))
        return dict(parse_json(text))

    def save_blob(self, key: str, content: bytes) -> None:
        """Store a finished piece of work that is bytes whole."""
        self._save(key, ".blob", content)

    def _save(self, key: str, suffix: str, content: bytes) -> None:
        head = {"key": key, "sha256": hashlib.sha256(content).hexdigest()}
        head |= {name: getattr(self, name) for name in ("config_hash", "fingerprint")}
        self.write_bytes(self._part_name(key, suffix), json.dumps(head).encode() + b"\n" + content)

    def blob_paths(self) -> list[Path]:
        """Return the files of all pieces that are bytes, whole or not, in the order of their names."""
        return [self.path / name for name in self.names() if name.endswith(".blob")]

    def read_blob(self, path: Path) -> tuple[str, bytes]:
        """Return the key and content of a finished piece of work.

        Raises
        ------
        DamagedPartError
            If it is not what was stored there in a run of this configuration.
        """
        try:
            content = read_file(path, key="part", allowed="a readable file", max_bytes=_MAX_PART_BYTES)
            line, _, content = content.partition(b"\n")
            head = parse_json(line)
            good = (
                head["sha256"] == hashlib.sha256(content).hexdigest()
                and head["config_hash"] == self.config_hash
                and not _other(head["fingerprint"], self.fingerprint)
                and self.path / self._part_name(head["key"], path.suffix) == path
            )
        except (ValueError, KeyError, TypeError, AttributeError, OSError) as error:
            raise DamagedPartError(f"part {path.name} is damaged ({type(error).__name__}: {error})") from None
        if not good:
            raise DamagedPartError(f"part {path.name} is damaged (checksum, configuration, software or name differs)")
        return head["key"], content

    def write(self, name: str, text: str) -> Path:
        """Write one product of the run whole.

        Parameters
        ----------
        name : str
            Name of the file in the folder.
        text : str
            Content of the file.
        """
        return self.write_bytes(name, utf8(text))

    def write_bytes(self, name: str, content: bytes) -> Path:
        """Write one product that is no text whole.

        Raises
        ------
        InputError
            If a file of this name is there that the run did not write.
        """
        whole = write_bytes(self.temporary / "product", content)
        return self.adopt(whole, name, size_bytes=len(content), sha256=hashlib.sha256(content).hexdigest())

    def _part_name(self, key: str, suffix: str) -> str:
        safe = "".join(char if char.isalnum() or char in "-_" else "_" for char in key)
        return f"parts/{safe}-{hashlib.sha256(utf8(key)).hexdigest()[:8]}{suffix}"

    def adopt(self, whole: Path, name: str, *, size_bytes: int, sha256: str) -> Path:
        """Make a whole file, of a temporary name in the same file system, a product of the run.

        One of ours that stands there is replaced; one that was changed since we wrote it is set aside.

        Parameters
        ----------
        whole : Path
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
            if not (self.path / folder).exists():
                self._add({"folder": folder.as_posix()})
                (self.path / folder).mkdir()
        if name in self._contents and self.standing(name) == "changed":
            self._set_changed_aside(name)
        if (size_bytes, sha256) not in self._contents.get(name, set()):
            self._add({"file": name, "size_bytes": size_bytes, "sha256": sha256})
        path = self.path / name
        whole.replace(path)
        return path

    def clear(self) -> None:
        """Remove the listed files, and the folders made for them where they are empty; set aside what was changed."""
        for name in sorted(self._contents):
            try:
                standing = self.standing(name)
            except InputError:  # behind a link: not where we wrote it
                continue
            if standing == "ours":
                (self.path / name).unlink()
            elif standing == "changed":
                self._set_changed_aside(name)
        self.sweep()
        for folder in sorted(self._folders, key=len, reverse=True):
            with contextlib.suppress(OSError, InputError):  # not empty, or not a folder any more
                self._place(folder).rmdir()

    def sweep(self) -> None:
        """Remove the temporary folders of runs that were killed."""
        for name in self._temporaries:
            path = self.path / name
            if not path.is_symlink() and path.is_dir():
                shutil.rmtree(path, ignore_errors=True)

    @contextlib.contextmanager
    def temporary_folder(self) -> Iterator[Path]:
        """Make a listed folder for files that are not whole yet; removed at the end."""
        name = f".cpic-{secrets.token_hex(4)}"
        self._add({"temporary": name})
        (self.path / name).mkdir()
        try:
            yield self.path / name
        finally:
            self.sweep()  # all: workers of a run that was killed go on for a moment, and write into theirs

    def _place(self, name: str) -> Path:
        """Return the path of a name below the folder; no folder on the way is a link."""
        path = self.path
        for part in PurePosixPath(name).parent.parts:
            path = path / part
            if path.is_symlink() or (path.exists() and not path.is_dir()):
                hint = "the run needs a folder of this name, and this is a link or a file"
                raise refused(path, _WITHOUT_IT, f"{hint}: {_MOVE_IT}")
        return self.path / name

    def _set_changed_aside(self, name: str) -> None:
        kept = set_aside(self.path / name, "changed")
        _LOG.warning("%s was changed after it was written: kept as %s", name, kept.name)

    def _add(self, line: Mapping[str, Any]) -> None:
        """Add a line; it is on the disk when this returns."""
        flags = os.O_RDWR | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC
        handle = os.open(self.path / LIST_NAME, flags)
        try:
            size, data = os.fstat(handle).st_size, _line(line).encode()
            if os.write(handle, data) < len(data):
                os.ftruncate(handle, size)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path / LIST_NAME))
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
            self._temporaries.append(line["temporary"])
        else:
            raise ValueError("not the name of a temporary folder")


def _below(name: str) -> str:
    """Return a name of a list as it is; one that leads out of the folder is none of ours."""
    if not name or name.startswith("/") or not {"", ".", ".."}.isdisjoint(name.split("/")):
        raise ValueError("not a name below the folder")
    return name


def contents_of(root: Path, names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Return the size and the checksum of files by their names, as pieces of work state them."""
    return {name: {"size_bytes": (root / name).stat().st_size, "sha256": digest_of(root / name)} for name in names}


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


_MAX_PART_BYTES = 4_000_000_000
_LOCK = "run.lock"
_LOCK_TEXT = "in use by pid "
_NO_LOCK = (errno.ELOOP, errno.EINVAL, errno.EISDIR, errno.ENXIO, errno.EACCES, errno.EPERM)
_ANY_PART = "parts/-"  # is of no part: asks whether parts may be a folder of ours
_OLD_LIST = "manifest.json"  # of versions that kept no list of their files


class DamagedPartError(RuntimeError):
    """A part is not as it was written, or belongs to another configuration, or to other code, data or libraries."""


def check_run_folder(path: str | Path, *, products: Sequence[str] = (), force: bool = False) -> None:
    """Refuse a folder of which no configuration makes the folder of a run, before any work; nothing is made.

    Parameters
    ----------
    path, products, force
        As of `open_run_folder`.

    Raises
    ------
    InputError
        If it cannot be made or written, or holds files that no run wrote (unless ``force``) or that have the name of
        a product.
    """
    folder = Path(path)
    check_writable(folder, key="--out", folder=True)
    if folder.exists() and not has_list(folder):
        _refuse_foreign(folder, products, force)


@contextlib.contextmanager
def open_run_folder(
    path: str | Path,
    *,
    kind: str,
    config_hash: str,
    products: Sequence[str] = (),
    force: bool = False,
    fingerprint: str | None = None,
) -> Iterator[RunFolder]:
    """Open an output folder for one run.

    Parameters
    ----------
    path : str or Path
        Folder; created with its parents if absent.
    kind : str
        Kind of run (``plan``, ``confirm``, ``simulation``, ``whatif``).
    config_hash : str
        Hash of everything that decides the finished pieces of work.
    products : sequence of str
        Names below the folder that the run will write: refused now, not at the end, where somebody else's files stand.
    force : bool
        Remove what the list of another run names, and write beside files that no list names. These are never removed
        or replaced; listed files that were changed since are renamed.
    fingerprint : str, optional
        Of what runs; that of this process by default.

    Raises
    ------
    InputError
        If another live run holds the folder, if it holds another configuration, work of other code, data or libraries,
        or files that no run wrote (unless ``force``), if such a file has the name of a product, or if it cannot be
        made.
    """
    folder, mine = Path(path), fingerprint or str(own_fingerprint())
    check_run_folder(folder, products=products, force=force)  # before the lock: not even that is left in somebody's
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise refused(folder, "a writable folder", error.strerror or "") from None
    with contextlib.ExitStack() as stack:
        stack.enter_context(_locked(folder))
        try:
            files = RunFolder.read(folder)
        except DamagedListError as error:
            text = "the list of the run, %s, is damaged (%s): kept as %s; nothing that it names is removed"
            _LOG.warning(text, LIST_NAME, error, set_aside(folder / LIST_NAME, "damaged").name)
            files = None
        if files is None:
            _refuse_foreign(folder, products, force)
        same = files is not None and (files.kind, files.config_hash) == (kind, config_hash)
        other = [] if files is None else _other(files.fingerprints[0], mine)
        resumed = same and not other
        if files is not None and not resumed and files.names():
            held = f"it holds a {files.kind} of configuration {files.config_hash}"
            asked = f"a folder of configuration {config_hash}"
            if same:
                held = f"what it holds was made with other {' and '.join(other)}"
                asked = "a folder of the same code, presets, catalogue and libraries"
            if not force:
                raise refused(folder, asked, f"{held}; choose another folder, or --force to replace it")
            _LOG.warning("%s: begun anew: %s", folder, held)
        if files is not None:
            _refuse_names(files, products)
        if files is None or not resumed:
            if files is not None:
                files.clear()
            files = RunFolder.begin(folder, kind, config_hash, mine)
        files.sweep()
        files.fingerprint, files.resumed = mine, resumed
        files.temporary = stack.enter_context(files.temporary_folder())
        files.met(mine)
        yield files


def _other(one: str, other: str) -> list[str]:
    """Return what two fingerprints differ in, the processor apart."""
    return [word for word in differing_words(one, other) if word != "processor"]


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder, and say in it who does."""
    path = folder / _LOCK
    hint = "it is no lock of a run: move it, or choose another folder"
    foreign = refused(path, "a folder without this file", hint)
    with contextlib.ExitStack() as stack:
        try:
            lock = stack.enter_context(exclusive_lock(path, wait=False))
        except LockHeld as held:
            text = held.text if held.text.startswith(_LOCK_TEXT) else "another run holds it"
            raise refused(folder, "a folder that no other run is using", text) from None
        except OSError as error:
            if error.errno not in _NO_LOCK:  # a full or broken disk says nothing about whose file it is
                raise
            raise foreign from None
        lock.seek(0)
        if lock.read(len(_LOCK_TEXT)) not in ("", _LOCK_TEXT):
            raise foreign
        lock.truncate(0)
        lock.write(f"{_LOCK_TEXT}{os.getpid()}, started {datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC\n")
        lock.flush()
        try:
            yield
        finally:
            lock.truncate(0)


def _refuse_foreign(folder: Path, products: Sequence[str], force: bool) -> None:
    """Refuse a folder without a list that holds files, or, if forced, files with the names of products."""
    held = sorted(p.name for p in folder.iterdir() if not p.name.startswith(".") and p.name != _LOCK)
    held = [name for name in held if not name.startswith(LIST_NAME)]
    if held and not force:
        hint = f"it holds {held[0]}, which no list of a run names; --force writes beside it"
        if _OLD_LIST in held and "parts" in held:
            hint = f"it holds {_OLD_LIST} of a version that kept no list of its files, or somebody else's"
        raise refused(folder, "an empty folder or one of an earlier run", hint)
    _refuse_names(RunFolder(folder, "", "", []), products)


def _refuse_names(files: RunFolder, products: Sequence[str]) -> None:
    for name in (*products, _ANY_PART):
        files.refuse_foreign(name)
