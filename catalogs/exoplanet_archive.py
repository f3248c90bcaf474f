"""The NASA Exoplanet Archive's planets of catalogue stars, from its table ``ps``: one row for each published solution.

Every column is asked for, and those that are needed are picked from what comes: tables and columns of the archive have
changed before, and an answer shows what they are called today. A column under an older name, in another unit or missing
is named in a remark, or where the table is worth nothing without it, in the refusal.

Of a planet's solutions the default one counts. Where that gives no time of periastron or conjunction, and another
confirmed solution of the same period does, the orbit (period, time, eccentricity, argument of periastron, with errors
and reference) is the whole one of the newest such publication, so that elements of two fits are never mixed; the row is
flagged. Errors are half the width of the published interval; the archive's 0 for an error means that none is given.
Columns: https://exoplanetarchive.ipac.caltech.edu/docs/API_PS_columns.html; Akeson et al. 2013, PASP 125, 989.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from catalogs.coordinates import separation_arcsec
from catalogs.known_planet_columns import COLUMNS, flags_of, reference_text, settle
from catalogs.known_planet_table import planet_key
from catalogs.names import snapshot_aliases
from catalogs.nomenclature import designation_key
from catalogs.stars import StarTable
from catalogs.table_cells import Column, Columns, Row, read_rows
from catalogs.table_files import RawTable
from catalogs.tap_client import RefreshError, TapService
from cpic_core import InputError

URL_VARIABLE = "CPIC_ARCHIVE_URL"
"""Environment variable with the address of the archive's TAP service, where none is given."""
ARCHIVE_URL = "https://exoplanetarchive.ipac.caltech.edu/TAP"
PLANETS_QUERY = "SELECT * FROM ps WHERE sy_dist <= 50"
"""All solutions of planets within 50 pc; the catalogue ends at 40 pc."""
NARROWER = "ask another service with --url"
"""Advice of messages on an answer with too many rows."""

# Column of ours, its error, and the archive's.
ORBIT = (
    ("period_days", "period_err_days", "pl_orbper"),
    ("periastron_jd", "periastron_err_days", "pl_orbtper"),
    ("conjunction_jd", "conjunction_err_days", "pl_tranmid"),
    ("eccentricity", "eccentricity_err", "pl_orbeccen"),
    ("omega_star_deg", "omega_err_deg", "pl_orblper"),
)
REST = (
    ("semi_major_axis_au", "semi_major_axis_err_au", "pl_orbsmax"),
    ("msini_mjup", "msini_err_mjup", "pl_msinij"),
    ("best_mass_mjup", "best_mass_err_mjup", "pl_bmassj"),
    ("inclination_deg", "inclination_err_deg", "pl_orbincl"),
    ("radius_rjup", "radius_err_rjup", "pl_radj"),
    ("star_mass_msun", "star_mass_err_msun", "st_mass"),
)
_LIMITS = ("pl_orbeccen", "pl_bmassj")
"""Columns of which a limit is kept and flagged; a limit of any other column is no value."""
_TEXTS = {
    "pl_name": "",
    "hostname": "plhostname",
    "hd_name": "",
    "hip_name": "",
    "discoverymethod": "pldiscmethod",
    "pl_bmassprov": "",
    "pl_refname": "pldefrefname",
    "pl_pubdate": "",
    "rowupdate": "plupdate",
}
"""Columns of texts, with their names before 2021 as `catalogs.table_cells.heading` reduces them."""
_OPTIONAL_TEXTS = {"soltype": "", "pl_letter": ""}
_PLAIN = {"default_flag": ("", ""), "pl_controv_flag": ("", ""), "ra": ("deg", ""), "dec": ("deg", "")}
_PLAIN |= {"sy_dist": ("pc", "stdist")}
_UNITS = {
    "days": "d",
    "day": "d",
    "au": "AU",
    "degrees": "deg",
    "jupitermass": "jupiterMass",
    "mj": "jupiterMass",
    "mjup": "jupiterMass",
    "mjupiter": "jupiterMass",
    "jupiterradius": "jupiterRad",
    "jupiterradii": "jupiterRad",
    "rj": "jupiterRad",
    "rjup": "jupiterRad",
    "rjupiter": "jupiterRad",
    "solarmass": "solMass",
    "msun": "solMass",
}
"""Units as the archive has written them, lower case without blanks and underlines, and as we do."""
_FAR_ARCSEC = 120.0
_SAME_DISTANCE = 0.2
_SAME_PERIOD = 0.1
_REMEDY = "the archive may have changed or the service is not the archive; tables already here stay as they are"


