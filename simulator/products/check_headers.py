"""Check header values of a Level-0 file against the table of keywords, against each other and against the name."""

import math
import re

from cpic_core import InputError
from simulator.config import checked_utc
from simulator.products.ephemeris import elapsed_s, mjd_of, stamp
from simulator.products.keywords import Profile, load_keywords
from simulator.products.naming import ProductName
from simulator.products.reading import Header, Report, is_real
from simulator.products.sequence import SCIENCE_KINDS

TIME_TOLERANCE_S = 0.002
SCALE_TOLERANCE = 1e-3
PLACE_TOLERANCE_DEG = 1.0 / 3600.0
ANGLE_TOLERANCE_DEG = 0.01
# Least values, and whether they are themselves allowed.
_LEAST = {"GAIN": (0.0, False), "FULLWELL": (0.0, False), "PIXSCALE": (0.0, False)}
_LEAST |= {"EMGAIN": (1.0, True), "RDNOISE": (0.0, True), "EXPTIME": (0.0, True)}
# What does not change during a sequence.
_SETTINGS = ("GAIN", "EMGAIN", "RDNOISE", "ADCBITS", "FULLWELL", "FILTER", "DETNAM")
# What is each image's own, what may be measured for each, and what is compared with the primary header elsewhere.
_OF_ITS_OWN = ("FRAMEID", "EXPBEG", "EXPEND", "NSAT", "NREGSAT", "NCLIP", "NCR", "NNEGRATE")
_MEASURED = ("CCDTEMP", "BIASLEV", "EMVOLT", *(f"CRPIX{axis}" for axis in (1, 2)), *(f"CRVAL{axis}" for axis in (1, 2)))
_MEASURED += ("CD1_1", "CD1_2", "CD2_1", "CD2_2")
_ELSEWHERE = ("EXPTIME", "NFRAME", "CAMERA")


def check_keywords(report: Report, header: Header, hdu: int, *, kind: str, coordinates: bool) -> None:
    """Check that a header has the keywords of its unit, under any spelling, in their types.

    Parameters
    ----------
    kind : str
        Kind of the observation.
    coordinates : bool
        Whether the target has coordinates.
    """
    table = load_keywords()
    needed = {"always": True, "sky": kind in SCIENCE_KINDS, "coordinates": coordinates and kind in SCIENCE_KINDS}
    home = "image" if hdu else "primary"
    for keyword in table:
        found = [spelling for spelling in (keyword.name, *keyword.aliases) if spelling in header]
        if keyword.hdu not in (home, "both"):
            continue
        if not found:
            if needed.get(keyword.required, False):
                others = f" (or {', '.join(keyword.aliases)})" if keyword.aliases else ""
                report.error(f"is missing{others}", keyword.name, hdu)
            continue
        for spelling in found:
            value = header[spelling]
            if not keyword.fits(value):
                report.error(f"is {value!r}, which is not of type {keyword.kind}", spelling, hdu)
        if any(header[spelling] != header[found[0]] for spelling in found):
            report.error(f"differs from its other spelling {found[0]}", found[-1], hdu)


def profile_of(header: Header) -> Profile:
    """Return the profile whose spellings a primary header follows best; the first of the table where several do."""
    table = load_keywords()
    return min(table.profiles.values(), key=lambda profile: len(_misspelled(header, 0, profile)))


def check_spellings(report: Report, header: Header, hdu: int, profile: Profile) -> None:
    """Warn where a keyword stands under another spelling only than those of the profile.

    Parameters
    ----------
    report : Report
    header : mapping
        Keywords and values of one unit.
    hdu : int
        Number of the unit in the file; the primary one is 0.
    profile : Profile
    """
    for missing, found in _misspelled(header, hdu, profile):
        report.warning(f"is missing, {found} stands for it", missing, hdu)


def _misspelled(header: Header, hdu: int, profile: Profile) -> list[tuple[str, str]]:
    """Return the spellings of the profile that a header lacks, and those that it has instead."""
    table, home = load_keywords(), "image" if hdu else "primary"
    found = []
    for keyword in table:
        present = table.find(header, keyword.name) if keyword.hdu in (home, "both") else None
        if present is not None:
            found += [(spelling, present[0]) for spelling in profile.spellings(keyword.name) if spelling not in header]
    return found


