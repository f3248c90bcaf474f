"""Calibration sequences: bias, dark, flat field, sky background, laser."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np

from catalogs.errors import InputError
from simulator.config import Instrument, load_instrument
from simulator.config.mission import checked_utc
from simulator.effects.sky import sky_rate_e_s_arcsec2
from simulator.effects.stray_light import stray_light_map
from simulator.imaging.frame import apodizer_energy, sky_transmission, window_of
from simulator.imaging.psf import single_band_psf
from simulator.knobs import Knobs
from simulator.ledger import EffectRow, camera_ledger
from simulator.quantities import check_number
from simulator.sequence import FloatArray, Light, Sequence

__all__ = ["Calibration", "calibrate"]

CalibrationKind = Literal["BIAS", "DARK", "FLAT", "BKG", "LASER"]
_NEEDS_BAND = ("FLAT", "BKG", "LASER")


@dataclass(frozen=True, eq=False)
class Calibration(Sequence):
    """Frames of a calibration sequence; made by `calibrate`."""

    ledger: tuple[EffectRow, ...] = field(kw_only=True)

    scene: None = field(default=None, init=False)
    roll_deg: float = field(default=0.0, init=False)

    @property
    def header(self) -> dict[str, Any]:
        """Keywords of the sequence."""
        return self.camera_keywords | self.keywords


def calibrate(
    kind: CalibrationKind,
    *,
    band: str = "",
    camera: Literal["VIS", "NIR"] = "VIS",
    exposure_s: float | None = None,
    n_frames: int = 1,
    em_gain: float = 1.0,
    level_e: float | None = None,
    offset_arcsec: tuple[float, float] = (0.5, 0.5),
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
    camera : {"VIS", "NIR"}
        Camera of BIAS and DARK.
    exposure_s : float, optional
        Exposure of a frame, 0 to 1e6 s: 0 for BIAS, which has no other; needed otherwise.
    n_frames : int
        Frames of the sequence, 1 to 1e6.
    em_gain : float
        Actual EM gain, 1 to the detector's maximum; 1 in the near infrared.
    level_e : float, optional
        FLAT: mean electrons of a pixel in one frame (half the full well over the gain if not given). LASER: electrons
        of the whole spot in one frame, before apodizer and mask (ten times the full well over the gain if not given).
    offset_arcsec : tuple of float
        LASER: place of the spot relative to the centre of the mask, x and y.
    seed, realisation, start_utc, instrument, switches
        As `simulator.observe`.

    Raises
    ------
    InputError
        For anything out of range, and for what a kind has no use for.
    """
    if kind not in get_args(CalibrationKind):
        raise InputError("kind", kind, allowed=", ".join(get_args(CalibrationKind)))
    config = instrument if isinstance(instrument, Instrument) else load_instrument(instrument)
    config = config.switched(switches)
    if (kind in _NEEDS_BAND) != bool(band):
        raise InputError("band", band, allowed=f"a band for {', '.join(_NEEDS_BAND)}, none for BIAS and DARK")
    if level_e is not None and kind not in ("FLAT", "LASER"):
        raise InputError("level_e", level_e, unit="e-", allowed="for FLAT and LASER only")
    name = config.band(band).camera if band else camera
    if name not in ("VIS", "NIR"):
        raise InputError("camera", camera, allowed="VIS, NIR")
    detector = config.detector if name == "VIS" else config.near_infrared.detector
    exposure = _exposure(kind, exposure_s)
    count = check_number("n_frames", n_frames)
    if isinstance(n_frames, bool) or not count.is_integer() or not 1 <= count <= 1_000_000:
        raise InputError("n_frames", n_frames, allowed="an integer from 1 to 1000000")
    most = config.detector.em_gain_max if name == "VIS" else 1.0
    if not 1 <= check_number("em_gain", em_gain) <= most:
        raise InputError("em_gain", em_gain, allowed=f"1 to {most:g}")
    start = checked_utc("start_utc", config.mission.start_utc if start_utc is None else start_utc)
    rates = np.zeros((detector.n_rows, detector.n_columns))
    if kind == "FLAT":
        level = 0.5 * detector.full_well_e / em_gain if level_e is None else _level(level_e)
        rates += level / exposure
    elif kind == "BKG":
        rates = _background(config, band, start)
    elif kind == "LASER":
        level = 10.0 * detector.full_well_e / em_gain if level_e is None else _level(level_e)
        rates = _spot(config, band, level / exposure, offset_arcsec)
    return Calibration(
        kind=kind,
        name=kind,
        instrument=config,
        camera=name,
        band=band,
        exposure_s=exposure,
        n_frames=int(n_frames),
        em_gain=float(em_gain),
        seed=seed,
        path=(kind, name, band, realisation),
        start_utc=start,
        light=Light(rates),
        first_pixel=None,
        keywords={"OBJECT": kind},
        ledger=camera_ledger(config, name),
    )


def _exposure(kind: str, exposure_s: float | None) -> float:
    if kind == "BIAS":
        if exposure_s:
            raise InputError("exposure_s", exposure_s, unit="s", allowed="0 for BIAS")
        return 0.0
    if exposure_s is None:
        raise InputError("exposure_s", "missing", unit="s", allowed=f"a value is required for {kind}")
    if not 1e-6 <= check_number("exposure_s", exposure_s, "s") <= 1e6:
        raise InputError("exposure_s", exposure_s, unit="s", allowed="1e-06 to 1e+06")
    return float(exposure_s)


def _level(level_e: float) -> float:
    if not 0 <= check_number("level_e", level_e, "e-") <= 1e12:
        raise InputError("level_e", level_e, unit="e-", allowed="0 to 1e12")
    return float(level_e)


def _background(instrument: Instrument, band: str, start_utc: str) -> FloatArray:
    psf = single_band_psf(band, instrument=instrument)
    window = window_of(psf, instrument, full=True)
    sky = sky_rate_e_s_arcsec2(instrument, band, start_utc=start_utc)
    rates = sky.rate_e_s_arcsec2 * psf.pixel_scale_arcsec**2 * apodizer_energy(psf) * sky_transmission(psf, window)
    stray = stray_light_map(instrument, band, window.shape)
    return rates if stray is None else rates + stray


def _spot(instrument: Instrument, band: str, rate_e_s: float, offset_arcsec: tuple[float, float]) -> FloatArray:
    """A point source at band centre through the optics."""
    place = np.asarray(offset_arcsec, dtype=np.float64)
    if place.shape != (2,) or not np.isfinite(place).all() or np.abs(place).max() > 8:
        raise InputError("offset_arcsec", offset_arcsec, unit="arcsec", allowed="x and y, each at most 8")
    psf = single_band_psf(band, instrument=instrument, fidelity=Knobs(wavelength_nodes=1))
    window = window_of(psf, instrument, full=True)
    stamp = psf.at(float(place[0]), float(place[1]))
    rates = np.zeros(window.shape)
    rows, columns, part = window.stamp(stamp.shape[0])
    rates[rows, columns] = rate_e_s * stamp[part]
    return rates
