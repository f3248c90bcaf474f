"""Fit orbits with orbitize!, run in its own environment: five epochs of each draw, and the orbit that is true."""

import json
import sys

import emcee
import numpy as np
from astropy.table import Table, vstack
from orbitize import read_input, sampler, system

WALKERS, STEPS, BURNT = 60, 1000, 300
NAMES = ("sma1", "ecc1", "inc1", "aop1", "pan1", "tau1")


def fit(data, true, rng):
    """Return the central 68 % of every element by the likelihood and priors of orbitize!, and the sampler it uses."""
    model = system.System(1, data, true["mass_msun"], true["parallax_mas"], mass_err=0, plx_err=0)
    chains = sampler.MCMC(model, num_temps=1, num_walkers=WALKERS, num_threads=1)
    start = np.array([true[name] for name in NAMES])

    def log_posterior(orbits):  # many orbits at once, which its own run does one by one
        good = (orbits[:, 0] > 0) & (orbits[:, 1] >= 0) & (orbits[:, 1] < 1)
        safe = np.where(good[:, None], orbits, start)
        found = chains._logl(safe, include_logp=True)
        return np.where(good & np.isfinite(found), found, -np.inf)

    # The walkers begin as wide as the data allow around the orbit that is true: only the time to forget it counts.
    step = np.array([1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-4])
    moved = np.concatenate([np.eye(6), -np.eye(6)]) * step
    base = model.compute_model(chains._fill_in_fixed_params(start + moved).T)[0]
    errors = np.array([model.data_table["quant1_err"], model.data_table["quant2_err"]]).T[..., None]
    slopes = ((base[..., :6] - base[..., 6:]) / (2 * step) / errors).reshape(-1, 6)
    spread = np.linalg.inv(slopes.T @ slopes)
    walkers = rng.multivariate_normal(start, 0.25 * spread, WALKERS)
    ensemble = emcee.EnsembleSampler(WALKERS, 6, log_posterior, vectorize=True)
    ensemble.random_state = np.random.RandomState(int(rng.integers(2**31))).get_state()
    ensemble.run_mcmc(walkers, BURNT + STEPS)
    found = ensemble.get_chain(discard=BURNT, flat=True)
    return np.percentile(found, [16, 84], axis=0).T.tolist()


def main():
    """Read the files that are named on the standard input, and print what was found."""
    asked = json.load(sys.stdin)
    rng = np.random.default_rng(asked["seed"])
    every = vstack([Table.read(name, format="ascii.ecsv") for name in asked["ecsv"]], metadata_conflicts="silent")
    tables = [read_input.read_file(name) for name in asked["csv"]]
    of_files = vstack(tables)
    intervals = []
    for draw in asked["draws"]:
        rows = every[every["realisation"] == draw]
        given = {"epoch": rows["epoch_mjd"], "object": rows["object"]}
        given |= {"sep": 1e3 * rows["separation_arcsec"], "sep_err": 1e3 * rows["separation_error_arcsec"]}
        given |= {"pa": rows["pa_deg"], "pa_err": rows["pa_error_deg"]}
        data = read_input.read_file(Table({name: np.asarray(column) for name, column in given.items()}))
        if draw == 1:
            for name in ("epoch", "quant1", "quant1_err", "quant2", "quant2_err"):
                assert np.allclose(data[name], of_files[name], rtol=1e-12), name
            assert set(of_files["quant_type"].astype(str)) == {"seppa"}
            assert np.isnan(of_files["quant12_corr"].astype(float)).all()
            data = of_files
        intervals.append(fit(data, asked["true"], rng))
    json.dump(intervals, sys.stdout)


main()
