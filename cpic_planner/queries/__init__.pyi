from cpic_planner.queries.base import (
    Question as Question,
    by_depth as by_depth,
    called as called,
    called_as as called_as,
    check_visits as check_visits,
    get as get,
    keys_of as keys_of,
    option_names as option_names,
    put as put,
    scaled as scaled,
    tree_of as tree_of,
)
from cpic_planner.queries.changes import (
    SHORT_KEYS as SHORT_KEYS,
    Change as Change,
    changed as changed,
    changed_instrument as changed_instrument,
    instrument_rows as instrument_rows,
    instrument_title as instrument_title,
    is_optical as is_optical,
    long_key as long_key,
    read_instrument as read_instrument,
)
from cpic_planner.queries.ensemble import (
    CONTRAST as CONTRAST,
    OCCURRENCE as OCCURRENCE,
    Ensemble as Ensemble,
    EnsembleChoice as EnsembleChoice,
    load_ensemble as load_ensemble,
)
from cpic_planner.queries.etc import EtcQuestion as EtcQuestion, OptimiseQuestion as OptimiseQuestion
from cpic_planner.queries.fields import (
    Option as Option,
    asked as asked,
    asked_of as asked_of,
    kind_of as kind_of,
    options_of as options_of,
    spelled as spelled,
)
from cpic_planner.queries.images import (
    MAX_FRAMES as MAX_FRAMES,
    ConfirmQuestion as ConfirmQuestion,
    ImageQuestion as ImageQuestion,
    SimulatorOverrides as SimulatorOverrides,
    StarImagesQuestion as StarImagesQuestion,
    audited as audited,
    refuse_counting as refuse_counting,
)
from cpic_planner.queries.rank import (
    DEFAULT_YEARS as DEFAULT_YEARS,
    FILTERS as FILTERS,
    FilteredQuestion as FilteredQuestion,
    KnownQuestion as KnownQuestion,
    RankedQuestion as RankedQuestion,
    RankQuestion as RankQuestion,
    VisibilityQuestion as VisibilityQuestion,
    asked_exclusions as asked_exclusions,
    read_exclusions as read_exclusions,
    read_spectral_types as read_spectral_types,
    read_star_names as read_star_names,
)
from cpic_planner.queries.runs import (
    PlanQuestion as PlanQuestion,
    TradeoffQuestion as TradeoffQuestion,
    WhatIfQuestion as WhatIfQuestion,
)
from cpic_planner.queries.searched import (
    CurveQuestion as CurveQuestion,
    RocQuestion as RocQuestion,
    SearchedQuestion as SearchedQuestion,
)
from cpic_planner.queries.shared import (
    DEFAULT_TIME_S as DEFAULT_TIME_S,
    EXCLUSIONS as EXCLUSIONS,
    MAX_VISITS as MAX_VISITS,
    FluxFilter as FluxFilter,
    ReferencePlanet as ReferencePlanet,
    Strategy as Strategy,
    observed_utc as observed_utc,
)
from cpic_planner.queries.simulate import SimulateQuestion as SimulateQuestion
from cpic_planner.queries.written_values import (
    Written as Written,
    read_value as read_value,
    seconds_text as seconds_text,
    two_spellings as two_spellings,
    with_unit as with_unit,
)
