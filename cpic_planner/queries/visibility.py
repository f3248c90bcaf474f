"""The question of ``cpic visibility``: when stars can be seen from the orbit."""

from __future__ import annotations

from typing import Any, ClassVar

from cpic_planner.queries.fields import asked
from cpic_planner.queries.shared import CatalogQuestion, Texts, default_instrument, read_instrument
from simulator.config import Instrument


class VisibilityQuestion(CatalogQuestion):
    """Say when stars can be seen from the orbit of the telescope, and for how long per orbit."""

    KIND: ClassVar[str] = "visibility"

    target: Texts = asked(
        ...,
        'Stars: "HIP 8102", "tau Cet", "alpha Cen B" ...',
        argument=True,
        metavar="TARGET...",
        accepts="str or sequence of str",
    )
    start_utc: str | None = asked(
        None, "First day, UTC, e.g. 2028-01-01.", option="--start", default_words="that of the mission"
    )
    n_days: int = asked(365, "How many days.", option="--days")
    step_days: float = asked(1.0, "Time between orbits that are looked at; of the Moon, at most 1.")
    limits: Any = asked(
        None,
        "Limits of pointing: preset, or YAML file.",
        option="--visibility",
        command=str,
        default_words="default",
        accepts="VisibilityConfig, mapping, str or Path, optional",
    )
    instrument: Instrument = asked(
        default_instrument,
        "Preset name or YAML file with what differs; its mission has the orbit.",
        option="--instrument",
        read=read_instrument,
        default_words="cpic_default",
        accepts="Instrument, mapping, str or Path, optional",
    )
