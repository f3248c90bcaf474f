"""Transcripts of commands and pages: made, and compared with those of another state of the code.

``python -m tests.golden.transcripts write FOLDER [WORDS...]`` answers the questions of ``questions.yaml`` whose names
hold one of the words (all without words), each in a folder of its own; ``... compare FOLDER OTHER [WORDS...]`` says
what differs. Numbers are compared to 1e-9 of themselves, pixels and headers of FITS files as they are; what differs
between runs by nature (times, paths, the fingerprint of the code) is left out. Words and pictures may improve: they
are reported apart and do not fail. ``... keep [WORDS...]`` writes what is printed into ``kept``, with which
``test_golden.py`` compares.
"""

import contextlib
import io
import json
import os
import re
import shlex
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import yaml

HERE = Path(__file__).parent
RELATIVE = 1e-9
QUESTIONS = yaml.safe_load((HERE / "questions.yaml").read_text(encoding="utf-8"))
STORY = ("run.json", "run.lock", "cpic-run.jsonl", "results.csv", "results.json", "report.md")
CHANGING = re.compile(
    r"fingerprint|sha256|hash|checksum|datasum|version|created|elapsed|cpu_|wall_s|_mb$|written|host|software|seconds"
)
_NUMBER = re.compile(r"[-+]?(?:\d+\.\d*|\.\d+|\d+)(?:[eE][-+]?\d+)?")
_HEX = re.compile(r"\b[0-9a-f]{8,64}\b")


def commands():
    """Return the command of each question that is no page, and the question that it reads from or None."""
    both = QUESTIONS["light"] | QUESTIONS["heavy"]
    return {
        name: (entry["command"], entry["after"]) if isinstance(entry, dict) else (entry, None)
        for name, entry in both.items()
    }


def write(folder, names):
    """Answer questions by name, each in ``folder/NAME``; what is printed stands in ``stdout.txt`` there."""
    from cpic_planner.cli.main import main

    os.environ |= {"COLUMNS": "120", "NO_COLOR": "1"}
    asked = commands()
    home = Path.cwd()
    for name in names:
        place = Path(folder, name).resolve()
        print(name, round(time.process_time()), file=sys.stderr, flush=True)
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)
        if name in QUESTIONS["pages"]:
            _write_page(QUESTIONS["pages"][name], place)
            continue
        for file, text in QUESTIONS["files"].items():
            (place / file).write_text(text, encoding="utf-8")
        os.chdir(place)
        out, err = io.StringIO(), io.StringIO()
        try:
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                status = main(["-q", *shlex.split(asked[name][0])])
        finally:
            os.chdir(home)
        for file in QUESTIONS["files"]:
            (place / file).unlink()
        (place / "stdout.txt").write_text(f"{out.getvalue()}\n{err.getvalue()}\nstatus {status}\n", encoding="utf-8")


def kept_names():
    """Return the questions whose transcripts are part of the tests: quick ones, with little to read."""
    asked = QUESTIONS["light"] | QUESTIONS["pages"]
    left_out = re.compile(r"-dry$|^catalog$|^rank|^schema|^plan|list$|^page-(rank|openapi|commands|etc-json)|show|hwo$")
    return [
        name
        for name, question in asked.items()
        if "--json" not in question and (name in ("rank", "rank-explain") or not left_out.search(name))
    ]


def transcript(place):
    """Return what a question in a folder was answered with: what was printed, and the text of a page."""
    parts = [(place / "stdout.txt").read_text(encoding="utf-8")]
    parts += [_plain(page.read_text(encoding="utf-8")) for page in place.glob("page.html")]
    text = re.sub(r"(?<!\.)\b(?=(?:\d*[a-f]){2})[0-9a-f]{12,64}\b", "HASH", "\n".join(parts))
    return "\n".join(line.rstrip() for line in text.splitlines() if line.strip()) + "\n"


def keep(names, folder):
    """Answer questions in a folder and keep their transcripts."""
    write(folder, names)
    for name in names:
        (HERE / "kept" / f"{name}.txt").write_text(transcript(Path(folder, name)), encoding="utf-8")


