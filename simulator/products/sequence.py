"""What a sequence of frames offers to be written as a product.

Places on the sky of what stands at an offset on the detector.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias, get_args

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, check_number
from simulator.camera import Frame
from simulator.config import AnyDetector, Instrument, Scene, checked_utc
from simulator.target import Source, detector_to_sky

if TYPE_CHECKING:
    from simulator.ledger import EffectRow

Camera: TypeAlias = Literal["VIS", "NIR"]
Kind: TypeAlias = Literal["BIAS", "DARK", "FLAT", "BKG", "LASER", "SCI", "DSF", "CALS"]
SCIENCE_KINDS: tuple[Kind, ...] = ("SCI", "DSF", "CALS")
"""Kinds of the folder ``SCI``; the others lie in ``CAL``."""
MAX_FRAMES = 1_000_000


@dataclass(frozen=True)
class Truth:
    """The point sources that are really there, with their places in the frame counted from 0.

    Attributes
    ----------
    sources : tuple of Source
        The central star first.
    x_pixel, y_pixel : tuple of float
        Column and row of each source.
    """

    sources: tuple[Source, ...]
    x_pixel: tuple[float, ...]
    y_pixel: tuple[float, ...]


class FrameSequence(Protocol):
    """Frames of one exposure sequence of one camera, made one at a time.

    Frame ``i`` begins ``i * (exposure_s + readout_s)`` after ``start_utc`` (ISO 8601). A sequence that has point
    sources says where they are in a further attribute, ``truth`` (`Truth`).
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
    def ledger(self) -> Sequence[EffectRow]:
        """What is modelled and what is left out."""

    @property
    def expected(self) -> FloatArray:
        """Mean ADU of a frame without noise, averaged over the sequence."""

    @property
    def expected_e(self) -> FloatArray:
        """Mean electrons of a frame before the camera."""

    def iter_full_frames(self) -> Iterator[Frame]:
        """Yield the frames one at a time."""


def settings_of(sequence: FrameSequence) -> dict[str, Any]:
    """Return the settings of a sequence as plain values, by name."""
    return {
        "camera": str(sequence.camera),
        "kind": str(sequence.kind),
        "band": str(sequence.band),
        "n_frames": int(sequence.n_frames),
        "exposure_s": float(sequence.exposure_s),
        "readout_s": float(sequence.readout_s),
        "em_gain": float(sequence.em_gain),
        "seed": int(sequence.seed),
        "start_utc": str(sequence.start_utc),
        "roll_deg": float(sequence.roll_deg),
        "shape": [int(side) for side in sequence.shape],
    }


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


def star_deg(sequence: FrameSequence) -> tuple[float, float] | None:
    """Right ascension and declination of the target; None if it has none."""
    star = None if sequence.scene is None else sequence.scene.cstar
    if star is None or star.ra_deg is None or star.dec_deg is None:
        return None
    return float(star.ra_deg), float(star.dec_deg)


Places: TypeAlias = tuple[FloatArray, FloatArray]


def sky_places(sequence: FrameSequence, x_arcsec: ArrayLike, y_arcsec: ArrayLike) -> Places | None:
    """Right ascension and declination at offsets from the target on the detector; None if it has no coordinates.

    Parameters
    ----------
    sequence : FrameSequence
    x_arcsec, y_arcsec : array_like
        Offsets along columns and rows.
    """
    from astropy import units as u
    from astropy.coordinates import offset_by

    star = star_deg(sequence)
    if star is None:
        return None
    separation, angle = detector_to_sky(x_arcsec, y_arcsec, roll_deg=sequence.roll_deg, parity=_parity_of(sequence))
    ra, dec = offset_by(star[0] * u.deg, star[1] * u.deg, angle * u.deg, separation * u.arcsec)
    return np.asarray(ra.to_value("deg")) % 360.0, np.asarray(dec.to_value("deg"))


def pointing_deg(sequence: FrameSequence) -> tuple[float, float] | None:
    """Place on the sky of the centre of the mask; None if the target has no coordinates."""
    offset = [-float(sequence.header.get(key) or 0.0) for key in ("STAROFFX", "STAROFFY")]
    if not any(offset):
        return star_deg(sequence)
    places = sky_places(sequence, *offset)
    return None if places is None else (float(places[0]), float(places[1]))


def _parity_of(sequence: FrameSequence) -> int:
    """Orientation of the detector: that of the world coordinates where they are given."""
    names = ("CD1_1", "CD1_2", "CD2_1", "CD2_2")
    if not all(name in sequence.header for name in names):
        return sequence.instrument.detector.parity
    a, b, c, d = (float(sequence.header[name]) for name in names)
    return 1 if a * d > b * c else -1
