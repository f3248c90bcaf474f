"""Fits of sensitivities to injected planets: truth recovered, and the files of a survey turned into rows."""

import csv

import numpy as np
import pytest

from catalogs import VELOCITY_AXES_AU
from catalogs.velocity_limits import ANNULI_AU
from tools.velocity_limits import EARTHS_IN_MJUP, catalogue_name, fitted, rule_rows, star_row


def injected(n, m50, m90, ceiling, seed=1):
    """Planets of m sin i from 0.01 to 30 M_Jup, and which of them the law finds."""
    random = np.random.default_rng(seed)
    mass = np.exp(random.uniform(np.log(0.01), np.log(30.0), n))
    chance = ceiling / (1.0 + (m50 / mass) ** (np.log(9.0) / np.log(m90 / m50)))
    return mass, (random.random(n) < chance).astype(float)


@pytest.mark.parametrize(("m50", "m90", "ceiling"), [(0.2, 0.3, 1.0), (1.0, 3.0, 0.8), (0.05, 0.06, 0.9)])
def test_the_truth_is_recovered_from_many(m50, m90, ceiling):
    found = fitted(*injected(20000, m50, m90, ceiling))
    assert found.m50_mjup == pytest.approx(m50, rel=0.05)
    assert found.m90_mjup == pytest.approx(m90, rel=0.1)
    assert found.ceiling == pytest.approx(ceiling, abs=0.02)


@pytest.mark.long
def test_a_survey_of_seventy_recovers_the_limit_without_bias():
    fits = [fitted(*injected(70, 0.2, 0.32, 1.0, seed)) for seed in range(40)]
    logs = np.log([fit.m50_mjup / 0.2 for fit in fits])
    assert abs(logs.mean()) < 4.0 * logs.std(ddof=1) / np.sqrt(40)
    assert np.median([fit.m90_mjup / fit.m50_mjup for fit in fits]) == pytest.approx(1.6, rel=0.15)


def test_lost_heavy_planets_lower_the_ceiling_and_not_the_slope():
    """What a search confuses with a known signal is missed at any mass; light planets stay excluded as they are."""
    fit = fitted(*injected(3000, 0.2, 0.3, 0.7, seed=5))
    assert fit.ceiling == pytest.approx(0.7, abs=0.04)
    assert fit.m90_mjup / fit.m50_mjup == pytest.approx(1.5, rel=0.2)


@pytest.mark.parametrize(
    ("survey", "star"), [("10700", "tau Cet"), ("131156", "ksi Boo A"), ("4614", "eta Cas"), ("140538a", "psi Ser")]
)
def test_names_of_the_survey(survey, star):
    assert catalogue_name(survey) == star


@pytest.mark.parametrize("survey", ["4614b", "13612b", "gl412a", "999999", ""])
def test_companions_and_strangers_have_no_name(survey):
    assert catalogue_name(survey) is None


def test_files_become_a_row(tmp_path):
    folder = tmp_path / "completeness" / "recoveries_all"
    folder.mkdir(parents=True)
    random = np.random.default_rng(2)
    mass, found = injected(4000, 0.2, 0.3, 1.0)
    axis = np.exp(random.uniform(np.log(0.3), np.log(16.0), mass.size))
    found[axis > 10.0] = 0.0
    with (folder / "10700_recoveries.csv").open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["inj_au", "inj_msini", "recovered"])
        writer.writerows(zip(axis, mass * EARTHS_IN_MJUP, found == 1.0, strict=True))
    row = star_row(tmp_path, "10700", "tau Cet", {"Nobs": "700", "baseline": "8990.0"})
    assert (row["star"], row["n_velocities"], row["baseline_years"], row["rule"]) == ("tau Cet", "700", "24.6", "")
    for number in range(1, 7):
        assert float(row[f"m50_mjup_{number}"]) == pytest.approx(0.2, rel=0.2)
    assert row["m50_mjup_7"] == row["ceiling_7"] == ""
    assert len(ANNULI_AU) == len(VELOCITY_AXES_AU) + 1
    confused = star_row(tmp_path, "10700", "eps Eri", {"Nobs": "458", "baseline": "11523.0"})
    assert [bool(confused[f"m50_mjup_{number}"]) for number in range(1, 8)] == [True] * 3 + [False] * 4
    assert confused["rule"] == "all"


def test_rules_are_medians_of_amplitudes(tmp_path):
    from catalogs.velocity_limits import LIMITS_FILE, RULES_FILE

    with LIMITS_FILE.open(encoding="utf-8", newline="") as stream:
        made = rule_rows(list(csv.DictReader(stream)))
    with RULES_FILE.open(encoding="utf-8", newline="") as stream:
        assert list(csv.DictReader(stream)) == made
    k50 = {row["rule"]: [float(row[f"k50_m_s_{number}"]) for number in range(1, 8)] for row in made}
    assert np.all(np.array(k50["many"]) < k50["all"])
    assert np.all(np.array(k50["all"]) < k50["few"])
