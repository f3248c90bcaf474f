"""One client for every service: an answer counts only when it is whole, and the time and the bytes are kept to.

Answers in the forms in which SIMBAD and the NASA Exoplanet Archive send them: columns, units, types and statuses.

The forms are those of recorded answers: SIMBAD's TAP service (taplib: a stream in BINARY, statuses and provider as
INFO; columns, types and units as its TAP_SCHEMA of 2024-03 lists them, recorded in the tests of astroquery), and the
archive's TAP service (TABLEDATA; units as its users reported them, astroquery issues 2130 and 3187, and as astroquery
knows them, BJD among them). The few facts are those of SIMBAD and of the archive's table ``ps`` for the stars named
here; the last row of each has what is missing. Queries: `catalogs.queries` and `catalogs.PLANETS_QUERY`.

Names of refreshed tables, and when one is set aside.
"""

import base64
import io
import pickle
import struct
import time
from datetime import UTC, datetime
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

import pytest
from astropy.io.votable import from_table
from astropy.table import MaskedColumn, Table

from catalogs import Cuts, RefreshError, TapService, archives, file_name, load_stars, queries, set_aside, stored_tables
from catalogs.archives import ask, loss_refused, read_answer
from catalogs.exoplanet_archive import read_archive
from catalogs.simbad import read_measurements, read_stars
from catalogs.table_files import RawTable, column_of

STARS, _ = queries(Cuts())


def asked(service, query=STARS, *, tell=lambda text: None, url="", **changes):
    """Put a question, and return the cells of the answer's columns."""
    patience = TapService(**({"timeout_s": 120.0, "retries": 2, "pause_s": 0.01} | changes))
    found = ask(patience, url or service.url, query, narrower="ask for less", tell=tell)
    return {column.heading: column.cells.tolist() for column in found.columns}


def test_a_wrong_query_is_refused_with_the_reason_and_not_repeated(simbad):
    for query, words in (
        ("SELECT b.oid FROM basic AS b WHERE b.nonsense > 1", "nonsense"),
        ("SELECT b.oid FROM stars AS b WHERE b.oid > 1", "stars"),
        ("DROP TABLE basic", "cannot parse"),
    ):
        before = len(simbad.queries)
        with pytest.raises(RefreshError, match=words) as failure:
            asked(simbad, query)
        assert len(simbad.queries) == before + 1
        assert "\n" not in str(failure.value)


@pytest.mark.parametrize(
    ("mode", "words", "attempts"),
    [
        ("error", "maintenance of <SIMBAD>", 1),
        ("404", "HTTP 404", 1),
        ("500", "HTTP 500", 3),
        ("drop", "dropped", 3),
        ("html", "web page", 3),
        ("garbage", "no VOTable", 3),
        ("cut", "breaks off", 3),
        ("short", "dropped", 3),
        ("empty", "the answer is empty", 3),
        ("chunked cut", "dropped", 3),
        ("server limit", r"cut off at 5 rows \(allowed: 200000\); ask for less", 1),
    ],
)
def test_failures_are_named_and_only_those_on_the_way_are_repeated(simbad, mode, words, attempts):
    simbad.mode, simbad.failures = mode, 99
    heard = []
    with pytest.raises(RefreshError, match=words) as failure:
        asked(simbad, tell=heard.append)
    assert len(simbad.queries) == attempts
    assert len(heard) == attempts - 1
    assert failure.value.remedy
    assert "\n" not in str(failure.value)


def test_connection_dropped_twice_then_answered(simbad):
    simbad.mode, simbad.failures = "drop", 2
    heard = []
    assert len(asked(simbad, tell=heard.append)["oid"]) > 10
    assert len(simbad.queries) == 3
    assert len(heard) == 2
    assert "trying again" in heard[0]


def test_pauses_grow(simbad, monkeypatch):
    simbad.mode, simbad.failures = "500", 2
    pauses = []
    monkeypatch.setattr(time, "sleep", pauses.append)
    asked(simbad, pause_s=0.1)
    assert pauses == [0.1, 0.2]


@pytest.mark.parametrize("mode", ["hang", "drip"])
def test_time_limit_holds_for_the_whole_answer(simbad, mode):
    simbad.mode = mode  # one byte of a slow answer comes in time, the whole does not
    with pytest.raises(RefreshError, match=r"within 0\.4 s"):
        asked(simbad, timeout_s=0.4, retries=0)


