import pytest

from cpic_planner.report.confirm_sections import ConfirmReport, confirm_document
from cpic_planner.report.drawing import Picture
from cpic_planner.report.image_figures import snr_figure
from cpic_planner.report.write import page_html

HOSTILE = "<script>alert('x')</script>"


@pytest.fixture(scope="module")
def page(confirmation):
    picture = Picture("data:image/png;base64,", "alt", "caption.")
    figures = {"calibration": snr_figure(confirmation), f"Clouds of {HOSTILE}": picture}
    return page_html(confirm_document(ConfirmReport(confirmation, figures, {"F520": picture})))


def test_nothing_is_loaded_from_outside_and_names_are_text(page, reader, words):
    reader.check_alone()
    assert HOSTILE not in page
    assert HOSTILE in words


def test_anchors_and_captions(reader):
    reader.check_anchors()


def test_page_one_names_what_is_altered_and_how_the_etc_stands(words):
    altered = "Images altered: throughput ×0.7, companions on. Predictions are nominal."
    sentence = "The ETC is optimistic by 1.43 ± 0.06 (predicted / recovered SNR) over 4 measurements."
    assert words.index(altered) < words.index("2 planets in F520, F662") < words.index(sentence)
    assert words.index(sentence) < words.index("Planets <script>")
    assert "c is found in F520 (8 of 8)." in words


def test_search_positions_and_albedos(words):
    for text in (
        "F520 118 × 42.5 36.2 395 1 of 8 0.451 315.2 20.1 6.10 ✓ detected",
        "0.451 315.2 6.30 6.10 ✓ detected –",
        "F662 118 × 42.5 36.2 215 0 of 8 nothing is named",
        "F520, F662 0.4512 ± 0.0011 0.4500 314.70 ± 0.22 315.00",
        "0.97; 0.06 to 0.97 −0.40; −1.20 to 0.77 −0.31 0.40 (0) not constrained",
        "cosmic rays: switched off",
        "□ outside field",
        "1 mode subtracted",
    ):
        assert text in words, text


def test_a_scene_without_planets_has_its_search_alone(confirmation, read):
    update = {"bands": [], "positions": [], "albedos": [], "calibration": {"ratio": None, "error": None, "n_bands": 0}}
    text = " ".join(
        " ".join(
            read(page_html(confirm_document(ConfirmReport(confirmation.model_copy(update=update), {}, {})))).text
        ).split()
    )
    assert "0 planets in F520, F662" in text
    assert "nothing to compare with a prediction" in text
    assert "No band was measured, so" not in text
    assert "Positions" not in text


def test_rolls_are_not_searched(confirmation, read):
    rolled = confirmation.model_copy(update={"searches": [], "reference_library": "roll"})
    text = " ".join(" ".join(read(page_html(confirm_document(ConfirmReport(rolled, {}, {})))).text).split())
    assert "Two rolls show every planet twice" in text
    assert "searched blind and measured" not in text
    assert "the star subtracted, measured at the known place" in text
    assert "a realisation is a detection if the planet is significant at its known place" in text
