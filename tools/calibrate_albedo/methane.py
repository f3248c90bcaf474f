"""Methane absorption coefficients from the measured albedos of the four giant planets.

Karkoschka's own coefficients (Icarus 133, 134) are in no released package, but the albedos from which they were
derived are. Each planet is two layers of gas over a deck whose reflectivity is smooth in wavelength; the coefficient
at each wavelength is what all four albedos want together. The absolute scale comes from four published coefficients
and from the known mixing ratios of methane.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from catalogs import load_albedo
from catalogs.spectra import PLANETS
from simulator.target.albedo import BACKSCATTER, layer_albedo, rayleigh_slope

ANCHORS_PER_KM_AM = {619.2: 0.7366, 702.0: 0.3450, 727.2: 4.5742, 780.0: 0.5618}
"""Published coefficients of Karkoschka 1998 at four wavelengths (nm), 1/(km amagat)."""

# CH4/H2 of the well-mixed gas: Jupiter Wong et al. 2004 (Icarus 171, 153), Saturn Fletcher et al. 2009 (Icarus 199,
# 351), Uranus and Neptune Karkoschka & Tomasko 2009, 2011 (Icarus 202, 287; 211, 780). 400 km amagat of H2 scatter
# with Rayleigh depth 1 at 550 nm.
_H2_KM_AM = 400.0
_MIXING = {"jupiter": 0.0024, "saturn": 0.0051, "uranus": 0.03, "neptune": 0.04}
_ICE_GIANTS = ("uranus", "neptune")

_STEP_NM = 2.0
_FIRST_EDGE_NM = 399.0
_LAST_EDGE_NM = 1755.0
_KNOTS_NM = np.array([400.0, 470.0, 550.0, 650.0, 760.0, 950.0, 1060.0, 1250.0, 1450.0, 1755.0])
_HAZE_SLOPE = -1.5
_HAZE_REFERENCE_NM = 800.0
_UPPER_DECK = 1.4
# Error model of the albedos, relative and absolute: real differences between planet and model, not noise.
_RELATIVE, _ABSOLUTE = 0.03, 0.004
_LEAST_ALBEDO = 1e-3
_BLACK = 2.0 * _ABSOLUTE
_ANCHOR_WEIGHT = 8.0
_PRIOR_PULL = 3.0
_DECK_STIFFNESS = 2.0
_GRID_LN_K = np.linspace(np.log(1e-5), np.log(200.0), 220)
# Where no planet constrains a coefficient it tends to a weak continuum, by three e-folds.
_WEAK_LN_K, _WEAK_SPREAD = np.log(1e-3), 3.0


@dataclass(frozen=True, eq=False)
class Methane:
    """Result of the inversion.

    Attributes
    ----------
    wavelength_nm, per_km_am : ndarray, shape (n,)
        Bin centres and coefficients, 1/(km amagat).
    measured, modelled : dict of str to ndarray, shape (n,)
        Planet -> geometric albedo in the bins.
    mixing_ratio : dict of str to float
        Planet -> CH4/H2 of the lower layer.
    """

    wavelength_nm: np.ndarray
    per_km_am: np.ndarray
    measured: dict[str, np.ndarray]
    modelled: dict[str, np.ndarray]
    mixing_ratio: dict[str, float]

    def rms(self, planet: str, low_nm: float, high_nm: float) -> float:
        """Return the rms difference of a planet's modelled and measured albedo over a range."""
        inside = (self.wavelength_nm >= low_nm) & (self.wavelength_nm <= high_nm)
        return float(np.sqrt(np.mean((self.modelled[planet] - self.measured[planet])[inside] ** 2)))


def invert_methane(*, last_nm: float = _LAST_EDGE_NM, turns: int = 40) -> Methane:
    """Return methane coefficients in bins of 2 nm from 400 nm.

    Parameters
    ----------
    last_nm : float
        Upper end.
    turns : int
        Rounds between coefficients (by wavelength) and gas, haze and deck (by planet).
    """
    edges = np.arange(_FIRST_EDGE_NM, last_nm + 1e-9, _STEP_NM)
    centres = 0.5 * (edges[1:] + edges[:-1])
    knots = _KNOTS_NM[: np.searchsorted(_KNOTS_NM, centres[-1]) + 1]
    planets = {name: _Planet.of(name, edges, centres, knots) for name in PLANETS}
    state = {name: planet.prior for name, planet in planets.items()}
    pinned = {int(np.argmin(np.abs(centres - place))): np.log(value) for place, value in ANCHORS_PER_KM_AM.items()}
    ln_k = np.full(centres.size, _WEAK_LN_K)
    for _ in range(turns):
        ln_k = _coefficients(planets, state, centres.size)
        fixed, weight = ln_k.copy(), np.ones(centres.size)
        for index, value in pinned.items():
            fixed[index], weight[index] = value, _ANCHOR_WEIGHT
        state = {name: planet.fit(state[name], fixed, weight) for name, planet in planets.items()}
    ln_k = _bridged(ln_k, np.array([planet.albedo for planet in planets.values()]))
    measured = {name: planet.albedo for name, planet in planets.items()}
    modelled = {name: planet.model(state[name], ln_k) for name, planet in planets.items()}
    mixing = {name: float(np.exp(values[3])) / _H2_KM_AM for name, values in state.items()}
    return Methane(centres, np.exp(ln_k), measured, modelled, mixing)


