"""SIMBAD's answers: old and new names, units and texts; what cannot be right is refused."""

from dataclasses import replace

import numpy as np
import pytest
from astropy import units as u

from catalogs import Cuts, RefreshError, TapService, queries, simbad_answer
from catalogs.simbad_answer import read_measurements, read_stars
from catalogs.table_files import RawTable, column_of
from catalogs.tap_client import ask

STARS, MEASUREMENTS = queries(Cuts())


def answered(simbad, query=STARS):
    """Columns of an answer by their headings, to be altered."""
    return {column.heading: column for column in ask(TapService(retries=0), simbad.url, query).columns}


def with_cells(column, cells):
    return column_of(column.heading, column.unit, cells)


def table(columns):
    return RawTable("the answer", list(columns.values()))


def both(simbad):
    return read_stars(table(answered(simbad))), read_measurements(table(answered(simbad, MEASUREMENTS)))


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
    columns = answered(simbad)
    from astropy.coordinates import SkyCoord

    sky = SkyCoord(answer.ra_deg * u.deg, answer.dec_deg * u.deg)
    ra = sky.ra.to_string(unit="hourangle", sep=" ", precision=6).tolist()
    dec = sky.dec.to_string(unit="deg", sep=" ", precision=6, alwayssign=True).tolist()
    rv_m_s = [None if np.isnan(value) else 1000.0 * value for value in answer.rv_km_s.tolist()]
    columns["ra"], columns["dec"] = column_of("ra", "", ra), column_of("dec", "", dec)
    columns["plx_value"] = column_of("plx_value", "arcsec", (answer.parallax_mas / 1000.0).tolist())
    columns["rvz_radvel"] = column_of("rvz_radvel", "m/s", rv_m_s)
    other = read_stars(table(columns))
    np.testing.assert_allclose(other.ra_deg, answer.ra_deg, atol=1e-8)
    np.testing.assert_allclose(other.dec_deg, answer.dec_deg, atol=1e-8)
    np.testing.assert_allclose(other.parallax_mas, answer.parallax_mas)
    np.testing.assert_allclose(other.rv_km_s, answer.rv_km_s)


def change(name, value):
    """Change the first cell of a column."""

    def alter(columns):
        columns[name] = with_cells(columns[name], [value, *columns[name].cells.tolist()[1:]])

    return alter


def fill(name, value):
    """Change all cells of a column."""

    def alter(columns):
        columns[name] = with_cells(columns[name], [value] * len(columns[name].cells))

    return alter


def rows(choose):
    """Choose other rows."""

    def alter(columns):
        for name, column in columns.items():
            columns[name] = with_cells(column, choose(column.cells.tolist()))

    return alter


@pytest.mark.parametrize(
    ("alter", "words"),
    [
        (rows(lambda cells: []), "no star"),
        (lambda columns: columns.pop("plx_value"), "column parallax_mas = missing"),
        (lambda columns: columns.update(V=replace(columns["V"], heading="Vega")), "column v_mag = missing"),
        (rows(lambda cells: [cells[0], *cells]), "rows 1 and 2 are of one name; same oid"),
        (change("plx_value", None), "column plx_value = missing"),
        (change("plx_value", -3.0), r"column plx_value = -3.0 mas"),
        (change("V", None), "column V = missing"),
        (change("V", 99.9), r"column V = 99.9.*-30 to 30"),
        (change("ra", 361.0), "column ra = 361.0 deg"),
        (change("dec", None), "column dec = missing"),
        (change("oid", None), "column oid = missing"),
        (change("main_id", None), "row 1 column main_id = missing"),
        (fill("pmra", "fast"), "column pmra = fast"),
        (fill("ra", "12 xx 4"), "column ra = unreadable"),
        (
            lambda columns: columns.update(plx_value=replace(columns["plx_value"], unit="kg")),
            "column plx_value = unit kg.*like mas",
        ),
    ],
)
def test_what_cannot_be_right_is_refused_in_one_line(simbad, alter, words):
    columns = answered(simbad)
    alter(columns)
    with pytest.raises(RefreshError, match=words) as failure:
        read_stars(table(columns))
    assert "\n" not in str(failure.value)


def test_no_measurements_at_all_are_fine_but_a_lost_column_is_not(simbad):
    columns = answered(simbad, MEASUREMENTS)
    assert len(read_measurements(table({name: with_cells(column, []) for name, column in columns.items()}))) == 0
    del columns["fe_h"]
    with pytest.raises(RefreshError, match="fe_h"):
        read_measurements(table(columns))


def test_numbers_in_texts_are_read(simbad):
    columns = answered(simbad)
    expected = read_stars(table(columns))
    columns["pmra"] = with_cells(
        columns["pmra"], [str(cell) if cell else cell for cell in columns["pmra"].cells.tolist()]
    )
    same(expected, read_stars(table(columns)))
