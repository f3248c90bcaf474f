"""SIMBAD's answers: old and new names, units and texts; what cannot be right is refused."""

from dataclasses import replace

import numpy as np
import pytest
from astropy import units as u

from catalogs import Cuts, RefreshError, TapService, queries
from catalogs.archives import ask, asked_columns
from catalogs.simbad import read_measurements, read_stars
from catalogs.table_files import RawTable, column_of

STARS, MEASUREMENTS = queries(Cuts())


def with_cells(given, cells):
    """The column with other cells, None where missing."""
    return column_of(given.heading, given.unit, cells)


def answered(simbad, query=STARS):
    """Columns of an answer by their headings, to be altered."""
    return {column.heading: column for column in ask(TapService(retries=0), simbad.url, query).columns}


def table(columns):
    return RawTable("the answer", list(columns.values()))


def both(simbad):
    return read_stars(table(answered(simbad))), read_measurements(table(answered(simbad, MEASUREMENTS)))


def column(rows, name):
    return np.array([row.get(name, np.nan) for row in rows])


def same(one, two):
    assert [row.keys() for row in one] == [row.keys() for row in two]
    for name in one[0]:
        values, others = ([row.get(name) for row in rows] for rows in (one, two))
        if name in ("main_id", "sp_type", "object_type", "ids", "bibcode"):
            assert values == others
        else:
            np.testing.assert_array_equal(np.array(values, float), np.array(others, float), err_msg=name)


def test_values_are_those_of_the_tables(simbad, sky):
    answer, measurements = both(simbad)
    by_name = {" ".join(star[1].split()): star for star in sky.STARS}
    names = "ra_deg dec_deg parallax_mas parallax_err_mas pm_ra_mas_yr pm_dec_mas_yr rv_km_s b_mag v_mag".split()
    for star in answer:
        _, _, ra, dec, plx, err, pmra, pmdec, rv, sp_type, otype, b, v, ids = by_name[star["main_id"]]
        expected = [ra, dec, plx, err, pmra, pmdec, rv, b, v]
        found = [star[name] for name in names]
        np.testing.assert_allclose(found, [np.nan if x is None else x for x in expected], rtol=1e-6)
        assert star["sp_type"] == (sp_type or "")
        assert star["object_type"] == otype
        assert star["ids"] == tuple(" ".join(name.split()) for name in (ids or "").split("|") if name)
    assert len(measurements) == sum(row[0] != 14 for row in sky.MEASUREMENTS)


def test_white_space_of_identifiers_is_normalised(simbad):
    answer, _ = both(simbad)
    ids = {star["main_id"]: star["ids"] for star in answer}
    assert "* alf Cen A" in ids["* alf Cen A"]
    assert "GJ 559 B" in ids["* alf Cen B"]


def test_misprints_of_the_literature_count_as_missing(simbad):
    _, measurements = both(simbad)
    odd = next(row for row in measurements if row["bibcode"] == "1901ApJ.....1....1X")
    assert not odd.keys() & {"teff_k", "metallicity"}


@pytest.mark.parametrize("names", ["OLD_NAMES", "PARENTHESES"])
def test_old_names_of_the_columns_are_understood(simbad, tap, names):
    new = both(simbad)
    simbad.rename = getattr(tap, names)
    for one, two in zip(new, both(simbad), strict=True):
        same(one, two)


def test_every_column_that_is_asked_for_is_known(tap):
    for query, table in ((STARS, "simbad_stars"), (MEASUREMENTS, "simbad_measurements")):
        asked = {column for _, column, _ in tap.parse(query)[1]["select"]} - {"mespos"}  # of the order of the list
        listed = asked_columns(table)
        forms = {form: name for name, row in listed.items() for form in (name, *row["headings"].split())}
        assert {forms[column.replace("_", "") if column not in forms else column] for column in asked} == set(listed)


def test_positions_in_hours_and_units_of_another_kind_are_converted(simbad):
    answer, _ = both(simbad)
    columns = answered(simbad)
    from astropy.coordinates import SkyCoord

    sky = SkyCoord(column(answer, "ra_deg") * u.deg, column(answer, "dec_deg") * u.deg)
    ra = sky.ra.to_string(unit="hourangle", sep=" ", precision=6).tolist()
    dec = sky.dec.to_string(unit="deg", sep=" ", precision=6, alwayssign=True).tolist()
    rv_m_s = [None if np.isnan(value) else 1000.0 * value for value in column(answer, "rv_km_s")]
    columns["ra"], columns["dec"] = column_of("ra", "", ra), column_of("dec", "", dec)
    columns["plx_value"] = column_of("plx_value", "arcsec", (column(answer, "parallax_mas") / 1000.0).tolist())
    columns["rvz_radvel"] = column_of("rvz_radvel", "m/s", rv_m_s)
    other = read_stars(table(columns))
    for name in ("ra_deg", "dec_deg", "parallax_mas", "rv_km_s"):
        np.testing.assert_allclose(column(other, name), column(answer, name), atol=1e-8)


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
        (lambda columns: columns.pop("plx_value"), "no column parallax_mas"),
        (lambda columns: columns.update(V=replace(columns["V"], heading="Vega")), "no column v_mag"),
        (rows(lambda cells: [cells[0], *cells]), "2 rows are of one name; same oid"),
        (change("plx_value", None), "column plx_value = missing"),
        (change("plx_value", -3.0), r"column plx_value = -3.0 mas"),
        (change("V", None), "column V = missing"),
        (change("V", 99.9), r"column V = 99.9.*-30 to 30"),
        (change("ra", 361.0), "column ra = 361.0 deg"),
        (change("dec", None), "column dec = missing"),
        (change("oid", None), "column oid = missing"),
        (change("main_id", None), "row 1 column main_id = missing"),
        (fill("pmra", "fast"), "column pmra = fast"),
        (fill("ra", "12 xx 4"), "column ra = 12 xx 4"),
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
    with pytest.raises(RefreshError, match="no column metallicity"):
        read_measurements(table(columns))


def test_numbers_in_texts_are_read(simbad):
    columns = answered(simbad)
    expected = read_stars(table(columns))
    columns["pmra"] = with_cells(
        columns["pmra"], [str(cell) if cell else cell for cell in columns["pmra"].cells.tolist()]
    )
    same(expected, read_stars(table(columns)))
