"""``cpic confirm`` with products: a confirmed scene in an output folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cpic_planner.environment import RunClock
from cpic_planner.etc.model import build_model
from cpic_planner.models import ConfirmResult
from cpic_planner.runfolder import RunFolder, open_run_folder
from cpic_planner.scene_confirmation import ConfirmConfig, confirm_hash, confirm_scene
from simulator.files import dump_json

__all__ = ["FinishedConfirmation", "run_confirmation"]


@dataclass(frozen=True)
class FinishedConfirmation:
    """A confirmed scene, and how much of it was already there."""

    result: ConfirmResult
    resumed_parts: int
    computed_parts: int


def run_confirmation(
    config: ConfirmConfig,
    out: str | Path,
    *,
    workers: int = 1,
    scheduler: str | None = None,
    force: bool = False,
    advance: Callable[[str], None] = lambda text: None,
    command: list[str] | None = None,
) -> FinishedConfirmation:
    """Confirm a scene and write ``confirm.json``, ``measurements.csv``, ``report.html``, panels and ``run.json``.

    Parameters
    ----------
    config : ConfirmConfig
    out : str or Path
        Output folder; resumed when it holds work of the same configuration.
    workers, scheduler, force, advance, command
        As of `cpic_planner.plan.make_plan`.

    Returns
    -------
    FinishedConfirmation

    Raises
    ------
    InputError
        For bad input, or if ``out`` is in use or holds another configuration.
    """
    from cpic_planner.report.write_confirm import products_of

    clock, kept = RunClock(), 0
    digest = confirm_hash(config)
    products = ("confirm.json", "run.json", *products_of(config.bands or config.instrument.visible_bands()))
    with open_run_folder(out, kind="confirm", config_hash=digest, products=products, force=force) as folder:

        def stored(key: str) -> dict[str, Any] | None:
            nonlocal kept
            body = folder.part(key)
            kept += body is not None
            return body

        result, bodies = confirm_scene(
            config, workers=workers, scheduler=scheduler, advance=advance, stored=stored, keep=folder.save_part
        )
        _write(folder, config, result, bodies)
        record = clock.record(
            command=command,
            config_hash=digest,
            workers=workers,
            scheduler=scheduler,
            resumed_parts=kept,
            computed_parts=len(bodies) - kept,
        )
        folder.write("run.json", dump_json(record.model_dump(mode="json")))
    return FinishedConfirmation(result, kept, len(bodies) - kept)


def _write(folder: RunFolder, config: ConfirmConfig, result: ConfirmResult, bodies: dict[str, dict[str, Any]]) -> None:
    from cpic_planner.report.write_confirm import write_confirm_report

    folder.write("confirm.json", dump_json(result.model_dump(mode="json")))
    model = build_model(config.instrument, config.bands, config.strategy)
    shown = config.simulator_overrides.scene(config.scene)
    write_confirm_report(folder, result, model, shown, bodies)
