"""The ranking against a few lines of arithmetic of its own."""

import csv
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import binom, norm, t as student

from catalogs import OrbitPlaces, load_stars
from cpic_core import Reason
from cpic_planner import load_targets
from cpic_planner.etc import build_model, contrast_limit, diagonal_pa_deg
from cpic_planner.etc.questions import exposure_time, signal_to_noise
from cpic_planner.planets import PopulationChoice, draw_population
from cpic_planner.queries import RankQuestion, ReferencePlanet, Strategy
from cpic_planner.ranking import detection_statuses, optimise, rank_targets, timed_model
from cpic_planner.survey.calendar import Calendar
from cpic_planner.survey.detection import Setting, detection_chance, expected_signals
from cpic_planner.survey.strategy import DetectionRule
from cpic_planner.targets import find_target, rank_sample
from simulator.config import load_instrument

MODEL = build_model(load_instrument())
ONE = build_model(load_instrument(), None, Strategy(visits=1))
TWO_BANDS = build_model(load_instrument(), ["F520", "F662"])
FEW = rank_sample(v_mag_max=3.0)
SMALL = PopulationChoice(PopulationChoice.default().config, n_planets=200)
AU_KM, RJ_KM = 149597870.7, 71492.0


@pytest.fixture(scope="module")
def ranking():
    return rank_targets(MODEL, rank_sample(), time_s=36000.0)


def test_reference_planet_follows_from_distance_and_separation(ranking):
    for row in ranking.targets[::50]:
        distance_au = row.distance_pc * row.separation_arcsec
        assert row.ref_planet_distance_au == pytest.approx(distance_au, rel=1e-12)
        geometric = (RJ_KM / (distance_au * AU_KM)) ** 2 / np.pi
        assert 0.2 < row.contrast / geometric < 0.56  # Jupiter's albedo over the visible bands
        assert row.ref_planet_insolation_au == pytest.approx(distance_au / row.luminosity_lsun**0.5, rel=1e-12)


def test_the_first_60_are_the_stars_whose_red_light_is_tested(ranking):
    lines = (Path(__file__).parents[2] / "first_targets.csv").read_text(encoding="utf-8").splitlines()
    assert {row.name for row in ranking.targets[:60]} == {row["star"] for row in csv.DictReader(lines)}


def test_order_status_and_reason_agree(ranking):
    scores = [(row.score, row.detection_margin) for row in ranking.targets]
    assert scores == sorted(scores, reverse=True)
    assert [row.rank for row in ranking.targets] == list(range(1, len(scores) + 1))
    for row in ranking.targets:
        assert row.detection_margin == pytest.approx(row.significance / row.threshold, rel=1e-12)
        assert (row.status == "ok") == (row.detection_probability >= 0.5 * (1 - 1e-9)) == (row.reason == "")
        assert row.time_s <= 36000 * (1 + 1e-12)
        assert row.time_s == row.visits * row.visit_time_s
        assert row.n_frames == row.visits * row.frames_per_visit
        assert row.reference_visits == row.visits
        frames_s = 2 * row.frames_per_visit * (row.exposure_s + 1.1)
        assert row.visit_time_s == pytest.approx(600 + frames_s, rel=1e-12)
        assert row.span_days == pytest.approx(row.time_s / 0.46 / 86400, rel=1e-12)
        assert row.completeness_per_hour == pytest.approx(3600 * row.completeness / row.completeness_time_s, rel=1e-12)
        assert row.score == row.completeness_per_hour
    reasons = [row.reason or "ok" for row in ranking.targets]
    assert ranking.counts == {name: reasons.count(name) for name in set(reasons)}


