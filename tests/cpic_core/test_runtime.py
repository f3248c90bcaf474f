"""One numeric context: a BLAS thread, whatever the machine, the environment and the order of imports say.

Functions that load alone are those of `scipy.special`, which works as ever once somebody asks for it.
"""

import json
import os
import subprocess
import sys
import threading
import warnings

import numpy as np
import pytest
import scipy.special
from threadpoolctl import threadpool_info, threadpool_limits

from cpic_core import THREAD_VARIABLES, load_kernels, numeric_context, special, stream

LATE = """
import json, sys
import numpy
from threadpoolctl import threadpool_info
from cpic_core.runtime import numeric_context
threads = lambda: [library["num_threads"] for library in threadpool_info()]
before = threads()
with numeric_context():
    import scipy.linalg
    within = threads()
print(json.dumps([before, within, threads()]))
"""


def blas_threads():
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


def environment():
    return {name: os.environ.get(name) for name in THREAD_VARIABLES}


@pytest.fixture
def two_threads(monkeypatch):
    """Two BLAS threads and an environment that asks for them, if the machine has two processors."""
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    with threadpool_limits(2):
        yield blas_threads()


def test_one_thread_inside_and_the_old_number_after(two_threads):
    before = environment()
    with numeric_context():
        assert blas_threads() == {1}
        assert set(environment().values()) == {"1"}
        with numeric_context():
            assert blas_threads() == {1}
        assert blas_threads() == {1}
    assert blas_threads() == two_threads
    assert environment() == before


def test_it_ends_with_an_error_too(two_threads):
    @numeric_context()
    def fails():
        assert blas_threads() == {1}
        raise KeyError

    for _ in range(2):
        with pytest.raises(KeyError):
            fails()
        assert blas_threads() == two_threads


def test_another_thread_that_leaves_does_not_end_it(two_threads):
    entered, leave = threading.Event(), threading.Event()

    def other():
        with numeric_context():
            entered.set()
            leave.wait(10.0)

    thread = threading.Thread(target=other)
    with numeric_context():
        thread.start()
        assert entered.wait(10.0)
        leave.set()
        thread.join()
        assert blas_threads() == {1}
        assert os.environ["OMP_NUM_THREADS"] == "1"
    assert blas_threads() == two_threads


def test_libraries_that_are_loaded_inside_have_one_thread_there_and_as_many_as_the_others_after():
    clean = {name: value for name, value in os.environ.items() if name not in THREAD_VARIABLES}
    done = subprocess.run([sys.executable, "-c", LATE], env=clean, capture_output=True, text=True, check=True)
    before, within, after = json.loads(done.stdout)
    assert set(within) == {1}
    assert len(within) > len(before)  # scipy did bring its own
    assert set(after) == set(before)


def test_settings_of_the_caller_for_floating_point_errors_do_not_matter():
    @numeric_context()
    def tiny():
        return np.array([1e-300]) * 1e-300

    with np.errstate(all="raise"):
        assert tiny() == 0.0
    with np.errstate(all="ignore"), numeric_context(), warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        np.array([1.0]) / 0.0
        assert len(seen) == 1


def test_kernels_are_compiled_where_nothing_can_be_kept(tmp_path, monkeypatch):
    """Neither beside the code nor at home, as in a container: a private folder takes them for as long as it runs."""
    from numba.core import caching, config

    real = caching.tempfile.TemporaryFile

    def nowhere(dir):
        if not os.path.basename(dir).startswith("cpic-") and "/cpic-" not in str(dir):
            raise PermissionError(13, "Permission denied", dir)
        return real(dir=dir)

    (tmp_path / "home_less_kernels.py").write_text(
        "from numba import njit\n\n\n@njit(cache=True)\ndef twice(x):\n    return 2 * x\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(caching.tempfile, "TemporaryFile", nowhere)
    monkeypatch.setattr(config, "CACHE_DIR", "")
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    kernels = load_kernels("home_less_kernels")
    folder = os.environ["NUMBA_CACHE_DIR"]
    assert kernels.twice(21) == 42
    assert os.stat(folder).st_mode & 0o777 == 0o700
    assert any(name.endswith(".nbi") for _, _, names in os.walk(folder) for name in names)


ALONE = """
import sys
from cpic_core import special
assert special().ndtr(0.0) == 0.5
from scipy.special import gammaln, hyp2f1
assert (gammaln, hyp2f1) == (special().gammaln, special().hyp2f1)
loaded = {"scipy.linalg", "scipy.special._orthogonal", "numpy.f2py"} & set(sys.modules)
assert not loaded, loaded
"""
LATER = """
import threading
import scipy.special
found = []
ask = [threading.Thread(target=lambda: found.append(scipy.special.logsumexp([0.0, 0.0]))) for _ in range(4)]
[one.start() for one in ask]
[one.join() for one in ask]
assert [round(value, 12) for value in found] == [0.693147180560] * 4, found
from scipy.special import ndtr
assert ndtr is special().ndtr
assert not hasattr(scipy.special, "no_such_function")
import scipy.stats
assert scipy.stats.norm.cdf(0.0) == 0.5
"""


def run(code):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_loads_nothing_beside_them():
    run(ALONE)


def test_the_package_loads_once_it_is_asked_for():
    run(ALONE + LATER)


def test_the_package_may_be_there_already():
    run("import scipy.special\n" + ALONE.partition("loaded =")[0] + LATER)


def test_same_functions():
    for name in ("ndtr", "ndtri", "stdtrit", "j0", "j1", "betainc", "betaincinv"):
        assert getattr(special(), name) is getattr(scipy.special, name)


def test_same_path_same_numbers_in_another_process():
    here = stream(7, "HIP 71681", "science", 3, "photons").integers(2**62, size=4).tolist()
    draw = "stream(7,'HIP 71681','science',3,'photons').integers(2**62,size=4).tolist()"
    code = f"from cpic_core.runtime import stream; print({draw})"
    there = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert there.strip() == str(here)


def test_paths_that_look_alike_are_different():
    paths = [("a", "bc"), ("ab", "c"), ("abc",), ("a", "b", "c"), (1,), ("1",), (1, 1), (11,), ("a|s1:b",), ("a", "b")]
    first = [stream(0, *path).integers(2**62) for path in paths]
    assert len(set(first)) == len(paths)
    assert stream(0, "a").integers(2**62) != stream(1, "a").integers(2**62)


def test_streams_are_uncorrelated():
    draws = np.array([stream(1, "frame", index).standard_normal(4000) for index in range(40)])
    correlation = np.corrcoef(draws)[np.triu_indices(40, 1)]
    # 780 pairs of variance 1/4000: four standard errors of the mean square.
    assert abs(np.mean(correlation**2) * 4000 - 1) < 4 * np.sqrt(2 / correlation.size)
    assert abs(draws.mean()) < 4 / np.sqrt(draws.size)


def test_bad_path_parts_are_refused(refused):
    refused("stream path", stream, 1, 2.5)
