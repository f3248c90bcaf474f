import math
import pickle

import pytest
from pydantic import ValidationError

from simulator.config import canonical_json, checked_utc, content_hash, load_instrument
from simulator.config.instrument import DarkHoleConfig, MirrorConfig, WavefrontConfig


def test_default_states_source_and_confidence_of_every_number():
    instrument = load_instrument()
    values = instrument.model_dump()

    def leaves(tree, path=""):
        for key, item in tree.items():
            here = f"{path}.{key}" if path else key
            if isinstance(item, dict):
                yield from leaves(item, here)
            elif isinstance(item, int | float) and not isinstance(item, bool):
                yield here

    provenance = instrument.provenance
    missing = [path for path in leaves(values) if not provenance.get(path) or not provenance[path].source]
    assert missing == []
    assert {item.confidence for item in provenance.values()} <= {"P", "I", "A"}


def test_geometry_of_the_default_instrument():
    instrument = load_instrument()
    assert instrument.telescope.area_cm2 == pytest.approx(31415.93, abs=0.01)
    assert instrument.lambda_d_arcsec("F520") == pytest.approx(0.0536, abs=5e-5)
    inner = {band: instrument.hole_inner_arcsec(band) * math.sqrt(2) for band in instrument.visible_bands()}
    assert {k: round(v, 3) for k, v in inner.items()} == {"F520": 0.231, "F662": 0.294, "F720": 0.319, "F850": 0.377}
    assert instrument.visible_bands() == ("F520", "F662", "F720", "F850")


