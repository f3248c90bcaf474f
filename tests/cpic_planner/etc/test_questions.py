"""The three questions: inverses of each other, monotone, and an answer of some type to everything."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from cpic_core import InputError
from cpic_planner.etc import build_model, contrast_limit, contrast_limits
from cpic_planner.etc.questions import exposure_time, signal_to_noise
from cpic_planner.queries import ReferencePlanet, Strategy
from cpic_planner.targets import find_target, rank_sample
from simulator.config import load_instrument

STARS = rank_sample()
TAU_CET = find_target("tau Cet")[0]
INSTRUMENT = load_instrument()
PLACE_KNOWN = {"visits": 1, "search": "known_place"}
ONE = Strategy(**PLACE_KNOWN)
MODEL = build_model(INSTRUMENT, None, ONE)
PLACE = {"separation_arcsec": 0.55, "bands": ["F520"]}
STRATEGIES = {
    "default": ONE,
    "four visits": Strategy(visits=4, search="known_place"),
    "blind": Strategy(visits=1),
    "known place": Strategy(visits=2, search="known_place"),
    "counting": Strategy(**PLACE_KNOWN, mode="photon_counting"),
    "brighter reference": Strategy(
        **PLACE_KNOWN, library="reference_star", reference_star={"v_mag": 1.0}, reference_ratio=0.5
    ),
    "roll": Strategy(**PLACE_KNOWN, library="roll"),
    "idealised": Strategy(**PLACE_KNOWN, library="idealised"),
    "many references": Strategy(**PLACE_KNOWN, reference_ratio=10.0, n_modes=0),
    "few references": Strategy(**PLACE_KNOWN, reference_ratio=0.1, sigma=3.0),
}
INSTRUMENTS = {
    "default": INSTRUMENT,
    "no walk": load_instrument({"drift": {"walk_nm_per_sqrt_hour": 0}}),
    "no drift": load_instrument({"drift": {"visit_nm": 0, "walk_nm_per_sqrt_hour": 0}}),
    "large drift": load_instrument({"drift": {"visit_nm": 2.0, "walk_nm_per_sqrt_hour": 2.0}}),
    "slow walk": load_instrument({"drift": {"visit_nm": 0.3, "walk_nm_per_sqrt_hour": 0.01}}),
    "overhead": load_instrument({"overhead_s": 900.0}),
    "quiet": load_instrument({"detector": {"read_noise_e": 0, "switches": {"clock_charge": False, "dark": False}}}),
}


OFTEN = ("default", "counting", "few references", "large drift", "slow walk")
"""Strategies and instruments with terms of their own in the closed forms; the others are long proofs."""


def often(names, *more):
    """Cases of these names; most are long."""
    return [pytest.param(name, *more, marks=[pytest.mark.long] * (name not in OFTEN)) for name in names]


def star(v_mag, distance_pc=10.0, teff_k=5800.0):
    """Stars made by hand, of one magnitude or several."""
    v, d, t = np.broadcast_arrays(np.atleast_1d(np.asarray(v_mag, float)), distance_pc, teff_k)
    return replace(TAU_CET.select([0] * len(v)), v_mag=v, distance_pc=d.astype(float), teff_k=t.astype(float))


def plain(answer):
    """An answer is a number with everything finite, or a reason; returned for further checks."""
    for value in answer.to_dict().values():
        for item in value.values() if isinstance(value, dict) else [value]:
            assert not isinstance(item, float) or math.isfinite(item), answer
    if answer.status == "ok":
        assert answer.value is not None
        assert answer.reason == ""
        assert answer.n_frames >= 1
        assert answer.exposure_s > 0
        assert answer.em_gain >= 1
        assert answer.budget["signal_e"] > 0
    else:
        assert answer.value is None
        assert answer.reason
        assert answer.message
        assert answer.exposure_s is None
    return answer


# --- round trips


@pytest.mark.parametrize("setup", often([*STRATEGIES, *(name for name in INSTRUMENTS if name != "default")]))
def test_round_trips(setup):
    """Contrast limit in a time -> time for that contrast; SNR in a time -> time for that SNR: what was used."""
    model = build_model(INSTRUMENTS.get(setup, INSTRUMENT), None, STRATEGIES.get(setup, ONE))
    rng = np.random.default_rng(len(setup))
    back_again = 0
    for case in range(4):
        target = STARS.select([int(rng.integers(len(STARS)))])
        time_s, place = float(10 ** rng.uniform(1.0, 6.5)), float(rng.uniform(0.42, 0.95))
        fixed = ({}, {}, {"exposure_s": 5.0}, {"em_gain": 50.0})[case % 4]
        if model.strategy.mode == "photon_counting" and "em_gain" in fixed:
            fixed = {"em_gain": 900.0}
        given = {"separation_arcsec": place, "bands": ["F520", "F720"], **fixed}
        for asked, inverse in (({"sigma": 5.0}, {"sigma": 5.0}), ({}, {"detect": True}), ({"snr": 5.0}, {"snr": 5.0})):
            for limit in contrast_limit(model, target, time_s=time_s, **given, **asked):
                plain(limit)
                if limit.value is None:
                    continue
                again = plain(
                    exposure_time(model, target, contrast=limit.value, **given | {"bands": [limit.band]}, **inverse)[0]
                )
                # Where more time hardly pays, the length of a visit is defined to 1e-6 alone.
                defined = 1e-6 if "shorter_visit_is_better" in limit.flags else 1e-9
                assert again.value == pytest.approx(limit.time_s, rel=defined)
                assert limit.time_s <= time_s * (1 + 1e-12)
                back_again += 1
        for found in signal_to_noise(model, target, time_s=time_s, contrast=1e-8, **given):
            plain(found)
            if found.value is None:
                continue
            again = plain(
                exposure_time(model, target, snr=found.value, contrast=1e-8, **given | {"bands": [found.band]})[0]
            )
            assert again.value == pytest.approx(found.time_s, rel=1e-9)
            back_again += 1
    assert back_again > 8


def test_a_detection_in_a_narrow_range_of_visits_is_found_by_every_question():
    """In two visits to Procyon the level is reached in a valley that is flat: its time stands beside a short visit."""
    model = build_model(INSTRUMENT, None, Strategy(visits=2))
    asked = {"separation_arcsec": 0.42, "bands": ["F720"]}
    detected = exposure_time(model, find_target("alf CMi A")[0], detect=True, **asked)[0]
    short = exposure_time(model, find_target("alf CMi A")[0], snr=5.0, **asked)[0]
    assert short.required_time_s == pytest.approx(detected.value, rel=1e-4)


def test_unreachable_both_ways():
    """What no time reaches has no contrast limit that would say otherwise."""
    limit = contrast_limit(MODEL, TAU_CET, time_s=1e9, **PLACE)[0]
    fainter = exposure_time(MODEL, TAU_CET, detect=True, contrast=0.99 * limit.value, **PLACE)[0]
    brighter = exposure_time(MODEL, TAU_CET, detect=True, contrast=1.01 * limit.value, **PLACE)[0]
    assert (fainter.status, fainter.reason) == ("unreachable", "speckle_floor")  # more visits would do
    assert brighter.status == "ok"
    assert brighter.value < limit.time_s


def test_given_frames_are_used_and_the_rest_follows():
    free = signal_to_noise(MODEL, TAU_CET, time_s=3600.0, contrast=1e-8, **PLACE)[0]
    fixed = signal_to_noise(
        MODEL, TAU_CET, time_s=3600.0, contrast=1e-8, exposure_s=17.0, em_gain=20.0, exact=True, **PLACE
    )[0]
    assert (fixed.exposure_s, fixed.em_gain) == (17.0, 20.0)
    assert fixed.n_frames == math.floor((3600.0 - 600.0) / 2.0 / 18.1)
    assert fixed.snr < free.snr
    assert fixed.exposure_limited_by == ""
    own = signal_to_noise(
        MODEL,
        TAU_CET,
        time_s=free.time_s,
        contrast=1e-8,
        exposure_s=free.exposure_s,
        em_gain=free.em_gain,
        exact=True,
        **PLACE,
    )[0]
    assert own.snr == pytest.approx(free.snr, rel=1e-9)


def test_exposures_out_of_range(refused):
    beyond = exposure_time(MODEL, star(7.0), snr=2.0, contrast=1e-7, exposure_s=400.0, **PLACE)[0]
    assert "exposure_beyond_max" in beyond.flags
    assert beyond.exposure_s == 400.0
    refused("exposure_s = 0.009 s", exposure_time, MODEL, TAU_CET, snr=2.0, exposure_s=0.009, **PLACE)
    refused("em_gain = 1001", exposure_time, MODEL, TAU_CET, snr=2.0, em_gain=1001, **PLACE)
    saturated = exposure_time(MODEL, star(0.0), snr=2.0, exposure_s=200.0, **PLACE)[0]
    assert (saturated.status, saturated.reason) == ("saturated", "pixel_full_well")
    for gain in (1, 1000.0):
        assert exposure_time(MODEL, TAU_CET, snr=2.0, contrast=1e-7, em_gain=gain, **PLACE)[0].em_gain == gain


# --- monotone

ROUNDING = 1 + 1e-12
SETUPS = {
    name: build_model(INSTRUMENTS.get(name, INSTRUMENT), ["F520"], STRATEGIES.get(name, ONE))
    for name in (*STRATEGIES, "no drift", "large drift", "overhead")
}


@pytest.mark.parametrize("setup", often(SETUPS))
def test_more_time_is_never_worse(setup):
    """On a dense grid of times around a few and many frames: SNR and contrast limits."""
    model, target = SETUPS[setup], star([0.5, 3.5, 6.5])
    times = np.concatenate([np.geomspace(3.0, 3e6, 11), np.linspace(400.0, 420.0, 6)])
    snr, limits = [], []
    for time_s in np.sort(times):
        found = signal_to_noise(model, target, time_s=time_s, contrast=1e-8, **PLACE)
        snr.append([answer.value or 0.0 for answer in found])
        limits.append([answer.value or 1.0 for answer in contrast_limit(model, target, time_s=time_s, **PLACE)])
    assert np.all(np.array(snr[1:]) * ROUNDING >= snr[:-1])
    assert np.all(np.array(limits[1:]) <= np.array(limits[:-1]) * ROUNDING)
    assert np.all(np.array(snr[-1]) > snr[0])


@pytest.mark.parametrize("setup", often(SETUPS))
def test_more_snr_never_takes_less_time(setup):
    model, target = SETUPS[setup], star(3.0)
    times = [
        exposure_time(model, target, snr=float(level), contrast=2e-8, **PLACE)[0].value or math.inf
        for level in np.geomspace(0.01, 100.0, 25)
    ]
    assert np.all(np.array(times[1:]) * ROUNDING >= times[:-1])
    assert math.isfinite(times[0])


@pytest.mark.parametrize("setup", often(SETUPS))
def test_brighter_planets_are_never_harder(setup):
    model, target = SETUPS[setup], star(3.0)
    contrasts = np.geomspace(1e-11, 1e-5, 60)
    many = {"time_s": 5000.0, "separation_arcsec": 0.55, "bands": ["F520"]}
    found = signal_to_noise(model, target, contrast=list(contrasts), **many)
    assert np.all(np.diff([answer.value for answer in found]) > 0)
    times = [
        answer.value or math.inf
        for answer in exposure_time(
            model, target, snr=5.0, contrast=list(contrasts), separation_arcsec=0.55, bands=["F520"]
        )
    ]
    assert np.all(np.array(times[1:]) <= np.array(times[:-1]) * ROUNDING)
    assert math.isinf(times[0]) or setup in ("idealised", "no drift")
    assert math.isfinite(times[-1])


@pytest.mark.parametrize("setup", often(name for name in SETUPS if name != "brighter reference"))
def test_brighter_stars_are_never_harder_until_they_saturate(setup):
    """Same colour, same contrast: more photons of everything. The rule ends where the star fills its pixels."""
    model = SETUPS[setup]
    found = signal_to_noise(model, star(np.linspace(12.0, 4.5, 60)), time_s=5000.0, contrast=1e-8, **PLACE)
    assert all(answer.exposure_limited_by != "pixel_full_well" for answer in found[:40])
    snr = np.array([answer.value for answer in found])
    free = [answer.exposure_limited_by not in ("pixel_full_well", "register_full_well") for answer in found]
    assert np.all((snr[1:] * ROUNDING >= snr[:-1])[np.array(free[1:]) & (setup != "counting")])
    assert snr[-1] > snr[0]


# --- extremes by type

ODD_STARS = {
    "by hand": star([-27.0, 30.0, 4.0, 6.0], [10.0, 10.0, 0.1, 1000.0]),
    "pair": find_target("alf Cen B")[0],
    "pair alone": find_target("alf Cen B", companions="off")[0],
}


@pytest.mark.parametrize(
    ("setup", "name"), [*often(SETUPS, "by hand"), ("default", "pair"), ("counting", "pair alone")]
)
def test_every_star_has_an_answer(setup, name):
    model, target = SETUPS[setup], ODD_STARS[name]
    given = {"separation_arcsec": [0.0, 1e-6, 0.3, 0.42, 0.95, 1.1, 120.0], "bands": ["F520"]}
    for time_s in (1e-3, 4.0, 1e9):
        for question in (signal_to_noise, contrast_limit):
            for answer in question(model, target, time_s=time_s, **given):
                plain(answer)
    for answer in exposure_time(model, target, snr=5.0, **given):
        plain(answer)
    inside = {"separation_arcsec": [0.6] * 5, "contrast": [0, 1, 1e-20, 1e-9, 1e-300], "bands": ["F520"]}
    for asked in ({"snr": 1e-6}, {"snr": 1e6}, {"sigma": 5.0}, {"detect": True}):
        for answer in exposure_time(model, target, **inside, **asked):
            plain(answer)
            if answer.contrast == 0.0:
                assert (answer.status, answer.reason) == (("unreachable", "no_planet_light"))
    for answer in signal_to_noise(model, target, time_s=36000.0, **inside):
        plain(answer)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        (key, value)
        for key in ("contrast", "time_s", "separation_arcsec", "exposure_s", "em_gain")
        for value in (-1, math.nan, math.inf, -math.inf, 1e308, True, np.True_, "1", [[0.5]])
    ],
)
def test_what_is_no_number_in_range_is_refused_in_one_line(refused, key, value):
    given = {"time_s": 3600.0, "separation_arcsec": 0.5, "bands": ["F520"]} | {key: value}
    message = refused("", signal_to_noise, MODEL, TAU_CET, **given)
    assert message.startswith(key)


@pytest.mark.parametrize("value", [0, -1, 1e-7, 1.1e6, math.nan, math.inf, True, None])
def test_levels_out_of_range_are_refused(refused, value):
    for key in ("snr", "sigma"):
        refused("", exposure_time, MODEL, TAU_CET, **{key: value}, **PLACE)
    refused("", contrast_limit, MODEL, TAU_CET, time_s=100.0, snr=5.0, sigma=5.0, **PLACE)
    refused("one of snr, sigma, detect", exposure_time, MODEL, TAU_CET, snr=5.0, detect=True, **PLACE)


def test_numpy_numbers_are_numbers():
    plain_answer = signal_to_noise(MODEL, TAU_CET, time_s=3600.0, contrast=0.25, **PLACE)[0]
    other = signal_to_noise(
        MODEL,
        TAU_CET,
        time_s=np.int64(3600),
        contrast=np.float32(0.25),
        separation_arcsec=np.float64(0.55),
        bands="F520",
    )[0]
    assert other == plain_answer


def test_where_and_why_there_is_no_answer():
    def ask(place, **changes):
        return exposure_time(MODEL, TAU_CET, **{"snr": 5.0, "separation_arcsec": place, "bands": ["F520"]} | changes)[0]

    assert (ask(0.0).status, ask(0.0).reason) == ("outside_field", "inside_inner_edge")
    assert (ask(1.2).status, ask(1.2).reason) == ("outside_field", "outside_outer_edge")
    assert ask(0.55, contrast=1e-12).reason == "common_speckle_floor"
    assert ask(0.55, contrast=1e-9).reason == "speckle_floor"
    bright = exposure_time(MODEL, star(-27.0), snr=5.0, **PLACE)[0]
    assert (bright.status, bright.reason) == ("saturated", "pixel_full_well")
    short = signal_to_noise(MODEL, TAU_CET, time_s=2.0, **PLACE)[0]
    assert (short.status, short.reason) == ("unreachable", "time_below_overheads")
    late = signal_to_noise(SETUPS["overhead"], TAU_CET, time_s=899.0, **PLACE)[0]
    assert (late.status, late.reason) == ("unreachable", "time_below_overheads")
    faint = contrast_limit(MODEL, star(30.0), time_s=3600.0, **PLACE)[0]
    assert (faint.status, faint.reason) == ("unreachable", "insufficient_time")
    ages = exposure_time(SETUPS["no drift"], star(30.0), snr=1e6, contrast=1e-20, **PLACE)[0]
    assert (ages.status, ages.reason) == ("unreachable", "too_many_frames")
    crowded = signal_to_noise(SETUPS["counting"], star(0.0), time_s=3600.0, contrast=0.9, **PLACE)[0]
    assert crowded.status in ("ok", "saturated")
    corner = contrast_limit(MODEL, TAU_CET, time_s=3600.0, separation_arcsec=0.96, bands=["F520"])[0]
    assert corner.status == "ok" or corner.reason in ("too_few_resolution_elements", "outside_outer_edge")


@pytest.mark.parametrize(
    ("name", "question", "excluded"),
    [
        ("tau Cet", {}, True),  # 0.27 Jupiter masses or more at 2 au, where 0.05 are found
        ("tau Cet", {"planet": ReferencePlanet(radius_rjup=0.3)}, False),  # 0.035 Jupiter masses
        ("tau Cet", {"contrast": 1e-8}, False),  # no planet of a radius
        ("alf CMi", {}, False),  # no velocities are counted
    ],
)
def test_planets_that_velocities_exclude_are_flagged(name, question, excluded):
    answer = signal_to_noise(MODEL, find_target(name)[0], time_s=36000.0, **PLACE, **question)[0]
    assert answer.status == "ok"
    assert ("excluded_by_rv" in answer.flags) == excluded


def test_companions_add_light_only_when_on():
    on, off = (
        signal_to_noise(MODEL, ODD_STARS[name], time_s=3600.0, contrast=1e-8, **PLACE)[0]
        for name in ("pair", "pair alone")
    )
    assert on.budget["companion_e2"] > 0 == off.budget["companion_e2"]
    assert on.value < off.value
    assert "companion_light_on" in on.flags
    assert "companion_light_off" in off.flags


@pytest.mark.parametrize(("name", "before", "now"), [("alf Cen B", 23.4, 18.5), ("alf Cen A", 26.4, 26.0)])
def test_alpha_centauri_is_closer_than_it_was(name, before, now):
    """Places of 1991 (19.1 arcsec) and of 2028.5 (10.2 arcsec): that of A at B grows 25 times."""
    plain = {"overhead_s": 0.0, "drift": {"common_fraction": 0.0, "orbital_nm": 0.0}}
    model = build_model(load_instrument(plain), None, ONE)
    asked = {"time_s": 7200.0, "contrast": 2e-8, "separation_arcsec": 0.6, "bands": ["F520"]}
    found = [
        signal_to_noise(model, find_target(name, catalog=table, date_utc="2028-07-01")[0], **asked)[0]
        for table in ("simbad_2012", "snapshot")
    ]
    assert [answer.value for answer in found] == pytest.approx([before, now], abs=0.2)
    light = [answer.budget["companion_e2"] / answer.budget["halo_e2"] for answer in found]
    assert light[1] / light[0] == pytest.approx(25.0, rel=0.1)  # of images: 24.9 and 25.1


def test_order_of_answers():
    stars = STARS.select([3, 1, 2])
    planets = [ReferencePlanet(), ReferencePlanet(radius_rjup=0.5)]
    found = signal_to_noise(MODEL, stars, time_s=3600.0, separation_arcsec=[0.5, 0.6], planet=planets)
    head = [(answer.target, answer.band, answer.separation_arcsec) for answer in found]
    assert head == [(str(name), band, place) for name in stars.name for band in MODEL.bands for place in (0.5, 0.6)]
    alone = signal_to_noise(
        MODEL, stars.select([1]), time_s=3600.0, separation_arcsec=0.6, bands=["F662"], planet=planets[1]
    )[0]
    same = next(
        answer
        for answer in found
        if (answer.target, answer.band, answer.separation_arcsec) == (str(stars.name[1]), "F662", 0.6)
    )
    assert alone.value == pytest.approx(same.value, rel=1e-12)


@pytest.mark.parametrize("level", [{}, {"snr": 5.0}, {"sigma": 4.0}], ids=str)
def test_limits_at_places_of_each_band_are_those_of_the_answers(level):
    places = {"F520": np.array([0.1, 0.4, 0.7]), "F850": np.array([0.6, 0.5, 2.0])}
    model = build_model(INSTRUMENT, None, Strategy())
    found = contrast_limits(model, TAU_CET, places, time_s=7200.0, **level)
    for band, where in places.items():
        rows = contrast_limit(model, TAU_CET, time_s=7200.0, separation_arcsec=where.tolist(), bands=[band], **level)
        told = [math.nan if row.value is None else row.value for row in rows]
        assert np.isfinite(told).any()
        assert np.isnan(told).any()
        np.testing.assert_allclose(found[band], told, rtol=1e-9)
    faint = find_target("HD 88230")[0]
    short = contrast_limits(model, faint, {"F520": np.array([0.5])}, time_s=1.0, **level)
    assert np.isnan(short["F520"]).all()


def test_unlike_lengths_and_nobody_are_refused(refused):
    with pytest.raises(InputError, match="separation_arcsec"):
        signal_to_noise(MODEL, TAU_CET, time_s=100.0, separation_arcsec=[0.5, 0.6], contrast=[1e-9] * 3)
    refused("separation_arcsec", signal_to_noise, MODEL, TAU_CET, time_s=100.0, separation_arcsec=[])
    refused("target", signal_to_noise, MODEL, TAU_CET.select([]), time_s=100.0, separation_arcsec=0.5)
    refused("band = F999", signal_to_noise, MODEL, TAU_CET, time_s=100.0, separation_arcsec=0.5, bands=["F999"])


@settings(max_examples=15)
@given(
    st.floats(-3.0, 15.0),
    st.floats(0.0, 1.3),
    st.floats(-20.0, 0.0),
    st.floats(-3.0, 9.0),
    st.floats(-6.0, 6.0),
    st.sampled_from(sorted(SETUPS)),
)
def test_anything_in_range_is_answered(v_mag, place, log_contrast, log_time, log_snr, setup):
    model, target = SETUPS[setup], star(v_mag)
    given_ = {"separation_arcsec": place, "bands": ["F520"]}
    plain(signal_to_noise(model, target, time_s=10**log_time, contrast=10**log_contrast, **given_)[0])
    plain(exposure_time(model, target, snr=10**log_snr, contrast=10**log_contrast, **given_)[0])
    plain(contrast_limit(model, target, time_s=10**log_time, **given_)[0])


# --- what drift does to long visits


@pytest.mark.parametrize("visit_nm", [0.0, 0.05, 0.1, 0.5])
def test_limits_reach_a_plateau_unless_there_is_no_drift(visit_nm):
    """Contrast limit against time without a walk: the root of time at no drift, else level x floor / core."""
    drift = {"visit_nm": visit_nm, "walk_nm_per_sqrt_hour": 0, "common_fraction": 0, "orbital_nm": 0}
    model = build_model(load_instrument({"overhead_s": 0, "drift": drift}), ["F520"], ONE)
    place, times = 0.65, np.geomspace(1.0, 1e9, 10)  # in long visits a search asks for more
    found = [contrast_limit(model, star(2.0), time_s=float(t), separation_arcsec=place, exact=True)[0] for t in times]
    limits = np.array([answer.value or 1.0 for answer in found])
    if visit_nm == 0.0:
        np.testing.assert_allclose(np.diff(np.log(limits[4:])) / np.diff(np.log(times[4:])), -0.5, atol=0.01)
        return
    metrics = model.metrics["F520"]
    around = place + 1.5 * metrics.lambda_d_arcsec * np.linspace(-1, 1, 41)
    floor = (metrics.rdi_floor(visit_nm, separation_arcsec=around) ** 2).mean() ** 0.5
    plateau = found[-1].level * floor / found[-1].core_throughput
    assert limits[-1] == pytest.approx(plateau, rel=0.10)
    assert limits[-1] / limits[-2] == pytest.approx(1.0, rel=0.01)
    assert limits[-1] < limits[0]


def test_every_answer_names_its_reduction():
    strategy = Strategy(visits=4, library="brighter_twin", reference_visits=9, annulus_lambda_d=2.0)
    (answer,) = signal_to_noise(
        build_model(INSTRUMENT, ["F520"], strategy), TAU_CET, time_s=7200.0, contrast=1e-8, **PLACE
    )
    named = answer.reference_library, answer.reference_visits, answer.n_modes, answer.centring, answer.annulus_lambda_d
    assert named == ("brighter_twin", 9, 0, "temporal", 2.0)
