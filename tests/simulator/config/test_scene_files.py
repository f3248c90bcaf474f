"""One scene for each star of a table, whatever library the table is of."""

import math

import numpy as np
import pytest
import yaml

from catalogs import load_stars
from cpic_core import InputError
from simulator.config import (
    Planet,
    SequenceConfig,
    is_table,
    load_instrument,
    load_scene,
    load_simulation,
    meaningful_keys,
    preset_names,
    scenes_from_table,
    simulation_of,
    validate,
)
from simulator.config.simulation import SEQUENCE_KINDS

COLUMNS = {
    "name": ["a", "b", "c"],
    "v_mag": [1.0, 2.5, 4.0],
    "teff_k": [5000.0, np.nan, 6000.0],
    "sp_type": ["strange", "G5V", "F8V"],
    "distance_pc": [10.0, np.nan, 5.0],
    "remark": ["x", "y", "z"],
}
PLANET = {"radius": 1, "phase": 90, "separation": 0.5, "pa": 45, "distance_au": 5.0, "albedo": 0.5}


def pandas_table():
    import pandas as pd

    return pd.DataFrame(COLUMNS)


def astropy_table():
    from astropy.table import Table

    return Table(COLUMNS)


def masked_table():
    from astropy.table import MaskedColumn, QTable

    table = QTable({key: value for key, value in COLUMNS.items() if key not in ("teff_k", "distance_pc")})
    table["teff_k"] = MaskedColumn([5000.0, 1.0, 6000.0], mask=[False, True, False])
    table["distance_pc"] = COLUMNS["distance_pc"]
    return table


@pytest.mark.parametrize("make", [pandas_table, astropy_table, masked_table])
def test_rows_become_scenes(make):
    table = make()
    assert is_table(table)
    first, second, third = scenes_from_table(table)
    assert [one.name for one in (first, second, third)] == ["a", "b", "c"]
    assert (first.cstar.teff_k, first.cstar.spectral_type) == (5000.0, None)
    assert (second.cstar.teff_k, second.cstar.spectral_type) == (None, "G5V")
    assert (second.cstar.distance_pc, third.cstar.distance_pc) == (None, 5.0)
    assert all(one.planets == () and one.stars == () for one in (first, second, third))


def test_units_of_a_table_are_obeyed():
    import astropy.units as u
    from astropy.table import QTable

    table = QTable({"name": ["a"], "v_mag": [3.0], "teff_k": [5.8] * u.kK, "distance_pc": [3.26156378] * u.lyr})
    star = scenes_from_table(table)[0].cstar
    assert star.teff_k == pytest.approx(5800.0)
    assert star.distance_pc == pytest.approx(1.0, rel=1e-8)


def test_the_star_catalogue_itself():
    stars = load_stars()
    scenes = scenes_from_table(stars)
    assert len(scenes) == len(stars)
    sun_like = next(one for one in scenes if one.name == "tau Cet")
    assert sun_like.cstar.teff_k == pytest.approx(5345, abs=100)
    assert sun_like.cstar.luminosity_lsun == pytest.approx(0.5, abs=0.1)


def test_the_same_planet_for_every_star():
    scenes = scenes_from_table(pandas_table().drop(columns="distance_pc"), planet=PLANET)
    assert {one.planets[0] for one in scenes} == {
        Planet(
            name="planet 1", radius_rjup=1, phase_deg=90, separation_arcsec=0.5, pa_deg=45, distance_au=5, albedo=0.5
        )
    }


def test_companions_join_when_they_are_near_and_known():
    table = pandas_table()
    table["companion_separation_arcsec"] = [5.0, 61.0, 5.0]
    table["companion_pa_deg"] = [30.0, 30.0, np.nan]
    table["companion_v_mag"] = [6.0, 6.0, 6.0]
    table["companion_teff_k"] = [4000.0, 4000.0, 4000.0]
    near, far, unknown = scenes_from_table(table)
    assert [(star.name, star.separation_arcsec, star.v_mag) for star in near.stars] == [("companion", 5.0, 6.0)]
    assert far.stars == ()
    assert [(star.name, star.pa_deg) for star in unknown.stars] == [("companion, position angle assumed", 30.0)]


def test_companions_of_the_catalogue_are_those_of_the_etc():
    stars = load_stars()
    scenes = scenes_from_table(stars)
    delta, separation = stars.column("companion_delta_v_mag"), stars.column("companion_sep_arcsec")
    near = np.isfinite(delta) & (separation <= 60.0)
    assert near.sum() > 100
    assert [len(scene.stars) for scene in scenes] == near.astype(int).tolist()
    row = next(number for number, scene in enumerate(scenes) if scene.name == "alf Cen A")
    host, (other,) = scenes[row].cstar, scenes[row].stars
    assert other.v_mag == pytest.approx(host.v_mag + delta[row])
    assert (other.teff_k, other.log_g) == (host.teff_k, host.log_g)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"drop": "name"}, ("table.name = missing",)),
        ({"drop": "v_mag"}, ("table.v_mag = missing",)),
        ({"v_mag": [1.0, 50.0, 2.0]}, ("table.1.cstar.v_mag = 50.0 mag", "-30 to 40")),
        ({"v_mag": [1.0, 2.0, np.nan]}, ("table.2.cstar.v_mag = missing",)),
        ({"sp_type": ["", "", ""]}, ("table.1.cstar.spectral_type = missing",)),
        ({"name": ["a", "", "c"]}, ("table.1.name",)),
    ],
)
def test_bad_rows_are_refused_by_number(refused, change, words):
    table = pandas_table()
    table = table.drop(columns=change["drop"]) if "drop" in change else table.assign(**change)
    message = refused("", scenes_from_table, table)
    for word in words:
        assert word in message


