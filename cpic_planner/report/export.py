"""Measurements in images as tables that programs for orbits and spectra read: one row an observation of a planet.

``astrometry.csv`` is what orbitize! reads: one observation of each planet and band, the first realisation. Correlations
are left out there, since with them its OFTI keeps every orbit (``findings/orbitize_correlation_accepts_all.sh``); they
are in ``astrometry.ecsv``, with all realisations. What was not detected is in ``limits.ecsv``.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from cpic_core import Record
from cpic_planner import results
from cpic_planner.jobs import RunFolder
from cpic_planner.results import BandConfirmation, ObservationRow

EXPORT_PRODUCTS = ("astrometry.csv", "astrometry.ecsv", "limits.ecsv")
"""Names of the files; those that would be empty are not written."""
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

    ``object`` counts the planets of a target. Columns of other names are passed over by orbitize!.
    """
    rows = []
    for item in observed(result):
        row = item.row
        if row.realisation == 1 and row.separation_arcsec is not None and row.separation_error_arcsec is not None:
            place: dict[str, Any] = {"sep": 1e3 * row.separation_arcsec, "sep_err": 1e3 * row.separation_error_arcsec}
            place |= {"pa": row.pa_deg, "pa_err": row.pa_error_deg}
            about = {"target": item.target, "planet": item.band.planet, "band": item.band.band}
            rows.append({"epoch": row.epoch_mjd, "object": item.number} | place | about)
    return results.csv_text(("epoch", "object", "sep", "sep_err", "pa", "pa_err", "target", "planet", "band"), rows)


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
    columns = [
        results.Column("target", "string", "star or scene", value=lambda item: item.target),
        results.Column("object", "int64", "number of the planet of the target", value=lambda item: item.number),
        *results.taken_of(BandConfirmation, "planet", "band", of=lambda item: item.band),
    ]
    if not detected:
        columns += results.taken_of(BandConfirmation, "separation_arcsec", "pa_deg", of=lambda item: item.band)
    columns += results.taken_of(ObservationRow, *(_FITTED if detected else _MISSED), of=lambda item: item.row)
    rows = [item for item in observed(result) if item.row.detected is detected]
    meta = {"config_hash": result.config_hash, "instrument": result.instrument, "sigma": result.sigma}
    return results.ecsv_text(columns, rows, meta) if rows else ""


def write_export(folder: RunFolder, result: AnyImages) -> None:
    """Write the files of `EXPORT_PRODUCTS`, each whole."""
    tables = {
        "astrometry.csv": astrometry_csv(result),
        "astrometry.ecsv": observations_ecsv(result, detected=True),
        "limits.ecsv": observations_ecsv(result, detected=False),
    }
    for name, text in tables.items():
        if text.count("\n") > 1:
            folder.write(name, text)
