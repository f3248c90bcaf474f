"""Frames of one sequence: light on the pixels, a camera, and the streams that make every frame reproducible."""

import functools
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np

from cpic_core import FloatArray, InputError, NDArray, PathPart, check_number, check_whole, numeric_context
from simulator.camera import Frame, InfraredCamera, VisibleCamera, camera_keywords, earlier_frames, stack_electrons
from simulator.config import CameraName, Channel, Detector, Instrument, Section
from simulator.detectors import Exposure, PastExposure
from simulator.effects import cosmic_ray_rate, effect_files

Kind = Literal["SCI", "DSF", "CALS", "BIAS", "DARK", "FLAT", "BKG", "LASER"]
Camera: TypeAlias = VisibleCamera | InfraredCamera
MAX_STACK_BYTES = 2_000_000_000
MAX_FRAMES = 1_000_000
MAX_REALISATION = 2**31 - 1


def checked_exposure(exposure_s: float) -> float:
    """Return an exposure in seconds, refused unless it is from 1e-6 to 1e6."""
    if not 1e-6 <= check_number("exposure_s", exposure_s, "s") <= 1e6:
        raise InputError("exposure_s", exposure_s, unit="s", allowed="1e-06 to 1e+06")
    return float(exposure_s)


@dataclass(frozen=True, eq=False)
class Stamps:
    """The central star as it changes during a sequence.

    Attributes
    ----------
    rate_e_s : ndarray
        Mean electrons per second, shape (epochs, side, side).
    rows, columns : slice
        Where the stamps lie on the frame or window.
    part : tuple of slice
        The part of a stamp that lies there.
    """

    rate_e_s: FloatArray
    rows: slice
    columns: slice
    part: tuple[slice, slice]


@dataclass(frozen=True, eq=False)
class Light:
    """Mean electrons per second on the pixels: a part that stays, and stamps of the star that change.

    ``beyond_e_s`` is the light of the frame beyond a window, summed over each of its columns: none of it is on the
    pixels, but it smears into them while the frame is transferred.
    """

    static_e_s: FloatArray
    star: Stamps | None = None
    beyond_e_s: FloatArray | None = None

    @property
    def epochs(self) -> int:
        """Number of different maps."""
        return 1 if self.star is None else len(self.star.rate_e_s)

    def map(self, epoch: int) -> FloatArray:
        """Return the mean electrons per second of one epoch."""
        return self.static_e_s if self.star is None else self._with(self.star, self.star.rate_e_s[epoch])

    def mean(self) -> FloatArray:
        """Return the mean over the epochs."""
        return self.static_e_s if self.star is None else self._with(self.star, self.star.rate_e_s.mean(axis=0))

    def _with(self, star: Stamps, stamp: FloatArray) -> FloatArray:
        whole = self.static_e_s.copy()
        whole[star.rows, star.columns] += stamp[star.part]
        return whole


