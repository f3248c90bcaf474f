"""The same bytes on any number of processors, in any language, time zone and folder; nearly the same on others.

The short form, with one ranking, one answer and one frame, is in ``test_numeric_context``.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits

from cpic_core import THREAD_VARIABLES, differing_words, fingerprint, promise_of
from cpic_core.provenance import PROMISES, TOLERANCE

pytestmark = pytest.mark.long
PROVES = ("cpic_core", "catalogs", "simulator", "cpic_planner")
SCRIPT = Path(__file__).with_name("commands_that_write.py")
NAMES = ("etc", "rank", "simulate", "plan", "whatif", "confirm")
STORY = ("run.json", "run.lock", "cpic-run.jsonl")
CLEAN = {name: value for name, value in os.environ.items() if name not in THREAD_VARIABLES}


def made(folder, *before, **environment):
    """What the commands write in a process of their own: content by name, and the fingerprint."""
    folder.mkdir(parents=True)
    run = [*before, sys.executable, str(SCRIPT), *NAMES]
    done = subprocess.run(run, cwd=folder, env=CLEAN | environment, capture_output=True, text=True, check=True)
    files = {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in STORY
    }
    assert len(files) > 30
    return files, done.stdout.split()[-1]


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return made(tmp_path_factory.mktemp("plain") / "a", OMP_NUM_THREADS="1", CPIC_CACHE_DIR=str(CACHE))


CACHE = Path(os.environ.get("CPIC_CACHE_DIR", "~/.cache/cpic-planner")).expanduser()
MACHINES = {
    "two threads": ((), {"OMP_NUM_THREADS": "2"}),
    "as many threads as processors": ((), {}),
    "one processor": (("taskset", "-c", "0"), {}),
    "another language": ((), {"LC_ALL": "C", "LANG": "tr_TR.UTF-8", "LANGUAGE": "tr"}),
    "another time zone": ((), {"TZ": "Pacific/Apia"}),
    "another order of sets": ((), {"PYTHONHASHSEED": "4242"}),
}


@pytest.mark.parametrize("name", MACHINES)
def test_bytes_do_not_depend_on(name, plain, tmp_path, record_property):
    before, environment = MACHINES[name]
    if before and shutil.which(before[0]) is None:
        pytest.skip("util-linux is not installed")
    files, mark = made(tmp_path / "a folder of another name" / "b", *before, CPIC_CACHE_DIR=str(CACHE), **environment)
    assert mark == plain[1] == str(fingerprint())
    assert promise_of(mark, plain[1]) == PROMISES[0]
    assert sorted(files) == sorted(plain[0])
    assert [file for file in files if files[file] != plain[0][file]] == []
    record_property("files", len(files))


OTHERS = {
    "an x86-64 of 2013": {"NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR", "OPENBLAS_CORETYPE": "Haswell"},
    "an x86-64 of 2008": {
        "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
        "OPENBLAS_CORETYPE": "Nehalem",
        "NUMBA_CPU_NAME": "nehalem",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX,-AVX512F",
    },
}
