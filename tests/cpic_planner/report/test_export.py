"""Tables for programs that fit orbits and spectra."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest
from astropy.table import Table
from scipy.stats import chi2, kstest

from cpic_core import numeric_context
from cpic_planner.confirm.scene import _work
from cpic_planner.queries import ConfirmQuestion
from cpic_planner.report.export import (
    STAR_FLUX_ERROR,
    Observed,
    astrometry_csv,
    band_covariance,
    covariance_ecsv,
    observations_ecsv,
    photometry_ecsv,
)
from cpic_planner.results import BandConfirmation, ConfirmResult, ObservationRow, PlanResult
from cpic_planner.validation import visit_pair
from cpic_planner.validation.confirm import _star, _star_light
from cpic_planner.validation.measure import measure_planets, planet_templates


def observation(realisation: int, *, detected: bool = True, fitted: bool = True) -> ObservationRow:
    place = {"separation_arcsec": 0.5, "separation_error_arcsec": 0.002, "pa_deg": 300.0, "pa_error_deg": 0.25}
    seen = {"contrast": 2e-9, "contrast_error": 3e-10, "contrast_limit": 1.5e-9, "star_flux_error": 2e-4}
    about = {"realisation": realisation, "epoch_mjd": 61771.25, "detected": detected}
    return ObservationRow(**about, **seen, **(place if fitted else {}))


@pytest.fixture
def seen(confirmation: ConfirmResult) -> ConfirmResult:
    """Two planets, and three realisations of each band: a place, no detection, and a fit without an end."""
    drawn = [observation(1), observation(2, detected=False, fitted=False), observation(3, fitted=False)]
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
            update={"bands": [band.model_copy(update={"observations": [observation(1)]}) for band in target.bands]}
        )
        for target in plan.targets
    ]
    table = Table.read(astrometry_csv(plan.model_copy(update={"targets": drawn})), format="ascii.csv")
    assert set(table["object"]) == {1}
    assert list(dict.fromkeys(table["target"])) == [target.name for target in plan.targets]


def test_nothing_is_no_table(confirmation: ConfirmResult) -> None:
    assert observations_ecsv(confirmation, detected=True) == ""
    assert astrometry_csv(confirmation).count("\n") == 1


def test_flux_is_contrast_times_the_star(seen: ConfirmResult) -> None:
    light = {
        "star_flux_density": 4e-9,
        "effective_wavelength_nm": 521.0,
        "band_center_nm": 520.0,
        "band_width_nm": 50.0,
    }
    result = seen.model_copy(update={"bands": [band.model_copy(update=light) for band in seen.bands]})
    table = Table.read(photometry_ecsv(result), format="ascii.ecsv")
    assert len(table) == sum(len(band.observations) for band in result.bands)
    assert table["flux"].unit.to_string("fits") == "W um-1 m-2"
    assert (table["wavelength"][0], table["flux"][0]) == pytest.approx((0.521, 8e-18))
    alone = np.hypot(3e-10, 2e-9 * 2e-4)
    assert table["contrast_error"][0] == pytest.approx(alone)
    assert table["flux_error"][0] == pytest.approx(np.hypot(4e-9 * alone, 8e-18 * 0.025))
    pairs = Table.read(covariance_ecsv(result), format="ascii.ecsv")
    first = pairs[pairs["object"] == 1]
    n_bands = len(set(first["band"]))
    flux = np.array(first["flux_covariance"]).reshape(n_bands, n_bands)
    assert flux == pytest.approx(flux.T)
    assert flux[0, 1] == pytest.approx((8e-18 * 0.025) ** 2)
    assert np.array(first["contrast_covariance"]).reshape(n_bands, n_bands) == pytest.approx(np.eye(n_bands) * alone**2)


def test_photometry_without_the_light_of_the_star_has_contrasts(seen: ConfirmResult) -> None:
    table = Table.read(photometry_ecsv(seen), format="ascii.ecsv")
    assert table["flux"].mask.all()
    assert table["contrast"][0] == 2e-9
    assert covariance_ecsv(seen) == ""


DRAWS = 400


@functools.cache
def drawn_bands() -> dict[str, tuple[np.ndarray, BandConfirmation]]:
    """Measure a planet 400 times in each visible band: forced photometry in sums of frames, at the known place.

    Each draw has its own error of the star's light off the mask.
    """
    frames = {"exposure_s": 9.5, "n_frames": 200, "em_gain": 150.0, "strategy": {"visits": 1}}
    question = ConfirmQuestion.of(frames | {"scene": "paper_example", "audit": False})
    found = {}
    with numeric_context():
        for task in _work(question).tasks:
            visits = visit_pair(task)
            planets, star = planet_templates(visits), _star(visits, measured=True)
            rng = np.random.default_rng(len(found))
            rows = []
            for number in range(DRAWS):
                drawn = replace(star, rate_e_s=star.rate_e_s + rng.normal(0.0, star.error_e_s))
                ((item,), _) = measure_planets(visits, visits.draw(number), planets, drawn, searched=False)
                assert item is not None
                rows.append((item.contrast, item.contrast_error, star.error_e_s / star.rate_e_s))
            light = _star_light(visits)
            truth = task.predictions[0]["contrast"]
            found[task.band] = (
                np.array(rows),
                BandConfirmation(
                    band=task.band,
                    status="ok",
                    reason="",
                    message="",
                    separation_arcsec=0.65,
                    pa_deg=315.0,
                    true_contrast=truth,
                    **light,
                ),
            )
    return found


@pytest.mark.long
def test_bands_have_no_noise_in_common() -> None:
    contrasts = np.array([rows[:, 0] for rows, _ in drawn_bands().values()])
    mixed = np.corrcoef(contrasts)[np.triu_indices(len(contrasts), 1)]
    assert np.abs(mixed).max() < 4 / np.sqrt(DRAWS)


@pytest.mark.long
@pytest.mark.parametrize("n_bands", [2, 3, 4])
@pytest.mark.parametrize("kind", ["contrast", "flux"])
def test_covariance_tells_how_bands_scatter(n_bands: int, kind: str) -> None:
    """Squared Mahalanobis distances from the truth follow chi squared with as many degrees of freedom as bands."""
    bands = list(drawn_bands().values())[:n_bands]
    rng = np.random.default_rng(9)
    squares = []
    for number in range(DRAWS):
        items = []
        for rows, band in bands:
            contrast, error, star = rows[number]
            row = observation(1).model_copy(
                update={"contrast": contrast, "contrast_error": error, "star_flux_error": star}
            )
            items.append(Observed("star", 1, band, row))
        off = np.array([item.row.contrast - (item.band.true_contrast or 0.0) for item in items])
        covariance, of_flux = band_covariance(items)
        if kind == "flux":
            # The star is brighter or fainter than its magnitude says, the same in all bands.
            light = np.array([item.band.star_flux_density for item in items])
            measured = np.array([item.row.contrast for item in items])
            off = light * (measured - (measured - off) * (1.0 + rng.normal(0.0, STAR_FLUX_ERROR)))
            covariance = of_flux
        squares.append(off @ np.linalg.solve(covariance, off))
    assert kstest(squares, chi2(n_bands).cdf).pvalue > 0.01
