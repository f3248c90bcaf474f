"""Answers in the forms in which SIMBAD and the NASA Exoplanet Archive send them: columns, units, types and statuses.

The forms are those of recorded answers: SIMBAD's TAP service (taplib: a stream in BINARY, statuses and provider as
INFO; columns, types and units as its TAP_SCHEMA of 2024-03 lists them, recorded in the tests of astroquery), and the
archive's TAP service (TABLEDATA; units as its users reported them, astroquery issues 2130 and 3187, and as astroquery
knows them, BJD among them). The few facts are those of SIMBAD and of the archive's table ``ps`` for the stars named
here; the last row of each has what is missing. Queries: `catalogs.queries` and `catalogs.PLANETS_QUERY`.
"""

import base64
import struct
from xml.sax.saxutils import escape, quoteattr

import pytest

from catalogs import RefreshError, TapService, load_stars
from catalogs.archives import ask, read_answer
from catalogs.exoplanet_archive import read_archive
from catalogs.simbad import read_measurements, read_stars
from catalogs.table_files import RawTable, column_of

NO_LONG, NO_INT = -(2**63), -(2**31)
STARS = [
    ("oid", "long", "", (1431926, 1526399, 1466021)),
    ("main_id", "char", "", ("* tau Cet", "* eps Eri", "HD 999003")),
    ("ra", "double", "deg", (26.0170132, 53.2326873, 50.0)),
    ("dec", "double", "deg", (-15.9374787, -9.4582587, 30.0)),
    ("plx_value", "double", "mas", (273.81, 310.5773, 40.3)),
    ("plx_err", "float", "mas", (0.17, 0.1355, None)),
    ("pmra", "double", "mas.yr-1", (-1721.05, -974.758, None)),
    ("pmdec", "double", "mas.yr-1", (854.16, 20.876, None)),
    ("rvz_radvel", "double", "km.s-1", (-16.68, 16.376, None)),
    ("sp_type", "char", "", ("G8V", "K2V", None)),
    ("otype", "char", "", ("PM*", "BY*", "*")),
    ("B", "double", "mag", (4.22, 4.61, None)),
    ("V", "double", "mag", (3.5, 3.73, 5.9)),
    ("ids", "char", "", ("* tau Cet|HD  10700|HIP 8102", "*  18 Eri|* eps Eri|HD  22049|HIP 16537", None)),
]
MEASUREMENTS = [
    ("oidref", "long", "", (1431926, 1526399, 1526399)),
    ("teff", "int", "K", (5344, 5076, None)),
    ("log_g", "float", "log(cm.s-2)", (4.42, 4.57, None)),
    ("fe_h", "float", "", (-0.52, -0.09, -0.13)),
    ("bibcode", "char", "", ("2013MNRAS.428.3164M", "2015A&A...582A..49H", "2005ApJS..159..141V")),
    ("mespos", "short", "", (1, 1, 2)),
]
PACKED = {"long": ">q", "int": ">i", "short": ">h", "double": ">d", "float": ">f"}
NULLS = {"long": NO_LONG, "int": NO_INT, "short": -(2**15), "double": float("nan"), "float": float("nan")}


def field(name, kind, unit):
    """Return a FIELD as taplib writes it: texts of any length, a number for missing integers."""
    size = ' arraysize="*"' if kind == "char" else ""
    null = f'<VALUES null="{NULLS[kind]}"/>' if kind in ("long", "int", "short") else ""
    measured = f" unit={quoteattr(unit)}" if unit else ""
    return f'<FIELD ID={quoteattr(name)} datatype="{kind}"{size} name={quoteattr(name)}{measured}>{null}</FIELD>'


def packed(kind, value):
    """Return a cell of a stream: a text after its length, a missing number as the null of its type."""
    if kind == "char":
        text = (value or "").encode()
        return struct.pack(">i", len(text)) + text
    return struct.pack(PACKED[kind], NULLS[kind] if value is None else value)


