"""Record what made a number: the code, presets and catalogue as installed, the numerical libraries, the processor.

A fingerprint is written as five words of eight hexadecimal digits, ``code-presets-catalogue-libraries-processor``. The
same question gives the same bytes where all five are equal. Where only the processor differs, numpy, BLAS and the
mathematical functions of the C library take other routes to the same sums: computed numbers agree within `TOLERANCE`.
A count that is drawn is now and then the next one, where a mean lies on the edge between two, so that what is measured
in images agrees within `TOLERANCE_SIGMA`.

It takes about 75 ms, once a process: what writes runs and products asks for it, short answers do not.
"""

import functools
import hashlib
import importlib
import importlib.metadata
import importlib.util
import os
import platform
from collections.abc import Iterator, Mapping
from dataclasses import fields
from pathlib import Path

from cpic_core.records import Record

PACKAGES = ("cpic_core", "catalogs", "simulator", "cpic_planner")
"""The packages of the distribution."""
LIBRARIES = (
    *("numpy", "scipy", "numba", "llvmlite", "astropy", "pyerfa", "synphot", "sep"),
    *("pandas", "pyarrow", "matplotlib", "pillow"),
)
"""Distributions on which numbers, or the bytes of products, rest."""
TOLERANCE = 1e-9
"""Largest relative difference of computed numbers between processors; ``tests/cpic_planner/test_same_bytes.py``
measures it."""
TOLERANCE_SIGMA = 0.05
"""Largest difference of what is measured in drawn images between processors, in units of its own error."""
PROMISES = (
    "same bytes",
    f"computed numbers equal within {TOLERANCE:.0e}, measurements of images within {TOLERANCE_SIGMA:g} of their errors",
)
"""Promises between runs whose fingerprints are equal, and between those that differ in the processor alone."""
_COMPILED = (".so", ".pyd", ".dylib", ".dll")
_TUNED = ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "GLIBC_TUNABLES")  # other code than the processor's own


class Fingerprint(Record):
    """Record of what made a number; ``str`` writes it as five words.

    Attributes
    ----------
    code, presets, catalogue : str
        SHA-256 of the files of the installed packages: Python code and shipped data, presets, star and planet tables.
    libraries : mapping of str to str
        Version, and hash of the compiled files, by distribution; Python and the C library too.
    processor : tuple of str
        Machine, its features, the kernels that BLAS takes for it, and what numba and the C library were told to take.
    """

    code: str
    presets: str
    catalogue: str
    libraries: Mapping[str, str]
    processor: tuple[str, ...]

    def __str__(self) -> str:
        libraries, processor = repr(sorted(self.libraries.items())), repr(self.processor)
        words = self.code, self.presets, self.catalogue, _hash(libraries.encode()), _hash(processor.encode())
        return "-".join(word[:8] for word in words)

    def differences(self, other: "Fingerprint") -> list[str]:
        """Say what another fingerprint has otherwise, the processor apart, each in a few words.

        Parameters
        ----------
        other : Fingerprint

        Returns
        -------
        list of str
        """
        found = [f"other {name}" for name in ("code", "presets", "catalogue") if vars(self)[name] != vars(other)[name]]
        for name in {**self.libraries, **other.libraries}:
            there, here = (one.libraries.get(name, "not installed") for one in (other, self))
            versions = there.split(" ")[0], here.split(" ")[0]
            if versions[0] != versions[1]:
                found.append(f"{name} {versions[0]} (here {versions[1]})")
            elif there != here:
                found.append(f"another build of {name} {versions[0]}")
        return found


WORDS = tuple(field.name for field in fields(Fingerprint))
"""What the five words are about, in order."""


def differing_words(one: str, other: str) -> list[str]:
    """Return what two written fingerprints differ in, of `WORDS`; everything where one is not readable."""
    words = one.split("-"), other.split("-")
    if not len(words[0]) == len(words[1]) == len(WORDS):
        return list(WORDS)
    return [name for name, mine, theirs in zip(WORDS, *words, strict=True) if mine != theirs]


def promise_of(*fingerprints: str) -> str:
    """Return which of `PROMISES` holds between written fingerprints that differ in nothing but the processor."""
    return PROMISES[len(set(fingerprints)) > 1]


@functools.cache
def fingerprint() -> Fingerprint:
    """Return the fingerprint of this process.

    Examples
    --------
    >>> from cpic_core import fingerprint
    >>> [len(word) for word in str(fingerprint()).split("-")]
    [8, 8, 8, 8, 8]
    """
    sums = {name: hashlib.sha256() for name in WORDS[:3]}
    for package in PACKAGES:
        for name, path in _files(package):
            sums[_kind(name)].update(f"{name}\0{_hash(path.read_bytes())}\0".encode())
    code, presets, catalogue = (one.hexdigest() for one in sums.values())
    return Fingerprint(code, presets, catalogue, _libraries(), _processor())


def _files(package: str) -> Iterator[tuple[str, Path]]:
    """Yield name, below the packages, and path of every shipped file of one, wherever it is installed."""
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        return
    home = Path(spec.origin).parent
    for base, folders, names in os.walk(home):
        folders[:] = sorted(name for name in folders if name != "__pycache__" and not name.startswith("."))
        for name in sorted(names):
            if not name.startswith(".") and not name.endswith((".pyc", ".nbi", ".nbc", "~")):
                path = Path(base, name)
                yield f"{package}/{path.relative_to(home).as_posix()}", path


def _kind(name: str) -> str:
    """Return which word a shipped file belongs to."""
    if name.split("/")[1] == "presets":
        return "presets"
    return "catalogue" if name.startswith(("catalogs/data/", "catalogs/parsed/")) else "code"


def _libraries() -> dict[str, str]:
    found = {"python": platform.python_version(), "libc": "".join(platform.libc_ver()) or "unknown"}
    for name in LIBRARIES:
        try:
            about = importlib.metadata.distribution(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "not installed"
            continue
        # The installer's record has the sum of every compiled file, that of a BLAS in the wheel too.
        lines = sorted(line for line in (about.read_text("RECORD") or "").splitlines() if _is_compiled(line))
        build = f" {_hash(chr(10).join(lines).encode())[:8]}" if lines else ""
        found[name] = f"{about.version}{build}"
    return found


def _is_compiled(line: str) -> bool:
    name = line.split(",", 1)[0]
    return name.endswith(_COMPILED) or ".so." in name.rsplit("/", 1)[-1]


def _processor() -> tuple[str, ...]:
    from threadpoolctl import threadpool_info

    try:
        # What numpy shows in public is only what it has kernels for; the C library chooses by other features too.
        features = importlib.import_module("numpy._core._multiarray_umath").__cpu_features__
    except (ImportError, AttributeError):  # a private name, which other versions may not have
        features = {}
    blas = (one for one in threadpool_info() if "numpy" in str(one["filepath"]))  # scipy's comes later, or not at all
    kernels = sorted({str(one["architecture"]) for one in blas if one.get("architecture")})
    tuned = [f"{name}={os.environ[name]}" for name in _TUNED if os.environ.get(name)]
    return (platform.machine(), *sorted(name for name, has in features.items() if has), *kernels, *tuned)


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
