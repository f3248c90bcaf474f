"""One scene for each star of a table, whatever library the table is of."""

import numpy as np
import pytest

from catalogs.stars import load_stars
from simulator.config import Planet
from simulator.config.scene_table import is_table, scenes_from_table

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
