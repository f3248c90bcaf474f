from simulator.config import load_instrument


def test_defaults():
    instrument = load_instrument()
    assert instrument.cosmic_rays.model == "physical"
    assert instrument.sky.model == "uniform"
    assert instrument.sky.brightness_v_mag_arcsec2 == 21.0
    assert instrument.sky.exozodi_zodis == 0.0
    assert instrument.provenance["sky.exozodi_zodis"].confidence == "A"
    assert instrument.sky.earthshine.map_of("F520") is None
    assert instrument.cosmic_rays.paper.depth_um == 100.0
    assert instrument.cosmic_rays.paper.mean_charge_e == 2700.0
    assert instrument.provenance["cosmic_rays.peak_rate_per_s_cm2"].confidence == "P"


def test_hash_sees_both_sections():
    default = load_instrument().content_hash
    assert load_instrument({"cosmic_rays": {"model": "paper"}}).content_hash != default
    assert load_instrument({"sky": {"earthshine": {"rate_e_s": 0.1}}}).content_hash != default
    assert load_instrument({"sky": {"exozodi_zodis": 3}}).content_hash != default
