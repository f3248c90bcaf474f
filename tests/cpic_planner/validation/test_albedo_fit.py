import math
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from cpic_planner.validation import AlbedoFit, AlbedoModel, FittedAlbedo, albedo_records, fit_albedo
from cpic_planner.validation.albedo_fit import albedo_model
from simulator import load_instrument
from simulator.passbands import Passbands
from simulator.target import stellar_spectrum

BANDS = ("F520", "F662", "F720", "F850")
TOP = math.log10(6.0)


@pytest.fixture(scope="module")
def model() -> AlbedoModel:
    passbands = Passbands.from_instrument(load_instrument())
    bands = [passbands.bands[passbands.index(name)] for name in BANDS]
    return albedo_model(
        bands, stellar_spectrum(1.35, "K1V"), radius_rjup=1.0, distance_au=0.8775, phase_deg=90.0, insolation_au=2.0
    )


def contrasts(values: np.ndarray, errors: np.ndarray) -> dict[str, tuple[float, float]]:
    return {name: (float(value), float(error)) for name, value, error in zip(BANDS, values, errors, strict=True)}


def held(fit: AlbedoFit, log10_mh: float, log10_fsed: float, probability: float = 0.68) -> bool:
    """Return whether a planet lies in the smallest region of this probability."""
    along = [np.interp(log10_fsed, fit.log10_fsed_grid, row, 0, 0) for row in fit.posterior]
    return np.interp(log10_mh, fit.log10_mh_grid, along, 0, 0) >= fit.level(probability)


@pytest.mark.parametrize("truth", [(0.8, -0.3), (1.3, -1.1), (0.2, 0.4), (1.85, 0.1)])
@pytest.mark.parametrize("relative", [0.1, 1e-3])
def test_without_noise_the_truth_comes_back(model: AlbedoModel, truth: tuple[float, float], relative: float) -> None:
    values = model.contrast(*truth)
    fit = fit_albedo(contrasts(values, relative * values), model)
    assert (fit.log10_mh, fit.log10_fsed) == pytest.approx(truth, abs=2e-3)
    assert fit.chi2 == pytest.approx(0.0, abs=1e-3)
    assert fit.model_contrasts == pytest.approx(values, rel=1e-3)
    assert held(fit, *truth)
    assert (fit.degrees_of_freedom, fit.p_value) == (2, pytest.approx(1.0, abs=1e-3))


@pytest.mark.long
@pytest.mark.parametrize("relative", [0.03, 0.1])
def test_regions_hold_the_truth_as_often_as_they_say(
    model: AlbedoModel, relative: float, record_property: Callable[[str, object], None]
) -> None:
    rng = np.random.default_rng(5)
    inside, chances, n_draws = [], [], 300
    for _ in range(n_draws):
        truth = rng.uniform(0, 2), rng.uniform(-2, TOP)
        expected = model.contrast(*truth)
        errors = np.full(4, relative * expected.mean())
        values = expected + errors * rng.normal(size=4)
        fit = fit_albedo(contrasts(values, errors), model)
        inside.append([held(fit, *truth), held(fit, *truth, 0.95)])
        chances.append(fit.p_value)
    for share, nominal in zip(np.mean(inside, axis=0), (0.68, 0.95), strict=True):
        record_property(f"of {n_draws} truths in {100 * nominal:.0f} % regions", f"{100 * share:.1f} %")
        assert abs(share - nominal) < 3 * math.sqrt(nominal * (1 - nominal) / n_draws)
    assert np.mean(np.array(chances) < 0.01) < 0.05


def brute(model: AlbedoModel, values: np.ndarray, errors: np.ndarray) -> tuple[np.ndarray, ...]:
    """The posterior on a grid of its own."""
    mh, fsed = np.linspace(0, 2, 401), np.linspace(-2, TOP, 401)
    posterior = np.exp(-0.5 * np.sum(((values - model.contrast(mh[:, None], fsed)) / errors) ** 2, axis=-1))
    return mh, fsed, posterior / posterior.sum()


def test_posterior_against_brute_force(model: AlbedoModel) -> None:
    values = model.contrast(1.1, -0.5) * np.array([1.1, 0.95, 1.0, 0.9])
    errors = 0.08 * values
    mh, fsed, posterior = brute(model, values, errors)
    fit = fit_albedo(contrasts(values, errors), model)
    mean = np.array([(posterior.sum(axis=1) * mh).sum(), (posterior.sum(axis=0) * fsed).sum()])
    spread = [math.sqrt((posterior.sum(axis=1 - i) * (axis - mean[i]) ** 2).sum()) for i, axis in enumerate((mh, fsed))]
    cross = float(np.einsum("mf,m,f->", posterior, mh - mean[0], fsed - mean[1]))
    assert fit.mean == pytest.approx(mean, abs=0.02)
    assert np.sqrt(np.diag(fit.covariance)) == pytest.approx(spread, rel=0.02)
    assert fit.correlation == pytest.approx(cross / (spread[0] * spread[1]), abs=0.02)
    cumulated = np.cumsum(posterior.sum(axis=1))
    assert fit.interval("log10_mh") == pytest.approx(np.interp([0.16, 0.84], cumulated, mh), abs=0.03)


