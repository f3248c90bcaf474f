"""The question of ``cpic tradeoff``: speed against accuracy on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from cpic_planner.queries.base import Question
from cpic_planner.queries.fields import asked
from cpic_planner.queries.shared import Texts


class TradeoffQuestion(Question):
    """Measure speed against accuracy: time, memory and error of every tier, tolerance and knob."""

    KIND: ClassVar[str] = "tradeoff"

    scenes: Texts = asked((), "Fixed scene; repeat for several.", option="--scene", default_words="all")
    only: Texts = asked((), "Way to measure again; the other rows in {out} are kept. Repeat for several.")
    quick_look: bool = asked(False, "Two frames and few samples: a minute a scene, for a look.")
    workers: int = asked(1, "2: knobs and effects of a scene are measured at once.", ge=1, le=2, physics=False)
    force: bool = asked(
        False, "Remove what a run of another configuration wrote into {out}, and nothing else.", physics=False
    )
    out: Path = asked(Path("out/tradeoff"), "Folder of the results.", physics=False)
