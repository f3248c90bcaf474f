"""The output folder of a run: locked, resumable, and never half written.

Layout::

    DIR/run.lock        operating-system lock; the holder writes pid and start time into it
    DIR/manifest.json   kind of run, configuration hash, schema version
    DIR/parts/KEY.json  one finished piece of work each, with its own checksum
    DIR/parts/KEY.blob  the same for pieces that are bytes: a line of JSON (key, hash, checksum), then they
    DIR/plan.json ...   the products, written at the end

A folder of the same configuration hash is resumed (finished parts are reused); of another one it is
refused unless forced, and then its parts are dropped. One in which nothing was finished is taken over.
A part that fails its checksum is done again.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from catalogs.errors import InputError
from simulator.files import LockHeld, dump_json, exclusive_lock, write_bytes, write_json, write_text

__all__ = ["DamagedPartError", "RunFolder", "open_run_folder"]

_LOG = logging.getLogger(__name__)
SCHEMA_VERSION = 1
PRODUCTS = ("simulation.json", "plan.json", "confirm.json", "sensitivity.json", "run.json", "ranking.csv",
            "ranking.ecsv", "measurements.csv", "report.html", "whatif.json", "targets.csv")  # fmt: skip


class DamagedPartError(RuntimeError):
    """A part is not as it was written, or belongs to another configuration."""


@dataclass(frozen=True)
class RunFolder:
    """An open, locked output folder."""

    path: Path
    config_hash: str
    resumed: bool

    def part(self, key: str) -> dict[str, Any] | None:
        """Finished piece of work ``key``, or ``None`` (also when its file is damaged)."""
        path = self._part_path(key, ".json")
        try:
            stored = json.loads(path.read_text(encoding="utf-8"))
            body = stored["body"]
            if stored["sha256"] != _digest(body) or stored["config_hash"] != self.config_hash:
                raise ValueError("checksum or configuration differs")
        except FileNotFoundError:
            return None
        except (ValueError, KeyError, TypeError, OSError) as error:
            _LOG.warning("part %s is damaged (%s): doing it again", path.name, error)
            return None
        return dict(body)

    def save_part(self, key: str, body: dict[str, Any]) -> dict[str, Any]:
        """Store a finished piece of work whole; returns it as it will be read back."""
        text = dump_json({"sha256": _digest(body), "config_hash": self.config_hash, "body": body})
        self.path.joinpath("parts").mkdir(exist_ok=True)
        write_text(self._part_path(key, ".json"), text)
        return dict(json.loads(text)["body"])

    def save_blob(self, key: str, content: bytes) -> None:
        """Store a finished piece of work that is bytes whole."""
        head = {"key": key, "sha256": hashlib.sha256(content).hexdigest(), "config_hash": self.config_hash}
        self.path.joinpath("parts").mkdir(exist_ok=True)
        write_bytes(self._part_path(key, ".blob"), json.dumps(head).encode() + b"\n" + content)

    def blob_paths(self) -> list[Path]:
        """Files of all pieces that are bytes, whole or not, in the order of their names."""
        return sorted(self.path.joinpath("parts").glob("[!.]*.blob"))

    def read_blob(self, path: Path) -> tuple[str, bytes]:
        """Key and content of one of `blob_paths`.

        Raises
        ------
        DamagedPartError
            If it is not what `save_blob` wrote there in a run of this configuration.
        """
        try:
            line, _, content = path.read_bytes().partition(b"\n")
            head = json.loads(line)
            good = (
                head["sha256"] == hashlib.sha256(content).hexdigest()
                and head["config_hash"] == self.config_hash
                and self._part_path(head["key"], ".blob") == path
            )
        except (ValueError, KeyError, TypeError, AttributeError, OSError) as error:
            raise DamagedPartError(f"part {path.name} is damaged ({type(error).__name__}: {error})") from None
        if not good:
            raise DamagedPartError(f"part {path.name} is damaged (checksum, configuration or name differs)")
        return head["key"], content

    def write(self, name: str, text: str) -> Path:
        """Write one product of the run whole."""
        return write_text(self.path / name, text)

    def write_bytes(self, name: str, content: bytes) -> Path:
        """Write one product that is no text whole."""
        return write_bytes(self.path / name, content)

    def _part_path(self, key: str, suffix: str) -> Path:
        safe = "".join(char if char.isalnum() or char in "-_" else "_" for char in key)
        return self.path / "parts" / f"{safe}-{hashlib.sha256(key.encode()).hexdigest()[:8]}{suffix}"


def _digest(body: Any) -> str:
    return hashlib.sha256(json.dumps(body, sort_keys=True, allow_nan=False).encode()).hexdigest()


@contextlib.contextmanager
def open_run_folder(
    path: str | Path,
    *,
    kind: str,
    config_hash: str,
    force: bool = False,
    clear: Callable[[Path], None] = lambda folder: None,
) -> Iterator[RunFolder]:
    """Open an output folder for one run.

    Parameters
    ----------
    path : str or Path
        Folder; created with its parents if absent.
    kind : str
        Kind of run (``plan``, ``confirm``, ``simulation``).
    config_hash : str
        Hash of everything that decides the result.
    force : bool
        Drop what a run of another configuration left there.
    clear : callable
        Called with the folder to remove what a run of this kind, but of another configuration, left there besides
        parts and the products of this module's list.

    Raises
    ------
    InputError
        If another live run holds the folder, if it holds another configuration (unless ``force``), if it holds
        files that are not a run's, or if it cannot be made.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not os.access(folder, os.W_OK):
            raise PermissionError(13, "not writable")
    except OSError as error:
        raise InputError("--out", str(folder), allowed="a writable folder", hint=error.strerror or "") from None
    foreign = [p.name for p in folder.iterdir() if not p.name.startswith(".")]
    if foreign and not (folder / "manifest.json").exists() and not (folder / "run.lock").exists() and not force:
        raise InputError("--out", str(folder), allowed="an empty folder or one of an earlier run",
                         hint=f"it holds {sorted(foreign)[0]}; --force writes there all the same")  # fmt: skip
    with contextlib.ExitStack() as stack:
        try:
            lock = stack.enter_context(exclusive_lock(folder / "run.lock", wait=False))
        except LockHeld as held:
            raise InputError("--out", str(folder), allowed="a folder that no other run is using",
                             hint=held.text or "another run holds it") from None  # fmt: skip
        lock.seek(0)
        lock.truncate()
        lock.write(f"in use by pid {os.getpid()}, started {datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC\n")
        lock.flush()
        resumed = _claim(folder, kind, config_hash, force, clear)
        if resumed:  # a killed run leaves what it was just writing under a temporary name
            for stale in (*folder.glob(".*.part"), *folder.glob("parts/.*.part")):
                stale.unlink(missing_ok=True)
        yield RunFolder(folder, config_hash, resumed)
        lock.seek(0)
        lock.truncate()


def _holds_work(folder: Path) -> bool:
    """Whether a run finished anything here: a folder that was only begun may be taken over."""
    return any((folder / "parts").glob("[!.]*.*")) or any((folder / name).exists() for name in PRODUCTS)


def _claim(folder: Path, kind: str, config_hash: str, force: bool, clear: Callable[[Path], None]) -> bool:
    """Check or write the manifest; true when work of the same configuration is there."""
    manifest = {"schema_version": SCHEMA_VERSION, "kind": kind, "config_hash": config_hash}
    path = folder / "manifest.json"
    try:
        old = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        old = None
    if not isinstance(old, dict):
        old = None
    if old == manifest:
        return True
    if old is not None and not force and _holds_work(folder):
        raise InputError("--out", str(folder), allowed=f"a folder of configuration {config_hash}",
                         hint=f"it holds a {old.get('kind')} of configuration {old.get('config_hash')}; "
                         "choose another folder, or --force to replace it")  # fmt: skip
    if old is not None and old.get("kind") == kind:
        clear(folder)
    shutil.rmtree(folder / "parts", ignore_errors=True)
    for name in PRODUCTS:
        (folder / name).unlink(missing_ok=True)
    write_json(path, manifest)
    return False
