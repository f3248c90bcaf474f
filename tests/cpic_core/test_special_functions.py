"""Functions that load alone are those of `scipy.special`, which works as ever once somebody asks for it."""

import subprocess
import sys

import scipy.special

from cpic_core import special

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