def test_user_file_holds_only_what_differs(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("detector: {read_noise_e: 160}\nbands: {F520: {width_nm: 25}}\n")
    mine, default = load_instrument(path), load_instrument()
    assert mine.detector.read_noise_e == 160
    assert mine.bands["F520"].width_nm == 25
    assert mine.bands["F520"].qe == default.bands["F520"].qe
    assert mine.content_hash != default.content_hash
    assert mine.provenance["detector.read_noise_e"].source == "user"
    assert mine.provenance["detector.full_well_e"] == default.provenance["detector.full_well_e"]


def test_configuration_is_frozen():
    instrument = load_instrument()
    with pytest.raises(ValidationError):
        instrument.detector.read_noise_e = 1.0


def test_an_instrument_travels_to_another_process_as_it_is():
    instrument = load_instrument()
    arrived = pickle.loads(pickle.dumps(instrument))
    assert arrived == instrument
    assert type(arrived.detector.switches) is type(instrument.detector.switches)


def test_hash_depends_on_content_only():
    assert content_hash({"a": 1, "b": [2.0, 3]}) == content_hash({"b": [2, 3.0], "a": 1.0})
    assert content_hash({"a": 1}) != content_hash({"a": 1.0000000001})
    assert canonical_json({"x": 1e300, "y": 0.1}) == '{"x":1e+300,"y":0.1}'
    assert (
        load_instrument().content_hash == load_instrument({}).model_copy(update={"name": "cpic_default"}).content_hash
    )


def test_files_beside_the_instruments_file_are_found(tmp_path, monkeypatch):
    import numpy as np

    from cpic_core import write_npz
    from simulator.imaging.pupil import load_apodizer

    folder = tmp_path / "mine"
    folder.mkdir()
    write_npz(folder / "mask.npz", {"transmission": np.ones((64, 64))})
    (folder / "curve.txt").write_text("# nm\n500 0.8\n540 0.8\n")
    (folder / "mine.yaml").write_text(
        "kind: instrument\ncoronagraph: {apodizer: {value: mask.npz, source: laboratory, confidence: A}}\n"
        "bands: {F520: {transmission_file: curve.txt}}\n"
    )
    monkeypatch.chdir(tmp_path)
    instrument = load_instrument("mine/mine.yaml")
    assert load_apodizer(instrument.coronagraph.apodizer).shape == (64, 64)
    assert instrument.bands["F520"].transmission_file == str(folder.relative_to(tmp_path) / "curve.txt")
    assert load_instrument().coronagraph.apodizer == "lpx43"


def test_the_instrument_of_table_1_states_its_numbers():
    stated, default = load_instrument("paper_table1"), load_instrument()
    assert stated.name == "paper_table1"
    visible = [stated.bands[band] for band in stated.visible_bands()]
    assert [band.width_nm for band in visible] == [50, 55, 20, 25]
    assert {band.t_opt for band in visible} == {0.19}
    assert stated.detector.read_noise_e == 100
    assert stated.coronagraph.aperture_radius_lambda_d == 0.7
    keys = [f"bands.{band}.{key}" for band in stated.visible_bands() for key in ("width_nm", "t_opt")]
    for key in (*keys, "detector.read_noise_e", "coronagraph.aperture_radius_lambda_d"):
        assert stated.provenance[key].source not in ("", "user")
        assert stated.provenance[key].confidence in "PIA"
        if key != "coronagraph.aperture_radius_lambda_d" and not key.endswith("t_opt"):
            assert stated.provenance[key] != default.provenance[key]
    # nothing else but the paper's sky, what it leaves out of the drift and the time between visits differs, so that the
    # optics are the shipped ones
    sky, drift = {"model": "uniform"}, {"common_fraction": 0.0, "orbital_nm": 0.0}
    same = default.changed({"detector": {"read_noise_e": 100.0}, "sky": sky, "drift": drift, "overhead_s": 0.0})
    assert same.model_copy(update={"name": "paper_table1"}).content_hash == stated.content_hash


def test_the_optics_of_table_1_are_the_shipped_ones():
    from simulator.imaging import metrics_key

    for band in load_instrument().visible_bands():
        assert metrics_key(load_instrument("paper_table1"), band) == metrics_key(load_instrument(), band)


def test_inner_edge_by_band_replaces_the_one_in_lambda_d(refused):
    instrument = load_instrument({"coronagraph": {"inner_arcsec": {"F662": 0.25}}})
    assert instrument.hole_inner_arcsec("F662") * math.sqrt(2) == pytest.approx(0.25)
    assert instrument.hole_inner_arcsec("F720") == load_instrument().hole_inner_arcsec("F720")
    refused(r"outer_half_side_arcsec.*hole of F662", load_instrument, {"coronagraph": {"inner_arcsec": {"F662": 0.95}}})


@pytest.mark.parametrize("band", ["F940", "F1265", "F1425", "F1542"])
def test_the_near_infrared_channel_has_its_own_geometry(band):
    instrument = load_instrument({"near_infrared": {"pixel_scale_arcsec": 0.03, "mask_half_width_arcsec": 0.2}})
    assert instrument.pixel_scale_arcsec(band) == 0.03
    assert instrument.mask_half_width_arcsec(band) == 0.2
    assert instrument.hole_outer_arcsec(band) == 1.2
    assert instrument.pixel_scale_arcsec("F850") == 0.016153
    assert instrument.mask_half_width_arcsec("F850") == 0.155


@pytest.mark.parametrize(
    ("preset", "control", "mode", "inner"),
    [
        ("cpic_default", "conjugation", "4q", (0.231, 0.294, 0.319, 0.377)),
        ("cpic_2q", "conjugation", "2q", (0.19, 0.21, 0.23, 0.27)),
        ("cpic_single_jacobian", "single_jacobian", "4q", (0.231, 0.294, 0.319, 0.377)),
        ("as_published", "conjugation", "4q", (0.231, 0.294, 0.319, 0.377)),
    ],
)
def test_shipped_instruments(preset, control, mode, inner):
    instrument = load_instrument(preset)
    assert instrument.name == preset
    assert (instrument.dark_hole.control, instrument.dark_hole.mode) == (control, mode)
    corners = [instrument.hole_inner_arcsec(band) * math.sqrt(2) for band in instrument.visible_bands()]
    assert corners == pytest.approx(inner, abs=5e-4)
    for band in instrument.bands:  # the cross hides nothing of the hole
        assert instrument.mask_half_width_arcsec(band) <= instrument.hole_inner_arcsec(band) + 1e-3
    for key in ("wavefront.opd_rms_nm", "mirror.n_actuators", "dark_hole.control", "coronagraph.apodizer"):
        assert instrument.provenance[key].source
        assert instrument.provenance[key].confidence == "A"


def test_a_band_has_its_own_error_of_sensing_or_that_of_all():
    own = {"sensing": "probes", "sensing_contrast": 2e-8, "sensing_contrast_by_band": {"F720": 5e-8}}
    hole = load_instrument({"dark_hole": own}).dark_hole
    assert (hole.sensing_contrast_of("F720"), hole.sensing_contrast_of("F520")) == (5e-8, 2e-8)
    assert load_instrument().dark_hole.sensing_contrast_of("F720") == 0


def test_published_is_the_default_but_for_sensing():
    published, default = load_instrument("as_published"), load_instrument()
    sensed = [band for band in published.bands if published.dark_hole.sensing_contrast_of(band) > 0]
    assert tuple(sensed) == published.visible_bands()
    keys = {name for name, value in published.dark_hole if value != getattr(default.dark_hole, name)}
    assert keys == {"sensing", "sensing_contrast_by_band"}
    for section in set(type(default).model_fields) - {"name", "dark_hole"}:
        assert getattr(published, section) == getattr(default, section), section


def test_perfect_is_without_aberrations():
    values = load_instrument().wavefront.model_dump()
    assert not WavefrontConfig(**values).perfect
    assert not WavefrontConfig(**values | {"opd_rms_nm": 0}).perfect
    assert not WavefrontConfig(**values | {"amplitude_rms": 0}).perfect
    assert WavefrontConfig(**values | {"opd_rms_nm": 0, "amplitude_rms": 0, "jitter_mas": 9}).perfect


def test_models_are_frozen_and_need_every_value():
    mirror = load_instrument().mirror
    assert MirrorConfig(**mirror.model_dump()) == mirror
    with pytest.raises(ValueError, match="frozen"):
        mirror.bits = 12
    with pytest.raises(ValueError, match="side"):
        DarkHoleConfig(control="off", mode="4q", bandwidth=0.1, surface_files={})


def test_defaults():
    instrument = load_instrument()
    assert instrument.cosmic_rays.model == "physical"
    assert (instrument.sky.model, instrument.sky.season, instrument.sky.sun_limit_deg) == ("zodiacal", "median", 50.0)
    assert instrument.provenance["sky.earthshine.brightness_v_mag_arcsec2"].confidence == "I"
    assert instrument.sky.exozodi_zodis == 0.0
    assert instrument.provenance["sky.exozodi_zodis"].confidence == "A"
    assert instrument.sky.earthshine.map_of("F520") is None
    assert instrument.cosmic_rays.paper.depth_um == 100.0
    assert instrument.cosmic_rays.paper.mean_charge_e == 2700.0
    assert instrument.provenance["cosmic_rays.peak_rate_per_s_cm2"].confidence == "P"


def test_the_papers_sky_is_an_option_and_that_of_its_preset():
    """21 mag/arcsec2 and nothing else; earthshine comes with it where it is asked for."""
    paper, named = load_instrument("paper_table1").sky, load_instrument({"sky": {"model": "uniform"}}).sky
    assert paper == named == load_instrument().changed({"sky": {"model": "uniform"}}).sky
    assert (named.model, named.brightness_v_mag_arcsec2) == ("uniform", 21.0)
    assert set(named.earthshine.model_dump().values()) == {None}
    lit = load_instrument({"base": "paper_table1", "sky": {"earthshine": {"brightness_v_mag_arcsec2": 23.0}}}).sky
    assert lit.earthshine.brightness_v_mag_arcsec2 == 23.0


def test_earthshine_of_ones_own_replaces_the_default():
    given = {"earthshine": {"rate_e_s": 0.5}}
    for sky in (load_instrument({"sky": given}).sky, load_instrument().changed({"sky": given}).sky):
        assert sky.earthshine.model_dump() == {"brightness_v_mag_arcsec2": None, "rate_e_s": 0.5, "map_file": None}
    off = load_instrument({"sky": {"earthshine": {"brightness_v_mag_arcsec2": None}}}).sky
    assert off.earthshine.brightness_v_mag_arcsec2 is None


def test_a_number_that_the_sky_does_not_read_is_refused(refused):
    """It would change nothing; the numbers that are there may be written out."""
    for name, own, key in (
        ("cpic_default", {"brightness_v_mag_arcsec2": 22.0}, "sky.brightness_v_mag_arcsec2 = 22.0"),
        ("paper_table1", {"season": "date"}, "sky.season = date"),
    ):
        refused(f"{key}.*only with sky.model", load_instrument, {"base": name, "sky": own})
        refused(f"{key}.*only with sky.model", load_instrument(name).changed, {"sky": own})
        whole = load_instrument(name)
        assert load_instrument(whole.model_dump()).sky == whole.sky


def test_hash_sees_both_sections():
    default = load_instrument().content_hash
    assert load_instrument({"cosmic_rays": {"model": "paper"}}).content_hash != default
    assert load_instrument({"sky": {"earthshine": {"rate_e_s": 0.1}}}).content_hash != default
    assert load_instrument({"sky": {"exozodi_zodis": 3}}).content_hash != default


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        ("2028-01-02", "2028-01-02T00:00:00"),
        ("2028-01-02T03:04", "2028-01-02T03:04:00"),
        ("2028-01-02 03:04:05.25Z", "2028-01-02T03:04:05.25"),
        ("2016-12-31T23:59:60.5", "2016-12-31T23:59:60.5"),
        ("1972-06-30T23:59:60", "1972-06-30T23:59:60"),
        ("2028-02-29", "2028-02-29T00:00:00"),
        ("2100-12-31T23:59:59.9", "2100-12-31T23:59:59.9"),
    ],
)
def test_times_are_read_in_the_usual_spellings(given, meant):
    assert checked_utc("start_utc", given) == meant


