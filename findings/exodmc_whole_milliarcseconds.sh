#!/usr/bin/env bash
# EXO-DMC 2.0.0 sees every planet inside the inner working angle if the detection limits of several stars stand in whole
# mas.
#
# Expected: `exodmc.DImode` gives one map of detection probabilities, whether the separations of the limits come as
# arcseconds (lxunit="as"), milliarcseconds ("mas") or au, and whether they are written 100 or 100.0.
# Seen, for two stars or more: the separations become one array, of integers if all are whole, and its rows are divided in
# place: 100, 200, 500, 900, 1500 mas are 0, 0, 0, 0, 1 arcsec. At 1 au and 10 pc, inside the 0.1 arcsec where the limit
# begins, the probability is 1.00 instead of 0.05. Written with a point the map is right. An array of the caller's own is
# divided too: the second call with it finds nothing, for its limits are then 1000 times as close. One star is right. The
# package needs numpy before 2.1 (it calls nonzero on a single value), which it does not say.
# Who meets it: statistics of surveys, where limits of many stars are put in at once.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check \
    exodmc==2.0.0 numpy==2.0.2 scipy==1.14.1 matplotlib==3.9.4
cd "$folder"
MPLCONFIGDIR="$folder" "$folder/venv/bin/python" - <<'PYTHON'
import warnings

warnings.simplefilter("ignore")
import numpy as np
from DMC import exodmc

SEPARATIONS_MAS, MASSES_MJUP = [100, 200, 500, 900, 1500], [10.0, 5.0, 3.0, 3.0, 3.0]


def innermost(separations, unit, stars=2):
    """Return the probability of a planet of 12.4 Jupiter masses at 1 au around the first of some stars at 10 pc."""
    np.random.seed(1)
    survey = exodmc([f"star {i}" for i in range(stars)], [10.0] * stars)
    survey.set_grid(x_min=1, x_max=20, nx=8, y_min=1, y_max=20, ny=6, ngen=300)
    masses = [MASSES_MJUP] * stars if stars > 1 else MASSES_MJUP
    return float(survey.DImode(separations, masses, lxunit=unit, verbose=False, plot=False)[0][0, 3])


points = [float(mas) for mas in SEPARATIONS_MAS]
right = innermost([[mas / 1000 for mas in SEPARATIONS_MAS]] * 2, "as")
given = np.array([points] * 2)
found = {
    "mas, with points": innermost([points] * 2, "mas"),
    "mas, whole numbers, one star": innermost(SEPARATIONS_MAS, "mas", stars=1),
    "mas, whole numbers, two stars": innermost([SEPARATIONS_MAS] * 2, "mas"),
    "mas, an array": innermost(given, "mas"),
    "mas, the same array again": innermost(given, "mas"),
}
print(f"exodmc 2.0.0, numpy {np.__version__}: arcsec {right:.3f}; {found}; the array afterwards {given[0].tolist()}")
assert 0 < right < 0.1
for name in ("mas, with points", "mas, whole numbers, one star", "mas, an array"):
    assert found[name] == right, name
assert found["mas, whole numbers, two stars"] == 1.0, "the behaviour has changed"
assert found["mas, the same array again"] == 0.0, "the behaviour has changed"
PYTHON
