"""Speckles of many visits of the optical model: their covariance, and what modes or weights leave of them.

The visits tell the covariance of the speckle field. R of them are taken as references with their modes, and the
covariance of the others says what is left. The mean of a Gaussian sample and the modes of its scatter are independent:
the residual of V science and R reference visits is (1/V + 1/R) times one number of R and K.

A sum that is weighed with the inverse of the covariance looks for a planet where it can be told from speckles: the
least noise that is possible if the covariance is right. It takes for granted that the model is that of this very
instrument: most of the covariance is the static field in the dark hole, crossed with the errors of the wavefront.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import field
from typing import Any, NamedTuple, Self

import numpy as np
import scipy

from cpic_core import (
    ArrayLike,
    BoolArray,
    FloatArray,
    InputError,
    IntArray,
    Record,
    announce,
    check_finite,
    check_whole,
    compute_once,
    stream,
)
from simulator.config import Instrument, content_hash
from simulator.imaging import Psf, centred_axis, metrics_key, overlap_weights, psf_metrics, single_band_psf, visit_light

REGION_LAMBDA_D = 2.4
"""Half width of the annulus around a place whose speckles count: those of the whole hole are its inner corner's."""
N_VISITS, SEED = 1500, 101
_NEAR_LAMBDA_D, _N_APERTURES, _N_PLANETS = 1.5, 300, 48


class OpticalBand(Record):
    """A band that counts as equal to any other of its key."""

    instrument: Instrument = field(compare=False)
    band: str = field(compare=False)
    key: str

    @classmethod
    def of(cls, instrument: Instrument, band: str) -> Self:
        """Return the band with everything that decides its visits."""
        slope = instrument.drift.psd_slope
        parts = {"optics": metrics_key(instrument, band), "slope": slope, "visits": N_VISITS, "seed": SEED, "schema": 2}
        return cls(instrument, band, content_hash(parts))


@functools.lru_cache(maxsize=4)
def visit_changes(wanted: OpticalBand) -> tuple[FloatArray, FloatArray]:
    """Return how the star's image in the dark hole changes with visits whose wavefronts are off by 1 nm.

    Returns
    -------
    linear, square : ndarray, shape (n, p)
        ``2 Re(E0* dE)`` and ``|dE|^2`` of n visits in the p pixels of the hole, in the order of the stamp, single
        precision, as part of the star's light on the clear disc: an offset of ``o`` nm changes the image by
        ``o linear + o^2 square``. Drawn once (`simulator.imaging.visit_light`) and kept in the cache.

    Raises
    ------
    InputError
        If the band has no optical model.
    """

    def measured() -> dict[str, Any]:
        announce(f"drawing how {N_VISITS} visits move the speckles in {wanted.band}, once: some seconds")
        psf = single_band_psf(wanted.band, instrument=wanted.instrument)
        slope = wanted.instrument.drift.psd_slope
        _, linear, square = hole_changes(psf, slope, N_VISITS, stream(SEED, "visits"))
        return {"linear": linear, "square": square}

    return compute_once(f"visits-{wanted.key}", measured, lambda found: (found["linear"], found["square"]))


def hole_changes(psf: Psf, psd_slope: float, count: int, rng: np.random.Generator) -> tuple[FloatArray, Any, Any]:
    """Return the star in the pixels of the dark hole, and what wavefront errors of 1 nm rms change of it.

    Parameters
    ----------
    psf : Psf
    psd_slope : float
        Exponent of the power spectrum of the errors.
    count : int
        Number of errors.
    rng : numpy.random.Generator

    Returns
    -------
    static : ndarray, shape (p,)
        In the order of the stamp, as part of the star's light on the clear disc.
    linear, square : ndarray, shape (count, p)
        As of `visit_changes`, in single precision.
    """
    hole, imager = psf.geometry.hole, psf.imager
    rows, columns = (np.flatnonzero(hole.any(axis=axis)) for axis in (1, 0))
    offset = centred_axis(len(hole), imager.pixel_scale_arcsec)
    y, x = (imager.axis(offset[part], masked=True) for part in (rows, columns))
    light, inside = visit_light(imager, y, x, psd_slope), hole[np.ix_(rows, columns)]
    linear, square = light.changes(np.stack([light.draw(rng, 1.0)[None] for _ in range(count)]))
    return light.static[inside], linear[:, inside], square[:, inside]


