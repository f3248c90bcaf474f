"""The questions of ``cpic confirm``, ``plan``, ``whatif`` and ``tradeoff``: runs that write a folder."""

import os
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from catalogs import resolve_star
from cpic_core import InputError
from cpic_planner.queries import shared
from cpic_planner.queries.changes import Change, SimulatorOverrides, changed, read_instrument
from cpic_planner.queries.question import Parts, Question, asked, asked_changes, called
from cpic_planner.queries.rank import Exclusions, RankedQuestion, asked_exclusions
from cpic_planner.queries.shared import RunQuestion, TablesQuestion, Texts
from simulator.config import FrozenModel, Real, Scene, Utc, checked_utc, load_scene
from simulator.knobs import Dial, dial_of

REALISATIONS = 8
"""Draws of drift and noise of every target and band: an SNR of 10 from 12 apertures is then known to 9 %."""


class ImageQuestion(shared.InstrumentQuestion):
    """The settings that decide images that are measured.

    ``fidelity`` or ``tolerance`` set the dial of speed against accuracy, ``standard`` without any.
    ``simulator_overrides`` alter the images alone.
    """

    strategy: shared.Strategy = shared.asked_strategy()
    realisations: int = asked(
        REALISATIONS,
        "Simulated observations of every planet and band, each with its own drift and noise.",
        ge=1,
        le=shared.MAX_REALISATIONS,
    )
    simulator_overrides: SimulatorOverrides = asked(
        SimulatorOverrides(),
        "Alter the simulator alone, as throughput=x0.7, companions=on or detector.cic_e=0.05; repeat for several. Or a "
        "YAML file.",
        metavar="KEY=VALUE",
        several=True,
        option="--simulator-overrides",
        accepts="mapping, str, Path or sequence",
    )
    fidelity: shared.Fidelity | None = asked(None, "Speed against accuracy of the images.", unset="standard")
    tolerance: float | None = asked(
        None,
        "Instead of {fidelity}: the cheapest images whose planet flux and SNR are predicted to be this close to the "
        "reference, 0 to 0.5.",
    )
    seed: shared.Seed = asked(1, "Seed of every random number.")

    @classmethod
    def _read(cls, tree: dict[str, Any]) -> dict[str, Any]:
        tree = super()._read(tree)
        if "simulator_overrides" in tree:
            tree["simulator_overrides"] = SimulatorOverrides.of(tree["simulator_overrides"], tree.get("instrument"))
        return tree

    @model_validator(mode="after")
    def _imaged(self) -> Self:
        self.simulator_overrides.instrument(self.instrument)  # refuses unknown keys
        self.refuse_together(("tolerance", "fidelity"), "they are two names of one dial")
        shared.refuse_counting(self.strategy, self.dial)
        return self

    @property
    def dial(self) -> Dial:
        """Speed against accuracy."""
        return dial_of(self.fidelity, self.tolerance)

    def hashed(self) -> dict[str, Any]:
        """Return what decides numbers; the dial by what it does, not by the name that it was given."""
        tree = super().hashed()
        del tree["fidelity"], tree["tolerance"]
        return tree | {"dial": self.dial.model_dump(mode="json")}

    @property
    def image_settings(self) -> dict[str, Any]:
        """Settings of `cpic_planner.validation.task.task_of`."""
        same = {name: getattr(self, name) for name in ("seed", "fidelity", "tolerance", "realisations")}
        return same | {"overrides": self.simulator_overrides}


class StarImagesQuestion(ImageQuestion, shared.StarsQuestion, shared.RunQuestion):
    """Images of named stars, each with its reference planet at the best separation."""

    KIND: ClassVar[str] = "confirm_targets"

    target: shared.Texts = asked(..., "Star names.", accepts="str or sequence of str")
    time_s: float = asked(
        36000.0, "Wall time per target and band, readouts and reference frames included.", ge=1e-3, le=1e9
    )
    planet: shared.ReferencePlanet = shared.asked_planet()


