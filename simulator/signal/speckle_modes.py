"""What a subtraction with modes of many reference visits leaves of speckles, noise and planet, in closed form.

The visits of the optical model tell the covariance of the speckle field. R of them are taken as references with their
modes, and the covariance of the others says what is left. The mean of a Gaussian sample and the modes of its scatter
are independent: the residual of V science and R reference visits is (1/V + 1/R) times one number of R and K.
"""

import functools
from typing import NamedTuple

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, check_finite, check_whole, stream
from simulator.config import Instrument
from simulator.imaging import psf_metrics, single_band_psf
from simulator.signal.speckle_visits import N_VISITS, SEED, OpticalBand, stamps_around, visit_changes

_MOST_SHARE = 2 / 3  # of the visits that may be references: the others tell what is left
_MOST_MODES, _VARIANCE_KEPT = 800, 0.99999
_DRAWN_MODES = 800  # references times draws: as many draws as that takes, 2 to 16
_NOISE_STEPS, _LEAST_NOISE, _MOST_NOISE = 8, 0.01, 30.0  # nodes a decade, and the range outside which nothing changes


class ModeFactors(NamedTuple):
    """What K = 0, 1, ... modes change, arrays whose last axis is K; all 1 at K = 0.

    Attributes
    ----------
    speckle, white : ndarray
        Variance of aperture sums over that without modes: of the speckles of science and reference visits, and of the
        white noise of the science frames.
    throughput : ndarray
        Part of a planet's light that is left.
    """

    speckle: FloatArray
    white: FloatArray
    throughput: FloatArray

    def at(self, n_modes: int) -> "ModeFactors":
        """Return those of so many modes, or of as many as there are."""
        return ModeFactors(*(part[..., min(n_modes, part.shape[-1] - 1)] for part in self))

    def limit(self, noise_over_speckle: ArrayLike) -> FloatArray:
        """Rms of aperture sums over throughput, relative to no modes, with so much white noise.

        Parameters
        ----------
        noise_over_speckle : array_like
            Rms of the white noise in the programme's mean over that of the speckles, both without modes.
        """
        ratio = np.asarray(noise_over_speckle, float)[..., None] ** 2
        left = (self.speckle + ratio * self.white) / (1.0 + ratio)
        return np.asarray(np.sqrt(left) / np.maximum(self.throughput, 1e-12))