@dataclass(frozen=True, eq=False)
class _Planet:
    """Measured albedo of a planet and the prior of its numbers.

    The numbers: ln Rayleigh depth and ln methane per Rayleigh depth of the upper layer, the same of the lower one, ln
    haze reflectivity, and the deck's logit at the knots.
    """

    albedo: np.ndarray
    error: np.ndarray
    slope: np.ndarray
    haze: np.ndarray
    hats: np.ndarray
    prior: np.ndarray
    spread: np.ndarray

    @classmethod
    def of(cls, name: str, edges: np.ndarray, centres: np.ndarray, knots: np.ndarray) -> "_Planet":
        table = load_albedo(name)
        bins = np.digitize(table.wavelength_nm, edges) - 1
        inside = (bins >= 0) & (bins < centres.size)
        sums = np.bincount(bins[inside], weights=table.albedo[inside], minlength=centres.size)
        albedo = np.maximum(sums / np.bincount(bins[inside], minlength=centres.size), _LEAST_ALBEDO)
        hats = np.array([np.interp(centres, knots, row) for row in np.eye(knots.size)]).T
        column = _MIXING[name] * _H2_KM_AM
        # Giants: well mixed, decks near 1 bar. Ice giants: methane frozen out above its cloud, deep below.
        if name in _ICE_GIANTS:
            prior, spread = [np.log(0.5), np.log(0.2), np.log(6.0), np.log(column)], [1.0, 1.5, 1.0, 0.4]
        else:
            prior, spread = [np.log(0.1), np.log(column), np.log(0.3), np.log(column)], [1.0, 0.3, 1.0, 0.7]
        return cls(
            albedo,
            _RELATIVE + _ABSOLUTE / albedo,
            rayleigh_slope(centres),
            (centres / _HAZE_REFERENCE_NM) ** _HAZE_SLOPE,
            hats,
            np.array([*prior, np.log(0.025), *np.ones(knots.size)]),
            np.array([*spread, 0.7, *np.full(knots.size, 3.0)]),
        )

    def model(self, numbers: np.ndarray, ln_k: np.ndarray) -> np.ndarray:
        """Return the albedo, broadcast over leading axes of ``ln_k``."""
        upper, upper_methane, lower, lower_methane, haze = numbers[:5]
        k = np.exp(ln_k)
        deck = 1.0 / (1.0 + np.exp(-self.hats @ numbers[5:]))
        below = layer_albedo(
            np.exp(lower) * self.slope, np.exp(lower + lower_methane) * k, deck, backscatter=BACKSCATTER
        )
        # The lower layer is the deck of the upper one: its flux albedo is about 1.4 times the geometric one.
        deck = np.minimum(_UPPER_DECK * below, 0.999)
        gas = layer_albedo(np.exp(upper) * self.slope, np.exp(upper + upper_methane) * k, deck)
        veil = np.exp(haze) * self.haze
        return np.asarray(veil + (1.0 - veil) ** 2 * gas)

    def fit(self, start: np.ndarray, ln_k: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Return the numbers of the planet for given coefficients."""

        def residuals(numbers: np.ndarray) -> np.ndarray:
            misfit = weight * np.log(self.model(numbers, ln_k) / self.albedo) / self.error
            pull = _PRIOR_PULL * (numbers - self.prior) / self.spread
            return np.concatenate([misfit, pull, _DECK_STIFFNESS * np.diff(numbers[5:])])

        return np.asarray(least_squares(residuals, start, max_nfev=10).x)


def _bridged(ln_k: np.ndarray, albedo: np.ndarray) -> np.ndarray:
    """Return the coefficients; those where every planet is black, which says only that they are large, interpolated."""
    lit = albedo.max(axis=0) > _BLACK
    places = np.arange(ln_k.size)
    return np.asarray(np.interp(places, places[lit], ln_k[lit]))


def _coefficients(planets: dict[str, _Planet], state: dict[str, np.ndarray], size: int) -> np.ndarray:
    """Return the best ln k at each wavelength: least cost on a grid, refined by a parabola."""
    cost = np.tile(((_GRID_LN_K - _WEAK_LN_K) / _WEAK_SPREAD)[:, None] ** 2, (1, size))
    for name, planet in planets.items():
        trial = planet.model(state[name], np.tile(_GRID_LN_K[:, None], (1, size)))
        cost += (np.log(trial / planet.albedo) / planet.error) ** 2
    best = np.clip(cost.argmin(axis=0), 1, _GRID_LN_K.size - 2)
    rows = np.arange(size)
    left, middle, right = cost[best - 1, rows], cost[best, rows], cost[best + 1, rows]
    shift = 0.5 * (left - right) / np.maximum(left - 2.0 * middle + right, 1e-12)
    return np.asarray(_GRID_LN_K[best] + np.clip(shift, -1.0, 1.0) * (_GRID_LN_K[1] - _GRID_LN_K[0]))