class SceneParts(Parts):
    """Options of a scene."""

    scene: str | None = asked(
        None,
        "Scene: a preset or a YAML file.",
        argument=True,
        unset="that of the parameters beside the files of {from_products}",
    )
    companions: shared.OnOff | None = asked(
        None, "Put the scene's companions on the images.", unset="as the scene says"
    )

    def made(self, base: Any) -> Scene:
        """Return the scene, with or without its companions."""
        if self.scene is None:
            raise InputError("companions", self.companions, allowed="together with a scene")
        chosen = _scene(self.scene)
        return chosen if self.companions is None else chosen.model_copy(update={"companions": self.companions})


def _scene(source: str) -> Scene:
    """Return the scene of a preset or a file; say what to do with the name of a star."""
    try:
        return load_scene(source)
    except InputError as error:
        if error.key != "scene" or os.path.exists(source):
            raise
        try:
            resolve_star(source)
        except InputError:
            raise error from None
        hint = "this is a star of the catalogue: write a scene with it as cstar, or see cpic plan"
        raise InputError(error.key, source, allowed=error.allowed, hint=hint) from None


class ConfirmQuestion(shared.ProgrammeQuestion, ImageQuestion, shared.ReportQuestion):
    """Everything that decides the confirmation of a scene.

    Frames are given by ``exposure_s`` and ``n_frames`` (of one visit where there is no number of visits), or visits and
    frames are those of most SNR within ``time_s`` of wall time, as the exposure-time calculator chooses them for the
    first planet of the scene that is in the dark hole of the band (for one of 1e-8 at the middle of the hole where it
    has none). A gain that is not given is the best one.
    ``audit`` None: as `cpic_planner.queries.shared.audited` says.
    With ``from_products`` Level-1 files are measured in place of simulated images; without a scene, beside none.
    """

    KIND: ClassVar[str] = "confirm"

    scene: Scene | None = asked(
        None,
        "The scene, with any number of planets and other stars; what `simulator.load_scene` reads.",
        parts=SceneParts,
        read=load_scene,
        accepts="Scene, mapping, str or Path",
    )
    # Files count by what they hold, not by where they are.
    from_products: Path | None = asked(
        None,
        "Measure the Level-1 files below this folder in place of simulated images: frames, visits, roll and exposure "
        "are theirs.",
        metavar="DIR",
        physics=False,
        accepts="str or Path",
        names_file=bool,
    )
    references: shared.Texts = asked(
        (),
        "Names below {from_products} of files that are references, whatever their headers say; * stands for anything.",
        metavar="PATTERN",
        physics=False,
    )
    date_utc: Utc | None = asked(
        None,
        "Date of the observation, UTC: that of the light of the sky; a scene has places of its own.",
        option="--date",
        unset="the mission's start",
    )
    exposure_s: Annotated[float, Field(ge=1e-6, le=1e6)] | None = asked(None, "Exposure of one frame.")
    n_frames: Annotated[int, Field(ge=1, le=shared.MAX_FRAMES)] | None = asked(
        None, "Science frames of a visit; needs {exposure_s}.", option="--frames"
    )
    em_gain: Annotated[float, Field(ge=1, le=1e4)] | None = asked(None, "Actual EM gain.", unset="the best one")
    audit: bool | None = asked(
        None,
        "Make one more realisation with every effect of the camera, a part of its frames run one by one.",
        unset="with {fidelity} standard",
    )

    @classmethod
    def _read(cls, tree: dict[str, Any]) -> dict[str, Any]:
        if "date_utc" in tree:
            start = Change(key="mission.start_utc", value=checked_utc("date_utc", tree["date_utc"]))
            tree["instrument"] = changed(read_instrument(tree.get("instrument")), (start,))
        return super()._read(tree)

    @model_validator(mode="after")
    def _frames(self) -> Self:
        if self.from_products is None:
            if self.scene is None:
                raise InputError("scene", "missing", allowed=f"a scene, or files to measure: {called('from_products')}")
            if self.references:
                raise InputError("references", self.references, allowed=f"only with {called('from_products')}")
        else:
            theirs = ("time_s", "visit_time_s", "exposure_s", "n_frames", "em_gain", "audit", "realisations", "seed")
            for name in (*theirs, "simulator_overrides", "strategy.visits", "strategy.reference_visits"):
                self.refuse_together(("from_products", name), "files are measured as they are")
        for name in ("time_s", "visit_time_s"):
            if getattr(self, name) is not None and self.n_frames is not None:
                allowed = f"without {called(name)}"
                raise InputError("n_frames", self.n_frames, allowed=allowed, hint="the time sets their number")
        if self.n_frames is not None and self.exposure_s is None:
            raise InputError("n_frames", self.n_frames, allowed=f"together with {called('exposure_s')}")
        timed = self.time_s is not None or self.visit_time_s is not None
        if self.exposure_s is not None and self.n_frames is None and not timed:
            allowed = f"together with {called('n_frames')} or {called('time_s')}"
            raise InputError("exposure_s", self.exposure_s, unit="s", allowed=allowed)
        shared.audited(self.dial, self.audit)
        return self

    @property
    def looked_at(self) -> Scene:
        """The scene that is given, or that files are of.

        Raises
        ------
        InputError
            If nobody looked at the files yet.
        """
        if self.scene is None:
            raise InputError("scene", "missing", allowed="a scene")
        return self.scene


