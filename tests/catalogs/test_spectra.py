"""Shipped spectra: known absolute values, read-only arrays, deterministic files."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

import catalogs.spectra as spectra

DATA = Path(spectra.__file__).parent / "data"
FILES = ("stellar_grid.npz", "pickles.npz", "reference_spectra.npz", "albedo.npz", "zodiacal_light.npz")


def test_files_are_small_and_match_their_provenance() -> None:
    assert sum((DATA / name).stat().st_size for name in FILES) < 2_000_000
    entries = {item["data_file"]: item for item in json.loads((DATA / "PROVENANCE.json").read_text())["files"]}
    for name in FILES:
        assert entries[name]["sha256"] == hashlib.sha256((DATA / name).read_bytes()).hexdigest()
        assert entries[name]["licence"]
        assert entries[name]["sources"]


def test_vega_flux_at_v() -> None:
    # CALSPEC: 3.44e-9 erg/s/cm2/A at 5556 A (Megessier 1995, Bohlin 2014), within 1 per cent.
    vega = spectra.load_reference_spectrum("vega")
    photlam = np.interp(555.6, vega.wavelength_nm, vega.photlam)
    assert photlam * spectra.HC_ERG_ANGSTROM / 5556.0 == pytest.approx(3.44e-9, rel=0.01)


def test_sun_carries_most_of_the_solar_constant() -> None:
    # 300-1750 nm holds 91 per cent of 1361 W/m2 (ASTM E-490).
    sun = spectra.load_reference_spectrum("sun")
    flam = sun.photlam * spectra.HC_ERG_ANGSTROM / (10.0 * sun.wavelength_nm)
    total_w_m2 = np.trapezoid(flam, 10.0 * sun.wavelength_nm) * 1e-3
    assert total_w_m2 == pytest.approx(0.91 * 1361.0, rel=0.02)


def test_constant_is_the_exact_si_value() -> None:
    from astropy import constants, units

    assert (
        pytest.approx((constants.h * constants.c).to_value(units.erg * units.AA), rel=1e-15) == spectra.HC_ERG_ANGSTROM
    )


def test_johnson_v_pivot() -> None:
    curve = spectra.load_johnson_v()
    wavelength, transmission = curve.wavelength_nm, curve.transmission
    assert wavelength[0] == 470.0
    assert wavelength[-1] == 700.0
    assert transmission.max() == 1.0
    x = np.linspace(470.0, 700.0, 20001)
    t = np.interp(x, wavelength, transmission)
    pivot = np.sqrt(np.trapezoid(t * x, x) / np.trapezoid(t / x, x))
    assert pivot == pytest.approx(549.0, abs=2.0)


def test_zodiacal_table_landmarks() -> None:
    table = spectra.load_zodi_table()
    radiance = table.radiance_500nm_w_m2_sr_um
    assert radiance.shape == (table.helioecliptic_longitude_deg.size, table.ecliptic_latitude_deg.size) == (19, 11)
    at = {lon: i for i, lon in enumerate(table.helioecliptic_longitude_deg)}
    assert radiance[at[90.0], 0] == pytest.approx(259e-8)
    np.testing.assert_allclose(radiance[:, -1], 77e-8)  # the ecliptic pole, whatever the longitude
    missing = np.isnan(radiance)
    assert missing.sum() == 8
    assert not missing[3:].any()
    assert not missing[:, 3:].any()
    assert np.nanmax(radiance) < 2e-4  # no sentinel values left
    assert table.spectrum_wavelength_um.shape == table.spectrum_radiance_w_m2_sr_um.shape == (16,)


@pytest.mark.parametrize("planet", spectra.PLANETS)
def test_albedos_are_physical(planet: str) -> None:
    table = spectra.load_albedo(planet)
    assert table.documented_to_nm == 1050.0
    assert table.wavelength_nm[0] == 300.0
    assert table.wavelength_nm[-1] >= 1750.0
    assert np.all(np.diff(table.wavelength_nm) > 0.0)
    assert table.albedo.min() >= 0.0
    assert table.albedo.max() < 0.8


def test_pickles_library() -> None:
    library = spectra.load_pickles()
    assert library.photlam.shape == (library.position.size, library.wavelength_nm.size)
    assert np.all(library.photlam >= 0.0)
    assert {tuple(pair) for pair in zip(library.position, library.luminosity_rank, strict=True)} >= {
        (20.0, 5.0),
        (42.0, 5.0),
        (62.5, 5.0),
        (25.5, 4.0),
        (50.0, 3.0),
        (53.5, 2.0),
        (48.0, 1.0),
    }
    # All are scaled to V = 0: about 1000 ph/s/cm2/A at 550 nm.
    np.testing.assert_allclose(library.photlam[:, 240:260].mean(axis=1), 1000.0, rtol=0.1)


def test_arrays_are_read_only_and_loaded_once() -> None:
    grid = spectra.load_stellar_grid()
    assert spectra.load_stellar_grid() is grid
    for array in (
        grid.log10_flam,
        grid.ratio,
        spectra.load_reference_spectrum("sun").photlam,
        spectra.load_johnson_v().transmission,
        spectra.load_pickles().photlam,
        spectra.load_albedo("jupiter").albedo,
        spectra.load_zodi_table().radiance_500nm_w_m2_sr_um,
    ):
        with pytest.raises(ValueError, match="read-only"):
            array.flat[0] = 0.0


def test_unknown_names_are_refused(refused) -> None:
    refused("", spectra.load_reference_spectrum, "sirius")
    refused("", spectra.load_albedo, "earth")


def test_npz_bytes_depend_on_the_arrays_alone(tmp_path) -> None:
    from tools.build_catalogue.npz import write_npz

    arrays = {"a": np.arange(6.0).reshape(2, 3), "b": np.array(3.5)}
    write_npz(tmp_path / "one.npz", arrays)
    write_npz(tmp_path / "two.npz", {"a": np.asfortranarray(arrays["a"]), "b": arrays["b"]})
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    with np.load(tmp_path / "one.npz", allow_pickle=False) as back:
        np.testing.assert_array_equal(back["a"], arrays["a"])
        assert back["b"].shape == ()
