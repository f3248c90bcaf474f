"""Albedos from a user's tables of wavelength and albedo, and between the models of a grid of such tables.

Between models they are linear over metallicity, clouds and distance. Batalha et al. 2018 (AJ 156, 158) keep reflected
spectra of giant planets at Zenodo, record 2003949. Facts about the layouts are those of their scripts
(github.com/natashabatalha/colorcolor, ``db_utils``) and of public loaders:

- SQLite: a table ``header`` with the columns metallicity (log10 over the Sun's), distance (au from a Sun), cloud
  (f_sed, 0 without clouds) and phase (deg), and a table for each model, named after its numbers
  (``g25_t150_m0.5_d2.0_f3_phang090``; ``NC`` without clouds), with WAVELN (um) and GEOMALB, the albedo at that phase.
- npz: those numbers as the axes ``metallicities, dists, clouds, betas, wavelns`` of the array ``allphotdata``.

Tables may be missing, and rows of tables; only a request that needs a missing model fails.
"""

import contextlib
import functools
import itertools
import re
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from catalogs import Albedo, read_curve
from cpic_core import NPZ_ERRORS, ArrayLike, InputError, Record, at_home, open_file, open_npz, read_file, refuse_sent
from simulator.knobs import AlbedoFamily, model_corners
from simulator.target.contrast import checked_phase

LARGEST_ALBEDO = 2.0
"""Larger is no planet's geometric albedo (A): 2/3 is a white Lambert sphere's, 1.4 the brightest icy moon's."""

_MAX_FILE_BYTES = 100_000_000_000  # the database has 5 GB
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


class Axes(Record, eq=False):
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


class SqliteModels(Record, eq=False):
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


class NpzModels(Record, eq=False):
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
    with open_file(path, key="albedo grid", allowed=_LAYOUTS, max_bytes=_MAX_FILE_BYTES) as file:
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


_MAX_BYTES = 200_000_000


def read_albedo(path: str | Path, *, unit: str | None = None) -> Albedo:
    """Read a geometric albedo from a file with a column of wavelengths or wavenumbers and one of albedos.

    Text (columns apart by blanks, commas, semicolons or tabs; ``#`` begins a remark; the line above the numbers, or a
    remark there, may name the columns), ECSV, VOTable, FITS, and npz with such names as ``wavelength_nm`` and
    ``albedo``. What a file is, its content says. Rows may come in any order: over wavenumber, as in PICASO's output,
    they run down in wavelength. Where there are more than two columns, names choose.

    Parameters
    ----------
    path : str or Path
        The file.
    unit : str, optional
        ``nm``, ``um``, ``angstrom``, ``cm-1`` or what astropy reads as a unit of light's wavelength, frequency or
        energy; overrides the file. By default the unit is that of the column or its name (``wavelength_um``,
        ``Wavelength [micron]``; a ``wavenumber`` is in 1/cm); where there is none, numbers all below 20 are um, all
        within 100 to 3000 nm.

    Returns
    -------
    Albedo
        Increasing wavelengths in nm; documented over all of them.

    Raises
    ------
    InputError
        If the file cannot be read, its columns or unit cannot be told, a row is broken, a wavelength is repeated, or
        an albedo is not within 0 to 2.
    """
    place = at_home(path)
    hint = "is it a grid of models? then give log10_mh and log10_fsed with it"
    allowed = "a text, CSV, ECSV, VOTable, FITS or npz file"
    data = read_file(path, key="albedo file", allowed=allowed, max_bytes=_MAX_BYTES, too_large=hint)
    if is_sqlite(data) or (data.startswith(b"PK") and b"allphotdata.npy" in data):
        hint = "this is a grid of models: give log10_mh and log10_fsed with it"
        raise InputError("albedo file", str(place), allowed="a table of wavelength and albedo", hint=hint)
    return Albedo(*read_curve(place.name, data, "albedo", unit=unit, most=LARGEST_ALBEDO, by_size=True)[:2])


# As for the parametric model: absorption beyond is not tied to planets that have been measured.
_DOCUMENTED_TO_NM = 1050.0
# Phase curves are means over the wavelengths of the visible bands.
_PHASE_RANGE_NM = (400.0, 1000.0)