def test_leap_seconds_are_those_of_astropy(refused):
    from astropy.time import Time

    for year in range(1972, 2024):
        for day in ("06-30", "12-31"):
            length = Time(f"{year}-{day}", scale="utc")
            seconds = (Time(length.jd1 + 1.0, length.jd2, format="jd", scale="utc") - length).to_value("s")
            text = f"{year}-{day}T23:59:60.5"
            if round(seconds) == 86401:
                assert checked_utc("start_utc", text) == text
            else:
                refused("start_utc", checked_utc, "start_utc", text)


HAT = {"camera": "VIS", "t_opt": 0.2, "qe": 0.9}


def curve_beside(folder):
    """A trapezium: mean wavelength 850 nm, area over peak 58 nm."""
    (folder / "curve.dat").write_text("# nm T\n700 0\n820 0\n822 0.9\n878 0.9\n880 0\n999 0\n")
    return str(folder / "curve.dat")


@pytest.mark.parametrize("name", ["F520", "mine"])
def test_a_band_with_a_curve_and_no_edges_has_those_of_the_curve(tmp_path, name):
    """In a file, a mapping and a change: the same instrument as with the edges written out."""
    file = curve_beside(tmp_path)
    own = {"transmission_file": file} | ({} if name == "F520" else HAT)
    followed = load_instrument({"bands": {name: own}})
    written = load_instrument({"bands": {name: own | {"center_nm": 850.0, "width_nm": 58.0}}})
    assert followed.content_hash == written.content_hash
    assert followed.lambda_d_arcsec(name) == pytest.approx(850e-9 / 2.0 * 206264.806, rel=1e-8)
    (tmp_path / "i.yaml").write_text(
        f"kind: instrument\nbands: {{{name}: {own | {'transmission_file': 'curve.dat'}}}}\n"
    )
    assert load_instrument(tmp_path / "i.yaml").bands[name] == written.bands[name]
    changed = load_instrument().changed({"bands": {name: own}})
    assert changed.bands[name] == written.bands[name]
    assert f"bands.{name}.center_nm" not in changed.provenance


