"""Geometric albedo and phase behaviour of planets: one door to all kinds."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from catalogs import Albedo, load_albedo
from cpic_core import ArrayLike, InputError, file_state, numeric_context, real_array
from simulator import config
from simulator.knobs import AlbedoFamily
from simulator.target.contrast import lambert_phase
from simulator.target.parametric import grid_phase_curve, parametric_family

if TYPE_CHECKING:
    from simulator.target.albedo_grid import AlbedoGrid


_DEFAULT = config.ParametricAlbedo(insolation_au=2.0)
# A constant has no table of its own; these ends hold every band.
_EVERYWHERE_NM = (100.0, 10000.0)


@numeric_context()
def planet_albedo(
    wavelength_nm: ArrayLike,
    *,
    model: str | Path = "parametric",
    log10_mh: float = _DEFAULT.log10_mh,
    log10_fsed: float | None = _DEFAULT.log10_fsed,
    insolation_au: float = 2.0,
) -> np.ndarray:
    """Return the geometric albedo of a giant planet.

    Parameters
    ----------
    wavelength_nm : array_like
        Wavelengths, 300 to 1754 nm, or a quantity of `astropy.units`, as the parameters below.
    model : {"parametric", "jupiter", "saturn", "uranus", "neptune"}, str or Path
        ``parametric``: Rayleigh scattering over a cloud deck with methane absorption, fitted to public band albedos
        (`simulator.target.parametric`). A planet: as measured (Karkoschka 1998 up to 1050 nm). Anything else is the
        path of a file of albedos.
    log10_mh : float
        Metallicity over the Sun's, decimal logarithm, 0 to 2; for ``parametric``, as the next two. The defaults of both
        are Jupiter-like.
    log10_fsed : float or None
        Sedimentation efficiency of the clouds, decimal logarithm, -2 to 2; above log10 6 = 0.778 that is used (see
        `albedo_notes`). None: no clouds.
    insolation_au : float
        Distance from the Sun that has the planet's insolation, above 0; clamped to 0.5-5.

    Returns
    -------
    ndarray
        Albedo at the wavelengths, linear between samples. For a band use ``Passbands.band_albedo``: one wavelength
        does not stand for a band.

    Raises
    ------
    InputError
        For an unknown model, a parameter out of range or a wavelength outside the table.
    """
    spec = _spec(model, log10_mh, log10_fsed, insolation_au)
    table, wavelength = _covered(albedo_table(spec), wavelength_nm)
    return np.asarray(np.interp(wavelength, table.wavelength_nm, table.albedo))


def albedo_flags(wavelength_nm: ArrayLike, *, model: str | Path = "parametric") -> np.ndarray:
    """Return True where an albedo is ``extrapolated``: beyond 1050 nm, except in a table of your own.

    The origin of the measured tables beyond is undocumented, and with it the methane coefficients there.

    Raises
    ------
    InputError
        For an unknown model or a wavelength outside the table.
    """
    table, wavelength = _covered(albedo_table(_spec(model, _DEFAULT.log10_mh, _DEFAULT.log10_fsed, 2.0)), wavelength_nm)
    return wavelength > table.documented_to_nm


def albedo_notes(spec: config.AlbedoSpec, insolation_au: float | None = None) -> tuple[str, ...]:
    """Return what was clamped: ``fsed_clamped`` (above 6), ``insolation_clamped`` (outside the models' distances).

    Parameters
    ----------
    spec : AlbedoSpec
    insolation_au : float, optional
        Distance from the Sun where a planet is lit as strongly, au.
    """
    if not isinstance(spec, config.ParametricAlbedo | config.GridAlbedo):
        return ()
    notes = ["fsed_clamped"] if spec.log10_fsed is not None and spec.log10_fsed > config.LOG10_FSED_MAX else []
    if bool(_family(spec).outside(_insolation(spec, insolation_au))):
        notes.append("insolation_clamped")
    return tuple(notes)


def needs_insolation(spec: config.AlbedoSpec) -> bool:
    """Return whether the albedo follows the star's light on the planet, so that its insolation must be known."""
    return isinstance(spec, config.ParametricAlbedo | config.GridAlbedo) and spec.insolation_au is None


def albedo_source(spec: config.AlbedoSpec) -> Albedo | AlbedoFamily:
    """Return what ``Passbands.band_albedo`` integrates: one albedo, or a family over insolation.

    The same configuration gives the same object, so that its band integrals are made once.
    """
    if isinstance(spec, config.ParametricAlbedo | config.GridAlbedo):
        family = _family(spec)
        return family if spec.insolation_au is None else _at(family, spec.insolation_au)
    if isinstance(spec, config.MeasuredAlbedo):
        return load_albedo(spec.model)
    if isinstance(spec, config.ConstantAlbedo):
        return _constant(spec.value)
    if spec.file is not None:
        return _file(spec.file, _state(spec.file))
    return _user_table(spec.wavelength_nm or (), spec.albedo or ())


def albedo_table(spec: config.AlbedoSpec, *, insolation_au: float | None = None) -> Albedo:
    """Return the albedo of one planet.

    Parameters
    ----------
    spec : AlbedoSpec
    insolation_au : float, optional
        Insolation of the planet, for a specification that leaves it to the star (`needs_insolation`).

    Raises
    ------
    InputError
        If the insolation is needed and not given, or a file cannot be read.
    """
    source = albedo_source(spec)
    if isinstance(source, AlbedoFamily):
        return source.at(float(np.asarray(_insolation(spec, insolation_au))))
    return source


def phase_value(
    spec: config.AlbedoSpec, phase_deg: ArrayLike, *, insolation_au: ArrayLike | None = None
) -> np.ndarray | float:
    """Return the planet's brightness at a phase angle relative to full phase.

    Lambert's function, or the one of the model grid where the specification asks for it (``phase_function: grid``).

    Parameters
    ----------
    spec : AlbedoSpec
    phase_deg : array_like
        0 to 180 degrees.
    insolation_au : array_like, optional
        For a specification that leaves it to the star; broadcast against the phases.

    Raises
    ------
    InputError
        If an angle is out of range, or the insolation is needed and not given.
    """
    if not isinstance(spec, config.ParametricAlbedo | config.GridAlbedo) or spec.phase_function == "lambert":
        return lambert_phase(phase_deg)
    distance = _insolation(spec, insolation_au)
    curve = _grid(spec.file).phase_curve if isinstance(spec, config.GridAlbedo) else grid_phase_curve
    found = curve(phase_deg, log10_mh=spec.log10_mh, log10_fsed=spec.clamped_log10_fsed, insolation_au=distance)
    value = np.asarray(found)
    return float(value) if value.ndim == 0 else value


def _spec(model: str | Path, log10_mh: float, log10_fsed: float | None, insolation_au: float) -> config.AlbedoSpec:
    if isinstance(model, str) and model == "parametric":
        tree = {"log10_mh": log10_mh, "log10_fsed": log10_fsed, "insolation_au": insolation_au}
        return config.albedo_spec({"model": "parametric"} | tree)
    # A word such as grid, or a number, is a key's business in a scene.
    spec = config.albedo_spec(model) if isinstance(model, str | Path) else None
    if not isinstance(spec, config.MeasuredAlbedo | config.TableAlbedo):
        raise InputError("model", model, allowed="parametric, jupiter, saturn, uranus, neptune or a file")
    return spec


def _family(spec: config.ParametricAlbedo | config.GridAlbedo) -> AlbedoFamily:
    if isinstance(spec, config.GridAlbedo):
        return _grid(spec.file).family(spec.log10_mh, spec.clamped_log10_fsed)
    return parametric_family(spec.log10_mh, spec.clamped_log10_fsed)


def _insolation(spec: config.AlbedoSpec, given: ArrayLike | None) -> ArrayLike:
    fixed = spec.insolation_au if isinstance(spec, config.ParametricAlbedo | config.GridAlbedo) else None
    if fixed is not None:
        return fixed
    if given is None:
        hint = "give it, or the distance and luminosity of the star"
        raise InputError("insolation_au", "missing", unit="au", allowed="a value is required", hint=hint)
    return given


@functools.lru_cache(maxsize=64)
def _at(family: AlbedoFamily, insolation_au: float) -> Albedo:
    return family.at(insolation_au)


def _grid(path: str) -> AlbedoGrid:
    from simulator.target.albedo_grid import load_albedo_grid  # readers of files load only when asked for

    return load_albedo_grid(path)


@functools.lru_cache(maxsize=64)
def _file(path: str, _state: tuple[int, int]) -> Albedo:
    from simulator.target.albedo_grid import read_albedo

    return read_albedo(path)


def _state(path: str) -> tuple[int, int]:
    """Return the state of a file: a changed file is read again; a missing one is the reader's to refuse."""
    try:
        return file_state(path)
    except OSError:
        return (0, 0)


@functools.lru_cache(maxsize=64)
def _constant(value: float) -> Albedo:
    return _user_table(_EVERYWHERE_NM, (value, value))


@functools.lru_cache(maxsize=64)
def _user_table(wavelength_nm: tuple[float, ...], albedo: tuple[float, ...]) -> Albedo:
    from simulator.passbands import check_table

    wavelength, values = check_table("albedo", wavelength_nm, albedo)
    return Albedo(wavelength, values)


def _covered(table: Albedo, wavelength_nm: ArrayLike) -> tuple[Albedo, np.ndarray]:
    wavelength = real_array("wavelength_nm", wavelength_nm, "nm")
    low, high = float(table.wavelength_nm[0]), float(table.wavelength_nm[-1])
    inside = (wavelength >= low) & (wavelength <= high)
    if not np.all(inside):
        bad = float(wavelength[~inside].flat[0])
        raise InputError("wavelength_nm", bad, unit="nm", allowed=f"{low:g} to {high:g}")
    return table, wavelength
