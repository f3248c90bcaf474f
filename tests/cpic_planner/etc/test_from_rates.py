"""Times from rates, and back."""

import itertools

import numpy as np
import pytest
from mpmath import mp, mpf

import cpic_planner as api
from cpic_planner import CONVENTIONS, InputError, NotOk, Reason, Status, snr_for_rates, time_for_rates


def exact_time(planet, background, snr, floor, a, b):
    """Solve ``SNR^2 ((a P + b B) t + F^2 t^2) = P^2 t^2`` with 60 digits."""
    with mp.workdps(60):
        p, back, s, f = map(mpf, (planet, background, snr, floor))
        return s**2 * (a * p + b * back) / (p**2 - (s * f) ** 2)


@pytest.mark.parametrize("name", CONVENTIONS)
def test_times_are_exact_over_sixty_decades(name):
    """Relative error over the condition number of the equation, which the floor alone makes large."""
    choice = CONVENTIONS[name]
    a, b = int(choice.planet_noise), int(choice.background_noise)
    tried = 0
    for planet, background, snr, share in itertools.product(
        (1e-300, 1e-30, 0.02, 1.0, 1e30), (0.0, 1e-30, 0.3, 1e30), (1e-6, 1.0, 7.0, 1e6), (0.0, 1e-9, 0.5, 1 - 1e-9)
    ):
        floor = share * planet / snr
        if floor > 1e30:
            continue
        exact = exact_time(planet, background, snr, floor, a, b)
        answer = time_for_rates(planet, background, snr=snr, floor_rate=floor, convention=name)
        if exact > mpf(1e308):
            assert answer.reason is Reason.INSUFFICIENT_TIME
            continue
        if 0 < exact < mpf(1e-300):
            continue
        condition = 1.0 / (1.0 - share**2)
        assert abs(mpf(answer.unwrap()) - exact) <= exact * 1e-14 * condition
        tried += 1
    assert tried > 200


@pytest.mark.parametrize("name", CONVENTIONS)
def test_the_ratio_in_that_time_is_the_one_asked_for(name):
    rng = np.random.default_rng(5)
    planet, background, floor = 10.0 ** rng.uniform(-6, 3, (3, 500))
    floor = np.minimum(floor, 0.12 * planet)
    there = time_for_rates(planet, background, snr=7.0, floor_rate=floor, convention=name)
    back = snr_for_rates(planet, background, time_s=there.unwrap(), floor_rate=floor, convention=name)
    np.testing.assert_allclose(back.unwrap(), 7.0, rtol=1e-13)


def test_photon_noise_alone_is_the_square_of_the_ratio():
    """100 counts have an SNR of 10; what is as bright behind them makes it 14.1 times less with an equal reference."""
    assert time_for_rates(1.0, 0.0, snr=10.0, convention="cpic").unwrap() == 100.0
    assert time_for_rates(1.0, 1.0, snr=10.0, convention="cpic").unwrap() == 300.0
    assert time_for_rates(1.0, 1.0, snr=10.0, convention="ebs").unwrap() == 100.0
    assert time_for_rates(1.0, 1.0, snr=10.0, convention={"planet_noise": 2, "background_noise": 0}).unwrap() == 200.0


def test_our_own_noise_model_has_the_same_ratio():
    """Light, references and speckles of a stack, given as rates, where no frame adds anything of its own."""
    from cpic_planner.etc import ApertureRates, FrameCamera, stack_noise
    from simulator.signal import ProgrammeLaw, SpeckleLaw

    planet, background, floor, time_s = 0.03, 0.21, 1e-3, 4000.0
    still, zero = (SpeckleLaw(*map(np.float64, (value, 0.0, 0.0))) for value in (floor**2, 0.0))
    given = dict.fromkeys(ApertureRates.__dataclass_fields__, 0.0) | {
        "planet_e_s": planet,
        "sky_e_s": background,
        "reference_light_e_s": background,
        "aperture_pixels": 1.0,
        "noise_fraction": 1.0,
        "source_noise_fraction": 1.0,
        "background_apertures": np.inf,
        "variance_factor": 1.0,
    }
    numbers = {name: np.float64(value) for name, value in given.items()}
    rates = ApertureRates(**numbers | {"speckle": ProgrammeLaw(still, zero, zero)})
    camera = FrameCamera(
        full_well_e=1e15,
        register_full_well_e=np.inf,
        converter_e=np.inf,
        em_gain_max=1.0,
        blooms=False,
        register_stages=0,
        read_noise_e=0.0,
        rounding_e=0.0,
        cic_e=0.0,
        dark_e_s=0.0,
        readout_s=0.0,
        exposure_min_s=1.0,
        exposure_max_s=time_s,
    )
    ours = float(stack_noise(rates, time_s, 1.0, 1.0, camera).snr)
    said = snr_for_rates(planet, background, floor_rate=floor, time_s=time_s, convention="cpic").unwrap()
    assert said == pytest.approx(ours, rel=1e-12)


