"""Level-1 files measured: whose they are, how they are registered, and that what is found is what was there."""

import json

import numpy as np
import pytest
from astropy.io import fits
from astropy.table import Table

from cpic_core import InputError
from cpic_planner.confirm import confirm_scene
from cpic_planner.confirm.files import measured_files
from cpic_planner.jobs import check_tree
from cpic_planner.queries import ConfirmQuestion
from cpic_planner.report.export import astrometry_csv
from cpic_planner.validation import confirm, level1_files, level1_programmes
from simulator import load_instrument
from simulator.target import scene_sources
from tests.cpic_planner.validation.level1_files import BAND, scenes, write_off_mask, write_pairs, write_programme

ROLL_DEG, JITTER = 90.0, ((0.2, -0.12), (-0.2, 0.12))
PIXEL = load_instrument().pixel_scale_arcsec(BAND)


def measured(folder, **asked):
    question = ConfirmQuestion.of({"from_products": str(folder), "fidelity": "quick"} | asked)
    return confirm_scene(question, question.out, force=question.force).result


@pytest.fixture(scope="module")
def truth():
    """Return the planet and the star, as the scene says."""
    star, planet = scene_sources(scenes()[0], load_instrument(), BAND)
    return planet, star


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("level1")
    write_programme(place, 4, frames=10, visits=2, jitter=JITTER, rolls_deg=(ROLL_DEG, ROLL_DEG))
    return place


def test_files_without_a_scene_are_measured_alone(folder, truth):
    result, (planet, _) = measured(folder), truth
    (source,) = result.sources
    assert abs(source.separation_arcsec - 0.65) < 3 * source.separation_error_arcsec
    assert abs(source.pa_deg - 315.0) < 3 * source.pa_error_deg  # on the sky, whatever the roll
    assert abs(source.rate_e_s - planet.rate_e_s) < 3 * source.rate_error_e_s
    assert source.search_snr > source.search_threshold > 3
    # Nothing of the star's light is known, and nothing is compared.
    assert source.contrast is None
    assert source.source == ""
    assert result.bare
    assert not result.bands
    assert result.searches[0].false_detections is None
    assert "nothing to compare" in result.calibration_text
    told = Table.read(astrometry_csv(result), format="ascii.csv")
    assert list(told["sep"]) == pytest.approx([1e3 * source.separation_arcsec])
    for row in result.visits:
        x, y = JITTER[row.visit - 1]
        assert row.moved
        assert row.frames_moved == 0
        assert row.roll_deg == ROLL_DEG
        assert (row.shift_x_pixel, row.shift_y_pixel) == pytest.approx((x, y), abs=0.01)


def small(path, n=1, **header):
    write_pairs(path, np.ones((n, 20, 20)), np.ones((n, 20, 20), bool), PIXEL, (10, 10), **header)


def test_visits_are_told_apart_by_headers_and_patterns(tmp_path):
    small(tmp_path / "a.fits", 2, ROLE="science", VISIT=1)
    small(tmp_path / "b.fits", 3, ROLE="science", VISIT=1)
    small(tmp_path / "night" / "c.fits")
    small(tmp_path / "d.fits", STAROFFX=0.4, STAROFFY=0.4)
    small(tmp_path / "masters" / "flat.fits", OBSTYPE="FLAT")
    with pytest.raises(InputError, match="reference visit in F662"):
        level1_programmes(tmp_path)
    (programme,) = level1_programmes(tmp_path, references=["night"])
    assert [[one.path.name for one in visit] for visit in programme.visits["science"]] == [["a.fits", "b.fits"]]
    assert (programme.n_frames("science"), programme.n_frames("reference")) == (5, 1)
    assert programme.visits["off_mask"][0][0].path.name == "d.fits"
    with pytest.raises(InputError, match="science visit in F520"):
        level1_programmes(tmp_path, ["F520"], ["night"])


def test_a_pixel_is_that_of_the_instrument_where_headers_do_not_state_it(tmp_path):
    for name, role in (("a.fits", "science"), ("b.fits", "reference")):
        small(tmp_path / name, ROLE=role)
        with fits.open(tmp_path / name, mode="update") as units:
            del units[1].header["PIXSCALE"]
    (programme,) = level1_programmes(tmp_path)
    programme.check(0.0162)
    assert programme.first.pixel_scale_arcsec(0.0162) == 0.0162


