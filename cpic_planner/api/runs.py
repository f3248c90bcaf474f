"""Plans, confirmations and simulated products, by star names and plain numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cpic_planner.api.inputs import InstrumentSource, OnOff, model_of, stars_named
from cpic_planner.etc.planet import ReferencePlanet
from cpic_planner.models import ConfirmedTarget, PlanResult, SimulationResult
from simulator.config import Instrument, load_instrument
from simulator.config.base import validate

if TYPE_CHECKING:
    from cpic_planner.simulation.inputs import SimulationInput

__all__ = ["confirm_targets", "make_plan", "simulate_products"]


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
        As `cpic_planner.plan.make_plan`.
    instrument : Instrument, mapping, str or Path, optional
    **settings
        Fields of `cpic_planner.plan.PlanConfig`: ``top``, ``bands``, ``time_s``, ``planet``, ``seed`` ...

    Returns
    -------
    PlanResult
    """
    from cpic_planner.plan import PlanConfig
    from cpic_planner.plan import make_plan as run

    chosen = instrument if isinstance(instrument, Instrument) else load_instrument(instrument)
    config = validate(PlanConfig, {"instrument": chosen} | settings, where="plan")
    return run(config, out, catalog=catalog, workers=workers, scheduler=scheduler, force=force).plan


def confirm_targets(
    target: str | Sequence[str],
    *,
    time_s: float = 36000.0,
    bands: Sequence[str] | None = None,
    planet: ReferencePlanet | None = None,
    companions: OnOff = "on",
    catalog: str | Path = "snapshot",
    instrument: InstrumentSource = None,
    seed: int = 1,
    fidelity: str = "standard",
    workers: int = 1,
) -> list[ConfirmedTarget]:
    """Simulate and measure the named stars, each with its reference planet at the best separation.

    Returns
    -------
    list of ConfirmedTarget
        In the given order.
    """
    from cpic_planner.plan import confirm_stars

    model = model_of(instrument, bands)
    return confirm_stars(
        model,
        stars_named(target, companions, catalog),
        time_s=time_s,
        planet=planet or ReferencePlanet(),
        seed=seed,
        fidelity=fidelity,
        workers=workers,
    )


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
        As `cpic_planner.simulation.run.simulate`.
    instrument : Instrument, mapping, str or Path, optional
    frames, seed, fidelity, switches, start_utc : optional
        For all sequences that have a use for them; those of a simulation are replaced.
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

    changes = {"frames": frames, "seed": seed, "fidelity": fidelity, "switches": switches, "start_utc": start_utc}
    simulation, _ = simulation_from(
        what if isinstance(what, list | tuple) else [what],
        settings=settings,
        changes={key: value for key, value in changes.items() if value is not None},
        instrument=instrument,
    )
    return simulate(simulation, out, workers=workers, scheduler=scheduler, force=force, truth=truth).result
