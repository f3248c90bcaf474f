"""What the archive's best masses, limits and inclinations become."""

import pytest

from catalogs.known_planets import reference_text, settle

MASS = {"best_mass_mjup": 2.0, "best_mass_err_mjup": 0.1}


@pytest.mark.parametrize(
    ("numbers", "kind", "expected", "flags"),
    [
        ({}, "Mass", {"mass_mjup": 2.0, "mass_err_mjup": 0.1}, ()),
        ({}, "Msini", {"msini_mjup": 2.0, "msini_err_mjup": 0.1}, ()),
        ({}, "M-R relationship", {}, ()),
        ({"msini_mjup": 1.0}, "Mass", {"mass_mjup": 2.0, "mass_err_mjup": 0.1, "msini_mjup": 1.0}, ()),
        ({"best_mass_limit": 1.0}, "Mass", {"mass_mjup": 2.0, "mass_err_mjup": 0.1}, ("mass_upper_limit",)),
        ({"best_mass_limit": -1.0}, "Mass", {"msini_mjup": 2.0, "msini_err_mjup": 0.1}, ("mass_lower_limit",)),
        ({"inclination_deg": 90.0}, "Mass", {"msini_mjup": 2.0, "msini_err_mjup": 0.1}, ("edge_on_assumed",)),
        (
            {"inclination_deg": 90.0, "inclination_err_deg": 0.1},
            "Mass",
            {"inclination_deg": 90.0, "inclination_err_deg": 0.1, "mass_mjup": 2.0, "mass_err_mjup": 0.1},
            (),
        ),
        (
            {"eccentricity": 0.3, "eccentricity_limit": 1.0},
            "M-R relationship",
            {"eccentricity": 0.3},
            ("eccentricity_upper_limit",),
        ),
        ({"controversial": 1.0}, "M-R relationship", {}, ("controversial",)),
    ],
)
def test_settled(numbers, kind, expected, flags):
    assert settle(MASS | numbers, kind, "a row") == (expected, flags)


def test_a_table_without_best_masses_is_left_alone():
    own = {"mass_mjup": 1.0, "inclination_deg": 90.0}
    assert settle(own, "", "a row") == (own, ())


def test_an_unknown_kind_is_refused(refused):
    refused("a row column best_mass_kind = Guess", settle, dict(MASS), "Guess", "a row")


def test_links_become_words_with_their_bibcode():
    link = "<a refstr=X href=http://adsabs.harvard.edu/abs/2013A%26A...551A..90M target=ref> Marmier et al. 2013 </a>"
    assert reference_text(link) == "Marmier et al. 2013 (2013A&A...551A..90M)"
    assert reference_text("Gregory &amp; Fischer 2010") == "Gregory & Fischer 2010"
