"""The columns of a table of known planets: names, units, ranges, what archives call them, and what a row lacks.

The shipped tables and a user's own have the same columns. Names of the NASA Exoplanet Archive are accepted as headings.
"""

import html
import math
import re
from collections.abc import Mapping

from catalogs.shipped import shipped_words
from catalogs.table_cells import Columns, columns_of, synonyms_of
from cpic_core import InputError

LOOKALIKES: dict[str, tuple[str, tuple[str, ...]]] = {
    "period_days": (r"(?<!rot)(?<!rotation)period|orbper", ()),
    "msini_mjup": (r"sini|min(?:imum)?mass", ("best_mass_mjup",)),
    "best_mass_kind": (r"mass(?:detection|measurement)?(?:type|method|prov|kind)", ("msini_mjup",)),
    "semi_major_axis_au": (r"axis|orbsmax|^sma", ()),
    "eccentricity": (r"^ecc|orbecc", ()),
    "omega_star_deg": (r"^arg\w*p|^aop$|orblper|lon\w*peri|^w$", ("omega_planet_deg",)),
    "inclination_deg": (r"^incl?|orbincl", ()),
    "node_deg": (r"^raan$|^lan$|node", ()),
    "periastron_jd": (r"tper|time\w*peri", ("conjunction_jd",)),
    "conjunction_jd": (r"tconj|tranmid|time\w*conj", ("periastron_jd",)),
}
"""Headings that look like those of a column and are none of its names, and columns that say the same instead of it."""
COLUMNS = Columns(
    *columns_of("planets"),
    synonyms=lambda: synonyms_of("planets"),
    cased={
        "omega": "omega_star_deg, omega_planet_deg or node_deg",
        "omegaerr": "omega_err_deg or node_err_deg",
        "m": "mass_mjup, msini_mjup or star_mass_msun",
    },
)
"""Every column by its name, in the order of the shipped file."""
STANDING = ("status", "status_reference", "updated", "note")
"""Columns that say how sure a planet is."""
UPDATES_ONLY = ("solution_weight", *STANDING)
"""Columns that the table of 2019 does not have, and what is laid over it may."""
INPUT_ONLY = tuple(column.name for column in columns_of("planets", only="input"))
"""Columns that a table of a user's own may have; reading turns them into the others."""
STATUSES = shipped_words("status")
"""Meaning of each status."""
COUNTED = ("confirmed", "controversial")
"""Statuses of the planets that rankings, plans, what-ifs and scenes have; the others are only listed."""
CANDIDATE = "candidate"
"""Status of those that are counted as well when asked for."""

FLAGS = shipped_words("planet")
"""What each flag means."""

_LIMITS = ("mass_lower_limit", "eccentricity_upper_limit", "mass_upper_limit")
GIVEN_FLAGS = ("controversial", "earlier_orbit", "edge_on_assumed", *_LIMITS)
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

    def has(name: str) -> bool:
        return math.isfinite(row.get(name, math.nan))

    def lacks_error(name: str, error: str) -> bool:
        return has(name) and not has(error)

    times = [what for what in ("periastron", "conjunction") if has(f"{what}_jd")]
    dated = [what for what in times if exact or (has(f"{what}_err_days") and has("period_err_days"))]
    unsure = exact and times and not any(has(f"{what}_err_days") for what in times)
    mass = "mass" if has("mass_mjup") else "msini"
    limited = {name: f"{name}_upper_limit" in given for name in ("eccentricity", "mass")}
    found = {
        "phase_unknown": not (dated and has("period_days")),
        "period_unknown": not has("period_days"),
        "axis_unknown": not has("semi_major_axis_au"),
        "eccentricity_unknown": not has("eccentricity"),
        "omega_unknown": not has("omega_star_deg"),
        "minimum_mass": has("msini_mjup") and not has("mass_mjup"),
        "mass_unknown": not (has("msini_mjup") or has("mass_mjup")),
        "inclination_unknown": not has("inclination_deg"),
        "radius_unknown": not has("radius_rjup"),
        "period_err_unknown": lacks_error("period_days", "period_err_days"),
        "eccentricity_err_unknown": lacks_error("eccentricity", "eccentricity_err") and not limited["eccentricity"],
        "omega_err_unknown": lacks_error("omega_star_deg", "omega_err_deg"),
        "axis_err_unknown": lacks_error("semi_major_axis_au", "semi_major_axis_err_au"),
        "mass_err_unknown": lacks_error(f"{mass}_mjup", f"{mass}_err_mjup") and not limited["mass"],
        "inclination_err_unknown": lacks_error("inclination_deg", "inclination_err_deg"),
        "time_err_unknown": bool(unsure) and has("period_days"),
        "node_err_unknown": exact and lacks_error("node_deg", "node_err_deg"),
        "radius_err_unknown": exact and lacks_error("radius_rjup", "radius_err_rjup"),
    }
    return tuple(name for name in FLAGS if name in given or found.get(name, False))


# How the archive says what a planet's numbers are: best masses, limits, assumed inclinations.
_KINDS = {"Mass": "mass", "Msin(i)/sin(i)": "mass", "Msini": "msini", "M-R relationship": ""}


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


def reference_text(link: str) -> str:
    """Return ``Benedict et al. 2006 (2006AJ....132.2206B)`` of a link to a bibliography; other text as it is."""
    words = " ".join(html.unescape(re.sub(r"<[^>]*>", " ", link)).split())
    bibcode = re.search(r"(?:bibcode=|abs/)([^\s>\"/]+)", link)
    code = html.unescape(bibcode[1]).replace("%26", "&") if bibcode else ""
    return f"{words} ({code})" if code else words
