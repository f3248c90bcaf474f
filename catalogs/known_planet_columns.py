"""The columns of a table of known planets: names, units, ranges, what archives call them, and what a row lacks.

The shipped tables and a user's own have the same columns. Names of the NASA Exoplanet Archive are accepted as headings.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from catalogs.user_columns import Quantity, heading, quantity_among

__all__ = [
    "COLUMNS",
    "COUNTED",
    "DESCRIPTIONS",
    "FLAGS",
    "GIVEN_FLAGS",
    "INPUT_ONLY",
    "STANDING",
    "STATUSES",
    "flags_of",
    "planet_quantity_of",
]

_JD = (2.4e6, 2.5e6)


def _text(name: str, *aliases: str) -> Quantity:
    return Quantity(name, aliases, "text")


def _error(name: str, unit: str, high: float, *aliases: str) -> Quantity:
    return Quantity(name, aliases, unit=unit, low=0.0, high=high)


_ALL: tuple[tuple[Quantity, str], ...] = (
    (_text("star", "hostname", "plhostname", "host", "starname"), "name of the star"),
    (_text("planet", "planetname", "plname", "name"), "name of the planet, unique"),
    (_text("discovery_method", "discoverymethod", "pldiscmethod", "method"), "how it was found"),
    (
        Quantity("period_days", ("period", "plorbper", "per", "p"), unit="d", low=0.01, high=1e8),
        "orbital period",
    ),
    (_error("period_err_days", "d", 1e8, "perr", "perioderr", "perioderror", "plorbpererr1"), "its error"),
    (
        Quantity(
            "periastron_jd",
            ("tperiastron", "timeperiastron", "plorbtper", "tp", "tperi"),
            unit="d",
            low=_JD[0],
            high=_JD[1],
        ),
        "Julian date of a passage of the periastron",
    ),
    (_error("periastron_err_days", "d", 1e6, "plorbtpererr1", "tperr", "periastronerr"), "its error"),
    (
        Quantity(
            "conjunction_jd",
            ("tconj", "tc", "pltranmid", "timeconjunction", "t0transit"),
            unit="d",
            low=_JD[0],
            high=_JD[1],
        ),
        "Julian date of an inferior conjunction, the planet between star and observer",
    ),
    (_error("conjunction_err_days", "d", 1e6, "pltranmiderr1", "tcerr", "tconjerr", "conjunctionerr"), "its error"),
    (Quantity("eccentricity", ("ecc", "e", "plorbeccen"), low=0.0, high=0.99), "eccentricity"),
    (_error("eccentricity_err", "", 1.0, "eerr", "eccerr", "plorbeccenerr1"), "its error"),
    (
        Quantity("omega_star_deg", ("omega", "plorblper", "omegastar", "argperi"), unit="deg", low=-360.0, high=720.0),
        "argument of periastron of the STAR's orbit, as radial velocities have it; the planet's is 180 deg more",
    ),
    (
        Quantity("omega_planet_deg", ("omegaplanet",), unit="deg", low=-360.0, high=720.0),
        "the planet's own argument of periastron, instead of omega_star_deg",
    ),
    (_error("omega_err_deg", "deg", 360.0, "omegaerr", "omegastarerr", "plorblpererr1"), "its error"),
    (
        Quantity("semi_major_axis_au", ("a", "sma", "semimajoraxis", "plorbsmax"), unit="AU", low=1e-3, high=1e5),
        "semi-major axis",
    ),
    (_error("semi_major_axis_err_au", "AU", 1e5, "aerr", "semimajoraxiserr", "plorbsmaxerr1"), "its error"),
    (
        Quantity("mass_mjup", ("mass", "plmassj", "m"), unit="jupiterMass", low=1e-5, high=1e3),
        "true mass",
    ),
    (_error("mass_err_mjup", "jupiterMass", 1e3, "masserr", "plmassjerr1"), "its error"),
    (
        Quantity("msini_mjup", ("msini", "plmsinij", "minimummass"), unit="jupiterMass", low=1e-5, high=1e3),
        "minimum mass m sin i",
    ),
    (_error("msini_err_mjup", "jupiterMass", 1e3, "msinierr", "plmsinijerr1"), "its error"),
    (
        Quantity("inclination_deg", ("inclination", "inc", "i", "plorbincl"), unit="deg", low=0.0, high=180.0),
        "inclination of the orbit, 90 deg edge-on",
    ),
    (_error("inclination_err_deg", "deg", 180.0, "ierr", "incerr", "inclinationerr", "plorbinclerr1"), "its error"),
    (
        Quantity("node_deg", ("node", "bigomega", "ascendingnode"), unit="deg", low=-360.0, high=720.0),
        "position angle of the node where the planet moves away from the observer, east of north",
    ),
    (_error("node_err_deg", "deg", 360.0, "nodeerr"), "its error"),
    (
        Quantity("radius_rjup", ("radius", "plradj", "rp"), unit="jupiterRad", low=1e-3, high=10.0),
        "radius",
    ),
    (_error("radius_err_rjup", "jupiterRad", 10.0, "radiuserr", "plradjerr1"), "its error"),
    (
        Quantity("star_mass_msun", ("starmass", "stmass"), unit="solMass", low=0.01, high=100.0),
        "mass of the star that the reference takes",
    ),
    (_error("star_mass_err_msun", "solMass", 100.0, "starmasserr", "stmasserr1"), "its error"),
    (_text("reference", "plrefname", "plorbitreference"), "where the orbit was published"),
    (
        Quantity("best_mass_mjup", ("plbmassj",), unit="jupiterMass", low=1e-5, high=1e3),
        "the archive's best mass, instead of mass_mjup and msini_mjup",
    ),
    (_error("best_mass_err_mjup", "jupiterMass", 1e3, "plbmassjerr1"), "its error"),
    (_text("best_mass_kind", "plbmassprov"), "what it is: Mass, Msini, Msin(i)/sin(i) or M-R relationship"),
    (Quantity("best_mass_limit", ("plbmassjlim",), low=-1.0, high=1.0), "1 upper limit, -1 lower limit, 0 a value"),
    (Quantity("eccentricity_limit", ("plorbeccenlim",), low=-1.0, high=1.0), "the same of the eccentricity"),
    (Quantity("controversial", ("plcontrovflag",), low=0.0, high=1.0), "1 where the archive says so"),
    (_text("flags", "remarks"), "words joined by ';': what is missing, see the list of flags"),
    (
        _text("status", "planetstatus"),
        "confirmed, controversial, candidate or refuted; the last two are listed and never counted",
    ),
    (_text("status_reference"), "where the status was published, if not where the orbit was"),
    (_text("updated"), "date on which the row was last changed"),
    (_text("note"), "a remark on the planet"),
)

COLUMNS: dict[str, Quantity] = {item.name: item for item, _ in _ALL}
"""Every column by its name, in the order of the shipped file."""
STANDING = ("status", "status_reference", "updated", "note")
"""Columns that say how sure a planet is; the table of 2019 has none of them, and what is laid over it may."""
INPUT_ONLY = (
    "omega_planet_deg",
    "best_mass_mjup",
    "best_mass_err_mjup",
    "best_mass_kind",
    "best_mass_limit",
    "eccentricity_limit",
    "controversial",
)
"""Columns that a table of a user's own may have; reading turns them into the others."""
DESCRIPTIONS: dict[str, str] = {item.name: text for item, text in _ALL}
"""One line on each column."""

