"""Refresh the known planets from the NASA Exoplanet Archive: ask, check, compare with the shipped table, store, read.

A refreshed table stands beside the shipped one as the base that ``latest`` names, and the updates kept by hand are laid
over it like over the table of 2019, with one difference: an orbit of theirs only where its row is newer than the last
change of the archive's own row. What they say of a planet's status stays whatever the date, for the archive has no word
for refuted: a planet that they refute is not counted again because the archive touched its row.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from catalogs.exoplanet_archive import NARROWER, PLANETS_QUERY, ArchivePlanets, archive_url, read_archive
from catalogs.known_planet_columns import COLUMNS, STANDING
from catalogs.known_planet_table import NUMBERS, TABLE_COLUMNS, KnownPlanetTable, planet_key
from catalogs.known_planets import load_known_planets, read_planets
from catalogs.refreshed_tables import Refresh, ecsv_of, loss_refused, parse_ecsv
from catalogs.stars import load_stars
from catalogs.table_cells import Row
from catalogs.table_files import TableBytes
from catalogs.tap_client import TapService, ask
from cpic_core import InputError

_LICENCE = "public facts (NASA Exoplanet Archive); star names as in the embedded catalogue"
CREDIT = "NASA Exoplanet Archive, table ps (Akeson et al. 2013, PASP 125, 989)"
SIGMAS = 3.0
"""An element has moved if it differs by more than this many combined errors, and by more than `LEAST`."""
LEAST = 0.05
"""Least difference that counts: of period and semi-major axis as a fraction, of the eccentricity itself."""
_ELEMENTS = {
    "period_days": "period_err_days",
    "semi_major_axis_au": "semi_major_axis_err_au",
    "eccentricity": "eccentricity_err",
}


@dataclass(frozen=True, kw_only=True)
class RefreshedPlanets(Refresh):
    """A refreshed table of planets with its story, and remarks on the archive's columns and values.

    Its changes are those of `compare_planets`.
    """

    rows: list[Row]
    notes: tuple[str, ...]


def refresh_planets(
    service: TapService,
    *,
    step: Callable[[str], None] = lambda text: None,
    tell: Callable[[str], None] = lambda text: None,
) -> RefreshedPlanets:
    """Ask the NASA Exoplanet Archive for the planets of catalogue stars.

    Parameters
    ----------
    service : TapService
        Where and how patiently to ask.
    step : callable
        Called with a word when a piece of work is done (twice).
    tell : callable
        Called with a sentence when a failure is tried again.

    Raises
    ------
    RefreshError
        If the service fails or its answer cannot be right.
    """
    url, when = archive_url(service), datetime.now(UTC).replace(microsecond=0)
    answer = ask(service, url, PLANETS_QUERY, narrower=NARROWER, tell=tell)
    step("planets")
    planets, shipped = read_archive(answer, load_stars()), load_known_planets()
    step("table")
    changes = compare_planets(planets, shipped)
    what = "counted planets of the shipped table"
    refusal = loss_refused(len(changes["gone"]), int(shipped.counted.sum()), what)
    story: dict[str, Any] = {"kind": "archive", "queried_utc": when, "url": url, "queries": (PLANETS_QUERY,)}
    return RefreshedPlanets(**story, **vars(planets), changes=changes, refusal=refusal)


def compare_planets(planets: ArchivePlanets, shipped: KnownPlanetTable) -> dict[str, Any]:
    """Return what differs from a table of planets.

    Parameters
    ----------
    planets : ArchivePlanets
        What the archive says.
    shipped : KnownPlanetTable
        The table with which it is compared; planets of it that are not counted are neither new nor gone nor moved.

    Returns
    -------
    dict
        ``same``, the number of counted planets in both of which no element differs; ``added``, planets that the shipped
        table does not have; ``gone``, counted ones that the archive does not have, with the reason where it is known;
        ``orbit_moved``, elements of orbits that differ: ``planet``, ``element`` (with its unit in its name),
        ``before``, ``before_err``, ``now``, ``now_err`` and ``sigmas``, the difference over the combined error; an
        error that is not given, and the ratio to none, is None.

    Notes
    -----
    Period, semi-major axis and eccentricity are compared: one has moved if the difference is more than `SIGMAS` times
    both errors, added in quadrature, and more than `LEAST`, which decides alone where no error is given. Of a planet
    with several published orbits all must differ.
    """
    names = shipped.text("planet")
    old = dict(zip(map(planet_key, shipped.text("star"), names), range(len(shipped)), strict=True))
    new = {planet_key(row["star"], row["planet"]): row for row in planets.rows}
    counted = {key: row for key, row in old.items() if shipped.counted[row]}
    moved = {key: _moved(row, shipped.orbits_of(counted[key])) for key, row in new.items() if key in counted}
    left_out = {planet_key(name.rpartition(" ")[0], name): why for name, why in planets.left_out.items()}
    gone = {names[row]: left_out.get(key, "not in the answer") for key, row in counted.items() if key not in new}
    return {
        "same": sum(not found for found in moved.values()),
        "added": [row["planet"] for key, row in new.items() if key not in old],
        "gone": gone,
        "orbit_moved": [item for found in moved.values() for item in found],
    }


def _moved(row: Row, orbits: KnownPlanetTable) -> list[dict[str, Any]]:
    """Return the elements of a row that have moved from those of all the orbits of its planet."""
    found = []
    for name, error in _ELEMENTS.items():
        now, now_err = row.get(name), row.get(error)
        values, errors = (orbits.number(column).tolist() for column in (name, error))
        differing = [
            difference(name, before, before_err, now, now_err)
            for before, before_err in zip(values, errors, strict=True)
            if now is not None
        ]
        if differing and all(differing):
            found.append({"planet": row["planet"], "element": name} | differing[0])
    return found


def difference(element: str, before: float, before_err: float, now: float, now_err: float | None) -> dict[str, Any]:
    """Return two values of an element and by how many combined errors they differ; empty if it has not moved.

    Parameters
    ----------
    element : str
        ``period_days``, ``semi_major_axis_au`` or ``eccentricity``.
    before, before_err, now, now_err : float
        Values and their errors; nan, or None of the last, where there is none.
    """
    known = [error for error in (before_err, now_err) if error is not None and error == error]
    error, apart = math.hypot(*known), abs(now - before)
    scale = 1.0 if element == "eccentricity" else abs(before)
    if not (apart > LEAST * scale and apart > SIGMAS * error):  # never where one is nan
        return {}
    values = {"before": before, "before_err": before_err if before_err == before_err else None}
    return values | {"now": now, "now_err": now_err, "sigmas": apart / error if error > 0.0 else None}


def planets_ecsv(made: RefreshedPlanets, versions: Mapping[str, str]) -> str:
    """Return a refreshed table of planets as ECSV 1.0: units of every column, and its story in the header.

    Parameters
    ----------
    made : RefreshedPlanets
        What to write.
    versions : mapping of str to str
        Software that made it.
    """
    values = {name: [row.get(name, math.nan if name in NUMBERS else "") for row in made.rows] for name in TABLE_COLUMNS}
    about = {"notes": list(made.notes), "licence": _LICENCE, "credit": CREDIT}
    return ecsv_of(made, [COLUMNS[name] for name in TABLE_COLUMNS], values, versions, **about)


def parse_planets(file: TableBytes) -> tuple[list[Row], str]:
    """Return the rows of a refreshed table of planets, and the day on which the archive was asked.

    Parameters
    ----------
    file : TableBytes
        ECSV as `planets_ecsv` writes it.

    Raises
    ------
    InputError
        If it is damaged, of another version, or another table.
    """
    meta = parse_ecsv(file.data.decode("utf-8", "replace"), file.name, "archive").meta
    rows, whole = read_planets(file), meta.get("counts", {}).get("planets")
    if len(rows) != whole:
        raise InputError(file.name, f"{len(rows)} planets", allowed=f"{whole}, as it was written with")
    return rows, str(meta.get("queried_utc", ""))[:10]


def newer_updates(archive: Sequence[Row], updates: Iterable[Row]) -> list[Row]:
    """Return what of the updates kept by hand is laid over the archive's rows.

    Parameters
    ----------
    archive : sequence of Row
        The refreshed table.
    updates : iterable of Row
        The updates, each with a date.

    Returns
    -------
    list of Row
        Planets that the archive lacks, unless the row has no orbit; of the others the whole row where it is newer than
        the archive's, else its status alone, where that is not ``confirmed``.
    """
    dates = {planet_key(row["star"], row["planet"]): row.get("updated", "") for row in archive}
    found = []
    for row in updates:
        date = dates.get(planet_key(row["star"], row["planet"]))
        with_orbit = any(name in row for name in ("period_days", "semi_major_axis_au"))
        if with_orbit and (date is None or row["updated"] > date):
            found.append(row)
        elif date is not None and row.get("status", "confirmed") != "confirmed":
            found.append({name: row[name] for name in ("star", "planet", *STANDING) if name in row})
    return found
