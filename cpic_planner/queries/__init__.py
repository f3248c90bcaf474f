"""Questions that can be asked: one frozen model for each command.

A field of a question is declared once (`cpic_planner.queries.fields.asked`). The options of the command, the keywords
of the Python function, the JSON Schema, the YAML file and the hash of a run all derive from it.
"""

from __future__ import annotations

import pkgutil

from catalogs.errors import InputError

QUESTIONS = {
    name: f"cpic_planner.queries.{name}:{model}Question"
    for name, model in (
        ("etc", "Etc"),
        ("rank", "Rank"),
        ("plan", "Plan"),
        ("confirm", "Confirm"),
        ("simulate", "Simulate"),
        ("visibility", "Visibility"),
        ("known", "Known"),
        ("whatif", "WhatIf"),
        ("tradeoff", "Tradeoff"),
    )
}
"""Where the question of each command is."""


def question_schema(name: str) -> str:
    """Return the JSON Schema of a question, as text.

    Parameters
    ----------
    name : str
        Command and ``-question``.

    Raises
    ------
    InputError
        If there is no such question.
    """
    from simulator.files import dump_json

    command = name.removesuffix("-question")
    if command not in QUESTIONS:
        raise InputError("schema", name, allowed=", ".join(f"{known}-question" for known in QUESTIONS))
    schema = pkgutil.resolve_name(QUESTIONS[command]).model_json_schema()
    return dump_json({"$schema": "https://json-schema.org/draft/2020-12/schema"} | schema)
