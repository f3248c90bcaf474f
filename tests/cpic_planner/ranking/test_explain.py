"""The explanation of a rank says what the ranking says."""

import math

import pytest

from cpic_core import InputError
from cpic_planner.etc import build_model
from cpic_planner.planets import PopulationChoice
from cpic_planner.queries import Strategy
from cpic_planner.ranking import explain_star, rank_targets
from cpic_planner.ranking.order import RankSetting
from cpic_planner.ranking.sensitivity import ASSUMPTIONS, sensitivity, under_others
from cpic_planner.targets import rank_sample
from simulator.config import load_instrument

MODEL = build_model(load_instrument(), ["F520", "F662"])
STARS = rank_sample(v_mag_max=3.5)
ASKED = {"time_s": 7200.0, "population": PopulationChoice(PopulationChoice.default().config, n_planets=150)}


@pytest.fixture(scope="module")
def rank():
    return rank_targets(MODEL, STARS, **ASKED)


@pytest.mark.parametrize("place", [0, 7, -1])
def test_numbers_are_those_of_the_ranking(rank, place):
    place %= len(rank.targets)
    row = rank.targets[place]
    told = explain_star(MODEL, STARS, row.name, **ASKED)
    assert told.star == row
    assert told.better == (rank.targets[place - 1] if place else None)
    assert told.worse == (rank.targets[place + 1] if place + 1 < len(rank.targets) else None)
    assert (told.n_ranked, told.ranks) == (len(rank.targets), {})
    band = next(item for item in told.bands if item.band == row.band)
    for name in """
        separation_arcsec contrast snr significance threshold detection_margin time_s exposure_s n_frames
        em_gain status contrast_limit visits visit_time_s frames_per_visit detection_probability
    """.split():
        assert getattr(band, name) == getattr(row, name), name
    counted = next(item for item in told.bands if item.band == row.completeness_band)
    assert counted.completeness == row.completeness
    assert counted.completeness_known_place == row.completeness_known_place
    clearest = max(told.bands, key=lambda item: item.contrast / (item.contrast_limit or math.inf))
    assert clearest.band == row.band
    # Two bands may show a bright planet with a chance of one.
    assert max(item.detection_probability for item in told.bands) == pytest.approx(row.detection_probability, rel=1e-9)


def test_budgets_and_reasons_of_each_band(rank):
    for row in rank.targets[:4]:
        told = explain_star(MODEL, STARS, row.name, rank=rank, **ASKED)
        for band in told.bands:
            total = sum(band.budget.values())
            quiet = total - band.budget["planet"] - band.budget["background_mean"]
            assert band.budget[band.dominant] == max(band.budget.values())
            assert (band.snr / band.significance) ** 2 == pytest.approx(quiet / total, rel=1e-9)
            assert (band.status == "ok") == (band.detection_probability >= 0.5 * (1.0 - 1e-9))
            assert 0.0 <= band.completeness <= band.completeness_unconditional <= band.observable <= band.in_zone <= 1.0
            assert set(band.gain_caps) == {"hole", "register_tail", "frame"}


def test_sentences_are_true(rank):
    row = rank.targets[1]
    told = explain_star(MODEL, STARS, row.name, rank=rank, **ASKED)
    band = next(item for item in told.bands if item.band == row.band)
    words = told.sentences
    assert words[0] == f"Rank 2 of {len(rank.targets)} by completeness per hour: {100 * row.score:.3g} %/h."
    assert f"{row.distance_pc:.2f} pc" in words[1]
    best = next(item for item in told.bands if item.band == row.completeness_band)
    assert 0.0 < best.observable < best.in_zone
    assert f"{best.in_zone:.1%} of the population lie in the dark quadrants of {best.band}" in words[1]
    assert f"{best.observable:.1%} with their whole aperture" in words[1]
    assert f"{row.completeness_unconditional:.1%} are detected" in words[1]
    assert words.pop(2).startswith(f"What is known of the star leaves {row.completeness:.1%}: ")
    assert ("is detected" in words[2]) == (row.status == "ok")
    assert f"significance {row.significance:.2f}, threshold {row.threshold:.2f}" in words[2]
    assert band.dominant.replace("_", " ") in words[3]
    assert f"{band.budget[band.dominant] / sum(band.budget.values()):.0%} of the variance" in words[3]
    assert f"by {max(band.remedies.values()):.2f}" in words[4]
    last = explain_star(MODEL, STARS, rank.targets[-1].name, rank=rank, **ASKED)
    assert "is not detected" in last.sentences[2]
    assert f"Observed in {row.visits} visits of {row.visit_time_s / 3600:.2g} h" in told.sentences[-1]


def test_ranks_under_other_assumptions_are_those_of_the_sensitivity(rank):
    best = {row.assumption: row.best for row in sensitivity(MODEL, STARS, **ASKED).rows}
    told = explain_star(MODEL, STARS, rank.targets[0].name, other_assumptions=True, **ASKED)
    assert set(told.ranks) == {item.key for item in ASSUMPTIONS}
    for key, rank in told.ranks.items():
        assert (rank == 1) == (best[key] == told.star.name)
    low, high = min(told.ranks.values()), max(told.ranks.values())
    assert told.sentences[-1] == f"Under the other assumptions it stands between rank {low} and rank {high}."


def test_a_star_without_any_frame():
    told = explain_star(MODEL, STARS, str(STARS.name[0]), **ASKED | {"time_s": 1.0})
    assert told.star.reason == "time_below_overheads"
    assert all(band.n_frames is None and band.budget == {} and band.dominant == "" for band in told.bands)
    assert "cannot be observed" in told.sentences[2]


@pytest.mark.parametrize("strategy", [{"mode": "photon_counting"}, {"library": "roll"}], ids=str)
def test_other_strategies_are_explained(strategy):
    model = build_model(load_instrument(), ["F520"], Strategy(**strategy))
    told = explain_star(model, STARS, str(STARS.name[0]), **ASKED)
    assert told.bands[0].dominant in told.bands[0].budget


def test_strangers_are_refused(refused):
    refused("star = nobody", explain_star, MODEL, STARS, "nobody", **ASKED)
    with pytest.raises(InputError, match="band = F850"):
        explain_star(MODEL, STARS, str(STARS.name[0]), bands=["F850"], **ASKED)


@pytest.mark.long
@pytest.mark.parametrize("place", [0, 5, 10])
def test_one_of_the_first_few_ranks_as_among_all_stars(rank, place):
    name = rank.targets[place].name
    setting, index = RankSetting.of(MODEL, **ASKED), STARS.name.tolist().index(name)
    among_all = {item.key: int(order.rank[index]) for item, order in under_others(setting, STARS)}
    assert max(among_all.values()) > place + 1 or place < 10  # the last of them falls behind its place
    assert explain_star(MODEL, STARS, name, other_assumptions=True, **ASKED).ranks == among_all
