"""The columns of a star table, in the order of the shipped file, and what a user's own table may call them.

Words of the column ``quality_flags``: what each means, and those that type, name and parallax call for.
"""

import math
import re
from dataclasses import replace

from catalogs.spectral_types import is_composite, luminosity_class
from catalogs.stellar_physics import is_giant
from catalogs.table_cells import Column, Columns


def _float(name: str, unit: str, decimals: int, description: str) -> Column:
    return Column(name, description, "float", unit, decimals=decimals)


def _src(name: str, what: str) -> Column:
    return Column(f"{name}_src", f"origin of {what}: measured, derived:<how>, assumed:<what> or missing")


COLUMNS: tuple[Column, ...] = (
    Column("name", "unique name shown to people: Bayer, Flamsteed, HD, HIP or the SIMBAD identifier"),
    Column("simbad_id", "main identifier in the SIMBAD extract, white space normalised"),
    Column("hip", "Hipparcos number, 0 if none; the components of a close pair share it", "int"),
    Column("hd", "Henry Draper number, blank if not in the sources"),
    Column("gj", "Gliese-Jahreiss number, blank if not in the sources"),
    Column("bayer", "Bayer designation in SIMBAD's spelling, blank if none"),
    Column("flamsteed", "Flamsteed designation, blank if none"),
    Column("common_name", "proper name, blank if none"),
    Column("component", "component letter within its system, blank if the source gives none"),
    _src("component", "the component letter"),
    _float("ra_deg", "deg", 7, "right ascension, ICRS, at epoch_yr"),
    _float("dec_deg", "deg", 7, "declination, ICRS, at epoch_yr"),
    _float("epoch_yr", "yr", 1, "Julian epoch of the position"),
    _float("pm_ra_mas_yr", "mas/yr", 2, "proper motion in right ascension, with the factor cos(dec)"),
    _float("pm_dec_mas_yr", "mas/yr", 2, "proper motion in declination"),
    _src("pm", "the proper motion"),
    _float("parallax_mas", "mas", 2, "adopted parallax; bound pairs share the better one"),
    _float("parallax_err_mas", "mas", 2, "its standard error"),
    _src("parallax", "the adopted parallax; shared:<name> when it is a companion's"),
    _src("parallax_err", "its standard error"),
    _float("parallax_own_mas", "mas", 2, "the star's own parallax in the SIMBAD extract"),
    _float("distance_pc", "pc", 4, "1000 / parallax_mas"),
    _src("distance_pc", "the distance"),
    _float("rv_km_s", "km/s", 2, "radial velocity, positive when receding"),
    _src("rv_km_s", "the radial velocity"),
    _float("v_mag", "mag", 3, "Johnson V"),
    _src("v_mag", "the V magnitude"),
    _float("b_v_mag", "mag", 3, "Johnson B-V"),
    _src("b_v_mag", "the colour"),
    Column("sp_type", "spectral type of the SIMBAD extract, white space normalised"),
    Column("spectral_class", "first letter of sp_type: F, G or K"),
    Column("luminosity_class", "V, IV-V, IV, III-IV, III, II or I read from sp_type, blank if it has none"),
    _float("teff_k", "K", 0, "effective temperature"),
    _src("teff_k", "the temperature"),
    _float("log_g", "dex(cm/s2)", 2, "surface gravity"),
    _src("log_g", "the gravity"),
    _float("metallicity", "dex", 2, "[Fe/H]"),
    _src("metallicity", "the metallicity"),
    _float("luminosity_lsun", "Lsun", 4, "bolometric luminosity at distance_pc"),
    _src("luminosity_lsun", "the luminosity"),
    _float("radius_rsun", "Rsun", 3, "radius from luminosity_lsun and teff_k"),
    _src("radius_rsun", "the radius"),
    _float("mass_msun", "Msun", 3, "mass"),
    _src("mass_msun", "the mass"),
    _float("ecliptic_lon_deg", "deg", 5, "ecliptic longitude, mean ecliptic and equinox J2000"),
    _float("ecliptic_lat_deg", "deg", 5, "ecliptic latitude, mean ecliptic and equinox J2000"),
    _src("ecliptic", "the ecliptic coordinates"),
    Column("close_companion", "1 if the SIMBAD extract flags a close companion (BINARY_CUT), else 0", "bool"),
    Column("companion_name", "the companion with the largest flux over squared separation, blank if none known"),
    _float("companion_sep_arcsec", "arcsec", 2, "its separation"),
    _float("companion_pa_deg", "deg", 1, "its position angle, east of north, as seen from this star"),
    _float("companion_epoch_yr", "yr", 2, "epoch of separation and position angle; orbital motion is not modelled"),
    _float("companion_delta_v_mag", "mag", 2, "companion V minus this star's V"),
    _src("companion", "the companion's name and separation; missing where none is known"),
    _src("companion_pa", "the companion's position angle and epoch"),
    _src("companion_delta_v", "the magnitude difference"),
    Column("quality_flags", "words joined by ';', see the list in stars_columns.json"),
)

