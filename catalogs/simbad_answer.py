"""SIMBAD's answers as checked columns: one table of names, old and new, and refusal of what cannot be right."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.simbad import RefreshError

__all__ = ["ALIASES", "Answer", "Measurements", "read_measurements", "read_stars"]

FloatArray = NDArray[np.float64]

ALIASES: dict[str, tuple[str, ...]] = {
    "oid": ("oid", "oidref"),
    "main_id": ("main_id", "main id"),
    "ra": ("ra", "ra_d", "ra(d)"),
    "dec": ("dec", "dec_d", "dec(d)"),
    "plx_value": ("plx_value", "plx"),
    "plx_err": ("plx_err", "plx_error"),
    "pmra": ("pmra",),
    "pmdec": ("pmdec",),
    "rvz_radvel": ("rvz_radvel", "rv_value", "radvel"),
    "sp_type": ("sp_type", "sptype", "sp"),
    "otype": ("otype", "otype(s)", "otype_s", "otype(v)"),
    "b": ("b", "flux_b", "flux(b)"),
    "v": ("v", "flux_v", "flux(v)"),
    "ids": ("ids",),
    "oidref": ("oidref", "oid"),
    "teff": ("teff", "mesfe_h.teff", "fe_h_teff"),
    "log_g": ("log_g", "mesfe_h.log_g", "fe_h_log_g", "logg"),
    "fe_h": ("fe_h", "mesfe_h.fe_h", "fe_h_fe_h", "feh"),
    "bibcode": ("bibcode", "mesfe_h.bibcode", "fe_h_bibcode"),
    "mespos": ("mespos", "mesfe_h.mespos", "fe_h_mespos"),
}
"""Column asked for -> names that the answer may give it, in lower case: of TAP, of ``add_votable_fields``, and of
astroquery before 0.4.8."""

_UNITS = {
    "ra": "deg",
    "dec": "deg",
    "plx_value": "mas",
    "plx_err": "mas",
    "pmra": "mas / yr",
    "pmdec": "mas / yr",
    "rvz_radvel": "km / s",
    "teff": "K",
}
_MISSING_TEXTS = frozenset(("", "nan", "--", "~", "null", "none"))
_REMEDY = "SIMBAD may have changed or the service is not SIMBAD; catalogues already here stay as they are"


@dataclass(frozen=True)
class Answer:
    """The stars as SIMBAD lists them, arrays of one length; nan where a number is missing."""

    oid: NDArray[np.int64]
    main_id: list[str]
    ra_deg: FloatArray
    dec_deg: FloatArray
    parallax_mas: FloatArray
    parallax_err_mas: FloatArray
    pm_ra_mas_yr: FloatArray
    pm_dec_mas_yr: FloatArray
    rv_km_s: FloatArray
    sp_type: list[str]
    object_type: list[str]
    b_mag: FloatArray
    v_mag: FloatArray
    ids: list[tuple[str, ...]]

    def __len__(self) -> int:
        return len(self.main_id)


@dataclass(frozen=True)
class Measurements:
    """Spectroscopic measurements, one row each; `oid` says of which star."""

    oid: NDArray[np.int64]
    teff_k: FloatArray
    log_g: FloatArray
    fe_h: FloatArray
    bibcode: list[str]

    def __len__(self) -> int:
        return len(self.bibcode)


def read_stars(table: Any) -> Answer:
    """Check the answer to the first question.

    Parameters
    ----------
    table : astropy.table.Table
        Columns under any name of :data:`ALIASES`.

    Raises
    ------
    RefreshError
        If it is empty, lacks a column, lists a star twice, or has a star without position, parallax or V.
    """
    if len(table) == 0:
        raise RefreshError("the answer holds no star", "check --v-mag-max and --parallax-min-mas, or the service")
    answer = Answer(
        oid=_whole(table, "oid"),
        main_id=_texts(table, "main_id"),
        ra_deg=_angles(table, "ra"),
        dec_deg=_angles(table, "dec"),
        parallax_mas=_numbers(table, "plx_value"),
        parallax_err_mas=_numbers(table, "plx_err"),
        pm_ra_mas_yr=_numbers(table, "pmra"),
        pm_dec_mas_yr=_numbers(table, "pmdec"),
        rv_km_s=_numbers(table, "rvz_radvel"),
        sp_type=_texts(table, "sp_type"),
        object_type=_texts(table, "otype"),
        b_mag=_numbers(table, "b"),
        v_mag=_numbers(table, "v"),
        ids=[
            tuple(filter(None, (" ".join(name.split()) for name in text.split("|")))) for text in _texts(table, "ids")
        ],
    )
    for what, values in (("oid", answer.oid.tolist()), ("main_id", answer.main_id)):
        seen: set[object] = set()
        for value, name in zip(values, answer.main_id, strict=True):
            if value in seen or value == "":
                raise RefreshError(f"the answer lists {name or 'a star without a name'} twice (same {what})", _REMEDY)
            seen.add(value)
    checks = (
        ("parallax", answer.parallax_mas, 1e-3, 1e3),
        ("V magnitude", answer.v_mag, -30.0, 30.0),
        ("right ascension", answer.ra_deg, 0.0, 360.0),
        ("declination", answer.dec_deg, -90.0, 90.0),
    )
    for what, numbers, low, high in checks:
        wrong = np.flatnonzero(~((numbers >= low) & (numbers <= high)))
        if wrong.size:
            i = int(wrong[0])
            shown = "no" if np.isnan(numbers[i]) else f"an impossible ({numbers[i]:g})"
            raise RefreshError(f"the answer has {shown} {what} for {answer.main_id[i]}", _REMEDY)
    return answer


def read_measurements(table: Any) -> Measurements:
    """Check the answer to the second question; an empty one is fine.

    Values that cannot be meant (temperature outside 2000 to 50 000 K, gravity outside -2 to 7, metallicity outside
    -5 to 1.5) count as missing: the table holds misprints of the literature.

    Raises
    ------
    RefreshError
        If it lacks a column.
    """
    return Measurements(
        oid=_whole(table, "oidref"),
        teff_k=_within(_numbers(table, "teff"), 2000.0, 50000.0),
        log_g=_within(_numbers(table, "log_g"), -2.0, 7.0),
        fe_h=_within(_numbers(table, "fe_h"), -5.0, 1.5),
        bibcode=_texts(table, "bibcode"),
    )


def _within(values: FloatArray, low: float, high: float) -> FloatArray:
    return np.where((values >= low) & (values <= high), values, np.nan)


def _column(table: Any, name: str) -> Any:
    names = {str(given).lower(): given for given in reversed(table.colnames)}
    for alias in ALIASES[name]:
        if alias in names:
            return table[names[alias]]
    raise RefreshError(f"the answer lacks the column {name} (it has: {', '.join(table.colnames)})", _REMEDY)


def _cells(column: Any) -> list[object]:
    """Return the cells, None where masked."""
    masked = np.ma.getmaskarray(column)
    if column.dtype == np.float32:  # 7.3 shall be 7.3, not 7.300000190734863
        column = column.astype(str)
    return [None if gone else cell for cell, gone in zip(column.tolist(), masked.tolist(), strict=True)]


def _text(cell: object) -> str:
    text = cell.decode("utf-8", "replace") if isinstance(cell, bytes) else str(cell if cell is not None else "")
    return " ".join(text.split())


def _texts(table: Any, name: str) -> list[str]:
    return [_text(cell) for cell in _cells(_column(table, name))]


def _numbers(table: Any, name: str) -> FloatArray:
    column = _column(table, name)
    values = np.array([_number(cell, name) for cell in _cells(column)], dtype=np.float64)
    wanted, unit = _UNITS.get(name), getattr(column, "unit", None)
    if wanted is None or unit is None or str(unit) == "":
        return values
    from astropy import units

    try:
        return np.asarray(units.Quantity(values, unit).to_value(wanted), dtype=np.float64)
    except (units.UnitConversionError, TypeError, ValueError):
        raise RefreshError(f"the answer gives {name} in {unit}, not in {wanted}", _REMEDY) from None


def _number(cell: object, name: str) -> float:
    if isinstance(cell, int | float | np.number):
        return float(cell)
    text = _text(cell)
    if text.lower() in _MISSING_TEXTS:
        return float("nan")
    try:
        return float(text)
    except ValueError:
        raise RefreshError(f"the answer has {text[:40]!r} for {name}, which is no number", _REMEDY) from None


def _angles(table: Any, name: str) -> FloatArray:
    """Return degrees; text in hours or degrees, minutes and seconds is what SIMBAD gave before TAP."""
    cells = _cells(_column(table, name))
    if not any(isinstance(cell, str | bytes) and len(_text(cell).split()) > 1 for cell in cells):
        return _numbers(table, name)
    from astropy.coordinates import Angle

    unit = "hourangle" if name == "ra" else "deg"
    try:
        return np.array([Angle(_text(cell), unit=unit).deg for cell in cells], dtype=np.float64)
    except ValueError as error:
        raise RefreshError(f"the answer has an unreadable {name}: {error}", _REMEDY) from None


def _whole(table: Any, name: str) -> NDArray[np.int64]:
    values = _numbers(table, name)
    if not np.all(np.isfinite(values)):
        raise RefreshError(f"the answer has rows without {name}", _REMEDY)
    return values.astype(np.int64)
