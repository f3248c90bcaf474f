"""The story of one run, ``run.json``: clocks, host, versions, and what made its numbers.

The pace of this machine, measured, so that estimates of run times hold on it.
"""

import contextlib
import functools
import hashlib
import os
import platform
import time
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib import metadata
from typing import Any

from cpic_core import compute_once, digest_of, fingerprint, promise_of
from cpic_planner.jobs.folder import RunFolder
from cpic_planner.jobs.written_files import LIST_NAME
from cpic_planner.results import FingerprintRecord, RunRecord

RECORD = "run.json"


def run_record(folder: RunFolder, run: object, **given: Any) -> RunRecord:
    """Return the record of a run that ends now.

    Parameters
    ----------
    folder : RunFolder
    run : object
        Has the workers and counts that a `RunRecord` names.
    **given
        Its other fields.
    """
    others = [other for other in folder.fingerprints if other != folder.fingerprint]
    return RunRecord.of(
        run,
        fingerprint=folder.fingerprint,
        finished_utc=datetime.now(UTC).isoformat(timespec="seconds"),
        host=host(),
        versions=versions(),
        software=FingerprintRecord.of(fingerprint(), processor=list(fingerprint().processor)),
        other_fingerprints=others,
        promise=promise_of(folder.fingerprint, *others),
        list_sha256=digest_of(folder.path / LIST_NAME),
        **given,
    )


def host() -> dict[str, Any]:
    """Return system, machine, Python, and number of cores: for the record of a run, never for its results."""
    system = {"system": platform.system(), "machine": platform.machine(), "python": platform.python_version()}
    return system | {"cpu_count": os.cpu_count()}


def versions() -> dict[str, str]:
    """Return versions of this package and of those that its results rest on."""
    names = ("cpic-planner", "numpy", "scipy", "astropy", "photutils", "numba", "pydantic", "dask")
    installed = dict.fromkeys(names, "not installed")
    for name in names:
        with contextlib.suppress(metadata.PackageNotFoundError):
            installed[name] = metadata.version(name)
    return installed


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