def test_an_independent_estimate_finds_the_same_detections():
    """Distance, square quadrants, threshold x noise, written out from scratch for F520; best of many visits."""
    alone = load_instrument({"overhead_s": 0.0, "drift": {"common_fraction": 0.0}})
    placed = build_model(alone, None, Strategy(visits=1, search="known_place"))
    ranking = rank_targets(placed, rank_sample(), time_s=36000.0, population=SMALL)
    table, metrics = load_targets(), MODEL.metrics["F520"]
    star = 7.08e8 * 10 ** (-0.4 * (table["v_mag"].to_numpy() - 1.33))  # e-/s on the clear disc, scaled from alpha Cen B
    exposure = np.clip(8e4 / (star * 1.25e-7), 1, 300)
    gain = np.minimum(1000, 7.3e5 / (star * 5.8e-8 * exposure))
    margin = np.zeros(len(table))
    for place in np.linspace(0.37, 0.94, 58):
        n, core = (
            float(metrics.resolution_elements(place)),
            float(metrics.core_throughput(place / 2**0.5, place / 2**0.5)),
        )
        if n < 3:
            continue
        threshold = student.isf(norm.sf(5), n - 2) * (1 + 1 / (n - 1)) ** 0.5
        signal = star * core * 0.515 * (RJ_KM / (table["distance_pc"].to_numpy() * place * AU_KM)) ** 2 / np.pi
        around = np.clip(place + 0.08 * np.linspace(-1, 1, 9), 0.36, 0.95)
        for hours in np.geomspace(0.05, 5, 15):
            floor = metrics.rdi_floor(0.05, walk_nm_per_sqrt_hour=0.05, visit_hours=hours, separation_arcsec=around)
            white = (
                2 * 1.98 * (star * 8.9e-11 + 17 * (5e-4 + 0.02 / exposure) + 0.01)
                + 2 * 17 * (110 / gain) ** 2 / exposure
            )
            noise = np.sqrt(white / (3600 * hours * exposure / (exposure + 1.1)) + (star**2 * (floor**2).mean()))
            margin = np.maximum(margin, signal / noise / threshold)
    found = set(table["name"][margin >= 1])
    said = {row.name for row in ranking.targets if row.status == "ok"}
    assert len(said) >= 5
    assert abs(len(found) - len(said)) <= 0.10 * len(said)
    assert found == said
    assert all(row.reason for row in ranking.targets if row.name not in said)


def test_whether_time_would_help_is_told():
    """Short visits: what a longer one detects lacks time; what none detects is below the residual."""
    for model, floor in ((ONE, "speckle_floor"), (MODEL, "common_speckle_floor")):
        short = rank_targets(model, rank_sample(v_mag_max=4.0), time_s=660.0, population=SMALL)
        for row in short.targets:
            if row.reason == "insufficient_time":
                assert row.required_time_s == row.detection_time_s > 660.0
            if row.reason == floor:
                assert row.detection_time_s is None
            if row.reason == "planet_moves":  # the orbits of the years that it takes ask for more than they bring
                assert row.detection_time_s is None
                assert row.verdict_mode == "blind"
        assert {row.reason for row in short.targets} - {"planet_moves"} == {"", "insufficient_time", floor}
    none = rank_targets(MODEL, FEW, time_s=1.0, population=SMALL)
    assert {row.reason for row in none.targets} == {"time_below_overheads"}
    assert all(row.time_s is None and row.detection_margin == 0.0 for row in none.targets)
    blind = build_model(load_instrument({"detector": {"exposure_min_s": 250.0}}))
    verdicts = detection_statuses(optimise(blind, FEW, time_s=36000.0), blind)
    assert Reason.PIXEL_FULL_WELL in {reason for _, reason in verdicts}


def test_ranked_numbers_are_those_of_the_etc(ranking):
    for row in ranking.targets[:5]:
        star, _ = find_target(row.name)
        fixed = {"exposure_s": row.exposure_s, "em_gain": row.em_gain, "bands": [row.band], "exact": True}
        model = build_model(load_instrument(), None, Strategy(visits=row.visits))
        answer = signal_to_noise(model, star, time_s=row.time_s, separation_arcsec=row.separation_arcsec, **fixed)[0]
        assert (answer.n_frames, answer.visits) == (row.n_frames, row.visits)
        assert answer.verdict == row.verdict == "detected"
        assert answer.detection_probability == pytest.approx(row.detection_probability, rel=1e-6)
        placed = row.detection_probability_known_place
        assert answer.detection_probability_known_place == pytest.approx(placed, rel=1e-6)
        assert answer.snr == pytest.approx(row.snr, rel=1e-9)
        assert answer.significance == pytest.approx(row.significance, rel=1e-9)
        assert answer.threshold == pytest.approx(row.threshold, rel=1e-9)
        assert answer.contrast == pytest.approx(row.contrast, rel=1e-9)


