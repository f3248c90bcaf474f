"""Fidelity knobs: every setting that trades speed for accuracy, in one frozen object.

Albedos that depend on how strongly the star shines on the planet, and the models around a point of their grids.
"""

import itertools
import math
from typing import Annotated, Any, Literal, cast, get_args

import numpy as np
from pydantic import Field

from catalogs import Albedo, bracket
from cpic_core import ArrayLike, InputError, Record, check_number, real_array
from simulator.config import FrozenModel

Fidelity = Literal["quick", "standard", "reference"]
Quantity = Literal["planet_flux", "snr", "pixel_map"]
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)


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
    "quick": Knobs(wavelength_nodes=2, pixel_nodes=2, precision="single"),
    "standard": Knobs(),
    "reference": Knobs(pupil_samples=256, wavelength_nodes=7, pixel_nodes=5),
}


def resolve_knobs(fidelity: str | Knobs) -> Knobs:
    """Return the knobs of a named tier, or the knobs themselves.

    Raises
    ------
    InputError
        If the name is not one of ``quick``, ``standard``, ``reference``.
    """
    if isinstance(fidelity, Knobs):
        return fidelity
    if not isinstance(fidelity, str) or fidelity not in FIDELITIES:
        raise InputError("fidelity", fidelity, allowed="quick, standard, reference or a Knobs object")
    return FIDELITIES[fidelity]


TOLERANCES: dict[Fidelity, dict[Quantity, float]] = {
    "quick": {"planet_flux": 0.05, "snr": 0.05, "pixel_map": 0.05},
    "standard": {"planet_flux": 0.01, "snr": 0.03, "pixel_map": 0.03},
    "reference": {"planet_flux": 0.0, "snr": 0.0, "pixel_map": 0.0},
}
MAX_TOLERANCE = 0.5


def checked_tolerance(tolerance: Any) -> float:
    """Return a tolerance from 0 to 0.5.

    Raises
    ------
    InputError
        If it is none.
    """
    value = check_number("tolerance", tolerance)
    if not 0.0 <= value <= MAX_TOLERANCE:
        raise InputError("tolerance", tolerance, allowed=f"0 to {MAX_TOLERANCE:g}")
    return value


class Dial(FrozenModel):
    """One setting of speed against accuracy; made by `dial_of`.

    Attributes
    ----------
    fidelity : {"quick", "standard", "reference", "custom"}
        A named tier, or ``custom`` where a tolerance was given.
    tolerance : dict
        Largest relative error of each quantity that may be traded for speed; 0 leaves nothing out.
    knobs : Knobs or None
        Of the tier; None where each scene gets the cheapest that meet the tolerance.
    """

    fidelity: Literal["quick", "standard", "reference", "custom"]
    tolerance: dict[Quantity, float]
    knobs: Knobs | None

    def of(self, *quantities: Quantity) -> "Dial":
        """Return the same dial for some quantities alone."""
        return self.model_copy(update={"tolerance": {name: self.tolerance[name] for name in quantities}})


def dial_of(fidelity: str | None = None, tolerance: float | None = None) -> Dial:
    """Return the dial at a named tier (``standard`` without any) or at a tolerance.

    Parameters
    ----------
    fidelity : {"quick", "standard", "reference"}, optional
    tolerance : float, optional
        Largest relative error of planet flux and SNR, 0 to 0.5. At 0 it is the reference.

    Raises
    ------
    InputError
        If both are given, the name is unknown, or the tolerance is out of range.
    """
    if tolerance is None:
        name = "standard" if fidelity is None else fidelity
        knobs = resolve_knobs(name)
        tier = cast(Fidelity, name)
        return Dial(fidelity=tier, tolerance=TOLERANCES[tier], knobs=knobs)
    if fidelity is not None:
        raise InputError("tolerance", tolerance, allowed="without fidelity", hint="they are two names of one dial")
    if checked_tolerance(tolerance) == 0:
        return Dial(fidelity="reference", tolerance=TOLERANCES["reference"], knobs=FIDELITIES["reference"])
    return Dial(fidelity="custom", tolerance=dict.fromkeys(QUANTITIES, float(tolerance)), knobs=None)


