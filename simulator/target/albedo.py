"""Geometric albedo and phase behaviour of planets: one door to all kinds.

The light is reflected by a Rayleigh-scattering, absorbing gas above a cloud deck. The model of the parametric albedo,
and of the inversion that gives the methane coefficients: one homogeneous layer of gas (scattering optical depth
``t_s``, absorption optical depth ``t_a``) over a deck that reflects the share ``d`` of the flux that reaches it, both
lit and seen along the same direction, as at phase 0.

Equations, for unit solar flux, ``t = t_s + t_a``, ``w = t_s / t`` and direction cosine ``m``:

1. The diffuse field is that of the hemispheric-mean two-stream approximation for isotropic scattering (Toon et al.
   1989, JGR 94, 16287, table 1: ``gamma_1 = 2 - w``, ``gamma_2 = w``, ``gamma_3 = gamma_4 = 1/2``). The sum ``S`` and
   the difference ``D`` of the upward and downward fluxes obey ``S' = 2 D`` and ``D' = 2 (1 - w) S - w exp(-x/m)``,
   hence with ``L = 2 sqrt(1 - w)``

       ``S(x) = a exp(-L x) + b exp(-L (t - x)) + c exp(-x/m)``,  ``c = -2 w m^2 / (1 - L^2 m^2)``;

   ``a`` and ``b`` follow from no diffuse light from above, ``S = D``, and reflection below,
   ``(S + D)/2 = d [(S - D)/2 + m exp(-t/m)]``.
2. The light that leaves towards the observer is the exact integral of that source over the path (the source function
   technique of the same paper), with ``J = S / (2 pi)`` and Rayleigh's phase function at backscatter, 3/2, for the
   first scattering: ``I(m) = integral of [w J + w (3/2) exp(-x/m) / (4 pi)] exp(-x/m) dx/m``
   plus the deck, ``d exp(-t/m) [(S - D)/2 + B m exp(-t/m)] / pi``. ``B`` is the deck's backscatter enhancement over a
   Lambert surface.
3. Geometric albedo ``A_g = 2 pi integral over 0 < m < 1 of I(m) m dm`` (Gauss-Legendre).

The parametric albedo of giant planets is Rayleigh scattering over a cloud deck with methane absorption: not the models
of Batalha et al. 2018, but a model with a few physical parameters at each node of their grid (metallicity,
sedimentation efficiency of the clouds f_sed, insolation), fitted to the six band albedos that are public for it;
``tools/calibrate_albedo`` makes the table and says how well it does.

At a node the albedo is ``h + (1 - h)^2 A(t_s, t_a, d)`` with `simulator.target.albedo.layer_albedo` and

- ``t_s = T r(l)``: Rayleigh scattering of the gas above the cloud, T at 550 nm;
- ``t_a = T [M x k(l) + n N(l) + w W(l)]``: methane (k in 1/(km amagat), x = 10^[M/H] times the column of a solar
  mixture, M a factor near 1), sodium and potassium wings, water vapour;
- ``d = logistic(c + s ln(l / 650 nm))``: reflectivity of the deck, with 1.15 times the light straight back of a
  Lambert surface;
- ``h``: a thin grey haze above all.

Between nodes the albedo itself is interpolated, linearly in log10 of metallicity and f_sed and in ln of distance: it
stays positive, and smooth in wavelength. f_sed above 6 is taken as 6 and never blended with the cloud-free models.
"""

from __future__ import annotations

import functools
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from catalogs import Albedo, load_albedo
from cpic_core import ArrayLike, InputError, Record, file_state, numeric_context, read_npz, real_array
from simulator import config
from simulator.knobs import AlbedoFamily, model_corners
from simulator.target.contrast import checked_phase, lambert_phase

_NODES = 8
_LEAST_DEPTH = 1e-12
_LARGEST_EXPONENT = 600.0
# Nearer to pure scattering, or to the resonance L m = 1, the closed form loses digits; the albedo moves by less than
# 1e-4 over these distances.
_LEAST_ABSORPTION = 1e-9
_RESONANCE = 1e-4
_RAYLEIGH_BACKSCATTER = 1.5
_REFERENCE_NM = 550.0


def rayleigh_slope(wavelength_nm: ArrayLike) -> np.ndarray:
    """Return the Rayleigh cross section of molecular hydrogen relative to 550 nm.

    Dalgarno & Williams 1962 (ApJ 136, 690): ``8.14e-13 l^-4 + 1.28e-6 l^-6 + 1.61 l^-8`` cm^2 with l in Angstrom.

    Parameters
    ----------
    wavelength_nm : array_like
        Wavelengths above 0.

    Returns
    -------
    ndarray
        1 at 550 nm.
    """

    def cross_section(angstrom: np.ndarray) -> np.ndarray:
        inverse_square = angstrom**-2.0
        return inverse_square**2 * (8.14e-13 + inverse_square * (1.28e-6 + inverse_square * 1.61))

    reference = cross_section(np.asarray(_REFERENCE_NM * 10.0))
    return np.asarray(cross_section(np.asarray(wavelength_nm, dtype=np.float64) * 10.0) / reference)


