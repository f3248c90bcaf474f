"""The speckle residual that no number of frames averages: a law in the length of a visit, and of many of them.

Visits have each a wavefront of their own, which means over visits average; what all differ by from references stays.
"""

import functools
import math
from typing import Any, NamedTuple

import numpy as np

from cpic_core import ArrayLike, FloatArray
from simulator.config import Drift, Timing
from simulator.imaging import PsfMetrics

_N_ANNULUS, _N_TABLE = 25, 500
# What low orders leave over what a screen of the same rms does, variances of the cross term and of the light of the
# errors: measured in the four visible bands by full propagation, the rms right within a factor of 4 from 0.1 to 3 nm.
LOW_ORDER_LINEAR, LOW_ORDER_SQUARE = 5e-5, 2e-7
INTERLEAVED = Timing()


class SpeckleLaw(NamedTuple):
    """Variance of aperture sums after subtraction, ``k0 + k1 v + k2 v^2`` for a visit of ``v`` seconds.

    In units of (star light on the clear disc)^2, or of (e-/s)^2 once multiplied with the star's rate squared.
    """

    k0: FloatArray
    k1: FloatArray
    k2: FloatArray

    def variance(self, visit_s: ArrayLike) -> FloatArray:
        """Return the value for a visit of that length."""
        visit = np.asarray(visit_s, float)
        return self.k0 + visit * (self.k1 + visit * self.k2)

    def scaled(self, factor: ArrayLike) -> "SpeckleLaw":
        """Return all of it times a factor."""
        return SpeckleLaw(np.multiply(factor, self.k0), np.multiply(factor, self.k1), np.multiply(factor, self.k2))

    def stretched(self, ratio: ArrayLike) -> "SpeckleLaw":
        """Return the law of visits that are ``ratio`` times as long as those that it is asked for."""
        longer = np.asarray(ratio, float)
        return SpeckleLaw(self.k0, self.k1 * longer, self.k2 * longer**2)