def check_settings(report: Report, header: Header, first: Header, hdu: int) -> None:
    """Check that the numbers of a camera in one image are possible, and those of the first image.

    Parameters
    ----------
    report : Report
    header : mapping
        Keywords and values of one unit.
    first : mapping
        Keywords and values of the first image.
    hdu : int
        Number of the unit in the file; the primary one is 0.
    """
    table = load_keywords()
    for key, (least, included) in _LEAST.items():
        value = table.value(header, key)
        if is_real(value) and (value < least or (value == least and not included)):
            report.error(f"is {value}, not {'at least' if included else 'above'} {least:g}", key, hdu)
    unit = table.value(header, "BUNIT")
    if isinstance(unit, str) and unit.strip().lower() != "adu":
        report.error(f"is {unit!r}, not 'adu'", "BUNIT", hdu)
    for key in _SETTINGS:
        value, other = table.value(header, key), table.value(first, key)
        if None not in (value, other) and value != other:
            report.error(f"is {value!r}, image 1 has {other!r}", key, hdu)


def check_shared(report: Report, header: Header, first: Header, primary: Header, hdu: int) -> None:
    """Check that an image says of the sequence what the first image and the primary header say of it.

    Every keyword of the table that an image has is compared, but for those that are its own, and those that
    `check_settings` compares.

    Parameters
    ----------
    report : Report
    header : mapping
        Keywords and values of one unit.
    first, primary : mapping
        Those of the first image and of the primary unit.
    hdu : int
        Number of the unit in the file; the primary one is 0.
    """
    table = load_keywords()
    for keyword in table:
        if keyword.hdu == "primary" or keyword.name in _OF_ITS_OWN:
            continue
        found, other = table.find(header, keyword.name), table.find(first, keyword.name)
        if keyword.name not in _SETTINGS and (found, other) != (None, None):
            if found is None or other is None:
                where = ("image 1 has it", "image 1 lacks it")[found is not None]
                report.warning(f"is {'missing' if found is None else 'there'}, {where}", keyword.name, hdu)
            elif found[1] != other[1]:
                say = report.warning if keyword.name in _MEASURED else report.error
                say(f"is {found[1]!r}, image 1 has {other[1]!r}", found[0], hdu)
        said = table.value(primary, keyword.name) if keyword.hdu == "both" and keyword.name not in _ELSEWHERE else None
        if hdu == 1 and None not in (found, said) and found[1] != said:  # type: ignore[index]
            report.error(f"is {found[1]!r}, the primary header says {said!r}", found[0], hdu)  # type: ignore[index]


def check_primary(report: Report, header: Header, name: ProductName | None, n_images: int) -> None:
    """Check what the primary header says of the file: name, number, kind, number of images.

    Parameters
    ----------
    report : Report
    header : mapping
        Keywords and values of one unit.
    name : ProductName or None
    n_images : int
        Images in the file.
    """
    table = load_keywords()
    for key, expected in (("TELESCOP", "CSST"), ("INSTRUME", "CPIC"), ("TIMESYS", "UTC")):
        value = table.value(header, key)
        if value is not None and value != expected:
            report.error(f"is {value!r}, not {expected!r}", key, 0)
    for key in ("NEXTEND", "NFRAME"):
        value = table.value(header, key)
        if value is not None and value != n_images:
            report.error(f"is {value!r}, the file has {n_images} images", key, 0)
    obsid = table.value(header, "OBSID")
    if isinstance(obsid, str) and re.fullmatch(r"\d{11}", obsid, re.ASCII) is None:
        report.error(f"is {obsid!r}, not 11 digits", "OBSID", 0)
    if name is None:
        return
    written = table.value(header, "FILENAME")
    if isinstance(written, str) and written.removesuffix(".fits") != name.stem:
        report.error(f"is {written!r}, not the name of this file", "FILENAME", 0)
    for key, expected in (("OBSID", name.obsid), ("OBSTYPE", name.kind), ("CAMERA", name.camera)):
        value = table.value(header, key)
        if isinstance(value, str) and value != expected:
            report.error(f"is {value!r}, the file name says {expected!r}", key, 0)


