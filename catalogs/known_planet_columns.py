"""The columns of a table of known planets: names, units, ranges, what archives call them, and what a row lacks.

The shipped tables and a user's own have the same columns. Names of the NASA Exoplanet Archive are accepted as headings.
"""

import html
import math
import re
from collections.abc import Mapping

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
STATUSES: dict[str, str] = {
    "confirmed": "a planet that nobody disputes: counted",
    "controversial": "a published planet that later work doubts and does not exclude: counted",
    "candidate": "a signal that may be a planet: listed, counted only when asked for",
    "refuted": "a published planet that later work excludes: listed, not counted",
}
"""Meaning of each status."""
COUNTED = ("confirmed", "controversial")
"""Statuses of the planets that rankings, plans, what-ifs and scenes have; the others are only listed."""
CANDIDATE = "candidate"
"""Status of those that are counted as well when asked for."""

FLAGS: dict[str, str] = {
    "controversial": "the archive marks the planet as controversial; read as the status of that name",
    "earlier_orbit": "period, time, eccentricity and omega are of an earlier publication, which gives the time",
    "several_orbits": "several published orbits that disagree: each is drawn with its weight",
    "orbit_superseded": "a later publication has another orbit, outside the errors of this one: cpic known says which",
    "edge_on_assumed": "the source sets the inclination to 90 deg: its mass is m sin i, the inclination unknown",
    "mass_lower_limit": "the source gives the mass as a lower limit: taken as m sin i",
    "eccentricity_upper_limit": "the eccentricity is an upper limit",
    "mass_upper_limit": "the mass is an upper limit",
    "phase_unknown": "no time of periastron or conjunction, or in archives no error of time or period: phase unknown",
    "period_unknown": "no period: that of the semi-major axis around a star of its mass",
    "axis_unknown": "no semi-major axis: that of the period around a star of its mass",
    "eccentricity_unknown": "no eccentricity: drawn from those of long-period planets",
    "omega_unknown": "no argument of periastron: any",
    "minimum_mass": "m sin i alone is known",
    "mass_unknown": "neither mass nor m sin i",
    "inclination_unknown": "no inclination: any orientation of the orbit's pole",
    "radius_unknown": "no radius: that of the mass, with scatter",
    "period_err_unknown": "no error of the period: taken as exact",
    "time_err_unknown": "no error of the time of periastron or conjunction: taken as exact",
    "eccentricity_err_unknown": "no error of the eccentricity: taken as exact",
    "omega_err_unknown": "no error of omega: taken as exact",
    "axis_err_unknown": "no error of the semi-major axis: taken as exact",
    "mass_err_unknown": "no error of the mass or m sin i: taken as exact",
    "inclination_err_unknown": "no error of the inclination: taken as exact",
    "node_err_unknown": "no error of the node: taken as exact",
    "radius_err_unknown": "no error of the radius: taken as exact",
    "columns_not_used": "columns of the table were not used: what is unknown may stand in one of them",
}
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
