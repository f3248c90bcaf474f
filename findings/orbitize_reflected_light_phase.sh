#!/usr/bin/env bash
# A planet between star and observer still shines in orbitize! 3.4.0, with 6 % of its greatest brightness.
#
# Expected: `System.compute_model` gives the light that a Lambert sphere reflects ("brightness" in the table of
# measurements), with the phase angle arccos(-z / r) of the line of sight z and the distance r: on a circular orbit seen
# edge-on pi times as bright when full as at quadrature, and dark when new. Its documentation says that the maximum is 1.
# Seen: the phase angle is that whose tangent is r / z. It runs from 45 to 135 degrees only, whatever the inclination: full
# over quadrature is 2.37 instead of 3.14, new over full 0.064 instead of 0, and the greatest brightness is 0.378 (at 1 au).
# Face-on (90 degrees) is right. Without a warning, a fit prefers a false inclination or eccentricity.
# Who meets it: those who add photometry to an orbit of a planet in reflected light. (Compiles C; about 1 minute.)
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check orbitize==3.4.0 astropy==8.0.2 numpy==2.4.6
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
import math
import warnings

warnings.simplefilter("ignore")
import numpy as np
import orbitize
from astropy.table import Table
from orbitize import read_input, system

YEAR_D, FIRST_MJD = 365.2568983, 58849.0  # Kepler's third law for 1 au and one solar mass; orbitize!'s reference epoch
phase_of_orbit = np.arange(4) / 4
ones = np.ones(4)
measured = {"sep": 100 * ones, "sep_err": ones, "pa": ones, "pa_err": ones, "brightness": ones, "brightness_err": ones}
table = Table({"epoch": FIRST_MJD + YEAR_D * phase_of_orbit, "object": [1, 1, 1, 1], **measured})
data = read_input.read_file(table)
model = system.System(1, data, 1.0, 100.0)


def seen(inclination_deg):
    """Return brightness at four quarters of a circular orbit of 1 au."""
    orbit = {"sma1": 1.0, "ecc1": 0.0, "inc1": math.radians(inclination_deg), "plx": 100.0, "mtot": 1.0}
    predicted, _ = model.compute_model(np.array([orbit.get(name, 0.0) for name in model.labels]))
    return predicted[np.asarray(model.data_table["quant_type"] == "brightness"), 0]


def lambert(angle):
    return (math.sin(angle) + (math.pi - angle) * math.cos(angle)) / math.pi


face_on, (quarter, full, _, new) = seen(0.0), seen(90.0)
print(f"orbitize! {orbitize.__version__}, face-on: {np.round(face_on, 4)}")
print(f"edge-on: quadrature {quarter:.4f}, full {full:.4f}, new {new:.4f}")
print(f"full over quadrature {full / quarter:.3f}, a Lambert sphere {lambert(0.0) / lambert(math.pi / 2):.3f}")
print(f"new over full {new / full:.3f}, a Lambert sphere {lambert(math.pi) / lambert(0.0):.3f}")
assert np.allclose(face_on, 0.5 * lambert(math.pi / 2), rtol=1e-6), "face-on"
for value, angle_deg in ((full, 45), (quarter, 90), (new, 135)):
    assert math.isclose(value, 0.5 * lambert(math.radians(angle_deg)), rel_tol=1e-4), "the behaviour has changed"
PYTHON
