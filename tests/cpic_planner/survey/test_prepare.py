"""Surveys made of strategies, and what these assume of the instrument."""

from dataclasses import replace

import numpy as np
import pytest

from cpic_planner.etc import aperture_rates, build_model, stack_noise
from cpic_planner.survey.prepare import (
    assumed_model,
    imaged_model,
    known_table,
    mirror_noise_nm,
    prepare,
    with_contrast,
)
from cpic_planner.survey.strategy import SurveyStrategy, UniverseConfig
from cpic_planner.targets import find_target
from cpic_planner.validation import Frames, confirm_task, expected_of, star_scene, task_of
from simulator import load_instrument
from simulator.config import ConstantAlbedo, Planet
from simulator.imaging import single_band_psf
from simulator.signal import programme_law
from simulator.target import contrast_at, sky_to_detector


def test_surveys_share_their_calendar_and_stars(small):
    told = []
    prepared = prepare(
        small({"name": "all"}, {"name": "two", "targets": {"names": ["tau Cet", "eps Eri"]}}),
        advance=lambda text, steps=1, /: told.append((text, steps)),
    )
    assert told == [("all: plan", 1), ("two: plan", 1)]
    every, two = (survey.calendar for survey in prepared.surveys)
    names = [list(survey.targets.name) for survey in prepared.surveys]
    assert sorted(names[0]) == ["alf Cen A", "eps Eri", "tau Cet"]
    for field in ("fraction", "window_s", "day", "sun_pa_deg"):
        own = getattr(every, field)[[names[0].index(name) for name in names[1]]]
        np.testing.assert_array_equal(own, getattr(two, field))
    for survey in prepared.surveys:
        assert len(survey.options) == len(survey.targets) == len(survey.known_rows) == len(survey.noise_alarms)
    assert [len(survey.targets) for survey in prepared.surveys] == [3, 2]


def test_schedules_stay_within_their_strategy(plain):
    survey = plain.surveys[0]
    planned = [visit for visit in survey.schedule.visits if not visit.reserve]
    assert sum(visit.cost_h for visit in planned) <= survey.strategy.time_budget_h
    for slot in range(survey.calendar.n_slots):
        used = sum(visit.cost_h for visit in survey.schedule.visits if visit.slot == slot)
        assert used <= survey.strategy.slot_share * survey.calendar.slot_h[slot] + 1e-6
    for star in range(len(survey.targets)):
        own = [visit for visit in survey.schedule.visits if visit.star == star]
        assert len(own) <= survey.strategy.revisits.max_visits
        assert [visit.ordinal for visit in own] == list(range(len(own)))
        days = [survey.calendar.day[star, visit.slot] for visit in own]
        assert np.all(np.diff(days) >= survey.strategy.revisits.min_gap_days)
        for visit in own:
            setting = survey.options[star][visit.option]
            cost = survey.calendar.cost_h(survey.model, star, setting, survey.strategy.visit.settlings)
            assert visit.cost_h == cost[visit.slot]


def test_the_gap_is_kept_in_days(small):
    prepared = prepare(small({"revisits": {"min_gap_days": 60}}))
    survey = prepared.surveys[0]
    for star in range(len(survey.targets)):
        days = [survey.calendar.day[star, visit.slot] for visit in survey.schedule.visits if visit.star == star]
        assert np.all(np.diff(days) >= 60.0)


@pytest.mark.parametrize("slot_days", [45.7, 33.3333, 61.0])
def test_slots_that_are_no_whole_number_of_days(small, slot_days):
    prepared = prepare(small(universe={"slot_days": slot_days, "duration_days": 200}))
    assert prepared.surveys[0].calendar.n_slots == int(np.ceil(200 / slot_days))
    assert prepared.surveys[0].schedule.visits