class PlanQuestion(ImageQuestion, RankedQuestion, RunQuestion):
    """Everything that decides a plan, but for the star table.

    ``v_mag_max`` None: 7, or all of a table of one's own. ``known_planets``
    (`catalogs.known_planets.load_known_planets`) stands instead of ``population``, with ``n_planets`` draws of each.
    With ``schedule`` the targets are those of its visits, whose frames are taken as they are.
    """

    KIND: ClassVar[str] = "plan"

    top: int = asked(5, "How many targets to confirm with images.", ge=1, le=1000)
    # What they leave out is in the hash of the plan.
    n_days: int = asked(
        365,
        "Length in days of the period, from {date_utc} on, in which a target has to be seen for as long as its "
        "observation takes.",
        ge=1,
        le=36525,
        option="--days",
        physics=False,
    )
    limits: str | None = asked(
        None,
        "Limits of pointing: preset, or YAML file.",
        option="--visibility",
        read=str,
        unset="default",
        physics=False,
    )
    schedule: str | None = asked(
        None,
        "Confirm just these visits: visits.csv of cpic whatif (or .ecsv, .json), without the lines that have an "
        "outcome. {top} is then the number of its stars.",
        read=str,
        physics=False,
    )
    schedule_strategy: str | None = asked(
        None, "Strategy of {schedule} whose visits are meant, where it has several.", option="--strategy", physics=False
    )
    out: Path = shared.asked_out("cpic-plan")

    @model_validator(mode="after")
    def _of_a_schedule(self) -> Self:
        why = "the visits of a schedule have bands, frames and dates of their own"
        for name in ("time_s", "visit_time_s", "strategy.visits", "bands", "n_days", "limits"):
            self.refuse_together(("schedule", name), why)
        if self.schedule_strategy is not None and self.schedule is None:
            raise InputError("schedule_strategy", self.schedule_strategy, allowed=f"only with {called('schedule')}")
        return self


_FILE = "as the file says"


