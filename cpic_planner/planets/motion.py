"""Motion of planets within a programme: the days that it spans, how far they go, and what a stack loses of them.

A stack of visits that looks for unknown planets shifts its images along orbits and pays for the trials. While a planet
has not gone far round its star, its path is a straight line, and the orbits are velocities. Planets at a known place
are on known orbits, which the stack follows: they cost nothing.
"""

import functools
import math
from typing import NamedTuple, Self

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, check_finite, special

MOST_SHIFT_LAMBDA_D = 0.3
"""A planet that goes farther within a programme moves; and a searched orbit stays as near to the planet's own."""
ORBIT_DUTY = 0.46
"""Part of the calendar time in which a target is seen from a low orbit, where no calendar says it: 42 of 92 minutes."""
_APERTURE_LAMBDA_D = 0.7
# The image behind the shipped apodizer of four quadrants is that of a clear pupil of this diameter, relative to the
# telescope's: light beside the middle to 0.3 %, roughness to 3 % in F520, F662 and F850.
_PUPIL = 0.65
_FARTHEST_LAMBDA_D, _N_PLACES = 40.0, 2001


def span_days(time_s: ArrayLike, visits: ArrayLike, gap_h: ArrayLike = 0.0, duty: ArrayLike = ORBIT_DUTY) -> FloatArray:
    """Return the days from the begin of the first visit to the end of the last.

    Parameters
    ----------
    time_s : array_like
        Of all visits together, references and overheads included; at least 0.
    visits : array_like
        Number of visits, at least 1.
    gap_h : array_like
        Between the end of a visit and the begin of the next, at least 0.
    duty : array_like
        Part of the calendar time that is observed within a visit, above 0 and at most 1.

    Raises
    ------
    InputError
        If an argument is out of range.
    """
    time, many, gap, part = in_range(time_s=time_s, visits=visits, gap_h=gap_h, duty=duty)
    return time / part / 86400.0 + (many - 1.0) * gap / 24.0


_RANGES = {
    "time_s": ("s", 0.0, math.inf, "at least 0"),
    "visits": ("", 1.0, math.inf, "at least 1"),
    "gap_h": ("h", 0.0, math.inf, "at least 0"),
    "duty": ("", 1e-6, 1.0, "above 0 and at most 1"),
    "sigma": ("sigma", 1.0, 20.0, "from 1 to 20"),
    "separation_arcsec": ("arcsec", 1e-6, math.inf, "above 0"),
    "distance_pc": ("pc", 1e-6, math.inf, "above 0"),
    "star_mass_msun": ("M_Sun", 1e-6, math.inf, "above 0"),
    "lambda_d_arcsec": ("arcsec", 1e-6, math.inf, "above 0"),
}


def in_range(**values: ArrayLike) -> list[FloatArray]:
    """Return arguments as arrays, or refuse the first that is out of range.

    Parameters
    ----------
    **values
        Numbers by the names that the functions of motion have for them.
    """
    arrays = []
    for key, value in values.items():
        unit, low, high, allowed = _RANGES[key]
        array = check_finite(key, value, unit)
        wrong = (array < low) | (array > high)
        if wrong.any():
            raise InputError(key, float(array[wrong][0]), unit=unit, allowed=allowed)
        arrays.append(array)
    return arrays


class ApertureTrack(NamedTuple):
    """Offsets from 0 in lambda/D, light there relative to offset 0, its integral, and roughness of matched noise."""

    offset: FloatArray
    light: FloatArray
    along: FloatArray
    roughness: float


