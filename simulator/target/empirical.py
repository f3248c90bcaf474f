"""Measured spectra by spectral type: the library of Pickles 1998."""

from __future__ import annotations

import numpy as np

from catalogs.errors import InputError
from catalogs.spectra import SpectralLibrary, load_pickles
from catalogs.spectral_types import parse_spectral_type

__all__ = ["library_photlam"]

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
    share = wanted.luminosity_rank - low
    for rank, part in ((low, 1.0 - share), (low + 1, share)):
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
    share = (position - places[left]) / gap
    if 0.0 < share < 1.0 and gap > _WIDEST_GAP:
        raise InputError(
            "spectral_type",
            spectral_type,
            allowed=f"types nearer to a template than between {_name(places[left], rank)} and "
            f"{_name(places[left + 1], rank)}",
        )
    weights[rows[left]] += part * (1.0 - share)
    weights[rows[left + 1]] += part * share


def _name(position: float, rank: int) -> str:
    letter, subclass = divmod(float(position), 10.0)
    return f"{_LETTERS[int(letter)]}{subclass:g}{_CLASSES[rank]}"
