"""Known planets: published orbits of companions of catalogue stars, and what each of them lacks.

Two tables are shipped: the confirmed planets of the NASA Exoplanet Archive, as of 2019-05-31, of stars in the
catalogue; and what has changed since, kept by hand with a date and a source in every row, which is laid over it.
Arguments of periastron are those of the star's orbit, as radial velocities have them; the planet's own is 180 degrees
more. A number is nan where the source has none; nothing is filled in, and ``flags`` says what is missing.

A row that is laid over another one of the same planet replaces its whole orbit, so that elements of two publications
are never mixed; what it does not say about the planet's status stays. A row with a status and no orbit changes the
status alone. Where publications disagree, a planet has several rows, each a whole orbit with a weight: together they
are a mixture, from which draws take one orbit each.
"""

import functools
import math
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from catalogs.known_planet_columns import (
    COLUMNS,
    FLAGS,
    GIVEN_FLAGS,
    STANDING,
    STATUSES,
    flags_of,
    reference_text,
    settle,
)
from catalogs.known_planet_table import (
    NUMBERS,
    TABLE_COLUMNS,
    TEXTS,
    KnownPlanetTable as KnownPlanetTable,
    planet_key,
    star_key as star_key,
)
from catalogs.names import snapshot_aliases
from catalogs.nomenclature import designation_key, host_of_planet, star_name_of
from catalogs.own_tables import is_strict, keep, tell
from catalogs.shipped import shipped_digest, shipped_rows, shipped_words
from catalogs.table_cells import ROW_OUT, Row, Rows, heading, read_rows
from catalogs.table_files import RawTable, TableBytes, parse_table, read_bytes
from cpic_core import InputError, check_flag, listed

DATA_FILE = "known_planets.csv"
UPDATES_FILE = "known_planets_updates.csv"
SOURCES = shipped_words("planet_sources")
"""Tables that a file can be laid over, with a description of each; the first is the default."""
PRESETS = "snapshot, archive_2019, latest"
"""Those that need no file, for messages."""
_DIGITS = 12
_EDGE_ON = 0.99
_VELOCITIES = re.compile(r"radial|\brv\b")
"""Methods that give no more than m sin i where nothing tells the inclination."""
_TAU_JD = 2458849.5
_SHOWN = 6
_LABEL = "the table of known planets"
_SOLUTIONS = "solutions"
_MISSING = {name: math.nan if name in NUMBERS else "" for name in TABLE_COLUMNS}
_HOSTS = ("hip", "hd", "tic", "gaia")
_ASIDE = (*_HOSTS, "star_aliases")
_NAMED = (("star", "planet", *_HOSTS), ("planet", "letter"))
_NAMES = (("star",), ("planet",))
_STATUS_WORDS = shipped_words("planet_statuses_elsewhere")
"""Parts of what exoplanet.eu, the Open Exoplanet Catalogue and the archive say of a planet, and our words."""
_REQUIRED = (("period_days", "semi_major_axis_au"), ("mass_mjup", "msini_mjup", "radius_rjup", "best_mass_mjup"))
REQUIRED = (*_NAMED, *_REQUIRED)
"""Names of columns; of each group a table of planets needs one."""


def load_known_planets(
    source: str | Path = "snapshot", *, candidates: bool = False, strict: bool = False
) -> KnownPlanetTable:
    """Return a table of known planets.

    Parameters
    ----------
    source : str or Path
        ``"snapshot"``: the archive's table of 2019 with the updates that are shipped; ``"archive_2019"``: without them;
        ``"latest"``: the newest table of the archive that ``cpic catalog refresh --planets`` left in the data folder,
        with the updates that are newer (`catalogs.planet_refresh.newer_updates`).
        A table file with the columns that ``cpic catalog columns`` lists is laid over the snapshot: planets of the
        same name are replaced, the others stay. ``"archive_2019+FILE"`` lays it over the table of 2019, ``"none+FILE"``
        takes the file alone. Headings of the archives are understood.
    candidates : bool
        Count candidates like confirmed planets; otherwise they are only listed.
    strict : bool
        Refuse a file for the first row or cell that cannot be used, instead of leaving it out with a remark.

    Returns
    -------
    KnownPlanetTable

    Raises
    ------
    InputError
        If there is no such file or it cannot be used, naming file, row, column, value, unit and range.

    Examples
    --------
    >>> from catalogs.known_planets import load_known_planets
    >>> planets = load_known_planets()
    >>> row = planets.row_of("eps Eri b")
    >>> float(planets.number("eccentricity")[row])
    0.06
    >>> before = load_known_planets("archive_2019")
    >>> float(before.number("eccentricity")[before.row_of("eps Eri b")])
    0.702
    """
    check_flag("candidates", candidates)
    base, name = split_source(source)
    table = _with_file(base, name, strict) if name else _base(base)[1]
    return table.with_candidates() if candidates else table


