"""The public functions: by names, all stars at once, with the defaults of the ranking."""

import numpy as np
import pytest

import cpic_planner as cp

FEW = {"bands": ["F520"], "v_mag_max": 3.0, "n_planets": 300, "time_s": 7200.0}


def test_named_stars_are_answered_as_alone():
    stars, places = ["tau Cet", "eps Eri"], [0.5, 0.6]
    together = cp.signal_to_noise(stars, time_s=3600, separation_arcsec=places, bands=["F662", "F520"])
    assert [(one.target, one.band, one.separation_arcsec) for one in together] == [
        (star, band, place) for star in ("tau Cet", "eps Eri") for band in ("F662", "F520") for place in places
    ]
    for one in together:
        alone = cp.signal_to_noise(one.target, time_s=3600, separation_arcsec=one.separation_arcsec, bands=[one.band])
        assert one.value == pytest.approx(alone[0].value, rel=1e-12)
    assert cp.signal_to_noise([], time_s=3600, separation_arcsec=0.5) == []


def test_an_observation_is_planned_as_the_strategy_says():
    ask = {"time_s": 3600.0, "separation_arcsec": 0.5, "bands": ["F520"]}
    plain, more = (cp.signal_to_noise("tau Cet", strategy=way, **ask)[0] for way in (None, {"reference_ratio": 2.0}))
    pace = {1.0: plain, 2.0: more}
    for ratio, one in pace.items():
        frames_s = (1 + ratio) * one.n_frames * (one.exposure_s + 1.1)
        assert one.time_s == pytest.approx(600.0 * one.visits + frames_s, rel=1e-12)
    with pytest.raises(cp.InputError, match="reference_star"):
        cp.signal_to_noise("tau Cet", strategy={"library": "reference_star"}, **ask)


def test_planets_may_be_mappings():
    small, large = cp.signal_to_noise(
        "tau Cet", time_s=3600, separation_arcsec=0.5, bands=["F520"], planet=[{"radius_rjup": 1}, {"radius_rjup": 2}]
    )
    assert large.contrast == pytest.approx(4 * small.contrast, rel=1e-12)
    assert small == cp.signal_to_noise("tau Cet", time_s=3600, separation_arcsec=0.5, bands=["F520"])[0]
    for wrong in ("big", 3, [{"radius": 1}]):
        with pytest.raises(cp.InputError, match="planet"):
            cp.signal_to_noise("tau Cet", time_s=3600, separation_arcsec=0.5, planet=wrong)


def test_optimise_gives_a_row_a_star():
    table = cp.optimise(["tau Cet", "eps Eri"], snr=5.0)
    assert list(table["name"]) == ["tau Cet", "eps Eri"]
    for row in table.itertuples():
        least = cp.exposure_time(row.name, snr=5.0, separation_arcsec=row.separation_arcsec, bands=[row.band])[0]
        assert row.time_s == pytest.approx(least.value, rel=1e-9)


def test_sensitivity_and_explanation_are_of_the_same_ranking():
    ranking = cp.rank_targets(**FEW)
    firm = cp.rank_sensitivity(**FEW)
    assert firm.top == min(50, len(ranking.targets))
    assert firm.n_ok == sum(row.status == "ok" for row in ranking.targets)
    told = cp.explain_rank("alpha Cen B", other_assumptions=True, **FEW)
    row = next(row for row in ranking.targets if row.name == "alf Cen B")
    assert told.star == row
    assert told.n_ranked == len(ranking.targets)
    assert set(told.ranks) == {row.assumption for row in firm.rows}


def test_more_planets_and_another_population_are_asked_for_by_name():
    few, seed = (cp.rank_targets(**FEW, seed=seed).targets[0].completeness for seed in (1, 2))
    assert few == pytest.approx(seed, abs=5 * np.sqrt(2 * 0.25 / 300))
    other = cp.rank_targets(**FEW, population="jupiters", score="detection_margin")
    assert other.population.name == "jupiters"
    margins = [row.detection_margin for row in other.targets]
    assert margins == sorted(margins, reverse=True)
    with pytest.raises(cp.InputError, match="eps Ind"):
        cp.explain_rank("eps Ind", **FEW)
    with pytest.raises(TypeError, match="colour"):
        cp.rank_sensitivity(colour="red")