def _quadrature(count: int, low: float, high: float) -> FloatArray:
    """Return the nodes and weights of Fejer's first rule between two numbers, (2, count).

    Notes
    -----
    For smooth functions as exact as Gauss's, and no eigenvalues: Waldvogel (2006, BIT 46, 195), equation 2.
    """
    angle, order = np.pi * (np.arange(count) + 0.5) / count, np.arange(1, count // 2 + 1)
    weight = (1.0 - 2.0 * np.cos(2.0 * order * angle[:, None]) @ (1.0 / (4.0 * order**2 - 1.0))) / count
    return np.stack([low + (high - low) * (1.0 + np.cos(angle)) / 2.0, (high - low) * weight])


@functools.cache
def aperture_track() -> ApertureTrack:
    """Return how the light in an aperture falls beside the middle of an image, and the roughness of matched noise.

    Of the image of a clear round pupil that is as wide as that of the apodizer. The light in an aperture whose centre
    is beside the image's is the integral of the transfer function with that of the aperture; white noise that is
    filtered with the image has the square of the transfer function as its power spectrum, and minus the curvature of
    its correlation is the roughness.
    """
    angle, weight = _quadrature(150, 0.0, math.pi / 2.0)  # frequencies are its cosine: what is integrated has no corner
    transfer, frequency = weight * np.sin(angle) * (angle - 0.5 * np.sin(2.0 * angle)), _PUPIL * np.cos(angle)
    offset = _FARTHEST_LAMBDA_D * np.linspace(0.0, 1.0, _N_PLACES) ** 2  # closer where the light falls first
    aperture = transfer * special().j1(2.0 * np.pi * _APERTURE_LAMBDA_D * frequency)
    light = special().j0(2.0 * np.pi * offset[:, None] * frequency) @ aperture
    along = np.concatenate([[0.0], np.cumsum((light[1:] + light[:-1]) * np.diff(offset) / 2.0)]) / light[0]
    power = transfer * (angle - 0.5 * np.sin(2.0 * angle)) * frequency
    roughness = 2.0 * np.pi**2 * float((power * frequency**2).sum() / power.sum())
    return ApertureTrack(offset, light / light[0], along, roughness)


_SPEED_AU_DAY = 2.0 * math.pi / 365.25  # of a circular orbit of 1 au around 1 solar mass
_BENDS = np.concatenate([[0.0], np.geomspace(1e-2, 40.0, 200)])
_WAYS = np.concatenate([[0.0], np.geomspace(1e-2, 1e6, 1000)])
_ITERATIONS, _LONGEST_DAYS, _FEW = 30, 1e9, 2000
# A search at rest keeps planets up to this way within 0.3 lambda/D, on whatever bound orbit they are.
_RESTING = math.sqrt(2.0) * MOST_SHIFT_LAMBDA_D


@functools.cache
def _along_a_bend() -> FloatArray:
    """Return the part of the light that an aperture keeps on the best line beside an arc that bends by `_BENDS`."""
    kink, track = math.sqrt(0.125), aperture_track()
    time, weight = np.concatenate([_quadrature(100, 0.0, kink), _quadrature(100, kink, 0.5)], axis=1)
    off = np.abs(8.0 * time**2 - 1.0)
    return np.asarray(np.interp(_BENDS[:, None] * off, track.offset, track.light) @ (2.0 * weight))


_SMEARS = (0.0718581003869122, 0.0009736586569963758, 0.0001017201519227341)
"""Coefficients of ``1 / kept(s) - 1`` in ``s^2``, ``s^4``, ``s^6`` up to 0.6 lambda/D, to 1e-6: a fit to the part of a
planet's light that its aperture gets along a straight line of length s, the mean of `aperture_track` up to s / 2, which
the tests repeat (it takes as long as all else that a cold answer computes)."""


@functools.lru_cache(maxsize=16)
def _levels_of_ways(sigma: float) -> FloatArray:
    """Return the significance with the false alarms of ``sigma`` at rest, of searches of fastest planets `_WAYS`."""
    alone, level, way = special().ndtr(-sigma), np.full(_WAYS.shape, sigma), _WAYS
    for _ in range(_ITERATIONS):  # the number of trials depends on the threshold as its square
        edge = math.sqrt(math.pi / 2.0) * way * (level**2 - 1.0) / level
        trials = 1.0 + edge + way**2 * np.maximum(level**2 - 3.0, 0.0) / 2.0
        level = -special().ndtri(alone / trials)
    return np.asarray(level)


def _squares(steps: FloatArray) -> FloatArray:
    """Return the squares that a disc touches whose radius is so many halves of their diagonals."""
    return 1.0 + 2.0 * math.sqrt(2.0) * steps + math.pi / 2.0 * steps**2


class OrbitSearch(NamedTuple):
    """A search that knows no place, around stars; arrays broadcast. Made by `of`.

    Attributes
    ----------
    speed : ndarray
        Of a planet on a circular orbit seen from its pole, lambda/D a day.
    bend : ndarray
        Its acceleration, lambda/D a day squared.
    gap_h : float
        From the end of a visit to the begin of the next.
    duty : float
        Part of the calendar time that is observed within a visit.
    sigma : float
        Gaussian significance whose false alarms a search at rest may have.
    """

    speed: FloatArray
    bend: FloatArray
    gap_h: float = 0.0
    duty: float = ORBIT_DUTY
    sigma: float = 5.0

    @classmethod
    def of(
        cls,
        separation_arcsec: ArrayLike,
        distance_pc: ArrayLike,
        star_mass_msun: ArrayLike,
        lambda_d_arcsec: ArrayLike,
        **how: float,
    ) -> Self:
        """Return the search at places of stars.

        Parameters
        ----------
        separation_arcsec : array_like
            Projected; the planet is at least that far from its star.
        distance_pc, star_mass_msun, lambda_d_arcsec : array_like
            Of the star, and the resolution of the band; above 0.
        **how
            ``gap_h``, ``duty`` and ``sigma`` (1 to 20), as of the attributes.

        Raises
        ------
        InputError
            If an argument is out of range.
        """
        place, distance, mass, width = in_range(
            separation_arcsec=separation_arcsec,
            distance_pc=distance_pc,
            star_mass_msun=star_mass_msun,
            lambda_d_arcsec=lambda_d_arcsec,
        )
        in_range(**how)
        radius = place * distance
        speed = _SPEED_AU_DAY * np.sqrt(mass / radius) / (distance * width)
        return cls(speed, _SPEED_AU_DAY**2 * mass / radius**2 / (distance * width), **how)

    def span_days(self, visits: ArrayLike, visit_time_s: ArrayLike) -> FloatArray:
        """Return the days from the begin of the first visit to the end of the last.

        Parameters
        ----------
        visits, visit_time_s : array_like
            Number and wall time of the visits; nothing is refused here, and endless ones take 1e9 days.
        """
        many = np.asarray(visits, float)
        days = np.minimum(many * np.asarray(visit_time_s, float) / (86400.0 * self.duty), _LONGEST_DAYS)
        return np.asarray(days if self.gap_h == 0.0 else days + (many - 1.0) * (self.gap_h / 24.0))

    def threshold_factor(self, visits: ArrayLike, visit_time_s: ArrayLike) -> FloatArray:
        """Return the factor by which motion raises the significance that a search asks for, at least 1.

        Parameters
        ----------
        visits, visit_time_s : array_like
            Number and wall time of the visits; broadcast with the places.

        Returns
        -------
        ndarray
            The significance with the false alarms of the one at rest, over it and over the least part of the signal
            that the searched orbit next to the planet's own keeps: for the threshold of any search, whose law gives the
            significance at rest. It grows with the span, without jumps.

        Notes
        -----
        A planet that is bound moves by at most ``sqrt(2 G M / r)`` with r the projected distance: the search covers
        this disc of velocities with squares whose corners are off by 0.3 lambda/D at both ends of the programme, some
        ``n(q) = 1 + 2 sqrt(2) q + pi q^2 / 2`` of them with q the way of the fastest from the middle date over 0.3
        lambda/D. Neighbouring velocities share most of their noise. The mean number of peaks of a Gaussian field over
        position and velocity is that over position alone times ``1 + sqrt(c) pi w (u^2 - 1) / (u sqrt(2 pi)) + c w^2
        (u^2 - 3) / 2`` at a threshold u, with c the roughness of the noise and w the way of the fastest in the rms
        distance of the light from its middle date (Adler & Taylor 2007, Random Fields and Geometry, section 11.8);
        there are never more trials than ``n(q - 1)``, orbits beyond the one at rest. Simulated searches of noise have
        0.7 to 1 times as many, a difference of a twentieth of a sigma. The threshold solves ``n(s') Phi(-s') =
        Phi(-s)``. A parabola bends by ``b = a T^2 / 16`` from the best line, on which an aperture keeps the mean of its
        light at ``b |8 t^2 / T^2 - 1|``: a search over straight lines loses planets that go round.
        """
        span = self.span_days(visits, visit_time_s)
        shift = self.speed * span
        square = np.minimum(shift, 2.0 * MOST_SHIFT_LAMBDA_D) ** 2
        one, two, three = _SMEARS
        factor = np.asarray(1.0 + square * (one + square * (two + square * three)))
        far = shift > _RESTING
        if far.any():
            parts = np.asarray(visits, float), span, self.speed, self.bend
            few = factor.size < _FEW  # to pick them out costs more than all of a few
            many, days, speed, bend = parts if few else (np.broadcast_to(part, factor.shape)[far] for part in parts)
            more = self._level(many, days, speed) / self.sigma / _bent(bend * days**2 / 16.0)
            if few:
                np.multiply(factor, more, out=factor, where=far)
            else:
                factor[far] *= more
        return factor

    def _level(self, visits: FloatArray, span: FloatArray, speed: FloatArray) -> FloatArray:
        """Return the significance with the false alarms of the one at rest, for planets that may leave their place."""
        fastest, gap = math.sqrt(2.0) * speed, self.gap_h / 24.0
        spread = span / math.sqrt(12.0)
        if gap > 0.0:
            visit = (span - (visits - 1.0) * gap) / visits
            spread = np.sqrt(((visit + gap) ** 2 * (visits**2 - 1.0) + visit**2) / 12.0)
        way = math.sqrt(aperture_track().roughness) * fastest * spread
        beyond = np.maximum(fastest * span / (2.0 * MOST_SHIFT_LAMBDA_D) - 1.0, 0.0)
        most = -special().ndtri(special().ndtr(-self.sigma) / _squares(beyond))
        return np.asarray(np.minimum(np.interp(way, _WAYS, _levels_of_ways(self.sigma)), most))

    def n_orbits(self, visits: ArrayLike, visit_time_s: ArrayLike) -> FloatArray:
        """Return the velocities that a search goes through; parameters as of `threshold_factor`."""
        steps = self.speed * self.span_days(visits, visit_time_s) / _RESTING
        return np.asarray(np.where(steps > 1.0, np.ceil(_squares(steps)), 1.0))


def _bent(bend_lambda_d: FloatArray) -> FloatArray:
    """Return the part of the light that is kept on the best line beside an arc that bends off it by so much."""
    bend = np.maximum(bend_lambda_d, 1e-300)
    near = np.minimum(bend, _BENDS[-1])
    return np.asarray(np.interp(near, _BENDS, _along_a_bend()) * near / bend)
