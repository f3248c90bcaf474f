"""What a survey has done at a star, and what that has shown, in all universes of a block."""

from dataclasses import InitVar, dataclass, field

import numpy as np

from cpic_core import BoolArray, FloatArray, IntArray
from cpic_planner.survey.detection import Setting
from cpic_planner.survey.events import HOURS
from cpic_planner.survey.orbits import Epoch
from cpic_planner.survey.universe import PlanetSample


@dataclass(eq=False)
class StarHistory:
    """One star in all universes of a block: what each visit would show, and what visits have shown so far.

    ``last_slot`` is that of its last planned visit. ``allowed`` tells which planets are there. The others are excluded
    by what is known of the star: nothing stops or follows because of them, but ``counts`` has what the same visits
    would show of them, too.
    """

    planets: PlanetSample
    allowed: BoolArray
    shape: InitVar[tuple[int, int]]
    left_h: float
    hits: dict[int, BoolArray] = field(default_factory=dict)
    seen: dict[int, dict[str, FloatArray]] = field(default_factory=dict)
    alarms: dict[int, tuple[IntArray, IntArray]] = field(default_factory=dict)
    epochs: list[Epoch] = field(default_factory=list)
    ahead: dict[Setting, FloatArray] = field(default_factory=dict)
    last_slot: int = -1
    visits: int = 0

    def __post_init__(self, shape: tuple[int, int]) -> None:
        bands, n = shape
        self.counts = np.zeros(len(self.planets), np.int64)
        self.found = np.zeros(len(self.planets), bool)
        self.shown = np.zeros((bands, len(self.planets)), bool)
        self.reached = np.zeros((bands, len(self.planets)))
        self.tried = np.zeros((bands, len(self.planets)), np.int64)
        self.stopped = np.zeros(n, bool)
        self.empty = np.zeros(n, np.int64)
        self.hours = np.zeros(len(HOURS))
        # What candidates wait for: planets to be seen again, false alarms to be refuted, and how the last was seen.
        self.confirmed = np.zeros(len(self.planets), bool)
        self.doubts, self.checks, self.option = np.zeros((3, n), np.int64)
        self.shown_day = np.zeros(n)
        self.place = np.zeros((2, len(self.planets)))

    def universes_of(self, some: BoolArray | IntArray) -> BoolArray:
        """Universes that have at least one of some planets."""
        found = np.zeros(len(self.stopped), bool)
        found[self.planets.universe[some]] = True
        return found
