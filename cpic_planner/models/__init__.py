"""Typed results that leave the program: their JSON is described by the schemas that ``cpic schema`` prints.

`PlanResult` holds what is reproducible (no clock, no path, no host); `RunRecord` holds the story of the run.
"""

from __future__ import annotations

from cpic_planner.models.answers import (
    EtcAnswer,
    EtcResult,
)
from cpic_planner.models.base import (
    LimitText,
    Result,
    StatusText,
    VerdictText,
)
from cpic_planner.models.checked import (
    AnswerFidelity,
    EtcFidelity,
    ImageCheck,
)
from cpic_planner.models.confirmed_scene import (
    AlbedoRecord,
    CandidateRecord,
    ConfirmResult,
    PositionRecord,
    SearchRecord,
)
from cpic_planner.models.known import (
    KnownBand,
    KnownHole,
    KnownPlanetRow,
    KnownResult,
    KnownTrack,
    KnownWindow,
    Quantiles,
)
from cpic_planner.models.modelled import (
    EffectRecord,
    ModellingRecord,
)
from cpic_planner.models.planned import (
    AuditRecord,
    BandConfirmation,
    ConfirmedTarget,
    PlanResult,
    RunRecord,
)
from cpic_planner.models.ranked import (
    KNOWN_PLANETS,
    BandStanding,
    Explanation,
    PopulationRecord,
    RankedTarget,
    RankResult,
    ReferencePlanetRecord,
    SensitivityResult,
    SensitivityRow,
)
from cpic_planner.models.simulated import (
    CheckResult,
    FindingRecord,
    PlannedSequenceRow,
    SimulatedSequence,
    SimulationEstimate,
    SimulationResult,
)
from cpic_planner.models.surveyed import (
    CurvePoint,
    DifferenceRecord,
    EstimateRecord,
    ImageSample,
    RankChange,
    ScheduleRecord,
    StrategyOutcome,
    SurveyTarget,
    TimeUse,
    WhatIfResult,
)
from cpic_planner.models.tradeoff import (
    MachineRecord,
    TradeoffResult,
    TradeoffRow,
    TradeoffScene,
)
from cpic_planner.models.visible import (
    PointingRecord,
    SeasonRecord,
    VisibilityResult,
    VisibleDays,
    VisibleTarget,
)
from cpic_planner.registry.scores import ScoreName

__all__ = [
    "KNOWN_PLANETS",
    "SCHEMAS",
    "AlbedoRecord",
    "AnswerFidelity",
    "AuditRecord",
    "BandConfirmation",
    "BandStanding",
    "CandidateRecord",
    "CheckResult",
    "ConfirmResult",
    "ConfirmedTarget",
    "CurvePoint",
    "DifferenceRecord",
    "EffectRecord",
    "EstimateRecord",
    "EtcAnswer",
    "EtcFidelity",
    "EtcResult",
    "Explanation",
    "FindingRecord",
    "ImageCheck",
    "ImageSample",
    "KnownBand",
    "KnownHole",
    "KnownPlanetRow",
    "KnownResult",
    "KnownTrack",
    "KnownWindow",
    "LimitText",
    "MachineRecord",
    "ModellingRecord",
    "PlanResult",
    "PlannedSequenceRow",
    "PointingRecord",
    "PopulationRecord",
    "PositionRecord",
    "Quantiles",
    "RankChange",
    "RankResult",
    "RankedTarget",
    "ReferencePlanetRecord",
    "Result",
    "RunRecord",
    "ScheduleRecord",
    "ScoreName",
    "SearchRecord",
    "SeasonRecord",
    "SensitivityResult",
    "SensitivityRow",
    "SimulatedSequence",
    "SimulationEstimate",
    "SimulationResult",
    "StatusText",
    "StrategyOutcome",
    "SurveyTarget",
    "TimeUse",
    "TradeoffResult",
    "TradeoffRow",
    "TradeoffScene",
    "VerdictText",
    "VisibilityResult",
    "VisibleDays",
    "VisibleTarget",
    "WhatIfResult",
]

SCHEMAS: dict[str, type[Result]] = {
    "rank": RankResult,
    "sensitivity": SensitivityResult,
    "explanation": Explanation,
    "etc": EtcResult,
    "plan": PlanResult,
    "confirm": ConfirmResult,
    "run": RunRecord,
    "simulation": SimulationResult,
    "check": CheckResult,
    "tradeoff": TradeoffResult,
    "known": KnownResult,
    "visibility": VisibilityResult,
    "whatif": WhatIfResult,
}
