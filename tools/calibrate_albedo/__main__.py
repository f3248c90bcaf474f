"""Make ``parametric_albedo.npz`` anew: ``python -m tools.calibrate_albedo --table FILE``.

Invert the methane coefficients, fit the nodes, and write the table (or compare it with ``--check``).
"""

import argparse
from pathlib import Path

import numpy as np

from cpic_core import read_npz, write_npz
from simulator.target.albedo import data_file
from tools.calibrate_albedo.grid_fit import fit_parameters, fit_phase, read_table
from tools.calibrate_albedo.methane import invert_methane

_SPECTRA_NM = np.arange(300.0, 1755.0, 2.0)
_DOCUMENTED_TO_NM = 1050.0
# Towards 400 nm the inversion takes the colour of the planets' hazes for methane, which hardly absorbs there.
_FADE_IN_NM = (400.0, 440.0)


def _faded_in(wavelength_nm: np.ndarray) -> np.ndarray:
    """Return the share of the inverted coefficients that is kept: from 0 to 1, without a step or a kink."""
    low, high = _FADE_IN_NM
    place = np.clip((wavelength_nm - low) / (high - low), 0.0, 1.0)
    return place * place * (3.0 - 2.0 * place)


def make(table: Path) -> dict[str, np.ndarray]:
    """Return the arrays of the shipped file."""
    measured, methane = read_table(table), invert_methane()
    # Beyond the last bin the last value holds.
    k = np.interp(_SPECTRA_NM, methane.wavelength_nm, methane.per_km_am) * _faded_in(_SPECTRA_NM)
    parameters = fit_parameters(measured, _SPECTRA_NM, k)
    return {
        "fsed": measured.fsed,
        "insolation_au": measured.insolation_au,
        "log10_mh": measured.log10_mh,
        "parameters": parameters.astype("<f4"),
        "phase": fit_phase(measured).astype("<f4"),
        "wavelength_nm": _SPECTRA_NM,
        "methane_per_km_am": k.astype("<f4"),
        "documented_to_nm": np.array(_DOCUMENTED_TO_NM),
    }


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--table", type=Path, required=True, help="band albedos of the public grid, csv or csv.gz")
    parser.add_argument("--check", action="store_true", help="compare with the shipped file, write nothing")
    arguments = parser.parse_args()
    made = make(arguments.table)
    if not arguments.check:
        write_npz(data_file(), made)
        print(f"wrote {data_file()}")
        return
    shipped = read_npz(data_file())
    for name, array in made.items():
        print(f"{name}: largest difference {np.max(np.abs(array - shipped[name])):.2g}")


if __name__ == "__main__":
    main()
