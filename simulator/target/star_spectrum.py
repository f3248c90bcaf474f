"""Stellar spectra normalised in Johnson V (Vega), the libraries that they come from, and the thermal light of a sphere.

Measured spectra by spectral type are those of Pickles 1998. Stellar models lie in a tree on disk: CK04, Kurucz 1993,
PHOENIX as STScI lays them out. A tree is a folder with ``catalog.fits`` (extension 1: ``INDEX`` = "Teff,[M/H],log g",
``FILENAME`` = "ckp00/ckp00_5000.fits[g45]") and the files that it names (columns ``WAVELENGTH`` in A and one surface
flux in erg/s/cm2/A per gravity). The catalogue is read once, a column of fluxes when it is first needed; both are read
again when their file changes.
"""

from __future__ import annotations

import functools
import os
import re
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from catalogs import (
    HC_ERG_ANGSTROM,
    SpectralLibrary,
    Spectrum,
    load_pickles,
    load_stellar_grid,
    parse_spectral_type,
    read_curve,
    stellar_parameters,
)
from cpic_core import (
    InputError,
    Record,
    bounded_fits,
    check_number,
    file_state,
    is_file,
    numeric_context,
    open_file,
    read_file,
)
from simulator.passbands import check_table, v_photon_rate, vega_v_photon_rate
from simulator.target.contrast import AU_KM, JUPITER_RADIUS_KM

if TYPE_CHECKING:
    from synphot import SourceSpectrum

_MAX_TABLE_BYTES = 200_000_000
_SPEED_OF_LIGHT_NM_S = 2.99792458e17


def read_spectrum(path: str | Path) -> Spectrum:
    """Read a spectrum from a file of wavelength and flux density, see `catalogs.curves.read_curve`.

    Units stand with the columns of ECSV, VOTable and FITS tables; text names them in its headings or remarks:
    ``wavelength_nm,photlam``, ``# Angstrom flam``, ``Wave (um)  Flux (W/m2/um)``.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    Spectrum
        Wavelengths in nm, ph/s/cm2/A, linear between the samples.

    Raises
    ------
    InputError
        If the file cannot be read, a unit is not stated, wavelengths do not increase or fluxes are not finite or
        negative.
    """
    place = Path(path)
    data = read_file(place, key="spectrum file", allowed="a readable file", max_bytes=_MAX_TABLE_BYTES)
    return photon_flux(place.name, *read_curve(place.name, data, "flux"))


def photon_flux(name: str, wavelength_nm: np.ndarray, flux: np.ndarray, unit: str) -> Spectrum:
    """Return a spectrum whose flux density is given in any of the usual units.

    Parameters
    ----------
    name : str
        What it is, for messages.
    wavelength_nm, flux : ndarray, shape (n,)
        Wavelengths and flux density.
    unit : str
        ``photlam`` (ph/s/cm2/A), ``flam`` (erg/s/cm2/A), ``fnu`` (erg/s/cm2/Hz), ``Jy``, or a unit that
        astropy reads.

    Raises
    ------
    InputError
        If the unit is not one of a flux density, wavelengths do not increase or fluxes are not finite or negative.
    """
    wavelength, values = check_table(name, wavelength_nm, flux)
    if wavelength[0] <= 0.0:
        raise InputError(f"{name} wavelength", float(wavelength[0]), unit="nm", allowed="above 0")
    kind = unit.strip().lower()
    if kind in ("fnu", "jy"):
        # Per frequency to per wavelength; a Jy is 1e-23 of the other.
        values = values * ((1e-23 if kind == "jy" else 1.0) * _SPEED_OF_LIGHT_NM_S / (10.0 * wavelength**2))
        kind = "flam"
    if kind == "flam":
        values = values * (10.0 * wavelength / HC_ERG_ANGSTROM)
    elif kind != "photlam":
        values = _by_astropy(name, wavelength, values, unit)
    return Spectrum(wavelength, values)


