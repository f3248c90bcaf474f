"""The only composer: scene + instrument + settings -> frames, with expectation, truth and ledger."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from catalogs.errors import InputError
from simulator.camera.emccd import Frame, expected_adu_map, expose_frame
from simulator.config import Instrument, Scene, load_instrument, load_scene
from simulator.imaging.drift import visit_frames
from simulator.imaging.external import ExternalPsf
from simulator.imaging.frame import (
    AnyPsf,
    SceneModel,
    Window,
    apodizer_energy,
    full_star_map,
    off_axis_light,
    sky_transmission,
    window_of,
)
from simulator.imaging.psf import PsfError, single_band_psf
from simulator.knobs import Knobs
from simulator.ledger import EffectRow, effect_ledger
from simulator.passbands import Passbands
from simulator.quantities import check_number
from simulator.rng import PathPart, stream
from simulator.target.positions import wcs_keywords
from simulator.target.sources import Source, extended_rates, scene_sources

__all__ = ["Observation", "Truth", "observe"]

FloatArray = NDArray[np.float64]
WindowName = Literal["full", "hole"]
Role = Literal["science", "reference", "calibration"]
MAX_STACK_BYTES = 2_000_000_000
MAX_EPOCHS = 12
MAX_OFFSET_ARCSEC = 8.0


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
    window: WindowName
    roll_deg: float
    star_offset_arcsec: tuple[float, float]
    scene_model: SceneModel
    psf: AnyPsf
    area: Window
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
        rows, columns, inside = self.area.stamp(stamp.shape[0])
        whole[rows, columns] += star[inside]
        return whole

    @property
    def expected(self) -> FloatArray:
        """Noise-free frame in ADU."""
        return expected_adu_map(self.mean_rate_map, self.exposure_s, self.em_gain, self.instrument.detector)

    @property
    def estimated_error(self) -> PsfError | None:
        """Numerical error of the point-spread functions; None for those of a file. Takes half a second once."""
        return None if isinstance(self.psf, ExternalPsf) else self.psf.estimated_error

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
            "STAROFFX": self.star_offset_arcsec[0],
            "STAROFFY": self.star_offset_arcsec[1],
            "HOLEMODE": self.instrument.dark_hole.mode,
            "HOLE": self.psf.hole_state,
            "HOLEIN": self.instrument.hole_inner_arcsec(self.band) * math.sqrt(2.0),
            "IWA": self.psf.metrics.iwa_arcsec,
            "FIDELITY": "external" if isinstance(self.psf, ExternalPsf) else self.psf.knobs.tier,
            "SCENEMOD": self.scene_model,
            "SEED": self.seed,
            "CONFHASH": self.instrument.content_hash,
        } | wcs_keywords(
            detector.pixel_scale_arcsec,
            (self.truth.x_pixel[0], self.truth.y_pixel[0]),
            (self.scene.cstar.ra_deg, self.scene.cstar.dec_deg),
            roll_deg=self.roll_deg,
            parity=detector.parity,
        )


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
    window: WindowName = "full",
    star_offset_arcsec: tuple[float, float] = (0.0, 0.0),
    scene_model: SceneModel = "exact",
    psf: ExternalPsf | None = None,
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
        Whole detector, or the stamp around the centre of the mask.
    star_offset_arcsec : tuple of float
        Place of the central star relative to the centre of the mask on the detector, x and y: off the mask for
        calibration. The whole sky moves with it.
    scene_model : {"exact", "paper"}
        ``exact``: every source at its place behind the mask. ``paper``: the shortcut of Zhu et al. 2025, in which
        sources other than the star go to the nearest of 4 x 4 cells of a pixel and no mask hides them.
    psf : ExternalPsf, optional
        Point-spread functions from a file (`simulator.load_psf`) instead of the model's; they do not drift.

    Returns
    -------
    Observation

    Raises
    ------
    InputError
        For anything out of range.

    Notes
    -----
    The random walk of the wavefront is sampled at up to 12 epochs a visit; frames between two epochs share one.
    """
    scene = load_scene(scene)
    instrument = instrument if isinstance(instrument, Instrument) else load_instrument(instrument)
    _check(instrument, band, exposure_s, n_frames, em_gain, tolerance, window, role, roll_deg)
    star = _checked_offset(star_offset_arcsec)
    if scene_model not in get_args(SceneModel):
        raise InputError("scene_model", scene_model, allowed=", ".join(get_args(SceneModel)))
    if psf is not None:
        _check_psf(psf, band, instrument)
    optics = psf or single_band_psf(band, fidelity=fidelity, instrument=instrument)
    sources = scene_sources(scene, instrument, band, roll_deg=roll_deg)
    area = window_of(optics, instrument, full=window == "full")
    path = (scene.name, role, band, realisation)
    stamps = _star_stamps(optics, instrument, exposure_s, n_frames, star, seed, path)
    static = _sky_e_s_pixel(instrument, band) * apodizer_energy(optics) * sky_transmission(optics, area)
    if window == "full":
        static += sources[0].rate_e_s * full_star_map(optics, area, star)
    static += off_axis_light(
        optics,
        area,
        sources[1:],
        extended_rates(scene, instrument, band),
        roll_deg=roll_deg,
        star_arcsec=star,
        model=scene_model,
    )
    pixel = instrument.detector.pixel_scale_arcsec
    truth = Truth(
        sources,
        tuple(area.centre[1] + (source.x_arcsec + star[0]) / pixel for source in sources),
        tuple(area.centre[0] + (source.y_arcsec + star[1]) / pixel for source in sources),
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
        star_offset_arcsec=star,
        scene_model=scene_model,
        psf=optics,
        area=area,
        truth=truth,
        ledger=effect_ledger(scene, instrument, scene_model=scene_model, hole_state=optics.hole_state),
        static_rate_e_s=static,
        star_stamps=stamps,
    )


