"""Fidelity knobs: every setting that trades speed for accuracy, in one frozen object."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
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
        Least number of samples across the pupil: the grid is the next multiple of the steps of apodizer and static
        wavefront, on which the field is exact at any multiple.
    wavelength_nodes : int
        Gauss-Legendre nodes per band.
    pixel_nodes : int
        Gauss nodes per pixel and axis, for the pixel and the pointing jitter together; a jitter above a tenth of
        lambda/D adds some.
    stamp_pixels : int
        Side of the PSF stamps (odd), in detector pixels.
    precision : {"double", "single"}
        Of the field; intensities are always double. Single is faster; what it adds to the field in the hole is below
        1e-15 of the peak in intensity, and beats with the speckles to some 1e-13.
    """

    pupil_samples: Annotated[int, Field(ge=64, le=2048)] = 64
    wavelength_nodes: Annotated[int, Field(ge=1, le=33)] = 4
    pixel_nodes: Annotated[int, Field(ge=1, le=8)] = 4
    stamp_pixels: Annotated[int, Field(ge=33, le=1201)] = 137
    precision: Literal["double", "single"] = "double"

    @property
    def field_dtype(self) -> type[np.complexfloating]:
        """Type of the focal-plane field."""
        return np.complex128 if self.precision == "double" else np.complex64

    @property
    def tier(self) -> str:
        """Name of the tier with these settings, or ``custom``."""
        return next((name for name, knobs in FIDELITIES.items() if knobs == self), "custom")


FIDELITIES: dict[str, Knobs] = {
    "quick": Knobs(wavelength_nodes=1, pixel_nodes=2, precision="single"),
    "standard": Knobs(),
    "reference": Knobs(pupil_samples=256, wavelength_nodes=7, pixel_nodes=5),
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
