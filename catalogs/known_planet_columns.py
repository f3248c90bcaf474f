"""The columns of a table of known planets: names, units, ranges, what archives call them, and what a row lacks.

The shipped tables and a user's own have the same columns. Names of the NASA Exoplanet Archive are accepted as headings.
"""

import functools
import html
import math
import re
from collections.abc import Mapping

from catalogs.shipped import shipped_rows, shipped_words
from catalogs.table_cells import Columns, columns_of
from cpic_core import InputError

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
"""What each flag means."""
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
