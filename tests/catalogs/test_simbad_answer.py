"""SIMBAD's answers: old and new names, units and texts; what cannot be right is refused."""

import numpy as np
import pytest
from astropy import units as u
from astropy.table import MaskedColumn, Table

from catalogs import Cuts, RefreshError, TapService, queries, simbad_answer
from catalogs.simbad import ask
from catalogs.simbad_answer import read_measurements, read_stars

STARS, MEASUREMENTS = queries(Cuts())


def both(simbad):
    service = TapService(url=simbad.url, retries=0)
    return read_stars(ask(service, STARS)), read_measurements(ask(service, MEASUREMENTS))


def same(one, two):
    for name, values in vars(one).items():
        if isinstance(values, list):
            assert values == getattr(two, name), name
        else:
            np.testing.assert_array_equal(values, getattr(two, name), err_msg=name)


def test_values_are_those_of_the_tables(simbad, sky):
    answer, measurements = both(simbad)
    by_name = {" ".join(star[1].split()): star for star in sky.STARS}
    for i, name in enumerate(answer.main_id):
        _, _, ra, dec, plx, err, pmra, pmdec, rv, sp_type, otype, b, v, ids = by_name[name]
        expected = [ra, dec, plx, err, pmra, pmdec, rv, b, v]
        found = [
            answer.ra_deg[i],
            answer.dec_deg[i],
            answer.parallax_mas[i],
            answer.parallax_err_mas[i],
            answer.pm_ra_mas_yr[i],
            answer.pm_dec_mas_yr[i],
            answer.rv_km_s[i],
            answer.b_mag[i],
            answer.v_mag[i],
        ]
        np.testing.assert_allclose(found, [np.nan if x is None else x for x in expected], rtol=1e-6)
        assert answer.sp_type[i] == (sp_type or "")
        assert answer.object_type[i] == otype
        assert answer.ids[i] == tuple(" ".join(name.split()) for name in (ids or "").split("|") if name)
    assert len(measurements) == sum(row[0] != 14 for row in sky.MEASUREMENTS)


def test_white_space_of_identifiers_is_normalised(simbad):
    answer, _ = both(simbad)
    assert "* alf Cen A" in answer.ids[answer.main_id.index("* alf Cen A")]
    assert "GJ 559 B" in answer.ids[answer.main_id.index("* alf Cen B")]


def test_misprints_of_the_literature_count_as_missing(simbad):
    _, measurements = both(simbad)
    odd = measurements.bibcode.index("1901ApJ.....1....1X")
    assert np.isnan(measurements.teff_k[odd])
    assert np.isnan(measurements.fe_h[odd])


@pytest.mark.parametrize("names", ["OLD_NAMES", "PARENTHESES"])
def test_old_names_of_the_columns_are_understood(simbad, tap, names):
    new = both(simbad)
    simbad.rename = getattr(tap, names)
    for one, two in zip(new, both(simbad), strict=True):
        same(one, two)


def test_every_column_that_is_asked_for_is_known(tap):
    for query, columns in ((STARS, simbad_answer.STARS), (MEASUREMENTS, simbad_answer.MEASUREMENTS)):
        asked = {column for _, column, _ in tap.parse(query)[1]["select"]} - {"mespos"}  # of the order of the list
        assert {columns.meant_by(column)[0].name for column in asked} == set(columns)


def test_positions_in_hours_and_units_of_another_kind_are_converted(simbad):
    answer, _ = both(simbad)
    table = ask(TapService(url=simbad.url), STARS)
    from astropy.coordinates import SkyCoord

    sky = SkyCoord(answer.ra_deg * u.deg, answer.dec_deg * u.deg)
    table["ra"] = sky.ra.to_string(unit="hourangle", sep=" ", precision=6)
    table["dec"] = sky.dec.to_string(unit="deg", sep=" ", precision=6, alwayssign=True)
    table["plx_value"] = MaskedColumn(answer.parallax_mas / 1000.0, unit="arcsec")
    table["rvz_radvel"] = MaskedColumn(answer.rv_km_s * 1000.0, unit="m/s")
    other = read_stars(table)
    np.testing.assert_allclose(other.ra_deg, answer.ra_deg, atol=1e-8)
    np.testing.assert_allclose(other.dec_deg, answer.dec_deg, atol=1e-8)
    np.testing.assert_allclose(other.parallax_mas, answer.parallax_mas)
    np.testing.assert_allclose(other.rv_km_s, answer.rv_km_s)


def change(column, value, row=0):
    def alter(table: Table) -> None:
        values = table[column].tolist()
        values[row] = value
        mask = [cell is None for cell in values]
        fill = "" if isinstance(value, str) else 0.0
        table[column] = MaskedColumn([fill if cell is None else cell for cell in values], mask=mask)

    return alter


@pytest.mark.parametrize(
    ("alter", "words"),
    [
        (lambda table: table.remove_rows(slice(None)), "no star"),
        (lambda table: table.remove_column("plx_value"), "column parallax_mas = missing"),
        (lambda table: table.rename_column("V", "Vega"), "column v_mag = missing"),
        (lambda table: table.insert_row(1, table[0]), "rows 1 and 2 are of one name; same oid"),
        (change("plx_value", None), "column plx_value = missing"),
        (change("plx_value", float("nan")), "column plx_value = missing"),
        (change("plx_value", -3.0), r"column plx_value = -3.0 mas"),
        (change("V", None), "column V = missing"),
        (change("V", 99.9), r"column V = 99.9.*-30 to 30"),
        (change("ra", 361.0), "column ra = 361.0 deg"),
        (change("dec", None), "column dec = missing"),
        (change("oid", None), "column oid = missing"),
        (change("main_id", ""), "row 1 column main_id = missing"),
        (lambda table: table.replace_column("pmra", ["fast"] * len(table)), "column pmra = fast"),
        (lambda table: table.replace_column("ra", ["12 xx 4"] * len(table)), "column ra = unreadable"),
        (lambda table: setattr(table["plx_value"], "unit", "kg"), "column plx_value = unit kg.*like mas"),
    ],
)
def test_what_cannot_be_right_is_refused_in_one_line(simbad, alter, words):
    table = ask(TapService(url=simbad.url), STARS)
    alter(table)
    with pytest.raises(RefreshError, match=words) as failure:
        read_stars(table)
    assert "\n" not in str(failure.value)


def test_no_measurements_at_all_are_fine_but_a_lost_column_is_not(simbad):
    table = ask(TapService(url=simbad.url), MEASUREMENTS)
    assert len(read_measurements(table[:0])) == 0
    table.remove_column("fe_h")
    with pytest.raises(RefreshError, match="fe_h"):
        read_measurements(table)


def test_bytes_and_numbers_in_texts_are_read(simbad):
    table = ask(TapService(url=simbad.url), STARS)
    expected = read_stars(table)
    table["main_id"] = [str(name).encode() for name in table["main_id"]]
    table["pmra"] = ["" if np.isnan(value) else repr(value) for value in expected.pm_ra_mas_yr.tolist()]
    same(expected, read_stars(table))
