"""JSON Schemas of questions and results, made from their models; those of results are shipped beside this file.

``python -m tools.schemas`` rewrites the shipped files; a test keeps them equal to the models.
"""

import pkgutil
from pathlib import Path

from cpic_core import InputError

FOLDER = Path(__file__).resolve().parent
OPENAPI = FOLDER / "openapi.json"
"""The description of the web calculator's addresses, without the version of the package."""
QUESTIONS = {
    command: f"cpic_planner.queries:{model}"
    for command, model in (
        ("etc", "EtcQuestion"),
        ("curve", "CurveQuestion"),
        ("roc", "RocQuestion"),
        ("rank", "RankQuestion"),
        ("visibility", "VisibilityQuestion"),
        ("known", "KnownQuestion"),
        ("plan", "PlanQuestion"),
        ("confirm", "ConfirmQuestion"),
        ("whatif", "WhatIfQuestion"),
        ("tradeoff", "TradeoffQuestion"),
        ("simulate", "SimulateQuestion"),
        ("reduce", "ReduceQuestion"),
    )
}
"""Where the question of each command is."""
RESULTS = {
    name: f"cpic_planner.results:{model}"
    for name, model in (
        ("rank", "RankResult"),
        ("sensitivity", "SensitivityResult"),
        ("explanation", "Explanation"),
        ("comparison", "RankComparison"),
        ("answer_comparison", "AnswerComparison"),
        ("etc", "EtcResult"),
        ("etc_stars", "EtcStarsResult"),
        ("curve", "CurveResult"),
        ("roc", "RocResult"),
        ("plan", "PlanResult"),
        ("confirm", "ConfirmResult"),
        ("star_images", "StarImagesResult"),
        ("run", "RunRecord"),
        ("simulation", "SimulationResult"),
        ("reduction", "ReductionResult"),
        ("check", "CheckResult"),
        ("instrument", "InstrumentResult"),
        ("tradeoff", "TradeoffResult"),
        ("known", "KnownResult"),
        ("visibility", "VisibilityResult"),
        ("whatif", "WhatIfResult"),
        ("visits", "VisitsResult"),
        ("star", "StarResult"),
        ("two_instruments", "TwoInstrumentsResult"),
        ("columns", "ColumnsResult"),
    )
}
"""Where the model of each result is."""


def generated(name: str) -> str:
    """Return the JSON Schema of a result, or of the question of a command, as its model defines it.

    Parameters
    ----------
    name : str
        Name of a result, or a command and ``-question``.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    from cpic_core import dump_json

    models = RESULTS | {f"{command}-question": model for command, model in QUESTIONS.items()}
    if name not in models:
        raise InputError("schema", name, allowed=", ".join(models))
    schema = pkgutil.resolve_name(models[name]).model_json_schema()
    return dump_json({"$schema": "https://json-schema.org/draft/2020-12/schema"} | schema)


def schema_text(name: str) -> str:
    """Return the JSON Schema of a result as shipped, or of a question.

    Parameters
    ----------
    name : str
        Name of a result, or a command and ``-question``.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    path = FOLDER / f"{name}.schema.json"
    return path.read_text(encoding="utf-8") if name in RESULTS and path.exists() else generated(name)


def openapi_text() -> str:
    """Return the OpenAPI document as shipped."""
    return OPENAPI.read_text(encoding="utf-8")