def _with_file(base: str, name: str, strict: bool) -> KnownPlanetTable:
    """Return a file laid over a shipped table."""
    file = read_bytes(name, key="known_planets", presets=PRESETS)
    raw = parse_table(file)
    below, table = ((), None) if base == "none" else _base(base)
    known = {_key(row) for row in below}
    own, given = _rows_of_file(raw, own=True, strict=strict, known=known)
    left = len({item.row for item in given.left_out if item.done == ROW_OUT})
    about = (
        f"user's table of {len(own)} planet{'s' * (len(own) != 1)} ({file.name} {file.sha256[:_DIGITS]}{raw.shortened})"
    )
    about += f", {left} rows left out" if left else ""
    about += f", columns not used: {listed(given.unused)}" if given.unused else ""
    notes = given.notes + given.told()
    if table is not None:
        about = f"{about} over {table.provenance}"
        notes += (_overlay_note(below, own, file.name),)
    rows = _laid_over(below, own)
    made = _table(rows, file.name, about, notes)
    tell(*notes)
    return replace(made, unused=given.unused, uses=given.uses, left_out=tuple(given.left_out))


def split_source(source: str | Path) -> tuple[str, str]:
    """Return which shipped table a source begins with, and the file that is laid over it; ``""`` for none.

    Raises
    ------
    InputError
        For ``none`` without a file.

    Examples
    --------
    >>> from catalogs.known_planets import split_source
    >>> split_source("mine.csv"), split_source("none+mine.csv"), split_source("archive_2019")
    (('snapshot', 'mine.csv'), ('none', 'mine.csv'), ('archive_2019', ''))
    """
    text = str(source)
    base, plus, file = text.partition("+")
    if base not in SOURCES:
        base, file = "snapshot", text
    elif base == "none" and not file:
        raise InputError("known_planets", text, allowed="none+FILE, the file alone")
    elif plus and not file:
        raise InputError("known_planets", text, allowed=f"{base}, or {base}+FILE")
    return base, file


def planets_updated() -> str:
    """Return the date of the latest row of the updates that are shipped."""
    return max(str(row["updated"]) for row in _updates()[0])


def _base(base: str) -> tuple[Sequence[Row], KnownPlanetTable]:
    """Return a table that needs no file, its rows first."""
    return _latest() if base == "latest" else _shipped(base)


def _latest() -> tuple[Sequence[Row], KnownPlanetTable]:
    """Return the newest refreshed table with the updates that are newer; read anew each time."""
    from catalogs.planet_refresh import newer_updates, parse_planets
    from catalogs.refreshed_tables import latest_table

    command = "cpic catalog refresh --planets"
    path = latest_table("archive", key="known_planets", instead="snapshot, archive_2019", command=command)
    file = read_bytes(path, key="known_planets", presets=PRESETS)
    own, day = parse_planets(file)
    below = _laid_over((), own)
    rows = _laid_over(below, newer_updates(below, _updates()[0]))
    about = f"NASA Exoplanet Archive of {day}, {len(own)} planets ({file.name} {file.sha256[:_DIGITS]}), {_updated()}"
    return rows, _table(rows, file.name, about)


