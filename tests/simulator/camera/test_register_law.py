import numpy as np
import pytest

from simulator.camera import gain_variance, stage_probability
from simulator.camera.register_law import MAX_ENTRIES, generating_function, output_cumulants, output_pmf, register_table


@pytest.mark.parametrize("stages", [16, 100, 604])
@pytest.mark.parametrize("gain", [1.001, 2.0, 20.0, 1000.0])
def test_cumulants_against_closed_forms_and_the_law(gain, stages):
    p = float(stage_probability(gain, stages))
    mean, variance, third, fourth, fifth = output_cumulants(p, stages)
    assert mean == pytest.approx(gain, rel=1e-12)
    assert variance == pytest.approx(float(gain_variance(gain, stages)), rel=1e-11)
    size = 1 << int(np.ceil(np.log2(60 * gain + 64)))
    k, law = np.arange(size), output_pmf(1, p, stages, size)
    central = [law @ (k - gain) ** power for power in range(6)]
    # Each probability carries the rounding of all stages, 1e-14.
    noise = [1e-14 * float(size) ** power for power in range(6)]
    assert central[3] == pytest.approx(third, rel=1e-6, abs=noise[3])
    assert central[4] - 3 * central[2] ** 2 == pytest.approx(fourth, rel=1e-5, abs=noise[4])
    assert central[5] - 10 * central[3] * central[2] == pytest.approx(fifth, rel=1e-4, abs=noise[5])


def test_one_stage_is_a_bernoulli_draw():
    law = output_pmf(2, 0.3, 1, 8)
    assert law == pytest.approx([0, 0, 0.49, 0.42, 0.09, 0, 0, 0], abs=1e-15)


@pytest.mark.parametrize("gain", [1.0001, 1.5, 20.0, 300.0, 1e4])
def test_tables_are_distribution_functions_of_bounded_size(gain):
    p = float(stage_probability(gain))
    table = register_table(gain, p, 604)
    assert 1 <= table.n_direct <= 64
    assert table.cdf.size <= MAX_ENTRIES or table.n_direct == 1
    ends = [*table.start[2:], table.cdf.size]
    for n in range(1, table.n_direct + 1):
        function = table.cdf[table.start[n] : ends[n - 1]]
        assert (np.diff(function) >= 0).all()
        assert function[0] == pytest.approx((1 - p) ** (604 * n), rel=1e-9)
        assert function[-1] == 2.0  # whatever the uniform number, the search ends here
        mean = n + np.sum(1 - np.minimum(function[:-1], 1))
        assert mean == pytest.approx(n * gain, rel=1e-9)


def test_the_guide_never_starts_beyond_the_answer():
    p = float(stage_probability(20.0))
    table = register_table(20.0, p, 604)
    for n in (1, 3, table.n_direct):
        function = table.cdf[table.start[n] : table.start[n + 1] if n < table.n_direct else None]
        for u in np.linspace(0, 1, 1001)[:-1]:
            step = table.guide[table.guide_start[n] + int(u * table.guide_size[n])]
            assert step <= np.searchsorted(function, u, side="right")


def test_generating_function_is_the_mean_power_of_the_output():
    p = float(stage_probability(20.0, 604))
    law = output_pmf(1, p, 604, 4096)
    z = np.array([0.9 + 0.1j, 0.99j, -0.5, 1.0])
    expected = (law * z[:, None] ** np.arange(law.size)).sum(axis=1)
    assert generating_function(z, p, 604) == pytest.approx(expected, abs=1e-12)
    assert z[0] == 0.9 + 0.1j  # the argument is left alone
