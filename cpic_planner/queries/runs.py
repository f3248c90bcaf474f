"""The question of ``cpic plan``: which of the best targets do simulated images confirm.

The question of ``cpic whatif``: which survey strategy finds most.

The question of ``cpic tradeoff``: speed against accuracy on this machine.
"""

from pathlib import Path
from typing import Any, ClassVar, Literal, Self

from pydantic import model_validator

from cpic_core import InputError
from cpic_planner.queries.base import Question, called
from cpic_planner.queries.fields import asked, asked_changes
from cpic_planner.queries.images import ImageQuestion
from cpic_planner.queries.rank import RankedQuestion, asked_exclusions
from cpic_planner.queries.shared import RunQuestion, TablesQuestion, Texts


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
    out: Path = asked(
        Path("cpic-plan"), "Output folder; an interrupted run continues there.", physics=False, metavar="DIR"
    )

    @model_validator(mode="after")
    def _of_a_schedule(self) -> Self:
        why = "the visits of a schedule have bands, frames and dates of their own"
        for name in ("time_s", "visit_time_s", "strategy.visits", "bands", "n_days", "limits"):
            self.refuse_together(("schedule", name), why)
        if self.schedule_strategy is not None and self.schedule is None:
            raise InputError("schedule_strategy", self.schedule_strategy, allowed=f"only with {called('schedule')}")
        return self


_SAMPLE = ("universes", "seed", "start_utc", "date_utc", "duration_days", "slot_days")
_FACTS = ("catalog", "known_planets", "candidates", "exclusions", "facts")
UNIVERSE = (*_SAMPLE, "observed", "background", "visibility", "instrument", "changes", *_FACTS)
"""Fields that stand instead of those of `cpic_planner.survey.strategy.UniverseConfig`, which checks them."""


class WhatIfQuestion(RunQuestion, TablesQuestion):
    """Compare survey strategies over the same synthetic universes.

    What is not given of the universe is as the strategies' file says.
    """

    KIND: ClassVar[str] = "whatif"

    strategies: Any = asked(
        "survey_default",
        "Preset (survey_default) or YAML file.",
        argument=True,
        command=str,
        accepts="mapping, str or Path",
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
    universes: int | None = asked(None, "Synthetic universes.", ge=2, le=10_000_000, unset="1000")
    seed: int | None = asked(None, "Seed of every random number.", ge=0, lt=2**63, unset="1")
    start_utc: str | None = asked(None, "Start of the survey, UTC.", option="--start")
    date_utc: str | None = asked(
        None,
        "Date of the places of stars and their companions in all visits, UTC.",
        option="--date",
        unset="the begin of the survey",
    )
    duration_days: float | None = asked(None, "Length of the survey in days.", option="--days")
    slot_days: float | None = asked(None, "Step of the calendar in days.")
    observed: str | None = asked(
        None, "Table of visits with outcomes filled in (visits.csv): plan what is left of the survey.", read=str
    )
    background: Literal["off", "on"] | None = asked(None, "Let background stars make false alarms.", unset="off")
    visibility: str | None = asked(None, "Limits of pointing: preset, or YAML file.", read=str)
    catalog: str | None = asked(None, "Star table: snapshot, latest, simbad_2012, or a file.", read=str)
    instrument: str | None = asked(None, "Preset name or YAML file.", read=str)
    changes: Texts | None = asked_changes(None, unset="as the file says")
    known_planets: str | None = asked(
        None,
        "Table of known planets as of cpic rank: snapshot, archive_2019, latest, a file, none+FILE; counted beside the "
        "population; off leaves them out.",
        read=str,
    )
    candidates: bool | None = asked(None, "Count candidates among the known planets too.", unset="no")
    exclusions: Texts | None = asked_exclusions(None, unset="all three")
    facts: bool | None = asked(
        None,
        "Also plan and play every strategy without each fact that is known (known planets since 2019, radial "
        "velocities, stability, known giants, companion stars), and say which fact moved which number.",
        unset="as the file says; not with values that vary",
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

    def shared(self) -> dict[str, Any]:
        """Return what is given of the universe that all strategies share."""
        return {name: getattr(self, name) for name in UNIVERSE if getattr(self, name) is not None}


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
