from cpic_planner.survey.calendar import Sight as Sight
from cpic_planner.survey.observed import ScheduledVisit as ScheduledVisit, read_schedule as read_schedule
from cpic_planner.survey.prepare import known_table as known_table
from cpic_planner.survey.strategy import (
    StrategiesConfig as StrategiesConfig,
    VisitRule as VisitRule,
    load_strategies as load_strategies,
    variation_lines as variation_lines,
    varied as varied,
    with_doubt as with_doubt,
    with_exact_calendars as with_exact_calendars,
    with_universe as with_universe,
)
from cpic_planner.survey.whatif import run_whatif as run_whatif, whatif_job as whatif_job
