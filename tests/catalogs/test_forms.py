"""One table of real stars in every form that libraries write it in: values, units and gaps are read as they were."""

import csv
import io
import tempfile
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from astropy import units as u
from astropy.io import fits
from astropy.table import MaskedColumn, Table

from catalogs import table_files
from catalogs.table_files import TableBytes, parse_table

STARS = Table(
    {
        "name": ["tau Cet", "eps Eri", "alf Aqr"],
        "ra": [26.01701, 53.23269, 331.44598] * u.deg,
        "dec": [-15.93748, -9.45826, -0.31985] * u.deg,
        "plx": [273.81, 310.577, 6.23] * u.mas,
        "pm_ra": [-1721.05, -975.17, 18.25] * u.mas / u.yr,
        "v_mag": MaskedColumn([3.49, 3.72, 0.0], mask=[False, False, True], unit="mag"),
        "sp_type": MaskedColumn(["G8V", "K2V", ""], mask=[False, False, True]),
        "hip": [8102, 16537, 109074],
    }
)
UNITS = {name: STARS[name].unit for name in STARS.colnames}
FRAME = pd.DataFrame(
    {name: [None if cell is np.ma.masked else cell for cell in STARS[name].value] for name in STARS.colnames}
)


def of_astropy(kind, **options):
    """The stars as astropy writes them."""
    file = io.BytesIO() if kind in ("fits", "votable") else io.StringIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        STARS.write(file, format=kind, **options)
    return file.getvalue()


def parquet_of_astropy():
    """The stars as astropy keeps them in Parquet: units and gaps in a way of its own."""
    with tempfile.TemporaryDirectory() as folder:
        STARS.write(f"{folder}/stars.parquet", format="parquet")
        return Path(folder, "stars.parquet").read_bytes()


def of_pandas(kind, **options):
    """The stars as pandas writes them."""
    if kind in ("parquet", "excel"):
        file = io.BytesIO()
        getattr(FRAME, f"to_{kind}")(file, **options)
        return file.getvalue()
    return getattr(FRAME, f"to_{kind}")(**options)


def of_tabulate(kind):
    """The stars as tabulate writes them, if it is installed."""
    return pytest.importorskip("tabulate").tabulate(FRAME, "keys", kind, showindex=False, floatfmt="", missingval="")


def rows(gap=""):
    return [[gap if pd.isna(cell) else str(cell) for cell in row] for row in FRAME.itertuples(index=False)]


def of_csv(gap="", heading=tuple(STARS.colnames), **options):
    """The stars as the csv module writes them."""
    file = io.StringIO(newline="")
    csv.writer(file, **options).writerows([heading, *rows(gap)])
    return file.getvalue()


def savetxt():
    file = io.StringIO()
    cells = np.array([[cell.replace(" ", "_") for cell in row] for row in rows("nan")])
    np.savetxt(file, cells, fmt="%s", header="Stars near us\n" + " ".join(STARS.colnames))
    return (
        file.getvalue().replace("tau_Cet", '"tau Cet"').replace("eps_Eri", '"eps Eri"').replace("alf_Aqr", '"alf Aqr"')
    )


def vizier(mark, gap=""):
    """The stars as VizieR lets them be downloaded: comments, headings, units, dashes, rows."""
    units = ["" if unit is None else unit.to_string("cds") for unit in UNITS.values()]
    table = [STARS.colnames, units, ["-" * (len(name) + 1) for name in STARS.colnames], *rows(gap)]
    head = "#\n#   VizieR Astronomical Server vizier.cds.unistra.fr\n#INFO\t-out.max=50\t\n#\n#RESOURCE=yCat_1239\n"
    head += "#Table\tI_239_hip_main:\n#Column\tplx\t(F7.2)\t? Trigonometric parallax\t[ucd=pos.parallax.trig]\n"
    return head + "\n".join(mark.join(row) for row in table) + "\n\n#Table\tother:\na\tb\n \t \n-\t--\n1\t2\n"


