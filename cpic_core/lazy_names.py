"""Names of a package that load on first use; its stub ``__init__.pyi`` is the only list of them."""

import importlib
import re
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

_IMPORT = re.compile(r"^from (\S+) import (?:\(([^)]*)\)|(.*))$", re.MULTILINE)
_NAME = re.compile(r"(\w+) as \w+")


def lazy_names(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return what a package needs to offer the names that its stub imports, each loaded when it is first asked for.

    Parameters
    ----------
    package : str
        Name of the package, its ``__name__``.
    file : str
        Path of its ``__init__.py``; the stub lies beside it.

    Returns
    -------
    tuple
        ``__getattr__``, ``__dir__`` and ``__all__`` of the package (PEP 562).
    """
    text = Path(file).with_suffix(".pyi").read_text(encoding="utf-8")
    home = {name: module for module, *names in _IMPORT.findall(text) for name in _NAME.findall("".join(names))}
    loaded: dict[str, ModuleType] = {}

    def load(name: str) -> Any:
        if name not in home:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        # Not from `sys.modules`: what another thread is still importing stands there half made.
        if name not in loaded:
            loaded[name] = importlib.import_module(str(home[name]))
        return getattr(loaded[name], name)

    return load, lambda: sorted(home), sorted(home)
