"""A confirmed scene in a folder: whole, resumable, and the same from the command line and from Python."""

import json

import pytest

import cpic_planner
from catalogs.errors import InputError
from cpic_planner.cli.main import main
from cpic_planner.jobs.engine import run_tasks
from cpic_planner.models import BandConfirmation, ConfirmResult
from cpic_planner.scene_confirmation import ConfirmQuestion, prepared_tasks
from cpic_planner.validation.confirm import confirm_task
from simulator import load_instrument, load_scene
from simulator.files import dump_json

FRAMES = {"exposure_s": 3.0, "n_frames": 6, "em_gain": 300.0, "realisations": 2}
OPTIONS = ["--exposure-s", "3", "--frames", "6", "--em-gain", "300", "--realisations", "2"]
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


FAINT = {
    "name": "faint",
    "cstar": {"v_mag": 5.5, "teff_k": 5500, "distance_pc": 4.0},
    "planets": [
        {"name": "b", "radius_rjup": 1, "phase_deg": 90, "separation_arcsec": 0.6, "pa_deg": 315, "albedo": "jupiter"}
    ],
}
TIERS = ("quick", "standard", "reference")


def tier_task(tier):
    config = ConfirmQuestion(
        instrument=load_instrument(),
        scene=load_scene(FAINT),
        bands=("F850",),
        exposure_s=60.0,
        n_frames=2,
        em_gain=300.0,
        realisations=1,
        fidelity=tier,
    )
    (expected,) = [task for task in prepared_tasks(config) if task.band == "F850"]
    return expected.to_dict()


@pytest.fixture(scope="module")
def tiers():
    """One scene at every tier, in this process."""
    return {TIERS[i]: body for i, body in run_tasks(confirm_task, [(tier_task(tier),) for tier in TIERS])}


@pytest.mark.long
def test_every_tier_is_the_same_for_any_number_of_workers(tiers):
    again = dict(run_tasks(confirm_task, [(tier_task(tier),) for tier in TIERS], workers=2))
    for number, tier in enumerate(TIERS):
        assert dump_json(again[number]) == dump_json(tiers[tier])


def test_the_reference_beside_standard(tiers):
    """Whole frames with every effect, and sums of frames: the same planet within its noise."""
    whole, sums = (
        BandConfirmation.model_validate(tiers[tier]["confirmations"][0]) for tier in ("reference", "standard")
    )
    assert (whole.drawn_as, whole.modelled.region, whole.realisations) == ("frames", "full", 1)
    assert whole.modelled.predicted_error == {"planet_flux": 0.0, "snr": 0.0}
    assert whole.audit is None
    assert (sums.drawn_as, sums.modelled.region, sums.audit.n_frames) == ("sums", "hole", 2)
    error = whole.contrast_error
    assert abs(whole.recovered_contrast - whole.true_contrast) < 4 * error
    assert abs(sums.recovered_contrast - whole.recovered_contrast) < 4 * 1.5 * error
    assert error == pytest.approx(sums.contrast_error, rel=0.35)  # a dozen apertures each
    assert whole.core_throughput == pytest.approx(sums.core_throughput, rel=0.01)
    assert whole.predicted_snr == sums.predicted_snr


def test_another_tier_is_another_configuration(finished):
    for dial in ({"fidelity": "quick"}, {"tolerance": 0.1}, {"fidelity": "reference"}):
        with pytest.raises(InputError, match="--force"):
            cpic_planner.confirm_scene("paper_example", bands=["F520"], out=finished, **(FRAMES | dial))


def test_a_tier_that_is_too_coarse_is_no_error(capsys, tmp_path):
    scene = tmp_path / "bright.yaml"
    scene.write_text("""name: bright
cstar: {v_mag: 0.4, teff_k: 6500, distance_pc: 3.5}
planets: [{name: b, radius_rjup: 1, phase_deg: 90, separation_arcsec: 0.9, pa_deg: 315, albedo: jupiter}]
""")
    options = ["--band", "F520", "--exposure-s", "1.7", "--frames", "400", "--em-gain", "300", "--fidelity", "quick"]
    assert main(["confirm", str(scene), *options, "--out", str(tmp_path / "o")]) == 0
    result = ConfirmResult.model_validate_json((tmp_path / "o" / "confirm.json").read_text())
    (band,) = result.bands
    assert (band.status, band.reason) == ("invalid", "tier_too_coarse")
    assert "--fidelity standard" in band.message
    assert "--fidelity standard" in " ".join(capsys.readouterr().out.split())
    assert "--fidelity standard" in (tmp_path / "o" / "report.html").read_text()
