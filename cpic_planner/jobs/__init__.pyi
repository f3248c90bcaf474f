from cpic_planner.jobs.chain import check_tree as check_tree
from cpic_planner.jobs.folder import (
    LIST_NAME as LIST_NAME,
    DamagedPartError as DamagedPartError,
    RunFolder as RunFolder,
    contents_of as contents_of,
)
from cpic_planner.jobs.job import (
    Cost as Cost,
    Job as Job,
    Runner as Runner,
    RunSettings as RunSettings,
    Task as Task,
    estimate as estimate,
    in_this_process as in_this_process,
    pace as pace,
    run as run,
)