def test_refuted_planets_make_no_host_and_are_in_no_schedule(refused, small):
    """tau Cet e and the one planet of omi2 Eri, which the archive of 2019 has."""

    def planets(source):
        names = ["tau Cet", "omi2 Eri"]
        surveys = prepare(
            small(
                {"targets": {"names": names}, "visit": {"time_s": 7200}, "time_budget_h": 20},
                {"name": "hosts", "targets": {"names": ["tau Cet"], "known_planets": "only"}},
                universe={"known_planets": source, "duration_days": 120},
            )
        ).surveys
        survey = surveys[0]
        listed = survey.known.text("planet")
        found = zip(survey.targets.name, survey.known_rows, strict=True)
        return {str(star): {listed[row] for row in rows} for star, rows in found}

    now, before = planets("snapshot"), planets("archive_2019")
    assert before["tau Cet"] == now["tau Cet"] | {"tau Cet e"}
    assert before.get("omi2 Eri", set()) >= now.get("omi2 Eri", set()) == set()
    refused("cuts that leave a star", prepare, small({"targets": {"names": ["omi2 Eri"], "known_planets": "only"}}))


def test_background_stars_and_follow_up_are_options(small):
    quiet = prepare(small()).surveys[0]
    assert not any(any(ways) for ways in quiet.background_alarms)
    assert quiet.follow == ((), (), ())
    loud = prepare(small({"follow_up": {"bands": ["F520"], "time_s": 3000}}, universe={"background": "on"})).surveys[0]
    assert all(min(ways) > 0.0 for ways in loud.background_alarms)
    assert loud.noise_alarms == quiet.noise_alarms
    assert all(way.band == "F520" and way.time_s <= 3000.0 * (1 + 1e-9) for (way,) in loud.follow)


def test_a_survey_that_nobody_can_make(small):
    for strategy in ({"time_budget_h": 0.01}, {"population": None, "targets": {"names": ["alf Cen A"]}}):
        survey = prepare(small(strategy)).surveys[0]
        assert survey.schedule.visits == ()
        assert survey.schedule.distance == 0.0


def test_what_is_refused(refused, small):
    faults = {
        "band = F999": {"visit": {"bands": ["F999"]}},
        "band = Q": {"follow_up": {"bands": ["Q"]}},
        "planets_per_star = missing": {"population": "jupiters"},
        "revisits.roll_dither_deg = 40": {"revisits": {"roll_dither_deg": 40}},
        "targets.names = Vulcan": {"targets": {"names": ["Vulcan"]}},
    }
    for text, strategy in faults.items():
        refused(text, prepare, small(strategy))


def test_candidates_are_known_planets_when_asked_for():
    """A survey reads the table as cpic known does."""
    counted = [known_table(UniverseConfig(candidates=asked)) for asked in (False, True)]
    assert [table.rows_of("alpha Cen A") for table in counted] == [(), (counted[1].row_of("alf Cen A S1"),)]
    assert known_table(UniverseConfig(known_planets="off", candidates=True)) is None


BRIGHT = 1e-8


@pytest.fixture(scope="module")
def instrument():
    return load_instrument()


@pytest.fixture(scope="module")
def metrics(instrument):
    return build_model(instrument, ("F520",)).metrics["F520"]


def assuming(instrument, **assumptions):
    return assumed_model(instrument, SurveyStrategy(name="x", assumptions=assumptions), ("F520",))


def rates(model, contrast=1e-8):
    star = find_target("tau Cet")[0]
    return aperture_rates(model, star, "F520", np.array([[0.42]]), np.array([[0.42]]), np.array([[contrast]]))


def test_nothing_assumed_is_the_instrument(instrument):
    assert assuming(instrument) is assuming(instrument)
    strategy = SurveyStrategy(name="x")
    assert assuming(instrument).strategy.sigma == strategy.detection.sigma


def test_the_nominal_contrast_changes_nothing(instrument, metrics):
    same = with_contrast(metrics, metrics.median_contrast)
    for name in ("halo_map", "raw_contrast", "floor_linear", "floor_square", "core_table", "column_light"):
        np.testing.assert_allclose(getattr(same, name), getattr(metrics, name), rtol=1e-12)
    assert same.peak_on_axis_hole == pytest.approx(metrics.peak_on_axis_hole, rel=1e-14)
    one, other = rates(assuming(instrument)), rates(assuming(instrument, contrast=metrics.median_contrast))
    assert float(other.halo_e_s.squeeze()) == pytest.approx(float(one.halo_e_s.squeeze()), rel=1e-12)