@pytest.mark.parametrize("mode", ["gzip", "chunked"])
def test_other_ways_of_sending_are_read(simbad, mode):
    simbad.mode = mode
    assert "* tau Cet" in asked(simbad)["main_id"]


@pytest.mark.parametrize("form", ["tabledata", "binary", "binary2"])
def test_every_form_of_a_votable_is_read_with_what_is_missing(simbad, form):
    table = Table({"main_id": ["HD 1", "", "HD 3"], "ra": MaskedColumn([1.5, 2.5, 3.5], mask=[False, False, True])})
    content = io.BytesIO()
    from_table(table).to_xml(content, tabledata_format=form)
    simbad.mode, simbad.data = "data", (content.getvalue(),)
    assert asked(simbad) == {"main_id": ["HD 1", None, "HD 3"], "ra": [1.5, 2.5, None]}


def said(name, place, tap):
    """Return an answer of one row that says its status in a place of the document."""
    data = tap.votable([("oid", "long", "")], [[1]]).decode()
    note = f'<INFO name="QUERY_STATUS" value="{name}">it was stopped</INFO>'
    return data.replace(
        *{"end": ("</VOTABLE>", f"{note}</VOTABLE>"), "table": ("</TABLE>", f"{note}</TABLE>")}[place]
    ).encode()


@pytest.mark.parametrize("place", ["end", "table"])
@pytest.mark.parametrize(("name", "words"), [("OVERFLOW", "cut off at 1 rows"), ("ERROR", "ERROR|it was stopped")])
def test_a_status_counts_wherever_it_stands(simbad, tap, name, place, words):
    simbad.mode, simbad.data = "data", (said(name, place, tap),)
    with pytest.raises(RefreshError, match=words):
        asked(simbad, retries=0)


@pytest.mark.parametrize(
    ("status", "kind", "words", "attempts"),
    [
        (500, "application/x-votable+xml", "HTTP 500", 3),
        (503, "text/plain", "HTTP 503", 3),
        (429, "application/x-votable+xml", "HTTP 429", 3),
        (403, "application/x-votable+xml", "HTTP 403", 1),
        (400, "text/plain", "HTTP 400", 1),
    ],
)
def test_a_whole_table_with_a_status_of_error_is_no_answer(simbad, tap, status, kind, words, attempts):
    simbad.mode, simbad.data = "data", (tap.votable([("oid", "long", "")], [[1]]), status, kind)
    with pytest.raises(RefreshError, match=words):
        asked(simbad)
    assert len(simbad.queries) == attempts


@pytest.mark.parametrize("mode", ["redirect heavily", "data"])
def test_what_is_no_answer_is_no_larger_than_allowed_either(simbad, mode):
    """A redirect, and a refusal in plain text: both are read by packages that we use, whole."""
    simbad.mode, simbad.data = mode, (b" " * 2_000_000, 400, "text/plain")
    with pytest.raises(RefreshError, match="larger than"):
        asked(simbad, max_bytes=1_000_000)


def test_what_is_packed_several_times_is_no_larger_than_allowed(simbad):
    simbad.mode, simbad.data = "data", (b" " * 20_000_000, 200, "text/xml", "gzip, gzip")
    with pytest.raises(RefreshError, match="larger than"):
        asked(simbad, max_bytes=10_000_000)


@pytest.mark.parametrize("mode", ["refer", "refer gzip", "refer packed"])
def test_an_answer_that_refers_to_an_address_is_refused_and_nobody_is_asked(simbad, mode):
    simbad.mode = mode
    with pytest.raises(RefreshError, match="references are not followed"):
        asked(simbad)
    assert simbad.paths == ["/simbad/sim-tap/sync"]


@pytest.mark.parametrize(("mode", "max_bytes"), [("bomb", 10_000_000), ("many rows", 1_000_000), ("", 1000)])
def test_an_answer_larger_than_allowed_packed_or_not_is_refused(simbad, mode, max_bytes):
    simbad.mode = mode
    with pytest.raises(RefreshError, match=rf"larger than {max_bytes / 2**20:.3g} MB"):
        asked(simbad, max_bytes=max_bytes)
    assert len(simbad.queries) == 1


