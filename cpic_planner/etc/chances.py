"""Chances that visits detect planets, blind and at a known place."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray
from cpic_planner.etc.detection import MIN_ELEMENTS
from cpic_planner.etc.detection_law import SearchLaw, band_law, light_share, lit_share, own_share, speckled_share
from cpic_planner.etc.model import EtcModel
from cpic_planner.etc.noise import StackNoise

LEAST_PROBABILITY = 1e-6
"""Planets that are detected with a smaller probability count as not detected at all."""


@dataclass(frozen=True, eq=False)
class Chances:
    """Probabilities of a detection, of a blind search and at a known place."""

    blind: FloatArray
    known_place: FloatArray

    @classmethod
    def of(
        cls,
        law: SearchLaw,
        noise: StackNoise,
        separation_arcsec: ArrayLike,
        light: ArrayLike,
        visits: ArrayLike,
        motion: ArrayLike = 1.0,
        *,
        at_place: bool = True,
    ) -> Self:
        """Return the chances by a law.

        Parameters
        ----------
        law : SearchLaw
        noise : StackNoise
            Of programmes at the planets' places.
        separation_arcsec : array_like
        light : array_like
            Share of the errors' light in what visits average (`light_share`).
        visits : array_like
            Independent wavefronts behind the noise (`effective_visits`).
        motion : array_like
            Factor on the threshold of a blind search for the motion of planets (`cpic_planner.etc.motion`); at a known
            place the orbit is followed.
        at_place : bool
            Those at a known place are asked for; else they are NaN.
        """
        where = own_share(noise), separation_arcsec, speckled_share(noise), lit_share(noise, light), visits
        paid = noise.significance / np.asarray(motion, float)
        blind = law.probability(paid, *where, at_place=False)
        # Who knows the place may search blind, too.
        known = law.probability(noise.significance, *where, at_place=True) if at_place else np.nan
        return cls(blind, np.maximum(blind, known))

    def where(self, defined: BoolArray) -> Self:
        """Return the same, and 0 where no threshold of a significance is defined."""
        return type(self)(*(np.where(defined, part, 0.0 * part) for part in (self.blind, self.known_place)))


def visit_chances(
    model: EtcModel,
    band: str,
    separation_arcsec: ArrayLike,
    visit_s: ArrayLike,
    noise: StackNoise,
    visits: ArrayLike = 1.0,
    *,
    motion: ArrayLike = 1.0,
    at_place: bool = True,
) -> Chances:
    """Return the probabilities that visits, or programmes of them, detect planets.

    Parameters
    ----------
    model : EtcModel
    band : str
    separation_arcsec, visit_s : array_like
        Of the planets, and length of the science visits.
    noise, visits, motion, at_place
        As of `Chances.of`.
    """
    light = light_share(model, band, separation_arcsec, visit_s)
    found = Chances.of(band_law(model, band), noise, separation_arcsec, light, visits, motion, at_place=at_place)
    return found.where(model.metrics[band].resolution_elements(separation_arcsec) >= MIN_ELEMENTS)
