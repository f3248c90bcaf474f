"""Special functions of `scipy`, without what its package loads beside them.

The functions are compiled and load in milliseconds; ``import scipy.special`` takes as long as a whole question, most of
it for array libraries that are not used here.
"""

import functools
import importlib
import sys
import threading
from importlib.util import find_spec, module_from_spec
from types import ModuleType
from typing import Any

import numpy as np


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
