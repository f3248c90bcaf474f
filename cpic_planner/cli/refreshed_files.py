"""Refreshed tables of stars and of known planets, left whole beside the shipped ones, which never change."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import catalogs
from catalogs import (
    Cuts,
    Refreshed,
    RefreshedPlanets,
    RefreshError,
    TableBytes,
    TapService,
    data_dir,
    ecsv_text,
    file_name,
    parse_planets,
    parse_refreshed,
    planets_ecsv,
    refresh_planets,
    refresh_stars,
    set_aside,
)
from cpic_core import InputError, at_home, check_writable, write_named
from cpic_planner.version import DISTRIBUTION, __version__

_EMBEDDED = Path(catalogs.__file__).resolve().parent
_SOFTWARE = ("pyvo", "astroquery", "astropy", "numpy")

Listener = Callable[[str], None]


@dataclass(frozen=True)
class Written:
    """A refreshed table on disk, of stars or of planets."""

    path: Path
    sha256: str
    made: Refreshed | RefreshedPlanets

    def summary(self) -> dict[str, Any]:
        """Return what happened, as plain values: file, source, counts, and what differs from the shipped table."""
        made = self.made
        return {
            "schema_version": 1,
            "kind": "catalog_refresh" if isinstance(made, Refreshed) else "planets_refresh",
            "file": str(self.path),
            "sha256": self.sha256,
            "set_aside": made.refusal,
            "queried_utc": made.queried_utc.isoformat(),
            "service": made.url,
            "queries": list(made.queries),
            "counts": dict(made.counts),
            "changes_to_snapshot": dict(made.changes),
            "left_out": dict(made.left_out),
            **({"cuts": asdict(made.cuts)} if isinstance(made, Refreshed) else {"notes": list(made.notes)}),
        }


def target_path(out: str | Path | None) -> Path:
    """Return where a refreshed table goes: ``out``, or the data folder (the name then has the date of the query).

    Raises
    ------
    InputError
        If ``out`` does not end in ``.ecsv``, lies in the installed package, is a folder, or cannot be written.
    """
    if out is None:
        check_writable(data_dir(), key="CPIC_DATA_DIR", folder=True)
        return data_dir()
    path = at_home(out)
    if path.suffix != ".ecsv":
        raise InputError("--out", str(out), allowed="a file name that ends in .ecsv")
    if path.resolve().is_relative_to(_EMBEDDED):
        raise InputError("--out", str(out), allowed="a place outside the package: its own table never changes")
    check_writable(path, key="--out")
    return path


def refresh_catalog(
    *,
    planets: bool = False,
    out: str | Path | None = None,
    service: TapService | None = None,
    cuts: Cuts | None = None,
    step: Listener = lambda text: None,
    tell: Listener = lambda text: None,
) -> Written:
    """Ask an archive and write its stars or planets as one ECSV file, all or nothing.

    Parameters
    ----------
    planets : bool
        Ask the NASA Exoplanet Archive for planets of catalogue stars, not SIMBAD for stars.
    out : str or Path, optional
        File to write, replaced when it is there; by default a dated file in the data folder (`catalogs.data_dir`),
        where ``--catalog latest`` or ``--known-planets latest`` finds it. A table that lacks too much is set aside
        beside it.
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
    path, service = target_path(out), service or TapService()
    versions = {DISTRIBUTION: __version__} | {name: metadata.version(name) for name in _SOFTWARE}
    made: Refreshed | RefreshedPlanets
    # What cannot be read back is not worth writing.
    if planets:
        made = refresh_planets(service, step=step, tell=tell)
        text = planets_ecsv(made, versions)
        parse_planets(TableBytes("the new table", text.encode(), ""))
    else:
        made = refresh_stars(service, cuts or Cuts(), step=step, tell=tell)
        text = ecsv_text(made, versions)
        parse_refreshed(text, "the new table")
    path = path / file_name(made.queried_utc, made.kind) if out is None else path
    path = set_aside(path) if made.refusal else path
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_named(path, text, key="--out")
    except OSError as error:
        hint = "choose another place with --out or CPIC_DATA_DIR"
        raise RefreshError(f"cannot write {path}: {error.strerror}", hint) from None
    return Written(path, hashlib.sha256(text.encode()).hexdigest(), made)
