"""SNR of many realisations, and the factor between prediction and measurement."""

import numpy as np
import pytest

from cpic_planner.results import BandConfirmation
from cpic_planner.validation import PREDICTION_ERROR, calibrate, mean_snr, snr_scatter
from cpic_planner.validation.findings import optimism, standing


def band(predicted, recovered, error):
    return BandConfirmation(
        band="F520",
        status="ok",
        reason="",
        message="",
        separation_arcsec=0.5,
        pa_deg=315.0,
        predicted_snr=predicted,
        predicted_significance=predicted,
        recovered_snr=recovered,
        recovered_snr_error=error,
    )


def measured(rng, snr, n, apertures):
    """Fluxes of unit noise, and errors from so many apertures."""
    flux = snr + rng.standard_normal(n)
    error = np.sqrt(rng.chisquare(apertures - 1, n) / (apertures - 1))
    return flux, error


@pytest.mark.parametrize(("n", "apertures"), [(1, 12), (4, 12), (8, 12), (24, 20)])
def test_the_mean_snr_is_unbiased_and_its_error_honest(n, apertures):
    rng = np.random.default_rng(n)
    found = np.array(
        [mean_snr(*measured(rng, 10.0, n, apertures), significance=10.0, n_apertures=apertures) for _ in range(1500)]
    )
    # One draw of 1 / sigma is too large by 3 / (4 nu) with nu degrees of freedom; of n draws the n-th part.
    bias = 10.0 * 3 / (4 * (apertures - 1) * n)
    assert abs(found[:, 0].mean() - 10.0 - bias) < 0.05 * bias + 4 * found[:, 0].std() / np.sqrt(1500)
    ratio = found[:, 0].std() / np.sqrt((found[:, 1] ** 2).mean())
    assert ratio == pytest.approx(1.0, abs=0.2)


def test_the_mean_of_ratios_would_be_biased():
    rng = np.random.default_rng(1)
    flux, error = measured(rng, 10.0, 20_000, 9)
    assert np.mean(flux / error) > 1.08 * mean_snr(flux, error, significance=10.0, n_apertures=9)[0]


def test_calibration_weighs_and_widens():
    assert calibrate([]).ratio is None
    assert "nothing" in calibrate([]).text
    one = calibrate([band(10.0, 9.0, 0.3)])
    assert one.ratio == pytest.approx(0.9)
    assert one.error == pytest.approx(np.hypot(0.03, PREDICTION_ERROR * 0.9))
    rng = np.random.default_rng(0)
    draws = []
    for _ in range(2000):
        true = 1.0 + PREDICTION_ERROR * rng.standard_normal(6)
        errors = np.array([0.5, 0.5, 1.0, 1.0, 2.0, 4.0])
        recovered = 20.0 * true + errors * rng.standard_normal(6)
        draws.append(calibrate([band(20.0, r, e) for r, e in zip(recovered, errors, strict=True)]))
    ratios, errors = np.array([d.ratio for d in draws]), np.array([d.error for d in draws])
    assert abs(ratios.mean() - 1) < 4 * ratios.std() / np.sqrt(len(draws))
    assert 0.62 < np.mean(np.abs(ratios - 1) < errors) < 0.80
    assert np.mean(np.abs(ratios - 1) < 2 * errors) > 0.93


def test_bands_that_disagree_enlarge_the_error():
    close = calibrate([band(10.0, r, 0.2) for r in (9.9, 10.0, 10.1, 10.0)])
    apart = calibrate([band(10.0, r, 0.2) for r in (6.0, 14.0, 6.0, 14.0)])
    assert apart.error > 3 * close.error


def test_bands_without_a_measurement_are_passed_over():
    empty = BandConfirmation(
        band="F850", status="saturated", reason="adc_range", message="", separation_arcsec=0.5, pa_deg=0.0
    )
    assert calibrate([empty, band(10.0, 9.0, 0.3)]).n_bands == 1


@pytest.mark.parametrize(
    ("recovered", "word"),
    [(10.0, "agrees"), (9.2, "agrees"), (8.0, "optimistic by 1.25"), (12.5, "pessimistic by 0.80"), (0.3, "missed")],
)
def test_a_factor_is_named_beyond_two_standard_errors_only(recovered, word):
    text = calibrate([band(10.0, recovered, 0.2)]).text
    assert word in text
    assert ("optimistic" in text) == (recovered == 8.0)


def test_optimism_is_the_inverse_ratio():
    factor, error = optimism(0.8, 0.04)
    assert factor == pytest.approx(1.25)
    assert error / factor == pytest.approx(0.04 / 0.8)
    assert standing(0.8, 0.04) == "optimistic"
    assert standing(0.93, 0.04) == "agrees"
    assert standing(1.3, 0.04) == "pessimistic"


@pytest.mark.parametrize(("snr", "significance", "n"), [(5.0, 5.0, 12), (30.0, 40.0, 20), (10.0, 12.0, 9)])
def test_scatter_of_one_measurement_against_draws(snr, significance, n):
    """The planet's own noise is measured with the flux, the scatter of the background from n apertures."""
    rng = np.random.default_rng(0)
    quiet = (snr / significance) ** 2
    flux = snr + rng.standard_normal(40_000)
    background = quiet * rng.chisquare(n - 1, flux.size) / (n - 1)
    own = (1 - quiet) * np.maximum(flux, 0) / snr
    scatter = np.std(flux / np.sqrt(background + own))
    assert scatter == pytest.approx(snr_scatter(snr, significance, n), rel=0.15)