@pytest.mark.parametrize(
    "mode",
    [
        "redirect slowly",
        "many rows",
        *(pytest.param(mode, marks=pytest.mark.long) for mode in ("trickled header", "continue")),
    ],
)
def test_a_service_that_does_not_end_is_left_when_the_time_is_up(simbad, mode):
    simbad.mode = mode
    with pytest.raises(RefreshError, match=r"within 0\.1 s"):
        asked(simbad, timeout_s=0.1, retries=0)
    simbad.mode = ""
    assert "* tau Cet" in asked(simbad)["main_id"], "the next question is answered"


@pytest.mark.parametrize(
    ("mode", "words"),
    [
        ("redirect", "redirects more than 5 times"),
        ("redirect file:///etc/passwd", "file:///etc/passwd"),
        ("redirect http://localhost/tap", "redirects to http://localhost, another host"),
        ("redirect http://192.0.2.1/tap", "redirects to http://192.0.2.1, which is not asked"),
        ("bomb", "the answer is empty"),
        ("long text", "more than 20000 letters"),
        ("promised rows", "takes more than 4 GB of memory"),
        ("no table", "holds no table"),
    ],
)
def test_what_no_service_should_send_is_refused(simbad, mode, words):
    simbad.mode = mode
    with pytest.raises(RefreshError, match=words) as failure:
        asked(simbad, retries=0)
    assert "\n" not in str(failure.value)
    simbad.mode = ""
    assert "* tau Cet" in asked(simbad)["main_id"], "the next question is answered"


def test_many_rows_are_read_where_there_is_time(simbad):
    simbad.mode = "many rows"
    assert len(asked(simbad)["oid"]) == 150_000


def test_a_redirect_is_followed_on_the_same_host_and_elsewhere_when_asked(simbad, tap):
    other = tap.TapService({})
    for code in ("307 ", ""):  # the first asks for the whole question again
        simbad.mode = f"redirect {code}{other.url}/sync"
        with pytest.raises(RefreshError, match=f"redirects to {other.url[:16]}.*another host"):
            asked(simbad, retries=0)
        assert other.paths == []
    with pytest.raises(RefreshError, match="HTTP 404"):
        asked(simbad, retries=0, other_hosts=True)
    assert other.paths == ["/simbad/sim-tap/sync"]
    other.close()


def test_an_interruption_ends_the_process_and_the_next_question_has_its_own_answer(simbad, monkeypatch):
    simbad.mode = "hang"

    def interrupt(lines, time_s):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(archives, "wait", interrupt)
        with pytest.raises(KeyboardInterrupt):
            asked(simbad)
    simbad.mode = ""
    assert asked(simbad, "SELECT b.oid FROM basic AS b WHERE b.oid = 3") == {"oid": [3]}


def test_a_process_that_died_is_replaced(simbad):
    asked(simbad)
    archives._PROCESS._child.kill()
    archives._PROCESS._child.wait()
    assert "* tau Cet" in asked(simbad)["main_id"]


def test_a_process_that_may_be_about_to_end_is_replaced(simbad, monkeypatch):
    """It ends when it has been idle for a while."""
    asked(simbad)
    first = archives._PROCESS._child
    asked(simbad)
    assert archives._PROCESS._child is first
    now = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now + 0.6 * archives.IDLE_S)
    asked(simbad)
    assert archives._PROCESS._child is not first
    assert first.returncode is not None


@pytest.mark.parametrize("mode", ["", "silent limit"])
def test_as_many_rows_as_allowed_count_as_cut_off(simbad, mode):
    whole = len(asked(simbad)["oid"])
    simbad.mode = mode
    for maxrec in (whole, whole - 1):
        with pytest.raises(RefreshError, match=rf"cut off at {maxrec} rows.*--maxrec"):
            asked(simbad, maxrec=maxrec)
    assert len(asked(simbad, maxrec=whole + 1)["oid"]) == whole


def test_nobody_listens():
    with pytest.raises(RefreshError, match="Connection refused"):
        asked(None, url="http://127.0.0.1:9/tap", retries=0)


