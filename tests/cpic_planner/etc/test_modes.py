"""Predictions with modes: what decides them, what they are for, and questions that are inverses of each other."""

from dataclasses import replace

import numpy as np
import pytest

from cpic_planner.api.functions import model_of
from cpic_planner.api.one_star import best_places, closed_forms
from cpic_planner.etc import Programme, aperture_rates, build_model, contrast_limit, with_modes
from cpic_planner.etc.noise import balance_of, stack_noise
from cpic_planner.etc.questions import exposure_time, signal_to_noise
from cpic_planner.queries import EtcQuestion, Strategy
from cpic_planner.targets import find_target
from simulator.config import load_instrument
from simulator.signal import BandModes, ModeFactors

INSTRUMENT = load_instrument()
TAU_CET = find_target("tau Cet")[0]
PLACE = {"separation_arcsec": 0.55, "bands": ["F520"]}


@pytest.fixture(autouse=True)
def field(monkeypatch):
    """Smooth factors instead of the optical model: modes take more speckles the more and the quieter references are."""
    asked = []

    def factors(self, separation, references, n_modes, noise, programme_noise=None):
        place, r, noise, whole = np.broadcast_arrays(
            separation, references, noise, 0.0 if programme_noise is None else programme_noise
        )
        asked.append((place, r, noise, n_modes))
        k = np.minimum(np.arange(n_modes + 1.0), r[..., None] - 1.0)
        seen = k / (k + 3.0) / (1.0 + noise[..., None]) * (1.0 - 1.0 / r[..., None])
        every = ModeFactors(k.astype(int), 1.0 - 0.8 * seen, 1.0 - 0.05 * seen, 1.0 - 0.1 * seen)
        return every.at(n_modes if programme_noise is None else np.argmin(every.limit(whole), axis=-1))

    monkeypatch.setattr(BandModes, "factors", factors)
    return asked


def model(instrument=INSTRUMENT, bands=None, **strategy):
    return build_model(instrument, bands, Strategy(**strategy))


@pytest.mark.parametrize(
    "strategy",
    [
        pytest.param({"visits": 20, "n_modes": 4, "mode": "photon_counting"}, marks=pytest.mark.long),
        {"visits": 20, "n_modes": 4, "library": "roll"},
        {"visits": 6, "n_modes": 3, "library": "brighter_twin", "reference_visits": 9, "search": "known_place"},
    ],
    ids=lambda one: " ".join(str(value) for value in one.values()),
)
def test_round_trips(strategy):
    """For a fixed number of modes answers for a level are inverses of each other as exactly as without."""
    one, done = model(**strategy), 0
    for time_s in (3e4, 1e5):
        for given, inverse in (({"sigma": 5.0}, {"sigma": 5.0}), ({"snr": 7.0}, {"snr": 7.0}), ({}, {"detect": True})):
            limit = contrast_limit(one, TAU_CET, time_s=time_s, **PLACE, **given)[0]
            if limit.value is not None:
                again = exposure_time(one, TAU_CET, contrast=limit.value, **PLACE, **inverse)[0]
                assert again.value == pytest.approx(limit.time_s, rel=1e-9)
                done += 1
        found = signal_to_noise(one, TAU_CET, time_s=time_s, contrast=2e-9, **PLACE)[0]
        again = exposure_time(one, TAU_CET, snr=found.value, contrast=2e-9, **PLACE)[0]
        assert again.value == pytest.approx(found.time_s, rel=1e-9)
        assert again.n_modes == found.n_modes > 0
        done += 1
    assert done >= 3


@pytest.mark.parametrize("given", [{"sigma": 5.0}, {"snr": 7.0}, {}], ids=str)
def test_the_limit_of_a_narrow_range_of_lengths_is_found_again(monkeypatch, given):
    """Modes of the optical model: neither endless visits nor visits without modes reach it, those between do."""
    monkeypatch.undo()
    one = model(visits=6, n_modes=3, library="brighter_twin", reference_visits=9, search="known_place")
    limit = contrast_limit(one, TAU_CET, time_s=1e5, **PLACE, **given)[0]
    assert limit.value is not None
    again = exposure_time(one, TAU_CET, contrast=limit.value, **PLACE, **(given or {"detect": True}))[0]
    assert again.value == pytest.approx(limit.time_s, rel=1e-9)


