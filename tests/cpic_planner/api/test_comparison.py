"""Two answers compared: what differs, in what order, and what explains it; against what was changed by hand."""

import json

import pytest

from cpic_planner import compare_answers
from cpic_planner.api import answered
from cpic_planner.cli.main import main
from cpic_planner.queries import EtcQuestion


def answer(**changed):
    return answered(EtcQuestion.of({"target": "tau Cet", "snr": 8, "bands": ["F520", "F662"]} | changed)).result


@pytest.fixture(scope="module")
def eight():
    return answer()


def test_the_same_answer_has_no_difference(eight):
    found = compare_answers(eight, eight)
    assert (found.statement, found.explained_by, found.changes, found.settings) == ("No difference.", "nothing", [], [])


def test_numbers_and_verdicts_are_those_that_differ_and_the_question_explains_them(eight):
    ten = answer(snr=10)
    found = compare_answers(eight, ten)
    assert [(one.key, one.before, one.after) for one in found.settings] == [("snr", "8", "10")]
    assert found.explained_by == "question"
    assert "snr alone (8 to 10)" in found.statement
    times = {one.row: one for one in found.changes if one.quantity == "value"}
    for old, new in zip(eight.answers, ten.answers, strict=True):
        one = times[old.band]
        assert one.relative == pytest.approx(new.value / old.value - 1.0, rel=1e-12)
        assert (old.verdict != new.verdict) == any(
            change.quantity == "verdict" and change.row == one.row for change in found.changes
        )
    assert found.to_pandas().columns.tolist()[:2] == ["row", "quantity"]


def test_rows_of_one_side_are_named(eight):
    found = compare_answers(eight, answer(bands=["F662", "F720"]))
    assert (found.only_before, found.only_after) == (["F520"], ["F720"])


def test_what_nothing_explains_is_said_and_so_is_other_software(eight):
    first, *rest = eight.answers
    changed = eight.model_copy(update={"answers": [first.model_copy(update={"snr": 2 * first.snr}), *rest]})
    found = compare_answers(eight, changed)
    assert found.explained_by == "unknown"
    assert "not explained" in found.statement
    (change,) = found.changes
    assert (change.row, change.quantity, change.relative) == ("F520", "snr", 1.0)
    other = changed.model_copy(update={"config_hash": "0123456789abcdef"})
    assert "in something that the answers do not state" in compare_answers(eight, other).statement


def test_files_folders_and_refusals(eight, tmp_path, capsys, refused):
    one, other, page = tmp_path / "a.json", tmp_path / "b.json", tmp_path / "page.html"
    one.write_text(eight.model_dump_json())
    other.write_text(answer(snr=9).model_dump_json())
    assert main(["compare", str(one), str(other), "--json", "--out", str(page)]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["changes"]
    assert (printed["before"]["name"], printed["kind"]) == ("a.json", "answer_comparison")
    assert "<table" in page.read_text()
    other.write_text('{"kind": "rank"')
    refused("b.json: not accepted", compare_answers, one, other)
    refused("holds no finished run", compare_answers, one, tmp_path)
    kinds = json.loads(one.read_text()) | {"kind": "visits"}
    other.write_text(json.dumps(kinds))
    assert main(["compare", str(one), str(other)]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize(
    ("more", "key", "texts"),
    [
        ({"time_s": 18000.0}, "time_s", ("by default", "18000")),
        ({"strategy": {"visits": 3}}, "strategy.visits", ("by default", "3")),
        ({"planet": {"radius_rjup": 0.5}}, "planet.radius_rjup", ("by default", "0.5")),
        (
            {"instrument": {"detector": {"read_noise_e": 160}}},
            "instrument.detector.read_noise_e",
            ("by default", "160 e-"),
        ),
    ],
)
def test_answers_state_what_was_asked_so_that_every_difference_is_named(more, key, texts):
    asked = {"target": "tau Cet", "bands": "F520"}
    found = compare_answers(*(answered(EtcQuestion.of(asked | own)).result for own in ({}, more)))
    settings = {row.key: (row.before, row.after) for row in found.settings}
    assert settings[key] == texts
    assert list(settings) == [key]
    assert found.explained_by == "question"


def test_two_stars_are_compared_band_by_band():
    asked = {"snr": 5, "bands": "F520"}
    one, two = (answered(EtcQuestion.of(asked | {"target": name})).result for name in ("tau Cet", "eps Ind"))
    found = compare_answers(one, two)
    assert [(row.key, row.before, row.after) for row in found.settings] == [("target", "tau Cet", "eps Ind")]
    assert not found.only_before
    (value,) = (row for row in found.changes if row.quantity == "value")
    assert value.relative == pytest.approx(two.answers[0].value / one.answers[0].value - 1.0)


@pytest.mark.parametrize("given", [None, 5, [], b"x"])
def test_what_is_no_answer_is_refused_in_one_line(eight, given, refused):
    refused("after = .*an answer as --json prints it", compare_answers, eight, given)