def _star_stamps(
    optics: AnyPsf,
    instrument: Instrument,
    exposure_s: float,
    n_frames: int,
    star_arcsec: tuple[float, float],
    seed: int,
    path: tuple[PathPart, ...],
) -> FloatArray:
    """Stamps of the unit star at every epoch of the visit."""
    if isinstance(optics, ExternalPsf):
        return (optics.at(*star_arcsec) if any(star_arcsec) else optics.on_axis)[None]
    epochs = min(n_frames, MAX_EPOCHS)
    return visit_frames(
        optics.imager,
        instrument.drift,
        epochs,
        (exposure_s + instrument.detector.readout_s) * n_frames / epochs,
        stream(seed, *path, "visit"),
        stream(seed, *path, "walk"),
        star_arcsec=star_arcsec,
    )


def _sky_e_s_pixel(instrument: Instrument, band: str) -> float:
    """Electrons per second of the uniform sky in an open pixel of a clear aperture."""
    passbands = Passbands.from_instrument(instrument)
    rates = passbands.sky_rate_e_s_arcsec2(instrument.sky.brightness_v_mag_arcsec2, instrument.telescope.area_cm2)
    return float(rates[passbands.index(band)]) * instrument.detector.pixel_scale_arcsec**2


def _check_psf(psf: ExternalPsf, band: str, instrument: Instrument) -> None:
    if not isinstance(psf, ExternalPsf):
        raise InputError("psf", psf, allowed="what load_psf returns")
    if psf.band not in ("", band):
        raise InputError("psf", psf.band, allowed=f"a PSF of {band}")
    if psf.instrument.content_hash != instrument.content_hash:
        raise InputError("psf", psf.instrument.name, allowed=f"a PSF of {instrument.name}: load_psf(..., instrument=)")


def _checked_offset(star_offset_arcsec: tuple[float, float]) -> tuple[float, float]:
    try:
        values = np.asarray(star_offset_arcsec, dtype=np.float64)
    except (TypeError, ValueError):
        values = np.empty(0)
    if values.shape != (2,) or not np.isfinite(values).all() or np.abs(values).max() > MAX_OFFSET_ARCSEC:
        raise InputError("star_offset_arcsec", star_offset_arcsec, unit="arcsec",
                         allowed=f"x and y, each at most {MAX_OFFSET_ARCSEC:g}")  # fmt: skip
    return float(values[0]), float(values[1])


def _check(instrument: Instrument, band: str, exposure_s: Any, n_frames: Any, em_gain: Any, tolerance: Any,
           window: str, role: str, roll_deg: Any) -> None:  # fmt: skip
    if instrument.band(band).camera != "VIS":
        raise InputError("band", band, allowed=", ".join(instrument.visible_bands()), hint="no infrared camera yet")
    most = instrument.detector.em_gain_max
    for name, value, low, high, unit in (("exposure_s", exposure_s, 1e-6, 1e6, "s"), ("em_gain", em_gain, 1, most, "")):
        if not low <= check_number(name, value, unit) <= high:
            raise InputError(name, value, unit=unit, allowed=f"{low:g} to {high:g}")
    count = check_number("n_frames", n_frames)
    if isinstance(n_frames, bool) or not count.is_integer() or not 1 <= count <= 1_000_000:
        raise InputError("n_frames", n_frames, allowed="an integer from 1 to 1000000")
    if check_number("tolerance", tolerance) != 0:
        raise InputError("tolerance", tolerance, allowed="0", hint="trading error for speed is not implemented yet")
    if role not in get_args(Role):
        raise InputError("role", role, allowed=", ".join(get_args(Role)))
    check_number("roll_deg", roll_deg, "deg")
    if window not in get_args(WindowName):
        raise InputError("window", window, allowed=", ".join(get_args(WindowName)))
