"""The fit of the parametric albedo: it finds known parameters again, and predicts a band that it did not see."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from simulator.target import load_parametric_grid
from simulator.target.albedo import node_albedo, phase_curve
from tools.calibrate_albedo.grid_fit import BANDS_NM, Measured, band_albedo, fit_parameters, fit_phase, read_table

TABLE = Path(__file__).resolve().parents[5] / "shared" / "validation" / "batalha2018_band_albedos.csv.gz"
needs_table = pytest.mark.skipif(not TABLE.exists(), reason="the validation folder with the model grid is not here")
PHASES = np.arange(0.0, 181.0, 10.0)


def synthetic():
    """A small table made by the model itself, smooth over its axes."""
    grid = load_parametric_grid()
    fsed, distance, metal = np.array([1.0, 6.0]), np.array([1.5, 2.0, 3.0]), np.array([0.0, 1.0, 2.0])
    f, d, m = np.meshgrid(fsed, distance, metal, indexing="ij")
    parameters = np.stack(
        [
            -3.0 + 0.3 * np.log(f),
            0.0 * f,
            1.5 - 0.3 * np.log(d),
            -0.1 + 0 * f,
            -3.0 + 0 * f,
            -1.0 + 0 * f,
            -5.0 + 0 * f,
        ],
        axis=-1,
    )
    bands = band_albedo(parameters.reshape(-1, 7), m.ravel(), grid.wavelength_nm, grid.methane_per_km_am)
    shape = phase_curve([0.2, -2.0, 0.5], PHASES)
    albedo = bands.reshape(*f.shape, 1, len(BANDS_NM)) * shape[:, None]
    return Measured(fsed, distance, metal, PHASES, albedo), grid


def test_bands_are_means_over_the_model_spectrum():
    grid = load_parametric_grid()
    node = grid.parameters[6, 6, 2]
    fine = np.arange(628.0, 694.0, 0.25)
    spectrum = node_albedo(node, 1.0, fine, np.interp(fine, grid.wavelength_nm, grid.methane_per_km_am))
    ours = band_albedo(node[None], np.array([1.0]), grid.wavelength_nm, grid.methane_per_km_am)[0]
    assert ours[list(BANDS_NM).index("albedo_661nm")] == pytest.approx(spectrum.mean(), abs=3e-3)


@pytest.mark.long
def test_own_spectra_are_recovered():
    measured, grid = synthetic()
    found = fit_parameters(measured, grid.wavelength_nm, grid.methane_per_km_am)
    metal = np.broadcast_to(measured.log10_mh, measured.full_phase.shape[:3]).ravel()
    again = band_albedo(found.reshape(-1, 7), metal, grid.wavelength_nm, grid.methane_per_km_am)
    assert np.max(np.abs(again.reshape(measured.full_phase.shape) - measured.full_phase)) < 0.01


def test_own_phase_curve_is_recovered():
    measured, _ = synthetic()
    found = phase_curve(fit_phase(measured), PHASES)
    assert np.max(np.abs(found - phase_curve([0.2, -2.0, 0.5], PHASES))) < 1e-4


@needs_table
def test_a_band_that_was_held_out_is_predicted():
    grid = load_parametric_grid()
    near = read_table(TABLE).nearest_insolations(2.0, 1)
    found = fit_parameters(near, grid.wavelength_nm, grid.methane_per_km_am, without="albedo_661nm")
    metal = np.broadcast_to(near.log10_mh, near.full_phase.shape[:3]).ravel()
    ours = band_albedo(found.reshape(-1, 7), metal, grid.wavelength_nm, grid.methane_per_km_am)
    away = np.abs(ours.reshape(near.full_phase.shape) - near.full_phase)[..., list(BANDS_NM).index("albedo_661nm")]
    assert np.median(away) < 0.02


def test_bad_tables_are_refused(refused, tmp_path):
    path = tmp_path / "short.csv.gz"
    header = ",".join(("fsed", "distance_au", "log10_mh", "phase_deg", *BANDS_NM))
    with gzip.open(path, "wt") as stream:
        stream.write(
            f"{header}\n1,1,0,0,{','.join('0.5' for _ in BANDS_NM)}\n3,2,0,0,{','.join('0.5' for _ in BANDS_NM)}\n"
        )
    refused("full grid", read_table, path)
    plain = tmp_path / "other.csv"
    plain.write_text("a,b\n1,2\n")
    refused("fsed", read_table, plain)
