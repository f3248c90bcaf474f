import pytest

from catalogs.errors import InputError
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


@pytest.mark.parametrize(
    ("tree", "words"),
    [
        ({"cosmic_rays": {"model": "streaks"}}, ("cosmic_rays.model", "physical")),
        ({"cosmic_rays": {"peak_rate_per_s_cm2": -1}}, ("peak_rate_per_s_cm2 = -1 1/s/cm2", "0 to 1e+06")),
        ({"cosmic_rays": {"cycle_depth": 1.5}}, ("cycle_depth", "0 to 1")),
        ({"cosmic_rays": {"physical": {"depth_um": float("nan")}}}, ("physical.depth_um",)),
        ({"cosmic_rays": {"physical": {"max_length_um": 12}}}, ("max_length_um = 12.0 um", "above depth_um = 14")),
        ({"cosmic_rays": {"paper": {"max_length_um": 100}}}, ("max_length_um = 100.0 um", "above depth_um = 100")),
        ({"cosmic_rays": {"physical": {"mean_loss_e_um": 60}}}, ("physical.loss_width_e_um = 7.0 e-/um", "= 6")),
        ({"cosmic_rays": {"paper": {"tail_index": 2}}}, ("paper.tail_index", "2.5 to 100")),
        ({"cosmic_rays": {"paper": {"texture_waves": 2.5}}}, ("texture_waves",)),
        ({"cosmic_rays": {"template": {"sample_um": 0}}}, ("template.sample_um = 0 um",)),
        ({"cosmic_rays": {"rate": 1}}, ("cosmic_rays.rate", "known keys")),
        ({"sky": {"model": "cloudy"}}, ("sky.model", "zodiacal")),
        ({"sky": {"brightness_v_mag_arcsec2": 50}}, ("sky.brightness_v_mag_arcsec2 = 50 mag/arcsec2", "0 to 40")),
        ({"sky": {"exozodi_zodis": -1}}, ("sky.exozodi_zodis = -1", "0 to 100000")),
        ({"sky": {"exozodi_zodis": float("inf")}}, ("sky.exozodi_zodis",)),
        ({"sky": {"earthshine": {"rate_e_s": -1}}}, ("sky.earthshine.rate_e_s = -1 e-/s",)),
        ({"sky": {"stray_light": {"rate_e_s": 1, "map_file": "a.fits"}}}, ("map_file", "given with rate_e_s")),
        ({"sky": {"stray_light": {"map_file": 3}}}, ("sky.stray_light.map_file",)),
    ],
)
def test_bad_values_are_refused_in_one_line(tree, words):
    with pytest.raises(InputError) as caught:
        load_instrument(tree)
    message = str(caught.value)
    assert all(word in message for word in words), message
    assert "\n" not in message


def test_hash_sees_both_sections():
    default = load_instrument().content_hash
    assert load_instrument({"cosmic_rays": {"model": "paper"}}).content_hash != default
    assert load_instrument({"sky": {"earthshine": {"rate_e_s": 0.1}}}).content_hash != default
    assert load_instrument({"sky": {"exozodi_zodis": 3}}).content_hash != default