def test_visits_that_remember_each_other_keep_the_inverse():
    slow = load_instrument({"drift": {"correlation_time_h": 3.0}})
    one = model(slow, visits=12, n_modes=4)
    found = signal_to_noise(one, TAU_CET, time_s=1e5, contrast=2e-9, **PLACE)[0]
    again = exposure_time(one, TAU_CET, snr=found.value, contrast=2e-9, **PLACE)[0]
    assert again.value == pytest.approx(found.time_s, rel=1e-9)


def test_modes_are_those_of_the_frames_that_are_answered():
    """Factors and frames stand still together: one follows from the other."""
    one = model(visits=20, n_modes=4)
    answer = signal_to_noise(one, TAU_CET, time_s=1e5, contrast=2e-9, **PLACE)[0]
    place = np.array([[0.55]]) / np.sqrt(2.0)
    rates = aperture_rates(one, TAU_CET, "F520", place, place, np.array([[2e-9]]))
    frames = answer.exposure_s, answer.frames_per_visit, answer.em_gain
    programme = Programme.of(one.strategy, 20)
    programme = with_modes(one, "F520", np.array([[0.55]]), rates, programme, *frames)
    noise = stack_noise(rates, *frames, one.camera("F520"), one.strategy, programme)
    assert answer.snr == pytest.approx(float(noise.snr[0, 0]), rel=1e-9)
    assert answer.budget["speckle_e2"] == pytest.approx(float(noise.terms["speckle"][0, 0]), rel=1e-9)


def test_the_noise_of_a_reference_is_its_own_over_its_speckles():
    """Written out for one reference visit of a programme; that of a twin counts less by its light."""
    one = model(visits=5, reference_visits=8, n_modes=4)
    place = np.array([[0.55]]) / np.sqrt(2.0)
    rates = aperture_rates(one, TAU_CET, "F520", place, place, np.array([[2e-9]]))
    camera, (t, n, gain) = one.camera("F520"), (10.0, 120.0, 200.0)
    programme = Programme.of(one.strategy)
    found = balance_of(rates, t, n, gain, camera, one.strategy, programme)
    noise = stack_noise(rates, t, n, gain, camera, one.strategy, programme)
    all_references = noise.terms["reference"] / (n * 5 * t) ** 2
    visit = n * (t + camera.readout_s)
    speckle = rates.speckle.reference.variance(visit * 5 / 8)
    assert found.reference == pytest.approx(np.sqrt(8 * all_references / speckle), rel=1e-9)
    white = noise.white / (noise.terms["speckle"] + noise.terms["common_speckle"])
    assert found.programme == pytest.approx(np.sqrt(white), rel=1e-9)
    # Two rolls halve the variance of both.
    rolled = balance_of(replace(rates, variance_factor=0.5), t, n, gain, camera, one.strategy, programme)
    np.testing.assert_allclose(np.array(rolled), np.array(found), rtol=1e-12)


def test_what_cannot_be_projected_out_is_said(field):
    def asked(**strategy):
        return signal_to_noise(model(**strategy), TAU_CET, time_s=1e5, contrast=2e-9, **PLACE)[0]

    mean = asked(visits=4)
    assert (mean.n_modes, asked(visits=4, n_modes=3).n_modes) == (0, 3)
    more = asked(visits=4, n_modes=9)
    assert more.n_modes == 3
    assert "modes_limited" in more.flags
    assert more.snr == asked(visits=4, n_modes=3).snr
    alone = asked(visits=1, n_modes=4)
    assert (alone.n_modes, alone.snr) == (0, asked(visits=1).snr)
    assert "modes_limited" in alone.flags
    # A library without noise or drift has nothing but its mean.
    idealised = asked(visits=4, n_modes=3, library="idealised")
    assert idealised.n_modes == 0
    assert idealised.snr == asked(visits=4, library="idealised").snr
    assert "modes_limited" in idealised.flags


