"""Describe the embedded data: vintage, counts per cut, sources, licences and credits.

Which star table a question is about: the snapshot, with or without updates, the latest refreshed one, or a file; and
what a file is read as, a table of stars or of planets.
"""

import contextlib
import functools
import json
import re
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal, get_args

from catalogs.binaries import BinaryOrbit, binary_orbits, orbits_vintage
from catalogs.known_planets import (
    COLUMNS as PLANET_COLUMNS,
    REQUIRED as PLANETS_REQUIRED,
    STATUSES,
    UPDATES_FILE,
    load_known_planets,
    own_rows,
    planets_updated,
)
from catalogs.shipped import parsed, shipped_rows, shipped_words
from catalogs.stars import (
    QUANTITIES,
    PublishedParameters,
    StarTable,
    load_stars,
    parameters_vintage,
    published_parameters,
    with_updates,
)
from catalogs.stellar_physics import stellar_parameters
from catalogs.table_cells import Columns, Groups, Use, reasons
from catalogs.table_files import LeftOut, RawTable, parse_table, read_bytes
from catalogs.user_tables import ASSUMED_PC, REQUIRED as STARS_REQUIRED, named_star, tables_read, tell, user_table
from cpic_core import InputError, Record, in_unit

_DATA = Path(__file__).resolve().parent / "data"

STAR_CREDITS = tuple(shipped_words("star_credits").values())
"""Credits of the embedded and refreshed star tables."""

PLANET_CREDITS = tuple(shipped_words("planet_credits").values())
"""Credits of the table of known planets."""

MODEL_CREDITS = tuple(shipped_words("model_credits").values())
"""Credits of the other data, which every result rests on."""


@functools.cache
def _provenance() -> list[dict[str, Any]]:
    entries: list[dict[str, Any]] = json.loads((_DATA / "PROVENANCE.json").read_text(encoding="utf-8"))["files"]
    return entries


def _entry(file: str) -> dict[str, Any]:
    """Return what is said of a shipped file."""
    return next(item for item in _provenance() if item["data_file"] == file)


def snapshot_vintage(*, updates: bool = True) -> str:
    """Return in one line what the star table is and how old, with the first digits of its checksum.

    Parameters
    ----------
    updates : bool
        Whether companions follow the orbits of `catalogs.binaries`, and temperatures are those of
        `catalogs.stars`.
    """
    return parsed("stars")[1]["updated" if updates else "plain"]


def vintage_of_files(*, updates: bool) -> str:
    """Return what `snapshot_vintage` does, from the files themselves."""
    entry = _entry("stars.csv")
    laid_over = f"; {orbits_vintage()}; {parameters_vintage()}" if updates else ""
    return f"{entry['vintage']} (stars.csv {entry['sha256'][:12]}{laid_over})"


def _updates() -> dict[str, Any]:
    """Return the date and file of the updates of known planets, and the planets that are not simply confirmed."""
    table = load_known_planets()
    pairs = list(zip(table.text("status"), table.text("planet"), strict=True))
    return {"date": planets_updated(), "file": UPDATES_FILE, "n_rows": sum(map(bool, table.text("updated")))} | {
        status: [planet for own, planet in pairs if own == status] for status in STATUSES if status != "confirmed"
    }


def _known(item: BinaryOrbit | PublishedParameters) -> dict[str, Any]:
    """Return what a row says, without numbers that it does not give."""
    return {name: value for name, value in asdict(item).items() if value == value}


def catalogue_info() -> dict[str, Any]:
    """Return everything that ``cpic catalog info`` shows.

    Returns
    -------
    dict
        ``vintage``, ``counts`` (cut, count, reference count and remark), ``notes``, ``binary_orbits`` (pairs whose
        companion follows its orbit), ``published_parameters`` (what publications say of temperatures, one row a
        publication and star), ``known_planets`` (vintage, notes, ``updates``: date, file, and the planets
        of each status that is not ``confirmed``), ``files`` (name, source packages, licence, description) and
        ``credits``.
    """
    counts = [
        {"cut": f"{row['group']}: {row['what']}", "count": int(row["count"])}
        | {name: row[name] for name in ("reference", "note")}
        for row in shipped_rows("stars_counts.csv")
    ]
    files = [
        {
            "file": entry["data_file"],
            "packages": ", ".join(sorted({f"{source['package']} {source['version']}" for source in entry["sources"]})),
            "licence": entry["licence"],
            "description": entry["description"],
        }
        for entry in _provenance()
    ]
    stars, planets = _entry("stars.csv"), _entry("known_planets.csv")
    return {
        "vintage": snapshot_vintage(),
        "counts": counts,
        "notes": stars["notes"],
        "binary_orbits": [_known(item) for item in binary_orbits()],
        "published_parameters": [_known(item) for items in published_parameters().values() for item in items],
        "known_planets": {"vintage": planets["vintage"], "notes": planets["notes"], "updates": _updates()},
        "files": files,
        "credits": [*STAR_CREDITS, *PLANET_CREDITS, *MODEL_CREDITS],
    }


