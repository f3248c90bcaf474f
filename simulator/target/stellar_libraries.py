"""Measured spectra by spectral type: the library of Pickles 1998.

Spectra from a tree of stellar models on disk: CK04, Kurucz 1993, PHOENIX as STScI lays them out.

A tree is a folder with ``catalog.fits`` (extension 1: ``INDEX`` = "Teff,[M/H],log g", ``FILENAME`` =
"ckp00/ckp00_5000.fits[g45]") and the files that it names (columns ``WAVELENGTH`` in A and one surface flux in
erg/s/cm2/A per gravity). The catalogue is read once, a column of fluxes when it is first needed; both are read again
when their file changes.
"""

import functools
import os
import re
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from catalogs import SpectralLibrary, load_pickles, parse_spectral_type
from cpic_core import InputError, bounded_fits, open_file
from simulator.target.spectrum_table import photon_flux

_LETTERS = "OBAFGKM"
_CLASSES = {1: "I", 2: "II", 3: "III", 4: "IV", 5: "V"}
# Wider gaps, in subclasses, are not bridged.
_WIDEST_GAP = 8.0


def library_photlam(spectral_type: str) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Return the measured spectrum of a spectral type.

    A type between two templates of its luminosity class takes the mean of both, weighted by the distance in
    subclasses; a class such as IV-V the mean of the two classes.

    Parameters
    ----------
    spectral_type : str
        MK type, see `catalogs.spectral_types.parse_spectral_type`.

    Returns
    -------
    wavelength_nm, photlam : ndarray, shape (n,)
        300-1750 nm in steps of 1 nm; ph/s/cm2/A for V = 0.
    flags : tuple of str
        ``template_interpolated`` if it is not a template of the library.

    Raises
    ------
    InputError
        If the type cannot be read or the library has no template near it.
    """
    library = load_pickles()
    wanted = parse_spectral_type(spectral_type)
    weights = np.zeros(library.position.size)
    low = int(np.floor(wanted.luminosity_rank))
    fraction = wanted.luminosity_rank - low
    for rank, part in ((low, 1.0 - fraction), (low + 1, fraction)):
        if part > 0.0:
            _add(library, spectral_type, wanted.position, rank, part, weights)
    flags = () if np.count_nonzero(weights) == 1 else ("template_interpolated",)
    return library.wavelength_nm, weights @ library.photlam, flags


def _add(
    library: SpectralLibrary, spectral_type: str, position: float, rank: int, part: float, weights: np.ndarray
) -> None:
    """Add the weights of the templates of one luminosity class, their sum being `part`."""
    rows = np.flatnonzero(library.luminosity_rank == rank)
    rows = rows[np.argsort(library.position[rows])]
    places = library.position[rows]
    if not places[0] <= position <= places[-1]:
        ends = f"{_name(places[0], rank)} to {_name(places[-1], rank)}"
        raise InputError("spectral_type", spectral_type, allowed=f"{ends}, the templates of class {_CLASSES[rank]}")
    left = min(int(np.searchsorted(places, position, side="right")) - 1, places.size - 2)
    if position == places[left + 1]:
        left = min(left + 1, places.size - 2)
    gap = places[left + 1] - places[left]
    fraction = (position - places[left]) / gap
    if 0.0 < fraction < 1.0 and gap > _WIDEST_GAP:
        ends = f"{_name(places[left], rank)} and {_name(places[left + 1], rank)}"
        allowed = f"types nearer to a template than between {ends}"
        raise InputError("spectral_type", spectral_type, allowed=allowed)
    weights[rows[left]] += part * (1.0 - fraction)
    weights[rows[left + 1]] += part * fraction


def _name(position: float, rank: int) -> str:
    letter, subclass = divmod(float(position), 10.0)
    return f"{_LETTERS[int(letter)]}{subclass:g}{_CLASSES[rank]}"


#: Trees of STScI that are found by name under ``$PYSYN_CDBS/grid``.
TREE_NAMES = ("ck04models", "k93models", "phoenix")

_CATALOGUE = "catalog.fits"
_MAX_BYTES = 1_000_000_000
_FILE_AND_COLUMN = re.compile(r"\s*([^\[\]]+?)\s*\[\s*(\w+)\s*\]\s*")
_AXES = (("teff_k", "K"), ("metallicity", "dex"), ("log_g", "dex"))


@dataclass(frozen=True, eq=False)
class _Catalogue:
    """Teff, [M/H] and log g of each model, shape (n, 3), and the file and column that hold it."""

    parameters: np.ndarray
    places: tuple[tuple[str, str], ...]


def find_tree(path: str | os.PathLike[str]) -> Path:
    """Return the catalogue file of a tree.

    Parameters
    ----------
    path : str or Path
        The folder that holds ``catalog.fits``, or this file; or the root of reference data (``$PYSYN_CDBS``), with
        the grid's name after it if the root holds several: ``<root>/ck04models``. The bare names ``ck04models``,
        ``k93models`` and ``phoenix`` are looked up under ``$PYSYN_CDBS``.

    Raises
    ------
    InputError
        If there is none, or several.
    """
    place = Path(path)
    if str(path) in TREE_NAMES and not os.path.exists(place):
        root = os.environ.get("PYSYN_CDBS", "")
        if not root:
            raise InputError("model", str(path), allowed="the path of the tree", hint="or set PYSYN_CDBS to its root")
        place = Path(root) / place
    if place.name == _CATALOGUE and os.path.isfile(place):
        return place
    for file in (place / _CATALOGUE, place.parent / "grid" / place.name / _CATALOGUE):
        if os.path.isfile(file):
            return file
    found = sorted(place.glob(f"grid/*/{_CATALOGUE}")) if os.path.isdir(place) else []
    if len(found) > 1:
        names = ", ".join(file.parent.name for file in found)
        raise InputError("model", str(path), allowed=f"one of its trees: {names}", hint=f"such as {found[0].parent}")
    if not found:
        kind = f"a folder with {_CATALOGUE} or grid/*/{_CATALOGUE}"
        raise InputError(
            "model", str(path), allowed=kind if os.path.exists(place) else f"grid, blackbody, pickles, or {kind}"
        )
    return found[0]


def tree_photlam(
    path: str | os.PathLike[str], teff_k: float, log_g: float, metallicity: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the surface flux of a star, interpolated between the eight nearest models of a tree.

    Trilinear and linear in flux: over log g, then [M/H], then Teff (Zhu et al. 2025, section 2; stsynphot does the
    same). At a node of an axis no neighbour on that axis is needed.

    Parameters
    ----------
    path : str or Path
        See `find_tree`.
    teff_k, log_g, metallicity : float
        Parameters (K, dex of cm/s2, dex).

    Returns
    -------
    wavelength_nm, photlam : ndarray, shape (n,)
        The models' own wavelengths; ph/s/cm2/A of stellar surface.

    Raises
    ------
    InputError
        If there is no such tree, a parameter is outside it, one of the models is empty (all zero), or a file is
        missing or damaged.
    """
    file = find_tree(path)
    catalogue = _catalogue(str(file), *_stamp(file))
    asked = np.array([teff_k, metallicity, log_g])
    cells = _weights(catalogue, np.arange(len(catalogue.places)), asked, 0)
    spectra = [(_model(file.parent, catalogue, row), weight) for row, weight in cells]
    wavelength = spectra[0][0][0]
    if any(not np.array_equal(other, wavelength) for (other, _), _ in spectra):
        wavelength = np.unique(np.concatenate([other for (other, _), _ in spectra]))
    total = np.zeros_like(wavelength)
    for (own, flux), weight in spectra:
        total += weight * np.interp(wavelength, own, flux, left=0.0, right=0.0)
    return wavelength, total