class UniverseSettings(FrozenModel):
    """The settings that survey strategies share: calendar, instrument, stars, and number of universes.

    A strategies' file says them (`cpic_planner.survey.strategy.UniverseConfig`), and a question stands above it.
    """

    start_utc: Utc = asked("2028-01-01T00:00:00", "Start of the survey, UTC.", option="--start", unset=_FILE)
    date_utc: Utc | None = asked(
        None,
        "Date of the places of stars and their companions in all visits, UTC.",
        option="--date",
        unset="the begin of the survey",
    )
    duration_days: Real = asked(3652.0, "Length of the survey in days.", option="--days", ge=1, le=36525, unset=_FILE)
    slot_days: Real = asked(30.0, "Step of the calendar in days.", ge=1, le=400, unset=_FILE)
    instrument: str = asked("cpic_default", "Preset name or YAML file.", read=str, unset=_FILE)
    changes: Texts = asked_changes(unset=_FILE)
    visibility: str = asked("default", "Limits of pointing: preset, or YAML file.", read=str, unset=_FILE)
    catalog: str = asked("snapshot", "Star table: snapshot, latest, simbad_2012, or a file.", read=str, unset=_FILE)
    known_planets: str = asked(
        "snapshot",
        "Table of known planets as of cpic rank: snapshot, archive_2019, latest, a file, none+FILE; counted beside the "
        "population; off leaves them out.",
        read=str,
        unset=_FILE,
    )
    candidates: bool = asked(False, "Count candidates among the known planets too.", unset=_FILE)
    exclusions: Exclusions = asked_exclusions(unset=f"{_FILE}; all three where it does not")
    observed: str = asked(
        "", "Table of visits with outcomes filled in (visits.csv): plan what is left of the survey.", read=str
    )
    facts: bool = asked(
        False,
        "Also plan and play every strategy without each fact that is known (known planets since 2019, radial "
        "velocities, stability, known giants, companion stars), and say which fact moved which number.",
        unset=f"{_FILE}; not with values that vary",
    )
    background: Literal["off", "on"] = asked("off", "Let background stars make false alarms.", unset=_FILE)
    universes: int = asked(1000, "Synthetic universes.", ge=2, le=10_000_000, unset=f"{_FILE}; 1000 where it does not")
    seed: shared.Seed = asked(1, "Seed of every random number.", unset=f"{_FILE}; 1 where it does not")


class WhatIfQuestion(RunQuestion, TablesQuestion, UniverseSettings):
    """Compare survey strategies over the same synthetic universes.

    What is not given of the universe is as the strategies' file says.
    """

    KIND: ClassVar[str] = "whatif"

    strategies: Any = asked(
        "survey_default", "Preset (survey_default) or YAML file.", argument=True, accepts="mapping, str or Path"
    )
    strategy: Texts = asked((), "Only this strategy of them; repeat for several.")
    vary: Texts = asked(
        (), "KEY=VALUE,VALUE...: every strategy with each value, as drift=0.1nm,x3; repeat for several keys."
    )
    doubt: str | None = asked(
        None,
        "KEY=VALUE,VALUE...: plan every strategy for each value of a number that is not known, play every plan under "
        "each, and say which to take, as drift=0.02nm,0.05nm,0.1nm,0.2nm.",
    )
    exact: bool = asked(
        False, "Search for the best calendar of every strategy much longer: minutes each (scheduler.method exact)."
    )
    share_of_time: float | None = asked(
        None,
        "Telescope time of every strategy as a fraction of the length of the survey: 0.05 is 5 % of it.",
        gt=0,
        le=1,
        unset="the hours or the share of the file",
    )
    images: int = asked(6, "Detections of each strategy that are simulated as images.", ge=0)
    workers: int = asked(
        2, "Local worker processes; results do not depend on their number.", ge=1, le=256, physics=False
    )
    out: Path | None = asked(
        None,
        "Output folder; an interrupted run continues there.",
        metavar="DIR",
        unset="cpic-whatif; none in Python, where nothing is kept without",
        physics=False,
        accepts="str or Path",
    )

    def universe(self) -> dict[str, Any]:
        """Return what is given of the universe that all strategies share."""
        return {name: getattr(self, name) for name in UniverseSettings.model_fields if name in self.model_fields_set}


class TradeoffQuestion(Question):
    """Measure speed against accuracy: time, memory and error of every tier, tolerance and knob."""

    KIND: ClassVar[str] = "tradeoff"

    scenes: Texts = asked((), "Fixed scene; repeat for several.", option="--scene", unset="all")
    only: Texts = asked((), "Way to measure again; the other rows in {out} are kept. Repeat for several.")
    quick_look: bool = asked(False, "Two frames and few samples: a minute a scene, for a look.")
    workers: int = asked(1, "2: knobs and effects of a scene are measured at once.", ge=1, le=2, physics=False)
    force: bool = asked(
        False, "Remove what a run of another configuration wrote into {out}, and nothing else.", physics=False
    )
    out: Path = asked(Path("out/tradeoff"), "Folder of the results.", physics=False, metavar="DIR")
