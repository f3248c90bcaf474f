"""A star of our catalogue in one of the two bands of the sheet of Stark et al. 2025: its light, sky and date."""

from __future__ import annotations

import datetime
import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

DIAMETER_M = 7.87


@functools.cache
def passbands() -> Any:
    """The two bands of the sheet, without losses: rates per nm are photon fluxes."""
    from catalogs import Band
    from cpic_planner import Passbands

    return Passbands.from_bands(
        [Band("B500", "VIS", 500.0, 100.0, 1.0, 1.0), Band("B1000", "NIR", 1000.0, 200.0, 1.0, 1.0)]
    )


@dataclass(frozen=True)
class Star:
    """A star by its name in one band: what our catalogue and spectra say.

    Attributes
    ----------
    name : str
    wavelength_nm : float
    """

    name: str
    wavelength_nm: float

    @functools.cached_property
    def row(self) -> Any:
        """The star in our catalogue."""
        from cpic_planner import load_targets

        stars = load_targets()
        return stars[stars["hip"] == int(self.name.split()[1])].iloc[0]

    @property
    def width_nm(self) -> float:
        """Width of the band."""
        return 0.2 * self.wavelength_nm

    @property
    def lambda_d_arcsec(self) -> float:
        """Wavelength over diameter."""
        return float(np.rad2deg(self.wavelength_nm * 1e-9 / DIAMETER_M) * 3600.0)

    def _per_nm(self, rates: Any) -> float:
        return float(rates[(500, 1000).index(int(self.wavelength_nm))]) / self.width_nm

    def of_spectrum(self, spectrum: Any) -> float:
        """Mean photon flux of a spectrum in the band, ph/s/cm2/nm."""
        return self._per_nm(passbands().spectrum_rate_e_s(spectrum.wavelength_nm, spectrum.photlam, 1.0))

    def light(self, v_mag: float | None = None) -> float:
        """Mean photon flux of the star in the band, ph/s/cm2/nm; of its companion where a magnitude is given."""
        found = self.row
        magnitude = found.v_mag if v_mag is None else v_mag
        return self._per_nm(passbands().star_rate_e_s(magnitude, found.teff_k, found.log_g, found.metallicity, 1.0))

    def vega(self) -> float:
        """Mean photon flux of Vega in the band, ph/s/cm2/nm."""
        from catalogs import load_reference_spectrum

        return self.of_spectrum(load_reference_spectrum("vega"))

    def date(self, sun_longitude_deg: float) -> str:
        """Day of 2028 on which the star is nearest to so many degrees of ecliptic longitude from the Sun."""
        from simulator.effects.sky import ecliptic_deg, sun_longitude_deg as longitude_of_sun

        longitude, _ = ecliptic_deg(self.row.ra_deg, self.row.dec_deg)
        first = datetime.datetime(2028, 1, 1, tzinfo=datetime.UTC)
        days = [first + datetime.timedelta(days=day) for day in range(366)]
        off = [float(longitude) - longitude_of_sun(day) - sun_longitude_deg for day in days]
        return days[int(np.argmin(np.abs((np.array(off) + 180.0) % 360.0 - 180.0)))].strftime("%Y-%m-%d")

    def zodiacal(self, sun_longitude_deg: float) -> float:
        """Zodiacal light at the star, ph/s/cm2/nm/arcsec2."""
        from simulator.effects.sky import ecliptic_deg, elongation_deg, zodiacal_photlam_arcsec2, zodiacal_radiance

        _, latitude = ecliptic_deg(self.row.ra_deg, self.row.dec_deg)
        radiance = zodiacal_radiance(sun_longitude_deg, latitude).radiance_500nm_w_m2_sr_um
        elongation = elongation_deg(sun_longitude_deg, latitude)
        return self.of_spectrum(zodiacal_photlam_arcsec2(float(radiance), float(elongation)))
