"""The question of ``cpic plan``: which of the best targets do simulated images confirm."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from cpic_planner.queries.fields import asked
from cpic_planner.queries.images import ImageQuestion
from cpic_planner.queries.rank import RankedQuestion
from cpic_planner.queries.shared import RunQuestion


class PlanQuestion(ImageQuestion, RankedQuestion, RunQuestion):
    """Everything that decides a plan, but for the star table.

    ``v_mag_max`` None: 7, or all of a table of one's own. ``known_planets``
    (`catalogs.known_planets.load_known_planets`) stands instead of ``population``, with ``n_planets`` draws of each at
    ``date_utc``, the start of the mission by default.
    """

    KIND: ClassVar[str] = "plan"

    top: int = asked(5, "How many targets to confirm with images.", ge=1, le=1000)
    out: Path = asked(Path("cpic-plan"), "Output folder; an interrupted run continues there.", physics=False)
