"""Files that come with a question: parsed from the body, held in memory while it is answered, never written."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import parse_qsl

from cpic_core import InputError
from cpic_planner.web.asking import MOST_VALUES
from simulator.config import Instrument
from simulator.imaging import metrics_key, shipped_file

MOST_PARTS = 200
_NAME = re.compile(r"[\w][\w.+ -]{0,79}")
_QUOTED = re.compile(rb'(name|filename)="((?:[^"\\]|\\.)*)"')
_FOLDED = re.compile(rb"\r\n[ \t]+")
FILE_FIELDS = ("instrument", "other", "catalog", "albedo", "known_planets", "table")
"""Parameters that take a file."""


@dataclass(frozen=True)
class Sent:
    """A posted question.

    Attributes
    ----------
    given : tuple of (str, str)
        Parameters; one that takes a file has the name of it.
    files : mapping
        Content by name.
    """

    given: tuple[tuple[str, str], ...]
    files: Mapping[str, bytes] = field(default_factory=dict)

    @property
    def hashes(self) -> list[tuple[str, str]]:
        """Names of the files with the sha256 of their content."""
        return [(name, hashlib.sha256(data).hexdigest()) for name, data in self.files.items()]


def read_sent(content_type: str, body: bytes) -> Sent:
    """Return a posted question.

    Parameters
    ----------
    content_type : str
        Of the request: that of a form, with files or without.
    body : bytes

    Raises
    ------
    InputError
        For a body of another kind, a file without a name or with a strange one, or where none is taken.
    """
    kind = content_type.partition(";")[0].strip().lower()
    if kind == "application/x-www-form-urlencoded":
        try:
            return Sent(tuple(parse_qsl(body.decode(), keep_blank_values=True, max_num_fields=MOST_PARTS)))
        except ValueError:
            raise InputError("body", "another text", allowed="parameters as in an address") from None
    found = re.search(r'boundary="?([\w\'()+,./:=? -]{1,70})"?', content_type)
    if kind != "multipart/form-data" or found is None:
        raise InputError("body", kind[:60] or "no type", allowed="multipart/form-data, as forms and curl -F send it")
    given: list[tuple[str, str]] = []
    files: dict[str, bytes] = {}
    for head, content in _parts(body, found[1].rstrip().encode()):
        names = dict(_QUOTED.findall(_FOLDED.sub(b" ", head)))
        parameter = names.get(b"name", b"").decode("utf-8", "replace")
        if b"filename" not in names:
            given.append((parameter, content.decode("utf-8", "replace").strip()))
            continue
        if not names[b"filename"] and not content:
            continue  # a field of a form in which no file was chosen
        name = re.split(r"[/\\]", names[b"filename"].decode("utf-8", "replace"))[-1]
        _check_file(parameter, name, files)
        files[name] = content
        given.append((parameter, name))
    return Sent(tuple(given), files)


def _parts(body: bytes, boundary: bytes) -> list[tuple[bytes, bytes]]:
    """Return the head and content of each part of a body."""
    first, *pieces = (b"\r\n" + body).split(b"\r\n--" + boundary)
    if first or not pieces or pieces[-1] not in (b"--", b"--\r\n") or len(pieces) > MOST_PARTS:
        raise InputError(
            "body", "another text", allowed=f"a whole multipart/form-data body of at most {MOST_PARTS} parts"
        )
    parts = []
    for piece in pieces[:-1]:
        head, blank, content = piece.partition(b"\r\n\r\n")
        if not head.startswith(b"\r\n") or not blank:
            raise InputError("body", "a part without a head", allowed="multipart/form-data")
        parts.append((head, content))
    return parts


def _check_file(parameter: str, name: str, files: Mapping[str, bytes]) -> None:
    if parameter not in FILE_FIELDS:
        raise InputError(parameter[:40] or "a file", "a file", allowed=f"files for {', '.join(FILE_FIELDS)}")
    if not _NAME.fullmatch(name) or "." not in name:
        allowed = "a name of letters, digits, blanks, points, + and -, with an ending such as .csv, .yaml or .fits"
        raise InputError(parameter, name[:80] if name.isprintable() else "another name", allowed=allowed)
    if name in files:
        raise InputError(parameter, name, allowed="files of different names")
    if len(files) >= MOST_VALUES:
        raise InputError(parameter, name, allowed=f"at most {MOST_VALUES} files")


def check_optics(question: Any, sent: Sent) -> None:
    """Refuse an instrument that was sent where its optics are none that the package ships: they take minutes.

    Parameters
    ----------
    question : EtcQuestion or RankQuestion
        It has an instrument and bands.
    sent : Sent

    Raises
    ------
    InputError
    """
    if sent.files:
        check_shipped(question.instrument, question.band_names())


def check_shipped(instrument: Instrument, bands: Sequence[str], key: str = "instrument") -> None:
    """Refuse an instrument with a band whose point-spread functions would have to be computed; see `check_optics`.

    Parameters
    ----------
    instrument : Instrument
    bands : sequence of str
    key : str
        What it is asked for as, for messages.

    Raises
    ------
    InputError
    """
    for band in bands if instrument.coronagraph.table is None else ():
        if band in instrument.bands and not shipped_file("metrics", metrics_key(instrument, band), band).is_file():
            hint = "on the command line it is computed once, which takes seconds to minutes"
            raise InputError(key, f"other optics in {band}", allowed="the optics of a shipped instrument", hint=hint)
