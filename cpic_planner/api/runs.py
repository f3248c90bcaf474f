"""Plans, confirmations and simulated products, by star names and plain numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cpic_planner.api.inputs import InstrumentSource, OnOff, StrategySource, model_of, planet_of, stars_named
from cpic_planner.etc.planet import ReferencePlanet
from cpic_planner.models import ConfirmedTarget, ConfirmResult, PlanResult, SimulationResult
from simulator.config import Instrument, Scene, load_instrument, load_scene
from simulator.config.base import validate
from simulator.numeric import numeric_context

if TYPE_CHECKING:
    from cpic_planner.overrides import OverrideSource
    from cpic_planner.simulation.inputs import SimulationInput

__all__ = ["confirm_scene", "confirm_targets", "make_plan", "simulate_products"]


@numeric_context()
def make_plan(
    out: str | Path,
    *,
    catalog: str | Path = "snapshot",
    workers: int = 1,
    scheduler: str | None = None,
    force: bool = False,
    instrument: InstrumentSource = None,
    **settings: Any,
) -> PlanResult:
    """Run the main job and write its products into ``out``.

    Parameters
    ----------
    out : str or Path
        Output folder; an interrupted run continues there.
    catalog : str or Path
        Star table, as in `signal_to_noise`.
    workers, scheduler, force
        As `cpic_planner.jobs.job.run`.
    instrument : Instrument, mapping, str or Path, optional
    **settings
        Fields of `cpic_planner.plan.PlanConfig`: ``top``, ``bands``, ``time_s``, ``planet``, ``strategy``,
        ``fidelity`` or ``tolerance``, ``realisations``, ``simulator_overrides`` (as
        `cpic_planner.overrides.SimulatorOverrides.of` reads them), ``seed``, ``known_planets`` and ``date_utc`` ...

    Returns
    -------
    PlanResult
    """
    from cpic_planner.overrides import SimulatorOverrides
    from cpic_planner.plan import PlanConfig
    from cpic_planner.plan import make_plan as run

    given = {name: value for name, value in settings.items() if value is not None}
    if "simulator_overrides" in given:
        given["simulator_overrides"] = SimulatorOverrides.of(given["simulator_overrides"])
    config = validate(PlanConfig, {"instrument": _instrument(instrument)} | given, where="plan")
    return run(config, out, catalog=catalog, workers=workers, scheduler=scheduler, force=force).result


@numeric_context()
def confirm_targets(
    target: str | Sequence[str],
    *,
    time_s: float = 36000.0,
    bands: Sequence[str] | None = None,
    planet: ReferencePlanet | Mapping[str, Any] | None = None,
    companions: OnOff = "on",
    catalog: str | Path = "snapshot",
    instrument: InstrumentSource = None,
    seed: int = 1,
    fidelity: str | None = None,
    tolerance: float | None = None,
    strategy: StrategySource = None,
    realisations: int | None = None,
    simulator_overrides: OverrideSource = None,
    workers: int = 1,
) -> list[ConfirmedTarget]:
    """Simulate and measure the named stars, each with its reference planet at the best separation.

    Parameters
    ----------
    target : str or sequence of str
    time_s, bands, planet, companions, catalog, instrument, strategy
        As `signal_to_noise`.
    seed : int
        Of the images.
    fidelity, tolerance : optional
        Speed against accuracy of the images: ``quick``, ``standard`` (the default) or ``reference``, or the largest
        relative error of planet flux and SNR that may be traded for speed, 0 to 0.5.
    realisations : int, optional
        Draws of drift and noise of every star and band, 8 by default.
    simulator_overrides : mapping, str, Path or sequence, optional
        What is altered in the images alone, as ``"throughput=x0.7"``; see `cpic_planner.overrides`.
    workers : int
        Local worker processes; the result does not depend on it.

    Returns
    -------
    list of ConfirmedTarget
        In the given order.
    """
    from cpic_planner.confirmed import REALISATIONS, confirm_stars
    from cpic_planner.overrides import SimulatorOverrides

    model = model_of(instrument, bands, strategy)
    return confirm_stars(
        model,
        stars_named(target, companions, catalog),
        time_s=time_s,
        planet=ReferencePlanet() if planet is None else planet_of(planet),
        seed=seed,
        fidelity=fidelity,
        tolerance=tolerance,
        realisations=REALISATIONS if realisations is None else realisations,
        overrides=SimulatorOverrides.of(simulator_overrides),
        workers=workers,
    )


@numeric_context()
def confirm_scene(
    scene: Scene | Mapping[str, Any] | str | Path,
    *,
    bands: Sequence[str] | None = None,
    time_s: float | None = None,
    exposure_s: float | None = None,
    n_frames: int | None = None,
    em_gain: float | None = None,
    instrument: InstrumentSource = None,
    strategy: StrategySource = None,
    realisations: int | None = None,
    audit: bool | None = None,
    simulator_overrides: OverrideSource = None,
    fidelity: str | None = None,
    tolerance: float | None = None,
    seed: int = 1,
    workers: int = 1,
    scheduler: str | None = None,
    out: str | Path | None = None,
    force: bool = False,
) -> ConfirmResult:
    """Observe one scene in simulated images and measure it blind, beside what the ETC expects, as ``cpic confirm``.

    Parameters
    ----------
    scene : Scene, mapping, str or Path
        What `simulator.load_scene` reads; with any number of planets and other stars.
    bands : sequence of str, optional
        All visible bands by default.
    time_s : float, optional
        Wall time a band in s, for the best frames; 36000 by default.
    exposure_s, n_frames, em_gain : optional
        Frames of the science visit instead; what is not given is the best one.
    instrument, strategy
        As `signal_to_noise`; photon counting is refused.
    realisations : int, optional
        Draws of drift and noise a band, 8 by default.
    audit : bool, optional
        Whether one more realisation a band runs frame by frame with every effect of the camera; by default with
        ``fidelity="standard"``.
    simulator_overrides : mapping, str, Path or sequence, optional
        What is altered in the images alone, as ``"throughput=x0.7"``; see `cpic_planner.overrides`.
    fidelity, tolerance
        As `confirm_targets`.
    seed : int
        Of the images.
    workers, scheduler
        As `make_plan`; the result does not depend on them.
    out : str or Path, optional
        Folder for ``confirm.json``, ``measurements.csv``, ``report.html`` and panels; nothing is written without.
    force : bool
        Remove what a run of another configuration wrote into ``out``, and nothing else.

    Returns
    -------
    ConfirmResult

    Raises
    ------
    InputError
        For bad input, or if ``out`` is in use or holds another configuration.
    """
    from cpic_planner.confirmed import REALISATIONS
    from cpic_planner.overrides import SimulatorOverrides
    from cpic_planner.scene_confirmation import ConfirmConfig
    from cpic_planner.scene_confirmation import confirm_scene as run

    tree: dict[str, Any] = {
        "instrument": _instrument(instrument),
        "scene": load_scene(scene),
        "bands": (bands,) if isinstance(bands, str) else bands,
        "time_s": time_s,
        "exposure_s": exposure_s,
        "n_frames": n_frames,
        "em_gain": em_gain,
        "realisations": REALISATIONS if realisations is None else realisations,
        "audit": audit,
        "simulator_overrides": SimulatorOverrides.of(simulator_overrides),
        "fidelity": fidelity,
        "tolerance": tolerance,
        "seed": seed,
    }
    config = validate(ConfirmConfig, tree if strategy is None else tree | {"strategy": strategy}, where="confirm")
    return run(config, out, workers=workers, scheduler=scheduler, force=force).result


def _instrument(source: InstrumentSource) -> Instrument:
    return source if isinstance(source, Instrument) else load_instrument(source)


@numeric_context()
def simulate_products(
    what: SimulationInput | list[SimulationInput] | tuple[SimulationInput, ...] = (),
    out: str | Path = "out/simulate",
    *,
    workers: int = 1,
    scheduler: str | None = None,
    force: bool = False,
    truth: bool = True,
    instrument: InstrumentSource = None,
    frames: int | None = None,
    seed: int | None = None,
    fidelity: str | None = None,
    tolerance: float | None = None,
    switches: Mapping[str, bool] | None = None,
    start_utc: str | None = None,
    **settings: Any,
) -> SimulationResult:
    """Make Level-0 products with truth, as ``cpic simulate`` does.

    Parameters
    ----------
    what : simulation, scene, mapping, str, Path, or a list of them
        Simulations, scenes (presets, YAML files, mappings, objects) and tables of stars (files), each row of which is a
        scene; nothing for a calibration ``kind``.
    out : str or Path
        Root of the tree of products; an interrupted run continues there.
    workers, scheduler, force, truth
        As `cpic_planner.jobs.job.run` and `cpic_planner.simulation.run.simulate`.
    instrument : Instrument, mapping, str or Path, optional
    frames, seed, fidelity, tolerance, switches, start_utc : optional
        For all sequences that have a use for them; those of a simulation are replaced. Above a ``tolerance`` of 0 the
        effect ledger leaves out what is predicted to matter less (`simulator.observe`).
    **settings
        Keys of `simulator.config.simulation.SequenceConfig` for scenes and calibration kinds: ``kind``, ``band``,
        ``exposure_s``, ``em_gain``, ``roll_deg``, ``star_offset_arcsec`` ...

    Returns
    -------
    SimulationResult
        ``sequences[i].file`` is the Level-0 file below ``out``.

    Raises
    ------
    InputError
        For bad input, or if ``out`` is in use or holds another configuration.
    """
    from cpic_planner.simulation.inputs import simulation_from
    from cpic_planner.simulation.run import simulate

    changes = {
        "frames": frames,
        "seed": seed,
        "fidelity": fidelity,
        "tolerance": tolerance,
        "switches": switches,
        "start_utc": start_utc,
    }
    simulation, _ = simulation_from(
        what if isinstance(what, list | tuple) else [what],
        settings=settings,
        changes={key: value for key, value in changes.items() if value is not None},
        instrument=instrument,
    )
    return simulate(simulation, out, workers=workers, scheduler=scheduler, force=force, truth=truth).result
