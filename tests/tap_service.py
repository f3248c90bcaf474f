"""A small TAP service for the tests: it parses the ADQL that is posted and answers from tables of its own.

Only what the two questions need is understood (select columns, inner and left joins on equality, comparisons joined by
AND), but that is evaluated, not recognised: a query that asks for something else gets other rows or an error.
"""

import contextlib
import gzip
import re
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs
from xml.sax.saxutils import escape

# columns of each table, with VOTable type and unit
COLUMNS = {
    "basic": """oid long; main_id char; ra double deg; dec double deg; plx_value double mas; plx_err float mas;
        pmra double mas.yr-1; pmdec double mas.yr-1; rvz_radvel double km.s-1; sp_type char; otype char; nbref int""",
    "allfluxes": "oidref long; b float mag; v float mag; k float mag",
    "ids": "oidref long; ids char",
    "mesfe_h": "oidref long; teff int K; log_g float; fe_h float; bibcode char; mespos short",
}
COLUMNS = {
    table: {name: (kind, *unit, "")[:2] for name, kind, *unit in (column.split() for column in columns.split(";"))}
    for table, columns in COLUMNS.items()
}


class QueryError(Exception):
    """The query is refused."""


def parse(query):
    """Read a query into its parts; raises `QueryError` for anything that is not understood."""
    text = " ".join(query.split())
    found = re.fullmatch(r"SELECT (.+?) FROM (\w+)(?: AS)? (\w+)((?: (?:LEFT )?JOIN .+?)*) WHERE (.+)", text, re.I)
    if not found:
        raise QueryError(f"cannot parse: {text[:60]}")
    select, table, alias, joins, where = found.groups()
    parsed = {
        "select": [reference(part) for part in select.split(",")],
        "tables": {alias.lower(): known_table(table)},
        "joins": [],
        "where": [],
    }
    base = alias.lower()
    pattern = r"(LEFT )?JOIN (\w+)(?: AS)? (\w+) ON (\w+\.\w+) ?= ?(\w+\.\w+)"
    if re.sub(pattern, "", joins, flags=re.I).strip():
        raise QueryError(f"cannot parse the joins: {joins}")
    for left, name, other, one, two in re.findall(pattern, joins, re.I):
        parsed["tables"][other.lower()] = known_table(name)
        parsed["joins"].append((bool(left), other.lower(), reference(one), reference(two)))
    number = r"([-+]?[\d.]+(?:e[-+]?\d+)?)"
    for part in re.split(r" AND (?![\d.+-]+(?: |$))", where, flags=re.I):
        if between := re.fullmatch(rf"(\w+\.\w+) BETWEEN {number} AND {number}", part, re.I):
            parsed["where"] += [
                (reference(between[1]), ">=", float(between[2])),
                (reference(between[1]), "<=", float(between[3])),
            ]
        elif compared := re.fullmatch(rf"(\w+\.\w+) ?(>=|<=|>|<|=) ?{number}", part, re.I):
            parsed["where"].append((reference(compared[1]), compared[2], float(compared[3])))
        else:
            raise QueryError(f"cannot parse the condition: {part}")
    used = [*parsed["select"], *(ref for _, _, one, two in parsed["joins"] for ref in (one, two))]
    for alias_name, column, _ in [*used, *(ref for ref, _, _ in parsed["where"])]:
        if alias_name not in parsed["tables"]:
            raise QueryError(f"unknown table alias {alias_name}")
        if column not in COLUMNS[parsed["tables"][alias_name]]:
            raise QueryError(f'Column "{column}" unknown in {parsed["tables"][alias_name]}')
    return base, parsed


def known_table(name):
    if name.lower() not in COLUMNS:
        raise QueryError(f'Table "{name}" unknown')
    return name.lower()


def reference(text):
    found = re.fullmatch(r"\s*(\w+)\.(\w+)\s*", text)
    if not found:
        raise QueryError(f"a column needs its table: {text}")
    return found[1].lower(), found[2].lower(), found[2]


