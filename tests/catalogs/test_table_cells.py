"""Headings of tables: which quantity and unit they mean."""

import pytest

from catalogs import QUANTITIES
from catalogs.known_planet_columns import COLUMNS
from catalogs.table_cells import heading


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("plx", "parallax_mas"),
        ("PLX_VALUE", "parallax_mas"),
        ("Plx [mas]", "parallax_mas"),
        ("log(g)", "log_g"),
        ("logg", "log_g"),
        ("[Fe/H]", "metallicity"),
        ("fe_h", "metallicity"),
        ("M/H", "metallicity"),
        ("flux(V)", "v_mag"),
        ("B-V", "b_v_mag"),
        ("RA", "ra_deg"),
        ("RAJ2000", "ra_deg"),
        ("_DE", "dec_deg"),
        ("V", "v_mag"),
        ("RAdeg", "ra_deg"),
        ("DEdeg", "dec_deg"),
        ("RA_d", "ra_deg"),
        ("DEC_d", "dec_deg"),
        ("rad", None),
        ("DE-", "dec_split_sign"),
        ("DE -", "dec_split_sign"),
        ("DEd", "dec_split_d"),
        ("nonsense", None),
        ("", None),
    ],
)
def test_heading_to_quantity(text, name):
    quantity, unit, *_ = QUANTITIES.meant_by(text)
    assert (quantity.name if quantity else None) == name
    assert unit in ("mas", "dex", "mag", "deg", "dex(cm/s2)", "")


def test_a_unit_in_the_heading_stands_for_that_of_its_source():
    assert QUANTITIES.meant_by("plx").unit == "mas"
    assert QUANTITIES.meant_by("plx [arcsec]").unit == "arcsec"
    assert QUANTITIES.meant_by("st_lum").unit == "dex(solLum)"
    assert QUANTITIES.meant_by("lum").unit == "solLum"


def test_another_heading_tells_whose_words_they_are():
    assert QUANTITIES.meant_by("name").column.name == "name"
    assert QUANTITIES.meant_by("name", {"planetstatus"}).column.name == "planet"
    assert QUANTITIES.meant_by("RA_ICRS").convention == ""
    assert QUANTITIES.meant_by("RA_ICRS", {"gmag"}).convention == "j2016"


@pytest.mark.parametrize("columns", [QUANTITIES, COLUMNS], ids=["stars", "planets"])
def test_no_heading_means_two_things(columns):
    forms = [(item.heading, item.beside, name) for name in columns for item in columns.synonyms_of(name)]
    forms += [(heading(name), "", name) for name in columns]
    meant = {}
    for form, beside, name in forms:
        assert form.lower() == heading(form)
        assert meant.setdefault((form, beside), name) == name


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("omega", "omega_star_deg"),
        ("Omega", "node_deg"),
        ("omega [deg]", "omega_star_deg"),
        ("Omega (deg)", "node_deg"),
        ("omega_err", "omega_err_deg"),
        ("Omega_err", "node_err_deg"),
        ("Omega_Err", "node_err_deg"),
        ("OMEGA_STAR_DEG", "omega_star_deg"),
        ("omega_planet", "omega_planet_deg"),
        ("m", "mass_mjup"),
        ("W", None),
    ],
)
def test_headings_that_differ_by_a_capital_alone(text, name):
    meant = COLUMNS.meant_by(text)[0]
    assert (meant.name if meant else None) == name


@pytest.mark.parametrize("text", ["OMEGA", "OMEGA [deg]", "OMEGA_ERR", "M", "M [Msun]"])
def test_headings_whose_capitals_leave_their_meaning_open_are_refused(refused, text):
    refused("more than one meaning", COLUMNS.meant_by, text)


@pytest.mark.parametrize(
    ("name", "filled", "measured"),
    [
        ("v_mag", [-1.0, -9.99, -9.999, -99.9], [-1.46, 9.99, 0.0]),
        ("rv_km_s", [-99.99, -999.0, -999.9, -9999.0, 999.9], [-9.99, -99.0, -99.9, 99.9, 0.0]),
        ("pm_ra_mas_yr", [-99.99, -9999.0, 9999.0, 99999.0], [-99.9, 999.0, -1.0, 9.0]),
        ("companion_delta_v_mag", [-9.99], [-9.9, -1.0, 9.99]),
        ("distance_pc", [9999.0], [9.99, 99.99, 999.0]),
    ],
)
def test_numbers_that_stand_for_missing_ones(name, filled, measured):
    assert all(map(QUANTITIES[name].is_fill, filled))
    assert not any(map(QUANTITIES[name].is_fill, measured))
