"""Headings of tables: which quantity and unit they mean."""

import pytest

from catalogs import QUANTITIES
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
        ("nonsense", None),
        ("", None),
    ],
)
def test_heading_to_quantity(text, name):
    quantity, unit = QUANTITIES.meant_by(text)
    assert (quantity.name if quantity else None) == name
    assert unit == ("mas" if "[mas]" in text else "")


def test_no_heading_means_two_things():
    forms = [form for item in QUANTITIES.values() for form in (heading(item.name), *item.headings)]
    assert len(forms) == len(set(forms))
    assert all(form == heading(form) for form in forms)
