"""What commands print and pages say is what was kept; ``python -m tests.golden.transcripts keep NAME`` keeps it anew.

A change of words or numbers is then seen in the difference of a text that people read. Numbers may differ in their last
printed digit, as they do between processors.
"""

import importlib.util
import re
from pathlib import Path

import pytest

HERE = Path(__file__).parent
_SPEC = importlib.util.spec_from_file_location("golden_transcripts", HERE / "transcripts.py")
golden = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(golden)
NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d*)?(?:[eE][-+]?\d{1,3})?(?!\w)")


def unit_in_the_last_place(text):
    """One in the last digit of a number as it is printed."""
    mantissa, _, exponent = text.lower().partition("e")
    return 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))


@pytest.mark.usefixtures("kept_rankings")
@pytest.mark.parametrize("name", golden.kept_names())
def test_the_answer_is_the_one_that_was_kept(name, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("NO_COLOR", "1")
    golden.write(tmp_path, [name])
    answer = golden.transcript(tmp_path / name)
    kept = (HERE / "kept" / f"{name}.txt").read_text(encoding="utf-8")
    assert NUMBER.sub("#", answer).split() == NUMBER.sub("#", kept).split()
    for ours, before in zip(NUMBER.findall(answer), NUMBER.findall(kept), strict=True):
        least = max(map(unit_in_the_last_place, (ours, before)))
        assert abs(float(ours) - float(before)) <= 1.01 * least + 1e-6 * abs(float(before)), (ours, before)


def test_kept_transcripts_are_of_questions():
    assert sorted(path.stem for path in (HERE / "kept").iterdir()) == sorted(golden.kept_names())


def test_a_difference_is_noticed(tmp_path):
    """Of a number, a word, a byte of pixels."""
    for folder, text in (("one", "SNR 5.01 in 3 h"), ("other", "SNR 5.02 in 3 h"), ("third", "S/N 5.01 in 3 h")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "stdout.txt").write_text(text)
    kinds = [
        [kind for kind, _ in golden.differences(tmp_path / "one", tmp_path / other)] for other in ("other", "third")
    ]
    assert kinds == [["number"], ["words"]]
    assert golden.differences(tmp_path / "one", tmp_path / "one") == []
    (tmp_path / "one" / "more.csv").write_text("1")
    assert [kind for kind, _ in golden.differences(tmp_path / "one", tmp_path / "other")] == ["bytes", "number"]
