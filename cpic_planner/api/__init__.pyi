from cpic_planner.api.comparison import compare_answers as compare_answers
from cpic_planner.api.functions import model_of as model_of
from cpic_planner.api.one_star import (
    Answered as Answered,
    answered as answered,
    answered_stars as answered_stars,
    closed_forms as closed_forms,
)
from cpic_planner.api.runs import (
    compared as compared,
    curve_job_of as curve_job_of,
    prepared as prepared,
    roc_job_of as roc_job_of,
    strategies_of as strategies_of,
    visibility_of as visibility_of,
)
