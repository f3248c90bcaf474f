"""The light of a scene's stars, worked out when it is asked for."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from catalogs.bands import Band
from catalogs.errors import InputError
from catalogs.spectra import Spectrum
from catalogs.spectral_types import stellar_parameters
from catalogs.stellar_physics import luminosity_from_v
from simulator.band_integrals import band_integral
from simulator.config.bodies import SceneStar
from simulator.config.geometry import Place
from simulator.config.keys import at
from simulator.config.light import STAR_MODELS, SpectrumTable
from simulator.target.spectrum_table import photon_flux
from simulator.target.star_spectrum import StarModel, StarSpectrum, stellar_spectrum

__all__ = ["ORIGIN", "LitStar", "inside", "table_spectrum"]

_Parameters: TypeAlias = tuple[float, str | None, float | None, float | None, float | None]
ORIGIN = Place(0.0, 0.0)
"""Where the central star stands."""


@contextmanager
def inside(path: str) -> Iterator[None]:
    """Name the place in the scene in every refusal."""
    try:
        yield
    except InputError as error:
        raise at(path, error) from None


def table_spectrum(table: SpectrumTable) -> Spectrum:
    """Return a user's table as photon flux density."""
    unit, flux = ("flam", table.flam) if table.photlam is None else ("photlam", table.photlam)
    return photon_flux("spectrum", np.array(table.wavelength_nm), np.array(flux), unit)


@dataclass(frozen=True, eq=False)
class LitStar:
    """A star of a scene.

    Attributes
    ----------
    star : SceneStar
    path : str
        Place in the scene, for messages.
    place : Place
        Offset from the central star on the sky.
    """

    star: SceneStar
    path: str
    place: Place = ORIGIN

    @property
    def name(self) -> str:
        """Name of the star."""
        return self.star.name

    @functools.cached_property
    def spectrum(self) -> StarSpectrum:
        """Spectrum at the telescope, scaled to the V magnitude, with the parameters used and flags."""
        star = self.star
        model = table_spectrum(star.spectrum) if isinstance(star.spectrum, SpectrumTable) else star.spectrum
        with inside(self.path):
            return _spectrum(*self._parameters, model)

    @property
    def _parameters(self) -> _Parameters:
        star = self.star
        return star.v_mag, star.spectral_type, star.teff_k, star.log_g, star.metallicity

    @property
    def wavelength_nm(self) -> np.ndarray:
        """Wavelengths of the samples of `photlam`."""
        return self.spectrum.wavelength_nm

    @property
    def photlam(self) -> np.ndarray:
        """Photon flux density at the telescope, ph/s/cm2/A."""
        return self.spectrum.photlam

    def flags(self) -> tuple[str, ...]:
        """What was assumed or clamped."""
        return self.spectrum.flags

    @functools.cached_property
    def luminosity(self) -> tuple[float, tuple[str, ...]]:
        """Luminosity, L_sun, and flags; derived from V, distance and temperature where it is not given.

        Raises
        ------
        InputError
            If it is not given and does not follow from what is.
        """
        star = self.star
        if star.luminosity_lsun is not None:
            return star.luminosity_lsun, ()
        teff = star.teff_k
        if teff is None and star.spectral_type is not None:
            teff = stellar_parameters(star.spectral_type).teff_k
        if star.distance_pc is None or teff is None:
            raise InputError(
                f"{self.path}.{'distance_pc' if star.distance_pc is None else 'teff_k'}",
                "missing",
                allowed="a value, where the insolation of a planet follows from the star's luminosity",
                hint="or give luminosity_lsun, or the planet's insolation_au",
            )
        return luminosity_from_v(star.v_mag, star.distance_pc, teff), ("luminosity_derived",)

    def rate_e_s_cm2(self, band: Band) -> float:
        """Detected electrons per second and cm2 of the telescope."""
        return self.in_band(band)[0]

    def in_band(self, band: Band) -> tuple[float, tuple[str, ...]]:
        """Detected electrons per second and cm2 of the telescope, and what was assumed or clamped."""
        model = self.star.spectrum
        if model in STAR_MODELS and "spectrum" not in self.__dict__:
            with inside(self.path):
                return _kept_rate(*self._parameters, model, band)
        star = self.spectrum
        with inside(f"{self.path}.spectrum"):
            return band_integral(band, star.wavelength_nm, star.photlam), star.flags


def _spectrum(
    v_mag: float,
    spectral_type: str | None,
    teff_k: float | None,
    log_g: float | None,
    metallicity: float | None,
    model: StarModel,
) -> StarSpectrum:
    return stellar_spectrum(v_mag, spectral_type, teff_k=teff_k, log_g=log_g, metallicity=metallicity, model=model)


@functools.lru_cache(maxsize=4096)
def _kept_rate(*asked: Any) -> tuple[float, tuple[str, ...]]:
    """Rate and flags of a star of a shipped model, from `LitStar._parameters`, model and band.

    The field of a scene is asked for again by every visit and every prediction. Files are not kept: they may change.
    """
    *parameters, band = asked
    star = _spectrum(*parameters)
    with inside("spectrum"):
        return band_integral(band, star.wavelength_nm, star.photlam), star.flags
