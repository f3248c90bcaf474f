"""Zodiacal light and earthshine of the CSST: the calculator of its integral-field spectrograph."""

from __future__ import annotations

from typing import Any

import numpy as np

from reports.external.comparison import Reference, Row

TITLE = "Sky of the CSST: ifs-etc"
REFERENCE = Reference(
    "ifs-etc", "0.1.4", "package index, calculator of the spectrograph CSST-IFS, `refdata/csst`", ("ifs-etc==0.1.4",)
)
TEXT = """
The calculator of another instrument of the same telescope has spectra of zodiacal light and of earthshine at three
levels each, without places in the sky. Its medium zodiacal light is ours opposite the Sun at 520 nm; the highest and
the lowest are beside ours at 50 degrees from the Sun, which is as near as the telescope may point, and at the pole of
the ecliptic. The levels are one spectrum, redder than ours: divided by the spectrum of the Sun it grows as 1 + 1.3
log10(wavelength / 500 nm), where equation 22 of Leinert et al. (1998), which ours follows, has 0.6 far from the Sun
and 0.8 at 30 degrees. Table 19 of Leinert, which pyEDITH takes, is less red than either of the two. Which of the
three is right is open. The medium earthshine is the source of our default level (24.3 mag/arcsec2), so that only its
colour is a comparison: the Sun's in both.
"""
WAVELENGTHS_NM, AVERAGED_NM = (520.0, 662.0, 720.0, 850.0), 20.0
PLACES = {"high": (50.0, 0.0), "med": (180.0, 0.0), "low": (90.0, 90.0)}  # longitude from the Sun and latitude, degrees
UNIT = "photons/s/cm2/nm/arcsec2"
HC_ERG_NM = 1.986445857e-9  # erg per photon times its wavelength


def peer() -> dict[str, Any]:
    """Read what ifs-etc reads."""
    import json
    from pathlib import Path

    import ifs_etc

    folder = Path(ifs_etc.__file__).parent / "refdata/csst"
    found: dict[str, Any] = {"area_cm2": json.loads((folder / "telescope/config.json").read_text())["coll_area"]}
    for name, file in (("zodi", "zodi_spec"), ("earthshine", "earthshine_spec")):
        table = np.genfromtxt(folder / f"background/{file}.csv", delimiter=",", names=True)
        for level in PLACES:
            light = np.interp(np.array(WAVELENGTHS_NM) * 10.0, table["wave"], table[f"{name}_{level}"])
            photons = 10.0 * light * np.array(WAVELENGTHS_NM) / HC_ERG_NM  # 10: light is per angstrom
            found[f"{name}_{level}"] = photons.tolist()
    return found


def rows(recorded: dict[str, Any]) -> list[Row]:
    """Return the sky of both."""
    from simulator import load_instrument, star_photlam
    from simulator.effects.sky import elongation_deg, zodiacal_photlam_arcsec2, zodiacal_radiance

    def near(wavelength_nm: float, places_nm: Any, photlam: Any) -> float:
        """Return photons per nm, averaged over the lines of the Sun."""
        return 10.0 * float(np.mean(photlam[np.abs(places_nm - wavelength_nm) <= AVERAGED_NM]))

    instrument = load_instrument()
    area = np.pi / 4.0 * (100.0 * instrument.telescope.diameter_m) ** 2
    found = [Row("collecting area (cm2)", recorded["area_cm2"], float(area), 1e-9, "a clear disc of 2 m in both")]
    for level, place in PLACES.items():
        radiance = float(zodiacal_radiance(*place).radiance_500nm_w_m2_sr_um)
        light = zodiacal_photlam_arcsec2(radiance, float(elongation_deg(*place)))
        ours = [near(wavelength, light.wavelength_nm, light.photlam) for wavelength in WAVELENGTHS_NM]
        theirs = recorded[f"zodi_{level}"]
        where = f"{place[0]:g} degrees of longitude from the Sun, latitude {place[1]:g}"
        what = f"zodiacal light at 520 nm ({UNIT}), `{level}` beside ours at {where}"
        about = (0.05, "opposite the Sun") if level == "med" else (0.25, "a level without a place")
        found.append(Row(what, theirs[0], ours[0], *about))
        if level == "med":
            for index, wavelength in enumerate(WAVELENGTHS_NM[1:], 1):
                what = f"the same at {wavelength:g} nm over that at 520 nm, `{level}`"
                numbers = theirs[index] / theirs[0], ours[index] / ours[0]
                found.append(Row(what, *numbers, 0.03, "reddening: 1.3 against 0.6 a decade", expected=False))
    brightness = instrument.sky.earthshine.brightness_v_mag_arcsec2
    places = np.linspace(450.0, 950.0, 2001)
    photlam = star_photlam(brightness, "G2V")(10.0 * places).value
    for wavelength, theirs in zip(WAVELENGTHS_NM, recorded["earthshine_med"], strict=True):
        what = f"earthshine ({UNIT}), `med` beside our default, {wavelength:g} nm"
        found.append(Row(what, theirs, near(wavelength, places, photlam), 0.05, "the Sun in both"))
    return found
