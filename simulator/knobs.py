"""Fidelity knobs: every setting that trades speed for accuracy, in one frozen object."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from catalogs.errors import InputError
from simulator.config.base import FrozenModel

__all__ = ["FIDELITIES", "Fidelity", "Knobs", "resolve_knobs"]

Fidelity = Literal["quick", "standard", "reference"]


class Knobs(FrozenModel):
    """Numerical settings of the image chain.

    Attributes
    ----------
    pupil_samples : int
        Samples across the pupil grid; a multiple of the 64 steps of the apodizer.
    wavelength_nodes : int
        Gauss-Legendre nodes per band.
    pixel_nodes : int
        Gauss-Legendre nodes per pixel and axis.
    stamp_pixels : int
        Side of the PSF stamps (odd), in detector pixels.
    """

    pupil_samples: Annotated[int, Field(ge=64, le=2048, multiple_of=64)] = 128
    wavelength_nodes: Annotated[int, Field(ge=1, le=33)] = 3
    pixel_nodes: Annotated[int, Field(ge=1, le=8)] = 2
    stamp_pixels: Annotated[int, Field(ge=33, le=1201)] = 137


FIDELITIES: dict[str, Knobs] = {
    "quick": Knobs(pupil_samples=64, wavelength_nodes=1, pixel_nodes=1),
    "standard": Knobs(),
    "reference": Knobs(pupil_samples=256, wavelength_nodes=5, pixel_nodes=4),
}


def resolve_knobs(fidelity: str | Knobs) -> Knobs:
    """Knobs of a named tier, or the knobs themselves.

    Raises
    ------
    InputError
        If the name is not one of ``quick``, ``standard``, ``reference``.
    """
    if isinstance(fidelity, Knobs):
        return fidelity
    if fidelity not in FIDELITIES:
        raise InputError("fidelity", fidelity, allowed="quick, standard, reference or a Knobs object")
    return FIDELITIES[fidelity]