class ProgrammeLaw(NamedTuple):
    """Residual of a programme of visits that are reduced together, each against the mean of all references.

    Attributes
    ----------
    science : SpeckleLaw
        Share of one science visit in the variance of a pair of visits, against its length.
    reference : SpeckleLaw
        The same of one reference visit, where there are as many of them as science visits.
    common : SpeckleLaw
        What science and reference differ by in every visit: no number of visits averages it.
    correlation_time_h : float
        Time in which the wavefronts of two visits forget each other; 0: all are independent, infinite: all are one.
    turned : SpeckleLaw or None
        What science and reference differ by in one visit, and in the next by as much the other way.
    """

    science: SpeckleLaw
    reference: SpeckleLaw
    common: SpeckleLaw
    correlation_time_h: float = 0.0
    turned: SpeckleLaw | None = None

    def independent(self, visits: ArrayLike, gap_s: ArrayLike = np.inf) -> FloatArray:
        """Return the number of independent wavefronts whose mean is as steady as that of these visits.

        Parameters
        ----------
        visits : array_like
            Number of visits, at least 1.
        gap_s : array_like
            From the start of a visit to that of the next.

        Notes
        -----
        ``V / [1 + 2 sum over 0 < k < V of (1 - k / V) rho^k]`` with ``rho = exp(-gap / correlation time)``; the sum is
        ``[rho - (1 - rho^V) rho / (V (1 - rho))] / (1 - rho)``.
        """
        count = np.asarray(visits, float)
        if self.correlation_time_h in (0.0, math.inf):
            return count if self.correlation_time_h == 0.0 else np.minimum(count, 1.0)
        # Closer than 1e-7 they are one and the same: the sum would be lost in rounding.
        decay = np.maximum(np.asarray(gap_s, float) / (3600.0 * self.correlation_time_h), 1e-7)
        rho, rest = np.exp(-decay), -np.expm1(-decay)
        together = (rho + np.expm1(-decay * count) * rho / (count * rest)) / rest
        return np.asarray(count / (1.0 + 2.0 * np.maximum(together, 0.0)))

    def law(
        self,
        visits: ArrayLike = 1.0,
        reference_visits: ArrayLike | None = None,
        gap_s: ArrayLike = np.inf,
        *,
        reference_length: ArrayLike | None = None,
    ) -> SpeckleLaw:
        """Return the variance of the programme's mean rate, against the length of one science visit.

        Parameters
        ----------
        visits : array_like
            Science visits, at least 1.
        reference_visits : array_like, optional
            Visits that all the reference frames are spread over; as many as science visits by default.
        gap_s : array_like
            From the start of a visit to that of the next.
        reference_length : array_like, optional
            Length of a reference visit over that of as many of them as science visits; ``V / R`` by default, so that
            all references together are as long.

        Notes
        -----
        ``science(v) / V + reference(v V / R) / R + common + turned / V^2``, with the numbers of independent wavefronts
        for V and R as divisors of the first two; the last is the bound that odd V reach. Simulated images agree (0.99
        to 1.02 for V to 16 and R to 400); the modes that a subtraction projects out beside the mean are not in it.
        Their light forgets twice as fast as the wavefronts do, so that correlated visits leave up to 13 % less.
        """
        many = np.asarray(visits, float)
        others = many if reference_visits is None else np.asarray(reference_visits, float)
        length = many / others if reference_length is None else reference_length
        own = 1.0 / self.independent(many, gap_s)
        if others is many and (np.asarray(length) == 1.0).all():
            parts = (_summed(self.science, self.reference).scaled(own), self.common)
        else:
            second = self.reference.stretched(length).scaled(1.0 / self.independent(others, gap_s))
            parts = (_summed(self.science.scaled(own), second), self.common)
        return _summed(*parts, *(() if self.turned is None else (self.turned.scaled(1.0 / many**2),)))

    def scaled(self, factor: ArrayLike) -> "ProgrammeLaw":
        """Return all of it times a factor."""
        science, reference, common = (part.scaled(factor) for part in self[:3])
        turned = None if self.turned is None else self.turned.scaled(factor)
        return ProgrammeLaw(science, reference, common, self.correlation_time_h, turned)

    def beside(self, other: "ProgrammeLaw") -> "ProgrammeLaw":
        """Return the law of two residuals of the same visits that know nothing of each other."""
        science, reference, common = (_summed(*pair) for pair in zip(self[:3], other[:3], strict=True))
        turned = [law.turned for law in (self, other) if law.turned is not None]
        every = science, reference, common
        return ProgrammeLaw(*every, self.correlation_time_h, _summed(*turned) if turned else None)

    def averaging(self) -> "ProgrammeLaw":
        """Return the law without what is common to all visits."""
        return self._replace(common=SpeckleLaw(*np.zeros(3)))


def _summed(*laws: SpeckleLaw) -> SpeckleLaw:
    """Return the law of residuals that know nothing of each other."""
    (k0, k1, k2), *others = laws
    for more in others:
        k0, k1, k2 = k0 + more.k0, k1 + more.k1, k2 + more.k2
    return SpeckleLaw(k0, k1, k2)


