"""Stars and planets of a scene as configuration, with right ascension and declination as people write them."""

import math
import re
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, StrictBool

from catalogs import stellar_parameters
from cpic_core import InputError, is_file
from simulator.config.base import SpelledModel, other_names, required
from simulator.config.light import STAR_MODELS, AlbedoValue, PlanetLight, Real, SpectrumTable, StarLight

_NUMBER = r"\d+(?:\.\d*)?"
_SEXAGESIMAL = re.compile(
    rf"(?P<sign>[-+]?)\s*(?P<whole>\d+)\s*(?P<unit>[hd:\s])\s*"
    rf"(?P<minutes>\d{{1,2}})(?:\s*[m:\s]\s*(?:(?P<seconds>{_NUMBER})\s*s?)?)?"
)
_DECIMAL = re.compile(rf"(?P<sign>[-+]?)\s*(?P<value>{_NUMBER})\s*(?P<unit>[hd])")
_SPELLINGS = str.maketrans("−–°ʰᵐˢ′'″\"", "--dhmsmmss")
_DEGREES_PER_HOUR = 15.0


def right_ascension_deg(value: Any) -> float:
    """Return a right ascension in degrees.

    Parameters
    ----------
    value : float or str
        Degrees, 0 to 360; or text: hours as ``14:39:36.49``, ``14 39 36.49``, ``14h39m36.49s``, ``14.66h``; degrees
        only where it says so, ``219.9d`` or ``219d54m7s``.

    Raises
    ------
    InputError
        If it cannot be read or is out of range.
    """
    return _angle("ra_deg", value, _DEGREES_PER_HOUR, (0.0, 360.0), "0 to 360 degrees, or text such as 14:39:36.5")


def declination_deg(value: Any) -> float:
    """Return a declination in degrees.

    Parameters
    ----------
    value : float or str
        Degrees, -90 to 90; or text: ``-60:50:02.3``, ``-60 50 02.3``, ``-60d50m02.3s``, ``-60.84d``.

    Raises
    ------
    InputError
        If it cannot be read or is out of range.
    """
    return _angle("dec_deg", value, 1.0, (-90.0, 90.0), "-90 to 90 degrees, or text such as -60:50:02.3")


def _angle(key: str, value: Any, degrees_per_part: float, limits: tuple[float, float], allowed: str) -> float:
    if isinstance(value, str):
        degrees = _read(value, degrees_per_part)
    else:
        degrees = value if isinstance(value, int | float) and not isinstance(value, bool) else None
    # Not a number compares false.
    if degrees is None or not limits[0] <= degrees <= limits[1]:
        raise InputError(key, value, unit="" if isinstance(value, str) else "deg", allowed=allowed)
    return float(degrees)


def _read(text: str, degrees_per_part: float) -> float | None:
    """Return the degrees of an angle whose colons separate parts of that many degrees, None if it cannot be read."""
    plain = text.strip().lower().translate(_SPELLINGS)
    found = _SEXAGESIMAL.fullmatch(plain)
    if found:
        minutes, seconds = float(found["minutes"]), float(found["seconds"] or 0.0)
        if minutes >= 60.0 or seconds >= 60.0:
            return None
        size = math.fsum((float(found["whole"]), minutes / 60.0, seconds / 3600.0))
    else:
        found = _DECIMAL.fullmatch(plain)
        if not found:
            return None
        size = float(found["value"])
    hours = found["unit"] == "h" or (found["unit"] != "d" and degrees_per_part == _DEGREES_PER_HOUR)
    if hours and degrees_per_part != _DEGREES_PER_HOUR:
        return None
    # The sign belongs to the whole angle: -00:30:00 is south.
    return (-1.0 if found["sign"] == "-" else 1.0) * size * (_DEGREES_PER_HOUR if hours else 1.0)


MAX_SEPARATION_ARCSEC = 120.0
"""Farthest source from the central star; the detector reaches 12 arcsec, the light of companions farther."""

RightAscension = Annotated[float | None, BeforeValidator(lambda x: None if x is None else right_ascension_deg(x))]
Declination = Annotated[float | None, BeforeValidator(lambda x: None if x is None else declination_deg(x))]
Magnitude = Annotated[Real, Field(ge=-30, le=40)]