def test_the_scene_is_that_of_the_parameters_of_the_same_observation(tmp_path):
    """And of no other that has its number; without one, the star alone is known."""
    own = {"OBSID": "40000000001", "SCENHASH": "a" * 16, "CONFHASH": "b" * 16}
    for number, planet in enumerate((False, True)):
        header = own | {"SCENHASH": own["SCENHASH"] if planet else "c" * 16}
        tree = {"header": header, "scene": scenes(planet=planet)[0].model_dump(mode="json")}
        tree["instrument"] = load_instrument({"name": "other"}).model_dump(mode="json")
        place = tmp_path / str(number) / "Params" / own["OBSID"] / "V01" / "configuration.json"
        place.parent.mkdir(parents=True)
        place.write_text(json.dumps(tree))
    small(tmp_path / "a.fits", ROLE="science", **own)
    small(tmp_path / "b.fits", ROLE="reference")
    files = measured_files(ConfirmQuestion.of({"from_products": tmp_path}), tmp_path)
    assert [planet.name for planet in files.question.looked_at.planets] == ["planet"]
    assert files.question.instrument.name == "other"
    assert not files.bare
    small(tmp_path / "bare" / "a.fits", ROLE="science", OBJECT="tau Cet")
    small(tmp_path / "bare" / "b.fits", ROLE="reference")
    files = measured_files(ConfirmQuestion.of({"from_products": tmp_path}), tmp_path / "bare")
    assert files.bare
    assert files.question.looked_at.name == "tau Cet"


@pytest.mark.parametrize(
    ("header", "names"),
    [
        ({"EXPTIME": 3.0}, "b.fits: EXPTIME = 3.0"),
        ({"EMGAIN": 300.0}, "b.fits: EMGAIN = 300.0"),
        ({"FILTER": 3}, "b.fits: FILTER = 3"),
        ({"VISIT": 2, "OBJECT": "tau Cet", "ROLE": "science"}, "b.fits: OBJECT = tau Cet"),
        ({"VISIT": 2, "POS_ANG0": 30.0, "ROLE": "science"}, "b.fits: POS_ANG0 = 30.0 deg"),
    ],
)
def test_files_that_do_not_fit_are_named(tmp_path, header, names):
    small(tmp_path / "a.fits", ROLE="science", VISIT=1)
    small(tmp_path / "b.fits", **{"ROLE": "reference"} | header)
    small(tmp_path / "c.fits", ROLE="reference")
    with pytest.raises(InputError, match=names):
        measured(tmp_path)


def test_what_is_no_level1_is_refused(tmp_path):
    from astropy.io import fits

    with pytest.raises(InputError, match="a folder with Level-1 files"):
        measured(tmp_path / "nowhere")
    raw = fits.ImageHDU(np.ones((5, 5), "u2"))
    raw.header["BUNIT"] = "adu"
    fits.HDUList([fits.PrimaryHDU(), raw]).writeto(tmp_path / "raw.fits")
    with pytest.raises(InputError, match="1 Level-0 files are there: reduce them first with cpic reduce"):
        level1_files(tmp_path)
    small(tmp_path / "a.fits", ROLE="science")
    small(tmp_path / "b.fits", ROLE="reference")
    with pytest.raises(InputError, match="a.fits: CRPIX1, CRPIX2"):
        measured(tmp_path)
    with pytest.raises(InputError, match="seed"):
        measured(tmp_path, seed=3)
    with pytest.raises(InputError, match="roll: not accepted; allowed: together with a scene"):
        measured(tmp_path, strategy={"library": "roll"})


