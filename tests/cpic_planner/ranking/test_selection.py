"""Some stars of a kept ranking are what the ranking of these stars would have said, to the last byte."""

import pytest

from cpic_planner import rank_targets
from cpic_planner.api import prepared
from cpic_planner.queries import RankQuestion

ASKED = {"bands": ["F520"], "n_planets": 50}
FILTERS = [
    pytest.param({"sp_type": ["K"]}, marks=pytest.mark.long),
    {"dec_min_deg": -20.0, "dec_max_deg": 40.0},
    {"known_hosts": True, "sp_type": ["G"]},
    pytest.param({"dec_min_deg": -90.0}, marks=pytest.mark.long),  # leaves all
]


@pytest.fixture(scope="module")
def whole():
    return rank_targets(**ASKED)


@pytest.mark.parametrize("filters", FILTERS)
def test_a_filter_selects_what_the_ranking_under_it_says(whole, filters):
    before = whole.model_dump_json()
    question = RankQuestion.of({**ASKED, **filters})
    chosen = prepared(question).of_all(whole)
    alone = rank_targets(**ASKED, **filters)
    assert chosen.model_dump_json() == alone.model_dump_json()
    if "dec_min_deg" not in filters or len(filters) > 1:
        assert 0 < len(chosen.targets) < len(whole.targets)
        assert chosen.config_hash != whole.config_hash
    assert whole.model_dump_json() == before
