#!/usr/bin/env bash
# pyvo 1.9.1 takes the table in an answer of HTTP status 500 or 403 for the answer to the query, without a word.
#
# Expected: `TAPService.run_sync` raises for a status of 400 or more, as it does when the body is a plain text.
# Seen: the status is looked at only where the body cannot be read as a VOTable. A service (or a gateway before it) that
# fails and sends a whole VOTable with it, such as the last good answer of a cache or the rows that came before the
# failure, without QUERY_STATUS ERROR, gives a result like any other: 1 row, no exception, no warning.
# Who meets it: programs that refresh catalogues unattended. `requests.Response.raise_for_status` in a hook of the session
# that is handed to TAPService catches it.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pyvo==1.9.1 astropy==8.0.2 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import threading
import warnings
from http.server import BaseHTTPRequestHandler, HTTPServer

import pyvo

TABLE = b"""<?xml version="1.0" encoding="UTF-8"?>
<VOTABLE version="1.4" xmlns="http://www.ivoa.net/xml/VOTable/v1.3"><RESOURCE type="results">
<INFO name="QUERY_STATUS" value="OK"/>
<TABLE><FIELD name="hip" datatype="int"/><DATA><TABLEDATA><TR><TD>8102</TD></TR></TABLEDATA></DATA></TABLE>
</RESOURCE></VOTABLE>"""
answer = {"status": 200, "type": "application/x-votable+xml", "body": TABLE}


class Service(BaseHTTPRequestHandler):
    def do_POST(self):
        self.rfile.read(int(self.headers["Content-Length"]))
        self.send_response(answer["status"])
        self.send_header("Content-Type", answer["type"])
        self.send_header("Content-Length", str(len(answer["body"])))
        self.end_headers()
        self.wfile.write(answer["body"])

    def log_message(self, *args):
        pass


server = HTTPServer(("127.0.0.1", 0), Service)
threading.Thread(target=server.serve_forever, daemon=True).start()
service = pyvo.dal.TAPService(f"http://127.0.0.1:{server.server_port}/tap")


def asked(status, kind, body):
    answer.update(status=status, type=kind, body=body)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            found = f"{len(service.run_sync('SELECT hip FROM stars'))} row"
        except pyvo.dal.DALServiceError as error:
            found = f"{type(error).__name__}"
    print(f"HTTP {status}, {kind}: {found}, warnings {[str(one.message) for one in said]}")
    return found, len(said)


assert asked(200, "application/x-votable+xml", TABLE) == ("1 row", 0)
assert asked(500, "text/plain", b"out of order")[0] == "DALServiceError"
for status in (500, 403):
    assert asked(status, "application/x-votable+xml", TABLE) == ("1 row", 0), "the behaviour has changed"
server.shutdown()
PYTHON
