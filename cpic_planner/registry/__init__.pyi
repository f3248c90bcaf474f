from cpic_planner.registry.libraries import (
    DEFAULT_LIBRARY as DEFAULT_LIBRARY,
    LIBRARIES as LIBRARIES,
    Library as Library,
    LibraryName as LibraryName,
    LibraryNoise as LibraryNoise,
    StarSettings as StarSettings,
)
from cpic_planner.registry.reductions import (
    DEFAULT_REDUCTION as DEFAULT_REDUCTION,
    REDUCTIONS as REDUCTIONS,
    Reduction as Reduction,
    ReductionName as ReductionName,
)
from cpic_planner.registry.scores import (
    DEFAULT_SCORE as DEFAULT_SCORE,
    SCORES as SCORES,
    Score as Score,
    ScoreName as ScoreName,
    StarNumbers as StarNumbers,
)
