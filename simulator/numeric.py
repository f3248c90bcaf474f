"""One numeric context for every command and public function: the same bytes for any number of processors.

A product of matrices adds in another order for another number of BLAS threads, so that without it the last digits
would depend on the machine, on ``OMP_NUM_THREADS`` and on ``taskset``.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

__all__ = ["THREAD_VARIABLES", "numeric_context"]

THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)
"""Environment variables from which numerical libraries read their number of threads when they are loaded."""

_lock = threading.Lock()
_entered = 0
_process = contextlib.ExitStack()
_seen: tuple[int, ThreadpoolController] | None = None


@contextlib.contextmanager
def numeric_context() -> Iterator[None]:
    """Compute with one BLAS thread, and with numpy's own reports of floating-point errors; also a decorator.

    Contexts may be nested, and entered by several Python threads at once: the first one in sets the process, the last
    one out restores it.

    Examples
    --------
    >>> import os
    >>> from simulator.numeric import numeric_context
    >>> with numeric_context():
    ...     os.environ["OMP_NUM_THREADS"]
    '1'
    """
    global _entered
    with _lock:
        if not _entered:
            _process.enter_context(_one_thread())
        _entered += 1
    try:
        with np.errstate(divide="warn", over="warn", under="ignore", invalid="warn"):
            yield
    finally:
        with _lock:
            _entered -= 1
            if not _entered:
                _process.close()


def _libraries() -> ThreadpoolController:
    """Return the numerical libraries of this process; they are looked for again only where modules were imported since.

    Looking takes milliseconds, and short functions enter a context thousands of times.
    """
    global _seen
    modules = len(sys.modules)
    if _seen is None or _seen[0] != modules:
        from threadpoolctl import ThreadpoolController

        _seen = len(sys.modules), ThreadpoolController()
    return _seen[1]


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Give one thread to libraries that are loaded, and by the environment to those that are loaded meanwhile."""
    loaded = _libraries()
    variables = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    threads = {library.filepath: library.num_threads for library in loaded.lib_controllers}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    try:
        with loaded.limit(limits=1):
            try:
                yield
            finally:
                # A library that was loaded meanwhile (scipy brings a BLAS of its own) gets what the others had.
                for library in _libraries().lib_controllers:
                    if library.filepath not in threads:
                        library.set_num_threads(max(threads.values(), default=1))
    finally:
        for name, value in variables.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
