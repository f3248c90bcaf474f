"""Prediction against measurement over many realisations."""

import functools

import numpy as np
import pytest

from cpic_planner.engine import single_threaded_blas
from cpic_planner.etc.exozodi import exozodi_disc
from cpic_planner.etc.model import build_model
from cpic_planner.etc.planet import ReferencePlanet, reference_distance_au
from cpic_planner.etc.speckles import speckle_law
from cpic_planner.targets import find_target
from cpic_planner.validation.apertures import sample_scatter
from cpic_planner.validation.calibration import calibrate, snr_scatter
from cpic_planner.validation.confirm import (
    ConfirmTask,
    confirm_task,
    decode_arrays,
    encode_arrays,
    prepare_task,
    target_scene,
)
from cpic_planner.validation.rdi import rdi_subtract
from simulator import load_instrument, observe

SEEDS = {"photons": 40, "speckles": 20, "companion": 20}
STILL = {"drift": {"visit_nm": 0, "walk_nm_per_sqrt_hour": 0}}
CASES = {
    "photons": ("tau Cet", "F520", STILL),
    "speckles": ("eps Eri", "F662", {}),
    "companion": ("alf Cen B", "F850", {}),
}


@functools.cache
def confirmations(case):
    """Measured realisations of one case, shared by the tests below."""
    star, band, changes = CASES[case]
    model = build_model(load_instrument(changes), [band])
    target, _ = find_target(star)
    found = []
    for seed in range(SEEDS[case]):
        # The statistics are those of the chain; what a finer optical model adds to its images is tested elsewhere.
        asked = {"time_s": 1800.0, "planet": ReferencePlanet(), "seed": seed, "fidelity": "quick"}
        task = prepare_task(model, target, band, **asked)
        assert isinstance(task, ConfirmTask)
        with single_threaded_blas():
            found.append(confirm_task(task.to_dict())["confirmation"])
    return found


def column(found, name):
    return np.array([item[name] for item in found], float)


@pytest.mark.parametrize("case", CASES)
def test_contrast_is_unbiased_and_its_error_honest(case):
    found = confirmations(case)
    names = ("recovered_contrast", "true_contrast", "contrast_error")
    recovered, truth, error = (column(found, name) for name in names)
    assert abs(recovered.mean() - truth[0]) < 4 * recovered.std(ddof=1) / np.sqrt(SEEDS[case])
    pull = (recovered - truth) / error
    # Student's t of some 15 apertures is wider than a Gaussian by 7 %; 20 draws know a width to 16 %.
    assert pull.std(ddof=1) == pytest.approx(1.07, abs=4 * 0.17)


@pytest.mark.parametrize("case", CASES)
def test_predicted_noise_is_recovered(case):
    found = confirmations(case)
    predicted = found[0]["true_contrast"] / found[0]["predicted_snr"]
    # Variances average without bias; 1/sigma of few apertures does not.
    variance = (column(found, "contrast_error") / predicted) ** 2
    # 10 % in SNR for what the analytic model leaves out, plus statistics
    assert variance.mean() == pytest.approx(1.0, abs=0.20 + 3 * variance.std(ddof=1) / np.sqrt(SEEDS[case]))
    assert column(found, "saturated_in_hole").sum() == 0
    spread = np.std(column(found, "recovered_snr"), ddof=1)
    expected = snr_scatter(
        found[0]["predicted_snr"], found[0]["predicted_significance"], found[0]["n_background_apertures"]
    )
    assert 0.5 < spread / expected < 2.0