@pytest.mark.parametrize("contrast", [0.0, 1e-10, 1e-9, 1e-8, 1e-5])
def test_light_scales_inside_the_hole_and_nowhere_else(metrics, contrast):
    other = with_contrast(metrics, contrast)
    factor = contrast / metrics.median_contrast
    assert other.median_contrast == pytest.approx(contrast, rel=1e-12)
    hole = metrics.hole
    np.testing.assert_allclose(other.raw_contrast[hole], factor * metrics.raw_contrast[hole], rtol=1e-12)
    np.testing.assert_array_equal(other.raw_contrast[~hole], metrics.raw_contrast[~hole])
    assert other.peak_on_axis_hole == pytest.approx(factor * metrics.peak_on_axis_hole, rel=1e-12)
    assert other.peak_on_axis_columns == metrics.peak_on_axis_columns
    np.testing.assert_array_equal(other.core_table, metrics.core_table)
    np.testing.assert_allclose(other.floor_linear, factor * metrics.floor_linear, rtol=1e-12)
    np.testing.assert_array_equal(other.floor_square, metrics.floor_square)
    assert np.isfinite(np.array(other.floor_logs())).all()


def test_the_floor_of_random_fields(metrics):
    """Fields of a static hole and of random errors, added and subtracted as two visits are."""
    rng, n_pixels, draws = np.random.default_rng(2), 40, 4000
    static = (rng.standard_normal(n_pixels) + 1j * rng.standard_normal(n_pixels)) * 1e-5
    error_1_nm = 3e-5  # rms of the real and of the imaginary part in a pixel

    def floor(light, offset):
        error = rng.standard_normal((2, draws, n_pixels)) + 1j * rng.standard_normal((2, draws, n_pixels))
        visits = np.abs(np.sqrt(light) * static + error_1_nm * offset * error) ** 2
        return (visits[0] - visits[1]).sum(axis=-1).std()

    bins = len(metrics.floor_linear)
    linear = 8.0 * error_1_nm**2 * (np.abs(static) ** 2).sum()  # of 2 Re(E0* dE), twice
    square = 8.0 * n_pixels * error_1_nm**4  # of |dE|^2, of variance 4 s^4 a pixel, twice
    known = replace(metrics, floor_linear=np.full(bins, linear), floor_square=np.full(bins, square))
    for light in (0.0, 0.03, 0.3, 4.0, 50.0):
        other = with_contrast(known, light * metrics.median_contrast)
        for offset in (0.005, 0.05, 0.2, 2.0):
            # A standard deviation is known to 1 / sqrt(2 draws).
            tolerance = 4.0 / np.sqrt(2.0 * draws)
            np.testing.assert_allclose(other.rdi_floor(offset, separation_arcsec=0.6), floor(light, offset), tolerance)


@pytest.mark.parametrize("brightest", [None, pytest.param(BRIGHT, marks=pytest.mark.long)])
def test_more_light_is_more_noise_and_less_is_less(instrument, brightest):
    noise = []
    for contrast in (0.0, 1e-10, brightest):  # None: as bright as the instrument's
        model = assuming(instrument, contrast=contrast)
        stack = stack_noise(rates(model), 20.0, 100.0, 300.0, model.camera("F520"))
        assert np.isfinite(stack.significance).all()
        noise.append(float(stack.significance.squeeze()))
    assert np.all(np.diff(noise) < 0.0)


@pytest.mark.parametrize(("band", "contrast"), [("F520", BRIGHT), ("F850", 3e-9), ("F850", 1e-6)])
def test_errors_of_the_mirror_that_brighten_the_hole(instrument, band, contrast):
    """As bright as asked by an image of its own; a small error squared is the light that it adds."""
    noise = mirror_noise_nm(instrument, band, contrast)
    for error, expected in ((noise, contrast), (3.0 * noise, 9.0 * contrast)):
        psf = single_band_psf(band, instrument=instrument.changed({"mirror": {"noise_nm": error}}))
        hole = psf.geometry.hole
        found = np.median((psf.on_axis / psf.off_axis.max())[hole])
        assert found == pytest.approx(expected, rel=1e-5 if error == noise else 0.15)


