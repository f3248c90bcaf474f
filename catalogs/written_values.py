"""Values as people write them in tables: numbers, angles, dates and units.

Whole columns are read at once. A cell that is empty (masked, None, nan or blank) gives nan; a cell that holds something
else than a value is marked as refused, and so is one that may mean two numbers: nothing is guessed.
"""

import contextlib
import functools
import math
import re
import unicodedata
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from catalogs.shipped import shipped_rows
from cpic_core import BoolArray, FloatArray, InputError, NDArray

if TYPE_CHECKING:
    from astropy.units import UnitBase

_MINUS = "-−–‒﹣－"
_SIZE = r"(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d{1,3})?"
#: Limit, number, digits of an error behind it, or the error, or that upwards and downwards in either order.
_NUMBER = (
    rf"([<>≤≥]?)=? ?(?:[~≈]|sim)? ?([-+]?{_SIZE}) ?(?:\((\d{{1,9}})\)|\((\d*\.\d+)\)|(?:±|pm|\+/?-) ?({_SIZE})"
    rf"|\+ ?({_SIZE}) ?[,/]? ?- ?({_SIZE})|- ?({_SIZE}) ?[,/]? ?\+ ?({_SIZE}))? ?[*:?†‡]*"
)
#: A comma between groups of three digits, and one that may be that or the decimal sign.
_GROUPED = re.compile(r"[^\d,]*\d{1,3}(?:(?:,\d{3})+\.\d|(?:,\d{3}){2,}(?![\d,]))")
_OPEN_COMMA = re.compile(r"[^\d,]*[1-9]\d{0,2},\d{3}(?![\d,.])")
#: Sign, hours or degrees, the mark behind them, minutes, seconds.
_SEXAGESIMAL = (
    rf"([{_MINUS}+]?) ?(\d{{1,3}}(?:\.\d*)?) ?([: hHdD°º]) ?"
    r"(?:(\d{1,2}(?:\.\d*)?) ?(?:[: mM'′’] ?(\d{1,2}(?:\.\d*)?|\.\d+))? ?(?:[mMsS\"″”'′’]|'')?)?"
)
#: Two angles, of which the second has a sign, or both three parts or one.
_PAIR = (
    rf"\+?([^{_MINUS}+,;\n]*[^{_MINUS}+,; \n]) ?[,;]? ?([{_MINUS}+].*)"
    r"|(\S+ \S+ [^\s,;]+) ?[ ,;] ?(\S+ \S+ \S+)|([^\s,;]+) ?[ ,;] ?([^\s,;]+)"
)
_NO_UNIT = re.compile(r"[\[(]?[-\s]*[\])]?|none", re.IGNORECASE)
_ZEROS = {"bkjd": 2454833.0, "btjd": 2457000.0, "mjd": 2400000.5, "rjd": 2.4e6, "modif": 2400000.5, "reduced": 2.4e6}
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
    reason: str = "a number with a decimal point"


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
    return _numbers(_texts(given))


