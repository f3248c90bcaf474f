"""Frames of one sequence: light on the pixels, a camera, and the streams that make every frame reproducible.

Calibration sequences: bias, dark, flat field, sky background, laser.
"""

import functools
from collections.abc import Iterator, Mapping
from dataclasses import field
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from cpic_core import (
    FloatArray,
    InputError,
    NDArray,
    PathPart,
    Record,
    check_number,
    check_pair,
    check_whole,
    check_word,
    numeric_context,
)
from simulator.camera import Frame, InfraredCamera, VisibleCamera, camera_keywords, earlier_frames, stack_electrons
from simulator.config import (
    MAX_FRAMES,
    CameraName,
    Channel,
    Detector,
    Instrument,
    Scene,
    Section,
    SequenceKind,
    checked_utc,
    declination_deg,
    load_instrument,
    right_ascension_deg,
)
from simulator.detectors import Exposure, PastExposure
from simulator.effects import cosmic_ray_rate, effect_files, sky_rate_e_s_arcsec2, stray_light_parts
from simulator.imaging import single_band_psf, sky_transmission, window_of
from simulator.knobs import Knobs
from simulator.ledger import EffectRow, camera_ledger, sky_ledger
from simulator.target import Source

Camera: TypeAlias = VisibleCamera | InfraredCamera
MAX_STACK_BYTES = 2_000_000_000
MAX_REALISATION = 2**31 - 1


def checked_exposure(exposure_s: float) -> float:
    """Return an exposure in seconds, refused unless it is from 1e-6 to 1e6."""
    if not 1e-6 <= check_number("exposure_s", exposure_s, "s") <= 1e6:
        raise InputError("exposure_s", exposure_s, unit="s", allowed="1e-06 to 1e+06")
    return float(exposure_s)


class Stamps(Record, eq=False):
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


class Light(Record, eq=False):
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


class Truth(Record):
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