def programme_law(
    metrics: PsfMetrics,
    drift: Drift,
    separation_arcsec: ArrayLike,
    annulus_lambda_d: float,
    reference_ratio: float = 1.0,
    timing: Timing = INTERLEAVED,
) -> ProgrammeLaw:
    """Return the law of the residual at a separation, of any number of visits.

    Parameters
    ----------
    metrics : PsfMetrics
    drift : Drift
        ``visit_nm`` is the offset of each visit, ``walk_nm_per_sqrt_hour`` its random walk, ``common_fraction`` the
        part of the offset's rms by which science and reference differ in every visit, ``correlation_time_h`` the time
        in which offsets forget each other, ``orbital_nm`` what swings with the orbit.
    separation_arcsec : array_like
    annulus_lambda_d : float
        Half width of the annulus over which the scatter is measured: the residual is several times larger at the inner
        edge of the hole than at the outer one, and this is its quadratic mean over whole apertures in the quadrants.
    reference_ratio : float
        Length of a reference visit over that of a science visit, of as many of both.
    timing : Timing
        Where in the orbit references are taken.

    Returns
    -------
    ProgrammeLaw
        Arrays that broadcast to ``separation_arcsec``, in units of (star light on the clear disc)^2.

    Notes
    -----
    Half the variance of a pair of visits, ``a o^2 + b o^4`` (`PsfMetrics.floor_linear`, `PsfMetrics.floor_square`),
    belongs to each. The mean of a walk of variance ``w s`` over ``0 < s < v`` has the variance ``w v / 3``; the mean of
    its square, which makes the light of the errors, has ``2 <min(s, s')^2> = w^2 v^2 / 3`` instead of the
    ``2 (w v / 3)^2`` of a frozen offset of that size, 3/2 times as much. The common screen of rms ``f o`` leaves
    ``[a (f o)^2 + b (f o)^4] / 2``; its light crossed with a visit's own, ``b (f o)^2 (o^2 + w v / 3)``, averages over
    the science visits.

    The orbital term of rms p swings as ``2^(1/2) sin`` with a phase that nobody knows. With m the mean of
    ``exp(2 pi i t)`` over the windows of science or of references, t in orbits, d the difference of the two and d2 that
    of ``exp(4 pi i t)``, a screen leaves ``[a p^2 |d|^2 + b p^4 |d2|^2 / 2] / 2`` in every visit, and its light crossed
    with a visit's own is ``b p^2 |m|^2 (o^2 + w v / 3)``. Visits fill their windows; rings of light, which the mean of
    an annulus takes off, are left out. Low orders leave a small share of that (``LOW_ORDER_LINEAR`` of a,
    ``LOW_ORDER_SQUARE`` of b); from 10 nm on they break the dark hole, which is not in the law.
    """
    crossed, light = programme_parts(metrics, drift, separation_arcsec, annulus_lambda_d, reference_ratio, timing)
    return crossed.beside(light)


def programme_parts(
    metrics: PsfMetrics,
    drift: Drift,
    separation_arcsec: ArrayLike,
    annulus_lambda_d: float,
    reference_ratio: float = 1.0,
    timing: Timing = INTERLEAVED,
) -> tuple[ProgrammeLaw, ProgrammeLaw]:
    """Return `programme_law` in two parts: the cross term with the static field, and the light of the errors.

    A drift all of which is ``k`` times as large leaves ``k^2`` times the first and ``k^4`` times the second. Where a
    table says how stable its contrast is, that is the first, and the second is 0.
    """
    separation = np.asarray(separation_arcsec, float)
    if (stable := metrics.stability(separation)) is not None:
        variance, common = stable
        return _stable_law(variance, common=common), _stable_law(np.zeros_like(variance), common=common)
    linear, square = (0.5 * part for part in annulus_floor(metrics, annulus_lambda_d, separation))
    return unit_parts(drift, linear, square, reference_ratio, timing)


def _stable_law(variance: FloatArray, *, common: bool) -> ProgrammeLaw:
    """Return the law of a residual that no drift changes: the same in all visits, or of the two visits of a pair."""
    nothing = np.zeros((1,) * variance.ndim)
    none, still = (SpeckleLaw(part, nothing, nothing) for part in (nothing, variance if common else 0.5 * variance))
    return ProgrammeLaw(none, none, still, math.inf) if common else ProgrammeLaw(still, still, none)