_ALIASES = other_names(ra_deg="ra", dec_deg="dec", separation_arcsec="separation", spectrum="model", teff_k="teff")
_ALIASES |= other_names(pa_deg="position_angle position_angle_deg pangle pa", v_mag="magnitude magnitude_v")
_ALBEDO_KEYS = ("log10_mh", "log10_fsed", "mh", "fsed", "insolation_au", "phase_function")
_PLANET_HINTS = {
    "distance": "distance_au is the planet's true distance from its star; the star's own is cstar.distance_pc",
    "distance_pc": "the distance of the system is cstar.distance_pc",
    "spectral_type": "a planet has a teff_k, for model: blackbody",
    "metallicity": "log10_mh for a parametric albedo",
}


class Body(SpelledModel):
    """The fields that every source has: a name, a place, and perhaps a brightness and a spectrum of its own.

    The place is either ``ra_deg`` and ``dec_deg`` (same epoch as the central star's) or ``separation_arcsec`` and
    ``pa_deg`` from the central star.

    Attributes
    ----------
    name : str
        Name in tables, headers and the truth.
    ra_deg, dec_deg : float or str, optional
        Right ascension and declination, ICRS: degrees, or text such as ``14:39:36.5``.
    separation_arcsec : float, optional
        Angle from the central star.
    pa_deg : float, optional
        Position angle from the central star, east of north.
    """

    name: str = ""
    ra_deg: RightAscension = None
    dec_deg: Declination = None
    separation_arcsec: Annotated[Real, Field(ge=0, le=MAX_SEPARATION_ARCSEC)] | None = None
    pa_deg: Annotated[Real, Field(ge=-360, le=360)] | None = None

    def _check_values(self) -> None:
        for pair in (("ra_deg", "dec_deg"), ("separation_arcsec", "pa_deg")):
            for one, other in (pair, pair[::-1]):
                if getattr(self, one) is None and getattr(self, other) is not None:
                    raise required(one, f"a value where {other} is given")
        if self.ra_deg is not None and self.separation_arcsec is not None:
            allowed = "either ra_deg and dec_deg, or separation_arcsec and pa_deg"
            raise InputError("ra_deg", "given with separation_arcsec", allowed=allowed)


class SceneStar(Body):
    """A star: brightness, atmosphere, and a place when it is not the central one.

    Attributes
    ----------
    v_mag : float
        Johnson V (Vega), to which the spectrum is scaled.
    spectral_type : str, optional
        MK type, which gives temperature and gravity where they are not given; a file or table needs neither.
    teff_k : float, optional
        Effective temperature.
    log_g : float, optional
        Decimal logarithm of the surface gravity in cm/s2.
    metallicity : float, optional
        Decimal logarithm of the metallicity over the Sun's.
    spectrum : str or SpectrumTable
        ``grid`` (shipped PHOENIX and CK04 fluxes), ``blackbody``, ``pickles``, the path of a file or of a CK04 or
        PHOENIX tree, or a table.
    distance_pc : float, optional
        Distance of the central star, which turns angles into distances.
    luminosity_lsun : float, optional
        Luminosity of the central star, which turns distances into insolation.
    companion : bool
        Whether the star stays away where a scene leaves companions out; no for a star of the field or a calibrator.
    """

    ALIASES = _ALIASES | other_names(spectral_type="sp_type sptype", log_g="logg", distance_pc="distance")
    ALIASES |= other_names(luminosity_lsun="luminosity")
    v_mag: Magnitude
    spectral_type: str | None = None
    teff_k: Annotated[Real, Field(ge=100, le=1e6)] | None = None
    log_g: Annotated[Real, Field(ge=-1, le=9)] | None = None
    metallicity: Annotated[Real, Field(ge=-5, le=2)] | None = None
    spectrum: StarLight = "grid"
    distance_pc: Annotated[Real, Field(gt=0, le=1e6)] | None = None
    luminosity_lsun: Annotated[Real, Field(gt=0, le=1e8)] | None = None
    companion: StrictBool = True

    def _check_values(self) -> None:
        super()._check_values()
        if self.spectral_type is not None:
            stellar_parameters(self.spectral_type)
        elif self.spectrum == "pickles":
            raise required("spectral_type", "an MK type such as K1V for spectrum: pickles")
        elif self.teff_k is None and self._needs_parameters():
            raise required("spectral_type", "an MK type such as K1V, or teff_k in K")

    def _needs_parameters(self) -> bool:
        """Return whether the spectrum is made from parameters: by a model or a tree of them, not by a file or table."""
        if isinstance(self.spectrum, SpectrumTable):
            return False
        return self.spectrum in STAR_MODELS or not is_file(self.spectrum)


