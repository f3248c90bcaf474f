"""The best band, separation and frames against asking for each of them."""

from dataclasses import replace

import numpy as np
import pytest

from cpic_planner.etc import build_model, place_status, usable_range_arcsec
from cpic_planner.etc.questions import exposure_time, signal_to_noise
from cpic_planner.queries import Strategy
from cpic_planner.ranking import optimise, separation_grid
from cpic_planner.ranking.optimiser import best_of
from cpic_planner.targets import rank_sample
from simulator.config import load_instrument

MODEL = build_model(load_instrument())
_BRIGHT = rank_sample(v_mag_max=4.0)
# Arcturus has a companion 0.3 arcsec away: what it leaves to be seen lies between the places that the search looks at.
STARS = _BRIGHT.select(
    [
        i
        for i, name in enumerate(_BRIGHT.name)
        if (i % 13 == 0 or name in ("tau Cet", "alf CMi", "bet Hyi")) and name != "alf Boo"
    ]
)
BANDS = MODEL.bands


def each(question, **asked):
    """Answers by star, over all bands and separations of the grids."""
    found = {str(name): [] for name in STARS.name}
    for band in BANDS:
        for answer in question(
            MODEL, STARS, bands=[band], separation_arcsec=list(separation_grid(MODEL, band)), **asked
        ):
            if answer.value is not None:
                found[answer.target].append(answer)
    return found


def test_no_band_and_place_is_clearer():
    """Margins over the whole grid; the search looks at every fifth place first, and refines."""
    best = optimise(MODEL, STARS, time_s=7200.0)
    for i, answers in enumerate(each(signal_to_noise, time_s=7200.0).values()):
        margins = {(a.band, round(a.separation_arcsec, 9)): a.significance / a.threshold for a in answers}
        assert best.margin[i] >= max(margins.values()) * (1 - 1e-3)
        own = margins[best.band[i], round(best.separation_arcsec[i], 9)]
        # The question maximises the SNR, the optimiser the significance: nearly the same frames.
        assert own * (1 - 1e-4) <= best.margin[i] <= own * 1.03
        assert best.margin[i] == pytest.approx(best.significance[i] / best.threshold[i], rel=1e-12)
        assert best.time_s[i] <= 7200.0 * (1 + 1e-12)


@pytest.mark.parametrize("goal", [{"snr": 0.5}, {"detect": True}], ids=str)
def test_no_band_and_place_is_quicker(goal):
    best = optimise(MODEL, STARS, **goal)
    answered = 0
    for i, answers in enumerate(each(exposure_time, **goal).values()):
        assert (best.n_frames[i] > 0) == bool(answers)
        if answers:
            assert best.time_s[i] <= min(a.value for a in answers) * (1 + 1e-3)
            answered += 1
    assert answered >= (2 if "detect" in goal else 5)


def test_a_given_separation_is_the_one_of_the_etc():
    best = optimise(MODEL, STARS, time_s=7200.0, separation_arcsec=0.6, bands=["F520"])
    answers = signal_to_noise(MODEL, STARS, time_s=7200.0, separation_arcsec=0.6, bands=["F520"])
    np.testing.assert_allclose(best.separation_arcsec, 0.6)
    # The question maximises the SNR, the optimiser the significance: nearly the same frames.
    np.testing.assert_allclose(best.significance, [answer.significance for answer in answers], rtol=0.02)
    assert np.all(best.significance >= np.array([answer.significance for answer in answers]) * (1 - 1e-4))
    outside = optimise(MODEL, STARS, time_s=7200.0, separation_arcsec=0.1, bands=["F520"])
    assert set(outside.outside) == {"inside_inner_edge"}


def test_more_time_never_loses_a_detection():
    """For one band and place strictly; over places to the spacing of the grid."""
    few, many = (optimise(MODEL, STARS, time_s=t, separation_arcsec=0.5).margin for t in (3000.0, 48000.0))
    assert np.all(many >= few * (1 - 1e-12))
    few, many = (optimise(MODEL, STARS, time_s=t).margin for t in (3000.0, 48000.0))
    assert np.all(many >= few * (1 - 1e-3))


@pytest.mark.parametrize("band", BANDS)
def test_places_hold_an_aperture_and_a_background(band):
    grid, metrics = separation_grid(MODEL, band), MODEL.metrics[band]
    low, high = usable_range_arcsec(MODEL.instrument, band)
    assert low * (1 - 1e-9) <= grid[0] < grid[-1] <= high * (1 + 1e-9)
    assert np.all(np.diff(grid) > 0)
    assert np.all(metrics.resolution_elements(grid) >= 3)


def test_what_no_visit_can_pass():
    """The bound holds for every length of visit, and where it decides it is reached by one."""
    best = optimise(MODEL, STARS, time_s=3000.0)
    margins = np.array([optimise(MODEL, STARS, time_s=t).margin for t in (1e4, 4e4, 1e6)])
    below = best.margin < 1.0
    assert np.all(margins[:, below] <= np.maximum(best.floor_margin, best.margin)[below] * (1 + 1e-3))
    still = build_model(load_instrument({"drift": {"visit_nm": 0, "walk_nm_per_sqrt_hour": 0}}))
    assert np.all(optimise(still, STARS, time_s=3000.0).floor_margin > 1.0)


def test_extrapolated_bands_win_only_alone():
    one = optimise(MODEL, STARS, time_s=3000.0, bands=["F520"])
    other = replace(
        one, band=np.full(len(STARS), "other"), margin=one.margin * 2, extrapolated=np.ones(len(STARS), bool)
    )
    assert set(best_of([other, one]).band) == {"F520"}
    assert set(best_of([other, replace(one, n_frames=0.0 * one.n_frames)]).band) == {"other"}
    assert set(best_of([replace(one, band=np.full(len(STARS), "first")), one]).band) == {"first"}


@pytest.mark.parametrize(
    "strategy", [{"mode": "photon_counting"}, {"library": "roll"}, {"library": "idealised"}], ids=str
)
def test_other_strategies_have_answers(strategy):
    best = optimise(build_model(load_instrument(), None, Strategy(**strategy)), STARS, time_s=7200.0)
    assert np.all(best.n_frames >= 1)
    assert np.all(np.isfinite(best.margin))
    assert np.all(best.margin > 0)


def test_goals_are_one_and_in_range(refused):
    for goal in ({}, {"time_s": 1.0, "snr": 5.0}, {"snr": 5.0, "detect": True}):
        refused("one of time_s, snr, detect", optimise, MODEL, STARS, **goal)
    for goal in (
        {"time_s": 0.0},
        {"time_s": np.nan},
        {"snr": -1.0},
        {"snr": np.inf},
        {"snr": 5.0, "bands": ["F999"]},
        {"snr": 5.0, "separation_arcsec": np.nan},
    ):
        refused("", optimise, MODEL, STARS, **goal)


def test_rolled_planets_stay_in_the_zone_and_no_place_is_refused(refused):
    roll = build_model(load_instrument(), ["F520"], Strategy(library="roll"))
    assert all(place_status(roll, "F520", float(place))[0] == "ok" for place in separation_grid(roll, "F520"))
    assert len(separation_grid(roll, "F520")) < len(separation_grid(MODEL, "F520"))
    for strategy in (Strategy(library="roll", roll_deg=2.0), Strategy(annulus_lambda_d=0.01)):
        refused("band = F520", optimise, build_model(load_instrument(), ["F520"], strategy), STARS, time_s=3600.0)
