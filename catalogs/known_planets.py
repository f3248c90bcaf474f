"""Known planets: published orbits of companions of catalogue stars, and what each of them lacks.

The shipped tables and a user's own have the same columns. Names of the NASA Exoplanet Archive are accepted as headings.

Two tables are shipped: the confirmed planets of the NASA Exoplanet Archive, as of 2019-05-31, of stars in the
catalogue; and what has changed since, kept by hand with a date and a source in every row, which is laid over it.
Arguments of periastron are those of the star's orbit, as radial velocities have them; the planet's own is 180 degrees
more. A number is nan where the source has none; nothing is filled in, and ``flags`` says what is missing.

A row that is laid over another one of the same planet replaces its whole orbit, so that elements of two publications
are never mixed; what it does not say about the planet's status stays. A row with a status and no orbit changes the
status alone. Where publications disagree, a planet has several rows, each a whole orbit with a weight: together they
are a mixture, from which draws take one orbit each.

A refreshed table stands beside the shipped one as the base that ``latest`` names, and the updates kept by hand are laid
over it like over the table of 2019, with one difference: an orbit of theirs only where its row is newer than the last
change of the archive's own row. What they say of a planet's status stays whatever the date, for the archive has no word
for refuted: a planet that they refute is not counted again because the archive touched its row.
"""

import functools
import html
import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from catalogs.names import snapshot_aliases
from catalogs.nomenclature import designation_key, host_of_planet, star_name_of
from catalogs.shipped import shipped_digest, shipped_rows, shipped_words
from catalogs.stars import FrozenTable
from catalogs.table_cells import Columns, Row, Rows, columns_of, heading, read_rows
from catalogs.table_files import ROW_OUT, RawTable, TableBytes, parse_table, read_bytes
from catalogs.user_tables import is_strict, keep, tell
from cpic_core import ArrayLike, InputError, NDArray, check_flag, listed

COLUMNS = Columns(*columns_of("planets"), table="planets")
"""Every column by its name, in the order of the shipped file."""
STANDING = ("status", "status_reference", "updated", "note")
"""Columns that say how sure a planet is."""
UPDATES_ONLY = ("solution_weight", *STANDING)
"""Columns that the table of 2019 does not have, and what is laid over it may."""
INPUT_ONLY = tuple(column.name for column in columns_of("planets", only="input"))
"""Columns that a table of a user's own may have; reading turns them into the others."""
STATUSES = shipped_words("planet_statuses")
"""Meaning of each status."""
COUNTED = tuple(shipped_words("planet_statuses", "counted"))
"""Statuses of the planets that rankings, plans, what-ifs and scenes have; the others are only listed."""
CANDIDATE = "candidate"
"""Status of those that are counted as well when asked for."""
FLAGS = shipped_words("planet_flags")
"""Meaning of each flag of a planet, by its name."""
GIVEN_FLAGS = tuple(shipped_words("planet_flags", "given"))
"""Flags that a table states; the others follow from what is missing."""


def flags_of(row: Mapping[str, float], given: tuple[str, ...] = (), *, exact: bool = False) -> tuple[str, ...]:
    """Return the flags of one planet, in the order of `FLAGS`.

    Parameters
    ----------
    row : mapping of str to float
        Numbers by column; nan or absent where missing.
    given : tuple of str
        Flags that the table states.
    exact : bool
        Whether a number without an error is exact, the time of periastron or conjunction too: so it is in a row of a
        user's own. A row of an archive does not state the error, and its phase is unknown without.
    """
    there = {name for name, value in row.items() if math.isfinite(value)}
    return _flags_of(frozenset(there.union(given, ("exact",) * exact)))


@functools.lru_cache(maxsize=10_000)
def _flags_of(given: frozenset[str]) -> tuple[str, ...]:
    """Return the flags of a row that has these numbers and flags; of the many rows of a table most have the same."""
    there = set(given)
    for flag, needs, lacks in _flag_rules():
        if needs <= there and lacks.isdisjoint(there):
            there.add(flag)
    return tuple(name for name in FLAGS if name in there)


@functools.cache
def _flag_rules() -> tuple[tuple[str, frozenset[str], frozenset[str]], ...]:
    """Return flags, each with what a row must have and must not have; later rules may ask for flags of earlier ones."""
    rows = shipped_rows("planet_flag_rules.csv")
    return tuple((row["flag"], frozenset(row["needs"].split()), frozenset(row["lacks"].split())) for row in rows)


_KINDS = shipped_words("mass_kinds")
"""Kinds of the archive's best mass by its provenance: a true or a minimum mass, or one from a radius."""


