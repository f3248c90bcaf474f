"""Detection probability against false alarms, for one planet and one filter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catalogs.errors import InputError
from cpic_planner.validation.detection import search
from cpic_planner.validation.injection import draw_place, inject, recovered
from cpic_planner.validation.reduced import ReducedStack
from cpic_planner.validation.search_field import REPORTED_SIGMA
from cpic_planner.validation.speckle_maps import SpeckleMaps
from simulator.imaging.external import ExternalPsf
from simulator.imaging.psf import Psf
from simulator.rng import stream

__all__ = ["RocCurve", "roc_curve"]

FloatArray = npt.NDArray[np.float64]
_SEARCH_SIGMA = 3.0


@dataclass(frozen=True, eq=False)
class RocCurve:
    """Receiver operating characteristic of the blind detector.

    Attributes
    ----------
    level : ndarray, shape (k,)
        Least `Candidate.significance` of a detection, ascending from 2.5.
    n_false : ndarray of int, shape (k,)
        Peaks at or above the level in the residuals without a planet.
    n_elements : float
        Resolution elements that were searched in them.
    n_detected : ndarray of int, shape (k,)
        Planets with a peak at or above the level within lambda/D.
    n_planets : int
        Planets injected, one a residual.
    """

    level: FloatArray
    n_false: npt.NDArray[np.int64]
    n_elements: float
    n_detected: npt.NDArray[np.int64]
    n_planets: int

    @property
    def false_alarm_rate(self) -> FloatArray:
        """False alarms per resolution element."""
        return self.n_false / self.n_elements

    @property
    def false_alarm_error(self) -> FloatArray:
        """Poisson standard deviation of that; of one count where there was none."""
        return np.sqrt(np.maximum(self.n_false, 1)) / self.n_elements

    @property
    def detection_probability(self) -> FloatArray:
        """Planets detected over planets injected."""
        return self.n_detected / self.n_planets

    @property
    def detection_error(self) -> FloatArray:
        """Binomial standard deviation, from the posterior under a uniform prior; never 0."""
        hits, misses = self.n_detected + 1.0, self.n_planets - self.n_detected + 1.0
        total = hits + misses
        return np.sqrt(hits * misses / (total**2 * (total + 1.0)))


def roc_curve(
    stacks: Sequence[ReducedStack],
    psf: Psf | ExternalPsf,
    maps: SpeckleMaps,
    *,
    star_rate_e_s: float,
    separation_arcsec: float,
    contrast: float,
    levels: npt.ArrayLike | None = None,
    seed: int = 0,
) -> RocCurve:
    """Search each residual without and with a planet.

    Parameters
    ----------
    stacks : sequence of ReducedStack
        Planet-free residuals of independent visits, at least one. The same residual counts false alarms and, with the
        planet added, detections: the two counts share their noise, not their errors of interest.
    psf, star_rate_e_s
        As in `cpic_planner.validation.detection.search`.
    maps : SpeckleMaps
        With the filter to be judged.
    separation_arcsec, contrast : float
        Of the planet; its azimuth in the hole is drawn for every residual.
    levels : array_like, optional
        At least 2.5, ascending; 2.5 to 7 by default.
    seed : int
        Of azimuths and photons: the same planets for another filter.

    Raises
    ------
    InputError
        If an argument is out of range.
    """
    level = np.asarray(np.linspace(REPORTED_SIGMA, 7.0, 46) if levels is None else levels, float)
    if level.ndim != 1 or not level.size or not (level >= REPORTED_SIGMA).all() or not (np.diff(level) > 0).all():
        raise InputError("levels", levels, unit="sigma", allowed=f"ascending, at least {REPORTED_SIGMA:g}")
    if not len(stacks):
        raise InputError("stacks", 0, allowed="at least one residual")
    geometry = psf.geometry
    alarms: list[float] = []
    seen = np.full(len(stacks), -math.inf)
    elements = 0.0
    for visit, stack in enumerate(stacks):
        rng = stream(seed, "roc", visit)
        empty = search(stack, psf, maps, star_rate_e_s=star_rate_e_s, sigma=_SEARCH_SIGMA)
        elements += empty.region.n_elements
        alarms += [one.significance for one in empty.candidates]
        x, y = draw_place(stack, separation_arcsec, geometry.pixel_scale_arcsec, rng)
        planet = inject(stack, psf, x, y, contrast * star_rate_e_s * stack.integration_s, rng)
        best = recovered(
            search(planet, psf, maps, star_rate_e_s=star_rate_e_s, sigma=_SEARCH_SIGMA), x, y, geometry.lambda_d_arcsec
        )
        if best is not None:
            seen[visit] = best.significance
    return RocCurve(
        level=level,
        n_false=np.array([np.count_nonzero(np.array(alarms) >= one) for one in level], np.int64),
        n_elements=elements,
        n_detected=np.array([np.count_nonzero(seen >= one) for one in level], np.int64),
        n_planets=len(stacks),
    )