def simbad_answer(columns, form):
    """Return the answer of SIMBAD's TAP service."""
    kinds = [kind for _, kind, _, _ in columns]
    rows = list(zip(*(cells for *_, cells in columns), strict=True))
    if form == "TABLEDATA":
        cells = ("".join(f"<TD>{'' if cell is None else escape(str(cell))}</TD>" for cell in row) for row in rows)
        data = "".join(f"<TR>{row}</TR>" for row in cells)
    else:
        stream = b""
        for row in rows:
            if form == "BINARY2":  # a bit for each missing cell, the highest first
                bits = "".join("1" if cell is None else "0" for cell in row)
                stream += int(bits.ljust(-len(bits) // 8 * -8, "0"), 2).to_bytes(-(-len(bits) // 8), "big")
            stream += b"".join(packed(kind, cell) for kind, cell in zip(kinds, row, strict=True))
        data = f"<STREAM encoding='base64'>\n{base64.encodebytes(stream).decode()}</STREAM>"
    fields = "".join(field(*column[:3]) for column in columns)
    return (
        "<?xml version='1.0' encoding='UTF-8'?>\n"
        '<VOTABLE version="1.4" xmlns="http://www.ivoa.net/xml/VOTable/v1.3">\n<RESOURCE type="results">\n'
        '<INFO name="QUERY_STATUS" value="OK"/>\n<INFO name="PROVIDER" value="CDS">SIMBAD TAP Service</INFO>\n'
        '<INFO name="QUERY"><![CDATA[SELECT b.oid FROM basic AS b WHERE f.V <= 7.5]]></INFO>\n'
        f'<TABLE ID="result_S1711442375218" name="result_S1711442375218">{fields}\n'
        f"<DATA><{form}>{data}</{form}></DATA></TABLE>\n</RESOURCE></VOTABLE>\n"
    ).encode()


@pytest.fixture
def answered(simbad):
    """Put a question to a service that sends this; return the answer."""

    def asking(data):
        simbad.mode, simbad.data = "data", (data,)
        return ask(TapService(retries=0, timeout_s=60.0), simbad.url, "SELECT b.oid FROM basic AS b")

    return asking


@pytest.mark.parametrize("form", ["BINARY", "BINARY2", "TABLEDATA"])
def test_simbads_stars_are_read_with_units_and_what_is_missing(answered, form):
    tau, eps, last = read_stars(answered(simbad_answer(STARS, form)))
    assert (tau["oid"], tau["main_id"], tau["v_mag"], tau["b_mag"]) == (1431926, "* tau Cet", 3.5, 4.22)
    assert (tau["parallax_mas"], tau["parallax_err_mas"]) == (273.81, 0.17), "as written, though of single precision"
    assert (eps["pm_ra_mas_yr"], eps["pm_dec_mas_yr"], eps["rv_km_s"]) == (-974.758, 20.876, 16.376)
    assert eps["ids"] == ("* 18 Eri", "* eps Eri", "HD 22049", "HIP 16537")
    missing = [name for name, cell in last.items() if cell != cell or cell in ("", ())]
    assert missing == ["parallax_err_mas", "pm_ra_mas_yr", "pm_dec_mas_yr", "rv_km_s", "sp_type", "b_mag", "ids"]


@pytest.mark.parametrize("form", ["BINARY", "BINARY2", "TABLEDATA"])
def test_simbads_measurements_are_read_with_what_is_missing(answered, form):
    tau, eps, last = read_measurements(answered(simbad_answer(MEASUREMENTS, form)))
    assert (tau["teff_k"], tau["log_g"], tau["metallicity"]) == (5344.0, 4.42, -0.52)
    assert (eps["oid"], eps["bibcode"]) == (1526399, "2015A&A...582A..49H")
    assert last == {"oid": 1526399, "metallicity": -0.13, "bibcode": "2005ApJS..159..141V"}


def test_simbads_refusal_is_given_with_its_reason(answered):
    said = 'Incorrect ADQL query:  Encountered ".". Was expecting one of: &lt;EOF&gt; "," ";" "ASC" "DESC" '
    data = simbad_answer(STARS, "TABLEDATA").decode()
    start, end = data.index('<INFO name="QUERY_STATUS"'), data.index("<INFO name='PROVIDER'".replace("'", '"'))
    refusal = f'{data[:start]}<INFO name="QUERY_STATUS" value="ERROR">{said}</INFO>{data[end:]}'
    table = refusal.index("<TABLE")
    refusal = f"{refusal[:table]}</RESOURCE></VOTABLE>"
    with pytest.raises(RefreshError, match=r"refused the query: Incorrect ADQL query: Encountered .*<EOF>"):
        answered(refusal.encode())


LINK = "<a refstr={} href=https://ui.adsabs.harvard.edu/abs/{}/abstract target=ref>{}</a>"
THOMPSON = LINK.format("THOMPSON_ET_AL__2025", "2025AJ....170..301T", "Thompson et al. 2025")
ROSENTHAL = LINK.format("ROSENTHAL_ET_AL__2021", "2021ApJS..255....8R", "Rosenthal et al. 2021")
PLANETS = [
    *((name, "char", "", cells) for name, cells in {
        "pl_name": ("eps Eri b", "47 UMa b"), "pl_letter": ("b", "b"), "hostname": ("eps Eri", "47 UMa"),
        "hd_name": ("HD 22049", "HD 95128"), "hip_name": ("HIP 16537", "HIP 53721"),
        "soltype": ("Published Confirmed",) * 2, "discoverymethod": ("Radial Velocity",) * 2,
        "pl_refname": (THOMPSON, ROSENTHAL), "pl_bmassprov": ("Mass", "Msini"), "pl_pubdate": ("2025-11", "2021-07"),
        "rowupdate": ("2025-12-11", "2021-09-20"),
    }.items()),
    ("default_flag", "int", "", (1, 1)),
    ("pl_controv_flag", "int", "", (0, 0)),
    ("ra", "double", "deg", (53.2282748, 164.8653)),
    ("dec", "double", "deg", (-9.4581716, 40.4302)),
    ("sy_dist", "double", "pc", (3.2026, 13.7967)),
]  # fmt: skip
MEASURED = {  # value, upper and lower error, limit, of both planets; in the archive's units
    "pl_orbper": ("day", (2678.0, 27.0, -29.0, 0), (1076.6, 2.1, -2.1, 0)),
    "pl_orbtper": ("day", (None,) * 4, (2451917.0, 60.0, -80.0, 0)),
    "pl_tranmid": ("BJD", (None,) * 4, (2451963.0, 9.0, -9.0, 0)),
    "pl_orbeccen": ("", (0.26, None, None, 1), (0.032, 0.014, -0.014, 0)),
    "pl_orblper": ("deg", (None,) * 4, (334.0, 23.0, -23.0, 0)),
    "pl_orbsmax": ("au", (3.53, 0.04, -0.04, 0), (2.1, 0.02, -0.02, 0)),
    "pl_msinij": ("Mjupiter", (None,) * 4, (2.45, 0.1, -0.1, 0)),
    "pl_bmassj": ("Mjupiter", (0.98, 0.1, -0.09, 0), (2.45, 0.1, -0.1, 0)),
    "pl_orbincl": ("deg", (40.0, 6.0, -5.0, 0), (None,) * 4),
    "pl_radj": ("Rjupiter", (None,) * 4, (None,) * 4),
    "st_mass": ("Msun", (0.82, 0.02, -0.02, 0), (1.06, None, None, 0)),
}


def archive_answer():
    """Return the answer of the NASA Exoplanet Archive: a table in text, with more columns than are read."""
    columns = [*PLANETS, ("st_logg", "double", "log(cm/s**2)", (4.6, 4.4)), ("sy_pnum", "int", "", (1, 3))]
    for name, (unit, one, other) in MEASURED.items():
        for number, end in enumerate(("", "err1", "err2", "lim")):
            kind, measured = ("int", "") if end == "lim" else ("double", unit)
            columns.append((f"{name}{end}", kind, measured, (one[number], other[number])))
    rows = zip(*(cells for *_, cells in columns), strict=True)
    cells = ("".join("<TD></TD>" if c is None else f"<TD>{escape(str(c))}</TD>" for c in row) for row in rows)
    fields = "".join(field(*column[:3]).replace("</FIELD>", "</FIELD>\n") for column in columns)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<VOTABLE version="1.3" xmlns="http://www.ivoa.net/xml/VOTable/v1.3">\n'
        '<RESOURCE type="results"><INFO name="QUERY_STATUS" value="OK"/>\n<TABLE>\n'
        f"{fields}<DATA><TABLEDATA>{''.join(f'<TR>{row}</TR>' for row in cells)}</TABLEDATA></DATA>"
        "</TABLE></RESOURCE></VOTABLE>"
    ).encode()


def test_the_archives_planets_are_read_with_units_errors_and_limits(answered):
    made = read_archive(answered(archive_answer()), load_stars())
    assert made.notes == ()
    assert made.left_out == {}
    uma, eps = made.rows
    assert (uma["planet"], eps["planet"]) == ("47 UMa b", "eps Eri b")
    assert (eps["period_days"], eps["period_err_days"]) == (2678.0, 28.0)
    assert (eps["semi_major_axis_au"], eps["mass_mjup"], eps["mass_err_mjup"]) == (3.53, 0.98, 0.095)
    assert (eps["inclination_deg"], eps["inclination_err_deg"], eps["star_mass_msun"]) == (40.0, 5.5, 0.82)
    assert eps["reference"] == "Thompson et al. 2025 (2025AJ....170..301T)"
    assert {"eccentricity_upper_limit", "phase_unknown"} <= set(eps["flags"].split(";"))
    assert (uma["msini_mjup"], uma["periastron_jd"], uma["periastron_err_days"]) == (2.45, 2451917.0, 70.0)
    assert (uma["conjunction_jd"], uma["conjunction_err_days"]) == (2451963.0, 9.0)
    assert (uma["omega_star_deg"], uma["eccentricity"], uma["updated"]) == (334.0, 0.032, "2021-09-20")
    assert not eps.keys() & {"periastron_jd", "radius_rjup", "eccentricity_err"}
    assert "star_mass_err_msun" not in uma


def test_a_service_with_other_rows_than_it_should_have_is_refused():
    def column(name, *cells):
        return column_of(name, "", list(cells))

    whole = [column("oidref", 1, 2), *(column(name, None, 1.0) for name in ("teff", "log_g", "fe_h", "bibcode"))]
    assert [row["oid"] for row in read_answer(RawTable("the answer", whole), "simbad_measurements")[0]] == [1, 2]
    for cells, words in (
        ((None, 2), "row 1 column oidref = missing"),
        ((1e20, 2), "column oidref = 1e"),
    ):
        with pytest.raises(RefreshError, match=words):
            read_answer(RawTable("the answer", [column("oidref", *cells), *whole[1:]]), "simbad_measurements")
    twice = RawTable("the answer", [column("oidref", 2, 2), *whole[1:]])
    with pytest.raises(RefreshError, match="2 rows are of one name; same oid 2"):
        read_answer(twice, "simbad_measurements", unique=("oid",))
