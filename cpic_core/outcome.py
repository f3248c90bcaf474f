"""Typed answers: a value, or the named reason why there is none."""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Generic, TypeVar

T = TypeVar("T")
U = TypeVar("U")


class Status(StrEnum):
    """What kind of answer this is."""

    OK = "ok"
    UNREACHABLE = "unreachable"
    SATURATED = "saturated"
    OUTSIDE_FIELD = "outside_field"
    INVALID = "invalid"


class Reason(StrEnum):
    """Why an answer is not ``ok`` (empty when it is)."""

    NONE = ""
    SPECKLE_FLOOR = "speckle_floor"
    COMMON_SPECKLE_FLOOR = "common_speckle_floor"
    PLANET_MOVES = "planet_moves"
    INSUFFICIENT_TIME = "insufficient_time"
    PIXEL_FULL_WELL = "pixel_full_well"
    REGISTER_FULL_WELL = "register_full_well"
    ADC_RANGE = "adc_range"
    INSIDE_INNER_EDGE = "inside_inner_edge"
    OUTSIDE_OUTER_EDGE = "outside_outer_edge"
    TOO_FEW_ELEMENTS = "too_few_resolution_elements"
    NO_TIME = "time_below_overheads"
    TOO_MANY_FRAMES = "too_many_frames"
    NOT_ADDITIVE = "not_additive"
    NO_LIGHT = "no_planet_light"
    SMALL_ROLL = "roll_too_small"
    TOO_BRIGHT_TO_COUNT = "too_bright_to_count"
    NOT_MEASURED = "not_measured_in_images"
    TOLERANCE_NOT_MET = "tolerance_not_met"
    TIER_TOO_COARSE = "tier_too_coarse"


class NotOk(RuntimeError):
    """Raised by `Outcome.unwrap` when there is no value."""


@dataclass(frozen=True)
class Outcome(Generic[T]):
    """A typed answer.

    Attributes
    ----------
    value : T or None
        The answer; ``None`` unless ``status`` is ``ok``.
    status : Status
        Kind of answer.
    reason : Reason
        Code of the reason when not ``ok``.
    message : str
        One sentence for people.
    flags : tuple of str
        Caveats that do not void the value (``extrapolated``, ``clamped`` ...).
    unit : str
        Unit of ``value``.
    """

    value: T | None
    status: Status = Status.OK
    reason: Reason = Reason.NONE
    message: str = ""
    flags: tuple[str, ...] = field(default=())
    unit: str = ""

    def __post_init__(self) -> None:
        if (self.value is None) == (self.status is Status.OK):
            raise ValueError("an Outcome has a value exactly when its status is ok")
        if (self.reason is Reason.NONE) != (self.status is Status.OK):
            raise ValueError("an Outcome names a reason exactly when its status is not ok")
        if isinstance(self.value, float) and self.value != self.value:
            raise ValueError("an Outcome has no nan: its status says why there is no number")

    @classmethod
    def ok(cls, value: T, *, unit: str = "", flags: tuple[str, ...] = ()) -> "Outcome[T]":
        """Answer with a value.

        Parameters
        ----------
        value : T
            The answer.
        unit : str, optional
            Unit of the value, in words; empty without one.
        flags : tuple of str, optional
            Remarks on the value.
        """
        return cls(value, unit=unit, flags=flags)

    @classmethod
    def refuse(cls, status: Status, reason: Reason, message: str, *, unit: str = "") -> "Outcome[T]":
        """Answer without a value.

        Parameters
        ----------
        status : Status
        reason : Reason
        message : str
            One sentence for people.
        unit : str, optional
            Unit of the value, in words; empty without one.
        """
        return cls(None, status=status, reason=reason, message=message, unit=unit)

    def unwrap(self) -> T:
        """Return the value.

        Raises
        ------
        NotOk
            If the status is not ``ok``; the message names status, reason and explanation.
        """
        if self.value is None:
            raise NotOk(f"{self.status}: {self.reason}: {self.message}")
        return self.value

    def map(self, function: Callable[[T], U]) -> "Outcome[U]":
        """Apply ``function`` to the value of an ``ok`` outcome, pass any other through."""
        value = None if self.value is None else function(self.value)
        return Outcome(value, self.status, self.reason, self.message, self.flags, self.unit)

    def to_dict(self) -> dict[str, Any]:
        """Plain dict for JSON."""
        return {
            "value": self.value,
            "unit": self.unit,
            "status": str(self.status),
            "reason": str(self.reason),
            "message": self.message,
            "flags": list(self.flags),
        }
