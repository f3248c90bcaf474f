"""The light of a scene's planets: the star's, reflected, or their own."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from catalogs.bands import Band
from catalogs.errors import InputError
from catalogs.spectra import Albedo, Spectrum, load_stellar_grid
from simulator.band_integrals import band_integral, band_projection
from simulator.config.bodies import Planet
from simulator.config.geometry import Place, true_distance_au
from simulator.config.light import SpectrumTable
from simulator.target.albedo import albedo_notes, albedo_table, needs_insolation, phase_value
from simulator.target.contrast import contrast_at
from simulator.target.lights import LitStar, inside, table_spectrum
from simulator.target.product import product_samples
from simulator.target.spectrum_table import read_spectrum
from simulator.target.star_spectrum import stellar_spectrum
from simulator.target.thermal import thermal_photlam

__all__ = ["LitPlanet"]


@dataclass(frozen=True, eq=False)
class LitPlanet:
    """A planet of a scene.

    Attributes
    ----------
    planet : Planet
    path : str
        Place in the scene, for messages.
    place : Place
        Offset from the central star on the sky.
    host : LitStar
    """

    planet: Planet
    path: str
    place: Place
    host: LitStar

    @functools.cached_property
    def distance_au(self) -> float | None:
        """True distance from the star; None where nothing depends on it and it is not given."""
        with inside(self.path):
            return true_distance_au(self.planet, self.place.separation_arcsec, self.host.star.distance_pc)

    @functools.cached_property
    def _insolation(self) -> tuple[float | None, tuple[str, ...]]:
        albedo, distance = self.planet.albedo, self.distance_au
        if albedo is None or distance is None or not needs_insolation(albedo):
            return getattr(albedo, "insolation_au", None), ()
        luminosity, flags = self.host.luminosity
        return distance / float(np.sqrt(luminosity)), flags

    @property
    def insolation_au(self) -> float | None:
        """Distance from the Sun at which a planet gets as much light; None where the albedo does not depend on it."""
        return self._insolation[0]

    @functools.cached_property
    def albedo(self) -> Albedo | None:
        """Geometric albedo; None for light of its own."""
        if self.planet.albedo is None:
            return None
        insolation = self.insolation_au
        with inside(f"{self.path}.albedo"):
            return albedo_table(self.planet.albedo, insolation_au=insolation)

    @property
    def name(self) -> str:
        """Name of the planet."""
        return self.planet.name

    def flags(self, band: Band | None = None) -> tuple[str, ...]:
        """What was assumed, clamped or extrapolated; in a band, or anywhere in the spectrum."""
        flags = list(self._insolation[1])
        if self.albedo is not None and self.planet.albedo is not None:
            flags += albedo_notes(self.planet.albedo, self.insolation_au)
            ends = (self.albedo.wavelength_nm[-1], self.host.wavelength_nm[-1])
            end = min(ends) if band is None else band.support_nm[1]
            if end > self.albedo.documented_to_nm:
                flags.append("extrapolated")
        if self.planet.reflects and self.host.star.distance_pc is None:
            flags.append("geometry_unchecked")
        return tuple(flags)

    def contrast_of(self, albedo: np.ndarray) -> np.ndarray:
        """Planet over star for a geometric albedo: Eq. 1 of Zhu et al. 2025, with the phase function asked for."""
        planet = self.planet
        assert planet.albedo is not None
        assert planet.radius_rjup is not None
        assert planet.phase_deg is not None
        assert self.distance_au is not None
        full = contrast_at(planet.radius_rjup, self.distance_au, 0.0, albedo)
        return np.asarray(full * phase_value(planet.albedo, planet.phase_deg, insolation_au=self.insolation_au))

    def band_contrast(self, band: Band) -> float:
        """True contrast in a band: ratio of detected rates, both integrals exact for the samples as they are."""
        star = self.host.spectrum
        host = self.host.rate_e_s_cm2(band)
        if host == 0.0:
            raise InputError(f"{self.host.path}.spectrum", "no light", allowed=f"some light in band {band.name}")
        own, table = self._own, self.albedo
        if own is not None:
            with inside(f"{self.path}.spectrum"):
                return band_integral(band, own.wavelength_nm, own.photlam) / host
        assert table is not None
        ratio = (table.wavelength_nm, self.contrast_of(table.albedo))
        with inside(f"{self.path}.albedo"):
            return float(band_projection(band, star.wavelength_nm, ratio) @ star.photlam) / host

    @functools.cached_property
    def _own(self) -> Spectrum | None:
        """Light of its own at the telescope; None for reflected light."""
        planet, distance_pc = self.planet, self.host.star.distance_pc
        if planet.reflects:
            return None
        with inside(self.path):
            given = table_spectrum(planet.spectrum) if isinstance(planet.spectrum, SpectrumTable) else planet.spectrum
            if planet.v_mag is not None:
                return stellar_spectrum(planet.v_mag, teff_k=planet.teff_k, model=given)
            if isinstance(given, Spectrum):
                return given
            if given != "blackbody":
                return read_spectrum(given)
            if distance_pc is None:
                raise InputError("v_mag", "missing", allowed="v_mag, or radius_rjup and cstar.distance_pc")
            assert planet.teff_k is not None
            assert planet.radius_rjup is not None
            x = load_stellar_grid().wavelength_nm
            return Spectrum(x, thermal_photlam(x, planet.teff_k, planet.radius_rjup, distance_pc))

    @property
    def wavelength_nm(self) -> np.ndarray:
        """Wavelengths of the samples of `photlam` and `contrast`."""
        return _samples(self)[0]

    @property
    def photlam(self) -> np.ndarray:
        """Photon flux density at the telescope, ph/s/cm2/A."""
        return _samples(self)[1]

    @property
    def contrast(self) -> np.ndarray:
        """Planet over star at each sample; nan where the star's spectrum holds no light."""
        return _samples(self)[2]

    def sample(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Wavelengths, photon flux density and contrast, finely enough to be taken as linear in between."""
        star, own, table = self.host.spectrum, self._own, self.albedo
        if own is not None:
            host = np.interp(own.wavelength_nm, star.wavelength_nm, star.photlam, left=0.0, right=0.0)
            ratio = np.divide(own.photlam, host, out=np.full_like(host, np.nan), where=host > 0.0)
            return own.wavelength_nm, own.photlam, ratio
        assert table is not None
        if table.wavelength_nm[0] >= star.wavelength_nm[-1] or table.wavelength_nm[-1] <= star.wavelength_nm[0]:
            span = f"{table.wavelength_nm[0]:g}-{table.wavelength_nm[-1]:g}"
            raise InputError(f"{self.path}.albedo", span, unit="nm", allowed="wavelengths of the star's spectrum")
        contrast = self.contrast_of(table.albedo)
        x, light, ratio = product_samples(star.wavelength_nm, star.photlam, table.wavelength_nm, contrast)
        return x, light * ratio, ratio


@functools.lru_cache(maxsize=64)
def _samples(planet: LitPlanet) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The samples of the planets asked for last: those of a whole catalogue would take a gigabyte."""
    found = planet.sample()
    for array in found:
        array.setflags(write=False)
    return found
