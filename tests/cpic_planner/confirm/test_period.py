"""What the observations of a plan take of the telescope's time."""

import numpy as np
import pytest

from cpic_planner.confirm.plan import with_telescope_time
from cpic_planner.etc import build_model
from cpic_planner.planets import PopulationChoice
from cpic_planner.ranking import rank_targets
from cpic_planner.results import BandConfirmation, ConfirmedTarget
from cpic_planner.survey import Sight
from cpic_planner.targets import find_target
from simulator.config import load_instrument

MODEL = build_model(load_instrument(), ["F520"])
READOUT_S = MODEL.camera("F520").readout_s
FRAME_S = 30.0 + READOUT_S


def sight(fraction=0.4, allowed_h=1e6, window_s=10.5 * FRAME_S, settle_h=1.7):
    return Sight(np.array(fraction), np.array(allowed_h), np.array(window_s), settle_h)


def target(**programme):
    """τ Cet with one band, of the frames that are given, and a detection in 3000 s."""
    small = PopulationChoice(PopulationChoice.default().config, n_planets=50)
    row = rank_targets(MODEL, find_target("tau Cet")[0], time_s=36000.0, population=small).targets[0]
    least = {"detection_time_s": 3000.0, "detection_visits": 2, "exposure_s": 30.0}
    frames = {"exposure_s": 30.0, "n_frames": 100, "time_s": 36000.0, "visits": 5} | programme
    head = {"band": "F520", "status": "ok", "reason": "", "message": "", "separation_arcsec": 0.4, "pa_deg": 315.0}
    band = BandConfirmation(**head, **frames)
    return ConfirmedTarget(
        name=row.name, hip=row.hip, ranked=row.model_copy(update=least), planet_distance_au=1.0, chosen_band="F520",
        bands=[band],
    )  # fmt: skip


def hours(found):
    return found.bands[0].telescope_h, found.detection_telescope_h


def test_frames_fill_the_windows_and_every_visit_slews_twice():
    """Ten whole frames of the 10.5 that fit a window, which is 0.4 of an orbit."""
    found = hours(with_telescope_time(target(), MODEL, {"tau Cet": sight()}))
    filled = 0.4 * 10.0 / 10.5
    assert found == pytest.approx((10.0 / filled + 5 * 2 * 1.7, 3000.0 / 3600.0 / filled + 2 * 2 * 1.7))


@pytest.mark.parametrize(
    "seen",
    [{}, {"eps Eri": sight()}, {"tau Cet": sight(fraction=0.0)}, {"tau Cet": sight(window_s=0.9 * FRAME_S)}],
    ids=["nobody", "another star", "never", "no whole frame"],
)
def test_what_is_not_seen_has_no_telescope_time(seen):
    assert hours(with_telescope_time(target(), MODEL, seen)) == (None, None)


def test_what_does_not_fit_the_period_has_none():
    found = hours(with_telescope_time(target(), MODEL, {"tau Cet": sight(allowed_h=20.0)}))
    assert found[0] is None
    assert found[1] < 20.0


def test_a_band_without_frames_has_none():
    found = hours(with_telescope_time(target(exposure_s=None, time_s=None), MODEL, {"tau Cet": sight()}))
    assert found[0] is None
    assert found[1] > 0.0
