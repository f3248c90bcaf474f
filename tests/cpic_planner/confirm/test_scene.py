"""Scenes of any kind: several planets, none, a calibrator, planets out of reach."""

import functools
import json

import numpy as np
import pytest
from astropy.table import Table
from astropy.time import Time

import cpic_planner
from cpic_core import InputError, dump_json
from cpic_planner.cli.main import main
from cpic_planner.confirm import confirm_job, confirm_scene, scene_target
from cpic_planner.confirm.scene import _work
from cpic_planner.etc import (
    aperture_rates,
    build_model,
    contrast_limit,
    planet_offsets,
    reference_distance_au,
    usable_range_arcsec,
)
from cpic_planner.jobs import check_tree
from cpic_planner.jobs.job import run_tasks
from cpic_planner.queries import ConfirmQuestion, ReferencePlanet, Strategy
from cpic_planner.results import BandConfirmation, ConfirmResult
from cpic_planner.targets import find_target
from cpic_planner.validation import Frames, confirm_task, expected_of, target_scene
from simulator import load_instrument, load_scene, spectrum_generator
from simulator.target import scene_sources

FRAMES = {"exposure_s": 4.0, "n_frames": 40, "em_gain": 300.0, "realisations": 3, "audit": False}
STAR = {"v_mag": 1.35, "spectral_type": "K1V", "distance_pc": 1.35}


def planet(name, separation, pa, contrast_scale=1.0):
    return {
        "name": name,
        "radius_rjup": contrast_scale,
        "phase_deg": 90,
        "separation_arcsec": separation,
        "pa_deg": pa,
        "albedo": "jupiter",
    }


def config(scene, **changes):
    return ConfirmQuestion(
        instrument=load_instrument(), scene=load_scene(scene), **(FRAMES | {"bands": ("F520",)} | changes)
    )


@functools.cache
def system():
    """Two planets in the hole and one behind the cross, beside a calibration star."""
    scene = {
        "name": "system",
        "cstar": STAR,
        "planets": [planet("b", 0.5, 315, 1.2), planet("c", 0.6, 135, 1.3), planet("d", 0.5, 0)],
        "stars": [
            {
                "name": "calibrator",
                "v_mag": 14.5,
                "spectral_type": "K1V",
                "separation_arcsec": 0.7,
                "pa_deg": 225,
                "companion": False,
            }
        ],
    }
    return confirm_scene(config(scene)).result


def test_every_planet_has_its_answer():
    answers = {band.planet: band for band in system().bands}
    assert set(answers) == {"b", "c", "d"}
    for name in ("b", "c"):
        found = answers[name]
        assert found.status == "ok"
        assert abs(found.recovered_contrast - found.true_contrast) < 4.5 * max(
            found.contrast_mean_error, found.contrast_error / np.sqrt(3)
        )
        assert found.n_significant == 3
    assert (answers["d"].status, answers["d"].reason) == ("outside_field", "inside_inner_edge")
    assert answers["d"].verdict == "not observed"


def test_the_blind_search_names_what_it_finds():
    (search,) = system().searches
    named = {candidate.planet for candidate in search.candidates if candidate.detected}
    assert {"b", "c"} <= named
    by_name = {candidate.planet: candidate for candidate in search.candidates}
    assert by_name["b"].separation_arcsec == pytest.approx(0.5, abs=0.02)
    assert by_name["b"].pa_deg == pytest.approx(315.0, abs=3.0)
    assert by_name["c"].pa_deg == pytest.approx(135.0, abs=3.0)
    for record in system().positions:
        assert abs(record.separation_arcsec - record.true_separation_arcsec) < 5 * record.separation_error_arcsec
        assert abs(record.pa_deg - record.true_pa_deg) < 5 * record.pa_error_deg


def test_a_scene_without_planets_is_searched():
    done = confirm_scene(config({"name": "alone", "cstar": STAR}))
    result = done.result
    assert result.bands == result.positions == result.albedos == []
    assert result.calibration["n_bands"] == 0
    assert result.searches[0].resolution_elements > 100
    assert not any(candidate.detected for candidate in result.searches[0].candidates)
    assert list(done.bodies) == ["alone F520"]