class Stamps(NamedTuple):
    """Sums and planets around a separation, as rows of the p pixels of its annulus.

    Attributes
    ----------
    inside : ndarray of bool
        Which pixels of the hole are those of the annulus.
    apertures : ndarray, shape (a, p)
        Weights of apertures within 1.5 lambda/D of the separation, the mean of them all taken off.
    own, planets : ndarray, shape (m, p)
        Weights of the apertures nearest to it, and the images of planets in their middles.
    mean : ndarray, shape (p,)
        What was taken off.
    """

    inside: BoolArray
    apertures: FloatArray
    own: FloatArray
    planets: FloatArray
    mean: FloatArray


def stamps_around(psf: Psf, separation_arcsec: float) -> Stamps:
    """Return sums and planets around a separation.

    Raises
    ------
    InputError
        If fewer than two whole apertures fit there.
    """
    geometry = psf.geometry
    region = geometry.annulus(separation_arcsec, REGION_LAMBDA_D)
    weights, planet = overlap_weights(geometry.aperture_radius_arcsec / geometry.pixel_scale_arcsec), psf.off_axis
    rows, columns = _whole(region, weights)
    if rows.size < 2:
        inner, outer = geometry.zone.inner_arcsec, geometry.zone.outer_arcsec
        allowed = f"with whole apertures inside the dark quadrants, {inner:.3g} to {outer:.3g} arcsec along an axis"
        raise InputError("separation_arcsec", separation_arcsec, unit="arcsec", allowed=allowed)
    offsets = centred_axis(len(region), geometry.pixel_scale_arcsec)
    distance = np.abs(np.hypot(offsets[rows], offsets[columns]) - separation_arcsec)
    near = np.flatnonzero(distance <= _NEAR_LAMBDA_D * geometry.lambda_d_arcsec)
    near = near if near.size > 1 else np.argsort(distance, kind="stable")[:2]
    nearest = np.argsort(distance, kind="stable")[:_N_PLANETS]

    def stamped(index: IntArray, stamp: FloatArray) -> FloatArray:
        return np.array([placed(region.shape, stamp, rows[i], columns[i])[region] for i in index])

    every = stamped(near, weights)
    chosen, mean = np.unique(np.linspace(0, len(every) - 1, _N_APERTURES).astype(int)), every.mean(axis=0)
    return Stamps(
        inside=region[geometry.hole],
        apertures=every[chosen] - mean,
        own=stamped(nearest, weights),
        planets=stamped(nearest, planet),
        mean=mean,
    )


