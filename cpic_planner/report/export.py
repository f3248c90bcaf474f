"""Measurements in images as tables that programs for orbits and spectra read: one row an observation of a planet.

``astrometry.csv`` is what orbitize! reads: one observation of each planet and band, the first realisation. Correlations
are left out there, since with them its OFTI keeps every orbit (``findings/orbitize_correlation_accepts_all.sh``); they
are in ``astrometry.ecsv``, with all realisations. What was not detected is in ``limits.ecsv``. ``photometry.ecsv`` has
contrasts and flux densities at the planets' places, detected or not, ``band_covariance.ecsv`` what they have in common.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from operator import itemgetter
from typing import Any

import numpy as np

from catalogs import Band
from cpic_core import FloatArray, Record
from cpic_planner import results
from cpic_planner.jobs import RunFolder
from cpic_planner.results import BandConfirmation, LimitRow, ObservationRow
from simulator.config import Instrument
from simulator.passbands import Passbands

EXPORT = "export/"
"""Folder of the files, in that of the run."""
ASTROMETRY = ("astrometry.csv", "astrometry.ecsv", "limits.ecsv")
PHOTOMETRY = ("photometry.ecsv", "band_covariance.ecsv", "passbands.ecsv")
CURVES = ("contrast_curve.csv", "contrast_curve.ecsv")
EXPORT_PRODUCTS = tuple(EXPORT + name for name in (*ASTROMETRY, *PHOTOMETRY, *CURVES))
"""Places of the files; those that would be empty are not written."""
PASSBAND, SPECTRUM = "passband-{band}.txt", "spectrum-{number}.txt"
"""Names of the curve of a band, and of the contrasts of a planet of a scene."""
STAR_FLUX_ERROR = 0.025
"""Relative error of the star's flux density by its V magnitude and spectrum, taken as 1 sigma and common to all bands.

