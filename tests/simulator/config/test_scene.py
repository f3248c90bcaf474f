import pytest

from catalogs.errors import InputError
from simulator.config import load_scene

STAR = {"name": "star", "v_mag": 1.35, "teff_k": 5230}
PLANET = {
    "name": "b",
    "radius_rjup": 1,
    "distance_au": 0.8775,
    "phase_deg": 90,
    "separation_arcsec": 0.65,
    "pa_deg": 315,
}


def test_planet_and_planets_mean_the_same():
    one = load_scene({"name": "s", "cstar": STAR, "planet": PLANET})
    many = load_scene({"name": "s", "cstar": STAR, "planets": [PLANET]})
    assert one == many
    assert one.content_hash == many.content_hash
    assert one.without_planets().planets == ()


def test_yaml_file(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text("name: s\ncstar: {name: a, v_mag: 5, teff_k: 5800}\ncompanions: off\n")
    assert load_scene(path).companions == "off"


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"planet": PLANET | {"phase_deg": 181}}, "phase_deg = 181 deg"),
        ({"planet": PLANET | {"mass": 1}}, "mass"),
        ({"planet": PLANET, "planets": [PLANET]}, "given with planets"),
        ({"cstar": {"name": "x"}}, "v_mag"),
        ({"companions": "maybe"}, "companions"),
    ],
)
def test_bad_scenes_are_refused(change, word):
    with pytest.raises(InputError, match=word):
        load_scene({"name": "s", "cstar": STAR} | change)
