from cpic_planner.survey.visibility.calendar import (
    BLOCKS as BLOCKS,
    Visibility as Visibility,
    seasons_of as seasons_of,
    slew_s as slew_s,
    utc_of as utc_of,
    visibility as visibility,
    visibility_result as visibility_result,
)
from cpic_planner.survey.visibility.config import (
    VisibilityConfig as VisibilityConfig,
    VisibilitySource as VisibilitySource,
    load_visibility as load_visibility,
)
