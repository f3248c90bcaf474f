import pytest

from catalogs.errors import InputError
from simulator.config import load_instrument, load_scene
from simulator.ledger import effect_ledger, not_modelled

STAR = {"name": "s", "v_mag": 5.0, "teff_k": 5800}
STATIC = "static wavefront error and deformable mirror"


def rows(instrument=None, scene=None, **more):
    found = effect_ledger(load_scene({"name": "s", "cstar": STAR} | (scene or {})), load_instrument(instrument), **more)
    assert len({row.effect for row in found}) == len(found)
    assert all(row.reason for row in found)
    return {row.effect: row for row in found}


def test_default_keeps_the_optics():
    found = rows()
    for effect in (STATIC, "pointing jitter", "wavefront drift"):
        assert found[effect].decision == "kept"
        assert not any(text.startswith(effect) for text in not_modelled(load_instrument()))


@pytest.mark.parametrize(
    ("instrument", "effect", "decision", "word"),
    [
        ({"wavefront": {"jitter_mas": 0}}, "pointing jitter", "skipped", "zero"),
        ({"drift": {"visit_nm": 0, "walk_nm_per_sqrt_hour": 0}}, "wavefront drift", "skipped", "zero"),
        ({"dark_hole": {"control": "off"}}, STATIC, "kept", "no dark hole"),
        ({"dark_hole": {"control": "off"}, "wavefront": {"opd_rms_nm": 0, "amplitude_rms": 0}}, STATIC, "skipped",
         "flat"),
        ("cpic_single_jacobian", STATIC, "kept", "one Jacobian"),
    ],
)  # fmt: skip
def test_what_the_instrument_lacks_is_said(instrument, effect, decision, word):
    row = rows(instrument)[effect]
    assert row.decision == decision
    assert word in row.reason


def test_what_the_scene_has_is_said():
    disc = {"kind": "disc", "inner_arcsec": 0.3, "outer_arcsec": 0.5, "contrast": 1e-6}
    found = rows(scene={"extended": [disc], "stars": [STAR | {"name": "t", "separation_arcsec": 3, "pa_deg": 0}]})
    assert found["extended sources"].decision == found["light of companions"].decision == "kept"
    assert "brighter" in rows(hole_state="not_reached")[STATIC].reason
    assert rows(scene_model="paper")["source positions"].decision == "skipped"
    assert rows(hole_state="external")[STATIC].decision == "skipped"


def test_switches_of_the_camera_are_rows():
    found = rows({"detector": {"switches": {"cosmic_rays": False}}})
    assert found["cosmic rays"].decision == "skipped"
    assert found["pixel full well"].decision == "kept"
    plain = load_instrument({"detector": {"switches": {"cosmic_rays": False}}})
    assert "cosmic rays: switched off" in not_modelled(plain)
    assert not any(text.startswith("cosmic rays") for text in not_modelled(load_instrument()))
    assert "persistence" in rows(band="F940")
    with pytest.raises(InputError, match="cosmic_ray"):
        load_instrument({"detector": {"switches": {"cosmic_ray": False}}})
