"""Band contrasts of a planet as metallicity and clouds make them: what a fit compares measured contrasts with."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from catalogs import Band, Spectrum, bracket
from cpic_core import ArrayLike, FloatArray, InputError, numeric_context
from simulator.band_integrals import band_quadrature, check_covers, check_table
from simulator.config import LOG10_FSED_MAX, ParametricAlbedo
from simulator.target import LitPlanet, contrast_at, load_parametric_grid, parametric_family, phase_value


@dataclass(frozen=True, eq=False)
class AlbedoModel:
    """Contrast in some bands over log10_mh and log10_fsed; made by `albedo_model`.

    Attributes
    ----------
    bands : tuple of str
        Names, in the order of the last axis of every result.
    wavelength_nm, width_nm : ndarray, shape (band,)
        Middle of each band and its full width.
    log10_mh, log10_fsed : ndarray, shapes (m,) and (f,)
        Nodes of the parametric model; their ends are the allowed ranges, 0 to 2 and -2 to log10 6.
    albedo : ndarray, shape (m, f, band)
        Photon-weighted geometric albedo at the nodes.
    phase : ndarray, shape (m, f)
        Brightness at the planet's phase relative to full phase.
    clear : ndarray, shape (m, band)
        Contrast of cloud-free planets.
    full_contrast : float
        Contrast of albedo 1 at full phase, (R/r)^2.
    insolation_au : float
        Distance from the Sun that has the planet's insolation.
    flags : tuple of str
        ``insolation_clamped`` (beyond 0.5-5 au), ``extrapolated`` (a band beyond 1050 nm).
    """

    bands: tuple[str, ...]
    wavelength_nm: FloatArray
    width_nm: FloatArray
    log10_mh: FloatArray
    log10_fsed: FloatArray
    albedo: FloatArray
    phase: FloatArray
    clear: FloatArray
    full_contrast: float
    insolation_au: float
    flags: tuple[str, ...] = ()

    def contrast(self, log10_mh: ArrayLike, log10_fsed: ArrayLike) -> FloatArray:
        """Return the contrast in every band, shape (..., band); parameters broadcast.

        Parameters
        ----------
        log10_mh : array_like
            Logarithm of the metallicity relative to the Sun's.
        log10_fsed : array_like
            Logarithm of the sedimentation efficiency of the clouds.

        Raises
        ------
        InputError
            If a parameter lies outside the nodes. Clamp f_sed to 6 yourself, and say so.
        """
        metal, cloud = self._node_weights(log10_mh, log10_fsed)
        albedo = np.einsum("...m,...f,mfb->...b", metal, cloud, self.albedo)
        phase = np.einsum("...m,...f,mf->...", metal, cloud, self.phase)
        return np.asarray(self.full_contrast * albedo * phase[..., None])

    def contrast_grid(self, log10_mh: ArrayLike, log10_fsed: ArrayLike) -> FloatArray:
        """Return the contrast on the grid of two axes, (i,) and (j,): shape (i, j, band); as `contrast`, but fast.

        Parameters
        ----------
        log10_mh : array_like
            Logarithm of the metallicity relative to the Sun's.
        log10_fsed : array_like
            Logarithm of the sedimentation efficiency of the clouds.
        """
        metal, cloud = self._node_weights(log10_mh, log10_fsed)
        albedo = np.tensordot(metal, np.tensordot(cloud, self.albedo, axes=(1, 1)), axes=(1, 1))
        return np.asarray(self.full_contrast * albedo * (metal @ self.phase @ cloud.T)[..., None])

    def _node_weights(self, log10_mh: ArrayLike, log10_fsed: ArrayLike) -> Iterator[FloatArray]:
        """Yield the weight of every node of metallicity, then of clouds, for each value, shape (..., node)."""
        for key, given in {"log10_mh": log10_mh, "log10_fsed": log10_fsed}.items():
            nodes, values = getattr(self, key), np.asarray(given, dtype=np.float64)
            good = (values >= nodes[0]) & (values <= nodes[-1])
            if not good.all():
                raise InputError(key, float(values[~good].flat[0]), allowed=f"{nodes[0]:g} to {nodes[-1]:.4g}")
            ends, weights = bracket(nodes, values)
            full = np.zeros((*values.shape, nodes.size))
            np.put_along_axis(full, ends, weights, axis=-1)
            yield full


def albedo_model(
    bands: Iterable[Band],
    star: Spectrum,
    *,
    radius_rjup: float,
    distance_au: float,
    phase_deg: float,
    insolation_au: float,
    phase_function: str = "lambert",
) -> AlbedoModel:
    """Integrate the parametric model over bands, once for any number of fits (0.2 s the first time).

    Parameters
    ----------
    bands : iterable of Band
        ``Passbands.bands``, or some of them: those of the exposure-time calculator.
    star : Spectrum
        Photon spectrum of the host, any scale.
    radius_rjup, distance_au, phase_deg : float
        Radius, true distance from the star, phase angle (below 180 degrees).
    insolation_au : float
        True distance over the square root of the star's luminosity; clamped to 0.5-5.
    phase_function : {"lambert", "grid"}, optional
        Lambert's, or the one fitted to the grid of models, which varies with metallicity and clouds.

    Returns
    -------
    AlbedoModel

    Raises
    ------
    InputError
        If a number is out of range, there is no band, or the spectrum or the model does not cover one.

    Notes
    -----
    The parametric albedo is interpolated linearly between its nodes (`simulator.target.parametric`), hence the band
    means interpolated between nodes are exact: they equal `Passbands.band_albedo` to rounding.
    """
    chosen = tuple(bands)
    if not chosen:
        raise InputError("bands", "none", allowed="at least one band")
    grid = load_parametric_grid()
    metals, clouds = grid.log10_mh, np.log10(grid.fsed[1:])
    clouds[-1] = LOG10_FSED_MAX
    wavelength, photlam = check_table("star", star.wavelength_nm, star.photlam)
    rules = []
    for band in chosen:
        check_covers("star", wavelength, band)
        check_covers("albedo", grid.wavelength_nm, band)
        x, measure = band_quadrature(band, wavelength, grid.wavelength_nm)
        measure = measure * np.interp(x, wavelength, photlam)
        rules.append((x, measure / measure.sum()))

    def means(metal: float, cloud: float | None) -> list[float]:
        node = parametric_family(metal, cloud).at(insolation_au)
        return [float(share @ np.interp(x, node.wavelength_nm, node.albedo)) for x, share in rules]

    def phase(metal: float, cloud: float | None) -> float:
        tree = {"log10_mh": metal, "log10_fsed": cloud, "insolation_au": insolation_au}
        spec = ParametricAlbedo.model_validate(tree | {"phase_function": phase_function})
        return float(phase_value(spec, phase_deg))

    if phase_function not in ("lambert", "grid"):
        raise InputError("phase_function", phase_function, allowed="lambert, grid")
    full = float(contrast_at(radius_rjup, distance_au, 0.0, 1.0))
    family = parametric_family(float(metals[0]), float(clouds[0]))
    names = {
        "insolation_clamped": bool(family.outside(insolation_au)),
        "extrapolated": any(band.support_nm[1] > grid.documented_to_nm for band in chosen),
    }
    pairs = [[(float(metal), float(cloud)) for cloud in clouds] for metal in metals]
    clear = [np.array(means(float(metal), None)) * phase(float(metal), None) for metal in metals]
    if not (full > 0 and phase(*pairs[0][0]) > 0):
        allowed = "a planet with light: radius above 0, phase below 180"
        raise InputError("phase_deg", phase_deg, unit="deg", allowed=allowed)
    ends = np.array([band.support_nm for band in chosen])
    return AlbedoModel(
        bands=tuple(band.name for band in chosen),
        wavelength_nm=ends.mean(axis=1),
        width_nm=np.diff(ends, axis=1)[:, 0],
        log10_mh=metals,
        log10_fsed=clouds,
        albedo=np.array([[means(*pair) for pair in row] for row in pairs]),
        phase=np.array([[phase(*pair) for pair in row] for row in pairs]),
        clear=full * np.array(clear),
        full_contrast=full,
        insolation_au=float(insolation_au),
        flags=tuple(name for name, there in names.items() if there),
    )


@numeric_context()
def planet_albedo_model(planet: LitPlanet, bands: Iterable[Band]) -> AlbedoModel:
    """Return the model of a planet of a scene: its size, place and star, whatever its true albedo is.

    Parameters
    ----------
    planet : LitPlanet
        ``spectrum_generator(scene)[i].light``, a planet that reflects.
    bands : iterable of Band

    Raises
    ------
    InputError
        If the planet has light of its own, or its insolation is neither given nor follows from its star.
    """
    body = planet.planet
    if body.albedo is None or body.radius_rjup is None or body.phase_deg is None or planet.distance_au is None:
        raise InputError(planet.path, "light of its own", allowed="a planet that reflects its star")
    insolation = getattr(body.albedo, "insolation_au", None)
    if insolation is None:
        insolation = planet.distance_au / math.sqrt(planet.host.luminosity[0])
    return albedo_model(
        bands,
        planet.host.spectrum,
        radius_rjup=body.radius_rjup,
        distance_au=planet.distance_au,
        phase_deg=body.phase_deg,
        insolation_au=float(insolation),
        phase_function=getattr(body.albedo, "phase_function", "lambert"),
    )
