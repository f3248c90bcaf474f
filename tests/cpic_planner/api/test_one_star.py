"""Questions without a place, whose light is kept between them, and answers with drawn instruments."""

import pytest

from cpic_planner import contrast_limit, exposure_time, signal_to_noise
from cpic_planner.api import one_star
from cpic_planner.queries import Change, EnsembleChoice, changed, load_ensemble
from simulator.config import load_instrument

ASKED = [
    (exposure_time, {"snr": 5.0}),
    (exposure_time, {"detect": True}),
    (exposure_time, {"sigma": 4.0, "visits": 2}),
    (signal_to_noise, {"time_s": 2e4}),
    (contrast_limit, {"time_s": 2e4}),
]


@pytest.mark.parametrize("bands", [["F662"], ["F520", "F850"]], ids=str)
def test_what_is_kept_of_a_star_answers_every_question_as_if_it_were_the_first(bands):
    """Each after all others, and each alone."""
    later = [ask("tau Cet", bands=bands, **how) for _ in range(2) for ask, how in ASKED][len(ASKED) :]
    for (ask, how), found in zip(ASKED, later, strict=True):
        one_star._on_grids.cache_clear()
        alone = ask("tau Cet", bands=bands, **how)
        assert [one.to_dict() for one in alone] == [one.to_dict() for one in found]


def test_light_along_the_diagonal_is_worked_out_once():
    one_star._on_grids.cache_clear()
    for snr in (3.0, 5.0, 8.0):
        exposure_time("eps Eri", snr=snr, bands="F662")
    assert one_star._on_grids.cache_info().misses == 1
    exposure_time("eps Eri", snr=3.0, bands="F662", planet_radius_rjup=0.5)
    exposure_time("eps Eri", snr=3.0, bands="F662", drift_nm=0.2)
    assert one_star._on_grids.cache_info().misses == 3


def test_an_albedo_whose_file_is_written_anew_is_another_planet(tmp_path):
    """A planet that shines in the blue alone, and one that does in the red alone."""
    file = tmp_path / "albedo.csv"
    one_star._on_grids.cache_clear()
    for misses, (blue, red) in enumerate(((0.5, 0.1), (0.1, 0.5)), start=1):
        rows = (f"{nm},{blue if nm < 600 else red}" for nm in range(400, 1100, 10))
        file.write_text("wavelength_nm,albedo\n" + "\n".join(rows) + "\n")
        answers = exposure_time("tau Cet", snr=5.0, bands=["F520", "F850"], planet={"albedo": str(file)})
        assert (answers[0].contrast > answers[1].contrast) == (blue > red)
        assert one_star._on_grids.cache_info().misses == misses


ENSEMBLE = {
    "numbers": dict.fromkeys(load_ensemble().numbers)
    | {
        "drift": {"label": "drift", "factor": {"law": "log_uniform", "low": 0.5, "high": 2.0}, "source": "test"},
        "detector.cic_e": {"label": "charge", "value": {"law": "uniform", "low": 0.0, "high": 0.2}, "source": "test"},
    }
}


@pytest.mark.parametrize(
    ("ask", "given"),
    [
        (exposure_time, {"snr": 8.0}),
        (exposure_time, {"detect": True, "separation_arcsec": 0.5}),
        (signal_to_noise, {"time_s": 7200.0}),
        (contrast_limit, {"time_s": 7200.0}),
    ],
)
def test_what_instruments_leave_open_is_that_of_each_asked_by_itself(ask, given):
    """Brute force: each drawn instrument as a configuration of its own."""
    given |= {"bands": ["F520"]}
    (row,) = ask("tau Cet", instruments=9, ensemble=ENSEMBLE, seed=3, **given)
    draws = EnsembleChoice(load_ensemble(ENSEMBLE), 9, 3).draws()
    assert sorted(draws) == ["detector.cic_e", "drift"]
    values = []
    for drift, charge in zip(draws["drift"], draws["detector.cic_e"], strict=True):
        other = changed(load_instrument(), [Change.scaling("drift", drift), Change(key="detector.cic_e", value=charge)])
        values += [answer.value for answer in ask("tau Cet", instrument=other, **given)]
    low, median, high = sorted(values)[1], sorted(values)[4], sorted(values)[7]
    found = row.over_instruments
    assert (found.low, found.median, found.high) == pytest.approx((low, median, high), rel=1e-9)
    assert found.answered_share == 1.0
    (plain,) = ask("tau Cet", **given)
    assert plain == row.model_copy(update={"over_instruments": None})


def test_a_time_that_some_instruments_never_reach_has_no_upper_end():
    ensemble = {
        "numbers": dict.fromkeys(load_ensemble().numbers)
        | {"drift": {"label": "drift", "factor": {"law": "log_uniform", "low": 0.1, "high": 1e3}, "source": "test"}}
    }
    where = {"bands": ["F520"], "separation_arcsec": 0.5, "contrast": 3e-9}
    (row,) = exposure_time("tau Cet", detect=True, instruments=8, ensemble=ensemble, **where)
    assert 0.0 < row.over_instruments.answered_share < 0.8
    assert row.over_instruments.high is None
    assert row.over_instruments.low is not None


def test_known_planets_and_several_stars_have_it_too():
    rows = signal_to_noise(["tau Cet", "eps Eri b"], time_s=7200.0, bands=["F520"], instruments=3, ensemble=ENSEMBLE)
    assert [row.target for row in rows] == ["tau Cet", "eps Eri"]
    assert all(row.over_instruments is not None for row in rows)
    assert rows[1].known_planet is not None