@pytest.mark.long
def test_frames_may_be_left_to_the_calculator():
    scene = {"name": "left", "cstar": STAR, "planets": [planet("b", 0.6, 315)]}
    free = config(scene, exposure_s=None, n_frames=None, em_gain=None, time_s=1200.0, realisations=1)
    (band,) = confirm_scene(free).result.bands
    assert 0.5 * 1200 < band.time_s <= 1200.0 * (1 + 1e-9)
    gain_only = config(scene, em_gain=None, realisations=1)
    (chosen,) = confirm_scene(gain_only).result.bands
    assert (chosen.exposure_s, chosen.n_frames) == (4.0, 40)
    model = build_model(free.instrument, ["F520"])
    place = scene_sources(free.scene, free.instrument, "F520")[1]
    target = scene_target(free.scene)
    at = [
        expected_of(model, target, "F520", (place.x_arcsec, place.y_arcsec), place.contrast, Frames(4.0, 40, gain))
        for gain in (0.7 * chosen.em_gain, chosen.em_gain)
    ]
    # Here the register's full well binds: less gain is worse, and more would spill into the hole.
    assert at[1]["significance"] > at[0]["significance"]
    star = scene_sources(free.scene, free.instrument, "F520")[0].rate_e_s
    tail = model.metrics["F520"].register_tail * star * 4.0 * chosen.em_gain
    assert tail == pytest.approx(free.instrument.detector.register_full_well_e, rel=0.15)
    late = config(scene, exposure_s=None, n_frames=None, em_gain=None, time_s=1.0)
    (refused,) = confirm_scene(late).result.bands
    assert refused.status == "unreachable"


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"time_s": 100.0}, "n_frames"),
        ({"exposure_s": None}, "exposure_s"),
        ({"n_frames": None}, "n_frames"),
        ({"strategy": Strategy(mode="photon_counting"), "fidelity": "reference"}, "photon"),
        ({"bands": ("F999",)}, "F999"),
    ],
)
def test_what_makes_no_sense_is_refused(changes, key):
    with pytest.raises((InputError, ValueError), match=key):
        confirm_scene(config({"name": "s", "cstar": STAR}, **changes))


def test_a_star_of_the_catalogue_is_the_same_target_through_its_scene():
    target, _ = find_target("eps Eri")
    body = ReferencePlanet()
    distance = float(reference_distance_au(target, np.array([0.6]), body)[0, 0])
    scene = target_scene(target, body, 0.6, distance)
    back = scene_target(scene)
    for name in ("v_mag", "teff_k", "log_g", "metallicity", "distance_pc", "luminosity_lsun", "ra_deg", "dec_deg"):
        assert getattr(back, name)[0] == pytest.approx(getattr(target, name)[0]), name
    model = build_model(load_instrument(), ["F520"])
    frames = Frames(20.0, 100, 400.0)
    ours, theirs = (
        expected_of(model, star, "F520", planet_offsets(model, star, "F520", 0.6), 1e-8, frames)
        for star in (back, target)
    )
    assert ours == pytest.approx(theirs)


# From F to M, by type, by temperature, by another model, by a table and by a file.
LIGHTS = {
    "F5V": {"spectral_type": "F5V"},
    "G2V": {"spectral_type": "G2V"},
    "K5V": {"spectral_type": "K5V"},
    "K2III": {"spectral_type": "K2III"},
    "M0V": {"spectral_type": "M0V"},
    "warm": {"teff_k": 6600.0},
    "metal-poor": {"teff_k": 4440.0, "log_g": 4.6, "metallicity": -1.5},
    "blackbody": {"spectrum": "blackbody", "teff_k": 3600.0},
    "pickles": {"spectrum": "pickles", "spectral_type": "K5V"},
    "table": {"spectrum": {"wavelength_nm": [300.0, 600.0, 1750.0], "photlam": [1.0, 2.0, 9.0]}},
    "file": {"spectrum": "star.txt"},
}
LIT = load_instrument()
SUNLIKE = {"teff_k": 5779.0, "log_g": 4.4, "metallicity": 0.0}
PLACE = {"separation_arcsec": 3.6, "pa_deg": 20.0}
WEST = {"separation_arcsec": 4.4, "pa_deg": 275.0}


def rates_of(stars, cstar=SUNLIKE, **more):
    """The calculator's rates in an aperture on the diagonal, by band, with its light of the star and of the others."""
    scene = load_scene({"name": "s", "cstar": {"v_mag": 5.0} | cstar, "stars": stars} | more)
    model, target = build_model(LIT, list(LIT.bands)), scene_target(scene)
    at = np.full((1, 1), 0.45)
    return {band: aperture_rates(model, target, band, at, at, np.full((1, 1), 1e-9)) for band in model.bands}