def _weights(catalogue: _Catalogue, rows: np.ndarray, asked: np.ndarray, axis: int) -> list[tuple[int, float]]:
    """Return the models around the asked parameters and their weights, split along one axis after the other."""
    if axis == len(_AXES):
        return [(int(rows[0]), 1.0)]
    values, value = catalogue.parameters[rows, axis], float(asked[axis])
    if not values.min() <= value <= values.max():
        name, unit = _AXES[axis]
        where = "".join(f" at {key} {asked[i]:g}" for i, (key, _) in enumerate(_AXES[:axis]))
        raise InputError(name, value, unit=unit, allowed=f"{values.min():g} to {values.max():g}{where}")
    low, high = values[values <= value].max(), values[values >= value].min()
    fraction = (value - low) / (high - low) if high > low else 0.0
    ends = ((low, 1.0 - fraction), (high, fraction)) if high > low else ((low, 1.0),)
    sides = ((part, _weights(catalogue, rows[values == end], asked, axis + 1)) for end, part in ends)
    return [(row, weight * part) for part, side in sides for row, weight in side]


def _model(folder: Path, catalogue: _Catalogue, row: int) -> tuple[np.ndarray, np.ndarray]:
    name, column = catalogue.places[row]
    file = folder.joinpath(*name.split("/"))
    try:
        stamp = _stamp(file)
    except OSError as error:
        raise InputError("model file", str(file), allowed="a readable file", hint=error.strerror or "") from None
    wavelength, flux = _column(str(file), *stamp, column)
    if not flux.any():
        teff, metallicity, log_g = catalogue.parameters[row]
        cell, hint = f"Teff {teff:g} K, log g {log_g:g}, [M/H] {metallicity:g}", f"{name}[{column}] is all zero"
        raise InputError("model cell", cell, allowed="models that exist", hint=hint)
    return wavelength, flux


