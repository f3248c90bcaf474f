import io

import pytest
from rich.console import Console

from cpic_planner.report import print_confirm
from cpic_planner.report.confirm import albedo_text


def shown(function, *arguments, width=100):
    stream = io.StringIO()
    function(*arguments, Console(file=stream, width=width, highlight=False))
    return stream.getvalue()


@pytest.mark.parametrize("width", [40, 60, 110, 200])
def test_it_fits_any_width(confirmation, width):
    assert max(len(line) for line in shown(print_confirm, confirmation, width=width).splitlines()) <= width


def test_bands_candidates_positions_albedos_and_the_etc(confirmation):
    text = " ".join(shown(print_confirm, confirmation, width=200).split())
    for words in (
        "24.0 26.0 ± 1.0 0.92 ± 0.06 8/8",
        "□ inside inner edge",
        "F520 – 118 × 42.5 36.2 0.451 315.2 20.1 6.10 <script>",
        "6.30 6.10 no planet of the scene",
        "F662 – 118 × 42.5 36.2 – – – – nothing",
        "1 detection that is no planet of the scene, in 16 searches.",
        "0.4512 ± 0.0011 0.4500 314.70 ± 0.22 315.00 F520, F662",
        "F662, with every effect (48 of 236 frames one by one): SNR 31.3 (30.7 predicted), "
        "contrast off by 1.3 of its errors, found",
        "Images altered: throughput ×0.7, companions on. Predictions are nominal.",
        "Predicted over recovered SNR 1.43 ± 0.06",
    ):
        assert words in text, words


def test_one_planet_needs_no_column_of_names(confirmation):
    one = confirmation.model_copy(update={"bands": confirmation.bands[-1:]})
    assert shown(print_confirm, confirmation).splitlines()[1].split()[:2] == ["planet", "band"]
    assert shown(print_confirm, one).splitlines()[1].split()[0] == "band"


def test_no_planet_is_said_and_nothing_is_compared(confirmation):
    text = shown(print_confirm, confirmation.model_copy(update={"bands": [], "positions": [], "albedos": []}))
    assert text.startswith("a scene: no planet, searched blind")
    assert "optimistic" not in text


def test_albedo_in_words(confirmation):
    text = albedo_text(confirmation.albedos[0])
    assert "log10 f_sed −1.20 to 0.77 (68 %), correlation −0.31, from F520, F662: not constrained" in text
