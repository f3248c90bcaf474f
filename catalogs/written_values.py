"""Values as people write them in tables: numbers, angles, dates and units.

Whole columns are read at once. A cell that is empty (masked, None, nan or blank) gives nan; a cell that holds something
else than a value is marked as refused, and so is one that may mean two numbers: nothing is guessed.
"""

import contextlib
import csv
import functools
import math
import re
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from cpic_core import BoolArray, FloatArray, InputError, NDArray

if TYPE_CHECKING:
    from astropy.units import UnitBase

_UNITS = Path(__file__).resolve().parent / "data" / "units.csv"
_MINUS = "-−–‒﹣－"
_PLAIN = r"^[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?$"
_SIZE = r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?"
_NUMBER = (
    rf"^(?P<limit>[<>≤≥]?)=?(?:[~≈]|sim)?\s*(?P<value>[-+]?{_SIZE})\s*(?:\((?P<digits>\d{{1,9}})\)"
    rf"|(?:±|pm|\+/?-)\s*(?P<error>{_SIZE})|\+\s*(?P<up>{_SIZE})\s*[,/]?\s*-\s*(?P<down>{_SIZE}))?\s*[*:?†‡]*$"
)
#: Commas between groups of three digits, and a comma that may be one of them or the decimal sign.
_GROUPED = r"^[^\d,]*\d{1,3}(?:(?:,\d{3})+\.\d|(?:,\d{3}){2,}(?:[^\d,]|$))"
_OPEN_COMMA = r"^[^\d,]*[1-9]\d{0,2},\d{3}(?:[^\d,.]|$)"
_SEXAGESIMAL = (
    rf"^(?P<sign>[{_MINUS}+]?)\s*(?P<whole>\d{{1,3}}(?:\.\d*)?)\s*(?P<mark>[:\shHdD°º])\s*"
    r"(?:(?P<minutes>\d{1,2}(?:\.\d*)?)\s*(?:[:\smM'′’]\s*(?P<seconds>\d{1,2}(?:\.\d*)?))?\s*(?:[mMsS\"″”'′’]|'')?)?$"
)
_PAIRS = (
    rf"^\+?(?P<first>[^{_MINUS}+,;]*[^{_MINUS}+,;\s])\s*[,;]?\s*(?P<second>[{_MINUS}+].*)$",
    r"^(?P<first>\S+\s+\S+\s+[^\s,;]+)\s*[\s,;]\s*(?P<second>\S+\s+\S+\s+\S+)$",
    r"^(?P<first>[^\s,;]+)\s*[\s,;]\s*(?P<second>[^\s,;]+)$",
)
_ZEROS = {
    "bkjd": 2454833.0,
    "btjd": 2457000.0,
    "mjd": 2400000.5,
    "rjd": 2400000.0,
    "modified": 2400000.5,
    "reduced": 2.4e6,
}
_CALENDAR = ("%Y %b %d", "%d %b %Y", "%Y %B %d", "%d %B %Y", "%Y-%b-%d", "%d-%b-%Y", "%Y/%m/%d", "%Y/%m/%d %H:%M:%S")
_JULIAN = (2.3e6, 2.5e6)
_DATES = (
    "a Julian date such as 2455000.5, or a calendar date such as 2005-06-12; 54321.5 may be a modified date (MJD) or a "
    "reduced one (JD-2400000), half a day apart: say which in the heading or the unit"
)


class Written(NamedTuple):
    """A column of values as it was read.

    Parameters
    ----------
    values : ndarray of float
        The numbers; nan where a cell is empty, refused or a limit.
    refused : ndarray of bool
        Cells that hold something else than a value.
    limits : ndarray of int
        1 for an upper limit (``<0.3``), -1 for a lower limit (``>5``), 0 for a value, as the NASA Exoplanet Archive
        has them.
    bounds : ndarray of float
        The numbers of the limits, nan elsewhere.
    errors : ndarray of float
        Standard errors that stand in the cells themselves (``12.3(4)``, ``12.3±0.4``; the larger one of two), nan
        elsewhere.
    reason : str
        What such a cell may hold, in words.
    """

    values: FloatArray
    refused: BoolArray
    limits: NDArray[np.int8]
    bounds: FloatArray
    errors: FloatArray
    reason: str


class WrittenUnit(NamedTuple):
    """A unit of astropy, and whether the numbers are decimal logarithms of it."""

    unit: "UnitBase"
    is_log10: bool


