"""The observing bands: centre, width, optical transmission and quantum efficiency, each with its source."""

import functools
from pathlib import Path
from typing import Any

import numpy as np

from catalogs.curves import read_curve
from catalogs.spectra import Curve
from cpic_core import ArrayLike, InputError, Provenance, Record, load_yaml, read_file, split_sourced

#: The two cameras.
CAMERAS = ("VIS", "NIR")

_FILE = Path(__file__).resolve().parent / "data" / "bands.yaml"
_MAX_BYTES = 200_000_000


class Band(Record, eq=False):
    """One observing band.

    Two bands are equal when all their numbers are; a band can be a dictionary key.

    Attributes
    ----------
    name : str
        Band name, for example ``F662``.
    camera : {"VIS", "NIR"}
        The camera that sees it.
    center_nm, width_nm : float
        Centre and full width; the edges of the top-hat when there is no curve.
    t_opt : float
        Mirrors, relay, DM reflectivity, filter and window, 0 < t_opt <= 1, the same at all wavelengths.
    qe : float
        Detector quantum efficiency, e-/ph, 0 < qe <= 1, constant over the band.
    curve : Curve, optional
        Filter transmission that replaces the top-hat.

    Raises
    ------
    InputError
        If a number is outside its range.
    """

    name: str
    camera: str
    center_nm: float
    width_nm: float
    t_opt: float
    qe: float
    curve: Curve | None = None

    def __post_init__(self) -> None:
        if self.camera not in CAMERAS:
            raise InputError(f"{self.name}.camera", self.camera, allowed=", ".join(CAMERAS))
        _in_range(f"{self.name}.center_nm", self.center_nm, "nm", 0.0, 1e5)
        _in_range(f"{self.name}.width_nm", self.width_nm, "nm", 0.0, 2.0 * self.center_nm)
        _in_range(f"{self.name}.t_opt", self.t_opt, "", 0.0, 1.0)
        _in_range(f"{self.name}.qe", self.qe, "e-/ph", 0.0, 1.0)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Band) and self._content() == other._content()

    def __hash__(self) -> int:
        return hash(self._content())

    @property
    def support_nm(self) -> tuple[float, float]:
        """Wavelengths outside which nothing is transmitted."""
        if self.curve is None:
            return self.center_nm - 0.5 * self.width_nm, self.center_nm + 0.5 * self.width_nm
        return float(self.curve.wavelength_nm[0]), float(self.curve.wavelength_nm[-1])

    def filter_transmission(self, wavelength_nm: ArrayLike) -> np.ndarray:
        """Return the filter shape: top-hat of height 1, or the curve; zero outside."""
        wavelength = np.asarray(wavelength_nm, dtype=np.float64)
        if self.curve is None:
            low, high = self.support_nm
            return np.where((wavelength >= low) & (wavelength <= high), 1.0, 0.0)
        left_of, height = self.curve.wavelength_nm, self.curve.transmission
        return np.asarray(np.interp(wavelength, left_of, height, left=0.0, right=0.0))

    def quantum_efficiency(self, wavelength_nm: ArrayLike) -> np.ndarray:
        """Return the quantum efficiency (e-/ph), constant over the band."""
        return np.full(np.shape(wavelength_nm), self.qe)

    def transmission(self, wavelength_nm: ArrayLike) -> np.ndarray:
        """Return detected electrons per photon that reaches the telescope: ``t_opt`` x filter x QE."""
        return np.asarray(self.t_opt * self.filter_transmission(wavelength_nm) * self.quantum_efficiency(wavelength_nm))

    def _content(self) -> tuple[object, ...]:
        curve = () if self.curve is None else (self.curve.wavelength_nm.tobytes(), self.curve.transmission.tobytes())
        return self.name, self.camera, self.center_nm, self.width_nm, self.t_opt, self.qe, curve


def load_bands() -> dict[str, Band]:
    """Return the eight shipped bands by name, in order of wavelength; the dictionary is yours to change."""
    return dict(_load()[0])


def band_provenance() -> dict[str, Provenance]:
    """Return unit, source and confidence of every number, keyed like ``F662.width_nm``."""
    return dict(_load()[1])


def band_from_file(
    path: str | Path, name: str, *, t_opt: float, qe: float, camera: str = "VIS", unit: str | None = None
) -> Band:
    """Read a filter transmission curve from a file of wavelength and transmission.

    Every form of `catalogs.curves.read_curve`: text, CSV, ECSV, VOTable, FITS. Transmissions are 0 to 1, or in percent
    where heading, unit or a remark says so; those that noise puts beyond by at most 1 % of the peak become 0 or 1. The
    wavelength unit is stated by ``unit``, by the column, its heading or a remark. Zeros beyond the ends are left out.

    Parameters
    ----------
    path : str or Path
        The file.
    name : str
        Band name.
    t_opt, qe : float
        Transmission of everything else, and quantum efficiency, both over 0 to 1.
    camera : {"VIS", "NIR"}
        The camera that sees it.
    unit : str, optional
        Wavelength unit, such as ``nm``, ``um`` or ``Angstrom``; overrides the file.

    Returns
    -------
    Band
        Centre: transmission-weighted mean wavelength. Width: area divided by the peak.

    Raises
    ------
    InputError
        If the file cannot be read, the unit is not stated, or transmissions are outside 0 to 1 or all zero.
    """
    data, file = read_file(path, key="file", allowed="a readable file", max_bytes=_MAX_BYTES), Path(path).name
    wavelength_nm, transmission, _ = read_curve(file, data, "transmission", unit=unit, most=1.0)
    if not transmission.any():
        raise InputError(f"{file} transmission", 0.0, allowed="above 0 somewhere")
    open_at = np.flatnonzero(transmission)
    part = slice(max(open_at[0] - 1, 0), open_at[-1] + 2)
    wavelength_nm, transmission = wavelength_nm[part], transmission[part]
    # Exact area and first moment of a piecewise linear curve.
    step = np.diff(wavelength_nm)
    left, right = transmission[:-1], transmission[1:]
    area = 0.5 * np.sum(step * (left + right))
    moment = np.sum(step * (wavelength_nm[:-1] * (2 * left + right) + wavelength_nm[1:] * (left + 2 * right))) / 6.0
    curve = Curve(wavelength_nm, transmission)
    return Band(name, camera, float(moment / area), float(area / transmission.max()), t_opt, qe, curve)


@functools.cache
def _load() -> tuple[dict[str, Band], dict[str, Provenance]]:
    values, provenance = split_sourced(load_yaml(_FILE))
    bands = {name: Band(name=name, **_floats(entry)) for name, entry in values["bands"].items()}
    return bands, {key.removeprefix("bands."): item for key, item in provenance.items()}


def _floats(entry: dict[str, str | float]) -> dict[str, Any]:
    return {key: value if isinstance(value, str) else float(value) for key, value in entry.items()}


def _in_range(key: str, value: float, unit: str, low: float, high: float) -> None:
    if not low < value <= high:
        raise InputError(key, value, unit=unit, allowed=f"above {low:g}, at most {high:g}")
