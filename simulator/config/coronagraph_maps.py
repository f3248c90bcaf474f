"""A coronagraph as maps: what it does to the star and to a planet, by their place on the detector.

An npz file has arrays, a FITS file images, named as the columns of a table (`simulator.config.coronagraph_table`).
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import FloatArray, InputError, NDArray, read_file
from simulator.config.coronagraph_table import (
    COLUMNS,
    CONSTANT,
    KEY,
    MOST_BYTES_OF_MAPS,
    REQUIRED,
    CoronagraphTable,
    checked,
    sha256_of,
)
from simulator.config.map_files import MapFile, header_number, pixel_scale, read_maps, real_map

_SIDES = (9, 4001)
_MAPS = tuple(
    name
    for name in COLUMNS
    if name not in CONSTANT and not name.startswith(("separation", "star_columns", "source_peak"))
)
_SQUARES = ("contrast_stability", "speckle_variance_per_nm2", "speckle_variance_per_nm4")
_EDGES = ("inner_arcsec", "outer_arcsec", "inner_lambda_d", "outer_lambda_d")
_SCALES = ("pixel_scale_arcsec", "pixel_scale_lambda_d")


def read_coronagraph_maps(path: str, lambda_d_arcsec: float) -> CoronagraphTable:
    """Read the maps of a band: a table of their means over rings, with the maps beside it.

    Parameters
    ----------
    path : str
    lambda_d_arcsec : float
        lambda/D of the band.

    Raises
    ------
    InputError
        If the file cannot be read, lacks a map or the scale, or a map is not square of one odd side, out of range or
        not finite.
    """
    name = Path(path).name
    data = read_file(path, key=KEY, allowed="a readable FITS or npz file", max_bytes=MOST_BYTES_OF_MAPS)
    file = read_maps(KEY, path)
    maps, side = {}, 0
    for column in _MAPS:
        found = file.named(column)
        if found is not None and found.data.ndim:
            maps[column] = real_map(f"{name} {column}", name, found.data, sides=_SIDES)
            side = side or len(maps[column])
            _check_map(name, column, maps[column], side)
    for group in REQUIRED[1:]:
        if not any(one in maps for one in group):
            raise InputError(f"{name} map {group[0]}", "missing", allowed=f"an array or image of the name {group[0]}")
    numbers = _numbers(name, path, file)
    if "pixel_scale_lambda_d" in numbers:
        step = numbers["pixel_scale_lambda_d"] * lambda_d_arcsec
    elif "pixel_scale_arcsec" in numbers:
        step = numbers["pixel_scale_arcsec"]
    else:
        raise InputError(f"{name} pixel_scale_arcsec", "missing", unit="arcsec", allowed="or pixel_scale_lambda_d")
    if not step > 0:
        raise InputError(f"{name} pixel_scale_arcsec", step, unit="arcsec", allowed="above 0")
    if "core_area_lambda_d2" in maps:
        maps.setdefault("core_area_arcsec2", maps.pop("core_area_lambda_d2") * lambda_d_arcsec**2)
    offset = np.arange(side) - side // 2
    ring = np.hypot(offset[:, None], offset)
    rings = {column: _means(values, ring, squares=column in _SQUARES) for column, values in maps.items()}
    place = np.asarray(step * np.arange(side // 2), np.float64)
    inner, outer = _edges(numbers, place, rings["core_throughput"], lambda_d_arcsec)
    kept = (place >= inner - 0.5 * step) & (place <= outer + 0.5 * step) & (place > 0)
    if np.count_nonzero(kept) < 2:
        allowed = f"an inner and an outer edge with two pixels between them, 0 to {place[-1]:.4g} arcsec"
        raise InputError(f"{name} inner_arcsec, outer_arcsec", (inner, outer), unit="arcsec", allowed=allowed)
    columns = {column: values[kept] for column, values in rings.items()}
    columns |= {one: np.full(kept.sum(), numbers[one]) for one in CONSTANT if one in numbers}
    return checked(CoronagraphTable(name, sha256_of(data), place[kept], columns, (), maps, step))


def _check_map(name: str, column: str, values: FloatArray, side: int) -> None:
    limits = COLUMNS[column]
    if len(values) != side or side % 2 == 0:
        allowed = "square maps of one odd side, the star on the middle pixel"
        raise InputError(f"{name} map {column}", f"{len(values)} pixels a side", allowed=allowed)
    if (values.min() < limits.low and values.min() != 0.0) or values.max() > limits.high:
        worst = float(values.min() if values.min() < limits.low else values.max())
        raise InputError(f"{name} map {column}", worst, unit=limits.unit, allowed=limits.range)


def _numbers(name: str, path: str, file: MapFile) -> dict[str, float]:
    """Return the scale, edges and constants of the file: arrays of one number, or cards of the header."""
    found: dict[str, float] = {}
    for key in (*_SCALES, *_EDGES, *CONSTANT):
        item = file.named(key)
        if item is not None and item.data.size == 1:
            found[key] = _number(name, key, item.data)
    if file.is_fits:
        header = file.maps[0].header
        for key, card in zip((*_EDGES, _SCALES[1]), ("INNER", "OUTER", "INNERLD", "OUTERLD", "PIXLD"), strict=True):
            value = header_number(KEY, path, header, card)
            if value is not None:
                found[key] = value
        scale = pixel_scale(KEY, path, header)
        if scale is not None and _SCALES[1] not in found:
            found[_SCALES[0]] = scale
    return found


def _number(name: str, key: str, data: NDArray[Any]) -> float:
    if data.dtype.kind not in "fiu" or not np.isfinite(data).all():
        raise InputError(f"{name} {key}", str(data.tolist())[:40], allowed="one finite number")
    return float(data.reshape(()))


def _edges(
    numbers: Mapping[str, float], place: FloatArray, core: FloatArray, lambda_d_arcsec: float
) -> tuple[float, float]:
    """Return the separations of the search for planets: from half of the largest core to the edge of the map."""
    most = float(place[-1])
    first = float(place[int(np.argmax(core >= 0.5 * core.max()))])
    inner = numbers.get("inner_arcsec", numbers.get("inner_lambda_d", math.nan) * lambda_d_arcsec)
    outer = numbers.get("outer_arcsec", numbers.get("outer_lambda_d", math.nan) * lambda_d_arcsec)
    return (first if math.isnan(inner) else inner), min(most, most if math.isnan(outer) else outer)


def _means(values: FloatArray, ring: FloatArray, *, squares: bool) -> FloatArray:
    """Return the means over rings one pixel wide, of rms values of their squares."""
    number = np.rint(ring).astype(int).ravel()
    weights = (values**2 if squares else values).ravel()
    mean = (np.bincount(number, weights) / np.bincount(number))[: len(values) // 2]
    return np.asarray(np.sqrt(mean) if squares else mean)