def simbad():
    """The stars as scripts and lists of SIMBAD give them."""
    wide = [max(map(len, column)) for column in zip(STARS.colnames, *rows("~"), strict=True)]
    lines = ["C.D.S.  -  SIMBAD4 rel 1.8  -  2026.11.01CET01:02:03\n", "Number of objects : 3\n"]
    lines.append("#|" + "|".join(name.center(width) for name, width in zip(STARS.colnames, wide, strict=True)))
    lines.append("-|" + "|".join("-" * width for width in wide))
    for number, row in enumerate(rows("~"), start=1):
        lines.append(f"{number}|" + "|".join(cell.ljust(width) for cell, width in zip(row, wide, strict=True)))
    return "\n".join(lines) + f"\n\n{'=' * 80}\n"


def ascii_fits():
    """The stars as a table extension of text, which states its nulls."""
    forms = dict(zip(STARS.colnames, ("A8", "F10.5", "F10.5", "F8.3", "F9.2", "F6.2", "A4", "I7"), strict=True))
    columns = []
    for name, form in forms.items():
        cells = np.ma.filled(STARS[name], 99.99 if name == "v_mag" else "").data
        unit = None if UNITS[name] is None else UNITS[name].to_string("fits")
        null = "---" if name == "v_mag" else None
        columns.append(fits.Column(name, form, unit, null, ascii=True, array=cells))
    file = io.BytesIO()
    fits.TableHDU.from_columns(columns).writeto(file)
    return file.getvalue().replace(b" 99.99", b"   ---")


def titled_excel():
    """A workbook with a title above the table and a second sheet."""
    file = io.BytesIO()
    with pd.ExcelWriter(file) as book:
        FRAME.to_excel(book, sheet_name="stars", startrow=2, startcol=1, index=False)
        book.sheets["stars"]["A1"] = "Table 1. Nearby stars"
        FRAME.to_excel(book, sheet_name="again")
    return file.getvalue()


def with_units():
    return of_csv().replace(
        "\r\n", "\r\n" + ",".join("" if unit is None else str(unit) for unit in UNITS.values()) + "\n", 1
    )


def spreadsheet():
    """CSV with separators behind the last column, and blank rows."""
    lines = of_csv(heading=(*STARS.colnames, "")).replace("\r\n", ",\r\n").splitlines()
    return "\r\n".join([lines[0][:-1], *lines[1:], "," * len(STARS.colnames), "," * len(STARS.colnames), ""])


CARRY_UNITS = {
    "ECSV": lambda: of_astropy("ascii.ecsv"),
    "ECSV with commas": lambda: of_astropy("ascii.ecsv", delimiter=","),
    "VOTable TABLEDATA": lambda: of_astropy("votable", tabledata_format="tabledata"),
    "VOTable BINARY": lambda: of_astropy("votable", tabledata_format="binary"),
    "VOTable BINARY2": lambda: of_astropy("votable", tabledata_format="binary2"),
    "FITS": lambda: of_astropy("fits"),
    "FITS in ASCII": ascii_fits,
    "Parquet of astropy": parquet_of_astropy,
    "MRT": lambda: of_astropy("ascii.mrt"),
    "IPAC": lambda: of_astropy("ascii.ipac"),
    "LaTeX": lambda: of_astropy("ascii.latex"),
    "AASTeX": lambda: of_astropy("ascii.aastex"),
    "VizieR with tabs": lambda: vizier("\t"),
    "VizieR with semicolons": lambda: vizier(";"),
    "VizieR with bars": lambda: vizier("|", gap=" "),
    "units below the headings": with_units,
}
FORMS = CARRY_UNITS | {
    "CSV": lambda: of_astropy("ascii.csv"),
    "tab": lambda: of_astropy("ascii.tab"),
    "rdb": lambda: of_astropy("ascii.rdb"),
    "blanks": lambda: of_astropy("ascii.basic"),
    "commented heading": lambda: of_astropy("ascii.commented_header"),
    "fixed width": lambda: of_astropy("ascii.fixed_width"),
    "two lines": lambda: of_astropy("ascii.fixed_width_two_line"),
    "two lines, wide": lambda: of_astropy("ascii.fixed_width_two_line", delimiter_pad=" "),
    "reStructuredText": lambda: of_astropy("ascii.rst"),
    "HTML": lambda: of_astropy("ascii.html"),
    "numpy": savetxt,
    "pandas, decimal commas": lambda: of_pandas("csv", sep=";", decimal=","),
    "pandas, tabs and decimal commas": lambda: of_pandas("csv", sep="\t", decimal=",", index=False),
    "pandas, tabs": lambda: of_pandas("csv", sep="\t"),
    "pandas, bars": lambda: of_pandas("csv", sep="|", na_rep="NULL"),
    "pandas, quoted": lambda: of_pandas("csv", quoting=csv.QUOTE_ALL, na_rep="NaN"),
    "Parquet": lambda: of_pandas("parquet"),
    "Excel": lambda: of_pandas("excel"),
    "Excel with a title": titled_excel,
    "pandas in HTML": lambda: of_pandas("html"),
    "pandas in LaTeX": lambda: of_pandas("latex", float_format=repr),
    "pandas as text": lambda: of_pandas("string", index=False, float_format=str, col_space=12),
    "Markdown": lambda: of_tabulate("pipe"),
    "psql": lambda: of_tabulate("psql"),
    "presto": lambda: of_tabulate("presto") + "\n(3 rows)\n",
    "grid": lambda: of_tabulate("grid"),
    "simple": lambda: of_tabulate("simple"),
    "orgtbl": lambda: of_tabulate("orgtbl"),
    "SIMBAD": simbad,
    "CSV of a spreadsheet": spreadsheet,
    "CSV with a byte-order mark": lambda: of_csv().encode("utf-8-sig"),
    "CSV in UTF-16": lambda: of_csv().encode("utf-16"),
    "CSV of an old Mac": lambda: of_csv().replace("\r\n", "\r"),
    "CSV with blanks": lambda: of_csv().replace(",", ", "),
    "CSV of a database": lambda: of_csv(gap=r"\N"),
}