The model of the Sun is within this of the measured one from 450 to 1100 nm (`simulator.stellar_spectrum`)."""
AnyImages = results.PlanResult | results.StarImagesResult | results.ConfirmResult


class Observed(Record):
    """One realisation of a planet in a band.

    Attributes
    ----------
    target : str
        Star or scene.
    number : int
        Of the planet among those of the target, from 1.
    band : BandConfirmation
    row : ObservationRow
    """

    target: str
    number: int
    band: BandConfirmation
    row: ObservationRow

    @property
    def flux(self) -> float | None:
        """Flux density of the planet; None without that of the star."""
        light = self.band.star_flux_density
        return None if light is None else light * self.row.contrast


def observed(result: AnyImages) -> Iterator[Observed]:
    """Yield every realisation of every planet and band, in the order of the result."""
    if isinstance(result, results.ConfirmResult):
        targets = [(result.scene, result.bands)]
    else:
        targets = [(target.name, target.bands) for target in result.targets]
    for name, bands in targets:
        planets = list(dict.fromkeys(band.planet for band in bands))
        for band in bands:
            for row in band.observations:
                yield Observed(name, planets.index(band.planet) + 1, band, row)


def astrometry_csv(result: AnyImages) -> str:
    """Return fitted places as orbitize! reads them: epoch in MJD, separation in mas, position angle in degrees.

    ``object`` counts the planets of a target, or the sources in files without a scene; orbitize! passes over columns of
    other names.
    """
    rows = []
    place: dict[str, Any]
    if isinstance(result, results.ConfirmResult) and result.bare:
        for number, source in enumerate(result.sources, 1):
            if source.mjd is not None:
                place = {"sep": 1e3 * source.separation_arcsec, "sep_err": 1e3 * source.separation_error_arcsec}
                place |= {"pa": source.pa_deg, "pa_err": source.pa_error_deg}
                about = {"target": result.scene, "planet": source.source, "band": source.band}
                rows.append({"epoch": source.mjd, "object": number} | place | about)
    for item in observed(result):
        row = item.row
        if row.realisation == 1 and row.separation_arcsec is not None and row.separation_error_arcsec is not None:
            place = {"sep": 1e3 * row.separation_arcsec, "sep_err": 1e3 * row.separation_error_arcsec}
            place |= {"pa": row.pa_deg, "pa_err": row.pa_error_deg}
            about = {"target": item.target, "planet": item.band.planet, "band": item.band.band}
            rows.append({"epoch": row.epoch_mjd, "object": item.number} | place | about)
    return results.csv_text(("epoch", "object", "sep", "sep_err", "pa", "pa_err", "target", "planet", "band"), rows)


def band_covariance(items: Sequence[Observed]) -> tuple[FloatArray, FloatArray]:
    """Return the covariance of the contrasts of a planet in some bands, and of its flux densities (W/m2/um)^2.

    Parameters
    ----------
    items : sequence of Observed
        One realisation of each band, with the star's flux density.

    Returns
    -------
    contrast, flux : ndarray, shape (bands, bands)

    Notes
    -----
    ``C_ij = delta_ij (s_i^2 + (c_i e_i)^2)`` with the error ``s`` of contrast ``c`` and the relative error ``e`` of the
    star's light off the mask. Bands have nothing in common: each has frames, wavefronts, speckles and a series off the
    mask of its own, and throughput, gain and flat field divide out, since planet and star are seen through the same.
    Flux densities ``f_i = F_i c_i`` share the star's magnitude: ``F_i F_j C_ij + f_i f_j m^2``, m `STAR_FLUX_ERROR`.
    """
    contrast, own, star = (
        np.array([getattr(item.row, name) for item in items])
        for name in ("contrast", "contrast_error", "star_flux_error")
    )
    light = np.array([item.band.star_flux_density or np.nan for item in items])
    errors, flux = np.hypot(own, contrast * star), contrast * light
    return np.diag(errors**2), np.diag((light * errors) ** 2) + STAR_FLUX_ERROR**2 * np.outer(flux, flux)


class BandPoint(Record):
    """A planet in a band, or two bands of it: what is measured there.

    Attributes
    ----------
    item, other : Observed
    contrast, flux : float
        Errors of `item`, or covariances of both.
    """

    item: Observed
    other: Observed
    contrast: float
    flux: float


_UM = 1e-3
_FLUX = "W m-2 um-1"
_WHO = (
    results.Column("target", "string", "star or scene", value=lambda item: item.target),
    results.Column("object", "int64", "number of the planet of the target", value=lambda item: item.number),
    *results.taken_of(BandConfirmation, "planet", "band", of=lambda item: item.band),
)


def _float(name: str, meaning: str, value: Callable[[BandPoint], float | None], unit: str = "") -> results.Column:
    return results.Column(name, "float64", meaning, unit, value=value)


def _of_item(column: results.Column) -> results.Column:
    return replace(column, value=lambda point: column.value and column.value(point.item))


def photometry_ecsv(result: AnyImages) -> str:
    """Return contrast and flux density of every planet, band and realisation, with the error of one band alone."""
    rows = []
    for item in observed(result):
        contrast, flux = (float(np.sqrt(part[0, 0])) for part in band_covariance([item]))
        rows.append(BandPoint(item, item, contrast, flux))
    columns = [
        *map(_of_item, (*_WHO, *results.taken_of(ObservationRow, "realisation", "detected", of=lambda item: item.row))),
        _float(
            "wavelength", "effective: of the star's photons", lambda it: _um(it.item.band.effective_wavelength_nm), "um"
        ),
        _float("width", "full width of the band", lambda it: _um(it.item.band.band_width_nm), "um"),
        _float("contrast", "planet over star", lambda it: it.item.row.contrast),
        _float("contrast_error", "1 sigma, the star's light off the mask included", lambda it: it.contrast),
        _float("flux", "contrast times the star's mean flux density", lambda it: it.item.flux, _FLUX),
        _float(
            *("flux_error", "1 sigma, the star's magnitude included"),
            lambda it: None if it.item.flux is None else it.flux,
            _FLUX,
        ),
    ]
    return _ecsv(result, columns, rows)


def covariance_ecsv(result: AnyImages) -> str:
    """Return the covariance of every two bands of a planet, first realisation: a row a pair, either order."""
    rows = []
    for items in _first(result):
        contrast, flux = band_covariance(items)
        for i, item in enumerate(items):
            rows += [BandPoint(item, other, *map(float, (contrast[i, j], flux[i, j]))) for j, other in enumerate(items)]
    columns = [
        *map(_of_item, _WHO),
        results.Column("other_band", "string", "the second of the pair", value=lambda it: it.other.band.band),
        _float("contrast_covariance", "of both contrasts", lambda it: it.contrast),
        _float("flux_covariance", "of both flux densities", lambda it: it.flux, "W2 m-4 um-2"),
    ]
    return _ecsv(result, columns, rows)


def spectrum_txt(items: Sequence[Observed]) -> str:
    """Return what TauREx reads: wavelength (um), contrast, its error, width (um) of each band of a planet.

    The wavelength is the middle of the band, about which TauREx lays the width.
    """
    errors = np.sqrt(np.diag(band_covariance(items)[0]))
    rows = []
    for item, error in zip(items, errors.tolist(), strict=True):
        wavelength, width = _um(item.band.band_center_nm), _um(item.band.band_width_nm)
        rows.append(f"{wavelength!r} {item.row.contrast!r} {error!r} {width!r}\n")
    return "".join(sorted(rows, key=lambda line: float(line.split()[0])))


def passband_samples(band: Band) -> tuple[FloatArray, FloatArray]:
    """Return wavelengths (um) and throughput of filter, optics and detector, linear between them and 0 at both ends."""
    low, high = band.support_nm
    inside = np.array([low, high]) if band.curve is None else band.curve.wavelength_nm
    edges = 1e-6 * band.width_nm
    throughput = np.concatenate([[0.0], band.transmission(inside), [0.0]])
    return np.concatenate([[low - edges], inside, [high + edges]]) * _UM, throughput


def _um(length_nm: float | None) -> float | None:
    return None if length_nm is None else length_nm * _UM


def _first(result: AnyImages) -> Iterator[list[Observed]]:
    """Yield the bands of each planet, first realisation."""
    planets: dict[tuple[str, int], list[Observed]] = {}
    for item in observed(result):
        if item.row.realisation == 1 and item.band.star_flux_density is not None:
            planets.setdefault((item.target, item.number), []).append(item)
    yield from planets.values()


def _ecsv(result: AnyImages, columns: Sequence[results.Column], rows: Sequence[Any]) -> str:
    meta = {name: getattr(result, name) for name in ("fingerprint", "config_hash", "instrument", "sigma")}
    return results.ecsv_text(columns, rows, meta) if rows else ""


_FITTED = tuple(name for name in results.names_of(ObservationRow) if name not in ("detected", "contrast_limit"))
_MISSED = ("realisation", "epoch_mjd", "contrast", "contrast_error", "contrast_limit")


def observations_ecsv(result: AnyImages, *, detected: bool) -> str:
    """Return the realisations that show their planet with all that is known of its place, or those that do not.

    Parameters
    ----------
    result : PlanResult, StarImagesResult or ConfirmResult
    detected : bool
        Whether those with a detection are wanted; of the others the limits at the known place are told.
    """
    columns = [*_WHO]
    if not detected:
        columns += results.taken_of(BandConfirmation, "separation_arcsec", "pa_deg", of=lambda item: item.band)
    columns += results.taken_of(ObservationRow, *(_FITTED if detected else _MISSED), of=lambda item: item.row)
    rows = [item for item in observed(result) if item.row.detected is detected]
    return _ecsv(result, columns, rows)


def export_products(bands: Iterable[str], planets: int) -> list[str]:
    """Return the names of all files, for some bands and so many planets of a scene."""
    spectra = [SPECTRUM.format(number=number + 1) for number in range(planets)]
    own = [*(PASSBAND.format(band=band) for band in bands), *spectra]
    return [*EXPORT_PRODUCTS, *(EXPORT + name for name in own)]


def write_export(
    folder: RunFolder, result: AnyImages, instrument: Instrument, bodies: Iterable[tuple[str, Mapping[str, Any]]]
) -> None:
    """Write the files of `export_products`, each whole; passbands of the bands that were measured.

    Parameters
    ----------
    folder : RunFolder
    result : PlanResult, StarImagesResult or ConfirmResult
    instrument : Instrument
    bodies : iterable of (str, mapping)
        Star or scene, and what `cpic_planner.validation.confirm.confirm_task` returned of it in a band.
    """
    tables = {
        "astrometry.csv": astrometry_csv(result),
        "astrometry.ecsv": observations_ecsv(result, detected=True),
        "limits.ecsv": observations_ecsv(result, detected=False),
        "photometry.ecsv": photometry_ecsv(result),
        "band_covariance.ecsv": covariance_ecsv(result),
    }
    measured = dict.fromkeys(item.band.band for item in observed(result))
    curves = {band.name: passband_samples(band) for band in Passbands.from_instrument(instrument).bands}
    curves = {name: curve for name, curve in curves.items() if name in measured}
    every = [
        (name, *point)
        for name, curve in curves.items()
        for point in zip(*(part.tolist() for part in curve), strict=True)
    ]
    for name in curves:
        tables[PASSBAND.format(band=name)] = "".join(f"{x!r} {y!r}\n" for band, x, y in every if band == name)
    columns = [
        results.Column("band", "string", value=itemgetter(0)),
        results.Column("wavelength", "float64", "linear in between", "um", value=itemgetter(1)),
        results.Column("throughput", "float64", "filter, optics and detector, e-/ph", value=itemgetter(2)),
    ]
    tables["passbands.ecsv"] = _ecsv(result, columns, every)
    searches = ((name, body["search"]) for name, body in bodies if body["search"] is not None)
    limits = [
        (name, search["band"], LimitRow.model_validate(row)) for name, search in searches for row in search["curve"]
    ]
    of_curve = [
        results.Column("target", "string", "star or scene", value=itemgetter(0)),
        results.Column("band", "string", value=itemgetter(1)),
        *results.taken_of(LimitRow, of=itemgetter(2)),
    ]
    tables[CURVES[1]] = _ecsv(result, of_curve, limits)
    cells = [{"target": name, "band": band} | results.values_of(row) for name, band, row in limits]
    tables[CURVES[0]] = results.csv_text([column.name for column in of_curve], cells) if limits else ""
    if isinstance(result, results.ConfirmResult):
        tables |= {SPECTRUM.format(number=items[0].number): spectrum_txt(items) for items in _first(result)}
    for name, text in tables.items():
        if text and not (name == "astrometry.csv" and text.count("\n") == 1):
            folder.write(EXPORT + name, text)
