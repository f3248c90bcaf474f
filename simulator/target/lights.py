"""The light of a scene's planets: the star's, reflected, or their own.

The light of a scene's stars, worked out when it is asked for.
"""

import functools
from typing import TypeAlias

import numpy as np

from catalogs import Albedo, Band, Spectrum, load_stellar_grid, luminosity_from_v, stellar_parameters
from cpic_core import InputError, Record
from simulator.config import STAR_MODELS, Place, Planet, SceneStar, SpectrumTable, inside, true_distance_au
from simulator.passbands import band_integral, band_projection, product_samples
from simulator.target.albedo import albedo_notes, albedo_table, needs_insolation, phase_value
from simulator.target.contrast import contrast_at
from simulator.target.star_spectrum import (
    StarModel,
    StarSpectrum,
    photon_flux,
    read_spectrum,
    stellar_spectrum,
    thermal_photlam,
)


class LitPlanet(Record, eq=False):
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
    host: "LitStar"

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
        """Return what was assumed, clamped or extrapolated; in a band, or anywhere in the spectrum."""
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
        """Return planet over star for a geometric albedo: Eq. 1 of Zhu et al. 2025, with the wanted phase function."""
        planet = self.planet
        assert planet.albedo is not None
        assert planet.radius_rjup is not None
        assert planet.phase_deg is not None
        assert self.distance_au is not None
        full = contrast_at(planet.radius_rjup, self.distance_au, 0.0, albedo)
        return np.asarray(full * phase_value(planet.albedo, planet.phase_deg, insolation_au=self.insolation_au))

    def band_contrast(self, band: Band) -> float:
        """Return the true contrast in a band: ratio of detected rates, both integrals exact for the given samples."""
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
        """Return the wavelengths, photon flux density and contrast, finely enough to be taken as linear in between."""
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
    """Return the samples of the planets asked for last: those of a whole catalogue would take a gigabyte."""
    found = planet.sample()
    for array in found:
        array.setflags(write=False)
    return found


_Parameters: TypeAlias = tuple[float, str | None, float | None, float | None, float | None]
ORIGIN = Place(0.0, 0.0)
"""Where the central star stands."""


def table_spectrum(table: SpectrumTable) -> Spectrum:
    """Return a user's table as photon flux density."""
    unit, flux = ("flam", table.flam) if table.photlam is None else ("photlam", table.photlam)
    return photon_flux("spectrum", np.array(table.wavelength_nm), np.array(flux), unit)


class LitStar(Record, eq=False):
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

    @functools.cached_property
    def spectrum(self) -> StarSpectrum:
        """Spectrum at the telescope, scaled to the V magnitude, with the parameters used and flags."""
        star = self.star
        model = table_spectrum(star.spectrum) if isinstance(star.spectrum, SpectrumTable) else star.spectrum
        with inside(self.path):
            return _spectrum(self._parameters, model)

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
        """Return what was assumed or clamped."""
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
            key = f"{self.path}.{'distance_pc' if star.distance_pc is None else 'teff_k'}"
            allowed = "a value, where the insolation of a planet follows from the star's luminosity"
            hint = "or give luminosity_lsun, or the planet's insolation_au"
            raise InputError(key, "missing", allowed=allowed, hint=hint)
        known = {"metallicity": star.metallicity, "log_g": star.log_g}
        given = {key: value for key, value in known.items() if value is not None}
        return luminosity_from_v(star.v_mag, star.distance_pc, teff, **given), ("luminosity_derived",)

    def rate_e_s_cm2(self, band: Band) -> float:
        """Return the detected electrons per second and cm2 of the telescope."""
        return self.in_band(band)[0]

    def in_band(self, band: Band) -> tuple[float, tuple[str, ...]]:
        """Return the detected electrons per second and cm2 of the telescope, and what was assumed or clamped."""
        model = self.star.spectrum
        if model in STAR_MODELS and "spectrum" not in self.__dict__:
            with inside(self.path):
                return _kept_rate(self._parameters, model, band)
        star = self.spectrum
        with inside(f"{self.path}.spectrum"):
            return band_integral(band, star.wavelength_nm, star.photlam), star.flags


def _spectrum(asked: _Parameters, model: StarModel) -> StarSpectrum:
    v_mag, spectral_type, teff_k, log_g, metallicity = asked
    return stellar_spectrum(v_mag, spectral_type, teff_k=teff_k, log_g=log_g, metallicity=metallicity, model=model)


@functools.lru_cache(maxsize=4096)
def _kept_rate(asked: _Parameters, model: str, band: Band) -> tuple[float, tuple[str, ...]]:
    """Return the rate and flags of a star of a shipped model, from `LitStar._parameters`, model and band.

    The field of a scene is asked for again by every visit and every prediction. Files are not kept: they may change.
    """
    star = _spectrum(asked, model)
    with inside("spectrum"):
        return band_integral(band, star.wavelength_nm, star.photlam), star.flags
