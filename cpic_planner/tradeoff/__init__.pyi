from cpic_planner.tradeoff.run import (
    FILES as FILES,
    RESULT as RESULT,
    chosen as chosen,
    n_rows as n_rows,
    read_result as read_result,
    tradeoff_job as tradeoff_job,
)
from cpic_planner.tradeoff.scenes import FixedScene as FixedScene, Point as Point
