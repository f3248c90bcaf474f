"""A user's grid of models: both layouts, interpolation against scipy's, everything that can be missing.

Tables of wavelength and albedo: every format, unit and way to be wrong.
"""

import os
import pickle
import sqlite3
import warnings
from contextlib import closing

import astropy.units as u
import numpy as np
import pytest
from astropy.table import Table
from hypothesis import HealthCheck, given, settings, strategies as st
from scipy.interpolate import PchipInterpolator, RegularGridInterpolator

from cpic_core import InputError
from simulator.target.albedo_grid import load_albedo_grid, read_albedo

METAL = np.array([0.0, 0.5, 1.7, 2.0])
DISTANCE = np.array([0.5, 0.85, 2.0, 5.0])
CLOUD = np.array([0.0, 0.01, 0.3, 1.0, 6.0])
PHASE = np.arange(0.0, 181.0, 30.0)
WAVE_UM = np.linspace(0.3, 1.1, 41)
TRUTH = np.random.default_rng(8).uniform(0.05, 0.9, (METAL.size, DISTANCE.size, CLOUD.size, 1, WAVE_UM.size))
# Brightness falls with phase, in every model at its own pace.
TRUTH = TRUTH * np.cos(np.deg2rad(PHASE / 2.0))[:, None] ** (2.0 + 3.0 * TRUTH)
CLEAR_NAMES = {0.0: "NC", 1.0: "f1", 3.0: "f3", 6.0: "f6"}


def table_name(metal, distance, cloud, phase):
    clouds = CLEAR_NAMES.get(cloud, f"f{cloud}")
    return f"g25_t150_m{metal}_d{distance}_{clouds}_phang{int(phase):03d}"


def write_database(path, truth=TRUTH, *, change=lambda name, rows: rows):
    """As the authors' scripts do, through pandas: a header in the order of files, an index column in each table."""
    rng = np.random.default_rng(3)
    with closing(sqlite3.connect(path)) as database:
        database.execute(
            'CREATE TABLE header ("index" TEXT, display_string TEXT, gravity REAL, tint REAL, temp REAL, '
            "metallicity REAL, distance REAL, cloud REAL, phase REAL)"
        )
        places = list(np.ndindex(truth.shape[:4]))
        rng.shuffle(places)
        for i, j, k, p in places:
            numbers = (float(METAL[i]), float(DISTANCE[j]), float(CLOUD[k]), float(PHASE[p]))
            name = table_name(*numbers)
            database.execute(
                "INSERT INTO header VALUES (?, 'x', 25, NULL, 150, ?, ?, ?, ?)",
                (name, numbers[0], numbers[1], numbers[2], numbers[3]),
            )
            rows = change(name, [(n, float(w), float(a)) for n, (w, a) in enumerate(zip(WAVE_UM, truth[i, j, k, p]))])  # noqa: B905
            if rows is not None:
                database.execute(f'CREATE TABLE "{name}" ("index" BIGINT, "WAVELN" FLOAT, "GEOMALB" FLOAT)')
                database.executemany(f'INSERT INTO "{name}" VALUES (?, ?, ?)', rows)
        database.commit()
    return path


def write_npz(path, truth=TRUTH, **changes):
    names = ["NC" if cloud == 0 else f"f{cloud}" for cloud in CLOUD.tolist()]
    arrays = {
        "metallicities": METAL,
        "dists": DISTANCE,
        "clouds": CLOUD,
        "cloudstr": np.array(names, dtype=object),
        "betas": PHASE,
        "wavelns": WAVE_UM,
        "allphotdata": truth,
    }
    np.savez(path, **{name: array for name, array in (arrays | changes).items() if array is not None})
    return path


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("grid 100% #1?")  # a name that a URI must not take literally
    return {"database": write_database(folder / "AlbedoModels.db"), "npz": write_npz(folder / "allphotdata.npz")}


@pytest.fixture(params=["database", "npz"])
def grid(request, files):
    return load_albedo_grid(files[request.param])


def albedo_oracle():
    full = np.moveaxis(TRUTH[:, :, 1:, 0, :], 2, 0)
    return RegularGridInterpolator((np.log10(CLOUD[1:]), METAL, np.log(DISTANCE)), full)


