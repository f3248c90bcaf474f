import io
import re

import pytest
from rich.console import Console

from cpic_planner.report import print_whatif
from cpic_planner.results import ImageSample


def shown(function, *arguments, width=120, **options):
    stream = io.StringIO()
    function(arguments[0], Console(file=stream, width=width, highlight=False), *arguments[1:], **options)
    return stream.getvalue()


@pytest.mark.parametrize("width", [40, 60, 110, 200])
def test_it_fits_any_width(compared, width):
    names = ["single_visit contrast=1e-8", "a", "b"]
    assert max(len(line) for line in shown(print_whatif, compared(names), width=width).splitlines()) <= width


def test_summary_strategies_differences_and_report(compared):
    text = " ".join(shown(print_whatif, compared(["one", "two"]), width=200).split())
    for words in (
        "two finds most planets New planets of two: 0.24; in the same visits 0.49 with",
        "In the same universes two finds 0.30 planets more than one",
        "a survey: mean of 200 universes and its 90 % interval",
        "0.51 0.46 to 0.57 0 to 1.02 0.15 40.0 100 8.1 10.0 0.004 one",
        "Difference with one in the same universes",
        "+0.30 0.19 to 0.42 +0.09 +50 more two",
        "Seed 1, configuration 0123456789abcdef.",
    ):
        assert words in text, words


def test_one_strategy_is_compared_with_none(compared):
    text = shown(print_whatif, compared(["one"]))
    assert "Difference" not in text


def test_chance_and_fewer_are_told_apart(compared):
    result = compared(["one", "two", "three"], empty=True)
    worse = [
        item.model_copy(update={"mean": -0.4, "low": -0.5, "high": -0.3}) if item.first == "three" else item
        for item in result.differences
    ]
    lines = shown(print_whatif, result.model_copy(update={"differences": worse})).splitlines()
    assert any("may be chance" in line and line.endswith("two") for line in map(str.rstrip, lines))
    assert any("fewer" in line and "−0.40" in line and line.rstrip().endswith("three") for line in lines)


def test_many_strategies_are_cut(compared):
    text = shown(print_whatif, compared([f"s{i}" for i in range(30)]))
    assert "The first and the 19 of 30 that find most." in text
    assert " s10\n" not in text.replace(" \n", "\n")


def test_images_tell_their_correction(compared):
    result = compared(["one"])
    sample = ImageSample(detections=40, images=120, expected=31.5, found=28, correction=0.889, low=0.75, high=1.02)
    item = result.strategies[0].model_copy(update={"images": sample})
    text = shown(print_whatif, result.model_copy(update={"strategies": [item]}), width=200)
    counts = "28 of 120 simulated image sequences (of 40 detections) show the planet"
    assert f"{counts}, 31.5 expected; correction 0.89 (0.75 to 1.02)" in text
    none = sample.model_copy(
        update={
            "detections": 0,
            "images": 0,
            "expected": 0.0,
            "found": 0,
            "correction": None,
            "low": None,
            "high": None,
            "note": "no detections",
        }
    )
    item = result.strategies[0].model_copy(update={"images": none})
    text = shown(print_whatif, result.model_copy(update={"strategies": [item]}), width=200)
    assert "one: no detection was simulated as images: no detections" in text


def test_in_short_a_legend_and_two_sentences_stand_under_the_strategies(compared):
    result = compared(["a", "b"])
    text = shown(print_whatif, result, width=110, full=False)
    below = " ".join(text[text.index("interval: of the mean") :].split())
    assert "bound %: optimality gap: planets lost relative to the best possible calendar, at most" in below
    told = below[below.index("Difference with") :]
    assert len(re.findall(r"[a-z)]\.(?:\s|$)", told)) <= 2
    assert "configuration" not in told
    assert "configuration" in shown(print_whatif, result, width=110)
