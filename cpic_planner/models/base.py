"""What all results share."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict

__all__ = ["Result", "StatusText"]


StatusText = Literal["ok", "unreachable", "saturated", "outside_field", "invalid"]


class Result(BaseModel):
    """Base of results: immutable, unknown keys refused, NaN and inf refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