def layer_albedo(
    scattering_depth: ArrayLike, absorption_depth: ArrayLike, deck_albedo: ArrayLike, *, backscatter: float = 1.0
) -> np.ndarray:
    """Return the geometric albedo of a gas layer over a deck; equations in the module's head.

    Parameters
    ----------
    scattering_depth, absorption_depth : array_like
        Optical depths of the layer, at least 0.
    deck_albedo : array_like
        Share of flux that the deck reflects, 0 to 1.
    backscatter : float
        Enhancement of the deck's reflection straight back over that of a Lambert surface, at least 0.

    Returns
    -------
    ndarray
        Geometric albedo, broadcast shape. Against exact transfer (isotropic, Rayleigh for the first scattering) it is
        off by at most 0.03, or 9 % at depth 0.6 without a deck, rms 3 %.
    """
    given = scattering_depth, absorption_depth, deck_albedo
    scattering, absorption, deck = (np.asarray(part, dtype=np.float64) for part in given)
    depth = np.maximum(scattering + absorption, _LEAST_DEPTH)
    single = np.minimum(scattering / depth, 1.0 - _LEAST_ABSORPTION)
    decay = 2.0 * np.sqrt(1.0 - single)
    points, weights = np.polynomial.legendre.leggauss(_NODES)
    total: np.ndarray | float = 0.0
    for mu, weight in zip(0.5 * (points + 1.0), 0.5 * weights, strict=True):
        total = total + weight * mu * _intensity(depth, single, decay, deck, mu, backscatter)
    return np.asarray(2.0 * np.pi * total)


def _intensity(
    depth: np.ndarray, single: np.ndarray, decay: np.ndarray, deck: np.ndarray, mu: float, boost: float
) -> np.ndarray:
    """Return the intensity towards the observer at one direction cosine, for unit flux."""
    product = decay * mu
    product = np.where(np.abs(product - 1.0) < _RESONANCE, 1.0 + _RESONANCE, product)
    decay = product / mu
    # Slant depth of the beam, depth of the diffuse field, and what is left of each at the deck.
    slant, diffuse = np.minimum(depth / mu, _LARGEST_EXPONENT), np.minimum(decay * depth, _LARGEST_EXPONENT)
    beam, field = np.exp(-slant), np.exp(-diffuse)
    c = -2.0 * single * mu**2 / (1.0 - product**2)
    half = 0.5 * decay
    # Two conditions for a and b: S - D = 0 at the top; (1 - d) S + (1 + d) D = 2 d m exp(-t/m) at the deck.
    top_a, top_b, top = 1.0 + half, field * (1.0 - half), -c * (1.0 + 0.5 / mu)
    low_a = field * ((1.0 - deck) - (1.0 + deck) * half)
    low_b = (1.0 - deck) + (1.0 + deck) * half
    low = 2.0 * deck * mu * beam - c * beam * ((1.0 - deck) - (1.0 + deck) * 0.5 / mu)
    determinant = top_a * low_b - top_b * low_a
    a = (top * low_b - top_b * low) / determinant
    b = (top_a * low - top * low_a) / determinant
    total = a * field + b + c * beam
    difference = half * (b - a * field) - 0.5 * c * beam / mu
    # Path integrals of the three exponentials; the second is a divided difference of the exponential function.
    gap = slant - diffuse
    safe = np.where(np.abs(gap) < _LARGEST_EXPONENT * 1e-12, 1.0, gap)
    falling = (1.0 - field * beam) / (1.0 + product)
    rising = slant * np.where(safe == gap, (field - beam) / safe, beam)
    once = 0.5 * (1.0 - beam * beam)
    many = single / (2.0 * np.pi) * (a * falling + b * rising + c * once)
    first = single * _RAYLEIGH_BACKSCATTER / (4.0 * np.pi) * once
    below = deck * beam / np.pi * (0.5 * (total - difference) + boost * mu * beam)
    return np.asarray(many + first + below)


_PARAMETRIC = "the parametric albedo"
PARAMETERS = ("ln_rayleigh_depth", "ln_methane_factor", "deck_logit", "deck_slope", "ln_alkali", "ln_water", "ln_haze")
"""The parameters of a node: ln T, ln M, c, s, ln n, ln w, ln h."""

