"""Closed forms of what remains of speckles, noise and planet when modes of many reference visits are subtracted.

The visits of the optical model tell the covariance of the speckle field. R of them are taken as references with their
modes, and the covariance of the others says what is left. The mean of a Gaussian sample and the modes of its scatter
are independent: the residual of V science and R reference visits is (1/V + 1/R) times one number of R and K.
"""

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
import scipy

from cpic_core import ArrayLike, FloatArray, InputError, IntArray, check_finite, check_whole, compute_once, stream
from simulator.config import Instrument, content_hash
from simulator.imaging import psf_metrics, single_band_psf
from simulator.signal.speckle_visits import N_VISITS, SEED, OpticalBand, stamps_around, visit_changes

_SCHEMA = 1
_MOST_SHARE = 2 / 3  # of the visits that may be references: the others tell what is left
_MOST_MODES, _VARIANCE_KEPT = 800, 0.99999
_LEAST_FACTOR = 1e-12
_MODE_STEPS = (8, 32, 128, 512)
_DRAWN_MODES = 800  # references times draws: as many draws as that takes, 2 to 16
_NOISE_STEPS, _LEAST_NOISE, _MOST_NOISE = 8, 0.01, 30.0  # nodes a decade, and the range outside which nothing changes
MOST_REFERENCES = int(_MOST_SHARE * N_VISITS)
"""Most reference visits whose modes are known; more change nothing."""
# Numbers of references that are drawn: between them factors are power laws.
_EVERY = 24
_REFERENCES = np.unique([*range(1, _EVERY + 1), *np.round(np.geomspace(_EVERY, MOST_REFERENCES, 16)).astype(int)])


class ModeFactors(NamedTuple):
    """The factors of modes: of `SpeckleModes` for K = 0, 1, ... along the last axis, 1 at K = 0; of places for one K.

    Attributes
    ----------
    n_modes : ndarray
        K.
    speckle, white : ndarray
        Variance of aperture sums over that without modes: of the speckles of science and reference visits, and of the
        white noise of the science frames.
    throughput : ndarray
        Part of a planet's light that is left.
    """

    n_modes: IntArray
    speckle: FloatArray
    white: FloatArray
    throughput: FloatArray

    def at(self, n_modes: ArrayLike) -> "ModeFactors":
        """Return those of so many modes, or of as many as there are, for each of the first axes."""
        wanted = np.minimum(np.asarray(n_modes, int), self.n_modes.max(axis=-1))
        index = np.broadcast_to(wanted, self.n_modes.shape[:-1])[..., None]
        numbers, *factors = (np.take_along_axis(part, index, axis=-1)[..., 0] for part in self)
        return ModeFactors(numbers.astype(int), *(np.asarray(part, float) for part in factors))

    def limit(self, noise_over_speckle: ArrayLike) -> FloatArray:
        """Return the rms of aperture sums over throughput, relative to no modes, with so much white noise.

        Parameters
        ----------
        noise_over_speckle : array_like
            Rms of the white noise in the programme's mean over that of the speckles, both without modes.
        """
        ratio = np.asarray(noise_over_speckle, float)[..., None] ** 2
        left = (self.speckle + ratio * self.white) / (1.0 + ratio)
        return np.asarray(np.sqrt(left) / np.maximum(self.throughput, 1e-12))


