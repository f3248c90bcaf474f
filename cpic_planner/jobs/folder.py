"""The output folder of a run: locked, resumable, and never half written.

Layout::

    DIR/run.lock        operating-system lock; the holder writes pid and start time into it
    DIR/cpic-run.jsonl  kind of run, configuration hash, fingerprint, every file that the run wrote, by its checksum
    DIR/parts/KEY.json  one finished piece of work each: a line of JSON (key, checksum, hash, fingerprint), then the
                        piece, JSON too
    DIR/parts/KEY.blob  the same for pieces that are bytes
    DIR/plan.json ...   the products, written at the end

A folder of the same configuration hash is resumed (finished parts are reused) by the same code, data and libraries;
one of another hash or of others is refused unless forced, and then what its list names is removed
(`cpic_planner.jobs.written_files`). One in which nothing was finished
is taken over. A part that fails its checksum is done again. Files that no list names are never touched.
"""

import contextlib
import errno
import hashlib
import json
import logging
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from cpic_core import (
    PROMISES,
    LockHeld,
    check_writable,
    differing_words,
    dump_json,
    exclusive_lock,
    fingerprint as own_fingerprint,
    parse_json,
    read_file,
    utf8,
    write_bytes,
)
from cpic_planner.jobs.written_files import LIST_NAME, DamagedListError, WrittenFiles, has_list, refused, set_aside

_LOG = logging.getLogger(__name__)
_MAX_PART_BYTES = 4_000_000_000
_LOCK = "run.lock"
_LOCK_TEXT = "in use by pid "
_NO_LOCK = (errno.ELOOP, errno.EINVAL, errno.EISDIR, errno.ENXIO, errno.EACCES, errno.EPERM)
_ANY_PART = "parts/-"  # is of no part: asks whether parts may be a folder of ours
_OLD_LIST = "manifest.json"  # of versions that kept no list of their files


class DamagedPartError(RuntimeError):
    """A part is not as it was written, or belongs to another configuration, or to other code, data or libraries."""


@dataclass(frozen=True)
class RunFolder:
    """An open, locked output folder.

    Attributes
    ----------
    path : Path
    config_hash : str
    fingerprint : str
        Of the process that has it open.
    resumed : bool
        Whether it holds work of the same configuration.
    temporary : Path
        Folder for files that are not whole yet, in the same file system; `adopt` gives them their names.
    """

    path: Path
    config_hash: str
    fingerprint: str
    resumed: bool
    temporary: Path
    _files: WrittenFiles

    @property
    def fingerprints(self) -> list[str]:
        """Of the process that began the run, and of others that differ in the processor alone and took part."""
        return self._files.fingerprints

    def met(self, fingerprint: str) -> None:
        """Note another processor that took part, and say what that means."""
        if fingerprint not in self.fingerprints:
            _LOG.warning("%s: another processor takes part: %s, not %s", self.path, *PROMISES[::-1])
            self._files.met(fingerprint)

    def part(self, key: str) -> dict[str, Any] | None:
        """Return the finished piece of work ``key``, or ``None`` (also when its file is damaged)."""
        path = self.path / self._part_name(key, ".json")
        if not os.path.lexists(path):
            return None
        try:
            return dict(parse_json(self.read_blob(path)[1]))
        except DamagedPartError as error:
            _LOG.warning("%s: doing it again", error)
            return None

    def save_part(self, key: str, body: dict[str, Any]) -> dict[str, Any]:
        """Store a finished piece of work whole; returns it as it will be read back.

        Parameters
        ----------
        key : str
            Name of the finished piece.
        body : mapping
            Plain data of a finished piece.
        """
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
        return [self.path / name for name in self._files.names() if name.endswith(".blob")]

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

    def adopt(self, whole: Path, name: str, *, size_bytes: int, sha256: str) -> Path:
        """Make a whole file in `temporary` a product of the run; errors are those of `write_bytes`.

        Parameters
        ----------
        whole : Path
            File that is moved in.
        name : str
            Name of the file in the folder.
        size_bytes : int
            Its size, bytes.
        sha256 : str
            Hash of its content.
        """
        return self._files.install(whole, name, size_bytes=size_bytes, sha256=sha256)

    def _part_name(self, key: str, suffix: str) -> str:
        safe = "".join(char if char.isalnum() or char in "-_" else "_" for char in key)
        return f"parts/{safe}-{hashlib.sha256(utf8(key)).hexdigest()[:8]}{suffix}"


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
        Hash of everything that decides the result.
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
            files = WrittenFiles.read(folder)
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
            files = WrittenFiles.begin(folder, kind, config_hash, mine)
        files.sweep()
        temporary = stack.enter_context(files.temporary_folder())
        opened = RunFolder(folder, config_hash, mine, resumed, temporary, files)
        opened.met(mine)
        yield opened


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
    _refuse_names(WrittenFiles(folder, "", "", []), products)


def _refuse_names(files: WrittenFiles, products: Sequence[str]) -> None:
    for name in (*products, _ANY_PART):
        files.refuse_foreign(name)