def load_albedo_grid(path: str | Path) -> "AlbedoGrid":
    """Open a user's copy of the grid of Batalha et al. 2018 (AJ 156, 158; Zenodo record 2003949).

    Two layouts are read, told apart by their content: the SQLite database itself, and the npz file into which public
    scripts pack it. Spectra are read when asked for. A file is opened once, and again after it has changed.

    Parameters
    ----------
    path : str or Path
        The file; it is neither locked nor written.

    Raises
    ------
    InputError
        If there is no such file, or it is not laid out as such a grid.
    """
    refuse_sent(path, key="albedo grid")
    try:
        place = at_home(path).resolve()
        state = place.stat()
    except (OSError, ValueError, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError("albedo grid", str(path), allowed="a readable file", hint=reason) from None
    if not place.is_file():
        raise InputError("albedo grid", str(path), allowed="a readable file", hint="not a file")
    return _opened(place, state.st_mtime_ns, state.st_size)


@functools.lru_cache(maxsize=2)
def _opened(path: Path, _mtime_ns: int, _size: int) -> "AlbedoGrid":
    models = open_models(path)
    _check(path, models.axes)
    return AlbedoGrid(path, models)


class AlbedoGrid(Record, eq=False):
    """A grid of models in a file; offers what `simulator.target.albedo` does.

    Attributes
    ----------
    path : Path
    models : Models
        Reader of the spectra; ``models.axes`` says which there are.
    """

    path: Path
    models: Models

    def family(self, log10_mh: float, log10_fsed: float | None) -> AlbedoFamily:
        """Return the albedo at full phase over insolation, linear in albedo over log10_mh and log10_fsed.

        Parameters
        ----------
        log10_mh : float
            Decimal logarithm of the metallicity over the Sun's, within the grid (0 to 2 in the published one).
        log10_fsed : float or None
            Decimal logarithm of f_sed, at least that of the grid (-2); above its largest (log10 6), the largest is
            used. None: cloud-free; cloudy planets never take a share of it.

        Returns
        -------
        AlbedoFamily
            At the wavelengths that all models it is made of cover; beyond 1050 nm it counts as extrapolated. The
            same arguments give the same object.

        Raises
        ------
        InputError
            If a parameter is outside the grid, or one of the models around it is missing (it is named).
        """
        return _family(self, tuple(self._corners(log10_mh, log10_fsed)))

    def phase_curve(
        self, phase_deg: ArrayLike, *, log10_mh: float, log10_fsed: float | None, insolation_au: ArrayLike
    ) -> np.ndarray:
        """Return the models' brightness at a phase relative to full phase, exactly 1 at 0.

        One curve for all wavelengths: the ratio A(phase) / A(0) weighted with A(0), over 400-1000 nm or what the grid
        has of it. Linear between models as `family` is; monotone cubic (Fritsch & Butland 1984) between their phases.

        Parameters
        ----------
        phase_deg, insolation_au : array_like
            Broadcast against each other; 0 to 180 degrees; above 0 au, clamped to the grid's distances.
        log10_mh, log10_fsed
            As in `family`.

        Returns
        -------
        ndarray
            Broadcast shape.

        Raises
        ------
        InputError
            If a parameter is outside the grid, or a model that is needed is missing (it is named).
        """
        phase, distance = np.broadcast_arrays(checked_phase(phase_deg), np.asarray(insolation_au, dtype=np.float64))
        corners = self._corners(log10_mh, log10_fsed)
        ends, weights = _family(self, tuple(corners)).corners(distance)
        axes = self.models.axes
        chosen = _around(axes.phase_deg, phase) if phase.size else (0,)
        if chosen == (0,):
            return np.ones(phase.shape)
        near = np.unique(ends)
        cells = tuple((fsed, metal) for fsed, metal, _ in corners)
        means = _phase_means(self, cells, tuple(near.tolist()), chosen)
        from scipy.interpolate import PchipInterpolator

        bright = np.zeros((phase.size, near.size))
        full = np.zeros(near.size)
        for (_, _, weight), mean in zip(corners, means, strict=True):
            bright += weight * PchipInterpolator(axes.phase_deg[list(chosen)], mean[1:])(phase.ravel())
            full += weight * mean[0]
        bright = bright.reshape(*phase.shape, near.size)
        place = np.searchsorted(near, ends)
        above = (weights * np.take_along_axis(bright, place, axis=-1)).sum(axis=-1)
        below = (weights * full[place]).sum(axis=-1)
        if np.any(below <= 0.0):
            raise InputError(f"{self.path.name} full phase", 0.0, allowed="an albedo above 0 somewhere in 400-1000 nm")
        return np.asarray(above / below)

    def _corners(self, log10_mh: float, log10_fsed: float | None) -> list[tuple[int, int, float]]:
        axes = self.models.axes
        return model_corners(axes.fsed, axes.log10_mh, log10_mh, log10_fsed, self.path.name)


@functools.lru_cache(maxsize=32)
def _family(grid: AlbedoGrid, corners: tuple[tuple[int, int, float], ...]) -> AlbedoFamily:
    axes = grid.models.axes
    nodes = itertools.product(corners, axes.insolation_au)
    models = [Model(axes.log10_mh[metal], axes.fsed[fsed], au, axes.phase_deg[0]) for (fsed, metal, _), au in nodes]
    wavelength_nm, albedo = _on_one_sampling(grid.path, grid.models.spectra(models))
    weights = np.array([weight for _, _, weight in corners])
    family = np.tensordot(weights, albedo.reshape(len(corners), axes.insolation_au.size, -1), axes=1)
    for array in (wavelength_nm, family):
        array.setflags(write=False)
    documented = min(_DOCUMENTED_TO_NM, float(wavelength_nm[-1]))
    return AlbedoFamily(axes.insolation_au, wavelength_nm, family, documented)


@functools.lru_cache(maxsize=256)
def _phase_means(
    grid: AlbedoGrid, cells: tuple[tuple[int, int], ...], near: tuple[int, ...], chosen: tuple[int, ...]
) -> np.ndarray:
    """Return the mean albedos over wavelength, (cells, 1 + phases, distances); the first phase is full phase."""
    axes, phases = grid.models.axes, (0, *chosen)
    models = [
        Model(axes.log10_mh[metal], axes.fsed[fsed], axes.insolation_au[distance], axes.phase_deg[phase])
        for (fsed, metal), phase, distance in itertools.product(cells, phases, near)
    ]
    wavelength_nm, albedo = _on_one_sampling(grid.path, grid.models.spectra(models))
    low, high = max(_PHASE_RANGE_NM[0], wavelength_nm[0]), min(_PHASE_RANGE_NM[1], wavelength_nm[-1])
    if not low < high:
        span = f"{wavelength_nm[0]:g}-{wavelength_nm[-1]:g}"
        raise InputError(f"{grid.path.name} range", span, unit="nm", allowed="a part of 400-1000 nm")
    inside = (wavelength_nm > low) & (wavelength_nm < high)
    x = np.concatenate([[low], wavelength_nm[inside], [high]])
    means = [np.trapezoid(np.interp(x, wavelength_nm, row), x) / (high - low) for row in albedo]
    result = np.reshape(means, (len(cells), len(phases), len(near)))
    result.setflags(write=False)
    return result


def _on_one_sampling(path: Path, spectra: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Bring spectra, linear between samples, to all their wavelengths within the range that they share."""
    first = spectra[0][0]
    if all(np.array_equal(wavelength, first) for wavelength, _ in spectra):
        return first.copy(), np.stack([albedo for _, albedo in spectra])
    every = np.unique(np.concatenate([wavelength for wavelength, _ in spectra]))
    low = max(wavelength[0] for wavelength, _ in spectra)
    high = min(wavelength[-1] for wavelength, _ in spectra)
    common = every[(every >= low) & (every <= high)]
    if common.size < 2:
        raise InputError(f"{path.name} wavelengths", "do not overlap", unit="nm", allowed="models of the same range")
    return common, np.stack([np.interp(common, wavelength, albedo) for wavelength, albedo in spectra])


def _around(nodes_deg: np.ndarray, phase_deg: np.ndarray) -> tuple[int, ...]:
    """Return the nodes that the monotone cubic needs: those about the phases and one more on either side."""
    low, high = float(phase_deg.min()), float(phase_deg.max())
    if high > nodes_deg[-1]:
        raise InputError("phase_deg", high, unit="deg", allowed=f"0 to {nodes_deg[-1]:g}, the phases of the grid")
    if low == high and low in nodes_deg:
        return tuple(sorted({0, int(np.searchsorted(nodes_deg, low))}))
    first = int(np.searchsorted(nodes_deg, low, side="right")) - 2
    last = int(np.searchsorted(nodes_deg, high, side="left")) + 1
    return tuple(range(max(first, 0), min(last, nodes_deg.size - 1) + 1))


def _check(path: Path, axes: Axes) -> None:
    """Refuse axes that the interpolation cannot stand on."""
    if axes.fsed[0] < 0.0:
        raise InputError(f"{path.name} clouds", float(axes.fsed[0]), allowed="f_sed, 0 where cloud-free")
    if axes.insolation_au[0] <= 0.0 or axes.insolation_au.size < 2:
        shown = ", ".join(f"{value:g}" for value in axes.insolation_au)
        raise InputError(f"{path.name} distances", shown, unit="au", allowed="two or more distances above 0")
    if axes.phase_deg[0] != 0.0 or axes.phase_deg[-1] > 180.0:
        span = f"{axes.phase_deg[0]:g} to {axes.phase_deg[-1]:g}"
        raise InputError(f"{path.name} phases", span, unit="deg", allowed="0 (full phase) to at most 180")
