"""Numbers with a unit of astropy are taken wherever a number is, converted, and refused where they do not convert."""

import inspect

import astropy.units as u
import pytest

import catalogs
import cpic_planner as cp
import simulator
from cpic_core import InputError, unit_of

GOOD = {"target": "tau Cet", "snr": 5, "band": "F520", "scene": "paper_example", "name": "tau Cet", "kind": "DARK"}
GOOD |= {"magnitude_v": 5.0, "v_mag": 5.0, "teff_k": 5000.0, "eccentricity": 0.1, "convention": "cpic"}
KEYWORDS = [
    (module.__name__, name, parameter)
    for module in (cp, simulator, catalogs)
    for name in sorted(dir(module))
    if not name.startswith("_") and inspect.isfunction(getattr(module, name))
    for parameter in inspect.signature(getattr(module, name)).parameters
    if unit_of(parameter)
]
"""Every keyword with a unit in its name, of every public function."""


@pytest.mark.parametrize(("module", "name", "keyword"), KEYWORDS)
def test_a_mass_is_refused_by_every_keyword(module, name, keyword):
    function = getattr({"cpic_planner": cp, "simulator": simulator, "catalogs": catalogs}[module], name)
    needed = {
        item.name: GOOD.get(item.name, 1.0)
        for item in inspect.signature(function).parameters.values()
        if item.default is item.empty and item.kind not in (item.VAR_KEYWORD, item.VAR_POSITIONAL)
    }
    with pytest.raises(InputError) as refused:
        function(**needed | {keyword: 3 * u.kg})
    assert str(refused.value).startswith(f"{keyword} = 3")
    assert unit_of(keyword) in str(refused.value) or " only, not for DARK" in str(refused.value)


def told(answers):
    return [answer.model_dump() for answer in answers]


@pytest.mark.parametrize(
    ("given", "plain"),
    [
        ({"time_s": 2 * u.h}, {"time_s": 7200.0}),
        ({"separation_arcsec": 450 * u.mas}, {"separation_arcsec": 0.45}),
        ({"separation_arcsec": [400, 450] * u.mas}, {"separation_arcsec": [0.4, 0.45]}),
        ({"separation_arcsec": [400 * u.mas, 0.45 * u.arcsec]}, {"separation_arcsec": [0.4, 0.45]}),
        ({"separation_arcsec": (400 * u.mas, 0.45)}, {"separation_arcsec": (0.4, 0.45)}),
        ({"semi_major_axis_au": 3 * u.AU}, {"semi_major_axis_au": 3.0}),
        ({"planet": {"radius_rjup": 2 * u.R_jup}}, {"planet": {"radius_rjup": 2.0}}),
        ({"exposure_s": 0.5 * u.min, "time_s": 1 * u.h}, {"exposure_s": 30.0, "time_s": 3600.0}),
        ({"v_mag": 5 * u.mag, "sp_type": "G2V", "distance_pc": 5 * u.pc, "target": "x"},
         {"v_mag": 5.0, "sp_type": "G2V", "distance_pc": 5.0, "target": "x"}),
    ],
    ids=str,
)  # fmt: skip
def test_an_answer_is_that_of_the_plain_number(given, plain):
    shared = {"target": "tau Cet", "bands": ["F520"], "time_s": 3600.0}
    assert told(cp.signal_to_noise(**shared | given)) == told(cp.signal_to_noise(**shared | plain))


def test_rates_take_quantities_too():
    plain = cp.snr_for_rates(2.0, 3.0, time_s=3600.0, convention="cpic").unwrap()
    assert cp.snr_for_rates(2.0 / u.s, 3.0 / u.s, time_s=1 * u.h, convention="cpic").unwrap() == pytest.approx(plain)