_BY_NAME = {column.name: column for column in COLUMNS}


BRIGHTEST_V_MAG = -1.5
"""V that no star is brighter than, mag: Sirius has -1.46."""


def _given(name: str, aliases: str = "", low: float = 0.0, high: float = 0.0) -> Column:
    """Return a column as a user's own table may give it: what people call it, and the range that is believed."""
    return replace(_BY_NAME[name], aliases=aliases, low=low, high=high, fills=True)


PAIRS = (("ra_deg", "dec_deg"), ("pm_ra_mas_yr", "pm_dec_mas_yr"))
"""Columns of which a table has both or neither."""
QUANTITIES = Columns(
    _given("name", "star starname target targetname object objectname mainid identifier designation hostname"),
    _given("hip", "hipnumber hipno hipname", 1.0, 120404.0),
    _given("hd", "hdnumber hdname"),
    _given("gj", "gjnumber gjname"),
    _given("bayer"),
    _given("flamsteed"),
    _given("common_name", "propername"),
    _given("simbad_id"),
    _given("ra_deg", "ra raj2000 raicrs rightascension radegrees RAd", 0.0, 360.0),
    _given(
        "dec_deg", "dec de decj2000 dej2000 decicrs deicrs declination dedeg decdegrees dedegrees decd", -90.0, 90.0
    ),
    _given("pm_ra_mas_yr", "pmra pmracosdec sypmra", -11000.0, 11000.0),
    _given("pm_dec_mas_yr", "pmdec pmde sypmdec", -11000.0, 11000.0),
    _given("rv_km_s", "rv radvel radialvelocity rvzradvel strv rvvalue", -900.0, 900.0),
    _given("parallax_mas", "parallax plx plxvalue syplx", 0.01, 1000.0),
    _given("parallax_err_mas", "parallaxerr parallaxerror plxerr plxerror eplx", 1e-6, 1e5),
    _given("distance_pc", "distance dist d dpc distpc sydist", 1.0, 1e5),
    _given("v_mag", "v magv vmagnitude johnsonv fluxv syvmag vj", BRIGHTEST_V_MAG, 25.0),
    _given("b_v_mag", "bv bminusv colorbv colourbv", -0.5, 5.0),
    _given("sp_type", "spt sp spectraltype spectype stspectype mktype"),
    _given("teff_k", "teff effectivetemperature temperature stteff teffgspphot", 2000.0, 50000.0),
    _given("log_g", "loggcgs surfacegravity stlogg", -0.9, 7.0),
    _given("metallicity", "feh mh stmet stmetfe met", -5.0, 1.5),
    _given("luminosity_lsun", "luminosity lum lbol lumlsun lbollsun", 1e-6, 1e7),
    _given("close_companion", "binary isbinary"),
    _given("companion_name", "companion"),
    _given("companion_sep_arcsec", "companionsep companionseparation companionseparationarcsec", 0.001, 36000.0),
    _given("companion_pa_deg", "companionpa", -360.0, 720.0),
    _given("companion_epoch_yr", "companionepoch", 1600.0, 2200.0),
    _given("companion_delta_v_mag", "companiondeltav companiondeltamag companiondmag", -30.0, 30.0),
    Column("companion_v_mag", "V of the companion", "float", "mag", "companionv", BRIGHTEST_V_MAG, 40.0, fills=True),
)
"""Every column that a user's table may give, by its name."""


