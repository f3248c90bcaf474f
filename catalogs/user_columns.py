"""What the columns of a user's star table may be called, their units and the ranges that are believed."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

__all__ = ["QUANTITIES", "Quantity", "heading", "quantity_among", "quantity_of"]


@dataclass(frozen=True)
class Quantity:
    """One quantity that a table may give.

    Parameters
    ----------
    name : str
        Its name here, which is always accepted as a heading.
    aliases : tuple of str
        Other headings, as reduced by :func:`heading`.
    kind : {"text", "number", "flag", "hip"}
        How cells are read.
    unit : str
        Unit in which it is kept (astropy's spelling); of a column that names none, the unit that is assumed.
    low, high : float
        Range that is believed, inclusive.
    """

    name: str
    aliases: tuple[str, ...] = ()
    kind: str = "number"
    unit: str = ""
    low: float = 0.0
    high: float = 0.0

    @property
    def allowed(self) -> str:
        """The range in words."""
        return f"{self.low:g} to {self.high:g} {self.unit}".strip()


def heading(text: str) -> str:
    """Reduce a column heading to its letters and digits, lower case: ``Sp_Type``, ``sp type``, ``SpType`` are one."""
    return re.sub(r"[^a-z0-9]", "", text.lower())


_ALL = (
    Quantity(
        "name",
        (
            "star",
            "starname",
            "target",
            "targetname",
            "object",
            "objectname",
            "mainid",
            "identifier",
            "designation",
            "hostname",
        ),
        "text",
    ),
    Quantity("hip", ("hipnumber", "hipno", "hipname"), "hip"),
    Quantity("hd", ("hdnumber", "hdname"), "text"),
    Quantity("gj", ("gjnumber", "gjname"), "text"),
    Quantity("bayer", (), "text"),
    Quantity("flamsteed", (), "text"),
    Quantity("common_name", ("propername",), "text"),
    Quantity("simbad_id", (), "text"),
    Quantity("ra_deg", ("ra", "raj2000", "raicrs", "rightascension"), unit="deg", low=0.0, high=360.0),
    Quantity(
        "dec_deg",
        ("dec", "de", "decj2000", "dej2000", "decicrs", "deicrs", "declination"),
        unit="deg",
        low=-90.0,
        high=90.0,
    ),
    Quantity("pm_ra_mas_yr", ("pmra", "pmracosdec", "sypmra"), unit="mas / yr", low=-20000.0, high=20000.0),
    Quantity("pm_dec_mas_yr", ("pmdec", "pmde", "sypmdec"), unit="mas / yr", low=-20000.0, high=20000.0),
    Quantity(
        "rv_km_s",
        ("rv", "radvel", "radialvelocity", "rvzradvel", "strv", "rvvalue"),
        unit="km / s",
        low=-2000.0,
        high=2000.0,
    ),
    Quantity("parallax_mas", ("parallax", "plx", "plxvalue", "syplx"), unit="mas", low=1e-2, high=1e5),
    Quantity(
        "parallax_err_mas",
        ("parallaxerr", "parallaxerror", "plxerr", "plxerror", "eplx"),
        unit="mas",
        low=1e-6,
        high=1e5,
    ),
    Quantity("distance_pc", ("distance", "dist", "d", "dpc", "distpc", "sydist"), unit="pc", low=1e-2, high=1e5),
    Quantity(
        "v_mag",
        ("v", "magv", "vmagnitude", "johnsonv", "fluxv", "syvmag", "vj"),
        unit="mag",
        low=-30.0,
        high=30.0,
    ),
    Quantity("b_v_mag", ("bv", "bminusv", "colorbv", "colourbv"), unit="mag", low=-1.0, high=5.0),
    Quantity("sp_type", ("spt", "sp", "spectraltype", "spectype", "stspectype", "mktype"), "text"),
    Quantity(
        "teff_k",
        ("teff", "effectivetemperature", "temperature", "stteff", "teffgspphot"),
        unit="K",
        low=2000.0,
        high=50000.0,
    ),
    Quantity("log_g", ("loggcgs", "surfacegravity", "stlogg"), unit="dex(cm/s2)", low=-2.0, high=7.0),
    Quantity("metallicity", ("feh", "mh", "stmet", "stmetfe", "met"), unit="dex", low=-5.0, high=1.5),
    Quantity(
        "luminosity_lsun", ("luminosity", "lum", "lbol", "lumlsun", "lbollsun"), unit="solLum", low=1e-6, high=1e7
    ),
    Quantity("close_companion", ("binary", "isbinary"), "flag"),
    Quantity("companion_name", ("companion",), "text"),
    Quantity(
        "companion_sep_arcsec",
        ("companionsep", "companionseparation", "companionseparationarcsec"),
        unit="arcsec",
        low=1e-3,
        high=36000.0,
    ),
    Quantity("companion_pa_deg", ("companionpa",), unit="deg", low=-360.0, high=720.0),
    Quantity("companion_epoch_yr", ("companionepoch",), unit="yr", low=1600.0, high=2200.0),
    Quantity(
        "companion_delta_v_mag",
        ("companiondeltav", "companiondeltamag", "companiondmag"),
        unit="mag",
        low=-30.0,
        high=30.0,
    ),
    Quantity("companion_v_mag", ("companionv",), unit="mag", low=-30.0, high=40.0),
)

QUANTITIES: dict[str, Quantity] = {item.name: item for item in _ALL}
"""Every quantity by its name."""

_BY_HEADING = {form: item for item in _ALL for form in (heading(item.name), *item.aliases)}


def quantity_of(text: str) -> tuple[Quantity | None, str]:
    """Return the quantity that a heading means and the unit written in it (``plx [mas]``), None if unknown."""
    return quantity_among(text, _BY_HEADING)


def quantity_among(text: str, by_heading: Mapping[str, Quantity]) -> tuple[Quantity | None, str]:
    """Return the same among other quantities, by their reduced headings."""
    if item := by_heading.get(heading(text)):
        return item, ""
    if found := re.fullmatch(r"\s*(.*\w.*?)\s*[\[(]([^\])]*)[\])]\s*", text):
        return by_heading.get(heading(found[1])), found[2].strip()
    return None, ""
