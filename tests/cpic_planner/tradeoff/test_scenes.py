import pytest

from cpic_planner.tradeoff.scenes import PLANET, SCENES, fixed_scene
from simulator.imaging import psf_metrics
from simulator.target import scene_sources

CONTRASTS = {"faint": 4e-8, "saturating": 1e-8, "binary": 1e-7, "edge": 4e-8, "field": 5e-8, "paper": 2e-8}


def test_every_kind_of_scene_is_there():
    single = [name for name, case in SCENES.items() if not case.is_programme]
    assert single == ["faint", "saturating", "binary", "edge", "field", "infrared", "paper"]
    assert {name for name, case in SCENES.items() if case.scene_model == "paper"} == {"paper"}
    cameras = {name: case.instrument.band(case.band).camera for name, case in SCENES.items()}
    assert {name for name, camera in cameras.items() if camera == "NIR"} == {"infrared"}
    assert len(SCENES["field"].scene.stars) == 300
    assert len(SCENES["binary"].scene.stars) == 1


def test_programmes_pair_visits_and_modes():
    programmes = [case for case in SCENES.values() if case.is_programme]
    made = {(case.visits, case.how.references_of(case.visits), case.how.n_modes) for case in programmes}
    assert {(1, 1, 0), (4, 4, 0), (16, 16, 0)} < made
    assert {(4, 16, 4), (4, 16, 12), (16, 16, 4), (16, 16, 12)} < made
    assert SCENES["rolls_4"].how.library == "roll"


@pytest.mark.parametrize("name", CONTRASTS)
def test_the_planet_lies_in_the_hole_with_the_contrast_it_was_given(name):
    case = SCENES[name]
    planets = [source for source in scene_sources(case.scene, case.instrument, case.band) if source.kind == "planet"]
    assert [planet.name for planet in planets] == [PLANET]
    assert planets[0].contrast == pytest.approx(CONTRASTS[name], rel=2e-3)  # the albedo is not quite grey in a band
    metrics = psf_metrics(case.instrument, case.band)
    radius = metrics.aperture_radius_arcsec
    x, y = abs(planets[0].x_arcsec), abs(planets[0].y_arcsec)
    assert max(x, y) + radius < metrics.hole_outer_arcsec
    assert min(x, y) > metrics.hole_inner_arcsec
    if name == "edge":
        assert min(x, y) - radius < metrics.hole_inner_arcsec + 0.01


def test_no_other_scene(refused):
    refused(r"--scene = nebula: not accepted; allowed: faint, saturating", fixed_scene, "nebula")
