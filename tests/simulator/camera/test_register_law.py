import numpy as np
import pytest
from scipy.stats import binom, gamma

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


@pytest.mark.parametrize("stages", [16, 100, 604])
def test_tables_against_the_trials_of_every_stage(stages):
    """Charge never falls, so that a matrix of one stage's trials, cut at some output, is exact for all smaller ones."""
    rng, output = np.random.default_rng(stages), np.arange(181)
    for gain in (1.0 + 1e-9, *10 ** rng.uniform(0, (0.1, 0.7, 1.5)), 1e4):
        p = float(stage_probability(gain, stages))
        trials = binom.pmf(output - output[:, None], output[:, None], p)
        law = np.linalg.matrix_power(trials, stages)
        table = register_table(gain, p, stages)
        # A product and a sum per electron and stage, whose errors add up over the transform (Cauchy-Schwarz).
        rounding = 2 * 2.0**-52 * np.sqrt(table.cdf.size - table.start[-1])
        for n in range(1, table.n_direct + 1):
            end = table.start[n + 1] if n < table.n_direct else table.cdf.size
            tabulated = table.cdf[table.start[n] : end - 1][: law[n, n:].size]
            assert np.abs(tabulated - np.cumsum(law[n, n:])[: tabulated.size]).max() < n * stages * rounding


@pytest.mark.parametrize("stages", [16, 604])
def test_tables_reach_to_where_nothing_is_left(stages):
    """A sum of ``n`` exponentials exceeds ``n + sqrt(2 n t) + t`` with a chance below ``exp(-t)``; 32 outputs more."""
    rng = np.random.default_rng(8)
    # At 2.49 the outputs of the last table are just too many for a transform of 512.
    for gain in (2.49, *10 ** rng.uniform(0, 1.3, 60 if stages == 16 else 6)):
        table = register_table(gain, float(stage_probability(gain, stages)), stages)
        assert table.n_direct == 64
        n = np.arange(1, 65)
        lengths = np.diff([*table.start[1:], table.cdf.size])
        assert (lengths == np.floor(gain * (n + 6 * np.sqrt(2 * n) + 36)) + 32).all()
        assert gamma.sf(lengths / gain, n).max() < np.exp(-36)
        last = table.start[1:] + lengths - 1
        assert (table.cdf[last] == 2.0).all()
        # No probability is above 1, and only the rounding of all stages is missing.
        assert table.cdf[last - 1].max() <= 1.0
        assert table.cdf[last - 1].min() > 1 - 1e-10


@pytest.mark.parametrize(("gain", "n_direct"), [(1.0001, 64), (20.0, 64), (300.0, 20), (1000.0, 7), (1e4, 1)])
def test_electrons_with_a_table_of_their_own(gain, n_direct):
    table = register_table(gain, float(stage_probability(gain)), 604)
    assert table.n_direct == n_direct
    assert table.start.size == table.guide_start.size == table.guide_size.size == n_direct + 1
    assert table.guide_size[0] == table.start[0] == table.guide_start[0] == 0
    lengths = np.diff([*table.start[1:], table.cdf.size])
    # One step of the guide for two to four entries, and guides that lie one after the other.
    assert ((table.guide_size[1:] <= lengths / 2) & (table.guide_size[1:] >= lengths / 4)).all()
    assert (np.diff([*table.guide_start[1:], table.guide.size]) == table.guide_size[1:]).all()


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
