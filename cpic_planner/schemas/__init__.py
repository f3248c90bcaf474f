"""JSON Schemas of the results, generated from the models and shipped beside this file.

``python -m cpic_planner.schemas`` rewrites them; a test keeps them equal to the models.
"""

from __future__ import annotations

from pathlib import Path

from catalogs.errors import InputError

__all__ = ["generated", "schema_text", "write_all"]

FOLDER = Path(__file__).resolve().parent


def generated(name: str) -> str:
    """Schema of one result as its model defines it."""
    from cpic_planner.models import SCHEMAS
    from simulator.files import dump_json

    if name not in SCHEMAS:
        raise InputError("schema", name, allowed=", ".join(SCHEMAS))
    schema = SCHEMAS[name].model_json_schema()
    return dump_json({"$schema": "https://json-schema.org/draft/2020-12/schema"} | schema)


def schema_text(name: str) -> str:
    """Shipped schema of one result.

    Raises
    ------
    InputError
        If there is no result of that name.
    """
    path = FOLDER / f"{name}.schema.json"
    if not name.isalpha() or not path.exists():
        raise InputError("schema", name, allowed=", ".join(sorted(p.name.split(".")[0] for p in FOLDER.glob("*.json"))))
    return path.read_text(encoding="utf-8")


def write_all() -> list[Path]:
    """Rewrite every shipped schema."""
    from cpic_planner.models import SCHEMAS
    from simulator.files import write_text

    return [write_text(FOLDER / f"{name}.schema.json", generated(name)) for name in SCHEMAS]
