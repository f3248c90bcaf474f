"""The eight bands: their numbers, their provenance, and curves from files."""

import dataclasses

import numpy as np
import pytest
from astropy import units
from astropy.table import Table

from catalogs import band_from_file, band_provenance, load_bands
from catalogs.spectra import Curve


def test_eight_bands_in_order_of_wavelength() -> None:
    bands = load_bands()
    assert list(bands) == ["F520", "F662", "F720", "F850", "F940", "F1265", "F1425", "F1542"]
    assert [band.center_nm for band in bands.values()] == [520, 662, 720, 850, 940, 1265, 1425, 1542]
    assert [band.width_nm for band in bands.values()][:4] == [50, 55, 20, 25]
    assert [band.qe for band in bands.values()][:4] == [0.915, 0.90, 0.835, 0.50]
    assert [band.camera for band in bands.values()] == ["VIS"] * 4 + ["NIR"] * 4
    for band in bands.values():
        assert band.t_opt == 0.19
        if band.camera == "NIR":
            assert band.width_nm == pytest.approx(0.05 * band.center_nm, rel=1e-3)


def test_every_number_has_a_source_and_a_confidence() -> None:
    provenance = band_provenance()
    assert set(provenance) == {
        f"{name}.{key}" for name in load_bands() for key in ("center_nm", "width_nm", "t_opt", "qe")
    }
    for item in provenance.values():
        assert item.confidence in {"P", "I", "A"}
        assert item.source
    assert provenance["F850.t_opt"].range == (0.19, 0.46)
    assert provenance["F520.qe"].confidence == "P"
    assert provenance["F940.qe"].confidence == "A"


def test_loaded_mappings_are_the_callers_own() -> None:
    load_bands().clear()
    assert len(load_bands()) == 8
    assert load_bands()["F520"].center_nm == 520


def test_top_hat_transmission_is_the_product_of_its_parts() -> None:
    band = load_bands()["F720"]
    wavelength = np.array([709.9, 710.0, 715.0, 730.0, 730.1])
    assert band.support_nm == (710.0, 730.0)
    np.testing.assert_array_equal(band.filter_transmission(wavelength), [0, 1, 1, 1, 0])
    np.testing.assert_array_equal(band.quantum_efficiency(wavelength), 0.835)
    np.testing.assert_allclose(band.transmission(wavelength), 0.19 * 0.835 * np.array([0, 1, 1, 1, 0]))


def test_equal_bands_are_equal_and_hash_equal() -> None:
    first, second = load_bands()["F520"], dataclasses.replace(load_bands()["F520"])
    assert first == second
    assert hash(first) == hash(second)
    assert first is not second
    assert first != dataclasses.replace(first, t_opt=0.2)
    curve = Curve(np.array([500.0, 520.0, 540.0]), np.array([0.0, 1.0, 0.0]))
    again = Curve(curve.wavelength_nm.copy(), curve.transmission.copy())
    assert dataclasses.replace(first, curve=curve) == dataclasses.replace(first, curve=again) != first
    assert first != "F520"


def test_curve_from_file_in_either_unit(tmp_path) -> None:
    rows = np.array([[510.0, 0.0], [515.0, 0.8], [525.0, 0.8], [530.0, 0.0]])
    in_nm, in_angstrom = tmp_path / "nm.txt", tmp_path / "angstrom.csv"
    in_nm.write_text("# wavelength [nm], T\n" + "\n".join(f"{a} {b}" for a, b in rows) + "\n")
    in_angstrom.write_text("".join(f"{10 * a},{b}\n" for a, b in rows))
    first = band_from_file(in_nm, "F520", t_opt=0.3, qe=0.9)
    second = band_from_file(in_angstrom, "F520", t_opt=0.3, qe=0.9, unit="Angstrom")
    np.testing.assert_allclose(first.curve.wavelength_nm, second.curve.wavelength_nm, rtol=1e-15)
    # A symmetric trapezium: mean at its middle, width = area / peak = 15 nm.
    assert first.center_nm == pytest.approx(520.0, rel=1e-14)
    assert first.width_nm == pytest.approx(15.0, rel=1e-14)
    assert first.support_nm == (510.0, 530.0)
    assert first.filter_transmission(512.5) == pytest.approx(0.4)
    assert first.filter_transmission(509.0) == 0.0
    with pytest.raises(ValueError, match="read-only"):
        first.curve.transmission[0] = 1.0


