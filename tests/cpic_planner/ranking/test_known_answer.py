"""Scenes of known planets: what the sources of the simulator have is what the ranking counts."""

import numpy as np
import pytest

from catalogs import load_known_planets
from cpic_planner.etc import build_model, questions
from cpic_planner.queries import ReferencePlanet
from cpic_planner.ranking import KnownChoice, known_scene
from cpic_planner.ranking.known_answer import planets_contrast
from cpic_planner.targets import find_target
from simulator import load_instrument, load_scene, spectrum_generator
from simulator.config import albedo_spec

MJD = 64022.0


def choice(**more):
    return KnownChoice(load_known_planets(), "2034-03-01T00:00:00", MJD, albedo_spec("jupiter"), 50, **more)


def test_the_scene_holds_the_draw_that_is_counted():
    star = find_target("eps Eri")[0]
    for number in (0, 7):
        scene = load_scene(known_scene("HD 22049", choice(), draw=number))
        (planet,), counted = scene.planets, choice().draw(star).planets[0][0]
        assert (scene.cstar.name, planet.name) == ("eps Eri", "eps Eri b")
        assert planet.phase_deg == pytest.approx(counted.phase_deg[number], abs=1e-12)
        assert planet.distance_au == pytest.approx(counted.distance_au[number], rel=1e-12)
        assert planet.radius_rjup == counted.radius_rjup[number]
        pa = np.rad2deg(np.arctan2(counted.east_au[number], counted.north_au[number])) % 360.0
        assert planet.pa_deg == pytest.approx(pa)
        rho = np.hypot(counted.east_au[number], counted.north_au[number]) / star.distance_pc[0]
        assert planet.separation_arcsec == pytest.approx(rho, rel=1e-12)


def test_it_is_simulated_like_any_planet():
    """Position and contrast of the simulator's source equal those that completeness takes."""
    scene = load_scene(known_scene("eps Eri", choice()))
    model, star = build_model(load_instrument(), bands=("F662",)), find_target("eps Eri")[0]
    planets = choice().draw(star).planets[0][0]
    sources = spectrum_generator(scene)
    source = next(item for item in sources if item.kind == "planet")
    per_arcsec = star.distance_pc[0]
    assert -source.x_arcsec == pytest.approx(planets.east_au[0] / per_arcsec, rel=1e-9)
    assert source.y_arcsec == pytest.approx(planets.north_au[0] / per_arcsec, rel=1e-9)
    expected = planets_contrast(model, star, "F662", planets, albedo_spec("jupiter"))[0]
    reference = ReferencePlanet(radius_rjup=planets.radius_rjup[0], phase_deg=planets.phase_deg[0])
    separation = float(np.hypot(source.x_arcsec, source.y_arcsec))
    answer = questions.signal_to_noise(model, star, time_s=3600.0, separation_arcsec=separation, planet=reference)[0]
    assert answer.contrast == pytest.approx(expected, rel=1e-6)


def test_all_planets_of_a_star_and_its_companion():
    scene = load_scene(known_scene("55 Cnc", choice()))
    assert [planet.name for planet in scene.planets] == [f"rho1 Cnc {letter}" for letter in "bcdef"]
    assert scene.stars == ()
    pair = load_scene(known_scene("16 Cyg B", choice()))
    assert [planet.name for planet in pair.planets] == ["16 Cyg B b"]
    # 39.45 arcsec in 1991 (Hipparcos), growing by 15 mas a year: the orbit of Marcy et al. 1999, at the date.
    assert pair.stars[0].separation_arcsec == pytest.approx(39.97, abs=0.03)


def test_planets_beyond_the_field_are_left_out(tmp_path):
    path = tmp_path / "far.csv"
    path.write_text(
        "star,planet,a,e,mass,inclination,star_mass\neps Eri,far,1000,0,1,0,0.8\neps Eri,near,1,0,1,0,0.8\n"
    )
    far = KnownChoice(load_known_planets(f"none+{path}"), "2034-03-01T00:00:00", MJD, albedo_spec("jupiter"), 5)
    assert [planet["name"] for planet in known_scene("eps Eri", far)["planets"]] == ["near"]


def test_refuted_planets_are_in_no_scene(refused):
    assert [planet["name"][-1] for planet in known_scene("tau Cet", choice())["planets"]] == ["f", "g", "h"]
    refused("known planets", known_scene, "omi2 Eri", choice())


def test_refusals(refused):
    refused("known planets", known_scene, "Procyon", choice())
    refused("draw", known_scene, "eps Eri", choice(), draw=50)
