"""Seeded random streams named by path, so that no draw depends on the order of execution.

A stream is keyed by ``(seed, *path)``; the path names target, role, band, realisation, frame and
stage. Two different paths give independent streams (NumPy ``SeedSequence`` over a SHA-256 digest of
the path), the same path gives the same numbers in any process. Adding a stage, or switching one
off, therefore leaves the numbers of every other stage unchanged.
"""

import functools
import hashlib
from typing import Any, TypeAlias, cast

import numpy as np

from cpic_core.errors import InputError
from cpic_core.quantities import NDArray

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
    >>> from cpic_core.random_streams import stream
    >>> a = stream(1, "HIP 71681", "science", "F520", 0, 3, "photons").random()
    >>> b = stream(1, "HIP 71681", "science", "F520", 0, 3, "photons").random()
    >>> a == b
    True
    """
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence(_words(seed, path))))
