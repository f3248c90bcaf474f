"""One camera of the instrument with what is in front of it: what differs between the channels, said once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from catalogs.errors import InputError
from simulator.config.detector import AnyDetector, Detector
from simulator.config.optics import Coronagraph, NearInfrared
from simulator.quantities import check_number

CameraName = Literal["VIS", "NIR"]


@dataclass(frozen=True)
class Channel:
    """One camera and its optics.

    Attributes
    ----------
    name : {"VIS", "NIR"}
    words : str
        Name for people.
    section : str
        Dotted key of the configuration that holds its optics.
    detector : Detector or InfraredDetector
    optics : Coronagraph or NearInfrared
        Edges of cross mask and dark hole.
    pixel_scale_arcsec : float
    exposure_max_s : float
        Longest exposure of a frame.
    """

    name: CameraName
    words: str
    section: str
    detector: AnyDetector
    optics: Coronagraph | NearInfrared
    pixel_scale_arcsec: float
    exposure_max_s: float

    @property
    def multiplies(self) -> bool:
        """Whether the camera has a multiplication register, and all that comes with charge transfer."""
        return isinstance(self.detector, Detector)

    @property
    def switches(self) -> tuple[str, ...]:
        """Names of the switches of the effects of the camera."""
        return tuple(type(self.detector.switches).model_fields)

    def check_gain(self, em_gain: float) -> None:
        """Refuse a gain that the camera does not have.

        Raises
        ------
        InputError
            Unless it is a number from 1 to the largest gain of the detector.
        """
        if not 1 <= check_number("em_gain", em_gain) <= self.detector.em_gain_max:
            allowed = f"1 to {self.detector.em_gain_max:g}" if self.multiplies else "1 in the near infrared"
            raise InputError("em_gain", em_gain, allowed=allowed)