@settings(max_examples=15, deadline=None)
@given(st.floats(0.0, 2.0), st.floats(-2.0, np.log10(6.0)), st.floats(0.5, 5.0))
def test_albedo_is_that_of_a_linear_interpolator(files, log10_mh, log10_fsed, distance):
    expected = albedo_oracle()((log10_fsed, log10_mh, np.log(distance)))
    for path in files.values():
        albedo = load_albedo_grid(path).family(log10_mh, log10_fsed).at(distance)
        np.testing.assert_allclose(albedo.albedo, expected, rtol=0, atol=1e-8)  # nodes reach 1e-9 far
        np.testing.assert_allclose(albedo.wavelength_nm, 1e3 * WAVE_UM, rtol=1e-15)


def test_nodes_are_the_models_themselves(grid):
    for i, metal in enumerate(METAL.tolist()):
        for k, cloud in enumerate(CLOUD.tolist()):
            family = grid.family(metal, np.log10(cloud) if cloud else None)
            np.testing.assert_array_equal(family.albedo, TRUTH[i, :, k, 0])
            np.testing.assert_array_equal(family.insolation_au, DISTANCE)
    assert family.documented_to_nm == 1050.0
    assert not family.albedo.flags.writeable


def test_cloud_free_never_mixes_with_clouds(grid):
    thin = grid.family(0.0, -2.0).albedo
    np.testing.assert_array_equal(thin, TRUTH[0, :, 1, 0])
    between = grid.family(0.25, None).albedo
    np.testing.assert_allclose(between, 0.5 * (TRUTH[0, :, 0, 0] + TRUTH[1, :, 0, 0]), rtol=1e-15)


def test_large_fsed_is_that_of_the_last_node(grid):
    assert grid.family(1.0, 2.0) is grid.family(1.0, np.log10(6.0))


@pytest.mark.parametrize(
    ("log10_mh", "log10_fsed", "says"),
    [
        (2.1, 0.0, "log10_mh = 2.1"),
        (-0.1, None, "0 to 2"),
        (float("nan"), 0.0, "log10_mh = nan"),
        (1.0, -2.1, "-2 to 0.7782"),
        (1.0, float("nan"), "log10_fsed = nan"),
        (1.0, float("-inf"), "cloud-free"),
    ],
)
def test_refuses_what_is_outside(refused, grid, log10_mh, log10_fsed, says):
    message = refused(r"log10_", grid.family, log10_mh, log10_fsed)
    assert says in message


def mean(truth):
    inside = (WAVE_UM > 0.399) & (WAVE_UM < 1.001)
    return np.trapezoid(truth[..., inside], WAVE_UM[inside], axis=-1) / 0.6


@settings(max_examples=15, deadline=None)
@given(
    st.floats(0.0, 2.0),
    st.floats(-2.0, np.log10(6.0)),
    st.lists(st.tuples(st.floats(0.0, 180.0) | st.sampled_from(PHASE.tolist()), st.floats(0.1, 20.0)), min_size=1),
)
def test_phase_curve_is_that_of_whole_monotone_cubics(files, log10_mh, log10_fsed, places):
    phase, distance = np.array(places).T
    curves = PchipInterpolator(PHASE, mean(np.moveaxis(TRUTH, 3, 0)))(phase)
    spots = np.clip(np.log(distance), np.log(DISTANCE[0]), np.log(DISTANCE[-1]))

    def between(values):
        axes = (np.log10(CLOUD[1:]), METAL, np.log(DISTANCE))
        return RegularGridInterpolator(axes, np.moveaxis(values[:, :, 1:], 2, 0))

    full = mean(TRUTH[..., 0, :])
    expected = [
        between(curve)((log10_fsed, log10_mh, spot)) / between(full)((log10_fsed, log10_mh, spot))
        for curve, spot in zip(curves, spots, strict=True)
    ]
    for path in files.values():
        found = load_albedo_grid(path).phase_curve(
            phase, log10_mh=log10_mh, log10_fsed=log10_fsed, insolation_au=distance
        )
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7)


def test_phase_curve_is_one_at_full_phase_and_falls(grid):
    phase = np.linspace(0.0, 180.0, 721)
    for log10_fsed in (None, -1.3, 0.5):
        curve = grid.phase_curve(phase, log10_mh=0.6, log10_fsed=log10_fsed, insolation_au=1.3)
        assert curve[0] == 1.0
        assert np.all(np.diff(curve) <= 0.0)
        assert curve[-1] == pytest.approx(0.0, abs=1e-12)
    many = grid.phase_curve([[0.0], [77.0]], log10_mh=0.6, log10_fsed=0.5, insolation_au=[0.7, 1.3, 9.0])
    assert many.shape == (2, 3)
    np.testing.assert_array_equal(many[0], 1.0)
    one = grid.phase_curve(77.0, log10_mh=0.6, log10_fsed=0.5, insolation_au=1.3)
    assert one.shape == ()
    assert one == pytest.approx(many[1, 1], rel=1e-12)
    assert grid.phase_curve([], log10_mh=0.6, log10_fsed=0.5, insolation_au=1.0).shape == (0,)


