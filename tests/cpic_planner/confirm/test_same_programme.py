"""The same question has the same programme, whichever command or function is asked: no images are made."""

import math

import pytest

import cpic_planner
from cpic_planner.confirm.curve import (
    AskedStar,
    _curve_programme as programme_of_curve,
    _roc_programme as programme_of_roc,
)
from cpic_planner.confirm.scene import _work, scene_target
from cpic_planner.etc import build_model, diagonal_pa_deg, reference_distance_au, signal_to_noise
from cpic_planner.queries import (
    MAX_FRAMES,
    ConfirmQuestion,
    CurveQuestion,
    EtcQuestion,
    ReferencePlanet,
    RocQuestion,
    Strategy,
)
from cpic_planner.results import BandConfirmation
from cpic_planner.targets import find_target
from cpic_planner.validation import prepare_task, target_scene
from simulator import load_instrument

BRIGHT, FAINT = "tau Cet", "HD 122064"
HOURS = 3600.0
PLACES = {"F520": 0.5, "F662": 0.6, "F720": 0.62, "F850": 0.7}
OPTIONS = [
    {},
    {"time_s": 2 * HOURS},
    {"strategy": {"visits": 1}, "time_s": 2 * HOURS},
    {"strategy": {"visits": 4}},
    {"visit_time_s": 2700.0},
    {"visit_time_s": 2700.0, "time_s": 7 * HOURS},
    {"visit_time_s": 2700.0, "strategy": {"visits": 6}},
    {"exposure_s": 20.0, "time_s": 5 * HOURS},
    {"em_gain": 150.0},
    {"exposure_s": 30.0, "n_frames": 12, "strategy": {"visits": 3}},
]


def shape(answer):
    """Return visits, frames of one, exposure and gain of an answer, a task or a row."""
    frames = answer.n_frames if getattr(answer, "frames_per_visit", None) is None else answer.frames_per_visit
    return answer.visits, frames, pytest.approx(answer.exposure_s, rel=1e-9), pytest.approx(answer.em_gain, rel=1e-9)


def numbers(answer):
    frames = answer.n_frames if getattr(answer, "frames_per_visit", None) is None else answer.frames_per_visit
    return answer.visits, frames, answer.exposure_s, answer.em_gain


def scene_of(star, band, separation, planet=None, pa_deg=None):
    """Return a star with one planet of the calculator, as a scene."""
    model = build_model(load_instrument(), [band])
    target = find_target(star, companions="off")[0]
    planet = planet or ReferencePlanet()
    distance = float(reference_distance_au(target, [separation], planet)[0, 0])
    return target_scene(target, planet, separation, distance, diagonal_pa_deg(model, target, band) + (pa_deg or 0.0))


def confirmed(scene, band, options):
    """Return the task of a scene in a band, or what refuses it."""
    work = _work(ConfirmQuestion.of({"scene": scene, "bands": [band], "realisations": 1, **options}))
    return (work.tasks or work.refused)[0]


def calculated(star, band, separation, options, **planet):
    asked = {"target": star, "bands": [band], "companions": "off", "separation_arcsec": separation, **planet}
    from cpic_planner.api.functions import model_of, stars_named
    from cpic_planner.api.one_star import closed_forms

    question = EtcQuestion.of(asked | options)
    (answer,) = closed_forms(question, model_of(question), stars_named(question)[0])
    return answer


@pytest.mark.parametrize(
    ("star", "band", "options"),
    [
        (star, list(PLACES)[(number + shift) % len(PLACES)], options)
        for number, options in enumerate(OPTIONS)
        for shift, star in enumerate([BRIGHT, FAINT])
    ],
)
def test_confirm_has_the_programme_of_the_calculator(star, band, options):
    task = confirmed(scene_of(star, band, PLACES[band]), band, options)
    answer = calculated(star, band, PLACES[band], options)
    assert numbers(task) == shape(answer)
    assert task.predictions[0]["snr_full"] == pytest.approx(answer.snr, rel=2e-3)
    if "n_frames" in options:
        assert task.unused_s is None
    else:
        given = options.get("time_s", 10 * HOURS)
        if "visit_time_s" in options and "strategy" in options:
            given = options["visit_time_s"] * options["strategy"]["visits"]
        assert task.unused_s == pytest.approx(answer.unused_s, abs=1e-6)
        assert answer.unused_s == pytest.approx(given - answer.time_s, abs=1e-6)
    assert task.chosen_for == "reference planet"


def test_a_long_time_of_a_bright_star_is_many_visits():
    """The case that was found: one visit of 4.2 h for 10 h, at half of the SNR."""
    task = confirmed(scene_of(BRIGHT, "F662", 0.5), "F662", {"time_s": 10 * HOURS})
    assert task.visits > 1
    one = confirmed(scene_of(BRIGHT, "F662", 0.5), "F662", {"time_s": 10 * HOURS, "strategy": {"visits": 1}})
    assert one.visits == 1
    assert task.predictions[0]["snr"] > 1.5 * one.predictions[0]["snr"]
    assert one.unused_s > 3 * HOURS > 30.0 > task.unused_s / 100