def read_numbers(cells: Any) -> Written:
    """Read numbers, with what people write around them.

    Accepted are signs of any kind (``−0.52``), exponents (``1.2e3``, Fortran's ``1.2D+03``), decimal commas, commas
    between groups of digits, marks behind the number (``12.3*``, ``12.3:``), errors (``12.3(4)``, ``12.3±0.4``,
    ``12.3 +/- 0.4``, ``$12.3^{+0.4}_{-0.3}$``), ``~3`` as the value 3, and limits (``<0.3``, ``>5``), which are no
    values. ``1,234`` alone may be 1234 or 1.234: the other cells of the column decide, or it is refused.

    Parameters
    ----------
    cells : array_like, 1-D
        Text or numbers, masked where missing.

    Returns
    -------
    Written
    """
    given = np.ma.asanyarray(cells)
    if given.dtype.kind in "iuf":
        return _written(np.ma.filled(given.astype(float), np.nan))
    texts = _texts(given)
    plain = pc.match_substring_regex(texts, _PLAIN)
    read = _written(_floats(pc.if_else(plain, texts, pa.scalar(None, pa.string()))))
    odd = np.flatnonzero(_true(pc.invert(plain)))
    if odd.size:
        points = bool(pc.any(pc.and_(plain, pc.match_substring(texts, "."))).as_py())
        found = _fields(_with_points(texts.take(pa.array(odd)), points), _NUMBER)
        number, limit = _floats(found["value"]), _is(found["limit"], "<≤").astype(np.int8)
        limit -= _is(found["limit"], ">≥")
        decimals = pc.utf8_length(pc.replace_substring_regex(found["value"], r"^[^.]*\.?|[eE].*$", ""))
        errors = [_floats(found[name]) for name in ("error", "up", "down")]
        errors.append(_floats(found["digits"]) * 10.0 ** -_floats(decimals))
        read.values[odd], read.bounds[odd] = np.where(limit, (np.nan * number, number), (number, np.nan * number))
        read.limits[odd], read.errors[odd], read.refused[odd] = limit, np.fmax.reduce(errors), ~np.isfinite(number)
    return read


def read_angles(cells: Any, unit: str = "", *, clock: bool = False) -> Written:
    """Read angles in degrees, sexagesimal or not.

    Parameters
    ----------
    cells : array_like, 1-D
        Numbers, or text such as ``01:44:04.08``, ``01 44 04.08``, ``1h44m4.08s``, ``-00 12 34.5``, ``+15°56'14"`` and
        ``12 30.5`` (minutes with a fraction), masked where missing.
    unit : str
        Unit of the column as written: plain numbers are in it, or else in degrees.
    clock : bool
        Whether the column is a right ascension: sexagesimal text without letters is in hours then, also where the unit
        says degrees, unless the first part reaches 24 in one of the cells of such a column.

    Returns
    -------
    Written
        Degrees. Refused are minutes or seconds of more than 60, right ascensions of less than 0 or more than 24 h in
        sexagesimal text, other such angles of more than 90 degrees or in hours.

    Raises
    ------
    InputError
        If the unit is not one of an angle.
    """
    given = np.ma.asanyarray(cells)
    if given.dtype.kind in "iuf":
        return converted(read_numbers(given), unit, "deg")
    found = _fields(_texts(given), _SEXAGESIMAL)
    whole, minutes, seconds = (_floats(found[name]) for name in ("whole", "minutes", "seconds"))
    split = np.isfinite(whole)
    read = converted(read_numbers(np.ma.array(given, mask=np.ma.getmaskarray(given) | split)), unit, "deg")
    hours, degrees = _is(found["mark"], "hH"), _is(found["mark"], "dD°º")
    bare = split & ~hours & ~degrees
    degrees_stated = bool(unit) and converted(_written(np.ones(1)), unit, "deg").values[0] == 1.0
    if clock and not (degrees_stated and np.any(whole[bare] >= 24.0)):
        hours |= bare
    angle = _joined(whole, minutes, seconds, _is(found["sign"], _MINUS), hours, clock)
    angle[(bare & np.isnan(minutes)) | (hours & (not clock))] = np.nan
    values = np.where(split, angle, read.values)
    return read._replace(values=values, refused=read.refused | (split & np.isnan(angle)))