class Planet(Body):
    """A planet: reflected light of the central star, or a light of its own.

    Reflected light needs ``radius_rjup`` (R_J = 71 492 km), ``phase_deg`` and an ``albedo`` (default Jupiter's). The
    true distance from the star is ``distance_au``; without it, that of the projected separation at the star's
    ``distance_pc``: ``r = rho / sin(phase)``.

    ``spectrum: blackbody`` is thermal light of temperature ``teff_k``, as bright as ``radius_rjup`` at the star's
    distance makes it or of the given ``v_mag``. A file or table is taken as it is, at the telescope, or scaled to
    ``v_mag``.

    Attributes
    ----------
    radius_rjup : float, optional
        Radius in Jupiter's equatorial radius, 71 492 km.
    distance_au : float, optional
        True distance from the star.
    phase_deg : float, optional
        Angle between star and observer as seen from the planet.
    albedo : optional
        A planet of the solar system, ``parametric``, a number, or a mapping with ``model`` or ``file``.
    spectrum : str or SpectrumTable
        ``reflected``, ``blackbody``, the path of a file, or a table.
    teff_k : float, optional
        Temperature of ``spectrum: blackbody``.
    v_mag : float, optional
        Johnson V of a planet with light of its own.
    """

    ALIASES = _ALIASES | other_names(radius_rjup="radius", phase_deg="phase phase_angle phase_angle_deg")
    ALIASES |= other_names(log10_mh="coe_metal", log10_fsed="coe_cloud")
    HINTS = _PLANET_HINTS
    MORE_KEYS = _ALBEDO_KEYS
    radius_rjup: Annotated[Real, Field(gt=0, le=10)] | None = None
    distance_au: Annotated[Real, Field(gt=0, le=1e12)] | None = None
    phase_deg: Annotated[Real, Field(ge=0, le=180)] | None = None
    albedo: AlbedoValue | None = None
    spectrum: PlanetLight = "reflected"
    teff_k: Annotated[Real, Field(ge=100, le=1e6)] | None = None
    v_mag: Magnitude | None = None

    @property
    def reflects(self) -> bool:
        """Whether the light is the star's, reflected."""
        return self.spectrum == "reflected"

    @classmethod
    def _read(cls, tree: dict[str, Any]) -> dict[str, Any]:
        return _with_albedo(tree)

    def _check_values(self) -> None:
        super()._check_values()
        if self.reflects:
            _refuse(self, ("teff_k", "v_mag"), "spectrum: reflected", "a key of a planet with light of its own")
            for name, why in (("radius_rjup", "radius in R_Jup"), ("phase_deg", "0 to 180 deg")):
                if getattr(self, name) is None:
                    raise required(name, f"a value: {why}")
            file = getattr(self.albedo, "file", None)
            if file is not None and not is_file(file):
                raise InputError("albedo.file", file, allowed="an existing file")
            return
        _refuse(self, ("albedo",), "light of its own", "a key of a planet in reflected light")
        if self.spectrum != "blackbody":
            _refuse(self, ("teff_k",), "a given spectrum", "a key of spectrum: blackbody")
        elif self.teff_k is None:
            raise required("teff_k", "a temperature in K for spectrum: blackbody")
        elif self.radius_rjup is None and self.v_mag is None:
            raise required("radius_rjup", "a radius in R_Jup, or v_mag, for spectrum: blackbody")


def _refuse(planet: Planet, names: tuple[str, ...], light: str, allowed: str) -> None:
    for name in names:
        if getattr(planet, name) is not None:
            raise InputError(name, f"given with {light}", allowed=allowed)


def _with_albedo(tree: dict[str, Any]) -> dict[str, Any]:
    """Gather the parameters of the albedo model, which the paper writes beside the others, under ``albedo``."""
    given = {key: tree.pop(key) for key in _ALBEDO_KEYS if key in tree}
    albedo = tree.get("albedo")
    if given:
        if albedo in (None, "parametric"):
            tree["albedo"] = {"model": "parametric", **given}
        elif isinstance(albedo, Mapping) and not set(albedo) & set(given):
            tree["albedo"] = {**albedo, **given}
        else:
            raise InputError("albedo", albedo, allowed="parametric, where its parameters stand beside it")
    elif albedo is None and tree.get("spectrum", "reflected") == "reflected":
        tree["albedo"] = "jupiter"
    return tree
