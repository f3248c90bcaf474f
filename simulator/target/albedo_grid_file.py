"""Spectra of a grid of models from a user's copy: the SQLite and npz layouts of Batalha et al. 2018.

Batalha et al. 2018 (AJ 156, 158) keep reflected spectra of giant planets at Zenodo, record 2003949. Facts about the
layouts are those of their scripts (github.com/natashabatalha/colorcolor, ``db_utils``) and of public loaders:

- SQLite: a table ``header`` with the columns metallicity (log10 over the Sun's), distance (au from a Sun), cloud
  (f_sed, 0 without clouds) and phase (deg), and a table for each model, named after its numbers
  (``g25_t150_m0.5_d2.0_f3_phang090``; ``NC`` without clouds), with WAVELN (um) and GEOMALB, the albedo at that phase.
- npz: those numbers as the axes ``metallicities, dists, clouds, betas, wavelns`` of the array ``allphotdata``.

Tables may be missing, and rows of tables; only a request that needs a missing model fails.
"""

import contextlib
import re
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from cpic_core import NPZ_ERRORS, InputError, open_file, open_npz

LARGEST_ALBEDO = 2.0
"""Larger is no planet's geometric albedo (A): 2/3 is a white Lambert sphere's, 1.4 the brightest icy moon's."""

_MAX_BYTES = 100_000_000_000  # the database has 5 GB
_MOST_NEGATIVE = -0.01  # below, an albedo is no rounding error of zero (A)
_NAME = re.compile(r"g[\d.]+_t[\d.]+_m(-?[\d.]+)_d([\d.]+)_(?:NC|f([\d.]+))_phang(\d{3})", re.ASCII)
_NPZ_AXES = ("metallicities", "clouds", "dists", "betas", "wavelns")
_LAYOUTS = "AlbedoModels.db (SQLite) or an npz made of it"


class Model(NamedTuple):
    """Numbers of one model: metallicity (log10 over the Sun's), f_sed (0 cloud-free), distance (au), phase (deg)."""

    log10_mh: float
    fsed: float
    insolation_au: float
    phase_deg: float

    def __str__(self) -> str:
        clouds = f"f_sed {self.fsed:g}" if self.fsed else "cloud-free"
        return f"log10_mh {self.log10_mh:g}, {clouds}, {self.insolation_au:g} au, phase {self.phase_deg:g} deg"


@dataclass(frozen=True, eq=False)
class Axes:
    """Increasing values that the models of a grid take; the meaning of each is that of `Model`."""

    log10_mh: np.ndarray
    fsed: np.ndarray
    insolation_au: np.ndarray
    phase_deg: np.ndarray


