"""The dial, the records of closed forms, and their stated errors: where the numbers come from, and that they hold."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest

from cpic_planner.etc import build_model, closed_form_fidelity, planet_offsets, usable_range_arcsec
from cpic_planner.etc.fidelity import (
    COMPANION_ERROR,
    CORNER_ERROR,
    PLACE_ERROR,
    PLANET_FLUX_ERROR,
    SPECKLE_ARCSEC,
    WHITE_SNR_ERROR,
    WINGS_ERROR,
    etc_fidelity,
    speckle_error,
    speckle_error_extrapolated,
    stated_error,
)
from cpic_planner.etc.questions import exposure_time, signal_to_noise
from cpic_planner.queries import ReferencePlanet, Strategy
from cpic_planner.ranking import best_in_band
from cpic_planner.targets import find_target
from cpic_planner.validation import aperture_weights
from simulator.config import load_instrument
from simulator.imaging import single_band_psf
from simulator.knobs import dial_of


@pytest.fixture(scope="module")
def answers():
    model, star = build_model(load_instrument()), find_target("tau Cet")[0]
    return signal_to_noise(model, star, time_s=7200.0, separation_arcsec=[0.1, 0.6], bands=["F520", "F850"])


def test_a_dial_is_a_tier_or_a_tolerance(refused):
    assert [dial_of(name).fidelity for name in ("quick", "standard", None)] == ["quick", "standard", "standard"]
    assert dial_of(tolerance=0).fidelity == "reference"
    assert dial_of(tolerance=0.02).tolerance["snr"] == 0.02
    for wrong in (
        {"fidelity": "fast"},
        {"tolerance": 0.6},
        {"tolerance": -0.1},
        {"tolerance": float("nan")},
        {"fidelity": "quick", "tolerance": 0.1},
    ):
        refused(next(iter(wrong)), dial_of, **wrong)


def test_answers_without_frames_are_passed_over(answers):
    assert [answer.n_frames is None for answer in answers] == [True, False, True, False]
    record = etc_fidelity(answers, dial_of("quick"), seed=3)
    assert [item.answer for item in record.answers] == [1, 3]
    assert (record.fidelity, record.tolerance, record.seed) == ("quick", None, None)
    assert etc_fidelity(answers, dial_of(tolerance=0.3)).tolerance == 0.3


def test_the_error_is_that_of_the_budget(answers):
    for answer in answers[1::2]:
        record = closed_form_fidelity(0, answer)
        assert record.closed_form_error == stated_error(answer.band, 0.6, answer.budget)
        assert record.predicted_error == record.closed_form_error
        assert record.images is None
    # What speckles dominate is less certain.
    assert closed_form_fidelity(0, answers[1]).predicted_error["snr"] > 0.03
    assert closed_form_fidelity(0, answers[3]).predicted_error["snr"] < 0.03


def test_the_infrared_has_no_stated_error():
    model, star = build_model(load_instrument(), ["F940"]), find_target("tau Cet")[0]
    (answer,) = exposure_time(model, star, snr=0.1, separation_arcsec=0.8, contrast=1e-6)
    assert answer.n_frames is not None
    assert closed_form_fidelity(0, answer).predicted_error is None


def test_plain_answers_have_no_fidelity_in_their_json(answers):
    assert answers[1].fidelity is None
    assert "fidelity" not in answers[1].to_dict()


REPORTS = Path(__file__).resolve().parents[3] / "reports/truth"


def test_without_speckles_the_snr_is_as_good_as_white_noise():
    assert stated_error("F520", 0.6, {"signal_e": 5.0, "planet_e2": 9.0, "speckle_e2": 0.0}) == {
        "planet_flux": PLANET_FLUX_ERROR,
        "snr": WHITE_SNR_ERROR,
    }


def test_speckles_alone_carry_their_whole_error():
    error = stated_error("F850", 0.9, {"speckle_e2": 4.0})
    off = speckle_error("F850", 0.9)
    assert off == CORNER_ERROR
    assert error["snr"] == pytest.approx(WHITE_SNR_ERROR + off)  # SNR goes as 1 over the speckles


def test_more_speckles_never_lower_the_error():
    shares = np.linspace(0.0, 1.0, 41)
    errors = [stated_error("F662", 0.7, {"read_noise_e2": 1 - s, "speckle_e2": s})["snr"] for s in shares]
    assert np.all(np.diff(errors) > 0)
    # To first order half the share of the variance times the error.
    assert errors[1] - errors[0] == pytest.approx(0.5 * shares[1] * 2 * speckle_error("F662", 0.7), rel=0.2)


def test_bands_without_a_measurement_have_no_stated_error():
    assert stated_error("F1265", 0.6, {"planet_e2": 1.0}) is None
    assert speckle_error("F1265", 0.6) is None


def test_between_and_beyond_the_measured_separations():
    assert speckle_error("F520", 0.2) == speckle_error("F662", 0.7) == PLACE_ERROR
    assert speckle_error("F520", 2.0) == speckle_error("F850", 0.9) == CORNER_ERROR
    assert speckle_error("F850", 0.8) == pytest.approx((PLACE_ERROR + CORNER_ERROR) / 2)


@pytest.mark.parametrize(
    ("band", "low", "high"), [("F520", 0.4, 0.9), ("F662", 0.5, 0.9), ("F720", 0.5, 0.9), ("F850", 0.5, 0.9)]
)
def test_answers_outside_the_measured_separations_say_so(band, low, high):
    for place in (low, 0.65, high):
        assert not speckle_error_extrapolated(band, place)
    for place in (low - 1e-3, high + 1e-3):
        assert speckle_error_extrapolated(band, place)
    assert not speckle_error_extrapolated("F1265", 2.0)  # no error is stated there at all
    model, star = build_model(load_instrument(), [band]), find_target("tau Cet")[0]
    ends = usable_range_arcsec(model.instrument, band)
    for place in (0.65, *(end for end in ends if not low <= end <= high)):
        (answer,) = signal_to_noise(model, star, time_s=3600.0, separation_arcsec=place, contrast=1e-7)
        assert ("speckle_error_extrapolated" in answer.flags) is (place != 0.65)
        assert answer.status == "ok"


def test_speckles_are_those_of_the_report():
    """The closed forms are exact where rings are whole, and within the stated error everywhere."""
    text = (REPORTS / "etc_accuracy" / "report.md").read_text(encoding="utf-8")
    rows = re.findall(r"\| (F\d+) \| (0\.\d) \| 0\.05 \| 0 \| \S+ \| \S+ \| (\S+) ± (\S+) \|", text)
    places = {(band, float(place)): (abs(float(ratio) - 1.0), float(error)) for band, place, ratio, error in rows}
    for band, ends in SPECKLE_ARCSEC.items():
        assert ends == tuple(limit([at for name, at in places if name == band]) for limit in (min, max))
    for (band, place), (off, error) in places.items():
        assert off + error <= speckle_error(band, place), (band, place)
        assert off <= (0.02 if place <= 0.7 else 0.145), (band, place)
        assert error < 0.035


def test_white_noise_is_that_of_the_report():
    with (REPORTS / "etc_accuracy" / "monte_carlo.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    columns = ("snr_etc_over_mc", "significance_etc_over_mc")
    worst = max(abs(float(row[name]) - 1.0) for row in rows for name in columns)
    assert 0.8 * WHITE_SNR_ERROR < worst <= WHITE_SNR_ERROR


@pytest.mark.parametrize("band", ["F520", "F662", "F720", "F850"])
def test_planet_light_is_that_of_images(band):
    instrument = load_instrument()
    metrics = build_model(instrument).metrics[band]
    psf, pixel = single_band_psf(band, instrument=instrument), metrics.pixel_scale_arcsec
    middle, radius = len(metrics.hole) // 2, metrics.aperture_radius_arcsec / pixel
    inner, outer = usable_range_arcsec(instrument, band)
    for place in np.linspace(inner, outer, 7):
        x, y = (float(part) for part in planet_offsets(build_model(instrument), find_target("tau Cet")[0], band, place))
        image = psf.at(x, y)
        light = np.sum(image * aperture_weights(image.shape, middle + x / pixel, middle + y / pixel, radius))
        known = metrics.core_throughput(np.array([x]), np.array([y]))[0]
        assert known == pytest.approx(light, rel=PLANET_FLUX_ERROR)


def test_planets_of_the_blind_validator_lie_within_it():
    """SNR of images of one visit over that of the ETC, 200 realisations each, against the error stated beforehand."""
    model = build_model(load_instrument(), None, Strategy(visits=1))
    kept = json.loads((REPORTS / "blind_validator" / "results.json").read_text(encoding="utf-8"))
    rows = [row for row in kept["chain"]["rows"] if row["chain"] == "sums of frames"]
    assert len(rows) == 20
    for row in rows:
        star, band = find_target(row["star"])[0], row["band"]
        best = best_in_band(model, star, band, 36000.0, ReferencePlanet())
        answer = signal_to_noise(
            model, star, bands=[band], time_s=36000.0, separation_arcsec=float(best.separation_arcsec[0])
        )[0]
        chance = (float(row["high"]) - float(row["low"])) / 3.92
        allowed = stated_error(band, answer.separation_arcsec, answer.budget)["snr"]
        assert abs(float(row["ratio"]) - 1.0) <= allowed + 2.0 * chance, (row["star"], band)


def test_the_light_of_a_companion_carries_its_own_error():
    alone = stated_error("F662", 0.6, {"companion_e2": 4.0})["snr"]
    assert alone == pytest.approx(WHITE_SNR_ERROR + COMPANION_ERROR, rel=0.06)
    assert stated_error("F662", 0.6, {"companion_e2": 1.0, "sky_e2": 1.0})["snr"] < alone
    assert stated_error("F662", 0.6, {"sky_e2": 1.0})["snr"] == pytest.approx(WHITE_SNR_ERROR)


def test_the_wings_of_a_companion_carry_their_own_error():
    alone = stated_error("F662", 0.6, {"companion_wings_e2": 4.0})["snr"]
    assert alone == pytest.approx(WHITE_SNR_ERROR + WINGS_ERROR)
    shares = np.linspace(0.0, 1.0, 21)
    errors = [stated_error("F662", 0.6, {"speckle_e2": 1 - s, "companion_wings_e2": s})["snr"] for s in shares]
    assert np.all(np.diff(errors) > 0)
    assert errors[0] == pytest.approx(stated_error("F662", 0.6, {"speckle_e2": 1.0})["snr"])