def test_off_the_diagonal_the_programme_is_that_of_the_place():
    star, band, separation = BRIGHT, "F520", 0.6
    task = confirmed(scene_of(star, band, separation, pa_deg=10.0), band, {})
    model = build_model(load_instrument(), [band])
    scene = scene_of(star, band, separation, pa_deg=10.0)
    place = task.predictions[0]
    angle = math.radians(place["pa_deg"])
    parity = model.instrument.detector.parity
    offsets = (parity * separation * math.sin(angle), separation * math.cos(angle))
    (answer,) = signal_to_noise(
        model,
        scene_target(scene),
        time_s=10 * HOURS,
        separation_arcsec=separation,
        contrast=place["contrast"],
        offsets_arcsec=offsets,
    )
    assert numbers(task) == shape(answer)
    assert place["snr_full"] == pytest.approx(answer.snr, rel=1e-6)


def test_the_first_planet_in_the_hole_chooses_and_every_row_says_so():
    planets = [
        {"name": name, "radius_rjup": 1.0, "phase_deg": 90, "separation_arcsec": place, "pa_deg": pa, "albedo": 0.5}
        for name, place, pa in (("out", 0.15, 315), ("b", 0.6, 315), ("c", 0.8, 135))
    ]
    star = {"name": "s", "v_mag": 4.5, "spectral_type": "K1V", "distance_pc": 5.0}
    both = confirmed({"name": "s", "cstar": star, "planets": planets}, "F520", {})
    alone = confirmed({"name": "s", "cstar": star, "planets": planets[1]}, "F520", {})
    assert both.chosen_for == alone.chosen_for == "b"
    assert numbers(both) == shape(alone)
    turned = confirmed({"name": "s", "cstar": star, "planets": planets[::-1]}, "F520", {})
    assert turned.chosen_for == "c"
    assert numbers(turned) != numbers(both)
    none = confirmed({"name": "s", "cstar": star}, "F520", {})
    assert "1e-08" in none.chosen_for


def test_what_cannot_be_imaged_is_refused_and_not_cut():
    options = {"time_s": 10 * HOURS, "strategy": {"visits": 1}, "exposure_s": 1.0}
    refused = confirmed(scene_of(BRIGHT, "F520", 0.5), "F520", options)
    assert isinstance(refused, BandConfirmation)
    assert (refused.status, refused.reason) == ("invalid", "too_many_frames")
    assert f"more than {MAX_FRAMES} frames a visit" in refused.message
    assert calculated(BRIGHT, "F520", 0.5, options).frames_per_visit > MAX_FRAMES


def test_no_frame_is_refused_with_the_reason_of_the_calculator():
    refused = confirmed(scene_of(BRIGHT, "F520", 0.5), "F520", {"time_s": 30.0})
    answer = calculated(BRIGHT, "F520", 0.5, {"time_s": 30.0})
    assert answer.value is None
    assert (refused.status, refused.reason, refused.message) == (answer.status, answer.reason, answer.message)


TIMES = [options for options in OPTIONS if not {"exposure_s", "em_gain"} & set(options)]


@pytest.mark.parametrize(
    ("star", "place", "options"),
    [
        ((BRIGHT, FAINT)[(number + shift) % 2], place, options)
        for number, options in enumerate(TIMES)
        for shift, place in enumerate([None, 0.6])
    ],
)
def test_characteristics_and_curves_have_the_programme_of_the_calculator(star, place, options):
    band, target = "F662", find_target(star, companions="off")[0]
    model = build_model(load_instrument(), [band], Strategy(**options.get("strategy", {})))
    asked = AskedStar(target, "", "")
    common = {"target": star, "bands": [band], **options}
    roc, _ = programme_of_roc(RocQuestion.of(common | {"separation_arcsec": place}), model, asked, band)
    curve, _ = programme_of_curve(CurveQuestion.of(common | {"separation_arcsec": place}), model, asked, band)
    for found, question in ((roc, {}), (curve, {"contrast_limit": True})):
        answer = calculated(star, band, place, options, **question)
        assert numbers(found) == shape(answer)
        assert found.separation_arcsec == answer.separation_arcsec
        assert found.unused_s == answer.unused_s


@pytest.mark.parametrize("visits", [None, 3])
@pytest.mark.parametrize("star", [BRIGHT, FAINT])
def test_plans_have_the_programme_of_the_ranking(star, visits):
    """Rankings and plans ask for the clearest detection, as `cpic_planner.optimise` does, and not for most SNR."""
    band, target = "F520", find_target(star)[0]
    model = build_model(load_instrument(), [band], Strategy(visits=visits))
    task = prepare_task(model, target, band, time_s=5 * HOURS, planet=ReferencePlanet(), seed=1)
    best = cpic_planner.optimise(star, time_s=5 * HOURS, bands=[band], strategy={"visits": visits})
    assert numbers(task) == (
        int(best.visits[0]),
        int(best.frames_per_visit[0]),
        pytest.approx(best.exposure_s[0], rel=1e-9),
        pytest.approx(best.em_gain[0], rel=1e-9),
    )
    assert task.unused_s == pytest.approx(5 * HOURS - best.time_s[0], abs=1e-6)


def test_unused_time_is_what_whole_visits_and_frames_leave():
    options = {"visit_time_s": 2700.0, "time_s": 7 * HOURS}
    answer = calculated(BRIGHT, "F520", 0.5, options)
    assert answer.visits == 9
    assert answer.unused_s >= 900.0
    assert calculated(BRIGHT, "F520", 0.5, {"snr": 5.0}).unused_s is None