class Models(Protocol):
    """A grid of spectra in a file."""

    @property
    def axes(self) -> Axes:
        """The values that there are models for."""

    def spectra(self, models: Sequence[Model]) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return increasing wavelengths (nm) and albedos of each model.

        Raises
        ------
        InputError
            Naming the model that is missing or holds no albedo.
        """


@dataclass(frozen=True, eq=False)
class SqliteModels:
    """Models in a database, read when asked for, without a lock on it.

    Attributes
    ----------
    path : Path
        Absolute.
    axes : Axes
    tables : mapping
        Name of the table of each model.
    """

    path: Path
    axes: Axes
    tables: Mapping[Model, str]

    @classmethod
    def open(cls, path: Path) -> "SqliteModels":
        """Read which models there are.

        Raises
        ------
        InputError
            If the file is damaged, or not laid out as the module's head says.
        """
        with _database(path) as database:
            rows = database.execute("SELECT [metallicity], [cloud], [distance], [phase] FROM [header]").fetchall()
            names = database.execute("SELECT [name] FROM [sqlite_master] WHERE [type] = 'table'").fetchall()
        try:
            header = np.array(rows, dtype=np.float64).reshape(-1, 4)
        except (TypeError, ValueError):
            allowed = "metallicity, cloud, distance, phase"
            raise InputError(f"{path.name} header", "not numbers", allowed=allowed) from None
        tables: dict[Model, str] = {}
        for (name,) in names:
            # Only names of digits, points and these letters go into a query.
            if (found := _NAME.fullmatch(str(name))) is None:
                continue
            model = _named(found)
            if model is not None and tables.setdefault(model, found[0]) != found[0]:
                raise InputError(path.name, f"{tables[model]} and {name}", allowed="one table for each model")
        axes = [_axis(path, key, np.unique(column)) for key, column in zip(Model._fields, header.T, strict=True)]
        return cls(path, Axes(*axes), tables)

    def spectra(self, models: Sequence[Model]) -> list[tuple[np.ndarray, np.ndarray]]:
        """See `Models`; tables are read within one connection."""
        for model in models:
            if model not in self.tables:
                raise _missing(self.path, model)
        found = []
        with _database(self.path) as database:
            for model in models:
                query = f"SELECT [WAVELN], [GEOMALB] FROM [{self.tables[model]}]"  # noqa: S608
                wavelength_um, albedo = _numbers(database.execute(query).fetchall())
                found.append(_clean(self.path, model, wavelength_um, albedo))
        return found


@dataclass(frozen=True, eq=False)
class NpzModels:
    """Models in one array.

    Attributes
    ----------
    path : Path
    axes : Axes
    wavelength_um : ndarray, shape (n,)
    albedo : ndarray, shape (metallicity, distance, cloud, phase, n)
        In the order of the file.
    places : mapping
        Index of each value along its axis in `albedo`, by field of `Model`.
    """

    path: Path
    axes: Axes
    wavelength_um: np.ndarray
    albedo: np.ndarray
    places: Mapping[str, Mapping[float, int]]

    @classmethod
    def open(cls, path: Path) -> "NpzModels":
        """Read the arrays; ``cloudstr``, which may need pickle, is not touched.

        Raises
        ------
        InputError
            If the file is damaged, an array is missing, or shapes do not agree.
        """
        try:
            with open_npz(path) as archive:
                lacking = [name for name in (*_NPZ_AXES, "allphotdata") if name not in archive.files]
                if lacking:
                    raise InputError(path.name, f"without {', '.join(lacking)}", allowed=_LAYOUTS)
                columns = {name: np.asarray(archive[name], dtype=np.float64).ravel() for name in _NPZ_AXES}
                albedo = np.asarray(archive["allphotdata"], dtype=np.float64)
        except InputError:
            raise
        except NPZ_ERRORS as error:
            raise _unreadable(path, error) from None
        expected = tuple(columns[name].size for name in ("metallicities", "dists", "clouds", "betas", "wavelns"))
        if albedo.shape != expected:
            raise InputError(f"{path.name} allphotdata", f"shape {albedo.shape}", allowed=f"{expected}, as the axes")
        axes, places = [], {}
        for key, name in zip(Model._fields, _NPZ_AXES[:4], strict=True):
            axes.append(_axis(path, name, np.sort(columns[name])))
            places[key] = {float(value): place for place, value in enumerate(columns[name])}
        return cls(path, Axes(*axes), columns["wavelns"], albedo, places)

    def spectra(self, models: Sequence[Model]) -> list[tuple[np.ndarray, np.ndarray]]:
        """See `Models`."""
        found = []
        for model in models:
            metal, cloud, distance, phase = (self.places[key][value] for key, value in model._asdict().items())
            row = self.albedo[metal, distance, cloud, phase]
            found.append(_clean(self.path, model, self.wavelength_um, row))
        return found


def open_models(path: Path) -> Models:
    """Open a grid of either layout, told apart by the first bytes.

    Raises
    ------
    InputError
        If the file cannot be read or is of neither layout.
    """
    with open_file(path, key="albedo grid", allowed=_LAYOUTS, max_bytes=_MAX_BYTES) as file:
        start = file.read(16)
    if is_sqlite(start):
        return SqliteModels.open(path)
    if start.startswith(b"PK\x03\x04"):
        return NpzModels.open(path)
    hint = "a table of wavelength and albedo is given without log10_mh and log10_fsed"
    raise InputError("albedo grid", str(path), allowed=_LAYOUTS, hint=hint)


def is_sqlite(start: bytes) -> bool:
    """Return whether a file that starts so is an SQLite database."""
    return start.startswith(b"SQLite format 3\x00")


@contextlib.contextmanager
def _database(path: Path) -> Iterator[sqlite3.Connection]:
    """Open without locks and side files: the grid is data that nobody writes."""
    try:
        with contextlib.closing(sqlite3.connect(f"{path.as_uri()}?mode=ro&immutable=1", uri=True)) as database:
            yield database
    except sqlite3.Error as error:
        raise _unreadable(path, error) from None


def _unreadable(path: Path, error: Exception) -> InputError:
    return InputError("albedo grid", str(path), allowed=_LAYOUTS, hint=f"{type(error).__name__}: {error}"[:160])


def _missing(path: Path, model: Model) -> InputError:
    return InputError("albedo grid model", str(model), allowed=f"models in {path.name}", hint="this one is missing")


def _named(found: re.Match[str]) -> Model | None:
    try:
        return Model(float(found[1]), float(found[3] or 0.0), float(found[2]), float(found[4]))
    except ValueError:  # two points in one number
        return None


def _axis(path: Path, key: str, values: np.ndarray) -> np.ndarray:
    if values.size == 0 or not np.all(np.isfinite(values)) or np.any(np.diff(values) <= 0.0):
        raise InputError(f"{path.name} {key}", f"{values.size} values", allowed="different finite numbers")
    values.setflags(write=False)
    return values


def _numbers(rows: list[tuple[Any, Any]]) -> tuple[np.ndarray, np.ndarray]:
    """Return the columns of a table; NaN for cells that hold no number, as Fortran's asterisks."""
    try:
        table = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError):
        table = np.array([[_number(cell) for cell in row] for row in rows])
    columns = table.reshape(-1, 2)
    return columns[:, 0], columns[:, 1]


def _number(cell: Any) -> float:
    try:
        return float(cell)
    except (TypeError, ValueError):
        return np.nan


def _clean(path: Path, model: Model, wavelength_um: np.ndarray, albedo: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sort one spectrum, leave out rows without a number and lift rounding errors to zero."""
    whole = np.isfinite(wavelength_um) & np.isfinite(albedo)
    order = np.argsort(wavelength_um[whole], kind="stable")
    wavelength_nm, values = 1e3 * wavelength_um[whole][order], albedo[whole][order]
    if wavelength_nm.size < 2:
        raise _missing(path, model)
    what = f"{path.name} ({model})"
    if np.any(np.diff(wavelength_nm) <= 0.0):
        raise InputError(f"{what} WAVELN", "repeated", allowed="different wavelengths")
    # A tenth of a micrometre to a tenth of a millimetre: nanometres or metres would not pass.
    if wavelength_nm[0] < 100.0 or wavelength_nm[-1] > 1e5:
        span = f"{wavelength_nm[0] / 1e3:g} to {wavelength_nm[-1] / 1e3:g}"
        raise InputError(f"{what} WAVELN", span, unit="um", allowed="0.1 to 100")
    good = (values >= _MOST_NEGATIVE) & (values <= LARGEST_ALBEDO)
    if not np.all(good):
        raise InputError(f"{what} GEOMALB", float(values[~good][0]), allowed=f"0 to {LARGEST_ALBEDO:g}")
    return wavelength_nm, np.maximum(values, 0.0)
