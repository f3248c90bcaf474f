"""Options of the commands that make images and measure them, handed over once for all of them.

A command takes one parameter ``images: ImageOptions``; `takes_images` puts an option for each of its fields there.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, get_type_hints

import typer

from catalogs.errors import InputError
from cpic_planner.cli.options import (
    BandOption,
    FidelityOption,
    ForceOption,
    InstrumentOption,
    JsonOption,
    RealisationsOption,
    SeedOption,
    Tier,
    ToleranceOption,
)
from cpic_planner.cli.override_option import SimulatorOverridesOption, overrides_from
from cpic_planner.cli.strategy_options import (
    HiddenCountingOption,
    LibraryOption,
    ReferenceRatioOption,
    ReferenceTeffOption,
    ReferenceVMagOption,
    RollOption,
    imaged_strategy,
    refuse_together,
)
from cpic_planner.jobs.engine import check_address
from cpic_planner.registry.libraries import DEFAULT_LIBRARY

if TYPE_CHECKING:
    from simulator.config import Instrument

__all__ = ["DIAL_HELP", "ImageOptions", "renamed", "takes_images"]

DIAL_HELP = """Speed against accuracy is one dial. --fidelity standard (the default) draws sums of frames where that is
allowed and one realisation frame by frame; quick is coarser and checks nothing frame by frame; reference leaves nothing
out: whole frames, one by one, in every realisation. --tolerance 0.02 picks for each scene the cheapest settings that
are predicted to keep planet flux and SNR within 2 % of the reference. Results state what was left out and what that is
predicted to cost; a tier that is not good enough for a scene says so in place of an answer. --dry-run tells the
time."""
"""Paragraph for the help of commands that have the dial."""

WorkersOption: TypeAlias = Annotated[int, typer.Option("--workers", min=1, max=256, help="Local worker processes.")]
SchedulerOption: TypeAlias = Annotated[
    str | None, typer.Option("--scheduler", callback=check_address, help="Dask scheduler, tcp://host:port.")
]
DryRunOption: TypeAlias = Annotated[bool, typer.Option("--dry-run", help="Estimate time, memory and disk, then stop.")]


@dataclass(frozen=True)
class ImageOptions:
    """What decides images and how they are run, as options; one field each."""

    bands: BandOption = None
    library: LibraryOption = DEFAULT_LIBRARY
    reference_v_mag: ReferenceVMagOption = None
    reference_teff_k: ReferenceTeffOption = None
    reference_ratio: ReferenceRatioOption = None
    roll_deg: RollOption = None
    photon_counting: HiddenCountingOption = False
    instrument: InstrumentOption = None
    realisations: RealisationsOption = None
    simulator_overrides: SimulatorOverridesOption = None
    fidelity: FidelityOption = None
    tolerance: ToleranceOption = None
    seed: SeedOption = 1
    workers: WorkersOption = 1
    scheduler: SchedulerOption = None
    force: ForceOption = False
    dry_run: DryRunOption = False
    as_json: JsonOption = False

    def config_tree(self, nominal: Instrument) -> dict[str, Any]:
        """Fields of `cpic_planner.confirmed.ImageConfig`, refused in one line where they contradict each other.

        Parameters
        ----------
        nominal : Instrument
            What ``instrument`` names.
        """
        refuse_together({"--tolerance": self.tolerance, "--fidelity": self.fidelity}, "they are two names of one dial")
        strategy = imaged_strategy(
            self.library,
            reference_v_mag=self.reference_v_mag,
            reference_teff_k=self.reference_teff_k,
            reference_ratio=self.reference_ratio,
            roll_deg=self.roll_deg,
            photon_counting=self.photon_counting,
        )
        given = {
            "bands": tuple(self.bands) if self.bands else None,
            "realisations": self.realisations,
            "fidelity": None if self.fidelity is None else Tier(self.fidelity).value,
            "tolerance": self.tolerance,
        }
        return {
            "instrument": nominal,
            "strategy": strategy,
            "simulator_overrides": overrides_from(self.simulator_overrides, nominal),
            "seed": self.seed,
        } | {name: value for name, value in given.items() if value is not None}


def takes_images(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command an option for every field of `ImageOptions` in place of its parameter ``images``."""
    hints = get_type_hints(ImageOptions, include_extras=True)
    names = [field.name for field in dataclasses.fields(ImageOptions)]
    shared = [
        inspect.Parameter(
            field.name, inspect.Parameter.KEYWORD_ONLY, default=field.default, annotation=hints[field.name]
        )
        for field in dataclasses.fields(ImageOptions)
    ]

    @functools.wraps(command)
    def with_options(**given: Any) -> None:
        images = ImageOptions(**{name: given.pop(name) for name in names})
        command(**given, images=images)

    signature = inspect.signature(command, eval_str=True)
    own = [
        parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY)
        for name, parameter in signature.parameters.items()
        if name != "images"
    ]
    with_options.__signature__ = signature.replace(parameters=[*own, *shared])  # type: ignore[attr-defined]
    return with_options


def renamed(error: InputError, where: str, options: dict[str, str]) -> InputError:
    """A refusal of a configuration that names the option which gave the value.

    Parameters
    ----------
    error : InputError
    where : str
        What keys of the configuration begin with.
    options : dict
        Option by key.
    """
    key = error.key.removeprefix(f"{where}.").split(".")[0]
    if key not in options:
        return error
    return InputError(options[key], error.value, unit=error.unit, allowed=error.allowed, hint=error.hint)
