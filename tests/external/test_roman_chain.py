"""Roman's coronagraph from its tables to a time: against what cgi_noise answers, recorded or in a folder beside us."""

import dataclasses
import json
import os
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from reports.external import comparison
from reports.external.comparisons import cgi_noise
from reports.external.roman_chain import EXPONENTIAL_STAGES, OK, OUTSIDE, REFERENCE_RATIO, Planet, answer, light_of
from reports.external.roman_instrument import calculator_light, from_tables, own_time
from reports.external.roman_tables import Mode, read_mode

HERE = Path(__file__).resolve().parents[3] / "shared" / "validation" / "external"
TABLES = Path(os.environ.get("CGI_NOISE_DATA_DIR", HERE / "cgi_noise_tables"))
GIVEN = TABLES.parent / "cgi_noise_cases.json"
with_tables = pytest.mark.skipif(not TABLES.is_dir(), reason="no tables of cgi_noise; CGI_NOISE_DATA_DIR names them")
RECORDED = comparison.recorded("cgi_noise")
CASES = pytest.mark.parametrize("case", RECORDED["cases"], ids=cgi_noise.words)
MODE = Mode(**RECORDED["modes"][0])


@CASES
def test_rates_and_answers_are_those_of_cgi_noise(case):
    ours = cgi_noise.ours_of(case, RECORDED["modes"])
    assert ours.answer == case["answer"]
    for name, rate in case.get("rates", {}).items():
        assert ours.rates[name] == pytest.approx(rate, rel=3e-4), name
    if case["answer"] == OK:
        assert ours.time_s == pytest.approx(case["time_s"], rel=1e-3)
        assert ours.critical_snr == pytest.approx(case["critical_snr"], rel=1e-9)


@pytest.mark.parametrize("case", [case for case in RECORDED["cases"] if "mode" in case], ids=cgi_noise.words)
def test_light_in_the_calculator_is_that_of_the_products(case):
    mode, planet = Mode(**RECORDED["modes"][case["mode"]]), Planet(**case["planet"])
    ours, plain = (light(mode, case["v_mag"], planet) for light in (calculator_light, light_of))
    assert dataclasses.asdict(ours) == {
        name: pytest.approx(value, rel=1e-12) for name, value in dataclasses.asdict(plain).items()
    }


@with_tables
@CASES
def test_tables_are_read_as_cgi_noise_reads_them(case):
    if not (TABLES / "Scenarios" / f"{case['scenario']}.yml").is_file():
        pytest.skip(f"no tables of {case['scenario']}")
    planet = Planet(**case["planet"])
    mode = read_mode(TABLES, case["scenario"], planet.separation_arcsec)
    if case["answer"] == OUTSIDE:
        assert mode is None
        return
    assert dataclasses.asdict(mode) == pytest.approx(RECORDED["modes"][case["mode"]], rel=1e-12)


@pytest.mark.skipif(not (GIVEN.is_file() and TABLES.is_dir()), reason="no cases of cgi_noise, or no tables of it")
def test_answers_from_the_tables_are_those_that_were_given():
    """The 18 cases beside the tables: their times within 1 %, and every refusal."""
    names = dict(zip(cgi_noise.THEIRS, cgi_noise.VARIANCES, strict=True))
    cases = json.loads(GIVEN.read_text(encoding="utf-8"))
    for case in cases:
        ours = from_tables(TABLES, case["scenario"], v_mag=case["v_mag"], planet=Planet(case["radius_rjup"]))
        assert ours.answer == case["answer"], case
        for name, rate in case.get("noise_variance_e2_s", {}).items():
            assert ours.rates.get(f"var_{names.get(name)}", 0.0) == pytest.approx(rate, rel=1e-3), name
        if "planet_e_s" in case:
            assert ours.rates["planet"] == pytest.approx(case["planet_e_s"], rel=1e-3)
            assert ours.rates["residual"] == pytest.approx(case["speckle_residual_e_s"], rel=1e-3)
        if case["answer"] == OK:
            assert ours.time_s == pytest.approx(case["time_to_snr5_s"], rel=1e-2)
            assert ours.critical_snr == pytest.approx(case["critical_snr"], rel=1e-3)
    assert len(cases) == 18


def test_a_real_register_changes_times_by_less_than_the_models_differ():
    """One electron of a CCD201 with 604 stages passes the threshold 0.4 % more often than an exponential law says."""
    light = light_of(MODE, 5.0, Planet(2.0))
    exponential, real = (answer(MODE, light, stages=stages) for stages in (EXPONENTIAL_STAGES, 604))
    assert real.rates["planet"] / exponential.rates["planet"] == pytest.approx(1.0041, abs=2e-4)
    assert 0.99 < real.time_s / exponential.time_s < 0.995


@pytest.mark.parametrize("index", [0, 1, 6, 12])
def test_own_time_follows_from_the_chance_of_a_count(index):
    """SNR of the inverse of a count's chance, here behind an exponential register: 0.4 % from the real one."""
    case = RECORDED["cases"][index]
    mode, planet, frame_s = Mode(**RECORDED["modes"][case["mode"]]), Planet(**case["planet"]), case["rates"]["frame_s"]
    light, pixels = light_of(mode, case["v_mag"], planet), mode.aperture_pixels
    counted = mode.qe * mode.transfer_efficiency * mode.spectral_share
    dark = mode.dark_e_s * pixels
    x = mode.threshold_sigma * mode.read_noise_e / mode.em_gain

    def variance(rate_e_s):
        mean = rate_e_s * frame_s / pixels + mode.cic_e
        passes = np.concatenate([[0.0], np.cumsum(stats.poisson.pmf(np.arange(30), x))])
        chance, slope = (stats.poisson.pmf(np.arange(30), mean) @ e for e in (passes[:30], np.diff(passes[:31])))
        return pixels * chance * (1.0 - chance) / slope**2

    core = {name: counted * rate for name, rate in light.core.items()}
    star, even = core["speckle"] + core["exozodi"], core["sky"] + core["stray"] + dark
    brighter = light.reference / light.star
    reference = variance(star * brighter + even) / brighter**2 / REFERENCE_RATIO
    white = (variance(core["planet"] + star + even) + reference) / frame_s
    expected = 25.0 * white / (core["planet"] ** 2 - 25.0 * (counted * light.left) ** 2)
    fixed = {"exposure_s": frame_s, "em_gain": mode.em_gain}
    found = own_time(mode, case["v_mag"], planet, same_light=True, snr=5.0, **fixed)
    assert found.integration_s == pytest.approx(expected, rel=2e-2)
