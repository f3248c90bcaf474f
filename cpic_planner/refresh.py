"""Refresh the star table from SIMBAD and leave it, whole, beside the snapshot; the snapshot itself never changes."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import catalogs
from catalogs.errors import InputError
from catalogs.refresh import Refreshed, data_dir, ecsv_text, file_name, parse_refreshed, refresh
from catalogs.simbad import Cuts, RefreshError, TapService
from cpic_planner.version import DISTRIBUTION, __version__
from simulator.files import write_text

__all__ = ["Written", "refresh_catalog", "target_path"]

_EMBEDDED = Path(catalogs.__file__).resolve().parent
_SOFTWARE = ("astroquery", "pyvo", "astropy", "numpy")


@dataclass(frozen=True)
class Written:
    """A refreshed table on disk."""

    path: Path
    sha256: str
    made: Refreshed

    def summary(self) -> dict[str, Any]:
        """What happened, as plain values: file, source, counts, and what differs from the snapshot."""
        made, changes = self.made, self.made.changes
        return {
            "schema_version": 1,
            "kind": "catalog_refresh",
            "file": str(self.path),
            "sha256": self.sha256,
            "queried_utc": made.queried_utc.isoformat(),
            "service": made.url,
            "queries": list(made.queries),
            "cuts": {"v_mag_max": made.cuts.v_mag_max, "parallax_min_mas": made.cuts.parallax_min_mas},
            "counts": dict(made.counts),
            "changes_to_snapshot": {
                "same": changes.same,
                "added": list(changes.added),
                "removed": dict(changes.removed),
                "v_mag_changed": list(changes.v_mag),
                "parallax_changed": list(changes.parallax),
            },
            "left_out": dict(made.left_out),
        }


def target_path(out: str | Path | None) -> Path:
    """Where a refreshed table goes: ``out``, or the data folder (the name then has the date of the query).

    Raises
    ------
    InputError
        If ``out`` does not end in ``.ecsv``, lies in the installed package, is a folder, or cannot be written.
    """
    if out is None:
        return data_dir()
    path = Path(out).expanduser()
    if path.suffix != ".ecsv" or path.is_dir():
        raise InputError("--out", str(out), allowed="a file name that ends in .ecsv")
    if path.resolve().is_relative_to(_EMBEDDED):
        raise InputError("--out", str(out), allowed="a place outside the package: its own table never changes")
    if not path.parent.is_dir():
        raise InputError("--out", str(out), allowed="a file in a folder that exists")
    return path


def refresh_catalog(
    *,
    out: str | Path | None = None,
    service: TapService | None = None,
    cuts: Cuts | None = None,
    step: Callable[[str], None] = lambda text: None,
    tell: Callable[[str], None] = lambda text: None,
) -> Written:
    """Ask SIMBAD for the stars and write them as one ECSV file, all or nothing.

    Parameters
    ----------
    out : str or Path, optional
        File to write, replaced when it is there; by default a dated file in the data folder
        (`catalogs.refresh.data_dir`), where ``--catalog latest`` finds it.
    service : TapService, optional
        Where and how patiently to ask.
    cuts : Cuts, optional
        Which stars.
    step, tell : callable
        Told of finished steps, and of failures that are tried again.

    Raises
    ------
    RefreshError
        If the service fails, its answers cannot be right, or the file cannot be written. Files that were there stay
        as they are.
    InputError
        If ``out`` cannot be a place for it.
    """
    place = target_path(out)
    _check_writable(place)
    made = refresh(service or TapService(), cuts or Cuts(), step=step, tell=tell)
    text = ecsv_text(made, _versions())
    path = place / file_name(made.queried_utc) if out is None else place
    parse_refreshed(text, path.name)  # what cannot be read back is not worth writing
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
    except OSError as error:
        raise _unwritable(path, error.strerror) from None
    return Written(path, hashlib.sha256(text.encode()).hexdigest(), made)


def _check_writable(place: Path) -> None:
    """Refuse before the long question what would fail after it."""
    folder = place if place.suffix != ".ecsv" else place.parent
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    if not folder.is_dir() or not os.access(folder, os.W_OK):
        raise _unwritable(place, f"{folder} is not a writable folder")


def _unwritable(path: Path, reason: str | None) -> RefreshError:
    return RefreshError(f"cannot write {path}: {reason}", "choose another place with --out or CPIC_DATA_DIR")


def _versions() -> dict[str, str]:
    return {DISTRIBUTION: __version__} | {name: metadata.version(name) for name in _SOFTWARE}
