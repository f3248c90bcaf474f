"""The public functions of the planner, by star names and plain numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from cpic_planner.etc import questions
from cpic_planner.etc.answer import EtcAnswer
from cpic_planner.etc.model import EtcModel, build_model
from cpic_planner.etc.planet import ReferencePlanet
from cpic_planner.models import ConfirmedTarget, PlanResult, RankResult, SimulationResult
from cpic_planner.targets import Targets, as_catalogue, find_target, rank_sample, sample_text
from simulator.config import Instrument, load_instrument
from simulator.config.base import validate

if TYPE_CHECKING:
    import pandas as pd

    from cpic_planner.simulation.inputs import SimulationInput

__all__ = [
    "confirm_targets",
    "contrast_limit",
    "exposure_time",
    "make_plan",
    "optimise",
    "rank_targets",
    "signal_to_noise",
    "simulate_products",
]

InstrumentSource = Instrument | Mapping[str, Any] | str | Path | None
OnOff = Literal["on", "off"]


def _model(instrument: InstrumentSource, bands: Sequence[str] | None) -> EtcModel:
    return build_model(instrument if isinstance(instrument, Instrument) else load_instrument(instrument), bands)


def _named(names: str | Sequence[str], companions: OnOff, catalog: str | Path) -> list[Targets]:
    table = as_catalogue(catalog)
    listed = [names] if isinstance(names, str) else names
    return [find_target(name, companions=companions, catalog=table)[0] for name in listed]


def _ask(
    question: Callable[..., list[EtcAnswer]],
    target: str | Sequence[str],
    bands: Sequence[str] | None,
    companions: OnOff,
    catalog: str | Path,
    instrument: InstrumentSource,
    **asked: Any,
) -> list[EtcAnswer]:
    """Put one question for every named star."""
    model = _model(instrument, bands)
    if isinstance(asked.get("planet"), Mapping):
        asked["planet"] = validate(ReferencePlanet, asked["planet"], where="planet")
    return [answer for star in _named(target, companions, catalog) for answer in question(model, star, **asked)]


def signal_to_noise(
    target: str | Sequence[str],
    *,
    time_s: float,
    separation_arcsec: float,
    bands: Sequence[str] | None = None,
    companions: OnOff = "on",
    catalog: str | Path = "snapshot",
    instrument: InstrumentSource = None,
    **planet_and_frame: Any,
) -> list[EtcAnswer]:
    """SNR of a planet in a given wall time.

    Parameters
    ----------
    target : str or sequence of str
        Star name(s).
    time_s : float
        Wall time of one visit, overheads and reference frames included.
    separation_arcsec : float
        Projected separation, on the diagonal of a quadrant.
    bands : sequence of str, optional
        All visible bands by default.
    companions : {"on", "off"}
        Whether the light of known stellar companions counts.
    catalog : str or Path
        Star table: ``"snapshot"``, ``"latest"`` (see ``cpic catalog refresh``) or a CSV, ECSV, VOTable or FITS file.
    instrument : Instrument, mapping, str or Path, optional
        What `simulator.load_instrument` reads.
    **planet_and_frame
        ``planet`` (a `ReferencePlanet`) or ``contrast``; ``exposure_s`` and ``em_gain`` to fix them. As
        `cpic_planner.etc.questions.signal_to_noise`.

    Returns
    -------
    list of EtcAnswer
        Targets in the given order, bands by wavelength within each.

    Raises
    ------
    InputError
        For an unknown star, band or a value out of range.

    Examples
    --------
    >>> from cpic_planner import signal_to_noise
    >>> answer = signal_to_noise("tau Cet", time_s=36000, separation_arcsec=0.5, bands=["F520"])[0]
    >>> answer.status.value
    'ok'
    """
    asked = {"time_s": time_s, "separation_arcsec": separation_arcsec} | planet_and_frame
    return _ask(questions.signal_to_noise, target, bands, companions, catalog, instrument, **asked)


def exposure_time(
    target: str | Sequence[str],
    *,
    snr: float,
    separation_arcsec: float,
    bands: Sequence[str] | None = None,
    companions: OnOff = "on",
    catalog: str | Path = "snapshot",
    instrument: InstrumentSource = None,
    **planet_and_frame: Any,
) -> list[EtcAnswer]:
    """Least wall time of one visit that reaches an SNR; parameters, returns and errors as `signal_to_noise`."""
    asked = {"snr": snr, "separation_arcsec": separation_arcsec} | planet_and_frame
    return _ask(questions.exposure_time, target, bands, companions, catalog, instrument, **asked)


def contrast_limit(
    target: str | Sequence[str],
    *,
    time_s: float,
    separation_arcsec: float,
    bands: Sequence[str] | None = None,
    sigma: float | None = None,
    companions: OnOff = "on",
    catalog: str | Path = "snapshot",
    instrument: InstrumentSource = None,
    **frame: Any,
) -> list[EtcAnswer]:
    """Faintest contrast detected in a given wall time; parameters, returns and errors as `signal_to_noise`.

    ``sigma`` asks for a plain significance instead of the small-sample threshold.
    """
    asked = {"time_s": time_s, "separation_arcsec": separation_arcsec, "sigma": sigma} | frame
    return _ask(questions.contrast_limit, target, bands, companions, catalog, instrument, **asked)


def optimise(
    target: str | Sequence[str],
    *,
    time_s: float = 36000.0,
    bands: Sequence[str] | None = None,
    planet: ReferencePlanet | None = None,
    companions: OnOff = "on",
    catalog: str | Path = "snapshot",
    instrument: InstrumentSource = None,
) -> pd.DataFrame:
    """Best band, separation, exposure, number of frames and EM gain per target.

    Returns
    -------
    pandas.DataFrame
        One row per target; columns of `cpic_planner.optimiser.Best`, units in their names.
    """
    import pandas as pd

    from cpic_planner.optimiser import optimise as best_of

    model = _model(instrument, bands)
    rows = []
    for star in _named(target, companions, catalog):
        best = best_of(model, star, time_s=time_s, planet=planet)
        rows.append(
            {"name": str(star.name[0])} | {item.name: np.asarray(getattr(best, item.name))[0] for item in fields(best)}
        )
    return pd.DataFrame(rows)


def rank_targets(
    *,
    time_s: float = 36000.0,
    bands: Sequence[str] | None = None,
    planet: ReferencePlanet | None = None,
    companions: OnOff = "on",
    catalog: str | Path = "snapshot",
    instrument: InstrumentSource = None,
    v_mag_max: float | None = None,
    dwarfs_only: bool = False,
    singles_only: bool = False,
) -> RankResult:
    """Analytic ranking of the catalogue; see `cpic_planner.ranking.rank_targets` and `cpic_planner.load_targets`."""
    from cpic_planner.ranking import rank_targets as rank

    table = as_catalogue(catalog)
    targets = rank_sample(
        catalog=table, v_mag_max=v_mag_max, dwarfs_only=dwarfs_only, singles_only=singles_only, companions=companions
    )
    return rank(
        _model(instrument, bands),
        targets,
        time_s=time_s,
        planet=planet,
        sample=sample_text(table, v_mag_max, dwarfs_only, singles_only),
        catalogue=table.provenance,
    )


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

    model = _model(instrument, bands)
    return confirm_stars(
        model,
        _named(target, companions, catalog),
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