def _columns() -> tuple[Columns, list[str]]:
    """Return the columns that are read, and the names of those that must be there."""
    anything = (-math.inf, math.inf)
    wanted = [Column(name, aliases=aliases) for name, aliases in (_TEXTS | _OPTIONAL_TEXTS).items()]
    wanted += [Column(name, "", "float", unit, aliases, *anything) for name, (unit, aliases) in _PLAIN.items()]
    for ours, _, name in (*ORBIT, *REST):
        units = {"": COLUMNS[ours].unit, "err1": COLUMNS[ours].unit, "err2": COLUMNS[ours].unit, "lim": ""}
        wanted += [Column(f"{name}{end}", "", "float", unit, "", *anything) for end, unit in units.items()]
    return Columns(*wanted), [*_TEXTS, *_PLAIN, *(name for _, _, name in (*ORBIT, *REST))]


ARCHIVE, _NEEDED = _columns()


@dataclass(frozen=True)
class ArchivePlanets:
    """Planets of catalogue stars as the archive has them.

    Parameters
    ----------
    rows : list of dict
        One planet each, by columns of `catalogs.known_planet_columns.COLUMNS`, sorted by star and planet.
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
    known, notes = _known_columns(answer)
    try:
        read = read_rows(known, ARCHIVE, (), about="pl_name")
        for where, row in read:
            read.refuse_missing(where, row, (("pl_name",), ("hostname",)))
    except InputError as error:
        raise RefreshError(str(error), _REMEDY) from None
    solutions: dict[str, list[Row]] = {}
    for row in read.rows:
        solutions.setdefault(row["pl_name"], []).append(row)
    hosts = _Hosts(stars)
    rows: dict[tuple[str, str], Row] = {}
    left_out: dict[str, str] = {}
    for name, published in solutions.items():
        try:
            star = hosts.star_of(published[0])
            if star is None:
                continue
            row, remarks = _planet(star, published)
        except InputError as error:
            left_out[name] = str(error)
            continue
        if rows.setdefault(planet_key(star, row["planet"]), row) is not row:
            left_out[name] = f"another planet of the archive is {row['planet']} too"
        notes += remarks
    if not rows:
        raise RefreshError("no planet of the answer is of a catalogue star", _REMEDY)
    counts = {"solutions": len(read.rows), "planets of the answer": len(solutions), "planets": len(rows)}
    return ArchivePlanets([rows[key] for key in sorted(rows)], counts, left_out, notes)


def _known_columns(answer: RawTable) -> tuple[RawTable, tuple[str, ...]]:
    """Return the columns that are read, units as we write them; and remarks on names, units and what is missing.

    Raises
    ------
    RefreshError
        If one is missing without which the table is worth nothing.
    """
    columns, notes = [], []
    for given in answer.columns:
        meant = ARCHIVE.meant_by(given.heading).column
        if meant is None:
            continue
        unit = given.unit if meant.unit else ""
        unit = _UNITS.get(unit.lower().replace(" ", "").replace("_", ""), unit)
        if unit not in ("", meant.unit):
            notes.append(f"{given.heading} is in {unit}, not in {meant.unit}: converted")
        if given.heading.lower() != meant.name:
            notes.append(f"{meant.name} is called {given.heading}")
        columns.append(replace(given, unit=unit))
    found = {meant.name for item in columns if (meant := ARCHIVE.meant_by(item.heading).column)}
    if lacking := [name for name in _NEEDED if name not in found]:
        raise RefreshError(f"the archive's table has no column {', '.join(lacking)}", _REMEDY)
    if lacking := [name for name in ARCHIVE if name not in found]:
        notes.append(f"columns that the archive no longer has: {', '.join(lacking)}")
    return RawTable(answer.name, columns), tuple(notes)


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
    if not own:
        return None
    if len({name for name, _ in hits}) > 1:
        raise InputError(where, ", ".join(own), allowed="names of one star")
    return own[0]


class _Hosts:
    """Catalogue stars by the names, and checked by the places, that the archive gives."""

    def __init__(self, stars: StarTable) -> None:
        names, ra, dec, distance = (
            stars.column(name).tolist() for name in ("name", "ra_deg", "dec_deg", "distance_pc")
        )
        self._places = dict(zip(names, zip(ra, dec, distance, strict=True), strict=True))

    def star_of(self, row: Row) -> str | None:
        """Return the catalogue's name of a planet's star; None if it is not in there.

        Raises
        ------
        InputError
            If its names mean different stars, or it stands elsewhere: by two arcminutes, a decade of the fastest
            proper motion, or a fifth of the distance.
        """
        where = f"star of {row['pl_name']}"
        names = [row.get(key, "") for key in ("hostname", "hd_name", "hip_name")]
        name = host_among(where, names, snapshot_aliases())
        if name is None:
            return None
        ra, dec, distance_pc = self._places[name]
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
    orbit = default
    if not _is_dated(default):
        dated = (row for row in others if _is_dated(row, with_errors=True) and _same_period(row, default))
        if found := next(dated, None):
            orbit = found
    given = () if orbit is default else ("earlier_orbit",)
    numbers, flags = settled(default, orbit, default["pl_name"])
    remarks = []
    for name in list(numbers):
        try:
            believe(default["pl_name"], name, numbers[name])
        except InputError as error:
            remarks.append(f"left out: {error}")
            del numbers[name]
    for needed in (("period_days", "semi_major_axis_au"), ("mass_mjup", "msini_mjup", "radius_rjup")):
        if not any(name in numbers for name in needed):
            raise InputError(f"{default['pl_name']} {' or '.join(needed)}", "missing")
    letter = default.get("pl_letter") or default["pl_name"].split()[-1]
    texts = {
        "star": star,
        "planet": f"{star} {letter}",
        "discovery_method": default.get("discoverymethod", ""),
        "reference": reference_text(orbit.get("pl_refname", "")),
        "updated": default.get("rowupdate", "")[:10],
        "flags": ";".join(flags_of(numbers, given + flags)),
    }
    return texts | numbers, tuple(remarks)


def _is_dated(row: Row, *, with_errors: bool = False) -> bool:
    """Return whether a solution says when the planet is where, with the errors without which that soon means little."""
    ends = ("", "err1") if with_errors else ("",)
    times = any(all(f"{name}{end}" in row for end in ends) for name in ("pl_orbtper", "pl_tranmid"))
    return times and all(f"pl_orbper{end}" in row for end in ends)


def _same_period(one: Row, other: Row) -> bool:
    if "pl_orbper" not in other:
        return True
    return bool(abs(one["pl_orbper"] - other["pl_orbper"]) < _SAME_PERIOD * other["pl_orbper"])


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
    numbers = _numbers(orbit, ORBIT) | _numbers(row, REST)
    numbers["best_mass_limit"] = float(row.get("pl_bmassjlim") or 0.0)
    numbers["eccentricity_limit"] = float(orbit.get("pl_orbeccenlim") or 0.0)
    numbers["controversial"] = float(row.get("pl_controv_flag") or 0.0)
    return settle(numbers, str(row.get("pl_bmassprov", "")), where)


def _numbers(row: Mapping[str, Any], names: tuple[tuple[str, str, str], ...]) -> dict[str, float]:
    """Return values and errors that the archive gives."""
    found: dict[str, float] = {}
    for value_name, error_name, column in names:
        if row.get(column, "") == "" or (float(row.get(f"{column}lim") or 0.0) and column not in _LIMITS):
            continue
        found[value_name] = float(row[column])
        sides = [abs(float(row[key])) for end in ("err1", "err2") if row.get(key := f"{column}{end}", "") != ""]
        error = sum(sides) / len(sides) if sides else 0.0
        if error > 0.0:
            found[error_name] = float(f"{error:.6g}")
    return found


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
    believed = COLUMNS[name]
    if not believed.low <= value <= believed.high:
        raise InputError(f"{where} {name}", value, unit=believed.unit, allowed=believed.allowed)
