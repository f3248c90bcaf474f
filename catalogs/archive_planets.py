"""How the NASA Exoplanet Archive says what a planet's numbers are: best masses, limits, assumed inclinations."""

from __future__ import annotations

import html
import re

from catalogs.errors import InputError

__all__ = ["reference_text", "settle"]

_KINDS = {"Mass": "mass", "Msin(i)/sin(i)": "mass", "Msini": "msini", "M-R relationship": ""}


def settle(numbers: dict[str, float], kind: str, where: str) -> tuple[dict[str, float], tuple[str, ...]]:
    """Turn the archive's best mass and its limits into columns of ours.

    Parameters
    ----------
    numbers : dict of str to float
        What a row gives, by column of `catalogs.known_planet_columns.COLUMNS`; errors above 0.
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
