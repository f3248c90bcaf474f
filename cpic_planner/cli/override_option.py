"""``--simulator-overrides``: images of an instrument worse than the one that the prediction knows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from cpic_planner.cli.output import note

if TYPE_CHECKING:
    from cpic_planner.overrides import SimulatorOverrides
    from simulator.config import Instrument

__all__ = ["OVERRIDES_HELP", "SimulatorOverridesOption", "overrides_from"]

SimulatorOverridesOption: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--simulator-overrides",
        metavar="KEY=VALUE",
        help="Alter the simulator alone, as throughput=x0.7, companions=on or detector.cic_e=0.05; repeat for several. "
        "Or a YAML file.",
    ),
]

OVERRIDES_HELP = """What if reality is worse than the model? --simulator-overrides alters the images and nothing else:
the prediction keeps the nominal instrument, and the report says by how much it was off. KEY is a dotted key of the
instrument's file (* stands for any name) or a short one: throughput, quantum_efficiency, read_noise, dark_current,
clock_charge, drift, visit_drift, walk, jitter, exozodi; and companions (on, off). VALUE is a number with a unit
(0.1nm), a factor on the present value (x0.7), a number alone where the dotted key ends in its unit or the quantity has
none, or a word. Short names always need a unit or an x: drift=x2 doubles the offset of a visit and the walk within it;
drift=0.1nm makes the offset 0.1 nm rms and scales the walk in the same ratio.

  --simulator-overrides throughput=x0.7

  --simulator-overrides read_noise=x1.5 --simulator-overrides visit_drift=x3

  --simulator-overrides companions=on

  --simulator-overrides bands.F850.qe=0.4 --simulator-overrides detector.switches.cosmic_rays=off

  --simulator-overrides reality.yaml"""
"""Paragraph for the help of commands that have the option."""


def overrides_from(given: list[str] | None, nominal: Instrument) -> SimulatorOverrides:
    """Overrides from the option, refused in one line where the instrument cannot have them.

    Parameters
    ----------
    given : list of str or None
        What stands behind each ``--simulator-overrides``.
    nominal : Instrument
        Instrument of the prediction.

    Raises
    ------
    InputError
        For an unknown key, a value out of range, or a key given twice.
    """
    from cpic_planner.overrides import SimulatorOverrides

    overrides = SimulatorOverrides.of(given, nominal)
    overrides.instrument(nominal)
    if overrides.alters_optics:
        note("the optics of the simulator are altered: they are computed anew, once, up to a minute a band")
    return overrides