def read_planets(file: TableBytes) -> list[Row]:
    """Return the rows of a table of planets, one each.

    Raises
    ------
    InputError
        If it cannot be used, naming file, row, column, value, unit and range.
    """
    return _rows_of_file(parse_table(file), known=())[0]


def _updated() -> str:
    return f"updated {planets_updated()} ({UPDATES_FILE} {_updates()[1][:_DIGITS]})"


@functools.cache
def _shipped(base: str) -> tuple[Sequence[Row], KnownPlanetTable]:
    """Return a shipped table, its rows first."""
    if base == "snapshot":
        below, older = _shipped("archive_2019")
        rows = _laid_over(below, _updates()[0])
        return rows, _table(rows, _LABEL, f"{older.provenance}, {_updated()}")
    rows = [
        {name: cell if name in TEXTS else float(cell) for name, cell in row.items() if cell}
        for row in shipped_rows(DATA_FILE)
    ]
    rows = _laid_over((), rows)
    about = f"NASA Exoplanet Archive of 2019-05-31, {len(rows)} planets ({DATA_FILE} {shipped_digest(DATA_FILE)})"
    return rows, _table(rows, _LABEL, about)


@functools.cache
def _updates() -> tuple[tuple[Row, ...], str]:
    """Return the rows of the shipped updates, and the sha256 of their file."""
    file = read_bytes(Path(__file__).parent / "data" / UPDATES_FILE)
    known = {_key(row) for row in _shipped("archive_2019")[0]}
    return tuple(_rows_of_file(parse_table(file), known=known)[0]), file.sha256


def _laid_over(below: Sequence[Row], own: Iterable[Row]) -> list[Row]:
    """Return the rows of a table with those of another laid over them, new planets at the end."""
    rows = list(below)
    places = {_key(row): place for place, row in enumerate(rows)}
    stars = {key: rows[place]["star"] for (key, _), place in places.items()}
    for row in own:
        place = places.get(_key(row))
        if place is None:
            rows.append(_with_status(row | {"star": stars.get(star_key(row["star"]), row["star"])}, {}))
            continue
        older = rows[place]
        named = {"star": older["star"], "planet": older["planet"]}
        if any(name in row for name in _REQUIRED[0]):
            rows[place] = _with_status(row | named, older)
        else:
            orbit = {key: value for key, value in older.items() if key not in STANDING}
            rows[place] = orbit | {key: value for key, value in row.items() if key in STANDING}
    return rows


def _with_status(row: Row, older: Row) -> Row:
    """Return a row with its status: its own, or that of the row below; the archive's flag makes doubtful, no more."""
    flags = row.get("flags", "").split(";")
    known = {key: older[key] for key in ("status", "status_reference") if key in older and "status" not in row}
    if "status" not in row and "controversial" in flags and known.get("status", "confirmed") == "confirmed":
        known = {"status": "controversial"}
    others = ";".join(word for word in flags if word != "controversial")
    return {"status": "confirmed"} | row | known | {"flags": others}


def _one_each(rows: Iterable[Row]) -> list[Row]:
    """Return one row a planet: of several orbits the one of the largest weight, with all of them as ``solutions``."""
    orbits: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        orbits.setdefault(_key(row), []).append(row)
    return [_mixture(own) if len(own) > 1 else own[0] for own in orbits.values()]


def _mixture(orbits: list[Row]) -> Row:
    first = max(orbits, key=lambda row: float(row["solution_weight"]))
    given = {"several_orbits", *first["flags"].split(";")}
    return first | {"flags": ";".join(word for word in FLAGS if word in given), _SOLUTIONS: tuple(orbits)}


def _key(row: Row) -> tuple[str, str]:
    return planet_key(row["star"], row["planet"])


def _overlay_note(below: Sequence[Row], own: Sequence[Row], name: str) -> str:
    """Say how many planets of a user's table are new and which are replaced."""
    known = {_key(row): row["planet"] for row in below}
    changed = [known[_key(row)] for row in own if _key(row) in known]
    new = len(own) - len(changed)
    replaced = f"{len(changed)} of the {len(below)} planets below {'is' if len(changed) == 1 else 'are'} changed"
    replaced += f": {listed(changed, _SHOWN)}" if changed else ""
    return f"{name}: {replaced}; {new} {'is' if new == 1 else 'are'} new (none+{name} takes the file alone)"


