"""Refresh the star table from SIMBAD: ask, check, assemble, compare with the snapshot; and read what was kept back.

Where refreshed tables are kept, `catalogs.refreshed_tables` says. Nothing is written here: whoever does writes the
whole text at once.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from catalogs.catalogue import STAR_CREDITS, snapshot_vintage
from catalogs.refreshed_tables import DAMAGED, Refresh, ecsv_of, loss_refused, parse_ecsv
from catalogs.simbad import NARROWER, Cuts, queries, service_url
from catalogs.simbad_answer import read_measurements, read_stars
from catalogs.simbad_rows import Assembled, assemble
from catalogs.star_columns import COLUMNS
from catalogs.stars import StarTable, load_stars, star_table
from catalogs.tap_client import RefreshError, TapService, ask
from cpic_core import InputError

FORMAT_KEY = "cpic_star_table"
_FORMAT_VERSION = 1
_LICENCE = "Open Database License (ODbL) 1.0: a database derived from SIMBAD"
V_CHANGE_MAG = 0.05
"""A V that differs by at least this from the snapshot's counts as changed."""
PARALLAX_CHANGE = 0.01
"""A parallax that differs by at least this fraction from the snapshot's counts as changed."""
INSIDE_V_MAG, INSIDE_PARALLAX = 0.2, 0.1
"""Snapshot stars this much brighter than the cut (mag), with a parallax larger by this fraction, cannot drop out of the
answer because SIMBAD has newer values: by them it is judged whether the answer is whole."""


@dataclass(frozen=True)
class Changes:
    """The differences from the snapshot within the same cuts.

    Parameters
    ----------
    added : tuple of str
        Names of stars that the snapshot does not have.
    removed : mapping of str to str
        Names of snapshot stars that are not in the refreshed table -> why.
    v_mag, parallax : tuple of str
        Names of stars whose V differs by :data:`V_CHANGE_MAG`, and whose parallax by :data:`PARALLAX_CHANGE`, or more.
    same : int
        Stars in both of which neither differs.
    before : int
        Stars of the snapshot within the cuts.
    well_inside : int
        Those of them that newer values do not take out of the cuts.
    lost : tuple of str
        Names of those that are not in the refreshed table all the same.
    """

    added: tuple[str, ...]
    removed: Mapping[str, str]
    v_mag: tuple[str, ...]
    parallax: tuple[str, ...]
    same: int
    before: int
    well_inside: int
    lost: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Refreshed(Refresh):
    """A refreshed table of stars with its story."""

    table: StarTable
    cuts: Cuts
    changes: Changes

    @property
    def refusal(self) -> str:
        """Why the table is set aside; empty if it is not."""
        return loss_refused(
            len(self.changes.lost), self.changes.well_inside, "stars of the snapshot well within the cuts"
        )


def refresh_stars(
    service: TapService,
    cuts: Cuts,
    *,
    step: Callable[[str], None] = lambda text: None,
    tell: Callable[[str], None] = lambda text: None,
) -> Refreshed:
    """Ask SIMBAD for the stars within the cuts and return them as a table with the columns of the snapshot.

    Parameters
    ----------
    service : TapService
        Where and how patiently to ask.
    cuts : Cuts
        Which stars.
    step : callable
        Called with a word when a piece of work is done (three times).
    tell : callable
        Called with a sentence when a failure is tried again.

    Raises
    ------
    RefreshError
        If the service fails or its answers cannot be right.
    """
    questions = queries(cuts)
    url = service_url(service)
    answers = []
    when = datetime.now(UTC).replace(microsecond=0)
    for question, what in zip(questions, ("stars", "measurements"), strict=True):
        answers.append(ask(service, url, question, narrower=NARROWER, tell=tell))
        step(what)
    snapshot = load_stars(updates=False)  # they are laid over when the table is opened
    label = f"the catalogue refreshed on {when:%Y-%m-%d}"
    try:
        made = assemble(read_stars(answers[0]), read_measurements(answers[1]), snapshot, cuts, label)
    except InputError as error:
        raise RefreshError(str(error), "the service is not SIMBAD; tables already here stay as they are") from None
    step("table")
    changes = compare(made, snapshot, cuts)
    return Refreshed(
        table=made.table,
        queried_utc=when,
        url=url,
        queries=questions,
        cuts=cuts,
        counts=made.counts,
        left_out=made.left_out,
        changes=changes,
    )


