"""Typed answers: a value, or the named reason why there is none."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Generic, TypeVar

import numpy as np
import numpy.typing as npt

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
    NO_NOISE = "no_noise"
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


@dataclass(frozen=True, eq=False)
class Outcomes:
    """Typed answers of the same kind in an array; ``answers[index]`` is one of them.

    Attributes
    ----------
    value : ndarray
        The answers; ``nan`` where there is none.
    status, reason : ndarray of str
        Those of `Outcome`, element by element.
    messages : mapping of str to str
        One sentence for each reason that occurs.
    unit : str
        Unit of the values.
    """

    value: npt.NDArray[np.float64]
    status: npt.NDArray[np.str_]
    reason: npt.NDArray[np.str_]
    messages: Mapping[str, str]
    unit: str = ""

    @classmethod
    def of(
        cls,
        value: npt.NDArray[np.float64],
        refused: Mapping[Reason, tuple[Status, npt.NDArray[np.bool_]]],
        messages: Mapping[Reason, str],
        unit: str = "",
    ) -> "Outcomes | Outcome[float]":
        """Answer with an array; a single number becomes an `Outcome`.

        Parameters
        ----------
        value : ndarray
            The answers; what stands where one is refused does not matter.
        refused : mapping
            For each reason its status, and where it holds; the first that holds is given.
        messages : mapping of Reason to str
            One sentence for each of these reasons.
        unit : str, optional
            Unit of the values.
        """
        where = [bad for _, bad in refused.values()]
        status = np.select(where, [str(status) for status, _ in refused.values()], str(Status.OK))
        reason = np.select(where, [str(reason) for reason in refused], str(Reason.NONE))
        value = np.where(status == str(Status.OK), value, np.nan)
        answers = cls(value, status, reason, {str(reason): messages[reason] for reason in refused}, unit)
        return answers if value.ndim else answers[()]

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array."""
        return self.value.shape

    def __getitem__(self, index: tuple[int, ...] | int) -> Outcome[float]:
        """Answer of one element."""
        if self.status[index] == Status.OK:
            return Outcome.ok(float(self.value[index]), unit=self.unit)
        reason = Reason(str(self.reason[index]))
        return Outcome.refuse(Status(str(self.status[index])), reason, self.messages[reason], unit=self.unit)

    def unwrap(self) -> npt.NDArray[np.float64]:
        """Return the values.

        Raises
        ------
        NotOk
            If an answer has none; the message names the first of these.
        """
        for index in zip(*np.nonzero(self.status != str(Status.OK)), strict=True):
            place = tuple(map(int, index))
            try:
                self[place].unwrap()
            except NotOk as error:
                raise NotOk(f"element {list(place)}: {error}") from None
        return self.value
