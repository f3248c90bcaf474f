"""What the terminal says of answers that are, and that are not, a detection."""

import io
import re
from shlex import split

import pytest
from rich.console import Console

from cpic_planner.cli.main import main
from cpic_planner.report import etc_blocks, print_blocks
from cpic_planner.results import AnswerFidelity, EtcFidelity, ImageCheck, ModellingRecord
from simulator.knobs import FIDELITIES


def told(capsys, *arguments):
    status = main([*arguments])
    captured = capsys.readouterr()
    assert status == 0, captured.err
    return " ".join(captured.out.split())


@pytest.mark.parametrize("star", ["omi2 Eri", "bar"])
def test_an_snr_below_the_threshold_is_not_a_detection(capsys, tmp_path, star):
    """SNR 5 is reached at the inner edge of the hole, where the threshold is highest: also for a star of one's own."""
    table = tmp_path / "mine.csv"
    table.write_text("name,distance_pc,v_mag,sp_type\nbar,5.0,4.4,K0V\n", encoding="utf-8")
    own = ["--catalog", str(table)] if star == "bar" else []
    text = told(capsys, "etc", star, "--snr", "5", "--band", "F520", *own)
    assert "✓" not in text
    assert "· measured, not detected" in text
    shown = float(re.search(r"in F520 is not a detection: ([\d.]+) % of such programmes show", text)[1])
    # The programme reaches 6.9 times the noise of the filtered image; 5 sigma in the tails of errors of two visits ask
    # for about 8, and the planet's own light scatters that by 1.4: Phi(-0.8).
    assert 10.0 < shown < 30.0
    assert "where the threshold is highest (a question for a detection takes that into account)" in text
    placed = told(capsys, "etc", star, "--snr", "5", "--band", "F520", "--separation-arcsec", "0.34", *own)
    assert "is not a detection" in placed
    assert "it was put" not in placed


def test_an_snr_of_a_tenth_has_no_mark_and_no_law(capsys):
    """A faint planet; a near-infrared band would have to measure its optics first."""
    text = told(capsys, *split("etc 'tau Cet' --band F850 --time-s 36000 --contrast 1e-10 --separation-arcsec 0.65"))
    assert "✓" not in text
    assert "· measured, not detected" in text
    assert "Limited by photons (too faint even if the wavefront did not drift" in text


def shown(result, width=110):
    stream = io.StringIO()
    print_blocks(etc_blocks(result), Console(file=stream, width=width, highlight=False))
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
    quick = shown(with_records(etc_answers, "quick", record(fidelity="quick")))
    assert not {"Checked in images", "closed forms are enough"} & {shown(etc_answers), quick}


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
