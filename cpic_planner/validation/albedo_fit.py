"""Metallicity and clouds of a planet from its measured band contrasts, and the model that these are compared with."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Literal

import numpy as np

from catalogs import Band, Spectrum, bracket
from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, Record, numeric_context
from cpic_planner.validation.astrometry import chi2_p_value
from simulator.config import LOG10_FSED_MAX, ParametricAlbedo
from simulator.passbands import band_quadrature, check_covers, check_table
from simulator.target import LitPlanet, contrast_at, load_parametric_grid, parametric_family, phase_value


class AlbedoModel(Record, eq=False):
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
    """Integrate the parametric model over bands, once for any number of fits.

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
    The parametric albedo is interpolated linearly between its nodes (`simulator.target.albedo`), hence the band
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

    def means(metal: float, cloud: float) -> list[float]:
        node = parametric_family(metal, cloud, insolation_au).at(insolation_au)
        return [float(share @ np.interp(x, node.wavelength_nm, node.albedo)) for x, share in rules]

    def phase(metal: float, cloud: float) -> float:
        tree = {"log10_mh": metal, "log10_fsed": cloud, "insolation_au": insolation_au}
        spec = ParametricAlbedo.model_validate(tree | {"phase_function": phase_function})
        return float(phase_value(spec, phase_deg))

    if phase_function not in ("lambert", "grid"):
        raise InputError("phase_function", phase_function, allowed="lambert, grid")
    full = float(contrast_at(radius_rjup, distance_au, 0.0, 1.0))
    names = {
        "insolation_clamped": not grid.insolation_au[0] <= insolation_au <= grid.insolation_au[-1],
        "extrapolated": any(band.support_nm[1] > grid.documented_to_nm for band in chosen),
    }
    pairs = [[(float(metal), float(cloud)) for cloud in clouds] for metal in metals]
    albedo = np.array([[means(*pair) for pair in row] for row in pairs])
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
        albedo=albedo,
        phase=np.array([[phase(*pair) for pair in row] for row in pairs]),
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


Constraint = Literal["constrained", "not_constrained", "degenerate"]

N_PARAMETERS = 2
GRID_POINTS = 121
# The grid is laid anew around what is within 5 sigma of the best place until that fills half of it.
KEPT_LOG = 12.5
FILLED_SHARE = 0.5
MAX_ZOOMS = 12
# A narrow valley that crosses the grid aslant has many lowest points; from so many of them a fit goes downhill.
STARTS = 6
SAME_CHI2 = 1e-3
LEVELS = (0.68, 0.95)


class AlbedoFit(Record, eq=False):
    """The values of log10_mh and log10_fsed that band contrasts allow.

    Attributes
    ----------
    status : {"constrained", "not_constrained", "degenerate"}
        ``degenerate``: fewer bands than parameters, so that a whole line fits equally well; ``not_constrained``: the
        95 % region reaches the edge of the allowed range (`open_edges` says which).
    log10_mh, log10_fsed : float
        Best fit, the smallest chi2. In a degenerate fit one of many.
    chi2 : float
        At the best fit.
    degrees_of_freedom : int
        Bands less 2, at least 0.
    p_value : float or None
        Chance of a chi2 at least this large if the model holds; None without degrees of freedom.
    mean, covariance : ndarray, shapes (2,) and (2, 2)
        Of the posterior over (log10_mh, log10_fsed), with flat priors on the allowed ranges.
    correlation : float
        Of the two in the posterior.
    log10_mh_grid, log10_fsed_grid : ndarray, shapes (m,) and (f,)
        Axes of the posterior: the allowed ranges, or the part of them that holds all of it.
    posterior : ndarray, shape (m, f)
        Probability per dex^2.
    bands : tuple of str
        Bands that were fitted.
    contrasts, errors : ndarray, shape (band,)
        As measured.
    model_contrasts : ndarray, shape (band,)
        At the best fit.
    open_edges : tuple of str
        Ends of the allowed ranges that the 95 % region reaches: ``log10_mh_low``, ``log10_mh_high``,
        ``log10_fsed_low``, ``log10_fsed_high`` (f_sed 6, above which all is the same).
    flags : tuple of str
        Those of the model.
    """

    status: Constraint
    log10_mh: float
    log10_fsed: float
    chi2: float
    degrees_of_freedom: int
    p_value: float | None
    mean: FloatArray
    covariance: FloatArray
    correlation: float
    log10_mh_grid: FloatArray
    log10_fsed_grid: FloatArray
    posterior: FloatArray
    bands: tuple[str, ...]
    contrasts: FloatArray
    errors: FloatArray
    model_contrasts: FloatArray
    open_edges: tuple[str, ...]
    flags: tuple[str, ...] = ()

    def level(self, probability: float) -> float:
        """Return the posterior density on the edge of the smallest region of this probability, between 0 and 1."""
        return _level(self.posterior, _cells(self.log10_mh_grid, self.log10_fsed_grid), probability)

    def interval(self, name: Literal["log10_mh", "log10_fsed"]) -> tuple[float, float]:
        """Return the central 68 % of one parameter, the other integrated over; its median lies in it.

        Parameters
        ----------
        name : {"log10_mh", "log10_fsed"}
            Name of the parameter.
        """
        low, high = self._quantiles(name, 0.5 - 0.5 * LEVELS[0], 0.5 + 0.5 * LEVELS[0])
        return low, high

    def median(self, name: Literal["log10_mh", "log10_fsed"]) -> float:
        """Return the median of one parameter, the other integrated over.

        The best fit is that of both parameters together, and may lie outside the interval of one of them.
        """
        return self._quantiles(name, 0.5)[0]

    def _quantiles(self, name: str, *levels: float) -> list[float]:
        axis, other, posterior = self.log10_mh_grid, self.log10_fsed_grid, self.posterior
        if name == "log10_fsed":
            axis, other, posterior = other, axis, posterior.T
        density = posterior @ _widths(other)
        below = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(axis))])
        return [float(value) for value in np.interp(levels, below / below[-1], axis)]


