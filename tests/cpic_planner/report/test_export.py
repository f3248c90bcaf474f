"""Tables for programs that fit orbits and spectra."""

from __future__ import annotations

import numpy as np
import pytest
from astropy.table import Table

from cpic_planner.report.export import astrometry_csv, observations_ecsv
from cpic_planner.results import ConfirmResult, ObservationRow, PlanResult


def row(realisation: int, *, detected: bool = True, fitted: bool = True) -> ObservationRow:
    place = {"separation_arcsec": 0.5, "separation_error_arcsec": 0.002, "pa_deg": 300.0, "pa_error_deg": 0.25}
    seen = {"contrast": 2e-9, "contrast_error": 3e-10, "contrast_limit": 1.5e-9, "star_flux_error": 2e-4}
    about = {"realisation": realisation, "epoch_mjd": 61771.25, "detected": detected}
    return ObservationRow(**about, **seen, **(place if fitted else {}))


@pytest.fixture
def seen(confirmation: ConfirmResult) -> ConfirmResult:
    """Two planets, and three realisations of each band: a place, no detection, and a fit without an end."""
    drawn = [row(1), row(2, detected=False, fitted=False), row(3, fitted=False)]
    bands = [
        band.model_copy(update={"observations": drawn if band.status == "ok" else []}) for band in confirmation.bands
    ]
    return confirmation.model_copy(update={"bands": bands})


def test_orbitize_gets_one_observation_in_its_units(seen: ConfirmResult) -> None:
    table = Table.read(astrometry_csv(seen), format="ascii.csv")
    assert table.colnames[:6] == ["epoch", "object", "sep", "sep_err", "pa", "pa_err"]
    assert len(table) == sum(band.status == "ok" for band in seen.bands)
    assert set(table["object"]) == {1, 2}  # an integer, or orbitize! refuses it
    assert np.issubdtype(table["object"].dtype, np.integer)
    assert table["epoch"][0] == 61771.25
    assert (table["sep"][0], table["sep_err"][0], table["pa"][0], table["pa_err"][0]) == pytest.approx(
        (500, 2, 300, 0.25)
    )


def test_detections_and_limits_are_apart(seen: ConfirmResult) -> None:
    places, limits = (
        Table.read(observations_ecsv(seen, detected=detected), format="ascii.ecsv") for detected in (True, False)
    )
    assert set(places["realisation"]) == {1, 3}
    assert str(places["separation_arcsec"].unit) == "arcsec"
    assert list(places["separation_arcsec"].mask[:2]) == [False, True]
    assert set(limits["realisation"]) == {2}
    assert limits["contrast_limit"][0] == 1.5e-9
    assert limits["separation_arcsec"][0] == seen.bands[0].separation_arcsec
    assert places.meta["config_hash"] == seen.config_hash


def test_planets_are_counted_by_their_star(plan: PlanResult) -> None:
    drawn = [
        target.model_copy(
            update={"bands": [band.model_copy(update={"observations": [row(1)]}) for band in target.bands]}
        )
        for target in plan.targets
    ]
    table = Table.read(astrometry_csv(plan.model_copy(update={"targets": drawn})), format="ascii.csv")
    assert set(table["object"]) == {1}
    assert list(dict.fromkeys(table["target"])) == [target.name for target in plan.targets]


def test_nothing_is_no_table(confirmation: ConfirmResult) -> None:
    assert observations_ecsv(confirmation, detected=True) == ""
    assert astrometry_csv(confirmation).count("\n") == 1
