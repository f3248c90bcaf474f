from cpic_planner.tradeoff.points import Point as Point
from cpic_planner.tradeoff.run import chosen as chosen, n_rows as n_rows, tradeoff_job as tradeoff_job
from cpic_planner.tradeoff.setup import FixedScene as FixedScene
from cpic_planner.tradeoff.write import FILES as FILES, RESULT as RESULT, read_result as read_result
