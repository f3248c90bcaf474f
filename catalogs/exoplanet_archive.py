"""The NASA Exoplanet Archive's planets of catalogue stars, from its table ``ps``: one row for each published solution.

Every column is asked for, and those that are needed are picked from what comes: tables and columns of the archive have
changed before, and an answer shows what they are called today. A column under an older name, in another unit or missing
is named in a remark, or where the table is worth nothing without it, in the refusal.

Of a planet's solutions the default one counts. Where that gives no time of periastron or conjunction, and another
confirmed solution of the same period does, the orbit (period, time, eccentricity, argument of periastron, with errors
and reference) is the whole one of the newest such publication, so that elements of two fits are never mixed; the row is
flagged. Errors are half the width of the published interval; the archive's 0 for an error means that none is given.
Columns: https://exoplanetarchive.ipac.caltech.edu/docs/API_PS_columns.html; Akeson et al. 2013, PASP 125, 989.

A refresh asks, checks and compares with the shipped table; `catalogs.known_planets` says how a refreshed one is used.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from catalogs import known_planets
from catalogs.archives import Refresh, RefreshError, TapService, answer_columns, ask, ecsv_of, loss_refused, read_answer
from catalogs.coordinates import separation_arcsec
from catalogs.names import snapshot_aliases
from catalogs.nomenclature import designation_key
from catalogs.stars import StarTable, load_stars
from catalogs.table_cells import Row
from catalogs.table_files import RawTable
from cpic_core import InputError, Record

URL_VARIABLE = "CPIC_ARCHIVE_URL"
"""Environment variable with the address of the archive's TAP service, where none is given."""
ARCHIVE_URL = "https://exoplanetarchive.ipac.caltech.edu/TAP"
PLANETS_QUERY = "SELECT * FROM ps WHERE sy_dist <= 50"
"""All solutions of planets within 50 pc; the catalogue ends at 40 pc."""
NARROWER = "ask another service with --url"
"""Advice of messages on an answer with too many rows."""
_ORBIT = ("period_days", "periastron_jd", "conjunction_jd", "eccentricity", "eccentricity_limit", "omega_star_deg")
"""Columns of ours that are taken from one solution, whichever gives the orbit."""
_FAR_ARCSEC = 120.0
_SAME_DISTANCE = 0.2
_SAME_PERIOD = 0.1


class ArchivePlanets(Record):
    """Planets of catalogue stars as the archive has them.

    Parameters
    ----------
    rows : list of dict
        One planet each, by columns of `catalogs.known_planets.COLUMNS`, sorted by star and planet.
    counts : mapping of str to int
        Solutions and planets at each step.
    left_out : mapping of str to str
        The archive's name of each planet of a catalogue star that is not among the rows -> why.
    notes : tuple of str
        How the archive's columns differ from what was expected, and values that cannot be meant.
    """

    rows: list[Row]
    counts: Mapping[str, int]
    left_out: Mapping[str, str]
    notes: tuple[str, ...]


def archive_url(service: TapService) -> str:
    """Return the base address that is asked (its ``/sync`` is).

    Raises
    ------
    InputError
        If ``$CPIC_ARCHIVE_URL`` is no address.
    """
    return service.address(URL_VARIABLE) or ARCHIVE_URL


def read_archive(answer: RawTable, stars: StarTable) -> ArchivePlanets:
    """Return the planets of catalogue stars of an answer to `PLANETS_QUERY`.

    Parameters
    ----------
    answer : RawTable
        The archive's columns.
    stars : StarTable
        The embedded catalogue.

    Raises
    ------
    RefreshError
        If a column is missing, in a unit that is not understood, or holds what is none of its values; or if no planet
        is of a catalogue star.
    """
    read, notes = read_answer(answer, "ps")
    solutions: dict[str, list[Row]] = {}
    for row in read:
        solutions.setdefault(row["pl_name"], []).append(row)
    places = dict(zip(stars.column("name").tolist(), range(len(stars)), strict=True))
    rows: dict[tuple[str, str], Row] = {}
    left_out: dict[str, str] = {}
    for name, published in solutions.items():
        try:
            if (star := _star_of(published[0], stars, places)) is None:
                continue
            row, remarks = _planet(star, published)
        except InputError as error:
            left_out[name] = str(error)
            continue
        if rows.setdefault(known_planets.planet_key(star, row["planet"]), row) is not row:
            left_out[name] = f"another planet of the archive is {row['planet']} too"
        notes += remarks
    if not rows:
        raise RefreshError("no planet of the answer is of a catalogue star", "is the service the archive?")
    counts = {"solutions": len(read), "planets of the answer": len(solutions), "planets": len(rows)}
    return ArchivePlanets([rows[key] for key in sorted(rows)], counts, left_out, notes)