class SpeckleModes:
    """Covariance of visits around one place, in its own leading modes; made by `BandModes.around`.

    Parameters
    ----------
    images : ndarray, shape (n, p)
        Visits, their mean taken off.
    apertures, own, planets : ndarray
        Weights (a, p) of apertures with their mean taken off, and of those of m planets with their light (m, p).
    """

    def __init__(self, images: FloatArray, apertures: FloatArray, own: FloatArray, planets: FloatArray) -> None:
        wide = len(images) <= images.shape[1]
        values, vectors = np.linalg.eigh(images @ images.T if wide else images.T @ images)
        values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
        share = np.cumsum(values) / values.sum()
        n = min(int(np.searchsorted(share, _VARIANCE_KEPT)) + 1, _MOST_MODES, values.size)
        basis = (vectors[:, :n] / np.sqrt(values[:n])).T @ images if wide else vectors[:, :n].T
        self.variances, self._visits = values[:n] / len(images), images @ basis.T
        self.n_pixels, self._n_visits = images.shape[1], len(images)
        self._apertures, self._own, self._planets = (part @ basis.T for part in (apertures, own, planets))
        self._weights = float((apertures**2).sum(axis=1).mean())
        # Mean square of an aperture sum of one visit, as a quadratic form of its modes; and that of every visit.
        self._squares = self._apertures.T @ self._apertures / len(apertures)
        self._sums2 = ((self._visits @ self._squares) * self._visits).sum(axis=1)
        self._light = (own * planets).sum(axis=1)
        # Rms of aperture sums of one visit.
        self.speckle_rms = float(np.sqrt(((self._apertures**2) @ self.variances).mean()))
        self._nodes: dict[tuple[int, int, int], FloatArray] = {}
        self._logs: dict[tuple[int, int, int], FloatArray] = {}

    def factors(
        self, reference_visits: ArrayLike, noise_over_speckle: ArrayLike, most_modes: int | None = None
    ) -> ModeFactors:
        """Return the change by 0 to R - 1 modes.

        Parameters
        ----------
        reference_visits : array_like
            R, whole numbers from 1 to 1000, and at most two thirds of the visits. One has no modes beside its mean.
        noise_over_speckle : array_like
            Rms of the white noise of one reference visit over that of its speckles, in aperture sums; at least 0. Below
            0.01 and above 30 nothing changes. It broadcasts with R.
        most_modes : int, optional
            Largest K to look at, by default all.

        Returns
        -------
        ModeFactors
            Of K = 0 to the most, R - 1 where there are no more; more modes than the field has change nothing.

        Raises
        ------
        InputError
            If an argument is out of range.
        """
        most_visits = int(_MOST_SHARE * self._n_visits)
        for number in np.unique(reference_visits):
            check_whole("reference_visits", float(number), 1, most_visits)
        noise = check_finite("noise_over_speckle", noise_over_speckle)
        if np.any(noise < 0.0):
            raise InputError("noise_over_speckle", float(np.min(noise)), allowed="at least 0")
        references, noise = np.broadcast_arrays(np.asarray(reference_visits, int), noise)
        most = int(references.max()) - 1
        most = most if most_modes is None else min(check_whole("most_modes", most_modes, 0, 1000), most)
        usable = _REFERENCES[most_visits >= _REFERENCES]
        where_r = np.interp(np.log(references), np.log(usable), np.arange(usable.size))
        where_n = _NOISE_STEPS * np.log10(np.clip(noise, _LEAST_NOISE, _MOST_NOISE))
        corners = [(r, n, a * b) for r, a in _nodes_around(where_r) for n, b in _nodes_around(where_n)]
        low_r, low_n, _ = corners[0]
        # Nodes without a share are not made: the first one, which has one always, stands for them.
        at = [np.where(share > 0, [r, n], [low_r, low_n]) for r, n, share in corners]
        pairs, place = np.unique(np.stack(at, axis=1).reshape(2, -1), axis=1, return_inverse=True)
        table = np.stack([self._log_node(int(usable[i]), int(k), most) for i, k in pairs.T], axis=1)
        index = place.reshape(len(corners), *references.shape)
        found = np.zeros((3, *references.shape, most + 1))
        for (_, _, share), where in zip(corners, index, strict=True):
            found += share[..., None] * table[:, where]
        modes = np.minimum(np.arange(most + 1), references[..., None] - 1)
        return ModeFactors(modes, *np.exp(found))

    def _log_node(self, r: int, node: int, most: int) -> FloatArray:
        """Return the logarithms of the factors of a node, of 0 to ``most`` modes: speckle, white and throughput."""
        known = self._logs.get((r, node, most))
        if known is None:
            known = np.log(np.maximum(self._node(r, node, most), _LEAST_FACTOR))
            self._logs[r, node, most] = known
        return known

    def _node(self, r: int, node: int, most: int) -> FloatArray:
        """Return the factors of 0 to ``most`` modes of one number of references and level of noise."""
        # Some more than are asked for: the next question may ask for them. A node of more modes differs in the last
        # bit, and answers must not depend on what was asked before.
        enough = min(next((step for step in _MODE_STEPS if step >= most), most), r - 1)
        held = self._nodes.get((r, node, enough))
        if held is None:
            held = self._nodes[r, node, enough] = self._computed(r, node, enough)
        # Where there are no more modes, the last one stands for what is missing.
        return held[:, np.minimum(np.arange(most + 1), held.shape[1] - 1)]

    def _computed(self, r: int, node: int, most: int) -> FloatArray:
        """Return the mean factors of several libraries."""
        noise = 10.0 ** (node / _NOISE_STEPS) * self.speckle_rms / np.sqrt(self._weights)
        draws = int(np.clip(_DRAWN_MODES // r, 2, 16))
        return np.asarray(np.mean([self._drawn(r, noise, draw, most) for draw in range(draws)], axis=0))

    def _drawn(self, r: int, noise: float, draw: int, most: int) -> FloatArray:
        """Return the factors of one library of visits with white noise of that rms a pixel, for 0 to ``most`` modes."""
        rng, q, n_visits = stream(SEED, "modes", r, draw), self.variances.size, len(self._visits)
        members = rng.permutation(n_visits)[:r]
        chosen = self._visits[members]
        library = chosen + noise * rng.standard_normal((r, q))
        library -= library.mean(axis=0)
        others = max(self.n_pixels - q, 0)
        beside = noise * rng.standard_normal((r, others))  # noise in directions that no speckles have
        beside -= beside.mean(axis=0)
        most_here = min(most, r - 1)
        values, vectors = np.ones(0), np.ones((r, 0))
        if most_here:
            scatter = library @ library.T + beside @ beside.T
            values, vectors = scipy.linalg.eigh(scatter, subset_by_index=(r - most_here, r - 1), check_finite=False)
        n = int(np.count_nonzero(values > 1e-9 * values[-1:]))
        modes = (vectors[:, ::-1][:, :n] / np.sqrt(values[::-1][:n])).T @ library
        own, planets = (part @ modes.T for part in (self._own, self._planets))
        # All visits, and the references among them: the difference is what the modes have not seen. With x what is
        # taken of a visit, modes change the mean square of sums s by |s - sum of modes|^2: two cumulated products.
        of_modes = modes @ self._squares
        unseen = n_visits * self.variances * modes - (modes @ chosen.T) @ chosen
        twice = np.cumsum((of_modes * unseen).sum(axis=1))
        squares = (of_modes @ modes.T) * (unseen @ modes.T)
        whole = n_visits * float(np.diagonal(self._squares) @ self.variances) - self._sums2[members].sum()
        left = whole - 2.0 * twice + np.diagonal(np.cumsum(np.cumsum(squares, axis=0), axis=1))
        speckle = np.concatenate([[1.0], left / whole])
        # Modes of noise lie in all pixels, also in those directions that no speckles have.
        outside = np.cumsum(np.maximum(1.0 - (modes**2).sum(axis=1), 0.0)) / max(others, 1)
        beyond = self._weights - float(np.trace(self._squares))
        lost = (np.cumsum((of_modes * modes).sum(axis=1)) + beyond * outside) / self._weights
        beyond = (1.0 - (self._own * self._planets).sum(axis=1) / self._light).mean()
        hidden = np.cumsum((own * planets / self._light[:, None]).mean(axis=0)) + beyond * outside
        white, throughput = (1.0 - np.concatenate([[0.0], part]) for part in (lost, hidden))
        # Draws of small fields may end one mode apart: the last stands for what is missing.
        return np.stack([np.pad(part, (0, most - n), "edge") for part in (speckle, white, throughput)])


def _nodes_around(place: FloatArray) -> Iterator[tuple[IntArray, FloatArray]]:
    """Yield the node below and above each place on an axis, with their shares."""
    low = np.floor(place).astype(int)
    for step in (0, 1):
        yield low + step, 1.0 - np.abs(place - low - step)


@dataclass(frozen=True, eq=False)
class BandModes:
    """The factors of modes anywhere in the hole of a band, for visits whose wavefronts are off by so much.

    Attributes
    ----------
    offset_nm : float
        Rms of the wavefront of one visit; without an offset there are no speckles, and no mode changes anything.
    nearest_arcsec, farthest_arcsec, step_arcsec : float
        Separations whose apertures fit into the quadrants, on the diagonal, and the step between fields: half a
        lambda/D.
    """

    _optics: OpticalBand
    offset_nm: float
    nearest_arcsec: float
    farthest_arcsec: float
    step_arcsec: float

    @classmethod
    def of(cls, instrument: Instrument, band: str, offset_nm: float) -> Self:
        """Return the modes of a band.

        Parameters
        ----------
        instrument : Instrument
        band : str
            Name of a band of the instrument, such as ``F520``.
        offset_nm : float
            Rms of the wavefront of one visit, at least 0.
        """
        metrics, optics = psf_metrics(instrument, band), OpticalBand.of(instrument, band)
        margin = metrics.aperture_radius_arcsec
        low, high = metrics.hole_inner_corner_arcsec + 2.0 * margin, metrics.owa_arcsec - margin
        return cls(optics, float(offset_nm), low, max(low, high), 0.5 * metrics.lambda_d_arcsec)

    def around(self, separation_arcsec: float) -> SpeckleModes:
        """Return what modes change around one separation; kept in the cache, of which the last 64 are at hand."""
        return _stored(self._optics, separation_arcsec, self.offset_nm)

    def factors(
        self,
        separation_arcsec: ArrayLike,
        reference_visits: ArrayLike,
        n_modes: int,
        noise_over_speckle: ArrayLike,
        programme_noise: ArrayLike | None = None,
    ) -> ModeFactors:
        """Return what modes change at places, arrays of the shape of all arguments broadcast.

        Parameters
        ----------
        separation_arcsec : array_like
            The field is that of the nearest step.
        reference_visits : array_like
            R, at least 1; more than 1000 are as good as 1000.
        n_modes : int
            K, 0 to 1000; more than R - 1 do not exist.
        noise_over_speckle : array_like
            As of `SpeckleModes.factors`.
        programme_noise : array_like, optional
            White noise over speckles, as rms, in the mean of a programme without modes: with it, K is the most, and the
            number of least limit is taken.

        Raises
        ------
        InputError
            If an argument is out of range.
        """
        k = check_whole("n_modes", n_modes, 0, 1000)
        separation = check_finite("separation_arcsec", separation_arcsec, "arcsec")
        check_whole("reference_visits", float(np.min(reference_visits)), 1, 10**15)
        parts = separation, reference_visits, noise_over_speckle, 0.0 if programme_noise is None else programme_noise
        arrays = np.broadcast_arrays(*(np.asarray(part, float) for part in parts))
        place, references, noise, of_all = (array.ravel() for array in arrays)
        references = np.minimum(references, MOST_REFERENCES).astype(int)
        found = np.concatenate([np.zeros((1, place.size)), np.ones((3, place.size))])
        usable = (np.minimum(k, references - 1) > 0) & (self.offset_nm > 0.0)
        steps = np.round(place / self.step_arcsec) * self.step_arcsec
        nearest = np.clip(steps, self.nearest_arcsec, self.farthest_arcsec)
        for one in np.unique(nearest[usable]):
            here = usable & (nearest == one)
            every = self.around(float(one)).factors(references[here], noise[here], k)
            best = np.full(here.sum(), k) if programme_noise is None else np.argmin(every.limit(of_all[here]), axis=-1)
            found[:, here] = every.at(best)
        numbers, *factors = (part.reshape(arrays[0].shape) for part in found)
        return ModeFactors(numbers.astype(int), *factors)


@functools.lru_cache(maxsize=16)
def _made(wanted: OpticalBand, separation_arcsec: float, offset: float) -> SpeckleModes:
    around = stamps_around(single_band_psf(wanted.band, instrument=wanted.instrument), separation_arcsec)
    linear, square = (part[:, around.inside].astype(float) for part in visit_changes(wanted))
    images = offset * linear + offset**2 * square
    return SpeckleModes(images - images.mean(axis=0), around.apertures, around.own, around.planets)


class _Stored(SpeckleModes):
    """The field around a place, made only where its factors are not in the cache yet."""

    def __init__(self, wanted: OpticalBand, separation_arcsec: float, offset: float) -> None:
        self._place = wanted, separation_arcsec, offset
        self._n_visits, self._nodes, self._logs = N_VISITS, {}, {}

    def _computed(self, r: int, node: int, most: int) -> FloatArray:
        wanted, *place = self._place
        names = "speckle", "white", "throughput"

        def drawn() -> dict[str, FloatArray]:
            return dict(zip(names, _made(wanted, *place)._computed(r, node, most), strict=True))

        key = content_hash({"optics": wanted.key, "place": place, "node": (r, node, most), "schema": _SCHEMA})
        return compute_once(f"modes-{key}", drawn, lambda held: np.stack([held[name] for name in names]))


@functools.lru_cache(maxsize=64)
def _stored(wanted: OpticalBand, separation_arcsec: float, offset: float) -> SpeckleModes:
    return _Stored(wanted, separation_arcsec, offset)