BACKSCATTER = 1.15
"""Enhancement of the deck straight back (A): the brightest models of the grid reach A_g = 0.77, 2/3 of it 0.67."""

# Methane above a Rayleigh depth of 1 at 550 nm in a solar mixture, km amagat: 400 km amagat of H2 (cross section of
# Dalgarno & Williams 1962) times CH4/H2 = 5e-4 (C/H of Lodders 2003, all carbon in methane).
_SOLAR_METHANE_KM_AM = 0.2
_DECK_REFERENCE_NM = 650.0

# Absorbers of warm gas beside methane: centre (nm), half width (nm), height relative to the strongest. Centres from
# spectroscopy; widths and heights assumed (A): they only have to carry light between the fitted bands.
_ALKALI = ((589.3, 15.0, 1.0), (768.0, 15.0, 0.5))
_WATER = ((725.0, 10.0, 0.1), (820.0, 12.0, 0.1), (940.0, 25.0, 1.0), (1135.0, 35.0, 1.0), (1380.0, 50.0, 10.0))


class ParametricGrid(Record, eq=False):
    """The fitted table.

    Attributes
    ----------
    fsed : ndarray, shape (8,)
        Sedimentation efficiency; the first, 0, is cloud-free.
    insolation_au : ndarray, shape (10,)
    log10_mh : ndarray, shape (6,)
    parameters : ndarray, shape (8, 10, 6, 7)
        In the order of `PARAMETERS`.
    phase : ndarray, shape (8, 10, 6, 3)
        Parameters of `phase_curve`.
    wavelength_nm, methane_per_km_am : ndarray, shape (n,)
        Sampling of the spectra and methane absorption there, 1/(km amagat).
    documented_to_nm : float
        Beyond, the methane coefficients come from albedos of undocumented origin.
    """

    fsed: np.ndarray
    insolation_au: np.ndarray
    log10_mh: np.ndarray
    parameters: np.ndarray
    phase: np.ndarray
    wavelength_nm: np.ndarray
    methane_per_km_am: np.ndarray
    documented_to_nm: float


def data_file() -> Path:
    """Return where the fitted table lies."""
    return Path(str(files("simulator.target") / "data" / "parametric_albedo.npz"))


@functools.cache
def load_parametric_grid() -> ParametricGrid:
    """Return the shipped table; it is read once per process."""
    arrays = read_npz(data_file())
    documented = float(arrays.pop("documented_to_nm"))
    plain = {name: np.asarray(array, dtype=np.float64) for name, array in arrays.items()}
    for array in plain.values():
        array.setflags(write=False)
    return ParametricGrid(documented_to_nm=documented, **plain)


def node_albedo(
    parameters: ArrayLike, log10_mh: ArrayLike, wavelength_nm: ArrayLike, methane_per_km_am: ArrayLike
) -> np.ndarray:
    """Return geometric albedos of nodes; equations in the module's head.

    Parameters
    ----------
    parameters : array_like, shape (..., 7)
        In the order of `PARAMETERS`.
    log10_mh : array_like, shape (...)
        Metallicity of each.
    wavelength_nm, methane_per_km_am : array_like, shape (n,)

    Returns
    -------
    ndarray, shape (..., n)
    """
    depth, methane, deck, slope, alkali, water, haze = np.moveaxis(np.asarray(parameters, float), -1, 0)[..., None]
    wavelength = np.asarray(wavelength_nm, dtype=np.float64)
    column = _SOLAR_METHANE_KM_AM * 10.0 ** np.asarray(log10_mh, float)[..., None] * np.exp(methane)
    absorber = column * np.asarray(methane_per_km_am, float)
    absorber = absorber + np.exp(alkali) * _lorentz(wavelength, _ALKALI) + np.exp(water) * _gauss(wavelength, _WATER)
    above = np.exp(depth)
    reflectivity = 1.0 / (1.0 + np.exp(-(deck + slope * np.log(wavelength / _DECK_REFERENCE_NM))))
    below = layer_albedo(above * rayleigh_slope(wavelength), above * absorber, reflectivity, backscatter=BACKSCATTER)
    veil = np.exp(haze)
    return np.asarray(veil + (1.0 - veil) ** 2 * below)


