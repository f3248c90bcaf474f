"""Typed results that leave the program: their JSON is described by the schemas that ``cpic schema`` prints.

`PlanResult` holds what is reproducible (no clock, no path, no host); `RunRecord` holds the story of the run.
"""

from __future__ import annotations

from cpic_planner.models.answers import (
    EtcResult,
    EtcRow,
)
from cpic_planner.models.base import (
    Result,
    StatusText,
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
    BandStanding,
    Explanation,
    PopulationRecord,
    RankedTarget,
    RankResult,
    ReferencePlanetRecord,
    ScoreName,
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
from cpic_planner.models.tradeoff import (
    MachineRecord,
    TradeoffResult,
    TradeoffRow,
    TradeoffScene,
)

__all__ = [
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
    "EffectRecord",
    "EtcFidelity",
    "EtcResult",
    "EtcRow",
    "Explanation",
    "FindingRecord",
    "ImageCheck",
    "MachineRecord",
    "ModellingRecord",
    "PlanResult",
    "PlannedSequenceRow",
    "PopulationRecord",
    "PositionRecord",
    "RankResult",
    "RankedTarget",
    "ReferencePlanetRecord",
    "Result",
    "RunRecord",
    "ScoreName",
    "SearchRecord",
    "SensitivityResult",
    "SensitivityRow",
    "SimulatedSequence",
    "SimulationEstimate",
    "SimulationResult",
    "StatusText",
    "TradeoffResult",
    "TradeoffRow",
    "TradeoffScene",
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
}
