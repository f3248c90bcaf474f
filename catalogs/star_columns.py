"""The columns of a star table: name, unit, kind, decimals, description. The order here is the order of the file."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["COLUMNS", "Column"]


@dataclass(frozen=True)
class Column:
    """One column; `kind` is ``text``, ``int``, ``bool`` or ``float`` (with `decimals` digits written)."""

    name: str
    unit: str
    kind: str
    description: str
    decimals: int = 0


def _src(name: str, what: str) -> Column:
    return Column(f"{name}_src", "", "text", f"origin of {what}: measured, derived:<how>, assumed:<what> or missing")


COLUMNS: tuple[Column, ...] = (
    Column("name", "", "text", "unique name shown to people: Bayer, Flamsteed, HD, HIP or the SIMBAD identifier"),
    Column("simbad_id", "", "text", "main identifier in the SIMBAD extract, white space normalised"),
    Column("hip", "", "int", "Hipparcos number, 0 if none; the components of a close pair share it"),
    Column("hd", "", "text", "Henry Draper number, blank if not in the sources"),
    Column("gj", "", "text", "Gliese-Jahreiss number, blank if not in the sources"),
    Column("bayer", "", "text", "Bayer designation in SIMBAD's spelling, blank if none"),
    Column("flamsteed", "", "text", "Flamsteed designation, blank if none"),
    Column("common_name", "", "text", "proper name, blank if none"),
    Column("component", "", "text", "component letter within its system, blank if the source gives none"),
    _src("component", "the component letter"),
    Column("ra_deg", "deg", "float", "right ascension, ICRS, at epoch_yr", 7),
    Column("dec_deg", "deg", "float", "declination, ICRS, at epoch_yr", 7),
    Column("epoch_yr", "yr", "float", "Julian epoch of the position", 1),
    Column("pm_ra_mas_yr", "mas/yr", "float", "proper motion in right ascension, with the factor cos(dec)", 2),
    Column("pm_dec_mas_yr", "mas/yr", "float", "proper motion in declination", 2),
    _src("pm", "the proper motion"),
    Column("parallax_mas", "mas", "float", "adopted parallax; bound pairs share the better one", 2),
    Column("parallax_err_mas", "mas", "float", "its standard error (Hipparcos-2)", 2),
    _src("parallax", "the adopted parallax; shared:<name> when it is a companion's"),
    _src("parallax_err", "its standard error"),
    Column("parallax_own_mas", "mas", "float", "the star's own parallax in the SIMBAD extract", 2),
    Column("distance_pc", "pc", "float", "1000 / parallax_mas", 4),
    _src("distance_pc", "the distance"),
    Column("rv_km_s", "km/s", "float", "radial velocity, positive when receding", 2),
    _src("rv_km_s", "the radial velocity"),
    Column("v_mag", "mag", "float", "Johnson V", 3),
    _src("v_mag", "the V magnitude"),
    Column("b_v_mag", "mag", "float", "Johnson B-V", 3),
    _src("b_v_mag", "the colour"),
    Column("sp_type", "", "text", "spectral type of the SIMBAD extract, white space normalised"),
    Column("spectral_class", "", "text", "first letter of sp_type: F, G or K"),
    Column(
        "luminosity_class",
        "",
        "text",
        "V, IV-V, IV, III-IV, III, II or I read from sp_type, blank if it has none",
    ),
    Column("teff_k", "K", "float", "effective temperature", 0),
    _src("teff_k", "the temperature"),
    Column("log_g", "dex(cm/s2)", "float", "surface gravity", 2),
    _src("log_g", "the gravity"),
    Column("metallicity", "dex", "float", "[Fe/H]", 2),
    _src("metallicity", "the metallicity"),
    Column("luminosity_lsun", "Lsun", "float", "bolometric luminosity at distance_pc", 4),
    _src("luminosity_lsun", "the luminosity"),
    Column("radius_rsun", "Rsun", "float", "radius from luminosity_lsun and teff_k", 3),
    _src("radius_rsun", "the radius"),
    Column("mass_msun", "Msun", "float", "mass", 3),
    _src("mass_msun", "the mass"),
    Column("ecliptic_lon_deg", "deg", "float", "ecliptic longitude, mean ecliptic and equinox J2000", 5),
    Column("ecliptic_lat_deg", "deg", "float", "ecliptic latitude, mean ecliptic and equinox J2000", 5),
    _src("ecliptic", "the ecliptic coordinates"),
    Column("close_companion", "", "bool", "1 if the SIMBAD extract flags a close companion (BINARY_CUT), else 0"),
    Column(
        "companion_name",
        "",
        "text",
        "the companion with the largest flux over squared separation, blank if none known",
    ),
    Column("companion_sep_arcsec", "arcsec", "float", "its separation", 2),
    Column("companion_pa_deg", "deg", "float", "its position angle, east of north, as seen from this star", 1),
    Column(
        "companion_epoch_yr",
        "yr",
        "float",
        "epoch of separation and position angle; orbital motion is not modelled",
        2,
    ),
    Column("companion_delta_v_mag", "mag", "float", "companion V minus this star's V", 2),
    _src("companion", "the companion's name and separation; missing where none is known"),
    _src("companion_pa", "the companion's position angle and epoch"),
    _src("companion_delta_v", "the magnitude difference"),
    Column("quality_flags", "", "text", "words joined by ';', see the list in stars_columns.json"),
)
