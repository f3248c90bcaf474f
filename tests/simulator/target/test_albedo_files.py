"""Tables of wavelength and albedo: every format, unit and way to be wrong."""

import sqlite3
import warnings

import astropy.units as u
import numpy as np
import pytest
from astropy.table import Table
from hypothesis import HealthCheck, given, settings, strategies as st

from cpic_core import InputError
from simulator.target.albedo_grid import read_albedo

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


def test_refuses_what_is_no_file(tmp_path):
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
def test_refuses_garbage(tmp_path, content):
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