def _by_astropy(name: str, wavelength_nm: np.ndarray, flux: np.ndarray, unit: str) -> np.ndarray:
    hint = "the unit is not understood"
    if unit.strip():
        from astropy import units

        photlam = units.photon / (units.s * units.cm**2 * units.AA)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # several slashes are read from the left, as people mean them
                quantity = flux * units.Unit(unit)
            return np.asarray(quantity.to_value(photlam, units.spectral_density(wavelength_nm * units.nm)))
        except (ValueError, TypeError):
            pass
    else:
        unit, hint = "not stated", "name it in the heading, such as 'wavelength_nm photlam'"
    raise InputError(f"{name} flux unit", unit, allowed="photlam, flam, fnu, Jy, or a flux density", hint=hint)


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
        MK type, see `catalogs.stellar_physics.parse_spectral_type`.

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


class _Catalogue(Record, eq=False):
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
    catalogue = _catalogue(str(file), *file_state(file))
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
        stamp = file_state(file)
    except OSError as error:
        raise InputError("model file", str(file), allowed="a readable file", hint=error.strerror or "") from None
    wavelength, flux = _column(str(file), *stamp, column)
    if not flux.any():
        teff, metallicity, log_g = catalogue.parameters[row]
        cell, hint = f"Teff {teff:g} K, log g {log_g:g}, [M/H] {metallicity:g}", f"{name}[{column}] is all zero"
        raise InputError("model cell", cell, allowed="models that exist", hint=hint)
    return wavelength, flux


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


_C_CM_S = 2.99792458e10
# h c / k, cm K (exact SI values).
_HC_OVER_K_CM_K = 6.62607015e-34 * 2.99792458e8 / 1.380649e-23 * 100.0
_CM_PER_NM = 1e-7
_CM_PER_ANGSTROM = 1e-8
_AU_PER_PC = 648000.0 / np.pi


def photon_surface(wavelength_nm: np.ndarray, teff_k: float) -> np.ndarray:
    """Return the photon flux of a black surface, ph/s/cm2/A: ``2 pi c / lambda^4 / (exp(h c / lambda k T) - 1)``.

    Planck's law in photons times pi.

    Parameters
    ----------
    wavelength_nm : ndarray
        Wavelengths.
    teff_k : float
        Temperature, at least 70 K at 300 nm (below, the exponential overflows).
    """
    wavelength_cm = np.asarray(wavelength_nm, dtype=np.float64) * _CM_PER_NM
    surface = 2.0 * np.pi * _C_CM_S / wavelength_cm**4 / np.expm1(_HC_OVER_K_CM_K / (wavelength_cm * teff_k))
    return np.asarray(surface * _CM_PER_ANGSTROM)


def thermal_photlam(wavelength_nm: np.ndarray, teff_k: float, radius_rjup: float, distance_pc: float) -> np.ndarray:
    """Return the photon flux density of a black sphere at a distance, ph/s/cm2/A.

    `photon_surface` times ``(R/d)^2``.

    Parameters
    ----------
    wavelength_nm : ndarray
        Wavelengths.
    teff_k : float
        Temperature, see `photon_surface`.
    radius_rjup : float
        Radius, R_J = 71 492 km.
    distance_pc : float
        Distance from us.
    """
    size = radius_rjup * JUPITER_RADIUS_KM / (distance_pc * _AU_PER_PC * AU_KM)
    return np.asarray(photon_surface(wavelength_nm, teff_k) * size * size)


StarModel: TypeAlias = str | os.PathLike[str] | Spectrum
"""Name of a model, path of a tree or file, or a spectrum."""

STAR_MODELS = ("grid", "blackbody", "pickles")
"""Models by name."""

STAR_FLAGS = {
    "subclass_assumed": "the spectral type names no subclass: 5 taken",
    "luminosity_class_assumed": "the spectral type names no luminosity class: V taken",
    "type_uncertain": "the spectral type carries a colon or question mark",
    "composite_first_used": "two stars in one spectral type: the first taken",
    "subdwarf_as_dwarf": "temperature and gravity of a subdwarf taken from the dwarfs",
    "log_g_assumed": "no gravity and no spectral type given: the Sun's taken",
    "low_gravity_lines": "gravity below 3.5: lines of log g 3.5 on the broadband fluxes of the gravity",
    "template_interpolated": "mean of neighbouring templates of the library",
    "teff_k_unused": "the model does not depend on the temperature given",
    "log_g_unused": "the model does not depend on the gravity given",
    "metallicity_unused": "the model does not depend on the metallicity given",
}
"""Codes in ``flags`` and what they mean."""