def check_times(report: Report, header: Header, name: ProductName | None) -> None:
    """Check that times in the primary header, exposure, readout and the stamps of the name agree.

    Parameters
    ----------
    report : Report
    header : mapping
        Keywords and values of one unit.
    name : ProductName or None
    """
    table = load_keywords()
    keys = ("DATE-OBS", "DATE-END", "EXPSTART", "EXPEND", "EXPTIME", "READTIME", "NFRAME")
    get = {key: table.value(header, key) for key in keys}
    utc: dict[str, str] = {}
    for key in ("DATE-OBS", "DATE-END"):
        if isinstance(get[key], str):
            try:
                utc[key] = checked_utc(key, get[key])
            except InputError:
                report.error(f"is {get[key]!r}, no time as 2028-01-01T00:00:00", key, 0)
    if name is not None:
        for key, digits, word in (("DATE-OBS", name.start, "start"), ("DATE-END", name.end, "end")):
            if key in utc and stamp(utc[key]) != digits:
                report.error(f"is {utc[key]}, the {word} stamp of the name is {digits}", key, 0)
    for key, other in (("DATE-OBS", "EXPSTART"), ("DATE-END", "EXPEND")):
        if key in utc and is_real(get[other]) and abs(mjd_of(utc[key]) - get[other]) * 86400.0 > TIME_TOLERANCE_S:
            report.error(f"is {get[other]!r}, {key} is MJD {mjd_of(utc[key]):.8f}", other, 0)
    if not all(is_real(get[key]) for key in ("EXPSTART", "EXPEND", "EXPTIME", "NFRAME")):
        return
    took, shortest = elapsed_s(get["EXPSTART"], get["EXPEND"]), get["NFRAME"] * get["EXPTIME"]
    if is_real(get["READTIME"]):
        expected = shortest + (get["NFRAME"] - 1) * get["READTIME"]
        if abs(took - expected) > TIME_TOLERANCE_S:
            report.error(f"comes {took:.3f} s after EXPSTART, the frames take {expected:.3f} s", "EXPEND", 0)
    elif took < shortest - TIME_TOLERANCE_S:
        report.error(f"comes {took:.3f} s after EXPSTART, the exposures alone take {shortest:.3f} s", "EXPEND", 0)


def check_world(report: Report, header: Header, primary: Header, hdu: int) -> None:
    """Check that the world coordinates are a sky of square pixels of the stated scale, place and position angle.

    Parameters
    ----------
    report : Report
    header : mapping
        Keywords and values of one unit.
    primary : mapping
        Keywords and values of the primary header.
    hdu : int
        Number of the unit in the file; the primary one is 0.
    """
    table = load_keywords()
    cd = [table.value(header, key) for key in ("CD1_1", "CD1_2", "CD2_1", "CD2_2")]
    if not all(is_real(value) for value in cd):
        return
    a, b, c, d = cd
    determinant = a * d - b * c
    if determinant == 0.0:
        report.error("is singular", "CD1_1", hdu)
        return
    step = math.sqrt(abs(determinant))
    if max(abs(a * a + c * c - step**2), abs(b * b + d * d - step**2), abs(a * b + c * d)) > SCALE_TOLERANCE * step**2:
        report.error("does not describe square pixels", "CD1_1", hdu)
    scale = table.value(header, "PIXSCALE")
    if is_real(scale) and abs(step * 3600.0 - scale) > SCALE_TOLERANCE * abs(scale):
        report.error(f"describes pixels of {step * 3600.0:.6f} arcsec, PIXSCALE is {scale}", "CD1_1", hdu)
    angle = table.value(primary, "POS_ANG1")
    if is_real(angle):
        turn = math.degrees(math.atan2(b, d))
        if abs((turn - angle + 180.0) % 360.0 - 180.0) > ANGLE_TOLERANCE_DEG:
            report.error(f"puts +y at {turn % 360.0:.3f} deg, POS_ANG1 is {angle}", "CD1_2", hdu)
    types = header.get("CTYPE1"), header.get("CTYPE2")
    if types == ("RA---TAN", "DEC--TAN"):
        for key, other in (("CRVAL1", "RA_OBJ"), ("CRVAL2", "DEC_OBJ")):
            value, target = header.get(key), table.value(primary, other)
            if is_real(value) and is_real(target):
                gap = abs((value - target + 180.0) % 360.0 - 180.0)
                if gap > PLACE_TOLERANCE_DEG:
                    report.error(f"is {value}, {other} is {target}", key, hdu)
        if is_real(header.get("CRVAL2")) and abs(header["CRVAL2"]) > 90.0:
            report.error(f"is {header['CRVAL2']}, no declination", "CRVAL2", hdu)
    elif types != ("EAST", "NORTH") and None not in types:
        known = "RA---TAN and DEC--TAN are known, EAST and NORTH without coordinates"
        report.error(f"is {types[0]!r} with CTYPE2 {types[1]!r}; {known}", "CTYPE1", hdu)
