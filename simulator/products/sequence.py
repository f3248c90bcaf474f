"""What a sequence of frames offers to be written as a product."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal, Protocol, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from catalogs.errors import InputError
from simulator.camera.frame import Frame
from simulator.config import Instrument, Scene
from simulator.config.detector import AnyDetector
from simulator.config.mission import checked_utc
from simulator.quantities import check_number
from simulator.target.sources import Source

__all__ = [
    "SCIENCE_KINDS",
    "Camera",
    "FrameSequence",
    "Kind",
    "LedgerRow",
    "SourceTruth",
    "camera_of",
    "check_sequence",
]

Camera: TypeAlias = Literal["VIS", "NIR"]
Kind: TypeAlias = Literal["BIAS", "DARK", "FLAT", "BKG", "LASER", "SCI", "DSF", "CALS"]
SCIENCE_KINDS: tuple[Kind, ...] = ("SCI", "DSF", "CALS")
"""Kinds of the folder ``SCI``; the others lie in ``CAL``."""
MAX_FRAMES = 1_000_000


class LedgerRow(Protocol):
    """One effect: kept or skipped, and why."""

    @property
    def effect(self) -> str:
        """Name of the effect."""

    @property
    def decision(self) -> str:
        """``kept`` or ``skipped``."""

    @property
    def reason(self) -> str:
        """Why, or by which law."""

    @property
    def key(self) -> str:
        """Name for programs."""

    @property
    def size(self) -> float | None:
        """Predicted size on what was asked for, None where none was worked out."""


class SourceTruth(Protocol):
    """The point sources that are really there, with their places in the frame counted from 0."""

    @property
    def sources(self) -> tuple[Source, ...]:
        """The central star first."""

    @property
    def x_pixel(self) -> tuple[float, ...]:
        """Column of each source."""

    @property
    def y_pixel(self) -> tuple[float, ...]:
        """Row of each source."""


class FrameSequence(Protocol):
    """Frames of one exposure sequence of one camera, made one at a time.

    Frame ``i`` begins ``i * (exposure_s + readout_s)`` after ``start_utc`` (ISO 8601). A sequence that has point
    sources says where they are in a further attribute, ``truth`` (`SourceTruth`).
    """

    @property
    def camera(self) -> Camera:
        """Which camera took it."""

    @property
    def kind(self) -> Kind:
        """What was observed."""

    @property
    def band(self) -> str:
        """Name of the band, empty where no light falls on the detector."""

    @property
    def n_frames(self) -> int:
        """Number of frames."""

    @property
    def exposure_s(self) -> float:
        """Exposure of a frame."""

    @property
    def em_gain(self) -> float:
        """Actual gain of the multiplication register, 1 without one."""

    @property
    def readout_s(self) -> float:
        """Dead time after each frame."""

    @property
    def seed(self) -> int:
        """Seed of every random number."""

    @property
    def start_utc(self) -> str:
        """Begin of the first exposure."""

    @property
    def roll_deg(self) -> float:
        """Position angle of the +y axis."""

    @property
    def instrument(self) -> Instrument:
        """The whole configuration."""

    @property
    def scene(self) -> Scene | None:
        """What the telescope points at, None for internal calibrations."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of a frame."""

    @property
    def header(self) -> Mapping[str, Any]:
        """Keywords that the sequence supplies."""

    @property
    def sections(self) -> Mapping[str, tuple[slice, slice]]:
        """Rows and columns of the parts of the frame, by name."""

    @property
    def calibration_files(self) -> Sequence[str]:
        """Names of the external calibration maps that were used."""

    @property
    def ledger(self) -> Sequence[LedgerRow]:
        """What is modelled and what is left out."""

    @property
    def expected(self) -> NDArray[np.float64]:
        """Mean ADU of a frame without noise, averaged over the sequence."""

    @property
    def expected_e(self) -> NDArray[np.float64]:
        """Mean electrons of a frame before the camera."""

    def iter_full_frames(self) -> Iterator[Frame]:
        """Yield the frames one at a time."""


def camera_of(sequence: FrameSequence) -> AnyDetector:
    """Configuration of the camera that took a sequence."""
    return sequence.instrument.channel(sequence.camera).detector


def check_sequence(sequence: FrameSequence) -> None:
    """Refuse a sequence that has no name or time of its own, before any frame is made.

    Raises
    ------
    InputError
        Naming the attribute.
    """
    for name, allowed in (("camera", get_args(Camera)), ("kind", get_args(Kind))):
        if getattr(sequence, name) not in allowed:
            raise InputError(name, getattr(sequence, name), allowed=", ".join(allowed))
    count = check_number("n_frames", sequence.n_frames)
    if not count.is_integer() or not 1 <= count <= MAX_FRAMES:
        raise InputError("n_frames", sequence.n_frames, allowed=f"an integer from 1 to {MAX_FRAMES}")
    for name in ("exposure_s", "readout_s"):
        if check_number(name, getattr(sequence, name), "s") < 0:
            raise InputError(name, getattr(sequence, name), unit="s", allowed="at least 0")
    checked_utc("start_utc", sequence.start_utc)
    if len(sequence.shape) != 2 or min(sequence.shape) < 1:
        raise InputError("shape", sequence.shape, unit="px", allowed="rows and columns, each at least 1")