def settle(numbers: dict[str, float], kind: str, where: str) -> tuple[dict[str, float], tuple[str, ...]]:
    """Turn the archive's best mass and its limits into columns of ours.

    Parameters
    ----------
    numbers : dict of str to float
        What a row gives, by column of `COLUMNS`; errors above 0.
    kind : str
        The archive's provenance of the best mass; ``""`` if the table has none.
    where : str
        The row, for messages.

    Returns
    -------
    dict, tuple of str
        Numbers without the archive's own columns, and the flags that follow.

    Raises
    ------
    InputError
        For an unknown kind of mass.

    Notes
    -----
    An inclination of exactly 90 degrees without an error is an assumption of the fit: it is left out, and the mass
    taken as m sin i, as is a mass that is a lower limit. A mass that the archive has from a radius is left out.
    """
    found, flags = dict(numbers), []
    best, error = found.pop("best_mass_mjup", None), found.pop("best_mass_err_mjup", None)
    limit, eccentric = found.pop("best_mass_limit", 0.0), found.pop("eccentricity_limit", 0.0)
    if found.pop("controversial", 0.0):
        flags.append("controversial")
    if eccentric > 0.0:
        flags.append("eccentricity_upper_limit")
    if best is None:
        return found, tuple(flags)
    if kind not in _KINDS:
        raise InputError(f"{where} column best_mass_kind", kind or "missing", allowed=", ".join(_KINDS))
    name = _KINDS[kind]
    if found.get("inclination_deg") == 90.0 and "inclination_err_deg" not in found:
        del found["inclination_deg"]
        flags.append("edge_on_assumed")
        name = name and "msini"
    if limit:
        flags.append("mass_upper_limit" if limit > 0.0 else "mass_lower_limit")
        name = name if limit > 0.0 else name and "msini"
    if name:
        found.pop(f"{name}_err_mjup", None)
        found[f"{name}_mjup"] = best
        if error is not None:
            found[f"{name}_err_mjup"] = error
        if name == "msini":
            found = {key: value for key, value in found.items() if key not in ("mass_mjup", "mass_err_mjup")}
    return found, tuple(flags)


@functools.lru_cache(maxsize=10_000)
def reference_text(link: str) -> str:
    """Return ``Benedict et al. 2006 (2006AJ....132.2206B)`` of a link to a bibliography; other text as it is."""
    words = " ".join(html.unescape(re.sub(r"<[^>]*>", " ", link)).split())
    bibcode = re.search(r"(?:bibcode=|abs/)([^\s>\"/]+)", link)
    code = html.unescape(bibcode[1]).replace("%26", "&") if bibcode else ""
    return f"{words} ({code})" if code else words


TABLE_COLUMNS = tuple(name for name in COLUMNS if name not in INPUT_ONLY)
TEXTS = tuple(name for name in TABLE_COLUMNS if COLUMNS[name].kind == "text")
NUMBERS = tuple(name for name in TABLE_COLUMNS if name not in TEXTS)
PLACE_DEG = 3.0
"""Error of the angles of an orbit within which its planet's place is known: a resolution element at 1 arcsec."""


