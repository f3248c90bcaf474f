"""The columns of a star table, in the order of the shipped file, and what a user's own table may call them.

Words of the column ``quality_flags``: what each means, and those that type, name and parallax call for.
"""

import functools
import math
import re

from catalogs.shipped import shipped_words
from catalogs.spectral_types import is_composite, luminosity_class
from catalogs.stellar_physics import is_giant
from catalogs.table_cells import Column, Columns, columns_of

COLUMNS: tuple[Column, ...] = columns_of("stars", without="not_shipped")
"""Columns of a star table, in the order of the shipped file."""
QUANTITIES = Columns(*columns_of("stars", only="own"), table="stars")
"""Every column that a user's table may give, by its name."""

FLAGS = shipped_words("star_flags", "shipped")
"""Words of the column quality_flags in the shipped table, and what each means."""
ADDED_FLAGS = shipped_words("star_flags", "added")
"""Words that only refreshed tables and tables of a user's own have."""

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
        "variable": object_type in _VARIABLE_TYPES.split() or simbad_id.startswith("V*"),
        "spectroscopic_binary": object_type in _BINARY_TYPES.split(),
        "double_entry": object_type == "**",
    }
    return {name for name, applies in checks.items() if applies}.union(_type_flags(sp_type))


@functools.lru_cache(maxsize=10_000)
def _type_flags(sp_type: str) -> frozenset[str]:
    """Return the flags that a spectral type calls for; a table has few types and many stars."""
    checks = {
        "giant": is_giant(sp_type),
        "no_class": not luminosity_class(sp_type),
        "composite_spectrum": is_composite(sp_type),
        "peculiar": bool(re.search(r"p|m", sp_type[1:])),
    }
    return frozenset(name for name, applies in checks.items() if applies)


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