def test_every_detected_planet_is_found_again_by_its_time(ranking):
    found = [row for row in ranking.targets if row.status == "ok"]
    for row in found[::3]:
        star, _ = find_target(row.name)
        answer = exposure_time(MODEL, star, detect=True, separation_arcsec=row.separation_arcsec, bands=[row.band])[0]
        assert answer.value <= row.time_s * (1 + 1e-9)
        # The quickest place and band are no slower than those of the clearest detection, to the flat top of visits.
        assert row.detection_time_s <= answer.value * (1 + 0.01)


def test_contrast_limit_is_where_the_planet_is_just_detected():
    star, _ = find_target("tau Cet")
    limit = contrast_limit(MODEL, star, time_s=7200.0, separation_arcsec=0.5, bands=["F520"])[0]
    fixed = {"exposure_s": limit.exposure_s, "em_gain": limit.em_gain, "exact": True, "contrast": limit.value}
    model = build_model(load_instrument(), None, Strategy(visits=limit.visits))
    back = signal_to_noise(model, star, time_s=limit.time_s, separation_arcsec=0.5, bands=["F520"], **fixed)[0]
    assert back.visits == limit.visits > 1
    assert back.detection_probability == pytest.approx(0.5, abs=1e-5)


def test_fewer_stars_with_more_drift_and_all_with_none():
    targets = rank_sample(v_mag_max=4)
    counts = []
    for factor in (2.0, 1.0, 0.0):
        drift = {"visit_nm": 0.05 * factor, "walk_nm_per_sqrt_hour": 0.05 * factor}
        model = build_model(load_instrument({"drift": drift}))
        counts.append(int(np.sum(optimise(model, targets, time_s=36000.0).margin >= 1)))
    assert counts[0] < counts[1] < counts[2]


def test_companion_light_counts_only_when_on():
    on, off = (find_target("70 Oph A", companions=state)[0] for state in ("on", "off"))
    pair = [signal_to_noise(MODEL, star, time_s=7200.0, separation_arcsec=0.5, bands=["F520"])[0] for star in (on, off)]
    assert pair[0].budget["companion_e2"] > 0 == pair[1].budget["companion_e2"]
    assert "companion_light_on" in pair[0].flags
    assert "companion_light_off" in pair[1].flags


@pytest.mark.parametrize(
    "score", ["completeness", "detection_margin", "detection_time", "photometric_snr", "contrast_limit"]
)
def test_other_scores(score):
    found = rank_targets(TWO_BANDS, FEW, time_s=7200.0, population=SMALL, score=score)
    for row in found.targets:
        expected = {
            "completeness": row.completeness,
            "detection_margin": row.detection_margin,
            "detection_time": 3600.0 / row.detection_time_s if row.detection_time_s else 0.0,
            "photometric_snr": row.snr,
            "contrast_limit": -math.log10(row.deepest_limit),
        }[score]
        assert row.score == pytest.approx(expected, rel=1e-12)
    scores = [row.score for row in found.targets]
    assert scores == sorted(scores, reverse=True)
    assert found.score_name == score


def test_completeness_is_a_share_of_the_planets_drawn(ranking):
    assert ranking.population.n_planets == len(draw_population(PopulationChoice.default().config, 4000, 1).radius_rjup)
    for row in ranking.targets[:40]:
        share = row.completeness_unconditional
        # A planet that may exist with less than certainty scatters less than one that does or does not.
        assert row.completeness_error <= (row.completeness * (1 - row.completeness) / 4000) ** 0.5 * (1 + 1e-9)
        assert row.expected_planets == pytest.approx(0.21 * row.completeness)
        assert row.expected_planets_unconditional == pytest.approx(0.21 * share)


