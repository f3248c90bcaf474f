"""What limits of pointing are refused."""

from cpic_planner.survey.visibility.config import load_visibility

READERS = {"limits": load_visibility}


def test_bad_input_is_refused_in_one_line(refusal):
    refusal.by(READERS)
