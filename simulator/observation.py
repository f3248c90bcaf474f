"""The only composer: scene + instrument + settings -> frames, with expectation, truth and ledger."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from catalogs.errors import InputError
from simulator.camera.emccd import Frame, expected_adu_map, expose_frame
from simulator.config import Instrument, Scene, load_instrument, load_scene
from simulator.imaging.drift import visit_frames
from simulator.imaging.frame import full_stamp, full_star_map, sky_transmission
from simulator.imaging.psf import Psf, single_band_psf
from simulator.knobs import Knobs
from simulator.ledger import EffectRow, effect_ledger
from simulator.passbands import Passbands
from simulator.rng import PathPart, stream
from simulator.target.sources import Source, scene_sources

__all__ = ["Observation", "Truth", "observe"]

FloatArray = NDArray[np.float64]
Window = Literal["full", "hole"]
Role = Literal["science", "reference", "calibration"]
MAX_STACK_BYTES = 2_000_000_000
MAX_EPOCHS = 24


@dataclass(frozen=True)
class Truth:
    """What is really there: sources with pixel positions (column, row) in the frame."""

    sources: tuple[Source, ...]
    x_pixel: tuple[float, ...]
    y_pixel: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Observation:
    """Frames of one sequence, made one at a time; made by `observe`.

    Attributes
    ----------
    window : {"full", "hole"}
        Whole detector, or the square stamp around the star that holds the dark hole.
    expected : ndarray
        Mean ADU of a frame, averaged over the drift of the visit.
    truth : Truth
    ledger : tuple of EffectRow
    header : dict
    """

    scene: Scene
    instrument: Instrument
    band: str
    exposure_s: float
    n_frames: int
    em_gain: float
    seed: int
    role: Role
    realisation: int
    window: Window
    roll_deg: float
    psf: Psf
    truth: Truth
    ledger: tuple[EffectRow, ...]
    static_rate_e_s: FloatArray
    star_stamps: FloatArray

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of a frame."""
        return self.static_rate_e_s.shape[0], self.static_rate_e_s.shape[1]

    def rate_map(self, index: int) -> FloatArray:
        """Mean electrons per second and pixel of frame ``index``, before the camera."""
        if not 0 <= index < self.n_frames:
            raise InputError("frame", index, allowed=f"0 to {self.n_frames - 1}")
        epoch = index * len(self.star_stamps) // self.n_frames
        return self._with_star(self.star_stamps[epoch])

    @functools.cached_property
    def mean_rate_map(self) -> FloatArray:
        """Mean of `rate_map` over the visit."""
        return self._with_star(self.star_stamps.mean(axis=0))

    def _with_star(self, stamp: FloatArray) -> FloatArray:
        star = self.truth.sources[0].rate_e_s * stamp
        if self.window == "hole":
            return self.static_rate_e_s + star
        whole = self.static_rate_e_s.copy()
        rows, columns, inside = _stamp_slices(self.instrument, stamp.shape[0])
        whole[rows, columns] += star[inside]
        return whole

    @property
    def expected(self) -> FloatArray:
        """Noise-free frame in ADU."""
        return expected_adu_map(self.mean_rate_map, self.exposure_s, self.em_gain, self.instrument.detector)

    @property
    def path(self) -> tuple[PathPart, ...]:
        """Path of this sequence's random streams."""
        return (self.scene.name, self.role, self.band, self.realisation)

    def frame(self, index: int) -> Frame:
        """One noisy frame with its bookkeeping; the same whichever frames were made before."""
        rate = self.rate_map(index)
        return expose_frame(
            rate,
            self.exposure_s,
            self.em_gain,
            self.instrument.detector,
            seed=self.seed,
            path=(*self.path, index),
        )

    def iter_frames(self) -> Iterator[NDArray[np.uint16]]:
        """Yield the frames one at a time, ADU."""
        for index in range(self.n_frames):
            yield self.frame(index).adu

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
            raise InputError(
                "n_frames",
                self.n_frames,
                allowed=f"{MAX_STACK_BYTES / 1e9:g} GB of frames at once",
                hint="use iter_frames()",
            )
        return np.stack(list(self.iter_frames()))

    @property
    def header(self) -> dict[str, Any]:
        """Keywords of the sequence."""
        detector = self.instrument.detector
        return {
            "TELESCOP": "CSST",
            "INSTRUME": "CPIC",
            "OBJECT": self.scene.name,
            "FILTER": self.band,
            "ROLE": self.role,
            "EXPTIME": self.exposure_s,
            "NFRAME": self.n_frames,
            "EMGAIN": self.em_gain,
            "GAIN": detector.gain_e_adu,
            "RDNOISE": detector.read_noise_e,
            "BIASLEV": detector.bias_adu,
            "PIXSCALE": detector.pixel_scale_arcsec,
            "ROLL": self.roll_deg,
            "SEED": self.seed,
            "CONFHASH": self.instrument.content_hash,
        }


def _stamp_slices(instrument: Instrument, side: int) -> tuple[slice, slice, tuple[slice, slice]]:
    """Where a star-centred stamp lies on the detector, and the part of it that does."""
    detector, half = instrument.detector, side // 2
    rows = slice(max(detector.star_row - half, 0), min(detector.star_row + half + 1, detector.n_rows))
    columns = slice(max(detector.star_column - half, 0), min(detector.star_column + half + 1, detector.n_columns))
    inside = (
        slice(rows.start - detector.star_row + half, rows.stop - detector.star_row + half),
        slice(columns.start - detector.star_column + half, columns.stop - detector.star_column + half),
    )
    return rows, columns, inside


