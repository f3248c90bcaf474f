"""Measure how fast this machine works, so that estimates of run times hold on it."""

from __future__ import annotations

import functools
import hashlib
import time
from typing import TYPE_CHECKING, Any

from cpic_core import compute_once, fingerprint

if TYPE_CHECKING:
    from collections.abc import Mapping

_REFERENCE_S = 0.048
"""Processor time of the piece of work on the core that the costs of jobs are stated for (Intel Xeon of 2.5 GHz)."""
_TRIES, _SIZE, _PRODUCTS, _DRAWS, _CALLS = 12, 256, 8, 200_000, 4000


def piece_s() -> float:
    """Return the processor time of one piece of work (s), which has a part of each kind of work of the jobs.

    The parts take about a third each: complex matrix products, as a propagation of light has them; draws of Poisson
    and gamma variates and a sort, as frames have them; calls of numpy on short arrays, as rankings and calendars do.
    """
    import numpy as np

    generator = np.random.default_rng(0)
    matrix = generator.random((_SIZE, _SIZE)) + 1j * generator.random((_SIZE, _SIZE))
    mean, short = np.full(_DRAWS, 3.0), np.arange(16.0)
    begun = time.process_time()
    for _ in range(_PRODUCTS):
        matrix @ matrix
    generator.poisson(mean)
    generator.gamma(3.0, size=_DRAWS // 2)
    np.sort(generator.random(_DRAWS // 2))
    for number in range(_CALLS):
        float(np.sum(short * number))
    return time.process_time() - begun


@functools.cache
def pace() -> float:
    """Return the processor time of work on this machine over that of the core that costs are stated for.

    It is the quickest of a few tries, since other processes slow down a try but never speed it up, and is kept in the
    cache: measured once for each machine and version, in about half a second.
    """
    import numpy as np

    digest = hashlib.sha256(str(fingerprint()).encode()).hexdigest()[:16]

    def measured() -> Mapping[str, Any]:
        return {"pace": np.array(min(piece_s() for _ in range(_TRIES)) / _REFERENCE_S)}

    return compute_once(f"pace-{digest}", measured, lambda arrays: float(arrays["pace"]))
