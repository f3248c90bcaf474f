"""Laws of populations against SciPy's and against their densities."""

import mpmath
import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from cpic_planner.planets import chosen_entry
from cpic_planner.planets.population import LAWS, read_law

SHARE = np.array([0.0, 1e-9, 0.01, 0.2, 0.5, 0.77, 0.999, 1.0 - 1e-12])
MIXED = {
    "fixed": {"value": 2.5},
    "uniform": {"low": -3, "high": 4},
    "log_uniform": {"low": 0.5, "high": 10},
    "power_law": {"index": -2.35, "low": 0.1, "high": 100},
    "broken_power_law": {"index_inner": 0.5, "index_outer": -2.5, "turn": 3, "low": 0.5, "high": 30},
    "normal": {"mean": 1, "sd": 0.3, "low": 0.5, "high": 2},
    "rayleigh": {"scale": 0.2, "high": 0.95},
    "beta": {"a": 1.12, "b": 3.09, "high": 0.9},
    "isotropic": {},
    "table": {"values": [3, 1, 2], "weights": [1, 0, 3]},
}


def law(name, **keys):
    return read_law({"law": name, **keys})


@pytest.mark.parametrize("name", LAWS)
def test_every_law_reads_its_own_dump_and_stays_in_its_support(name):
    one = law(name, **MIXED[name])
    assert read_law(one.model_dump(mode="json")) == one
    assert read_law(one) is one
    values = one.quantile(SHARE)
    low, high = one.support
    assert values.shape == SHARE.shape
    assert np.all((values >= low) & (values <= high))
    if name != "table":
        assert np.all(np.diff(values) >= 0)


@pytest.mark.parametrize("index", [-19.0, -3.0, -1.0 - 1e-13, -1.0, -0.999, 0.0, 2.5, 19.0])
@pytest.mark.parametrize(("low", "high"), [(0.5, 10.0), (1e-3, 1e4), (0.999, 1.0)])
def test_power_law_against_forty_digits(index, low, high):
    values = law("power_law", index=index, low=low, high=high).quantile(SHARE)
    with mpmath.workdps(40):
        a, b, power = mpmath.mpf(low), mpmath.mpf(high), mpmath.mpf(index) + 1
        for share, value in zip(SHARE.tolist(), values.tolist(), strict=True):
            u = mpmath.mpf(share)
            exact = a * (b / a) ** u if power == 0 else (a**power + u * (b**power - a**power)) ** (1 / power)
            # Beside an end where the law is thin the share itself decides, to its last digit.
            assert value == pytest.approx(float(exact), rel=1e-12)


def test_named_cases_of_the_power_law():
    flat, even = law("power_law", index=0, low=2, high=5), law("power_law", index=-1, low=2, high=5)
    np.testing.assert_allclose(flat.quantile(SHARE), law("uniform", low=2, high=5).quantile(SHARE), rtol=1e-14)
    np.testing.assert_allclose(even.quantile(SHARE), 2 * 2.5**SHARE, rtol=1e-14)
    np.testing.assert_array_equal(even.quantile(SHARE), law("log_uniform", low=2, high=5).quantile(SHARE))


@pytest.mark.parametrize(("inner", "outer"), [(-0.025, -1.975), (2.0, -3.0), (-1.0, -1.0), (-4.0, 1.0)])
def test_broken_power_law_against_its_density(inner, outer):
    low, turn, high = 0.5, 2.66, 10.0
    one = law("broken_power_law", index_inner=inner, index_outer=outer, turn=turn, low=low, high=high)

    def density(x):
        return (x / turn) ** (inner if x < turn else outer)

    whole = quad(density, low, turn)[0] + quad(density, turn, high)[0]
    for share in (0.003, 0.1, 0.3, 0.5, 0.8, 0.99):
        value = float(one.quantile(np.array([share]))[0])
        below = quad(density, low, value, points=[turn] if value > turn else None)[0]
        assert below / whole == pytest.approx(share, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "keys", "oracle"),
    [
        ("beta", {"a": 1.12, "b": 3.09, "high": 1}, stats.beta(1.12, 3.09)),
        ("rayleigh", {"scale": 0.2, "high": 50}, stats.rayleigh(scale=0.2)),
        ("normal", {"mean": 1, "sd": 0.4, "low": -20, "high": 20}, stats.norm(1, 0.4)),
        ("normal", {"mean": 1, "sd": 0.4, "low": 0.8, "high": 2}, stats.truncnorm(-0.5, 2.5, 1, 0.4)),
        ("normal", {"mean": 0, "sd": 1, "low": 5.5, "high": 9}, stats.truncnorm(5.5, 9)),
        ("uniform", {"low": 2, "high": 7}, stats.uniform(2, 5)),
        ("log_uniform", {"low": 2, "high": 7}, stats.loguniform(2, 7)),
    ],
)
def test_laws_against_scipy(name, keys, oracle):
    share = np.linspace(0.001, 0.999, 301)
    np.testing.assert_allclose(law(name, **keys).quantile(share), oracle.ppf(share), rtol=1e-7)


@pytest.mark.parametrize(
    ("name", "keys", "oracle"),
    [
        ("beta", {"a": 1.12, "b": 3.09, "high": 0.4}, stats.beta(1.12, 3.09)),
        ("rayleigh", {"scale": 0.2, "high": 0.3}, stats.rayleigh(scale=0.2)),
    ],
)
def test_cut_laws_keep_their_shape(name, keys, oracle):
    share = np.linspace(0.001, 0.999, 301)
    expected = oracle.ppf(share * oracle.cdf(keys["high"]))
    np.testing.assert_allclose(law(name, **keys).quantile(share), expected, rtol=1e-10)


def test_isotropic_poles_are_even_on_the_sphere():
    share = np.linspace(0, 1, 1001)
    inclination = law("isotropic").quantile(share)
    np.testing.assert_allclose((1 - np.cos(np.radians(inclination))) / 2, share, rtol=0, atol=1e-15)


def test_table_has_its_weights():
    share = (np.arange(900) + 0.5) / 900
    values, counts = np.unique(law("table", values=[3, 1, 2]).quantile(share), return_counts=True)
    assert (values.tolist(), counts.tolist()) == ([1, 2, 3], [300, 300, 300])
    share = (np.arange(1000) + 0.5) / 1000
    values, counts = np.unique(law("table", values=[3, 1, 2], weights=[1, 0, 3]).quantile(share), return_counts=True)
    assert values.tolist() == [2, 3]
    assert counts.tolist() == [750, 250]
    # A share just below 1 never falls on an entry without weight.
    assert chosen_entry(np.array([np.nextafter(1.0, 0.0)]), (0.1, 0.2, 0.7, 0.0)).tolist() == [2]


def test_short_forms():
    assert read_law(3) == law("fixed", value=3)
    assert read_law("isotropic") == law("isotropic")
