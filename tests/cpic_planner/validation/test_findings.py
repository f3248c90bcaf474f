"""SNR of many realisations, and the factor between prediction and measurement."""

import numpy as np
import pytest

from cpic_planner.validation import PREDICTION_ERROR, calibrate, mean_snr, snr_scatter
from cpic_planner.validation.verdict import MOST_ERROR, Calibration, calibration_of
from tests.cpic_planner import measured as targets


def band(predicted, recovered, error):
    return targets.band(
        "F520",
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
    assert calibrate([]).etc_ratio is None
    assert "no band was measured" in calibrate([]).text
    one = calibrate([band(10.0, 9.0, 0.3)])
    assert one.etc_ratio == pytest.approx(1 / 0.9)
    assert one.etc_ratio_error == pytest.approx(np.hypot(0.03, PREDICTION_ERROR * 0.9) / 0.81)
    rng = np.random.default_rng(0)
    draws = []
    for _ in range(2000):
        true = 1.0 + PREDICTION_ERROR * rng.standard_normal(6)
        errors = np.array([0.5, 0.5, 1.0, 1.0, 2.0, 4.0])
        recovered = 20.0 * true + errors * rng.standard_normal(6)
        draws.append(calibrate([band(20.0, r, e) for r, e in zip(recovered, errors, strict=True)]))
    # Their inverses have normal errors.
    ratios = 1.0 / np.array([d.etc_ratio for d in draws])
    errors = ratios**2 * np.array([d.etc_ratio_error for d in draws])
    assert abs(ratios.mean() - 1) < 4 * ratios.std() / np.sqrt(len(draws))
    assert 0.62 < np.mean(np.abs(ratios - 1) < errors) < 0.80
    assert np.mean(np.abs(ratios - 1) < 2 * errors) > 0.93


def test_bands_that_disagree_enlarge_the_error():
    close = calibrate([band(10.0, r, 0.2) for r in (9.9, 10.0, 10.1, 10.0)])
    apart = calibrate([band(10.0, r, 0.2) for r in (6.0, 14.0, 6.0, 14.0)])
    assert apart.etc_ratio_error > 3 * close.etc_ratio_error


def test_bands_without_a_measurement_are_passed_over():
    assert calibrate([targets.refused("F850"), band(10.0, 9.0, 0.3)]).n_bands == 1


@pytest.mark.parametrize(
    ("recovered", "words"),
    [
        (10.0, "1.00 +- 0.05 over 1 measurement: the ETC agrees with the images within two standard errors"),
        (9.2, "1.09 +- 0.06 over 1 measurement: the ETC agrees with the images within two standard errors"),
        (8.0, "1.25 +- 0.07 over 1 measurement: the ETC is optimistic by 25 %, beyond two standard errors"),
        (12.5, "0.80 +- 0.04 over 1 measurement: the ETC is pessimistic by 20 %, beyond two standard errors"),
        # 0.03 + 2 hypot(0.02, 0.0015) recovered of 1 predicted: predicted over recovered is above 14.
        (0.3, "above 14 over 1 measurement: the planets are missed, and the ETC is optimistic"),
    ],
)
def test_a_factor_is_named_beyond_two_standard_errors_only(recovered, words):
    assert calibrate([band(10.0, recovered, 0.2)]).text == f"predicted over recovered SNR {words}"


def test_the_ratio_is_predicted_over_recovered():
    found = calibration_of(10.0, 8.0, 1e-9)
    assert found.etc_ratio == pytest.approx(10.0 / 8.0)
    assert found.etc_ratio_error / found.etc_ratio == pytest.approx(PREDICTION_ERROR)
    for ratio, error, word in ((1.25, 0.06, "ETC optimistic by 25 %"), (1.07, 0.04, "ETC agrees")):
        assert Calibration(ratio, error, None, 1).standing == word
    assert Calibration(0.77, 0.02, None, 1).standing == "ETC pessimistic by 23 %"


@pytest.mark.parametrize(("first", "second"), [((1.03, 0.02), (1.04, 0.01)), ((0.97, 0.02), (0.96, 0.01))])
def test_the_same_ratio_has_the_same_words_before_its_verdict(first, second):
    """Two reports of one physics say the same number first; the word follows the error, and the size stands in it."""
    agreeing, off = (Calibration(ratio, error, None, 20) for ratio, error in (first, second))
    for found, (ratio, error) in ((agreeing, first), (off, second)):
        assert found.text.startswith(f"predicted over recovered SNR {ratio:.3f} +- {error:.3f} over 20 measurements: ")
    assert "agrees" in agreeing.text
    assert "by 4.0 %" in off.text


@pytest.mark.parametrize("realised", [1, 2, 8])
def test_bands_too_faint_to_tell_say_nothing_of_the_etc(realised):
    """Not of one band, and not of many: SNR of 1.5 that is known to 1 is no agreement, whatever is recovered."""
    rng = np.random.default_rng(realised)
    faint = [band(1.5, 1.5 + error, 1.0) for error in rng.standard_normal(realised)]
    found = calibrate(faint)
    assert (found.etc_ratio, found.n_bands, found.n_faint) == (None, 0, realised)
    assert found.text == "the planets are too faint in these images to measure the ETC by"
    for one in faint:
        alone = calibration_of(one.predicted_snr, one.recovered_snr, one.recovered_snr_error)
        assert alone.standing == "too faint to measure the ETC by"
    mixed = calibrate([*faint, band(10.0, 9.0, 0.3)])
    assert (mixed.etc_ratio, mixed.n_bands, mixed.n_faint) == (pytest.approx(1 / 0.9), 1, realised)
    assert f"over 1 measurement ({realised} more too faint to count)" in mixed.text


def test_what_tells_is_chosen_by_errors_and_not_by_luck():
    """The mean over faint bands is unbiased: those that come out low are kept as those that come out high."""
    rng = np.random.default_rng(4)
    error = 0.9 * MOST_ERROR
    found = [calibrate([band(1.0, 1.0 + error * draw, error) for draw in rng.standard_normal(30)]) for _ in range(400)]
    assert {one.n_bands for one in found} == {30}
    shares = 1.0 / np.array([one.etc_ratio for one in found])
    assert abs(shares.mean() - 1.0) < 4 * shares.std() / np.sqrt(len(found))


@pytest.mark.parametrize("predicted", [1.0, 5.0, 40.0])
@pytest.mark.parametrize("recovered", [-1.0, 0.0, 0.3, 0.8, 1.0, 1.3, 5.0])
@pytest.mark.parametrize("error", [0.01, 0.1, 0.19, 0.21, 0.5, 2.0])
def test_words_follow_the_number_in_every_case(predicted, recovered, error):
    """A ratio is stated or not, and the words of band and mean say what follows from it."""
    found = calibration_of(predicted, recovered * predicted, error * predicted)
    mean = calibrate([band(predicted, recovered * predicted, error * predicted)])
    assert mean == found
    if found.etc_ratio is None:
        assert "agrees" not in found.text + found.standing
        assert ("missed" in found.text) == (found.etc_ratio_least is not None)
        return
    away = (found.etc_ratio - 1.0) / found.etc_ratio_error
    assert ("optimistic" in found.text) == (away > 2.0)
    assert ("pessimistic" in found.text) == (away < -2.0)
    assert ("agrees" in found.text) == (abs(away) <= 2.0)


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