def test_without_drift_modes_take_nothing(monkeypatch):
    monkeypatch.undo()
    still = load_instrument({"drift": {"visit_nm": 0, "walk_nm_per_sqrt_hour": 0}})
    mean, modes = (
        signal_to_noise(model(still, visits=8, n_modes=k), TAU_CET, time_s=1e5, contrast=2e-9, **PLACE)[0]
        for k in (0, 4)
    )
    assert modes.snr == mean.snr


def test_the_number_of_modes_is_chosen_where_it_is_left_open():
    """Never worse than the mean or the most, and 0 where the mean is best."""
    settings = {"time_s": 1e5, "contrast": 2e-9, **PLACE}
    for visits in (2, 40):
        mean, most, best = (
            signal_to_noise(model(visits=visits, **strategy), TAU_CET, **settings)[0].significance
            for strategy in ({}, {"n_modes": 12}, {"n_modes": 12, "choose_modes": True})
        )
        assert best >= max(mean, most) * (1.0 - 1e-9)


def test_the_best_number_of_visits_counts_the_modes_that_it_brings():
    """Against other numbers of visits, one by one."""
    time_s = 4e4
    free = signal_to_noise(model(n_modes=6), TAU_CET, time_s=time_s, contrast=2e-9, **PLACE)[0]
    every = [
        signal_to_noise(model(n_modes=6, visits=v), TAU_CET, time_s=time_s, contrast=2e-9, **PLACE)[0].value or 0.0
        for v in {2, 4, 8, 16, 25} | {free.visits - 1, free.visits + 1}
    ]
    assert free.value >= max(every) * (1.0 - 1e-4)
    plain = signal_to_noise(model(), TAU_CET, time_s=time_s, contrast=2e-9, **PLACE)[0]
    assert free.value > plain.value
    quickest = exposure_time(model(n_modes=6), TAU_CET, detect=True, contrast=2e-9, **PLACE)[0]
    near = (quickest.visits - 1, quickest.visits, quickest.visits + 1)
    times = [
        exposure_time(model(n_modes=6, visits=v), TAU_CET, detect=True, contrast=2e-9, **PLACE)[0].value for v in near
    ]
    assert quickest.value == pytest.approx(min(times), rel=1e-4)


def test_bands_stars_and_planets_are_answered_as_one_by_one(field):
    stars = replace(TAU_CET.select([0, 0]), v_mag=np.array([3.5, 5.0]))
    one, given = model(visits=10, n_modes=4), {"time_s": 1e5, "contrast": [1e-8, 2e-8]}
    every = signal_to_noise(one, stars, separation_arcsec=[0.5, 0.7], bands=["F520", "F720"], **given)
    assert len(every) == 8
    for i, answer in enumerate(every):
        alone = signal_to_noise(
            one,
            stars.select([i // 4]),
            time_s=1e5,
            separation_arcsec=answer.separation_arcsec,
            contrast=answer.contrast,
            bands=[answer.band],
        )[0]
        assert answer.snr == pytest.approx(alone.snr, rel=1e-9)


def test_modes_of_near_infrared_references_are_followed():
    """Images of four such programmes have 0.994 +- 0.023 of the SNR that is predicted with modes."""
    given = {"time_s": 1e5, "contrast": 1e-8, "separation_arcsec": 1.0, "bands": ["F1265"]}
    mean, modes = (signal_to_noise(model(bands=["F1265"], visits=8, n_modes=k), TAU_CET, **given)[0] for k in (0, 4))
    assert (mean.n_modes, modes.n_modes) == (0, 4)
    assert modes.snr < mean.snr  # reading makes the noise: modes add theirs
    assert "modes_not_modelled" not in modes.flags


@pytest.mark.parametrize("level", [{"snr": 10.0}, {"detect": True}])
def test_the_best_place_for_a_level_takes_few_looks_at_modes(field, level):
    """Every look may have to measure what modes change: places are compared without the nested search for a length."""
    question = EtcQuestion.of({"target": "tau Cet", "bands": ["F520"], "strategy": {"n_modes": 3, "visits": 6}} | level)
    found = best_places(question, model_of(question), TAU_CET, ["F520"])["F520"]
    assert len(found) == 1
    assert len(field) < 20
    (answer,) = closed_forms(question, model_of(question), TAU_CET)
    assert answer.separation_arcsec == found[0]
    assert answer.n_modes == 3