def test_this_machine_is_reached_without_the_proxy_of_the_environment(simbad, monkeypatch):
    for name in ("http_proxy", "HTTP_PROXY", "https_proxy", "ALL_PROXY", "all_proxy"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")
    monkeypatch.delenv("no_proxy", raising=False)
    monkeypatch.delenv("NO_PROXY", raising=False)
    assert len(asked(simbad)["oid"]) > 10


def test_other_machines_are_reached_through_the_proxy_of_the_environment(simbad, monkeypatch):
    monkeypatch.setenv("http_proxy", "http://127.0.0.1:9")
    monkeypatch.delenv("no_proxy", raising=False)
    monkeypatch.delenv("NO_PROXY", raising=False)
    with pytest.raises(RefreshError, match="refused"):
        asked(None, url="http://192.0.2.1/tap", retries=0, plain_http=True)


def test_error_travels_between_processes():
    error = RefreshError("what", "remedy")
    back = pickle.loads(pickle.dumps(error))
    assert str(back) == str(error) == "what; remedy"


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: TapService(url="simbad.example.org"), "url.*https://"),
        (lambda: TapService(url="file:///etc/passwd"), "url.*https://"),
        (lambda: TapService(url="http://["), "url.*https://"),
        (lambda: TapService(url="http://simbad.example.org/tap"), "url.*https://.*--plain-http"),
        (lambda: TapService(timeout_s=0.0), "timeout_s"),
        (lambda: TapService(retries=-1), "retries"),
        (lambda: TapService(maxrec=0), "maxrec"),
        (lambda: TapService(pause_s=-1.0), "pause_s"),
        (lambda: TapService(max_bytes=0), "max_bytes"),
    ],
)
def test_settings_are_checked(refused, make, words):
    refused(words, make)


def test_plain_http_is_asked_where_it_will_do_and_on_this_machine():
    for url in ("http://localhost:8000/tap", "http://127.0.0.1/tap", "http://[::1]:1/tap", "https://a.example/tap"):
        assert TapService(url=url).check_url("url", url) == url
    url = "http://a.example/tap"
    assert TapService(url=url, plain_http=True).check_url("url", f"{url}/sync") == url


NO_LONG, NO_INT = -(2**63), -(2**31)
STARS_OF_ARCHIVE_ANSWERS = [
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
    tau, eps, last = read_stars(answered(simbad_answer(STARS_OF_ARCHIVE_ANSWERS, form)))
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
    data = simbad_answer(STARS_OF_ARCHIVE_ANSWERS, "TABLEDATA").decode()
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
    for cells, words in (((None, 2), "row 1 column oidref = missing"), ((1e20, 2), "column oidref = 1e")):
        with pytest.raises(RefreshError, match=words):
            read_answer(RawTable("the answer", [column("oidref", *cells), *whole[1:]]), "simbad_measurements")
    twice = RawTable("the answer", [column("oidref", 2, 2), *whole[1:]])
    with pytest.raises(RefreshError, match="2 rows are of one name; same oid 2"):
        read_answer(twice, "simbad_measurements", unique=("oid",))


WHEN = datetime(2026, 3, 9, 4, 5, 6, tzinfo=UTC)


@pytest.mark.parametrize(
    ("lost", "known", "said"),
    [
        (0, 0, ""),
        (10, 100, ""),
        (11, 100, "11 of 100 stars are not in the new table, more than 10%: is the service whole?"),
        (1, 1, "1 of 1 stars are not in the new table, more than 10%: is the service whole?"),
    ],
)
def test_more_than_a_tenth_may_not_be_lost(lost, known, said):
    assert loss_refused(lost, known, "stars") == said


def test_kinds_are_kept_apart_and_what_is_set_aside_is_none_of_them(data_folder):
    data_folder.mkdir()
    for kind in ("simbad", "archive"):
        path = data_folder / file_name(WHEN, kind)
        path.write_text("")
        set_aside(path).write_text("")
    assert [item.path.name for item in stored_tables("simbad")] == ["simbad_2026-03-09T040506Z.ecsv"]
    assert [item.path.name for item in stored_tables("archive")] == ["archive_2026-03-09T040506Z.ecsv"]
    assert set_aside(Path("a/b.ecsv")) == Path("a/set_aside_b.ecsv")