def test_one_band_by_name_is_that_band():
    one, listed = (
        rank_targets(MODEL, FEW, time_s=7200.0, bands=bands, population=SMALL) for bands in ("F662", ["F662"])
    )
    assert one == listed
    assert {row.band for row in one.targets} == {"F662"}


@pytest.mark.parametrize("value", [-1.0, 0.0, math.nan, math.inf, 1e10, True, "3600", None])
def test_times_out_of_range_are_refused(refused, value):
    refused("^time_s = ", rank_targets, MODEL, FEW, time_s=value, population=SMALL)


def test_what_cannot_be_ranked_is_refused(refused):
    refused("^targets = 0", rank_targets, MODEL, FEW.select([]), time_s=3600.0, population=SMALL)
    refused("^score = best", rank_targets, MODEL, FEW, time_s=3600.0, population=SMALL, score="best")
    refused("^band = F999", rank_targets, MODEL, FEW, time_s=3600.0, population=SMALL, bands=["F999"])


def test_numpy_times_give_the_same_ranking():
    plain, other = (rank_targets(TWO_BANDS, FEW, time_s=t, population=SMALL) for t in (3600.0, np.int64(3600)))
    assert plain == other


def test_every_idealised_row_says_so():
    model = build_model(load_instrument(), None, Strategy(library="idealised"))
    assert all("idealised" in row.flags for row in rank_targets(model, FEW, time_s=3600.0, population=SMALL).targets)


def test_the_catalogue_by_what_limits_it(ranking):
    """A wavefront without drift would detect some ten more reference planets; nine in ten stars are too faint."""
    assert {"none", "speckles", "photons"} <= set(ranking.counts_limited_by)
    assert ranking.counts_limited_by["photons"] > 0.9 * len(ranking.targets)
    assert 10 <= ranking.counts_limited_by["none"] <= 60
    told = [row.limited_by for row in ranking.targets]
    assert ranking.counts_limited_by == {name: told.count(name) for name in set(told)}
    for row in ranking.targets:
        assert row.verdict == ("detected" if row.status == "ok" else "unreachable")
        assert (row.verdict == "detected") == (row.limited_by == "none")
        assert (row.verdict == "detected") == (row.detection_probability >= 0.5 * (1 - 1e-9))
        assert row.verdict_mode == "blind"
        for missing in (row.required_drift_factor, row.required_visits, row.required_time_s):
            assert missing is None or row.verdict != "detected"
        assert (row.required_contrast_factor is None) == (row.verdict == "detected")
        if row.limited_by == "photons":
            assert row.required_drift_factor is None
        if row.limited_by == "speckles":
            assert 0.0 < row.required_drift_factor < 1.0


def test_what_images_hardly_find_in_one_long_visit_is_better_found_in_a_shorter_one():
    """The images of epsilon Indi and 61 Cygni A, as long as the SNR grows: a blind search finds 2 and 1 of 24.

    The light of the wavefront's errors, which grows through a visit, makes noise that the search judges worse.
    """
    stars = rank_sample()
    stars = stars.select(np.isin(stars.name, ["eps Ind", "61 Cyg A"]))
    rows = {row.name: row for row in rank_targets(ONE, stars, time_s=36000.0, population=SMALL).targets}
    for name, seen in (("eps Ind", 2), ("61 Cyg A", 1)):
        row, (star, _) = rows[name], find_target(name)
        place = {"separation_arcsec": row.separation_arcsec, "bands": [row.band]}
        longest = signal_to_noise(ONE, star, time_s=36000.0, **place)[0]
        assert longest.significance > longest.threshold
        assert longest.verdict != "detected"
        chance = longest.detection_probability
        assert min(binom.cdf(seen, 24, chance), binom.sf(seen - 1, 24, chance)) > 0.05
        assert row.visits == 1
        assert row.significance < longest.significance
        assert row.visit_time_s < 0.6 * longest.time_s
        assert (row.verdict, row.status) == ("detected", "ok")
    for row in rank_targets(MODEL, stars, time_s=36000.0, population=SMALL).targets:
        assert (row.verdict, row.status, row.required_visits) == ("detected", "ok", None)
        assert row.detection_probability > rows[row.name].detection_probability
        assert 1 < row.visits < 100


