"""Heavy libraries, loaded on first use and without their chatter.

One numeric context for every command and public function: the same bytes for any number of processors.

A product of matrices adds in another order for another number of BLAS threads, so that without it the last digits
would depend on the machine, on ``OMP_NUM_THREADS`` and on ``taskset``.

Announcements of work that takes a while: to a logger, silent unless somebody listens, or to whoever counts it.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import importlib
import logging
import os
import shutil
import sys
import tempfile
import threading
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController


def load_quietly(name: str) -> Any:
    """Import a module; progress-bar packages complain, on import, where a notebook has no widgets.

    Parameters
    ----------
    name : str
        Full name of the module.

    Returns
    -------
    module

    Raises
    ------
    ImportError
        If it is not installed.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="IProgress not found")
        return importlib.import_module(name)


@functools.cache
def load_kernels(name: str) -> Any:
    """Import a module of compiled kernels; it is announced where this machine has yet to compile them.

    Parameters
    ----------
    name : str
        Full name of the module.

    Returns
    -------
    module
    """
    try:
        module = importlib.import_module(name)
    except RuntimeError as error:
        if "no locator available" not in str(error):
            raise
        # Neither the folder of the package nor the user's home can be written: compiled for this run alone.
        os.environ["NUMBA_CACHE_DIR"] = private_folder()
        importlib.import_module("numba.core.config").reload_config()
        module = importlib.import_module(name)
    source = Path(str(module.__file__))
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    folder, pattern = (Path(chosen), "**/") if chosen else (source.parent, "__pycache__/")
    kept = folder.glob(f"{pattern}{source.stem}.*.nbi")
    if next(kept, None) is None:
        announce(f"compiling {name.rpartition('.')[2]} for this machine, once: about 10 s on a free processor")
    return module


@functools.cache
def private_folder() -> str:
    """Return a temporary folder that this user alone can read; it is removed when the process ends."""
    folder = tempfile.mkdtemp(prefix="cpic-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


_LIBRARIES = ("OMP_NUM", "OPENBLAS_NUM", "MKL_NUM", "BLIS_NUM", "VECLIB_MAXIMUM", "NUMEXPR_NUM")
THREAD_VARIABLES = tuple(f"{library}_THREADS" for library in _LIBRARIES)
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
    >>> from cpic_core.runtime import numeric_context
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


LOGGER = "cpic_core.runtime"
_LOG = logging.getLogger(LOGGER)


class Advance(Protocol):
    """Told about finished pieces of work."""

    def __call__(self, text: str, steps: int = 1, /) -> None:
        """Note ``steps`` more pieces, the last of which ``text`` names."""


def untold(text: str, steps: int = 1, /) -> None:
    """Tell nobody: the `Advance` of those who do not want to know."""


def announce(text: str) -> None:
    """Say what is done from now on, at level INFO: the command line shows it, a script only if it asks for it.

    Parameters
    ----------
    text : str
        The work, and about how long it takes where that is known.
    """
    _LOG.info("%s", text)