_SUN_LIKE_LOG_G = 4.44
_BLACKBODY_TEFF_K = (100.0, 1e6)
_V_MAG = (-30.0, 40.0)
_NEUTRAL = {"metallicity": 0.0}
_ALLOWED_MODELS = f"{', '.join(STAR_MODELS)}, a Spectrum, or the path of a file or of a tree of models"


class StarSpectrum(Spectrum, eq=False):
    """A stellar spectrum at the telescope and what it was made from.

    Attributes
    ----------
    wavelength_nm, photlam : ndarray, shape (n,)
        Increasing wavelengths, the model's own (300-1750 nm for the shipped ones); ph/s/cm2/A.
    teff_k, log_g, metallicity : float or None
        Parameters used; for models that do not depend on them, those given or typical of the spectral type, None
        if there are none.
    flags : tuple of str
        Codes of `STAR_FLAGS`.
    model : str
        ``grid``, ``blackbody``, ``pickles``, ``table``, or the path given.
    """

    teff_k: float | None
    log_g: float | None
    metallicity: float | None
    flags: tuple[str, ...]
    model: str = "grid"


class _Parameters(Record):
    teff_k: float | None
    log_g: float | None
    metallicity: float | None
    flags: tuple[str, ...] = ()

    def unused(self, *names: str) -> tuple[str, ...]:
        """Return flags for those that are given; [M/H] = 0 is what all models are made for."""
        return tuple(f"{name}_unused" for name in names if getattr(self, name) not in (None, _NEUTRAL.get(name)))


def stellar_spectrum(
    magnitude_v: float,
    spectral_type: str | None = None,
    *,
    teff_k: float | None = None,
    log_g: float | None = None,
    metallicity: float | None = None,
    model: StarModel = "grid",
) -> StarSpectrum:
    """Return the photon spectrum of a star at the telescope, outside the atmosphere.

    Whatever the model, the spectrum is scaled to the Johnson V magnitude on the Vega scale (Vega has V = 0). One star
    a call; numbers may carry units (`astropy.units`). For many stars, see `simulator.passbands.Passbands`.

    Parameters
    ----------
    magnitude_v : float
        Johnson V, -30 to 40.
    spectral_type : str, optional
        MK type, gives Teff and log g. Either this or `teff_k` is needed, unless the spectrum is given.
    teff_k, log_g, metallicity : float, optional
        Override the type's values (K, dex of cm/s2, dex); defaults: log g 4.44 without a type (flagged), [M/H] = 0.
    model : str, path or Spectrum
        - ``"grid"``: the shipped surface fluxes (PHOENIX lines at R = 1000 on PHOENIX-ACES broadband fluxes, CK04
          broadband trends with metallicity and, below 3.5, gravity), interpolated linearly in flux over log g, [M/H]
          and Teff. 3500-8000 K, log g 0-5 (from 0.5 above 6000 K, from 1 above 7400 K), [M/H] -2.5 to 0.5. Scaled in
          V, it has the Sun's light within 2.5 % from 450 to 1100 nm, 3 % more at 1265 and 4 % more at 1400-1600 nm
          (TSIS-1 HSRS, ``reports/external``).
        - ``"blackbody"``: Planck's law, 100 K to 1e6 K.
        - ``"pickles"``: measured spectra by spectral type (Pickles 1998), A0-M6.
        - the path of a CK04, Kurucz or PHOENIX tree, see `simulator.target.star_spectrum.find_tree`.
        - the path of a file, see `simulator.target.star_spectrum.read_spectrum`, or a `Spectrum`; it must cover
          470-700 nm.

    Returns
    -------
    StarSpectrum

    Raises
    ------
    InputError
        If a value is not finite or outside the model (which is said with its range), the type cannot be read, or the
        tree or file is not as it should be.
    """
    magnitude = _number("magnitude_v", magnitude_v, "mag", *_V_MAG)
    numbers = ("teff_k", teff_k, "K"), ("log_g", log_g, "dex"), ("metallicity", metallicity, "dex")
    checked = [None if value is None else check_number(name, value, unit) for name, value, unit in numbers]
    given = _Parameters(checked[0], checked[1], checked[2])
    if isinstance(model, Spectrum):
        return _from_table(magnitude, model, given, "table")
    if not isinstance(model, str | os.PathLike):
        raise InputError("model", model, allowed=_ALLOWED_MODELS)
    name = str(model)
    if name == "pickles":
        return _from_library(magnitude, spectral_type, given)
    if name not in STAR_MODELS and is_file(name) and Path(name).name != "catalog.fits":
        return _from_table(magnitude, read_spectrum(name), given, name)
    star = _complete(spectral_type, given)
    if name == "grid":
        return _from_grid(magnitude, star)
    if name == "blackbody":
        return _blackbody(magnitude, star, given)
    return _from_tree(magnitude, star, name)


