#!/usr/bin/env bash
# With a column of correlations between separation and angle, OFTI of orbitize! 3.4.0 takes every orbit that it tries.
#
# Expected: "OFTI" draws orbits, scales them to one measurement, and keeps each with the probability exp(-chi2 / 2). A
# correlation of 0 between the errors of separation and position angle (`seppa_corr`, as many catalogues of astrometry
# have it) says what an empty column says: the same orbits are kept.
# Seen: 12 of 20 000 orbits are kept without the column, 20 000 of 20 000 with zeros in it, chi2 of 400 among them, and
# nothing warns. The likelihood itself is right. `lnlike.chi2_norm_term`, which OFTI takes off the likelihood to be left
# with chi2, adds the determinant of the covariance where its logarithm belongs, and that of the first such row for all.
# Who meets it: everybody who gives measurements with a correlation and draws orbits by OFTI; MCMC does not use the term.
# (Compiles C; about 1 minute.)
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
from orbitize import read_input, sampler, system
from orbitize.lnlike import chi2_norm_term

DAYS, TRIED = np.arange(4) * 30.0, 20_000  # a quarter of a circular orbit of 1.6 au around 0.78 solar masses at 3.65 pc
ones = np.ones(4)
measured = {
    "epoch": 60_000.0 + DAYS, "object": [1] * 4,
    "sep": 450.0 * ones, "sep_err": 30.0 * ones, "pa": 80.0 + 0.414 * DAYS, "pa_err": 5.0 * ones,
}
kept = {}
for name, more in (("no column", {}), ("zeros", {"seppa_corr": 0.0 * ones})):
    model = system.System(1, read_input.read_file(Table(measured | more)), 0.78, 274.0)
    np.random.seed(1)
    ofti = sampler.OFTI(model)
    orbits, lnlike = ofti.reject(ofti.prepare_samples(TRIED))[:2]
    best = 4 * -0.5 * (math.log((30.0 * 5.0) ** 2) + 2.0 * math.log(2.0 * math.pi))  # of the likelihood, where chi2 is 0
    kept[name] = len(orbits)
    chi2 = np.percentile(-2.0 * (np.asarray(lnlike) - best), [50, 95])
    print(f"orbitize! {orbitize.__version__}, {name}: {len(orbits)} of {TRIED} kept, chi2 {chi2[0]:.0f} (95 %: {chi2[1]:.0f})")
errors = np.array([[30.0, 5.0], [2.0, 0.5]])
right, seen = chi2_norm_term(errors, None), chi2_norm_term(errors, np.zeros(2))
print(f"term of two measurements: {right:.2f} without the column, {seen:.2f} with zeros")
assert kept["no column"] < TRIED / 200, "without the column"
assert kept["zeros"] == TRIED, "the behaviour has changed"
assert math.isclose(seen, -0.5 * (2 * (30.0 * 5.0) ** 2 + 4 * math.log(2.0 * math.pi)), rel_tol=1e-9), "the term has changed"
PYTHON