def test_answers_say_how_firm_they_are_where_that_is_asked():
    stars, places = ["tau Cet", "eps Eri"], [0.5, 0.7]
    ask = {"time_s": 3600.0, "separation_arcsec": places, "bands": ["F662", "F520"]}
    plain = cp.signal_to_noise(stars, **ask)
    assert {one.fidelity for one in plain} == {None}
    quick = cp.signal_to_noise(stars, **ask, fidelity="quick")
    assert [one.value for one in quick] == [one.value for one in plain]
    assert [one.fidelity.answer for one in quick] == list(range(8))
    assert all(one.fidelity.images is None for one in quick)
    loose = cp.signal_to_noise(stars, **ask, tolerance=0.3)
    assert [one.fidelity for one in loose] == [one.fidelity for one in quick]


def test_a_roll_turns_the_companion_and_the_quadrant():
    """36 Ophiuchi at 40 deg has an arm of its companion's light in the hole; every answer says where the planet is."""
    ask = {"time_s": 7200.0, "separation_arcsec": 0.6, "bands": ["F520"], "contrast": 1e-7}
    (still,), (turned,), (over,), (single,) = (
        cp.signal_to_noise(name, **ask, observation_roll_deg=roll)
        for name, roll in (("36 Oph A", 0.0), ("36 Oph A", 40.0), ("36 Oph A", 180.0), ("tau Cet", 40.0))
    )
    assert (still.roll_deg, turned.roll_deg) == (0.0, 40.0)
    assert over.quadrant != still.quadrant
    assert turned.value < 0.5 * still.value
    assert single.value == cp.signal_to_noise("tau Cet", **ask)[0].value
    assert single.quadrant == "upper right"
    with pytest.raises(cp.InputError, match="observation_roll_deg"):
        cp.signal_to_noise("tau Cet", **ask, observation_roll_deg=361.0)


@pytest.mark.long
def test_answers_are_checked_in_images_with_their_own_planets():
    planets = [{"radius_rjup": 1.0}, {"radius_rjup": 2.0}]
    found = cp.signal_to_noise(
        ["tau Cet", "eps Eri"],
        time_s=1800.0,
        separation_arcsec=0.6,
        bands=["F520"],
        planet=planets,
        fidelity="standard",
        realisations=1,
        seed=3,
    )
    for one in found:
        assert one.fidelity.status == "ok"
        assert one.fidelity.images.light_ratio == pytest.approx(1.0, abs=0.005)
        assert one.fidelity.images.realisations == 1
        assert one.to_dict()["fidelity"]["images"]["draw"] == "sums"
    (given,) = cp.exposure_time(
        "tau Cet", snr=5, separation_arcsec=0.6, bands=["F520"], contrast=3e-8, fidelity="standard", realisations=1
    )
    (limit,) = cp.contrast_limit(
        "tau Cet", time_s=1800, separation_arcsec=0.6, bands=["F520"], fidelity="standard", realisations=1
    )
    for one in (given, limit):
        assert one.fidelity.images.light_ratio == pytest.approx(1.0, abs=0.005)


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"fidelity": "best"}, "fidelity"),
        ({"tolerance": 0.7}, "tolerance"),
        ({"seed": 3}, "seed"),
        ({"realisations": 3}, "realisations"),
        ({"fidelity": "quick", "tolerance": 0.1}, "tolerance"),
        ({"fidelity": "quick", "realisations": 3}, "realisations"),
    ],
)
def test_the_dial_refuses_what_it_cannot_use(options, word):
    with pytest.raises(cp.InputError, match=word):
        cp.signal_to_noise("tau Cet", time_s=3600, separation_arcsec=0.5, **options)
