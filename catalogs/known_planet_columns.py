"""The columns of a table of known planets: names, units, ranges, what archives call them, and what a row lacks.

The shipped tables and a user's own have the same columns. Names of the NASA Exoplanet Archive are accepted as headings.
"""

import html
import math
import re
from collections.abc import Mapping

from catalogs.table_cells import Column, Columns
from cpic_core import InputError


def _text(name: str, aliases: str, description: str) -> Column:
    return Column(name, description, aliases=aliases)


def _float(name: str, unit: str, believed: tuple[float, float], aliases: str, description: str) -> Column:
    return Column(name, description, "float", unit, aliases, *believed)


def _angle(name: str, aliases: str, description: str) -> Column:
    return Column(name, description, "float", "deg", aliases, -360.0, 720.0, fills=True)


def _date(name: str, aliases: str, description: str) -> Column:
    return _float(name, "d", (2.4e6, 2.5e6), aliases, description)


def _mass(name: str, aliases: str, description: str) -> Column:
    return _float(name, "jupiterMass", (1e-5, 1000.0), aliases, description)


def _error(name: str, unit: str, high: float, aliases: str) -> Column:
    return _float(name, unit, (0.0, high), aliases, "its error")


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
    _text("star", "hostname plhostname host starname", "name of the star"),
    _text("planet", "planetname plname name", "name of the planet, unique"),
    _text("discovery_method", "discoverymethod pldiscmethod method", "how it was found"),
    _float("period_days", "d", (0.01, 1e8), "period plorbper per p", "orbital period"),
    _error("period_err_days", "d", 1e8, "perr perioderr perioderror plorbpererr1"),
    _date(
        "periastron_jd", "tperiastron timeperiastron plorbtper tp tperi", "Julian date of a passage of the periastron"
    ),
    _error("periastron_err_days", "d", 1e6, "plorbtpererr1 tperr periastronerr"),
    _date(
        "conjunction_jd",
        "tconj tc pltranmid timeconjunction t0transit",
        "Julian date of an inferior conjunction, the planet between star and observer",
    ),
    _error("conjunction_err_days", "d", 1e6, "pltranmiderr1 tcerr tconjerr conjunctionerr"),
    _float("eccentricity", "", (0.0, 0.99), "ecc e plorbeccen", "eccentricity"),
    _error("eccentricity_err", "", 1.0, "eerr eccerr plorbeccenerr1"),
    _angle(
        "omega_star_deg",
        "omega plorblper omegastar argperi",
        "argument of periastron of the STAR's orbit, as radial velocities have it; the planet's is 180 deg more",
    ),
    _angle("omega_planet_deg", "omegaplanet", "the planet's own argument of periastron, instead of omega_star_deg"),
    _error("omega_err_deg", "deg", 360.0, "omegaerr omegastarerr plorblpererr1"),
    _float("semi_major_axis_au", "AU", (0.001, 1e5), "a sma semimajoraxis plorbsmax", "semi-major axis"),
    _error("semi_major_axis_err_au", "AU", 1e5, "aerr semimajoraxiserr plorbsmaxerr1"),
    _mass("mass_mjup", "mass plmassj m", "true mass"),
    _error("mass_err_mjup", "jupiterMass", 1000.0, "masserr plmassjerr1"),
    _mass("msini_mjup", "msini plmsinij minimummass", "minimum mass m sin i"),
    _error("msini_err_mjup", "jupiterMass", 1000.0, "msinierr plmsinijerr1"),
    _float(
        "inclination_deg",
        "deg",
        (0.0, 180.0),
        "inclination inc i plorbincl",
        "inclination of the orbit, 90 deg edge-on",
    ),
    _error("inclination_err_deg", "deg", 180.0, "ierr incerr inclinationerr plorbinclerr1"),
    _angle(
        "node_deg",
        "node bigomega ascendingnode Omega",
        "position angle of the node where the planet moves away from the observer, east of north",
    ),
    _error("node_err_deg", "deg", 360.0, "nodeerr Omegaerr"),
    _float("radius_rjup", "jupiterRad", (0.001, 10.0), "radius plradj rp", "radius"),
    _error("radius_err_rjup", "jupiterRad", 10.0, "radiuserr plradjerr1"),
    _float("star_mass_msun", "solMass", (0.01, 100.0), "starmass stmass", "mass of the star that the reference takes"),
    _error("star_mass_err_msun", "solMass", 100.0, "starmasserr stmasserr1"),
    _float(
        "solution_weight",
        "",
        (1e-3, 1e3),
        "weight",
        "weight of this orbit among the several published ones of its planet, each in a row of its own",
    ),
    _text("reference", "plrefname plorbitreference", "where the orbit was published"),
    _mass("best_mass_mjup", "plbmassj", "the archive's best mass, instead of mass_mjup and msini_mjup"),
    _error("best_mass_err_mjup", "jupiterMass", 1000.0, "plbmassjerr1"),
    _text("best_mass_kind", "plbmassprov", "what it is: Mass, Msini, Msin(i)/sin(i) or M-R relationship"),
    _float("best_mass_limit", "", (-1.0, 1.0), "plbmassjlim", "1 upper limit, -1 lower limit, 0 a value"),
    _float("eccentricity_limit", "", (-1.0, 1.0), "plorbeccenlim", "the same of the eccentricity"),
    _float("controversial", "", (0.0, 1.0), "plcontrovflag", "1 where the archive says so"),
    _text("flags", "remarks", "words joined by ';': what is missing, see the list of flags"),
    _text(
        "status",
        "planetstatus",
        "confirmed, controversial, candidate or refuted; candidates count only when asked for, refuted planets never",
    ),
    _text("status_reference", "", "where the status was published, if not where the orbit was"),
    _text("updated", "", "date on which the row was last changed"),
    _text("note", "", "a remark on the planet"),
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
_BEST = tuple(f"best_mass_{what}" for what in ("mjup", "err_mjup", "kind", "limit"))
INPUT_ONLY = ("omega_planet_deg", *_BEST, "eccentricity_limit", "controversial")
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
        raise InputError(f"{where} best_mass_kind", kind or "missing", allowed=", ".join(_KINDS))
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
