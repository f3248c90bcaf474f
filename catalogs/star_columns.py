"""The columns of a star table, in the order of the shipped file, and what a user's own table may call them.

Words of the column ``quality_flags``: what each means, and those that type, name and parallax call for.
"""

import math
import re

from catalogs.spectral_types import is_composite, luminosity_class
from catalogs.stellar_physics import is_giant
from catalogs.table_cells import Column, Columns, columns_of, synonyms_of

COLUMNS: tuple[Column, ...] = columns_of("stars", without="not_shipped")
"""Columns of a star table, in the order of the shipped file."""
QUANTITIES = Columns(*columns_of("stars", only="own"), synonyms=lambda: synonyms_of("stars"))
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
