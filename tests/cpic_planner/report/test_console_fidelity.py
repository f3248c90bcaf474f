"""What the terminal says of the firmness of answers."""

import io

import pytest
from rich.console import Console

from cpic_planner.report import print_fidelity
from cpic_planner.results import AnswerFidelity, EtcFidelity, ImageCheck, ModellingRecord
from simulator.knobs import FIDELITIES


def shown(result, width=110):
    stream = io.StringIO()
    print_fidelity(result, Console(file=stream, width=width, highlight=False))
    return stream.getvalue()


def images(**changed):
    made = ModellingRecord(
        fidelity="standard",
        tolerance={"snr": 0.03},
        predicted_error={"snr": 0.01},
        draw="sums",
        region="hole",
        epochs=6,
        knobs=FIDELITIES["standard"],
        effects=[],
    )
    known = {
        "draw": "sums",
        "realisations": 13,
        "light_ratio": 1.0013,
        "flux_ratio": 1.05,
        "flux_ratio_error": 0.06,
        "predicted_snr": 6.83,
        "snr": 7.34,
        "snr_error": 0.37,
        "etc_ratio": 0.93,
        "etc_ratio_error": 0.05,
        "predicted_significance": 7.8,
        "significance": 8.5,
        "agrees": True,
        "n_found": 2,
        "modelled": made,
    }
    return ImageCheck(**known | changed)


def with_records(result, fidelity, *records, tolerance=None):
    return result.model_copy(
        update={"fidelity": EtcFidelity(fidelity=fidelity, tolerance=tolerance, seed=1, answers=list(records))}
    )


def record(**changed):
    known = {
        "answer": 0,
        "fidelity": "standard",
        "status": "ok",
        "reason": "",
        "message": "",
        "predicted_error": {"planet_flux": 0.002, "snr": 0.05},
        "closed_form_error": None,
        "images": None,
    }
    return AnswerFidelity(**known | changed)


def test_closed_forms_alone_say_nothing(etc_answers):
    assert shown(etc_answers) == ""
    assert shown(with_records(etc_answers, "quick", record(fidelity="quick"))) == ""


@pytest.mark.parametrize("width", [60, 110, 160])
def test_checks_are_one_row_an_answer(etc_answers, width):
    text = shown(with_records(etc_answers, "standard", record(images=images())), width)
    assert max(len(line) for line in text.splitlines()) <= width
    title = "Checked in images (standard: sums of frames)"
    for word in (title, "6.83", "7.34 ± 0.37", "pred/rec", "0.93 ± 0.05", "agrees"):
        assert word in text
    if width == 160:
        for word in ("1.050 ± 0.060", "1.0013", "13", "2 of 13"):
            assert word in text
    assert "differs" in shown(with_records(etc_answers, "standard", record(images=images(agrees=False))), width)


def test_refusals_and_stated_errors_are_in_words(etc_answers):
    refused = record(status="invalid", reason="tolerance_not_met", message="it takes 9999 realisations")
    enough = record(answer=1, fidelity="quick")
    text = " ".join(shown(with_records(etc_answers, "custom", refused, enough, tolerance=0.04)).split())
    for word in (
        "tolerance 0.04",
        "tolerance not met",
        "it takes 9999 realisations.",
        "closed forms are enough",
        "planet flux 0.20 %, SNR 5.0 %",
    ):
        assert word in text
    assert "No answer has frames" in shown(with_records(etc_answers, "standard"))
