"""Options for how an observation is made and reduced, shared by the commands that predict."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from catalogs.errors import InputError
from cpic_planner.etc.model import EtcModel, Strategy, build_model
from cpic_planner.registry.libraries import LIBRARIES
from simulator.config.base import validate

if TYPE_CHECKING:
    LibraryText: TypeAlias = str
else:
    LibraryText = LIBRARIES.literal()

__all__ = [
    "CountingOption",
    "CountingSigmaOption",
    "ExozodiOption",
    "HiddenCountingOption",
    "LibraryOption",
    "ReferenceRatioOption",
    "ReferenceTeffOption",
    "ReferenceVMagOption",
    "RollOption",
    "imaged_strategy",
    "model_from",
    "refuse_together",
    "strategy_from",
]


LibraryOption: TypeAlias = Annotated[
    LibraryText, typer.Option("--library", help="Where the reference frames of the subtraction come from.")
]
ReferenceVMagOption: TypeAlias = Annotated[
    float | None, typer.Option("--reference-v-mag", help="V magnitude of the star of --library reference_star.")
]
ReferenceTeffOption: TypeAlias = Annotated[
    float | None, typer.Option("--reference-teff-k", help="Temperature of that star [default: 5772].")
]
ReferenceRatioOption: TypeAlias = Annotated[
    float | None,
    typer.Option("--reference-ratio", help="Reference frames per science frame, above 0 [default: 1]."),
]
RollOption: TypeAlias = Annotated[
    float | None, typer.Option("--roll-deg", help="Angle between the two rolls of --library roll [default: 30].")
]
CountingOption: TypeAlias = Annotated[
    bool, typer.Option("--photon-counting", help="Count photons instead of measuring charge (visible camera).")
]
HiddenCountingOption: TypeAlias = Annotated[bool, typer.Option("--photon-counting", hidden=True)]
CountingSigmaOption: TypeAlias = Annotated[
    float | None,
    typer.Option("--counting-sigma", help="Threshold of --photon-counting over the read noise [default: 5]."),
]
ExozodiOption: TypeAlias = Annotated[
    float | None,
    typer.Option("--exozodi", help="Dust around the star, in units of the solar system's [default: 0]."),
]


def refuse_together(options: dict[str, object], why: str) -> None:
    """Refuse two options that contradict each other; ``None`` and ``False`` are not given."""
    given = [name for name, value in options.items() if value is not None and value is not False]
    if len(given) > 1:
        raise InputError(given[0], f"given with {given[1]}", allowed="one of the two", hint=why)


def strategy_from(
    library: str,
    *,
    reference_v_mag: float | None = None,
    reference_teff_k: float | None = None,
    reference_ratio: float | None = None,
    roll_deg: float | None = None,
    photon_counting: bool = False,
    counting_sigma: float | None = None,
) -> Strategy:
    """Strategy from options; those that have no meaning with the others are refused."""
    own = LIBRARIES[library].parameters
    for name, value, needs, there in (
        ("--reference-v-mag", reference_v_mag, _of("reference_star"), "reference_star" in own),
        ("--reference-teff-k", reference_teff_k, _of("reference_star"), "reference_star" in own),
        ("--roll-deg", roll_deg, _of("roll_deg"), "roll_deg" in own),
        ("--counting-sigma", counting_sigma, "--photon-counting", photon_counting),
    ):
        if value is not None and not there:
            raise InputError(name, value, allowed=f"together with {needs}")
    tree: dict[str, Any] = {"library": library}
    if "reference_star" in own:
        if reference_v_mag is None:
            raise InputError(
                "--reference-v-mag",
                "missing",
                allowed="V magnitude of the reference star, -30 to 40 mag",
                hint="--library reference_star needs it",
            )
        tree["reference_star"] = {"v_mag": reference_v_mag} | _given(teff_k=reference_teff_k)
    tree |= _given(reference_ratio=reference_ratio, roll_deg=roll_deg, counting_sigma=counting_sigma)
    if photon_counting:
        tree["mode"] = "photon_counting"
    return validate(Strategy, tree, where="strategy")


def imaged_strategy(
    library: str,
    *,
    reference_v_mag: float | None,
    reference_teff_k: float | None,
    reference_ratio: float | None,
    roll_deg: float | None,
    photon_counting: bool,
) -> Strategy:
    """Strategy of images that are simulated and measured; photon counting is only predicted, and refused here."""
    if photon_counting:
        raise InputError(
            "--photon-counting",
            "given",
            allowed="only with cpic etc",
            hint="photon counting is predicted, not yet measured in images",
        )
    return strategy_from(
        library,
        reference_v_mag=reference_v_mag,
        reference_teff_k=reference_teff_k,
        reference_ratio=reference_ratio,
        roll_deg=roll_deg,
    )


def model_from(
    instrument: str | None, bands: Sequence[str] | None, strategy: Strategy, *, exozodi_zodis: float | None = None
) -> EtcModel:
    """Model from options."""
    from simulator.config import load_instrument

    built = load_instrument(instrument)
    if exozodi_zodis is not None:
        built = built.changed({"sky": {"exozodi_zodis": exozodi_zodis}})
    if strategy.mode == "photon_counting":
        dark = [band for band in bands or () if band in built.bands and band not in built.visible_bands()]
        if dark:
            raise InputError(
                "--photon-counting",
                f"given with --band {dark[0]}",
                allowed="visible bands",
                hint="the near-infrared camera has no gain register",
            )
    return build_model(built, bands, strategy)


def _of(parameter: str) -> str:
    """The choice of library that a parameter belongs to."""
    return f"--library {next(item.name for item in LIBRARIES.values() if parameter in item.parameters)}"


def _given(**values: Any) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}
