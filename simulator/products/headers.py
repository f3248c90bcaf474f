"""Header values of a sequence: what it supplies, what follows from its configuration, what the writer knows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import metadata
from typing import Any

from catalogs.errors import InputError
from simulator.camera.calibration_set import bias_level_adu
from simulator.camera.frame import Frame
from simulator.camera.gain_voltage import em_voltage_of
from simulator.config.detector import Detector, Section
from simulator.products.ephemeris import Ephemeris
from simulator.products.keywords import KeywordTable, Value, checked_value, load_keywords
from simulator.products.naming import ProductName
from simulator.products.places import pointing_deg, star_deg
from simulator.products.sequence import SCIENCE_KINDS, FrameSequence, camera_of
from simulator.products.times import SequenceTimes

__all__ = ["fits_section", "frame_values", "ledger_cards", "sequence_values", "software_version"]

DISTRIBUTION = "cpic-planner"
MAX_ROWS = 999


def software_version() -> str:
    """Version of the installed distribution; ``source`` where it runs without having been installed."""
    try:
        return metadata.version(DISTRIBUTION)
    except metadata.PackageNotFoundError:
        return "source"


def sequence_values(
    sequence: FrameSequence, name: ProductName, times: SequenceTimes, sky: Ephemeris
) -> tuple[dict[str, Value], dict[str, Value]]:
    """Values of the primary header and those that all images share, under the names of the table.

    Keywords that the sequence supplies replace those that follow from its configuration, but not names, times and
    counts, which are the writer's. Supplied keywords that the table does not know go to the images.

    Parameters
    ----------
    sequence : FrameSequence
    name : ProductName
    times : SequenceTimes
    sky : Ephemeris

    Raises
    ------
    InputError
        For a supplied keyword that is not legal, or of the wrong type.
    """
    table = load_keywords()
    supplied = {
        table.canonical(key): checked_value(table, key, value)
        for key, value in sequence.header.items()
        if value is not None
    }
    found = _configured(sequence) | _where(sequence, sky) | supplied | _own(sequence, name, times)
    values = {key: checked_value(table, key, value) for key, value in found.items() if value is not None}
    return _share(table, values, "primary"), _share(table, values, "image")


def _share(table: KeywordTable, values: Mapping[str, Value], hdu: str) -> dict[str, Value]:
    """Values that stand in one kind of unit."""
    homes = {key: table.keywords[key].hdu if key in table.keywords else "image" for key in values}
    return {key: value for key, value in values.items() if homes[key] in (hdu, "both")}


def _own(sequence: FrameSequence, name: ProductName, times: SequenceTimes) -> dict[str, Any]:
    count = int(sequence.n_frames)
    return {
        "FILENAME": name.file.name,
        "TELESCOP": "CSST",
        "INSTRUME": "CPIC",
        "CAMERA": sequence.camera,
        "OBSID": name.obsid,
        "OBSTYPE": sequence.kind,
        "NFRAME": count,
        "NEXTEND": count,
        "TIMESYS": "UTC",
        "DATE-OBS": times.start_utc,
        "DATE-END": times.stop_utc,
        "EXPSTART": float(times.begin_mjd[0]),
        "EXPEND": float(times.end_mjd[-1]),
        "EXPTIME": float(sequence.exposure_s),
        "READTIME": float(sequence.readout_s),
        "INTTIME": count * float(sequence.exposure_s),
        "KEYTABLE": load_keywords().version,
        "BUNIT": "adu",
        "IMG_VER": f"V{name.version:02d}",
        "NEFFECT": len(sequence.ledger),
        "NCALFILE": len(sequence.calibration_files),
    }


def _configured(sequence: FrameSequence) -> dict[str, Any]:
    camera, instrument, scene = camera_of(sequence), sequence.instrument, sequence.scene
    on_sky = sequence.kind in SCIENCE_KINDS
    values: dict[str, Any] = {
        "OBJECT": scene.name if scene is not None else sequence.kind,
        "FILTER": sequence.band or None,
        "SWNAME": DISTRIBUTION,
        "SWVER": software_version(),
        "CONFHASH": instrument.content_hash,
        "SCENHASH": None if scene is None else scene.content_hash,
        "SEED": int(sequence.seed),
        "DMFILE": instrument.dark_hole.surface_files.get(sequence.band),
        "DETNAM": sequence.camera,
        "GAIN": camera.gain_e_adu,
        "RDNOISE": camera.read_noise_e,
        "BIASLEV": bias_level_adu(camera),
        "ADCBITS": camera.adc_bits,
        "FULLWELL": camera.full_well_e,
        "PIXSIZE": camera.pixel_um,
        "PIXSCALE": instrument.pixel_scale_arcsec(sequence.band) if sequence.band else None,
        # The mask is part of the camera: the roll of the telescope does not turn it.
        "MASKROT": 0.0 if on_sky else None,
    }
    if isinstance(camera, Detector):
        setting = em_voltage_of(sequence.em_gain, camera.temperature_k)
        values |= {
            "CCDTEMP": camera.temperature_k,
            "EMGAIN": float(sequence.em_gain),
            "EMVOLT": float(setting.voltage_v),
        }
    for keyword in load_keywords():
        if keyword.section in sequence.sections:
            values[keyword.name] = fits_section(sequence.sections[keyword.section]) or None
    return values


def _where(sequence: FrameSequence, sky: Ephemeris) -> dict[str, Any]:
    """Pointing, state of the telescope, and angles."""
    values: dict[str, Any] = {}
    for end, row in enumerate((0, -1)):
        for axis, letter in enumerate("XYZ"):
            values[f"POSI{end}_{letter}"] = float(sky.position_km[row, axis])
            values[f"VELO{end}_{letter}"] = float(sky.velocity_km_s[row, axis])
        for key, angles in (("SUNANGL", sky.sun_deg), ("MOONANG", sky.moon_deg), ("TEL_ALT", sky.limb_deg)):
            if angles is not None:
                values[f"{key}{end}"] = float(angles[row])
    if sequence.scene is None:
        return values
    star, pointing = star_deg(sequence), pointing_deg(sequence)
    if star is not None and pointing is not None:
        values |= {"RA_OBJ": star[0], "DEC_OBJ": star[1], "RADESYS": "ICRS", "EQUINOX": 2000.0}
        for end in (0, 1):
            values |= {f"RA_PNT{end}": pointing[0], f"DEC_PNT{end}": pointing[1]}
    if "CTYPE1" in sequence.header:
        values["WCSAXES"] = 2
    return values | {"POS_ANG0": sequence.roll_deg % 360.0, "POS_ANG1": sequence.roll_deg % 360.0}


def frame_values(shared: Mapping[str, Value], index: int, times: SequenceTimes, frame: Frame) -> dict[str, Value]:
    """Values of one image: those that all share, and its own times and counts.

    Parameters
    ----------
    shared : mapping of str to Value
        Header values that all images of the file share.
    index : int
        Number of the frame, from 0.
    times : SequenceTimes
    frame : Frame
    """
    return {
        **shared,
        "FRAMEID": index + 1,
        "EXPBEG": float(times.begin_mjd[index]),
        "EXPEND": float(times.end_mjd[index]),
        "NSAT": int(frame.n_saturated_pixels),
        "NREGSAT": int(frame.n_register_saturated),
        "NCLIP": int(frame.n_clipped),
        "NCR": int(frame.n_cosmic_rays),
        "NNEGRATE": int(frame.n_negative_rates),
    }


def ledger_cards(sequence: FrameSequence) -> Iterator[tuple[str, Value, str]]:
    """Numbered cards of the effect ledger, ``kept | effect | reason | size``, and of the calibration maps.

    The size is the predicted one, where there is one.

    Raises
    ------
    InputError
        If there are more of either than three digits count.
    """
    table = load_keywords()
    sizes = ["" if row.size is None else f" | {row.size:.3g}" for row in sequence.ledger]
    texts = [
        f"{row.decision} | {row.effect} | {row.reason}{size}" for row, size in zip(sequence.ledger, sizes, strict=True)
    ]
    for what, key, rows in (("ledger", "EFF", texts), ("calibration_files", "CALF", sequence.calibration_files)):
        if len(rows) > MAX_ROWS:
            raise InputError(what, len(rows), allowed=f"at most {MAX_ROWS} rows")
        for number, text in enumerate(rows, start=1):
            yield f"{key}{number:03d}", checked_value(table, "OBJECT", text), ""


def fits_section(section: Section) -> str:
    """Return ``"[c1:c2,r1:r2]"``, one-based and inclusive as in FITS headers; ``""`` for a section of no pixels."""
    rows, columns = section
    if rows.stop <= rows.start or columns.stop <= columns.start:
        return ""
    return f"[{columns.start + 1}:{columns.stop},{rows.start + 1}:{rows.stop}]"