def read_positions(cells: Any) -> tuple[Written, Written]:
    """Read right ascension and declination, in degrees, that stand in one cell.

    Parameters
    ----------
    cells : array_like of str, 1-D
        Text such as ``01 44 04.083 -15 56 14.93``, ``01h44m04s -15d56m14s`` or ``26.017, -15.937``.

    Returns
    -------
    right ascension, declination : Written
        As of :func:`read_angles`; both are refused where a cell is no pair.
    """
    texts = _texts(np.ma.asanyarray(cells))
    first = second = pa.nulls(len(texts), pa.string())
    for pattern in _PAIRS:
        if first.null_count > texts.null_count:
            found = _fields(texts, pattern)
            first, second = pc.coalesce(first, found["first"]), pc.coalesce(second, found["second"])
    neither = pc.if_else(pc.is_valid(texts), "no pair", pa.scalar(None, pa.string()))
    first, second = pc.coalesce(first, neither), pc.coalesce(second, neither)
    return read_angles(first.to_numpy(zero_copy_only=False), clock=True), read_angles(
        second.to_numpy(zero_copy_only=False)
    )


def join_sexagesimal(
    whole: Any, minutes: Any, seconds: Any = None, sign: Any = None, *, clock: bool = False
) -> Written:
    """Join an angle that a table splits over several columns (``RAh RAm RAs``, ``DE- DEd DEm DEs``), in degrees.

    Parameters
    ----------
    whole, minutes : array_like, 1-D
        Hours or degrees, and minutes. Without `sign`, a minus of `whole` is that of the angle, of ``-00`` too.
    seconds, sign : array_like, 1-D, optional
        Blank seconds are 0; a blank sign is a plus.
    clock : bool
        Whether `whole` is in hours.

    Returns
    -------
    Written
        Refused where a part is missing or no number, or out of the range of :func:`read_angles`.
    """
    first, others = np.ma.asanyarray(whole), (minutes, np.zeros(np.shape(whole)) if seconds is None else seconds)
    degrees, *parts = read = [read_numbers(cells) for cells in (first, *others)]
    marks = _texts(first if sign is None else np.ma.asanyarray(sign))
    negative = _is(pc.utf8_slice_codeunits(marks, 0, 1), _MINUS)
    hours = np.full(first.shape, clock)
    values = _joined(np.abs(degrees.values), parts[0].values, parts[1].values, negative, hours, clock)
    values[np.isnan(parts[0].values)] = np.nan
    given = np.isfinite(degrees.values) | np.isfinite(parts[0].values) | np.any([part.refused for part in read], axis=0)
    return _written(values)._replace(refused=np.isnan(values) & given)


def read_dates(cells: Any, convention: str = "") -> Written:
    """Read times as Julian dates.

    Parameters
    ----------
    cells : array_like, 1-D
        Numbers, or calendar dates such as ``2005-06-12T03:04:05``, ``2005 Jun 12`` and ``J2005.45``.
    convention : str
        What the numbers are, in words as headings and units have them: ``JD``, ``BJD``, ``MJD``, ``BKJD``,
        ``BJD-2454833``, ``JD - 2,450,000``, ``yr`` (Julian years). Where they say nothing of the kind (``days``), only
        whole Julian dates are accepted: MJD and JD-2400000 are half a day apart.

    Returns
    -------
    Written
        Julian dates of the time scale that the table has; `reason` says what is accepted.
    """
    given = np.ma.asanyarray(cells)
    read, words = read_numbers(given), re.sub(r"[\s_,]", "", convention.lower())
    values = read.values
    if counted := re.search(rf"jd\w*?\)?[{_MINUS}]?\(?(24\d{{5}}(?:\.\d+)?)", words):
        values = values + float(counted[1])
    elif named := re.search("|".join(_ZEROS), words):
        values = values + _ZEROS[named[0]]
    elif re.search(r"y(?:ea)?rs?\b", words):
        values = np.where((values > 1000.0) & (values < 3000.0), _julian_date(values), np.inf)
    for row in np.flatnonzero(read.refused):
        values[row] = _calendar(" ".join(str(given[row]).split()))
    good = (values >= _JULIAN[0]) & (values <= _JULIAN[1])
    refused = ~good & (np.isfinite(read.values) | read.refused | (read.limits != 0))
    return read._replace(values=np.where(good, values, np.nan), refused=refused, reason=_DATES)


def _julian_date(year: Any) -> Any:
    """Return the Julian date of a Julian year (2000.0 is J2000.0)."""
    return 2451545.0 + (year - 2000.0) * 365.25


def _calendar(text: str) -> float:
    """Return the Julian date of a calendar date, nan if it is none."""
    if epoch := re.fullmatch(r"J(\d{4}(?:\.\d*)?)", text):
        return float(_julian_date(float(epoch[1])))
    for form in ("", *_CALENDAR):
        try:
            day = datetime.strptime(text, form) if form else datetime.fromisoformat(text)
        except ValueError:
            continue
        day = day if day.tzinfo else day.replace(tzinfo=UTC)
        return 2451545.0 + (day - datetime(2000, 1, 1, 12, tzinfo=UTC)).total_seconds() / 86400.0
    return math.nan