class SpeckleModes:
    """Covariance of visits around one place, in its own leading modes; made by `modes_around`.

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
        self.n_pixels = images.shape[1]
        self._apertures, self._own, self._planets = (part @ basis.T for part in (apertures, own, planets))
        self._weights = float((apertures**2).sum(axis=1).mean())
        self._light = (own * planets).sum(axis=1)
        # Rms of aperture sums of one visit.
        self.speckle_rms = float(np.sqrt(((self._apertures**2) @ self.variances).mean()))
        self._nodes: dict[tuple[int, int], ModeFactors] = {}

    def factors(self, reference_visits: int, noise_over_speckle: float) -> ModeFactors:
        """Return the change by 0 to R - 1 modes.

        Parameters
        ----------
        reference_visits : int
            R, 1 to 1000, and at most two thirds of the visits. One has no modes beside its mean.
        noise_over_speckle : float
            Rms of the white noise of one reference visit over that of its speckles, in aperture sums; at least 0. Below
            0.01 and above 30 nothing changes.

        Returns
        -------
        ModeFactors
            Of K = 0 to R - 1; more modes than the field has change nothing.

        Raises
        ------
        InputError
            If an argument is out of range.
        """
        r = check_whole("reference_visits", reference_visits, 1, int(_MOST_SHARE * len(self._visits)))
        noise = float(check_finite("noise_over_speckle", noise_over_speckle))
        if noise < 0.0:
            raise InputError("noise_over_speckle", noise, allowed="at least 0")
        place = _NOISE_STEPS * np.log10(np.clip(noise, _LEAST_NOISE, _MOST_NOISE))
        low = int(np.floor(place))
        nodes = [self._node(r, node) for node in ([low] if place == low else [low, low + 1])]
        return ModeFactors(*(parts[0] + (place - low) * (parts[-1] - parts[0]) for parts in zip(*nodes, strict=True)))

    def _node(self, r: int, node: int) -> ModeFactors:
        if (r, node) not in self._nodes:
            noise = 10.0 ** (node / _NOISE_STEPS) * self.speckle_rms / np.sqrt(self._weights)
            draws = int(np.clip(_DRAWN_MODES // r, 2, 16))
            drawn = [self._drawn(r, noise, draw) for draw in range(draws)]
            self._nodes[r, node] = ModeFactors(*(np.mean(part, axis=0) for part in zip(*drawn, strict=True)))
        return self._nodes[r, node]

    def _drawn(self, r: int, noise: float, draw: int) -> ModeFactors:
        """Factors of one library of visits with white noise of that rms a pixel."""
        rng, root, q = stream(SEED, "modes", r, draw), np.sqrt(self.variances), self.variances.size
        n_visits = len(self._visits)
        chosen = self._visits[rng.permutation(n_visits)[:r]]
        library = chosen + noise * rng.standard_normal((r, q))
        library -= library.mean(axis=0)
        others = max(self.n_pixels - q, 0)
        beside = noise * rng.standard_normal((r, others))  # noise in directions that no speckles have
        beside -= beside.mean(axis=0)
        values, vectors = np.linalg.eigh(library @ library.T + beside @ beside.T)
        n = int(np.count_nonzero(values[1:] > 1e-9 * values[-1]))
        modes = (vectors[:, ::-1][:, :n] / np.sqrt(values[::-1][:n])).T @ library
        on_modes, own, planets = (part @ modes.T for part in (self._apertures, self._own, self._planets))
        # All visits, and the references among them: the difference is what the modes have not seen.
        speckle, everything, seen = np.empty(n + 1), self._apertures * root, self._apertures @ chosen.T
        of_everything, of_seen = modes * root, modes @ chosen.T
        for k in range(n + 1):
            if k:
                everything -= on_modes[:, k - 1, None] * of_everything[k - 1]
                seen -= on_modes[:, k - 1, None] * of_seen[k - 1]
            square = n_visits * (everything**2).sum(axis=1) - (seen**2).sum(axis=1)
            speckle[k] = square.mean() / (n_visits - r)
        # Modes of noise lie in all pixels, also in those directions that no speckles have.
        outside = np.cumsum(np.maximum(1.0 - (modes**2).sum(axis=1), 0.0)) / max(others, 1)
        beyond = self._weights - (self._apertures**2).sum(axis=1).mean()
        lost = (np.cumsum((on_modes**2).mean(axis=0)) + beyond * outside) / self._weights
        beyond = (1.0 - (self._own * self._planets).sum(axis=1) / self._light).mean()
        hidden = np.cumsum((own * planets / self._light[:, None]).mean(axis=0)) + beyond * outside
        white, throughput = (1.0 - np.concatenate([[0.0], part]) for part in (lost, hidden))
        # Draws of small fields may end one mode apart: the last stands for what is missing.
        filled = (np.pad(part, (0, r - 1 - n), "edge") for part in (speckle / speckle[0], white, throughput))
        return ModeFactors(*filled)

    def best_modes(self, reference_visits: int, noise_over_speckle: float, programme_noise: float | None = None) -> int:
        """Return the number of modes of least limit, 0 where none pays.

        Parameters
        ----------
        reference_visits, noise_over_speckle
            As of `factors`.
        programme_noise : float, optional
            White noise over speckles, as rms, in the mean of the whole programme; that of a visit by default, which it
            is where white noise and speckles average alike.
        """
        found = self.factors(reference_visits, noise_over_speckle)
        return int(np.argmin(found.limit(noise_over_speckle if programme_noise is None else programme_noise)))


def modes_around(instrument: Instrument, band: str, separation_arcsec: float, offset_nm: float) -> SpeckleModes:
    """Return the speckle field around a separation, for visits whose wavefronts are off by so much.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Name of a band of the instrument, such as ``F520``.
    separation_arcsec : float
        Within the hole.
    offset_nm : float
        Rms of the wavefront of one visit, above 0.

    Returns
    -------
    SpeckleModes
        The last 16 are kept; visits of the optical model are measured once, some ten seconds for a band, and kept in
        the cache.

    Raises
    ------
    InputError
        If an argument is out of range, or the band has no optical model.
    """
    offset = float(check_finite("offset_nm", offset_nm, "nm"))
    if offset <= 0.0:
        raise InputError("offset_nm", offset, unit="nm", allowed="above 0")
    separation = float(check_finite("separation_arcsec", separation_arcsec, "arcsec"))
    return _made(OpticalBand.of(instrument, band), separation, offset)


def mode_factors(
    instrument: Instrument,
    band: str,
    separation_arcsec: ArrayLike,
    offset_nm: float,
    reference_visits: int,
    n_modes: int,
    noise_over_speckle: ArrayLike,
) -> ModeFactors:
    """Return what so many modes change at places, arrays of the shape of separations and noise, broadcast.

    Parameters
    ----------
    instrument, band, offset_nm
        As of `modes_around`; without an offset there are no speckles, and no mode changes anything.
    separation_arcsec : array_like
        The field is that of the nearest half lambda/D, inside the hole.
    reference_visits, noise_over_speckle
        As of `SpeckleModes.factors`; the noise broadcasts with the separations.
    n_modes : int
        K, at least 0; more than R - 1 do not exist.

    Raises
    ------
    InputError
        If an argument is out of range, or the band has no optical model.
    """
    k = check_whole("n_modes", n_modes, 0, 1000)
    references = check_whole("reference_visits", reference_visits, 1, int(_MOST_SHARE * N_VISITS))
    place, noise = np.broadcast_arrays(
        check_finite("separation_arcsec", separation_arcsec, "arcsec"), noise_over_speckle
    )
    found = np.ones((3, *place.shape))
    if min(k, references - 1) > 0 and offset_nm > 0.0:
        metrics = psf_metrics(instrument, band)
        step, margin = 0.5 * metrics.lambda_d_arcsec, metrics.aperture_radius_arcsec
        # Of the places whose aperture fits into the quadrants, on the diagonal.
        low, high = metrics.hole_inner_corner_arcsec + 2.0 * margin, metrics.owa_arcsec - margin
        nearest = np.clip(np.round(place / step) * step, low, max(low, high))
        for index in np.ndindex(place.shape):
            modes = modes_around(instrument, band, float(nearest[index]), offset_nm)
            found[(slice(None), *index)] = modes.factors(references, float(noise[index])).at(k)
    return ModeFactors(*found)


@functools.lru_cache(maxsize=16)
def _made(wanted: OpticalBand, separation_arcsec: float, offset: float) -> SpeckleModes:
    around = stamps_around(single_band_psf(wanted.band, instrument=wanted.instrument), separation_arcsec)
    linear, square = (part[:, around.inside].astype(float) for part in visit_changes(wanted))
    images = offset * linear + offset**2 * square
    return SpeckleModes(images - images.mean(axis=0), around.apertures, around.own, around.planets)
