import numpy as np
import pytest

from catalogs.stars import load_stars
from cpic_planner.report.names import full_name, pretty_name


@pytest.mark.parametrize(
    ("identifier", "expected"),
    [
        ("* alf Cen B", "α Cen B"),
        ("* tau Cet", "τ Cet"),
        ("tau Cet", "τ Cet"),
        ("HD  10700", "HD 10700"),
        ("V* AK Lep", "AK Lep"),
        ("V* V538 Aur", "V538 Aur"),
        ("NAME Proxima Centauri", "Proxima Centauri"),
        ("* pi.03 Ori", "π³ Ori"),
        ("* alf01 Cen", "α¹ Cen"),
        ("*  61 Cyg A", "61 Cyg A"),
        ("* ksi Boo A", "ξ Boo A"),
        ("* e Eri", "e Eri"),
        ("* b03 Cyg", "b³ Cyg"),
        ("** STF 60A", "STF 60A"),
        ("* mu.02 Cnc", "μ² Cnc"),
        ("HIP 8102", "HIP 8102"),
        ("ups Foo", "ups Foo"),
        ("<script>", "<script>"),
        ("", ""),
    ],
)
def test_pretty_name(identifier, expected):
    assert pretty_name(identifier) == expected


def test_full_name():
    assert full_name("* tau Cet", 8102) == "τ Cet (HIP 8102)"
    assert full_name("HIP 8102", 8102) == "HIP 8102"
    assert full_name("* tau Cet", None) == "τ Cet"


def test_catalogue_names_stay_distinct_and_short():
    names = [pretty_name(str(name)) for name in np.asarray(load_stars().column("name"))]
    assert len(set(names)) == len(names)
    assert max(map(len, names)) <= 18