@dataclass(frozen=True, eq=False)
class Sequence:
    """Frames of one sequence, made one at a time.

    Attributes
    ----------
    kind : str
        Type of the sequence: SCI, DSF, CALS (sky), BIAS, DARK, FLAT, BKG, LASER (calibration).
    band : str
        Band, ``""`` for a visible BIAS or DARK.
    camera : {"VIS", "NIR"}
    light : Light
        Mean electrons per second on the pixels, before the camera.
    first_pixel : tuple of int or None
        Row and column of the frame that a window begins with; None for the whole frame.
    path : tuple
        Names of the random streams. Sequences that differ in nothing that it names (in exposure, gain, roll or
        switches, say) draw common random numbers.
    start_utc : str
        Beginning of the first frame.
    keywords : dict
        Header keywords of whoever made the light.
    """

    kind: Kind
    name: str
    instrument: Instrument
    camera: CameraName
    band: str
    exposure_s: float
    n_frames: int
    em_gain: float
    seed: int
    path: tuple[PathPart, ...]
    start_utc: str
    light: Light
    first_pixel: tuple[int, int] | None
    realisation: int = field(default=0, kw_only=True)
    keywords: dict[str, Any] = field(default_factory=dict)
    _prepared: dict[int, Exposure] = field(default_factory=dict, init=False, repr=False)
    _held_e: dict[int, FloatArray] = field(default_factory=dict, init=False, repr=False)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of a frame."""
        rows, columns = self.light.static_e_s.shape
        return rows, columns

    @property
    def readout_s(self) -> float:
        """Dead time after each frame."""
        return self.channel.detector.readout_s

    @property
    def sections(self) -> dict[str, Section]:
        """Named parts of a whole frame; a window is active pixels only."""
        if self.first_pixel is not None:
            whole = (slice(0, self.shape[0]), slice(0, self.shape[1]))
            return {"active": whole, "image": whole}
        return self.channel.detector.sections

    @property
    def channel(self) -> Channel:
        """Camera of the sequence, as configured."""
        return self.instrument.channel(self.camera)

    @property
    def camera_keywords(self) -> dict[str, Any]:
        """Header keywords of camera and sequence."""
        return {
            "TELESCOP": "CSST",
            "INSTRUME": "CPIC",
            "CAMERA": self.camera,
            "OBSTYPE": self.kind,
            "FILTER": self.band,
            "EXPTIME": self.exposure_s,
            "NFRAME": self.n_frames,
            "EMGAIN": self.em_gain,
            **camera_keywords(self.channel.detector, self.em_gain),
            "SEED": self.seed,
            "REALISAT": self.realisation,
            "CONFHASH": self.instrument.content_hash,
            "OBJECT": self.name,
            "PIXSCALE": self.pixel_scale_arcsec,
        }

    @property
    def pixel_scale_arcsec(self) -> float:
        """Pixel of the camera."""
        return self.channel.pixel_scale_arcsec

    @functools.cached_property
    def camera_chain(self) -> Camera:
        """Camera with the effects that are switched on, and particles at the rate of the date."""
        detector, rays = self.channel.detector, self.instrument.cosmic_rays
        struck = detector.switches.cosmic_rays and self.exposure_s > 0
        rate = cosmic_ray_rate(rays, self.start_utc) if struck else 0.0
        if isinstance(detector, Detector):
            return VisibleCamera(detector, cosmic_rays=rays, cosmic_ray_rate_per_s_cm2=rate)
        return InfraredCamera(detector, cosmic_rays=rays, cosmic_ray_rate_per_s_cm2=rate)

    def prepared(self, rates: FloatArray) -> Exposure:
        """Return the noise-free part of a frame of this sequence under other light.

        Parameters
        ----------
        rates : ndarray
            Mean electrons per second and pixel, of the shape of a frame.
        """
        camera, first = self.camera_chain, self.first_pixel
        if isinstance(camera, InfraredCamera):
            return camera.prepare(rates, self.exposure_s, first_pixel=first)
        beyond_e_s = self.light.beyond_e_s
        return camera.prepare(rates, self.exposure_s, self.em_gain, first_pixel=first, beyond_e_s=beyond_e_s)

    @numeric_context()
    def rate_map(self, index: int) -> FloatArray:
        """Return the mean electrons per second and pixel of frame ``index``, before the camera."""
        return self.light.map(self._epoch(index))

    @functools.cached_property
    @numeric_context()
    def mean_rate_map(self) -> FloatArray:
        """Mean of `rate_map` over the sequence."""
        return self.light.mean()

    @property
    def expected(self) -> FloatArray:
        """Noise-free frame in ADU, averaged over the sequence; without cosmic rays and what earlier frames leave."""
        return self._expected[1]

    @property
    def expected_e(self) -> FloatArray:
        """Noise-free electrons of a frame as the pixels collect them: dark current included, as `expected` else."""
        return self._expected[0]

    @functools.cached_property
    @numeric_context()
    def smear_e(self) -> FloatArray:
        """Mean electrons of a frame that the light of other rows leaves in its pixels while it is transferred."""
        known = self.prepared(self.mean_rate_map).smear_e
        return np.zeros(self.shape) if known is None else known

    @functools.cached_property
    @numeric_context()
    def _expected(self) -> tuple[FloatArray, FloatArray]:
        exposure = self.prepared(self.mean_rate_map)
        camera: Any = self.camera_chain
        return exposure.mean_e, camera.expected_adu(exposure)

    @property
    def calibration_files(self) -> list[str]:
        """Names of the files that sky, particles and camera were read from."""
        light = effect_files(self.instrument, self.band) if self.band else []
        return [*self.channel.detector.maps.values(), *light]

    @numeric_context()
    def frame(self, index: int) -> Frame:
        """Return one noisy frame with its truth; the same whichever frames were made before.

        Parameters
        ----------
        index : int
            Number of the frame, from 0.

        Raises
        ------
        InputError
            If there is no such frame.

        Notes
        -----
        Effects that remember earlier frames, where they are switched on, see the mean charge which those of this
        sequence hold: `simulator.camera.camera.earlier_frames`.
        """
        epoch = self._epoch(index)
        if epoch not in self._prepared:
            self._prepared.clear()
            self._prepared[epoch] = self.prepared(self.light.map(epoch))
        path, past = (*self.path, int(index)), self._past(index)
        return self.camera_chain.expose(self._prepared[epoch], seed=self.seed, path=path, past=past)

    def _epoch(self, index: int) -> int:
        return check_whole("frame", index, 0, self.n_frames - 1) * self.light.epochs // self.n_frames

    def _first_frame(self, epoch: int) -> int:
        """Return the number of the first frame of an epoch of the light."""
        return -(-epoch * self.n_frames // self.light.epochs)

    def _past(self, index: int) -> list[PastExposure]:
        """Return the charge of the frames before one, as far as an effect remembers it."""
        memory_s = self.camera_chain.memory_s
        if memory_s == 0:
            return []
        epochs = range(self._epoch(index), -1, -1)
        edges = ((self._first_frame(epoch), min(self._first_frame(epoch + 1), int(index))) for epoch in epochs)
        return list(
            earlier_frames(
                ((first, end) for first, end in edges if first < index),
                self._mean_charge,
                before=int(index),
                full_well_e=self.channel.detector.full_well_e,
                exposure_s=self.exposure_s,
                readout_s=self.readout_s,
                memory_s=memory_s,
            )
        )

    def _mean_charge(self, index: int) -> FloatArray:
        """Return the mean electrons of a frame, kept for the frames after it."""
        epoch = self._epoch(index)
        if epoch not in self._held_e:
            self._held_e[epoch] = self.prepared(self.light.map(epoch)).mean_e
        return self._held_e[epoch]

    def iter_full_frames(self) -> Iterator[Frame]:
        """Yield the frames one at a time with their truth."""
        for index in range(self.n_frames):
            yield self.frame(index)

    def iter_frames(self) -> Iterator[NDArray[np.uint16]]:
        """Yield the frames one at a time, ADU."""
        for frame in self.iter_full_frames():
            yield frame.adu

    @property
    def frames(self) -> NDArray[np.uint16]:
        """All frames, shape (n_frames, rows, columns).

        Raises
        ------
        InputError
            If they need more than 2 GB; iterate instead.
        """
        size = 2 * self.n_frames * self.shape[0] * self.shape[1]
        if size > MAX_STACK_BYTES:
            allowed = f"{MAX_STACK_BYTES / 1e9:g} GB of frames at once"
            raise InputError("n_frames", self.n_frames, allowed=allowed, hint="use iter_frames()")
        return np.stack(list(self.iter_frames()))

    @numeric_context()
    def stack(self) -> FloatArray:
        """Return the sum of all frames in electrons at the register input, bias off, as one draw per epoch of light.

        The draws are those of no single frame, and, as with those, common to sequences of one ``path``.

        Raises
        ------
        InputError
            If frames can saturate, or an effect is on that does not add up (cosmic rays, non-linearity).
        """
        total, path = np.zeros(self.shape), (*self.path, "stack")
        for epoch in range(self.light.epochs):
            count = self._first_frame(epoch + 1) - self._first_frame(epoch)
            exposure = self.prepared(self.light.map(epoch))
            total += stack_electrons(self.camera_chain, exposure, count, seed=self.seed, path=(*path, epoch))
        return total