@numeric_context()
def star_photlam(
    magnitude_v: float,
    spectral_type: str | None = None,
    *,
    teff_k: float | None = None,
    log_g: float | None = None,
    metallicity: float | None = None,
    model: StarModel = "grid",
) -> SourceSpectrum:
    """Return `stellar_spectrum` as a synphot source: PHOTLAM (ph/s/cm2/A) over wavelength in Angstrom.

    Parameters and errors are those of `stellar_spectrum`; ``meta`` of the result holds the parameters used, the
    model and the flags. The source is zero outside the model's wavelengths (3000-17500 A for the shipped ones).
    """
    star = stellar_spectrum(
        magnitude_v, spectral_type, teff_k=teff_k, log_g=log_g, metallicity=metallicity, model=model
    )
    meta = {"magnitude_v": check_number("magnitude_v", magnitude_v, "mag"), "spectral_type": spectral_type}
    meta |= {name: getattr(star, name) for name in ("teff_k", "log_g", "metallicity", "model", "flags")}
    return synphot_source(star.wavelength_nm, star.photlam, meta)


def synphot_source(wavelength_nm: np.ndarray, photlam: np.ndarray, meta: dict[str, Any]) -> SourceSpectrum:
    """Return the samples as a synphot source, zero outside them.

    Parameters
    ----------
    wavelength_nm, photlam : ndarray
        Samples, nm and ph/s/cm2/A.
    meta : dict
        What is told with the source.
    """
    from synphot import SourceSpectrum
    from synphot.models import Empirical1D

    # Without fill_value synphot continues the edge values for ever.
    return SourceSpectrum(Empirical1D, points=wavelength_nm * 10.0, lookup_table=photlam, fill_value=0.0, meta=meta)


def _complete(spectral_type: str | None, given: _Parameters) -> _Parameters:
    """Return the parameters given, completed from the type or by the stated assumptions."""
    teff_k, log_g = given.teff_k, given.log_g
    flags: tuple[str, ...] = ()
    if teff_k is None and spectral_type is None:
        raise InputError("spectral_type", "missing", allowed="an MK type such as K1V", hint="or give teff_k")
    if spectral_type is not None and (teff_k is None or log_g is None):
        typical = stellar_parameters(spectral_type)
        teff_k = typical.teff_k if teff_k is None else teff_k
        log_g = typical.log_g if log_g is None else log_g
        flags = typical.flags
    elif log_g is None:
        log_g, flags = _SUN_LIKE_LOG_G, ("log_g_assumed",)
    return _Parameters(teff_k, log_g, 0.0 if given.metallicity is None else given.metallicity, flags)