def evaluate(query, tables):
    """Return the headings and rows that a query asks for."""
    base, parsed = parse(query)
    rows = [{base: row} for row in tables[parsed["tables"][base]]]
    for left, alias, one, two in parsed["joins"]:
        new, old = (one, two) if one[0] == alias else (two, one)
        index = {}
        for row in tables[parsed["tables"][alias]]:
            index.setdefault(row[new[1]], []).append(row)
        joined = []
        for row in rows:
            held = row[old[0]]
            matches = index.get(held[old[1]], []) if held else []
            joined += [row | {alias: match} for match in matches]
            if left and not matches:
                joined.append(row | {alias: None})
        rows = joined
    compare = {">=": float.__ge__, "<=": float.__le__, ">": float.__gt__, "<": float.__lt__, "=": float.__eq__}

    def value(row, ref):
        return None if row[ref[0]] is None else row[ref[0]][ref[1]]

    kept = [
        row
        for row in rows
        if all(
            (cell := value(row, ref)) is not None and compare[op](float(cell), bound)
            for ref, op, bound in parsed["where"]
        )
    ]
    headings = [(ref[2], *COLUMNS[parsed["tables"][ref[0]]][ref[1]]) for ref in parsed["select"]]
    return headings, [[value(row, ref) for ref in parsed["select"]] for row in kept]


def votable(headings, rows, status="OK", overflow=False):
    """Write a TAP answer."""

    def field(name, kind, unit):
        size = ' arraysize="*"' if kind == "char" else ""
        measured = f' unit="{unit}"' if unit else ""
        return f'<FIELD name="{escape(name)}" datatype="{kind}"{size}{measured}/>'

    def cell(value):
        return "<TD/>" if value is None else f"<TD>{escape(str(value))}</TD>"

    fields = "".join(field(*heading) for heading in headings)
    body = "".join("<TR>" + "".join(map(cell, row)) + "</TR>" for row in rows)
    mark = '<INFO name="QUERY_STATUS" value="OVERFLOW"/>' if overflow else ""
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<VOTABLE version="1.3" xmlns="http://www.ivoa.net/xml/VOTable/v1.3">'
        f'<RESOURCE type="results"><INFO name="QUERY_STATUS" value="{status}"/>'
        f"<TABLE>{fields}<DATA><TABLEDATA>{body}</TABLEDATA></DATA></TABLE>{mark}</RESOURCE></VOTABLE>"
    ).encode()


def error_document(text):
    return (
        '<?xml version="1.0" encoding="UTF-8"?><VOTABLE version="1.3" xmlns="http://www.ivoa.net/xml/VOTable/v1.3">'
        f'<RESOURCE type="results"><INFO name="QUERY_STATUS" value="ERROR">{escape(text)}</INFO></RESOURCE></VOTABLE>'
    ).encode()


def many_rows(count):
    """Write an answer of many rows."""
    one = votable([("oid", "long", ""), ("main_id", "char", ""), ("ra", "double", "deg")], [[1, "HD 1", 12.5]])
    start, row, end = re.fullmatch(rb"(.*<TABLEDATA>)(.*)(</TABLEDATA>.*)", one, re.DOTALL).groups()
    return start + row * count + end


OLD_NAMES = """
oid OID main_id MAIN_ID ra RA_d dec DEC_d plx_value PLX_VALUE plx_err PLX_ERROR pmra PMRA pmdec PMDEC
rvz_radvel RV_VALUE sp_type SP_TYPE otype OTYPE b FLUX_B v FLUX_V ids IDS oidref OIDREF teff Fe_H_Teff
log_g Fe_H_log_g fe_h Fe_H_Fe_H bibcode Fe_H_bibcode mespos mespos
""".split()
OLD_NAMES = dict(zip(OLD_NAMES[::2], OLD_NAMES[1::2], strict=True))
PARENTHESES = """
v flux(V) b flux(B) teff mesfe_h.teff log_g mesfe_h.log_g fe_h mesfe_h.fe_h bibcode mesfe_h.bibcode
sp_type sptype plx_value plx
""".split()
PARENTHESES = dict(zip(PARENTHESES[::2], PARENTHESES[1::2], strict=True))


