"""Meaning of a table: which column is which quantity, in which unit, and which of its rows can be used.

Whole columns are read at once. A cell that is empty (masked, None, nan or blank) gives nan; a cell that holds something
else than a value is marked as refused, and so is one that may mean two numbers: nothing is guessed.

What a file's headings mean stands in one table of synonyms, ``data/headings.csv``; names, units and believed ranges of
our own columns stand in ``data/columns.csv``. A row that cannot be used is left out with its reason, or refused where
the caller is strict; a cell that cannot be meant is left out of its row likewise.
"""

import contextlib
import functools
import math
import re
import unicodedata
from collections import Counter
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from catalogs.shipped import shipped_rows, shipped_words
from catalogs.table_files import CELL_OUT, ROW_OUT, LeftOut, RawColumn, RawTable
from cpic_core import BoolArray, FloatArray, InputError, NDArray, Record, listed

if TYPE_CHECKING:
    from astropy.units import UnitBase

_MINUS = "-−–‒﹣－"
_SIZE = r"(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d{1,3})?"
#: Limit, number; behind it the digits of an error, or the error, or that upwards and downwards in either order.
_NUMBER = (
    rf"([<>≤≥]?)=? ?(?:[~≈]|sim)? ?([-+]?{_SIZE}) ?(?:\((?:\d{{1,9}}|\d*\.\d+)\)|(?:±|pm|\+/?-) ?{_SIZE}"
    rf"|\+ ?{_SIZE} ?[,/]? ?- ?{_SIZE}|- ?{_SIZE} ?[,/]? ?\+ ?{_SIZE})? ?[*:?†‡]*"
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


class WrittenUnit(NamedTuple):
    """A unit of astropy, and whether the numbers are decimal logarithms of it."""

    unit: "UnitBase"
    is_log10: bool


def read_numbers(cells: Any) -> FloatArray:
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
    ndarray of float
        nan where a cell is empty, a limit, or holds something else than a number.
    """
    given = np.ma.asanyarray(cells)
    if given.dtype.kind in "iuf":
        return _finite(np.ma.filled(given.astype(float), np.nan))
    plain = np.ma.getdata(given).tolist()
    if not np.ma.getmaskarray(given).any() and set(map(type, plain)) == {str} and "_" not in "".join(plain):
        with contextlib.suppress(ValueError):  # numbers as programs write them, which most columns hold
            return _finite(np.array(plain, object).astype(float))
    return _text_numbers(_texts(given))


def _finite(values: FloatArray) -> FloatArray:
    """Return the numbers, nan for infinite ones."""
    return np.where(np.isinf(values), np.nan, values)


def _text_numbers(texts: list[str]) -> FloatArray:
    """Read numbers from trimmed text."""
    values = np.array([_float(text) if text else math.nan for text in texts], float)
    odd = np.flatnonzero(np.isnan(values) & np.array([text != "" for text in texts], bool))
    if odd.size:
        found = _fields(_with_points([texts[i] for i in odd], any("." in text for text in texts)), _NUMBER)
        values[odd] = [float(number) if number and not limit else math.nan for limit, number in found]
    return _finite(values)


def read_angles(cells: Any, unit: str = "", *, clock: bool = False) -> FloatArray:
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
    ndarray of float
        Degrees; nan where a cell is empty or no angle. No angles are minutes or seconds of more than 60, right
        ascensions of less than 0 or more than 24 h in sexagesimal text, other such angles of more than 90 degrees or in
        hours.

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
    read = _text_numbers(["" if row[1] else text for text, row in zip(texts, found, strict=True)])
    read = read if split.all() else converted(read, unit, "deg")
    hours, degrees, negative = _among(found, 2, "hH"), _among(found, 2, "dD°º"), _among(found, 0, _MINUS)
    bare = split & ~hours & ~degrees
    if clock and not (_words().get(_squeezed(unit)) == ["deg"] and np.any(whole[bare] >= 24.0)):
        hours |= bare
    angle = _joined(whole, minutes, seconds, negative, hours, clock)
    angle[(bare & np.isnan(minutes)) | (hours & (not clock))] = np.nan
    return np.where(split, angle, read)


def read_positions(cells: Any) -> tuple[FloatArray, FloatArray]:
    """Read right ascension and declination, in degrees, that stand in one cell.

    Parameters
    ----------
    cells : array_like of str, 1-D
        Text such as ``01 44 04.083 -15 56 14.93``, ``01h44m04s -15d56m14s`` or ``26.017, -15.937``.

    Returns
    -------
    right ascension, declination : ndarray of float
        As of :func:`read_angles`; both are nan where a cell is no pair.
    """
    texts = _texts(np.ma.asanyarray(cells))
    found = zip(texts, _fields(texts, _PAIR), strict=True)
    pairs = [(*filter(None, row), *[text and "no pair"] * 2)[:2] for text, row in found]
    ra, dec = (np.array([pair[place] for pair in pairs], object) for place in (0, 1))
    return read_angles(ra, clock=True), read_angles(dec)


def join_sexagesimal(
    whole: Any, minutes: Any, seconds: Any = None, sign: Any = None, *, clock: bool = False
) -> FloatArray:
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
    ndarray of float
        nan where a part is missing or no number, or out of the range of :func:`read_angles`.
    """
    first, others = np.ma.asanyarray(whole), (minutes, np.zeros(np.shape(whole)) if seconds is None else seconds)
    degrees, arcmin, arcsec = (read_numbers(cells) for cells in (first, *others))
    marks = _texts(first if sign is None else np.ma.asanyarray(sign))
    negative = np.array([mark.startswith(tuple(_MINUS)) for mark in marks], bool)
    angle = _joined(np.abs(degrees), arcmin, arcsec, negative, np.full(first.shape, clock), clock)
    return np.where(np.isnan(arcmin), np.nan, angle)


def read_dates(cells: Any, convention: str = "") -> FloatArray:
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
    ndarray of float
        Julian dates of the time scale that the table has; nan for anything else.
    """
    given = np.ma.asanyarray(cells)
    values, words = read_numbers(given), re.sub(r"[\s_,]", "", convention.lower())
    written = np.flatnonzero(np.isnan(values) & ~np.ma.getmaskarray(given))
    if counted := re.search(rf"jd\w{{0,9}}?\)?[{_MINUS}]?\(?(24\d{{5}}(?:\.\d+)?)", words):
        values = values + float(counted[1])
    elif named := re.search("|".join(_ZEROS), words):
        values = values + _ZEROS[named[0]]
    elif re.search(r"y(?:ea)?rs?\b", words):
        values = np.where((values > 1000.0) & (values < 3000.0), _julian_date(values), np.nan)
    for row in written:
        values[row] = _calendar(" ".join(str(given[row]).split()))
    return np.where((values >= _JULIAN[0]) & (values <= _JULIAN[1]), values, np.nan)


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
    for unit, is_log10 in _unit_meanings(text):
        if unit is None:
            return WrittenUnit(target.unit, True)
        if not own or unit.is_equivalent(target.unit):
            return WrittenUnit(unit, is_log10)
    raise InputError("unit", text, allowed=f"a unit like {own or 'mag, deg or mas/yr'}")


def converted(values: FloatArray, text: str, own: str) -> FloatArray:
    """Convert a column to the unit that we keep.

    Parameters
    ----------
    values : ndarray of float
    text : str
        Unit of the column as written, ``""`` if it states none: then it is `own`.
    own : str
        Our unit, in the same spellings; ``dex(cm/s2)`` and ``dex`` are logarithms.

    Returns
    -------
    ndarray of float
        nan for numbers of 0 and below of which we keep the logarithm.

    Raises
    ------
    InputError
        If the unit is not understood, or none of the quantity.
    """
    if text == own or _NO_UNIT.fullmatch(text.strip()) or _single(text) == _single(own):
        return values
    (unit, given_log), (kept, kept_log) = unit_of(text, own), unit_of(own)
    factor = float((1.0 * unit).to_value(kept))
    if given_log and kept_log and factor == 1.0:
        return values
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        linear = factor * (10.0**values if given_log else values)
        return _finite(np.log10(linear) if kept_log else linear)


def _unit_meanings(text: str) -> Iterator[tuple["UnitBase | None", bool]]:
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


CONVENTIONS = shipped_words("conventions")
"""Conventions of sources on what a number means, beyond its unit."""
_SPEED_OF_LIGHT_KM_S = 299792.458


class Column(Record):
    """One column of a shipped table or of a user's own.

    Parameters
    ----------
    name : str
        Its name, which is always accepted as a heading.
    description : str
        What it holds, in one line.
    kind : {"text", "float", "whole", "bool", "int"}
        How cells are read; ``int`` is the number of Hipparcos, which people write with and without its letters.
    unit : str
        Unit in which it is kept (astropy's spelling); of a column that names none, the unit that is assumed.
    aliases : str
        Other headings as reduced by `catalogs.table_cells.heading`, blanks between them. One with a capital letter is
        meant as it is written: ``Omega`` is another angle than ``omega``.
    low, high : float
        Range that is believed, inclusive.
    decimals : int
        Digits that a shipped table has after the point.
    fills : bool
        Whether a number such as 9999 or -99.99 stands for a missing one.
    vital : bool
        Whether a row is of no use if this cell is given and cannot be meant: elements of one orbit stand together.
    aside : bool
        Whether it only stands in for another column where that has none.
    """

    name: str
    description: str = ""
    kind: str = "text"
    unit: str = ""
    aliases: str = ""
    low: float = 0.0
    high: float = 0.0
    decimals: int = 0
    fills: bool = False
    vital: bool = False
    aside: bool = False

    @property
    def allowed(self) -> str:
        """Return what a cell may hold, in words."""
        if self.kind in ("float", "whole"):
            return f"a {'whole ' * (self.kind == 'whole')}number, {self.range}"
        words = {"bool": "yes or no, true or false, 1 or 0", "int": f"a Hipparcos number, {self.range}"}
        return words.get(self.kind, "text")

    @property
    def range(self) -> str:
        """The range in words."""
        return f"{self.low:g} to {self.high:g} {self.unit}".strip()

    def is_fill(self, value: float) -> bool:
        """Tell whether a number of the file is one that tables write where they have none: nothing but nines.

        No star has a V of exactly -1 either, while differences of magnitudes may be that; -99.9 km/s may be measured.
        """
        if not self.fills or set(f"{abs(value):.12g}".replace(".", "")) != {"9"}:
            return self.fills and value == -1.0 and self.unit == "mag" and self.low > -2.0
        return value < -9.9 if self.unit == "mag" else value < -99.9 or value > 999.0


def heading(text: str) -> str:
    """Reduce a column heading to its letters and digits, lower case: ``Sp_Type``, ``sp type``, ``SpType`` are one."""
    return _plain(text).lower()


def _plain(text: str) -> str:
    """Return a heading's letters and digits; a sign at its end is part of its meaning (``DE-`` of split angles)."""
    return re.sub(r"[^A-Za-z0-9]", "", text) + ("sign" if re.search(r"[-+]\s*$", text) else "")


class Meaning(NamedTuple):
    """The meaning of a heading of a file, or of one by which a source calls a quantity.

    Attributes
    ----------
    column : Column or None
        What it is; None if it is not known.
    unit : str
        That it names, or that its source means where the file names none.
    convention : str
        A word of `CONVENTIONS`, ``""`` for none.
    rank : int
        Place among the names of the quantity; the first are preferred.
    beside : str
        Another heading without which a file is not of that source, ``""`` if the heading says enough.
    stated : bool
        Whether the heading itself names the unit.
    heading : str
        Reduced as by the function `heading`, and meant as it is written where it has a capital letter.
    source : str
        Whose word it is.
    """

    column: "Column | None"
    unit: str = ""
    convention: str = ""
    rank: int = 0
    beside: str = ""
    stated: bool = False
    heading: str = ""
    source: str = ""


class Columns(dict[str, Column]):
    """The columns that a table may have, by name.

    Parameters
    ----------
    *columns : Column
    table : {"", "stars", "planets"}
        What kind of table it is: which other headings its columns have, and which headings mean something else with a
        capital letter.
    """

    def __init__(self, *columns: Column, table: str = "") -> None:
        super().__init__((column.name, column) for column in columns)
        self._table, self._cased = table, shipped_words(f"cased_headings_of_{table}")

    @functools.cached_property
    def by_heading(self) -> Mapping[str, Sequence[Meaning]]:
        """Return what each heading may mean, as it is reduced; what another heading must confirm comes first."""
        found: dict[str, list[Meaning]] = {heading(name): [Meaning(column)] for name, column in self.items()}
        for column in self.values():
            for rank, form in enumerate(self.synonyms_of(column.name), start=1):
                meant = form._replace(column=column, rank=rank)
                found.setdefault(form.heading, []).insert(0 if form.beside else 99, meant)
        return found

    def synonyms_of(self, name: str) -> Sequence[Meaning]:
        """Return what else people call a column, and whose word each is; of ``""`` what is known to be none of ours."""
        own = self[name].aliases.split() if name else ()
        return [*(Meaning(None, heading=form) for form in own), *synonyms_of(self._table).get(name, ())]

    def meant_by(self, text: str, others: Collection[str] = ()) -> Meaning:
        """Return what a heading means, and the unit written in it (``plx [mas]``); a column of None if unknown.

        Parameters
        ----------
        text : str
        others : collection of str
            Headings of the same file as `heading` reduces them, which may tell whose words they are.

        Raises
        ------
        InputError
            For a heading whose capitals leave open what it means (``OMEGA``).
        """
        if item := self._known(text, others):
            return item
        found = re.fullmatch(r"\s*(.*\w.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))\s*", text)
        if found and (item := self._known(found[1], others)):
            return item._replace(unit=(found[2] or found[3] or "").strip(), stated=True)
        return Meaning(None)

    def _known(self, text: str, others: Collection[str]) -> Meaning | None:
        form = _plain(text)
        if (names := self._cased.get(form.lower())) is None:
            meant = self.by_heading.get(form) or self.by_heading.get(form.lower(), ())
            return next((item for item in meant if not item.beside or item.beside in others), None)
        cased = () if form[1:2].isupper() else self.by_heading.get(form[0] + form[1:].lower(), ())
        if not cased:
            raise InputError(f"column {text}", "more than one meaning", allowed=names, hint="name it as it is meant")
        return cased[0]


def columns_of(table: str, *, only: str = "", without: str = "") -> tuple[Column, ...]:
    """Return the columns of a kind of table, in the order of ``data/columns.csv``.

    Parameters
    ----------
    table : {"stars", "planets"}
    only, without : str
        A word of the column ``rules`` that they have, or do not have: ``own`` for what a user's table may give,
        ``not_shipped`` and ``input`` for what only such a table has.
    """
    found = []
    for row in shipped_rows("columns.csv"):
        rules = row["rules"].split()
        if row["table"] == table and (not only or only in rules) and without not in rules:
            low, high = (float(row[end] or math.nan) for end in ("low", "high"))
            told: dict[str, Any] = {key: row[key] for key in ("name", "description", "kind", "unit")}
            told |= {word: word in rules for word in ("fills", "vital", "aside")}
            found.append(Column(**told, low=low, high=high, decimals=int(row["decimals"] or 0)))
    return tuple(found)


@functools.cache
def synonyms_of(table: str) -> Mapping[str, Sequence[Meaning]]:
    """Return the synonyms of the quantities of a kind of table, as ``data/headings.csv`` has them, in its order.

    Parameters
    ----------
    table : {"stars", "planets"}
    """
    found: dict[str, list[Meaning]] = {}
    for row in shipped_rows("headings.csv"):
        if row["table"] == table:
            words = row["convention"].split()
            beside = next((heading(word[7:]) for word in words if word.startswith("beside:")), "")
            convention = next((word for word in words if not word.startswith("beside:")), "")
            said = Meaning(None, row["unit"], convention, beside=beside, source=row["source"])
            found.setdefault(row["quantity"], []).extend(
                said._replace(heading=form) for form in row["headings"].split()
            )
    return found


Row = dict[str, Any]
"""One row by the names of columns; what is missing is left out."""
Groups = Sequence[Sequence[str]]
"""Names of columns; of each group a table, or a row, must have one."""

DEFAULT_ROW = "default_row"
"""Column that is 0 in rows that say again, with other numbers, what another row says: archives' other solutions."""
_YES, _NO = ("1", "1.0", "true", "t", "yes", "y"), ("0", "0.0", "false", "f", "no", "n")
_WORDS = {"name": "a unique name", "sp_type": "a spectral type such as G2V"}
_SHOWN = 40
_REASONS = 5
_ALTERNATIVES = 4
_SAME = 0.01
"""Two columns of one quantity that are closer than this part of it say the same: they are rounded apart."""
_FILL = "it stands for a missing number"


class Use(Record):
    """The quantity that one column of a file is taken for.

    Parameters
    ----------
    heading : str
        As the file has it.
    quantity : str
        Name of our column; ``""`` if the column is not used.
    unit : str
        Its unit: that of the file, or in brackets the one that is assumed.
    convention : str
        A word of `CONVENTIONS`, or ``""``.
    why : str
        Why it is not used; ``""`` if it is.
    """

    heading: str
    quantity: str
    unit: str = ""
    convention: str = ""
    why: str = ""


class Rows(Record, eq=False):
    """The rows of a table whose columns were understood; made by `read_rows`.

    Parameters
    ----------
    raw : RawTable
        The file.
    columns : Columns
        What the table may have.
    about : str
        Name of the column that says what a row is about.
    strict : bool
        Whether the first thing that cannot be used refuses the table.
    headings : dict of str to str
        What the file calls each column that it has.
    uses : tuple of Use
        What each column of the file is taken for.
    notes : list of str
        Remarks on the reading of its columns.
    rows : list of Row
        Those that can be used.
    numbers : list of int
        Number of each row in the file, from 1.
    left_out : list of LeftOut
        Rows and cells that were not used.
    """

    raw: RawTable
    columns: Columns
    about: str
    strict: bool
    headings: dict[str, str]
    uses: tuple[Use, ...]
    notes: list[str]
    rows: list[Row] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)
    left_out: list[LeftOut] = field(default_factory=list)

    @property
    def label(self) -> str:
        """Name of the file."""
        return self.raw.name

    @property
    def unused(self) -> tuple[str, ...]:
        """Headings of the file that were not used."""
        return tuple(use.heading for use in self.uses if not use.quantity)

    def __iter__(self) -> Iterator[tuple[str, Row]]:
        """Return each row after the words by which messages name it."""
        for number, row in zip(self.numbers, self.rows, strict=True):
            yield f"{self.label} row {number}" + (f" ({row[self.about]})" if self.about in row else ""), row

    def make(self, made: Callable[[str, Row], Row]) -> None:
        """Put what is made of each row in its place, and leave out the rows of which nothing can be made.

        Parameters
        ----------
        made : callable
            Takes the words by which messages name a row, and the row; raises InputError if it cannot be used.

        Raises
        ------
        InputError
            Where the table is strict, or no row is left: for the first such row.
        """
        kept: list[tuple[int, Row]] = []
        first: InputError | None = None
        cells = {(item.row, item.column): i for i, item in enumerate(self.left_out) if item.done == CELL_OUT}
        for number, (where, row) in zip(self.numbers, self, strict=True):
            try:
                kept.append((number, made(where, row)))
            except InputError as error:
                if self.strict:
                    raise
                item = _of_error(error, where, number, str(row.get(self.about, "")))
                # A row that lacks what could not be meant is left out for that.
                odd = next(
                    (i for one in item.column.split(" or ") if (i := cells.get((number, one))) is not None), None
                )
                if odd is not None and item.value == "missing":
                    item = self.left_out[odd] = replace(self.left_out[odd], name=item.name, done=ROW_OUT)
                    error = InputError(error.key, item.value, allowed=error.allowed, hint=error.hint)
                else:
                    self.left_out.append(item)
                first = first or error
        if not kept:
            raise first or self._refused()
        self.numbers[:], self.rows[:] = map(list, zip(*kept, strict=True))

    def _refused(self) -> InputError:
        """Return why a table is refused of which nothing is left, for its first row."""
        if not self.left_out:
            return InputError(self.label, "no rows", allowed="at least one row")
        item = self.left_out[0]
        who = f" ({item.name})" if item.name else ""
        key = f"{self.label} row {item.row}{who} column {item.column}"
        return InputError(key, item.value, allowed=item.why.removeprefix("allowed: "))

    def remarks(self) -> tuple[str, ...]:
        """Return remarks on the reading: on columns, how many rows are left out by which reasons, the first of each."""
        found = list(self.notes)
        for done, thing in ((ROW_OUT, "row"), (CELL_OUT, "cell")):
            items = [item for item in self.left_out if item.done == done]
            number = len({item.row for item in items}) if done == ROW_OUT else len(items)
            why = [f"{count} because of {item.column} ({_first(item)})" for item, count in reasons(items)]
            if more := why[_REASONS:]:
                why[_REASONS:] = [f"and {len(more)} more reasons: the list of rejects has all"]
            what = f"{number} {thing}{'s' * (number != 1)} {done.removeprefix('row ')}"
            found += [f"{self.label}: {what}: {'; '.join(why)}"] if items else []
        return tuple(found)

    def refuse_lacking(self, groups: Groups) -> None:
        """Refuse a table that has no column of one of the groups.

        Parameters
        ----------
        groups : sequence of sequence of str

        Raises
        ------
        InputError
            Naming the columns, what they may be called, and what the file has.
        """
        lacking = [group for group in groups if not any(name in self.headings for name in group)]
        if lacking:
            needed = [name for group in lacking for name in group[:_ALTERNATIVES]]
            called = {name: ", ".join(item.heading for item in self.columns.synonyms_of(name)[:6]) for name in needed}
            forms = "; ".join(f"{name} ({called[name]}, ...)" for name in needed)
            wanted = ", ".join(" or ".join(group[:_ALTERNATIVES]) for group in lacking)
            # With one known column or none it may be any file at all, and is not quoted.
            names = f": {listed([use.heading for use in self.uses])}"
            hint = f"the file has{names if len(self.headings) > 1 else f' {len(self.uses)} columns'}"
            odd = [f"{use.heading} has a {use.why}" for use in self.uses if use.why.startswith("unit")]
            raise InputError(f"{self.label} column {wanted}", "missing", allowed=forms, hint="; ".join((*odd, hint)))

    def refuse_missing(self, where: str, row: Row, groups: Groups) -> None:
        """Refuse a row that has nothing of one of the groups.

        Parameters
        ----------
        where : str
            Words for the row.
        row : Row
        groups : sequence of sequence of str

        Raises
        ------
        InputError
            Naming the columns and what they may hold.
        """
        for names in groups:
            if not any(name in row for name in names):
                own = [name for name in names if name in self.headings] or list(names[:_ALTERNATIVES])
                allowed = " or ".join(_WORDS.get(name) or self.columns[name].allowed for name in own)
                column = " or ".join(self.headings.get(name, name) for name in own)
                raise InputError(f"{where} column {column}", "missing", allowed=allowed)

    def refuse_twins(
        self, key: Callable[[Row], Hashable], *, date: Callable[[Row], str] = lambda row: "", remedy: str = ""
    ) -> None:
        """Refuse rows that are about what another row is about: they are left out, or the table is refused.

        Parameters
        ----------
        key : callable
            What is the same for all names of one thing.
        date : callable
            Tells which of them stays: the one of the latest date, and of one date the first row.
        remedy : str
            What to do about it.

        Raises
        ------
        InputError
            Where the table is strict: naming both rows.
        """
        newest = sorted(range(len(self.rows)), key=lambda i: date(self.rows[i]), reverse=True)
        self.numbers[:], self.rows[:] = [self.numbers[i] for i in newest], [self.rows[i] for i in newest]
        first: dict[Hashable, int] = {}
        numbers = iter(list(self.numbers))

        def new(where: str, row: Row) -> Row:
            number = next(numbers)
            if (earlier := first.setdefault(key(row), number)) != number:
                hint = "; ".join(filter(None, (f"rows {earlier} and {number} are of one name", remedy)))
                column = f"{where} column {self.headings.get(self.about, self.about)}"
                raise InputError(column, row[self.about], allowed=f"every {self.about} once", hint=hint)
            return row

        self.make(new)
        pairs = sorted(zip(self.numbers, self.rows, strict=True), key=lambda pair: pair[0])
        self.numbers[:], self.rows[:] = map(list, zip(*pairs, strict=True))


def _first(item: LeftOut) -> str:
    """Say what is wrong in the first row of a reason; what is missing needs no range."""
    where = f"row {item.row}{', ' * bool(item.name)}{item.name}"
    return f"first missing in {where}" if item.value == "missing" else f"first {item.value} in {where}; {item.why}"


def _of_error(error: InputError, where: str, number: int, name: str) -> LeftOut:
    """Return what a refused row is on the list."""
    column = error.key.removeprefix(f"{where} column ")
    hint = re.sub(r"^rows \d+ and \d+ are of one name(; )?", "", error.hint)
    why = "; ".join(filter(None, (f"allowed: {error.allowed}" if error.allowed else "", hint)))
    return LeftOut(number, name, column, str(error.value)[:_SHOWN], why, ROW_OUT)


def reasons(left_out: Iterable[LeftOut]) -> list[tuple[LeftOut, int]]:
    """Return the first row or cell of each reason for which some are left out, and how many there are; most first."""
    found: dict[tuple[bool, str, str], list[LeftOut]] = {}
    for item in sorted(left_out, key=lambda item: item.row):
        found.setdefault((item.done != ROW_OUT, item.column, item.why), []).append(item)
    most_first = sorted(found.items(), key=lambda pair: (pair[0][0], -len(pair[1])))
    return [(items[0], len(items)) for _, items in most_first]


def read_rows(raw: RawTable, columns: Columns, required: Groups, *, about: str, strict: bool = True) -> Rows:
    """Return the rows of a table, every cell in the unit of its column and checked.

    Parameters
    ----------
    raw : RawTable
        What :func:`catalogs.table_files.parse_table` read.
    columns : Columns
        What it may have.
    required : sequence of sequence of str
        Of each of these groups the table must have a column; texts of the first two say what a row is about where no
        column ``about`` does.
    about : str
        Name of the column that says what a row is about.
    strict : bool
        Refuse the table for the first cell that is not accepted; else it is taken as missing, or its row is left out
        where the column is vital, and `Rows.left_out` says so. Rows with 0 in `DEFAULT_ROW` are
        read only where no other row is about the same.

    Raises
    ------
    InputError
        Naming file, row, column, value, unit and range: a required column is missing, two columns claim to be one, a
        unit is not understood, or a cell is not what its column holds.
    """
    chosen, uses = _chosen(raw, columns, strict)
    headings = {name: found[0][0].heading for name, found in chosen.items()}
    given = Rows(raw, columns, about, strict, headings, uses, list(raw.notes))
    given.refuse_lacking(required)
    if given.unused:
        given.notes.append(f"{raw.name}: columns not used: {listed(given.unused)}")
    reading = _Reading(given)
    place = chosen["ra_deg"][0][1].convention if "ra_deg" in chosen else ""
    others = [name for group in required[:2] for name in group if columns[name].kind in ("text", "int")]
    numbered = chosen[about][0][0] if about in chosen and columns[about].kind != "text" else None
    naming = [about] if about in chosen else [name for name in others if name in chosen]
    values = {name: reading.merged(columns[name], chosen.pop(name)) for name in naming}
    if default := chosen.pop(DEFAULT_ROW, None):
        kept = reading.keep_default_rows(columns[DEFAULT_ROW], default, [*zip(*values.values(), strict=True)])
        values = {name: np.array(cells, object)[kept].tolist() for name, cells in values.items()}
    reading.names = values.get(about, [None] * len(reading.numbers))
    if numbered is not None:  # a row is called what the file calls it, whatever its unit
        reading.names = reading.cells(numbered).tolist()
    values |= {name: reading.merged(columns[name], found) for name, found in chosen.items()}
    for item in raw.rejects:
        if strict:
            raise raw.refusal_of(item)
        given.left_out.append(item)
    lost = {item.row for item in given.left_out if item.done == ROW_OUT}
    lines = zip(*values.values(), strict=True) if values else iter([()] * len(reading.numbers))
    for number, line in zip(reading.numbers.tolist(), lines, strict=True):
        if number not in lost:
            given.numbers.append(number)
            given.rows.append({name: cell for name, cell in zip(values, line, strict=True) if cell is not None})
    if epoch := re.fullmatch(r"j(\d+(?:\.\d+)?)", place):
        for row in given.rows:
            row.setdefault("epoch_yr", float(epoch[1]))
    return given


_Chosen = dict[str, list[tuple[RawColumn, Meaning]]]


def _meanings(raw: RawTable, columns: Columns) -> list[Meaning]:
    """Return what each column of a file means: by its heading, or else by a UCD that no other column has."""
    others = frozenset(heading(column.heading) for column in raw.columns)
    try:
        found = [columns.meant_by(column.heading, others) for column in raw.columns]
    except InputError as error:
        raise InputError(f"{raw.name} {error.key}", error.value, allowed=error.allowed, hint=error.hint) from None
    foreign = {item.heading for item in columns.synonyms_of("")}
    said = [
        columns.meant_by(column.ucd)
        if meant.column is None and heading(column.heading) not in foreign
        else Meaning(None)
        for column, meant in zip(raw.columns, found, strict=True)
    ]
    times = Counter(meant.column for meant in (*found, *said))
    return [one if one.column or times[two.column] > 1 else two for one, two in zip(found, said, strict=True)]


def _chosen(raw: RawTable, columns: Columns, strict: bool) -> tuple[_Chosen, tuple[Use, ...]]:
    """Return the columns of the file for each of ours, those that are preferred first; and what each is taken for."""
    found: _Chosen = {}
    uses: list[Use] = []
    exact = {column.heading for column in raw.columns} & set(columns)
    for column, meant in zip(raw.columns, _meanings(raw, columns), strict=True):
        unit = column.unit or meant.unit
        unused = Use(column.heading or "(no heading)", "", unit)
        if meant.column is None:
            uses.append(replace(unused, why="not known"))
        elif (name := meant.column.name) in exact and column.heading != name:
            uses.append(replace(unused, why=f"{name} is read"))
        elif allowed := _unit_problem(meant.column, unit, meant.convention):
            if strict:
                raise InputError(f"{raw.name} column {column.heading}", f"unit {unit}", allowed=allowed)
            uses.append(replace(unused, why=f"unit not understood, allowed: {allowed}"))
        else:
            assumed = f"[{unit or meant.column.unit}]" if meant.column.unit else ""
            said = unit if column.unit or meant.stated else assumed
            uses.append(Use(column.heading, name, said, meant.convention))
            found.setdefault(name, []).append((column, meant._replace(unit=unit)))
    for name, several in found.items():
        several.sort(key=lambda item: item[1].rank)
        if strict and len(several) > 1 and several[0][1].convention == several[1][1].convention:
            both = " and ".join(use.heading for use in uses if use.quantity == name)
            raise InputError(f"{raw.name} columns", both, allowed=f"one column for {name}", hint=f"name it {name}")
    return found, tuple(uses)


class _Reading:
    """The cells of a file's columns, in the units of ours and checked; what is not accepted goes on a list."""

    def __init__(self, given: Rows) -> None:
        self.given, self.numbers = given, given.raw.numbers
        self.kept: NDArray[np.bool_] | slice = slice(None)
        self.names: list[Any] = [None] * len(given.raw)

    def keep_default_rows(
        self, column: Column, found: list[tuple[RawColumn, Meaning]], names: Sequence[Hashable]
    ) -> NDArray[np.bool_]:
        """Leave out the rows that say again, with other numbers, what the default row of the same name says."""
        default = [cell is not False for cell in self.merged(column, found)]
        names = names or [()] * len(default)
        named = {name for name, own in zip(names, default, strict=True) if own}
        kept = np.array([own or name not in named for name, own in zip(names, default, strict=True)], bool)
        self.kept, self.numbers = kept, self.numbers[kept]
        if dropped := int(np.count_nonzero(~kept)):
            what = f"{dropped} row{'s are' if dropped > 1 else ' is'} not the default solution of a planet"
            self.given.notes.append(f"{self.given.label}: {what}: not read")
        return kept

    def merged(self, column: Column, found: list[tuple[RawColumn, Meaning]]) -> list[Any]:
        """Return the cells of one column of ours: errors of both sides as their mean, gaps of one from the next."""
        limits = [given for given, meant in found if meant.convention == "limit"]
        read = [(self.read(column, *item), item) for item in found if item[1].convention != "limit"]
        if not read:
            return [None] * len(self.numbers)
        sides = [values for values, (_, meant) in read if meant.convention.startswith("error_")]
        if len(sides) > 1 and len(sides) == len(read):
            return _mean_of_sides(sides)
        values, (first, _) = read[0]
        for others, (given, _) in read[1:]:
            odd = 0 if column.kind == "text" or column.aside else sum(map(_differ, values, others))
            if odd:
                same = f"{self.given.label}: {column.name} is that of {first.heading}, from which"
                self.given.notes.append(f"{same} {given.heading} differs in {odd} row{'s' * (odd > 1)}")
            values = [other if value is None else value for value, other in zip(values, others, strict=True)]
        for given in limits:
            said = self.cells(given)
            if set(said.compressed().tolist()) <= {"0", "0.0", 0}:
                continue
            flags = read_numbers(np.ma.filled(said.astype(object), 0))
            values = [None if flag else value for value, flag in zip(values, flags.tolist(), strict=True)]
        return values

    def read(self, column: Column, given: RawColumn, meant: Meaning) -> list[Any]:
        """Return the cells of one column of the file; None where missing."""
        whole = self.cells(given)
        cells, there = np.ma.getdata(whole), np.flatnonzero(~np.ma.getmaskarray(whole))
        fills = np.zeros(len(there), bool)
        if column.kind in ("float", "whole"):
            numbers, good, fills = _read_numbers(column, given.heading, meant, cells[there])
            with np.errstate(invalid="ignore"):
                good &= (numbers >= column.low) & (numbers <= column.high) & ~fills
                if column.kind == "whole":
                    good &= numbers % 1 == 0
            found: list[Any] = numbers.tolist()
        else:
            found = [_understood(column.kind, cell) for cell in cells[there].tolist()]
            good = np.array([cell is not NotImplemented for cell in found], bool)
            if meant.convention.startswith("gaia_dr"):
                release = f"Gaia DR{meant.convention[-1]}"
                found = [f"{release} {cell}" if str(cell).isdigit() else cell for cell in found]
        values = np.full(len(cells), None, object)
        values[there[good]] = np.array(found, object)[good]
        for place, fill in zip(there[~good].tolist(), fills[~good].tolist(), strict=True):
            self._leave_out(column, given.heading, meant.unit, (place, cells[place]), fill=fill)
        return list(values)

    def cells(self, given: RawColumn) -> "np.ma.MaskedArray[Any, Any]":
        """Return the cells of a column of the file in the rows that are read."""
        return given.cells[self.kept]

    def _leave_out(self, column: Column, heading_: str, unit: str, at: tuple[int, Any], *, fill: bool) -> None:
        """Put a cell that is not accepted on the list; refuse it where the table is strict."""
        (place, cell), number = at, int(self.numbers[at[0]])
        name = self.names[place]
        unit = (unit or column.unit) if column.kind in ("float", "whole") else ""
        hint = "write a decimal point" if isinstance(cell, str) and "," in cell else _FILL if fill else ""
        if self.given.strict:
            who = "" if name is None else f" ({name})"
            hint += ": leave the cell empty" if fill else ""
            key = f"{self.given.label} row {number}{who} column {heading_}"
            raise InputError(key, str(cell)[:_SHOWN], unit=unit, allowed=column.allowed, hint=hint)
        why = "; ".join(filter(None, (f"allowed: {column.allowed}", hint)))
        done = ROW_OUT if column.vital and not fill else CELL_OUT
        self.given.left_out.append(LeftOut(number, name or "", heading_, f"{cell} {unit}".strip()[:_SHOWN], why, done))


def _read_numbers(
    column: Column, heading_: str, meant: Meaning, cells: NDArray[Any]
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
    """Return cells as numbers in the unit of a column; which of them are some; and which stand for missing ones."""
    numbers = read_numbers(cells)
    good, fills = np.isfinite(numbers), np.zeros(len(cells), bool)
    if column.fills:
        fills[good] = _fills(column, numbers[good])
    unit, convention = meant.unit, meant.convention
    date = column.name.endswith("_jd")
    if convention == "rad_or_deg" and (np.abs(numbers[good]) > 2.0 * math.pi).any():
        unit = "deg"
    if convention == "log10" and not re.match(r"\s*\[?(?:dex|log)", unit):
        unit = f"log({unit or column.unit})"
    if convention == "jd_auto":
        numbers = np.where((numbers > 1000.0) & (numbers < 10000.0), numbers + 2450000.0, numbers)
    if date:
        if not (good & (numbers > 2.4e6) & (numbers < 2.5e6)).all():
            mixed = np.where(good, numbers.astype(object), cells)
            numbers = read_dates(mixed, f"{heading_} {unit} {'' if convention == 'jd_auto' else convention}")
    elif column.name in ("ra_deg", "dec_deg") and not (good.all() and unit in ("", column.unit)):
        numbers = read_angles(cells, unit, clock=column.name == "ra_deg")
    elif convention != "redshift" or not good.all():
        numbers = converted(numbers, unit, column.unit)
    numbers = _by_convention(numbers, convention)
    return numbers, np.isfinite(numbers), fills


def _mean_of_sides(sides: Sequence[Sequence[Any]]) -> list[Any]:
    """Return the mean of the errors of both sides, of those that are given; archives write 0 where nobody gave one."""
    errors = np.abs(np.array(sides, np.float64))
    there = np.isfinite(errors) & (errors > 0.0)
    count = there.sum(axis=0)
    mean = np.where(there, errors, 0.0).sum(axis=0) / np.maximum(count, 1)
    found = mean.astype(object)
    found[count == 0] = None
    return list(found)


def _fills(column: Column, numbers: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which numbers stand for missing ones; those of nothing but nines begin with one."""
    with np.errstate(divide="ignore", invalid="ignore"):
        leading = np.abs(numbers) / 10.0 ** np.floor(np.log10(np.abs(numbers)))
    found = np.asarray((leading >= 9.0) | (numbers == -1.0), bool)
    found[found] = [column.is_fill(value) for value in numbers[found].tolist()]
    return found


def _by_convention(numbers: NDArray[np.float64], convention: str) -> NDArray[np.float64]:
    """Return numbers as we write them: errors above 0, velocities."""
    if convention.startswith("error_"):
        return np.abs(numbers)
    return numbers * _SPEED_OF_LIGHT_KM_S if convention == "redshift" else numbers


def _differ(one: Any, other: Any) -> bool:
    """Tell whether two cells say different things."""
    if one is None or other is None:
        return False
    if isinstance(one, float) and isinstance(other, float):
        return abs(one - other) > _SAME * max(abs(one), abs(other))
    return bool(one != other)


def _understood(kind: str, cell: Any) -> Any:
    """Return a cell that is no number, NotImplemented if it is not accepted."""
    try:
        return _READERS[kind](cell)
    except (ValueError, OverflowError):
        return NotImplemented


def _text(cell: Any) -> str | None:
    """Return a text; a number that a program wrote with a point because others are missing is whole (10700.0)."""
    plain = type(cell) is str and "  " not in cell and cell.isprintable()
    text = cell if plain else " ".join(str(cell).split())
    return (text[:-2] if text.endswith(".0") and text[:-2].isdigit() else text) or None


def _flag(cell: Any) -> bool:
    text = str(cell).strip().lower()
    if text not in _YES + _NO:
        raise ValueError
    return text in _YES


def _hip(cell: Any) -> int | str | None:
    """Return a Hipparcos number; as it is written where the letter of a component follows it."""
    found = re.fullmatch(r"(?:HIP[\s_]*)?(\d+)(?:\.0*)?([\s_]*[A-E]{0,2})[\s_]*", str(cell).strip(), re.IGNORECASE)
    if not found or int(found[1]) > 120404:
        raise ValueError
    return f"{found[1]}{found[2].strip(' _')}" if found[2].strip(" _") else int(found[1]) or None


_READERS: dict[str, Callable[[Any], Any]] = {"text": _text, "bool": _flag, "int": _hip}


def _unit_problem(column: Column, unit: str, convention: str) -> str:
    """Return which units a column may have if this is none of them; ``""`` if it is."""
    if column.kind not in ("float", "whole") or unit in ("", column.unit) or convention == "redshift":
        return ""
    if column.name.endswith("_jd"):
        return ""

    try:
        meant = unit_of(unit, column.unit or "1")
    except InputError as error:
        return error.allowed if column.unit else "none"
    return "none" if meant.is_log10 and not column.unit else ""