def test_answers_are_typed_element_by_element():
    answers = time_for_rates([1.0, 0.0, 1.0], 0.5, snr=[[5.0], [1e3]], floor_rate=0.01, convention="ayo")
    assert answers.shape == (2, 3)
    assert answers[0, 0].unwrap() == answers.value[0, 0] == pytest.approx(25 * 2 / (1 - 0.05**2))
    assert answers.unit == answers[0, 1].unit == "s"
    for place, reason in {(0, 1): Reason.NO_LIGHT, (1, 0): Reason.SPECKLE_FLOOR, (1, 2): Reason.SPECKLE_FLOOR}.items():
        assert (answers[place].status, answers[place].reason) == (Status.UNREACHABLE, reason)
        assert np.isnan(answers.value[place])
    with pytest.raises(NotOk, match=r"element \[0, 1\]: unreachable: no_planet_light"):
        answers.unwrap()


def test_what_has_no_ratio_says_so():
    assert snr_for_rates(0.0, 0.0, time_s=10.0, convention="ebs").unwrap() == 0.0
    answer = snr_for_rates(1.0, 0.0, time_s=10.0, convention="ebs")
    assert (answer.status, answer.reason) == (Status.INVALID, Reason.NO_NOISE)
    assert time_for_rates(1e-300, 1e-3, snr=7.0, convention="ebs").reason is Reason.INSUFFICIENT_TIME


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"planet_rate": -1.0}, r"planet_rate = -1.0 1/s: not accepted; allowed: 0 to 1e\+30"),
        ({"background_rate": [1.0, float("nan")]}, r"background_rate\[1\] = nan"),
        ({"floor_rate": "0.1"}, "floor_rate"),
        ({"snr": 0.0}, "snr = 0.0"),
        ({"snr": True}, "snr = True"),
        ({"planet_rate": [1.0, 2.0], "background_rate": [1.0, 2.0, 3.0]}, "whose shapes broadcast"),
        ({"convention": "ETC"}, "convention = ETC.*cpic, ayo, ebs, exosims, cgi_noise"),
        ({"convention": {"planet_noise": 1.0}}, "convention.background_noise = missing"),
        ({"convention": {"planet_noise": 1.0, "background_noise": -1.0}}, "convention.background_noise = -1.0"),
        ({"convention": {"planet_noise": 1.0, "background_noise": 1.0, "floor": 2}}, "convention.floor = 2"),
    ],
)
def test_refusals(change, match, refused):
    asked = {"planet_rate": 1.0, "background_rate": 1.0, "snr": 5.0, "convention": "cpic"} | change
    refused(match, time_for_rates, asked.pop("planet_rate"), asked.pop("background_rate"), **asked)


def test_equations_in_one_line():
    assert {name: choice.equation for name, choice in CONVENTIONS.items()} == {
        "cpic": "t = SNR^2 (P + 2 B) / (P^2 - (SNR F)^2)",
        "ayo": "t = SNR^2 (P + 2 B) / (P^2 - (SNR F)^2)",
        "ebs": "t = SNR^2 (B) / (P^2 - (SNR F)^2)",
        "exosims": "t = SNR^2 (B) / (P^2 - (SNR F)^2)",
        "cgi_noise": "t = SNR^2 (B) / (P^2 - (SNR F)^2)",
    }
    assert issubclass(InputError, ValueError)
    assert api.time_for_rates is time_for_rates