def host_among(where: str, names: Iterable[str], aliases: Mapping[str, tuple[str, int]]) -> str | None:
    """Return the catalogue's name of a star; None if it is not in there.

    Parameters
    ----------
    where : str
        What it is, for messages.
    names : iterable of str
        What an archive calls it.
    aliases : mapping of str to (str, int)
        Key of a designation -> name of the catalogue star, and 0 for its own name, 1 for one of its whole system.

    Raises
    ------
    InputError
        If the names mean different stars.
    """
    hits = [aliases[key] for name in names if name and (key := designation_key(name)) in aliases]
    own = sorted({name for name, kind in hits if kind == 0})
    if own and len({name for name, _ in hits}) > 1:
        raise InputError(where, ", ".join(own), allowed="names of one star")
    return own[0] if own else None


def _star_of(row: Row, stars: StarTable, places: Mapping[str, int]) -> str | None:
    """Return the catalogue's name of a planet's star; None if it is not in there.

    Raises
    ------
    InputError
        If its names mean different stars, or it stands elsewhere: by two arcminutes, a decade of the fastest proper
        motion, or a fifth of the distance.
    """
    where = f"star of {row['pl_name']}"
    name = host_among(where, [row.get(key, "") for key in ("hostname", "hd_name", "hip_name")], snapshot_aliases())
    if name is not None:
        ra, dec, distance_pc = (stars.columns[key][places[name]].item() for key in ("ra_deg", "dec_deg", "distance_pc"))
        away = float(separation_arcsec(row.get("ra", ra), row.get("dec", dec), ra, dec))
        ratio = row.get("sy_dist", distance_pc) / distance_pc
        if away > _FAR_ARCSEC or abs(ratio - 1.0) > _SAME_DISTANCE:
            found = f"{away:.0f} arcsec from {name}, at {ratio:.2f} of its distance"
            raise InputError(where, found, allowed="a star at the place that the archive gives")
    return name


def _planet(star: str, published: Sequence[Row]) -> tuple[Row, tuple[str, ...]]:
    """Return the row of one planet, and remarks on values that cannot be meant.

    Raises
    ------
    InputError
        If none of its solutions is confirmed, or it has no orbit, or neither mass nor radius.
    """
    confirmed = [row for row in published if "confirmed" in row.get("soltype", "confirmed").lower()]
    if not confirmed:
        raise InputError(f"{published[0]['pl_name']} soltype", published[0]["soltype"], allowed="a confirmed planet")
    confirmed.sort(key=lambda row: (row.get("default_flag", 0.0) == 1.0, row.get("pl_pubdate", "")), reverse=True)
    default, *others = confirmed
    name, orbit = default["pl_name"], default
    if not _is_dated(default):
        dated = (row for row in others if _is_dated(row, with_errors=True) and _same_period(row, default))
        orbit = next(dated, default)
    numbers, flags = settled(default, orbit, name)
    remarks = []
    for column in list(numbers):
        try:
            believe(name, column, numbers[column])
        except InputError as error:
            remarks.append(f"left out: {error}")
            del numbers[column]
    for needed in (("period_days", "semi_major_axis_au"), ("mass_mjup", "msini_mjup", "radius_rjup")):
        if not numbers.keys() & set(needed):
            raise InputError(f"{name} {' or '.join(needed)}", "missing")
    given = () if orbit is default else ("earlier_orbit",)
    texts = {
        "star": star,
        "planet": f"{star} {default.get('pl_letter') or name.split()[-1]}",
        "discovery_method": default.get("discoverymethod", ""),
        "reference": known_planets.reference_text(orbit.get("pl_refname", "")),
        "updated": default.get("rowupdate", "")[:10],
        "flags": ";".join(known_planets.flags_of(numbers, given + flags)),
    }
    return texts | numbers, tuple(remarks)


