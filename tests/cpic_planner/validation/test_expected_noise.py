"""The noise that the calculator expects, against the scatter of apertures in many realisations of images."""

import numpy as np

from cpic_planner.etc import build_model
from cpic_planner.queries import ReferencePlanet, Strategy
from cpic_planner.targets import find_target
from cpic_planner.validation import planet_templates, prepare_task, visit_pair
from cpic_planner.validation.measure import forced_photometry
from simulator.config import load_instrument

REALISATIONS = 200


def test_expected_noise_is_the_scatter_of_apertures():
    """One visit of tau Cet in F520, where halo, the light of its errors and speckles count; variances are unbiased.

    Without the light that wavefront errors scatter, and with the halo at the planet's own place, 16 % of the variance
    was missing: more than 7 standard errors.
    """
    model = build_model(load_instrument(), ["F520"], Strategy(visits=1))
    target, _ = find_target("tau Cet")
    task = prepare_task(model, target, "F520", time_s=36000.0, planet=ReferencePlanet(), seed=21, fidelity="standard")
    visits = visit_pair(task)
    (planet,), (expected,) = planet_templates(visits), task.predictions
    measured = [forced_photometry(visits.draw(number), planet, visits.geometry) for number in range(REALISATIONS)]
    seconds = task.exposure_s * task.n_frames
    (source,) = (one for one in visits.science.truth.sources if one.kind == "planet")
    signal = source.rate_e_s * planet.core * seconds * measured[0].throughput
    relative = np.array([one.sigma_background for one in measured]) ** 2 / (signal / expected["significance"]) ** 2
    error = relative.std(ddof=1) / np.sqrt(REALISATIONS)
    assert error < 0.025
    assert abs(relative.mean() - 1.0) < 4.0 * error
    flux = np.array([one.raw_flux for one in measured]) / signal
    assert abs(flux.mean() - 1.0) < 4.0 * flux.std(ddof=1) / np.sqrt(REALISATIONS)