def _stamp(file: Path) -> tuple[int, int]:
    status = file.stat()
    return status.st_mtime_ns, status.st_size


@functools.lru_cache(maxsize=8)
def _catalogue(path: str, mtime_ns: int, size: int) -> _Catalogue:
    rows = _table(path, ("INDEX", "FILENAME"))
    parameters, places = [], []
    for index, name in zip(rows["INDEX"], rows["FILENAME"], strict=True):
        found = _FILE_AND_COLUMN.fullmatch(str(name))
        try:
            numbers = [float(word) for word in str(index).split(",")]
        except ValueError:
            numbers = []
        if not found or len(numbers) != len(_AXES) or not np.all(np.isfinite(numbers)):
            raise InputError(path, f"{index} {name}", allowed='"Teff,[M/H],log g" and "file.fits[column]"')
        parameters.append(numbers)
        places.append((found[1], found[2]))
    if not places:
        raise InputError(path, "no rows", allowed="at least one model")
    return _Catalogue(np.array(parameters), tuple(places))


@functools.lru_cache(maxsize=128)
def _column(path: str, mtime_ns: int, size: int, column: str) -> tuple[np.ndarray, np.ndarray]:
    rows = _table(path, ("WAVELENGTH", column))
    wavelength_nm = np.array(rows["WAVELENGTH"], dtype=np.float64) / 10.0
    spectrum = photon_flux(Path(path).name, wavelength_nm, np.array(rows[column], dtype=np.float64), "flam")
    for array in (spectrum.wavelength_nm, spectrum.photlam):
        array.setflags(write=False)
    return spectrum.wavelength_nm, spectrum.photlam


def _table(path: str, columns: tuple[str, str]) -> dict[str, Any]:
    """Return two columns of the first table extension."""
    from astropy.io import fits

    wanted = f"a table with columns {' and '.join(columns)}"
    try:
        with warnings.catch_warnings():
            # STScI files carry unit and display cards that FITS does not know; they do not touch the data.
            warnings.simplefilter("ignore")
            with (
                open_file(path, key="model file", allowed=wanted, max_bytes=_MAX_BYTES) as file,
                fits.open(bounded_fits(file)) as hdus,
            ):
                table = hdus[1].data
                return {name: np.array(table[name]) for name in columns}
    except InputError:
        raise
    except (OSError, KeyError, IndexError, TypeError, ValueError) as error:
        hint = f"{type(error).__name__}: {error}"[:160]
        raise InputError("model file", path, allowed=wanted, hint=hint) from None
