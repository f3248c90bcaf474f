"""Refreshed tables of stars and of known planets, left whole beside the shipped ones, which never change."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from importlib import metadata
from pathlib import Path
from typing import Any, Literal

import catalogs
from cpic_core import InputError, at_home, check_writable, write_named
from cpic_planner.version import DISTRIBUTION, __version__

_EMBEDDED = Path(catalogs.__file__).resolve().parent
_SOFTWARE = ("astroquery", "astropy", "numpy")

Listener = Callable[[str], None]


@dataclass(frozen=True)
class Written:
    """A refreshed table on disk: of stars or of planets; ``refusal`` says why it was set aside, if it was."""

    path: Path
    sha256: str
    refusal: str
    made: catalogs.Refreshed | catalogs.RefreshedPlanets

    def summary(self) -> dict[str, Any]:
        """Return what happened, as plain values: file, source, counts, and what differs from the shipped table."""
        if isinstance(self.made, catalogs.RefreshedPlanets):
            kind, more = "planets_refresh", _of_planets(self.made)
        else:
            kind, more = "catalog_refresh", _of_stars(self.made)
        about = {
            "schema_version": 1,
            "kind": kind,
            "file": str(self.path),
            "sha256": self.sha256,
            "set_aside": self.refusal,
            "queried_utc": self.made.queried_utc.isoformat(),
            "service": self.made.url,
        }
        return about | more


def _of_stars(made: catalogs.Refreshed) -> dict[str, Any]:
    changes = made.changes
    return {
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


def _of_planets(made: catalogs.RefreshedPlanets) -> dict[str, Any]:
    changes = made.changes
    return {
        "queries": [catalogs.PLANETS_QUERY],
        "counts": dict(made.planets.counts),
        "changes_to_snapshot": {
            "same": changes.same,
            "added": list(changes.added),
            "gone": dict(changes.gone),
            "orbit_moved": [
                {
                    "planet": item.planet,
                    "element": item.element,
                    "before": item.before,
                    "before_err": plain(item.before_err),
                    "now": item.now,
                    "now_err": plain(item.now_err),
                    "sigmas": plain(item.sigmas),
                }
                for item in changes.moved
            ],
        },
        "left_out": dict(made.planets.left_out),
        "notes": list(made.planets.notes),
    }


def plain(value: float) -> float | None:
    """Return a number as JSON has it: none where it is infinite or nan."""
    return value if abs(value) < float("inf") else None


def target_path(out: str | Path | None) -> Path:
    """Return where a refreshed table goes: ``out``, or the data folder (the name then has the date of the query).

    Raises
    ------
    InputError
        If ``out`` does not end in ``.ecsv``, lies in the installed package, is a folder, or cannot be written.
    """
    if out is None:
        check_writable(catalogs.data_dir(), key="CPIC_DATA_DIR", folder=True)
        return catalogs.data_dir()
    path = at_home(out)
    if path.suffix != ".ecsv":
        raise InputError("--out", str(out), allowed="a file name that ends in .ecsv")
    if path.resolve().is_relative_to(_EMBEDDED):
        raise InputError("--out", str(out), allowed="a place outside the package: its own table never changes")
    check_writable(path, key="--out")
    return path


def refresh_catalog(
    *,
    out: str | Path | None = None,
    service: catalogs.TapService | None = None,
    cuts: catalogs.Cuts | None = None,
    step: Listener = lambda text: None,
    tell: Listener = lambda text: None,
) -> Written:
    """Ask SIMBAD for the stars and write them as one ECSV file, all or nothing.

    Parameters
    ----------
    out : str or Path, optional
        File to write, replaced when it is there; by default a dated file in the data folder
        (`catalogs.data_dir`), where ``--catalog latest`` finds it. A table that lacks too much is set aside beside it.
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
    made = catalogs.refresh_stars(service or catalogs.TapService(), cuts or catalogs.Cuts(), step=step, tell=tell)
    text = catalogs.ecsv_text(made, _versions())
    path = _path(place, out is None, "simbad", made.queried_utc, made.refusal)
    catalogs.parse_refreshed(text, path.name)  # what cannot be read back is not worth writing
    return Written(path, _write(path, text), made.refusal, made)


def refresh_known_planets(
    *,
    out: str | Path | None = None,
    service: catalogs.TapService | None = None,
    step: Listener = lambda text: None,
    tell: Listener = lambda text: None,
) -> Written:
    """Ask the NASA Exoplanet Archive for planets of catalogue stars and write one ECSV file, all or nothing.

    Parameters
    ----------
    out : str or Path, optional
        As in `refresh_catalog`; ``--known-planets latest`` finds those in the data folder.
    service : TapService, optional
        Where and how patiently to ask.
    step, tell : callable
        Told of finished steps, and of failures that are tried again.

    Raises
    ------
    RefreshError
        As in `refresh_catalog`.
    InputError
        If ``out`` cannot be a place for it.
    """
    place = target_path(out)
    made = catalogs.refresh_planets(service or catalogs.TapService(), step=step, tell=tell)
    text = catalogs.planets_ecsv(made, _versions())
    path = _path(place, out is None, "archive", made.queried_utc, made.refusal)
    # What cannot be read back is not worth writing.
    catalogs.parse_planets(catalogs.TableBytes(path.name, text.encode(), ""))
    return Written(path, _write(path, text), made.refusal, made)


def _path(place: Path, dated: bool, kind: Literal["simbad", "archive"], queried: datetime, refusal: str) -> Path:
    path = place / catalogs.file_name(queried, kind) if dated else place
    return catalogs.set_aside(path) if refusal else path


def _write(path: Path, text: str) -> str:
    """Write a file whole, and return the sha256 of its content."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_named(path, text, key="--out")
    except OSError as error:
        hint = "choose another place with --out or CPIC_DATA_DIR"
        raise catalogs.RefreshError(f"cannot write {path}: {error.strerror}", hint) from None
    return hashlib.sha256(text.encode()).hexdigest()


def _versions() -> dict[str, str]:
    return {DISTRIBUTION: __version__} | {name: metadata.version(name) for name in _SOFTWARE}