def test_speckle_floor_is_that_of_the_subtraction_that_runs():
    """Noise-free sequences through the same RDI: the rms of aperture sums is the ETC's speckle term."""
    instrument = load_instrument({"drift": {"walk_nm_per_sqrt_hour": 0}})
    scene = {"name": "s", "cstar": {"name": "s", "v_mag": 0.0, "teff_k": 5800}}
    squares, separation = [], 0.5
    for seed in range(40):
        pair = [
            observe(scene, band="F520", exposure_s=1.0, seed=seed, role=role, window="hole", instrument=instrument)
            for role in ("science", "reference")
        ]
        metrics, star = pair[0].psf.metrics, pair[0].truth.sources[0].rate_e_s
        maps = [np.repeat((sequence.mean_rate_map / star)[None], 3, axis=0) for sequence in pair]
        left = rdi_subtract(maps[0], maps[1], 1, region=metrics.hole, centering="temporal").residuals[0]
        annulus = metrics.annulus(separation, 1.5)
        sigma, _ = sample_scatter(left, annulus, metrics.aperture_radius_arcsec / metrics.pixel_scale_arcsec)
        squares.append(sigma**2)
    measured = np.sqrt(np.mean(squares))
    error = np.std(squares, ddof=1) / np.sqrt(len(squares)) / (2 * measured)
    metrics = build_model(instrument, ["F520"]).metrics["F520"]
    predicted = float(speckle_law(metrics, instrument.drift, separation, 1.5).k0 ** 0.5)
    assert measured == pytest.approx(predicted, abs=0.08 * predicted + 3 * error)


def test_an_altered_simulator_is_noticed():
    """Throughput x 0.5 in the images alone: the recovered contrast of the same planet falls by half."""
    model = build_model(load_instrument(), ["F520"])
    target, _ = find_target("alf Cen B")
    task = prepare_task(model, target, "F520", time_s=2000.0, planet=ReferencePlanet(), seed=1, fidelity="standard")
    tree = task.to_dict()
    tree["instrument"]["bands"]["F520"]["t_opt"] *= 0.5
    altered = confirm_task(tree)["confirmation"]
    plain = confirm_task(task.to_dict())["confirmation"]
    assert altered["recovered_snr"] < 0.85 * plain["recovered_snr"]


def test_calibration_weighs_and_widens():
    class Band:
        def __init__(self, predicted, recovered, n=1000):
            self.predicted_snr = self.predicted_significance = predicted
            self.recovered_snr, self.n_background_apertures = recovered, n

    assert calibrate([]).ratio is None
    one = calibrate([Band(10.0, 9.0)])
    assert one.ratio == pytest.approx(0.9)
    assert one.error == pytest.approx(snr_scatter(10.0, 10.0, 1000) / 10.0)
    rng = np.random.default_rng(0)
    draws = [
        calibrate([Band(p, p + rng.normal(0, snr_scatter(p, p, 1000))) for p in (5.0, 10.0, 20.0, 40.0)])
        for _ in range(2000)
    ]
    ratios, errors = np.array([d.ratio for d in draws]), np.array([d.error for d in draws])
    assert abs(ratios.mean() - 1) < 4 * ratios.std() / np.sqrt(len(draws))
    assert np.mean(np.abs(ratios - 1) < errors) > 0.66


def test_arrays_survive_the_part_file():
    arrays = {"a": np.arange(6, dtype=np.float32).reshape(2, 3), "b": np.array([np.nan], np.float32)}
    back = decode_arrays(encode_arrays(arrays))
    for name, array in arrays.items():
        np.testing.assert_array_equal(back[name], array)


def test_dust_of_the_instrument_is_in_science_and_reference():
    target, _ = find_target("tau Cet")
    planet = ReferencePlanet()
    distance = float(reference_distance_au(target, np.array([0.6]), planet)[0, 0])
    plain = target_scene(target, planet, 0.6, distance)
    dusty = target_scene(target, planet, 0.6, distance, exozodi_zodis=7.0)
    assert plain.extended == ()
    assert dusty.extended == dusty.without_planets().extended == (exozodi_disc(7.0),)
    for zodis in (0.0, 7.0):
        model = build_model(load_instrument({"sky": {"exozodi_zodis": zodis}}), ["F662"])
        task = prepare_task(model, target, "F662", time_s=1800.0, planet=planet, seed=1, fidelity="quick")
        assert [disc["contrast"] for disc in task.scene["extended"]] == ([exozodi_disc(7.0).contrast] if zodis else [])