class KnownPlanetTable(FrozenTable):
    """An immutable table of planets.

    Parameters
    ----------
    columns : mapping of str to ndarray
        Read-only arrays of equal length: those of `catalogs.known_planets.COLUMNS` less ``INPUT_ONLY``;
        float64 with nan where missing, or text.
    label : str
        What messages call the table.
    provenance : str
        One line for results: what it is, its vintage or file name, the first digits of its sha256.
    notes : tuple of str
        Remarks on the reading, for its owner.
    solutions : mapping of str to KnownPlanetTable
        All published orbits of the planets that have several, by the name of the planet, each orbit a row with its
        ``solution_weight``. In ``columns`` these planets have the orbit of the largest weight.
    candidates : bool
        Whether candidates are counted as well.
    unused : tuple of str
        Headings of a user's file that were not used; its planets have the flag ``columns_not_used``.
    """

    label: str
    provenance: str
    notes: tuple[str, ...] = ()
    solutions: Mapping[str, "KnownPlanetTable"] = field(default_factory=dict)
    candidates: bool = False
    unused: tuple[str, ...] = ()

    def number(self, name: str) -> NDArray[np.float64]:
        """Return a column of numbers (read-only)."""
        if name not in NUMBERS:
            raise InputError("column", name, allowed=", ".join(NUMBERS))
        return np.asarray(self.columns[name], np.float64)

    def text(self, name: str) -> list[str]:
        """Return a column of texts."""
        if name not in TEXTS:
            raise InputError("column", name, allowed=", ".join(TEXTS))
        return [str(cell) for cell in self.columns[name]]

    def flags(self, row: int) -> tuple[str, ...]:
        """Return the flags of one planet."""
        return tuple(filter(None, str(self.columns["flags"][row]).split(";")))

    def select(self, rows: ArrayLike) -> "KnownPlanetTable":
        """Return the table of the rows of a mask, or of row numbers in their order."""
        index = np.asarray(rows)
        index = np.flatnonzero(index) if index.dtype == np.bool_ else index.astype(np.int64)
        columns = {name: cells[index] for name, cells in self.columns.items()}
        return replace(self, columns=columns, notes=())

    def orbits_of(self, row: int) -> "KnownPlanetTable":
        """Return the published orbits of one planet, each a row: one, or several with their weights."""
        return self.solutions.get(str(self.columns["planet"][row])) or self.select([row])

    def with_candidates(self) -> "KnownPlanetTable":
        """Return the table in which candidates are counted like confirmed planets."""
        return replace(self, candidates=True, provenance=f"{self.provenance}, candidates counted")

    @functools.cached_property
    def counted(self) -> NDArray[np.bool_]:
        """Tell which planets are counted: those whose status is not ``refuted``, nor ``candidate`` unless asked for."""
        return np.isin(self.columns["status"], (*COUNTED, CANDIDATE) if self.candidates else COUNTED)

    @functools.cached_property
    def listed_by_star(self) -> Mapping[str, tuple[int, ...]]:
        """Rows of all planets of each star, counted or not, by `star_key` of its name."""
        found: dict[str, list[int]] = {}
        for row, name in enumerate(self.text("star")):
            found.setdefault(star_key(name), []).append(row)
        return MappingProxyType({key: tuple(rows) for key, rows in found.items()})

    @functools.cached_property
    def by_star(self) -> Mapping[str, tuple[int, ...]]:
        """Rows of the counted planets of each star that has any, by `star_key` of its name."""
        counted = {key: tuple(row for row in rows if self.counted[row]) for key, rows in self.listed_by_star.items()}
        return MappingProxyType({key: rows for key, rows in counted.items() if rows})

    @functools.cached_property
    def placed(self) -> NDArray[np.bool_]:
        """Tell which planets have a place on the sky: phase, inclination and node are known, within `PLACE_DEG` deg.

        Planets with several published orbits have none. The errors of the angles are added in quadrature, that of the
        phase as it is a period after the time given.
        """
        lacking = {"phase_unknown", "several_orbits"}
        dated = np.array([lacking.isdisjoint(self.flags(row)) for row in range(len(self))], bool)
        times = [self.number(f"{what}_err_days") for what in ("conjunction", "periastron")]
        time_days = np.where(np.isfinite(self.number("conjunction_jd")), *times)
        turns = [days / self.number("period_days") for days in (time_days, self.number("period_err_days"))]
        angles_deg = [self.number(f"{what}_err_deg") for what in ("inclination", "node")]
        angles_deg += [360.0 * turn for turn in turns]
        error_deg = np.sqrt(np.sum(np.square(np.nan_to_num(angles_deg, nan=0.0)), axis=0))
        known = np.isfinite(self.number("inclination_deg")) & np.isfinite(self.number("node_deg"))
        return np.asarray(dated & known & (error_deg <= PLACE_DEG))

    def rows_of(self, star: str) -> tuple[int, ...]:
        """Return the rows of a star's counted planets, by any of its names; empty if it has none."""
        return self.by_star.get(star_key(star), ())

    def listed_rows_of(self, star: str) -> tuple[int, ...]:
        """Return the rows of all planets of a star, those that are not counted too, by any of its names."""
        return self.listed_by_star.get(star_key(star), ())

    def row_of(self, name: str) -> int:
        """Return the row of a planet, counted or not, by its name: any name of its star, and its letter.

        Raises
        ------
        InputError
            If there is no such planet.
        """
        star, _, letter = " ".join(name.split()).rpartition(" ")
        rows = self.listed_rows_of(star)
        planets = self.text("planet")
        for row in rows:
            if planets[row].rpartition(" ")[2] == letter:
                return row
        hint = f"of this star: {', '.join(planets[row] for row in rows)}" if rows else ""
        raise InputError("planet", name, allowed=f"a planet of {self.label}", hint=hint)


@functools.lru_cache(maxsize=100_000)
def star_key(name: str) -> str:
    """Return one key for all names of a star: that of its name in the embedded catalogue, where it is in there.

    Examples
    --------
    >>> from catalogs.known_planets import star_key
    >>> star_key("HD 22049") == star_key("epsilon Eridani") == star_key("eps Eri")
    True
    """
    key = designation_key(name)
    known = snapshot_aliases().get(key, (name, 0))[0]
    return key if known == name else designation_key(known)


def planet_key(star: str, planet: str) -> tuple[str, str]:
    """Return one key for all names of a planet: that of its star, and the last word of its own name.

    Parameters
    ----------
    star, planet : str
        Any name of the star, and any of the planet; the last word of the latter is its letter.

    Examples
    --------
    >>> from catalogs.known_planets import planet_key
    >>> planet_key("HD 22049", "HD 22049 b") == planet_key("eps Eri", "epsilon Eridani b")
    True
    """
    return star_key(star), planet.split()[-1].casefold()


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
        with the updates that are newer (`newer_updates`).
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
    notes = given.remarks()
    if table is not None:
        about = f"{about} over {table.provenance}"
        notes += (_overlay_note(below, own, file.name),)
    rows = _laid_over(below, own)
    made = _table(rows, file.name, about, notes)
    tell(*notes)
    return replace(made, unused=given.unused)


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
    from catalogs.archives import latest_table

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


def parse_planets(file: TableBytes) -> tuple[list[Row], str]:
    """Return the rows of a refreshed table of planets, and the day on which the archive was asked.

    Parameters
    ----------
    file : TableBytes
        ECSV as `catalogs.planets_ecsv` writes it.

    Raises
    ------
    InputError
        If it is damaged, of another version, or another table.
    """
    from catalogs.archives import parse_ecsv

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