def _is_dated(row: Row, *, with_errors: bool = False) -> bool:
    """Return whether a solution says when the planet is where, with the errors without which that soon means little."""
    ends = ("", "err1") if with_errors else ("",)
    times = any(all(f"{name}{end}" in row for end in ends) for name in ("pl_orbtper", "pl_tranmid"))
    return times and all(f"pl_orbper{end}" in row for end in ends)


def _same_period(one: Row, other: Row) -> bool:
    period = other.get("pl_orbper")
    return period is None or bool(abs(one["pl_orbper"] - period) < _SAME_PERIOD * period)


def settled(row: Mapping[str, Any], orbit: Mapping[str, Any], where: str) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return the numbers of a planet by columns of ours, and the flags that follow.

    Parameters
    ----------
    row : mapping
        The archive's columns of the solution that counts; missing ones absent or ``""``.
    orbit : mapping
        Those of the solution that the orbit is taken from.
    where : str
        The planet, for messages.

    Raises
    ------
    InputError
        For a kind of mass that nobody knows.
    """
    numbers: dict[str, float] = {}
    asked = answer_columns("ps")
    for column, about in asked.items():
        given, quantity, limit = orbit if about["quantity"] in _ORBIT else row, about["quantity"], f"{column}lim"
        refused = limit in asked and not asked[limit]["quantity"] and float(given.get(limit) or 0.0)
        if not quantity or given.get(column, "") == "" or refused:
            continue
        numbers[quantity] = float(given[column])
        sides = [abs(float(given[key])) for end in ("err1", "err2") if given.get(key := f"{column}{end}", "") != ""]
        if error := sum(sides) / max(len(sides), 1):
            numbers[about["error"]] = float(f"{error:.6g}")
    return known_planets.settle(numbers, str(row.get("pl_bmassprov", "")), where)


def believe(where: str, name: str, value: float) -> None:
    """Refuse a number that its column cannot hold.

    Parameters
    ----------
    where : str
        The planet, for messages.
    name : str
        Column of ours.
    value : float
        In its unit.

    Raises
    ------
    InputError
        If it is outside the range that is believed.
    """
    believed = known_planets.COLUMNS[name]
    if not believed.low <= value <= believed.high:
        raise InputError(f"{where} {name}", value, unit=believed.unit, allowed=believed.allowed)


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


class RefreshedPlanets(Refresh, kw_only=True):
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
    planets, shipped = read_archive(answer, load_stars()), known_planets.load_known_planets()
    step("table")
    changes = compare_planets(planets, shipped)
    what = "counted planets of the shipped table"
    refusal = loss_refused(len(changes["gone"]), int(shipped.counted.sum()), what)
    story: dict[str, Any] = {"kind": "archive", "queried_utc": when, "url": url, "queries": (PLANETS_QUERY,)}
    return RefreshedPlanets(**story, **vars(planets), changes=changes, refusal=refusal)


def compare_planets(planets: ArchivePlanets, shipped: known_planets.KnownPlanetTable) -> dict[str, Any]:
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
    old = dict(zip(map(known_planets.planet_key, shipped.text("star"), names), range(len(shipped)), strict=True))
    new = {known_planets.planet_key(row["star"], row["planet"]): row for row in planets.rows}
    counted = {key: row for key, row in old.items() if shipped.counted[row]}
    moved = {key: _moved(row, shipped.orbits_of(counted[key])) for key, row in new.items() if key in counted}
    left_out = {known_planets.planet_key(name.rpartition(" ")[0], name): why for name, why in planets.left_out.items()}
    gone = {names[row]: left_out.get(key, "not in the answer") for key, row in counted.items() if key not in new}
    return {
        "same": sum(not found for found in moved.values()),
        "added": [row["planet"] for key, row in new.items() if key not in old],
        "gone": gone,
        "orbit_moved": [item for found in moved.values() for item in found],
    }


def _moved(row: Row, orbits: known_planets.KnownPlanetTable) -> list[dict[str, Any]]:
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
    values = {
        name: [row.get(name, math.nan if name in known_planets.NUMBERS else "") for row in made.rows]
        for name in known_planets.TABLE_COLUMNS
    }
    about = {"notes": list(made.notes), "licence": _LICENCE, "credit": CREDIT}
    return ecsv_of(
        made, [known_planets.COLUMNS[name] for name in known_planets.TABLE_COLUMNS], values, versions, **about
    )
