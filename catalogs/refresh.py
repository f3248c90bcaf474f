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
from catalogs.refreshed_tables import DAMAGED, FORMATS, Refresh, ecsv_of, loss_refused, parse_ecsv
from catalogs.simbad import NARROWER, Cuts, queries, service_url
from catalogs.simbad_answer import read_measurements, read_stars
from catalogs.simbad_rows import Assembled, assemble
from catalogs.star_columns import COLUMNS
from catalogs.stars import StarTable, load_stars, star_table
from catalogs.tap_client import RefreshError, TapService, ask
from cpic_core import InputError

FORMAT_KEY = FORMATS["simbad"]
_LICENCE = "Open Database License (ODbL) 1.0: a database derived from SIMBAD"
V_CHANGE_MAG = 0.05
"""A V that differs by at least this from the snapshot's counts as changed."""
PARALLAX_CHANGE = 0.01
"""A parallax that differs by at least this fraction from the snapshot's counts as changed."""
INSIDE_V_MAG, INSIDE_PARALLAX = 0.2, 0.1
"""Snapshot stars this much brighter than the cut (mag), with a parallax larger by this fraction, cannot drop out of the
answer because SIMBAD has newer values: by them it is judged whether the answer is whole."""
_NEEDED = ("v_mag", "distance_pc", "teff_k", "log_g", "metallicity", "luminosity_lsun", "ra_deg", "dec_deg")


@dataclass(frozen=True, kw_only=True)
class Refreshed(Refresh):
    """A refreshed table of stars with its story; its changes are those of `compare`."""

    table: StarTable
    cuts: Cuts


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
    changes, refusal = compare(made, snapshot, cuts)
    asked: dict[str, Any] = {"kind": "simbad", "queried_utc": when, "url": url, "queries": questions, "cuts": cuts}
    story: dict[str, Any] = {"counts": made.counts, "left_out": made.left_out, "changes": changes, "refusal": refusal}
    return Refreshed(**asked, **story, table=made.table)


def compare(made: Assembled, snapshot: StarTable, cuts: Cuts) -> tuple[dict[str, Any], str]:
    """Return what differs from the snapshot's stars within the cuts, and why the table is set aside, if it is.

    Parameters
    ----------
    made : Assembled
        The refreshed table, with the row of the snapshot that each of its rows is.
    snapshot : StarTable
        The embedded table.
    cuts : Cuts
        What was asked for.

    Returns
    -------
    changes : dict
        ``same``, the number of stars in both whose V and parallax do not differ; names of those that are ``added``,
        ``removed`` (with the reason), and whose V or parallax differs (``v_mag_changed``, ``parallax_changed``).
    refusal : str
        Empty, unless stars are lost that newer values do not take out of the cuts.
    """
    names, old_names = (table.column("name").tolist() for table in (made.table, snapshot))
    rows = made.snapshot_rows
    known = np.flatnonzero(rows >= 0)
    v_mag, parallax = (np.asarray(snapshot.column(name), float) for name in ("v_mag", "parallax_mas"))
    new_v, new_parallax = (np.asarray(made.table.column(name), float) for name in ("v_mag", "parallax_mas"))
    # the snapshot keeps three decimals of V and two of the parallax
    v_differs = np.abs(new_v[known] - v_mag[rows[known]]) >= V_CHANGE_MAG - 1e-9
    before = parallax[rows[known]]
    parallax_differs = np.abs(new_parallax[known] - before) >= PARALLAX_CHANGE * before
    gone = (v_mag <= cuts.v_mag_max) & (parallax >= cuts.parallax_min_mas)
    gone[rows[known]] = False
    inside = v_mag <= cuts.v_mag_max - INSIDE_V_MAG
    inside &= parallax >= (1.0 + INSIDE_PARALLAX) * cuts.parallax_min_mas
    changes = {
        "same": int(np.sum(~(v_differs | parallax_differs))),
        "added": [names[i] for i in np.flatnonzero(rows < 0)],
        "removed": {old_names[row]: made.missed.get(int(row), "not in the answer") for row in np.flatnonzero(gone)},
        "v_mag_changed": [names[i] for i in known[v_differs]],
        "parallax_changed": [names[i] for i in known[parallax_differs]],
    }
    what = "stars of the snapshot well within the cuts"
    return changes, loss_refused(int(np.sum(gone & inside)), int(inside.sum()), what)


def ecsv_text(made: Refreshed, versions: Mapping[str, str]) -> str:
    """Return a refreshed table as ECSV 1.0: units and descriptions of every column, and its story in the header.

    Parameters
    ----------
    made : Refreshed
        What to write; numbers are rounded as in the snapshot.
    versions : mapping of str to str
        Software that made it.
    """
    values: dict[str, Any] = {column.name: made.table.column(column.name).tolist() for column in COLUMNS}
    values |= {item.name: np.round(values[item.name], item.decimals) for item in COLUMNS if item.kind == "float"}
    about = {"cuts": asdict(made.cuts), "snapshot": snapshot_vintage(), "licence": _LICENCE, "credit": STAR_CREDITS[0]}
    columns = [replace(column, description=made.table.descriptions[column.name]) for column in COLUMNS]
    return ecsv_of(made, columns, values, versions, **about)


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
    table = parse_ecsv(text, name, "simbad")
    meta = json.loads(json.dumps(dict(table.meta), default=str))
    try:
        datetime.fromisoformat(meta["queried_utc"])
        float(meta["cuts"]["parallax_min_mas"])
        int(meta["counts"]["stars"])
        cells: dict[str, Any] = {column.name: np.ma.asarray(table[column.name]) for column in COLUMNS}
        numbers = {item.name: cells[item.name].astype(float).filled(np.nan) for item in COLUMNS if item.kind == "float"}
        others: dict[str, Any] = {key: part.filled("").tolist() for key, part in cells.items() if key not in numbers}
        made = star_table(others | numbers, name)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(name, "unreadable", allowed="a refreshed table", hint=f"{DAMAGED}; {error}") from None
    if len(made) == 0:
        raise InputError(name, "no rows", hint=DAMAGED)
    for key in _NEEDED:
        if not np.all(np.isfinite(numbers[key])):
            raise InputError(f"{name} column {key}", "a missing value", allowed="numbers", hint=DAMAGED)
    return made, meta
