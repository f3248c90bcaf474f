"""Questions without a place: the light along the diagonal that is kept between them."""

import pytest

from cpic_planner import contrast_limit, exposure_time, signal_to_noise
from cpic_planner.api import one_star

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
