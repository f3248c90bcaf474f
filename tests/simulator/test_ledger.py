import numpy as np
import pytest

from simulator.config import load_instrument, load_scene
from simulator.effects import sky_rate_e_s_arcsec2
from simulator.ledger import EffectRow, camera_ledger, effect_ledger, not_modelled, sky_ledger

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
        ({"drift": {"common_fraction": 0}}, "wavefront common to all science visits", "skipped", "zero"),
        ({"drift": {"visit_nm": 0}}, "wavefront common to all science visits", "skipped", "zero"),
        ({"drift": {"orbital_nm": 0}}, "wavefront around the orbit", "skipped", "zero"),
        ({}, "wavefront around the orbit", "kept", "sine"),
        ({"dark_hole": {"control": "off"}}, STATIC, "kept", "no dark hole"),
        (
            {"dark_hole": {"control": "off"}, "wavefront": {"opd_rms_nm": 0, "amplitude_rms": 0}},
            STATIC,
            "skipped",
            "flat",
        ),
        ("cpic_single_jacobian", STATIC, "kept", "one Jacobian"),
        ("as_published", STATIC, "kept", "errors of probes"),
    ],
)
def test_what_the_instrument_lacks_is_said(instrument, effect, decision, word):
    row = rows(instrument)[effect]
    assert row.decision == decision
    assert word in row.reason


def test_what_the_scene_has_is_said():
    disc = {"kind": "disc", "inner_arcsec": 0.3, "outer_arcsec": 0.5, "contrast": 1e-6}
    found = rows(scene={"extended": [disc], "stars": [STAR | {"name": "t", "separation_arcsec": 3, "pa_deg": 0}]})
    assert found["extended sources"].decision == found["light of companions"].decision == "kept"
    field = STAR | {"name": "t", "separation_arcsec": 3, "pa_deg": 0, "companion": False}
    assert "light of companions" not in rows(scene={"stars": [field]})
    both = [field, field | {"name": "u", "companion": True}]
    assert rows(scene={"stars": both, "companions": "off"})["light of companions"].decision == "skipped"
    assert "brighter" in rows(hole_state="not_reached")[STATIC].reason
    assert rows(scene_model="paper")["source positions"].decision == "skipped"
    assert rows(hole_state="external")[STATIC].decision == "skipped"


def test_switches_of_the_camera_are_rows(refused):
    found = rows({"detector": {"switches": {"cosmic_rays": False}}})
    assert found["cosmic rays"].decision == "skipped"
    assert found["pixel full well"].decision == "kept"
    plain = load_instrument({"detector": {"switches": {"cosmic_rays": False}}})
    assert "cosmic rays: switched off" in not_modelled(plain)
    assert not any(text.startswith("cosmic rays") for text in not_modelled(load_instrument()))
    assert "persistence" in rows(band="F940")
    refused("cosmic_ray", load_instrument, {"detector": {"switches": {"cosmic_ray": False}}})


def test_every_switch_has_a_row_of_its_own():
    config = load_instrument()
    for camera, detector in (("VIS", config.detector), ("NIR", config.near_infrared.detector)):
        found = camera_ledger(config, camera)
        assert len(found) == len(type(detector.switches).model_fields) + 1
        assert len({row.effect for row in found}) == len(found)


def sky(instrument=None, **more):
    return {row.effect: row for row in sky_ledger(load_instrument(instrument), **more)}


def test_the_sky_is_named_as_it_is():
    found = sky({"sky": {"model": "uniform"}})
    assert "21 mag/arcsec2" in found["sky"].reason
    assert found["position-dependent zodiacal light"].decision == "skipped"
    assert found["earthshine"] == EffectRow("earthshine", "skipped", "none given", "earthshine")
    assert found["stray light"].decision == "skipped"
    found = sky()
    assert found["position-dependent zodiacal light"].reason == (
        "by ecliptic latitude, median over the days 50 deg or more from the Sun"
    )
    assert found["earthshine"].reason == "24.3 mag/arcsec2 in V, solar colour"
    nowhere = sky(band="F662", sky=sky_rate_e_s_arcsec2(load_instrument(), "F662"))
    assert "the star has no coordinates" in nowhere["position-dependent zodiacal light"].reason
    dated = load_instrument({"sky": {"season": "date"}})
    rate = sky_rate_e_s_arcsec2(dated, "F662", ra_deg=10.0, dec_deg=20.0, start_utc="2028-04-10")
    found = {row.effect: row for row in sky_ledger(dated, band="F662", sky=rate)}
    assert "21" not in found["sky"].reason.split(",")[0]
    assert "zodiacal" in found["sky"].reason
    assert f"{rate.parts['zodiacal']:.3g} e-/s/arcsec2" in found["sky"].reason
    assert ("lower limit" in found["sky"].reason) == bool(rate.flags)
    assert found["position-dependent zodiacal light"].reason == "by ecliptic position and date"


