"""Stages of a plan: one target in one band, and its pictures."""

from dataclasses import replace

import numpy as np
import pytest

from cpic_planner.confirm import make_plan
from cpic_planner.etc import build_model
from cpic_planner.queries import PlanQuestion
from cpic_planner.ranking import rank_targets
from cpic_planner.report.image_figures import Mark, Panels, PanelSheet
from cpic_planner.report.ranking_figures import contrast_diagram, margin_figure, sky_map
from cpic_planner.targets import rank_sample
from simulator import load_instrument
from simulator.imaging import HoleZone

STARS = """name,v_mag,sp_type,teff_k,log_g,metallicity,distance_pc,luminosity_lsun,ra_deg,dec_deg
first,3.73,K2V,5080,4.6,-0.1,3.2,0.34,53.2,-9.5
second,3.5,G8V,5283,4.5,-0.5,3.65,0.5,26.0,-15.9
"""
INSTRUMENT = load_instrument()


@pytest.fixture(scope="module")
def stars(tmp_path_factory):
    path = tmp_path_factory.mktemp("stars") / "stars.csv"
    path.write_text(STARS)
    return path


def test_a_plan_of_one_target(timed, stars, tmp_path):
    config = PlanQuestion(instrument=INSTRUMENT, top=1, bands=("F662",), time_s=7200.0, n_planets=2000)
    finished = timed(
        "plan: one target, one band, standard",
        lambda: make_plan(config, tmp_path / "plan", catalog=stars, force=True),
        rounds=1,
    )
    (target,) = finished.result.targets
    assert target.bands[0].status == "ok"


def test_figures_of_the_catalogue(timed):
    ranked = rank_targets(build_model(INSTRUMENT), rank_sample(), time_s=7200.0)
    drawn = timed(
        "plan: figures of the catalogue",
        lambda: [draw(ranked) for draw in (sky_map, contrast_diagram, margin_figure)],
        rounds=3,
    )
    assert all(picture.uri.startswith("data:image/svg") for picture in drawn)


def test_picture_of_three_panels(timed):
    rng = np.random.default_rng(1)
    images = rng.normal(1000.0, 30.0, (3, 137, 137))
    panels = Panels("F662", *images, 0.016153, 0.0375, HoleZone(0.18, 0.707), marks=(Mark(0.35, 0.35),))
    sheet = PanelSheet()
    turned = iter(np.linspace(0.0, 90.0, 100))
    picture = timed(
        "plan: picture of three panels", lambda: sheet.picture(replace(panels, roll_deg=float(next(turned))), "a star")
    )
    assert picture.uri.startswith("data:image/png")