def _from_grid(magnitude: float, star: _Parameters) -> StarSpectrum:
    grid = load_stellar_grid()
    teff_k = _number("teff_k", star.teff_k, "K", *grid.teff_k[[0, -1]], hint='or model="blackbody"')
    floor = float(grid.log_g_floor(teff_k))
    log_g = _number("log_g", star.log_g, "dex", floor, grid.log_g[-1], where=f" at {teff_k:g} K")
    metallicity = _number("metallicity", star.metallicity, "dex", *grid.metallicity[[0, -1]])
    flags = (*star.flags, "low_gravity_lines") if log_g < grid.line_log_g[0] else star.flags
    nodes, weights = grid.corners(teff_k, log_g, metallicity)
    surface = weights @ grid.node_photlam(nodes, np.arange(grid.wavelength_nm.size))
    photlam = _normalised(grid.wavelength_nm, surface, magnitude)
    return StarSpectrum(grid.wavelength_nm, photlam, teff_k, log_g, metallicity, flags, "grid")


def _blackbody(magnitude: float, star: _Parameters, given: _Parameters) -> StarSpectrum:
    teff_k = _number("teff_k", star.teff_k, "K", *_BLACKBODY_TEFF_K)
    flags = tuple(flag for flag in star.flags if flag != "log_g_assumed")
    wavelength_nm = load_stellar_grid().wavelength_nm
    photlam = _normalised(wavelength_nm, photon_surface(wavelength_nm, teff_k), magnitude)
    flags += given.unused("log_g", "metallicity")
    return StarSpectrum(wavelength_nm, photlam, teff_k, star.log_g, star.metallicity, flags, "blackbody")


def _from_library(magnitude: float, spectral_type: str | None, given: _Parameters) -> StarSpectrum:

    if spectral_type is None:
        allowed = "an MK type of the library, A0 to M6"
        raise InputError("spectral_type", "missing", allowed=allowed, hint='or model="grid"')
    wavelength_nm, template, flags = library_photlam(spectral_type)
    typical = stellar_parameters(spectral_type)
    photlam = _normalised(wavelength_nm, template, magnitude)
    flags = (*typical.flags, *flags, *given.unused("teff_k", "log_g", "metallicity"))
    return StarSpectrum(wavelength_nm, photlam, typical.teff_k, typical.log_g, 0.0, flags, "pickles")


def _from_tree(magnitude: float, star: _Parameters, path: str) -> StarSpectrum:

    if not path:
        raise InputError("model", "empty", allowed=_ALLOWED_MODELS)
    tree = find_tree(path)
    assert star.teff_k is not None
    assert star.log_g is not None
    assert star.metallicity is not None
    wavelength_nm, surface = tree_photlam(tree, star.teff_k, star.log_g, star.metallicity)
    photlam = _normalised(wavelength_nm, surface, magnitude)
    return StarSpectrum(wavelength_nm, photlam, star.teff_k, star.log_g, star.metallicity, star.flags, path)


def _from_table(magnitude: float, table: Spectrum, given: _Parameters, name: str) -> StarSpectrum:
    wavelength_nm, flux = check_table("spectrum", table.wavelength_nm, table.photlam)
    photlam = _normalised(wavelength_nm, flux, magnitude)
    flags = given.unused("teff_k", "log_g", "metallicity")
    return StarSpectrum(wavelength_nm, photlam, given.teff_k, given.log_g, given.metallicity, flags, name)


def _normalised(wavelength_nm: np.ndarray, surface: np.ndarray, magnitude: float) -> np.ndarray:
    """Return the spectrum scaled to the V magnitude, read-only."""
    peak = surface.max()
    rate = v_photon_rate(wavelength_nm, surface / peak) if peak > 0.0 else 0.0
    if not rate > 0.0:
        raise InputError("spectrum", "no light in V", allowed="some light between 470 and 700 nm")
    photlam: np.ndarray = surface / peak * (10.0 ** (-0.4 * magnitude) * vega_v_photon_rate() / rate)
    photlam.setflags(write=False)
    return photlam


def _number(
    name: str, value: float | None, unit: str, low: float, high: float, *, where: str = "", hint: str = ""
) -> float:
    number = check_number(name, value, unit)
    if not low <= number <= high:
        raise InputError(name, number, unit=unit, allowed=f"{low:g} to {high:g}{where}", hint=hint)
    return number
