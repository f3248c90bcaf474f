"""What strategies, sweeps, estimates and limits of pointing refuse, each in one line."""

from cpic_planner.survey import load_strategies, varied
from cpic_planner.survey.outcome import mean_interval
from cpic_planner.survey.strategy import SurveyStrategy
from cpic_planner.survey.visibility import load_visibility
from simulator.config import validate

ONE = {"strategies": [{"name": "one", "revisits": {"max_visits": 4}}]}

READERS = {
    "strategy": lambda tree: validate(SurveyStrategy, {"name": "x"} | tree, where="strategy"),
    "strategies": lambda tree: load_strategies(ONE | tree),
    "strategies_file": load_strategies,
    "vary": lambda sweep: varied(load_strategies(ONE), [sweep]),
    "mean_interval": mean_interval,
    "limits": load_visibility,
}


def test_bad_input_is_refused_in_one_line(refusal):
    refusal.by(READERS)
