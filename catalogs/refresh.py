"""Refresh the star table from SIMBAD: ask, check, assemble, and compare with the snapshot. Nothing is written here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from catalogs.simbad import Cuts, TapService, ask, queries, service_url
from catalogs.simbad_answer import read_measurements, read_stars
from catalogs.simbad_rows import Assembled, assemble
from catalogs.stars import StarTable, load_stars

V_CHANGE_MAG = 0.05
"""A V that differs by at least this from the snapshot's counts as changed."""
PARALLAX_CHANGE = 0.01
"""A parallax that differs by at least this fraction from the snapshot's counts as changed."""


@dataclass(frozen=True)
class Changes:
    """What differs from the snapshot within the same cuts.

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
    """

    added: tuple[str, ...]
    removed: Mapping[str, str]
    v_mag: tuple[str, ...]
    parallax: tuple[str, ...]
    same: int
    before: int


@dataclass(frozen=True)
class Refreshed:
    """A refreshed table with its story: when, where and what was asked, and what came of it."""

    table: StarTable
    queried_utc: datetime
    url: str
    queries: tuple[str, str]
    cuts: Cuts
    counts: Mapping[str, int]
    left_out: Mapping[str, str]
    changes: Changes


def refresh(
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
    answers: list[Any] = []
    when = datetime.now(UTC).replace(microsecond=0)
    for question, what in zip(questions, ("stars", "measurements"), strict=True):
        answers.append(ask(service, question, tell=tell))
        step(what)
    snapshot = load_stars()
    label = f"the catalogue refreshed on {when:%Y-%m-%d}"
    made = assemble(read_stars(answers[0]), read_measurements(answers[1]), snapshot, cuts, label)
    step("table")
    return Refreshed(
        table=made.table,
        queried_utc=when,
        url=service_url(service),
        queries=questions,
        cuts=cuts,
        counts=made.counts,
        left_out=made.left_out,
        changes=compare(made, snapshot, cuts),
    )


def compare(made: Assembled, snapshot: StarTable, cuts: Cuts) -> Changes:
    """Return what differs from the snapshot's stars within the cuts."""
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
    old_names = snapshot.column("name").tolist()
    return Changes(
        added=tuple(names[i] for i in np.flatnonzero(rows < 0).tolist()),
        removed={old_names[row]: made.missed.get(row, "not in the answer") for row in gone},
        v_mag=tuple(names[i] for i in known[v_differs].tolist()),
        parallax=tuple(names[i] for i in known[parallax_differs].tolist()),
        same=int(np.sum(~(v_differs | parallax_differs))),
        before=int(inside.sum()),
    )
