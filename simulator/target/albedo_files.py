"""Geometric albedos from a user's tables of wavelength and albedo; for grids see `simulator.target.albedo_grid`."""

from pathlib import Path

from catalogs import Albedo, read_curve
from cpic_core import InputError, at_home, read_file
from simulator.target.albedo_grid_file import LARGEST_ALBEDO, is_sqlite

_MAX_BYTES = 200_000_000


def read_albedo(path: str | Path, *, unit: str | None = None) -> Albedo:
    """Read a geometric albedo from a file with a column of wavelengths or wavenumbers and one of albedos.

    Text (columns apart by blanks, commas, semicolons or tabs; ``#`` begins a remark; the line above the numbers, or a
    remark there, may name the columns), ECSV, VOTable, FITS, and npz with such names as ``wavelength_nm`` and
    ``albedo``. What a file is, its content says. Rows may come in any order: over wavenumber, as in PICASO's output,
    they run down in wavelength. Where there are more than two columns, names choose.

    Parameters
    ----------
    path : str or Path
        The file.
    unit : str, optional
        ``nm``, ``um``, ``angstrom``, ``cm-1`` or what astropy reads as a unit of light's wavelength, frequency or
        energy; overrides the file. By default the unit is that of the column or its name (``wavelength_um``,
        ``Wavelength [micron]``; a ``wavenumber`` is in 1/cm); where there is none, numbers all below 20 are um, all
        within 100 to 3000 nm.

    Returns
    -------
    Albedo
        Increasing wavelengths in nm; documented over all of them.

    Raises
    ------
    InputError
        If the file cannot be read, its columns or unit cannot be told, a row is broken, a wavelength is repeated, or
        an albedo is not within 0 to 2.
    """
    place = at_home(path)
    hint = "is it a grid of models? then give log10_mh and log10_fsed with it"
    allowed = "a text, CSV, ECSV, VOTable, FITS or npz file"
    data = read_file(path, key="albedo file", allowed=allowed, max_bytes=_MAX_BYTES, too_large=hint)
    if is_sqlite(data) or (data.startswith(b"PK") and b"allphotdata.npy" in data):
        hint = "this is a grid of models: give log10_mh and log10_fsed with it"
        raise InputError("albedo file", str(place), allowed="a table of wavelength and albedo", hint=hint)
    return Albedo(*read_curve(place.name, data, "albedo", unit=unit, most=LARGEST_ALBEDO, by_size=True)[:2])
