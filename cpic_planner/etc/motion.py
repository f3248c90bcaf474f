"""Motion of planets within programmes of visits, as the exposure-time calculator counts it.

A blind search goes through orbits, and its threshold pays for the trials (`cpic_planner.planets.orbit_search`). Where
the place of a planet is known its orbit is followed, which costs nothing.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from cpic_core import ArrayLike, FloatArray, IntArray
from cpic_planner.etc.model import EtcModel, Programme
from cpic_planner.planets import OrbitSearch, span_days, star_masses_msun
from cpic_planner.targets import Targets


@dataclass(frozen=True, eq=False)
class SearchMotion:
    """The cost of the motion of planets to a blind search at places of stars; made by `of`.

    Attributes
    ----------
    model : EtcModel
        Says what a visit takes of wall time.
    search : OrbitSearch
        Of the places.
    """

    model: EtcModel
    search: OrbitSearch

    @classmethod
    def of(
        cls,
        model: EtcModel,
        targets: Targets,
        band: str,
        separation_arcsec: ArrayLike,
        stars: IntArray | None = None,
    ) -> Self:
        """Return the motion at places around stars.

        Parameters
        ----------
        model : EtcModel
        targets : Targets
            ``n`` stars.
        band : str
        separation_arcsec : array_like
            Projected, above 0; its first axis is 1 or that of the stars.
        stars : ndarray of int, optional
            Which of the stars each place is at, of the shape of the places.
        """
        place, strategy = np.asarray(separation_arcsec, float), model.strategy
        around = (slice(None), *(None,) * (place.ndim - 1)) if stars is None else stars
        of_star = targets.distance_pc[around], _masses_msun(targets)[around], model.metrics[band].lambda_d_arcsec
        return cls(model, OrbitSearch.of(place, *of_star, gap_h=strategy.visit_gap_h, sigma=_level(strategy.sigma)))

    @classmethod
    def asked(cls, model: EtcModel, targets: Targets, band: str, separation_arcsec: ArrayLike) -> Self | None:
        """Return the same where the search of the model's strategy is blind, else None; parameters as of `of`."""
        return cls.of(model, targets, band, separation_arcsec) if model.strategy.search == "blind" else None

    @classmethod
    def stacked(cls, parts: Sequence["SearchMotion | None"], shape: tuple[int, ...]) -> "SearchMotion | None":
        """Return the motion in several bands, each of a shape, along a new first axis; None where there is none."""
        there = [part for part in parts if part is not None]
        if not there:
            return None
        first, *others = (part.search for part in there)
        return SearchMotion(there[0].model, first.stacked(others, shape))

    def at(self, index: Any) -> Self:
        """Return the motion at some of the places."""
        return type(self)(self.model, self.search.at(index))

    def factor(self, programme: Programme, visit_s: ArrayLike) -> FloatArray:
        """Return the factor on the significance that a search asks for, at least 1.

        Parameters
        ----------
        programme : Programme
        visit_s : array_like
            Length of the science part of its visits.
        """
        return self.search.threshold_factor(programme.visits, self.model.time_s(visit_s))

    def orbits(self, programme: Programme, visit_s: ArrayLike) -> FloatArray:
        """Return the number of orbits that a search goes through; parameters as of `factor`."""
        return self.search.n_orbits(programme.visits, self.model.time_s(visit_s))


def motion_factor(motion: SearchMotion | None, programme: Programme, visit_s: FloatArray) -> FloatArray:
    """Return the factor on the significance that a search asks for because planets move; 1 where it follows them.

    Parameters
    ----------
    motion : SearchMotion or None
    programme, visit_s
        As of `SearchMotion.factor`.
    """
    return np.ones_like(visit_s) if motion is None else motion.factor(programme, visit_s)


def programme_days(model: EtcModel, visits: ArrayLike, time_s: ArrayLike) -> FloatArray:
    """Return the days from the begin of the first visit to the end of the last, occultations by the Earth included.

    Parameters
    ----------
    model : EtcModel
        Its strategy says what lies between visits.
    visits, time_s : array_like
        Number of visits, and wall time of all.
    """
    return span_days(time_s, np.maximum(visits, 1.0), model.strategy.visit_gap_h)


def _level(sigma: float) -> float:
    """Return the significance of the false alarms at rest, within what trials are stated for."""
    return min(max(sigma, 1.0), 20.0)


def _masses_msun(targets: Targets) -> FloatArray:
    return _masses(
        tuple(targets.name.tolist()),
        *(tuple(part.tolist()) for part in (targets.log_g, targets.luminosity_lsun, targets.teff_k)),
    )


@functools.lru_cache(maxsize=64)
def _masses(names: tuple[str, ...], *physics: tuple[float, ...]) -> FloatArray:
    log_g, luminosity, teff = physics
    return star_masses_msun(names, log_g, luminosity, teff)
