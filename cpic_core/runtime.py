"""Numeric context, named random streams, announcements of long work, and heavy libraries that load on first use.

One numeric context for every command and public function: the same bytes for any number of processors.

A product of matrices adds in another order for another number of BLAS threads, so that without it the last digits
would depend on the machine, on ``OMP_NUM_THREADS`` and on ``taskset``.

Announcements of work that takes a while: to a logger, silent unless somebody listens, or to whoever counts it.

Special functions of `scipy` come without what its package loads beside them: they are compiled and load in
milliseconds; ``import scipy.special`` takes as long as a whole question, most of it for array libraries that are not
used here.

Random streams are seeded and named by path, so that no draw depends on the order of execution. A stream is keyed by
``(seed, *path)``; the path names target, role, band, realisation, frame and stage. Two different paths give
independent streams (NumPy ``SeedSequence`` over a SHA-256 digest of the path), the same path gives the same numbers in
any process. Adding a stage, or switching one off, therefore leaves the numbers of every other stage unchanged.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import hashlib
import importlib
import logging
import os
import shutil
import sys
import tempfile
import threading
import warnings
from collections.abc import Hashable, Iterator
from dataclasses import field
from importlib.util import find_spec, module_from_spec
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeAlias, TypeVar, cast

import numpy as np

from cpic_core.errors import InputError
from cpic_core.quantities import NDArray
from cpic_core.records import Record

T = TypeVar("T")

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


class Keyed(Record, Generic[T]):
    """A value that stands for all of the same key: what is kept in memory of one serves the others.

    Attributes
    ----------
    key : hashable
        All of the value that counts.
    value : T
    """

    key: Hashable
    value: T = field(compare=False)


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


class _Face(ModuleType):
    """A package that hands out compiled functions; its own code runs when the first other name is asked for."""

    _lock: threading.RLock
    _begun: bool

    def __getattr__(self, name: str) -> Any:
        own = vars(self)
        compiled = getattr(sys.modules.get(f"{self.__name__}._ufuncs"), name, None)
        if isinstance(compiled, np.ufunc):
            return compiled
        with own["_lock"]:
            if not own["_begun"]:
                own["_begun"] = True
                assert self.__spec__ is not None
                assert self.__spec__.loader is not None
                self.__spec__.loader.exec_module(self)
        if name in own:
            return own[name]
        raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")


@functools.cache
def special() -> Any:
    """Return the module of compiled special functions: ``special().ndtr`` is ``scipy.special.ndtr``.

    Notes
    -----
    `scipy.special` itself loads on the first use of a name of its own, by whomever.
    """
    name = "scipy.special"
    spec = None if name in sys.modules else find_spec(name)
    if spec is not None:
        face = module_from_spec(spec)
        face.__class__ = _Face
        vars(face).update(_lock=threading.RLock(), _begun=False)
        sys.modules[name] = face
    try:
        return importlib.import_module(f"{name}._ufuncs")
    except ImportError:  # a private name, which other versions may not have
        return importlib.import_module(name)


PathPart: TypeAlias = str | int
MAX_SEED = 2**63 - 1
_INTEGERS = (int, np.integer)
_PARTS = (str, *_INTEGERS)


def _words(seed: int, path: tuple[PathPart, ...]) -> NDArray[np.uint32]:
    if isinstance(seed, bool) or not isinstance(seed, _INTEGERS) or not 0 <= int(seed) <= MAX_SEED:
        raise InputError("seed", seed, allowed=f"an integer from 0 to {MAX_SEED}")
    text = f"seed:{int(seed)}" + "".join([_text(cast(Any, type(part)), part) for part in path])
    digest = hashlib.sha256(text.encode()).digest()
    return np.frombuffer(digest, dtype="<u4").astype(np.uint32, copy=False)


@functools.lru_cache(maxsize=4096)
def _text(kind: Any, part: PathPart) -> str:
    """Return a name with its kind and length, so that no two paths read alike."""
    if kind is bool or not issubclass(kind, _PARTS):
        raise InputError("stream path", part, allowed="strings and integers")
    name = str(part)
    return f"|{'s' if issubclass(kind, str) else 'i'}{len(name)}:{name}"


def stream(seed: int, *path: PathPart) -> np.random.Generator:
    """Yield the random generator of one named stage.

    Parameters
    ----------
    seed : int
        Seed of the run, 0 to 2**63 - 1.
    *path : str or int
        Names of target, role, band, realisation, frame, stage ...

    Returns
    -------
    numpy.random.Generator
        SFC64 generator (the fastest bit generator of NumPy) on an independent stream.

    Examples
    --------
    >>> from cpic_core.runtime import stream
    >>> a = stream(1, "HIP 71681", "science", "F520", 0, 3, "photons").random()
    >>> b = stream(1, "HIP 71681", "science", "F520", 0, 3, "photons").random()
    >>> a == b
    True
    """
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence(_words(seed, path))))