@pytest.mark.long
def test_a_scene_stands_beside_its_files(folder, truth):
    result, (planet, star) = measured(folder, scene=scenes()[0]), truth
    (band,) = result.bands
    assert band.drawn_as == "files"
    assert band.detected
    assert band.realisations == 1
    assert band.planet == "planet"
    assert band.pa_deg == pytest.approx(315.0)
    assert band.predicted_snr > 5
    assert abs(band.recovered_contrast - planet.rate_e_s / star.rate_e_s) < 3 * band.contrast_error
    assert abs(band.found_pa_deg - 315.0) < 3 * band.found_pa_error_deg
    (source,) = result.sources
    assert source.source == "planet"
    assert source.contrast == pytest.approx(source.rate_e_s / star.rate_e_s)
    assert result.searches[0].false_detections == 0
    assert not result.bare
    curve = result.searches[0].curve
    there = np.interp(0.65, [row.separation_arcsec for row in curve], [row.contrast_limit for row in curve])
    assert there == pytest.approx(band.observations[0].contrast_limit, rel=0.5)  # another quadrant of the ring


@pytest.mark.long
def test_a_curve_goes_on_where_what_is_usable_has_no_room_for_apertures(folder, monkeypatch):
    real = confirm.measured_at

    def measured_at(visits, realisation, place, *more):
        x, y = place.places_arcsec[0]
        return None if x > 0 or y > 0 else real(visits, realisation, place, *more)

    whole = measured(folder, scene=scenes()[0]).searches[0].curve
    monkeypatch.setattr(confirm, "measured_at", measured_at)
    curve = measured(folder, scene=scenes()[0]).searches[0].curve
    assert [row.separation_arcsec for row in curve] == [row.separation_arcsec for row in whole]
    assert curve != whole


@pytest.mark.long
def test_two_rolls_and_references_of_another_star(tmp_path, truth):
    (whole, alone), (planet, star) = scenes(), truth
    contrast = planet.rate_e_s / star.rate_e_s
    write_programme(tmp_path / "rolls", 2, frames=20, visits=2, rolls_deg=(75.0, 105.0), shown=(whole, whole))
    result = measured(tmp_path / "rolls", scene=whole, strategy={"library": "roll"})
    (band,) = result.bands
    assert band.pa_deg == pytest.approx(315.0)
    assert abs(band.recovered_contrast - contrast) < 3 * band.contrast_error
    fainter = alone.cstar.model_copy(update={"v_mag": 2.1, "ra_deg": 200.0})
    shown = whole, alone.model_copy(update={"cstar": fainter})
    write_programme(tmp_path / "other", 2, frames=20, visits=2, shown=shown)
    result = measured(tmp_path / "other", scene=whole)
    assert abs(result.bands[0].recovered_contrast - contrast) < 3 * result.bands[0].contrast_error
    assert len(result.sources) == 1


@pytest.mark.long
@pytest.mark.parametrize("seeds", [range(1, 11), range(11, 21)])
def test_pulls_of_place_and_contrast(tmp_path, truth, seeds):
    planet, star = truth
    pulls = []
    for seed in seeds:
        place = tmp_path / str(seed)
        write_programme(place, seed, frames=20, visits=2, rolls_deg=(ROLL_DEG, ROLL_DEG))
        rate = write_off_mask(place, seed)
        (one,) = measured(place).sources
        assert rate == pytest.approx(star.rate_e_s)
        pulls.append(
            (
                (one.separation_arcsec - 0.65) / one.separation_error_arcsec,
                (one.pa_deg - 315.0) / one.pa_error_deg,
                (one.contrast - planet.rate_e_s / star.rate_e_s) / one.contrast_error,
            )
        )
    values = np.array(pulls)
    assert (np.abs(values.mean(axis=0)) < 4 * values.std(axis=0, ddof=1) / np.sqrt(len(values))).all(), values
    assert 0.8 < values.std() < 1.25, values


@pytest.mark.long
def test_nothing_is_found_where_nothing_is(tmp_path):
    """In eight programmes without a planet, and the tables of none are whole."""
    for seed in range(1, 9):
        write_programme(tmp_path / str(seed), seed, frames=10, visits=2, planet=False)
        assert measured(tmp_path / str(seed), out=str(tmp_path / "out"), force=True).sources == []
    assert len(Table.read(tmp_path / "out" / "sources.ecsv")) == 0
    assert check_tree(tmp_path / "out") == []
