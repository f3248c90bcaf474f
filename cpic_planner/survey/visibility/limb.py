"""The part of an orbit during which a target stands clear of the Earth.

At the place ``u`` of a circular orbit the target stands ``zeta`` from the zenith ``z``, with
``cos(zeta) = cos(beta) cos(u - u0)`` where ``beta`` is its angle from the plane of the orbit, and
``l = 180 deg - rho - zeta`` from the limb of the Earth, whose angular radius is ``rho``. The limb's nearest point lies
in the plane of zenith and target: the line of sight that touches the Earth below the target does so at
``P = R (sin(rho) z + cos(rho) h)``, ``h`` being horizontal towards the target. The Sun ``s`` has risen there if
``P . s > 0``, which with ``h = (t - cos(zeta) z) / sin(zeta)`` is

    ``cos(l) (z . s) + cos(rho) (t . s) > 0``.

A place counts if ``l`` reaches the limit for a dark limb and, where that point is sunlit, the limit for a bright one.
So an orbit has a *core* around ``u0`` that always counts, two *flanks* beside it that count while their limb is dark,
and the rest, which never does. The ends of the dark pieces of a flank are those of parabolas through the expression
above at places not more than `STEP_DEG` apart.
"""

import math
from dataclasses import dataclass

import numpy as np

from cpic_core import FloatArray, NDArray

STEP_DEG = 1.5
# Pieces of a flank come in multiples of this many, each with a parabola over two steps.
_WIDTHS = 4
_BLOCK_CELLS = 50_000
_TINY = 1e-300


@dataclass(frozen=True, eq=False)
class Geometry:
    """Targets, orbits and Suns, arrays of one length.

    Attributes
    ----------
    in_plane : ndarray
        Cosine of the target's angle from the plane of the orbit.
    sun_ahead, sun_aside : ndarray
        Cosines between the Sun and the direction in that plane nearest to the target, and a quarter of a revolution on.
    sun_target : ndarray
        Cosine between Sun and target.
    """

    in_plane: FloatArray
    sun_ahead: FloatArray
    sun_aside: FloatArray
    sun_target: FloatArray

    def take(self, rows: NDArray[np.intp]) -> "Geometry":
        """Return some of them."""
        return Geometry(self.in_plane[rows], self.sun_ahead[rows], self.sun_aside[rows], self.sun_target[rows])


@dataclass(frozen=True, eq=False)
class _Runs:
    """The lengths in a piece of orbit, radians: all of it, at its begin, at its end, the longest run; its length."""

    total: FloatArray
    begin: FloatArray
    end: FloatArray
    longest: FloatArray
    length: FloatArray

    def then(self, other: "_Runs") -> "_Runs":
        """Join this piece and the one behind it."""
        return _Runs(
            total=self.total + other.total,
            begin=np.where(self.begin >= self.length, self.length + other.begin, self.begin),
            end=np.where(other.end >= other.length, other.length + self.end, other.end),
            longest=np.maximum(np.maximum(self.longest, other.longest), self.end + other.begin),
            length=self.length + other.length,
        )


def clear_arcs(
    geometry: Geometry, radius_deg: float, dark_limb_deg: float, bright_limb_deg: float
) -> tuple[FloatArray, FloatArray]:
    """Return the part of the orbit on which each target stands clear of the Earth.

    Parameters
    ----------
    geometry : Geometry
    radius_deg : float
        Angular radius of the Earth.
    dark_limb_deg, bright_limb_deg : float
        Least angle from the limb.

    Returns
    -------
    fraction : ndarray
        Of the orbit, 0 to 1.
    longest : ndarray
        Its longest piece, fraction of the orbit; a piece does not end where the revolution does.

    Examples
    --------
    A target in the plane of the orbit, with the Sun behind it and in front of it:

    >>> new, full = (np.array([side]) for side in (1.0, -1.0))
    >>> for sun in (new, full):
    ...     fraction, longest = clear_arcs(Geometry(np.ones(1), sun, np.zeros(1), sun), 70.2, 10.0, 30.0)
    ...     print(fraction.round(3), longest.round(3))
    [0.443] [0.443]
    [0.554] [0.554]
    """
    rho = math.radians(radius_deg)

    def reach(limb_deg: float) -> FloatArray:
        least = -math.cos(min(rho + math.radians(limb_deg), math.pi))
        return np.arccos(np.clip(least / np.maximum(geometry.in_plane, _TINY), -1.0, 1.0))

    outer = reach(dark_limb_deg)
    core = np.minimum(outer, reach(bright_limb_deg))
    fraction, longest = core / math.pi, core / math.pi
    # Flanks of about one width go together, so that each is divided only as often as it has to be.
    pieces = _WIDTHS * np.ceil(np.rad2deg(outer - core) / (2 * STEP_DEG * _WIDTHS)).astype(int)
    for count in np.unique(pieces[pieces != 0]).tolist():
        flanks, block = np.flatnonzero(pieces == count), _BLOCK_CELLS // count
        for part in range(0, len(flanks), block):
            rows = flanks[part : part + block]
            runs = _whole_orbit(geometry.take(rows), core[rows], outer[rows], rho, count)
            fraction[rows] = runs.total / (2 * math.pi)
            # The end of a revolution is its begin; one that counts as a whole is cut to one revolution below.
            longest[rows] = np.maximum(runs.longest, runs.begin + runs.end) / (2 * math.pi)
    return np.minimum(fraction, 1.0), np.minimum(longest, 1.0)


