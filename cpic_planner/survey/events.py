"""What a survey spends and finds, event after event."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cpic_planner.survey.schedule import PlannedVisit
from cpic_planner.survey.universe import Bodies

if TYPE_CHECKING:
    from cpic_planner.survey.play import Survey

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
ROUNDING_H = 1e-9
_OF_BODY = ("radius_rjup", "semi_major_axis_au", "eccentricity", "inclination_deg")
_OF_VISIT = (
    "margin",
    "chance",
    "snr",
    "contrast",
    "separation_arcsec",
    "pa_deg",
    "roll_deg",
    "distance_au",
    "phase_deg",
)


@dataclass(eq=False)
class Clock:
    """Time of ``n`` universes, hours."""

    left: FloatArray
    slot: FloatArray
    promised: FloatArray
    search: FloatArray
    follow: FloatArray
    visits: NDArray[np.int64]

    @classmethod
    def of(cls, n: int, budget_h: float, promised_h: float) -> Clock:
        """Return the start of ``n`` universes: whole budget, and what planned visits will take of it."""
        zero = np.zeros(n)
        return cls(
            np.full(n, budget_h), zero.copy(), np.full(n, promised_h), zero.copy(), zero.copy(), np.zeros(n, np.int64)
        )

    def affords(self, cost_h: float) -> BoolArray:
        """Return the universes whose slot and budget hold a cost."""
        return np.asarray((self.slot >= cost_h - ROUNDING_H) & (self.left >= cost_h - ROUNDING_H))

    def spend(self, go: BoolArray, cost_h: float, on: FloatArray) -> None:
        """Take the cost of one visit in the universes ``go`` from slot and budget, and note what it was spent on."""
        for account in (self.left, self.slot):
            account[go] -= cost_h
        on[go] += cost_h
        self.visits[go] += 1

    @property
    def used(self) -> FloatArray:
        """Time of search and follow-up so far."""
        return self.search + self.follow


class Events:
    """Detections and false alarms of ``n`` universes."""

    def __init__(self, n: int) -> None:
        self.noise_alarms = np.zeros(n, np.int64)
        self.background_alarms = np.zeros(n, np.int64)
        self._parts: list[dict[str, Any]] = []

    def alarms(self, go: NDArray[np.bool_], noise: NDArray[np.int64], background: NDArray[np.int64]) -> None:
        """Count the false alarms of a visit where it was made."""
        self.noise_alarms[go] += noise[go]
        self.background_alarms[go] += background[go]

    def detections(
        self,
        bodies: Bodies,
        new: NDArray[np.bool_],
        visit: PlannedVisit,
        seen: Mapping[str, FloatArray],
        day: float,
        used_h: FloatArray,
    ) -> None:
        """Note the planets that a visit adds."""
        count = int(new.sum())
        part: dict[str, Any] = {
            "universe": bodies.universe[new],
            "planet": bodies.number[new],
            "known_row": bodies.known[new],
            "kind": bodies.kind[new],
            "star": np.full(count, visit.star),
            "option": np.full(count, visit.option),
            "ordinal": np.full(count, visit.ordinal),
            "day": np.full(count, day),
            "used_h": used_h[bodies.universe[new]],
        }
        part |= {name: getattr(bodies, name)[new] for name in _OF_BODY}
        part |= {name: seen[name][new] for name in _OF_VISIT}
        self._parts.append(part)

    def columns(self, survey: Survey) -> dict[str, NDArray[Any]]:
        """Columns of the table of detections, names instead of positions."""
        names = (
            "universe",
            "planet",
            "known_row",
            "kind",
            "star",
            "option",
            "ordinal",
            "day",
            "used_h",
            *_OF_BODY,
            *_OF_VISIT,
        )
        kinds = dict.fromkeys(names[:7], np.int64)
        joined: dict[str, NDArray[Any]] = {
            name: np.concatenate([np.zeros(0), *(part[name] for part in self._parts)]).astype(kinds.get(name, float))
            for name in names
        }
        option, star = joined["option"], joined.pop("star")
        joined["star"] = np.array([str(survey.targets.name[i]) for i in star], object)
        joined["band"] = np.array([survey.options[i][o].band for i, o in zip(star, option, strict=True)], object)
        return joined
