import pytest

from cpic_core import InputError
from cpic_planner.web.answers import DEFAULT_ROWS, rows_of, tag_of


def test_rows_that_are_shown():
    assert rows_of("") == DEFAULT_ROWS
    assert rows_of("7") == 7
    for text in ("0", "-1", "1e3", "1501", "٣", "9" * 40):
        with pytest.raises(InputError, match="1 to 1500"):
            rows_of(text)


def test_a_tag_follows_question_kind_and_version(monkeypatch):
    from cpic_planner.web import answers

    asked = (("target", "tau Cet"),)
    mine = tag_of("svg", asked)
    assert mine == tag_of("svg", asked)
    assert mine not in (tag_of("png", asked), tag_of("svg", (("target", "eps Eri"),)))
    monkeypatch.setattr(answers, "__version__", "9.9.9")
    assert tag_of("svg", asked) != mine
