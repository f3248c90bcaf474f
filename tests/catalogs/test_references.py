"""Reading a table opens nothing but that table: no address, no other file."""

import http.server
import os
import socket
import threading

import pytest

from catalogs import load_known_planets, open_catalogue
from catalogs.table_files import TableBytes, votable_document
from simulator.target import read_spectrum
from simulator.target.albedo_grid import read_albedo

FIELDS = "".join(f'<FIELD name="{name}" datatype="double"/>' for name in ("v_mag", "distance_pc"))
TABLE = '{head}<VOTABLE version="1.3"><RESOURCE><TABLE>{fields}<DATA>{data}</DATA></TABLE></RESOURCE></VOTABLE>'
READERS = (open_catalogue, load_known_planets, read_spectrum, read_albedo)


@pytest.fixture(scope="module")
def server():
    """Address of a server of this machine, and the requests that it got."""
    asked = []

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path)
            self.send_error(404)

        def log_message(self, *given):
            pass

    service = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=service.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{service.server_port}", asked
    service.shutdown()
    service.server_close()
    thread.join()


def referring(address):
    """Tables of each kind of reference to an address."""
    stream = f'<STREAM href="{address}/leak" encoding="base64"/>'
    rows = "<TABLEDATA><TR><TD>1</TD><TD>2</TD></TR></TABLEDATA>"
    entity = f'<?xml version="1.0"?><!DOCTYPE VOTABLE [<!ENTITY x SYSTEM "{address}/leak">]>'
    include = f'<x:include xmlns:x="http://www.w3.org/2001/XInclude" href="{address}/leak"/>'
    doctype = f'<?xml version="1.0"?><!DOCTYPE VOTABLE SYSTEM "{address}/dtd">'
    binary = f"<BINARY>{stream}</BINARY>"
    return {
        "binary": TABLE.format(head="", fields=FIELDS, data=binary),
        "binary 2": TABLE.format(head='<?xml version="1.0"?>', fields=FIELDS, data=f"<BINARY2>{stream}</BINARY2>"),
        "FITS": TABLE.format(head="", fields=FIELDS, data=f'<FITS extnum="1">{stream}</FITS>'),
        "prefixed": TABLE.format(head="", fields=FIELDS, data=binary.replace("STREAM", "v:STREAM")),
        "entity": TABLE.format(head=entity, fields=FIELDS, data=rows.replace("<TD>1", "<TD>&x;")),
        "document type": TABLE.format(fields=FIELDS, data=rows, head=doctype),
        "inclusion": TABLE.format(head="", fields=FIELDS, data=f"<TABLEDATA>{include}</TABLEDATA>"),
        "encoding": TABLE.format(head='<?xml version="1.0" encoding="x-none"?>', fields=FIELDS, data=binary),
    }


@pytest.mark.parametrize("kind", referring(""))
@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.__name__)
def test_a_table_with_a_reference_is_refused_and_nobody_is_asked(refused, tmp_path, server, kind, reader):
    address, asked = server
    path = tmp_path / "e.vot"
    path.write_text(referring(address)[kind])
    refused("reference|a VOTable that holds", reader, path)
    assert asked == []


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.__name__)
def test_no_local_file_is_opened(refused, tmp_path, reader):
    """A pipe would hold its reader for ever."""
    os.mkfifo(tmp_path / "pipe")
    path = tmp_path / "e.vot"
    path.write_text(referring(f"file://{tmp_path}/pipe?")["binary"].replace("?/leak", ""))
    refused("", reader, path)


def test_the_data_of_a_table_itself_are_read(tmp_path):
    """Streams without an address, and links for people, are no references."""
    link = '<LINK href="http://example.org/about"/>'
    rows = "<TABLEDATA><TR><TD>a</TD><TD>1</TD><TD>2</TD><TD>5000</TD></TR></TABLEDATA>"
    fields = f'<FIELD name="name" datatype="char" arraysize="*"/>{FIELDS}<FIELD name="teff_k" datatype="double"/>{link}'
    path = tmp_path / "good.vot"
    path.write_text(TABLE.format(head="", fields=fields, data=rows))
    assert open_catalogue(path).table.column("v_mag").tolist() == [1.0]
    binary = TABLE.format(head="", fields=fields, data="<BINARY><STREAM encoding='base64'></STREAM></BINARY>")
    document, _ = votable_document(TableBytes("binary.vot", binary.encode(), ""))
    assert len(document.get_first_table().array) == 0


def test_text_that_is_named_like_an_address_is_no_address(refused, tmp_path, monkeypatch):
    """ECSV of one line would be an address to astropy."""
    monkeypatch.setattr(socket, "create_connection", lambda *given, **more: pytest.fail("the network was asked"))
    path = tmp_path / "x.ecsv"
    for text in ("# %ECSV 1.0", "# %ECSV 1.0 http://127.0.0.1:9/x"):
        path.write_text(text)
        for reader in (open_catalogue, read_spectrum):
            refused("", reader, path)