@pytest.mark.parametrize("phase", [-1.0, 180.5, float("nan")])
def test_refuses_other_phases(refused, grid, phase):
    refused("phase_deg", grid.phase_curve, phase, log10_mh=0.0, log10_fsed=0.0, insolation_au=1.0)


@pytest.mark.parametrize("distance", [0.0, -1.0, float("nan"), float("inf")])
def test_refuses_other_distances(refused, grid, distance):
    refused("insolation_au", grid.phase_curve, 10.0, log10_mh=0.0, log10_fsed=0.0, insolation_au=distance)


def holed(tmp_path, layout, holes):
    """Both layouts without some models; ``holes`` are indices of metallicity, distance, cloud and phase."""
    truth = TRUTH.copy()
    names = set()
    for hole in holes:
        truth[hole] = np.nan
        i, j, k, p = hole
        names.add(table_name(METAL[i], DISTANCE[j], CLOUD[k], PHASE[p]))
    if layout == "npz":
        return write_npz(tmp_path / "holed.npz", truth)
    return write_database(tmp_path / "holed.db", change=lambda name, rows: None if name in names else rows)


@pytest.mark.parametrize("layout", ["database", "npz"])
def test_a_missing_model_matters_only_where_it_is_needed(refused, tmp_path, layout):
    grid = load_albedo_grid(holed(tmp_path, layout, [(1, 2, 3, 0), (0, 1, 1, 3), (2, 3, 0, 0)]))
    needed = "log10_mh 0.5, f_sed 1, 2 au, phase 0 deg"
    for log10_mh, log10_fsed in ((0.5, 0.0), (0.3, 0.0), (0.5, 0.4)):
        refused(needed, grid.family, log10_mh, log10_fsed)
    refused("log10_mh 1.7, cloud-free, 5 au, phase 0 deg", grid.family, 1.9, None)
    for log10_mh, log10_fsed in ((0.0, 0.0), (0.5, -1.0), (1.9, 0.3)):
        assert np.all(np.isfinite(grid.family(log10_mh, log10_fsed).albedo))
    # Between 0.85 and 2 au at f_sed 0.01: phase 90 is gone, 150 and its neighbours are not.
    thin = {"log10_mh": 0.0, "log10_fsed": -2.0}
    for phase in (90.0, 100.0, 125.0, [10.0, 170.0]):
        refused("log10_mh 0, f_sed 0.01, 0.85 au, phase 90 deg", grid.phase_curve, phase, insolation_au=1.0, **thin)
    assert 0.0 < grid.phase_curve(155.0, insolation_au=1.0, **thin) < 0.2
    assert 0.0 < grid.phase_curve(60.0, insolation_au=1.0, **thin) < 1.0
    assert 0.0 < grid.phase_curve(100.0, insolation_au=3.0, **thin) < 1.0


@pytest.mark.parametrize("layout", ["database", "npz"])
def test_models_with_fewer_wavelengths_are_brought_to_those_of_the_others(tmp_path, layout):
    lost, ends = [5, 6, 20], [0, 40]
    if layout == "npz":
        truth = TRUTH.copy()
        truth[0, 1, 2, 0, lost] = np.nan
        truth[0, 2, 2, 0, ends] = np.nan
        path = write_npz(tmp_path / "short.npz", truth)
    else:
        # the first overflowed in Fortran and in NULL, the second lacks rows at its ends
        stars = {table_name(0.0, 0.85, 0.3, 0.0): lost}
        short = {table_name(0.0, 2.0, 0.3, 0.0): ends}

        def change(name, rows):
            if name in stars:
                spoilt = [(n, w, ("***********", None)[n % 2] if n in lost else a) for n, w, a in rows]
                return spoilt[::-1]
            return [row for row in rows if row[0] not in short.get(name, [])]

        path = write_database(tmp_path / "short.db", change=change)
    family = load_albedo_grid(path).family(0.0, np.log10(0.3))
    np.testing.assert_allclose(family.wavelength_nm, 1e3 * WAVE_UM[1:-1], rtol=1e-15)
    expected = TRUTH[0, :, 2, 0].copy()
    keep = np.setdiff1d(np.arange(WAVE_UM.size), lost)
    expected[1] = np.interp(WAVE_UM, WAVE_UM[keep], expected[1][keep])
    np.testing.assert_allclose(family.albedo, expected[:, 1:-1], rtol=1e-12)


