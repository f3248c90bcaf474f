"""Make a table of point sources from a scene: where they stand on the detector and how bright they are.

Parity and roll, by which offsets on the sky become offsets on the detector, are applied in this one place.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, TypeAlias, overload

import numpy as np

from cpic_core import ArrayLike, InputError, Record, check_finite, check_number, numeric_context
from simulator import config
from simulator.config import Instrument, InstrumentLike, Scene, StarColumns
from simulator.passbands import Passbands
from simulator.target.lights import ORIGIN, LitPlanet, LitStar
from simulator.target.star_spectrum import synphot_source

if TYPE_CHECKING:
    import pandas as pd
    from astropy.table import QTable
    from synphot import SourceSpectrum


Kind: TypeAlias = Literal["cstar", "planet", "star"]
_NUMBERS = dict.fromkeys(("x_arcsec", "y_arcsec", "separation_arcsec"), "arcsec") | {"pa_deg": "deg"}
_NUMBERS |= dict.fromkeys(("distance_au", "insolation_au"), "AU")
_COLUMNS = ("name", "kind", *_NUMBERS, "flags", "spectrum")


class SpectralSource(Record, eq=False):
    """One source: where it stands and its spectrum at the telescope.

    Attributes
    ----------
    name : str
    kind : {"cstar", "planet", "star"}
    x_arcsec, y_arcsec : float
        Offset from the central star on the detector.
    light : LitStar or LitPlanet
        What the spectrum is made from.
    """

    name: str
    kind: Kind
    x_arcsec: float
    y_arcsec: float
    light: LitStar | LitPlanet

    @property
    def separation_arcsec(self) -> float:
        """Separation from the central star."""
        return self.light.place.separation_arcsec

    @property
    def pa_deg(self) -> float:
        """Position angle, degrees east of north."""
        return self.light.place.pa_deg

    @property
    def distance_au(self) -> float | None:
        """True distance of a planet from its star, None for stars and where nothing depends on it."""
        return self.light.distance_au if isinstance(self.light, LitPlanet) else None

    @property
    def insolation_au(self) -> float | None:
        """Insolation used for the albedo, as the distance from the Sun that has it; None where it has no part."""
        return self.light.insolation_au if isinstance(self.light, LitPlanet) else None

    @property
    def wavelength_nm(self) -> np.ndarray:
        """Wavelengths of the samples; the spectrum is linear between them and zero outside."""
        return self.light.wavelength_nm

    @property
    def photlam(self) -> np.ndarray:
        """Photon flux density at the samples, ph/s/cm2/A."""
        return self.light.photlam

    @property
    def contrast(self) -> np.ndarray | None:
        """Planet over star at the samples; None for stars."""
        return self.light.contrast if isinstance(self.light, LitPlanet) else None

    @property
    def flags(self) -> tuple[str, ...]:
        """What was assumed, clamped or extrapolated."""
        return self.light.flags()

    @functools.cached_property
    def spectrum(self) -> SourceSpectrum:
        """The spectrum as a synphot source, PHOTLAM over Angstrom."""
        meta = {"name": self.name, "kind": self.kind, "flags": self.flags}
        return synphot_source(self.wavelength_nm, self.photlam, meta)

    def __getitem__(self, column: str) -> Any:
        if column not in _COLUMNS and column not in ("wavelength_nm", "photlam", "contrast"):
            raise InputError("column", column, allowed=", ".join(_COLUMNS))
        return getattr(self, column)


class SourceTable(Record, Sequence[SpectralSource], eq=False):
    """Sources of one scene, the central star first.

    ``table[0]`` and ``table["planet 1"]`` are rows, iteration goes over rows, and the names of the columns are
    attributes: ``table.x_arcsec`` is an array, ``table.spectrum`` a tuple of synphot sources.

    Attributes
    ----------
    scene : str
        Name of the scene.
    rows : tuple of SpectralSource
    columns : tuple of str
        Names of the columns.
    name, kind : tuple of str
        Names of the sources; ``cstar``, ``planet`` or ``star``.
    x_arcsec, y_arcsec : ndarray
        Offsets along detector columns and rows.
    separation_arcsec, pa_deg : ndarray
        Separations from the central star, and position angles, degrees east of north.
    distance_au : ndarray
        True distances of planets from their star; nan where a source has none.
    insolation_au : ndarray
        Insolations used for albedos; nan where it has no part.
    flags : tuple of tuple of str
        What was assumed, clamped or extrapolated.
    spectrum : tuple of synphot.SourceSpectrum
        Spectra as synphot sources, PHOTLAM over Angstrom.
    """

    scene: str
    rows: tuple[SpectralSource, ...]
    columns: ClassVar[tuple[str, ...]] = _COLUMNS

    def __len__(self) -> int:
        return len(self.rows)

    @overload
    def __getitem__(self, key: int) -> SpectralSource: ...
    @overload
    def __getitem__(self, key: slice) -> tuple[SpectralSource, ...]: ...
    @overload
    def __getitem__(self, key: str) -> Any: ...
    def __getitem__(self, key: int | slice | str) -> Any:
        """Return the row by number or name, rows by slice, or column by its name."""
        if not isinstance(key, str):
            return self.rows[key]
        for row in self.rows:
            if row.name == key:
                return row
        if key in _COLUMNS:
            return getattr(self, key)
        raise InputError("source", key, allowed=", ".join((*self.name, *_COLUMNS)))

    def __getattr__(self, column: str) -> Any:
        """Return a column: an array of its numbers, or a tuple of what are none."""
        if column not in _COLUMNS:
            raise AttributeError(column)
        cells = [getattr(row, column) for row in self.rows]
        return np.array(cells, dtype=np.float64) if column in _NUMBERS else tuple(cells)

    def to_pandas(self) -> pd.DataFrame:
        """Return the table, without the spectra, as a data frame; flags joined by ``|``."""
        return _frame([self])

    def to_table(self) -> QTable:
        """Return the table, without the spectra, as an astropy table with units; flags joined by ``|``."""
        return _qtable([self])


class SourceBatch(Record, Sequence[SourceTable], eq=False):
    """Source tables of many scenes, one after the other.

    Attributes
    ----------
    tables : tuple of SourceTable
    """

    tables: tuple[SourceTable, ...]

    def __len__(self) -> int:
        return len(self.tables)

    @overload
    def __getitem__(self, key: int | str) -> SourceTable: ...
    @overload
    def __getitem__(self, key: slice) -> tuple[SourceTable, ...]: ...
    def __getitem__(self, key: int | slice | str) -> SourceTable | tuple[SourceTable, ...]:
        """Return the table by number or name of its scene, tables by slice."""
        if not isinstance(key, str):
            return self.tables[key]
        for table in self.tables:
            if table.scene == key:
                return table
        raise InputError("scene", key, allowed="the name of a scene of the batch")

    def to_pandas(self) -> pd.DataFrame:
        """Return all rows, without the spectra, as one data frame with a first column ``scene``."""
        return _frame(self.tables, scene=True)

    def to_table(self) -> QTable:
        """Return all rows, without the spectra, as one astropy table with a first column ``scene``."""
        return _qtable(self.tables, scene=True)


def _columns(tables: Sequence[SourceTable], *, scene: bool = False) -> dict[str, Any]:
    rows = [row for table in tables for row in table.rows]
    columns: dict[str, Any] = {}
    if scene:
        columns["scene"] = [table.scene for table in tables for _ in table.rows]
    columns |= {name: [getattr(row, name) for row in rows] for name in ("name", "kind")}
    columns |= {name: np.array([getattr(row, name) for row in rows], dtype=np.float64) for name in _NUMBERS}
    return columns | {"flags": ["|".join(row.flags) for row in rows]}


def _frame(tables: Sequence[SourceTable], *, scene: bool = False) -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame(_columns(tables, scene=scene))


def _qtable(tables: Sequence[SourceTable], *, scene: bool = False) -> QTable:
    from astropy.table import QTable

    return QTable(_columns(tables, scene=scene), units=_NUMBERS)


def sky_to_detector(
    separation_arcsec: ArrayLike, pa_deg: ArrayLike, *, roll_deg: float = 0.0, parity: int = -1
) -> tuple[np.ndarray, np.ndarray]:
    """Return the detector offset from the star of a source at a separation and position angle.

    ``x = parity rho sin(PA - roll)``, ``y = rho cos(PA - roll)``. With parity -1 (the paper's text) and
    roll 0, north is +y and east is -x; with +1 (the orientation of its figures) east is +x.

    Parameters
    ----------
    separation_arcsec : array_like
        Separation, at least 0.
    pa_deg : array_like
        Position angle, degrees east of north.
    roll_deg : float
        Rotation of the sky on the detector; it never rotates mask, hole or speckles.
    parity : {-1, +1}
        Orientation of the detector.

    Returns
    -------
    x_arcsec, y_arcsec : ndarray
        Offsets, broadcast shape.

    Raises
    ------
    InputError
        If a value is not finite, the separation negative or the parity another number.
    """
    rho = check_finite("separation_arcsec", separation_arcsec, "arcsec")
    if np.any(rho < 0.0):
        raise InputError("separation_arcsec", float(rho.min()), unit="arcsec", allowed="at least 0")
    pa, roll = check_finite("pa_deg", pa_deg, "deg"), check_number("roll_deg", roll_deg, "deg")
    with np.errstate(over="ignore"):
        angle = np.deg2rad(check_finite("pa_deg - roll_deg", pa - roll, "deg"))
    # Adding zero turns the -0 of the star itself into 0.
    return _parity(parity) * rho * np.sin(angle) + 0.0, rho * np.cos(angle) + 0.0


def detector_to_sky(
    x_arcsec: ArrayLike, y_arcsec: ArrayLike, *, roll_deg: float = 0.0, parity: int = -1
) -> tuple[np.ndarray, np.ndarray]:
    """Return separation and position angle of a detector offset from the star.

    The inverse of `sky_to_detector`.

    Parameters
    ----------
    x_arcsec, y_arcsec : array_like
        Detector offsets from the star.
    roll_deg : float
        Rotation of the sky on the detector.
    parity : {-1, +1}
        Orientation of the detector.

    Returns
    -------
    separation_arcsec, pa_deg : ndarray
        Separation and position angle, 0 <= PA < 360; PA is the roll angle at the star itself.

    Raises
    ------
    InputError
        If a value is not finite or the parity another number than -1 and +1.
    """
    x, y = check_finite("x_arcsec", x_arcsec, "arcsec"), check_finite("y_arcsec", y_arcsec, "arcsec")
    roll = check_number("roll_deg", roll_deg, "deg")
    pa = np.mod(np.rad2deg(np.arctan2(_parity(parity) * x, y)) + roll, 360.0)
    with np.errstate(over="ignore"):
        separation = check_finite("separation_arcsec", np.hypot(x, y), "arcsec")
    # A tiny negative angle rounds to 360 itself.
    return separation, np.where(pa == 360.0, 0.0, pa)


def wcs_keywords(
    pixel_scale_arcsec: float,
    star_pixel: tuple[float, float],
    star_deg: tuple[float | None, float | None],
    *,
    roll_deg: float = 0.0,
    parity: int = -1,
) -> dict[str, float | str]:
    """Return the world coordinates of an image: the FITS keywords that say what `sky_to_detector` does.

    Parameters
    ----------
    pixel_scale_arcsec : float
        Pixel.
    star_pixel : tuple of float
        Column and row of the star, counted from 0.
    star_deg : tuple of float or None
        Right ascension and declination of the star. If unknown the axes are offsets from the star in degrees toward
        east and north (``CTYPE`` ``EAST`` and ``NORTH``).
    roll_deg : float
        Rotation of the sky on the detector.
    parity : {-1, +1}
        Orientation of the detector.
    """
    step = pixel_scale_arcsec / 3600.0
    angle = np.deg2rad(check_number("roll_deg", roll_deg, "deg"))
    sine, cosine, flip = float(np.sin(angle)), float(np.cos(angle)), _parity(parity)
    cards: dict[str, float | str] = {"CTYPE1": "EAST", "CTYPE2": "NORTH", "CUNIT1": "deg", "CUNIT2": "deg"}
    cards |= {"CRPIX1": star_pixel[0] + 1.0, "CRPIX2": star_pixel[1] + 1.0, "CRVAL1": 0.0, "CRVAL2": 0.0}
    ra_deg, dec_deg = star_deg
    if ra_deg is not None and dec_deg is not None:
        cards |= {"CTYPE1": "RA---TAN", "CTYPE2": "DEC--TAN", "CRVAL1": float(ra_deg), "CRVAL2": float(dec_deg)}
    cards |= {"CD1_1": flip * step * cosine, "CD1_2": step * sine}
    return cards | {"CD2_1": -flip * step * sine, "CD2_2": step * cosine}


def _parity(parity: int) -> int:
    if parity not in (-1, 1):
        raise InputError("parity", parity, allowed="-1, +1")
    return parity


SceneLike: TypeAlias = Scene | Mapping[str, Any] | str | Path


class Source(Record):
    """One point source in one band.

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
    flags : tuple of str
        What was assumed, clamped or extrapolated.
    """

    name: str
    kind: Kind
    x_arcsec: float
    y_arcsec: float
    rate_e_s: float
    contrast: float | None = None
    flags: tuple[str, ...] = ()


def scene_sources(scene: Scene, instrument: Instrument, band: str, *, roll_deg: float = 0.0) -> tuple[Source, ...]:
    """Return the point sources of a scene in one band, the central star first.

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

    Raises
    ------
    InputError
        If a spectrum or albedo does not cover the band, or a parameter is outside its model; the key says of which
        object.
    """
    passbands = Passbands.from_instrument(instrument)
    passband = passbands.bands[passbands.index(band)]
    area = instrument.telescope.area_cm2
    found: list[Source] = []
    for row in _rows(scene, roll_deg, instrument.detector.parity, "scene"):
        where = (row.name, row.kind, row.x_arcsec, row.y_arcsec)
        if isinstance(row.light, LitPlanet):
            contrast = row.light.band_contrast(passband)
            found.append(Source(*where, found[0].rate_e_s * contrast, contrast, row.light.flags(passband)))
        else:
            rate, flags = row.light.in_band(passband)
            found.append(Source(*where, area * rate, flags=flags))
    return tuple(found)


class ExtendedRate(NamedTuple):
    """An extended source in one band.

    Attributes
    ----------
    source : ExtendedSource
        A disc, ring or image.
    rate_e_s : float
        Detected electrons per second of all its light before the PSF.
    contrast : float
        The same over the central star's.
    """

    source: config.ExtendedSource
    rate_e_s: float
    contrast: float


def extended_rates(scene: Scene, instrument: Instrument, band: str) -> tuple[ExtendedRate, ...]:
    """Return the rates of the extended sources of a scene in one band: ``contrast`` times that of the central star.

    Parameters
    ----------
    scene : Scene
    instrument : Instrument
    band : str
        Name of a band of the instrument, such as ``F520``.

    Raises
    ------
    InputError
        For an unknown band, or a spectrum of the star that does not cover it.
    """
    if not scene.extended:
        return ()
    passbands = Passbands.from_instrument(instrument)
    star = LitStar(scene.cstar, "scene.cstar").rate_e_s_cm2(passbands.bands[passbands.index(band)])
    star *= instrument.telescope.area_cm2
    contrasts = ((source, source.contrast_to(scene.cstar.v_mag)) for source in scene.extended)
    return tuple(ExtendedRate(source, star * part, part) for source, part in contrasts)


@overload
def spectrum_generator(
    scene: SceneLike, *, roll_deg: float = 0.0, instrument: InstrumentLike = None
) -> SourceTable: ...
@overload
def spectrum_generator(
    scene: Sequence[Scene | Mapping[str, Any] | Path] | StarColumns,
    *,
    roll_deg: float = 0.0,
    instrument: InstrumentLike = None,
) -> SourceBatch: ...
@numeric_context()
def spectrum_generator(
    scene: SceneLike | Iterable[SceneLike] | StarColumns, *, roll_deg: float = 0.0, instrument: InstrumentLike = None
) -> SourceTable | SourceBatch:
    """Return the positions and spectra of every object of a scene.

    Parameters
    ----------
    scene : Scene, mapping, str or Path; or an iterable of these; or a table
        What `simulator.load_scene` reads. A table (pandas, astropy, the star catalogue) has one star a row, see
        `simulator.scenes_from_table`, which can also give each star a planet.
    roll_deg : float
        Roll of the telescope; it turns the sky on the detector.
    instrument : Instrument, mapping or str, optional
        What `simulator.load_instrument` reads; its detector parity orients the offsets.

    Returns
    -------
    SourceTable or SourceBatch
        Rows with ``name``, ``kind``, ``x_arcsec``, ``y_arcsec`` and ``spectrum`` (synphot, PHOTLAM over Angstrom), the
        central star first, then planets, then other stars; the same spectrum as arrays ``wavelength_nm`` and
        ``photlam``. For many scenes, one such table each. Spectra are worked out when they are asked for.

    Raises
    ------
    InputError
        Naming key, value, unit and allowed range of the first fault.

    Examples
    --------
    >>> from simulator import spectrum_generator
    >>> table = spectrum_generator("paper_example")
    >>> table.kind
    ('cstar', 'planet')
    >>> round(float(table["planet"].x_arcsec), 3)
    0.46
    """
    checked = instrument if isinstance(instrument, Instrument) else config.load_instrument(instrument)
    parity = checked.detector.parity
    if isinstance(scene, Scene | Mapping | str | Path):
        one = config.load_scene(scene)
        return SourceTable(one.name, tuple(_rows(one, roll_deg, parity, "scene")))
    if config.is_table(scene):
        scenes: Iterable[Scene] = config.scenes_from_table(scene)
    else:
        scenes = [_numbered(number, one) for number, one in enumerate(_listed(scene))]
    rows = ((one.name, _rows(one, roll_deg, parity, f"scenes.{number}")) for number, one in enumerate(scenes))
    return SourceBatch(tuple(SourceTable(name, tuple(sources)) for name, sources in rows))


def _listed(scenes: Any) -> list[SceneLike]:
    try:
        return list(scenes)
    except TypeError:
        raise InputError("scene", scenes, allowed="a scene, a sequence of scenes or a table of stars") from None


def _numbered(number: int, scene: SceneLike) -> Scene:
    try:
        return config.load_scene(scene)
    except InputError as error:
        key = f"scenes.{number}.{error.key.removeprefix('scene.')}"
        raise InputError(key, error.value, unit=error.unit, allowed=error.allowed, hint=error.hint) from None


def _rows(scene: Scene, roll_deg: float, parity: int, path: str) -> Iterable[SpectralSource]:
    host = LitStar(scene.cstar, f"{path}.cstar", ORIGIN)
    lights: list[tuple[str, Kind, LitStar | LitPlanet]] = [(scene.cstar.name, "cstar", host)]
    for number, planet in enumerate(scene.planets):
        where = config.place(scene.cstar, planet)
        lights.append((planet.name, "planet", LitPlanet(planet, f"{path}.planets.{number}", where, host)))
    for number, star in enumerate(scene.stars):
        if scene.is_lit(star):
            where = config.place(scene.cstar, star)
            lights.append((star.name, "star", LitStar(star, f"{path}.stars.{number}", where)))
    separations_arcsec = np.array([light.place.separation_arcsec for _, _, light in lights])
    angles_deg = np.array([light.place.pa_deg for _, _, light in lights])
    x, y = sky_to_detector(separations_arcsec, angles_deg, roll_deg=roll_deg, parity=parity)
    for index, (name, kind, light) in enumerate(lights):
        yield SpectralSource(name, kind, float(x[index]), float(y[index]), light)