def unit_parts(
    drift: Drift,
    linear: ArrayLike = 1.0,
    square: ArrayLike = 1.0,
    reference_ratio: float = 1.0,
    timing: Timing = INTERLEAVED,
) -> tuple[ProgrammeLaw, ProgrammeLaw]:
    """Return the two parts of `programme_parts` for any sum of pixels.

    Parameters
    ----------
    drift : Drift
    linear, square : array_like
        Variance of the sum in visits that are off by 1 nm: of the cross term with the static field, and of the light
        of the errors. With 1, the laws are factors of these, in nm^2 and nm^4.
    reference_ratio : float
    timing : Timing
        As of `programme_law`.
    """
    linear, square = np.asarray(linear, float), np.asarray(square, float)
    visit, walk = drift.visit_nm**2, drift.walk_nm_per_sqrt_hour**2 / (3.0 * 3600.0)
    common, nothing = drift.common_fraction**2 * visit, np.zeros((1,) * linear.ndim)
    orbit = _orbital(drift, timing)

    def lit(also: float) -> SpeckleLaw:
        return SpeckleLaw(
            k0=(visit**2 + 2.0 * also * visit) * square,
            k1=walk * 2.0 * square * (visit + also),
            k2=1.5 * walk**2 * square,
        )

    def still(factor: float, part: FloatArray) -> SpeckleLaw:
        return SpeckleLaw(factor * part, nothing, nothing)

    def law(science: SpeckleLaw, reference: SpeckleLaw, common: SpeckleLaw, orbital: SpeckleLaw) -> ProgrammeLaw:
        later, turns = reference.stretched(reference_ratio), timing.scheme == "swapped"
        always = common if turns else _summed(common, orbital)
        return ProgrammeLaw(science, later, always, drift.correlation_time_h, orbital if turns else None)

    once = SpeckleLaw(k0=visit * linear, k1=walk * linear, k2=nothing)
    crossed = law(once, once, still(common, linear), still(orbit.linear, linear))
    light = law(
        lit(common + orbit.science),
        lit(orbit.reference),
        still(common**2 + 2.0 * common * orbit.science, square),
        still(orbit.square, square),
    )
    return crossed, light


class _Orbital(NamedTuple):
    """The orbital term as variances of screens: what stays of it, and what it is while science and references last.

    Attributes
    ----------
    linear : float
        Of the cross term with the static field, nm^2.
    square : float
        Of the light of the errors, nm^4.
    science, reference : float
        Mean square of the mean over a visit as far as its light crosses with that of other errors, nm^2.
    """

    linear: float
    square: float
    science: float
    reference: float


@functools.lru_cache(maxsize=64)
def _orbital(drift: Drift, timing: Timing) -> _Orbital:
    """Return the orbital term of a drift, averaged over its phase."""
    linear, square = (LOW_ORDER_LINEAR, LOW_ORDER_SQUARE) if drift.orbital_orders == "low" else (1.0, 1.0)
    power, window = drift.orbital_nm**2, (0.0, timing.window_turns)
    means = [
        [timing.phasors(window, reference=reference, harmonic=harmonic)[0] for reference in (False, True)]
        for harmonic in (1, 2)
    ]
    left, left2 = (abs(science - reference) ** 2 for science, reference in means)
    crossing = power * float(np.sqrt(square))
    return _Orbital(
        linear=linear * power * left,
        square=square * power**2 * left2 / 2.0,
        science=crossing * abs(means[0][0]) ** 2,
        reference=crossing * abs(means[0][1]) ** 2,
    )


def error_light_share(
    metrics: PsfMetrics,
    drift: Drift,
    separation_arcsec: ArrayLike,
    annulus_lambda_d: float,
    reference_ratio: float,
    visit_s: ArrayLike,
    timing: Timing = INTERLEAVED,
) -> FloatArray:
    """Return the share of a residual's variance that the light of the wavefront's errors makes, ``|dE|^2``, 0 to 1.

    The rest is ``2 Re(E0* dE)``, which is as Gaussian as the errors are; ``|dE|^2`` has exponential tails. Parameters
    as of `programme_law`, with the length of the science visit in s; 0 where there is no residual. It is that of what
    averages over visits, with as many references as science visits.
    """
    laws = programme_parts(metrics, drift, separation_arcsec, annulus_lambda_d, reference_ratio, timing)
    crossed, light = (law.averaging().law().variance(visit_s) for law in laws)
    whole = crossed + light
    return np.asarray(light / np.where(whole > 0.0, whole, 1.0))