def test_layouts_agree_where_axes_run_in_any_order(files, tmp_path):
    back = TRUTH[::-1, ::-1, ::-1, ::-1, ::-1]
    turned = {"metallicities": METAL, "dists": DISTANCE, "clouds": CLOUD, "betas": PHASE, "wavelns": WAVE_UM}
    path = write_npz(tmp_path / "back.npz", back, **{name: axis[::-1] for name, axis in turned.items()})
    expected = load_albedo_grid(files["database"]).family(0.9, 0.1).albedo
    np.testing.assert_array_equal(load_albedo_grid(path).family(0.9, 0.1).albedo, expected)


@pytest.mark.parametrize(("value", "good"), [(-1e-4, True), (-0.02, False), (2.5, False)])
def test_rounding_below_zero_is_lifted_and_nonsense_refused(refused, tmp_path, value, good):
    truth = TRUTH.copy()
    truth[0, 0, 0, 0, 7] = value
    for path in (write_database(tmp_path / "a.db", truth), write_npz(tmp_path / "a.npz", truth)):
        grid = load_albedo_grid(path)
        if good:
            assert grid.family(0.0, None).albedo[0, 7] == 0.0
        else:
            refused(r"cloud-free, 0.5 au.*GEOMALB", grid.family, 0.0, None)


def test_documented_to_its_end_where_that_comes_first(tmp_path):
    keep = WAVE_UM < 0.99
    path = write_npz(tmp_path / "red.npz", TRUTH[..., keep], wavelns=WAVE_UM[keep])
    family = load_albedo_grid(path).family(0.0, 0.0)
    assert family.documented_to_nm == family.wavelength_nm[-1] == pytest.approx(980.0)


def test_database_is_neither_locked_nor_touched(files):
    path = files["database"]
    before = (path.read_bytes(), path.stat().st_mtime_ns, sorted(os.listdir(path.parent)))
    with closing(sqlite3.connect(path, isolation_level=None)) as writer:
        writer.execute("BEGIN EXCLUSIVE")  # a reader that asks for a lock would wait and fail
        load_albedo_grid.__globals__["_opened"].cache_clear()
        grid = load_albedo_grid(path)
        grid.phase_curve(10.0, log10_mh=0.1, log10_fsed=0.0, insolation_au=1.0)
        writer.execute("ROLLBACK")
    assert (path.read_bytes(), path.stat().st_mtime_ns, sorted(os.listdir(path.parent))) == before


def test_read_again_only_after_a_change(tmp_path):
    path = write_npz(tmp_path / "a.npz")
    grid = load_albedo_grid(path)
    assert load_albedo_grid(str(path)) is grid
    assert grid.family(0.0, 0.0) is grid.family(0.0, 0.0)
    write_npz(path, 0.5 * TRUTH)
    os.utime(path, ns=(1, 1))
    np.testing.assert_allclose(load_albedo_grid(path).family(0.0, 0.0).albedo, 0.5 * grid.family(0.0, 0.0).albedo)


def test_travels_between_processes(grid):
    copy = pickle.loads(pickle.dumps(grid))
    np.testing.assert_array_equal(copy.family(0.3, 0.2).albedo, grid.family(0.3, 0.2).albedo)


def test_grid_of_few_models(refused, tmp_path):
    path = write_npz(
        tmp_path / "few.npz", TRUTH[1:2, :, 3:4, :1], metallicities=METAL[1:2], clouds=CLOUD[3:4], betas=PHASE[:1]
    )
    grid = load_albedo_grid(path)
    np.testing.assert_array_equal(grid.family(0.5, 0.0).albedo, TRUTH[1, :, 3, 0])
    assert grid.phase_curve(0.0, log10_mh=0.5, log10_fsed=0.0, insolation_au=1.0) == 1.0
    for log10_mh, log10_fsed, phase in ((0.6, 0.0, 0.0), (0.5, None, 0.0), (0.5, -0.1, 0.0), (0.5, 0.0, 1.0)):
        refused("", grid.phase_curve, phase, log10_mh=log10_mh, log10_fsed=log10_fsed, insolation_au=1.0)
    clear = write_npz(tmp_path / "clear.npz", TRUTH[:, :, :1], clouds=CLOUD[:1])
    refused("no cloudy models", load_albedo_grid(clear).family, 0.5, 0.0)


