import pytest

from cpic_core import InputError
from cpic_planner.web.answers import rank_pairs
from cpic_planner.web.pages import tag_of


def test_rows_that_are_shown():
    assert rank_pairs([("limit", "")]) == ()
    assert rank_pairs([("limit", "7")]) == (("limit", "7"),)
    for text in ("0", "-1", "1e3", "1501", "٣", "9" * 40):
        with pytest.raises(InputError, match="1 to 1500"):
            rank_pairs([("limit", text)])


def test_a_tag_follows_question_kind_and_version(monkeypatch):
    from cpic_planner.web import pages

    asked = (("target", "tau Cet"),)
    mine = tag_of("svg", asked)
    assert mine == tag_of("svg", asked)
    assert mine not in (tag_of("png", asked), tag_of("svg", (("target", "eps Eri"),)))
    monkeypatch.setattr(pages, "__version__", "9.9.9")
    assert tag_of("svg", asked) != mine