def test_a_mapping_or_a_list_is_no_table():
    assert not is_table({"name": "s"})
    assert not is_table([1, 2])


SCENE = {"name": "s", "cstar": {"v_mag": 5, "teff_k": 5800}}


def written(path, tree):
    path.write_text(yaml.safe_dump(tree), encoding="utf-8")
    return path


def test_defaults_count_where_they_have_a_use_and_nothing_else_is_said():
    found = load_simulation(
        {
            "name": "x",
            "defaults": {"scene": SCENE, "band": "F662", "exposure_s": 3, "frames": 4},
            "sequences": [{}, {"frames": 2, "kind": "DSF"}, {"kind": "BIAS"}, {"kind": "FLAT", "level_e": 100}],
        }
    )
    science, field, bias, flat = found.sequences
    assert (science.kind, science.band, science.exposure_s, science.frames) == ("SCI", ("F662",), (3.0,), 4)
    assert (field.kind, field.frames) == ("DSF", 2)
    assert (bias.scene, bias.band, bias.frames) == (None, (), 4)
    assert (flat.scene, flat.band, flat.level_e) == (None, ("F662",), 100.0)


def test_files_are_looked_for_beside_the_simulation(tmp_path, monkeypatch):
    folder = tmp_path / "deep"
    folder.mkdir()
    written(folder / "my_scene.yaml", SCENE | {"name": "mine"})
    written(folder / "my_instrument.yaml", {"detector": {"read_noise_e": 90}})
    (folder / "flux.txt").write_text("400 1\n1000 2\n")
    inline = {"name": "inline", "cstar": {"v_mag": 5, "spectrum": "flux.txt"}}
    tree = {
        "kind": "simulation",
        "instrument": "my_instrument.yaml",
        "sequences": [{"scene": "my_scene.yaml"}, {"scene": inline}],
    }
    path = written(folder / "run.yaml", tree)
    monkeypatch.chdir(tmp_path)
    found = load_simulation("deep/run.yaml")
    assert found.name == "run"
    assert [item.scene.name for item in found.sequences] == ["mine", "inline"]
    assert found.sequences[0].instrument.detector.read_noise_e == 90
    assert found.sequences[1].scene.cstar.spectrum == str(path.parent.relative_to(tmp_path) / "flux.txt")


def test_a_sequence_changes_the_instrument_of_the_simulation():
    found = load_simulation(
        {
            "name": "x",
            "instrument": {"detector": {"read_noise_e": 90}},
            "sequences": [
                {"kind": "BIAS"},
                {"kind": "BIAS", "instrument": {"detector": {"bias_adu": 300}}},
                {"kind": "BIAS", "instrument": "cpic_2q"},
            ],
        }
    )
    plain, changed, other = (item.instrument for item in found.sequences)
    assert (plain.detector.read_noise_e, plain.detector.bias_adu) == (90, 200)
    assert (changed.detector.read_noise_e, changed.detector.bias_adu) == (90, 300)
    assert "detector.bias_adu" not in changed.provenance
    assert changed.provenance["detector.read_noise_e"].source == "user"
    assert changed.provenance["telescope.diameter_m"].confidence == "P"
    assert other.content_hash == load_instrument("cpic_2q").content_hash


def test_another_instrument_in_place_of_the_simulations():
    found = load_simulation("paper_cosmic_rays", instrument={"detector": {"bias_adu": 300}})
    assert [item.instrument.detector.bias_adu for item in found.sequences] == [300, 300]
    assert [item.instrument.cosmic_rays.model for item in found.sequences] == ["physical", "paper"]


def test_changes_replace_what_has_a_use_for_them():
    found = load_simulation(
        {"name": "x", "sequences": [{"scene": SCENE, "switches": {"smear": False}}, {"kind": "BIAS"}]}
    )
    changed = simulation_of(
        "y",
        found.sequences,
        changes={"frames": 7, "fidelity": "quick", "switches": {"dark": False}, "start_utc": "2029-01-01"},
    )
    science, bias = changed.sequences
    assert (science.frames, bias.frames, science.fidelity) == (7, 7, "quick")
    assert science.switches == {"smear": False, "dark": False}
    assert (science.start_utc, bias.start_utc) == ("2029-01-01T00:00:00", None)
    assert science.band == found.sequences[0].band
    assert simulation_of("y", found.sequences, changes={"switches": {"all": False}}).sequences[0].switches == {
        "all": False
    }


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"fidelity": "quick"}, ["fidelity", "not for BIAS"]),
        ({"switches": {"smer": False}}, ["switches", "smer"]),
        ({"switches": {"smear": False, "reset_noise": False}}, ["switches", "reset_noise"]),
        ({"start_utc": "2029-01-01"}, ["start_utc", "2030-01-01"]),
        ({"frames": 0}, ["frames", "0"]),
    ],
)
def test_changes_of_no_use_are_refused(changes, words):
    found = load_simulation({"name": "x", "sequences": [{"kind": "BIAS", "start_utc": "2030-01-01"}]})
    with pytest.raises(InputError) as refused:
        simulation_of("y", found.sequences, changes=changes)
    for word in words:
        assert word in str(refused.value)