def test_dark_models_have_no_phase_curve(refused, tmp_path):
    grid = load_albedo_grid(write_npz(tmp_path / "dark.npz", 0.0 * TRUTH))
    refused("full phase", grid.phase_curve, 10.0, log10_mh=0.0, log10_fsed=0.0, insolation_au=1.0)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"betas": None}, "without betas"),
        ({"betas": PHASE + 10.0}, "phases"),
        ({"betas": PHASE[:-1]}, "allphotdata"),
        ({"clouds": -CLOUD}, "clouds"),
        ({"clouds": np.array([0.0, 1.0, 1.0, 3.0, 6.0])}, "different finite numbers"),
        ({"metallicities": np.array([0.0, np.nan, 1.0, 2.0])}, "different finite numbers"),
        ({"dists": DISTANCE - 1.0}, "distances"),
        ({"allphotdata": np.array([None, {}])}, "Object arrays"),
        ({"metallicities": np.array(["a", "b", "c", "d"])}, "could not convert"),
    ],
)
def test_refuses_another_npz(refused, tmp_path, change, says):
    path = write_npz(tmp_path / "a.npz", **change) if "allphotdata" not in change else tmp_path / "a.npz"
    if "allphotdata" in change:
        arrays = {"metallicities": METAL, "dists": DISTANCE, "clouds": CLOUD, "betas": PHASE, "wavelns": WAVE_UM}
        np.savez(path, **arrays, **change)
    refused(says, load_albedo_grid, path)


def test_refuses_nanometres_for_micrometres(refused, tmp_path):
    refused("300 to 1100 um", load_albedo_grid(write_npz(tmp_path / "a.npz", wavelns=1e3 * WAVE_UM)).family, 0.0, 0.0)


@pytest.mark.parametrize(
    ("statements", "says"),
    [
        (["CREATE TABLE stars (name TEXT)"], "no such table: header"),
        (["CREATE TABLE header (metallicity REAL)"], "no such column"),
        (["CREATE TABLE header (metallicity, distance, cloud, phase)"], "different finite numbers"),
        (
            ["CREATE TABLE header (metallicity, distance, cloud, phase)", "INSERT INTO header VALUES ('x', 1, 1, 0)"],
            "header = not numbers",
        ),
        (
            ["CREATE TABLE header (metallicity, distance, cloud, phase)", "INSERT INTO header VALUES (NULL, 1, 1, 0)"],
            "different finite numbers",
        ),
        (
            ["CREATE TABLE header (metallicity, distance, cloud, phase)", "INSERT INTO header VALUES (0, 1, 1, 0)"],
            "two or more distances",
        ),
        (
            [
                "CREATE TABLE header (metallicity, distance, cloud, phase)",
                'CREATE TABLE "g25_t150_m0.0_d1.0_f1_phang000" (WAVELN, GEOMALB)',
                'CREATE TABLE "g25_t150_m0_d1_f1.0_phang000" (WAVELN, GEOMALB)',
            ],
            "one table for each model",
        ),
    ],
)
def test_refuses_another_database(refused, tmp_path, statements, says):
    path = tmp_path / "other.db"
    with closing(sqlite3.connect(path)) as database:
        for statement in statements:
            database.execute(statement)
        database.commit()
    message = refused("", load_albedo_grid, path)
    assert says in message


def test_names_of_tables_are_no_commands(refused, tmp_path):
    path = tmp_path / "evil.db"
    evil = "g25_t150_m0.0_d1.0_f1]; DROP TABLE [header]; --_phang000"
    with closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TABLE header (metallicity, distance, cloud, phase)")
        database.execute("INSERT INTO header VALUES (0, 1, 1, 0), (0, 2, 1, 0)")
        database.execute(f'CREATE TABLE "{evil}" (WAVELN, GEOMALB)')
        database.execute('CREATE TABLE "g25_t150_m0.0.0_d1.0_f1_phang000" (WAVELN, GEOMALB)')
        database.execute('CREATE TABLE "g25_t150_m0.0_d1.0_f1_phang000" (WAVELN, ALBEDO)')
        database.commit()
    grid = load_albedo_grid(path)
    refused("log10_mh 0, f_sed 1, 2 au", grid.family, 0.0, 0.0)
    assert list(grid.models.tables.values()) == ["g25_t150_m0.0_d1.0_f1_phang000"]
    refused("no such column", grid.models.spectra, list(grid.models.tables))


