"""The dial of the exposure-time calculator and the records of closed forms."""

import pytest

from catalogs.errors import InputError
from cpic_planner.etc.fidelity import closed_form_fidelity, etc_dial, etc_fidelity
from cpic_planner.etc.model import build_model
from cpic_planner.etc.questions import exposure_time, signal_to_noise
from cpic_planner.etc.stated_error import stated_error
from cpic_planner.targets import find_target
from simulator.config import load_instrument


@pytest.fixture(scope="module")
def answers():
    model, star = build_model(load_instrument()), find_target("tau Cet")[0]
    return signal_to_noise(model, star, time_s=7200.0, separation_arcsec=[0.1, 0.6], bands=["F520", "F850"])


def test_the_dial_is_quick_without_any():
    assert etc_dial().fidelity == etc_dial("quick").fidelity == "quick"
    assert etc_dial("standard").fidelity == "standard"
    assert etc_dial(tolerance=0).fidelity == "reference"
    assert etc_dial(tolerance=0.02).tolerance["snr"] == 0.02
    for wrong in (
        {"fidelity": "fast"},
        {"tolerance": 0.6},
        {"tolerance": -0.1},
        {"tolerance": float("nan")},
        {"fidelity": "quick", "tolerance": 0.1},
    ):
        with pytest.raises(InputError, match=next(iter(wrong))):
            etc_dial(**wrong)


def test_answers_without_frames_are_passed_over(answers):
    assert [answer.n_frames is None for answer in answers] == [True, False, True, False]
    record = etc_fidelity(answers, etc_dial(), seed=3)
    assert [item.answer for item in record.answers] == [1, 3]
    assert (record.fidelity, record.tolerance, record.seed) == ("quick", None, None)
    assert etc_fidelity(answers, etc_dial(tolerance=0.3)).tolerance == 0.3


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