def _write_page(address, place):
    from cpic_planner.web import application
    from tests.cpic_planner.web.conftest import Browser

    answer = Browser(application()).get(address)
    kind = answer.headers.get("content-type", "")
    name = "page.json" if "json" in kind else "page.svg" if "svg" in kind else "page.html"
    (place / name).write_bytes(answer.body)
    (place / "stdout.txt").write_text(f"status {answer.status} {kind}\n", encoding="utf-8")


def differences(one, other):
    """Return what differs between two folders of one question, as pairs: number, bytes, words or picture; and what."""
    found = []
    files = [
        {path.relative_to(place).as_posix(): path for path in sorted(place.rglob("*")) if path.is_file()}
        for place in (one, other)
    ]
    for name in sorted(files[0].keys() | files[1].keys()):
        if Path(name).name in STORY:
            continue
        if name not in files[0] or name not in files[1]:
            found.append(("bytes", f"{name}: only in {'the second' if name not in files[0] else 'the first'}"))
            continue
        found += [(kind, f"{name}: {text}") for kind, text in _in_file(files[0][name], files[1][name])]
    return found


def _in_file(one, other):
    suffix = one.suffix
    if suffix in (".fits", ".gz"):
        return _in_fits(one, other)
    if suffix == ".png":
        from PIL import Image

        sizes = [Image.open(path).size for path in (one, other)]
        same = sizes[0] == sizes[1] and np.array_equal(*(np.asarray(Image.open(path)) for path in (one, other)))
        return [] if same else [("picture", f"{sizes[0]} {sizes[1]}")]
    if suffix == ".parquet":
        import pandas as pd

        tables = [pd.read_parquet(path) for path in (one, other)]
        if list(tables[0].columns) != list(tables[1].columns) or len(tables[0]) != len(tables[1]):
            return [("number", f"columns or rows: {tables[0].shape} {tables[1].shape}")]
        return [d for column in tables[0] for d in _in_values(column, *(list(t[column]) for t in tables))]
    if suffix == ".npz":
        arrays = [np.load(path) for path in (one, other)]
        same = sorted(arrays[0].files) == sorted(arrays[1].files)
        return [("bytes", key) for key in arrays[0].files if not same or not np.array_equal(*(a[key] for a in arrays))]
    try:
        texts = [path.read_text(encoding="utf-8") for path in (one, other)]
    except UnicodeDecodeError:
        return [] if one.read_bytes() == other.read_bytes() else [("bytes", "differ")]
    if texts[0] == texts[1]:
        return []
    if suffix == ".json" or (texts[0].lstrip()[:1] == "{" and one.name == "stdout.txt"):
        trees = [_json_of(text) for text in texts]
        if None not in trees:
            return list(_in_tree("", *trees))
    if suffix == ".svg":
        return [("picture", "drawn otherwise")] if _drawing(texts[0]) != _drawing(texts[1]) else []
    return _in_text(*(_plain(text) if suffix == ".html" else text for text in texts))


def _json_of(text):
    try:
        return json.JSONDecoder().raw_decode(text.lstrip())[0]
    except ValueError:
        return None


def _drawing(text):
    return re.sub(r"(id|href|clip-path)=\"[^\"]*\"|url\([^)]*\)|<dc:date>.*?</dc:date>", "", text)


def _plain(html):
    pictures = len(re.findall(r"<svg|<img", html))
    html = re.sub(r"(?s)<(script|style|svg)\b.*?</\1>|<!--.*?-->", " ", html)
    return f"{pictures} pictures\n" + re.sub(r"<[^>]*>", " ", html)


def _in_tree(path, one, other):
    if isinstance(one, dict) and isinstance(other, dict):
        for key in one.keys() | other.keys():
            if CHANGING.search(key):
                continue
            if key not in one or key not in other:
                yield "number", f"{path}.{key}: only in {'the second' if key not in one else 'the first'}"
            else:
                yield from _in_tree(f"{path}.{key}", one[key], other[key])
    elif isinstance(one, list) and isinstance(other, list):
        if len(one) != len(other):
            yield "number", f"{path}: {len(one)} and {len(other)} entries"
        for index, (a, b) in enumerate(zip(one, other, strict=False)):
            yield from _in_tree(f"{path}[{index}]", a, b)
    elif isinstance(one, str) and isinstance(other, str):
        for kind, text in _in_text(one, other):
            yield kind, f"{path}: {text}"
    else:
        yield from _in_values(path, [one], [other])