def _whole_orbit(geometry: Geometry, core: FloatArray, outer: FloatArray, rho: float, pieces: int) -> _Runs:
    """Return one revolution, from where the target comes up to where it comes up again."""
    share = np.linspace(0.0, 1.0, 2 * pieces + 1)[:, None]
    place = core + (outer - core) * share
    cosine, sine = np.cos(place), np.sin(place)
    over = geometry.in_plane * cosine
    from_limb = math.sin(rho) * np.sqrt(np.maximum(1.0 - over**2, 0.0)) - math.cos(rho) * over
    constant = math.cos(rho) * geometry.sun_target
    ahead, aside = geometry.sun_ahead * cosine, geometry.sun_aside * sine
    step = (outer - core) / (2 * pieces)
    before = _flank(from_limb * (ahead - aside) + constant, step)[::-1]
    behind = _flank(from_limb * (ahead + aside) + constant, step)
    nothing = np.zeros_like(core)
    runs = None
    for piece in (
        *(_turned(one) for one in before),
        _all(2 * core),
        *behind,
        _Runs(nothing, nothing, nothing, nothing, 2 * (math.pi - outer)),
    ):
        runs = piece if runs is None else runs.then(piece)
    assert runs is not None
    return runs


def _all(length: FloatArray) -> _Runs:
    return _Runs(length, length, length, length, length)


def _turned(runs: _Runs) -> _Runs:
    """Return the same piece from the other side."""
    return _Runs(runs.total, runs.end, runs.begin, runs.longest, runs.length)


def _flank(sunlit: FloatArray, step: FloatArray) -> list[_Runs]:
    """Return the dark runs of the pieces of a flank, from the core outwards.

    Parameters
    ----------
    sunlit : ndarray, shape (2 pieces + 1, n)
        Above 0 where the limb is sunlit, at even steps.
    step : ndarray, shape (n,)
    """
    first, middle, last = sunlit[:-2:2], sunlit[1::2], sunlit[2::2]
    bend, slope = 0.5 * (first + last) - middle, 0.5 * (last - first)
    # Roots of bend x^2 + slope x + middle, x from -1 to 1 over a piece, by the form that loses no digits.
    inside = slope**2 - 4.0 * bend * middle
    half = -0.5 * (slope + np.copysign(np.sqrt(np.maximum(inside, 0.0)), slope))
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = half / bend, middle / half
        low = np.maximum(np.minimum(one, other), -1.0)
        high = np.minimum(np.maximum(one, other), 1.0)
        crossed = (inside > 0.0) & (high > low)
    # Between the roots the sign is that of -bend, outside that of bend; without a piece between, that of the ends (the
    # middle may touch 0 from above).
    dark_between = crossed & (bend >= 0.0)
    whole = ~crossed & (first + last <= 0.0)
    between = high - low
    begin = np.where(dark_between, np.where(low <= -1.0, between, 0.0), np.where(crossed, low + 1.0, 0.0))
    end = np.where(dark_between, np.where(high >= 1.0, between, 0.0), np.where(crossed, 1.0 - high, 0.0))
    total = np.where(dark_between, between, begin + end)
    longest = np.where(dark_between, between, np.maximum(begin, end))
    length = 2.0 * step
    total, begin, end, longest = (np.where(whole, length, part * step) for part in (total, begin, end, longest))
    return [_Runs(total[i], begin[i], end[i], longest[i], length) for i in range(len(whole))]
