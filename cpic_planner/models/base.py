"""What all results and their rows share."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, GetJsonSchemaHandler
from pydantic_core import CoreSchema

from cpic_planner.models.columns import described

StatusText = Literal["ok", "unreachable", "saturated", "outside_field", "invalid"]
VerdictText = Literal["detected", "measured_not_detected", "unreachable"]
DetectionMode = Literal["known_place"]
LimitText = Literal["geometry", "photons", "background", "speckles", "saturation", "none"]


class Result(BaseModel):
    """Base of results: immutable, unknown keys refused, NaN and inf refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Write meaning, label and unit of every field into its JSON Schema; see `cpic_planner.models.columns`."""
        schema = handler(core_schema)
        properties = handler.resolve_ref_schema(schema).get("properties", {})
        for name, part in properties.items():
            look = described(name, cls.model_fields[name])
            said = {"title": look.label, "unit": look.unit, "description": look.meaning}
            part.update({key: value for key, value in said.items() if value})
        return schema


class Row(Result):
    """Base of rows: every field is a column of the tables that show it."""