#: Words of the column quality_flags in the shipped table.
FLAGS: dict[str, str] = {
    "colour_outlier": "B-V of the extract contradicts the spectral type; the subtype's median is used",
    "composite": "entry is the blended light of components that have no entry of their own",
    "composite_spectrum": "spectral type names more than one star",
    "double_entry": "SIMBAD object type is a double or multiple star",
    "giant": "luminosity class III-IV or brighter",
    "low_parallax_snr": "adopted parallax is below 50 times its error",
    "no_class": "spectral type has no luminosity class",
    "no_hip": "no Hipparcos number in the sources",
    "parallax_unknown_error": "no source gives an error of the parallax",
    "peculiar": "spectral type marked p or m",
    "rv_unknown": "radial velocity not known, 0 assumed",
    "shared_parallax": "member of a bound system whose members take one parallax",
    "spectroscopic_binary": "SIMBAD object type is a spectroscopic, eclipsing or ellipsoidal binary",
    "teff_conflict": "ExoCat-1 temperature contradicts the spectral type and was not used",
    "teff_disagreement": "an estimate from B-V, V-Ks, spectral type or publications is over 200 K from teff_k",
    "v_conflict": "V differs by more than 0.15 mag between the extract and ExoCat-1, often another blend",
    "variable": "SIMBAD object type or identifier of a variable star",
}

#: Words that only refreshed tables and tables of a user's own have.
ADDED_FLAGS: dict[str, str] = {
    "companions_not_listed": "the table does not say whether the star has a companion: none is counted",
    "companions_not_searched": "not in the snapshot: companions fainter than the query's limit are not known",
    "distance_assumed": "no distance is given, 10 pc assumed",
    "distance_conflict": "the table's distance and parallax differ by more than 5 %; the distance is used",
    "luminosity_conflict": "V, distance and temperature give a radius that the type or gravity contradicts by 1.5 dex",
    "luminosity_extrapolated": "luminosity from V below 3500 K, where the bolometric correction makes it too high",
    "position_unknown": "the table gives no position on the sky",
    "stellar_grid_clamped": "temperature, gravity or metallicity clamped to the edge of the spectral grid",
}

_LOW_PARALLAX_SNR = 50.0
# SIMBAD's codes of object types.
_VARIABLE_TYPES = "V* V*? BY* RS* dS* gD* Fl* Er* Pu* TT* BS* a2* Ce* LP* El* Ro* WU* Al* EB*"
_BINARY_TYPES = "SB* El* WU* EB*"


def type_flags(sp_type: str, object_type: str, simbad_id: str) -> set[str]:
    """Return the flags that spectral type, SIMBAD object type (old or new code) and identifier call for.

    Parameters
    ----------
    sp_type : str
        Spectral type.
    object_type : str
        SIMBAD's code of the type of object, "" if unknown.
    simbad_id : str
        SIMBAD's main identifier.
    """
    checks = {
        "giant": is_giant(sp_type),
        "no_class": not luminosity_class(sp_type),
        "composite_spectrum": is_composite(sp_type),
        "peculiar": bool(re.search(r"p|m", sp_type[1:])),
        "variable": object_type in _VARIABLE_TYPES.split() or simbad_id.startswith("V*"),
        "spectroscopic_binary": object_type in _BINARY_TYPES.split(),
        "double_entry": object_type == "**",
    }
    return {name for name, applies in checks.items() if applies}


def parallax_flags(parallax_mas: float, parallax_err_mas: float) -> set[str]:
    """Return the flags that a parallax and its error (nan if unknown) call for.

    Parameters
    ----------
    parallax_mas, parallax_err_mas : float
        Parallax and its standard error, mas; nan if unknown.
    """
    if not math.isfinite(parallax_err_mas):
        return {"parallax_unknown_error"}
    low = parallax_err_mas > 0.0 and parallax_mas / parallax_err_mas < _LOW_PARALLAX_SNR
    return {"low_parallax_snr"} if low else set()