def test_posterior_is_a_density(model: AlbedoModel) -> None:
    values = model.contrast(0.8, -0.3)
    for relative in (0.2, 0.01):
        fit = fit_albedo(contrasts(values, relative * values), model)
        total = np.trapezoid(np.trapezoid(fit.posterior, fit.log10_fsed_grid, axis=1), fit.log10_mh_grid)
        assert total == pytest.approx(1.0, rel=1e-9)
        assert fit.level(0.95) < fit.level(0.68) < fit.posterior.max()
    assert np.ptp(fit.log10_fsed_grid) < TOP + 2  # the grid closes in on a narrow posterior


def test_one_band_is_degenerate(model: AlbedoModel) -> None:
    value = float(model.contrast(0.8, -0.3)[0])
    fit = fit_albedo({"F520": (value, 0.05 * value)}, model)
    assert fit.status == "degenerate"
    assert fit.p_value is None
    assert fit.degrees_of_freedom == 0
    assert fit.open_edges
    assert held(fit, 0.8, -0.3)


def test_two_bands_leave_no_degree_of_freedom(model: AlbedoModel) -> None:
    values = model.contrast(0.8, -0.3)
    fit = fit_albedo({"F520": (values[0], 0.1 * values[0]), "F850": (values[3], 0.1 * values[3])}, model)
    assert fit.status != "degenerate"
    assert fit.p_value is None


def test_open_edges_and_constraint(model: AlbedoModel) -> None:
    values = model.contrast(1.3, -1.1)
    loose, tight = (fit_albedo(contrasts(values, relative * values), model) for relative in (0.5, 0.003))
    assert loose.status == "not_constrained"
    assert {"log10_mh_low", "log10_mh_high", "log10_fsed_low"} <= set(loose.open_edges)
    assert (tight.status, tight.open_edges) == ("constrained", ())
    top = model.contrast(1.0, TOP)
    assert "log10_fsed_high" in fit_albedo(contrasts(top, 0.02 * top), model).open_edges


def test_metallicity_and_clouds_are_confused(model: AlbedoModel) -> None:
    values = model.contrast(0.8, -0.3)
    fit = fit_albedo(contrasts(values, 0.02 * values), model)
    assert fit.correlation < -0.8


def test_what_the_model_cannot_do_has_a_small_p_value(model: AlbedoModel) -> None:
    grey = np.full(4, 0.5 * model.full_contrast / math.pi)
    fit = fit_albedo(contrasts(grey, 0.02 * grey), model)
    assert fit.p_value is not None
    assert fit.p_value < 1e-3
    # A flat spectrum with large errors is nothing out of the ordinary.
    assert (fit_albedo(contrasts(grey, 0.3 * grey), model).p_value or 0) > 0.2


def test_negative_contrasts_are_measurements(model: AlbedoModel) -> None:
    values = model.contrast(1.8, -0.3)
    errors = np.full(4, 1.2 * values.mean())
    fit = fit_albedo(contrasts(values - errors, errors), model)
    assert (values - errors).min() < 0
    assert np.isfinite([fit.chi2, fit.correlation, *fit.mean]).all()


@pytest.mark.parametrize(
    ("measured", "key"),
    [
        ({}, "measured"),
        ({"F999": (1e-8, 1e-9)}, "measured"),
        ({"F520": (math.nan, 1e-9)}, "measured.F520"),
        ({"F520": (1e-8, 0.0)}, "measured.F520.error"),
    ],
)
def test_refusals(refused, model: AlbedoModel, measured: dict[str, tuple[float, float]], key: str) -> None:
    refused(key, fit_albedo, measured, model)


@pytest.mark.parametrize("relative", [0.02, 0.2, 1.0])
@pytest.mark.parametrize(
    "truth",
    [(0.0, -2.0), (1.0, 0.0), *(pytest.param(truth, marks=pytest.mark.long) for truth in ((2.0, TOP), (2.0, -1.0)))],
)
def test_what_is_stated_beside_an_interval_lies_in_it(
    model: AlbedoModel, truth: tuple[float, float], relative: float
) -> None:
    """The record has medians beside intervals; the best fit of both parameters together can lie outside of one."""
    rng = np.random.default_rng(round(10 * relative))
    outside = 0
    for _ in range(4):
        expected = model.contrast(*truth)
        errors = np.full(4, relative * expected.mean())
        fit = fit_albedo(contrasts(expected + errors * rng.normal(size=4), errors), model)
        light = SimpleNamespace(name="b")
        (record,) = albedo_records([FittedAlbedo(light, model, fit)])
        for name, best in zip(("log10_mh", "log10_fsed"), record.best_fit, strict=True):
            value, interval = getattr(record, name), getattr(record, f"{name}_interval")
            assert interval[0] < value < interval[1]
            assert best == getattr(fit, name)
            outside += not interval[0] <= best <= interval[1]
    if relative == 1.0:
        assert outside > 0  # the case that was told wrongly