class AlbedoFamily(Record, eq=False):
    """Albedos of one kind of planet at several insolations, linear in albedo over ln(insolation distance).

    Linear in albedo, so that band integrals of the nodes, made once, serve any number of planets.

    Attributes
    ----------
    insolation_au : ndarray, shape (k,)
        Increasing distances from the Sun of equal insolation; beyond the ends the end itself holds (`outside`).
    wavelength_nm : ndarray, shape (n,)
    albedo : ndarray, shape (k, n)
    documented_to_nm : float
        Beyond this wavelength the albedo is extrapolated.
    """

    insolation_au: np.ndarray
    wavelength_nm: np.ndarray
    albedo: np.ndarray
    documented_to_nm: float

    def corners(self, insolation_au: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Return the two neighbouring nodes of each distance and their weights, both of shape (..., 2).

        Raises
        ------
        InputError
            If a distance is not a finite number above 0.
        """
        return bracket(np.log(self.insolation_au), np.log(_positive(insolation_au)))

    def outside(self, insolation_au: ArrayLike) -> np.ndarray:
        """Return True where a distance lies beyond the nodes and the albedo of the end is used."""
        distance = _positive(insolation_au)
        result: np.ndarray = (distance < self.insolation_au[0]) | (distance > self.insolation_au[-1])
        return result

    def at(self, insolation_au: float) -> Albedo:
        """Return the albedo at one insolation distance."""
        nodes, weights = self.corners(float(insolation_au))
        albedo = weights @ self.albedo[nodes]
        albedo.setflags(write=False)
        return Albedo(self.wavelength_nm, albedo, self.documented_to_nm)


def _positive(insolation_au: ArrayLike) -> np.ndarray:
    distance = real_array("insolation_au", insolation_au, "au")
    good = (distance > 0.0) & np.isfinite(distance)
    if not np.all(good):
        bad = float(distance[~good].flat[0])
        raise InputError("insolation_au", bad, unit="au", allowed="a finite distance above 0")
    return distance


# A logarithm that went through a text file or a power of ten is still the node it was.
_SAME = 1e-9


def model_corners(
    fsed: np.ndarray, metals_log10: np.ndarray, log10_mh: float, log10_fsed: float | None, models: str
) -> list[tuple[int, int, float]]:
    """Return the nodes (f_sed, metallicity) around a point and their weights, linear over both logarithms.

    Parameters
    ----------
    fsed, metals_log10 : ndarray
        Increasing nodes; f_sed 0 is cloud-free.
    log10_mh : float
        Metallicity.
    log10_fsed : float or None
        Sedimentation efficiency, None for a cloud-free planet; above the last node, that.
    models : str
        Whose nodes they are, for refusals.

    Raises
    ------
    InputError
        For a point beyond the nodes.
    """
    metals = _bracket("log10_mh", metals_log10, log10_mh, f"the models of {models}")
    free = int(np.count_nonzero(fsed == 0.0))
    if log10_fsed is None:
        if not free:
            raise InputError("log10_fsed", None, allowed=f"a number: {models} has no cloud-free models")
        clouds = [(0, 1.0)]
    else:
        if fsed.size == free:
            raise InputError("log10_fsed", log10_fsed, allowed=f"null: {models} has no cloudy models")
        nodes = np.log10(fsed[free:])
        words = f"the models of {models}, or null for a cloud-free planet"
        found = _bracket("log10_fsed", nodes, min(log10_fsed, float(nodes[-1])), words)
        clouds = [(index + free, weight) for index, weight in found]
    return [(fsed, metal, a * b) for (fsed, a), (metal, b) in itertools.product(clouds, metals)]


def _bracket(name: str, nodes: np.ndarray, value: float, words: str) -> list[tuple[int, float]]:
    """Return the neighbouring nodes of a value and their weights; a node alone where the value is one."""
    near = np.flatnonzero(np.abs(nodes - value) <= _SAME)
    if near.size:
        return [(int(near[0]), 1.0)]
    if not (math.isfinite(value) and nodes[0] < value < nodes[-1]):
        raise InputError(name, value, allowed=f"{nodes[0]:.4g} to {nodes[-1]:.4g}, {words}")
    ends, weights = bracket(nodes, value)
    return list(zip(ends.tolist(), weights.tolist(), strict=True))