def test_an_edge_that_is_given_stays(tmp_path):
    band = load_instrument({"bands": {"mine": HAT | {"transmission_file": curve_beside(tmp_path), "center_nm": 848}}})
    assert (band.bands["mine"].center_nm, band.bands["mine"].width_nm) == (848.0, 58.0)


def test_a_curve_that_cannot_be_read_is_refused_with_its_name(tmp_path, refused):
    (tmp_path / "svo.dat").write_text("8200 0\n8300 0.5\n8400 0\n")
    band = HAT | {"transmission_file": str(tmp_path / "svo.dat")}
    refused("svo.dat wavelength unit = not stated, .*# Angstrom", load_instrument, {"bands": {"mine": band}})
    refused("none.dat", load_instrument, {"bands": {"mine": HAT | {"transmission_file": "none.dat"}}})


def test_a_preset_is_read_once_and_stays_as_it_is_under_others():
    shipped = load_instrument()
    before = shipped.content_hash
    for own in ({"detector": {"read_noise_e": 3.0, "em_gain_max": 1}}, {"bands": {"F520": {"t_opt": 0.1}}}):
        assert load_instrument(own).content_hash != before
        assert load_instrument(own) is not load_instrument(own)
    assert load_instrument("cpic_default") is load_instrument() is shipped
    assert load_instrument({"name": shipped.name}).content_hash == before
