"""Record of what a survey has done at a star and found there, in all universes of a block."""

from dataclasses import InitVar, dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from cpic_core import BoolArray, FloatArray, IntArray
from cpic_planner.planets import PublishedOrbit
from cpic_planner.survey.detection import Setting, on_detector
from cpic_planner.survey.events import HOURS
from cpic_planner.survey.orbits import Epoch
from cpic_planner.survey.universe import NEW, PlanetSample

if TYPE_CHECKING:
    from cpic_planner.survey.simulate import Survey


@dataclass(eq=False)
class StarHistory:
    """One star in all universes of a block: what each visit would show, and what visits have shown so far.

    ``last_slot`` is that of its last planned visit, ``published`` what is published of the orbits of its known planets,
    by their row. ``allowed`` tells which planets are there. The others are excluded by what is known of the star:
    nothing stops or follows because of them, but ``counts`` has what the same visits would show of them, too.
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
    published: dict[int, PublishedOrbit] = field(default_factory=dict)
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
        self.listed = self.planets.known != NEW
        # What candidates wait for: planets to be seen again, false alarms to be refuted, and how the last was seen.
        self.confirmed = np.zeros(len(self.planets), bool)
        self.doubts, self.checks, self.option = np.zeros((3, n), np.int64)
        self.shown_day = np.zeros(n)
        self.place = np.zeros((2, len(self.planets)))
        # Visits for orbits: those made and the day of the last one, the way each planet was found, the slots that are
        # to come, and what these were chosen by.
        self.orbit_visits, self.orbit_day = np.zeros(n, np.int64), np.full(n, -np.inf)
        self.way, self.chosen_by = np.full((2, len(self.planets)), -1)
        self.orbit_slots: BoolArray | None = None

    def universes_of(self, some: BoolArray | IntArray) -> BoolArray:
        """Return the universes that have at least one of some planets."""
        found = np.zeros(len(self.stopped), bool)
        found[self.planets.universe[some]] = True
        return found

    def inside(self, survey: "Survey", i: int, band: str, slot: int) -> BoolArray:
        """Tell which planets a team expects in the dark hole: known ones by their orbit, others where they were.

        Parameters
        ----------
        survey : Survey
        i : int
            Position of the star.
        band : str
        slot : int
        """
        now = self.planets.places(survey.calendar.day[i, [slot]])
        here = np.hypot(now.east_au, now.north_au)[0] / float(survey.targets.distance_pc[i])
        by_orbit = here, np.rad2deg(np.arctan2(now.east_au, now.north_au))[0]
        separation, pa_deg = np.where(self.planets.known != NEW, by_orbit, self.place)
        roll = survey.calendar.roll_deg(survey.strategy.revisits, i, np.array([slot]), np.array([slot]))
        return on_detector(survey.model, band, separation, pa_deg - roll)[2]

    def show(self, day: float, band: str, some: IntArray, snr: FloatArray, shows: BoolArray) -> None:
        """Note positions of some planets, where a visit shows them.

        Parameters
        ----------
        day : float
            After the start of the survey.
        band : str
        some : ndarray of int
            Numbers of planets of the star.
        snr : ndarray
            Of each of them.
        shows : ndarray of bool
            Likewise.
        """
        light, shown = np.zeros(len(self.planets)), np.zeros(len(self.planets), bool)
        light[some], shown[some] = snr, shows
        self.epochs.append(Epoch(day, band, light, shown))