def integrated(star):
    """Detected rate of a star's spectrum in the images, by trapezoids over every band."""
    scene = load_scene({"name": "s", "cstar": {"v_mag": 5.0} | SUNLIKE, "stars": [star]})
    (_, row), found = spectrum_generator(scene), {}
    for band, optics in LIT.bands.items():
        ends = optics.center_nm - optics.width_nm / 2, optics.center_nm + optics.width_nm / 2
        angstrom = 10.0 * np.linspace(*ends, 4001)
        found[band] = np.trapezoid(row.spectrum(angstrom).value, angstrom) * optics.t_opt * optics.qe
    return found


def lit(looks):
    """The images' light of a star of these looks, and the calculator's of it as companion, field star and host."""
    star = {"name": "B", "v_mag": 7.4} | PLACE | looks
    beside = [rates_of([star | {"companion": companion}]) for companion in (True, False)]
    alone = rates_of([], looks)
    ours = {band: [one[band].companion_e_s.item() for one in beside] + [alone[band].halo_e_s.item()] for band in alone}
    return integrated(star), ours


SUN = functools.cache(lambda: lit(SUNLIKE))


@pytest.mark.parametrize("light", LIGHTS)
def test_every_star_has_the_light_of_the_images(light, tmp_path, monkeypatch):
    """Over that of a star whose temperature, gravity and metallicity are given, in all bands of both cameras."""
    monkeypatch.chdir(tmp_path)
    table = np.column_stack([np.linspace(300.0, 1750.0, 60), np.geomspace(1.0, 0.2, 60)])
    np.savetxt("star.txt", table, header="wavelength_nm photlam", comments="")
    (seen, ours), (unit, plain) = lit(LIGHTS[light]), SUN()
    for band in LIT.bands:
        assert np.divide(ours[band], plain[band]) == pytest.approx(seen[band] / unit[band], rel=0.01)


def test_all_stars_of_a_scene_count():
    near = {"name": "B", "v_mag": 7.0, "spectral_type": "K5V"} | PLACE
    far = {"name": "C", "v_mag": 8.0, "spectral_type": "M0V"} | WEST
    field = {"name": "F", "v_mag": 8.5, "teff_k": 6000.0, "ra_deg": 10.001, "dec_deg": 5.0005, "companion": False}
    star, every = SUNLIKE | {"ra_deg": 10.0, "dec_deg": 5.0}, [near, far, field]
    one, two, three = (rates_of([body], star) for body in every)
    together, stayed = rates_of(every, star), rates_of(every, star, companions="off")
    for band in LIT.bands:
        for name in ("companion_e_s", "wings_e2_s2"):
            parts = [getattr(rates[band], name).item() for rates in (one, two, three)]
            assert getattr(together[band], name).item() == pytest.approx(sum(parts), rel=1e-9)
            assert getattr(stayed[band], name).item() == pytest.approx(parts[-1], rel=1e-9)
        assert min(rates[band].companion_e_s.item() for rates in (one, two, three)) > 0.0


@pytest.mark.parametrize("band", LIT.visible_bands())
def test_images_are_made_where_the_calculator_answers(band):
    """From corner to corner; what it refuses, the dry run and the run refuse too, and for the same reason."""
    model, (star, _) = build_model(LIT, [band]), find_target("tau Cet")
    inner, outer = usable_range_arcsec(LIT, band)
    for separation in (inner - 0.01, inner, inner + 0.015, outer - 1e-3, outer, outer + 0.01):
        (answer,) = contrast_limit(model, star, time_s=1e4, separation_arcsec=separation)
        work = _work(config({"name": "edge", "cstar": STAR, "planets": [planet("b", separation, 315)]}, bands=(band,)))
        assert [task.planets for task in work.tasks] == ([["b"]] if answer.status == "ok" else [])
        assert [(one.status, one.reason) for one in work.refused] == (
            [] if answer.status == "ok" else [(answer.status, answer.reason)]
        )