@pytest.mark.parametrize(
    "content", [b"", b"500 0.5\n600 0.4\n", b"PK\x03\x04 no", b"SQLite format 3\x00 but no more", bytes(range(256)) * 9]
)
def test_refuses_garbage(refused, tmp_path, content):
    path = tmp_path / "garbage.db"
    path.write_bytes(content)
    refused("albedo grid", load_albedo_grid, path)


def test_refuses_what_is_no_file(refused, tmp_path):
    for path in (tmp_path / "absent.db", tmp_path, "a\0b"):
        refused("albedo grid", load_albedo_grid, path)


@pytest.mark.parametrize("layout", ["database", "npz"])
def test_a_damaged_file_is_refused_or_read_but_fails_in_no_other_way(files, tmp_path, layout):
    data = files[layout].read_bytes()
    rng = np.random.default_rng(11)
    refused = 0
    for trial in range(25):
        broken = np.frombuffer(data, dtype=np.uint8).copy()
        broken[rng.integers(len(data), size=200)] ^= np.uint8(1 << rng.integers(8))
        path = tmp_path / f"{trial}"
        path.write_bytes(broken[: rng.integers(len(data) // 2, len(data))].tobytes())
        try:
            load_albedo_grid(path).phase_curve(70.0, log10_mh=0.2, log10_fsed=-0.2, insolation_au=1.0)
        except InputError:
            refused += 1
    assert refused > 15


NM = np.array([400.0, 550.0, 660.0, 1000.0])
ALBEDO = np.array([0.5, 0.45, 0.3, 0.05])
# Of the same light by another road than the reader's: astropy's.
IN_UNIT = {
    "nm": NM,
    "um": (NM * u.nm).to_value(u.um),
    "angstrom": (NM * u.nm).to_value(u.AA),
    "cm1": (NM * u.nm).to_value(1 / u.cm, u.spectral()),
}


def written(tmp_path, text, name="spectrum.txt"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def rows(values, albedo=ALBEDO, mark=" "):
    return "".join(f"{float(x)!r}{mark}{float(y)!r}\n" for x, y in zip(values, albedo, strict=True))


def is_right(found):
    np.testing.assert_allclose(found.wavelength_nm, NM, rtol=1e-14)
    np.testing.assert_allclose(found.albedo, ALBEDO, rtol=1e-15)
    assert found.documented_to_nm == np.inf
    assert not found.albedo.flags.writeable
    assert not found.wavelength_nm.flags.writeable


def refusal(path, **options):
    with pytest.raises(InputError) as caught:
        read_albedo(path, **options)
    assert "\n" not in str(caught.value)
    assert path.name in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("heading", "unit"),
    [
        ("wavelength_nm albedo\n", "nm"),
        ("# wavelength_nm albedo\n", "nm"),
        ("# made by hand, 3 um grains\n# Wavelength (nm)  Geometric_Albedo\n", "nm"),
        ("wavelength_um albedo\n", "um"),
        ("Wavelength [µm]  A_g\n", "um"),
        ("WAVELN GEOMALB\n", "um"),
        ("micron albedo\n", "um"),
        ("# wavelength in microns and geometric albedo of the planet\n", "um"),
        ("A white planet\n\nwavelength in microns and geometric albedo\n", "um"),
        ("wavelength_angstrom albedo\n", "angstrom"),
        ("Wavelength (Å) albedo\n", "angstrom"),
        ("wavelength (A) albedo\n", "angstrom"),
        ("wavenumber_cm1 albedo\n", "cm1"),
        ("wavenumber albedo\n", "cm1"),
        ("# wavenumber (cm^-1)   albedo\n", "cm1"),
        ("wavenumber_cm-1 albedo\n", "cm1"),
        ("wno[1/cm] albedo\n", "cm1"),
        ("# albedo over wavenumber as PICASO gives it\n", "cm1"),
        ("x y\n", "nm"),
        ("", "nm"),
        ("", "um"),
    ],
)
def test_units_by_name_remark_or_numbers(tmp_path, heading, unit):
    is_right(read_albedo(written(tmp_path, heading + rows(IN_UNIT[unit]))))


@pytest.mark.parametrize("mark", [",", ", ", ";", "\t", "   ", " \t "])
def test_separators(tmp_path, mark):
    plain = mark.strip(" ") or mark
    is_right(read_albedo(written(tmp_path, f"wavelength_nm{plain}albedo\n" + rows(NM, mark=mark))))
    is_right(read_albedo(written(tmp_path, "\ufeff" + rows(NM, mark=mark).replace("\n", "  # remark\r\n\n"))))


def test_a_mark_behind_the_last_cell(tmp_path):
    is_right(read_albedo(written(tmp_path, "wavelength_nm,albedo\n" + rows(NM, mark=",").replace("\n", ",\n"))))


def test_output_over_wavenumber_runs_up_in_wavelength(tmp_path):
    wavenumber = np.linspace(10000.0, 33333.0, 301)
    albedo = 0.3 + 0.2 * np.sin(wavenumber / 2000.0)
    # as pandas writes such a frame: with a first column that has no name
    text = ",wavenumber,albedo\n" + "".join(
        f"{i},{float(x)!r},{float(y)!r}\n" for i, (x, y) in enumerate(zip(wavenumber, albedo, strict=True))
    )
    found = read_albedo(written(tmp_path, text, "picaso.csv"))
    assert np.all(np.diff(found.wavelength_nm) > 0.0)
    np.testing.assert_allclose(found.wavelength_nm, (wavenumber / u.cm).to_value(u.nm, u.spectral())[::-1], rtol=1e-14)
    np.testing.assert_array_equal(found.albedo, albedo[::-1])


def test_columns_are_told_by_name_in_any_order(tmp_path):
    text = "albedo,wavelength_nm\n" + rows(ALBEDO, NM, mark=",")
    is_right(read_albedo(written(tmp_path, text)))
    text = "phase,geomalb,albedo_err,waveln\n" + "".join(
        f"0,{y!r},0.01,{x!r}\n" for x, y in zip(IN_UNIT["um"].tolist(), ALBEDO.tolist(), strict=True)
    )
    is_right(read_albedo(written(tmp_path, text)))


def test_a_remark_with_such_a_word_is_no_heading(tmp_path):
    # taken for names of columns, this one would swap them, and pass: all numbers are below 1
    is_right(read_albedo(written(tmp_path, "# albedo spectrum\n" + rows(IN_UNIT["um"]))))
    is_right(read_albedo(written(tmp_path, "# Jupiter wavelengths\n" + rows(IN_UNIT["um"]))))


@pytest.mark.parametrize(("kind", "name"), [("ascii.ecsv", "a.ecsv"), ("fits", "a.fits"), ("votable", "a.vot")])
@pytest.mark.parametrize("unit", [u.nm, u.um, u.AA, 1 / u.cm, u.m, u.eV])
def test_tables_with_units(tmp_path, kind, name, unit):
    table = Table({"grid": (NM * u.nm).to(unit, u.spectral())[::-1], "refl": ALBEDO[::-1]})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # astropy finds the Angstrom old-fashioned in a VOTable
        table.write(tmp_path / name, format=kind)
    np.testing.assert_allclose(read_albedo(tmp_path / name).wavelength_nm, NM, rtol=1e-13)
    np.testing.assert_array_equal(read_albedo(tmp_path / name).albedo, ALBEDO)


def test_percent_and_words_beside_the_numbers(tmp_path):
    table = Table({"note": ["a", "b", "c", "d"], "wavelength_nm": NM, "albedo": 100.0 * ALBEDO * u.percent})
    table.write(tmp_path / "a.ecsv")
    is_right(read_albedo(tmp_path / "a.ecsv"))


@pytest.mark.parametrize("name", ["wavelength_nm", "wavelength_um", "wavelength_angstrom", "wavenumber_cm1"])
def test_npz(tmp_path, name):
    np.savez(tmp_path / "a.npz", **{name: IN_UNIT[name.split("_")[1]], "albedo": ALBEDO, "cube": np.ones((2, 2))})
    is_right(read_albedo(tmp_path / "a.npz"))


@pytest.mark.parametrize(
    "unit", ["nm", "um", "angstrom", "cm-1", "1 / cm", "Angstrom", "AA", "micron", "0.1 um", "THz"]
)
def test_unit_given_by_hand(tmp_path, unit):
    values = (NM * u.nm).to_value(u.Unit({"cm-1": "1 / cm"}.get(unit, unit)), u.spectral())
    np.testing.assert_allclose(read_albedo(written(tmp_path, rows(values)), unit=unit).wavelength_nm, NM, rtol=1e-14)


def test_unit_given_by_hand_overrides_the_file(tmp_path):
    is_right(read_albedo(written(tmp_path, "wavelength_um albedo\n" + rows(NM)), unit="nm"))


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    wavelengths=st.lists(st.integers(3000, 17999), min_size=2, max_size=30, unique=True),
    unit=st.sampled_from(["nm", "um", "angstrom", "cm1"]),
    data=st.data(),
)
def test_round_trip_through_any_unit_and_order(tmp_path, wavelengths, unit, data):
    nm = np.array(wavelengths) / 10.0
    albedo = np.array(data.draw(st.lists(st.floats(0.0, 2.0), min_size=nm.size, max_size=nm.size)))
    values = (nm * u.nm).to_value(
        {"cm1": 1 / u.cm, "angstrom": u.AA}.get(unit, u.Unit("nm" if unit == "nm" else "um")), u.spectral()
    )
    name = "wavenumber_cm1" if unit == "cm1" else f"wavelength_{unit}"
    found = read_albedo(written(tmp_path, f"{name},albedo\n" + rows(values, albedo, ",")))
    order = np.argsort(nm)
    np.testing.assert_allclose(found.wavelength_nm, nm[order], rtol=1e-14)
    np.testing.assert_array_equal(found.albedo, albedo[order])


@pytest.mark.parametrize("unit", ["kg", "parsnips", "nm2", "m / s"])
def test_refuses_a_unit_that_is_none_of_light(tmp_path, unit):
    assert unit in refusal(written(tmp_path, rows(NM)), unit=unit)


def test_refuses_what_is_no_file_of_albedo_files(tmp_path):
    assert "No such file" in refusal(tmp_path / "absent.txt")
    assert "folder" in refusal(tmp_path).lower() or "directory" in refusal(tmp_path).lower()


@pytest.mark.parametrize(
    "content",
    [
        bytes(range(256)),
        b"500 0.5\n600 0.4\x00\n",
        b"PK\x03\x04 but no archive",
        b"SIMPLE  =                    T",
        b"<?xml version='1.0'?><VOTABLE>",
        b"# %ECSV 1.0\n# ---\n# datatype: [\n",
        b"# %ECSV 1.0\n# ---\n# datatype:\n# - {name: a, datatype: float64}\n# schema: astropy-2.0\na\n",
    ],
)
def test_refuses_garbage_of_albedo_files(tmp_path, content):
    path = tmp_path / "garbage.fits"
    path.write_bytes(content)
    refusal(path)


@pytest.mark.parametrize("kind", ["npz", "fits", "ecsv"])
def test_refuses_or_reads_a_damaged_file_but_never_fails_otherwise(tmp_path, kind):
    whole = tmp_path / f"a.{kind}"
    if kind == "npz":
        np.savez_compressed(whole, wavelength_nm=NM, albedo=ALBEDO)
    else:
        Table({"wavelength_nm": NM, "albedo": ALBEDO}).write(whole)
    data = whole.read_bytes()
    rng = np.random.default_rng(5)
    refused = 0
    for _ in range(60):
        broken = bytearray(data)
        broken[rng.integers(len(data))] ^= 1 << rng.integers(8)
        whole.write_bytes(bytes(broken[: rng.integers(len(data) // 2, len(data) + 1)]))
        try:
            read_albedo(whole)
        except InputError:
            refused += 1
    assert refused > 10


def test_a_table_read_without_its_objects(tmp_path):
    np.savez(tmp_path / "a.npz", wavelength_nm=NM, albedo=ALBEDO, notes=np.array([{}, None], dtype=object))
    assert "Object arrays" in refusal(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", wavelength_nm=NM, albedo=ALBEDO[1:])
    assert "albedo: 3" in refusal(tmp_path / "b.npz")


def test_refuses_a_file_too_large_to_be_a_table(tmp_path):
    path = tmp_path / "AlbedoModels.db"
    with path.open("wb") as file:
        file.truncate(300_000_000)  # takes no room on disk
    assert "log10_mh" in refusal(path)


def test_a_grid_is_not_taken_for_a_table(tmp_path):
    database = tmp_path / "grid.db"
    connection = sqlite3.connect(database)
    connection.execute("CREATE TABLE header (metallicity REAL)")
    connection.commit()
    connection.close()
    np.savez(tmp_path / "grid.npz", allphotdata=np.zeros(3))
    for path in (database, tmp_path / "grid.npz"):
        assert "log10_mh" in refusal(path)
