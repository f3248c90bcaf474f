"""What all results and their rows share."""

from __future__ import annotations

import math
from typing import Any, Literal, Self, get_args

from pydantic import BaseModel, ConfigDict, GetJsonSchemaHandler
from pydantic_core import CoreSchema

from cpic_planner.models.columns import described

StatusText = Literal["ok", "unreachable", "saturated", "outside_field", "invalid"]
VerdictText = Literal["detected", "measured_not_detected", "unreachable"]
DetectionMode = Literal["known_place"]
LimitText = Literal["geometry", "photons", "background", "speckles", "saturation", "none"]


_ABSENT = object()


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

    @classmethod
    def of(cls, *sources: Any, at: int | None = None, **given: Any) -> Self:
        """Return a result made of the attributes of other objects that bear the names of its fields.

        Parameters
        ----------
        *sources
            Objects; the first one that has an attribute counts. Arrays become lists.
        at : int, optional
            Place in their arrays, along the first axis: for one star of columns of many.
        **given
            Values of fields that no source has, or has otherwise.

        Returns
        -------
        Result
            Numbers that are not finite are null where the field may be.
        """
        found = dict(given)
        for name, field in cls.model_fields.items():
            for source in () if name in given else sources:
                value = getattr(source, name, _ABSENT)
                if value is not _ABSENT:
                    found[name] = _plain(value, at, field.annotation)
                    break
        return cls(**found)


def _plain(value: Any, at: int | None, annotation: Any) -> Any:
    if hasattr(value, "tolist"):
        value = (value if at is None else value[at]).tolist()
    if isinstance(value, float) and not math.isfinite(value) and type(None) in get_args(annotation):
        return None
    return value


class Row(Result):
    """Base of rows: every field is a column of the tables that show it."""