@pytest.mark.parametrize("name", preset_names("simulation"))
def test_presets_load_and_say_what_they_are(name):
    found = load_simulation(name)
    assert found.name == name
    assert found.description


def test_no_simulation_has_the_name_of_a_scene():
    assert set(preset_names("simulation")).isdisjoint(preset_names("scene"))


def test_the_papers_numbers():
    table = {"F520": 17, "F662": 9, "F720": 50, "F850": 100}
    for name, instrument in (("paper_alpha_cen_b", "cpic_default"), ("paper_table1", "paper_table1")):
        example = load_simulation(name).sequences
        for role in ("science", "reference"):
            assert {item.band[0]: item.exposure_s[0] for item in example if item.role == role} == table
        assert {(item.frames, item.em_gain) for item in example} == {(30, (20.0,))}
        assert {len(item.scene.planets) for item in example if item.role == "reference"} == {0}
        assert {item.instrument.name for item in example} == {instrument}
        assert {item.scene.companions for item in example if item.role == "science"} == {"off"}
    (figure,) = load_simulation("paper_exposure_gain").sequences
    assert (figure.exposure_s, figure.em_gain) == ((30.0, 300.0), (1.0, 20.0))
    (source,) = figure.scene.stars
    assert (source.pa_deg, source.separation_arcsec) == (135, 0.95)
    rays = load_simulation("paper_cosmic_rays").sequences
    assert {(item.exposure_s, item.em_gain) for item in rays} == {((3000.0,), (1.0, 300.0))}
    shifts = load_simulation("paper_shifted_star").sequences
    assert [round(math.hypot(*item.star_offset_arcsec), 5) for item in shifts] == [0, 0.2, 0.5, 1.0]
    assert {(item.frames, item.exposure_s, item.band) for item in shifts} == {(50, (0.01,), ("F520",))}
    assert {item.kind for item in load_simulation("calibration_set").sequences} == set(
        """
        BIAS DARK FLAT BKG LASER
    """.split()
    )


INSTRUMENT = load_instrument()

SIMULATION_SCENE = load_scene("paper_example")


def entry(kind="SCI", **keys):
    sky = {"scene": SIMULATION_SCENE} if kind in ("SCI", "DSF", "CALS") else {}
    return validate(SequenceConfig, {"kind": kind, "instrument": INSTRUMENT} | sky | keys)


def test_lists_are_a_grid_with_the_gain_fastest():
    one = entry(band=["F520", "F662"], exposure_s=[30, 300], em_gain=[1, 20])
    assert list(one.grid()) == [
        (band, exposure, gain) for band in ("F520", "F662") for exposure in (30.0, 300.0) for gain in (1.0, 20.0)
    ]


def test_single_values_and_other_spellings_are_understood():
    one = entry(bands="F520", n_frames=3, em_gains=5, exposures_s=2)
    assert list(one.grid()) == [("F520", 2.0, 5.0)]
    assert one.frames == 3


def test_defaults():
    one = entry()
    assert one.band == ("F520", "F662", "F720", "F850")
    assert (one.exposure_s, one.em_gain, one.frames, one.seed, one.role) == ((10.0,), (1.0,), 1, 1, "science")
    assert entry("CALS").role == "calibration"
    assert entry("CALS", role="science").role == "science"
    assert list(entry("BIAS").grid()) == [("", 0.0, 1.0)]
    assert list(entry("BIAS", exposure_s=0).grid()) == [("", 0.0, 1.0)]
    assert entry("DARK", camera="NIR").cameras == ("NIR",)


def test_every_kind_has_keys_of_its_own_and_common_ones():
    assert all({"frames", "seed", "em_gain"} <= set(meaningful_keys(kind)) for kind in SEQUENCE_KINDS)
    assert "scene" in meaningful_keys("DSF")
    assert "scene" not in meaningful_keys("FLAT")


def test_switches_of_each_camera():
    one = entry(band=["F520", "F940"], switches={"all": False, "read_noise": True})
    visible, infrared = one.switches_for("VIS"), one.switches_for("NIR")
    assert visible["smear"] is False
    assert "smear" not in infrared
    assert visible["read_noise"] is infrared["read_noise"] is True
    assert sum(visible.values()) == sum(infrared.values()) == 1
    assert entry(switches={"smear": False}).switches_for("VIS") == {"smear": False}


def test_quantities_are_converted():
    from astropy import units as u

    assert entry(exposure_s=2 * u.min).exposure_s == (120.0,)