def _whole(region: BoolArray, weights: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the rows and columns of pixels whose aperture lies wholly in a region."""
    half = len(weights) // 2
    fits = np.ones(region.shape, bool)
    padded = np.pad(region, half)
    for dy, dx in np.argwhere(weights > 0):
        fits &= padded[dy : dy + len(region), dx : dx + len(region)]
    rows, columns = np.nonzero(fits)
    return rows, columns


def placed(shape: tuple[int, int], stamp: FloatArray, row: int, column: int) -> FloatArray:
    """Return an image with the middle pixel of a stamp at a place, 0 where it does not reach.

    Parameters
    ----------
    shape : tuple of int
        Shape (y, x) of the image.
    stamp : ndarray
        Odd sides.
    row, column : int
        Place of its middle pixel, in the image.
    """
    image, half = np.zeros(shape), len(stamp) // 2
    low = [max(place - half, 0) for place in (row, column)]
    high = [min(place - half + size, side) for place, size, side in zip((row, column), stamp.shape, shape, strict=True)]
    to = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    image[to] = stamp[
        tuple(slice(s.start - p + half, s.stop - p + half) for s, p in zip(to, (row, column), strict=True))
    ]
    return image


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
_FURTHER = np.geomspace(_EVERY, MOST_REFERENCES, 16).round().astype(int).tolist()
_REFERENCES = np.array(sorted({*range(1, _EVERY + 1), *_FURTHER}))


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

    def at(self, n_modes: ArrayLike) -> ModeFactors:
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


class BandModes(Record, eq=False):
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


LEAST_NOISE = 0.01
"""White noise of a pixel over the rms of its speckles, at least: below, chance in the visits would pass for order."""


class Whitening:
    """Pixels in units in which their noise is white and of variance 1.

    Parameters
    ----------
    covariance : ndarray, shape (p, p)
        Of the noise, positive definite.
    beside : ndarray, shape (k, p)
        Images of unknown strength that are fitted too: nothing of them is left.

    Raises
    ------
    InputError
        If the covariance is not positive definite.

    Notes
    -----
    A source of image t in an image x: the whitened images ``t' = L^-1 t``, ``x' = L^-1 x`` with ``L L^T`` the
    covariance, without their parts along the whitened ``beside``, tell its strength ``t' x' / t' t'`` with the error
    ``(t' t')^-1/2``. It is the estimate of generalised least squares, of which no linear one is better (Aitken 1936).
    """

    def __init__(self, covariance: FloatArray, beside: FloatArray) -> None:
        from scipy.linalg import cholesky

        try:
            self._root = cholesky(covariance, lower=True, check_finite=False)
        except np.linalg.LinAlgError:
            raise InputError("covariance", "singular", allowed="positive definite") from None
        self._beside = _orthonormal(self._solved(np.asarray(beside, float)))

    def of(self, images: FloatArray) -> FloatArray:
        """Return images whitened, without what is beside; shape (..., p).

        Parameters
        ----------
        images : ndarray, shape (..., p)
        """
        rows = self._solved(np.atleast_2d(images))
        rows -= (rows @ self._beside.T) @ self._beside
        return rows.reshape(np.shape(images))

    def weights(self, images: FloatArray) -> FloatArray:
        """Return the weights of the sums that tell the strength of sources of these images, one each; shape (..., p).

        Parameters
        ----------
        images : ndarray, shape (..., p)
        """
        from scipy.linalg import solve_triangular

        seen = self.of(images)
        back = solve_triangular(self._root, seen.T, lower=True, trans="T", check_finite=False).T
        return np.asarray(back / (seen**2).sum(axis=-1, keepdims=True))

    def _solved(self, rows: FloatArray) -> FloatArray:
        from scipy.linalg import solve_triangular

        return np.ascontiguousarray(solve_triangular(self._root, rows.T, lower=True, check_finite=False).T)


def _orthonormal(rows: FloatArray) -> FloatArray:
    """Return the orthonormal rows that span what these do."""
    if not len(rows):
        return rows
    _, singular, basis = np.linalg.svd(rows, full_matrices=False)
    return np.asarray(basis[singular > 1e-9 * singular[0]])


def speckle_covariance(
    instrument: Instrument, band: str, separation_arcsec: float, linear_nm2: float, square_nm4: float
) -> FloatArray:
    """Return the covariance of speckles around a separation, in units of (star light on the clear disc)^2.

    Parameters
    ----------
    instrument : Instrument
        Whose static field, mirror and spectrum of drift are taken for granted.
    band : str
        Name of a band of the instrument, such as ``F520``.
    separation_arcsec : float
    linear_nm2, square_nm4 : float
        Factors of the covariance of ``2 Re(E0* dE)`` and of ``|dE|^2``, each at 1 nm: offset squared and to the fourth
        for one visit, and those of `unit_parts` for a programme.

    Returns
    -------
    ndarray, shape (p, p)
        Of the pixels of the hole within 2.4 lambda/D of the separation, in the order of the stamp; read-only.

    Notes
    -----
    The two parts do not go together for errors with a normal distribution: their product is odd in the errors. They
    are measured apart on the visits of `visit_changes`, the mean over the visits taken off.
    """
    band_of = OpticalBand.of(instrument, band)
    return _covariance(band_of, float(separation_arcsec), float(linear_nm2), float(square_nm4))


@functools.lru_cache(maxsize=4)
def _covariance(wanted: OpticalBand, separation_arcsec: float, linear_nm2: float, square_nm4: float) -> FloatArray:
    geometry = single_band_psf(wanted.band, instrument=wanted.instrument).geometry
    inside = geometry.annulus(separation_arcsec, REGION_LAMBDA_D)[geometry.hole]
    found = np.zeros((np.count_nonzero(inside),) * 2)
    if linear_nm2 > 0.0 or square_nm4 > 0.0:
        changes = visit_changes(wanted)
        for factor, part in zip((linear_nm2, square_nm4), changes, strict=True):
            images = part[:, inside].astype(float)
            images -= images.mean(axis=0)
            found += (factor / len(images)) * (images.T @ images)
    found.flags.writeable = False
    return found


def with_noise(covariance: FloatArray, white_variance: ArrayLike) -> FloatArray:
    """Return the covariance of speckles and white noise.

    Parameters
    ----------
    covariance : ndarray, shape (p, p)
        Of the speckles.
    white_variance : array_like
        Of every pixel, broadcasts to (p,); at least 0. No less is taken than 1e-4 of the mean variance of the speckles,
        and where there is neither, 1.
    """
    whole = np.array(covariance)
    least = LEAST_NOISE**2 * float(np.trace(whole)) / len(whole)
    white = np.maximum(np.broadcast_to(white_variance, len(whole)), least)
    whole[np.diag_indices_from(whole)] += white if white.any() else 1.0
    return whole