def test_a_planet_at_the_inner_corner_is_measured():
    inner, _ = usable_range_arcsec(LIT, "F520")
    frames = {"exposure_s": 4.0, "n_frames": 20, "realisations": 1}
    (band,) = confirm_scene(
        config({"name": "edge", "cstar": STAR, "planets": [planet("b", inner, 315)]}, **frames)
    ).result.bands
    assert (band.status, band.n_background_apertures) == ("ok", 3)
    assert band.recovered_snr > 0.0


def test_planets_that_images_cannot_show_are_told_without_images():
    """One planet of two: the other is measured. Images of another telescope may show less than the nominal one's."""
    bodies = [planet("b", 0.30, 315), planet("c", 0.6, 135)]
    # The telescope of cpic_2q, whose hole is shipped, and lies on one side of the star.
    one_sided = load_instrument("cpic_2q")
    changed = {"apodizer": one_sided.coronagraph.apodizer}
    changed |= {"mask_half_width_arcsec": one_sided.coronagraph.mask_half_width_arcsec}
    changed |= {"inner_arcsec.F520": one_sided.coronagraph.inner_arcsec["F520"]}
    entries = [{"key": f"coronagraph.{key}", "action": "set", "value": value} for key, value in changed.items()]
    entries.append({"key": "dark_hole.mode", "action": "set", "value": one_sided.dark_hole.mode})
    hidden = {"entries": entries}
    work = _work(config({"name": "two", "cstar": STAR, "planets": bodies}, simulator_overrides=hidden))
    assert [task.planets for task in work.tasks] == [["b"]]
    assert [len(task.predictions) for task in work.tasks] == [1]
    assert [(one.planet, one.status, one.reason) for one in work.refused] == [
        ("c", "outside_field", "outside_outer_edge")
    ]
    nominal = _work(config({"name": "two", "cstar": STAR, "planets": bodies}))
    assert ([task.planets for task in nominal.tasks], nominal.refused) == ([["b", "c"]], [])


def test_the_hash_is_that_of_what_decides():
    scene = {"name": "s", "cstar": STAR}
    assert confirm_job(config(scene)).digest == confirm_job(config(scene)).digest
    assert confirm_job(config(scene)).digest != confirm_job(config(scene, seed=2)).digest
    altered = config(
        scene, simulator_overrides={"entries": [{"key": "detector.read_noise_e", "action": "scale", "value": 2}]}
    )
    assert confirm_job(config(scene)).digest != confirm_job(altered).digest


# In a folder: whole, resumable, and the same from the command line and from Python.

FEW_FRAMES = {"exposure_s": 3.0, "n_frames": 6, "em_gain": 300.0, "realisations": 2}
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
    assert check_tree(finished) == []
    assert not list(finished.glob("*.tmp*"))
    result = ConfirmResult.model_validate_json((finished / "confirm.json").read_text())
    (band,) = result.bands
    assert (band.status, band.n_frames, band.exposure_s, band.em_gain) == ("ok", 6, 3.0, 300.0)
    assert abs(band.recovered_contrast - band.true_contrast) < 5 * band.contrast_error
    assert band.audit is not None
    assert "Images" in (finished / "report.html").read_text()


def test_places_are_told_with_their_day_and_covariance(finished):
    result = ConfirmResult.model_validate_json((finished / "confirm.json").read_text())
    (band,) = result.bands
    table = Table.read(finished / "export" / "astrometry.ecsv", format="ascii.ecsv")
    assert len(table) == len(band.observations) == 2
    first = table[0]
    assert first["separation_arcsec"] == pytest.approx(np.hypot(first["east_arcsec"], first["north_arcsec"]), rel=1e-12)
    assert first["separation_arcsec"] == band.found_separation_arcsec
    # The middle of a visit of 2 x 6 frames of 3 s with their readouts, and its overhead, of which the Earth hides 54 %.
    days = (first["epoch_mjd"] - Time("2028-01-01", scale="utc").mjd) * 2
    assert days * 86400 == pytest.approx(band.time_s / 0.46, rel=0.02)
    # Offsets east and north, turned by hand into errors along and across.
    covariance = np.array(
        [
            [first["east_error_arcsec"] ** 2, first["east_north_covariance"]],
            [first["east_north_covariance"], first["north_error_arcsec"] ** 2],
        ]
    )
    angle = np.radians(first["pa_deg"])
    along, across = np.array([np.sin(angle), np.cos(angle)]), np.array([np.cos(angle), -np.sin(angle)])
    errors = np.sqrt([along @ covariance @ along, across @ covariance @ across])
    assert errors[0] == pytest.approx(first["separation_error_arcsec"], rel=1e-9)
    assert np.degrees(errors[1] / first["separation_arcsec"]) == pytest.approx(first["pa_error_deg"], rel=1e-9)
    mixed = along @ covariance @ across / errors.prod()
    assert mixed == pytest.approx(first["separation_pa_correlation"], abs=1e-9)
    csv = Table.read(finished / "export" / "astrometry.csv", format="ascii.csv")
    assert list(csv["sep"]) == pytest.approx([1e3 * first["separation_arcsec"]])


