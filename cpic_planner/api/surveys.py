"""Visibility and survey what-ifs, by star names and plain numbers."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cpic_planner.api.inputs import InstrumentSource, stars_named
from cpic_planner.models import VisibilityResult, WhatIfResult
from cpic_planner.targets import Targets, as_catalogue
from simulator.config import Instrument, load_instrument
from simulator.numeric import numeric_context

if TYPE_CHECKING:
    from cpic_planner.survey.visibility import VisibilitySource

__all__ = ["compare_strategies", "star_visibility"]


@numeric_context()
def star_visibility(
    target: str | Sequence[str],
    *,
    start_utc: str | None = None,
    n_days: int = 366,
    step_days: float = 1.0,
    limits: VisibilitySource = None,
    catalog: str | Path = "snapshot",
    instrument: InstrumentSource = None,
) -> VisibilityResult:
    """When stars can be seen from the orbit, for how long, and at which roll.

    Parameters
    ----------
    target : str or sequence of str
    start_utc : str, optional
        That of the instrument's mission by default.
    n_days : int
    step_days : float
        One orbit in the middle of each step stands for it.
    limits : VisibilityConfig, mapping, str or Path, optional
        Avoidance angles, panels and slews; see `cpic_planner.survey.visibility.load_visibility`.
    catalog : str or Path
    instrument : Instrument, mapping, str or Path, optional
        Its mission has the orbit.

    Returns
    -------
    VisibilityResult

    Raises
    ------
    InputError
        For an unknown star, one without coordinates, or a time out of range.
    """
    from cpic_planner.survey.visibility import load_visibility
    from cpic_planner.survey.visibility.result import visibility_result

    mission = (instrument if isinstance(instrument, Instrument) else load_instrument(instrument)).mission
    table = as_catalogue(catalog)
    stars = Targets.joined(stars_named(target, "on", table))
    return visibility_result(
        stars,
        load_visibility(limits),
        mission.orbit,
        start_utc=start_utc or mission.start_utc,
        n_days=n_days,
        step_days=step_days,
        catalogue=table.provenance,
    )


@numeric_context()
def compare_strategies(
    strategies: Mapping[str, Any] | str | Path = "survey_default",
    *,
    out: str | Path | None = None,
    vary: Sequence[str] = (),
    images: int = 0,
    workers: int = 1,
    scheduler: str | None = None,
    force: bool = False,
    **universe: Any,
) -> WhatIfResult:
    """Compare survey strategies over the same synthetic universes.

    Parameters
    ----------
    strategies : mapping, str or Path
        As `cpic_planner.survey.strategy_file.load_strategies` reads them.
    out : str or Path, optional
        Folder for tables and report; an interrupted run continues there. Without it nothing is kept.
    vary : sequence of str
        ``"KEY=VALUE,VALUE..."``: every strategy with each value, as ``"drift=0.1nm,x3"``; values carry a unit or an
        x, see `cpic_planner.survey.sweeps.varied`.
    images : int
        Detections of each strategy that are simulated as images.
    workers, scheduler, force
        As `cpic_planner.jobs.job.run`.
    **universe
        Fields of `cpic_planner.survey.strategy_file.UniverseConfig`: ``universes``, ``seed``, ``start_utc``,
        ``duration_days``, ``slot_days``, ``catalog``, ``instrument``, ``known_planets``, ``observed`` ...

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

    config = with_universe(load_strategies(strategies), universe)
    config = varied(config, vary) if vary else config
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory()) if out is None else out
        return run_whatif(
            config, folder, workers=workers, scheduler=scheduler, force=force, n_images=images, pages=out is not None
        ).result
