"""orbitize! reads the exported places of a planet and finds its orbit."""

from __future__ import annotations

import json
import math
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from astropy.time import Time
from scipy.stats import binomtest

import cpic_planner
from simulator import load_scene

pytestmark = pytest.mark.programs
DRAWS = 10
DATES = ("2028-01-16", "2028-04-05", "2028-06-11", "2028-08-16", "2028-12-16")
# Elements as orbitize! names them; a planet at 1.35 pc that stands in the dark hole at the five dates.
TRUE = {"sma1": 0.9, "ecc1": 0.15, "inc1": 0.5, "aop1": 1.0, "pan1": 0.7, "tau1": 0.3}
TRUE |= {"mass_msun": 0.9, "parallax_mas": 1e3 / 1.35}
_TAU_EPOCH_MJD = 58849.0


def place(mjd: float) -> tuple[float, float]:
    """Return separation (arcsec) and position angle (deg) by Kepler's equation and Thiele-Innes rotations."""
    year = 365.25 * math.sqrt(TRUE["sma1"] ** 3 / TRUE["mass_msun"])
    mean = 2 * math.pi * ((mjd - _TAU_EPOCH_MJD) / year - TRUE["tau1"])
    anomaly = mean
    for _ in range(60):
        anomaly -= (anomaly - TRUE["ecc1"] * math.sin(anomaly) - mean) / (1 - TRUE["ecc1"] * math.cos(anomaly))
    x = math.cos(anomaly) - TRUE["ecc1"]
    y = math.sqrt(1 - TRUE["ecc1"] ** 2) * math.sin(anomaly)
    along = x * math.cos(TRUE["aop1"]) - y * math.sin(TRUE["aop1"])
    across = (x * math.sin(TRUE["aop1"]) + y * math.cos(TRUE["aop1"])) * math.cos(TRUE["inc1"])
    north = along * math.cos(TRUE["pan1"]) - across * math.sin(TRUE["pan1"])
    east = along * math.sin(TRUE["pan1"]) + across * math.cos(TRUE["pan1"])
    scale = TRUE["sma1"] * TRUE["parallax_mas"] / 1e3
    return scale * math.hypot(north, east), math.degrees(math.atan2(east, north)) % 360.0


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Confirm the scene at five dates, each time with the planet where its orbit puts it at the middle."""
    folders = []
    for date in DATES:
        tree: dict[str, Any] = load_scene("paper_example").model_dump(mode="json")
        start = float(Time(date, scale="utc").mjd)
        settings = {"bands": "F520", "exposure_s": 9.5, "n_frames": 60, "em_gain": 150.0, "visits": 1}
        # 60 science and 60 reference frames of 9.5 s, readouts and 600 s of overhead, of which the Earth hides 54 %.
        separation, pa = place(start + 0.02)
        tree["planets"][0] |= {"separation_arcsec": separation, "pa_deg": pa}
        out = tmp_path_factory.mktemp("epoch")
        cpic_planner.confirm_scene(tree, date_utc=date, out=out, realisations=DRAWS, audit=False, **settings)
        folders.append(out)
    return folders


def test_orbitize_covers_the_elements(files: list[Path], program: Callable[..., Path]) -> None:
    python = program("orbitize==3.4.0", "astropy==8.0.2", "numpy==2.4.6")
    asked = {
        "csv": [str(folder / "export" / "astrometry.csv") for folder in files],
        "ecsv": [str(folder / "export" / "astrometry.ecsv") for folder in files],
        "draws": list(range(1, DRAWS + 1)),
        "true": TRUE,
        "seed": 5,
    }
    script = Path(__file__).with_name("orbitize_fit.py")
    done = subprocess.run(
        [python, "-W", "ignore", script],
        input=json.dumps(asked),
        capture_output=True,
        text=True,
        check=False,
        cwd=files[0],
    )
    assert done.returncode == 0, done.stderr[-2000:]
    intervals = np.array(json.loads(done.stdout.splitlines()[-1]))
    assert intervals.shape == (DRAWS, 6, 2)
    true = np.array([TRUE[name] for name in ("sma1", "ecc1", "inc1", "aop1", "pan1", "tau1")])
    inside = (intervals[..., 0] <= true) & (true <= intervals[..., 1])
    print(inside.mean(axis=0), (np.diff(intervals, axis=-1)[..., 0] / 2).mean(axis=0))
    for element, covered in zip(TRUE, inside.T, strict=False):
        assert binomtest(int(covered.sum()), DRAWS, 0.68).pvalue > 0.01, element
    # Size of an element known from five epochs: an interval that is wide covers anything.
    assert (np.diff(intervals, axis=-1)[..., 0] / 2)[:, 0].max() < 0.03