def _in_values(name, one, other):
    for index, (a, b) in enumerate(zip(one, other, strict=True)):
        if isinstance(a, (int, float, np.number)) and isinstance(b, (int, float, np.number)):
            if not (a == b or (a != a and b != b) or abs(a - b) <= RELATIVE * max(abs(a), abs(b))):
                yield "number", f"{name}[{index}]: {a!r} {b!r}"
        elif isinstance(a, np.ndarray):
            if not np.array_equal(a, b):
                yield "number", f"{name}[{index}]: arrays differ"
        elif a != b and not (a is None and b is None):
            yield ("words" if isinstance(a, str) and isinstance(b, str) else "number"), f"{name}[{index}]: {a!r} {b!r}"


def _in_text(one, other):
    one, other = (re.sub(r"20\d\d-\d\d-\d\dT[\d:.]+Z?", "TIME", _HEX.sub("HASH", text)) for text in (one, other))
    if one == other:
        return []
    numbers = [[float(x) for x in _NUMBER.findall(text)] for text in (one, other)]
    words = [_NUMBER.sub("#", text).split() for text in (one, other)]
    found = []
    if sorted(numbers[0]) != sorted(numbers[1]):
        left = [list(n) for n in numbers]
        for value in numbers[0]:
            if value in left[1]:
                left[1].remove(value)
                left[0].remove(value)
        found.append(("number", f"only in the first {left[0][:8]}, only in the second {left[1][:8]}"))
    if words[0] != words[1]:
        import difflib

        shown = [line for line in difflib.ndiff(_lines(one), _lines(other)) if line[:1] in "+-"]
        found.append(("words", " | ".join(shown)[:600]))
    return found


def _lines(text):
    return [" ".join(line.split()) for line in text.splitlines() if line.strip()]


def _in_fits(one, other):
    from astropy.io import fits

    found = []
    with fits.open(one) as a, fits.open(other) as b:
        if len(a) != len(b):
            return [("bytes", f"{len(a)} and {len(b)} units")]
        for index, (x, y) in enumerate(zip(a, b, strict=True)):
            if (x.data is None) != (y.data is None) or (x.data is not None and x.data.tobytes() != y.data.tobytes()):
                found.append(("bytes", f"data of unit {index}"))
            cards = [{k: v for k, v in h.header.items() if k not in ("CHECKSUM", "DATASUM", "DATE")} for h in (x, y)]
            for key in cards[0].keys() | cards[1].keys():
                values = [c.get(key) for c in cards]
                if str(values[0]) != str(values[1]) and not CHANGING.search(str(key).lower()):
                    if key in ("HISTORY", "COMMENT", "FINGERPR", "CODE") or _HEX.search(str(values[0])):
                        continue
                    found.append(("bytes", f"header {index} {key}: {values[0]!r} {values[1]!r}"))
    return found


def main(words):
    """Write, compare or keep, see above."""
    if words[0] == "keep":
        names = [name for name in kept_names() if not words[1:] or any(re.search(part, name) for part in words[1:])]
        with tempfile.TemporaryDirectory() as folder:
            keep(names, folder)
        return 0
    task, folders, parts = (
        words[0],
        words[1 : 2 if words[0] == "write" else 3],
        words[2 if words[0] == "write" else 3 :],
    )
    known = [*QUESTIONS["light"], *QUESTIONS["pages"], *QUESTIONS["heavy"]]
    names = [name for name in known if not parts or any(re.search(part, name) for part in parts)]
    if task == "write":
        write(folders[0], names)
        return 0
    worst = 0
    compared = 0
    for name in names:
        places = [Path(folder, name) for folder in folders]
        if not all(place.exists() for place in places):
            print(f"{name}: not in both folders")
            continue
        compared += 1
        for kind, text in differences(*places):
            worst |= kind in ("number", "bytes")
            print(f"{name} [{kind}] {text}")
    print(f"{compared} questions compared")
    return int(worst)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