def error_variance_nm2(drift: Drift) -> float:
    """Return the mean square of the wavefront errors of a science visit whose light lies in the zone, nm^2.

    Parameters
    ----------
    drift : Drift
        The offset of the visit, the screen that all science visits share, and as much of what swings with the orbit as
        reaches the zone. The walk within a visit of ``v`` is left out: its light, ``w v / 2``, counts little where its
        speckles grow with v.
    """
    reaches = LOW_ORDER_SQUARE**0.5 if drift.orbital_orders == "low" else 1.0
    return drift.visit_nm**2 + drift.common_nm**2 + reaches * drift.orbital_nm**2


def annulus_floor(metrics: PsfMetrics, annulus_lambda_d: float, separation_arcsec: ArrayLike) -> tuple[FloatArray, ...]:
    """Return `PsfMetrics.floor_linear` and `floor_square` of the annulus around separations: mean of its apertures."""
    start, step, *tables = _annulus_table(metrics, annulus_lambda_d)
    # Even steps: a row is a division, which takes a tenth of a search.
    row = np.minimum(np.maximum((np.asarray(separation_arcsec, float) - start) / step, 0.0), _N_TABLE - 1.0)
    low = np.minimum(row.astype(np.intp), _N_TABLE - 2)
    return tuple(np.asarray(np.exp(table[low] + (row - low) * rise[low])) for table, rise in tables)


@functools.lru_cache(maxsize=64)
def _annulus_table(metrics: PsfMetrics, annulus_lambda_d: float) -> tuple[Any, ...]:
    """Return the first of separations in even steps, the step, and a table of either mean coefficient over an annulus.

    A table holds the logarithms at the separations, and by how much each rises to the next. The mean is that of whole
    apertures.

    Apertures count by the azimuth that is left to them in the zone: few fit near the corners of square quadrants.
    """
    margin = metrics.aperture_radius_arcsec
    place = np.linspace(0.5 * metrics.hole_inner_corner_arcsec, metrics.owa_arcsec, _N_TABLE)
    # Apertures lie wholly inside the annulus: their centres keep a radius away from its edges.
    half_width = max(annulus_lambda_d * metrics.lambda_d_arcsec - margin, 0.0)
    reach = np.linspace(-1.0, 1.0, _N_ANNULUS) * half_width
    around = np.maximum(place[:, None] + reach, 1e-6)
    weight = around * metrics.zone.azimuth_fraction(around, margin)
    total = weight.sum(axis=1, keepdims=True)
    # Where no whole aperture fits, the residual at the separation itself.
    alone = np.broadcast_to(np.arange(_N_ANNULUS) == _N_ANNULUS // 2, weight.shape)
    weight = np.where(total > 0.0, weight / np.where(total > 0.0, total, 1.0), alone)
    bins = metrics.floor_separation_arcsec
    means = ((weight * np.exp(_followed(around, bins, part))).sum(axis=1) for part in metrics.floor_logs())
    return place[0], place[1] - place[0], *((np.log(mean), np.diff(np.log(mean))) for mean in means)


def _followed(at: FloatArray, bins: FloatArray, values: FloatArray) -> FloatArray:
    """Interpolate logarithms between bins; beyond the last, at the hole's corners, they fall on by the same power."""
    inside = np.interp(at, bins, values)
    if len(bins) < 2:
        return np.asarray(inside)
    power = min((values[-1] - values[-2]) / np.log(bins[-1] / bins[-2]), 0.0)
    return np.asarray(inside + power * np.log(np.maximum(at / bins[-1], 1.0)))
