"""The story of one run, ``run.json``: clocks, host, versions, and what made its numbers."""

import contextlib
import os
import platform
from datetime import UTC, datetime
from importlib import metadata
from typing import Any

from cpic_core import digest_of, fingerprint, promise_of
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