@pytest.mark.parametrize("visits", [1, 4])
def test_ranking_calculator_and_survey_agree(visits):
    """One star, one planet, the same frames: the probabilities of the ranking, of the calculator and of a survey."""
    model = build_model(load_instrument(), ["F520"], Strategy(visits=visits))
    star, _ = find_target("tau Cet")
    best = optimise(model, star, time_s=7200.0)
    frames = [best.exposure_s, best.frames_per_visit, best.em_gain, best.time_s]
    setting = Setting("F520", *(float(part[0]) for part in frames))
    asked = {"time_s": float(best.time_s[0]), "separation_arcsec": float(best.separation_arcsec[0]), "exact": True}
    own = {"exposure_s": setting.exposure_s, "em_gain": setting.em_gain}
    answer = signal_to_noise(model, star, **asked, **own)[0]
    angle = math.radians(diagonal_pa_deg(model, star, "F520"))
    radius_au = float(best.separation_arcsec[0] * star.distance_pc[0])
    ones = np.ones((1, 1))
    place = OrbitPlaces(
        east_au=ones * radius_au * math.sin(angle),
        north_au=ones * radius_au * math.cos(angle),
        distance_au=ones * radius_au,
        phase_deg=ones * 90.0,
    )
    sample = SimpleNamespace(kind=np.zeros(1, int), radius_rjup=np.ones(1))
    seen = expected_signals(model, star, setting, sample, (ReferencePlanet().albedo,), place, [0.0])
    blind, placed = (float(detection_chance(seen, DetectionRule(), np.array([known]))[0, 0]) for known in (False, True))
    assert answer.detection_probability == pytest.approx(best.chance_blind[0], rel=1e-6)
    assert answer.detection_probability_known_place == pytest.approx(best.chance_known_place[0], rel=1e-6)
    assert (answer.verdict == "detected") == best.detected[0] == (best.chance_blind[0] >= 0.5)
    assert blind == pytest.approx(best.chance_blind[0], rel=1e-3)
    assert placed == pytest.approx(best.chance_known_place[0], rel=1e-3)


@pytest.mark.parametrize("changes", [{}, {"bands": ["F662", "F720"]}])
def test_speckles_limit_what_an_instrument_without_drift_detects(changes):
    """Ranked anew with an instrument that does not drift; the stars hold all three kinds."""
    names = ["tau Cet", "omi2 Eri", "bet Hyi", "70 Oph A", "gam Lep", "mu Her", "10 Tau", "HD 191408", "alf Aur"]
    stars = rank_sample()
    stars = stars.select(np.isin(stars.name, names))
    still = load_instrument().changed({"drift": {"visit_nm": 0.0, "walk_nm_per_sqrt_hour": 0.0}})
    asked = {"time_s": 36000.0, **changes}
    for model in (ONE, MODEL):
        free = optimise(build_model(still, None, model.strategy), stars, **asked)
        told = {row.name: row.limited_by for row in rank_targets(model, stars, population=SMALL, **asked).targets}
        for name, clear in zip(stars.name, free.detected, strict=True):
            assert (told[str(name)] in ("none", "speckles", "common_speckles")) == clear, name
        assert {"none", "speckles"} & set(told.values())


def test_what_is_known_of_the_stars_decides_completeness_and_order(ranking):
    by_name = {row.name: row for row in ranking.targets}
    for row in ranking.targets:
        assert 0.0 <= row.completeness <= row.completeness_unconditional <= 1.0
        assert row.completeness_known_place <= row.completeness_known_place_unconditional <= 1.0
    tau_ceti = by_name["tau Cet"]
    assert tau_ceti.completeness_unconditional > 0.04
    assert tau_ceti.completeness < 0.1 * tau_ceti.completeness_unconditional
    # Procyon has room to 0.80 arcsec; nobody's velocities are counted there.
    assert 0.5 < by_name["alf CMi"].completeness / by_name["alf CMi"].completeness_unconditional < 1.0
    assert ranking.population.planets_per_star_range == (0.14, 0.26)
    assert ranking.population.exclusions == ["rv", "stability", "known_giants"]


