"""Typed answers: a value, or the named reason why there is none."""

from collections.abc import Callable, Mapping
from dataclasses import field
from enum import StrEnum
from typing import Any, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from cpic_core.records import Record

T = TypeVar("T")
U = TypeVar("U")


class Status(StrEnum):
    """The kind of an answer."""

    OK = "ok"
    """There is a value."""
    UNREACHABLE = "unreachable"
    """No choice of frames, gain and visits gives what is asked for; the reason says what prevents it."""
    SATURATED = "saturated"
    """Even the shortest frame at the lowest gain is too bright for the camera."""
    OUTSIDE_FIELD = "outside_field"
    """The place lies outside the dark hole of the band."""
    INVALID = "invalid"
    """The method that was asked for does not hold here, although the question has a meaning."""


class Reason(StrEnum):
    """The reason why an answer is not ``ok`` (empty when it is)."""

    NONE = ""
    SPECKLE_FLOOR = "speckle_floor"
    """Residual speckles of so many visits are too bright: no length of visit is enough; more visits may be."""
    COMMON_SPECKLE_FLOOR = "common_speckle_floor"
    """Speckles that science and reference differ by in every visit are too bright: no number of visits is enough."""
    PLANET_MOVES = "planet_moves"
    """It would be detected if it stood still, but it moves in the time that so many visits take."""
    INSUFFICIENT_TIME = "insufficient_time"
    """The given time is too short, or the time that is needed is too long to be stated."""
    PIXEL_FULL_WELL = "pixel_full_well"
    """Pixels hold no more electrons."""
    REGISTER_FULL_WELL = "register_full_well"
    """The gain register holds no more electrons."""
    ADC_RANGE = "adc_range"
    """The analogue-to-digital converter has no larger number."""
    INSIDE_INNER_EDGE = "inside_inner_edge"
    """The place is too close to the star: inside the inner edge of the dark hole."""
    OUTSIDE_OUTER_EDGE = "outside_outer_edge"
    """The place is too far from the star: outside the outer edge of the dark hole."""
    TOO_FEW_ELEMENTS = "too_few_resolution_elements"
    """Fewer than three resolution elements at this separation: the scatter of the background is undefined."""
    SOURCE_ON_PLACE = "source_on_place"
    """Another source stands within lambda/D: their light cannot be told apart."""
    NO_TIME = "time_below_overheads"
    """The time holds no science frame with its share of reference frames and overhead."""
    TOO_MANY_FRAMES = "too_many_frames"
    """It takes more frames than can be planned or simulated."""
    NOT_ADDITIVE = "not_additive"
    """Frames of this kind cannot be drawn as a sum, because an effect depends on what single frames hold."""
    NO_LIGHT = "no_planet_light"
    """The planet sends no light in this band and at this phase."""
    NO_NOISE = "no_noise"
    """No term makes noise, so that the ratio has no value."""
    SMALL_ROLL = "roll_too_small"
    """The planet overlaps its own image at the other roll."""
    TOO_BRIGHT_TO_COUNT = "too_bright_to_count"
    """At this gain every pixel of the aperture counts in each frame: photons cannot be told apart."""
    NOT_MEASURED = "not_measured_in_images"
    """Images of this kind are not simulated, so that the answer cannot be checked in them."""
    TOLERANCE_NOT_MET = "tolerance_not_met"
    """No method is predicted to be as accurate as the tolerance asks."""
    TIER_TOO_COARSE = "tier_too_coarse"
    """The tier of accuracy (``fidelity``) is too coarse for this scene."""


class NotOk(RuntimeError):
    """Raised by `Outcome.unwrap` when there is no value."""


class Outcome(Record, Generic[T]):
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
        """Return the answer with a value.

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
        """Return the answer without a value.

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
        """Return the plain dict for JSON."""
        return {
            "value": self.value,
            "unit": self.unit,
            "status": str(self.status),
            "reason": str(self.reason),
            "message": self.message,
            "flags": list(self.flags),
        }


class Outcomes(Record, eq=False):
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
        """Return the answer with an array; a single number becomes an `Outcome`.

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
        """Return the answer of one element."""
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