_BY_HEADING = {form: item for item in COLUMNS.values() for form in (heading(item.name), *item.aliases)}

STATUSES: dict[str, str] = {
    "confirmed": "a planet that nobody disputes: counted",
    "controversial": "a published planet that later work doubts and does not exclude: counted",
    "candidate": "a signal that may be a planet: listed, not counted",
    "refuted": "a published planet that later work excludes: listed, not counted",
}
"""Meaning of each status."""
COUNTED = ("confirmed", "controversial")
"""Statuses of the planets that rankings, plans, what-ifs and scenes have; the others are only listed."""

FLAGS: dict[str, str] = {
    "controversial": "the archive marks the planet as controversial; read as the status of that name",
    "earlier_orbit": "period, time, eccentricity and omega are of an earlier publication, which gives the time",
    "edge_on_assumed": "the source sets the inclination to 90 deg: its mass is m sin i, the inclination unknown",
    "mass_lower_limit": "the source gives the mass as a lower limit: taken as m sin i",
    "eccentricity_upper_limit": "the eccentricity is an upper limit",
    "mass_upper_limit": "the mass is an upper limit",
    "phase_unknown": "no time of periastron or conjunction, or no error of it or of the period: phase unknown",
    "period_unknown": "no period: that of the semi-major axis around a star of its mass",
    "axis_unknown": "no semi-major axis: that of the period around a star of its mass",
    "eccentricity_unknown": "no eccentricity: drawn from those of long-period planets",
    "omega_unknown": "no argument of periastron: any",
    "minimum_mass": "m sin i alone is known",
    "mass_unknown": "neither mass nor m sin i",
    "inclination_unknown": "no inclination: any orientation of the orbit's pole",
    "radius_unknown": "no radius: that of the mass, with scatter",
    "period_err_unknown": "no error of the period",
    "eccentricity_err_unknown": "no error of the eccentricity: taken as exact",
    "omega_err_unknown": "no error of omega: taken as exact",
    "axis_err_unknown": "no error of the semi-major axis: taken as exact",
    "mass_err_unknown": "no error of the mass or m sin i: taken as exact",
    "inclination_err_unknown": "no error of the inclination: taken as exact",
}
"""What each flag means."""

GIVEN_FLAGS = (
    "controversial",
    "earlier_orbit",
    "edge_on_assumed",
    "mass_lower_limit",
    "eccentricity_upper_limit",
    "mass_upper_limit",
)
"""Flags that a table states; the others follow from what is missing."""


def planet_quantity_of(text: str) -> tuple[Quantity | None, str]:
    """Return the column that a heading means and the unit written in it, None if unknown."""
    return quantity_among(text, _BY_HEADING)


def flags_of(row: Mapping[str, float], given: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Return the flags of one planet, in the order of `FLAGS`.

    Parameters
    ----------
    row : mapping of str to float
        Numbers by column; nan or absent where missing.
    given : tuple of str
        Flags that the table states.
    """

    def has(name: str) -> bool:
        return math.isfinite(row.get(name, math.nan))

    def lacks_error(name: str, error: str) -> bool:
        return has(name) and not has(error)

    dated = (has("periastron_jd") and has("periastron_err_days")) or (
        has("conjunction_jd") and has("conjunction_err_days")
    )
    mass = "mass" if has("mass_mjup") else "msini"
    limited = {name: f"{name}_upper_limit" in given for name in ("eccentricity", "mass")}
    found = {
        "phase_unknown": not (dated and has("period_days") and has("period_err_days")),
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
    }
    return tuple(name for name in FLAGS if name in given or found.get(name, False))