@functools.cache
def unit_of(text: str, own: str = "") -> WrittenUnit:
    """Return the unit that a text means.

    Parameters
    ----------
    text : str
        A unit as tables have it: astropy's, CDS's or FITS's spelling, words (``days``, ``[Jupiter mass]``), or a
        logarithm (``log10(cm/s**2)``, ``dex(Lsun)``, ``[cm/s2]``).
    own : str
        A unit of the quantity, of several meanings the choice (``h`` is an hour, or 15 degrees; ``MJ`` the mass of
        Jupiter or a megajoule); without it the first one.

    Returns
    -------
    WrittenUnit
        Square brackets mean a logarithm, as at CDS, around an acceleration, a luminosity and the Sun alone; headings
        have them around any unit.

    Raises
    ------
    InputError
        If it is no unit, or none of the quantity.
    """
    from astropy import units

    target = unit_of(own) if own else WrittenUnit(units.dimensionless_unscaled, False)
    if not text.strip("- "):
        return target
    for unit, is_log10 in _meanings(text):
        if unit is None:
            return WrittenUnit(target.unit, True)
        if not own or unit.is_equivalent(target.unit):
            return WrittenUnit(unit, is_log10)
    raise InputError("unit", text, allowed=f"a unit like {own or 'mag, deg or mas/yr'}")


def converted(read: Written, text: str, own: str) -> Written:
    """Convert a column to the unit that we keep.

    Parameters
    ----------
    read : Written
    text : str
        Unit of the column as written, ``""`` if it states none: then it is `own`.
    own : str
        Our unit, in the same spellings; ``dex(cm/s2)`` and ``dex`` are logarithms.

    Raises
    ------
    InputError
        If the unit is not understood, or none of the quantity.
    """
    if text.strip("- ") in ("", own) or _words().get(_squeezed(text)) == [own]:
        return read
    (unit, given_log), (kept, kept_log) = unit_of(text, own), unit_of(own)
    factor = float((1.0 * unit).to_value(kept))

    def scaled(numbers: FloatArray) -> FloatArray:
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            if given_log and kept_log:
                return numbers + math.log10(factor)
            linear = (10.0**numbers if given_log else numbers) * factor
            return np.log10(linear) if kept_log else linear

    values, errors = scaled(read.values), read.errors
    if not given_log and not kept_log:
        errors = errors * factor
    elif given_log != kept_log:  # d log10(x) = dx / (x ln 10)
        slope = values if given_log else 1.0 / (read.values * factor)
        errors = errors * factor * slope * math.log(10.0) ** (1 if given_log else -1)
    lost = np.isfinite(read.values) & ~np.isfinite(values)
    values[lost] = np.nan
    return read._replace(values=values, bounds=scaled(read.bounds), errors=errors, refused=read.refused | lost)


def _meanings(text: str) -> Iterator[tuple["UnitBase | None", bool]]:
    """Yield what a unit may mean, the likeliest first; None for a logarithm of whatever the quantity is."""
    from astropy import units

    plain = re.sub(r"[$\\{}]|\brm\b", "", text).strip()
    inner = re.sub(r"^[\[(](.*)[\])]$", r"\1", plain).strip()
    logged = re.fullmatch(r"(?:dex|log_?10|log|lg)(?:\s*[\[(](.*)[\])]|\s+(.*))", inner, re.IGNORECASE)
    inner = (logged[1] or logged[2]).strip() if logged else inner
    bracketed = (units.cm / units.s**2, units.solLum, units.dimensionless_unscaled) if plain[:1] == "[" else ()
    spelled = re.sub(r"[^\W\d]+|''|[\"″”'′°]", lambda word: _single(word[0]), inner)
    for word in _words().get(_squeezed(inner), [spelled, inner]):
        for form in ("generic", "cds") if word else ():
            with contextlib.suppress(ValueError, TypeError):
                unit = units.Unit(word, format=form)
                physical = getattr(unit, "physical_unit", unit)
                yield physical, bool(logged) or physical is not unit or unit in bracketed
                break
        if not word:
            yield None, True


def _single(word: str) -> str:
    """Return the unit of a word that means one only, and any other word as it is."""
    found = _words().get(_squeezed(word), [])
    return found[0] if len(found) == 1 and found[0] else word


