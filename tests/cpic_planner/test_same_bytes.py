"""The same bytes on any number of processors, in any language, time zone and folder; nearly the same on others.

The short form, with one ranking, one answer and one frame, is in ``test_numeric_context``.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from astropy.io import fits

from cpic_core import PROMISES, THREAD_VARIABLES, differing_words, fingerprint, promise_of
from cpic_core.provenance import TOLERANCE, TOLERANCE_SIGMA

pytestmark = pytest.mark.long
SCRIPT = Path(__file__).with_name("commands_that_write.py")
NAMES = ("etc", "rank", "simulate", "plan", "whatif", "confirm", "curve")
STORY = ("run.json", "run.lock", "cpic-run.jsonl")
CLEAN = {name: value for name, value in os.environ.items() if name not in THREAD_VARIABLES}


def made(folder, *before, options=(), **environment):
    """What the commands write in a process of their own: files by name, and the fingerprint, all that is printed."""
    folder.mkdir(parents=True)
    run = [*before, sys.executable, str(SCRIPT), *options, *NAMES]
    done = subprocess.run(run, cwd=folder, env=CLEAN | environment, capture_output=True, text=True, check=True)
    files = {
        path.relative_to(folder).as_posix(): path
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in STORY
    }
    assert len(files) > 30
    (mark,) = done.stdout.splitlines()
    return files, mark


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return made(tmp_path_factory.mktemp("plain") / "a", OMP_NUM_THREADS="1")


MACHINES = {
    "two threads in another time zone": ((), (), {"OMP_NUM_THREADS": "2", "TZ": "Pacific/Apia"}),
    "as many threads as processors in another language": (
        (),
        (),
        {"LC_ALL": "C", "LANG": "tr_TR.UTF-8", "LANGUAGE": "tr"},
    ),
    "one processor, another order of sets, no network": (
        ("taskset", "-c", "0"),
        ("--offline",),
        {"PYTHONHASHSEED": "4242"},
    ),
}
"""Settings that have nothing to do with each other are tried together; where bytes differ, one by one tells which."""


@pytest.mark.parametrize("name", MACHINES)
def test_bytes_do_not_depend_on(name, plain, tmp_path, record_property):
    before, options, environment = MACHINES[name]
    if before and shutil.which(before[0]) is None:
        pytest.skip("util-linux is not installed")
    files, mark = made(tmp_path / "a folder of another name" / "b", *before, options=options, **environment)
    assert mark == plain[1] == str(fingerprint())
    assert promise_of(mark, plain[1]) == PROMISES[0]
    assert sorted(files) == sorted(plain[0])
    assert [file for file, path in files.items() if path.read_bytes() != plain[0][file].read_bytes()] == []
    record_property("files", len(files))


OTHERS = {
    "an x86-64 of 2013": {"NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR", "OPENBLAS_CORETYPE": "Haswell"},
    "an x86-64 of 2008": {
        "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
        "OPENBLAS_CORETYPE": "Nehalem",
        "NUMBA_CPU_NAME": "nehalem",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX2,-AVX,-FMA",
    },
}
"""What makes this processor compute as another one does."""
DRAWN = ("simulation.json", "parts/", ".blob", ".html", "measurements.csv", "confirm.txt", "plan.txt")
DRAWN += ("curve/curve.csv", "recovered.csv", "curve.txt", "export/")
MEASURED = ("confirm/confirm.json", "plan/plan.json", "curve/curve.json")
"""What holds sums of frames, or the content of files that are compared otherwise; and what holds measurements."""


def leaves(tree, path=""):
    """Every value of a JSON tree by its place, but for the fingerprint."""
    if isinstance(tree, dict | list):
        for key, item in tree.items() if isinstance(tree, dict) else enumerate(tree):
            yield from leaves(item, f"{path}/{key}")
    elif not path.endswith(("/fingerprint", "/FPRINT")):
        yield path, tree


def values(name, path):
    """What a file holds: values by place."""
    text = path.read_text() if path.suffix in (".json", ".csv", ".txt") else ""
    if path.suffix == ".parquet":
        columns = pq.read_table(path).to_pydict()
        return {f"{column}/{row}": value for column, cells in columns.items() for row, value in enumerate(cells)}
    if path.suffix == ".csv":
        cells = [line.split(",") for line in text.splitlines()]
        return {f"{row}/{column}": number(cell) for row, line in enumerate(cells) for column, cell in enumerate(line)}
    return dict(leaves(json.loads(text))) if text.startswith("{") else {}


def number(text):
    try:
        return float(text)
    except ValueError:
        return text


def distance(one, other):
    """Relative difference of two values; infinite where they are not numbers and differ."""
    if one == other:
        return 0.0
    if not all(isinstance(value, int | float) and not isinstance(value, bool) for value in (one, other)):
        return float("inf")
    if 0.0 in (one, other) and abs(one - other) <= 2.0**-50:  # what is left where two equal numbers are subtracted
        return 0.0
    return abs(one - other) / max(abs(one), abs(other))


@pytest.mark.parametrize("name", OTHERS)
def test_another_processor_gives_nearly_the_same(name, plain, tmp_path, record_property):
    """Nothing that was worked out with the other one is taken over: neither optics nor compiled kernels."""
    if os.uname().machine != "x86_64":
        pytest.skip("processors of x86-64")
    kept = {"CPIC_CACHE_DIR": str(tmp_path / "cache"), "NUMBA_CACHE_DIR": str(tmp_path / "numba")}
    files, mark = made(tmp_path / "b", OMP_NUM_THREADS="1", **kept, **OTHERS[name])
    assert differing_words(mark, plain[1]) == ["processor"]
    assert promise_of(mark, plain[1]) == PROMISES[1]
    worst, measured, drawn, pixels, brightest = 0.0, 0.0, 0, 0, 0.0
    for file, path in files.items():
        here = plain[0][file]
        if file.endswith(".fits"):
            with fits.open(here) as mine, fits.open(path) as theirs:
                for one, other in zip(mine[1:], theirs[1:], strict=True):
                    apart = np.abs(np.asarray(one.data, float) - np.asarray(other.data, float)) if one.is_image else 0.0
                    if one.name == "IMAGE":
                        assert apart.max() <= 4 * one.header["EMGAIN"]
                        drawn, pixels = drawn + int((apart > 0.0).sum()), pixels + apart.size
                    elif one.name.startswith("EXPECTED"):
                        brightest = max(brightest, float(apart.max() / one.data.max()))
        elif not any(word in file for word in DRAWN):
            mine, theirs = values(file, here), values(file, path)
            assert mine.keys() == theirs.keys(), file
            apart = {place: distance(value, theirs[place]) for place, value in mine.items()}
            if file in MEASURED:
                # A covariance follows from errors that are compared too, as the difference of nearly equal squares.
                far = {place: value for place, value in apart.items() if value > 1e-3}
                assert [place for place in far if not re.search("chi2|covariance", place)] == []
                places = [place for place in mine if re.search("recovered_s|search_snr", place) and mine[place]]
                measured = max(measured, *(abs(mine[place] - theirs[place]) for place in places), 0.0)
            else:
                worst = max(worst, *apart.values(), 0.0)
    assert worst <= TOLERANCE
    assert measured <= TOLERANCE_SIGMA
    assert drawn <= 1e-5 * pixels > 10.0
    assert brightest <= 2.0**-21  # frames of 32 bits
    record_property("SNRs measured in images", f"{measured:.2g}")
    record_property("computed numbers", f"{worst:.1e} relative")
    record_property("drawn counts that differ", f"{drawn} of {pixels}")
    record_property("expected images", f"{brightest:.1e} of the brightest pixel")
