"""A confirmed scene in a folder: whole, resumable, and the same from the command line and from Python."""

import json

import pytest

import cpic_planner
from catalogs.errors import InputError
from cpic_planner.cli.main import main
from cpic_planner.models import ConfirmResult

FRAMES = {"exposure_s": 3.0, "n_frames": 6, "em_gain": 300.0, "realisations": 2, "fidelity": "quick"}
OPTIONS = ["--exposure-s", "3", "--frames", "6", "--em-gain", "300", "--realisations", "2", "--fidelity", "quick"]
PRODUCTS = ("confirm.json", "measurements.csv", "panels-F520.png", "report.html", "run.json")


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("confirm") / "scene"
    assert main(["-q", "confirm", "paper_example", "--band", "F520", *OPTIONS, "--out", str(out)]) == 0
    return out


def test_products_are_whole(finished):
    for name in PRODUCTS:
        assert (finished / name).stat().st_size > 100, name
    assert not list(finished.glob("*.tmp*"))
    result = ConfirmResult.model_validate_json((finished / "confirm.json").read_text())
    (band,) = result.bands
    assert (band.status, band.n_frames, band.exposure_s, band.em_gain) == ("ok", 6, 3.0, 300.0)
    assert abs(band.recovered_contrast - band.true_contrast) < 5 * band.contrast_error
    assert band.audit is not None
    assert "Images" in (finished / "report.html").read_text()


def test_started_again_it_keeps_what_is_finished_and_gives_the_same_bytes(finished):
    before = {name: (finished / name).read_bytes() for name in PRODUCTS[:-1]}
    result = cpic_planner.confirm_scene("paper_example", bands="F520", out=finished, **FRAMES)
    assert {name: (finished / name).read_bytes() for name in PRODUCTS[:-1]} == before
    assert json.loads(before["confirm.json"]) == result.model_dump(mode="json")
    run = json.loads((finished / "run.json").read_text())
    assert (run["resumed_parts"], run["computed_parts"]) == (1, 0)


def test_another_configuration_needs_force(finished, tmp_path):
    settings = FRAMES | {"audit": False, "realisations": 1}
    with pytest.raises(InputError, match="--force"):
        cpic_planner.confirm_scene("paper_example", bands=["F520"], out=finished, **settings)
    assert (finished / "panels-F520.png").exists()
    star = {"name": "alone", "cstar": {"v_mag": 4.0, "teff_k": 5500, "distance_pc": 4.0}}
    cpic_planner.confirm_scene("paper_example", bands=["F662"], out=tmp_path / "o", **settings)
    alone = cpic_planner.confirm_scene(star, bands=["F520"], out=tmp_path / "o", force=True, **settings)
    assert [path.name for path in (tmp_path / "o").glob("panels-*")] == ["panels-F520.png"]
    # without a planet the blind search is all there is
    assert alone.bands == []
    assert alone.searches[0].realisations == 1
    assert alone.searches[0].n_frames == 6


def test_overrides_alter_the_images_alone(finished):
    nominal = ConfirmResult.model_validate_json((finished / "confirm.json").read_text()).bands[0]
    settings = FRAMES | {"audit": False, "simulator_overrides": {"throughput": "x0.3"}}
    result = cpic_planner.confirm_scene("paper_example", bands=["F520"], strategy={"library": "idealised"}, **settings)
    assert result.simulator_overrides == {"bands.*.t_opt": "x0.3"}
    assert result.reference_library == "idealised"
    assert result.bands[0].recovered_snr < 0.8 * result.bands[0].predicted_snr
    assert result.bands[0].predicted_snr >= nominal.predicted_snr
