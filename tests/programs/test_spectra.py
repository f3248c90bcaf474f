"""species and TauREx read the exported photometry of a planet."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from astropy.table import Table

import cpic_planner

pytestmark = pytest.mark.programs
EDGES_UM = {"F520": (0.495, 0.545), "F662": (0.6345, 0.6895), "F720": (0.71, 0.73), "F850": (0.8375, 0.8625)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Confirm the planet of the paper in four bands; return the folder of what is exported."""
    out = tmp_path_factory.mktemp("bands") / "scene"
    frames = {"exposure_s": 9.5, "n_frames": 60, "em_gain": 150.0, "visits": 1}
    cpic_planner.confirm_scene("paper_example", out=out, realisations=2, audit=False, **frames)
    return out / "export"


def told_by(python: Path, script: str, *arguments: Path, cwd: Path) -> Any:
    """Return what a script of this folder prints last, by the interpreter of a program."""
    command = [python, "-W", "ignore", Path(__file__).with_name(script), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])


def test_species_reads_and_draws_the_photometry(folder: Path, tmp_path: Path, program: Callable[..., Path]) -> None:
    python, picture = program("species==0.11.0"), tmp_path / "planet.png"
    told = told_by(python, "species_read.py", folder, picture, cwd=tmp_path)
    table = Table.read(folder / "photometry.ecsv", format="ascii.ecsv")
    table = table[table["realisation"] == 1]
    assert set(told) == set(EDGES_UM)
    for row in table:
        low, high = EDGES_UM[row["band"]]
        assert told[row["band"]]["point"] == pytest.approx([row["flux"], row["flux_error"]], rel=1e-12)
        # The mean of a flux that grows as the wavelength, weighted by photons in a top hat.
        mean = (high**3 - low**3) / 3 / ((high**2 - low**2) / 2)
        assert told[row["band"]]["of_wavelength"] == pytest.approx(mean, rel=2e-5)
    assert picture.stat().st_size > 5000


def test_taurex_reads_contrasts_in_their_bands(folder: Path, program: Callable[..., Path]) -> None:
    told = told_by(program("taurex==3.3.2"), "taurex_read.py", folder / "spectrum-1.txt", cwd=folder)
    table = Table.read(folder / "photometry.ecsv", format="ascii.ecsv")
    table = table[table["realisation"] == 1][::-1]  # by wavenumber
    assert told["contrast"] == pytest.approx(list(table["contrast"]), rel=1e-12)
    assert told["error"] == pytest.approx(list(table["contrast_error"]), rel=1e-12)
    edges = sorted(edge for pair in EDGES_UM.values() for edge in pair)
    assert sorted(told["edges"]) == pytest.approx(edges, rel=1e-9)
    assert told["binned"] == pytest.approx([3e-8] * 4, rel=1e-6)