def bytes_of(form):
    made = FORMS[form]()
    return made if isinstance(made, bytes) else made.encode()


def by_heading(table):
    return {column.heading: column for column in table.columns}


def check(table, *, units):
    """The columns hold what the stars have, in numbers or in texts that are the same numbers."""
    found = by_heading(table)
    for name in STARS.colnames:
        given, cells = STARS[name], found[name].cells
        assert cells.ndim == 1
        assert np.ma.getmaskarray(cells).tolist() == np.ma.getmaskarray(given).tolist(), name
        read = [
            type(value)(cell) for cell, value in zip(cells.compressed(), np.ma.compressed(given.value), strict=True)
        ]
        assert read == np.ma.compressed(given.value).tolist(), name
        if units:
            assert u.Unit(found[name].unit) == (UNITS[name] or u.one), name
    assert not table.rejects


@pytest.mark.parametrize("form", FORMS)
def test_every_form_of_the_same_stars_is_read_alike(form):
    check(parse_table(TableBytes("mine", bytes_of(form), "")), units=form in CARRY_UNITS)


def test_forms_are_many():
    assert len(FORMS) >= 40


@pytest.mark.parametrize(
    "text",
    [
        *("CSV", "tab", "rdb", "pandas, decimal commas", "pandas, bars", "pandas, quoted", "VizieR with tabs"),
        *("CSV of a spreadsheet", "CSV of an old Mac", "CSV with blanks", "units below the headings", "psql"),
        "a,b\n1,2\n3\n4,5,6\n7,8\n",
        "a,b\n1,2\n3,4,\n,\n\n7\n5,6,,\n7,8,9\n",
        'a,b\n"1\n2",3\n"4","5,6"\n7\n',
        'a\tb\n5" x\t1\n"Barn"ard\t2\n',
        "# OVERFLOW\na,b\n1,2\n# a remark\n3,4\n",
        "a;b\n1,5;x\n-;y\n,5;z,z\n",
    ],
)
def test_large_files_are_read_as_small_ones(monkeypatch, text):
    data = bytes_of(text) if text in FORMS else text.encode()
    small = parse_table(TableBytes("mine", data, ""))
    monkeypatch.setattr(table_files, "_SMALL_BYTES", 0)
    large = parse_table(TableBytes("mine", data, ""))
    assert [(item.heading, item.unit, item.description, item.ucd) for item in small.columns] == [
        (item.heading, item.unit, item.description, item.ucd) for item in large.columns
    ]
    assert [item.cells.tolist() for item in small.columns] == [item.cells.tolist() for item in large.columns]
    assert (small.notes, small.rejects) == (large.notes, large.rejects)
