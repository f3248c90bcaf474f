"""The effects of both cameras in their order, and what the program derives from them.

A new effect is one line here, at its place in the chain.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from pydantic import create_model

from simulator.config.base import FrozenModel
from simulator.detectors.collection import Blooming, CosmicRayHits, InfraredPhotonNoise, PhotonNoise, PixelNonlinearity
from simulator.detectors.effect import Effect
from simulator.detectors.infrared import (
    InfraredHits,
    InfraredReadNoise,
    InterpixelCapacitance,
    Persistence,
    PixelCurve,
    ResetNoise,
)
from simulator.detectors.pixels import BadColumns, BadPixels, Dark, DarkStructure, Flat, InfraredDark
from simulator.detectors.readout import BiasDrift, Interference, Quantisation, ReadNoise, Stripes
from simulator.detectors.register import OutputNonlinearity, Register, RegisterClockCharge, RegisterFullWell
from simulator.detectors.transfer import ClockCharge, ParallelTransfer, SerialTransfer, Smear
from simulator.signal.variance import FrameTerm

Chain = tuple[Effect, ...]

VISIBLE: Chain = (
    PhotonNoise(),
    Flat(),
    Dark(),
    DarkStructure(),
    BadPixels(),
    BadColumns(),
    Smear(),
    CosmicRayHits(),
    PixelNonlinearity(),
    Blooming(),
    ParallelTransfer(),
    ClockCharge(),
    SerialTransfer(),
    Register(),
    RegisterClockCharge(),
    RegisterFullWell(),
    OutputNonlinearity(),
    ReadNoise(),
    Stripes(),
    Interference(),
    BiasDrift(),
    Quantisation(),
)
INFRARED: Chain = (
    InfraredPhotonNoise(),
    Flat(),
    InfraredDark(),
    DarkStructure(),
    BadPixels(),
    InfraredHits(),
    Persistence(),
    PixelCurve(),
    InterpixelCapacitance(),
    ResetNoise(),
    InfraredReadNoise(),
    Quantisation(),
)


def rows_of(chain: Chain) -> Iterator[Effect]:
    """Yield the effects of a chain that have a row in the ledger: one a switch."""
    return (effect for effect in chain if effect.label)


def switched(chain: Chain) -> tuple[str, ...]:
    """Return the names of the switches of a chain."""
    return tuple(effect.switch for effect in rows_of(chain) if not effect.fixed)


def in_sums(chain: Chain, *fates: str) -> tuple[str, ...]:
    """Return the switches of effects that sums of frames treat in one of some ways; see `Effect.in_sums`."""
    return tuple(effect.switch for effect in rows_of(chain) if effect.in_sums in fates)


def added_variance(detector: Any, exposure_s: float | None = None) -> dict[str, FrameTerm]:
    """Return the variance that a pixel of one frame has besides that of its light, by term of the budget of noise.

    Parameters
    ----------
    detector : Detector or InfraredDetector
        Effects that are switched off add nothing.
    exposure_s : float, optional
        Exposure of the frame; one that has room for all reads of the detector if not given.
    """
    terms: dict[str, FrameTerm] = {}
    for effect in detector.chain:
        added = effect.added(detector, exposure_s) if effect.on(detector) else FrameTerm()
        if any(added):
            terms[effect.budget_term] = FrameTerm.total([terms.get(effect.budget_term, FrameTerm()), added])
    return terms


def noise_terms() -> dict[str, Effect]:
    """Return the effects that add variance, by their term in budgets of noise: their words and colours there."""
    found: dict[str, Effect] = {}
    for effect in (*VISIBLE, *INFRARED):
        if type(effect).added is not Effect.added:
            found.setdefault(effect.budget_term, effect)
    return found


def chain_preset(chain: Chain) -> dict[str, Any]:
    """Return the defaults that effects of a chain bring with them, as in the file of an instrument under a detector."""
    tree: dict[str, Any] = {"switches": {}}
    for effect in chain:
        for key, value in effect.preset.items():
            tree[key] = {**tree.get(key, {}), **value} if key == "switches" else value
    return tree


class Switches(FrozenModel):
    """Every effect of a camera can be left out; what is left out leaves the numbers of the others as they are."""

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> bool: ...


def switches_model(name: str, module: str, chain: Chain) -> type[Switches]:
    """Return the model of the switches of a chain.

    Parameters
    ----------
    name, module : str
        Name of the class, and of the module that holds it.
    chain : tuple of Effect
    """
    fields: Any = dict.fromkeys(switched(chain), (bool, ...))
    return create_model(name, __base__=Switches, __module__=module, __doc__=Switches.__doc__, **fields)


def numbers_model(name: str, module: str, chain: Chain) -> type[FrozenModel]:
    """Return the model of the settings that effects of a chain bring with them, by the names of their switches.

    Parameters
    ----------
    name, module : str
        Name of the class, and of the module that holds it.
    chain : tuple of Effect
    """
    own: Any = {effect.switch: (effect.settings, ...) for effect in chain if effect.settings is not None}
    return create_model(name, __base__=FrozenModel, __module__=module, **own)