@numeric_context()
def fit_albedo(measured: Mapping[str, tuple[float, float]], model: AlbedoModel) -> AlbedoFit:
    """Fit metallicity and clouds to the contrasts measured in some bands.

    Parameters
    ----------
    measured : mapping of str to (value, error)
        Contrast of the planet in each band and its 1-sigma error, above 0; bands of the model. Values may be negative.
    model : AlbedoModel
        Of the planet, see `albedo_model`: size, distance, phase and insolation are known.

    Returns
    -------
    AlbedoFit

    Raises
    ------
    InputError
        If there is no band, one is unknown, or a number is out of range.

    Notes
    -----
    The posterior takes the likelihood ``exp(-chi2 / 2)`` on a grid with flat priors in log10_mh (0 to 2) and log10_fsed
    (-2 to log10 6); its regions hold the truth as often as they say when truths are spread like the prior. Errors are
    widened by what the model changes within a cell of the grid, which counts for errors well below a per cent only.
    """
    names, values, errors = _measured(measured, model)
    columns = [model.bands.index(name) for name in names]

    def chi2_of(contrast: FloatArray) -> FloatArray:
        return np.asarray(np.sum(((values - contrast[..., columns]) / errors) ** 2, axis=-1))

    def log_likelihood(contrast: FloatArray) -> FloatArray:
        seen = contrast[..., columns]
        wide = np.hypot(errors, _within_cell(seen))
        chi2 = np.sum(((values - seen) / wide) ** 2, axis=-1)
        return np.asarray(-0.5 * chi2 - np.log(wide / errors).sum(axis=-1))

    ranges = [(float(nodes[0]), float(nodes[-1])) for nodes in (model.log10_mh, model.log10_fsed)]
    axes = [np.linspace(*ends, GRID_POINTS) for ends in ranges]
    for _ in range(MAX_ZOOMS):
        contrast = model.contrast_grid(*axes)
        log_posterior = log_likelihood(contrast)
        kept = log_posterior > log_posterior.max() - KEPT_LOG
        smaller = [_around(axis, kept.any(axis=1 - number)) for number, axis in enumerate(axes)]
        if all(np.ptp(new) > FILLED_SHARE * np.ptp(old) for new, old in zip(smaller, axes, strict=True)):
            break
        axes = smaller
    contrast = model.contrast_grid(*axes)
    log_posterior = log_likelihood(contrast)
    cells = _cells(*axes)
    posterior = np.exp(log_posterior - log_posterior.max())
    posterior /= float((posterior * cells).sum())
    starts = _lowest(chi2_of(contrast), *axes)
    best = starts[0]
    if len(names) >= N_PARAMETERS:

        def chi2_at(place: FloatArray) -> float:
            return float(chi2_of(model.contrast_grid(place[:1], place[1:]))[0, 0])

        steps = [float(axis[1] - axis[0]) for axis in axes]
        ends = [_polished(start, steps, ranges, chi2_at) for start in starts]
        least = min(chi2_at(end) for end in ends)
        # Not the very least: rounding must not choose between ends of one valley.
        best = next(end for end in ends if chi2_at(end) <= least + SAME_CHI2)
    contrast = model.contrast(best[0], best[1])
    chi2 = float(chi2_of(contrast))
    mean, covariance = _moments(posterior * cells, *axes)
    spread = np.sqrt(np.diag(covariance))
    open_edges = _open_edges(posterior >= _level(posterior, cells, LEVELS[1]), axes, ranges)
    free = max(len(names) - N_PARAMETERS, 0)
    status: Constraint = "not_constrained" if open_edges else "constrained"
    return AlbedoFit(
        status="degenerate" if len(names) < N_PARAMETERS else status,
        log10_mh=float(best[0]),
        log10_fsed=float(best[1]),
        chi2=chi2,
        degrees_of_freedom=free,
        p_value=chi2_p_value(chi2, free),
        mean=mean,
        covariance=covariance,
        correlation=float(covariance[0, 1] / (spread[0] * spread[1])),
        log10_mh_grid=axes[0],
        log10_fsed_grid=axes[1],
        posterior=posterior,
        bands=names,
        contrasts=values,
        errors=errors,
        model_contrasts=contrast[columns],
        open_edges=open_edges,
        flags=model.flags,
    )