def own_rows(raw: RawTable, *, strict: bool = False) -> tuple[list[Row], Rows]:
    """Return the rows of a user's own table that can be laid over the snapshot, and as they were read.

    Parameters
    ----------
    raw : RawTable
    strict : bool
        As of `load_known_planets`.

    Raises
    ------
    InputError
        As `load_known_planets`.
    """
    known = {_key(row) for row in _shipped("snapshot")[0]}
    return _rows_of_file(raw, own=True, strict=strict, known=known)


def _rows_of_file(
    raw: RawTable, *, known: Collection[tuple[str, str]], own: bool = False, strict: bool = True
) -> tuple[list[Row], Rows]:
    """Return the rows of a file by the columns of a table, and as they were read; ``own`` for a file of the user's.

    ``known`` are the planets of the table below: a row that says nothing but a status must be of one of them.

    Raises
    ------
    InputError
        If a column is missing, no row can be used or, in a strict table, a cell is missing or out of range, or a planet
        is there twice without weights.
    """
    given = read_rows(raw, COLUMNS, _NAMED, about="planet", strict=is_strict(strict) if own else strict)
    if own:
        keep(given)
    if "status" not in given.headings:
        given.refuse_lacking(_REQUIRED)
    if "omega_star_deg" in given.headings and "omega_planet_deg" in given.headings:
        raise InputError(f"{raw.name} columns", "omega_star_deg and omega_planet_deg", allowed="one of the two")
    _refuse_lookalikes(raw, given)

    def read(where: str, row: Row) -> Row:
        _name(row)
        return _user_row(row, where, given, own, known)

    given.make(read)
    unweighted = {_key(row) for row in given.rows if "solution_weight" not in row}
    given.refuse_twins(
        lambda row: (_key(row), "" if _key(row) in unweighted else row.get("reference", "")),
        date=lambda row: row.get("updated", ""),
        remedy="of an archive's solutions keep the default ones, or give each its reference and a solution_weight",
    )
    return _one_each(given.rows), given


def _name(row: Row) -> None:
    """Give a row, in place, the names of star and planet that other columns of it imply."""
    if "star" not in row:
        host = host_of_planet(row["planet"]) if "planet" in row else None
        if star := (host and host[0]) or star_name_of(row):
            row["star"] = star
    if "star" in row and designation_key(row["star"]) not in snapshot_aliases():
        others = (name.strip() for name in row.get("star_aliases", "").split(","))
        row["star"] = next((name for name in others if designation_key(name) in snapshot_aliases()), row["star"])
    letter = row.pop("letter", None)
    if "planet" not in row and letter and "star" in row:
        row["planet"] = f"{row['star']} {letter}"


def _refuse_lookalikes(raw: RawTable, given: Rows) -> None:
    """Refuse a table that says more of an orbit or a mass than is understood: other columns would stand for it."""
    read = set(given.headings)
    unread = given.unused
    remedies = {}
    for row in shipped_rows("lookalikes.csv"):
        pattern, names = row["pattern"], [row["quantity"], *row["instead"].split()]
        found = [text for text in unread if re.search(pattern, heading(text)) and not re.match("st|sy", heading(text))]
        if found and read.isdisjoint(names):
            remedies[found[0]] = f"{found[0]} as {' or '.join(names)}"
    if remedies:
        hint = f"name {', '.join(remedies.values())}, or leave out what is not meant"
        raise InputError(f"{raw.name} columns", ", ".join(remedies), allowed="headings that are understood", hint=hint)