def test_dust_around_the_star_is_in_scenes_or_said_to_be_missing():
    effect, disc = "exozodiacal light", {"kind": "disc", "inner_arcsec": 0.3, "outer_arcsec": 0.5, "contrast": 1e-6}
    assert rows()[effect] == EffectRow(effect, "skipped", "sky.exozodi_zodis is 0", "exozodi")
    assert f"{effect}: sky.exozodi_zodis is 0" in not_modelled(load_instrument())
    dusty = {"sky": {"exozodi_zodis": 3}}
    assert rows(dusty, scene={"extended": [disc]})[effect].decision == "kept"
    row = rows(dusty)[effect]
    assert row.decision == "skipped"
    assert "predictions count 3 zodis" in row.reason
    # a planner puts the disc into its own scenes
    assert not any(text.startswith(effect) for text in not_modelled(load_instrument(dusty)))


def test_earthshine_and_stray_light_are_named_with_their_size():
    config = load_instrument(
        {"sky": {"earthshine": {"brightness_v_mag_arcsec2": 22.5}, "stray_light": {"rate_e_s": 0.5}}}
    )
    level = sky_rate_e_s_arcsec2(config, "F662")
    found = {row.effect: row for row in sky_ledger(config, band="F662", sky=level)}
    assert found["earthshine"].reason.startswith("22.5 mag/arcsec2")
    assert f"{level.parts['earthshine']:.3g} e-/s/arcsec2" in found["earthshine"].reason
    assert found["stray light"] == EffectRow("stray light", "kept", "0.5 e-/s in every pixel", "stray_light")
    dark = sky({"sky": {"stray_light": {"rate_e_s": 0.0}}})
    assert dark["stray light"].decision == "skipped"
    maps = {"sky": {"stray_light": {"map_file": {"F662": "/far/away/glow.fits"}}}}
    row = sky(maps, band="F662", stray={"stray_light": np.full((3, 4), 0.25)})["stray light"]
    assert row.reason == "from the map glow.fits, 0.25 e-/s a pixel on average"
    assert "by band" in sky(maps)["stray light"].reason


@pytest.mark.parametrize("rays", [{"peak_rate_per_s_cm2": 0}, {"orbit_factor": 0}])
def test_cosmic_rays_without_a_rate_are_skipped(rays):
    for more in ({}, {"start_utc": "2028-01-01"}):
        row = rows({"cosmic_rays": rays}, **more)["cosmic rays"]
        assert (row.decision, row.reason) == ("skipped", "their rate is zero")
    assert "0.832 /s/cm2" in rows(start_utc="2028-01-01")["cosmic rays"].reason


def test_effects_of_no_size_are_skipped_and_name_their_number():
    none = {"detector": {"read_noise_e": 0, "bias_structure": {"drift_adu": 0}, "flaws": {"prnu_rms": 0}}}
    found = rows(none)
    for effect, key in (
        ("read noise", "read_noise_e"),
        ("drift of the bias", "bias_structure.drift_adu"),
        ("flat field", "flaws.prnu_rms"),
    ):
        assert (found[effect].decision, found[effect].reason) == ("skipped", f"{key} is 0")
    late = {"near_infrared": {"detector": {"switches": {"persistence": True}, "persistence": {"fraction": 0}}}}
    assert rows(late, band="F940")["persistence"].reason == "persistence.fraction is 0"
    dark = rows({"detector": {"switches": {"dark": False}}})["structure of the dark current"]
    assert dark.decision == "skipped"


def test_maps_of_the_camera_are_named():
    files = {"flat": "a/f.fits", "dark": "a/d.fits", "cic": "a/c.fits", "bad_columns": "a/b.fits", "bias": "a/z.fits"}
    off = {"stripes": False, "flat": False}
    detector = {"calibration_files": files, "switches": off, "flaws": {"dsnu_rms": 0}, "cic_e": 0}
    found = {row.effect: row for row in camera_ledger(load_instrument({"detector": detector}))}
    assert found["dark current"].reason == found["structure of the dark current"].reason == "from the map d.fits"
    assert found["clock-induced charge"] == EffectRow(
        "clock-induced charge", "kept", "from the map c.fits", "clock_charge"
    )
    assert found["bad columns"].reason == "from the map b.fits"
    assert found["flat field"] == EffectRow("flat field", "skipped", "switched off", "flat")
    # no switch takes the structure off a map of the bias
    assert found["stripes of the bias"].decision == "kept"
    assert "z.fits" in found["stripes of the bias"].reason


def test_what_calibrations_have_no_use_for_is_skipped():
    bias = {row.effect: row for row in camera_ledger(load_instrument(), lit=False, exposure_s=0.0)}
    for effect in ("cosmic rays", "dark current", "photon noise", "frame-transfer smear"):
        assert (bias[effect].decision, bias[effect].reason) == ("skipped", "frames without exposure")
    assert bias["read noise"].decision == "kept"
    dark = {row.effect: row for row in camera_ledger(load_instrument(), lit=False, exposure_s=10.0)}
    assert dark["flat field"].decision == dark["frame-transfer smear"].decision == "skipped"
    assert dark["dark current"].decision == dark["cosmic rays"].decision == "kept"