class FrameSequence(Record, eq=False):
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
    scene : Scene or None
        What the telescope points at, None for internal calibrations.
    roll_deg : float
        Position angle of the +y axis.
    truth : Truth or None
        The point sources that are there.
    ledger : tuple of EffectRow
        What is modelled and what is left out.
    """

    kind: SequenceKind
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
    scene: Scene | None = field(default=None, kw_only=True)
    roll_deg: float = field(default=0.0, kw_only=True)
    truth: Truth | None = field(default=None, kw_only=True)
    ledger: tuple[EffectRow, ...] = field(default=(), kw_only=True)
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

    @functools.cached_property
    def header(self) -> dict[str, Any]:
        """Keywords of camera and sequence."""
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
            **self.keywords,
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
        return exposure.mean_e, self.camera_chain.expected_adu(exposure)

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


CalibrationKind = Literal["BIAS", "DARK", "FLAT", "BKG", "LASER"]
_NEEDS_BAND = ("FLAT", "BKG", "LASER")
_LASER_ARCSEC = (0.5, 0.5)


class Calibration(FrameSequence, eq=False):
    """Frames of a calibration sequence; made by `calibrate`."""


@numeric_context()
def calibrate(
    kind: CalibrationKind,
    *,
    band: str = "",
    camera: CameraName | None = None,
    exposure_s: float | None = None,
    n_frames: int = 1,
    em_gain: float = 1.0,
    level_e: float | None = None,
    offset_arcsec: tuple[float, float] | None = None,
    ra_deg: float | str | None = None,
    dec_deg: float | str | None = None,
    seed: int = 1,
    realisation: int = 0,
    start_utc: str | None = None,
    instrument: Instrument | Mapping[str, Any] | str | None = None,
    switches: Mapping[str, bool] | None = None,
) -> Calibration:
    """Set up a calibration sequence; frames are drawn when they are asked for.

    Parameters
    ----------
    kind : {"BIAS", "DARK", "FLAT", "BKG", "LASER"}
        Frames without exposure; closed exposures; an evenly lit field; the sky alone; the internal laser as a point
        source at band centre.
    band : str
        Band of FLAT, BKG and LASER; it names the camera.
    camera : {"VIS", "NIR"}, optional
        Camera of BIAS and DARK, the visible one if not given.
    exposure_s : float, optional
        Exposure of a frame, 0 to 1e6 s: 0 for BIAS, which has no other; needed otherwise.
    n_frames : int
        Frames of the sequence, 1 to 1e6.
    em_gain : float
        Actual EM gain, 1 to the detector's maximum; 1 in the near infrared.
    level_e : float, optional
        FLAT: mean electrons of a pixel in one frame (half the full well over the gain if not given). LASER: electrons
        of the whole spot in one frame, before apodizer and mask (ten times the full well over the gain if not given).
    offset_arcsec : tuple of float, optional
        LASER: place of the spot relative to the centre of the mask, x and y, on the stamp of the point-spread function;
        (0.5, 0.5) if not given.
    ra_deg, dec_deg : float or str, optional
        BKG: where the telescope points, as in a scene; needed where ``sky.season`` is ``date``.
    seed, realisation, start_utc, instrument, switches
        As `simulator.observe`.

    Raises
    ------
    InputError
        For anything out of range, and for what a kind has no use for.

    Notes
    -----
    Random numbers depend on ``seed``, ``kind``, camera, ``band``, ``realisation``, the number of the frame and the
    effect, and on nothing else. Sequences that differ only in exposure, gain, level or switches therefore draw common
    random numbers; give each its own ``realisation`` (or ``seed``) where their noise has to be independent.
    """
    check_word("kind", kind, get_args(CalibrationKind))
    config = instrument if isinstance(instrument, Instrument) else load_instrument(instrument)
    for key, value, unit, kinds in (
        ("level_e", level_e, "e-", ("FLAT", "LASER")),
        ("offset_arcsec", offset_arcsec, "arcsec", ("LASER",)),
        ("ra_deg", ra_deg, "deg", ("BKG",)),
        ("dec_deg", dec_deg, "deg", ("BKG",)),
    ):
        if value is not None and kind not in kinds:
            raise InputError(key, value, unit=unit, allowed=f"for {' and '.join(kinds)} only, not for {kind}")
    name = _camera(config, kind, band, camera)
    config = config.switched(switches, camera=name)
    detector = config.channel(name).detector
    exposure = _exposure(kind, exposure_s)
    frames = check_whole("n_frames", n_frames, 1, MAX_FRAMES)
    number = check_whole("realisation", realisation, 0, MAX_REALISATION)
    config.channel(name).check_gain(em_gain)
    start = checked_utc("start_utc", config.mission.start_utc if start_utc is None else start_utc)
    rates = np.zeros((detector.n_rows, detector.n_columns))
    sky_rows: tuple[EffectRow, ...] = ()
    keywords: dict[str, Any] = {"OBJECT": kind}
    if kind == "FLAT":
        level = 0.5 * detector.full_well_e / em_gain if level_e is None else _level(level_e)
        rates += level / exposure
    elif kind == "BKG":
        place = _pointing(ra_deg, dec_deg)
        rates, sky_rows = _background(config, band, place, start)
        if place is not None:
            keywords |= {"RA_OBJ": place[0], "DEC_OBJ": place[1]}
    elif kind == "LASER":
        level = 10.0 * detector.full_well_e / em_gain if level_e is None else _level(level_e)
        rates = _spot(config, band, level / exposure, _LASER_ARCSEC if offset_arcsec is None else offset_arcsec)
    lit = kind in _NEEDS_BAND
    return Calibration(
        kind=kind,
        name=kind,
        instrument=config,
        camera=name,
        band=band,
        exposure_s=exposure,
        n_frames=frames,
        em_gain=float(em_gain),
        seed=seed,
        path=(kind, name, band, number),
        start_utc=start,
        light=Light(rates),
        first_pixel=None,
        realisation=number,
        keywords=keywords,
        ledger=(*sky_rows, *camera_ledger(config, name, lit=lit, exposure_s=exposure, start_utc=start)),
    )


def _camera(instrument: Instrument, kind: str, band: str, camera: str | None) -> CameraName:
    """Return the name of the camera: that of the band, or the one asked for."""
    if not isinstance(band, str) or (kind in _NEEDS_BAND) != bool(band):
        raise InputError("band", band, allowed=f"a band for {', '.join(_NEEDS_BAND)}, none for BIAS and DARK")
    if camera is not None:
        check_word("camera", camera, get_args(CameraName))
    if not band:
        return "NIR" if camera == "NIR" else "VIS"
    own = instrument.band(band).camera
    if camera not in (None, own):
        raise InputError("camera", camera, allowed=f"{own}, the camera of {band}, or none")
    return own


def _exposure(kind: str, exposure_s: float | None) -> float:
    if kind == "BIAS":
        if exposure_s is not None and check_number("exposure_s", exposure_s, "s"):
            raise InputError("exposure_s", exposure_s, unit="s", allowed="0 for BIAS")
        return 0.0
    if exposure_s is None:
        raise InputError("exposure_s", "missing", unit="s", allowed=f"a value is required for {kind}")
    return checked_exposure(exposure_s)


def _level(level_e: float) -> float:
    if not 0 <= check_number("level_e", level_e, "e-") <= 1e12:
        raise InputError("level_e", level_e, unit="e-", allowed="0 to 1e12")
    return float(level_e)


def _pointing(ra_deg: float | str | None, dec_deg: float | str | None) -> tuple[float, float] | None:
    if ra_deg is None and dec_deg is None:
        return None
    for key, value in (("ra_deg", ra_deg), ("dec_deg", dec_deg)):
        if value is None:
            raise InputError(key, "missing", unit="deg", allowed="both coordinates of the pointing, or none")
    return right_ascension_deg(ra_deg), declination_deg(dec_deg)


def _background(
    instrument: Instrument, band: str, place: tuple[float, float] | None, start_utc: str
) -> tuple[FloatArray, tuple[EffectRow, ...]]:
    """Return the sky behind the mask, with what falls on the detector besides, and its ledger."""
    ra_deg, dec_deg = (None, None) if place is None else place
    sky = sky_rate_e_s_arcsec2(instrument, band, ra_deg=ra_deg, dec_deg=dec_deg, start_utc=start_utc)
    psf = single_band_psf(band, instrument=instrument)
    window = window_of(psf, instrument, full=True)
    rates = sky.rate_e_s_arcsec2 * psf.pixel_scale_arcsec**2 * psf.apodizer_energy * sky_transmission(psf, window)
    stray = stray_light_parts(instrument, band, window.shape)
    return rates + sum(stray.values()), sky_ledger(instrument, band=band, sky=sky, stray=stray)


def _spot(instrument: Instrument, band: str, rate_e_s: float, offset_arcsec: tuple[float, float]) -> FloatArray:
    """Return a point source at band centre through the optics."""
    psf = single_band_psf(band, instrument=instrument, fidelity=Knobs(wavelength_nodes=1))
    half = psf.on_axis.shape[0] // 2 * psf.pixel_scale_arcsec
    place = check_pair("offset_arcsec", offset_arcsec, half, "arcsec", why=f"the edge of the stamp of {band}")
    window = window_of(psf, instrument, full=True)
    stamp = psf.at(*place)
    rates = np.zeros(window.shape)
    rows, columns, part = window.stamp(stamp.shape[0])
    rates[rows, columns] = rate_e_s * stamp[part]
    return rates