def test_curve_is_the_limit_of_the_planets_ring(finished):
    result = ConfirmResult.model_validate_json((finished / "confirm.json").read_text())
    (band,) = result.bands
    table = Table.read(finished / "export" / "contrast_curve.ecsv", format="ascii.ecsv")
    assert list(table["separation_arcsec"]) == [row.separation_arcsec for row in result.searches[0].curve]
    assert table.meta["sigma"] == 5.0
    there = np.interp(band.separation_arcsec, table["separation_arcsec"], table["contrast_limit"])
    # Another quadrant of the same ring: the scatter of some twenty sums is known to 16 %.
    assert there == pytest.approx(band.observations[0].contrast_limit, rel=0.5)
    assert (
        Table.read(finished / "export" / "contrast_curve.csv", format="ascii.csv")["contrast_limit"][3]
        == table["contrast_limit"][3]
    )


def test_started_again_it_keeps_what_is_finished_and_gives_the_same_bytes(finished):
    before = {name: (finished / name).read_bytes() for name in PRODUCTS[:-1]}
    result = cpic_planner.confirm_scene("paper_example", bands="F520", out=finished, **FEW_FRAMES)
    assert {name: (finished / name).read_bytes() for name in PRODUCTS[:-1]} == before
    assert json.loads(before["confirm.json"]) == result.model_dump(mode="json")
    run = json.loads((finished / "run.json").read_text())
    assert (run["resumed_parts"], run["computed_parts"]) == (1, 0)


@pytest.mark.long
def test_another_configuration_needs_force(refused, finished, tmp_path):
    settings = FEW_FRAMES | {"audit": False, "realisations": 1, "fidelity": "quick"}
    refused("--force", cpic_planner.confirm_scene, "paper_example", bands=["F520"], out=finished, **settings)
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
    settings = FEW_FRAMES | {"audit": False, "simulator_overrides": {"throughput": "x0.3"}}
    result = cpic_planner.confirm_scene("paper_example", bands=["F520"], strategy={"library": "idealised"}, **settings)
    assert result.simulator_overrides == {"bands.*.t_opt": "x0.3"}
    assert result.reference_library == "idealised"
    assert result.bands[0].recovered_snr < 0.8 * result.bands[0].predicted_snr
    assert result.bands[0].predicted_snr >= nominal.predicted_snr


@pytest.mark.parametrize("pa_deg", [331, 333])
def test_a_planet_that_one_of_two_rolls_hides_has_an_answer(pa_deg):
    """Beside the cross it stands behind it at one roll: nothing to measure there, and it says so without images."""
    planets = [planet("b", 0.6, 315), planet("c", 0.6, pa_deg)]
    scene = {"name": "rolls", "cstar": STAR | {"v_mag": 4.0}, "planets": planets}
    rolls = Strategy(library="roll", roll_deg=24.0)
    settings = {"strategy": rolls, "realisations": 1, "n_frames": 10, "fidelity": "quick"}
    shown, hidden = confirm_scene(config(scene, **settings)).result.bands
    assert (shown.planet, shown.status, shown.drawn_as) == ("b", "ok", "sums")
    assert (hidden.planet, hidden.status, hidden.reason) == ("c", "outside_field", "inside_inner_edge")
    assert "at one of the two rolls" in hidden.message
    assert (hidden.verdict, hidden.detected, hidden.drawn_as) == ("not observed", None, None)
    assert hidden.recovered_snr is None
    assert hidden.predicted_snr > 0


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
    (expected,) = [task for task in _work(config).tasks if task.band == "F850"]
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


@pytest.mark.long
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
            cpic_planner.confirm_scene("paper_example", bands=["F520"], out=finished, **(FEW_FRAMES | dial))


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