RANKED_V_MAG = 7.0
"""Faintest V of a ranking of the snapshot or a refreshed table, mag; they reach a little deeper."""
NAMED_TABLES = ("snapshot", "latest", "simbad_2012")
"""Words that name a star table; anything else is a file."""
_DIGITS = 12
TableKind = Literal["stars", "planets"]
_USER = "user's "
_USER_TABLE = f"{_USER}table"


class Catalogue(Record):
    """A star table and what results say about it.

    Parameters
    ----------
    table : StarTable
        The stars, where their sources saw them.
    kind : {"snapshot", "simbad_2012", "refreshed", "file"}
        Where they come from.
    provenance : str
        One line for results: what it is, its date or file name (no folder), the first digits of its sha256.
    sample : str
        What its stars are, in words: "every FGK star of the snapshot with parallax >= 25 mas".
    notes : tuple of str
        Remarks on the reading, for the person who asked.
    """

    table: StarTable
    kind: Literal["snapshot", "simbad_2012", "refreshed", "file"]
    provenance: str
    sample: str
    notes: tuple[str, ...] = ()

    @property
    def ranked_v_mag(self) -> float | None:
        """Faintest V of a ranking unless asked otherwise; None for all rows."""
        return None if self.kind == "file" else RANKED_V_MAG

    @property
    def orbits(self) -> bool:
        """Tell whether companions follow the orbits of `catalogs.binaries`."""
        return self.kind in ("snapshot", "refreshed")


def open_catalogue(source: str | Path = "snapshot", *, strict: bool = False) -> Catalogue:
    """Return a star table.

    Parameters
    ----------
    source : str or Path
        ``"snapshot"`` (embedded), ``"simbad_2012"`` (the same with companions where they were first listed, without
        orbits), ``"latest"`` (the newest that ``cpic catalog refresh`` left in the
        data folder), or a file: a table of a user's own, or a refreshed one. A file of one of these three names is
        written with its folder: ``./latest``.
    strict : bool
        Refuse a user's table for the first row or cell that cannot be used, instead of leaving it out with a remark.

    Raises
    ------
    InputError
        If there is no such table, or it cannot be used; naming file, row, column, value, unit and range.
    """
    source = checked_table_name(source)
    if source == "snapshot" or source == "simbad_2012":
        updates = source == "snapshot"
        table, vintage = load_stars(updates=updates), snapshot_vintage(updates=updates)
        sample = "every FGK star of the snapshot with parallax >= 25 mas"
        return Catalogue(table, "snapshot" if updates else "simbad_2012", vintage, sample)
    if source == "latest":
        from catalogs.archives import latest_table

        source = latest_table("simbad", key="catalog", instead="snapshot", command="cpic catalog refresh")
    return _from_file(source, strict)


def checked_table_name(source: object) -> str | Path:
    """Return what may be the name of a star table; see `open_catalogue`.

    Parameters
    ----------
    source : object
        A name that is known, or that of a file.

    Raises
    ------
    InputError
        If it is no name.
    """
    if not isinstance(source, str | Path) or not str(source):
        raise InputError("catalog", source, allowed=f"{', '.join(NAMED_TABLES)}, or the name of a table file")
    return source


def catalogue_of_star(
    name: str,
    v_mag: float,
    *,
    sp_type: str | None = None,
    teff_k: float | None = None,
    distance_pc: float | None = None,
) -> Catalogue:
    """Return the table of one star that is in none.

    Parameters
    ----------
    name : str
    v_mag : float
        Johnson V, -30 to 30 mag.
    sp_type : str, optional
    teff_k : float, optional
        Effective temperature, 2000 to 50 000 K; instead of that of the spectral type.
    distance_pc : float, optional
        0.01 to 100 000 pc; 10 pc by default, which is flagged ``distance_assumed``.

    Raises
    ------
    InputError
        For a spectral type that gives no temperature, or neither of the two.
    """
    v_mag = in_unit("v_mag", v_mag, "mag")
    teff_k, distance_pc = in_unit("teff_k", teff_k, "K"), in_unit("distance_pc", distance_pc, "pc")
    if teff_k is None:
        try:
            stellar_parameters(sp_type or "")
        except InputError as error:
            hint = error.hint or "a temperature stands for it"
            raise InputError("sp_type", sp_type or "missing", allowed=error.allowed, hint=hint) from None
    far = f"{ASSUMED_PC:g} pc (assumed)" if distance_pc is None else f"{distance_pc:g} pc"
    facts = [f"V {v_mag:g}", sp_type or "", "" if teff_k is None else f"{teff_k:g} K", far]
    table = named_star(name, v_mag, sp_type=sp_type, teff_k=teff_k, distance_pc=distance_pc)
    return Catalogue(table, "file", f"{_USER}star: {', '.join(filter(None, facts))}", "one star")


def data_credits(provenance: str) -> tuple[str, ...]:
    """Return whose data a result with a table of this ``provenance`` rests on; a user's own stars are not SIMBAD's."""
    return MODEL_CREDITS if provenance.startswith(_USER) else (*STAR_CREDITS, *MODEL_CREDITS)