def test_without_exclusions_all_planets_count(ranking):
    stars = rank_sample(v_mag_max=2.5)
    choice = PopulationChoice(PopulationChoice.default().config, exclusions=())
    found = rank_targets(MODEL, stars, time_s=36000.0, population=choice)
    before = {row.name: row for row in ranking.targets}
    for row in found.targets:
        assert row.completeness == row.completeness_unconditional == before[row.name].completeness_unconditional
        assert row.expected_planets == row.expected_planets_unconditional
    assert [row.score for row in found.targets] == sorted((row.score for row in found.targets), reverse=True)
    assert found.population.exclusions == []
    some = rank_targets(MODEL, stars, time_s=36000.0, population=PopulationChoice(choice.config))
    assert some.config_hash != found.config_hash


def test_reference_planets_that_velocities_exclude_are_flagged(ranking):
    """The amplitude by Kepler's third law: 28.4 m/s at 1 au for a Jupiter of the Sun."""
    flagged = {row.name for row in ranking.targets if "excluded_by_rv" in row.flags}
    assert {"tau Cet", "alf Cen B"} <= flagged
    assert not {"alf CMi", "eps Ind", "70 Oph A", "ksi Boo A"} & flagged
    stars = load_stars()
    mass = dict(zip(stars.column("name").tolist(), stars.column("mass_msun").tolist(), strict=True))
    for row in ranking.targets[:20]:
        expected = 28.43 * 0.2735 * math.sin(math.radians(60)) / math.sqrt(mass[row.name] * row.ref_planet_distance_au)
        assert row.rv_amplitude_m_s == pytest.approx(expected, rel=2e-3)


def test_the_length_of_a_visit_sets_number_or_time(refused):
    """Either of three follows from the other two, and a contradiction is refused."""
    asked = {"bands": ("F520",), "n_planets": 50}
    model = build_model(load_instrument(), ["F520"])
    for given, visits, time_s in (
        ({"visit_time_s": 3000.0}, 12, 36000.0),
        ({"visit_time_s": 3000.0, "strategy": Strategy(visits=4)}, 4, 12000.0),
        ({"visit_time_s": 3000.0, "time_s": 7000.0}, 2, 6000.0),
        ({"time_s": 7000.0}, None, 7000.0),
    ):
        question = RankQuestion(**asked, **given)
        own = replace(model, strategy=question.strategy)
        timed, wall_s = timed_model(own, question)
        assert (timed.strategy.visits, wall_s) == (visits, time_s)
    asked_twice = RankQuestion(**asked, visit_time_s=3000.0, time_s=7000.0)
    wrong = asked_twice.model_copy(update={"strategy": Strategy(visits=4)})  # as a plan, which is not asked before
    refused("^time_s = 7000", timed_model, replace(model, strategy=wrong.strategy), wrong)


def test_settlings_of_a_survey_are_those_of_all_visits():
    """Two observations of the same wall time: that of four visits settles four times as often."""
    calendar = Calendar(
        start_mjd=61771.0,
        slot_h=np.array([240.0]),
        fraction=np.array([[0.46]]),
        allowed_h=np.array([[240.0]]),
        window_s=np.array([[2500.0]]),
        day=np.array([[5.0]]),
        sun_pa_deg=np.array([[0.0]]),
        period_s=5553.6,
        settle_h=0.5,
        opens_day=np.array([[0.0]]),
        closes_day=np.array([[10.0]]),
    )
    setting = Setting("F520", 30.0, 10.0, 20.0, 36000.0)
    one, four = (
        calendar.cost_h(build_model(load_instrument(), ["F520"], Strategy(visits=visits)), 0, setting, 2)[0]
        for visits in (1, 4)
    )
    assert four - one == pytest.approx(3 * 2 * 0.5)
