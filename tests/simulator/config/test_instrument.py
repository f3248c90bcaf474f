import math

import pytest
from pydantic import ValidationError

from simulator.config import content_hash, load_instrument
from simulator.config.base import canonical_json


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
    assert {k: round(v, 3) for k, v in inner.items()} == {
        "F520": 0.231,
        "F662": 0.294,
        "F720": 0.319,
        "F850": 0.377,
    }
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


def test_hash_depends_on_content_only():
    assert content_hash({"a": 1, "b": [2.0, 3]}) == content_hash({"b": [2, 3.0], "a": 1.0})
    assert content_hash({"a": 1}) != content_hash({"a": 1.0000000001})
    assert canonical_json({"x": 1e300, "y": 0.1}) == '{"x":1e+300,"y":0.1}'
    assert (
        load_instrument().content_hash == load_instrument({}).model_copy(update={"name": "cpic_default"}).content_hash
    )


def test_files_beside_the_instruments_file_are_found(tmp_path, monkeypatch):
    import numpy as np

    from simulator.arrays import write_npz
    from simulator.imaging.apodizer import load_apodizer

    folder = tmp_path / "mine"
    folder.mkdir()
    write_npz(folder / "mask.npz", {"transmission": np.ones((64, 64))})
    (folder / "curve.txt").write_text("500 0.8\n540 0.8\n")
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
    # nothing else differs, so that the optics are the shipped ones
    detector = default.detector.model_copy(update={"read_noise_e": 100.0})
    assert default.model_copy(update={"name": "paper_table1", "detector": detector}).content_hash == stated.content_hash


def test_the_optics_of_table_1_are_the_shipped_ones():
    from simulator.imaging.store import metrics_key

    for band in load_instrument().visible_bands():
        assert metrics_key(load_instrument("paper_table1"), band) == metrics_key(load_instrument(), band)
