"""Visibility and survey what-ifs, by star names and plain numbers."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable

from cpic_planner.api.keywords import takes
from cpic_planner.models import VisibilityResult, WhatIfResult
from cpic_planner.queries.visibility import VisibilityQuestion
from cpic_planner.queries.whatif import WhatIfQuestion
from cpic_planner.targets import Targets, as_catalogue, find_target


def visibility_of(question: VisibilityQuestion, tell: Callable[[str], None] = lambda text: None) -> VisibilityResult:
    """Return when stars can be seen, each star once.

    Parameters
    ----------
    question : VisibilityQuestion
    tell : callable
        Gets remarks on what was read.

    Raises
    ------
    InputError
        For an unknown star, one without coordinates, or a time out of range.
    """
    from cpic_planner.survey.visibility import load_visibility
    from cpic_planner.survey.visibility.result import visibility_result

    config, mission, table = (
        load_visibility(question.limits),
        question.instrument.mission,
        as_catalogue(question.catalog),
    )
    stars: dict[str, Targets] = {}
    found = [find_target(name, catalog=table) for name in question.target]
    for remark in (*table.notes, *(remark for _, remark in found if remark)):
        tell(remark)
    for star, _ in found:
        stars.setdefault(str(star.name[0]), star)
    return visibility_result(
        Targets.joined(list(stars.values())),
        config,
        mission.orbit,
        start_utc=question.start_utc or mission.start_utc,
        n_days=question.n_days,
        step_days=question.step_days,
        catalogue=table.provenance,
    )


@takes(VisibilityQuestion, first=("target",))
def star_visibility(question: VisibilityQuestion) -> VisibilityResult:
    """Say when stars can be seen from the orbit, for how long, and at which roll.

    One orbit in the middle of each step stands for it.

    Returns
    -------
    VisibilityResult

    Raises
    ------
    InputError
        For an unknown star, one without coordinates, or a time out of range.
    """
    return visibility_of(question)


@takes(
    WhatIfQuestion,
    first=("strategies",),
    without=("strategy",),
    defaults={"out": None, "images": 0, "workers": 1},
)
def compare_strategies(question: WhatIfQuestion) -> WhatIfResult:
    """Compare survey strategies over the same synthetic universes.

    Without ``out`` nothing is kept. Values of ``vary`` carry a unit or an x, see `cpic_planner.survey.sweeps.varied`.

    Returns
    -------
    WhatIfResult

    Raises
    ------
    InputError
        For bad input, naming key, value and range.

    Examples
    --------
    >>> import cpic_planner as cp
    >>> result = cp.compare_strategies(
    ...     {"strategies": [{"name": "once", "targets": {"names": ["eps Eri"]}, "visit": {"bands": ["F520"]}}]},
    ...     universes=20, duration_days=365.0)
    >>> result.strategies[0].schedule.visits
    1
    """
    from cpic_planner.survey.strategy_file import load_strategies, with_universe
    from cpic_planner.survey.sweeps import varied
    from cpic_planner.survey.whatif import run_whatif

    config = with_universe(load_strategies(question.strategies), question.shared())
    config = varied(config, question.vary) if question.vary else config
    with contextlib.ExitStack() as stack:
        folder = question.out or stack.enter_context(tempfile.TemporaryDirectory())
        return run_whatif(
            config,
            folder,
            workers=question.workers,
            scheduler=question.scheduler,
            force=question.force,
            n_images=question.images,
            pages=question.out is not None,
        ).result
