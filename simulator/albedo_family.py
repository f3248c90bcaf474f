"""Albedos that depend on how strongly the star shines on the planet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from catalogs.errors import InputError
from catalogs.spectra import Albedo
from catalogs.stellar_grid import bracket
from simulator.quantities import real_array

__all__ = ["AlbedoFamily"]


@dataclass(frozen=True, eq=False)
class AlbedoFamily:
    """Albedos of one kind of planet at several insolations, linear in albedo over ln(insolation distance).

    Linear in albedo, so that band integrals of the nodes, made once, serve any number of planets.

    Attributes
    ----------
    insolation_au : ndarray, shape (k,)
        Increasing distances from the Sun of equal insolation; beyond the ends the end itself holds (`outside`).
    wavelength_nm : ndarray, shape (n,)
    albedo : ndarray, shape (k, n)
    documented_to_nm : float
        Beyond this wavelength the albedo is extrapolated.
    """

    insolation_au: np.ndarray
    wavelength_nm: np.ndarray
    albedo: np.ndarray
    documented_to_nm: float

    def corners(self, insolation_au: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Return the two neighbouring nodes of each distance and their weights, both of shape (..., 2).

        Raises
        ------
        InputError
            If a distance is not a finite number above 0.
        """
        return bracket(np.log(self.insolation_au), np.log(_positive(insolation_au)))

    def outside(self, insolation_au: ArrayLike) -> np.ndarray:
        """Return True where a distance lies beyond the nodes and the albedo of the end is used."""
        distance = _positive(insolation_au)
        result: np.ndarray = (distance < self.insolation_au[0]) | (distance > self.insolation_au[-1])
        return result

    def at(self, insolation_au: float) -> Albedo:
        """Return the albedo at one insolation distance."""
        nodes, weights = self.corners(float(insolation_au))
        albedo = weights @ self.albedo[nodes]
        albedo.setflags(write=False)
        return Albedo(self.wavelength_nm, albedo, self.documented_to_nm)


def _positive(insolation_au: ArrayLike) -> np.ndarray:
    distance = real_array("insolation_au", insolation_au, "au")
    good = (distance > 0.0) & np.isfinite(distance)
    if not np.all(good):
        bad = float(distance[~good].flat[0])
        raise InputError("insolation_au", bad, unit="au", allowed="a finite distance above 0")
    return distance