@functools.lru_cache(maxsize=32)
def parametric_family(log10_mh: float, log10_fsed: float | None, near_au: float | None = None) -> AlbedoFamily:
    """Return the parametric albedo over insolation.

    Parameters
    ----------
    log10_mh : float
        Decimal logarithm of the metallicity over the Sun's, 0 to 2.
    log10_fsed : float or None
        Decimal logarithm of f_sed, -2 to log10 6; above, log10 6 is used. None: cloud-free.
    near_au : float, optional
        An insolation distance: only the two nodes next to it are worked out.

    Returns
    -------
    AlbedoFamily
        300-1755 nm in steps of 2 nm.

    Raises
    ------
    InputError
        If a parameter is out of range.
    """
    grid = load_parametric_grid()
    first, last = 0, grid.insolation_au.size
    if near_au is not None:
        first = int(np.clip(np.searchsorted(grid.insolation_au, near_au) - 1, 0, last - 2))
        last = first + 2
    corners = model_corners(grid.fsed, grid.log10_mh, log10_mh, log10_fsed, _PARAMETRIC)
    family = np.asarray(sum(weight * _node_spectra(fsed, metal, first, last) for fsed, metal, weight in corners))
    family.setflags(write=False)
    return AlbedoFamily(grid.insolation_au[first:last], grid.wavelength_nm, family, grid.documented_to_nm)


def phase_curve(shape: ArrayLike, phase_deg: ArrayLike) -> np.ndarray:
    """Return ``(1 - s) L^p + s cos^(2 q)(a / 2)``: L is Lambert's phase function, s = logistic of the second number.

    Parameters
    ----------
    shape : array_like, shape (..., 3)
        ln p, logit s, ln q.
    phase_deg : array_like, shape (n,)

    Returns
    -------
    ndarray, shape (..., n)
        1 at 0, 0 at 180 degrees.
    """
    power, mixture, wide = np.moveaxis(np.asarray(shape, float), -1, 0)[..., None]
    phase = checked_phase(phase_deg)
    mixed = 1.0 / (1.0 + np.exp(-mixture))
    # From the supplement the cosine of half the phase keeps its digits up to 180 degrees.
    cosine = np.sin(np.deg2rad(0.5 * (180.0 - phase)))
    return np.asarray((1.0 - mixed) * lambert_phase(phase) ** np.exp(power) + mixed * cosine ** (2.0 * np.exp(wide)))


def grid_phase_curve(
    phase_deg: ArrayLike, *, log10_mh: float, log10_fsed: float | None, insolation_au: ArrayLike
) -> np.ndarray:
    """Return the phase function of the grid's models, as fitted, relative to full phase.

    At 90 degrees it lies between 0.13 and 0.51 (Lambert: 0.318), for nine nodes in ten between 0.20 and 0.45; one
    curve serves all wavelengths.

    Parameters
    ----------
    phase_deg, insolation_au : array_like
        Broadcast against each other; 0 to 180 degrees; above 0 au, clamped to the grid's 0.5-5.
    log10_mh, log10_fsed
        As in `parametric_family`.

    Returns
    -------
    ndarray
        Broadcast shape.
    """
    grid = load_parametric_grid()
    phase, distance = np.broadcast_arrays(checked_phase(phase_deg), np.asarray(insolation_au, dtype=np.float64))
    nodes, weights = parametric_family(log10_mh, log10_fsed).corners(distance)
    result = np.zeros(phase.shape)
    for fsed, metal, weight in model_corners(grid.fsed, grid.log10_mh, log10_mh, log10_fsed, _PARAMETRIC):
        curves = phase_curve(grid.phase[fsed, :, metal], phase.ravel()).reshape(-1, *phase.shape)
        for end in (0, 1):
            chosen = np.take_along_axis(curves, nodes[..., end][None], axis=0)[0]
            result += weight * weights[..., end] * chosen
    return result


@functools.lru_cache(maxsize=64)
def _node_spectra(fsed: int, metal: int, first: int, last: int) -> np.ndarray:
    """Return the spectra of some insolations at one metallicity and f_sed, shape (k, n)."""
    grid = load_parametric_grid()
    metallicity = np.full(last - first, grid.log10_mh[metal])
    parameters = grid.parameters[fsed, first:last, metal]
    return node_albedo(parameters, metallicity, grid.wavelength_nm, grid.methane_per_km_am)


def _lorentz(wavelength_nm: np.ndarray, lines: tuple[tuple[float, float, float], ...]) -> np.ndarray:
    parts = (height / (1.0 + ((wavelength_nm - centre) / width) ** 2) for centre, width, height in lines)
    return sum(parts, np.zeros_like(wavelength_nm))


def _gauss(wavelength_nm: np.ndarray, lines: tuple[tuple[float, float, float], ...]) -> np.ndarray:
    parts = (height * np.exp(-0.5 * ((wavelength_nm - centre) / width) ** 2) for centre, width, height in lines)
    return sum(parts, np.zeros_like(wavelength_nm))


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
        (`simulator.target.albedo`). A planet: as measured (Karkoschka 1998 up to 1050 nm). Anything else is the
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
