"""From a scene to a table of point sources: where they stand on the detector and how bright they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from catalogs.errors import InputError
from simulator.config import Instrument, Scene, load_instrument, load_scene
from simulator.config.scene import Planet, SceneStar
from simulator.passbands import Passbands
from simulator.target.contrast import contrast_at
from simulator.target.positions import sky_to_detector

if TYPE_CHECKING:
    from collections.abc import Mapping

    from synphot import SourceSpectrum

__all__ = ["Source", "scene_sources", "spectrum_generator"]

Kind = Literal["cstar", "star", "planet"]


@dataclass(frozen=True)
class Source:
    """One point source.

    Attributes
    ----------
    name : str
    kind : {"cstar", "star", "planet"}
    x_arcsec, y_arcsec : float
        Offset from the central star on the detector.
    rate_e_s : float
        Detected electrons per second in the band before the PSF (apodizer, mask and aperture not applied).
    contrast : float or None
        For planets: band ratio of detected rates to the central star.
    """

    name: str
    kind: Kind
    x_arcsec: float
    y_arcsec: float
    rate_e_s: float
    contrast: float | None = None


def _star_rate(star: SceneStar, band: str, passbands: Passbands, area_cm2: float) -> float:
    if bool(passbands.grid_flags(star.teff_k, star.log_g, star.metallicity).teff_k):
        raise InputError(f"{star.name}.teff_k", star.teff_k, unit="K", allowed="3500 to 8000, the stellar grid")
    rates = passbands.star_rate_e_s(star.v_mag, star.teff_k, star.log_g, star.metallicity, area_cm2)
    return float(rates[passbands.index(band)])


def planet_band_contrast(planet: Planet, star: SceneStar, band: str, passbands: Passbands) -> float:
    """True contrast of a planet in a band: photon-weighted albedo times ``(R/r)^2 Phi`` (Eq. 1 of Zhu et al. 2025)."""
    albedo = passbands.band_albedo(planet.albedo, star.teff_k, star.log_g, star.metallicity)[passbands.index(band)]
    return float(contrast_at(planet.radius_rjup, planet.distance_au, planet.phase_deg, float(albedo)))


def scene_sources(scene: Scene, instrument: Instrument, band: str, *, roll_deg: float = 0.0) -> tuple[Source, ...]:
    """Point sources of a scene in one band, the central star first.

    Parameters
    ----------
    scene : Scene
    instrument : Instrument
    band : str
    roll_deg : float
        Roll of the telescope; it turns the sky on the detector.

    Returns
    -------
    tuple of Source
    """
    passbands = Passbands.from_instrument(instrument)
    area, parity = instrument.telescope.area_cm2, instrument.detector.parity
    star_rate = _star_rate(scene.cstar, band, passbands, area)
    found = [Source(scene.cstar.name, "cstar", 0.0, 0.0, star_rate)]
    for planet in scene.planets:
        x, y = sky_to_detector(planet.separation_arcsec, planet.pa_deg, roll_deg=roll_deg, parity=parity)
        contrast = planet_band_contrast(planet, scene.cstar, band, passbands)
        found.append(Source(planet.name, "planet", float(x), float(y), star_rate * contrast, contrast))
    if scene.companions == "on":
        for star in scene.stars:
            x, y = sky_to_detector(star.separation_arcsec, star.pa_deg, roll_deg=roll_deg, parity=parity)
            found.append(Source(star.name, "star", float(x), float(y), _star_rate(star, band, passbands, area)))
    return tuple(found)


@dataclass(frozen=True)
class SpectralSource:
    """One row of `spectrum_generator`: offsets in arcsec and the spectrum at the telescope."""

    name: str
    kind: Kind
    x_arcsec: float
    y_arcsec: float
    spectrum: SourceSpectrum


def spectrum_generator(scene: Scene | Mapping[str, Any]) -> tuple[SpectralSource, ...]:
    """Positions and spectra of every object of a scene.

    Parameters
    ----------
    scene : Scene or mapping
        See `simulator.load_scene`.

    Returns
    -------
    tuple of SpectralSource
        Central star first; offsets at roll 0 with the default detector parity; spectra as synphot
        ``SourceSpectrum`` (PHOTLAM over Angstrom).
    """
    import numpy as np
    from synphot import Empirical1D, SourceSpectrum

    from catalogs.spectra import load_albedo
    from simulator.target.star_spectrum import star_photlam

    checked = scene if isinstance(scene, Scene) else load_scene(scene)
    parity = load_instrument().detector.parity

    def spectrum(star: SceneStar) -> SourceSpectrum:
        return star_photlam(star.v_mag, teff_k=star.teff_k, log_g=star.log_g, metallicity=star.metallicity)

    host = spectrum(checked.cstar)
    rows = [SpectralSource(checked.cstar.name, "cstar", 0.0, 0.0, host)]
    for planet in checked.planets:
        x, y = sky_to_detector(planet.separation_arcsec, planet.pa_deg, parity=parity)
        table = load_albedo(planet.albedo)
        angstrom = np.asarray(host.waveset.value)
        inside = (angstrom >= table.wavelength_nm[0] * 10) & (angstrom <= table.wavelength_nm[-1] * 10)
        angstrom = angstrom[inside]
        albedo = np.interp(angstrom / 10.0, table.wavelength_nm, table.albedo)
        ratio = contrast_at(planet.radius_rjup, planet.distance_au, planet.phase_deg, albedo)
        light = SourceSpectrum(Empirical1D, points=angstrom, lookup_table=host(angstrom) * ratio)
        rows.append(SpectralSource(planet.name, "planet", float(x), float(y), light))
    if checked.companions == "on":
        for star in checked.stars:
            x, y = sky_to_detector(star.separation_arcsec, star.pa_deg, parity=parity)
            rows.append(SpectralSource(star.name, "star", float(x), float(y), spectrum(star)))
    return tuple(rows)