def test_a_hole_that_no_mirror_brightens(instrument, metrics):
    nominal = metrics.median_contrast
    assert mirror_noise_nm(instrument, "F520", nominal) is None
    assert mirror_noise_nm(instrument, "F520", 0.5 * nominal) is None
    still = instrument.changed({"dark_hole": {"control": "off"}})
    assert mirror_noise_nm(still, "F520", 0.5) is None


@pytest.mark.long
def test_images_of_a_brighter_hole(instrument):
    """The SNR under an assumed contrast is that of images; as much light of the nominal hole would do less harm."""
    strategy = SurveyStrategy(name="x", assumptions={"contrast": BRIGHT})
    model = imaged_model(assumed_model(instrument, strategy, ("F520",)), strategy, "F520")
    assert model.metrics["F520"].median_contrast == pytest.approx(BRIGHT, rel=1e-6)
    star, frames, separation = find_target("eps Eri")[0], Frames(25.0, 120, 300.0), 0.45
    distance_au, albedo = separation * float(star.distance_pc[0]), ConstantAlbedo(value=0.5)
    planet = Planet(
        name="planet",
        separation_arcsec=separation,
        pa_deg=40.0,
        radius_rjup=3.0,
        albedo=albedo,
        distance_au=distance_au,
        phase_deg=90.0,
    )
    light = float(contrast_at(3.0, distance_au, 90.0, 0.5))
    place = sky_to_detector(separation, 40.0, parity=instrument.detector.parity)
    task = task_of(
        model,
        star_scene(star, (planet,), name="x", exozodi_zodis=1.0),
        "F520",
        frames,
        [expected_of(model, star, "F520", place, light, frames)],
        seed=3,
        fidelity="standard",
        realisations=12,
        audit=False,
        overrides=None,
    )
    answer = confirm_task(task.to_dict())["confirmations"][0]
    # Twelve realisations know the SNR to some 10 %, and places of one separation differ by that.
    assert answer["predicted_snr"] == pytest.approx(answer["recovered_snr"], rel=0.25)
    scaled = replace(model, metrics={"F520": with_contrast(build_model(instrument, ("F520",)).metrics["F520"], BRIGHT)})
    optimistic = expected_of(scaled, star, "F520", place, light, frames)
    assert optimistic["snr_full"] > 1.6 * answer["predicted_snr"]


def test_drift_and_throughput_and_dust(instrument):
    nominal = assuming(instrument)
    wild = assuming(instrument, drift=3.0)
    assert wild.instrument.drift.visit_nm == pytest.approx(3.0 * instrument.drift.visit_nm)
    laws = [programme_law(model.metrics["F520"], model.instrument.drift, 0.6, 1.5).law() for model in (nominal, wild)]
    assert 9.0 <= float(laws[1].k0 / laws[0].k0) <= 81.0
    half = rates(assuming(instrument, throughput=0.5))
    one = rates(nominal)
    np.testing.assert_allclose(half.planet_e_s, 0.5 * one.planet_e_s, rtol=1e-12)
    np.testing.assert_allclose(half.halo_e_s, 0.5 * one.halo_e_s, rtol=1e-12)
    np.testing.assert_allclose(half.dark_e_s, one.dark_e_s, rtol=1e-12)
    dusty, clean = (rates(assuming(instrument, exozodi=amount)) for amount in (30.0, 0.0))
    assert float(clean.exozodi_e_s.squeeze()) == 0.0
    assert float(dusty.exozodi_e_s.squeeze()) > 0.0


def test_impossible_assumptions_are_refused_with_their_key(refused, instrument):
    refused(r"bands.F520.t_opt = 1.9.*at most 1", assuming, instrument, throughput=10.0)
    refused("band = F999", assumed_model, instrument, SurveyStrategy(name="x"), ("F999",))
