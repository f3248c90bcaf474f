"""Calibration sequences: bias, dark, flat field, sky background, laser."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np

from cpic_core import FloatArray, InputError, check_number, check_pair, check_whole, check_word, numeric_context
from simulator.config import CameraName, Instrument, checked_utc, declination_deg, load_instrument, right_ascension_deg
from simulator.effects import sky_rate_e_s_arcsec2, stray_light_parts
from simulator.imaging import single_band_psf, sky_transmission, window_of
from simulator.knobs import Knobs
from simulator.ledger import EffectRow, camera_ledger, sky_ledger
from simulator.observing.sequence import MAX_FRAMES, MAX_REALISATION, Light, Sequence, checked_exposure

CalibrationKind = Literal["BIAS", "DARK", "FLAT", "BKG", "LASER"]
_NEEDS_BAND = ("FLAT", "BKG", "LASER")
_LASER_ARCSEC = (0.5, 0.5)


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
