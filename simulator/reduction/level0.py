"""Level-0 files of any writer, frame by frame, with the numbers of the camera that took them."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import field
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import BoolArray, FloatArray, InputError, Record
from simulator.config import SKY_KINDS, Detector, Instrument, Section
from simulator.products.keywords import load_keywords
from simulator.products.sequence import ProductName
from simulator.products.write import read_section
from simulator.reduction.level1 import fits_units, named_header

KINDS = (*SKY_KINDS, "BIAS", "DARK", "FLAT", "BKG", "LASER")
_SAME_EXPOSURE = 1e-3
_NUMBERS = {"GAIN": "gain_e_adu", "RDNOISE": "read_noise_e", "BIASLEV": "bias_adu", "FULLWELL": "full_well_e"}
_OWN = ("FRAMEID", "EXPBEG", "EXPEND")


class Level0(Record, eq=False):
    """A sequence of raw frames of the visible camera.

    Attributes
    ----------
    path : Path
    kind : str
        SCI, DSF, CALS, BIAS, DARK, FLAT, BKG or LASER.
    header : mapping
        Keywords of the primary unit and of the first image, by the names of the table of keywords.
    planes : tuple of (int, int)
        Unit and plane of every frame; -1 for units of two axes.
    shape : tuple of int
    exposure_s, em_gain : float
    detector : Detector
        That of the instrument with the numbers of the header.
    sections : mapping of str to Section
        Parts of the frame; ``active`` at least.
    assumed : tuple of str
        What the header does not say and is that of the instrument, or 1 for the gain of the register.
    """

    path: Path
    kind: str
    header: Mapping[str, Any]
    planes: tuple[tuple[int, int], ...]
    shape: tuple[int, int]
    exposure_s: float
    em_gain: float
    detector: Detector
    sections: Mapping[str, Section]
    assumed: tuple[str, ...] = field(default=())

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.planes)

    def iter_raw(self) -> Iterator[tuple[FloatArray, dict[str, Any]]]:
        """Yield the frames in ADU with the keywords of their own, one in memory at a time."""
        with fits_units(self.path) as units:
            for number, plane in self.planes:
                data = units[number].data
                header = named_header(units[number].header)
                yield (
                    np.array(data if plane < 0 else data[plane], dtype=np.float64),
                    {key: header[key] for key in _OWN if key in header},
                )
                if plane < 0 or plane == len(data) - 1:
                    del units[number].data

    def unlit(self) -> BoolArray:
        """Return the pixels of prescan and overscan columns, without those that collect what transfers leave behind."""
        found = np.zeros(self.shape, dtype=np.bool_)
        for name, trail in (("prescan", 0), ("overscan_columns", _TRAIL_PIXELS)):
            if name in self.sections:
                rows, columns = self.sections[name]
                found[rows, columns.start + trail : columns.stop] = True
        return found


_TRAIL_PIXELS = 4


def read_level0(path: str | Path, instrument: Instrument) -> Level0:
    """Read what a Level-0 file of any writer says, and check that its frames can be reduced.

    Parameters
    ----------
    path : str or Path
        Images of two axes and one shape, one unit each (compressed ones too), or one cube. Where some units are called
        IMAGE, others are passed over; tables and images of another shape are.
    instrument : Instrument
        Its visible camera gives what the header does not.

    Raises
    ------
    InputError
        For a file that is no FITS, has no images or none of a visible camera, does not say its kind or exposure, or has
        a number out of range; file and keyword are named.
    """
    table, place = load_keywords(), Path(path)
    with fits_units(place) as units:
        images = [number for number, unit in enumerate(units) if unit.is_image and len(unit.shape) in (2, 3)]
        called = [number for number in images if units[number].name == "IMAGE"] or images
        if not called:
            raise InputError("file", str(path), allowed="Level 0: a FITS file with images")
        rows, columns = (int(side) for side in units[called[0]].shape[-2:])
        chosen = [number for number in called if tuple(units[number].shape[-2:]) == (rows, columns)]
        planes: list[tuple[int, int]] = []
        for number in chosen:
            cube = len(units[number].shape) == 3
            planes += [(number, plane) for plane in range(units[number].shape[0])] if cube else [(number, -1)]
        headers = [named_header(units[number].header) for number in chosen]
        header = headers[0] | named_header(units[0].header)
    name = ProductName.parse(place.name)

    def refused(key: str, value: Any, allowed: str, unit: str = "") -> InputError:
        return InputError(key, value, unit=unit, allowed=allowed, hint=str(path))

    kind = str(header.get("OBSTYPE", name.kind if name else "missing")).strip().upper()
    if kind not in KINDS:
        raise refused("OBSTYPE", kind, f"{', '.join(KINDS)} (or the keyword FILETYPE)")
    camera = str(header.get("CAMERA", name.camera if name else "VIS")).strip().upper()
    if camera != "VIS":
        allowed = "VIS: headers of the near-infrared camera do not say how the reads of a ramp were fitted"
        raise refused("CAMERA", camera, allowed)
    assumed: list[str] = []

    def stated(key: str, default: float, low: float, high: float) -> float:
        unit = table.keywords[key].unit
        value = header.get(key)
        if value is None:
            assumed.append(f"{key} = {default:g} {unit}".strip())
            return default
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            raise refused(key, value, f"a number from {low:g} to {high:g}", unit)
        return float(value)

    exposures: list[float] = []
    for value in (0.0,) if kind == "BIAS" else (one.get("EXPTIME", header.get("EXPTIME")) for one in headers):
        if isinstance(value, bool) or not isinstance(value, int | float) or not (0.0 <= value <= 1e6):
            raise refused("EXPTIME", "missing" if value is None else value, "a number from 0 to 1e6", "s")
        exposures.append(float(value))
        if abs(value - exposures[0]) > _SAME_EXPOSURE * exposures[0]:
            raise refused("EXPTIME", f"{exposures[0]} and {value}", "one exposure for all images of a file", "s")
    base = instrument.detector
    update = {name: stated(key, getattr(base, name), *_RANGES[key]) for key, name in _NUMBERS.items()}
    adc_bits = int(stated("ADCBITS", base.adc_bits, 8, 16))
    detector = base.model_copy(update={**update, "adc_bits": adc_bits, "n_rows": rows, "n_columns": columns})
    return Level0(
        path=place,
        kind=kind,
        header={"OBSTYPE": kind, "CAMERA": camera, **header},
        planes=tuple(planes),
        shape=(rows, columns),
        exposure_s=float(np.mean(exposures)),
        em_gain=stated("EMGAIN", 1.0, 1.0, base.em_gain_max),
        detector=detector,
        sections=_sections(header, (rows, columns), base, refused, assumed),
        assumed=tuple(assumed),
    )


_RANGES = {"GAIN": (1e-6, 1e5), "RDNOISE": (0.0, 1e5), "BIASLEV": (0.0, 65535.0), "FULLWELL": (100.0, 1e9)}


def _sections(
    header: Mapping[str, Any], shape: tuple[int, int], detector: Detector, refused: Any, assumed: list[str]
) -> dict[str, Section]:
    """Return the parts of the frame: of the header, of the instrument for a frame of its shape, or all active."""
    found: dict[str, Section] = {}
    for keyword in load_keywords():
        text = header.get(keyword.name)
        if not keyword.section or text is None:
            continue
        part = read_section(str(text).replace(" ", ""), shape)
        if part is None:
            raise refused(keyword.name, text, f"[first:last column,first:last row] in {shape[1]} x {shape[0]} pixels")
        found[keyword.section] = part
    if "active" in found:
        return found
    whole = detector.sections if shape == detector.shape else {"active": (slice(0, shape[0]), slice(0, shape[1]))}
    assumed.append("DATASEC = that of the instrument" if shape == detector.shape else "DATASEC = the whole frame")
    return {**whole, **found}


def nearness(a: float, b: float) -> float:
    """Return how far two gains or exposures are apart: the size of the logarithm of their ratio."""
    return abs(math.log(max(a, 1e-6) / max(b, 1e-6)))