def _from_file(path: str | Path, strict: bool) -> Catalogue:
    file = read_bytes(path)
    digest = f"{file.name} {file.sha256[:_DIGITS]}"
    if file.data.startswith(b"# %ECSV") and _is_refreshed(file.data):
        from catalogs.archives import parse_refreshed

        table, meta = parse_refreshed(file.data.decode("utf-8", "replace"), file.name)
        whole = int(meta["counts"]["stars"])
        part = f"{file.name} has {len(table)} stars of the {whole} that it was written with"
        notes = () if len(table) == whole else (part,)
        tell(*notes)
        day, least = str(meta["queried_utc"])[:10], float(meta["cuts"]["parallax_min_mas"])
        origin = f"SIMBAD of {day}{_elsewhere(str(meta.get('service', '')))}, {len(table)} stars ({digest})"
        sample = f"every FGK star of the table refreshed on {day} with parallax >= {least:g} mas"
        return Catalogue(with_updates(table), "refreshed", origin, sample, notes)
    raw = parse_table(file)
    made = user_table(raw, strict=strict)
    tell(*made.notes)
    stars = f"{len(made.table)} star{'s' * (len(made.table) != 1)}"
    origin, sample = f"{_USER_TABLE} of {stars} ({digest}{raw.shortened})", f"every star of {file.name}{raw.shortened}"
    return Catalogue(made.table, "file", origin, sample, made.notes)


def _elsewhere(service: str) -> str:
    """Name the machine that was asked where it is none of SIMBAD's own."""
    found = re.match(r"https?://([^/:?#]+)", service)
    host = found[1] if found else "an unknown service"
    return "" if host.startswith("simbad.") else f" as {host} has it"


def _is_refreshed(data: bytes) -> bool:
    from catalogs.archives import FORMATS

    header = [line for line in data.splitlines() if line.startswith(b"#")]
    return any(line.lstrip(b"# -{").startswith(FORMATS["simbad"].encode()) for line in header)


class TableReading(Record):
    """The meaning of a file as a table of one kind.

    Parameters
    ----------
    kind : {"stars", "planets"}
    file : str
        Its name.
    rows, usable : int
        Rows of the file, and those that can be used.
    uses : tuple of Use
        What each column is taken for.
    left_out : tuple of LeftOut
        Rows and cells that cannot be used.
    notes : tuple of str
        Remarks on the reading.
    """

    kind: TableKind
    file: str
    rows: int
    usable: int
    uses: tuple[Use, ...]
    left_out: tuple[LeftOut, ...]
    notes: tuple[str, ...]

    @property
    def reasons(self) -> list[tuple[LeftOut, int]]:
        """The first row or cell of each reason for which some are left out, and how many there are; most first."""
        return reasons(self.left_out)


def table_readings(source: str | Path, kind: TableKind | None = None, *, strict: bool = False) -> list[TableReading]:
    """Return what a file is taken for: as a table of stars, of planets, or of both where both can be read from it.

    Parameters
    ----------
    source : str or Path
    kind : {"stars", "planets"}, optional
        Which of the two it is; by default each that it can be.
    strict : bool
        Refuse it for the first row or cell that cannot be used.

    Raises
    ------
    InputError
        If it is neither: why it is none of the kind of which it has more columns.
    """
    raw = parse_table(read_bytes(source, key="file", presets=""))
    made, refused = [], []
    for one in get_args(TableKind) if kind is None else (kind,):
        with tables_read(apart=True):
            try:
                made.append(_reading(raw, one, strict=False))
            except InputError as error:
                refused.append((_known_headings(raw, one), error))
    if not made:
        raise max(refused, key=lambda item: item[0])[1]
    if strict:
        for reading in made:
            _reading(raw, reading.kind, strict=True)
    return made


def possible_columns(kind: TableKind) -> tuple[Columns, Groups]:
    """Return the columns that a table of a kind may have, and groups of those of which it needs one each.

    Parameters
    ----------
    kind : {"stars", "planets"}
    """
    if kind == "stars":
        return QUANTITIES, STARS_REQUIRED
    return PLANET_COLUMNS, PLANETS_REQUIRED


def _known_headings(raw: RawTable, kind: TableKind) -> int:
    """Return how many headings of a file are known in tables of a kind."""
    columns, known = possible_columns(kind)[0], 0
    for column in raw.columns:
        with contextlib.suppress(InputError):
            known += columns.meant_by(column.heading).column is not None
    return known


def _reading(raw: RawTable, kind: TableKind, *, strict: bool) -> TableReading:
    if kind == "stars":
        made = user_table(raw, strict=strict)
        return TableReading(kind, raw.name, len(raw), len(made.table), made.uses, made.left_out, made.notes)
    _, given = own_rows(raw, strict=strict)
    left_out = tuple(given.left_out)
    return TableReading(kind, raw.name, len(raw), len(given.rows), given.uses, left_out, given.remarks())