@functools.cache
def _words() -> dict[str, list[str]]:
    """Return the units that each word of the shipped list may mean."""
    with _UNITS.open(encoding="utf-8", newline="") as stream:
        return {word: row["units"].split() or [""] for row in csv.DictReader(stream) for word in row["written"].split()}


def _squeezed(text: str) -> str:
    return re.sub(r"[\s_.]|(?<=[A-Za-z])-(?=[A-Za-z])", "", text).lower()


def _written(values: FloatArray) -> Written:
    """Return numbers that need no reading; infinite ones are refused."""
    refused, none = np.isinf(values), np.full(values.shape, np.nan)
    return Written(
        np.where(refused, np.nan, values), refused, np.zeros(values.shape, np.int8), none, none.copy(), "a number"
    )


def _texts(given: Any) -> Any:
    """Return the cells as an Arrow array of trimmed text, null where empty."""
    hidden, cells = np.ma.getmaskarray(given), np.ma.getdata(given).astype(object)
    try:
        texts = pa.array(cells, pa.string(), mask=hidden)
    except (pa.ArrowTypeError, pa.ArrowInvalid):  # numbers among the text, as spreadsheets have them
        texts = pa.array([None if cell is None else str(cell) for cell in cells], pa.string(), mask=hidden)
    texts = pc.utf8_trim_whitespace(texts)
    blank = pc.is_in(texts, value_set=pa.array(["", "nan"]))
    return pc.if_else(blank, pa.scalar(None, pa.string()), texts)


def _fields(texts: Any, pattern: str) -> dict[str, Any]:
    """Return the named groups of a pattern as Arrow arrays of text, null where there is no such group."""
    found = pc.extract_regex(texts, pattern)
    groups = re.findall(r"\?P<(\w+)>", pattern)
    parts = {name: pc.struct_field(found, [i]) for i, name in enumerate(groups)}
    return {name: pc.if_else(pc.equal(part, ""), pa.scalar(None, pa.string()), part) for name, part in parts.items()}


def _floats(texts: Any) -> FloatArray:
    """Return an Arrow array as numbers, nan where null."""
    return np.array(pc.cast(texts, pa.float64()).to_numpy(zero_copy_only=False))


def _true(flags: Any) -> BoolArray:
    return np.asarray(flags.fill_null(False).to_numpy(zero_copy_only=False), bool)


def _is(texts: Any, letters: str) -> BoolArray:
    """Tell which cells are one of some letters."""
    return _true(pc.is_in(texts, value_set=pa.array(list(letters))))


def _with_points(texts: Any, points: bool) -> Any:
    """Return numbers in ASCII, without the marks of LaTeX, a point before the decimals and no other commas.

    Parameters
    ----------
    texts : pyarrow.Array
    points : bool
        Whether other cells of the column have a decimal point.
    """
    for pattern, plain in ((f"[{_MINUS}]", "-"), (r"[$\\}^]|_?\{", ""), (r"(\d\.?)[dD]([-+]\d)", r"\1e\2")):
        texts = pc.replace_substring_regex(texts, pattern, plain)
    comma = pc.match_substring(texts, ",")
    grouped, either = pc.match_substring_regex(texts, _GROUPED), pc.match_substring_regex(texts, _OPEN_COMMA)
    decimal = pc.and_not(comma, pc.or_(grouped, either))
    sure = bool(pc.any(decimal).as_py())
    points = points or bool(pc.any(grouped).as_py())
    if points != sure:
        grouped, decimal = (pc.or_(grouped, either), decimal) if points else (grouped, pc.or_(decimal, either))
    without = pc.replace_substring(texts, ",", "")
    return pc.if_else(grouped, without, pc.if_else(decimal, pc.replace_substring(texts, ",", "."), texts))


def _joined(
    whole: FloatArray, minutes: FloatArray, seconds: FloatArray, negative: BoolArray, hours: BoolArray, clock: bool
) -> FloatArray:
    """Return degrees of hours or degrees, minutes and seconds; nan where they are no angle."""
    size = whole + np.nan_to_num(minutes) / 60.0 + np.nan_to_num(seconds) / 3600.0
    broken = ((whole % 1.0 > 0.0) & np.isfinite(minutes)) | ((minutes % 1.0 > 0.0) & np.isfinite(seconds))
    broken |= (minutes >= 60.0) | (seconds > 60.0) | (np.isfinite(seconds) & np.isnan(minutes))
    angle = np.where(negative, -size, size) * np.where(hours, 15.0, 1.0)
    broken |= (angle < 0.0) | (angle > 360.0) if clock else np.abs(angle) > 90.0
    return np.where(broken, np.nan, angle)