class TapService:
    """The service. `mode` says how it misbehaves; `rename` how it calls its columns; `alter` changes the answer.

    `data` is what it answers in the mode of that name: content, status, type and coding of the content.
    """

    PATH = "/simbad/sim-tap"

    def __init__(self, tables):
        self.tables = tables
        self.mode = ""
        self.rename = {}
        self.alter = None
        self.data = ()
        self.failures = 0
        self.queries = []
        self.maxrec = []
        self.paths = []
        service = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_POST(self):
                body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
                service.answer(self, parse_qs(body.decode()))

            def do_GET(self):
                service.paths.append(self.path)
                if self.path.startswith("/next/"):
                    service.redirect(self, service.mode)
                else:
                    self.send_error(404)

            def log_message(self, *_):
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.daemon_threads = True
        self.thread = threading.Thread(target=self.server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
        self.thread.start()

    @property
    def url(self):
        return f"http://127.0.0.1:{self.server.server_port}{self.PATH}"

    def close(self):
        self.server.shutdown()
        self.server.server_close()
        self.thread.join()

    def answer(self, handler, form):
        self.paths.append(handler.path)
        if handler.path != f"{self.PATH}/sync" or form.get("REQUEST") != ["doQuery"] or form.get("LANG") != ["ADQL"]:
            self.send(handler, error_document("not a TAP request"), 400)
            return
        self.queries.append(form["QUERY"][0])
        self.maxrec.append(int(form["MAXREC"][0]))
        mode = self.mode
        if mode in ("drop", "500") and self.failures > 0:
            self.failures -= 1
        elif mode in ("drop", "500"):
            mode = ""
        if mode == "drop":
            handler.close_connection = True
            handler.connection.close()
        elif mode == "500":
            self.send(handler, b"<html>Internal error</html>", 500, "text/html")
        elif mode == "404":
            self.send(handler, b"<html>Not here</html>", 404, "text/html")
        elif mode == "hang":
            time.sleep(1.5)
        elif mode in ("trickled header", "continue"):
            self.never_end(handler, mode)
        elif mode.startswith("redirect"):
            self.redirect(handler, mode)
        elif mode == "html":
            self.send(handler, b"<!DOCTYPE html><html>Please log in to the hotel network</html>", 200, "text/html")
        elif mode == "garbage":
            self.send(handler, bytes(range(256)) * 40)
        elif mode == "empty":
            self.send(handler, b"")
        elif mode.startswith("refer"):
            data = (
                f'<?xml version="1.0"?><VOTABLE version="1.3"><RESOURCE type="results"><TABLE>'
                f'<FIELD name="oid" datatype="long"/><DATA><BINARY><STREAM href="{self.url}/leak"/></BINARY></DATA>'
                f"</TABLE></RESOURCE></VOTABLE>"
            ).encode()
            data = gzip.compress(data) if mode == "refer packed" else data
            self.send(handler, data, mode="gzip" if mode == "refer gzip" else "")
        elif mode == "bomb":
            self.send(handler, b" " * 20_000_000, mode="gzip")
        elif mode == "long text":
            self.send(handler, votable([("main_id", "char", "")], [["x" * 30_000]]))
        elif mode == "many rows":
            self.send(handler, many_rows(150_000))
        elif mode == "promised rows":
            data = votable([("oid", "long", "")], [[1]])
            self.send(handler, data.replace(b"<TABLE>", b'<TABLE nrows="2000000000000">'))
        elif mode == "no table":
            self.send(handler, error_document("").replace(b"ERROR", b"OK"))
        elif mode == "data":
            self.send(handler, *self.data)
        elif mode == "error":
            self.send(handler, error_document("Query rejected: maintenance of <SIMBAD>"), 200)
        else:
            self.send_rows(handler, form, mode)

    def never_end(self, handler, mode):
        """Send what is no answer yet, until nobody listens."""
        endless = b"HTTP/1.1 100 Continue\r\n\r\n" if mode == "continue" else b"X-a: b\r\n"
        with contextlib.suppress(OSError):
            handler.wfile.write(b"" if mode == "continue" else b"HTTP/1.1 200 OK\r\n")
            while True:
                handler.wfile.write(endless)
                handler.wfile.flush()
                time.sleep(0.02)
        handler.close_connection = True

    def redirect(self, handler, mode):
        """Send the client elsewhere: to `mode`'s last word, or round and round, slowly where it says so; 303 or 307."""
        *_, where = mode.split()
        if where == "slowly":
            time.sleep(0.4)
        turning = where in ("redirect", "slowly", "heavily")
        body = b" " * 2_000_000 * (where == "heavily")
        handler.send_response(307 if "307" in mode else 303)
        handler.send_header("Location", f"/next/{len(self.paths)}" if turning else where)
        handler.send_header("Content-Length", str(len(body)))
        handler.end_headers()
        with contextlib.suppress(OSError):
            handler.wfile.write(body)

    def evaluate(self, query):
        """Return the headings and rows that a query asks for."""
        return evaluate(query, self.tables)

    def send_rows(self, handler, form, mode):
        try:
            headings, rows = self.evaluate(form["QUERY"][0])
        except QueryError as error:
            self.send(handler, error_document(str(error)), 400)
            return
        if self.alter is not None:
            headings, rows = self.alter(headings, rows)
        headings = [(self.rename.get(name.lower(), name), kind, unit) for name, kind, unit in headings]
        limit = int(form["MAXREC"][0])
        if mode == "server limit":
            limit = min(limit, 5)
        overflow = len(rows) > limit
        data = votable(headings, rows[:limit], overflow=overflow and mode != "silent limit")
        if mode == "cut":
            data = data[: len(data) // 2]
        self.send(handler, data, mode=mode)

    def send(self, handler, data, status=200, kind="application/x-votable+xml", mode=""):
        try:
            handler.send_response(status)
            handler.send_header("Content-Type", kind)
            if mode.startswith("gzip"):
                for _ in mode.split(", "):
                    data = gzip.compress(data)
                handler.send_header("Content-Encoding", mode)
            if mode in ("chunked", "chunked cut"):
                handler.send_header("Transfer-Encoding", "chunked")
                handler.end_headers()
                for start in range(0, len(data), 1000):
                    part = data[start : start + 1000]
                    handler.wfile.write(f"{len(part):x}\r\n".encode() + part + b"\r\n")
                    if mode == "chunked cut":
                        handler.close_connection = True
                        return
                handler.wfile.write(b"0\r\n\r\n")
                return
            promised = len(data) + (100 if mode == "short" else 0)
            handler.send_header("Content-Length", str(promised))
            handler.end_headers()
            if mode == "drip":
                for byte in data[:40]:
                    handler.wfile.write(bytes([byte]))
                    handler.wfile.flush()
                    time.sleep(0.1)
            else:
                handler.wfile.write(data)
            if mode in ("short", "drip"):
                handler.close_connection = True
        except OSError:
            handler.close_connection = True  # the client has gone


class ArchiveService(TapService):
    """The NASA Exoplanet Archive: all columns of its table ``ps``, in its units; `tables` are rows by column."""

    PATH = "/TAP"
    UNITS = {  # noqa: RUF012
        "pl_orbper": "days",
        "pl_orbtper": "days",
        "pl_tranmid": "days",
        "pl_orblper": "deg",
        "pl_orbincl": "deg",
        "pl_orbsmax": "au",
        "pl_bmassj": "Jupiter mass",
        "pl_msinij": "Jupiter mass",
        "pl_radj": "Jupiter Radius",
        "st_mass": "Solar mass",
        "sy_dist": "pc",
        "ra": "deg",
        "dec": "deg",
    }

    def evaluate(self, query):
        found = re.fullmatch(r"SELECT \* FROM ps WHERE sy_dist <= ([\d.]+)", query)
        if not found:
            raise QueryError('ORA-00904: "PL_NONSENSE": invalid identifier')
        names = list(dict.fromkeys(name for row in self.tables for name in row))
        texts = {name for row in self.tables for name, cell in row.items() if isinstance(cell, str)}
        headings = [
            (name, "char" if name in texts else "double", self.UNITS.get(re.sub("err[12]$", "", name), ""))
            for name in names
        ]
        near = [row for row in self.tables if row["sy_dist"] <= float(found[1])]
        return headings, [[row.get(name) for name in names] for row in near]
