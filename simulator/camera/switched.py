"""The instrument with effects of one camera switched on or off by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from catalogs.errors import InputError
from simulator.config import Instrument

__all__ = ["switched_for"]


def switched_for(
    instrument: Instrument, camera: Literal["VIS", "NIR"], switches: Mapping[str, bool] | None
) -> Instrument:
    """Return the instrument with effects of a camera switched.

    Parameters
    ----------
    instrument : Instrument
    camera : {"VIS", "NIR"}
    switches : mapping of str to bool, optional
        Effects by the name of their switch.

    Raises
    ------
    InputError
        For a name that is no switch of this camera, or a value that is neither true nor false.
    """
    visible = camera == "VIS"
    detector = instrument.detector if visible else instrument.near_infrared.detector
    known = tuple(type(detector.switches).model_fields)
    for name in switches if isinstance(switches, Mapping) else ():
        if name not in known:
            which = "visible" if visible else "near-infrared"
            raise InputError("switches", name, allowed=", ".join(known), hint=f"the switches of the {which} camera")
    return instrument.switched(switches)