def observe(
    scene: Scene | Mapping[str, Any] | str | Path,
    *,
    band: str,
    exposure_s: float,
    n_frames: int = 1,
    em_gain: float = 1.0,
    seed: int = 1,
    fidelity: str | Knobs = "standard",
    tolerance: float = 0.0,
    roll_deg: float = 0.0,
    instrument: Instrument | Mapping[str, Any] | str | None = None,
    role: Role = "science",
    realisation: int = 0,
    window: Window = "full",
) -> Observation:
    """Set up a simulated sequence; frames are drawn when they are asked for.

    Parameters
    ----------
    scene : Scene, mapping, str or Path
        The scene, or what `simulator.load_scene` reads: ``"paper_example"``, ``"my_scene.yaml"``.
    band : str
        Band of the visible camera.
    exposure_s : float
        Exposure of a frame, 1e-6 to 1e6 s.
    n_frames : int
        Frames of the sequence, 1 to 1e6.
    em_gain : float
        Actual EM gain, 1 to the detector's maximum.
    seed : int
        Seed of every random number.
    fidelity : str or Knobs
        Accuracy of the optics.
    tolerance : float
        Error that may be traded for speed; only 0 (model everything that exists) is implemented.
    roll_deg : float
        Turns sky and sources on the detector, never mask, hole or speckles.
    instrument : Instrument, mapping or str, optional
        What `simulator.load_instrument` reads; the default instrument otherwise.
    role : {"science", "reference", "calibration"}
        Names the visit: each has its own wavefront offset and its own noise.
    realisation : int
        Number of the noise realisation.
    window : {"full", "hole"}
        Whole detector, or the stamp around the star.

    Returns
    -------
    Observation

    Raises
    ------
    InputError
        For anything out of range.

    Notes
    -----
    The random walk of the wavefront is sampled at up to 24 epochs a visit; frames between two epochs share one.
    """
    scene = load_scene(scene)
    instrument = instrument if isinstance(instrument, Instrument) else load_instrument(instrument)
    _check(instrument, band, exposure_s, n_frames, em_gain, tolerance, window, role, roll_deg)
    psf = single_band_psf(band, fidelity=fidelity, instrument=instrument)
    sources = scene_sources(scene, instrument, band, roll_deg=roll_deg)
    detector = instrument.detector
    cadence = exposure_s + detector.readout_s
    epochs = min(n_frames, MAX_EPOCHS)
    path = (scene.name, role, band, realisation)
    stamps = visit_frames(
        psf.imager,
        instrument.drift,
        epochs,
        cadence * n_frames / epochs,
        stream(seed, *path, "visit"),
        stream(seed, *path, "walk"),
    )
    side = psf.on_axis.shape[0]
    static = np.zeros((side, side)) if window == "hole" else np.zeros((detector.n_rows, detector.n_columns))
    passbands = Passbands.from_instrument(instrument)
    sky = float(
        passbands.sky_rate_e_s_arcsec2(instrument.sky.brightness_v_mag_arcsec2, instrument.telescope.area_cm2)[
            passbands.index(band)
        ]
    )
    sky *= detector.pixel_scale_arcsec**2 * psf.metrics.apodizer_energy
    if window == "hole":
        static += sky * sky_transmission(psf)
        for source in sources[1:]:
            static += source.rate_e_s * psf.at(source.x_arcsec, source.y_arcsec)
    else:
        static += sky * sky_transmission(psf, instrument)
        static += sources[0].rate_e_s * full_star_map(psf, instrument)
        for source in sources[1:]:
            static += source.rate_e_s * full_stamp(psf, instrument, source.x_arcsec, source.y_arcsec)
    centre = (side // 2, side // 2) if window == "hole" else (detector.star_column, detector.star_row)
    truth = Truth(
        sources,
        tuple(centre[0] + source.x_arcsec / detector.pixel_scale_arcsec for source in sources),
        tuple(centre[1] + source.y_arcsec / detector.pixel_scale_arcsec for source in sources),
    )
    return Observation(
        scene=scene,
        instrument=instrument,
        band=band,
        exposure_s=float(exposure_s),
        n_frames=int(n_frames),
        em_gain=float(em_gain),
        seed=seed,
        role=role,
        realisation=realisation,
        window=window,
        roll_deg=roll_deg,
        psf=psf,
        truth=truth,
        ledger=effect_ledger(scene, instrument),
        static_rate_e_s=static,
        star_stamps=stamps,
    )


def _check(
    instrument: Instrument,
    band: str,
    exposure_s: float,
    n_frames: int,
    em_gain: float,
    tolerance: float,
    window: str,
    role: str,
    roll_deg: float,
) -> None:
    if instrument.band(band).camera != "VIS":
        raise InputError(
            "band", band, allowed=", ".join(instrument.visible_bands()), hint="no near-infrared camera yet"
        )
    if not 1e-6 <= exposure_s <= 1e6:
        raise InputError("exposure_s", exposure_s, unit="s", allowed="1e-6 to 1e6")
    if isinstance(n_frames, bool) or not float(n_frames).is_integer() or not 1 <= n_frames <= 1_000_000:
        raise InputError("n_frames", n_frames, allowed="an integer from 1 to 1000000")
    if not 1.0 <= em_gain <= instrument.detector.em_gain_max:
        raise InputError("em_gain", em_gain, allowed=f"1 to {instrument.detector.em_gain_max:g}")
    if tolerance != 0:
        raise InputError("tolerance", tolerance, allowed="0", hint="trading error for speed is not implemented yet")
    if role not in ("science", "reference", "calibration"):
        raise InputError("role", role, allowed="science, reference, calibration")
    if not math.isfinite(roll_deg):
        raise InputError("roll_deg", roll_deg, unit="deg", allowed="a finite angle")
    if window not in ("full", "hole"):
        raise InputError("window", window, allowed="full, hole")