def compare(made: Assembled, snapshot: StarTable, cuts: Cuts) -> Changes:
    """Return what differs from the snapshot's stars within the cuts.

    Parameters
    ----------
    made : Assembled
        The refreshed table, with the row of the snapshot that each of its rows is.
    snapshot : StarTable
        The embedded table.
    cuts : Cuts
        What was asked for.
    """
    names = made.table.column("name").tolist()
    rows = made.snapshot_rows
    old = {name: np.asarray(snapshot.column(name), float) for name in ("v_mag", "parallax_mas")}
    new = {name: np.asarray(made.table.column(name), float) for name in ("v_mag", "parallax_mas")}
    known = np.flatnonzero(rows >= 0)
    shift = {name: np.abs(new[name][known] - old[name][rows[known]]) for name in old}
    # the snapshot keeps three decimals of V and two of the parallax
    v_differs = shift["v_mag"] >= V_CHANGE_MAG - 1e-9
    parallax_differs = shift["parallax_mas"] >= PARALLAX_CHANGE * old["parallax_mas"][rows[known]]
    inside = (old["v_mag"] <= cuts.v_mag_max) & (old["parallax_mas"] >= cuts.parallax_min_mas)
    gone = sorted(set(np.flatnonzero(inside).tolist()) - set(rows[known].tolist()))
    well_inside = old["v_mag"] <= cuts.v_mag_max - INSIDE_V_MAG
    well_inside &= old["parallax_mas"] >= (1.0 + INSIDE_PARALLAX) * cuts.parallax_min_mas
    old_names = snapshot.column("name").tolist()
    return Changes(
        added=tuple(names[i] for i in np.flatnonzero(rows < 0).tolist()),
        removed={old_names[row]: made.missed.get(row, "not in the answer") for row in gone},
        v_mag=tuple(names[i] for i in known[v_differs].tolist()),
        parallax=tuple(names[i] for i in known[parallax_differs].tolist()),
        same=int(np.sum(~(v_differs | parallax_differs))),
        before=int(inside.sum()),
        well_inside=int(well_inside.sum()),
        lost=tuple(old_names[row] for row in gone if well_inside[row]),
    )


def ecsv_text(made: Refreshed, versions: Mapping[str, str]) -> str:
    """Return a refreshed table as ECSV 1.0: units and descriptions of every column, and its story in the header.

    Parameters
    ----------
    made : Refreshed
        What to write; numbers are rounded as in the snapshot.
    versions : mapping of str to str
        Software that made it.
    """
    values = {
        column.name: np.round(made.table.column(column.name), column.decimals)
        if column.kind == "float"
        else made.table.column(column.name).tolist()
        for column in COLUMNS
    }
    about = {
        FORMAT_KEY: _FORMAT_VERSION,
        "cuts": asdict(made.cuts),
        "snapshot": snapshot_vintage(),
        "licence": _LICENCE,
        "credit": STAR_CREDITS[0],
    }
    columns = [replace(column, description=made.table.descriptions[column.name]) for column in COLUMNS]
    return ecsv_of(made, columns, values, versions, about)


def parse_refreshed(text: str, name: str) -> tuple[StarTable, dict[str, Any]]:
    """Read the text of a refreshed table back.

    Parameters
    ----------
    text : str
        ECSV as :func:`ecsv_text` writes it.
    name : str
        File name, for messages and as the table's label.

    Returns
    -------
    table, meta : StarTable, dict

    Raises
    ------
    InputError
        If it is damaged, of another version, or not a refreshed table.
    """
    table = parse_ecsv(text, name, FORMAT_KEY, _FORMAT_VERSION)
    meta = json.loads(json.dumps(dict(table.meta), default=str))
    hint = DAMAGED
    try:
        datetime.fromisoformat(meta["queried_utc"])
        float(meta["cuts"]["parallax_min_mas"])
        int(meta["counts"]["stars"])
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{name} header", "without date, cuts or counts", hint=hint) from None
    lost = [column.name for column in COLUMNS if column.name not in table.colnames]
    if lost or len(table) == 0:
        raise InputError(f"{name} columns", f"without {', '.join(lost)}" if lost else "no rows", hint=hint)
    values = {}
    for column in COLUMNS:
        cells = np.ma.asarray(table[column.name])
        try:
            values[column.name] = (
                np.ma.filled(cells.astype(np.float64), np.nan).tolist()
                if column.kind == "float"
                else ["" if cell is None else cell for cell in cells.tolist()]
            )
        except (TypeError, ValueError):
            raise InputError(f"{name} column {column.name}", "not numbers", hint=hint) from None
    needed = ("v_mag", "distance_pc", "teff_k", "log_g", "metallicity", "luminosity_lsun", "ra_deg", "dec_deg")
    for what in needed:
        if not np.all(np.isfinite(values[what])):
            raise InputError(f"{name} column {what}", "a missing value", allowed="numbers", hint=hint)
    try:
        return star_table(values, name), meta
    except (InputError, TypeError, ValueError) as error:
        raise InputError(name, "unreadable", hint=f"{hint}; {error}") from None