@pytest.mark.parametrize(
    "text",
    [
        "500 0.1\n510 0.2\n",  # no unit
        "# nm and Angstrom\n500 0.1\n510 0.2\n",  # two units
        "# nm\n510 0.2\n500 0.1\n520 0.1\n",
        "# nm\n500 0.2\n500 0.1\n",
        "# nm\n500 -0.1\n510 0.2\n",
        "# nm\n500 0.1\n510 1.2\n",
        "# nm\n500 0\n510 0\n",
        "# nm\n500 0.1\n510 nan\n",
        "# nm\n500 0.1 3\n510 0.2 3\n",
        "# nm\n500 0.1\n",
        "# nm\n500 0.1\nwave trans\n510 0.2\n",
        "# nm\n500 90\n510 95\n",
    ],
)
def test_bad_curve_is_refused(refused, tmp_path, text: str) -> None:
    path = tmp_path / "curve.txt"
    path.write_text(text)
    refused("", band_from_file, path, "X", t_opt=0.3, qe=0.9)


ROWS = [[510.0, 0.0], [515.0, 0.8], [525.0, 0.8], [530.0, 0.0]]


def written_curve(folder, head, scale=1.0, percent=1.0, mark=" ", rows=ROWS):
    path = folder / "curve.dat"
    path.write_text(head + "".join(f"{w * scale!r}{mark}{t * percent!r}\n" for w, t in rows))
    return path


@pytest.mark.parametrize(
    ("head", "scale"),
    [
        ("# um transmission\n", 1e-3),
        ("# wavelength in \N{GREEK SMALL LETTER MU}m\n", 1e-3),
        ("# wavelength (microns), transmission\n", 1e-3),
        ("wavelength_um transmission\n", 1e-3),
        ("lambda_nm transmission\n", 1.0),
        ("Wavelength[Angstrom] T\n", 10.0),
        ("# nm T\n", 1.0),
    ],
)
def test_units_of_headings_and_comments_are_read(tmp_path, head, scale):
    found = band_from_file(written_curve(tmp_path, head, scale), "X", t_opt=0.3, qe=0.9)
    assert (found.center_nm, found.width_nm) == (pytest.approx(520.0), pytest.approx(15.0))


def test_percent_of_a_heading_is_read(tmp_path):
    found = band_from_file(written_curve(tmp_path, "lambda_nm,%T\n", percent=100.0, mark=","), "X", t_opt=0.3, qe=0.9)
    assert found.curve.transmission.max() == pytest.approx(0.8)


@pytest.mark.parametrize(
    ("head", "said"),
    [
        ("wave (furlong) T\n", "unit = furlong: .*not understood"),
        ("# T\n", "not stated"),
        ("# nm or um\n", "nm and um"),
    ],
)
def test_refusals_of_units_are_true(refused, tmp_path, head, said):
    refused(f"{said}", band_from_file, written_curve(tmp_path, head), "X", t_opt=0.3, qe=0.9)


@pytest.mark.filterwarnings("ignore:The unit 'Angstrom' has been deprecated")
@pytest.mark.parametrize("form", ["ascii.ecsv", "votable", "fits"])
@pytest.mark.parametrize(("unit", "scale"), [("nm", 1.0), ("Angstrom", 10.0), ("um", 1e-3), ("0.1 nm", 10.0)])
def test_curves_of_tables_have_the_unit_of_their_column(tmp_path, form, unit, scale):
    wavelength, transmission = np.array(ROWS).T
    path = tmp_path / "curve"
    Table({"wave": wavelength * scale * units.Unit(unit), "T": transmission}).write(path, format=form)
    found = band_from_file(path, "X", t_opt=0.3, qe=0.9)
    assert (found.center_nm, found.width_nm) == (pytest.approx(520.0), pytest.approx(15.0))


def test_zeros_beyond_the_ends_are_left_out(tmp_path):
    padded = [[200.0, 0.0], [505.0, 0.0], *ROWS, [540.0, 0.0], [1900.0, 0.0]]
    found = band_from_file(written_curve(tmp_path, "# nm\n", rows=padded), "X", t_opt=0.3, qe=0.9)
    assert found.support_nm == (510.0, 530.0)
    assert found == band_from_file(written_curve(tmp_path, "# nm\n"), "X", t_opt=0.3, qe=0.9)
    cut = band_from_file(written_curve(tmp_path, "# nm\n", rows=ROWS[1:3]), "X", t_opt=0.3, qe=0.9)
    assert cut.support_nm == (515.0, 525.0)


def test_unreadable_curve_is_refused(refused, tmp_path) -> None:
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00\x81")
    for name, unit in (("missing", "nm"), ("binary", "nm"), ("binary", "furlong")):
        refused("", band_from_file, tmp_path / name, "X", t_opt=0.3, qe=0.9, unit=unit)