def _user_row(given: Row, where: str, table: Rows, own: bool, known: Collection[tuple[str, str]]) -> Row:
    """Return one row by the columns of a table, its flags included.

    Raises
    ------
    InputError
        If it lacks what is required, or states a status or flag that nobody knows.
    """
    texts = {name: value for name, value in given.items() if isinstance(value, str)}
    # Archives write 0 for an error that nobody gave.
    numbers = {name: value for name, value in given.items() if name not in texts and (value or "_err" not in name)}
    if "status" in texts:
        word = texts["status"].lower()
        texts["status"] = next((ours for part, ours in _STATUS_WORDS.items() if part in word), word)
        if texts["status"] not in STATUSES:
            raise InputError(f"{where} column {table.headings['status']}", given["status"], allowed=", ".join(STATUSES))
    alone = "status" in texts and len(texts) == len(given)
    table.refuse_missing(where, given, _NAMES if alone else (*_NAMES, *_REQUIRED))
    if alone and _key(given) not in known:
        allowed = "an orbit, or a planet of the table below"
        raise InputError(f"{where} column {table.headings['status']}", "a status without an orbit", allowed=allowed)
    stated = tuple(filter(None, texts.pop("flags", "").replace(" ", "").split(";")))
    for word in stated:
        if word not in FLAGS:
            raise InputError(f"{where} column flags", word, allowed=", ".join(GIVEN_FLAGS))
    method = texts.pop("mass_detection_type", "").lower()
    if "candidate" in texts.pop("solution_type", "").lower():
        allowed = "the solution of a confirmed planet"
        raise InputError(f"{where} column {table.headings['solution_type']}", given["solution_type"], allowed=allowed)
    if "calculated" in texts.pop("radius_reference", "").lower():  # from the mass: no measurement
        numbers = {name: value for name, value in numbers.items() if not name.startswith("radius")}
    texts = {name: text for name, text in texts.items() if name not in _ASIDE}
    if alone:  # what says the status is all that the row is about
        texts.setdefault("status_reference", reference_text(texts.pop("reference", "")))
        return texts
    if "periastron_tau" in numbers:
        axis, mass = numbers.get("semi_major_axis_au", math.nan), numbers.get("star_mass_msun", math.nan)
        period_days = numbers.get("period_days", 365.25 * math.sqrt(axis**3 / mass))  # Kepler's third law
        jd = _TAU_JD + numbers.pop("periastron_tau") * period_days
        numbers |= {"periastron_jd": jd, "period_days": period_days} if math.isfinite(jd) else {}
    if "omega_planet_deg" in numbers:
        numbers["omega_star_deg"] = numbers.pop("omega_planet_deg") - 180.0
    turned, mass = "inclination_deg" in numbers, numbers.get("mass_mjup")
    if mass is not None and not turned and _VELOCITIES.search(method):
        numbers.setdefault("msini_mjup", mass)  # velocities alone give no more
    edge_on = math.sin(math.radians(numbers.get("inclination_deg", 0.0))) > _EDGE_ON
    if not edge_on and mass is not None and mass == numbers.get("msini_mjup"):  # as exoplanet.eu repeats it
        del numbers["mass_mjup"]
        if (error := numbers.pop("mass_err_mjup", None)) is not None:
            numbers.setdefault("msini_err_mjup", error)
    kind = texts.pop("best_mass_kind", "")
    if not kind and "best_mass_kind" not in table.headings:
        method = method or texts.get("discovery_method", "").lower()
        kind = "Msini" if _VELOCITIES.search(method) and not turned else "Mass" if method else ""
    numbers, found = settle(numbers, kind, where)
    texts["reference"] = reference_text(texts.get("reference", ""))
    found += tuple(word for word in stated if word in GIVEN_FLAGS)
    found += ("columns_not_used",) if own and table.unused else ()
    texts["flags"] = ";".join(flags_of(numbers, found, exact=own))
    return texts | numbers


def _table(rows: Sequence[Row], label: str, provenance: str, notes: tuple[str, ...] = ()) -> KnownPlanetTable:
    columns = {name: np.array([row.get(name, none) for row in rows]) for name, none in _MISSING.items()}
    solutions = {
        row["planet"]: _table([orbit | {"planet": row["planet"]} for orbit in row[_SOLUTIONS]], label, provenance)
        for row in rows
        if _SOLUTIONS in row
    }
    return KnownPlanetTable(columns, label, provenance, notes, solutions)