def _measured(
    measured: Mapping[str, tuple[float, float]], model: AlbedoModel
) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
    if not measured:
        raise InputError("measured", "no band", allowed="the contrast of at least one band")
    pairs = {}
    for name, (value, error) in measured.items():
        if name not in model.bands:
            raise InputError("measured", name, allowed=", ".join(model.bands))
        if not math.isfinite(value):
            raise InputError(f"measured.{name}", value, allowed="a finite contrast")
        if not (math.isfinite(error) and error > 0):
            raise InputError(f"measured.{name}.error", error, allowed="a finite error above 0")
        pairs[name] = (float(value), float(error))
    values, errors = np.array(list(pairs.values())).T
    return tuple(pairs), values, errors


def _within_cell(contrast: FloatArray) -> FloatArray:
    """Return the model's rms within the cell of each grid point: no narrow ridge may slip through between points."""
    steps = [np.gradient(contrast, axis=axis) for axis in (0, 1)]
    return np.asarray(np.hypot(*steps) / math.sqrt(12.0))


def _around(axis: FloatArray, kept: BoolArray) -> FloatArray:
    """Return a finer axis over the kept points and two more on either side."""
    inside = np.flatnonzero(kept)
    low, high = max(inside[0] - 2, 0), min(inside[-1] + 2, axis.size - 1)
    return np.linspace(axis[low], axis[high], axis.size)


def _lowest(values: FloatArray, first: FloatArray, second: FloatArray) -> list[FloatArray]:
    """Return the places of the lowest points of a grid, no two of them neighbours."""
    from scipy.ndimage import minimum_filter

    row, column = np.nonzero(values == minimum_filter(values, size=3, mode="nearest"))
    order = np.argsort(values[row, column], kind="stable")[:STARTS]
    return [np.array([first[row[k]], second[column[k]]]) for k in order]


def _polished(
    best: FloatArray, steps: list[float], ranges: list[tuple[float, float]], chi2: Callable[[FloatArray], float]
) -> FloatArray:
    """Follow chi2 from the best point of the grid downhill, by a simplex since the model has kinks at its nodes."""
    from scipy.optimize import minimize

    middle = np.mean(ranges, axis=1)
    inward = np.where(best < middle, 1.0, -1.0) * steps
    simplex = best + np.array([[0.0, 0.0], [inward[0], 0.0], [0.0, inward[1]]])
    options = {"xatol": 1e-2 * min(steps), "fatol": 1e-5, "initial_simplex": simplex}
    found = minimize(chi2, best, method="Nelder-Mead", bounds=ranges, options=options)
    return np.asarray(found.x) if found.fun <= chi2(best) else best


def _widths(axis: FloatArray) -> FloatArray:
    """Return trapezoidal weights."""
    step = np.diff(axis)
    return np.asarray(0.5 * (np.concatenate([[0.0], step]) + np.concatenate([step, [0.0]])))


def _cells(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.outer(_widths(first), _widths(second))


def _level(posterior: FloatArray, cells: FloatArray, probability: float) -> float:
    order = np.argsort(posterior, axis=None)[::-1]
    held = np.cumsum((posterior * cells).ravel()[order])
    index = min(int(np.searchsorted(held, probability * held[-1])), order.size - 1)
    return float(posterior.ravel()[order[index]])


def _moments(probability: FloatArray, mh: FloatArray, fsed: FloatArray) -> tuple[FloatArray, FloatArray]:
    weights = probability / probability.sum()
    points = np.stack(np.broadcast_arrays(mh[:, None], fsed), axis=-1).reshape(-1, 2)
    mean = np.asarray(weights.ravel() @ points)
    return mean, np.asarray(((points - mean) * weights.reshape(-1, 1)).T @ (points - mean))


def _open_edges(region: BoolArray, axes: list[FloatArray], ranges: list[tuple[float, float]]) -> tuple[str, ...]:
    found = []
    for number, name in enumerate(("log10_mh", "log10_fsed")):
        for end, side in ((0, "low"), (-1, "high")):
            reaches = bool(np.take(region, end, axis=number).any())
            if reaches and math.isclose(axes[number][end], ranges[number][end], abs_tol=1e-12):
                found.append(f"{name}_{side}")
    return tuple(found)