def _numbers(texts: list[str]) -> Written:
    """Read numbers from trimmed text."""
    read = _written(np.array([_float(text) if text else math.nan for text in texts], float))
    odd = np.flatnonzero(np.isnan(read.values) & np.array([text != "" for text in texts], bool) & ~read.refused)
    if odd.size:
        found = _fields(_with_points([texts[i] for i in odd], any("." in text for text in texts)), _NUMBER)
        limit = np.array([(row[0] in "<≤") - 1 * (row[0] in ">≥") if row[0] else 0 for row in found], np.int8)
        number, digits, *errors = (_column(found, place) for place in range(1, 9))
        decimals = [len(re.sub(r"^[^.]*\.?|[eE].*", "", row[1])) if row[2] else 0 for row in found]
        read.values[odd], read.bounds[odd] = np.where(limit, (np.nan * number, number), (number, np.nan * number))
        read.errors[odd] = np.fmax.reduce([*errors, digits * 10.0 ** -np.array(decimals, float)])
        read.limits[odd], read.refused[odd] = limit, ~np.isfinite(number)
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
    if form := re.fullmatch(r"\W*([hd])\1?\W*mm?\W*s[\Ws]*", unit.lower()):  # "h:m:s", hh mm ss.s
        unit = "deg" if form[1] == "d" else "hourangle"
    if given.dtype.kind in "iuf":
        return converted(read_numbers(given), unit, "deg")
    texts = _texts(given)
    found = _fields(texts, _SEXAGESIMAL)
    whole, minutes, seconds = (_column(found, place) for place in (1, 3, 4))
    split = np.isfinite(whole)
    read = _numbers(["" if row[1] else text for text, row in zip(texts, found, strict=True)])
    read = read if split.all() else converted(read, unit, "deg")
    hours, degrees, negative = _among(found, 2, "hH"), _among(found, 2, "dD°º"), _among(found, 0, _MINUS)
    bare = split & ~hours & ~degrees
    if clock and not (_words().get(_squeezed(unit)) == ["deg"] and np.any(whole[bare] >= 24.0)):
        hours |= bare
    angle = _joined(whole, minutes, seconds, negative, hours, clock)
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
    found = zip(texts, _fields(texts, _PAIR), strict=True)
    pairs = [(*filter(None, row), *[text and "no pair"] * 2)[:2] for text, row in found]
    ra, dec = (np.array([pair[place] for pair in pairs], object) for place in (0, 1))
    return read_angles(ra, clock=True), read_angles(dec)


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
    negative = np.array([mark.startswith(tuple(_MINUS)) for mark in marks], bool)
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
    if counted := re.search(rf"jd\w{{0,9}}?\)?[{_MINUS}]?\(?(24\d{{5}}(?:\.\d+)?)", words):
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
    if _NO_UNIT.fullmatch(text.strip()):
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

    Returns
    -------
    Written
        Refused are numbers below 0 of which we keep the logarithm. Errors are nan where a number becomes a logarithm or
        the other way round.

    Raises
    ------
    InputError
        If the unit is not understood, or none of the quantity.
    """
    if text == own or _NO_UNIT.fullmatch(text.strip()) or _single(text) == _single(own):
        return read
    (unit, given_log), (kept, kept_log) = unit_of(text, own), unit_of(own)
    factor = float((1.0 * unit).to_value(kept))

    def scaled(numbers: FloatArray) -> FloatArray:
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            linear = factor * (10.0**numbers if given_log else numbers)
            return np.asarray(np.log10(linear) if kept_log else linear)

    if given_log and kept_log and factor == 1.0:
        return read
    values = scaled(read.values)
    errors = np.full_like(values, np.nan) if given_log != kept_log else read.errors * (1.0 if kept_log else factor)
    lost = np.isfinite(read.values) & ~np.isfinite(values)
    values[lost] = np.nan
    return read._replace(values=values, bounds=scaled(read.bounds), errors=errors, refused=read.refused | lost)


def _meanings(text: str) -> Iterator[tuple["UnitBase | None", bool]]:
    """Yield what a unit may mean, the likeliest first; None for a logarithm of whatever the quantity is."""
    from astropy import units

    plain = unicodedata.normalize("NFKC", text.replace("″", '"')).replace("−", "-").replace("·", ".")
    plain = re.sub(r"\\?(?:mathrm|text|rm\b)|[$\\{}]", "", " ".join(plain.split())).strip(" .")
    inner = re.sub(r"^[\[(](.*)[\])]$", r"\1", plain).strip()
    logged = re.fullmatch(r"(?:dex|log_?10|log|lg)\s*[\[(]?\s*(.+?)\s*[\])]?", inner, re.IGNORECASE)
    inner = logged[1] if logged else inner
    bracketed = plain[:1] == "["
    spelled = re.sub(r"[^\W\d]+|''|[\"″”'′°]", lambda word: _single(word[0]), inner)
    for word in _words().get(_squeezed(inner), [spelled, inner]):
        for form in ("generic", "cds") if word else ():
            with contextlib.suppress(ValueError, TypeError):
                unit = units.Unit(word, format=form)
                physical = getattr(unit, "physical_unit", unit)
                at_cds = unit in (units.solLum, units.one) or unit.physical_type == "acceleration"
                yield physical, bool(logged) or physical is not unit or (bracketed and at_cds)
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
    rows = shipped_rows("units.csv")
    return {word: row["units"].split() or [""] for row in rows for word in row["written"].split()}


def _squeezed(text: str) -> str:
    return re.sub(r"[\s_.()]|(?<=[A-Za-z])-(?=[A-Za-z])", "", text).lower()


def _written(values: FloatArray) -> Written:
    """Return numbers that need no reading; infinite ones are refused."""
    refused, none = np.isinf(values), np.full(values.shape, np.nan)
    limits = np.zeros(values.shape, np.int8)
    return Written(np.where(refused, np.nan, values), refused, limits, none, none.copy())


def _texts(given: Any) -> list[str]:
    """Return the cells as text with single blanks, ``""`` where empty."""
    cells = np.where(np.ma.getmaskarray(given), "", np.ma.getdata(given).astype(object)).tolist()
    texts = ["" if cell is None else " ".join(str(cell).split()) for cell in cells]
    return ["" if text.lower() == "nan" else text for text in texts]


def _float(text: str) -> float:
    """Return a plain number, nan for any other text."""
    try:
        return float(text) if text.isascii() and "_" not in text else math.nan  # Python reads 1_000, people do not
    except ValueError:
        return math.nan


def _fields(texts: list[str], pattern: str) -> list[tuple[str, ...]]:
    """Return the groups of a pattern in each text, all blank where it does not match the whole of it.

    One search through all texts takes a third of the time of one each.
    """
    return re.findall(rf"^(?:{pattern}|.*)$", "\n".join(texts), re.MULTILINE) if texts else []


def _column(fields: list[tuple[str, ...]], place: int) -> FloatArray:
    return np.array([float(row[place]) if row[place] else math.nan for row in fields], float)


def _among(fields: Sequence[Sequence[str]], place: int, letters: str) -> BoolArray:
    """Tell where a group is one of some letters."""
    return np.array([row[place] != "" and row[place] in letters for row in fields], bool)


def _with_points(texts: list[str], points: bool) -> list[str]:
    """Return numbers in ASCII, without the marks of LaTeX, a point before the decimals and no other commas.

    Parameters
    ----------
    texts : list of str
    points : bool
        Whether other cells of the column have a decimal point.
    """
    joined = "\n".join(texts)
    for pattern, plain in ((f"[{_MINUS}]", "-"), (r"[$\\}^]|_?\{", ""), (r"(\d\.?)[dD]([-+]\d)", r"\1e\2")):
        joined = re.sub(pattern, plain, joined)
    plain_texts = joined.split("\n")
    commas = {text for text in plain_texts if "," in text}
    grouped, either = (set(filter(form.match, commas)) for form in (_GROUPED, _OPEN_COMMA))
    decimal = commas - grouped - either
    if bool(grouped or points) != bool(decimal):
        grouped, decimal = (grouped, decimal | either) if decimal else (grouped | either, decimal)
    signs = dict.fromkeys(grouped, "") | dict.fromkeys(decimal, ".")
    return [text.replace(",", signs[text]) if text in signs else text for text in plain_texts]


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
